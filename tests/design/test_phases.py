"""The phase between engines: against firing angles changed one by one, and its worst
against all phases tried out.
"""

import dataclasses

import jax
import numpy as np
import pytest
from tolerances import GRADIENT

import jaxhb
from jaxhb import Cylinder, Disk, Ground, Load, Mesh, Phase, SceneError, Shaft, Torque
from jaxhb.design import Objective, phases

RPM = np.array([240.0, 310.0, 420.0])


def engine(name, angles):
    yield Disk(name=name, inertia=25.0, damping=4.0)
    yield Disk(name=f"{name} pinion", inertia=2.0, radius=0.2)
    yield Shaft(
        name=f"{name} clutch",
        between=(name, f"{name} pinion"),
        stiffness=2e5,
        damping=150.0,
    )
    for k, angle in enumerate(angles):
        yield Cylinder(
            name=f"{name} {k + 1}",
            disk=name,
            firing_angle=angle,
            bore=0.2,
            stroke=0.3,
            rod=0.6,
            reciprocating_mass=20.0,
            orders=6,
            gas_torque_mean=400.0,
            gas_torque=((0.5, 300.0, 100.0), (1.5, 700.0, -200.0), (2.5, -80.0, 150.0)),
        )


def plant(port=(0.0, 360.0), *, backlash=None, phases=()):
    """Two four-stroke engines at twice the speed of the wheel, one with the torque of a
    pump as well.
    """
    yield from engine("port", port)
    yield from engine("starboard", (0.0, 240.0, 480.0))
    yield Disk(name="wheel", inertia=40.0, radius=0.4)
    yield Disk(name="propeller", inertia=150.0)
    yield Shaft(
        name="line",
        between=("wheel", "propeller"),
        stiffness=1e6,
        damping=500.0,
        diameter=0.12,
    )
    for name in ("port", "starboard"):
        mesh = Mesh(
            name=name + " mesh",
            between=(f"{name} pinion", "wheel"),
            stiffness=1e9,
            damping=3e4,
        )
        yield (
            dataclasses.replace(mesh, backlash=backlash, epsilon=1e-3, transition=0.04)
            if backlash
            else mesh
        )
    yield Torque(
        name="pump",
        disk="port pinion",
        harmonics=((3.0, 60.0, -30.0),),
        orders_of="reference",
    )
    yield Load(disk="propeller", harmonics=((4.0, 0.05, 0.0),))
    yield Ground(disk="propeller", stiffness=1.0)
    yield from phases


def built(port=(0.0, 360.0), *, backlash=None, phases=()):
    return jaxhb.build(
        [*plant(port, backlash=backlash, phases=phases)],
        reference="wheel",
        revolutions_per_cycle=1,
        name="plant",
    )


TURN = Phase(name="turn", of=("port", "pump"), angle=25.0)


@pytest.mark.slow
def test_a_phase_is_the_same_as_every_firing_angle_changed():
    train = built(phases=[dataclasses.replace(TURN, of=("port",))])
    by_phase = jaxhb.forced_response(train, rpm=RPM).torques
    by_angles = jaxhb.forced_response(built((25.0, 385.0)), rpm=RPM).torques
    rounding = 1e-11 * np.abs(by_angles).max()
    np.testing.assert_allclose(by_phase, by_angles, rtol=0, atol=rounding)
    twice = jaxhb.forced_response(train.repeated(2), rpm=RPM).torques[..., ::2]
    np.testing.assert_allclose(twice, by_phase, rtol=0, atol=rounding)
    # The rotor counts for torques in orders of the reference: 25 deg of it, order 1.5,
    # are 12.5 deg at order 3.
    turned = jaxhb.forced_response(
        built(phases=[dataclasses.replace(TURN, of=("pump",))]), rpm=RPM
    ).torques
    later = complex(60.0, -30.0) * np.exp(-1.5j * np.deg2rad(25.0))
    changed = built().replace({"pump.harmonics": [(later.real, later.imag)]})
    expected = jaxhb.forced_response(changed, rpm=RPM).torques
    np.testing.assert_allclose(
        turned, expected, rtol=0, atol=1e-11 * np.abs(expected).max()
    )


@pytest.mark.slow
def test_the_angle_is_a_number_with_derivatives():
    train = built(phases=[TURN])

    def swing(angle):
        return (
            jaxhb.forced_response(train.replace({"turn.angle": angle}), rpm=300.0)
            .torque("line")
            .smooth_peak()
        )

    slope = jax.jit(jax.grad(swing))(25.0)
    h = 1e-4
    assert float(slope) == pytest.approx(
        float(swing(25.0 + h) - swing(25.0 - h)) / (2 * h), rel=100 * GRADIENT
    )
    assert abs(float(slope)) > 1.0


@pytest.mark.slow
def test_the_worst_phase_of_a_linear_train_is_that_of_all_phases_tried_out():
    train = built(phases=[TURN])
    of = [
        Objective(quantity="shaft torque", of="line"),
        Objective(quantity="shaft torque order", of="line", order=3.0),
        Objective(quantity="tooth force", of="starboard mesh"),
        Objective(quantity="stress", of="line"),
    ]
    result = jaxhb.worst_phase(train, "turn", rpm=RPM, of=of)
    assert result.circle == 720.0
    tried = np.arange(0.0, 720.0, 2.0)

    def at(angle):
        turned = train.replace({"turn.angle": float(angle)})
        response = jaxhb.forced_response(turned, rpm=RPM)
        line = response.torque("line")
        swing = np.asarray(line.half_peak_to_peak)
        order = np.asarray(line.order(3.0))
        force = np.asarray(response.force("starboard mesh").half_peak_to_peak)
        stress = 16 * swing / (np.pi * 0.12**3)
        return np.stack([swing, order, force, stress], -1)

    values = np.stack([at(angle) for angle in tried], -1)
    assert (result.worst >= values.max(-1) * (1 - 1e-12)).all()
    np.testing.assert_allclose(result.worst, values.max(-1), rtol=2e-3)
    np.testing.assert_allclose(result.nominal, at(25.0), rtol=1e-10)
    # The worst is the response of the train at the phase that is named.
    for s in range(len(RPM)):
        for q in range(len(of)):
            assert at(result.angle[s, q])[s, q] == pytest.approx(
                result.worst[s, q], rel=1e-9
            )
    # The worst of one order is exactly the sum of both engines' amplitudes.
    without_pump = train.replace({"pump.harmonics": [(0.0, 0.0)]})
    quiet = {
        f"port {k}.{field}": 0.0
        for k in (1, 2)
        for field in ("gas_factor", "reciprocating_mass")
    }
    both = jaxhb.forced_response(without_pump, rpm=RPM).torque("line")
    starboard_alone = without_pump.replace(quiet)
    starboard = jaxhb.forced_response(starboard_alone, rpm=RPM).torque("line")
    n = list(np.asarray(both.orders)).index(3.0)
    of_starboard = np.asarray(starboard.coefficients)[:, n + 1]
    of_port = np.asarray(both.coefficients)[:, n + 1] - of_starboard
    order = jaxhb.worst_phase(without_pump, "turn", rpm=RPM, of=of[1:2])
    np.testing.assert_allclose(
        order.worst[:, 0], 2 * (np.abs(of_starboard) + np.abs(of_port)), rtol=1e-9
    )


@pytest.mark.slow
def test_a_long_cycle_is_turned_through_one_engine_cycle():
    """A cycle of five revolutions of the wheel holds five engine cycles, after each of
    which all repeats.
    """
    long = jaxhb.build(
        [*plant(phases=[TURN])],
        reference="wheel",
        revolutions_per_cycle=5,
        name="plant",
    )
    of = [Objective(quantity="shaft torque order", of="line", order=3.0)]
    result, expected = (
        jaxhb.worst_phase(train, "turn", rpm=RPM[:1], of=of)
        for train in (long, built(phases=[TURN]))
    )
    assert result.circle == expected.circle == 720.0
    assert len(result.angles) == len(expected.angles)
    np.testing.assert_allclose(result.worst, expected.worst, rtol=1e-9)
    np.testing.assert_allclose(result.angle, expected.angle, atol=1e-3)


@pytest.mark.slow
def test_with_backlash_phases_in_contact_are_those_of_the_linear_train():
    """Under a heavy load the teeth stay in contact: the train without backlash is the
    second way.
    """
    heavy = {
        f"{name}.gas_torque_mean": 2e4
        for name in ("port 1", "port 2", *(f"starboard {k}" for k in (1, 2, 3)))
    }
    of = [Objective(quantity="tooth force", of="port mesh")]
    linear, loose = (
        jaxhb.worst_phase(
            built(phases=[TURN], backlash=backlash).replace(heavy),
            "turn",
            of=of,
            rpm=[300.0],
            phases=12,
        )
        for backlash in (None, 1e-4)
    )
    np.testing.assert_allclose(loose.values, linear.values, rtol=1e-9)
    assert loose.worst[0, 0] > loose.values.max()
    assert loose.worst[0, 0] == pytest.approx(linear.worst[0, 0], rel=1e-9)


@pytest.mark.slow
def test_only_speeds_at_which_teeth_may_part_are_marched(monkeypatch):
    """At 310 rpm the teeth of this load leave contact at some phase, at 420 rpm at
    none; steady states of single trains are the second way at both.
    """
    rpm = np.array([310.0, 420.0])
    names = ("port 1", "port 2", *(f"starboard {k}" for k in (1, 2, 3)))
    train = built(phases=[TURN], backlash=1e-4).replace(
        {f"{name}.gas_torque_mean": 2600.0 for name in names}
    )
    of = [Objective(quantity="tooth force", of="port mesh")]
    marched = []

    def counted(train, *, rpm, exact):
        marched.extend(rpm)
        return jaxhb.steady_state(train, rpm=rpm, exact=exact)

    monkeypatch.setattr(phases, "steady_state", counted)
    found = jaxhb.worst_phase(train, "turn", rpm=rpm, of=of, phases=6)
    assert set(marched) == {310.0}
    # Extremes are read from samples, of which responses have other numbers; those of
    # recorded cycles are good to about 1 %.
    tolerance = {310.0: 1e-2, 420.0: 2e-3}
    for k, angle in enumerate(found.angles):
        turned = train.replace({"turn.angle": float(angle)})
        for i, speed in enumerate(rpm):
            force = jaxhb.steady_state(turned, rpm=float(speed)).force("port mesh")
            assert found.values[i, 0, k] == pytest.approx(
                float(force.half_peak_to_peak), rel=tolerance[float(speed)]
            )
    assert (found.worst[:, 0] >= found.values[:, 0].max(-1) * (1 - 1e-12)).all()


@pytest.mark.slow
def test_irregular_motions_have_a_worst_phase():
    """Lightly loaded teeth rattle irregularly at 500 rpm: recorded cycles have the
    largest force, and no smooth measure of impacts.
    """
    names = ("port 1", "port 2", *(f"starboard {k}" for k in (1, 2, 3)))
    train = built(phases=[TURN], backlash=1e-4).replace(
        {f"{name}.gas_torque_mean": 50.0 for name in names}
    )
    of = [
        Objective(quantity="tooth force", of="port mesh"),
        Objective(quantity="impact severity", of="port mesh"),
    ]
    found = jaxhb.worst_phase(train, "turn", rpm=[500.0], of=of, phases=3)
    alone = jaxhb.steady_state(train, rpm=500.0)
    assert alone.kind == "irregular"
    # Both are the largest of a record of a motion that does not repeat.
    assert found.nominal[0, 0] == pytest.approx(
        float(alone.force("port mesh").half_peak_to_peak), rel=0.05
    )
    assert np.isfinite(found.values[0, 0]).all()
    assert np.isnan(found.nominal[0, 1])
    assert found.left_out == (
        "plant, at some phases, at 500 rpm: recorded cycles do not tell the impact"
        " severity.",
    )


@pytest.mark.slow
def test_no_share_of_a_stress_limit_is_told_above_the_range_of_its_rule():
    """1.05 of the rated speed: 241.5 rpm."""

    def with_limits(part):
        if getattr(part, "name", None) != "line":
            return part
        return dataclasses.replace(part, tensile_strength=6e8, stress_concentration=0.5)

    turn = Phase(name="turn", of=["starboard"], angle=0.0)
    parts = [with_limits(part) for part in plant(phases=[turn])]
    train = jaxhb.build(
        parts, reference="wheel", revolutions_per_cycle=1, rated_rpm=230.0, name="plant"
    )
    share = Objective(quantity="stress over continuous limit", of="line")
    result = jaxhb.worst_phase(train, "turn", rpm=[200.0, 240.0, 310.0], of=[share])
    for values in (result.nominal, result.worst, result.best):
        assert (values[:2, 0] > 0).all()
        assert np.isnan(values[2, 0])


def test_a_wrong_phase_is_refused_in_a_sentence():
    wrong = {"a": ("prt",), "b": ("port", "propeller gas"), "c": ()}
    with pytest.raises(SceneError) as refusal:
        built(phases=[Phase(name=name, of=of) for name, of in wrong.items()])
    faults = [sentence.split(": of", 1)[1] for sentence in refusal.value.sentences]
    assert faults == [
        ": there is no cylinder, torque or engine 'prt'. Did you mean 'port'?",
        (
            ": there is no cylinder, torque or engine 'propeller gas'. Known: 'port 1',"
            " 'port 2', 'starboard 1', 'starboard 2', 'starboard 3', 'pump', 'port',"
            " 'starboard'."
        ),
        " is empty. Name the cylinders and torques, or their engine.",
    ]
    wheel = Torque(name="gas", disk="wheel", harmonics=((1.0, 1.0, 0.0),))
    with pytest.raises(SceneError, match="turns at 2 speeds, must be on one rotor"):
        built(phases=[wheel, Phase(name="a", of=("port", "gas"))])
    with pytest.raises(
        SceneError, match="there is no phase 'trn'. Did you mean 'turn'?"
    ):
        jaxhb.worst_phase(built(phases=[TURN]), "trn", rpm=RPM)

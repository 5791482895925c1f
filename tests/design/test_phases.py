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
from jaxhb.design import Objective

RPM = np.array([240.0, 310.0, 420.0])
GAS = {"bore": 0.2, "stroke": 0.3, "rod": 0.6, "reciprocating_mass": 20.0, "orders": 6}
FIRED = {
    "gas_torque_mean": 400.0,
    "gas_torque": ((0.5, 300.0, 100.0), (1.5, 700.0, -200.0), (2.5, -80.0, 150.0)),
}


def engine(name, angles):
    yield from (
        Disk(name=name, inertia=25.0, damping=4.0),
        Disk(name=f"{name} pinion", inertia=2.0, radius=0.2),
    )
    yield Shaft(
        name=f"{name} clutch",
        between=(name, f"{name} pinion"),
        stiffness=2e5,
        damping=150.0,
    )
    for k, angle in enumerate(angles):
        yield Cylinder(
            name=f"{name} {k + 1}", disk=name, firing_angle=angle, **GAS, **FIRED
        )


def plant(
    port=(0.0, 360.0), starboard=(0.0, 240.0, 480.0), *, backlash=None, phases=()
):
    """Two four-stroke engines at twice the speed of the wheel, one with a given torque
    as well.
    """
    yield from (*engine("port", port), *engine("starboard", starboard))
    yield from (
        Disk(name="wheel", inertia=40.0, radius=0.4),
        Disk(name="propeller", inertia=150.0),
    )
    yield Shaft(
        name="line",
        between=("wheel", "propeller"),
        stiffness=1e6,
        damping=500.0,
        diameter=0.12,
    )
    for name in ("port", "starboard"):
        gap = (
            {"backlash": backlash, "epsilon": 1e-3, "transition": 0.04}
            if backlash
            else {}
        )
        yield Mesh(
            name=name + " mesh",
            between=(f"{name} pinion", "wheel"),
            stiffness=1e9,
            damping=3e4,
            **gap,
        )
    yield Torque(
        name="pump",
        disk="port pinion",
        harmonics=((3.0, 60.0, -30.0),),
        orders_of="reference",
    )
    yield from (
        Load(disk="propeller", harmonics=((4.0, 0.05, 0.0),)),
        Ground(disk="propeller", stiffness=1.0),
    )
    yield from phases


def built(*args, **how):
    return jaxhb.build(
        [*plant(*args, **how)], reference="wheel", revolutions_per_cycle=1, name="plant"
    )


TURN = Phase(name="turn", of=("port", "pump"), angle=25.0)


def test_a_phase_is_the_same_as_every_firing_angle_changed():
    found = built(phases=[dataclasses.replace(TURN, of=("port",))])
    one, two = (
        jaxhb.forced_response(t, rpm=RPM) for t in (found, built((25.0, 385.0)))
    )
    np.testing.assert_allclose(
        one.torques, two.torques, rtol=0, atol=1e-11 * np.abs(two.torques).max()
    )
    twice = jaxhb.forced_response(found.repeated(2), rpm=RPM).torques[..., ::2]
    np.testing.assert_allclose(
        twice, one.torques, rtol=0, atol=1e-11 * np.abs(two.torques).max()
    )
    # Of what orders of the reference are given the rotor counts: 25 deg of it, order
    # 1.5, are 12.5 deg at order 3.
    turned = jaxhb.forced_response(
        built(phases=[dataclasses.replace(TURN, of=("pump",))]), rpm=RPM
    )
    later = complex(60.0, -30.0) * np.exp(-1.5j * np.deg2rad(25.0))
    changed = built().replace({"pump.harmonics": [(later.real, later.imag)]})
    wanted = jaxhb.forced_response(changed, rpm=RPM)
    np.testing.assert_allclose(
        turned.torques,
        wanted.torques,
        rtol=0,
        atol=1e-11 * np.abs(wanted.torques).max(),
    )


def test_the_angle_is_a_number_with_derivatives():
    train = built(phases=[TURN])

    def swing(angle):
        return (
            jaxhb.forced_response(train.replace({"turn.angle": angle}), rpm=300.0)
            .torque("line")
            .smooth_peak()
        )

    slope = jax.grad(swing)(25.0)
    h = 1e-4
    assert float(slope) == pytest.approx(
        float(swing(25.0 + h) - swing(25.0 - h)) / (2 * h), rel=100 * GRADIENT
    )
    assert abs(float(slope)) > 1.0


def test_the_worst_phase_of_a_linear_train_is_that_of_all_phases_tried_out():
    train = built(phases=[TURN])
    of = [
        Objective(quantity="shaft torque", of="line"),
        Objective(quantity="shaft torque order", of="line", order=3.0),
        Objective(quantity="tooth force", of="starboard mesh"),
        Objective(quantity="stress", of="line"),
    ]
    found = jaxhb.worst_phase(train, "turn", rpm=RPM, of=of)
    assert found.circle == 720.0
    tried = np.arange(0.0, 720.0, 2.0)

    def at(angle, rpm=RPM):
        r = jaxhb.forced_response(train.replace({"turn.angle": float(angle)}), rpm=rpm)
        line = r.torque("line")
        swing = np.asarray(line.half_peak_to_peak)
        order = np.asarray(line.order(3.0))
        stress = 16 * swing / (np.pi * 0.12**3)
        return np.stack(
            [
                swing,
                order,
                np.asarray(r.force("starboard mesh").half_peak_to_peak),
                stress,
            ],
            -1,
        )

    values = np.stack([at(angle) for angle in tried], -1)
    assert (found.worst >= values.max(-1) * (1 - 1e-12)).all()
    np.testing.assert_allclose(found.worst, values.max(-1), rtol=2e-3)
    np.testing.assert_allclose(found.nominal, at(25.0), rtol=1e-10)
    for s in range(len(RPM)):  # it is what the train does at the phase that is named
        for q in range(len(of)):
            assert at(found.angle[s, q])[s, q] == pytest.approx(
                found.worst[s, q], rel=1e-9
            )
    # Of one order exactly the sum of both engines' amplitudes.
    none = train.replace({"pump.harmonics": [(0.0, 0.0)]})
    quiet = {
        f"port {k}.{field}": 0.0
        for k in (1, 2)
        for field in ("gas_factor", "reciprocating_mass")
    }
    own = none.replace({})
    others = none.replace(quiet)
    whole, rest = (
        jaxhb.forced_response(t, rpm=RPM).torque("line") for t in (own, others)
    )
    n = list(np.asarray(whole.orders)).index(3.0)
    a = np.asarray(rest.coefficients)[:, n + 1]
    b = np.asarray(whole.coefficients)[:, n + 1] - a
    alone = jaxhb.worst_phase(none, "turn", rpm=RPM, of=of[1:2])
    np.testing.assert_allclose(
        alone.worst[:, 0], 2 * (np.abs(a) + np.abs(b)), rtol=1e-9
    )


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
    found, wanted = (
        jaxhb.worst_phase(train, "turn", rpm=RPM[:1], of=of)
        for train in (long, built(phases=[TURN]))
    )
    assert found.circle == wanted.circle == 720.0
    assert len(found.angles) == len(wanted.angles)
    np.testing.assert_allclose(found.worst, wanted.worst, rtol=1e-9)
    np.testing.assert_allclose(found.angle, wanted.angle, atol=1e-3)


def test_with_backlash_phases_are_solved_round_the_circle():
    """Under a heavy load the teeth stay in contact: the train without backlash is the
    second way.
    """
    heavy = {
        f"{name}.gas_torque_mean": 2e4
        for name in ("port 1", "port 2", *(f"starboard {k}" for k in (1, 2, 3)))
    }
    of = [Objective(quantity="tooth force", of="port mesh")]
    how = {"rpm": [300.0], "phases": 12}
    linear, found = (
        jaxhb.worst_phase(
            built(phases=[TURN], backlash=gap).replace(heavy), "turn", of=of, **how
        )
        for gap in (None, 1e-4)
    )
    np.testing.assert_allclose(found.values, linear.values, rtol=1e-5)
    assert found.worst[0, 0] > found.values.max()
    assert found.worst[0, 0] == pytest.approx(linear.worst[0, 0], rel=1e-3)


def test_no_share_of_a_stress_limit_is_told_above_the_range_of_its_rule():
    """1.05 of the rated speed: 241.5 rpm."""
    steel = {"tensile_strength": 6e8, "stress_concentration": 0.5}
    parts = [
        (
            dataclasses.replace(part, **steel)
            if getattr(part, "name", None) == "line"
            else part
        )
        for part in plant(phases=[Phase(name="turn", of=["starboard"], angle=0.0)])
    ]
    train = jaxhb.build(
        parts, reference="wheel", revolutions_per_cycle=1, rated_rpm=230.0, name="plant"
    )
    share = Objective(quantity="stress over continuous limit", of="line")
    found = jaxhb.worst_phase(train, "turn", rpm=[200.0, 240.0, 310.0], of=[share])
    for values in (found.nominal, found.worst, found.best):
        assert (values[:2, 0] > 0).all()
        assert np.isnan(values[2, 0])


def test_what_is_no_phase_is_said_in_a_sentence():
    wrong = {"a": ("prt",), "b": ("port", "propeller gas"), "c": ()}
    with pytest.raises(SceneError) as told:
        built(phases=[Phase(name=name, of=of) for name, of in wrong.items()])
    assert [s.split(": of", 1)[1] for s in told.value.sentences] == [
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

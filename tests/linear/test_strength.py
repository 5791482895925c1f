"""Stresses, tooth torques and heat beside their limits: values of the rule by hand,
energies, differences.
"""

import dataclasses

import jax
import numpy as np
import pytest
from trains import build

import jaxhb
from jaxhb import Damper, Disk, Load, Mesh, SceneError, Shaft, Torque
from jaxhb.linear import strength
from jaxhb.results.record import Record, RecordedSignal

# d mm, sigma_B MPa, C_K, lambda; tau_C and tau_T in MPa, worked out with 30 digits from
# the text of the rule
RULE = (
    (400, 600, 1.0, 0.5, 66.562193, 113.155729),
    (400, 600, 0.6, 0.9, 22.045398, 48.382828),
    (55, 600, 0.6, 0.2, 56.757040, 124.564139),
    (150, 500, 0.45, 0.89, 16.151610, 40.931577),
    (80, 1000, 1.0, 1.05, 54.253301, 92.230612),  # counted as 800 MPa
    (800, 400, 0.8, 0.0, 44.371942, 84.335878),
)

STEEL = {
    "length": 0.4,
    "outer": 0.06,
    "inner": 0.02,
    "shear_modulus": 8e10,
    "magnifier": 30.0,
    "damping_hz": 40.0,
}
KEYWAY = {"stress_concentration": 0.6, "tensile_strength": 6e8}
FLANGE = {"stress_concentration": 1.0, "tensile_strength": 7e8}
GEARED = [
    Disk(name="engine", inertia=1.0, damping=0.2),
    Disk(name="pinion", inertia=0.02, radius=0.05),
    Disk(name="wheel", inertia=0.3, radius=0.15),
    Disk(name="mill", inertia=2.0, damping=0.1),
    Shaft(
        between=("engine", "pinion"),
        name="coupling",
        **STEEL,
        diameter=0.055,
        bore=0.02,
        **KEYWAY,
        power_limit=5.0,
    ),
    Shaft(
        between=("wheel", "mill"),
        stiffness=2e5,
        damping_ratio=0.01,
        damping_hz=60.0,
        diameter=0.08,
        **FLANGE,
    ),
    Mesh(
        between=("pinion", "wheel"),
        stiffness=2e8,
        magnifier=15.0,
        damping_hz=800.0,
        rated_torque=300.0,
    ),
    Damper(
        name="ring",
        disk="engine",
        inertia=0.1,
        stiffness=2e4,
        damping_ratio=0.1,
        damping_hz=50.0,
        power_limit=20.0,
    ),
    Torque(
        disk="engine",
        mean=1e3,
        harmonics=((0.5, 2400.0, 600.0), (1.0, -1200.0, 400.0), (2.0, 300.0, 800.0)),
    ),
    Load(disk="mill"),
]
RPM = np.linspace(500.0, 3300.0, 29)
SAMPLED = 1e-5
"""Extremes among 4096 samples of the cycle against those among 20,000."""


def geared(parts=GEARED):
    return jaxhb.build(parts, reference="engine", rated_rpm=3000.0, name="geared")


@pytest.fixture(scope="module")
def response():
    return jaxhb.forced_response(geared(), rpm=RPM)


@pytest.mark.parametrize("row", RULE)
def test_limits_are_those_of_the_rule_worked_out_by_hand(row):
    d, sigma, form, ratio, *wanted = row
    given = {
        "diameter": d / 1e3,
        "stress_concentration": form,
        "tensile_strength": 1e6 * sigma,
    }
    found = jaxhb.permissible_stress(**given, speed_ratio=ratio)
    np.testing.assert_allclose(np.array(found) / 1e6, wanted, rtol=0, atol=5.1e-7)


def test_bounds_of_barred_ranges_lie_where_the_interpolated_stress_meets_the_limit():
    rpm = np.array([400.0, 100.0, 200.0, 300.0, 500.0, 600.0, 700.0])
    stress = np.array([10.0, 50.0, 10.0, 40.0, np.nan, 35.0, 90.0])
    limit = np.array([20.0, 20.0, 30.0, 20.0, 20.0, 20.0, np.inf])
    first, middle, last = jaxhb.barred_ranges(rpm, stress, limit, 1.5 * limit)
    # stress less limit by speed: 30, -20, 20, -10, (none), 15, (no limit)
    assert (first.low, first.open_below, first.high) == (
        100.0,
        True,
        pytest.approx(160.0),
    )
    assert (middle.low, middle.high) == (
        pytest.approx(250.0),
        pytest.approx(300.0 + 200.0 / 3),
    )
    assert (last.low, last.high, last.open_above) == (
        pytest.approx(400.0 + 200.0 * 10 / 25),
        600.0,
        True,
    )
    assert [one.at for one in (first, middle, last)] == [100.0, 300.0, 600.0]
    assert [one.share for one in (first, middle, last)] == [2.5, 2.0, 1.75]
    assert [one.passable for one in (first, middle, last)] == [False, False, False]
    assert jaxhb.barred_ranges(rpm, stress / 5, limit, limit) == ()
    assert all(
        one.passable for one in jaxhb.barred_ranges(rpm, stress, limit, 3 * limit)
    )


def test_stresses_tooth_torques_and_heat_are_those_of_the_samples(response):
    found = jaxhb.strength(response)
    coupling = response.torque("coupling")
    line = response.torque("wheel|mill")
    for name, signal, (d, b) in (
        ("coupling", coupling, (0.055, 0.02)),
        ("wheel|mill", line, (0.08, 0.0)),
    ):
        samples = signal.samples(20_000)
        polar = np.pi / 32 * (d**4 - b**4)
        wanted = np.ptp(samples, axis=-1) / 2 * (d / 2) / polar
        np.testing.assert_allclose(found.stresses[name].stress, wanted, rtol=SAMPLED)
    force = response.force("pinion|wheel").samples(20_000)
    tooth = found.tooth_torques["pinion|wheel"]
    np.testing.assert_allclose(
        tooth.vibratory, 0.05 * np.ptp(force, axis=-1) / 2, rtol=SAMPLED
    )
    np.testing.assert_allclose(tooth.mean, 0.05 * force.mean(-1), rtol=1e-9)
    np.testing.assert_array_equal(
        tooth.reverses, (force.min(-1) < 0) & (force.max(-1) > 0)
    )
    assert tooth.limit == pytest.approx(100.0)
    assert 0 < tooth.reverses.sum() < len(RPM)
    for name in ("coupling", "ring"):
        np.testing.assert_allclose(
            found.heat[name].power, response.power(name), rtol=1e-9
        )
    assert (found.heat["coupling"].limit, found.heat["ring"].limit) == (5.0, 20.0)
    rest = sum(
        response.power(name)
        for name in ("wheel|mill", "pinion|wheel", "engine", "mill")
    )
    np.testing.assert_allclose(
        sum(row.power for row in found.heat.values()) + rest,
        response.input_power,
        rtol=1e-9,
    )


def test_a_shaft_is_judged_at_its_own_section_or_at_that_of_its_stiffness():
    parts = [Disk(name=name, inertia=1.0) for name in "abc"]
    parts += [
        Shaft(between=("a", "b"), **STEEL),
        Shaft(between=("b", "c"), stiffness=1e5),
    ]
    train = build([*parts, Torque(disk="a", harmonics=((1.0, 10.0, 0.0),))])
    found = jaxhb.strength(jaxhb.forced_response(train, rpm=300.0))
    assert list(found.stresses) == ["a|b"]
    assert found.stresses["a|b"].continuous is None
    assert not found.barred
    assert strength.section(train, "a|b") == (0.06, 0.02)


def test_a_scene_without_such_keys_has_nothing_to_be_judged_by_and_no_arrays_more():
    train = jaxhb.load_scene("spur_pair")
    assert train.topology.link_keys == ()
    assert train.topology.rated_rpm is None
    assert not jaxhb.strength(jaxhb.forced_response(train, rpm=1500.0))
    assert train.shafts.outer is None
    assert train.meshes.magnifier is None
    assert train.dampers.power_limit is None


def test_a_response_without_a_train_needs_one(response):
    train = geared()
    bare = jax.jit(lambda rpm: jaxhb.forced_response(train, rpm=rpm))(RPM)
    with pytest.raises(ValueError, match="has no train: give train="):
        jaxhb.strength(bare)
    given = jaxhb.strength(bare, train=train).stresses["coupling"]
    both = jaxhb.strength(response).stresses["coupling"]
    for one, other in zip(given, both, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)


NUMBERS = [
    f"coupling.{key}" for key in (*STEEL, "diameter", "bore", *KEYWAY, "power_limit")
]
NUMBERS += [
    "pinion|wheel.rated_torque",
    "pinion|wheel.magnifier",
    "ring.damping_ratio",
    "ring.stiffness",
    "engine.inertia",
]


def test_above_the_rule_the_share_and_its_derivative_are_0():
    def shares(ratio, form):
        given = {
            "diameter": 0.1,
            "stress_concentration": form,
            "tensile_strength": 6e8,
            "speed_ratio": ratio,
        }
        return 3e7 / jax.numpy.stack(jaxhb.permissible_stress(**given))

    assert not shares(1.1, 0.5).any()
    assert not np.any(jax.jacrev(shares, (0, 1))(1.1, 0.5))


def test_a_steady_state_is_judged_as_the_motion_that_it_is(response):
    state = jaxhb.steady_state(geared(), rpm=RPM[4])
    found = jaxhb.strength(state)
    wanted = jaxhb.strength(response)
    assert found.stresses["coupling"].stress == pytest.approx(
        wanted.stresses["coupling"].stress[4], rel=SAMPLED
    )
    assert found.heat["ring"].power == pytest.approx(
        wanted.heat["ring"].power[4], rel=1e-9
    )
    recorded = jaxhb.strength(
        dataclasses.replace(state, response=None, record=record_of(state)),
        train=geared(),
    )
    assert recorded.stresses["coupling"].stress == pytest.approx(
        found.stresses["coupling"].stress, rel=SAMPLED
    )
    assert np.isnan(recorded.heat["ring"].power)


def record_of(state):
    """A record in which the torques and tooth forces of a steady state are those of one
    recorded cycle.
    """

    def recorded(signal):
        return RecordedSignal(
            signal.highest,
            signal.lowest,
            signal.mean,
            signal.rms,
            signal.amplitudes,
            2.0,
        )

    topology = state.topology
    torques = tuple(
        recorded(state.torque(name))
        for name in topology.shaft_names + topology.damper_names
    )
    forces = tuple(recorded(state.force(name)) for name in topology.mesh_names)
    return Record(
        topology,
        1,
        (),
        (),
        (),
        torques,
        (),
        forces,
        {},
        (),
        heat=(np.nan,) * len(torques),
    )


def test_a_limit_without_the_rated_speed_is_refused():
    with pytest.raises(
        SceneError,
        match=(
            "the key 'rated_rpm' is missing; the stress limits of 'coupling' and 'wheel"
        ),
    ):
        jaxhb.build(GEARED, reference="engine")


# Rule, sigma_B and Y in MPa, lambda; tau_C and tau_T in MPa, by hand from the text of
# the rule
KOREAN = (
    ("KR crankshaft A", 440, 225, 0.5, 39.0, 78.0),
    ("KR crankshaft A", 590, 225, 0.8, 29.64 * (1 + 2 / 3 * 150 / 440), 59.28),
    ("KR crankshaft B", 400, 450, 0.7, 30.79, 123.16),
    ("KR crankshaft B", 440, 450, 0.9, 21.51, 21.51),  # no passing above 0.8
    ("KR crankshaft A", 440, 0, 1.09, 21.0 + 237 * 0.29 * 0.3, 21.0 + 237 * 0.29 * 0.3),
    ("KR crankshaft B", 440, 0, 1.04, 16.0 + 237 * 0.24 * 0.2, 16.0 + 237 * 0.24 * 0.2),
    ("KR crankshaft B", 440, 0, 1.16, np.inf, np.inf),
    ("KR generator crankshaft A", 440, 0, 0.9, 21.0, 90.0),
    (
        "KR generator crankshaft B",
        1000,
        300,
        0.3,
        16.0 * (1 + 2 / 3 * 395 / 440),
        120.0,
    ),  # counted as 835 MPa
    ("KR generator shaft", 440, 225, 0.5, 31.0, 118.0),
    ("KR generator shaft", 550, 225, 1.1, 31.0 * 7 / 6, 31.0 * 7 / 6),
    ("KR generator shaft", 550, 225, 1.11, np.inf, np.inf),
)


@pytest.mark.parametrize("row", KOREAN)
def test_limits_of_crankshafts_and_generator_shafts_are_those_of_the_rule_worked_out_by_hand(
    row,
):
    rule, sigma, flow, ratio, *wanted = row
    found = jaxhb.permissible_stress(
        rule=rule,
        tensile_strength=1e6 * sigma,
        yield_strength=1e6 * flow,
        speed_ratio=ratio,
    )
    np.testing.assert_allclose(np.array(found) / 1e6, wanted, rtol=1e-12)


def test_every_rule_that_a_scene_may_name_has_its_source():
    assert set(strength.RULE) == set(strength.RULES)
    with pytest.raises(ValueError, match="there is no rule 'M86'. Did you mean 'M68'?"):
        jaxhb.permissible_stress(rule="M86", tensile_strength=4e8, speed_ratio=1.0)
    slope = jax.grad(
        lambda x: jaxhb.permissible_stress(
            rule="KR crankshaft A", tensile_strength=5e8, speed_ratio=x
        )[0]
    )
    assert np.isfinite([float(slope(x)) for x in (0.5, 1.0, 1.1)]).all()


def test_a_shaft_is_judged_by_the_rule_that_it_names():
    generator = {
        "rule": "KR generator shaft",
        "tensile_strength": 5e8,
        "yield_strength": 3e8,
    }
    parts = [
        (
            dataclasses.replace(e, **generator, stress_concentration=None)
            if isinstance(e, Shaft) and e.between[0] == "wheel"
            else e
        )
        for e in GEARED
    ]
    train = geared(parts)
    found = jaxhb.strength(jaxhb.forced_response(train, rpm=RPM))
    wanted = jaxhb.permissible_stress(**generator, speed_ratio=RPM / 3000.0)
    np.testing.assert_allclose(found.stresses["wheel|mill"][1:], wanted, rtol=1e-12)
    assert found.rules == {"coupling": "M68", "wheel|mill": "KR generator shaft"}
    # 3300 rpm is 1.1 of the rated speed: limits end there, and 102 asks for stresses up
    # to 1.2.
    judged = found.judged
    assert judged["M68"][1:] == (
        pytest.approx(3150.0),
        pytest.approx(3150.0),
        3300.0,
        True,
    )
    assert judged["KR generator shaft"][1:] == (
        pytest.approx(3300.0),
        pytest.approx(3600.0),
        3300.0,
        False,
    )
    more = train.replace({"wheel|mill.tensile_strength": 8e8})
    assert (strength.stress_limits(more, "wheel|mill", 3000.0)[0] > wanted[0][-4]).all()
    with pytest.raises(
        SceneError,
        match="stress_concentration has no part in the limits of KR generator shaft",
    ):
        geared(
            [
                (
                    dataclasses.replace(e, stress_concentration=1.0)
                    if e in parts[5:6]
                    else e
                )
                for e in parts
            ]
        )
    with pytest.raises(
        SceneError,
        match=(
            "rule asks for the stress limits of KR generator shaft, without tensile_str"
        ),
    ):
        geared(
            [
                dataclasses.replace(e, tensile_strength=None) if e in parts[5:6] else e
                for e in parts
            ]
        )

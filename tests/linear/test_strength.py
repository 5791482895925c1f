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
from jaxhb.elements.rules import RULES
from jaxhb.linear import strength
from jaxhb.results.record import Record, RecordedSignal
from jaxhb.train.checks.limits import section_of

# d mm, sigma_B MPa, C_K, lambda; tau_C and tau_T in MPa, worked out with 30 digits from
# the text of the rule.
RULE = (
    (400, 600, 1.0, 0.5, 66.562193, 113.155729),
    (400, 600, 0.6, 0.9, 22.045398, 48.382828),
    (55, 600, 0.6, 0.2, 56.757040, 124.564139),
    (150, 500, 0.45, 0.89, 16.151610, 40.931577),
    (80, 1000, 1.0, 1.05, 54.253301, 92.230612),  # counted as 800 MPa
    (800, 400, 0.8, 0.0, 44.371942, 84.335878),
)

STEEL = Shaft(
    between=("a", "b"),
    length=0.4,
    outer=0.06,
    inner=0.02,
    shear_modulus=8e10,
    magnifier=30.0,
    damping_hz=40.0,
)
GEARED = [
    Disk(name="engine", inertia=1.0, damping=0.2),
    Disk(name="pinion", inertia=0.02, radius=0.05),
    Disk(name="wheel", inertia=0.3, radius=0.15),
    Disk(name="mill", inertia=2.0, damping=0.1),
    dataclasses.replace(
        STEEL,
        between=("engine", "pinion"),
        name="coupling",
        diameter=0.055,
        bore=0.02,
        stress_concentration=0.6,
        tensile_strength=6e8,
        power_limit=5.0,
    ),
    Shaft(
        between=("wheel", "mill"),
        stiffness=2e5,
        damping_ratio=0.01,
        damping_hz=60.0,
        diameter=0.08,
        stress_concentration=1.0,
        tensile_strength=7e8,
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
    d, sigma, form, ratio, *expected = row
    limits = jaxhb.permissible_stress(
        diameter=d / 1e3,
        stress_concentration=form,
        tensile_strength=1e6 * sigma,
        speed_ratio=ratio,
    )
    np.testing.assert_allclose(np.array(limits) / 1e6, expected, rtol=0, atol=5.1e-7)


def test_bounds_of_barred_ranges_lie_where_the_interpolated_stress_meets_the_limit():
    rpm = np.array([400.0, 100.0, 200.0, 300.0, 500.0, 600.0, 700.0])
    stress = np.array([10.0, 50.0, 10.0, 40.0, np.nan, 35.0, 90.0])
    limit = np.array([20.0, 20.0, 30.0, 20.0, 20.0, 20.0, np.inf])
    ranges = jaxhb.barred_ranges(rpm, stress, limit, 1.5 * limit)
    first, middle, last = ranges
    # Stress less limit by speed: 30, -20, 20, -10, (none), 15, (no limit).
    assert first.low == 100.0
    assert first.open_below
    assert first.high == pytest.approx(160.0)
    assert middle.low == pytest.approx(250.0)
    assert middle.high == pytest.approx(300.0 + 200.0 / 3)
    assert last.low == pytest.approx(400.0 + 200.0 * 10 / 25)
    assert last.high == 600.0
    assert last.open_above
    assert [barred.at for barred in ranges] == [100.0, 300.0, 600.0]
    assert [barred.share for barred in ranges] == [2.5, 2.0, 1.75]
    assert [barred.passable for barred in ranges] == [False, False, False]
    assert jaxhb.barred_ranges(rpm, stress / 5, limit, limit) == ()
    passable = jaxhb.barred_ranges(rpm, stress, limit, 3 * limit)
    assert all(barred.passable for barred in passable)


@pytest.mark.slow
def test_stresses_tooth_torques_and_heat_are_those_of_the_samples(response):
    limits = jaxhb.strength(response)
    coupling = response.torque("coupling")
    line = response.torque("wheel|mill")
    sections = (
        ("coupling", coupling, 0.055, 0.02),
        ("wheel|mill", line, 0.08, 0.0),
    )
    for name, signal, d, b in sections:
        samples = signal.samples(20_000)
        polar = np.pi / 32 * (d**4 - b**4)
        expected = np.ptp(samples, axis=-1) / 2 * (d / 2) / polar
        np.testing.assert_allclose(limits.stresses[name].stress, expected, rtol=SAMPLED)
    force = response.force("pinion|wheel").samples(20_000)
    tooth = limits.tooth_torques["pinion|wheel"]
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
            limits.heat[name].power, response.power(name), rtol=1e-9
        )
    assert (limits.heat["coupling"].limit, limits.heat["ring"].limit) == (5.0, 20.0)
    rest = sum(
        response.power(name)
        for name in ("wheel|mill", "pinion|wheel", "engine", "mill")
    )
    np.testing.assert_allclose(
        sum(row.power for row in limits.heat.values()) + rest,
        response.input_power,
        rtol=1e-9,
    )


@pytest.mark.slow
def test_a_shaft_is_judged_at_its_own_section_or_at_that_of_its_stiffness():
    parts = [Disk(name=name, inertia=1.0) for name in "abc"]
    parts += [
        STEEL,
        Shaft(between=("b", "c"), stiffness=1e5),
    ]
    train = build([*parts, Torque(disk="a", harmonics=((1.0, 10.0, 0.0),))])
    limits = jaxhb.strength(jaxhb.forced_response(train, rpm=300.0))
    assert list(limits.stresses) == ["a|b"]
    assert limits.stresses["a|b"].continuous is None
    assert not limits.barred
    section = section_of(train, 0)
    assert (section.diameter, section.bore) == (0.06, 0.02)


def test_a_scene_without_such_keys_has_nothing_to_be_judged_by_and_no_arrays_more():
    train = jaxhb.load_scene("spur_pair")
    assert train.topology.link_keys == ()
    assert train.topology.rated_rpm is None
    assert not jaxhb.strength(jaxhb.forced_response(train, rpm=1500.0))
    assert train.shafts.outer is None
    assert train.meshes.magnifier is None
    assert train.dampers.power_limit is None


@pytest.mark.slow
def test_a_response_without_a_train_needs_one(response):
    train = geared()
    bare = jax.jit(lambda rpm: jaxhb.forced_response(train, rpm=rpm))(RPM)
    with pytest.raises(ValueError, match="has no train: give train="):
        jaxhb.strength(bare)
    stresses = jaxhb.strength(bare, train=train).stresses["coupling"]
    expected = jaxhb.strength(response).stresses["coupling"]
    for values, exact in zip(stresses, expected, strict=True):
        np.testing.assert_allclose(values, exact, rtol=1e-9)


def test_above_the_rule_the_share_and_its_derivative_are_0():
    def shares(ratio, form):
        limits = jaxhb.permissible_stress(
            diameter=0.1,
            stress_concentration=form,
            tensile_strength=6e8,
            speed_ratio=ratio,
        )
        return 3e7 / jax.numpy.stack(limits)

    assert not shares(1.1, 0.5).any()
    assert not np.any(jax.jit(jax.jacrev(shares, (0, 1)))(1.1, 0.5))


@pytest.mark.slow
def test_a_steady_state_is_judged_as_the_motion_that_it_is(response):
    state = jaxhb.steady_state(geared(), rpm=RPM[4])
    limits = jaxhb.strength(state)
    expected = jaxhb.strength(response)
    assert limits.stresses["coupling"].stress == pytest.approx(
        expected.stresses["coupling"].stress[4], rel=SAMPLED
    )
    assert limits.heat["ring"].power == pytest.approx(
        expected.heat["ring"].power[4], rel=1e-9
    )
    recorded = jaxhb.strength(
        dataclasses.replace(state, response=None, record=record_of(state)),
        train=geared(),
    )
    assert recorded.stresses["coupling"].stress == pytest.approx(
        limits.stresses["coupling"].stress, rel=SAMPLED
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
# the rule.
KOREAN = (
    ("KR crankshaft A", 440, 225, 0.5, 39.0, 78.0),
    ("KR crankshaft A", 590, 225, 0.8, 29.64 * (1 + 2 / 3 * 150 / 440), 59.28),
    ("KR crankshaft B", 400, 450, 0.7, 30.79, 123.16),
    ("KR crankshaft B", 440, 450, 0.9, 21.51, 21.51),  # no passing above 0.8
    ("KR crankshaft A", 440, 0, 1.09, 21.0 + 237 * 0.29 * 0.3, 21.0 + 237 * 0.29 * 0.3),
    ("KR crankshaft B", 440, 0, 1.04, 16.0 + 237 * 0.24 * 0.2, 16.0 + 237 * 0.24 * 0.2),
    ("KR crankshaft B", 440, 0, 1.16, np.inf, np.inf),
    ("KR generator crankshaft A", 440, 0, 0.9, 21.0, 90.0),
    # Counted as 835 MPa.
    (
        "KR generator crankshaft B",
        1000,
        300,
        0.3,
        16.0 * (1 + 2 / 3 * 395 / 440),
        120.0,
    ),
    ("KR generator shaft", 440, 225, 0.5, 31.0, 118.0),
    ("KR generator shaft", 550, 225, 1.1, 31.0 * 7 / 6, 31.0 * 7 / 6),
    ("KR generator shaft", 550, 225, 1.11, np.inf, np.inf),
)


@pytest.mark.parametrize("row", KOREAN)
def test_limits_of_crankshafts_and_generator_shafts_are_those_of_the_rule(row):
    rule, sigma, flow, ratio, *expected = row
    limits = jaxhb.permissible_stress(
        rule=rule,
        tensile_strength=1e6 * sigma,
        yield_strength=1e6 * flow,
        speed_ratio=ratio,
    )
    np.testing.assert_allclose(np.array(limits) / 1e6, expected, rtol=1e-12)


def test_every_rule_that_a_scene_may_name_has_its_source():
    assert list(RULES)[0] == "M68"
    for name, rule in RULES.items():
        assert rule.name == name
        assert rule.source
        assert rule.corners[-1] == rule.highest
    with pytest.raises(ValueError, match="there is no rule 'M86'. Did you mean 'M68'?"):
        jaxhb.permissible_stress(rule="M86", tensile_strength=4e8, speed_ratio=1.0)

    def continuous(ratio):
        limit, _ = jaxhb.permissible_stress(
            rule="KR crankshaft A", tensile_strength=5e8, speed_ratio=ratio
        )
        return limit

    derivative = jax.jit(jax.grad(continuous))
    slopes = [float(derivative(ratio)) for ratio in (0.5, 1.0, 1.1)]
    assert np.isfinite(slopes).all()


def test_a_shaft_is_judged_by_the_rule_that_it_names():
    (line,) = [
        part
        for part in GEARED
        if isinstance(part, Shaft) and part.between[0] == "wheel"
    ]
    judged_line = dataclasses.replace(
        line,
        rule="KR generator shaft",
        tensile_strength=5e8,
        yield_strength=3e8,
        stress_concentration=None,
    )

    def geared_with(shaft):
        return geared([shaft if part is line else part for part in GEARED])

    train = geared_with(judged_line)
    limits = jaxhb.strength(jaxhb.forced_response(train, rpm=RPM))
    expected = jaxhb.permissible_stress(
        rule="KR generator shaft",
        tensile_strength=5e8,
        yield_strength=3e8,
        speed_ratio=RPM / 3000.0,
    )
    np.testing.assert_allclose(limits.stresses["wheel|mill"][1:], expected, rtol=1e-12)
    assert limits.rules == {"coupling": "M68", "wheel|mill": "KR generator shaft"}
    # 3300 rpm is 1.1 of the rated speed: limits end there, and 102 asks for stresses up
    # to 1.2.
    judged = limits.judged
    _, limits_to, asked_to, known_to, complete = judged["M68"]
    assert limits_to == pytest.approx(3150.0)
    assert asked_to == pytest.approx(3150.0)
    assert known_to == 3300.0
    assert complete
    _, limits_to, asked_to, known_to, complete = judged["KR generator shaft"]
    assert limits_to == pytest.approx(3300.0)
    assert asked_to == pytest.approx(3600.0)
    assert known_to == 3300.0
    assert not complete
    stronger = train.replace({"wheel|mill.tensile_strength": 8e8})
    continuous, _ = strength.stress_limits(stronger, "wheel|mill", 3000.0)
    assert (continuous > expected[0][-4]).all()
    with pytest.raises(
        SceneError,
        match="stress_concentration has no part in the limits of KR generator shaft",
    ):
        geared_with(dataclasses.replace(judged_line, stress_concentration=1.0))
    with pytest.raises(
        SceneError,
        match=(
            "rule asks for the stress limits of KR generator shaft, without tensile_str"
        ),
    ):
        geared_with(dataclasses.replace(judged_line, tensile_strength=None))

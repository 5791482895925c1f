"""Couplings and dampers as catalogues give them: relative damping against the work lost
in a cycle, and numbers over temperature and frequency against those written by hand.
"""

import dataclasses

import jax
import numpy as np
import pytest
from tolerances import ALGEBRAIC, GRADIENT

import jaxhb
from jaxhb import Damper, Disk, Shaft, Torque
from jaxhb.scene.writer import elements_text

STIFFNESS = 1e5
TORQUE = 10.0
MASSES = (2.0, 3.0)
HZ = float(np.sqrt(STIFFNESS * sum(MASSES) / np.prod(MASSES)) / (2 * np.pi))
"""Natural frequency of two masses on the stiffness."""
ROWS = ((20.0, 1.0, 1.0), (60.0, 0.6, 0.8), (100.0, 0.5, 0.7))


def pair(**keys):
    """Two masses on a coupling, whose torques turn against each other."""
    elements = [
        Disk(name="a", inertia=MASSES[0]),
        Disk(name="b", inertia=MASSES[1]),
        Shaft(between=("a", "b"), **keys),
        Torque(disk="a", harmonics=((1.0, TORQUE, 0.0),)),
        Torque(disk="b", harmonics=((1.0, -TORQUE, 0.0),)),
    ]
    return jaxhb.build(elements, revolutions_per_cycle=1)


@pytest.mark.parametrize("psi", [0.6, 1.2])
@pytest.mark.parametrize("way", [{}, {"damping_hz": HZ}])
def test_relative_damping_is_the_work_of_a_cycle_over_the_elastic_energy(psi, way):
    coupled = pair(stiffness=STIFFNESS, relative_damping=psi, **way)
    response = jaxhb.forced_response(coupled, rpm=60.0 * HZ)
    twist = float(response.twist("a", "b").order(1.0))
    work = float(response.power("a", "b")) / HZ
    assert work == pytest.approx(psi * STIFFNESS * twist**2 / 2, rel=ALGEBRAIC)
    # At resonance the torque balances the damping alone.
    assert twist == pytest.approx(TORQUE / STIFFNESS * 2 * np.pi / psi, rel=1e-9)


@pytest.mark.parametrize("way", [{}, {"damping_hz": 30.0}])
def test_numbers_over_the_temperature_are_those_at_the_temperature(way):
    psi = 0.9
    stiffness = STIFFNESS * 0.55  # half way from 60 to 100 deg C
    share = psi * 0.75 / (2 * np.pi)
    keys = {"stiffness": STIFFNESS, "relative_damping": psi, "over_temperature": ROWS}
    built = pair(**keys, **way, temperature=80.0)
    changed = pair(**keys, **way, temperature=20.0).replace({"a|b.temperature": 80.0})
    for warm in (built, changed):
        assert warm.value("a|b.stiffness") == pytest.approx(stiffness, rel=ALGEBRAIC)
        if way:
            damping = share * stiffness / (2 * np.pi * 30.0)
            assert warm.value("a|b.damping") == pytest.approx(damping, rel=ALGEBRAIC)
        else:
            assert warm.value("a|b.loss_factor") == pytest.approx(share, rel=ALGEBRAIC)


def test_a_given_damping_has_the_factor_of_damping_and_stages_that_of_stiffness():
    keys = {"stiffness": STIFFNESS, "damping": 40.0, "stages": ((0.5, 2e5),)}
    cold = pair(**keys, over_temperature=ROWS, temperature=10.0)
    assert cold.value("a|b.damping") == 40.0  # constant below the first row
    warm = cold.replace({"a|b.temperature": 60.0})
    assert warm.value("a|b.damping") == pytest.approx(32.0, rel=ALGEBRAIC)
    np.testing.assert_allclose(warm.value("a|b.stages"), [(0.5, 1.2e5)], rtol=ALGEBRAIC)
    built = pair(**keys, over_temperature=ROWS, temperature=60.0)
    np.testing.assert_allclose(
        built.value("a|b.stages"), warm.value("a|b.stages"), rtol=ALGEBRAIC
    )


def test_a_stiffness_set_with_a_temperature_is_the_one_at_that_temperature():
    cold = pair(stiffness=STIFFNESS, over_temperature=ROWS, temperature=20.0)
    warm = cold.replace({"a|b.temperature": 60.0, "a|b.stiffness": 7e4})
    assert warm.value("a|b.stiffness") == 7e4


def test_the_temperature_of_the_scene_is_that_of_couplings_without_one():
    coupling = Shaft(between=("a", "b"), stiffness=STIFFNESS, over_temperature=ROWS)
    elements = [Disk(name="a", inertia=2.0), Disk(name="b", inertia=3.0), coupling]
    train = jaxhb.build(elements, temperature=60.0)
    assert train.value("a|b.temperature") == 60.0
    assert train.value("a|b.stiffness") == pytest.approx(6e4, rel=ALGEBRAIC)
    own = dataclasses.replace(coupling, temperature=20.0)
    train = jaxhb.build([*elements[:2], own], temperature=60.0)
    assert train.value("a|b.stiffness") == STIFFNESS


def test_the_temperature_of_a_scene_is_written(tmp_path):
    elements = [
        Disk(name="a", inertia=2.0),
        Disk(name="b", inertia=3.0),
        Shaft(between=("a", "b"), stiffness=STIFFNESS, over_temperature=ROWS),
    ]
    path = tmp_path / "warm.toml"
    path.write_text(elements_text(elements, name="warm", temperature=70.0))
    expected = jaxhb.build(elements, name="warm", temperature=70.0)
    assert jaxhb.load_scene(path) == expected


def test_the_derivative_to_a_temperature_is_that_of_differences():
    train = pair(
        stiffness=STIFFNESS,
        relative_damping=0.9,
        over_temperature=ROWS,
        temperature=30.0,
    )

    def twist(temperature):
        warm = train.replace({"a|b.temperature": temperature})
        return jaxhb.forced_response(warm, rpm=40.0 * HZ).twist("a", "b").order(1.0)

    slope = jax.grad(twist)(45.0)
    step = 1e-2
    near = twist(45.0 + step) - twist(45.0 - step)
    far = twist(45.0 + 2 * step) - twist(45.0 - 2 * step)
    np.testing.assert_allclose(slope, (8 * near - far) / (12 * step), rtol=GRADIENT)


def test_a_progressive_coupling_has_the_stiffness_of_each_row_at_its_mean_torque():
    rows = ((0.0, 8e3), (200.0, 1.2e4), (400.0, 2.1e4), (800.0, 4.5e4))
    for torque, stiffness in rows[1:]:
        elements = [
            Disk(name="a", inertia=MASSES[0]),
            Disk(name="b", inertia=MASSES[1]),
            Shaft(between=("a", "b"), stiffness_over_torque=rows),
            Torque(disk="a", mean=torque),
            jaxhb.Load(disk="b"),
        ]
        train = jaxhb.build(elements)
        at_load = jaxhb.at_mean_load(train, rpm=1000.0).train
        hz = float(jaxhb.frequencies_hz(at_load)[-1])
        mass = np.prod(MASSES) / sum(MASSES)
        expected = np.sqrt(stiffness / mass) / (2 * np.pi)
        # Changes of stiffness are spread, and have a rest of themselves elsewhere.
        assert hz == pytest.approx(expected, rel=1e-3)


def test_the_stages_of_a_progressive_coupling_end_half_way_between_rows():
    train = pair(stiffness_over_torque=((0.0, 1e4), (100.0, 2e4), (300.0, 5e4)))
    first = 50.0 / 1e4
    second = first + 150.0 / 2e4
    expected = [(np.degrees(first), 2e4), (np.degrees(second), 5e4)]
    np.testing.assert_allclose(train.value("a|b.stages"), expected, rtol=ALGEBRAIC)


def test_a_fluid_has_its_stiffness_and_damping_at_each_frequency():
    rows = {
        "stiffness_over_hz": ((0.0, 2e3), (20.0, 5e4), (80.0, 9e4)),
        "damping_over_hz": ((5.0, 60.0), (50.0, 25.0)),
    }
    fluid = pair(**rows)
    for hz in (10.0, 37.0, 90.0):
        stiffness = np.interp(hz, *np.transpose(rows["stiffness_over_hz"]))
        damping = np.interp(hz, *np.transpose(rows["damping_over_hz"]))
        omega = 2 * np.pi * hz
        mass = np.prod(MASSES) / sum(MASSES)
        # One mass on the coupling: the torque turns both against each other.
        expected = TORQUE / abs(stiffness + 1j * omega * damping - mass * omega**2)
        response = jaxhb.forced_response(fluid, rpm=60.0 * hz)
        twist = float(response.twist("a", "b").order(1.0))
        assert twist == pytest.approx(expected, rel=1e-9)


def test_a_damper_of_fluid_may_have_no_stiffness_at_rest():
    ring = Damper(
        name="ring",
        disk="a",
        inertia=0.5,
        stiffness_over_hz=((0.0, 0.0), (100.0, 1e4)),
        damping_over_hz=((0.0, 30.0), (100.0, 10.0)),
    )
    elements = [
        Disk(name="a", inertia=2.0),
        ring,
        Torque(disk="a", harmonics=((1.0, TORQUE, 0.0),)),
    ]
    train = jaxhb.build(elements, revolutions_per_cycle=1)
    response = jaxhb.forced_response(train, rpm=60.0 * 50.0)
    omega = 2 * np.pi * 50.0
    modulus = 5e3 + 1j * omega * 20.0
    torque = TORQUE * modulus / (modulus * 2.5 / 0.5 - 2.0 * omega**2)
    jaxhb.check(response)
    assert float(response.torque("ring").order(1.0)) == pytest.approx(
        abs(torque), rel=1e-9
    )


FAULTS = {
    "two dampings": (
        {"stiffness": 1e4, "relative_damping": 0.8, "loss_factor": 0.1},
        "relative_damping = 0.8 is given together with loss_factor = 0.1.",
    ),
    "two shares": (
        {"stiffness": 1e4, "relative_damping": 0.8, "magnifier": 9.0, "damping_hz": 5},
        "magnifier = 9 is given together with relative_damping = 0.8.",
    ),
    "no temperature": (
        {"stiffness": 1e4, "over_temperature": ROWS},
        "over_temperature is given without temperature. Give it in deg C",
    ),
    "temperature alone": (
        {"stiffness": 1e4, "temperature": 30.0},
        "temperature is given without over_temperature, and changes nothing.",
    ),
    "kelvin": (
        {"stiffness": 1e4, "over_temperature": ROWS, "temperature": -300.0},
        "temperature is -300 deg C, must be at least -100 deg C and at most 500 deg C",
    ),
    "below all": (
        {"stiffness": 1e4, "temperature": 1.0, "over_temperature": ((-400, 1, 1),)},
        "over_temperature, row 1: temperature is -400, must be at least -273.15",
    ),
    "no damping when hot": (
        {"stiffness": 1e4, "temperature": 1.0, "over_temperature": ((10, 1, 0.0),)},
        "over_temperature, row 1: factor of damping is 0, must be greater than 0",
    ),
    "over rpm": (
        {
            "stiffness_over_rpm": ((0, 1e4), (100, 2e4)),
            "over_temperature": ROWS,
            "temperature": 20.0,
        },
        "stiffness_over_rpm is given together with over_temperature. Keep one",
    ),
    "factors and values": (
        {"stiffness_over_hz": ((1, 1e4),), "over_hz": ((1, 1, 1),)},
        "stiffness_over_hz is given together with over_hz. Keep one of them.",
    ),
    "two stiffnesses": (
        {"stiffness_over_hz": ((1, 1e4),), "stiffness": 1e4},
        "stiffness_over_hz is given together with stiffness = 10000 N m/rad.",
    ),
    "damping over hz and psi": (
        {"stiffness": 1e4, "damping_over_hz": ((1, 3.0),), "relative_damping": 0.8},
        "damping_over_hz is given together with relative_damping = 0.8.",
    ),
    "nothing in the rows": (
        {"stiffness": 1e4, "damping_over_hz": ((1, 0.0),)},
        "damping_over_hz is 0 in all rows. Give one that is greater than 0.",
    ),
    "negative": (
        {"stiffness_over_hz": ((1, -1e4),)},
        "stiffness_over_hz, row 1: stiffness is -10000, must be at least 0.",
    ),
    "progressive twice": (
        {"stiffness_over_torque": ((0, 1e4),), "stiffness": 2e4},
        "stiffness_over_torque is given together with stiffness = 20000 N m/rad.",
    ),
    "no stiffness over the torque": (
        {"stiffness_over_torque": ((0, 1e4), (10, 0.0))},
        "stiffness_over_torque, row 2: it has 10 N m and 0 N m/rad, must have at least",
    ),
    "stages": (
        {"stiffness_over_hz": ((1, 1e4),), "stages": ((1.0, 2e4),)},
        "stages is given together with stiffness_over_hz, which only linear",
    ),
}


@pytest.mark.parametrize("case", FAULTS)
def test_each_fault_is_one_sentence(case):
    keys, expected = FAULTS[case]
    with pytest.raises(jaxhb.SceneError) as caught:
        pair(**keys)
    (sentence,) = caught.value.sentences
    assert expected in sentence


@pytest.mark.parametrize(
    ("keys", "value", "expected"),
    [
        (
            {"stiffness": 1e4, "relative_damping": 0.8},
            {"a|b.loss_factor": 0.3},
            "the loss factor comes from relative_damping. Change that.",
        ),
        (
            {"stiffness_over_hz": ((1, 1e4), (10, 2e4))},
            {"a|b.stiffness": 3e4},
            "the stiffness comes from stiffness_over_hz. Change the rows in the scene.",
        ),
        (
            {"stiffness": 1e4, "relative_damping": 0.8},
            {"a|b.temperature": 30.0},
            "nothing in the scene has temperature",
        ),
    ],
)
def test_what_follows_from_other_numbers_is_not_changed_alone(keys, value, expected):
    with pytest.raises(jaxhb.SceneError) as caught:
        pair(**keys).replace(value)
    assert expected in str(caught.value)

"""Transients of linear trains against the exact motion and equations written anew."""

import numpy as np
import pytest
from random_plants import (
    CUT_OFF,
    EVENTS,
    FUEL,
    SECONDS,
    fuel_factor,
    gas_factor,
    linear_plant,
)
from transient_twins import Ramps, accelerated_mass, difference

import jaxhb
from jaxhb import Disk, Event, Ground, Load, Shaft, Torque

CLOSE = 1e-6
"""Torques of a step are parabolas, with 32 steps in a period of the highest harmonic:
they err by 2e-7 of that harmonic, and the twin by 1e-9.
"""
NATURAL = 200.0  # rad/s
UP_AND_DOWN = Ramps(((0.0, 700.0), (0.2, 900.0), (0.3, 850.0), (SECONDS, 1000.0)))
BY_NAME = {kind.event.name: kind for kind in EVENTS}


def accelerated_train(ratio=0.02, inertia=2.0):
    """One mass on a spring that a torque of 100 N m shakes once a revolution."""
    stiffness = inertia * NATURAL**2
    return jaxhb.build(
        [
            Disk(name="mass", inertia=inertia, damping=2 * ratio * NATURAL * inertia),
            Ground(disk="mass", stiffness=stiffness),
            Torque(disk="mass", harmonics=((1.0, 100.0, 0.0),)),
        ],
        revolutions_per_cycle=1,
    )


@pytest.mark.parametrize("alpha", [20.0, 60.0, 200.0, 600.0, 2000.0])
def test_a_mass_passes_its_resonance_as_the_exact_solution_does(alpha):
    seconds = 1.6 * NATURAL / alpha
    rpm = alpha * seconds * 30 / np.pi
    found = jaxhb.transient(
        accelerated_train(), seconds=seconds, speed=[(0.0, 0.0), (seconds, rpm)]
    )
    exact = accelerated_mass(
        found.time, omega=NATURAL, ratio=0.02, alpha=alpha, amplitude=50.0
    )
    # It goes through the resonance, whose static twist is 0.0025 rad.
    assert np.abs(exact).max() > 5e-3
    error = np.abs(found.disk("mass").values - exact).max()
    assert error < CLOSE * np.abs(exact).max()


@pytest.mark.slow
@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("meshing", [True, False])
@pytest.mark.parametrize("seed", [1, 2])
def test_random_linear_trains_move_as_their_twins_at_a_given_speed(seed, held, meshing):
    parts = linear_plant(seed, held=held, meshing=meshing)
    assert difference(parts, SECONDS, UP_AND_DOWN) < CLOSE


@pytest.mark.slow
@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("seed", [1, 2])
def test_random_linear_trains_move_as_their_twins_at_a_free_speed(seed, held):
    parts = linear_plant(seed, held=held, law=True)
    assert difference(parts, SECONDS, None, rpm=800.0) < CLOSE


@pytest.mark.slow
@pytest.mark.parametrize("name", BY_NAME)
def test_torques_of_events_move_a_train_as_its_twin_at_a_given_speed(name):
    parts = linear_plant(7, meshing=False)
    speed = Ramps(((0.0, 1000.0), (SECONDS, 1300.0)))
    assert difference(parts, SECONDS, speed, kind=BY_NAME[name]) < CLOSE


@pytest.mark.slow
@pytest.mark.parametrize("name", BY_NAME)
def test_torques_of_events_move_a_train_as_its_twin_at_a_free_speed(name):
    parts = linear_plant(7, law=True, meshing=False)
    assert difference(parts, SECONDS, None, rpm=1000.0, kind=BY_NAME[name]) < CLOSE


@pytest.mark.slow
@pytest.mark.parametrize(
    "speed", [Ramps(((0.0, 1000.0), (SECONDS, 1300.0))), None], ids=["given", "free"]
)
@pytest.mark.parametrize(
    "change, corners",
    [
        ((FUEL, "fuel", fuel_factor), (0.1, 0.2, 0.25)),
        ((CUT_OFF, "gas", gas_factor), (0.15,)),
    ],
)
def test_fuel_and_cut_off_cylinders_change_torques_as_in_the_twin(
    change, corners, speed
):
    parts = linear_plant(7, law=True, meshing=False)
    rpm = None if speed else 1000.0
    options = {"rpm": rpm, "change": change, "corners": corners}
    assert difference(parts, SECONDS, speed, **options) < CLOSE


def free_pair(*events, laws=True):
    """Two disks that float, whose load has a law."""
    law = {"law": "propeller", "rated_torque": 90.0, "rated_rpm": 900.0}
    return [
        Disk(name="motor", inertia=0.8),
        Disk(name="fan", inertia=1.2),
        Shaft(between=("motor", "fan"), stiffness=2e4, damping=8.0),
        Torque(disk="motor", mean=90.0, harmonics=((1.0, 60.0, 10.0),)),
        Load(disk="fan", **(law if laws else {})),
        *events,
    ]


def test_a_floating_train_under_a_step_of_torque_gains_the_momentum_of_it():
    """At a given speed nothing balances the torque of an event: the train turns away
    with the torque over its inertia, exactly.
    """
    step = Event(name="step", disk="fan", begin=0.1, step=30.0)
    train = jaxhb.build(free_pair(step), reference="motor", revolutions_per_cycle=1)
    found = jaxhb.transient(train, seconds=0.5, speed=600.0, events=["step"])
    parts = {"motor": 0.8, "fan": 1.2}
    turning = 600.0 * np.pi / 30
    momentum = sum(
        inertia * (found.speed(name).values - turning)
        for name, inertia in parts.items()
    )
    since = np.maximum(found.time - 0.1, 0.0)
    # Torques of the first harmonic bring the momentum back and forth as well.
    wave = 60.0 * np.sin(turning * found.time) + 10.0 * np.cos(turning * found.time)
    expected = 30.0 * since + wave / turning
    drift = momentum - expected
    # Parabolas of the wave over a step err by 2e-7 of it, of 1 N m s.
    np.testing.assert_allclose(drift, drift[0], atol=1e-6)


def test_without_loads_each_disk_is_accelerated_by_itself():
    """No torque of inertia acts: the run-up of a train without torques rests."""
    parts = [part for part in free_pair() if not isinstance(part, Load)]
    parts = [
        Torque(disk="motor", harmonics=((1.0, 60.0, 10.0),))
        if isinstance(part, Torque)
        else part
        for part in parts
    ]
    train = jaxhb.build(parts, reference="motor", revolutions_per_cycle=1)
    found = jaxhb.transient(
        train, seconds=0.2, speed=[(0, 600), (0.2, 900)], start="rest"
    )
    assert any("no load takes the torque" in note for note in found.notes)
    loaded = jaxhb.build(
        [*parts, Load(disk="fan")], reference="motor", revolutions_per_cycle=1
    )
    other = jaxhb.transient(
        loaded, seconds=0.2, speed=[(0, 600), (0.2, 900)], start="rest"
    )
    # The load takes 2 kg m2 alpha, of which 1.2 turn the fan: the shaft carries 0.8,
    # which comes at once, as a step.
    alpha = 300.0 * np.pi / 30 / 0.2
    mass = 0.8 * 1.2 / 2.0
    decay = 8.0 / (2 * mass)
    rate = np.sqrt(2e4 / mass - decay**2)
    time = found.time
    gone = np.exp(-decay * time)
    turned = np.cos(rate * time) + decay / rate * np.sin(rate * time)
    twist = -0.8 * alpha / 2e4 * (1 - gone * turned)
    slope = -0.8 * alpha / 2e4 * gone * (rate + decay**2 / rate) * np.sin(rate * time)
    expected = 2e4 * twist + 8.0 * slope
    apart = other.torque("motor", "fan").values - found.torque("motor", "fan").values
    # The torque is constant: steps are exact but for rounding.
    np.testing.assert_allclose(apart, expected, atol=1e-9 * np.abs(expected).max())


def test_the_order_of_elements_and_their_names_do_not_matter():
    speed = [(0.0, 700.0), (0.1, 900.0)]
    parts = free_pair()
    swapped = [parts[place] for place in (4, 1, 0, 3, 2)]
    motions = [
        jaxhb.transient(
            jaxhb.build(these, reference="motor", revolutions_per_cycle=1),
            seconds=0.1,
            speed=speed,
            start="rest",
        )
        for these in (parts, swapped)
    ]
    first, second = (motion.torque("motor", "fan").values for motion in motions)
    # Modes are found anew in another order: 1e-12 of the largest
    np.testing.assert_allclose(first, second, atol=1e-11 * np.abs(first).max())
    back = motions[0].torque("fan", "motor").values
    np.testing.assert_array_equal(back, -first)


def test_steps_half_as_long_err_by_a_sixteenth():
    """Its order is four in the torques over a step."""
    errors = []
    for refine in (2, 4, 8):
        found = jaxhb.transient(
            accelerated_train(ratio=0.1),
            seconds=0.16,
            speed=[(0.0, 0.0), (0.16, 2000.0 * 0.16 * 30 / np.pi)],
            refine=refine,
        )
        exact = accelerated_mass(
            found.time, omega=NATURAL, ratio=0.1, alpha=2000.0, amplitude=50.0
        )
        errors.append(np.abs(found.disk("mass").values - exact).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    # Blocks are whole: steps are not quite half as long.
    np.testing.assert_allclose(orders, 4.0, atol=0.4)


def test_few_instants_are_those_of_all():
    speed = [(0.0, 700.0), (0.1, 900.0)]
    train = jaxhb.build(free_pair(), reference="motor", revolutions_per_cycle=1)
    every = jaxhb.transient(train, seconds=0.1, speed=speed, start="rest")
    few = jaxhb.transient(train, seconds=0.1, speed=speed, start="rest", record=150.0)
    assert len(few.time) == 1 + (len(every.time) - 1) / 4
    assert np.diff(few.time).max() <= 1 / 150
    places = np.searchsorted(every.time, few.time - 1e-12)
    np.testing.assert_array_equal(every.time[places], few.time)
    np.testing.assert_array_equal(
        every.torque("motor", "fan").values[places], few.torque("motor", "fan").values
    )


def test_two_transients_are_one_that_goes_on():
    """At a constant speed, cut after whole revolutions."""
    train = jaxhb.build(free_pair(), reference="motor", revolutions_per_cycle=1)
    whole = jaxhb.transient(train, seconds=0.4, speed=600.0, start="rest")
    first = jaxhb.transient(train, seconds=0.2, speed=600.0, start="rest")
    motion = motion_at_end(first, ("motor", "fan"))
    second = jaxhb.transient(train, seconds=0.2, speed=600.0, start=motion)
    torque = whole.torque("motor", "fan")
    later = second.torque("motor", "fan")
    expected = torque.values[torque.time > 0.2 - 1e-9]
    # The rounding of some hundred steps
    np.testing.assert_allclose(later.values, expected, atol=1e-9 * torque.peak)


def motion_at_end(transient, disks, radius=1.0):
    """Displacements and velocities at the end, of disks that are no gears."""
    turning = transient.rpm[-1] * np.pi / 30
    angles = [transient.disk(name).values[-1] for name in disks]
    speeds = [transient.speed(name).values[-1] - turning for name in disks]
    return np.array([*angles, *speeds])

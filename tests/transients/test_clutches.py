"""Clutches of transients against closed forms: a clutch that slips carries its capacity,
and one that sticks is a spring.
"""

import numpy as np
import pytest

import jaxhb
from jaxhb import Clutch, Disk, Event, SceneError, Shaft, build

ENGINE = 2.0
DRIVEN = 3.0
STIFFNESS = 1e5
CAPACITY = 500.0
RPM = 300.0


def clutched(capacity=((0.0, CAPACITY), (1.0, CAPACITY)), **shaft):
    parts = [
        Disk(name="engine", inertia=ENGINE),
        Disk(name="driven", inertia=DRIVEN),
        Shaft(between=("engine", "driven"), stiffness=STIFFNESS, **shaft),
        Event(
            name="engage",
            between=("engine", "driven"),
            clutch=Clutch(capacity=capacity),
        ),
    ]
    return build(parts, reference="engine", revolutions_per_cycle=1)


def test_a_clutch_slips_at_its_capacity_until_both_sides_turn_alike_and_then_rings():
    # With the relative rate r and w^2 = k (1/J1 + 1/J2) the shaft is twisted as
    # r sin(w t) / w until its torque is T. The relative rate then falls by
    # T (1/J1 + 1/J2) t until it is 0; twisted by T / k and at rest, its torque goes on as
    # T cos(w t).
    softness = 1 / ENGINE + 1 / DRIVEN
    omega = RPM * np.pi / 30
    frequency = np.sqrt(STIFFNESS * softness)
    slips = np.arcsin(CAPACITY * frequency / (STIFFNESS * omega)) / frequency
    left = omega * np.cos(frequency * slips)
    together = slips + left / (CAPACITY * softness)
    motion = jaxhb.transient(
        clutched(), seconds=0.2, speed=RPM, events="engage", start="open", refine=8
    )
    torque = motion.torque("engine", "driven").values
    time = np.asarray(motion.time)
    rings = CAPACITY * np.cos(frequency * (time - together))
    expected = np.where(time < together, CAPACITY, rings)
    slipping = (time > 2 * slips) & (time < 0.99 * together)
    np.testing.assert_allclose(torque[slipping], CAPACITY, rtol=1e-12)
    # The steps in which it begins and ceases to slip are of first order.
    assert np.abs(torque - expected)[time > 2 * slips].max() < 0.01 * CAPACITY
    # The momentum of the twisting shaft, and of the capacity from then on
    before = STIFFNESS * omega / frequency**2 * (1 - np.cos(frequency * slips))
    speed = (before + CAPACITY * (time - slips)) / DRIVEN
    np.testing.assert_allclose(
        motion.speed("driven").values[slipping], speed[slipping], atol=1e-3 * omega
    )


def test_a_clutch_that_carries_the_torque_is_its_shaft():
    # From the same motion, with and without an event: the clutch never slips.
    start = np.array([1e-3, 0.0, 0.0, 0.0])
    train = clutched(capacity=((0.0, 1e6), (1.0, 1e6)), damping=5.0)
    free = jaxhb.transient(train, seconds=0.1, speed=RPM, start=start, refine=20)
    held = jaxhb.transient(
        train, seconds=0.1, speed=RPM, events="engage", start=start, refine=20
    )
    times = np.linspace(0.0, 0.1, 50)
    expected = free.torque("engine", "driven").at(times)
    found = held.torque("engine", "driven").at(times)
    # Cubics through the instants of two grids
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())


def test_a_clutch_limits_the_torque_of_a_shaft():
    start = np.array([2e-2, 0.0, 0.0, 0.0])  # the shaft would carry 2000 N m
    motion = jaxhb.transient(
        clutched(damping=5.0), seconds=0.1, speed=RPM, events="engage", start=start
    )
    assert motion.torque("engine", "driven").peak <= CAPACITY * (1 + 1e-12)


def test_clutches_that_cannot_be_are_refused():
    with pytest.raises(SceneError, match='start is "open", and no event is a clutch'):
        jaxhb.transient(clutched(), seconds=0.1, speed=RPM, start="open")
    with pytest.raises(SceneError, match="its stiffness must be constant"):
        jaxhb.transient(
            clutched(clearance=1.0), seconds=0.1, speed=RPM, events="engage"
        )

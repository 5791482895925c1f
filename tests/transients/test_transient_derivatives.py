"""Derivatives of transients against differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tolerances import TANGENT

import jaxhb
from jaxhb import Disk, Event, Load, Mesh, Shaft, Torque
from jaxhb.transients.fatigue import SNCurve

LINEAR = 1e-5
"""Central differences of second order by 1e-4 of a number err by 1e-6 of smooth
torques, whose step is what they have in common with the derivative.
"""
SPEED = [(0.0, 700.0), (0.15, 1000.0)]
NUMBERS = (
    "motor|gear a.stiffness",
    "motor|gear a.damping",
    "fan.inertia",
    "torque 1.mean",
    "gear a|gear b.stiffness",
)


def parts(*events, backlash=None):
    """Motor, gears and fan; the teeth hammer where there is backlash."""
    law = {} if backlash is None else {"epsilon": 1e-3, "transition": 0.1}
    return [
        Disk(name="motor", inertia=0.8, damping=0.5),
        Disk(name="gear a", inertia=0.01, radius=0.05),
        Disk(name="gear b", inertia=0.03, radius=0.1),
        Disk(name="fan", inertia=0.6, damping=1.0),
        Shaft(between=("motor", "gear a"), stiffness=2e4, damping=8.0),
        Shaft(between=("gear b", "fan"), stiffness=1e4, damping=8.0),
        Mesh(
            between=("gear a", "gear b"),
            stiffness=1e7,
            damping=500.0,
            backlash=backlash,
            **law,
        ),
        Torque(
            name="torque 1",
            disk="motor",
            mean=20.0,
            harmonics=((1.0, 60.0, 10.0), (2.0, 20.0, 5.0)),
        ),
        Load(disk="fan", law="propeller", rated_torque=60.0, rated_rpm=900.0),
        *events,
    ]


def built(*events, backlash=None):
    return jaxhb.build(
        parts(*events, backlash=backlash), reference="motor", revolutions_per_cycle=1
    )


def difference(value, at, step=1e-4):
    """Central differences in every direction ``(n,)``."""
    steps = np.diag(step * np.abs(at))
    return np.array(
        [
            (float(value(at + row)) - float(value(at - row))) / (2 * row.sum())
            for row in steps
        ]
    )


def check(value, at, tolerance, step=1e-4):
    """Gradient and tangent of a function of numbers ``(n,)``, all by their share."""
    expected = difference(value, at, step)
    gradient = np.asarray(jax.grad(value)(jnp.array(at)))
    size = np.maximum(np.abs(expected), 1e-3 * np.abs(expected * at).max() / np.abs(at))
    assert np.all(np.abs(gradient - expected) < tolerance * size), gradient / expected
    direction = at * np.linspace(0.5, -1.0, len(at))
    _, slope = jax.jvp(value, (jnp.array(at),), (jnp.array(direction),))
    terms = gradient * direction
    assert abs(float(slope) - terms.sum()) < 100 * TANGENT * np.abs(terms).sum()


def numbers_of(train, names):
    return np.array([float(train.value(name)) for name in names])


@pytest.mark.slow
def test_the_peak_of_a_linear_run_up_has_the_derivative_of_differences():
    train = built()

    def peak(numbers):
        changed = train.replace(dict(zip(NUMBERS, numbers, strict=True)))
        found = jaxhb.transient(changed, seconds=0.15, speed=SPEED, start="rest")
        return found.torque("motor", "gear a").smooth_peak(16)

    check(peak, numbers_of(train, NUMBERS), LINEAR)


@pytest.mark.slow
def test_the_peak_of_a_hammering_run_up_has_the_derivative_of_differences():
    """Smooth as the law of the teeth is; differences by 1e-6 see the same impacts."""
    train = built(backlash=1e-4)

    def motion(numbers):
        changed = train.replace(dict(zip(NUMBERS, numbers, strict=True)))
        return jaxhb.transient(changed, seconds=0.15, speed=SPEED, start="rest")

    def peak(numbers):
        return motion(numbers).force("gear a", "gear b").smooth_peak(16)

    at = numbers_of(train, NUMBERS)
    assert motion(at).mesh("gear a", "gear b").impacts > 0
    check(peak, at, 1e-2, step=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [SPEED, "free"])
def test_numbers_of_events_have_the_derivatives_of_differences(speed):
    ramp = Event(name="ramp", disk="fan", begin=0.05, ramp=(-90.0, 0.02))
    short = Event(
        name="short", disk="fan", begin=0.06, decaying=((400.0, 0.05, 20.0, 30.0),)
    )
    less = Event(name="less", begin=0.04, fuel=((0.0, 1.0), (0.05, 0.5)))
    train = built(ramp, short, less)
    names = ("ramp.begin", "short.factor", "ramp.factor", "less.begin")
    values = {name: float(train.value(name)) for name in names}
    events = ["ramp", "short", "less"]
    options = {"rpm": 700.0} if speed == "free" else {}

    def late(numbers):
        # The begin of a torque that jumps has no derivative: only ramp and fuel move.
        changed = train.replace(dict(zip(moved, numbers, strict=True)))
        found = jaxhb.transient(
            changed,
            seconds=0.15,
            speed=speed,
            start="rest",
            events=taken,
            **options,
        )
        return found.torque("motor", "gear a").at(0.14)

    moved = names[1:3]
    taken = events
    check(late, np.array([values[name] for name in moved]), LINEAR)
    moved = ("ramp.begin", "less.begin")
    taken = ["ramp", "less"]
    # Borders of blocks lie at the begin: they stand still in the derivative, and move
    # in differences, which see other steps and err by 1e-5 between instants.
    check(late, np.array([values[name] for name in moved]), 1e-2, step=1e-2)


@pytest.mark.slow
def test_damage_and_passage_have_the_derivatives_of_differences_in_free_speed():
    train = built()
    names = ("torque 1.mean", "fan.inertia", "motor|gear a.stiffness")
    curve = SNCurve(points=((1e4, 400.0), (1e6, 100.0)), source="by hand")

    def motion(numbers):
        changed = train.replace(dict(zip(names, numbers, strict=True)))
        return jaxhb.transient(
            changed, seconds=0.4, speed="free", rpm=500.0, start="rest"
        )

    def damage(numbers):
        found = motion(numbers)
        return found.damage(found.torque("motor", "gear a"), curve)

    def passage(numbers):
        return motion(numbers).passage(510.0, 540.0)

    at = numbers_of(train, names)
    assert 0.0 < float(passage(at)) < 0.4
    # Turning points stand still in the derivative: cycles of neighbours are others
    # where instants change their place, by 1e-4 of a range.
    check(damage, at, 1e-3)
    # The stiffness changes no mean rotation.
    gradient = np.asarray(jax.grad(passage)(jnp.array(at)))
    expected = difference(passage, at)
    assert abs(gradient[2]) < 1e-12
    np.testing.assert_allclose(gradient[:2], expected[:2], rtol=1e-5)

"""Lines at fixed frequencies in transients: against an integrator of scipy, and in the
long run against the forced response.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from trains import build

import jaxhb
from jaxhb import Disk, Event, Ground, Load, Mesh, Shaft, Torque

MARCHED = 1e-6
"""Of the largest value: steps of a 32nd of the shortest wave, of fourth order."""

INERTIA = np.array([2.0, 1.0, 0.5])
ROWS = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
GROUND = np.diag([0.0, 0.0, 5e3])
STIFFNESS = ROWS.T @ np.diag([1e4, 2e4]) @ ROWS + GROUND
DAMPING = ROWS.T @ np.diag([30.0, 20.0]) @ ROWS


def chain():
    parts = [
        Disk(name=name, inertia=inertia)
        for name, inertia in zip("abc", INERTIA, strict=True)
    ]
    parts += [
        Shaft(between=("a", "b"), stiffness=1e4, damping=30.0),
        Shaft(between=("b", "c"), stiffness=2e4, damping=20.0),
        Ground(disk="c", stiffness=5e3),
        Torque(disk="a", harmonics=[(1.0, 10.0, 2.0)]),
        Torque(name="grid", disk="c", lines=[(50.0, 3.0, -1.0), (13.7, 5.0, 0.0)]),
        Torque(disk="a", lines=[(50.0, 1.0, 2.0)], scale=[(0.0, 0.0), (1000.0, 2.0)]),
    ]
    return build(parts, reference="a")


def integrated(marched, angle_and_scale):
    """Torque ``(n,)`` of the first shaft by DOP853, from rest."""

    def rate(t, motion):
        angle, scale = angle_and_scale(t)
        grid = np.exp(2j * np.pi * 50.0 * t)
        slow = np.exp(2j * np.pi * 13.7 * t)
        first = (10 + 2j) * np.exp(1j * angle) + scale * (1 + 2j) * grid
        load = np.array([first.real, 0.0, ((3 - 1j) * grid + 5 * slow).real])
        force = load - STIFFNESS @ motion[:3] - DAMPING @ motion[3:]
        return np.concatenate([motion[3:], force / INERTIA])

    solution = solve_ivp(
        rate,
        (0.0, float(marched.time[-1])),
        np.zeros(6),
        method="DOP853",
        rtol=1e-10,
        atol=1e-12,
        t_eval=np.asarray(marched.time),
    )
    angles = solution.y[:3]
    speeds = solution.y[3:]
    return 1e4 * (angles[0] - angles[1]) + 30.0 * (speeds[0] - speeds[1])


def at_constant_speed(t):
    return 2 * np.pi * 500.0 / 60 * t, 1.0


def in_a_run_up(t):
    angle = np.pi / 30 * (400.0 * t + 500.0 * t**2)
    return angle, 2 * (400.0 + 1000.0 * t) / 1000.0


COURSES = {
    "constant": (500.0, at_constant_speed),
    "run-up": ([(0.0, 400.0), (0.4, 800.0)], in_a_run_up),
}


@pytest.mark.parametrize("course", COURSES)
def test_a_march_is_that_of_an_integrator(course):
    speed, angle_and_scale = COURSES[course]
    marched = jaxhb.transient(chain(), seconds=0.4, speed=speed, start="rest")
    torque = marched.torque("a", "b").values
    expected = integrated(marched, angle_and_scale)
    assert np.abs(torque - expected).max() < MARCHED * np.abs(expected).max()


def test_a_linear_train_starts_in_its_steady_motion():
    train = chain()
    marched = jaxhb.transient(train, seconds=12.0, speed=500.0, record=1000.0)
    assert not [note for note in marched.notes if "lines" in note]
    signal = jaxhb.forced_response(train, rpm=500.0).torque("a", "b")
    t = np.asarray(marched.time)
    expected = 2 * (signal.coefficients[1] * np.exp(2j * np.pi * 500 / 60 * t)).real
    for hz, coefficient in zip(signal.lines.hz, signal.lines.coefficients, strict=True):
        expected += 2 * (coefficient * np.exp(2j * np.pi * hz * t)).real
    torque = marched.torque("a", "b").values
    assert np.abs(torque - expected).max() < MARCHED * np.abs(expected).max()
    bound = float(signal.max)
    # Beats of 12 s come within some per cent of the bound.
    assert 0.95 * bound < torque.max() < bound * (1 + MARCHED)


def pair(ripple):
    parts = [
        Disk(name="a", inertia=0.01, radius=0.1),
        Disk(name="b", inertia=0.02, radius=0.1),
        Mesh(between=("a", "b"), stiffness=1e6, damping=300.0, backlash=1e-4),
        Torque(disk="a", mean=20.0, harmonics=[(2.0, 4.0, 0.0)]),
        Torque(disk="b", mean=-20.0),
        Torque(name="ripple", disk="b", lines=[(210.0, ripple, 0.0)]),
    ]
    return build(parts, reference="a")


def test_teeth_in_contact_settle_within_the_forced_response():
    train = pair(6.0)
    marched = jaxhb.transient(train, seconds=1.0, speed=900.0)
    (note,) = [note for note in marched.notes if "lines" in note]
    assert note.endswith("without the lines at fixed frequencies of ripple")
    late = marched.time > 0.3
    force = marched.force("a", "b").values[late]
    signal = jaxhb.forced_response(train, rpm=900.0).force("a", "b")
    assert signal.min > 0  # teeth stay in contact
    # The smooth law is stiff to 1e-3 at this load; 30 and 210 Hz meet in each cycle.
    assert force.max() < float(signal.max) * (1 + 1e-3)
    assert force.max() > 0.98 * float(signal.max)


def test_ripple_alone_makes_teeth_part():
    without = jaxhb.transient(pair(0.0), seconds=0.3, speed=900.0)
    rippled = jaxhb.transient(pair(60.0), seconds=0.3, speed=900.0)
    assert without.force("a", "b").min > 50.0
    assert rippled.force("a", "b").min < 10.0


def test_steps_resolve_the_lines():
    slow = jaxhb.transient(chain(), seconds=0.2, speed=500.0)
    rows = [(400.0, 3.0, -1.0), (13.7, 5.0, 0.0)]
    fast = jaxhb.transient(
        chain().replace({"grid.lines": rows}), seconds=0.2, speed=500.0
    )
    assert len(fast.time) > 0.2 * 400 * 32
    assert len(fast.time) > 4 * len(slow.time)


@pytest.mark.slow
def test_a_march_has_derivatives_by_amplitude_and_frequency():
    train = chain()

    def last(share):
        row = jnp.array([52.0, 3.0, -1.0]) * (1 + share * jnp.array([0.01, 1.0, -0.5]))
        rows = jnp.stack([row, jnp.array([13.7, 5.0, 0.0])])
        changed = train.replace({"grid.lines": rows})
        marched = jaxhb.transient(changed, seconds=0.05, speed=500.0)
        return marched.torque("a", "b").values[-1]

    _, derivative = jax.jvp(last, (0.0,), (1.0,))
    # Central differences of second order, on steps that follow the frequency.
    difference = (float(last(1e-3)) - float(last(-1e-3))) / 2e-3
    assert abs(float(derivative) - difference) < 1e-5 * abs(difference)


def test_lines_of_a_torque_that_drives_end_with_the_fuel():
    parts = [
        Disk(name="a", inertia=1.0),
        Disk(name="b", inertia=2.0),
        Shaft(between=("a", "b"), stiffness=1e4, damping=60.0),
        Torque(disk="a", mean=30.0, lines=[(19.0, 50.0, 0.0)]),
        Torque(name="grid", disk="a", lines=[(30.0, 5.0, 0.0)]),
        Load(disk="b"),
        Event(name="cut", fuel=[(0.0, 1.0), (0.2, 0.0)]),
    ]
    train = build(parts)
    marched = jaxhb.transient(train, seconds=3.0, speed=800.0, events="cut")
    late = marched.torque("a", "b").values[marched.time > 2.5]
    signal = jaxhb.forced_response(train, rpm=800.0).torque("a", "b")
    swing = np.ptp(late) / 2
    # Half a second has 15 waves of 30 Hz with more than 32 samples each.
    assert abs(swing - float(signal.line(30.0))) < 0.01 * swing
    assert float(signal.line(19.0)) > 10 * swing

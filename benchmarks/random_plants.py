"""Random linear trains with all that is linear, and events of every kind with their
torques in closed form, for transients.
"""

from dataclasses import dataclass

import numpy as np

from jaxhb import (
    Cylinder,
    Damper,
    Disk,
    Event,
    Ground,
    Ice,
    Load,
    Mesh,
    Phase,
    Pulse,
    Shaft,
    Torque,
)

TEETH = 6, 12
"""Of the two gears; the second shaft turns half as fast."""


def rows(draw, orders, size):
    """Rows of (order, Re, Im) of random phases."""
    return tuple(
        (float(order), *(size / order * draw.uniform(-1, 1, 2)).tolist())
        for order in orders
    )


def linear_plant(seed, *, held=True, law=False, meshing=True):
    """Elements of a random linear train: two shafts on gears, a damper, a damped and an
    undamped disk without inertia that carry torques, a pulsating load.

    held : whether a ground holds it; law : whether its load has one over the speed;
    meshing : whether the stiffness of the mesh varies and its teeth have errors.
    """
    draw = np.random.default_rng(seed)

    def between(low, high):
        return float(np.exp(draw.uniform(np.log(low), np.log(high))))

    ends = ("pinion", "wheel")
    errors = {}
    if meshing:
        errors = {
            "stiffness_orders": rows(draw, (1.0, 2.0), 0.1),
            "transmission_error": rows(draw, (1.0,), 2e-6),
            "first_gear_error": rows(draw, (1.0, 2.0), 2e-5),
            "second_gear_error": rows(draw, (2.0,), 2e-5),
            "phase": 35.0,
        }
    parts = [
        Disk(name="engine", inertia=between(0.5, 3.0), damping=between(0.5, 3.0)),
        Disk(name="hub", inertia=0.0),
        Disk(name="pinion", inertia=between(0.05, 0.2), radius=0.1, teeth=TEETH[0]),
        Disk(name="wheel", inertia=between(0.2, 1.0), radius=0.2, teeth=TEETH[1]),
        Disk(name="flange", inertia=0.0, damping=between(0.5, 2.0)),
        Disk(name="machine", inertia=between(2.0, 9.0), damping=between(1.0, 5.0)),
        Shaft(between=("engine", "hub"), stiffness=between(2e4, 2e5)),
        Shaft(between=("hub", "pinion"), stiffness=between(2e4, 2e5)),
        Shaft(
            between=("wheel", "flange"),
            stiffness=between(2e4, 2e5),
            damping=between(1.0, 20.0),
        ),
        Shaft(
            between=("flange", "machine"),
            stiffness=between(2e4, 2e5),
            damping=between(5.0, 50.0),
        ),
        Mesh(between=ends, stiffness=between(1e7, 3e7), damping=500.0, **errors),
        Damper(
            name="ring",
            disk="engine",
            inertia=between(0.1, 0.4),
            stiffness=between(2e3, 2e4),
            damping=between(2.0, 20.0),
        ),
        Torque(
            name="gas",
            disk="engine",
            mean=between(200.0, 900.0),
            harmonics=rows(draw, (0.5, 1.0, 2.0, 4.0), 300.0),
            scale=((300.0, 0.5), (1000.0, 1.0), (2000.0, 1.2)),
        ),
        Torque(name="valves", disk="hub", harmonics=rows(draw, (1.0, 3.0), 90.0)),
        Torque(
            name="fan",
            disk="flange",
            mean=-between(20.0, 90.0),
            harmonics=rows(draw, (1.0,), 40.0),
            rated_rpm=1500.0,
        ),
        Cylinder(
            name="cylinder",
            disk="engine",
            gas_torque_mean=between(50.0, 300.0),
            gas_torque=rows(draw, (0.5, 1.0, 1.5), 300.0),
            firing_angle=120.0,
        ),
        Load(
            disk="machine",
            harmonics=rows(draw, (2.0, 4.0), 0.2),
            law="propeller" if law else "",
            rated_torque=1500.0 if law else None,
            rated_rpm=1200.0 if law else None,
        ),
        Phase(name="late", of=("valves",), angle=40.0),
    ]
    if held:
        parts.append(Ground(disk="machine", stiffness=between(2e3, 2e4)))
    return parts


SECONDS = 0.4
BEGIN = 0.1


@dataclass(frozen=True)
class KindOfEvent:
    """An event, ``torque``: of the time and the angle theta of the reference rotor
    since its begin, rad, in N m; ``bends``: times and angles since then of kinks and
    jumps.
    """

    event: Event
    torque: object
    seconds: tuple = ()
    angles: tuple = ()


def _milling(turned):
    """Torque of two blocks of ice on the four blades of the machine, which turns half
    as fast as the reference rotor: case 3.
    """
    phi = np.rad2deg(turned) / 2
    if not 0 <= phi < 216.0:
        return 0.0
    impacts = 0.0
    for passage in range(8):
        x = phi - 45.0 * passage
        if 0 <= x < 45.0:
            impacts += np.sin(np.pi * x / 45.0)
    return -0.5 * 2000.0 * min(phi, 216.0 - phi, 90.0) / 90.0 * impacts


_STEPS = np.deg2rad(2 * np.array([*range(0, 217, 45), 90.0, 126.0, 216.0]))
_TABLE = ((0.0, 50.0), (0.05, -300.0), (0.15, 100.0))
_DECAYING = ((900.0, 0.1, 50.0, 0.0), (300.0, 0.05, 100.0, 30.0))


def _short_circuit(t):
    return sum(
        T * np.exp(-t / decay) * np.sin(2 * np.pi * hz * t + np.deg2rad(deg))
        for T, decay, hz, deg in _DECAYING
    )


EVENTS = (
    KindOfEvent(
        Event(name="step", disk="machine", begin=BEGIN, step=-400.0, factor=0.5),
        lambda t, turned: -200.0,
    ),
    KindOfEvent(
        Event(name="block", disk="hub", begin=BEGIN, end=0.25, step=150.0),
        lambda t, turned: 150.0 if t < 0.15 else 0.0,
        (0.15,),
    ),
    KindOfEvent(
        Event(name="ramp", disk="wheel", begin=BEGIN, ramp=(300.0, 0.1)),
        lambda t, turned: 300.0 * min(t / 0.1, 1.0),
        (0.1,),
    ),
    KindOfEvent(
        Event(
            name="half sine",
            disk="engine",
            begin=BEGIN,
            pulse=Pulse(torque=500.0, seconds=0.03),
        ),
        lambda t, turned: 500.0 * np.sin(np.pi * t / 0.03) if t < 0.03 else 0.0,
        (0.03,),
    ),
    KindOfEvent(
        Event(
            name="trapezoid",
            disk="ring",
            begin=BEGIN,
            pulse=Pulse(torque=80.0, seconds=0.06, shape="trapezoid", rise=0.01),
        ),
        lambda t, turned: 80.0 * min(max(min(t, 0.06 - t), 0.0) / 0.01, 1.0),
        (0.01, 0.05, 0.06),
    ),
    KindOfEvent(
        Event(name="table", disk="flange", begin=BEGIN, table=_TABLE),
        lambda t, turned: float(np.interp(t, *np.array(_TABLE).T)),
        (0.05, 0.15),
    ),
    KindOfEvent(
        Event(
            name="short circuit",
            disk="machine",
            begin_deg=720.0,
            decaying=_DECAYING,
        ),
        lambda t, turned: _short_circuit(t),
    ),
    KindOfEvent(
        Event(
            name="ice",
            disk="machine",
            begin_deg=720.0,
            ice=Ice(torque=2000.0, blades=4, case=3, angle_deg=216.0, ramp_deg=90.0),
        ),
        lambda t, turned: _milling(turned),
        angles=tuple(_STEPS.tolist()),
    ),
)
"""An event of every kind that is a torque."""

FUEL = Event(name="fuel", begin=BEGIN, fuel=((0.0, 1.0), (0.1, 0.3), (0.15, 0.3)))


def fuel_factor(t):
    """Factor of the event FUEL at a time."""
    return float(np.interp(t - BEGIN, *np.array(FUEL.fuel).T))


CUT_OFF = Event(name="cut", cut_off="cylinder", begin=0.15)


def gas_factor(name, t):
    """Factor of the gas torque under the event CUT_OFF."""
    return 1.0 if t < 0.15 else 0.0

"""Small drive trains for the tests, as lists of elements; some come from the
benchmarks.
"""

import sys
from pathlib import Path

import numpy as np

import jaxhb
from jaxhb import Damper, Disk, Ground, Mesh, Shaft, Torque
from jaxhb.balance.plan import Request
from jaxhb.solutions.planning import plan_speeds

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
from branched_thirty import branched_thirty, numpy_angles  # noqa: F401
from event_exact import Pair  # noqa: F401
from known_trains import (  # noqa: F401
    INERTIA,
    NATURAL,
    around_optimum,
    branched_parts,
    exact_peak,
    main_mass,
    tuned_main_mass,
)
from random_trains import random_case, span  # noqa: F401
from refined_trains import refined, with_tooth_damping  # noqa: F401

sys.path.pop(0)

ONE_RADIAN_PER_SECOND = 60 / (2 * 3.141592653589793)
"""rpm at which Omega = 1 rad/s for one revolution per cycle."""


def chain_parts(inertia, stiffness, *, ground=None, damping=0.0):
    """Disks 1 .. S in a row; a ground spring at the last."""
    parts = [
        Disk(name=str(k + 1), inertia=J, damping=damping) for k, J in enumerate(inertia)
    ]
    parts += [
        Shaft(between=(str(k + 1), str(k + 2)), stiffness=c)
        for k, c in enumerate(stiffness)
    ]
    return parts + (
        [Ground(disk=str(len(inertia)), stiffness=ground)] if ground else []
    )


def one_mass_parts(*, m, b, c, eps, h, q0, q1, transition=0.2):
    """``m x'' + b x' + f(x) = q0 + q1 cos t`` as two equal gears of radius 1, driven
    against each other.

    With x = phi_a - phi_b, inertia 2 m, damping 2 b and torques +-q, their difference
    is twice this equation.
    """
    parts = [Disk(name=name, inertia=2 * m, damping=2 * b, radius=1.0) for name in "ab"]
    parts.append(
        Mesh(
            between=("a", "b"),
            stiffness=c,
            epsilon=eps,
            transition=transition,
            backlash=h,
        )
    )
    rows = ((1.0, q1, 0.0),)
    return [
        *parts,
        Torque(disk="a", mean=q0, harmonics=rows),
        Torque(disk="b", mean=-q0, harmonics=((1.0, -q1, 0.0),)),
    ]


def pair_train(pair, *, transition, stiffness=1.0, backlash=2.0, natural_frequency=1.0):
    """The :class:`event_exact.Pair` as two equal gears of radius 1, driven against each
    other; see :func:`pair_rpm`.

    With x = l / (h/2), time t = tau / w0 and m = c / w0^2, the pair is ``m l'' + 2 zeta
    m w0 l' + f(l) = q(t)`` with q = c h/2 (mean + Re(alternating e^{i Omega tau})). The
    deflection l = phi_a - phi_b of gears of inertia 2 m under torques +-q obeys twice
    this. A damper that always acts is one of the disks, 4 zeta m w0 each, so that the
    rotation of the pair as one is damped too; else one of the mesh, 2 zeta m w0 with
    damping law "contact". Tooth forces are in units of c h/2. The numbers by default
    are the units: l is x.
    """
    mass = stiffness / natural_frequency**2
    force = stiffness * backlash / 2
    damping = 2 * pair.damping_ratio * mass * natural_frequency
    always = pair.damped_gap
    parts = [
        Disk(name=name, inertia=2 * mass, damping=2 * damping * always, radius=1.0)
        for name in "ab"
    ]
    parts.append(
        Mesh(
            between=("a", "b"),
            stiffness=stiffness,
            backlash=backlash,
            epsilon=pair.epsilon,
            transition=transition,
            damping=damping * (not always),
            damping_law="contact",
        )
    )
    wave = force * complex(pair.alternating)
    for name, sign in (("a", 1), ("b", -1)):
        rows = ((1.0, sign * wave.real, sign * wave.imag),)
        parts.append(Torque(disk=name, mean=sign * force * pair.mean, harmonics=rows))
    return build(parts, reference="a")


def pair_rpm(pair, natural_frequency=1.0):
    """rpm at which Omega of a pair is that of one revolution per cycle."""
    return pair.frequency * natural_frequency * ONE_RADIAN_PER_SECOND


def build(parts, *, cycle=1, reference=None):
    return jaxhb.build(
        parts, revolutions_per_cycle=cycle, reference=reference, name="test train"
    )


def pinions_parts(pump):
    """A crank gear between a light cam gear, which hammers at 1500 rpm, and a pump gear
    that takes ``pump`` N m.
    """

    def mesh(*gears):
        return Mesh(
            between=gears,
            stiffness=2e8,
            damping=1500.0,
            backlash=1e-4,
            epsilon=0.02,
            transition=0.04,
        )

    return [
        Disk(name="flywheel", inertia=0.8, damping=0.4),
        Disk(name="crank gear", inertia=0.01, radius=0.05),
        Disk(name="cam gear", inertia=0.008, radius=0.06),
        Disk(name="pump gear", inertia=0.004, radius=0.04),
        Shaft(between=("flywheel", "crank gear"), stiffness=2e5, damping=20.0),
        mesh("crank gear", "cam gear"),
        mesh("crank gear", "pump gear"),
        Ground(disk="flywheel", stiffness=50.0),
        Torque(disk="flywheel", mean=4.0 * 5 / 6 + pump * 5 / 4),
        Torque(
            disk="cam gear", mean=-4.0, harmonics=((1.0, 60.0, 0.0), (2.0, 18.0, 12.0))
        ),
        Torque(disk="pump gear", mean=-pump),
    ]


def gearbox_parts(*, grounded=True):
    """Two parallel meshes between two shafts (a closed loop), several gears a shaft,
    massless disks, viscous ring.
    """
    parts = [
        Disk(name="motor", inertia=0.05, damping=0.2),
        Disk(name="coupling", inertia=0.0),
        Disk(name="input 1", inertia=0.002, radius=0.05),
        Disk(name="input 2", inertia=0.004, radius=0.08),
        Disk(name="lay 1", inertia=0.01, radius=0.10),
        Disk(name="lay 2", inertia=0.03, radius=0.16, damping=0.1),
        Disk(name="lay 3", inertia=0.0, radius=0.06),
        Disk(name="output", inertia=0.02, radius=0.09),
        Disk(name="mill", inertia=0.4, damping=0.5),
        Shaft(between=("coupling", "motor"), stiffness=4e3, damping=1.0),
        Shaft(between=("coupling", "input 1"), stiffness=6e3, loss_factor=0.05),
        Shaft(between=("input 1", "input 2"), stiffness=9e4, damping=3.0),
        Shaft(between=("lay 2", "lay 1"), stiffness=2e5),
        Shaft(between=("lay 2", "lay 3"), stiffness=1e5, damping=2.0),
        Shaft(between=("output", "mill"), stiffness=3e4, damping=4.0, loss_factor=0.01),
        Damper(
            name="viscous ring", disk="motor", inertia=0.02, damping=3.0, stiffness=0.0
        ),
        Damper(
            name="rubber ring",
            disk="mill",
            inertia=0.1,
            damping=1.0,
            stiffness=2e3,
            loss_factor=0.1,
        ),
        Mesh(between=("input 1", "lay 1"), stiffness=1e8, damping=500.0),
        Mesh(between=("lay 2", "input 2"), stiffness=2e8),
        Mesh(between=("lay 3", "output"), stiffness=1.5e8, damping=300.0),
    ]
    speed_ratio = (0.05 / 0.10) * (0.06 / 0.09)
    parts += [
        Torque(disk="motor", mean=30.0, harmonics=((1.0, 20.0, 5.0), (2.0, 0.0, 7.0))),
        Torque(
            disk="mill",
            mean=-30.0 / speed_ratio,
            harmonics=((1.0, 4.0, 0.0), (3.0, 2.0, -6.0)),
        ),
    ]
    return parts + ([Ground(disk="lay 2", stiffness=4e4)] if grounded else [])


def hammering_train(*seed):
    """The first of some random trains that separates teeth, all with the same tooth
    damping, and its speed.
    """
    draw = np.random.default_rng(seed)
    while True:
        train, rpm, _ = random_case(draw)
        train = with_tooth_damping(train, span(draw, 0.01, 0.3))
        (plan,) = plan_speeds(train, np.array([rpm]), Request())
        if plan.marches:
            return train, rpm

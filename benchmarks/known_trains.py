"""Trains with known answers or all kinds of elements, for benchmarks and tests
alike.
"""

import numpy as np

import jaxhb
from jaxhb import Damper, Disk, Ground, Mesh, Shaft, Torque
from jaxhb.design import Objective

INERTIA = 2.0
STIFFNESS = 8e4
NATURAL = np.sqrt(STIFFNESS / INERTIA)
"""One mass on a spring, rad/s."""


def branched_parts(laws=("contact", "always")):
    """A crank with a flywheel and a ring, an idler, and an accessory behind it: two
    meshes that hammer at 1500 rpm.
    """
    common = {
        "stiffness": 2e8,
        "damping": 1500.0,
        "backlash": 1e-4,
        "epsilon": 0.02,
        "transition": 0.3,
    }
    return [
        Disk(name="flywheel", inertia=0.8, damping=0.4),
        Disk(name="crank gear", inertia=0.01, radius=0.05),
        Disk(name="idler", inertia=0.008, radius=0.06, damping=0.3),
        Disk(name="pump gear", inertia=0.004, radius=0.04),
        Disk(name="pump", inertia=0.02, damping=0.1),
        Shaft(between=("flywheel", "crank gear"), stiffness=2e5, damping=20.0),
        Shaft(
            between=("pump gear", "pump"), stiffness=3e4, damping=2.0, loss_factor=0.03
        ),
        Damper(
            name="ring", disk="crank gear", inertia=0.02, damping=6.0, stiffness=4e3
        ),
        Mesh(between=("crank gear", "idler"), damping_law=laws[0], **common),
        Mesh(between=("pump gear", "idler"), damping_law=laws[1], **common),
        Ground(disk="flywheel", stiffness=50.0),
        Torque(
            disk="flywheel",
            mean=12.0,
            harmonics=((1.0, 300.0, -80.0), (2.0, 60.0, 90.0)),
        ),
        Torque(disk="pump", mean=-8.0, harmonics=((1.0, 3.0, 5.0), (3.0, 4.0, 0.0))),
    ]


def main_mass(ring, stiffness, damping):
    """One disk on a spring under a torque of order 1, one revolution a cycle, with a
    damper.
    """
    parts = [
        Disk(name="main", inertia=INERTIA),
        Ground(disk="main", stiffness=STIFFNESS),
        Torque(disk="main", harmonics=((1.0, 10.0, 0.0),)),
        Damper(
            name="damper",
            disk="main",
            inertia=ring,
            stiffness=stiffness,
            damping=damping,
        ),
    ]
    return jaxhb.build(parts, name="one mass")


def exact_peak(ring, stiffness, damping):
    """Largest |theta K / T| over all frequencies, by the formula of two masses."""
    omega = NATURAL * np.linspace(0.3, 2.0, 400_001)
    link = stiffness + 1j * omega * damping
    behind = -link * ring * omega**2 / (link - ring * omega**2)
    return np.abs(STIFFNESS / (STIFFNESS - INERTIA * omega**2 + behind)).max()


def tuned_main_mass(train, parameters, ratios):
    """The tuning of ``train`` for the smallest peak, at speeds in shares of the natural
    frequency.
    """
    return jaxhb.tune(
        train,
        parameters=parameters,
        rpm=ratios * NATURAL * 60 / (2 * np.pi),
        objective=Objective(quantity="angle order", of="main", order=1.0),
        steps=300,
        peaks=2,
        widths=(1.0, 0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5),
        improvement=1e-7,
    )


def around_optimum():
    """Shares of the natural frequency, close together where the peaks of a tuned damper
    lie.
    """
    return np.concatenate(
        [
            np.linspace(0.5, 0.8, 31),
            np.linspace(0.8, 1.2, 401)[1:],
            np.linspace(1.2, 2, 81)[1:],
        ]
    )

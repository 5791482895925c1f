"""Drive trains for the benchmarks: tooth damping set by its ratio, finely divided
shafts, many meshes.
"""

import dataclasses

import numpy as np

import jaxhb

SWING = 170.0
"""Of the motor's torque in :func:`accessory_drive`, N m."""

HAMMERING_RPM = (1422.0, 1628.0, 1833.0, 2039.0, 2244.0)
"""Five speeds of ``gear_train_30`` at which teeth separate."""

SHARE = 0.2
"""Of the inertia of the lighter neighbour, what moves from each end of a shaft into its
new disks.
"""


def tooth_damping_ratio(train):
    """``r / (2 sqrt(c m_a m_b / (m_a + m_b)))`` ``(M,)`` of every mesh, ``m = J / r^2``
    of the two gears alone.
    """
    return np.asarray(train.meshes.damping) / (2 * _critical(train))


def with_tooth_damping(train, ratio):
    """The train with the same damping ratio at every mesh; ``ratio`` 0.06 is 6 %."""
    return dataclasses.replace(
        train,
        meshes=dataclasses.replace(train.meshes, damping=2 * ratio * _critical(train)),
    )


def _critical(train):
    """``sqrt(c m)`` of the meshes, N s/m, half the critical damping."""
    ends = np.array(train.topology.mesh_ends, dtype=int)
    mass = (
        np.asarray(train.disks.inertia)[ends]
        / np.asarray(train.disks.radius)[ends] ** 2
    )
    return np.sqrt(
        np.asarray(train.meshes.stiffness) * mass.prod(axis=1) / mass.sum(axis=1)
    )


def refined(train, disks, *, share=SHARE):
    """The same train with every shaft cut into equal pieces.

    A shaft of stiffness k and damping r becomes m pieces of m k and m r with m - 1 new
    disks between them, so that its static stiffness stays. The new disks share equally
    what the two ends of the shaft give up: each end ``share / 2`` of the lighter of the
    two inertias, an inertia being divided by the number of shafts at its disk. The
    total inertia stays; excitation, gears, dampers and grounds stay on their disks.
    ``disks`` afterwards include rings of dampers; the shafts get the same number of new
    disks, give or take one.
    """
    train = jaxhb.load_scene(train) if isinstance(train, str) else train
    old = train.topology
    extra, shafts = disks - old.n_disks, len(old.shaft_ends)
    if extra == 0:
        return train
    if extra < 0 or not shafts:
        raise ValueError(
            f"{old.name or 'scene'}: {shafts} shafts and {old.n_disks} disks cannot"
            f" become {disks} disks"
        )
    new = np.full(shafts, extra // shafts) + (np.arange(shafts) < extra % shafts)
    inertia, added = _shared_inertia(train, new, share)
    first = old.n_scene_disks

    def moved(disk):
        return disk if disk < first else disk + extra

    names = []
    ends = []
    rotor = []
    for name, (a, b), count in zip(old.shaft_names, old.shaft_ends, new, strict=True):
        chain = [
            moved(a),
            *range(first + len(rotor), first + len(rotor) + count),
            moved(b),
        ]
        ends += zip(chain[:-1], chain[1:], strict=True)
        names += [f"{name}.{k + 1}" for k in range(count + 1)] if count else [name]
        rotor += [old.rotor[a]] * count
    topology = dataclasses.replace(
        old,
        disk_names=(
            *old.disk_names[:first],
            *(f"piece {k + 1}" for k in range(extra)),
            *old.disk_names[first:],
        ),
        n_scene_disks=first + extra,
        teeth=(*old.teeth, *[0] * extra),
        rotor=(*old.rotor[:first], *rotor, *old.rotor[first:]),
        shaft_names=tuple(names),
        shaft_ends=tuple((int(a), int(b)) for a, b in ends),
        shaft_rules=tuple(np.repeat(old.shaft_rules, new + 1).tolist()),
        shaft_curves=tuple(
            curve
            for curve, count in zip(old.shaft_curves, new + 1, strict=True)
            for _ in range(count)
        ),
    )
    nothing = np.zeros(extra)
    table = train.disks
    pieces = new + 1
    return dataclasses.replace(
        train,
        topology=topology,
        disks=dataclasses.replace(
            table,
            inertia=np.concatenate([inertia, np.repeat(added, new)]),
            radius=np.concatenate([table.radius, nothing]),
            damping=np.concatenate([table.damping, nothing]),
        ),
        shafts=dataclasses.replace(
            train.shafts,
            stiffness=np.repeat(pieces * train.shafts.stiffness, pieces),
            damping=np.repeat(pieces * train.shafts.damping, pieces),
            loss_factor=np.repeat(train.shafts.loss_factor, pieces),
        ),
    )


def _shared_inertia(train, new, share):
    """Inertia ``(S,)`` left on the scene's disks, and that of each new disk of every
    shaft, kg m2.
    """
    inertia = np.array(train.disks.inertia, dtype=float)
    ends = np.array(train.topology.shaft_ends, dtype=int)
    if (ends >= inertia.size).any():
        raise ValueError("a shaft that ends at the ring of a damper is not refined")
    per_shaft = inertia / np.maximum(
        np.bincount(ends.ravel(), minlength=inertia.size), 1
    )
    given = np.where(new > 0, share / 2 * per_shaft[ends].min(axis=1), 0.0)
    np.subtract.at(inertia, ends.ravel(), np.repeat(given, 2))
    return inertia, 2 * given / np.maximum(new, 1)


def accessory_drive(meshes):
    """A motor and a stiff shaft with pinions, each driving an accessory of its own
    through a mesh with backlash.

    The motor's torque grows with the meshes so that each is out of contact for about a
    sixth of the cycle, one revolution, at 1500 rpm, whatever their number; 4 of them
    have modes up to harmonic 210.
    """
    swing = SWING * meshes**0.11 * (1 + meshes / 4)
    harmonics = [(2.0, swing, 0.0), (4.0, swing / 2, 40.0)]
    parts = [
        jaxhb.Disk(name="motor", inertia=0.2 * (1 + meshes / 4), damping=0.5),
        jaxhb.Ground(disk="motor", stiffness=10.0),
        jaxhb.Torque(disk="motor", mean=10.0 * meshes, harmonics=harmonics),
    ]
    before = "motor"
    for k in range(1, meshes + 1):
        pinion = f"pinion {k}"
        gear = f"gear {k}"
        wheel = f"accessory {k}"
        parts += [
            jaxhb.Disk(name=pinion, inertia=0.01, radius=0.06),
            jaxhb.Shaft(between=(before, pinion), stiffness=1e7, damping=500.0),
            jaxhb.Disk(name=gear, inertia=0.01, radius=0.06, damping=0.05),
            jaxhb.Disk(name=wheel, inertia=0.005, damping=0.05),
            jaxhb.Shaft(between=(gear, wheel), stiffness=5e4, damping=2.0),
            jaxhb.Mesh(
                between=(pinion, gear), stiffness=2e8, damping=3300.0, backlash=1e-4
            ),
            jaxhb.Torque(disk=wheel, mean=-10.0),
        ]
        before = pinion
    return jaxhb.build(
        parts, name=f"{meshes} meshes", reference="motor", revolutions_per_cycle=1
    )

"""What holds the parts of a train: a part that only viscous links join has no place of its own."""

from __future__ import annotations

import jax
import numpy as np

from jaxhb.model.graph import pieces

_DECIDES = {
    "damper": ("stiffness", "damping"),
    "torque": ("mean",),
    "cylinder": ("gas_torque_mean", "pressure", "bore"),
}


def names_of(names, indices, most: int = 8) -> str:
    """List names for a sentence."""
    shown = ", ".join(repr(names[i]) for i in indices[:most])
    return shown + (f", … ({len(indices)} disks)" if len(indices) > most else "")


def unheld(source, names, *, links, static, ground, loaded, main: int) -> list[str]:
    """Find parts behind viscous links that the only ground holds, or on which a mean torque acts.

    ``links`` and ``static`` are pairs of disks joined by any link and by one with static stiffness; ``ground``
    and ``loaded`` the disks on a ground and under a mean torque; ``main`` a disk of the main part.
    """
    joined, part = pieces(len(names), links), pieces(len(names), static)
    grounded = {part[d] for d in ground if joined[d] == joined[main]}
    errors = []
    if grounded and part[main] not in grounded:
        held = [i for i, p in enumerate(part) if p in grounded]
        errors.append(
            f"{source}: the [[ground]] on {names_of(names, held)} holds the train only through links without static"
            f" stiffness. Ground a disk that is joined by shafts or meshes to {names[main]!r}."
        )
    for p in sorted({part[d] for d in loaded if joined[d] == joined[main]} - grounded - {part[main]}):
        disks = [i for i, q in enumerate(part) if q == p]
        errors.append(
            f"{source}: a mean torque acts on {names_of(names, disks)}, which no static stiffness holds."
            " Give the damper a stiffness, ground the disk, or remove the mean torque."
        )
    return errors


def touches(changes) -> bool:
    """Tell whether changed fields ((table, field), ...) can decide what is held."""
    return any(field in _DECIDES.get(table, ()) for table, field in changes)


def train_errors(train) -> list[str]:
    """Find what the numbers of a train leave loose or unheld; nothing where they are traced."""
    topology, dampers = train.topology, train.dampers
    torques, cylinders = train.torques, train.cylinders
    numbers = [dampers.stiffness, torques.mean, torques.scale_rpm, torques.scale_factor, cylinders.gas_torque_mean]
    numbers += [cylinders.scale_factor, cylinders.pressure, cylinders.bore]
    if any(isinstance(v, jax.core.Tracer) for v in numbers):
        return []
    source = topology.name or "scene"
    stiff = np.asarray(dampers.stiffness) > 0.0
    errors = []
    if not isinstance(dampers.damping, jax.core.Tracer):
        loose = ~stiff & (np.asarray(dampers.damping) == 0.0)
        errors += [
            f"{source}, [[damper]] {topology.damper_names[i]!r}: damping and stiffness are both 0, so that the ring"
            " is loose. Give at least one of them."
            for i in np.flatnonzero(loose)
        ]
    rings = zip(topology.damper_disk, topology.ring_disks, strict=True)
    static = [
        *topology.shaft_ends,
        *topology.mesh_ends,
        *(ends for ends, held in zip(rings, stiff, strict=True) if held),
    ]
    errors += unheld(
        source,
        topology.disk_names,
        links=topology.link_ends,
        static=static,
        ground=topology.ground_disk,
        loaded=[*topology.load_disk, *_loaded(train)],
        main=topology.rotor.index(topology.reference_rotor),
    )
    return errors


@np.errstate(over="ignore", invalid="ignore")
def _loaded(train) -> list[int]:
    """Disks under a mean torque at some speed."""
    topology, torques, cylinders = train.topology, train.torques, train.cylinders
    mean = np.zeros((topology.n_disks, np.asarray(torques.scale_rpm).size))
    rows = zip(topology.torque_disk, torques.mean, torques.scale_rpm, torques.scale_factor, strict=True)
    speeds = np.ravel(torques.scale_rpm)
    for disk, value, rpm, factor in rows:
        mean[disk] += value * np.interp(speeds, np.asarray(rpm), np.asarray(factor))
    acts = np.any(np.asarray(cylinders.scale_factor) != 0.0, axis=-1)
    given = np.asarray(cylinders.gas_torque_mean) != 0.0
    traced = np.any(np.asarray(cylinders.pressure) != 0.0, axis=-1) & (np.asarray(cylinders.bore) > 0.0)
    fires = np.array(topology.cylinder_fires, dtype=bool)
    disks = np.array(topology.cylinder_disk, dtype=int)[fires & acts & (given | traced)]
    return [*np.flatnonzero(np.any(mean != 0.0, axis=1)).tolist(), *disks.tolist()]

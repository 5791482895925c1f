"""What holds the parts of a train: a part that only viscous links join has no place of its own."""

from __future__ import annotations

import numpy as np

from jaxhb._jax import on_host, traced
from jaxhb.model.gas import FAR
from jaxhb.model.graph import pieces
from jaxhb.model.mean_torques import mean_torques

_DECIDES = {
    "damper": ("stiffness", "damping"),
    "torque": ("mean",),
    "cylinder": ("gas_torque_mean", "pressure", "bore", "gas_factor", "combustion.heat", "combustion.imep"),
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
    # Pieces that no link joins to the train have their own sentence.
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
    numbers += [cylinders.scale_rpm, cylinders.scale_factor, cylinders.gas_factor, torques.rated_rpm]
    numbers += [cylinders.pressure, cylinders.bore, cylinders.stroke, cylinders.rod]
    numbers += [cylinders.traces, cylinders.combustion, cylinders.load_rpm, cylinders.load_share]
    if traced(numbers):
        return []
    source = topology.title
    stiff = np.asarray(dampers.stiffness) > 0.0
    # An order-tuned absorber is held by its centrifugal stiffness.
    stiff |= np.isin(len(topology.shaft_names) + np.arange(len(stiff)), topology.order_links)
    errors = []
    if not traced(dampers.damping):
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


def on_disks(disks: int, seats, torques) -> np.ndarray:
    """Sum torques [..., n] that act on the disks ``seats`` [n]: [..., disks]."""
    total = np.zeros((*torques.shape[:-1], disks))
    np.add.at(total, (..., np.array(seats, dtype=int)), torques)  # type: ignore[arg-type]  # numpy takes ... there
    return total


def speeds(train) -> np.ndarray:
    """Speeds (rpm) at which torques have a point: of scales, load shares, traces and rated speeds; [0] without any."""
    torques, cylinders = on_host((train.torques, train.cylinders))
    points = [torques.scale_rpm, cylinders.scale_rpm, torques.rated_rpm, cylinders.load_rpm]
    points += [cylinders.traces.rpm] if cylinders.traces is not None else []
    found = np.unique(np.concatenate([np.ravel(rpm) for rpm in points if rpm is not None]))
    # Points that fill up grids are no speeds.
    return found[found < FAR] if len(found) else np.zeros(1)


@np.errstate(over="ignore", invalid="ignore")
def _loaded(train) -> list[int]:
    """Disks under a mean torque at some speed."""
    topology, given = train.topology, on_host((train.torques, train.cylinders))
    means = mean_torques(given[0], given[1], topology.cylinder_fires, topology.cylinder_gas_revolutions, speeds(train))
    seats = [*topology.torque_disk, *topology.cylinder_disk]
    return np.flatnonzero(on_disks(topology.n_disks, seats, means).any(axis=0)).tolist()

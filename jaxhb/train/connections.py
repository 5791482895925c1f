"""How the disks hang together, pieces, rotors and closed loops, and what holds them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from jaxhb._jax import on_host, traced
from jaxhb.excitation.gas import FAR
from jaxhb.excitation.mean_torques import mean_torques

RATIO_TOLERANCE = 1e-6
"""Share by which the ratios around a closed loop may miss 1: radii are given with so many digits."""


def pieces(n_disks: int, pairs) -> list[int]:
    """Number the connected pieces of disks 0..n_disks-1 joined by ``pairs``, by first appearance."""
    neighbours = [[] for _ in range(n_disks)]
    for a, b in pairs:
        neighbours[a].append(b)
        neighbours[b].append(a)
    piece = [-1] * n_disks
    count = 0
    for start in range(n_disks):
        if piece[start] >= 0:
            continue
        stack = [start]
        piece[start] = count
        while stack:
            for other in neighbours[stack.pop()]:
                if piece[other] < 0:
                    piece[other] = count
                    stack.append(other)
        count += 1
    return piece


@dataclass(frozen=True, kw_only=True)
class Rotors:
    """Rotor of each disk, and for each rotor its path of (driving, driven) gears, speed ratio and sense."""

    rotor: tuple[int, ...]
    path: tuple[tuple[tuple[int, int], ...], ...]
    ratio: tuple[float, ...]
    sense: tuple[int, ...]


def find_rotors(n_disks, elastic_pairs, mesh_ends, mesh_internal, radius, reference: int):
    """Find the rotors and lead speeds and senses from the rotor of disk ``reference`` over the meshes.

    Returns the rotors, and the meshes that close a loop in which the train is locked, as (mesh, disks of the
    loop, why). Rotors that no mesh reaches keep ratio 1 and an empty path.
    """
    rotor = pieces(n_disks, elastic_pairs)
    count = max(rotor, default=-1) + 1
    at = [[] for _ in range(count)]
    for m, (a, b) in enumerate(mesh_ends):
        at[rotor[a]].append((m, a, b))
        at[rotor[b]].append((m, b, a))
    path: list[tuple[tuple[int, int], ...]] = [()] * count
    ratio, sense = [1.0] * count, [1] * count
    root = rotor[reference]
    seen, queue, used, locked = {root}, deque([root]), set(), []
    while queue:
        here = queue.popleft()
        for m, driver, driven in at[here]:
            there = rotor[driven]
            if m in used or there == here:
                continue
            used.add(m)
            new_ratio = ratio[here] * radius[driver] / radius[driven]
            new_sense = sense[here] * (1 if mesh_internal[m] else -1)
            if there not in seen:
                seen.add(there)
                queue.append(there)
                path[there] = (*path[here], (driver, driven))
                ratio[there], sense[there] = new_ratio, new_sense
                continue
            # Reached a second time: both ways must give one speed and one sense.
            disks = _loop(path[here], path[there], (driver, driven))
            if abs(new_ratio / ratio[there] - 1.0) > RATIO_TOLERANCE:
                locked.append((m, disks, f"its ratios multiply to {new_ratio / ratio[there]:.6g}"))
            elif new_sense != sense[there]:
                locked.append((m, disks, "its senses of rotation contradict each other"))
    found = Rotors(rotor=tuple(rotor), path=tuple(path), ratio=tuple(ratio), sense=tuple(sense))
    return found, locked


def _loop(path_a, path_b, closing) -> list[int]:
    """Gears round the loop closed between the ends of two paths."""
    shared = 0
    while shared < min(len(path_a), len(path_b)) and path_a[shared] == path_b[shared]:
        shared += 1
    there = [gear for step in path_a[shared:] for gear in step]
    back = [gear for step in reversed(path_b[shared:]) for gear in reversed(step)]
    return list(dict.fromkeys([*there, *closing, *back]))


def exact_radii(radius, teeth, mesh_ends) -> list[float]:
    """Radii made exactly proportional to the numbers of teeth among gears that mesh and both have them."""
    exact = list(radius)
    neighbours = {}
    for a, b in mesh_ends:
        if teeth[a] and teeth[b]:
            neighbours.setdefault(a, []).append(b)
            neighbours.setdefault(b, []).append(a)
    done = set()
    for start in neighbours:
        if start in done:
            continue
        done.add(start)
        stack = [start]
        while stack:
            here = stack.pop()
            for other in neighbours[here]:
                if other not in done:
                    done.add(other)
                    # From the first gear, not along the way: each radius is rounded once.
                    exact[other] = radius[start] * teeth[other] / teeth[start]
                    stack.append(other)
    return exact


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

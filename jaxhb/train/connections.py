"""How the disks hang together, pieces, rotors and closed loops, and what holds them."""

from dataclasses import dataclass

import numpy as np

from jaxhb._jax import on_host, traced
from jaxhb.excitation.gas import FAR
from jaxhb.excitation.mean_torques import mean_torques

RATIO_TOLERANCE = 1e-6  # share by which the ratios around a closed loop may miss 1: radii are given with so many digits


def neighbours(ends, nodes: int, without=()):
    """Of each node the others that links ``ends`` join it to, and these links: (other, link)."""
    found, without = [[] for _ in range(nodes)], set(without)
    for link, (a, b) in enumerate(ends):
        if link not in without:
            found[a].append((b, link))
            found[b].append((a, link))
    return found


def breadth_first(joined, root: int):
    """Nodes reached from a root over :func:`neighbours`, breadth first: (node, the one before, the link to it)."""
    seen, outward = {root}, [(root, -1, 0)]
    for node, _, _ in outward:
        for other, link in joined[node]:
            if other not in seen:
                seen.add(other)
                outward.append((other, node, link))
    return outward


def pieces(n_disks: int, pairs) -> list[int]:
    """Number the connected pieces of disks 0..n_disks-1 joined by ``pairs``, by first appearance."""
    joined, piece, count = neighbours(pairs, n_disks), [-1] * n_disks, 0
    for start in range(n_disks):
        if piece[start] < 0:
            for disk, *_ in breadth_first(joined, start):
                piece[disk] = count
            count += 1
    return piece


@dataclass(frozen=True, kw_only=True)
class Rotors:
    """Rotor of each disk, and for each rotor its path of (driving, driven) gears and its speed ratio."""

    rotor: tuple[int, ...]
    path: tuple[tuple[tuple[int, int], ...], ...]
    ratio: tuple[float, ...]


def find_rotors(n_disks, elastic_pairs, mesh_ends, mesh_internal, radius, reference: int):
    """Find the rotors and lead speeds and senses from the rotor of disk ``reference`` over the meshes.

    Returns the rotors, and the meshes that close a loop in which the train is locked, as (mesh, disks of the
    loop, why). Rotors that no mesh reaches keep ratio 1 and an empty path.
    """
    rotor = pieces(n_disks, elastic_pairs)
    count = max(rotor, default=-1) + 1
    pairs = [(rotor[a], rotor[b]) for a, b in mesh_ends]
    bare = {m for m, (a, b) in enumerate(pairs) if a == b}
    path: list[tuple[tuple[int, int], ...]] = [()] * count
    ratio, sense = [1.0] * count, [1] * count

    def led(m, here):
        """Where mesh m leads from rotor ``here``: its gears (driving, driven), ratio and sense there."""
        driver, driven = mesh_ends[m] if pairs[m][0] == here else mesh_ends[m][::-1]
        ahead = ratio[here] * radius[driver] / radius[driven]
        return (driver, driven), ahead, sense[here] * (1 if mesh_internal[m] else -1)

    tree = breadth_first(neighbours(pairs, count, bare), rotor[reference])
    rank = {there: k for k, (there, _, _) in enumerate(tree)}
    for there, here, m in tree[1:]:
        gears, ratio[there], sense[there] = led(m, here)
        path[there] = (*path[here], gears)
    locked, used = [], bare | {m for _, _, m in tree[1:]}
    for m, ends in enumerate(pairs):
        if m in used or ends[0] not in rank:
            continue
        # Reached a second time: both ways must give one speed and one sense.
        here, there = sorted(ends, key=rank.__getitem__)
        gears, ahead, turn = led(m, here)
        disks = _loop(path[here], path[there], gears)
        if abs(ahead / ratio[there] - 1.0) > RATIO_TOLERANCE:
            locked.append((m, disks, f"its ratios multiply to {ahead / ratio[there]:.6g}"))
        elif turn != sense[there]:
            locked.append((m, disks, "its senses of rotation contradict each other"))
    return Rotors(rotor=tuple(rotor), path=tuple(path), ratio=tuple(ratio)), locked


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
    exact, done = list(radius), set()
    toothed = [pair for pair in mesh_ends if all(teeth[gear] for gear in pair)]
    joined = neighbours(toothed, len(exact))
    for start in dict.fromkeys(gear for pair in toothed for gear in pair):
        if start in done:
            continue
        for gear, *_ in breadth_first(joined, start)[1:]:
            done.add(gear)
            # From the first gear, not along the way: each radius is rounded once.
            exact[gear] = radius[start] * teeth[gear] / teeth[start]
    return exact


_NO_MEAN = ("harmonics", "gas_torque", "firing_angle", "reciprocating_mass", "ambient_pressure")
"""Numbers of torques and cylinders that no mean torque depends on."""


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
    means = any(table in ("torque", "cylinder") and field not in _NO_MEAN for table, field in changes)
    return means or not {("damper", "stiffness"), ("damper", "damping")}.isdisjoint(changes)


def train_errors(train) -> list[str]:
    """Find what the numbers of a train leave loose or unheld; nothing where they are traced."""
    topology, dampers = train.topology, train.dampers
    given = [*vars(train.torques).items(), *vars(train.cylinders).items()]
    if traced(dampers.stiffness, [values for name, values in given if name not in _NO_MEAN]):
        return []
    stiff = np.asarray(dampers.stiffness) > 0.0
    # An order-tuned absorber is held by its centrifugal stiffness.
    stiff |= np.isin(len(topology.shaft_names) + np.arange(len(stiff)), topology.order_links)
    errors = []
    if not traced(dampers.damping):
        errors += [
            f"{topology.title}, [[damper]] {topology.damper_names[i]!r}: damping and stiffness are both 0, so that the"
            " ring is loose. Give at least one of them."
            for i in np.flatnonzero(~stiff & (np.asarray(dampers.damping) == 0.0))
        ]
    rings = zip(topology.damper_disk, topology.ring_disks, stiff, strict=True)
    static = [*topology.shaft_ends, *topology.mesh_ends, *((disk, ring) for disk, ring, held in rings if held)]
    return errors + unheld(
        topology.title,
        topology.disk_names,
        links=topology.link_ends,
        static=static,
        ground=topology.ground_disk,
        loaded=[*topology.load_disk, *_loaded(train)],
        main=topology.rotor.index(topology.reference_rotor),
    )


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
    means = mean_torques(*given, topology.gas_cycles, speeds(train))
    seats = [*topology.torque_disk, *topology.cylinder_disk]
    return np.flatnonzero(on_disks(topology.n_disks, seats, means).any(axis=0)).tolist()

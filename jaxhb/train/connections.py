"""How the disks hang together, pieces, rotors and closed loops, and what holds them."""

from dataclasses import dataclass

import numpy as np

from jaxhb._jax import on_host, traced
from jaxhb.elements.elements import shown
from jaxhb.excitation.gas import FAR
from jaxhb.excitation.mean_torques import mean_torques

# Share by which the ratios around a closed loop may miss 1: radii are given with so
# many digits
RATIO_TOLERANCE = 1e-6


def neighbours(ends, nodes: int, without=()):
    """Of each node the others that links ``ends`` join it to, and these links: (other,
    link).
    """
    found = [[] for _ in range(nodes)]
    without = set(without)
    for link, (a, b) in enumerate(ends):
        if link not in without:
            found[a].append((b, link))
            found[b].append((a, link))
    return found


def breadth_first(joined, root: int):
    """Nodes reached from a root over :func:`neighbours`, breadth first: (node, the one
    before, the link to it).
    """
    seen = {root}
    outward = [(root, -1, 0)]
    for node, _, _ in outward:
        for other, link in joined[node]:
            if other not in seen:
                seen.add(other)
                outward.append((other, node, link))
    return outward


def pieces(n_disks: int, pairs) -> list[int]:
    """Number the connected pieces of disks 0..n_disks-1 joined by ``pairs``, by first
    appearance.
    """
    joined = neighbours(pairs, n_disks)
    piece = [-1] * n_disks
    count = 0
    for start in range(n_disks):
        if piece[start] < 0:
            for disk, *_ in breadth_first(joined, start):
                piece[disk] = count
            count += 1
    return piece


def members_of(piece: list[int]) -> list[list[int]]:
    """Disks of each piece."""
    found = [[] for _ in range(max(piece, default=-1) + 1)]
    for disk, k in enumerate(piece):
        found[k].append(disk)
    return found


@dataclass(frozen=True, kw_only=True)
class Rotors:
    """Rotor of each disk, and for each rotor its path of (driving, driven) gears and
    its speed ratio.
    """

    rotor: tuple[int, ...]
    path: tuple[tuple[tuple[int, int], ...], ...]
    ratio: tuple[float, ...]


class Gearing:
    """Rotors of disks, and speeds and senses led over the meshes from any of them.

    ``locked`` collects the meshes that close a loop in which the train is locked, as
    (mesh, disks of the loop, why).
    """

    def __init__(self, n_disks: int, elastic_pairs, mesh_ends, mesh_internal, radius):
        self._mesh_ends = mesh_ends
        self._mesh_internal = mesh_internal
        self._radius = radius
        self.rotor = pieces(n_disks, elastic_pairs)
        count = max(self.rotor, default=-1) + 1
        self._pairs = [(self.rotor[a], self.rotor[b]) for a, b in mesh_ends]
        within = [m for m, (a, b) in enumerate(self._pairs) if a == b]
        self._joined = neighbours(self._pairs, count, within)
        self._path: list[tuple[tuple[int, int], ...]] = [()] * count
        self._ratio = [1.0] * count
        self._sense = [1] * count
        self.locked: list[tuple[int, list[int], str]] = []

    def _led(self, mesh: int, here: int):
        """Where a mesh leads from a rotor: its gears (driving, driven), ratio and sense
        there.
        """
        ends = self._mesh_ends[mesh]
        driver, driven = ends if self._pairs[mesh][0] == here else ends[::-1]
        ahead = self._ratio[here] * self._radius[driver] / self._radius[driven]
        return (
            (driver, driven),
            ahead,
            self._sense[here] * (1 if self._mesh_internal[mesh] else -1),
        )

    def lead(self, reference: int) -> set[int]:
        """Lead from the rotor of disk ``reference`` to all that meshes reach: these."""
        tree = breadth_first(self._joined, self.rotor[reference])
        rank = {there: k for k, (there, _, _) in enumerate(tree)}
        for there, here, mesh in tree[1:]:
            gears, self._ratio[there], self._sense[there] = self._led(mesh, here)
            self._path[there] = (*self._path[here], gears)
        closing = {mesh for there in rank for _, mesh in self._joined[there]} - {
            mesh for _, _, mesh in tree[1:]
        }
        for mesh in sorted(closing):
            # Reached a second time: both ways must give one speed and one sense.
            here, there = sorted(self._pairs[mesh], key=rank.__getitem__)
            gears, ahead, turn = self._led(mesh, here)
            share = ahead / self._ratio[there]
            if abs(share - 1.0) > RATIO_TOLERANCE:
                why = f"its ratios multiply to {share:.6g}"
            elif turn != self._sense[there]:
                why = "its senses of rotation contradict each other"
            else:
                continue
            self.locked.append(
                (mesh, _loop(self._path[here], self._path[there], gears), why)
            )
        return set(rank)

    def rotors(self, reached: set[int]) -> Rotors:
        """The rotors, those that are not among ``reached`` with ratio 1 and an empty
        path.
        """
        return Rotors(
            rotor=tuple(self.rotor),
            path=tuple(
                path if k in reached else () for k, path in enumerate(self._path)
            ),
            ratio=tuple(
                ratio if k in reached else 1.0 for k, ratio in enumerate(self._ratio)
            ),
        )


def _loop(path_a, path_b, closing) -> list[int]:
    """Gears round the loop closed between the ends of two paths."""
    shared = 0
    while shared < min(len(path_a), len(path_b)) and path_a[shared] == path_b[shared]:
        shared += 1
    there = [gear for step in path_a[shared:] for gear in step]
    back = [gear for step in reversed(path_b[shared:]) for gear in reversed(step)]
    return list(dict.fromkeys([*there, *closing, *back]))


def exact_radii(radius, teeth, mesh_ends) -> list[float]:
    """Radii made exactly proportional to the numbers of teeth among gears that mesh and
    both have them.
    """
    exact = list(radius)
    done = set()
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


_NO_MEAN = (
    "harmonics",
    "gas_torque",
    "firing_angle",
    "reciprocating_mass",
    "ambient_pressure",
)
"""Numbers of torques and cylinders that no mean torque depends on."""


def names_of(names, indices, most: int = 8) -> str:
    """List names for a sentence."""
    listed = ", ".join(shown(names[i]) for i in indices[:most])
    return listed + (f", … ({len(indices)} in all)" if len(indices) > most else "")


def unheld(source, names, *, links, static, ground, loaded, main: int) -> list[str]:
    """Find parts behind viscous links that the only ground holds, or on which a mean
    torque acts.

    ``links`` and ``static`` are pairs of disks joined by any link and by one with
    static stiffness; ``ground`` and ``loaded`` the disks on a ground and under a mean
    torque; ``main`` a disk of the main part.
    """
    joined = pieces(len(names), links)
    part = pieces(len(names), static)
    # Pieces that no link joins to the train have their own sentence.
    grounded = {part[d] for d in ground if joined[d] == joined[main]}
    errors = []
    members = members_of(part)
    if grounded and part[main] not in grounded:
        held = [i for i, p in enumerate(part) if p in grounded]
        errors.append(
            f"{source}: the [[ground]] on {names_of(names, held)} holds the train only"
            " through links without static stiffness. Ground a disk that is joined by"
            f" shafts or meshes to {names[main]!r}."
        )
    for p in sorted(
        {part[d] for d in loaded if joined[d] == joined[main]} - grounded - {part[main]}
    ):
        errors.append(
            f"{source}: a mean torque acts on {names_of(names, members[p])}, which no"
            " static stiffness holds. Give the damper a stiffness, ground the disk, or"
            " remove the mean torque."
        )
    return errors


def touches(changes) -> bool:
    """Tell whether changed fields ((table, field), ...) can decide what is held."""
    means = any(
        table in ("torque", "cylinder") and field not in _NO_MEAN
        for table, field in changes
    )
    return means or not {("damper", "stiffness"), ("damper", "damping")}.isdisjoint(
        changes
    )


def train_errors(train) -> list[str]:
    """Find what the numbers of a train leave loose or unheld; nothing where they are
    traced.
    """
    topology = train.topology
    dampers = train.dampers
    given = [*vars(train.torques).items(), *vars(train.cylinders).items()]
    if traced(
        dampers.stiffness, [values for name, values in given if name not in _NO_MEAN]
    ):
        return []
    stiff = np.asarray(dampers.stiffness) > 0.0
    # An order-tuned absorber is held by its centrifugal stiffness.
    stiff |= np.isin(
        len(topology.shaft_names) + np.arange(len(stiff)), topology.order_links
    )
    errors = []
    if not traced(dampers.damping):
        errors += [
            f"{topology.title}, [[damper]] {topology.damper_names[i]!r}: damping and"
            " stiffness are both 0, so that the ring is loose. Give at least one of"
            " them."
            for i in np.flatnonzero(~stiff & (np.asarray(dampers.damping) == 0.0))
        ]
    rings = zip(topology.damper_disk, topology.ring_disks, stiff, strict=True)
    static = [
        *topology.shaft_ends,
        *topology.mesh_ends,
        *((disk, ring) for disk, ring, held in rings if held),
    ]
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
    places = np.array(seats, dtype=int)
    np.add.at(total, (..., places), torques)  # type: ignore[arg-type]
    return total


def speeds(train) -> np.ndarray:
    """Speeds (rpm) at which torques have a point: of scales, loads, traces, charge
    pressures and rated speeds; [0] without any.
    """
    torques, cylinders = on_host((train.torques, train.cylinders))
    points = [
        torques.scale_rpm,
        cylinders.scale_rpm,
        torques.rated_rpm,
        cylinders.load_rpm,
    ]
    points += [cylinders.traces.rpm] if cylinders.traces is not None else []
    burning = cylinders.combustion
    if burning is not None and burning.charge_at is not None:
        points.append(burning.charge_at[[by == "rpm" for by in burning.charge_by]])
    found = np.unique(
        np.concatenate([np.ravel(rpm) for rpm in points if rpm is not None])
    )
    # Points that fill up grids are no speeds.
    return found[found < FAR] if len(found) else np.zeros(1)


@np.errstate(over="ignore", invalid="ignore")
def _loaded(train) -> list[int]:
    """Disks under a mean torque at some speed."""
    topology = train.topology
    (torques, cylinders) = on_host((train.torques, train.cylinders))
    means = mean_torques(torques, cylinders, topology.gas_cycles, speeds(train))
    seats = [*topology.torque_disk, *topology.cylinder_disk]
    return np.flatnonzero(on_disks(topology.n_disks, seats, means).any(axis=0)).tolist()

"""Connections of the disks: pieces, rotors and closed loops, and what holds them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jaxhb._jax import on_host, traced
from jaxhb.elements.excitations import EXCITATIONS
from jaxhb.elements.sentences import shown
from jaxhb.train.excitation import mean_on_disks, speeds

if TYPE_CHECKING:
    from jaxhb.train.tables import TrainArrays

# Share by which the ratios around a closed loop may miss 1: radii are given with so
# many digits
RATIO_TOLERANCE = 1e-6


def neighbours(
    ends: Iterable[Sequence[int]], nodes: int, without: Iterable[int] = ()
) -> list[list[tuple[int, int]]]:
    """Nodes that the links ``ends`` join each node to, and these links: a list of
    (other, link) for each node.
    """
    joined: list[list[tuple[int, int]]] = [[] for _ in range(nodes)]
    skipped = set(without)
    for link, (a, b) in enumerate(ends):
        if link not in skipped:
            joined[a].append((b, link))
            joined[b].append((a, link))
    return joined


def breadth_first(
    joined: Sequence[Sequence[tuple[int, int]]], root: int
) -> list[tuple[int, int, int]]:
    """Nodes reached from a root over :func:`neighbours`, breadth first: (node, the node
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


def pieces(n_disks: int, pairs: Iterable[Sequence[int]]) -> list[int]:
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


def members_of(piece: Sequence[int]) -> list[list[int]]:
    """Disks of each piece."""
    members: list[list[int]] = [[] for _ in range(max(piece, default=-1) + 1)]
    for disk, number in enumerate(piece):
        members[number].append(disk)
    return members


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

    def __init__(
        self,
        n_disks: int,
        elastic_pairs: Sequence[tuple[int, int]],
        mesh_ends: Sequence[tuple[int, int]],
        mesh_internal: Sequence[bool],
        radius: Sequence[float],
    ) -> None:
        self._mesh_ends = mesh_ends
        self._mesh_internal = mesh_internal
        self._radius = radius
        self.rotor = pieces(n_disks, elastic_pairs)
        count = max(self.rotor, default=-1) + 1
        self._pairs = [(self.rotor[a], self.rotor[b]) for a, b in mesh_ends]
        within = [mesh for mesh, (a, b) in enumerate(self._pairs) if a == b]
        self._joined = neighbours(self._pairs, count, within)
        self._path: list[tuple[tuple[int, int], ...]] = [()] * count
        self._ratio = [1.0] * count
        self._sense = [1] * count
        self.locked: list[tuple[int, list[int], str]] = []

    def _follow(self, mesh: int, rotor: int) -> tuple[tuple[int, int], float, int]:
        """Follow a mesh from a rotor to the next: its gears (driving, driven), and the
        ratio and the sense of rotation there.
        """
        ends = self._mesh_ends[mesh]
        driver, driven = ends if self._pairs[mesh][0] == rotor else ends[::-1]
        next_ratio = self._ratio[rotor] * self._radius[driver] / self._radius[driven]
        next_sense = self._sense[rotor] * (1 if self._mesh_internal[mesh] else -1)
        return (driver, driven), next_ratio, next_sense

    def lead(self, reference: int) -> set[int]:
        """Lead speeds from the rotor of disk ``reference`` over all meshes, and return
        the rotors that they reach.
        """
        tree = breadth_first(self._joined, self.rotor[reference])
        rank = {rotor: position for position, (rotor, _, _) in enumerate(tree)}
        for next_rotor, rotor, mesh in tree[1:]:
            gears, ratio, sense = self._follow(mesh, rotor)
            self._ratio[next_rotor] = ratio
            self._sense[next_rotor] = sense
            self._path[next_rotor] = (*self._path[rotor], gears)
        meshes = {mesh for rotor in rank for _, mesh in self._joined[rotor]}
        closing = meshes - {mesh for _, _, mesh in tree[1:]}
        for mesh in sorted(closing):
            # Reached a second time: both ways must give one speed and one sense.
            rotor, next_rotor = sorted(self._pairs[mesh], key=rank.__getitem__)
            gears, next_ratio, next_sense = self._follow(mesh, rotor)
            mismatch = next_ratio / self._ratio[next_rotor]
            if abs(mismatch - 1.0) > RATIO_TOLERANCE:
                why = f"its ratios multiply to {mismatch:.6g}"
            elif next_sense != self._sense[next_rotor]:
                why = "its senses of rotation contradict each other"
            else:
                continue
            self.locked.append(
                (mesh, _loop(self._path[rotor], self._path[next_rotor], gears), why)
            )
        return set(rank)

    def rotors(self, reached: Collection[int]) -> Rotors:
        """The rotors; those that are not among ``reached`` have ratio 1 and an empty
        path.
        """
        return Rotors(
            rotor=tuple(self.rotor),
            path=tuple(
                path if rotor in reached else ()
                for rotor, path in enumerate(self._path)
            ),
            ratio=tuple(
                ratio if rotor in reached else 1.0
                for rotor, ratio in enumerate(self._ratio)
            ),
        )


def _loop(
    path_a: Sequence[tuple[int, int]],
    path_b: Sequence[tuple[int, int]],
    closing: tuple[int, int],
) -> list[int]:
    """Gears round the loop closed between the ends of two paths."""
    shared = 0
    while shared < min(len(path_a), len(path_b)) and path_a[shared] == path_b[shared]:
        shared += 1
    outward = [gear for step in path_a[shared:] for gear in step]
    back = [gear for step in reversed(path_b[shared:]) for gear in reversed(step)]
    return list(dict.fromkeys([*outward, *closing, *back]))


def exact_radii(
    radius: Sequence[float | None],
    teeth: Sequence[int],
    mesh_ends: Sequence[tuple[int, int]],
) -> list[float | None]:
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
        first_radius = radius[start]
        assert first_radius is not None  # a disk with teeth that count is a gear
        for gear, *_ in breadth_first(joined, start)[1:]:
            done.add(gear)
            # From the first gear, not along the way: each radius is rounded once.
            exact[gear] = first_radius * teeth[gear] / teeth[start]
    return exact


def names_of(names: Sequence[str], indices: Sequence[int], most: int = 8) -> str:
    """List names for a sentence."""
    listed = ", ".join(shown(names[index]) for index in indices[:most])
    return listed + (f", … ({len(indices)} in all)" if len(indices) > most else "")


def unheld(
    source: str,
    names: Sequence[str],
    *,
    links: Iterable[Sequence[int]],
    static: Iterable[Sequence[int]],
    ground: Sequence[int],
    loaded: Iterable[int],
    main: int,
) -> list[str]:
    """Find parts behind viscous links that the only ground holds, or on which a mean
    torque acts.

    ``links`` and ``static`` are pairs of disks joined by any link and by one with
    static stiffness; ``ground`` and ``loaded`` the disks on a ground and under a mean
    torque; ``main`` a disk of the main part.
    """
    joined = pieces(len(names), links)
    piece = pieces(len(names), static)
    # Pieces that no link joins to the train have their own sentence.
    grounded = {piece[disk] for disk in ground if joined[disk] == joined[main]}
    errors = []
    members = members_of(piece)
    if grounded and piece[main] not in grounded:
        held_disks = [disk for disk, number in enumerate(piece) if number in grounded]
        errors.append(
            f"{source}: the [[ground]] on {names_of(names, held_disks)} holds the train"
            " only through links without static stiffness. Ground a disk that is joined"
            f" by shafts or meshes to {names[main]!r}."
        )
    in_main = {piece[disk] for disk in loaded if joined[disk] == joined[main]}
    for number in sorted(in_main - grounded - {piece[main]}):
        errors.append(
            f"{source}: a mean torque acts on {names_of(names, members[number])}, which"
            " no static stiffness holds. Give the damper a stiffness, ground the disk,"
            " or remove the mean torque."
        )
    return errors


def touches(changes: Collection[tuple[str, str]]) -> bool:
    """Tell whether changed fields ((table, field), ...) can decide what is held."""
    moves_means = any(
        table in EXCITATIONS and field not in EXCITATIONS[table].no_mean
        for table, field in changes
    )
    return moves_means or not {
        ("damper", "stiffness"),
        ("damper", "damping"),
    }.isdisjoint(changes)


def train_errors(train: TrainArrays) -> list[str]:
    """Find parts that the numbers of a train leave loose or unheld; nothing where they
    are traced.
    """
    topology = train.topology
    dampers = train.dampers
    deciding = [
        values
        for kind, numbers, _ in train.excited()
        for name, values in vars(numbers).items()
        if name not in kind.no_mean
    ]
    if traced(dampers.stiffness, deciding):
        return []
    stiff = np.asarray(dampers.stiffness) > 0.0
    # An order-tuned absorber is held by its centrifugal stiffness.
    stiff |= np.isin(
        len(topology.shaft_names) + np.arange(len(stiff)), topology.order_links
    )
    stiff |= _springs_over_rpm(train)
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
        *((disk, ring) for disk, ring, is_held in rings if is_held),
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


def _springs_over_rpm(train: TrainArrays) -> np.ndarray:
    """Whether each damper has a stiffness over the speed that is above 0 somewhere,
    ``[n_dampers]``.
    """
    sprung = np.zeros(len(train.topology.damper_names), dtype=bool)
    for table, field, i, count in train.topology.rpm_tables:
        if (table, field) == ("damper", "stiffness"):
            rows = train.dampers.stiffness_over_rpm[i, :count]
            sprung[i] = traced(rows) or np.any(np.asarray(rows)[:, 1] > 0.0)
    return sprung


@np.errstate(over="ignore", invalid="ignore")
def _loaded(train: TrainArrays) -> list[int]:
    """Disks under a mean torque at some speed."""
    host = on_host(train)
    return np.flatnonzero(mean_on_disks(host, speeds(host)).any(axis=0)).tolist()

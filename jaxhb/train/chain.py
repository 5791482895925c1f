"""From the drive train to a tree of links in circumferential displacements, and back.

Displacements are measured on one pitch circle per rotor, ``x = R phi`` with R the
radius of the rotor's first gear (1 m on a rotor without gears): ``m = J/R^2``, ``b =
beta/R^2``, ``c = k/R^2``, ``q = T/R`` (Fridman 2009, chapter 1). A link deflects by ``l
= a x_a - b x_b``; the arms a, b are 1 for shafts and ``r/R`` for a gear on a rotor with
several. Every rotor counts its own sense of rotation positive.

The elimination order is a list of nodes, each before its parent: Fridman's numbering
(main chain, side branches, a fictitious node wherever the main chain jumps over a
branch) is another way to write the same tree.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import numpy as np

from jaxhb._jax import Array, added, namespace
from jaxhb.equations.block_sweep import Slots, slots
from jaxhb.train.connections import breadth_first, neighbours
from jaxhb.train.kinematics import displacement_radii, speed_ratios
from jaxhb.train.varying import refuse_varying

if TYPE_CHECKING:
    from jaxhb.train.tables import TrainArrays
    from jaxhb.train.topology import Topology

ALL = slice(None)  # every link


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Condensation:
    """Chains of disks without teeth and without branches, condensed to one link each;
    integer arrays, no names.

    Of the n disks condensed, chain after chain: disk, chain, after (the link onwards)
    and before (the link by which the chain begins, if it lies between two disks). Of
    the c chains: begin and end, the disks that they lie between, first the t that do,
    and end of those with one free end: ``(t,)`` and ``(c,)``. kept ``(K,)``: the other
    disks; begin, end and ``tree`` count these. The links of ``tree`` are the t chains
    and after them ``plain``, links between disks that remain.
    """

    disk: np.ndarray
    chain: np.ndarray
    before: np.ndarray
    after: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    kept: np.ndarray
    plain: np.ndarray
    tree: Tree


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Tree:
    """Elimination order of S nodes joined by tree links, leaves first, root last;
    integer arrays, no names.

    node : ``(S,)`` disk of each position; parent : ``(S,)`` position of the parent, S
    at the root; slots : of the sweep; link : ``(S,)`` link to the parent, 0 at the
    root; from_a : ``(S,)`` whether the node is the link's first end; loops : ``(n,)``
    links outside the tree; end_a, end_b : ``(L,)`` disks that each link joins;
    condensation : the chains between the teeth, if they are known; pinned : bool
    ``(L,)``, the links that hold the mean of the part that hangs on them where they
    have no stiffness, if that is known.
    """

    node: np.ndarray
    parent: np.ndarray
    slots: Slots
    link: np.ndarray
    from_a: np.ndarray
    loops: np.ndarray
    end_a: np.ndarray
    end_b: np.ndarray
    condensation: Condensation | None = None
    pinned: np.ndarray | None = None


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class System:
    """Arrays of the linear train in circumferential displacements (meshes taken in
    contact).

    radius : ``(S,)`` m, displacement / angle; mass kg, damping N s/m of disks to
    ground, ground N/m : ``(S,)``; stiffness N/m, viscous N s/m, loss, arm_a, arm_b :
    ``(L,)``, the first three ``(L, H)`` where links have their own numbers at each of H
    frequencies, viscous the ``damping`` of shafts, dampers and meshes; floating : True
    where nothing holds the mean angle.

    The incidence of links is here alone: methods take the ``links`` that are meant, by
    default all L.
    """

    tree: Tree
    radius: Array
    mass: Array
    damping: Array
    ground: Array
    stiffness: Array
    viscous: Array
    loss: Array
    arm_a: Array
    arm_b: Array
    floating: np.ndarray

    def _arms(self, links: slice | Array, ndim: int) -> tuple[Array, Array]:
        """Arms a and b of links, shaped to multiply arrays of ``ndim`` dimensions."""
        shape = (-1,) + (1,) * (ndim - 1)
        return self.arm_a[links].reshape(shape), self.arm_b[links].reshape(shape)

    def _at_ends(self, links: slice | Array, at_a: Array, at_b: Array) -> Array:
        """Sums ``(S, ...)`` on the disks of numbers ``(n, ...)`` at the two ends of
        links.
        """
        xp = namespace(self, at_a)
        sums = xp.zeros((len(self.mass), *at_a.shape[1:]), at_a.dtype)
        return added(
            added(sums, self.tree.end_a[links], at_a), self.tree.end_b[links], at_b
        )

    def deflections(self, displacement: Array, links: slice | Array = ALL) -> Array:
        """Deflections D x ``(n, ...)``, ``a x_a - b x_b`` of each link, from
        displacements ``(S, ...)``.
        """
        arm_a, arm_b = self._arms(links, displacement.ndim)
        return (
            arm_a * displacement[self.tree.end_a[links]]
            - arm_b * displacement[self.tree.end_b[links]]
        )

    def spread(self, force: Array, links: slice | Array = ALL) -> Array:
        """Forces D^T f ``(S, ...)`` on the disks, a f and -b f at the ends of each
        link, from forces ``(n, ...)``.
        """
        arm_a, arm_b = self._arms(links, force.ndim)
        return self._at_ends(links, arm_a * force, -arm_b * force)

    def incidence(self, links: slice | Array = ALL) -> Array:
        """Columns of D^T ``(S, n)``: a at the first end of each link and -b at the
        second.
        """
        return self.spread(np.eye(len(self.arm_a[links])), links)

    def springs(self) -> tuple[Array, Array]:
        """Links and grounds as rows ``(L + S, S)`` of the motion that each resists,
        with their stiffness ``(L + S,)`` in N/m.
        """
        xp = namespace(self)
        rows = xp.concatenate([xp.asarray(self.incidence()).T, xp.eye(len(self.mass))])
        stiffness = xp.concatenate(
            [xp.asarray(self.stiffness), xp.asarray(self.ground)]
        )
        return rows, stiffness

    def held_stiffness(self) -> Array:
        """``(S,)`` N/m of every disk with all other disks held: the diagonal of K."""
        return self.ground + self._at_ends(
            ALL, self.arm_a**2 * self.stiffness, self.arm_b**2 * self.stiffness
        )


@functools.lru_cache(maxsize=256)
def span(topology: Topology) -> Tree:
    """The elimination :class:`Tree` of a topology: rooted at the first grounded disk,
    stiff links first.

    Links that close a loop (shafts before meshes in the tree) are listed in ``loops``.
    """
    ends = topology.link_ends
    disks = len(topology.disk_names)
    root = topology.ground_disk[0] if topology.ground_disk else 0
    tree = span_links(ends, disks, root)
    teeth = {
        disk
        for pair in (
            *topology.mesh_ends,
            *(ends[link] for link, *_ in topology.springs),
        )
        for disk in pair
    }
    condensation = condense_chains(tree, root, teeth)
    return dataclasses.replace(
        tree, condensation=condensation, pinned=_pinned(topology, tree)
    )


def _pinned(topology: Topology, tree: Tree) -> np.ndarray:
    """Whether each link is that of a damper whose ring hangs on it alone, with no
    spring beside it: bool ``(L,)``.
    """
    ends = topology.link_ends
    first_damper = len(topology.shaft_names)
    sprung = {link for link, kind, _ in topology.springs if kind != "friction"}

    def hangs(link: int) -> bool:
        """Whether nothing but ``link`` joins a ring to its hub."""
        hub, ring = ends[link]
        rest = neighbours(ends, topology.n_disks, [link]) if len(tree.loops) else None
        return rest is None or ring not in {
            disk for disk, *_ in breadth_first(rest, hub)
        }

    dampers = range(first_damper, first_damper + len(topology.damper_names))
    pinned = [link for link in dampers if link not in sprung and hangs(link)]
    return np.isin(np.arange(len(ends)), pinned)


def condense_chains(tree: Tree, root: int, teeth: Iterable[int]) -> Condensation:
    """Condense the chains of a tree; the disks ``teeth`` and ``root`` remain, and all
    that branch.
    """
    ends = list(zip(tree.end_a.tolist(), tree.end_b.tolist(), strict=True))
    disks = len(tree.node)
    links_at = [[link for _, link in joined] for joined in neighbours(ends, disks)]
    needed = {root, *teeth, *(disk for link in tree.loops for disk in ends[link])}
    remaining = [
        disk for disk in range(disks) if disk in needed or len(links_at[disk]) > 2
    ]
    number = {disk: i for i, disk in enumerate(remaining)}

    def walk(disk: int, link: int) -> tuple[list[int], list[int]]:
        """Disks and links from ``disk`` over ``link`` to a free end or to a disk that
        remains, the last of the disks.
        """
        passed = []
        links = [link]
        while True:
            disk = sum(ends[links[-1]]) - disk
            passed.append(disk)
            onward = [index for index in links_at[disk] if index != links[-1]]
            if disk in number or not onward:
                return passed, links
            links += onward

    # Chains: their disks, the link before these, the link after each, both end disks.
    through: list[tuple[list[int], int, list[int], int, int]] = []
    hanging: list[tuple[list[int], int, list[int], int, int]] = []
    plain = []
    for start in remaining:
        for link in links_at[start]:
            passed, links = walk(start, link)
            end = passed[-1]
            if end not in number:
                hanging.append((passed[::-1], link, links[::-1], start, start))
            elif (start, link) < (end, links[-1]):  # seen from both ends
                if links[1:]:
                    through.append((passed[:-1], link, links[1:], start, end))
                else:
                    plain.append(link)
    plain.sort()
    rows = []
    for chain, (passed, before, links, _, _) in enumerate(through + hanging):
        rows += [
            (disk, chain, before, after)
            for disk, after in zip(passed, links, strict=True)
        ]
    starts = [number[start] for *_, start, _ in through]
    chain_ends = [number[end] for *_, end in through + hanging]
    joints = list(zip(starts, chain_ends, strict=False))
    joints += [(number[ends[link][0]], number[ends[link][1]]) for link in plain]
    columns = np.array(rows, dtype=np.int32).reshape(-1, 4).T
    return Condensation(
        disk=columns[0],
        chain=columns[1],
        before=columns[2],
        after=columns[3],
        begin=_index(starts),
        end=_index(chain_ends),
        kept=_index(remaining),
        plain=_index(plain),
        tree=span_links(joints, len(remaining), number[root]),
    )


def span_links(ends: Sequence[Sequence[int]], disks: int, root: int) -> Tree:
    """Spanning tree of links ``ends`` over ``disks`` nodes as a :class:`Tree`; earlier
    links are preferred.
    """
    group = list(range(disks))

    def find(disk: int) -> int:
        """The disk that stands for all that are joined to a disk so far."""
        while group[disk] != disk:
            group[disk] = group[group[disk]]
            disk = group[disk]
        return disk

    loops = []
    for index, (a, b) in enumerate(ends):
        # Kruskal's algorithm: links come in the order of the topology, shafts before
        # meshes, so that meshes close the loops.
        if find(a) == find(b):
            loops.append(index)
        else:
            group[find(a)] = find(b)
    reached = breadth_first(neighbours(ends, disks, loops), root)
    outward = [disk for disk, *_ in reached]
    above = {disk: previous for disk, previous, _ in reached}
    via = {disk: link for disk, _, link in reached}
    branches: dict[int, list[int]] = {disk: [] for disk in outward}
    for disk in outward[1:]:
        branches[above[disk]].append(disk)
    weight = dict.fromkeys(outward, 1)
    for disk in reversed(outward[1:]):
        weight[above[disk]] += weight[disk]
    order = []
    stack = [root]
    # The heaviest branch is eliminated first: the sweep then needs the fewest places
    while stack:
        disk = stack.pop()
        order.append(disk)
        stack += sorted(branches[disk], key=weight.__getitem__, reverse=True)
    order.reverse()
    position = {disk: position for position, disk in enumerate(order)}
    parent = _index(
        [position[above[disk]] if above[disk] >= 0 else disks for disk in order]
    )
    link = _index([via[disk] for disk in order])
    end_a = _index([a for a, _ in ends])
    end_b = _index([b for _, b in ends])
    node = _index(order)
    from_a = end_a[link] == node if len(ends) else np.ones(disks, bool)
    return Tree(node, parent, slots(parent), link, from_a, _index(loops), end_a, end_b)


def assemble(train: TrainArrays) -> System:
    """The :class:`System` of a drive train without links that vary; every number stays
    differentiable.
    """
    refuse_varying(train.topology)
    xp = namespace(train)
    topology = train.topology
    tree = span(train.topology)
    radius = displacement_radii(train)
    square = radius**2
    zeros = xp.zeros(len(topology.damper_names))
    ground = added(
        xp.zeros(len(radius)), _index(topology.ground_disk), train.grounds.stiffness
    )
    shaft_at = square[_index([a for a, _ in topology.shaft_ends])]
    ring_at = square[_index(topology.damper_disk)]
    gear_radius = xp.concatenate([xp.asarray(train.disks.radius), zeros])
    unit = xp.ones(len(topology.shaft_names) + len(topology.damper_names))
    mesh_a = _index([a for a, _ in topology.mesh_ends])
    mesh_b = _index([b for _, b in topology.mesh_ends])
    meshes = train.meshes
    shafts = train.shafts
    dampers = train.dampers
    return System(
        tree=tree,
        radius=radius,
        mass=xp.concatenate([train.disks.inertia, dampers.inertia]) / square,
        damping=xp.concatenate([train.disks.damping, zeros]) / square,
        ground=ground / square,
        stiffness=xp.concatenate(
            [shafts.stiffness / shaft_at, dampers.stiffness / ring_at, meshes.stiffness]
        ),
        viscous=xp.concatenate(
            [shafts.damping / shaft_at, dampers.damping / ring_at, meshes.damping]
        ),
        loss=xp.concatenate(
            [
                shafts.loss_factor,
                dampers.loss_factor,
                xp.zeros(len(topology.mesh_names)),
            ]
        ),
        arm_a=xp.concatenate([unit, gear_radius[mesh_a] / radius[mesh_a]]),
        arm_b=xp.concatenate([unit, gear_radius[mesh_b] / radius[mesh_b]]),
        floating=np.array(not topology.ground_disk),
    )


def _index(values: Collection[int]) -> np.ndarray:
    """Integers as a host array."""
    return np.array(values, dtype=np.int32)


def rigid_shape(train: TrainArrays, radius: Array) -> Array:
    """``(S,)`` displacements of the motion in which no link deflects: speed ratio x R
    of each disk's rotor.
    """
    return speed_ratios(train)[_index(train.topology.rotor)] * radius


def drift(system: System, rigid: Array, mean: Array) -> Array:
    """Share of the rigid rotation in mean displacements ``(S, ...)`` of a floating
    train, weighted by inertia; 0 of a train that a ground holds.
    """
    xp = namespace(mean)
    mass = xp.asarray(system.mass)
    rigid = xp.asarray(rigid)
    share = (mass * rigid) @ mean / (mass @ rigid**2)
    column = rigid.reshape((-1,) + (1,) * (mean.ndim - 1))
    return xp.where(system.floating, column * share, 0.0)


def to_angles(system: System, displacement: Array) -> Array:
    """Angles phi = x / R in rad of displacements ``(S, ...)`` in m."""
    return displacement / system.radius.reshape((-1,) + (1,) * (displacement.ndim - 1))

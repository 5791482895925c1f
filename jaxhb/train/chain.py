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
from typing import TYPE_CHECKING

import numpy as np

from jaxhb._jax import Array, Number, added, namespace
from jaxhb.equations.block_sweep import slots
from jaxhb.equations.system import Condensation, System, Tree
from jaxhb.train.connections import breadth_first, neighbours
from jaxhb.train.kinematics import displacement_radii, speed_ratios
from jaxhb.train.varying import at_speed, refuse_varying

if TYPE_CHECKING:
    from jaxhb.train.tables import TrainArrays
    from jaxhb.train.topology import Topology


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
        remaining=_index(remaining),
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


def assemble(train: TrainArrays, rpm: Number | None = None) -> System:
    """The :class:`System` of a drive train without links that vary; every number stays
    differentiable.

    ``rpm`` : speed of the reference rotor, a number that may be traced, which a train
    needs whose damping or stiffness depends on it: :class:`SceneError` without. Where
    nothing does it changes nothing.
    """
    if rpm is not None:
        train = at_speed(train, rpm)
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

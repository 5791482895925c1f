"""Ways through the disks of a train along its links, as one would draw it: the longest,
then branches.
"""

from collections.abc import Collection, Iterable

from jaxhb.train.chain import span
from jaxhb.train.connections import breadth_first, neighbours
from jaxhb.train.topology import Topology

Neighbours = list[list[tuple[int, int]]]
"""Neighbours of every disk: (other, link)."""


def joined(topology: Topology, links: Iterable[int]) -> Neighbours:
    """Find the neighbours of every disk by some links of the train, without those that
    close a loop.
    """
    every = range(len(topology.link_ends))
    return neighbours(
        topology.link_ends,
        topology.n_disks,
        {*every} - {*links} | {*span(topology).loops.tolist()},
    )


def ways(near: Neighbours, start: int, *, through: bool = False) -> list[list[int]]:
    """Find ways through the disks that hang on ``start``, on which every link lies
    once: the longest, or the longest from ``start`` if it has to lie on the first; then
    branches, each from a disk of an earlier way.
    """
    # In a tree the disk farthest from any is an end of a longest way.
    first = _longest(near, _longest(near, start)[-1])
    if through and start not in first:
        first = _longest(near, start)
    # As the scene runs, whichever end the search began at.
    all_ways = [first if first[0] < first[-1] else first[::-1]]
    placed = set(first)
    for way in all_ways:
        for disk in way:
            while branches := [
                _longest(near, other, placed)
                for other, _ in near[disk]
                if other not in placed
            ]:
                branch = [disk, *max(branches, key=len)]
                all_ways.append(branch)
                placed.update(branch)
    return all_ways


def _longest(near: Neighbours, start: int, placed: Collection[int] = ()) -> list[int]:
    """Find the disks from ``start`` to the one farthest from it, without those that are
    placed.
    """
    free = [[pair for pair in pairs if pair[0] not in placed] for pairs in near]
    outward = breadth_first(free, start)
    before = {disk: other for disk, other, _ in outward}
    path = [outward[-1][0]]
    while path[-1] != start:
        path.append(before[path[-1]])
    return path[::-1]


def train_lines(topology: Topology) -> list[list[int]]:
    """Find ways along the train, lists of disks, on which every link lies once: the
    longest, then branches from where they leave, then links that close a loop.

    >>> import jaxhb
    >>> topology = jaxhb.load_scene("engine_with_damper").topology
    >>> lines = train_lines(topology)
    >>> [[topology.disk_names[disk] for disk in way] for way in lines][2:]
    [['idler', 'cam gear', 'camshaft'], ['hub', 'viscous damper']]
    """
    in_tree = ways(joined(topology, range(len(topology.link_ends))), 0)
    closing = [list(topology.link_ends[link]) for link in span(topology).loops.tolist()]
    return in_tree + closing

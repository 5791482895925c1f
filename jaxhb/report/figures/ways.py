"""Ways through the disks of a train along its links, as one would draw it: the longest,
then branches.
"""

from jaxhb.train.chain import span
from jaxhb.train.connections import breadth_first, neighbours


def joined(topology, links):
    """Neighbours of every disk by some links of the train, without those that close a
    loop: (other, link).
    """
    every = range(len(topology.link_ends))
    return neighbours(
        topology.link_ends,
        topology.n_disks,
        {*every} - {*links} | {*span(topology).loops.tolist()},
    )


def ways(near, start, *, through=False):
    """Ways through the disks that hang on ``start``, on which every link lies once: the
    longest, or the longest from ``start`` if it has to lie on the first; then branches,
    each from a disk of an earlier way.
    """
    first = _longest(
        near, _longest(near, start)[-1]
    )  # in a tree what is farthest from any is an end of a longest way
    if through and start not in first:
        first = _longest(near, start)
    # As the scene runs, whichever end the search began at.
    found = [first if first[0] < first[-1] else first[::-1]]
    placed = set(first)
    for way in found:
        for disk in way:
            while branches := [
                _longest(near, other, placed)
                for other, _ in near[disk]
                if other not in placed
            ]:
                found.append([disk, *max(branches, key=len)])
                placed.update(found[-1])
    return found


def _longest(near, start, taken=()):
    """Disks from ``start`` to the one farthest from it, without those taken."""
    free = [[pair for pair in pairs if pair[0] not in taken] for pairs in near]
    outward = breadth_first(free, start)
    before = {disk: other for disk, other, _ in outward}
    path = [outward[-1][0]]
    while path[-1] != start:
        path.append(before[path[-1]])
    return path[::-1]


def train_lines(topology):
    """Ways along the train, lists of disks, on which every link lies once: the longest,
    then branches from where they leave, then links that close a loop.

    >>> import jaxhb
    >>> topology = jaxhb.load_scene("engine_with_damper").topology
    >>> [[topology.disk_names[disk] for disk in way] for way in train_lines(topology)][
    ...     2:
    ... ]
    [['idler', 'cam gear', 'camshaft'], ['hub', 'viscous damper']]
    """
    found = ways(joined(topology, range(len(topology.link_ends))), 0)
    return found + [
        list(topology.link_ends[link]) for link in span(topology).loops.tolist()
    ]

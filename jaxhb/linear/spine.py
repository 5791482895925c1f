"""The spine of a train: its root, or the ring of its one closed loop, with all that hangs on it; host, graph only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..harmonic import chain
from ..harmonic.block_sweep import slots
from ..model.elements import SceneError


@dataclass(frozen=True)
class Parts:
    """Parts that hang on a spine of disks, eliminated in ``order`` (host): link, place and place above of each."""

    order: np.ndarray
    link: np.ndarray
    own: np.ndarray
    above: np.ndarray
    places: int
    spine: tuple
    joints: tuple


def spine_of(train):
    """The :class:`Parts` that hang on the root of a tree or on the ring of disks of the one closed loop."""
    tree = chain.span(train.topology)
    if not len(tree.loops):
        return _hang(tree, (int(tree.node[-1]),))
    if len(tree.loops) > 1:
        where = train.topology.title
        names = ", ".join(repr(train.topology.link_names[link]) for link in tree.loops)
        raise SceneError(
            f"{where}: links {names} close {len(tree.loops)} loops, and characteristic polynomials take one at most. "
            "Use natural_frequencies or linear_response."
        )
    loop = int(tree.loops[0])
    return _hang(tree, _path(tree, int(tree.end_a[loop]), int(tree.end_b[loop])), closing=loop)


def _path(tree, a, b):
    """Disks of the tree from a to b."""
    above = {int(tree.node[s]): int(tree.node[up]) for s, up in enumerate(tree.parent[:-1].tolist())}

    def climb(disk):
        way = [disk]
        while way[-1] in above:
            way.append(above[way[-1]])
        return way

    up, down = climb(a), climb(b)
    met = next(disk for disk in up if disk in set(down))
    return (*up[: up.index(met) + 1], *reversed(down[: down.index(met)]))


def _hang(tree, spine, closing=None):
    """The :class:`Parts` of a tree that hang on the disks ``spine``, joined in a row and by the link ``closing``."""
    at = [[] for _ in tree.node]
    for s, up in enumerate(tree.parent[:-1].tolist()):
        disk, other, link = int(tree.node[s]), int(tree.node[up]), int(tree.link[s])
        at[disk].append((other, link))
        at[other].append((disk, link))
    seen, outward = set(spine), [(disk, -1, -1) for disk in spine]
    for disk, _, _ in outward:
        for other, link in at[disk]:
            if other not in seen:
                seen.add(other)
                outward.append((other, disk, link))
    hanging = outward[: len(spine) - 1 : -1]
    position = {disk: s for s, (disk, *_) in enumerate([*hanging, *((disk,) for disk in spine)])}
    parent = np.array([position[up] for _, up, _ in hanging], dtype=np.int32)
    held = slots([*np.where(parent < len(hanging), parent, len(hanging)), len(hanging)])
    places = len(held.every)
    onto = [up >= len(hanging) for up in parent]
    above = np.where(onto, places + parent - len(hanging), held.above[:-1])
    links = {frozenset((a, b)): link for a, pairs in enumerate(at) for b, link in pairs}
    joints = [links[frozenset(pair)] for pair in zip(spine, spine[1:], strict=False)]
    return Parts(
        order=np.array([disk for disk, *_ in hanging], dtype=np.int32),
        link=np.array([link for *_, link in hanging], dtype=np.int32),
        own=held.own[:-1],
        above=above.astype(np.int32),
        places=places + len(spine),
        spine=tuple(spine),
        joints=(*joints, *(() if closing is None else (closing,))),
    )


def ways_between(tree, a, b):
    """Ways from disk a to b as (disks, links): one, and where the closed loop allows it the other way round it."""
    at = {
        frozenset((int(tree.node[s]), int(tree.node[up]))): int(tree.link[s]) for s, up in enumerate(tree.parent[:-1])
    }

    def way(*disks):
        return disks, [at[frozenset(pair)] for pair in zip(disks, disks[1:], strict=False)]

    ways = [way(*_path(tree, a, b))]
    for loop in tree.loops.tolist():
        x, y = int(tree.end_a[loop]), int(tree.end_b[loop])
        for near, far in ((x, y), (y, x)):
            (there, before), (back, behind) = way(*_path(tree, a, near)), way(*_path(tree, far, b))
            if not set(there) & set(back):
                ways.append(((*there, *back), [*before, loop, *behind]))
    return ways

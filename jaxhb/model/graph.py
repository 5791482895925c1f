"""How the disks hang together: pieces, rotors, speed ratios, closed loops."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

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

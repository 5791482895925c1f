"""Where everything lies in a sketch of the train: rotors as horizontal lines of disks, gears in mesh touching.

Lengths are in units of a shaft between two small disks. The longest line of the reference rotor comes first; branches
of shafts and rotors in mesh are put where they hit nothing, tried above and below, to the left and to the right. Pitch
circles have the sizes of the gears to one another; disks are drawn as if all had one thickness and density, their
radius growing with the fourth root of the inertia.
"""

import itertools
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from jaxhb.train.chain import span

DISK, LEAST, MASSLESS = 0.42, 0.12, 0.07
"""Radius of the largest disk, of the smallest with inertia, and of one without."""
GEAR, RIM = 1.4, 0.32
"""Pitch radius of the largest gear, and of any at least beyond its disk."""
LETTER, LINE = 0.155, 0.3
"""Width of a letter and height of a line of text."""
GAP = 0.5
"""Least length of a shaft that can be seen between two disks."""
APART = 0.06
"""Least distance between things that do not touch."""
ANGLES = (-90, 90, 0, 180, -45, -135, -30, -150, -60, -120, -15, -165, -75, -105, 45, 135, 30, 150, 60, 120)
"""Directions from a gear to one in mesh with it, deg, as they are tried."""
REACH, SLANTS = 12, (0.0, 1.0, -1.0, 2.0, -2.0)
"""Distances at which a branch is tried, and how far to the side."""


@dataclass
class Layout:
    """Places of the parts of a train, made by :func:`layout`.

    x, y : ``(S,)``; disk, pitch : ``(S,)`` radii, pitch 0 of disks that are no gears; names : disk -> (x, y, text,
    whether it is upright), centres of texts; touching : links whose pitch circles touch; low, high : ``(2,)`` corners
    """

    x: np.ndarray
    y: np.ndarray
    disk: np.ndarray
    pitch: np.ndarray
    names: dict = field(default_factory=dict)
    touching: set = field(default_factory=set)
    low: np.ndarray | None = None
    high: np.ndarray | None = None


def layout(train, named=True):
    """Places of disks, gears and names.

    Parameters
    ----------
    train : DriveTrain
    named : bool
        Whether names need room.

    Returns
    -------
    Layout

    Examples
    --------
    Two gears touch: the distance of their centres is the sum of their pitch radii.

    >>> import jaxhb
    >>> found = layout(jaxhb.load_scene("spur_pair"))
    >>> found.x.round(6).tolist(), bool(np.isclose(np.ptp(found.y), found.pitch.sum()))
    ([0.0, 0.0], True)
    """
    return _Placing(train, named).run()


def disk_radii(train):
    """Drawn radii ``(S,)`` of the disks and ``(S,)`` of the pitch circles, 0 where there is none."""
    inertia = np.concatenate([np.asarray(train.disks.inertia, float), np.asarray(train.dampers.inertia, float)])
    share = (inertia / (inertia.max(initial=0.0) or 1.0)) ** 0.25
    disk = np.where(inertia > 0, np.maximum(DISK * share, LEAST), MASSLESS)
    pitch = np.zeros(len(inertia))
    gears = sorted({gear for ends in train.topology.mesh_ends for gear in ends})
    radius = np.asarray(train.disks.radius, float)[gears]
    if gears:
        pitch[gears] = np.maximum(GEAR * radius / radius.max(), disk[gears] + RIM)
    return disk, pitch


def longest_way(near, start, taken=()):
    """Disks from ``start`` to the one farthest from it, without those taken; ``near``: neighbours of each."""
    above, way = {start: None}, [start]
    for disk in way:
        for other in near[disk]:
            if other not in above and other not in taken:
                above[other] = disk
                way.append(other)
    path, disk = [], way[-1]
    while disk is not None:
        path.append(disk)
        disk = above[disk]
    return path[::-1]


class _Placing:
    """A layout in the making."""

    def __init__(self, train, named):
        self.topology = topology = train.topology
        disk, pitch = disk_radii(train)
        size = len(disk)
        self.found = Layout(np.full(size, np.nan), np.zeros(size), disk, pitch)
        self.named = named
        self.boxes, self.circles = [], []  # (left, low, right, high) and (x, y, radius) of what is placed
        first_mesh = len(topology.link_names) - len(topology.mesh_names)
        loops = span(topology).loops.tolist()
        self.near, self.meshes = ([[] for _ in range(size)] for _ in range(2))  # neighbours by shafts; and mates
        for link, (a, b) in enumerate(topology.link_ends):
            if link in loops:
                continue
            for one, other in ((a, b), (b, a)):
                if link < first_mesh:
                    self.near[one].append(other)
                else:
                    self.meshes[one].append((other, link))

    def run(self):
        """The layout, rotor by rotor from the reference rotor on."""
        near, start = self.near, self.topology.rotor.index(self.topology.reference_rotor)
        # In a tree the disk farthest from any other is an end of a longest way.
        way = longest_way(near, longest_way(near, start)[-1])
        way = way if way[0] < way[-1] else way[::-1]
        self._take(self._line(way, 0, (0.0, 0.0), 1, 1))
        rotors = deque([way])
        while rotors:
            ways = [rotors.popleft()]
            for way in ways:
                for disk in way:
                    while branches := [
                        longest_way(near, other, self._placed()) for other in near[disk] if other not in self._placed()
                    ]:
                        ways.append(max(branches, key=len))
                        self._branch(disk, ways[-1])
            for gear, other, link in [(d, *pair) for way in ways for d in way for pair in self.meshes[d]]:
                if other not in self._placed():
                    whole = longest_way(near, longest_way(near, other)[-1])
                    line = whole if other in whole else longest_way(near, other)
                    self._mesh(gear, other, link, line)
                    rotors.append(line)
        corners = np.array([*self.boxes, *((x - r, y - r, x + r, y + r) for x, y, r in self.circles)])
        self.found.low, self.found.high = corners[:, :2].min(0), corners[:, 2:].max(0)
        return self.found

    def _placed(self):
        return {int(disk) for disk in np.flatnonzero(~np.isnan(self.found.x))}

    def _half(self, disk):
        """Half the width that a disk takes in its line."""
        gear = self.found.pitch[disk]
        wide = len(self.topology.disk_names[disk]) * LETTER / 2 if gear and self.named else LINE / 2
        return max(self.found.disk[disk], gear, wide)

    def _line(self, way, anchor, at, direction, side):
        """A line of disks whose number ``anchor`` lies at a place: disk -> (x, y), shapes, and names.

        direction : 1 to the right, -1 to the left; side : -1 with names below, 1 above
        """
        steps = [self._half(a) + self._half(b) + GAP for a, b in zip(way, way[1:], strict=False)]
        along = np.concatenate([[0.0], np.cumsum(steps)])
        x = at[0] + direction * (along - along[anchor])
        places = {disk: (float(place), at[1]) for disk, place in zip(way, x, strict=True)}
        boxes = [(min(a, b), at[1] - APART, max(a, b), at[1] + APART) for a, b in zip(x, x[1:], strict=False)]
        circles = [(*places[disk], max(self.found.disk[disk], self.found.pitch[disk])) for disk in way]
        names = {}
        for disk in way if self.named else ():
            text = self.topology.disk_names[disk]
            gear, length = self.found.pitch[disk] > 0, len(text) * LETTER
            out = self.found.disk[disk] + (LINE / 2 + 0.03 if gear else length / 2 + 0.08)
            where = (places[disk][0], at[1] + side * out)
            names[disk] = (*where, text, not gear)
            across, up = (length, LINE) if gear else (LINE, length)
            if not gear or across > 1.6 * self.found.pitch[disk]:
                boxes.append((where[0] - across / 2, where[1] - up / 2, where[0] + across / 2, where[1] + up / 2))
        return places, boxes, circles, names

    def _take(self, line, extra=()):
        places, boxes, circles, names = line
        for disk, (x, y) in places.items():
            self.found.x[disk], self.found.y[disk] = x, y
        self.boxes += [*boxes, *extra]
        self.circles += circles
        self.found.names |= names

    def _free(self, line, extra=(), but=()):
        """Whether a line hits nothing that is placed; ``but``: circles it may touch."""
        _, boxes, circles, _ = line
        others = [circle for circle in self.circles if circle not in but]
        return not (
            any(_overlap(a, b) for a in (*boxes, *extra) for b in self.boxes)
            or any(_hit(circle, box) for circle in others for box in (*boxes, *extra))
            or any(_hit(circle, box) for circle in circles for box in self.boxes)
            or any(_near(a, b, -APART if b in but else APART) for a in circles for b in self.circles)
            or any(_hit(circle, box) for circle in but for box in boxes)
        )

    def _branch(self, disk, way):
        """Put a branch of shafts below or above its disk, straight or slanting, as near as it goes."""
        x, y = float(self.found.x[disk]), float(self.found.y[disk])
        own = (x, y, max(self.found.disk[disk], self.found.pitch[disk]))
        least = own[2] + max(self.found.disk[way[0]], self.found.pitch[way[0]]) + GAP
        for away, side, slant in itertools.product(range(REACH), (-1, 1), SLANTS):
            at = (x + slant, y + side * (least + 0.5 * away))
            link = _segment((x, y), at, own[2] + 0.2)
            for direction in (1, -1):
                line = self._line(way, 0, at, direction, side)
                if self._free(line, link, (own,)):
                    self._take(line, link)
                    return
        self._take(self._line(way, 0, (x, self._lowest(way)), 1, -1))

    def _lowest(self, way):
        """Where a line lies below everything."""
        lowest = min([*(box[1] for box in self.boxes), *(y - r for _, y, r in self.circles)])
        return lowest - 0.6 - max(*self.found.disk[way], *self.found.pitch[way])

    def _mesh(self, gear, other, link, way):
        """Put the line of a gear so that it touches its mate, or if nothing is free below everything."""
        x, y = float(self.found.x[gear]), float(self.found.y[gear])
        own, reach = (x, y, self.found.pitch[gear]), self.found.pitch[gear] + self.found.pitch[other]
        anchor = way.index(other)
        for angle in np.deg2rad(ANGLES):
            at = (x + reach * float(np.cos(angle).round(12)), y + reach * float(np.sin(angle).round(12)))
            for direction in (1, -1):
                line = self._line(way, anchor, at, direction, 1 if np.sin(angle) > 0.1 else -1)
                if self._free(line, (), (own,)):
                    self._take(line)
                    self.found.touching.add(link)
                    return
        self._take(self._line(way, anchor, (x, self._lowest(way)), 1, -1))


def _segment(a, b, start):
    """Small boxes along a straight link, from a distance on."""
    length = float(np.hypot(b[0] - a[0], b[1] - a[1]))
    shares = np.linspace(start / length, 1.0, max(2, int(length / 0.1)))[:, None]
    points = np.array(a) * (1 - shares) + np.array(b) * shares
    return [(px - APART, py - APART, px + APART, py + APART) for px, py in points.tolist()]


def _overlap(a, b):
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _near(a, b, apart):
    return np.hypot(a[0] - b[0], a[1] - b[1]) < a[2] + b[2] + apart


def _hit(circle, box):
    x, y, r = circle
    dx, dy = max(box[0] - x, 0.0, x - box[2]), max(box[1] - y, 0.0, y - box[3])
    return dx * dx + dy * dy < (r + APART) ** 2

"""Where everything lies in a sketch of the train: rotors as horizontal lines of disks,
gears in mesh touching.

Lengths are in units of a shaft between two small disks. The longest line of the
reference rotor comes first; branches of shafts and rotors in mesh are put where they
hit nothing, tried above and below, to the left and to the right. Whatever takes room is
a row of circles.
"""

import itertools

import numpy as np

from jaxhb.report.figures.ways import joined, ways

DISK, LEAST, MASSLESS = (
    0.42,
    0.12,
    0.07,
)  # radius of the largest disk, of the smallest with inertia, and of one without
GEAR, RIM = (
    1.4,
    0.32,
)  # pitch radius of the largest gear, and of any at least beyond its disk
LETTER, LINE = 0.155, 0.3  # width of a letter and height of a line of text
GAP = 0.5  # least length of a shaft that can be seen between two disks
APART = 0.06  # least distance between things that do not touch
ANGLES = (
    -90,
    90,
    0,
    180,
    -45,
    -135,
    -30,
    -150,
    -60,
    -120,
    -15,
    -165,
    -75,
    -105,
    45,
    135,
    30,
    150,
    60,
    120,
)
"""Directions from a gear to one in mesh with it, deg, as they are tried."""
REACH, SLANTS = (
    12,
    (0.0, 1.0, -1.0, 2.0, -2.0),
)  # distances at which a branch is tried, and how far to the side


def disk_radii(train):
    """Drawn radii ``(S,)`` of the disks, as if all had one thickness and density, and
    of the pitch circles, which have the sizes of the gears to one another; 0 where
    there is none.
    """
    inertia = np.concatenate(
        [
            np.asarray(train.disks.inertia, float),
            np.asarray(train.dampers.inertia, float),
        ]
    )
    share = (inertia / (inertia.max(initial=0.0) or 1.0)) ** 0.25
    disk = np.where(inertia > 0, np.maximum(DISK * share, LEAST), MASSLESS)
    pitch = np.zeros(len(inertia))
    gears = sorted({gear for ends in train.topology.mesh_ends for gear in ends})
    radius = np.asarray(train.disks.radius, float)[gears]
    if gears:
        pitch[gears] = np.maximum(GEAR * radius / radius.max(), disk[gears] + RIM)
    return disk, pitch


class Layout:
    """Places of the parts of a train, ``named`` with room for names.

    x, y ``(S,)``; disk, pitch ``(S,)``: radii; names: disk -> (x, y, text, whether it
    is upright), centres of texts; touching: links whose pitch circles touch; low, high
    ``(2,)``: corners
    """

    def __init__(self, train, named=True):
        self.topology = train.topology
        self.named = named
        self.disk, self.pitch = disk_radii(train)
        self.x, self.y = np.full((2, len(self.disk)), np.nan)
        self.names, self.touching = {}, set()
        self.circles = np.zeros((0, 3))  # x, y and radius of what is placed
        self._place()
        places = self.circles[:, :2]
        radii = self.circles[:, 2:]
        self.low, self.high = (places - radii).min(0), (places + radii).max(0)

    def _place(self):
        """Rotor by rotor from the reference rotor on."""
        topology = self.topology
        elastic = len(topology.link_names) - len(topology.mesh_names)
        shafts = joined(topology, range(elastic))
        mates = joined(topology, range(elastic, len(topology.link_names)))
        first = ways(shafts, topology.rotor.index(topology.reference_rotor))
        self._take(first[0], self._line(first[0], 0, (0.0, 0.0), 1, 1))
        rotors = [first]
        for rotor in rotors:
            for disk, *branch in rotor[1:]:
                self._branch(disk, branch)
            for gear in [
                disk for number, way in enumerate(rotor) for disk in way[number > 0 :]
            ]:
                for other, link in mates[gear]:
                    if np.isnan(self.x[other]):
                        rotors.append(ways(shafts, other, through=True))
                        if self._mesh(gear, other, rotors[-1][0]):
                            self.touching.add(link)

    def _line(self, way, anchor, at, direction, side):
        """A line of disks, that with the number ``anchor`` at a place: the others' x,
        the line's y, names, and circles, first those of the disks.

        direction : 1 to the right, -1 to the left; side : -1 with names below, 1 above
        """
        text = [self.topology.disk_names[disk] for disk in way]
        disk = self.disk[way]
        pitch = self.pitch[way]
        length = LETTER * np.array([len(name) for name in text]) * self.named
        gear = pitch > 0
        half = np.maximum.reduce([disk, pitch, np.where(gear, length, LINE) / 2])
        along = np.concatenate([[0.0], np.cumsum(half[:-1] + half[1:] + GAP)])
        x = at[0] + direction * (along - along[anchor])
        y = at[1]
        circles = [
            np.column_stack([x, np.full(len(way), y), np.maximum(disk, pitch)]),
            _row((x[0], y), (x[-1], y)),
        ]
        names = {}
        above = y + side * (disk + np.where(gear, LINE / 2 + 0.03, length / 2 + 0.08))
        for k in range(len(way)) if self.named else ():
            names[way[k]] = (float(x[k]), float(above[k]), text[k], not gear[k])
            ends = np.outer(
                (-0.5, 0.5), np.where(gear[k], (1.0, 0.0), (0.0, 1.0))
            ) * max(length[k] - LINE, 0.0)
            circles.append(_row(*(ends + (x[k], above[k])), LINE / 2))
        return x, y, names, np.concatenate(circles)

    def _take(self, way, line):
        self.x[way], self.y[way], names, circles = line
        self.names |= names
        self.circles = np.concatenate([self.circles, circles])

    def _branch(self, disk, way):
        """Put a branch of shafts below or above its disk, straight or slanting, as near
        as it goes.
        """
        start = np.array([self.x[disk], self.y[disk]])
        both = np.maximum(self.disk, self.pitch)
        places = []
        for away, side, slant in itertools.product(range(REACH), (-1, 1), SLANTS):
            link = np.array(
                [slant, side * (both[disk] + both[way[0]] + GAP + 0.5 * away)]
            )
            places.append(
                (
                    start + link,
                    side,
                    _row(
                        start + link * (both[disk] + 0.2) / np.hypot(*link),
                        start + link,
                    ),
                )
            )
        self._put(way, 0, places)

    def _mesh(self, gear, other, way):
        """Put the line of a gear so that it touches its mate; whether there is room."""
        centre = np.array([self.x[gear], self.y[gear]])
        reach = self.pitch[gear] + self.pitch[other]
        own = np.argmax((self.circles == (*centre, self.pitch[gear])).all(axis=1))
        around = np.round(
            [(np.cos(angle), np.sin(angle)) for angle in np.deg2rad(ANGLES)], 12
        )
        places = [
            (centre + reach * way, 1 if way[1] > 0.1 else -1, np.zeros((0, 3)))
            for way in around
        ]
        return self._put(way, way.index(other), places, (way.index(other), own))

    def _put(self, way, anchor, places, touching=None):
        """Put a line of disks at the first of some places, each with a side for names
        and the circles of a link to it, where it hits nothing but the circle that it
        may touch, else below everything; whether one was free.
        """
        for (at, side, link), direction in itertools.product(places, (1, -1)):
            *line, circles = self._line(way, anchor, at, direction, side)
            circles = np.concatenate([circles, link])
            gaps = np.hypot(
                *(circles[:, None, :2] - self.circles[:, :2]).transpose(2, 0, 1)
            )
            gaps -= circles[:, None, 2] + self.circles[:, 2]
            if touching is not None:
                gaps[touching] = np.inf
            if (gaps > APART).all():
                self._take(way, (*line, circles))
                return True
        below = (
            (self.circles[:, 1] - self.circles[:, 2]).min()
            - 0.6
            - max(*self.disk[way], *self.pitch[way])
        )
        self._take(way, self._line(way, anchor, (places[0][0][0], below), 1, -1))
        return False


def _row(start, end, radius=APART):
    """Circles in a row from one point to another, near enough to leave no gap."""
    length = np.hypot(end[0] - start[0], end[1] - start[1])
    points = np.linspace(start, end, 2 + int(length / max(radius, 0.1)))
    return np.column_stack([points, np.full(len(points), radius)])

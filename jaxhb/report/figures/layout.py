"""Layout of a sketch of the train: rotors as horizontal lines of disks, gears in mesh
touching.

Lengths are in units of a shaft between two small disks. The longest line of the
reference rotor comes first; branches of shafts and rotors in mesh are put where they
hit nothing, tried above and below, to the left and to the right. Whatever takes room is
a row of circles.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxhb.report.figures.ways import joined, ways
from jaxhb.train.drivetrain import DriveTrain

# Radius of the largest disk, of the smallest with inertia, and of one without
DISK = 0.42
LEAST = 0.12
MASSLESS = 0.07
# Pitch radius of the largest gear, and of any at least beyond its disk
GEAR = 1.4
RIM = 0.32
# Width of a letter and height of a line of text
LETTER = 0.155
LINE = 0.3
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
# Distances at which a branch is tried, and how far to the side
REACH = 12
SLANTS = (0.0, 1.0, -1.0, 2.0, -2.0)


def disk_radii(train: DriveTrain) -> tuple[np.ndarray, np.ndarray]:
    """Return drawn radii ``(S,)`` of the disks, as if all had one thickness and
    density, and of the pitch circles, in proportion to one another; 0 where there is
    none.
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


class _Line(NamedTuple):
    """A horizontal line of n disks.

    x ``(n,)``, y : places; names : disk -> (x, y, text, whether it is upright); circles
    ``(c, 3)`` : x, y and radius of all that takes room, first those of the disks
    """

    x: np.ndarray
    y: float
    names: dict[int, tuple[float, float, str, bool]]
    circles: np.ndarray


class Layout:
    """Places of the parts of a train, ``named`` with room for names.

    x, y ``(S,)``; disk, pitch ``(S,)``: radii; names: disk -> (x, y, text, whether it
    is upright), centres of texts; touching: links whose pitch circles touch; low, high
    ``(2,)``: corners
    """

    def __init__(self, train: DriveTrain, named: bool = True):
        self.topology = train.topology
        self.named = named
        self.disk, self.pitch = disk_radii(train)
        self.x = np.full(len(self.disk), np.nan)
        self.y = np.full(len(self.disk), np.nan)
        self.names: dict[int, tuple[float, float, str, bool]] = {}
        self.touching: set[int] = set()
        self.circles = np.zeros((0, 3))  # x, y and radius of what is placed
        self._place()
        places = self.circles[:, :2]
        radii = self.circles[:, 2:]
        self.low = (places - radii).min(0)
        self.high = (places + radii).max(0)

    def _place(self) -> None:
        """Place rotor by rotor from the reference rotor on."""
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
            # Every branch begins with a disk of an earlier way.
            gears = [
                disk for number, way in enumerate(rotor) for disk in way[number > 0 :]
            ]
            for gear in gears:
                for mate, link in mates[gear]:
                    if np.isnan(self.x[mate]):
                        rotors.append(ways(shafts, mate, through=True))
                        if self._mesh(gear, mate, rotors[-1][0]):
                            self.touching.add(link)

    def _line(
        self,
        way: list[int],
        anchor: int,
        point: Sequence[float] | np.ndarray,
        direction: int,
        side: int,
    ) -> _Line:
        """Make a line of disks, that with the number ``anchor`` at a point ``(2,)``.

        direction : 1 to the right, -1 to the left; side : -1 with names below, 1 above
        """
        text = [self.topology.disk_names[disk] for disk in way]
        disk = self.disk[way]
        pitch = self.pitch[way]
        length = LETTER * np.array([len(name) for name in text]) * self.named
        gear = pitch > 0
        half = np.maximum.reduce([disk, pitch, np.where(gear, length, LINE) / 2])
        along = np.concatenate([[0.0], np.cumsum(half[:-1] + half[1:] + GAP)])
        x = point[0] + direction * (along - along[anchor])
        y = point[1]
        circles = [
            np.column_stack([x, np.full(len(way), y), np.maximum(disk, pitch)]),
            _row((x[0], y), (x[-1], y)),
        ]
        names = {}
        above = y + side * (disk + np.where(gear, LINE / 2 + 0.03, length / 2 + 0.08))
        for k in range(len(way)) if self.named else ():
            names[way[k]] = (float(x[k]), float(above[k]), text[k], not gear[k])
            reading = np.where(gear[k], (1.0, 0.0), (0.0, 1.0))
            ends = np.outer((-0.5, 0.5), reading) * max(length[k] - LINE, 0.0)
            start, end = ends + (x[k], above[k])
            circles.append(_row(start, end, LINE / 2))
        return _Line(x, y, names, np.concatenate(circles))

    def _take(self, way: list[int], line: _Line) -> None:
        """Put a line of disks where it is."""
        self.x[way] = line.x
        self.y[way] = line.y
        self.names |= line.names
        self.circles = np.concatenate([self.circles, line.circles])

    def _branch(self, disk: int, way: list[int]) -> None:
        """Put a branch of shafts below or above its disk, straight or slanting, as near
        as it goes.
        """
        start = np.array([self.x[disk], self.y[disk]])
        radius = np.maximum(self.disk, self.pitch)
        places = []
        for away, side, slant in itertools.product(range(REACH), (-1, 1), SLANTS):
            rise = radius[disk] + radius[way[0]] + GAP + 0.5 * away
            link = np.array([slant, side * rise])
            edge = start + link * (radius[disk] + 0.2) / np.hypot(link[0], link[1])
            places.append((start + link, side, _row(edge, start + link)))
        self._put(way, 0, places)

    def _mesh(self, gear: int, mate: int, way: list[int]) -> bool:
        """Put the line of a gear so that it touches its mate; return whether there is
        room.
        """
        centre = np.array([self.x[gear], self.y[gear]])
        reach = self.pitch[gear] + self.pitch[mate]
        gear_circle = np.array([*centre, self.pitch[gear]])
        touched = int(np.argmax((self.circles == gear_circle).all(axis=1)))
        around = np.round(
            [(np.cos(angle), np.sin(angle)) for angle in np.deg2rad(ANGLES)], 12
        )
        places = [
            (
                centre + reach * direction,
                1 if direction[1] > 0.1 else -1,
                np.zeros((0, 3)),
            )
            for direction in around
        ]
        return self._put(way, way.index(mate), places, (way.index(mate), touched))

    def _put(
        self,
        way: list[int],
        anchor: int,
        places: Sequence[tuple[np.ndarray, int, np.ndarray]],
        touching: tuple[int, int] | None = None,
    ) -> bool:
        """Put a line of disks at the first of some places, each with a side for names
        and the circles ``(c, 3)`` of a link to it, where it hits nothing but the circle
        that it may touch, else below everything; return whether one was free.

        touching : number of the circle of the line that may touch, and of the circle
        placed that it may touch
        """
        for (point, side, link), direction in itertools.product(places, (1, -1)):
            line = self._line(way, anchor, point, direction, side)
            line = line._replace(circles=np.concatenate([line.circles, link]))
            apart = line.circles[:, None, :2] - self.circles[:, :2]
            gaps = np.hypot(apart[..., 0], apart[..., 1])
            gaps -= line.circles[:, None, 2] + self.circles[:, 2]
            if touching is not None:
                gaps[touching] = np.inf
            if (gaps > APART).all():
                self._take(way, line)
                return True
        lowest = (self.circles[:, 1] - self.circles[:, 2]).min()
        below = lowest - 0.6 - max(self.disk[way].max(), self.pitch[way].max())
        self._take(way, self._line(way, anchor, (places[0][0][0], below), 1, -1))
        return False


def _row(
    start: Sequence[float] | np.ndarray,
    end: Sequence[float] | np.ndarray,
    radius: float = APART,
) -> np.ndarray:
    """Make circles ``(c, 3)`` in a row from one point to another, near enough to leave
    no gap.
    """
    length = np.hypot(end[0] - start[0], end[1] - start[1])
    points = np.linspace(start, end, 2 + int(length / max(radius, 0.1)))
    return np.column_stack([points, np.full(len(points), radius)])

"""The equivalent system as SVG: masses with their inertias, links with their
stiffnesses, written so that no two texts share a place.

Ways through the train (:func:`~jaxhb.report.figures.ways.train_lines`) stand one behind
the other, a seat for each disk, in strips as wide as a page. Each kind of text has a
height of its own in a strip, and as much width as two disks are apart: longer names
take two lines, and what is longer still is squeezed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from jaxhb.report.figures.figure import BAND, WIDTH
from jaxhb.report.figures.lettering import width_of
from jaxhb.report.figures.sketch import TORQUE
from jaxhb.report.figures.ways import train_lines
from jaxhb.report.text.columns import plain_number
from jaxhb.report.text.scene_check import at_own_speed
from jaxhb.train.connections import neighbours
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import excited_disks
from jaxhb.train.kinematics import Referred, referred

IN_STRIP = 10  # disks
FIRST = 32.0
STEP = 66.0
"""Pixels from the left to the first disk of a strip, and between two."""

ROOM = STEP - 4.0  # pixels for a text
LONGEST = 22  # letters of a text, of which longer ones are cut
NAME = 18.0
ABOVE_NAME = 9.0
STIFFNESS = 33.0
LINE = 52.0
DAMPING = 69.0
INERTIA = 79.0
GROUND = 89.0
HEIGHT = 96.0
"""Pixels from the top of a strip to each kind of text, the first of two lines of a name
before the other, to the line, and to its end.
"""

RADII = 3.5, 11.0  # pixels of the smallest and the largest disk
SIZE = 8.4  # pixels of a letter
LARGE = 1e6  # N m/rad, median of shafts from which MN m/rad are shown


@dataclass(frozen=True)
class Equivalent:
    """The equivalent system: ``strips`` of SVG, and the ``caption`` with the units of
    the numbers in them.
    """

    caption: str
    strips: list[str]


def equivalent_system(train: DriveTrain) -> Equivalent:
    """Draw the equivalent system of a train, its numbers not referred.

    >>> import jaxhb
    >>> drawn = equivalent_system(jaxhb.load_scene("spur_pair"))
    >>> len(drawn.strips), "kg m2" in drawn.caption
    (1, True)
    """
    train = at_own_speed(train)
    numbers = referred(train)
    topology = train.topology
    links = len(topology.shaft_names) + len(topology.damper_names)
    stiffness = np.asarray(numbers.stiffness, float)[:links]
    large = bool(len(stiffness)) and np.median(stiffness) >= LARGE
    unit = "MN m/rad" if large else "kN m/rad"
    above = f"above the links stiffnesses, in {unit}"
    if topology.mesh_names:
        above += ", of meshes (two bars) in MN/m"
    parts = ["inertias in kg m2 below the disks", above]
    if topology.damper_names:
        parts.append("below dampers damping in N m s/rad; white: ring of a damper")
    if topology.ground_names:
        parts.append(f"springs to ground in {unit}")
    if not np.all(numbers.factor == 1):
        parts.append("i: speed over that of the reference rotor")
    parts.append("dark: a torque acts; cross: load")
    lines = train_lines(topology)
    parts += ["dashed: where a branch leaves"] * (len(lines) > 1)
    pen = _Pen(train, numbers, 1e-6 if large else 1e-3)
    seats = _seats(lines)
    strips = [
        pen.strip(seats[start : start + IN_STRIP])
        for start in range(0, len(seats), IN_STRIP)
    ]
    return Equivalent(f"Equivalent system: {'; '.join(parts)}", strips)


@dataclass(frozen=True)
class Seat:
    """A place in a strip: its disk, None where nothing stands, the disks before and
    behind it on its line, and whether it stands on an earlier line, too.
    """

    disk: int | None = None
    before: int | None = None
    behind: int | None = None
    again: bool = False


def _seats(lines: Sequence[Sequence[int]]) -> list[Seat]:
    """Put lines of disks one behind the other, with a free seat between two.

    >>> [seat.disk for seat in _seats([[0, 1], [1, 2]])]
    [0, 1, None, 1, 2]
    """
    seats: list[Seat] = []
    for number, way in enumerate(lines):
        if number:
            seats.append(Seat())
        others = [None, *way, None]
        seats += [
            Seat(disk, others[k], others[k + 2], again=number > 0 and k == 0)
            for k, disk in enumerate(way)
        ]
    return seats


class _Pen:
    """Draws strips of one train; ``scale`` leads from N m/rad to the unit shown."""

    def __init__(self, train: DriveTrain, numbers: Referred, scale: float):
        topology = train.topology
        self.topology = topology
        self.numbers = numbers
        self.scale = scale
        self.near = neighbours(topology.link_ends, topology.n_disks)
        self.excited = {*excited_disks(topology)}
        self.loaded = {*topology.load_disk}
        inertia = np.asarray(numbers.inertia, float)
        share = (inertia / (inertia.max(initial=0.0) or 1.0)) ** 0.25
        self.radius = np.maximum(RADII[1] * share, RADII[0])
        self.ground = np.zeros(topology.n_disks)
        np.add.at(
            self.ground,
            np.array(topology.ground_disk, dtype=int),
            np.asarray(train.grounds.stiffness, float),
        )

    def strip(self, seats: Sequence[Seat]) -> str:
        """Draw some seats from left to right, links first: disks lie on them."""
        parts = []
        for place, seat in enumerate(seats):
            if seat.disk is None:
                continue
            if place == 0 and seat.before is not None:
                parts.append(self._link(seat.before, seat.disk, -1))
            if seat.behind is not None:
                parts.append(self._link(seat.disk, seat.behind, place))
        for place, seat in enumerate(seats):
            if seat.disk is not None:
                parts.append(self._disk(seat.disk, place, again=seat.again))
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH - 4}"'
            f' height="{HEIGHT:g}" viewBox="0 0 {WIDTH - 4} {HEIGHT:g}"'
            f' font-family="Arial, Helvetica, sans-serif" font-size="{SIZE}">'
            f"{''.join(parts)}</svg>"
        )

    def _disk(self, disk: int, place: int, *, again: bool) -> str:
        """Draw a disk with its name and inertia; ``again`` where it hangs on another
        line.
        """
        x = FIRST + STEP * place
        name = self.topology.disk_names[disk]
        ring = disk >= self.topology.n_scene_disks
        fill = "white" if ring else TORQUE if disk in self.excited else BAND
        look = ' stroke-dasharray="2 2"' if again else ""
        parts = [
            f'<circle cx="{x:g}" cy="{LINE:g}" r="{self.radius[disk]:.1f}"'
            f' fill="{"white" if again else fill}" stroke="black"{look}/>',
            *(
                _text(line, x, height, ' class="name"')
                for line, height in zip(
                    reversed(name_lines(f"({name})" if again else name)),
                    (NAME, ABOVE_NAME),
                    strict=False,
                )
            ),
        ]
        if again:
            return "".join(parts)
        if disk in self.loaded:
            parts.append(
                f'<path d="M{x - 3:g} {LINE - 3:g}l6 6m0 -6l-6 6" stroke="black"/>'
            )
        parts.append(_text(plain_number(float(self.numbers.inertia[disk])), x, INERTIA))
        parts += self._below(disk, x)
        return "".join(parts)

    def _below(self, disk: int, x: float) -> Iterator[str]:
        """Write the speed ratio of a disk, and draw the spring to ground."""
        ratio = float(self.numbers.factor[disk])
        words = [] if ratio == 1 else [f"i {plain_number(ratio)}"]
        if disk in self.topology.ground_disk:
            words.append(f"ground {plain_number(self.scale * self.ground[disk], 3)}")
            y = LINE + self.radius[disk]
            yield (
                f'<path d="M{x:g} {y:.1f}v3m-6 0h12m-10 2h8m-6 2h4" stroke="black"'
                ' fill="none"/>'
            )
        if words:
            yield _text(", ".join(words), x, GROUND)

    def _link(self, a: int, b: int, place: int) -> str:
        """Draw the link right of a place, with its stiffness; of place -1 the end of a
        link that stands in the strip before.
        """
        named = place >= 0
        (link,) = [link for other, link in self.near[a] if other == b][:1]
        topology = self.topology
        shafts = len(topology.shaft_names)
        dampers = shafts + len(topology.damper_names)
        left = FIRST + STEP * place if named else 0.0
        right = min(FIRST + STEP * (place + 1), WIDTH - 4.0)
        middle = FIRST + STEP * (place + 0.5)
        damper = shafts <= link < dampers
        look = ' stroke-dasharray="3 2"' if damper else ""
        width = 2.2 if link < shafts else 1.4
        parts = [
            f'<path d="M{left:g} {LINE:g}H{right:g}" stroke="black"'
            f' stroke-width="{width}"{look}/>'
        ]
        mesh = link >= dampers
        if mesh and named:
            parts.append(
                f'<path d="M{middle - 2:g} {LINE - 8:g}v16m4 0v-16" stroke="black"'
                ' stroke-width="1.6"/>'
            )
        if named:
            scale = 1e-6 if mesh else self.scale
            stiffness = scale * float(self.numbers.stiffness[link])
            parts.append(_text(plain_number(stiffness), middle, STIFFNESS))
        if named and damper:
            damping = plain_number(float(self.numbers.damping[link]))
            parts.append(_text(damping, middle, DAMPING))
        return "".join(parts)


def name_lines(name: str) -> list[str]:
    """Break a name into the lines that a strip has of it: one, or two where it is long,
    each as short as can be.

    >>> name_lines("propeller shaft flange")
    ['propeller', 'shaft flange']
    """
    lines = [name]
    breaks = [place for place, letter in enumerate(name) if letter == " "]
    if width_of(name, SIZE) > ROOM and breaks:
        place = min(
            breaks,
            key=lambda at: max(width_of(name[:at], SIZE), width_of(name[at:], SIZE)),
        )
        lines = [name[:place], name[place + 1 :]]
    return [
        line if len(line) <= LONGEST else f"{line[: LONGEST - 1]}…" for line in lines
    ]


def _text(words: str, x: float, y: float, kind: str = "") -> str:
    """Write a text in the middle above a place, squeezed where it is wider than its
    room.
    """
    squeezed = ""
    if width_of(words, SIZE) > ROOM:
        squeezed = f' textLength="{ROOM:g}" lengthAdjust="spacingAndGlyphs"'
    return (
        f'<text x="{x:g}" y="{y:g}" text-anchor="middle"{squeezed}{kind}>'
        f"{escape(words)}</text>"
    )

"""Readings of a design between the speeds of a tuning: its peaks lie at critical
speeds, which no grid of speeds meets.

A resonance is narrower than the distance of the speeds asked for, so that a limit read
at these alone is passed between them unseen, and the largest reading rises and falls as
the design moves a resonance from one speed to the next. Here the readings are taken at
the critical speeds of the design itself, where an order of the excitation meets a
natural frequency, and a tuning follows those that matter. Where teeth part a peak lies
elsewhere: there the speeds between are looked at as well, and those round the largest
readings again and again.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jaxhb._shown import brief
from jaxhb.design.quantities import QUANTITIES, Criterion, Penalty, judged, label
from jaxhb.elements.sentences import SceneError
from jaxhb.linear.critical import campbell, modes_of
from jaxhb.linear.forced import forced_response
from jaxhb.linear.modal import natural_frequencies
from jaxhb.results.response import Response
from jaxhb.solutions.speeds import solve_speeds
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.varying import varying

if TYPE_CHECKING:
    from jaxhb.design.task import Reading, Task

# Share of a limit by which it may be exceeded: penalties let through a tenth of that
EXCESS = 0.01
# Distance of neighbouring speeds over the median distance beyond which the speeds
# between are not meant
HOLE = 2.5
# Places of a resonance that are looked at, in half-widths
ASIDE = (-1.0, -0.5, 0.0, 0.5, 1.0)
HALF_WIDTH = 1e-3, 0.05  # damping ratio of a mode at least and at most
MODES = 12  # elastic modes whose critical speeds are looked at
FILLED = 32  # speeds are filled up to a multiple of these
VERTICES = 2  # times that the largest value is looked for between its neighbours
NEAR = 3.0  # half-widths within which a peak is that of a critical speed

# Of motions that are not linear:
# Critical speeds that are looked at, those with the largest linear readings
STRONGEST = 6
# Speeds that are looked at, at least, and at least one between two neighbours of those
# asked for
FINE = 64
# Times that both sides of the highest peaks of a reading are halved
HALVINGS = 4
SUMMITS = 2  # peaks of a reading whose sides are halved


@dataclass(frozen=True)
class Followed:
    """A speed that a tuning looks at beside those asked for: the critical speed of a
    mode and an order in each design, or ``rpm`` where it is none.
    """

    rpm: float
    mode: int | None = None
    order: float | None = None
    half_width: float = 0.0

    @property
    def name(self) -> tuple[float | None, ...]:
        """The mode and order, or the speed, that it is in every design."""
        return (self.mode, self.order) if self.order is not None else (self.rpm,)


@brief
@dataclass(frozen=True)
class Checked:
    """Readings of a design at the speeds of a tuning and between them.

    rpm : ``(m,)``, rising; solved : ``(m,)``; readings : by label ``(m,)``, SI units,
    nan where not solved or a rule has no limit
    """

    rpm: np.ndarray
    solved: np.ndarray
    readings: dict[str, np.ndarray]

    def worst(self, name: str) -> tuple[float, float]:
        """The largest reading of a label and its speed in rpm; nan where no speed is
        solved.
        """
        values = self.readings[name]
        if not np.isfinite(values).any():
            return np.nan, np.nan
        place = int(np.nanargmax(values))
        return float(values[place]), float(self.rpm[place])


@dataclass(frozen=True)
class Excess:
    """A limit that a design does not keep: the ``criterion`` that is read, the most
    that it may be, its largest value in SI units and the speed of that.
    """

    criterion: Criterion
    most: float
    value: float
    rpm: float

    def sentence(self, asked_rpm: np.ndarray) -> str:
        """Say the share of the limit and where it is reached, and whether that is at
        one of the speeds asked for ``(n,)`` rpm.
        """
        is_asked = (np.abs(asked_rpm - self.rpm) < 1e-9 * self.rpm).any()
        place = "" if is_asked else ", between the speeds asked for"
        return (
            f"{label(self.criterion)} {self.value / self.most:.3g} of its limit at"
            f" {self.rpm:.4g} rpm{place}"
        )


@dataclass(frozen=True)
class Reader:
    """A train and the readings of it at any speed: the responses of a
    :class:`~jaxhb.design.task.Task`.

    harmonics, tolerance : accuracy of the solves, as of :func:`jaxhb.solve_speeds`
    """

    train: DriveTrain
    task: Task
    harmonics: int | None = None
    tolerance: float | None = None

    def at(self, rpm: np.ndarray) -> Checked:
        """Take the readings at speeds ``(m,)`` rpm."""
        # Their number is a shape, and a shape is a program: where they cost little they
        # are filled up to one of few.
        padding = -len(rpm) % FILLED if is_linear(self.train) else 0
        response = solve_speeds(
            self.train,
            rpm=np.concatenate([rpm, np.repeat(rpm[-1:], padding)]),
            harmonics=self.harmonics,
            tolerance=self.tolerance,
        )
        solved = np.asarray(response.solved)[: len(rpm)]
        readings = {}
        for criterion in self.task.of_response:
            has_value = solved & judged(self.train, criterion, rpm)
            values = _values(response, criterion, self.train)[: len(rpm)]
            readings[label(criterion)] = np.where(has_value, values, np.nan)
        return Checked(rpm, solved, readings)

    def with_more(self, checked: Checked | None, rpm: np.ndarray) -> Checked:
        """Add readings at further speeds."""
        if checked is None:
            return self.at(np.unique(rpm))
        rpm = np.setdiff1d(rpm, checked.rpm)
        return _joined(checked, self.at(rpm)) if len(rpm) else checked


@dataclass(frozen=True)
class Spans:
    """The rising speeds of a tuning ``(n,)`` rpm, and the ends of the ranges between
    neighbours ``(k,)`` that are looked into, without holes.
    """

    grid: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of(cls, grid: np.ndarray) -> Spans:
        """Make the spans between rising speeds ``(n,)`` rpm."""
        gaps = np.diff(grid)
        close = gaps <= HOLE * np.median(gaps) if len(gaps) else gaps > 0
        return cls(grid, grid[:-1][close], grid[1:][close])

    def inside(self, speeds: Sequence[float] | np.ndarray) -> np.ndarray:
        """Select the speeds that lie within a span."""
        speeds = np.asarray(speeds, dtype=float)
        within = (self.low < speeds[:, None]) & (speeds[:, None] < self.high)
        return speeds[within.any(axis=1)]

    def divided(self, parts: int) -> np.ndarray:
        """Divide each span into equal parts, at these speeds."""
        shares = np.arange(1, parts) / parts
        return (self.low[:, None] + (self.high - self.low)[:, None] * shares).ravel()


def limits_of(task: Task) -> list[tuple[Criterion, float]]:
    """List ``(criterion, the most that it may be)`` of all limits that are read over
    the speeds.
    """
    limits = [(criterion, most_of(criterion)) for criterion in task.of_response]
    return [(criterion, most) for criterion, most in limits if most is not None]


def most_of(criterion: Criterion) -> float | None:
    """The most that a criterion may be: the limit of a Penalty, 1 of an Objective that
    is a share of a limit, else None.
    """
    if isinstance(criterion, Penalty):
        return criterion.most
    return 1.0 if criterion.quantity.endswith(" limit") else None


def exceeded(task: Task, checked: Checked) -> list[Excess]:
    """List the :class:`Excess` of each limit that a design does not keep."""
    excesses = []
    for criterion, most in limits_of(task):
        value, rpm = checked.worst(label(criterion))
        if value > most + EXCESS * abs(most):
            excesses.append(Excess(criterion, most, value, rpm))
    return excesses


def worst_share(task: Task, checked: Checked) -> float:
    """The largest reading over its limit; 0 without limits."""
    shares = (
        checked.worst(label(criterion))[0] / most for criterion, most in limits_of(task)
    )
    return max(shares, default=0.0)


def critical_speeds(train: DriveTrain, rpm: np.ndarray) -> list[Followed]:
    """List the critical speeds of a train within the range of the speeds ``(n,)`` rpm,
    none where they depend on amplitudes.
    """
    try:
        _, _, ratios = modes_of(train)
        crossings = campbell(
            train, rpm=[float(rpm.min()), float(rpm.max())], count=MODES
        ).critical
    except SceneError:
        return []
    least, most = HALF_WIDTH
    widths = np.clip(np.nan_to_num(ratios, nan=most), least, most)
    excited = (crossing for crossing in crossings if crossing.torque > 0)
    return [
        Followed(
            crossing.rpm, crossing.mode, crossing.order, float(widths[crossing.mode])
        )
        for crossing in excited
    ]


def speeds_of(
    followed: Sequence[Followed], train: DriveTrain, rpm: np.ndarray
) -> np.ndarray:
    """The speeds in a train that a tuning follows ``(k,)`` rpm, those beyond the range
    of the speeds ``(n,)`` at its end.
    """
    if not followed:
        return np.zeros(0)
    hz = () if varying(train.topology) else natural_frequencies(train).frequencies_hz
    speeds = [
        (
            60 * hz[peak.mode] / peak.order
            if peak.mode is not None and len(hz)
            else peak.rpm
        )
        for peak in followed
    ]
    return np.clip(speeds, rpm.min(), rpm.max())


def check_between(
    train: DriveTrain,
    rpm: np.ndarray,
    task: Task,
    reading: Reading | None = None,
    *,
    harmonics: int | None = None,
    tolerance: float | None = None,
) -> Checked:
    """Read a train at the speeds of a tuning ``(n,)`` rpm, of which the ``reading`` may
    be at hand, and between them as far as is needed to meet the peaks.
    """
    rising_rpm, places = np.unique(rpm, return_index=True)
    checked = None
    if reading is not None:
        names = map(label, task.of_response)
        readings = {name: reading.readings[name][places] for name in names}
        checked = Checked(rising_rpm, reading.solved[places], readings)
    with_peaks = _with_linear_peaks if is_linear(train) else _with_peaks
    reader = Reader(train, task, harmonics, tolerance)
    return with_peaks(reader, checked, Spans.of(rising_rpm))


def _with_linear_peaks(
    reader: Reader, checked: Checked | None, spans: Spans
) -> Checked:
    """Add the speeds asked for, those round the critical speeds and half way between
    the speeds, and where parabolas through the largest values culminate.
    """
    critical = _critical_within(reader.train, spans)
    flanks = [
        peak.rpm * (1 + place * peak.half_width) for peak in critical for place in ASIDE
    ]
    checked = reader.with_more(
        checked, np.concatenate([spans.grid, spans.inside(flanks), spans.divided(2)])
    )
    for _ in range(VERTICES):
        vertices = [_vertex(checked, name) for name in checked.readings]
        checked = reader.with_more(checked, spans.inside(vertices))
    return checked


def _with_peaks(reader: Reader, checked: Checked | None, spans: Spans) -> Checked:
    """Add the speeds asked for, equal parts of the spans, the strongest critical
    speeds, and both sides of the highest peaks halved again and again: where teeth part
    a peak lies beside the critical speed and may end in a jump, which no parabola
    meets.
    """
    critical = [
        peak.rpm for peak in _strongest(reader, _critical_within(reader.train, spans))
    ]
    parts = max(2, -(-FINE // max(len(spans.low), 1)))
    checked = reader.with_more(
        checked, np.concatenate([spans.grid, critical, spans.divided(parts)])
    )
    for _ in range(HALVINGS):
        midpoints = [
            speed
            for name in checked.readings
            for speed in _beside_summits(checked, name)
        ]
        checked = reader.with_more(checked, spans.inside(midpoints))
    return checked


def _critical_within(train: DriveTrain, spans: Spans) -> list[Followed]:
    """List the critical speeds of a train within the spans."""
    return [
        peak
        for peak in critical_speeds(train, spans.grid)
        if len(spans.inside([peak.rpm]))
    ]


def is_linear(train: DriveTrain) -> bool:
    """Whether a solve of the train is one linear solve."""
    return train.topology.linear_in_contact and not train.topology.has_law.any()


def followed_at(
    speed: float,
    train: DriveTrain,
    rpm: np.ndarray,
    followed_names: Collection[tuple] = (),
) -> Followed:
    """Tell what to follow of a peak at a speed: the critical speed that it is of, or
    the speed itself; the speed, too, in a train that is not linear whose critical speed
    is among the ``followed_names``, for its peak lies beside it.
    """
    critical = critical_speeds(train, rpm)
    distances = [abs(peak.rpm - speed) for peak in critical]
    if not critical:
        return Followed(speed)
    nearest = critical[int(np.argmin(distances))]
    of_nearest = min(distances) <= NEAR * nearest.half_width * speed
    beside_known = nearest.name in followed_names and not is_linear(train)
    return nearest if of_nearest and not beside_known else Followed(speed)


def _strongest(reader: Reader, critical: list[Followed]) -> list[Followed]:
    """Select the critical speeds with the largest readings of the linear motion."""
    criteria = [
        criterion
        for criterion in reader.task.of_response
        if QUANTITIES[criterion.quantity].kind != "mesh with backlash"
    ]
    if len(critical) <= STRONGEST or not criteria:
        return critical[:STRONGEST]
    response = forced_response(
        reader.train, rpm=np.array([peak.rpm for peak in critical])
    )
    sizes = np.zeros(len(critical))
    for criterion in criteria:
        values = np.nan_to_num(_values(response, criterion, reader.train))
        sizes = np.maximum(sizes, values / max(values.max(), 1e-300))
    return [critical[k] for k in np.sort(np.argsort(-sizes)[:STRONGEST])]


def _values(response: Response, criterion: Criterion, train: DriveTrain) -> np.ndarray:
    """Values ``(n,)`` of a criterion, SI units."""
    return np.asarray(
        QUANTITIES[criterion.quantity].exact_value(
            response, criterion.of, criterion.order, train
        ),
        dtype=float,
    )


def _joined(checked: Checked, other: Checked) -> Checked:
    """Merge the speeds of both, rising."""
    order = np.argsort(np.concatenate([checked.rpm, other.rpm]), kind="stable")
    rpm = np.concatenate([checked.rpm, other.rpm])
    solved = np.concatenate([checked.solved, other.solved])
    readings = {
        name: np.concatenate([values, other.readings[name]])[order]
        for name, values in checked.readings.items()
    }
    return Checked(rpm[order], solved[order], readings)


def _beside_summits(checked: Checked, name: str) -> list[float]:
    """Speeds half way to the neighbours of the highest local maxima of a reading, ends
    included.
    """
    solved = np.isfinite(checked.readings[name])
    x = checked.rpm[solved]
    y = checked.readings[name][solved]
    walled = np.concatenate([[-np.inf], y, [-np.inf]])
    summits = np.flatnonzero((y >= walled[:-2]) & (y >= walled[2:]))
    highest = summits[np.argsort(-y[summits], kind="stable")][:SUMMITS]
    sides = [
        (place, neighbour)
        for place in highest
        for neighbour in (place - 1, place + 1)
        if 0 <= neighbour < len(x)
    ]
    return [(x[place] + x[neighbour]) / 2 for place, neighbour in sides]


def _vertex(checked: Checked, name: str) -> float:
    """Speed at which the parabola through the largest reading and its neighbours
    culminates; nan at an end.
    """
    values = checked.readings[name]
    if not np.isfinite(values).any():
        return np.nan
    place = int(np.nanargmax(values))
    if not 0 < place < len(values) - 1:
        return np.nan
    near = slice(place - 1, place + 2)
    x = checked.rpm[near]
    if not np.ptp(values[near]) > 0:
        return np.nan
    return float(np.clip(culmination(x, values[near]), x[0], x[2]))


def culmination(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Where the parabola through three points ``(3, ...)``, not on a line, has its
    vertex; they need not be equidistant.
    """
    left, right = np.diff(x, axis=0)
    rise, fall = np.diff(y, axis=0) / np.diff(x, axis=0)
    return x[1] + (rise * right + fall * left) / (2 * (rise - fall))

"""What a design does between the speeds of a tuning: its peaks lie at critical speeds,
which no grid of speeds meets.

A resonance is narrower than the distance of speeds that one asks for, so that a limit
read at these alone is passed between them unseen, and the largest reading rises and
falls as the design moves a resonance from one speed to the next. Here the readings are
taken at the critical speeds of the design itself, where an order of the excitation
meets a natural frequency, and a tuning follows those that matter. Where teeth part a
peak lies elsewhere: there the speeds between are looked at as well, and those round the
largest readings again and again.
"""

from dataclasses import dataclass

import numpy as np

from jaxhb._shown import brief
from jaxhb.design.quantities import QUANTITIES, judged, label
from jaxhb.elements.elements import SceneError
from jaxhb.linear.critical import campbell, modes_of
from jaxhb.linear.forced import forced_response
from jaxhb.linear.modal import natural_frequencies
from jaxhb.solutions.speeds import solve_speeds
from jaxhb.train.varying import varying

# Share of a limit by which it may be exceeded: penalties let through a tenth of that
EXCESS = 0.01
# Distance of neighbouring speeds over the median distance beyond which the speeds
# between are not meant
HOLE = 2.5
ASIDE = (
    -1.0,
    -0.5,
    0.0,
    0.5,
    1.0,
)  # places of a resonance that are looked at, in half-widths
HALF_WIDTH = 1e-3, 0.05  # damping ratio of a mode at least and at most
MODES = 12  # elastic modes whose critical speeds are looked at
FILLED = 32  # speeds are filled up to a multiple of these
VERTICES = 2  # times that the largest value is looked for between its neighbours
NEAR = 3.0  # half-widths within which a peak is that of a critical speed

# Of motions that are not linear:
STRONGEST = (
    6  # critical speeds that are looked at, those with the largest linear readings
)
# Speeds that are looked at, at least, and at least one between two neighbours of those
# asked for
FINE = 64
HALVINGS, SUMMITS = (
    4,
    2,
)  # times that both sides of the highest peaks of a reading are halved; so many peaks


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
    def name(self) -> tuple:
        """What it is, in every design."""
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
    readings: dict

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
    """A limit that a design does not keep: what is ``read`` (an Objective or Penalty),
    the most that it may be, its largest value in SI units and the speed of that.
    """

    read: object
    most: float
    value: float
    rpm: float

    def sentence(self, asked_rpm) -> str:
        """The share of the limit and where, and whether that is at one of the speeds
        asked for.
        """
        asked = (np.abs(asked_rpm - self.rpm) < 1e-9 * self.rpm).any()
        where = "" if asked else ", between the speeds asked for"
        return (
            f"{label(self.read)} {self.value / self.most:.3g} of its limit at"
            f" {self.rpm:.4g} rpm{where}"
        )


@dataclass(frozen=True)
class Reader:
    """A train and what is read of it at any speed: the responses of a
    :class:`~jaxhb.design.evaluation.Task`.

    accuracy : ``harmonics`` and ``tolerance`` of the solves
    """

    train: object
    task: object
    accuracy: dict

    def at(self, rpm):
        """The :class:`Checked` at some speeds."""
        # Their number is a shape, and a shape is a program: where they cost little they
        # are filled up to one of few.
        more = -len(rpm) % FILLED if is_linear(self.train) else 0
        response = solve_speeds(
            self.train,
            rpm=np.concatenate([rpm, np.repeat(rpm[-1:], more)]),
            **self.accuracy,
        )
        solved = np.asarray(response.solved)[: len(rpm)]
        told = {}
        for chosen in self.task.of_response:
            kept = solved & judged(self.train, chosen, rpm)
            told[label(chosen)] = np.where(
                kept, _values(response, chosen, self.train)[: len(rpm)], np.nan
            )
        return Checked(rpm, solved, told)

    def with_more(self, checked, rpm):
        """A Checked with further speeds."""
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
    def of(cls, grid):
        """Those of rising speeds."""
        gaps = np.diff(grid)
        kept = gaps <= HOLE * np.median(gaps) if len(gaps) else gaps > 0
        return cls(grid, grid[:-1][kept], grid[1:][kept])

    def inside(self, speeds):
        """Those of some speeds that lie within a span."""
        speeds = np.asarray(speeds, dtype=float)
        within = (self.low < speeds[:, None]) & (speeds[:, None] < self.high)
        return speeds[within.any(axis=1)]

    def divided(self, parts):
        """The speeds that divide each span into equal parts."""
        shares = np.arange(1, parts) / parts
        return (self.low[:, None] + (self.high - self.low)[:, None] * shares).ravel()


def limits_of(task):
    """``(Objective or Penalty, the most that it may be)`` of all limits that are read
    over the speeds.
    """
    return [
        (chosen, most_of(chosen))
        for chosen in task.of_response
        if most_of(chosen) is not None
    ]


def most_of(chosen):
    """What an Objective or Penalty may be at most: an Objective that is a share of a
    limit that limit; else None.
    """
    if hasattr(chosen, "most"):
        return chosen.most
    return 1.0 if chosen.quantity.endswith(" limit") else None


def exceeded(task, checked):
    """The :class:`Excess` of each limit that a design does not keep."""
    all_limits = (
        Excess(chosen, most, *checked.worst(label(chosen)))
        for chosen, most in limits_of(task)
    )
    return [
        excess
        for excess in all_limits
        if excess.value > excess.most + EXCESS * abs(excess.most)
    ]


def worst_share(task, checked):
    """The largest reading over its limit."""
    return max(
        (checked.worst(label(chosen))[0] / most for chosen, most in limits_of(task)),
        default=0.0,
    )


def critical_speeds(train, rpm):
    """The :class:`Followed` of all critical speeds of a train within the range of
    speeds, none where they depend on amplitudes.
    """
    try:
        _, _, ratios = modes_of(train)
        crossings = campbell(
            train, rpm=[float(rpm.min()), float(rpm.max())], count=MODES
        ).critical
    except SceneError:
        return []
    widths = np.clip(np.nan_to_num(ratios, nan=HALF_WIDTH[1]), *HALF_WIDTH)
    excited = (crossing for crossing in crossings if crossing.torque > 0)
    return [
        Followed(each.rpm, each.mode, each.order, float(widths[each.mode]))
        for each in excited
    ]


def speeds_of(followed, train, rpm):
    """The speeds in a train that a tuning follows, those beyond the range of speeds at
    its end.
    """
    if not followed:
        return np.zeros(0)
    hz = () if varying(train.topology) else natural_frequencies(train).frequencies_hz
    speeds = [
        (
            60 * hz[each.mode] / each.order
            if each.mode is not None and len(hz)
            else each.rpm
        )
        for each in followed
    ]
    return np.clip(speeds, rpm.min(), rpm.max())


def check_between(train, rpm, task, known=None, **accuracy):
    """The :class:`Checked` of a train: at the speeds of a tuning, of which its Reading
    may be ``known``, and between them as far as is needed to meet the peaks.
    """
    grid, places = np.unique(rpm, return_index=True)
    if known is None:
        nothing = np.zeros(0)
        none = np.zeros(0, dtype=bool)
        checked = Checked(
            nothing, none, {label(chosen): nothing for chosen in task.of_response}
        )
    else:
        told = {
            label(chosen): known.readings[label(chosen)][places]
            for chosen in task.of_response
        }
        checked = Checked(grid, known.solved[places], told)
    with_peaks = _with_linear_peaks if is_linear(train) else _with_peaks
    return with_peaks(Reader(train, task, accuracy), checked, Spans.of(grid))


def _with_linear_peaks(reader, checked, spans):
    """A Checked with the speeds asked for, round the critical speeds, half way between
    the speeds, and where parabolas through the largest values culminate.
    """
    critical = _critical_within(reader.train, spans)
    flanks = [
        each.rpm * (1 + place * each.half_width) for each in critical for place in ASIDE
    ]
    checked = reader.with_more(
        checked, np.concatenate([spans.grid, spans.inside(flanks), spans.divided(2)])
    )
    for _ in range(VERTICES):
        vertices = [_vertex(checked, name) for name in checked.readings]
        checked = reader.with_more(checked, spans.inside(vertices))
    return checked


def _with_peaks(reader, checked, spans):
    """A Checked with the speeds asked for, equal parts of the spans, the strongest
    critical speeds, and both sides of the highest peaks halved again and again: where
    teeth part a peak lies beside the critical speed and may end in a jump, which no
    parabola meets.
    """
    critical = [
        each.rpm for each in _strongest(reader, _critical_within(reader.train, spans))
    ]
    parts = max(2, -(-FINE // max(len(spans.low), 1)))
    checked = reader.with_more(
        checked, np.concatenate([spans.grid, critical, spans.divided(parts)])
    )
    for _ in range(HALVINGS):
        beside = [
            speed
            for name in checked.readings
            for speed in _beside_summits(checked, name)
        ]
        checked = reader.with_more(checked, spans.inside(beside))
    return checked


def _critical_within(train, spans):
    """The critical speeds of a train within the spans."""
    return [
        each
        for each in critical_speeds(train, spans.grid)
        if len(spans.inside([each.rpm]))
    ]


def is_linear(train):
    """Whether a solve is one linear solve."""
    return train.topology.linear_in_contact and not train.topology.has_law.any()


def near(speed, train, rpm, known=()):
    """What to follow of a peak at a speed: the critical speed that it is of, or the
    speed itself; of a train that is not linear, too, where that critical speed is among
    the names ``known``, for its peak lies beside it.
    """
    critical = critical_speeds(train, rpm)
    apart = [abs(each.rpm - speed) for each in critical]
    if not critical:
        return Followed(speed)
    nearest = critical[int(np.argmin(apart))]
    of_nearest = min(apart) <= NEAR * nearest.half_width * speed
    beside_known = nearest.name in known and not is_linear(train)
    return nearest if of_nearest and not beside_known else Followed(speed)


def _strongest(reader, critical):
    """Of critical speeds those with the largest readings of the linear motion."""
    read = [
        chosen
        for chosen in reader.task.of_response
        if QUANTITIES[chosen.quantity].kind != "mesh with backlash"
    ]
    if len(critical) <= STRONGEST or not read:
        return critical[:STRONGEST]
    response = forced_response(
        reader.train, rpm=np.array([each.rpm for each in critical])
    )
    sizes = np.zeros(len(critical))
    for chosen in read:
        values = np.nan_to_num(_values(response, chosen, reader.train))
        sizes = np.maximum(sizes, values / max(values.max(), 1e-300))
    return [critical[k] for k in np.sort(np.argsort(-sizes)[:STRONGEST])]


def _values(response, chosen, train):
    return np.asarray(
        QUANTITIES[chosen.quantity].exact_value(
            response, chosen.of, chosen.order, train
        ),
        dtype=float,
    )


def _joined(checked, other):
    """A Checked with the speeds of both."""
    order = np.argsort(np.concatenate([checked.rpm, other.rpm]), kind="stable")
    rpm = np.concatenate([checked.rpm, other.rpm])
    solved = np.concatenate([checked.solved, other.solved])
    told = {
        name: np.concatenate([values, other.readings[name]])[order]
        for name, values in checked.readings.items()
    }
    return Checked(rpm[order], solved[order], told)


def _beside_summits(checked, name):
    """Half way to the neighbours of the highest local maxima of a reading, ends
    included.
    """
    solved = np.isfinite(checked.readings[name])
    x = checked.rpm[solved]
    y = checked.readings[name][solved]
    walled = np.concatenate([[-np.inf], y, [-np.inf]])
    summits = np.flatnonzero((y >= walled[:-2]) & (y >= walled[2:]))
    highest = summits[np.argsort(-y[summits], kind="stable")][:SUMMITS]
    sides = [
        (place, beside)
        for place in highest
        for beside in (place - 1, place + 1)
        if 0 <= beside < len(x)
    ]
    return [(x[place] + x[beside]) / 2 for place, beside in sides]


def _vertex(checked, name):
    """Where the parabola through the largest reading and its neighbours culminates; nan
    at an end.
    """
    values = checked.readings[name]
    if not np.isfinite(values).any():
        return np.nan
    place = int(np.nanargmax(values))
    if not 0 < place < len(values) - 1:
        return np.nan
    x = checked.rpm[place - 1 : place + 2]
    y = values[place - 1 : place + 2]
    left = (y[1] - y[0]) / (x[1] - x[0])
    right = (y[2] - y[1]) / (x[2] - x[1])
    bend = (right - left) / (x[2] - x[0])
    if not bend < 0:
        return np.nan
    return float(np.clip((x[0] + x[1]) / 2 - left / (2 * bend), x[0], x[2]))

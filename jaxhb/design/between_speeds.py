"""What a design does between the speeds of a tuning: its peaks lie at critical speeds, which no grid of speeds meets.

A resonance is narrower than the distance of speeds that one asks for, so that a limit read at these alone is passed
between them unseen, and the largest reading rises and falls as the design moves a resonance from one speed to the next.
Here the readings are taken at the critical speeds of the design itself, where an order of the excitation meets a
natural frequency, and a tuning follows those that matter.
"""

from dataclasses import dataclass

import numpy as np

from jaxhb._shown import brief
from jaxhb.design.quantities import QUANTITIES, label
from jaxhb.elements.elements import SceneError
from jaxhb.linear.critical import campbell, modes_of
from jaxhb.linear.forced import forced_response
from jaxhb.linear.modal import natural_frequencies
from jaxhb.solutions.speeds import solve_speeds
from jaxhb.train.varying import varying

EXCESS = 0.01  # share of a limit by which it may be exceeded: penalties let through a tenth of that
HOLE = 2.5  # distance of neighbouring speeds over the median distance beyond which the speeds between are not meant
ASIDE = (-1.0, -0.5, 0.0, 0.5, 1.0)  # places of a resonance that are looked at, in half-widths
HALF_WIDTH = 1e-3, 0.05  # damping ratio of a mode at least and at most
MODES = 12  # elastic modes whose critical speeds are looked at
MOST = 6  # critical speeds that are looked at where motions are not linear, those with the largest linear readings
FILLED = 32  # speeds are filled up to a multiple of these
VERTICES = 2  # times that the largest value is looked for between its neighbours
NEAR = 3.0  # half-widths within which a peak is that of a critical speed


@dataclass(frozen=True)
class Followed:
    """A speed that a tuning looks at beside those asked for: the critical speed of a mode and an order in each design,
    or ``rpm`` where it is none."""

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

    rpm : ``(m,)``, rising; solved : ``(m,)``; readings : by label ``(m,)``, SI units, nan where not solved
    """

    rpm: np.ndarray
    solved: np.ndarray
    readings: dict

    def worst(self, name: str) -> tuple[float, float]:
        """The largest reading of a label and its speed in rpm; nan where no speed is solved."""
        values = self.readings[name]
        if not np.isfinite(values).any():
            return np.nan, np.nan
        place = int(np.nanargmax(values))
        return float(values[place]), float(self.rpm[place])


def limits_of(task):
    """``(Objective or Penalty, the most that it may be)`` of all limits that are read over the speeds."""
    return [(one, most_of(one)) for one in task.of_response if most_of(one) is not None]


def most_of(chosen):
    """What an Objective or Penalty may be at most: an Objective that is a share of a limit that limit; else None."""
    if hasattr(chosen, "most"):
        return chosen.most
    return 1.0 if chosen.quantity.endswith(" limit") else None


def exceeded(task, checked):
    """``(Objective or Penalty, limit, value, rpm)`` of the limits that a design does not keep."""
    found = [(chosen, most, *checked.worst(label(chosen))) for chosen, most in limits_of(task)]
    return [one for one in found if one[2] > one[1] + EXCESS * abs(one[1])]


def shown_excess(one, rpm):
    """A limit exceeded, in a sentence: where, and whether at a speed asked for."""
    chosen, most, value, speed = one
    where = "" if (np.abs(rpm - speed) < 1e-9 * speed).any() else ", between the speeds asked for"
    return f"{label(chosen)} {value / most:.3g} of its limit at {speed:.4g} rpm{where}"


def worst_share(task, checked):
    """The largest reading over its limit."""
    return max((checked.worst(label(chosen))[0] / most for chosen, most in limits_of(task)), default=0.0)


def critical_speeds(train, rpm):
    """The :class:`Followed` of all critical speeds of a train within the range of speeds, none where they depend on
    amplitudes."""
    try:
        _, _, ratios = modes_of(train)
        found = campbell(train, rpm=[float(rpm.min()), float(rpm.max())], count=MODES).critical
    except SceneError:
        return []
    widths = np.clip(np.nan_to_num(ratios, nan=HALF_WIDTH[1]), *HALF_WIDTH)
    return [Followed(one.rpm, one.mode, one.order, float(widths[one.mode])) for one in found if one.torque > 0]


def speeds_of(followed, train, rpm):
    """The speeds in a train that a tuning follows, those beyond the range of speeds at its end."""
    if not followed:
        return np.zeros(0)
    hz = () if varying(train.topology) else natural_frequencies(train).frequencies_hz
    speeds = [60 * hz[one.mode] / one.order if one.mode is not None and len(hz) else one.rpm for one in followed]
    return np.clip(speeds, rpm.min(), rpm.max())


def check_between(train, rpm, task, known=None, **accuracy):
    """The :class:`Checked` of a train: at the speeds of a tuning, of which its Reading may be ``known``, round its
    critical speeds, half way between the speeds, and where parabolas through the largest values culminate.

    Where a solve takes longer, as motions are not linear: at the critical speeds that matter most, and the last.
    """
    grid, places = np.unique(rpm, return_index=True)
    gaps = np.diff(grid)
    spans = [(low, high) for low, high in zip(grid[:-1], grid[1:], strict=True) if high - low <= HOLE * np.median(gaps)]

    def meant(speeds):
        return [speed for speed in speeds if any(low < speed < high for low, high in spans)]

    critical = [one for one in critical_speeds(train, grid) if meant([one.rpm])]
    if is_linear(train):
        round_them = [one.rpm * (1 + place * one.half_width) for one in critical for place in ASIDE]
        between = meant(round_them) + [(low + high) / 2 for low, high in spans]
    else:
        between = [one.rpm for one in _largest(train, critical, task)]
    if known is None:
        checked = _read(train, np.unique([*grid, *between]), task, accuracy)
    else:
        told = {label(chosen): known.readings[label(chosen)][places] for chosen in task.of_response}
        checked = Checked(grid, known.solved[places], told)
        checked = _with(checked, between, train, task, accuracy)
    for _ in range(VERTICES):
        checked = _with(checked, meant([_vertex(checked, name) for name in checked.readings]), train, task, accuracy)
    return checked


def is_linear(train):
    """Whether a solve is one linear solve."""
    return train.topology.linear_in_contact and not train.topology.has_law.any()


def near(speed, train, rpm):
    """What to follow of a peak at a speed: the critical speed that it is of, or the speed itself."""
    critical = critical_speeds(train, rpm)
    apart = [abs(one.rpm - speed) for one in critical]
    if critical and min(apart) <= NEAR * critical[int(np.argmin(apart))].half_width * speed:
        return critical[int(np.argmin(apart))]
    return Followed(speed)


def _largest(train, critical, task):
    """Of critical speeds those with the largest readings of the linear motion."""
    read = [chosen for chosen in task.of_response if QUANTITIES[chosen.quantity].kind != "mesh with backlash"]
    if len(critical) <= MOST or not read:
        return critical[:MOST]
    response = forced_response(train, rpm=np.array([one.rpm for one in critical]))
    sizes = np.zeros(len(critical))
    for chosen in read:
        values = np.nan_to_num(_values(response, chosen, train))
        sizes = np.maximum(sizes, values / max(values.max(), 1e-300))
    return [critical[k] for k in np.sort(np.argsort(-sizes)[:MOST])]


def _values(response, chosen, train):
    return np.asarray(QUANTITIES[chosen.quantity].exact_value(response, chosen.of, chosen.order, train), dtype=float)


def _read(train, rpm, task, accuracy):
    """The Checked at some speeds."""
    # Their number is a shape, and a shape is a program: where they cost little they are filled up to one of few.
    filled = np.concatenate([rpm, np.repeat(rpm[-1:], -len(rpm) % FILLED if is_linear(train) else 0)])
    response = solve_speeds(train, rpm=filled, **accuracy)
    solved = np.asarray(response.solved)[: len(rpm)]
    told = {}
    for chosen in task.of_response:
        told[label(chosen)] = np.where(solved, _values(response, chosen, train)[: len(rpm)], np.nan)
    return Checked(rpm, solved, told)


def _with(checked, rpm, train, task, accuracy):
    """A Checked with further speeds."""
    rpm = np.setdiff1d(rpm, checked.rpm)
    if not len(rpm):
        return checked
    other = _read(train, rpm, task, accuracy)
    return _joined(checked, other)


def _joined(one, other):
    order = np.argsort(np.concatenate([one.rpm, other.rpm]), kind="stable")
    rpm, solved = (np.concatenate([getattr(part, name) for part in (one, other)])[order] for name in ("rpm", "solved"))
    told = {name: np.concatenate([values, other.readings[name]])[order] for name, values in one.readings.items()}
    return Checked(rpm, solved, told)


def _vertex(checked, name):
    """Where the parabola through the largest reading and its neighbours culminates; nan at an end."""
    values = checked.readings[name]
    if not np.isfinite(values).any():
        return np.nan
    place = int(np.nanargmax(values))
    if not 0 < place < len(values) - 1:
        return np.nan
    x, y = checked.rpm[place - 1 : place + 2], values[place - 1 : place + 2]
    left, right = (y[1] - y[0]) / (x[1] - x[0]), (y[2] - y[1]) / (x[2] - x[1])
    bend = (right - left) / (x[2] - x[0])
    if not bend < 0:
        return np.nan
    return float(np.clip((x[0] + x[1]) / 2 - left / (2 * bend), x[0], x[2]))

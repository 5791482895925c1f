"""The answers of the command line: what a train does at one speed, at many, and the periodic solutions of --orbit."""

import dataclasses
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from jaxhb.report.answer import Answer, growth_of, orbit_state, shown
from jaxhb.report.text.certified import certificate_of
from jaxhb.results.status import Status
from jaxhb.solutions.speeds import solve_speeds
from jaxhb.steady.checkpoint import CHUNK, Checkpoint
from jaxhb.steady.steady_state import steady_state
from jaxhb.train.changes import without_backlash


@dataclass(frozen=True)
class Asked:
    """What was asked of every speed: the steady state or a periodic solution (``orbit``), how exactly, and whether
    with a computed bound."""

    orbit: bool = False
    harmonics: int | None = None
    tolerance: float | None = None
    certify: bool = False

    @classmethod
    def of(cls, arguments):
        """As the command line says."""
        certified = getattr(arguments, "certify", False)
        return cls(arguments.orbit, arguments.harmonics, arguments.tolerance, certified)

    @property
    def accuracy(self):
        """Of :func:`jaxhb.solve` and :func:`jaxhb.steady_state`."""
        return {"harmonics": self.harmonics, "tolerance": self.tolerance}


def answer_one(train, rpm, asked, say=lambda text: None, *, start=None, kept=None):
    """The :class:`Answer` at one speed; ``say`` is told what is done.

    Parameters
    ----------
    train : DriveTrain
    rpm : float
    asked : Asked
    start : SteadyState, optional
        A neighbour from which the motion starts.
    kept : dict, ``out`` and ``chunk`` of :func:`jaxhb.steady_state`, optional

    Examples
    --------
    >>> import jaxhb
    >>> answer = answer_one(jaxhb.load_scene("spur_pair"), 2000.0, Asked())
    >>> answer.state.kind, round(answer.force("gear a|gear b").max)
    ('contact', 1072)
    """
    linear = _linear(train, [rpm])[0]
    if asked.orbit:
        say(f"{rpm:g} rpm: solving for a periodic motion")
        keep = _keeper(train, asked, kept or {})
        (state,) = keep([[rpm]], lambda: [_orbit(train, rpm, asked)], lambda count: None)
    elif _unbalanced(linear):
        state = _no_state(linear)
    else:
        say(f"{rpm:g} rpm: marching until the motion settles")
        state = steady_state(train, rpm=rpm, **asked.accuracy, start=start, **(kept or {}))
    say(f"{rpm:g} rpm: is the motion stable?")
    answer = Answer(train, state, shown(linear), growth_of(state), asked.orbit)
    return dataclasses.replace(answer, certificate=certificate_of(answer, say)) if asked.certify else answer


def answer_speeds(train, rpm, asked, *, direction="up", kept=None, progress=None, say=lambda text: None, told=None):
    """Answers at many speeds, by the direction in which the sweep went.

    Parameters
    ----------
    train : DriveTrain
    rpm : sequence of float
    asked : Asked
    direction : "up", "down" or "both", of no meaning for orbits
    kept : dict, ``out`` and ``chunk`` of :func:`jaxhb.steady_state`
    progress : callable, called with the number of speeds done since the last call
    say : callable, told what is done
    told : callable, told now and then what is returned in the end, as far as it is known

    Returns
    -------
    dict
        ``{"up": [Answer, ...]}``, ``"down"`` or both; ``"orbit"`` for orbits. Always in the order of ``rpm``.
    """
    rpm = np.array(rpm, dtype=float)
    linear = _linear(train, rpm)
    gathered = _Gathered(train, linear, asked.orbit, told)
    if asked.orbit:
        say("speeds solved for a periodic motion")
        found = {"orbit": _orbits(train, rpm, asked, kept or {}, progress, gathered.tell)}
    else:
        say("speeds marched until the motion settles")
        found = _swept(train, rpm, linear, asked, direction, kept or {}, progress, gathered.tell)
    say("is each motion stable?")
    return gathered.answers({way: dict(enumerate(states)) for way, states in found.items()})


def _linear(train, rpm):
    """Responses with all teeth in contact, at speeds."""
    # A train without backlash is its own linear train, whose programs are at hand.
    return solve_speeds(without_backlash(train) if any(train.topology.mesh_backlash) else train, rpm=rpm)


class _Gathered:
    """Answers of a sweep as its states become known."""

    def __init__(self, train, linear, orbit, told):
        self.train, self.linear, self.orbit, self.told = train, linear, orbit, told
        self.states, self.made = {}, {}

    def tell(self, states, way):
        """Some states more, by the number of their speed."""
        self.states.setdefault(way, {}).update(states)
        if self.told:
            self.told(self.answers(self.states))

    def answers(self, states):
        """Answers by direction, in the order of the speeds."""
        return {way: [self._answer(i, own[i]) for i in sorted(own)] for way, own in states.items()}

    def _answer(self, place, state):
        if id(state) not in self.made:  # a speed that does the same upwards and downwards has one state
            growth = growth_of(state)
            self.made[id(state)] = Answer(self.train, state, shown(self.linear[place]), growth, self.orbit)
        return self.made[id(state)]


def answer_values(train, rpm, axis, values, asked, *, direction="up", kept=None, progress=None, told=None):
    """Answers at one speed for many values of a number of the scene, each from the motion of its neighbour.

    Parameters
    ----------
    train, asked, direction, kept, progress, told : as of :func:`answer_speeds`
    rpm : float
    axis : Axis, the number that changes
    values : sequence of float

    Returns
    -------
    dict
        As of :func:`answer_speeds`, in the order of ``values``.
    """
    order, found = np.argsort(values, kind="stable"), {}
    ways = ("orbit",) if asked.orbit else ("up", "down") if direction == "both" else (direction,)
    for way in ways:
        own, start = found.setdefault(way, {}), None
        for place in order[::-1] if way == "down" else order:
            changed, value = train.replace({axis.name: values[place]}), float(values[place])
            folder = {"out": Path(kept["out"]) / f"{way} {place}"} if kept and kept["out"] else {}
            answer = answer_one(changed, rpm, asked, start=start, kept=folder)
            own[int(place)] = dataclasses.replace(answer, axis=axis, value=value)
            # A motion that is not known is nothing to start from.
            start = answer.state if answer.state.motion is not None else None
            progress and progress(1)
            if told:
                told({key: [rows[i] for i in sorted(rows)] for key, rows in found.items()})
    return {way: [own[i] for i in sorted(own)] for way, own in found.items()}


def _orbit(train, rpm, asked):
    """The periodic solution at one speed: planned and started by itself, so that it has the same bits alone, in a sweep
    and in a report."""
    return orbit_state(solve_speeds(train, rpm=[rpm], **asked.accuracy)[0])


def _orbits(train, rpm, asked, kept, progress, tell):
    progress = progress or (lambda count: None)

    def solved(speeds):
        found = []
        for speed in speeds:
            found.append(_orbit(train, speed, asked))
            progress(1)
        return found

    keep, size, states = _keeper(train, asked, kept), kept.get("chunk") or CHUNK, []
    for first in range(0, len(rpm), size):
        speeds = rpm[first : first + size]
        states += keep([speeds], partial(solved, speeds), progress)
        tell(dict(enumerate(states)), "orbit")
    return states


def _keeper(train, asked, kept):
    """What keeps periodic solutions, as :meth:`Checkpoint.keep`; without a folder it computes them."""
    if not kept.get("out"):
        return lambda question, compute, progress: compute()
    options = {"answers": "periodic solutions", **asked.accuracy}
    return Checkpoint(kept["out"], train, options, kept.get("chunk") or CHUNK).keep


def _swept(train, rpm, linear, asked, direction, kept, progress, tell):
    """Steady states by direction."""
    if _unbalanced(linear[0]):
        ways = ("up", "down") if direction == "both" else (direction,)
        return {way: [_no_state(linear[i]) for i in range(len(rpm))] for way in ways}
    given = {**asked.accuracy, **kept, "progress": progress, "on_states": tell}
    found = steady_state(train, rpm=rpm, direction=direction, **given)
    sweeps = found if direction == "both" else (found,)
    return {sweep.direction: list(sweep.states) for sweep in sweeps}


def _unbalanced(linear):
    """A train that gains speed has no steady motion, whatever its vibration."""
    return int(linear.status) == Status.UNBALANCED


def _no_state(linear):
    """The steady state of a train whose linear motion tells that there is none."""
    return dataclasses.replace(orbit_state(linear), response=None)

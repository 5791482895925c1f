"""The answers of the command line: what a train does at one speed, at many, and the periodic solutions of --orbit."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from ..model.change import without_backlash
from ..periodic.solve import linear_response, solve
from ..periodic.speeds import solve_speeds
from ..periodic.steady_state import steady_state
from ..response.status import Status
from .answer import Answer, orbit_state
from .certified import certificate_of
from .floquet import growth_of


@dataclass(frozen=True)
class Asked:
    """What was asked of every speed: the steady state or a periodic solution (``orbit``), how exactly, and whether
    with an error bound."""

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


def answer_one(train, rpm, asked, say=lambda text: None):
    """The :class:`Answer` at one speed; ``say`` is told what is done.

    Parameters
    ----------
    train : DriveTrain
    rpm : float
    asked : Asked

    Examples
    --------
    >>> import jaxhb
    >>> answer = answer_one(jaxhb.load_scene("spur_pair"), 2000.0, Asked())
    >>> answer.state.kind, round(answer.force("gear a|gear b").max)
    ('contact', 1072)
    """
    linear = linear_response(train, rpm=rpm)
    if asked.orbit:
        say(f"{rpm:g} rpm: solving for a periodic motion")
        state = orbit_state(solve(train, rpm=rpm, **asked.accuracy))
    else:
        say(f"{rpm:g} rpm: marching until the motion settles")
        state = _settled(train, rpm, linear, asked)
    say(f"{rpm:g} rpm: is the motion stable?")
    answer = Answer(train, state, linear, growth_of(state, orbit=asked.orbit), asked.orbit)
    return dataclasses.replace(answer, certificate=certificate_of(answer, say)) if asked.certify else answer


def answer_speeds(train, rpm, asked, *, direction="up", kept=None, progress=None, say=lambda text: None):
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

    Returns
    -------
    dict
        ``{"up": [Answer, ...]}``, ``"down"`` or both; ``"orbit"`` for orbits. Always in the order of ``rpm``.
    """
    rpm = np.array(rpm, dtype=float)
    # A train without backlash is its own linear train; the program is the one that planned the sweep.
    flat = without_backlash(train) if any(train.topology.mesh_backlash) else train
    linear = solve_speeds(flat, rpm=rpm)
    if asked.orbit:
        say("speeds solved for a periodic motion")
        found = {"orbit": _orbits(train, rpm, linear, asked, progress)}
    else:
        say("speeds marched until the motion settles")
        found = _swept(train, rpm, linear, asked, direction, kept or {}, progress)
    say("is each motion stable?")
    # A speed that does the same upwards and downwards has one state.
    own = {id(state): state for states in found.values() for state in states}
    growths = {key: growth_of(state, orbit=asked.orbit) for key, state in own.items()}
    return {
        way: [Answer(train, state, linear[i], growths[id(state)], asked.orbit) for i, state in enumerate(states)]
        for way, states in found.items()
    }


def _orbits(train, rpm, linear, asked, progress):
    if any(train.topology.mesh_backlash):
        sweep = solve_speeds(train, rpm=rpm, **asked.accuracy, progress=progress)
    else:
        sweep = linear
        progress and progress(len(rpm))
    return [orbit_state(sweep[i]) for i in range(len(sweep))]


def _swept(train, rpm, linear, asked, direction, kept, progress):
    """Steady states by direction."""
    if _unbalanced(linear[0]):
        ways = ("up", "down") if direction == "both" else (direction,)
        return {way: [_no_state(linear[i]) for i in range(len(rpm))] for way in ways}
    found = steady_state(train, rpm=rpm, direction=direction, **asked.accuracy, **kept, progress=progress)
    sweeps = found if direction == "both" else (found,)
    return {sweep.direction: list(sweep.states) for sweep in sweeps}


def _settled(train, rpm, linear, asked):
    return _no_state(linear) if _unbalanced(linear) else steady_state(train, rpm=rpm, **asked.accuracy)


def _unbalanced(linear):
    """A train that gains speed has no steady motion, whatever its vibration."""
    return int(linear.status) == Status.UNBALANCED


def _no_state(linear):
    """The steady state of a train whose linear motion tells that there is none."""
    return dataclasses.replace(orbit_state(linear), response=None)

"""Outcome of a solve: one number inside programs, a sentence for people outside, and
the attempts in order.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, TypeVar

import numpy as np

from jaxhb._jax import refuse_tracers

AnyResponse = TypeVar("AnyResponse", bound=Any)


class Status(IntEnum):
    """Outcome of a solve; larger is worse. ``sentence`` says it for people.

    >>> print(Status(3))
    MAX_STEPS
    >>> Status.NEAR_SINGULAR.sentence.split(": ")[1]
    'add damping or move the speed'
    """

    CONVERGED = 0
    TOLERANCE_NOT_MET = 1
    PLAN_VIOLATED = 2
    MAX_STEPS = 3
    STALLED = 4
    UNBALANCED = 5
    NEAR_SINGULAR = 6
    NONFINITE = 7
    INVALID_INPUT = 8

    def __str__(self) -> str:
        return self.name

    # An IntEnum would format as its number.
    def __format__(self, spec: str) -> str:
        return format(self.name, spec)

    @property
    def sentence(self) -> str:
        """Sentence that says what happened and what to try."""
        return _SENTENCES[self]

    @property
    def another_start_may_help(self) -> bool:
        """Whether another start of Newton's method may succeed."""
        return self in (Status.MAX_STEPS, Status.STALLED, Status.NONFINITE)


_REMEDY = (
    "ask for the steady state, use more harmonics (above the mesh modes), start from"
    " the response at a neighbouring speed, or search longer with jaxhb.solve_all"
)
_SENTENCES = {
    Status.CONVERGED: "converged",
    Status.TOLERANCE_NOT_MET: (
        "the equations are solved, but with too few harmonics for the tolerance: use"
        " more harmonics"
    ),
    Status.PLAN_VIOLATED: (
        "a mesh that the plan holds on one flank leaves it, or passes the knots of its"
        " law more often than exact integrals allow: plan again, solve without a plan,"
        " or use sampled integrals"
    ),
    Status.MAX_STEPS: (
        "Newton's method needed more steps than allowed: "
        + _REMEDY
        + "; of a linear response: the amplitude of a link was not found: make its"
        " table over_amplitude smoother or add damping"
    ),
    Status.STALLED: (
        "Newton's method found no step that improves the solution: " + _REMEDY
    ),
    Status.UNBALANCED: (
        "the mean torques do not balance and no load or ground takes the difference:"
        " add a [[load]] or correct the mean torques; a damper ring that dry friction"
        " drives and no stiffness holds creeps: give it a small stiffness"
    ),
    Status.NEAR_SINGULAR: (
        "the equations are singular here (an undamped resonance): add damping or move"
        " the speed"
    ),
    Status.NONFINITE: (
        "the solution is not finite: check the scene for huge or tiny numbers"
    ),
    Status.INVALID_INPUT: (
        "the speed is not between 0 and 1000000 rpm, or a number of the train lies"
        " outside its range (an inertia, stiffness, damping or backlash below 0,"
        " epsilon or transition not within 0 and 1): correct it"
    ),
}


class NotConverged(RuntimeError):
    """A periodic solution did not converge, or not to the requested tolerance."""


def check(response: AnyResponse) -> AnyResponse:
    """Raise :class:`NotConverged` with a sentence per speed that did not converge;
    return the response otherwise.
    """
    refuse_tracers(
        "check",
        response,
        instead="read response.solved or response.status there",
        host=True,
    )
    columns = (
        response.rpm,
        response.status,
        response.residual,
        response.truncation_error,
    )
    sentences = [
        f"{response.topology.title} at {rpm:g} rpm: {Status(int(status)).name},"
        f" residual {residual:.1e}, truncation error {100 * error:.3g} %:"
        f" {Status(int(status)).sentence}."
        for rpm, status, residual, error in zip(
            *map(np.atleast_1d, columns), strict=True
        )
        if status
    ]
    if sentences:
        raise NotConverged("\n".join(sentences))
    return response


@dataclass(frozen=True)
class Newton:
    """Newton's method on the harmonics; without unknown meshes one linear solve."""

    harmonics: int
    active_meshes: int
    integrals: str
    status: Status
    steps: int

    def __str__(self) -> str:
        size = f"{self.harmonics} harmonics" + (
            ", exact integrals" if self.integrals == "exact" else ""
        )
        if not self.active_meshes:
            return f"linear solve with {size}: {self.status.name}"
        return f"Newton with {size}: {self.status.name}, {self.steps} steps"


@dataclass(frozen=True)
class March:
    """Time integration over some cycles; the last one misses its beginning by the
    periodicity error.
    """

    cycles: int
    time_steps: int
    periodicity_error: float

    def __str__(self) -> str:
        size = f"{self.cycles} cycles of {self.time_steps} steps"
        return f"march of {size} (periodicity error {self.periodicity_error:.1e})"


@dataclass(frozen=True)
class Sweeps:
    """Sweeps of a cycle, each corrected by the error of its steps; ``change`` of the
    vibration in the last one.
    """

    count: int
    time_steps: int
    change: float

    def __str__(self) -> str:
        return (
            f"{self.count} sweeps of {self.time_steps} steps (last change"
            f" {self.change:.1e})"
        )


@dataclass(frozen=True)
class NewtonOnSweeps:
    """Newton's method on the change that a sweep makes; ``left`` is the share of the
    vibration by which the last cycle misses its beginning.
    """

    marches: int
    time_steps: int
    left: float

    def __str__(self) -> str:
        return (
            f"Newton on sweeps: {self.marches} marches of {self.time_steps} steps (left"
            f" {self.left:.1e})"
        )


@dataclass(frozen=True)
class Shooting:
    """Newton's method on the state at the beginning of a cycle and then on those of its
    segments, from so many states: an orbit that closes.
    """

    tries: int
    time_steps: int
    periodicity_error: float

    def __str__(self) -> str:
        start = f"{self.tries} states, cycle of {self.time_steps} steps"
        return f"shooting from {start} (periodicity error {self.periodicity_error:.1e})"


@dataclass(frozen=True)
class Homotopy:
    """The curve of motions from a linear law to that of the train, the last of so many
    ``curves``.
    """

    curves: int
    steps: int
    turning_points: int
    time_steps: int

    def __str__(self) -> str:
        counts = (
            f"curve no. {self.curves}, {self.steps} steps, {self.turning_points}"
            " turning points"
        )
        return f"homotopy from a linear law: {counts}, cycle of {self.time_steps} steps"

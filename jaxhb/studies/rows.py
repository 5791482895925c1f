"""Rows of a part of a campaign: one for each speed of a design, computed wherever an
executor puts it.

A design or a speed that cannot be computed is a row that says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from jaxhb.design.quantities import QUANTITIES, Objective
from jaxhb.elements.sentences import SceneError
from jaxhb.linear.forced import forced_response
from jaxhb.results.response import Response
from jaxhb.results.status import Status
from jaxhb.results.steady import SteadyState, orbit_state
from jaxhb.solutions.speeds import solve_speeds
from jaxhb.steady.steady_state import steady_state
from jaxhb.studies.study import Part
from jaxhb.train.drivetrain import DriveTrain

INVALID = "INVALID_INPUT"
FAILED = "FAILED"
LOST = "WORKER_LOST"
RECORDED = "RECORDED"  # numbers of recorded cycles, which no harmonic balance has


@dataclass
class Rows:
    """Columns of rows ``(n,)``.

    numbers : those that change, by name, ``(n,)`` each; kind, period : of the motion;
    status : how it is known, a name of :class:`jaxhb.Status`, or RECORDED, FAILED,
    WORKER_LOST; problem : why there is no answer, "" where there is one; kept : ``(n,
    Q)`` quantities, nan without an answer
    """

    rpm: np.ndarray
    numbers: dict[str, float]
    kept: np.ndarray
    kind: list[str] = field(default_factory=list)
    period: list[int] = field(default_factory=list)
    status: list[str] = field(default_factory=list)
    problem: list[str] = field(default_factory=list)

    def add(
        self,
        kind: str,
        period: int,
        status: str,
        problem: str,
        kept: Sequence[float] = (),
    ) -> None:
        """Add the row of the next speed."""
        if len(kept):
            self.kept[len(self.kind)] = kept
        self.kind.append(kind)
        self.period.append(period)
        self.status.append(status)
        self.problem.append(problem)


def rows_of(part: Part) -> Rows:
    """Compute the rows of a part; no failure leaves it."""
    rows = _empty(part)
    try:
        train = _design(part)
        rows.numbers = {
            name: float(train.value(name)) for name in (*part.values, *part.ratios)
        }
    except SceneError as error:
        return without_answer(part, INVALID, str(error))
    try:
        states = _states(train, part, part.rpm)
    except Exception:
        # One speed spoils the others: each by itself.
        for speed in part.rpm:
            try:
                states = _states(train, part, np.array([speed]))
            except Exception as error:
                rows.add("unknown", 0, FAILED, f"{type(error).__name__}: {error}")
            else:
                _add(rows, train, part, states[0])
        return rows
    for state in states:
        _add(rows, train, part, state)
    return rows


def without_answer(part: Part, status: str, problem: str) -> Rows:
    """Rows of a part that has no answer."""
    rows = _empty(part)
    for _ in part.rpm:
        rows.add("unknown", 0, status, problem)
    return rows


def _empty(part: Part) -> Rows:
    return Rows(
        rpm=part.rpm,
        numbers=dict(part.values),
        kept=np.full((len(part.rpm), len(part.keep)), np.nan),
    )


def _design(part: Part) -> DriveTrain:
    """The train of a part; numbers within tolerances have a ratio to those of the
    design.
    """
    train = part.variant.train
    if part.values:
        train = train.replace(part.values)
    if part.ratios:
        train = train.replace(
            {
                name: float(train.value(name)) * ratio
                for name, ratio in part.ratios.items()
            }
        )
    return train


def _states(train: DriveTrain, part: Part, rpm: np.ndarray) -> Sequence[SteadyState]:
    """Answers at speeds ``(n,)``."""
    accuracy = part.accuracy
    responses: Response
    if accuracy.answers == "forced":
        responses = forced_response(train, rpm=rpm, harmonics=accuracy.harmonics)
    elif accuracy.answers == "orbit":
        responses = solve_speeds(
            train,
            rpm=rpm,
            harmonics=accuracy.harmonics,
            tolerance=accuracy.tolerance,
        )
    else:
        sweep = steady_state(
            train,
            rpm=rpm,
            harmonics=accuracy.harmonics,
            tolerance=accuracy.tolerance,
        )
        return sweep.states
    return [orbit_state(responses[place]) for place in range(len(rpm))]


def _add(rows: Rows, train: DriveTrain, part: Part, state: SteadyState) -> None:
    """Add the row of a state."""
    response = state.response
    status = RECORDED if response is None else Status(int(response.status)).name
    if not state.known:
        rows.add(state.kind, 0, status, "; ".join(state.notes))
        return
    kept = [_read(train, state, quantity) for quantity in part.keep]
    rows.add(state.kind, state.period, status, "", kept)


def _read(train: DriveTrain, state: SteadyState, kept: Objective) -> float:
    """A quantity of a state; nan where recorded cycles do not tell it."""
    quantity = QUANTITIES[kept.quantity]
    motion: SteadyState | Response = state
    if not quantity.compared:
        if state.response is None:
            return np.nan
        motion = state.response
    return float(quantity.exact_value(motion, kept.of, kept.order, train))

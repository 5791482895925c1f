"""Rows of a part of a campaign: one for each speed of its designs, computed wherever an
executor puts it.

A design or a speed that cannot be computed is a row that says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from jaxhb.design.quantities import QUANTITIES
from jaxhb.elements.sentences import SceneError
from jaxhb.linear.heat import heat_balance
from jaxhb.results.response import Response
from jaxhb.results.status import Status
from jaxhb.results.steady import SteadyState, orbit_state
from jaxhb.solutions.speeds import solve_speeds
from jaxhb.steady.steady_state import steady_state
from jaxhb.studies.study import Piece
from jaxhb.train.drivetrain import DriveTrain

INVALID = "INVALID_INPUT"
FAILED = "FAILED"
LOST = "WORKER_LOST"
UNKNOWN = "UNKNOWN"  # the motion is not known, and the problem says why
RECORDED = "RECORDED"  # numbers of recorded cycles, which no harmonic balance has


@dataclass
class Rows:
    """Columns of the rows ``(n,)`` of a piece.

    numbers : those that change, by name; kind, period : of the motion; status : how it
    is known, a name of :class:`jaxhb.Status`, or one of those above; problem : why
    there is no answer, "" where there is one; values : ``(n, Q)`` of the quantities,
    nan without an answer
    """

    rpm: np.ndarray
    numbers: dict[str, float]
    values: np.ndarray
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
        values: Sequence[float] = (),
    ) -> None:
        """Add the row of the next speed."""
        if len(values):
            self.values[len(self.kind)] = values
        self.kind.append(kind)
        self.period.append(period)
        self.status.append(status)
        self.problem.append(problem)


def rows_of(pieces: Sequence[Piece]) -> list[Rows]:
    """Compute the rows of each piece of a part; no failure leaves it."""
    return [_rows_of(piece) for piece in pieces]


def _rows_of(piece: Piece) -> Rows:
    """Compute the rows of a piece."""
    rows = _empty(piece)
    try:
        train = _design(piece)
        rows.numbers = {
            name: float(train.value(name)) for name in (*piece.values, *piece.ratios)
        }
    except SceneError as error:
        return without_answer(piece, INVALID, str(error))
    try:
        states = _states(train, piece, piece.rpm)
    except Exception:
        # One speed spoils the others: each by itself.
        for speed in piece.rpm:
            try:
                states = _states(train, piece, np.array([speed]))
            except Exception as error:
                rows.add("unknown", 0, FAILED, f"{type(error).__name__}: {error}")
            else:
                _add(rows, train, piece, states[0])
        return rows
    for state in states:
        _add(rows, train, piece, state)
    return rows


def without_answer(piece: Piece, status: str, problem: str) -> Rows:
    """Rows of a piece that has no answer."""
    rows = _empty(piece)
    for _ in piece.rpm:
        rows.add("unknown", 0, status, problem)
    return rows


def _empty(piece: Piece) -> Rows:
    return Rows(
        rpm=piece.rpm,
        numbers=dict(piece.values),
        values=np.full((len(piece.rpm), len(piece.keep)), np.nan),
    )


def _design(piece: Piece) -> DriveTrain:
    """The train of a piece; numbers within tolerances have a ratio to those of the
    design.
    """
    train = piece.variant.train
    if piece.values:
        train = train.replace(piece.values)
    if piece.ratios:
        train = train.replace(
            {
                name: float(train.value(name)) * ratio
                for name, ratio in piece.ratios.items()
            }
        )
    return train


def _states(train: DriveTrain, piece: Piece, rpm: np.ndarray) -> Sequence[SteadyState]:
    """Answers at speeds ``(n,)``."""
    accuracy = piece.accuracy
    responses: Response
    if accuracy.answers == "forced":
        responses = heat_balance(train, rpm=rpm, harmonics=accuracy.harmonics)
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


def _add(rows: Rows, train: DriveTrain, piece: Piece, state: SteadyState) -> None:
    """Add the row of a state."""
    response = state.response
    problem = ""
    if response is not None:
        outcome = Status(int(response.status))
        status = outcome.name
        # Numbers beyond their limits are there, but no answer, as in a sweep.
        problem = "" if response.converged else outcome.sentence
    else:
        status = RECORDED if state.known else UNKNOWN
    if not state.known:
        rows.add(state.kind, 0, status, "; ".join(state.notes))
        return
    values = [
        QUANTITIES[kept.quantity].of_state(state, kept.of, kept.order, train)
        for kept in piece.keep
    ]
    rows.add(state.kind, state.period, status, problem, values)

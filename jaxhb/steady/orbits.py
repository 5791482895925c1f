"""Periodic solutions as the steady states that they would be, stable or not, at many
speeds.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path

import numpy as np

from jaxhb.results.checkpoint import CHUNK, Cached, Checkpoint, answered_parts
from jaxhb.results.steady import SteadyState, orbit_state
from jaxhb.solutions.speeds import solve_speeds
from jaxhb.train.drivetrain import DriveTrain


def orbit_states(
    train: DriveTrain,
    rpm: Sequence[float] | np.ndarray,
    *,
    harmonics: int | None = None,
    tolerance: float | None = None,
    out: str | Path | Cached | None = None,
    chunk: int | None = None,
    progress: Callable[[int], object] | None = None,
    on_states: Callable[[dict[int, SteadyState]], object] | None = None,
    executor: Executor | None = None,
) -> list[SteadyState]:
    """A SteadyState for each of the speeds ``rpm`` ``(n,)``, each planned and started
    by itself: a speed has the same bits alone and in a sweep. Arguments are as of
    :func:`jaxhb.steady_state`; ``on_states`` is called with all states so far, by the
    number of their speed.
    """
    report = progress or (lambda count: None)
    size = chunk or CHUNK
    settings = {
        "answers": "periodic solutions",
        "harmonics": harmonics,
        "tolerance": tolerance,
    }
    checkpoint = None if out is None else Checkpoint(out, train, settings, size)
    solved = partial(_solved, harmonics=harmonics, tolerance=tolerance)
    if executor is None:
        solved = partial(solved, report=report)
    chunks = [rpm[first : first + size] for first in range(0, len(rpm), size)]
    questions = [[speeds] for speeds in chunks]
    parts = [(train, speeds) for speeds in chunks]
    states: dict[int, SteadyState] = {}
    for number, chunk_states in answered_parts(
        checkpoint,
        questions,
        solved,
        parts,
        executor,
        lambda answer: report(len(answer)),
    ):
        states |= enumerate(chunk_states, number * size)
        if on_states:
            on_states(dict(states))
    return [states[place] for place in range(len(rpm))]


def _solved(
    train: DriveTrain,
    rpm: Sequence[float] | np.ndarray,
    *,
    harmonics: int | None,
    tolerance: float | None,
    report: Callable[[int], object] = lambda count: None,
) -> list[SteadyState]:
    """Steady states of speeds, each solved by itself."""
    states = []
    for speed in rpm:
        responses = solve_speeds(
            train, rpm=[speed], harmonics=harmonics, tolerance=tolerance
        )
        states.append(orbit_state(responses[0]))
        report(1)
    return states

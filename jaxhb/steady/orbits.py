"""Periodic solutions as the steady states that they would be, stable or not, at many
speeds.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from jaxhb.results.checkpoint import CHUNK, Cached, keeper
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
) -> list[SteadyState]:
    """A SteadyState for each of the speeds ``rpm`` ``(n,)``, each planned and started
    by itself: a speed has the same bits alone and in a sweep. Arguments are as of
    :func:`jaxhb.steady_state`; ``on_states`` is called with all states so far, by the
    number of their speed.
    """
    report = progress or (lambda count: None)
    size = chunk or CHUNK
    states: list[SteadyState] = []
    settings = {
        "answers": "periodic solutions",
        "harmonics": harmonics,
        "tolerance": tolerance,
    }
    keep = keeper(out, train, settings, size)

    def solved(speeds: Sequence[float] | np.ndarray) -> list[SteadyState]:
        solved_states = []
        for speed in speeds:
            responses = solve_speeds(
                train, rpm=[speed], harmonics=harmonics, tolerance=tolerance
            )
            solved_states.append(orbit_state(responses[0]))
            report(1)
        return solved_states

    for first in range(0, len(rpm), size):
        speeds = rpm[first : first + size]
        states += keep([speeds], partial(solved, speeds), report)
        if on_states:
            on_states(dict(enumerate(states)))
    return states

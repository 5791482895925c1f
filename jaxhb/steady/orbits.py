"""Periodic solutions as the steady states that they would be, stable or not, at many
speeds.
"""

from functools import partial

from jaxhb.results.checkpoint import CHUNK, keeper
from jaxhb.results.steady import orbit_state
from jaxhb.solutions.speeds import solve_speeds


def orbit_states(
    train,
    rpm,
    *,
    harmonics=None,
    tolerance=None,
    out=None,
    chunk=None,
    progress=None,
    on_states=None,
):
    """A SteadyState for each of the speeds, each planned and started by itself: a speed
    has the same bits alone and in a sweep. Arguments are as of
    :func:`jaxhb.steady_state`; ``on_states`` is told all states so far.
    """
    progress, size, states = progress or (lambda count: None), chunk or CHUNK, []
    accuracy = {"harmonics": harmonics, "tolerance": tolerance}
    keep = keeper(out, train, {"answers": "periodic solutions", **accuracy}, size)

    def solved(speeds):
        found = []
        for speed in speeds:
            found.append(orbit_state(solve_speeds(train, rpm=[speed], **accuracy)[0]))
            progress(1)
        return found

    for first in range(0, len(rpm), size):
        speeds = rpm[first : first + size]
        states += keep([speeds], partial(solved, speeds), progress)
        if on_states:
            on_states(dict(enumerate(states)))
    return states

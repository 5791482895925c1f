"""One line for a session, and a table for a notebook, of responses, steady states and
signals.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jaxhb._jax import traced
from jaxhb._shown import MOST_ROWS, counts, html_table, number, span

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from jaxhb.results.response import Response
    from jaxhb.results.signal import Signal
    from jaxhb.results.steady import SteadyState, SteadySweep


def response_line(response: Response) -> str:
    """A response in one line: its train and speeds, and the outcome of the solve."""
    beginning = f"<{type(response).__name__} of {response.topology.title}"
    if traced(response):
        return f"{beginning}, traced, {response.harmonics} harmonics>"
    if not np.ndim(response.rpm):
        return (
            f"{beginning} at {number(float(response.rpm))} rpm: {_outcome(response)}>"
        )
    many = np.ndim(response.rpm) == 1
    speeds = (
        span(np.asarray(response.rpm), "rpm")
        if many
        else f"{' x '.join(map(str, np.shape(response.rpm)))} motions"
    )
    return (
        f"{beginning} at {speeds}: {counts(response.status_name)}, {response.harmonics}"
        " harmonics>"
    )


def _outcome(response: Response) -> str:
    """Status, number of harmonics and truncation error of a response, in words."""
    error = 100 * float(response.truncation_error)
    return (
        f"{response.status_name}, {response.harmonics} harmonics, truncation error"
        f" {error:.2g} %"
    )


def response_html(response: Response) -> str:
    """A response as a table: its links at one speed, or its speeds."""
    caption = response_line(response)[1:-1]
    if traced(response) or np.ndim(response.rpm) > 1:
        return html_table(caption, [], [])
    if not np.ndim(response.rpm):
        return (
            _links(caption, response)
            if response.solved
            else html_table(caption, [], [])
        )

    def cells(motion: Response) -> tuple[list[Any], Any]:
        return [motion.status_name, int(motion.highest_harmonic)], motion.solved

    return _speeds(caption, response, ["status", "harmonics"], cells)


def _speeds(
    caption: str,
    motions: Response | SteadySweep,
    head: list[str],
    cells: Callable[[Any], tuple[list[Any], Any]],
) -> str:
    """A table of motions, a row for each speed; ``cells(motion)`` gives its cells below
    ``head`` and whether it has numbers.
    """
    rows = []
    for k in range(min(len(motions), MOST_ROWS)):
        motion = motions[k]
        own_cells, solved = cells(motion)
        peaks = {
            name: float(motion.force(name).peak)
            for name in motion.topology.mesh_names
            if solved
        }
        mesh = max(peaks, key=peaks.__getitem__, default="-")
        rows.append(
            [
                number(float(motion.rpm)),
                *own_cells,
                number(peaks[mesh]) if peaks else "-",
                mesh,
            ]
        )
    caption += f"; the first {MOST_ROWS}" * (len(motions) > MOST_ROWS)
    return html_table(caption, ["rpm", *head, "largest tooth force, N", "mesh"], rows)


def _links(caption: str, motion: Response | SteadyState) -> str:
    """A table of every mesh, shaft and damper of a motion."""
    topology = motion.topology
    rows = []
    for name in (*topology.mesh_names, *topology.shaft_names, *topology.damper_names):
        toothed = name in topology.mesh_names
        signal = motion.force(name) if toothed else motion.torque(name)
        # Sizes: a sign would tell which end the scene names first.
        values = [
            number(abs(float(value)))
            for value in (signal.mean, signal.half_peak_to_peak, signal.peak)
        ]
        apart = f"{100 * motion.mesh(name).separated_fraction:.3g}" if toothed else ""
        rows.append([name, *values, "N" if toothed else "N m", apart])
    head = [
        "mesh, shaft or damper",
        "mean",
        "half peak-to-peak",
        "peak",
        "unit",
        "apart %",
    ]
    return html_table(caption, head, rows)


def state_line(state: SteadyState) -> str:
    """A steady state in one line."""
    kind = (
        f"subharmonic, period {state.period} cycles"
        if state.kind == "subharmonic"
        else state.kind
    )
    outcome = (
        _outcome(state.response)
        if state.response is not None
        else f"{state.cycles} cycles marched"
    )
    return (
        f"<SteadyState of {state.topology.title} at {number(state.rpm)} rpm: {kind};"
        f" {outcome}>"
    )


def state_html(state: SteadyState) -> str:
    """A steady state as a table of its links, with its notes."""
    caption = "; ".join([state_line(state)[1:-1], *state.notes])
    return _links(caption, state) if state.known else html_table(caption, [], [])


def states_line(sweep: SteadySweep) -> str:
    """A sweep of steady states in one line."""
    return (
        f"<SteadySweep {sweep.direction}, {span(sweep.rpm, 'rpm')}:"
        f" {counts(sweep.kind)}>"
    )


def states_html(sweep: SteadySweep) -> str:
    """A sweep of steady states as a table of its speeds."""
    caption = states_line(sweep)[1:-1]
    head = ["motion", "period"]

    def cells(state: SteadyState) -> tuple[list[Any], bool]:
        return [state.kind, state.period or "-"], state.known

    return _speeds(caption, sweep, head, cells)


def signal_line(signal: Signal) -> str:
    """A signal in one line: its extremes."""
    kind = type(signal).__name__
    orders = signal.coefficients.shape[-1] - 1
    if traced(signal):
        return f"<{kind}, traced, {orders} harmonics>"
    if np.ndim(signal.coefficients) > 1:
        batch = " x ".join(map(str, signal.coefficients.shape[:-1]))
        low = float(np.min(signal.min))
        high = float(np.max(signal.max))
        return (
            f"<{kind} of {batch} motions, {orders} harmonics: {number(low)} to"
            f" {number(high)}>"
        )
    mean, smallest, largest = (
        number(float(value)) for value in (signal.mean, signal.min, signal.max)
    )
    return f"<{kind}, {orders} harmonics: mean {mean}, min {smallest}, max {largest}>"

"""What responses and steady states show of themselves in a session and in a
notebook.
"""

import numpy as np

from jaxhb._jax import traced
from jaxhb._shown import MOST_ROWS, counts, html_table, number, span


def response_line(response):
    """A response in one line: where it is from, how it went."""
    begun = f"<{type(response).__name__} of {response.topology.title}"
    if traced(response):
        return f"{begun}, traced, {response.harmonics} harmonics>"
    if not np.ndim(response.rpm):
        return f"{begun} at {number(float(response.rpm))} rpm: {_how(response)}>"
    many = np.ndim(response.rpm) == 1
    speeds = (
        span(response.rpm, "rpm")
        if many
        else f"{' x '.join(map(str, np.shape(response.rpm)))} motions"
    )
    return (
        f"{begun} at {speeds}: {counts(response.status_name)}, {response.harmonics}"
        " harmonics>"
    )


def _how(response):
    error = 100 * float(response.truncation_error)
    return (
        f"{response.status_name}, {response.harmonics} harmonics, truncation error"
        f" {error:.2g} %"
    )


def response_html(response):
    """A response as a table: of one speed its links, of several its speeds."""
    caption = response_line(response)[1:-1]
    if traced(response) or np.ndim(response.rpm) > 1:
        return html_table(caption, [], [])
    if not np.ndim(response.rpm):
        return (
            _links(caption, response)
            if response.solved
            else html_table(caption, [], [])
        )

    def cells(one):
        return [one.status_name, int(one.highest_harmonic)], one.solved

    return _speeds(caption, response, ["status", "harmonics"], cells)


def _speeds(caption, motions, head, cells):
    """A table of the speeds of motions; ``cells`` of one, and whether it has
    numbers.
    """
    rows = []
    for k in range(min(len(motions), MOST_ROWS)):
        motion = motions[k]
        own, known = cells(motion)
        peaks = {
            name: float(motion.force(name).peak)
            for name in motion.topology.mesh_names
            if known
        }
        mesh = max(peaks, key=peaks.get, default="-")
        rows.append(
            [
                number(float(motion.rpm)),
                *own,
                number(peaks[mesh]) if peaks else "-",
                mesh,
            ]
        )
    caption += f"; the first {MOST_ROWS}" * (len(motions) > MOST_ROWS)
    return html_table(caption, ["rpm", *head, "largest tooth force, N", "mesh"], rows)


def _links(caption, motion):
    """A table of every mesh, shaft and damper of a motion."""
    topology = motion.topology
    rows = []
    for name in (*topology.mesh_names, *topology.shaft_names, *topology.damper_names):
        toothed = name in topology.mesh_names
        signal = motion.force(name) if toothed else motion.torque(name)
        # Sizes: a sign would tell which end the scene names first.
        values = [
            number(abs(float(v)))
            for v in (signal.mean, signal.half_peak_to_peak, signal.peak)
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


def state_line(state):
    """A steady state in one line."""
    kind = (
        f"subharmonic, period {state.period} cycles"
        if state.kind == "subharmonic"
        else state.kind
    )
    how = (
        _how(state.response)
        if state.response is not None
        else f"{state.cycles} cycles marched"
    )
    return (
        f"<SteadyState of {state.topology.title} at {number(state.rpm)} rpm: {kind};"
        f" {how}>"
    )


def state_html(state):
    """A steady state as a table of its links, with its notes."""
    caption = "; ".join([state_line(state)[1:-1], *state.notes])
    return _links(caption, state) if state.known else html_table(caption, [], [])


def states_line(sweep):
    """A sweep of steady states in one line."""
    return (
        f"<SteadySweep {sweep.direction}, {span(sweep.rpm, 'rpm')}:"
        f" {counts(sweep.kind)}>"
    )


def states_html(sweep):
    """A sweep of steady states as a table of its speeds."""
    caption = states_line(sweep)[1:-1]
    head = ["motion", "period"]
    return _speeds(
        caption,
        sweep,
        head,
        lambda state: ([state.kind, state.period or "-"], state.known),
    )


def signal_line(signal):
    """A signal in one line: its extremes."""
    kind = type(signal).__name__
    orders = signal.coefficients.shape[-1] - 1
    if traced(signal):
        return f"<{kind}, traced, {orders} harmonics>"
    if np.ndim(signal.coefficients) > 1:
        lot = " x ".join(map(str, signal.coefficients.shape[:-1]))
        low = float(np.min(signal.min))
        high = float(np.max(signal.max))
        return (
            f"<{kind} of {lot} motions, {orders} harmonics: {number(low)} to"
            f" {number(high)}>"
        )
    mean, low, high = (number(float(v)) for v in (signal.mean, signal.min, signal.max))
    return f"<{kind}, {orders} harmonics: mean {mean}, min {low}, max {high}>"

"""What responses and steady states show of themselves in a session and in a notebook."""

import numpy as np

from jaxhb._jax import traced
from jaxhb._shown import counts, html_table, number, shown_rows, span
from jaxhb.results.status import Status

HEAD = ["mesh, shaft or damper", "mean", "half peak-to-peak", "max", "unit", "apart %"]


def response_line(response):
    """A response in one line: where it is from, how it went."""
    kind, name = type(response).__name__, response.topology.title
    if traced(response):
        return f"<{kind} of {name}, traced, {response.harmonics} harmonics>"
    if not np.ndim(response.rpm):
        return f"<{kind} of {name} at {number(float(response.rpm))} rpm: {_how(response)}>"
    many = np.ndim(response.rpm) == 1
    speeds = span(response.rpm, "rpm") if many else f"{' x '.join(map(str, np.shape(response.rpm)))} motions"
    return f"<{kind} of {name} at {speeds}: {counts(response.status_name)}, {response.harmonics} harmonics>"


def _how(response):
    error = 100 * float(response.truncation_error)
    return f"{response.status_name}, {response.harmonics} harmonics, truncation error {error:.2g} %"


def response_html(response):
    """A response as a table: of one speed its links, of several its speeds."""
    caption = response_line(response)[1:-1]
    if traced(response) or np.ndim(response.rpm) > 1:
        return html_table(caption, [], [])
    if np.ndim(response.rpm):
        rows = [None if k is None else _speed_row(response[k]) for k in shown_rows(len(response))]
        return html_table(caption, ["rpm", "status", "harmonics", "largest tooth force, N", "mesh"], rows)
    apart = {name: contact.separated_fraction for name, contact in response.contacts().items()}
    return html_table(caption, HEAD, link_rows(response, apart))


def _speed_row(response):
    # The last iterate of a solve that failed is no motion.
    force, mesh = _largest_force(response) if response.status <= Status.TOLERANCE_NOT_MET else ("-", "-")
    return [number(float(response.rpm)), response.status_name, int(response.highest_harmonic), force, mesh]


def _largest_force(motion):
    peaks = {name: float(motion.force(name).peak) for name in motion.topology.mesh_names}
    mesh = max(peaks, key=peaks.get, default="-")
    return number(peaks[mesh]) if peaks else "-", mesh


def link_rows(motion, apart):
    """Rows of every mesh, shaft and damper of a motion; ``apart``: share of the time by mesh."""
    topology, rows = motion.topology, []
    for name in (*topology.mesh_names, *topology.shaft_names, *topology.damper_names):
        toothed = name in apart
        signal = motion.force(name) if toothed else motion.torque(name)
        values = [number(float(v)) for v in (signal.mean, signal.half_peak_to_peak, signal.max)]
        rows.append([name, *values, "N" if toothed else "N m", f"{100 * apart[name]:.3g}" if toothed else ""])
    return rows


def state_line(state):
    """A steady state in one line."""
    kind = f"subharmonic, period {state.period} cycles" if state.kind == "subharmonic" else state.kind
    how = _how(state.response) if state.response is not None else f"{state.cycles} cycles marched"
    return f"<SteadyState of {state.topology.title} at {number(state.rpm)} rpm: {kind}; {how}>"


def state_html(state):
    """A steady state as a table of its links, with its notes."""
    caption = "; ".join([state_line(state)[1:-1], *state.notes])
    if not state.known:
        return html_table(caption, [], [])
    apart = {name: state.mesh(name).separated_fraction for name in state.topology.mesh_names}
    return html_table(caption, HEAD, link_rows(state, apart))


def states_line(sweep):
    """A sweep of steady states in one line."""
    return f"<SteadySweep {sweep.direction}, {span(sweep.rpm, 'rpm')}: {counts(sweep.kind)}>"


def states_html(sweep):
    """A sweep of steady states as a table of its speeds."""
    rows = [None if k is None else _state_row(sweep[k]) for k in shown_rows(len(sweep))]
    return html_table(states_line(sweep)[1:-1], ["rpm", "motion", "period", "largest tooth force, N", "mesh"], rows)


def _state_row(state):
    force, mesh = _largest_force(state) if state.known else ("-", "-")
    return [number(state.rpm), state.kind, state.period or "-", force, mesh]


def signal_line(signal):
    """A signal in one line: its extremes."""
    kind, orders = type(signal).__name__, signal.coefficients.shape[-1] - 1
    if traced(signal):
        return f"<{kind}, traced, {orders} harmonics>"
    if np.ndim(signal.coefficients) > 1:
        lot = " x ".join(map(str, signal.coefficients.shape[:-1]))
        low, high = float(np.min(signal.min)), float(np.max(signal.max))
        return f"<{kind} of {lot} motions, {orders} harmonics: {number(low)} to {number(high)}>"
    mean, low, high = (number(float(v)) for v in (signal.mean, signal.min, signal.max))
    return f"<{kind}, {orders} harmonics: mean {mean}, min {low}, max {high}>"

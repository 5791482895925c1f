"""Pictures of what a train does: kinds of motion over the speed, peaks of cycles, orders.

Forces are transmitted tooth forces; a peak is the largest absolute value.
"""

import numpy as np

from jaxhb.report.figures.branch import GREY, branch_keys, draw_branch
from jaxhb.report.figures.style import MOTIONS, crosses, key, legend, one_panel, plain
from jaxhb.results.record import PERCENT
from jaxhb.results.steady import KINDS

COLOURS = {kind: MOTIONS[kind][2] for kind in KINDS}
SHAPES = {kind: MOTIONS[kind][0] for kind in KINDS}
SIZES = {"contact": 3.5, "periodic": 4.5, "subharmonic": 5.5, "irregular": 9, "unknown": 7}

STEM = 4.0
"""Height of the largest order of a waterfall, in distances of its speeds."""

SEEN = 0.02
"""Share of the largest from which the tip of a stem is marked."""


def plot_motions(*sweeps, mesh=None, branches=(), orbits=None):
    """Largest tooth force of a mesh over the speed, marked with the kind of motion.

    Parameters
    ----------
    sweeps : SteadySweep
        One, or two of one train, upwards and downwards: the second is drawn hollow.
    mesh : str, optional
        Default: the one with the largest force.
    branches : sequence of Branch, optional
        Over the speed, drawn below as lines, solid where stable and dashed where not.
    orbits : Response, optional
        Of many speeds (:func:`jaxhb.solve_speeds`): the periodic motions, whether or not they occur.

    Returns
    -------
    matplotlib.figure.Figure
        Markers at the largest force of the motion, with the period of a subharmonic one in cycles; a bar over the
        peaks of the cycles, from 5 to 95 %, where the motion is irregular; a cross at the bottom where it is unknown.

    Raises
    ------
    ValueError
        For a train without meshes.

    Examples
    --------
    >>> import jaxhb
    >>> train = jaxhb.load_scene("spur_pair")
    >>> figure = plot_motions(jaxhb.steady_state(train, rpm=[2000.0, 3000.0]))
    >>> figure.axes[0].get_ylabel()
    'largest tooth force, kN'
    """
    mesh = mesh or hardest_mesh(*sweeps)
    figure, axes = one_panel(_title(sweeps[0], mesh, "largest tooth force"), "largest tooth force, kN")
    for branch in branches:
        draw_branch(axes, branch, mesh)
    if orbits is not None:
        solved = np.asarray(orbits.converged)
        largest = np.asarray(orbits.force(mesh).peak)[solved] / 1e3
        axes.plot(np.asarray(orbits.rpm)[solved], largest, "+", color="black", markersize=8)
    for number, sweep in enumerate(sweeps):
        rpm, largest = sweep.rpm, _of_known(sweep, mesh, np.max)
        axes.plot(rpm, largest, color=GREY, linewidth=0.9, linestyle="--" if number else "-", zorder=1)
        for kind in KINDS:
            _mark(axes, rpm, largest, sweep.kind == kind, kind, hollow=number > 0)
        for state, value in zip(sweep, largest, strict=True):
            if state.kind == "subharmonic":
                _digit(axes, state, value, below=number > 0)
        _bars(axes, sweep, mesh, hollow=number > 0)
    axes.set_ylim(bottom=0.0)
    legend(
        axes,
        _kinds(sweeps)
        + _ways(sweeps)
        + branch_keys(branches)
        + [key("periodic solution", "+", "black", markersize=8)] * (orbits is not None),
    )
    return figure


def plot_cycle_peaks(*sweeps, mesh=None):
    """Bifurcation diagram: peak of the tooth force in every cycle, over the speed.

    Parameters
    ----------
    sweeps : SteadySweep
        One, or two of one train, upwards and downwards: the second is drawn hollow.
    mesh : str, optional
        Default: the one with the largest force.

    Returns
    -------
    matplotlib.figure.Figure
        One point a speed where every cycle is as the one before, k points where the motion repeats after k cycles, all
        recorded cycles where it is irregular.

    Raises
    ------
    ValueError
        For a train without meshes.

    Examples
    --------
    >>> import jaxhb
    >>> train = jaxhb.load_scene("spur_pair")
    >>> figure = plot_cycle_peaks(jaxhb.steady_state(train, rpm=[2000.0, 3000.0]))
    >>> len(figure.axes[0].get_lines())
    1
    """
    mesh = mesh or hardest_mesh(*sweeps)
    figure, axes = one_panel(_title(sweeps[0], mesh, "peak of each cycle"), "tooth force, kN")
    for number, sweep in enumerate(sweeps):
        for kind in KINDS:
            states = [state for state in sweep if state.kind == kind]
            if kind == "unknown":
                crosses(axes, [state.rpm for state in states])
            elif states:
                peaks = [_peaks(state, mesh) / 1e3 for state in states]
                rpm = np.repeat([state.rpm for state in states], [len(values) for values in peaks])
                style = _style(kind, number > 0) | {"marker": "." if kind == "irregular" else "o"}
                size = (2.5, 4.5)[number] if kind == "irregular" else (4, 7)[number]
                axes.plot(rpm, np.concatenate(peaks), linestyle="none", **style | {"markersize": size})
    axes.set_ylim(bottom=0.0)
    legend(axes, _kinds(sweeps, irregular=".") + _ways(sweeps))
    return figure


def plot_waterfall(sweep, mesh=None, *, highest=None):
    """Amplitudes of the orders of a tooth force, speed above speed.

    Parameters
    ----------
    sweep : SteadySweep
    mesh : str, optional
        Default: the one with the largest force.
    highest : float, optional
        Order up to which is drawn. Default: the last with a tenth of the largest amplitude at some speed.

    Returns
    -------
    matplotlib.figure.Figure
        A stem for each order, on a line for each speed, in the colour of the kind of motion. A subharmonic motion of k
        cycles has k times as many orders; those of an irregular one are quadratic means over the recorded cycles.

    Raises
    ------
    ValueError
        For a train without meshes.

    Examples
    --------
    >>> import jaxhb
    >>> train = jaxhb.load_scene("spur_pair")
    >>> figure = plot_waterfall(jaxhb.steady_state(train, rpm=[2000.0, 3000.0]))
    >>> figure.axes[0].get_xlabel()
    'order, per revolution of the reference rotor'
    """
    mesh = mesh or hardest_mesh(sweep)
    figure, axes = one_panel(_title(sweep, mesh, "orders of the tooth force"), "speed, rpm", height=6.2)
    axes.set_xlabel("order, per revolution of the reference rotor")
    known = [state for state in sweep if state.known]
    signals = [state.force(mesh) for state in known]
    largest = max((float(np.max(signal.amplitudes)) for signal in signals), default=1.0)
    if highest is None:
        seen = [signal.orders[np.asarray(signal.amplitudes) > largest / 10] for signal in signals]
        highest = float(max((orders.max(initial=1.0) for orders in seen), default=1.0))
    distance = np.min(np.diff(np.sort(sweep.rpm)), initial=np.ptp(sweep.rpm) or sweep.rpm.max())
    scale = STEM * distance / largest
    for state, signal in zip(known, signals, strict=True):
        drawn = signal.orders <= highest
        orders, heights = signal.orders[drawn], scale * np.asarray(signal.amplitudes)[drawn]
        axes.axhline(state.rpm, color="0.85", linewidth=0.7, zorder=1)
        axes.vlines(orders, state.rpm, state.rpm + heights, color=COLOURS[state.kind], linewidth=1.5, zorder=2)
        tips = heights > SEEN * scale * largest
        axes.plot(orders[tips], (state.rpm + heights)[tips], ".", color=COLOURS[state.kind], markersize=4)
    nothing = sweep.rpm[sweep.kind == "unknown"]
    axes.plot(np.full(len(nothing), highest / 100), nothing, linestyle="none", **_style("unknown", False))
    axes.set_xlim(0.0, 1.02 * highest)
    axes.annotate(f"{largest / 1e3:.3g} kN ", (highest, sweep.rpm.max() + scale * largest / 2), ha="right", va="center")
    axes.vlines(highest, sweep.rpm.max(), sweep.rpm.max() + scale * largest, color="black", linewidth=1.8)
    legend(axes, _kinds([sweep], stems=True))
    return figure


def hardest_mesh(*sweeps):
    """Name of the mesh with the largest tooth force of all known motions."""
    topology = sweeps[0][0].topology
    if not topology.mesh_names:
        raise ValueError(f"{topology.name or 'scene'} has no mesh: these pictures show tooth forces.")
    known = [state for sweep in sweeps for state in sweep if state.known]
    return max(topology.mesh_names, key=lambda mesh: max((_peaks(s, mesh).max() for s in known), default=0.0))


def _peaks(state, mesh):
    """Peak of the tooth force in each cycle, N."""
    signal = state.force(mesh)
    return np.maximum(signal.highest, -signal.lowest)


def _of_known(sweep, mesh, measure):
    """A measure of the peaks of each state in kN, nan where its motion is unknown."""
    return np.array([measure(_peaks(state, mesh)) / 1e3 if state.known else np.nan for state in sweep])


def _mark(axes, x, y, chosen, kind, *, hollow):
    """Markers of one kind of motion; unknown ones are crosses at the bottom."""
    if kind == "unknown":
        crosses(axes, x[chosen])
    elif chosen.any():
        axes.plot(x[chosen], y[chosen], linestyle="none", **_style(kind, hollow))


def _style(kind, hollow):
    """Colour, shape and size of the marker of a kind; hollow ones go around filled ones at the same place."""
    size = SIZES[kind] + (3.5 if hollow and kind != "irregular" else 0)
    face = "none" if hollow else COLOURS[kind]
    return {"marker": SHAPES[kind], "markersize": size, "color": COLOURS[kind], "markerfacecolor": face}


def _digit(axes, state, value, *, below):
    """Period of a subharmonic motion beside its marker."""
    offset = {"xytext": (0, -9 if below else 7), "textcoords": "offset points", "ha": "center"}
    place = {"va": "top" if below else "bottom", "fontsize": "small", "color": COLOURS[state.kind]}
    axes.annotate(str(state.period), (state.rpm, value), **offset, **place)


def _bars(axes, sweep, mesh, *, hollow):
    """Bars over the peaks of the cycles of irregular motions, from 5 to 95 %."""
    states = [state for state in sweep if state.kind == "irregular"]
    if states:
        low, _, high = np.transpose([np.percentile(_peaks(state, mesh), PERCENT) for state in states]) / 1e3
        style = {"linewidth": 1.5 if hollow else 6, "alpha": 1.0 if hollow else 0.35, "zorder": 2}
        axes.vlines([state.rpm for state in states], low, high, color=COLOURS["irregular"], **style)


def _title(sweep, mesh, what):
    return f"{sweep[0].topology.name or 'scene'}, {plain(mesh)}: {what}"


def _kinds(sweeps, *, irregular=None, stems=False):
    """Entries of the kinds of motion that occur."""
    said = {
        "contact": "in contact",
        "periodic": "every cycle the same",
        "subharmonic": "repeats after several cycles" + ("" if irregular or stems else " (digit)"),
        "irregular": "irregular" if irregular or stems else "irregular: largest (bar: 5-95 % of cycles)",
        "unknown": "unknown",
    }
    keys = []
    for kind in KINDS:
        if any((sweep.kind == kind).any() for sweep in sweeps):
            marker = "|" if stems and kind != "unknown" else (kind == "irregular" and irregular) or SHAPES[kind]
            keys.append(key(said[kind], marker, COLOURS[kind], markersize=9 if stems else SIZES[kind]))
    return keys


def _ways(sweeps):
    """Entries of the two directions."""
    if len(sweeps) < 2:
        return []
    says = [f"filled: {sweeps[0].direction}wards", f"hollow: {sweeps[1].direction}wards"]
    return [key(said, "o", "0.4", markerfacecolor=face) for said, face in zip(says, ("0.4", "none"), strict=True)]

"""Figures of a cycle, of a record and of a tuning."""

from itertools import pairwise

import numpy as np

from jaxhb.design.quantities import label
from jaxhb.equations import fourier
from jaxhb.equations.backlash import separated
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import Figure, above, bands, crosses, layout, line, marks, speed_range, top_of
from jaxhb.report.figures.style import plain
from jaxhb.report.quantities import forces, gear_torques, shaft_torques
from jaxhb.report.selection import default_gear, gears, hardest_shaft, meshes_of, train_name
from jaxhb.report.text.sentences import motion_text
from jaxhb.report.text.tuned import scaled_unit
from jaxhb.results.record import PERCENT

SAMPLES = 4320

PANEL = 130
"""Pixels, the height of a panel."""

SPIKES = 3
"""Cycles up to which every sample is drawn; of longer periods as many points in all."""


def plot_cycle(answer, gear=None):
    """Torque on a gear over the period of the motion, with and without backlash; below it the forces of its meshes.

    Parameters
    ----------
    answer : Answer
    gear : str, optional
        Default: the gear of the reference rotor whose torque has the largest half peak-to-peak. A train without gears
        shows its hardest worked shaft or damper.

    Returns
    -------
    matplotlib.figure.Figure
        Shaded where a mesh of the gear is in the gap; angles in deg of the reference rotor. A motion of several cycles
        is drawn with all of them. One that never repeats has no cycle to draw: extremes of the torque in each recorded
        cycle, and below the share of cycles whose largest tooth force stays below a value. An unknown one has its
        reason in the picture.

    Examples
    --------
    >>> import jaxhb
    >>> from jaxhb.report.compute import Asked, answer_one
    >>> plot_cycle(answer_one(jaxhb.load_scene("spur_pair"), 2000.0, Asked())).axes[0].get_ylabel()
    'gear torque, N m'
    """
    title = f"{train_name(answer.topology)}, {answer.rpm:g} rpm: {_kind(answer)}"
    return drawn(*cycle_figures(answer, gear), title=title)


def _kind(answer):
    """The kind of motion, or why there is none."""
    if not answer.known:
        return f"unknown: {'; '.join(answer.state.notes)}"
    return f"{answer.doubt.upper()}: {motion_text(answer)}" if answer.doubt else motion_text(answer)


def cycle_figures(answer, gear=None):
    """The figures of :func:`plot_cycle`, in a list."""
    gear = gear or default_gear(answer)
    subject = gear or hardest_shaft([answer])
    meshes = meshes_of(answer.topology, gear) if gear else ()
    torque = _torque_of(answer.train, subject)
    swings = [f"{float(torque.read(motion, subject)):.0f}" for motion in (answer, answer.linear)]
    said = f" {swings[0]} N m" if answer.known else ""
    said += f" (without backlash {swings[1]}), and tooth forces" if gear else ","
    figures = [cycle_figure(answer, subject, meshes, f"Torque of {plain(subject)}, half peak-to-peak{said}")]
    return [*figures, _peaks(answer, meshes)] if gear and _recorded(answer) else figures


def _recorded(answer):
    """Whether the motion is known from recorded cycles alone."""
    return answer.known and answer.response is None


def _torque_of(train, subject):
    """The quantity that is the torque of a gear, or of a shaft or damper."""
    return gear_torques(train) if subject in gears(train.topology) else shaft_torques(train)


def cycle_figure(answer, subject, meshes, caption):
    """Torque of a gear and forces of meshes, or torque of a shaft, over the period, or cycle by cycle where the motion
    never repeats."""
    rows = [(_torque_of(answer.train, subject), subject), *((forces(answer.train), name) for name in meshes)]
    return (_record if _recorded(answer) else _period)(answer, rows, caption)


def _period(answer, rows, caption):
    """Signals over the period of the motion, with and without backlash; grey where the teeth are apart."""
    backlash = any(answer.topology.mesh_backlash)
    traces, shapes, notes = [], [], []
    for panel, (quantity, name) in enumerate(rows):
        more = {"panel": panel, "showlegend": backlash and not panel}
        if answer.known:
            after = quantity.signal(answer, name)
            said = "with backlash" if backlash else plain(name)
            traces.append(_sampled(answer, quantity.factor, after, said, 0, **more))
        if backlash or not answer.known:
            before = quantity.signal(answer.linear, name)
            traces.append(_sampled(answer, quantity.factor, before, "without backlash", 1, **more))
        meshes = {"gear": meshes_of, "mesh": lambda _, mesh: (mesh,)}.get(quantity.element, lambda *_: ())
        apart = [in_the_gap(answer, mesh, count_of(answer)) for mesh in meshes(answer.topology, name) if answer.known]
        edges = _edges(np.any(apart, axis=0)) * answer.cycle_deg / SAMPLES if apart else []
        shapes += bands(edges, rows=f"y{panel + 1 if panel else ''} domain")
        notes.append(above(plain(name), panel))
    zero = " (0: firing top dead centre of a cylinder with firing angle 0)" if answer.topology.cylinder_names else ""
    end, title = answer.cycle_deg * periods_of(answer), f"angle of the reference rotor, deg{zero}"
    made = _layout(title, rows, traces, notes, end, shapes=shapes)
    if periods_of(answer) > 1:
        made["xaxis"] |= {"dtick": answer.cycle_deg, "gridcolor": "black"}
    elif answer.cycle_deg % 90 == 0:
        made["xaxis"] |= {"dtick": 90}
    more = "" if answer.known else ", without backlash alone"
    more += "; grey: its teeth are apart" if shapes else ""
    return Figure(f"{caption} over the period{more}", traces, made)


def _layout(title, rows, traces, notes, end, **more):
    """The layout of a panel for every row, the legend beside the name of the first."""
    panels = [(f"{quantity.called}, {quantity.unit}", None) for quantity, _ in rows]
    more |= {"heights": [PANEL] * len(panels), "annotations": notes, "x_range": (0.0, end)}
    made = layout(title, panels, traces, **more)
    made["legend"] |= {"x": 1, "xanchor": "right"}
    return made


def _sampled(answer, factor, signal, name, style, **more):
    """A signal over the whole period."""
    step = max(1, periods_of(answer) // SPIKES)
    trace = line([], factor * np.asarray(closed(answer, signal))[::step], name, style, **more)
    trace["line"] |= {"width": 1.1}
    # Equal steps: a start and a step in place of all angles keep the page small.
    del trace["x"]
    return trace | {"x0": 0.0, "dx": answer.cycle_deg * periods_of(answer) / count_of(answer) * step}


def _edges(apart):
    """Pairs of time samples ``(n, 2)`` between which teeth are apart."""
    steps = np.diff(np.concatenate([[0], apart.astype(int), [0]]))
    return np.stack([np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)], axis=1)


def _record(answer, rows, caption):
    """A motion that never repeats: extremes of every recorded cycle, and those without backlash."""
    traces, notes = [], []
    for panel, (quantity, name) in enumerate(rows):
        after, before = quantity.signal(answer, name), quantity.signal(answer.linear, name)
        more = {"panel": panel, "showlegend": not panel, "size": 5}
        cycles = np.arange(1, len(after.highest) + 1)
        traces += [
            marks(cycles, quantity.factor * after.highest, "largest of a cycle", "triangle-up", **more),
            marks(cycles, quantity.factor * after.lowest, "smallest of a cycle", "triangle-down-open", **more),
        ]
        shares = [f"{share} % of the cycles" for share in PERCENT]
        levels = [
            (value, said, 0) for extremes in after.per_cycle for value, said in zip(extremes, shares, strict=True)
        ]
        levels += [(before.max, "extremes without backlash", 1), (before.min, "extremes without backlash", 1)]
        for number, (value, said, style) in enumerate(levels):
            more = {"panel": panel, "showlegend": not panel and number == len(levels) - 1}
            traces.append(line(cycles[[0, -1]], [quantity.factor * float(value)] * 2, said, style, **more))
            traces[-1]["line"] |= {} if style else {"width": 0.8}
        notes.append(above(plain(name), panel))
    made = _layout("recorded cycle", rows, traces, notes, len(cycles) + 1.0)
    said = "extremes of every recorded cycle (lines: 5, 50, 95 % of them); the motion never repeats"
    return Figure(f"{caption}, {said}", traces, made)


def _peaks(answer, names):
    """Share of the recorded cycles whose largest tooth force stays below a value."""
    quantity, traces = forces(answer.train), []
    for number, name in enumerate(names):
        peaks = quantity.factor * np.sort(answer.force(name).highest)
        shares = 100 * np.arange(1, len(peaks) + 1) / len(peaks)
        traces.append(line(peaks, shares, plain(name), number))
        traces[-1]["line"] |= {"shape": "hv"}
        before = [quantity.factor * float(answer.linear.force(name).max)] * 2
        traces.append(line(before, [0.0, 100.0], "without backlash", number, showlegend=not number))
        traces[-1]["line"] |= {"width": 0.8}
    made = layout(f"largest tooth force of a cycle, {quantity.unit}", [("cycles below it, %", (0.0, 103.0))], traces)
    return Figure("Cycles whose largest tooth force stays below a value", traces, made)


def plot_tuning(objectives, result):
    """What was made small over the speed, before and after, and the history of the tuning below.

    Parameters
    ----------
    objectives : sequence of Objective
    result : Tuning

    Returns
    -------
    matplotlib.figure.Figure
        One panel for each objective, with gaps at speeds that are not solved and crosses at those that never were, and
        one for the history: the objective, 1 at the start but for smoothing, with a line where the smooth maximum was
        sharpened.
    """
    figures, axis = [], speed_range(result.rpm)
    for objective in objectives:
        name, (factor, unit) = label(objective), scaled_unit(objective.quantity)
        traces = [
            line(result.rpm, factor * reading.readings[name], said, style, mode="lines+markers")
            for style, (said, reading) in enumerate((("before", result.before), ("after", result.after)))
        ]
        panels = [(f"{objective.quantity}, {unit}".removesuffix(", "), top_of(*(trace["y"] for trace in traces)))]
        traces += crosses(result.rpm[~(result.before.solved | result.after.solved)])
        figures.append(Figure(plain(name), traces, layout("speed, rpm", panels, traces, x_range=axis)))
    steps, values = zip(*((step.number, step.objective) for step in result.history), strict=True)
    sharper = [one.number + 0.5 for one, after in pairwise(result.history) if after.width != one.width]
    highest = top_of(values)
    traces = [line(steps, values, "objective, 1 at the start", 1, mode="lines+markers")]
    traces += [
        line([step] * 2, highest, "smooth maximum sharpened", 3, showlegend=step == sharper[0]) for step in sharper
    ]
    figures.append(Figure("History of the tuning", traces, layout("step", [("objective", highest)], traces)))
    return drawn(*figures, title=result.train.topology.title)


def in_the_gap(answer, mesh, count):
    """Whether the teeth are apart at ``count`` time samples of the period."""
    apart = separated(answer.response.law.expand(), answer.response.deflection_samples(count))
    return np.asarray(apart)[answer.topology.mesh_names.index(mesh)]


def periods_of(answer):
    """Cycles that are drawn."""
    return max(answer.state.period, 1)


def count_of(answer):
    return SAMPLES * periods_of(answer)


def closed(answer, signal):
    """Samples of the whole period, its first time sample again at the end; a cycle comes as often as there is room."""
    turns = signal.revolutions_per_cycle / answer.topology.revolutions_per_cycle
    times = round(periods_of(answer) / turns)
    values = np.tile(np.asarray(fourier.sample(signal.coefficients, count_of(answer) // times)), times)
    return np.append(values, values[0])

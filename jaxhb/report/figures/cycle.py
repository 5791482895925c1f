"""Figures of a cycle, of a record and of a tuning."""

import itertools
import math
from itertools import pairwise

import numpy as np

from jaxhb.design.quantities import label
from jaxhb.equations import fourier
from jaxhb.equations.backlash import separated
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import (
    above,
    bands,
    bars,
    crosses,
    figure,
    line,
    marks,
    plain,
    speed_range,
    spread_bars,
    top_of,
)
from jaxhb.report.quantities import forces, gear_torques, shaft_torques
from jaxhb.report.selection import meshes_of, subject_of, train_name
from jaxhb.report.text.columns import plain_number
from jaxhb.report.text.sentences import motion_text
from jaxhb.report.text.tuned import scaled_unit
from jaxhb.results.record import PERCENT

SAMPLES = 4320

PANEL = 130  # pixels, the height of a panel
MOST_TICKS = 12  # steps of an axis of angles, whose numbers have up to five digits
FOOT = 0.012  # width of a bar, as a share of the recorded cycles
# Cycles up to which every sample is drawn; of longer periods as many points in all
SPIKES = 3


def plot_cycle(answer, gear=None):
    """Torque on a gear over the period of the motion, with and without backlash; below
    it the forces of its meshes.

    Shaded where a mesh of the gear is in the gap. A motion of several cycles is drawn
    with all of them; one that never repeats by the extremes of every recorded cycle,
    and below by the share of cycles whose largest tooth force stays below a value. The
    gear is by default that of the reference rotor whose torque swings most; a train
    without gears shows its hardest worked shaft or damper.
    """
    kind = (
        motion_text(answer)
        if answer.known
        else f"unknown: {'; '.join(answer.state.notes)}"
    )
    doubt = f"{answer.doubt.upper()}: " if answer.doubt else ""
    subject, meshes = subject_of(answer, gear)
    torque = _torque_of(answer.train, subject)
    swings = [
        plain_number(float(torque.read(motion, subject)))
        for motion in (answer, answer.without_backlash)
    ]
    said = f" {swings[0]} N m" if answer.known else ""
    said += f" (without backlash {swings[1]}), and tooth forces" if meshes else ","
    figures = [
        cycle_figure(
            answer,
            subject,
            meshes,
            f"Torque of {plain(subject)}, half peak-to-peak{said}",
        )
    ]
    figures += [_peaks(answer, meshes)] if meshes and answer.recorded else []
    return drawn(
        *figures,
        title=f"{train_name(answer.topology)}, {answer.rpm:g} rpm: {doubt}{kind}",
    )


def _torque_of(train, subject):
    """The quantity that is the torque of a gear, or of a shaft or damper."""
    return (
        gear_torques(train)
        if subject in train.topology.gear_names
        else shaft_torques(train)
    )


def cycle_figure(answer, subject, meshes, caption):
    """Torque of a gear and forces of meshes, or torque of a shaft, over the period, or
    cycle by cycle where the motion never repeats.
    """
    rows = [
        (_torque_of(answer.train, subject), subject),
        *((forces(answer.train), name) for name in meshes),
    ]
    said, title, end, traces, shapes = (_record if answer.recorded else _period)(
        answer, rows
    )
    panels = [(f"{quantity.called}, {quantity.unit}", None) for quantity, _ in rows]
    more = {"x_range": (0.0, end), "height": PANEL, "shapes": shapes}
    notes = [above(plain(name), panel) for panel, (_, name) in enumerate(rows)]
    made = figure(f"{caption}{said}", title, panels, traces, annotations=notes, **more)
    made.layout["legend"] |= {
        "x": 1,
        "xanchor": "right",
    }  # beside the name of the first panel
    if not answer.recorded and end > answer.cycle_deg:
        cycles = math.ceil(end / answer.cycle_deg / MOST_TICKS)
        made.layout["xaxis"] |= {
            "dtick": answer.cycle_deg * cycles,
            "gridcolor": "black",
        }
    elif not answer.recorded and answer.cycle_deg % 90 == 0:
        made.layout["xaxis"] |= {
            "dtick": next(step for step in _quarters() if end <= MOST_TICKS * step)
        }
    return made


def _quarters():
    """Steps of an axis of angles: a quarter of a revolution and so many times it that
    whole revolutions are met.
    """
    return (90 * 2**k for k in itertools.count())


def _period(answer, rows):
    """Signals over the period of the motion, with and without backlash; grey where the
    teeth are apart.
    """
    backlash = any(answer.topology.mesh_backlash)
    traces = []
    shapes = []
    beside = answer.without_backlash
    # A motion that never repeats has no samples, one that is not known nothing at all.
    compared = (backlash or not answer.known) and beside.known and not beside.recorded
    motions = [(answer, 0)] * answer.known + [(beside, 1)] * compared
    periods = math.lcm(*(max(motion.state.period, 1) for motion, _ in motions))
    step = max(1, periods // SPIKES)
    end = answer.cycle_deg * periods
    for panel, (quantity, name) in enumerate(rows):
        for motion, style in motions:
            said = (
                "without backlash"
                if style
                else "with backlash"
                if backlash
                else plain(name)
            )
            signal = quantity.signal_for_people(answer, motion, name)
            values = quantity.factor * _repeated(motion, signal, periods)[::step]
            more = {
                "panel": panel,
                "showlegend": backlash and not panel,
                "look": {"width": 1.1},
            }
            # Equal steps: a start and a step in place of all angles keep the page
            # small.
            traces.append(
                line(
                    [],
                    values,
                    said,
                    style,
                    x0=0.0,
                    dx=end / (SAMPLES * periods) * step,
                    **more,
                )
            )
            del traces[-1]["x"]
        meshes = {"gear": meshes_of, "mesh": lambda _, mesh: (mesh,)}.get(
            quantity.element, lambda *_: ()
        )
        own = meshes(answer.topology, name) if answer.known else ()
        times = periods // max(answer.state.period, 1)
        apart = [
            np.tile(in_the_gap(answer, mesh, SAMPLES * periods // times), times)
            for mesh in own
        ]
        if apart:
            steps = np.flatnonzero(
                np.diff(np.pad(np.any(apart, axis=0).astype(int), 1))
            )
            shapes += bands(steps.reshape(-1, 2) * answer.cycle_deg / SAMPLES, panel)
    zero = (
        " (0: firing top dead centre of a cylinder with firing angle 0)"
        if answer.topology.cylinder_names
        else ""
    )
    said = " over the period" + (
        ", without backlash alone" if compared and not answer.known else ""
    )
    said += "; grey: its teeth are apart" if shapes else ""
    return said, f"angle of the reference rotor, deg{zero}", end, traces, shapes


def _record(answer, rows):
    """A motion that never repeats: extremes of every recorded cycle, and those without
    backlash.
    """
    traces = []
    for panel, (quantity, name) in enumerate(rows):
        after, before = (
            quantity.signal_for_people(answer, one, name)
            for one in (answer, answer.without_backlash)
        )
        factor = quantity.factor
        cycles = np.arange(1, len(after.highest) + 1)
        more = {"panel": panel, "showlegend": not panel}
        traces.append(
            marks(
                cycles,
                factor * after.highest,
                "largest of a cycle",
                "triangle-up",
                size=5,
                **more,
            )
        )
        traces.append(
            marks(
                cycles,
                factor * after.lowest,
                "smallest of a cycle",
                "triangle-down-open",
                size=5,
                **more,
            )
        )
        of_cycles = f"{', '.join(map(str, PERCENT))} % of the cycles"
        levels = (
            (of_cycles, np.ravel([after.per_cycle.max, after.per_cycle.min]), 0.8),
            ("without backlash", (before.max, before.min), 1.6),
        )
        for style, (said, values, width) in enumerate(levels):
            x = np.tile([1, len(cycles), np.nan], len(values))
            y = np.repeat(factor * np.array(values, float), 3)
            traces.append(line(x, y, said, style, look={"width": width}, **more))
        extremes = np.array([after.max, after.min])
        spread = np.array([after.spread.max, after.spread.min])
        at = np.array([np.argmax(after.highest), np.argmin(after.lowest)]) + 1
        traces += spread_bars(
            at, factor * extremes, factor * spread, FOOT * len(cycles), **more
        )
    said = ", extremes of every recorded cycle; the motion never repeats"
    return said, "recorded cycle", len(cycles) + 1.0, traces, ()


def _peaks(answer, names):
    """Share of the recorded cycles whose largest tooth force stays below a value."""
    quantity = forces(answer.train)
    traces = []
    for number, name in enumerate(names):
        peaks = quantity.factor * np.sort(answer.force(name).peaks)
        shares = 100 * np.arange(1, len(peaks) + 1) / len(peaks)
        traces.append(line(peaks, shares, plain(name), number, look={"shape": "hv"}))
        before = [quantity.factor * float(answer.without_backlash.force(name).peak)] * 2
        more = {"look": {"width": 0.8}, "showlegend": not number}
        traces.append(line(before, [0.0, 100.0], "without backlash", number, **more))
    caption = "Cycles whose largest tooth force stays below a value"
    title = "largest tooth force of a cycle"
    return figure(
        caption,
        f"{title}, {quantity.unit}",
        [("cycles below it, %", (0.0, 103.0))],
        traces,
    )


def plot_tuning(objectives, result):
    """What was made small over the speed, before and after, and the history of the
    tuning below.

    A panel for each objective, with crosses at speeds that were never solved; in the
    history, 1 at the start but for smoothing, a line where the smooth maximum was
    sharpened.
    """
    figures = []
    axis = speed_range(result.rpm)
    for objective in objectives:
        name = label(objective)
        (factor, unit) = scaled_unit(objective.quantity)
        designs = {"before": result.before, "after": result.after}
        traces = []
        for style, (said, design) in enumerate(designs.items()):
            checked = result.checked.get(said)  # between the speeds, too
            rpm, readings = (
                (checked.rpm, checked.readings)
                if checked
                else (result.rpm, design.readings)
            )
            traces.append(
                line(rpm, factor * readings[name], said, style, mode="lines+markers")
            )
        said = f"{objective.quantity}, {unit}".removesuffix(", ")
        traces += crosses(result.rpm[~(result.before.solved | result.after.solved)])
        figures.append(figure(plain(name), "speed, rpm", said, traces, x_range=axis))
    steps, values = zip(
        *((step.number, step.objective) for step in result.history), strict=True
    )
    traces = [line(steps, values, "objective", 1, mode="lines+markers")]
    panels = [("objective", top_of(traces))]
    sharper = [
        one.number + 0.5
        for one, after in pairwise(result.history)
        if after.width != one.width
    ]
    if sharper:
        low, high = np.broadcast_to(panels[0][1], (len(sharper), 2)).T
        traces.append(
            bars(
                sharper,
                low,
                high,
                "smooth maximum sharpened",
                look={"color": "grey", "dash": "dot"},
            )
        )
    figures.append(
        figure(
            "History of the tuning: the objective, 1 at the start",
            "step",
            panels,
            traces,
        )
    )
    return drawn(*figures, title=result.train.topology.title)


def in_the_gap(answer, mesh, count):
    """Whether the teeth are apart at ``count`` time samples of the period."""
    apart = separated(
        answer.response.law.expand(), answer.response.deflection_samples(count)
    )
    return np.asarray(apart)[answer.topology.mesh_names.index(mesh)]


def _repeated(answer, signal, cycles):
    """Samples of a signal over some cycles, as often as its period fits into them, the
    first again at the end.
    """
    times = round(
        cycles * answer.topology.revolutions_per_cycle / signal.revolutions_per_cycle
    )
    values = np.tile(
        np.asarray(fourier.sample(signal.coefficients, SAMPLES * cycles // times)),
        times,
    )
    return np.append(values, values[0])

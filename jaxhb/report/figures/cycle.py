"""Figures of a cycle, of a record and of a tuning."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from jaxhb.design.quantities import Objective, label
from jaxhb.equations import fourier
from jaxhb.equations.backlash import separated
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import (
    Axis,
    Band,
    Figure,
    Trace,
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
from jaxhb.report.quantities import Quantity, forces, gear_torques, shaft_torques
from jaxhb.report.selection import meshes_of, subject_of, train_name
from jaxhb.report.text.columns import plain_number
from jaxhb.report.text.sentences import motion_text
from jaxhb.report.text.tuned import scaled_unit
from jaxhb.results.record import PERCENT

if TYPE_CHECKING:
    from jaxhb.design.tuning import Tuning
    from jaxhb.report.answer import Answer
    from jaxhb.report.figures.draw import Picture
    from jaxhb.results.record import SteadySignal
    from jaxhb.train.drivetrain import DriveTrain

SAMPLES = 4320

PANEL = 130  # pixels, the height of a panel
# Panels up to which each is as high, and the height of more
FEW = 3
LOW_PANEL = 96
MOST_TICKS = 12  # steps of an axis of angles, whose numbers have up to five digits
FOOT = 0.012  # width of a bar, as a share of the recorded cycles
# Cycles up to which every sample is drawn; of longer periods as many points in all
SPIKES = 3


def plot_cycle(answer: Answer, gear: str | None = None) -> Picture:
    """Draw the torque on a gear over the period of the motion, with and without
    backlash; below it the forces of its meshes.

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
    assert subject is not None  # trains without torques are refused before
    torque = _torque_of(answer.train, subject)
    swings = [
        plain_number(torque.factor * float(torque.read(motion, subject)))
        for motion in (answer, answer.without_backlash)
    ]
    values = f" {swings[0]} {torque.unit}" if answer.known else ""
    values += f" (without backlash {swings[1]}), and tooth forces" if meshes else ","
    caption = f"Torque of {plain(subject)}, half peak-to-peak{values}"
    figures = [cycle_figure(answer, subject, meshes, caption)]
    figures += [_peaks(answer, meshes)] if meshes and answer.recorded else []
    return drawn(
        *figures,
        title=f"{train_name(answer.topology)}, {answer.rpm:g} rpm: {doubt}{kind}",
    )


def _torque_of(train: DriveTrain, subject: str) -> Quantity:
    """Return the quantity that is the torque of a gear, or of a shaft or damper."""
    return (
        gear_torques(train)
        if subject in train.topology.gear_names
        else shaft_torques(train)
    )


def cycle_figure(
    answer: Answer, subject: str, meshes: Sequence[str], caption: str
) -> Figure:
    """Make the figure of the torque of a gear and forces of meshes, or of the torque of
    a shaft, over the period, or cycle by cycle where the motion never repeats.
    """
    rows = [
        (_torque_of(answer.train, subject), subject),
        *((forces(answer.train), name) for name in meshes),
    ]
    curves = _record if answer.recorded else _period
    remark, x_title, end, traces, shaded = curves(answer, rows)
    angles = Axis(x_title, (0.0, end))
    if not answer.recorded and end > answer.cycle_deg:
        cycles = math.ceil(end / answer.cycle_deg / MOST_TICKS)
        angles = replace(angles, step=answer.cycle_deg * cycles, grid="black")
    elif not answer.recorded and answer.cycle_deg % 90 == 0:
        step = next(step for step in _quarters() if end <= MOST_TICKS * step)
        angles = replace(angles, step=step)
    spec = figure(
        f"{caption}{remark}",
        angles,
        [Axis(f"{quantity.called}, {quantity.unit}") for quantity, _ in rows],
        traces,
        height=PANEL if len(rows) <= FEW else LOW_PANEL,
        bands=shaded,
        notes=[above(plain(name), panel) for panel, (_, name) in enumerate(rows)],
    )
    # The legend stands beside the name of the first panel.
    return replace(spec, legend="right")


def _quarters() -> Iterator[int]:
    """Yield steps of an axis of angles: a quarter of a revolution, times powers of 2 so
    that whole revolutions are met.
    """
    return (90 * 2**k for k in itertools.count())


Curves = tuple[str, str, float, list[Trace], Sequence[Band]]
"""Remark in the caption, title and end of the axis, traces and bands."""


def _period(answer: Answer, rows: Sequence[tuple[Quantity, str]]) -> Curves:
    """Draw signals over the period of the motion, with and without backlash; grey where
    the teeth are apart.
    """
    backlash = any(answer.topology.mesh_backlash)
    traces = []
    shaded: list[Band] = []
    without = answer.without_backlash
    # A motion that never repeats has no samples, one that is not known nothing at all.
    compared = (backlash or not answer.known) and without.known and not without.recorded
    motions = [(answer, 0)] * answer.known + [(without, 1)] * compared
    periods = math.lcm(*(max(motion.state.period, 1) for motion, _ in motions))
    step = max(1, periods // SPIKES)
    end = answer.cycle_deg * periods
    for panel, (quantity, name) in enumerate(rows):
        for motion, style in motions:
            words = "with backlash" if backlash else plain(name)
            words = "without backlash" if style else words
            signal = quantity.signal_for_people(answer, motion, name)
            values = quantity.factor * _repeated(motion, signal, periods)[::step]
            # Equal steps: a start and a step in place of all angles keep the page
            # small.
            trace = line(
                [],
                values,
                words,
                style,
                x0=0.0,
                dx=end / (SAMPLES * periods) * step,
                panel=panel,
                showlegend=backlash and not panel,
                look={"width": 1.1},
            )
            del trace["x"]
            traces.append(trace)
        meshes: Sequence[str] = ()
        if answer.known and quantity.element == "gear":
            meshes = meshes_of(answer.topology, name)
        elif answer.known and quantity.element == "mesh":
            meshes = (name,)
        times = periods // max(answer.state.period, 1)
        apart = [
            np.tile(in_the_gap(answer, mesh, SAMPLES * periods // times), times)
            for mesh in meshes
        ]
        if apart:
            steps = np.flatnonzero(
                np.diff(np.pad(np.any(apart, axis=0).astype(int), 1))
            )
            shaded += bands(steps.reshape(-1, 2) * answer.cycle_deg / SAMPLES, panel)
    zero = (
        " (0: firing top dead centre of a cylinder with firing angle 0)"
        if answer.topology.cylinder_names
        else ""
    )
    remark = " over the period"
    remark += ", without backlash alone" if compared and not answer.known else ""
    remark += "; grey: its teeth are separated" if shaded else ""
    return remark, f"angle of the reference rotor, deg{zero}", end, traces, shaded


def _record(answer: Answer, rows: Sequence[tuple[Quantity, str]]) -> Curves:
    """Draw a motion that never repeats: extremes of every recorded cycle, and those
    without backlash.
    """
    traces = []
    for panel, (quantity, name) in enumerate(rows):
        after = quantity.signal_for_people(answer, answer, name)
        before = quantity.signal_for_people(answer, answer.without_backlash, name)
        factor = quantity.factor
        count = len(after.highest)
        cycles = np.arange(1, count + 1)
        in_legend = not panel
        traces += [
            marks(
                cycles,
                factor * values,
                f"{which} of a cycle",
                symbol,
                size=5,
                panel=panel,
                showlegend=in_legend,
            )
            for values, which, symbol in (
                (after.highest, "largest", "triangle-up"),
                (after.lowest, "smallest", "triangle-down-open"),
            )
        ]
        percentiles = f"{', '.join(map(str, PERCENT))} % of the cycles"
        levels: Sequence[tuple[str, Sequence[float] | np.ndarray, float]] = (
            (percentiles, np.ravel([after.per_cycle.max, after.per_cycle.min]), 0.8),
            ("without backlash", (before.max, before.min), 1.6),
        )
        for style, (words, values, width) in enumerate(levels):
            traces.append(
                line(
                    np.tile([1, count, np.nan], len(values)),
                    np.repeat(factor * np.array(values, float), 3),
                    words,
                    style,
                    look={"width": width},
                    panel=panel,
                    showlegend=in_legend,
                )
            )
        traces += spread_bars(
            np.array([np.argmax(after.highest), np.argmin(after.lowest)]) + 1,
            factor * np.array([after.max, after.min]),
            factor * np.array([after.spread.max, after.spread.min]),
            FOOT * count,
            panel=panel,
            showlegend=in_legend,
        )
    remark = ", extremes of every recorded cycle"
    if answer.state.kind == "irregular":
        remark += "; the motion never repeats"
    return remark, "recorded cycle", count + 1.0, traces, ()


def _peaks(answer: Answer, names: Sequence[str]) -> Figure:
    """Make the figure of the share of the recorded cycles whose largest tooth force
    stays below a value.
    """
    quantity = forces(answer.train)
    traces = []
    for number, name in enumerate(names):
        peaks = quantity.factor * np.sort(answer.force(name).peaks)
        shares = 100 * np.arange(1, len(peaks) + 1) / len(peaks)
        traces.append(line(peaks, shares, plain(name), number, look={"shape": "hv"}))
        before = quantity.factor * float(answer.without_backlash.force(name).peak)
        traces.append(
            line(
                [before, before],
                [0.0, 100.0],
                "without backlash",
                number,
                look={"width": 0.8},
                showlegend=not number,
            )
        )
    return figure(
        "Cycles whose largest tooth force stays below a value",
        Axis(f"largest tooth force of a cycle, {quantity.unit}"),
        [Axis("cycles below it, %", (0.0, 103.0))],
        traces,
    )


def plot_tuning(objectives: Sequence[Objective], result: Tuning) -> Picture:
    """Draw the objectives over the speed, before and after, and the history of the
    tuning below.

    A panel for each objective, with crosses at speeds that were never solved; in the
    history, 1 at the start but for smoothing, a line where the smooth maximum was
    sharpened.
    """
    figures = []
    axis = Axis("speed, rpm", speed_range(result.rpm))
    for objective in objectives:
        name = label(objective)
        (factor, unit) = scaled_unit(objective.quantity)
        designs = {"before": result.before, "after": result.after}
        traces = []
        for style, (when, design) in enumerate(designs.items()):
            checked = result.checked.get(when)  # between the speeds, too
            rpm = checked.rpm if checked else result.rpm
            readings = checked.readings if checked else design.readings
            values = factor * readings[name]
            traces.append(line(rpm, values, when, style, mode="lines+markers"))
        y_title = f"{objective.quantity}, {unit}".removesuffix(", ")
        traces += crosses(result.rpm[~(result.before.solved | result.after.solved)])
        figures.append(figure(plain(name), axis, y_title, traces))
    numbers = [step.number for step in result.history]
    values = [step.objective for step in result.history]
    traces = [line(numbers, values, "objective", 1, mode="lines+markers")]
    low, high = top_of(traces)
    sharper = [
        step.number + 0.5
        for step, after in pairwise(result.history)
        if after.width != step.width
    ]
    if sharper:
        traces.append(
            bars(
                sharper,
                [low] * len(sharper),
                [high] * len(sharper),
                "smooth maximum sharpened",
                look={"color": "grey", "dash": "dot"},
            )
        )
    figures.append(
        figure(
            "History of the tuning: the objective, 1 at the start",
            Axis("step"),
            [Axis("objective", (low, high))],
            traces,
        )
    )
    return drawn(*figures, title=result.train.topology.title)


def in_the_gap(answer: Answer, mesh: str, count: int) -> np.ndarray:
    """Tell whether the teeth are apart at ``count`` time samples of the period
    ``(count,)``.
    """
    response = answer.response
    assert response is not None  # recorded cycles have no samples
    apart = separated(response.law.expand(), response.deflection_samples(count))
    return np.asarray(apart)[answer.topology.mesh_names.index(mesh)]


def _repeated(answer: Answer, signal: SteadySignal, cycles: int) -> np.ndarray:
    """Sample a signal over some cycles, as often as its period fits into them, the
    first sample again at the end.
    """
    times = round(
        cycles * answer.topology.revolutions_per_cycle / signal.revolutions_per_cycle
    )
    values = np.tile(
        np.asarray(fourier.sample(signal.coefficients, SAMPLES * cycles // times)),
        times,
    )
    return np.append(values, values[0])

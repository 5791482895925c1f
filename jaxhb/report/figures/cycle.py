"""Pictures of a cycle, of a record and of a tuning."""

import textwrap

import numpy as np

from jaxhb.design.quantities import label
from jaxhb.equations import fourier
from jaxhb.equations.backlash import separated
from jaxhb.report.figures.style import GAP, MESH_COLOURS, WITH, WITHOUT, crosses, new_figure, plain
from jaxhb.report.selection import default_gear, hardest_shaft, meshes_of, train_name
from jaxhb.report.text.sentences import motion_text
from jaxhb.report.text.tuned import scaled_unit
from jaxhb.results.record import PERCENT

SAMPLES = 4320


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
    'torque, N m'
    """
    gear = gear or default_gear(answer)
    if gear is None:
        return _plot_shaft(answer)
    figure = new_figure(6.2)
    recorded = answer.known and answer.response is None
    above, below = figure.subplots(2, 1, sharex=not recorded, height_ratios=(3, 2))
    swings = [f"{float(r.gear_torque(gear).half_peak_to_peak):.0f}" for r in (answer, answer.linear)]
    subject = f"torque that {gear} passes on, half peak-to-peak {swings[0] if answer.known else '-'} N m"
    kind = textwrap.fill(motion_text(answer), 110) if answer.known else ""
    kind = f"{answer.doubt.upper()}: {kind}" if answer.doubt and not answer.answered else kind
    title = f"{_title(answer)}: {subject} (without backlash {swings[1]})\n{kind}"
    above.set_title(title, fontsize="medium")
    above.set_ylabel("torque, N m")
    if recorded:
        _draw_record(answer, above, answer.gear_torque(gear), answer.linear.gear_torque(gear))
        _draw_peaks(answer, below, meshes_of(answer.topology, gear))
    else:
        _draw_period(answer, above, answer.gear_torque(gear), answer.linear.gear_torque(gear))
        _draw_forces(answer, below, meshes_of(answer.topology, gear))
        apart = [in_the_gap(answer, name, count_of(answer)) for name in meshes_of(answer.topology, gear)]
        for axes in (above, below):
            _shade(axes, angles_of(answer), np.any(apart, axis=0))
        _finish(below, answer)
    for axes in (above, below):
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.15 * (high - low) * (not recorded or axes is above))  # room for the legend
        axes.legend(loc="best" if recorded and axes is below else "upper right", fontsize="small", ncols=3)
    return figure


def _draw_period(answer, axes, after, before):
    """A signal over the period of the motion, and without backlash."""
    angles = angles_of(answer)
    if answer.known:
        axes.plot(angles, closed(answer, after), color=WITH, linewidth=1.1, label="with backlash")
    else:
        _say_unknown(answer, axes)
    label = "without backlash"
    axes.plot(angles, closed(answer, before), color=WITHOUT, linewidth=1.3, linestyle="--", label=label)
    axes.axhline(0.0, color="black", linewidth=0.6)


def _draw_forces(answer, axes, names):
    """Tooth forces of meshes over the period of the motion, and without backlash."""
    angles = angles_of(answer)
    for number, name in enumerate(names):
        colour = MESH_COLOURS[number % len(MESH_COLOURS)]
        if answer.known:
            force = closed(answer, answer.force(name)) / 1e3
            axes.plot(angles, force, color=colour, linewidth=1.0, label=plain(name))
        before = closed(answer, answer.linear.force(name)) / 1e3
        axes.plot(angles, before, color=colour, linewidth=0.9, linestyle="--", alpha=0.6)
    # One grey key stands for the dashed lines of all colours.
    axes.plot([], [], color="grey", linewidth=0.9, linestyle="--", label="without backlash")
    axes.axhline(0.0, color="black", linewidth=0.6)
    axes.set_ylabel("tooth force, kN")


def _draw_record(answer, axes, after, before):
    """Largest and smallest value in each recorded cycle, their percentiles, and the extremes without backlash."""
    cycles = np.arange(1, len(after.highest) + 1)
    axes.plot(cycles, after.highest, "^", color=WITH, markersize=4, label="largest of a cycle")
    axes.plot(cycles, after.lowest, "v", color=WITH, markersize=4, label="smallest of a cycle")
    for extremes in after.per_cycle:
        for share, value in zip(PERCENT, extremes, strict=True):
            axes.axhline(value, color=WITH, linewidth=0.7 if share != 50 else 1.2, alpha=0.5)
    for value in (float(before.max), float(before.min)):
        axes.axhline(value, color=WITHOUT, linewidth=1.3, linestyle="--")
    axes.plot([], [], color=WITH, linewidth=0.9, alpha=0.5, label="5, 50, 95 % of the cycles")
    axes.plot([], [], color=WITHOUT, linewidth=1.3, linestyle="--", label="extremes without backlash")
    axes.axhline(0.0, color="black", linewidth=0.6)
    axes.set_xlabel("recorded cycle")
    axes.set_xlim(0.0, len(cycles) + 1.0)


def _draw_peaks(answer, axes, names):
    """Share of the recorded cycles whose largest tooth force stays below a value."""
    for number, name in enumerate(names):
        colour = MESH_COLOURS[number % len(MESH_COLOURS)]
        peaks = np.sort(answer.force(name).highest) / 1e3
        shares = 100 * np.arange(1, len(peaks) + 1) / len(peaks)
        axes.step(peaks, shares, where="post", color=colour, linewidth=1.2, label=plain(name))
        before = float(answer.linear.force(name).max) / 1e3
        axes.axvline(before, color=colour, linewidth=0.9, linestyle="--", alpha=0.6)
    axes.plot([], [], color="grey", linewidth=0.9, linestyle="--", label="without backlash")
    axes.set_xlabel("largest tooth force of a cycle, kN")
    axes.set_ylabel("cycles below it, %")
    axes.set_ylim(0.0, 103.0)


def _say_unknown(answer, axes):
    text = textwrap.fill(f"unknown: {'; '.join(answer.state.notes)}", 70)
    axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes)


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
    count = len(objectives)
    figure = new_figure(2.2 + 2.8 * count)
    *panels, below = figure.subplots(count + 1, 1)
    for axes, objective in zip(panels, objectives, strict=True):
        name, (factor, unit) = label(objective), scaled_unit(objective.quantity)
        for reading, colour, said in ((result.before, WITH, "before"), (result.after, WITHOUT, "after")):
            axes.plot(result.rpm, factor * reading.readings[name], color=colour, marker="o", markersize=3, label=said)
        crosses(axes, result.rpm[~(result.before.solved | result.after.solved)])
        axes.set_ylabel(f"{objective.quantity}{', ' + unit if unit else ''}")
        axes.set_title(f"{result.train.topology.name or 'scene'}: {plain(name)}", fontsize="medium")
        axes.set_ylim(bottom=0.0)
        axes.legend(loc="upper left", fontsize="small")
    panels[-1].set_xlabel("speed, rpm")
    steps = [step.number for step in result.history]
    below.plot(steps, [step.objective for step in result.history], color=WITHOUT, marker="o", markersize=3)
    for step, following in zip(result.history, result.history[1:], strict=False):
        if following.width != step.width:
            below.axvline(step.number + 0.5, color="grey", linewidth=0.8, linestyle=":")
    below.set_xlabel("step")
    below.set_ylabel("objective, 1: start")
    below.set_ylim(bottom=0.0)
    return figure


def in_the_gap(answer, mesh, count):
    """Whether the teeth are apart at ``count`` time samples of the period; nowhere where the motion is unknown."""
    if not answer.known:
        return np.zeros(count, dtype=bool)
    apart = separated(answer.response.law.expand(), answer.response.deflection_samples(count))
    return np.asarray(apart)[answer.topology.mesh_names.index(mesh)]


def _plot_shaft(answer):
    figure = new_figure(3.8)
    axes = figure.subplots()
    shaft = hardest_shaft([answer])
    swing = float(answer.torque(shaft).half_peak_to_peak)
    _draw_period(answer, axes, answer.torque(shaft), answer.linear.torque(shaft))
    if answer.known:
        axes.get_lines()[1].remove()  # a train without gears has no backlash
    title = f"{_title(answer)}: torque of {plain(shaft)}, half peak-to-peak {swing:.0f} N m"
    axes.set_title(title, fontsize="medium")
    axes.set_ylabel("torque, N m")
    _finish(axes, answer)
    return figure


def _title(answer):
    return f"{train_name(answer.topology)}, {answer.rpm:g} rpm"


def periods_of(answer):
    """Cycles that are drawn."""
    return max(answer.state.period, 1)


def count_of(answer):
    return SAMPLES * periods_of(answer)


def angles_of(answer):
    return np.linspace(0.0, answer.cycle_deg * periods_of(answer), count_of(answer) + 1)


def closed(answer, signal):
    """Samples of the whole period, its first time sample again at the end; a cycle comes as often as there is room."""
    turns = signal.revolutions_per_cycle / answer.topology.revolutions_per_cycle
    times = round(periods_of(answer) / turns)
    values = np.tile(np.asarray(fourier.sample(signal.coefficients, count_of(answer) // times)), times)
    return np.append(values, values[0])


def _shade(axes, angles, apart):
    if apart.any():
        axes.fill_between(
            angles,
            0,
            1,
            where=np.append(apart, apart[0]),
            transform=axes.get_xaxis_transform(),
            color=GAP,
            linewidth=0,
            zorder=0,
            label="teeth apart",
        )


def _finish(axes, answer):
    cycle, periods = answer.cycle_deg, periods_of(answer)
    axes.set_xlim(0.0, periods * cycle)
    if periods > 1:
        axes.set_xticks(np.linspace(0.0, periods * cycle, periods + 1))
        axes.grid(axis="x", linewidth=0.8, linestyle=":", color="black")
    elif cycle % 90 == 0:
        axes.set_xticks(np.arange(0.0, cycle + 1, 90.0))
    zero = " (0: firing top dead centre of a cylinder with firing angle 0)" if answer.topology.cylinder_names else ""
    axes.set_xlabel(f"angle of the reference rotor, deg{zero}")

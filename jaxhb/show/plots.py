"""Pictures of one cycle and of a sweep. The only importer of matplotlib; figures without pyplot, for any backend."""

import numpy as np
from matplotlib.figure import Figure

from ..design.evaluation import label
from ..harmonic.backlash import separated
from .report import contact_at, gears, hardest_gear, hardest_shaft, meshes_of
from .tuned import scaled_unit

SAMPLES = 4320
WITH, WITHOUT, GAP = "#b3261e", "#1f4e79", "#e3e3e3"
MESH_COLOURS = ("#b3261e", "#2e7d32", "#6a1b9a", "#ef6c00", "#00838f", "#5d4037")


def plot_cycle(response, linear, gear=None):
    """Torque on a gear over one cycle, with and without backlash; below it the tooth forces of its meshes.

    Parameters
    ----------
    response, linear : Response
        With backlash and with all teeth in contact, at the same speed.
    gear : str, optional
        Default: the gear of the reference rotor whose torque has the largest half peak-to-peak. A train without gears
        shows its hardest worked shaft or damper.

    Returns
    -------
    matplotlib.figure.Figure
        Shaded where a mesh of the gear is in the gap; angles in deg of the reference rotor.

    Examples
    --------
    >>> import jaxhb
    >>> train = jaxhb.load_scene("spur_pair")
    >>> figure = plot_cycle(jaxhb.solve(train, rpm=2000.0), jaxhb.linear_response(train, rpm=2000.0))
    >>> figure.axes[0].get_ylabel()
    'torque, N m'
    """
    gear = gear or default_gear(response)
    title = f"{response.topology.name or 'scene'}, {float(response.rpm):g} rpm"
    if gear is None:
        return _plot_shaft(response, title)
    figure = Figure(figsize=(9.0, 6.2), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    names = meshes_of(response, gear)
    apart = np.any([in_the_gap(response, name, SAMPLES) for name in names], axis=0)
    after, before = response.gear_torque(gear), linear.gear_torque(gear)
    angles = _angles(response)
    above.plot(angles, _closed(after), color=WITH, linewidth=1.1, label="with backlash")
    above.plot(angles, _closed(before), color=WITHOUT, linewidth=1.3, linestyle="--", label="without backlash")
    above.set_title(
        f"{title}: torque that {gear} passes on, half peak-to-peak {float(after.half_peak_to_peak):.0f} N m "
        f"(without backlash {float(before.half_peak_to_peak):.0f})",
        fontsize="medium",
    )
    above.set_ylabel("torque, N m")
    for number, name in enumerate(names):
        colour = MESH_COLOURS[number % len(MESH_COLOURS)]
        below.plot(angles, _closed(response.force(name)) / 1e3, color=colour, linewidth=1.0, label=_plain(name))
        below.plot(angles, _closed(linear.force(name)) / 1e3, color=colour, linewidth=0.9, linestyle="--", alpha=0.6)
    below.plot([], [], color="grey", linewidth=0.9, linestyle="--", label="without backlash")
    below.set_ylabel("tooth force, kN")
    _shade(above, angles, apart)
    _shade(below, angles, apart)
    _finish(below, response)
    above.axhline(0.0, color="black", linewidth=0.6)
    below.axhline(0.0, color="black", linewidth=0.6)
    for axes in (above, below):
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.15 * (high - low))  # room for the legend
        axes.legend(loc="upper right", fontsize="small", ncols=3)
    return figure


def plot_sweep(sweep, linear):
    """Largest tooth force and share of the cycle out of contact, mesh by mesh, over the speed.

    Parameters
    ----------
    sweep, linear : Response
        Of many speeds (:func:`jaxhb.solve_speeds`), with backlash and with all teeth in contact.

    Returns
    -------
    matplotlib.figure.Figure
        A cross marks a speed that did not converge. A train without gears shows its hardest worked shaft or damper.

    Examples
    --------
    >>> import jaxhb
    >>> sweep = jaxhb.solve_speeds(jaxhb.load_scene("six_cylinder_diesel"), rpm=[1000.0, 1500.0, 2000.0])
    >>> len(plot_sweep(sweep, sweep).axes)
    1
    """
    name = sweep.topology.name or "scene"
    if not sweep.topology.mesh_names:
        return _plot_shaft_sweep(sweep, name)
    rpm, failed = np.asarray(sweep.rpm), ~np.asarray(sweep.converged)
    figure = Figure(figsize=(9.0, 6.2), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    marker = "o" if len(rpm) <= 60 else None
    for number, mesh in enumerate(sweep.topology.mesh_names):
        colour = MESH_COLOURS[number % len(MESH_COLOURS)]
        largest = np.asarray(sweep.force(mesh).peak) / 1e3
        above.plot(rpm, largest, color=colour, marker=marker, markersize=3, linewidth=1.1, label=_plain(mesh))
        above.plot(rpm, np.asarray(linear.force(mesh).peak) / 1e3, color=colour, linewidth=1.0, linestyle="--")
        above.plot(rpm[failed], largest[failed], "x", color="black")
        contacts = [contact_at(sweep[i], mesh) for i in range(len(rpm))]
        apart = [np.nan if contact is None else 100 * contact.separated_fraction for contact in contacts]
        below.plot(rpm, apart, color=colour, marker=marker, markersize=3, linewidth=1.1)
    above.plot([], [], color="grey", linestyle="--", label="without backlash")
    if failed.any():
        above.plot([], [], "x", color="black", label="not converged")
    above.set_title(f"{name}: largest tooth force over the cycle", fontsize="medium")
    above.set_ylabel("tooth force, kN")
    above.set_ylim(bottom=0.0)
    above.legend(loc="upper left", fontsize="small")
    below.set_ylabel("teeth apart, % of the cycle")
    below.set_ylim(bottom=0.0)
    below.set_xlabel("speed, rpm")
    return figure


def plot_tuning(objectives, result):
    """What was made small over the speed, before and after, and the history of the tuning below.

    Parameters
    ----------
    objectives : sequence of Objective
    result : Tuning

    Returns
    -------
    matplotlib.figure.Figure
        One panel for each objective (speeds that are not solved are left out), and one for the history: the objective,
        1 at the start but for smoothing, with a line where the smooth maximum was sharpened.
    """
    count = len(objectives)
    figure = Figure(figsize=(9.0, 2.2 + 2.8 * count), layout="constrained")
    *panels, below = figure.subplots(count + 1, 1)
    for axes, objective in zip(panels, objectives, strict=True):
        name, (factor, unit) = label(objective), scaled_unit(objective.quantity)
        for reading, colour, said in ((result.before, WITH, "before"), (result.after, WITHOUT, "after")):
            axes.plot(result.rpm, factor * reading.readings[name], color=colour, marker="o", markersize=3, label=said)
        axes.set_ylabel(f"{objective.quantity}{', ' + unit if unit else ''}")
        axes.set_title(f"{result.train.topology.name or 'scene'}: {_plain(name)}", fontsize="medium")
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


def default_gear(response):
    """Of the gears of the reference rotor (of all, if it has none) the one whose torque swings most, or None."""
    topology = response.topology
    near = [g for g in gears(response) if topology.rotor[topology.disk_index(g)] == topology.reference_rotor]
    if not near:
        return hardest_gear(response)
    return max(near, key=lambda name: float(response.gear_torque(name).half_peak_to_peak))


def in_the_gap(response, mesh, count):
    """Whether the teeth are apart at ``count`` time samples of the cycle."""
    apart = separated(response.law.expand(), response.deflection_samples(count))
    return np.asarray(apart)[response.topology.mesh_names.index(mesh)]


def _plot_shaft(response, title):
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    axes = figure.subplots()
    shaft = hardest_shaft(response)
    axes.plot(_angles(response), _closed(response.torque(shaft)), color=WITHOUT, linewidth=1.3)
    axes.axhline(0.0, color="black", linewidth=0.6)
    swing = float(response.torque(shaft).half_peak_to_peak)
    axes.set_title(f"{title}: torque of {_plain(shaft)}, half peak-to-peak {swing:.0f} N m", fontsize="medium")
    axes.set_ylabel("torque, N m")
    _finish(axes, response)
    return figure


def _plot_shaft_sweep(sweep, name):
    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    axes = figure.subplots()
    shaft = hardest_shaft(sweep)
    signal, rpm = sweep.torque(shaft), np.asarray(sweep.rpm)
    axes.plot(rpm, np.asarray(signal.half_peak_to_peak), color=WITHOUT, label="half peak-to-peak")
    axes.plot(rpm, np.asarray(signal.sum_of_amplitudes), color=WITHOUT, linestyle=":", label="sum of amplitudes")
    axes.set_title(f"{name}: vibratory torque of {_plain(shaft)}", fontsize="medium")
    axes.set_ylabel("torque, N m")
    axes.set_xlabel("speed, rpm")
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize="small")
    return figure


def _angles(response):
    return np.linspace(0.0, 360.0 * response.topology.revolutions_per_cycle, SAMPLES + 1)


def _closed(signal):
    """Samples of a whole cycle, its first time sample again at the end."""
    values = np.asarray(signal.samples(SAMPLES))
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


def _finish(axes, response):
    cycle = 360.0 * response.topology.revolutions_per_cycle
    axes.set_xlim(0.0, cycle)
    if cycle % 90 == 0:
        axes.set_xticks(np.arange(0.0, cycle + 1, 90.0))
    zero = " (0: firing top dead centre of a cylinder with firing angle 0)" if response.topology.cylinder_names else ""
    axes.set_xlabel(f"angle of the reference rotor, deg{zero}")


def _plain(name):
    """``a|b`` as a label."""
    return name.replace("|", " - ")

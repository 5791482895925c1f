"""Pictures over the speed: forces or torques, and the kind of motion at every speed."""

import numpy as np

from jaxhb.report.answer import SPEED
from jaxhb.report.figures.limits import draw_limits, judged_elements
from jaxhb.report.figures.style import MESH_COLOURS, MOTIONS, WITHOUT, moved_right, new_figure, plain
from jaxhb.report.selection import hardest_shaft, train_name
from jaxhb.report.text.strength import answers_strength

BESIDE = 4.0
"""Points between the bars of two meshes at one speed."""

DOWNWARDS = ", downwards"
WAYS = {"up": ("-", "full"), "down": (":", "none"), "orbit": ("-", "full")}
"""Line and filling of markers by direction."""


def plot_sweep(sweeps):
    """Largest tooth force and share of the time out of contact, mesh by mesh, over the speed.

    Parameters
    ----------
    sweeps : dict
        Answers by direction, from :func:`jaxhb.report.compute.answer_speeds`.

    Returns
    -------
    matplotlib.figure.Figure
        Markers tell the kind of motion; what has no answer, or did not converge, is a gap in the lines and a cross at
        the bottom. Downwards lines are dotted and markers open. A train without gears shows its hardest worked shaft or
        damper. Below, of stresses, tooth torques and heat what comes nearest to the limits that the scene gives, with
        barred ranges shaded.

    Examples
    --------
    >>> import jaxhb
    >>> from jaxhb.report.compute import Asked, answer_speeds
    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> len(plot_sweep(answer_speeds(train, [1000.0, 1500.0, 2000.0], Asked())).axes)
    1
    """
    first = next(iter(sweeps.values()))
    name = train_name(first[0].topology)
    if not first[0].topology.mesh_names:
        figure, (axes,) = _figure(sweeps, [4.2])
        _plot_shaft_sweep(axes, first, name)
        return figure
    figure, (above, below) = _figure(sweeps, [3.7, 2.5])
    places = [answer.place for answer in first]
    for number, mesh in enumerate(first[0].topology.mesh_names):
        colour = MESH_COLOURS[number % len(MESH_COLOURS)]
        for way, answers in sweeps.items():
            line, fill = WAYS[way]
            style = {"color": colour, "linestyle": line, "linewidth": 1.1}
            largest = _certain(answers, lambda answer, mesh=mesh: float(answer.force(mesh).peak) / 1e3)
            apart = _certain(answers, lambda answer, mesh=mesh: 100 * answer.contacts[mesh].separated_fraction)
            above.plot(places, largest, **style, label=plain(mesh) if answers is first else None)
            below.plot(places, apart, **style)
            _draw_kinds(above, answers, largest, colour, fill)
            _draw_distributions(above, answers, mesh, colour, BESIDE * number)
        before = [float(answer.linear.force(mesh).peak) / 1e3 for answer in first]
        above.plot(places, before, color=colour, linewidth=1.0, linestyle="--", alpha=0.6)
    above.plot([], [], color="grey", linestyle="--", label="without backlash")
    if len(sweeps) > 1:
        above.plot([], [], color="grey", linestyle=":", marker="o", fillstyle="none", label="downwards")
    above.set_title(f"{name}: largest tooth force, and the kind of motion", fontsize="medium")
    above.set_ylabel("tooth force, kN")
    above.set_ylim(bottom=0.0)
    below.set_ylabel("teeth apart, % of the time")
    below.set_ylim(bottom=0.0)
    _mark_unknown(above, sweeps)
    _legend_of_kinds(above, sweeps)
    above.legend(loc="upper left", fontsize="x-small", ncols=2)
    return figure


def _figure(sweeps, heights):
    """A figure with panels of these heights for the caller, the panels of limits drawn below them."""
    along = {way: answers for way, answers in sweeps.items() if answers[0].axis == SPEED}
    judged = {DOWNWARDS * (way == "down"): answers_strength(answers) for way, answers in along.items()}
    limited = judged_elements(next(iter(judged.values()))) if judged else []
    figure = new_figure(sum(heights) + 2.2 * len(limited))
    heights = [*heights, *[2.2] * len(limited)]
    panels = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    own = len(heights) - len(limited)
    for axes, chosen in zip(panels[own:], limited, strict=True):
        draw_limits(axes, judged, *chosen)
    axis = next(iter(sweeps.values()))[0].axis
    panels[-1].set_xlabel("speed, rpm" if axis == SPEED else axis.label)
    return figure, panels[:own]


def _certain(answers, read):
    """What is read of answers, nan where there is none: a gap, which sets no scale."""
    return [read(answer) if answer.answered else np.nan for answer in answers]


def _kind(answer):
    if not answer.answered:
        return "unknown"
    return "unstable" if answer.growth.unstable else answer.state.kind


def _draw_kinds(axes, answers, values, colour, fill):
    """A marker for the kind of motion at every speed."""
    size = 4 if len(answers) <= 60 else 2.5
    for kind, (marker, *_) in MOTIONS.items():
        there = [(answer.place, y) for answer, y in zip(answers, values, strict=True) if _kind(answer) == kind]
        if there and kind != "unknown":
            larger = size * (1.8 if marker == "*" else 1.0)
            axes.plot(*zip(*there, strict=True), marker, color=colour, markersize=larger, fillstyle=fill)


def _draw_distributions(axes, answers, mesh, colour, beside):
    """Of motions that never repeat, from 5 to 95 % of the largest forces of a cycle, ``beside`` points to the right."""
    place = moved_right(axes, beside)
    for answer in answers:
        if answer.state.kind == "irregular" and answer.answered:
            low, _, high = answer.force(mesh).per_cycle.max / 1e3
            axes.plot([answer.place] * 2, [low, high], color=colour, linewidth=3.0, alpha=0.35, transform=place)


def _mark_unknown(axes, sweeps):
    """Crosses at the bottom."""
    unknown = sorted({answer.place for answers in sweeps.values() for answer in answers if not answer.answered})
    if unknown:
        bottom = np.full(len(unknown), 0.02)
        axes.plot(unknown, bottom, "x", color="black", transform=axes.get_xaxis_transform(), clip_on=False)


def _legend_of_kinds(axes, sweeps):
    met = {_kind(answer) for answers in sweeps.values() for answer in answers}
    for kind, (marker, _, _, said) in MOTIONS.items():
        if kind in met:
            axes.plot([], [], marker, color="black", markersize=5, label=said)


def _plot_shaft_sweep(axes, answers, name):
    shaft, places = hardest_shaft(answers), [answer.place for answer in answers]
    swings = _certain(answers, lambda answer: float(answer.torque(shaft).half_peak_to_peak))
    sums = _certain(answers, lambda answer: float(answer.torque(shaft).sum_of_amplitudes))
    marker = "." if len(answers) <= 60 else ""
    axes.plot(places, swings, color=WITHOUT, marker=marker, label="half peak-to-peak")
    axes.plot(places, sums, color=WITHOUT, linestyle=":", label="sum of amplitudes")
    _mark_unknown(axes, {"": answers})
    axes.set_title(f"{name}: vibratory torque of {plain(shaft)}", fontsize="medium")
    axes.set_ylabel("torque, N m")
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize="small")

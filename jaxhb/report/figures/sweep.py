"""Figures over the speed: forces or torques, and the kind of motion at every speed."""

import dataclasses

import numpy as np

from jaxhb.report.answer import SPEED, Case
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import Figure, kind_keys, layout, line, motion_line, speed_range, top_of
from jaxhb.report.figures.limits import judged_elements, limit_figure
from jaxhb.report.figures.style import plain
from jaxhb.report.quantities import forces, separation, shaft_torques
from jaxhb.report.selection import hardest_shaft, train_name
from jaxhb.report.text.strength import answers_strength

BESIDE = 0.006
"""Share of the axis between the bars of two meshes at one speed."""

WAYS = {"up": "upwards", "down": "downwards", "orbit": "periodic solutions"}


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
        the bottom. Downwards markers are open. A train without gears shows its hardest worked shaft or damper. Below,
        of stresses, tooth torques and heat what comes nearest to the limits that the scene gives, with barred ranges
        shaded.

    Examples
    --------
    >>> import jaxhb
    >>> from jaxhb.report.compute import Asked, answer_speeds
    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> len(plot_sweep(answer_speeds(train, [1000.0, 1500.0, 2000.0], Asked())).axes)
    1
    """
    return drawn(*sweep_figures(sweeps), title=train_name(next(iter(sweeps.values()))[0].topology))


def sweep_figures(sweeps):
    """The figures of :func:`plot_sweep`, in a list."""
    cases = [Case(WAYS[way] if len(sweeps) > 1 else "", answers) for way, answers in sweeps.items()]
    first = cases[0].answers
    train = first[0].train
    meshes = train.topology.mesh_names
    if meshes:
        figures = [
            over_speed(forces(train), meshes, cases, "Largest tooth force, and the kind of motion"),
            over_speed(separation(train), meshes, cases, "Time out of contact"),
        ]
    else:
        torque, shaft = shaft_torques(train), hardest_shaft(first)
        sums = dataclasses.replace(torque, read=lambda answer, name: answer.torque(name).sum_of_amplitudes)
        more = [line([answer.place for answer in first], sums.of(first, shaft), "sum of amplitudes", 3)]
        caption = f"Vibratory torque of {plain(shaft)}, half peak-to-peak, and the kind of motion"
        figures = [over_speed(torque, [shaft], cases, caption, more=more)]
    judged = {case.title: answers_strength(case.answers) for case in cases if first[0].axis == SPEED}
    limited = judged_elements(next(iter(judged.values()))) if judged else []
    return figures + [limit_figure(judged, *chosen) for chosen in limited]


def over_speed(quantity, names, cases, caption=None, *, more=()):
    """Elements over the speed, case by case, with and without backlash; symbols tell the kind of motion.

    Parameters
    ----------
    quantity : Quantity
    names : sequence of str
        Of one element every case is a line of its own look; of several every element is, with open symbols in the
        second case.
    cases : sequence of Case
        The same speeds; a single one may have no title.
    caption : str, optional
        Default: the element and what it shows.
    more : sequence of dict
        Traces that are drawn with them.
    """
    first, several = cases[0].answers, len(names) > 1
    places, train = [answer.place for answer in first], first[0].train
    # What is no signal, heat or a time apart, is drawn with backlash alone.
    backlash = quantity.signal is not None and any(train.topology.mesh_backlash)
    # Both directions have the same motion without backlash.
    alike, traces = all(case.answers[0].train is train for case in cases), []
    for place, name in enumerate(names):
        for number, case in enumerate(cases):
            said = [plain(name)] * (several or not case.title) + [plain(case.title)] * bool(case.title)
            style = place if several else 2 * number
            values = quantity.of(case.answers, name)
            traces.append(motion_line(case.answers, values, ", ".join(said), style, hollow=number > 0))
            if backlash and (case is cases[0] or not alike):
                said = "" if alike else f"{plain(case.title)}, "
                style = {"style": place if several else 2 * number + 1, "showlegend": not (several and place)}
                before = line(places, quantity.without(case.answers, name), f"{said}without backlash", **style)
                before["line"] |= {"width": 0.8} if several else {}
                traces.append(before)
    traces += more
    axis = speed_range(places)
    if quantity.called == "tooth force" and names[0]:
        traces += _cycles(quantity, names, cases, BESIDE * (axis[1] - axis[0]))
    panels = [(f"{quantity.called}, {quantity.unit}", top_of(*(trace["y"] for trace in traces)))]
    traces += kind_keys(*(case.answers for case in cases))
    title = "speed, rpm" if first[0].axis == SPEED else first[0].axis.label
    caption = caption or f"{plain(names[0])}: {quantity.small_title}, {quantity.unit}"
    return Figure(caption, traces, layout(title, panels, traces, x_range=axis))


def _cycles(quantity, names, cases, beside):
    """Bars from 5 to 95 % of the largest forces of a cycle, of motions that never repeat; one mesh beside the other."""
    x, y = [], []
    for number, name in enumerate(names):
        for answer in (answer for case in cases for answer in case.answers):
            if answer.answered and answer.state.kind == "irregular":
                low, _, high = quantity.factor * np.asarray(answer.force(name).per_cycle.max)
                # nan ends a line: one trace draws all bars.
                x += [*[answer.place + beside * number] * 2, np.nan]
                y += [low, high, np.nan]
    style = {"opacity": 0.45, "hoverinfo": "skip"}
    bars = line(x, y, "5 to 95 % of the cycles", **style) | {"line": {"color": "#555555", "width": 5}}
    return [bars] if x else []

"""Figures over the speed: forces or torques, and the kind of motion at every speed."""

import dataclasses

import numpy as np

from jaxhb.report.answer import SPEED, Case
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import bars, figure, kind_keys, line, motion_line, plain, speed_range, top_of
from jaxhb.report.figures.limits import judged_elements, limit_figure
from jaxhb.report.quantities import forces, separation, shaft_torques
from jaxhb.report.selection import hardest_shaft, train_name
from jaxhb.report.text.strength import answers_strength

BESIDE = 0.006
"""Share of the axis between the bars of two meshes at one speed."""

WAYS = {"up": "upwards", "down": "downwards", "orbit": "periodic solutions"}


def plot_sweep(sweeps):
    """Largest tooth force and share of the time out of contact, mesh by mesh, over the speed.

    Markers tell the kind of motion; what has no answer, or did not converge, is a gap in the lines and a cross at the
    bottom. Downwards markers are open. A train without gears shows its hardest worked shaft or damper. Below, of
    stresses, tooth torques and heat what comes nearest to the limits that the scene gives, with barred ranges shaded.
    ``sweeps`` are answers by direction, from :func:`jaxhb.report.compute.answer_speeds`.
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


def over_speed(quantity, names, cases, caption=None, *, more=(), **layout):
    """Elements over the speed, case by case, with and without backlash; symbols tell the kind of motion.

    A quantity of no signal is drawn with backlash alone. Of one element every case is a line of its own look; of
    several every element is, with open symbols in the second case. Cases have the same speeds; a single one may have no
    title. ``more`` are traces drawn with them, ``layout`` is for :func:`figure`.
    """
    first, several = cases[0].answers, len(names) > 1
    places = [answer.place for answer in first]
    backlash = quantity.signal is not None and any(first[0].topology.mesh_backlash)
    # Both directions have the same motion without backlash.
    alike, traces = all(case.answers[0].train is first[0].train for case in cases), []
    for place, name in enumerate(names):
        for number, case in enumerate(cases):
            said = [plain(name)] * (several or not case.title) + [plain(case.title)] * bool(case.title)
            style = place if several else 2 * number
            values = quantity.of(case.answers, name)
            traces.append(motion_line(case.answers, values, ", ".join(said), style, hollow=number > 0))
            if backlash and (case is cases[0] or not alike):
                said = "" if alike else f"{plain(case.title)}, "
                style = {"style": place if several else 2 * number + 1, "showlegend": not (several and place)}
                values, look = quantity.without(case.answers, name), {"width": 0.8} if several else {}
                traces.append(line(places, values, f"{said}without backlash", look=look, **style))
    traces += more
    axis = speed_range(places)
    if quantity.called == "tooth force" and names[0]:
        traces += _cycles(quantity, names, cases, BESIDE * (axis[1] - axis[0]))
    panels = [(f"{quantity.called}, {quantity.unit}", top_of(traces))]
    traces += kind_keys(*(case.answers for case in cases))
    title = "speed, rpm" if first[0].axis == SPEED else first[0].axis.label
    caption = caption or f"{plain(names[0])}: {quantity.small_title}, {quantity.unit}"
    return figure(caption, title, panels, traces, x_range=axis, **layout)


def _cycles(quantity, names, cases, beside):
    """Bars from 5 to 95 % of the largest forces of a cycle, of motions that never repeat; one mesh beside the other."""
    answers = [answer for case in cases for answer in case.answers]
    rows = [
        (answer.place + beside * number, *quantity.factor * np.asarray(answer.force(name).per_cycle.max)[[0, 2]])
        for number, name in enumerate(names)
        for answer in answers
        if answer.answered and answer.state.kind == "irregular"
    ]
    look = {"color": "#555555", "dash": "solid", "width": 5}
    said = "5 to 95 % of the cycles"
    return [bars(*np.transpose(rows), said, look=look, opacity=0.45, hoverinfo="skip")] if rows else []

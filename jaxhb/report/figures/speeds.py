"""Figures over the speed: forces or torques and the kind of motion, linear orders,
numbers beside their limits.
"""

import dataclasses

import numpy as np

from jaxhb.design.measurements import UNITS
from jaxhb.linear.strength import corners_of, strength, stress_limits
from jaxhb.report.answer import SPEED, Case
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import (
    MARKED,
    SYMBOLS,
    bands,
    bars,
    crosses,
    figure,
    kind_keys,
    line,
    marks,
    motion_line,
    plain,
    rings,
    speed_range,
    spread_bars,
)
from jaxhb.report.orders import order_names
from jaxhb.report.quantities import forces, separation, shaft_torques, shown_unit
from jaxhb.report.selection import case_title, hardest_shaft, train_name
from jaxhb.report.text.strength import LIMITED, answers_strength
from jaxhb.report.text.sweep_tables import BLOCKS
from jaxhb.report.text.tuned import scaled_unit

ASTRIDE = 1e-9  # share of a speed by which it is left or right of a step
BESIDE = 0.006  # share of the axis between the bars of two meshes at one speed


def plot_sweep(sweeps):
    """Largest tooth force and share of the time out of contact, mesh by mesh, over the
    speed.

    Markers tell the kind of motion, open ones downwards; without an answer there is a
    gap and a cross at the bottom. A train without gears shows its hardest worked shaft
    or damper. Below stands what comes nearest to the limits of the scene. ``sweeps``
    are answers by direction, from :func:`jaxhb.report.compute.answer_speeds`.
    """
    cases = [
        Case(BLOCKS[way].lower() if len(sweeps) > 1 else "", answers)
        for way, answers in sweeps.items()
    ]
    first = cases[0].answers
    train = first[0].train
    meshes = train.topology.mesh_names
    if meshes:
        figures = [
            over_speed(
                forces(train),
                meshes,
                cases,
                "Largest tooth force, and the kind of motion",
            ),
            over_speed(separation(train), meshes, cases, "Time out of contact"),
        ]
    else:
        torque = shaft_torques(train)
        shaft = hardest_shaft(first)
        sums = dataclasses.replace(torque, variable="torque_sum_of_amplitudes")
        more = [
            line(
                [answer.place for answer in first],
                sums.of(first, shaft),
                "sum of amplitudes",
                3,
            )
        ]
        caption = (
            f"Vibratory torque of {plain(shaft)}, half peak-to-peak, and the kind of"
            " motion"
        )
        figures = [over_speed(torque, [shaft], cases, caption, more=more)]
    judged = {
        case.title: answers_strength(case.answers)
        for case in cases
        if first[0].axis == SPEED
    }
    limited = judged_elements(next(iter(judged.values()))) if judged else []
    figures += [limit_figure(judged, *chosen, train) for chosen in limited]
    return drawn(*figures, title=train_name(train.topology))


def over_speed(quantity, names, cases, caption=None, *, more=(), **layout):
    """Elements over the speed, case by case, with and without backlash; symbols tell
    the kind of motion.

    Of one element every case has a look of its own; of several every element, with open
    symbols in the second case. A quantity of no signal is drawn with backlash alone, as
    what has no linear motion beside it. ``more`` are further traces, ``layout`` is for
    :func:`figure`.
    """
    first = cases[0].answers
    several = len(names) > 1
    places = [answer.place for answer in first]
    backlash = (
        quantity.of_signal
        and first[0].linear is not None
        and any(first[0].topology.mesh_backlash)
    )
    # Both directions have the same motion without backlash.
    alike = all(case.answers[0].train is first[0].train for case in cases)
    traces = []
    seen = []
    for place, name in enumerate(names):
        for number, case in enumerate(cases):
            said = [plain(name)] * (several or not case.title) + [
                plain(case.title)
            ] * bool(case.title)
            style = place if several else 2 * number
            values = quantity.of(case.answers, name)
            traces.append(
                motion_line(
                    case.answers, values, ", ".join(said), style, hollow=number > 0
                )
            )
            seen += zip(case.answers, values, strict=True)
            if backlash and (case is cases[0] or not alike):
                said = "" if alike else f"{plain(case.title)}, "
                style = {
                    "style": place if several else 2 * number + 1,
                    "showlegend": not (several and place),
                }
                values = quantity.without(case.answers, name)
                look = {"width": 0.8} if several else {}
                traces.append(
                    line(
                        places,
                        values,
                        f"{said}without backlash",
                        look=look,
                        alone=1,
                        **style,
                    )
                )
    traces += more
    axis = speed_range(places)
    if quantity.called == "tooth force" and names[0]:
        traces += _cycles(quantity, names, cases, BESIDE * (axis[1] - axis[0]))
    traces += _spread(quantity, names, cases, 2 * BESIDE * (axis[1] - axis[0]))
    unconfirmed = [(a.place, value) for a, value in seen if a.unconfirmed]
    traces += rings(*zip(*unconfirmed, strict=True)) if unconfirmed else []
    traces += kind_keys(*(case.answers for case in cases))
    title = "speed, rpm" if first[0].axis == SPEED else first[0].axis.label
    caption = caption or f"{plain(names[0])}: {quantity.small_title}, {quantity.unit}"
    return figure(
        caption,
        title,
        f"{quantity.called}, {quantity.unit}",
        traces,
        x_range=axis,
        **layout,
    )


def _cycles(quantity, names, cases, beside):
    """Bars from 5 to 95 % of the largest forces of a cycle, of motions that never
    repeat; one mesh beside the other.
    """
    rows = [
        (
            answer.place + beside * number,
            *quantity.factor * np.asarray(answer.force(name).per_cycle.peak)[[0, 2]],
        )
        for number, name in enumerate(names)
        for answer in _irregular(cases)
    ]
    look = {"color": "#555555", "dash": "solid", "width": 5}
    said = "5 to 95 % of the cycles"
    return (
        [bars(*np.transpose(rows), said, look=look, opacity=0.45, hoverinfo="skip")]
        if rows
        else []
    )


def _irregular(cases):
    """Answers whose motion never repeats."""
    answers = (answer for case in cases for answer in case.answers)
    return [
        answer
        for answer in answers
        if answer.answered and answer.state.kind == "irregular"
    ]


def _spread(quantity, names, cases, width):
    """Bars to where the numbers of other records of motions that never repeat may lie,
    in a list.
    """
    answers = _irregular(cases)
    rows = [
        (
            answer.place,
            quantity.factor * quantity.read(answer, name),
            quantity.spread(answer, name),
        )
        for name in names
        for answer in answers
    ]
    return spread_bars(*np.transpose(rows), width) if rows else []


def plot_tolerance(spread):
    """Every quantity over the speed: as the scene is, worst case found and bound, 5 to
    95 % of a sample.
    """
    title = f"{train_name(spread.train.topology)}: what the tolerances do"
    return drawn(*tolerance_figures(spread), title=title)


def tolerance_figures(spread):
    """The same as specifications, one for each quantity."""
    rpm = spread.rpm
    figures = []
    for j, (one, name) in enumerate(zip(spread.of, spread.labels, strict=True)):
        factor, _ = scaled_unit(one.quantity)
        traces = [
            line(rpm, factor * spread.nominal[:, j], "as the scene is", 1),
            line(rpm, factor * spread.worst[:, j], "worst case found", 0),
        ]
        if np.isfinite(spread.bound[:, j]).any():
            look = {"width": 0.8, "dash": "dot"}
            traces.append(
                line(rpm, factor * spread.bound[:, j], "at most", look=look, alone=2)
            )
        if len(spread.drawn):
            low, middle, high = (
                factor * spread.percentile(q)[:, j] for q in (5, 50, 95)
            )
            look = {"color": "#555555", "dash": "solid", "width": 5}
            traces.append(
                bars(rpm, low, high, "5 to 95 % of the sample", look=look, opacity=0.45)
            )
            traces.append(marks(rpm, middle, "median of the sample", "circle", size=5))
        title = f"{one.quantity}, {scaled_unit(one.quantity)[1]}".removesuffix(", ")
        figures.append(
            figure(plain(name), "speed, rpm", title, traces, x_range=speed_range(rpm))
        )
    return figures


def plot_identified(found):
    """Measured and computed amplitudes over the speed, a panel for each element, the
    largest orders of each.
    """
    rows = found.measured
    figures = []
    names = order_names(found.train)
    pairs = list(zip(rows.quantity, rows.element, strict=True))
    for quantity, element in dict.fromkeys(pairs):
        own = np.array([pair == (quantity, element) for pair in pairs])
        factor, unit = shown_unit(UNITS[quantity])
        known = np.where(found.kept, factor, np.nan)
        orders = rows.order.astype(str)
        largest = {
            order: rows.amplitude[own & (orders == order)].max()
            for order in orders[own]
        }
        traces = []
        for style, order in enumerate(
            sorted(largest, key=lambda one: -largest[one])[:MOST]
        ):
            at = np.flatnonzero(own & (orders == order))
            at = at[np.argsort(rows.rpm[at])]
            said = (
                "sum of all orders"
                if order == "nan"
                else f"order {names.number(float(order))}"
            )
            for computed, name, look in (
                (found.computed, "fitted", {}),
                (found.before_computed, "scene", {"width": 0.8, "dash": "dot"}),
            ):
                traces.append(
                    line(
                        rows.rpm[at],
                        known[at] * np.abs(computed[at]),
                        f"{said}, {name}",
                        style,
                        look=look,
                    )
                )
            traces.append(
                marks(
                    rows.rpm[at],
                    factor * rows.amplitude[at],
                    f"{said}, measured",
                    SYMBOLS[style],
                    size=6,
                )
            )
        caption = f"{quantity} of {plain(element)}: amplitudes"
        axis = speed_range(np.unique(rows.rpm))
        figures.append(
            figure(caption, "speed, rpm", f"{quantity}, {unit}", traces, x_range=axis)
        )
    return drawn(
        *figures, title=f"{train_name(found.train.topology)}: measured and computed"
    )


MOST = 4  # elements, or orders, in one picture


def plot_forced(cases, found, worst=None):
    """Half peak-to-peak, sum of amplitudes and the largest orders of up to four
    elements over the speed; limits.

    Of more than four readings ``found`` the shaft and the mesh that swing most are
    drawn. Below stand stresses, tooth torques and heat beside their limits, of the
    elements drawn or of what comes nearest. ``cases`` are responses by the cylinder
    that does not fire; of several the ``worst`` misfire
    (:func:`jaxhb.report.text.forced.worst_of`) adds its half peak-to-peak.
    """
    response = cases[""]
    certain = np.asarray(response.converged)
    known = [one.at(certain) for one in found] if certain.any() else found
    chosen = known if len(found) <= MOST else hardest_elements(known)
    judged = strength(response)

    def beside(name):
        """The worst misfire of an element."""
        if not worst:
            return {}
        cylinder = worst[name].cylinder
        return {case_title(cases[cylinder].train, cylinder): cases[cylinder]}

    figures = [orders_figure(response, one, beside(one.name)) for one in chosen]
    for kind, name in judged_elements(
        judged, {one.name for one in found}, each=len(found) <= MOST
    ):
        others = {title: strength(other) for title, other in beside(name).items()}
        figures.append(limit_figure({"": judged} | others, kind, name, response.train))
    return drawn(*figures, title=train_name(response.topology))


def orders_figure(response, element, misfires, title=""):
    """Synthesis, sum and main orders of an element, a Reading, over the speed; gaps and
    crosses without an answer.

    misfires : responses by title, whose half peak-to-peak stands beside it; title : of
    the case
    """
    factor, unit = element.shown
    signal = element.of(response).signal
    rpm = response.rpm
    converged = np.asarray(response.converged)
    certain = np.where(converged, factor, np.nan)
    traces = [
        line(
            rpm,
            certain * signal.half_peak_to_peak,
            "half peak-to-peak",
            look={"width": 2.4},
        ),
        line(rpm, certain * signal.sum_of_amplitudes, "sum of amplitudes", 3),
    ]
    for called, other in misfires.items():
        own = (
            np.where(other.converged, factor, np.nan)
            * element.of(other).signal.half_peak_to_peak
        )
        traces.append(line(rpm, own, f"half peak-to-peak, {plain(called)}", 1))
    names = order_names(response.train)
    for number, k in enumerate(element.main()):
        marker = {
            "symbol": SYMBOLS[number % len(SYMBOLS)],
            "size": 6,
            "maxdisplayed": 12,
        }
        more = {"mode": "lines+markers", "marker": marker, "look": {"width": 1.0}}
        traces.append(
            line(
                rpm,
                certain * signal.amplitudes[:, k],
                f"order {names.number(signal.orders[k])}",
                2 + number,
                **more,
            )
        )
    traces += crosses(rpm[~converged])
    layout = {"x_range": speed_range(rpm), "height": 220}  # as the limits below it
    said = f"linear forced response over the speed, {title}".removesuffix(", ")
    caption = f"{plain(element.name)}: {said}, {unit}"
    return figure(caption, "speed, rpm", f"{element.called}, {unit}", traces, **layout)


def hardest_elements(found):
    """The shaft and the mesh with the largest half peak-to-peak, without either the
    disk.
    """
    kinds = {
        kind: [one for one in found if one.kind == kind]
        for kind in ("shafts", "meshes")
    }
    kinds = [own for own in kinds.values() if own] or [found]
    return [
        max(own, key=lambda one: np.max(one.signal.half_peak_to_peak)) for own in kinds
    ]


def judged_elements(found, names=None, *, each=False):
    """What has a panel, as (key of LIMITED, name), of the elements ``names`` or of all:
    of each kind that with the largest share of its limit, without limits that with the
    largest number, or ``each``.
    """
    chosen = []
    for key, kind in LIMITED.items():
        rows = {
            name: row
            for name, row in getattr(found, key).items()
            if names is None or name in names
        }

        def most(name, kind=kind, rows=rows):
            share, place = kind.worst(rows[name])
            return np.nan_to_num(share, nan=-1.0), (
                0.0 if place is None else getattr(rows[name], kind.field)[place]
            )

        chosen += [
            (key, name)
            for name in (rows if each or not rows else [max(rows, key=most)])
        ]
    return chosen


def limit_figure(judged, key, name, train):
    """One element of :func:`judged_elements` against its limits; what is barred is
    shaded.

    judged : one :class:`jaxhb.Strength` or more of the same speeds and limits, by the
    titles of their cases; train : as it runs, whose limits are drawn with their steps
    between the speeds
    """
    kind = LIMITED[key]
    first = next(iter(judged.values()))
    traces = []
    called = kind.called
    (factor, unit) = kind.shown
    for number, (title, found) in enumerate(judged.items()):
        values = factor * np.asarray(
            getattr(getattr(found, key)[name], kind.field), float
        )
        said = f"{called}, {plain(title)}".removesuffix(", ")
        traces.append(
            line(
                found.rpm,
                values,
                said,
                number,
                mode="lines+markers" if len(values) <= MARKED else "lines",
            )
        )
    speeds, limits = _limits(first, key, name, train)
    for number, (values, said) in enumerate(
        zip(limits, kind.limits.values(), strict=True)
    ):
        if values is not None:
            values = factor * np.broadcast_to(values, np.shape(speeds))
            traces.append(
                line(speeds, values, said, 2 + number, look={"color": "black"})
            )
    doubtful = [
        own
        for found in judged.values()
        for own in _unconfirmed(found, factor, key, name, kind.field)
    ]
    traces += rings(*zip(*doubtful, strict=True)) if doubtful else []
    barred = (
        [one for found in judged.values() for one in found.barred.get(name, ())]
        if key == "stresses"
        else []
    )
    shaded = (
        "; grey: barred" + " in one of these cases" * (len(judged) > 1)
        if barred
        else ""
    )
    drawn_limits = sum(values is not None for values in limits)
    against = f" against its limit{'s' * (drawn_limits > 1)}" if drawn_limits else ""
    caption = f"{plain(name)}: {called}{against}, {unit}{shaded}"
    layout = {
        "x_range": speed_range(first.rpm),
        "height": 180,
        "shapes": bands([(b.low, b.high) for b in barred]),
    }
    return figure(caption, "speed, rpm", f"{called}, {unit}", traces, **layout)


def _limits(found, key, name, train):
    """Speeds and the limits of an element there: those of stresses at the speeds of a
    :class:`jaxhb.Strength` and on both sides of every step and corner that their rule
    has between them.
    """
    row = getattr(found, key)[name]
    kind = LIMITED[key]
    if key != "stresses" or row.continuous is None:
        return found.rpm, [getattr(row, limit) for limit in kind.limits]
    corners = found.rated_rpm * np.array(corners_of(found.rules[name]))
    corners = np.concatenate([corners * (1 - ASTRIDE), corners * (1 + ASTRIDE)])
    within = corners[(corners > np.min(found.rpm)) & (corners < np.max(found.rpm))]
    speeds = np.unique(np.concatenate([np.atleast_1d(found.rpm), within]))
    return speeds, list(stress_limits(train, name, speeds))


def _unconfirmed(found, factor, key, name, field):
    """Speeds and numbers of an element that harmonic balance did not confirm."""
    if found.unconfirmed is None:
        return []
    values = factor * np.asarray(getattr(getattr(found, key)[name], field), float)
    return [
        (rpm, value)
        for rpm, value, doubt in zip(found.rpm, values, found.unconfirmed, strict=True)
        if doubt
    ]

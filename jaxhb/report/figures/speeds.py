"""Figures over the speed: forces or torques and the kind of motion, linear orders,
numbers beside their limits.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb.linear.forced import ForcedResponse
from jaxhb.linear.strength import Strength, strength, stress_limits, train_of
from jaxhb.report.answer import SPEED, Answer, Case
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import (
    MARKED,
    SYMBOLS,
    Axis,
    Figure,
    Trace,
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
from jaxhb.report.quantities import (
    Quantity,
    forces,
    separation,
    shaft_torques,
)
from jaxhb.report.selection import case_title, hardest_shaft, train_name
from jaxhb.report.text.forced import by_kind, kind_of
from jaxhb.report.text.identified import largest_orders
from jaxhb.report.text.strength import LIMITED, Limited, answers_strength
from jaxhb.report.text.sweep_tables import BLOCKS
from jaxhb.report.text.tuned import scaled_unit
from jaxhb.report.units import shown_unit
from jaxhb.results.quantities import MEASURED
from jaxhb.train.drivetrain import DriveTrain

if TYPE_CHECKING:
    from jaxhb.design.identification import Identification
    from jaxhb.design.signals.orders import MeasuredOrders
    from jaxhb.design.worst_case import Spread
    from jaxhb.report.figures.draw import Picture
    from jaxhb.report.text.forced import ElementKey, ElementReading, WorstMisfire

ASTRIDE = 1e-9  # share of a speed by which it is left or right of a step
BESIDE = 0.006  # share of the axis between the bars of two meshes at one speed


def plot_sweep(sweeps: Mapping[str, list[Answer]]) -> Picture:
    """Draw largest tooth force and share of the time out of contact, mesh by mesh, over
    the speed.

    Markers tell the kind of motion, open ones downwards; without an answer there is a
    gap and a cross at the bottom. A train without gears shows its hardest worked shaft
    or damper. Below stand the elements nearest to the limits of the scene. ``sweeps``
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
        caption = "Largest tooth force, and the kind of motion"
        figures = [
            over_speed(forces(train), meshes, cases, caption),
            over_speed(separation(train), meshes, cases, "Separated time"),
        ]
    else:
        torque = shaft_torques(train)
        shaft = hardest_shaft(first)
        assert shaft is not None  # trains without torques are refused before
        sums = dataclasses.replace(torque, variable="torque_sum_of_amplitudes")
        sum_line = line(
            [answer.place for answer in first],
            sums.of(first, shaft),
            "sum of amplitudes",
            3,
        )
        caption = (
            f"Vibratory torque of {plain(shaft)}, half peak-to-peak, and the kind of"
            " motion"
        )
        figures = [over_speed(torque, [shaft], cases, caption, more=[sum_line])]
    judged = {
        case.title: answers_strength(case.answers)
        for case in cases
        if first[0].axis == SPEED
    }
    limited = judged_elements(next(iter(judged.values()))) if judged else []
    figures += [limit_figure(judged, key, name, train) for key, name in limited]
    return drawn(*figures, title=train_name(train.topology))


def over_speed(
    quantity: Quantity,
    names: Sequence[str],
    cases: Sequence[Case],
    caption: str | None = None,
    *,
    more: Sequence[Trace] = (),
) -> Figure:
    """Make the figure of elements over the speed, case by case, with and without
    backlash; symbols tell the kind of motion.

    Of one element every case has a look of its own; of several every element, with open
    symbols in the second case. A quantity of no signal is drawn with backlash alone, as
    a motion that has no linear one beside it. ``more`` are further traces.
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
    points: list[tuple[Answer, float]] = []
    for number, name in enumerate(names):
        for case_number, case in enumerate(cases):
            labels = [plain(name)] if several or not case.title else []
            labels += [plain(case.title)] if case.title else []
            values = quantity.of(case.answers, name)
            traces.append(
                motion_line(
                    case.answers,
                    values,
                    ", ".join(labels),
                    number if several else 2 * case_number,
                    hollow=case_number > 0,
                )
            )
            points += zip(case.answers, values, strict=True)
            if backlash and (case is cases[0] or not alike):
                label = "" if alike else f"{plain(case.title)}, "
                traces.append(
                    line(
                        places,
                        quantity.without(case.answers, name),
                        f"{label}without backlash",
                        number if several else 2 * case_number + 1,
                        look={"width": 0.8} if several else {},
                        alone=1,
                        showlegend=not (several and number),
                    )
                )
    traces += more
    title = "speed, rpm" if first[0].axis == SPEED else first[0].axis.label
    low, high = speed_range(places)
    width = BESIDE * (high - low)
    if quantity.called == "tooth force" and names[0]:
        traces += _cycles(quantity, names, cases, width)
    traces += _spread(quantity, names, cases, 2 * width)
    traces += rings([(a.place, value) for a, value in points if a.unconfirmed])
    traces += kind_keys(*(case.answers for case in cases))
    caption = caption or f"{plain(names[0])}: {quantity.small_title}, {quantity.unit}"
    panel = f"{quantity.called}, {quantity.unit}"
    return figure(caption, Axis(title, (low, high)), panel, traces)


def _cycles(
    quantity: Quantity, names: Sequence[str], cases: Sequence[Case], beside: float
) -> list[Trace]:
    """Make bars from 5 to 95 % of the largest forces of a cycle, of motions that never
    repeat; one mesh beside the other; in a list.
    """
    points = [
        (
            answer.place + beside * number,
            *(quantity.factor * np.asarray(answer.force(name).per_cycle.peak)),
        )
        for number, name in enumerate(names)
        for answer in _irregular(cases)
    ]
    if not points:
        return []
    places, low, _, high = np.transpose(points)
    return [
        bars(
            places,
            low,
            high,
            "5 to 95 % of the cycles",
            look={"color": "#555555", "dash": "solid", "width": 5},
            opacity=0.45,
            hoverinfo="skip",
        )
    ]


def _irregular(cases: Sequence[Case]) -> list[Answer]:
    """Return the answers whose motion never repeats."""
    answers = (answer for case in cases for answer in case.answers)
    return [
        answer
        for answer in answers
        if answer.answered and answer.state.kind == "irregular"
    ]


def _spread(
    quantity: Quantity, names: Sequence[str], cases: Sequence[Case], width: float
) -> list[Trace]:
    """Make bars to where the numbers of other records of motions that never repeat may
    lie, in a list.
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
    if not rows:
        return []
    places, values, spreads = np.transpose(rows)
    return spread_bars(places, values, spreads, width)


def plot_tolerance(spread: Spread) -> Picture:
    """Draw every quantity over the speed: nominal, worst case found and bound,
    5 to 95 % of a sample.
    """
    title = f"{train_name(spread.train.topology)}: what the tolerances do"
    return drawn(*tolerance_figures(spread), title=title)


def tolerance_figures(spread: Spread) -> list[Figure]:
    """Make the figures of :func:`plot_tolerance`, one for each quantity."""
    rpm = spread.rpm
    figures = []
    for j, (objective, name) in enumerate(zip(spread.of, spread.labels, strict=True)):
        factor, unit = scaled_unit(objective.quantity)
        traces = [
            line(rpm, factor * spread.nominal[:, j], "nominal", 1),
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
        title = f"{objective.quantity}, {unit}".removesuffix(", ")
        axis = Axis("speed, rpm", speed_range(rpm))
        figures.append(figure(plain(name), axis, title, traces))
    return figures


def plot_identified(identification: Identification) -> Picture:
    """Draw measured and computed amplitudes over the speed, a panel for each element,
    the largest orders of each.
    """
    measured = identification.measured
    figures = []
    names = order_names(identification.train)
    pairs = list(zip(measured.quantity, measured.element, strict=True))
    orders = measured.order.astype(str)
    for quantity, element in dict.fromkeys(pairs):
        of_element = np.array([pair == (quantity, element) for pair in pairs])
        factor, unit = shown_unit(MEASURED[quantity].unit)
        answered = np.where(identification.kept, factor, np.nan)
        largest = {
            order: measured.amplitude[of_element & (orders == order)].max()
            for order in orders[of_element]
        }
        main_orders = sorted(largest, key=lambda order: -largest[order])[:MOST]
        traces = []
        for style, order in enumerate(main_orders):
            rows = np.flatnonzero(of_element & (orders == order))
            rows = rows[np.argsort(measured.rpm[rows])]
            label = (
                "sum of all orders"
                if order == "nan"
                else f"order {names.number(float(order))}"
            )
            thin = {"width": 0.8, "dash": "dot"}
            traces += [
                line(
                    measured.rpm[rows],
                    answered[rows] * np.abs(computed[rows]),
                    f"{label}, {name}",
                    style,
                    look=look,
                )
                for computed, name, look in (
                    (identification.computed, "fitted", {}),
                    (identification.before_computed, "scene", thin),
                )
            ]
            traces.append(
                marks(
                    measured.rpm[rows],
                    factor * measured.amplitude[rows],
                    f"{label}, measured",
                    SYMBOLS[style],
                    size=6,
                )
            )
        caption = f"{quantity} of {plain(element)}: amplitudes"
        axis = Axis("speed, rpm", speed_range(np.unique(measured.rpm)))
        figures.append(figure(caption, axis, f"{quantity}, {unit}", traces))
    title = train_name(identification.train.topology)
    return drawn(*figures, title=f"{title}: measured and computed")


def plot_measured(found: MeasuredOrders, quantity: str, name: str) -> Picture:
    """Draw the largest orders of a measured rotation over the speed."""
    values = found.values(quantity)
    factor, unit = shown_unit(MEASURED[quantity].unit)
    traces = [
        line(
            found.rpm,
            factor * np.abs(values[:, place]),
            f"order {found.orders[place]:g}",
            style,
        )
        for style, place in enumerate(largest_orders(values, MOST))
    ]
    axis = Axis("speed, rpm", speed_range(found.rpm))
    caption = f"{plain(name)}: orders of the {quantity}"
    return drawn(figure(caption, axis, f"{quantity}, {unit}", traces), title=name)


MOST = 4  # elements, or orders, in one picture


def plot_forced(
    cases: Mapping[str, ForcedResponse],
    elements: Sequence[ElementReading],
    worst: Mapping[ElementKey, WorstMisfire] | None = None,
) -> Picture:
    """Draw half peak-to-peak, sum of amplitudes and the largest orders of up to four
    elements over the speed; limits.

    Of more than four readings ``elements`` the shaft and the mesh that swing most are
    drawn. Below stand stresses, tooth torques and heat beside their limits, of the
    elements drawn or of those nearest to a limit. ``cases`` are responses by the
    cylinder that does not fire; of several the ``worst`` misfire
    (:func:`jaxhb.report.text.forced.worst_of`) adds its half peak-to-peak.
    """
    response = cases[""]
    train = train_of(response)
    converged = np.asarray(response.converged)
    answered = [
        element.at(converged) if converged.any() else element for element in elements
    ]
    few = len(elements) <= MOST
    chosen = answered if few else hardest_elements(answered)
    judged = strength(response)

    def worst_misfire(element: ElementKey) -> dict[str, ForcedResponse]:
        """Return the response with the worst misfire of an element, by its title."""
        if not worst:
            return {}
        cylinder = worst[element].cylinder
        misfire = cases[cylinder]
        return {case_title(train_of(misfire), cylinder): misfire}

    figures = [
        orders_figure(response, element, worst_misfire(element.key))
        for element in chosen
    ]
    names = {element.name for element in elements}
    for key, name in judged_elements(judged, names, each=few):
        misfires = {
            title: strength(misfire)
            for title, misfire in worst_misfire((kind_of(LIMITED[key]), name)).items()
        }
        figures.append(limit_figure({"": judged} | misfires, key, name, train))
    return drawn(*figures, title=train_name(response.topology))


def orders_figure(
    response: ForcedResponse,
    element: ElementReading,
    misfires: Mapping[str, ForcedResponse],
    title: str = "",
) -> Figure:
    """Make the figure of synthesis, sum and main orders of an element, an
    ElementReading, over the speed; gaps and crosses without an answer.

    misfires : responses by title, whose half peak-to-peak stands beside it; title : of
    the case
    """
    factor, unit = element.shown
    signal = element.of(response).signal
    rpm = np.asarray(response.rpm)
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
    for case, misfire in misfires.items():
        certain_misfire = np.where(misfire.converged, factor, np.nan)
        values = certain_misfire * element.swing(misfire)
        traces.append(line(rpm, values, f"half peak-to-peak, {plain(case)}", 1))
    names = order_names(train_of(response))
    for number, k in enumerate(element.main()):
        traces.append(
            line(
                rpm,
                certain * signal.amplitudes[:, k],
                f"order {names.number(signal.orders[k])}",
                2 + number,
                mode="lines+markers",
                marker={
                    "symbol": SYMBOLS[number % len(SYMBOLS)],
                    "size": 6,
                    "maxdisplayed": 12,
                },
                look={"width": 1.0},
            )
        )
    for number, (hz, amplitudes) in enumerate(signal.by_line().items()):
        style = 2 + len(element.main()) + number
        look = {"width": 1.0}
        traces.append(line(rpm, certain * amplitudes, f"{hz:g} Hz", style, look=look))
    traces += crosses(rpm[~converged])
    remark = f"linear forced response over the speed, {title}".removesuffix(", ")
    return figure(
        f"{plain(element.name)}: {remark}, {unit}",
        Axis("speed, rpm", speed_range(rpm)),
        f"{element.called}, {unit}",
        traces,
        height=220,  # as the limits below it
    )


def hardest_elements(elements: Sequence[ElementReading]) -> list[ElementReading]:
    """Return the shaft and the mesh with the largest half peak-to-peak, without either
    the disk.
    """
    kinds = by_kind(elements)
    if kinds[1:]:
        kinds = [of_kind for of_kind in kinds if of_kind[0].kind != "disks"]
    return [
        max(of_kind, key=lambda element: np.max(element.signal.half_peak_to_peak))
        for of_kind in kinds
    ]


def judged_elements(
    judged: Strength, names: Collection[str] | None = None, *, each: bool = False
) -> list[tuple[str, str]]:
    """Choose the elements that have a panel, as (key of LIMITED, name), of the elements
    ``names`` or of all: of each kind that with the largest share of its limit, without
    limits that with the largest number, or ``each``.
    """
    chosen = []
    for key, kind in LIMITED.items():
        rows = {
            name: row
            for name, row in getattr(judged, key).items()
            if names is None or name in names
        }

        def most(
            name: str, kind: Limited = kind, rows: dict[str, Any] = rows
        ) -> tuple[float, float]:
            share, place = kind.worst(rows[name])
            value = 0.0 if place is None else getattr(rows[name], kind.field)[place]
            return np.nan_to_num(share, nan=-1.0), value

        chosen += [
            (key, name)
            for name in (rows if each or not rows else [max(rows, key=most)])
        ]
    return chosen


def limit_figure(
    judged: Mapping[str, Strength], key: str, name: str, train: DriveTrain
) -> Figure:
    """Make the figure of one element of :func:`judged_elements` against its limits;
    barred speeds are shaded.

    judged : one :class:`jaxhb.Strength` or more of the same speeds and limits, by the
    titles of their cases; train : as it runs, whose limits are drawn with their steps
    between the speeds
    """
    kind = LIMITED[key]
    first = next(iter(judged.values()))
    traces = []
    called = kind.called
    factor, unit = kind.shown
    doubtful: list[tuple[float, float]] = []
    for number, (title, case) in enumerate(judged.items()):
        row = getattr(case, key)[name]
        values = factor * np.asarray(getattr(row, kind.field), float)
        traces.append(
            line(
                np.asarray(case.rpm),
                values,
                f"{called}, {plain(title)}".removesuffix(", "),
                number,
                mode="lines+markers" if len(values) <= MARKED else "lines",
            )
        )
        if case.unconfirmed is not None:
            doubtful += zip(
                np.asarray(case.rpm)[case.unconfirmed],
                values[case.unconfirmed],
                strict=True,
            )
    speeds, limits = _limits(first, key, name, train)
    for number, (limit, label) in enumerate(
        zip(limits, kind.limits.values(), strict=True)
    ):
        if limit is not None:
            values = factor * np.broadcast_to(limit, np.shape(speeds))
            traces.append(
                line(speeds, values, label, 2 + number, look={"color": "black"})
            )
    traces += rings(doubtful)
    barred = (
        [band for case in judged.values() for band in case.barred.get(name, ())]
        if key == "stresses"
        else []
    )
    shaded = "; grey: barred" if barred else ""
    shaded += " in one of these cases" if barred and len(judged) > 1 else ""
    drawn_limits = sum(limit is not None for limit in limits)
    against = f" against its limit{'s' * (drawn_limits > 1)}" if drawn_limits else ""
    return figure(
        f"{plain(name)}: {called}{against}, {unit}{shaded}",
        Axis("speed, rpm", speed_range(np.asarray(first.rpm))),
        f"{called}, {unit}",
        traces,
        height=180,
        bands=bands([(band.bar_low, band.bar_high) for band in barred]),
    )


def _limits(
    judged: Strength, key: str, name: str, train: DriveTrain
) -> tuple[np.ndarray, list]:
    """Return speeds and the limits of an element there: those of stresses at the speeds
    of a :class:`jaxhb.Strength` and on both sides of every step and corner that their
    rule has between them.
    """
    row = getattr(judged, key)[name]
    kind = LIMITED[key]
    if key != "stresses" or row.continuous is None:
        return np.asarray(judged.rpm), [getattr(row, limit) for limit in kind.limits]
    corners = judged.rated_rpm * np.array(judged.known[judged.rules[name]].corners)
    corners = np.concatenate([corners * (1 - ASTRIDE), corners * (1 + ASTRIDE)])
    within = corners[(corners > np.min(judged.rpm)) & (corners < np.max(judged.rpm))]
    speeds = np.unique(np.concatenate([np.atleast_1d(judged.rpm), within]))
    return speeds, list(stress_limits(train, name, speeds))

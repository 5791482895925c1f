"""Parts of the page of the linear train: natural frequencies and shapes, the Campbell
diagram, forced orders.
"""

import dataclasses

import numpy as np

from jaxhb.linear.critical import (
    ELASTIC,
    campbell as campbell_of,
    excited_orders,
    modes_of,
    shares_in_mode,
)
from jaxhb.linear.forced import forced_response
from jaxhb.linear.strength import strength
from jaxhb.report.answer import SPEED
from jaxhb.report.figures.linear import MOST, campbell_figure, shapes_figure
from jaxhb.report.figures.speeds import hardest_elements, orders_figure
from jaxhb.report.orders import order_names
from jaxhb.report.page.parts import Heading
from jaxhb.report.selection import cylinder_of, misfiring
from jaxhb.report.text.forced import (
    forced_failures,
    misfire_tables,
    readings,
    worst_of,
    worst_tables,
)
from jaxhb.report.text.linear import (
    approximations,
    campbell_parts,
    in_contact,
    modes_text,
)

CAMPBELL_MODES = 6, 12
"""Modes of the Campbell diagram: at least so many, and those that the orders reach up
to the second number.
"""

# Range of a Campbell diagram around one speed, below and above as a share of it
ONE_SPEED = 0.5
LOWEST = 60  # natural frequencies of a train of many disks
TOGETHER = 3  # mode shapes in a figure: what does not fit on a sheet leaves it empty
# Modal torque over the largest of the mode below which a critical speed is not in the
# table
NEGLIGIBLE = 0.01
# Speeds of the linear forced response at least: it costs little and has sharp peaks
SPEEDS = 201


def modes(report):
    """Natural frequencies and the shapes of the first ones that strain links."""
    train = report.train
    found, kinds, ratios = modes_of(train, LOWEST)
    table = modes_text(found, train.topology.title, kinds, ratios, in_contact(train))
    elastic = [k for k, kind in enumerate(kinds) if kind == ELASTIC][:MOST]
    shapes = [elastic[i : i + TOGETHER] for i in range(0, len(elastic), TOGETHER)]
    return [
        table,
        *approximations(train),
        *(shapes_figure(train, found, some, ratios) for some in shapes),
    ]


def campbell(report):
    """Natural frequencies over the speed, orders, critical speeds."""
    low = min(report.rpm)
    high = max(report.rpm)
    low, high = (
        (low * (1 - ONE_SPEED), high * (1 + ONE_SPEED)) if low == high else (low, high)
    )
    speeds = np.linspace(low, high, 33)
    trains = {cylinder_of(case.title): case.answers[0].train for case in report.cases}
    orders = sorted(
        {
            order
            for train in trains.values()
            for order in excited_orders(train, rpm=speeds)
        }
    )
    asked = {"rpm": speeds, "orders": orders, "count": CAMPBELL_MODES[1]}
    found = [campbell_of(train, **asked) for train in trains.values()]
    count = min(max(found[0].reached(), CAMPBELL_MODES[0]), CAMPBELL_MODES[1])
    torques = [
        max(c.torque for c in same)
        for same in zip(*(one.critical for one in found), strict=True)
    ]
    chosen = [
        place
        for place, share in enumerate(shares_in_mode(found[0].critical, torques))
        if share >= NEGLIGIBLE
    ]
    main, *others = (
        dataclasses.replace(
            one, critical=tuple(one.critical[place] for place in chosen)
        )
        for one in found
    )
    misfires = dict(zip(list(trains)[1:], others, strict=True))
    names = order_names(report.train)
    blocks = campbell_parts(main, count, misfires, names)
    left = len(torques) - len(chosen)
    said = (
        f"{left} critical speeds have a modal torque below {100 * NEGLIGIBLE:g} % of"
        " the largest of their mode"
    )
    return [
        campbell_figure(found[0], count, report.cases[0].title, names),
        *blocks,
        *[f"{said}: left out here."] * bool(left),
    ]


def forced(report):
    """The linear forced response over the speeds: the worst of every element, orders of
    what swings most; of several misfires that which governs each element.
    """
    low = min(report.rpm)
    high = max(report.rpm)
    speeds = np.unique(
        [*report.rpm, *(np.linspace(low, high, SPEEDS) if low < high else [])]
    )
    responses = {
        case.title: forced_response(case.answers[0].train, rpm=speeds)
        for case in report.cases
    }
    title, first = next(iter(responses.items()))
    found = readings(first)
    good = np.asarray(first.converged)
    chosen = (
        hardest_elements([one.at(good) for one in found])
        if len(speeds) > 1 and good.any()
        else []
    )
    misfires = {
        other: response for other, response in responses.items() if misfiring(other)
    }
    worst = _worst(first, misfires, found) if len(misfires) > 1 else None
    said = f"Linear, teeth in contact, at {SPEED.span(speeds)}."
    if chosen:
        said += f" Sums and orders in the figures: {title}."
        said += " Lines of a misfire are its half peak-to-peak." if misfires else ""
    blocks = [said, *approximations(report.train, report.rpm)]
    for one in chosen:
        governing = (
            {worst[one.name].cylinder: misfires[worst[one.name].cylinder]}
            if worst
            else misfires
        )
        blocks.append(orders_figure(first, one, governing, title))
    for other, response in responses.items():
        if other == title or not worst:
            blocks += [
                Heading(f"Largest values, {other}"),
                *worst_tables(response, readings(response)),
            ]
        blocks += forced_failures(response, other if other in misfires else "")
    if not worst:
        return blocks
    return [
        *blocks,
        Heading("The worst misfire of every element"),
        *misfire_tables(found, worst, title),
    ]


def _worst(first, misfires, found):
    """The worst misfire of every element by the titles of cases, as :func:`worst_of`;
    None where none has an answer.
    """
    if not any(np.asarray(response.converged).any() for response in misfires.values()):
        return None
    cases = {"": first} | misfires
    return worst_of(
        cases, found, {title: strength(response) for title, response in cases.items()}
    )

"""Parts of the page of the linear train: natural frequencies and shapes, the Campbell
diagram, forced orders.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from jaxhb.linear.critical import (
    ELASTIC,
    campbell as campbell_of,
    excited_orders,
    modes_of,
    shares_in_mode,
)
from jaxhb.linear.forced import ForcedResponse
from jaxhb.linear.margins import separations
from jaxhb.linear.strength import strength
from jaxhb.report.answer import SPEED
from jaxhb.report.figures.linear import MOST, campbell_figure, shapes_figure
from jaxhb.report.figures.speeds import hardest_elements, orders_figure
from jaxhb.report.orders import order_names
from jaxhb.report.page.critical import critical_table, modes_that_matter
from jaxhb.report.page.judgement import for_readers
from jaxhb.report.page.parts import ROWS, Block, Heading, Report, without
from jaxhb.report.selection import cylinder_of, misfiring
from jaxhb.report.table import Table
from jaxhb.report.text.forced import (
    ElementKey,
    ElementReading,
    WorstMisfire,
    by_kind,
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
    separation_tables,
)
from jaxhb.train.varying import at_speed

CAMPBELL_MODES = 6, 12
"""Modes of the Campbell diagram: at least so many, and those that the orders reach up
to the second number.
"""

# Range of a Campbell diagram around one speed, below and above as a share of it
ONE_SPEED = 0.5
LOWEST = 60  # natural frequencies of a train of many disks
BEYOND = 5  # natural frequencies that are listed above the highest excited one
TOGETHER = 3  # mode shapes in a figure: what does not fit on a sheet leaves it empty
# Modal torque over the largest of the mode below which no table has a critical speed
NEGLIGIBLE = 0.01


def speed_of_modes(report: Report) -> float:
    """Speed (rpm) of the modes of trains that depend on it: the rated one, else the
    highest.
    """
    return report.train.topology.rated_rpm or max(report.rpm)


def modes(report: Report) -> list[Block]:
    """Show natural frequencies, and the shapes of the modes that the orders reach."""
    top = max(report.rpm)
    rpm = speed_of_modes(report)
    train = at_speed(report.train, rpm)
    remark = f"Stiffness and damping that depend on the speed are those at {rpm:g} rpm."
    natural, kinds, ratios = modes_of(train, LOWEST)
    table = modes_text(natural, train.topology.title, kinds, ratios, in_contact(train))
    elastic = [k for k, kind in enumerate(kinds) if kind == ELASTIC]
    highest = max(excited_orders(train, rpm=np.array([top])), default=0.0) * top / 60
    reached = sum(natural.frequencies_hz[k] <= highest for k in elastic)
    shown = elastic[: min(max(reached, TOGETHER), MOST)]
    sheets = [shown[i : i + TOGETHER] for i in range(0, len(shown), TOGETHER)]
    last = max([*elastic[: reached + BEYOND], BEYOND]) + 1
    rows = len(table.columns[0])
    left_out = (
        f"{rows - last} higher natural frequencies are left out: the orders end at"
        f" {highest:.4g} Hz."
    )
    return [
        without(table, rows=last),
        *[left_out] * (rows > last),
        *separation_tables(
            separations(train, natural, kinds), train.topology.operating_rpm
        ),
        *[remark] * report.train.topology.depends_on_speed,
        *approximations(train),
        *(shapes_figure(train, natural, sheet, ratios) for sheet in sheets),
        *modes_that_matter(train, natural, kinds, shown),
    ]


def campbell(report: Report) -> list[Block]:
    """Show natural frequencies over the speed, orders, critical speeds."""
    one_speed = ONE_SPEED * (len(set(report.rpm)) == 1)
    low = min(report.rpm) * (1 - one_speed)
    high = max(report.rpm) * (1 + one_speed)
    speeds = np.linspace(low, high, 33)
    trains = {cylinder_of(case.title): case.answers[0].train for case in report.cases}
    orders = sorted(
        {
            order
            for train in trains.values()
            for order in excited_orders(train, rpm=speeds)
        }
    )
    diagrams = [
        campbell_of(train, rpm=speeds, orders=orders, count=CAMPBELL_MODES[1])
        for train in trains.values()
    ]
    normal = diagrams[0]
    count = min(max(normal.reached(), CAMPBELL_MODES[0]), CAMPBELL_MODES[1])
    torques = [
        max(critical.torque for critical in in_all_cases)
        for in_all_cases in zip(
            *(diagram.critical for diagram in diagrams), strict=True
        )
    ]
    chosen = [
        place
        for place, share in enumerate(shares_in_mode(normal.critical, torques))
        if share >= NEGLIGIBLE
    ]
    main, *with_misfire = (
        dataclasses.replace(
            diagram, critical=tuple(diagram.critical[place] for place in chosen)
        )
        for diagram in diagrams
    )
    misfires = dict(zip(list(trains)[1:], with_misfire, strict=True))
    names = order_names(report.train)
    left = len(torques) - len(chosen)
    left_out = (
        f"Left out without a calculation: {left} critical speeds with a modal torque"
        f" below {100 * NEGLIGIBLE:g} % of the largest of their mode."
    )
    # Of constant trains another part has the natural frequencies.
    first, *parts, last = campbell_parts(main, count, misfires, names)
    natural, _, _ = modes_of(at_speed(report.train, speed_of_modes(report)), LOWEST)
    return [
        campbell_figure(normal, count, report.cases[0].title, names),
        *[first] * report.train.topology.depends_on_speed,
        *(part if isinstance(part, Table) else for_readers(part) for part in parts),
        *critical_table(report, main.critical, natural),
        *[last] * (not main.critical),  # it says so
        *[left_out] * bool(left),
    ]


def forced(report: Report) -> list[Block]:
    """Show the linear forced response over the speeds: the worst of every element,
    orders of those that swing most; of several misfires that which governs each
    element.
    """
    speeds = report.fine_rpm
    responses = report.responses
    normal, first = next(iter(responses.items()))
    every = readings(first)
    elements = _largest(every)
    converged = np.asarray(first.converged)
    chosen = (
        hardest_elements([element.at(converged) for element in elements])
        if len(speeds) > 1 and converged.any()
        else []
    )
    misfires = {
        title: response for title, response in responses.items() if misfiring(title)
    }
    worst = _worst(first, misfires, elements) if len(misfires) > 1 else None
    teeth = ", teeth in contact" if report.train.topology.mesh_names else ""
    remark = f"Linear{teeth}, at {SPEED.span(speeds)}."
    if chosen:
        remark += f" Sums and orders in the figures: {normal}."
        remark += " Lines of a misfire are its half peak-to-peak." if misfires else ""
    blocks: list[Block] = [
        remark,
        *approximations(report.train, report.rpm, balanced=True),
    ]
    if len(elements) < len(every):
        blocks.append(
            f"Of {len(every)} elements those with the largest sums of amplitudes are"
            f" shown, {ROWS} of each kind."
        )
    for element in chosen:
        governing = misfires
        if worst:
            title = worst[element.key].cylinder
            governing = {title: misfires[title]}
        blocks.append(orders_figure(first, element, governing, normal))
    for title, response in responses.items():
        if title == normal or not worst:
            blocks += [
                Heading(f"Largest values, {title}"),
                *worst_tables(response, [each.of(response) for each in elements]),
            ]
        blocks += forced_failures(response, title if title in misfires else "")
    if not worst:
        return blocks
    return [
        *blocks,
        Heading("The worst misfire of every element"),
        *misfire_tables(elements, worst, normal),
    ]


def _largest(elements: Sequence[ElementReading]) -> list[ElementReading]:
    """Choose of each kind as many elements as a table shows, those with the largest sum
    of amplitudes, in their order.
    """
    chosen = []
    for of_kind in by_kind(elements):
        sums = [np.max(each.signal.sum_of_amplitudes) for each in of_kind]
        places = np.argsort(-np.array(sums), kind="stable")[:ROWS]
        chosen += [of_kind[place] for place in sorted(places)]
    return chosen


def _worst(
    first: ForcedResponse,
    misfires: Mapping[str, ForcedResponse],
    elements: Sequence[ElementReading],
) -> dict[ElementKey, WorstMisfire] | None:
    """Find the worst misfire of every element by the titles of cases, as
    :func:`worst_of`; None where none has an answer.
    """
    if not any(np.asarray(response.converged).any() for response in misfires.values()):
        return None
    cases = {"": first, **misfires}
    judged = {title: strength(response) for title, response in cases.items()}
    return worst_of(cases, elements, judged)

"""Parts of the page on what the train does, with and without backlash: over the speed,
at one speed in full, and in a second design.
"""

import dataclasses

import numpy as np

from jaxhb.report import quantities
from jaxhb.report.answer import UNCONFIRMED
from jaxhb.report.figures.cycle import cycle_figure
from jaxhb.report.figures.figure import plain
from jaxhb.report.figures.speeds import over_speed
from jaxhb.report.page.differences import differences
from jaxhb.report.page.judgement import SECOND_LIMITS, judged, shares_table
from jaxhb.report.page.parts import Heading
from jaxhb.report.selection import subject_of
from jaxhb.report.text.cases import hardest_of, speed_tables
from jaxhb.report.text.columns import (
    DOUBT,
    NONE,
    Doubtful,
    from_rows,
    hit,
    percent,
    ratio,
)
from jaxhb.report.text.sentences import status_lines, verdict
from jaxhb.report.text.sweep_tables import speed_table, turning_table

MOST, BESIDE = (
    6,
    4,
    # Elements with a figure, of a kind and of two designs: those with the largest
    # numbers
)
# Meshes of the gear that are drawn over the cycle beside the one with the largest force
MESHES = 3


def motions(report):
    """The largest number of all elements and the kind of motion, a row for every speed,
    irregularity.
    """
    cases = report.shown
    quantity = quantities.main_quantity(report.train)
    blocks = []
    if len(report.rpm) > 1:
        caption = f"{quantity.title} of all, {quantity.unit}, and the kind of motion"
        blocks.append(over_speed(quantity, [""], cases, caption))
    blocks += [_misfires(report)] if len(report.cases) > 2 else []
    blocks += [
        speed_table(case.answers, f"Speed by speed, {case.title}") for case in cases
    ]
    blocks += [
        one for case in cases for one in turning_table(case.answers, f", {case.title}")
    ]
    return [*blocks, maxima(quantities.irregularity(report.train), cases)]


def _misfires(report):
    """Every misfire: the largest number of all elements over the speeds."""
    quantity = quantities.main_quantity(report.train)
    rows = []
    for case in report.cases:
        found = hardest_of([case])
        cells = (
            [quantity.factor * found.value, f"{found.answer.rpm:g}", found.name]
            if found
            else [np.nan, NONE, NONE]
        )
        rows.append([case.title, *cells])
    title = f"Every misfire: {quantity.small_title} over the speeds, {quantity.unit}"
    return from_rows(title, ["", (quantity.unit, "number"), "at rpm", "in"], rows)


def forces_over_speed(report):
    """Tooth forces and how long teeth are apart."""
    blocks = swings(quantities.forces(report.train), report.shown)
    apart = quantities.separation(report.train)
    if any(report.train.topology.mesh_backlash) and len(report.rpm) > 1:
        for case in report.shown:
            alone = [dataclasses.replace(case, title="")]
            caption = f"Time out of contact, {case.title}"
            blocks.append(over_speed(apart, apart.names, alone, caption))
    return blocks


def swings(quantity, cases, most=MOST):
    """The largest numbers of all elements in a table, and the hardest worked over the
    speed; a list, empty without.
    """
    names = quantity.hardest(cases)[:most] if len(cases[0].answers) > 1 else []
    said = (
        f"Figures show the {len(names)} with the largest numbers; the table lists all"
        f" {len(quantity.names)}."
    )
    blocks = [said] * (0 < len(names) < len(quantity.names)) + [
        maxima(quantity, cases)
    ] * bool(quantity.names)
    return blocks + [over_speed(quantity, [name], cases) for name in names]


def maxima(quantity, cases):
    """The largest number of every element over the speeds that have an answer, with and
    without backlash; of tooth forces the worst contact too.
    """
    rpm = [answer.rpm for answer in cases[0].answers]
    backlash = any(cases[0].answers[0].topology.mesh_backlash)
    contact = backlash and quantity.called == "tooth force"
    marked = False
    heads = [quantity.element]
    rows = [[name] for name in quantity.names]
    for case in cases:
        heads += [("with" if backlash else quantity.unit, case.title), "at rpm"]
        heads += [("without", case.title), ("ratio", ratio)] * backlash
        heads += [("apart %", percent), ("hit m/s", hit)] * contact
        known = [answer for answer in case.answers if answer.answered]
        for row, name in zip(rows, quantity.names, strict=True):
            values = quantity.of(case.answers, name)
            # Both go over the same speeds: those that have an answer with backlash.
            both = (
                values,
                np.where(
                    np.isfinite(values), quantity.without(case.answers, name), np.nan
                ),
            )
            largest, before = (
                max(own[np.isfinite(own)], default=np.nan) for own in both
            )
            place = values.tolist().index(largest) if np.isfinite(largest) else None
            at = NONE if place is None else f"{rpm[place]:g}"
            doubtful = place is not None and case.answers[place].unconfirmed
            marked |= doubtful
            row += [
                Doubtful(largest) if doubtful else largest,
                at,
                *[before, (largest, before)] * backlash,
            ]
            for field in ("separated_fraction", "hardest_impact") if contact else ():
                row.append(
                    max(
                        (getattr(answer.contacts[name], field) for answer in known),
                        default=np.nan,
                    )
                )
    width = (len(heads) - 1) // len(cases)
    groups = [
        (case.title, 1 + i * width, (i + 1) * width) for i, case in enumerate(cases)
    ]
    said = (
        ", with and without backlash" * backlash + f"; {DOUBT}: {UNCONFIRMED}" * marked
    )
    return from_rows(
        f"{quantity.title} over the speeds, {quantity.unit}{said}", heads, rows, groups
    )


def one_speed(report):
    """One speed in full: verdicts, the cycle, tables of forces and torques, normal and
    misfiring.
    """
    answers = {case.title: case.answers[report.place] for case in report.shown}
    first = report.cases[0].answers[report.place]
    why = (
        f"the speed of the largest {quantities.main_quantity(report.train).called} with"
        f" {report.cases[0].title}"
    )
    why = "as asked for" if report.asked else why
    subject, own = subject_of(first, report.gear)
    meshes = (
        list(dict.fromkeys([*own[:MESHES], first.worst_mesh or own[0]])) if own else ()
    )
    blocks = [f"Shown is {first.rpm:g} rpm, {why}."]
    for title, answer in answers.items():
        lines = [f"{said[0].upper()}{said[1:]}." for said in status_lines(answer)]
        caption = (
            f"{answer.rpm:g} rpm, {plain(title)}: torque of {plain(subject or '')}"
        )
        caption += " and tooth forces" * bool(meshes)
        blocks += [Heading(f"With {title}"), "\n".join([verdict(answer), *lines])]
        blocks += (
            [cycle_figure(answer, subject, meshes, caption)]
            if subject and answer.answered
            else []
        )
    return blocks + speed_tables(report.shown, report.place)


def second_design(report):
    """Another design beside the first: what differs, what it does at the same speeds,
    and its shares of limits.
    """
    if not report.seconds:
        return []
    title = "first design"
    pairs = [
        [
            dataclasses.replace(
                first,
                title=title if first is report.cases[0] else f"{title}, {first.title}",
            ),
            second,
        ]
        for first, second in zip(report.shown, report.seconds, strict=False)
    ]
    trains = (report.train, report.seconds[0].answers[0].train)
    designs = (report.elements, report.second_elements)
    blocks = [
        *(report.tuning or differences(trains, designs)),
        *_beside(pairs[0], BESIDE),
    ]
    for pair in pairs[1:]:
        blocks += [Heading(f"With {report.shown[1].title}"), *_beside(pair, 0)]
    if len(report.cases) > 1 == len(pairs):
        blocks.append(
            "The second design was run without a misfire: nothing here shows what a"
            " misfire does to it."
        )
    shares = shares_table(
        "Largest shares of the limits that each design gives", sum(pairs, [])
    )
    limits = [
        Heading("Limits of both designs"),
        *judged(report.seconds, SECOND_LIMITS),
        shares,
    ]
    return blocks + limits * (shares is not None)


def _beside(cases, most):
    """What two designs do, element by element that both have."""
    trains = [case.answers[0].train for case in cases]
    told = [quantities.forces, quantities.gear_torques, quantities.shaft_torques]
    blocks = []
    for quantity in (
        *(told if trains[0].topology.link_names else [quantities.angles]),
        quantities.heat,
    ):
        mine, its = map(quantity, trains)
        shared = dataclasses.replace(
            mine, names=tuple(name for name in mine.names if name in its.names)
        )
        blocks += swings(shared, cases, most)
    return blocks

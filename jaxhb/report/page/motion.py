"""Parts of the page on what the train does, with and without backlash: over the speed,
at one speed in full, and in a second design.
"""

import dataclasses
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxhb.report import quantities
from jaxhb.report.answer import UNCONFIRMED, Answer, Case
from jaxhb.report.figures.cycle import cycle_figure
from jaxhb.report.figures.figure import plain
from jaxhb.report.figures.speeds import over_speed
from jaxhb.report.page.differences import differences
from jaxhb.report.page.judgement import (
    SECOND_LIMITS,
    for_readers,
    judged,
    shares_table,
)
from jaxhb.report.page.parts import Block, Heading, Report, flowing, without
from jaxhb.report.selection import subject_of
from jaxhb.report.table import Column, Table
from jaxhb.report.text.cases import speed_tables
from jaxhb.report.text.columns import (
    DOUBT,
    NONE,
    Doubtful,
    hit,
    percent,
    plain_number,
    ratio,
)
from jaxhb.report.text.sentences import (
    NO_TEETH,
    motion_text,
    solution_text,
    verdict,
)
from jaxhb.report.text.sweep_tables import motion_sentences, speed_table, turning_table
from jaxhb.results.answers import with_gaps
from jaxhb.results.quantities import VIBRATIONS
from jaxhb.train.kinematics import speed_ratios

# Elements with a figure of two designs, of a kind: those with the largest numbers
BESIDE = 4
# Meshes of the gear that are drawn over the cycle beside the one with the largest force
MESHES = 3


def motions(report: Report) -> list[Block]:
    """Show the largest number of all elements and the kind of motion, a row for every
    speed, irregularity.
    """
    cases = report.shown
    quantity = quantities.main_quantity(report.train)
    blocks: list[Block] = []
    if report.is_linear:
        return [_linear_irregularity(report)]
    blocks += [
        f"With {case.title}: {' '.join(motion_sentences(case.answers))}"
        for case in cases
    ]
    if len(report.rpm) > 1:
        caption = f"{quantity.title} of all, {quantity.unit}, and the kind of motion"
        blocks.append(over_speed(quantity, [""], cases, caption))
    for case in cases:
        by_speed = speed_table(case.answers, f"Speed by speed, {case.title}")
        blocks.append(without(by_speed, ["harmonics"], len(case.answers)))
    for case in cases:
        blocks += turning_table(case.answers, f", {case.title}")
    return [*blocks, maxima(quantities.irregularity(report.train), cases)]


def _linear_irregularity(report: Report) -> Table:
    """Make the table of the largest cyclic irregularity of a linear train, at the
    speeds of its forced response.
    """
    quantity = quantities.irregularity(report.train)
    topology = report.train.topology
    ratios = np.abs(np.asarray(speed_ratios(report.train)))
    columns: list[Column | str] = [quantity.element]
    for case in report.shown:
        columns += [
            Column(quantity.placeholder, case.title, unit="1", group=case.title),
            Column("at rpm", group=case.title),
        ]
    rows = []
    for name in quantity.names:
        ratio_of_disk = ratios[topology.rotor[topology.disk_names.index(name)]]
        cells: list[Any] = [name]
        for case in report.shown:
            response = with_gaps(report.responses[case.title])
            swing = VIBRATIONS["speed"].read(response, name).half_peak_to_peak
            mean = ratio_of_disk * np.asarray(response.rpm) * np.pi / 30
            shares = 2 * np.asarray(swing, float) / mean
            if not np.isfinite(shares).any():
                cells += [np.nan, NONE]
                continue
            place = int(np.nanargmax(shares))
            cells += [float(shares[place]), f"{response.rpm[place]:g}"]
        rows.append(cells)
    return Table(
        f"{quantity.title}: largest over the speeds, {quantity.placeholder}",
        columns,
        rows,
    )


def forces_over_speed(report: Report) -> list[Block]:
    """Show tooth forces and how long teeth are separated."""
    blocks = _largest_numbers(report, quantities.forces(report.train))
    apart = quantities.separation(report.train)
    if any(report.train.topology.mesh_backlash) and len(report.rpm) > 1:
        for case in report.shown:
            alone = [dataclasses.replace(case, title="")]
            caption = f"Separated time, {case.title}"
            blocks.append(over_speed(apart, apart.names, alone, caption))
    return blocks


def gears(report: Report) -> list[Block]:
    """Show torques of gears."""
    return _largest_numbers(report, quantities.gear_torques(report.train))


def shafts(report: Report) -> list[Block]:
    """Show torques of shafts and dampers, without links angles."""
    links = report.train.topology.link_names
    quantity = quantities.shaft_torques if links else quantities.angles
    return _largest_numbers(report, quantity(report.train))


def dampers(report: Report) -> list[Block]:
    """Show the heat of dampers."""
    return _largest_numbers(report, quantities.heat(report.train))


def _largest_numbers(report: Report, quantity: quantities.Quantity) -> list[Block]:
    """Show the largest numbers of all elements, in a list; of a linear train the part
    on its forced response has them.
    """
    if report.is_linear or not quantity.names:
        return []
    return [maxima(quantity, report.shown)]


def swings(
    quantity: quantities.Quantity, cases: Sequence[Case], most: int
) -> list[Block]:
    """Show the largest numbers of all elements in a table, and the hardest worked over
    the speed; a list, empty without.
    """
    names = quantity.hardest(cases)[:most] if len(cases[0].answers) > 1 else []
    blocks: list[Block] = []
    if 0 < len(names) < len(quantity.names):
        blocks.append(
            f"Figures show the {len(names)} with the largest numbers; the table lists"
            f" all {len(quantity.names)}."
        )
    if quantity.names:
        blocks.append(maxima(quantity, cases))
    return blocks + [over_speed(quantity, [name], cases) for name in names]


def maxima(quantity: quantities.Quantity, cases: Sequence[Case]) -> Table:
    """Make a table of the largest number of every element over the speeds that have an
    answer, with and without backlash; of tooth forces the worst contact too.
    """
    backlash = any(cases[0].answers[0].topology.mesh_backlash)
    contact = backlash and quantity.called == "tooth force"
    unit = quantity.entry.unit
    columns: list[Column | str] = [quantity.element]
    for case in cases:
        head = "with" if backlash else quantity.placeholder
        largest = Column(head, case.title, unit=unit)
        of_case = [largest, Column("at rpm")]
        of_case += [
            Column("without", case.title, unit=unit),
            Column("ratio", ratio),
        ] * backlash
        of_case += [Column("separated %", percent), Column("impact m/s", hit)] * contact
        columns += [dataclasses.replace(each, group=case.title) for each in of_case]
    rows = [
        [
            name,
            *(
                cell
                for case in cases
                for cell in _largest(quantity, case, name, backlash)
            ),
        ]
        for name in quantity.names
    ]
    marked = any(isinstance(cell, Doubtful) for row in rows for cell in row)
    remark = ", with and without backlash" if backlash else ""
    remark += f"; {DOUBT}: {UNCONFIRMED}" if marked else ""
    begin = "" if quantity.title.startswith("Largest") else ", largest"
    return Table(
        f"{quantity.title}{begin} over the speeds, {quantity.placeholder}{remark}",
        columns,
        rows,
    )


def _largest(
    quantity: quantities.Quantity, case: Case, name: str, backlash: bool
) -> list:
    """Find the largest number of an element over the speeds and its speed, where teeth
    have backlash the same without and their ratio, of tooth forces the worst contact.
    """
    answered = [answer for answer in case.answers if answer.answered]
    values = quantity.numbers(case.answers, name)
    finite = np.isfinite(values)
    largest = max(values[finite], default=np.nan)
    cells = [largest, NONE]
    if finite.any():
        answer = case.answers[int(np.nanargmax(values))]
        cells = [
            Doubtful(largest) if answer.unconfirmed else largest,
            f"{answer.rpm:g}",
        ]
    if not backlash:
        return cells
    alone = [answer.without_backlash for answer in case.answers]
    without = quantity.numbers(alone, name)
    # Both go over the same speeds: those that have an answer with backlash.
    before = max(without[finite & np.isfinite(without)], default=np.nan)
    cells += [before, (largest, before)]
    fields = ("separated_fraction", "hardest_impact")
    return cells + [
        max((getattr(each.contacts[name], field) for each in answered), default=np.nan)
        for field in fields * (quantity.called == "tooth force")
    ]


def one_speed(report: Report) -> list[Block]:
    """Show one speed in full: verdicts, the cycle, tables of forces and torques, normal
    and misfiring.
    """
    answers = {case.title: case.answers[report.place] for case in report.shown}
    first = report.cases[0].answers[report.place]
    why = "as asked for"
    if not report.place_asked:
        called = quantities.main_quantity(report.train).called
        why = f"the speed of the largest {called} with {report.cases[0].title}"
        if report.is_linear:
            why = f"of the speeds asked for {why}"
    subject, subject_meshes = subject_of(first, report.gear)
    meshes = (
        list(
            dict.fromkeys(
                [*subject_meshes[:MESHES], first.worst_mesh or subject_meshes[0]]
            )
        )
        if subject_meshes
        else ()
    )
    blocks: list[Block] = [f"Shown is {first.rpm:g} rpm, {why}."]
    for title, answer in answers.items():
        lines = [f"Motion: {motion_text(answer)}.", *_accuracy_line(answer)]
        blocks.append(Heading(f"With {title}"))
        if not report.is_linear:
            blocks.append("\n".join([verdict(answer), *lines]))
        if subject and answer.answered:
            caption = f"{answer.rpm:g} rpm, {plain(title)}: torque of {plain(subject)}"
            caption += " and tooth forces" if meshes else ""
            blocks.append(cycle_figure(answer, subject, meshes, caption))
    # Of a linear train other parts have these numbers where they are largest.
    return blocks + (
        [] if report.is_linear else speed_tables(report.shown, report.place)
    )


def _accuracy_line(answer: Answer) -> list[str]:
    """Say how accurate the numbers of a harmonic solution are, in a list; empty of
    motions that were recorded.
    """
    response = answer.response
    if response is None:
        return []
    if not answer.converged:
        return [f"{solution_text(answer)}."]
    error = 100 * float(response.truncation_error)
    return [
        f"Error of the tooth forces, as estimated: {plain_number(error, 2)} % of the"
        f" largest, with {answer.harmonics} harmonics."
    ]


def second_design(report: Report) -> list[Block]:
    """Show another design beside the first: what differs, what it does at the same
    speeds, and its shares of limits.
    """
    if not report.seconds:
        return []
    pairs = []
    for first, second in zip(report.shown, report.seconds, strict=False):
        normal = first is report.cases[0]
        title = "first design" if normal else f"first design, {first.title}"
        pairs.append([dataclasses.replace(first, title=title), second])
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
        "Largest shares of the limits that each design gives",
        [case for pair in pairs for case in pair],
    )
    if shares is None:
        return blocks
    heading = Heading("Limits of both designs")
    return [*blocks, heading, *judged(report.seconds, SECOND_LIMITS), shares]


def _beside(cases: Sequence[Case], most: int) -> list[Block]:
    """Show two designs, element by element that both have."""
    trains = [case.answers[0].train for case in cases]
    links = [quantities.forces, quantities.gear_torques, quantities.shaft_torques]
    blocks = []
    for quantity in (
        *(links if trains[0].topology.link_names else [quantities.angles]),
        quantities.heat,
    ):
        first, second = map(quantity, trains)
        names = tuple(name for name in first.names if name in second.names)
        blocks += swings(dataclasses.replace(first, names=names), cases, most)
    return blocks


def transient(report: Report) -> list[Block]:
    """Show a transient where one was asked for."""
    blocks: list[Block] = []
    for block in report.transient:
        if type(block) is not str:
            blocks.append(block)
            continue
        text = block
        if not report.train.topology.mesh_names:
            text = text.removeprefix(NO_TEETH).lstrip()
        head, _, lines = text.partition("\n  ")
        if head == "Notes":
            # Lines of a note that go on are indented further.
            notes = re.split(r"\n  (?! )", re.sub(r"\n {4}", " ", lines))
            blocks += [f"{note[0].upper()}{for_readers(note)[1:]}" for note in notes]
        else:
            blocks.append(flowing(text))
    return blocks

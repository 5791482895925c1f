"""Parts of the page over the speed: kinds of motion, tooth forces, torques, heat, each with and without backlash."""

import dataclasses
import textwrap

import numpy as np

from jaxhb.report.figures.figure import NO_ANSWER, SYMBOLS, Figure, kind_of, kind_word, layout, marks, speed_range
from jaxhb.report.figures.sweep import over_speed
from jaxhb.report.quantities import (
    angles,
    forces,
    gear_torques,
    heat,
    irregularity,
    main_quantity,
    separation,
    shaft_torques,
)
from jaxhb.report.selection import largest
from jaxhb.report.text.columns import NONE, Table, alike, ratios, shares
from jaxhb.report.text.sweep_tables import speed_table, turning_table

MANY = 40
"""Speeds above which symbols are small."""

MOST = 6
"""Elements of a kind that have a figure, those with the largest numbers; tables tell of all."""


def map_part(report):
    """The kind of motion at every speed, the largest number of all elements, a row for every speed, irregularity."""
    cases, several = report.shown, len(report.rpm) > 1
    blocks = [_kinds(cases), _overview(cases, main_quantity(report.train))] if several else []
    if len(report.cases) > 2:
        blocks.append(_misfires(report))
    blocks += [speed_table(case.answers, f"Speed by speed, {case.title}") for case in cases]
    blocks += [table for case in cases for table in turning_table(case.answers, f", {case.title}")]
    return [*blocks, maxima(irregularity(report.train), cases)]


def _kinds(cases):
    """A row of symbols for every case."""
    traces = []
    for row, case in enumerate(cases):
        for kind in (*SYMBOLS, None):
            speeds = [answer.rpm for answer in case.answers if kind_of(answer) == kind]
            if speeds:
                said = kind_word(kind) if kind else NO_ANSWER
                traces.append(marks(speeds, np.full(len(speeds), -row), said, SYMBOLS.get(kind, "x-thin-open")))
                traces[-1] |= {"showlegend": all(said != trace["name"] for trace in traces[:-1])}
                traces[-1] |= {"hovertemplate": "%{x} rpm: " + said + "<extra></extra>"}
                traces[-1]["marker"] |= {
                    "size": 8 if len(case.answers) <= MANY else 5,
                    "line": {"width": 0 if kind else 2, "color": "black"},
                }
    rpm = [answer.rpm for answer in cases[0].answers]
    panels = [("", (0.6 - len(cases), 0.6))]
    made = layout("speed, rpm", panels, traces, x_range=speed_range(rpm), heights=[22 + 22 * len(cases)])
    titles = ["<br>".join(textwrap.wrap(case.title, 22)) for case in cases]
    made["yaxis"] |= {"tickvals": [-row for row in range(len(cases))], "ticktext": titles, "showgrid": False}
    made["margin"] |= {"l": 130}
    return Figure("Kind of motion over the speed", traces, made)


def _overview(cases, quantity):
    """The largest number of all elements over the speed, with and without backlash."""

    def largest_number(motion, _):
        return max(float(quantity.read(motion, name)) for name in quantity.names)

    whole = dataclasses.replace(quantity, names=("",), read=largest_number)
    return over_speed(whole, whole.names, cases, f"{quantity.title} of all, {quantity.unit}")


def _misfires(report):
    """Every misfire: the largest number of all elements over the speeds."""
    quantity, rows = main_quantity(report.train), []
    for case in report.cases:
        values = {name: quantity.of(case.answers, name) for name in quantity.names}
        name = largest(values, lambda name, values=values: _or_nan(values[name]))
        rows.append((case.title, name or NONE, values.get(name, np.array([np.nan]))))
    columns = [
        [title for title, *_ in rows],
        *alike([_or_nan(values) for *_, values in rows]),
        [_at(report.rpm, values) for *_, values in rows],
        [name for _, name, _ in rows],
    ]
    title = f"Every misfire: {quantity.small_title} over the speeds, {quantity.unit}"
    return Table(title, ["", quantity.unit, "at rpm", "in"], columns, left=(3,))


def _at(rpm, values):
    return f"{rpm[int(np.nanargmax(values))]:g}" if np.isfinite(values).any() else NONE


def forces_part(report):
    """Tooth forces and how long teeth are apart."""
    if not report.train.topology.mesh_names:
        return []
    quantity, cases = forces(report.train), report.shown
    tables = [maxima(quantity, cases, contact=True)]
    figures = [over_speed(quantity, [name], cases) for name in _drawn(report, quantity)]
    apart, train = [], report.train
    if any(train.topology.mesh_backlash) and len(report.rpm) > 1:
        for case in cases:
            alone = [dataclasses.replace(case, title="")]
            caption = f"Time out of contact, {case.title}"
            apart.append(over_speed(separation(train), train.topology.mesh_names, alone, caption))
    return _few(report, quantity) + tables + figures + apart


def gears_part(report):
    """Torques of gears."""
    return _swings(report, gear_torques(report.train))


def shafts_part(report):
    """Torques of shafts and dampers; of a train without links the angles of its disks."""
    return _swings(report, (shaft_torques if report.train.topology.link_names else angles)(report.train))


def _swings(report, quantity):
    if not quantity.names:
        return []
    figures = [over_speed(quantity, [name], report.shown) for name in _drawn(report, quantity)]
    return [*_few(report, quantity), maxima(quantity, report.shown), *figures]


def _drawn(report, quantity):
    return quantity.hardest(report.shown)[:MOST] if len(report.rpm) > 1 else []


def _few(report, quantity):
    """A sentence where not all elements have a figure."""
    left = len(quantity.names) - MOST
    if left <= 0 or len(report.rpm) < 2:
        return []
    return [f"Figures show the {MOST} with the largest numbers; the table lists all {len(quantity.names)}."]


def maxima(quantity, cases, *, contact=False):
    """The largest number of every element over the speeds that have an answer, with and without backlash; of meshes the
    worst contact."""
    rpm, names = [answer.rpm for answer in cases[0].answers], quantity.names
    backlash = any(cases[0].answers[0].topology.mesh_backlash)
    columns, heads = [names], [quantity.element]
    for case in cases:
        values = [quantity.of(case.answers, name) for name in names]
        before = [quantity.without(case.answers, name) for name in names]
        # Both columns go over the same speeds: those that have an answer with backlash.
        before = [np.where(np.isfinite(own), other, np.nan) for own, other in zip(values, before, strict=True)]
        pair = [_or_nan(column) for column in values], [_or_nan(column) for column in before]
        shown = alike(*pair)
        columns += [shown[0], [_at(rpm, column) for column in values]]
        heads += ["with" if backlash else quantity.unit, "at rpm"]
        if backlash:
            columns += [shown[1], ratios(*pair)]
            heads += ["without", "ratio"]
        if backlash and contact:
            columns += _contact_columns(case, names)
            heads += ["apart %", "hit m/s"]
    width = (len(heads) - 1) // len(cases)
    groups = [(case.title, 1 + i * width, (i + 1) * width) for i, case in enumerate(cases)]
    said = ", with and without backlash" if backlash else ""
    return Table(f"{quantity.title} over the speeds, {quantity.unit}{said}", heads, columns, groups)


def _or_nan(values):
    return float(np.nanmax(values)) if np.isfinite(values).any() else float("nan")


def _contact_columns(case, names):
    """Longest time apart and hardest impact of every mesh."""
    known = [answer for answer in case.answers if answer.answered]
    apart = [max((a.contacts[name].separated_fraction for a in known), default=None) for name in names]
    hits = [max((a.contacts[name].hardest_impact for a in known), default=0.0) for name in names]
    return [shares(apart), [f"{hit:.2f}" if hit > 0 else NONE for hit in hits]]


def power_part(report):
    """Power that dampers turn into heat."""
    return _swings(report, heat(report.train))

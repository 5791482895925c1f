"""Parts of the page that answer first: what is judged, worst first, by which rule, and
in which operating modes.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxhb.linear.strength import BarredRange, Strength
from jaxhb.report import quantities
from jaxhb.report.answer import Case
from jaxhb.report.page.judgement import reversing
from jaxhb.report.page.parts import Block, Report, flowing
from jaxhb.report.quantities import Quantity
from jaxhb.report.table import Column, Table
from jaxhb.report.text.cases import hardest_of, worst_misfire
from jaxhb.report.text.columns import NONE, plain_number
from jaxhb.report.text.sentences import firing_lines, misfire_text
from jaxhb.report.text.strength import (
    AID,
    ENOUGH,
    LIMITED,
    Share,
    largest_shares,
    rule_notes,
)
from jaxhb.report.text.sweep_tables import motion_sentences
from jaxhb.report.units import shown_unit
from jaxhb.results.answers import with_gaps

ROWS = 18  # rows of the table on the first page
WITHIN = "within"
ABOVE = "ABOVE"
UNJUDGED = "no limit given"
REASONS = 8  # elements that a sentence names


Range = tuple[float, float]
"""Speeds from and to, rpm."""


@dataclass(frozen=True)
class Judged:
    """A row of the answer: the ``quantity`` of an element where it is worst, numbers in
    the ``unit`` for people; limit and share are nan where none is given.
    """

    element: str
    quantity: str
    value: float
    limit: float
    unit: str
    share: float
    rpm: float
    case: str

    @property
    def verdict(self) -> str:
        """A word beside the colour of the row."""
        if np.isnan(self.share):
            return UNJUDGED
        return ABOVE if self.share > 1 else WITHIN


def result(report: Report) -> list[Block]:
    """Answer in a table, worst first, and in a few sentences: whether a limit is
    exceeded, what the teeth do, which speeds are in doubt.
    """
    rows = judged_rows(report)
    blocks: list[Block] = []
    if rows:
        blocks.append(_answer_table(rows[:ROWS]))
    if len(rows) > ROWS:
        blocks.append(
            f"{len(rows) - ROWS} more rows have smaller shares: see the statement of"
            " compliance."
        )
    strengths = report.strengths
    blocks += [_verdict(report, rows), *_barred(strengths), *reversing(strengths)]
    if report.has_backlash or _unanswered(report.cases):
        blocks.append(
            " ".join(
                f"With {case.title}: {motion_sentences(case.answers)[0]}"
                for case in report.shown
            )
        )
    return [*blocks, _doubts([*report.cases, *report.seconds])]


def judged_rows(report: Report) -> list[Judged]:
    """Make a row for every element with a limit, worst first, then one for every
    quantity that is not judged, of the element with the largest number.
    """
    shares = largest_shares(report.strengths)
    rows = [_of_share(share) for share in shares.values()]
    rows += _passing(report.strengths)
    rows.sort(key=lambda row: -row.share)
    return rows + [
        row
        for quantity in unjudged(report, {key for key, _ in shares})
        for row in _largest(quantity, report.cases)
    ]


def unjudged(report: Report, judged: Iterable[str]) -> list[Quantity]:
    """Choose the quantities of the train that no limit of the kinds ``judged`` is
    about.
    """
    train = report.train
    torques = (
        quantities.shaft_torques if train.topology.link_names else quantities.angles
    )
    every = {
        "": quantities.forces(train),
        "tooth_torques": quantities.gear_torques(train),
        "stresses": torques(train),
        "heat": quantities.heat(train),
    }
    return [
        quantity
        for key, quantity in every.items()
        if quantity.names and key not in judged
    ]


def _of_share(share: Share) -> Judged:
    """Make the row of the largest share of a limit."""
    factor, unit = shown_unit(share.kind.si_unit, share.value)
    value = factor * share.value
    return Judged(
        share.name,
        share.kind.called,
        value,
        value / share.share if share.share else np.nan,
        unit,
        share.share,
        share.rpm,
        share.case,
    )


def _passing(strengths: Mapping[str, Strength]) -> list[Judged]:
    """Make a row for every stress that is above the limit of passing through rapidly,
    where it is most.
    """
    worst: dict[str, Judged] = {}
    factor, unit = LIMITED["stresses"].shown
    for title, strength in strengths.items():
        for name, row in strength.stresses.items():
            if row.transient is None:
                continue
            stress = np.asarray(row.stress, float)
            limit = np.broadcast_to(row.transient, stress.shape)
            shares = np.where(np.isfinite(limit), stress / limit, np.nan)
            if not np.any(shares > 1):
                continue
            place = int(np.nanargmax(shares))
            judged = Judged(
                name,
                "stress when passed through",
                factor * stress[place],
                factor * limit[place],
                unit,
                shares[place],
                float(strength.rpm[place]),
                title,
            )
            if name not in worst or judged.share > worst[name].share:
                worst[name] = judged
    return list(worst.values())


def _largest(quantity: Quantity, cases: Sequence[Case]) -> list[Judged]:
    """Make the row of the element with the largest number of a quantity, in a list."""
    best: list[Judged] = []
    for case in cases:
        for name in quantity.names:
            values = quantity.of(case.answers, name)
            if not np.isfinite(values).any():
                continue
            place = int(np.nanargmax(values))
            if best and best[0].value >= values[place]:
                continue
            best = [
                Judged(
                    name,
                    quantity.small_title,
                    float(values[place]),
                    np.nan,
                    quantity.unit,
                    np.nan,
                    case.answers[place].rpm,
                    case.title,
                )
            ]
    return best


def _answer_table(rows: Sequence[Judged]) -> Table:
    """Make the table of the answer; rows above their limit are marked."""

    def number(value: float) -> str:
        return plain_number(value) if np.isfinite(value) else NONE

    judged = any(row.verdict != UNJUDGED for row in rows)
    largest = f"Largest shares of limits ({AID})" if judged else "Largest numbers"
    share = [
        Column("share", _share, lambda row: row.share),
        Column("", read=lambda row: row.verdict, left=True),
    ]
    return Table(
        f"{largest}, over all speeds and operating modes",
        [
            Column("element", read=lambda row: row.element),
            Column("quantity", read=lambda row: row.quantity, left=True),
            Column("value", number, lambda row: row.value),
            *[Column("limit", number, lambda row: row.limit)] * judged,
            Column("unit", read=lambda row: row.unit, left=True),
            *share * judged,
            Column("at rpm", "{:g}".format, lambda row: row.rpm),
            Column("case", read=lambda row: row.case, left=True),
        ],
        rows,
        marked=[place for place, row in enumerate(rows) if row.verdict == ABOVE],
    )


def _share(share: float) -> str:
    """Write a share with two decimals, a dash where there is none."""
    return f"{share:.2f}" if np.isfinite(share) else NONE


def _verdict(report: Report, rows: Sequence[Judged]) -> str:
    """Say in a sentence how many of the judged rows are above their limit, and from how
    many speeds that is known.
    """
    if not rows:
        return "No speed has an answer."
    judged = [row for row in rows if row.verdict != UNJUDGED]
    if not judged:
        return (
            "NOT JUDGED: the scene gives no limits (no diameter of a shaft, no"
            " rated_torque of a mesh, no power_limit)."
        )
    over = sum(row.verdict == ABOVE for row in judged)
    count = len(report.fine_rpm if report.is_linear else report.rpm)
    speeds = f"judged at {count} speeds" if count > 1 else "judged at one speed"
    few = "" if count >= ENOUGH else f" (use {ENOUGH} or more to find all resonances)"
    if over:
        return f"{over} of {len(judged)} are ABOVE A LIMIT, {speeds}{few}."
    return f"All {len(judged)} are within their limits, {speeds}{few}."


def _barred_ranges(strengths: Mapping[str, Strength]) -> dict[str, list[Range]]:
    """Collect the barred ranges of every shaft that has one, of all cases together."""
    ranges: dict[str, list[Range]] = {}
    for strength in strengths.values():
        for name, barred in _ranges_of(strength).items():
            bands = [(float(band.bar_low), float(band.bar_high)) for band in barred]
            if bands:
                ranges.setdefault(name, []).extend(bands)
    return {name: _joined(bands) for name, bands in ranges.items()}


def _ranges_of(strength: Strength) -> Mapping[str, tuple[BarredRange, ...]]:
    """Barred ranges of every shaft; none of one speed."""
    return strength.barred if len(strength.rpm) > 1 else {}


def _barred(strengths: Mapping[str, Strength]) -> list[str]:
    """Tell the speeds that are to be barred, of all cases and shafts together, with the
    shafts that ask for each range, in a sentence in a list.
    """
    ranges = _barred_ranges(strengths)
    texts = []
    for low, high in _joined(band for bands in ranges.values() for band in bands):
        names = [
            name
            for name, bands in ranges.items()
            if any(low <= band[0] <= high for band in bands)
        ]
        texts.append(f"{low:.4g} to {high:.4g} rpm, by {_some(names)}")
    return [f"Barred speed ranges: {'; '.join(texts)}."] if texts else []


def _some(names: Sequence[str]) -> str:
    """Name a few of many elements.

    >>> _some(["a", "b"])
    'a, b'
    """
    more = f" and {len(names) - REASONS} more" if len(names) > REASONS else ""
    return f"{', '.join(names[:REASONS])}{more}"


def _joined(bands: Iterable[Range]) -> list[Range]:
    """Join ranges that overlap, by rising speed.

    >>> _joined([(3.0, 4.0), (1.0, 2.0), (1.5, 2.5)])
    [(1.0, 2.5), (3.0, 4.0)]
    """
    joined: list[Range] = []
    for low, high in sorted(bands):
        if joined and low <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(joined[-1][1], high))
        else:
            joined.append((low, high))
    return joined


def _unanswered(cases: Sequence[Case]) -> bool:
    """Tell whether a case has no answer at all."""
    return any(not any(each.answered for each in case.answers) for case in cases)


def _doubts(cases: Sequence[Case]) -> str:
    """Say at how many speeds a case has no answer; "" where all have one."""
    missing = {
        case.title: sum(not answer.answered for answer in case.answers)
        for case in cases
    }
    doubts = ", ".join(
        f"{count} of {len(cases[0].answers)} ({title})"
        for title, count in missing.items()
        if count
    )
    return (
        f"Speeds WITHOUT AN ANSWER, left out of all largest values: {doubts}."
        if doubts
        else ""
    )


def compliance(report: Report) -> list[Block]:
    """State element by element by which rule it is judged, and whether it complies; and
    what is not judged.
    """
    shares = largest_shares(report.strengths)
    if not shares:
        return []  # the result says so
    strength = report.strengths[report.cases[0].title]
    late = {row.element for row in _passing(report.strengths)}
    late |= _refused_ranges(report.strengths)
    bands = _barred_ranges(report.strengths)
    rows = [
        (
            name,
            share.kind.called,
            rule_of(strength, key, name),
            _share(share.share),
            f"{share.rpm:g}",
            share.case,
            _statement(share, key == "stresses" and name in bands, name in late),
        )
        for (key, name), share in shares.items()
    ]
    columns: list[Column | str] = [
        "element",
        Column("judged", left=True),
        Column("rule", left=True),
        "largest share",
        "at rpm",
        Column("case", left=True),
        Column("statement", left=True),
    ]
    table = Table(
        f"Statement of compliance by element and rule ({AID})",
        columns,
        rows,
        marked=[place for place, row in enumerate(rows) if "NOT" in row[-1]],
    )
    return [table, *map(flowing, rule_notes(strength)), *_without_limit(report, shares)]


def rule_of(strength: Strength, key: str, name: str) -> str:
    """Name the rule by which an element is judged: of stresses that of the shaft, of
    other numbers what :data:`LIMITED` calls their limit.
    """
    if key == "stresses" and name in strength.rules:
        rule = strength.known[strength.rules[name]]
        return rule.title or rule.name
    return LIMITED[key].rule


def _refused_ranges(strengths: Mapping[str, Strength]) -> set[str]:
    """Find the shafts with a barred range at speeds at which their rule accepts
    none.
    """
    refused = set()
    for strength in strengths.values():
        for name, ranges in _ranges_of(strength).items():
            rule = strength.known[strength.rules[name]]
            rated = strength.rated_rpm
            assert rated is not None  # rules are those of a rated speed
            if not all(each.accepted_by(rule, rated) for each in ranges):
                refused.add(name)
    return refused


def _statement(share: Share, barred: bool, late: bool) -> str:
    """State whether an element complies; ``late``: a stress is above the limit of
    passing, or a range barred where none is accepted.
    """
    if late:
        return "does NOT comply"
    if share.share <= 1:
        return "complies"
    return "complies with barred ranges" if barred else "does NOT comply"


def _without_limit(report: Report, shares: Iterable[tuple[str, str]]) -> list[str]:
    """Name shafts, dampers and meshes for which the scene gives no limit, in a sentence
    in a list.
    """
    topology = report.train.topology
    judged = {name for _, name in shares}
    links = [name for name in topology.link_names if name not in judged]
    if not links:
        return []
    return [f"NOT judged, as the scene gives no limit: {_some(links)}."]


def _largest_of(quantity: Quantity) -> str:
    """Name the largest number of a quantity.

    >>> import jaxhb
    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> _largest_of(quantities.main_quantity(train))
    'largest torque of shafts and dampers, half peak-to-peak,'
    """
    title = f"largest {quantity.small_title.removeprefix('largest ')}"
    return f"{title}," if "," in title else title


def _hardest_cells(report: Report, case: Case, quantity: Quantity) -> list[Any]:
    """Cells of the largest number of a case: value, speed and element; of linear trains
    at the speeds between those given, too, as everywhere on the page.
    """
    nothing = [np.nan, NONE, NONE]
    if not (report.is_linear and case.title in report.responses):
        hardest = hardest_of([case])
        if hardest is None:
            return nothing
        return [
            quantity.factor * hardest.value,
            f"{hardest.answer.rpm:g}",
            hardest.name,
        ]
    response = with_gaps(report.responses[case.title])
    values = np.array(
        [
            np.asarray(quantity.signal(response, name).half_peak_to_peak, float)
            for name in quantity.names
        ]
    )
    if not np.isfinite(values).any():
        return nothing
    element, place = np.unravel_index(np.nanargmax(values), values.shape)
    rpm = f"{response.rpm[place]:g}"
    return [quantity.factor * values[element, place], rpm, quantity.names[element]]


def operating_modes(report: Report) -> list[Block]:
    """List the cases that are computed, with their largest number, and what is taken of
    cylinders that do not fire.
    """
    quantity = quantities.main_quantity(report.train)
    rows = []
    for case in [*report.cases, *report.seconds]:
        cells = _hardest_cells(report, case, quantity)
        answered = sum(answer.answered for answer in case.answers)
        speeds = f"{report.rpm[0]:g}"
        if len(report.rpm) > 1:
            speeds = f"{min(report.rpm):g} to {max(report.rpm):g}"
        rows.append([case.title, speeds, f"{answered} of {len(report.rpm)}", *cells])
    table = Table(
        f"Operating modes; {_largest_of(quantity)} over the speeds, {quantity.unit}",
        [
            "case",
            "speeds rpm",
            "with a result",
            Column(quantity.unit, "number"),
            "at rpm",
            Column("in", left=True),
        ],
        rows,
    )
    cases = report.cases
    worst = worst_misfire(cases) if len(cases) > 2 else None
    of_all = f"Of all {len(cases) - 1}: "
    return [
        table,
        *firing_lines(*(case.answers[0].train for case in cases)),
        of_all + misfire_text(worst, cases[0].title) if worst else None,
    ]

"""A transient for people: peaks of shafts, dampers and meshes, stresses beside their
limits, passages.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jaxhb._shown import number
from jaxhb.report.selection import train_name
from jaxhb.report.table import Column, Table
from jaxhb.report.text.columns import NONE, hit, plain_number, ratio
from jaxhb.report.text.sentences import NO_TEETH, firing_lines, remarks_text
from jaxhb.report.text.strength import AID, LIMITED, range_text
from jaxhb.report.transients import (
    BARRED_SPEEDS,
    Fatigue,
    StressPeak,
    TransientReport,
    signal_for_people,
)
from jaxhb.train.checks.plausible import plausibility
from jaxhb.transients.history import History
from jaxhb.transients.motion import ToothContact


def transient_text(report: TransientReport) -> str:
    """Tell a transient, with the notes on its scene."""
    notes = remarks_text([*plausibility(report.run.train), *report.run.notes])
    return "\n\n".join([*transient_parts(report), *notes])


def transient_parts(report: TransientReport) -> list[str]:
    """Make verdict, duration and speeds, tables, passages, and what limits are of."""
    parts = [_head(report), *_tables(report), *_stress_parts(report)]
    parts += _peak_tables(report)
    return [*parts, *_passage_parts(report), *_rule_parts(report)]


def transient_verdict(report: TransientReport) -> str:
    """Say in one sentence whether teeth part or hit."""
    topology = report.topology
    if not topology.mesh_names:
        return NO_TEETH
    if not any(topology.mesh_backlash):
        return "No mesh has backlash: the teeth cannot separate."
    contacts = {name: report.run.mesh(name) for name in topology.mesh_names}
    apart = {name: contact for name, contact in contacts.items() if contact.separated}
    if not apart:
        return "All teeth stay in contact."
    name = min(apart, key=lambda mesh: apart[mesh].first_separation)
    first = apart[name].first_separation
    longest = max(apart, key=lambda mesh: apart[mesh].separated)
    contact = apart[longest]
    impacts = "without an impact"
    if contact.impacts:
        impacts = (
            f"with {contact.impacts} impact{'s' * (contact.impacts > 1)}, the hardest"
            f" at {hit(contact.hardest_impact)} m/s"
        )
    apart_for = f"for {number(contact.separated)} s in all, {impacts}."
    if name == longest:
        return f"Teeth of {name} separate, first at {_at(report, first)}, {apart_for}"
    return (
        f"Teeth separate, first those of {name} at {_at(report, first)}, longest those"
        f" of {longest}, {apart_for}"
    )


def _at(report: TransientReport, seconds: float) -> str:
    """Write an instant with its speed."""
    rpm = float(np.interp(seconds, report.run.time, report.run.rpm))
    return f"{number(seconds)} s ({number(rpm)} rpm)"


def _head(report: TransientReport) -> str:
    """Write the verdict and which transient it is."""
    run = report.run
    first, last = float(run.rpm[0]), float(run.rpm[-1])
    lowest, highest = float(run.rpm.min()), float(run.rpm.max())
    speeds = f"from {number(first)} to {number(last)} rpm"
    if lowest == highest:
        speeds = f"at {number(first)} rpm"
    elif lowest < min(first, last) or highest > max(first, last):
        speeds += f", between {number(lowest)} and {number(highest)} rpm"
    start = "from rest" if report.start == "rest" else "from the steady motion"
    events = f"; events: {', '.join(report.events)}" if report.events else ""
    lines = [
        transient_verdict(report),
        "",
        f"{train_name(run.topology)}: {number(float(run.time[-1]))} s {speeds},"
        f" {start}{events}",
        *firing_lines(run.train),
    ]
    return "\n".join(lines)


@dataclass(frozen=True)
class _Row:
    """A link with its signal, and its contact, of a mesh."""

    name: str
    signal: History
    contact: ToothContact | None = None

    def peaks(self) -> list[float]:
        """Largest and smallest value and the one that is larger in size."""
        highest, lowest = float(self.signal.max), float(self.signal.min)
        peak = highest if highest >= -lowest else lowest
        return [highest, lowest, peak]


def _columns(element: str, unit: str) -> list[Column]:
    """Columns of extremes, and of the peak with time and speed."""
    return [
        Column(element, read=lambda row: row.name),
        Column("max", "force", lambda row: row.peaks()[0], unit=unit),
        Column("min", "force", lambda row: row.peaks()[1], unit=unit),
        Column(f"{{{unit}}}", "force", lambda row: row.peaks()[2], "peak", unit=unit),
        Column("at s", number, lambda row: float(row.signal.time_of_peak), "peak"),
        Column("at rpm", number, lambda row: float(row.signal.rpm_of_peak), "peak"),
    ]


def _tables(report: TransientReport) -> Iterator[Table]:
    """Make the tables of meshes, and of shafts and dampers."""
    run = report.run
    topology = run.topology

    def rows(names: Sequence[str]) -> list[_Row]:
        return [
            _Row(
                name,
                signal_for_people(run, name),
                run.mesh(name) if name in topology.mesh_names else None,
            )
            for name in names
        ]

    if topology.mesh_names:
        contact = [
            Column("separated s", _seconds, lambda row: row.contact.separated),
            Column("reverse s", _seconds, lambda row: row.contact.reverse_contact),
            Column("impacts", str, lambda row: row.contact.impacts),
            Column("hardest m/s", hit, lambda row: row.contact.hardest_impact),
            Column("first at s", _instant, lambda row: _first(row.contact)),
        ]
        shown = contact if any(topology.mesh_backlash) else []
        caption = "Tooth force, {N} (positive on the flank that drives)"
        if shown:
            caption += (
                "; separated: seconds in the gap; reverse: on the flank that does not"
                " drive"
            )
        meshes = rows(topology.mesh_names)
        yield Table(caption, [*_columns("mesh", "N"), *shown], meshes)
    names = topology.shaft_and_damper_names
    if names:
        yield Table(
            "Torque of shafts and dampers, {N m} (elastic and damping part; the mean is"
            " positive)",
            _columns("shaft", "N m"),
            rows(names),
        )


def _seconds(value: float) -> str:
    """Write seconds; a dash where nothing happens."""
    return number(value) if math.isfinite(value) and value > 0 else NONE


def _instant(value: float) -> str:
    """Write an instant, the begin too; a dash where nothing happens."""
    return number(value) if math.isfinite(value) else NONE


def _first(contact: ToothContact) -> float:
    """Return when the teeth of a mesh first separate or touch the other flank, nan if
    never.
    """
    times = (contact.first_separation, contact.first_reverse_contact)
    return min((time for time in times if math.isfinite(time)), default=math.nan)


def _stress_parts(report: TransientReport) -> list[str]:
    """Make the table of stresses, what its limits and its damage are of."""
    stresses = report.stresses
    if not stresses:
        return []
    rows = list(stresses.items())
    limited = any(peak.rule for peak in stresses.values())
    counted = any(peak.fatigue for peak in stresses.values())

    columns = [
        Column("shaft", read=lambda row: row[0]),
        Column("stress", "stress", lambda row: row[1].amplitude, unit="Pa"),
        Column("at s", number, lambda row: row[1].time),
        Column("at rpm", number, lambda row: row[1].rpm),
    ]
    if limited:
        columns += [
            Column("transient limit", "stress", lambda row: row[1].limit, unit="Pa"),
            Column("share", ratio, lambda row: (row[1].amplitude, row[1].limit)),
        ]
    if counted:
        columns += [
            Column("cycles", _counted_cycles, lambda row: row[1].fatigue),
            Column("damage", _damage, lambda row: row[1].fatigue),
        ]
    parts: list[str] = [
        Table(
            "Torsional stress of shafts, {Pa}: half of peak-to-peak torque within a"
            f" cycle / W_p ({AID})",
            columns,
            rows,
        )
    ]
    if counted:
        parts.append(_sources(stresses))
    return parts


def _peak_tables(report: TransientReport) -> Iterator[Table]:
    """Make the tables of numbers that a limit bounds at every instant."""
    for kind, peaks in report.peaks.items():
        factor, _ = LIMITED[kind].shown
        columns = [
            Column(LIMITED[kind].element, read=lambda row: row[0]),
            Column(
                LIMITED[kind].called, "number", lambda row, by=factor: by * row[1].value
            ),
            Column("at s", number, lambda row: row[1].time),
            Column("at rpm", number, lambda row: row[1].rpm),
            Column("limit", "number", lambda row, by=factor: by * row[1].limit),
            Column("share", ratio, lambda row: (row[1].value, row[1].limit)),
        ]
        if peaks:
            yield Table(LIMITED[kind].title, columns, list(peaks.items()))


def _rule_parts(report: TransientReport) -> list[str]:
    """Say what the limits are of."""
    rated = report.topology.rated_rpm
    rules = [peak.rule for peak in report.stresses.values() if peak.rule]
    notes = [rule.note.format(source=rule.source, rated=rated) for rule in rules]
    return list(dict.fromkeys(notes))


def _counted_cycles(fatigue: Fatigue | None) -> str:
    """Write how many cycles were counted."""
    return plain_number(fatigue.cycles) if fatigue else NONE


def _damage(fatigue: Fatigue | None) -> str:
    """Write a damage, three digits."""
    return f"{fatigue.damage:.3g}" if fatigue else NONE


def _sources(stresses: dict[str, StressPeak]) -> str:
    """Say what damage is, and what the S-N curves are of."""
    sources = dict.fromkeys(
        peak.fatigue.curve.source for peak in stresses.values() if peak.fatigue
    )
    return (
        "Damage: cycles counted by rainflow (ASTM E1049) over those of the S-N curve at"
        " the same amplitude,\nsummed after Palmgren and Miner, without mean stress; 1"
        f" is the end of the life. S-N curve: {'; '.join(sources)}."
    )


def _passage_parts(report: TransientReport) -> list[str]:
    """Write the seconds in ranges of speeds, in a list; empty without any."""
    rated = report.topology.rated_rpm
    lines = []
    for passage in report.passages:
        text = f"  {passage.low:.4g} to {passage.high:.4g} rpm"
        if passage.barred is not None and rated is not None:
            rule = report.stresses[passage.shaft].rule
            assert rule is not None  # ranges are those of a rule
            text = range_text(passage.shaft, passage.barred, rule, rated)
            if (passage.low, passage.high) != (passage.barred.low, passage.barred.high):
                text += f"; barred {passage.low:.4g} to {passage.high:.4g} rpm"
        lines.append(f"{text}: {number(passage.seconds)} s")
    if not lines:
        return []
    barred = any(passage.barred for passage in report.passages)
    how = f"; barred: by the linear response at {BARRED_SPEEDS} speeds ({AID})"
    return ["\n".join([f"Time in ranges of speeds{how * barred}", *lines])]

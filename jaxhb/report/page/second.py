"""The part of the page that sets another design beside the first."""

import dataclasses

from jaxhb.report.figures.sweep import over_speed
from jaxhb.report.page.differences import differences
from jaxhb.report.page.limits import judged_text, shares_table
from jaxhb.report.page.motion import maxima
from jaxhb.report.page.parts import Heading
from jaxhb.report.quantities import angles, forces, gear_torques, heat, shaft_torques

MOST = 4
"""Elements whose two designs are drawn."""

ALONE = "The second design was run without a misfire: nothing here shows what a misfire does to it."


def second_part(report):
    """Another design beside the first: what differs, what it does at the same speeds, and its shares of limits."""
    second, first = report.second, report.cases[0]
    if second is None:
        return []
    pairs = [[dataclasses.replace(first, title="first design"), second]]
    if report.second_misfire is not None:
        misfire = report.shown[1]
        pairs.append([dataclasses.replace(misfire, title=f"first design, {misfire.title}"), report.second_misfire])
    blocks = list(report.tuning or differences(report.train, second.answers[0].train))
    blocks += _beside(pairs[0], drawn=len(report.rpm) > 1)
    for pair in pairs[1:]:
        blocks += [Heading(f"With {report.shown[1].title}"), *_beside(pair, drawn=False)]
    if len(report.cases) > 1 and len(pairs) == 1:
        blocks.append(ALONE)
    shares = shares_table(
        "Largest shares of the limits that each design gives", [case for pair in pairs for case in pair]
    )
    said = judged_text(report.seconds, "Second design, against the limits of its scene")
    return blocks + ([Heading("Limits of both designs"), *said, *shares] if shares else [])


def _beside(cases, *, drawn):
    """Tables of what two designs do, and figures of what works hardest."""
    train, other = (case.answers[0].train for case in cases)
    told = (forces, gear_torques, shaft_torques) if train.topology.link_names else (angles,)
    blocks = []
    for quantity in (*told, heat):
        mine, its = quantity(train), quantity(other)
        both = tuple(name for name in mine.names if name in its.names)
        if not both:
            continue
        mine = dataclasses.replace(mine, names=both)
        blocks.append(maxima(mine, cases, contact=quantity is forces))
        hardest = mine.hardest(cases)[:MOST] if drawn and quantity is not heat else []
        blocks += [over_speed(mine, [name], cases) for name in hardest]
    return blocks

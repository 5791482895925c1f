"""Many speeds as text: one row per speed, and what the train does upwards and
downwards.
"""

import math

from jaxhb._shown import ranges
from jaxhb.report.answer import SPEED, UNCONFIRMED
from jaxhb.report.quantities import IRREGULARITY, main_quantity
from jaxhb.report.selection import heaviest, most_apart
from jaxhb.report.text.columns import (
    DOUBT,
    NONE,
    Table,
    hit,
    irregular,
    percent,
    written,
)
from jaxhb.report.text.sentences import (
    firing_lines,
    motion_word,
    notes_text,
    status_word,
    verdict,
)
from jaxhb.report.text.strength import answers_strength, strength_text

BLOCKS = {"up": "Upwards", "down": "Downwards", "orbit": "Periodic solutions"}
"""Headings of the ways in which speeds are gone through."""

# Difference of largest tooth forces from which two motions are told as different
APART = 0.02


def sweep_text(sweeps):
    """One row per speed: the mesh with the largest tooth force, or the shaft with the
    largest torque; by direction.
    """
    parts = []
    several = len(sweeps) > 1
    for way, answers in sweeps.items():
        head = f"{BLOCKS[way]}: " * several
        said = [*motion_sentences(answers), *firing_lines(answers[0].train)]
        parts += ["\n".join([head + "\n".join(said), "", speed_table(answers)])]
        parts += turning_table(answers)
    if answers[0].axis == SPEED:
        parts += strength_text(
            {
                BLOCKS[way] * several: answers_strength(own)
                for way, own in sweeps.items()
            }
        )
    parts += _hysteresis(sweeps)
    # A speed that does the same both ways has one answer, noted once.
    every = {id(answer): answer for answers in sweeps.values() for answer in answers}
    return "\n\n".join([*parts, *notes_text(*every.values())])


def speed_table(answers, title=""):
    """A row for every speed: what is hit hardest, and the kind of motion."""
    columns = (
        MESHES
        if answers[0].topology.mesh_names
        else _swings(main_quantity(answers[0].train))
    )
    return _over_axis(title, answers, [*columns, *MOTION])


def turning_table(answers, title=""):
    """Irregularity of the heaviest disk of the reference rotor and heat of the dampers
    over the speed, in a list.
    """
    dampers = answers[0].topology.damper_names
    disk = heaviest(answers[0].train)
    if not dampers:
        return []
    specs = [(disk, lambda answer: answer.irregularity(disk), irregular)]
    specs += [
        (name, lambda answer, name=name: answer.power(name), "W") for name in dampers
    ]
    told = "of the heaviest disk (of every disk: --csv)"
    groups = [("irregularity, %", 1, 1), ("heat, W", 2, len(specs))]
    return [
        _over_axis(
            f"{IRREGULARITY}, {told}, and heat of dampers{title}",
            answers,
            specs,
            groups,
        )
    ]


def _over_axis(title, answers, specs, groups=()):
    """A row for every answer; numbers to doubt are marked, and the title explains the
    mark.
    """
    heads, reads, ways = zip(
        (answers[0].axis.label, lambda answer: f"{answer.place:g}", str),
        *specs,
        strict=True,
    )
    cells = written([list(map(read, answers)) for read in reads], ways)
    for place, (head, way) in enumerate(zip(heads, ways, strict=True)):
        if way is not str and head != WITHOUT:
            cells[place] = [
                f"{cell}{DOUBT}" if answer.doubt and cell[:1].isdigit() else cell
                for cell, answer in zip(cells[place], answers, strict=True)
            ]
    doubts = " or ".join(
        dict.fromkeys(answer.doubt for answer in answers if answer.doubt)
    )
    return Table(
        "; ".join(filter(None, [title, doubts and f"{DOUBT}: {doubts}"])),
        heads,
        cells,
        groups,
    )


def _peak(motion, answer):
    """The tooth force in kN of the mesh that has the largest."""
    return motion.force(answer.worst_mesh).peak / 1e3 if answer.worst_mesh else math.nan


WITHOUT = "without kN"

MESHES = (
    ("largest tooth force", lambda answer: answer.worst_mesh or NONE, str),
    ("with kN", lambda answer: _peak(answer, answer), "kN"),
    (WITHOUT, lambda answer: _peak(answer.without_backlash, answer), "kN"),
    ("longest apart", lambda answer: most_apart(answer) or NONE, str),
    (
        "apart %",
        lambda a: max(one.separated_fraction for one in a.contacts.values()),
        percent,
    ),
    (
        "hardest of all m/s",
        lambda a: max(one.hardest_impact for one in a.contacts.values()),
        hit,
    ),
)
MOTION = (
    (
        "harmonics",
        lambda answer: NONE if answer.harmonics is None else answer.harmonics,
        str,
    ),
    ("motion", motion_word, str),
)
"""Columns of the table of a sweep: head, reader of an answer, and how it is written."""


def _swings(quantity):
    """Columns of a train without teeth: the shaft or damper with the largest torque, or
    the disk that moves most.
    """

    def read(what):
        name_of = (
            quantity.largest
        )  # of a motion that is not known every element has the same: nan
        return lambda one: (
            quantity.factor
            * getattr(quantity.signal(one, name_of(one) or quantity.names[0]), what)
        )

    what = (
        "largest shaft torque"
        if quantity.element == "shaft"
        else f"largest {quantity.called}"
    )
    return (
        (what, lambda answer: quantity.largest(answer) or NONE, str),
        (f"half p-p {quantity.unit}", read("half_peak_to_peak"), "swing"),
        (f"sum of amplitudes {quantity.unit}", read("sum_of_amplitudes"), "swing"),
    )


def _verdict(answers):
    """Where the teeth separate, in one sentence."""
    if len(answers) == 1:
        return verdict(answers[0])
    axis = answers[0].axis
    places = [answer.place for answer in answers]
    answered = [answer for answer in answers if answer.answered]
    if not any(answers[0].topology.mesh_backlash):
        return f"No mesh with backlash: {axis.span(places)}."
    if not answered:
        return f"No answer at any of {axis.span(places)}."
    doubt = (
        f"; {len(answers) - len(answered)} without an answer"
        if len(answered) < len(answers)
        else ""
    )
    hammering = [answer.place for answer in answered if most_apart(answer) is not None]
    if not hammering:
        some = (
            f"{len(answered)} of {axis.span(places)}"
            if doubt
            else f"all {axis.span(places)}"
        )
        return f"All teeth stay in contact at {some}{doubt}."
    some = f"{len(hammering)} of {axis.span(places, 'between', 'and')}"
    return f"Teeth separate at {some}: {_where(answers, hammering)}{doubt}."


def _where(answers, chosen):
    """Places on the axis, in ranges of those that follow each other."""
    axis = answers[0].axis
    return axis.said(
        ranges(
            [answer.place for answer in answers],
            chosen,
            "-" if axis == SPEED else " to ",
        )
    )


def motion_sentences(answers):
    """Where the teeth separate, and a line for each motion other than contact and one
    stable cycle or not converged.
    """
    alike_in = {}
    for answer in answers:
        if answer.unstable:
            alike_in.setdefault(
                "UNSTABLE, the train does not run in these motions,", []
            ).append(answer.place)
        said = {
            "subharmonic": f"The motion has a period of {answer.state.period} cycles",
            "irregular": (
                "The motion is irregular and never repeats (numbers are the extremes"
                " over recorded cycles)"
            ),
            "unknown": "The motion is unknown",
        }.get("" if answer.orbit else answer.state.kind)
        if answer.orbit and not answer.converged:
            said = f"NOT CONVERGED, {status_word(answer.status)},"
        elif answer.doubt and not answer.orbit:
            doubt = (
                UNCONFIRMED if answer.answered else f"{answer.doubt}, WITHOUT AN ANSWER"
            )
            said = f"{said or 'The motion has a period of one cycle'}, {doubt},"
        if said:
            alike_in.setdefault(said, []).append(answer.place)
    kinds = [
        f"{said} at {_where(answers, chosen)}." for said, chosen in alike_in.items()
    ]
    return [_verdict(answers), *kinds, *_spread(answers)]


def _spread(answers):
    """How far the extremes of other records of irregular motions may lie, in a list."""
    shares = [
        answer.state.record.spread
        for answer in answers
        if answer.recorded and not answer.state.period
    ]
    if not shares:
        return []
    share = f"{100 * max(shares):.2g} % (two standard deviations)"
    return [
        "Largest forces of other such records of irregular motion would differ by up"
        f" to {share}."
    ]


def _hysteresis(sweeps):
    """Where the train does something else downwards than upwards: another kind of
    motion, period or largest force.
    """
    if len(sweeps) < 2:
        return []

    def differ(*pair):
        one, other = ((a.state.kind, a.state.period) for a in pair)
        before, after = (
            max((a.force(name).peak for name in a.topology.mesh_names), default=0.0)
            for a in pair
        )
        return one != other or abs(before - after) > APART * max(before, after)

    found = [
        one.place
        for one, other in zip(sweeps["up"], sweeps["down"], strict=True)
        if differ(one, other)
    ]
    if not found:
        return ["Upwards and downwards the train does the same."]
    return [
        f"Upwards and downwards differ at {_where(sweeps['up'], found)}: the motion"
        " depends on what came before."
    ]

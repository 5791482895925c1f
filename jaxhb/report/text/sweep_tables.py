"""Many speeds as text: one row per speed, and what the train does upwards and
downwards.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from operator import methodcaller

from jaxhb._shown import ranges
from jaxhb.report.answer import SPEED, UNCONFIRMED, Answer
from jaxhb.report.quantities import Quantity, main_quantity
from jaxhb.report.selection import heaviest, most_apart
from jaxhb.report.table import Column, Table
from jaxhb.report.text.columns import (
    DOUBT,
    NONE,
    Doubtful,
    Way,
    hit,
    irregular,
    percent,
)
from jaxhb.report.text.sentences import (
    firing_lines,
    motion_word,
    notes_text,
    status_word,
    verdict,
)
from jaxhb.report.text.strength import answers_strength, strength_text
from jaxhb.results.quantities import IRREGULARITY

BLOCKS = {"up": "Upwards", "down": "Downwards", "orbit": "Periodic solutions"}
"""Headings of the ways in which speeds are gone through."""

# Difference of largest tooth forces from which two motions are told as different
APART = 0.02


def sweep_text(sweeps: Mapping[str, Sequence[Answer]]) -> str:
    """One row per speed: the mesh with the largest tooth force, or the shaft with the
    largest torque; by direction.
    """
    parts: list[str] = []
    several = len(sweeps) > 1
    axis = next(iter(sweeps.values()))[0].axis
    for way, answers in sweeps.items():
        head = f"{BLOCKS[way]}: " * several
        lines = [*motion_sentences(answers), *firing_lines(answers[0].train)]
        parts.append("\n".join([head + "\n".join(lines), "", speed_table(answers)]))
        parts += turning_table(answers)
    if axis == SPEED:
        parts += strength_text(
            {
                BLOCKS[way] * several: answers_strength(answers)
                for way, answers in sweeps.items()
            }
        )
    parts += _hysteresis(sweeps)
    # A speed that does the same both ways has one answer, noted once.
    every = {id(answer): answer for answers in sweeps.values() for answer in answers}
    return "\n\n".join([*parts, *notes_text(*every.values())])


def speed_table(answers: Sequence[Answer], title: str = "") -> Table:
    """A row for every speed: what is hit hardest, and the kind of motion."""
    columns = (
        MESHES
        if answers[0].topology.mesh_names
        else _swings(main_quantity(answers[0].train))
    )
    return _over_axis(title, answers, [*columns, *MOTION])


def turning_table(answers: Sequence[Answer], title: str = "") -> list[Table]:
    """Irregularity of the heaviest disk of the reference rotor and heat of the dampers
    over the speed, in a list.
    """
    dampers = answers[0].topology.damper_names
    if not dampers:
        return []
    disk = heaviest(answers[0].train)
    share = _number(
        disk, irregular, lambda answer: answer.irregularity(disk), "irregularity, %"
    )
    heats = [
        _number(name, "W", methodcaller("power", name), "heat, {W}", unit="W")
        for name in dampers
    ]
    of_disk = "of the heaviest disk (of every disk: --csv)"
    caption = f"{IRREGULARITY}, {of_disk}, and heat of dampers{title}"
    return [_over_axis(caption, answers, [share, *heats])]


def _number(
    head: str,
    way: Way,
    read: Callable[[Answer], float],
    group: str = "",
    *,
    unit: str = "",
) -> Column:
    """Make a column of numbers of answers, in an SI ``unit``, marked where they are to
    doubt.
    """

    def value(answer: Answer) -> float:
        number = read(answer)
        return Doubtful(number) if answer.doubt else number

    return Column(head, way, value, group, unit=unit)


def _over_axis(
    title: str, answers: Sequence[Answer], columns: Sequence[Column]
) -> Table:
    """A row for every answer; the title explains the mark of numbers to doubt."""
    place = Column(answers[0].axis.label, str, lambda answer: f"{answer.place:g}")
    doubts = " or ".join(
        dict.fromkeys(answer.doubt for answer in answers if answer.doubt)
    )
    caption = "; ".join(filter(None, [title, doubts and f"{DOUBT}: {doubts}"]))
    return Table(caption, [place, *columns], answers)


def _peak(motion: Answer, answer: Answer) -> float:
    """The tooth force in N, in a motion, of the mesh that has the largest in the
    answer.
    """
    return motion.force(answer.worst_mesh).peak if answer.worst_mesh else math.nan


def _most_of_contacts(field: str) -> Callable[[Answer], float]:
    """Reader of the largest number of contact of all meshes."""
    return lambda answer: max(
        getattr(contact, field) for contact in answer.contacts.values()
    )


MESHES = (
    Column("largest tooth force", str, lambda answer: answer.worst_mesh or NONE),
    _number("with {N}", "N", lambda answer: _peak(answer, answer), unit="N"),
    Column(
        "without {N}",
        "N",
        lambda answer: _peak(answer.without_backlash, answer),
        unit="N",
    ),
    Column("longest separated", str, lambda answer: most_apart(answer) or NONE),
    _number("separated %", percent, _most_of_contacts("separated_fraction")),
    _number("hardest impact m/s", hit, _most_of_contacts("hardest_impact")),
)
MOTION = (
    Column(
        "harmonics",
        str,
        lambda answer: NONE if answer.harmonics is None else answer.harmonics,
    ),
    Column("motion", str, motion_word),
)
"""Columns of the table of a sweep, by answers."""


def _swings(quantity: Quantity) -> tuple[Column, ...]:
    """Columns of a train without teeth: the shaft or damper with the largest torque, or
    the disk that moves most.
    """

    def read(answer: Answer, statistic: str) -> float:
        # In a motion that is not known every element has the same: nan.
        name = quantity.largest(answer) or quantity.names[0]
        return getattr(quantity.signal(answer, name), statistic)

    called = "shaft torque" if quantity.element == "shaft" else quantity.called
    unit = quantity.placeholder
    half = partial(read, statistic="half_peak_to_peak")
    total = partial(read, statistic="sum_of_amplitudes")
    return (
        Column(
            f"largest {called}", str, lambda answer: quantity.largest(answer) or NONE
        ),
        _number(f"half p-p {unit}", "swing", half, unit=quantity.entry.unit),
        _number(f"sum of amplitudes {unit}", "swing", total, unit=quantity.entry.unit),
    )


def _verdict(answers: Sequence[Answer]) -> str:
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
        speeds = (
            f"{len(answered)} of {axis.span(places)}"
            if doubt
            else f"all {axis.span(places)}"
        )
        return f"All teeth stay in contact at {speeds}{doubt}."
    speeds = f"{len(hammering)} of {axis.span(places, 'between', 'and')}"
    return f"Teeth separate at {speeds}: {_where(answers, hammering)}{doubt}."


def _where(answers: Sequence[Answer], chosen: list[float]) -> str:
    """Places on the axis, in ranges of those that follow each other."""
    axis = answers[0].axis
    places = [answer.place for answer in answers]
    return axis.said(ranges(places, chosen, "-" if axis == SPEED else " to "))


def motion_sentences(answers: Sequence[Answer]) -> list[str]:
    """Where the teeth separate, and a line for each motion other than contact and one
    stable cycle or not converged.
    """
    alike: dict[str, list[float]] = {}
    for answer in answers:
        if answer.unstable:
            unstable = "UNSTABLE, the train does not run in these motions,"
            alike.setdefault(unstable, []).append(answer.place)
        motion = {
            "subharmonic": f"The motion has a period of {answer.state.period} cycles",
            "irregular": (
                "The motion is irregular and never repeats (numbers are the extremes"
                " over recorded cycles)"
            ),
            "unknown": "The motion is unknown",
        }.get("" if answer.orbit else answer.state.kind)
        if answer.orbit and not answer.converged:
            motion = f"NOT CONVERGED, {status_word(answer)},"
        elif answer.doubt and not answer.orbit:
            doubt = (
                UNCONFIRMED if answer.answered else f"{answer.doubt}, WITHOUT AN ANSWER"
            )
            motion = f"{motion or 'The motion has a period of one cycle'}, {doubt},"
        if motion:
            alike.setdefault(motion, []).append(answer.place)
    motions = [
        f"{motion} at {_where(answers, places)}." for motion, places in alike.items()
    ]
    return [_verdict(answers), *motions, *_spread(answers)]


def _spread(answers: Sequence[Answer]) -> list[str]:
    """How far the extremes of other records of irregular motions may lie, in a list."""
    records = [
        answer.state.record
        for answer in answers
        if answer.recorded and not answer.state.period
    ]
    shares = [record.spread for record in records if record is not None]
    if not shares:
        return []
    share = f"{100 * max(shares):.2g} % (two standard deviations)"
    return [
        "Largest forces of other such records of irregular motion would differ by up"
        f" to {share}."
    ]


def _hysteresis(sweeps: Mapping[str, Sequence[Answer]]) -> list[str]:
    """Where the train does something else downwards than upwards: another kind of
    motion, period or largest force.
    """
    if len(sweeps) < 2:
        return []

    def largest_force(answer: Answer) -> float:
        names = answer.topology.mesh_names
        return max((answer.force(name).peak for name in names), default=0.0)

    def differ(up: Answer, down: Answer) -> bool:
        if (up.state.kind, up.state.period) != (down.state.kind, down.state.period):
            return True
        before = largest_force(up)
        after = largest_force(down)
        return abs(before - after) > APART * max(before, after)

    places = [
        up.place
        for up, down in zip(sweeps["up"], sweeps["down"], strict=True)
        if differ(up, down)
    ]
    if not places:
        return ["Upwards and downwards the train does the same."]
    return [
        f"Upwards and downwards differ at {_where(sweeps['up'], places)}: the motion"
        " depends on what came before."
    ]

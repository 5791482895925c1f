"""Many speeds as text: one row per speed, and what the train does upwards and downwards."""

import numpy as np

from jaxhb.report.answer import SPEED, UNCONFIRMED
from jaxhb.report.quantities import main_quantity
from jaxhb.report.selection import heaviest, most_apart, worst_mesh
from jaxhb.report.text.columns import NONE, Table, alike, ranges, shares
from jaxhb.report.text.sentences import motion_word, status_word, verdict
from jaxhb.report.text.strength import answers_strength, strength_text
from jaxhb.report.text.tables import hardest_text, irregularity_text, notes_text

BLOCKS = {"up": "Upwards", "down": "Downwards", "orbit": "Periodic solutions"}
"""Headings of the ways in which speeds are gone through."""

WITHOUT = "without kN"

SWINGS = "half_peak_to_peak", "sum_of_amplitudes"

DOUBT = "?"
"""Behind numbers that are not converged, or not confirmed by harmonic balance."""

APART = 0.02
"""Difference of largest tooth forces from which two motions are told as different."""


def sweep_text(sweeps):
    """One row per speed: the mesh with the largest tooth force, or the shaft with the largest torque.

    Parameters
    ----------
    sweeps : dict
        Answers by direction, from :func:`jaxhb.report.compute.answer_speeds`.
    """
    parts = []
    for way, answers in sweeps.items():
        lines = [*motion_sentences(answers), "", speed_table(answers)]
        parts.append("\n".join([*([f"{BLOCKS[way]}: {lines[0]}"] if len(sweeps) > 1 else lines[:1]), *lines[1:]]))
        parts += turning_table(answers)
    ways = {BLOCKS[way] if len(sweeps) > 1 else "": answers_strength(answers) for way, answers in sweeps.items()}
    parts += (strength_text(ways) if answers[0].axis == SPEED else []) + _hysteresis(sweeps)
    # A speed that does the same both ways has one answer, noted once.
    every = {id(answer): answer for answers in sweeps.values() for answer in answers}
    return "\n\n".join([*parts, *notes_text(*every.values())])


def motion_sentences(answers):
    """Where the teeth separate, and where the motion is another than contact and one stable cycle."""
    return [_verdict(answers), *_kinds(answers)]


def speed_table(answers, title=""):
    """A row for every speed: what is hit hardest, and the kind of motion."""
    heads, columns = (_meshes if answers[0].topology.mesh_names else _swings)(answers)
    harmonics = [NONE if answer.harmonics is None else str(answer.harmonics) for answer in answers]
    places, motions = [f"{answer.place:g}" for answer in answers], [motion_word(answer) for answer in answers]
    columns = [
        column if head == WITHOUT else _doubted(column, answers) for head, column in zip(heads, columns, strict=True)
    ]
    heads = [answers[0].axis.label, *heads, "harmonics", "motion"]
    return Table(_titled(title, answers), heads, [places, *columns, harmonics, motions])


def _titled(title, answers):
    """A title that explains the mark of doubtful numbers, where there are any."""
    doubts = " or ".join(dict.fromkeys(answer.doubt for answer in answers if answer.doubt))
    return "; ".join(filter(None, [title, doubts and f"{DOUBT}: {doubts}"]))


def _doubted(column, answers):
    """A column with a mark behind the doubtful numbers."""
    return [
        f"{cell}{DOUBT}" if answer.doubt and cell[:1].isdigit() else cell
        for cell, answer in zip(column, answers, strict=True)
    ]


def turning_table(answers, title=""):
    """Irregularity of the heaviest disk of the reference rotor and heat of the dampers over the speed, in a list."""
    topology = answers[0].topology
    if not topology.damper_names:
        return []
    disk = heaviest(answers[0].train)
    irregular = [irregularity_text(answer, disk) for answer in answers]
    heat = alike(*([answer.power(name) for answer in answers] for name in topology.damper_names))
    columns = [_doubted(column, answers) for column in (irregular, *heat)]
    heads = [answers[0].axis.label, disk, *topology.damper_names]
    places = [f"{answer.place:g}" for answer in answers]
    groups = [("irregularity, %", 1, 1), ("heat, W", 2, len(heads) - 1)]
    told = "of the heaviest disk (of every disk: --csv)"
    title = f"Cyclic irregularity, (largest - smallest) / mean speed, {told}, and heat of dampers{title}"
    return [Table(_titled(title, answers), heads, [places, *columns], groups)]


def _meshes(answers):
    names = [worst_mesh(answer) for answer in answers]
    pairs = list(zip(answers, names, strict=True))
    apart = [most_apart(answer) for answer in answers]
    columns = [
        [name or NONE for name in names],
        *alike(
            [answer.force(name).peak / 1e3 if name else np.nan for answer, name in pairs],
            [answer.linear.force(name).peak / 1e3 if name else np.nan for answer, name in pairs],
        ),
        [name or NONE for name in apart],
        shares([_longest(answer, name) for answer, name in zip(answers, apart, strict=True)]),
        [hardest_text(*answer.contacts.values()) for answer in answers],
    ]
    heads = ["largest tooth force", "with kN", WITHOUT, "longest apart", "apart %", "hardest of all m/s"]
    return heads, columns


def _longest(answer, name):
    if not answer.known:
        return None
    return answer.contacts[name].separated_fraction if name else 0.0


def _swings(answers):
    """Of a train without teeth the shaft or damper with the largest torque, of one without links the disk that moves
    most."""
    quantity = main_quantity(answers[0].train)
    names = [quantity.largest(answer) if answer.known else None for answer in answers]
    signals = [quantity.signal(a, name or quantity.names[0]) for a, name in zip(answers, names, strict=True)]
    swings = ([quantity.factor * getattr(signal, what) for signal in signals] for what in SWINGS)
    what = "largest shaft torque" if quantity.element == "shaft" else f"largest {quantity.called}"
    heads = [what, f"half p-p {quantity.unit}", f"sum of amplitudes {quantity.unit}"]
    return heads, [[name or NONE for name in names], *alike(*swings)]


def _verdict(answers):
    """Where the teeth separate, in one sentence."""
    axis, places = answers[0].axis, [answer.place for answer in answers]
    if len(answers) == 1:
        return verdict(answers[0])
    first, last = min(places), max(places)
    answered = [answer for answer in answers if answer.answered]
    if not any(answers[0].topology.mesh_backlash):
        return f"No mesh with backlash: {axis.span(places)}."
    if not answered:
        return f"No answer at any of {axis.span(places)}."
    doubt = f"; {len(answers) - len(answered)} without an answer" if len(answered) < len(answers) else ""
    hammering = [answer.place for answer in answered if most_apart(answer) is not None]
    if not hammering:
        some = f"{len(answered)} of {axis.span(places)}" if doubt else f"all {axis.span(places)}"
        return f"All teeth stay in contact at {some}{doubt}."
    where = axis.said(ranges(places, hammering, axis.to))
    counted = "speeds" if axis == SPEED else f"values of {axis.name}"
    between = f"between {first:g} and {last:g} {axis.unit}".rstrip()
    return f"Teeth separate at {len(hammering)} of {len(places)} {counted} {between}: {where}{doubt}."


def _kinds(answers):
    """A line for each kind of motion other than contact and one stable cycle, and for each status but converged."""
    axis, places, alike_in = answers[0].axis, [answer.place for answer in answers], {}
    for answer in answers:
        if answer.growth.unstable:
            alike_in.setdefault("UNSTABLE, the train does not run in these motions,", []).append(answer.place)
        period = answer.state.period
        said = {
            "subharmonic": f"The motion has a period of {period} cycles",
            "irregular": "The motion is irregular and never repeats (numbers are the extremes over recorded cycles)",
            "unknown": "The motion is unknown",
        }.get("" if answer.orbit else answer.state.kind)
        if answer.orbit and not answer.converged:
            said = f"NOT CONVERGED, {status_word(answer.status)},"
        elif answer.doubt and not answer.orbit:
            doubt = UNCONFIRMED if answer.answered else f"{answer.doubt}, WITHOUT AN ANSWER"
            said = f"{said or 'The motion has a period of one cycle'}, {doubt},"
        if said:
            alike_in.setdefault(said, []).append(answer.place)
    return [f"{said} at {axis.said(ranges(places, chosen, axis.to))}." for said, chosen in alike_in.items()]


def _hysteresis(sweeps):
    """Where the train does something else downwards than upwards."""
    if len(sweeps) < 2:
        return []
    up, down = sweeps["up"], sweeps["down"]
    places = [answer.place for answer in up]
    found = [one.place for one, other in zip(up, down, strict=True) if differ(one, other)]
    if not found:
        return ["Upwards and downwards the train does the same."]
    where = up[0].axis.said(ranges(places, found, up[0].axis.to))
    return [f"Upwards and downwards differ at {where}: the motion depends on what came before."]


def differ(one, other):
    """Whether two answers are different motions: another kind, period or largest tooth force."""
    if (one.state.kind, one.state.period) != (other.state.kind, other.state.period):
        return True
    peaks = [[float(a.force(name).peak) for name in a.topology.mesh_names] for a in (one, other)]
    highest = [max(values, default=0.0) for values in peaks]
    return bool(abs(highest[0] - highest[1]) > APART * max(highest))

"""Many speeds as text: one row per speed, and what the train does upwards and downwards."""

import numpy as np

from .choose import hardest_shaft, largest, most_apart, shafts_of, worst_mesh
from .columns import NONE, Table, alike, ranges, shares
from .strength import answers_strength, strength_text
from .tables import hardest_text, notes_text
from .words import motion_word, speeds_text

BLOCKS = {"up": "Upwards", "down": "Downwards", "orbit": "Periodic solutions"}
"""Headings of the ways in which speeds are gone through."""

APART = 0.02
"""Difference of largest tooth forces from which two motions are told as different."""


def sweep_text(sweeps):
    """One row per speed: the mesh with the largest tooth force, or the shaft with the largest torque.

    Parameters
    ----------
    sweeps : dict
        Answers by direction, from :func:`jaxhb.show.compute.answer_speeds`.
    """
    parts = []
    for way, answers in sweeps.items():
        lines = [*motion_sentences(answers), "", speed_table(answers)]
        parts.append("\n".join([*([f"{BLOCKS[way]}: {lines[0]}"] if len(sweeps) > 1 else lines[:1]), *lines[1:]]))
        parts += _failures(answers)
    ways = {BLOCKS[way] if len(sweeps) > 1 else "": answers_strength(answers) for way, answers in sweeps.items()}
    parts += strength_text(ways) + _hysteresis(sweeps)
    every = {id(answer): answer for answers in sweeps.values() for answer in answers}
    return "\n\n".join([*parts, *notes_text(*every.values())])


def motion_sentences(answers):
    """Where the teeth separate, and where the motion is another than contact and one stable cycle."""
    return [_verdict(answers), *_kinds(answers)]


def speed_table(answers, title=""):
    """A row for every speed: what is hit hardest, and the kind of motion."""
    heads, columns = (_meshes if answers[0].topology.mesh_names else _shafts)(answers)
    harmonics = [NONE if answer.harmonics is None else str(answer.harmonics) for answer in answers]
    rpm, motions = [f"{answer.rpm:g}" for answer in answers], [motion_word(answer) for answer in answers]
    return Table(title, ["rpm", *heads, "harmonics", "motion"], [rpm, *columns, harmonics, motions])


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
    heads = ["largest tooth force", "with kN", "without kN", "longest apart", "apart %", "hardest m/s"]
    return heads, columns


def _longest(answer, name):
    if not answer.known:
        return None
    return answer.contacts[name].separated_fraction if name else 0.0


def _shafts(answers):
    if not shafts_of(answers[0].topology):
        return _disks(answers)
    names = [hardest_shaft([answer]) if answer.known else None for answer in answers]
    signals = [answer.torque(name) for answer, name in zip(answers, names, strict=True)]
    columns = alike([s.half_peak_to_peak for s in signals], [s.sum_of_amplitudes for s in signals])
    heads = ["largest shaft torque", "half p-p N m", "sum of amplitudes N m"]
    return heads, [[name or NONE for name in names], *columns]


def _disks(answers):
    """A train without links: its disks alone."""
    disks = answers[0].topology.disk_names
    names = [largest(disks, lambda name, a=answer: a.disk(name).half_peak_to_peak) for answer in answers]
    signals = [answer.disk(name) for answer, name in zip(answers, names, strict=True)]
    columns = alike([1e3 * s.half_peak_to_peak for s in signals], [1e3 * s.sum_of_amplitudes for s in signals])
    heads = ["largest angle", "half p-p mrad", "sum of amplitudes mrad"]
    return heads, [[name or NONE for name in names], *columns]


def _verdict(answers):
    """Where the teeth separate, in one sentence."""
    speeds = [answer.rpm for answer in answers]
    first, last, known = min(speeds), max(speeds), [answer for answer in answers if answer.known]
    if not any(answers[0].topology.mesh_backlash):
        return f"No mesh with backlash: {len(speeds)} speeds from {first:g} to {last:g} rpm."
    failed = sum(not answer.answered for answer in answers)
    doubt = f"; {failed} without an answer, do not rely on those" if failed else ""
    hammering = [answer.rpm for answer in known if most_apart(answer) is not None]
    if not hammering and known:
        where = f"all {len(speeds)} speeds" if len(known) == len(speeds) else f"{len(known)} of {len(speeds)} speeds"
        return f"All teeth stay in contact at {where} from {first:g} to {last:g} rpm{doubt}."
    where = f": {ranges(speeds, hammering)} rpm" if hammering else ""
    return (
        f"Teeth separate at {len(hammering)} of {len(speeds)} speeds between {first:g} and {last:g} rpm{where}{doubt}."
    )


def _kinds(answers):
    """A line for each kind of motion other than contact and one stable cycle."""
    speeds, alike_in = [answer.rpm for answer in answers], {}
    for answer in answers:
        if answer.growth.unstable:
            alike_in.setdefault("UNSTABLE, the train does not run in these motions,", []).append(answer.rpm)
        period = answer.state.period
        said = {
            "subharmonic": f"The motion has a period of {period} cycles",
            "irregular": "The motion is irregular and never repeats (numbers are the extremes over recorded cycles)",
            "unknown": f"Unknown, {'; '.join(answer.state.notes)},",
        }.get("" if answer.orbit else answer.state.kind)
        if said:
            alike_in.setdefault(said, []).append(answer.rpm)
    return [f"{said} at {ranges(speeds, chosen)} rpm." for said, chosen in alike_in.items()]


def _failures(answers):
    """A line for each status other than converged."""
    failed = sorted({a.status for a in answers if a.status is not None and not a.converged})
    lines = [
        f"{status.name} at {speeds_text([a for a in answers if a.status == status])}: {status.sentence}."
        for status in failed
    ]
    return ["\n".join(lines)] if lines else []


def _hysteresis(sweeps):
    """Where the train does something else downwards than upwards."""
    if len(sweeps) < 2:
        return []
    up, down = sweeps["up"], sweeps["down"]
    speeds = [answer.rpm for answer in up]
    found = [one.rpm for one, other in zip(up, down, strict=True) if differ(one, other)]
    if not found:
        return ["Upwards and downwards the train does the same."]
    return [f"Upwards and downwards differ at {ranges(speeds, found)} rpm: the motion depends on what came before."]


def differ(one, other):
    """Whether two answers are different motions: another kind, period or largest tooth force."""
    if (one.state.kind, one.state.period) != (other.state.kind, other.state.period):
        return True
    peaks = [[float(a.force(name).peak) for name in a.topology.mesh_names] for a in (one, other)]
    highest = [max(values, default=0.0) for values in peaks]
    return bool(abs(highest[0] - highest[1]) > APART * max(highest))

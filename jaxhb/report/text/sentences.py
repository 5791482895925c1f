"""The sentences that an engineer reads first: do the teeth hammer, in what motion, and
what to be careful about.
"""

import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from jaxhb._jax import Number
from jaxhb.balance.plan import MOST_HARMONICS
from jaxhb.floquet.stability import fall_text
from jaxhb.linear.heat import fixed_temperatures
from jaxhb.report.answer import SPEED, UNCONFIRMED, Answer, SweepAxis
from jaxhb.report.selection import most_apart
from jaxhb.report.text.columns import hit, plain_number
from jaxhb.report.text.mean_torques import speed_of, torque_notes
from jaxhb.report.units import shown_unit
from jaxhb.results.record import Record
from jaxhb.results.status import Homotopy, NewtonOnSweeps, Shooting, Status
from jaxhb.steady.closure import SPREAD
from jaxhb.train.checks.plausible import plausibility
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.omission import not_firing

SOFT = 0.005  # approach speed of impacts, m/s, below which no teeth hammer
NO_TEETH = "No teeth mesh in this train."
LOST = 1e-3  # share of the power of the torques that may be lost without a note

_VALUE = re.compile(
    r"""(?P<name>(?<!\w)(?P<quote>['"]).*?(?<!\\)(?P=quote))|\b\d[\d.]*(e[-+]?\d+)?"""
)
"""A value in a note, or a name in quotes, whose digits are no values."""

GAP_SPRING_SHARE = 0.05
KNEE_SHARE = 0.5
SHOWN_SPEEDS = 6


def _stability_text(answer: Answer) -> str:
    """Words on the stability of a motion; "" where nothing is known."""
    stability = answer.stability
    period = answer.state.period
    span = "a cycle" if period <= 1 else f"{period} cycles"
    if stability is None:
        return f"stability not decided: {answer.undecided}" if answer.undecided else ""
    if not answer.unstable:
        return f"stable: a disturbance {fall_text(stability.largest)} in {span}"
    cause = f" ({stability.loses_by})" if stability.loses_by else ""
    return (
        f"UNSTABLE{cause}: a disturbance grows {stability.largest:.3g} times in {span};"
        " the train does not run in it"
    )


def motion_text(answer: Answer) -> str:
    """The kind of motion in the words of an engineer."""
    state = answer.state
    turns = state.period * answer.topology.revolutions_per_cycle
    kind = {
        "contact": "the teeth stay in contact",
        "periodic": "periodic, period one cycle",
        "subharmonic": (
            f"period of {state.period} cycles (of {turns:g}"
            f" revolution{'s' * (turns != 1)})"
        ),
        "irregular": "irregular: the motion never repeats",
        "unknown": "unknown",
    }[state.kind]
    record = state.record
    if answer.recorded and record is not None:
        kind += f"; {UNCONFIRMED}" if answer.unconfirmed else ""
        kind += f"; numbers are the extremes over {record.cycles} recorded cycles"
        kind += "" if state.period else _spread_text(record)
    return "; ".join(filter(None, [kind, _stability_text(answer)]))


def _spread_text(record: Record) -> str:
    """How far the extremes of another record may lie."""
    aimed = (
        ""
        if record.spread <= SPREAD
        else f", more than the {100 * SPREAD:g} % aimed at"
    )
    share = f"{100 * record.spread:.2g} % (two standard deviations{aimed})"
    return (
        f", and the largest forces of another such record would differ by up to {share}"
    )


def motion_word(answer: Answer) -> str:
    """The kind of motion in a word or two, for a column of a table."""
    state = answer.state
    word = f"period {state.period}" if state.kind == "subharmonic" else state.kind
    words = [status_word(answer) if answer.orbit else word]
    if answer.doubt and not answer.orbit:
        words.append(answer.doubt if answer.answered else status_word(answer))
    return ", ".join([*words, *["UNSTABLE"] * answer.unstable])


def status_word(answer: Answer) -> str:
    """The Status of the harmonic solution of an answer in small letters."""
    assert answer.status is not None  # only solutions have one
    return answer.status.name.lower().replace("_", " ")


def solution_text(answer: Answer) -> str:
    """How the harmonic solution went: status with what to try, harmonics, residual,
    truncation error; "" without.
    """
    response = answer.response
    period = answer.state.period
    if response is None:
        return ""
    status = (
        "converged" if answer.converged else f"NOT CONVERGED: {status_word(answer)}"
    )
    span = "the cycle" if period <= 1 else f"{period} cycles"
    line = f"{status}; {answer.harmonics} harmonics of {span}"
    residual = float(response.residual)
    error = float(response.truncation_error)
    if not residual and not error:
        backlash = any(response.topology.mesh_backlash)
        flanks = ": every mesh keeps its flank" if backlash else ""
        return f"{line}, linear{flanks}"
    return (
        f"{line}, residual {residual:.1e}, truncation error {_percent(error)} of the"
        " largest tooth force"
    )


def status_lines(answer: Answer) -> list[str]:
    """The kind of motion and, where there is one, how its harmonic solution went."""
    head = "orbit" if answer.orbit else "motion"
    return [f"{head}: {motion_text(answer)}", *filter(None, [solution_text(answer)])]


def verdict(answer: Answer) -> str:
    """The answer in one sentence: do the teeth hammer, which mesh is separated
    longest, which has the hardest impact?
    """
    topology = answer.topology
    speed = answer.at
    if not answer.known:
        return f"No answer at {speed}."
    if not topology.mesh_names:
        return NO_TEETH
    if not any(topology.mesh_backlash):
        return "No mesh has backlash: the teeth cannot separate."
    sentence = _hammering(answer, speed)
    doubts = []
    if answer.doubt and answer.answered:
        doubts.append(UNCONFIRMED)
    elif answer.doubt:
        doubts.append(f"{answer.doubt}, do not rely on this")
    if answer.unstable:
        doubts.append("unstable, the train does not run in this motion")
    if not doubts:
        return sentence
    doubt = "; ".join(doubts)
    return f"{doubt[0].upper()}{doubt[1:]}: {sentence[0].lower()}{sentence[1:]}"


def _hammering(answer: Answer, speed: str) -> str:
    """Sentence on whether the teeth hammer at a ``speed`` in words."""
    name = most_apart(answer)
    contacts = answer.contacts
    if name is None:
        return f"All teeth stay in contact at {speed}."
    contact = contacts[name]
    hardest = max(contacts, key=lambda mesh: contacts[mesh].hardest_impact)
    apart = f"{name} is separated {_percent(contact.separated_fraction)} of the time, "
    elsewhere = contacts[hardest].hardest_impact > contact.hardest_impact
    count = contact.impacts_per_cycle
    if not count and not elsewhere:
        return f"Teeth separate at {speed}: {apart}without an impact."
    number = "one impact" if count == 1 else f"{plain_number(count, digits=3)} impacts"
    impacts = (
        f"{number} a cycle, the hardest at {hit(contact.hardest_impact)} m/s"
        if count
        else "without an impact"
    )
    if elsewhere:
        impacts += (
            "; hardest impact of all meshes:"
            f" {hit(contacts[hardest].hardest_impact)} m/s in {hardest}"
        )
    if contacts[hardest].hardest_impact < SOFT:
        return (
            f"The teeth separate and make contact again softly at {speed}:"
            f" {apart}{impacts}."
        )
    manners = {
        "irregular": " irregularly",
        "subharmonic": f" with a period of {answer.state.period} cycles",
    }
    manner = manners.get(answer.state.kind, "")
    return f"The teeth hammer{manner} at {speed}: {apart}{impacts}."


def _percent(share: float) -> str:
    """A share in % with two digits, three from 99.5 % on: never ``1e+02 %``."""
    return f"{plain_number(100 * share, digits=2 if share < 0.995 else 3)} %"


def speeds_text(answers: Sequence[Answer]) -> str:
    """Speeds of answers in words, ``600, 1200 and 4 more rpm``; values where a sweep
    goes over another number.
    """
    return _places([answer.place for answer in answers], answers[0].axis)


def _places(places: Iterable[float], axis: SweepAxis) -> str:
    """Places on an axis in words, the first of many."""
    numbers = [f"{place:g}" for place in sorted(set(places))]
    rest = len(numbers) - SHOWN_SPEEDS
    more = f" and {rest} more" if rest > 0 else ""
    return axis.said(f"{', '.join(numbers[:SHOWN_SPEEDS])}{more}")


def notes(*answers: Answer) -> list[str]:
    """Sentences on what to be careful about in answers of one train, at least one."""
    axis = answers[0].axis
    sentences = []
    unstable = [answer for answer in answers if answer.unstable]
    if unstable:
        worst = max(unstable, key=lambda answer: answer.multiplier or 0.0)
        instead = (
            "leave out --orbit for what it does"
            if worst.orbit
            else "compare with jaxhb.integrate"
        )
        sentences.append(
            f"The periodic motion at {speeds_text(unstable)} is UNSTABLE (a disturbance"
            f" grows up to {worst.multiplier:.3g} times in a period): the train does"
            f" not run in it; {instead}."
        )
    solved = [
        (answer, answer.response)
        for answer in answers
        if answer.known and answer.response is not None
    ]
    defects = [
        (answer, abs(float(response.power_defect))) for answer, response in solved
    ]
    lossy = [(answer, defect) for answer, defect in defects if defect > LOST]
    if lossy:
        worst, defect = max(lossy, key=lambda pair: pair[1])
        share = f"{100 * defect:.2g} %"
        sentences.append(
            f"At {worst.at} {share} of the power of the torques is not accounted for:"
            " use more harmonics."
        )
    sentences += once_alike(
        (
            (answer.place, note)
            for answer in answers
            if answer.known
            for note in answer.state.notes
        ),
        axis,
    )
    # Converged orbits of unknown stability that a march of a few cycles did not settle
    # on.
    searches = Shooting | Homotopy | NewtonOnSweeps
    unsettled = [
        answer
        for answer, response in solved
        if answer.orbit
        and answer.converged
        and answer.stable is None
        and any(isinstance(event, searches) for event in response.path)
    ]
    if unsettled:
        sentences.append(
            f"A periodic motion was found at {speeds_text(unsettled)}, but a few cycles"
            " of time integration do not settle there: it may be unstable, and the"
            " engine may run in another motion (leave out --orbit for what it does)."
        )
    outside = (
        (answer.place, note)
        for answer in answers
        for note in answer.train.outside_traces(answer.rpm)
    )
    sentences += once_alike(outside, axis)
    temperatures = (
        note for answer in answers for note in fixed_temperatures(answer.train)
    )
    sentences += [f"{note}." for note in dict.fromkeys(temperatures)]
    sentences += torque_notes([answer.balance for answer in answers])
    return sentences + _tooth_notes([answer for answer in answers if answer.known])


def notes_text(*answers: Answer) -> list[str]:
    """The notes on the scene and on the motions as one paragraph in a list; an empty
    list where there are none.
    """
    return remarks_text([*plausibility(answers[0].train), *notes(*answers)])


def remarks_text(remarks: Iterable[str], head: str = "Notes") -> list[str]:
    """Sentences as one paragraph under a head in a list; an empty list where there are
    none.
    """
    lines = [
        textwrap.fill(
            remark,
            116,
            initial_indent="  ",
            subsequent_indent="    ",
            break_on_hyphens=False,
        )
        for remark in remarks
    ]
    if not lines:
        return []
    return ["\n".join([head, *lines] if head else lines)]


def _tooth_notes(answers: Sequence[Answer]) -> list[str]:
    """Traits of the tooth laws of answers whose motion is known."""
    sentences = []
    pulling_meshes = []
    for name in answers[0].topology.mesh_names if answers else ():
        law = answers[0].law(name)
        if law is None:
            continue
        means = [abs(float(answer.force(name).mean)) for answer in answers]
        least = int(np.argmin(means))
        mean = means[least]
        at_speed = speed_of(answers, least) if max(means) > 1.05 * mean else ""
        mean_force = f"the mean tooth force of {_force(mean)}{at_speed}"
        for trait, force, share, remedy in (
            (
                "the spring in the gap carries up to",
                law.gap_spring_force,
                GAP_SPRING_SHARE,
                "lower epsilon",
            ),
            (
                "the teeth reach full stiffness only above",
                law.knee_force,
                KNEE_SHARE,
                "a smaller transition makes contact sharper",
            ),
        ):
            if force > share * mean:
                sentences.append(
                    f"{name}: {trait} {_force(force)}, more than {100 * share:g} % of"
                    f" {mean_force}: {remedy}."
                )
        pulling = [
            answer.details[name].pulling_force if answer.details else 0.0
            for answer in answers
        ]
        hardest = int(np.argmax(pulling))
        if pulling[hardest] > GAP_SPRING_SHARE * means[hardest]:
            pulling_meshes.append(
                f"{_force(pulling[hardest])}{speed_of(answers, hardest)} in {name}"
            )
    if pulling_meshes:
        sentences.append(
            'Damping law "always" transmits force while the teeth are separated'
            ' ("contact" does not): up to'
            f" {', '.join(pulling_meshes)}."
        )
    return sentences


def once_alike(
    notes_of: Iterable[tuple[float, str]], axis: SweepAxis = SPEED
) -> list[str]:
    """Notes (place on the axis, text), once for those that differ in values alone, as
    it stands at the lowest place.
    """
    alike: dict[str, list[tuple[float, str]]] = {}
    for place, note in sorted(notes_of, key=lambda pair: pair[0]):
        pattern = _VALUE.sub(lambda value: value["name"] or "#", note)
        alike.setdefault(pattern, []).append((place, note))
    sentences = []
    for (place, note), *later in alike.values():
        elsewhere = {other for other, _ in later} - {place}
        also = f" (alike at {_places(elsewhere, axis)})" if elsewhere else ""
        sentences.append(f"At {axis.said(f'{place:g}')} {note}{also}.")
    return sentences


def misfire_text(worst: Mapping[str, Any], firing: str, swing: str = "") -> str:
    """The sentence on a misfire, the record of which the JSON has; ``firing`` is the
    title of the train without a misfire.
    """
    factor, unit = shown_unit(worst["unit"])
    value = f"{plain_number(factor * worst['value'])} {unit}"
    normal = f"{plain_number(factor * worst['firing'])} {unit}"
    normal = "no answer" if np.isnan(worst["firing"]) else normal
    share = ""
    if "share" in worst:
        judged = worst.get("judged", worst["quantity"])
        # The name of a limit may tell of what it is one.
        told = judged == worst["quantity"] or judged in worst["limit"]
        words = "" if told else f"{judged} "
        share = f", {words}{worst['share']:.2f} of {worst['limit']}"
    before = (
        f", {worst['firing_share']:.2f} of it"
        if share and np.isfinite(worst["firing_share"])
        else ""
    )
    return (
        f"The worst misfire is that of {worst['cylinder']}: {worst['quantity']} of"
        f" {value}{swing} in {worst['of']} at {worst['rpm']:g} rpm{share};"
        f" {normal}{before} with {firing}."
    )


def firing_lines(*trains: DriveTrain) -> list[str]:
    """A line on what is computed of cylinders that do not fire in some of the trains,
    in a list, empty without any.
    """
    computed = "; ".join(not_firing(*trains))
    return [f"Not firing, {computed}."] if computed else []


def _force(force: Number) -> str:
    """A force in N in the unit for people."""
    factor, unit = shown_unit("N")
    return f"{factor * force:.3g} {unit}"


def warnings(answers: Iterable[Answer]) -> list[str]:
    """Warnings on stderr of speeds without an answer, once for those that fail alike:
    what happened, and what helps.
    """
    failed: dict[str, list[Answer]] = {}
    for answer in answers:
        if answer.answered:
            continue
        notes = "; ".join(answer.state.notes).removesuffix(".")
        failure = f"the kind of motion is unknown: {notes}"
        if answer.status is not None:
            failure = f"{answer.status.name}, {_remedy(answer)}"
        failed.setdefault(failure, []).append(answer)
    return [f"{speeds_text(alike)}: {failure}." for failure, alike in failed.items()]


def _remedy(answer: Answer) -> str:
    """Meaning of a status, and what the command line can do about it."""
    assert answer.status is not None  # only solutions have one
    if answer.status is Status.TOLERANCE_NOT_MET:
        most = (answer.harmonics or 0) >= MOST_HARMONICS["reduced"]
        few = (
            f"{answer.harmonics} harmonics, the most that are taken, are"
            if most
            else "its harmonics are"
        )
        more = "" if most else "leave out --harmonics or give more, or "
        return (
            f"the motion is solved, but {few} too few for the tolerance: {more}accept"
            " its error with --tolerance"
        )
    if answer.status in (Status.MAX_STEPS, Status.STALLED) and any(
        answer.topology.mesh_backlash
    ):
        steady = "leave out --orbit for what the train does, " if answer.orbit else ""
        return (
            f"Newton's method found no periodic motion: {steady}give --harmonics above"
            " those of the mesh modes (jaxhb modes), or take another speed nearby"
        )
    return answer.status.sentence

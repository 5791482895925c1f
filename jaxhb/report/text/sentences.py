"""The sentences that an engineer reads first: do the teeth hammer, in what motion, and
what to be careful about.
"""

import re
import textwrap

import numpy as np

from jaxhb.balance.plan import MOST_HARMONICS
from jaxhb.floquet.stability import fall_text
from jaxhb.report.answer import SPEED, UNCONFIRMED
from jaxhb.report.quantities import shown_unit
from jaxhb.report.selection import most_apart
from jaxhb.report.text.columns import hit, plain_number
from jaxhb.report.text.mean_torques import speed_of, torque_notes
from jaxhb.results.status import Homotopy, NewtonOnSweeps, Shooting, Status
from jaxhb.steady.closure import SPREAD
from jaxhb.train.firing import not_firing
from jaxhb.train.plausible import plausibility

SOFT = 0.005  # approach speed of impacts, m/s, below which no teeth hammer
LOST = 1e-3  # share of the power of the torques that may be lost without a note

_VALUE = re.compile(
    r"""(?P<name>(?<!\w)(?P<quote>['"]).*?(?<!\\)(?P=quote))|\b\d[\d.]*(e[-+]?\d+)?"""
)
"""A value in a note, or a name in quotes, whose digits are no values."""

GAP_SPRING_SHARE = 0.05
KNEE_SHARE = 0.5
SHOWN_SPEEDS = 6


def _stability_text(answer):
    """What is known of the stability of a motion, "" for nothing."""
    found = answer.stability
    period = answer.state.period
    span = "a cycle" if period <= 1 else f"{period} cycles"
    if found is None:
        return f"stability not decided: {answer.undecided}" if answer.undecided else ""
    if answer.unstable:
        how = f" ({found.loses_by})" if found.loses_by else ""
        return (
            f"UNSTABLE{how}: a disturbance grows {found.largest:.3g} times in {span};"
            " the train does not run in it"
        )
    return f"stable: a disturbance {fall_text(found.largest)} in {span}"


def motion_text(answer):
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
    if answer.recorded:
        kind += f"; {UNCONFIRMED}" if answer.unconfirmed else ""
        kind += f"; numbers are the extremes over {state.record.cycles} recorded cycles"
        kind += "" if state.period else _spread_text(state.record)
    return "; ".join(filter(None, [kind, _stability_text(answer)]))


def _spread_text(record):
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


def motion_word(answer):
    """The kind of motion in a word or two, for a column of a table."""
    state = answer.state
    parts = []
    if answer.orbit:
        parts.append(status_word(answer.status))
    else:
        words = {"subharmonic": f"period {state.period}"}
        parts.append(words.get(state.kind, state.kind))
        if answer.doubt:
            parts.append(
                answer.doubt if answer.answered else status_word(answer.status)
            )
    return ", ".join([*parts, *["UNSTABLE"] * answer.unstable])


def status_word(status):
    """A Status in small letters."""
    return status.name.lower().replace("_", " ")


def solution_text(answer):
    """How the harmonic solution went: status with what to try, harmonics, residual,
    truncation error; "" without.
    """
    response = answer.response
    period = answer.state.period
    if response is None:
        return ""
    said = (
        "converged"
        if answer.converged
        else f"NOT CONVERGED: {status_word(answer.status)}"
    )
    line = (
        f"{said}; {answer.harmonics} harmonics of"
        f" {'the cycle' if period <= 1 else f'{period} cycles'}"
    )
    residual = float(response.residual)
    error = float(response.truncation_error)
    if not residual and not error:
        return f"{line}, linear" + (
            ": every mesh keeps its flank"
            if any(response.topology.mesh_backlash)
            else ""
        )
    return (
        f"{line}, residual {residual:.1e}, truncation error {_percent(error)} of the"
        " largest tooth force"
    )


def status_lines(answer):
    """The kind of motion and, where there is one, how its harmonic solution went."""
    head = "orbit" if answer.orbit else "motion"
    return [f"{head}: {motion_text(answer)}", *filter(None, [solution_text(answer)])]


def verdict(answer):
    """The answer in one sentence: do the teeth hammer, which mesh is apart longest,
    which has the hardest impact?
    """
    topology = answer.topology
    speed = answer.at
    if not answer.known:
        return f"No answer at {speed}."
    if not topology.mesh_names:
        return "No teeth mesh in this train."
    if not any(topology.mesh_backlash):
        return "No mesh has backlash: the teeth cannot separate."
    said = _hammering(answer, speed)
    doubts = [
        UNCONFIRMED if answer.answered else f"{answer.doubt}, do not rely on this"
    ] * bool(answer.doubt)
    doubts += ["unstable, the train does not run in this motion"] * answer.unstable
    if not doubts:
        return said
    doubt = "; ".join(doubts)
    return f"{doubt[0].upper()}{doubt[1:]}: {said[0].lower()}{said[1:]}"


def _hammering(answer, speed):
    name = most_apart(answer)
    contacts = answer.contacts
    if name is None:
        return f"All teeth stay in contact at {speed}."
    contact = contacts[name]
    hardest = max(contacts, key=lambda mesh: contacts[mesh].hardest_impact)
    said = f"{name} is apart {_percent(contact.separated_fraction)} of the time, "
    elsewhere = contacts[hardest].hardest_impact > contact.hardest_impact
    count = contact.impacts_per_cycle
    if not count and not elsewhere:
        return f"Teeth separate at {speed}: {said}without an impact."
    impacts = "one impact" if count == 1 else f"{plain_number(count, digits=3)} impacts"
    said += (
        f"{impacts} a cycle, the hardest at {hit(contact.hardest_impact)} m/s"
        if count
        else "without an impact"
    )
    said += (
        f"; the hardest of all at {hit(contacts[hardest].hardest_impact)} m/s in"
        f" {hardest}"
        if elsewhere
        else ""
    )
    if contacts[hardest].hardest_impact < SOFT:
        return f"The teeth part and touch again softly at {speed}: {said}."
    manner = {
        "irregular": " irregularly",
        "subharmonic": f" with a period of {answer.state.period} cycles",
    }
    return f"The teeth hammer{manner.get(answer.state.kind, '')} at {speed}: {said}."


def _percent(share):
    """Two digits, three from 99.5 % on: never ``1e+02 %``."""
    return f"{plain_number(100 * share, digits=2 if share < 0.995 else 3)} %"


def speeds_text(answers):
    """``600, 1200 and 4 more rpm``; of another number that a sweep goes over its
    values.
    """
    return _places([answer.place for answer in answers], answers[0].axis)


def _places(places, axis):
    found = [f"{place:g}" for place in sorted(set(places))]
    more = f" and {len(found) - SHOWN_SPEEDS} more" if len(found) > SHOWN_SPEEDS else ""
    return axis.said(f"{', '.join(found[:SHOWN_SPEEDS])}{more}")


def notes(*answers):
    """Sentences on what to be careful about in answers of one train, at least one."""
    axis = answers[0].axis
    found = []
    unstable = [answer for answer in answers if answer.unstable]
    if unstable:
        worst = max(unstable, key=lambda answer: answer.multiplier)
        instead = (
            "leave out --orbit for what it does"
            if worst.orbit
            else "compare with jaxhb.integrate"
        )
        found.append(
            f"The periodic motion at {speeds_text(unstable)} is UNSTABLE (a disturbance"
            f" grows up to {worst.multiplier:.3g} times in a period): the train does"
            f" not run in it; {instead}."
        )
    solved = [
        answer for answer in answers if answer.known and answer.response is not None
    ]
    lossy = [answer for answer in solved if abs(answer.response.power_defect) > LOST]
    if lossy:
        worst = max(lossy, key=lambda answer: abs(answer.response.power_defect))
        share = f"{100 * abs(float(worst.response.power_defect)):.2g} %"
        found.append(
            f"At {worst.at} {share} of the power of the torques is not accounted for:"
            " use more harmonics."
        )
    found += once_alike(
        ((a.place, note) for a in answers if a.known for note in a.state.notes), axis
    )
    # Converged orbits of unknown stability that a march of a few cycles did not settle
    # on.
    unsettled = [a for a in solved if a.orbit and a.converged and a.stable is None]
    searches = Shooting | Homotopy | NewtonOnSweeps
    unsettled = [
        a
        for a in unsettled
        if any(isinstance(event, searches) for event in a.response.path)
    ]
    if unsettled:
        found.append(
            f"A periodic motion was found at {speeds_text(unsettled)}, but a few cycles"
            " of time integration do not settle there: it may be unstable, and the"
            " engine may run in another motion (leave out --orbit for what it does)."
        )
    found += once_alike(
        ((a.place, note) for a in answers for note in a.train.outside_traces(a.rpm)),
        axis,
    )
    return (
        found
        + torque_notes([a.balance for a in answers])
        + _tooth_notes([answer for answer in answers if answer.known])
    )


def notes_text(*answers):
    """The notes on the scene and on the motions as one paragraph in a list; an empty
    list where there are none.
    """
    return remarks_text([*plausibility(answers[0].train), *notes(*answers)])


def remarks_text(remarks, head="Notes"):
    """Sentences as one paragraph under a head in a list; an empty list where there are
    none.
    """
    style = {
        "initial_indent": "  ",
        "subsequent_indent": "    ",
        "break_on_hyphens": False,
    }
    lines = [textwrap.fill(remark, 116, **style) for remark in remarks]
    return ["\n".join([head, *lines] if head else lines)] if lines else []


def _tooth_notes(known):
    """Traits of the tooth laws of answers that are known."""
    found = []
    through = []
    for name in known[0].topology.mesh_names if known else ():
        law = known[0].law(name)
        if law is None:
            continue
        means = [abs(float(answer.force(name).mean)) for answer in known]
        least = int(np.argmin(means))
        mean = means[least]
        said = (
            "the mean tooth force of"
            f" {_kN(mean)}{speed_of(known, least) if max(means) > 1.05 * mean else ''}"
        )
        soft = "the spring in the gap carries up to"
        knee = "the teeth are stiff only above"
        for what, force, share, remedy in (
            (soft, law.gap_spring_force, GAP_SPRING_SHARE, "lower epsilon"),
            (
                knee,
                law.knee_force,
                KNEE_SHARE,
                "a smaller transition makes contact sharper",
            ),
        ):
            if force > share * mean:
                found.append(
                    f"{name}: {what} {_kN(force)}, more than {100 * share:g} % of"
                    f" {said}: {remedy}."
                )
        pulling = [
            answer.details[name].pulling_force if answer.details else 0.0
            for answer in known
        ]
        hardest = int(np.argmax(pulling))
        if pulling[hardest] > GAP_SPRING_SHARE * means[hardest]:
            through.append(
                f"{_kN(pulling[hardest])}{speed_of(known, hardest)} in {name}"
            )
    if through:
        law = (
            'Damping law "always" transmits force while the teeth are apart ("contact"'
            " does not)"
        )
        found.append(f"{law}: up to {', '.join(through)}.")
    return found


def once_alike(notes_of, axis=SPEED):
    """Notes (place on the axis, text), once for those that differ in values alone, as
    it stands at the lowest place.
    """
    alike = {}
    found = []
    for place, note in sorted(notes_of, key=lambda told: told[0]):
        alike.setdefault(
            _VALUE.sub(lambda value: value["name"] or "#", note), []
        ).append((place, note))
    for (place, note), *told in alike.values():
        others = {other for other, _ in told} - {place}
        also = f" (alike at {_places(others, axis)})" if others else ""
        found.append(f"At {axis.said(f'{place:g}')} {note}{also}.")
    return found


def misfire_text(worst, firing, swing=""):
    """The sentence on a misfire, the record of which the JSON has; ``firing`` is what
    the train is called without.
    """
    factor, unit = shown_unit(worst["unit"])
    value, normal = (
        f"{plain_number(factor * worst[key])} {unit}" for key in ("value", "firing")
    )
    normal = "no answer" if np.isnan(worst["firing"]) else normal
    share = f", {worst['share']:.2f} of {worst['limit']}" if "share" in worst else ""
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


def firing_lines(*trains):
    """A line on what is computed of cylinders that do not fire in some of the trains,
    in a list, empty without any.
    """
    said = "; ".join(not_firing(*trains))
    return [f"Not firing, {said}."] * bool(said)


def _kN(force):
    return f"{force / 1e3:.3g} kN"


def warnings(answers):
    """What stderr says of speeds without an answer, once for those that fail alike:
    what happened, and what helps.
    """
    failed = {}
    for answer in answers:
        if not answer.answered:
            unknown = (
                "the kind of motion is unknown:"
                f" {'; '.join(answer.state.notes).removesuffix('.')}"
            )
            said = (
                unknown
                if answer.status is None
                else f"{answer.status.name}, {_remedy(answer)}"
            )
            failed.setdefault(said, []).append(answer)
    return [f"{speeds_text(told)}: {said}." for said, told in failed.items()]


def _remedy(answer):
    """What a status means and what the command line can do about it."""
    if answer.status is Status.TOLERANCE_NOT_MET:
        most = answer.harmonics >= MOST_HARMONICS["reduced"]
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
        own = "leave out --orbit for what the train does, " if answer.orbit else ""
        return (
            f"Newton's method found no periodic motion: {own}give --harmonics above"
            " those of the mesh modes (jaxhb modes), or take another speed nearby"
        )
    return answer.status.sentence

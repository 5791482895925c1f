"""Parts of the page on what the design is held against: limits, another design beside it, error bounds, notes."""

import dataclasses

import numpy as np

from ..model.plausible import plausibility
from .balance import plain_number
from .certified import certificate_parts
from .choose import largest
from .columns import NONE, Table
from .limit_plots import PANELS, judged_elements, share_of
from .misfire_cases import worst_misfire
from .page_differences import differences
from .page_figures import Figure, answered, bands, layout, line, speed_range, top_of
from .page_motion import angles, forces, gear_torques, main_quantity, maxima, over_speed, shaft_torques
from .page_parts import Heading, flowing
from .plots import plain
from .strength import AID, answers_strength, strength_text
from .sweep_tables import motion_sentences
from .words import notes, warnings

MOST = 4
"""Elements whose two designs are drawn."""

ROUNDING = 1e-9
"""Share of the power that is lost by rounding."""


def result_part(report):
    """What an engineer reads first: do the teeth hammer, how hard, and what of it is in doubt."""
    blocks, quantity = [], main_quantity(report.train)
    for case in report.shown:
        said = " ".join(motion_sentences(case.answers))
        blocks.append(f"With {case.title}: {said} {_largest(quantity, case)}")
    if len(report.cases) > 2 and (worst := worst_misfire(report.cases)):
        blocks.append(f"Of all {len(report.cases) - 1} misfires that of {worst['cylinder']} is the worst.")
    if report.second is not None:
        said = " ".join(motion_sentences(report.second.answers))
        blocks.append(f"With the {report.second.title}: {said} {_largest(quantity, report.second)}")
    return [*blocks, *_shares(report), *_doubts(report)]


def _largest(quantity, case):
    """The largest number of all elements over the speeds, in a sentence."""
    values = {name: quantity.of(case.answers, name) for name in quantity.names}
    name = largest(values, lambda name: np.nanmax(np.append(values[name], -1.0)))
    if name is None or not np.isfinite(values[name]).any():
        return "No speed has an answer."
    place = int(np.nanargmax(values[name]))
    before = quantity.without(case.answers, name)[place]
    backlash = any(case.answers[0].topology.mesh_backlash) and np.isfinite(before)
    less = f" ({before:.4g} {quantity.unit} without backlash)" if backlash else ""
    where = f"in {name} at {case.answers[place].rpm:g} rpm"
    return f"{quantity.title}: {values[name][place]:.4g} {quantity.unit} {where}{less}."


def _shares(report):
    """The largest share of a limit of the scene, in a list."""
    found = answers_strength(report.cases[0].answers)
    shares = {(kind, name): share_of(getattr(found, kind)[name], kind) for kind, name in judged_elements(found)}
    known = {key: share for key, share in shares.items() if share >= 0}
    if not known:
        return []
    said = [f"{PANELS[kind][1]} of {name} {share:.2f}" for (kind, name), share in known.items()]
    over = "ABOVE A LIMIT" if max(known.values()) > 1 else "within the limits"
    return [f"Against the limits of the scene ({AID}), {report.cases[0].title}, {over}; shares: {', '.join(said)}."]


def _every(report):
    """All cases, the second design last."""
    return [*report.cases, *([report.second] if report.second else [])]


def _doubts(report):
    """Speeds without an answer, in a list."""
    missing = {case.title: sum(not answer.answered for answer in case.answers) for case in _every(report)}
    said = [f"{count} of {len(report.rpm)} ({title})" for title, count in missing.items() if count]
    return [f"Speeds WITHOUT AN ANSWER, left out of all largest values: {', '.join(said)}."] if said else []


def limits_part(report):
    """Stresses, tooth torques and heat against the limits of the scene."""
    judged = {case.title: answers_strength(case.answers) for case in report.shown}
    first = judged[report.cases[0].title]
    if not first:
        return ["The scene gives no limits: no diameter of a shaft, no rated_torque of a mesh, no power_limit."]
    blocks = []
    for title, found in judged.items():
        told = [part if hasattr(part, "heads") else flowing(part) for part in strength_text({"": found})]
        blocks += [Heading(f"With {title}"), *(part for part in told if part not in blocks)]
    chosen = judged_elements(first, each=True)[: 2 * MOST] if len(report.rpm) > 1 else []
    return blocks + [_limit(judged, kind, name, report.shown) for kind, name in chosen]


def _limit(judged, kind, name, cases):
    """One element against its limits, case by case; what is barred of the first is shaded."""
    field, called, factor, unit, limits = PANELS[kind]
    traces, rpm = [], [answer.rpm for answer in cases[0].answers]
    for number, case in enumerate(cases):
        values = factor * np.asarray(getattr(getattr(judged[case.title], kind)[name], field), float)
        values = np.where(np.isfinite(answered(case.answers, lambda answer: 0.0)), values, np.nan)
        traces.append(line(rpm, values, f"{called}, {plain(case.title)}", number, mode="lines+markers"))
    first = judged[cases[0].title]
    for number, (limit, said) in enumerate(limits.items()):
        values = getattr(getattr(first, kind)[name], limit)
        if values is not None:
            traces.append(line(rpm, factor * np.broadcast_to(values, np.shape(rpm)), said, 2 + number))
            traces[-1]["line"] |= {"color": "black"}
    barred = first.barred.get(name, ()) if kind == "stresses" else ()
    edges = [(float(one.low), float(one.high)) for one in barred]
    panels = [(f"{called}, {unit}", top_of(*(trace["y"] for trace in traces)))]
    made = layout("speed, rpm", panels, traces, x_range=speed_range(rpm), heights=[180], shapes=bands(edges))
    shaded = "; grey: barred" if edges else ""
    return Figure(f"{plain(name)}: {called} against its limits, {unit}{shaded}", traces, made)


def second_part(report):
    """Another design beside the first: what differs, and what it does at the same speeds."""
    second, first = report.second, report.cases[0]
    if second is None:
        return []
    cases = [dataclasses.replace(first, title="first design"), second]
    other = second.answers[0].train
    blocks = list(report.tuning or differences(report.train, other))
    told = (forces, gear_torques, shaft_torques) if report.train.topology.link_names else (angles,)
    for quantity in told:
        mine, its = quantity(report.train), quantity(other)
        both = tuple(name for name in mine.names if name in its.names)
        if not both:
            continue
        mine = dataclasses.replace(mine, names=both)
        blocks.append(maxima(mine, cases, contact=quantity is forces))
        drawn = mine.hardest(cases)[:MOST] if len(report.rpm) > 1 else []
        blocks += [over_speed(mine, name, cases) for name in drawn]
    return blocks


def bounds_part(report):
    """How far the numbers can be trusted: residuals, truncation, power, error bounds."""
    rows = [[case.title, *_accuracy(case.answers)] for case in report.cases]
    heads = ["", "speeds answered", "largest residual", "truncation error %", "at rpm", "power lost %"]
    title = (
        "Harmonic balance, the largest of all speeds: residual of its equations, estimated change of the tooth force by"
        " harmonics left out (% of the largest), power not accounted for"
    )
    blocks = [Table(title, heads, list(zip(*rows, strict=True)))]
    chosen = [(case.title, case.answers[report.place]) for case in report.shown]
    certified = [(title, answer) for title, answer in chosen if answer.certificate is not None]
    if not certified:
        return [*blocks, "No error bound was asked for: --certify adds one at the speed that is shown in full."]
    for title, answer in certified:
        first, *tables = certificate_parts(answer, answer.certificate)
        blocks += [f"{answer.rpm:g} rpm, {title}. {flowing(first)}", *tables]
    return blocks


def _accuracy(answers):
    """Cells of one case."""
    solved = [answer for answer in answers if answer.answered and answer.response is not None]
    count = f"{sum(answer.answered for answer in answers)} of {len(answers)}"
    if not solved:
        return [count, *[NONE] * 4]
    residual = max(float(answer.response.residual) for answer in solved)
    worst = max(solved, key=lambda answer: float(answer.response.truncation_error))
    error = 100 * float(worst.response.truncation_error)
    lost = max(abs(float(answer.response.power_defect)) for answer in solved)
    at = f"{worst.rpm:g}" if error else NONE
    lost = plain_number(100 * lost, 2) if lost > ROUNDING else "0"
    return [count, f"{residual:.1e}" if residual else "0", plain_number(error, 2), at, lost]


def notes_part(report):
    """What to be careful about, and speeds without an answer."""
    said = [f"{case.title}: {sentence}" for case in _every(report) for sentence in warnings(case.answers)]
    own = plausibility(report.train) + notes(*(answer for case in report.cases for answer in case.answers))
    return [*said, *own] or ["Nothing to note."]

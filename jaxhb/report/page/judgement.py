"""Parts of the page on what was found and how far it can be trusted: the result, computed bounds, notes."""

import numpy as np

from jaxhb.report.page.limits import judged_text
from jaxhb.report.page.parts import flowing
from jaxhb.report.quantities import main_quantity
from jaxhb.report.selection import largest
from jaxhb.report.text.cases import worst_misfire
from jaxhb.report.text.certified import certificate_parts
from jaxhb.report.text.columns import NONE, Table, plain_number
from jaxhb.report.text.sentences import notes, warnings
from jaxhb.report.text.sweep_tables import motion_sentences
from jaxhb.train.plausible import plausibility

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
    for case in report.seconds:
        said = " ".join(motion_sentences(case.answers))
        blocks.append(f"With the {case.title}: {said} {_largest(main_quantity(case.answers[0].train), case)}")
    judged = judged_text(report.cases) + judged_text(report.seconds, "Second design, against the limits of its scene")
    return [*blocks, *judged, *_doubts(report)]


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


def _every(report):
    """All cases, the second design last."""
    return [*report.cases, *report.seconds]


def _doubts(report):
    """Speeds without an answer, in a list."""
    missing = {case.title: sum(not answer.answered for answer in case.answers) for case in _every(report)}
    said = [f"{count} of {len(report.rpm)} ({title})" for title, count in missing.items() if count]
    return [f"Speeds WITHOUT AN ANSWER, left out of all largest values: {', '.join(said)}."] if said else []


def bounds_part(report):
    """How far the numbers can be trusted: residuals, truncation, power, computed bounds."""
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
        return [*blocks, "No computed bound was asked for: --certify adds one at the speed that is shown in full."]
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

"""Parts of the page on what was found and how far it can be trusted: the result, computed bounds, notes."""

import numpy as np

from jaxhb.report.page.limits import judged
from jaxhb.report.page.parts import table
from jaxhb.report.text.cases import hardest, worst_misfire
from jaxhb.report.text.certified import certificate_parts
from jaxhb.report.text.columns import NONE, plain_number
from jaxhb.report.text.sentences import notes, warnings
from jaxhb.report.text.sweep_tables import motion_sentences
from jaxhb.train.plausible import plausibility

ROUNDING = 1e-9
"""Share of the power that is lost by rounding."""


def result(report):
    """What an engineer reads first: do the teeth hammer, how hard, and what of it is in doubt."""
    every = [*report.cases, *report.seconds]
    missing = {case.title: sum(not answer.answered for answer in case.answers) for case in every}
    return {
        "shown": [_largest(case) for case in report.shown],
        "seconds": [_largest(case) for case in report.seconds],
        "worst": worst_misfire(report.cases),
        "first": judged(report.cases),
        "second": judged(report.seconds),
        "doubts": {title: count for title, count in missing.items() if count},
    }


def _largest(case):
    """What a case does over the speeds, and the largest number of all elements."""
    found = [(*hardest(answer), answer) for answer in case.answers]
    quantity, name, value, answer = max(found, key=lambda row: row[2] if row[1] else -1.0)
    told = {"title": case.title, "said": " ".join(motion_sentences(case.answers)), "quantity": quantity, "name": name}
    before = quantity.without([answer], name)[0] if name and any(answer.topology.mesh_backlash) else np.nan
    told |= {"largest": quantity.factor * value if name else None, "rpm": answer.rpm}
    return told | {"before": before if np.isfinite(before) else None}


def accuracy(report):
    """How far the numbers can be trusted: residuals, truncation, power, computed bounds."""
    title = (
        "Harmonic balance, the largest of all speeds: residual of its equations, estimated change of the tooth force by"
        " harmonics left out (% of the largest), power not accounted for"
    )
    heads = ["", "speeds answered", "largest residual", "truncation error %", "at rpm", "power lost %"]
    rows = [[case.title, *_accuracy(case.answers)] for case in report.cases]
    chosen = {case.title: case.answers[report.place] for case in report.shown}
    certified = {title: answer for title, answer in chosen.items() if answer.certificate is not None}
    return {
        "residuals": table(title, rows, heads),
        "rpm": report.rpm[report.place],
        "certified": {title: certificate_parts(answer, answer.certificate) for title, answer in certified.items()},
    }


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


def notes_of(report):
    """What to be careful about, and speeds without an answer."""
    every = [*report.cases, *report.seconds]
    said = [f"{case.title}: {sentence}" for case in every for sentence in warnings(case.answers)]
    own = plausibility(report.train) + notes(*(answer for case in report.cases for answer in case.answers))
    return {"blocks": [*said, *own] or ["Nothing to note."]}

"""Parts of the page on the answers and how far they can be trusted: limits, computed
bounds, notes.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jaxhb.report.answer import Answer, Case
from jaxhb.report.figures.speeds import judged_elements, limit_figure
from jaxhb.report.page.parts import Block, Heading, Report, flowing
from jaxhb.report.table import Column, Table
from jaxhb.report.text.cases import (
    governing_misfires,
    governing_table,
)
from jaxhb.report.text.certified import certificate_parts
from jaxhb.report.text.columns import NONE, plain_number
from jaxhb.report.text.sentences import notes, warnings
from jaxhb.report.text.strength import (
    AID,
    LIMITED,
    Share,
    answers_strength,
    largest_shares,
    strength_text,
)
from jaxhb.train.checks.plausible import plausibility

ROUNDING = 1e-9  # share of the power that is lost by rounding


def accuracy(report: Report) -> list[Block]:
    """Tell how far the numbers can be trusted: residuals, truncation, power, computed
    bounds.
    """
    blocks: list[Block] = [
        Table(
            "Harmonic balance, the largest of all speeds: residual of its equations,"
            " estimated change of the tooth force by harmonics left out (% of the"
            " largest), power not accounted for",
            [
                "",
                "speeds answered",
                "largest residual",
                "truncation error %",
                "at rpm",
                "power lost %",
            ],
            [[case.title, *_accuracy(case.answers)] for case in report.cases],
        )
    ]
    for case in report.shown:
        answer = case.answers[report.place]
        if answer.certificate is not None:
            text, *more = certificate_parts(answer, answer.certificate)
            blocks += [f"{answer.rpm:g} rpm, {case.title}. {flowing(text)}", *more]
    if not blocks[1:]:
        blocks.append(
            "No computed bound was asked for: --certify adds one at the speed that is"
            " shown in full."
        )
    return blocks


def _accuracy(answers: Sequence[Answer]) -> list[str]:
    """Write the cells of one case."""
    responses = [
        (answer.rpm, answer.response)
        for answer in answers
        if answer.answered and answer.response is not None
    ]
    count = f"{sum(answer.answered for answer in answers)} of {len(answers)}"
    if not responses:
        return [count, NONE, NONE, NONE, NONE]
    residual = max(float(response.residual) for _, response in responses)
    lost = max(abs(float(response.power_defect)) for _, response in responses)
    error, rpm = max(
        (float(response.truncation_error), rpm) for rpm, response in responses
    )
    return [
        count,
        f"{residual:.1e}" if residual else "0",
        plain_number(100 * error, 2),
        f"{rpm:g}" if error else NONE,
        plain_number(100 * lost, 2) if lost > ROUNDING else "0",
    ]


def notes_of(report: Report) -> list[Block]:
    """List what to be careful about, and speeds without an answer."""
    sentences: list[Block] = [
        f"{case.title}: {sentence}"
        for case in [*report.cases, *report.seconds]
        for sentence in warnings(case.answers)
    ]
    sentences += plausibility(report.train)
    sentences += notes(*(answer for case in report.cases for answer in case.answers))
    return sentences or ["Nothing to note."]


SHOWN = 6  # shares of limits in a sentence
SECOND_LIMITS = "Second design, against the limits of its scene"
MOST = 4  # elements whose limits are drawn, of each of two kinds


def shares_of(cases: Sequence[Case]) -> dict[tuple[str, str], Share]:
    """Find the :class:`~jaxhb.report.text.strength.Share` of every element over all
    cases that are judged.
    """
    return largest_shares(
        {case.title: answers_strength(case.answers) for case in cases}
    )


def judged(cases: Sequence[Case], against: str) -> list[str]:
    """Judge cases by their limits, in sentences: the largest shares, and where stresses
    may not even be passed through or the torque of teeth changes its sign.
    """
    shares = list(shares_of(cases).values())
    if not shares:
        return []

    over = sum(share.share > 1 for share in shares)
    count = "one case" if len(cases) == 1 else f"{len(cases)} cases"
    verdict = (
        f"{over} of {len(shares)} ABOVE A LIMIT"
        if over
        else "within the limits at all speeds that are judged"
    )
    listed = [
        f"{share.kind.called} of {share.name} {share.share:.2f} of {share.said}"
        f" ({share.case}, {share.rpm:g} rpm)"
        for share in shares[:SHOWN]
    ]
    if len(shares) > SHOWN:
        listed.append(f"{len(shares) - SHOWN} more have smaller shares")
    sentences = [
        f"{against} ({AID}), {count}: {verdict}. Shares, the largest first:"
        f" {'; '.join(listed)}."
    ]
    return [*sentences, *_above_transient(cases), *reversing(cases)]


def _above_transient(cases: Sequence[Case]) -> list[str]:
    """Name the shafts whose stress may not even be passed through, in a list."""
    above = _where(
        cases,
        "stresses",
        lambda row: row.transient is not None and np.any(row.stress > row.transient),
    )
    return [f"ABOVE THE TRANSIENT LIMIT of stress: {above}."] if above else []


def reversing(cases: Sequence[Case]) -> list[str]:
    """Name the meshes with a rated torque whose torque changes its sign, in a list."""
    names = _where(cases, "tooth_torques", lambda row: np.any(row.reverses))
    if not names:
        return []
    return [f"Teeth with a rated torque whose torque changes its sign: {names}."]


def _where(
    cases: Sequence[Case], key: str, holds: Callable[[Any], bool | np.bool_]
) -> str:
    """Name the elements and cases where something holds of a row of ``key``."""
    titles_by_name: dict[str, list[str]] = {}
    for case in cases:
        for name, row in getattr(answers_strength(case.answers), key).items():
            if holds(row):
                titles_by_name.setdefault(name, []).append(case.title)
    return "; ".join(
        f"{name} ({', '.join(titles)})" for name, titles in titles_by_name.items()
    )


def shares_table(title: str, cases: Sequence[Case]) -> Table | None:
    """Make a table of the shares of limits of every element, case by case; cases may be
    of two designs; None without a limit.
    """
    shares = [shares_of([case]) for case in cases]
    judged = dict.fromkeys(key for of_case in shares for key in of_case)
    columns = [
        Column("element", read=lambda key: key[1]),
        Column("judged", read=lambda key: LIMITED[key[0]].called),
        Column("limit", read=lambda key: LIMITED[key[0]].limit),
    ]
    for case, of_case in zip(cases, shares, strict=True):
        columns += [
            Column("share", _or_none("{0.share:.2f}"), of_case.get, case.title),
            Column("at rpm", _or_none("{0.rpm:g}"), of_case.get, case.title),
        ]
    return Table(title, columns, judged) if judged else None


def _or_none(form: str) -> Callable[[Any], str]:
    """Write a value in a form, a dash where there is none."""
    return lambda value: NONE if value is None else form.format(value)


def limits(report: Report) -> list[Block]:
    """Judge stresses, tooth torques and heat by the limits of the scene; of misfires
    that which governs each element.
    """
    strengths = {case.title: answers_strength(case.answers) for case in report.cases}
    normal = report.cases[0].title
    if not strengths[normal]:
        return [
            "The scene gives no limits: no diameter of a shaft, no rated_torque of a"
            " mesh, no power_limit."
        ]
    blocks: list[Block] = []
    for case in report.shown:
        parts = [
            part if isinstance(part, Table) else flowing(part)
            for part in strength_text({"": strengths[case.title]})
        ]
        new_parts = [part for part in parts if part not in blocks]
        blocks += [Heading(f"With {case.title}"), *new_parts]
    governing = governing_misfires(report.cases)
    if len(report.cases) > 2 and governing:
        blocks += [Heading("Of all misfires"), governing_table(report.cases)]
    chosen = (
        judged_elements(strengths[normal], each=True)[: 2 * MOST]
        if len(report.rpm) > 1
        else []
    )
    for key, name in chosen:
        worst = governing.get((key, name))
        drawn = [normal, worst.case] if worst else [case.title for case in report.shown]
        blocks.append(
            limit_figure(
                {title: strengths[title] for title in drawn}, key, name, report.train
            )
        )
    return blocks

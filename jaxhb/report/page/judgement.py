"""Parts of the page on the answers and how far they can be trusted: limits, computed
bounds, notes.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from jaxhb.linear.strength import Strength
from jaxhb.report.answer import Answer, Case
from jaxhb.report.page.parts import Block, Heading, Report, flowing
from jaxhb.report.table import Column, Table
from jaxhb.report.text.cases import governing_table
from jaxhb.report.text.certified import certificate_parts
from jaxhb.report.text.columns import NONE, plain_number
from jaxhb.report.text.sentences import notes, speeds_text
from jaxhb.report.text.strength import (
    AID,
    LIMITED,
    Share,
    answers_strength,
    largest_shares,
    rule_notes,
    strength_text,
)
from jaxhb.results.status import Status
from jaxhb.train.checks.plausible import plausibility

ROUNDING = 1e-9  # share of the power that is lost by rounding


def accuracy(report: Report) -> list[Block]:
    """Tell how far the numbers can be trusted: residuals, truncation, power, computed
    bounds.
    """
    if report.is_linear:
        return []  # the part on assumptions has it
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
    return blocks


def linear_accuracy(report: Report) -> list[str]:
    """Say what a linear train loses by rounding, in a sentence in a list; empty for
    other trains.
    """
    if not report.is_linear:
        return []
    lost = max(
        (
            abs(float(answer.response.power_defect))
            for case in report.cases
            for answer in case.answers
            if answer.response is not None
        ),
        default=0.0,
    )
    return [
        "Every order is solved by itself, exactly but for rounding (power not accounted"
        f" for: {100 * lost:.1g} %)."
    ]


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
    sentences = [
        sentence
        for case in [*report.cases, *report.seconds]
        for sentence in _without_result(case)
    ]
    sentences += plausibility(report.train)
    sentences += notes(*(answer for case in report.cases for answer in case.answers))
    return [for_readers(sentence) for sentence in sentences]


def _without_result(case: Case) -> list[str]:
    """Say at which speeds a case has no result and why, once for those that fail alike,
    in sentences.
    """
    alike: dict[str, list[Answer]] = {}
    for answer in case.answers:
        if answer.answered:
            continue
        reason = f"the kind of motion is unknown: {'; '.join(answer.state.notes)}"
        if answer.status is Status.TOLERANCE_NOT_MET:
            reason = (
                f"the motion was found, but {answer.harmonics} harmonics are too few"
                " for the accuracy asked for"
            )
        elif answer.status is not None:
            reason = answer.status.sentence.partition(": ")[0]
        alike.setdefault(reason.removesuffix("."), []).append(answer)
    return [
        f"No result at {speeds_text(answers)} with {case.title}: {reason}."
        for reason, answers in alike.items()
    ]


_ADVICE = r"--\w|jaxhb\b|\w_\w|another tolerance|use more harmonics|smaller transition"
_ADVICE += "|lower epsilon"
"""Words of what the user of the program may do, which readers of a report cannot."""


def for_readers(note: str) -> str:
    """Write a note for those who read a report: elements by their names, without what
    the user of the program may do.

    >>> for_readers("[[cylinder]] 'A1', 'A2': the load is high: give load_over_rpm")
    'Cylinders A1, A2: the load is high.'
    >>> for_readers("[[shaft]] 'shaft 2': 3.2e5 Pa are unusual")
    'shaft 2: 3.2 bar are unusual.'
    """
    table = re.match(r"\[\[(\w+)\]\] ", note)
    if table:
        names, colon, rest = note[table.end() :].partition(": ")
        names = names.replace("', '", ", ").strip("'").replace("', …", ", …")
        several = "s" * (", " in names)
        kind = f"{table[1].capitalize()}{several} "
        if names.startswith(table[1]):
            kind = ""
        note = f"{kind}{names}{colon}{rest}"
    note = re.sub(rf" \([^()]*(?:{_ADVICE})[^()]*\)", "", note)
    clause = r"(?:(?![:;] ).)*"
    note = re.sub(rf"[:;] {clause}(?:{_ADVICE}){clause}$", "", note)
    note = re.sub(r"(\d)e5 Pa\b", r"\1 bar", note)
    return f"{note.rstrip('.')}."


SHOWN = 6  # shares of limits in a sentence
SECOND_LIMITS = "Second design, against the limits of its scene"


def shares_of(cases: Sequence[Case]) -> dict[tuple[str, str], Share]:
    """Find the :class:`~jaxhb.report.text.strength.Share` of every element over all
    cases that are judged.
    """
    return largest_shares(_strengths(cases))


def _strengths(cases: Sequence[Case]) -> dict[str, Strength]:
    """Judge cases by the limits of their scene at the speeds of their answers."""
    return {case.title: answers_strength(case.answers) for case in cases}


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
    strengths = _strengths(cases)
    return [*sentences, *_above_transient(strengths), *reversing(strengths)]


def _above_transient(strengths: Mapping[str, Strength]) -> list[str]:
    """Name the shafts whose stress may not even be passed through, in a list."""
    above = _where(
        strengths,
        "stresses",
        lambda row: row.transient is not None and np.any(row.stress > row.transient),
    )
    return [f"ABOVE THE TRANSIENT LIMIT of stress: {above}."] if above else []


def reversing(strengths: Mapping[str, Strength]) -> list[str]:
    """Name the meshes with a rated torque whose torque changes its sign, in a list."""
    names = _where(strengths, "tooth_torques", lambda row: np.any(row.reverses))
    if not names:
        return []
    return [f"Teeth with a rated torque whose torque changes its sign: {names}."]


def _where(
    strengths: Mapping[str, Strength],
    key: str,
    holds: Callable[[Any], bool | np.bool_],
) -> str:
    """Name the elements and cases where something holds of a row of ``key``."""
    titles_by_name: dict[str, list[str]] = {}
    for title, strength in strengths.items():
        for name, row in getattr(strength, key).items():
            if holds(row):
                titles_by_name.setdefault(name, []).append(title)
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
    strengths = report.strengths
    normal = report.cases[0].title
    if not strengths[normal]:
        return []
    blocks: list[Block] = []
    for case in report.shown:
        parts = [
            part if isinstance(part, Table) else flowing(part)
            for part in strength_text({"": strengths[case.title]})
        ]
        # The statement of compliance has the notes of the rules.
        told = [*blocks, *map(flowing, rule_notes(strengths[normal]))]
        new_parts = [part for part in parts if part not in told]
        blocks += [Heading(f"With {case.title}"), *new_parts]
    if len(report.cases) > 2 and not report.is_linear:
        blocks += [Heading("Of all misfires"), governing_table(report.cases)]
    return blocks

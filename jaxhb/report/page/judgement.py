"""Parts of the page on what was found and how far it can be trusted: result, limits,
computed bounds, notes.
"""

import numpy as np

from jaxhb.report.figures.speeds import judged_elements, limit_figure
from jaxhb.report.page.parts import Heading, flowing, table
from jaxhb.report.text.cases import (
    governing_misfires,
    governing_table,
    hardest_of,
    worst_misfire,
)
from jaxhb.report.text.certified import certificate_parts
from jaxhb.report.text.columns import NONE, Table, from_rows, plain_number
from jaxhb.report.text.sentences import firing_lines, misfire_text, notes, warnings
from jaxhb.report.text.strength import (
    AID,
    LIMITED,
    answers_strength,
    largest_shares,
    strength_text,
)
from jaxhb.report.text.sweep_tables import motion_sentences
from jaxhb.train.plausible import plausibility

ROUNDING = 1e-9  # share of the power that is lost by rounding


def result(report):
    """What an engineer reads first: do the teeth hammer, how hard, and what of it is in
    doubt.
    """
    blocks = [f"With {_largest(case)}" for case in report.shown]
    worst = worst_misfire(report.cases)
    blocks += firing_lines(*(case.answers[0].train for case in report.cases))
    if len(report.cases) > 2 and worst:
        blocks.append(
            f"Of all {len(report.cases) - 1}:"
            f" {misfire_text(worst, report.cases[0].title)}"
        )
    blocks += [f"With the {_largest(case)}" for case in report.seconds]
    blocks += judged(report.cases, "Against the limits of the scene") + judged(
        report.seconds, SECOND_LIMITS
    )
    missing = {
        case.title: sum(not a.answered for a in case.answers)
        for case in [*report.cases, *report.seconds]
    }
    doubts = ", ".join(
        f"{count} of {len(report.rpm)} ({title})"
        for title, count in missing.items()
        if count
    )
    return blocks + [
        f"Speeds WITHOUT AN ANSWER, left out of all largest values: {doubts}."
    ] * bool(doubts)


def _largest(case):
    """What a case does over the speeds, and the largest number of all elements, in
    sentences.
    """
    found = hardest_of([case])
    said = " ".join(motion_sentences(case.answers))
    if found is None:
        return f"{case.title}: {said} No speed has an answer."
    quantity = found.quantity
    before = (
        quantity.without([found.answer], found.name)[0]
        if any(found.answer.topology.mesh_backlash)
        else np.nan
    )
    without = (
        f" ({plain_number(before)} {quantity.unit} without backlash)"
        if np.isfinite(before)
        else ""
    )
    return f"{case.title}: {said} {quantity.title}: {found.said}{without}."


def accuracy(report):
    """How far the numbers can be trusted: residuals, truncation, power, computed
    bounds.
    """
    title = (
        "Harmonic balance, the largest of all speeds: residual of its equations,"
        " estimated change of the tooth force by harmonics left out (% of the largest),"
        " power not accounted for"
    )
    heads = [
        "",
        "speeds answered",
        "largest residual",
        "truncation error %",
        "at rpm",
        "power lost %",
    ]
    rows = [[case.title, *_accuracy(case.answers)] for case in report.cases]
    chosen = {case.title: case.answers[report.place] for case in report.shown}
    certified = {
        title: answer
        for title, answer in chosen.items()
        if answer.certificate is not None
    }
    blocks = [table(title, rows, heads)]
    for title, answer in certified.items():
        said, *more = certificate_parts(answer, answer.certificate)
        blocks += [f"{answer.rpm:g} rpm, {title}. {flowing(said)}", *more]
    none = (
        "No computed bound was asked for: --certify adds one at the speed that is shown"
        " in full."
    )
    return blocks if certified else [*blocks, none]


def _accuracy(answers):
    """Cells of one case."""
    solved = [
        answer for answer in answers if answer.answered and answer.response is not None
    ]
    count = f"{sum(answer.answered for answer in answers)} of {len(answers)}"
    if not solved:
        return [count, *[NONE] * 4]
    residual = max(float(answer.response.residual) for answer in solved)
    lost = max(abs(float(answer.response.power_defect)) for answer in solved)
    error, rpm = max(
        (float(answer.response.truncation_error), answer.rpm) for answer in solved
    )
    error, at = plain_number(100 * error, 2), f"{rpm:g}" if error else NONE
    lost = plain_number(100 * lost, 2) if lost > ROUNDING else "0"
    return [count, f"{residual:.1e}" if residual else "0", error, at, lost]


def notes_of(report):
    """What to be careful about, and speeds without an answer."""
    every = [*report.cases, *report.seconds]
    said = [
        f"{case.title}: {sentence}"
        for case in every
        for sentence in warnings(case.answers)
    ]
    own = plausibility(report.train) + notes(
        *(answer for case in report.cases for answer in case.answers)
    )
    return [*said, *own] or ["Nothing to note."]


SHOWN = 6  # shares of limits in a sentence
SECOND_LIMITS = "Second design, against the limits of its scene"
MOST = 4  # elements whose limits are drawn, of each of two kinds


def shares_of(cases):
    """The :class:`~jaxhb.report.text.strength.Share` of every element over all cases
    that are judged.
    """
    return largest_shares(
        {case.title: answers_strength(case.answers) for case in cases}
    )


def judged(cases, against):
    """How cases stand against their limits, in sentences: the largest shares, and where
    stresses may not even be passed through or the torque of teeth changes its sign.
    """
    shares = list(shares_of(cases).values())
    if not shares:
        return []

    def where(key, is_so):
        found = {}
        for case in cases:
            for name, row in getattr(answers_strength(case.answers), key).items():
                if is_so(row):
                    found.setdefault(name, []).append(case.title)
        return "; ".join(
            f"{name} ({', '.join(titles)})" for name, titles in found.items()
        )

    over = sum(one.share > 1 for one in shares)
    count = "one case" if len(cases) == 1 else f"{len(cases)} cases"
    how = (
        f"{over} of {len(shares)} ABOVE A LIMIT"
        if over
        else "within the limits at all speeds that are judged"
    )
    told = [
        f"{one.kind.called} of {one.name} {one.share:.2f} of {one.said} ({one.case},"
        f" {one.rpm:g} rpm)"
        for one in shares[:SHOWN]
    ]
    told += [f"{len(shares) - SHOWN} more have smaller shares"] * (len(shares) > SHOWN)
    said = [
        f"{against} ({AID}), {count}: {how}. Shares, the largest first:"
        f" {'; '.join(told)}."
    ]
    above = where(
        "stresses",
        lambda row: row.transient is not None and np.any(row.stress > row.transient),
    )
    reversing = where("tooth_torques", lambda row: np.any(row.reverses))
    said += [f"ABOVE THE TRANSIENT LIMIT of stress: {above}."] * bool(above)
    return said + [
        f"Teeth with a rated torque whose torque changes its sign: {reversing}."
    ] * bool(reversing)


def shares_table(title, cases):
    """Shares of limits of every element, case by case; cases may be of two designs;
    None without a limit.
    """
    columns = [shares_of([case]) for case in cases]
    rows = []
    for key, name in dict.fromkeys(key for column in columns for key in column):
        rows.append([name, LIMITED[key].called, LIMITED[key].limit])
        for column in columns:
            own = column.get((key, name))
            rows[-1] += [f"{own.share:.2f}", f"{own.rpm:g}"] if own else [NONE, NONE]
    heads = ["element", "judged", "limit", *["share", "at rpm"] * len(cases)]
    groups = [(case.title, 3 + 2 * i, 4 + 2 * i) for i, case in enumerate(cases)]
    return from_rows(title, heads, rows, groups) if rows else None


def limits(report):
    """Stresses, tooth torques and heat against the limits of the scene; of misfires
    that which governs each element.
    """
    every = {case.title: answers_strength(case.answers) for case in report.cases}
    normal = report.cases[0].title
    if not every[normal]:
        return [
            "The scene gives no limits: no diameter of a shaft, no rated_torque of a"
            " mesh, no power_limit."
        ]
    blocks = []
    for case in report.shown:
        parts = strength_text({"": every[case.title]})
        parts = [part if isinstance(part, Table) else flowing(part) for part in parts]
        blocks += [
            Heading(f"With {case.title}"),
            *(part for part in parts if part not in blocks),
        ]
    governing = governing_misfires(report.cases)
    if len(report.cases) > 2 and governing:
        blocks += [Heading("Of all misfires"), governing_table(report.cases)]
    chosen = (
        judged_elements(every[normal], each=True)[: 2 * MOST]
        if len(report.rpm) > 1
        else []
    )
    for key, name in chosen:
        worst = governing.get((key, name))
        drawn = [normal, worst.case] if worst else [case.title for case in report.shown]
        blocks.append(
            limit_figure(
                {title: every[title] for title in drawn}, key, name, report.train
            )
        )
    return blocks

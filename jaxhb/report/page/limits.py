"""What the page says of limits: every case, element and speed against them."""

from typing import NamedTuple

import numpy as np

from jaxhb.report.figures.limits import judged_elements, limit_figure
from jaxhb.report.page.parts import flowing
from jaxhb.report.text.columns import NONE, Table
from jaxhb.report.text.strength import AID, LIMITED, Limited, answers_strength, strength_text

MOST = 4
"""Elements whose limits are drawn, of each of two kinds."""


class Share(NamedTuple):
    """The largest share of a limit that an element has: its kind (of LIMITED), the case and the speed."""

    kind: Limited
    name: str
    share: float
    case: str
    rpm: float


def largest_shares(cases):
    """The :class:`Share` of every element over all cases and speeds that are judged, the largest first."""
    found = {}
    for case in cases:
        strength = answers_strength(case.answers)
        for key, name in judged_elements(strength, each=True):
            shares = LIMITED[key].shares(getattr(strength, key)[name])
            if np.isfinite(shares).any():
                place = int(np.nanargmax(shares))
                own = Share(LIMITED[key], name, float(shares[place]), case.title, case.answers[place].rpm)
                found[key, name] = max(own, found.get((key, name), own), key=lambda one: one.share)
    return dict(sorted(found.items(), key=lambda item: -item[1].share))


def judged(cases):
    """The largest shares of limits over all cases, and the titles of cases, by elements, in which stresses may not even
    be passed through, or the torque of teeth changes its sign."""
    shares, transient, reversing = list(largest_shares(cases).values()), {}, {}
    for case in cases:
        strength = answers_strength(case.answers)
        for name, row in strength.stresses.items():
            if row.transient is not None and np.any(row.stress > row.transient):
                transient.setdefault(name, []).append(case.title)
        for name, row in strength.tooth_torques.items():
            if np.any(row.reverses):
                reversing.setdefault(name, []).append(case.title)
    over = sum(one.share > 1 for one in shares)
    said = {"shares": shares, "over": over, "cases": len(cases), "transient": transient, "reversing": reversing}
    return said | {"aid": AID}


def shares_table(title, cases):
    """Shares of limits of every element, case by case; cases may be of two designs; None without a limit."""
    columns = [largest_shares([case]) for case in cases]
    keys = list(dict.fromkeys(key for column in columns for key in column))
    if not keys:
        return None
    kinds = [LIMITED[key] for key, _ in keys]
    cells = [[name for _, name in keys], [kind.called for kind in kinds], [kind.limit for kind in kinds]]
    for column in columns:
        cells.append([f"{column[key].share:.2f}" if key in column else NONE for key in keys])
        cells.append([f"{column[key].rpm:g}" if key in column else NONE for key in keys])
    heads = ["element", "judged", "limit", *["share", "at rpm"] * len(cases)]
    return Table(title, heads, cells, [(case.title, 3 + 2 * i, 4 + 2 * i) for i, case in enumerate(cases)])


def limits(report):
    """Stresses, tooth torques and heat against the limits of the scene."""
    strengths = {case.title: answers_strength(case.answers) for case in report.shown}
    first = strengths[report.cases[0].title]
    cases, told = {}, []
    for title, found in strengths.items() if first else ():
        parts = [part if isinstance(part, Table) else flowing(part) for part in strength_text({"": found})]
        cases[title] = [part for part in parts if part not in told]
        told += parts
    chosen = judged_elements(first, each=True)[: 2 * MOST] if len(report.rpm) > 1 else []
    return {"cases": cases, "figures": [limit_figure(strengths, kind, name) for kind, name in chosen]}

"""What the page says of limits: every case, element and speed against them."""

from typing import NamedTuple

import numpy as np

from jaxhb.report.figures.limits import PANELS, judged_elements, limit_figure, shares_of
from jaxhb.report.page.parts import Heading, flowing
from jaxhb.report.text.columns import NONE, Table
from jaxhb.report.text.strength import AID, answers_strength, strength_text

MOST = 4
"""Elements whose limits are drawn, of each of two kinds."""

NAMED = 6
"""Shares that the result tells."""


class Share(NamedTuple):
    """The largest share of a limit that an element has: its kind (a key of PANELS), the case and the speed."""

    kind: str
    name: str
    share: float
    case: str
    rpm: float

    @property
    def text(self):
        """In words, with the limit."""
        _, called, _, _, limits = PANELS[self.kind]
        limit = next(iter(limits.values()))
        of = "its limit" if limit == "limit" else limit if limit.startswith("a ") else f"the {limit}"
        return f"{called} of {self.name} {self.share:.2f} of {of} ({self.case}, {self.rpm:g} rpm)"


def largest_shares(cases):
    """The :class:`Share` of every element over all cases and speeds that are judged, the largest first."""
    found = {}
    for case in cases:
        judged = answers_strength(case.answers)
        for kind, name in judged_elements(judged, each=True):
            shares = shares_of(getattr(judged, kind)[name], kind)
            if np.isfinite(shares).any():
                place = int(np.nanargmax(shares))
                own = Share(kind, name, float(shares[place]), case.title, case.answers[place].rpm)
                found[kind, name] = max(own, found.get((kind, name), own), key=lambda one: one.share)
    return sorted(found.values(), key=lambda one: -one.share)


def judged_text(cases, against="Against the limits of the scene"):
    """The largest shares of limits over all cases in a sentence, and what else is above one, in a list."""
    shares = largest_shares(cases)
    if not shares:
        return []
    over = sum(one.share > 1 for one in shares)
    head = f"{over} of {len(shares)} ABOVE A LIMIT" if over else "within the limits at all speeds that are judged"
    which = "one case" if len(cases) == 1 else f"{len(cases)} cases"
    said = "; ".join(one.text for one in shares[:NAMED])
    more = f"; {len(shares) - NAMED} more have smaller shares" if len(shares) > NAMED else ""
    found = [f"{against} ({AID}), {which}: {head}. Shares, the largest first: {said}{more}."]
    return found + _transient(cases) + _reversing(cases)


def _transient(cases):
    """Stresses that may not even be passed through."""
    found = []
    for case in cases:
        for name, row in answers_strength(case.answers).stresses.items():
            if row.transient is not None and np.any(row.stress > row.transient):
                found.append(f"{name} ({case.title})")
    return [f"ABOVE THE TRANSIENT LIMIT of stress: {', '.join(found)}."] if found else []


def _reversing(cases):
    """Meshes whose torque changes its sign."""
    found = {}
    for case in cases:
        for name, row in answers_strength(case.answers).tooth_torques.items():
            if np.any(row.reverses):
                found.setdefault(name, []).append(case.title)
    said = "; ".join(f"{name} ({', '.join(titles)})" for name, titles in found.items())
    return [f"Teeth with a rated torque whose torque changes its sign: {said}."] if found else []


def shares_table(title, cases):
    """Shares of limits of every element, case by case, a table in a list; cases may be of two designs."""
    columns = [{(one.kind, one.name): one for one in largest_shares([case])} for case in cases]
    keys = list(dict.fromkeys(key for column in columns for key in column))
    if not keys:
        return []
    cells = [[name for _, name in keys], [PANELS[kind][1] for kind, _ in keys]]
    cells.append([next(iter(PANELS[kind][4].values())) for kind, _ in keys])
    for column in columns:
        cells.append([f"{column[key].share:.2f}" if key in column else NONE for key in keys])
        cells.append([f"{column[key].rpm:g}" if key in column else NONE for key in keys])
    heads = ["element", "judged", "limit", *["share", "at rpm"] * len(cases)]
    groups = [(case.title, 3 + 2 * i, 4 + 2 * i) for i, case in enumerate(cases)]
    return [Table(title, heads, cells, groups, left=(1, 2))]


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
    return blocks + [limit_figure(judged, kind, name) for kind, name in chosen]

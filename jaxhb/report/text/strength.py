"""Stresses, tooth torques and heat beside their limits, as text and as plain
numbers.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np

from jaxhb._shown import ranges
from jaxhb.elements.elements import RULES
from jaxhb.linear.strength import NEAR, RULE as OF_RULE, judged
from jaxhb.report.answer import UNCONFIRMED
from jaxhb.report.quantities import shown_unit
from jaxhb.report.text.columns import DOUBT, NONE, Doubtful, from_rows, ratio
from jaxhb.results.record import Motions

AID = "evaluation aid, no class approval"

ENOUGH = 50  # speeds from which barred ranges are found

RULE = (
    "Limits after IACS UR M68 for intermediate, thrust and propeller shafts, "
    "lambda = speed / {rated:g} rpm: to be checked\n"
    "against its current text. Tensile strengths count up to 800 MPa; of carbon "
    "steels and propeller shafts the rule counts\n"
    "at most 600 MPa. They do NOT hold for crankshafts: these have a rule of "
    "their own, IACS UR M53, which adds bending,\n"
    "fillets and oil holes, and is not computed here."
)


OTHER = (
    "Limits after {source},\n"
    "lambda = speed / {rated:g} rpm: to be checked against its current text. A: "
    "four-strokes in line, or in vee with firing\n"
    "intervals of 45 or 60 deg; B: two-strokes and other vees. Tensile strengths "
    "count up to 835 MPa; of carbon steels the\n"
    "rule counts at most 590 MPa. The strength of a crankshaft after IACS UR M53 "
    "is not computed here."
)


@dataclass(frozen=True)
class Limited:
    """A kind of rows of a :class:`jaxhb.Strength`: title of its table, head of its
    elements, SI unit, heads of its numbers in tables and CSV files (the first has the
    second as its limit), and what figures call its limits.
    """

    title: str
    element: str
    si_unit: str
    heads: dict
    limits: dict

    field = property(
        lambda self: next(iter(self.heads)), doc="Field of the number that is judged."
    )
    called = property(
        lambda self: self.heads[self.field][1], doc="What is judged, in words."
    )
    limit = property(
        lambda self: next(iter(self.limits.values())),
        doc="What the first limit is called.",
    )
    shown = property(
        lambda self: shown_unit(self.si_unit),
        doc="Factor from the SI unit, and the unit for people.",
    )

    def worst(self, row):
        """The largest share of the first limit, nan without one, and its place: without
        one that of the largest number; None where nothing is known.
        """
        numbers = np.asarray(getattr(row, self.field), float)
        limit = getattr(row, next(iter(self.limits)))
        limit = np.asarray(np.nan if limit is None else limit, float)
        shares = numbers / np.where(np.isfinite(limit), limit, np.nan)
        judged_by = shares if np.isfinite(shares).any() else numbers
        place = int(np.nanargmax(judged_by)) if np.isfinite(judged_by).any() else None
        return np.nan if place is None else float(shares[place]), place


_STRESS = f"Torsional stress of shafts, MPa: half of peak-to-peak torque / W_p ({AID})"
_TORQUE = (
    "Torque of meshes on the first gear, N m: half peak-to-peak, limit a third of the"
    f" rated torque ({AID})"
)
_CONTINUOUS = {"continuous": "continuous limit", "transient": "transient limit"}
_OF_STRESS = {"stress": ("stress", "stress")} | {
    field: (called, called) for field, called in _CONTINUOUS.items()
}
_OF_TORQUE = {
    "vibratory": ("vibratory", "vibratory torque"),
    "limit": ("limit", "limit of vibratory torque"),
}
_OF_TORQUE |= {"mean": ("mean", "mean torque")}
_OF_HEAT = {"power": ("heat", "heat"), "limit": ("limit", "limit of heat")}
LIMITED = {
    "stresses": Limited(_STRESS, "shaft", "Pa", _OF_STRESS, _CONTINUOUS),
    "tooth_torques": Limited(
        _TORQUE, "mesh", "N m", _OF_TORQUE, {"limit": "a third of the rated torque"}
    ),
    "heat": Limited(
        f"Heat of shafts and dampers, W ({AID})",
        "shaft or damper",
        "W",
        _OF_HEAT,
        {"limit": "limit"},
    ),
}
"""By the fields of a :class:`jaxhb.Strength`."""


@dataclass(frozen=True)
class Share:
    """The largest share of a limit of its ``kind`` that the element ``name`` has, its
    case, the place of the speed and the number that is judged, SI unit.
    """

    kind: Limited
    name: str
    share: float
    case: str
    place: int
    rpm: float
    value: float

    @property
    def said(self):
        """``the continuous limit``."""
        return {"limit": "its limit", "continuous limit": "the continuous limit"}.get(
            self.kind.limit, self.kind.limit
        )


def largest_shares(judged):
    """The :class:`Share` of every element with a limit over all cases and speeds, the
    largest first, by (key of LIMITED, name); ``judged`` has the :class:`jaxhb.Strength`
    of each case by its title.
    """
    found = {}
    for title, strength in judged.items():
        for key, limited in LIMITED.items():
            for name, row in getattr(strength, key).items() if strength else ():
                share, place = limited.worst(row)
                if np.isfinite(share):
                    value = float(np.asarray(getattr(row, limited.field))[place])
                    own = Share(
                        limited,
                        name,
                        share,
                        title,
                        place,
                        float(strength.rpm[place]),
                        value,
                    )
                    found[key, name] = max(
                        own, found.get((key, name), own), key=lambda one: one.share
                    )
    return dict(sorted(found.items(), key=lambda item: -item[1].share))


def at_same_speed(share, key, strength):
    """The judged number and its share of the limit of another case, where a
    :class:`Share` stands.
    """
    row = getattr(strength, key)[share.name]
    value = float(np.asarray(getattr(row, share.kind.field))[share.place])
    limit = np.broadcast_to(
        getattr(row, next(iter(share.kind.limits))), np.shape(strength.rpm)
    )
    return value, value / float(limit[share.place])


def answers_strength(answers):
    """The :class:`jaxhb.Strength` of answers of one train, at least one, with arrays
    over their speeds.
    """
    motions = Motions(
        answers[0].topology, [answer if answer.answered else None for answer in answers]
    )
    found = judged(
        answers[0].train, np.array([answer.rpm for answer in answers]), motions
    )
    unconfirmed = np.array([answer.unconfirmed for answer in answers])
    return (
        dataclasses.replace(found, unconfirmed=unconfirmed)
        if unconfirmed.any()
        else found
    )


def strength_text(judged):
    """Tables of the worst of each element, of one :class:`jaxhb.Strength` or more by
    headings ("" without one).
    """
    parts = []
    limited = {}
    for title, found in judged.items():
        own = [_table(found, kind) for kind in LIMITED if getattr(found, kind)]
        if any(row.continuous is not None for row in found.stresses.values()):
            for rule in found.judged:
                told = RULE if rule == RULES[0] else OTHER
                limited[rule] = told.format(
                    source=OF_RULE[rule].source, rated=found.rated_rpm
                )
            own += (
                [_barred_text(found, rule) for rule in found.judged]
                if len(found.rpm) > 1
                else []
            )
        parts += ([f"{title}\n{own[0]}"] if title and own else own[:1]) + own[1:]
    return parts + list(dict.fromkeys(limited.values()))


def _table(found, kind):
    """The numbers of every element at the speed at which it is worst."""
    limited, rpm, several, rows = LIMITED[kind], found.rpm, len(found.rpm) > 1, []

    def number(values, place):
        """Its size in the unit for people; nan where there is none and where the rule
        has no limit.
        """
        value = (
            np.nan
            if values is None or place is None
            else np.broadcast_to(values, np.shape(rpm))[place]
        )
        return limited.shown[0] * (abs(value) if np.isfinite(value) else np.nan)

    for name, row in getattr(found, kind).items():
        _, place = limited.worst(row)
        doubtful = (
            place is not None
            and found.unconfirmed is not None
            and found.unconfirmed[place]
        )
        first, *others = (number(getattr(row, field), place) for field in limited.heads)
        first = Doubtful(first) if doubtful else first
        at = [NONE if place is None else f"{rpm[place]:g}"] * several
        reverses = [_where(rpm, row.reverses)] if kind == "tooth_torques" else []
        rows.append([name, first, *at, *others, (first, others[0]), *reverses])
    first, *others = ((head, "number") for head, _ in limited.heads.values())
    heads = [limited.element, first, *["at rpm"] * several, *others, ("share", ratio)]
    marked = any(isinstance(row[1], Doubtful) for row in rows)
    title = f"{limited.title}; {DOUBT}: {UNCONFIRMED}" if marked else limited.title
    return from_rows(title, [*heads, *["reverses"] * (kind == "tooth_torques")], rows)


def _where(rpm, happens):
    """Speeds at which something happens; of one speed whether it does."""
    if len(rpm) == 1:
        return "yes" if happens[0] else "no"
    return f"at {ranges(list(rpm), rpm[happens])} rpm" if np.any(happens) else NONE


def _barred_text(found, rule):
    """What a rule bars of several speeds, one range a line, from how many it was
    judged, and where it was not.
    """
    limited = {
        name: found.stresses[name] for name, own in found.rules.items() if own == rule
    }
    barred = [(name, one) for name in limited for one in found.barred[name]]
    after = f" after {rule}" * (rule != RULES[0])
    share = OF_RULE[rule].highest
    judged = found.judged[rule]
    first = next(iter(limited.values()))
    rpm = np.asarray(found.rpm)
    rated = found.rated_rpm
    within = np.isfinite(first.continuous)
    said = []
    if within.any():
        head = "Barred speed ranges" if barred else "No barred speed range"
        said = [
            f"{head}{after} between {rpm[within].min():g} and {rpm[within].max():g} rpm"
            f" ({AID})"
        ]
        said += [
            _range_text(name, one, OF_RULE[rule].passed, rated) for name, one in barred
        ]
        speeds = rpm[within & np.isfinite(first.stress)]
        highest = share * rated
        few = (
            f": resonances between them are NOT seen, take {ENOUGH} or more"
            if len(speeds) < ENOUGH
            else ""
        )
        said.append(f"Judged from {len(speeds)} speed{'s' * (len(speeds) != 1)}{few}.")
        if len(speeds) and speeds.max() < (1 - NEAR) * highest:
            said[-1] += (
                f" The rule looks up to {highest:g} rpm, {share:g} of the rated speed:"
                " NOT judged there."
            )
    if not within.all():
        beyond = {
            name: np.where(within, -np.inf, np.nan_to_num(row.stress, nan=-np.inf))
            for name, row in limited.items()
        }
        largest = [
            f"{name} {1e-6 * stress.max():.4g} MPa at {rpm[stress.argmax()]:g} rpm"
            for name, stress in beyond.items()
            if np.isfinite(stress.max())
        ]
        told = f"; largest there: {', '.join(largest)}" if largest else ""
        said.append(
            f"Above {share * rated:g} rpm, {share:g} of the rated speed, the rule has"
            f" no limit: NOT judged{told}."
        )
    if judged.asked_to_rpm > judged.limits_to_rpm and not judged.complete:
        asked = (
            f"{OF_RULE[rule].asked:g} of the rated speed = {judged.asked_to_rpm:g} rpm"
        )
        ends = (
            f"the speeds end at {judged.known_to_rpm:g} rpm"
            if judged.known_to_rpm
            else "none is known"
        )
        said.append(f"The rule asks for stresses up to {asked}; {ends}.")
    return "\n".join(said)


def _range_text(name, one, share, rated):
    """One barred range as a line."""
    low, high = (f"{speed:.4g}" for speed in (one.low, one.high))
    low = f"{low} or below" if one.open_below else low
    high = f"{high} or above" if one.open_above else high
    said = (
        f"  {name}: {low} to {high} rpm, {one.share:.2f} of the continuous limit at"
        f" {one.at:g} rpm"
    )
    beyond = f"ABOVE THE TRANSIENT LIMIT ({one.transient_share:.2f} of it)"
    late = (
        f"; not accepted above {share:g} of the rated speed"
        if one.high > share * rated
        else ""
    )
    return f"{said}, {'within the transient limit' if one.passable else beyond}{late}"


def strength_record(found, *, one_speed=False):
    """``{"strength": ...}`` of a :class:`jaxhb.Strength`, see
    ``docs/how_to/data_and_files.md``: SI units, lists over the speeds (of ``one_speed``
    numbers, and no ranges), None where there is no limit; empty without any limits.
    """
    if not found:
        return {}
    record = {"note": AID, "rated_rpm": found.rated_rpm}
    record |= {
        "rules": found.rules,
        "judged": {r: one._asdict() for r, one in found.judged.items()},
    }
    for kind, limited in LIMITED.items():
        ends = dict.fromkeys(limited.heads, f"_{limited.si_unit.replace(' ', '')}")
        record[kind] = {
            name: {
                field + ends.get(field, ""): (
                    values[0] if one_speed and np.ndim(values) else values
                )
                for field, values in row._asdict().items()
            }
            for name, row in getattr(found, kind).items()
        }
    for name, ranges_of in () if one_speed else found.barred.items():
        record["stresses"][name]["barred"] = [
            vars(one) | {"passable": one.passable} for one in ranges_of
        ]
    return {"strength": record}


def strength_columns(found):
    """Columns of the CSV files by their heads, SI units, a value of each speed."""
    columns = {}
    for kind, limited in LIMITED.items():
        for name, row in getattr(found, kind).items():
            for field, values in row._asdict().items():
                head = (
                    f"{limited.heads[field][1]} {limited.si_unit}"
                    if field in limited.heads
                    else field
                )
                if values is not None:
                    columns[f"{name} {head}"] = np.broadcast_to(
                        values, np.shape(found.rpm)
                    )
    return columns

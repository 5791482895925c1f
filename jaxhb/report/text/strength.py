"""Stresses, torques, heat and vibrations beside their limits, as text and as plain
numbers.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxhb._jax import Array
from jaxhb._shown import ranges
from jaxhb.elements.rules import Rule
from jaxhb.linear.strength import (
    NEAR,
    BarredRange,
    Bounded,
    Heat,
    Strength,
    Stress,
    ToothTorque,
    judged,
)
from jaxhb.report.answer import UNCONFIRMED, Answer
from jaxhb.report.table import Column, Table
from jaxhb.report.text.columns import DOUBT, NONE, Doubtful, ratio
from jaxhb.report.units import said, shown_unit
from jaxhb.results.record import Motions

AID = "evaluation aid, no class approval"

ENOUGH = 50  # speeds from which barred ranges are found


@dataclass(frozen=True)
class Limited:
    """A kind of rows of a :class:`jaxhb.Strength`: title of its table, head of its
    elements, SI unit, heads of its numbers in tables and CSV files (the first has the
    second as its limit), what figures call its limits, and what readers are told of it
    below the tables.
    """

    title: str
    element: str
    si_unit: str
    heads: dict[str, tuple[str, str]]
    limits: dict[str, str]
    note: str = ""

    @property
    def field(self) -> str:
        """Field of the number that is judged."""
        return next(iter(self.heads))

    @property
    def called(self) -> str:
        """Name of the number that is judged, in words."""
        return self.heads[self.field][1]

    @property
    def limit(self) -> str:
        """Name of the first limit."""
        return next(iter(self.limits.values()))

    @property
    def rule(self) -> str:
        """Name of the rule where no publication has one: that of the limit, a plain
        limit is one of the scene.
        """
        return "limit of the scene" if self.plain else self.limit

    @property
    def plain(self) -> bool:
        """Whether the first limit has no name but that of the number that it bounds."""
        return self.limit in self.heads

    @property
    def shown(self) -> tuple[float, str]:
        """Factor from the SI unit, and the unit for people."""
        return shown_unit(self.si_unit)

    @property
    def suffix(self) -> str:
        """End of the keys of its numbers in JSON files, the SI unit."""
        unit = self.si_unit.replace(" ", "").replace("/", "_per_")
        return "" if unit == "1" else f"_{unit}"

    def worst(
        self, row: Stress | ToothTorque | Heat | Bounded
    ) -> tuple[float, int | None]:
        """The largest share of the first limit, nan without one, and its place: without
        one that of the largest number; None where nothing is known.
        """
        numbers = np.asarray(getattr(row, self.field), float)
        limit = getattr(row, next(iter(self.limits)))
        limit = np.asarray(np.nan if limit is None else limit, float)
        shares = numbers / np.where(np.isfinite(limit), limit, np.nan)
        judged_by = shares if np.isfinite(shares).any() else numbers
        if not np.isfinite(judged_by).any():
            return np.nan, None
        place = int(np.nanargmax(judged_by))
        return float(shares[place]), place


def _bounded(
    title: str, element: str, si_unit: str, called: str, limit: str, note: str = ""
) -> Limited:
    """Make the kind of :class:`jaxhb.linear.strength.Bounded` numbers."""
    heads = {"value": (called, called), "limit": ("limit", limit)}
    return Limited(f"{title} ({AID})", element, si_unit, heads, {"limit": limit}, note)


LIMITED = {
    "stresses": Limited(
        "Torsional stress of shafts, {Pa}: half of peak-to-peak torque / W_p"
        f" ({AID})",
        "shaft",
        "Pa",
        {
            "stress": ("stress", "stress"),
            "continuous": ("continuous limit", "continuous limit"),
            "transient": ("transient limit", "transient limit"),
        },
        {"continuous": "continuous limit", "transient": "transient limit"},
    ),
    "tooth_torques": Limited(
        "Torque of meshes on the first gear, {N m}: half peak-to-peak, limit a third of"
        f" the rated torque ({AID})",
        "mesh",
        "N m",
        {
            "vibratory": ("vibratory", "vibratory torque"),
            "limit": ("limit", "limit of vibratory torque"),
            "mean": ("mean", "mean torque"),
        },
        {"limit": "a third of the rated torque"},
    ),
    "heat": Limited(
        f"Heat of shafts and dampers, {{W}} ({AID})",
        "shaft or damper",
        "W",
        {"power": ("heat", "heat"), "limit": ("limit", "limit of heat")},
        {"limit": "limit"},
    ),
    "mean_torques": _bounded(
        "Mean torque of couplings, {N m}, beside the nominal torque T_KN",
        "coupling",
        "N m",
        "mean torque",
        "nominal torque",
    ),
    "vibratory_torques": _bounded(
        "Vibratory torque of couplings, {N m}: half peak-to-peak, beside the"
        " permissible one T_KW",
        "coupling",
        "N m",
        "vibratory torque",
        "permissible vibratory torque",
    ),
    "largest_torques": _bounded(
        "Largest torque of couplings, {N m}, beside the maximum torque T_Kmax",
        "coupling",
        "N m",
        "largest torque",
        "maximum torque",
    ),
    "speeds": _bounded(
        "Speed of couplings, rpm of their own rotor",
        "coupling",
        "rpm",
        "speed",
        "speed limit",
    ),
    "crank_stresses": _bounded(
        "Alternating torsional stress of crankshafts, {Pa}: nominal one times the"
        " larger of its factors",
        "shaft",
        "Pa",
        "alternating stress",
        "limit of alternating stress",
        "Alternating stresses of crankshafts are the part of IACS UR M53 that is"
        " torsion: half of peak-to-peak torque / W_p\ntimes alpha_T or beta_T of"
        " fillets, gamma_T of oil bores, against the limit that the scene gives."
        " Bending and its\ncombination with torsion, and the acceptability factor, are"
        " out of reach of this program.",
    ),
    "angles": _bounded(
        "Vibratory angle of disks, {rad}: half peak-to-peak",
        "disk",
        "rad",
        "vibratory angle",
        "limit of the vibratory angle",
    ),
    "irregularities": _bounded(
        "Cyclic irregularity of disks, {1}: (largest - smallest) / mean speed",
        "disk",
        "1",
        "cyclic irregularity",
        "limit of cyclic irregularity",
    ),
    "accelerations": _bounded(
        "Angular acceleration of disks, rad/s2: half peak-to-peak",
        "disk",
        "rad/s2",
        "angular acceleration",
        "limit of angular acceleration",
    ),
}
"""Kinds of rows by the fields of a :class:`jaxhb.Strength`."""


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
    def said(self) -> str:
        """The limit in a sentence: ``the continuous limit``."""
        limit = self.kind.limit
        if self.kind.plain:
            return "its limit"
        return limit if limit.startswith("a ") else f"the {limit}"


def largest_shares(
    strengths: Mapping[str, Strength],
) -> dict[tuple[str, str], Share]:
    """The :class:`Share` of every element with a limit over all cases and speeds, the
    largest first, by (key of LIMITED, name); ``strengths`` has the
    :class:`jaxhb.Strength` of each case by its title.
    """
    shares: dict[tuple[str, str], Share] = {}
    for title, strength in strengths.items():
        for key, limited in LIMITED.items():
            for name, row in getattr(strength, key).items() if strength else ():
                number, place = limited.worst(row)
                if place is None or not np.isfinite(number):
                    continue
                value = float(np.asarray(getattr(row, limited.field))[place])
                rpm = float(strength.rpm[place])
                share = Share(limited, name, number, title, place, rpm, value)
                largest = shares.get((key, name), share)
                shares[key, name] = max(share, largest, key=lambda each: each.share)
    return dict(sorted(shares.items(), key=lambda entry: -entry[1].share))


def at_same_speed(share: Share, key: str, strength: Strength) -> tuple[float, float]:
    """The judged number and its share of the limit of another case, at the speed of a
    :class:`Share`.
    """
    row = getattr(strength, key)[share.name]
    value = float(np.asarray(getattr(row, share.kind.field))[share.place])
    limit = np.broadcast_to(
        getattr(row, next(iter(share.kind.limits))), np.shape(strength.rpm)
    )
    return value, value / float(limit[share.place])


def answers_strength(answers: Sequence[Answer]) -> Strength:
    """The :class:`jaxhb.Strength` of answers of one train, at least one, with arrays
    over their speeds.
    """
    motions = Motions(
        answers[0].topology, [answer if answer.answered else None for answer in answers]
    )
    strength = judged(
        answers[0].train, np.array([answer.rpm for answer in answers]), motions
    )
    unconfirmed = np.array([answer.unconfirmed for answer in answers])
    return (
        dataclasses.replace(strength, unconfirmed=unconfirmed)
        if unconfirmed.any()
        else strength
    )


def rule_notes(strength: Strength) -> list[str]:
    """Texts that tell readers of the rules of shafts and of the limits of other
    elements.
    """
    notes = []
    if any(row.continuous is not None for row in strength.stresses.values()):
        for name in strength.judged:
            rule = strength.known[name]
            notes.append(rule.note.format(source=rule.source, rated=strength.rated_rpm))
    notes += [LIMITED[kind].note for kind in LIMITED if getattr(strength, kind)]
    return [note for note in dict.fromkeys(notes) if note]


def strength_text(strengths: Mapping[str, Strength]) -> list[str]:
    """Tables of the worst of each element, of one :class:`jaxhb.Strength` or more by
    headings ("" without one).
    """
    parts: list[str] = []
    sources: dict[str, None] = {}
    for title, strength in strengths.items():
        blocks: list[str] = [
            _table(strength, kind) for kind in LIMITED if getattr(strength, kind)
        ]
        if any(row.continuous is not None for row in strength.stresses.values()):
            for name in strength.judged if len(strength.rpm) > 1 else ():
                blocks.append(_barred_text(strength, name))
        sources |= dict.fromkeys(rule_notes(strength))
        if title and blocks:
            blocks[0] = f"{title}\n{blocks[0]}"
        parts += blocks
    return [*parts, *sources]


def _table(strength: Strength, kind: str) -> Table:
    """The numbers of every element at the speed at which it is worst."""
    limited = LIMITED[kind]
    rpm = strength.rpm
    several = len(rpm) > 1
    rows = []

    def number(values: Array | None, place: int | None) -> float:
        """Size of a number; nan where there is none and where the rule has no limit."""
        if values is None or place is None:
            return np.nan
        value = np.broadcast_to(values, np.shape(rpm))[place]
        return abs(value) if np.isfinite(value) else np.nan

    for name, row in getattr(strength, kind).items():
        _, place = limited.worst(row)
        first, *limits = (number(getattr(row, field), place) for field in limited.heads)
        if place is not None and strength.unconfirmed is not None:
            first = Doubtful(first) if strength.unconfirmed[place] else first
        at_rpm = [NONE if place is None else f"{rpm[place]:g}"] * several
        cells = [name, first, *at_rpm, *limits, (first, limits[0])]
        if kind == "tooth_torques":
            cells.append(_where(np.asarray(rpm), row.reverses))
        rows.append(cells)
    numbers = [
        Column(head, "number", unit=limited.si_unit)
        for head, _ in limited.heads.values()
    ]
    marked = any(isinstance(row[1], Doubtful) for row in rows)
    reverses = kind == "tooth_torques"
    return Table(
        f"{limited.title}; {DOUBT}: {UNCONFIRMED}" if marked else limited.title,
        [
            limited.element,
            numbers[0],
            *["at rpm"] * several,
            *numbers[1:],
            Column("share", ratio),
            *["reverses"] * (kind == "tooth_torques"),
        ],
        rows,
        marked=[place for place, row in enumerate(rows) if _above(row[-1 - reverses])],
    )


def _above(share: tuple[float, float]) -> bool:
    """Whether a number is above its limit; not where there is none."""
    value, limit = share
    return value > limit


def _where(rpm: np.ndarray, happens: np.ndarray) -> str:
    """Speeds at which something happens, of ``(n,)``; of one speed whether it does."""
    if len(rpm) == 1:
        return "yes" if happens[0] else "no"
    return f"at {ranges(list(rpm), rpm[happens])} rpm" if np.any(happens) else NONE


def _barred_text(strength: Strength, rule_name: str) -> str:
    """The speeds that a rule bars, one range a line, from how many speeds it was
    judged, and where it was not.
    """
    limited = {
        name: strength.stresses[name]
        for name, shaft_rule in strength.rules.items()
        if shaft_rule == rule_name
    }
    rule = strength.known[rule_name]
    barred = [(name, each) for name in limited for each in strength.barred[name]]
    after = "" if rule.default else f" after {rule.name}"
    share = rule.highest
    reach = strength.judged[rule_name]
    first = next(iter(limited.values()))
    rpm = np.asarray(strength.rpm)
    rated = strength.rated_rpm
    assert rated is not None  # rules are those of a rated speed
    within = np.isfinite(first.continuous)
    lines = []
    if within.any():
        kind = "restricted" if strength.not_firing else "barred"
        head = (
            f"{kind.capitalize()} speed ranges" if barred else f"No {kind} speed range"
        )
        lines = [
            f"{head}{after} between {rpm[within].min():g} and {rpm[within].max():g} rpm"
            f" ({AID})"
        ]
        lines += [
            range_text(name, barred_range, rule, rated) + _around(barred_range, rule)
            for name, barred_range in barred
        ]
        lines += _to_bar([each for _, each in barred], rule, strength)
        speeds = rpm[within & np.isfinite(first.stress)]
        highest = share * rated
        few = (
            f": resonances between them are NOT detected; use {ENOUGH} or more"
            if len(speeds) < ENOUGH
            else ""
        )
        lines.append(f"Judged from {len(speeds)} speed{'s' * (len(speeds) != 1)}{few}.")
        if len(speeds) and speeds.max() < (1 - NEAR) * highest:
            lines[-1] += (
                f" The rule looks up to {highest:g} rpm, {share:g} of the rated speed:"
                " NOT judged there."
            )
    if not within.all():
        beyond = {
            name: np.where(within, -np.inf, np.nan_to_num(row.stress, nan=-np.inf))
            for name, row in limited.items()
        }
        largest = [
            f"{name} {said(stress.max(), 'Pa')} at {rpm[stress.argmax()]:g} rpm"
            for name, stress in beyond.items()
            if np.isfinite(stress.max())
        ]
        largest_there = f"; largest there: {', '.join(largest)}" if largest else ""
        lines.append(
            f"Above {share * rated:g} rpm, {share:g} of the rated speed, the rule has"
            f" no limit: NOT judged{largest_there}."
        )
    if reach.asked_to_rpm > reach.limits_to_rpm and not reach.complete:
        speed = f"{rule.required:g} of the rated speed = {reach.asked_to_rpm:g} rpm"
        ends = (
            f"the speeds end at {reach.known_to_rpm:g} rpm"
            if reach.known_to_rpm
            else "none is known"
        )
        lines.append(f"The rule asks for stresses up to {speed}; {ends}.")
    return "\n".join(lines)


def range_text(
    name: str, barred_range: BarredRange, rule: Rule, rated_rpm: float
) -> str:
    """One barred range of a shaft as a line, and whether the rule accepts one there."""
    low = f"{barred_range.low:.4g}{' or below' * barred_range.open_below}"
    high = f"{barred_range.high:.4g}{' or above' * barred_range.open_above}"
    passing = (
        "within the transient limit"
        if barred_range.passable
        else f"ABOVE THE TRANSIENT LIMIT ({barred_range.transient_share:.2f} of it)"
    )
    late = (
        ""
        if barred_range.accepted_by(rule, rated_rpm)
        else f"; not accepted above {rule.passed:g} of the rated speed"
    )
    return (
        f"  {name}: {low} to {high} rpm, {barred_range.share:.2f} of the continuous"
        f" limit at {barred_range.at:g} rpm, {passing}{late}"
    )


def _around(barred_range: BarredRange, rule: Rule) -> str:
    """The range that a rule bars around a critical speed; empty of a rule without."""
    if barred_range.rule_low is None:
        return ""
    return (
        f"; {rule.range_source} around {barred_range.at:g} rpm:"
        f" {barred_range.rule_low:.4g} to {barred_range.rule_high:.4g} rpm"
    )


def _to_bar(barred: Sequence[BarredRange], rule: Rule, strength: Strength) -> list[str]:
    """The speeds that are to be barred together, in a list; empty of a rule that gives
    no range around a critical speed.
    """
    if rule.barred is None or not barred:
        return []
    united: list[list[float]] = []
    ends = [(float(each.bar_low), float(each.bar_high)) for each in barred]
    for low, high in sorted(ends):
        if united and low <= united[-1][1]:
            united[-1][1] = max(united[-1][1], high)
        else:
            united.append([low, high])
    below = {float(each.bar_low) for each in barred if each.open_below}
    above = {float(each.bar_high) for each in barred if each.open_above}
    listed = ", ".join(
        f"{low:.4g}{' or below' * (low in below)} to"
        f" {high:.4g}{' or above' * (high in above)} rpm"
        for low, high in united
    )
    tolerance = barred[0].tolerance
    share = 100 * strength.tachometer_tolerance
    rated = strength.rated_rpm
    assert rated is not None  # rules are those of a rated speed
    accepted = all(each.passable and each.accepted_by(rule, rated) for each in barred)
    what = "Restricted with this misfire" if strength.not_firing else "To be barred"
    how = " and passed rapidly" if accepted else ""
    words = (
        f"{what}{how}: {listed} (above the limit with {tolerance:g} rpm = {share:g} %"
        f" of the rated speed for the tachometer, and {rule.range_source} around each"
        " critical speed)."
    )
    if not accepted:
        words += " NOT accepted as a whole: see the ranges."
    if strength.not_firing:
        words += " What is left must allow to navigate safely."
    return [words]


def strength_record(
    strength: Strength, *, one_speed: bool = False
) -> dict[str, dict[str, Any]]:
    """Record ``{"strength": ...}`` of a :class:`jaxhb.Strength`, see
    ``docs/how_to/data_and_files.md``: SI units, lists over the speeds (of ``one_speed``
    numbers, and no ranges), None where there is no limit; empty without any limits.
    """
    if not strength:
        return {}
    record: dict[str, Any] = {
        "note": AID,
        "rated_rpm": strength.rated_rpm,
        "rules": strength.rules,
        "judged": {rule: reach._asdict() for rule, reach in strength.judged.items()},
    }
    for kind, limited in LIMITED.items():
        ends = dict.fromkeys(limited.heads, limited.suffix)
        record[kind] = {
            name: {
                field + ends.get(field, ""): (
                    values[0] if one_speed and np.ndim(values) else values
                )
                for field, values in row._asdict().items()
            }
            for name, row in getattr(strength, kind).items()
        }
    for name, barred_ranges in () if one_speed else strength.barred.items():
        record["stresses"][name]["barred"] = [
            range_record(barred_range) for barred_range in barred_ranges
        ]
    return {"strength": record}


def range_record(barred_range: BarredRange) -> dict[str, Any]:
    """Record of a barred range, speeds in rpm."""
    return vars(barred_range) | {
        "passable": barred_range.passable,
        "bar_low": barred_range.bar_low,
        "bar_high": barred_range.bar_high,
    }


def strength_columns(strength: Strength) -> dict[str, np.ndarray]:
    """Columns of the CSV files by their heads, SI units, a value of each speed."""
    columns = {}
    for kind, limited in LIMITED.items():
        for name, row in getattr(strength, kind).items():
            for field, values in row._asdict().items():
                head = (
                    f"{limited.heads[field][1]} {limited.si_unit}"
                    if field in limited.heads
                    else field
                )
                if values is not None:
                    columns[f"{name} {head}"] = np.broadcast_to(
                        values, np.shape(strength.rpm)
                    )
    return columns

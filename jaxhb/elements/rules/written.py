"""Rules that users write as TOML files, see ``docs/how_to/strength.md``: formulas as
text in the units that the file states, over spans of the speed ratio lambda.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import TYPE_CHECKING, Any

from jaxhb.elements.rules.formula import Formula, FormulaError, formula
from jaxhb.elements.rules.rule import Rule, Section
from jaxhb.elements.sentences import SceneError, cut, shown, suggestion

if TYPE_CHECKING:
    from jaxhb._jax import Array, Number

STRESS_UNITS = {"Pa": 1.0, "MPa": 1e6, "N/mm2": 1e6}
LENGTH_UNITS = {"m": 1.0, "mm": 1e-3}
"""SI units in a unit of a file."""

OF_SHAFTS = {
    "d": "diameter",
    "b": "",
    "sigma_B": "tensile_strength",
    "Y": "yield_strength",
    "C_K": "stress_concentration",
    "T_rated": "nominal_torque",
    "lambda": "",
    "n": "",
    "n_0": "",
}
"""Names that formulas of limits read, and the keys of a shaft that they need."""

OF_RANGES = ("n_c", "lambda", "n_0")
"""Names that formulas of barred ranges read: critical speed, its share of the rated
speed, rated speed, in rpm.
"""

SAME = 1e-9  # difference of lambda that is rounding

_KEYS = (
    *("name", "source", "year", "note", "stress_unit", "length_unit"),
    *("accepted_to", "required_to", "crankshafts", "define", "span", "barred"),
)


@dataclass(frozen=True)
class Span:
    """Formulas of both limits up to a speed ratio; the last span includes it."""

    to: float
    continuous: Formula
    transient: Formula


@dataclass(frozen=True)
class Written:
    """Formulas of a file: ``defined`` ones by name in their order, spans, and units."""

    defined: tuple[tuple[str, Formula], ...]
    spans: tuple[Span, ...]
    stress: float
    length: float

    def limits(self, section: Section, ratio: Array) -> tuple[Array, Array]:
        """Continuous and transient limit ``(...)`` in Pa."""
        from jaxhb._jax import namespace

        xp = namespace(*vars(section).values(), ratio)
        ratio = xp.asarray(ratio, dtype=float)
        begin = 0.0
        continuous = transient = xp.zeros(())
        for span in self.spans:
            # Formulas may have no number beyond their span, as roots.
            inside = (ratio >= begin) & (ratio <= span.to)
            numbers = self._numbers(
                section, xp.where(inside, ratio, (begin + span.to) / 2)
            )
            below = span.continuous.value(numbers)
            passing = span.transient.value(numbers | {"tau_C": below})
            reached = ratio >= begin
            continuous = xp.where(reached, self.stress * below, continuous)
            transient = xp.where(reached, self.stress * passing, transient)
            begin = span.to
        return continuous, transient

    def _numbers(self, section: Section, ratio: Array) -> dict[str, Any]:
        """Numbers that formulas read at speed ratios, in the units of the file."""
        numbers: dict[str, Any] = {
            "d": section.diameter / self.length,
            "b": section.bore / self.length,
            "sigma_B": section.tensile_strength / self.stress,
            "Y": section.yield_strength / self.stress,
            "C_K": section.stress_concentration,
            "T_rated": section.nominal_torque,
            "lambda": ratio,
            "n": ratio * section.rated_rpm,
            "n_0": section.rated_rpm,
        }
        for name, defined in self.defined:
            numbers[name] = defined.value(numbers)
        return numbers


def barred_range(
    low: Formula, high: Formula, critical: Number, rated: Number
) -> tuple[Number, Number]:
    """Lowest and highest speed in rpm of the range around a critical speed."""
    numbers = {"n_c": critical, "lambda": critical / rated, "n_0": rated}
    return low.value(numbers), high.value(numbers)


class Faults(list[str]):
    """Sentences on the faults of a file, each with its place."""

    def __init__(self, file: str) -> None:
        super().__init__()
        self.file = file

    def add(self, sentence: str) -> None:
        """Add a sentence."""
        self.append(f"{self.file}: {sentence}")


@cache
def rule_of(text: str, file: str) -> Rule:
    """Read a rule from the text of a file; :class:`SceneError` with a sentence for each
    fault.
    """
    try:
        content = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        raise SceneError(
            f"{file}: invalid TOML: {cut(str(error))}. Correct the line."
        ) from None
    faults = Faults(file)
    for key in content:
        if key not in _KEYS:
            faults.add(f"unknown key {shown(key)}.{suggestion(key, _KEYS)}")
    name = _text(content, "name", faults)
    source = _text(content, "source", faults)
    note = _text(content, "note", faults, needed=False)
    stress = _unit(content, "stress_unit", STRESS_UNITS, faults)
    length = _unit(content, "length_unit", LENGTH_UNITS, faults)
    defined = _defined(content, faults)
    spans = _spans(content, faults)
    barred = _barred(content, faults)
    highest = spans[-1].to if spans else 1.0
    accepted = _number(content, "accepted_to", highest, faults)
    required = _number(content, "required_to", highest, faults)
    year = content.get("year")
    if not isinstance(year, int | None) or isinstance(year, bool):
        faults.add(f"year is {shown(year)}, must be a whole number. Correct it.")
    crankshafts = content.get("crankshafts", True)
    if not isinstance(crankshafts, bool):
        faults.add(f"crankshafts is {shown(crankshafts)}, must be true or false.")
    if faults:
        raise SceneError(faults)
    of_year = f", {year}" if year else ""
    return Rule(
        name=name,
        source=f"{source}{of_year} ({file})",
        limits=Written(tuple(defined), tuple(spans), stress, length).limits,
        highest=highest,
        required=required,
        passed=accepted,
        corners=tuple(sorted({*(span.to for span in spans[:-1]), accepted, highest})),
        note=(
            "Limits after {source}, lambda = speed / {rated:g} rpm: a file of the user,"
            " who answers for its formulas."
            + f" {note}".rstrip().replace("{", "{{").replace("}", "}}")
        ),
        needs=_needs(defined, spans),
        unread=(),
        crankshafts=crankshafts,
        barred=barred,
        range_source=name,
        year=year,
    )


def _needs(defined: list[tuple[str, Formula]], spans: list[Span]) -> tuple[str, ...]:
    """Keys of a shaft that formulas read, and the tensile strength, by which a shaft is
    known to have limits.
    """
    formulas = [formula for _, formula in defined]
    formulas += [span.continuous for span in spans]
    formulas += [span.transient for span in spans]
    names = {name for formula in formulas for name in formula.names}
    keys = {OF_SHAFTS[name] for name in names if OF_SHAFTS.get(name)}
    return tuple(sorted(keys | {"tensile_strength"}))


def _text(
    content: Mapping[str, Any], key: str, faults: Faults, *, needed: bool = True
) -> str:
    """Read a text."""
    value = content.get(key)
    if value is None and needed:
        faults.add(f"the key {key!r} is missing. Give a text.")
    elif value is not None and (not isinstance(value, str) or not value.strip()):
        faults.add(f"{key} is {shown(value)}, must be a text. Correct it.")
    return value if isinstance(value, str) else ""


def _unit(
    content: Mapping[str, Any], key: str, units: Mapping[str, float], faults: Faults
) -> float:
    """Read a unit of formulas."""
    value = content.get(key)
    if isinstance(value, str) and value in units:
        return units[value]
    allowed = " or ".join(map(repr, units))
    if value is None:
        faults.add(f"the key {key!r} is missing. Give {allowed}.")
    else:
        faults.add(f"{key} is {shown(value)}, must be {allowed}. Correct it.")
    return 1.0


def _number(
    content: Mapping[str, Any], key: str, default: float, faults: Faults
) -> float:
    """Read a share of the rated speed."""
    value = content.get(key, default)
    if (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and (0 < value < math.inf)
    ):
        return float(value)
    faults.add(
        f"{key} is {shown(value)}, must be a number greater than 0, a share of the"
        " rated speed. Correct it."
    )
    return default


def _formula(where: str, text: Any, known: list[str], faults: Faults) -> Formula | None:
    """Read a formula, or a number; None of a faulty one."""
    if isinstance(text, int | float) and not isinstance(text, bool):
        text = repr(text)
    if not isinstance(text, str):
        faults.add(f"{where} is {shown(text)}, must be a formula as text. Correct it.")
        return None
    try:
        return formula(text, known)
    except FormulaError as error:
        faults.add(f"{where}: {error}")
        return None


def _defined(content: Mapping[str, Any], faults: Faults) -> list[tuple[str, Formula]]:
    """Read the formulas that others name, each over those before it."""
    table = content.get("define", {})
    if not isinstance(table, dict):
        faults.add(f"define is {shown(table)}, must be a table. Write [define].")
        return []
    defined = []
    known = list(OF_SHAFTS)
    for name, text in table.items():
        where = f"[define], {name}"
        if name in (*known, "tau_C") or not re.fullmatch(r"[A-Za-z_]\w*", name):
            faults.add(f"{where}: the name is taken, or none. Choose another one.")
            continue
        read = _formula(where, text, known, faults)
        if read is not None:
            defined.append((name, read))
        known.append(name)
    return defined


def _spans(content: Mapping[str, Any], faults: Faults) -> list[Span]:
    """Read the spans of lambda, which begin at 0 and follow each other."""
    rows = content.get("span")
    if not isinstance(rows, list) or not rows:
        faults.add(
            "there is no [[span]]. Give at least one, with lambda = [from, to],"
            " continuous and transient."
        )
        return []
    spans = []
    table = content.get("define", {})
    known = [*OF_SHAFTS, *(table if isinstance(table, dict) else ())]
    end = 0.0
    for place, row in enumerate(rows, 1):
        where = f"[[span]] no. {place}"
        if not isinstance(row, dict):
            faults.add(f"{where} is {shown(row)}, must be a table. Write [[span]].")
            continue
        unknown = [
            key for key in row if key not in ("lambda", "continuous", "transient")
        ]
        for key in unknown:
            choices = ("lambda", "continuous", "transient")
            faults.add(f"{where}: unknown key {shown(key)}.{suggestion(key, choices)}")
        ends = row.get("lambda")
        if not (
            isinstance(ends, list)
            and len(ends) == 2
            and all(isinstance(x, int | float) for x in ends)
            and 0 <= ends[0] < ends[1] < math.inf
        ):
            faults.add(
                f"{where}: lambda is {shown(ends)}, must be [from, to], rising shares"
                " of the rated speed. Correct it."
            )
            continue
        begin, to = map(float, ends)
        if begin > end + SAME:
            faults.add(
                f"{where}: there is no span of lambda from {end:g} to {begin:g}. Give"
                " one, or begin there."
            )
        elif begin < end - SAME:
            faults.add(
                f"{where}: lambda from {begin:g} to {min(to, end):g} is in the span"
                " before, too. Let each span begin where the last one ends."
            )
        end = to
        formulas = []
        for key in ("continuous", "transient"):
            names = known if key == "continuous" else [*known, "tau_C"]
            if key in row:
                formulas.append(_formula(f"{where}, {key}", row[key], names, faults))
            else:
                faults.add(f"{where}: the key {key!r} is missing. Give a formula.")
        match formulas:
            case [Formula() as continuous, Formula() as transient]:
                spans.append(Span(to, continuous, transient))
    return spans


def _barred(
    content: Mapping[str, Any], faults: Faults
) -> Callable[[Number, Number], tuple[Number, Number]] | None:
    """Read the formulas of the barred range around a critical speed, None without."""
    table = content.get("barred")
    if table is None:
        return None
    if not isinstance(table, dict) or set(table) != {"low", "high"}:
        faults.add("[barred] must have the keys low and high, formulas in rpm.")
        return None
    low, high = (
        _formula(f"[barred], {key}", table[key], list(OF_RANGES), faults)
        for key in ("low", "high")
    )
    if low is None or high is None:
        return None
    rated = 1000.0
    for critical in (0.3 * rated, 0.6 * rated, 0.9 * rated):
        ends = [float(end) for end in barred_range(low, high, critical, rated)]
        if not ends[0] <= critical <= ends[1]:
            faults.add(
                f"[barred]: of n_c = {critical:g} rpm with n_0 = {rated:g} rpm low is"
                f" {ends[0]:.4g} and high is {ends[1]:.4g} rpm, must lie below and"
                " above n_c. Correct the formulas."
            )
            return None
    return partial(barred_range, low, high)

"""Numbers with units, as ``"1.976 MN m/rad"``: read into the unit of a key, and units
of answers.

Pint, imported when the first unit is met, has the arithmetic. It is given the units of
drive trains alone, so that ``PS`` is no petasiemens and ``mil`` no angle. Angles are a
dimension of their own: a frequency is one of revolutions, a stiffness N m/rad.
"""

from __future__ import annotations

import dataclasses
import difflib
import importlib.util
import math
import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, TypeGuard

from jaxhb.elements.declared import fields_of_class, unit_of
from jaxhb.elements.sentences import shown, suggestion

if TYPE_CHECKING:
    import pint

_DEFINITIONS = """
nano- = 1e-9 = n-
micro- = 1e-6 = µ- = μ- = u-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
deci- = 1e-1 = d-
deca- = 1e1 = da-
hecto- = 1e2 = h-
kilo- = 1e3 = k-
mega- = 1e6 = M-
giga- = 1e9 = G-
meter = [length] = m = metre
second = [time] = s = sec
gram = [mass] = g
radian = [angle] = rad
kelvin = [temperature] = K
percent = 0.01
permille = 0.001
minute = 60 * second = min
degree = 0.017453292519943295 * radian = deg
gon = 0.9 * degree = gon = grad
revolution = 360 * degree = rev = turn
hertz = revolution / second = Hz
revolutions_per_minute = revolution / minute = rpm = RPM
newton = kilogram * meter / second ** 2 = N
pascal = newton / meter ** 2 = Pa
joule = newton * meter = J
watt = joule / second = W
tonne = 1000 * kilogram = t
kilogram_force = 9.80665 * newton = kgf = kp
tonne_force = 9806.65 * newton = tf
bar = 1e5 * pascal = bar
atmosphere = 101325 * pascal = atm
technical_atmosphere = 98066.5 * pascal = at
metric_horsepower = 75 * kilogram_force * meter / second = PS
inch = 0.0254 * meter = in
foot = 0.3048 * meter = ft
thousandth = 0.001 * inch = mil = thou
pound = 0.45359237 * kilogram = lb = lbm
ounce = pound / 16 = oz
slug = pound_force * second ** 2 / foot
pound_force = 4.4482216152605 * newton = lbf
ounce_force = pound_force / 16 = ozf
kip = 1000 * pound_force
psi = pound_force / inch ** 2
ksi = 1000 * psi
horsepower = 550 * pound_force * foot / second = hp
degree_Celsius = kelvin; offset: 273.15 = degC
"""

TEMPERATURE = "deg C"
_ZEROS = {"c": (1.0, 0.0), "k": (1.0, 273.15), "f": (5.0 / 9.0, 32.0)}
"""Size in deg C of a degree of each scale of temperature, and its mark at 0 deg C."""

OFTEN = {
    "kg m2": ("kg cm2", "kg mm2", "g cm2", "t m2", "kgf m s2", "lb in2", "lbf in s2"),
    "m": ("mm", "cm", "µm", "in", "mil"),
    "deg": ("rad", "mrad", "rev"),
    "N m": ("kN m", "MN m", "N mm", "kgf m", "lbf ft", "lbf in"),
    "N m/rad": ("kN m/rad", "MN m/rad", "N m/deg", "kgf m/rad", "lbf in/rad"),
    "N m s/rad": ("kN m s/rad", "MN m s/rad", "N m s/deg", "N m/rpm", "kgf m s/rad"),
    "N/m": ("N/mm", "kN/mm", "N/µm", "MN/m", "lbf/in"),
    "N s/m": ("N s/mm", "kN s/m", "lbf s/in"),
    "Pa": ("MPa", "GPa", "N/mm2", "bar", "mbar", "kPa", "psi", "ksi", "kgf/cm2"),
    "W": ("kW", "MW", "PS", "hp"),
    "J": ("kJ", "MJ", "N m"),
    "kg": ("g", "t", "lb"),
    "s": ("ms", "min"),
    "Hz": ("rpm", "1/min", "rad/s", "kHz"),
    "rpm": ("1/min", "Hz", "rad/s"),
    "rad/s": ("rpm", "1/min", "Hz", "deg/s"),
    "rad": ("deg", "mrad"),
    "N": ("kN", "MN", "kgf", "lbf"),
    "rad/s2": ("deg/s2",),
    "m/s": ("mm/s", "in/s"),
    TEMPERATURE: ("°C", "K", "deg F"),
    "m2": ("cm2", "mm2", "in2"),
    "W/(m2 K)": ("kW/(m2 K)",),
}
"""Units in which numbers of an SI unit, or rpm and deg, are often written."""

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_QUANTITY = re.compile(rf"\s*({_NUMBER})\s*(\S.*?)\s*")
_SIGNS = str.maketrans(
    {"²": "^2", "³": "^3", "⁴": "^4", "¹": "^1", "⁻": "^-", "·": "*", "⋅": "*"}
    | {"∙": "*", "•": "*", "×": "*", "−": "-", "%": " percent ", "‰": " permille "}
    | {"°": " deg "}
)
_LETTERS = "A-Za-zµμ"
_JOINED = re.compile(
    rf"(?<![{_LETTERS}])([kMGm]?N|kgf|kp|tf|lbf|kg|t|g|lb|ozf|oz)"
    rf"(mm|cm|m|ft|in)((?:\^|\*\*)?[234])?(s(?:\^|\*\*)?2?)?(?![{_LETTERS}])"
)
"""Units without a blank or a dot between them, as kNm, kgcm2, Nms."""
_POWER = re.compile(rf"(?<=[{_LETTERS}])\s*(?:\^|\*\*)?\s*(-?\d+)(?!\d|\.)")


class UnitError(ValueError):
    """A unit cannot be taken: the end of a sentence, as ``must be in N m``, and what to
    do.
    """


class Refused(str):
    """A text that stands where a number should, with the rest of the sentence ``why``
    it is none.
    """

    why: str

    def __new__(cls, text: str, why: str) -> Refused:
        refused = super().__new__(cls, text)
        refused.why = why
        return refused


def has_unit(value: Any) -> TypeGuard[str]:
    """Tell whether a value is a text of a number and a unit.

    >>> has_unit("85 kW"), has_unit("85"), has_unit("pressure.csv"), has_unit(85)
    (True, False, False, False)
    """
    return isinstance(value, str) and split(value)[1] != ""


def split(text: str) -> tuple[str, str]:
    """Number and unit of a text, both as written; no unit where it is none of both.

    >>> split("1500 1/min"), split("85kW"), split("1e3"), split("soft")
    (('1500', '1/min'), ('85', 'kW'), ('1e3', ''), ('soft', ''))
    """
    match = None if _is_number(text) else _QUANTITY.fullmatch(text)
    return (match[1], match[2]) if match else (text.strip(), "")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def in_unit(text: str, unit: str, *, weight: bool = False) -> float:
    """Read a number with a unit into another ``unit``, "" for a share.

    weight : whether kgf stands for kg, and 9.80665 N with it, as makers write the
    flywheel effect GD2. Raises :class:`UnitError` where the text is no number of that
    unit.

    >>> in_unit("350 kg cm2", "kg m2"), in_unit("20 Hz", "rpm"), in_unit("5 %", "")
    (0.035, 1200.0, 0.05)
    """
    number, written = split(text)
    if re.match(r",\s*\d", written):
        raise UnitError("must have a point before its decimals, and not a comma.")
    if re.match(r"[\d.']", written) and not re.match(r"1\s*/", written):
        raise UnitError(
            "must be one number and a unit. Write thousands without a mark."
        )
    if unit == TEMPERATURE:
        return _temperature(number, written)
    by_weight = unit.replace("kg", "kgf")
    if weight and written != unit and _fits(written, by_weight):
        unit = by_weight
    scale = factor(written, unit)
    # A quotient of whole numbers is rounded once: 0.2 mm is 0.0002 m.
    parts = round(1 / scale) or 1
    return float(number) / parts if 1 / parts == scale else float(number) * scale


def _temperature(number: str, written: str) -> float:
    """A temperature in deg C; :class:`UnitError` in a unit that is none."""
    for letter, (size, zero) in _ZEROS.items():
        if _form(written) in (letter, f"deg{letter}"):
            return (float(number) - zero) * size
    raise UnitError(f"must be in {TEMPERATURE}, K or deg F.")


def factor(written: str, unit: str) -> float:
    """Size of a ``written`` unit in another ``unit``; :class:`UnitError` where it has
    none.

    >>> factor("kN m", "N m"), factor("mm", "m"), factor("1/min", "rpm")
    (1000.0, 0.001, 1.0)
    """
    if unit == TEMPERATURE:
        # Other scales have another zero.
        if _form(written) not in ("c", "degc"):
            raise UnitError(f"must be in {TEMPERATURE}.")
        return 1.0
    return 1.0 if written == unit else _factor(written, unit)


@cache
def _factor(written: str, unit: str) -> float:
    if importlib.util.find_spec("pint") is None:
        raise UnitError(
            f"must be a number{f' in {unit}' if unit else ''} where pint is not"
            ' installed. Install it: pip install "jaxhb[units]".'
        )
    try:
        scale = _scale(_parsed(written), unit)
        is_read = True
    except ValueError as error:
        if isinstance(error, UnitError):
            raise
        scale = None
        is_read = False
    if scale is None:
        needs = f"in {unit} or a unit like it" if unit else "a number without unit"
        raise UnitError(
            f"{'' if is_read else 'whose unit is not known, '}must be"
            f" {needs}.{_suggestion(written, unit)}"
        )
    return scale


def _scale(written: pint.Unit, unit: str) -> float | None:
    """Size of a unit in another, None where they are of different kinds.

    An angle may be left out: that of a revolution in a speed, as 1/min, and a radian
    below a torque, as in N m for N m/rad.
    """
    registry = _registry()
    if not unit:
        shares = {registry.percent: 0.01, registry.permille: 0.001}
        return shares.get(written)
    to = _parsed(unit)
    if unit in ("rpm", "rad/s") and written == 1 / registry.second:
        raise UnitError("may be rad/s or revolutions a second. Write rad/s, Hz or rpm.")
    dimensions = dict(written.dimensionality)
    like = [written]
    if dimensions == {"[time]": -1}:
        like.append(written * registry.revolution)
    elif "[angle]" not in dimensions:
        like.append(written / registry.radian)
    for candidate in like:
        if candidate.dimensionality == to.dimensionality:
            return float(registry.convert(1.0, candidate, to))
    return None


@cache
def _registry() -> Any:
    """Make the registry of the units of drive trains."""
    import pint

    registry: Any = pint.UnitRegistry(None)
    registry.load_definitions(_DEFINITIONS.strip().splitlines())
    return registry


def _form(unit: str) -> str:
    """Letters and digits of a unit, by which it is compared with others."""
    return re.sub(r"[\s*^.]+", "", unit.translate(_SIGNS)).casefold()


@cache
def _parsed(written: str) -> pint.Unit:
    """Read a unit; ValueError where it is none, or may mean two."""
    text = _JOINED.sub(_parted, written.translate(_SIGNS).replace("^-^", "^-"))
    text = re.sub(rf"(?<=[{_LETTERS}\d)])\s*[.-]\s*(?=[{_LETTERS}(])", "*", text)
    text = _POWER.sub(r"**\1", text)
    text = re.sub(rf"(?<=[\w)])\s+(?=[{_LETTERS}(])", "*", text.strip())
    text = re.sub(r"\s+", "", text)
    letters = re.sub(r"\*\*-?\d+", "", text.removeprefix("1/"))
    below = re.search(r"/[^/()]*\*", re.sub(r"\([^()]*\)", "", letters))
    # Of N m/rad s it is not clear whether s stands above or below.
    if re.search(r"\d", letters) or not re.search(f"[{_LETTERS}]", letters) or below:
        raise ValueError(written)
    try:
        return _registry().parse_units(text)
    except Exception:  # pint raises what its parser and Python's raise
        raise ValueError(written) from None


def _parted(match: re.Match[str]) -> str:
    """Joined units, with a star between them."""
    first, length, power, seconds = match.groups()
    return "*".join(filter(None, (first, length + (power or ""), seconds)))


def is_unit(written: str) -> bool:
    """Whether a text is a unit, of any kind; without pint, one of :data:`OFTEN`."""
    if any(written in (unit, *others) for unit, others in OFTEN.items()):
        return True
    if importlib.util.find_spec("pint") is None:
        return False
    try:
        _parsed(written)
    except ValueError:
        return False
    return True


def _suggestion(written: str, unit: str) -> str:
    """Say which unit was probably meant."""
    if not unit:
        return " Write the number alone."
    if unit == "kg m2" and _fits(written, "N m2"):
        return " The flywheel effect GD2 in kgf m2 is the key gd2."
    for mass in ("kg", "lb", "t"):
        weight = re.sub(rf"\b{mass}\b", f"{mass}f", written)
        if weight != written and _fits(weight, unit):
            return f" Did you mean {shown(weight)}?"
    choices = (unit, *OFTEN.get(unit, ()))
    by_form = {_form(choice): choice for choice in reversed(choices)}
    near = difflib.get_close_matches(_form(written), by_form, 1)
    if near:
        return f" Did you mean {shown(by_form[near[0]])}?"
    return f" Known: {', '.join(choices)}."


def _fits(written: str, unit: str) -> bool:
    """Whether a written unit is of the kind of another."""
    try:
        return _scale(_parsed(written), unit) is not None
    except ValueError:
        return False


Shown = tuple[float, str]
"""Factor from an SI unit, and the unit that it leads to."""

OF_ANSWERS = {
    "torque": "N m",
    "force": "N",
    "angle": "rad",
    "speed": "rad/s",
    "acceleration": "rad/s2",
    "stress": "Pa",
    "power": "W",
    "inertia": "kg m2",
}
"""SI units of quantities of answers whose unit can be chosen."""


def chosen_units(units: Mapping[str, Any]) -> dict[str, Shown]:
    """Read units of quantities of answers, by their SI units; :class:`UnitError` with a
    sentence on the first that cannot be taken.

    >>> chosen_units({"torque": "kN m"})
    {'N m': (0.001, 'kN m')}
    """
    chosen = {}
    for quantity, unit in units.items():
        si_unit = OF_ANSWERS.get(quantity)
        if si_unit is None:
            near = suggestion(quantity, OF_ANSWERS)
            raise UnitError(f"there is no quantity {shown(quantity)}.{near}")
        if not isinstance(unit, str):
            raise UnitError(f"{quantity} is {shown(unit)}, must be a unit in quotes.")
        try:
            size = factor(unit.strip(), si_unit)
        except UnitError as error:
            raise UnitError(f"{quantity} is {shown(unit)}, {error}") from None
        chosen[si_unit] = (1.0 / size, " ".join(unit.split()))
    return chosen


UNITS_OF_COLUMNS = {
    "rpm": "rpm",
    "hz": "Hz",
    "Hz": "Hz",
    "angle": "deg",
    "phase": "deg",
    "twist": "deg",
    "amplitude": "rad",
    "pressure": "Pa",
    "imep": "Pa",
    "stress": "Pa",
    "torque": "N m",
    "mean torque": "N m",
    "temperature": TEMPERATURE,
    "seconds": "s",
    "decay": "s",
}
"""Units of columns of rows, by their heads; "stiffness" and "damping" have the unit of
the key of this name, columns in the unit of their rows this, and others none.
"""
IN_UNIT_OF_ROWS = ("Re", "Im", "cosine", "sine", "amplitude")


def units_of_columns(cls: type, field: dataclasses.Field) -> tuple[str, ...]:
    """Units of the columns of rows, or of the numbers of a list, of a class of
    elements.
    """
    units = {key: unit_of(other) for key, other in fields_of_class(cls).items()}
    unit = field.metadata.get("unit")
    special = dict.fromkeys(IN_UNIT_OF_ROWS, unit) if unit else {}
    special |= {key: units[key] for key in ("stiffness", "damping") if key in units}
    return tuple(
        special.get(column, UNITS_OF_COLUMNS.get(column, ""))
        for column in field.metadata["columns"]
    )


def si_value(cls: type, field: dataclasses.Field, value: Any) -> Any:
    """A value of a key of a class of elements, with every text of a number and a unit
    in the unit of the key.

    Texts that are no such number are left to the checks, as :class:`Refused` where
    they have a unit.
    """
    kind = field.metadata["kind"]
    listed = isinstance(value, list | tuple)
    if kind == "rows" and listed:
        units = units_of_columns(cls, field)
        return [_si_row(units, row) for row in value]
    if kind == "numbers":
        return _si_row(units_of_columns(cls, field), value)
    unit = field.metadata.get("unit", unit_of(field))
    if kind not in ("number", "count", "shorthand") and not unit:
        return value

    def read(value: Any) -> Any:
        weight = bool(field.metadata.get("weight"))
        return si_number(value, unit, weight=weight, counts=kind == "count")

    # Engines have lists with a number for each cylinder.
    return [read(each) for each in value] if listed else read(value)


def _si_row(units: Sequence[str], row: Any) -> Any:
    """A row of numbers with texts in the units of its columns; others unchanged."""
    if not isinstance(row, list | tuple) or len(row) != len(units):
        return row
    if not any(isinstance(cell, str) for cell in row):
        return row
    return [si_number(cell, unit) for cell, unit in zip(row, units, strict=True)]


def si_number(
    value: Any, unit: str, *, weight: bool = False, counts: bool = False
) -> Any:
    """Read a text of a number and a unit; other values stay as they are.

    A text with a unit that does not fit becomes :class:`Refused`; ``counts`` : whether
    it is a whole number, which has no unit, not even %.
    """
    if not has_unit(value) or isinstance(value, Refused):
        return value
    try:
        if counts:
            raise UnitError("must be a number without unit. Write the number alone.")
        number = in_unit(value, unit, weight=weight)
    except UnitError as error:
        return Refused(value, str(error))
    return number if math.isfinite(number) else Refused(value, "must be finite.")

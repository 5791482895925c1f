"""Values of a scene in single cells: numbers, texts, and several of them with
semicolons between.

What such a text cannot say stands in the notation of JSON, as ``[[1.0, 5.0, 0.0]]``.
"""

import json
import re
from typing import Any

from jaxhb.elements.sentences import shown
from jaxhb.elements.units import has_unit
from jaxhb.scene.csv_tables import THOUSANDS
from jaxhb.scene.workbook.columns import NUMBERS, Column

_TEXTS = ("name", "disk", "pair", "cylinder", "text", "choice", "rows", "tables")
_QUANTITY = re.compile(
    r"([+-]?[\d.,]*\d[\d.,]*(?:[eE][+-]?\d+)?)(\s*[A-Za-zµμ°%‰].*|\s+1\s*/.*)?"
)
"""A number, and perhaps a unit."""

_CURE = "Write decimals with a point, and thousands without a mark."
_FLAGS = {"true": True, "yes": True, "false": False, "no": False}


class CellError(ValueError):
    """A cell cannot be read: a sentence without the name of the cell."""


def value_of(cell: Any, column: Column, units: tuple[str, ...] = ()) -> Any:
    """Read a cell, a truth value, number or text; ``units`` are those that the head of
    its column names instead of its own. :class:`CellError` where a comma is not clear.

    Texts that are no such value stay as they are, for the checks of a scene.
    """
    if isinstance(cell, str):
        literal = _literal(cell)
        if literal is not None:
            return _with_units(literal, units)
    if column.kind in _TEXTS:
        return _text(cell)
    if column.kind == "list" and not column.unit:
        return _parts(cell) if isinstance(cell, str) else [_text(cell)]
    if column.kind == "flag":
        return _listed(cell, lambda part, _: _flag(part))
    if column.kind in NUMBERS:
        several = column.kind == "numbers"
        return _listed(
            cell, lambda part, k: _number(part, units[k : k + 1] or units[:1]), several
        )
    if column.kind == "list":
        return _listed(cell, lambda part, _: _number(part, units[:1]), True)
    return _with_units(_anything(cell), units)


def cell_of(value: Any, column: Column) -> Any:
    """Write a value so that :func:`value_of` reads the same: as people do, or else in
    the notation of JSON.
    """
    plain = value
    if isinstance(value, list | tuple):
        scalars = all(isinstance(part, str | int | float) for part in value)
        plain = "; ".join(map(_written, value)) if scalars and value else None
    try:
        if _is_kept(plain) and _same(value_of(plain, column), value):
            return plain
    except CellError:
        pass
    return json.dumps(value, ensure_ascii=False, default=str)


def number_text(cell: str) -> Any:
    """Number of a text, with its unit if it has one, or the text where it is none.

    >>> number_text("0,035"), number_text("350 kg cm2"), number_text("soft")
    (0.035, '350 kg cm2', 'soft')
    """
    match = _QUANTITY.fullmatch(cell)
    if not match:
        return cell
    digits = match[1]
    unit = (match[2] or "").strip()
    if unit and "," not in digits:
        return cell
    if "," in digits:
        if "." in digits or digits.count(",") > 1:
            raise CellError(f"{shown(cell)} has several marks. {_CURE}")
        if THOUSANDS.fullmatch(digits):
            raise CellError(
                f"{shown(cell)} may have decimals or thousands behind its comma."
                f" {_CURE}"
            )
        digits = digits.replace(",", ".")
    if unit:
        return f"{digits} {unit}"
    try:
        return int(digits) if re.fullmatch(r"[+-]?\d+", digits) else float(digits)
    except ValueError:
        return cell


def _number(cell: Any, units: tuple[str, ...]) -> Any:
    """Number of a cell, with the unit of its head unless it has its own."""
    value = number_text(cell) if isinstance(cell, str) else cell
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    if units and units[0]:
        return f"{value!r} {units[0]}"
    return value


def _with_units(value: Any, units: tuple[str, ...]) -> Any:
    """Numbers of a value, of a list one after another, with the units of a head."""
    if isinstance(value, list):
        return [
            _with_units(part, units[k : k + 1] or units[:1])
            for k, part in enumerate(value)
        ]
    return value if isinstance(value, str) else _number(value, units)


def _listed(cell: Any, read: Any, always: bool = False) -> Any:
    """One value, or a list where semicolons separate several."""
    if isinstance(cell, str) and ";" in cell:
        return [read(part, k) for k, part in enumerate(_parts(cell))]
    return [read(cell, 0)] if always else read(cell, 0)


def _parts(cell: str) -> list[str]:
    parts = [part.strip() for part in cell.split(";")]
    return parts[:-1] if not parts[-1] else parts


def _flag(cell: Any) -> Any:
    return _FLAGS.get(cell.casefold(), cell) if isinstance(cell, str) else cell


def _anything(cell: Any) -> Any:
    """Number where a text is one by itself, a list where all its parts are numbers."""
    if not isinstance(cell, str):
        return cell
    parts = _parts(cell) if ";" in cell else [cell]
    numbers = []
    for part in parts:
        try:
            number = number_text(part)
        except CellError:
            return cell
        if isinstance(number, str) and not has_unit(number):
            return cell
        numbers.append(number)
    return numbers if ";" in cell else numbers[0]


def _literal(cell: str) -> Any:
    """Value of a text in the notation of JSON, None where it is none."""
    if not cell.startswith(("[", "{", '"')):
        return None
    try:
        return json.loads(cell)
    except (ValueError, RecursionError):
        return None


def _text(cell: Any) -> Any:
    """Text of a cell, of a number as it is shown."""
    if isinstance(cell, float) and cell.is_integer() and abs(cell) < 1e15:
        return str(int(cell))
    return cell if isinstance(cell, str) else str(cell)


def _is_kept(plain: Any) -> bool:
    """Whether a cell comes back as it was written, with blanks at its ends."""
    if not isinstance(plain, str):
        return isinstance(plain, bool | int | float)
    return plain.strip() == plain != "" and not re.search(
        r"[\x00-\x09\x0b-\x1f\u00a0\u202f]|^#", plain
    )


def _written(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _same(value: Any, other: Any) -> bool:
    """Whether values are equal with their types."""
    return json.dumps(value, default=str) == json.dumps(other, default=str)

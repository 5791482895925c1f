"""Checks of the values of a field: kind, range, rows of tables."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any, TypeGuard

import numpy as np

from jaxhb._jax import traced
from jaxhb.elements.declared import LARGEST, SMALLEST, Unread, fields_of
from jaxhb.elements.sentences import MOST_SENTENCES, nearest, shown
from jaxhb.elements.units import Refused
from jaxhb.excitation import gas


def number_like(value: Any) -> TypeGuard[float]:
    """Tell whether a value is a number and no truth value."""
    if isinstance(value, bool):
        return False
    try:
        float(value)
    except (TypeError, ValueError, OverflowError):
        return False
    return not isinstance(value, str)


def field_errors(where: str, field: dataclasses.Field, value: Any) -> list[str] | None:
    """Sentences on one field; None where it is sound, an empty list where its sentences
    exist already.
    """
    if isinstance(value, Unread):
        return []
    if value is None:
        return [_missing(where, field)] if field.default is not None else None
    if field.metadata["kind"] in ("table", "tables"):
        return _table_errors(where, field, value)
    return [f"{where}: {text}" for text in _value_errors(field, value)] or None


def _table_errors(where: str, field: dataclasses.Field, value: Any) -> list[str] | None:
    """Sentences on a table inside an element, or on a list of them; None where all is
    sound.
    """
    cls = field.metadata["of"]
    several = field.metadata["kind"] == "tables"
    rows = value if several else [value]
    if not is_list(rows) or not rows or not all(isinstance(row, cls) for row in rows):
        expected = (
            f"one table or more. Write [[….{field.name}]]"
            if several
            else f"a table. Write [….{field.name}]"
        )
        return [f"{where}: {field.name} is {shown(value)}, must be {expected}."]
    by_field = [
        field_errors(
            f"{where}, {field.name}{f' no. {k + 1}' if several else ''}",
            inner_field,
            getattr(row, inner_field.name),
        )
        for k, row in enumerate(rows)
        for inner_field in fields_of(row)
    ]
    if all(sentences is None for sentences in by_field):
        return None
    return [text for sentences in by_field for text in sentences or ()]


COLDEST = -273.15  # deg C
# Distance from a whole number, in harmonics of the cycle, up to which an order fits
WHOLE = 1e-6
LONGEST_NAME = 100  # characters: tables and pictures show names
_NAME = f"a text of at most {LONGEST_NAME} characters"

_KINDS: dict[str, tuple[Callable[[Any], Any], str, str]] = {
    "name": (
        lambda value: isinstance(value, str) and 0 < len(value) <= LONGEST_NAME,
        _NAME,
        "a text, unique over all tables",
    ),
    "disk": (
        lambda value: isinstance(value, str) and value,
        "a text",
        "the name of a disk",
    ),
    "pair": (
        lambda value: is_list(value) and [type(end) for end in value] == [str, str],
        "the names of two disks",
        "the names of two disks",
    ),
    "cylinder": (
        lambda value: isinstance(value, str) and value,
        "a text",
        "the name of a cylinder",
    ),
    "text": (
        lambda value: isinstance(value, str) and 0 < len(value) <= LONGEST_NAME,
        _NAME,
        "a text",
    ),
    "flag": (lambda value: isinstance(value, bool), "true or false", "a value"),
    "list": (lambda value: is_list(value), "a list", "a list"),
}
"""A test of the values of each kind of field, and the words for a value that fails it
and for a missing one.
"""


def is_list(value: Any) -> TypeGuard[Sequence[Any]]:
    return isinstance(value, tuple | list)


def is_present(value: Any) -> bool:
    """Tell whether a key is given, with rows if it takes rows."""
    return value is not None and not (is_list(value) and not value)


def _missing(where: str, field: dataclasses.Field) -> str:
    """Sentence for a key that is not there."""
    limits = field.metadata.get("range")
    kind = field.metadata["kind"]
    expected = "a value"
    if limits:
        expected = limits.words()
    elif kind == "rows":
        columns = ", ".join(field.metadata["columns"])
        expected = f"rows of {columns}, or the name of a CSV file"
    elif kind in _KINDS:
        expected = _KINDS[kind][2]
    return f"{where}: the key {field.name!r} is missing. Give {expected}."


def _value_errors(field: dataclasses.Field, value: Any) -> list[str]:
    """Check one value against the kind and the range of its field."""
    kind = field.metadata["kind"]
    if kind in ("number", "count", "shorthand"):
        return value_errors(field, value)
    if kind == "rows":
        return row_errors(field.name, field.metadata["columns"], value)
    if kind == "numbers":
        return numbers_errors(field.name, field.metadata["columns"], value)
    if kind == "choice":
        words = [word for word in field.metadata["words"] if word]
        if value in field.metadata["words"]:
            return []
        expected = joined(map(repr, words), "or")
        near = nearest(value, words)
    else:
        test, expected, _ = _KINDS[kind]
        if test(value):
            return []
        near = ""
    return [f"{field.name} is {shown(value)}, must be {expected}.{near}"]


def value_errors(field: dataclasses.Field, value: Any) -> list[str]:
    """Check a number against the range in its field's metadata; sentences without the
    element.
    """
    limits = field.metadata["range"]
    remedy = ""
    unit = f" {limits.unit}" if limits.unit else ""
    number = float(value) if number_like(value) else math.nan
    if isinstance(value, Refused):
        return [f"{field.name} is {shown(value)}, {value.why}"]
    if not number_like(value) and traced(value):
        remedy_outside = (
            "build the train outside, and change it there by train.replace, whose"
            " numbers may be traced"
        )
        return [
            f"{field.name} is traced by jit, vmap or grad, must be a number:"
            f" {remedy_outside}."
        ]
    if not number_like(value) and (
        isinstance(value, bool) or not isinstance(value, int)
    ):
        actual = shown(value)
        expected = f"a number{f' in {limits.unit}' if limits.unit else ''}"
    elif not math.isfinite(number):
        actual = f"{number if number_like(value) else shown(value)}{unit}"
        expected = "a finite number"
    elif abs(number) > LARGEST:
        actual = f"{number:g}{unit}"
        expected = f"at most {LARGEST:g} in size"
    elif 0.0 < abs(number) < SMALLEST:
        actual = f"{number:g}{unit}"
        expected = f"0 or at least {SMALLEST:g} in size"
    elif field.metadata["kind"] == "count" and number != int(number):
        actual = f"{number:g}"
        expected = "a whole number"
    elif limits.excludes(number):
        absent = "" if field.default is dataclasses.MISSING else " or leave the key out"
        actual = f"{number:g}{unit}"
        expected = limits.words()
        remedy = f" {limits.remedy or f'Correct the value{absent}.'}"
    else:
        return []
    return [f"{field.name} is {actual}, must be {expected}.{remedy}"]


def numbers_errors(name: str, columns: Sequence[str], value: Any) -> list[str]:
    """Check a list of numbers that is no table."""
    if not row_errors(name, columns, [value]):
        return []
    refused = _refused_cells(columns, value)
    if refused:
        return [f"{name}: {text}" for text in refused]
    header = ", ".join(columns)
    text = f"{name} is {shown(value)}, must be {len(columns)} numbers [{header}]"
    return [f"{text}, at most {LARGEST:g} in size."]


def _refused_cells(columns: Sequence[str], row: Any) -> list[str]:
    """Sentences on the numbers of a row whose units do not fit."""
    return [
        f"{column} is {shown(cell)}, {cell.why}"
        for column, cell in zip(columns, row if is_list(row) else (), strict=False)
        if isinstance(cell, Refused)
    ]


def row_errors(name: str, columns: Sequence[str], rows: Any) -> list[str]:
    """Check a table of numbers: its columns, finiteness, and the growth of its first
    column.
    """
    header = ", ".join(columns)
    if not is_list(rows):
        return [f"{name} is {shown(rows)}, must be a list of rows [{header}]."]
    for i, row in enumerate(rows):
        refused = _refused_cells(columns, row)
        if refused:
            return [f"{name}, row {i + 1}: {text}" for text in refused]
        if not (
            is_list(row)
            and len(row) == len(columns)
            and all(number_like(number) for number in row)
        ):
            return [
                f"{name}, row {i + 1} is {shown(row)}, must be {len(columns)} numbers"
                f" [{header}]."
            ]
        if not all(abs(float(number)) <= LARGEST for number in row):
            return [
                f"{name}, row {i + 1} is {shown(list(row))}, must be finite numbers, at"
                f" most {LARGEST:g} in size."
            ]
    first = [float(row[0]) for row in rows]
    # Terms of a sum, in any order, and tables over two quantities
    if columns[0] == "torque" or columns[:2] == ("order", "imep"):
        return []
    if columns[0] in ("order", "Hz"):
        order, unit = ("order", "") if columns[0] == "order" else ("frequency", " Hz")
        not_positive = [i for i, number in enumerate(first) if number <= 0.0]
        repeated = [
            (number, times) for number, times in Counter(first).items() if times > 1
        ]
        errors = [
            f"{name}, row {i + 1}: {order} is {first[i]:g}{unit}, must be greater than"
            " 0. Give the mean by its own key."
            for i in not_positive[:MOST_SENTENCES]
        ]
        errors += [
            f"{name}: {order} {number:g}{unit} stands {times} times. Add the rows."
            for number, times in repeated[:MOST_SENTENCES]
        ]
        left_out = max(len(not_positive) - MOST_SENTENCES, 0) + max(
            len(repeated) - MOST_SENTENCES, 0
        )
        return (
            [*errors, f"{name}: {left_out} more rows are so."] if left_out else errors
        )
    for i, (previous, current) in enumerate(pairwise(first), start=2):
        if current <= previous:
            remedy = (
                "Leave out one of the two rows"
                if current == previous
                else "Sort the rows"
            )
            return [
                f"{name}, row {i}: {columns[0]} {current:g} after {previous:g}; must"
                f" increase. {remedy}."
            ]
    if columns[0] in ("hz", "amplitude", "temperature"):
        # 5e-324 is the least number above 0.
        allowed = {
            "temperature": (f"at least {COLDEST:g}", COLDEST),
            "factor of stiffness": ("greater than 0", 5e-324),
        }
        if columns[0] == "temperature":  # a change divides by what was before
            allowed["factor of damping"] = allowed["factor of stiffness"]
        rules = [
            (column, *allowed.get(head, ("at least 0", 0.0)))
            for column, head in enumerate(columns)
        ]
        outside = (
            f"{name}, row {i + 1}: {columns[column]} is {row[column]:g}, must be"
            f" {words}. Correct the row."
            for i, row in enumerate(rows)
            for column, words, least in rules
            if not row[column] >= least
        )
        return list(itertools.islice(outside, MOST_SENTENCES))
    if columns[0] == "rpm" and first and first[0] < 0.0:
        return [
            f"{name}, row 1: rpm is {first[0]:g}, must be at least 0. Speeds are"
            " positive; correct the row."
        ]
    return _span_errors(name, first, rows) if columns[0] == "angle" else []


def _span_errors(name: str, angle: Sequence[float], rows: Any) -> list[str]:
    """Check that a pressure table covers one gas cycle but for one step at most."""
    if len(angle) < 2:
        return [f"{name} has {len(angle)} rows, needs at least 2."]
    span = angle[-1] - angle[0]
    if span > 720.0 + 1e-9:
        return [
            f"{name} spans {span:g} deg, must span at most 720 deg. Give one gas cycle."
        ]
    period = 720.0 if gas.is_four_stroke(rows) else 360.0
    steps = np.diff(angle)
    # The end of a table may be left out: as much as a step of it, up to an eighth of
    # the cycle.
    step = min(max(float(np.median(steps)), steps[0], steps[-1]), period / 8.0)
    if span >= period - step - 1e-6:
        return []
    return [
        f"{name} covers {angle[0]:g} to {angle[-1]:g} deg, must cover a whole gas cycle"
        f" of {period:g} deg but for one step ({step:g} deg). Add the missing angles;"
        " four-stroke tables span 720 deg, two-stroke tables 360 deg within -360 to"
        " 360 deg."
    ]


def plain_number(value: Any) -> TypeGuard[float]:
    """Tell whether a value is a number that can be printed: no text, no truth value and
    not infinite.
    """
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) < 1e300
    )


def joined(texts: Iterable[str], last: str = "and") -> str:
    """Join texts by commas and a ``last`` word."""
    words = list(texts)
    if len(words) > 1:
        return f"{', '.join(words[:-1])} {last} {words[-1]}"
    return "".join(words)


def several_given(names: Sequence[str]) -> list[str]:
    """Say that keys are given of which one is enough; nothing of fewer than two."""
    if len(names) < 2:
        return []
    count = "both" if len(names) == 2 else "all"
    return [f"{joined(names)} are {count} given. Keep one of them."]


def exactly_one(element: Any, *names: str) -> list[str]:
    """Check that an element has one of two keys."""
    present = [name for name in names if is_present(getattr(element, name))]
    if present:
        return several_given(present)
    return [f"neither {' nor '.join(names)} is given. Give one of them."]


def sound_orders(rows: Any) -> list[float]:
    """Orders of the sound rows of a table of harmonics."""
    if not isinstance(rows, tuple | list):
        return []
    firsts = [row[0] for row in rows if isinstance(row, tuple | list) and row]
    orders = [float(first) for first in firsts if number_like(first)]
    return [order for order in orders if math.isfinite(order) and order > 0.0]


def whole(number: float) -> bool:
    """Tell whether a number is whole to 1e-6."""
    return math.isfinite(number) and abs(number - round(number)) <= WHOLE


def rounded(number: float) -> float:
    """Round a number that is whole to 1e-6: ratios of radii round."""
    return float(round(number)) if whole(number) else number

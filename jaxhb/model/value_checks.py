"""Checks of the fields of an element: single values, tables of numbers, tables inside tables."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter

import numpy as np

from jaxhb.model import gas
from jaxhb.model.elements import Unread, suggestion


def shown(value) -> str:
    """Write a value into a sentence, in short."""
    # Beyond float64; and repr refuses more than 4300 digits.
    if isinstance(value, int) and value.bit_length() > 1023:
        return f"an integer of about {int(value.bit_length() * math.log10(2.0)) + 1} digits"
    try:
        text = repr(value)
    except ValueError:
        return "a value too long to be written"
    return text if len(text) <= 100 else f"{text[:100]}…"


def number_like(value) -> bool:
    """Tell whether a value is a number and no truth value."""
    if isinstance(value, bool):
        return False
    try:
        float(value)
    except (TypeError, ValueError, OverflowError):
        return False
    return not isinstance(value, str)


def field_errors(where, f, value) -> list[str] | None:
    """Sentences on one field; None where it is sound, none where they have been said already."""
    if isinstance(value, Unread):
        return []
    if value is None:
        return [_missing(where, f)] if f.default is not None else None
    if f.metadata["kind"] in ("table", "tables"):
        return _table_errors(where, f, value)
    return [f"{where}: {text}" for text in _value_errors(f, value)] or None


def _table_errors(where, f, value) -> list[str] | None:
    """Sentences on a table inside an element, or on a list of them; None where all is sound."""
    cls, several = f.metadata["of"], f.metadata["kind"] == "tables"
    rows = value if several else [value]
    if not isinstance(rows, tuple | list) or not rows or not all(isinstance(row, cls) for row in rows):
        wanted = f"one table or more. Write [[….{f.name}]]" if several else f"a table. Write [….{f.name}]"
        return [f"{where}: {f.name} is {shown(value)}, must be {wanted}."]
    found = []
    for k, row in enumerate(rows):
        inside = f"{where}, {f.name}{f' no. {k + 1}' if several else ''}"
        found += [field_errors(inside, g, getattr(row, g.name)) for g in dataclasses.fields(row)]
    said = [sentences for sentences in found if sentences is not None]
    return [text for sentences in said for text in sentences] if said else None


def _missing(where, f) -> str:
    """Sentence for a key that is not there."""
    limits = f.metadata.get("range")
    kinds = {
        "name": "a text, unique over all tables",
        "disk": "the name of a disk",
        "pair": "the names of two disks",
        "list": "a list",
        "rows": f"rows of {', '.join(f.metadata.get('columns', ()))}, or the name of a CSV file",
    }
    wanted = limits.words() if limits else kinds.get(f.metadata["kind"], "a value")
    return f"{where}: the key {f.name!r} is missing. Give {wanted}."


def _value_errors(f, value) -> list[str]:
    """Check one value against the kind and the range of its field."""
    kind = f.metadata["kind"]
    if kind in ("number", "count"):
        return value_errors(f, value)
    if kind in ("name", "disk") and not (isinstance(value, str) and value):
        return [f"{f.name} is {shown(value)}, must be a text."]
    if kind == "pair":
        good = isinstance(value, tuple | list) and len(value) == 2 and all(isinstance(v, str) for v in value)
        return [] if good else [f"{f.name} is {shown(value)}, must be the names of two disks."]
    if kind == "flag" and not isinstance(value, bool):
        return [f"{f.name} is {shown(value)}, must be true or false."]
    if kind == "choice" and value not in f.metadata["words"]:
        words = [w for w in f.metadata["words"] if w]
        return [f"{f.name} is {shown(value)}, must be {' or '.join(repr(w) for w in words)}.{suggestion(value, words)}"]
    if kind == "list":
        return [] if isinstance(value, tuple | list) else [f"{f.name} is {shown(value)}, must be a list."]
    if kind == "rows":
        return row_errors(f.name, f.metadata["columns"], value)
    return []


def value_errors(f, value) -> list[str]:
    """Check a number against the range in its field's metadata; sentences without the element."""
    limits = f.metadata["range"]
    unit = f" {limits.unit}" if limits.unit else ""
    if isinstance(value, int) and not isinstance(value, bool) and not number_like(value):
        return [f"{f.name} is {shown(value)}{unit}, must be a finite number."]
    if not number_like(value):
        return [f"{f.name} is {shown(value)}, must be a number{f' in {limits.unit}' if limits.unit else ''}."]
    number = float(value)
    if not math.isfinite(number):
        return [f"{f.name} is {number}{unit}, must be a finite number."]
    if f.metadata["kind"] == "count" and number != int(number):
        return [f"{f.name} is {number:g}, must be a whole number."]
    if not limits.contains(number):
        remedy = f" {limits.remedy}" if limits.remedy else " Correct the value or leave the key out."
        if f.default is dataclasses.MISSING and not limits.remedy:
            remedy = " Correct the value."
        return [f"{f.name} is {number:g}{unit}, must be {limits.words()}.{remedy}"]
    return []


def row_errors(name, columns, rows) -> list[str]:
    """Check a table of numbers: its columns, finiteness, and the growth of its first column."""
    wanted = ", ".join(columns)
    if not isinstance(rows, tuple | list):
        return [f"{name} is {shown(rows)}, must be a list of rows [{wanted}]."]
    for k, row in enumerate(rows):
        good = isinstance(row, tuple | list) and len(row) == len(columns) and all(number_like(v) for v in row)
        if not good:
            return [f"{name}, row {k + 1} is {shown(row)}, must be {len(columns)} numbers [{wanted}]."]
        if not all(math.isfinite(float(v)) for v in row):
            return [f"{name}, row {k + 1} is {shown(list(row))}, must be finite numbers."]
    first = [float(row[0]) for row in rows]
    if columns[0] == "order":
        errors = [
            f"{name}, row {k + 1}: order is {order:g}, must be greater than 0. Give the mean by its own key."
            for k, order in enumerate(first)
            if order <= 0.0
        ]
        errors += [f"{name}: order {o:g} stands {n} times. Add the rows." for o, n in Counter(first).items() if n > 1]
        return errors
    for k in range(1, len(first)):
        if first[k] <= first[k - 1]:
            cure = "Leave out one of the two rows" if first[k] == first[k - 1] else "Sort the rows"
            text = f"{columns[0]} {first[k]:g} after {first[k - 1]:g}; must increase. {cure}."
            return [f"{name}, row {k + 1}: {text}"]
    if columns[0] in ("hz", "amplitude"):
        return _factor_errors(name, columns, rows)
    if columns[0] == "rpm" and first and first[0] < 0.0:
        return [f"{name}, row 1: rpm is {first[0]:g}, must be at least 0. Speeds are positive; correct the row."]
    return _span_errors(name, first, rows) if columns[0] == "angle" else []


def _factor_errors(name, columns, rows) -> list[str]:
    """Check the signs of rows (frequency or amplitude, factor of stiffness, factor of damping)."""
    # 5e-324 is the least number above 0.
    limits = {columns[0]: ("at least 0", 0.0), columns[2]: ("at least 0", 0.0), columns[1]: ("greater than 0", 5e-324)}
    return [
        f"{name}, row {k + 1}: {column} is {row[columns.index(column)]:g}, must be {words}. Correct the row."
        for k, row in enumerate(rows)
        for column, (words, least) in limits.items()
        if not row[columns.index(column)] >= least
    ]


def _span_errors(name, angle, rows) -> list[str]:
    """Check that a pressure table covers one gas cycle, but for one step at the most."""
    if len(angle) < 2:
        return [f"{name} has {len(angle)} rows, needs at least 2."]
    span = angle[-1] - angle[0]
    if span > 720.0 + 1e-9:
        return [f"{name} spans {span:g} deg, must span at most 720 deg. Give one gas cycle."]
    period = 720.0 if gas.is_four_stroke(rows) else 360.0
    steps = np.diff(angle)
    # The end of a table may be left out: as much as a step of it, up to an eighth of the cycle.
    step = min(max(float(np.median(steps)), steps[0], steps[-1]), period / 8.0)
    if span >= period - step - 1e-6:
        return []
    return [
        f"{name} covers {angle[0]:g} to {angle[-1]:g} deg, must cover a whole gas cycle of {period:g} deg but for one"
        f" step ({step:g} deg). Add the missing angles; four-stroke tables span 720 deg, two-stroke tables 360 deg"
        " within -360 to 360 deg."
    ]

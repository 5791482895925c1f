"""How results show themselves: one line in a session, a small table in a notebook."""

import dataclasses
import html

import numpy as np

from jaxhb._equal import by_value
from jaxhb._jax import traced

MOST_ROWS = 20  # rows of a table in a notebook


def brief(cls):
    """Give a dataclass a ``repr`` that tells the shapes of its arrays instead of their
    numbers, and ``==`` by value.

    Not for classes whose ``repr`` identifies them: static parts of pytrees, which keys
    of programs are made of.

    >>> brief(dataclasses.make_dataclass("Shapes", ["hz", "names"]))(
    ...     np.arange(6.0), tuple("abcdef")
    ... )
    Shapes(hz=float64[6] 0 to 5, names=6 of str)
    """

    def line(self):
        fields = [f.name for f in dataclasses.fields(self) if f.repr]
        parts = ((name, getattr(self, name)) for name in fields)
        texts = [f"{name}={value_text(v)}" for name, v in parts if v is not None]
        return f"{type(self).__name__}({', '.join(texts)})"

    cls.__repr__ = line
    return by_value(cls)


def value_text(value):
    """A value in a few words: scalars as they are, of arrays type, shape and range, of
    collections the number.
    """
    if traced(value):
        return "traced"
    if hasattr(value, "dtype"):
        return (
            _array_text(np.asarray(value))
            if np.size(value) != 1
            else number(np.asarray(value).item())
        )
    items = list(value.values()) if isinstance(value, dict) else value
    records = (
        isinstance(items, tuple | list)
        and len(items) > 1
        and dataclasses.is_dataclass(items[0])
    )
    if records or (isinstance(items, tuple | list) and len(items) > 4):
        return f"{len(items)} of {type(items[0]).__name__}"
    if isinstance(value, dict):
        items = (f"{key!r}: {value_text(item)}" for key, item in value.items())
        return f"{{{', '.join(items)}}}"
    if isinstance(value, tuple | list):
        return f"({', '.join(map(value_text, value))})"
    return number(value) if isinstance(value, float) else repr(value)


def _array_text(values):
    shape = ", ".join(map(str, values.shape))
    finite = (
        values[np.isfinite(values)]
        if values.dtype.kind == "f"
        else values
        if values.dtype.kind == "i"
        else []
    )
    span = f" {number(finite.min())} to {number(finite.max())}" if len(finite) else ""
    return f"{values.dtype}[{shape}]{span}"


def number(value):
    """A number with at most four digits."""
    return (
        f"{value:.4g}"
        if isinstance(value, int | float | np.number) and not isinstance(value, bool)
        else str(value)
    )


def span(values, unit):
    """``8 speeds from 700 to 2450 rpm``."""
    values = np.asarray(values)
    plural = "s" * (len(values) != 1)
    ends = (
        f" from {number(values[0])} to {number(values[-1])} {unit}"
        if len(values)
        else ""
    )
    return f"{len(values)} speed{plural}{ends}"


def counts(names):
    """``5 periodic, 3 contact``: how often each name occurs, the most frequent
    first.
    """
    found, often = np.unique(np.asarray(names, dtype=str), return_counts=True)
    return ", ".join(
        f"{often[k]} {found[k]}" for k in np.argsort(-often, kind="stable")
    )


def html_table(caption, head, rows):
    """A table in HTML."""
    lines = "".join(
        f"<tr>{''.join(f'<td>{html.escape(str(c))}</td>' for c in row)}</tr>"
        for row in rows
    )
    titles = "".join(f"<th>{html.escape(title)}</th>" for title in head)
    table = (
        f"<table><thead><tr>{titles}</tr></thead><tbody>{lines}</tbody></table>"
        if rows
        else ""
    )
    return f"<p>{html.escape(caption)}</p>{table}"


def ranges(speeds: list[float], chosen: list[float], to: str = "-") -> str:
    """``1500-2450`` for speeds that follow each other."""
    runs: list[list[float]] = []
    ordered = sorted(speeds)
    for i, speed in enumerate(ordered):
        if speed not in chosen:
            continue
        if runs and i and runs[-1][1] == ordered[i - 1]:
            runs[-1][1] = speed
        else:
            runs.append([speed, speed])
    return ", ".join(f"{a:g}" if a == b else f"{a:g}{to}{b:g}" for a, b in runs)

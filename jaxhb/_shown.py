"""How results show themselves: one line in a session, a small table in a notebook."""

import dataclasses
import html
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

from jaxhb._equal import by_value
from jaxhb._jax import traced

MOST_ROWS = 20  # rows of a table in a notebook

Shown = TypeVar("Shown")


def brief(cls: type[Shown]) -> type[Shown]:
    """Give a dataclass a ``repr`` that tells the shapes of its arrays instead of their
    numbers, and ``==`` by value.

    Not for classes whose ``repr`` identifies them: static parts of pytrees, which keys
    of programs are made of.

    >>> brief(dataclasses.make_dataclass("Shapes", ["hz", "names"]))(
    ...     np.arange(6.0), tuple("abcdef")
    ... )
    Shapes(hz=float64[6] 0 to 5, names=6 of str)
    """

    def line(self: Any) -> str:
        fields = [field.name for field in dataclasses.fields(self) if field.repr]
        values = {name: getattr(self, name) for name in fields}
        texts = [
            f"{name}={value_text(value)}"
            for name, value in values.items()
            if value is not None
        ]
        return f"{type(self).__name__}({', '.join(texts)})"

    cls.__repr__ = line  # type: ignore[method-assign]
    return by_value(cls)


def value_text(value: Any) -> str:
    """A value in a few words: scalars as they are, of arrays type, shape and range, of
    collections the number.
    """
    if traced(value):
        return "traced"
    if hasattr(value, "dtype"):
        array = np.asarray(value)
        return number(array.item()) if array.size == 1 else _array_text(array)
    if isinstance(value, dict | tuple | list):
        members = list(value.values() if isinstance(value, dict) else value)
        records = len(members) > 1 and dataclasses.is_dataclass(members[0])
        if records or len(members) > 4:
            return f"{len(members)} of {type(members[0]).__name__}"
    if isinstance(value, dict):
        pairs = [f"{key!r}: {value_text(member)}" for key, member in value.items()]
        return f"{{{', '.join(pairs)}}}"
    if isinstance(value, tuple | list):
        return f"({', '.join(map(value_text, value))})"
    return number(value) if isinstance(value, float) else repr(value)


def _array_text(values: np.ndarray) -> str:
    shape = ", ".join(map(str, values.shape))
    finite = values[:0]
    if values.dtype.kind in "fi":
        finite = values[np.isfinite(values)]
    span = f" {number(finite.min())} to {number(finite.max())}" if len(finite) else ""
    return f"{values.dtype}[{shape}]{span}"


def number(value: Any) -> str:
    """A number with at most four digits."""
    if isinstance(value, int | float | np.number) and not isinstance(value, bool):
        return f"{value:.4g}"
    return str(value)


def span(values: Sequence[float] | np.ndarray, unit: str) -> str:
    """``8 speeds from 700 to 2450 rpm``."""
    values = np.asarray(values)
    plural = "s" * (len(values) != 1)
    ends = ""
    if len(values):
        ends = f" from {number(values[0])} to {number(values[-1])} {unit}"
    return f"{len(values)} speed{plural}{ends}"


def counts(names: Sequence[str] | np.ndarray) -> str:
    """``5 periodic, 3 contact``: how often each name occurs, the most frequent
    first.
    """
    words, often = np.unique(np.asarray(names, dtype=str), return_counts=True)
    return ", ".join(
        f"{often[k]} {words[k]}" for k in np.argsort(-often, kind="stable")
    )


def html_table(caption: str, head: Sequence[str], rows: Sequence[Sequence]) -> str:
    """A table in HTML."""
    lines = "".join(
        f"<tr>{''.join(f'<td>{html.escape(str(cell))}</td>' for cell in row)}</tr>"
        for row in rows
    )
    titles = "".join(f"<th>{html.escape(title)}</th>" for title in head)
    table = ""
    if rows:
        table = f"<table><thead><tr>{titles}</tr></thead><tbody>{lines}</tbody></table>"
    return f"<p>{html.escape(caption)}</p>{table}"


def ranges(speeds: Sequence[float], chosen: Sequence[float], to: str = "-") -> str:
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

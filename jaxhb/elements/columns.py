"""Fields of elements collected into vectors."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jaxhb.elements.declared import (
    DAMPING_OVER_RPM,
    HARMONICS,
    OVER_RPM,
    OVER_TEMPERATURE,
    STIFFNESS_OVER_RPM,
    TWISTS,
)


def column(elements: Sequence[Any], name: str, absent: float = 0.0) -> np.ndarray:
    """Collect one field over elements, ``absent`` for None."""
    values = [getattr(element, name) for element in elements]
    return np.array(
        [absent if value is None else value for value in values], dtype=np.float64
    )


def stacked(rows: Sequence[Any]) -> np.ndarray:
    """Stack the (Re, Im) of rows (order, Re, Im), padded by zeros."""
    stacked = np.zeros((len(rows), max((len(row or ()) for row in rows), default=0), 2))
    for i, row in enumerate(rows):
        if row:
            stacked[i, : len(row)] = np.asarray(row, dtype=np.float64)[:, 1:]
    return stacked


def scales(elements: Sequence[Any]) -> dict[str, np.ndarray]:
    """Stack the scales, padded by their last point; the factor is 1 without a scale."""
    points = padded([element.scale for element in elements], (0.0, 1.0), 2)
    return {"scale_rpm": points[..., 0].copy(), "scale_factor": points[..., 1].copy()}


def padded(
    rows: Sequence[Any], absent: tuple[float, ...], least: int = 1
) -> np.ndarray:
    """Stack lists of rows [n, K, columns]; lists without any hold the row ``absent``,
    shorter ones repeat their last row; K is at least ``least``.
    """
    rows = [row or (absent,) for row in rows]
    longest = max([least, *map(len, rows)])
    padded = [[*row, *([row[-1]] * longest)][:longest] for row in rows]
    return np.array(padded, dtype=np.float64).reshape(len(rows), longest, len(absent))


def collected(
    cls: type[Any],
    element: type[Any],
    elements: Sequence[Any],
    special: Mapping[str, Any] | None = None,
) -> Any:
    """Collect a table: its ``special`` fields, and the others from its elements, of the
    class ``element``; None for a field that may be absent and that no element has.
    Numbers that an element gives over the speed are nan.
    """
    columns = dict(special or {})
    headers = {
        declared.name: declared.metadata.get("columns")
        for declared in dataclasses.fields(element)
    }
    for field in dataclasses.fields(cls):
        if field.name in columns:
            continue
        values = [getattr(element, field.name) for element in elements]
        if field.default is None and not any(values):
            columns[field.name] = None
        elif headers[field.name] == HARMONICS:
            columns[field.name] = stacked(values)
        elif headers[field.name] in (
            TWISTS,
            OVER_RPM,
            DAMPING_OVER_RPM,
            STIFFNESS_OVER_RPM,
        ):
            columns[field.name] = padded(values, (0.0, 0.0))
        elif headers[field.name] == OVER_TEMPERATURE:
            columns[field.name] = padded(values, (0.0, 1.0, 1.0))
        elif field.name.startswith("over_"):
            rows = padded(values, (0.0, 1.0, 1.0), 2)
            columns[field.name] = rows if any(values) else rows[:, :0]
        else:
            numbers = column(elements, field.name)
            # No calculation may take a number that depends on the speed for constant
            tabled = [_has_table(part, field.name) for part in elements]
            numbers[np.array(tabled, dtype=bool)] = np.nan
            columns[field.name] = numbers
    return cls(**columns)


def _has_table(element: Any, name: str) -> bool:
    """Whether an element gives a number over the speed."""
    return bool(getattr(element, f"{name}_over_rpm", ()))

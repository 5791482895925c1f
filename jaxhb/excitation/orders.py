"""Orders of some elements as harmonics of the cycle, and their sums on disks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from jaxhb._jax import Array, added


def add_listed(
    torque: Array,
    disks: Sequence[int] | np.ndarray,
    numbers: Iterable[tuple[int, ...]],
    values: Callable[[np.ndarray, np.ndarray, np.ndarray], Array],
) -> Array:
    """Add ``values(i, k, n)`` of elements i on ``disks`` at their harmonics n =
    ``numbers[i][k]`` up to N.
    """
    i, k, n = _listed(tuple(numbers), torque.shape[-1] - 1)
    if not i.size:
        return torque
    return added(torque, (..., np.array(disks, dtype=int)[i], n), values(i, k, n))


@lru_cache(maxsize=256)
def _listed(numbers: tuple[tuple[int, ...], ...], most: int) -> np.ndarray:
    """Elements i, places k and harmonics n = ``numbers[i][k]`` up to ``most``."""
    flat = [
        (i, k, n)
        for i, row in enumerate(numbers)
        for k, n in enumerate(row)
        if n <= most
    ]
    return np.array(flat, dtype=int).reshape(-1, 3).T


def add_rows(
    torque: Array,
    disks: Sequence[int] | np.ndarray,
    numbers: Iterable[tuple[int, ...]],
    rows: Array,
    factor: Array,
) -> Array:
    """Add harmonics of elements, from their rows of amplitudes, each times
    its factor.
    """
    return add_listed(
        torque,
        disks,
        numbers,
        lambda i, k, n: factor[..., i] * coefficients(rows, i, k),
    )


def coefficients(rows: Array, i: np.ndarray, k: np.ndarray) -> Array:
    """Coefficients T^n of rows (Re, Im) of peak amplitudes."""
    pair = rows[i, k]
    return 0.5 * (pair[:, 0] + 1j * pair[:, 1])


def harmonics_of(
    tables: Iterable[Sequence[Any]], turns: Iterable[float]
) -> tuple[tuple[int, ...], ...]:
    """Harmonics of the cycle of rows (order, Re, Im) of every element, which count on
    what makes so many ``turns`` a cycle.
    """
    return tuple(
        tuple(round(row[0] * factor) for row in rows)
        for rows, factor in zip(tables, turns, strict=True)
    )


def highest_rows(numbers: Iterable[tuple[int, ...]], rows: Array | None) -> list[int]:
    """Harmonics ``numbers`` of elements whose rows of amplitudes ``(n, K, 2)`` are not
    0; none without rows. Concrete values.
    """
    if rows is None:
        return []
    present = (np.asarray(rows) != 0.0).any(axis=-1).tolist()
    return [
        n
        for row, counts in zip(numbers, present, strict=True)
        for n, there in zip(row, counts, strict=False)
        if there
    ]

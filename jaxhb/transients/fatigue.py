"""Cycles of a signal, counted by rainflow, and the damage that they do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxhb._equal import by_value
from jaxhb._jax import Array, namespace, traced
from jaxhb.elements.sentences import SceneError
from jaxhb.transients.history import History


@by_value
@dataclass(frozen=True)
class CountedCycles:
    """Counted cycles, largest range first: ranges (largest less smallest value), means
    and counts, 0.5 of a half cycle, each ``(n,)``; begin and end ``(n,)``: instants
    between which a cycle lies, by their number.
    """

    ranges: Array
    means: Array
    counts: np.ndarray
    begin: np.ndarray
    end: np.ndarray

    @property
    def total(self) -> float:
        """Number of all cycles."""
        return float(self.counts.sum())


@by_value
@dataclass(frozen=True)
class SNCurve:
    """Cycles that a material or part bears at an amplitude, ``N = n (S_n / S)^m``
    through points.

    Parameters
    ----------
    points : rows of (cycles, amplitude), amplitudes falling; straight lines between
        them in logarithms, the first and the last one extended
    source : str, standard or test that the points are of
    limit : amplitude below which a cycle does no damage; 0: none
    knee_exponent : exponent m of amplitudes below those of the last point, by default
        that of the last line; Haibach's is 2 m - 1

    Examples
    --------
    >>> curve = SNCurve(points=((1e4, 200e6), (1e6, 100e6)), source="an example")
    >>> round(float(curve.cycles(np.array(100e6))))
    1000000
    """

    points: tuple[tuple[float, float], ...]
    source: str
    limit: float = 0.0
    knee_exponent: float | None = None

    def cycles(self, amplitude: Array) -> Array:
        """Cycles ``(...)`` borne at amplitudes ``(...)``; infinite up to the limit, nan
        of an amplitude that is none.
        """
        xp = namespace(amplitude)
        rows = np.array(self.points, dtype=float)
        if rows.ndim != 2 or len(rows) < 2:
            raise SceneError("S-N curve: points must be rows of (cycles, amplitude).")
        falling = np.all(np.diff(rows[:, 0]) > 0) and np.all(np.diff(rows[:, 1]) < 0)
        if not (falling and np.all(rows > 0)):
            raise SceneError(
                "S-N curve: cycles must increase and amplitudes fall from row to row,"
                " all greater than 0."
            )
        number, height = np.log(rows).T
        exponents = -np.diff(number) / np.diff(height)
        positive = xp.asarray(amplitude) > 0
        level = xp.log(xp.where(positive, amplitude, rows[-1, 1]))
        line = np.searchsorted(-height[1:-1], -_concrete(level))
        life = number[line] + exponents[line] * (height[line] - level)
        if self.knee_exponent is not None:
            below = number[-1] + self.knee_exponent * (height[-1] - level)
            life = xp.where(level < height[-1], below, life)
        wears = positive & (xp.asarray(amplitude) > self.limit)
        borne = xp.where(wears, xp.exp(xp.where(wears, life, 0.0)), xp.inf)
        return xp.where(xp.isnan(xp.asarray(amplitude)), xp.nan, borne)


def _concrete(values: Array) -> np.ndarray:
    """Values that a choice is made by; derivatives go past it."""
    import jax

    stopped = jax.lax.stop_gradient(values) if traced(values) else values
    return np.asarray(stopped)


def count_cycles(history: History) -> CountedCycles:
    """Cycles of a signal by the rainflow method of ASTM E1049-85, with the package
    rainflow.

    Ranges and means stay differentiable: the count is that of the values.
    :class:`SceneError` of values that are not finite.

    >>> time = np.arange(9.0)
    >>> values = np.array([-2.0, 1, -3, 5, -1, 3, -4, 4, -2])
    >>> cycles = count_cycles(History(time, values, 0 * time, time))
    >>> sorted(zip(cycles.ranges.tolist(), cycles.counts.tolist(), strict=True))
    [(3.0, 0.5), (4.0, 0.5), (4.0, 1.0), (6.0, 0.5), (8.0, 0.5), (8.0, 0.5), (9.0, 0.5)]
    """
    try:
        import rainflow
    except ImportError:
        raise ImportError(
            "counting cycles needs rainflow. Install it: pip install"
            ' "jaxhb[transients]"'
        ) from None
    values = history.values
    counted = _concrete(values)
    if not np.isfinite(counted).all():
        place = int(np.flatnonzero(~np.isfinite(counted))[0])
        raise SceneError(
            f"the signal is {counted[place]} at {float(history.time[place]):g} s, and"
            " its cycles cannot be counted. Take the part before."
        )
    rows = list(rainflow.extract_cycles(counted))
    rows.sort(key=lambda row: -row[0])
    begin = np.array([row[3] for row in rows], dtype=int)
    end = np.array([row[4] for row in rows], dtype=int)
    xp = namespace(values)
    return CountedCycles(
        ranges=xp.abs(values[begin] - values[end]),
        means=(values[begin] + values[end]) / 2,
        counts=np.array([row[2] for row in rows], dtype=float),
        begin=begin,
        end=end,
    )


def damage_of(cycles: CountedCycles, curve: SNCurve) -> Any:
    """Damage of counted cycles by the sum of Palmgren and Miner, ``sum n_i / N(S_i)``
    with the amplitude ``S_i`` half of the range; 1 is the end of the life.
    """
    return (cycles.counts / curve.cycles(cycles.ranges / 2)).sum()

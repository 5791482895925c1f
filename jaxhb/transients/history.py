"""Signals over a time in which nothing repeats: extremes, envelopes, orders over
speed.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import partial

import jax
import numpy as np

from jaxhb._equal import by_value
from jaxhb._jax import Array, concrete, namespace, refuse_tracers
from jaxhb._program import Program
from jaxhb._shown import number
from jaxhb.equations import fourier


@by_value
@dataclass(frozen=True)
class Envelope:
    """Largest and smallest values ``(n,)`` of a signal in windows of equal length:
    time in s and speed in rpm of their middles ``(n,)``.
    """

    time: np.ndarray
    rpm: np.ndarray
    highest: np.ndarray
    lowest: np.ndarray


@by_value
@dataclass(frozen=True)
class OrderMap:
    """Amplitudes of orders over the speed: one-sided peak amplitudes ``(n, K)`` of
    orders ``(K,)`` per revolution of the reference rotor, in windows around time in s
    and speed in rpm ``(n,)``.
    """

    time: np.ndarray
    rpm: np.ndarray
    orders: np.ndarray
    amplitudes: np.ndarray


@by_value
@dataclass(frozen=True, repr=False)
class History:
    """A quantity over time.

    Parameters
    ----------
    time : ``(n,)`` s
    values : ``(n,)`` in the unit of the quantity
    rpm : ``(n,)`` speed of the reference rotor
    angle : ``(n,)`` rad that the reference rotor has turned
    elastic_values : ``(n,)`` or None, elastic part (stiffness only) of a transmitted
    force or torque

    Examples
    --------
    >>> time = np.linspace(0.0, 1.0, 1001)
    >>> turned = 10 * np.pi * time
    >>> torque = History(time, 3 + np.sin(turned), 0 * time + 300, turned)
    >>> round(float(torque.max), 6), round(float(torque.time_of_peak), 3)
    (4.0, 0.05)
    """

    time: Array
    values: Array
    rpm: Array
    angle: Array
    elastic_values: Array | None = None

    def __repr__(self) -> str:
        return (
            f"<History of {number(float(self.time[0]))} to"
            f" {number(float(self.time[-1]))} s: min {number(float(self.min))}, max"
            f" {number(float(self.max))}>"
        )

    @property
    def elastic(self) -> History:
        """The elastic part alone."""
        if self.elastic_values is None:
            raise AttributeError(
                "this signal is not a force or torque: it has no elastic part"
            )
        return dataclasses.replace(
            self, values=self.elastic_values, elastic_values=None
        )

    def reversed(self) -> History:
        """The quantity with the other sign."""
        part = None if self.elastic_values is None else -self.elastic_values
        return dataclasses.replace(self, values=-self.values, elastic_values=part)

    def between(self, begin: float, end: float) -> History:
        """The part from ``begin`` to ``end``, both in s."""
        inside = (np.asarray(self.time) >= begin) & (np.asarray(self.time) <= end)
        if np.count_nonzero(inside) < 2:
            raise ValueError(
                f"between {begin:g} and {end:g} s there are no two instants: the signal"
                f" goes from {float(self.time[0]):g} to {float(self.time[-1]):g} s"
            )
        part = self.elastic_values
        return History(
            time=self.time[inside],
            values=self.values[inside],
            rpm=self.rpm[inside],
            angle=self.angle[inside],
            elastic_values=None if part is None else part[inside],
        )

    @property
    def max(self) -> Array:
        """Largest value, on parabolas through neighbouring instants."""
        return vertices(self.values).max()

    @property
    def min(self) -> Array:
        """Smallest value, as :attr:`max`."""
        return -vertices(-self.values).max()

    @property
    def peak(self) -> Array:
        """Largest absolute value."""
        return namespace(self.values).maximum(self.max, -self.min)

    @property
    def half_peak_to_peak(self) -> Array:
        """(max - min) / 2."""
        return (self.max - self.min) / 2

    @property
    def time_of_peak(self) -> Array:
        """Instant of the largest absolute value, s."""
        xp = namespace(self.values)
        return self.time[xp.argmax(xp.abs(self.values))]

    @property
    def rpm_of_peak(self) -> Array:
        """Speed of the reference rotor in rpm at the largest absolute value."""
        xp = namespace(self.values)
        return self.rpm[xp.argmax(xp.abs(self.values))]

    @property
    def mean(self) -> Array:
        """Mean over the time."""
        return self._over_time(self.values)

    @property
    def rms(self) -> Array:
        """Root mean square over the time, mean included."""
        return self._over_time(self.values**2) ** 0.5

    def _over_time(self, values: Array) -> Array:
        """Mean over the time, by trapezia."""
        areas = np.diff(self.time) * (values[1:] + values[:-1]) / 2
        return areas.sum() / (self.time[-1] - self.time[0])

    def smooth_peak(self, p: float = 64) -> Array:
        """Differentiable peak, the p-norm over the time, ``(1/T int |x|^p dt)^(1/p)``
        by trapezia: below the peak, by less the longer it lasts.
        """
        steps = np.diff(self.time)
        shares = np.concatenate([steps, [0.0]]) + np.concatenate([[0.0], steps])
        weights = shares / (2 * (self.time[-1] - self.time[0]))
        norm = _norm.function if namespace(self.values) is np else _norm
        return norm(self.values, weights, p)

    def at(self, seconds: float | Array) -> Array:
        """Values at instants in s, on cubics through four neighbours."""
        xp = namespace(self.values)
        instants = np.asarray(seconds, dtype=float)
        time = np.asarray(self.time)
        if np.any(instants < time[0] - 1e-9) or np.any(instants > time[-1] + 1e-9):
            raise ValueError(
                f"the signal goes from {time[0]:g} to {time[-1]:g} s, and"
                f" {instants.min():g} to {instants.max():g} s were asked for"
            )
        if len(time) < 4:
            return xp.interp(instants, time, self.values)
        first = np.clip(np.searchsorted(time, instants) - 2, 0, len(time) - 4)
        places = first[..., None] + np.arange(4)
        nodes = time[places]
        total: Array = xp.zeros(instants.shape)
        for k in range(4):
            remaining = [j for j in range(4) if j != k]
            weight = np.ones(instants.shape)
            for j in remaining:
                weight = weight * (instants - nodes[..., j])
                weight = weight / (nodes[..., k] - nodes[..., j])
            total = total + weight * self.values[places[..., k]]
        return total

    def envelope(self, window: float) -> Envelope:
        """Largest and smallest value in every window of ``window`` s."""
        refuse_tracers("envelope", self.values, host=True)
        if not window > 0:
            raise ValueError(f"the window is {window:g} s, must be greater than 0 s")
        time = np.asarray(self.time)
        share = (time - time[0]) / window
        # The last instant ends a window, and has none of its own.
        last = max(np.ceil(share[-1] - 1e-9) - 1, 0)
        number_of_window = np.minimum(np.floor(share + 1e-9), last)
        begins = np.unique(number_of_window, return_index=True)[1]
        highest = np.maximum.reduceat(vertices(np.asarray(self.values)), begins)
        lowest = -np.maximum.reduceat(vertices(-np.asarray(self.values)), begins)
        ends = np.append(begins[1:], len(time)) - 1
        middles = (time[begins] + time[ends]) / 2
        return Envelope(middles, np.interp(middles, time, self.rpm), highest, lowest)

    def envelope_of_cycles(self, revolutions: float) -> Envelope:
        """Largest and smallest value in windows of so many revolutions of the
        reference rotor, which overlap by half; the last is up to half as long again.
        """
        refuse_tracers("envelope_of_cycles", self.values, host=True)
        if not revolutions > 0:
            raise ValueError(f"revolutions are {revolutions:g}, must be greater than 0")
        turned = np.asarray(self.angle) / (np.pi * revolutions)
        halves = np.floor(turned - turned[0] + 1e-9)
        halves = np.minimum(halves, max(halves[-1] - 1, 0))
        begins = np.flatnonzero(np.diff(halves, prepend=-1.0))
        highest = np.maximum.reduceat(vertices(np.asarray(self.values)), begins)
        lowest = -np.maximum.reduceat(vertices(-np.asarray(self.values)), begins)
        time = np.asarray(self.time)
        ends = np.append(begins[1:], len(time) - 1)
        if len(begins) == 1:
            middles = (time[begins] + time[ends]) / 2
        else:
            middles = time[begins[1:]]
            highest = np.maximum(highest[:-1], highest[1:])
            lowest = np.minimum(lowest[:-1], lowest[1:])
        return Envelope(middles, np.interp(middles, time, self.rpm), highest, lowest)

    def order_map(
        self,
        *,
        highest: float = 12.0,
        revolutions: float = 8.0,
        overlap: float = 0.75,
    ) -> OrderMap:
        """Amplitudes of orders up to ``highest`` over the speed: in windows of so many
        revolutions of the reference rotor, which ``overlap`` by a share, the signal is
        sampled by its angle, weighted by Hann's window and transformed.

        Orders are multiples of 1 / revolutions; a peak of one order spreads over its
        two neighbours.
        """
        refuse_tracers("order_map", self.values, host=True)
        if not 0 <= overlap < 1:
            raise ValueError(f"overlap is {overlap:g}, must be from 0 to below 1")
        if not (revolutions > 0 and 0 < highest < np.inf):
            raise ValueError(
                f"revolutions are {revolutions:g} and highest is {highest:g}, must both"
                " be greater than 0"
            )
        turned = np.asarray(self.angle) / (2 * np.pi)
        if turned[-1] - turned[0] < revolutions:
            raise ValueError(
                f"the rotor turns {turned[-1] - turned[0]:.4g} times, and a window has"
                f" {revolutions:g} revolutions: give fewer"
            )
        hop = revolutions * (1 - overlap)
        count = int((turned[-1] - turned[0] - revolutions) / hop) + 1
        moving = np.concatenate([[True], np.diff(turned) > 0])
        values = np.asarray(self.values)[moving]
        angles = turned[moving]
        begins = angles[0] + hop * np.arange(count)
        spectra = [
            _spectrum(angles, values, begin, revolutions, highest) for begin in begins
        ]
        middles = begins + revolutions / 2
        return OrderMap(
            time=np.interp(middles, angles, np.asarray(self.time)[moving]),
            rpm=np.interp(middles, angles, np.asarray(self.rpm)[moving]),
            orders=np.arange(len(spectra[0])) / revolutions,
            amplitudes=np.array(spectra),
        )


def _spectrum(
    turned: np.ndarray,
    values: np.ndarray,
    begin: float,
    revolutions: float,
    highest: float,
) -> np.ndarray:
    """One-sided amplitudes ``(K,)`` of the orders 0, 1 / revolutions, ... ``highest``
    of a signal in the window from ``begin`` on, at angles in revolutions.
    """
    shown = int(np.floor(highest * revolutions + 1e-9)) + 1
    instants = np.diff(np.searchsorted(turned, [begin, begin + revolutions]))[0]
    # As fine as the signal itself: orders beyond the samples would appear below.
    samples = 2 * max(int(np.ceil(2 * highest * revolutions)), int(instants), 1)
    angles = begin + revolutions * np.arange(samples) / samples
    window = np.hanning(samples + 1)[:-1]
    weighted = np.interp(angles, turned, values) * (window * samples / window.sum())
    coefficients = fourier.analyze(weighted, samples // 2)
    one_sided = np.where(np.arange(shown) > 0, 2.0, 1.0)
    return np.abs(np.asarray(coefficients)[:shown]) * one_sided


@partial(Program, static_argnames="p")
def _norm(values: Array, weights: Array, p: float) -> Array:
    """The p-norm of values ``(n,)`` with weights ``(n,)``."""
    xp = namespace(values)
    size = xp.abs(values)
    largest = concrete(size.max())[0]
    scale = xp.where(largest > 0, largest, 1.0)
    total = (weights * (size / scale) ** p).sum()
    # 0 of a signal that is 0, without a derivative of infinity
    safe = xp.where(total > 0, total, 1.0)
    return scale * xp.where(total > 0, safe ** (1 / p), 0.0)


def vertices(values: Array) -> Array:
    """Values ``(n,)``, with those of the vertices of parabolas through three
    neighbours where the middle one is the largest.
    """
    xp = namespace(values)
    if len(values) < 3:
        return values
    before = values[:-2]
    here = values[1:-1]
    after = values[2:]
    bend = 2 * here - before - after
    vertex = here + (after - before) ** 2 / (8 * xp.where(bend > 0, bend, 1.0))
    is_peak = (here >= before) & (here >= after) & (bend > 0)
    inside = xp.where(is_peak, vertex, here)
    return xp.concatenate([values[:1], inside, values[-1:]])


jax.tree_util.register_dataclass(
    History,
    data_fields=["time", "values", "rpm", "angle", "elastic_values"],
    meta_fields=[],
)

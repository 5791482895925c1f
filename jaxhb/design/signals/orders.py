r"""Orders of a measured rotation over the speed, by least squares on the samples
themselves.

In a block of some cycles the rotor turns by

    alpha(t) = p(t) + sum over orders k   Re(c_k exp(i k (p(t) - p_0)))

p, the even rotation, is a cubic of time: the speed may change within the block. Samples
of alpha (pulses, an encoder) or of its rate (a torsiograph) are fitted by p and all
c_k together; p inside the exponentials is that of the step before, until it stays.
Nothing is interpolated between samples: what is left is noise, rotation that is no
cubic, and orders beyond those that the samples can tell. p_0 is the angle at which the
cycle begins, from a mark once per cycle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxhb._equal import by_value
from jaxhb._jax import refuse_tracers
from jaxhb.design.measurements import Measured
from jaxhb.design.signals.pulses import counted
from jaxhb.elements.sentences import SceneError, shown

TURN = 2 * math.pi
DEGREE = 3  # of the even rotation over time in a block
MOST_STEPS = 20  # until the even rotation stays
STAYS = 1e-12  # rad
FEWEST_CYCLES = 2
OFF_MARK = 0.01  # share of a cycle that may be missing from mark to mark
BETWEEN = 0.95  # of the highest order that samples can tell: the last ones are noise
QUANTITIES = ("angle", "speed", "acceleration")


@by_value
@dataclass(frozen=True)
class MeasuredOrders:
    """Orders of a measured rotation: B windows of speed, K orders.

    rpm : ``(B,)`` mean speeds; orders : ``(K,)`` per revolution; angle : complex ``(B,
    K)``, rad, peak amplitude and phase of ``cos(order theta + phase)``, of a speed
    without marks amplitudes alone; noise : ``(B, K)`` rad, standard deviation of each
    amplitude from what the orders leave unexplained; blocks : ``(B,)``, how many each
    window has; phased : whether theta is 0 at a mark, so that phases mean
    something; notes : sentences on what was mended or left out
    """

    rpm: np.ndarray
    orders: np.ndarray
    angle: np.ndarray
    noise: np.ndarray
    blocks: np.ndarray
    phased: bool
    notes: tuple[str, ...]

    def values(self, quantity: str = "angle") -> np.ndarray:
        """Complex amplitudes ``(B, K)`` of the angle (rad), the speed (rad/s) or the
        acceleration (rad/s2).
        """
        rate = 1j * self.orders * self.rpm[:, None] * TURN / 60.0
        powers = dict(zip(QUANTITIES, range(len(QUANTITIES)), strict=True))
        if quantity not in powers:
            raise SceneError(
                f"quantity is {shown(quantity)}, must be one of"
                f" {', '.join(QUANTITIES)}."
            )
        return self.angle * rate ** powers[quantity]

    def rows(self, element: str, quantity: str = "angle") -> Measured:
        """All amplitudes as rows for :func:`jaxhb.identify`, of a disk ``element``;
        phases in deg where there was a mark.
        """
        values = self.values(quantity)
        count = values.size
        phase = np.rad2deg(np.angle(values)) if self.phased else np.full(count, np.nan)
        return Measured(
            rpm=np.repeat(self.rpm, len(self.orders)),
            order=np.tile(self.orders, len(self.rpm)),
            element=(element,) * count,
            quantity=(quantity,) * count,
            amplitude=np.abs(values).ravel(),
            phase=np.ravel(phase),
        )


def measured_orders(
    time: Sequence[float] | np.ndarray,
    *,
    angle: Sequence[float] | np.ndarray | None = None,
    speed: Sequence[float] | np.ndarray | None = None,
    pulses: int | None = None,
    marks: Sequence[float] | np.ndarray | None = None,
    mark_deg: float = 0.0,
    revolutions_per_cycle: float = 2.0,
    highest: float = 12.0,
    cycles: int = 10,
    step_rpm: float = 10.0,
) -> MeasuredOrders:
    """Find the orders of a measured rotation over its speed.

    One of ``angle``, ``speed`` and ``pulses`` says what is measured. The record is cut
    into blocks of ``cycles``; those whose speeds lie in one window of ``step_rpm`` are
    averaged, of a speed without marks by their sizes: its integral drifts, and phases
    with it. Missing pulses are counted, as of a wheel with a gap, and told in
    ``notes``. Amplitudes are those of jaxhb: over the even rotation theta = Omega t and
    not over the angle that vibrates. :class:`SceneError` where the record has no rising
    time, less than a block, or too few samples for the orders, or where the rotor does
    not turn by a cycle from mark to mark.

    Parameters
    ----------
    time : ``(n,)``
        Instants in s, with ``pulses`` those at which a tooth of the wheel passes.
    angle : ``(n,)``, optional
        Angle of rotation in rad, as an encoder gives it; it may jump by 2 pi.
    speed : ``(n,)``, optional
        Speed of rotation in rad/s.
    pulses : int, optional
        Pulses of the wheel in a revolution.
    marks : ``(m,)``, optional
        Instants in s of a mark once per cycle; without it phases are not known.
    mark_deg : float
        Angle of the cycle at the mark, 0 at firing top dead centre, in deg.
    revolutions_per_cycle : float
        Revolutions in a cycle: 2 of a four-stroke engine, whose orders are 0.5, 1, ...
    highest : float
        Highest order.
    cycles : int
        Cycles in a block, at least 2.
    step_rpm : float
        Width of the windows of speed.

    Examples
    --------
    A wheel of 60 teeth at 1200 rpm that vibrates by 0.01 rad in order 3, its pulses
    timed to first order:

    >>> even = np.arange(60 * 40) / 60 * 2 * np.pi
    >>> time = (even - 0.01 * np.cos(3 * even)) / (40 * np.pi)
    >>> found = measured_orders(time, pulses=60)
    >>> found.rpm.round(3), np.abs(found.angle[0, 5]).round(3)
    (array([1200.]), np.float64(0.01))
    """
    refuse_tracers("measured_orders", time, angle, speed, marks)
    record = _Record.of(time, angle, speed, pulses)
    turns = float(revolutions_per_cycle)
    for name, value in (("revolutions_per_cycle", turns), ("highest", highest)):
        if not 0 < value < math.inf:
            raise SceneError(f"{name} is {value:g}, must be greater than 0.")
    orders = np.arange(1, math.floor(highest * turns + 1e-9) + 1) / turns
    _check(record, orders, cycles, turns, step_rpm)
    blocks = []
    length = cycles * turns * TURN
    first = record.alpha[0]
    count = math.floor((record.alpha[-1] - first) / length + 1e-9)
    places = np.searchsorted(record.alpha, first + length * np.arange(count + 1) - 1e-9)
    passages = np.asarray([] if marks is None else marks, dtype=float)
    _check_marks(record, passages, turns)
    for begin, end in zip(places[:-1], places[1:], strict=True):
        block = _Block.fitted(record, slice(begin, end), orders)
        if block is not None:
            blocks.append(block.from_mark(passages, mark_deg, turns))
    notes = [*record.notes]
    missing = count - len(blocks)
    if missing:
        notes.append(f"{missing} blocks have too few samples and are left out.")
    phased = len(passages) > 0
    unmarked = [block for block in blocks if phased and not block.marked]
    if unmarked:
        notes.append(f"{len(unmarked)} blocks have no mark and are left out.")
        blocks = [block for block in blocks if block.marked]
    if not blocks:
        raise SceneError(
            f"no block of {cycles} cycles can be read."
            f" {' '.join(notes) or 'Give a longer record.'}"
        )
    coherent = phased or record.rate is None
    return _averaged(blocks, orders, step_rpm, phased, coherent, tuple(notes))


@dataclass(frozen=True)
class _Record:
    """Samples of a rotation: time and rising angle alpha ``(n,)``; ``rate`` in rad/s
    where that is what was measured; ``tells`` the highest order that samples can tell.
    """

    time: np.ndarray
    alpha: np.ndarray
    rate: np.ndarray | None
    tells: float
    notes: tuple[str, ...]

    @classmethod
    def of(cls, time: Any, angle: Any, speed: Any, pulses: int | None) -> _Record:
        """Check and complete the samples of a record."""
        values_of = {"angle": angle, "speed": speed, "pulses": pulses}
        names = [name for name, value in values_of.items() if value is not None]
        if len(names) != 1:
            raise SceneError(
                f"{' and '.join(names) or 'nothing'} is given beside time, must be one"
                " of angle, speed and pulses."
            )
        time = _finite("time", time)
        if len(time) < 3 or not (np.diff(time) > 0).all():
            raise SceneError(_not_rising(time))
        if pulses is not None:
            if pulses < 1 or pulses != int(pulses):
                raise SceneError(
                    f"pulses is {shown(pulses)}, must be a whole number of at least 1:"
                    " the teeth of the wheel."
                )
            train = counted(time)
            alpha = TURN * train.number / pulses
            return cls(train.time, alpha, None, pulses / 2, train.notes)
        values = _finite(names[0], angle if speed is None else speed)
        if len(values) != len(time):
            raise SceneError(
                f"{names[0]} has {len(values)} values, must have {len(time)}: one for"
                " each instant."
            )
        if speed is None:
            alpha = np.unwrap(values)
            rate = None
        else:
            rate = values
            steps = np.diff(time) * (rate[1:] + rate[:-1]) / 2
            alpha = np.concatenate([[0.0], np.cumsum(steps)])
        backward = alpha[-1] < alpha[0]
        if backward:
            alpha = -alpha
            rate = None if rate is None else -rate
        alpha = np.maximum.accumulate(alpha) if rate is not None else alpha
        turned = (alpha[-1] - alpha[0]) / TURN
        tells = len(time) / (2 * turned) if turned > 0 else math.inf
        notes = ("It turns backward: its sense is reversed.",) if backward else ()
        return cls(time, alpha, rate, tells, notes)


def _finite(name: str, values: Any) -> np.ndarray:
    """An array of finite numbers."""
    array = np.asarray(values, dtype=float).ravel()
    if not np.isfinite(array).all():
        place = int(np.flatnonzero(~np.isfinite(array))[0])
        raise SceneError(
            f"{name} no. {place + 1} is {array[place]}, must be a finite number."
        )
    return array


def _not_rising(time: np.ndarray) -> str:
    if len(time) < 3:
        return f"there are {len(time)} instants, must be at least 3. Give a record."
    place = int(np.flatnonzero(np.diff(time) <= 0)[0])
    return (
        f"time no. {place + 2} is {time[place + 1]:g} s after {time[place]:g} s, must"
        " increase. Sort the record, or leave one of the two out."
    )


def _check(
    record: _Record, orders: np.ndarray, cycles: int, turns: float, step_rpm: float
) -> None:
    """Refuse settings that a record cannot answer."""
    if cycles < FEWEST_CYCLES:
        raise SceneError(
            f"cycles is {shown(cycles)}, must be at least {FEWEST_CYCLES}: a block of"
            " one cycle cannot tell a rising speed from its lowest order."
        )
    if not step_rpm > 0:
        raise SceneError(f"step_rpm is {step_rpm:g} rpm, must be greater than 0 rpm.")
    turned = (record.alpha[-1] - record.alpha[0]) / TURN
    if turned < cycles * turns * (1 - 1e-9):
        raise SceneError(
            f"the record has {turned:.4g} revolutions, must have {cycles * turns:g}: a"
            f" block of {cycles} cycles. Give fewer cycles, or a longer record; the"
            " rotation itself must be in it."
        )
    if not len(orders):
        raise SceneError("highest is below the lowest order. Give a higher one.")
    if orders[-1] > BETWEEN * record.tells:
        raise SceneError(
            f"{2 * record.tells:.4g} samples a revolution tell orders up to"
            f" {BETWEEN * record.tells:.3g}, and order {orders[-1]:g} is asked for."
            " Give a lower highest order."
        )


def _check_marks(record: _Record, marks: np.ndarray, turns: float) -> None:
    """Refuse marks between which the rotor does not turn by a cycle."""
    inside = marks[(marks >= record.time[0]) & (marks <= record.time[-1])]
    if len(inside) < 2:
        return
    passed = np.interp(inside, record.time, record.alpha) / TURN
    between = float(np.median(np.diff(passed)))
    if abs(between - turns) > OFF_MARK * turns:
        raise SceneError(
            f"from mark to mark there are {between:.4g} revolutions, must be"
            f" {turns:g}: a mark comes once per cycle. Correct the number of pulses or"
            " the scale of the speed, the revolutions of the cycle, or the marks."
        )


@dataclass(frozen=True)
class _Block:
    """Orders of one block: coefficients of the even rotation, over times from
    ``middle`` on in units of ``scale``; c ``(K,)``; deviation ``(K,)`` of c;
    whether a mark has told the begin of its cycle.
    """

    middle: float
    scale: float
    even: np.ndarray
    c: np.ndarray
    orders: np.ndarray
    noise: np.ndarray
    span: tuple[float, float]
    marked: bool = False

    @classmethod
    def fitted(cls, record: _Record, part: slice, orders: np.ndarray) -> _Block | None:
        """Fit a block; None where it has too few samples."""
        time = record.time[part]
        unknowns = 2 * len(orders) + DEGREE + 1
        if len(time) < unknowns + 2:
            return None
        middle = (time[0] + time[-1]) / 2
        scale = (time[-1] - time[0]) / 2
        s = (time - middle) / scale
        even = np.polynomial.polynomial.polyfit(s, record.alpha[part], DEGREE)
        fit = _fit_angle if record.rate is None else _fit_rate
        for _ in range(MOST_STEPS):
            before = even
            even, c, left = fit(record, part, s, scale, even, orders)
            if np.abs(even - before).max() < STAYS * max(1.0, np.abs(even).max()):
                break
        deviation = math.sqrt(float(left @ left) / (len(time) - unknowns))
        noise: Any = deviation * math.sqrt(2 / len(time))
        if record.rate is None:
            noise = np.full(len(orders), noise)
        else:
            noise = noise / (orders * abs(even[1]) / scale)
        return cls(middle, scale, even, c, orders, noise, (time[0], time[-1]))

    @property
    def rpm(self) -> float:
        """Mean speed."""
        ends = np.polynomial.polynomial.polyval(np.array([-1.0, 1.0]), self.even)
        return float((ends[1] - ends[0]) / (2 * self.scale) * 60 / TURN)

    def from_mark(self, marks: np.ndarray, mark_deg: float, turns: float) -> _Block:
        """The block with theta from the begin of the cycle, where a mark is in it."""
        low, high = self.span
        inside = marks[(marks >= low) & (marks <= high)]
        offset = 0.0
        if len(inside):
            s = (inside - self.middle) / self.scale
            even = np.polynomial.polynomial.polyval(s, self.even)
            waves = np.exp(1j * even[:, None] * self.orders)
            # The mark passes where the rotor itself stands, vibration included.
            alpha = even + (waves @ self.c).real
            cycle = turns * TURN
            share = np.exp(TURN * 1j * (alpha - math.radians(mark_deg)) / cycle)
            offset = float(np.angle(share.mean())) * cycle / TURN
        return _Block(
            self.middle,
            self.scale,
            self.even,
            self.c * np.exp(1j * self.orders * offset),
            self.orders,
            self.noise,
            self.span,
            marked=bool(len(inside)),
        )


Fitted = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Coefficients of the even rotation, c ``(K,)``, and what is left of the samples."""


def _fit_angle(
    record: _Record,
    part: slice,
    s: np.ndarray,
    scale: float,
    even: np.ndarray,
    orders: np.ndarray,
) -> Fitted:
    """Fit samples of the angle."""
    phase = np.polynomial.polynomial.polyval(s, even)[:, None] * orders
    matrix = np.hstack(
        [s[:, None] ** np.arange(DEGREE + 1), np.cos(phase), -np.sin(phase)]
    )
    solution, left = _least_squares(matrix, record.alpha[part])
    c = solution[DEGREE + 1 :].reshape(2, -1)
    return solution[: DEGREE + 1], c[0] + 1j * c[1], left


def _fit_rate(
    record: _Record,
    part: slice,
    s: np.ndarray,
    scale: float,
    even: np.ndarray,
    orders: np.ndarray,
) -> Fitted:
    """Fit samples of the rate: d/dt Re(c exp(i k p)) = p' Re(i k c exp(i k p))."""
    assert record.rate is not None
    polynomial = np.polynomial.polynomial
    phase = polynomial.polyval(s, even)[:, None] * orders
    rate = (polynomial.polyval(s, polynomial.polyder(even)) / scale)[:, None] * orders
    powers = s[:, None] ** np.arange(DEGREE)
    matrix = np.hstack([powers, -rate * np.sin(phase), -rate * np.cos(phase)])
    solution, left = _least_squares(matrix, record.rate[part])
    c = solution[DEGREE:].reshape(2, -1)
    amplitudes = c[0] + 1j * c[1]
    # The angle at the middle is that of the integral of the rate.
    turned = polynomial.polyint(solution[:DEGREE] * scale)
    vibration = (np.exp(1j * phase) @ amplitudes).real
    turned[0] = np.mean(record.alpha[part] - polynomial.polyval(s, turned) - vibration)
    return turned, amplitudes, left


def _least_squares(
    matrix: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Solution, and what it leaves: normal equations of columns scaled alike, which are
    nearly orthogonal, and one refinement.
    """
    scaled = matrix / np.linalg.norm(matrix, axis=0)
    normal = scaled.T @ scaled
    solution = np.linalg.solve(normal, scaled.T @ values)
    left = values - scaled @ solution
    solution += np.linalg.solve(normal, scaled.T @ left)
    return solution / np.linalg.norm(matrix, axis=0), values - scaled @ solution


def _averaged(
    blocks: Sequence[_Block],
    orders: np.ndarray,
    step_rpm: float,
    phased: bool,
    coherent: bool,
    notes: tuple[str, ...],
) -> MeasuredOrders:
    """Average blocks in windows of the speed: complex amplitudes, or where these are
    not ``coherent`` the squares of their sizes.
    """
    speeds = np.array([block.rpm for block in blocks])
    windows = np.rint(speeds / step_rpm)
    chosen = [windows == window for window in np.unique(windows)]

    def mean(read: Callable[[_Block], Any]) -> np.ndarray:
        values = np.array([read(block) for block in blocks])
        return np.array([values[window].mean(axis=0) for window in chosen])

    counts = np.array([window.sum() for window in chosen])
    if coherent:
        angle = mean(lambda block: block.c)
    else:
        # The integral of a rate drifts: phases of blocks have no common zero. Noise,
        # of either part, adds to squares.
        squares = mean(lambda block: np.abs(block.c) ** 2 - 2 * block.noise**2)
        angle = np.sqrt(np.maximum(squares, 0.0)).astype(complex)
    return MeasuredOrders(
        rpm=mean(lambda block: block.rpm),
        orders=orders,
        angle=angle,
        noise=np.sqrt(mean(lambda block: block.noise**2) / counts[:, None]),
        blocks=counts,
        phased=phased,
        notes=notes,
    )

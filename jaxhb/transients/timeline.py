"""Time of a transient: the speed of the mean rotation, and blocks of equal steps.

Every block has :data:`STEPS` steps. Its acceleration is a polynomial over its time, a
constant where the speed is given as a table; borders of blocks lie at all corners: of
the speed, of the torques over it, of the events.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import jax
import numpy as np

from jaxhb._jax import Array, namespace
from jaxhb.elements.sentences import SceneError
from jaxhb.train.speeds import HIGHEST_RPM

STEPS = 64  # of a block
# Share of a block by which instants at its borders lie inside: events that jump at a
# border belong to one side of it.
INSIDE = 1e-9
# Blocks of a second, at least, however slow the train turns
SLOWEST = 4.0
# Borders nearer than this share of a transient are one.
SAME = 1e-12


@dataclass(frozen=True)
class SpeedTable:
    """Speed of the reference rotor, ``rpm`` ``(n,)`` linear between ``seconds``
    ``(n,)``, and the last one after the end.
    """

    seconds: np.ndarray
    rpm: np.ndarray

    def speed(self, seconds: Array) -> Array:
        """Speed in rpm."""
        return np.interp(seconds, self.seconds, self.rpm)

    def angle(self, seconds: Array) -> np.ndarray:
        """Angle in rad that the reference rotor has turned since 0 s."""
        omega = self.rpm * (np.pi / 30)
        turned = np.cumsum(np.diff(self.seconds) * (omega[1:] + omega[:-1]) / 2)
        at_rows = np.concatenate([[0.0], turned])
        place = np.searchsorted(self.seconds, seconds, side="right") - 1
        place = np.clip(place, 0, len(omega) - 1)
        since = seconds - self.seconds[place]
        now = np.interp(seconds, self.seconds, omega)
        return at_rows[place] + since * (omega[place] + now) / 2

    def times_of_speed(self, rpm: float) -> list[float]:
        """Times in s at which the speed passes ``rpm``."""
        return _crossings(self.seconds, self.rpm, rpm)

    def time_of_angle(self, angle: float) -> float:
        """Time in s at which the reference rotor has turned by ``angle`` rad; infinite
        where it never does.
        """
        omega = self.rpm * (np.pi / 30)
        at_rows = self.angle(self.seconds)
        place = max(int(np.searchsorted(at_rows, angle, side="right")) - 1, 0)
        left = angle - at_rows[place]
        rate = 0.0
        if place + 1 < len(omega):
            duration = self.seconds[place + 1] - self.seconds[place]
            rate = (omega[place + 1] - omega[place]) / duration
        # omega t + rate t^2 / 2 = left, without the cancellation of a small rate
        root = omega[place] + np.sqrt(max(omega[place] ** 2 + 2 * rate * left, 0.0))
        if root <= 0:
            return 0.0 if left <= 0 else np.inf
        return float(self.seconds[place] + 2 * left / root)


def _crossings(seconds: np.ndarray, values: np.ndarray, level: float) -> list[float]:
    """Times at which a quantity that is linear between rows passes a level."""
    before = values[:-1] - level
    after = values[1:] - level
    passing = np.flatnonzero(before * after < 0)
    share = before[passing] / (before[passing] - after[passing])
    return (seconds[passing] + share * np.diff(seconds)[passing]).tolist()


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Blocks:
    """Blocks of :data:`STEPS` steps each, ``(B,)``.

    begin : s; step : s; kind : index of the length of the step among the ``lengths``
    ``(K,)``; mode : index of the state of the cylinders; angle : rad turned by the
    reference rotor at the begin; omega : its speed at the begin in rad/s; acceleration
    ``(B, s)`` : rad/s2 at the Gauss nodes of the block, between which it is the
    polynomial through these.
    """

    begin: Array
    step: Array
    kind: Array
    mode: Array
    angle: Array
    omega: Array
    acceleration: Array

    @property
    def duration(self) -> Array:
        """Seconds of each block."""
        return STEPS * self.step

    def speeds(self, shares: np.ndarray) -> Array:
        """Speed ``(..., n)`` rad/s at shares ``(n,)`` of the blocks."""
        gained = self.acceleration @ self._weights(shares, integrals=1)
        return self.omega[..., None] + self.duration[..., None] * gained

    def accelerations(self, shares: np.ndarray) -> Array:
        """Angular acceleration ``(..., n)`` rad/s2 at shares ``(n,)`` of the blocks."""
        return self.acceleration @ self._weights(shares, integrals=0)

    def angles(self, shares: np.ndarray) -> Array:
        """Angle ``(..., n)`` rad at shares ``(n,)`` of the blocks."""
        gained = self.acceleration @ self._weights(shares, integrals=2)
        duration = self.duration[..., None]
        turned = self.omega[..., None] * shares + duration * gained
        return self.angle[..., None] + duration * turned

    def _weights(self, shares: np.ndarray, integrals: int) -> np.ndarray:
        """Weights ``(s, n)`` of the accelerations, see :func:`from_nodes`."""
        return from_nodes(self.acceleration.shape[-1], shares, integrals)


def gauss_nodes(count: int) -> np.ndarray:
    """Gauss nodes ``(count,)`` of a block, as shares of it."""
    return (np.polynomial.legendre.leggauss(count)[0] + 1) / 2


def from_nodes(count: int, shares: np.ndarray, integrals: int) -> np.ndarray:
    """Weights ``(count, n)`` with which values at the Gauss nodes give the polynomial
    through them at ``shares`` ``(n,)``, or its first or second integral from 0 on.
    """
    nodes, weights = np.polynomial.legendre.leggauss(count)
    at_nodes = np.polynomial.legendre.legvander(nodes, count - 1)
    # Legendre polynomials are orthogonal over the nodes.
    norms = np.arange(count) + 0.5
    coefficients = (at_nodes * weights[:, None] * norms).T
    if integrals:
        coefficients = np.polynomial.legendre.legint(
            coefficients, integrals, lbnd=-1, scl=0.5
        )
    return np.polynomial.legendre.legval(2 * np.asarray(shares) - 1, coefficients)


@dataclass(frozen=True)
class Grid:
    """Times of the blocks, on the host: begin ``(B,)`` s, kind ``(B,)``, and lengths
    ``(K,)`` s of the steps.
    """

    begin: np.ndarray
    kind: np.ndarray
    lengths: np.ndarray

    @property
    def step(self) -> np.ndarray:
        """Length of the steps of each block, s."""
        return self.lengths[self.kind]

    @property
    def borders(self) -> np.ndarray:
        """Begin of every block and the end of the last ``(B + 1,)`` s."""
        return np.append(self.begin, self.begin[-1] + STEPS * self.step[-1])


def grid(seconds: float, corners: Iterable[float], longest: float) -> Grid:
    """The :class:`Grid` over ``seconds``, with borders at the ``corners`` and steps of
    at most ``longest`` s.
    """
    inside = sorted(time for time in corners if 0 < time < seconds)
    borders = [0.0]
    for time in [*inside, seconds]:
        if time - borders[-1] > SAME * seconds:
            borders.append(time)
    borders[-1] = seconds
    longest = min(longest, 1 / SLOWEST / STEPS)
    begin = []
    step = []
    for first, last in zip(borders[:-1], borders[1:], strict=True):
        count = max(int(np.ceil((last - first) / (STEPS * longest) - 1e-9)), 1)
        begin.append(first + (last - first) / count * np.arange(count))
        step.append(np.full(count, (last - first) / count / STEPS))
    lengths, kind = np.unique(np.concatenate(step), return_inverse=True)
    return Grid(np.concatenate(begin), kind, lengths)


def blocks_of_table(grid: Grid, table: SpeedTable, mode: np.ndarray) -> Blocks:
    """The :class:`Blocks` of a given speed, whose rows are borders of blocks."""
    omega = table.speed(grid.borders) * (np.pi / 30)
    acceleration = np.diff(omega) / (STEPS * grid.step)
    return Blocks(
        begin=grid.begin,
        step=grid.step,
        kind=grid.kind,
        mode=mode,
        angle=table.angle(grid.begin),
        omega=omega[:-1],
        acceleration=acceleration[:, None],
    )


def padded(blocks: Blocks, count: int) -> Blocks:
    """Blocks with the last one repeated until there are ``count``."""
    xp = namespace(blocks)

    def longer(values: Array) -> Array:
        more = count - len(values)
        return xp.concatenate([values, xp.repeat(values[-1:], more, axis=0)])

    return jax.tree.map(longer, blocks)


def parts(count: int, size: int) -> Sequence[range]:
    """Ranges of at most ``size`` that cover ``count``."""
    return [range(first, min(first + size, count)) for first in range(0, count, size)]


def speed_table(
    seconds: float, speed: float | Sequence[Sequence[float]], rpm: float | None
) -> SpeedTable:
    """The :class:`SpeedTable` of a speed as it is given."""
    check_seconds(seconds)
    if rpm is not None:
        raise SceneError(
            'transient: rpm is the first speed of speed="free": leave it out.'
        )
    if np.ndim(speed) == 0:
        rows = np.array([[0.0, speed], [seconds, speed]], dtype=float)
    else:
        rows = np.array(speed, dtype=float)
    if rows.ndim != 2 or rows.shape[1] != 2:
        raise SceneError(
            "transient: speed must be rows of (s, rpm), as [(0, 60), (9, 120)]."
        )
    for before, after in zip(rows[:-1, 0], rows[1:, 0], strict=True):
        if not after > before:
            raise SceneError(
                f"transient: the row of speed at {after:g} s follows that at"
                f" {before:g} s: times must increase."
            )
    for time, value in rows:
        if not (np.isfinite(value) and 0 <= value <= HIGHEST_RPM):
            raise SceneError(
                f"transient: the speed at {time:g} s is {value:g} rpm, must be from 0"
                f" to {HIGHEST_RPM:.0f} rpm: no train turns backwards."
            )
    if rows[0, 0] < 0:
        raise SceneError(
            f"transient: the first row of speed is at {rows[0, 0]:g} s, must be at 0 s"
            " or later."
        )
    if rows[0, 0] > 0:
        rows = np.concatenate([[[0.0, rows[0, 1]]], rows])
    if rows[-1, 0] < seconds:
        rows = np.concatenate([rows, [[seconds, rows[-1, 1]]]])
    whole = SpeedTable(rows[:, 0], rows[:, 1])
    inside = rows[:, 0] < seconds
    times = np.append(rows[inside, 0], seconds)
    table = SpeedTable(times, np.asarray(whole.speed(times)))
    if not table.rpm.any():
        raise SceneError("transient: the speed is 0 rpm throughout: nothing turns.")
    return table


def check_seconds(seconds: float) -> None:
    """Refuse a duration that is none."""
    if not (np.isfinite(seconds) and seconds > 0):
        raise SceneError(
            f"transient: seconds is {seconds:g}, must be greater than 0 s."
        )

"""End of a march: the period that its motion has, approaches, or does not have. Host
arithmetic.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

# Closure errors are shares of the largest deflection and the gap. Soft springs to
# ground and heavy disks on soft shafts settle over hundreds of cycles, of which the
# teeth see little: what is left is solved by harmonic balance, whatever the rate of
# decay.

PERIODIC = 5e-5  # closure error at which a motion that does not leave it has a period
NEAR = 3e-4  # closure error below which it has a period that it approaches
# Closure error, still falling, below which a march that ends may be near a motion to
# which it goes on: worth the question of whether that motion attracts.
CLOSE = 0.02
SMALL = 0.3  # closure error above which a decay shows nothing
ROUNDED = 1e-9  # closure error that rounding leaves
# Share to which the closure error falls from one window of cycles to the next, twice,
# where a motion approaches a period; past a motion that repels in one direction the
# fall slows down.
FALLING = 0.8
DECAYING = 0.95  # the same where it may still do so
# Growth of the closure error from one window to the next that still counts as none
LEAVING = 1.05
# Cycles in a window at least (as many as the period has), and cycles after which one is
# looked for, at most.
WINDOW = 3
LONGEST_PERIOD = 8

PERIODS = range(1, LONGEST_PERIOD + 1)

# Latest cycles that closure errors are read from: three windows and the longest period.
READ = 3 * max(WINDOW, LONGEST_PERIOD) + LONGEST_PERIOD
# Cycles before a record, fewest and most, and steps times modes that these may take
# beyond the fewest.
TRANSIENT = (64, 1024)
WORK = 4e6
# Times the decay of the slowest mode that teeth notice, that a transient is given
DECAYS = 16.0
# Cycles of a transient for the sake of such modes, at most: where cycles take long, and
# where they do not; steps times modes that these may take beyond the fewer, some
# seconds.
SLOWEST = (512, 10_000)
SLOW_WORK = 4e7


# Cycles of a record by default, and of one whose extremes vary: by two standard
# deviations of more than this share.
RECORDED = 64
LONGER = 256
SPREAD = 0.05


@dataclass(frozen=True)
class Cycles:
    """Largest length of a march, in cycles of the excitation.

    Parameters
    ----------
    transient : int, optional
        Cycles before the record, by default 64 to 1024, more of them for trains whose
        cycles are cheap; where a mode that teeth notice decays slowly, sixteen times
        its decay, up to 512 if cycles take long and 10,000 if not.
    recorded : int, optional
        Cycles of the record of a motion that does not return, at least; by default 64,
        and 256 where the largest tooth forces of parts of them tell that those of
        another record would differ by more than 5 %.
    most : int
        Cycles while closure errors still fall, with each length of steps.
    """

    transient: int | None = None
    recorded: int | None = None
    most: int = 256

    def before_record(self, work: float, decay: float) -> int:
        """Cycles before the record, for ``work`` steps times modes a cycle and
        ``decay`` cycles in which the slowest mode that teeth notice falls by the factor
        e.
        """
        if self.transient is not None:
            return self.transient
        shortest, longest = SLOWEST
        most = np.clip(SLOW_WORK / work, shortest, longest)
        fewest, usual_most = TRANSIENT
        usual = np.clip(WORK / work, fewest, usual_most)
        return int(max(usual, min(DECAYS * decay, most)))


class Closure:
    """Closure of a march: how nearly its cycles close, cycle by cycle.

    A cycle is represented by (l, l') ``(I, 2G)`` of its meshes at I equidistant time
    samples, a reconstruction of the state by delays: motion that no mesh sees, free
    rotation above all, does not count. The closure error of period k is the largest
    difference from the cycle k before, relative to the largest of that quantity and the
    gap (``floor``, ``(2G,)`` in m and m/s).
    """

    def __init__(self, floor: np.ndarray):
        self.floor = floor
        self.cycles: list = []

    def add(self, samples: Iterable[np.ndarray]) -> None:
        """Add cycles ``(cycles, I, 2G)``, and drop those that no closure error reads
        any more.
        """
        self.cycles = (self.cycles + list(samples))[-READ:]

    @property
    def finite(self) -> bool:
        """Whether the motion stayed finite."""
        return bool(np.isfinite(self.cycles[-1]).all())

    @property
    def scale(self) -> np.ndarray:
        """Size ``(2G,)`` of deflections and rates."""
        return (
            np.abs(np.array(self.cycles[-2 * LONGEST_PERIOD :])).max(axis=(0, 1))
            + self.floor
        )

    def errors(self, k: int, scale: np.ndarray | None = None) -> list[float]:
        """Largest closure error of period k in each of the last three windows, the
        latest first; inf for a window that is not complete.
        """
        window = max(WINDOW, k)
        scale = self.scale if scale is None else scale
        last = np.array(self.cycles[-3 * window - k :])
        change = (np.abs(last[k:] - last[:-k]) / scale).max(axis=(1, 2))[::-1]
        windows = (change[i * window : (i + 1) * window] for i in range(3))
        return [
            float(part.max()) if len(part) == window else np.inf for part in windows
        ]

    def period(self) -> int:
        """The smallest period in cycles that the motion has or approaches; 0 where
        there is none yet.

        Where the motion still approaches a divisor of a period it may well have that
        divisor as its period: beside a period doubling it nearly returns after two
        cycles while it settles on the period of one.
        """
        errors = self._errors_by_period()
        for k in PERIODS:
            waits = any(k % j == 0 and decaying(errors[j]) for j in PERIODS if j < k)
            # As fast as a decay is, and the passage of a motion that repels is not.
            if (periodic(errors[k]) or falling(errors[k], NEAR, FALLING)) and not waits:
                return k
        return 0

    def period_at_end(self, close: float = NEAR) -> int:
        """The smallest period that the motion has or approaches, however slowly, from a
        closure error of ``close`` on; 0 where there is none: the march goes on no
        longer.
        """
        errors = self._errors_by_period()
        return next(
            (
                k
                for k in PERIODS
                if periodic(errors[k]) or falling(errors[k], close, 1.0)
            ),
            0,
        )

    def undecided(self) -> bool:
        """Whether the motion may still settle on a period: a closure error is small and
        keeps falling.
        """
        return any(map(decaying, self._errors_by_period().values()))

    def _errors_by_period(self) -> dict[int, list[float]]:
        """Closure errors of the last three windows by period."""
        scale = self.scale
        return {k: self.errors(k, scale) for k in PERIODS}


def periodic(errors: Sequence[float]) -> bool:
    """Whether the latest closure error, of those of successive windows, is small and
    not on its way out.
    """
    now, before, _ = errors
    return now <= PERIODIC and now <= LEAVING * before < np.inf or now <= ROUNDED


def falling(errors: Sequence[float], close: float, share: float) -> bool:
    """Whether closure errors of successive windows, the latest first and below
    ``close``, fall to a share each.
    """
    now, before, first = errors
    return now <= close and now <= share * before and before <= share * first < np.inf


def decaying(errors: Sequence[float]) -> bool:
    """Whether closure errors may be those of an approach: they fall, if slowly."""
    return falling(errors, SMALL, DECAYING)

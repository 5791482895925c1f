"""Whether a marched motion returns: the period that it has, approaches, or does not have. Host arithmetic."""

import numpy as np

PERIODS = tuple(range(1, 9))
"""Cycles after which a return is looked for."""

SETTLED, NEAR = 5e-5, 3e-4
"""Return error at which a motion that does not leave it has a period, and below which it has one that it approaches.

Soft springs to ground and heavy disks on soft shafts settle over hundreds of cycles, of which the teeth see little:
what is left is solved by harmonic balance, whatever the rate of decay."""

FALLING, DECAYING = 0.8, 0.95
"""Share to which the return error falls from one window of cycles to the next, twice, where a motion approaches a
period (past a motion that repels in one direction the fall slows down), and where it may still do so."""

LEAVING, ROUNDED = 1.05, 1e-9
"""Growth of the return error from one window to the next that still is none; return error that rounding leaves."""

SMALL = 0.3
"""Return error above which a decay tells nothing."""

WINDOW = 3
"""Cycles in a window at least; as many as the period has."""


class Returns:
    """Return errors of a march, told cycle by cycle.

    A cycle is known by (l, l') ``(I, 2G)`` of its meshes at I equidistant instants, a reconstruction of the state by
    delays: motion that no mesh sees, free rotation above all, does not count. The return error after k cycles is the
    largest difference from the cycle k before, relative to the largest of that quantity and the gap (``floor``,
    ``(2G,)`` in m and m/s).
    """

    def __init__(self, floor):
        self.floor = floor
        self.cycles = []

    def add(self, seen):
        """Take in cycles ``(cycles, I, 2G)``."""
        self.cycles += list(seen)

    @property
    def finite(self):
        """Whether the motion stayed finite."""
        return bool(np.isfinite(self.cycles[-1]).all())

    @property
    def scale(self):
        """Size ``(2G,)`` of deflections and rates."""
        return np.abs(np.array(self.cycles[-2 * PERIODS[-1] :])).max(axis=(0, 1)) + self.floor

    def errors(self, k):
        """Largest return error after k cycles in each of the last three windows, the latest first; else inf."""
        window = max(WINDOW, k)
        found = []
        for last in (len(self.cycles) - i * window for i in range(3)):
            pairs = [(c, c - k) for c in range(last - window, last)]
            known = pairs[0][1] >= 0
            found.append(max(self._error(*pair) for pair in pairs) if known else np.inf)
        return found

    def _error(self, one, other):
        return float((np.abs(self.cycles[one] - self.cycles[other]) / self.scale).max())

    def period(self, last=False):
        """The smallest period in cycles that the motion has or approaches; 0 where there is none yet.

        ``last``: the march ends here, and however slow an approach counts.

        Where the motion still approaches a divisor of a period it may well have that one: beside a period doubling it
        nearly returns after two cycles while it settles on the period of one.
        """
        errors, falling = {k: self.errors(k) for k in PERIODS}, 1.0 if last else FALLING
        for k, (now, before, first) in errors.items():
            settled = now <= SETTLED and now <= LEAVING * before < np.inf or now <= ROUNDED
            near = now <= NEAR and now <= falling * before and before <= falling * first < np.inf
            waits = not last and any(k % j == 0 and decaying(errors[j]) for j in PERIODS if j < k)
            if (settled or near) and not waits:
                return k
        return 0

    def undecided(self):
        """Whether the motion may still settle on a period: a return error is small and keeps falling."""
        return any(decaying(self.errors(k)) for k in PERIODS)


def decaying(errors):
    """Whether return errors of successive windows, the latest first, fall."""
    now, before, first = errors
    return now <= SMALL and now <= DECAYING * before and before <= DECAYING * first < np.inf

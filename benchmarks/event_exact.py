"""Event-exact motion of one pair of gears with backlash, an oracle of what it does
after it has run long enough.

Lengths are in units of half the backlash, forces in stiffness x half the backlash,
times in 1 / natural frequency:

    x'' + 2 zeta x' + g(x) = mean + Re(alternating e^{i Omega t}),
    g = epsilon x in the gap |x| <= 1,  sign(x) (|x| - 1 + epsilon) in contact

This is law (18) of :mod:`jaxhb.equations.backlash` for a transition of width 0. On each
piece of the law the motion has a closed form. Its turning points are searched with
steps too short to pass one, for which |x'''| has a bound; between two of them x is
monotone, so that a knot is crossed once or not at all, however close they are. The
linearised motion is the product of the closed forms too: x'' is continuous at a knot,
or jumps by a multiple of x' (damping in contact only), which adds one shear. Nothing
here is shared with jaxhb. ``lightly_loaded.py`` tabulates a family with it.
"""

import cmath
import math
from dataclasses import dataclass

import numpy as np

SHORTEST = 1e-9
"""Time in which a speed that is about to change its sign changes by less than the
rounding of a speed.
"""

RETURNS = 1e-9
"""A state that returns this closely may be periodic: Newton's method decides. An
irregular motion of dimension D comes back to one of its last states so closely in about
1e-9^D of the cycles, D > 1: not once in a record.
"""

LONGEST = 8
"""Cycles of the longest subharmonic motion; a longer period counts as irregular."""

LONGEST_SOUGHT = 64
"""Cycles of the longest period that is told from an aperiodic motion."""


@dataclass(frozen=True)
class Pair:
    """The pair at one speed: damping ratio, mean and alternating force (complex),
    frequency, law in the gap.

    damped_gap : True, the damper always acts (damping law "always"); False, in contact
    only ("contact")
    """

    frequency: float
    damping_ratio: float = 0.05
    mean: float = 0.25
    alternating: complex = 0.5
    epsilon: float = 0.0
    damped_gap: bool = True

    @property
    def cycle(self):
        return 2 * math.pi / self.frequency

    def stiffness(self, piece):
        return 1.0 if piece else self.epsilon

    def damping(self, piece):
        return self.damping_ratio if piece or self.damped_gap else 0.0


class Arc:
    """Motion on one piece of the law (-1, 0, 1) from (x, v) at time t.

    y = x - Re(P e^{i Omega t}) obeys y'' + 2 d y' + k y = load: y = y0 + y0' s + (load
    - k y0) q with s'' + 2 d s' + k s = 0, s(0) = 0, s'(0) = 1 and q the integral of s.
    The rounding of q is 1e-16 / k: give an epsilon of 0, or not far below 1e-3.
    """

    def __init__(self, pair, piece, t, x, v):
        self.k, self.d, self.frequency = (
            pair.stiffness(piece),
            pair.damping(piece),
            pair.frequency,
        )
        self.load = pair.mean + piece * (1 - pair.epsilon)
        receptance = 1 / (self.k - self.frequency**2 + 2j * self.d * self.frequency)
        self.forced = pair.alternating * receptance * cmath.exp(1j * self.frequency * t)
        self.x0 = x - self.forced.real
        self.v0 = v + self.frequency * self.forced.imag
        self.pull = self.load - self.k * self.x0
        self.root = math.sqrt(abs(self.k - self.d**2))

    def basis(self, tau):
        """s, s' and q."""
        decay = math.exp(-self.d * tau)
        angle = self.root * tau
        if angle == 0:
            s = tau
            even = 1.0
        elif self.k > self.d**2:
            s = math.sin(angle) / self.root
            even = math.cos(angle)
        else:
            s = math.sinh(angle) / self.root
            even = math.cosh(angle)
        s = decay * s
        even = decay * even
        if self.k:
            return s, even - self.d * s, (1 - even - self.d * s) / self.k
        return s, even - self.d * s, (tau - s) / (2 * self.d) if self.d else tau**2 / 2

    def at(self, tau):
        """x, x', x'' and the free parts y'' and y'''."""
        s, rate, q = self.basis(tau)
        y = self.x0 + self.v0 * s + self.pull * q
        w = self.v0 * rate + self.pull * s
        free = self.load - self.k * y - 2 * self.d * w
        forced = self.forced * cmath.exp(1j * self.frequency * tau)
        frequency = self.frequency
        x = y + forced.real
        v = w - frequency * forced.imag
        a = free - frequency**2 * forced.real
        return x, v, a, free, -2 * self.d * free - self.k * w

    def tangent(self, tau):
        """d (x, x')(tau) / d (x, x')(0)."""
        s, rate, _ = self.basis(tau)
        return np.array([[rate + 2 * self.d * s, s], [-self.k * s, rate]])


def next_turn(arc, limit):
    """First time up to ``limit`` at which x' changes its sign, else the limit; and that
    sign before.

    |y'''| <= |y'''_0| + k |y''_0| L for a time L, because |s'| <= 1 and |s| <= L.
    """
    tau = 0.0
    window = 1 / max(1.0, arc.frequency)
    forced = abs(arc.forced) * arc.frequency**3
    _, v, a, free, jerk = arc.at(0.0)
    sign = math.copysign(1.0, v if v else a)
    while tau < limit:
        speed = max(sign * v, 0.0)
        slope = sign * a
        bound = forced + abs(jerk) + arc.k * abs(free) * window + 1e-300
        reach = math.sqrt(slope**2 + 2 * bound * speed)
        step = 2 * speed / (reach - slope) if slope < 0 else (reach + slope) / bound
        if step < SHORTEST and slope < 0:
            return min(tau + step, limit), sign
        tau += min(max(step, SHORTEST), window)
        _, v, a, free, jerk = arc.at(tau)
    return limit, sign


def crossing(arc, level, sign, end):
    """Time in [0, end] at which x, monotone there, passes ``level``: Newton's method,
    held in a shrinking bracket.
    """
    low = 0.0
    high = end
    tau = end / 2
    for _ in range(200):
        x, v, *_ = arc.at(tau)
        beyond = sign * (x - level)
        low, high = (low, tau) if beyond > 0 else (tau, high)
        newton = tau - (x - level) / v if v else math.inf
        before = tau
        tau = newton if low <= newton <= high else (low + high) / 2
        if abs(tau - before) <= 4e-16 * max(end, 1.0):
            break
    return tau


@dataclass(frozen=True)
class Stretch:
    """A stretch of motion: state (x, x') at its end, tangent map, extremes of x, shares
    of time in the gap and on the reverse flank, impacts (from the gap into contact).
    """

    state: tuple
    tangent: np.ndarray
    minimum: float
    maximum: float
    separated: float
    reverse: float
    impacts: int


def advance(pair, state, begin, end):
    """The motion from the state (x, x') at time ``begin`` to ``end``."""
    t = begin
    (x, v) = map(float, state)
    piece = int(math.copysign(1, x)) if abs(x) > 1 or (abs(x) == 1 and x * v > 0) else 0
    seen = [x]
    tangent = np.eye(2)
    shares = {-1: 0.0, 0: 0.0, 1: 0.0}
    impacts = 0
    while t < end:
        arc = Arc(pair, piece, t, x, v)
        tau, sign = next_turn(arc, end - t)
        level = piece or sign
        last = tau == end - t
        after = piece
        x, v, *_ = arc.at(tau)
        if (piece == 0 or sign == -piece) and sign * (x - level) > 0:
            tau = crossing(arc, level, sign, tau)
            last = False
            after = piece + int(sign)
            x = level
            v = sign * max(sign * arc.at(tau)[1], 0.0)
            impacts += after != 0
        elif not last:
            v = 0.0
        seen.append(x)
        tangent = shear(pair, piece, after) @ arc.tangent(tau) @ tangent
        shares[piece] += tau / (end - begin)
        t = end if last else t + tau
        piece = after
    return Stretch(
        (x, v), tangent, min(seen), max(seen), shares[0], shares[-1], impacts
    )


def shear(pair, before, after):
    """What the jump of x'' at a knot adds to the tangent map: that of 2 d x', as the
    elastic force does not jump.
    """
    return np.array(
        [[1.0, 0.0], [2 * (pair.damping(before) - pair.damping(after)), 1.0]]
    )


def cycle(pair, state):
    """One cycle of the excitation, from t = 0."""
    return advance(pair, state, 0.0, pair.cycle)


def samples(pair, state, count):
    """x at ``count`` even times of the cycle from a state at t = 0."""
    times = pair.cycle * np.arange(count) / count
    found = [state]
    for begin, end in zip(times[:-1], times[1:], strict=True):
        found.append(advance(pair, found[-1], begin, end).state)
    return np.array([x for x, _ in found])


def march(pair, state, cycles):
    """That many cycles one after the other."""
    found = []
    for _ in range(cycles):
        found.append(cycle(pair, found[-1].state if found else state))
    return found


def product(cycles):
    """Tangent map over several cycles."""
    tangent = np.eye(2)
    for one in cycles:
        tangent = one.tangent @ tangent
    return tangent


def orbit(pair, state, period=1, steps=40):
    """The periodic motion near a state, stable or not, by Newton's method on the exact
    map; its cycles, or None.
    """
    state = np.array(state, float)
    best = (math.inf, None)
    for _ in range(steps):
        cycles = march(pair, state, period)
        change = np.array(cycles[-1].state) - state
        error = np.abs(change).max()
        if not error < 1e6 or (error >= best[0] and best[0] < 1e-12):
            break
        if error < best[0]:
            best = error, cycles
        # least squares: a motion that stays in a gap without a spring has the
        # multiplier 1
        state = (
            state - np.linalg.lstsq(product(cycles) - np.eye(2), change, rcond=None)[0]
        )
    return best[1] if best[0] < 1e-12 else None


def multipliers(cycles):
    """Floquet multipliers of a periodic motion, the largest first."""
    return sorted(
        np.linalg.eigvals(product(cycles)).tolist(),
        key=lambda value: (-abs(value), -value.imag),
    )


def lyapunov_exponent(cycles):
    """Largest Lyapunov exponent per cycle: mean growth of the logarithm of a tangent
    vector.
    """
    vector = np.array([1.0, 0.3])
    total = 0.0
    for one in cycles:
        vector = one.tangent @ vector
        size = np.linalg.norm(vector)
        vector = vector / size
        total = total + math.log(size)
    return total / len(cycles)


@dataclass(frozen=True)
class Motion:
    """What the pair does after it has run long enough.

    kind : "contact", "periodic", "subharmonic" (2 to 8 cycles) or "irregular"; period
    in cycles, 0 where there is none (an irregular motion may have one of 9 to 64);
    cycles : one period, or the record; marched : cycles until known
    """

    kind: str
    period: int
    cycles: list
    marched: int

    @property
    def state(self):
        return self.cycles[-1].state

    @property
    def minimum(self):
        return min(one.minimum for one in self.cycles)

    @property
    def maximum(self):
        return max(one.maximum for one in self.cycles)

    @property
    def exponent(self):
        """Largest Lyapunov exponent per cycle."""
        if self.period:
            return math.log(abs(multipliers(self.cycles)[0])) / self.period
        return lyapunov_exponent(self.cycles)


def returned(states):
    """Smallest number of cycles after which the last of the states had been there; 0 if
    it never had.
    """
    x, v = states[-1]
    back = range(2, min(LONGEST_SOUGHT + 1, len(states)) + 1)
    return next(
        (
            k - 1
            for k in back
            if abs(states[-k][0] - x) < RETURNS and abs(states[-k][1] - v) < RETURNS
        ),
        0,
    )


def long_run(pair, state, *, transient=8192, record=4096):
    """March from a state until it is periodic, ``transient + record`` cycles at most;
    the record if it never is.

    A periodic motion is the one to which Newton's method goes from there, if it is near
    and its multipliers lie within the unit circle. A record whose exponent is not above
    0 tells that the march was too short for its period.
    """
    states = [tuple(state)]
    cycles = []
    for count in range(1, transient + record + 1):
        cycles.append(cycle(pair, states[-1]))
        states.append(cycles[-1].state)
        period = returned(states)
        found = shortest(orbit(pair, states[-1], period)) if period else None
        if (
            found
            and np.abs(np.subtract(found[-1].state, states[-1])).max() < 1e-5
            and abs(multipliers(found)[0]) < 1
        ):
            return Motion(kind_of(found), len(found), found, count)
    return Motion("irregular", 0, cycles[transient:], transient + record)


def shortest(cycles):
    """The cycles of one period: a fast motion may return after a multiple of its period
    first.
    """
    return (
        cycles
        and cycles[
            -(
                returned([cycles[-1].state] + [one.state for one in cycles])
                or len(cycles)
            ) :
        ]
    )


def kind_of(cycles):
    """Kind of a periodic motion."""
    if len(cycles) > LONGEST:
        return "irregular"
    apart = any(one.separated or one.reverse for one in cycles)
    return "subharmonic" if len(cycles) > 1 else "periodic" if apart else "contact"

"""The variational equation around a given periodic motion in the damped modes of the
train, interval by interval.

    z' = rates z + forcing u,     u_c = slope_c(t) w_c,     w = Re(observation z)

(:mod:`jaxhb.floquet.slopes`). In an interval of length h, u and w are polynomials of
degree below Q, sums of Legendre polynomials (Galerkin):

    w_p = O_p z + sum_q R_pq u_q,     u_q = sum_p T_qp w_p,
    z <- exp(rates h) z + sum_q B_q u_q.

O, R and B are exact integrals of the exponentials of the modes, T of the slopes. Only
what reactions see is approximated: as its remainder and that of the adjoint are
orthogonal to all polynomials, the error at the end of an interval is of order 2 Q in h
where slopes are smooth. So that they are, intervals end where a motion passes knots,
rounded to a fine grid, in which there are few different lengths. Reactions that are
zero in an interval take no part.

Measured on ``gear_train_30``, 54 states and 452 passages of knots at 1833 rpm: 884
intervals, under a third of the time of the dense equation
(:mod:`jaxhb.floquet.variational`). A step is four products of numpy: compiled, as a
loop of jax that takes all reactions in every interval, it is no faster. Three degrees
and one more interval in three cost the same and leave ten times the error; breaks in
the middle of the smooth zone alone, a fifth fewer, fifty times.
"""

from __future__ import annotations

from functools import cache
from math import factorial

import numpy as np
from numpy.polynomial import legendre

from jaxhb.balance.sweeps import fastest_rate
from jaxhb.equations.state_space import ComplexModes
from jaxhb.floquet.slopes import Reactions, SampledMotion, moments
from jaxhb.floquet.variational import Monodromy

DEGREES = 4  # Q
# Intervals per period of the fastest mode in which teeth move, or of a mesh on the
# stiffest reaction, and per cycle: errors of multipliers of gear_train_30 are below
# 1e-4 of the largest.
PER_PERIOD = 2.2
FEWEST = 256
# Multiple of the fastest rate up to which intervals follow a mesh on its reactions
STIFFEST = 8.0
GRID = 32  # grid steps of the longest interval
CHUNK = 4096  # intervals that are prepared at a time
# Modulus of rates h up to which integrals are power series, and the number of their
# terms: exact to rounding
REACH = 4.0
TERMS = 40
# Largest decay in an interval of a mode whose share in the determinant of an interval
# is counted
LIVELY = 2.0


def monodromy(
    modes: ComplexModes, reactions: Reactions, deflection: np.ndarray, frequency: float
) -> Monodromy:
    """The :class:`~jaxhb.floquet.variational.Monodromy` in the states of
    :func:`real_states`; on the host.

    deflection : complex ``(G, N+1)`` m, the motion of the meshes; frequency : Omega in
    rad/s.
    """
    motion = SampledMotion(reactions, deflection, frequency)
    length, step = _lengths(
        motion, fewest_intervals(modes, reactions, frequency), frequency
    )
    edges = np.concatenate([[0], np.cumsum(length)])
    slope = moments(reactions, motion, edges / edges[-1], 2 * DEGREES - 1)
    lengths, index = np.unique(length, return_inverse=True)
    weights = _Weights(modes, reactions, lengths * step)
    state = _real_states(modes.rates)
    log_determinant = 0.0
    for first in range(0, len(length), CHUNK):
        chosen = slice(first, first + CHUNK)
        log_determinant += weights.march(state, slope[:, chosen], index[chosen])
    doubled = np.where(modes.rates.imag == 0, 1.0, 2.0)
    free = float(doubled @ modes.rates.real) * 2 * np.pi / frequency
    seen = modes.observation[reactions.observed]
    at_once = np.einsum("cm,mc->c", seen, reactions.forcing).real
    trace = free + float((at_once @ slope[..., 0]) @ (length * step))
    return Monodromy(
        state[:, _real_columns(modes.rates)].T, free + log_determinant, trace
    )


def real_states(modes: ComplexModes, vectors: np.ndarray) -> np.ndarray:
    """Vectors ``(r, m)`` of the modes as columns ``(r, n)`` of their real states: real
    and imaginary parts of those that turn, real parts of others.
    """
    pairs = np.stack([vectors.real, -vectors.imag], axis=-1).reshape(len(vectors), -1)
    return pairs[:, _real_columns(modes.rates)]


def _real_columns(rates: np.ndarray) -> np.ndarray:
    """Mask ``(2m,)`` of the parts of all modes, real and imaginary in turn, that are
    states.
    """
    return np.stack([np.ones(len(rates), bool), rates.imag != 0], axis=-1).ravel()


def _real_states(rates: np.ndarray) -> np.ndarray:
    """Unit states ``(n, 2m)``, by rows."""
    return np.eye(2 * len(rates))[_real_columns(rates)]


def fewest_intervals(
    modes: ComplexModes, reactions: Reactions, frequency: float
) -> int:
    """Intervals of a cycle in which teeth pass no knots."""
    meshes = len(modes.observation) // 2
    seen = modes.observation[meshes:][reactions.mesh]
    # In 1/kg, of a force on its mesh
    lightness = np.einsum("cm,mc->c", seen, modes.forcing[:, reactions.mesh]).real
    stiff = np.abs(lightness) * reactions.stiffest
    stiffest = np.where(reactions.observed >= meshes, stiff, np.sqrt(stiff)).max()
    variation = reactions.meshes.variation
    varied = 0 if variation is None else variation.shape[-1] - 1
    fastest = max(
        fastest_rate(modes), varied * frequency, FEWEST / PER_PERIOD * frequency
    )
    # What is far stiffer, such as friction that sticks, holds a mesh within an
    # interval: polynomials do that, too.
    fastest = max(fastest, min(stiffest, STIFFEST * fastest))
    return int(np.ceil(PER_PERIOD * fastest / frequency))


def _lengths(
    motion: SampledMotion, fewest: int, frequency: float
) -> tuple[np.ndarray, float]:
    """Lengths ``(K,)`` of the intervals of a cycle in steps of a grid, and its step in
    s.
    """
    grid = GRID * fewest
    ends = np.unique(np.append(np.rint(motion.share * grid).astype(int) % grid, 0))
    arc = np.diff(np.append(ends, grid))
    count = -(-arc // GRID)
    number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    share = number * np.repeat(arc, count) // np.repeat(count, count)
    begin = np.repeat(ends, count) + share
    return np.diff(np.append(begin, grid)), 2 * np.pi / frequency / grid


class _Weights:
    """O, R and B of intervals of a few lengths ``(k,)`` s; the C Q polynomials in the
    order of the reactions.

    observed, pushed : ``(k, C Q, 2m)``, O and the transposed B, of real and imaginary
    parts of the modes in turn; response, around : ``(k, C Q, C Q)``, R and O exp(-rates
    h) B; decay : complex ``(k, m)``.
    """

    def __init__(self, modes: ComplexModes, reactions: Reactions, length: np.ndarray):
        seen = modes.observation[reactions.observed]
        forcing = reactions.forcing.T
        lengths = len(length)
        size = len(seen) * DEGREES
        x = length[:, None] * modes.rates
        moment, repeated = _exponential_integrals(x.ravel())
        moment = moment.reshape(x.shape + moment.shape[1:])
        repeated = repeated.reshape(x.shape + repeated.shape[1:])
        norm = 2 * np.arange(DEGREES) + 1
        by_degree = (moment * norm).transpose(0, 2, 1)[:, None]
        observed = (seen[:, None] * by_degree).reshape(lengths, size, -1)
        by_degree = (moment * (-1.0) ** np.arange(DEGREES)).transpose(0, 2, 1)[:, None]
        pushed = (forcing[:, None] * by_degree).reshape(lengths, size, -1)
        pushed = length[:, None, None] * pushed
        pairs = (seen[:, None] * forcing).reshape(-1, len(modes.rates)).T
        by_degree = (repeated * norm[:, None]).reshape(x.shape + (-1,))
        response = (by_degree.transpose(0, 2, 1) @ pairs).real.reshape(
            lengths, DEGREES, DEGREES, len(seen), len(seen)
        )
        response = response.transpose(0, 3, 1, 4, 2).reshape(lengths, size, size)
        self.response = length[:, None, None] * response
        lively = np.abs(x.real) <= LIVELY
        grown = np.exp(-np.maximum(x.real, -LIVELY) - 1j * x.imag)
        back = np.where(lively, grown, 0.0)
        self.around = ((observed * back[:, None]) @ pushed.transpose(0, 2, 1)).real
        self.decay = np.exp(x)
        self.pushed = np.ascontiguousarray(pushed).view(float)
        self.observed = np.ascontiguousarray(observed.conj()).view(float)

    def march(self, state: np.ndarray, slope: np.ndarray, index: np.ndarray) -> float:
        """Take states ``(n, 2m)``, by rows, through intervals of lengths ``index``
        ``(K,)`` with moments of slopes ``(C, K, 2Q-1)``; give the logarithm of the
        determinant over that of the modes by themselves.
        """
        coupling = (slope @ _PRODUCTS).reshape(slope.shape[:2] + (DEGREES, DEGREES))
        acting = (slope != 0).any(axis=-1)
        patterns, kind = np.unique(acting.T, axis=0, return_inverse=True)
        steps: list[tuple[np.ndarray, np.ndarray] | None] = [None] * len(index)
        log_determinant = 0.0
        number = np.arange(len(self.decay))
        index = index.astype(int)
        for pattern in np.flatnonzero(patterns.any(axis=1)):
            chosen = np.flatnonzero(patterns[pattern])
            members = np.flatnonzero(kind.ravel() == pattern)
            rows = (DEGREES * chosen[:, None] + np.arange(DEGREES)).ravel()
            block = np.ix_(number, rows, rows)
            length = index[members]
            response = self.response[block][length]
            answer = _answers(coupling[chosen][:, members], response)
            around = np.eye(len(rows)) + answer @ self.around[block][length]
            log_determinant += np.linalg.slogdet(around)[1].sum()
            observed = (answer @ self.observed[:, rows][length]).transpose(0, 2, 1)
            pushed = list(self.pushed[:, rows])
            places = zip(members.tolist(), observed, length.tolist(), strict=True)
            for i, row, k in places:
                steps[i] = (row, pushed[k])
        decay = list(self.decay)
        modal = state.view(complex)
        moved = np.empty_like(state)
        for step, k in zip(steps, index.tolist(), strict=True):
            if step is None:
                modal *= decay[k]
                continue
            from_state, to_state = step
            force = np.dot(state, from_state)
            modal *= decay[k]
            state += np.dot(force, to_state, out=moved)
        return log_determinant


def _answers(coupling: np.ndarray, response: np.ndarray) -> np.ndarray:
    """Solutions ``(I - T R)^-1 T`` ``(K, c Q, c Q)`` of T ``(c, K, Q, Q)`` of the
    reactions that act and their R.
    """
    reactions, intervals = coupling.shape[:2]
    size = reactions * DEGREES
    of_interval = coupling.transpose(1, 0, 2, 3)
    back = (
        of_interval @ response.reshape(intervals, reactions, DEGREES, size)
    ).reshape(intervals, size, size)
    right = np.zeros((intervals, reactions, DEGREES, reactions, DEGREES))
    for c in range(reactions):
        right[:, c, :, c] = coupling[c]
    return np.linalg.solve(np.eye(size) - back, right.reshape(intervals, size, size))


def _exponential_integrals(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Integrals ``int e^(x s) P_p(s) ds`` ``(n, Q)``, and ``int int e^(x (s - r))
    P_q(r) P_p(s) dr ds`` ``(n, p, q)`` over r < s, from 0 to 1, of the Legendre
    polynomials there.
    """
    moment = np.zeros((len(x), DEGREES), complex)
    repeated = np.zeros((len(x), DEGREES**2), complex)
    near = np.abs(x) < REACH
    powers = x[near, None] ** np.arange(TERMS)
    series, double_series = _series()
    moment[near] = powers @ series.T
    repeated[near] = powers @ double_series.T
    far = x[~near]
    # By parts: a polynomial p leaves -sum_k p^(k) / x^(k+1) behind at both ends.
    begin, end, within = _derivatives()
    inverse = far[:, None] ** -(1.0 + np.arange(DEGREES))
    signed = inverse * (-1.0) ** np.arange(DEGREES)
    moment[~near] = np.exp(far)[:, None] * (signed @ end) - signed @ begin
    by_begin = (inverse @ begin)[:, None, :] * moment[~near][:, :, None]
    left_behind = inverse @ within.reshape(DEGREES, -1)
    repeated[~near] = by_begin.reshape(-1, DEGREES**2) - left_behind
    return moment, repeated.reshape(-1, DEGREES, DEGREES)


@cache
def _series() -> tuple[np.ndarray, np.ndarray]:
    """Coefficients ``(Q, TERMS)`` and ``(Q Q, TERMS)`` of powers of x in
    :func:`_exponential_integrals`.
    """
    node, weight = legendre.leggauss(TERMS)
    s = (node + 1) / 2
    weight = weight / 2
    inverse = np.array([1 / factorial(k) for k in range(TERMS)])
    polynomial = legendre.legvander(node, DEGREES - 1)
    single = (weight[:, None] * polynomial).T @ (
        s[:, None] ** np.arange(TERMS) * inverse
    )
    r = s[:, None] * s
    power = (s[:, None] - r)[..., None] ** np.arange(TERMS) * inverse
    inner = np.einsum(
        "sr,srq,srk->sqk",
        s[:, None] * weight,
        legendre.legvander(2 * r - 1, DEGREES - 1),
        power,
    )
    return single, np.einsum("s,sp,sqk->pqk", weight, polynomial, inner).reshape(
        DEGREES**2, TERMS
    )


@cache
def _derivatives() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives of order k of the Legendre polynomials of 0 .. 1 at 0 and 1 ``(k,
    q)``, and their integrals with the polynomials ``(k, p, q)``.
    """
    derivatives = np.zeros((DEGREES, DEGREES, DEGREES))
    for q in range(DEGREES):
        series = np.eye(DEGREES)[q]
        for k in range(DEGREES):
            derivatives[k, : len(series), q] = series
            series = 2 * legendre.legder(series)
    begin, end = ((sign ** np.arange(DEGREES)) @ derivatives for sign in (-1.0, 1.0))
    return begin, end, derivatives / (2 * np.arange(DEGREES) + 1)[:, None]


def _products() -> np.ndarray:
    """Matrix ``(2Q-1, Q Q)`` from moments of a slope to its T, ``(2 q + 1) int slope
    P_q P_p``.
    """
    degrees = 2 * DEGREES - 1
    node, weight = legendre.leggauss(2 * degrees)
    values = legendre.legvander(node, degrees - 1)
    products = np.einsum(
        "s,sq,sp,sd->dqp", weight / 2, values[:, :DEGREES], values[:, :DEGREES], values
    )
    norm = 2 * np.arange(degrees) + 1
    return (norm[:, None, None] * products * norm[:DEGREES, None]).reshape(degrees, -1)


_PRODUCTS = _products()

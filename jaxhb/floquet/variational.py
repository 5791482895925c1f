"""The variational equation around a given periodic motion, solved arc by arc between
its switching times.

With the slopes of the nonlinear force phi in l and l' along the motion, a small
deviation obeys

    y' = (A + E S(t) L) y,     S(t) = (d phi/dl, d phi/dl'),

in the coordinates of :mod:`jaxhb.equations.state_space`. An arc ends where a mesh
passes a knot of its law (docs/theory A7). In an arc, a mesh in contact or in its gap
has constant slopes and belongs to the matrix; without others, the arc is one exact
exponential. Of a mesh in its smooth zone, or whose stiffness varies in time, the force
u = S w is a polynomial through Gauss nodes (collocation), and Duhamel's integral with
the constant train around it is exact:

    y(tau) = exp(A tau) y(0) + sum_j W_j u_j,
    u_i = S_i (L exp(A c_i tau) y(0) + sum_j K_ij u_j).

All are power series in A tau, whose powers the arcs with the same constant meshes
share: an exponential costs one product of matrices, and one more each time it is
squared. Measured on ``gear_train_30`` at 1800 rpm, 54 states and 424 switching times:
0.08 s on one core, numpy; at 700 rpm, where teeth stay in their smooth zone, 0.11 s. It
is exact to rounding, for error bounds and as the measure of
:mod:`jaxhb.floquet.intervals`, which is faster.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from math import factorial
from typing import NamedTuple

import jax
import numpy as np

from jaxhb.equations import backlash, fourier
from jaxhb.equations.backlash import MeshParameters
from jaxhb.equations.state_space import StateSpace

STAGES = 10  # Gauss nodes of a step with a mesh in its smooth zone
# Norm of A tau at most, of a step or of what is squared: the terms of a power series
# are then exact to 1e-13, and rounding leaves 1e-12 of the determinant. Shorter steps
# with fewer nodes take longer.
REACH = 4.0
# Powers of A that are stored for exponentials; products of two make the terms of a
# series
POWERS = 16
TERMS = 2 * POWERS + 1
CHUNK = 3_000_000  # entries of the propagators that are held at a time
MOST_SLOPES = 20_000_000  # slopes at Gauss nodes of a cycle, 160 MB
# Samples per harmonic, and derivatives at each, from which a motion follows at any time
# to 1e-12
SAMPLES = 16
DERIVATIVES = 9


class Monodromy(NamedTuple):
    """Derivative ``(n, n)`` of the state after one cycle with respect to the state
    before; the logarithm of its determinant as the sum over its factors, as that of the
    product is lost in rounding; and the integral over the cycle of the trace of the
    matrix of the equation, equal to it (Liouville).
    """

    matrix: np.ndarray
    log_determinant: float
    trace: float


def monodromy(
    space: StateSpace,
    meshes: MeshParameters,
    deflection: np.ndarray,
    frequency: float,
    switching: np.ndarray,
) -> Monodromy:
    """The :class:`Monodromy` of a motion; on the host.

    space : StateSpace; meshes : MeshParameters, the G meshes with backlash; deflection
    : complex ``(G, N+1)`` m, their motion; frequency : Omega in rad/s; switching :
    shares of the cycle at which a mesh passes a knot of its law.
    """
    cycle = _Cycle(space, meshes, deflection, frequency, switching)
    matrix = np.eye(len(cycle.space.transition))
    log_determinant = 0.0
    for propagators, logarithms in cycle.propagators():
        log_determinant += logarithms.sum()
        for propagator in propagators:
            matrix = propagator @ matrix
    return Monodromy(matrix, float(log_determinant), cycle.trace())


class Propagation(NamedTuple):
    """Propagation of a disturbance to K shares of the cycle from 0 to 1: deflection
    ``(K, G, n)`` m there per unit state at the beginning; end_state ``(K, n, G)`` per
    unit impulse (m s) there of the integral of (engagement - 1) over the deflection of
    a mesh; matrix ``(n, n)`` of the whole cycle.
    """

    share: np.ndarray
    deflection: np.ndarray
    end_state: np.ndarray
    matrix: np.ndarray


def propagation(
    space: StateSpace,
    meshes: MeshParameters,
    deflection: np.ndarray,
    frequency: float,
    share: np.ndarray,
) -> Propagation:
    """The :class:`Propagation` of disturbances; arguments as of :func:`monodromy`,
    times where teeth pass knots among ``share``.

    The force of a mesh is ``k I + r dI/dt``, k = (1 - epsilon) c and r its damping if
    that acts in contact, of the integral I. As A + E S L takes a state on, an impulse
    of I leaves ``(E k + (A + E S L) E r)`` behind.
    """
    cycle = _Cycle(space, meshes, deflection, frequency, share)
    space = cycle.space
    meshes = cycle.meshes
    time = np.concatenate([[0.0], np.cumsum(cycle.length)])
    ends = time * cycle.frequency / (2 * np.pi)
    propagators = np.concatenate([chunk for chunk, _ in cycle.propagators()])
    E = space.forcing
    L = space.observation
    count = E.shape[1]
    slope = cycle.slopes(ends)
    contact_viscous = np.where(meshes.contact_damping, meshes.viscous, 0.0)
    # S L
    changed = slope[:, :count, None] * L[:count] + slope[:, count:, None] * L[count:]
    impulse = E * ((1 - meshes.law.epsilon) * meshes.law.stiffness)
    impulse = impulse + (space.transition @ E + E @ (changed @ E)) * contact_viscous
    deflections = [L[:count]]
    end_states = [impulse[-1]]
    ahead = np.eye(len(E))
    behind = np.eye(len(E))
    steps = zip(propagators, propagators[::-1], impulse[-2::-1], strict=True)
    for forwards, backwards, pushed in steps:
        ahead = forwards @ ahead
        behind = behind @ backwards
        deflections.append(L[:count] @ ahead)
        end_states.append(behind @ pushed)
    return Propagation(ends, np.array(deflections), np.array(end_states[::-1]), ahead)


class _Cycle:
    """The P steps through the cycle of a motion, in order: length ``(P,)`` s; constant
    ``(P, 2G)`` slopes in l and l' of meshes that keep them; between ``(P, G)``, the
    meshes between their gap and contact; slope ``(P, J, 2G)`` of these at the Gauss
    nodes.
    """

    def __init__(
        self,
        space: StateSpace,
        meshes: MeshParameters,
        deflection: np.ndarray,
        frequency: float,
        breaks: np.ndarray,
    ):
        self.space, self.meshes, self.deflection = jax.tree.map(
            np.asarray, (space, meshes, deflection)
        )
        self.frequency = float(frequency)
        period = 2 * np.pi / self.frequency
        self.sampled = sampled(self.deflection)
        # Each constant train is made once; its slopes as bytes, as arrays are no keys.
        self.train = cache(
            lambda slope: _ConstantTrain(self.space, np.frombuffer(slope))
        )
        breaks = np.unique(np.concatenate([[0.0], breaks, [1.0]]))
        begin = breaks[:-1]
        share = np.diff(breaks)
        # In an arc no mesh passes a knot: all along it is in contact, apart or between,
        # as in the middle.
        middle = begin + share / 2
        deflection, _ = between_samples(self.sampled, self.frequency, middle)
        engagement = backlash.engagement(self.meshes.law.expand(), deflection)
        between = ((engagement > 0) & (engagement < 1)).T
        variation = self.meshes.variation
        quickest = 0.0
        # A mesh whose stiffness varies has a constant slope nowhere
        if variation is not None:
            between = between | (variation != 0).any(axis=-1)
            quickest = (variation.shape[-1] - 1) * self.frequency
        constant = np.where(np.tile(between, 2), 0.0, self.slopes(middle))
        # Arcs of a mesh in its smooth zone are cut into steps of bounded norm; others
        # are exponentials of any length.
        norm = np.array([self.train(row.tobytes()).norm for row in constant])
        reach = np.maximum(norm, quickest) * period * share
        count = np.where(between.any(axis=1), np.ceil(reach / REACH), 1).astype(int)
        if count.sum() * STAGES * constant.shape[1] > MOST_SLOPES:
            raise ValueError(
                f"stability would take {count.sum():.3g} steps a cycle, as teeth stay"
                " in the smooth zone of their law while they vibrate fast beside the"
                " cycle, and memory does not suffice: ask at a higher speed."
            )
        share = np.repeat(share / count, count)
        number = np.arange(len(share)) - np.repeat(np.cumsum(count) - count, count)
        begin = np.repeat(begin, count, axis=0)
        self.constant = np.repeat(constant, count, axis=0)
        self.between = np.repeat(between, count, axis=0)
        varying = self.between.any(axis=1)
        node = (begin + share * number)[varying, None] + share[varying, None] * _NODE
        self.length = share * period
        self.slope = np.zeros((len(share), STAGES, constant.shape[1]))
        at_nodes = self.slopes(node.ravel()).reshape(self.slope[varying].shape)
        mask = np.tile(self.between, 2)[varying, None]
        self.slope[varying] = np.where(mask, at_nodes, 0.0)

    def slopes(self, share: np.ndarray) -> np.ndarray:
        """Slopes ``(K, 2G)`` of phi in l and l' at shares of the cycle ``(K,)``."""
        law, viscous, contact_damping = backlash.at_samples(
            self.meshes, lambda coefficients: fourier.values_at(coefficients, share)
        )
        deflection, rate = between_samples(self.sampled, self.frequency, share)
        by_deflection, by_rate = backlash.nonlinear_slopes(
            law, viscous, contact_damping, deflection, rate
        )
        return np.concatenate([by_deflection, by_rate + 0 * rate]).T

    def propagators(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Propagators ``(K, n, n)`` of the steps, chunk by chunk, and the logarithms
        ``(K,)`` of their determinants.
        """
        alike = np.column_stack([self.constant, self.between])
        states = len(self.space.transition)
        size = max(CHUNK // states**2, 1)
        for first in range(0, len(self.length), size):
            chosen = slice(first, first + size)
            count = len(self.length[chosen])
            propagators = np.zeros((count, states, states))
            logarithm = np.zeros(count)
            # Steps with the same meshes in contact share the powers of one matrix.
            rows, kind = np.unique(alike[chosen], axis=0, return_inverse=True)
            for k, row in enumerate(rows):
                constant, between = np.split(row, [self.constant.shape[1]])
                members = np.flatnonzero(kind.ravel() == k)
                varying = np.flatnonzero(between)
                train = self.train(constant.tobytes())
                length = self.length[chosen][members]
                if len(varying):
                    propagators[members], logarithm[members] = train.collocated(
                        length, self.slope[chosen][members], varying
                    )
                else:
                    propagators[members], logarithm[members] = train.long_exponential(
                        length
                    )
            yield propagators, logarithm

    def trace(self) -> float:
        """Integral of the trace of the matrix of the equation over the cycle."""
        forces = np.einsum(
            "hn,nh->h", self.space.observation, np.tile(self.space.forcing, 2)
        )
        mean = self.constant + np.einsum("i,pih->ph", _WEIGHT, self.slope)
        return float(self.length @ (np.trace(self.space.transition) + mean @ forces))


def motion(deflection: np.ndarray, frequency: float, share: np.ndarray) -> np.ndarray:
    """Deflection l and rate l' ``(2, G, K)``, in m and m/s, at shares ``(K,)`` of the
    cycle, of coefficients ``(G, N+1)``.
    """
    return between_samples(sampled(deflection), frequency, share)


def sampled(deflection: np.ndarray) -> np.ndarray:
    """Sample the motion with coefficients ``(G, N+1)`` and its derivatives by the angle
    of the cycle at equidistant times, ``(DERIVATIVES + 1, G, samples)``.
    """
    samples = SAMPLES * max(deflection.shape[-1] - 1, 1)
    values = []
    for _ in range(DERIVATIVES + 1):
        values.append(fourier.synthesize(deflection, samples))
        deflection = fourier.derivative(deflection, 1.0)
    return np.stack(values)


def between_samples(
    values: np.ndarray, frequency: float, share: np.ndarray
) -> np.ndarray:
    """Deflection l and rate l' ``(2, G, K)`` at shares ``(K,)`` of the cycle: Taylor
    series from the nearest of equidistant samples.
    """
    samples = values.shape[-1]
    # Transforms know a motion at equidistant times only. From the nearest of them, half
    # a sample away at most, its Taylor series converges fast: n times the angle stays
    # below pi / 16.
    nearest = np.rint(share * samples)
    angle = 2 * np.pi / samples * (share * samples - nearest)
    values = values[..., nearest.astype(int) % samples]
    power = angle ** np.arange(DERIVATIVES)[:, None, None]
    power = power * _INVERSE[:DERIVATIVES, None, None]
    deflection = np.sum(power * values[:-1], axis=0)
    rate = frequency * np.sum(power * values[1:], axis=0)
    return np.stack([deflection, rate])


class _ConstantTrain:
    """Power series of one constant train: powers of A/norm ``(powers + 1, n n)``; with
    forces of the meshes on their right ``(terms, n, G)``, motion of the meshes on their
    left ``(terms, 2G, n)``, or both.
    """

    def __init__(self, space: StateSpace, slope: np.ndarray):
        forcing = space.forcing
        observation = space.observation
        on, following = np.split(observation, 2)
        rows = slope[: len(on), None] * on + slope[len(on) :, None] * following
        matrix = space.transition + forcing @ rows
        self.norm = np.linalg.norm(matrix, 2)
        matrix = matrix / self.norm
        powers = [np.eye(len(matrix))]
        forced = [forcing]
        observed = [observation]
        for _ in range(POWERS):
            powers.append(powers[-1] @ matrix)
        for _ in range(TERMS - 1):
            forced.append(matrix @ forced[-1])
            observed.append(observed[-1] @ matrix)
        self.last = powers[-1]
        self.powers = np.reshape(powers, (len(powers), -1))
        self.forced = np.array(forced)
        self.observed = np.array(observed)
        self.both = observation @ self.forced

    def exponential(self, length: np.ndarray) -> np.ndarray:
        """Exponentials exp(A tau) ``(K, n, n)`` of lengths ``(K,)`` s with norms of A
        tau within the reach.
        """
        x = (length * self.norm)[:, None] ** np.arange(TERMS)
        shape = (-1, *self.last.shape)
        # Paterson and Stockmeyer (SIAM J. Comput. 2 (1973) 60): two sums of the powers
        # at hand, and one product with the last, instead of a product for each term.
        low = (x[:, :POWERS] * _INVERSE[:POWERS]) @ self.powers[:POWERS]
        high = (x[:, POWERS:] * _INVERSE[POWERS:]) @ self.powers
        return low.reshape(shape) + self.last @ high.reshape(shape)

    def long_exponential(self, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Exponentials exp(A tau), and the logarithms of the determinants, of any
        lengths: squared as often as necessary.
        """
        pieces = np.maximum(length * self.norm / REACH, 1.0)
        halvings = np.ceil(np.log2(pieces)).astype(int)
        exponential = self.exponential(length / 2.0**halvings)
        logarithm = np.linalg.slogdet(exponential)[1] * 2.0**halvings
        for k in range(halvings.max(initial=0)):
            again = halvings > k
            exponential[again] = exponential[again] @ exponential[again]
        return exponential, logarithm

    def collocated(
        self, length: np.ndarray, slope: np.ndarray, chosen: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Propagators ``(K, n, n)`` of steps in which the chosen meshes also have
        slopes ``(K, J, 2G)`` at the Gauss nodes, and logarithms of their determinants.
        """
        states, meshes = self.forced.shape[1:]
        both = np.concatenate([chosen, meshes + chosen])
        count = len(chosen)
        observed = self.observed[:, both].reshape(TERMS, -1)
        forced = self.forced[:, :, chosen].reshape(TERMS, -1)
        between = self.both[:, both[:, None], chosen].reshape(TERMS, -1)
        # Steps of one section have one length: what depends on it alone is computed
        # once.
        length, index = np.unique(length, return_inverse=True)
        x = (length * self.norm)[:, None] ** np.arange(TERMS)
        scale = length[:, None, None, None]
        # Motions of unit states at the Gauss nodes (K, J, 2G, n), of unit forces there
        # (K, J, 2G, J, G), and the states (K, n, J, G) that these leave at the end.
        powers = x[:, None] * _NODE[:, None] ** np.arange(TERMS) * _INVERSE
        observed = powers @ observed
        observed = observed.reshape(-1, STAGES, 2 * count, states)[index]
        response = (x[:, None, None] * _UNTIL_NODE) @ between
        response = response.reshape(-1, STAGES, STAGES, 2 * count, count)
        response = (scale[..., None] * response.transpose(0, 1, 3, 2, 4))[index]
        left = ((x[:, None] * _UNTIL_END) @ forced).reshape(-1, STAGES, states, count)
        left = (scale * left.transpose(0, 2, 1, 3))[index]
        slope = slope[..., both]
        size = STAGES * count

        def force(moved: np.ndarray) -> np.ndarray:
            slopes = slope.reshape(slope.shape + (1,) * (moved.ndim - 3))
            by_deflection, by_rate = np.split(slopes * moved, 2, axis=2)
            return (by_deflection + by_rate).reshape(len(slope), size, -1)

        # u_i = S_i (L exp(A c_i tau) y + sum_j K_ij u_j) of the head of this module,
        # for unit states y.
        forces = np.linalg.solve(np.eye(size) - force(response), force(observed))
        free = self.exponential(length)[index]
        propagator = free + left.reshape(len(slope), states, -1) @ forces
        return propagator, np.linalg.slogdet(propagator)[1]


def _integrals() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Gauss nodes of 0 .. 1, their weights, and with the Lagrange polynomial p_j
    through them the integrals of ``(e - s)^k / k! p_j(s)`` from 0 to e: to each node
    ``(i, j, k)`` and to the end ``(j, k)``.
    """
    unit, unit_weight = np.polynomial.legendre.leggauss(STAGES)
    node = (unit + 1) / 2
    weight = unit_weight / 2
    # Exact for these degrees, and well conditioned
    fine, fine_weight = np.polynomial.legendre.leggauss(TERMS)
    end = np.append(node, 1.0)[:, None]
    points = end * (fine + 1) / 2
    scale = end * fine_weight / 2
    off_diagonal = ~np.eye(STAGES, dtype=bool)
    lagrange = [
        np.prod((points[..., None] - node[rest]) / (node[j] - node[rest]), axis=-1)
        for j, rest in enumerate(off_diagonal)
    ]
    power = (end - points)[..., None] ** np.arange(TERMS) * _INVERSE
    to = np.einsum("es,jes,esk->ejk", scale, lagrange, power)
    return node, weight, to[:-1], to[-1]


_INVERSE = np.array([1 / factorial(k) for k in range(TERMS)])
_NODE, _WEIGHT, _UNTIL_NODE, _UNTIL_END = _integrals()

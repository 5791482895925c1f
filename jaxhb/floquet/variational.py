"""The variational equation around a given periodic motion, solved arc by arc between its switching times.

With the slopes of the nonlinear force phi in l and l' along the motion, a small deviation obeys

    y' = (A + E S(t) L) y,     S(t) = (d phi/dl, d phi/dl'),

in the coordinates of :mod:`jaxhb.equations.state_space`. An arc ends where a mesh passes a knot of its law (docs/theory
A7). In an arc, a mesh in contact or in its gap has constant slopes and belongs to the matrix; without others, the arc
is one exact exponential. Of a mesh in its smooth zone the force u = S w is a polynomial through Gauss nodes
(collocation), and Duhamel's integral with the constant train around it is exact:

    y(tau) = exp(A tau) y(0) + sum_j W_j u_j,     u_i = S_i (L exp(A c_i tau) y(0) + sum_j K_ij u_j).

All are power series in A tau, whose powers the arcs with the same constant meshes share: an exponential costs one
product of matrices, and one more each time it is squared. Measured on ``gear_train_30`` at 1800 rpm, 54 states and 424
switching times: 0.08 s on one core, numpy; at 700 rpm, where teeth stay in their smooth zone, 0.11 s.
"""

from dataclasses import dataclass
from math import factorial

import jax
import numpy as np

from jaxhb.equations import backlash, fourier


@dataclass(frozen=True)
class VariationalOptions:
    """How the variational equation is solved.

    Parameters
    ----------
    stages : Gauss nodes of a step with a mesh in its smooth zone
    reach : norm of A tau at most, of a step or of what is squared: the terms of a power series are then exact to 1e-13,
        and rounding leaves 1e-12 of the determinant. Shorter steps with fewer nodes take longer
    powers : of A that are kept for exponentials; two factors of them make the terms of a series
    chunk : steps whose propagators are held at a time
    samples, derivatives : samples per harmonic, and derivatives at each, from which a motion is known at any time to
        1e-12
    """

    stages: int = 10
    reach: float = 4.0
    powers: int = 16
    chunk: int = 256
    samples: int = 16
    derivatives: int = 9

    @property
    def terms(self):
        """Terms of a power series."""
        return 2 * self.powers + 1


VARIATIONAL = VariationalOptions()
_STAGES, _TERMS = VARIATIONAL.stages, VARIATIONAL.terms


@dataclass(frozen=True)
class Monodromy:
    """The derivative ``(n, n)`` of the state after one cycle with respect to the state before.

    log_determinant : of it, as the sum over its factors: its own is lost in rounding. trace : integral over the cycle
    of the trace of the matrix of the equation, equal to it (Liouville).
    """

    matrix: np.ndarray
    log_determinant: float
    trace: float


@dataclass(frozen=True)
class _Steps:
    """Steps in order: length ``(P,)`` s; constant ``(P, 2G)`` slopes in l and l' of meshes that keep them; of those
    that are between ``(P, G)`` their gap and contact, slope ``(P, J, 2G)`` at the Gauss nodes."""

    length: np.ndarray
    constant: np.ndarray
    slope: np.ndarray
    between: np.ndarray


def monodromy(space, meshes, deflection, frequency, switching):
    """Solve the variational equation over one cycle; on the host.

    Parameters
    ----------
    space : StateSpace
    meshes : MeshParameters, the G meshes with backlash
    deflection : complex array ``(G, N+1)`` m, their motion
    frequency : float, Omega in rad/s
    switching : array, shares of the cycle at which a mesh passes a knot of its law

    Returns
    -------
    Monodromy
    """
    space, meshes, deflection = jax.tree.map(np.asarray, (space, meshes, deflection))
    trains = _ConstantTrains(space)
    steps = _steps(trains, meshes, deflection, float(frequency), switching)
    matrix, log_determinant = np.eye(len(space.transition)), 0.0
    for first in range(0, len(steps.length), VARIATIONAL.chunk):
        propagators, logarithms = _propagators(
            trains, steps, np.arange(first, min(first + VARIATIONAL.chunk, len(steps.length)))
        )
        log_determinant += logarithms.sum()
        for propagator in propagators:
            matrix = propagator @ matrix
    return Monodromy(matrix, float(log_determinant), _trace(space, steps))


@dataclass(frozen=True)
class Propagation:
    """How a disturbance propagates through the cycle, at K shares of it from 0 to 1; matrix ``(n, n)`` of it all.

    deflection ``(K, G, n)`` m: at a time per unit state at the beginning; end_state ``(K, n, G)``: the state at the
    end of the cycle per unit impulse (m s) at a time of the integral of (engagement - 1) over the deflection of a mesh.
    """

    share: np.ndarray
    deflection: np.ndarray
    end_state: np.ndarray
    matrix: np.ndarray


def propagation(space, meshes, deflection, frequency, share):
    """The :class:`Propagation` of disturbances; arguments as of :func:`monodromy`, times where teeth pass knots among
    ``share``.

    The force of a mesh is ``k I + r dI/dt``, k = (1 - epsilon) c and r its damping if that acts in contact, of the
    integral I. As A + E S L takes a state on, an impulse of I leaves ``(E k + (A + E S L) E r)`` behind.
    """
    space, meshes, deflection = jax.tree.map(np.asarray, (space, meshes, deflection))
    trains, frequency = _ConstantTrains(space), float(frequency)
    steps = _steps(trains, meshes, deflection, frequency, share)
    ends = np.concatenate([[0.0], np.cumsum(steps.length)]) * frequency / (2 * np.pi)
    chunks = [
        np.arange(i, min(i + VARIATIONAL.chunk, len(steps.length)))
        for i in range(0, len(steps.length), VARIATIONAL.chunk)
    ]
    propagators = np.concatenate([_propagators(trains, steps, chunk)[0] for chunk in chunks])
    E, L, count = space.forcing, space.observation, space.forcing.shape[1]
    slope = _slopes(meshes, *motion(deflection, frequency, ends))
    contact_viscous = np.where(meshes.contact_damping, meshes.viscous, 0.0)
    changed = slope[:, :count, None] * L[:count] + slope[:, count:, None] * L[count:]  # S L
    impulse = E * ((1 - meshes.law.epsilon) * meshes.law.stiffness)
    impulse = impulse + (space.transition @ E + E @ (changed @ E)) * contact_viscous
    deflections, end_states, ahead, behind = [L[:count]], [impulse[-1]], np.eye(len(E)), np.eye(len(E))
    for propagator, backwards, pushed in zip(propagators, propagators[::-1], impulse[-2::-1], strict=True):
        ahead, behind = propagator @ ahead, behind @ backwards
        deflections.append(L[:count] @ ahead)
        end_states.append(behind @ pushed)
    return Propagation(ends, np.array(deflections), np.array(end_states[::-1]), ahead)


def _steps(trains, meshes, deflection, frequency, switching):
    """The :class:`_Steps` of a motion."""
    law, period = meshes.law.expand(), 2 * np.pi / frequency
    breaks = np.unique(np.concatenate([[0.0], switching, [1.0]]))
    begin, share = breaks[:-1], np.diff(breaks)
    # In an arc no mesh passes a knot: what it is in the middle, in contact, apart or between, it is all along.
    middle = motion(deflection, frequency, begin + share / 2)
    engagement = backlash.engagement(law, middle[0])
    between = ((engagement > 0) & (engagement < 1)).T
    constant = np.where(np.tile(between, 2), 0.0, _slopes(meshes, *middle))
    varying = between.any(axis=1)
    # Arcs of a mesh in its smooth zone are cut into steps of bounded norm; others are exponentials of any length.
    reach = np.array([trains[row].norm for row in constant]) * period * share
    count = np.where(varying, np.ceil(reach / VARIATIONAL.reach), 1).astype(int)
    share = np.repeat(share / count, count)
    number = np.arange(len(share)) - np.repeat(np.cumsum(count) - count, count)
    begin, constant, between = (np.repeat(a, count, axis=0) for a in (begin, constant, between))
    varying = between.any(axis=1)
    at = (begin + share * number)[varying, None] + share[varying, None] * _NODE
    slope = np.zeros((len(share), _STAGES, constant.shape[1]))
    found = _slopes(meshes, *motion(deflection, frequency, at.ravel())).reshape(slope[varying].shape)
    slope[varying] = np.where(np.tile(between, 2)[varying, None], found, 0.0)
    return _Steps(share * period, constant, slope, between)


def _slopes(meshes, deflection, rate):
    """Slopes ``(K, 2G)`` of phi in l and l', at deflections and rates ``(G, K)``."""
    viscous, in_contact = meshes.viscous[:, None], meshes.contact_damping[:, None]
    slope, rate_slope = backlash.mesh_slopes(meshes.law.expand(), viscous, in_contact, deflection, rate)
    return np.concatenate([slope - meshes.law.stiffness[:, None], rate_slope - viscous + 0 * rate]).T


def motion(deflection, frequency, share):
    """l and l' ``(2, G, K)`` at shares ``(K,)`` of the cycle, of coefficients ``(G, N+1)``: Taylor series from the
    nearest of equidistant samples."""
    samples = VARIATIONAL.samples * max(deflection.shape[-1] - 1, 1)
    # Transforms know a motion at equidistant times only. From the nearest of them, half a sample away at most, its
    # Taylor series converges fast: n times the angle stays below pi / 16.
    nearest = np.rint(share * samples)
    angle = 2 * np.pi / samples * (share * samples - nearest)
    values = []
    for _ in range(VARIATIONAL.derivatives + 1):
        values.append(fourier.synthesize(deflection, samples)[:, nearest.astype(int) % samples])
        deflection = fourier.derivative(deflection, 1.0)
    power = angle ** np.arange(VARIATIONAL.derivatives)[:, None, None] * _INVERSE[: VARIATIONAL.derivatives, None, None]
    return np.stack([np.sum(power * values[:-1], axis=0), frequency * np.sum(power * values[1:], axis=0)])


class _ConstantTrains(dict):
    """The train with the slopes of some meshes, by the bytes of these ``(2G,)``; each is made once."""

    def __init__(self, space):
        self.space = space

    def __getitem__(self, slope):
        key = slope.tobytes()
        if key not in self:
            self[key] = _ConstantTrain(self.space, slope)
        return self.get(key)


class _ConstantTrain:
    """Power series of one constant train: powers of A/norm ``(powers + 1, n n)``; with forces of the meshes on their
    right ``(terms, n G)``, motion of the meshes on their left ``(terms, 2G n)``, or both."""

    def __init__(self, space, slope):
        forcing, observation = space.forcing, space.observation
        meshes = forcing.shape[1]
        rows = slope[:meshes, None] * observation[:meshes] + slope[meshes:, None] * observation[meshes:]
        matrix = space.transition + forcing @ rows
        self.norm = np.linalg.norm(matrix, 2)
        matrix = matrix / self.norm
        powers, forced, observed = [np.eye(len(matrix))], [forcing], [observation]
        for _ in range(VARIATIONAL.powers):
            powers.append(powers[-1] @ matrix)
        for _ in range(_TERMS - 1):
            forced.append(matrix @ forced[-1])
            observed.append(observed[-1] @ matrix)
        self.shape = *forcing.shape, _TERMS
        self.last = powers[-1]
        both = [observation @ column for column in forced]
        self.powers, self.forced, self.observed, self.both = (
            np.reshape(a, (len(a), -1)) for a in (powers, forced, observed, both)
        )

    def exponential(self, length):
        """exp(A tau) ``(K, n, n)`` of lengths ``(K,)`` no longer than the options allow."""
        x = (length * self.norm)[:, None] ** np.arange(_TERMS)
        shape = -1, *self.last.shape
        # Paterson and Stockmeyer (SIAM J. Comput. 2 (1973) 60): two sums of the powers at hand, and one product with
        # the last, instead of a product for each term.
        low = (x[:, : VARIATIONAL.powers] * _INVERSE[: VARIATIONAL.powers]) @ self.powers[: VARIATIONAL.powers]
        high = (x[:, VARIATIONAL.powers :] * _INVERSE[VARIATIONAL.powers :]) @ self.powers
        return low.reshape(shape) + self.last @ high.reshape(shape)

    def long_exponential(self, length):
        """exp(A tau), and the logarithms of the determinants, of any lengths: squared as often as necessary."""
        halvings = np.ceil(np.log2(np.maximum(length * self.norm / VARIATIONAL.reach, 1.0))).astype(int)
        found = self.exponential(length / 2.0**halvings)
        logarithm = np.linalg.slogdet(found)[1] * 2.0**halvings
        for k in range(halvings.max(initial=0)):
            again = halvings > k
            found[again] = found[again] @ found[again]
        return found, logarithm

    def collocation_responses(self, length, chosen):
        """With K lengths, per step and chosen meshes: the motion ``(K, J, 2G, n)`` of unit states at the J Gauss nodes,
        that of unit forces there ``(K, J, 2G, J, G)``, and the state ``(K, n, J, G)`` that these leave at the end."""
        states, meshes, _ = self.shape
        both = np.concatenate([chosen, meshes + chosen])
        observed = self.observed.reshape(_TERMS, 2 * meshes, states)[:, both].reshape(_TERMS, -1)
        forced = self.forced.reshape(_TERMS, states, meshes)[:, :, chosen].reshape(_TERMS, -1)
        between = self.both.reshape(_TERMS, 2 * meshes, meshes)[:, both[:, None], chosen].reshape(_TERMS, -1)
        x = (length * self.norm)[:, None] ** np.arange(_TERMS)
        observed = (x[:, None] * _NODE[:, None] ** np.arange(_TERMS) * _INVERSE) @ observed
        response = (x[:, None, None] * _UNTIL_NODE) @ between
        left = (x[:, None] * _UNTIL_END) @ forced
        count, own, scale = len(length), len(chosen), length[:, None, None, None]
        response = response.reshape(count, _STAGES, _STAGES, 2 * own, own).transpose(0, 1, 3, 2, 4)
        left = left.reshape(count, _STAGES, states, own).transpose(0, 2, 1, 3)
        return observed.reshape(count, _STAGES, 2 * own, states), scale[..., None] * response, scale * left

    def collocated(self, length, slope, chosen):
        """Propagators ``(K, n, n)`` of steps in which the chosen meshes have slopes ``(K, J, 2G)`` at the Gauss
        nodes besides, and logarithms of determinants."""
        # Steps of one section have one length: what depends on it alone is made once.
        length, index = np.unique(length, return_inverse=True)
        observed, response, left = (a[index] for a in self.collocation_responses(length, chosen))
        slope, size = slope[..., np.concatenate([chosen, self.shape[1] + chosen])], _STAGES * len(chosen)

        def force(moved):
            on, following = np.split(slope.reshape(*slope.shape, *[1] * (moved.ndim - 3)) * moved, 2, axis=2)
            return (on + following).reshape(len(slope), size, -1)

        # u_i = S_i (L exp(A c_i tau) y + sum_j K_ij u_j) of the head of this module, for unit states y.
        force = np.linalg.solve(np.eye(size) - force(response), force(observed))
        found = self.exponential(length)[index] + left.reshape(len(slope), self.shape[0], -1) @ force
        return found, np.linalg.slogdet(found)[1]


def _propagators(trains, steps, chosen):
    """Propagators ``(K, n, n)`` of the chosen steps, and the logarithms ``(K,)`` of their determinants."""
    states = len(trains.space.transition)
    found, logarithm = np.zeros((len(chosen), states, states)), np.zeros(len(chosen))
    # Steps with the same meshes in contact share the powers of one matrix.
    alike = np.column_stack([steps.constant[chosen], steps.between[chosen]])
    rows, kind = np.unique(alike, axis=0, return_inverse=True)
    for k, row in enumerate(rows):
        constant, between = np.split(row, [steps.constant.shape[1]])
        at, varying = np.flatnonzero(kind.ravel() == k), np.flatnonzero(between)
        length, slope = steps.length[chosen[at]], steps.slope[chosen[at]]
        if len(varying):
            found[at], logarithm[at] = trains[constant].collocated(length, slope, varying)
        else:
            found[at], logarithm[at] = trains[constant].long_exponential(length)
    return found, logarithm


def _trace(space, steps):
    """Integral of the trace of the matrix of the equation over all steps."""
    forces = np.einsum("hn,nh->h", space.observation, np.tile(space.forcing, 2))
    mean = steps.constant + np.einsum("i,pih->ph", _WEIGHT, steps.slope)
    return float(steps.length @ (np.trace(space.transition) + mean @ forces))


def _integrals():
    """Gauss nodes of 0 .. 1, their weights, and with the Lagrange polynomial p_j through them the integrals of
    ``(e - s)^k / k! p_j(s)`` from 0 to e: to each node ``(i, j, k)`` and to the end ``(j, k)``."""
    unit, unit_weight = np.polynomial.legendre.leggauss(_STAGES)
    node, weight = (unit + 1) / 2, unit_weight / 2
    fine, fine_weight = np.polynomial.legendre.leggauss(_TERMS)  # exact for these degrees, and well conditioned
    end = np.append(node, 1.0)[:, None]
    at, scale = end * (fine + 1) / 2, end * fine_weight / 2
    others = ~np.eye(_STAGES, dtype=bool)
    lagrange = [np.prod((at[..., None] - node[o]) / (node[j] - node[o]), axis=-1) for j, o in enumerate(others)]
    power = (end - at)[..., None] ** np.arange(_TERMS) * _INVERSE
    to = np.einsum("es,jes,esk->ejk", scale, lagrange, power)
    return node, weight, to[:-1], to[-1]


_INVERSE = np.array([1 / factorial(k) for k in range(_TERMS)])
_NODE, _WEIGHT, _UNTIL_NODE, _UNTIL_END = _integrals()

"""Weights of the steps of a transient: exponential integrals of the linear train over a
step, for the forces of meshes and for loads.

The train obeys, with its meshes in contact,

    y' = A y + E phi(w) + F q(t),     w = (l, l') = L y - e(t),

with phi the forces of the meshes less their linear part, as in
:mod:`jaxhb.integration.step`, and loads q: torques of disks over their radius, the
angular acceleration of the mean rotation, forces of transmission errors. A step takes
q as the parabola through its values at the begin, in the middle and at the end, and phi
by Krogstad's scheme, so that it is of fourth order in both, whatever the stiffness of
A.

The states stand in pairs, in a real basis in which A has 2 x 2 blocks alone: real and
imaginary part of a mode that vibrates, two real modes, angle and speed of a rotation
that nothing holds, whose block is that of uniform motion. Where numbers are traced, A
is dense in the energy coordinates of :mod:`jaxhb.equations.state_space`: derivatives
need no eigenvectors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jax import lax

from jaxhb._jax import Array, Number, namespace
from jaxhb.equations.state_space import (
    CONDITION,
    PARTING,
    Partition,
    StateSpace,
    matrices,
    propagated,
)
from jaxhb.equations.system import System
from jaxhb.integration.step import krogstad


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ForcedSpace:
    """First-order equations ``y' = A y + E phi + F q`` of n states, G meshes, C loads,
    with ``w = L y`` and ``(x, x') = X y + Q q``.

    transition A ``(n, n)``, of states in pairs the blocks ``(2, 2, n/2)``; forcing E
    ``(n, G)``; load F ``(n, C)``; observation L ``(2G, n)``; motion X ``(2S, n)``;
    through Q ``(2S, C)``, of disks without inertia and damping, which follow their
    loads at once; coordinates ``(n, 2S)``, y of (x, x').
    """

    transition: Array
    forcing: Array
    load: Array
    observation: Array
    motion: Array
    through: Array
    coordinates: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class StepWeights:
    """Weights of a step; n states, G meshes, C loads.

    propagator : exp(A h) ``(n, n)`` or its blocks; ahead ``(4G, n)``: L exp(A h) above
    L exp(A h/2); first, second, third, end : of the forces phi of the stages, as in
    :class:`~jaxhb.integration.step.KrogstadWeights`; load_state ``(3C, n)``, load_next
    and load_middle ``(3C, 2G)``: of the loads at begin, middle and end of the step in
    the state after it, and in w after it and in its middle.
    """

    propagator: Array
    ahead: Array
    first: Array
    second: Array
    third: Array
    end: Array
    load_state: Array
    load_next: Array
    load_middle: Array


@dataclass(frozen=True)
class FreeRotation:
    """Rotation that nothing holds and no damping to ground brakes: states ``(n,)`` of
    angle and speed, and rows ``(n,)`` that read them.
    """

    angle: np.ndarray
    speed: np.ndarray
    angle_row: np.ndarray
    speed_row: np.ndarray


def load_rates(system: System, parts: Partition, columns: Array) -> tuple[Array, Array]:
    """Rates ``(n, C)`` of displacements and velocities of the dynamic disks under loads
    with forces ``columns`` ``(S, C)`` N on the disks, and displacements ``(2S, C)`` of
    disks without inertia and damping that follow them at once.
    """
    xp = namespace(system, columns)
    B, K = matrices(system)
    inertial = np.array(parts.inertial, dtype=int)
    damped = np.array(parts.damped, dtype=int)
    static = np.array(parts.static, dtype=int)
    dynamic = np.concatenate([inertial, damped])
    n = inertial.size
    force = columns[dynamic]
    through = xp.zeros((2 * len(system.mass), columns.shape[1]))
    if static.size:
        follows = xp.linalg.solve(K[np.ix_(static, static)], columns[static])
        force = force - K[np.ix_(static, dynamic)].T @ follows
        rows = np.zeros((2 * len(system.mass), static.size))
        rows[static, np.arange(static.size)] = 1.0
        through = rows @ follows
    velocity = xp.zeros((damped.size, columns.shape[1]))
    pull = force[:n]
    if damped.size:
        velocity = xp.linalg.solve(B[np.ix_(damped, damped)], force[n:])
        pull = pull - B[np.ix_(inertial, damped)] @ velocity
    acceleration = pull / system.mass[inertial][:, None]
    at_rest = xp.zeros((n, columns.shape[1]))
    return xp.concatenate([at_rest, velocity, acceleration]), through


def forced_space(
    system: System,
    parts: Partition,
    space: StateSpace,
    columns: Array,
    springs: Array,
) -> ForcedSpace:
    """The :class:`ForcedSpace` of a StateSpace under loads with forces ``columns``
    ``(S, C)`` N on the disks, dense; ``springs`` ``(S, V)``: further springs, by their
    deflections per displacement, whose forces stand behind those of the meshes.
    """
    xp = namespace(system, space, columns)
    disks = len(system.mass)
    inertial = np.array(parts.inertial, int)
    dynamic = np.concatenate([inertial, np.array(parts.damped, int)])
    static = np.array(parts.static, int)
    T = space.coordinates[:, np.concatenate([dynamic, disks + inertial])]
    rates, through = load_rates(system, parts, columns)
    inverse = xp.linalg.inv(T)
    selected = np.zeros((disks, len(dynamic)))
    selected[dynamic, np.arange(len(dynamic))] = 1.0
    displacement = selected @ inverse[: len(dynamic)]
    if static.size:
        K = matrices(system)[1]
        follows = xp.linalg.solve(K[np.ix_(static, static)], K[np.ix_(static, dynamic)])
        rows = np.zeros((disks, static.size))
        rows[static, np.arange(static.size)] = 1.0
        displacement = displacement - rows @ (follows @ inverse[: len(dynamic)])
    velocity = displacement @ space.transition
    # Loads move damped disks without inertia at once: their velocity follows from them.
    through = xp.concatenate([through[:disks], displacement @ (T @ rates)])
    of_springs, _ = load_rates(system, parts, springs)
    forcing = xp.concatenate([space.forcing, -T @ of_springs], axis=1)
    deflection, rate = xp.split(space.observation, 2)
    observation = [
        deflection,
        springs.T @ displacement,
        rate,
        springs.T @ velocity,
    ]
    return ForcedSpace(
        transition=space.transition,
        forcing=forcing,
        load=T @ rates,
        observation=xp.concatenate(observation),
        motion=xp.concatenate([displacement, velocity]),
        through=through,
        coordinates=space.coordinates,
    )


def in_pairs(space: ForcedSpace, rotation: FreeRotation | None) -> ForcedSpace:
    """The same equations, on the host, in a basis in which A has 2 x 2 blocks alone."""
    A = np.asarray(space.transition)
    free = np.zeros((len(A), 0))
    parted = A
    if rotation is not None:
        # Angle and speed of a free rotation have no eigenvectors of their own. Both get
        # a rate each, apart from all others, with which they are found again.
        scale = np.abs(np.diag(A)).max() + np.abs(A).max()
        nilpotent = np.outer(rotation.angle, rotation.speed_row)
        parted = A - nilpotent
        parted = parted - 2 * scale * np.outer(rotation.angle, rotation.angle_row)
        parted = parted - 3 * scale * np.outer(rotation.speed, rotation.speed_row)
        free = np.stack([rotation.angle, rotation.speed], axis=1)
    rates, vectors = np.linalg.eig(parted)
    if np.linalg.cond(vectors, 1) > CONDITION:
        shares = (1 + np.arange(len(A))) / len(A)
        damping = PARTING * np.abs(np.diag(A)).max() * shares
        rates, vectors = np.linalg.eig(parted - np.diag(damping))
    if rotation is not None:
        elastic = np.argsort(-np.abs(rates.real))[2:]
        rates = rates[elastic]
        vectors = vectors[:, elastic]
    turning = vectors[:, rates.imag > 0]
    real = np.concatenate([free, vectors[:, rates.imag == 0].real], axis=1)
    if real.shape[1] % 2:
        real = np.concatenate([real, np.zeros((len(A), 1))], axis=1)
    first = np.concatenate([turning.real, real[:, 0::2]], axis=1)
    second = np.concatenate([turning.imag, real[:, 1::2]], axis=1)
    basis = np.concatenate([first, second], axis=1)
    # A column of zeros makes the number of states even; the state is 0 for ever.
    inverse = np.linalg.pinv(basis) if basis.shape[1] > len(A) else np.linalg.inv(basis)
    full = inverse @ A @ basis
    half = len(full) // 2
    quarters = full.reshape(2, half, 2, half)
    return ForcedSpace(
        transition=np.ascontiguousarray(np.diagonal(quarters, axis1=1, axis2=3)),
        forcing=inverse @ space.forcing,
        load=inverse @ space.load,
        observation=space.observation @ basis,
        motion=space.motion @ basis,
        through=np.asarray(space.through),
        coordinates=inverse @ space.coordinates,
    )


def halvings(rates: np.ndarray) -> np.ndarray:
    """Number ``(...)`` of halvings after which the largest sum of a column of matrices
    ``(..., n, n)`` of the host is at most a half.
    """
    norms = np.abs(rates).sum(axis=-2).max(axis=-1)
    return np.ceil(np.log2(np.maximum(2 * norms, 1.0))).astype(int)


@dataclass(frozen=True)
class _Integrals:
    """exp(A h), and h phi_k(A h) times the columns of forces and loads, k = 1, 2, 3."""

    propagator: Array
    columns: tuple[Array, Array, Array]


def _integrals(
    transition: Array, columns: Array, h: Number, halved: np.ndarray | int
) -> tuple[_Integrals, _Integrals]:
    """The :class:`_Integrals` over half of ``h`` seconds and over ``h``, of a dense A
    or of blocks, after so many :func:`halvings` of A h / 2, for all or for each block.
    """
    dense = transition.ndim == 2
    xp = namespace(transition, h)
    matrix = transition if dense else transition.transpose(2, 0, 1)
    scale = 0.5 ** (np.asarray(halved)[..., None, None] + 1.0)
    half = _phi_functions(matrix * (scale * h), np.asarray(halved))

    def weighted(phis: Array, h: Number) -> _Integrals:
        if not dense:
            phis = phis.transpose(0, 2, 3, 1)
        first, second, third = (propagated(h * phi, columns) for phi in phis[1:])
        return _Integrals(phis[0], (first, second, third))

    return weighted(half, h / 2), weighted(_doubled(xp, half), h)


def _phi_functions(small: Array, halved: np.ndarray) -> Array:
    """phi_0 to phi_3 ``(4, ..., n, n)``, exp the first, of matrices ``(..., n, n)``
    times 2 to the power of ``halved`` ``(...)``: the Taylor series of phi_3, and
    doubling [1].

    [1] Skaflestad, Wright, The scaling and modified squaring method for matrix
    functions related to the exponential, Appl. Numer. Math. 59 (2009) 783
    """
    xp = namespace(small)
    identity = np.broadcast_to(np.eye(small.shape[-1]), small.shape)
    # Of matrices with sums below a half, terms further on are below 1e-19.
    series = _repeated(
        14, lambda k, series: identity + small @ series / (17 - k), identity + 0 * small
    )
    third = series / 6
    second = identity / 2 + small @ third
    first = identity + small @ second
    phis = xp.stack([identity + small @ first, first, second, third])

    def doubled(k: Number, phis: Array) -> Array:
        left = xp.asarray(k < halved)[..., None, None]
        return xp.where(left, _doubled(xp, phis), phis)

    return _repeated(int(halved.max(initial=0)), doubled, phis)


def _repeated(
    count: int, change: Callable[[Number, Array], Array], begin: Array
) -> Array:
    """Change a value ``count`` times, with the number of times so far."""
    if namespace(begin) is not np:
        return lax.fori_loop(0, count, change, begin)
    for k in range(count):
        begin = change(k, begin)
    return begin


def _doubled(xp: Any, phis: Array) -> Array:
    """phi_0 to phi_3 ``(4, ..., n, n)`` of matrices twice as large."""
    exp, first, second, third = phis
    return xp.stack(
        [
            exp @ exp,
            (exp @ first + first) / 2,
            (exp @ second + first + second) / 4,
            (exp @ third + first / 2 + second + third) / 8,
        ]
    )


def stacked_weights(space: ForcedSpace, lengths: Array, halved: int) -> StepWeights:
    """The :class:`StepWeights` ``(K, ...)`` of steps of ``lengths`` ``(K,)`` s, of a
    traced space after so many :func:`halvings` of its A h / 2.
    """
    if namespace(space) is not np:
        return lax.map(lambda h: step_weights(space, h, halved), lengths)
    pairs = np.asarray(space.transition).transpose(2, 0, 1)
    weights = [step_weights(space, h, halvings(pairs * (h / 2))) for h in lengths]
    return jax.tree.map(lambda *rows: np.stack(rows), *weights)


def step_weights(
    space: ForcedSpace, h: Number, halved: np.ndarray | int
) -> StepWeights:
    """The :class:`StepWeights` of steps of ``h`` seconds, after so many
    :func:`halvings` of A h / 2.
    """
    xp = namespace(space.transition, h)
    L = space.observation
    meshes = space.forcing.shape[1]
    columns = xp.concatenate([space.forcing, space.load], axis=1)
    half, full = _integrals(space.transition, columns, h, halved)
    # Krogstad's second integral over half a step counts the whole step.
    integrals = (half.columns[0], 2 * half.columns[1], *full.columns)
    first, second, third, end = krogstad(*(part[:, :meshes] for part in integrals))
    half_1, half_2, half_3 = (integral[:, meshes:] for integral in half.columns)
    full_1, full_2, full_3 = (integral[:, meshes:] for integral in full.columns)
    # The parabola through begin, middle and end, integrated over the step and over its
    # first half.
    in_state = (
        full_1 - 3 * full_2 + 4 * full_3,
        4 * full_2 - 8 * full_3,
        4 * full_3 - full_2,
    )
    in_middle = (
        half_1 - 1.5 * half_2 + half_3,
        2 * half_2 - 2 * half_3,
        half_3 - 0.5 * half_2,
    )
    end_state = xp.concatenate(end, axis=1)
    load_state = xp.concatenate(in_state, axis=1)
    rows = [propagated_rows(L, integral.propagator) for integral in (full, half)]
    return StepWeights(
        propagator=full.propagator,
        ahead=xp.concatenate(rows),
        first=L @ first[0],
        second=L @ xp.concatenate(second, axis=1),
        third=L @ xp.concatenate(third, axis=1),
        end=xp.concatenate([end_state, L @ end_state]),
        load_state=load_state.T,
        load_next=(L @ load_state).T,
        load_middle=(L @ xp.concatenate(in_middle, axis=1)).T,
    )


def propagated_rows(rows: Array, propagator: Array) -> Array:
    """Rows ``(r, n)`` times a propagator, dense or blocks ``(2, 2, n/2)``."""
    if propagator.ndim == 2:
        return rows @ propagator
    first, second = np.split(rows, 2, axis=1)
    return np.concatenate(
        [first * propagator[0, k] + second * propagator[1, k] for k in (0, 1)],
        axis=1,
    )

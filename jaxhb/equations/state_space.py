"""The linear train as dense first-order equations in energy coordinates, and in its
damped modes.

With every mesh taken in contact the displacements obey ``M x'' + B x' + K x = q - D^T
phi``. The state is

    y = (s q, p, v),     q = Q^T M^(1/2) x,     v = q',
    p = scaled displacements of damped massless disks,

with Q the undamped modes and ``s = max(omega, Omega)``: ``|y|^2`` is twice the energy
of all modes above the excitation, so that propagators, monodromy matrices and their
singular values are well scaled from the free rotation (s q of a floating train) to the
stiffest tooth. Massless disks without damping are condensed statically; massless disks
whose damping matrix is regular have the first-order equation ``B x' + K x = q``.

In its damped modes, ``A V = V diag(rates)``, every state stands by itself, so that
lanes of other speeds share all but rates:

    z' = rates z + forcing phi,     (l, l') = Re(observation z),
    (x, x') = Re(motion z).

One mode of each conjugate pair is kept and counted twice. Free rotation and rings
without spring have a Jordan block, which no eigenvectors span: a spring far below the
cycle frequency parts it, which no mesh notices. Rates at which eigenvectors coincide
are parted by a little more damping.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jax import lax

from jaxhb._jax import Array, Number, namespace, on_host, traced

if TYPE_CHECKING:
    from jaxhb.equations.backlash import MeshParameters
    from jaxhb.equations.system import System

# Share of the mean inertia that a disk without inertia gets: its mode is then far above
# all others
LIGHT = 1e-6
# Share of the highest squared frequency below which a mode is free rotation, as
# rounding shows it
ROTATION = 1e-14
# Frequency given to free rotation by springs in proportion to the inertias, as a share
# of that of the cycle; and the least share of the highest squared frequency, which
# rounding leaves.
HELD = 1e-5
HELD_ROUNDED = 1e-15
# Condition number of eigenvectors above which damping is added
CONDITION = 1e7
# That damping as a share of the largest
PARTING = 1e-9
# Damping that is always added where real modes are made, as a share of the largest
PARTED = 1e-13


@dataclass(frozen=True)
class Partition:
    """Disks by the order of their equation: inertial (second), damped massless (first),
    static massless (none).
    """

    inertial: tuple[int, ...]
    damped: tuple[int, ...] = ()
    static: tuple[int, ...] = ()


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class StateSpace:
    """First-order equations ``y' = A y + E phi``, with mesh deflections and rates ``w =
    L y`` (l before l'), ``y = T (x, x')``.

    transition A ``(n, n)`` 1/s; forcing E ``(n, G)``; observation L ``(2G, n)``;
    coordinates T ``(n, 2S)``; in_modes : whether A has entries only in the blocks of
    states k and n/2 + k, which :func:`paired` gives.
    """

    transition: Array
    forcing: Array
    observation: Array
    coordinates: Array
    in_modes: bool = field(default=False, metadata={"static": True})


def paired(matrix: Array) -> Array:
    """Blocks ``(2, 2, n/2)`` of a matrix ``(n, n)`` that couples states k and n/2 + k
    alone.
    """
    half = len(matrix) // 2
    quarters = jnp.stack([matrix[:half], matrix[half:]]).reshape(2, half, 2, half)
    return jnp.diagonal(quarters, axis1=1, axis2=3)


def paired_matrix(blocks: Array) -> Array:
    """Matrix ``(n, n)`` of the blocks that :func:`paired` gives."""
    return jnp.block([[jnp.diag(block) for block in row] for row in blocks])


def propagated(propagator: Array, state: Array) -> Array:
    """Product of a matrix ``(n, n)``, or of the blocks that :func:`paired` gives, with
    states ``(n, ...)``.
    """
    if propagator.ndim == 2:
        return propagator @ state
    xp = namespace(propagator, state)
    pairs = state.reshape((2, -1) + state.shape[1:])
    blocks = propagator.reshape(propagator.shape + (1,) * (state.ndim - 1))
    return xp.concatenate([row[0] * pairs[0] + row[1] * pairs[1] for row in blocks])


def modal_basis(transition: Array) -> Array:
    """Real basis ``(n, n)`` in which a transition matrix couples states k and n/2 + k
    alone, for even n.

    Columns k and n/2 + k are real and imaginary part of an eigenvector, or two real
    eigenvectors.
    """
    # Eigenvectors that coincide are parted by a little more damping, which no march and
    # no preconditioner notices.
    n = len(transition)
    little = PARTED * jnp.abs(jnp.diag(transition)).max()
    shares = (1 + jnp.arange(n)) / n
    parted = transition - jnp.diag(little * shares)
    rates, vectors = jnp.linalg.eig(lax.stop_gradient(parted))
    # In this order: eigenvectors that turn, real ones, and the conjugates of the first;
    # of the first their real and imaginary parts.
    vectors = vectors[:, jnp.argsort(-rates.imag)]
    turning = jnp.sum(rates.imag > 0)
    k = jnp.arange(n // 2)
    real = turning + 2 * (k - turning)
    first, second = (jnp.where(k < turning, k, real + i) for i in (0, 1))
    second_columns = jnp.where(
        k < turning, vectors[:, first].imag, vectors[:, second].real
    )
    return jnp.concatenate([vectors[:, first].real, second_columns], axis=1)


def matrices(system: System) -> tuple[Array, Array]:
    """Dense damping matrix B ``(S, S)`` N s/m and stiffness matrix K ``(S, S)`` N/m,
    meshes taken in contact.
    """
    xp = namespace(system)
    D = system.incidence().T
    B = xp.diag(system.damping) + D.T @ (system.viscous[:, None] * D)
    K = xp.diag(system.ground) + D.T @ (system.stiffness[:, None] * D)
    return B, K


def loss_stiffness(system: System) -> Array:
    """Imaginary part ``(S, S)`` N/m that loss factors add to K for harmonics
    above 0.
    """
    D = system.incidence().T
    return D.T @ ((system.loss * system.stiffness)[:, None] * D)


def loss_damping(system: System) -> np.ndarray:
    """Damping matrix ``(S, S)`` N s/m, host, that takes as much from every mode as loss
    factors do, which have no equation in time.

    With the undamped modes (``Phi^T M Phi = 1``, ``Phi^T K Phi = W^2``) and the
    imaginary stiffness H, the matrix C of ``Phi^T C Phi = W^-1/2 Phi^T H Phi W^-1/2``
    is symmetric, takes energy from all motions, and gives each mode the damping ratio
    that H gives it at its own frequency; off its resonance a mode is hardly damped by
    either.
    """
    if not np.any(system.loss):
        return np.zeros((len(system.mass),) * 2)
    mass = np.where(system.mass > 0, system.mass, LIGHT * np.mean(system.mass))
    scale = np.sqrt(mass)[:, None]
    _, K = matrices(system)
    squares, shapes = np.linalg.eigh(K / scale / scale.T)
    moving = squares > ROTATION * squares[-1]
    root = np.where(moving, np.where(moving, squares, 1.0) ** -0.25, 0.0)
    left = scale * shapes * root
    modal_loss = (shapes / scale).T @ loss_stiffness(system) @ (shapes / scale)
    return left @ modal_loss @ left.T


def partition(
    system: System,
    meshes: MeshParameters,
    disk_names: Sequence[str] | None = None,
    link_names: Sequence[str] | None = None,
    lossy: bool = False,
) -> Partition:
    """The :class:`Partition` of the disks, on the host; hashable, to be passed where
    the system is traced.

    meshes : those with backlash; disk_names, link_names : for the sentences of errors;
    lossy : whether loss factors are served, by :func:`loss_damping`. Raises ValueError
    naming loss factors, or massless disks that leave no equation to integrate.
    """
    if traced((system, meshes)):
        raise ValueError(
            "jit or vmap traces the train: pass parts=partition(system, meshes), made"
            " outside."
        )

    system = jax.tree.map(np.asarray, system)
    meshed = np.asarray(meshes.link)

    def named(names: Sequence[str] | None, kind: str, indices: Iterable[int]) -> str:
        return ", ".join(repr(names[i]) if names else f"{kind} {i}" for i in indices)

    refused: Sequence[int] | np.ndarray = [] if lossy else np.flatnonzero(system.loss)
    if len(refused):
        raise ValueError(
            f"{named(link_names, 'link', refused)}: loss factors exist only in harmonic"
            " methods: apply train.with_viscous_damping(hz=...)."
        )
    massless = np.flatnonzero(system.mass == 0)
    ends = np.concatenate([system.tree.end_a[meshed], system.tree.end_b[meshed]])
    for index in massless[np.isin(massless, ends)]:
        raise ValueError(
            f"{named(disk_names, 'disk', [index])} has no inertia and carries a"
            " backlash mesh: no equation of motion in time is left for it. Give it an"
            " inertia, or use a harmonic method."
        )
    B, K = matrices(system)
    undamped = ~np.any(B[massless] != 0, axis=1)
    static = massless[undamped]
    damped = massless[~undamped]
    for group, matrix, quantity in ((static, K, "stiffness"), (damped, B, "damping")):
        block = matrix[np.ix_(group, group)]
        scale = np.sqrt(np.maximum(np.diag(block), 1e-300))
        if not group.size:
            continue
        if not np.linalg.eigvalsh(block / scale[:, None] / scale)[0] > 1e-10:
            raise ValueError(
                f"{named(disk_names, 'disk', group)}: no inertia, and the {quantity}"
                " between them does not determine their motion. Give them an inertia,"
                " or use a harmonic method."
            )
    return Partition(
        inertial=tuple(np.flatnonzero(system.mass != 0).tolist()),
        damped=tuple(damped.tolist()),
        static=tuple(static.tolist()),
    )


def state_space(
    system: System,
    meshes: MeshParameters,
    frequency: Number,
    parts: Partition,
    damping: Number = 0.0,
) -> StateSpace:
    """The :class:`StateSpace` of the train and its meshes with backlash; ``frequency``
    Omega in rad/s only scales the slow modes, ``damping`` ``(S, S)`` N s/m acts beside
    that of the system.
    """
    xp = namespace(system, meshes, frequency)
    B, K = matrices(system)
    B = B + damping
    inertial = np.array(parts.inertial, dtype=int)
    damped = np.array(parts.damped, dtype=int)
    static = np.array(parts.static, dtype=int)
    dynamic = np.concatenate([inertial, damped])
    stiffness = K[np.ix_(dynamic, dynamic)]
    if static.size:
        coupling = K[np.ix_(static, dynamic)]
        stiffness = stiffness - coupling.T @ xp.linalg.solve(
            K[np.ix_(static, static)], coupling
        )
    n = inertial.size
    extra = damped.size
    root = xp.sqrt(system.mass[inertial])
    # Any orthonormal basis is exact, hence no derivative through that of the undamped
    # modes.
    constant = lax.stop_gradient if xp is jnp else lambda array: array
    scaled = constant(stiffness[:n, :n] / root[:, None] / root)
    squares, vectors = xp.linalg.eigh(scaled)
    scale = constant(xp.sqrt(xp.maximum(squares, frequency**2)))
    to_modal = vectors.T * root
    from_modal = vectors / root[:, None]
    drag = B[np.ix_(dynamic, dynamic)]
    # B x' + K x = 0: velocities of damped disks without inertia from all displacements
    # and the others' velocities.
    follow = xp.zeros((extra, 2 * n + extra))
    if extra:
        right = xp.concatenate([stiffness[n:], drag[n:, :n]], axis=1)
        follow = -xp.linalg.solve(drag[n:, n:], right)
    motion = xp.concatenate([xp.zeros((n, n + extra)), xp.eye(n)], axis=1)
    pull = xp.concatenate([stiffness[:n], drag[:n, :n]], axis=1) + drag[:n, n:] @ follow
    physical = xp.concatenate([motion, follow, -pull / (root**2)[:, None]])

    weight = xp.sqrt(xp.mean(root**2)) * frequency
    blocks = scipy.linalg.block_diag if xp is np else jax.scipy.linalg.block_diag
    to = blocks(scale[:, None] * to_modal, weight * xp.eye(extra), to_modal)
    back = blocks(from_modal / scale, xp.eye(extra) / weight, from_modal)
    mesh_rows = system.incidence(meshes.link).T[:, inertial]
    zeros = xp.zeros((meshes.link.shape[0], n + extra))
    observation = xp.block([[mesh_rows, zeros], [zeros, mesh_rows]])
    forcing = xp.concatenate([zeros.T, -mesh_rows.T / (root**2)[:, None]])
    disks = system.mass.shape[0]
    return StateSpace(
        transition=to @ physical @ back,
        forcing=to @ forcing,
        observation=observation @ back,
        coordinates=to @ np.eye(2 * disks)[np.concatenate([dynamic, disks + inertial])],
    )


def dense_linear_motion(system: System, frequency: Number, load: Array) -> Array:
    """Steady displacements ``(S, N+1)`` m of the train with all meshes in contact under
    ``load`` ``(S, N+1)`` N, one dense solve per harmonic; motions that no force opposes
    (rotation, rings without spring) have mean zero.
    """
    xp = namespace(system, frequency, load)
    B, K = matrices(system)
    mean = static_response(K, load[:, 0].real)
    omega = frequency * xp.arange(1, load.shape[-1])
    K = K + 1j * loss_stiffness(system)
    Z = (
        K
        + 1j * omega[:, None, None] * B
        - omega[:, None, None] ** 2 * xp.diag(system.mass)
    )
    harmonics = xp.linalg.solve(Z, load[:, 1:].T[..., None])[..., 0].T
    return xp.concatenate([mean[:, None] + 0j, harmonics], axis=1)


def static_response(K: Array, force: Array) -> Array:
    """Displacements K^-1 force ``(S,)`` m, without the motions that meet no stiffness
    (the load is balanced on them).
    """
    xp = namespace(K, force)
    diagonal = xp.diag(K)
    scale = xp.sqrt(xp.where(diagonal > 0, diagonal, 1.0))
    values, vectors = xp.linalg.eigh(K / scale[:, None] / scale)
    # Scaled by the diagonal: what is left of an eigenvalue that should be zero is
    # rounding.
    held = values > 1e-13
    inverse = xp.where(held, 1.0, 0.0) / xp.where(held, values, 1.0)
    return (vectors @ (inverse * (vectors.T @ (force / scale)))) / scale


@dataclass(frozen=True)
class ComplexModes:
    """Complex host arrays of m modes: rates ``(m,)`` 1/s; forcing ``(m, G)``;
    observation ``(2G, m)``; motion ``(2S, m)``; coordinates ``(m, 2S)``, z of (x, x').
    """

    rates: np.ndarray
    forcing: np.ndarray
    observation: np.ndarray
    motion: np.ndarray
    coordinates: np.ndarray

    def only(self, chosen: np.ndarray) -> ComplexModes:
        """Some of the modes, by index or mask."""
        return ComplexModes(
            rates=self.rates[chosen],
            forcing=self.forcing[chosen],
            observation=self.observation[:, chosen],
            motion=self.motion[:, chosen],
            coordinates=self.coordinates[chosen],
        )


def march_modes(
    system: System, meshes: MeshParameters, frequency: float, parts: Partition
) -> ComplexModes:
    """The :class:`ComplexModes` of a train; arguments as of :func:`state_space`."""
    # Springs in proportion to the inertias leave the undamped shapes as they are: they
    # part the Jordan block of free rotation, and raise the other frequencies by less
    # than rounding shows.
    soft = _holding(system, frequency, parts)
    held = dataclasses.replace(system, ground=system.ground + soft * system.mass)
    host_system, host_meshes = on_host((held, meshes))
    damping = loss_damping(held)
    space = state_space(host_system, host_meshes, frequency, parts, damping)
    return modes_of(space, _motion(system, space, parts))


def _holding(system: System, frequency: float, parts: Partition) -> float:
    """Stiffness over inertia, 1/s2, of the springs that hold free rotation."""
    inertial = np.array(parts.inertial, int)
    highest = np.max(
        np.asarray(system.held_stiffness())[inertial] / system.mass[inertial]
    )
    return max((HELD * frequency) ** 2, HELD_ROUNDED * highest)


def unheld_modes(
    system: System,
    meshes: MeshParameters,
    space: StateSpace,
    frequency: float,
    parts: Partition,
) -> ComplexModes:
    """The :class:`ComplexModes` of a train with its StateSpace, without the spring of
    :func:`march_modes`: where rotation is free its rates are 0.
    """
    rates, vectors = np.linalg.eig(space.transition)
    if np.linalg.cond(vectors) <= CONDITION:
        motion = _motion(system, space, parts)
        return _modes_of_pairs(rates, vectors, space, motion)
    modes = march_modes(system, meshes, frequency, parts)
    free = np.abs(modes.rates) <= 2 * np.sqrt(_holding(system, frequency, parts))
    return _without_spring(modes, free)


def _without_spring(modes: ComplexModes, free: np.ndarray) -> ComplexModes:
    """The ComplexModes with rates 0 where they are ``free`` ``(m,)``: real and
    imaginary part of a mode that turns on its spring are two, angle and speed of a
    rotation.
    """
    turns = free & (modes.rates.imag != 0)
    rest = modes.only(~turns)
    turning = modes.only(turns)
    zeros = np.zeros(np.count_nonzero(turns))

    def rows(name: str) -> np.ndarray:
        rotation = getattr(turning, name)
        return np.concatenate([getattr(rest, name), rotation.real, rotation.imag])

    def columns(name: str) -> np.ndarray:
        rotation = getattr(turning, name)
        return np.concatenate(
            [getattr(rest, name), rotation.real, -rotation.imag], axis=1
        )

    return ComplexModes(
        rates=np.concatenate([np.where(free[~turns], 0.0, rest.rates), zeros, zeros]),
        forcing=rows("forcing"),
        observation=columns("observation"),
        motion=columns("motion"),
        coordinates=rows("coordinates"),
    )


def modes_of(space: StateSpace, motion: np.ndarray) -> ComplexModes:
    """The :class:`ComplexModes` of a StateSpace; ``motion`` ``(2S, n)``: (x, x') of its
    states.
    """
    A = np.asarray(space.transition)
    rates, vectors = np.linalg.eig(A)
    if np.linalg.cond(vectors) > CONDITION:
        # Different shares for every state: equal ones would move all eigenvalues alike
        # and part none.
        shares = (1 + np.arange(len(A))) / len(A)
        damping = PARTING * np.abs(np.diag(A)).max() * shares
        rates, vectors = np.linalg.eig(A - np.diag(damping))
    return _modes_of_pairs(rates, vectors, space, motion)


def _modes_of_pairs(
    rates: np.ndarray, vectors: np.ndarray, space: StateSpace, motion: np.ndarray
) -> ComplexModes:
    """The :class:`ComplexModes` of eigenvalues and eigenvectors of a StateSpace: of a
    conjugate pair one.
    """
    forcing = np.asarray(space.forcing)
    observation = np.asarray(space.observation)
    coordinates = np.asarray(space.coordinates)
    # One mode of a conjugate pair, counted twice: Re(v z) of both is twice that of one.
    chosen = rates.imag >= 0
    inverse = np.linalg.inv(vectors)[chosen]
    rates = rates[chosen]
    vectors = np.where(rates.imag > 0, 2.0, 1.0) * vectors[:, chosen]
    return ComplexModes(
        rates=rates,
        forcing=inverse @ forcing,
        observation=observation @ vectors,
        motion=motion @ vectors,
        coordinates=inverse @ coordinates,
    )


def _motion(system: System, space: StateSpace, parts: Partition) -> np.ndarray:
    """Matrix ``(2S, n)`` from the state to (x, x') of all disks."""
    A = np.asarray(space.transition)
    T = np.asarray(space.coordinates)
    inertial = np.array(parts.inertial, int)
    dynamic = np.array(parts.inertial + parts.damped, int)
    static = np.array(parts.static, int)
    disks = len(system.mass)
    inverse = np.linalg.inv(T[:, np.concatenate([dynamic, disks + inertial])])
    x = np.zeros((disks, len(A)))
    x[dynamic] = inverse[: len(dynamic)]
    if static.size:
        K = np.asarray(matrices(system)[1])
        pull = K[np.ix_(static, dynamic)] @ x[dynamic]
        x[static] = -np.linalg.solve(K[np.ix_(static, static)], pull)
    return np.concatenate([x, x @ A])

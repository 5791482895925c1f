"""Reduced-order model that a train which marches may use in place of the true one:
inertial, viscous damping alone, few modes.

What the harmonics of a solve cannot see need not be integrated: modes faster than the
steps respond statically, a disk without inertia (beside a backlash mesh an algebraic
unknown) has a fast mode, loss factors damp each mode at its own frequency
(:func:`jaxhb.equations.state_space.loss_damping`), and a finely divided train is
projected on its responses to forces at the meshes over the frequencies that matter
(rational Krylov, Galerkin). Errors made here cost iterations, never accuracy.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array, Number
from jaxhb.equations.dynamic_stiffness import solve_linear, unit_forces
from jaxhb.equations.state_space import (
    LIGHT,
    ROTATION,
    StateSpace,
    modal_basis,
    paired,
    paired_matrix,
)
from jaxhb.equations.system import System

# Disks of a train, at most, whose modes are all part of the model
DISKS = 64
# Modes in the model of a larger train
MODES = 48
# Frequencies at which the responses of a larger train to mesh forces are taken, its
# basis
SHIFTS = 12
# Share of the largest drag that counts as none: rounding leaves more where inertias
# differ much
UNDAMPED = 1e-6
STILL = 1e-9  # times Omega, of a rate that rounding leaves of none
RESOLVED = 4  # steps per period of the slowest mode that is too fast for the steps


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ReducedOrderModel:
    """Slow modes, damped: first those that take longest to decay, last what does not
    move; and the static response ``(G, G)`` m/N of the fast ones.

    motion : ``(2S, n)``, displacements and velocities of the disks for each state;
    at_rest : ``(n, G)`` per N, state in which a constant nonlinear force of a mesh
    leaves what has a stiffness, and the rest at zero.
    """

    space: StateSpace
    residual_flexibility: Array
    motion: Array
    at_rest: Array


def states_of(disks: int) -> int:
    """Number of states of a reduced-order model, at most."""
    return 2 * (disks if disks <= DISKS else MODES)


def reduced_model(
    system: System, links: Array, active: Array, frequency: Number, time_steps: int
) -> ReducedOrderModel:
    """The :class:`ReducedOrderModel` of all modes of a train; of a larger train, of
    those that meshes see most.

    links, active : ``(G,)`` the links with backlash, and 1, 0 for padding; frequency :
    Omega in rad/s; time_steps : per cycle that will be taken: modes with fewer steps
    per period than resolve them are fast.
    """
    system = jax.tree.map(jnp.asarray, lax.stop_gradient(system))
    fastest = frequency * time_steps / RESOLVED
    # A disk without inertia gets a little.
    little = jnp.minimum(
        system.held_stiffness() / (30 * fastest) ** 2, LIGHT * jnp.mean(system.mass)
    )
    mass = jnp.where(
        system.mass > 0, system.mass, jnp.maximum(little, 1e-12 * jnp.mean(system.mass))
    )
    basis = _basis(system, mass, links, frequency, time_steps)
    bend = system.deflections(basis)
    K = basis.T @ (system.ground[:, None] * basis) + bend.T @ (
        system.stiffness[:, None] * bend
    )
    B = basis.T @ (system.damping[:, None] * basis) + bend.T @ (
        system.viscous[:, None] * bend
    )
    H = bend.T @ ((system.loss * system.stiffness)[:, None] * bend)
    squares, vectors = jnp.linalg.eigh(K)
    slow = squares <= fastest**2
    rows = active[:, None] * (bend[links] @ vectors)
    free = ROTATION * squares[-1]
    chosen: Array = np.arange(len(squares))
    if len(system.mass) > DISKS:
        seen = jnp.max(rows**2, axis=0, initial=0.0) / (squares + frequency**2)
        # The most visible of the slow modes
        chosen = jnp.argsort(jnp.where(slow, -seen, 1.0))[:MODES]
        slow = slow & jnp.zeros(len(squares), bool).at[chosen].set(True)
    # Fast modes respond statically: row^2 / omega^2 of each, their residual
    # flexibility.
    apart = ~slow & (squares > free)
    softness = jnp.where(apart, 1 / jnp.where(apart, squares, 1.0), 0.0)
    residual_flexibility = (rows * softness) @ rows.T
    vectors = jnp.where(slow, vectors, 0.0)[:, chosen]
    rows = jnp.where(slow, rows, 0.0)[:, chosen]
    squares = jnp.where(slow & (squares > free), squares, 0.0)[chosen]
    # As in loss_damping
    root = jnp.where(squares > 0, jnp.where(squares > 0, squares, 1.0) ** -0.25, 0.0)
    drag = vectors.T @ B @ vectors + root[:, None] * (vectors.T @ H @ vectors) * root
    # States (s q, q') of undamped modes: all entries are velocities, free rotation
    # included, whose q alone would have none.
    scale = jnp.sqrt(jnp.maximum(squares, frequency**2))
    shapes = basis @ vectors
    modal = shapes.T * mass
    zero = jnp.zeros_like(drag)
    row_zeros = jnp.zeros_like(rows)
    transition = jnp.block(
        [[zero, jnp.diag(scale)], [-jnp.diag(squares / scale), -drag]]
    )
    held = squares / scale > 1e-12 * jnp.max(squares / scale)
    at_rest = jnp.concatenate(
        [
            jnp.where(held, -rows / jnp.where(held, squares / scale, 1.0), 0.0).T,
            row_zeros.T,
        ]
    )
    # Undamped free rotation, and what is left out, has no two eigenvectors: with a
    # spring of its own it has.
    count = len(squares)
    isolated = (squares == 0) & (
        jnp.abs(drag).max(axis=1) <= UNDAMPED * jnp.abs(drag).max()
    )
    springs = jnp.where(isolated, scale * (1 + jnp.arange(count) / count), 0.0)
    basis = modal_basis(transition.at[count:, :count].add(-jnp.diag(springs)))
    rates = paired(jnp.linalg.solve(basis, transition @ basis))
    # What takes longest to decay first, and what does not move by itself, which no
    # cycle closes, last.
    trace = rates[0, 0] + rates[1, 1]
    determinant = rates[0, 0] * rates[1, 1] - rates[0, 1] * rates[1, 0]
    still = (jnp.abs(trace) < STILL * frequency) & (
        jnp.abs(determinant) < (STILL * frequency) ** 2
    )
    order = jnp.argsort(
        jnp.where(still, jnp.inf, -jnp.maximum(rates[0, 0], rates[1, 1]))
    )
    basis = basis[:, jnp.concatenate([order, count + order])]
    rates = rates[..., order]
    to_modes = partial(jnp.linalg.solve, basis)
    space = StateSpace(
        transition=paired_matrix(rates),
        forcing=to_modes(jnp.concatenate([row_zeros.T, -rows.T])),
        observation=jnp.block([[rows / scale, row_zeros], [row_zeros, rows]]) @ basis,
        coordinates=to_modes(
            jnp.block([[scale[:, None] * modal, 0 * modal], [0 * modal, modal]])
        ),
        in_modes=True,
    )
    motion = jnp.block([[shapes / scale, 0 * shapes], [0 * shapes, shapes]]) @ basis
    return ReducedOrderModel(space, residual_flexibility, motion, to_modes(at_rest))


def _basis(
    system: System, mass: Array, links: Array, frequency: Number, time_steps: int
) -> Array:
    """Columns ``(S, r)`` with ``basis^T M basis = 1``: all motions, or those that mesh
    forces excite.
    """
    root = jnp.sqrt(mass)[:, None]
    disks = len(system.mass)
    if disks <= DISKS:
        return jnp.eye(disks) / root
    # Harmonic of the fastest mode that so many time steps resolve
    highest = time_steps / 6
    # Geometric from the cycle to the fastest mode that the steps resolve: as many
    # shifts in each octave.
    omega = frequency * highest ** (jnp.arange(SHIFTS) / (SHIFTS - 1.0))
    motion, _ = solve_linear(
        system, omega, unit_forces(system.incidence(links), SHIFTS), forces=0
    )
    columns = root * jnp.concatenate([motion.real, motion.imag], axis=-1).reshape(
        disks, -1
    )
    # Responses at resonances would drown the others: columns of length one before they
    # are made orthogonal.
    sizes = jnp.linalg.norm(columns, axis=0)
    # Some may be 0: without damping there are no imaginary parts
    columns = columns / jnp.where(sizes > 0, sizes, 1.0)
    q, _ = jnp.linalg.qr(columns)
    return q / root

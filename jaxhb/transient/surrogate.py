"""A train that starts and preconditioners may use in place of the true one: inertial, without losses, of few modes.

What the harmonics of a solve cannot see need not be integrated: disks lighter than the fastest wanted motion could tell
get a mass (a disk without inertia beside a backlash mesh would be an algebraic unknown), loss factors become viscous
damping, and a finely divided train is projected on its answers to forces at the meshes over the frequencies that
matter (rational Krylov, Galerkin). Errors made here cost iterations, never accuracy.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..harmonic.reduction import incidence, solve_linear
from .statespace import StateSpace

LIGHT = 0.01
"""Share of the mean inertia that a disk may be given at most."""

LARGEST = 64
"""Disks, and modes of a larger train, that are kept."""

SHIFTS = 12
"""Frequencies at which the answers to mesh forces of a larger train are taken."""


def surrogate(system, links, active, frequency, instants, excited):
    """First-order equations ``y' = A y + E phi`` in modes, ``y = (s q, q')``, s = max(omega, Omega).

    Parameters
    ----------
    system : System
    links, active : arrays ``(G,)``, the links with backlash, and 1; 0 for padding
    frequency : float, Omega in rad/s
    instants : int, steps per cycle that will be taken: the fastest motion has four of them per period
    excited : int, harmonic at which a loss factor is turned into viscous damping

    Returns
    -------
    StateSpace
    """
    system = jax.tree.map(jnp.asarray, lax.stop_gradient(system))
    fastest = frequency * instants / 4
    mass = _inertial(system, fastest)
    basis = _basis(system, mass, links, frequency, instants)
    bend = system.deflections(basis, np.arange(len(system.stiffness)))
    viscous = system.viscous + system.loss * system.stiffness / (excited * frequency)
    K = basis.T @ (system.ground[:, None] * basis) + bend.T @ (system.stiffness[:, None] * bend)
    B = basis.T @ (system.damping[:, None] * basis) + bend.T @ (viscous[:, None] * bend)
    values, vectors = jnp.linalg.eigh(K)
    kept = min(LARGEST, len(values))
    squares, vectors = jnp.maximum(values[:kept], 0.0), vectors[:, :kept]
    scale = jnp.sqrt(jnp.maximum(squares, frequency**2))
    rows = active[:, None] * (bend[links] @ vectors)
    modal = vectors.T @ basis.T * mass
    zero, none = jnp.zeros((kept, kept)), jnp.zeros_like(rows)
    return StateSpace(
        transition=jnp.block([[zero, jnp.diag(scale)], [-jnp.diag(squares / scale), -vectors.T @ B @ vectors]]),
        forcing=jnp.concatenate([none.T, -rows.T]),
        observation=jnp.block([[rows / scale, none], [none, rows]]),
        coordinates=jnp.block([[scale[:, None] * modal, 0 * modal], [0 * modal, modal]]),
    )


def _inertial(system, fastest):
    """``(S,)`` kg: masses, none too light for steps of a quarter period of ``fastest`` rad/s."""
    tree = system.tree

    def at_disks(values):
        total = jnp.zeros(len(system.mass)).at[tree.end_a].add(system.arm_a**2 * values)
        return total.at[tree.end_b].add(system.arm_b**2 * values)

    pull = system.ground + at_disks(system.stiffness) + fastest * (system.damping + at_disks(system.viscous))
    return jnp.maximum(system.mass, jnp.minimum(pull / fastest**2, LIGHT * jnp.mean(system.mass)))


def _basis(system, mass, links, frequency, instants):
    """Columns ``(S, r)`` with ``basis^T M basis = 1``: all motions, or those that mesh forces excite."""
    root = jnp.sqrt(mass)[:, None]
    disks = len(system.mass)
    if disks <= LARGEST:
        return jnp.eye(disks) / root
    highest = instants / 6
    omega = frequency * highest ** (jnp.arange(SHIFTS) / (SHIFTS - 1.0))
    unit = jnp.broadcast_to(incidence(system, links)[:, None, :], (disks, SHIFTS, len(links)))
    motion, _ = solve_linear(system, omega, unit.astype(complex))
    columns = root * jnp.concatenate([motion.real, motion.imag], axis=-1).reshape(disks, -1)
    columns = columns / jnp.linalg.norm(columns, axis=0)
    q, _ = jnp.linalg.qr(columns)
    return q / root


def resting_on_flank(space, force):
    """State ``(2n,)`` at rest under constant mesh forces ``(G,)``; motion that meets no stiffness is left at zero."""
    n = space.transition.shape[0] // 2
    stiffness = -jnp.diag(space.transition[n:, :n])
    held = stiffness > 1e-12 * jnp.max(stiffness)
    position = jnp.where(held, space.forcing[n:] @ force, 0.0) / jnp.where(held, stiffness, 1.0)
    return jnp.concatenate([position, jnp.zeros(n)])

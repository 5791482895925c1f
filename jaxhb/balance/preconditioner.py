"""The linearised motion around one cycle: a periodic, time-varying linear train solved by one pass over the cycle.

With slopes w and s of the nonlinear force phi in l and l', the forces u in response to a given periodic motion b are

    z' = A z + E u,      u = w (b + l) + s (b' + l'),      (l, l') = L z,      z(T) = z(0).

u is taken as linear between the time steps of a grid: exact where a mesh stays in contact (u = 0) and where it flies
freely through its gap (l linear in time), so that six time steps per period of the highest mesh mode do. z(0) follows
from the slowest modes alone, whose memory outlasts the cycle. Work per time step is that of one small matrix product,
whatever the number of harmonics; it replaces the factorisation of a Jacobian in which all harmonics are coupled.

The cycle is cut into blocks that are passed through side by side from rest, 8 to 32 time steps each instead of
thousands one after another. What the state at the beginning of a block adds is known beforehand: its forces solve a
triangular system of the block, as the train itself does not change from time step to time step.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.scipy.linalg import solve_triangular

from jaxhb.integration.step import hold_weights

SLOW_MODES = 16  # whose state is carried from the end of the cycle to its beginning
LONGEST, SHORTEST = 32, 8  # time steps of a block, powers of two; every grid is a multiple of the longest
BLOCK_FORCES = 64  # forces of all meshes in a block that are aimed at: they make one triangular system


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PeriodicOperator:
    """What the pass needs at K = B m time steps, B blocks of m; n states, G meshes, C of the states periodic.

    propagate ``(n, n)``, forcing ``(n, G)``, observation ``(2G, n)``; gain ``(m, G, 2G, B)``: force of a mesh per
    motion. Per unit state at the beginning of a block: block_forces ``(B, m G, n)``; block_propagator ``(B, n, n)``,
    the state at its end. block_starts ``(B, n, C)``: state at the beginning of a block per state at that of the cycle;
    closing ``(C, n)``: from the state at the end of a cycle begun at zero to that at the beginning of the periodic one.
    """

    propagate: jax.Array
    forcing: jax.Array
    observation: jax.Array
    gain: jax.Array
    block_forces: jax.Array
    block_propagator: jax.Array
    block_starts: jax.Array
    closing: jax.Array

    @property
    def time_steps(self):
        """K, time steps per cycle."""
        return self.gain.shape[0] * self.gain.shape[-1]

    def forces(self, motion):
        """Forces u ``(G, K)`` in response to the motion ``(2G, K)``: b above b'."""
        length, meshes, _, blocks = self.gain.shape
        motion = motion.reshape(-1, blocks, length).transpose(2, 0, 1)

        def step(state, known):
            gain, motion = known
            force = jnp.sum(gain * (motion + self.observation @ state), axis=1)
            return self.propagate @ state + self.forcing @ force, force

        rest = jnp.zeros((len(self.propagate), blocks))
        left, force = lax.scan(step, rest, (self.gain, motion))

        def join(state, known):
            propagator, left = known
            return propagator @ state + left, state

        end, begins = lax.scan(join, rest[:, 0], (self.block_propagator, left.T))
        begins = begins + self.block_starts @ (self.closing @ end)
        of_begins = jnp.einsum("bfn,bn->bf", self.block_forces, begins)
        force = force.transpose(2, 0, 1) + of_begins.reshape(blocks, length, meshes)
        return force.transpose(2, 0, 1).reshape(meshes, -1)


def linearize(model, frequency, slope, rate_slope):
    """The PeriodicOperator of a ReducedModel for slopes ``(G, K)`` of phi, averages around K equidistant time steps."""
    meshes, time_steps = slope.shape
    propagate, early, late = hold_weights(model.space, 2 * jnp.pi / frequency / time_steps)
    L = model.space.observation
    # Force that acts in a step moves the meshes at its end at once, by the late weight and by the residual flexibility:
    # u = S (w + at_once u), solved for u mesh by mesh.
    at_once = (L @ late).at[:meshes].add(-model.residual_flexibility)
    own = jnp.eye(meshes)
    slopes = jnp.concatenate([slope.T[:, :, None] * own, rate_slope.T[:, :, None] * own], axis=2)
    gain = jnp.linalg.solve(own - slopes @ at_once, slopes)
    # The state kept is that without the late part of the last force, so that each force enters once.
    forcing = propagate @ late + early
    length = min(LONGEST, 1 << max(SHORTEST, BLOCK_FORCES // meshes).bit_length() - 1)
    gain = gain.reshape(-1, length, meshes, 2 * meshes)
    block_forces, block_propagator = _per_state(propagate, forcing, L, gain)

    n = len(propagate) // 2
    slow = min(SLOW_MODES, n)
    kept = np.r_[0:slow, n : n + slow]
    begin = jnp.eye(2 * n)[:, kept]
    end, block_starts = lax.scan(lambda state, propagator: (propagator @ state, state), begin, block_propagator)
    # z(T) = z(0) on the slow modes: (I - Phi) z(0) = what one cycle from rest leaves. The pseudo-inverse leaves free
    # rotation alone.
    gap = jnp.eye(len(kept)) - end[kept]
    closing = jnp.zeros((len(kept), 2 * n)).at[:, kept].set(jnp.linalg.pinv(gap, rtol=1e-9))
    gain = gain.transpose(1, 2, 3, 0)
    return PeriodicOperator(propagate, forcing, L, gain, block_forces, block_propagator, block_starts, closing)


def _per_state(propagate, forcing, L, gain):
    """``block_forces`` and ``block_propagator`` of blocks with the gains ``(B, m, G, 2G)``."""
    blocks, length, meshes, _ = gain.shape
    _, observed = lax.scan(lambda row, _: (row @ propagate, row), L, length=length)
    _, pushed = lax.scan(lambda column, _: (propagate @ column, column), forcing, length=length)
    # A force acts on later steps of its block by L exp(A dt (k - j)) E: lower triangular, solved at once for all unit
    # states.
    delay = np.arange(length)[:, None] - np.arange(length) - 1
    response = jnp.where((delay >= 0)[:, :, None, None], (observed @ forcing)[np.maximum(delay, 0)], 0.0)
    coupling = jnp.einsum("bkgh,kjhf->bkgjf", gain, response).reshape(blocks, length * meshes, length * meshes)
    alone = jnp.einsum("bkgh,khn->bkgn", gain, observed).reshape(blocks, length * meshes, -1)
    unit = jnp.eye(length * meshes)
    block_forces = solve_triangular(unit - coupling, alone, lower=True, unit_diagonal=True)
    pushed = pushed[::-1].transpose(1, 0, 2).reshape(len(propagate), -1)
    return block_forces, jnp.linalg.matrix_power(propagate, length) + pushed @ block_forces

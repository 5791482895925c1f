"""One linear solve with the Jacobian of the condensed equation, ``J = I + G (w + s d/dt)``: Krylov steps on the exact
Jacobian, preconditioned by the linearised motion in time, whose cost does not grow with the number of harmonics.

The preconditioner: with slopes w and s of the nonlinear force phi in l and l', the forces u in response to a given
periodic motion b are

    z' = A z + E u,      u = w (b + l) + s (b' + l'),      (l, l') = L z,      z(T) = z(0).

u is taken as linear between the time steps of a grid: exact where a mesh stays in contact (u = 0) and where it flies
freely through its gap (l linear in time), so that six time steps per period of the highest mesh mode do. z(0) follows
from the modes that take longest to decay, whose memory outlasts the cycle. The cycle is cut into blocks of 8 to 32 time
steps that are passed through side by side from rest. What the state at the beginning of a block adds is known
beforehand: its forces solve a triangular system of the block, as the train itself does not change from time step to
time step.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb.equations import fourier
from jaxhb.equations.iterations import gcr
from jaxhb.equations.state_space import paired, propagated
from jaxhb.integration.step import hold_weights

DERIVATIVE = 1e-12, 60  # share of the right side that a derivative may leave, and its Krylov steps at most
NO_DERIVATIVE = 1e-8  # share beyond which it is none, and nan: where the Jacobian is nearly singular, as at a fold
BORDERED = 1e-9  # share that a bordered solve may leave: of tangents, and of Newton's method, which gains digits
SLOW_MODES = 16  # that take longest to decay, whose state is carried from the end of the cycle to its beginning
LONGEST, SHORTEST = 32, 8  # time steps of a block, powers of two; every grid is a multiple of the longest
BLOCK_FORCES = 64  # forces of all meshes in a block that are aimed at: they make one triangular system


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PeriodicOperator:
    """What the pass needs at K = B m time steps, B blocks of m; n states, G meshes, C of the states periodic.

    propagator ``(2, 2, n/2)`` of damped modes, forcing ``(n, G)``, observation ``(2G, n)``; gain ``(m, G, 2G, B)``:
    force of a mesh per motion. Per unit state at the beginning of a block, the rows: block_forces ``(B, n, m G)``;
    block_propagator ``(B, n, n)``, the state at its end. block_starts ``(B, C, n)``: state at the beginning of a block
    per state, the row, at that of the cycle; closing ``(n, C)``: from the state at the end of a cycle begun at zero,
    the row, to that at the beginning of the periodic one.
    """

    propagator: jax.Array
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
            return propagated(self.propagator, state) + self.forcing @ force, force

        rest = jnp.zeros((len(self.forcing), blocks))
        left, force = lax.scan(step, rest, (self.gain, motion))

        def join(state, known):
            propagator, left = known
            return state @ propagator + left, state

        end, begins = lax.scan(join, rest[:, 0], (self.block_propagator, left.T))
        begins = begins + (end @ self.closing) @ self.block_starts
        of_begins = jnp.einsum("bnf,bn->bf", self.block_forces, begins)
        force = force.transpose(2, 0, 1) + of_begins.reshape(blocks, length, meshes)
        return force.transpose(2, 0, 1).reshape(meshes, -1)


def linearize(model, frequency, slope, rate_slope):
    """The PeriodicOperator of a ReducedOrderModel for slopes ``(G, K)`` of phi, averages around K time steps."""
    meshes, time_steps = slope.shape
    propagate, early, late = hold_weights(model.space, 2 * jnp.pi / frequency / time_steps)
    L = model.space.observation
    # Force that acts in a step moves the meshes at its end at once, by the late weight and by the residual flexibility:
    # u = S (w + at_once u), solved for u mesh by mesh.
    at_once = (L @ late).at[:meshes].add(-model.residual_flexibility)
    gain = _gain(slope, rate_slope, at_once)
    # The state kept is that without the late part of the last force, so that each force enters once.
    forcing = propagate @ late + early
    length = min(LONGEST, 1 << max(SHORTEST, BLOCK_FORCES // meshes).bit_length() - 1)
    block_forces, block_propagator = _per_state(propagate, forcing, L, gain.reshape(-1, length, meshes, 2 * meshes))

    n = len(propagate) // 2
    slow = min(SLOW_MODES, n)
    kept = np.r_[0:slow, n : n + slow]
    begin = jnp.eye(2 * n)[kept]
    end, block_starts = lax.scan(lambda state, propagator: (state @ propagator, state), begin, block_propagator)
    # z(T) = z(0) on the slow modes: (I - Phi) z(0) = what one cycle from rest leaves. The pseudo-inverse leaves free
    # rotation alone.
    gap = jnp.eye(len(kept)) - end[:, kept]
    closing = jnp.zeros((2 * n, len(kept))).at[kept].set(jnp.linalg.pinv(gap, rtol=1e-9))
    gain = gain.reshape(-1, length, meshes, 2 * meshes).transpose(1, 2, 3, 0)
    return PeriodicOperator(paired(propagate), forcing, L, gain, block_forces, block_propagator, block_starts, closing)


def _gain(slope, rate_slope, at_once):
    """``(K, G, 2G)``: the forces u = S (w + at_once u) of the meshes per w, with S of the slopes ``(G, K)``."""
    own = jnp.eye(len(slope))[:, :, None]
    slopes = jnp.concatenate([own * slope, own * rate_slope], axis=1)
    rows = jnp.concatenate([own - jnp.einsum("ghk,hf->gfk", slopes, at_once), slopes], axis=1)
    # Elimination of all time steps side by side, an eighth of the time of a library's one after another. Without
    # pivots: where its slope is lost, a mesh has more compliance, never less than none.
    for i in range(len(slope)):
        row = rows[i] / rows[i, i]
        rows = (rows - rows[:, i, None] * row).at[i].set(row)
    return rows[:, len(slope) :].transpose(2, 0, 1)


def _per_state(propagate, forcing, L, gain):
    """``block_forces`` and ``block_propagator`` of blocks with the gains ``(B, m, G, 2G)``."""
    blocks, length, meshes, _ = gain.shape
    _, observed = lax.scan(lambda row, _: (row @ propagate, row), L, length=length)
    _, pushed = lax.scan(lambda column, _: (propagate @ column, column), forcing, length=length)
    # A force acts on later steps of its block by L exp(A dt (k - j)) E: lower triangular, solved at once for all unit
    # states.
    delay = np.arange(length)[:, None] - np.arange(length) - 1
    response = jnp.where((delay >= 0)[:, :, None, None], (observed @ forcing)[np.maximum(delay, 0)], 0.0)
    size = length * meshes
    coupling = jnp.einsum("bkgh,kjhf->bjfkg", gain, response).reshape(blocks, size, size)
    alone = jnp.einsum("bkgh,khn->bnkg", gain, observed).reshape(blocks, -1, size)
    # States are rows, as the library wants them: two thirds of the time.
    block_forces = lax.linalg.triangular_solve(jnp.eye(size) - coupling, alone, unit_diagonal=True)
    pushed = pushed[::-1].transpose(0, 2, 1).reshape(size, -1)
    return block_forces, jnp.linalg.matrix_power(propagate, length).T + block_forces @ pushed


def cell_averages(values, cells):
    """Averages of periodic samples ``(G, samples)`` over ``cells`` equal cells centred on their time samples."""
    samples = values.shape[-1]
    integral = jnp.concatenate([jnp.zeros_like(values[..., :1]), jnp.cumsum(values, axis=-1)], axis=-1)
    integral = jnp.concatenate([integral, integral[..., -1:] + integral[..., 1:]], axis=-1)
    # Sample j stands for the time from j - 1/2 to j + 1/2. Where the first cell begins before the cycle does, all cells
    # are taken one cycle later: the integral is there for two.
    edges = (jnp.arange(cells + 1) - 0.5) * (samples / cells) + 0.5
    edges = edges + (edges[0] < 0) * samples
    low = jnp.floor(edges).astype(int)
    share = edges - low
    at_edges = (1 - share) * integral[..., low] + share * integral[..., low + 1]
    return jnp.diff(at_edges, axis=-1) * (cells / samples)


def prepare(reduced, model, deflection, samples, time_steps):
    """The :class:`PeriodicOperator` of a ReducedOrderModel around a motion ``(G, N+1)``."""
    _, slope, rate_slope = reduced.nonlinear_force(*reduced.sampled(deflection, samples), fourier.Equidistant(samples))
    slope, rate_slope = cell_averages(slope, time_steps), cell_averages(rate_slope, time_steps)
    return linearize(model, reduced.frequency, slope, rate_slope)


def precondition(reduced, operator, b):
    """Approximate solution of ``J delta = b``, coefficients ``(G, N+1)``; the identity beyond the harmonics that
    the time steps of the operator tell apart."""
    time_steps = operator.time_steps
    low = fourier.resize(b, min(b.shape[-1] - 1, time_steps // 2 - 1))
    both = jnp.concatenate([low, fourier.derivative(low, reduced.frequency)])
    forces = operator.forces(fourier.synthesize(both, time_steps))
    kept = low.shape[-1]
    # Forces are linear between time steps: a hat function, whose Fourier coefficients are squares of sinc.
    linear_between = jnp.sinc(jnp.arange(kept) / time_steps) ** 2
    nonlinear_force = linear_between * fourier.analyze(forces, kept - 1)
    return b.at[:, :kept].add(-jnp.einsum("ngh,hn->gn", reduced.receptance[:kept], nonlinear_force))


def force_change(reduced, deflection, samples):
    """The product ``delta -> w delta + s delta'``, coefficients ``(G, N+1)``: what a change of ``deflection`` is to
    phi, law sampled at ``samples`` time samples or integrated exactly.

    The slopes enter a Galerkin product with at most 2 N harmonics. With a change of N it has 3 N, of which none is seen
    at those up to N from 4 N + 1 time samples on: 4.5 N give it exactly.
    """
    harmonics = deflection.shape[-1] - 1
    time_samples = (9 * harmonics + 1) // 2
    slope, rate_slope = fourier.synthesize(reduced.nonlinear_slopes(deflection, samples, 2 * harmonics), time_samples)

    def product(delta):
        change, rate = reduced.sampled(delta, time_samples)
        return fourier.analyze(slope * change + rate_slope * rate, harmonics)

    return product


def tangent(reduced, deflection, samples):
    """The product ``delta -> J delta`` at ``deflection``, law as in :func:`force_change`."""
    return _tangent(reduced, force_change(reduced, deflection, samples))


def _tangent(reduced, forces):
    return lambda delta: delta + reduced.respond(forces(delta))


def correct(reduced, operator, deflection, value, samples, forcing, steps):
    """``J change = value`` at ``deflection``: (change, share of the residual that is left, Krylov steps).

    operator : from :func:`prepare` at this motion or a near one; deflection, value ``(G, N+1)``; forcing : wanted
    share; steps : largest number of Krylov steps (static).
    """
    product, approximate = _packed(reduced, operator, deflection, force_change(reduced, deflection, samples))
    change, left, used = gcr(product, approximate, fourier.pack(value).reshape(-1), tolerance=forcing, steps=steps)
    return _coefficients(change, deflection), left, used


def invert(reduced, operator, deflection, value, forces):
    """``change`` with ``J change = value``, J with the ``forces`` of :func:`force_change`; differentiable, its
    transpose solves with the transpose of J.

    nan where the Krylov steps leave too much.
    """
    product, approximate = _packed(reduced, operator, deflection, forces)
    value = fourier.pack(value).reshape(-1)

    def solve(apply, b, approximate=approximate):
        tolerance, steps = DERIVATIVE
        change, left, _ = gcr(apply, approximate, b, tolerance=tolerance, steps=steps)
        return jnp.where(left <= NO_DERIVATIVE, change, jnp.nan)

    def solve_transposed(apply, b):
        _, transposed = jax.vjp(approximate, b)  # jax.linear_transpose of a loop fails with jax 0.9
        return solve(apply, b, lambda v: transposed(v)[0])

    return _coefficients(lax.custom_linear_solve(product, value, solve, solve_transposed), deflection)


def correct_bordered(reduced, operator, deflection, border, right, samples, steps):
    """Solve ``J x + column p = f,  row . (x, p) = g``, regular at a fold, too, for each array ``(n+1,)`` of ``right``.

    border : column ``(n,)`` packed, row ``(n+1,)``; others as in :func:`correct`.
    """
    product, approximate = _packed(reduced, operator, deflection, force_change(reduced, deflection, samples))
    column, row = border
    # Block elimination with the preconditioner in place of J: J^-1 column once, then p from the last row. Its pivot
    # does not vanish at a fold, where J alone is singular.
    column_solved = approximate(column)
    pivot = row[-1] - row[:-1] @ column_solved

    def whole(z):
        return jnp.append(product(z[:-1]) + column * z[-1], row @ z)

    def approximately(b):
        alone = approximate(b[:-1])
        p = (b[-1] - row[:-1] @ alone) / jnp.where(pivot == 0, 1.0, pivot)
        return jnp.append(alone - p * column_solved, p)

    return [gcr(whole, approximately, b, tolerance=BORDERED, steps=steps)[0] for b in right]


def _packed(reduced, operator, deflection, forces):
    """The product with J at ``deflection``, of the ``forces`` of :func:`force_change`, and its approximate inverse in
    packed coordinates ``(n,)``, orthonormal."""
    product = _tangent(reduced, forces)

    def flat(function):
        return lambda packed: fourier.pack(function(_coefficients(packed, deflection))).reshape(-1)

    return flat(product), flat(lambda b: precondition(reduced, operator, b))


def _coefficients(packed, like):
    return fourier.unpack(packed.reshape(len(like), -1))

"""One linear solve with the Jacobian of the reduced equation, ``J = I + G (w + s d/dt)``.

Krylov steps on the exact Jacobian, preconditioned by the linearised motion in time
(:mod:`jaxhb.balance.preconditioner`), whose cost does not grow with the number of harmonics.
"""

import jax
import jax.numpy as jnp
from jax import lax

from jaxhb.balance.preconditioner import linearize
from jaxhb.equations import fourier
from jaxhb.equations.iterations import gcr

DERIVATIVE = 1e-12, 60  # share of the right side that a derivative may leave, and its Krylov steps at most
NO_DERIVATIVE = 1e-8  # share beyond which it is none, and nan: where the Jacobian is nearly singular, as at a fold
BORDERED = 1e-9  # share that a bordered solve may leave: of tangents, and of Newton's method, which gains digits


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
    """The :class:`~jaxhb.balance.preconditioner.PeriodicOperator` of a ReducedModel around a motion ``(G, N+1)``."""
    _, slope, rate_slope = reduced.nonlinear_force(*reduced.sampled(deflection, samples))
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


def tangent(reduced, deflection, samples):
    """The product ``delta -> J delta`` at ``deflection``, law sampled at ``samples`` time samples or integrated
    exactly.

    The slopes enter a Galerkin product with at most 2 N harmonics. With a change of N it has 3 N, of which none is seen
    at those up to N from 4 N + 1 time samples on: 4.5 N give it exactly.
    """
    harmonics = deflection.shape[-1] - 1
    time_samples = (9 * harmonics + 1) // 2
    slope, rate_slope = fourier.synthesize(reduced.nonlinear_slopes(deflection, samples, 2 * harmonics), time_samples)

    def product(delta):
        change, rate = reduced.sampled(delta, time_samples)
        return delta + reduced.respond(fourier.analyze(slope * change + rate_slope * rate, harmonics))

    return product


def correct(reduced, operator, deflection, value, samples, forcing, steps):
    """``J change = value`` at ``deflection``: (change, share of the residual that is left, Krylov steps).

    operator : from :func:`prepare` at this motion or a near one; deflection, value ``(G, N+1)``; forcing : wanted
    share; steps : largest number of Krylov steps (static).
    """
    product, approximate = _packed(reduced, operator, deflection, samples)
    change, left, used = gcr(product, approximate, fourier.pack(value).reshape(-1), tolerance=forcing, steps=steps)
    return _coefficients(change, deflection), left, used


def invert(reduced, operator, deflection, value, samples):
    """``change`` with ``J change = value``; differentiable, its transpose solves with the transpose of J.

    nan where the Krylov steps leave too much.
    """
    product, approximate = _packed(reduced, operator, deflection, samples)
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
    product, approximate = _packed(reduced, operator, deflection, samples)
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


def _packed(reduced, operator, deflection, samples):
    """The product with J at ``deflection`` and its approximate inverse in packed coordinates ``(n,)``, orthonormal."""
    product = tangent(reduced, deflection, samples)

    def flat(function):
        return lambda packed: fourier.pack(function(_coefficients(packed, deflection))).reshape(-1)

    return flat(product), flat(lambda b: precondition(reduced, operator, b))


def _coefficients(packed, like):
    return fourier.unpack(packed.reshape(len(like), -1))

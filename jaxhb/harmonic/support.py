"""Corrections that live only where a mesh is out of contact: the preconditioner of the reduced equation.

The Jacobian of ``F(l) = l - l_lin + G phi(l, l')`` is ``I + G (w + s d/dt)`` with w, s the slopes of phi in l and l'. Both vanish
while a mesh is in contact. On a grid of 2 N instants, ``u = w delta + s delta'`` solves

    u + (w G + s G d/dt) u = w b + s b',        delta = b - G u,

a dense system for the instants out of contact alone. It is solved by one LU and preconditions GMRES on the true
Jacobian, whose products with w and s use all samples.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from . import fourier


class Support(NamedTuple):
    """Instants out of contact (flat index into ``(G, 2N)``), the slopes of phi there, and the LU of the correction."""

    index: jax.Array
    slope: jax.Array
    rate_slope: jax.Array
    factor: tuple


def instants(harmonics):
    """Number of instants of the grid, to which the samples of the law are averaged in groups."""
    return 2 * harmonics


def group(values, harmonics):
    """Averages of samples ``(G, samples)`` over the cells of the grid, centred on its instants: ``(G, 2N)``."""
    grid = instants(harmonics)
    size = values.shape[-1] // grid
    centred = jnp.roll(values, size // 2, axis=-1)
    return centred.reshape(*values.shape[:-1], grid, size).mean(-1)


def importance(law, viscous, slope, rate_slope):
    """How far each instant is from contact, dimensionless, 0 in contact."""
    stiffness = jnp.where(law.stiffness > 0, law.stiffness, 1.0)[:, None]
    damping = jnp.where(viscous > 0, viscous, 1.0)[:, None]
    return jnp.abs(slope) / stiffness + jnp.abs(rate_slope) / damping


def prepare(reduced, slope, rate_slope, size):
    """Factor the correction on the ``size`` instants that are furthest from contact.

    Parameters
    ----------
    reduced : Reduced
    slope, rate_slope : arrays ``(G, samples)``, slopes of phi in l and l'
    size : int, room (static); instants that find no room are treated as in contact

    Returns
    -------
    Support
    """
    harmonics = reduced.linear.shape[-1] - 1
    grid = instants(harmonics)
    slope, rate_slope = group(slope, harmonics), group(rate_slope, harmonics)
    weight = importance(reduced.law, reduced.viscous, slope, rate_slope)
    _, index = lax.top_k(weight.reshape(-1), size)
    mesh, instant = index // grid, index % grid
    w, s = slope.reshape(-1)[index], rate_slope.reshape(-1)[index]
    kernel = _halve_last(reduced.receptance.transpose(1, 2, 0))
    rate_kernel = fourier.derivative(kernel, reduced.frequency)
    meshes = kernel.shape[0]
    place = (mesh[:, None] * meshes + mesh[None, :]) * grid + (instant[:, None] - instant[None, :]) % grid
    matrix = w[:, None] * fourier.synthesize(kernel, grid).reshape(-1)[place]
    matrix = matrix + s[:, None] * fourier.synthesize(rate_kernel, grid).reshape(-1)[place]
    return Support(index, w, s, jax.scipy.linalg.lu_factor(jnp.eye(size) + matrix / grid))


def _halve_last(coefficients):
    """A grid of 2N instants cannot tell harmonic N from its mirror image: each gets half."""
    return coefficients.at[..., -1].multiply(0.5)


def apply(reduced, support, b):
    """Approximate solution delta of ``J delta = b``, coefficients ``(G, N+1)``."""
    meshes, width = b.shape
    grid = instants(width - 1)
    values = fourier.synthesize(b, grid).reshape(-1)[support.index]
    rates = fourier.synthesize(fourier.derivative(b, reduced.frequency), grid).reshape(-1)[support.index]
    u = jax.scipy.linalg.lu_solve(support.factor, support.slope * values + support.rate_slope * rates)
    spread = jnp.zeros(meshes * grid).at[support.index].set(u).reshape(meshes, grid)
    return b - reduced.respond(fourier.analyze(spread, width - 1))

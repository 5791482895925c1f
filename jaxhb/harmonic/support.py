"""Corrections that live only where a mesh is out of contact: the preconditioner of the reduced equation.

The Jacobian of ``F(l) = l - l_lin + G phi(l, l')`` is ``I + G (w + s d/dt)`` with w, s the slopes of phi in l and l'.
Both vanish while a mesh is in contact. On a grid of instants, ``u = w delta + s delta'`` solves

    u + (w G + s G d/dt) u = w b + s b',        delta = b - G u,

a dense system for the instants out of contact alone. One LU of it preconditions GMRES on the true Jacobian, whose
products with w and s use all samples. The grid resolves the harmonics up to a little above the mesh modes; beyond them
G falls like 1/n^2 and the identity is good enough, so that the size of the LU does not grow with N.
"""

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
from jax import lax

from . import fourier


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Support:
    """Instants out of contact, slopes of phi there, LU of the correction, and the harmonics that it resolves.

    index : ``(K,)`` flat places in ``(G, 2 harmonics)``; slope, rate_slope : ``(K,)``; factor, pivots : LU.
    """

    index: jax.Array
    slope: jax.Array
    rate_slope: jax.Array
    factor: jax.Array
    pivots: jax.Array
    harmonics: int = field(metadata={"static": True})


def cell_averages(values, cells):
    """Averages of periodic samples ``(G, samples)`` over ``cells`` equal cells centred on their instants."""
    samples = values.shape[-1]
    integral = jnp.concatenate([jnp.zeros_like(values[..., :1]), jnp.cumsum(values, axis=-1)], axis=-1)
    integral = jnp.concatenate([integral, integral[..., -1:] + integral[..., 1:]], axis=-1)
    edges = (jnp.arange(cells + 1) - 0.5) * (samples / cells) + 0.5
    edges = edges + (edges[0] < 0) * samples
    low = jnp.floor(edges).astype(int)
    share = edges - low
    at_edges = (1 - share) * integral[..., low] + share * integral[..., low + 1]
    return jnp.diff(at_edges, axis=-1) * (cells / samples)


def importance(law, viscous, slope, rate_slope):
    """How far each instant is from contact, dimensionless, 0 in contact."""
    stiffness = jnp.where(law.stiffness > 0, law.stiffness, 1.0)[:, None]
    damping = jnp.where(viscous > 0, viscous, 1.0)[:, None]
    return jnp.abs(slope) / stiffness + jnp.abs(rate_slope) / damping


def prepare(reduced, slope, rate_slope, size, harmonics):
    """Factor the correction on the ``size`` instants that are furthest from contact.

    Parameters
    ----------
    reduced : Reduced
    slope, rate_slope : arrays ``(G, samples)``, slopes of phi in l and l'
    size : int, room (static); instants that find no room are treated as in contact
    harmonics : int (static), harmonics that the correction resolves, on a grid of twice as many instants

    Returns
    -------
    Support
    """
    grid = 2 * harmonics
    slope, rate_slope = cell_averages(slope, grid), cell_averages(rate_slope, grid)
    weight = importance(reduced.law, reduced.viscous, slope, rate_slope)
    _, index = lax.top_k(weight.reshape(-1), size)
    mesh, instant = index // grid, index % grid
    w, s = slope.reshape(-1)[index], rate_slope.reshape(-1)[index]
    kernel = _halve_last(reduced.receptance[: harmonics + 1].transpose(1, 2, 0))
    rate_kernel = fourier.derivative(kernel, reduced.frequency)
    meshes = kernel.shape[0]
    place = (mesh[:, None] * meshes + mesh[None, :]) * grid + (instant[:, None] - instant[None, :]) % grid
    matrix = w[:, None] * fourier.synthesize(kernel, grid).reshape(-1)[place]
    matrix = matrix + s[:, None] * fourier.synthesize(rate_kernel, grid).reshape(-1)[place]
    factor, pivots = jax.scipy.linalg.lu_factor(jnp.eye(size) + matrix / grid)
    return Support(index, w, s, factor, pivots, harmonics)


def _halve_last(coefficients):
    """A grid of 2N instants cannot tell harmonic N from its mirror image: each gets half."""
    return coefficients.at[..., -1].multiply(0.5)


def apply(reduced, support, b):
    """Approximate solution delta of ``J delta = b``, coefficients ``(G, N+1)`` with N at least the resolved ones."""
    meshes = b.shape[0]
    kept = support.harmonics + 1
    grid = 2 * support.harmonics
    low = b[:, :kept]
    values = fourier.synthesize(low, grid).reshape(-1)[support.index]
    rates = fourier.synthesize(fourier.derivative(low, reduced.frequency), grid).reshape(-1)[support.index]
    load = support.slope * values + support.rate_slope * rates
    u = jax.scipy.linalg.lu_solve((support.factor, support.pivots), load)
    spread = jnp.zeros(meshes * grid).at[support.index].set(u).reshape(meshes, grid)
    excess = fourier.analyze(spread, support.harmonics)
    response = jnp.einsum("ngh,hn->gn", reduced.receptance[:kept], excess)
    return b.at[:, :kept].add(-response)

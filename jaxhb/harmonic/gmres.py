"""Restart-free GMRES with a right preconditioner, in ``lax.while_loop``; vectors are flat real arrays."""

import jax.numpy as jnp
from jax import lax


def gmres(apply, precondition, b, *, tolerance, steps):
    """Solve ``apply(x) = b`` with x in the range of ``precondition``.

    Parameters
    ----------
    apply, precondition : callables on arrays ``(n,)``
    b : array ``(n,)``
    tolerance : float
        Stop when the residual norm has fallen to ``tolerance * |b|``.
    steps : int
        Largest dimension of the Krylov space (static).

    Returns
    -------
    x : array ``(n,)``
    residual : float, estimated ``|b - apply(x)| / |b|``
    used : int, steps taken
    """
    norm = jnp.linalg.norm(b)
    scale = jnp.where(norm > 0, norm, 1.0)
    size = b.shape[0]
    basis = jnp.zeros((steps + 1, size)).at[0].set(b / scale)
    triangle = jnp.zeros((steps, steps))
    rhs = jnp.zeros(steps + 1).at[0].set(norm)
    rotations = jnp.zeros((steps, 2))

    def unfinished(state):
        k, _, _, rhs, _ = state
        return (k < steps) & (jnp.abs(rhs[k]) > tolerance * norm)

    def extend(state):
        k, basis, triangle, rhs, rotations = state
        w = apply(precondition(basis[k]))
        h = basis @ w
        w = w - h @ basis
        again = basis @ w
        w, h = w - again @ basis, h + again
        height = jnp.linalg.norm(w)
        basis = basis.at[k + 1].set(w / jnp.where(height > 0, height, 1.0))

        def rotate(column, item):
            (c, s), i = item
            top, below = column[i], column[i + 1]
            turned = column.at[i].set(c * top + s * below).at[i + 1].set(c * below - s * top)
            return jnp.where(i < k, turned, column), None

        column, _ = lax.scan(rotate, h, (rotations, jnp.arange(steps)))
        radius = jnp.sqrt(column[k] ** 2 + height**2)
        radius = jnp.where(radius > 0, radius, 1.0)
        c, s = column[k] / radius, height / radius
        triangle = triangle.at[:, k].set(jnp.where(jnp.arange(steps) < k, column[:steps], 0.0)).at[k, k].set(radius)
        rhs = rhs.at[k + 1].set(-s * rhs[k]).at[k].set(c * rhs[k])
        return k + 1, basis, triangle, rhs, rotations.at[k].set(jnp.stack([c, s]))

    used, basis, triangle, rhs, _ = lax.while_loop(unfinished, extend, (0, basis, triangle, rhs, rotations))
    present = jnp.arange(steps) < used
    square = jnp.where(present[:, None] & present[None, :], triangle, jnp.eye(steps))
    weights = lax.linalg.triangular_solve(square, jnp.where(present, rhs[:-1], 0.0)[:, None], left_side=True)[:, 0]
    return precondition(weights @ basis[:-1]), jnp.abs(rhs[used]) / scale, used

"""Iterations: generalised conjugate residuals for linear equations, and the length of a
step of Newton's method.

The level of a point, seen from an iterate, is the norm of the correction that the
Jacobian of the iterate gives there: of the correction itself at the iterate, of the
simplified correction at the end of a trial. Unlike the residual it does not depend on
how the equations are scaled (Deuflhard, Newton Methods for Nonlinear Problems, Springer
2004, sec. 3.3, algorithm NLEQ-ERR). All arguments but lengths are norms.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array, Number

ROWS = 10  # directions against which a new one is made orthogonal at once
SHORTEST = 1e-3  # length below which there is no step


class _Krylov(NamedTuple):
    """Number of the step, x and its residual, and orthonormal images of the directions,
    with these, ``(rows, n)``.
    """

    step: Number
    x: Array
    residual: Array
    images: jax.Array
    directions: jax.Array


def gcr(
    apply: Callable[[Array], Array],
    precondition: Callable[[Array], Array],
    b: Array,
    *,
    tolerance: Number,
    steps: int,
) -> tuple[Array, Array, Number]:
    """Solve ``apply(x) = b`` over the Krylov space of ``apply(precondition(.))``, on
    real arrays ``(n,)``, until the residual norm has fallen to ``tolerance * |b|``, in
    at most ``steps`` (static): x, ``|b - apply(x)| / |b|``, and how many steps were
    taken.

    In exact arithmetic the iterates are those of GMRES with a right preconditioner
    (Eisenstat, Elman, Schultz, SIAM J. Numer. Anal. 20 (1983) 345); the preconditioner
    may change from step to step.

    >>> x, _, used = gcr(
    ...     lambda v: 2 * v, lambda v: v, jnp.array([2.0, 4.0]), tolerance=1e-9, steps=5
    ... )
    >>> x.tolist(), int(used)
    ([1.0, 2.0], 1)
    """
    norm = jnp.linalg.norm(b)
    capacity = jnp.zeros((-(-steps // ROWS) * ROWS, b.shape[0]))

    def orthogonalize(
        block: Array, state: tuple[Array, Array], images: Array, directions: Array
    ) -> tuple[Array, Array]:
        image, direction = state
        image_rows = lax.dynamic_slice_in_dim(images, block * ROWS, ROWS)
        direction_rows = lax.dynamic_slice_in_dim(directions, block * ROWS, ROWS)
        shares = image_rows @ image
        return image - shares @ image_rows, direction - shares @ direction_rows

    def unfinished(state: _Krylov) -> Array:
        return (state.step < steps) & (
            jnp.linalg.norm(state.residual) > tolerance * norm
        )

    def extend(state: _Krylov) -> _Krylov:
        count, x, residual, images, directions = state
        direction = precondition(residual)
        image = apply(direction)
        # Blocks in use: most solves leave most of the room empty
        blocks = (count + ROWS - 1) // ROWS
        # Twice: once leaves what rounding of large components makes, and directions
        # that are not orthogonal cost steps (Giraud and others, Numer. Math. 101 (2005)
        # 87).
        for _ in range(2):
            image, direction = lax.fori_loop(
                0,
                blocks,
                lambda block, state: orthogonalize(block, state, images, directions),
                (image, direction),
            )
        size = jnp.linalg.norm(image)
        scale = 1 / jnp.where(size > 0, size, 1.0)
        image = scale * image
        direction = scale * direction
        # Images are orthonormal, so that the residual falls by its component along the
        # last one alone.
        share = image @ residual
        return _Krylov(
            count + 1,
            x + share * direction,
            residual - share * image,
            images.at[count].set(image),
            directions.at[count].set(direction),
        )

    start = _Krylov(0, jnp.zeros_like(b), b, capacity, capacity)
    used, x, residual, _, _ = lax.while_loop(unfinished, extend, start)
    return x, jnp.linalg.norm(residual) / jnp.where(norm > 0, norm, 1.0), used


def gcr_on_host(
    apply: Callable[[np.ndarray], np.ndarray],
    b: np.ndarray,
    *,
    tolerance: float,
    steps: int,
) -> np.ndarray:
    """The x of :func:`gcr` without preconditioner, for ``apply`` that runs on the host.

    >>> gcr_on_host(
    ...     lambda v: 2 * v, np.array([2.0, 4.0]), tolerance=1e-9, steps=5
    ... ).tolist()
    [1.0, 2.0]
    """
    x = np.zeros_like(b)
    residual = b
    goal = tolerance * np.linalg.norm(b)
    count = 0
    # Room for all steps: arrays that grow would be copied in each.
    images, directions = np.empty((2, steps, len(b)))
    while count < steps and np.linalg.norm(residual) > goal:
        direction = residual
        image = apply(residual)
        for _ in range(2):  # twice: orthogonal to rounding
            shares = images[:count] @ image
            image = image - shares @ images[:count]
            direction = direction - shares @ directions[:count]
        length = np.linalg.norm(image)
        images[count] = image / length
        directions[count] = direction / length
        share = images[count] @ residual
        x = x + share * directions[count]
        residual = residual - share * images[count]
        count += 1
    return x


def lowers_level(simplified: Number, correction: Number, length: Number) -> Number:
    """Whether a trial leads closer: a linear model promises a level of (1 - length)
    times that of the iterate, and a quarter of the fall is required, so that steps
    which hardly gain anything are not taken.
    """
    return simplified < (1 - length / 4) * correction


def predicted_length(gain: Number, difference: Number, correction: Number) -> Array:
    """Length to try first at an iterate, from how much the Jacobian changed on the way
    there: ``gain`` of the step before, its length times its correction times its
    simplified correction; ``difference`` of the simplified correction and the
    correction, which only the change of the Jacobian makes different.
    """
    return jnp.clip(gain / (difference * correction + 1e-300), SHORTEST, 1.0)


def shorter_length(length: Number, correction: Number, curvature: Number) -> Array:
    """Length to try after a trial that failed: where the ``curvature`` met on it, of
    the simplified correction less (1 - length) times the correction, lets the level
    fall most; half the length where that is not finite.
    """
    # At least a tenth of the length: one trial far out may see too much curvature.
    lowest = correction * length**2 / (2 * curvature + 1e-300)
    return jnp.maximum(jnp.fmin(lowest, length / 2), length / 10)

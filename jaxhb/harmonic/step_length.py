"""Length of a step of Newton's method, as a share of the correction, from the natural level.

The level of a point, seen from an iterate, is the norm of the correction that the Jacobian of the iterate asks for
there: of the correction itself at the iterate, of the simplified correction at the end of a trial. Unlike the residual
it does not depend on how the equations are scaled (Deuflhard, Newton Methods for Nonlinear Problems, Springer 2004,
sec. 3.3, algorithm NLEQ-ERR). All arguments but lengths are norms.
"""

import jax.numpy as jnp

SHORTEST = 1e-3
"""Length below which there is no step."""


def lowers_level(simplified, correction, length):
    """Whether a trial leads closer: a linear model promises a level of (1 - length) times that of the iterate, and a
    quarter of the fall is wanted, so that steps which hardly gain anything are not taken."""
    return simplified < (1 - length / 4) * correction


def predicted_length(gain, difference, correction):
    """Length to try first at an iterate, from how much the Jacobian changed on the way there.

    gain : of the step before, its length times its correction times its simplified correction; difference : of that
    simplified correction and the correction, which only the change of the Jacobian makes different.
    """
    return jnp.clip(gain / (difference * correction + 1e-300), SHORTEST, 1.0)


def shorter_length(length, correction, curvature):
    """Length to try after a trial that failed: where the curvature met on it lets the level fall most.

    curvature : of the simplified correction less (1 - length) times the correction, zero for linear equations; where it
    is not finite the length is halved. At least a tenth of the length: one trial far out may see too much of it.
    """
    wanted = correction * length**2 / (2 * curvature + 1e-300)
    return jnp.maximum(jnp.fmin(wanted, length / 2), length / 10)

"""Curves with folds, corners and no end, followed by arclength."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxhb.solutions import continuation


def shortest(value, slope):
    """Shortest change for one equation in (x, p)."""
    return -value[0] * slope / (slope @ slope)


def follow(share, start, most=400):
    """Follow the curve on which p is the function ``share`` of x; the determinant with
    (-b, a) below is a^2 + b^2.
    """

    def evaluate(y):
        return jnp.array([share(y[0]) - y[1]])

    @jax.jit
    def linearize(y, normal):
        value = evaluate(y)
        (slope,) = jax.jacfwd(evaluate)(y)
        return value, shortest(value, slope), jnp.array([-slope[1], slope[0]]), slope

    @jax.jit
    def simplify(y, slope):
        return evaluate(y), shortest(evaluate(y), slope)

    return continuation.follow_curve(
        linearize, simplify, np.array([start, 0.0]), most=most
    )


def s_curve(x):
    return 0.5 + x**3 - x


def zigzag(x):
    """Rises to 0.8 at x = 0.8, falls to 0.3 at x = 1.3, rises again, with sharp
    corners.
    """
    return jnp.where(x < 0.8, x, jnp.where(x < 1.3, 1.6 - x, x - 1.0))


def late(x):
    """Comes back from 0.9 to -0.1 before it reaches 1."""
    return 0.4 + 0.5 * jnp.sin(3 * x) + jnp.maximum(x - 4, 0.0)


@pytest.mark.parametrize(
    ("share", "start", "folds"),
    [(s_curve, -1.2, {2}), (zigzag, 0.1, {2}), (late, 0.0, {2, 3, 4})],
)
def test_a_curve_is_followed_to_its_end_through_folds_and_corners(share, start, folds):
    curve = follow(share, start)
    assert curve.arrived
    assert curve.folds in folds
    np.testing.assert_allclose(
        [share(curve.y[0]), curve.y[1]], 1.0, atol=20 * continuation.STEP_CONTROL.closed
    )


def test_a_curve_that_never_arrives_costs_what_it_may_and_no_more():
    curve = follow(lambda x: 0.5 * jnp.sin(x), 0.1, most=90)
    assert not curve.arrived
    assert curve.jacobians == 90
    assert curve.folds > 3


def test_a_start_from_which_no_motion_is_found_ends_at_once():
    curve = follow(lambda x: jnp.sqrt(x), -1.0)
    assert not curve.arrived
    assert curve.steps == 0
    assert curve.jacobians == 1

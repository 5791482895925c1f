"""Damped Newton's method on equations whose answer is known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxhb.balance.newton import newton


def solve(evaluate, start, max_steps=24):
    def direction(x, residual, error, forcing):
        return jnp.linalg.solve(jax.jacfwd(evaluate)(x), residual)

    @jax.jit
    def run(start):
        return newton(
            evaluate,
            lambda x: x,
            direction,
            jnp.linalg.norm,
            start,
            tolerance=1e-12,
            max_steps=max_steps,
        )

    return run(jnp.asarray(start))


@pytest.mark.parametrize("scale", [10.0, 1e3, 1e6])
def test_steps_along_a_curved_valley_do_not_depend_on_how_the_equations_are_scaled(
    scale,
):
    """Rosenbrock's valley: the residual rises on the way, by as much as ``scale``
    wants, the natural level does not.
    """
    iterate = solve(
        lambda x: jnp.array([scale * (x[1] - x[0] ** 2), 1 - x[0]]), [-1.2, 1.0]
    )
    np.testing.assert_allclose(iterate.x, [1.0, 1.0], atol=1e-12)
    assert iterate.error <= 1e-12
    assert iterate.steps <= 12


def test_a_start_that_solves_the_equations_is_kept():
    iterate = solve(lambda x: x**2 - 1, [1.0, -1.0])
    np.testing.assert_array_equal(iterate.x, [1.0, -1.0])
    assert iterate.steps == 0


def test_equations_without_a_root_stall():
    iterate = solve(lambda x: x**2 + 1, [0.5], max_steps=100)
    assert iterate.stalled
    assert iterate.steps < 100
    assert np.isfinite(iterate.x).all()


def test_residuals_that_are_not_finite_shorten_the_step():
    """log(x) from 3: the whole step goes to a negative number."""
    iterate = solve(jnp.log, [3.0])
    np.testing.assert_allclose(iterate.x, 1.0, atol=1e-12)

"""Conjugate residuals against dense solves; lengths of Newton steps against levels
known in closed form.
"""

import numpy as np
import pytest

from jaxhb.equations import iterations


@pytest.mark.parametrize("h", [4.0, 2.5])
def test_a_shorter_length_is_where_a_quadratic_level_is_lowest(h):
    """Curvature h: a step of length s leaves (1 - s) of the correction and s^2 h / 2
    beside it, least at 1/h.
    """
    for length in (1.0, 2.2 / h):
        level = 3.0 * length**2 * h / 2
        shorter = iterations.shorter_length(length, 3.0, level)
        assert shorter == pytest.approx(max(1 / h, length / 10))
    assert iterations.lowers_level(3.0 * (1 - 1 / h + 1 / (2 * h)), 3.0, 1 / h)
    assert not iterations.lowers_level(3.0 * h / 2, 3.0, 1.0)


def test_lengths_have_bounds():
    assert iterations.shorter_length(0.8, 1.0, 0.0) == 0.4
    assert iterations.shorter_length(0.8, 1.0, np.nan) == 0.4
    assert iterations.shorter_length(0.8, 1.0, 1e9) == pytest.approx(0.08)
    # Where the Jacobian did not change the whole correction is tried.
    assert iterations.predicted_length(1.0, 0.0, 1.0) == 1.0
    assert iterations.predicted_length(np.inf, 2.0, 1.0) == 1.0
    assert iterations.predicted_length(0.1, 2.0, 0.5) == pytest.approx(0.1)
    assert iterations.predicted_length(1e-9, 2.0, 1.0) == iterations.SHORTEST


def test_conjugate_residuals_take_a_step_an_unknown_and_one_with_the_inverse():
    """Whichever matrix preconditions them, the identity or the inverse."""
    draw = np.random.default_rng(15)
    matrix = np.eye(12) + 0.3 * draw.normal(size=(12, 12))
    b = draw.normal(size=12)
    inverse = np.linalg.inv(matrix)
    for preconditioner, most in ((np.eye(12), 12), (inverse, 1)):
        x, residual, steps = iterations.gcr(
            lambda v: matrix @ v,
            lambda v, m=preconditioner: m @ v,
            b,
            tolerance=1e-12,
            steps=20,
        )
        np.testing.assert_allclose(x, inverse @ b, rtol=1e-10)
        assert steps <= most
        assert residual <= 1e-11
    x, residual, steps = iterations.gcr(
        lambda v: 2 * v, lambda v: v, 0 * b, tolerance=1e-12, steps=20
    )
    assert steps == 0
    assert residual == 0
    assert not np.asarray(x).any()

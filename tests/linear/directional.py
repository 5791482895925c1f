"""Derivatives along one random direction against differences, forwards and backwards."""

import jax
import numpy as np
from tolerances import GRADIENT, TANGENT


def check_derivative(value, at, *, step=1e-4, tolerance=GRADIENT, staged=True, seed=0):
    """The derivative of ``value`` of numbers ``at``, all changed by random shares, is that of differences.

    Relative to each derivative, or to a thousandth of the value where it is smaller. Not ``staged``: without jit.
    """
    at = np.asarray(at, float)
    random = np.random.default_rng(seed)
    direction = at * random.uniform(0.3, 1.0, len(at)) * random.choice([-1.0, 1.0], len(at))
    call = jax.jit if staged else lambda function: function
    changed = call(lambda share: value(at + share * direction))
    numbers, found = call(lambda x: jax.jvp(value, (x,), (direction,)))(at)
    near, back, far, farther = (np.asarray(changed(share)) for share in (step, -step, 2 * step, -2 * step))
    wanted = (8 * (near - back) - (far - farther)) / (12 * step)
    size = np.maximum(np.abs(wanted), 1e-3 * np.abs(numbers))
    assert np.all(np.abs(found - wanted) <= tolerance * size), np.max(np.abs(found - wanted) / size)
    weight = random.normal(size=np.shape(numbers)) / np.where(numbers == 0, 1.0, np.abs(numbers))
    backwards = call(lambda x: jax.vjp(value, x)[1](weight)[0])(at)
    terms = np.abs(weight * np.asarray(found)).sum()
    np.testing.assert_allclose(
        backwards @ direction, (weight * np.asarray(found)).sum(), rtol=0, atol=10 * TANGENT * terms
    )

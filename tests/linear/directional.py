"""Derivatives along one random direction against differences, forwards and backwards."""

import jax
import numpy as np
from tolerances import GRADIENT, TANGENT


def check_derivative(value, at, *, step=1e-4, staged=True, scale=None):
    """The derivative of ``value`` of numbers ``at``, all changed by random shares, is that of differences.

    Relative to each derivative, or to a thousandth of ``scale``, by default the value, where it is smaller. Not
    ``staged``: without jit.
    """
    at, random = np.asarray(at, float), np.random.default_rng(0)
    direction = at * random.uniform(0.3, 1.0, len(at)) * random.choice([-1.0, 1.0], len(at))
    call = jax.jit if staged else lambda function: function
    changed = call(lambda share: value(at + share * direction))
    numbers, found = map(np.asarray, call(lambda x: jax.jvp(value, (x,), (direction,)))(at))
    scale = np.abs(numbers) if scale is None else scale
    near, back, far, farther = (np.asarray(changed(share)) for share in (step, -step, 2 * step, -2 * step))
    wanted = (8 * (near - back) - (far - farther)) / (12 * step)
    size = np.maximum(np.abs(wanted), 1e-3 * scale)
    assert np.all(np.abs(found - wanted) <= GRADIENT * size), np.max(np.abs(found - wanted) / size)
    weight = random.normal(size=numbers.shape) / np.where(scale == 0, 1.0, scale)
    backwards, terms = call(lambda x: jax.vjp(value, x)[1](weight)[0])(at), weight * found
    np.testing.assert_allclose(backwards @ direction, terms.sum(), rtol=0, atol=10 * TANGENT * np.abs(terms).sum())

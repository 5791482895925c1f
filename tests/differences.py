"""Derivatives by differences, and plans solved tightly enough to take them."""

import jax
import jax.numpy as jnp
import numpy as np
from tolerances import GRADIENT, TANGENT

import jaxhb

TIGHT = {"residual_tolerance": 1e-13, "max_steps": 12, "averaged": False}
"""Of plans solved to rounding, as differences divide what is left of the residual by
the step, and differentiated at the time samples of their solve: differences are those
of the sampled equations.
"""

BOTH_SEPARATE = {
    "harmonics": 32,
    "active": (0, 1),
    "flank": (0, 0),
    "start": "march",
    "time_steps": 768,
}
BOTH_SEPARATE |= {"tolerance": 0.5, "excited": 3}
"""Of plans of ``branched_parts`` at 1500 rpm."""


def tight_plan(**given):
    """Such a plan, without the estimate of the truncation error, which has no
    derivative.
    """
    return jaxhb.Plan(**TIGHT | {"estimated": False} | given)


def differences(value, at, steps):
    """Central differences of fourth order of ``value`` (batched; numbers or arrays) in
    every direction, axis 0.
    """
    away = np.diag(steps)
    values = np.asarray(
        value(np.concatenate([at + away, at - away, at + 2 * away, at - 2 * away]))
    )
    near, back, far, farther = np.split(values, 4)
    return ((8 * (near - back) - (far - farther)).T / (12 * steps)).T


def compare(found, wanted, tolerance):
    """Relative to each derivative, or to a thousandth of the largest where one is
    small: rounding is common to all.
    """
    size = np.maximum(np.abs(wanted), 1e-3 * np.abs(wanted).max())
    assert np.max(np.abs(found - wanted) / size) < tolerance


def check_derivative(value, at, *, step=1e-4, staged=True, scale=None):
    """The derivative of ``value`` of numbers ``at``, all changed by random shares, is
    that of differences.

    Relative to each derivative, or to a thousandth of ``scale``, by default the value,
    where it is smaller. Not ``staged``: without jit.
    """
    at, random = np.asarray(at, float), np.random.default_rng(0)
    direction = (
        at * random.uniform(0.3, 1.0, len(at)) * random.choice([-1.0, 1.0], len(at))
    )

    def linearised(share):
        """Numbers, their change along the direction, and both ends of the way back: one
        program for all of them.
        """
        numbers, push = jax.linearize(value, at + share * direction)
        weight = random.normal(size=numbers.shape) / size_of(numbers)
        return (
            numbers,
            push(direction),
            weight,
            jax.linear_transpose(push, at)(weight)[0],
        )

    def size_of(numbers):
        return jnp.where(
            (size := jnp.abs(numbers) if scale is None else scale) == 0, 1.0, size
        )

    both = jax.jit(linearised) if staged else linearised
    numbers, found, weight, backwards = map(np.asarray, both(0.0))
    changed = (
        (lambda share: both(share)[0])
        if staged
        else lambda share: value(at + share * direction)
    )
    near, back, far, farther = (
        np.asarray(changed(share)) for share in (step, -step, 2 * step, -2 * step)
    )
    wanted = (8 * (near - back) - (far - farther)) / (12 * step)
    size = np.maximum(
        np.abs(wanted), 1e-3 * (np.abs(numbers) if scale is None else scale)
    )
    assert np.all(np.abs(found - wanted) <= GRADIENT * size), np.max(
        np.abs(found - wanted) / size
    )
    terms = weight * found
    np.testing.assert_allclose(
        backwards @ direction,
        terms.sum(),
        rtol=0,
        atol=10 * TANGENT * np.abs(terms).sum(),
    )

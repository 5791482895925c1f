"""Derivatives by differences, and plans solved tightly enough to take them."""

import jax
import jax.numpy as jnp
import numpy as np
from tolerances import GRADIENT, TANGENT

import jaxhb

TIGHT = {"residual_tolerance": 1e-13, "max_steps": 12, "averaged": False}
"""Options of plans solved to rounding, since differences divide the remaining residual
by the step. Derivatives are taken at the time samples of the solve, since differences
are those of the sampled equations.
"""


def tight_plan(**options):
    """A plan solved to rounding, without the estimate of the truncation error, which
    has no derivative.
    """
    return jaxhb.Plan(**TIGHT | {"estimated": False} | options)


def separating_plan(*, averaged=False, estimated=False):
    """Tight plan of ``branched_parts`` at 1500 rpm, both of whose meshes part."""
    return tight_plan(
        harmonics=32,
        active=(0, 1),
        flank=(0, 0),
        start="march",
        time_steps=768,
        tolerance=0.5,
        excited=3,
        averaged=averaged,
        estimated=estimated,
    )


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


def compare(derivatives, expected, tolerance):
    """Compares relative to each derivative, or to a thousandth of the largest where one
    is small: rounding is common to all.
    """
    size = np.maximum(np.abs(expected), 1e-3 * np.abs(expected).max())
    assert np.max(np.abs(derivatives - expected) / size) < tolerance


def check_derivative(value, at, *, step=1e-4, staged=True, scale=None):
    """Checks the derivative of ``value`` of numbers ``at``, all changed by random
    shares, against that of differences.

    The tolerance is relative to each derivative, or to a thousandth of ``scale``, by
    default the value, where it is smaller. Not ``staged``: without jit.
    """
    at = np.asarray(at, float)
    random = np.random.default_rng(0)
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
        size = jnp.abs(numbers) if scale is None else scale
        return jnp.where(size == 0, 1.0, size)

    linearise = jax.jit(linearised) if staged else linearised
    numbers, slopes, weight, backwards = map(np.asarray, linearise(0.0))

    def values_at(share):
        if staged:
            return np.asarray(linearise(share)[0])
        return np.asarray(value(at + share * direction))

    shares = (step, -step, 2 * step, -2 * step)
    near, back, far, farther = map(values_at, shares)
    expected = (8 * (near - back) - (far - farther)) / (12 * step)
    least = 1e-3 * (np.abs(numbers) if scale is None else scale)
    size = np.maximum(np.abs(expected), least)
    error = np.abs(slopes - expected)
    assert np.all(error <= GRADIENT * size), np.max(error / size)
    terms = weight * slopes
    np.testing.assert_allclose(
        backwards @ direction,
        terms.sum(),
        rtol=0,
        atol=10 * TANGENT * np.abs(terms).sum(),
    )

"""Derivatives by differences, and plans solved tightly enough to take them."""

import numpy as np

import jaxhb

TIGHT = {"residual_tolerance": 1e-13, "max_steps": 12, "slope_samples": 1}
"""Of plans solved to rounding, as differences divide what is left of the residual by the step, and differentiated at
the time samples of their solve: differences are those of the sampled equations."""


def tight_plan(**given):
    """Such a plan, without the estimate of the truncation error, which has no derivative."""
    return jaxhb.Plan(**TIGHT | {"estimated": False} | given)


def differences(value, at, steps):
    """Central differences of fourth order of ``value`` (batched; numbers or arrays) in every direction, axis 0."""
    away = np.diag(steps)
    values = np.asarray(value(np.concatenate([at + away, at - away, at + 2 * away, at - 2 * away])))
    near, back, far, farther = np.split(values, 4)
    return ((8 * (near - back) - (far - farther)).T / (12 * steps)).T


def compare(found, wanted, tolerance):
    """Relative to each derivative, or to a thousandth of the largest where one is small: rounding is common to all."""
    size = np.maximum(np.abs(wanted), 1e-3 * np.abs(wanted).max())
    assert np.max(np.abs(found - wanted) / size) < tolerance

"""Solutions and derivatives with exact integrals: against sampling at 16 N."""

import dataclasses
from functools import cache, partial

import jax
import numpy as np
import pytest
from differences import separating_plan
from trains import ONE_RADIAN_PER_SECOND, branched_parts, build, one_mass_parts

import jaxhb

pytestmark = pytest.mark.slow

KEYS = [
    "crank gear|idler.stiffness",
    "crank gear|idler.damping",
    "pump gear|idler.backlash",
    "pump gear|idler.damping",
    "ring.damping",
]
ONES = np.ones(len(KEYS))
SAMPLED = separating_plan(averaged=True)
EXACT = dataclasses.replace(SAMPLED, integrals="exact")


@cache
def train():
    return build(branched_parts(), reference="crank gear")


def value(factors, plan):
    """One number that both meshes enter, and how the solve went."""
    changed = train().replace(
        {key: train().value(key) * x for key, x in zip(KEYS, factors, strict=True)}
    )
    response = jaxhb.solve(changed, rpm=1500.0, plan=plan)
    tooth = response.force("crank gear", "idler").smooth_peak(8) / 700
    shaft = response.torque("pump gear", "pump").order(1.0) / 10
    return tooth + shaft, (response.status, response.deflections)


@partial(jax.jit, static_argnums=1)
def gradient(factors, plan):
    return jax.value_and_grad(value, has_aux=True)(factors, plan)


def test_the_gradient_of_sampled_integrals_is_that_of_exact_ones():
    """The second derivatives of exact integrals: test_derivative_paths.py."""
    exact = gradient(ONES, EXACT)
    sampled = gradient(ONES, SAMPLED)
    assert exact[0][1][0] == sampled[0][1][0] == jaxhb.Status.CONVERGED
    apart = np.abs(sampled[1] - exact[1]).max() / np.abs(exact[1]).max()
    # Order 2 in the samples, with a constant that depends on where the knots fall: 8e-4
    # at the 16 of the solve.
    assert apart < 3e-5


def test_where_the_teeth_stay_in_contact_exact_integrals_change_nothing():
    pressed = build(
        one_mass_parts(m=1.0, b=0.2, c=1.0, eps=0.05, h=0.1, q0=2.0, q1=0.1),
        reference="a",
    )
    rpm = 0.5 * ONE_RADIAN_PER_SECOND
    response = jaxhb.solve(pressed, rpm=rpm, integrals="exact")
    assert response.converged
    assert response.path[0].active_meshes == 0
    linear = jaxhb.linear_response(pressed, rpm=rpm, harmonics=response.harmonics)
    # To rounding.
    np.testing.assert_allclose(
        response.deflections[:, 1:], linear.deflections[:, 1:], rtol=0, atol=1e-14
    )

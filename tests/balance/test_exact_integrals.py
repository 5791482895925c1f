"""Solutions with exact integrals; their derivatives: test_derivatives.py."""

import numpy as np
import pytest
from trains import ONE_RADIAN_PER_SECOND, build, one_mass_parts

import jaxhb


@pytest.mark.slow
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

"""Averages of mesh forces between time samples, against integrals that are exact
between the knots of the law.
"""

import dataclasses

import jax
import numpy as np
import pytest

from jaxhb.equations import backlash, cell_forces, condensation, fourier

HARMONICS = 16


def equation(law, **changes):
    """Meshes with damping in contact, free of any train."""
    linear = np.zeros((2, HARMONICS + 1), complex)
    receptance = np.zeros((HARMONICS + 1, 2, 2), complex)
    equation = condensation.CondensedEquation(
        linear,
        receptance,
        np.array(1.0),
        law,
        np.array([0.05, 0.03]),
        np.array([True, False]),
    )
    return dataclasses.replace(equation, **changes)


@pytest.fixture(scope="module")
def motion():
    """Deflections that cross their gaps some ten times a cycle."""
    draw = np.random.default_rng(7)
    shape = (2, HARMONICS + 1)
    motion = draw.normal(size=shape) + 1j * draw.normal(size=shape)
    motion[:, 0] = motion[:, 0].real
    return motion / (1 + np.arange(HARMONICS + 1)) ** 0.8


LAW = backlash.Law(
    stiffness=np.array([3.0, 5.0]),
    epsilon=np.array([1e-3, 0.05]),
    transition=np.array([0.04, 0.2]),
    backlash=np.array([1.0, 0.7]),
)
ONE_SIDED = dataclasses.replace(
    LAW,
    linear=np.zeros(2),
    side=np.array([1.0, 0.0]),
    friction=np.array([0.4, 0.0]),
    slip=np.array([0.2, 1.0]),
)

force = jax.jit(cell_forces.force_coefficients, static_argnums=2)
slopes = jax.jit(cell_forces.slope_coefficients, static_argnums=(2, 3))


def error(actual, expected):
    return float(np.abs(actual - expected).max() / np.abs(expected).max())


@pytest.mark.slow
def test_forces_and_slopes_tend_to_the_exact_integrals_with_the_cells(motion):
    exact = equation(LAW, integrals="exact")
    expected = jax.jit(lambda: exact.nonlinear_force_coefficients(motion, 0))()
    expected_slopes = jax.jit(
        lambda: exact.nonlinear_slopes(motion, 0, 2 * HARMONICS)
    )()
    sampled = equation(LAW)
    errors = [error(force(sampled, motion, k * HARMONICS), expected) for k in (32, 128)]
    of_slopes = [
        error(slopes(sampled, motion, k * HARMONICS, 2 * HARMONICS), expected_slopes)
        for k in (32, 128)
    ]
    assert errors[-1] < 1e-4
    assert of_slopes[-1] < 2e-3
    for decay in (errors, of_slopes):
        assert np.log2(decay[0] / decay[-1]) / 2 > 1.5, decay


@pytest.mark.slow
def test_cells_beat_samples_eight_times_as_fine(motion):
    exact = equation(LAW, integrals="exact")
    sampled = equation(LAW)
    expected = jax.jit(lambda: exact.nonlinear_slopes(motion, 0, 2 * HARMONICS))()
    fine = jax.jit(
        lambda: sampled.nonlinear_slopes(motion, 256 * HARMONICS, 2 * HARMONICS)
    )()
    assert error(
        slopes(sampled, motion, 32 * HARMONICS, 2 * HARMONICS), expected
    ) < error(fine, expected)


def test_one_flank_and_dry_friction_are_those_of_many_samples(motion):
    sampled = equation(ONE_SIDED)
    many = 2**16
    expected = jax.jit(lambda: sampled.nonlinear_force_coefficients(motion, many))()
    expected_slopes = jax.jit(
        lambda: sampled.nonlinear_slopes(motion, many, 2 * HARMONICS)
    )()
    assert error(force(sampled, motion, 64 * HARMONICS), expected) < 1e-3
    assert (
        error(slopes(sampled, motion, 64 * HARMONICS, 2 * HARMONICS), expected_slopes)
        < 5e-3
    )


def test_what_varies_follows_the_stiffness_of_the_instant(motion):
    variation = np.zeros((2, 3), complex)
    variation[:, 2] = 0.2 - 0.1j
    law = dataclasses.replace(LAW, linear=LAW.stiffness)
    sampled = equation(law, variation=variation)
    expected = jax.jit(lambda: sampled.nonlinear_force_coefficients(motion, 2**16))()
    assert error(force(sampled, motion, 64 * HARMONICS), expected) < 1e-3


def test_a_motion_that_stays_on_its_flank_has_constant_forces():
    still = np.zeros((2, HARMONICS + 1), complex)
    still[:, 0] = 3.0
    still[:, 1] = 0.5
    forces = np.asarray(force(equation(LAW), still, 32 * HARMONICS))
    np.testing.assert_allclose(
        forces[:, 0].real, -np.asarray(backlash.offset(LAW)), rtol=1e-12
    )
    np.testing.assert_allclose(forces[:, 1:], 0.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        slopes(equation(LAW), still, 32 * HARMONICS, 4), 0.0, rtol=0, atol=1e-9
    )
    assert fourier.synthesize(still, 64).min() > LAW.knee.max()

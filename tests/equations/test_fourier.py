"""Layout of the coefficients, and the product with a periodic function."""

import jax.numpy as jnp
import numpy as np
import pytest
from tolerances import ALGEBRAIC

from jaxhb.equations import fourier

N = 7
SAMPLES = 64


@pytest.fixture(scope="module")
def signals():
    """Coefficients ``(3, N+1)`` of three real signals: the mean is real."""
    draw = np.random.default_rng(1)
    x = draw.normal(size=(3, N + 1)) + 1j * draw.normal(size=(3, N + 1))
    x[:, 0] = x[:, 0].real
    return x


def by_direct_sum(coefficients, samples):
    t = 2 * np.pi * np.arange(samples) / samples
    n = np.arange(1, coefficients.shape[-1])
    return (
        coefficients[..., :1].real
        + 2 * (coefficients[..., 1:] @ np.exp(1j * np.outer(n, t))).real
    )


def test_packing_and_unpacking_are_inverse(signals):
    packed = fourier.pack(signals)
    assert packed.shape == (3, 2 * N + 1)
    assert packed.dtype == np.float64
    np.testing.assert_allclose(fourier.unpack(packed), signals, rtol=ALGEBRAIC)
    again = fourier.pack(fourier.unpack(np.arange(5.0)))
    np.testing.assert_allclose(again, np.arange(5.0), rtol=ALGEBRAIC)


def test_packed_coordinates_are_those_of_an_orthonormal_basis(signals):
    t = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    n = np.arange(1, N + 1)
    waves = np.sqrt(2) * np.concatenate(
        [np.cos(np.outer(n, t)), np.sin(np.outer(n, t))]
    )
    basis = np.concatenate([np.ones((1, SAMPLES)), waves])
    np.testing.assert_allclose(
        basis @ basis.T / SAMPLES, np.eye(2 * N + 1), rtol=0, atol=ALGEBRAIC
    )
    values = np.asarray(fourier.pack(signals)) @ basis
    np.testing.assert_allclose(
        values, by_direct_sum(signals, SAMPLES), rtol=0, atol=1e-12
    )


@pytest.mark.parametrize("samples", [2 * N + 1, SAMPLES])
def test_synthesis_is_the_fourier_sum_and_analysis_undoes_it(signals, samples):
    values = fourier.synthesize(signals, samples)
    np.testing.assert_allclose(
        values, by_direct_sum(signals, samples), rtol=0, atol=ALGEBRAIC * 30
    )
    np.testing.assert_allclose(
        fourier.analyze(values, N), signals, rtol=0, atol=ALGEBRAIC * 10
    )


def test_derivative_is_that_of_the_fourier_sum(signals):
    frequency = 3.0
    step = 1e-5
    shift = np.exp(1j * frequency * step * np.arange(N + 1))
    ahead = by_direct_sum(signals * shift, SAMPLES)
    behind = by_direct_sum(signals / shift, SAMPLES)
    slopes = fourier.synthesize(fourier.derivative(signals, frequency), SAMPLES)
    np.testing.assert_allclose(
        slopes,
        (ahead - behind) / (2 * step),
        rtol=1e-6,
        atol=1e-6 * np.abs(slopes).max(),
    )


def test_resizing_keeps_the_harmonics_that_fit(signals):
    wide = fourier.resize(signals, N + 3)
    assert wide.shape == (3, N + 4)
    assert not np.asarray(wide[:, N + 1 :]).any()
    np.testing.assert_array_equal(fourier.resize(wide, N), signals)
    np.testing.assert_array_equal(fourier.resize(signals, 2), signals[:, :3])


def test_host_arrays_are_transformed_on_the_host_with_the_same_result(signals):
    functions = [
        lambda x: fourier.synthesize(x, SAMPLES),
        lambda x: fourier.sample(x, 4),
        fourier.pack,
        lambda x: fourier.analyze(x.real, 3),
        lambda x: fourier.derivative(x, 3.0),
        lambda x: fourier.resize(x, N + 2),
        lambda x: fourier.unpack(x.real),
    ]
    for function in functions:
        on_host = function(signals[:, :-1])
        on_device = function(jnp.asarray(signals[:, :-1]))
        assert type(on_host) is np.ndarray
        assert not isinstance(on_device, np.ndarray)
        np.testing.assert_allclose(on_host, on_device, rtol=0, atol=ALGEBRAIC * 30)


def test_packed_diagonal_multiplies_every_harmonic_by_its_gain(signals):
    draw = np.random.default_rng(2)
    gain = draw.normal(size=(3, N + 1)) + 1j * draw.normal(size=(3, N + 1))
    gain[:, 0] = gain[:, 0].real
    product = np.einsum(
        "sij,sj->si", fourier.packed_diagonal(gain), fourier.pack(signals)
    )
    np.testing.assert_allclose(
        product, fourier.pack(gain * signals), rtol=0, atol=ALGEBRAIC * 10
    )


def test_product_matrix_is_the_product_in_time_truncated_to_the_same_harmonics(signals):
    draw = np.random.default_rng(3)
    c = draw.normal(size=(3, 2 * N + 1)) + 1j * draw.normal(size=(3, 2 * N + 1))
    c[:, 0] = c[:, 0].real
    product = fourier.synthesize(c, SAMPLES) * fourier.synthesize(signals, SAMPLES)
    coefficients = np.einsum(
        "sij,sj->si", fourier.product_matrix(c), fourier.pack(signals)
    )
    np.testing.assert_allclose(
        coefficients,
        fourier.pack(fourier.analyze(product, N)),
        rtol=0,
        atol=ALGEBRAIC * 100,
    )


def test_values_at_any_times_take_what_harmonics_are_there_alone():
    """Three harmonics among 50,000 at 20,000 times: a product with all of them would
    hold 16 GB.
    """
    coefficients = np.zeros((1, 50_001), dtype=complex)
    coefficients[0, [0, 7, 50_000]] = 0.5, 1 - 2j, 0.25j
    share = np.random.default_rng(5).uniform(size=20_000)
    slow = (1 - 2j) * np.exp(14j * np.pi * share)
    fast = 0.25j * np.exp(100_000j * np.pi * share)
    expected = 0.5 + 2 * (slow + fast).real
    np.testing.assert_allclose(
        fourier.values_at(coefficients, share)[0], expected, rtol=0, atol=1e-9
    )

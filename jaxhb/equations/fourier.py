"""The layout of Fourier coefficients: synthesis, analysis, products with a periodic
function.

A real periodic signal of period ``2 pi / Omega`` is

    x(t) = sum_{n=-N}^{N} x^n exp(i n Omega t),      x^{-n} = conj(x^n).

Two forms are in use, and only this module knows them:

* *coefficients*: complex, shape ``(..., N+1)``, the entries ``x^0 .. x^N``;
* *packed*: real, shape ``(..., 2N+1)``, ``[x^0, sqrt(2) Re x^n .., -sqrt(2) Im x^n
  ..]``: the coordinates in the orthonormal basis ``1, sqrt(2) cos n Omega t, sqrt(2)
  sin n Omega t``, whose Euclidean norm is the root mean square of the signal. Unknowns
  of Newton's method are packed, as the backlash law is not holomorphic in the
  coefficients.

Nothing else in the package calls a fast Fourier transform. Numpy arrays are transformed
by numpy, on the host.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array, Number, namespace

AnyArray = TypeVar("AnyArray", Array, np.ndarray, Array)
"""Arrays of numpy, or of jax: each function gives the kind that it gets."""

SQRT2 = 2.0**0.5
# Time samples at which tooth forces are taken (docs/theory A6)
SAMPLES_PER_HARMONIC = 16


def pack(coefficients: AnyArray) -> AnyArray:
    """Complex coefficients ``(..., N+1)`` to real packed coordinates ``(..., 2N+1)``.

    >>> [round(float(value), 4) for value in pack(jnp.array([1.0, 0.5 - 0.5j]))]
    [1.0, 0.7071, 0.7071]
    """
    tail = coefficients[..., 1:]
    mean = coefficients[..., :1].real
    return namespace(tail).concatenate(
        [mean, SQRT2 * tail.real, -SQRT2 * tail.imag], axis=-1
    )


def unpack(packed: AnyArray) -> AnyArray:
    """Real packed coordinates ``(..., 2N+1)`` to complex coefficients ``(...,
    N+1)``.
    """
    harmonics = (packed.shape[-1] - 1) // 2
    cosine = packed[..., 1 : harmonics + 1]
    sine = packed[..., harmonics + 1 :]
    return namespace(packed).concatenate(
        [packed[..., :1] + 0j, (cosine - 1j * sine) / SQRT2], axis=-1
    )


def synthesize(coefficients: AnyArray, samples: int) -> AnyArray:
    """Values ``(..., samples)`` at equidistant time samples ``t_j = 2 pi j / (Omega
    samples)`` of complex coefficients ``(..., N+1)``; exact for ``samples >= 2N+1``,
    and harmonics above ``samples / 2`` must be absent.
    """
    return namespace(coefficients).fft.irfft(
        coefficients, n=samples, axis=-1, norm="forward"
    )


def values_at(coefficients: Array, share: np.ndarray) -> np.ndarray:
    """Values ``(..., K)`` of host coefficients ``(..., N+1)`` at shares ``(K,)`` of the
    cycle, in any order.

    Work and memory are K times the harmonics that are present: the stiffness of a mesh
    has a few among thousands.
    """
    harmonic = np.flatnonzero(
        np.any(coefficients != 0, axis=tuple(range(coefficients.ndim - 1)))
    )
    turned = coefficients[..., harmonic] * np.where(harmonic > 0, 2.0, 1.0)
    return (turned @ np.exp(2j * np.pi * harmonic[:, None] * share)).real


def sample(coefficients: AnyArray, count: int) -> AnyArray:
    """Values ``(..., count)`` at equidistant time samples as of :func:`synthesize`, for
    any ``count``.
    """
    # Fewer samples than 2 N + 1 would alias: every ``factor``-th of enough of them is
    # taken.
    factor = -(-(2 * coefficients.shape[-1] - 1) // count)
    return synthesize(coefficients, factor * count)[..., ::factor]


def analyze(values: AnyArray, harmonics: int) -> AnyArray:
    """Complex coefficients ``(..., harmonics+1)`` of sampled values ``(...,
    samples)``.
    """
    return namespace(values).fft.rfft(values, axis=-1, norm="forward")[
        ..., : harmonics + 1
    ]


def samples_for(harmonics: int) -> int:
    """Number of time samples that represents so many harmonics and is quick to
    transform.
    """
    from scipy.fft import next_fast_len  # a tenth of a second, which few commands need

    return next_fast_len(2 * harmonics + 2, real=True)


@dataclass(frozen=True)
class Equidistant:
    """The ``samples`` equidistant time samples of the cycle, at which a law is
    evaluated and analysed.
    """

    samples: int

    def synthesize(self, coefficients: AnyArray) -> AnyArray:
        """Values ``(..., samples)`` of coefficients ``(..., N+1)``."""
        return synthesize(coefficients, self.samples)

    def analyze(self, values: AnyArray, harmonics: int) -> AnyArray:
        """Coefficients ``(..., harmonics+1)`` of values ``(..., samples)``."""
        return analyze(values, harmonics)


def each(function: Callable[[Array], Array], *arrays: Array) -> Sequence[Array] | Array:
    """Apply a function to each of some arrays of one shape; in a program to all at
    once.
    """
    xp = namespace(arrays)
    if xp is np:
        return [function(array) for array in arrays]
    return jax.vmap(function)(jnp.stack(arrays))


def derivative(coefficients: AnyArray, frequency: Number) -> AnyArray:
    """Coefficients of dx/dt: ``i n Omega x^n``, with ``frequency`` = Omega in rad/s,
    ``()`` or ``(..., 1)``.
    """
    xp = namespace(coefficients, frequency)
    return 1j * frequency * xp.arange(coefficients.shape[-1]) * coefficients


def resize(coefficients: AnyArray, harmonics: int) -> AnyArray:
    """The same signal with another number of harmonics: truncated, or padded with
    zeros.
    """
    present = coefficients.shape[-1] - 1
    if harmonics <= present:
        return coefficients[..., : harmonics + 1]
    xp = namespace(coefficients)
    beyond = (*coefficients.shape[:-1], harmonics - present)
    return xp.concatenate([coefficients, xp.zeros(beyond, coefficients.dtype)], axis=-1)


def packed_diagonal(gain: Array) -> Array:
    """Real packed matrix ``(..., 2N+1, 2N+1)`` of the harmonic-wise product with
    complex ``gain`` ``(..., N+1)``.
    """
    harmonics = gain.shape[-1] - 1
    index = jnp.arange(1, harmonics + 1)
    matrix = (
        jnp.zeros((*gain.shape[:-1], 2 * harmonics + 1, 2 * harmonics + 1))
        .at[..., 0, 0]
        .set(gain[..., 0].real)
    )
    real = gain[..., 1:].real
    imag = gain[..., 1:].imag
    matrix = (
        matrix.at[..., index, index]
        .set(real)
        .at[..., index + harmonics, index + harmonics]
        .set(real)
    )
    return (
        matrix.at[..., index, index + harmonics]
        .set(imag)
        .at[..., index + harmonics, index]
        .set(-imag)
    )


def product_matrix(coefficients: Array) -> Array:
    """Packed matrix ``(..., 2N+1, 2N+1)`` of the product with a function c, of which
    the coefficients go to 2N harmonics ``(..., 2N+1)``.

    Truncated to N harmonics the product is Hermitian Toeplitz in complex coefficients,
    hence real and symmetric here: with ``c^k = alpha_k - i beta_k`` (alpha even, beta
    odd in k) cos-cos ``alpha_{n-k} + alpha_{n+k}``, sin-sin ``alpha_{n-k} -
    alpha_{n+k}``, cos-sin ``beta_{n+k} - beta_{n-k}``.
    """
    harmonics = (coefficients.shape[-1] - 1) // 2
    n = jnp.arange(1, harmonics + 1)
    plus = n[:, None] + n
    minus = n[:, None] - n
    alpha = coefficients.real
    beta = -coefficients.imag
    even_minus = alpha[..., jnp.abs(minus)]
    even_plus = alpha[..., plus]
    odd_minus = jnp.sign(minus) * beta[..., jnp.abs(minus)]
    odd_plus = beta[..., plus]
    first = SQRT2 * jnp.concatenate(
        [alpha[..., 1 : harmonics + 1], beta[..., 1 : harmonics + 1]], axis=-1
    )
    cosine_rows = jnp.concatenate(
        [even_minus + even_plus, odd_plus - odd_minus], axis=-1
    )
    sine_rows = jnp.concatenate([odd_plus + odd_minus, even_minus - even_plus], axis=-1)
    body = jnp.concatenate([cosine_rows, sine_rows], axis=-2)
    body = jnp.concatenate([first[..., :, None], body], axis=-1)
    top = jnp.concatenate([alpha[..., :1], first], axis=-1)
    return jnp.concatenate([top[..., None, :], body], axis=-2)

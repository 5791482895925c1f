"""Product with a periodic function, as a real matrix in packed coordinates.

The product ``c(t) x(t)``, truncated to N harmonics, is Hermitian Toeplitz in complex coefficients. In the packed
coordinates of :mod:`jaxhb.harmonic.fourier` it is a real symmetric matrix built from ``c^k``, ``k = 0 .. 2N``, with
``c^k = alpha_k - i beta_k`` (alpha even, beta odd in k): cos-cos ``alpha_{n-k} + alpha_{n+k}``, sin-sin
``alpha_{n-k} - alpha_{n+k}``, cos-sin ``beta_{n+k} - beta_{n-k}``.
"""

import jax.numpy as jnp

from . import fourier


def product_matrix(coefficients):
    """Packed matrix ``(..., 2N+1, 2N+1)`` of the product with a function given to 2N harmonics ``(..., 2N+1)``.

    Rows and columns are packed coordinates; the matrix is symmetric.
    """
    harmonics = (coefficients.shape[-1] - 1) // 2
    n = jnp.arange(1, harmonics + 1)
    plus = n[:, None] + n[None, :]
    minus = n[:, None] - n[None, :]
    alpha, beta = coefficients.real, -coefficients.imag
    even_minus, even_plus = alpha[..., jnp.abs(minus)], alpha[..., plus]
    odd_minus, odd_plus = jnp.sign(minus) * beta[..., jnp.abs(minus)], beta[..., plus]
    first = fourier.SQRT2 * jnp.concatenate([alpha[..., 1 : harmonics + 1], beta[..., 1 : harmonics + 1]], axis=-1)
    cosine_rows = jnp.concatenate([even_minus + even_plus, odd_plus - odd_minus], axis=-1)
    sine_rows = jnp.concatenate([odd_plus + odd_minus, even_minus - even_plus], axis=-1)
    body = jnp.concatenate([cosine_rows, sine_rows], axis=-2)
    body = jnp.concatenate([first[..., :, None], body], axis=-1)
    top = jnp.concatenate([alpha[..., :1], first], axis=-1)
    return jnp.concatenate([top[..., None, :], body], axis=-2)

"""Fourier-domain mathematics: arrays in, arrays out."""

from .. import _jax

_jax.load()

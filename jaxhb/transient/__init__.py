"""Time integration: the reference integration, and starts for the harmonic solution."""

from .. import _jax

_jax.load()

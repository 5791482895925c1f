"""Finding periodic solutions and estimating their errors."""

from .. import _jax

_jax.load()

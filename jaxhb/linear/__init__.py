"""The engineer's linear toolbox: modes, Holzer's table, characteristic polynomials, forced response."""

from .. import _jax

_jax.load()

"""What a solution is: the response, its signals, the contact of its teeth, its status."""

from .. import _jax

_jax.load()

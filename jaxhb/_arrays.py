"""Where arithmetic runs: numpy on the host, jax.numpy under a transformation."""

import jax
import jax.numpy as jnp
import numpy as np

from . import _x64  # noqa: F401


def namespace(*trees):
    """jax.numpy if any leaf is a tracer or a device array, else numpy: reading results compiles nothing."""
    return jnp if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(trees)) else np


def traced(*trees):
    """Whether any leaf is being traced."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(trees))


def staged():
    """Whether ``jit`` is at work: what programs return is then traced, whatever their arguments."""
    return traced(jax.lax.full((), 0.0))


def concrete(*trees):
    """The values, as numpy arrays where differentiation outside ``jit`` and ``vmap`` holds them; else still traced."""
    if not traced(trees):
        return trees
    values = jax.lax.stop_gradient(trees)
    return values if traced(values) else jax.tree.map(np.asarray, values)

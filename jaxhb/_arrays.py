"""Where arithmetic runs: numpy on the host, jax.numpy under a transformation. Scenes are read without jax."""

import sys
from functools import lru_cache, wraps
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    import jax

    Array = jax.Array | np.ndarray
    Number = float | Array
    Numbers = float | Sequence[float] | Array
else:
    Array = Number = Numbers = Any

_waiting = []


def pytree(cls):
    """Make a dataclass of arrays a pytree, at once or when jax is there."""
    _waiting.append(cls)
    if f"{__package__}._x64" in sys.modules:
        register_waiting()
    return cls


def register_waiting():
    """Register what :func:`pytree` was given before jax was there."""
    while _waiting:
        _jax().tree_util.register_dataclass(_waiting.pop())


def _jax():
    """jax in double precision if anything has imported it, else None: then no array is one of jax."""
    if "jax" not in sys.modules:
        return None
    from . import _x64

    return _x64.jax


def namespace(*trees):
    """jax.numpy if any leaf is a tracer or a device array, else numpy: reading results compiles nothing."""
    jax = _jax()
    return jax.numpy if jax and any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(trees)) else np


def traced(*trees):
    """Whether any leaf is being traced."""
    jax = _jax()
    return bool(jax) and any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(trees))


def staged():
    """Whether ``jit`` is at work: what programs return is then traced, whatever their arguments."""
    jax = _jax()
    # jit alone traces an operation none of whose arguments is traced: jax has no public question for it.
    return bool(jax) and traced(jax.lax.full((), 0.0))


def concrete(*trees):
    """The values, as numpy arrays where differentiation outside ``jit`` and ``vmap`` holds them; else still traced."""
    if not traced(trees):
        return trees
    jax = _jax()
    values = jax.lax.stop_gradient(trees)
    return values if traced(values) else jax.tree.map(np.asarray, values)


def on_host(tree):
    """The tree with numpy arrays for its leaves, except those that are traced."""
    jax = _jax()
    return jax.tree.map(lambda leaf: leaf if traced(leaf) else np.asarray(leaf), tree) if jax else tree


def kept(function):
    """Make ``function(tree, *static)`` remember what it gave for the numbers of the last trees of host arrays.

    The speeds of a sweep share the numbers of their train: what depends on these alone is computed once. Numbers count
    and not arrays, as a train may hold a view of an array that its user writes to.
    """

    @lru_cache(maxsize=8)
    def known(leaves, structure, *static):
        arrays = [np.frombuffer(numbers, kind).reshape(shape) for numbers, kind, shape in leaves]
        return function(_jax().tree.unflatten(structure, arrays), *static)

    @wraps(function)
    def called(tree, *static):
        if not _jax() or namespace(tree) is not np:  # a scene that is only checked is read once, without jax
            return function(tree, *static)
        leaves, structure = _jax().tree.flatten(tree)
        numbers = ((array.tobytes(), array.dtype.str, array.shape) for array in map(np.asarray, leaves))
        return known(tuple(numbers), structure, *static)

    return called

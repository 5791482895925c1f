"""Compiled programs: ``jax.jit``, with options of the compiler where the host calls, one at a time."""

import contextlib
import threading
import weakref
from functools import cache, cached_property, update_wrapper

import jax

from ._arrays import staged, traced

OPTIONS = {"xla_cpu_use_fusion_emitters": False}
"""Of the compiler for CPUs: kernels without its fusion dialects run as fast and compile in two thirds of the time."""


class _Turn:
    """Outermost programs run one after another, whatever the thread.

    A batched LAPACK call of jaxlib 0.10 waits on a thread of XLA's pool for others of that pool: two programs at once,
    of two threads or of one that does not wait, may hold all of them and never return.
    """

    def __init__(self):
        self.lock, self.results = threading.RLock(), []

    def run(self, program, args, kwargs):
        """The program's result, perhaps while it still runs; it begins when the one before has ended."""
        with self.lock:
            with contextlib.suppress(RuntimeError):  # whoever holds the result hears of its error
                jax.block_until_ready([result() for result in self.results])
            found = program(*args, **kwargs)
            self.results = [weakref.ref(leaf) for leaf in jax.tree.leaves(found) if isinstance(leaf, jax.Array)]
            return found


_turn = _Turn()


class Program:
    """``jax.jit`` of a function. Only an outermost program has options: called under a transformation it has none."""

    def __init__(self, function, **static):
        self.function, self.static = function, static
        self.nested = jax.jit(function, **static)
        update_wrapper(self, function)

    @cached_property
    def outermost(self):
        """The program that the host calls."""
        return jax.jit(self.function, compiler_options=_known_options(), **self.static)

    def __call__(self, *args, **kwargs):
        if traced(args, kwargs) or staged():
            return self.nested(*args, **kwargs)
        return _turn.run(self.outermost, args, kwargs)


@cache
def _known_options():
    """OPTIONS, or None where the compiler does not know them."""
    if jax.default_backend() != "cpu":
        return None
    try:
        jax.jit(lambda: 0, compiler_options=OPTIONS).lower().compile()
    except jax.errors.JaxRuntimeError:
        return None
    return OPTIONS

"""Compiled programs: ``jax.jit``, with options of the compiler where the host calls."""

from functools import cache, cached_property, update_wrapper

import jax

from ._arrays import traced

OPTIONS = {"xla_cpu_use_fusion_emitters": False}
"""Of the compiler for CPUs: kernels without its fusion dialects run as fast and compile in two thirds of the time."""


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
        program = self.nested if traced(args, kwargs) else self.outermost
        return program(*args, **kwargs)


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

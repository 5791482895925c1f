"""Compiled programs: ``jax.jit``, with options of the compiler where the host calls, and not too many of them."""

from functools import cache, cached_property, update_wrapper
from pathlib import Path

import jax

from ._arrays import staged, traced

OPTIONS = {
    # Kernels without its fusion dialects run as fast and compile in two thirds of the time (jaxlib 0.9).
    "xla_cpu_use_fusion_emitters": False,
    # Sums as trees of kernels: a fifth of the memory maps and a tenth of the compile time, and nothing won.
    "xla_disable_hlo_passes": "tree_reduction_rewriter",
}
"""Of the compiler for CPUs, each passed where it is known."""

COMPILED_BETWEEN_COUNTS = 20
"""Programs compiled, each of up to some hundred memory maps, after which the maps of the process are counted again."""


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
        _held.limit()
        return self.outermost(*args, **kwargs)


@cache
def _known_options():
    """Those of OPTIONS that the compiler knows; None for other devices."""
    if jax.default_backend() != "cpu":
        return None
    known = {}
    for name, value in OPTIONS.items():
        try:
            jax.jit(lambda: 0, compiler_options={name: value}).lower().compile()
        except jax.errors.JaxRuntimeError:
            continue
        known[name] = value
    return known


class Held:
    """Compiled programs of the process, all of them dropped before their memory maps reach the limit of Linux.

    Beyond that limit a process ends with a segmentation fault. Programs of others are dropped as well: JAX forgets all
    or none, and compiles again what is called again.
    """

    def __init__(self):
        self.programs = self.counted = 0
        jax.monitoring.register_event_duration_secs_listener(self.listen)

    def listen(self, event, _, **__):
        """Count the programs that are compiled, by whatever package."""
        self.programs += event == "/jax/core/compile/backend_compile_duration"

    def limit(self, most=None, between=COMPILED_BETWEEN_COUNTS):
        """Drop all programs if they take more than ``most`` memory maps, by default half of those that there are."""
        if self.programs - self.counted < between:
            return
        self.counted, maps = self.programs, Path("/proc/self/maps")
        if maps.exists() and maps.read_bytes().count(b"\n") > (_half_of_all() if most is None else most):
            jax.clear_caches()


@cache
def _half_of_all():
    return int(Path("/proc/sys/vm/max_map_count").read_text()) // 2


_held = Held()

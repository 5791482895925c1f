"""How programs of the tests compile, in this process and in those that tests start;
imported before jax is.

Most of the time of the tests is compilation. The compiler optimises less, which halves
it and makes programs slower, those too that the package compiles with options of its
own; it emits kernels without its fusion dialects (where it knows that option), which
halves it again; it leaves sums as they are, which saves a sixth of the rest in large
programs of the tests' own; it emits a program in one piece, which saves a tenth; and
operations do not tell where they come from. Processes started from this one (workers of
the tests, commands) hold on to memory that they free: giving it back takes a tenth of a
compilation. Each thread keeps at most a hundred pieces of a size apart: what is kept so
merges with nothing, and of ten thousand the heap is so torn that solves of long cycles
take gigabytes anew.

Threads of OpenBLAS wait actively for matrices that take less time than the waiting.
Tracing makes so many objects that collecting garbage as often as by default takes a
third of it; at a tenth of the threshold set here it still takes a tenth.
"""

import gc
import os
from concurrent.futures import Future
from importlib.metadata import version

flags = (
    "--xla_backend_optimization_level=0"
    " --xla_disable_hlo_passes=tree_reduction_rewriter"
)
flags += " --xla_cpu_parallel_codegen_split_count=1"
if version("jaxlib").startswith(
    "0.9."
):  # a flag that it does not know ends the process
    flags += " --xla_cpu_use_fusion_emitters=false"
os.environ.setdefault("XLA_FLAGS", flags)
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("JAX_TRACEBACK_IN_LOCATIONS_LIMIT", "0")
malloc = {
    "tcache_count": 100,
    "trim_threshold": 1 << 32,
    "top_pad": 1 << 26,
    "mmap_threshold": 1 << 25,
}
os.environ.setdefault(
    "GLIBC_TUNABLES",
    ":".join(f"glibc.malloc.{name}={value}" for name, value in malloc.items()),
)
os.environ["JAXHB_CACHE"] = "off"
gc.set_threshold(500_000)

from jaxhb import _jax, _program  # noqa: E402

_jax.load()
_program.OPTIONS["xla_backend_optimization_level"] = 0


def executables(program):
    """Number of executables that the process holds of a Program: one for each kind of
    arguments.
    """
    held = [
        executable
        for key, executable in _program._compiled.items()
        if key.program is program
    ]
    cancelled = [
        isinstance(executable, Future) and executable.cancelled() for executable in held
    ]
    return len(held) - sum(cancelled)

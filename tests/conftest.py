"""Makes the modules of ``tests`` (``tolerances``, ``reference_data``, ``dense``, ``trains``) importable by all tests.

The directory of a conftest.py is put on the path by pytest; the double precision of every test comes with the package.
Most of the time is compilation: programs are kept for all processes of the run, those that tests start too; the
compiler optimises less, which halves it and doubles the run times, and emits kernels without its fusion dialects (where
it knows that option), which halves it again. Threads of OpenBLAS wait actively for matrices that take less time than
the waiting. Tracing makes so many objects that collecting garbage as often as by default takes a third of it.
"""

import gc
import os
import tempfile
from importlib.metadata import version
from pathlib import Path

import pytest

kept = None
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    kept = tempfile.TemporaryDirectory(prefix="jaxhb-tests-")
    os.environ["JAX_COMPILATION_CACHE_DIR"] = kept.name
flags = "--xla_backend_optimization_level=0"
if version("jaxlib").startswith("0.9."):  # a flag that it does not know ends the process
    flags += " --xla_cpu_use_fusion_emitters=false"
os.environ.setdefault("XLA_FLAGS", flags)
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ["JAXHB_CACHE"] = "off"
gc.set_threshold(50_000)

import jax  # noqa: E402

import jaxhb._x64  # noqa: E402, F401

MOST_MAPS = 30_000
"""Memory maps of a process above which its programs are dropped: a solve takes 600 to 900, and Linux gives 65530."""


@pytest.fixture(scope="module", autouse=True)
def few_memory_maps():
    """Compiled programs beyond the limit of memory maps end the process with a segmentation fault."""
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and maps.read_text().count("\n") > MOST_MAPS:
        jax.clear_caches()

"""Makes the modules of ``tests`` (``tolerances``, ``reference_data``, ``dense``, ``trains``) importable by all tests.

The directory of a conftest.py is put on the path by pytest; the double precision of every test comes with the package.
Most of the time is compilation: programs are kept for all processes of the run, those that tests start too, and the
compiler optimises less, which halves it and doubles the run times.
"""

import os
import tempfile

kept = None
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    kept = tempfile.TemporaryDirectory(prefix="jaxhb-tests-")
    os.environ["JAX_COMPILATION_CACHE_DIR"] = kept.name
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")

import jaxhb._x64  # noqa: E402, F401

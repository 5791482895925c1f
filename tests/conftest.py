"""Makes the modules of ``tests`` (``tolerances``, ``reference_data``, ``dense``, ``trains``) importable by all tests.

The directory of a conftest.py is put on the path by pytest; the double precision of every test comes with the package.
Programs are kept for all processes of the run, those that tests start too: most of the time is compilation.
"""

import os
import tempfile

kept = tempfile.TemporaryDirectory(prefix="jaxhb-tests-") if "JAX_COMPILATION_CACHE_DIR" not in os.environ else None
if kept:
    os.environ["JAX_COMPILATION_CACHE_DIR"] = kept.name

import jaxhb._x64  # noqa: E402, F401

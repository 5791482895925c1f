"""Makes the modules of ``tests`` (``tolerances``, ``reference_data``, ``dense``, ``trains``) importable by all tests.

The directory of a conftest.py is put on the path by pytest; the double precision of every test comes with the package.
Most of the time is compilation: the compiler optimises less, which halves it and doubles the run times.
"""

import os

os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")

import jaxhb._x64  # noqa: E402, F401

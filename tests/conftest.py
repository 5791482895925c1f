"""Makes the modules of ``tests`` (``tolerances``, ``reference_data``, ``dense``, ``trains``) importable by all tests.

The directory of a conftest.py is put on the path by pytest; the double precision of every test comes with the package.
"""

import jaxhb._x64  # noqa: F401

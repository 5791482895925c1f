"""Time integration: the reference integration, and starts for the harmonic solution."""

from .. import _x64  # noqa: F401

"""The engineer's linear toolbox: modes, Holzer's table, characteristic polynomials, forced response."""

from .. import _x64  # noqa: F401

"""Finding periodic solutions and estimating their errors."""

from .. import _x64  # noqa: F401

"""Modal analysis and the response as the engineer reads it."""

from .. import _x64  # noqa: F401

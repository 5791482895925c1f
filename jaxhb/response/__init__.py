"""What a solution is: the response, its signals, the contact of its teeth, its status."""

from .. import _x64  # noqa: F401

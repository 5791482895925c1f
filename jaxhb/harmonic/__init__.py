"""Fourier-domain mathematics: arrays in, arrays out."""

from .. import _x64  # noqa: F401

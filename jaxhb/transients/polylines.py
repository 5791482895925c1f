"""Piecewise linear functions, several at once, with jumps."""

from __future__ import annotations

import numpy as np

from jaxhb._jax import Array, namespace


def polyline_at(x: Array, points: Array, values: Array, counts: np.ndarray) -> Array:
    """Values ``(..., m)`` of ``m`` functions at ``x`` ``(..., m)``, linear between
    their ``points`` and constant outside.

    ``points`` and ``values`` ``(m, K)``, of which the first ``counts`` ``(m,)`` are
    those of a function; points increase, or are equal at a jump, at which the value is
    that behind it. Differentiable by all but the counts.
    """
    xp = namespace(x, points, values)
    x = xp.asarray(x, dtype=float)[..., None]
    last = np.maximum(counts - 1, 0)
    counts_here = np.arange(points.shape[-1]) < counts[:, None]
    behind = ((x >= points) & counts_here).sum(axis=-1)
    left = xp.clip(behind - 1, 0, last)
    right = xp.clip(behind, 0, last)
    function = np.arange(len(counts))
    start = points[function, left]
    width = points[function, right] - start
    # Before the first and behind the last point there is no width, and no slope.
    share = (x[..., 0] - start) / xp.where(width > 0.0, width, 1.0)
    share = xp.where(width > 0.0, share, 0.0)
    value = values[function, left]
    return value + share * (values[function, right] - value)

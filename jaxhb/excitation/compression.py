"""The pressure in a cylinder without injection, told from a measured table of the cycle
with injection. NumPy or JAX.

Until it burns the charge obeys p (c + x)^n = constant, with the travel x of the piston
from top dead centre and the height c of the clearance. Of its change over the crank
angle, d(p (c + x)) = -(n - 1) p dx, the integral from the first angle of
:data:`BEFORE_IGNITION` on is

    c (p - p1) + (n - 1) integral p dx = p1 x1 - p x,

linear in c and n - 1: least squares over these angles find both, without the derivative
of a measured pressure. Closer to top dead centre the table may burn already, so that
the line goes on as this polytrope. What was compressed then expands along the same
line: a charge that does not burn gives its work back, but for heat and leakage, of
which a table with combustion tells nothing. So the mean torque of compression and
expansion is 0. Where the exhaust opens before bottom dead centre makes no difference
that counts: the piston hardly moves, and the pressure has nearly come down to that of
the exchange.

In the exhaust stroke of a four-stroke engine the table still blows down what burnt,
from several bar. A charge that did not burn has nothing to blow down: above the
pressure of :data:`LATE_EXHAUST` the table is cut. The rest of exhaust and inlet strokes
stays as the table has it. In two-stroke engines the mirrored compression holds the
scavenging pressure instead of the blowdown.
"""

from __future__ import annotations

import numpy as np

from jaxhb._jax import Array, namespace
from jaxhb.excitation.crank import slider_crank

BEFORE_IGNITION = -80.0, -30.0
"""deg from firing top dead centre: all valves and ports are closed, and nothing burns
yet.
"""
EXPONENT = 1.1, 1.6
"""Exponents of the compression of gases in engines, 1.25 to 1.40, with room for the
errors of measurements.
"""
CLEARANCE = 1.0 / 40.0, 1.0 / 3.0
"""Clearance over the stroke: compression ratios of 4 to 41."""
LATE_EXHAUST = 300.0, 330.0
"""deg from firing top dead centre of a four-stroke: the blowdown is over, and the inlet
is not open wide yet.
"""


def unburnt_table(
    pressure: Array, stroke: Array, rod: Array, *, revolutions: int
) -> Array:
    """The table without injection, as ``pressure`` [..., n, M] (Pa, absolute) at equal
    steps from firing TDC on.

    stroke and rod [n] in m; ``revolutions`` of the crank in a gas cycle, 2
    (four-stroke) or 1. A table whose compression is no polytrope of an engine is taken
    up to top dead centre as it is.
    """
    xp = namespace(pressure, stroke, rod)
    samples = pressure.shape[-1]
    half = samples // (2 * revolutions)
    angle = np.linspace(-180.0, 0.0, half + 1)
    compressed = xp.concatenate(
        [pressure[..., samples - half :], pressure[..., :1]], axis=-1
    )
    travel = slider_crank(np.deg2rad(angle), stroke[:, None], rod[:, None])[0]
    first, last = (round(half * (1.0 + limit / 180.0)) for limit in BEFORE_IGNITION)
    window = slice(first, last + 1)
    clearance, exponent = _polytrope(compressed[..., window], travel[:, window])
    sound = (exponent >= EXPONENT[0]) & (exponent <= EXPONENT[1])
    share = clearance / stroke
    sound &= (share >= CLEARANCE[0]) & (share <= CLEARANCE[1])
    # Numbers that stand in for those of no engine keep derivatives finite.
    clearance = xp.where(sound, clearance, stroke)[..., None]
    exponent = xp.where(sound, exponent, 1.0)[..., None]
    before = xp.where(sound[..., None], compressed, 1.0)[..., window]
    height = xp.log(clearance + travel)
    constant = (xp.log(before) + exponent * height[..., window]).mean(
        axis=-1, keepdims=True
    )
    line = xp.exp(constant - exponent * height)
    compressed = xp.where(
        sound[..., None] & (angle > BEFORE_IGNITION[1]), line, compressed
    )
    expanded = compressed[..., :0:-1]
    exchange = pressure[..., half : samples - half]
    if revolutions == 2:
        exchange = _without_blowdown(exchange)
    return xp.concatenate([expanded, exchange, compressed[..., :-1]], axis=-1)


def _without_blowdown(exchange: Array) -> Array:
    """Cut exhaust and inlet stroke [..., K], 180 to 540 deg, so that they begin with
    the pressure of :data:`LATE_EXHAUST`.
    """
    xp = namespace(exchange)
    samples = exchange.shape[-1]
    first, last = (round(samples * (limit - 180.0) / 360.0) for limit in LATE_EXHAUST)
    blown_down = exchange[..., first:last].mean(axis=-1, keepdims=True)
    return xp.concatenate(
        [xp.minimum(exchange[..., :first], blown_down), exchange[..., first:]], axis=-1
    )


def _polytrope(pressure: Array, travel: Array) -> tuple[Array, Array]:
    """Clearance (m) and exponent [..., n] of a compression, samples [..., n, K]; nan or
    absurd where there is none.
    """
    xp = namespace(pressure, travel)
    mean = 0.5 * (pressure[..., 1:] + pressure[..., :-1])
    work = xp.cumsum(mean * (travel[..., 1:] - travel[..., :-1]), axis=-1)
    # In shares of the last pressure and the first travel, squares of numbers near 1 are
    # summed.
    size = xp.where(pressure[..., -1:] > 0.0, pressure[..., -1:], 1.0)
    rise = (pressure[..., 1:] - pressure[..., :1]) / size
    work = work / (size * travel[..., :1])
    product = (pressure * travel)[..., :1] - (pressure * travel)[..., 1:]
    product = product / (size * travel[..., :1])
    rise2 = (rise * rise).sum(axis=-1)
    work2 = (work * work).sum(axis=-1)
    both = (rise * work).sum(axis=-1)
    determinant = rise2 * work2 - both**2
    solvable = determinant > 1e-12 * rise2 * work2
    determinant = xp.where(solvable, determinant, 1.0)
    of_rise = (rise * product).sum(axis=-1)
    of_work = (work * product).sum(axis=-1)
    clearance = (work2 * of_rise - both * of_work) / determinant * travel[..., 0]
    exponent = 1.0 + (rise2 * of_work - both * of_rise) / determinant
    return xp.where(solvable, clearance, 0.0), exponent

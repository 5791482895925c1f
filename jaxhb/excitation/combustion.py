"""The pressure in a cylinder without a measured trace: a single-zone cycle with Wiebe's heat release, in NumPy or JAX.

Inlet and exhaust open and close at the dead centres, where the piston stands still. From bottom to bottom dead centre
the gas in the volume V obeys

    dp/da = -n p V'/V + (n - 1)/V dQ/da,    Q = heat x b(a),    b = 1 - exp(-6.908 ((a - start)/duration)^(shape + 1)),

with the burnt share b (0 before ``start``, 99.9 % after ``duration``) and an exponent n that goes with it from that of
the compression to that of the expansion: before the start p V^n is constant, heat to the walls included. Four-stroke
engines then push the gas out at the exhaust pressure and take it in at the charge pressure; in two-stroke engines the
charge pressure is there at once. Numbers of charge change that matter (valve timing, scavenging) go into the
compression ratio, which is the effective one.

The equation is linear in p and Q: the pressure is that without heat, plus the heat times one function of the angle.

Sources: I. Wiebe, *Brennverlauf und Kreisprozess von Verbrennungsmotoren*, 1970; J. B. Heywood, *Internal Combustion
Engine Fundamentals*, sections 9.2 and 9.6.

Examples
--------
>>> import numpy as np
>>> motored, per_joule = pressures(
...     np.array([0.1]), np.array([0.12]), np.array([0.2]), compression_ratio=np.array([16.0]),
...     charge_pressure=np.array([1e5]), exhaust_pressure=np.array([1e5]), start=np.array([-5.0]),
...     duration=np.array([60.0]), shape=np.array([1.0]), compression_exponent=np.array([1.35]),
...     expansion_exponent=np.array([1.28]), revolutions=2, samples=7200,
... )
>>> round(float(motored[0, 0] / 1e5), 1), round(float((motored + 2000 * per_joule).max() / 1e5))
(42.2, 69)
"""

from __future__ import annotations

import numpy as np

from jaxhb._jax import namespace
from jaxhb.excitation.crank import slider_crank

BURNT_AT_END = 0.999
"""Share of the fuel that is burnt at the end of the duration: Wiebe's function never reaches 1."""


def burnt_share(angle, start, duration, shape):
    """Wiebe's share of the heat released up to an angle (deg); arguments broadcast."""
    xp = namespace(angle, start, duration, shape)
    begun = angle > start
    # 1 before the start: powers of negative numbers are nan, and derivatives would spread it.
    passed = xp.where(begun, (angle - start) / duration, 1.0)
    # expm1 keeps the digits of what has hardly begun to burn.
    return xp.where(begun, -xp.expm1(np.log(1.0 - BURNT_AT_END) * passed ** (shape + 1.0)), 0.0)


def pressures(
    bore,
    stroke,
    rod,
    *,
    compression_ratio,
    charge_pressure,
    exhaust_pressure,
    start,
    duration,
    shape,
    compression_exponent,
    expansion_exponent,
    revolutions,
    samples,
):
    """Pressure without heat, and that which one joule adds, at equal steps of the gas cycle from firing TDC on.

    Parameters
    ----------
    bore, stroke, rod : array [n]
        m.
    compression_ratio, shape, compression_exponent, expansion_exponent : array [n]
    charge_pressure, exhaust_pressure : array [n]
        Pa, absolute.
    start, duration : array [n]
        deg.
    revolutions : int
        Of the crank in a gas cycle: 2 (four-stroke) or 1.
    samples : int
        A multiple of 4.

    Returns
    -------
    motored, per_joule : array [n, samples]
        Pa and Pa/J.
    """
    given = bore, stroke, rod, compression_ratio, charge_pressure, exhaust_pressure, start, duration, shape
    given = *given, compression_exponent, expansion_exponent
    xp = namespace(given)
    bore, stroke, rod, ratio, charge, exhaust, start, duration, shape, before, after = (v[:, None] for v in given)
    closed = samples // revolutions
    angle = np.linspace(-180.0, 180.0, closed + 1)
    swept = np.pi / 4.0 * bore**2
    # Of the compression ratio r: the clearance is the swept volume over r - 1.
    volume = swept * (stroke / (ratio - 1.0) + slider_crank(np.deg2rad(angle), stroke, rod)[0])
    burnt = burnt_share(angle, start, duration, shape)
    exponent = before + (after - before) * burnt
    # The equation is linear in p, and exp(growth) its integrating factor.
    growth = _integral(exponent, xp.log(volume))
    motored = charge * xp.exp(-growth)
    per_joule = xp.exp(-growth) * _integral((exponent - 1.0) / volume * xp.exp(growth), burnt)
    # Computed from bottom dead centre, returned from firing top dead centre on.
    half = closed // 2
    if revolutions == 1:
        return tuple(xp.concatenate([p[:, half:closed], p[:, :half]], axis=1) for p in (motored, per_joule))
    open_pressure = xp.repeat(xp.concatenate([exhaust, charge], axis=1), half, axis=1)
    found = []
    for p, gas_exchange in ((motored, open_pressure), (per_joule, xp.zeros_like(open_pressure))):
        found.append(xp.concatenate([p[:, half:closed], gas_exchange, p[:, :half]], axis=1))
    return tuple(found)


def _integral(values, over):
    """Integral of ``values`` d``over`` from the first sample on, by the trapezoidal rule, zero at the first."""
    xp = namespace(values, over)
    steps = 0.5 * (values[:, 1:] + values[:, :-1]) * (over[:, 1:] - over[:, :-1])
    return xp.concatenate([xp.zeros_like(values[:, :1]), xp.cumsum(steps, axis=1)], axis=1)

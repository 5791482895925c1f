"""The pressure in a cylinder without a measured trace: a single-zone cycle with Wiebe's
heat release, in NumPy or JAX.

Inlet and exhaust open and close at the dead centres, where the piston stands still.
From bottom to bottom dead centre the gas in the volume V obeys

    dp/da = -n p V'/V + (n - 1)/V dQ/da,    Q = heat x b(a),
    b = 1 - exp(-6.908 ((a - start)/duration)^(shape + 1)),

with the burnt share b (0 before ``start``, 99.9 % after ``duration``) and an exponent n
that goes with it from that of the compression to that of the expansion: before the
start p V^n is constant, heat to the walls included. Four-stroke engines then push the
gas out at the exhaust pressure and take it in at the charge pressure; in two-stroke
engines the charge pressure is there at once. Numbers of charge change that matter
(valve timing, scavenging) go into the compression ratio, which is the effective one.

The equation is linear in p and Q: the pressure is the charge pressure, the exhaust
pressure and the heat, each times one function of the angle. Without injection nothing
burns, and the exponent stays that of the compression: what was compressed expands along
the same line (:func:`unburnt`).

Sources: I. Wiebe, *Brennverlauf und Kreisprozess von Verbrennungsmotoren*, 1970; J. B.
Heywood, *Internal Combustion Engine Fundamentals*, sections 9.2 and 9.6.
"""

import numpy as np

from jaxhb._jax import namespace
from jaxhb.excitation.crank import slider_crank

# Share of the fuel that is burnt at the end of the duration: Wiebe's function never
# reaches 1
BURNT_AT_END = 0.999
NUMBERS = (
    "compression_ratio",
    "start",
    "duration",
    "shape",
    "compression_exponent",
    "expansion_exponent",
)


def burnt_share(angle, start, duration, shape):
    """Wiebe's share of the heat released up to an angle (deg); arguments broadcast."""
    xp = namespace(angle, start, duration, shape)
    begun = angle > start
    # 1 before the start: powers of negative numbers are nan, and derivatives would
    # spread it.
    passed = xp.where(begun, (angle - start) / duration, 1.0)
    # expm1 keeps the digits of what has hardly begun to burn.
    return xp.where(
        begun, -xp.expm1(np.log(1.0 - BURNT_AT_END) * passed ** (shape + 1.0)), 0.0
    )


def pressures(bore, stroke, rod, numbers, *, revolutions, samples):
    """Pressures (Pa) that 1 Pa of charge, 1 Pa in the exhaust and 1 J of heat make, [n,
    samples] each, from firing TDC on; that of a cycle is their sum, times these three.

    Arrays [n]: bore, stroke and rod in m, and by their names the :data:`NUMBERS` of a
    :class:`~jaxhb.elements.elements.Combustion`. ``revolutions`` of the crank in a gas
    cycle, 2 (four-stroke) or 1, of ``samples`` equal steps, a multiple of 4.
    """
    given = bore, stroke, rod, *(numbers[name] for name in NUMBERS)
    xp = namespace(given)
    bore, stroke, rod, ratio, start, duration, shape, before, after = (
        v[:, None] for v in given
    )
    closed = samples // revolutions
    angle = np.linspace(-180.0, 180.0, closed + 1)
    volume = np.pi / 4.0 * bore**2 * _height(angle, stroke, rod, ratio)
    burnt = burnt_share(angle, start, duration, shape)
    exponent = before + (after - before) * burnt
    # The equation is linear in p, and exp(growth) its integrating factor.
    growth = _integral(exponent, xp.log(volume))
    per_joule = xp.exp(-growth) * _integral(
        (exponent - 1.0) / volume * xp.exp(growth), burnt
    )
    of_charge, of_exhaust = _with_exchange(xp.exp(-growth), samples)
    none = xp.zeros((len(bore), samples - closed))
    return of_charge, of_exhaust, xp.concatenate(_around(per_joule, none), axis=1)


def unburnt(stroke, rod, numbers, *, revolutions, samples):
    """The same of a cycle without injection: pressures that 1 Pa of charge and 1 Pa in
    the exhaust make.
    """
    xp = namespace(stroke, rod, numbers)
    stroke = stroke[:, None]
    rod = rod[:, None]
    ratio, exponent = (
        numbers[name][:, None] for name in ("compression_ratio", "compression_exponent")
    )
    height = _height(
        np.linspace(-180.0, 180.0, samples // revolutions + 1), stroke, rod, ratio
    )
    return _with_exchange(xp.exp(-exponent * xp.log(height / height[:, :1])), samples)


def _height(angle, stroke, rod, ratio):
    """Height (m) of the gas above the piston; of the compression ratio r the clearance
    is the stroke over r - 1.
    """
    return stroke / (ratio - 1.0) + slider_crank(np.deg2rad(angle), stroke, rod)[0]


def _with_exchange(closed, samples):
    """What 1 Pa of charge and 1 Pa in the exhaust make of a cycle whose closed part,
    from bottom to bottom dead centre, begins with 1 Pa of charge.
    """
    xp = namespace(closed)
    exchange = samples - closed.shape[1] + 1
    none, ones = (xp.full((len(closed), exchange // 2), value) for value in (0.0, 1.0))
    of_charge = xp.concatenate(
        _around(closed, xp.concatenate([none, ones], axis=1)), axis=1
    )
    of_exhaust = xp.concatenate(
        _around(xp.zeros_like(closed), xp.concatenate([ones, none], axis=1)), axis=1
    )
    return of_charge, of_exhaust


def _around(closed, exchange):
    """Parts of a cycle from firing top dead centre on: expansion, gas exchange,
    compression.
    """
    half = closed.shape[1] // 2
    return closed[:, half:-1], exchange, closed[:, :half]


def _integral(values, over):
    """Integral of ``values`` d``over`` from the first sample on, by the trapezoidal
    rule, zero at the first.
    """
    xp = namespace(values, over)
    steps = 0.5 * (values[:, 1:] + values[:, :-1]) * (over[:, 1:] - over[:, :-1])
    return xp.concatenate(
        [xp.zeros_like(values[:, :1]), xp.cumsum(steps, axis=1)], axis=1
    )

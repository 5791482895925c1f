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

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from jaxhb._jax import Array, Number, namespace
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


def burnt_share(angle: Number, start: Number, duration: Number, shape: Number) -> Array:
    """Share of the heat released up to an angle (deg) by Wiebe's function; arguments
    broadcast.
    """
    xp = namespace(angle, start, duration, shape)
    begun = angle > start
    # 1 before the start: powers of negative numbers are nan, and derivatives would
    # spread it.
    passed = xp.where(begun, (angle - start) / duration, 1.0)
    # expm1 keeps the digits of what has hardly begun to burn.
    return xp.where(
        begun, -xp.expm1(np.log(1.0 - BURNT_AT_END) * passed ** (shape + 1.0)), 0.0
    )


def pressures(
    bore: Array,
    stroke: Array,
    rod: Array,
    numbers: Mapping[str, Array],
    *,
    revolutions: int,
    samples: int,
) -> tuple[Array, Array, Array]:
    """Pressures (Pa) that 1 Pa of charge, 1 Pa in the exhaust and 1 J of heat make, [n,
    samples] each, from firing TDC on; the pressure of a cycle is their sum, times these
    three.

    Arrays [n]: bore, stroke and rod in m, and by their names the :data:`NUMBERS` of a
    :class:`~jaxhb.Combustion`. ``revolutions`` of the crank in a gas
    cycle, 2 (four-stroke) or 1, of ``samples`` equal steps, a multiple of 4.
    """
    columns = (bore, stroke, rod, *(numbers[name] for name in NUMBERS))
    xp = namespace(columns)
    bore, stroke, rod, ratio, start, duration, shape, before, after = (
        column[:, None] for column in columns
    )
    closed = samples // revolutions
    angle = np.linspace(-180.0, 180.0, closed + 1)
    volume = np.pi / 4.0 * bore**2 * _height(angle, stroke, rod, ratio)
    burnt = burnt_share(angle, start, duration, shape)
    exponent = before + (after - before) * burnt
    # The equation is linear in p, and exp(growth) its integrating factor.
    growth = _integral(exponent, xp.log(volume))
    released = _integral((exponent - 1.0) / volume * xp.exp(growth), burnt)
    per_joule = xp.exp(-growth) * released
    of_charge, of_exhaust = _with_exchange(xp.exp(-growth), samples)
    no_heat = xp.zeros((len(bore), samples - closed))
    return of_charge, of_exhaust, xp.concatenate(_around(per_joule, no_heat), axis=1)


def unburnt(
    stroke: Array,
    rod: Array,
    numbers: Mapping[str, Array],
    *,
    revolutions: int,
    samples: int,
) -> tuple[Array, Array]:
    """Pressures (Pa) that 1 Pa of charge and 1 Pa in the exhaust make in a cycle
    without injection, [n, samples] each; arguments as of :func:`pressures`.
    """
    xp = namespace(stroke, rod, numbers)
    stroke = stroke[:, None]
    rod = rod[:, None]
    ratio = numbers["compression_ratio"][:, None]
    exponent = numbers["compression_exponent"][:, None]
    angle = np.linspace(-180.0, 180.0, samples // revolutions + 1)
    height = _height(angle, stroke, rod, ratio)
    closed = xp.exp(-exponent * xp.log(height / height[:, :1]))
    return _with_exchange(closed, samples)


def _height(angle: np.ndarray, stroke: Array, rod: Array, ratio: Array) -> Array:
    """Height (m) of the gas above the piston; with the compression ratio r the
    clearance is the stroke over r - 1.
    """
    return stroke / (ratio - 1.0) + slider_crank(np.deg2rad(angle), stroke, rod)[0]


def _with_exchange(closed: Array, samples: int) -> tuple[Array, Array]:
    """Pressures that 1 Pa of charge and 1 Pa in the exhaust make in a cycle whose
    closed part, from bottom to bottom dead centre, begins with 1 Pa of charge.
    """
    xp = namespace(closed)
    exchange = samples - closed.shape[1] + 1
    zeros = xp.full((len(closed), exchange // 2), 0.0)
    ones = xp.full((len(closed), exchange // 2), 1.0)
    inlet = xp.concatenate([zeros, ones], axis=1)
    exhaust = xp.concatenate([ones, zeros], axis=1)
    of_charge = xp.concatenate(_around(closed, inlet), axis=1)
    of_exhaust = xp.concatenate(_around(xp.zeros_like(closed), exhaust), axis=1)
    return of_charge, of_exhaust


def _around(closed: Array, exchange: Array) -> tuple[Array, Array, Array]:
    """Parts of a cycle from firing top dead centre on: expansion, gas exchange,
    compression.
    """
    half = closed.shape[1] // 2
    return closed[:, half:-1], exchange, closed[:, :half]


def _integral(values: Array, over: Array) -> Array:
    """Integral of ``values`` d``over`` from the first sample on, by the trapezoidal
    rule, zero at the first.
    """
    xp = namespace(values, over)
    steps = 0.5 * (values[:, 1:] + values[:, :-1]) * (over[:, 1:] - over[:, :-1])
    zeros = xp.zeros_like(values[:, :1])
    return xp.concatenate([zeros, xp.cumsum(steps, axis=1)], axis=1)

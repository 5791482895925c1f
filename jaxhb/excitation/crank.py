"""The crank-slider: its kinematics, gas torque (NumPy or JAX) and inertia torque
(JAX).
"""

from __future__ import annotations

import numpy as np

from jaxhb._jax import Array, Number, namespace

CRANK_SAMPLES = 512
"""Angles of a revolution at which inertia torques are taken: their series falls by
stroke/(2 rod) per order.
"""


def slider_crank(
    angle: Number, stroke: Number, rod: Number
) -> tuple[Array, Array, Array]:
    """Travel x (m) of the piston from top dead centre and its derivatives x' and x'' by
    the crank angle (rad), exact.

    With r = stroke/2, lambda = r/rod < 1 and q = sqrt(1 - lambda^2 sin^2 a): x = r (1 -
    cos a) + rod (1 - q), x' = r (sin a + lambda sin a cos a / q), x'' = r (cos a +
    lambda cos 2a / q + lambda^3 sin^2 a cos^2 a / q^3). Den Hartog, *Mechanical
    Vibrations*, section 5.3.
    """
    xp = namespace(angle, stroke, rod)
    r = 0.5 * stroke
    ratio = r / rod
    s = xp.sin(angle)
    c = xp.cos(angle)
    q = xp.sqrt(1.0 - (ratio * s) ** 2)
    # 1 - q = (lambda sin a)^2 / (1 + q), without a difference of nearly equal numbers.
    x = r * (1.0 - c) + rod * (ratio * s) ** 2 / (1.0 + q)
    x1 = r * (s + ratio * s * c / q)
    x2 = r * (c + ratio * (c * c - s * s) / q + ratio**3 * (s * c) ** 2 / q**3)
    return x, x1, x2


def gas_torque(
    pressure: Array, bore: Number, stroke: Number, rod: Number, *, revolutions: Number
) -> Array:
    """Gas torque p A x'(a) in N m [..., M] at equal steps of the gas cycle from firing
    top dead centre on, in NumPy or JAX.

    ``pressure`` [..., M] in Pa at these steps; bore, stroke and rod [...] in m;
    ``revolutions`` [...] of the crank in a gas cycle, 2 (four-stroke) or 1.
    """
    xp = namespace(pressure, bore, stroke, rod)
    pressure = xp.asarray(pressure, dtype=float)
    bore, stroke, rod, revolutions = (
        xp.asarray(values, dtype=float)[..., None]
        for values in (bore, stroke, rod, revolutions)
    )
    samples = pressure.shape[-1]
    angle = 2.0 * np.pi * revolutions * (xp.arange(samples) / samples)
    _, x1, _ = slider_crank(angle, stroke, rod)
    return pressure * (np.pi / 4.0) * bore**2 * x1


def inertia_torque(
    stroke: Number, rod: Number, *, short_series: bool | np.ndarray = False
) -> Array:
    """Inertia torque -x'(a) x''(a) in m2 [..., M] at equal steps from top dead centre,
    of 1 kg at 1 rad/s of the crank.

    ``short_series``: take x'' = r (cos a + lambda cos 2a - lambda^3/4 cos 4a + 9
    lambda^5/128 cos 6a) of Mendes, Meirelles and Zampieri 2008, about 3 % of lambda
    from the exact one.
    """
    xp = namespace(stroke, rod)
    stroke = xp.asarray(stroke)[..., None]
    rod = xp.asarray(rod)[..., None]
    short = xp.asarray(short_series)[..., None]
    angle = 2.0 * np.pi * (np.arange(CRANK_SAMPLES) / CRANK_SAMPLES)
    _, x1, x2 = slider_crank(angle, stroke, rod)
    r = 0.5 * stroke
    ratio = 0.5 * stroke / rod
    series = (
        np.cos(angle) + ratio * np.cos(2 * angle) - ratio**3 / 4 * np.cos(4 * angle)
    )
    short_x2 = r * (series + 9 * ratio**5 / 128 * np.cos(6 * angle))
    return -x1 * xp.where(short, short_x2, x2)

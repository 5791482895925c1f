"""The crank-slider: its kinematics (NumPy or JAX) and the harmonics of its gas and inertia torques (JAX)."""

from __future__ import annotations

import jax.numpy as jnp

import jaxhb._x64  # noqa: F401

CRANK_SAMPLES = 512


def slider_crank(angle, stroke, rod, *, xp=jnp):
    """Piston travel of a centric crank-slider and its two derivatives by the crank angle, exact.

    With r = stroke/2, lambda = r/rod and q = sqrt(1 - lambda^2 sin^2 a): x = r (1 - cos a) + rod (1 - q), x'
    = r (sin a + lambda sin a cos a / q), x'' = r (cos a + lambda cos 2a / q + lambda^3 sin^2 a cos^2 a /
    q^3).

    Parameters
    ----------
    angle : array
        Crank angle from top dead centre, rad.
    stroke, rod : array
        Stroke and length of the connecting rod, m; broadcast against ``angle``; rod > stroke/2.
    xp : module
        ``jax.numpy`` or ``numpy``.

    Returns
    -------
    x, x1, x2 : array
        Travel from top dead centre (m) and its first two derivatives by the angle (m/rad, m/rad2).

    Notes
    -----
    Classical; Den Hartog, *Mechanical Vibrations*, section 5.3.

    Examples
    --------
    >>> from jaxhb.model.crank import slider_crank
    >>> [round(float(v), 6) for v in slider_crank(0.0, 0.1, 0.2)]
    [0.0, 0.0, 0.0625]
    """
    r = 0.5 * stroke
    ratio = r / rod
    s, c = xp.sin(angle), xp.cos(angle)
    q = xp.sqrt(1.0 - (ratio * s) ** 2)
    x = r * (1.0 - c) + rod * (ratio * s) ** 2 / (1.0 + q)
    x1 = r * (s + ratio * s * c / q)
    x2 = r * (c + ratio * (c * c - s * s) / q + ratio**3 * (s * c) ** 2 / q**3)
    return x, x1, x2


def short_series_acceleration(angle, stroke, rod, *, xp=jnp):
    """x'' by the short series of Mendes, Meirelles and Zampieri 2008 (about 3 % of lambda from the exact
    one).

    x'' = r (cos a + lambda cos 2a - lambda^3/4 cos 4a + 9 lambda^5/128 cos 6a), in m/rad2; arguments as for
    :func:`slider_crank`.
    """
    r = 0.5 * stroke
    ratio = r / rod
    return r * (
        xp.cos(angle)
        + ratio * xp.cos(2 * angle)
        - ratio**3 / 4 * xp.cos(4 * angle)
        + 9 * ratio**5 / 128 * xp.cos(6 * angle)
    )


def gas_torque_harmonics(pressure, bore, stroke, rod, *, revolutions):
    """Harmonics of p A x'(a) over the gas cycle, of a pressure on a uniform grid from firing top dead centre
    on.

    Parameters
    ----------
    pressure : array [..., M]
        Pressure on the piston, Pa, at M equal steps of the gas cycle.
    bore, stroke, rod : array [...]
        m.
    revolutions : array [...]
        Revolutions of the crank in a gas cycle: 2 (four-stroke) or 1.

    Returns
    -------
    array [..., M//2 + 1], complex
        N m; entry 0 the mean, entry k the coefficient of exp(i k a / revolutions), half the peak amplitude.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxhb.model.crank import gas_torque_harmonics
    >>> abs(gas_torque_harmonics(np.ones(64) * 1e5, 0.1, 0.1, 0.2, revolutions=2)[0]) < 1e-9
    Array(True, dtype=bool)
    """
    pressure = jnp.asarray(pressure, dtype=jnp.float64)
    bore, stroke, rod, revolutions = (jnp.asarray(v)[..., None] for v in (bore, stroke, rod, revolutions))
    samples = pressure.shape[-1]
    angle = 2.0 * jnp.pi * revolutions * (jnp.arange(samples) / samples)
    _, x1, _ = slider_crank(angle, stroke, rod)
    return jnp.fft.rfft(pressure * (jnp.pi / 4.0) * bore**2 * x1) / samples


def inertia_torque_harmonics(stroke, rod, *, short_series=False):
    """Harmonics of -x'(a) x''(a), the inertia torque of a reciprocating mass of 1 kg at 1 rad/s of the crank.

    Parameters
    ----------
    stroke, rod : array [...]
        m.
    short_series : bool or array [...]
        Take x'' from :func:`short_series_acceleration`.

    Returns
    -------
    array [..., 257], complex
        N m; entry j the coefficient of exp(i j a), half the peak amplitude, a from top dead centre.

    Notes
    -----
    The series in lambda = stroke/(2 rod) is Porter's (1943): -1/2 sin 2a - 3 lambda/4 sin 3a + ... times m r^2 w^2.

    Examples
    --------
    >>> from jaxhb.model.crank import inertia_torque_harmonics
    >>> round(float(-2 * inertia_torque_harmonics(2.0, 5.0)[2].imag), 12)
    -0.500052072485
    """
    stroke, rod, short = (jnp.asarray(v)[..., None] for v in (stroke, rod, short_series))
    angle = 2.0 * jnp.pi * (jnp.arange(CRANK_SAMPLES) / CRANK_SAMPLES)
    _, x1, x2 = slider_crank(angle, stroke, rod)
    x2 = jnp.where(short, short_series_acceleration(angle, stroke, rod), x2)
    return jnp.fft.rfft(-x1 * x2) / CRANK_SAMPLES

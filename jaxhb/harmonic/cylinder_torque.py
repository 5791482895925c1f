"""Harmonics of the torques of a cylinder, over its gas cycle and over a revolution of its own rotor."""

import numpy as np

from .._jax import kept, namespace
from ..model.crank import CRANK_SAMPLES, gas_torque, inertia_torque
from ..model.gas import COMPUTED, components
from . import fourier


def gas_torque_harmonics(pressure, bore, stroke, rod, *, revolutions):
    """Harmonics of :func:`~jaxhb.model.crank.gas_torque` over the gas cycle, arguments as there.

    Returns
    -------
    array [..., M//2 + 1], complex
        N m; entry 0 the mean, entry k the coefficient of exp(i k a / revolutions), half the peak amplitude.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxhb.harmonic.cylinder_torque import gas_torque_harmonics
    >>> bool(abs(gas_torque_harmonics(np.ones(64) * 1e5, 0.1, 0.1, 0.2, revolutions=2)[0]) < 1e-9)
    True
    """
    torque = gas_torque(pressure, bore, stroke, rod, revolutions=revolutions)
    return fourier.analyze(torque, torque.shape[-1] // 2)


def inertia_torque_harmonics(stroke, rod, *, short_series=False):
    """Harmonics of :func:`~jaxhb.model.crank.inertia_torque` over a revolution, arguments as there.

    Returns
    -------
    array [..., 257], complex
        N m; entry j the coefficient of exp(i j a), half the peak amplitude, a from top dead centre.

    Notes
    -----
    The series in lambda = stroke/(2 rod) is Porter's (1943): -1/2 sin 2a - 3 lambda/4 sin 3a + ... times m r^2 w^2.

    Examples
    --------
    >>> from jaxhb.harmonic.cylinder_torque import inertia_torque_harmonics
    >>> round(float(-2 * inertia_torque_harmonics(2.0, 5.0)[2].imag), 12)
    -0.500052072485
    """
    return fourier.analyze(inertia_torque(stroke, rod, short_series=short_series), CRANK_SAMPLES // 2)


def pressure_cylinders(topology) -> tuple[int, ...]:
    """Indices of the cylinders whose gas torque is computed."""
    both = zip(topology.cylinder_source, topology.cylinder_fires, strict=True)
    return tuple(i for i, (source, fires) in enumerate(both) if source in COMPUTED and fires)


def gas_revolutions(topology, rows):
    """Revolutions of the gas cycles of some cylinders."""
    return tuple(topology.cylinder_gas_revolutions[i] for i in rows)


@kept
def pressure_harmonics(table, rows, revolutions):
    """Harmonics of the gas cycle of p A x' [J, n, K], one for each component of p, and of p_ambient A x' [n, K].

    ``rows`` are the n cylinders of the table, ``revolutions`` those of their gas cycles.
    """
    xp, rows = namespace(table), np.array(rows, dtype=int)
    given = (table.ambient_pressure, table.bore, table.stroke, table.rod)
    pressure = xp.asarray(components(table))[:, rows]
    ambient, *geometry = (xp.asarray(values)[rows] for values in given)
    all_of = xp.concatenate([pressure, xp.broadcast_to(ambient[None, :, None], (1, *pressure.shape[1:]))])
    harmonics = gas_torque_harmonics(all_of, *geometry, revolutions=np.array(revolutions))
    return harmonics[:-1], harmonics[-1]


@kept
def unit_inertia_harmonics(table, short_series):
    """:func:`inertia_torque_harmonics` of the cylinders of a table."""
    return inertia_torque_harmonics(table.stroke, table.rod, short_series=np.array(short_series))

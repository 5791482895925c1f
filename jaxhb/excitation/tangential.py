"""Gas torques from tables of tangential pressure, as engine makers give them, in NumPy
or JAX.

The tangential pressure of a cylinder is its gas torque over piston area A and crank
radius r. At the crank angle a from firing top dead centre

    T(a) = A r (T_0 + sum_n C_n cos(n a) + S_n sin(n a)),    T_0 = p_mi / (pi z),

with the orders n of the crank, the mean indicated pressure p_mi and z revolutions of
the gas cycle: p_mi A 2 r is the work of a cycle, and 2 pi z its angle. The table has
C_n and S_n over p_mi, linear between its rows and constant outside them. At p_mi = 0
stands compression alone, which holds without injection.
"""

from __future__ import annotations

import numpy as np

from jaxhb._jax import Array, Number, namespace
from jaxhb.excitation import gas
from jaxhb.excitation.tables import Cylinders, GasCycles, TangentialPressures


def mean_indicated_pressures(cylinders: Cylinders, rpm: Number) -> Array:
    """Mean indicated pressure with injection, Pa [..., n] at ``rpm`` [...], of the
    cylinders with a table.
    """
    table = _table(cylinders)
    return table.imep * gas.load_share(cylinders, rpm)[..., np.array(table.seats)]


def tangential_means(cylinders: Cylinders, cycles: GasCycles, rpm: Number) -> Array:
    """Mean torque N m [..., nc] at ``rpm`` [...], 0 of cylinders without a table."""
    table = _table(cylinders)
    seats = np.array(table.seats)
    xp = namespace(cylinders)
    stroke = xp.asarray(cylinders.stroke)[seats]
    swept = _area(cylinders) * stroke
    turns = 2.0 * np.pi * np.array(table.revolutions)
    share = gas.injection(cylinders, cycles)[seats]
    share = share * np.array(cycles.tangential)[seats]
    mean = share * mean_indicated_pressures(cylinders, rpm) * swept / turns
    return gas.on_cylinders(mean, table.seats, len(cycles.source), axis=-1)


def tangential_harmonics(cylinders: Cylinders, cycles: GasCycles, rpm: Number) -> Array:
    """Coefficients T^n N m, complex [..., n, K] at ``rpm`` [...], of the orders of the
    cylinders with a table, for firing at 0.
    """
    table = _table(cylinders)
    seats = np.array(table.seats)
    xp = namespace(cylinders)
    share = gas.injection(cylinders, cycles)[seats][:, None]
    weights = gas.hats(mean_indicated_pressures(cylinders, rpm), table.grid)
    compression = np.eye(1, table.grid.shape[-1])
    weights = share * weights + (1.0 - share) * compression
    parts = xp.einsum("...nr,nrkc->...nkc", weights, table.parts)
    radius = 0.5 * xp.asarray(cylinders.stroke)[seats]
    size = (0.5 * _area(cylinders) * radius)[:, None]
    return size * (parts[..., 0] - 1j * parts[..., 1])


def _table(cylinders: Cylinders) -> TangentialPressures:
    table = cylinders.tangential_pressure
    assert table is not None  # callers have such cylinders
    return table


def _area(cylinders: Cylinders) -> Array:
    """Area of the piston (m2) of the cylinders with a table."""
    xp = namespace(cylinders)
    bore = xp.asarray(cylinders.bore)[np.array(_table(cylinders).seats)]
    return np.pi / 4.0 * bore**2

"""Mean gas torques, gas pressures and scales at a speed, in NumPy or JAX; scenes are
checked by them, without jax.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxhb._jax import Array, Number, namespace, remembered
from jaxhb.excitation import gas
from jaxhb.excitation.crank import gas_torque
from jaxhb.excitation.tables import Cylinders, GasCycles
from jaxhb.excitation.tangential import tangential_means


def scale_at(table: Any, rpm: Number) -> Array:
    """Factor of each element at ``rpm`` [..., n]: its scale, linear between the points
    and constant outside them.
    """
    return between_points(rpm, table.scale_rpm, table.scale_factor)


def between_points(rpm: Number, speeds: Array, values: Array) -> Array:
    """Values [..., n] at ``rpm`` [...] of n rows ``values`` [n, K] over ``speeds`` [n,
    K], linear between the points and constant outside them.
    """
    if namespace(speeds, values, rpm) is not np:
        import jax
        import jax.numpy as jnp

        interpolate = jax.vmap(jnp.interp, in_axes=(None, 0, 0), out_axes=-1)
        return interpolate(rpm, speeds, values)
    points = zip(speeds, values, strict=True)
    rows = [np.interp(rpm, *row) for row in points]
    return np.reshape(rows, (len(rows), *np.shape(rpm))).T


def gas_pressures(cylinders: Cylinders, cycles: GasCycles, rpm: Number) -> Array:
    """Pressure [..., nc, M] (Pa) of every cylinder from firing top dead centre on,
    times its scale, at ``rpm`` [...].

    M is 0 where no cylinder computes its torque from a pressure; zeros stand for those
    that do not.
    """
    weights = gas.weights(cylinders, cycles, rpm)
    components = gas.components(cylinders, cycles)
    pressure = np.einsum("...jn,jnm->...nm", weights, components)
    return scale_at(cylinders, rpm)[..., None] * pressure


def mean_gas_torques(cylinders: Cylinders, cycles: GasCycles, rpm: Number) -> Array:
    """Mean of the gas torques of the cylinders, N m [..., nc], at ``rpm`` [...].

    The ambient pressure and the inertia torque do no work over a cycle. In NumPy or
    JAX.
    """
    prescribed = namespace(cylinders.gas_torque_mean).asarray(cylinders.gas_torque_mean)
    means = _computed_means(cylinders, cycles)
    computed = (gas.weights(cylinders, cycles, rpm) * means).sum(axis=-2)
    if cycles.skipping:
        unburnt = gas.unburnt_weights(cylinders, rpm)
        every = np.array(cycles.every)
        idle = (unburnt * means[means.shape[0] - unburnt.shape[-2] :]).sum(axis=-2)
        computed = (computed + (every - 1) * idle) / every
    prescribed = (
        np.array(cycles.prescribed) * gas.injection(cylinders, cycles) * prescribed
    )
    mean = prescribed + np.array(cycles.computed) * computed
    if cylinders.tangential_pressure is not None:
        mean = mean + tangential_means(cylinders, cycles, rpm)
    if cylinders.gas_factor is not None:
        mean = cylinders.gas_factor * mean
    return scale_at(cylinders, rpm) * mean


@remembered
def _computed_means(cylinders: Cylinders, cycles: GasCycles) -> Array:
    """Mean torque [J, nc], N m, of each component of the gas pressure: speeds differ in
    its weights alone.
    """
    pressures = gas.components(cylinders, cycles)
    if not pressures.shape[-1]:
        return np.zeros(pressures.shape[:-1])
    torque = gas_torque(
        pressures,
        cylinders.bore,
        cylinders.stroke,
        cylinders.rod,
        revolutions=np.array(cycles.revolutions),
    )
    return torque.mean(axis=-1)

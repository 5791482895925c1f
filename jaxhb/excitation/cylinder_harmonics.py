"""Harmonics of the torques of crank-sliders, over a gas cycle and over a revolution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxhb._jax import Array, Number, namespace, remembered
from jaxhb.equations import fourier
from jaxhb.excitation.crank import CRANK_SAMPLES, gas_torque, inertia_torque
from jaxhb.excitation.gas import components, in_groups, unburnt_weights, weights
from jaxhb.excitation.tables import Cylinders, GasCycles


@remembered
def pressure_harmonics(
    table: Cylinders, cylinders: Sequence[int], cycles: GasCycles
) -> tuple[Array, Array]:
    """Harmonics of the gas cycle of p A x' [J, n, K] N m, one for each component of p,
    and of p_ambient A x' [n, K].

    ``cylinders`` are the n rows of the table.
    """
    revolutions = np.array([cycles.revolutions[i] for i in cylinders])
    xp = namespace(table)
    rows = np.array(cylinders, dtype=int)
    pressure = xp.asarray(components(table, cycles))[:, rows]
    ambient, bore, stroke, rod = (
        xp.asarray(values)[rows]
        for values in (table.ambient_pressure, table.bore, table.stroke, table.rod)
    )
    ambient = xp.broadcast_to(ambient[None, :, None], (1, *pressure.shape[1:]))
    pressures = xp.concatenate([pressure, ambient])
    torque = gas_torque(pressures, bore, stroke, rod, revolutions=revolutions)
    if cycles.skipping:
        every = [cycles.every[i] for i in rows]
        return _over_several_cycles(torque[:-1], torque[-1], every)
    harmonics = fourier.analyze(torque, torque.shape[-1] // 2)
    return harmonics[:-1], harmonics[-1]


def _over_several_cycles(
    torque: Array, ambient: Array, every: Sequence[int]
) -> tuple[Array, Array]:
    """Harmonics as of :func:`pressure_harmonics`, of cylinders that are injected in
    one of ``every`` [n] gas cycles: those of all these cycles.

    Components [J, n, M] hold in the gas cycle round the injection; the components
    without injection, the second half of all but the heat, hold in the other cycles
    too, and follow once more with that part.
    """
    xp = namespace(torque)
    samples = torque.shape[-1]
    half = samples // 2

    def of_group(cycles: int, rows: np.ndarray) -> Array:
        of_rows = torque[:, rows]
        between = xp.zeros((*of_rows.shape[:-1], (cycles - 1) * samples))
        with_injection = xp.concatenate(
            [of_rows[..., :half], between, of_rows[..., half:]], axis=-1
        )
        turned = xp.roll(of_rows, -half, axis=-1)
        idle = between
        if cycles > 1:
            idle = xp.concatenate([turned] * (cycles - 1), axis=-1)
        zeros = xp.zeros((*idle.shape[:-1], half))
        without = xp.concatenate([zeros, idle, zeros], axis=-1)
        outside = xp.concatenate([ambient[None, rows]] * cycles, axis=-1)
        signal = xp.concatenate([with_injection, without, outside])
        return fourier.analyze(signal, half)

    harmonics = in_groups(every, of_group)
    return harmonics[:-1], harmonics[-1]


@remembered
def unit_inertia_harmonics(table: Cylinders, short_series: Sequence[bool]) -> Array:
    """Harmonics [..., 257] of the torque of 1 kg at 1 rad/s over a revolution of each
    cylinder's crank, m2.
    """
    torque = inertia_torque(
        table.stroke, table.rod, short_series=np.array(short_series)
    )
    return fourier.analyze(torque, CRANK_SAMPLES // 2)


def harmonic_weights(table: Cylinders, cycles: GasCycles, rpm: Number) -> Array:
    """Weights [..., J, nc] of all harmonics that :func:`pressure_harmonics` gives."""
    by_component = weights(table, cycles, rpm)
    if not cycles.skipping:
        return by_component
    unburnt = unburnt_weights(table, rpm)
    xp = namespace(by_component, unburnt)
    burnt = by_component.shape[-2] - unburnt.shape[-2]
    zeros = xp.zeros((*by_component.shape[:-2], burnt, by_component.shape[-1]))
    return xp.concatenate([by_component, zeros, unburnt], axis=-2)


def computed_gas(
    cylinders: Cylinders, cycles: GasCycles
) -> tuple[tuple[int, ...], Any, Any]:
    """Cylinders whose gas torque is computed, and their :func:`pressure_harmonics`,
    also of the ambient pressure.
    """
    rows = tuple(i for i, computed in enumerate(cycles.computed) if computed)
    if not rows:
        return rows, None, None
    harmonics, ambient = pressure_harmonics(cylinders, rows, cycles)
    return rows, harmonics, ambient

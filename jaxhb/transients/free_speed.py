"""Free speed: the mean rotation as its mean torques drive it.

With J the inertia of the train referred to the reference rotor, i the speed ratios and
Omega the speed of the reference rotor,

    J Omega' = sum_disks i T_0(Omega) + sum_loads i L(Omega) + sum_events i T(t, theta),

integrated by the classical Runge-Kutta method from border to border of the blocks. What
vibration takes from the mean rotation is left out.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxhb._jax import Array, Number
from jaxhb._program import Program
from jaxhb.transients.disturbance import Disturbance
from jaxhb.transients.torques import TorqueTable, means


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MeanRotation:
    """Numbers of the mean rotation: the table of torques, with the loads of its speeds;
    ratios ``(D,)`` of its disks and ``(E,)`` of those of events; inertia kg m2.
    """

    table: TorqueTable
    ratios: Array
    event_ratios: Array
    inertia: Number
    disturbance: Disturbance | None


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Rotation:
    """Speed ``(B + 1,)`` rad/s at the borders of blocks, and its rates ``(B,)`` rad/s2
    at their begins and ends.
    """

    omega: Array
    first: Array
    last: Array


# Events that jump at a border belong to one side of it.
INSIDE = 1e-9


def _rate(
    mean: MeanRotation,
    seconds: Number,
    omega: Number,
    angle: Number,
    mode: Array,
    start_angles: Array,
) -> Array:
    """Angular acceleration in rad/s2 of the reference rotor."""
    disturbance = mean.disturbance
    if disturbance is None:
        return means(mean.table, mode, omega, 1.0) @ mean.ratios / mean.inertia
    now = jnp.asarray(seconds)[None]
    factor = disturbance.fuel(now)[0]
    torque = means(mean.table, mode, omega, factor) @ mean.ratios
    begun = dataclasses.replace(disturbance, start_angles=start_angles)
    of_events = begun.torque(now, jnp.asarray(angle)[None])[0]
    return (torque + of_events @ mean.event_ratios) / mean.inertia


@Program
def free_rotation(
    mean: MeanRotation, omega: Number, borders: Array, mode: Array, begins_at: Array
) -> Rotation:
    """The :class:`Rotation` from a speed ``omega`` in rad/s on, with states ``(B,)`` of
    the cylinders.

    borders ``(B + 1,)`` s; begins_at ``(E,)``: the block with which each torque begins,
    whose angle it counts from.
    """
    mean, borders, mode = jax.tree.map(jnp.asarray, (mean, borders, mode))
    begins_at = jnp.asarray(begins_at)

    def block(
        carry: tuple[jax.Array, jax.Array, jax.Array], row: Any
    ) -> tuple[tuple[jax.Array, jax.Array, jax.Array], Any]:
        omega, angle, starts = carry
        begin, duration, mode, number = row
        starts = jnp.where(begins_at == number, angle, starts)

        def slope(share: float, omega: Array, angle: Array) -> Array:
            seconds = begin + share * duration
            return _rate(mean, seconds, omega, angle, mode, starts)

        half = duration / 2
        first = slope(INSIDE, omega, angle)
        second_omega = omega + half * first
        second = slope(0.5, second_omega, angle + half * omega)
        third_omega = omega + half * second
        third = slope(0.5, third_omega, angle + half * second_omega)
        fourth_omega = omega + duration * third
        fourth = slope(1 - INSIDE, fourth_omega, angle + duration * third_omega)
        after = omega + duration / 6 * (first + 2 * second + 2 * third + fourth)
        mean_omega = omega + duration / 6 * (first + second + third)
        turned = angle + duration * mean_omega
        last = slope(1 - INSIDE, after, turned)
        return (after, turned, starts), (after, first, last)

    rows = (borders[:-1], jnp.diff(borders), mode, jnp.arange(len(mode)))
    omega = jnp.asarray(omega, dtype=float)
    begin = (omega, jnp.zeros(()), jnp.full(len(begins_at), jnp.inf))
    _, (after, first, last) = lax.scan(block, begin, rows)
    return Rotation(jnp.append(omega, after), first, last)

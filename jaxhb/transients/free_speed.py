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
import numpy as np
from jax import lax

from jaxhb._jax import Array, Number
from jaxhb._program import Program
from jaxhb.elements.sentences import SceneError
from jaxhb.train import excitation
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.kinematics import speed_ratios
from jaxhb.train.speeds import HIGHEST_RPM
from jaxhb.transients import torques
from jaxhb.transients.course import (
    Course,
    Occurrence,
    course,
    disturbance_of,
    event_corners,
)
from jaxhb.transients.events import Disturbance
from jaxhb.transients.timeline import (
    INSIDE,
    STEPS,
    SpeedTable,
    check_seconds,
    grid,
)
from jaxhb.transients.torques import TorqueTable, means

FREE_STEPS = 2048  # of the first integration of a free speed


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


# Runge-Kutta steps of a block, without events and with torques or fuel of events that
# may change as fast as its steps resolve: a multiple of 3.
SUBSTEPS = 3
SUBSTEPS_OF_EVENTS = 48


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
) -> Array:
    """Speeds ``(B, 4)`` rad/s at begin, thirds and end of blocks from a speed ``omega``
    in rad/s on, with states ``(B,)`` of the cylinders.

    borders ``(B + 1,)`` s; begins_at ``(E,)``: the block with which each torque begins,
    whose angle it counts from.
    """
    mean, borders, mode = jax.tree.map(jnp.asarray, (mean, borders, mode))
    begins_at = jnp.asarray(begins_at)
    substeps = SUBSTEPS if mean.disturbance is None else SUBSTEPS_OF_EVENTS

    def block(
        carry: tuple[jax.Array, jax.Array, jax.Array], row: Any
    ) -> tuple[tuple[jax.Array, jax.Array, jax.Array], Any]:
        omega, angle, starts = carry
        begin, duration, mode, number = row
        starts = jnp.where(begins_at == number, angle, starts)

        def slope(share: Number, omega: Array, angle: Array) -> Array:
            inside = jnp.clip(share, INSIDE, 1 - INSIDE)
            seconds = begin + inside * duration
            return _rate(mean, seconds, omega, angle, mode, starts)

        def substep(k: Array, values: tuple[Array, Array]) -> tuple[Array, Array]:
            omega, angle = values
            share = k / substeps
            h = duration / substeps
            first = slope(share, omega, angle)
            second_omega = omega + h / 2 * first
            middle = share + 0.5 / substeps
            second = slope(middle, second_omega, angle + h / 2 * omega)
            third_omega = omega + h / 2 * second
            third = slope(middle, third_omega, angle + h / 2 * second_omega)
            fourth_omega = omega + h * third
            end = share + 1 / substeps
            fourth = slope(end, fourth_omega, angle + h * third_omega)
            turned = omega + h / 6 * (first + second + third)
            change = h / 6 * (first + 2 * second + 2 * third + fourth)
            return omega + change, angle + h * turned

        at_thirds = [omega]
        for part in range(3):
            steps = (part * substeps // 3, (part + 1) * substeps // 3)
            omega, angle = lax.fori_loop(*steps, substep, (omega, angle))
            at_thirds.append(omega)
        return (omega, angle, starts), jnp.stack(at_thirds)

    rows = (borders[:-1], jnp.diff(borders), mode, jnp.arange(len(mode)))
    omega = jnp.asarray(omega, dtype=float)
    begin = (omega, jnp.zeros(()), jnp.full(len(begins_at), jnp.inf))
    _, speeds = lax.scan(block, begin, rows)
    return speeds


@dataclass(frozen=True)
class Plan:
    """Speed of a transient, of a ``free`` one about, and its :class:`Course`."""

    table: SpeedTable
    course: Course
    free: bool


def free_plan(
    values: DriveTrain,
    seconds: float,
    speed: str,
    rpm: float | None,
    listed: list[Occurrence],
) -> Plan:
    """The :class:`Plan` of a free speed: integrated again until events that begin at
    angles and speeds stand still.
    """
    check_seconds(seconds)
    title = values.topology.title
    if speed != "free":
        raise SceneError(
            f"transient: speed is {speed!r}: give a number in rpm, rows of (s, rpm), or"
            ' "free".'
        )
    if rpm is None or not (np.isfinite(rpm) and 0 <= rpm <= HIGHEST_RPM):
        raise SceneError(
            f'{title}: speed="free" begins at rpm={rpm!r}: give the first speed, from 0'
            f" to {HIGHEST_RPM:.0f} rpm."
        )
    topology = values.topology
    lawless = [
        name
        for name, law in zip(topology.names_of("load"), topology.load_law, strict=True)
        if not law
    ]
    if lawless or not topology.load_disk:
        which = (
            f"load {lawless[0]!r} has no law over the speed"
            if lawless
            else ("there is no [[load]]")
        )
        raise SceneError(
            f"{title}: at free speed {which}: give a load a law with rated_torque and"
            " rated_rpm, or over_rpm."
        )
    table = SpeedTable(np.array([0.0, seconds]), np.array([rpm, rpm]))
    highest = 2.0 * max(rpm, *known_speeds(values), 1.0)
    plan = Plan(table, course(values, listed, table), free=True)
    for _ in range(4 + 2 * len(listed)):
        after = _free_again(values, plan, seconds, rpm, highest)
        settled = np.allclose(
            after.table.rpm[[0, -1]], plan.table.rpm[[0, -1]], rtol=1e-9
        ) and np.allclose(after.course.begins, plan.course.begins, atol=1e-9)
        plan = after
        if settled:
            break
    return plan


def _free_again(
    values: DriveTrain, plan: Plan, seconds: float, rpm: float, highest: float
) -> Plan:
    """The plan with the speed that follows from its course."""
    corners = event_corners(values, plan.course, plan.table, seconds)
    steps = grid(seconds, corners, seconds / FREE_STEPS / STEPS, slowest=0.0)
    present = plan.course
    table = torques.torque_table(
        present.states(values),
        present.idle_states(values),
        torques.panels(values, 0.0, highest),
        1,
        free=True,
    )
    disturbance = disturbance_of(values, present)
    mean = mean_rotation(values, present, table, disturbance)
    mode = plan.course.mode(steps.begin)
    omega = np.asarray(rotated(mean, rpm, steps.borders, mode, plan.course))
    speeds = np.append(omega[:, 0], omega[-1, -1]) * (30 / np.pi)
    title = values.topology.title
    # Where speeds turn negative torques have no law: what follows means nothing.
    stopped = np.append(np.flatnonzero(speeds < 0), len(speeds))[0]
    away = np.append(np.flatnonzero(~(speeds <= 0.99 * highest)), len(speeds))[0]
    if away < stopped:
        raise SceneError(
            f"{title}: at free speed the train runs away: {0.99 * highest:.5g} rpm are"
            f" passed after {steps.borders[away]:.3g} s. Correct the mean torques or"
            " the laws of loads."
        )
    if stopped < len(speeds):
        raise SceneError(
            f"{title}: at free speed the train stops after"
            f" {steps.borders[stopped]:.3g} s. Ask for fewer seconds, or correct the"
            " mean torques or the laws of loads."
        )
    after = SpeedTable(steps.borders, speeds)
    return Plan(after, course(values, plan.course.listed, after), free=True)


def known_speeds(train: DriveTrain) -> list[float]:
    """Speeds in rpm of the reference rotor at which torques and loads are given."""
    numbers = [*excitation.speeds(train)]
    loads = train.loads
    if loads.rated_rpm is not None:
        numbers += np.asarray(loads.rated_rpm).tolist()
    if loads.over_rpm is not None:
        numbers += np.asarray(loads.over_rpm)[..., 0].ravel().tolist()
    return [float(number) for number in numbers if np.isfinite(number)]


def mean_rotation(
    train: DriveTrain,
    plan: Course,
    table: TorqueTable,
    disturbance: Disturbance | None,
) -> MeanRotation:
    """The :class:`MeanRotation` of a train with its table of torques."""
    ratio = speed_ratios(train)[np.array(train.topology.rotor, dtype=int)]
    return MeanRotation(
        table=table,
        ratios=ratio[torques.excited_disks(train)],
        event_ratios=ratio[plan.torque_disks],
        inertia=torques.accelerated_inertia(train),
        disturbance=disturbance,
    )


def rotated(
    mean: MeanRotation,
    rpm: float,
    borders: np.ndarray,
    mode: np.ndarray,
    plan: Course,
) -> Array:
    """Speeds ``(B, 4)`` rad/s at begin, thirds and end of blocks between borders ``(B +
    1,)`` s.
    """
    count = len(mode)
    # Few lengths, so that few programs are compiled
    room = 1 << int(np.ceil(np.log2(count)))
    longer = np.append(borders, np.full(room - count, borders[-1]))
    modes = np.append(mode, np.full(room - count, mode[-1]))
    begins_at = np.searchsorted(borders, plan.torque_begins - 1e-9)
    return free_rotation(mean, rpm * np.pi / 30, longer, modes, begins_at)[:count]

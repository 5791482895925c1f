"""Free speed: the mean rotation as its mean torques drive it.

With J the inertia of the train referred to the reference rotor, i the speed ratios and
Omega the speed of the reference rotor,

    J Omega' = sum_disks i T_0(Omega) + sum_loads i L(Omega) + sum_events i T(t, theta),

integrated by Gauss collocation from border to border of the blocks: the acceleration is
a polynomial over the block, and obeys the equation at its nodes. What vibration takes
from the mean rotation is left out.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array, Number, concrete, traced
from jaxhb._program import Program
from jaxhb.elements.sentences import SceneError, shown
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
    STEPS,
    Blocks,
    Grid,
    SpeedTable,
    check_seconds,
    from_nodes,
    gauss_nodes,
    grid,
)
from jaxhb.transients.torques import TorqueTable, means

FREE_BLOCKS = 2048  # of the first integration of a free speed
SETTLED = 1e-9  # of begins in s, and of speeds as a share


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


# Nodes of a block, without events and with torques or fuel of events that may change as
# fast as its steps resolve: two periods of a sine, of which 24 nodes see all but 1e-12.
NODES = 3
NODES_OF_EVENTS = 24
# Fixed-point iterations of a block, each of which gains a factor of the block over the
# time in which the speed settles, and the largest last change over the highest speed.
ITERATIONS = 16
CLOSE = 1e-9


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Rotation:
    """Mean rotation over B blocks: angle rad and omega rad/s at their begins ``(B,)``,
    acceleration rad/s2 at their Gauss nodes ``(B, s)``; change of the speed in rad/s in
    the last iteration ``(B,)``.
    """

    angle: Array
    omega: Array
    acceleration: Array
    change: Array


def _rates(
    mean: MeanRotation, seconds: Array, omega: Array, angle: Array, mode: Array
) -> Array:
    """Angular accelerations ``(s,)`` in rad/s2 of the reference rotor."""
    disturbance = mean.disturbance
    factor: Array = jnp.ones(len(seconds))
    if disturbance is not None:
        factor = disturbance.fuel(seconds)

    def torque_at(omega: Array, factor: Array) -> Array:
        return means(mean.table, mode, omega, factor) @ mean.ratios

    torque = jax.vmap(torque_at)(omega, factor)
    if disturbance is not None:
        torque = torque + disturbance.torque(seconds, angle) @ mean.event_ratios
    return torque / mean.inertia


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
    count = NODES if mean.disturbance is None else NODES_OF_EVENTS
    nodes = gauss_nodes(count)
    to_speeds = from_nodes(count, nodes, 1)
    to_angles = from_nodes(count, nodes, 2)
    end = np.ones(1)
    to_speed_at_end = from_nodes(count, end, 1)[:, 0]
    to_angle_at_end = from_nodes(count, end, 2)[:, 0]

    def block(
        carry: tuple[jax.Array, jax.Array, jax.Array], row: Any
    ) -> tuple[tuple[jax.Array, jax.Array, jax.Array], Rotation]:
        omega, angle, starts = carry
        begin, duration, mode, number = row
        starts = jnp.where(begins_at == number, angle, starts)
        begun = mean
        if mean.disturbance is not None:
            disturbance = dataclasses.replace(mean.disturbance, start_angles=starts)
            begun = dataclasses.replace(mean, disturbance=disturbance)
        seconds = begin + nodes * duration

        def again(acceleration: Array) -> Array:
            speeds = omega + duration * (acceleration @ to_speeds)
            gained = duration * (acceleration @ to_angles)
            angles = angle + duration * (nodes * omega + gained)
            return _rates(begun, seconds, speeds, angles, mode)

        before = lax.fori_loop(
            0, ITERATIONS, lambda _, values: again(values), jnp.zeros(count)
        )
        acceleration = again(before)
        change = duration * jnp.max(jnp.abs(acceleration - before))
        rotation = Rotation(angle, omega, acceleration, change)
        gained = duration * (acceleration @ to_angle_at_end)
        angle = angle + duration * (omega + gained)
        omega = omega + duration * (acceleration @ to_speed_at_end)
        return (omega, angle, starts), rotation

    rows = (borders[:-1], jnp.diff(borders), mode, jnp.arange(len(mode)))
    omega = jnp.asarray(omega, dtype=float)
    first = (omega, jnp.zeros(()), jnp.full(len(begins_at), jnp.inf))
    # Backwards a block is integrated again, so that its iterations are not kept.
    _, rotation = lax.scan(jax.checkpoint(block), first, rows)
    return rotation


@dataclass(frozen=True)
class Plan:
    """Speed of a transient, of a ``free`` one about, its :class:`Course`, and notes on
    both.
    """

    table: SpeedTable
    course: Course
    free: bool
    notes: tuple[str, ...] = ()


def free_plan(
    values: DriveTrain,
    seconds: float,
    speed: str,
    rpm: float | None,
    listed: list[Occurrence],
    refine: int,
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
    points = [point for point in points_of(values) if point > 0.0]
    highest = 2.0 * max(rpm, *points, 1.0)
    while True:
        try:
            return _settled(values, seconds, rpm, listed, refine, highest)
        except RunsAway:
            # Torques that are alike at all speeds name none that is too high.
            if points or highest > HIGHEST_RPM:
                raise
            highest *= 8.0


class RunsAway(SceneError):
    """A free speed goes beyond the range of its torques."""


def _settled(
    values: DriveTrain,
    seconds: float,
    rpm: float,
    listed: list[Occurrence],
    refine: int,
    highest: float,
) -> Plan:
    """The plan whose begins of events stand still, of torques up to a speed in rpm."""
    table = SpeedTable(np.array([0.0, seconds]), np.array([rpm, rpm]))
    plan = Plan(table, course(values, listed, table), free=True)
    longest = seconds / FREE_BLOCKS / STEPS / refine
    torque_table = _torque_table(values, plan.course, highest)
    for _ in range(4 + 2 * len(listed)):
        after = _free_again(values, plan, torque_table, seconds, longest, rpm, highest)
        if after.course.numbers != plan.course.numbers:
            torque_table = _torque_table(values, after.course, highest)
        moving = ~np.isclose(
            after.course.begins, plan.course.begins, rtol=0.0, atol=SETTLED
        )
        ends = after.table.rpm[[0, -1]], plan.table.rpm[[0, -1]]
        plan = after
        if not moving.any() and np.allclose(*ends, rtol=SETTLED):
            return plan
    names = [listed[place].name for place in np.flatnonzero(moving)]
    which = ", ".join(shown(name) for name in names) or "changes of torques"
    return dataclasses.replace(
        plan,
        notes=(
            f"at free speed the begins of {which} did not settle: each integration of"
            " the speed moves them, so that they are uncertain",
        ),
    )


def _torque_table(values: DriveTrain, present: Course, highest: float) -> TorqueTable:
    """Mean torques of a course up to a speed in rpm."""
    return torques.torque_table(
        present.states(values),
        present.idle_states(values),
        torques.panels(values, 0.0, highest),
        1,
        free=True,
    )


def _free_again(
    values: DriveTrain,
    plan: Plan,
    table: TorqueTable,
    seconds: float,
    longest: float,
    rpm: float,
    highest: float,
) -> Plan:
    """The plan with the speed that follows from its course."""
    corners = event_corners(values, plan.course, plan.table, seconds)
    steps = grid(seconds, corners, longest)
    disturbance = disturbance_of(values, plan.course)
    mean = mean_rotation(values, plan.course, table, disturbance)
    blocks = free_blocks(mean, rpm, steps, plan.course)
    omega = np.append(blocks.omega, blocks.speeds(np.ones(1))[-1])
    speeds = np.asarray(omega) * (30 / np.pi)
    title = values.topology.title
    # Where speeds turn negative torques have no law: what follows means nothing.
    stopped = np.append(np.flatnonzero(speeds < 0), len(speeds))[0]
    away = np.append(np.flatnonzero(~(speeds <= 0.99 * highest)), len(speeds))[0]
    if away < stopped:
        raise RunsAway(
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


def points_of(train: DriveTrain) -> list[float]:
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


def free_blocks(mean: MeanRotation, rpm: float, steps: Grid, plan: Course) -> Blocks:
    """The :class:`Blocks` of the free speed from ``rpm`` on."""
    count = len(steps.begin)
    mode = plan.mode(steps.begin)
    # Few lengths, so that few programs are compiled
    room = 1 << int(np.ceil(np.log2(count)))
    borders = np.append(steps.borders, np.full(room - count, steps.borders[-1]))
    modes = np.append(mode, np.full(room - count, mode[-1]))
    begins_at = np.searchsorted(steps.borders, plan.torque_begins - 1e-9)
    rotation = free_rotation(mean, rpm * np.pi / 30, borders, modes, begins_at)
    rotation = jax.tree.map(lambda values: values[:count], rotation)
    _check_iterations(rotation, steps, float(mean.table.omega[-1, -1]))
    if not traced(rotation):
        rotation = jax.tree.map(np.asarray, rotation)
    return Blocks(
        begin=steps.begin,
        step=steps.step,
        kind=steps.kind,
        mode=mode,
        angle=rotation.angle,
        omega=rotation.omega,
        acceleration=rotation.acceleration,
    )


def _check_iterations(rotation: Rotation, steps: Grid, highest: float) -> None:
    """Refuse blocks whose iterations have not converged at speeds in rad/s from 0 to
    the ``highest``; beyond, the train has run away or has stopped.
    """
    omega, change = concrete(rotation.omega, rotation.change)
    inside = (np.asarray(omega) >= 0) & (np.asarray(omega) <= highest)
    failed = np.flatnonzero(inside & ~(np.asarray(change) <= CLOSE * highest))
    if len(failed):
        first = failed[0]
        raise SceneError(
            "transient: at free speed the mean torques change too fast after"
            f" {steps.begin[first]:.3g} s for blocks of {STEPS} steps of"
            f" {steps.step[first]:.2g} s: ask for shorter ones by a greater refine."
        )

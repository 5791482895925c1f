"""Transients: run-ups and run-downs, and events at a steady mean speed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array, concrete, namespace, traced
from jaxhb.elements.events import TORQUES
from jaxhb.elements.sentences import SceneError
from jaxhb.equations.state_space import (
    Partition,
    loss_damping,
    partition,
    state_space,
)
from jaxhb.equations.system import System
from jaxhb.results.response import Response
from jaxhb.results.steady import SteadyState
from jaxhb.steady.classification import motion_of
from jaxhb.steady.marching import Equations
from jaxhb.steady.steady_state import steady_state
from jaxhb.train import chain, excitation
from jaxhb.train.chain import rigid_shape
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.kinematics import speed_ratios
from jaxhb.train.mesh_parameters import all_meshes, law_meshes
from jaxhb.train.speeds import HIGHEST_RPM
from jaxhb.transients import torques
from jaxhb.transients.course import (
    Course,
    Occurrence,
    begin_seconds,
    course,
    event_corners,
    occurrences,
    refuse_moving_jumps,
    refuse_unsupported,
)
from jaxhb.transients.disturbance import Disturbance
from jaxhb.transients.free_speed import MeanRotation, Rotation, free_rotation
from jaxhb.transients.march import Errors, Marched, Marching, first_instant, march
from jaxhb.transients.motion import Readings, Transient
from jaxhb.transients.timeline import (
    STEPS,
    Blocks,
    Grid,
    SpeedTable,
    blocks_of_rates,
    blocks_of_table,
    grid,
    padded,
)
from jaxhb.transients.weights import (
    ForcedSpace,
    FreeRotation,
    StepWeights,
    forced_space,
    in_pairs,
    step_weights,
)

# Steps per period of the highest harmonic of the excitation at the highest speed, and
# of the highest mode that teeth notice.
STEPS_PER_WAVE = 32
STEPS_PER_MODE_PERIOD = 8
CHUNK = 64  # blocks of a program
MOST_DISKS = 600  # modes of more take minutes
MOST_STEPS = 2**26
MEMORY = 2**31  # B of states
FREE_STEPS = 2048  # of the first integration of a free speed
IMBALANCE = 1e-6  # share of the mean torques that counts as balanced

Speed = float | Sequence[Sequence[float]] | str
"""Speed of a transient: rpm, rows of (s, rpm), or "free"."""


def transient(
    train: DriveTrain,
    *,
    seconds: float,
    speed: Speed,
    events: str | Sequence[str] = (),
    start: str | SteadyState | Response | Array | None = None,
    rpm: float | None = None,
    record: float | None = None,
    refine: int = 1,
    progress: Callable[[float], object] | None = None,
) -> Transient:
    """Motion of a drive train in time, while its speed changes or events disturb it.

    The mean rotation turns at the given speed, or as its mean torques drive it; torques
    follow its angle and are those of its momentary speed. Vibration about it, ``M x'' +
    B x' + K x + D^T f = q``, is marched by exponential steps of fourth order, exact for
    the linear train.

    Parameters
    ----------
    train : DriveTrain
        Loss factors damp each mode at its own frequency, and a note says so.
    seconds : float
        Duration in s.
    speed : float, rows of (s, rpm) or "free"
        Speed of the reference rotor: constant, linear between rows and constant after
        the last one, or from ``rpm`` on as the torques of the excitation, of loads by
        their laws over the speed and of events drive it.
    events : names of events and sequences of the scene
    start : "steady", "rest", SteadyState, Response or array ``(2S,)``
        Motion at 0 s. "steady": the steady state of the first speed (default, unless
        that is 0 rpm); "rest": no vibration, the links without torque; or
        displacements in m and velocities in m/s of the disks.
    rpm : float, optional
        First speed of a free one.
    record : float, optional
        Instants to keep in a second, at least; default: every step.
    refine : int
        Factor by which steps are shorter than usual.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    Transient

    Raises
    ------
    SceneError
        A speed below 0 or above 1e6 rpm, rows that are not increasing, mean torques
        that no load balances, free speed with a load that has no law; an event or a
        sequence that there is not.
    TypeError
        Under ``jit`` or ``vmap``; ``grad`` and ``jvp`` are fine.

    Notes
    -----
    At a given speed loads take the power that accelerates the train from theirs. The
    torques of inertia are those of the momentary speed; their part in proportion to
    the angular acceleration is left out, as is what vibration takes from a free
    rotation. Derivatives are those of the steps, which stand still; by the begin of an
    event there are some where its torque does not jump.

    Examples
    --------
    >>> import jaxhb
    >>> run_up = jaxhb.transient(
    ...     jaxhb.load_scene("spur_pair"), seconds=0.1, speed=[(0, 1000), (0.1, 1500)]
    ... )
    >>> float(run_up.rpm[-1])
    1500.0
    """
    (values,) = concrete(train)
    if traced(values):
        raise TypeError(
            "transient depends on values, so jit and vmap cannot trace it: call it"
            " outside; jax.grad and jax.jvp of it work"
        )
    listed = occurrences(values, events)
    refuse_unsupported(values.topology, listed)
    refuse_moving_jumps(train, listed)
    if isinstance(speed, str):
        plan = free_plan(values, seconds, speed, rpm, listed)
    else:
        table = speed_table(seconds, speed, rpm)
        _check_balance(values, table)
        plan = Plan(table, course(values, listed, table), free=False)
    equations = TransientEquations.of(train, values, plan.course)
    steps = _grid(equations, plan, seconds, refine)
    marching, readings = equations.marching(plan, steps)
    blocks = blocks_of(train, plan, steps, marching)
    if marching.disturbance is not None:
        marching = _with_start_angles(marching, plan.course, steps, blocks)
    state = equations.begin(start, plan.table)
    recording = _Recording.of(blocks, record, len(equations.space.coordinates))
    marched = _march(marching, state, blocks, recording, progress)
    return _result(train, blocks, recording, marched, readings, equations.notes)


def speed_table(seconds: float, speed: Speed, rpm: float | None) -> SpeedTable:
    """The :class:`SpeedTable` of a speed as it is given."""
    _check_seconds(seconds)
    if rpm is not None:
        raise SceneError(
            'transient: rpm is the first speed of speed="free": leave it out.'
        )
    if np.ndim(speed) == 0:
        rows = np.array([[0.0, speed], [seconds, speed]], dtype=float)
    else:
        rows = np.array(speed, dtype=float)
    if rows.ndim != 2 or rows.shape[1] != 2:
        raise SceneError(
            "transient: speed must be rows of (s, rpm), as [(0, 60), (9, 120)]."
        )
    for before, after in zip(rows[:-1, 0], rows[1:, 0], strict=True):
        if not after > before:
            raise SceneError(
                f"transient: the row of speed at {after:g} s follows that at"
                f" {before:g} s: times must increase."
            )
    for time, value in rows:
        if not (np.isfinite(value) and 0 <= value <= HIGHEST_RPM):
            raise SceneError(
                f"transient: the speed at {time:g} s is {value:g} rpm, must be from 0"
                f" to {HIGHEST_RPM:.0f} rpm: no train turns backwards."
            )
    if rows[0, 0] < 0:
        raise SceneError(
            f"transient: the first row of speed is at {rows[0, 0]:g} s, must be at 0 s"
            " or later."
        )
    if rows[0, 0] > 0:
        rows = np.concatenate([[[0.0, rows[0, 1]]], rows])
    if rows[-1, 0] < seconds:
        rows = np.concatenate([rows, [[seconds, rows[-1, 1]]]])
    whole = SpeedTable(rows[:, 0], rows[:, 1])
    inside = rows[:, 0] < seconds
    times = np.append(rows[inside, 0], seconds)
    table = SpeedTable(times, np.asarray(whole.speed(times)))
    if not table.rpm.any():
        raise SceneError("transient: the speed is 0 rpm throughout: nothing turns.")
    return table


def _check_seconds(seconds: float) -> None:
    """Refuse a duration that is none."""
    if not (np.isfinite(seconds) and seconds > 0):
        raise SceneError(
            f"transient: seconds is {seconds:g}, must be greater than 0 s."
        )


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
    _check_seconds(seconds)
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
    mean = mean_rotation(values, plan.course, np.array([0.0, highest]))
    mode = plan.course.mode(steps.begin)
    rotation = rotated(mean, rpm, steps.borders, mode, plan.course)
    speeds = np.asarray(rotation.omega) * (30 / np.pi)
    title = values.topology.title
    if not np.all(np.isfinite(speeds)) or speeds.max() > 0.99 * highest:
        time = steps.borders[np.argmax(~(speeds <= 0.99 * highest))]
        raise SceneError(
            f"{title}: at free speed the train runs away: {0.99 * highest:.5g} rpm are"
            f" passed after {time:.3g} s. Correct the mean torques or the laws of"
            " loads."
        )
    if speeds.min() < 0:
        time = steps.borders[np.argmax(speeds < 0)]
        raise SceneError(
            f"{title}: at free speed the train stops after {time:.3g} s. Ask for fewer"
            " seconds, or correct the mean torques or the laws of loads."
        )
    table = SpeedTable(steps.borders, speeds)
    return Plan(table, course(values, plan.course.listed, table), free=True)


def known_speeds(train: DriveTrain) -> list[float]:
    """Speeds in rpm of the reference rotor at which torques and loads are given."""
    numbers = [*excitation.speeds(train)]
    loads = train.loads
    if loads.rated_rpm is not None:
        numbers += np.asarray(loads.rated_rpm).tolist()
    if loads.over_rpm is not None:
        numbers += np.asarray(loads.over_rpm)[..., 0].ravel().tolist()
    return [float(number) for number in numbers if np.isfinite(number)]


def mean_rotation(train: DriveTrain, plan: Course, span: np.ndarray) -> MeanRotation:
    """The :class:`MeanRotation` of a train between two speeds ``(2,)`` rpm."""
    ratio = speed_ratios(train)[np.array(train.topology.rotor, dtype=int)]
    harmonics = 1
    table = torques.torque_table(
        plan.states(train),
        plan.idle_states(train),
        torques.panels(concrete(train)[0], float(span[0]), float(span[1])),
        harmonics,
        free=True,
    )
    return MeanRotation(
        table=table,
        ratios=ratio[torques.excited_disks(train)],
        event_ratios=ratio[plan.torque_disks],
        inertia=torques.accelerated_inertia(train),
        disturbance=disturbance_of(train, plan),
    )


def rotated(
    mean: MeanRotation,
    rpm: float,
    borders: np.ndarray,
    mode: np.ndarray,
    plan: Course,
) -> Rotation:
    """The :class:`Rotation` between borders of blocks ``(B + 1,)`` s."""
    count = len(mode)
    # Few lengths, so that few programs are compiled
    room = 1 << int(np.ceil(np.log2(count)))
    longer = np.append(borders, np.full(room - count, borders[-1]))
    modes = np.append(mode, np.full(room - count, mode[-1]))
    begins_at = np.searchsorted(borders, plan.torque_begins - 1e-9)
    rotation = free_rotation(mean, rpm * np.pi / 30, longer, modes, begins_at)
    return Rotation(
        rotation.omega[: count + 1], rotation.first[:count], rotation.last[:count]
    )


def disturbance_of(train: DriveTrain, plan: Course) -> Disturbance | None:
    """The :class:`Disturbance` of the events of a course; None of none."""
    places = plan.of_kind(*TORQUES)
    fuels = plan.of_kind("fuel")
    if not places and not fuels:
        return None
    return Disturbance(
        train=train,
        begins=begin_seconds(train, plan, places),
        start_angles=np.zeros(len(places)),
        fuel_begins=begin_seconds(train, plan, fuels),
        torques=tuple(plan.listed[place].name for place in places),
        fuels=tuple(plan.listed[place].name for place in fuels),
    )


def blocks_of(train: DriveTrain, plan: Plan, steps: Grid, marching: Marching) -> Blocks:
    """The :class:`Blocks` of a transient."""
    mode = plan.course.mode(steps.begin)
    if not plan.free:
        return blocks_of_table(steps, plan.table, mode)
    ratio = speed_ratios(train)[np.array(train.topology.rotor, dtype=int)]
    mean = MeanRotation(
        table=marching.torques,
        ratios=ratio[torques.excited_disks(train)],
        event_ratios=ratio[plan.course.torque_disks],
        inertia=torques.accelerated_inertia(train),
        disturbance=marching.disturbance,
    )
    rpm = float(plan.table.rpm[0])
    rotation = rotated(mean, rpm, steps.borders, mode, plan.course)
    if not traced(rotation):
        rotation = jax.tree.map(np.asarray, rotation)
    return blocks_of_rates(steps, rotation.omega, rotation.first, rotation.last, mode)


def _with_start_angles(
    marching: Marching, plan: Course, steps: Grid, blocks: Blocks
) -> Marching:
    """The Marching whose events count from the angle of the border at which they
    begin.
    """
    disturbance = marching.disturbance
    assert disturbance is not None  # there are events
    begins_at = np.searchsorted(steps.borders, plan.torque_begins - 1e-9)
    reached = begins_at < len(steps.begin)
    xp = namespace(blocks)
    angles = xp.where(reached, blocks.angle[np.where(reached, begins_at, 0)], np.inf)
    begun = dataclasses.replace(disturbance, start_angles=angles)
    return dataclasses.replace(marching, disturbance=begun)


def _check_balance(train: DriveTrain, table: SpeedTable) -> None:
    """Refuse a train that floats where no load takes its mean torques or those that
    accelerate it.
    """
    topology = train.topology
    if topology.ground_disk or topology.load_disk:
        return
    if np.ptp(table.rpm):
        raise SceneError(
            f"{topology.title}: the speed changes, and there is no load and no ground"
            " that takes the torque of the acceleration: add a [[load]]."
        )
    rpm = float(table.rpm[0])
    torque, _, imbalance = excitation.excitation(train, rpm, 1)
    largest = np.abs(torque[:, 0]).max(initial=0.0)
    if abs(float(imbalance)) > IMBALANCE * largest:
        raise SceneError(
            f"{topology.title}: at {rpm:g} rpm a mean torque of"
            f" {float(imbalance):.4g} N m is left that nothing balances: add a [[load]]"
            " or correct the mean torques."
        )


def _grid(
    equations: TransientEquations, plan: Plan, seconds: float, refine: int
) -> Grid:
    """The :class:`Grid` of the steps."""
    values = equations.values
    title = values.topology.title
    if not (isinstance(refine, int) and refine >= 1):
        raise SceneError(
            f"transient: refine is {refine!r}, must be a whole number of at least 1."
        )
    table = plan.table
    fastest = values.topology.cycle_frequency(float(table.rpm.max())) / (2 * np.pi)
    wave = fastest * excitation.highest_harmonic(values)
    wave = max(wave, highest_event_hz(values, plan.course))
    of_teeth = STEPS_PER_MODE_PERIOD * equations.highest_hz
    rate = max(STEPS_PER_WAVE * wave, of_teeth) * refine
    if rate * seconds > MOST_STEPS:
        raise SceneError(
            f"{title}: {seconds:g} s take {rate * seconds:.3g} steps of {1 / rate:.3g}"
            f" s, and at most {MOST_STEPS:.3g} are taken: ask for a shorter time."
        )
    kinks = torques.kinks_between(values, table.rpm.min(), table.rpm.max())
    corners = [*event_corners(values, plan.course, table, seconds)]
    corners += [time for rpm in kinks for time in table.times_of_speed(rpm)]
    corners += plan.course.changes.tolist()
    if not plan.free:
        corners += table.seconds.tolist()
    return grid(seconds, corners, 1 / rate)


def highest_event_hz(train: DriveTrain, plan: Course) -> float:
    """Highest frequency in Hz of decaying torques."""
    numbers: Any = train.events
    highest = 0.0
    for place in plan.of_kind("decaying"):
        index = plan.listed[place].event.index
        rows = plan.listed[place].event.seat.rows
        highest = max(highest, float(np.max(numbers.decaying[index, :rows, 2])))
    return highest


@dataclass(frozen=True)
class TransientEquations:
    """Equations of a train as a transient marches them; ``values`` is the train with
    concrete numbers, ``space`` that in pairs of the host, or dense where the train is
    traced.
    """

    train: DriveTrain
    values: DriveTrain
    system: System
    space: ForcedSpace
    highest_hz: float
    notes: tuple[str, ...]

    @classmethod
    def of(
        cls, train: DriveTrain, values: DriveTrain, plan: Course
    ) -> TransientEquations:
        """The equations of a train."""
        topology = train.topology
        if topology.n_disks > MOST_DISKS:
            raise SceneError(
                f"{topology.title}: a transient takes trains of at most {MOST_DISKS}"
                f" disks, and this one has {topology.n_disks}."
            )
        at_hand = Equations(values)
        system = chain.assemble(train)
        meshes = law_meshes(train)
        lossy = bool(np.any(at_hand.system.loss))
        if lossy and traced(train):
            raise SceneError(
                f"{topology.title}: derivatives of a transient take no loss factors:"
                " apply train.with_viscous_damping(hz=...)."
            )
        parts: Partition = partition(
            at_hand.system,
            at_hand.meshes,
            topology.disk_names,
            topology.link_names,
            lossy=True,
        )
        frequency = topology.cycle_frequency(1000.0)
        damping = loss_damping(at_hand.system) if lossy else 0.0
        dense = state_space(system, meshes, frequency, parts, damping)
        every = all_meshes(train)
        columns = torques.load_columns(train, system, every, plan.torque_disks)
        space = forced_space(system, parts, dense, columns)
        if not traced(train):
            space = in_pairs(space, _free_rotation(train, system, space))
        notes: tuple[str, ...] = ()
        if lossy:
            notes = (
                "loss factors damp each mode at its own frequency, and are no part of"
                " the torques",
            )
        highest = at_hand.highest_hz if len(at_hand.own) else 0.0
        return cls(train, values, system, space, highest, notes)

    @property
    def follows_loads(self) -> bool:
        """Whether disks without inertia follow their loads at once."""
        return bool(np.any(self.values.disks.inertia == 0))

    def marching(self, plan: Plan, steps: Grid) -> tuple[Marching, Readings]:
        """The :class:`Marching` and the :class:`Readings`."""
        train = self.train
        topology = train.topology
        xp = namespace(train)
        meshes = law_meshes(train)
        harmonics = excitation.listed_harmonic(topology)
        weights = [step_weights(self.space, h) for h in steps.lengths]
        stacked: StepWeights = jax.tree.map(lambda *rows: xp.stack(rows), *weights)
        lowest = float(plan.table.rpm.min())
        highest = float(plan.table.rpm.max())
        every = all_meshes(train)
        errors = None
        if every.error is not None:
            errors = Errors(
                every.error, every.law.stiffness, every.viscous, topology.law_index
            )
        marching = Marching(
            weights=stacked,
            observation=self.space.observation,
            law=meshes.law,
            viscous=meshes.viscous,
            contact_damping=meshes.contact_damping,
            variation=meshes.variation,
            errors=errors,
            torques=torques.torque_table(
                plan.course.states(train),
                plan.course.idle_states(train),
                torques.panels(self.values, lowest, highest),
                harmonics,
                free=plan.free,
            ),
            disturbance=disturbance_of(train, plan.course),
            revolutions=float(topology.revolutions_per_cycle),
            keeps_loads=self.follows_loads,
        )
        system = self.system
        disks = topology.n_disks
        at_hand = Equations(self.values)
        rotor = np.array(topology.rotor, dtype=int)
        through = self.space.through
        if not self.follows_loads:
            through = through[:, :0]
        readings = Readings(
            displacement=self.space.motion[:disks],
            velocity=self.space.motion[disks:],
            displacement_of_loads=through[:disks],
            velocity_of_loads=through[disks:],
            radius=system.radius,
            ratio=speed_ratios(train)[rotor],
            ends=system.radius[system.tree.end_a],
            bend=system.incidence().T,
            stiffness=system.stiffness,
            viscous=system.viscous,
            meshes=meshes,
            beside=at_hand.beside,
        )
        return marching, readings

    def begin(self, start: Any, table: SpeedTable) -> Array:
        """State ``(n,)`` of the motion at 0 s."""
        first = float(table.rpm[0])
        disks = self.train.topology.n_disks
        if start is None:
            start = "steady" if first > 0 else "rest"
        if isinstance(start, str) and start == "steady":
            if not first > 0:
                raise SceneError(
                    'transient: start is "steady", and the first speed is 0 rpm: start'
                    ' from "rest", or from a speed above 0.'
                )
            start = steady_state(self.values, rpm=first)
            if not start.known:
                raise SceneError(
                    f"transient: the steady motion at {first:g} rpm is unknown:"
                    f' {" ".join(start.notes)}: start from "rest".'
                )
        if isinstance(start, str):
            if start != "rest":
                raise SceneError(
                    f'transient: start is {start!r}: give "steady", "rest" or a motion.'
                )
            return 0 * self.space.coordinates[:, 0]
        if isinstance(start, SteadyState | Response):
            motion = motion_of(self.values, start)
        else:
            motion = start
        if np.shape(motion) != (2 * disks,):
            raise SceneError(
                f"transient: start has the shape {np.shape(motion)}, must be"
                f" ({2 * disks},): displacements and velocities of {disks} disks."
            )
        return self.space.coordinates @ motion


def _free_rotation(
    train: DriveTrain, system: System, space: ForcedSpace
) -> FreeRotation | None:
    """The :class:`FreeRotation` of a train that no ground holds and nothing brakes."""
    rigid = rigid_shape(train, system.radius)
    mass = np.asarray(system.mass * rigid)
    coordinates = np.asarray(space.coordinates)
    motion = np.asarray(space.motion)
    braked = np.any(system.damping != 0) or np.any(system.ground != 0)
    if braked:
        return None
    disks = len(rigid)
    zero = 0 * rigid
    inertia = mass @ rigid
    return FreeRotation(
        angle=coordinates @ np.concatenate([rigid, zero]),
        speed=coordinates @ np.concatenate([zero, rigid]),
        angle_row=mass @ motion[:disks] / inertia,
        speed_row=mass @ motion[disks:] / inertia,
    )


@dataclass(frozen=True)
class _Recording:
    """Every ``stride``-th step of a block that is kept."""

    stride: int

    @classmethod
    def of(cls, blocks: Blocks, record: float | None, states: int) -> _Recording:
        """The strides for ``record`` instants in a second, and for the memory."""
        stride = 1
        longest = float(np.max(blocks.step))
        while stride < STEPS and record and 2 * stride * longest * record <= 1:
            stride *= 2
        size = 8 * (states + 32) * STEPS * len(blocks.begin)
        while stride < STEPS and size / stride > MEMORY:
            stride *= 2
        return cls(stride)

    @property
    def places(self) -> np.ndarray:
        """Steps of a block that are kept, the last among them."""
        return np.arange(self.stride - 1, STEPS, self.stride)


def _march(
    marching: Marching,
    state: Array,
    blocks: Blocks,
    recording: _Recording,
    progress: Callable[[float], object] | None,
) -> Marched:
    """March through all blocks, chunk by chunk."""
    count = len(blocks.begin)
    first_block = jax.tree.map(lambda values: values[0], blocks)
    instants = _Instants(first_instant(marching, state, first_block), recording, count)
    # Derivatives backwards keep the state at the begin of every part alone.
    marched_part = jax.checkpoint(march) if traced(marching, state) else march
    for first in range(0, count, CHUNK):
        part = jax.tree.map(lambda values: values[first : first + CHUNK], blocks)  # noqa: B023
        state, marched = marched_part(marching, state, padded(part, CHUNK))
        instants.add(marched, len(part.begin))
        if progress is not None:
            progress(min(first + CHUNK, count) / count)
    return instants.marched


class _Instants:
    """Instants that are kept, one after another: the rows of ``count`` blocks after the
    first one.
    """

    def __init__(self, begin: Marched, recording: _Recording, count: int):
        self._recording = recording
        self._traced = traced(begin)
        self._parts = [begin]
        self._filled = 1
        if not self._traced:
            rows = 1 + count * len(recording.places)
            self._arrays = jax.tree.map(
                lambda values: np.empty((rows, values.shape[-1])), begin
            )
            self._fill(jax.tree.map(np.asarray, begin), 0)

    def _fill(self, marched: Marched, at: int) -> None:
        """Write rows ``(blocks, steps, ...)`` from the row ``at`` on."""
        for array, values in zip(
            jax.tree.leaves(self._arrays), jax.tree.leaves(marched), strict=True
        ):
            rows = values.shape[0] * values.shape[1]
            array[at : at + rows] = values.reshape(rows, values.shape[2])

    def add(self, marched: Marched, size: int) -> None:
        """Keep the steps of the first ``size`` of some blocks."""
        places = self._recording.places
        if self._traced:
            self._parts.append(
                jax.tree.map(lambda values: values[:size, places], marched)
            )
            return
        on_host = jax.tree.map(
            lambda values: np.asarray(values)[:size][:, places], marched
        )
        self._fill(on_host, self._filled)
        self._filled += size * len(places)

    @property
    def marched(self) -> Marched:
        """Rows ``(n, ...)`` of all instants."""
        if not self._traced:
            return self._arrays

        def joined(*parts: Array) -> Array:
            flat = [part.reshape(-1, part.shape[2]) for part in parts if part.size]
            shape = (self._filled, parts[0].shape[2])
            return jnp.concatenate(flat) if flat else jnp.zeros(shape)

        return jax.tree.map(joined, *self._parts)


def _result(
    train: DriveTrain,
    blocks: Blocks,
    recording: _Recording,
    marched: Marched,
    readings: Readings,
    notes: tuple[str, ...],
) -> Transient:
    """The :class:`Transient` of the steps that were kept."""
    xp = namespace(blocks)
    shares = (recording.places + 1) / STEPS
    after = blocks.begin[:, None] + blocks.duration[:, None] * shares
    start = np.zeros(1)

    def along(first: Array, rest: Array) -> Array:
        return xp.concatenate([xp.ravel(first)[:1], xp.ravel(rest)])

    return Transient(
        topology=train.topology,
        time=along(blocks.begin[:1], after),
        rpm=along(blocks.speeds(start), blocks.speeds(shares)) * (30 / np.pi),
        angle=along(blocks.angles(start), blocks.angles(shares)),
        states=marched.state,
        loads=marched.loads,
        teeth=marched.teeth,
        readings=readings,
        notes=notes,
    )

"""Transients: run-ups and run-downs, and events at a steady mean speed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array, concrete, namespace, traced
from jaxhb._program import Program
from jaxhb.elements.sentences import SceneError
from jaxhb.linear.mesh_modes import STRAINED
from jaxhb.linear.modal import natural_frequencies
from jaxhb.results.response import Response
from jaxhb.results.steady import SteadyState
from jaxhb.train import excitation
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import main_speed
from jaxhb.train.varying import at_speed
from jaxhb.transients import torques
from jaxhb.transients.course import (
    Course,
    course,
    event_corners,
    occurrences,
    refuse_clutches,
    refuse_moving_jumps,
)
from jaxhb.transients.equations import TransientEquations
from jaxhb.transients.free_speed import Plan, free_blocks, free_plan, mean_rotation
from jaxhb.transients.march import Marched, Marching, first_instant, march
from jaxhb.transients.motion import Readings, States, Transient
from jaxhb.transients.timeline import (
    STEPS,
    Blocks,
    Grid,
    SpeedTable,
    blocks_of_table,
    grid,
    padded,
    speed_table,
)

# Steps per period of the highest harmonic of the excitation at the highest speed and of
# the highest line, and of the highest mode that teeth notice.
STEPS_PER_WAVE = 32
STEPS_PER_MODE_PERIOD = 8
CHUNK = 64  # blocks of a program
MOST_STEPS = 2**26
MEMORY = 2**31  # B of states
# Modes above do not ring noticeably after a torque that jumps.
HIGHEST_RINGING_HZ = 500.0
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
    start : "steady", "rest", "open", SteadyState, Response or array ``(2S,)``
        Motion at 0 s. "steady": the steady state of the first speed (default, unless
        that is 0 rpm), of a train that is not linear without its lines at fixed
        frequencies, and a note says so; "rest": no vibration, the links without torque;
        "open": the same, and what hangs on the reference rotor by clutches of events
        alone stands still; or displacements in m and velocities in m/s of the disks.
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
        Ctrl-C ends it early: ``interrupted`` is then True.

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
    At a given speed loads take the power that accelerates the train from theirs;
    without loads each disk is accelerated by itself, and a note says so. The torques of
    inertia are those of the momentary speed; their part in proportion to the angular
    acceleration is left out, as is what vibration takes from a free rotation.
    Derivatives are those of the steps, which stand still; by the begin of an event
    there are some where its torque does not jump.

    Examples
    --------
    >>> import jaxhb
    >>> run_up = jaxhb.transient(
    ...     jaxhb.load_scene("spur_pair"), seconds=0.1, speed=[(0, 1000), (0.1, 1500)]
    ... )
    >>> round(float(run_up.rpm[-1]), 6)
    1500.0
    """
    return transient_in_steps(
        train,
        StepRate(),
        seconds=seconds,
        speed=speed,
        events=events,
        start=start,
        rpm=rpm,
        record=record,
        refine=refine,
        progress=progress,
    )


class StepRate:
    """Steps in a second that transients of trains alike share, so that they have the
    same steps and programs: those of the first one and some to ``spare``, a share,
    until one needs more.
    """

    def __init__(self, spare: float = 0.0):
        self._spare = spare
        self._steps = 0.0

    def at_least(self, needed: float) -> float:
        """Steps in a second for a transient that needs so many."""
        if needed > self._steps:
            self._steps = (1 + self._spare) * needed
        return self._steps


def transient_in_steps(
    train: DriveTrain,
    step_rate: StepRate,
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
    """The :func:`transient` in steps by a :class:`StepRate`."""
    (values,) = concrete(train)
    if traced(values):
        raise TypeError(
            "transient depends on values, so jit and vmap cannot trace it: call it"
            " outside; jax.grad and jax.jvp of it work"
        )
    listed = occurrences(values, events)
    refuse_clutches(values.topology, listed)
    refuse_moving_jumps(train, listed)
    if not (isinstance(refine, int) and refine >= 1):
        raise SceneError(
            f"transient: refine is {refine!r}, must be a whole number of at least 1."
        )
    if isinstance(speed, str):
        plan = free_plan(values, seconds, speed, rpm, listed, refine)
    else:
        table = speed_table(seconds, speed, rpm)
        _check_balance(values, table)
        plan = Plan(table, course(values, listed, table), free=False)
    equations = TransientEquations.of(train, values, plan)
    steps = _grid(equations, plan, seconds, refine, step_rate)
    prepared = equations.set_up(plan, steps)
    marching = prepared.marching
    blocks = blocks_of(train, plan, steps, marching)
    if marching.disturbance is not None:
        marching = _with_start_angles(marching, plan.course, steps, blocks)
    state = equations.begin(prepared.coordinates, start, plan)
    on_start = equations.notes_on_start(start, plan)
    notes = (*equations.notes, *plan.notes, *on_start)
    recording = _Recording.of(blocks, record, len(prepared.coordinates))
    instants = _march(marching, state, blocks, recording, progress)
    return _result(train, blocks, recording, instants, prepared.readings, notes)


def blocks_of(train: DriveTrain, plan: Plan, steps: Grid, marching: Marching) -> Blocks:
    """The :class:`Blocks` of a transient."""
    if not plan.free:
        return blocks_of_table(steps, plan.table, plan.course.mode(steps.begin))
    mean = mean_rotation(train, plan.course, marching.torques, marching.disturbance)
    return free_blocks(mean, float(plan.table.rpm[0]), steps, plan.course)


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
    """Refuse a train that floats where nothing takes its mean torques."""
    topology = train.topology
    if topology.ground_disk or topology.load_disk:
        return
    rpm = float(table.rpm[0])
    torque, _, imbalance = excitation.excitation(train, rpm, 1, beside_lines=True)
    largest = np.abs(torque[:, 0]).max(initial=0.0)
    if abs(float(imbalance)) > IMBALANCE * largest:
        raise SceneError(
            f"{topology.title}: at {rpm:g} rpm a mean torque of"
            f" {float(imbalance):.4g} N m is left that nothing balances: add a [[load]]"
            " or correct the mean torques."
        )


def _grid(
    equations: TransientEquations,
    plan: Plan,
    seconds: float,
    refine: int,
    step_rate: StepRate,
) -> Grid:
    """The :class:`Grid` of the steps."""
    values = equations.values
    title = values.topology.title
    table = plan.table
    fastest = values.topology.cycle_frequency(float(table.rpm.max())) / (2 * np.pi)
    wave = fastest * excitation.highest_harmonic(values, beside_lines=True)
    lines_hz, _ = excitation.lines_at(values, float(table.rpm.max()))
    wave = max(wave, highest_event_hz(values, plan.course), *lines_hz.tolist())
    modes = max(equations.highest_hz, _highest_mode_hz(values, plan.course))
    needed = max(STEPS_PER_WAVE * wave, STEPS_PER_MODE_PERIOD * modes) * refine
    rate = step_rate.at_least(needed)
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


def _highest_mode_hz(train: DriveTrain, plan: Course) -> float:
    """Frequency in Hz of the highest mode that has to be resolved as clutches strain
    it, or as torques that jump let it ring; 0 where nothing does.
    """
    clutches = plan.clutch_links(train.topology)
    jumps = plan.of_kind("step", "table", "pulse", "decaying", "ice")
    if not (len(clutches) or jumps):
        return 0.0
    modes = natural_frequencies(at_speed(train, float(main_speed(train))))
    hz = modes.frequencies_hz
    strained = (modes.strain_share[:, clutches] > STRAINED).any(axis=1)
    ringing = np.zeros(len(hz), dtype=bool)
    if jumps:
        ringing = hz <= HIGHEST_RINGING_HZ
    return float(np.max(hz[strained | ringing], initial=0.0))


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
) -> _Instants:
    """March through all blocks, chunk by chunk; Ctrl-C ends it."""
    count = len(blocks.begin)
    first_block = jax.tree.map(lambda values: values[0], blocks)
    instant, begin = first_instant(marching, state, first_block)
    instants = _Instants(begin, recording, count, traced(marching, state, blocks))
    marched_part: Callable = partial(march, stride=recording.stride)
    if traced(marching, state, blocks):
        # Derivatives backwards store the state at the begin of every part alone.
        marched_part = jax.checkpoint(marched_part)
    try:
        for first in range(0, count, CHUNK):
            part = _part(blocks, first)
            instant, marched = marched_part(marching, instant, padded(part, CHUNK))
            instants.add(marched, len(part.begin))
            if progress is not None:
                progress(min(first + CHUNK, count) / count)
    except KeyboardInterrupt:
        if not instants.blocks or traced(marching, state, blocks):
            raise
    return instants


def _part(blocks: Blocks, first: int) -> Blocks:
    """The blocks of a program from the ``first`` one on."""
    return jax.tree.map(lambda values: values[first : first + CHUNK], blocks)


class _Instants:
    """Instants in parts, one after another: the rows of ``count`` blocks after the
    first one.
    """

    def __init__(self, begin: Marched, recording: _Recording, count: int, traced: bool):
        self._recording = recording
        self._traced = traced
        self._parts: list[Marched] = []
        self.count = count
        self.blocks = -1
        self.add(begin, 1)

    def add(self, marched: Marched, size: int) -> None:
        """Append the steps of the first ``size`` of some blocks."""
        if not self._traced:
            # Views of what the program has left: a copy takes as long as the march.
            marched = jax.tree.map(lambda rows: np.asarray(rows)[:size], marched)
        self._parts.append(marched)
        self.blocks += size

    @property
    def marched(self) -> Joined:
        """Rows ``(n, ...)`` of all instants."""
        parts = tuple(self._parts)
        if self._traced:
            return joined(parts, 1 + self.blocks * len(self._recording.places))
        states = tuple(_rows(part.state) for part in parts)
        loads = [_rows(part.loads) for part in parts]
        teeth = [_rows(part.teeth) for part in parts]
        return Joined(States(states), np.concatenate(loads), np.concatenate(teeth))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Joined:
    """Numbers of all n instants: states, loads ``(n, C)`` and teeth ``(n, W)``, as in
    :class:`~jaxhb.transients.march.Marched`.
    """

    states: States
    loads: Array
    teeth: Array


def _rows(values: Array) -> Array:
    """Rows ``(n, ...)`` of blocks of steps."""
    return values.reshape(values.shape[0] * values.shape[1], values.shape[2])


@partial(Program, static_argnames="count")
def joined(parts: tuple[Marched, ...], count: int) -> Joined:
    """The first ``count`` instants of some parts."""

    def rows(*values: Array) -> Array:
        return jnp.concatenate([_rows(part) for part in values])[:count]

    whole = jax.tree.map(rows, *parts)
    return Joined(States((whole.state,)), whole.loads, whole.teeth)


def _result(
    train: DriveTrain,
    blocks: Blocks,
    recording: _Recording,
    instants: _Instants,
    readings: Readings,
    notes: tuple[str, ...],
) -> Transient:
    """The :class:`Transient` of the steps that were kept."""
    xp = namespace(blocks)
    marched = instants.marched
    interrupted = instants.blocks < instants.count
    blocks = jax.tree.map(lambda values: values[: instants.blocks], blocks)
    if recording.stride > 1:
        notes += (
            f"one of {recording.stride} steps is kept: peaks between them are not seen",
        )
    shares = (recording.places + 1) / STEPS
    after = blocks.begin[:, None] + blocks.duration[:, None] * shares
    start = np.zeros(1)

    def along(first: Array, rest: Array) -> Array:
        return xp.concatenate([xp.ravel(first)[:1], xp.ravel(rest)])

    return Transient(
        topology=train.topology,
        train=train,
        time=along(blocks.begin[:1], after),
        rpm=along(blocks.speeds(start), blocks.speeds(shares)) * (30 / np.pi),
        angle=along(blocks.angles(start), blocks.angles(shares)),
        states=marched.states,
        loads=marched.loads,
        teeth=marched.teeth,
        readings=readings,
        notes=notes,
        interrupted=interrupted,
    )

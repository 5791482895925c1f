"""Transients: run-ups and run-downs, and events at a steady mean speed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array, concrete, namespace, traced
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
from jaxhb.transient import torques
from jaxhb.transient.march import Errors, Marched, Marching, first_instant, march
from jaxhb.transient.motion import Readings, Transient
from jaxhb.transient.timeline import (
    STEPS,
    Blocks,
    Grid,
    SpeedTable,
    blocks_of_table,
    grid,
    padded,
)
from jaxhb.transient.weights import (
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
IMBALANCE = 1e-6  # share of the mean torques that counts as balanced

Speed = float | Sequence[Sequence[float]] | str


def transient(
    train: DriveTrain,
    *,
    seconds: float,
    speed: Speed,
    start: str | SteadyState | Response | Array | None = None,
    record: float | None = None,
    refine: int = 1,
    progress: Callable[[float], object] | None = None,
) -> Transient:
    """Motion of a drive train in time, while its speed changes.

    The mean rotation turns at the given speed; torques follow its angle and are those
    of its momentary speed. Vibration about it, ``M x'' + B x' + K x + D^T f = q``, is
    marched by exponential steps of fourth order, exact for the linear train.

    Parameters
    ----------
    train : DriveTrain
        Loss factors damp each mode at its own frequency, and a note says so.
    seconds : float
        Duration in s.
    speed : float or rows of (s, rpm)
        Speed of the reference rotor: constant, or linear between rows and constant
        after the last one.
    start : "steady", "rest", SteadyState, Response or array ``(2S,)``
        Motion at 0 s. "steady": the steady state of the first speed (default, unless
        that is 0 rpm); "rest": no vibration, the links without torque; or
        displacements in m and velocities in m/s of the disks.
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
        that no load balances.

    Notes
    -----
    Loads take the power that accelerates the train from theirs. The torques of
    inertia are those of the momentary speed; their part in proportion to the angular
    acceleration is left out.

    Examples
    --------
    >>> import jaxhb
    >>> run_up = jaxhb.transient(
    ...     jaxhb.load_scene("spur_pair"), seconds=0.1, speed=[(0, 1000), (0.1, 1500)]
    ... )
    >>> float(run_up.rpm[-1])
    1500.0
    """
    table = speed_table(seconds, speed)
    (values,) = concrete(train)
    if traced(values):
        raise TypeError(
            "transient depends on values, so jit and vmap cannot trace it: call it"
            " outside; jax.grad and jax.jvp of it work"
        )
    equations = _TransientEquations.of(train, values)
    grid_of_steps = _grid(values, equations.highest_hz, table, seconds, refine)
    mode = np.zeros(len(grid_of_steps.begin), dtype=int)
    blocks = blocks_of_table(grid_of_steps, table, mode)
    ranges = torques.panels(values, table.rpm.min(), table.rpm.max())
    _check_balance(values, table)
    marching, readings = equations.marching(ranges, grid_of_steps)
    state = equations.begin(start, table, blocks)
    recorded = _Recording.of(blocks, record, len(equations.coordinates))
    marched = _march(marching, state, blocks, recorded, progress)
    return _result(train, blocks, recorded, marched, readings, equations.notes)


def speed_table(seconds: float, speed: Speed) -> SpeedTable:
    """The :class:`SpeedTable` of a speed as it is given."""
    if not (np.isfinite(seconds) and seconds > 0):
        raise SceneError(
            f"transient: seconds is {seconds:g}, must be greater than 0 s."
        )
    if isinstance(speed, str):
        raise SceneError(
            f"transient: speed is {speed!r}: give a number in rpm, or rows of (s, rpm)."
        )
    if np.ndim(speed) == 0:
        rows = np.array([[0.0, float(speed)], [seconds, float(speed)]])  # type: ignore[arg-type]
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
    for time, rpm in rows:
        if not (np.isfinite(rpm) and 0 <= rpm <= HIGHEST_RPM):
            raise SceneError(
                f"transient: the speed at {time:g} s is {rpm:g} rpm, must be from 0 to"
                f" {HIGHEST_RPM:.0f} rpm: a train that turns backwards is none."
            )
    if rows[0, 0] > 0:
        rows = np.concatenate([[[0.0, rows[0, 1]]], rows])
    if not rows[:, 1].any():
        raise SceneError("transient: the speed is 0 rpm throughout: nothing turns.")
    if rows[-1, 0] < seconds:
        rows = np.concatenate([rows, [[seconds, rows[-1, 1]]]])
    return SpeedTable(rows[:, 0], rows[:, 1])


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
            f"{topology.title}: at {rpm:g} rpm a mean torque of {float(imbalance):.4g} N"
            " m is left that nothing balances: add a [[load]] or correct the mean"
            " torques."
        )


def _grid(
    train: DriveTrain,
    highest_hz: float,
    table: SpeedTable,
    seconds: float,
    refine: int,
) -> Grid:
    """The :class:`Grid` of the steps."""
    fastest = train.topology.cycle_frequency(float(table.rpm.max())) / (2 * np.pi)
    wave = fastest * excitation.highest_harmonic(train)
    rate = max(STEPS_PER_WAVE * wave, STEPS_PER_MODE_PERIOD * highest_hz) * refine
    if rate * seconds > MOST_STEPS:
        raise SceneError(
            f"{train.topology.title}: {seconds:g} s take {rate * seconds:.3g} steps of"
            f" {1 / rate:.3g} s, and at most {MOST_STEPS:.3g} are taken: ask for a"
            " shorter time."
        )
    kinks = torques.kinks_between(train, table.rpm.min(), table.rpm.max())
    corners = [*table.seconds.tolist()]
    corners += [time for rpm in kinks for time in table.times_of_speed(rpm)]
    return grid(seconds, corners, 1 / rate)


@dataclass(frozen=True)
class _TransientEquations:
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
    def of(cls, train: DriveTrain, values: DriveTrain) -> _TransientEquations:
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
        columns = torques.load_columns(train, system, every, np.zeros(0, dtype=int))
        space = forced_space(system, parts, dense, columns)
        if not traced(train):
            space = in_pairs(space, _free_rotation(train, system, space))
        notes = ()
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

    @property
    def coordinates(self) -> Array:
        """Rows ``(n, 2S)`` of the states."""
        return self.space.coordinates

    def marching(
        self, ranges: np.ndarray, grid_of_steps: Grid
    ) -> tuple[Marching, Readings]:
        """The :class:`Marching` over panels of speed ``(P, 2)`` rpm, and the
        :class:`Readings`.
        """
        train = self.train
        topology = train.topology
        xp = namespace(train)
        meshes = law_meshes(train)
        harmonics = excitation.listed_harmonic(topology)
        weights = [step_weights(self.space, h) for h in grid_of_steps.lengths]
        stacked: StepWeights = jax.tree.map(lambda *rows: xp.stack(rows), *weights)
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
            torques=torques.torque_table([train], ranges, harmonics),
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

    def begin(self, start: Any, table: SpeedTable, blocks: Blocks) -> Array:
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
            return 0 * self.coordinates[:, 0]
        if isinstance(start, SteadyState | Response):
            motion = motion_of(self.values, start)
        else:
            motion = start
        if np.shape(motion) != (2 * disks,):
            raise SceneError(
                f"transient: start has the shape {np.shape(motion)}, must be"
                f" ({2 * disks},): displacements and velocities of {disks} disks."
            )
        return self.coordinates @ motion


def _free_rotation(
    train: DriveTrain, system: System, space: ForcedSpace
) -> FreeRotation | None:
    """The :class:`FreeRotation` of a train that no ground holds and nothing brakes."""
    rigid = rigid_shape(train, system.radius)
    mass = system.mass * rigid
    braked = np.any(system.damping != 0) or np.any(system.ground != 0)
    if braked:
        return None
    disks = len(rigid)
    zero = 0 * rigid
    inertia = mass @ rigid
    return FreeRotation(
        angle=space.coordinates @ np.concatenate([rigid, zero]),
        speed=space.coordinates @ np.concatenate([zero, rigid]),
        angle_row=mass @ space.motion[:disks] / inertia,
        speed_row=mass @ space.motion[disks:] / inertia,
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

"""Equations of a train as a transient marches them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np

from jaxhb._jax import Array, Number, namespace, traced
from jaxhb._program import Program
from jaxhb.elements.sentences import SceneError
from jaxhb.equations import fourier
from jaxhb.equations.state_space import Partition, loss_damping, state_space
from jaxhb.equations.system import System
from jaxhb.linear.forced import ForcedResponse, forced_response
from jaxhb.linear.heat import fixed_temperatures
from jaxhb.results.response import Response
from jaxhb.results.steady import SteadyState
from jaxhb.solutions.solve import solve
from jaxhb.steady.classification import motion_of
from jaxhb.steady.marching import Equations
from jaxhb.steady.steady_state import steady_state
from jaxhb.train import chain, excitation
from jaxhb.train.chain import rigid_shape
from jaxhb.train.connections import breadth_first, neighbours
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.kinematics import displacement_radii, speed_ratios
from jaxhb.train.mesh_parameters import all_meshes, law_meshes
from jaxhb.train.topology import Topology
from jaxhb.train.varying import at_speed
from jaxhb.transients import torques
from jaxhb.transients.course import Course, disturbance_of
from jaxhb.transients.free_speed import Plan
from jaxhb.transients.march import Errors, Marching, Slipping, Varying
from jaxhb.transients.motion import Readings
from jaxhb.transients.timeline import Grid
from jaxhb.transients.weights import (
    ForcedSpace,
    FreeRotation,
    forced_space,
    halvings,
    in_pairs,
    stacked_weights,
)

MOST_DISKS = 600  # modes of more take minutes


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Frame:
    """Numbers of a transient that are not differentiated, and what is fixed when its
    set-up is compiled.

    rpm : the middle speed; damping ``(S, S)`` N s/m of loss factors, or 0; ranges ``(P,
    2)`` rpm of the panels of torques; lengths ``(K,)`` s of steps; parts : of the
    disks; event_disks : of the events that are torques; clutches : links with clutches;
    halved : times that A h / 2 is halved for its exponential; free : whether the speed
    is; follows_loads : whether disks without inertia follow their loads at once.
    """

    rpm: float
    damping: Number
    ranges: np.ndarray
    lengths: np.ndarray
    parts: Partition = field(metadata={"static": True})
    event_disks: tuple[int, ...] = field(metadata={"static": True})
    clutches: tuple[int, ...] = field(metadata={"static": True})
    halved: int = field(metadata={"static": True})
    free: bool = field(metadata={"static": True})
    follows_loads: bool = field(metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SetUp:
    """Numbers that the blocks of a transient share, events aside: the
    :class:`Marching`, the :class:`Readings`, and coordinates ``(n, 2S)``, states of (x,
    x').
    """

    marching: Marching
    readings: Readings
    coordinates: Array


@Program
def set_up(
    train: DriveTrain,
    states: tuple[DriveTrain, ...],
    idle_states: tuple[DriveTrain, ...],
    frame: Frame,
) -> SetUp:
    """The :class:`SetUp` of a train in the states of its cylinders, with fuel and
    without.
    """
    topology = train.topology
    frequency = topology.cycle_frequency(1000.0)
    fixed = at_speed(train, frame.rpm)
    system = chain.assemble(fixed)
    meshes = law_meshes(fixed)
    every = all_meshes(fixed)
    springs = springs_over_speed(topology)
    clutches = np.array(frame.clutches, dtype=int)
    columns = torques.load_columns(
        fixed, system, every, np.array(frame.event_disks, dtype=int)
    )
    dense = state_space(system, meshes, frequency, frame.parts, frame.damping)
    rows = springs.columns(system, clutches)
    space = forced_space(system, frame.parts, dense, columns, rows)
    if namespace(train) is np:
        space = in_pairs(space, _free_rotation(train, system, space))
    over_speed = springs.over_speed(train, frame.ranges)
    errors = None
    if every.error is not None:
        errors = Errors(
            every.error, every.law.stiffness, every.viscous, topology.law_index
        )
    marching = Marching(
        weights=stacked_weights(space, frame.lengths, frame.halved),
        observation=space.observation,
        law=meshes.law,
        viscous=meshes.viscous,
        contact_damping=meshes.contact_damping,
        variation=meshes.variation,
        errors=errors,
        varying=springs.varying(over_speed, system),
        slipping=_slipping(system, clutches),
        torques=torques.torque_table(
            states,
            idle_states,
            frame.ranges,
            excitation.listed_harmonic(topology, beside_lines=True),
            free=frame.free,
        ),
        disturbance=None,
        revolutions=float(topology.revolutions_per_cycle),
        keeps_loads=frame.follows_loads,
    )
    disks = topology.n_disks
    through = space.through if frame.follows_loads else space.through[:, :0]
    readings = Readings(
        displacement=space.motion[:disks],
        velocity=space.motion[disks:],
        displacement_of_loads=through[:disks],
        velocity_of_loads=through[disks:],
        radius=system.radius,
        ratio=speed_ratios(train)[np.array(topology.rotor, dtype=int)],
        ends=system.radius[system.tree.end_a],
        bend=system.incidence().T,
        stiffness=system.stiffness,
        viscous=system.viscous,
        meshes=meshes,
        beside=None,
        clutches=clutches,
        varying_links=springs.links,
        varying=None if over_speed is None else over_speed.of(springs.links),
    )
    return SetUp(marching, readings, space.coordinates)


@dataclass(frozen=True)
class TransientEquations:
    """Equations of a train as a transient marches them.

    values : the train with concrete numbers; at_hand : the equations of marches at the
    middle ``rpm`` of its speeds; notes : on the numbers.
    """

    train: DriveTrain
    values: DriveTrain
    at_hand: Equations
    rpm: float
    notes: tuple[str, ...]

    @classmethod
    def of(
        cls, train: DriveTrain, values: DriveTrain, plan: Plan
    ) -> TransientEquations:
        """The equations of a train."""
        topology = train.topology
        if topology.n_disks > MOST_DISKS:
            raise SceneError(
                f"{topology.title}: a transient takes trains of at most {MOST_DISKS}"
                f" disks, and this one has {topology.n_disks}."
            )
        rpm = float(plan.table.rpm.min() + plan.table.rpm.max()) / 2
        at_hand = Equations(at_speed(values, rpm))
        lossy = bool(np.any(at_hand.system.loss))
        if lossy and traced(train):
            raise SceneError(
                f"{topology.title}: derivatives of a transient take no loss factors:"
                " apply train.with_viscous_damping(hz=...)."
            )
        springs = springs_over_speed(topology)
        clutches = plan.course.clutch_links(topology)
        rows = np.asarray(springs.columns(at_hand.system, clutches))
        _refuse_at_static(topology, at_hand.parts, rows)
        notes: list[str] = []
        if lossy:
            notes.append(
                "loss factors damp each mode at its own frequency, and are no part of"
                " the torques"
            )
        notes += fixed_temperatures(values)
        if not topology.load_disk:
            notes.append(
                "no load takes the torque of an acceleration: each disk is accelerated"
                " by itself"
            )
        return cls(train, values, at_hand, rpm, tuple(notes))

    @property
    def highest_hz(self) -> float:
        """Frequency in Hz that teeth notice; 0 without teeth."""
        return self.at_hand.highest_hz if len(self.at_hand.own) else 0.0

    def set_up(self, plan: Plan, steps: Grid) -> SetUp:
        """The :class:`SetUp`, in one program where the train is traced."""
        course = plan.course
        states = tuple(course.states(self.train))
        idle_states = tuple(course.idle_states(self.train))
        prepare = set_up if traced(self.train) else set_up.function
        prepared = prepare(self.train, states, idle_states, self._frame(plan, steps))
        marching = dataclasses.replace(
            prepared.marching, disturbance=disturbance_of(self.train, course)
        )
        # Arrays of the host, which readers index by.
        readings = dataclasses.replace(
            prepared.readings,
            beside=self.at_hand.beside,
            clutches=course.clutch_links(self.values.topology),
        )
        return SetUp(marching, readings, prepared.coordinates)

    def _frame(self, plan: Plan, steps: Grid) -> Frame:
        """The :class:`Frame` of a transient."""
        at_hand = self.at_hand
        topology = self.values.topology
        frequency = topology.cycle_frequency(1000.0)
        lowest = float(plan.table.rpm.min())
        highest = float(plan.table.rpm.max())
        # Few numbers of lengths and of halvings, so that few programs are compiled
        count = len(steps.lengths)
        places = np.minimum(np.arange(1 << (count - 1).bit_length()), count - 1)
        halved = 0
        if traced(self.train):
            dense = state_space(
                at_hand.system, at_hand.meshes, frequency, at_hand.parts
            )
            longest = dense.transition * (steps.lengths.max() / 2)
            halved = 2 * -(-int(halvings(longest)) // 2)
        return Frame(
            rpm=self.rpm,
            damping=loss_damping(at_hand.system),
            ranges=torques.panels(self.values, lowest, highest),
            lengths=steps.lengths[places],
            parts=at_hand.parts,
            event_disks=tuple(plan.course.torque_disks.tolist()),
            clutches=tuple(plan.course.clutch_links(topology).tolist()),
            halved=halved,
            free=plan.free,
            follows_loads=bool(np.any(self.values.disks.inertia == 0)),
        )

    def begin(self, coordinates: Array, start: Any, plan: Plan) -> Array:
        """State ``(n,)`` of the motion at 0 s, by the ``coordinates`` of a
        :class:`SetUp`.
        """
        first = float(plan.table.rpm[0])
        disks = self.train.topology.n_disks
        if start is None:
            start = "steady" if first > 0 else "rest"
        if isinstance(start, str) and start == "steady":
            if not first > 0:
                raise SceneError(
                    'transient: start is "steady", and the first speed is 0 rpm: start'
                    ' from "rest", or from a speed above 0.'
                )
            start = self._steady(first)
        if isinstance(start, str):
            if start not in ("rest", "open"):
                raise SceneError(
                    f'transient: start is {start!r}: give "steady", "rest", "open" or a'
                    " motion."
                )
            velocity = np.zeros(disks)
            if start == "open":
                velocity = -first * (np.pi / 30) * self._behind(plan.course)
            rest = np.zeros(disks)
            return coordinates @ np.concatenate([rest, velocity])
        if isinstance(start, Response):
            motion = _motion(self.train, start)
        elif isinstance(start, SteadyState):
            motion = motion_of(self.values, start)
        else:
            motion = start
        if np.shape(motion) != (2 * disks,):
            raise SceneError(
                f"transient: start has the shape {np.shape(motion)}, must be"
                f" ({2 * disks},): displacements and velocities of {disks} disks."
            )
        return coordinates @ motion

    def _behind(self, plan: Course) -> np.ndarray:
        """Displacements ``(S,)`` m per rad of the reference rotor of the disks that
        hang on it by clutches alone, 0 of the others.
        """
        topology = self.values.topology
        clutches = plan.clutch_links(topology).tolist()
        if not clutches:
            raise SceneError(
                'transient: start is "open", and no event is a clutch: start from'
                ' "rest".'
            )
        joined = neighbours(topology.link_ends, topology.n_disks, clutches)
        turning = {disk for disk, *_ in breadth_first(joined, topology.reference_disk)}
        rigid = np.asarray(rigid_shape(self.values, displacement_radii(self.values)))
        still = [disk not in turning for disk in range(topology.n_disks)]
        return np.where(still, rigid, 0.0)

    def notes_on_start(self, start: Any, plan: Plan) -> tuple[str, ...]:
        """Notes on the motion at 0 s."""
        by_default = start is None and plan.table.rpm[0] > 0
        steady = by_default or (isinstance(start, str) and start == "steady")
        notes = []
        names = excitation.line_names(self.train.topology)
        if steady and names and not self._is_linear:
            notes.append(
                "it starts from the steady motion without the lines at fixed"
                f" frequencies of {', '.join(names)}"
            )
        if steady and plan.free:
            notes.append(
                "it starts from a steady motion, in which loads balance the power; from"
                " 0 s on they follow their laws"
            )
        return tuple(notes)

    @property
    def _is_linear(self) -> bool:
        """Whether the train is linear, of constant numbers at one speed."""
        topology = self.train.topology
        return topology.linear_in_contact and not topology.has_law.any()

    def _linear_steady(self, rpm: float) -> ForcedResponse:
        """The steady motion of a linear train at a speed, lines at fixed frequencies
        among it.
        """
        response = forced_response(self.values, rpm=rpm)
        if not response.converged:
            raise SceneError(
                f"transient: the steady motion at {rpm:g} rpm is unknown:"
                f' {response.status_name}: start from "rest".'
            )
        if traced(self.train):
            return forced_response(self.train, rpm=rpm)
        return response

    def _steady(self, rpm: float) -> SteadyState | Response:
        """The steady motion at a speed; where the train is traced as a solution of its
        equations, which has derivatives. Lines at fixed frequencies are part of it
        where the train is linear.
        """
        if excitation.line_names(self.train.topology) and self._is_linear:
            return self._linear_steady(rpm)
        state = steady_state(excitation.without_lines(self.values), rpm=rpm)
        if not state.known:
            raise SceneError(
                f"transient: the steady motion at {rpm:g} rpm is unknown:"
                f' {" ".join(state.notes)}: start from "rest".'
            )
        if not traced(self.train):
            return state
        if state.response is None:
            raise SceneError(
                f"transient: the steady motion at {rpm:g} rpm is {state.kind} and has"
                ' no derivatives: start from "rest", or give its motion.'
            )
        train = excitation.without_lines(self.train)
        if state.period > 1:
            train = train.repeated(state.period)
        return solve(train, rpm=rpm, start=state.response)


def _slipping(system: System, links: np.ndarray) -> Slipping | None:
    """The clutches of some shafts; None without any."""
    if not len(links):
        return None
    ends = system.tree.end_a[links]
    return Slipping(system.stiffness[links], system.viscous[links], system.radius[ends])


def _motion(train: DriveTrain, response: Response) -> Array:
    """Motion (x, x') ``(2S,)`` of the disks at the begin of a cycle of a response, with
    its derivatives; lines at fixed frequencies as they are at 0 s.
    """
    angles = response.angles * displacement_radii(train)[:, None]
    omega = response.topology.cycle_frequency(response.rpm)
    xp = namespace(angles)
    both = xp.concatenate([angles, fourier.derivative(angles, omega)])
    motion = fourier.sample(both, 1)[:, 0]
    if response.lines is None:
        return motion
    lines = response.lines.angles * displacement_radii(train)[:, None]
    rates = 2j * np.pi * response.lines.hz * lines
    return motion + 2 * xp.concatenate([lines, rates]).real.sum(axis=-1)


@dataclass(frozen=True)
class SpringsOverSpeed:
    """Springs whose stiffness or damping depends on the speed: links by their index,
    and disks whose ground or damping to ground does.
    """

    links: np.ndarray
    disks: np.ndarray

    def columns(self, system: System, clutches: np.ndarray) -> Array:
        """Deflections ``(S, V + C)`` per displacement of the disks, of links with
        clutches behind the springs.
        """
        xp = namespace(system)
        seats = np.eye(len(system.mass))[:, self.disks]
        varying = system.incidence(self.links)
        slipping = system.incidence(clutches)
        return xp.concatenate([varying, seats, slipping], axis=1)

    def over_speed(self, train: DriveTrain, ranges: Array) -> Varying | None:
        """Stiffness and damping of all links and disks over panels ``(P, 2)`` rpm; None
        where nothing varies.
        """
        if not train.topology.depends_on_speed:
            return None
        xp = namespace(train)
        nodes = torques.nodes_of(ranges)

        def at(rpm: Number) -> tuple[Array, Array]:
            return _springs_of(chain.assemble(train, rpm))

        both: list[Array]
        if xp is np:
            rows = [at(float(rpm)) for rpm in nodes.ravel()]
            both = [np.stack([row[k] for row in rows]) for k in (0, 1)]
        else:
            both = [*jax.vmap(at)(nodes.ravel())]
        stiffness, viscous = both
        shape = (*nodes.shape, stiffness.shape[-1])
        return Varying(
            ranges * (np.pi / 30), stiffness.reshape(shape), viscous.reshape(shape)
        )

    def varying(self, over_speed: Varying | None, system: System) -> Varying | None:
        """The :class:`Varying` beside a System; None where nothing varies."""
        if over_speed is None:
            return None
        stiffness, viscous = _springs_of(system)
        chosen = np.concatenate([self.links, len(system.stiffness) + self.disks])
        return Varying(
            over_speed.omega,
            (over_speed.stiffness - stiffness)[..., chosen],
            (over_speed.viscous - viscous)[..., chosen],
        )


def _springs_of(system: System) -> tuple[Array, Array]:
    """Stiffness N/m and damping N s/m of all links, and behind them of the grounds and
    to ground of all disks.
    """
    xp = namespace(system)
    return (
        xp.concatenate([system.stiffness, system.ground]),
        xp.concatenate([system.viscous, system.damping]),
    )


def springs_over_speed(topology: Topology) -> SpringsOverSpeed:
    """The :class:`SpringsOverSpeed` of a train; meshes that have a law are refused."""
    shafts = len(topology.shaft_names)
    meshes = len(topology.link_names) - len(topology.mesh_names)
    first = {"shaft": 0, "damper": shafts, "mesh": meshes}
    links = set(topology.order_links)
    disks = set(topology.archer_disks)
    for table, key, index, _ in topology.rpm_tables:
        if table == "mesh" and topology.has_law[index]:
            raise SceneError(
                f"{topology.title}: mesh {topology.mesh_names[index]!r} has"
                f" {key}_over_rpm, and its teeth may part: a transient takes it"
                " constant: train.with_constant_links(rpm=...)."
            )
        if table in first:
            links.add(first[table] + index)
        else:
            disks.add(topology.ground_disk[index] if table == "ground" else index)
    return SpringsOverSpeed(
        np.array(sorted(links), dtype=int), np.array(sorted(disks), dtype=int)
    )


def _refuse_at_static(topology: Topology, parts: Partition, rows: np.ndarray) -> None:
    """Refuse springs that vary with the speed beside disks without inertia and
    damping.
    """
    touched = np.any(rows != 0, axis=1)
    for disk in parts.static:
        if touched[disk]:
            raise SceneError(
                f"{topology.title}: disk {topology.disk_names[disk]!r} has no inertia,"
                " and a link at it depends on the speed: give it an inertia, or take"
                " train.with_constant_links(rpm=...)."
            )


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

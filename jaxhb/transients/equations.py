"""Equations of a train as a transient marches them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from jaxhb._jax import Array, namespace, traced
from jaxhb.elements.sentences import SceneError
from jaxhb.equations.state_space import Partition, loss_damping, partition, state_space
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
from jaxhb.transients import torques
from jaxhb.transients.course import Course, disturbance_of
from jaxhb.transients.free_speed import Plan
from jaxhb.transients.march import Errors, Marching
from jaxhb.transients.motion import Readings
from jaxhb.transients.timeline import Grid, SpeedTable
from jaxhb.transients.weights import (
    ForcedSpace,
    FreeRotation,
    StepWeights,
    forced_space,
    in_pairs,
    step_weights,
)

MOST_DISKS = 600  # modes of more take minutes


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
        notes: list[str] = []
        if lossy:
            notes.append(
                "loss factors damp each mode at its own frequency, and are no part of"
                " the torques"
            )
        if not topology.load_disk:
            notes.append(
                "no load takes the torque of an acceleration: each disk is accelerated"
                " by itself"
            )
        highest = at_hand.highest_hz if len(at_hand.own) else 0.0
        return cls(train, values, system, space, highest, tuple(notes))

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

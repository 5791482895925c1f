"""Width of the transition, and stiffness left in the gap, of meshes whose scene gives
none: from their mean loads.

Teeth have their full stiffness above the force ``c (epsilon + transition) h / 2``, and
the spring in the gap carries up to ``epsilon c h / 2``. Both are chosen small beside
the smallest mean force that the mesh has at the speeds at which the scene gives
torques. They are numbers of the train from then on: a mean torque that changes later
leaves them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb._jax import Array
from jaxhb.train import excitation
from jaxhb.train.kinematics import speed_ratios
from jaxhb.train.varying import tables_at, without_tables

if TYPE_CHECKING:
    from jaxhb.elements.elements import Mesh
    from jaxhb.equations.system import System
    from jaxhb.train.tables import Train, TrainArrays

# Shares of the mean force: at which the stiffness is full, and which the gap carries
KNEE_SHARE = 0.2
GAP_SPRING_SHARE = 0.04
TRANSITION = (0.004, 0.04)
EPSILON = (1e-4, 1e-3)
"""Smallest and largest choice. Smaller numbers cost steps in time and harmonics; teeth
with hardly a mean load are moved by their impacts, whatever the width.
"""

ANY_SPEED = 1000.0  # rpm, where no torque depends on the speed
IDLE = 1 / 3  # of a rated speed, from which on a train runs
# Up to which loads that several ways share are computed with dense matrices
DENSE_DISKS = 1000


def with_contact_law(train: Train, meshes: Sequence[Mesh]) -> Train:
    """Complete the laws of the meshes of a train where their elements ``meshes`` leave
    numbers open.
    """
    gaps = np.array(train.topology.mesh_backlash, dtype=bool)
    undecided = {
        key: (
            gaps
            & np.array(
                [not mesh.law and getattr(mesh, key) is None for mesh in meshes],
                dtype=bool,
            )
        )
        for key in ("epsilon", "transition")
    }
    if not any(rows.any() for rows in undecided.values()):
        return train
    table: Any = train.meshes
    share = _least_mean_shares(train, gaps)
    gap_spring = np.clip(GAP_SPRING_SHARE * share, EPSILON[0], EPSILON[1])
    epsilon = np.where(undecided["epsilon"], gap_spring, table.epsilon)
    width = np.clip(KNEE_SHARE * share - epsilon, TRANSITION[0], TRANSITION[1])
    transition = np.where(undecided["transition"], width, table.transition)
    return dataclasses.replace(
        train, meshes=dataclasses.replace(table, epsilon=epsilon, transition=transition)
    )


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _least_mean_shares(train: TrainArrays, gaps: np.ndarray) -> np.ndarray:
    """Smallest mean tooth force of every mesh over the speeds at which the scene gives
    torques, all teeth in contact, over its force at the flank of a gap that is filled
    with the full stiffness, ``(M,)``; ``gaps`` ``(M,)``: whether a mesh has one.
    """
    speeds = excitation.speeds(train)
    # A torque that follows a power of the speed has a point at its rated speed alone.
    for kind, numbers, _ in train.excited():
        speeds = np.append(speeds, IDLE * kind.rated_speeds(numbers))
    speeds = speeds[speeds > 0] if np.any(speeds > 0) else np.array([ANY_SPEED])
    parts = np.split(speeds, len(speeds)) if train.topology.rpm_tables else [speeds]
    shares = []
    for part in parts:
        constant = tables_at(train, part[0])
        meshes = constant.meshes
        full_force = meshes.stiffness * meshes.backlash / 2
        divisor = np.where(gaps & (full_force > 0), full_force, 1.0)
        shares.append(_least_mean_forces(constant, part) / divisor)
    return np.min(shares, axis=0)


def _least_mean_forces(train: TrainArrays, speeds: np.ndarray) -> np.ndarray:
    """Smallest mean tooth force ``(M,)`` N of every mesh over speeds."""
    # Here: it imports jax, which a train without a mesh to decide on does without.
    from jaxhb.train import chain

    system = chain.assemble(without_tables(train))
    load = _mean_torques(train, speeds).T / system.radius[:, None]
    shared = len(system.tree.loops) > 0 or len(train.topology.ground_disk) > 1
    if shared and len(load) <= DENSE_DISKS and np.all(np.isfinite(load)):
        rows, stiffness = system.springs()
        motion = np.linalg.lstsq((rows.T * stiffness) @ rows, load, rcond=None)[0]
        force: Array = system.stiffness[:, None] * system.deflections(motion)
    else:
        force = _passed_on(system, load)
    least = np.abs(force[len(train.topology.shaft_and_damper_names) :]).min(axis=-1)
    return np.nan_to_num(least, nan=0.0)


def _mean_torques(train: TrainArrays, speeds: np.ndarray) -> np.ndarray:
    """Mean torque ``(n, S)`` N m on every disk at some speeds, loads included."""
    topology = train.topology
    disks = train.topology.n_disks
    torque = excitation.mean_on_disks(train, speeds)
    if not topology.load_disk:
        return torque
    ratio = speed_ratios(train)[np.array(topology.rotor, dtype=int)]
    share = train.loads.share
    load_share = share / (share @ ratio[np.array(topology.load_disk, dtype=int)])
    return torque + excitation.on_disks(
        disks, topology.load_disk, -np.outer(torque @ ratio, load_share)
    )


def _passed_on(system: System, load: np.ndarray) -> np.ndarray:
    """Forces ``(L, n)`` N of the links of a tree, each that of the loads ``(S, n)`` N
    beyond it; 0 of links that close loops.
    """
    tree = system.tree
    remaining = load.copy()
    force = np.zeros((len(system.stiffness), load.shape[-1]))
    for position, parent in enumerate(tree.parent[:-1].tolist()):
        link = tree.link[position]
        disk = tree.node[position]
        arm_near = system.arm_a[link]
        arm_far = -system.arm_b[link]
        if not tree.from_a[position]:
            arm_near, arm_far = arm_far, arm_near
        force[link] = remaining[disk] / arm_near
        remaining[tree.node[parent]] -= arm_far * force[link]
    return force

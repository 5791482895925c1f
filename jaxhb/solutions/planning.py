"""Decisions of the host: which meshes are unknowns, where to start, how many harmonics
there are.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from jaxhb._jax import on_host, remembered
from jaxhb.balance.plan import (
    MOST_HARMONICS,
    Plan,
    Request,
    excited_harmonic,
    time_steps_for,
    time_steps_of,
)
from jaxhb.balance.program import solve_batches
from jaxhb.equations import backlash, fourier
from jaxhb.equations.backlash import MeshParameters
from jaxhb.equations.condensation import HOST_DISKS
from jaxhb.equations.system import System
from jaxhb.integration.batch import motions_in_contact
from jaxhb.linear.mesh_modes import mesh_mode_harmonics
from jaxhb.train import chain
from jaxhb.train.changes import linearised
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import listed_harmonic
from jaxhb.train.mesh_parameters import all_meshes, law_of
from jaxhb.train.varying import at_speed

LEVELS = (
    16,
    24,
    32,
    48,
    64,
    96,
    128,
    192,
    256,
    384,
    512,
    768,
    1024,
    1536,
    2048,
    3072,
    4096,
)
"""Numbers of harmonics of the cycle that are offered: each is a program."""
FEW_LEVELS = 192, 768, 1536, 4096
"""Numbers of harmonics that are offered where speeds share programs: a speed has the
same harmonics in any sweep.
"""

# How many times as many harmonics are tried next, where all levels are offered
LEVEL_RATIO = 2.0
# Where the first level lies, over the highest harmonic excited and over that of the
# highest mesh mode: below the mesh modes the truncated equations often have no solution
# near the motion.
ABOVE_EXCITATION = 2.0
ABOVE_MODES = 1.5
# Times the weakly strained modes at which the 2 N harmonics of an estimate see them
SEES_MODES = 1.2
BLIND_SHARE = 0.1  # of the tolerance that an estimate may use which does not see them
# Half peak-to-peak values of the linear force of the hardest mesh that separates, by
# which another mesh must stay loaded to be held on its flank.
HAMMERED = 2.0
COLUMNS = 4096  # harmonics of some speeds whose linear motion is found at once


def level_at_least(harmonics: float, levels: Sequence[int] = LEVELS) -> int:
    """The smallest of the levels that is not below ``harmonics``, else the highest."""
    return next((level for level in levels if level >= harmonics), levels[-1])


def next_level(harmonics: int, method: str, few_levels: bool = False) -> int | None:
    """The number of harmonics to try after ``harmonics``; None at the limit.

    A level nearer to the limit than to the one before is the limit.
    """
    most = MOST_HARMONICS[method]
    if few_levels:
        return next((level for level in FEW_LEVELS if level > harmonics), None)
    # 0.95: levels are a ratio of 1.33 or 1.5 apart, and the next one is not to be
    # missed by a little.
    least = 0.95 * LEVEL_RATIO * harmonics
    near_limit = most / math.sqrt(LEVEL_RATIO)
    higher = [level for level in LEVELS if least <= level <= near_limit]
    if higher:
        return higher[0]
    return most if harmonics < most else None


def meshes_leaving_contact(
    train: DriveTrain, forces: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the meshes that the linear motion takes off their flank, or nearly so where
    other meshes separate and hammer.

    forces : ``(n, M, samples)`` N, elastic, with all teeth in contact. Returns the
    flank ``(n, E)`` on which each backlash mesh is taken to stay (to be verified), 0
    for other meshes and for the ``springs`` of the topology; whether its motion is an
    unknown ``(n, E)``, as it leaves the flank or its stiffness varies; and whether any
    force passes through zero ``(n,)``.
    """
    gap = np.array(train.topology.mesh_backlash, dtype=bool)
    # A mesh stays on its flank where its least force exceeds that of the knee, by more
    # the harder other meshes hammer: their impacts come on top of the linear motion.
    side = np.where(forces.mean(-1) < 0, -1, 1)
    lowest = forces.min(-1, initial=np.inf)
    highest = forces.max(-1, initial=-np.inf)
    least = np.where(side < 0, -highest, lowest)
    apart = gap & (least <= 0)
    half_peak_to_peak = np.where(apart, (highest - lowest) / 2, 0.0)
    spare = HAMMERED * np.max(half_peak_to_peak, axis=-1, initial=0.0, keepdims=True)
    stays = (
        gap
        & (least > law_of(train.meshes).knee_force + spare)
        & ~train.topology.mesh_varies
    )
    flank = np.where(stays, side, 0)
    springs = [(0, 0), (0, len(train.topology.springs))]
    return (
        np.pad(flank, springs),
        train.topology.has_law & ~np.pad(stays, springs),
        apart.any(axis=-1),
    )


def first_level(excited: int, mesh_modes: float) -> int:
    """The number of harmonics to begin with: above the excitation, and above the mesh
    modes where teeth separate.
    """
    return level_at_least(max(ABOVE_EXCITATION * excited, ABOVE_MODES * mesh_modes))


def tolerance_share(harmonics: int, weak_modes: float) -> float:
    """Share of the tolerance that an estimate may use: less while modes of meshes lie
    above the 2 N harmonics that it sees.
    """
    return 1.0 if 2 * harmonics >= SEES_MODES * weak_modes else BLIND_SHARE


def all_active(train: DriveTrain, plan: Plan, request: Request) -> Plan:
    """The plan with every mesh that has backlash as an unknown, and enough harmonics
    for that.
    """
    active = tuple(train.topology.law_index.tolist())
    level = min(
        first_level(excited_harmonic(train, plan.method), 0.0),
        MOST_HARMONICS[plan.method],
    )
    harmonics = request.harmonics or max(plan.harmonics, level)
    return dataclasses.replace(
        plan,
        harmonics=harmonics,
        active=active,
        flank=(0,) * len(train.topology.has_law),
    )


def contact_plan(train: DriveTrain, request: Request) -> Plan:
    """The plan with all teeth in contact and no mesh held on a flank, so that nothing
    is verified.
    """
    return Plan(
        harmonics=request.harmonics
        or max(excited_harmonic(train, request.method), LEVELS[0]),
        active=(),
        flank=(0,) * len(train.topology.has_law),
        method=request.method,
        tolerance=request.tolerance,
        excited=listed_harmonic(train.topology),
        integrals=request.integrals,
        step_tolerance=request.step_tolerance,
        averaged=request.averaged,
    )


def plan_speeds(train: DriveTrain, rpm: np.ndarray, request: Request) -> list[Plan]:
    """A Plan for every speed ``(n,)``, few distinct ones: teeth in contact, leaving
    contact, separating.
    """
    # Its ``excited`` is the highest order listed, whatever its amplitude.
    contact = contact_plan(train, request)
    excited = excited_harmonic(train, request.method)
    if not train.topology.has_law.any():
        return [contact] * len(rpm)
    if train.topology.depends_on_speed:
        return [
            plan
            for speed in rpm
            for plan in plan_speeds(at_speed(train, speed), speed[None], request)
        ]
    forces = _linear_mesh_forces(train, rpm, contact, max(excited, LEVELS[0]))
    sampled = fourier.synthesize(
        forces, fourier.SAMPLES_PER_HARMONIC * forces.shape[-1]
    )
    flanks, leaves, apart = meshes_leaving_contact(train, sampled)
    modes, weak_modes = (
        mesh_mode_harmonics(train, train.topology.cycle_frequency(1.0))[:, None] / rpm
    )
    plans = [
        dataclasses.replace(contact, flank=tuple(flank)) for flank in flanks.tolist()
    ]

    def level_of(highest: float) -> int:
        levels = FEW_LEVELS if request.few_levels and highest else LEVELS
        level = level_at_least(first_level(excited, highest), levels)
        return request.harmonics or min(level, MOST_HARMONICS[request.method])

    # The linear train does not tell what a stiffness that varies, or a stage, does to
    # the motion: that is marched, too.
    marched = apart | (not train.topology.linear_in_contact)
    touching, hammering = (
        np.flatnonzero(leaves.any(axis=-1) & (marched == separating))
        for separating in (False, True)
    )
    groups = {(False, level_of(0.0)): touching} if len(touching) else {}
    levels = np.array([level_of(highest) for highest in modes[hammering]], dtype=int)
    groups |= {
        (True, level): hammering[levels == level]
        for level in dict.fromkeys(levels.tolist())
    }
    for (separating, level), group in groups.items():
        # One plan for the group: a mesh is held where it stays on the same flank at all
        # its speeds.
        held = flanks[group]
        flank = tuple(np.where((held == held[0]).all(axis=0), held[0], 0).tolist())
        resolving = time_steps_for(max(np.max(modes[group]), 2 * contact.excited))
        shared = dataclasses.replace(
            contact,
            harmonics=level,
            active=tuple(i for i in train.topology.law_index.tolist() if not flank[i]),
            flank=flank,
            start="march" if separating else "linear",
            time_steps=max(time_steps_of(level), resolving if separating else 0),
            tolerance_share=tolerance_share(level, np.max(weak_modes[group])),
        )
        for i in group:
            plans[i] = shared
    return plans


def _linear_mesh_forces(
    train: DriveTrain, rpm: np.ndarray, contact: Plan, harmonics: int
) -> np.ndarray:
    """Elastic forces ``(n, M, N+1)`` N of the meshes at speeds ``(n,)``, all teeth in
    contact.
    """
    if train.topology.n_disks <= HOST_DISKS:
        with np.errstate(all="ignore"):  # a solve tells of numbers that are not finite
            return _mesh_forces_of_host(on_host(train), rpm, harmonics)
    linear = dataclasses.replace(
        contact, harmonics=harmonics, method="reduced", integrals="sampled"
    )
    batches = solve_batches(linearised(train), rpm, linear)
    return np.stack(
        [response.elastic_forces for batch in batches for response in batch]
    )


def _mesh_forces_of_host(
    train: DriveTrain, rpm: np.ndarray, harmonics: int
) -> np.ndarray:
    """Elastic forces as of :func:`_linear_mesh_forces`, without a program."""
    system, meshes = _linear_parts(train)
    forces = []
    size = max(COLUMNS // (harmonics + 1), 1)
    for first in range(0, len(rpm), size):
        _, bends = motions_in_contact(
            train, rpm[first : first + size], system, meshes, harmonics
        )
        forces.append(
            meshes.law.stiffness[:, None]
            * backlash.less_error(meshes, bends[:, meshes.link])
        )
    return np.concatenate(forces)


@remembered
def _linear_parts(train: DriveTrain) -> tuple[System, MeshParameters]:
    """System and meshes of the linear train, for any speed."""
    train = linearised(train)  # without springs beside shafts, which are no meshes
    return chain.assemble(train), all_meshes(train)


def plan_marching(
    train: DriveTrain, rpm: np.ndarray, plan: Plan, request: Request
) -> Plan:
    """A plan that serves all speeds ``rpm`` ``(n,)`` whatever the teeth do there, at
    least as fine as ``plan``.
    """
    modes, _ = mesh_mode_harmonics(
        train, train.topology.cycle_frequency(float(np.max(rpm)))
    )
    excited = excited_harmonic(train, request.method)
    least = time_steps_for(max(modes, 2 * excited))
    steps = max(plan.time_steps, least) if plan.active else least
    return dataclasses.replace(
        all_active(train, plan, request), start="march", time_steps=steps
    )


def plan_range(
    train: DriveTrain, rpm: np.ndarray, request: Request, *, every_mesh: bool
) -> Plan:
    """One plan for all speeds ``rpm`` ``(n,)`` as far as the linear motion tells: for
    teeth in contact where they stay so at every speed, unless ``every_mesh`` is to be
    an unknown.
    """
    plans = plan_speeds(train, rpm, request)
    unknown = [plan for plan in plans if plan.active]
    flanks = {plan.flank for plan in plans}
    if not unknown and not every_mesh and len(flanks) == 1:
        return plans[0]
    marching = plan_marching(
        train, rpm, max(unknown or plans, key=lambda plan: plan.harmonics), request
    )
    steps = [
        marching.time_steps,
        time_steps_of(marching.harmonics),
        *(plan.time_steps for plan in unknown),
    ]
    return dataclasses.replace(marching, time_steps=max(steps))

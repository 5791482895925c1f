"""Decisions taken on the host: which meshes are unknowns, where to start, how many
harmonics.
"""

import dataclasses
import math

import numpy as np

from jaxhb._jax import kept, on_host
from jaxhb.balance.plan import (
    MOST_HARMONICS,
    Plan,
    excited_harmonic,
    time_steps_for,
    time_steps_of,
)
from jaxhb.balance.program import solve_batches
from jaxhb.equations import backlash, fourier
from jaxhb.equations.condensation import HOST_DISKS
from jaxhb.excitation.torques import listed_harmonic
from jaxhb.integration.batch import motions_in_contact
from jaxhb.linear.mesh_modes import mesh_mode_harmonics
from jaxhb.train import chain
from jaxhb.train.changes import linearised

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
"""Those offered where speeds share programs whatever else is asked for: one has the
same harmonics in any sweep.
"""

LEVEL_RATIO = (
    2.0  # how many times as many harmonics are tried next, where all levels are offered
)
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


def level_at_least(harmonics, levels=LEVELS):
    """The smallest of the levels that is not below ``harmonics``, else the highest."""
    return next((n for n in levels if n >= harmonics), levels[-1])


def next_level(harmonics, method, few_levels=False):
    """The number of harmonics to try after ``harmonics``; None at the limit.

    A level nearer to the limit than to the one before is the limit.
    """
    most = MOST_HARMONICS[method]
    if few_levels:
        return next((n for n in FEW_LEVELS if n > harmonics), None)
    # 0.95: levels are a ratio of 1.33 or 1.5 apart, and the next one is not to be
    # missed by a little.
    higher = [
        n
        for n in LEVELS
        if 0.95 * LEVEL_RATIO * harmonics <= n <= most / math.sqrt(LEVEL_RATIO)
    ]
    return higher[0] if higher else most if harmonics < most else None


def meshes_leaving_contact(train, forces):
    """Meshes that the linear motion takes off their flank, or nearly so where others
    separate and hammer.

    Of elastic forces ``(n, M, samples)`` N with all in contact: the flank ``(n, E)`` on
    which each backlash mesh is taken to stay (to be verified), 0 for the others and for
    ``springs`` of the topology; whether it leaves it or its stiffness varies, its
    motion an unknown; and ``(n,)`` whether any force passes through zero.
    """
    gap = np.array(train.topology.mesh_backlash, dtype=bool)
    # A mesh stays on its flank where its least force exceeds that of the knee, by more
    # the harder others hammer: their impacts come on top of the linear motion.
    side = np.where(forces.mean(-1) < 0, -1, 1)
    lowest = forces.min(-1, initial=np.inf)
    highest = forces.max(-1, initial=-np.inf)
    least = np.where(side < 0, -highest, lowest)
    apart = gap & (least <= 0)
    half_peak_to_peak = np.where(apart, (highest - lowest) / 2, 0.0)
    spare = HAMMERED * np.max(half_peak_to_peak, axis=-1, initial=0.0, keepdims=True)
    stays = (
        gap
        & (least > backlash.law_of(train.meshes).knee_force + spare)
        & ~train.topology.mesh_varies
    )
    flank = np.where(stays, side, 0)
    springs = [(0, 0), (0, len(train.topology.springs))]
    return (
        np.pad(flank, springs),
        train.topology.has_law & ~np.pad(stays, springs),
        apart.any(axis=-1),
    )


def first_level(excited, mesh_modes):
    """Where to begin: above the excitation, and above the mesh modes where teeth
    separate.
    """
    return level_at_least(max(ABOVE_EXCITATION * excited, ABOVE_MODES * mesh_modes))


def tolerance_share(harmonics, weak_modes):
    """How much of the tolerance an estimate may use: less while modes of meshes lie
    above the 2 N that it sees.
    """
    return 1.0 if 2 * harmonics >= SEES_MODES * weak_modes else BLIND_SHARE


def all_active(train, plan, request):
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


def contact_plan(train, request):
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


def plan_speeds(train, rpm, request):
    """A Plan for every speed ``(n,)``, few distinct ones: teeth in contact, leaving
    contact, separating.
    """
    contact = contact_plan(
        train, request
    )  # its ``excited`` is the highest order listed, whatever its amplitude
    excited = excited_harmonic(train, request.method)
    if not train.topology.has_law.any():
        return [contact] * len(rpm)
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

    def level_of(highest):
        levels = FEW_LEVELS if request.few_levels and highest else LEVELS
        wanted = level_at_least(first_level(excited, highest), levels)
        return request.harmonics or min(wanted, MOST_HARMONICS[request.method])

    # What a stiffness that varies, or a stage, does to the motion the linear train does
    # not tell: that is marched, too.
    marched = apart | (not train.topology.linear_in_contact)
    touching, hammering = (
        np.flatnonzero(leaves.any(axis=-1) & (marched == kind))
        for kind in (False, True)
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
        own = flanks[group]
        flank = tuple(np.where((own == own[0]).all(axis=0), own[0], 0).tolist())
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


def _linear_mesh_forces(train, rpm, contact, harmonics):
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


def _mesh_forces_of_host(train, rpm, harmonics):
    """The same without a program."""
    (system, meshes) = _linear_parts(train)
    found = []
    size = max(COLUMNS // (harmonics + 1), 1)
    for first in range(0, len(rpm), size):
        _, bends = motions_in_contact(
            train, rpm[first : first + size], system, meshes, harmonics
        )
        found.append(
            meshes.law.stiffness[:, None]
            * backlash.less_error(meshes, bends[:, meshes.link])
        )
    return np.concatenate(found)


@kept
def _linear_parts(train):
    """System and meshes of the linear train, for any speed."""
    train = linearised(train)  # what acts beside shafts is no mesh
    return chain.assemble(train), backlash.all_meshes(train)


def plan_marching(train, rpm, plan, request):
    """A plan that serves all ``rpm`` ``(n,)`` whatever the teeth do there, at least as
    fine as ``plan``.
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


def plan_range(train, rpm, request, *, every_mesh):
    """One plan for all ``rpm`` ``(n,)`` as far as the linear motion tells: of teeth in
    contact where none leaves it at any of them, unless ``every_mesh`` is to be an
    unknown.
    """
    plans = plan_speeds(train, rpm, request)
    unknown = [plan for plan in plans if plan.active]
    held = {plan.flank for plan in plans}
    if not unknown and not every_mesh and len(held) == 1:
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

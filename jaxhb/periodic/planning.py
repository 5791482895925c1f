"""Decisions taken on the host: which meshes are unknowns, where to start, how many harmonics."""

import contextlib
import dataclasses
import math

import numpy as np

from .._arrays import kept, on_host
from ..harmonic import backlash, chain, fourier
from ..harmonic.excitation import excitation, listed_harmonic
from ..linear.modal import natural_frequencies
from ..model.change import without_backlash
from ..transient.statespace import linear_response
from .plan import Plan
from .planned import solve_batches
from .request import MOST, excited_harmonic
from .time_steps import time_steps_for, time_steps_of

LEVELS = (16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024, 1536, 2048, 3072, 4096)
DENSE_MODES, GEARS_ALONE = 400, 1.1
"""Disks up to which all modes are computed; what the shafts add to the frequencies of the gears alone."""

DENSE_DISKS, DENSE_SPEEDS = 100, 256
"""Disks and speeds up to which the linear motion is solved with dense matrices, and no program, to plan: 27 disks take
5 ms a speed, and the program 3 s to compile."""

STRAINED = 0.05, 0.01
"""Share of the strain energy of a mode that tooth meshes hold noticeably, and faintly."""

HAMMERED = 2.0
"""Linear half swings of the hardest mesh that separates, by which another must stay loaded to be no unknown."""

DENSE, SPARSE = 2.0, 4.0
"""How far apart the levels of harmonics lie that are tried one after another, at one speed and in a sweep: a program
more costs as much as a hundred speeds with twice the harmonics."""


def level_at_least(harmonics):
    """Smallest of the offered numbers of harmonics that is not below ``harmonics``."""
    return next((n for n in LEVELS if n >= harmonics), LEVELS[-1])


def shared_level(harmonics):
    """The smallest of few numbers of harmonics, SPARSE apart, that is not below ``harmonics``: for speeds that are not
    known beforehand and share programs."""
    few = LEVELS[LEVELS.index(192) : -4 : 4]  # 192, 768
    return next((n for n in few if n >= harmonics), LEVELS[-1])


def next_level(harmonics, method, ratio=DENSE):
    """The number of harmonics to try after ``harmonics``, about ``ratio`` times as many; None at the limit.

    A level nearer to the limit than to the one before is the limit.
    """
    most = MOST[method]
    higher = [n for n in LEVELS if 0.95 * ratio * harmonics <= n <= most / math.sqrt(ratio)]
    return higher[0] if higher else most if harmonics < most else None


def mesh_mode_harmonics(train, frequency):
    """Harmonics of the cycle at the highest natural frequencies that strain tooth meshes noticeably and faintly.

    Noticeably: a motion is resolved from there on. Faintly: little damping makes such a mode loud, and an estimate of
    the truncation error that does not reach it misses that. Of a finely divided train, whose modes would take longer
    than its solve, that of the gears and meshes alone.

    Returns
    -------
    array ``(2,)``
    """
    return _mesh_modes_hz(train) / (frequency / (2 * np.pi))


@kept
def _mesh_modes_hz(train):
    """Frequencies ``(2,)`` in Hz of :func:`mesh_mode_harmonics`."""
    if train.topology.n_disks > DENSE_MODES:
        return np.full(2, GEARS_ALONE * _gear_mode_hz(train))
    modes = natural_frequencies(train)
    share = modes.mesh_energy_share
    return np.array([np.max(modes.frequencies_hz[share > least], initial=0.0) for least in STRAINED])


def _gear_mode_hz(train):
    """Highest natural frequency in Hz of the gears on their meshes, all shafts taken away."""
    system = chain.assemble(train)
    links = np.arange(len(system.stiffness) - len(train.topology.mesh_names), len(system.stiffness))
    rows = system.incidence(links).T
    mass = np.maximum(system.mass, 1e-6 * np.mean(system.mass))
    root = np.sqrt(system.stiffness[links])
    squares = np.linalg.eigvalsh(root[:, None] * (rows / mass) @ rows.T * root)
    return np.sqrt(max(squares.max(initial=0.0), 0.0)) / (2 * np.pi)


def contact_demand(train, forces):
    """Meshes that the linear motion takes off their flank, or nearly so where others separate and hammer.

    Parameters
    ----------
    train : DriveTrain
    forces : array ``(..., M, samples)`` N, elastic forces of the meshes with all in contact

    Returns
    -------
    flank : int array ``(..., M)``
        Side of each backlash mesh taken to stay beyond its transition zone (to be verified); 0 for the others and for
        linear meshes.
    leaves : bool array ``(..., M)``
        Backlash meshes whose contact is an unknown.
    separates : bool array ``(...)``
        Whether any linear force passes through zero.
    """
    gap = np.array(train.topology.mesh_backlash, dtype=bool)
    side = np.where(forces.mean(-1) < 0, -1, 1)
    lowest, highest = forces.min(-1, initial=np.inf), forces.max(-1, initial=-np.inf)
    least = np.where(side < 0, -highest, lowest)
    apart = gap & (least <= 0)
    swing = np.where(apart, (highest - lowest) / 2, 0.0)
    spare = HAMMERED * np.max(swing, axis=-1, initial=0.0, keepdims=True)
    leaves = gap & ~(least > backlash.law_of(train.meshes).knee_force + spare)
    return np.where(gap & ~leaves, side, 0), leaves, apart.any(axis=-1)


def first_level(excited, mesh_modes):
    """Where to begin: above the excitation, and above the mesh modes where teeth separate."""
    return level_at_least(max(2 * excited, 1.5 * mesh_modes))


def tolerance_share(harmonics, faint):
    """How much of the tolerance an estimate may use: a tenth while modes of meshes lie above the 2 N that it sees."""
    return 1.0 if 2 * harmonics >= 1.2 * faint else 0.1


def all_unknown(train, plan, request):
    """The plan with every mesh that has backlash as an unknown, and enough harmonics for that."""
    gaps = train.topology.mesh_backlash
    active = tuple(i for i, gap in enumerate(gaps) if gap)
    level = min(first_level(excited_harmonic(train, plan.method), 0.0), MOST[plan.method])
    harmonics = request.harmonics or max(plan.harmonics, level)
    return dataclasses.replace(plan, harmonics=harmonics, active=active, flank=(0,) * len(gaps))


def contact_plan(train, request):
    """The plan with all teeth in contact and no mesh held on a flank, so that nothing is verified."""
    return Plan(
        harmonics=request.harmonics or max(excited_harmonic(train, request.method), LEVELS[0]),
        active=(),
        flank=(0,) * len(train.topology.mesh_names),
        method=request.method,
        tolerance=request.tolerance,
        excited=listed_harmonic(train.topology),
        integrals=request.integrals,
    )


def plan_speeds(train, rpm, request):
    """A plan for every speed, few distinct ones: teeth in contact, leaving contact, separating.

    Parameters
    ----------
    train : DriveTrain
    rpm : array ``(n,)``
    request : Request

    Returns
    -------
    list of Plan
    """
    contact = contact_plan(train, request)  # its ``excited`` is the highest order listed, whatever its amplitude
    excited = excited_harmonic(train, request.method)
    if not any(train.topology.mesh_backlash):
        return [contact] * len(rpm)
    forces = _linear_mesh_forces(train, rpm, contact, max(excited, LEVELS[0]))
    flanks, leaves, apart = contact_demand(train, fourier.synthesize(forces, 16 * forces.shape[-1]))
    modes, faint = mesh_mode_harmonics(train, train.topology.cycle_frequency(1.0))[:, None] / rpm
    plans = [dataclasses.replace(contact, flank=tuple(flank)) for flank in flanks.tolist()]

    def level_of(group, separating):
        wanted = first_level(excited, np.max(modes[group]) if separating else 0.0)
        return request.harmonics or min(wanted, MOST[request.method])

    touching, hammering = (np.flatnonzero(leaves.any(axis=-1) & (apart == kind)) for kind in (False, True))
    groups = [(False, touching)] if len(touching) else []
    groups += [(True, group) for group in _alike(hammering, modes)]
    for separating, group in groups:
        level, own = level_of(group, separating), flanks[group]
        flank = tuple(np.where((own == own[0]).all(axis=0), own[0], 0).tolist())
        resolving = time_steps_for(max(np.max(modes[group]), 2 * contact.excited))
        shared = dataclasses.replace(
            contact,
            harmonics=level,
            active=tuple(i for i, gap in enumerate(train.topology.mesh_backlash) if gap and not flank[i]),
            flank=flank,
            start="march" if separating else "linear",
            time_steps=max(time_steps_of(level), resolving if separating else 0),
            tolerance_share=tolerance_share(level, np.max(faint[group])),
        )
        for i in group:
            plans[i] = shared
    return plans


def _linear_mesh_forces(train, rpm, contact, harmonics):
    """Elastic forces ``(n, M, N+1)`` N of the meshes at speeds ``(n,)``, all teeth in contact."""
    if len(rpm) <= DENSE_SPEEDS and train.topology.n_disks <= DENSE_DISKS:
        with contextlib.suppress(np.linalg.LinAlgError):  # a singular train, of which the program below says more
            return _dense_mesh_forces(on_host(train), rpm, harmonics)
    linear = dataclasses.replace(contact, harmonics=harmonics, method="reduced", integrals="sampled")
    batches = solve_batches(without_backlash(train), rpm, linear, linear.sizes.max_steps)
    return np.stack([response.elastic_forces for batch in batches for response in batch])


def _dense_mesh_forces(train, rpm, harmonics):
    """Those without a program, whose compilation takes longer than all else of a first plan."""
    system, found = chain.assemble(train), []
    links = np.arange(len(system.stiffness))[-len(train.topology.mesh_names) :]
    for speed in rpm:
        load = excitation(train, speed, harmonics)[0] / system.radius[:, None]
        displacement = linear_response(system, train.topology.cycle_frequency(speed), load)
        found.append(system.stiffness[links][:, None] * system.deflections(displacement, links))
    return np.stack(found)


def _alike(places, modes):
    """``places`` of speeds in groups whose mesh modes lie within a factor of SPARSE: each is one level, one program."""
    groups = []
    while len(places):
        near = SPARSE * modes[places] > modes[places].max()
        groups.append(places[near])
        places = places[~near]
    return groups


def plan_marching(train, rpm, plan, request):
    """A plan that serves all ``rpm`` ``(n,)`` whatever the teeth do there, at least as fine as ``plan``."""
    modes, _ = mesh_mode_harmonics(train, train.topology.cycle_frequency(float(np.max(rpm))))
    excited = excited_harmonic(train, request.method)
    least = time_steps_for(max(modes, 2 * excited))
    steps = max(plan.time_steps, least) if plan.active else least
    return dataclasses.replace(all_unknown(train, plan, request), start="march", time_steps=steps)

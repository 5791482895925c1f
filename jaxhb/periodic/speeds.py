"""Many speeds in one call: planned on the host, solved in compiled batches, the few that fail taken up the ladder."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from .._program import Program
from ..linear.response import stack
from ..model.engine import listed_harmonic
from . import harmonics as decide
from . import march
from .harmonics import Plan
from .newton import Status
from .problem import Problem, pose
from .program import Start, solve_problem
from .solve import check_speed, respond, solve, solve_further

CHUNK, LINEAR_CHUNK = 8, 32
"""Speeds in a batch; more of them where there are so many and no lane waits for another."""

BATCH_STEPS = 8
HEAVY, LARGE = 192, 24
"""Harmonics, and disks beside unknown contact, from which one speed fills a processor: there a batch is no faster, as
it waits for its slowest speed, and takes longer to compile."""

MANY = 8
"""Heavy speeds that are worth a program of their own."""


def solve_speeds(train, *, rpm, plan=None, harmonics=None, tolerance=None, integrals=None, progress=None):
    """Periodic responses at many speeds.

    The linear motion tells at which speeds teeth leave contact or separate; speeds with the same needs share a plan
    and one compiled program, in batches of fixed size where that is faster. A speed that fails is solved again by
    itself, from the nearest speed that converged, with more harmonics or by shooting.

    Parameters
    ----------
    train : DriveTrain
    rpm : array ``(n,)``
        Speeds of the reference rotor.
    plan : Plan, optional
        From :func:`jaxhb.plan`: all speeds are solved under it, and nothing is solved twice.
    harmonics : int, optional
        Harmonics of the cycle, fixed for all speeds.
    tolerance : float, optional
        On the truncation error, default 1 %; speeds that do not reach it have status TOLERANCE_NOT_MET.
    integrals : str, optional
        Of the tooth law over the cycle, "sampled" (default) or "exact", as in :func:`jaxhb.solve`.
    progress : callable, optional
        Called with the number of speeds done since the last call.

    Returns
    -------
    Response
        With a leading axis: ``sweep[17]`` is the response at speed 17, ``sweep.status`` the status of each. Responses
        with fewer harmonics than others are padded with zeros.

    Raises
    ------
    SceneError
        A speed that is not positive, or harmonics below the excitation.

    Examples
    --------
    >>> import jaxhb, numpy
    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> sweep = jaxhb.solve_speeds(train, rpm=numpy.linspace(1000, 2500, 4))
    >>> sweep.torque("cyl6", "flywheel").half_peak_to_peak.shape
    (4,)
    """
    rpm = np.atleast_1d(np.asarray(rpm, dtype=float))
    check_speed(train, rpm, many=True)
    if plan and not (harmonics is None and tolerance is None and integrals is None):
        raise ValueError("harmonics, tolerance and integrals belong to the plan: give them to jaxhb.plan")
    tolerance, integrals = 0.01 if tolerance is None else tolerance, integrals or "sampled"
    decide.check_tolerance(train, tolerance)
    decide.check_integrals(integrals, "reduced")
    if plan:
        decide.check_plan(train, plan)
    if harmonics is not None:
        decide.check_harmonics(train, harmonics, "reduced")
    plans = [plan] * len(rpm) if plan else plan_speeds(train, rpm, harmonics, tolerance, integrals)
    tell = progress or (lambda done: None)
    found = [None] * len(rpm)
    for shared in dict.fromkeys(plans):
        places = [i for i, own in enumerate(plans) if own == shared]
        size = LINEAR_CHUNK if not shared.active and len(places) >= LINEAR_CHUNK else CHUNK
        alone = _alone(shared.harmonics, train.topology.n_disks if shared.active else 0)
        size = 1 if alone or len(places) == 1 else size
        for first in range(0, len(places), size):
            chunk = places[first : first + size]
            if size == 1:
                found[chunk[0]] = solve(train, rpm=float(rpm[chunk[0]]), plan=shared)
            else:
                most = shared.sizes.max_steps if plan and plan.active else BATCH_STEPS
                solved = _solve_chunk(train, rpm[chunk], shared, size, most)
                for row, place in enumerate(chunk):
                    found[place] = solved, row
            tell(len(chunk))
    if plan is None:
        status = np.array([int(np.ravel(r.status)[row]) for r, row in map(_placed, found)])
        for place in range(len(rpm)):
            if _worth_another_try(status[place], harmonics):
                found[place] = _again(train, rpm, place, found, status, harmonics, tolerance, integrals)
                status[place] = found[place].status
    return stack(found)


def _placed(found):
    """A batch and a row of it, of what one speed was found in."""
    return found if isinstance(found, tuple) else (found, 0)


def _again(train, rpm, place, found, status, harmonics, tolerance, integrals):
    """The best response at one speed: from its own motion or the nearest that converged, then up the ladder."""
    own, good = status[place] == Status.TOLERANCE_NOT_MET, np.flatnonzero(status == Status.CONVERGED)
    asked = {"harmonics": harmonics, "tolerance": tolerance, "integrals": integrals}
    tried = [_single(found[place])] if own else []
    if own or len(good):
        near = tried[0] if own else _single(found[good[np.argmin(np.abs(rpm[good] - rpm[place]))]])
        tried.append(solve(train, rpm=float(rpm[place]), start=near, **asked))
    if not tried or int(tried[-1].status) > Status.TOLERANCE_NOT_MET:
        tried.append(solve_further(train, float(rpm[place]), **asked))
    return min(reversed(tried), key=lambda response: int(response.status))


def _single(found):
    """The response of one speed."""
    batch, row = _placed(found)
    return batch[row] if np.ndim(batch.rpm) else batch


def _worth_another_try(status, harmonics):
    hopeless = (Status.CONVERGED, Status.UNBALANCED)
    return status not in hopeless and not (harmonics and status == Status.TOLERANCE_NOT_MET)


def _axes():
    """Of a batch of problems only what depends on speed has a leading axis."""
    return Problem(
        system=None,
        meshes=None,
        frequency=0,
        load=0,
        rigid=None,
        load_torque=0,
        load_power=0,
    )


@partial(Program, static_argnames="excited")
def _pose_all(train, rpm, excited):
    return jax.vmap(lambda speed: pose(train, speed, excited), out_axes=_axes())(rpm)


@partial(Program, static_argnames="sizes")
def _solve_all(problem, choice, start, tolerance, sizes):
    def one(problem):
        return solve_problem(problem, choice, start, tolerance, sizes)

    return jax.vmap(one, in_axes=(_axes(),))(problem)


def _solve_chunk(train, rpm, plan, size, most):
    """Response at up to ``size`` speeds under one plan, padded to a batch of that size; ``most`` Newton steps."""
    padded = np.concatenate([rpm, np.full(size - len(rpm), rpm[-1])])
    problem = _pose_all(train, jnp.asarray(padded), plan.sizes.excited)
    choice = plan.choice
    coefficients = np.zeros((len(choice.active), plan.harmonics + 1), dtype=complex)
    start = Start(coefficients, np.array(False), np.array(plan.cycles if plan.start == "march" else 0))
    sizes = dataclasses.replace(plan.sizes, max_steps=most)
    outcome = _solve_all(problem, choice, start, plan.limit, sizes)
    loads = _Loads(problem.load_torque, problem.load_power)
    loads, outcome = jax.tree.map(lambda a: np.asarray(a)[: len(rpm)], (loads, outcome))
    return dataclasses.replace(respond(train, rpm, loads, outcome, plan), path=(str(plan),) * len(rpm))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Loads:
    """What :func:`respond` reads of a problem."""

    load_torque: jax.Array
    load_power: jax.Array


def _alone(harmonics, disks):
    """Whether speeds with so many harmonics, and disks beside unknown contact, are solved one by one."""
    return (harmonics >= HEAVY or disks >= LARGE) and jax.default_backend() == "cpu"


def _alike(places, modes, excited):
    """``places`` of speeds cut where the mesh modes want fewer steps a cycle, if there are MANY speeds on each side.

    One speed after another costs what its steps cost, and every number of steps is one more program: that pays with
    many speeds.
    """
    groups, left = [], places
    steps = np.array([march.instants_for(max(mode, 2 * excited)) for mode in modes])
    for count in sorted(set(steps[places].tolist())):
        alike = left[steps[left] <= count]
        if len(alike) >= MANY and len(left) - len(alike) >= MANY:
            groups.append(alike)
            left = left[steps[left] > count]
    return [*groups, left]


def plan_speeds(train, rpm, harmonics, tolerance, integrals="sampled"):
    """A plan for every speed, few distinct ones: teeth in contact, leaving contact, separating."""
    excited = decide.excited_harmonic(train, "reduced")
    count = len(train.topology.mesh_names)
    level = harmonics or max(excited, decide.LEVELS[0])
    contact = Plan(
        harmonics=level,
        active=(),
        flank=(0,) * count,
        tolerance=tolerance,
        excited=listed_harmonic(train.topology),
        integrals=integrals,
    )
    if not any(train.topology.mesh_backlash):
        return [contact] * len(rpm)
    probing = dataclasses.replace(contact, harmonics=min(level, max(excited, decide.LEVELS[0])))
    straight = solve_speeds(decide.without_backlash(train), rpm=rpm, plan=probing)
    samples = np.fft.irfft(straight.elastic_forces, n=16 * straight.elastic_forces.shape[-1], norm="forward")
    flanks, leaves, apart = decide.contact_demand(train, samples)
    modes, faint = decide.mesh_mode_harmonics(train, train.topology.cycle_frequency(1.0))[:, None] / rpm
    resting = {flank: dataclasses.replace(contact, flank=flank) for flank in set(map(tuple, flanks.tolist()))}
    plans = [resting[tuple(flank)] for flank in flanks.tolist()]

    def level_of(group, separating):
        return harmonics or decide.first_level(excited, float(np.median(modes[group])) if separating else 0.0)

    touching, hammering = (np.flatnonzero(leaves.any(axis=-1) & (apart == kind)) for kind in (False, True))
    cut = len(hammering) and _alone(level_of(hammering, True), train.topology.n_disks)
    groups = [(False, touching)]
    groups += [(True, group) for group in (_alike(hammering, modes, excited) if cut else [hammering])]
    for separating, group in groups:
        if not len(group):
            continue
        slowest, level = np.max(modes[group]), level_of(group, separating)
        own = flanks[group]
        flank = tuple(np.where((own == own[0]).all(axis=0), own[0], 0).tolist())
        shared = dataclasses.replace(
            contact,
            harmonics=level,
            active=tuple(i for i, gap in enumerate(train.topology.mesh_backlash) if gap and not flank[i]),
            flank=flank,
            start="march" if separating else "linear",
            instants=march.instants_for(max(slowest, 2 * contact.excited) if separating else 2 * level),
            trust=decide.trust_in(level, np.max(faint[group])),
        )
        for i in group:
            plans[i] = shared
    return plans

"""Solves in which nothing is decided: one speed or a batch of them under one plan, eager or traced."""

import dataclasses
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import namespace, staged, traced
from jaxhb._program import WHOLE, Program, across, along
from jaxhb.balance import derivative, request
from jaxhb.balance.problem import Problem, problem_at
from jaxhb.balance.program import Start, solve_problem
from jaxhb.equations import fourier
from jaxhb.equations.backlash import law_of
from jaxhb.results.response import Response
from jaxhb.results.status import March, Newton, Status
from jaxhb.train.changes import within_range
from jaxhb.train.speeds import HIGHEST_RPM, check_speed


@dataclass(frozen=True)
class BatchOptions:
    """How many speeds one program solves side by side.

    Parameters
    ----------
    speeds : in a batch
    alone_harmonics, alone_disks : number of harmonics, or of disks, from which speeds are solved without batches on
        processors: one fills a processor, and a batch waits for its slowest and takes longer to compile
    newton_steps : at most, of a speed in a batch under a plan that the caller did not give; one that needs more is
        solved again by itself
    """

    speeds: int = 8
    alone_harmonics: int = 192
    alone_disks: int = 24
    newton_steps: int = 8


BATCH = BatchOptions()

FEWEST_SAMPLES = 4096
"""Per cycle, at which extremes of a response are looked for."""


def solve_planned(train, rpm, plan, start=None):
    """Response under a plan, from a Response or "linear" or "march" instead of the start that the plan has."""
    request.check_plan(train, plan)
    if start is None and plan.start == "response":
        raise ValueError(
            f"{train.topology.title}: no start that a plan holds leads to its motion: solve without a plan and give "
            "that response as start."
        )
    if not traced(rpm):
        check_speed(train, rpm)
        rpm = np.asarray(rpm, dtype=float)
    begin = first_start(plan, marches=plan.marches if start is None else start == "march")
    if start == "march":
        plan = dataclasses.replace(plan, start=start)
    if isinstance(start, Response):
        begin = first_start(plan, given=active_deflections(plan, start.deflections), xp=jnp)
        # Under jit a response that is not solved is nan, and no start.
        begin = dataclasses.replace(begin, given=jnp.isfinite(begin.coefficients).all())
    if traced(train, rpm, begin) or staged():
        response = _solve_traced(train, rpm, begin, plan.active_meshes, plan.limit, plan.sizes)
        return dataclasses.replace(response, train=train)
    return solve_once(train, rpm, problem_at(train, rpm, plan.sizes.excited), plan, begin)[0]


def solve_once(train, rpm, problem, plan, begin):
    """The Response with numpy arrays, and the Outcome, of one eager solve from a Start."""
    outcome = jax.tree.map(np.asarray, solve_problem(problem, plan.active_meshes, begin, plan.limit, plan.sizes))
    return _response_of(train, rpm, problem, outcome, plan), outcome


def _response_of(train, rpm, problem, outcome, plan):
    """The Response of an Outcome with numpy arrays, its train and its path."""
    response = jax.tree.map(np.asarray, respond(train, rpm, problem, outcome, plan.sizes))
    status, steps, error = Status(int(response.status)), int(response.steps), float(outcome.periodicity_error)
    path = (Newton(plan.harmonics, len(plan.active), plan.integrals, status, steps),)
    if error:  # 0: nothing was marched
        path = (March(plan.cycles, plan.time_steps, error), *path)
    return dataclasses.replace(response, train=train, path=path)


def active_deflections(plan, deflections):
    """Deflections ``(..., G, n+1)`` m of the active meshes of a plan, from those of all ``(..., M, n+1)``."""
    return deflections[..., plan.active_meshes.index, :] * plan.active_meshes.mask[:, None]


def first_start(plan, *, marches=False, given=None, xp=np):
    """The Start from teeth in contact, marched on or not, or from given deflections ``(G, n+1)``."""
    if given is None:
        nothing = np.zeros((len(plan.active_meshes.mask), plan.harmonics + 1), dtype=complex)
        return Start(nothing, np.array(False), np.array(plan.cycles if marches else 0))
    return Start(fourier.resize(xp.asarray(given), plan.harmonics), np.array(True), np.array(0))


@partial(Program, static_argnames="sizes")
def _solve_traced(train, rpm, begin, active_meshes, limit, sizes):
    """One program for all of it: piece by piece, differentiation outside ``jit`` compiles a hundred small ones."""
    finite = derivative.all_finite((train, rpm))
    # Not ``rpm > 0``: nan is not out of range but not finite, and has its own status.
    valid = within_range(train) & ~((rpm <= 0) | (rpm > HIGHEST_RPM))
    train, rpm = derivative.only_if(finite & valid, (train, rpm))
    problem = problem_at(train, rpm, sizes.excited)
    outcome = solve_problem(problem, active_meshes, begin, limit, sizes)
    status = jnp.where(finite, outcome.status, Status.NONFINITE)
    outcome = dataclasses.replace(outcome, status=jnp.where(valid, status, Status.INVALID_INPUT))
    return _nan_unless_solved(respond(train, rpm, problem, outcome, sizes))


def _nan_unless_solved(response):
    """The response with nan for all that was computed if it is not solved, and derivatives of zero, not nan."""
    given = ("rpm", "radius", "law", "topology", "resolution", "train", "path", "certificate")
    found = {f.name: getattr(response, f.name) for f in dataclasses.fields(response) if f.name not in given}
    solved = response.status <= Status.TOLERANCE_NOT_MET
    return dataclasses.replace(response, **derivative.only_known(solved, found))


def respond(train, rpm, problem, outcome, sizes):
    """Assemble the :class:`Response` of an outcome."""
    found, topology, xp = outcome.fields, train.topology, namespace(outcome.fields)
    ground = np.array(topology.ground_disk, dtype=int)
    return Response(
        **{f.name: getattr(found, f.name) for f in dataclasses.fields(found)},
        rpm=xp.asarray(rpm, dtype=float),
        load_torque=problem.load_torque,
        load_power=problem.load_power,
        ground_reaction=xp.asarray(train.grounds.stiffness) * found.angles[ground, 0].real,
        radius=xp.asarray(train.disks.radius),
        law=jax.tree.map(xp.asarray, law_of(train.meshes)),
        status=outcome.status,
        residual=outcome.residual,
        truncation_error=outcome.truncation_error,
        power_defect=outcome.power_defect,
        steps=outcome.steps,
        topology=topology,
        # A multiple of the samples, so that extremes are no smaller than theirs, and enough for few harmonics too.
        resolution=sizes.samples * max(1, -(-FEWEST_SAMPLES // sizes.samples)),
        train=train,
    )


def _speeds_in_batch(plan, disks):
    """How many speeds one device solves side by side under a plan; with 1 there are no batches."""
    # A linear solve by itself is the same bits whatever speeds are asked for beside it.
    alone = not plan.active or disks >= BATCH.alone_disks or plan.harmonics >= BATCH.alone_harmonics
    return 1 if alone and jax.default_backend() == "cpu" else BATCH.speeds


def solve_batches(train, rpm, plan, max_steps, devices=()):
    """Yield lists of Responses at the speeds ``(n,)`` under one plan, batch after batch, in order.

    Across several devices, each has as many speeds of a batch as one has alone.
    """
    count = max(len(devices), 1)
    size = count * _speeds_in_batch(plan, train.topology.n_disks)
    if size == 1 or len(rpm) == 1:
        begin = first_start(plan, marches=plan.marches)
        for speed in map(float, rpm):
            yield [solve_once(train, speed, problem_at(train, speed, plan.sizes.excited), plan, begin)[0]]
        return
    for first in range(0, len(rpm), size):
        yield _solve_batch(train, rpm[first : first + size], plan, size, max_steps, devices)


def _axes():
    """Of a batch of problems only what depends on speed has a leading axis."""
    return Problem(system=None, meshes=None, frequency=0, load=0, rigid=None, load_torque=0, load_power=0)


@partial(Program, static_argnames="excited")
def _problems_at(train, rpm, excited):
    return jax.vmap(lambda speed: problem_at(train, speed, excited), out_axes=_axes())(rpm)


@partial(Program, static_argnames="sizes")
def _solve_all(problem, active_meshes, start, limit, sizes):
    def one(problem):
        return solve_problem(problem, active_meshes, start, limit, sizes)

    return jax.vmap(one, in_axes=(_axes(),))(problem)


def _across(devices, sizes):
    """The program of a batch whose speeds are shared among devices."""
    given = jax.tree.map(lambda axis: WHOLE if axis is None else along(axis), _axes(), is_leaf=lambda a: a is None)
    return across(_solve_all, devices, (given, WHOLE, WHOLE, WHOLE), along(0), sizes=sizes)


def _solve_batch(train, rpm, plan, size, max_steps, devices):
    """Responses at up to ``size`` speeds, padded to a batch of that size."""
    padded = np.concatenate([rpm, np.full(size - len(rpm), rpm[-1])])
    problem = _problems_at(train, jnp.asarray(padded), plan.sizes.excited)
    sizes = dataclasses.replace(plan.sizes, max_steps=max_steps)
    given = problem, plan.active_meshes, first_start(plan, marches=plan.marches), plan.limit
    outcome = _across(devices, sizes)(*given) if len(devices) > 1 else _solve_all(*given, sizes)
    loads, outcome = jax.tree.map(np.asarray, ((problem.load_torque, problem.load_power), outcome))
    rows = []
    for i, speed in enumerate(rpm):
        row, (torque, power) = jax.tree.map(lambda leaf, i=i: leaf[i], (outcome, loads))
        own = dataclasses.replace(problem, load_torque=torque, load_power=power)
        rows.append(_response_of(train, speed, own, row, plan))
    return rows

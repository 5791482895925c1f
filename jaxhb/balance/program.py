"""Solves under a plan: one problem or a batch of them, eager or traced. No decisions by
value, no names.

A compiled solve makes sweeps, where a plan begins with them, and ends with Newton's
method where these do not solve the equations; it estimates the truncation error, and
gives what it found its derivative.
"""

import dataclasses
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import sequential_vmap

from jaxhb._jax import check_settings, namespace, on_host, staged, traced
from jaxhb._program import WHOLE, Program, across, along
from jaxhb._threads import side_by_side
from jaxhb.balance import correction, derivative, sweeps
from jaxhb.balance.march import InstantSolve, modes_of_model
from jaxhb.balance.newton import solve_chain, solve_reduced
from jaxhb.balance.outcome import Ended, conclude, linear_outcome, relative_force_change
from jaxhb.balance.plan import check_plan, time_steps_of
from jaxhb.balance.problem import (
    Problem,
    force_balance,
    model_of,
    problem_at,
    reduced_equation,
)
from jaxhb.balance.sizes import relative_residual
from jaxhb.balance.sweeps import SweepPlan
from jaxhb.equations import backlash, condensation, fourier
from jaxhb.equations.backlash import law_of
from jaxhb.integration.step import force_on_flank, stepper_of
from jaxhb.results.response import Response
from jaxhb.results.status import Newton, Status, Sweeps
from jaxhb.train.changes import within_range
from jaxhb.train.speeds import HIGHEST_RPM, check_speed

# Relative residual, a few times that of a settled march, from which Newton's method
# takes longer than a march.
MARCH_ABOVE = 3e-4
# Change of the vibration in the last sweep from which sweeps may be going astray, as
# where no motion that repeats attracts, and cycles that are marched beside them then.
UNSETTLED = 1e-3
MARCHED = 3
ESTIMATE = (
    0.01,
    20,
    # Share of the residual that the correction of an estimate may leave, and its Krylov
    # steps at most
)
# Share of the vibration that sweeps may leave to Newton's method, which is quick from
# there
START_SETTLED = 1e-4
FEWEST_SAMPLES = 4096  # per cycle, at which extremes of a response are looked for
# Speeds that one program solves side by side where contacts are unknowns, on
# accelerators: one NVIDIA H200 takes 8.7 ms a speed for 64, and not longer for a batch
# of 1024 than for eight of 64.
BATCH_SPEEDS = 64
# The same where teeth stay in contact; of fewer each is solved by itself, without one
# more program.
LINEAR_SPEEDS = 64


@partial(Program, static_argnames="plan")
def solve_problem(problem, active_meshes, start, goals, plan):
    """The Outcome of one Problem and its ActiveMeshes under a :attr:`Plan.static` and
    :attr:`Plan.goals`.

    start : coefficients ``(G, N+1)`` m; whether they are where Newton's method starts,
    and not teeth in contact; sweeps from teeth on their drive sides at most (beside a
    given start only if ``plan.compare_starts`` and it leaves more than MARCH_ABOVE of
    the equations: the better of the two is then the start); share of the vibration at
    which they end.
    """
    # The iteration is not differentiated: the implicit function theorem gives the
    # derivative of what it found.
    frozen = lax.stop_gradient((problem, start, goals))
    return differentiable(
        problem, active_meshes, find(frozen[0], active_meshes, *frozen[1:], plan), plan
    )


def differentiable(problem, active_meshes, found, plan):
    """The Outcome that :func:`find` found, with its derivative with respect to
    ``problem``.
    """
    outcome, at, solved = found
    given = problem, active_meshes, at, solved, outcome.fields, outcome.deflection
    fields, deflection = derivative.attach(plan, *given)
    return dataclasses.replace(outcome, fields=fields, deflection=deflection)


def find(problem, active_meshes, start, goals, plan):
    """The Outcome without derivatives, what :func:`derivative.attach` needs of its
    motion, whether it solves.
    """
    find_one = partial(_find, plan=plan)
    if len(active_meshes.mask) and jax.default_backend() == "cpu":
        # Under vmap one after another: side by side each step of each loop would be
        # that of the slowest.
        find_one = sequential_vmap(find_one)
    return find_one(problem, active_meshes, start, goals)


def _find(problem, active_meshes, start, goals, plan):
    harmonics = plan.harmonics
    none = len(active_meshes.mask) == 0
    (limit, tolerance, step_tolerance) = goals
    # The estimate of the truncation error asks for receptances of 2 N harmonics: made
    # once, cut for the solve.
    reach = 2 * harmonics if plan.estimated and not none else harmonics
    fine, condensed = reduced_equation(problem, reach, active_meshes)
    # The block sweep samples the law.
    integrals = plan.integrals if plan.method == "chain" else plan.force_integrals
    reduced = dataclasses.replace(
        condensation.truncate(fine, harmonics), integrals=integrals
    )
    error = jnp.zeros(())
    truncation = jnp.zeros(())
    begin = Begin(reduced.linear, jnp.array(0), jnp.zeros(()), jnp.array(jnp.inf))
    train = None
    steps = jnp.array(0)
    stalled = jnp.array(False)
    small_step = jnp.array(False)
    deflection = reduced.linear
    if not none:
        sweep_plan = _sweep_plan(problem, plan)
        equation = _sweep_equation(problem, active_meshes, reduced, sweep_plan)
        train = correction.linear_train(equation, sweep_plan.steps)
        begin = _first(reduced, equation, start, goals, plan, sweep_plan)
        if plan.method == "chain":
            deflection, iterate = _by_chain(
                problem, active_meshes, reduced, condensed, begin.deflection, plan
            )
            error = relative_residual(
                reduced, reduced.residual(deflection, plan.samples)
            )
        else:
            goal = {
                "tolerance": tolerance,
                "step_tolerance": step_tolerance,
                "max_steps": plan.max_steps,
            }
            goal |= {"samples": plan.samples, "step": begin.distance}
            iterate = solve_reduced(reduced, train, begin.deflection, **goal)
            deflection = iterate.x
            error = iterate.error
            small_step = iterate.step < step_tolerance
        if plan.estimated:
            truncation = truncation_error(fine, train, deflection, plan)
        steps = iterate.steps
        stalled = iterate.stalled
    reduced = reduced.with_crossings(deflection)
    nonlinear_force = reduced.nonlinear_force_coefficients(deflection, plan.samples)
    ended = Ended(
        deflection=deflection,
        settled=(error <= tolerance) | small_step,
        stalled=stalled,
        steps=steps,
        error=error,
        sweeps=begin.sweeps,
        periodicity_error=begin.change,
        truncation_error=truncation,
    )
    given = problem, active_meshes, reduced, condensed
    outcome, crossings = conclude(*given, nonlinear_force, ended, limit, plan.samples)
    return outcome, (train, crossings), outcome.status <= Status.TOLERANCE_NOT_MET


def _sweep_plan(problem, plan):
    """The :class:`SweepPlan` of a plan: its harmonics and samples, so that sweeps solve
    the equations of the plan.
    """
    steps = max(plan.time_steps, time_steps_of(plan.harmonics))
    instant = InstantSolve.of(problem.meshes.springs)
    return SweepPlan(
        steps, instant, most_harmonics=plan.harmonics, law_samples=plan.samples
    )


def _sweep_equation(problem, active_meshes, reduced, sweep_plan):
    """The :class:`~jaxhb.balance.sweeps.SweepEquation` of a condensed equation."""
    modes = modes_of_model(model_of(problem, active_meshes, sweep_plan.steps))
    return sweeps.sweep_equation(
        condensation.truncate(reduced, sweep_plan.harmonics), modes, sweep_plan
    )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Begin:
    """Where Newton's method starts: deflections ``(G, N+1)`` m; how many sweeps led
    there, 0 for none, by how much of the vibration the last of them changed it, and how
    much of it may be left to the solution.
    """

    deflection: jax.Array
    sweeps: jax.Array
    change: jax.Array
    distance: jax.Array


def _first(reduced, equation, start, goals, plan, sweep_plan):
    """The :class:`Begin` of a ``start`` of :func:`solve_problem`, which solves if
    sweeps do.
    """
    coefficients, given, most, goal = start
    at_hand = jnp.where(given, coefficients, deflections_on_flank(reduced))
    unswept = Begin(at_hand, jnp.array(0), jnp.zeros(()), jnp.array(jnp.inf))
    if not plan.marches:
        return unswept
    # Which start leaves less the samples tell as well as exact integrals.
    integrals = "sampled" if reduced.integrals == "exact" else reduced.integrals
    of_starts = dataclasses.replace(reduced, integrals=integrals)

    def left(deflection):
        return relative_residual(
            of_starts, of_starts.residual(deflection, plan.samples)
        )

    def swept():
        return by_sweeps(equation, plan.harmonics, sweep_plan, most, goal, goals, left)

    if not plan.compare_starts:
        return lax.cond(most > 0, swept, lambda: unswept)

    def better():
        other = swept()
        worse = lax.cond(
            compared,
            lambda found: ~(left(found) < remaining),
            lambda _: False,
            other.deflection,
        )
        return jax.tree.map(partial(jnp.where, worse), unswept, other)

    compared = given & (most > 0)
    remaining = lax.cond(compared, left, lambda _: jnp.inf, at_hand)
    return lax.cond((most > 0) & (remaining > MARCH_ABOVE), better, lambda: unswept)


def deflections_on_flank(reduced):
    """Deflections ``(G, N+1)`` with every mesh on its drive side all cycle."""
    held = (
        jnp.zeros_like(reduced.linear)
        .at[:, 0]
        .set(force_on_flank(reduced.law, reduced.linear))
    )
    return reduced.linear - reduced.respond(held)


def reduced_stepper(
    reduced, model, time_steps, linear, variation, residual_flexibility=None
):
    """The :class:`~jaxhb.integration.step.Stepper` of a condensed equation and its
    ReducedOrderModel, ``time_steps`` steps per cycle.
    """
    states = (
        jnp.zeros(len(model.at_rest)),
        model.at_rest @ force_on_flank(reduced.law, reduced.linear),
    )
    given = reduced.frequency, time_steps, *states, residual_flexibility
    return stepper_of(model.space, reduced, linear, variation, *given)


def by_sweeps(equation, harmonics, plan, most, goal, goals, left):
    """The :class:`Begin` to which at most so many sweeps from the drive sides lead,
    near the end more of them.

    They end where they solve the equations as the ``goals`` of a plan want it, or where
    ``goal`` of the vibration is left and so many more would not; where they do not
    settle, the last of a few cycles marched if that leaves less of the equations; on
    the flanks where the steps were too long for the train. left : what deflections
    leave of the equations.
    """
    _, tolerance, step_tolerance = goals
    exact = step_tolerance == 0
    first = sweeps.first_point(equation)
    nearer = jnp.where(exact, goal, jnp.minimum(goal, step_tolerance))
    ended = sweeps.settle(
        equation, first, plan, nearer, most, jnp.where(exact, tolerance, 0.0)
    )
    swept = fourier.resize(ended.deflection, harmonics)

    def better():
        def march(_, carry):
            return sweeps.marched(equation, carry[0], plan)

        _, deflection = lax.fori_loop(0, MARCHED, march, (first, ended.deflection))
        marched = fourier.resize(deflection, harmonics)
        return jnp.where(left(marched) < left(swept), marched, swept)

    settled = ended.change < UNSETTLED
    deflection = lax.cond(settled, lambda: swept, better)
    finite = jnp.all(jnp.isfinite(deflection))
    deflection = jnp.where(finite, deflection, deflections_on_flank(equation.equation))
    return Begin(
        deflection,
        ended.marches,
        ended.change,
        jnp.where(settled & finite, ended.distance, jnp.inf),
    )


def _by_chain(problem, active_meshes, reduced, condensed, start, plan):
    """Newton on all disks by the block sweep; meshes held on a flank follow the whole
    law here.
    """
    meshes = problem.meshes
    displacement, _ = condensed.combine(
        reduced.nonlinear_force_coefficients(start, plan.samples)
    )
    balance = force_balance(problem, displacement.shape[-1] - 1, plan.samples)
    iterate, deflection = solve_chain(
        balance, fourier.pack(displacement), tolerance=1e-13, max_steps=plan.max_steps
    )
    teeth = backlash.less_error(meshes, deflection[meshes.link])
    return teeth[active_meshes.index] * active_meshes.mask[:, None], iterate


@partial(Program, static_argnames="plan")
def estimate(problem, active_meshes, deflection, plan):
    """The truncation error of a motion found without it: deflections ``(G, N+1)`` of
    the active meshes.
    """
    fine, _ = reduced_equation(problem, 2 * plan.harmonics, active_meshes)
    sweep_plan = _sweep_plan(problem, plan)
    reduced = condensation.truncate(fine, plan.harmonics)
    equation = _sweep_equation(problem, active_meshes, reduced, sweep_plan)
    return truncation_error(
        fine, correction.linear_train(equation, sweep_plan.steps), deflection, plan
    )


def truncation_error(fine, train, deflection, plan):
    """Estimated sup-norm error of the elastic force / its largest value: one Newton
    correction on 2 N harmonics.

    ``fine`` is the condensed equation with 2 N harmonics, ``deflection`` ``(G, N+1)``
    its solution with N harmonics. The residual on harmonics N+1 .. 2N is included:
    below the mesh modes a difference of two levels is no estimate.
    """
    samples = 2 * plan.samples
    wide = fourier.resize(deflection, fine.linear.shape[-1] - 1)
    slopes = correction.slopes_at(fine, wide, samples)
    value = fine.residual(wide, samples)
    change, left, _ = correction.correct(
        fine, correction.march_at(train, slopes), slopes, value, *ESTIMATE
    )
    taken = relative_force_change(fine, fine.sampled(wide, samples), (change,))
    return taken / (1 - jnp.minimum(left, 0.999))


def active_deflections(plan, deflections):
    """Deflections ``(..., G, n+1)`` m of the active meshes of a plan, from those of all
    ``(..., M, n+1)``.
    """
    return (
        deflections[..., plan.active_meshes.index, :] * plan.active_meshes.mask[:, None]
    )


def first_start(plan, *, marches=False, given=None, xp=np):
    """``start`` of :func:`solve_problem`: teeth in contact, marched on or not, or given
    deflections ``(G, n+1)``.
    """
    if given is None:
        nothing = np.zeros(
            (len(plan.active_meshes.mask), plan.harmonics + 1), dtype=complex
        )
        return (
            nothing,
            np.array(False),
            np.array(plan.cycles if marches else 0),
            START_SETTLED,
        )
    return (
        fourier.resize(xp.asarray(given), plan.harmonics),
        np.array(True),
        np.array(0),
        START_SETTLED,
    )


def solve_planned(train, rpm, plan, start=None):
    """Response under a plan, from a Response or "linear" or "march" instead of the
    start that the plan has.
    """
    check_plan(train, plan)
    if start is None and plan.start == "response":
        raise ValueError(
            f"{train.topology.title}: no start that a plan holds leads to its motion:"
            " solve without a plan and give that response as start."
        )
    if not traced(rpm):
        check_speed(train, rpm)
        rpm = np.asarray(rpm, dtype=float)
    begin = first_start(
        plan, marches=plan.marches if start is None else start == "march"
    )
    if start == "march":
        plan = dataclasses.replace(plan, start=start)
    if isinstance(start, Response):
        coefficients, _, *others = first_start(
            plan, given=active_deflections(plan, start.deflections), xp=jnp
        )
        # Under jit a response that is not solved is nan, and no start.
        begin = coefficients, jnp.isfinite(coefficients).all(), *others
    if traced(train, rpm, begin) or staged():
        response = _solve_traced(
            train, rpm, begin, plan.active_meshes, plan.goals, plan.static
        )
        return dataclasses.replace(response, train=train)
    return solve_once(
        train, rpm, problem_at(train, rpm, plan.static.excited), plan, begin
    )[0]


@partial(Program, static_argnames="plan")
def _solve_traced(train, rpm, begin, active_meshes, goals, plan):
    """One program for all of it: piece by piece, differentiation outside ``jit``
    compiles a hundred small ones.
    """
    finite = derivative.all_finite((train, rpm))
    # Not ``rpm > 0``: nan is not out of range but not finite, and has its own status.
    valid = within_range(train) & ~((rpm <= 0) | (rpm > HIGHEST_RPM))
    train, rpm = derivative.only_if(finite & valid, (train, rpm), plan.failed_gradient)
    problem = problem_at(train, rpm, plan.excited)
    outcome = solve_problem(problem, active_meshes, begin, goals, plan)
    status = jnp.where(finite, outcome.status, Status.NONFINITE)
    outcome = dataclasses.replace(
        outcome, status=jnp.where(valid, status, Status.INVALID_INPUT)
    )
    response = respond(train, rpm, problem, outcome, plan)
    # nan for all that was computed if it is not solved, and derivatives as the plan
    # wants them.
    given = (
        "rpm",
        "radius",
        "law",
        "topology",
        "resolution",
        "sharp",
        "train",
        "path",
        "certificate",
    )
    found = {
        f.name: getattr(response, f.name)
        for f in dataclasses.fields(response)
        if f.name not in given
    }
    return dataclasses.replace(
        response, **derivative.only_known(response.solved, found)
    )


def respond(train, rpm, problem, outcome, plan):
    """Assemble the :class:`Response` of an outcome."""
    found = outcome.fields
    topology = train.topology
    xp = namespace(outcome.fields)
    ground = np.array(topology.ground_disk, dtype=int)
    return Response(
        **{f.name: getattr(found, f.name) for f in dataclasses.fields(found)},
        rpm=xp.asarray(rpm, dtype=float),
        load_torque=problem.load_torque,
        load_power=problem.load_power,
        ground_reaction=xp.asarray(train.grounds.stiffness)
        * found.angles[ground, 0].real,
        radius=xp.asarray(train.disks.radius),
        law=jax.tree.map(xp.asarray, law_of(train.meshes)),
        status=outcome.status,
        residual=outcome.residual,
        truncation_error=outcome.truncation_error,
        power_defect=outcome.power_defect,
        steps=outcome.steps,
        topology=topology,
        # A multiple of the samples, so that extremes are no smaller than theirs, and
        # enough for few harmonics too.
        resolution=plan.samples * max(1, -(-FEWEST_SAMPLES // plan.samples)),
        sharp=outcome.deflection.shape[-2] > 0,  # an active mesh at least
        train=train,
    )


def solve_once(train, rpm, problem, plan, begin):
    """The Response with numpy arrays, and the Outcome, of one eager solve."""
    outcome = _of_the_host(problem, plan)
    if outcome is None:
        outcome = solve_problem(
            problem, plan.active_meshes, begin, plan.goals, plan.static
        )
        outcome = jax.tree.map(np.asarray, outcome)
    return (
        response_of(train, rpm, problem, outcome, plan, _newtons_path(outcome, plan)),
        outcome,
    )


def _of_the_host(problem, plan):
    """The Outcome of teeth that a plan holds in contact, without a program; None where
    it wants one.
    """
    if plan.active or plan.integrals == "exact":
        return None
    check_settings()  # as programs do
    limit, *_ = plan.goals
    with np.errstate(all="ignore"):  # the status tells of numbers that are not finite
        return linear_outcome(
            on_host(problem),
            plan.active_meshes,
            plan.harmonics,
            limit,
            plan.static.samples,
        )


def response_of(train, rpm, problem, outcome, plan, path):
    """The Response of an Outcome with numpy arrays, its train and the events that led
    to it.
    """
    response = jax.tree.map(np.asarray, respond(train, rpm, problem, outcome, plan))
    return dataclasses.replace(response, train=train, path=tuple(path))


def _newtons_path(outcome, plan):
    """The events of a solve under a plan."""
    status = Status(int(outcome.status))
    steps = int(outcome.steps)
    swept = int(outcome.sweeps)
    newton = Newton(plan.harmonics, len(plan.active), plan.integrals, status, steps)
    begun = Sweeps(swept, plan.time_steps, float(outcome.periodicity_error))
    return (begun, newton) if swept else (newton,)


def solve_batches(train, rpm, plan, devices=()):
    """Yield lists of Responses at the speeds ``(n,)`` under one plan, batch after
    batch, in order.

    Across several devices, each has as many speeds of a batch as one has alone.
    """
    # With contacts as unknowns a speed fills a processor, and a batch waits for its
    # slowest and compiles longer.
    size = (
        LINEAR_SPEEDS
        if not plan.active
        else 1
        if jax.default_backend() == "cpu"
        else BATCH_SPEEDS
    )
    size *= max(len(devices), 1)
    begin, static = first_start(plan, marches=plan.marches), plan.static
    if size == 1 or len(rpm) == 1 or not plan.active and len(rpm) < size:

        def alone(speed):
            return solve_once(
                train, speed, problem_at(train, speed, static.excited), plan, begin
            )[0]

        yield from (
            [response] for response in side_by_side(alone, rpm.tolist(), devices)
        )
        return
    solve = partial(_solve_all, plan=static)
    if len(devices) > 1:
        axes = problem_axes()
        given = jax.tree.map(
            lambda axis: WHOLE if axis is None else along(axis),
            axes,
            is_leaf=lambda a: a is None,
        )
        solve = across(
            _solve_all, devices, (given, WHOLE, WHOLE, WHOLE), along(0), plan=static
        )
    for first in range(0, len(rpm), size):
        speeds = rpm[first : first + size]
        padded = np.concatenate([speeds, np.full(size - len(speeds), speeds[-1])])
        problem = problems_at(train, jnp.asarray(padded), static.excited)
        outcome = solve(problem, plan.active_meshes, begin, plan.goals)
        loads, outcome = jax.tree.map(
            np.asarray, ((problem.load_torque, problem.load_power), outcome)
        )
        responses = []
        for i, speed in enumerate(speeds):
            row, (torque, power) = jax.tree.map(
                lambda leaf, i=i: leaf[i], (outcome, loads)
            )
            own = dataclasses.replace(problem, load_torque=torque, load_power=power)
            responses.append(
                response_of(train, speed, own, row, plan, _newtons_path(row, plan))
            )
        yield responses


def problem_axes():
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
def problems_at(train, rpm, excited):
    """The Problem of a train at speeds ``(n,)``, with the axes of
    :func:`problem_axes`.
    """
    return jax.vmap(
        lambda speed: problem_at(train, speed, excited), out_axes=problem_axes()
    )(rpm)


@partial(Program, static_argnames="plan")
def _solve_all(problem, active_meshes, start, goals, plan):
    given = active_meshes, start, goals, plan
    return jax.vmap(
        lambda problem: solve_problem(problem, *given), in_axes=(problem_axes(),)
    )(problem)

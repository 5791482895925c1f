"""Solves under a plan: one problem or a batch of them, eager or traced. No decisions by
value, no names.

A compiled solve makes sweeps, where a plan begins with them, and ends with Newton's
method where these do not solve the equations; it estimates the truncation error, and
attaches the derivative to the solution.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import sequential_vmap

from jaxhb._jax import Array, Number, check_settings, namespace, on_host, staged, traced
from jaxhb._program import WHOLE, Program, across, along
from jaxhb._threads import side_by_side
from jaxhb.balance import correction, derivative, sweeps
from jaxhb.balance.march import InstantSolve, modes_of_model
from jaxhb.balance.newton import Iterate, solve_chain, solve_reduced
from jaxhb.balance.outcome import (
    IterationEnd,
    Outcome,
    Solution,
    conclude,
    linear_outcome,
    relative_force_change,
)
from jaxhb.balance.plan import (
    Goals,
    Plan,
    ProgramShape,
    check_plan,
    time_steps_of,
)
from jaxhb.balance.problem import (
    ActiveMeshes,
    Problem,
    force_balance,
    model_of,
    problem_at,
    reduced_equation,
)
from jaxhb.balance.sizes import relative_residual
from jaxhb.balance.sweeps import SweepEquation, SweepPlan, SweepPoint
from jaxhb.equations import backlash, condensation, fourier
from jaxhb.equations.condensation import CondensedEquation, CondensedTrain
from jaxhb.equations.fourier import SAMPLES_PER_HARMONIC
from jaxhb.integration.step import force_on_flank
from jaxhb.results.response import Response
from jaxhb.results.status import Newton, Status, Sweeps
from jaxhb.train.changes import within_range
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.mesh_parameters import law_of
from jaxhb.train.speeds import HIGHEST_RPM, check_speed
from jaxhb.train.varying import at_speed

# Relative residual, a few times that of a settled march, from which Newton's method
# takes longer than a march.
MARCH_ABOVE = 3e-4
# Change of the vibration in the last sweep from which sweeps may be going astray, as
# where no motion that repeats attracts, and number of cycles that are marched then
UNSETTLED = 1e-3
MARCHED = 3
# Share of the residual that the correction of an estimate may leave, and its Krylov
# steps at most
ESTIMATE = (0.01, 20)
# Share of the vibration that sweeps may leave to Newton's method, which is quick from
# there
START_SETTLED = 1e-4
FEWEST_SAMPLES = 4096  # per cycle, at which extremes of a response are looked for
# Speeds that one program solves side by side where contacts are unknowns, on
# accelerators: one NVIDIA H200 takes 8.7 ms a speed for 64, and not longer for a batch
# of 1024 than for eight of 64.
BATCH_SPEEDS = 64
# The same where teeth stay in contact; fewer speeds are solved one by one, without one
# more program.
LINEAR_SPEEDS = 64


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Start:
    """Start of a solve.

    deflection : ``(G, N+1)`` m; is_given : whether Newton's method starts from it, and
    not from teeth in contact; sweeps : from teeth on their drive sides at most (beside
    a given start only if ``compare_starts`` of the :class:`ProgramShape` and it leaves
    more than MARCH_ABOVE of the equations: the better of the two is then the start);
    settled : share of the vibration at which they end.
    """

    deflection: Array
    is_given: Array
    sweeps: Array
    settled: Array


@partial(Program, static_argnames="shape")
def solve_problem(
    problem: Problem,
    active_meshes: ActiveMeshes,
    start: Start,
    goals: Goals,
    shape: ProgramShape,
) -> Outcome:
    """The Outcome of one Problem and its ActiveMeshes, from a Start to the Goals."""
    # The iteration is not differentiated: the implicit function theorem gives the
    # derivative of its solution.
    frozen, start, goals = lax.stop_gradient((problem, start, goals))
    solution = find(frozen, active_meshes, start, goals, shape)
    return differentiable(problem, active_meshes, solution, shape)


def differentiable(
    problem: Problem,
    active_meshes: ActiveMeshes,
    solution: Solution,
    shape: ProgramShape,
) -> Outcome:
    """The Outcome of a Solution, with its derivative with respect to ``problem``."""
    fields, deflection = derivative.attach(shape, problem, active_meshes, solution)
    return dataclasses.replace(solution.outcome, fields=fields, deflection=deflection)


def find(
    problem: Problem,
    active_meshes: ActiveMeshes,
    start: Start,
    goals: Goals,
    shape: ProgramShape,
) -> Solution:
    """The Solution of a problem, for :func:`differentiable`."""
    solve = partial(_find, shape=shape)
    if len(active_meshes.mask) and jax.default_backend() == "cpu":
        # Under vmap one after another: side by side each step of each loop would be
        # that of the slowest.
        solve = sequential_vmap(solve)
    return solve(problem, active_meshes, start, goals)


def _find(
    problem: Problem,
    active_meshes: ActiveMeshes,
    start: Start,
    goals: Goals,
    shape: ProgramShape,
) -> Solution:
    harmonics = shape.harmonics
    is_linear = len(active_meshes.mask) == 0
    # The estimate of the truncation error needs receptances of 2 N harmonics: made
    # once, cut for the solve.
    reach_harmonics = 2 * harmonics if shape.estimated and not is_linear else harmonics
    fine, condensed = reduced_equation(problem, reach_harmonics, active_meshes)
    # The block sweep samples the law.
    integrals = shape.integrals if shape.method == "chain" else shape.force_integrals
    reduced = dataclasses.replace(
        condensation.truncate(fine, harmonics), integrals=integrals
    )
    error: Array = jnp.zeros(())
    truncation: Array = jnp.zeros(())
    newton_start = _unswept_start(reduced.linear)
    linear_train = None
    steps: Array = jnp.array(0)
    stalled: Array = jnp.array(False)
    small_step: Array = jnp.array(False)
    deflection: Array = reduced.linear
    if not is_linear:
        sweep_plan = _sweep_plan(problem, shape)
        equation = _sweep_equation(problem, active_meshes, reduced, sweep_plan)
        linear_train = correction.linear_train(equation, sweep_plan.steps)
        newton_start = _newton_start(reduced, equation, start, goals, shape, sweep_plan)
        if shape.method == "chain":
            deflection, iterate = _by_chain(
                problem,
                active_meshes,
                reduced,
                condensed,
                newton_start.deflection,
                shape,
            )
            error = relative_residual(
                reduced, reduced.residual(deflection, shape.samples)
            )
        else:
            iterate = solve_reduced(
                reduced,
                linear_train,
                newton_start.deflection,
                samples=shape.samples,
                tolerance=goals.residual,
                max_steps=shape.max_steps,
                step_tolerance=goals.step,
                distance=newton_start.distance,
            )
            deflection = iterate.x
            error = iterate.error
            small_step = iterate.step < goals.step
        if shape.estimated:
            truncation = truncation_error(fine, linear_train, deflection, shape)
        steps = iterate.steps
        stalled = iterate.stalled
    reduced = reduced.with_crossings(deflection)
    nonlinear_force = reduced.nonlinear_force_coefficients(deflection, shape.samples)
    ended = IterationEnd(
        deflection=deflection,
        settled=(error <= goals.residual) | small_step,
        stalled=stalled,
        steps=steps,
        error=error,
        sweeps=newton_start.sweeps,
        periodicity_error=newton_start.change,
        truncation_error=truncation,
    )
    outcome, crossings = conclude(
        problem,
        active_meshes,
        reduced,
        condensed,
        nonlinear_force,
        ended,
        goals.truncation,
        shape.samples,
    )
    solved = outcome.status <= Status.TOLERANCE_NOT_MET
    return Solution(outcome, linear_train, crossings, solved)


def _sweep_plan(problem: Problem, shape: ProgramShape) -> SweepPlan:
    """The :class:`SweepPlan` with the harmonics and samples of a program, so that
    sweeps solve its equations.
    """
    steps = max(shape.time_steps, time_steps_of(shape.harmonics))
    instant = InstantSolve.of(problem.meshes.springs)
    return SweepPlan(
        steps, instant, most_harmonics=shape.harmonics, law_samples=shape.samples
    )


def _sweep_equation(
    problem: Problem,
    active_meshes: ActiveMeshes,
    reduced: CondensedEquation,
    sweep_plan: SweepPlan,
) -> SweepEquation:
    """The :class:`~jaxhb.balance.sweeps.SweepEquation` of a condensed equation."""
    modes = modes_of_model(model_of(problem, active_meshes, sweep_plan.steps))
    return sweeps.sweep_equation(
        condensation.truncate(reduced, sweep_plan.harmonics), modes, sweep_plan
    )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class NewtonStart:
    """Start of Newton's method: deflections ``(G, N+1)`` m; number of sweeps that led
    there, change of the vibration in the last of them, and distance to the solution
    that may be left, both as shares of the vibration.
    """

    deflection: Array
    sweeps: Array
    change: Array
    distance: Array


def _unswept_start(deflection: Array) -> NewtonStart:
    """The :class:`NewtonStart` with deflections that no sweep led to."""
    return NewtonStart(
        deflection=deflection,
        sweeps=jnp.array(0),
        change=jnp.zeros(()),
        distance=jnp.array(jnp.inf),
    )


def _newton_start(
    reduced: CondensedEquation,
    equation: SweepEquation,
    start: Start,
    goals: Goals,
    shape: ProgramShape,
    sweep_plan: SweepPlan,
) -> NewtonStart:
    """The :class:`NewtonStart` of a ``start`` of :func:`solve_problem`, which solves if
    sweeps do.
    """
    start_deflection = jnp.where(
        start.is_given, start.deflection, deflections_on_flank(reduced)
    )
    unswept = _unswept_start(start_deflection)
    if not shape.marches:
        return unswept
    # The samples tell as well as exact integrals which start leaves less.
    integrals = "sampled" if reduced.integrals == "exact" else reduced.integrals
    start_equation = dataclasses.replace(reduced, integrals=integrals)

    def residual_of(deflection: Array) -> Array:
        return relative_residual(
            start_equation, start_equation.residual(deflection, shape.samples)
        )

    def swept_start() -> NewtonStart:
        return by_sweeps(
            equation, shape.harmonics, sweep_plan, start, goals, residual_of
        )

    if not shape.compare_starts:
        return lax.cond(start.sweeps > 0, swept_start, lambda: unswept)

    def better_of_both() -> NewtonStart:
        by_sweeping = swept_start()
        is_worse = lax.cond(
            compared,
            lambda swept_deflection: ~(residual_of(swept_deflection) < remaining),
            lambda _: False,
            by_sweeping.deflection,
        )
        return jax.tree.map(partial(jnp.where, is_worse), unswept, by_sweeping)

    compared = start.is_given & (start.sweeps > 0)
    remaining = lax.cond(compared, residual_of, lambda _: jnp.inf, start_deflection)
    return lax.cond(
        (start.sweeps > 0) & (remaining > MARCH_ABOVE), better_of_both, lambda: unswept
    )


def deflections_on_flank(reduced: CondensedEquation) -> Array:
    """Deflections ``(G, N+1)`` with every mesh on its drive side all cycle."""
    held_forces = (
        jnp.zeros_like(reduced.linear)
        .at[:, 0]
        .set(force_on_flank(reduced.law, reduced.linear))
    )
    return reduced.linear - reduced.respond(held_forces)


def by_sweeps(
    equation: SweepEquation,
    harmonics: int,
    plan: SweepPlan,
    start: Start,
    goals: Goals,
    residual_of: Callable[[Array], Array],
) -> NewtonStart:
    """The :class:`NewtonStart` to which ``start.sweeps`` or less from the drive sides
    lead, near the end more of them.

    Sweeps end where they solve the equations to the ``goals``, or where
    ``start.settled`` of the vibration is left and as many more would not solve them.
    Where they do not settle, the last of a few cycles marched is taken if it leaves
    less of the equations; teeth on the flanks where the steps were too long for the
    train.
    residual_of : from deflections to their relative residual.
    """
    is_exact = goals.step == 0
    first_point = sweeps.first_point(equation)
    closer_goal = jnp.where(
        is_exact, start.settled, jnp.minimum(start.settled, goals.step)
    )
    ended = sweeps.settle(
        equation,
        first_point,
        plan,
        closer_goal,
        start.sweeps,
        jnp.where(is_exact, goals.residual, 0.0),
    )
    swept_deflection = fourier.resize(ended.deflection, harmonics)

    def better_of_both() -> Array:
        def march(
            _: Array, carry: tuple[SweepPoint, Array]
        ) -> tuple[SweepPoint, Array]:
            return sweeps.marched(equation, carry[0], plan)

        _, deflection = lax.fori_loop(
            0, MARCHED, march, (first_point, ended.deflection)
        )
        marched_deflection = fourier.resize(deflection, harmonics)
        return jnp.where(
            residual_of(marched_deflection) < residual_of(swept_deflection),
            marched_deflection,
            swept_deflection,
        )

    is_settled = ended.change < UNSETTLED
    deflection = lax.cond(is_settled, lambda: swept_deflection, better_of_both)
    is_finite = jnp.all(jnp.isfinite(deflection))
    deflection = jnp.where(
        is_finite, deflection, deflections_on_flank(equation.equation)
    )
    return NewtonStart(
        deflection=deflection,
        sweeps=ended.marches,
        change=ended.change,
        distance=jnp.where(is_settled & is_finite, ended.distance, jnp.inf),
    )


def _by_chain(
    problem: Problem,
    active_meshes: ActiveMeshes,
    reduced: CondensedEquation,
    condensed: CondensedTrain,
    start: Array,
    shape: ProgramShape,
) -> tuple[Array, Iterate]:
    """Newton's method on all disks by the block sweep, where meshes held on a flank
    follow the whole law: deflections ``(G, N+1)`` m of the active meshes, and Iterate.
    """
    meshes = problem.meshes
    displacement, _ = condensed.combine(
        reduced.nonlinear_force_coefficients(start, shape.samples)
    )
    balance = force_balance(problem, displacement.shape[-1] - 1, shape.samples)
    iterate, deflection = solve_chain(
        balance, fourier.pack(displacement), tolerance=1e-13, max_steps=shape.max_steps
    )
    teeth_deflection = backlash.less_error(meshes, deflection[meshes.link])
    return teeth_deflection[active_meshes.index] * active_meshes.mask[:, None], iterate


@partial(Program, static_argnames="shape")
def estimate(
    problem: Problem,
    active_meshes: ActiveMeshes,
    deflection: Array,
    shape: ProgramShape,
) -> Array:
    """The truncation error of a motion that was solved without it: deflections
    ``(G, N+1)`` m of the active meshes.
    """
    fine, _ = reduced_equation(problem, 2 * shape.harmonics, active_meshes)
    sweep_plan = _sweep_plan(problem, shape)
    reduced = condensation.truncate(fine, shape.harmonics)
    equation = _sweep_equation(problem, active_meshes, reduced, sweep_plan)
    return truncation_error(
        fine, correction.linear_train(equation, sweep_plan.steps), deflection, shape
    )


def truncation_error(
    fine: CondensedEquation,
    linear_train: correction.LinearTrain,
    deflection: Array,
    shape: ProgramShape,
) -> Array:
    """Estimated sup-norm error of the elastic force / its largest value: one Newton
    correction on 2 N harmonics.

    ``fine`` is the condensed equation with 2 N harmonics, ``deflection`` ``(G, N+1)``
    its solution with N harmonics. The residual on harmonics N+1 .. 2N is included:
    below the mesh modes a difference of two levels is no estimate.
    """
    samples = 2 * shape.samples
    fine_deflection = fourier.resize(deflection, fine.linear.shape[-1] - 1)
    slopes = correction.slopes_at(fine, fine_deflection, samples)
    value = fine.residual(fine_deflection, samples)
    forcing, krylov_steps = ESTIMATE
    change, left, _ = correction.correct(
        fine,
        correction.march_at(linear_train, slopes),
        slopes,
        value,
        forcing,
        krylov_steps,
    )
    force_change = relative_force_change(
        fine, fine.sampled(fine_deflection, samples), (change,)
    )
    return force_change / (1 - jnp.minimum(left, 0.999))


def active_deflections(plan: Plan, deflections: Array) -> Array:
    """Deflections ``(..., G, n+1)`` m of the active meshes of a plan, from those of all
    ``(..., M, n+1)``.
    """
    return (
        deflections[..., plan.active_meshes.index, :] * plan.active_meshes.mask[:, None]
    )


def first_start(
    plan: Plan, *, marches: bool = False, deflections: Array | None = None, xp: Any = np
) -> Start:
    """The Start with teeth in contact, marched on or not, or with ``deflections``
    ``(G, n+1)`` m.
    """
    if deflections is None:
        shape = (len(plan.active_meshes.mask), plan.harmonics + 1)
        deflection = np.zeros(shape, dtype=complex)
    else:
        deflection = fourier.resize(xp.asarray(deflections), plan.harmonics)
    return Start(
        deflection=deflection,
        is_given=np.array(deflections is not None),
        sweeps=np.array(plan.cycles if marches and deflections is None else 0),
        settled=np.array(START_SETTLED),
    )


def solve_planned(
    train: DriveTrain,
    rpm: Number,
    plan: Plan,
    start: Response | str | None = None,
) -> Response:
    """Response under a plan, from a Response or "linear" or "march" instead of the
    start of the plan.
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
        plan = dataclasses.replace(plan, start="march")
    if isinstance(start, Response):
        begin = first_start(
            plan, deflections=active_deflections(plan, start.deflections), xp=jnp
        )
        # Under jit a response that is not solved is nan, and no start.
        is_given = jnp.isfinite(begin.deflection).all()
        begin = dataclasses.replace(begin, is_given=is_given)
    if traced(train, rpm, begin) or staged():
        response = _solve_traced(
            train, rpm, begin, plan.active_meshes, plan.goals, plan.shape
        )
        return dataclasses.replace(response, train=train, topology=train.topology)
    return solve_once(
        train, rpm, problem_at(train, rpm, plan.shape.excited), plan, begin
    )[0]


@partial(Program, static_argnames="shape")
def _solve_traced(
    train: DriveTrain,
    rpm: Number,
    start: Start,
    active_meshes: ActiveMeshes,
    goals: Goals,
    shape: ProgramShape,
) -> Response:
    """Solve in one program: piece by piece, differentiation outside ``jit`` compiles a
    hundred small ones.
    """
    train = at_speed(train, rpm)
    is_finite = derivative.all_finite((train, rpm))
    # Not ``rpm > 0``: nan is not out of range but not finite, which is another status.
    is_valid = within_range(train) & ~((rpm <= 0) | (rpm > HIGHEST_RPM))
    train, rpm = derivative.only_if(
        is_finite & is_valid, (train, rpm), shape.failed_gradient
    )
    problem = problem_at(train, rpm, shape.excited)
    outcome = solve_problem(problem, active_meshes, start, goals, shape)
    status = jnp.where(is_finite, outcome.status, Status.NONFINITE)
    outcome = dataclasses.replace(
        outcome, status=jnp.where(is_valid, status, Status.INVALID_INPUT)
    )
    response = respond(train, rpm, problem, outcome)
    # nan for all computed fields if it is not solved, and derivatives as the plan says
    inputs = (
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
    computed = {
        field.name: getattr(response, field.name)
        for field in dataclasses.fields(response)
        if field.name not in inputs
    }
    return dataclasses.replace(
        response, **derivative.only_known(response.solved, computed)
    )


def respond(
    train: DriveTrain, rpm: Number, problem: Problem, outcome: Outcome
) -> Response:
    """Assemble the :class:`Response` of an outcome."""
    fields = outcome.fields
    constant = at_speed(train, rpm)
    samples = SAMPLES_PER_HARMONIC * (fields.angles.shape[-1] - 1)
    topology = train.topology
    xp = namespace(outcome.fields)
    ground = np.array(topology.ground_disk, dtype=int)
    return Response(
        angles=fields.angles,
        torques=fields.torques,
        elastic_torques=fields.elastic_torques,
        deflections=fields.deflections,
        forces=fields.forces,
        elastic_forces=fields.elastic_forces,
        rpm=xp.asarray(rpm, dtype=float),
        load_torque=problem.load_torque,
        load_power=problem.load_power,
        ground_reaction=xp.asarray(constant.grounds.stiffness)
        * fields.angles[ground, 0].real,
        radius=xp.asarray(train.disks.radius),
        law=jax.tree.map(xp.asarray, law_of(constant.meshes)),
        status=outcome.status,
        residual=outcome.residual,
        truncation_error=outcome.truncation_error,
        power_defect=outcome.power_defect,
        steps=outcome.steps,
        topology=topology,
        # A multiple of the samples, so that extremes are no smaller than theirs, and
        # enough for few harmonics too.
        resolution=samples * max(1, -(-FEWEST_SAMPLES // samples)),
        sharp=outcome.deflection.shape[-2] > 0,  # an active mesh at least
        train=train,
    )


def solve_once(
    train: DriveTrain, rpm: Number, problem: Problem, plan: Plan, start: Start
) -> tuple[Response, Outcome]:
    """The Response with numpy arrays, and the Outcome, of one eager solve."""
    outcome = _of_the_host(problem, plan)
    if outcome is None:
        outcome = solve_problem(
            problem, plan.active_meshes, start, plan.goals, plan.shape
        )
        outcome = jax.tree.map(np.asarray, outcome)
    path = _newtons_path(outcome, plan)
    return response_of(train, rpm, problem, outcome, path), outcome


def _of_the_host(problem: Problem, plan: Plan) -> Outcome | None:
    """The Outcome of teeth that a plan holds in contact, without a program; None where
    it needs one.
    """
    if plan.active or plan.integrals == "exact":
        return None
    check_settings()  # as programs do
    with np.errstate(all="ignore"):  # the status tells of numbers that are not finite
        return linear_outcome(
            on_host(problem),
            plan.active_meshes,
            plan.harmonics,
            plan.goals.truncation,
        )


def response_of(
    train: DriveTrain,
    rpm: Number,
    problem: Problem,
    outcome: Outcome,
    path: Iterable,
) -> Response:
    """The Response of an Outcome with numpy arrays, its train and the events that led
    to it.
    """
    response = jax.tree.map(np.asarray, respond(train, rpm, problem, outcome))
    return dataclasses.replace(response, train=train, path=tuple(path))


def _newtons_path(outcome: Outcome, plan: Plan) -> tuple[Sweeps | Newton, ...]:
    """The events of a solve under a plan."""
    status = Status(int(outcome.status))
    steps = int(outcome.steps)
    sweep_count = int(outcome.sweeps)
    newton = Newton(plan.harmonics, len(plan.active), plan.integrals, status, steps)
    sweeps_event = Sweeps(
        sweep_count, plan.time_steps, float(outcome.periodicity_error)
    )
    return (sweeps_event, newton) if sweep_count else (newton,)


def solve_batches(
    train: DriveTrain, rpm: np.ndarray, plan: Plan, devices: Sequence[jax.Device] = ()
) -> Iterator[list[Response]]:
    """Yield lists of Responses at the speeds ``(n,)`` under one plan, batch after
    batch, in order.

    Across several devices, each has as many speeds of a batch as one has alone.
    """
    # With contacts as unknowns a speed fills a processor, and a batch waits for its
    # slowest speed and compiles longer.
    if not plan.active:
        size = LINEAR_SPEEDS
    elif jax.default_backend() == "cpu":
        size = 1
    else:
        size = BATCH_SPEEDS
    size *= max(len(devices), 1)
    start = first_start(plan, marches=plan.marches)
    shape = plan.shape
    one_system = not train.topology.depends_on_speed
    few = len(rpm) == 1 or not plan.active and len(rpm) < size
    if size == 1 or few or not one_system:

        def alone(speed: float) -> Response:
            return solve_once(
                train, speed, problem_at(train, speed, shape.excited), plan, start
            )[0]

        yield from (
            [response] for response in side_by_side(alone, rpm.tolist(), devices)
        )
        return
    solve: Callable[..., Outcome] = partial(_solve_all, shape=shape)
    if len(devices) > 1:
        axes = problem_axes()
        problem_specs = jax.tree.map(
            lambda axis: WHOLE if axis is None else along(axis),
            axes,
            is_leaf=lambda axis_or_none: axis_or_none is None,
        )
        solve = across(
            _solve_all,
            devices,
            (problem_specs, WHOLE, WHOLE, WHOLE),
            along(0),
            shape=shape,
        )
    for first in range(0, len(rpm), size):
        speeds = rpm[first : first + size]
        padded = np.concatenate([speeds, np.full(size - len(speeds), speeds[-1])])
        problem = problems_at(train, jnp.asarray(padded), shape.excited)
        outcome = solve(problem, plan.active_meshes, start, plan.goals)
        loads, outcome = jax.tree.map(
            np.asarray, ((problem.load_torque, problem.load_power), outcome)
        )
        responses = []
        for i, speed in enumerate(speeds):
            outcome_of_speed, (torque, power) = jax.tree.map(
                lambda leaf, i=i: leaf[i], (outcome, loads)
            )
            speed_problem = dataclasses.replace(
                problem, load_torque=torque, load_power=power
            )
            responses.append(
                response_of(
                    train,
                    speed,
                    speed_problem,
                    outcome_of_speed,
                    _newtons_path(outcome_of_speed, plan),
                )
            )
        yield responses


def problem_axes() -> Problem:
    """Axes of a batch of problems: what depends on speed has a leading one."""
    # Axes in place of arrays
    tree = cast(Any, Problem)
    return tree(
        system=None,
        meshes=None,
        frequency=0,
        load=0,
        rigid=None,
        load_torque=0,
        load_power=0,
    )


@partial(Program, static_argnames="excited")
def problems_at(train: DriveTrain, rpm: Array, excited: int) -> Problem:
    """The Problem of a train at speeds ``(n,)``, with the axes of
    :func:`problem_axes`.
    """
    return jax.vmap(
        lambda speed: problem_at(train, speed, excited), out_axes=problem_axes()
    )(rpm)


@partial(Program, static_argnames="shape")
def _solve_all(
    problem: Problem,
    active_meshes: ActiveMeshes,
    start: Start,
    goals: Goals,
    shape: ProgramShape,
) -> Outcome:
    return jax.vmap(
        lambda problem: solve_problem(problem, active_meshes, start, goals, shape),
        in_axes=(problem_axes(),),
    )(problem)

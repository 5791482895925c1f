"""Solution of one train at one speed by sweeps, with its status and the error of its
harmonics.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import partial

import jax
import numpy as np

from jaxhb._jax import Array, on_host
from jaxhb._program import Program
from jaxhb.balance import map_newton, sweeps
from jaxhb.balance.march import MarchModes
from jaxhb.balance.outcome import IterationEnd, Outcome, conclude, relative_force_change
from jaxhb.balance.problem import ActiveMeshes, Problem, linear_equation
from jaxhb.balance.sweeps import Settled, SweepEquation, SweepPlan, SweepPoint
from jaxhb.equations import condensation, fourier
from jaxhb.equations.condensation import CondensedEquation, CondensedTrain
from jaxhb.equations.system import System
from jaxhb.results.status import NewtonOnSweeps, Sweeps

MOST_SWEEPS = 12  # a motion that these do not settle needs Newton's method
# Marches of Newton's method at most: orbits of irregular trains that need more are
# rarely found at all; and from a motion at hand
MOST_MARCHES = 100
MARCHES_NEARBY = 50
# Multiple of F(l), and of the change that sweeps leave, by which the motion may be off:
# the inverse of the Jacobian, and changes that shrink more slowly later on. At 131
# speeds of ``gear_train_30``, with 5.5 steps a period of the fastest mode, the error by
# shooting was 0.7 of its estimate in the median, below 1.4 at nine of ten, and 2.3 at
# most; at 40 others, against four times the steps, 0.8, 1.0 and, beside a period
# doubling, 11.
AMPLIFIED = 1.5
# Difference of deflections, relative to the largest, up to which two motions are the
# same, and time samples for it
ARRIVED = 0.02
COMPARED = 1024
# Share of the tolerance that may be left of the vibration: peaks of forces are off by
# more
SETTLED = 0.03


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SweptProblem:
    """A Problem ready for sweeps: its equation with 2 N harmonics, the equation of the
    sweeps, and the point with all teeth on their drive sides.
    """

    fine: CondensedEquation
    sweeps: SweepEquation
    flank: SweepPoint


@partial(Program, static_argnames="plan")
def prepare(
    equation: CondensedEquation,
    system: System,
    columns: Array,
    modes: MarchModes,
    plan: SweepPlan,
) -> SweptProblem:
    """The :class:`SweptProblem` of a CondensedEquation with 2 N harmonics that lacks
    its receptances.
    """
    fine = condensation.with_receptances(equation, system, columns)
    equation_of_sweeps = sweeps.sweep_equation(
        condensation.truncate(fine, plan.harmonics), modes, plan
    )
    return SweptProblem(
        fine, equation_of_sweeps, sweeps.first_point(equation_of_sweeps)
    )


def conclude_sweeps(
    problem: Problem,
    active_meshes: ActiveMeshes,
    condensed: CondensedTrain,
    swept: SweptProblem,
    settled: Settled,
    tolerance: float,
    goal: float,
    plan: SweepPlan,
) -> Outcome:
    """The Outcome at the end of sweeps, with ``plan.motion_harmonics`` harmonics;
    settled where ``goal`` of the vibration or less is left.

    CONVERGED : the truncation error is ``tolerance`` of the largest elastic force or
    less. It is an estimate, no bound: omitted harmonics, F(l) on 2 N harmonics taken
    from the deflections once, and the distance to the fixed point. MAX_STEPS : the
    sweeps did not settle, or mean forces miss the mean torques. Computed on the host
    from arrays of the host: a program would take seconds to make and as long to run.
    """
    fine = swept.fine
    equation = swept.sweeps.equation
    retained = fourier.resize(settled.deflection, plan.motion_harmonics)
    samples = sweeps.WIDE_SAMPLES_PER_STEP * plan.steps
    nonlinear_force, residual, truncation = truncation_of(
        fine, settled.deflection, retained, samples, settled.left
    )
    vibration = sweeps.vibration_size(fine, settled.deflection)
    ended = IterationEnd(
        deflection=retained,
        settled=settled.distance <= goal,
        stalled=np.array(False),
        steps=settled.marches,
        error=sweeps.force_size(fine, residual[:, : plan.harmonics + 1]) / vibration,
        sweeps=settled.marches,
        periodicity_error=settled.change,
        truncation_error=truncation,
    )
    outcome, _ = conclude(
        problem,
        active_meshes,
        equation,
        condensed,
        fourier.resize(nonlinear_force, plan.motion_harmonics),
        ended,
        tolerance,
        samples=fourier.SAMPLES_PER_HARMONIC * plan.motion_harmonics,
    )
    return outcome


def truncation_of(
    fine: CondensedEquation,
    deflection: Array,
    retained: Array,
    samples: int,
    *left: Array,
) -> tuple[Array, Array, Array]:
    """phi in N and F in m of deflections ``(G, N+1)`` m, coefficients ``(G, 2N+1)``,
    and the estimated error of the ``retained`` ones, as a share of the largest elastic
    force: from omitted harmonics, F on 2 N harmonics, and changes that are ``left``.

    fine : the condensed equation with 2 N harmonics; samples : of the law. The
    harmonics N+1 to 2N are included: below the mesh modes a difference of two levels is
    no estimate.
    """
    harmonics = fine.linear.shape[-1] - 1
    wide = fourier.resize(deflection, harmonics)
    deflections, rates = fine.sampled(wide, samples)
    nonlinear_force = fourier.analyze(
        fine.nonlinear_force(deflections, rates, fourier.Equidistant(samples)),
        harmonics,
    )
    residual = fine.left(wide, nonlinear_force)
    omitted = wide - fourier.resize(retained, harmonics)
    changes = (
        omitted - AMPLIFIED * residual,
        *(AMPLIFIED * fourier.resize(change, harmonics) for change in left),
    )
    error = relative_force_change(fine, (deflections, rates), changes)
    return nonlinear_force, residual, error


def difference(first: Array, second: Array, period: int = 1) -> float:
    """Largest difference of deflections ``(G, n+1)`` m over ``period`` cycles, relative
    to the largest of all meshes; the motions may begin in different cycles.
    """
    first = fourier.sample(first, period * COMPARED)
    second = fourier.sample(second, period * COMPARED)
    shifted = (np.roll(second, cycle * COMPARED, axis=-1) for cycle in range(period))
    least = min(np.abs(first - turned).max(initial=0.0) for turned in shifted)
    largest = max(np.abs(first).max(initial=0.0), np.abs(second).max(initial=0.0))
    return float(least / max(largest, 1e-300))


_begun: set = set()
"""Structures of problems, with their plans, whose programs were begun ahead."""


def compile_ahead(
    equation: CondensedEquation,
    system: System,
    columns: Array,
    modes: MarchModes,
    plan: SweepPlan,
) -> None:
    """Begin to make the program of sweeps where :data:`prepare` has to be made, once
    for each structure.
    """
    leaves, tree = jax.tree.flatten((equation, system, columns, modes))
    structure = plan, tree, tuple(map(np.shape, leaves))
    if structure in _begun:
        return
    _begun.add(structure)
    if prepare.at_hand(equation, system, columns, modes, plan=plan):
        return
    shapes = prepare.shapes(equation, system, columns, modes, plan=plan)
    sweeps.settle_program.compile_ahead(
        shapes.sweeps, shapes.flank, goal=0.0, most=MOST_SWEEPS, plan=plan
    )


def ready(
    problem: Problem, active_meshes: ActiveMeshes, modes: MarchModes, plan: SweepPlan
) -> tuple[SweptProblem, CondensedTrain]:
    """The :class:`SweptProblem` of a Problem, and its CondensedTrain."""
    equation, condensed = linear_equation(
        on_host(problem), 2 * plan.harmonics, active_meshes
    )
    equation = dataclasses.replace(equation, by_rate=plan.by_rate)
    system = condensed.system
    columns = condensed.columns
    compile_ahead(equation, system, columns, modes, plan)
    return prepare(equation, system, columns, modes, plan=plan), condensed


@dataclass(frozen=True)
class SweptSolution:
    """Solve by sweeps: its Outcome, arrays of the host, None where sweeps settle at the
    motion at hand; deflections ``(G, N+1)`` m where its iteration ended; and the events
    on the way.
    """

    outcome: Outcome | None
    deflection: np.ndarray
    path: list[Sweeps | NewtonOnSweeps]


def solve_by_sweeps(
    problem: Problem,
    active_meshes: ActiveMeshes,
    modes: MarchModes,
    tolerance: float,
    plan: SweepPlan,
    *,
    deviation: np.ndarray | None = None,
    deflection: Array | None = None,
    settled: float = SETTLED,
    newton: bool = True,
    at_hand: Array | None = None,
) -> SweptSolution:
    """Solve a Problem by sweeps.

    From teeth on their drive sides, from a ``deviation`` ``(2S,)`` from the linear
    motion (:func:`~jaxhb.balance.sweeps.point_at`), or from deflections ``(G, n+1)`` m
    of a motion: sweeps, and where these do not settle, with ``newton`` Newton's method
    on the same map; ``settled`` : share of the tolerance that may be left of the
    vibration; at_hand : deflections ``(G, n+1)`` m of a motion: where sweeps settle at
    it (ARRIVED), there is no Outcome.
    """
    goal = settled * tolerance
    swept, condensed = ready(problem, active_meshes, modes, plan)
    begin = swept.flank
    with np.errstate(all="ignore"):  # sweeps tell of numbers that are not finite
        if deflection is not None:
            begin = sweeps.point_of(on_host(swept.sweeps), deflection, plan)
        elif deviation is not None:
            begin = sweeps.point_at(on_host(swept.sweeps), deviation)
    ended = sweeps.settle_program(
        swept.sweeps, begin, goal=goal, most=MOST_SWEEPS, plan=plan
    )
    path: list[Sweeps | NewtonOnSweeps] = [
        Sweeps(int(ended.marches), plan.steps, float(ended.change))
    ]

    def is_unsettled() -> bool:
        return goal < float(ended.distance)

    if newton and is_unsettled() and np.isfinite(ended.change):
        point = ended.point
        most = MOST_MARCHES
        if deflection is not None:  # sweeps lead away from a motion that repels
            first = corrected(swept, begin, plan)
            point = map_newton.least_changed(swept.sweeps, [point, first], plan)
            most = MARCHES_NEARBY
        begun = int(ended.marches)
        ended = map_newton.solve_map(
            swept.sweeps, point, plan, goal=goal, most_marches=most
        )
        path.append(NewtonOnSweeps(int(ended.marches), plan.steps, float(ended.change)))
        ended = dataclasses.replace(ended, marches=begun + ended.marches)
    swept, ended = jax.tree.map(np.asarray, (swept, ended))
    if (
        at_hand is not None
        and not is_unsettled()
        and difference(ended.deflection, at_hand) <= ARRIVED
    ):
        return SweptSolution(None, ended.deflection, path)
    with np.errstate(all="ignore"):  # a status tells of numbers that are not finite
        outcome = conclude_sweeps(
            problem, active_meshes, condensed, swept, ended, tolerance, goal, plan
        )
    outcome = jax.tree.map(np.asarray, outcome)
    return SweptSolution(outcome, ended.deflection, path)


def corrected(swept: SweptProblem, point: SweepPoint, plan: SweepPlan) -> SweepPoint:
    """The point with its linear motion corrected for the errors of the steps of its
    cycle.
    """
    following, _ = sweeps.sweep_program(swept.sweeps, point, plan=plan)
    return SweepPoint(following.linear, point.state, point.force)

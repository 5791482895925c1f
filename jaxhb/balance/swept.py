"""The solution of one train at one speed by sweeps, with its status and the error of
its harmonics.
"""

import dataclasses
from dataclasses import dataclass

import jax
import numpy as np

from jaxhb._jax import on_host
from jaxhb._program import Program
from jaxhb.balance import map_newton, sweeps
from jaxhb.balance.march import MarchModes
from jaxhb.balance.outcome import Ended, conclude, relative_force_change
from jaxhb.balance.problem import linear_equation
from jaxhb.balance.sweeps import Settled, SweepEquation, SweepPlan, SweepPoint
from jaxhb.equations import condensation, fourier
from jaxhb.results.status import NewtonOnSweeps, Sweeps

MOST_SWEEPS = 12  # a motion that these do not settle wants Newton's method
# Of Newton's method: orbits of irregular trains that need more are rarely found at all;
# and from a motion at hand.
MOST_MARCHES = 100
MARCHES_NEARBY = 50
# Times what F(l) leaves, and what is left of sweeps, that the motion may be off: the
# inverse of the Jacobian, and changes that shrink more slowly later on. At 131 speeds
# of ``gear_train_30``, with 5.5 steps a period of the fastest mode, the error by
# shooting was 0.7 of its estimate in the median, below 1.4 at nine of ten, and 2.3 at
# most; at 40 others, against four times the steps, 0.8, 1.0 and, beside a period
# doubling, 11.
AMPLIFIED = 1.5
# Difference of deflections, relative to the largest, up to which two motions are one,
# and time samples for it.
ARRIVED = 0.02
COMPARED = 1024
# Share of the tolerance that may be left of the vibration: peaks of forces are off by
# more
SETTLED = 0.03


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SweptProblem:
    """A Problem ready for sweeps: its equation with 2 N harmonics, equation of the
    sweeps, and the point with all teeth on their drive sides.
    """

    fine: condensation.CondensedEquation
    sweeps: SweepEquation
    flank: SweepPoint


def _prepared(
    equation, system, columns, modes: MarchModes, plan: SweepPlan
) -> SweptProblem:
    """The :class:`SweptProblem` of a CondensedEquation with 2 N harmonics that lacks
    its receptances.
    """
    fine = condensation.with_receptances(equation, system, columns)
    of_sweeps = sweeps.sweep_equation(
        condensation.truncate(fine, plan.harmonics), modes, plan
    )
    return SweptProblem(fine, of_sweeps, sweeps.first_point(of_sweeps))


def conclude_sweeps(
    problem,
    active_meshes,
    condensed,
    swept: SweptProblem,
    settled: Settled,
    tolerance,
    goal,
    plan,
):
    """The Outcome with ``plan.kept`` harmonics of where sweeps ended, settled where
    ``goal`` of the vibration is left.

    CONVERGED : the truncation error is ``tolerance`` of the largest elastic force or
    less. It is an estimate, no bound: harmonics above those kept, F(l) on 2 N harmonics
    taken from the deflections once, and what is left to the fixed point. MAX_STEPS :
    the sweeps did not settle, or mean forces miss the mean torques. Of arrays of the
    host it is found there: a program would take seconds to make and as long to run.
    """
    fine = swept.fine
    equation = swept.sweeps.equation
    kept = fourier.resize(settled.deflection, plan.kept)
    samples = sweeps.WIDE_SAMPLES_PER_STEP * plan.steps
    nonlinear_force, missed, truncation = truncation_of(
        fine, settled.deflection, kept, samples, settled.left
    )
    vibration = sweeps.vibration_size(fine, settled.deflection)
    ended = Ended(
        deflection=kept,
        settled=settled.distance <= goal,
        stalled=np.array(False),
        steps=settled.marches,
        error=sweeps.force_size(fine, missed[:, : plan.harmonics + 1]) / vibration,
        sweeps=settled.marches,
        periodicity_error=settled.change,
        truncation_error=truncation,
    )
    given = problem, active_meshes, equation, condensed
    samples = fourier.SAMPLES_PER_HARMONIC * plan.kept
    outcome, _ = conclude(
        *given, fourier.resize(nonlinear_force, plan.kept), ended, tolerance, samples
    )
    return outcome


def truncation_of(fine, deflection, kept, samples, *left):
    """phi and F of deflections ``(G, N+1)`` m, coefficients ``(G, 2N+1)``, and by how
    much of the largest elastic force those ``kept`` of them are estimated to be off:
    what is left out, F on 2 N harmonics, and changes that are ``left``.

    fine : the condensed equation with 2 N harmonics; samples : of the law. The
    harmonics N+1 to 2N are included: below the mesh modes a difference of two levels is
    no estimate.
    """
    harmonics = fine.linear.shape[-1] - 1
    wide = fourier.resize(deflection, harmonics)
    motion = fine.sampled(wide, samples)
    nonlinear_force = fourier.analyze(
        fine.nonlinear_force(*motion, fourier.Equidistant(samples)), harmonics
    )
    missed = fine.left(wide, nonlinear_force)
    left_out = wide - fourier.resize(kept, harmonics)
    changes = (
        left_out - AMPLIFIED * missed,
        *(AMPLIFIED * fourier.resize(change, harmonics) for change in left),
    )
    return nonlinear_force, missed, relative_force_change(fine, motion, changes)


prepare = Program(_prepared, static_argnames="plan")


def difference(one, other, period=1):
    """Largest difference of deflections ``(G, n+1)`` m over ``period`` cycles, relative
    to the largest of all meshes; the motions may begin in different cycles.
    """
    one, other = (
        fourier.sample(deflection, period * COMPARED) for deflection in (one, other)
    )
    shifted = (np.roll(other, cycle * COMPARED, axis=-1) for cycle in range(period))
    least = min(np.abs(one - moved).max(initial=0.0) for moved in shifted)
    return float(
        least
        / max(np.abs(one).max(initial=0.0), np.abs(other).max(initial=0.0), 1e-300)
    )


_begun: set = set()
"""Structures of problems, with their plans, whose programs were begun beforehand."""


def compile_ahead(
    equation, system, columns, modes: MarchModes, plan: SweepPlan
) -> None:
    """Begin to make the program of sweeps where :data:`prepare` has to be made, once
    for each structure.
    """
    given = equation, system, columns, modes
    leaves, tree = jax.tree.flatten(given)
    structure = plan, tree, tuple(map(np.shape, leaves))
    if structure in _begun:
        return
    _begun.add(structure)
    if prepare.at_hand(*given, plan=plan):
        return
    swept = prepare.shapes(*given, plan=plan)
    sweeps.settle_program.compile_ahead(
        swept.sweeps, swept.flank, goal=0.0, most=MOST_SWEEPS, plan=plan
    )


def ready(problem, active_meshes, modes: MarchModes, plan: SweepPlan):
    """The :class:`SweptProblem` of a Problem, and its CondensedTrain."""
    equation, condensed = linear_equation(
        on_host(problem), 2 * plan.harmonics, active_meshes
    )
    given = (
        dataclasses.replace(equation, by_rate=plan.by_rate),
        condensed.system,
        condensed.columns,
        modes,
    )
    compile_ahead(*given, plan)
    return prepare(*given, plan=plan), condensed


def solve_by_sweeps(
    problem,
    active_meshes,
    modes,
    tolerance,
    plan: SweepPlan,
    *,
    deviation=None,
    deflection=None,
    settled=SETTLED,
    newton=True,
    at_hand=None,
):
    """The Outcome of a Problem, as arrays of the host, where it ended (Settled), and
    the events on the way.

    From teeth on their drive sides, from a ``deviation`` ``(2S,)`` from the linear
    motion (:func:`~jaxhb.balance.sweeps.point_at`), or from deflections ``(G, n+1)`` m
    of a motion: sweeps, and where these do not settle, with ``newton`` its method on
    the same map; ``settled`` : share of the tolerance that may be left of the
    vibration; at_hand : deflections ``(G, n+1)`` m of a motion: where sweeps settle at
    it (ARRIVED), the Outcome is None.
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

    def left_over():
        return goal < float(ended.distance)

    if newton and left_over() and np.isfinite(ended.change):
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
        and not left_over()
        and difference(ended.deflection, at_hand) <= ARRIVED
    ):
        return None, ended, path
    with np.errstate(all="ignore"):  # a status tells of numbers that are not finite
        outcome = conclude_sweeps(
            problem, active_meshes, condensed, swept, ended, tolerance, goal, plan
        )
    return jax.tree.map(np.asarray, outcome), ended, path


def corrected(swept: SweptProblem, point: SweepPoint, plan: SweepPlan) -> SweepPoint:
    """The point whose linear motion has what the steps of its cycle did wrong taken
    from it.
    """
    following, _ = sweeps.sweep_program(swept.sweeps, point, plan=plan)
    return SweepPoint(following.linear, point.state, point.force)

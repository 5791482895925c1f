"""The solution of one train at one speed by sweeps, with its status and the error of its harmonics."""

import dataclasses
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._program import Program
from jaxhb.balance import map_newton, sweeps
from jaxhb.balance.march import MarchModes
from jaxhb.balance.outcome import Ended, Outcome, conclude, relative_force_change
from jaxhb.balance.problem import reduced_equation
from jaxhb.balance.sweeps import Settled, SweepEquation, SweepPlan, SweepPoint
from jaxhb.equations import condensation, fourier
from jaxhb.results.status import March, NewtonOnSweeps, Sweeps

MOST_SWEEPS = 12  # a motion that these do not settle wants Newton's method
# Of a search, cycles marched, from how many of them Newton's method starts at most, the first of these, and marches of
# all these starts after which no other is made.
CYCLES, TRIES, FIRST_CYCLE, SEARCHED = 128, 6, 2, 300
MOST_MARCHES = 100  # of Newton's method: orbits of irregular trains that need more are rarely found at all
# Times what F(l) leaves, and what is left of sweeps, that the motion may be off: the inverse of the Jacobian, and
# changes that shrink more slowly later on. At 131 speeds of ``gear_train_30``, with 5.5 steps a period of the fastest
# mode, the error by shooting was 0.7 of its estimate in the median, below 1.4 at nine of ten, and 2.3 at most.
AMPLIFIED = 1.5
SETTLED = 0.03  # share of the tolerance that may be left of the vibration: peaks of forces are off by more


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SweptProblem:
    """A Problem ready for sweeps: its equation with 2 N harmonics, condensed train, equation of the sweeps, and the
    point with all teeth on their drive sides."""

    fine: condensation.CondensedEquation
    condensed: condensation.CondensedTrain
    sweeps: SweepEquation
    flank: SweepPoint


def _prepared(problem, active_meshes, modes: MarchModes, plan: SweepPlan) -> SweptProblem:
    """The :class:`SweptProblem` of a Problem."""
    fine, condensed = reduced_equation(problem, 2 * plan.harmonics, active_meshes)
    fine = dataclasses.replace(fine, by_rate=plan.by_rate)
    equation = sweeps.sweep_equation(condensation.truncate(fine, plan.harmonics), modes, plan)
    return SweptProblem(fine, condensed, equation, sweeps.first_point(equation))


def _concluded(problem, active_meshes, swept: SweptProblem, settled: Settled, tolerance, goal, plan) -> Outcome:
    """The Outcome with ``plan.kept`` harmonics of where sweeps ended, settled where ``goal`` of the vibration is left.

    CONVERGED : the truncation error is ``tolerance`` of the largest elastic force or less. It is an estimate, no bound:
    harmonics above those kept, F(l) on 2 N harmonics taken from the deflections once, and what is left to the fixed
    point. MAX_STEPS : the sweeps did not settle, or mean forces miss the mean torques.
    """
    fine, equation = swept.fine, swept.sweeps.equation
    wide = fourier.resize(settled.deflection, 2 * plan.harmonics)
    nonlinear_force = fine.nonlinear_force_coefficients(wide, 2 * plan.samples)
    missed = fine.left(wide, nonlinear_force)
    corrected = wide - AMPLIFIED * missed
    kept = fourier.resize(settled.deflection, plan.kept)
    left_out = corrected - fourier.resize(kept, 2 * plan.harmonics)
    truncation = relative_force_change(fine, corrected, left_out, 2 * plan.samples)
    unsettled = relative_force_change(equation, settled.deflection, AMPLIFIED * settled.left, plan.samples)
    ended = Ended(
        deflection=kept,
        settled=settled.distance <= goal,
        stalled=jnp.array(False),
        steps=settled.marches,
        error=sweeps.force_size(fine, missed[:, : plan.harmonics + 1]) / sweeps.vibration_size(fine, wide),
        sweeps=settled.marches,
        periodicity_error=settled.change,
        truncation_error=truncation + unsettled,
    )
    given = problem, active_meshes, equation, swept.condensed
    samples = fourier.SAMPLES_PER_HARMONIC * plan.kept
    outcome, _ = conclude(*given, fourier.resize(nonlinear_force, plan.kept), ended, tolerance, samples)
    return outcome


prepare = Program(_prepared, static_argnames="plan")
conclude_sweeps = Program(_concluded, static_argnames="plan")


_begun: set = set()
"""Structures of problems, with their plans, whose programs were begun beforehand."""


def compile_ahead(problem, active_meshes, modes: MarchModes, plan: SweepPlan) -> None:
    """Begin to make the programs that follow :data:`prepare` while that is made, once for each structure of arrays."""
    leaves, tree = jax.tree.flatten((problem, active_meshes, modes))
    structure = plan, tree, tuple(map(np.shape, leaves))
    if structure in _begun:
        return
    _begun.add(structure)
    swept = jax.eval_shape(partial(_prepared, plan=plan), problem, active_meshes, modes)
    point, number = swept.flank, np.zeros(())
    ended = Settled(point, point.linear, np.zeros((), dtype=int), number, point.linear, number)
    conclude_sweeps.compile_ahead(problem, active_meshes, swept, ended, 0.0, 0.0, plan=plan)
    sweeps.settle_program.compile_ahead(swept.sweeps, point, goal=0.0, most=MOST_SWEEPS, plan=plan)


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
    search=False,
):
    """The Outcome of a Problem, as arrays of the host, where it ended (Settled), and the events on the way.

    From teeth on their drive sides, from a ``deviation`` ``(2S,)`` from the linear motion
    (:func:`~jaxhb.balance.sweeps.point_at`), or from deflections ``(G, n+1)`` m of a motion: sweeps, and where these do
    not settle, with ``newton`` its method on the same map, with ``search`` from cycles of a march, too; ``settled`` :
    share of the tolerance that may be left of the vibration.
    """
    goal = settled * tolerance
    compile_ahead(problem, active_meshes, modes, plan)
    swept = prepare(problem, active_meshes, modes, plan=plan)
    begin = swept.flank
    if deflection is not None:
        begin = sweeps.motion_program(swept.sweeps, fourier.resize(deflection, plan.harmonics), plan=plan)
    elif deviation is not None:
        begin = sweeps.point_program(swept.sweeps, deviation)
    ended = sweeps.settle_program(swept.sweeps, begin, goal=goal, most=MOST_SWEEPS, plan=plan)
    path: list[Sweeps | March | NewtonOnSweeps] = [Sweeps(int(ended.marches), plan.steps, float(ended.change))]

    def left_over():
        return goal < float(ended.distance)

    if newton and left_over() and np.isfinite(ended.change):
        ended = _by_newton(swept, ended.point, plan, goal, int(ended.marches), path)
    begun = int(ended.marches)
    if search and left_over():
        for point, event in _nearly_closed(swept, plan):
            path.append(event)
            found = _by_newton(swept, point, plan, goal, int(ended.marches), path)
            ended = found if found.distance < ended.distance else dataclasses.replace(ended, marches=found.marches)
            if not left_over() or ended.marches > begun + SEARCHED:
                break
    ended = jax.tree.map(np.asarray, ended)  # one program, whatever made them
    outcome = conclude_sweeps(problem, active_meshes, swept, ended, tolerance, goal, plan=plan)
    return jax.tree.map(np.asarray, outcome), ended, path


def _by_newton(swept: SweptProblem, point, plan, goal, begun, path):
    """Where Newton's method on the map ends from a point, ``begun`` marches counted as well; its event is added."""
    ended = map_newton.solve_map(swept.sweeps, point, plan, goal=goal, most_marches=MOST_MARCHES)
    path.append(NewtonOnSweeps(int(ended.marches), plan.steps, float(ended.change)))
    return dataclasses.replace(ended, marches=begun + ended.marches)


def _nearly_closed(swept: SweptProblem, plan):
    """Points at which cycles of a long march begin, those first that miss their beginning least, with their events.

    Of a march that does not settle, the cycles that nearly close pass near a periodic motion, stable or not.
    """
    states, forces, missed = jax.tree.map(
        np.asarray, sweeps.visited_program(swept.sweeps, swept.flank, plan=plan, cycles=CYCLES)
    )
    missed = np.where(np.isfinite(missed), missed, np.inf)
    largest = np.max(missed[np.isfinite(missed)], initial=1e-300)
    tried: list[int] = []
    for cycle in (FIRST_CYCLE + np.argsort(missed[FIRST_CYCLE:])).tolist():
        if len(tried) == TRIES or not np.isfinite(missed[cycle]):
            return
        if any(abs(cycle - other) < 2 for other in tried):
            continue  # the cycle before or after one that was tried passes by the same motion
        tried.append(cycle)
        begin = SweepPoint(swept.flank.linear, states[cycle], forces[cycle])
        following, _ = sweeps.sweep_program(swept.sweeps, begin, plan=plan)
        yield (
            SweepPoint(following.linear, begin.state, begin.force),
            March(cycle + 1, plan.steps, float(missed[cycle] / largest)),
        )

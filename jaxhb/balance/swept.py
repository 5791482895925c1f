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
from jaxhb.results.status import NewtonOnSweeps, Sweeps

MOST_SWEEPS = 12  # a motion that these do not settle wants Newton's method
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
    kept = fourier.resize(settled.deflection, plan.kept)
    nonlinear_force, missed, truncation = truncation_of(fine, settled.deflection, kept, 2 * plan.samples)
    unsettled = relative_force_change(equation, settled.deflection, AMPLIFIED * settled.left, plan.samples)
    vibration = sweeps.vibration_size(fine, settled.deflection)
    ended = Ended(
        deflection=kept,
        settled=settled.distance <= goal,
        stalled=jnp.array(False),
        steps=settled.marches,
        error=sweeps.force_size(fine, missed[:, : plan.harmonics + 1]) / vibration,
        sweeps=settled.marches,
        periodicity_error=settled.change,
        truncation_error=truncation + unsettled,
    )
    given = problem, active_meshes, equation, swept.condensed
    samples = fourier.SAMPLES_PER_HARMONIC * plan.kept
    outcome, _ = conclude(*given, fourier.resize(nonlinear_force, plan.kept), ended, tolerance, samples)
    return outcome


def truncation_of(fine, deflection, kept, samples):
    """phi and F of deflections ``(G, N+1)`` m, coefficients ``(G, 2N+1)``, and by how much of the largest elastic force
    those ``kept`` of them are estimated to be off: what is left out, and F on 2 N harmonics.

    fine : the condensed equation with 2 N harmonics; samples : of the law. The harmonics N+1 to 2N are included: below
    the mesh modes a difference of two levels is no estimate.
    """
    wide = fourier.resize(deflection, fine.linear.shape[-1] - 1)
    nonlinear_force = fine.nonlinear_force_coefficients(wide, samples)
    missed = fine.left(wide, nonlinear_force)
    corrected = wide - AMPLIFIED * missed
    left_out = corrected - fourier.resize(kept, wide.shape[-1] - 1)
    return nonlinear_force, missed, relative_force_change(fine, corrected, left_out, samples)


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
):
    """The Outcome of a Problem, as arrays of the host, where it ended (Settled), and the events on the way.

    From teeth on their drive sides, from a ``deviation`` ``(2S,)`` from the linear motion
    (:func:`~jaxhb.balance.sweeps.point_at`), or from deflections ``(G, n+1)`` m of a motion: sweeps, and where these do
    not settle, with ``newton`` its method on the same map; ``settled`` : share of the tolerance that may be left of the
    vibration.
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
    path: list[Sweeps | NewtonOnSweeps] = [Sweeps(int(ended.marches), plan.steps, float(ended.change))]
    if newton and goal < float(ended.distance) and np.isfinite(ended.change):
        begun = int(ended.marches)
        ended = map_newton.solve_map(swept.sweeps, ended.point, plan, goal=goal, most_marches=MOST_MARCHES)
        path.append(NewtonOnSweeps(int(ended.marches), plan.steps, float(ended.change)))
        ended = dataclasses.replace(ended, marches=begun + ended.marches)
    ended = jax.tree.map(np.asarray, ended)  # one program, whatever made them
    outcome = conclude_sweeps(problem, active_meshes, swept, ended, tolerance, goal, plan=plan)
    return jax.tree.map(np.asarray, outcome), ended, path

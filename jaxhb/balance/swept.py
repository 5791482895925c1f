"""The solution of one train at one speed by sweeps, with its status and the error of its harmonics."""

import jax.numpy as jnp

from jaxhb._program import Program
from jaxhb.balance import sweeps
from jaxhb.balance.march import MarchModes
from jaxhb.balance.problem import fields, power_defect, reduced_equation
from jaxhb.balance.program import Outcome, failure_of, is_balanced, relative_force_change
from jaxhb.balance.sweeps import SweepPlan
from jaxhb.equations import condensation, fourier
from jaxhb.results.status import Status

MOST_SWEEPS = 12  # a motion that these do not settle wants shorter steps, Newton's method or more cycles
SETTLED = 0.1  # share of the tolerance that the last sweep may change of the vibration
LAST_CHANGES = 2.0  # times the last change that sweeps to come may add, as they shrink it to a half or less


def _solved_by_sweeps(problem, active_meshes, modes: MarchModes, tolerance, plan: SweepPlan) -> Outcome:
    """The Outcome of a Problem from teeth on their drive sides, by MOST_SWEEPS at most.

    CONVERGED : the truncation error is ``tolerance`` of the largest elastic force or less. It is an estimate, no bound:
    F(l) on 2 N harmonics taken from the deflections once, and the changes that more sweeps would make. MAX_STEPS : the
    sweeps did not settle, or mean forces miss the mean torques.
    """
    fine, condensed = reduced_equation(problem, 2 * plan.harmonics, active_meshes)
    equation = condensation.truncate(fine, plan.harmonics)
    goal = SETTLED * tolerance
    settled = sweeps.settled_from_flank(equation, modes, plan, goal, MOST_SWEEPS)
    deflection = settled.deflection
    wide = fourier.resize(deflection, 2 * plan.harmonics)
    missed = fine.residual(wide, 2 * plan.samples)
    truncation = relative_force_change(fine, wide, missed, 2 * plan.samples) + LAST_CHANGES * settled.change

    nonlinear_force = equation.nonlinear_force_coefficients(deflection, plan.samples)
    displacement, force = condensed.combine(nonlinear_force)
    found = fields(problem, displacement, force, "sampled", plan.samples)
    balanced = is_balanced(problem, active_meshes, nonlinear_force, found, tolerance)
    iteration = jnp.where((settled.change <= goal) & balanced, Status.CONVERGED, Status.MAX_STEPS)
    iteration = jnp.where(jnp.isfinite(settled.error), iteration, Status.NONFINITE)
    failure = failure_of(problem, active_meshes, equation, condensed, found, iteration, None, plan.samples)
    exceeded = (failure == Status.CONVERGED) & ~(truncation <= tolerance)
    return Outcome(
        fields=found,
        deflection=deflection,
        status=jnp.where(exceeded, Status.TOLERANCE_NOT_MET, failure),
        periodicity_error=settled.change,
        residual=settled.error,
        truncation_error=truncation,
        power_defect=power_defect(problem, displacement, force, found),
        steps=settled.sweeps,
    )


solve_by_sweeps = Program(_solved_by_sweeps, static_argnames="plan")

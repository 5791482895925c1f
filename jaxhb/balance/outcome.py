"""The outcome of a solve: fields and status of the deflections at which an iteration
ended, however it went there.
"""

import dataclasses
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array, namespace
from jaxhb.balance.problem import (
    fields,
    force_defect,
    held_in_contact,
    power_defect,
    reduced_equation,
    ring_force,
)
from jaxhb.balance.sizes import deflection_scale
from jaxhb.equations import backlash, exact_integrals, fourier
from jaxhb.linear.forced import SINGULAR, residual_and_status
from jaxhb.results.status import Status

# Share of the tooth forces, at least, by which their means may miss the balance of
# torques
UNBALANCED_FORCE = 1e-2


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Ended:
    """Where an iteration ended: deflections ``(G, N+1)`` m of the active meshes;
    whether it settled, else whether it stalled; steps; error, what is left of the
    equations; sweeps with which it began, 0 for none, and periodicity_error, by which
    the last of them changed the vibration; estimated truncation_error.
    """

    deflection: Array
    settled: Array
    stalled: Array
    steps: Array
    error: Array
    sweeps: Array
    periodicity_error: Array
    truncation_error: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Outcome:
    """Fields of the solution, deflections ``(G, N+1)`` of the active meshes, and how
    the solve went.

    sweeps with which it began, 0 for none; periodicity_error : by which the last of
    them changed the vibration, nan where that is not finite; residual,
    truncation_error, power_defect; steps : of Newton, or sweeps.
    """

    fields: object
    deflection: Array
    status: Array
    sweeps: Array
    periodicity_error: Array
    residual: Array
    truncation_error: Array
    power_defect: Array
    steps: Array


def conclude(
    problem,
    active_meshes,
    equation,
    condensed,
    nonlinear_force,
    ended: Ended,
    limit,
    samples,
):
    """The Outcome of a Problem, and with exact integrals the Crossings of the active
    and of all meshes, else None.

    equation, condensed : of :func:`~jaxhb.balance.problem.reduced_equation`, the first
    with its crossings if its integrals are exact; nonlinear_force : coefficients ``(G,
    N+1)`` N at the deflections; limit : on the truncation error; samples : of tooth
    forces over the cycle.
    """
    xp = namespace(problem, nonlinear_force)
    displacement, force = condensed.combine(nonlinear_force)
    found = fields(problem, displacement, force, equation.integrals, samples)
    crossings = None
    if equation.integrals == "exact":
        every = exact_integrals.find_crossings(
            jax.tree.map(jnp.asarray, problem.meshes.law), found.deflections
        )
        crossings = equation.crossings, every
    balanced = _is_balanced(problem, active_meshes, nonlinear_force, found, limit)
    iteration = xp.where(ended.stalled, Status.STALLED, Status.MAX_STEPS)
    iteration = xp.where(ended.settled & balanced, Status.CONVERGED, iteration)
    iteration = xp.where(xp.isfinite(ended.error), iteration, Status.NONFINITE)
    status = _failure_of(
        problem,
        active_meshes,
        equation,
        condensed,
        found,
        iteration,
        crossings,
        samples,
    )
    exceeded = (status == Status.CONVERGED) & ~(ended.truncation_error <= limit)
    outcome = Outcome(
        fields=found,
        deflection=ended.deflection,
        status=xp.where(exceeded, Status.TOLERANCE_NOT_MET, status),
        sweeps=ended.sweeps,
        periodicity_error=ended.periodicity_error,
        residual=ended.error,
        truncation_error=ended.truncation_error,
        power_defect=power_defect(problem, displacement, force, found),
        steps=ended.steps,
    )
    return outcome, crossings


def linear_outcome(problem, active_meshes, harmonics, limit, samples) -> Outcome:
    """The Outcome of a Problem without active meshes, by arithmetic of the host.

    harmonics, samples : of the fields; limit : on the truncation error.
    """
    equation, condensed = reduced_equation(problem, harmonics, active_meshes)
    nothing = np.zeros(())
    ended = Ended(
        deflection=equation.linear,
        settled=np.array(True),
        stalled=np.array(False),
        steps=np.array(0),
        error=nothing,
        sweeps=np.array(0),
        periodicity_error=nothing,
        truncation_error=nothing,
    )
    outcome, _ = conclude(
        problem,
        active_meshes,
        equation,
        condensed,
        equation.linear,
        ended,
        limit,
        samples,
    )
    return outcome


def _is_balanced(problem, active_meshes, nonlinear_force, found, limit):
    """Whether mean tooth forces are what the mean torques ask for, to ``limit`` of the
    forces or UNBALANCED_FORCE.
    """
    missed = force_defect(problem, active_meshes, nonlinear_force, found)
    return missed <= namespace(missed).maximum(limit, UNBALANCED_FORCE)


def _failure_of(
    problem, active_meshes, equation, condensed, found, iteration, crossings, samples
):
    """The status as far as the equations go, CONVERGED whatever the truncation error,
    from that of ``iteration``.
    """
    xp = namespace(problem, found)
    finite = (iteration != Status.NONFINITE) & xp.all(
        xp.isfinite(found.angles.real + found.angles.imag)
    )
    _, linear = residual_and_status(*condensed.balance)
    # Teeth in the gap push at harmonics that no torque has, where the train may be at
    # resonance as well.
    compliance = xp.max(xp.abs(equation.receptance), initial=0.0) * xp.max(
        equation.law.stiffness, initial=0.0
    )
    held = held_in_contact(problem, found.deflections, active_meshes.flank, samples)
    complete = (
        xp.array(True)
        if crossings is None
        else crossings[0].complete & crossings[1].complete
    )
    # The later, the stronger: a motion that is not finite says nothing of the plan, and
    # at a resonance without damping nothing else means anything.
    status = xp.where(held & complete, iteration, Status.PLAN_VIOLATED)
    creeps = (status == Status.CONVERGED) & (
        ring_force(problem, found) > UNBALANCED_FORCE
    )
    status = xp.where(creeps, Status.UNBALANCED, status)
    status = xp.where(linear == Status.UNBALANCED, linear, status)
    status = xp.where(finite, status, Status.NONFINITE)
    linear = xp.where(
        compliance > SINGULAR, xp.maximum(linear, Status.NEAR_SINGULAR), linear
    )
    return xp.where(linear >= Status.NEAR_SINGULAR, linear, status)


def relative_force_change(equation, motion, changes):
    """Sum of the sup-norms of what each of some changes ``(G, N+1)`` m takes from the
    elastic forces of a motion, over the largest of them; motion : deflections and rates
    ``(G, samples)`` over the cycle.
    """
    samples, xp = motion[0].shape[-1], namespace(equation, motion, changes)
    law, *_ = backlash.at_samples(equation, fourier.Equidistant(samples).synthesize)

    def force(deflection, rate):
        return backlash.force(law, deflection) + backlash.dry_friction(law, rate)

    # Rates of deflection change the elastic forces by dry friction alone.
    read = dataclasses.replace(equation, by_rate=equation.law.friction is not None)

    def taken(change):
        moved, slowed = read.sampled(change, samples)
        return xp.max(xp.abs(force(motion[0] - moved, motion[1] - slowed) - before))

    before = force(*motion)
    # Of solved equations, where no tooth carries a load.
    noise = 1e-8 * xp.max(equation.law.stiffness * deflection_scale(equation))
    largest = xp.maximum(xp.max(xp.abs(before)), xp.maximum(noise, 1e-300))
    return sum(taken(change) for change in changes) / largest

"""The outcome of a solve: fields and status of the deflections at which an iteration ended, however it went there."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from jaxhb._jax import Array
from jaxhb.balance.problem import fields, force_defect, held_in_contact, power_defect, ring_force
from jaxhb.balance.sizes import deflection_scale
from jaxhb.equations import backlash, exact_integrals, fourier
from jaxhb.linear.forced import SINGULAR, residual_and_status
from jaxhb.results.status import Status

UNBALANCED_FORCE = 1e-2  # share of the tooth forces, at least, by which their means may miss the balance of torques


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Ended:
    """Where an iteration ended: deflections ``(G, N+1)`` m of the active meshes; whether it settled, else whether it
    stalled; steps; error, what is left of the equations; sweeps with which it began, 0 for none, and periodicity_error,
    by which the last of them changed the vibration; estimated truncation_error."""

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
    """Fields of the solution, deflections ``(G, N+1)`` of the active meshes, and how the solve went.

    sweeps with which it began, 0 for none; periodicity_error : by which the last of them changed the vibration, nan
    where that is not finite; residual, truncation_error, power_defect; steps : of Newton, or sweeps.
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


def conclude(problem, active_meshes, equation, condensed, nonlinear_force, ended: Ended, limit, samples):
    """The Outcome of a Problem, and with exact integrals the Crossings of the active and of all meshes, else None.

    equation, condensed : of :func:`~jaxhb.balance.problem.reduced_equation`, the first with its crossings if its
    integrals are exact; nonlinear_force : coefficients ``(G, N+1)`` N at the deflections; limit : on the truncation
    error; samples : of tooth forces over the cycle.
    """
    displacement, force = condensed.combine(nonlinear_force)
    found = fields(problem, displacement, force, equation.integrals, samples)
    crossings = None
    if equation.integrals == "exact":
        every = exact_integrals.find_crossings(jax.tree.map(jnp.asarray, problem.meshes.law), found.deflections)
        crossings = equation.crossings, every
    balanced = _is_balanced(problem, active_meshes, nonlinear_force, found, limit)
    iteration = jnp.where(ended.stalled, Status.STALLED, Status.MAX_STEPS)
    iteration = jnp.where(ended.settled & balanced, Status.CONVERGED, iteration)
    iteration = jnp.where(jnp.isfinite(ended.error), iteration, Status.NONFINITE)
    status = _failure_of(problem, active_meshes, equation, condensed, found, iteration, crossings, samples)
    exceeded = (status == Status.CONVERGED) & ~(ended.truncation_error <= limit)
    outcome = Outcome(
        fields=found,
        deflection=ended.deflection,
        status=jnp.where(exceeded, Status.TOLERANCE_NOT_MET, status),
        sweeps=ended.sweeps,
        periodicity_error=ended.periodicity_error,
        residual=ended.error,
        truncation_error=ended.truncation_error,
        power_defect=power_defect(problem, displacement, force, found),
        steps=ended.steps,
    )
    return outcome, crossings


def _is_balanced(problem, active_meshes, nonlinear_force, found, limit):
    """Whether mean tooth forces are what the mean torques ask for, to ``limit`` of the forces or UNBALANCED_FORCE."""
    missed = force_defect(problem, active_meshes, nonlinear_force, found)
    return missed <= jnp.maximum(limit, UNBALANCED_FORCE)


def _failure_of(problem, active_meshes, equation, condensed, found, iteration, crossings, samples):
    """The status as far as the equations go, CONVERGED whatever the truncation error, from that of ``iteration``."""
    finite = (iteration != Status.NONFINITE) & jnp.all(jnp.isfinite(found.angles.real + found.angles.imag))
    _, linear = residual_and_status(*condensed.balance)
    # Teeth in the gap push at harmonics that no torque has, where the train may be at resonance as well.
    compliance = jnp.max(jnp.abs(equation.receptance), initial=0.0) * jnp.max(equation.law.stiffness, initial=0.0)
    held = held_in_contact(problem, found.deflections, active_meshes.flank, samples)
    complete = jnp.array(True) if crossings is None else crossings[0].complete & crossings[1].complete
    # The later, the stronger: a motion that is not finite says nothing of the plan, and at a resonance without damping
    # nothing else means anything.
    status = jnp.where(held & complete, iteration, Status.PLAN_VIOLATED)
    creeps = (status == Status.CONVERGED) & (ring_force(problem, found) > UNBALANCED_FORCE)
    status = jnp.where(creeps, Status.UNBALANCED, status)
    status = jnp.where(linear == Status.UNBALANCED, linear, status)
    status = jnp.where(finite, status, Status.NONFINITE)
    linear = jnp.where(compliance > SINGULAR, jnp.maximum(linear, Status.NEAR_SINGULAR), linear)
    return jnp.where(linear >= Status.NEAR_SINGULAR, linear, status)


def relative_force_change(equation, deflection, change, samples):
    """Sup-norm of what ``change`` ``(G, N+1)`` m takes from the elastic forces at a deflection, over the largest of
    them."""
    law, *_ = backlash.at_samples(equation, fourier.Equidistant(samples).synthesize)

    def force(deflection):
        elastic = backlash.force(law, fourier.synthesize(deflection, samples))
        if law.friction is None:
            return elastic
        return elastic + backlash.dry_friction(law, equation.sampled(deflection, samples)[1])

    before, after = force(deflection), force(deflection - change)
    # Of solved equations, where no tooth carries a load.
    noise = 1e-8 * jnp.max(equation.law.stiffness * deflection_scale(equation))
    largest = jnp.maximum(jnp.max(jnp.abs(before)), jnp.maximum(noise, 1e-300))
    return jnp.max(jnp.abs(after - before)) / largest

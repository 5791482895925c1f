"""Outcome of a solve: fields and status of the deflections at which an iteration
ended, whichever it was.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array, Number, namespace
from jaxhb.balance.correction import LinearTrain
from jaxhb.balance.problem import (
    ActiveMeshes,
    Problem,
    fields,
    force_defect,
    held_in_contact,
    power_defect,
    reduced_equation,
    ring_force,
)
from jaxhb.balance.sizes import deflection_scale
from jaxhb.equations import backlash, exact_integrals, fourier
from jaxhb.equations.condensation import CondensedEquation, CondensedTrain
from jaxhb.equations.exact_integrals import Crossings
from jaxhb.linear.forced import SINGULAR, residual_and_status
from jaxhb.results.response import Fields
from jaxhb.results.status import Status

# Share of the tooth forces, at least, by which their means may miss the balance of
# torques
UNBALANCED_FORCE = 1e-2


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class IterationEnd:
    """End of an iteration: deflections ``(G, N+1)`` m of the active meshes; whether it
    settled, else whether it stalled; steps; error, the residual of the equations;
    sweeps with which it began, 0 for none, and periodicity_error, by which the last of
    them changed the vibration; estimated truncation_error.
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

    fields: Fields
    deflection: Array
    status: Array
    sweeps: Array
    periodicity_error: Array
    residual: Array
    truncation_error: Array
    power_defect: Array
    steps: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Solution:
    """Outcome without derivatives, and what :func:`jaxhb.balance.derivative.attach`
    needs of the solve: the LinearTrain of the equation, None without active meshes; of
    exact integrals the Crossings of the active and of all meshes, else None; whether
    the equations are solved.
    """

    outcome: Outcome
    linear_train: LinearTrain | None
    crossings: tuple[Crossings, Crossings] | None
    solved: Array


def conclude(
    problem: Problem,
    active_meshes: ActiveMeshes,
    equation: CondensedEquation,
    condensed: CondensedTrain,
    nonlinear_force: Array,
    ended: IterationEnd,
    limit: Number,
    samples: int,
) -> tuple[Outcome, tuple[Crossings, Crossings] | None]:
    """The Outcome of a Problem, and with exact integrals the Crossings of the active
    and of all meshes, else None.

    equation, condensed : of :func:`~jaxhb.balance.problem.reduced_equation`, the first
    with its crossings if its integrals are exact; nonlinear_force : coefficients ``(G,
    N+1)`` N at the deflections; limit : on the truncation error; samples : of tooth
    forces over the cycle.
    """
    xp = namespace(problem, nonlinear_force)
    displacement, force = condensed.combine(nonlinear_force)
    computed = fields(problem, displacement, force, equation.integrals, samples)
    crossings = None
    if equation.integrals == "exact":
        all_crossings = exact_integrals.find_crossings(
            jax.tree.map(jnp.asarray, problem.meshes.law), computed.deflections
        )
        assert equation.crossings is not None  # its integrals are exact
        crossings = equation.crossings, all_crossings
    balanced = _is_balanced(problem, active_meshes, nonlinear_force, computed, limit)
    iteration = xp.where(ended.stalled, Status.STALLED, Status.MAX_STEPS)
    iteration = xp.where(ended.settled & balanced, Status.CONVERGED, iteration)
    iteration = xp.where(xp.isfinite(ended.error), iteration, Status.NONFINITE)
    status = _failure_of(
        problem,
        active_meshes,
        equation,
        condensed,
        computed,
        iteration,
        crossings,
        samples,
    )
    exceeded = (status == Status.CONVERGED) & ~(ended.truncation_error <= limit)
    outcome = Outcome(
        fields=computed,
        deflection=ended.deflection,
        status=xp.where(exceeded, Status.TOLERANCE_NOT_MET, status),
        sweeps=ended.sweeps,
        periodicity_error=ended.periodicity_error,
        residual=ended.error,
        truncation_error=ended.truncation_error,
        power_defect=power_defect(problem, displacement, force, computed),
        steps=ended.steps,
    )
    return outcome, crossings


def linear_outcome(
    problem: Problem,
    active_meshes: ActiveMeshes,
    harmonics: int,
    limit: Number,
) -> Outcome:
    """The Outcome of a Problem without active meshes, by arithmetic of the host.

    limit : on the truncation error.
    """
    equation, condensed = reduced_equation(problem, harmonics, active_meshes)
    zero = np.zeros(())
    ended = IterationEnd(
        deflection=equation.linear,
        settled=np.array(True),
        stalled=np.array(False),
        steps=np.array(0),
        error=zero,
        sweeps=np.array(0),
        periodicity_error=zero,
        truncation_error=zero,
    )
    outcome, _ = conclude(
        problem,
        active_meshes,
        equation,
        condensed,
        equation.linear,
        ended,
        limit,
        fourier.SAMPLES_PER_HARMONIC * harmonics,
    )
    return outcome


def _is_balanced(
    problem: Problem,
    active_meshes: ActiveMeshes,
    nonlinear_force: Array,
    computed: Fields,
    limit: Number,
) -> Array:
    """Whether mean tooth forces balance the mean torques, to ``limit`` of the forces or
    UNBALANCED_FORCE.
    """
    missed = force_defect(problem, active_meshes, nonlinear_force, computed)
    return missed <= namespace(missed).maximum(limit, UNBALANCED_FORCE)


def _failure_of(
    problem: Problem,
    active_meshes: ActiveMeshes,
    equation: CondensedEquation,
    condensed: CondensedTrain,
    computed: Fields,
    iteration: Array,
    crossings: tuple[Crossings, Crossings] | None,
    samples: int,
) -> Array:
    """Status as far as the equations go, CONVERGED whatever the truncation error, from
    that of ``iteration``.
    """
    xp = namespace(problem, computed)
    is_finite = (iteration != Status.NONFINITE) & xp.all(
        xp.isfinite(computed.angles.real + computed.angles.imag)
    )
    _, linear_status = residual_and_status(*condensed.balance)
    # Teeth in the gap push at harmonics that no torque has, where the train may be at
    # resonance as well.
    compliance = xp.max(xp.abs(equation.receptance), initial=0.0) * xp.max(
        equation.law.stiffness, initial=0.0
    )
    stays_held = held_in_contact(
        problem, computed.deflections, active_meshes.flank, samples
    )
    is_complete = (
        xp.array(True)
        if crossings is None
        else crossings[0].complete & crossings[1].complete
    )
    # Later ones override: a motion that is not finite says nothing about the plan, and
    # at a resonance without damping nothing else means anything.
    status = xp.where(stays_held & is_complete, iteration, Status.PLAN_VIOLATED)
    creeps = (status == Status.CONVERGED) & (
        ring_force(problem, computed) > UNBALANCED_FORCE
    )
    status = xp.where(creeps, Status.UNBALANCED, status)
    status = xp.where(linear_status == Status.UNBALANCED, linear_status, status)
    status = xp.where(is_finite, status, Status.NONFINITE)
    linear_status = xp.where(
        compliance > SINGULAR,
        xp.maximum(linear_status, Status.NEAR_SINGULAR),
        linear_status,
    )
    return xp.where(linear_status >= Status.NEAR_SINGULAR, linear_status, status)


def relative_force_change(
    equation: CondensedEquation, motion: Sequence[Array], changes: Sequence[Array]
) -> Array:
    """Sum of the sup-norms of the changes of the elastic forces of a motion under each
    of several changes ``(G, N+1)`` m, over the largest force; motion : deflections and
    rates ``(G, samples)`` over the cycle.
    """
    deflections, rates = motion
    samples = deflections.shape[-1]
    xp = namespace(equation, motion, changes)
    law, *_ = backlash.at_samples(equation, fourier.Equidistant(samples).synthesize)

    def force(deflection: Array, rate: Array) -> Array:
        return backlash.force(law, deflection) + backlash.dry_friction(law, rate)

    # Rates of deflection change the elastic forces by dry friction alone.
    changed_equation = dataclasses.replace(
        equation, by_rate=equation.law.friction is not None
    )

    def largest_change(change: Array) -> Array:
        deflection_change, rate_change = changed_equation.sampled(change, samples)
        changed = force(deflections - deflection_change, rates - rate_change)
        return xp.max(xp.abs(changed - force_before))

    force_before = force(deflections, rates)
    # Noise of solved equations, where no tooth carries a load
    noise = 1e-8 * xp.max(equation.law.stiffness * deflection_scale(equation))
    largest = xp.maximum(xp.max(xp.abs(force_before)), xp.maximum(noise, 1e-300))
    return sum(largest_change(change) for change in changes) / largest

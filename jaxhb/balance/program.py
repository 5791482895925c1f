"""The compiled solve: one problem, one set of active meshes, fixed sizes. No decisions by value, no names."""

import dataclasses
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
from jax import lax

from jaxhb._program import Program
from jaxhb.balance import correction
from jaxhb.balance.derivative import attach
from jaxhb.balance.march_start import deflections_on_flank, marched
from jaxhb.balance.newton import relative_residual, solve_chain, solve_reduced
from jaxhb.balance.problem import fields, held_in_contact, model_of, power_defect, reduced_equation
from jaxhb.equations import backlash, condensation, exact_integrals, fourier
from jaxhb.linear.forced import SINGULAR, judged
from jaxhb.results.status import Status


@dataclass(frozen=True)
class SolveOptions:
    """When a compiled solve marches, and how it estimates what is left out.

    Parameters
    ----------
    march_above : relative residual, a few times that of a settled march, from which Newton's method takes longer than a
        march
    estimate_forcing, estimate_steps : share of the residual that the correction of an estimate of the truncation error
        may leave, and its Krylov steps at most
    unloaded : tooth force, over stiffness x backlash, up to which teeth carry nothing but what solved equations leave
    """

    march_above: float = 3e-4
    estimate_forcing: float = 0.05
    estimate_steps: int = 20
    unloaded: float = 1e-8


SOLVE = SolveOptions()


@dataclass(frozen=True)
class Sizes:
    """What a program is compiled for.

    samples : per cycle, of the law; time_steps : of the march and of the preconditioner; excited : harmonics of the
    excitation that there is room for; method : "reduced" or "chain"; residual_tolerance, max_steps : of Newton;
    integrals : of the law over the cycle, "sampled" or "exact", which leaves ``samples`` to what needs no such
    accuracy; estimated : whether the truncation error is; without, it counts as 0; marches : whether a start may march
    cycles (a sixth of the program); compare_starts : whether a given start is compared with a marched one;
    slope_samples : times ``samples`` at which derivatives evaluate a sampled law. Its slope has kinks: where teeth
    hammer few samples of a solve lie in its transition zones, and derivatives from them alone are off by 8 % and more.
    """

    samples: int
    time_steps: int
    excited: int
    method: str = "reduced"
    residual_tolerance: float = 1e-10
    max_steps: int = 24
    integrals: str = "sampled"
    estimated: bool = True
    marches: bool = True
    compare_starts: bool = False
    slope_samples: int = 16


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Start:
    """Where Newton starts: coefficients ``(G, N+1)`` where ``given``, else teeth in contact and ``cycles`` marched.

    With ``Sizes.compare_starts`` cycles are marched as well where a given motion leaves more than ``march_above`` of
    the equations unsolved, and the better of the two is the start. A march ends early where a cycle closes to
    ``periodicity_tolerance``.
    """

    coefficients: jax.Array
    given: jax.Array
    cycles: jax.Array
    periodicity_tolerance: jax.Array | float = 0.0


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Outcome:
    """Fields of the solution, deflections ``(G, N+1)`` of the active meshes, and how the solve went.

    periodicity_error : of the last cycle marched, nan where that is not finite and 0 where nothing was marched;
    residual, truncation_error, power_defect; steps : of Newton.
    """

    fields: object
    deflection: jax.Array
    status: jax.Array
    periodicity_error: jax.Array
    residual: jax.Array
    truncation_error: jax.Array
    power_defect: jax.Array
    steps: jax.Array


@partial(Program, static_argnames="sizes")
def solve_problem(problem, active_meshes, start, limit, sizes):
    """Solve one problem.

    Parameters
    ----------
    problem : Problem; active_meshes : ActiveMeshes
    start : Start
    limit : float, largest estimate of the truncation error that counts as converged (:attr:`Plan.limit`)
    sizes : Sizes (static)

    Returns
    -------
    Outcome
    """
    # The iteration is not differentiated: the implicit function theorem gives the derivative of what it found.
    frozen = lax.stop_gradient((problem, start, limit))
    return differentiable(problem, active_meshes, find(frozen[0], active_meshes, *frozen[1:], sizes), sizes)


def differentiable(problem, active_meshes, found, sizes):
    """The Outcome that :func:`find` found, with its derivative with respect to ``problem``."""
    outcome, at, solved = found
    fields, deflection = attach(sizes, problem, active_meshes, at, solved, outcome.fields, outcome.deflection)
    return dataclasses.replace(outcome, fields=fields, deflection=deflection)


def find(problem, active_meshes, start, limit, sizes):
    """The Outcome without derivatives, what :func:`attach` needs of its motion, whether it solves."""
    # N is the length of the start; the plan sees to it that ``sizes.samples`` are SAMPLES_PER_HARMONIC times N.
    harmonics = start.coefficients.shape[-1] - 1
    none = len(active_meshes.mask) == 0
    # The estimate of the truncation error asks for receptances of 2 N harmonics: made once, cut for the solve.
    reach = 2 * harmonics if sizes.estimated and not none else harmonics
    fine, condensed = reduced_equation(problem, reach, active_meshes)
    reduced = dataclasses.replace(condensation.truncate(fine, harmonics), integrals=sizes.integrals)
    periodicity_error, error, truncation = jnp.zeros(()), jnp.zeros(()), jnp.zeros(())
    operator = None
    steps, stalled = jnp.array(0), jnp.array(False)
    deflection = reduced.linear
    if not none:
        model = model_of(problem, active_meshes, sizes.time_steps)
        first, periodicity_error = _first(reduced, model.space, start, sizes)
        numbers = {"samples": sizes.samples, "time_steps": sizes.time_steps}
        if sizes.method == "chain":
            deflection, iterate = _by_chain(problem, active_meshes, reduced, condensed, first, sizes)
            operator = correction.prepare(reduced, model, deflection, **numbers)
            error = relative_residual(reduced, reduced.residual(deflection, sizes.samples))
        else:
            goal = {"tolerance": sizes.residual_tolerance, "max_steps": sizes.max_steps}
            iterate, operator = solve_reduced(reduced, model, first, **numbers, **goal)
            deflection, error = iterate.x, iterate.error
        if sizes.estimated:
            truncation = truncation_error(fine, operator, deflection, sizes.samples)
        steps, stalled = iterate.steps, iterate.stalled
    reduced, crossings = reduced.with_crossings(deflection), None
    nonlinear_force = reduced.nonlinear_force_coefficients(deflection, sizes.samples)
    motion = condensed.combine(nonlinear_force)
    found = fields(problem, *motion, sizes)
    defect = power_defect(problem, *motion, found)
    if sizes.integrals == "exact":
        crossings = (
            reduced.crossings,
            exact_integrals.find_crossings(jax.tree.map(jnp.asarray, problem.meshes.law), found.deflections),
        )
    failure = _failure(problem, active_meshes, reduced, condensed, found, error, stalled, crossings, sizes)
    solved = failure == Status.CONVERGED
    status = jnp.where(solved & ~(truncation <= limit), Status.TOLERANCE_NOT_MET, failure)
    return (
        Outcome(found, deflection, status, periodicity_error, error, truncation, defect, steps),
        (operator, crossings),
        solved,
    )


def _first(reduced, space, start, sizes):
    """Where Newton starts, coefficients ``(G, N+1)``, and the periodicity error of the march, 0 without."""
    begun = jnp.where(start.given, start.coefficients, deflections_on_flank(reduced))

    def march():
        return marched(reduced, space, sizes.time_steps, start.cycles, start.periodicity_tolerance)

    if not sizes.marches:
        return begun, jnp.zeros(())
    if not sizes.compare_starts:
        return lax.cond(start.cycles > 0, march, lambda: (begun, jnp.zeros(())))
    sampled = dataclasses.replace(reduced, integrals="sampled")

    def left(deflection):
        return relative_residual(sampled, sampled.residual(deflection, sizes.samples))

    def better():
        found, periodicity_error = march()
        worse = lax.cond(given, lambda found: ~(left(found) < remaining), lambda _: False, found)
        return jnp.where(worse, begun, found), jnp.where(worse, 0.0, periodicity_error)

    given = start.given & (start.cycles > 0)
    remaining = lax.cond(given, left, lambda _: jnp.inf, begun)
    marching = (start.cycles > 0) & (remaining > SOLVE.march_above)
    return lax.cond(marching, better, lambda: (begun, jnp.zeros(())))


def _by_chain(problem, active_meshes, reduced, condensed, start, sizes):
    """Newton on all disks by the block sweep; meshes held on a flank follow the whole law here."""
    system, meshes = problem.system, problem.meshes
    displacement, _ = condensed.combine(reduced.nonlinear_force_coefficients(start, sizes.samples))
    iterate = solve_chain(
        system,
        meshes,
        problem.frequency,
        fourier.resize(jnp.asarray(problem.load), displacement.shape[-1] - 1),
        fourier.pack(displacement),
        samples=sizes.samples,
        tolerance=1e-13,
        max_steps=sizes.max_steps,
    )
    found = system.deflections(fourier.unpack(iterate.x), problem.links(active_meshes))
    return found * active_meshes.mask[:, None], iterate


def _failure(problem, active_meshes, reduced, condensed, found, error, stalled, crossings, sizes):
    """The status as far as the equations go, CONVERGED whatever the truncation error."""
    finite = jnp.isfinite(error) & jnp.all(jnp.isfinite(found.angles.real + found.angles.imag))
    _, linear = judged(*condensed.balance)
    # Teeth in the gap push at harmonics that no torque has, where the train may be at resonance as well.
    compliance = jnp.max(jnp.abs(reduced.receptance), initial=0.0) * jnp.max(reduced.law.stiffness, initial=0.0)
    held = held_in_contact(problem, found.deflections, active_meshes.flank, sizes.samples)
    unsolved = jnp.where(stalled, Status.STALLED, Status.MAX_STEPS)
    status = jnp.where(error <= sizes.residual_tolerance, Status.CONVERGED, unsolved)
    complete = jnp.array(True) if crossings is None else crossings[0].complete & crossings[1].complete
    # The later, the stronger: a motion that is not finite says nothing of the plan, and at a resonance without damping
    # nothing else means anything.
    status = jnp.where(held & complete, status, Status.PLAN_VIOLATED)
    status = jnp.where(linear == Status.UNBALANCED, linear, status)
    status = jnp.where(finite, status, Status.NONFINITE)
    linear = jnp.where(compliance > SINGULAR, jnp.maximum(linear, Status.NEAR_SINGULAR), linear)
    return jnp.where(linear >= Status.NEAR_SINGULAR, linear, status)


@partial(Program, static_argnames="sizes")
def estimate(problem, active_meshes, deflection, sizes):
    """The truncation error of a motion found without it: deflections ``(G, N+1)`` of the active meshes."""
    harmonics = deflection.shape[-1] - 1
    fine, _ = reduced_equation(problem, 2 * harmonics, active_meshes)
    reduced = condensation.truncate(fine, harmonics)
    model = model_of(problem, active_meshes, sizes.time_steps)
    operator = correction.prepare(reduced, model, deflection, sizes.samples, sizes.time_steps)
    return truncation_error(fine, operator, deflection, sizes.samples)


def truncation_error(fine, operator, deflection, samples):
    """Estimated sup-norm error of the elastic force / its largest value: one Newton correction on 2 N harmonics.

    ``fine`` is the reduced equation with 2 N harmonics, ``deflection`` ``(G, N+1)`` its solution with N harmonics and
    ``samples`` time samples. The residual on harmonics N+1 .. 2N is included: below the mesh modes a difference of two
    levels is no estimate.
    """
    harmonics = fine.linear.shape[-1] - 1
    wide = fourier.resize(deflection, harmonics)
    residual = fine.residual(wide, 2 * samples)
    forcing = SOLVE.estimate_forcing, SOLVE.estimate_steps
    change, left, _ = correction.correct(fine, operator, wide, residual, 2 * samples, *forcing)
    law = fine.law.expand()
    before = backlash.force(law, fourier.synthesize(wide, 2 * samples))
    after = backlash.force(law, fourier.synthesize(wide - change, 2 * samples))
    noise = SOLVE.unloaded * jnp.max(law.stiffness * law.backlash)  # of solved equations, where no tooth carries a load
    estimate = jnp.max(jnp.abs(after - before)) / jnp.maximum(jnp.max(jnp.abs(before)), jnp.maximum(noise, 1e-300))
    return estimate / (1 - jnp.minimum(left, 0.999))

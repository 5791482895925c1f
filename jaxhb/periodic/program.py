"""The compiled solve: one problem, one choice of meshes, fixed sizes. No decisions by value, no names."""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp

from ..harmonic import backlash, fourier, reduction, support
from ..harmonic.gmres import gmres
from ..transient.statespace import Partition
from .march import march_start, start_from
from .newton import Status, relative_residual, solve_chain, solve_reduced
from .problem import excess_load, fields, held_in_contact, reduced_equation


@dataclass(frozen=True)
class Sizes:
    """What a program is compiled for.

    samples : instants per cycle of the law; room, resolved : instants out of contact and
    harmonics in the preconditioner; method : "reduced" or
    "chain"; origin : "given", "linear" or "march", where Newton starts; count :
    active meshes without padding; cycles, march_steps, excited, parts : of the march; residual_tolerance, max_steps : of Newton.
    """

    samples: int
    room: int
    resolved: int
    method: str = "reduced"
    origin: str = "linear"
    count: int = 0
    cycles: int = 6
    march_steps: int = 0
    excited: int = 0
    parts: Partition | None = None
    residual_tolerance: float = 1e-10
    max_steps: int = 40


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Choice:
    """Which meshes are unknowns: active ``(G,)`` 1 or 0 (padding), chosen ``(G,)`` mesh, flank ``(M,)`` +1, -1, or 0."""

    active: jax.Array
    chosen: jax.Array
    flank: jax.Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Outcome:
    """Fields of the solution, deflections ``(G, N+1)`` of the active meshes, and how the solve went."""

    fields: object
    deflection: jax.Array
    status: jax.Array
    residual: jax.Array
    truncation_error: jax.Array
    steps: jax.Array
    krylov: jax.Array


@partial(jax.jit, static_argnames="sizes")
def solve_problem(problem, choice, start, tolerance, sizes):
    """Solve one problem.

    Parameters
    ----------
    problem : Problem; choice : Choice
    start : complex ``(G, N+1)`` m, used where ``sizes.origin`` is "given"
    tolerance : float, on the truncation error
    sizes : Sizes (static)

    Returns
    -------
    Outcome
    """
    load = jnp.asarray(problem.load)
    harmonics = load.shape[-1] - 1
    nothing = jnp.zeros((0, harmonics + 1), dtype=complex)
    if not len(choice.active):
        whole = excess_load(problem, None, nothing, choice.active, choice.chosen, choice.flank, sizes.samples)
        found = fields(problem, whole, sizes.samples)
        zero, count = jnp.array(0.0), jnp.array(0)
        status = _status(problem, choice, found, zero, zero, count, jnp.array(False), tolerance, sizes)
        return Outcome(found, nothing, status, zero, zero, count, count)
    reduced = reduced_equation(problem, choice.active, choice.chosen, choice.flank)
    if sizes.origin == "linear":
        start = reduced.linear
    elif sizes.origin == "march":
        _, trace, _ = march_start(
            problem,
            choice,
            sizes.count,
            cycles=sizes.cycles,
            steps=sizes.march_steps,
            excited=sizes.excited,
            parts=sizes.parts,
        )
        start = start_from(trace, harmonics)
    solver = _by_chain if sizes.method == "chain" else _by_reduction
    deflection, iterate = solver(problem, choice, reduced, start, sizes)
    error = relative_residual(reduced, reduced.residual(deflection, sizes.samples))
    truncation = truncation_error(problem, choice, reduced, deflection, sizes)
    whole = excess_load(problem, reduced, deflection, choice.active, choice.chosen, choice.flank, sizes.samples)
    found = fields(problem, whole, sizes.samples)
    status = _status(problem, choice, found, error, truncation, iterate.steps, iterate.stalled, tolerance, sizes)
    return Outcome(found, deflection, status, error, truncation, iterate.steps, iterate.krylov)


def _by_reduction(problem, choice, reduced, start, sizes):
    iterate = solve_reduced(
        reduced,
        start,
        samples=sizes.samples,
        room=sizes.room,
        resolved=sizes.resolved,
        tolerance=sizes.residual_tolerance,
        max_steps=sizes.max_steps,
    )
    return iterate.x, iterate


def _by_chain(problem, choice, reduced, start, sizes):
    """Newton on all disks by the block sweep; meshes held on a flank follow the whole law here."""
    system, meshes = problem.system, problem.meshes
    whole = excess_load(problem, reduced, start, choice.active, choice.chosen, choice.flank, sizes.samples)
    omega = reduction.frequencies(problem.frequency, whole.shape[-1] - 1)
    displacement, _ = reduction.solve_linear(system, omega, whole[..., None])
    iterate = solve_chain(
        system,
        meshes,
        problem.frequency,
        jnp.asarray(problem.load),
        fourier.pack(displacement[..., 0]),
        samples=sizes.samples,
        tolerance=1e-13,
        max_steps=sizes.max_steps,
    )
    links = jnp.asarray(meshes.link)[choice.chosen]
    return system.deflections(fourier.unpack(iterate.x), links) * choice.active[:, None], iterate


def _status(problem, choice, found, error, truncation, steps, stalled, tolerance, sizes):
    finite = jnp.isfinite(error) & jnp.all(jnp.isfinite(found.angles.real + found.angles.imag))
    held = held_in_contact(problem, found.deflections, choice.flank, sizes.samples)
    balanced = jnp.abs(problem.imbalance) <= 1e-9 * problem.torque_scale
    unsolved = jnp.where(stalled, Status.STALLED, Status.MAX_STEPS)
    status = jnp.where(truncation <= tolerance, Status.CONVERGED, Status.TOLERANCE_NOT_MET)
    status = jnp.where(held, status, Status.PLAN_VIOLATED)
    status = jnp.where(error <= sizes.residual_tolerance, status, unsolved)
    status = jnp.where(problem.system.floating & ~balanced, Status.UNBALANCED, status)
    return jnp.where(finite, status, Status.NONFINITE)


def truncation_error(problem, choice, reduced, deflection, sizes):
    """Estimated sup-norm error of the elastic force / its largest value: one Newton correction on 2 N harmonics.

    The residual on harmonics N+1 .. 2N is included: below the mesh modes a difference of two levels is no estimate.
    """
    meshes, width = deflection.shape
    fine = _padded_problem(problem, 2 * (width - 1))
    reduced_fine = reduced_equation(fine, choice.active, choice.chosen, choice.flank)
    wide = fourier.resize(deflection, 2 * (width - 1))
    samples = 2 * sizes.samples
    values, rates = reduced_fine.sampled(wide, samples)
    _, slope, rate_slope = reduced_fine.excess(values, rates)
    factored = support.prepare(reduced_fine, slope, rate_slope, sizes.room, sizes.resolved)

    def unpacked(flat):
        return fourier.unpack(flat.reshape(meshes, -1))

    def tangent(flat):
        v = unpacked(flat)
        change, rate = reduced_fine.sampled(v, samples)
        excess = fourier.analyze(slope * change + rate_slope * rate, 2 * (width - 1))
        return fourier.pack(v + reduced_fine.respond(excess)).reshape(-1)

    def inverse(flat):
        return fourier.pack(support.apply(reduced_fine, factored, unpacked(flat))).reshape(-1)

    residual = reduced_fine.residual(wide, samples)
    flat, _, _ = gmres(tangent, inverse, fourier.pack(residual).reshape(-1), tolerance=0.05, steps=30)
    law = reduced.law.expand()
    before = backlash.force(law, values)
    after = backlash.force(law, fourier.synthesize(wide - unpacked(flat), samples))
    largest = jnp.max(jnp.abs(before))
    return jnp.max(jnp.abs(after - before)) / jnp.where(largest > 0, largest, 1.0)


def _padded_problem(problem, harmonics):
    fields_of = dict(vars(problem))
    fields_of["load"] = fourier.resize(jnp.asarray(problem.load), harmonics)
    return type(problem)(**fields_of)

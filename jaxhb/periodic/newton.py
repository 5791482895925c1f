"""Newton-Kantorovich iteration with line search in ``lax.while_loop``, and the status of a solve."""

from enum import IntEnum
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from ..harmonic import fourier, support
from ..harmonic.block_sweep import block_sweep
from ..harmonic.krylov import minimise_residual
from ..harmonic.residual import link_blocks, node_blocks, residual


class Status(IntEnum):
    """Outcome of a solve; larger is worse. ``sentence`` says it for people."""

    CONVERGED = 0
    TOLERANCE_NOT_MET = 1
    PLAN_VIOLATED = 2
    MAX_STEPS = 3
    STALLED = 4
    UNBALANCED = 5
    NEAR_SINGULAR = 6
    NONFINITE = 7

    @property
    def sentence(self):
        """What happened and what to try."""
        return _SENTENCES[self]


_REMEDY = (
    "ask for more harmonics (above the mesh modes), start from the response at a neighbouring speed, or look whether "
    "time integration settles there at all"
)
_SENTENCES = {
    Status.CONVERGED: "converged",
    Status.TOLERANCE_NOT_MET: "the equations are solved, but the number of harmonics is too small for the asked "
    "tolerance: ask for more harmonics",
    Status.PLAN_VIOLATED: "a mesh that the plan held on one flank leaves it: plan again, or solve without a plan",
    Status.MAX_STEPS: "Newton's method needed more steps than allowed: " + _REMEDY,
    Status.STALLED: "Newton's method found no step that lowers the residual: " + _REMEDY,
    Status.UNBALANCED: "the mean torques do not balance and nothing takes the difference: add a [[load]] or correct "
    "the mean torques",
    Status.NEAR_SINGULAR: "the equations are singular here (an undamped resonance): add damping or move the speed",
    Status.NONFINITE: "the solution is not finite: look for huge or tiny numbers in the scene",
}


class Iterate(NamedTuple):
    """Unknowns, residual norm, Newton steps, Krylov steps, and whether no step lowers the residual."""

    x: jax.Array
    error: jax.Array
    steps: jax.Array
    krylov: jax.Array
    stalled: jax.Array


def newton(evaluate, direction, norm, start, *, tolerance, max_steps):
    """Solve ``evaluate(x) = 0`` from ``start``; a start that already solves it is accepted as it is.

    Parameters
    ----------
    evaluate : x -> residual
    direction : (x, residual, error) -> (correction, work)
        Solves ``J correction = residual``; ``work`` is added up in ``Iterate.krylov``.
    norm : residual -> float
    start : array
    tolerance : float, on ``norm``
    max_steps : int

    Returns
    -------
    Iterate
        With the smallest residual met; finite if the start was.
    """

    def unfinished(state):
        iterate, _ = state
        return (iterate.error > tolerance) & (iterate.steps < max_steps) & ~iterate.stalled

    def step(state):
        iterate, value = state
        correction, work = direction(iterate.x, value, iterate.error)
        moved, after, error = _line_search(evaluate, norm, iterate, value, correction)
        stalled = ~(error < iterate.error)
        following = Iterate(
            jnp.where(stalled, iterate.x, moved),
            jnp.where(stalled, iterate.error, error),
            iterate.steps + 1,
            iterate.krylov + work,
            stalled,
        )
        return following, jnp.where(stalled, value, after)

    value = evaluate(start)
    first = Iterate(start, norm(value), jnp.array(0), jnp.array(0), jnp.array(False))
    return lax.while_loop(unfinished, step, (first, value))[0]


def _line_search(evaluate, norm, iterate, value, correction):
    """Halve the step until the residual falls by the Armijo share, at most ten times."""

    def poor(state):
        length, _, _, error = state
        return ~(error < (1 - 1e-4 * length) * iterate.error) & (length > 1e-3)

    def halve(state):
        length = state[0] / 2
        moved = iterate.x - length * correction
        value = evaluate(moved)
        return length, moved, value, norm(value)

    return lax.while_loop(poor, halve, (jnp.array(2.0), iterate.x, value, jnp.array(jnp.inf)))[1:]


def relative_residual(reduced, value):
    """max over meshes of ||F|| / (||l_lin|| + h), root mean square over the cycle, dimensionless."""
    size = jnp.linalg.norm(fourier.pack(value), axis=-1)
    scale = jnp.linalg.norm(fourier.pack(reduced.linear), axis=-1) + reduced.law.backlash
    return jnp.max(size / scale)


def solve_reduced(reduced, start, *, samples, room, resolved, tolerance, max_steps, krylov=60):
    """Newton on the reduced equation, unknowns the deflections ``(G, N+1)`` of the active meshes.

    ``samples`` per cycle for the law (a multiple of 2 N); ``room`` for instants out of contact and ``resolved``
    harmonics in the preconditioner.
    """

    def evaluate(deflection):
        return reduced.residual(deflection, samples)

    def direction(deflection, value, error):
        forcing = jnp.clip(0.05 * tolerance / error, 1e-10, 1e-2)
        forcing = jnp.maximum(forcing, jnp.minimum(1e-2, 0.1 * error))
        correction, _, used = correct(reduced, deflection, value, samples, room, resolved, forcing, krylov)
        return correction, used

    return newton(
        evaluate,
        direction,
        lambda value: relative_residual(reduced, value),
        start,
        tolerance=tolerance,
        max_steps=max_steps,
    )


def correct(reduced, deflection, value, samples, room, resolved, forcing, krylov):
    """``J correction = value`` at ``deflection`` by preconditioned Krylov steps: (correction, what is left, steps)."""
    meshes, width = deflection.shape
    _, slope, rate_slope = reduced.excess(*reduced.sampled(deflection, samples))
    factored = support.prepare(reduced, slope, rate_slope, room, resolved)

    def unpacked(flat):
        return fourier.unpack(flat.reshape(meshes, 2 * width - 1))

    def tangent(flat):
        v = unpacked(flat)
        change, rate = reduced.sampled(v, samples)
        excess = fourier.analyze(slope * change + rate_slope * rate, width - 1)
        return fourier.pack(v + reduced.respond(excess)).reshape(-1)

    def inverse(flat):
        return fourier.pack(support.apply(reduced, factored, unpacked(flat))).reshape(-1)

    flat, left, used = minimise_residual(
        tangent, inverse, fourier.pack(value).reshape(-1), tolerance=forcing, steps=krylov
    )
    return unpacked(flat), left, used


def solve_chain(system, meshes, frequency, load, start, *, samples, tolerance, max_steps):
    """Newton on all disks, each step one block sweep over the tree; unknowns packed ``(S, 2N+1)``.

    The seed's method, kept as an oracle: memory and work grow with ``S N^2`` and ``S N^3``. ``tolerance`` is relative
    to the largest force in the balance. A tree is needed: the caller refuses closed loops.
    """
    tree = system.tree
    near = jnp.where(tree.from_a, system.arm_a[tree.link], system.arm_b[tree.link])
    far = jnp.where(tree.from_a, system.arm_b[tree.link], system.arm_a[tree.link])
    node = node_blocks(system, frequency, load.shape[-1] - 1)
    hold = jnp.where(system.floating, 1.0, 0.0)
    root = tree.node[-1]
    node = node.at[root, 0, 0].add(hold)
    scale = jnp.linalg.norm(fourier.pack(load)) + jnp.max(meshes.law.stiffness * meshes.law.backlash, initial=0.0)

    def evaluate(packed):
        value = residual(packed, system, meshes, frequency, load, samples)
        return value.at[root, 0].add(hold * packed[root, 0])

    def direction(packed, value, error):
        blocks = link_blocks(packed, system, meshes, frequency, samples)[tree.link]
        x, _ = block_sweep(tree.parent, near, far, blocks, node[tree.node], value[tree.node])
        return jnp.zeros_like(x).at[tree.node].set(x), 1

    return newton(
        evaluate,
        direction,
        lambda value: jnp.linalg.norm(value) / scale,
        start,
        tolerance=tolerance,
        max_steps=max_steps,
    )

"""Newton-Kantorovich iteration with line search in ``lax.while_loop``, and the status of a solve."""

from enum import IntEnum
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from ..harmonic import fourier
from ..harmonic.block_sweep import block_sweep
from ..harmonic.residual import link_blocks, node_blocks, residual
from . import correction

KRYLOV_STEPS = 20
WORN = 12
"""Krylov steps of a Newton step above which the preconditioner is made anew."""


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
    Status.PLAN_VIOLATED: "a mesh that the plan held on one flank leaves it, or passes the knots of its law more "
    "often than exact integrals have room for: plan again, solve without a plan, or with sampled integrals",
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


def newton(evaluate, prepare, direction, norm, start, *, tolerance, max_steps, worn=0):
    """Solve ``evaluate(x) = 0`` from ``start``; a start that already solves it is accepted as it is.

    Parameters
    ----------
    evaluate : x -> residual
    prepare : x -> whatever ``direction`` needs and is worth keeping for several steps
    direction : (prepared, x, residual, error) -> (correction, work)
        Solves ``J correction = residual``; ``work`` is added up in ``Iterate.krylov``.
    norm : residual -> float
    start : array
    tolerance : float, on ``norm``
    max_steps : int
    worn : int
        Work of a step above which the next one is prepared anew; so is a step after one that found no descent.

    Returns
    -------
    iterate : Iterate
        With the smallest residual met; finite if the start was.
    prepared
        What was prepared last.
    """

    def unsolved(iterate):
        return (iterate.error > tolerance) & (iterate.steps < max_steps)

    def step(state):
        iterate, value, _, age, prepared = state
        correction, work = direction(prepared, iterate.x, value, iterate.error)
        moved, after, error = _line_search(evaluate, norm, iterate, value, correction)
        stalled = ~(error < iterate.error)
        following = Iterate(
            jnp.where(stalled, iterate.x, moved),
            jnp.where(stalled, iterate.error, error),
            iterate.steps + 1,
            iterate.krylov + work,
            stalled,
        )
        return following, jnp.where(stalled, value, after), work, age + 1, prepared

    def fresh(state):
        iterate, value, _, _, _ = state
        state = (iterate, value, jnp.array(0), jnp.array(0), prepare(iterate.x))
        return lax.while_loop(lambda s: unsolved(s[0]) & ~s[0].stalled & (s[2] <= worn), step, state)

    def unfinished(state):
        iterate, _, _, age, _ = state
        return (age < 0) | unsolved(iterate) & ~(iterate.stalled & (age <= 1))

    value = evaluate(start)
    first = Iterate(start, norm(value), jnp.array(0), jnp.array(0), jnp.array(False))
    empty = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), jax.eval_shape(prepare, start))
    state = lax.while_loop(unfinished, fresh, (first, value, jnp.array(0), jnp.array(-1), empty))
    return state[0], state[-1]


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


def solve_reduced(reduced, train, start, *, samples, instants, tolerance, max_steps):
    """Newton on the reduced equation, unknowns the deflections ``(G, N+1)`` of the active meshes.

    Parameters
    ----------
    reduced : Reduced; train : Surrogate, for the preconditioner
    start : complex array ``(G, N+1)`` m
    samples : int, instants of the law, a multiple of 2 N; instants : int, of the preconditioner

    Returns
    -------
    Iterate, Variation
    """

    def prepare(deflection):
        return correction.prepare(reduced, train, deflection, samples, instants)

    def direction(variation, deflection, value, error):
        forcing = jnp.clip(0.05 * tolerance / error, 1e-10, 1e-2)
        forcing = jnp.maximum(forcing, jnp.minimum(1e-2, 0.1 * error))
        change, _, used = correction.correct(reduced, variation, deflection, value, samples, forcing, KRYLOV_STEPS)
        return change, used

    return newton(
        lambda deflection: reduced.residual(deflection, samples),
        prepare,
        direction,
        lambda value: relative_residual(reduced, value),
        start,
        tolerance=tolerance,
        max_steps=max_steps,
        worn=WORN,
    )


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

    def direction(_, packed, value, error):
        blocks = link_blocks(packed, system, meshes, frequency, samples)[tree.link]
        x, _ = block_sweep(tree.parent, near, far, blocks, node[tree.node], value[tree.node])
        return jnp.zeros_like(x).at[tree.node].set(x), 1

    return newton(
        evaluate,
        lambda packed: (),
        direction,
        lambda value: jnp.linalg.norm(value) / scale,
        start,
        tolerance=tolerance,
        max_steps=max_steps,
    )[0]

"""Newton-Kantorovich iteration, damped by the natural level, in ``lax.while_loop``.

A step ``x - lambda J^-1 F`` counts as good if the residual falls by half of what its
linear model promises. Where the tangent is nearly singular, beside a grazing impact,
good steps let the residual rise, and a search for smaller ones creeps. There the
natural level decides (:mod:`jaxhb.equations.iterations`): the simplified correction
``J^-1 F(x - lambda J^-1 F)`` must be shorter than the correction.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxhb.balance import correction
from jaxhb.balance.sizes import LIGHT, relative_residual
from jaxhb.equations import backlash, fourier, iterations

KRYLOV_STEPS = 60  # of a Newton step at most
# Share of the residual that a correction may leave, and a simplified one. Kinks of the
# law make Newton's method no better than linear until the last steps: tighter
# corrections take twice as many Krylov steps for a fifth fewer others.
FORCING = 0.03
LEVEL_FORCING = 0.01
# Share of a whole step that it leaves at most, where its size tells how far the
# solution is
LEAVES = 0.1
# Residual from which a step goes for the goal, and by what share it aims below, where
# derivatives are to follow.
NEAR = 1e-6
BELOW = 0.05


class Iterate(NamedTuple):
    """Unknowns, residual norm, linear solves, whether no step leads closer, and the
    size of the step that led here, inf unless it was a whole one that left little of
    itself.
    """

    x: jax.Array
    error: jax.Array
    steps: jax.Array
    stalled: jax.Array
    step: jax.Array


class _State(NamedTuple):
    """value : residual at the iterate; given : residual that the next linear solve is
    for, the same or, while a step is on trial, that of the trial; correction : at the
    iterate, or the last simplified one; length : of the trial; gain : from which the
    length of the next step is predicted.
    """

    iterate: Iterate
    value: jax.Array
    given: jax.Array
    correction: jax.Array
    length: jax.Array
    gain: jax.Array
    trying: jax.Array


def _solve(evaluate, direction, norm, state):
    """One linear solve: for a correction and the first trial of its length, or for the
    level of the trial.

    Either ends with a trial, so that the loop has one body with one linear solve: most
    of the work, and of what is compiled.
    """
    iterate = state.iterate
    trying = state.trying
    forcing = jnp.where(trying, LEVEL_FORCING, FORCING)
    found = direction(state.given, iterate.error, forcing)
    correction = jnp.where(trying, state.correction, found)
    size = norm(correction)
    found_size = norm(found)
    # On trial, what was found is the simplified correction: the trial is taken now, or
    # a shorter one is made.
    lower = trying & iterations.lowers_level(found_size, size, state.length)
    curvature = norm(found - (1 - state.length) * correction)
    on_trial = jnp.where(
        lower, state.length, iterations.shorter_length(state.length, size, curvature)
    )
    # At an iterate, state.correction is the simplified one of the step that led there:
    # the length is foreseen from it. A step that the residual accepted leaves none, but
    # an infinite gain: the whole correction is tried.
    foreseen = iterations.predicted_length(
        state.gain, norm(state.correction - found), size
    )
    length = jnp.where(trying, on_trial, foreseen)
    moved = iterate.x - length * correction
    after = evaluate(moved)
    error = norm(after)
    # The residual is at hand and the level costs a linear solve: where the residual
    # falls, it is not asked for.
    good = lower | (error < (1 - length / 2) * iterate.error)
    # A step tells how far the solution is only where it leaves little of itself.
    left = jnp.where(lower, found_size / size, error / iterate.error)
    telling = (length == 1) & (left < LEAVES)
    following = Iterate(
        jnp.where(good, moved, iterate.x),
        jnp.where(good, error, iterate.error),
        iterate.steps + 1,
        ~good & (length < iterations.SHORTEST),
        jnp.where(good, jnp.where(telling, size, jnp.inf), iterate.step),
    )
    return _State(
        following,
        value=jnp.where(good, after, state.value),
        given=after,
        correction=jnp.where(lower, found, correction),
        length=length,
        gain=jnp.where(
            lower, size * found_size * length, jnp.where(good, jnp.inf, state.gain)
        ),
        trying=~good,
    )


def newton(
    evaluate,
    prepare,
    direction,
    norm,
    start,
    *,
    tolerance,
    max_steps,
    step_tolerance=0.0,
    step=jnp.inf,
):
    """Solve ``evaluate(x) = 0`` from ``start``, which is accepted as it is if it
    already solves: the last Iterate, finite if the start was.

    norm : of a residual or correction, on which ``tolerance`` and ``step_tolerance``,
    of a whole step, are; prepare : x -> whatever ``direction`` needs at an iterate;
    direction : (prepared, residual, error at x, forcing) -> correction, solves ``J(x)
    correction = residual`` to that share of the residual or less; max_steps : linear
    solves; step : how far the start is from the solution, in that norm, where this is
    known.
    """

    def unsolved(iterate):
        unknown = (iterate.error > tolerance) & ~(iterate.step < step_tolerance)
        return unknown & (iterate.steps < max_steps) & ~iterate.stalled

    def at_iterate(state):
        """All trials at one iterate, with what is prepared there."""
        direct = partial(direction, prepare(state.iterate.x))

        def untaken(carry):
            fresh, state = carry
            return (fresh | state.trying) & unsolved(state.iterate)

        def solve(carry):
            return jnp.array(False), _solve(evaluate, direct, norm, carry[1])

        return lax.while_loop(untaken, solve, (jnp.array(True), state))[1]

    value = evaluate(start)
    first = Iterate(
        start, norm(value), jnp.array(0), jnp.array(False), jnp.asarray(step, float)
    )
    one = jnp.array(1.0)
    infinite = jnp.array(jnp.inf)
    begin = _State(
        first, value, value, jnp.zeros_like(start), one, infinite, jnp.array(False)
    )
    return lax.while_loop(
        lambda state: unsolved(state.iterate), at_iterate, begin
    ).iterate


def solve_reduced(
    reduced,
    train,
    start,
    *,
    samples,
    tolerance,
    max_steps,
    step_tolerance=0.0,
    step=jnp.inf,
):
    """Newton on the condensed equation from deflections ``(G, N+1)`` of the active
    meshes: Iterate.

    train : its :class:`~jaxhb.balance.correction.LinearTrain`; samples : of the law, a
    multiple of 2 N.
    """

    def prepare(deflection):
        slopes = correction.slopes_at(reduced, deflection, samples)
        return slopes, correction.march_at(train, slopes)

    def direction(prepared, value, error, forcing):
        slopes, march = prepared
        aimed = jnp.clip(BELOW * tolerance / error, 1e-10, forcing)
        forcing = jnp.where((error < NEAR) & (step_tolerance == 0), aimed, forcing)
        change, _, _ = correction.correct(
            reduced, march, slopes, value, forcing, KRYLOV_STEPS
        )
        return change

    def evaluate(deflection):
        return reduced.residual(deflection, samples)

    norm = partial(relative_residual, reduced)
    goal = {
        "tolerance": tolerance,
        "max_steps": max_steps,
        "step_tolerance": step_tolerance,
        "step": step,
    }
    return newton(evaluate, prepare, direction, norm, start, **goal)


def solve_chain(balance, start, *, tolerance, max_steps):
    """Newton on all disks, each step one block sweep over the tree, from packed
    displacements ``(S, 2N+1)``: Iterate, deflections ``(L, N+1)`` of all links.

    Fridman's method, kept as an oracle: memory and work grow with ``S N^2`` and ``S
    N^3``. ``tolerance`` is relative to the largest force in the balance, of light loads
    to theirs (:func:`~jaxhb.balance.sizes.deflection_scale`). A tree is needed: the
    caller refuses closed loops.
    """
    driven = jnp.linalg.norm(fourier.pack(balance.load))
    gap = 2 * jnp.max(backlash.offset(balance.meshes.law), initial=0.0)
    scale = driven + jnp.where(driven > 0, jnp.minimum(gap, LIGHT * driven), gap)
    # Deflections are unknowns beside the displacements: they change by what a sweep
    # finds of them, without the digits that their differences lose in a train that
    # turns far as one.
    first = jnp.concatenate([start, balance.deflections(start)])
    disks = len(start)

    def evaluate(packed):
        return balance.residual_at(packed[:disks], packed[disks:])

    def direction(packed, value, error, forcing):
        return jnp.concatenate(balance.sweep(packed[disks:], value))

    def norm(value):
        return jnp.linalg.norm(value) / scale

    iterate = newton(
        evaluate,
        lambda packed: packed,
        direction,
        norm,
        first,
        tolerance=tolerance,
        max_steps=max_steps,
    )
    return iterate, fourier.unpack(iterate.x[disks:])

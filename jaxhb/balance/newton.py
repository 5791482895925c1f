"""Newton-Kantorovich iteration, damped by the natural level, in ``lax.while_loop``.

A step ``x - lambda J^-1 F`` counts as good if the residual falls by half of what its
linear model promises. Where the tangent is nearly singular, beside a grazing impact,
good steps let the residual rise, and a search for smaller ones creeps. There the
natural level decides (:mod:`jaxhb.equations.iterations`): the simplified correction
``J^-1 F(x - lambda J^-1 F)`` must be shorter than the correction.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxhb._jax import Array, Number
from jaxhb.balance import correction
from jaxhb.balance.correction import LinearMarch, LinearTrain
from jaxhb.balance.sizes import LIGHT, relative_residual
from jaxhb.equations import backlash, fourier, iterations
from jaxhb.equations.condensation import CondensedEquation
from jaxhb.equations.residual import ForceBalance

KRYLOV_STEPS = 60  # of a Newton step at most
# Share of the residual that a correction may leave, and a simplified one. Kinks of the
# law make Newton's method no better than linear until the last steps: tighter
# corrections take twice as many Krylov steps for a fifth fewer others.
FORCING = 0.03
LEVEL_FORCING = 0.01
# Share of itself that a whole step may leave for its size to tell how far the solution
# is
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

    x: Array
    error: Array
    steps: Array
    stalled: Array
    step: Array


class _Iteration(NamedTuple):
    """State of the iteration.

    value : residual at the iterate; right_side : residual that the next linear solve is
    for, the same or, while a step is on trial, that of the trial; correction : at the
    iterate, or the last simplified one; length : of the trial; gain : from which the
    length of the next step is predicted; trying : whether a step is on trial.
    """

    iterate: Iterate
    value: Array
    right_side: Array
    correction: Array
    length: Array
    gain: Array
    trying: Array


def _solve(
    evaluate: Callable[[Array], Array],
    direction: Callable[..., Array],
    norm: Callable[[Array], Array],
    state: _Iteration,
) -> _Iteration:
    """Solve one linear system: for a correction and the first trial of its length, or
    for the level of the trial.

    Either ends with a trial, so that the loop has one body with one linear solve: most
    of the work, and of what is compiled.
    """
    iterate = state.iterate
    trying = state.trying
    forcing = jnp.where(trying, LEVEL_FORCING, FORCING)
    solved = direction(state.right_side, iterate.error, forcing)
    correction = jnp.where(trying, state.correction, solved)
    size = norm(correction)
    solved_size = norm(solved)
    # On trial, the solution is the simplified correction: the trial is accepted now, or
    # a shorter one is made.
    lowers_level = trying & iterations.lowers_level(solved_size, size, state.length)
    curvature = norm(solved - (1 - state.length) * correction)
    length_on_trial = jnp.where(
        lowers_level,
        state.length,
        iterations.shorter_length(state.length, size, curvature),
    )
    # At an iterate, state.correction is the simplified one of the step that led there:
    # the length is predicted from it. A step that the residual accepted leaves none,
    # but an infinite gain: the whole correction is tried.
    predicted = iterations.predicted_length(
        state.gain, norm(state.correction - solved), size
    )
    length = jnp.where(trying, length_on_trial, predicted)
    trial = iterate.x - length * correction
    trial_residual = evaluate(trial)
    error = norm(trial_residual)
    # The residual is at hand and the level costs a linear solve, which is spared where
    # the residual falls.
    is_good = lowers_level | (error < (1 - length / 2) * iterate.error)
    # A step tells how far the solution is only where it leaves little of itself.
    share_left = jnp.where(lowers_level, solved_size / size, error / iterate.error)
    tells_distance = (length == 1) & (share_left < LEAVES)
    following = Iterate(
        x=jnp.where(is_good, trial, iterate.x),
        error=jnp.where(is_good, error, iterate.error),
        steps=iterate.steps + 1,
        stalled=~is_good & (length < iterations.SHORTEST),
        step=jnp.where(is_good, jnp.where(tells_distance, size, jnp.inf), iterate.step),
    )
    return _Iteration(
        iterate=following,
        value=jnp.where(is_good, trial_residual, state.value),
        right_side=trial_residual,
        correction=jnp.where(lowers_level, solved, correction),
        length=length,
        gain=jnp.where(
            lowers_level,
            size * solved_size * length,
            jnp.where(is_good, jnp.inf, state.gain),
        ),
        trying=~is_good,
    )


def newton(
    evaluate: Callable[[Array], Array],
    prepare: Callable[[Array], Any],
    direction: Callable[..., Array],
    norm: Callable[[Array], Array],
    start: Array,
    *,
    tolerance: Number,
    max_steps: int,
    step_tolerance: Number = 0.0,
    distance: Number = jnp.inf,
) -> Iterate:
    """Solve ``evaluate(x) = 0`` from ``start``, which is accepted unchanged if it
    already solves: the last Iterate, finite if the start was.

    norm : of a residual, for ``tolerance``, and of a whole step, for
    ``step_tolerance``; prepare : x -> whatever ``direction`` needs at an iterate;
    direction : (prepared, residual, error at x, forcing) -> correction, solves ``J(x)
    correction = residual`` to that share of the residual or less; max_steps : linear
    solves; distance : how far the start is from the solution, in that norm, where this
    is known.
    """

    def unsolved(iterate: Iterate) -> Array:
        unknown = (iterate.error > tolerance) & ~(iterate.step < step_tolerance)
        return unknown & (iterate.steps < max_steps) & ~iterate.stalled

    def try_lengths(state: _Iteration) -> _Iteration:
        """Make all trials at one iterate, with the linear system prepared there."""
        direction_here = partial(direction, prepare(state.iterate.x))

        def on_trial(carry: tuple[jax.Array, _Iteration]) -> Array:
            fresh, state = carry
            return (fresh | state.trying) & unsolved(state.iterate)

        def solve_once(
            carry: tuple[jax.Array, _Iteration],
        ) -> tuple[jax.Array, _Iteration]:
            return jnp.array(False), _solve(evaluate, direction_here, norm, carry[1])

        return lax.while_loop(on_trial, solve_once, (jnp.array(True), state))[1]

    value = evaluate(start)
    first_iterate = Iterate(
        x=start,
        error=norm(value),
        steps=jnp.array(0),
        stalled=jnp.array(False),
        step=jnp.asarray(distance, float),
    )
    begin = _Iteration(
        iterate=first_iterate,
        value=value,
        right_side=value,
        correction=jnp.zeros_like(start),
        length=jnp.array(1.0),
        gain=jnp.array(jnp.inf),
        trying=jnp.array(False),
    )
    return lax.while_loop(
        lambda state: unsolved(state.iterate), try_lengths, begin
    ).iterate


def solve_reduced(
    reduced: CondensedEquation,
    linear_train: LinearTrain,
    start: Array,
    *,
    samples: int,
    tolerance: Number,
    max_steps: int,
    step_tolerance: Number = 0.0,
    distance: Number = jnp.inf,
) -> Iterate:
    """Newton's method on the condensed equation from deflections ``(G, N+1)`` m of the
    active meshes: the last Iterate.

    linear_train : of the equation; samples : of the law, a multiple of 2 N.
    """

    def prepare(deflection: Array) -> tuple[Array, LinearMarch]:
        slopes = correction.slopes_at(reduced, deflection, samples)
        return slopes, correction.march_at(linear_train, slopes)

    def direction(
        prepared: tuple[Array, LinearMarch], value: Array, error: Array, forcing: Array
    ) -> Array:
        slopes, march = prepared
        aimed = jnp.clip(BELOW * tolerance / error, 1e-10, forcing)
        forcing = jnp.where((error < NEAR) & (step_tolerance == 0), aimed, forcing)
        change, _, _ = correction.correct(
            reduced, march, slopes, value, forcing, KRYLOV_STEPS
        )
        return change

    def evaluate(deflection: Array) -> Array:
        return reduced.residual(deflection, samples)

    return newton(
        evaluate,
        prepare,
        direction,
        partial(relative_residual, reduced),
        start,
        tolerance=tolerance,
        max_steps=max_steps,
        step_tolerance=step_tolerance,
        distance=distance,
    )


def solve_chain(
    balance: ForceBalance, start: Array, *, tolerance: float, max_steps: int
) -> tuple[Iterate, Array]:
    """Newton's method on all disks, each step one block sweep over the tree, from
    packed displacements ``(S, 2N+1)`` m: the last Iterate, and deflections ``(L, N+1)``
    m of all links.

    Fridman's method, here as an oracle: memory and work grow with ``S N^2`` and ``S
    N^3``. ``tolerance`` is relative to the largest force in the balance, or to the
    loads where they are light (:func:`~jaxhb.balance.sizes.deflection_scale`). A tree
    is needed: the caller refuses closed loops.
    """
    driven = jnp.linalg.norm(fourier.pack(balance.load))
    gap = 2 * jnp.max(backlash.offset(balance.meshes.law), initial=0.0)
    scale = driven + jnp.where(driven > 0, jnp.minimum(gap, LIGHT * driven), gap)
    # Deflections are unknowns beside the displacements: they change by the deflections
    # of a sweep, without the digits that differences lose in a train that turns far as
    # a whole.
    first_unknowns = jnp.concatenate([start, balance.deflections(start)])
    disks = len(start)

    def evaluate(packed: Array) -> Array:
        return balance.residual_at(packed[:disks], packed[disks:])

    def direction(packed: Array, value: Array, error: Array, forcing: Array) -> Array:
        return jnp.concatenate(balance.sweep(packed[disks:], value))

    def norm(value: Array) -> Array:
        return jnp.linalg.norm(value) / scale

    iterate = newton(
        evaluate,
        lambda packed: packed,
        direction,
        norm,
        first_unknowns,
        tolerance=tolerance,
        max_steps=max_steps,
    )
    return iterate, fourier.unpack(iterate.x[disks:])

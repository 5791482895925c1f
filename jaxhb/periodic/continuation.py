"""Pseudo-arclength continuation: along a curve of solutions through its folds and corners.

A curve ``H(y) = 0`` with one unknown more than equations, the last of ``y`` a share p that shall reach 1, is followed
by steps along its tangent, each corrected by Newton's method in the plane across the tangent (Keller 1977; Allgower and
Georg, Introduction to Numerical Continuation Methods, SIAM 2003, chs. 2, 6 and 10). The orientation of the tangent is
that of the determinant of the Jacobian with the tangent below it: it is constant along the curve, so that steps never
run back, even from a corner, where a knot of the law is grazed and the tangent jumps.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

FIRST, LONGEST, SHORTEST = 0.02, 0.5, 1e-3
"""Steps, in the norm of y. A step shorter than SHORTEST that fails takes the tangent of the side it fell on."""

NEAR, CLOSED = 1e-4, 1e-9
"""Norm of H: on the way, and at the end."""

COSINE = 0.5
"""Of the angle by which the tangent may turn within a step."""

TURNS = 12
"""Tangents tried at a corner."""


class Followed(NamedTuple):
    """Where the curve was followed to.

    y ``(m+1,)``: a point with p = 1 if ``arrived``; steps accepted; jacobians evaluated; folds of p passed.
    """

    y: jax.Array
    arrived: jax.Array
    steps: jax.Array
    jacobians: jax.Array
    folds: jax.Array


class _State(NamedTuple):
    """y : accepted, rise : direction of p there; tangent : of the next step; trial : being corrected; side : tangent at
    the first trial; goal : p that the trial is being corrected to, nan across the tangent."""

    y: jax.Array
    rise: jax.Array
    tangent: jax.Array
    trial: jax.Array
    side: jax.Array
    goal: jax.Array
    orientation: jax.Array
    length: jax.Array
    tries: jax.Array
    turns: jax.Array
    steps: jax.Array
    jacobians: jax.Array
    folds: jax.Array
    arrived: jax.Array


def follow(linearize, evaluate, correct, start, *, most):
    """Follow the curve from p = 0 at ``start`` until p = 1; one program, valid under jit.

    Parameters
    ----------
    linearize : y -> (H, slopes), a tuple
    evaluate : y -> H
    correct : (H, slopes) -> a change ``(m+1,)`` that makes H zero to first order, and the oriented tangent ``(m+1,)``
    start : array ``(m+1,)``, from which Newton's method reaches the curve at p = 0
    most : int, Jacobians at most

    Returns
    -------
    Followed
    """

    def both(value, slopes):
        change, tangent = correct(value, slopes)
        return change, tangent / jnp.linalg.norm(tangent)

    def across(change, tangent, normal):
        """The change without its part along the curve, in the plane of ``normal``."""
        return change - tangent * (normal @ change) / (normal @ tangent)

    def polish(slopes, trial, error, change, state):
        """Corrections with the same slopes as long as each is less than half of the last."""

        def unfinished(carry):
            _, error, _, tries, good = carry
            return good & (error > NEAR) & (tries < 5)

        def again(carry):
            trial, error, change, tries, _ = carry
            moved = trial + change
            value = evaluate(moved)
            after = across(*both(value, slopes), state.tangent)
            good = jnp.linalg.norm(after) < 0.5 * jnp.linalg.norm(change)
            kept = [
                jnp.where(good, new, old)
                for new, old in zip((moved, jnp.linalg.norm(value), after), (trial, error, change), strict=True)
            ]
            return *kept, tries + 1, good

        good = jnp.isnan(state.goal) & (jnp.linalg.norm(change) < 2 * state.length)
        return lax.while_loop(unfinished, again, (trial, error, change, jnp.array(0), good))[:3]

    def unfinished(state):
        lost = (state.turns > TURNS) | (state.length < 1e-8)
        return ~state.arrived & ~lost & (state.jacobians < most)

    def step(state):
        value, *slopes = linearize(state.trial)
        closing = ~jnp.isnan(state.goal)
        change, tangent = both(value, slopes)
        to_goal = change - tangent * (change[-1] + state.trial[-1] - state.goal) / tangent[-1]
        sideways = across(change, tangent, state.tangent)
        error = jnp.linalg.norm(value)
        trial, error, sideways = polish(slopes, state.trial, error, sideways, state)
        return _judge(state, trial, error, tangent, jnp.where(closing, to_goal, sideways), closing)

    zero, no = jnp.array(0), jnp.array(False)
    begin = _State(
        y=start,
        rise=jnp.array(1.0),
        tangent=jnp.zeros_like(start),
        trial=start,
        side=jnp.zeros_like(start),
        goal=jnp.array(0.0),
        orientation=jnp.array(1.0),
        length=jnp.array(FIRST),
        tries=zero,
        turns=zero,
        steps=zero,
        jacobians=zero,
        folds=zero,
        arrived=no,
    )
    last = lax.while_loop(unfinished, step, begin)
    return Followed(last.y, last.arrived, last.steps, last.jacobians, last.folds)


def _judge(state, trial, error, tangent, change, closing):
    """The state after one linearisation: the trial accepted, corrected, or given up for a shorter step."""
    began = state.steps > 0
    reached = closing & (error < CLOSED) & (jnp.abs(trial[-1] - state.goal) < CLOSED)
    orientation = jnp.where(reached & ~began, jnp.sign(tangent[-1]), state.orientation)
    tangent = orientation * tangent
    side = jnp.where(state.tries == 0, tangent, state.side)
    straight = tangent @ state.tangent
    close = ~closing & (error < NEAR)
    fits = close & ((straight > COSINE) | (state.length < SHORTEST))
    crossing = fits & ((trial[-1] - 1) * (state.y[-1] - 1) <= 0)
    accepted = (fits & ~crossing) | (reached & ~began)
    arrived = reached & began
    far = ~(jnp.linalg.norm(change) < jnp.where(closing & ~began, jnp.inf, jnp.where(closing, 4, 2) * state.length))
    failed = ~close & ~reached & (far | ~jnp.isfinite(error) | (state.tries >= jnp.where(closing, 8, 2)))
    bent = close & ~fits
    grown = jnp.where((state.tries == 0) & (straight > 0.9), jnp.minimum(1.6 * state.length, LONGEST), state.length)
    grown = jnp.where(state.tries >= 2, 0.7 * state.length, grown)
    length = jnp.where(fits & ~crossing, grown, jnp.where(failed | bent, 0.4 * state.length, state.length))
    corner = failed & ~closing & (length < SHORTEST) & jnp.isfinite(error)
    length = jnp.where(corner, jnp.maximum(length, SHORTEST / 20), length)
    y = jnp.where(accepted | arrived, trial, state.y)
    ahead = jnp.where(accepted, tangent, jnp.where(corner, side, state.tangent))
    part = (1 - state.y[-1]) / (trial[-1] - state.y[-1])
    on = ~(accepted | crossing | failed | bent | reached)
    following = jnp.where(on, trial + change, y + length * ahead)
    following = jnp.where(crossing, state.y + part * (trial - state.y), following)
    return _State(
        y=y,
        rise=jnp.where(accepted, jnp.sign(tangent[-1]), state.rise),
        tangent=ahead,
        trial=following,
        side=side,
        goal=jnp.where(crossing, 1.0, jnp.where(on, state.goal, jnp.nan)),
        orientation=orientation,
        length=length,
        tries=jnp.where(on, state.tries + 1, 0),
        turns=jnp.where(accepted, 0, state.turns + corner),
        steps=state.steps + accepted,
        jacobians=state.jacobians + 1,
        folds=state.folds + (accepted & (tangent[-1] * state.rise < 0)),
        arrived=arrived,
    )

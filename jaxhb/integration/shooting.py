"""Shooting: Newton's method on the states where segments of a cycle begin, for stable
and unstable motions.

Over a whole cycle an unstable motion multiplies an error by the largest Floquet
multiplier, a million where lightly damped teeth hammer; over a segment by its root.
Newton's method on the states of all segments (multiple shooting) sees the motion as a
whole, and the segments run side by side.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxhb._jax import Array, Number
from jaxhb.equations import iterations
from jaxhb.equations.state_space import StateSpace
from jaxhb.integration.step import (
    CycleTrace,
    Stepper,
    cycle_error,
    no_samples,
    periodicity_error,
    put,
    run,
    trace_of,
    watch,
)

# Segments of a cycle; divides every number of time steps. More of them cost no less.
SEGMENTS = 32
# Share of the largest singular value of a condensed cycle below which every motion
# returns
SINGULAR = 1e-11
# Shares of a Newton step on segments that are tried, all of them: one costs a run
# through the segments and no linear solve, little beside the Jacobian, so that none
# need be predicted.
LENGTHS = (1.0, 0.5, 0.2, 0.05, 0.01)
# The same of a step on one piece: beside grazing impacts only short steps improve the
# periodicity error.
SEARCH_LENGTHS = (1.0, 0.6, 0.36, 0.2, 0.1, 0.03)


def _end(stepper: Stepper, state: Array, segment: int | Array, segments: int) -> Array:
    """State at the end of one of ``segments`` from that at its beginning."""
    count = stepper.steps // segments
    return run(stepper, state, segment * count, count)[0]


def moving(space: StateSpace) -> Array:
    """Mask ``(n,)``: 1, or 0 for states that return from any value: those that move
    nothing (free rotation, modes left out), and those that move only these (the
    undamped rate of a free rotation).
    """
    zero = jnp.abs(space.transition) <= 1e-10 * jnp.max(jnp.abs(space.transition))
    moves_nothing = jnp.all(zero, axis=0)
    return 1.0 - jnp.all(zero | moves_nothing[:, None], axis=0)


def beginnings(stepper: Stepper, state: Array, segments: int = SEGMENTS) -> Array:
    """States ``(segments, n)`` of a cycle from ``state`` at the beginnings of its
    segments.
    """

    def through(state: Array, segment: Array) -> tuple[Array, Array]:
        return _end(stepper, state, segment, segments), state

    return lax.scan(through, state, jnp.arange(segments))[1]


def gaps_and_error(stepper: Stepper, nodes: Array) -> tuple[Array, Array]:
    """Gaps ``(K, n)``, and the periodicity error of :func:`motion`."""
    gap, largest = gaps(stepper, nodes, *watch(stepper))
    return gap, periodicity_error(stepper, _widest(stepper, gap), largest.max(axis=0))


def motion(stepper: Stepper, nodes: Array) -> CycleTrace:
    """The :class:`~jaxhb.integration.step.CycleTrace` of a cycle in segments; its
    periodicity error is that of the widest gap.
    """
    segments = len(nodes)
    step = jnp.arange(stepper.capacity)
    count = stepper.steps // segments
    gap, samples = gaps(
        stepper, nodes, put, no_samples(stepper, stepper.capacity // segments)
    )
    samples = samples[jnp.minimum(step // count, segments - 1), step % count]
    return trace_of(
        stepper,
        jnp.where((step < stepper.steps)[:, None], samples, 0.0),
        _widest(stepper, gap),
    )


def gaps(stepper: Stepper, nodes: Array, *observer: Any) -> tuple[Array, Any]:
    """End of each segment less the beginning of the next, ``(K, n)``, of nodes ``(K,
    n)``, and what was seen on the way; observer : ``keep`` and ``seen`` of
    :func:`~jaxhb.integration.step.run`.
    """
    count = stepper.steps // len(nodes)

    def through(node: Array, segment: Array) -> tuple[Array, Any]:
        end, _, observed = run(stepper, node, segment * count, count, *observer)
        return end, observed

    end, observed = jax.vmap(through)(nodes, jnp.arange(len(nodes)))
    return _gaps(stepper, nodes, end), observed


def _gaps(stepper: Stepper, nodes: Array, end: Array) -> Array:
    assert stepper.space is not None  # a stepper of one speed
    return (end - jnp.roll(nodes, -1, axis=0)) * moving(stepper.space)


def _widest(stepper: Stepper, gap: Array) -> Array:
    """Largest of the gaps ``(K, n)`` in deflections and rates, ``(2G,)``."""
    return jnp.max(jnp.abs(gap @ stepper.observation.T), axis=0)


def linearize(stepper: Stepper, nodes: Array) -> tuple[Array, Array]:
    """Gaps ``(K, n)``, and the derivatives ``(K, n, n)`` of each end in its
    beginning.
    """
    assert stepper.space is not None  # a stepper of one speed
    is_moving = moving(stepper.space)
    end, slope = ends(stepper, nodes)
    return _gaps(stepper, nodes, end), slope * is_moving[:, None] * is_moving


def ends(stepper: Stepper, nodes: Array) -> tuple[Array, Array]:
    """End ``(K, n)`` of each segment and its derivatives, as in :func:`linearize`, of
    all states.
    """

    def end(node: Array, segment: Array) -> tuple[Array, Array]:
        reached = _end(stepper, node, segment, len(nodes))
        return reached, reached

    slopes, reached = jax.vmap(jax.jacfwd(end, has_aux=True))(
        nodes, jnp.arange(len(nodes))
    )
    return reached, slopes


class CondensedCycle(NamedTuple):
    """A cycle condensed on its first node: the slope ``(K, n, n)`` of its segments, and
    the singular value decomposition of the condensed equations ``(n, n)``.
    """

    slope: Array
    left: Array
    values: Array
    right: Array


def condense(slope: Array) -> CondensedCycle:
    """Condense a cycle on its first node, as :func:`closing` needs it."""
    left, values, right = jnp.linalg.svd(_over_cycle(slope) - jnp.eye(slope.shape[1]))
    return CondensedCycle(slope, left, values, right)


def _over_cycle(slope: Array) -> Array:
    """Derivative ``(n, n)`` of the state after a cycle in that before it, from those
    ``(K, n, n)`` of its segments.
    """

    def through(whole: jax.Array, segment: Any) -> tuple[jax.Array, None]:
        return segment @ whole, None

    return lax.scan(through, jnp.eye(slope.shape[1]), slope)[0]


def closing(condensed: CondensedCycle, gap: Array) -> Array:
    """Change ``(K, n)`` of the nodes, shortest at the first, that closes all gaps
    ``(K, n)`` to first order.
    """
    slope, left, values, right = condensed
    # The gaps of all segments, taken on to the end of the cycle: what the first node
    # has to make up.
    cycle_gap, _ = lax.scan(
        lambda carry, segment: (segment[0] @ carry + segment[1], None),
        0.0 * gap[0],
        (slope, gap),
    )
    # The pseudo-inverse leaves alone what nothing holds (free rotation) and gives of
    # all solutions the shortest.
    is_regular = values > SINGULAR * values[0]
    first_node = right.T @ (
        jnp.where(is_regular, left.T @ -cycle_gap, 0.0)
        / jnp.where(is_regular, values, 1.0)
    )
    return lax.scan(
        lambda node, segment: (segment[0] @ node + segment[1], node),
        first_node,
        (slope, gap),
    )[1]


class _Closing(NamedTuple):
    """Nodes ``(K, n)``, the periodicity error of their motion, Newton steps, and
    whether the last of them led closer.
    """

    nodes: Array
    periodicity_error: Array
    steps: Array
    closer: Array


def close(
    stepper: Stepper, nodes: Array, *, tolerance: float | Array, most: int
) -> tuple[Array, CycleTrace, Array]:
    """Newton's method on the nodes ``(K, n)`` of one train until the periodicity error
    of their :func:`motion` is at most ``tolerance``: the nodes, their motion, and
    Newton steps taken, ``most`` at most; valid under jit and vmap.

    Each step is the longest of the lengths that lowers the natural level
    (:mod:`jaxhb.equations.iterations`), and they end where none does.
    """
    lengths = jnp.array(LENGTHS)

    def unfinished(carry: _Closing) -> Array:
        return (
            ~(carry.periodicity_error <= tolerance)
            & (carry.steps < most)
            & carry.closer
        )

    def step(carry: _Closing) -> _Closing:
        nodes, periodicity_error, done, _ = carry
        gap, slope = linearize(stepper, nodes)
        condensed = condense(slope)

        def change(gap: Array) -> Array:
            return closing(condensed, gap)

        def try_length(length: Array) -> tuple[Number, Array]:
            gap, periodicity_error = gaps_and_error(
                stepper, nodes + length * full_change
            )
            return (
                iterations.lowers_level(jnp.linalg.norm(change(gap)), size, length),
                periodicity_error,
            )

        # Every length is tried, and the longest that passes the test is taken: a run
        # through the segments is little beside their Jacobian.
        full_change = change(gap)
        size = jnp.linalg.norm(full_change)
        lowers_level, periodicity_errors = lax.map(try_length, lengths)
        best = jnp.argmax(lowers_level)
        any_closer = jnp.any(lowers_level)
        nodes = jnp.where(any_closer, nodes + lengths[best] * full_change, nodes)
        return _Closing(
            nodes=nodes,
            periodicity_error=jnp.where(
                any_closer, periodicity_errors[best], periodicity_error
            ),
            steps=done + 1,
            closer=any_closer,
        )

    start = _Closing(
        nodes=nodes,
        periodicity_error=jnp.array(jnp.inf),
        steps=jnp.array(0),
        closer=jnp.array(True),
    )
    closed = lax.while_loop(unfinished, step, start)
    return closed.nodes, motion(stepper, closed.nodes), closed.steps


def monodromy(stepper: Stepper, state: Array) -> tuple[Array, Array]:
    """Derivative ``(n, n)`` of the state after one cycle with respect to the state
    before, and the state after it ``(n,)``.

    Its eigenvalues are the Floquet multipliers of a periodic motion. Computed from as
    many of the segments, side by side, as divide the steps: 2.4 times faster than along
    the cycle with 6 states, twice with 24, no faster with 120.
    """
    nodes = beginnings(stepper, state, math.gcd(stepper.capacity, SEGMENTS))
    end, slope = ends(stepper, nodes)
    return _over_cycle(slope), end[-1]


def shoot(
    stepper: Stepper,
    state: Array,
    *,
    most: int = 20,
    tolerance: float = 1e-11,
    cutoff: float = 1e-10,
) -> tuple[Array, Array, Array]:
    """Correct a state until the cycle closes, ``z(T; z) = z``; valid under jit and
    vmap.

    Each Newton step has the length that closes best of several, whether or not the
    cycle closed better before: a search, for states ``(n,)`` far from any periodic
    motion. Motion that returns from any state (free rotation of a floating train) makes
    ``I - Phi`` singular and is left alone by a pseudo-inverse: singular values below
    the share ``cutoff`` of the largest count as zero. Returns the state, the
    periodicity error of its cycle, and the Newton steps taken, one at least.
    """
    identity = jnp.eye(state.shape[0])
    lengths = jnp.array(SEARCH_LENGTHS)

    def unfinished(carry: tuple[Array, jax.Array, jax.Array]) -> Array:
        _, periodicity_error, done = carry
        return (done < most) & ~(periodicity_error <= tolerance)

    def correct(
        carry: tuple[Array, jax.Array, jax.Array],
    ) -> tuple[Array, jax.Array, jax.Array]:
        state, _, done = carry
        transition, end = monodromy(stepper, state)
        # (I - Phi) dz = z(T) - z. Far from a motion the full step may land anywhere:
        # several lengths are run side by side, and the one that closes best is taken
        # even where none closes better.
        direction = jnp.linalg.pinv(identity - transition, rtol=cutoff) @ (end - state)
        trial_states = state + lengths[:, None] * direction
        periodicity_errors = jax.vmap(lambda state: cycle_error(stepper, state)[1])(
            trial_states
        )
        best = jnp.nanargmin(periodicity_errors)
        return trial_states[best], periodicity_errors[best], done + 1

    return lax.while_loop(
        unfinished, correct, (state, jnp.array(jnp.inf), jnp.array(0))
    )

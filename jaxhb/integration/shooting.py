"""Shooting: Newton's method on the states where segments of a cycle begin, for stable
and unstable motions.

Over a whole cycle an unstable motion multiplies an error by the largest Floquet
multiplier, a million where lightly damped teeth hammer; over a segment by its root.
Newton's method on the states of all segments (multiple shooting) sees the motion as a
whole, and the segments run side by side.
"""

import math

import jax
import jax.numpy as jnp
from jax import lax

from jaxhb.equations import iterations
from jaxhb.integration.step import (
    cycle_error,
    no_samples,
    periodicity_error,
    put,
    run,
    trace_of,
    watch,
)

SEGMENTS = (
    32  # of a cycle; divides every number of time steps. More of them cost no less.
)
# Share of the largest singular value of a condensed cycle below which a motion returns
# whatever it is
SINGULAR = 1e-11
# Shares of a Newton step on segments that are tried, all of them: one costs a run
# through the segments and no linear solve, little beside the Jacobian, so that none
# need be predicted.
LENGTHS = (1.0, 0.5, 0.2, 0.05, 0.01)
# The same of a step on one piece: beside grazing impacts only short steps improve the
# periodicity error.
SEARCH_LENGTHS = (1.0, 0.6, 0.36, 0.2, 0.1, 0.03)


def _end(stepper, state, segment, segments):
    """State at the end of one of ``segments`` from that at its beginning."""
    count = stepper.steps // segments
    return run(stepper, state, segment * count, count)[0]


def moving(space):
    """``(n,)`` 1, or 0 for states that return whatever they are: those that move
    nothing (free rotation, modes left out), and those that move only these (the
    undamped rate of a free rotation).
    """
    nothing = jnp.abs(space.transition) <= 1e-10 * jnp.max(jnp.abs(space.transition))
    free = jnp.all(nothing, axis=0)
    return 1.0 - jnp.all(nothing | free[:, None], axis=0)


def beginnings(stepper, state, segments=SEGMENTS):
    """States ``(segments, n)`` that a cycle from ``state`` goes through at the
    beginnings of its segments.
    """

    def through(state, segment):
        return _end(stepper, state, segment, segments), state

    return lax.scan(through, state, jnp.arange(segments))[1]


def gaps_and_error(stepper, nodes):
    """Gaps ``(K, n)``, and the periodicity error of :func:`motion`."""
    gap, largest = gaps(stepper, nodes, *watch(stepper))
    return gap, periodicity_error(stepper, _widest(stepper, gap), largest.max(axis=0))


def motion(stepper, nodes):
    """The :class:`~jaxhb.integration.step.Trace` of a cycle in segments; its
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


def gaps(stepper, nodes, *kept):
    """End of each segment less the beginning of the next, ``(K, n)``, of nodes ``(K,
    n)``; what was seen on the way.
    """
    count = stepper.steps // len(nodes)

    def through(node, segment):
        end, _, seen = run(stepper, node, segment * count, count, *kept)
        return end, seen

    end, seen = jax.vmap(through)(nodes, jnp.arange(len(nodes)))
    return _gaps(stepper, nodes, end), seen


def _gaps(stepper, nodes, end):
    return (end - jnp.roll(nodes, -1, axis=0)) * moving(stepper.space)


def _widest(stepper, gap):
    """Largest of the gaps ``(K, n)`` in deflections and rates, ``(2G,)``."""
    return jnp.max(jnp.abs(gap @ stepper.observation.T), axis=0)


def linearize(stepper, nodes):
    """Gaps ``(K, n)``, and the derivatives ``(K, n, n)`` of each end in its
    beginning.
    """
    free = moving(stepper.space)
    end, slope = ends(stepper, nodes)
    return _gaps(stepper, nodes, end), slope * free[:, None] * free


def ends(stepper, nodes):
    """End ``(K, n)`` of each segment and its derivatives, as in :func:`linearize`, of
    all states.
    """

    def end(node, segment):
        reached = _end(stepper, node, segment, len(nodes))
        return reached, reached

    slopes, reached = jax.vmap(jax.jacfwd(end, has_aux=True))(
        nodes, jnp.arange(len(nodes))
    )
    return reached, slopes


def condense(slope):
    """A cycle condensed on its first node: what :func:`closing` needs of its
    derivatives.

    slope ``(K, n, n)``, and the singular value decomposition of the condensed equations
    ``(n, n)``.
    """
    return slope, *jnp.linalg.svd(_over_cycle(slope) - jnp.eye(slope.shape[1]))


def _over_cycle(slope):
    """``(n, n)``: the change of the state after a cycle by that before it, from those
    ``(K, n, n)`` of its segments.
    """
    return lax.scan(
        lambda whole, slope: (slope @ whole, None), jnp.eye(slope.shape[1]), slope
    )[0]


def closing(condensed, gap):
    """``(K, n)``: the change of nodes, shortest at the first, that closes all gaps to
    first order.
    """
    slope, left, values, right = condensed
    # The gaps of all segments, taken on to the end of the cycle: what the first node
    # has to make up.
    gathered, _ = lax.scan(
        lambda carry, known: (known[0] @ carry + known[1], None),
        0.0 * gap[0],
        (slope, gap),
    )
    # The pseudo-inverse leaves alone what nothing holds (free rotation) and gives of
    # all solutions the shortest.
    known = values > SINGULAR * values[0]
    first = right.T @ (
        jnp.where(known, left.T @ -gathered, 0.0) / jnp.where(known, values, 1.0)
    )
    return lax.scan(
        lambda node, known: (known[0] @ node + known[1], node), first, (slope, gap)
    )[1]


def close(stepper, nodes, *, tolerance, most):
    """Newton's method on the nodes ``(K, n)`` of one train until the periodicity error
    of their :func:`motion` is at most ``tolerance``: the nodes, their motion, and
    Newton steps taken, ``most`` at most; valid under jit and vmap.

    Each step is the longest of the lengths that lowers the natural level
    (:mod:`jaxhb.equations.iterations`), and they end where none does.
    """
    lengths = jnp.array(LENGTHS)

    def unfinished(carry):
        _, periodicity_error, done, closer = carry
        return ~(periodicity_error <= tolerance) & (done < most) & closer

    def step(carry):
        nodes, periodicity_error, done, _ = carry
        gap, slope = linearize(stepper, nodes)
        condensed = condense(slope)

        def change(gap):
            return closing(condensed, gap)

        def tried(length):
            gap, periodicity_error = gaps_and_error(stepper, nodes + length * whole)
            return (
                iterations.lowers_level(jnp.linalg.norm(change(gap)), size, length),
                periodicity_error,
            )

        # Every length is tried, and the longest that passes the test is taken: a run
        # through the segments is little beside their Jacobian.
        whole = change(gap)
        size = jnp.linalg.norm(whole)
        lower, periodicity_errors = lax.map(tried, lengths)
        best = jnp.argmax(lower)
        closer = jnp.any(lower)
        nodes = jnp.where(closer, nodes + lengths[best] * whole, nodes)
        return (
            nodes,
            jnp.where(closer, periodicity_errors[best], periodicity_error),
            done + 1,
            closer,
        )

    start = (nodes, jnp.array(jnp.inf), jnp.array(0), jnp.array(True))
    nodes, _, done, _ = lax.while_loop(unfinished, step, start)
    return nodes, motion(stepper, nodes), done


def monodromy(stepper, state):
    """Derivative ``(n, n)`` of the state after one cycle with respect to the state
    before, and that state ``(n,)``.

    The eigenvalues are the Floquet multipliers of a periodic motion. Found from as many
    of the segments, side by side, as divide the steps: 2.4 times faster than along the
    cycle with 6 states, twice with 24, no faster with 120.
    """
    nodes = beginnings(stepper, state, math.gcd(stepper.capacity, SEGMENTS))
    end, slope = ends(stepper, nodes)
    return _over_cycle(slope), end[-1]


def shoot(stepper, state, *, most=20, tolerance=1e-11, cutoff=1e-10):
    """Correct a state until the cycle closes, ``z(T; z) = z``; valid under jit and
    vmap.

    Each Newton step has the length that closes best of several, whether or not the
    cycle closed better before: a search, for states ``(n,)`` far from any periodic
    motion. Motion that returns whatever it is (free rotation of a floating train) makes
    ``I - Phi`` singular and is left alone by a pseudo-inverse: singular values below
    the share ``cutoff`` of the largest count as zero. Gives the state, the periodicity
    error of its cycle, and the Newton steps taken, one at least.
    """
    identity = jnp.eye(state.shape[0])
    lengths = jnp.array(SEARCH_LENGTHS)

    def unfinished(carry):
        _, periodicity_error, done = carry
        return (done < most) & ~(periodicity_error <= tolerance)

    def correct(carry):
        state, _, done = carry
        matrix, end = monodromy(stepper, state)
        # (I - Phi) dz = z(T) - z. Far from a motion the full step may land anywhere:
        # several lengths are run side by side, and the one that closes best is taken
        # even where none closes better.
        direction = jnp.linalg.pinv(identity - matrix, rtol=cutoff) @ (end - state)
        tried = state + lengths[:, None] * direction
        periodicity_errors = jax.vmap(lambda state: cycle_error(stepper, state)[1])(
            tried
        )
        best = jnp.nanargmin(periodicity_errors)
        return tried[best], periodicity_errors[best], done + 1

    return lax.while_loop(
        unfinished, correct, (state, jnp.array(jnp.inf), jnp.array(0))
    )

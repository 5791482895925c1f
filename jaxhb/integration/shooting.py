"""Shooting: Newton's method on the states where segments of a cycle begin, for stable and unstable motions.

Over a whole cycle an unstable motion multiplies an error by the largest Floquet multiplier, a million where lightly
damped teeth hammer; over a segment by its root. Newton's method on the states of all segments (multiple shooting) sees
the motion as a whole, and the segments run side by side.

A motion here belongs to a share p of a change of the train: ``stepper`` is a function of p.
"""

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import lax

from jaxhb.equations import iterations
from jaxhb.integration.cycles import cycle_error, no_samples, periodicity_error, put, run, trace_of, watch


@dataclass(frozen=True)
class ShootingOptions:
    """How cycles are closed by Newton's method, in one piece and in segments.

    Parameters
    ----------
    segments : of a cycle; divides every number of time steps. More of them cost no less
    singular : share of the largest singular value of a condensed cycle below which a motion returns whatever it is
    lengths : shares of a Newton step on segments that are tried, all of them: one costs a run through the segments and
        no linear solve, little beside the Jacobian, so that none need be predicted
    search_lengths : the same of a step on one piece: beside grazing impacts only short steps improve the periodicity
        error
    """

    segments: int = 32
    singular: float = 1e-11
    lengths: tuple[float, ...] = (1.0, 0.5, 0.2, 0.05, 0.01)
    search_lengths: tuple[float, ...] = (1.0, 0.6, 0.36, 0.2, 0.1, 0.03)


SHOOTING = ShootingOptions()


def _end(stepper, state, segment, segments):
    """State at the end of one of ``segments`` from that at its beginning."""
    count = stepper.steps // segments
    return run(stepper, state, segment * count, count)[0]


def moving(space):
    """``(n,)`` 1, or 0 for states that return whatever they are: those that move nothing (free rotation, modes left
    out), and those that move only these (the undamped rate of a free rotation)."""
    nothing = jnp.abs(space.transition) <= 1e-10 * jnp.max(jnp.abs(space.transition))
    free = jnp.all(nothing, axis=0)
    return 1.0 - jnp.all(nothing | free[:, None], axis=0)


def beginnings(stepper, state, segments=SHOOTING.segments):
    """States ``(segments, n)`` that a cycle from ``state`` goes through at the beginnings of its segments."""

    def through(state, segment):
        return _end(stepper, state, segment, segments), state

    return lax.scan(through, state, jnp.arange(segments))[1]


def gaps(stepper, nodes):
    """End of each segment less the beginning of the next, ``(K, n)``, of nodes ``(K, n)``."""
    return _driven(stepper, nodes)[0]


def gaps_and_error(stepper, nodes):
    """Gaps ``(K, n)``, and the periodicity error of :func:`motion`."""
    gap, largest = _driven(stepper, nodes, *watch(stepper))
    return gap, periodicity_error(stepper, _widest(stepper, gap), largest.max(axis=0))


def motion(stepper, nodes):
    """The :class:`~jaxhb.integration.cycles.Trace` of a cycle in segments; its periodicity error is that of the
    widest gap."""
    segments, step = len(nodes), jnp.arange(stepper.capacity)
    count = stepper.steps // segments
    gap, samples = _driven(stepper, nodes, put, no_samples(stepper, stepper.capacity // segments))
    samples = samples[jnp.minimum(step // count, segments - 1), step % count]
    return trace_of(stepper, jnp.where((step < stepper.steps)[:, None], samples, 0.0), _widest(stepper, gap))


def _driven(stepper, nodes, *kept):
    """Gaps ``(K, n)``, and what was seen on the way, segment by segment."""
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
    return jnp.max(jnp.abs(gap @ stepper.space.observation.T), axis=0)


def linearize(stepper, nodes, share):
    """Gaps ``(K, n)``, their derivatives: of each end in its beginning ``(K, n, n)``, and in the share ``(K, n)``."""
    free = moving(stepper(share).space)
    end, slope, share_slope = ends(stepper, nodes, share)
    return _gaps(stepper(share), nodes, end), slope * free[:, None] * free, share_slope * free


def ends(stepper, nodes, share):
    """End ``(K, n)`` of each segment and its derivatives, as in :func:`linearize`, of all states."""

    def end(node_and_share, segment):
        reached = _end(stepper(node_and_share[-1]), node_and_share[:-1], segment, len(nodes))
        return reached, reached

    both = jnp.concatenate([nodes, jnp.full((len(nodes), 1), share)], axis=1)
    slopes, reached = jax.vmap(jax.jacfwd(end, has_aux=True))(both, jnp.arange(len(nodes)))
    return reached, slopes[:, :, :-1], slopes[:, :, -1]


def condense(slope, share_slope):
    """A cycle condensed on its first node: what :func:`closing` and :func:`tangent` need of its derivatives.

    slope ``(K, n, n)``, share_slope ``(K, n)``, and the singular value decomposition of the condensed equations
    ``(n, n+1)``.
    """
    size = slope.shape[1]

    def through(carry, segment):
        slope, share_slope = segment
        return (slope @ carry).at[:, size].add(share_slope), None

    # The change of the state after a cycle by that of the first node, and by the share in the last column: Phi - I and
    # what the share adds, n equations for n + 1 unknowns, of which the null vector is the tangent of the curve.
    whole, _ = lax.scan(through, jnp.eye(size, size + 1), (slope, share_slope))
    return slope, share_slope, *jnp.linalg.svd(whole - jnp.eye(size, size + 1), full_matrices=True)


def closing(condensed, gap):
    """``(K n + 1,)``: the change of nodes and share, shortest at the first, that closes all gaps to first order."""
    slope, share_slope, left, values, right = condensed
    # The gaps of all segments, taken on to the end of the cycle: what the first node and the share have to make up.
    gathered, _ = lax.scan(lambda carry, known: (known[0] @ carry + known[1], None), 0.0 * gap[0], (slope, gap))
    # The pseudo-inverse leaves alone what nothing holds (free rotation) and gives of all solutions the shortest.
    known = values > SHOOTING.singular * values[0]
    first = right[:-1].T @ (jnp.where(known, left.T @ -gathered, 0.0) / jnp.where(known, values, 1.0))
    return _expanded(slope, gap + share_slope * first[-1], first)


def tangent(condensed):
    """``(K n + 1,)``: the change of nodes and share that keeps all gaps, not normalised; oriented by the sign of the
    determinant, which no fold and no corner of the curve changes."""
    slope, share_slope, left, _, right = condensed
    # The last right singular vector is the null vector. Its sign is arbitrary; with that of the two determinants it is
    # oriented as the whole curve is.
    first = right[-1] * jnp.sign(jnp.linalg.det(left) * jnp.linalg.det(right))
    return _expanded(slope, share_slope * first[-1], first)


def _expanded(slope, added, first):
    """Changes of all nodes, and of the share, from those of the first node and the share."""
    _, nodes = lax.scan(lambda node, known: (known[0] @ node + known[1], node), first[:-1], (slope, added))
    return jnp.append(nodes, first[-1])


def close(stepper, nodes, *, tolerance, most):
    """Newton's method on the nodes ``(K, n)`` of one train, until the gaps are small; valid under jit and vmap.

    Parameters
    ----------
    stepper : Stepper
    nodes : array ``(K, n)``, of a near motion
    tolerance : float, on the periodicity error of :func:`motion`
    most : int, Newton steps; each is the longest of the lengths that lowers the natural level
        (:mod:`jaxhb.equations.iterations`), and they end where none does

    Returns
    -------
    nodes ``(K, n)``, the Trace of their motion, Newton steps taken
    """
    lengths = jnp.array(SHOOTING.lengths)

    def unfinished(carry):
        _, periodicity_error, done, closer = carry
        return ~(periodicity_error <= tolerance) & (done < most) & closer

    def step(carry):
        nodes, periodicity_error, done, _ = carry
        gap, slope, none = linearize(lambda _: stepper, nodes, 1.0)
        condensed = condense(slope, none)

        def change(gap):
            return closing(condensed, gap)[:-1].reshape(nodes.shape)

        def tried(length):
            gap, periodicity_error = gaps_and_error(stepper, nodes + length * whole)
            return iterations.lowers_level(jnp.linalg.norm(change(gap)), size, length), periodicity_error

        # Every length is tried, and the longest that passes the test is taken: a run through the segments is little
        # beside their Jacobian.
        whole = change(gap)
        size = jnp.linalg.norm(whole)
        lower, periodicity_errors = lax.map(tried, lengths)
        best, closer = jnp.argmax(lower), jnp.any(lower)
        nodes = jnp.where(closer, nodes + lengths[best] * whole, nodes)
        return nodes, jnp.where(closer, periodicity_errors[best], periodicity_error), done + 1, closer

    start = (nodes, jnp.array(jnp.inf), jnp.array(0), jnp.array(True))
    nodes, _, done, _ = lax.while_loop(unfinished, step, start)
    return nodes, motion(stepper, nodes), done


def monodromy(stepper, state):
    """Derivative ``(n, n)`` of the state after one cycle with respect to the state before, and that state ``(n,)``.

    In the coordinates of the state; the eigenvalues are the Floquet multipliers of a periodic motion. Found from as
    many of the segments, side by side, as divide the steps: 2.4 times faster than along the cycle with 6 states, twice
    with 24, no faster with 120.
    """
    nodes = beginnings(stepper, state, math.gcd(stepper.capacity, SHOOTING.segments))
    end, slope, _ = ends(lambda _: stepper, nodes, 1.0)
    return lax.scan(lambda matrix, slope: (slope @ matrix, None), jnp.eye(len(state)), slope)[0], end[-1]


def shoot(stepper, state, *, most=20, tolerance=1e-11, cutoff=1e-10):
    """Correct a state until the cycle closes, ``z(T; z) = z``; valid under jit and vmap.

    Each Newton step has the length that closes best of several, whether or not the cycle closed better before: a
    search, for states far from any periodic motion. Motion that returns whatever it is (free rotation of a floating
    train) makes ``I - Phi`` singular and is left alone by a pseudo-inverse.

    Parameters
    ----------
    stepper : Stepper
    state : array ``(n,)``
        Deviation at t = 0 near the wanted motion.
    most : int
        At most so many Newton steps, and at least one.
    tolerance : float
        Periodicity error at which to stop.
    cutoff : float
        Singular values of ``I - Phi`` below this share of the largest are taken as zero.

    Returns
    -------
    state ``(n,)``, the periodicity error of its cycle, Newton steps taken
    """
    identity = jnp.eye(state.shape[0])
    lengths = jnp.array(SHOOTING.search_lengths)

    def unfinished(carry):
        _, periodicity_error, done = carry
        return (done < most) & ~(periodicity_error <= tolerance)

    def correct(carry):
        state, _, done = carry
        matrix, end = monodromy(stepper, state)
        # (I - Phi) dz = z(T) - z. Far from a motion the full step may land anywhere: several lengths are run side by
        # side, and the one that closes best is taken even where none closes better.
        direction = jnp.linalg.pinv(identity - matrix, rtol=cutoff) @ (end - state)
        tried = state + lengths[:, None] * direction
        periodicity_errors = jax.vmap(lambda state: cycle_error(stepper, state)[1])(tried)
        best = jnp.nanargmin(periodicity_errors)
        return tried[best], periodicity_errors[best], done + 1

    return lax.while_loop(unfinished, correct, (state, jnp.array(jnp.inf), jnp.array(0)))

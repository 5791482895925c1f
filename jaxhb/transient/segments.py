"""A cycle cut into segments: the states at their beginnings, what is missing between them, and what corrects them.

Over a whole cycle an unstable motion multiplies an error by the largest Floquet multiplier, a million where lightly
damped teeth hammer; over a segment by its root. Newton's method on the states of all segments (multiple shooting) sees
the motion as a whole, and the segments run side by side.

A motion here belongs to a share p of a change of the train: ``stepper`` is a function of p.
"""

import jax
import jax.numpy as jnp
from jax import lax

from .integrate import traced

SEGMENTS = 32
"""Divides every number of instants; more of them cost no less."""

SINGULAR = 1e-11
"""Share of the largest singular value of a condensed cycle below which a motion returns whatever it is."""

LENGTHS = (1.0, 0.5, 0.2, 0.05, 0.01)
"""Shares of a Newton step that are tried."""


def _grid(stepper, segments):
    """w of the linear train at half and full steps ahead and at the beginning, segment by segment."""
    steps = stepper.linear.shape[0] // 2
    middle = stepper.linear[1::2].reshape(segments, steps // segments, -1)
    ahead = jnp.roll(stepper.linear, -2, axis=0)[::2].reshape(segments, steps // segments, -1)
    return middle, ahead, stepper.linear[::2].reshape(segments, steps // segments, -1)[:, 0]


def _run(stepper, state, middle, ahead, first):
    """State at the end of one segment, and w ``(steps, 2G)`` on the way."""

    def step(carry, known):
        return stepper.advance(*carry, *known), carry[1]

    (end, _), seen = lax.scan(step, (state, first + stepper.space.observation @ state), (middle, ahead))
    return end, seen


def moving(space):
    """``(n,)`` 1, or 0 for states that return whatever they are: those that move nothing (free rotation, modes left
    out), and those that move only these (the undamped rate of a free rotation)."""
    nothing = jnp.abs(space.transition) <= 1e-10 * jnp.max(jnp.abs(space.transition))
    free = jnp.all(nothing, axis=0)
    return 1.0 - jnp.all(nothing | free[:, None], axis=0)


def beginnings(stepper, state):
    """States ``(SEGMENTS, n)`` that a cycle from ``state`` goes through at the beginnings of its segments."""

    def through(state, segment):
        return _run(stepper, state, *segment)[0], state

    return lax.scan(through, state, _grid(stepper, SEGMENTS))[1]


def gaps(stepper, nodes):
    """End of each segment less the beginning of the next, ``(K, n)``, of nodes ``(K, n)``."""
    return _driven(stepper, nodes)[0]


def motion(stepper, nodes):
    """The :class:`~jaxhb.transient.integrate.Trace` of a cycle in segments; its closure is that of the widest gap."""
    gap, seen = _driven(stepper, nodes)
    return traced(stepper, seen, jnp.max(jnp.abs(gap @ stepper.space.observation.T), axis=0))


def _driven(stepper, nodes):
    """Gaps ``(K, n)`` and w ``(steps, 2G)`` over the cycle."""
    end, seen = jax.vmap(lambda *segment: _run(stepper, *segment))(nodes, *_grid(stepper, len(nodes)))
    return (end - jnp.roll(nodes, -1, axis=0)) * moving(stepper.space), seen.reshape(-1, seen.shape[-1])


def linearize(stepper, nodes, share):
    """Gaps ``(K, n)``, their derivatives: of each end in its beginning ``(K, n, n)``, and in the share ``(K, n)``."""
    free = moving(stepper(share).space)

    def end(node_and_share, *known):
        reached, _ = _run(stepper(node_and_share[-1]), node_and_share[:-1], *known)
        return reached, reached

    both = jnp.concatenate([nodes, jnp.full((len(nodes), 1), share)], axis=1)
    slopes, reached = jax.vmap(jax.jacfwd(end, has_aux=True))(both, *_grid(stepper(share), len(nodes)))
    gap = (reached - jnp.roll(nodes, -1, axis=0)) * free
    return gap, slopes[:, :, :-1] * free[:, None] * free, slopes[:, :, -1] * free


def correct(gap, slope, share_slope):
    """Changes of nodes and share that close all gaps to first order, and those that keep them: the tangent.

    The cycle is condensed on its first node; the tangent is oriented by the sign of the determinant, which no fold and
    no corner of the curve changes.

    Returns
    -------
    array ``(K n + 1, 2)``: the shortest closing change (at the first node), and the tangent, not normalised
    """
    size = gap.shape[1]
    identity = jnp.eye(size)

    def through(carry, segment):
        slope, gap, share_slope = segment
        return (slope @ carry).at[:, size].add(gap).at[:, size + 1].add(share_slope), None

    begin = jnp.concatenate([identity, jnp.zeros((size, 2))], axis=1)
    whole, _ = lax.scan(through, begin, (slope, gap, share_slope))
    condensed = jnp.concatenate([whole[:, :size] - identity, whole[:, size + 1 :]], axis=1)
    left, values, right = jnp.linalg.svd(condensed, full_matrices=True)
    known = values > SINGULAR * values[0]
    closing = right[:size].T @ (jnp.where(known, left.T @ -whole[:, size], 0.0) / jnp.where(known, values, 1.0))
    tangent = right[size] * jnp.sign(jnp.linalg.det(left) * jnp.linalg.det(right))
    first = jnp.stack([closing, tangent], axis=1)

    def unfold(node, segment):
        slope, gap, share_slope = segment
        return (slope @ node + share_slope[:, None] * first[size]).at[:, 0].add(gap), node

    _, nodes = lax.scan(unfold, first[:size], (slope, gap, share_slope))
    return jnp.concatenate([nodes.reshape(-1, 2), first[size:]])


def close(stepper, nodes, *, tolerance, most):
    """Newton's method on the nodes ``(K, n)`` of one train, until the gaps are small; valid under jit and vmap.

    Parameters
    ----------
    stepper : Stepper
    nodes : array ``(K, n)``, of a near motion
    tolerance : float, on the closure of :func:`motion`
    most : int, Newton steps; each is the longest of LENGTHS that lowers the natural level (the norm of what the same
        Jacobian would still correct), and they end where none does

    Returns
    -------
    nodes ``(K, n)``, the Trace of their motion, Newton steps taken
    """
    lengths = jnp.array(LENGTHS)

    def unfinished(carry):
        _, trace, done, closer = carry
        return (trace.closure > tolerance) & (done < most) & closer

    def step(carry):
        nodes, _, done, _ = carry
        gap, slope, none = linearize(lambda _: stepper, nodes, 1.0)

        def closing(gap):
            return -correct(gap, slope, none)[:-1, 0].reshape(nodes.shape)

        def lowers(length):
            return jnp.linalg.norm(closing(gaps(stepper, nodes - length * change))) < (1 - length / 4) * size

        change = closing(gap)
        size = jnp.linalg.norm(change)
        lower = lax.map(lowers, lengths)
        closer = jnp.any(lower)
        nodes = jnp.where(closer, nodes - lengths[jnp.argmax(lower)] * change, nodes)
        return nodes, motion(stepper, nodes), done + 1, closer

    start = (nodes, motion(stepper, nodes), jnp.array(0), jnp.array(True))
    return lax.while_loop(unfinished, step, start)[:3]

"""Marching through cycles, and waiting until nothing changes from cycle to cycle."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import lax


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Trace:
    """One cycle of the meshes, sampled at ``t_j = 2 pi j / (Omega steps)``, above zeros where there is room for more.

    deflection ``(G, capacity)`` m; rate ``(G, capacity)`` m/s; periodicity_error : change of (l, l') from the
    beginning of that cycle to its end, the largest over the meshes relative to ``max|l| + g`` and ``max|l'| + Omega
    g``, g = (1 - epsilon) h. Motion that moves no mesh (rotation of a floating or softly grounded train) does not
    count.
    """

    deflection: jax.Array
    rate: jax.Array
    periodicity_error: jax.Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Settled:
    """Outcome of :func:`settle`: state ``(n,)``, last cycle, whether the tolerance was met, cycles run."""

    state: jax.Array
    trace: Trace
    settled: jax.Array
    cycles: jax.Array


def run(stepper, state, first, count, keep=lambda seen, k, w: seen, seen=(), even=False):
    """``count`` steps on from the deviation ``state`` at the beginning of step ``first``; valid under jit and vmap.

    Parameters
    ----------
    keep : function
        ``seen = keep(seen, k, w)`` before each step k = 0, 1, .. of them; w ``(2G,)`` is (l, l') of the states.
    even : bool
        The count is even: two steps are taken at once, which is faster where trains are small.

    Returns
    -------
    state ``(n,)`` and w ``(2G,)`` at the end, and what was seen
    """

    def step(k, carry):
        state, w, seen = carry
        return *stepper.advance(state, w, *stepper.known(first + k)), keep(seen, k, w)

    begin = lax.dynamic_index_in_dim(stepper.linear, 2 * first, keepdims=False) + stepper.space.observation @ state
    start = (state, begin, seen)
    # Two steps in a loop body: where a step takes a microsecond, the loop itself is a good part of it.
    if even:
        return lax.fori_loop(0, count // 2, lambda k, carry: step(2 * k + 1, step(2 * k, carry)), start)
    return lax.fori_loop(0, count, step, start)


def _whole(stepper, state, keep, seen):
    """State after one cycle, the change of w ``(2G,)``, and what was seen."""
    even = stepper.count is not None or stepper.steps % 2 == 0
    end, w, seen = run(stepper, state, 0, stepper.steps, keep, seen, even)
    return end, w - stepper.observe(state), seen


def cycle(stepper, state):
    """One cycle from the deviation ``state`` at t = 0.

    Returns
    -------
    state : array ``(n,)``
    trace : Trace
    """
    end, change, samples = _whole(stepper, state, put, no_samples(stepper, stepper.capacity))
    return end, trace_of(stepper, samples, change)


def cycle_error(stepper, state):
    """State after one cycle from ``state``, and the periodicity error of its :class:`Trace`; no samples are kept."""
    end, change, largest = _whole(stepper, state, *watch(stepper))
    return end, periodicity_error(stepper, change, largest)


def put(samples, k, w):
    """``keep`` of :func:`run` for samples ``(capacity, 2G)``."""
    return lax.dynamic_update_index_in_dim(samples, w, k, axis=0)


def no_samples(stepper, capacity):
    """Zeros ``(capacity, 2G)``, to :func:`put` samples over."""
    return jnp.zeros((capacity, stepper.linear.shape[1]))


def watch(stepper):
    """``keep`` and ``seen`` of :func:`run` for the largest deflections and rates ``(2G,)``."""

    def keep(largest, _, w):
        motion = jnp.concatenate([stepper.with_fast_modes(w), jnp.split(w, 2)[1]])
        return jnp.maximum(largest, jnp.abs(motion))

    return keep, jnp.zeros(stepper.linear.shape[1])


def periodicity_error(stepper, change, largest):
    """Periodicity error, see :class:`Trace`, of a change and the largest of deflections and rates, ``(2G,)`` each."""
    gap = (1 - stepper.law.epsilon) * stepper.law.backlash + 1e-300
    return jnp.max(jnp.abs(change) / (largest + jnp.concatenate([gap, stepper.frequency * gap])), initial=0.0)


def trace_of(stepper, samples, change):
    """The Trace of a cycle from w ``(capacity, 2G)``, (l, l') of the states, and its change ``(2G,)`` over the
    cycle."""
    deflection, rate = jax.vmap(stepper.with_fast_modes)(samples).T, jnp.split(samples.T, 2)[1]
    largest = jnp.abs(jnp.concatenate([deflection, rate])).max(axis=1)
    return Trace(deflection, rate, periodicity_error(stepper, change, largest))


def _no_trace(stepper):
    """The Trace before the first cycle, open: loops that begin with it hold one copy of a cycle, and compile faster."""
    empty = jnp.zeros((len(stepper.viscous), stepper.capacity))
    return Trace(empty, empty, jnp.array(jnp.inf))


def march(stepper, state, cycles):
    """Integrate a number of cycles; valid under jit and vmap.

    Parameters
    ----------
    stepper : Stepper
    state : array ``(n,)``
        Deviation at t = 0: :func:`on_flank`, :func:`at_rest`, :func:`state_from_harmonics`, or where a march ended.
    cycles : int, at least 1

    Returns
    -------
    state : array ``(n,)``
        At the end.
    trace : Trace
        The last cycle; ``trace.periodicity_error`` its change.
    """
    return lax.fori_loop(0, cycles, lambda _, carry: cycle(stepper, carry[0]), (state, _no_trace(stepper)))


def settle(stepper, state, *, tolerance=1e-6, max_cycles=200):
    """March until a cycle closes within ``tolerance``, or ``max_cycles`` have passed; valid under jit and vmap.

    Parameters
    ----------
    stepper : Stepper
    state : array ``(n,)``
    tolerance : float
        Allowed ``trace.periodicity_error``. A slow drift closes every cycle to the drift of one cycle.
    max_cycles : int

    Returns
    -------
    Settled
        ``settled`` is False where the motion is not periodic, has a longer period or decays too slowly.
    """

    def unfinished(carry):
        _, trace, done = carry
        return (done < max_cycles) & ~(trace.periodicity_error <= tolerance) & ~jnp.isnan(trace.periodicity_error)

    def another(carry):
        state, _, done = carry
        return *cycle(stepper, state), done + 1

    state, trace, done = lax.while_loop(unfinished, another, (state, _no_trace(stepper), jnp.array(0)))
    return Settled(state, trace, trace.periodicity_error <= tolerance, done)

"""Marching through cycles, and waiting until nothing changes from cycle to cycle."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import lax


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Trace:
    """One cycle of the meshes, sampled at ``t_j = 2 pi j / (Omega steps)``.

    deflection ``(G, steps)`` m; rate ``(G, steps)`` m/s; closure : change of (l, l') from the beginning of that cycle
    to its end, the largest over the meshes relative to ``max|l| + g`` and ``max|l'| + Omega g``, g = (1 - epsilon) h.
    Motion that moves no mesh (rotation of a floating or softly grounded train) does not count.
    """

    deflection: jax.Array
    rate: jax.Array
    closure: jax.Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Settled:
    """Outcome of :func:`settle`: state ``(n,)``, last cycle, whether the tolerance was met, cycles run."""

    state: jax.Array
    trace: Trace
    settled: jax.Array
    cycles: jax.Array


def cycle(stepper, state):
    """One cycle from the deviation ``state`` at t = 0.

    Returns
    -------
    state : array ``(n,)``
    trace : Trace
    """
    ahead = jnp.roll(stepper.linear, -2, axis=0)[::2]

    def step(carry, known):
        return stepper.advance(*carry, *known), carry[1]

    start = stepper.observe(state)
    (state, end), samples = lax.scan(step, (state, start), (stepper.linear[1::2], ahead), unroll=2)
    return state, traced(stepper, samples, end - start)


def traced(stepper, samples, change):
    """The Trace of a cycle from w ``(steps, 2G)``, (l, l') of the states, and its change ``(2G,)`` over the cycle."""
    deflection, rate = jax.vmap(stepper.flexed)(samples).T, jnp.split(samples.T, 2)[1]
    change_l, change_v = jnp.split(jnp.abs(change), 2)
    gap = (1 - stepper.law.epsilon) * stepper.law.backlash + 1e-300
    size_l = jnp.abs(deflection).max(axis=1) + gap
    size_v = jnp.abs(rate).max(axis=1) + stepper.frequency * gap
    closure = jnp.concatenate([change_l / size_l, change_v / size_v]).max(initial=0.0)
    return Trace(deflection, rate, closure)


def _no_trace(stepper):
    """The Trace before the first cycle, open: loops that begin with it hold one copy of a cycle, and compile faster."""
    empty = jnp.zeros((len(stepper.viscous), stepper.linear.shape[0] // 2))
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
        The last cycle; ``trace.closure`` its change.
    """
    return lax.fori_loop(0, cycles, lambda _, carry: cycle(stepper, carry[0]), (state, _no_trace(stepper)))


def settle(stepper, state, *, tolerance=1e-6, max_cycles=200):
    """March until a cycle closes within ``tolerance``, or ``max_cycles`` have passed; valid under jit and vmap.

    Parameters
    ----------
    stepper : Stepper
    state : array ``(n,)``
    tolerance : float
        Allowed ``trace.closure``. A slow drift closes every cycle to the drift of one cycle.
    max_cycles : int

    Returns
    -------
    Settled
        ``settled`` is False where the motion is not periodic, has a longer period or decays too slowly.
    """

    def unfinished(carry):
        _, trace, done = carry
        return (done < max_cycles) & ~(trace.closure <= tolerance) & ~jnp.isnan(trace.closure)

    def another(carry):
        state, _, done = carry
        return *cycle(stepper, state), done + 1

    state, trace, done = lax.while_loop(unfinished, another, (state, _no_trace(stepper), jnp.array(0)))
    return Settled(state, trace, trace.closure <= tolerance, done)

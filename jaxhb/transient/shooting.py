"""Shooting: Newton's method on the state at the beginning of the cycle, for stable and unstable motions."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import lax

from .integrate import Trace, cycle

LENGTHS = (1.0, 0.6, 0.36, 0.2, 0.1, 0.03)
"""Shares of a Newton step that are tried at once: beside grazing impacts only short steps improve the closure."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Shot:
    """A periodic motion found by shooting.

    state ``(n,)`` at t = 0; trace : its cycle; closure_before, closure_after : of the start and of the result; steps :
    Newton steps taken; monodromy ``(n, n)`` of the integrated map at the result, in the coordinates of the state: its
    eigenvalues are the Floquet multipliers.
    """

    state: jax.Array
    trace: Trace
    closure_before: jax.Array
    closure_after: jax.Array
    steps: jax.Array
    monodromy: jax.Array


def monodromy(stepper, state):
    """Derivative ``(n, n)`` of the state after one cycle with respect to the state before."""
    return jax.jacfwd(lambda z: cycle(stepper, z)[0])(state)


def shoot(stepper, state, *, steps_newton=6, tolerance=1e-11, cutoff=1e-10, persistent=False):
    """Correct a state until the cycle closes, ``z(T; z) = z``; valid under jit and vmap.

    Each Newton step keeps the length of LENGTHS that closes best, and the steps end where none closes better. Motion
    that returns whatever it is (free rotation of a floating train) makes ``I - Phi`` singular and is left alone by a
    pseudo-inverse. Under jit the last monodromy matrix costs nothing where it is not used.

    Parameters
    ----------
    stepper : Stepper
    state : array ``(n,)``
        Deviation at t = 0 near the wanted motion.
    steps_newton : int
        At most so many steps.
    tolerance : float
        Closure at which to stop.
    cutoff : float
        Singular values of ``I - Phi`` below this share of the largest are taken as zero.
    persistent : bool
        Step on where no length closes better: a search, for states far from any periodic motion.

    Returns
    -------
    Shot
    """
    identity = jnp.eye(state.shape[0])
    lengths = jnp.array(LENGTHS)

    def defect(z):
        end, trace = cycle(stepper, z)
        return end - z, trace.closure

    def unfinished(carry):
        _, _, closure, done, improved = carry
        return (done < steps_newton) & (closure > tolerance) & improved

    def correct(carry):
        z, gap, closure, done, _ = carry
        direction = jnp.linalg.pinv(identity - monodromy(stepper, z), rtol=cutoff) @ gap
        tried = z + lengths[:, None] * direction
        gaps, closures = jax.vmap(defect)(tried)
        best = jnp.nanargmin(closures)
        improved = persistent | (closures[best] < closure)
        found = (tried[best], gaps[best], closures[best])
        kept = [jnp.where(improved, new, old) for new, old in zip(found, (z, gap, closure), strict=True)]
        return *kept, done + 1, improved

    gap, before = defect(state)
    start = (state, gap, before, jnp.array(0), jnp.array(True))
    state, _, after, done, _ = lax.while_loop(unfinished, correct, start)
    return Shot(state, cycle(stepper, state)[1], before, after, done, monodromy(stepper, state))

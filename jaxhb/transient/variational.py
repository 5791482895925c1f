"""The linearised motion around one cycle: a periodic, time-varying linear train solved by one sweep over the cycle.

With slopes w and s of the excess force phi in l and l', the forces u that answer a given periodic motion b are

    z' = A z + E u,      u = w (b + l) + s (b' + l'),      (l, l') = L z,      z(T) = z(0).

u is taken as linear between the instants of a grid: exact where a mesh stays in contact (u = 0) and where it flies
freely through its gap (l linear in time), so that six instants per period of the highest mesh mode do. z(0) follows
from the slowest modes alone, whose memory outlasts the cycle. Work per instant is that of one small matrix product,
whatever the number of harmonics; it replaces the factorisation of a Jacobian in which all harmonics are coupled.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .stepper import hold_weights

SLOW_MODES = 8
"""Modes whose state is carried from the end of the cycle to its beginning."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Variation:
    """What the sweep needs at K instants; n states, G meshes, C of the states periodic.

    propagate ``(n, n)``, forcing ``(n, G)``, observation ``(2G, n)``; gain ``(K, G, 2G)``: force of a mesh per motion;
    seen ``(K, G, C)``: forces caused by unit states at the beginning; closing ``(C, n)``: from the state at the end of
    a cycle begun at zero to the state at the beginning of the periodic one.
    """

    propagate: jax.Array
    forcing: jax.Array
    observation: jax.Array
    gain: jax.Array
    seen: jax.Array
    closing: jax.Array

    def forces(self, motion):
        """Forces u ``(G, K)`` that answer the motion ``(2G, K)``: b above b'."""
        given = jnp.einsum("kgh,hk->kg", self.gain, motion)

        def step(state, known):
            gain, force = known
            force = force + gain @ (self.observation @ state)
            return self.propagate @ state + self.forcing @ force, force

        end, force = lax.scan(step, jnp.zeros(len(self.propagate)), (self.gain, given), unroll=2)
        return (force + self.seen @ (self.closing @ end)).T


def vary(train, frequency, slope, rate_slope):
    """Prepare the sweep for slopes of phi.

    Parameters
    ----------
    train : Surrogate
    frequency : float, Omega in rad/s
    slope, rate_slope : arrays ``(G, K)``, averages around K equidistant instants

    Returns
    -------
    Variation
    """
    instants = slope.shape[-1]
    propagate, early, late = hold_weights(train.space, 2 * jnp.pi / frequency / instants)
    L = train.space.observation
    at_once = (L @ late).at[: len(slope)].add(-train.static)
    own = jnp.eye(len(slope))
    slopes = jnp.concatenate([slope.T[:, :, None] * own, rate_slope.T[:, :, None] * own], axis=2)
    gain = jnp.linalg.solve(own - slopes @ at_once, slopes)
    forcing = propagate @ late + early

    def step(state, gain):
        force = gain @ (L @ state)
        return propagate @ state + forcing @ force, force

    n = len(propagate) // 2
    slow = min(SLOW_MODES, n)
    kept = np.r_[0:slow, n : n + slow]
    end, seen = lax.scan(step, jnp.eye(2 * n)[:, kept], gain)
    gap = jnp.eye(len(kept)) - end[kept]
    closing = jnp.zeros((len(kept), 2 * n)).at[:, kept].set(jnp.linalg.pinv(gap, rtol=1e-9))
    return Variation(propagate, forcing, L, gain, seen, closing)

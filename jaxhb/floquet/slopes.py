"""Slopes of the forces of teeth along a motion, by which a disturbance acts back on the
train, averaged in intervals.

The nonlinear force phi of a mesh is ``(c2 - c1) E(l) + r dE/dt``, the second where
damping acts in contact alone, of an integral E of the engagement less 1. A disturbance
changes E by ``(engagement - 1)`` times its deflection, which is bounded, and the time
derivative goes to the modes, whose rates multiply the forcing instead. Where the
stiffness of a mesh varies, and of what acts beside shafts, elastic force and damping
stand by themselves; dry friction goes by l'.

Slopes are constant between the times at which a motion passes the knots of its law, but
in the smooth zone and where the stiffness varies. All integrals over an interval are
taken from knot to knot.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import numpy as np
from numpy.polynomial import legendre

from jaxhb.equations import backlash, fourier
from jaxhb.equations.backlash import MeshParameters
from jaxhb.equations.state_space import Modes

SAMPLES, FEWEST_SAMPLES = (
    16,
    1024,
)  # of a motion per harmonic, between which it is a cubic; and of a cycle at least
FRICTION_SAMPLES = (
    128  # per harmonic: slip is passed so fast that its time has to be known far better
)
NODES = 8  # Gauss nodes of a piece whose slope is not constant
NEWTON_STEPS = (
    5  # to the time of a knot from the straight line between samples, bracketed
)
ENGAGEMENT, ELASTIC, FRICTION = range(
    3
)  # kinds of slopes: engagement less 1, N/m of phi in l, N s/m in l'

_AT, _WEIGHT = legendre.leggauss(NODES)


@dataclass(frozen=True)
class Reactions:
    """C forces by which a disturbance acts back: slopes, of a kind, times what it does
    to a mesh.

    kind, mesh : int ``(C,)``; observed : int ``(C,)``, rows of (l, l'); forcing :
    complex ``(m, C)``, what they do to the modes; meshes : MeshParameters, row by row
    those of ``mesh``.
    """

    kind: np.ndarray
    mesh: np.ndarray
    observed: np.ndarray
    forcing: np.ndarray
    meshes: MeshParameters

    def slopes(self, which, value, share):
        """Slopes of reactions ``which``, int ``(n,)``, where the motion has a ``value``
        (m or m/s), ``(n,)`` or ``(n, K)``, at a ``share`` of the cycle, of the same
        shape.
        """
        law = jax.tree.map(
            lambda a: a[which].reshape(-1, *[1] * (value.ndim - 1)), self.meshes.law
        )
        kind = self.kind[which].reshape(-1, *[1] * (value.ndim - 1))
        engaged = backlash.engagement(law, value)
        found = np.where(kind == ENGAGEMENT, engaged - 1, 0.0)
        if (kind == ELASTIC).any():
            if self.meshes.variation is not None:
                law = backlash.at_instant(law, self._variation(which, share))
            elastic = (
                law.stiffness * (law.epsilon + (1 - law.epsilon) * engaged)
                - law.linear_stiffness
            )
            found = np.where(kind == ELASTIC, elastic, found)
        if (kind == FRICTION).any():
            sticks = (kind == FRICTION) & (np.abs(value) < law.slip)
            found = np.where(
                sticks, law.friction / law.slip, np.where(kind == FRICTION, 0.0, found)
            )
        return found

    def _variation(self, which, share):
        found = np.zeros(share.shape)
        for c in np.flatnonzero(np.any(self.meshes.variation != 0, axis=-1)):
            at = which == c
            found[at] = fourier.values_at(
                self.meshes.variation[c], share[at].ravel()
            ).reshape(share[at].shape)
        return found

    def constant(self, which, value):
        """Whether slopes ``(n,)`` stay as they are up to the next knots."""
        law = jax.tree.map(lambda a: a[which], self.meshes.law)
        engaged = backlash.engagement(law, value)
        between = (engaged > 0) & (engaged < 1)
        if self.meshes.variation is not None:
            varies = (self.meshes.variation != 0).any(axis=-1)[which]
            between = between | varies & (self.kind[which] == ELASTIC)
        return ~between | (self.kind[which] == FRICTION)

    @property
    def knots(self):
        """Values ``(C, 4)`` of the motion at which slopes change, rising."""
        law = self.meshes.law
        knots = np.stack([-law.knee, -law.gap, law.gap, law.knee], axis=-1)
        if (self.kind == FRICTION).any():
            slip = law.slip[:, None] * np.array([-1.0, -1.0, 1.0, 1.0])
            knots = np.where((self.kind == FRICTION)[:, None], slip, knots)
        return knots

    @property
    def stiffest(self):
        """Largest slopes ``(C,)`` that a linear train does not have already."""
        law = self.meshes.law
        swing = (
            0.0
            if self.meshes.variation is None
            else 2 * np.abs(self.meshes.variation).sum(axis=-1)
        )
        elastic = np.maximum(
            np.abs(law.stiffness * (1 + swing) - law.linear_stiffness),
            np.abs(law.linear_stiffness),
        )
        found = np.where(self.kind == ELASTIC, elastic, 0.0)
        return (
            found
            if law.friction is None
            else np.where(self.kind == FRICTION, law.friction / law.slip, found)
        )


def reactions_of(modes: Modes, meshes: MeshParameters) -> Reactions:
    """The :class:`Reactions` of meshes and of what acts beside shafts, on the host."""
    law = meshes.law
    count = len(meshes.link)
    drop = law.stiffness * (1 - law.epsilon)
    viscous = np.where(meshes.contact_damping, meshes.viscous, 0.0)
    varies = (
        np.zeros(count, bool)
        if meshes.variation is None
        else (meshes.variation != 0).any(axis=-1)
    )
    alike = ~varies & (law.stiffness == law.linear_stiffness)
    rows = []
    for g, force in enumerate(modes.forcing.T):
        damping = viscous[g] * modes.rates * force
        if alike[g]:
            rows.append((ENGAGEMENT, g, g, drop[g] * force + damping))
        elif law.stiffness[g] or law.linear_stiffness[g]:
            rows.append((ELASTIC, g, g, force))
            if viscous[g]:
                rows.append((ENGAGEMENT, g, g, damping))
        if law.friction is not None and law.friction[g]:
            rows.append((FRICTION, g, count + g, force))
    kind, mesh, observed = (
        np.array(column) for column in list(zip(*rows, strict=True))[:3]
    )
    forcing = np.stack([row[3] for row in rows], axis=-1)
    return Reactions(
        kind, mesh, observed, forcing, jax.tree.map(lambda a: a[mesh], meshes)
    )


class SampledMotion:
    """What reactions see of a motion ``(G, N+1)`` m: a cubic between equidistant
    samples, and where it passes knots.

    share, reaction : ``(n,)`` of the cycle and of the C, each time a knot is passed.
    """

    def __init__(self, reactions: Reactions, deflection, frequency):
        slips = (reactions.kind == FRICTION).any()
        wanted = (FRICTION_SAMPLES if slips else SAMPLES) * (deflection.shape[-1] - 1)
        self.samples = 1 << (max(wanted, FEWEST_SAMPLES) - 1).bit_length()
        rows = [deflection, fourier.derivative(deflection, frequency)]
        if slips:
            rows.append(fourier.derivative(rows[-1], frequency))
        values = fourier.synthesize(np.concatenate(rows), self.samples)
        step = 2 * np.pi / frequency / self.samples
        self.value, self.change = (
            values[reactions.observed],
            step * values[reactions.observed + len(deflection)],
        )
        self.reaction, self.share = self._passes(reactions.knots)

    def _cubic(self, which, first):
        """Coefficients of the cubic behind samples: value, change, second and third
        power of a share of a step.
        """
        following = (first + 1) % self.samples
        value = self.value[which, first]
        change = self.change[which, first]
        rise = self.value[which, following] - value
        last = self.change[which, following]
        return value, change, 3 * rise - 2 * change - last, change + last - 2 * rise

    def at(self, which, share):
        """Values of reactions ``which`` ``(n,)`` at shares ``(n, ...)`` of the
        cycle.
        """
        place = share * self.samples
        first = np.floor(place).astype(int)
        x = place - first
        a, b, c, d = self._cubic(
            which.reshape(-1, *[1] * (share.ndim - 1)), first % self.samples
        )
        return a + x * (b + x * (c + x * d))

    def _passes(self, knots):
        """Reaction and share of the cycle of every passage of a knot."""
        zone = (self.value > knots[:, 0, None]).astype(np.int8)
        for k in range(1, knots.shape[1]):
            zone += self.value > knots[:, k, None]
        following = np.roll(zone, -1, axis=1)
        which, first = np.nonzero(zone != following)
        before = zone[which, first, None]
        behind = following[which, first, None]
        number = np.arange(knots.shape[1])
        passed = (np.minimum(before, behind) <= number) & (
            number < np.maximum(before, behind)
        )
        step, knot = np.nonzero(passed)
        which = which[step]
        first = first[step]
        a, b, c, d = self._cubic(which, first)
        a = a - knots[which, knot]
        rising = a + b + c + d > 0
        low = np.zeros(len(a))
        high = np.ones(len(a))
        x = -a / (b + c + d)
        for _ in range(NEWTON_STEPS):
            value = a + x * (b + x * (c + x * d))
            rate = b + x * (2 * c + 3 * d * x)
            below = (value < 0) == rising
            low = np.where(below, x, low)
            high = np.where(below, high, x)
            ahead = x - value / np.where(rate == 0, 1.0, rate)
            x = np.where((ahead > low) & (ahead < high), ahead, (low + high) / 2)
        return which, (first + x) / self.samples


def moments(reactions: Reactions, motion: SampledMotion, edges, degrees):
    """Integrals ``(C, K, degrees)`` of slopes times Legendre polynomials over the K
    intervals of a cycle between ``edges`` ``(K+1,)``, over the length of the interval.
    """
    count = len(reactions.kind)
    intervals = len(edges) - 1
    # Pieces are ordered by the interval of a reaction, and in it by time; each interval
    # begins with one.
    owner = (
        np.searchsorted(edges, motion.share, side="right")
        - 1
        + intervals * motion.reaction
    )
    begin = np.concatenate([np.tile(edges[:-1], count), motion.share])
    owner = np.concatenate([np.arange(count * intervals), owner])
    order = np.lexsort((begin, owner))
    begin = begin[order]
    owner = owner[order]
    first = np.flatnonzero(np.diff(owner, prepend=-1))
    which, interval = np.divmod(owner, intervals)
    end = np.append(begin[1:], 0.0)
    end[np.append(first[1:], len(end)) - 1] = np.tile(edges[1:], count)
    scale = 2 / np.diff(edges)[interval]
    low = scale * (begin - edges[interval]) - 1
    high = scale * (end - edges[interval]) - 1

    middle = (begin + end) / 2
    value = motion.at(which, middle)
    constant = reactions.constant(which, value)
    slope = np.where(constant, reactions.slopes(which, value, middle), 0.0)
    found = np.zeros((len(slope), degrees))
    found[:, 0] = slope
    at = np.flatnonzero((slope != 0) & (high - low < 2 - 1e-9))
    found[at] = slope[at, None] * (
        _integrals(high[at], degrees) - _integrals(low[at], degrees)
    )
    at = np.flatnonzero(~constant)
    if len(at):
        middle = (low + high)[at, None] / 2
        half = (high - low)[at, None] / 2
        node = middle + half * _AT
        share = edges[interval[at], None] + (node + 1) / scale[at, None]
        slope = reactions.slopes(which[at], motion.at(which[at], share), share)
        weighted = (slope * half * _WEIGHT / 2)[:, None]
        found[at] = (weighted @ legendre.legvander(node, degrees - 1))[:, 0]
    return np.add.reduceat(found, first).reshape(count, intervals, degrees)


def _integrals(x, degrees):
    """Half the integrals ``(n, degrees)`` of Legendre polynomials up to x, but for
    constants.
    """
    values = legendre.legvander(x, degrees)
    before = np.concatenate([np.zeros((len(x), 1)), values[:, : degrees - 1]], axis=1)
    return (values[:, 1:] - before) / (2 * (2 * np.arange(degrees) + 1))

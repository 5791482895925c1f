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

from jaxhb._jax import Array, Number
from jaxhb.equations import backlash, fourier
from jaxhb.equations.backlash import MeshParameters
from jaxhb.equations.state_space import ComplexModes

# Samples of a motion per harmonic, between which it is a cubic
SAMPLES = 16
# Samples of a cycle at least
FEWEST_SAMPLES = 1024
# Samples per harmonic with friction: slip is passed so fast that its time has to be
# known far better
FRICTION_SAMPLES = 128
NODES = 8  # Gauss nodes of a piece whose slope is not constant
# Steps to the time of a knot from the straight line between samples, bracketed
NEWTON_STEPS = 5
# Kinds of slopes: engagement less 1, N/m of phi in l, N s/m in l'
ENGAGEMENT, ELASTIC, FRICTION = range(3)

_AT, _WEIGHT = legendre.leggauss(NODES)


@dataclass(frozen=True)
class Reactions:
    """The C forces by which a disturbance acts back: slopes, of a kind, times what the
    disturbance does to a mesh.

    kind, mesh : int ``(C,)``; observed : int ``(C,)``, rows of (l, l'); forcing :
    complex ``(m, C)``, of the forces on the modes; meshes : MeshParameters, row by row
    those of ``mesh``.
    """

    kind: np.ndarray
    mesh: np.ndarray
    observed: np.ndarray
    forcing: np.ndarray
    meshes: MeshParameters

    def slopes(
        self, which: np.ndarray, value: np.ndarray, share: np.ndarray
    ) -> np.ndarray:
        """Slopes of reactions ``which``, int ``(n,)``, where the motion has a ``value``
        (m or m/s), ``(n,)`` or ``(n, K)``, at a ``share`` of the cycle, of the same
        shape.
        """
        shape = (-1,) + (1,) * (value.ndim - 1)
        law = jax.tree.map(lambda array: array[which].reshape(shape), self.meshes.law)
        kind = self.kind[which].reshape(shape)
        engaged = backlash.engagement(law, value)
        slopes = np.where(kind == ENGAGEMENT, engaged - 1, 0.0)
        if (kind == ELASTIC).any():
            variation = self.meshes.variation
            if variation is not None:
                of_reactions = _variation(variation, which, share)
                law = backlash.at_instant(law, of_reactions)
            tangent = law.stiffness * (law.epsilon + (1 - law.epsilon) * engaged)
            elastic = tangent - law.linear_stiffness
            slopes = np.where(kind == ELASTIC, elastic, slopes)
        if (kind == FRICTION).any():
            sticks = (kind == FRICTION) & (np.abs(value) < law.slip)
            slips = np.where(kind == FRICTION, 0.0, slopes)
            slopes = np.where(sticks, law.friction / law.slip, slips)
        return slopes

    def constant(self, which: np.ndarray, value: np.ndarray) -> np.ndarray:
        """Whether slopes ``(n,)`` stay the same up to the next knots."""
        law = jax.tree.map(lambda array: array[which], self.meshes.law)
        engaged = backlash.engagement(law, value)
        between = (engaged > 0) & (engaged < 1)
        if self.meshes.variation is not None:
            varies = (self.meshes.variation != 0).any(axis=-1)[which]
            between = between | varies & (self.kind[which] == ELASTIC)
        return ~between | (self.kind[which] == FRICTION)

    @property
    def knots(self) -> np.ndarray:
        """Values ``(C, 4)`` of the motion at which slopes change, rising."""
        law = self.meshes.law
        knots = np.stack([-law.knee, -law.gap, law.gap, law.knee], axis=-1)
        if law.slip is not None and (self.kind == FRICTION).any():
            slip = law.slip[:, None] * np.array([-1.0, -1.0, 1.0, 1.0])
            knots = np.where((self.kind == FRICTION)[:, None], slip, knots)
        return knots

    @property
    def stiffest(self) -> np.ndarray:
        """Largest slopes ``(C,)`` that a linear train does not have already."""
        law = self.meshes.law
        variation = self.meshes.variation
        swing: Number = 0.0
        if variation is not None:
            swing = 2 * np.abs(variation).sum(axis=-1)
        elastic = np.maximum(
            np.abs(law.stiffness * (1 + swing) - law.linear_stiffness),
            np.abs(law.linear_stiffness),
        )
        stiffest = np.where(self.kind == ELASTIC, elastic, 0.0)
        if law.friction is None or law.slip is None:
            return stiffest
        return np.where(self.kind == FRICTION, law.friction / law.slip, stiffest)


def _variation(variation: Array, which: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Variation of the stiffness at shares of the cycle, of the rows ``which`` of
    coefficients ``(C, K+1)``.
    """
    values = np.zeros(share.shape)
    for row in np.flatnonzero(np.any(variation != 0, axis=-1)):
        mask = which == row
        shares = share[mask]
        of_row = fourier.values_at(variation[row], shares.ravel())
        values[mask] = of_row.reshape(shares.shape)
    return values


def reactions_of(modes: ComplexModes, meshes: MeshParameters) -> Reactions:
    """The :class:`Reactions` of meshes and of what acts beside shafts, on the host."""
    law = meshes.law
    count = len(meshes.link)
    drop = law.stiffness * (1 - law.epsilon)
    viscous = np.where(meshes.contact_damping, meshes.viscous, 0.0)
    varies: Array = np.zeros(count, bool)
    if meshes.variation is not None:
        varies = (meshes.variation != 0).any(axis=-1)
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
    mesh = np.array([row[1] for row in rows])
    return Reactions(
        kind=np.array([row[0] for row in rows]),
        mesh=mesh,
        observed=np.array([row[2] for row in rows]),
        forcing=np.stack([row[3] for row in rows], axis=-1),
        meshes=jax.tree.map(lambda array: array[mesh], meshes),
    )


class SampledMotion:
    """A motion ``(G, N+1)`` m as reactions see it: a cubic between equidistant samples,
    and the times at which it passes knots.

    share, reaction : ``(n,)`` of the cycle and of the C, each time a knot is passed.
    """

    def __init__(self, reactions: Reactions, deflection: np.ndarray, frequency: float):
        slips = (reactions.kind == FRICTION).any()
        per_harmonic = FRICTION_SAMPLES if slips else SAMPLES
        least = max(per_harmonic * (deflection.shape[-1] - 1), FEWEST_SAMPLES)
        self.samples = 1 << (least - 1).bit_length()
        rows = [deflection, fourier.derivative(deflection, frequency)]
        if slips:
            rows.append(fourier.derivative(rows[-1], frequency))
        values = fourier.synthesize(np.concatenate(rows), self.samples)
        step = 2 * np.pi / frequency / self.samples
        self.value = values[reactions.observed]
        self.change = step * values[reactions.observed + len(deflection)]
        self.reaction, self.share = self._passes(reactions.knots)

    def _cubic(
        self, which: np.ndarray, first: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Coefficients of the cubic behind samples: value, change, second and third
        power of a share of a step.
        """
        following = (first + 1) % self.samples
        value = self.value[which, first]
        change = self.change[which, first]
        rise = self.value[which, following] - value
        last = self.change[which, following]
        return value, change, 3 * rise - 2 * change - last, change + last - 2 * rise

    def at(self, which: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Values of reactions ``which`` ``(n,)`` at shares ``(n, ...)`` of the
        cycle.
        """
        place = share * self.samples
        first = np.floor(place).astype(int)
        x = place - first
        which = which.reshape((-1,) + (1,) * (share.ndim - 1))
        a, b, c, d = self._cubic(which, first % self.samples)
        return a + x * (b + x * (c + x * d))

    def _passes(self, knots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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


def moments(
    reactions: Reactions, motion: SampledMotion, edges: np.ndarray, degrees: int
) -> np.ndarray:
    """Integrals ``(C, K, degrees)`` of slopes times Legendre polynomials over the K
    intervals of a cycle between ``edges`` ``(K+1,)``, over the length of the interval.
    """
    count = len(reactions.kind)
    intervals = len(edges) - 1
    # Pieces are ordered by the interval of a reaction, and in it by time; each interval
    # begins with one.
    owner = np.searchsorted(edges, motion.share, side="right") - 1
    owner = owner + intervals * motion.reaction
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
    averages = np.zeros((len(slope), degrees))
    averages[:, 0] = slope
    short = np.flatnonzero((slope != 0) & (high - low < 2 - 1e-9))
    integrals = _integrals(high[short], degrees) - _integrals(low[short], degrees)
    averages[short] = slope[short, None] * integrals
    curved = np.flatnonzero(~constant)
    if len(curved):
        middle = (low + high)[curved, None] / 2
        half = (high - low)[curved, None] / 2
        node = middle + half * _AT
        share = edges[interval[curved], None] + (node + 1) / scale[curved, None]
        reaction = which[curved]
        slope = reactions.slopes(reaction, motion.at(reaction, share), share)
        weighted = (slope * half * _WEIGHT / 2)[:, None]
        averages[curved] = (weighted @ legendre.legvander(node, degrees - 1))[:, 0]
    return np.add.reduceat(averages, first).reshape(count, intervals, degrees)


def _integrals(x: np.ndarray, degrees: int) -> np.ndarray:
    """Half the integrals ``(n, degrees)`` of Legendre polynomials up to x, without
    their constants.
    """
    values = legendre.legvander(x, degrees)
    before = np.concatenate([np.zeros((len(x), 1)), values[:, : degrees - 1]], axis=1)
    return (values[:, 1:] - before) / (2 * (2 * np.arange(degrees) + 1))

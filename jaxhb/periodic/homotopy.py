"""From a linear law with strong tooth damping to the wanted train, along the curve of its periodic motions.

Where teeth hammer with little damping, time integration may wander for ever though periodic motions exist. With a gap
as stiff as the contact the law is linear and its motion unique. On the way to the wanted law,

    epsilon^p,     damping r w^(1 - p),     transition tau v^(1 - p),     p = 0 .. 1,

the motion stays bounded, so that the curve of motions that begins at p = 0 has nowhere to end but at p = 1, however
often it turns back (homotopies of this kind succeed for almost all their parameters: Chow, Mallet-Paret and Yorke,
Math. Comp. 32 (1978) 887). It is followed by arclength (:mod:`jaxhb.periodic.continuation`) in the states at the
beginnings of the segments of a cycle. How long it is nobody knows beforehand: the work is bounded.
"""

from dataclasses import dataclass, fields

import jax
import jax.numpy as jnp
import numpy as np

from .._program import Program
from ..harmonic import backlash
from ..transient import segments
from ..transient.stepper import Stepper
from . import continuation
from .orbits import coefficients, stepper_of, work_of_cycle

BEGINNINGS = ((20.0, 20.0, False), (6.0, 4.5, True), (20.0, 7.0, False))
"""Tooth damping and transition at p = 0 over the wanted ones, as far as the steps carry the damping and the backlash
holds the transition: one curve after another."""

LEAST_EPSILON = 1e-4
"""Stiffness in the gap below which it changes linearly in p: of no consequence, and zero has no logarithm."""

WORK, LEAST, MOST = 2e9, 50, 700
"""Of all curves: Jacobians times :func:`work_of_cycle`, twenty seconds; Jacobians below which none arrives,
and of one curve at most."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Towards(Stepper):
    """A Stepper whose meshes are a share p on the way from the linear law; heavier w and wider v at p = 0."""

    share: jax.Array = 1.0
    heavier: jax.Array = 1.0
    wider: jax.Array = 1.0
    late: jax.Array = False

    def phi(self, deflection, rate):
        """Force ``(G,)`` N of the meshes less its linear part; that of the train itself for a share of 1."""
        law, left = self.law, 1 - self.share
        kept = jnp.maximum(law.epsilon, LEAST_EPSILON)
        geometric = kept**self.share - self.share * (kept - law.epsilon)
        epsilon = jnp.where(self.late, 1 - self.share * (1 - law.epsilon), geometric)
        widest = jnp.minimum(law.transition * self.wider, jnp.maximum(law.transition, 1.0))
        law = backlash.Law(law.stiffness, epsilon, law.transition * (widest / law.transition) ** left, law.backlash)
        gated = jnp.where(self.contact_damping, (1 - epsilon) / jnp.maximum(1 - self.law.epsilon, 1e-300), 0.0)
        damping = self.viscous * self._damping() ** left * (1 - gated * (1 - backlash.engagement(law, deflection)))
        return backlash.force(law, deflection) - law.stiffness * deflection + (damping - self.viscous) * rate

    def _damping(self):
        """Tooth damping at p = 0 over the wanted one: at most what the steps carry."""
        rows, columns = self.space.observation[len(self.viscous) :], self.space.forcing
        step = 2 * jnp.pi / self.frequency / self.steps
        decay = step * self.viscous * -jnp.einsum("gn,ng->g", rows, columns)
        return jnp.clip(0.5 / jnp.where(decay > 0, decay, 1.0), 1.0, self.heavier)


@Program
def _followed(stepper, beginning, most):
    """The Followed of one curve; nodes ``(K, n)`` and deflections ``(G, room)`` where it ends."""
    parts = {f.name: getattr(stepper, f.name) for f in fields(Stepper)}
    shape = (segments.SEGMENTS, len(stepper.flank_state))
    size = (jnp.linalg.norm(stepper.flank_state) + 1e-300) * np.sqrt(segments.SEGMENTS)

    def towards(share):
        return Towards(**parts, share=share, heavier=beginning[0], wider=beginning[1], late=beginning[2])

    def nodes(y):
        return size * y[:-1].reshape(shape)

    def linearize(y):
        gap, slope, share_slope = segments.linearize(towards, nodes(y), y[-1])
        condensed = segments.condense(slope, share_slope / size)
        return gap / size, condensed, segments.tangent(condensed)

    def evaluate(y):
        return segments.gaps(towards(y[-1]), nodes(y)) / size

    def correct(gap, slopes):
        condensed, tangent = slopes
        return segments.closing(condensed, gap), tangent

    followed = continuation.follow(linearize, evaluate, correct, jnp.zeros(shape[0] * shape[1] + 1), most=most)
    return followed, nodes(followed.y), segments.motion(stepper, nodes(followed.y)).deflection


@dataclass(frozen=True)
class Arrival:
    """What the curves led to.

    coefficients : ``(G, n+1)`` deflections in m, None where no curve arrives; nodes ``(K, n)`` of that motion;
    curves : followed; steps, folds : of the last one.
    """

    coefficients: np.ndarray | None
    nodes: np.ndarray | None
    curves: int
    steps: int
    folds: int


def find(train, rpm, plan):
    """The :class:`Arrival` at a train, with the meshes and instants of a Plan; of no curve where WORK is too little."""
    left, curves = int(WORK / work_of_cycle(train, plan.instants)), 0
    if left < LEAST:
        return Arrival(None, None, 0, 0, 0)
    stepper = stepper_of(train, rpm, plan)
    while True:
        followed, nodes, deflection = _followed(stepper, BEGINNINGS[curves], min(left, MOST))
        left, curves = left - int(followed.jacobians), curves + 1
        told = {"curves": curves, "steps": int(followed.steps), "folds": int(followed.folds)}
        if bool(followed.arrived):
            return Arrival(coefficients(deflection, plan.instants), np.asarray(nodes), **told)
        if curves == len(BEGINNINGS) or left < MOST // 4:
            return Arrival(None, None, **told)

"""From a linear law with strong tooth damping to the wanted train, along the curve of its periodic motions.

Where teeth hammer with little damping, time integration may wander for ever though periodic motions exist. With a gap
as stiff as the contact the law is linear and its motion unique. On the way to the wanted law,

    epsilon^p,     damping r w^(1 - p),     transition tau v^(1 - p),     variation p (kappa - 1),     p = 0 .. 1,

the motion stays bounded, so that the curve of motions that begins at p = 0 has nowhere to end but at p = 1, however
often it turns back (homotopies of this kind succeed for almost all their parameters: Chow, Mallet-Paret and Yorke,
Math. Comp. 32 (1978) 887). It is followed by arclength (:mod:`jaxhb.solutions.continuation`) in the states at the
beginnings of the segments of a cycle. How long it is nobody knows beforehand: the work is bounded.
"""

from dataclasses import dataclass, fields, replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array
from jaxhb._program import Program
from jaxhb.equations import backlash
from jaxhb.integration import shooting
from jaxhb.integration.step import Stepper
from jaxhb.results.status import Homotopy
from jaxhb.solutions import continuation
from jaxhb.solutions.orbits import FoundOrbit, coefficients, stepper_of, work_of_cycle


class Beginning(NamedTuple):
    """The law at p = 0: tooth damping and transition over the wanted ones, at most, as far as the steps carry the
    damping and the backlash holds the transition; whether epsilon falls linearly in p instead of geometrically."""

    damping: float
    transition: float
    linear: bool


# Of one curve after another: which is short nobody knows beforehand.
BEGINNINGS = Beginning(20.0, 20.0, False), Beginning(6.0, 4.5, True), Beginning(20.0, 7.0, False)
WORK = 2e9  # of all curves, Jacobians times ``work_of_cycle``: twenty seconds
FEWEST_JACOBIANS, MOST_JACOBIANS = 50, 700  # of one curve: with fewer no curve arrives
LEAST_EPSILON = 1e-4  # below which epsilon changes linearly in p: too soft to matter, and zero has no logarithm


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class HomotopyStepper(Stepper):
    """A Stepper whose meshes are the share p, the continuation parameter, of the way from the linear law."""

    parameter: Array | float = 1.0
    beginning: Beginning = BEGINNINGS[0]

    def nonlinear_force(self, deflection, rate, row):
        """Force ``(G,)`` N of the meshes less its linear part; that of the train itself for p = 1."""
        law, left = self.law, 1 - self.parameter
        least = jnp.maximum(law.epsilon, LEAST_EPSILON)
        # epsilon^p for what is not too small, and the little below it linear in p: 1 at p = 0, epsilon at p = 1.
        geometric = least**self.parameter - self.parameter * (least - law.epsilon)
        epsilon = jnp.where(self.beginning.linear, 1 - self.parameter * (1 - law.epsilon), geometric)
        widest = jnp.minimum(law.transition * self.beginning.transition, jnp.maximum(law.transition, 1.0))
        law = replace(law, epsilon=epsilon, transition=law.transition * (widest / law.transition) ** left)
        if self.variation is not None:
            law = backlash.at_instant(law, self.parameter * self.variation_at(row))
        in_contact = jnp.where(self.contact_damping, (1 - epsilon) / jnp.maximum(1 - self.law.epsilon, 1e-300), 0.0)
        damping = self.viscous * self._damping() ** left * (1 - in_contact * (1 - backlash.engagement(law, deflection)))
        elastic = backlash.force(law, deflection) - law.linear_stiffness * deflection
        return elastic + (damping - self.viscous) * rate + backlash.dry_friction(law, rate)

    def _damping(self):
        """Tooth damping at p = 0 over the wanted one: at most what the steps carry."""
        rows, columns = self.observation[len(self.viscous) :], self.space.forcing
        step = 2 * jnp.pi / self.frequency / self.steps
        # The damping force is taken explicitly in a step: with r times the rate of one unit of force times the step
        # above about a half, the stages of the step would overshoot.
        decay = step * self.viscous * -jnp.einsum("gn,ng->g", rows, columns)
        return jnp.clip(0.5 / jnp.where(decay > 0, decay, 1.0), 1.0, self.beginning.damping)


def _on_the_way(stepper, beginning, p):
    """The HomotopyStepper at p."""
    parts = {f.name: getattr(stepper, f.name) for f in fields(Stepper)}
    return HomotopyStepper(**parts, parameter=p, beginning=beginning)


def _scale(stepper):
    """Unit of the states in y, the norm of all nodes on the flanks: what makes their changes comparable with p's."""
    return (jnp.linalg.norm(stepper.flank_state) + 1e-300) * np.sqrt(shooting.SEGMENTS)


def _nodes(stepper, y):
    """States ``(K, n)`` at the beginnings of the segments, of y = (states, p)."""
    return _scale(stepper) * y[:-1].reshape(shooting.SEGMENTS, len(stepper.flank_state))


@Program
def _linearized(stepper, beginning, y, normal):
    """What ``linearize`` of :func:`continuation.follow_curve` returns: H are the gaps of the segments, and the
    determinant orients the tangent, not ``normal``."""
    scale, at = _scale(stepper), partial(_on_the_way, stepper, beginning)
    gap, slope, by_parameter = shooting.linearize(at, _nodes(stepper, y), y[-1])
    condensed = shooting.condense(slope, by_parameter / scale)
    return gap / scale, shooting.closing(condensed, gap / scale), shooting.tangent(condensed), condensed


@Program
def _simplified(stepper, beginning, y, condensed):
    """What ``simplify`` of :func:`continuation.follow_curve` returns."""
    gap, _ = shooting.gaps(_on_the_way(stepper, beginning, y[-1]), _nodes(stepper, y))
    gap = gap / _scale(stepper)
    return gap, shooting.closing(condensed, gap)


@Program
def _motion(stepper, y):
    """Nodes ``(K, n)`` and deflections ``(G, capacity)`` of the motion at y."""
    nodes = _nodes(stepper, y)
    return nodes, shooting.motion(stepper, nodes).deflection


def find(train, rpm, plan):
    """The FoundOrbit at the end of the first curve that arrives, with the meshes and time steps of a Plan, and the
    event that tells of it; of no curve where that is more than ``WORK``."""
    left = int(WORK / work_of_cycle(train, plan.time_steps))
    if left < FEWEST_JACOBIANS:
        return FoundOrbit(None, np.inf, None, 0), Homotopy(False, 0, 0, 0, plan.time_steps)
    stepper = jax.device_put(stepper_of(train, rpm, plan)[0])  # once, not for every Jacobian
    start = np.zeros(shooting.SEGMENTS * len(stepper.flank_state) + 1)
    for curves, beginning in enumerate(BEGINNINGS, 1):
        linearize, simplify = (partial(part, stepper, beginning) for part in (_linearized, _simplified))
        end = continuation.follow_curve(linearize, simplify, start, most=min(left, MOST_JACOBIANS))
        event = Homotopy(end.arrived, curves, end.steps, end.folds, plan.time_steps)
        if end.arrived:
            nodes, deflection = _motion(stepper, end.y)
            # At the end of a curve its segments close to what counts as periodic.
            return FoundOrbit(coefficients(deflection, plan.time_steps), 0.0, np.asarray(nodes), 1), event
        left -= end.jacobians
        if left < MOST_JACOBIANS // 4:
            break
    return FoundOrbit(None, np.inf, None, 0), event

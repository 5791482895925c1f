"""Starts for Newton's method where a march of a few cycles does not settle: closed orbits, found by shooting.

Light damping makes time integration settle slowly, and strong hammering makes the wanted motion unstable or one of
many that the march visits. Newton's method on the state at the beginning of the cycle finds it all the same, from one
or another of the cycles that a short march went through. Motions found here are those of the steps taken; the
harmonics correct them.
"""

from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..harmonic import fourier
from ..transient.integrate import cycle
from ..transient.shooting import shoot
from ..transient.surrogate import surrogate
from .march import begin
from .problem import pose, reduced_equation

CYCLES = 64
"""Cycles marched at most; those that close best are shot from."""

STEADY = 1e-3
"""Closure of a cycle from which Newton's method on the harmonics usually succeeds; the march ends there."""

TRIES, WORK = (1, 24), 4e7
"""Fewest and most cycles shot from: as many as ``WORK`` pays for, counted in instants times (states^2 + 30^2)."""

STEPS = 25
"""Newton steps of one shooting; those that succeed take about ten."""

SETTLED = 1e-6
"""Closure of a cycle that counts as periodic: far below what the steps themselves leave."""


FLEXIBLE = 1e-6
"""Share of the compliance of a mesh below which modes too fast for the steps are left out."""


@partial(jax.jit, static_argnames=("instants", "excited"))
def _stepper(problem, choice, instants, excited):
    links = jnp.asarray(problem.meshes.link)[choice.chosen]
    harmonics = problem.load.shape[-1] - 1
    reduced, _ = reduced_equation(problem, harmonics, choice.active, choice.chosen, choice.flank)
    train = surrogate(problem.system, links, choice.active, problem.frequency, instants, excited)
    return begin(reduced, train.space, instants, train.static)


def stepper_of(train, rpm, plan):
    """The Stepper of a train with the meshes and instants of a Plan."""
    excited = plan.sizes.excited
    stepper = _stepper(pose(train, rpm, excited), plan.choice, plan.instants, excited)
    flexible = np.abs(np.diag(stepper.static)) * np.asarray(stepper.law.stiffness) > FLEXIBLE
    return stepper if flexible.any() else replace(stepper, static=None)


@jax.jit
def _visited(stepper, until):
    """States ``(CYCLES, n)`` at the beginning of cycles from the flanks, their closures, the last cycle's deflection.

    Ends with the first cycle that closes to ``until``; cycles not marched have closure nan.
    """

    def unfinished(carry):
        done, _, _, closures, _ = carry
        return (done < CYCLES) & ~(closures[done - 1] <= until)

    def visit(carry):
        done, state, states, closures, _ = carry
        after, trace = cycle(stepper, state)
        return done + 1, after, states.at[done].set(state), closures.at[done].set(trace.closure), trace.deflection

    state = stepper.flank_state
    empty = jnp.zeros((CYCLES, len(state))), jnp.full(CYCLES, jnp.nan)
    none = jnp.zeros((len(stepper.viscous), len(stepper.linear) // 2))
    return lax.while_loop(unfinished, visit, (jnp.array(0), state, *empty, none))[2:]


@jax.jit
def _shot(stepper, state):
    shot = shoot(stepper, state, steps_newton=STEPS, tolerance=SETTLED, persistent=True)
    return shot.state, shot.trace.deflection, shot.closure_after


@dataclass(frozen=True)
class Orbit:
    """What was found.

    coefficients : ``(G, n+1)`` deflections in m, None where no cycle closes; closure : of the cycle that closes best,
    state ``(n,)`` its beginning; tries : cycles from which shooting began, or cycles marched.
    """

    coefficients: np.ndarray | None
    closure: float
    state: np.ndarray
    tries: int


def coefficients(deflection):
    """Coefficients ``(G, n+1)`` of deflections ``(G, instants)`` over a cycle, all that the instants tell apart."""
    return np.asarray(fourier.analyze(deflection, (deflection.shape[-1] - 1) // 2))


class Search:
    """Closed orbits of a train at a speed, with the meshes and instants of a Plan."""

    def __init__(self, train, rpm, plan):
        self.instants = plan.instants
        self.stepper = stepper_of(train, rpm, plan)
        self.states, self.closures = None, None

    def march(self, until=0.0):
        """The :class:`Orbit` of the first cycle, from the flanks, that closes to ``until``; the cycles are kept."""
        self.states, closures, deflection = jax.tree.map(np.asarray, _visited(self.stepper, until))
        marched = int(np.isfinite(closures).sum())
        self.closures = np.nan_to_num(closures, nan=np.inf)
        closure = self.closures[max(marched, 1) - 1]
        found = coefficients(deflection) if closure <= until else None
        return Orbit(found, float(closure), self.states[max(marched, 1) - 1], marched)

    def shoot(self, seed=None):
        """The :class:`Orbit` that Newton's method closes from ``seed``, or the cycles of a march that close best."""
        best, tries = Orbit(None, np.inf, None, 0), 0
        for first in self._seeds(seed):
            tries += 1
            state, deflection, closure = _shot(self.stepper, first)
            if closure < best.closure:
                best = Orbit(None, float(closure), np.asarray(state), tries)
            if closure <= SETTLED:
                return replace(best, coefficients=coefficients(deflection))
        return replace(best, tries=tries)

    def _seeds(self, seed):
        if seed is not None:
            yield seed
            return
        if self.states is None:
            self.march()
        most = np.clip(WORK / (self.instants * (self.states.shape[1] ** 2 + 30**2)), *TRIES)
        for first in np.argsort(self.closures)[: int(most)]:
            if np.isfinite(self.closures[first]):
                yield self.states[first]

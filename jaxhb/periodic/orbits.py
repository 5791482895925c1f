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

from ..transient.integrate import cycle
from ..transient.shooting import shoot
from ..transient.surrogate import surrogate
from .march import begin
from .problem import pose, reduced_equation

CYCLES = 64
"""Cycles marched; those that close best are shot from."""

TRIES, WORK = (4, 24), 3e7
"""Fewest and most cycles shot from: as many as ``WORK`` pays for, counted in instants times (states^2 + 30^2)."""

STEPS = 25
"""Newton steps of one shooting; those that succeed take about ten."""

SETTLED = 1e-6
"""Closure of a cycle that counts as periodic: far below what the steps themselves leave."""


@partial(jax.jit, static_argnames=("instants", "excited"))
def _visited(problem, choice, instants, excited):
    """The Stepper of a problem, and the state and closure of each of CYCLES cycles from the flanks."""
    links = jnp.asarray(problem.meshes.link)[choice.chosen]
    harmonics = problem.load.shape[-1] - 1
    reduced, _ = reduced_equation(problem, harmonics, choice.active, choice.chosen, choice.flank)
    train = surrogate(problem.system, links, choice.active, problem.frequency, instants, excited)
    stepper = begin(reduced, train.space, instants)

    def visit(state, _):
        after, trace = cycle(stepper, state)
        return after, (state, trace.closure)

    return stepper, *lax.scan(visit, stepper.flank_state, None, length=CYCLES)[1]


@jax.jit
def _shot(stepper, state):
    shot = shoot(stepper, state, steps_newton=STEPS, tolerance=SETTLED, persistent=True)
    return shot.state, shot.trace.deflection, shot.closure_after


@dataclass(frozen=True)
class Orbit:
    """What shooting found.

    coefficients : ``(G, n+1)`` deflections in m, None where no cycle closes; closure : of the cycle that closes best,
    state ``(n,)`` its beginning; tries : cycles from which shooting began.
    """

    coefficients: np.ndarray | None
    closure: float
    state: np.ndarray
    tries: int


def find(train, rpm, plan, seed=None):
    """The :class:`Orbit` of a train with the meshes and instants of a Plan; ``seed``: a state to try first."""
    excited = plan.sizes.excited
    stepper, states, closures = _visited(pose(train, rpm, excited), plan.choice, plan.instants, excited)
    closures = np.nan_to_num(np.asarray(closures), nan=np.inf)
    seeds = [seed] if seed is not None else []
    most = np.clip(WORK / (plan.instants * (states.shape[1] ** 2 + 30**2)), *TRIES)
    seeds += [states[first] for first in np.argsort(closures)[: int(most)] if np.isfinite(closures[first])]
    best = Orbit(None, np.inf, None, 0)
    for tries, first in enumerate(seeds, 1):
        state, deflection, closure = _shot(stepper, first)
        if closure < best.closure:
            best = Orbit(None, float(closure), np.asarray(state), tries)
        if closure <= SETTLED:
            kept = np.fft.rfft(np.asarray(deflection), norm="forward")[:, : (plan.instants - 1) // 2 + 1]
            return replace(best, coefficients=kept)
    return replace(best, tries=len(seeds))

"""Starts for Newton's method where a march of a few cycles does not settle: closed orbits, found by shooting.

Light damping makes time integration settle slowly, and strong hammering makes the wanted motion unstable or one of
many that the march visits. Newton's method on the state at the beginning of the cycle, then on the states of all its
segments, finds it all the same, from one or another of the cycles that a short march went through. Motions found here
are those of the steps taken; the harmonics correct them.
"""

from dataclasses import dataclass, replace
from functools import cached_property, partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .._program import Program
from ..harmonic import fourier
from ..transient import segments
from ..transient.integrate import cycle, cycle_closure
from ..transient.shooting import shoot
from ..transient.stepper import seen
from ..transient.surrogate import LARGEST, states_of, surrogate
from .march import begin
from .problem import pose, reduced_equation

CYCLES = 64
"""Cycles marched at most; those that close best are shot from."""

STEADY = 1e-3
"""Closure of a cycle from which Newton's method on the harmonics usually succeeds; the march ends there."""

TRIES, WORK = (1, CYCLES), 6e7
"""Fewest and most cycles shot from: as many as ``WORK`` pays for, see :func:`work_of_cycle`."""

STEPS = 15
"""Newton steps of one shooting, in one piece and then in segments: of those that succeed in one piece within 40, nine
out of ten take no more than 12."""

SETTLED, CLOSED = 1e-6, 1e-8
"""Closure of a cycle that counts as periodic, far below what the steps themselves leave; of its segments, aimed at."""

SAME = 1e-4
"""Difference of the deflections, as a share of the largest, below which two orbits are one, found twice."""

ROOM = 32768
"""Most steps a cycle. Arrays have room for them: programs are compiled once and not for each number of steps."""

FLEXIBLE = 1e-6
"""Share of the compliance of a mesh below which modes too fast for the steps are left out."""


@partial(Program, static_argnames="excited")
def _equations(problem, choice, instants, excited):
    """A Stepper without samples of its linear response, the coefficients ``(2G, N+1)`` of these, and the Surrogate."""
    links = jnp.asarray(problem.meshes.link)[choice.chosen]
    harmonics = problem.load.shape[-1] - 1
    reduced, _ = reduced_equation(problem, harmonics, choice.active, choice.chosen, choice.flank)
    train = surrogate(problem.system, links, choice.active, problem.frequency, instants, excited)
    response = seen(reduced.linear, reduced.frequency)
    return begin(reduced, train.space, instants, jnp.zeros((0, len(response))), train.static), response, train


def work_of_cycle(train, instants):
    """What the Jacobian of a cycle costs: instants times (states^2 + 15^2)."""
    return instants * (states_of(train.topology.n_disks) ** 2 + 15**2)


def stepper_of(train, rpm, plan):
    """The Stepper of a train with the meshes and instants of a Plan."""
    return _make(train, rpm, plan)[0]


def _make(train, rpm, plan):
    """A Stepper and the Surrogate that it steps."""
    excited = plan.sizes.excited
    stepper, response, modes = _equations(pose(train, rpm, excited), plan.choice, plan.instants, excited)
    linear = np.zeros((2 * ROOM, len(response)))
    linear[: 2 * plan.instants] = fourier.synthesize(response, 2 * plan.instants).T
    stepper = replace(stepper, linear=linear, count=np.array(plan.instants))
    flexible = np.abs(np.diag(stepper.static)) * np.asarray(stepper.law.stiffness) > FLEXIBLE
    return (stepper if flexible.any() else replace(stepper, static=None)), modes


@Program
def _visited(stepper, until):
    """States ``(CYCLES, n)`` at the beginning of cycles from the flanks, their closures, the last cycle's deflection.

    Ends with the first cycle that closes to ``until``; cycles not marched have closure nan.
    """

    def unfinished(carry):
        done, _, _, closures = carry
        return (done < CYCLES) & ~(closures[done - 1] <= until)

    def visit(carry):
        done, state, states, closures = carry
        after, closure = cycle_closure(stepper, state)
        return done + 1, after, states.at[done].set(state), closures.at[done].set(closure)

    state = stepper.flank_state
    empty = jnp.zeros((CYCLES, len(state))), jnp.full(CYCLES, jnp.nan)
    done, _, states, closures = lax.while_loop(unfinished, visit, (jnp.array(0), state, *empty))
    return states, closures, cycle(stepper, states[done - 1])[1].deflection


@Program
def _shot(stepper, state):
    """What :func:`_closed` makes of the cycle that shooting reaches from a state ``(n,)``."""
    found = shoot(stepper, state, most=STEPS, tolerance=SETTLED)[0]
    return _closed(stepper, segments.beginnings(stepper, found))


@Program
def _closed(stepper, nodes):
    """Nodes ``(K, n)`` with smaller gaps, the deflections ``(G, room)`` of their motion, and its closure."""
    nodes, trace, _ = segments.close(stepper, nodes, tolerance=CLOSED, most=STEPS)
    return nodes, trace.deflection, trace.closure


@dataclass(frozen=True)
class Orbit:
    """What was found.

    coefficients : ``(G, n+1)`` deflections in m, None where no cycle closes; closure : of the cycle that closes best,
    nodes ``(K, n)`` its states at the beginnings of K segments, None after a march; tries : cycles from which shooting
    began, or cycles marched.
    """

    coefficients: np.ndarray | None
    closure: float
    nodes: np.ndarray | None
    tries: int


def _same(deflection, other):
    return np.max(np.abs(deflection - other)) <= SAME * np.max(np.abs(deflection))


def coefficients(deflection, instants):
    """Coefficients ``(G, n+1)`` of deflections ``(G, room)`` over a cycle, all that the instants tell apart."""
    return np.asarray(fourier.analyze(deflection[:, :instants], (instants - 1) // 2))


class Search:
    """Closed orbits of a train at a speed, with the meshes and instants of a Plan."""

    def __init__(self, train, rpm, plan):
        self.train, self.rpm, self.plan = train, rpm, plan
        self.states, self.closures = None, None

    @cached_property
    def _made(self):
        """Made (and its program compiled) when something is searched with it."""
        return _make(self.train, self.rpm, self.plan)

    @cached_property
    def stepper(self):
        """The Stepper."""
        return self._made[0]

    def march(self, until=0.0):
        """The :class:`Orbit` of the first cycle, from the flanks, that closes to ``until``; the cycles are kept."""
        self.states, closures, deflection = jax.tree.map(np.asarray, _visited(self.stepper, until))
        marched = int(np.isfinite(closures).sum())
        self.closures = np.nan_to_num(closures, nan=np.inf)
        closure = self.closures[max(marched, 1) - 1]
        found = coefficients(deflection, self.plan.instants) if closure <= until else None
        return Orbit(found, float(closure), None, marched)

    def shoot(self):
        """Yield the Orbits that Newton's method closes from the cycles of a march that close best, each once.

        Where none closes, the best of all is yielded at last, open.
        """
        best, known = Orbit(None, np.inf, None, 0), []
        for tries, seed in enumerate(self._seeds(), 1):
            nodes, deflection, closure = jax.tree.map(np.asarray, _shot(self.stepper, seed))
            best = replace(best, tries=tries)
            if closure <= SETTLED and not any(_same(deflection, other) for other in known):
                known.append(deflection)
                yield Orbit(coefficients(deflection, self.plan.instants), float(closure), nodes, tries)
            elif closure < best.closure:
                best = Orbit(None, float(closure), nodes, tries)
        if not known:
            yield best

    def close(self, nodes, search):
        """The :class:`Orbit` near the nodes of another one, which another Search with other steps found."""
        if self.train.topology.n_disks > LARGEST or not np.all(self.train.disks.inertia):  # modes depend on the steps
            nodes = nodes @ (self._made[1].space.coordinates @ search._made[1].motion).T
        nodes, deflection, closure = jax.tree.map(np.asarray, _closed(self.stepper, nodes))
        found = coefficients(deflection, self.plan.instants) if closure <= SETTLED else None
        return Orbit(found, float(closure), nodes, 1)

    def _seeds(self):
        """Beginnings ``(tries, n)`` of the cycles of a march that close best."""
        if self.states is None:
            self.march()
        most = int(np.clip(WORK / work_of_cycle(self.train, self.plan.instants), *TRIES))
        best = np.argsort(self.closures)[:most]
        return self.states[best[np.isfinite(self.closures[best])]]

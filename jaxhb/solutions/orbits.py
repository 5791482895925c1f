"""Starts for Newton's method where a march of a few cycles does not settle: closed orbits, found by shooting.

Light damping makes time integration settle slowly, and strong hammering makes the wanted motion unstable or one of
many that the march visits. Newton's method on the state at the beginning of the cycle, then on the states of all its
segments, finds it all the same, from one or another of the cycles that a march went through. Motions found here
are those of the steps taken; the harmonics correct them.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._program import Program
from jaxhb.balance.problem import model_of, problem_at, reduced_equation
from jaxhb.balance.program import reduced_stepper
from jaxhb.equations import fourier
from jaxhb.equations.reduced_model import states_of
from jaxhb.integration import shooting
from jaxhb.integration.step import cycle, cycle_error, rows_of, with_rate

CYCLES = 64  # marched at most; those that close best are shot from
WORK = 6e7  # of the cycles shot from, in units of ``work_of_cycle``
# Of one shooting, in one piece and then in segments: of those that succeed in one piece within 40, nine out of ten take
# no more than 12.
NEWTON_STEPS = 15
STEADY = 1e-3  # periodicity error from which Newton's method on the harmonics usually succeeds; the march ends there
PERIODIC = 1e-6  # periodicity error that counts as none, far below what the steps themselves leave
CLOSED = 1e-8  # the same of the segments of a cycle, aimed at
SAME = 1e-4  # difference of the deflections, as a share of the largest, below which two orbits are one, found twice
CAPACITY = 32768  # steps of a cycle at most. Arrays have room for them: programs are not compiled for each number.
FLEXIBLE = 1e-6  # share of the compliance of a mesh below which modes too fast for the steps are left out


@Program
def _equations(problem, active_meshes, time_steps):
    """A Stepper without samples of its linear response, the coefficients ``(2G, N+1)`` of these, those of the
    variation of the meshes, and the ReducedOrderModel."""
    harmonics = problem.load.shape[-1] - 1
    reduced, _ = reduced_equation(problem, harmonics, active_meshes)
    model = model_of(problem, active_meshes, time_steps)
    response = with_rate(reduced.linear, reduced.frequency)
    empty = jnp.zeros((0, len(response)))
    stepper = reduced_stepper(reduced, model, time_steps, empty, None, model.residual_flexibility)
    return stepper, response, reduced.variation, model


def work_of_cycle(train, time_steps):
    """What the Jacobian of a cycle costs: time steps times (states^2 + 15^2)."""
    return time_steps * (states_of(train.topology.n_disks) ** 2 + 15**2)


def stepper_of(train, rpm, plan):
    """The Stepper of a train with the meshes and time steps of a Plan, and the ReducedOrderModel that it steps."""
    problem = problem_at(train, rpm, plan.static.excited)
    stepper, response, variation, modes = _equations(problem, plan.active_meshes, plan.time_steps)
    # Room for the most steps, the number in use traced: one program for all numbers of steps that follow the modes of
    # the teeth, and one for all that do not: the static response of the rest doubles the time of a step.
    rows = []
    for coefficients in (response, variation):
        rows.append(coefficients if coefficients is None else np.zeros((2 * CAPACITY, len(coefficients))))
        if coefficients is not None:
            rows[-1][: 2 * plan.time_steps] = rows_of(coefficients, plan.time_steps)
    stepper = replace(stepper, linear=rows[0], variation=rows[1], count=np.array(plan.time_steps))
    flexible = np.abs(np.diag(stepper.residual_flexibility)) * np.asarray(stepper.law.stiffness) > FLEXIBLE
    return (stepper if flexible.any() else replace(stepper, residual_flexibility=None)), modes


@Program
def _visited(stepper, until):
    """States ``(CYCLES, n)`` at the beginning of cycles from the flanks up to the first that closes to ``until``, their
    periodicity errors, nan of cycles not marched, and the deflection of the last cycle."""

    def unfinished(carry):
        done, _, _, periodicity_errors = carry
        return (done < CYCLES) & ~(periodicity_errors[done - 1] <= until)

    def visit(carry):
        done, state, states, periodicity_errors = carry
        after, periodicity_error = cycle_error(stepper, state)
        return done + 1, after, states.at[done].set(state), periodicity_errors.at[done].set(periodicity_error)

    state = stepper.flank_state
    empty = jnp.zeros((CYCLES, len(state))), jnp.full(CYCLES, jnp.nan)
    done, _, states, periodicity_errors = lax.while_loop(unfinished, visit, (jnp.array(0), state, *empty))
    return states, periodicity_errors, cycle(stepper, states[done - 1])[1].deflection


@Program
def _shot(stepper, state):
    """What :func:`_closed` makes of the cycle that shooting reaches from a state ``(n,)``."""
    found = shooting.shoot(stepper, state, most=NEWTON_STEPS, tolerance=PERIODIC)[0]
    return _closed(stepper, shooting.beginnings(stepper, found))


@Program
def _closed(stepper, nodes):
    """Nodes ``(K, n)`` with smaller gaps, the deflections ``(G, capacity)`` of their motion, and its periodicity
    error."""
    nodes, trace, _ = shooting.close(stepper, nodes, tolerance=CLOSED, most=NEWTON_STEPS)
    return nodes, trace.deflection, trace.periodicity_error


@dataclass(frozen=True)
class FoundOrbit:
    """An orbit that closes, or of those that do not the one that closes best."""

    coefficients: np.ndarray | None  # (G, n+1) deflections in m, None where no cycle closes
    periodicity_error: float
    nodes: np.ndarray | None  # (K, n) states at the beginnings of K segments, None after a march
    tries: int  # cycles from which shooting began, or cycles marched


def _same_orbit(deflection, other):
    return np.max(np.abs(deflection - other)) <= SAME * np.max(np.abs(deflection))


def coefficients(deflection, time_steps):
    """Coefficients ``(G, n+1)`` of deflections ``(G, capacity)`` over a cycle, all that the time steps tell apart."""
    return np.asarray(fourier.analyze(deflection[:, :time_steps], (time_steps - 1) // 2))


class OrbitSearch:
    """Closed orbits of a train at a speed, with the meshes and time steps of a Plan; as many shots as ``work`` pays."""

    def __init__(self, train, rpm, plan, work=WORK):
        self.train, self.rpm, self.plan, self.work = train, rpm, plan, work
        self.states, self.periodicity_errors = None, None

    @cached_property
    def _made(self):
        """Stepper and ReducedOrderModel, made (and their program compiled) when something is searched with them."""
        return stepper_of(self.train, self.rpm, self.plan)

    @property
    def stepper(self):
        """The Stepper."""
        return self._made[0]

    def march(self, until=0.0):
        """The FoundOrbit of the first cycle, from the flanks, that closes to ``until``; the cycles are kept."""
        self.states, periodicity_errors, deflection = jax.tree.map(np.asarray, _visited(self.stepper, until))
        marched = int(np.isfinite(periodicity_errors).sum())
        self.periodicity_errors = np.nan_to_num(periodicity_errors, nan=np.inf)
        periodicity_error = self.periodicity_errors[max(marched, 1) - 1]
        found = coefficients(deflection, self.plan.time_steps) if periodicity_error <= until else None
        return FoundOrbit(found, float(periodicity_error), None, marched)

    def shoot(self):
        """Yield a FoundOrbit for each orbit that Newton's method closes from the cycles of a march that close best.

        Where none closes, the best of all is yielded at last, open.
        """
        best, known = FoundOrbit(None, np.inf, None, 0), []
        for tries, seed in enumerate(self._seeds(), 1):
            nodes, deflection, periodicity_error = jax.tree.map(np.asarray, _shot(self.stepper, seed))
            best = replace(best, tries=tries)
            if periodicity_error <= PERIODIC and not any(_same_orbit(deflection, other) for other in known):
                known.append(deflection)
                yield FoundOrbit(coefficients(deflection, self.plan.time_steps), float(periodicity_error), nodes, tries)
            elif periodicity_error < best.periodicity_error:
                best = FoundOrbit(None, float(periodicity_error), nodes, tries)
        if not known:
            yield best

    def close(self, nodes, search):
        """The FoundOrbit near the nodes of another one, which another OrbitSearch with other steps found."""
        # Modes, and their order, depend on the steps.
        nodes = nodes @ (self._made[1].space.coordinates @ search._made[1].motion).T
        nodes, deflection, periodicity_error = jax.tree.map(np.asarray, _closed(self.stepper, nodes))
        found = coefficients(deflection, self.plan.time_steps) if periodicity_error <= PERIODIC else None
        return FoundOrbit(found, float(periodicity_error), nodes, 1)

    def _seeds(self):
        """Beginnings ``(tries, n)`` of the cycles of a march that close best."""
        if self.states is None:
            self.march()
        most = int(np.clip(self.work / work_of_cycle(self.train, self.plan.time_steps), 1, CYCLES))
        # Of a march that does not settle, the cycles that nearly close pass near a periodic motion, stable or not.
        best = np.argsort(self.periodicity_errors)[:most]
        return self.states[best[np.isfinite(self.periodicity_errors[best])]]

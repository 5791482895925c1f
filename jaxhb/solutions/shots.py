"""Closed orbits by shooting, as starts of Newton's method on the harmonics where it
leads nowhere on the map of sweeps.

Where teeth hammer so hard that a disturbance grows a thousand times in a cycle,
Newton's method on the map goes astray from a cycle that nearly closes. Newton's method
on the state at the beginning of the cycle, then on the states of all its segments,
arrives from one or another of the cycles that a march went through, or of states at
random. Motions found here are those of the time steps; the harmonics correct them.
"""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array
from jaxhb._program import Program
from jaxhb.balance.plan import Plan
from jaxhb.balance.problem import (
    ActiveMeshes,
    Problem,
    model_of,
    problem_at,
    reduced_equation,
)
from jaxhb.equations import fourier
from jaxhb.equations.reduced_model import states_of
from jaxhb.integration import shooting
from jaxhb.integration.step import (
    Stepper,
    cycle_error,
    force_on_flank,
    rows_of,
    stepper_of,
    with_rate,
)
from jaxhb.train.drivetrain import DriveTrain

CYCLES = 64  # marched; those that close best are shot from
WORK = 6e7  # of the cycles shot from, in units of ``work_of_cycle``
# Of one shooting, in one piece and then in segments: of those that succeed in one piece
# within 40, nine out of ten take no more than 12.
NEWTON_STEPS = 15
# Periodicity error that counts as none, far below what the steps themselves leave
PERIODIC = 1e-6
CLOSED = 1e-8  # the same of the segments of a cycle, aimed at
# Difference of the deflections, as a share of the largest, below which two orbits are
# one, found twice
SAME = 1e-4
# Steps of a cycle at most. Arrays have room for them: programs are not compiled for
# each number.
CAPACITY = 32768
# Share of the compliance of a mesh below which modes too fast for the steps are left
# out
FLEXIBLE = 1e-6


@Program
def _equations(
    problem: Problem, active_meshes: ActiveMeshes, time_steps: int
) -> tuple[Stepper, Array, Array | None]:
    """A Stepper without samples of its linear response, the coefficients ``(2G, N+1)``
    of that response, and those of the variation of the meshes.
    """
    harmonics = problem.load.shape[-1] - 1
    reduced, _ = reduced_equation(problem, harmonics, active_meshes)
    model = model_of(problem, active_meshes, time_steps)
    response = with_rate(reduced.linear, reduced.frequency)
    empty = jnp.zeros((0, len(response)))
    linear_state = jnp.zeros(len(model.at_rest))
    flank_state = model.at_rest @ force_on_flank(reduced.law, reduced.linear)
    stepper = stepper_of(
        model.space,
        reduced,
        empty,
        None,
        reduced.frequency,
        time_steps,
        linear_state,
        flank_state,
        model.residual_flexibility,
    )
    return stepper, response, reduced.variation


def work_of_cycle(train: DriveTrain, time_steps: int) -> int:
    """Cost of the Jacobian of a cycle: time steps times (states^2 + 15^2)."""
    return time_steps * (states_of(train.topology.n_disks) ** 2 + 15**2)


def reduced_stepper(train: DriveTrain, rpm: float, plan: Plan) -> Stepper:
    """The Stepper of a train with the meshes and time steps of a Plan."""
    problem = problem_at(train, rpm, plan.shape.excited)
    stepper, response, variation = _equations(
        problem, plan.active_meshes, plan.time_steps
    )

    # Room for the most steps, the number in use traced: one program for all numbers of
    # steps that follow the modes of the teeth, and one for all that do not: the static
    # response of the rest doubles the time of a step.
    def padded(coefficients: Array) -> np.ndarray:
        rows = np.zeros((2 * CAPACITY, len(coefficients)))
        rows[: 2 * plan.time_steps] = rows_of(coefficients, plan.time_steps)
        return rows

    stepper = replace(
        stepper,
        linear=padded(response),
        variation=None if variation is None else padded(variation),
        count=np.array(plan.time_steps),
    )
    assert stepper.residual_flexibility is not None  # of the reduced model
    flexible = (
        np.abs(np.diag(stepper.residual_flexibility))
        * np.asarray(stepper.law.stiffness)
        > FLEXIBLE
    )
    return stepper if flexible.any() else replace(stepper, residual_flexibility=None)


@Program
def _visited(stepper: Stepper) -> tuple[Array, Array]:
    """States ``(CYCLES, n)`` at the beginning of cycles from the flanks on, and the
    periodicity errors ``(CYCLES,)`` of these cycles.
    """

    def visit(state: Any, _: None) -> tuple[Any, tuple]:
        after, periodicity_error = cycle_error(stepper, state)
        return after, (state, periodicity_error)

    return lax.scan(visit, stepper.flank_state, None, length=CYCLES)[1]


@Program
def _shot(stepper: Stepper, state: Array) -> tuple[Array, Array]:
    """Deflections ``(G, capacity)`` of the cycle that shooting reaches from a state
    ``(n,)``, and their periodicity error.
    """
    shot = shooting.shoot(stepper, state, most=NEWTON_STEPS, tolerance=PERIODIC)[0]
    _, trace, _ = shooting.close(
        stepper,
        shooting.beginnings(stepper, shot),
        tolerance=CLOSED,
        most=NEWTON_STEPS,
    )
    return trace.deflection, trace.periodicity_error


@dataclass(frozen=True)
class FoundOrbit:
    """An orbit that closes."""

    coefficients: np.ndarray  # (G, n+1) deflections in m
    periodicity_error: float
    tries: int  # states from which shooting began


def _same_orbit(deflection: np.ndarray, other: np.ndarray) -> np.bool_:
    """Whether two orbits have the same deflections ``(G, capacity)``."""
    return np.max(np.abs(deflection - other)) <= SAME * np.max(np.abs(deflection))


def coefficients(deflection: np.ndarray, time_steps: int) -> np.ndarray:
    """Coefficients ``(G, n+1)`` of deflections ``(G, capacity)`` over a cycle, as many
    as the time steps tell apart.
    """
    return np.asarray(
        fourier.analyze(deflection[:, :time_steps], (time_steps - 1) // 2)
    )


def shoot(
    train: DriveTrain,
    rpm: float,
    plan: Plan,
    *,
    work: float = WORK,
    deadline: float = math.inf,
) -> Iterator[FoundOrbit]:
    """Yield a FoundOrbit for each orbit that Newton's method closes with the meshes and
    time steps of a Plan, each once, with as many shots as ``work`` pays; none begins
    after ``deadline`` on the monotonic clock.
    """
    stepper = reduced_stepper(train, rpm, plan)
    most = int(np.clip(work / work_of_cycle(train, plan.time_steps), 1, CYCLES))
    deflections: list[np.ndarray] = []
    for tries, state in enumerate(_states(stepper, most), 1):
        if time.monotonic() > deadline:
            return
        deflection, periodicity_error = jax.tree.map(np.asarray, _shot(stepper, state))
        if periodicity_error <= PERIODIC and not any(
            _same_orbit(deflection, other) for other in deflections
        ):
            deflections.append(deflection)
            yield FoundOrbit(
                coefficients(deflection, plan.time_steps),
                float(periodicity_error),
                tries,
            )


def _states(stepper: Stepper, most: int) -> np.ndarray:
    """States ``(tries, n)`` to shoot from: the beginnings of those cycles of a march
    that close best, ``most`` of them, and as many states at random within twice its
    reach.
    """
    states, periodicity_errors = jax.tree.map(np.asarray, _visited(stepper))
    # Of a march that does not settle, the cycles that nearly close pass near a periodic
    # motion, stable or not.
    best = np.argsort(np.nan_to_num(periodicity_errors, nan=np.inf))[:most]
    states = states[best[np.isfinite(periodicity_errors[best])]]
    size = np.abs(states).max(axis=0, initial=0.0)
    scattered = size * np.random.default_rng(0).uniform(-2, 2, states.shape)
    return np.concatenate([states, scattered])

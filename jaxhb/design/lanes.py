"""The compiled programs of a tuning: designs to problems, problems to readings, readings to one number per design.

A lane is one design at one speed. What depends on the parameters is done for all designs at once and ends in the
numbers of the lanes' problems; what is expensive, a solve per lane, knows no parameters: its program serves any of
them, and a gradient passes it once whatever their number. Each program hands out its pullback, so that a gradient is
taken only where the value turned out to be worth it, and only through the speeds that matter.
"""

import dataclasses
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..harmonic import fourier
from ..periodic.derivative import only_if_finite
from ..periodic.problem import pose
from ..periodic.program import estimate, solve_problem
from ..periodic.solve import respond
from . import objectives
from .quantities import OF_DESIGN, QUANTITIES, frequencies_hz, inertia_added

NEWTON_STEPS = 15


@dataclass(frozen=True)
class Task:
    """What is tuned for what: tuples of Parameter, Objective, Penalty; heavy: disks with inertia."""

    parameters: tuple
    objectives: tuple
    penalties: tuple
    heavy: tuple

    @property
    def of_response(self):
        """The objectives, and the penalties that read a response: J of them."""
        return self.objectives + tuple(p for p in self.penalties if p.quantity not in OF_DESIGN)

    @property
    def asked(self):
        """Quantity, element and order of each reading."""
        return tuple((chosen.quantity, chosen.of, chosen.order) for chosen in self.of_response)


@dataclass(frozen=True)
class Form:
    """How a train and its problem are made of their numbers, and of the integers that no design changes."""

    structure: object
    is_number: tuple

    @classmethod
    def of(cls, tree):
        """The form of a tree, and its integers."""
        leaves, structure = jax.tree.flatten(tree)
        is_number = tuple(jnp.issubdtype(jnp.result_type(leaf), jnp.inexact) for leaf in leaves)
        return cls(structure, is_number), [leaf for leaf, number in zip(leaves, is_number, strict=True) if not number]

    def numbers(self, tree):
        """The leaves that are numbers."""
        return [leaf for leaf, number in zip(jax.tree.leaves(tree), self.is_number, strict=True) if number]

    def build(self, numbers, integers):
        """The tree."""
        numbers, integers = iter(numbers), iter(integers)
        return jax.tree.unflatten(self.structure, [next(numbers if number else integers) for number in self.is_number])


def to_values(z, parameters):
    """Parameters in their own units ``(P,)`` from z ``(P,)``; numpy on the host."""
    xp = jnp if isinstance(z, jax.Array) else np
    share = 1 / (1 + xp.exp(-z))
    low = np.array([p.low for p in parameters])
    high = np.array([p.high for p in parameters])
    log = np.array([p.scale == "log" for p in parameters])
    ratio = np.log(np.where(log, high, 1.0) / np.where(log, low, 1.0))
    return xp.where(log, np.where(log, low, 1.0) * xp.exp(share * ratio), low + share * (high - low))


def _changed(train, z, task):
    values = to_values(z, task.parameters)
    return train.replace({p.name: values[i] for i, p in enumerate(task.parameters)})


@partial(jax.jit, static_argnames=("task", "excited", "form"))
def pose_designs(train, rpm, z, *, task, excited, form):
    """The numbers of train and problem of every lane, leaves ``(A, n, ...)``, and their pullback to z ``(A, P)``.

    ``rpm`` ``(A, n)``.
    """

    def lane(z, speed):
        changed = _changed(train, z, task)
        return form.numbers((changed, pose(changed, speed, excited)))

    return jax.vjp(lambda z: jax.vmap(jax.vmap(lane, (None, 0)))(z, rpm), z)


@partial(jax.jit, static_argnames=("form", "asked", "plan"))
def read_lanes(numbers, integers, rpm, start, choice, *, form, asked, plan):
    """Solve lanes of one plan and read their responses.

    Parameters
    ----------
    numbers : list of arrays ``(c, ...)``; integers : list of arrays
    rpm : array ``(c,)``
    start : Start of leaves ``(c, ...)``
    choice : Choice
    form, asked, plan : static; what ``choice`` says does not count in the plan

    Returns
    -------
    smooth : array ``(c, J)``
    pull : pullback of ``smooth`` to ``numbers``
    status ``(c,)``, deflections of all meshes ``(c, M, N+1)``, readings not smoothed ``(c, J)``
    """

    def lane(numbers, speed, start):
        changed, problem = form.build(only_if_finite(numbers), integers)
        problem = dataclasses.replace(problem, load=fourier.resize(problem.load, plan.harmonics))
        sizes = dataclasses.replace(plan.sizes, max_steps=NEWTON_STEPS, estimated=False)
        return respond(changed, speed, problem, solve_problem(problem, choice, start, 1.0, sizes), plan)

    def every(numbers):
        response = jax.vmap(lane)(numbers, rpm, start)
        smooth = [QUANTITIES[quantity].read(response, of, order) for quantity, of, order in asked]
        exact = [QUANTITIES[quantity].tell(response, of, order) for quantity, of, order in asked]
        aux = jnp.asarray(response.status), response.deflections, jnp.stack(exact, axis=-1)
        return jnp.stack(smooth, axis=-1), lax.stop_gradient(aux)

    return jax.vjp(every, numbers, has_aux=True)


@partial(jax.jit, static_argnames=("form", "plan"))
def estimate_lanes(numbers, integers, motion, choice, *, form, plan):
    """Truncation errors ``(c,)`` of solved lanes, ``motion`` ``(c, G, N+1)`` of the active meshes."""

    def lane(numbers, motion):
        _, problem = form.build(numbers, integers)
        problem = dataclasses.replace(problem, load=fourier.resize(problem.load, plan.harmonics))
        return estimate(problem, choice, motion, plan.sizes)

    return jax.vmap(lane)(numbers, motion)


@jax.jit
def pull_back(pull, cotangent):
    """What a pullback that a program handed out makes of a cotangent."""
    return pull(cotangent)[0]


@partial(jax.jit, static_argnames=("task", "own"))
def combine(train, z, smooth, kept, weights, widths, scales, *, task, own):
    """The objective of every design.

    Parameters
    ----------
    train : DriveTrain, at the start
    z : array ``(A, P)``
    smooth : array ``(A, n, J)``; kept : bool array ``(A, n)``, the speeds that enter
    weights : array ``(A, n, objectives)``
    widths, scales : arrays, of every objective: width of its smooth maximum and unit of its values; the latter in its
        own unit, the former in this one
    task, own : static; the first ``own`` speeds enter means and penalties, all of them the smooth maxima

    Returns
    -------
    value ``(A,)``; readings of the train alone, one ``(A,)`` for each such penalty
    by_z ``(A, P)``, by_smooth ``(A, n, J)`` : derivatives of the value
    """

    def cost(z, smooth, kept, weights):
        changed, total, told = _changed(train, z, task), jnp.zeros(()), []
        values = iter(smooth.T)
        for objective, share, scale, width in zip(task.objectives, weights.T, scales, widths, strict=True):
            weighted = share * next(values) / scale
            if objective.over == "worst":
                total += objective.weight * objectives.smooth_maximum(weighted, kept, width)
            else:
                count = jnp.maximum(kept[:own].sum(), 1)
                total += objective.weight * objectives.masked_sum(weighted[:own], kept[:own]) / count
        for penalty in task.penalties:
            if penalty.quantity in OF_DESIGN:
                reading = _of_design(penalty, changed, train, task.heavy)
                told.append(reading)
                total += penalty.weight * _excess(penalty, reading) ** 2
            else:
                excess = penalty.weight * _excess(penalty, next(values)) ** 2
                total += objectives.masked_sum(excess[:own], kept[:own])
        return total, tuple(told)

    (value, told), slopes = jax.vmap(jax.value_and_grad(cost, (0, 1), has_aux=True))(z, smooth, kept, weights)
    return value, told, *slopes


def _of_design(penalty, train, start, heavy):
    if penalty.quantity == "inertia added":
        return inertia_added(train, start, penalty.of)
    return frequencies_hz(train, np.array(heavy))[penalty.mode]


def _excess(penalty, reading):
    """What lies beyond the limits, in shares of them."""
    total = jnp.zeros_like(reading)
    if penalty.most is not None:
        total += jnp.maximum(reading - penalty.most, 0.0) / abs(penalty.most)
    if penalty.least is not None:
        total += jnp.maximum(penalty.least - reading, 0.0) / abs(penalty.least)
    return total

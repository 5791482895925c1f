"""The compiled programs of a tuning: designs to problems, problems to readings, readings to one number per design.

A lane is one design at one speed. What depends on the parameters is done for all designs at once and ends in the
numbers of the lanes' problems; what is expensive, a solve per lane, knows no parameters: its program serves any of
them, and a gradient passes it once whatever their number. Solving and differentiating are two programs: a gradient is
taken only where the value turned out to be worth it, and only through the speeds that matter.
"""

import dataclasses
import math
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._program import Program
from jaxhb.balance.derivative import all_finite, only_if
from jaxhb.balance.planned import respond
from jaxhb.balance.problem import problem_at
from jaxhb.balance.program import differentiable, estimate, find
from jaxhb.design import objectives
from jaxhb.design.quantities import OF_DESIGN, QUANTITIES, inertia_added
from jaxhb.linear.sensitivity import frequencies_hz


@dataclass(frozen=True)
class EvaluationOptions:
    """How designs are evaluated.

    Parameters
    ----------
    newton_steps : of a lane at most
    settled : periodicity error at which a march ends; what its steps leave of the equations is as much
    alone : harmonics from which a processor solves lanes one by one: in a batch each waits for the slowest
    negligible : share of the largest derivative of the objective by a reading below which no gradient is taken through
        it
    ladder : lost speeds of an evaluation that are taken up the ladder of :func:`jaxhb.solve`; with more of them the
        step went too far
    seconds : after which a lost speed gets no further attempt
    farthest : |z| of a start on a bound: a thousandth of the range inside it, where the share still has a slope
    """

    newton_steps: int = 15
    settled: float = 1e-4
    alone: int = 48
    negligible: float = 1e-8
    ladder: int = 3
    seconds: float = 30.0
    farthest: float = 6.9


EVALUATION = EvaluationOptions()


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
class VectorForm:
    """How a train and its problem are made of a vector of their numbers and of what no design or speed changes.

    leaves : shape and kind of each leaf, "f" real, "c" complex, "h" held. Tables of pressures would fill the vectors.
    """

    structure: object
    leaves: tuple

    @classmethod
    def of(cls, tree, held):
        """The form of a tree and the leaves, on the device, that are ``held`` (bool of each leaf) or integers."""
        leaves, structure = jax.tree.flatten(tree)
        kinds = [jnp.result_type(leaf).kind for leaf in leaves]
        kinds = [kind if kind in "fc" and not keep else "h" for kind, keep in zip(kinds, held, strict=True)]
        form = cls(structure, tuple((np.shape(leaf), kind) for leaf, kind in zip(leaves, kinds, strict=True)))
        return form, [jnp.asarray(leaf) for leaf, kind in zip(leaves, kinds, strict=True) if kind == "h"]

    def numbers(self, tree):
        """The leaves that change as one real vector ``(K,)``."""
        flat = []
        for leaf, (_, kind) in zip(jax.tree.leaves(tree), self.leaves, strict=True):
            flat += {"f": (leaf,), "c": (leaf.real, leaf.imag), "h": ()}[kind]
        return jnp.concatenate([jnp.ravel(leaf) for leaf in flat])

    def build(self, numbers, held):
        """The tree."""
        at, held, leaves = 0, iter(held), []

        def take(shape):
            nonlocal at
            at += math.prod(shape)
            return numbers[at - math.prod(shape) : at].reshape(shape)

        for shape, kind in self.leaves:
            number = next(held) if kind == "h" else take(shape)
            leaves.append(number + 1j * take(shape) if kind == "c" else number)
        return jax.tree.unflatten(self.structure, leaves)


def to_values(z, parameters):
    """Parameters in their own units ``(P,)`` from z ``(P,)``; numpy on the host."""
    xp = jnp if isinstance(z, jax.Array) else np
    share = 1 / (1 + xp.exp(-z))
    low = np.array([p.low for p in parameters])
    high = np.array([p.high for p in parameters])
    log = np.array([p.scale == "log" for p in parameters])
    # On a log scale the share of the way is that of the logarithm.
    ratio = np.log(np.where(log, high, 1.0) / np.where(log, low, 1.0))
    return xp.where(log, np.where(log, low, 1.0) * xp.exp(share * ratio), low + share * (high - low))


def _changed(train, z, task):
    values = to_values(z, task.parameters)
    return train.replace({p.name: values[i] for i, p in enumerate(task.parameters)})


@partial(Program, static_argnames=("task", "excited", "form"))
def problems_of_designs(train, rpm, z, *, task, excited, form):
    """The numbers of train and problem of every lane ``(A, n, K)``, and their pullback to z ``(A, P)``.

    ``rpm`` ``(A, n)``.
    """

    def lane(z, speed):
        changed = _changed(train, z, task)
        return form.numbers((changed, problem_at(changed, speed, excited)))

    return jax.vjp(lambda z: jax.vmap(jax.vmap(lane, (None, 0)))(z, rpm), z)


@partial(Program, static_argnames=("form", "asked", "sizes"))
def read_lanes(numbers, held, rpm, start, active_meshes, *, form, asked, sizes):
    """Solve lanes of one plan and read their responses.

    Parameters
    ----------
    numbers : array ``(c, K)``; held : list of arrays, from :meth:`VectorForm.of`
    rpm : array ``(c,)``
    start : Start of leaves ``(c, ...)``
    active_meshes : ActiveMeshes
    form, asked, sizes : static

    Returns
    -------
    smooth : array ``(c, J)``
    found : the solutions, for :func:`pull_lanes`
    status ``(c,)``, periodicity error of the march or 0 ``(c,)``, deflections of all meshes ``(c, M, N+1)``, readings
    not smoothed ``(c, J)``
    """

    def lane(numbers, speed, start):
        train, problem = form.build(numbers, held)
        found = find(problem, active_meshes, start, 1.0, sizes)
        response = respond(train, speed, problem, found[0], sizes)
        exact = [QUANTITIES[quantity].exact_value(response, of, order) for quantity, of, order in asked]
        outcome = jnp.asarray(response.status), found[0].periodicity_error, response.deflections, jnp.stack(exact)
        return _smooth(response, asked), found, outcome

    return _each(lane, numbers, rpm, start)


@partial(Program, static_argnames=("form", "asked", "sizes"))
def pull_lanes(numbers, held, rpm, found, active_meshes, cotangent, *, form, asked, sizes):
    """What a derivative by the readings ``(c, J)`` of solved lanes is by their numbers ``(c, K)``.

    Arguments as in :func:`read_lanes`, ``found`` from there.
    """

    def lane(numbers, speed, found, cotangent):
        def read(numbers):
            train, problem = form.build(only_if(all_finite(numbers), numbers), held)
            outcome = differentiable(problem, active_meshes, found, sizes)
            return _smooth(respond(train, speed, problem, outcome, sizes), asked)

        return jax.vjp(read, numbers)[1](cotangent)[0]

    return _each(lane, numbers, rpm, found, cotangent)


def lane_sizes(plan):
    """What the programs of the lanes of a plan are compiled for; whether it has enough harmonics is asked by itself."""
    return dataclasses.replace(
        plan.sizes, max_steps=EVALUATION.newton_steps, estimated=False, marches=True, compare_starts=True
    )


def _smooth(response, asked):
    return jnp.stack([QUANTITIES[quantity].read(response, of, order) for quantity, of, order in asked])


def _each(lane, *batch):
    """``lane`` of every lane; of a single one without ``vmap``, under which a condition runs both its branches."""
    if len(jax.tree.leaves(batch)[0]) > 1:
        return jax.vmap(lane)(*batch)
    return jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], lane(*jax.tree.map(lambda leaf: leaf[0], batch)))


@partial(Program, static_argnames=("form", "sizes"))
def estimate_lanes(numbers, held, motion, active_meshes, *, form, sizes):
    """Truncation errors ``(c,)`` of solved lanes, ``motion`` ``(c, G, N+1)`` of the active meshes."""

    def lane(numbers, motion):
        return estimate(form.build(numbers, held)[1], active_meshes, motion, sizes)

    return _each(lane, numbers, motion)


@Program
def pull_back(pull, cotangent):
    """What a pullback that a program handed out makes of a cotangent."""
    return pull(cotangent)[0]


@partial(Program, static_argnames=("task", "own"))
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
        changed, total, readings = _changed(train, z, task), jnp.zeros(()), []
        # Readings of the objectives come first, then those of the penalties that read a response, as in
        # ``Task.of_response``.
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
                readings.append(reading)
                total += penalty.weight * _excess(penalty, reading) ** 2
            else:
                excess = penalty.weight * _excess(penalty, next(values)) ** 2
                total += objectives.masked_sum(excess[:own], kept[:own])
        return total, tuple(readings)

    (value, readings), slopes = jax.vmap(jax.value_and_grad(cost, (0, 1), has_aux=True))(z, smooth, kept, weights)
    return value, readings, *slopes


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

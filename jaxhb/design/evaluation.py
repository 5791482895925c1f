"""The objective of a tuning and its gradient: all starts and all speeds in one compiled call.

On the device the parameters are unbounded numbers z: a parameter lies the share ``1 / (1 + exp(-z))`` of the way from
its lower to its upper bound, on its scale.
"""

import dataclasses
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from ..periodic import harmonics as decide
from ..periodic import march
from ..periodic.derivative import only_if_finite
from ..periodic.newton import Status
from ..periodic.problem import pose
from ..periodic.program import Start, solve_problem
from ..periodic.solve import respond, solve
from ..periodic.speeds import plan_speeds
from . import objectives
from .quantities import OF_DESIGN, QUANTITIES, frequencies_hz, inertia_added

NEWTON_STEPS = 15
LONGER = (12, 60)
"""Cycles marched where the usual few are no start."""

FARTHEST = 6.9
"""|z| of a start on a bound: a thousandth of the range inside it, where the share still has a slope."""


@dataclass(frozen=True)
class Task:
    """What is tuned for what: tuples of Parameter, Objective, Penalty; heavy: disks with inertia."""

    parameters: tuple
    objectives: tuple
    penalties: tuple
    heavy: tuple


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Point:
    """Designs and how they do: A starts, n speeds, P parameters, G meshes, N harmonics.

    z : ``(A, P)``; value : ``(A,)``; gradient : ``(A, P)``, with respect to z
    status, truncation : ``(A, n)``; motion : complex ``(A, n, G, N+1)`` m, deflections of the active meshes
    readings : of each objective and then each penalty, not smoothed, ``(A, n)``; those of the train alone ``(A,)``
    """

    z: jax.Array
    value: jax.Array
    gradient: jax.Array
    status: jax.Array
    truncation: jax.Array
    motion: jax.Array
    readings: tuple

    @property
    def solved(self):
        """Whether the equations are solved ``(A, n)``."""
        return self.status <= Status.TOLERANCE_NOT_MET

    def where(self, chosen, other):
        """The designs of this point where ``chosen`` ``(A,)``, else of the other."""
        chosen = np.asarray(chosen)

        def pick(here, there):
            return np.where(chosen.reshape(-1, *[1] * (np.ndim(here) - 1)), here, there)

        return jax.tree.map(pick, self, other)


def to_values(z, parameters):
    """Parameters in their own units ``(P,)`` from z ``(P,)``; numpy on the host."""
    xp = jnp if isinstance(z, jax.Array) else np
    share = 1 / (1 + xp.exp(-z))
    low = np.array([p.low for p in parameters])
    high = np.array([p.high for p in parameters])
    log = np.array([p.scale == "log" for p in parameters])
    ratio = np.log(np.where(log, high, 1.0) / np.where(log, low, 1.0))
    return xp.where(log, np.where(log, low, 1.0) * xp.exp(share * ratio), low + share * (high - low))


def to_unbounded(values, parameters):
    """z ``(P,)`` of values between their bounds, those on a bound a little inside."""
    shares = [
        np.log(v / p.low) / np.log(p.high / p.low) if p.scale == "log" else (v - p.low) / (p.high - p.low)
        for v, p in zip(values, parameters, strict=True)
    ]
    with np.errstate(divide="ignore"):
        z = np.log(shares) - np.log1p(-np.array(shares))
    return np.clip(z, -FARTHEST, FARTHEST)


def first_plan(train, rpm, tolerance, harmonics):
    """One plan for all speeds, as fine as the finest that one of them needs.

    Every mesh with backlash is an unknown at every speed: a changed design may take it off its flank.
    """
    plans = plan_speeds(train, rpm, harmonics, tolerance)
    gaps = tuple(i for i, gap in enumerate(train.topology.mesh_backlash) if gap)
    finest = max((plan for plan in plans if plan.active), key=lambda plan: plan.harmonics, default=plans[0])
    if not gaps:
        return finest
    excited = decide.excited_harmonic(train, "reduced")
    modes = decide.mesh_mode_harmonic(train, train.topology.cycle_frequency(float(np.max(rpm))))
    least = march.instants_for(max(modes, 2 * excited))
    return dataclasses.replace(
        finest,
        harmonics=harmonics or max(finest.harmonics, decide.first_level(excited, 0.0)),
        active=gaps,
        flank=(0,) * len(train.topology.mesh_backlash),
        start="march",
        instants=max(finest.instants, least) if finest.active else least,
    )


@partial(jax.jit, static_argnames=("task", "plan"))
def assess(train, rpm, z, start, counted, widths, scales, *, task, plan):
    """The :class:`Point` of designs z.

    Parameters
    ----------
    train : DriveTrain, at the start
    rpm : array ``(n,)``
    z : array ``(A, P)``
    start : Start of leaves ``(A, n, ...)``
    counted : bool array ``(A, n)``, speeds that enter the objective if they are solved
    widths, scales : arrays, of every objective: width of its smooth maximum and unit of its values; the latter in its
        own unit, the former in this one
    task, plan : static
    """

    def one(z, start, counted):
        both = jax.value_and_grad(cost, has_aux=True)
        (value, aux), gradient = both(z, train, rpm, start, counted, widths, scales, task, plan)
        return Point(z, value, gradient, *aux)

    return jax.vmap(one)(z, start, counted)


def cost(z, train, rpm, start, counted, widths, scales, task, plan):
    """The objective of one design z ``(P,)``, and (status, truncation error, motion, readings); see :func:`assess`."""
    values = to_values(z, task.parameters)
    changed = train.replace({p.name: values[i] for i, p in enumerate(task.parameters)})
    response, motion = jax.vmap(lambda speed, start: _solve(changed, speed, start, plan))(rpm, start)
    everywhere = jnp.asarray(response.status)
    masked = dataclasses.replace(response, status=jnp.where(counted, everywhere, Status.MAX_STEPS))
    total, readings = jnp.zeros(()), []
    for objective, scale, width in zip(task.objectives, scales, widths, strict=True):
        quantity = QUANTITIES[objective.quantity]
        reading = quantity.read(response, objective.of, objective.order)
        readings.append(quantity.tell(response, objective.of, objective.order))
        total += objective.weight * over_speeds(objective, reading / scale, masked, width)
    for penalty in task.penalties:
        reading = _limited(penalty, changed, train, response, task.heavy)
        readings.append(reading if penalty.quantity in OF_DESIGN else _told(penalty, response))
        excess = penalty.weight * _excess(penalty, reading) ** 2
        total += objectives.weighted_sum(excess, masked)[0] if jnp.ndim(reading) else excess
    aux = everywhere, response.truncation_error, motion, tuple(readings)
    return total, jax.lax.stop_gradient(aux)


def _solve(train, rpm, start, plan):
    """Response at one speed and the deflections ``(G, N+1)`` of its active meshes."""
    train, rpm = only_if_finite((train, rpm))
    problem = pose(train, rpm, plan.harmonics, plan.excited)
    sizes = dataclasses.replace(plan.sizes, max_steps=NEWTON_STEPS)
    outcome = solve_problem(problem, plan.choice, start, plan.limit, sizes)
    response, choice = respond(train, rpm, problem, outcome, plan), plan.choice
    return response, response.deflections[choice.chosen] * choice.active[:, None]


def over_speeds(objective, values, response, width):
    """One number of values ``(n,)``: their smooth maximum or their mean over the valid speeds."""
    weights = jnp.array(objective.weights or (1.0,) * values.shape[0])
    if objective.over == "worst":
        return objectives.worst(weights * values, response, width=width)[0]
    total, count = objectives.weighted_sum(values, response, weights=weights)
    return total / jnp.maximum(count, 1)


def _limited(penalty, train, start, response, heavy):
    if penalty.quantity == "inertia added":
        return inertia_added(train, start, penalty.of)
    if penalty.quantity == "natural frequency":
        return frequencies_hz(train, np.array(heavy))[penalty.mode]
    return QUANTITIES[penalty.quantity].read(response, penalty.of, penalty.order)


def _told(penalty, response):
    return QUANTITIES[penalty.quantity].tell(response, penalty.of, penalty.order)


def _excess(penalty, reading):
    """What lies beyond the limits, in shares of them."""
    total = jnp.zeros_like(reading)
    if penalty.most is not None:
        total += jnp.maximum(reading - penalty.most, 0.0) / abs(penalty.most)
    if penalty.least is not None:
        total += jnp.maximum(penalty.least - reading, 0.0) / abs(penalty.least)
    return total


@dataclass(frozen=True)
class Reading:
    """What a design does: parameters by name, whether each speed is solved ``(n,)``, readings by label.

    A reading is an array ``(n,)`` in SI units, nan where the speed is not solved, or a float for those of the train
    alone; its label is ``"tooth force of crank gear|idler"``.
    """

    parameters: dict
    solved: np.ndarray
    readings: dict


class Bench:
    """Evaluates designs on the host: holds plan, units and widths of the objectives, counts the calls."""

    def __init__(self, train, rpm, task, plan, *, fixed):
        self.train, self.rpm, self.task, self.plan, self.fixed = train, rpm, task, plan, fixed
        self.scales = np.ones(len(task.objectives))
        self.widths = 0.1 * self.scales
        self.calls = 0

    def first(self, z):
        """The Point of designs without motions: marched, longer where that fails; the first one up the whole ladder."""
        active = len(self.plan.choice.active)
        motion = np.zeros((len(z), len(self.rpm), active, self.plan.harmonics + 1), dtype=complex)
        everywhere = np.ones(motion.shape[:2], dtype=bool)
        point = self._call(z, motion, ~everywhere, everywhere, decide.MARCH_CYCLES if active else 0)
        return self._climbed(self._again(point, everywhere, LONGER))

    def at(self, z, near, counted, *, rungs=LONGER[:1]):
        """The Point of designs near those of the Point ``near``; speeds that are lost are marched."""
        point = self._call(z, near.motion, near.solved, counted, decide.MARCH_CYCLES)
        return self._again(point, counted, rungs)

    def _again(self, point, counted, rungs):
        for cycles in rungs if len(self.plan.choice.active) else ():
            lost = counted & ~point.solved
            if not lost.any():
                break
            point = self._call(point.z, point.motion, ~lost, counted, cycles)
        return point

    def _climbed(self, point):
        """The first design's lost speeds solved one by one, up the ladder of :func:`jaxhb.solve`."""
        choice, motion, train = self.plan.choice, point.motion.copy(), None
        solved = point.solved
        for i in np.flatnonzero(~solved[0]) if len(choice.active) else ():
            train = train or self.train.replace(self.values(point.z[0]))
            response = solve(train, rpm=float(self.rpm[i]), harmonics=self.plan.harmonics)
            if response.status <= Status.TOLERANCE_NOT_MET:
                motion[0, i] = response.deflections[choice.chosen] * choice.active[:, None]
                solved[0, i] = True
        if (solved == point.solved).all():
            return point
        return self._call(point.z, motion, solved, np.ones_like(solved), decide.MARCH_CYCLES)

    def _call(self, z, motion, given, counted, cycles):
        start = Start(motion, given, np.where(given, 0, cycles))
        self.calls += 1
        point = assess(
            self.train,
            self.rpm,
            z,
            start,
            counted,
            self.widths,
            self.scales,
            task=self.task,
            plan=self.plan,
        )
        return jax.tree.map(np.asarray, point)

    def finer_plan(self, point, counted):
        """Whether solved speeds need more harmonics than the plan has; the plan then gets them."""
        short = point.status == Status.TOLERANCE_NOT_MET
        higher = decide.next_level(self.plan.harmonics, self.plan.method)
        if self.fixed or higher is None or not (short & counted).any():
            return False
        self.plan = dataclasses.replace(self.plan, harmonics=higher, trust=1.0)
        return True

    def reading(self, point, best):
        """The :class:`Reading` of one design."""
        solved, readings = point.solved[best], {}
        for chosen, values in zip((*self.task.objectives, *self.task.penalties), point.readings, strict=True):
            at = values[best]
            readings[label(chosen)] = float(at) if chosen.quantity in OF_DESIGN else np.where(solved, at, np.nan)
        return Reading(self.values(point.z[best]), solved, readings)

    def values(self, z):
        """Parameters by name."""
        values = to_values(z, self.task.parameters)
        return {p.name: float(v) for p, v in zip(self.task.parameters, values, strict=True)}


def label(chosen):
    """What an Objective or Penalty reads: ``"tooth force of crank gear|idler"``."""
    order = f" {chosen.order:g}" if chosen.order is not None else ""
    mode = f" {chosen.mode}" if getattr(chosen, "mode", None) is not None else ""
    return f"{chosen.quantity}{order}{mode}" + (f" of {chosen.of}" if chosen.of else "")

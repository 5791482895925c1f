"""The objective of a tuning and its gradient: all starts and all speeds, in batches of lanes that share a plan.

On the device the parameters are unbounded numbers z: a parameter lies the share ``1 / (1 + exp(-z))`` of the way from
its lower to its upper bound, on its scale. At most speeds of a drive train no tooth separates, and one linear solve is
all; it is verified, and where a changed design shakes a tooth off the speed is solved like those that hammer.
"""

import dataclasses
from dataclasses import dataclass

import jax
import numpy as np

from jaxhb._shown import brief
from jaxhb.balance.problem import problem_at
from jaxhb.balance.request import Request
from jaxhb.design.evaluation import Evaluation, Point, batches, of_active_meshes
from jaxhb.design.lanes import EVALUATION, VectorForm, estimate_lanes, problems_of_designs, to_values
from jaxhb.design.quantities import OF_DESIGN
from jaxhb.excitation.torques import listed_harmonic
from jaxhb.results.status import Status
from jaxhb.solutions.planning import next_level, plan_marching, plan_speeds


def to_unbounded(values, parameters):
    """z ``(P,)`` of values between their bounds, those on a bound a little inside."""
    shares = [
        np.log(v / p.low) / np.log(p.high / p.low) if p.scale == "log" else (v - p.low) / (p.high - p.low)
        for v, p in zip(values, parameters, strict=True)
    ]
    with np.errstate(divide="ignore"):
        z = np.log(shares) - np.log1p(-np.array(shares))
    return np.clip(z, -EVALUATION.farthest, EVALUATION.farthest)


def plan_designs(train, rpm, tolerance, harmonics, integrals="sampled"):
    """A plan for every speed, and the plan of those that leave theirs.

    Returns
    -------
    fallback : Plan
        Every mesh with backlash is an unknown, as fine as the finest plan that a speed needs.
    plans : list of Plan, one for each speed
    """
    request = Request.of(train, harmonics, tolerance, integrals=integrals)
    plans = plan_speeds(train, rpm, request)
    plans = [plan if harmonics else _with_room(plan) for plan in plans]
    finest = max((plan for plan in plans if plan.active), key=lambda plan: plan.harmonics, default=plans[0])
    if not any(train.topology.mesh_backlash):
        return finest, plans
    return plan_marching(train, rpm, finest, request), plans


def _with_room(plan):
    """The next level where teeth leave contact without separating: cheaper than programs for two levels."""
    higher = next_level(plan.harmonics, plan.method) if plan.active and not plan.marches else None
    return dataclasses.replace(plan, harmonics=higher) if higher else plan


@brief
@dataclass(frozen=True)
class Reading:
    """What a design does: parameters by name, whether each speed is solved ``(n,)``, readings by label.

    A reading is an array ``(n,)`` in SI units, nan where the speed is not solved, or a float for those of the train
    alone; its label is ``"tooth force of crank gear|idler"``.
    """

    parameters: dict
    solved: np.ndarray
    readings: dict


class Evaluator:
    """Evaluates designs on the host: holds plans, units and widths of the objectives, counts the calls.

    Attributes
    ----------
    plans : list of Plan, the largest first; scales, widths : of the objectives; calls : evaluations so far
    speeds : ``(A, n)`` rpm, those asked for and behind them those that follow peaks
    """

    def __init__(self, train, rpm, task, planner, *, fixed, peaks=0, on_start=None):
        """``planner``: (train, rpm) -> what :func:`plan_designs` returns; ``fixed``: harmonics stay as it says;
        ``peaks``: speeds added for every objective that is a maximum, to follow its highest peaks; ``on_start``: called
        with the Reading of the train as it is while it is solved first.
        """
        self.on_start = on_start
        self.train, self.rpm, self.task, self.planner, self.fixed = train, rpm, task, planner, fixed
        self.followed = [j for j, objective in enumerate(task.objectives) if objective.over == "worst"]
        self.peaks, self.speeds = peaks, rpm[None]
        fallback, plans = planner(train, rpm)
        self.plans = [fallback]
        self.scales = np.ones(len(task.objectives))
        self.widths = 0.1 * self.scales
        self.calls = 0
        excited = listed_harmonic(train.topology)
        self.excited = excited or max(plan.harmonics for plan in (fallback, *plans))
        moved = train.replace({p.name: train.value(p.name) for p in task.parameters})
        problem = problem_at(train, float(rpm[0]), self.excited)
        # What no parameter changes is handed to programs once; the rest travels as one vector for each lane.
        same = [old is new for old, new in zip(jax.tree.leaves(train), jax.tree.leaves(moved), strict=True)]
        same += [False] * len(jax.tree.leaves(problem))
        self.form, self.held = VectorForm.of((train, problem), same)

    def first(self, z):
        """The Point of designs without motions, lost speeds up the ladder."""
        meshes, added = len(self.train.topology.mesh_names), self.peaks * len(self.followed)
        spread = np.linspace(0, len(self.rpm) - 1, added).round().astype(int)
        self.speeds = np.tile(np.concatenate([self.rpm, self.rpm[spread]]), (len(z), 1))
        motion = np.zeros((*self.speeds.shape, meshes, 1), dtype=complex)
        numbers = self._planned(z)
        near = Point(z, None, None, np.full(numbers.shape, Status.MAX_STEPS), numbers, motion, None)
        point = self.at(z, near, np.ones(numbers.shape, dtype=bool), ladder=self.speeds.shape[1])
        self.on_start = None
        return point

    def report(self, evaluation):
        """Report what an evaluation has found of the first design so far, while that is the train as it is."""
        if self.on_start:
            solved = evaluation.status[0, : len(self.rpm)] <= Status.TOLERANCE_NOT_MET
            chosen = [c for c in (*self.task.objectives, *self.task.penalties) if c.quantity not in OF_DESIGN]
            values = np.where(solved, np.moveaxis(evaluation.exact[0, : len(self.rpm)], -1, 0), np.nan)
            readings = dict(zip(map(label, chosen), values, strict=True))
            self.on_start(Reading(self.values(evaluation.z[0]), solved, readings))

    def replanned(self, point):
        """The same designs, their speeds planned anew."""
        return dataclasses.replace(point, plan_number=self._planned(point.z))

    def follow_peaks(self, point):
        """Move the added speeds to the highest peaks of the curves through all: the Point to start there from."""
        self.speeds, into = self.speeds.copy(), len(self.rpm)
        near = np.tile(np.arange(self.speeds.shape[1]), (len(point.z), 1))
        for j in self.followed if self.peaks else ():
            values = self.weights()[..., j] * point.readings[j]
            for a, good in enumerate(point.solved):
                places, speeds = highest_peaks(self.speeds[a][good], values[a][good], self.peaks)
                near[a, into : into + len(places)] = np.flatnonzero(good)[places]
                self.speeds[a, into : into + len(places)] = speeds
            into += self.peaks
        rows = np.arange(len(near))[:, None]
        return dataclasses.replace(point, status=point.status[rows, near], motion=point.motion[rows, near])

    def weights(self):
        """Factors of the objectives at all speeds ``(A, n, objectives)``, interpolated at the added ones."""
        order, columns = np.argsort(self.rpm, kind="stable"), []
        for objective in self.task.objectives:
            given = np.array(objective.weights or np.ones(len(self.rpm)))
            columns.append(np.interp(self.speeds, self.rpm[order], given[order]))
            columns[-1][:, : len(self.rpm)] = given
        return np.stack(columns, axis=-1)

    def _planned(self, z):
        """Numbers of the plans ``(A, n)``: those of the present harmonics where they do the same."""
        trains = [self.train.replace(self.values(one)) for one in z]
        # A changed design may shake off a tooth: every design is planned by its own numbers, under the plans at hand as
        # far as they do the same.
        plans = [self.planner(train, rpm)[1] for train, rpm in zip(trains, self.speeds, strict=True)]
        return np.array([[self._plan_number(plan) for plan in row] for row in plans])

    def _plan_number(self, plan):
        """The number of a plan, a new one where none yet holds the same meshes."""
        for number, known in enumerate(self.plans):
            if (known.active, known.flank) == (plan.active, plan.flank):
                return number
        self.plans.append(plan)
        return len(self.plans) - 1

    def at(self, z, near, counted, *, wanted=True, most=np.inf, ladder=EVALUATION.ladder):
        """The Point of designs near those of the Point ``near``.

        Parameters
        ----------
        z : array ``(A, P)``
        near : Point
        counted : bool array ``(A, n)``, speeds that enter the objective if they are solved
        wanted : bool array ``(A,)``, designs to be solved; the others are those of ``near`` without value
        most : array ``(A,)``, values above which no gradient is asked for
        ladder : int, lost speeds of a design that are taken up the ladder
        """
        self.calls += 1
        evaluation = Evaluation(self, z, near, counted, np.broadcast_to(wanted, len(z)))
        evaluation.solve(np.broadcast_to(evaluation.wanted[:, None], counted.shape), near.solved)
        # What was lost from a march is tried from the motion of the design nearby, and the other way round.
        again = evaluation.lost() & near.solved & (evaluation.status != Status.PLAN_VIOLATED)
        evaluation.solve(again & ~evaluation.resumed, True, other=False)
        evaluation.solve(again & evaluation.resumed, False)
        violated = evaluation.lost() & (evaluation.status == Status.PLAN_VIOLATED)
        evaluation.plan_number[violated] = 0
        evaluation.solve(violated, False)
        lost = evaluation.lost()
        evaluation.climb(lost & (lost.sum(1, keepdims=True) <= ladder))
        return evaluation.point(most)

    def finer_plans(self, point, counted):
        """Whether solved speeds need more harmonics than their plans have; the plans then get them."""
        short = set() if self.fixed else self._short(point, counted & point.solved)
        for number in short:
            plan = self.plans[number]
            higher = next_level(plan.harmonics, plan.method)
            self.plans[number] = dataclasses.replace(plan, harmonics=higher, tolerance_share=1.0)
        return bool(short)

    def _short(self, point, counted):
        """Numbers of the plans that have too few harmonics and may have more."""
        short, numbers = set(), None
        for number, plan in enumerate(self.plans):
            higher = next_level(plan.harmonics, plan.method)
            lanes = np.argwhere(counted & (point.plan_number == number)) if plan.active and higher else ()
            for chunk, padded in batches(lanes, plan):
                numbers = self.numbers_of(point.z)[0] if numbers is None else numbers
                motion = of_active_meshes(point.motion[tuple(padded.T)], plan)
                own = numbers[tuple(padded.T)]
                errors = estimate_lanes(own, self.held, motion, plan.active_meshes, form=self.form, sizes=plan.sizes)
                if (np.asarray(errors)[: len(chunk)] > plan.limit).any():
                    short.add(number)
                    break
        return short

    def numbers_of(self, z):
        """Numbers of all lanes ``(A, n, ...)`` of designs z, and the pullback to z."""
        numbers, pull = problems_of_designs(
            self.train, self.speeds, z, task=self.task, excited=self.excited, form=self.form
        )
        return np.asarray(numbers), pull

    def reading(self, point, best):
        """The :class:`Reading` of one design."""
        solved, readings = point.solved[best, : len(self.rpm)], {}
        for chosen, values in zip((*self.task.objectives, *self.task.penalties), point.readings, strict=True):
            at = values[best]
            alone = chosen.quantity in OF_DESIGN
            readings[label(chosen)] = float(at) if alone else np.where(solved, at[: len(solved)], np.nan)
        return Reading(self.values(point.z[best]), solved, readings)

    def values(self, z):
        """Parameters by name."""
        values = to_values(z, self.task.parameters)
        return {p.name: float(v) for p, v in zip(self.task.parameters, values, strict=True)}

    def described(self, point, best):
        """The plans of one design, for people."""
        numbers, counts = np.unique(point.plan_number[best], return_counts=True)
        return "; ".join(f"{n} speeds: {self.plans[k]}" for k, n in zip(numbers, counts, strict=True))


def highest_peaks(speeds, values, most):
    """The highest local maxima of a curve: their places in ``speeds``, and where the parabolas through them culminate.

    At most ``most``; a speed given twice counts once, and ends of the curve are no peaks. Nor are those narrower than
    the spacing of the speeds: one speed in such a peak would only be fled from.
    """
    _, places = np.unique(speeds, return_index=True)
    x, y = speeds[places], values[places]
    middle = np.flatnonzero((y[1:-1] >= y[:-2]) & (y[1:-1] > y[2:])) + 1
    middle = middle[np.minimum(y[middle - 1], y[middle + 1]) > 0.5 * y[middle]]
    middle = middle[np.argsort(-y[middle], kind="stable")][:most]
    left, right = x[middle] - x[middle - 1], x[middle + 1] - x[middle]
    # Vertex of the parabola through three speeds that need not be equidistant.
    rise, fall = (y[middle] - y[middle - 1]) / left, (y[middle + 1] - y[middle]) / right
    return places[middle], x[middle] + (rise * right + fall * left) / (2 * (rise - fall))


def label(chosen):
    """What an Objective or Penalty reads: ``"tooth force of crank gear|idler"``."""
    order = f" {chosen.order:g}" if chosen.order is not None else ""
    mode = f" {chosen.mode}" if getattr(chosen, "mode", None) is not None else ""
    return f"{chosen.quantity}{order}{mode}" + (f" of {chosen.of}" if chosen.of else "")

"""The objective of a tuning and its gradient: all starts and all speeds, in batches of lanes that share a plan.

On the device the parameters are unbounded numbers z: a parameter lies the share ``1 / (1 + exp(-z))`` of the way from
its lower to its upper bound, on its scale. At most speeds of a drive train no tooth separates, and one linear solve is
all; it is verified, and where a changed design shakes a tooth off the speed is solved like those that hammer.
"""

import dataclasses
from dataclasses import dataclass
from functools import partial

import jax
import numpy as np

from ..harmonic.excitation import listed_harmonic
from ..periodic.planned import BATCH
from ..periodic.planning import next_level, plan_marching, plan_speeds
from ..periodic.problem import pose
from ..periodic.program import Start
from ..periodic.request import Request
from ..periodic.solve import solve
from ..response.status import Status
from .lanes import (
    Form,
    combine,
    estimate_lanes,
    lane_sizes,
    pose_designs,
    pull_back,
    pull_lanes,
    read_lanes,
    to_values,
)
from .quantities import OF_DESIGN

LADDER = 3
"""Lost speeds of a trial that are taken up the ladder of :func:`jaxhb.solve`; with more of them it went too far."""

ALONE = 48
"""Harmonics from which a processor solves lanes one by one: in a batch each waits for the slowest."""

NEGLIGIBLE = 1e-8
"""Share of the largest derivative of the objective by a reading below which no gradient is taken through it."""

SETTLED = 1e-4
"""Closure at which a march ends; what its steps leave of the equations is as much."""

FARTHEST = 6.9
"""|z| of a start on a bound: a thousandth of the range inside it, where the share still has a slope."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Point:
    """Designs and how they do: A starts, n speeds, P parameters, M meshes, N harmonics of the finest plan.

    z : ``(A, P)``; value : ``(A,)``; gradient : ``(A, P)``, with respect to z, nan where it was not asked for
    status : ``(A, n)``; kind : ``(A, n)``, number of the plan; motion : complex ``(A, n, M, N+1)`` m, deflections
    readings : of each objective and then each penalty, not smoothed, ``(A, n)``; those of the train alone ``(A,)``
    """

    z: np.ndarray
    value: np.ndarray
    gradient: np.ndarray
    status: np.ndarray
    kind: np.ndarray
    motion: np.ndarray
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


def to_unbounded(values, parameters):
    """z ``(P,)`` of values between their bounds, those on a bound a little inside."""
    shares = [
        np.log(v / p.low) / np.log(p.high / p.low) if p.scale == "log" else (v - p.low) / (p.high - p.low)
        for v, p in zip(values, parameters, strict=True)
    ]
    with np.errstate(divide="ignore"):
        z = np.log(shares) - np.log1p(-np.array(shares))
    return np.clip(z, -FARTHEST, FARTHEST)


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
    """Evaluates designs on the host: holds plans, units and widths of the objectives, counts the calls.

    Attributes
    ----------
    kinds : list of Plan, the largest first; scales, widths : of the objectives; calls : evaluations so far
    speeds : ``(A, n)`` rpm, those asked for and behind them those that follow peaks
    """

    def __init__(self, train, rpm, task, planner, *, fixed, peaks=0):
        """``planner``: (train, rpm) -> what :func:`plan_designs` returns; ``fixed``: harmonics stay as it says;
        ``peaks``: speeds added for every objective that is a maximum, to follow its highest peaks.
        """
        self.train, self.rpm, self.task, self.planner, self.fixed = train, rpm, task, planner, fixed
        self.followed = [j for j, objective in enumerate(task.objectives) if objective.over == "worst"]
        self.peaks, self.speeds = peaks, rpm[None]
        fallback, plans = planner(train, rpm)
        self.kinds = [fallback]
        self.scales = np.ones(len(task.objectives))
        self.widths = 0.1 * self.scales
        self.calls = 0
        excited = listed_harmonic(train.topology)
        self.excited = excited or max(plan.harmonics for plan in (fallback, *plans))
        moved = train.replace({p.name: train.value(p.name) for p in task.parameters})
        problem = pose(train, float(rpm[0]), self.excited)
        same = [old is new for old, new in zip(jax.tree.leaves(train), jax.tree.leaves(moved), strict=True)]
        same += [False] * len(jax.tree.leaves(problem))
        self.form, self.held = Form.of((train, problem), same)

    def first(self, z):
        """The Point of designs without motions, lost speeds up the ladder."""
        meshes, added = len(self.train.topology.mesh_names), self.peaks * len(self.followed)
        spread = np.linspace(0, len(self.rpm) - 1, added).round().astype(int)
        self.speeds = np.tile(np.concatenate([self.rpm, self.rpm[spread]]), (len(z), 1))
        motion = np.zeros((*self.speeds.shape, meshes, 1), dtype=complex)
        kind = self._planned(z)
        near = Point(z, None, None, np.full(kind.shape, Status.MAX_STEPS), kind, motion, None)
        return self.at(z, near, np.ones(kind.shape, dtype=bool), ladder=self.speeds.shape[1])

    def replanned(self, point):
        """The same designs, their speeds planned anew."""
        return dataclasses.replace(point, kind=self._planned(point.z))

    def follow(self, point):
        """Move the added speeds to the highest peaks of the curves through all: the Point to start there from."""
        self.speeds, into = self.speeds.copy(), len(self.rpm)
        near = np.tile(np.arange(self.speeds.shape[1]), (len(point.z), 1))
        for j in self.followed if self.peaks else ():
            values = self.weights()[..., j] * point.readings[j]
            for a, good in enumerate(point.solved):
                places, speeds = summits(self.speeds[a][good], values[a][good], self.peaks)
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
        plans = [self.planner(train, rpm)[1] for train, rpm in zip(trains, self.speeds, strict=True)]
        return np.array([[self._kind(plan) for plan in row] for row in plans])

    def _kind(self, plan):
        """The number of a plan, a new one where none yet holds the same meshes."""
        for number, known in enumerate(self.kinds):
            if (known.active, known.flank) == (plan.active, plan.flank):
                return number
        self.kinds.append(plan)
        return len(self.kinds) - 1

    def at(self, z, near, counted, *, wanted=True, most=np.inf, ladder=LADDER):
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
        trial = _Trial(self, z, near, counted, np.broadcast_to(wanted, len(z)))
        trial.solve(np.broadcast_to(trial.wanted[:, None], counted.shape), near.solved)
        again = trial.lost() & near.solved & (trial.status != Status.PLAN_VIOLATED)
        trial.solve(again & ~trial.resumed, True, other=False)
        trial.solve(again & trial.resumed, False)
        violated = trial.lost() & (trial.status == Status.PLAN_VIOLATED)
        trial.kind[violated] = 0
        trial.solve(violated, False)
        lost = trial.lost()
        trial.climb(lost & (lost.sum(1, keepdims=True) <= ladder))
        return trial.point(most)

    def finer_plans(self, point, counted):
        """Whether solved speeds need more harmonics than their plans have; the plans then get them."""
        short = set() if self.fixed else self._short(point, counted & point.solved)
        for number in short:
            plan = self.kinds[number]
            higher = next_level(plan.harmonics, plan.method)
            self.kinds[number] = dataclasses.replace(plan, harmonics=higher, tolerance_share=1.0)
        return bool(short)

    def _short(self, point, counted):
        """Numbers of the plans that have too few harmonics and may have more."""
        short, numbers = set(), None
        for number, plan in enumerate(self.kinds):
            higher = next_level(plan.harmonics, plan.method)
            lanes = np.argwhere(counted & (point.kind == number)) if plan.active and higher else ()
            for chunk, padded in _chunks(lanes, plan):
                numbers = self._pose(point.z)[0] if numbers is None else numbers
                motion = _active(point.motion[tuple(padded.T)], plan)
                own = numbers[tuple(padded.T)]
                errors = estimate_lanes(own, self.held, motion, plan.choice, form=self.form, sizes=plan.sizes)
                if (np.asarray(errors)[: len(chunk)] > plan.limit).any():
                    short.add(number)
                    break
        return short

    def _pose(self, z):
        numbers, pull = pose_designs(self.train, self.speeds, z, task=self.task, excited=self.excited, form=self.form)
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
        numbers, counts = np.unique(point.kind[best], return_counts=True)
        return "; ".join(f"{n} speeds: {self.kinds[k]}" for k, n in zip(numbers, counts, strict=True))


class _Trial:
    """One evaluation under way: lanes are solved, some of them again, and what came of them is put together."""

    def __init__(self, bench, z, near, counted, wanted):
        task, shape = bench.task, near.status.shape
        self.bench, self.z, self.counted, self.wanted = bench, z, counted, wanted
        self.numbers, self.pull = bench._pose(z)
        self.kind, self.status, self.resumed = near.kind.copy(), near.status.copy(), np.zeros(shape, dtype=bool)
        self.unmoved = (z == near.z).all(1, keepdims=True)
        harmonics = max(plan.harmonics for plan in bench.kinds)
        self.motion = np.zeros((*near.motion.shape[:3], harmonics + 1), dtype=complex)
        kept = min(self.motion.shape[-1], near.motion.shape[-1])
        self.motion[..., :kept] = near.motion[..., :kept]
        self.smooth = np.zeros((*shape, len(task.of_response)))
        self.exact = np.zeros_like(self.smooth)
        self.pulls, self.owner = [], np.full(shape, -1)

    def lost(self):
        """Lanes that count and are not solved."""
        return self.wanted[:, None] & self.counted & (self.status > Status.TOLERANCE_NOT_MET)

    def solve(self, lanes, given, other=True):
        """Solve ``lanes`` ``(A, n)``, from the motion at hand where it is ``given`` and no ``other`` start is better.

        A march is where the motion at hand leaves more of the equations; teeth in contact are, where none separates,
        once the design has changed.
        """
        given = np.broadcast_to(given, lanes.shape)
        for number in np.unique(self.kind[lanes]):
            plan = self.bench.kinds[number]
            marching = plan.marches
            own = given & (marching | self.unmoved | (not other))
            for chunk, padded in _chunks(np.argwhere(lanes & (self.kind == number)), plan):
                self._read(plan, chunk, padded, own[tuple(padded.T)], plan.cycles if marching and other else 0)

    def _read(self, plan, chunk, padded, given, cycles):
        bench, at, into = self.bench, tuple(padded.T), tuple(chunk.T)
        start = Start(
            _active(self.motion[at], plan) if plan.active else np.zeros((len(padded), 0, plan.harmonics + 1), complex),
            given,
            np.full(len(padded), cycles),
            np.full(len(padded), SETTLED),
        )
        lanes = self.numbers[at], bench.held, bench.speeds[at]
        shape = {"form": bench.form, "asked": bench.task.asked, "sizes": lane_sizes(plan)}
        smooth, found, told = read_lanes(*lanes, start, plan.choice, **shape)
        status, periodicity_error, motion, exact = (np.asarray(a)[: len(chunk)] for a in told)
        self.owner[into] = len(self.pulls)
        self.pulls.append((chunk, padded, partial(pull_lanes, *lanes, found, plan.choice, **shape)))
        self.smooth[into], self.exact[into] = np.asarray(smooth)[: len(chunk)], exact
        self.status[into], self.resumed[into] = status, given[: len(chunk)] & (periodicity_error == 0)
        self.motion[into] = 0.0
        self.motion[(*into, slice(None), slice(0, motion.shape[-1]))] = motion

    def climb(self, lanes):
        """Solve ``lanes`` one by one, up the ladder of :func:`jaxhb.solve`, and from there under the largest plan."""
        bench, plan, found = self.bench, self.bench.kinds[0], np.zeros_like(lanes)
        for a, i in np.argwhere(lanes) if plan.active else ():
            train = bench.train.replace(bench.values(self.z[a]))
            response = solve(train, rpm=float(bench.speeds[a, i]), harmonics=plan.harmonics, integrals=plan.integrals)
            if response.status <= Status.TOLERANCE_NOT_MET:
                found[a, i] = True
                self.kind[a, i] = 0
                self.motion[a, i] = 0.0
                self.motion[a, i, :, : response.deflections.shape[-1]] = response.deflections
        self.solve(found, True, other=False)

    def point(self, most):
        """The Point, with gradients where the value is at most ``most``; a speed without one counts as lost."""
        bench, task = self.bench, self.bench.task
        while True:
            kept = self.wanted[:, None] & self.counted & (self.status <= Status.TOLERANCE_NOT_MET)
            numbers = bench.weights(), bench.widths, bench.scales
            combined = combine(bench.train, self.z, self.smooth, kept, *numbers, task=task, own=len(bench.rpm))
            value, of_design, by_z, by_smooth = jax.tree.map(np.asarray, combined)
            steep = self.wanted & (value <= most)
            lanes = self._pulled(np.where(steep[:, None, None], by_smooth, 0.0))
            whole = np.isfinite(lanes).all(axis=-1)
            if (whole | ~kept).all():
                break
            self.status[kept & ~whole] = Status.STALLED
        gradient = by_z + np.asarray(pull_back(self.pull, lanes))
        told, of_design = iter(np.moveaxis(self.exact, -1, 0)), iter(of_design)
        chosen = (*task.objectives, *task.penalties)
        return Point(
            z=self.z,
            value=value,
            gradient=np.where(steep[:, None], gradient, np.nan),
            status=self.status,
            kind=self.kind,
            motion=self.motion,
            readings=tuple(next(of_design if c.quantity in OF_DESIGN else told) for c in chosen),
        )

    def _pulled(self, by_smooth):
        """The derivative of the objective by the numbers of every lane, from that by its readings."""
        by_numbers = np.zeros_like(self.numbers)
        size = np.abs(by_smooth * self.smooth)
        counts = size.max(axis=(1, 2), keepdims=True) * NEGLIGIBLE < size
        for number, (chunk, padded, pull) in enumerate(self.pulls):
            into = tuple(chunk.T)
            own = (self.owner[into] == number)[:, None] & counts[into]
            if own.any():
                cotangent = np.zeros((len(padded), by_smooth.shape[-1]))
                cotangent[: len(chunk)] = np.where(own, by_smooth[into], 0.0)
                by_numbers[into] += np.asarray(pull(cotangent))[: len(chunk)]
        return by_numbers


def summits(speeds, values, most):
    """The highest local maxima of a curve: their places in ``speeds``, and where the parabolas through them culminate.

    At most ``most``; a speed given twice counts once, and ends of the curve are no summits. Nor are peaks narrower than
    the spacing of the speeds: one speed in such a peak would only be fled from.
    """
    _, places = np.unique(speeds, return_index=True)
    x, y = speeds[places], values[places]
    middle = np.flatnonzero((y[1:-1] >= y[:-2]) & (y[1:-1] > y[2:])) + 1
    middle = middle[np.minimum(y[middle - 1], y[middle + 1]) > 0.5 * y[middle]]
    middle = middle[np.argsort(-y[middle], kind="stable")][:most]
    left, right = x[middle] - x[middle - 1], x[middle + 1] - x[middle]
    rise, fall = (y[middle] - y[middle - 1]) / left, (y[middle + 1] - y[middle]) / right
    return places[middle], x[middle] + (rise * right + fall * left) / (2 * (rise - fall))


def _chunks(lanes, plan):
    """Batches of ``lanes`` ``(k, 2)`` and the same padded to one of few sizes: a size is a program."""
    few = 2 * BATCH
    size = min(-(-len(lanes) // few), 4) * few
    if jax.default_backend() == "cpu" and plan.active:
        size = 1 if plan.harmonics >= ALONE else BATCH
    for first in range(0, len(lanes), max(size, 1)):
        chunk = lanes[first : first + size]
        yield chunk, np.concatenate([chunk, np.repeat(chunk[-1:], size - len(chunk), axis=0)])


def _active(motion, plan):
    """Deflections ``(c, G, N+1)`` of the active meshes of a plan from those of all."""
    choice = plan.choice
    kept = motion[:, choice.chosen, : plan.harmonics + 1] * choice.active[:, None]
    return np.pad(kept, [(0, 0), (0, 0), (0, plan.harmonics + 1 - kept.shape[-1])])


def label(chosen):
    """What an Objective or Penalty reads: ``"tooth force of crank gear|idler"``."""
    order = f" {chosen.order:g}" if chosen.order is not None else ""
    mode = f" {chosen.mode}" if getattr(chosen, "mode", None) is not None else ""
    return f"{chosen.quantity}{order}{mode}" + (f" of {chosen.of}" if chosen.of else "")

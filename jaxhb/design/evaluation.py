"""Evaluation of designs: the objective of a tuning and its gradient, all starts at all
speeds in batches of lanes.

A lane is one design at one speed. The parameters are unbounded numbers z: a parameter
lies the share ``1 / (1 + exp(-z))`` of the way from its lower to its upper bound, on
its scale. All that depends on them is computed for all designs at once and ends in the
numbers of the lanes' problems; a solve per lane knows no parameters: its program serves
any of them, and a gradient passes it once whatever their number. A gradient is taken
only where the value turned out to be worth it, and only through the speeds that matter.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array
from jaxhb._program import Program
from jaxhb._threads import side_by_side
from jaxhb.balance.derivative import all_finite, only_if
from jaxhb.balance.plan import RESIDUAL, Goals, Plan, ProgramShape, Request
from jaxhb.balance.problem import ActiveMeshes, Problem, problem_at
from jaxhb.balance.program import (
    START_SETTLED,
    Start,
    active_deflections,
    differentiable,
    estimate,
    find,
    respond,
)
from jaxhb.design import objectives
from jaxhb.design.between_speeds import Followed, culmination, speeds_of
from jaxhb.design.quantities import (
    OF_DESIGN,
    QUANTITIES,
    Penalty,
    inertia_added,
    judged,
    label,
)
from jaxhb.design.task import Reading, ResponseReading, Task
from jaxhb.design.tolerances import Box, Scatter
from jaxhb.equations import fourier
from jaxhb.linear.sensitivity import frequencies_hz
from jaxhb.results import answers
from jaxhb.results.response import Response
from jaxhb.results.status import Status
from jaxhb.solutions.planning import next_level, plan_marching, plan_speeds
from jaxhb.solutions.solve import solve
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import listed_harmonic

NEWTON_STEPS = 15  # of a lane at most
NEGLIGIBLE = 1e-8
"""Share of the largest derivative of the objective by a reading below which no gradient
is taken through it.
"""

MOST_RESCUES = 3
"""Lost speeds of a design that :func:`jaxhb.solve` tries from all its starts; with more
the step went too far.
"""

RESCUE_SECONDS = 30.0
"""Time after which a lost speed gets no further attempt; most of those that are not
found soon have no motion of one cycle.
"""

# Lanes that one program computes side by side
FEW_LANES = 16
MANY_LANES = 64

# Structure of the train and problem of a lane, and which of its leaves all lanes share
Form: TypeAlias = tuple[jax.tree_util.PyTreeDef, tuple[bool, ...]]
# A pullback from cotangents of results to those of arguments
Pullback: TypeAlias = Callable[..., Any]
Tree = TypeVar("Tree")
UNSOLVED: Any = None
"""Value of the fields of a Point that a solve fills in."""


@dataclass(frozen=True)
class Aim:
    """The present aim of a descent.

    counted : bool ``(A, n)``, speeds that enter where they are solved; scales, widths :
    of every objective, unit of its values in its own, and width of its smooth maximum
    in this one; share : the width as a share of the worst value
    """

    counted: np.ndarray
    scales: np.ndarray
    widths: np.ndarray
    share: float


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Point:
    """Designs and their readings: A starts, n speeds, P parameters, M meshes, N
    harmonics of the finest plan.

    z : ``(A, P)``; speeds : ``(A, n)`` rpm, those asked for, those that follow peaks,
    and those at critical speeds; status : ``(A, n)``; plan_number : ``(A, n)``, index
    of ``plans``, the first of which serves any motion; motion : complex ``(A, n, M,
    N+1)`` m, deflections; resumed : bool ``(A, n)``, solved from the motion at hand
    alone; smooth, exact : readings of responses ``(A, n, J)``; of_design : readings
    ``(A,)`` of the train alone; value : ``(A,)``; gradient : ``(A, P)``, with respect
    to z, nan where it was not asked for
    """

    z: np.ndarray
    speeds: np.ndarray
    status: np.ndarray
    plan_number: np.ndarray
    motion: np.ndarray
    resumed: np.ndarray = UNSOLVED
    smooth: np.ndarray = UNSOLVED
    exact: np.ndarray = UNSOLVED
    of_design: tuple[np.ndarray, ...] = ()
    value: np.ndarray = UNSOLVED
    gradient: np.ndarray = UNSOLVED
    plans: tuple[Plan, ...] = field(default=(), metadata={"static": True})

    @property
    def solved(self) -> np.ndarray:
        """Whether the equations are solved ``(A, n)``."""
        return answers.solved(self.status)

    @property
    def readings(self) -> tuple[np.ndarray, ...]:
        """Readings that are not smoothed: of a response ``(A, n)`` each, then of the
        train alone ``(A,)``.
        """
        return (*np.moveaxis(self.exact, -1, 0), *self.of_design)


def where(chosen: np.ndarray, here: Tree, there: Tree) -> Tree:
    """Join two trees of arrays ``(A, ...)``: the designs of one where ``chosen``
    ``(A,)``, else of the other.
    """

    def pick(first: Any, second: Any) -> np.ndarray:
        return np.where(chosen.reshape(-1, *[1] * (np.ndim(first) - 1)), first, second)

    return jax.tree.map(pick, here, there)


class Evaluator:
    """Evaluates designs of one train on the host; it holds what stays the same all the
    way down.
    """

    def __init__(
        self,
        train: DriveTrain,
        rpm: np.ndarray,
        task: Task,
        request: Request,
        peaks: int = 0,
        scatter: Scatter | None = None,
        critical: Sequence[Followed] = (),
    ):
        """Plan the speeds ``rpm`` ``(n,)``, to which ``peaks`` speeds are added for
        every objective that is a maximum, to follow its highest peaks; ``scatter`` is
        None, or the :class:`~jaxhb.design.tolerances.Scatter` of the trains at these
        speeds; ``critical`` are the :class:`~jaxhb.design.between_speeds.Followed` at
        whose speed each design is looked at, too.
        """
        self.scatter_box = scatter.box if scatter else None
        # A number that the scene leaves out (gas_factor) is an array of every lane.
        names = [*task.named(task.unbounded(train))]
        if self.scatter_box:
            names += self.scatter_box.named(self.scatter_box.unbounded(train))
        train = train.replace({name: train.value(name) for name in names})
        self.critical = tuple(critical)
        self.train = train
        self.rpm = rpm
        self.task = task
        self.request = request
        self.peaks = peaks
        self.followed = [
            j
            for j, objective in enumerate(task.objectives)
            if peaks and objective.over == "worst"
        ]
        self.fallback, plans = plan_designs(train, rpm, request)
        excited = listed_harmonic(train.topology)
        self.excited = excited or max(
            plan.harmonics for plan in (self.fallback, *plans)
        )
        inertia = np.concatenate([train.disks.inertia, train.dampers.inertia])
        self.heavy = tuple((inertia > 0).tolist())
        self.shares = scatter.shares if scatter else np.zeros((len(rpm), 0))
        # Within a box all its numbers differ from the train's own.
        elsewhere = np.full(self.shares.shape[1], 0.3)
        moved = train_of_lane(
            train, task, self.scatter_box, task.unbounded(train), elsewhere
        )
        leaves, structure = jax.tree.flatten(
            (train, problem_at(train, float(rpm[0]), self.excited))
        )
        # Leaves that no parameter changes, as tables of pressures, are handed to
        # programs once; the rest for each lane.
        same = [
            old is new
            for old, new in zip(
                jax.tree.leaves(train), jax.tree.leaves(moved), strict=True
            )
        ]
        same += [False] * (len(leaves) - len(same))
        held = [
            is_held or jnp.result_type(leaf).kind not in "fc"
            for leaf, is_held in zip(leaves, same, strict=True)
        ]
        self.held = [
            jnp.asarray(leaf)
            for leaf, is_held in zip(leaves, held, strict=True)
            if is_held
        ]
        self.form: Form = structure, tuple(held)

    def unsolved(self, z: np.ndarray) -> Point:
        """The Point of designs ``(A, P)`` without motions."""
        added = self.peaks * len(self.followed)
        spread = np.linspace(0, len(self.rpm) - 1, added).round().astype(int)
        of_design = np.concatenate(
            [self.rpm, self.rpm[spread], np.zeros(len(self.critical))]
        )
        speeds = self._at_critical(z, np.tile(of_design, (len(z), 1)))
        motion = np.zeros(
            (*speeds.shape, len(self.train.topology.has_law), 1), dtype=complex
        )
        lost = np.full(speeds.shape, Status.MAX_STEPS)
        return self._planned(
            Point(z, speeds, lost, np.zeros_like(lost), motion, plans=(self.fallback,))
        )

    def _at_critical(self, z: np.ndarray, speeds: np.ndarray) -> np.ndarray:
        """Move the last of the speeds ``(A, n)`` to the critical speeds of designs
        ``(A, P)``.

        There a reading is at a maximum over the speed: its derivative by z is that at a
        constant speed.
        """
        if not self.critical:
            return speeds
        trains = [self.train.replace(self.task.named(design)) for design in z]
        critical = np.array(
            [speeds_of(self.critical, train, self.rpm) for train in trains]
        )
        return np.concatenate([speeds[:, : -len(self.critical)], critical], axis=1)

    def replanned(self, point: Point) -> Point:
        """Prepare the same designs to be solved anew: the added speeds on their highest
        peaks, all planned by their numbers.
        """
        speeds = point.speeds.copy()
        column = len(self.rpm)
        nearest = np.tile(np.arange(speeds.shape[1]), (len(point.z), 1))
        for j in self.followed:
            values = self.weights(point.speeds)[..., j] * point.readings[j]
            for design, solved in enumerate(point.solved):
                places, summits = highest_peaks(
                    point.speeds[design][solved], values[design][solved], self.peaks
                )
                added = slice(column, column + len(places))
                nearest[design, added] = np.flatnonzero(solved)[places]
                speeds[design, added] = summits
            column += self.peaks
        rows = np.arange(len(nearest))[:, None]
        status = point.status[rows, nearest]
        motion = point.motion[rows, nearest]
        return self._planned(
            dataclasses.replace(point, speeds=speeds, status=status, motion=motion)
        )

    def _planned(self, point: Point) -> Point:
        """Plan every design by its own numbers, as a changed one may shake off a tooth;
        of the plans at hand those that hold the same meshes, whose harmonics have
        proved enough.
        """
        plans = {(plan.active, plan.flank): plan for plan in point.plans}
        numbers = []
        for z, speeds in zip(point.z, point.speeds, strict=True):
            design = self.train.replace(self.task.named(z))
            _, design_plans = plan_designs(design, speeds, self.request)
            for plan in design_plans:
                plans.setdefault((plan.active, plan.flank), plan)
            numbers.append(
                [list(plans).index((plan.active, plan.flank)) for plan in design_plans]
            )
        return dataclasses.replace(
            point, plans=tuple(plans.values()), plan_number=np.array(numbers)
        )

    def weights(self, speeds: np.ndarray) -> np.ndarray:
        """Factors of the objectives at all speeds ``(A, n, objectives)``, interpolated
        at the added ones.
        """
        order = np.argsort(self.rpm, kind="stable")
        columns = []
        for objective in self.task.objectives:
            factors = np.array(objective.weights or np.ones(len(self.rpm)))
            columns.append(np.interp(speeds, self.rpm[order], factors[order]))
            columns[-1][:, : len(self.rpm)] = factors
        return np.stack(columns, axis=-1)

    def at(
        self,
        z: np.ndarray,
        near: Point,
        aim: Aim,
        *,
        to_solve: np.ndarray | bool = True,
        most: np.ndarray | float = np.inf,
        rescues: int = MOST_RESCUES,
        on_lanes: Callable[[Reading], object] | None = None,
    ) -> Point:
        """Evaluate designs z ``(A, P)`` near those of the Point ``near``.

        to_solve : bool ``(A,)``, designs to be solved; the others are those of ``near``
        without value; most : ``(A,)``, values above which no gradient is asked for;
        rescues : lost speeds of a design that are tried from all starts of
        :func:`jaxhb.solve`; on_lanes : called with the Reading of the first design,
        again and again while its speeds are solved
        """
        to_solve = np.broadcast_to(to_solve, len(z))
        near = dataclasses.replace(near, speeds=self._at_critical(z, near.speeds))
        lanes, pull = self.solved(
            z, near, to_solve[:, None] & aim.counted, rescues=rescues, on_lanes=on_lanes
        )
        return self._valued(lanes, pull, aim, to_solve, most)

    def solved(
        self,
        z: np.ndarray,
        near: Point,
        which: np.ndarray,
        *,
        again: bool = True,
        rescues: int = MOST_RESCUES,
        on_lanes: Callable[[Reading], object] | None = None,
    ) -> tuple[Lanes, Pullback]:
        """Solve the :class:`Lanes` of designs z near those of a Point where ``which``
        ``(A, n)``, lost ones from another start ``again``, and give the pullback of
        their numbers to z; other arguments as of :meth:`at`.
        """
        numbers, pull = self.numbers_of(z, near.speeds)
        nothing = np.zeros((*which.shape, len(self.task.of_response)))
        motion = fourier.resize(near.motion, max(plan.harmonics for plan in near.plans))
        point = dataclasses.replace(
            near,
            z=z,
            of_design=(),
            motion=motion,
            resumed=np.zeros_like(which),
            smooth=nothing,
            exact=nothing,
        )
        unmoved = (z == near.z).all(1, keepdims=True)
        lanes = Lanes(self, point, numbers, which, unmoved, on_lanes)
        lanes = lanes.solve(which, near.solved)
        # A speed lost from a march is tried from the motion of the design nearby, and
        # the other way round.
        retry = (
            again
            & lanes.lost
            & near.solved
            & (lanes.point.status != Status.PLAN_VIOLATED)
        )
        lanes = lanes.solve(retry & ~lanes.point.resumed, True, other_starts=False)
        lanes = lanes.solve(retry & lanes.point.resumed, False)
        violated = lanes.lost & (lanes.point.status == Status.PLAN_VIOLATED)
        lanes = lanes.with_point(
            plan_number=np.where(violated, 0, lanes.point.plan_number)
        ).solve(violated, False)
        lost = lanes.lost
        return lanes.rescue(lost & (lost.sum(1, keepdims=True) <= rescues)), pull

    def _valued(
        self,
        lanes: Lanes,
        pull: Pullback,
        aim: Aim,
        to_solve: np.ndarray,
        most: np.ndarray | float,
    ) -> Point:
        """The Point, with gradients where the value is at most ``most``; a speed
        without one counts as lost.
        """
        point = lanes.point
        status = lanes.point.status
        while True:
            valid = lanes.counted & answers.solved(status)
            combined = combine(
                self.train,
                point.z,
                point.smooth,
                valid,
                self.weights(point.speeds),
                aim.widths,
                aim.scales,
                task=self.task,
                n_speeds=len(self.rpm),
                critical=len(self.critical),
                heavy=self.heavy,
            )
            value, of_design, by_z, by_smooth = jax.tree.map(np.asarray, combined)
            # A line search rejects higher values without their gradients, which cost as
            # much as the solves.
            steep = to_solve & (value <= most)
            by_numbers = lanes.pulled(np.where(steep[:, None, None], by_smooth, 0.0))
            whole = np.all(
                [
                    np.isfinite(slopes).all(axis=tuple(range(2, slopes.ndim)))
                    for slopes in by_numbers
                ],
                axis=0,
            )
            if (whole | ~valid).all():
                break
            # Near a fold the equations are solved and their derivative is not: the
            # speed is lost, and the rest evaluated without it.
            status = np.where(valid & ~whole, Status.STALLED, status)
        gradient = np.where(steep[:, None], by_z + np.asarray(pull(by_numbers)), np.nan)
        return dataclasses.replace(
            point, status=status, value=value, gradient=gradient, of_design=of_design
        )

    def finer(self, point: Point, counted: np.ndarray) -> Point | None:
        """The point under plans of more harmonics where counted speeds need them, None
        where none does.
        """
        plans = list(point.plans)
        counted = counted & point.solved & (not self.request.harmonics)
        if not counted.any():
            return None
        numbers, _ = self.numbers_of(point.z, point.speeds)
        for number, plan in enumerate(point.plans):
            higher = next_level(plan.harmonics, plan.method) if plan.active else None
            if not higher:
                continue
            lanes = np.argwhere(counted & (point.plan_number == number))
            for chunk, padded in batches(lanes, plan):
                motion = of_active_meshes(point.motion[tuple(padded.T)], plan)
                chunk_numbers = [leaf[tuple(padded.T)] for leaf in numbers]
                errors = estimate_lanes(
                    chunk_numbers,
                    self.held,
                    motion,
                    plan.active_meshes,
                    form=self.form,
                    shape=plan.shape,
                )
                if (np.asarray(errors)[: len(chunk)] > plan.goals.truncation).any():
                    plans[number] = dataclasses.replace(
                        plan, harmonics=higher, tolerance_share=1.0
                    )
                    break
        if tuple(plans) == point.plans:
            return None
        return dataclasses.replace(point, plans=tuple(plans))

    def numbers_of(
        self, z: np.ndarray, speeds: np.ndarray
    ) -> tuple[list[np.ndarray], Pullback]:
        """Numbers of all lanes ``(A, n, ...)`` of designs z, and the pullback to z."""
        # Of a box there are no added speeds.
        shares = np.resize(self.shares, (speeds.shape[1], self.shares.shape[1]))
        form = DesignForm(self.task, self.scatter_box, self.excited, self.form[1])
        numbers = problems_of_designs(self.train, speeds, shares, z, form=form)
        pull = partial(pull_designs, self.train, speeds, shares, z, form=form)
        return [np.asarray(leaf) for leaf in numbers], pull

    def reading(self, point: Point, design: int) -> Reading:
        """The :class:`Reading` of one design, as far as it is known."""
        solved = point.solved[design, : len(self.rpm)]
        readings: dict[str, Any] = {}
        for criterion, values in zip(
            self.task.of_response + self.task.of_design, point.readings, strict=False
        ):
            if criterion.quantity in OF_DESIGN:
                readings[label(criterion)] = float(values[design])
            else:
                has_value = solved & judged(self.train, criterion, self.rpm)
                readings[label(criterion)] = np.where(
                    has_value, values[design][: len(solved)], np.nan
                )
        return Reading(self.task.named(point.z[design]), solved, readings)

    def described(self, point: Point, design: int) -> str:
        """Describe the plans of one design, for people."""
        numbers, counts = np.unique(point.plan_number[design], return_counts=True)
        return "; ".join(
            f"{count} speeds: {point.plans[number]}"
            for number, count in zip(numbers, counts, strict=True)
        )


# Fields of a Point that a solve gives
SOLVED = ("status", "motion", "resumed", "smooth", "exact")


@dataclass(frozen=True)
class Lanes:
    """The lanes of one evaluation, as far as they are solved: each attempt gives
    others.

    numbers : arrays ``(A, n, ...)``; counted : ``(A, n)``, lanes that enter the
    objective; unmoved : ``(A, 1)``, designs that are those of the motions at hand;
    on_lanes : None, or called with a Reading; batches : (lanes, padded lanes,
    derivative) of each batch solved
    """

    evaluator: Evaluator
    point: Point
    numbers: list[np.ndarray]
    counted: np.ndarray
    unmoved: np.ndarray
    on_lanes: Callable[[Reading], object] | None = None
    batches: tuple[tuple[np.ndarray, np.ndarray, Pullback], ...] = ()

    @property
    def lost(self) -> np.ndarray:
        """Lanes that count and are not solved ``(A, n)``."""
        return self.counted & ~self.point.solved

    def with_point(self, **changes: Any) -> Lanes:
        """The lanes with changes of their point."""
        return dataclasses.replace(
            self, point=dataclasses.replace(self.point, **changes)
        )

    def solve(
        self,
        which: np.ndarray,
        from_motion: np.ndarray | bool,
        other_starts: bool = True,
    ) -> Lanes:
        """Solve ``which`` ``(A, n)``, from the motion at hand where ``from_motion``
        and, unless ``other_starts`` is False, no other start is better.

        A march is better where the motion at hand leaves more of the equations; teeth
        in contact are, where none separates, once the design has changed.
        """
        changes = {name: getattr(self.point, name).copy() for name in SOLVED}
        lanes = self.with_point(**changes)
        for number in np.unique(self.point.plan_number[which]):
            plan = self.point.plans[number]
            resumes = np.broadcast_to(
                from_motion & (plan.marches | self.unmoved | (not other_starts)),
                which.shape,
            )
            chunks = list(
                batches(np.argwhere(which & (self.point.plan_number == number)), plan)
            )

            def read(
                pair: tuple[np.ndarray, np.ndarray],
                plan: Plan = plan,
                resumes: np.ndarray = resumes,
            ) -> tuple[tuple, Pullback]:
                places = tuple(pair[1].T)
                return self._read(
                    plan, places, resumes[places], plan.marches and other_starts
                )

            for (chunk, padded), (fields, pull) in zip(
                chunks, side_by_side(read, chunks), strict=True
            ):
                for name, values in zip(SOLVED, fields, strict=True):
                    changes[name][tuple(chunk.T)] = np.asarray(values)[: len(chunk)]
                lanes = dataclasses.replace(
                    lanes, batches=(*lanes.batches, (chunk, padded, pull))
                )
                if self.on_lanes:
                    self.on_lanes(self.evaluator.reading(lanes.point, 0))
        return lanes

    def _read(
        self,
        plan: Plan,
        places: tuple[np.ndarray, ...],
        from_motion: np.ndarray,
        marching: bool,
    ) -> tuple[tuple, Pullback]:
        """The fields SOLVED of the lanes at ``places`` under a plan, and the pullback
        from their readings.
        """
        point = self.point
        evaluator = self.evaluator
        motion: Array = np.zeros((len(from_motion), 0, plan.harmonics + 1), complex)
        if plan.active:
            motion = of_active_meshes(point.motion[places], plan)
        lanes = len(from_motion)
        start = Start(
            deflection=motion,
            is_given=from_motion,
            sweeps=np.full(lanes, plan.cycles * marching),
            settled=np.full(lanes, START_SETTLED),
        )
        goals = Goals(
            truncation=np.full(lanes, 1.0),
            residual=np.full(lanes, RESIDUAL),
            step=np.full(lanes, evaluator.task.step_tolerance),
        )
        # Whether a plan has enough harmonics is asked by itself.
        shape = dataclasses.replace(
            plan.shape,
            max_steps=NEWTON_STEPS,
            estimated=False,
            compare_starts=True,
            marches=True,
            averaged=True,
        )
        form = evaluator.form
        readings = evaluator.task.response_readings
        numbers = [leaf[places] for leaf in self.numbers]
        speeds = point.speeds[places]
        smooth, solution, (status, sweeps, motion, exact) = read_lanes(
            numbers,
            evaluator.held,
            speeds,
            start,
            goals,
            plan.active_meshes,
            form=form,
            readings=readings,
            shape=shape,
        )
        pull = partial(
            pull_lanes,
            numbers,
            evaluator.held,
            speeds,
            solution,
            plan.active_meshes,
            form=form,
            readings=readings,
            shape=shape,
        )
        motion = fourier.resize(np.asarray(motion), point.motion.shape[-1] - 1)
        solved = status, motion, from_motion & (np.asarray(sweeps) == 0), smooth, exact
        return solved, pull

    def rescue(self, which: np.ndarray) -> Lanes:
        """Solve ``which`` ``(A, n)`` one by one, from all starts of
        :func:`jaxhb.solve`, and from there under the largest plan.
        """
        point = self.point
        plan = self.point.plans[0]
        rescued = np.zeros_like(which)
        motion = point.motion.copy()
        lost = np.argwhere(which) if plan.active else ()
        evaluator = self.evaluator
        for design, speed in lost:
            response = solve(
                train_of_lane(
                    evaluator.train,
                    evaluator.task,
                    evaluator.scatter_box,
                    point.z[design],
                    evaluator.shares[speed] if evaluator.scatter_box else np.zeros(0),
                ),
                rpm=float(point.speeds[design, speed]),
                harmonics=plan.harmonics,
                integrals=plan.integrals,
                seconds=RESCUE_SECONDS,
            )
            if response.solved:
                rescued[design, speed] = True
                motion[design, speed] = fourier.resize(
                    np.asarray(response.deflections), motion.shape[-1] - 1
                )
        lanes = self.with_point(
            plan_number=np.where(rescued, 0, point.plan_number), motion=motion
        )
        return lanes.solve(rescued, True, other_starts=False)

    def pulled(self, by_smooth: np.ndarray) -> list[np.ndarray]:
        """Pull the derivatives of the objective back to the numbers of every lane, from
        those by its readings ``(A, n, J)``.
        """
        by_numbers = [np.zeros_like(leaf) for leaf in self.numbers]
        size = np.abs(by_smooth * self.point.smooth)
        # Of a smooth maximum few speeds have a weight: a gradient is pulled through
        # these alone.
        left = size.max(axis=(1, 2), keepdims=True) * NEGLIGIBLE < size
        calls = []
        for chunk, padded, pull in reversed(self.batches):
            places = tuple(chunk.T)
            cotangent = np.zeros((len(padded), by_smooth.shape[-1]))
            last = left[places]
            left[places] = False  # of the attempts at a lane the last one counts
            if last.any():
                cotangent[: len(chunk)] = np.where(last, by_smooth[places], 0.0)
                calls.append((places, pull, cotangent))
        for (places, _, _), changes in zip(
            calls, side_by_side(lambda call: call[1](call[2]), calls), strict=True
        ):
            for slopes, change in zip(by_numbers, changes, strict=True):
                slopes[places] += np.asarray(change)[: len(places[0])]
        return by_numbers


def plan_designs(
    train: DriveTrain, rpm: np.ndarray, request: Request
) -> tuple[Plan, list[Plan]]:
    """Plan the speeds: the plan of those that leave theirs, every mesh an unknown and
    as fine as the finest; and a plan for each.
    """
    plans = plan_speeds(train, rpm, request)
    if not request.harmonics:
        plans = [
            dataclasses.replace(plan, harmonics=_level_with_room(plan))
            for plan in plans
        ]
    finest = max(
        (plan for plan in plans if plan.active),
        key=lambda plan: plan.harmonics,
        default=plans[0],
    )
    if not train.topology.has_law.any():
        return finest, plans
    return plan_marching(train, rpm, finest, request), plans


def _level_with_room(plan: Plan) -> int:
    """The next level of harmonics where teeth leave contact without separating: cheaper
    than programs for two levels.
    """
    if not plan.active or plan.marches:
        return plan.harmonics
    return next_level(plan.harmonics, plan.method) or plan.harmonics


def batches(lanes: np.ndarray, plan: Plan) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield batches of ``lanes`` ``(k, 2)`` and the same padded to one of few sizes: a
    size is a program.
    """
    # With contacts as unknowns a lane fills a processor.
    alone = plan.active and jax.default_backend() == "cpu"
    together = FEW_LANES if len(lanes) <= MANY_LANES else MANY_LANES
    size = 1 if alone else together
    for first in range(0, len(lanes), size):
        chunk = lanes[first : first + size]
        padding = np.repeat(chunk[-1:], size - len(chunk), axis=0)
        yield chunk, np.concatenate([chunk, padding])


def of_active_meshes(motion: Array, plan: Plan) -> Array:
    """Deflections ``(c, G, N+1)`` of the active meshes of a plan from those of all
    ``(c, M, N+1)``.
    """
    return fourier.resize(active_deflections(plan, motion), plan.harmonics)


def highest_peaks(
    speeds: np.ndarray, values: np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Find the highest local maxima of a curve: their places in ``speeds``, and where
    the parabolas through them culminate.

    At most ``most``; a speed given twice counts once, and ends of the curve are no
    peaks. Nor are those narrower than the spacing of the speeds: one speed in such a
    peak would only be fled from.
    """
    _, places = np.unique(speeds, return_index=True)
    x = speeds[places]
    y = values[places]
    middle = np.flatnonzero((y[1:-1] >= y[:-2]) & (y[1:-1] > y[2:])) + 1
    middle = middle[np.minimum(y[middle - 1], y[middle + 1]) > 0.5 * y[middle]]
    middle = middle[np.argsort(-y[middle], kind="stable")][:most]
    near = middle + np.array([[-1], [0], [1]])
    return places[middle], culmination(x[near], y[near])


def train_of_lane(
    train: DriveTrain, task: Task, box: Box | None, z: Array, shares: Array
) -> DriveTrain:
    """The train of a design z ``(P,)``, within a ``box`` at the shares ``(...)``."""
    design = train.replace(task.named(z))
    return design.replace(box.scaled(design, shares)) if box else design


@dataclass(frozen=True)
class DesignForm:
    """Static part of the numbers of designs: the task, the box of further lanes or
    None, the harmonics of the excitation, and which leaves of train and problem are
    held.
    """

    task: Task
    box: Box | None
    excited: int
    held: tuple[bool, ...]

    def lanes(
        self, train: DriveTrain, rpm: Array, shares: Array, z: Array
    ) -> list[Array]:
        """The numbers of train and problem, less those held, of every lane at ``rpm``
        ``(A, n)`` and the ``shares`` ``(n, ...)`` of designs z ``(A, P)``: arrays
        ``(A, n, ...)``.
        """

        def lane(z: Array, speed: Array, share: Array) -> list[Array]:
            changed = train_of_lane(train, self.task, self.box, z, share)
            leaves = jax.tree.leaves(
                (changed, problem_at(changed, speed, self.excited))
            )
            return [
                leaf
                for leaf, is_held in zip(leaves, self.held, strict=True)
                if not is_held
            ]

        by_speed = jax.vmap(lane, (None, 0, 0))
        return jax.vmap(by_speed, (0, 0, None))(z, rpm, shares)


@partial(Program, static_argnames="form")
def problems_of_designs(
    train: DriveTrain, rpm: Array, shares: Array, z: Array, *, form: DesignForm
) -> list[Array]:
    """The numbers of all lanes: :meth:`DesignForm.lanes`."""
    return form.lanes(train, rpm, shares, z)


@partial(Program, static_argnames="form")
def pull_designs(
    train: DriveTrain,
    rpm: Array,
    shares: Array,
    z: Array,
    cotangent: list[Array],
    *,
    form: DesignForm,
) -> Array:
    """Pull derivatives by the numbers of all lanes back to z ``(A, P)``.

    A program of its own, which computes the numbers again: one that hands out its
    pullback cannot be kept on disk, and every process would trace it.
    """
    return jax.vjp(partial(form.lanes, train, rpm, shares), z)[1](cotangent)[0]


def train_and_problem(
    form: Form, numbers: Sequence[Array], held: Sequence[Array]
) -> tuple[DriveTrain, Problem]:
    """Rebuild the train and problem of a lane from its numbers and those that all lanes
    share; form: their structure, and which leaves are held.
    """
    structure, mask = form
    lane_leaves = iter(numbers)
    held_leaves = iter(held)
    leaves = [next(held_leaves if is_held else lane_leaves) for is_held in mask]
    return jax.tree.unflatten(structure, leaves)


@partial(Program, static_argnames=("form", "readings", "shape"))
def read_lanes(
    numbers: Sequence[Array],
    held: Sequence[Array],
    rpm: Array,
    start: Start,
    goals: Goals,
    active_meshes: ActiveMeshes,
    *,
    form: Form,
    readings: tuple[ResponseReading, ...],
    shape: ProgramShape,
) -> Any:
    """Solve ``c`` lanes of one plan: smooth readings ``(c, J)``; the solutions, for
    :func:`pull_lanes`; and status ``(c,)``, sweeps to its start or 0 ``(c,)``,
    deflections of all meshes ``(c, M, N+1)``, exact readings.
    """

    def lane(numbers: list[Array], speed: Array, start: Start, goals: Goals) -> Any:
        train, problem = train_and_problem(form, numbers, held)
        solution = find(problem, active_meshes, start, goals, shape)
        response = respond(train, speed, problem, solution.outcome)
        exact = [
            QUANTITIES[quantity].exact_value(response, of, order)
            for quantity, of, order, _ in readings
        ]
        outcome = (
            jnp.asarray(response.status),
            solution.outcome.sweeps,
            response.deflections,
            jnp.stack(exact),
        )
        return _differentiated(response, readings), solution, outcome

    return _each(lane, numbers, rpm, start, goals)


@partial(Program, static_argnames=("form", "readings", "shape"))
def pull_lanes(
    numbers: Sequence[Array],
    held: Sequence[Array],
    rpm: Array,
    solution: Any,
    active_meshes: ActiveMeshes,
    cotangent: Array,
    *,
    form: Form,
    readings: tuple[ResponseReading, ...],
    shape: ProgramShape,
) -> list[Array]:
    """Pull a derivative by the readings ``(c, J)`` of lanes, of which
    :func:`read_lanes` gave the ``solution``, back to their numbers.
    """

    def lane(
        numbers: list[Array], speed: Array, solution: Any, cotangent: Array
    ) -> list[Array]:
        def read(numbers: list[Array]) -> Array:
            train, problem = train_and_problem(
                form, only_if(all_finite(numbers), numbers), held
            )
            outcome = differentiable(problem, active_meshes, solution, shape)
            return _differentiated(respond(train, speed, problem, outcome), readings)

        return jax.vjp(read, numbers)[1](cotangent)[0]

    return _each(lane, numbers, rpm, solution, cotangent)


def _differentiated(response: Response, readings: tuple[ResponseReading, ...]) -> Array:
    """The values ``(J,)`` that a gradient is taken of: smooth readings, or
    sharp ones.
    """
    # Who asks for sharp ones wants the slope of one time sample: no warning.
    response = dataclasses.replace(response, sharp=False)
    return jnp.stack(
        [
            QUANTITIES[quantity].differentiated(variant)(response, of, order, None)
            for quantity, of, order, variant in readings
        ]
    )


def _each(lane: Callable[..., Any], *batch: Any) -> Any:
    """Map ``lane`` over all lanes; a single one without ``vmap``, under which a
    condition runs both its branches.
    """
    if len(jax.tree.leaves(batch)[0]) > 1:
        return jax.vmap(lane)(*batch)
    single = lane(*jax.tree.map(lambda leaf: leaf[0], batch))
    return jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], single)


@partial(Program, static_argnames=("form", "shape"))
def estimate_lanes(
    numbers: Sequence[Array],
    held: Sequence[Array],
    motion: Array,
    active_meshes: ActiveMeshes,
    *,
    form: Form,
    shape: ProgramShape,
) -> Array:
    """Truncation errors ``(c,)`` of solved lanes, ``motion`` ``(c, G, N+1)`` of the
    active meshes.
    """

    def lane(numbers: list[Array], motion: Array) -> Array:
        _, problem = train_and_problem(form, numbers, held)
        return estimate(problem, active_meshes, motion, shape)

    return _each(lane, numbers, motion)


@partial(Program, static_argnames=("task", "n_speeds", "critical", "heavy"))
def combine(
    train: DriveTrain,
    z: Array,
    smooth: Array,
    valid: Array,
    weights: Array,
    widths: Array,
    scales: Array,
    *,
    task: Task,
    n_speeds: int,
    critical: int,
    heavy: tuple[bool, ...],
) -> tuple[Array, tuple[Array, ...], Array, Array]:
    """Combine readings to the objective of every design: value ``(A,)``, readings
    ``(A,)`` of the train alone, and derivatives of the value by z ``(A, P)`` and by the
    readings of responses ``(A, n, J)``.

    Speeds that are ``valid`` ``(A, n)`` enter, the first ``n_speeds`` of them into
    means, these and the last ``critical`` into penalties, all into smooth maxima.
    """
    limited = np.arange(valid.shape[1]) < n_speeds
    limited[valid.shape[1] - critical :] = True

    def cost(
        z: Array, smooth: Array, valid: Array, weights: Array
    ) -> tuple[Array, tuple[Array, ...]]:
        changed = train.replace(task.named(z))
        total = jnp.zeros(())
        readings = []
        # Readings of the objectives come first, then those of penalties: the order of
        # ``Task.of_response``.
        values = iter(smooth.T)
        for objective, share, scale, width in zip(
            task.objectives, weights.T, scales, widths, strict=True
        ):
            weighted = share * next(values) / scale
            if objective.over == "worst":
                total += objective.weight * objectives.smooth_maximum(
                    weighted, valid, width
                )
            else:
                count = jnp.maximum(valid[:n_speeds].sum(), 1)
                total += (
                    objective.weight
                    * objectives.masked_sum(weighted[:n_speeds], valid[:n_speeds])
                    / count
                )
        for penalty in task.penalties:
            if penalty.quantity in OF_DESIGN:
                is_inertia = penalty.quantity == "inertia added"
                readings.append(
                    inertia_added(changed, train, penalty.of)
                    if is_inertia
                    else frequencies_hz(changed, np.array(heavy))[penalty.mode]
                )
                total += penalty.weight * _excess(penalty, readings[-1]) ** 2
            else:
                excess = penalty.weight * _excess(penalty, next(values)) ** 2
                total += objectives.masked_sum(excess, valid & limited)
        return total, tuple(readings)

    costs = jax.vmap(jax.value_and_grad(cost, (0, 1), has_aux=True))
    (value, readings), (by_z, by_smooth) = costs(z, smooth, valid, weights)
    return value, readings, by_z, by_smooth


def _excess(penalty: Penalty, reading: Array) -> Array:
    """The excess of a reading beyond the limits, in shares of them."""
    total = jnp.zeros_like(reading)
    if penalty.most is not None:
        total += jnp.maximum(reading - penalty.most, 0.0) / abs(penalty.most)
    if penalty.least is not None:
        total += jnp.maximum(penalty.least - reading, 0.0) / abs(penalty.least)
    return total

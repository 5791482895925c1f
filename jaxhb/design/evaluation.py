"""Evaluation of designs: the objective of a tuning and its gradient, all starts at all
speeds in batches of lanes.

A lane is one design at one speed. The parameters are unbounded numbers z: a parameter
lies the share ``1 / (1 + exp(-z))`` of the way from its lower to its upper bound, on
its scale. What depends on them is done for all designs at once and ends in the numbers
of the lanes' problems; a solve per lane knows no parameters: its program serves any of
them, and a gradient passes it once whatever their number. A gradient is taken only
where the value turned out to be worth it, and only through the speeds that matter.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import namespace
from jaxhb._program import Program
from jaxhb._shown import brief
from jaxhb._threads import side_by_side
from jaxhb.balance.derivative import all_finite, only_if
from jaxhb.balance.plan import RESIDUAL
from jaxhb.balance.problem import problem_at
from jaxhb.balance.program import (
    START_SETTLED,
    active_deflections,
    differentiable,
    estimate,
    find,
    respond,
)
from jaxhb.design import objectives
from jaxhb.design.between_speeds import speeds_of
from jaxhb.design.quantities import (
    OF_DESIGN,
    QUANTITIES,
    Penalty,
    inertia_added,
    judged,
    label,
)
from jaxhb.equations import fourier
from jaxhb.excitation.torques import listed_harmonic
from jaxhb.linear.sensitivity import frequencies_hz
from jaxhb.results import answers
from jaxhb.results.status import Status
from jaxhb.solutions.planning import next_level, plan_marching, plan_speeds
from jaxhb.solutions.solve import solve

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
"""After which a lost speed gets no further attempt; most of what is not found soon has
no motion of one cycle.
"""

FEW_LANES, MANY_LANES = 16, 64  # that one program computes side by side
# |z| of a start on a bound: a thousandth of the range inside it, where the share still
# has a slope
FARTHEST = 6.9


@dataclass(frozen=True)
class Task:
    """What is tuned for what: tuples of Parameter, Objective, Penalty."""

    parameters: tuple
    objectives: tuple
    penalties: tuple
    smooth = True
    step_tolerance = 0.0
    """Newton step after which a lane is solved; 0 for the accuracy of derivatives."""

    @property
    def of_response(self):
        """The objectives, and the penalties that read a response: J of them."""
        return self.objectives + tuple(
            p for p in self.penalties if p.quantity not in OF_DESIGN
        )

    @property
    def of_design(self):
        """The penalties that read the train alone."""
        return tuple(p for p in self.penalties if p.quantity in OF_DESIGN)

    @property
    def asked(self):
        """Quantity, element and order of each reading of a response, and which of its
        readings is differentiated.
        """
        how = [
            "close" if isinstance(chosen, Penalty) else "read"
            for chosen in self.of_response
        ]
        how = how if self.smooth else ["sharp"] * len(how)
        return tuple(
            (c.quantity, c.of, c.order, reading)
            for c, reading in zip(self.of_response, how, strict=True)
        )

    def named(self, z):
        """Parameters by name, in their own units, from z ``(P,)``; floats on the
        host.
        """
        xp = namespace(z)
        share = 1 / (1 + xp.exp(-z))
        low, high = np.array([(p.low, p.high) for p in self.parameters]).T
        log = np.array([p.scale == "log" for p in self.parameters])
        # On a log scale the share of the way is that of the logarithm.
        ratio = np.log(np.where(log, high, 1.0) / np.where(log, low, 1.0))
        values = xp.where(
            log,
            np.where(log, low, 1.0) * xp.exp(share * ratio),
            low + share * (high - low),
        )
        return {
            p.name: values[i] if xp is jnp else float(values[i])
            for i, p in enumerate(self.parameters)
        }

    def unbounded(self, train):
        """z ``(P,)`` of a train, of values on a bound a little inside."""
        values = [train.value(p.name) for p in self.parameters]
        shares = [
            (
                np.log(v / p.low) / np.log(p.high / p.low)
                if p.scale == "log"
                else (v - p.low) / (p.high - p.low)
            )
            for v, p in zip(values, self.parameters, strict=True)
        ]
        with np.errstate(divide="ignore"):
            z = np.log(shares) - np.log1p(-np.array(shares))
        return np.clip(z, -FARTHEST, FARTHEST)


@dataclass(frozen=True)
class Aim:
    """What the objective is made of at present.

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
    """Designs and how they do: A starts, n speeds, P parameters, M meshes, N harmonics
    of the finest plan.

    z : ``(A, P)``; speeds : ``(A, n)`` rpm, those asked for, those that follow peaks,
    and those at critical speeds status : ``(A, n)``; plan_number : ``(A, n)``, index of
    ``plans``, the first of which serves any motion motion : complex ``(A, n, M, N+1)``
    m, deflections; resumed : bool ``(A, n)``, solved from the motion at hand alone
    smooth, exact : readings of responses ``(A, n, J)``; of_design : readings ``(A,)``
    of the train alone value : ``(A,)``; gradient : ``(A, P)``, with respect to z, nan
    where it was not asked for
    """

    z: np.ndarray
    speeds: np.ndarray
    status: np.ndarray
    plan_number: np.ndarray
    motion: np.ndarray
    resumed: np.ndarray | None = None
    smooth: np.ndarray | None = None
    exact: np.ndarray | None = None
    of_design: tuple = ()
    value: np.ndarray | None = None
    gradient: np.ndarray | None = None
    plans: tuple = field(default=(), metadata={"static": True})

    @property
    def solved(self):
        """Whether the equations are solved ``(A, n)``."""
        return answers.solved(self.status)

    @property
    def readings(self):
        """Not smoothed, of what reads a response ``(A, n)`` each, then of what reads
        the train alone ``(A,)``.
        """
        return (*np.moveaxis(self.exact, -1, 0), *self.of_design)


def where(chosen, here, there):
    """A tree of arrays ``(A, ...)`` with the designs of one where ``chosen`` ``(A,)``,
    else of the other.
    """

    def pick(one, other):
        return np.where(chosen.reshape(-1, *[1] * (np.ndim(one) - 1)), one, other)

    return jax.tree.map(pick, here, there)


@brief
@dataclass(frozen=True)
class Reading:
    """What a design does: parameters by name, whether each speed is solved ``(n,)``,
    readings by label.

    A reading is an array ``(n,)`` in SI units, nan where the speed is not solved or a
    rule has no limit, or a float for those of the train alone; its label is ``"tooth
    force of crank gear|idler"``.
    """

    parameters: dict
    solved: np.ndarray
    readings: dict

    def of_first(self, count):
        """The same of the first speeds."""
        cut = {
            name: own[:count] if np.ndim(own) else own
            for name, own in self.readings.items()
        }
        return dataclasses.replace(self, solved=self.solved[:count], readings=cut)


class Evaluator:
    """Evaluates designs of one train on the host; it holds what stays the same all the
    way down.
    """

    def __init__(self, train, rpm, task, request, peaks=0, scatter=None, critical=()):
        """``peaks`` speeds are added for every objective that is a maximum, to follow
        its highest peaks; ``scatter`` is None, or the
        :class:`~jaxhb.design.robust.Scatter` of the trains at these speeds;
        ``critical`` are the :class:`~jaxhb.design.between_speeds.Followed` at whose
        speed each design is looked at, too.
        """
        self.critical = tuple(critical)
        self.train = train
        self.rpm = rpm
        self.task = task
        self.request = request
        self.peaks = peaks
        self.followed = (
            [
                j
                for j, objective in enumerate(task.objectives)
                if objective.over == "worst"
            ]
            if peaks
            else []
        )
        self.fallback, plans = plan_designs(train, rpm, request)
        excited = listed_harmonic(train.topology)
        self.excited = excited or max(
            plan.harmonics for plan in (self.fallback, *plans)
        )
        self.heavy = tuple(
            (np.concatenate([train.disks.inertia, train.dampers.inertia]) > 0).tolist()
        )
        self.box, self.shares = (
            (scatter.box, scatter.shares)
            if scatter
            else (None, np.zeros((len(rpm), 0)))
        )
        moved = train.replace(task.named(task.unbounded(train)))
        moved = scatter.of_lanes(moved) if scatter else moved
        leaves, structure = jax.tree.flatten(
            (train, problem_at(train, float(rpm[0]), self.excited))
        )
        # What no parameter changes, as tables of pressures, is handed to programs once;
        # the rest for each lane.
        same = [
            old is new
            for old, new in zip(
                jax.tree.leaves(train), jax.tree.leaves(moved), strict=True
            )
        ]
        same += [False] * (len(leaves) - len(same))
        held = [
            keep or jnp.result_type(leaf).kind not in "fc"
            for leaf, keep in zip(leaves, same, strict=True)
        ]
        self.held = [
            jnp.asarray(leaf) for leaf, keep in zip(leaves, held, strict=True) if keep
        ]
        self.form = structure, tuple(held)

    def unsolved(self, z):
        """The Point of designs ``(A, P)`` without motions."""
        spread = (
            np.linspace(0, len(self.rpm) - 1, self.peaks * len(self.followed))
            .round()
            .astype(int)
        )
        speeds = np.tile(
            np.concatenate([self.rpm, self.rpm[spread], np.zeros(len(self.critical))]),
            (len(z), 1),
        )
        speeds = self._at_critical(z, speeds)
        motion = np.zeros(
            (*speeds.shape, len(self.train.topology.has_law), 1), dtype=complex
        )
        lost = np.full(speeds.shape, Status.MAX_STEPS)
        return self._planned(
            Point(z, speeds, lost, np.zeros_like(lost), motion, plans=(self.fallback,))
        )

    def _at_critical(self, z, speeds):
        """The speeds ``(A, n)`` with the last ones at the critical speeds of designs
        ``(A, P)``.

        There a reading is at a maximum over the speed: its derivative by z is that at a
        constant speed.
        """
        if not self.critical:
            return speeds
        trains = [self.train.replace(self.task.named(own)) for own in z]
        critical = np.array(
            [speeds_of(self.critical, train, self.rpm) for train in trains]
        )
        return np.concatenate([speeds[:, : -len(self.critical)], critical], axis=1)

    def replanned(self, point):
        """The same designs to be solved anew: the added speeds on their highest peaks,
        all planned by their numbers.
        """
        speeds = point.speeds.copy()
        into = len(self.rpm)
        near = np.tile(np.arange(speeds.shape[1]), (len(point.z), 1))
        for j in self.followed:
            values = self.weights(point.speeds)[..., j] * point.readings[j]
            for a, good in enumerate(point.solved):
                places, summits = highest_peaks(
                    point.speeds[a][good], values[a][good], self.peaks
                )
                near[a, into : into + len(places)] = np.flatnonzero(good)[places]
                speeds[a, into : into + len(places)] = summits
            into += self.peaks
        rows = np.arange(len(near))[:, None]
        status = point.status[rows, near]
        motion = point.motion[rows, near]
        return self._planned(
            dataclasses.replace(point, speeds=speeds, status=status, motion=motion)
        )

    def _planned(self, point):
        """Every design planned by its own numbers, as a changed one may shake off a
        tooth; of the plans at hand those that hold the same meshes, whose harmonics
        have proved enough.
        """
        plans = {(plan.active, plan.flank): plan for plan in point.plans}
        numbers = []
        for z, speeds in zip(point.z, point.speeds, strict=True):
            own = plan_designs(
                self.train.replace(self.task.named(z)), speeds, self.request
            )[1]
            for plan in own:
                plans.setdefault((plan.active, plan.flank), plan)
            numbers.append(
                [list(plans).index((plan.active, plan.flank)) for plan in own]
            )
        return dataclasses.replace(
            point, plans=tuple(plans.values()), plan_number=np.array(numbers)
        )

    def weights(self, speeds):
        """Factors of the objectives at all speeds ``(A, n, objectives)``, interpolated
        at the added ones.
        """
        order = np.argsort(self.rpm, kind="stable")
        columns = []
        for objective in self.task.objectives:
            given = np.array(objective.weights or np.ones(len(self.rpm)))
            columns.append(np.interp(speeds, self.rpm[order], given[order]))
            columns[-1][:, : len(self.rpm)] = given
        return np.stack(columns, axis=-1)

    def at(
        self,
        z,
        near,
        aim,
        *,
        wanted=True,
        most=np.inf,
        rescues=MOST_RESCUES,
        on_lanes=None,
    ):
        """The Point of designs z ``(A, P)`` near those of the Point ``near``.

        wanted : bool ``(A,)``, designs to be solved; the others are those of ``near``
        without value most : ``(A,)``, values above which no gradient is asked for
        rescues : lost speeds of a design that are tried from all starts of
        :func:`jaxhb.solve` on_lanes : called with the Reading of the first design,
        again and again while its speeds are solved
        """
        wanted = np.broadcast_to(wanted, len(z))
        near = dataclasses.replace(near, speeds=self._at_critical(z, near.speeds))
        lanes, pull = self.solved(
            z, near, wanted[:, None] & aim.counted, rescues=rescues, on_lanes=on_lanes
        )
        return self._valued(lanes, pull, aim, wanted, most)

    def solved(
        self, z, near, which, *, again=True, rescues=MOST_RESCUES, on_lanes=None
    ):
        """The :class:`Lanes` of designs z near those of a Point, solved where ``which``
        ``(A, n)``, lost ones from another start ``again``, and the pullback of their
        numbers to z; other arguments as of :meth:`at`.
        """
        numbers, pull = self.numbers_of(z, near.speeds)
        nothing = np.zeros((*which.shape, len(self.task.of_response)))
        motion = fourier.resize(near.motion, max(plan.harmonics for plan in near.plans))
        changes = {
            "motion": motion,
            "resumed": np.zeros_like(which),
            "smooth": nothing,
            "exact": nothing,
        }
        point = dataclasses.replace(near, z=z, of_design=(), **changes)
        lanes = Lanes(
            self, point, numbers, which, (z == near.z).all(1, keepdims=True), on_lanes
        )
        lanes = lanes.solve(which, near.solved)
        # What was lost from a march is tried from the motion of the design nearby, and
        # the other way round.
        again = (
            again
            & lanes.lost
            & near.solved
            & (lanes.point.status != Status.PLAN_VIOLATED)
        )
        lanes = lanes.solve(again & ~lanes.point.resumed, True, other=False)
        lanes = lanes.solve(again & lanes.point.resumed, False)
        violated = lanes.lost & (lanes.point.status == Status.PLAN_VIOLATED)
        lanes = lanes.with_point(
            plan_number=np.where(violated, 0, lanes.point.plan_number)
        ).solve(violated, False)
        lost = lanes.lost
        return lanes.rescue(lost & (lost.sum(1, keepdims=True) <= rescues)), pull

    def _valued(self, lanes, pull, aim, wanted, most):
        """The Point, with gradients where the value is at most ``most``; a speed
        without one counts as lost.
        """
        point = lanes.point
        status = lanes.point.status
        while True:
            kept = lanes.counted & answers.solved(status)
            weighted = (
                point.smooth,
                kept,
                self.weights(point.speeds),
                aim.widths,
                aim.scales,
            )
            shape = {
                "task": self.task,
                "own": len(self.rpm),
                "critical": len(self.critical),
                "heavy": self.heavy,
            }
            combined = combine(self.train, point.z, *weighted, **shape)
            value, of_design, by_z, by_smooth = jax.tree.map(np.asarray, combined)
            # A line search rejects higher values without their gradients, which cost as
            # much as the solves.
            steep = wanted & (value <= most)
            by_numbers = lanes.pulled(np.where(steep[:, None, None], by_smooth, 0.0))
            whole = np.all(
                [
                    np.isfinite(by).all(axis=tuple(range(2, by.ndim)))
                    for by in by_numbers
                ],
                axis=0,
            )
            if (whole | ~kept).all():
                break
            # Near a fold the equations are solved and their derivative is not: the
            # speed is lost, and the rest evaluated without it.
            status = np.where(kept & ~whole, Status.STALLED, status)
        gradient = np.where(
            steep[:, None], by_z + np.asarray(pull_back(pull, by_numbers)), np.nan
        )
        return dataclasses.replace(
            point, status=status, value=value, gradient=gradient, of_design=of_design
        )

    def finer(self, point, counted):
        """The point under plans of more harmonics where counted speeds need them, None
        where none does.
        """
        plans = list(point.plans)
        counted = counted & point.solved & (not self.request.harmonics)
        numbers = self.numbers_of(point.z, point.speeds)[0] if counted.any() else None
        for number, plan in enumerate(point.plans):
            higher = next_level(plan.harmonics, plan.method) if plan.active else None
            lanes = (
                np.argwhere(counted & (point.plan_number == number)) if higher else ()
            )
            for chunk, padded in batches(lanes, plan):
                motion = of_active_meshes(point.motion[tuple(padded.T)], plan)
                own = [leaf[tuple(padded.T)] for leaf in numbers]
                errors = estimate_lanes(
                    own,
                    self.held,
                    motion,
                    plan.active_meshes,
                    form=self.form,
                    sizes=plan.static,
                )
                if (np.asarray(errors)[: len(chunk)] > plan.goals[0]).any():
                    plans[number] = dataclasses.replace(
                        plan, harmonics=higher, tolerance_share=1.0
                    )
                    break
        return (
            dataclasses.replace(point, plans=tuple(plans))
            if tuple(plans) != point.plans
            else None
        )

    def numbers_of(self, z, speeds):
        """Numbers of all lanes ``(A, n, ...)`` of designs z, and the pullback to z."""
        shape = {
            "task": self.task,
            "box": self.box,
            "excited": self.excited,
            "held": self.form[1],
        }
        shares = np.resize(
            self.shares, (speeds.shape[1], self.shares.shape[1])
        )  # of a box there are no added speeds
        numbers, pull = problems_of_designs(self.train, speeds, shares, z, **shape)
        return [np.asarray(leaf) for leaf in numbers], pull

    def reading(self, point, design):
        """The :class:`Reading` of one design, of as much as is known."""
        solved = point.solved[design, : len(self.rpm)]
        told = {}
        for chosen, values in zip(
            self.task.of_response + self.task.of_design, point.readings, strict=False
        ):
            if chosen.quantity in OF_DESIGN:
                told[label(chosen)] = float(values[design])
            else:
                kept = solved & judged(self.train, chosen, self.rpm)
                told[label(chosen)] = np.where(
                    kept, values[design][: len(solved)], np.nan
                )
        return Reading(self.task.named(point.z[design]), solved, told)

    def described(self, point, design):
        """The plans of one design, for people."""
        numbers, counts = np.unique(point.plan_number[design], return_counts=True)
        return "; ".join(
            f"{n} speeds: {point.plans[k]}"
            for k, n in zip(numbers, counts, strict=True)
        )


SOLVED = (
    "status",
    "motion",
    "resumed",
    "smooth",
    "exact",
)  # fields of Point that a solve gives


@dataclass(frozen=True)
class Lanes:
    """The lanes of one evaluation, as far as they are solved: each attempt gives
    others.

    numbers : arrays ``(A, n, ...)``; counted : ``(A, n)``, lanes that enter the
    objective unmoved : ``(A, 1)``, designs that are those of the motions at hand;
    on_lanes : None, or called with a Reading batches : (lanes, padded lanes,
    derivative) of each batch solved
    """

    evaluator: Evaluator
    point: Point
    numbers: list
    counted: np.ndarray
    unmoved: np.ndarray
    on_lanes: Callable | None = None
    batches: tuple = ()

    @property
    def lost(self):
        """Lanes that count and are not solved ``(A, n)``."""
        return self.counted & ~self.point.solved

    def with_point(self, **changes):
        """The lanes with changes of their point."""
        return dataclasses.replace(
            self, point=dataclasses.replace(self.point, **changes)
        )

    def solve(self, which, given, other=True):
        """Solve ``which`` ``(A, n)``, from the motion at hand where it is ``given`` and
        no ``other`` start is better.

        A march is where the motion at hand leaves more of the equations; teeth in
        contact are, where none separates, once the design has changed.
        """
        changes = {name: getattr(self.point, name).copy() for name in SOLVED}
        made = self.with_point(**changes)
        for number in np.unique(self.point.plan_number[which]):
            plan = self.point.plans[number]
            own = np.broadcast_to(
                given & (plan.marches | self.unmoved | (not other)), which.shape
            )
            chunks = list(
                batches(np.argwhere(which & (self.point.plan_number == number)), plan)
            )

            def read(pair, plan=plan, own=own):
                at = tuple(pair[1].T)
                return self._read(plan, at, own[at], plan.marches and other)

            for (chunk, padded), (found, pull) in zip(
                chunks, side_by_side(read, chunks), strict=True
            ):
                for name, values in zip(SOLVED, found, strict=True):
                    changes[name][tuple(chunk.T)] = np.asarray(values)[: len(chunk)]
                made = dataclasses.replace(
                    made, batches=(*made.batches, (chunk, padded, pull))
                )
                if self.on_lanes:
                    self.on_lanes(self.evaluator.reading(made.point, 0))
        return made

    def _read(self, plan, at, given, marching):
        """The fields SOLVED of the lanes ``at`` under a plan, and the pullback from
        their readings.
        """
        point = self.point
        evaluator = self.evaluator
        motion = np.zeros((len(given), 0, plan.harmonics + 1), complex)
        motion = of_active_meshes(point.motion[at], plan) if plan.active else motion
        start = (
            motion,
            given,
            np.full(len(given), plan.cycles * marching),
            np.full(len(given), START_SETTLED),
        )
        goals = np.tile([1.0, RESIDUAL, evaluator.task.step_tolerance], (len(given), 1))
        # Whether a plan has enough harmonics is asked by itself.
        changes = {
            "max_steps": NEWTON_STEPS,
            "estimated": False,
            "compare_starts": True,
        }
        changes |= {"start": "march", "averaged": True}
        shape = {"form": evaluator.form, "asked": evaluator.task.asked}
        shape["sizes"] = dataclasses.replace(plan.static, **changes)
        lanes = [leaf[at] for leaf in self.numbers], evaluator.held, point.speeds[at]
        smooth, found, (status, sweeps, motion, exact) = read_lanes(
            *lanes, start, goals, plan.active_meshes, **shape
        )
        motion = fourier.resize(np.asarray(motion), point.motion.shape[-1] - 1)
        solved = status, motion, given & (np.asarray(sweeps) == 0), smooth, exact
        return solved, partial(pull_lanes, *lanes, found, plan.active_meshes, **shape)

    def rescue(self, which):
        """Solve ``which`` one by one, from all starts of :func:`jaxhb.solve`, and from
        there under the largest plan.
        """
        point = self.point
        plan = self.point.plans[0]
        found = np.zeros_like(which)
        motion = point.motion.copy()
        for a, i in np.argwhere(which) if plan.active else ():
            train = self.evaluator.train.replace(self.evaluator.task.named(point.z[a]))
            box = self.evaluator.box
            train = (
                train.replace(box.scaled(train, self.evaluator.shares[i]))
                if box
                else train
            )
            own = {
                "harmonics": plan.harmonics,
                "integrals": plan.integrals,
                "seconds": RESCUE_SECONDS,
            }
            response = solve(train, rpm=float(point.speeds[a, i]), **own)
            if response.solved:
                found[a, i] = True
                motion[a, i] = fourier.resize(
                    np.asarray(response.deflections), motion.shape[-1] - 1
                )
        made = self.with_point(
            plan_number=np.where(found, 0, point.plan_number), motion=motion
        )
        return made.solve(found, True, other=False)

    def pulled(self, by_smooth):
        """The derivatives of the objective by the numbers of every lane, from that by
        its readings.
        """
        by_numbers = [np.zeros_like(leaf) for leaf in self.numbers]
        size = np.abs(by_smooth * self.point.smooth)
        # Of a smooth maximum few speeds have a weight: a gradient is pulled through
        # these alone.
        left = size.max(axis=(1, 2), keepdims=True) * NEGLIGIBLE < size
        calls = []
        for chunk, padded, pull in reversed(self.batches):
            into = tuple(chunk.T)
            cotangent = np.zeros((len(padded), by_smooth.shape[-1]))
            own = left[into]
            left[into] = False  # of the attempts at a lane the last one counts
            if own.any():
                cotangent[: len(chunk)] = np.where(own, by_smooth[into], 0.0)
                calls.append((into, pull, cotangent))
        for (into, *_), parts in zip(
            calls, side_by_side(lambda call: call[1](call[2]), calls), strict=True
        ):
            for by, part in zip(by_numbers, parts, strict=True):
                by[into] += np.asarray(part)[: len(into[0])]
        return by_numbers


def plan_designs(train, rpm, request):
    """The plan of speeds that leave theirs, every mesh an unknown and as fine as the
    finest; and a plan for each.
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


def _level_with_room(plan):
    """The next level where teeth leave contact without separating: cheaper than
    programs for two levels.
    """
    return (
        plan.active and not plan.marches and next_level(plan.harmonics, plan.method)
    ) or plan.harmonics


def batches(lanes, plan):
    """Batches of ``lanes`` ``(k, 2)`` and the same padded to one of few sizes: a size
    is a program.
    """
    # With contacts as unknowns a lane fills a processor.
    alone = plan.active and jax.default_backend() == "cpu"
    size = 1 if alone else FEW_LANES if len(lanes) <= MANY_LANES else MANY_LANES
    for first in range(0, len(lanes), max(size, 1)):
        chunk = lanes[first : first + size]
        yield (
            chunk,
            np.concatenate([chunk, np.repeat(chunk[-1:], size - len(chunk), axis=0)]),
        )


def of_active_meshes(motion, plan):
    """Deflections ``(c, G, N+1)`` of the active meshes of a plan from those of all."""
    return fourier.resize(active_deflections(plan, motion), plan.harmonics)


def highest_peaks(speeds, values, most):
    """The highest local maxima of a curve: their places in ``speeds``, and where the
    parabolas through them culminate.

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
    left = x[middle] - x[middle - 1]
    right = x[middle + 1] - x[middle]
    # Vertex of the parabola through three speeds that need not be equidistant.
    rise = (y[middle] - y[middle - 1]) / left
    fall = (y[middle + 1] - y[middle]) / right
    return places[middle], x[middle] + (rise * right + fall * left) / (
        2 * (rise - fall)
    )


@partial(Program, static_argnames=("task", "box", "excited", "held"))
def problems_of_designs(train, rpm, shares, z, *, task, box, excited, held):
    """The numbers of train and problem, less those ``held``, of every lane at ``rpm``
    ``(A, n)``, of a ``box`` at the ``shares`` ``(n, ...)``: arrays ``(A, n, ...)``, and
    their pullback to z ``(A, P)``.
    """

    def lane(z, speed, share):
        changed = train.replace(task.named(z))
        changed = changed.replace(box.scaled(changed, share)) if box else changed
        leaves = jax.tree.leaves((changed, problem_at(changed, speed, excited)))
        return [leaf for leaf, keep in zip(leaves, held, strict=True) if not keep]

    return jax.vjp(
        lambda z: jax.vmap(jax.vmap(lane, (None, 0, 0)), (0, 0, None))(z, rpm, shares),
        z,
    )


def train_and_problem(form, numbers, held):
    """Those of a lane from its numbers and what all lanes share; form: their structure,
    and which leaves are held.
    """
    numbers = iter(numbers)
    held = iter(held)
    return jax.tree.unflatten(
        form[0], [next(held if keep else numbers) for keep in form[1]]
    )


@partial(Program, static_argnames=("form", "asked", "sizes"))
def read_lanes(numbers, held, rpm, start, goals, active_meshes, *, form, asked, sizes):
    """Solve ``c`` lanes of one plan: smooth readings ``(c, J)``; the solutions, for
    :func:`pull_lanes`; and status ``(c,)``, sweeps to its start or 0 ``(c,)``,
    deflections of all meshes ``(c, M, N+1)``, exact readings.
    """

    def lane(numbers, speed, start, goals):
        train, problem = train_and_problem(form, numbers, held)
        found = find(problem, active_meshes, start, goals, sizes)
        response = respond(train, speed, problem, found[0], sizes)
        exact = [
            QUANTITIES[quantity].exact_value(response, of, order)
            for quantity, of, order, _ in asked
        ]
        outcome = (
            jnp.asarray(response.status),
            found[0].sweeps,
            response.deflections,
            jnp.stack(exact),
        )
        return _differentiated(response, asked), found, outcome

    return _each(lane, numbers, rpm, start, goals)


@partial(Program, static_argnames=("form", "asked", "sizes"))
def pull_lanes(
    numbers, held, rpm, found, active_meshes, cotangent, *, form, asked, sizes
):
    """What a derivative by the readings ``(c, J)`` of lanes ``found`` by
    :func:`read_lanes` is by their numbers.
    """

    def lane(numbers, speed, found, cotangent):
        def read(numbers):
            train, problem = train_and_problem(
                form, only_if(all_finite(numbers), numbers), held
            )
            outcome = differentiable(problem, active_meshes, found, sizes)
            return _differentiated(
                respond(train, speed, problem, outcome, sizes), asked
            )

        return jax.vjp(read, numbers)[1](cotangent)[0]

    return _each(lane, numbers, rpm, found, cotangent)


def _differentiated(response, asked):
    """What a gradient is taken of: smooth readings, or sharp ones."""
    # Who asks for sharp ones wants the slope of one time sample: no warning.
    response = dataclasses.replace(response, sharp=False)
    return jnp.stack(
        [
            QUANTITIES[quantity].differentiated(how)(response, of, order, None)
            for quantity, of, order, how in asked
        ]
    )


def _each(lane, *batch):
    """``lane`` of every lane; of a single one without ``vmap``, under which a condition
    runs both its branches.
    """
    if len(jax.tree.leaves(batch)[0]) > 1:
        return jax.vmap(lane)(*batch)
    return jax.tree.map(
        lambda leaf: jnp.asarray(leaf)[None],
        lane(*jax.tree.map(lambda leaf: leaf[0], batch)),
    )


@partial(Program, static_argnames=("form", "sizes"))
def estimate_lanes(numbers, held, motion, active_meshes, *, form, sizes):
    """Truncation errors ``(c,)`` of solved lanes, ``motion`` ``(c, G, N+1)`` of the
    active meshes.
    """

    def lane(numbers, motion):
        return estimate(
            train_and_problem(form, numbers, held)[1], active_meshes, motion, sizes
        )

    return _each(lane, numbers, motion)


@Program
def pull_back(pull, cotangent):
    """What a pullback that a program handed out makes of a cotangent."""
    return pull(cotangent)[0]


@partial(Program, static_argnames=("task", "own", "critical", "heavy"))
def combine(
    train, z, smooth, kept, weights, widths, scales, *, task, own, critical, heavy
):
    """The objective of every design: value ``(A,)``, readings ``(A,)`` of the train
    alone, and derivatives of the value by z ``(A, P)`` and by the readings of responses
    ``(A, n, J)``.

    Speeds ``kept`` ``(A, n)`` enter, the first ``own`` of them into means, these and
    the last ``critical`` into penalties, all into smooth maxima.
    """
    limited = np.arange(kept.shape[1]) < own
    limited[kept.shape[1] - critical :] = True

    def cost(z, smooth, kept, weights):
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
                    weighted, kept, width
                )
            else:
                count = jnp.maximum(kept[:own].sum(), 1)
                total += (
                    objective.weight
                    * objectives.masked_sum(weighted[:own], kept[:own])
                    / count
                )
        for penalty in task.penalties:
            if penalty.quantity in OF_DESIGN:
                added = penalty.quantity == "inertia added"
                hz = None if added else frequencies_hz(changed, np.array(heavy))
                readings.append(
                    inertia_added(changed, train, penalty.of)
                    if added
                    else hz[penalty.mode]
                )
                total += penalty.weight * _excess(penalty, readings[-1]) ** 2
            else:
                excess = penalty.weight * _excess(penalty, next(values)) ** 2
                total += objectives.masked_sum(excess, kept & limited)
        return total, tuple(readings)

    (value, readings), slopes = jax.vmap(
        jax.value_and_grad(cost, (0, 1), has_aux=True)
    )(z, smooth, kept, weights)
    return value, readings, *slopes


def _excess(penalty, reading):
    """What lies beyond the limits, in shares of them."""
    total = jnp.zeros_like(reading)
    if penalty.most is not None:
        total += jnp.maximum(reading - penalty.most, 0.0) / abs(penalty.most)
    if penalty.least is not None:
        total += jnp.maximum(penalty.least - reading, 0.0) / abs(penalty.least)
    return total

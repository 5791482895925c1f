"""One evaluation of a tuning under way: lanes solved, some of them again, and put together to an objective."""

from dataclasses import dataclass
from functools import partial

import jax
import numpy as np

from jaxhb.balance.planned import BATCH, active_deflections
from jaxhb.balance.program import Start
from jaxhb.design.lanes import EVALUATION, combine, lane_sizes, pull_back, pull_lanes, read_lanes
from jaxhb.design.quantities import OF_DESIGN
from jaxhb.equations import fourier
from jaxhb.results.status import Status
from jaxhb.solutions.solve import solve


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Point:
    """Designs and how they do: A starts, n speeds, P parameters, M meshes, N harmonics of the finest plan.

    z : ``(A, P)``; value : ``(A,)``; gradient : ``(A, P)``, with respect to z, nan where it was not asked for
    status : ``(A, n)``; plan_number : ``(A, n)``; motion : complex ``(A, n, M, N+1)`` m, deflections
    readings : of each objective and then each penalty, not smoothed, ``(A, n)``; those of the train alone ``(A,)``
    """

    z: np.ndarray
    value: np.ndarray
    gradient: np.ndarray
    status: np.ndarray
    plan_number: np.ndarray
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


class Evaluation:
    """One evaluation under way: lanes are solved, some of them again, and what came of them is put together."""

    def __init__(self, evaluator, z, near, counted, wanted):
        task, shape = evaluator.task, near.status.shape
        self.evaluator, self.z, self.counted, self.wanted = evaluator, z, counted, wanted
        self.numbers, self.pull = evaluator.numbers_of(z)
        self.plan_number, self.status = near.plan_number.copy(), near.status.copy()
        self.resumed = np.zeros(shape, dtype=bool)
        self.unmoved = (z == near.z).all(1, keepdims=True)
        harmonics = max(plan.harmonics for plan in evaluator.plans)
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
        for number in np.unique(self.plan_number[lanes]):
            plan = self.evaluator.plans[number]
            marching = plan.marches
            own = given & (marching | self.unmoved | (not other))
            for chunk, padded in batches(np.argwhere(lanes & (self.plan_number == number)), plan):
                self._read(plan, chunk, padded, own[tuple(padded.T)], plan.cycles if marching and other else 0)

    def _read(self, plan, chunk, padded, given, cycles):
        evaluator, at, into = self.evaluator, tuple(padded.T), tuple(chunk.T)
        start = Start(
            of_active_meshes(self.motion[at], plan)
            if plan.active
            else np.zeros((len(padded), 0, plan.harmonics + 1), complex),
            given,
            np.full(len(padded), cycles),
            np.full(len(padded), EVALUATION.settled),
        )
        lanes = self.numbers[at], evaluator.held, evaluator.speeds[at]
        shape = {"form": evaluator.form, "asked": evaluator.task.asked, "sizes": lane_sizes(plan)}
        smooth, found, outcome = read_lanes(*lanes, start, plan.active_meshes, **shape)
        status, periodicity_error, motion, exact = (np.asarray(a)[: len(chunk)] for a in outcome)
        self.owner[into] = len(self.pulls)
        self.pulls.append((chunk, padded, partial(pull_lanes, *lanes, found, plan.active_meshes, **shape)))
        self.smooth[into], self.exact[into] = np.asarray(smooth)[: len(chunk)], exact
        self.status[into], self.resumed[into] = status, given[: len(chunk)] & (periodicity_error == 0)
        self.motion[into] = 0.0
        self.motion[(*into, slice(None), slice(0, motion.shape[-1]))] = motion
        evaluator.report(self)

    def climb(self, lanes):
        """Solve ``lanes`` one by one, up the ladder of :func:`jaxhb.solve`, and from there under the largest plan.

        Each has a bounded time, and one attempt in any case: most of what is not found soon has no motion of one cycle.
        """
        evaluator, plan, found = self.evaluator, self.evaluator.plans[0], np.zeros_like(lanes)
        for a, i in np.argwhere(lanes) if plan.active else ():
            train = evaluator.train.replace(evaluator.values(self.z[a]))
            own = {"harmonics": plan.harmonics, "integrals": plan.integrals, "seconds": EVALUATION.seconds}
            response = solve(train, rpm=float(evaluator.speeds[a, i]), **own)
            if response.status <= Status.TOLERANCE_NOT_MET:
                found[a, i] = True
                self.plan_number[a, i] = 0
                self.motion[a, i] = 0.0
                self.motion[a, i, :, : response.deflections.shape[-1]] = response.deflections
        self.solve(found, True, other=False)

    def point(self, most):
        """The Point, with gradients where the value is at most ``most``; a speed without one counts as lost."""
        evaluator, task = self.evaluator, self.evaluator.task
        while True:
            kept = self.wanted[:, None] & self.counted & (self.status <= Status.TOLERANCE_NOT_MET)
            numbers = evaluator.weights(), evaluator.widths, evaluator.scales
            combined = combine(evaluator.train, self.z, self.smooth, kept, *numbers, task=task, own=len(evaluator.rpm))
            value, of_design, by_z, by_smooth = jax.tree.map(np.asarray, combined)
            # A line search rejects higher values without their gradients, which cost as much as the solves.
            steep = self.wanted & (value <= most)
            lanes = self._pulled(np.where(steep[:, None, None], by_smooth, 0.0))
            whole = np.isfinite(lanes).all(axis=-1)
            if (whole | ~kept).all():
                break
            # Near a fold the equations are solved and their derivative is not: the speed is lost, and the rest
            # evaluated without it.
            self.status[kept & ~whole] = Status.STALLED
        gradient = by_z + np.asarray(pull_back(self.pull, lanes))
        exact, of_design = iter(np.moveaxis(self.exact, -1, 0)), iter(of_design)
        chosen = (*task.objectives, *task.penalties)
        return Point(
            z=self.z,
            value=value,
            gradient=np.where(steep[:, None], gradient, np.nan),
            status=self.status,
            plan_number=self.plan_number,
            motion=self.motion,
            readings=tuple(next(of_design if c.quantity in OF_DESIGN else exact) for c in chosen),
        )

    def _pulled(self, by_smooth):
        """The derivative of the objective by the numbers of every lane, from that by its readings."""
        by_numbers = np.zeros_like(self.numbers)
        size = np.abs(by_smooth * self.smooth)
        # Of a smooth maximum few speeds have a weight: a gradient is pulled through these alone.
        counts = size.max(axis=(1, 2), keepdims=True) * EVALUATION.negligible < size
        for number, (chunk, padded, pull) in enumerate(self.pulls):
            into = tuple(chunk.T)
            own = (self.owner[into] == number)[:, None] & counts[into]
            if own.any():
                cotangent = np.zeros((len(padded), by_smooth.shape[-1]))
                cotangent[: len(chunk)] = np.where(own, by_smooth[into], 0.0)
                by_numbers[into] += np.asarray(pull(cotangent))[: len(chunk)]
        return by_numbers


def batches(lanes, plan):
    """Batches of ``lanes`` ``(k, 2)`` and the same padded to one of few sizes: a size is a program."""
    few = 2 * BATCH.speeds
    size = min(-(-len(lanes) // few), 4) * few
    if jax.default_backend() == "cpu" and plan.active:
        size = 1 if plan.harmonics >= EVALUATION.alone else BATCH.speeds
    for first in range(0, len(lanes), max(size, 1)):
        chunk = lanes[first : first + size]
        yield chunk, np.concatenate([chunk, np.repeat(chunk[-1:], size - len(chunk), axis=0)])


def of_active_meshes(motion, plan):
    """Deflections ``(c, G, N+1)`` of the active meshes of a plan from those of all."""
    return fourier.resize(active_deflections(plan, motion), plan.harmonics)

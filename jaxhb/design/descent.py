"""The way down: steps of all starts side by side, none of which loses a speed, and their history."""

import time
from dataclasses import dataclass

import jax
import numpy as np

from jaxhb.elements.elements import SceneError
from jaxhb.results.status import Status


@dataclass(frozen=True)
class DescentOptions:
    """How designs descend.

    Parameters
    ----------
    longest : largest change of a z in one step: the share of the range then moves by at most 0.36
    trials : lengths of a step that are tried at most
    expansions : of these, trials from which on a step is taken that falls without Wolfe's condition
    decrease, curvature : of the line search: Armijo's and Wolfe's conditions
    again : times that the last width is taken up again where peaks are followed
    flat : largest slope, as a share of the objective, at which nothing is left to win
    """

    longest: float = 1.5
    trials: int = 12
    expansions: int = 2
    decrease: float = 1e-4
    curvature: float = 0.9
    again: int = 2
    flat: float = 1e-7


DESCENT = DescentOptions()


@dataclass(frozen=True)
class Step:
    """One accepted step of a tuning.

    number : 0 is the start; objective : of the best design; parameters : of the best design by name
    gradient_norm : of the best design, with respect to z; valid : speeds solved there; width : of the smooth maximum
    start : which of the starts is best; evaluations : so far, of all starts at once; plan : of the solves
    seconds : since the beginning
    """

    number: int
    objective: float
    parameters: dict
    gradient_norm: float
    valid: int
    width: float
    start: int
    evaluations: int
    plan: str
    seconds: float


class Descent:
    """The designs of all starts as they are now, the best ones, and the history of the best of all."""

    def __init__(self, evaluator, optimizer, *, searching, rate, widths, improvement, patience, on_step):
        """``optimizer``: an optax transformation; ``searching``: with line search, else strides of ``rate``."""
        self.evaluator, self.optimizer, self.searching, self.rate = evaluator, optimizer, searching, rate
        self.widths, self.improvement, self.patience, self.on_step = widths, improvement, patience, on_step
        self.update = jax.jit(jax.vmap(optimizer.update))
        self.history, self.began = [], time.monotonic()

    def run(self, z, steps):
        """From the designs z to the end, or to Ctrl-C.

        Returns
        -------
        first, best : Point; winner : int, number of the best start; stopped : str; interrupted : bool
        """
        first = self.best = self.point = self._first(z)
        self._note(0)
        try:
            stopped, interrupted = self._stages(steps), False
        except KeyboardInterrupt:
            stopped, interrupted = "stopped by the user", True
        return first, self.best, self._winner(self.best), stopped, interrupted

    def _first(self, z):
        """The starts, solved; objectives from now on are shares of those of the train as it is."""
        evaluator = self.evaluator
        point = evaluator.first(z)
        if not point.solved[0].any():
            raise SceneError(_nothing_solved(evaluator, point.status[0]))
        while evaluator.finer_plans(point, point.solved):
            point = evaluator.at(z, point, point.solved)
        if evaluator.peaks:
            point = evaluator.at(z, evaluator.replanned(evaluator.follow_peaks(point)), point.solved)
        self.counted = point.solved
        chosen = zip(evaluator.task.objectives, point.readings, strict=False)
        evaluator.scales = np.array([_size(objective, values[0][point.solved[0]]) for objective, values in chosen])
        self._sharpen(self.widths[0], point)
        return evaluator.at(z, point, self.counted)

    def _sharpen(self, share, point):
        """Smooth maxima of the width ``share`` of the worst value of the best design."""
        best, self.share = self._winner(point), share
        chosen = zip(self.evaluator.task.objectives, point.readings, strict=False)
        worst = [_size(objective, values[best][point.solved[best]]) for objective, values in chosen]
        self.evaluator.widths = share * np.array(worst) / self.evaluator.scales

    def _stages(self, steps):
        """Each width in turn until nothing is won or the steps are used up."""
        number, again = 0, self.widths[-1:] * DESCENT.again if self.evaluator.peaks else ()
        for stage, width in enumerate((*self.widths, *again)):
            self.sharpened = stage > 0
            if stage:
                self._sharpen(width, self.best)
                self.best = self.evaluator.replanned(self.evaluator.follow_peaks(self.best))
                self._renew()
            while True:
                ended, number = self._descend(number, steps)
                if not self.evaluator.finer_plans(self.best, self.counted):
                    break
                self._renew()
            if ended:
                return f"stopped after {steps} steps, which is all that was allowed"
        return "stopped where nothing more is won"

    def _descend(self, number, steps):
        """Steps at one width: (whether the steps are used up, their number)."""
        idle, memory = np.zeros(len(self.point.z), dtype=int), self._memory()
        while number < steps:
            # A design rests when its last steps won too little or its slope is gone; the others go on beside it.
            steep = np.abs(self.point.gradient).max(1) > DESCENT.flat * np.abs(self.point.value)
            moving = (idle < self.patience) & steep
            if not moving.any():
                return False, number
            direction, memory = self._direction(memory)
            before = self.point
            after, moved = self._step(before, direction, moving)
            number += 1
            self.point = after.where(moved, before)
            won = self.best.value - self.point.value
            idle = np.where(won > self.improvement * np.abs(self.best.value), 0, idle + 1)
            idle = np.where(moved, idle, np.maximum(idle, self.patience - 1))  # once more, along the gradient
            self.best = self.point.where(won > 0, self.best)
            # Between plans the objective jumps by its truncation error: such a step says nothing about curvature.
            other = (self.point.plan_number != before.plan_number).any(1)
            memory = self._without_curvature(memory, before, moved & ~other)
            if self._more_speeds():
                self._renew()
                memory = self._memory()
            self._note(number)
        return True, number

    def _step(self, point, direction, moving):
        return (self._search if self.searching else self._stride)(point, direction, moving)

    def _stride(self, point, direction, moving):
        """One step of Adam, halved while it loses a speed: (Point, whether each design moved)."""
        length, best, moved = np.full(len(point.z), self.rate), point, np.zeros(len(point.z), dtype=bool)
        for _ in range(DESCENT.trials):
            trial = self.evaluator.at(
                point.z + length[:, None] * direction, point, self.counted, wanted=moving & ~moved
            )
            good = self._kept(trial) & moving & ~moved
            best, moved = trial.where(good, best), moved | good
            if (moved | ~moving).all():
                break
            length = np.where(moved, length, length / 2)
        return best, moved

    def _search(self, point, direction, moving):
        """Line search of Lewis and Overton for all designs at once: (Point, whether each design moved)."""
        slope = np.sum(point.gradient * direction, axis=1)
        low, high, length = np.zeros(len(slope)), np.full(len(slope), np.inf), np.ones(len(slope))
        best, moved, done = point, np.zeros(len(slope), dtype=bool), ~moving | ~(slope < 0)
        for trial in range(DESCENT.trials):
            if done.all():
                break
            z = point.z + np.where(done, 0.0, length)[:, None] * direction
            most = point.value + DESCENT.decrease * length * slope
            at = self.evaluator.at(z, point, self.counted, wanted=~done, most=most)
            falls = self._kept(at) & (at.value <= most) & ~done
            # Weak Wolfe conditions by bisection, which ends at the kinks of a worst value, too (Lewis and Overton,
            # Math. Program. 141 (2013) 135): a step that rises is the new ``high``, one still steep the new ``low``.
            curved = np.sum(at.gradient * direction, axis=1) >= DESCENT.curvature * slope
            best, moved = at.where(falls & (at.value <= best.value), best), moved | falls
            done |= falls & (curved | (trial >= DESCENT.expansions))
            high, low = np.where(falls | done, high, length), np.where(falls, length, low)
            done |= moved & ~falls & (trial >= DESCENT.expansions)
            length = np.where(np.isinf(high), 2 * length, (low + np.minimum(high, 1e300)) / 2)
        return best, moved

    def _kept(self, point):
        """Whether each design still has every speed that counts, and a finite value and gradient."""
        finite = np.isfinite(point.value) & np.isfinite(point.gradient).all(1)
        return finite & (point.solved | ~self.counted).all(1)

    def _more_speeds(self):
        """Whether a speed is solved that was not: it counts from now on."""
        counted = self.counted | self.point.solved
        more = (counted != self.counted).any()
        self.counted = counted
        return bool(more)

    def _renew(self):
        """The best designs under the present plans, widths and speeds, less what finer plans lose for good."""
        self.point = self.evaluator.at(self.best.z, self.best, self.counted, ladder=len(self.counted[0]))
        self.counted = self.counted & self.point.solved
        self.best = self.point

    def _memory(self):
        self.fresh = np.full(len(self.point.z), self.sharpened)
        return jax.vmap(self.optimizer.init)(self.point.z)

    def _direction(self, memory):
        """Descent directions ``(A, P)``, no component longer than the longest, and the optimiser's memory."""
        updates, memory = self.update(self.point.gradient, memory, self.point.z)
        direction = -np.asarray(updates)
        # With gradients of two sides of a kink in its memory L-BFGS may point uphill.
        uphill = np.sum(direction * self.point.gradient, axis=1) >= 0
        if self.searching:
            direction = np.where(uphill[:, None], -self.point.gradient, direction)
            square = np.maximum(np.sum(self.point.gradient**2, axis=1), 1e-300)
            promised = np.minimum(1.0, 2 * self.share * np.abs(self.point.value) / square)  # a kink is as wide as that
            direction *= np.where(self.fresh, promised, 1.0)[:, None]
        longest = np.maximum(np.abs(direction).max(1), 1e-300)
        return direction * np.minimum(1.0, DESCENT.longest / longest)[:, None], memory

    def _without_curvature(self, memory, before, moved):
        """L-BFGS begins anew where a step did not turn the gradient the right way."""
        if not self.searching:
            return memory
        change = (self.point.z - before.z) * (self.point.gradient - before.gradient)
        # L-BFGS needs s . y > 0: without, its matrix is not positive definite any more.
        bad = ~moved | ~(change.sum(1) > 0)
        fresh = self._memory()
        self.fresh &= bad
        return jax.tree.map(
            lambda new, old: np.where(bad.reshape(-1, *[1] * (np.ndim(old) - 1)), new, old), fresh, memory
        )

    @staticmethod
    def _winner(point):
        """The start that keeps most speeds and, among those, has the lowest objective."""
        return int(np.lexsort((point.value, -point.solved.sum(1)))[0])

    def _note(self, number):
        evaluator, best = self.evaluator, self._winner(self.best)
        step = Step(
            number=number,
            objective=float(self.best.value[best]),
            parameters=evaluator.values(self.best.z[best]),
            gradient_norm=float(np.linalg.norm(self.best.gradient[best])),
            valid=int(self.best.solved[best, : len(evaluator.rpm)].sum()),
            width=self.share,
            start=best,
            evaluations=evaluator.calls,
            plan=evaluator.described(self.best, best),
            seconds=time.monotonic() - self.began,
        )
        self.history.append(step)
        self.on_step(step)


def _size(objective, values):
    """What one unit of an objective is: its value at the start."""
    values = np.asarray(values)
    size = float(values.max() if objective.over == "worst" else values.mean())
    return size if size > 0 else 1.0


def _nothing_solved(evaluator, status):
    name, rpm = evaluator.train.topology.title, evaluator.rpm
    names, counts = np.unique([Status(int(s)).name for s in status], return_counts=True)
    found = ", ".join(f"{count} {name}" for name, count in zip(names, counts, strict=True))
    way = "choose other speeds, more damping, or look at them with jaxhb sweep."
    if any(evaluator.train.topology.mesh_backlash):
        way = (
            "where teeth hammer there may be no periodic motion to follow. Tune a copy of the scene without the"
            " backlash keys, or other speeds, or begin with more damping; then check the result with backlash by jaxhb"
            " sweep."
        )
    return (
        f"{name}: none of the {len(rpm)} speeds from {rpm.min():g} to {rpm.max():g} rpm converges at the start "
        f"({found}): {way}"
    )

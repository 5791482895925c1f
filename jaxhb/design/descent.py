"""The way down: steps of all starts side by side, none of which loses a speed, and
their history. Imports optax.
"""

import dataclasses
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import jax
import numpy as np
import optax

from jaxhb._shown import counts
from jaxhb.design.evaluation import Aim, Evaluator, Point, Reading, where
from jaxhb.elements.sentences import SceneError
from jaxhb.results.checkpoint import computed
from jaxhb.results.status import Status

OPTIMIZERS = {"lbfgs": optax.scale_by_lbfgs, "adam": optax.scale_by_adam}
Optimizer: TypeAlias = str | optax.GradientTransformation

# Largest change of a z in one step: the share of the range then moves by at most 0.36
LONGEST = 1.5
TRIALS = 12  # lengths of a step tried at most
# Trial from which on a length is taken that falls without Wolfe's condition
EXPANSIONS = 2
DECREASE = 1e-4  # of the line search: Armijo's condition
CURVATURE = 0.9  # of the line search: Wolfe's condition
BY_USER = "stopped by the user"
AGAIN = 2  # times that the last width is taken up again where peaks are followed
# Largest slope, as a share of the objective, at which nothing is left to win
FLAT = 1e-7


def fault_of_optimizer(optimizer: object) -> str:
    """Why something is no optimizer, a sentence; empty where it is."""
    if isinstance(optimizer, str):
        if optimizer in OPTIMIZERS:
            return ""
        return f"optimizer is {optimizer!r}, must be 'lbfgs' or 'adam'."
    if isinstance(optimizer, optax.GradientTransformation):
        return ""
    return (
        f"optimizer is a {type(optimizer).__name__}, must be 'lbfgs', 'adam' or an"
        " optax transformation."
    )


@dataclass(frozen=True)
class Step:
    """One accepted step of a tuning, from 0 for the start, and the best design there.

    objective, parameters (by name), gradient_norm (with respect to z), valid (speeds
    solved), start (which it is) : of the best design; width : of the smooth maximum;
    evaluations : so far, of all starts at once; plan : of the solves; seconds : since
    the beginning
    """

    number: int
    objective: float
    parameters: dict[str, float]
    gradient_norm: float
    valid: int
    width: float
    start: int
    evaluations: int
    plan: str
    seconds: float


@dataclass(frozen=True)
class Rules:
    """Rules of a descent.

    optimizer : a name of OPTIMIZERS, or an optax transformation; rate : step of "adam"
    in z; widths : of smooth maxima, shares of the worst value, each in its turn;
    improvement, patience : a width is done when so many steps in a row each win less
    than this share
    """

    optimizer: Optimizer
    rate: float
    widths: tuple[float, ...]
    improvement: float
    patience: int

    @property
    def searching(self) -> bool:
        """Whether each step is a line search."""
        return self.optimizer == "lbfgs"

    @property
    def transformation(self) -> optax.GradientTransformation:
        """The optax transformation of gradients into steps; those of a line search have
        a length of their own.
        """
        if not isinstance(self.optimizer, str):
            return self.optimizer
        length = 1.0 if self.searching else self.rate
        return optax.chain(OPTIMIZERS[self.optimizer](), optax.scale(-length))


# State of the optimiser, and whether the next step of each design is to be short
Memory: TypeAlias = tuple[Any, np.ndarray]


class Descent:
    """The designs of all starts as they are now, the best ones, and the history of the
    best of all.
    """

    def __init__(
        self,
        evaluator: Evaluator,
        rules: Rules,
        *,
        on_step: Callable[[Step], object] | None = None,
        on_start: Callable[[Reading], object] | None = None,
        keep: Callable[..., Point] = computed,
        history: Sequence[Step] = (),
    ):
        """Begin with an empty history, or with that of a descent before. ``keep`` as of
        :func:`jaxhb.results.checkpoint.keeper`: an evaluation follows from those
        before, so that a descent whose evaluations are kept goes on with the same
        numbers.
        """
        self.evaluator = evaluator
        self.rules = rules
        self.on_step = on_step
        self.on_start = on_start
        self.keep = keep
        self.optimizer = rules.transformation
        self.update = jax.jit(jax.vmap(self.optimizer.update))
        self.history = list(history)
        self.evaluations = 0
        self.began = time.monotonic()
        self.earlier = history[-1] if history else None

    def run(
        self, z: np.ndarray, steps: int, only: int | None = None
    ) -> tuple[Point, Point, str, bool]:
        """Go down from the designs z ``(A, P)``, or from ``only`` one of them, to the
        end, or to Ctrl-C: the first and the best Point, why it stopped, and whether the
        user stopped it.
        """
        first = self.point = self._first(z)
        if only is not None:
            self._select(only)
        self.best = self.point
        self._note(0)
        try:
            stopped = self._stages(steps)
            interrupted = False
        except KeyboardInterrupt:
            stopped = BY_USER
            interrupted = True
        return first, self.best, stopped, interrupted

    def _at(self, z: np.ndarray, near: Point, **options: Any) -> Point:
        """Evaluate designs z near a Point, or take the evaluation from those kept;
        ``options`` as of :meth:`Evaluator.at`.
        """
        self.evaluations += 1
        arguments = {
            name: value for name, value in options.items() if name != "on_lanes"
        }
        question = self.evaluations, z, self.aim, arguments

        def compute() -> Point:
            return jax.tree.map(
                np.asarray, self.evaluator.at(z, near, self.aim, **options)
            )

        return self.keep(question, compute)

    def _first(self, z: np.ndarray) -> Point:
        """Solve the starts; objectives from now on are shares of those of the train as
        it is.
        """
        evaluator = self.evaluator
        near = self.evaluator.unsolved(z)
        ones = np.ones(len(evaluator.task.objectives))
        self.aim = Aim(np.ones(near.status.shape, dtype=bool), ones, 0.1 * ones, 0.1)
        point = self._at(z, near, rescues=near.status.shape[1], on_lanes=self.on_start)
        if not point.solved[0].any():
            raise SceneError(_nothing_solved(evaluator, point.status[0]))
        self._count(point.solved)
        finer = evaluator.finer(point, point.solved)
        while finer is not None:
            point = self._at(z, finer)
            self._count(point.solved)
            finer = evaluator.finer(point, point.solved)
        if evaluator.peaks:
            point = self._at(z, evaluator.replanned(point))
            self._count(point.solved)
        self.aim = dataclasses.replace(self.aim, scales=self._sizes(point, 0))
        self._sharpen(self.rules.widths[0], point)
        return self._at(z, point)

    def _select(self, design: int) -> None:
        """Go on with one design alone; the first is still the unit of objectives."""
        self.point = jax.tree.map(lambda leaf: leaf[[design]], self.point)
        self._count(self.aim.counted[[design]])
        self._sharpen(self.rules.widths[0], self.point)
        self.point = self._at(self.point.z, self.point)

    def _count(self, counted: np.ndarray) -> None:
        """Let the speeds ``counted`` ``(A, n)`` enter the objective from now on."""
        self.aim = dataclasses.replace(self.aim, counted=counted)

    def _sizes(self, point: Point, design: int) -> np.ndarray:
        """The unit of every objective: its value at a design."""
        solved = point.solved[design]
        sizes = []
        for objective, values in zip(
            self.evaluator.task.objectives, point.readings, strict=False
        ):
            solved_values = np.asarray(values[design][solved])
            size = float(
                solved_values.max()
                if objective.over == "worst"
                else solved_values.mean()
            )
            sizes.append(size if size > 0 else 1.0)
        return np.array(sizes)

    def _sharpen(self, share: float, point: Point) -> None:
        """Set the width of the smooth maxima to the ``share`` of the worst value of the
        best design.
        """
        widths = share * self._sizes(point, best_of(point)) / self.aim.scales
        self.aim = dataclasses.replace(self.aim, share=share, widths=widths)

    def _stages(self, steps: int) -> str:
        """Take each width in turn until nothing is won or the steps are used up; say
        which.
        """
        number = 0
        again = self.rules.widths[-1:] * AGAIN if self.evaluator.peaks else ()
        for stage, width in enumerate((*self.rules.widths, *again)):
            self.sharpened = stage > 0
            if stage:
                self._sharpen(width, self.best)
                self._renew(self.evaluator.replanned(self.best))
            while True:
                ended, number = self._descend(number, steps)
                finer = self.evaluator.finer(self.best, self.aim.counted)
                if finer is None:
                    break
                self._renew(finer)
            if ended:
                return f"stopped after {steps} steps, which is all that was allowed"
        return "stopped: no further improvement"

    def _descend(self, number: int, steps: int) -> tuple[bool, int]:
        """Take steps at one width: (whether the steps are used up, their number)."""
        idle = np.zeros(len(self.point.z), dtype=int)
        memory = self._memory()
        while number < steps:
            # A design rests when its last steps won too little or its slope is gone;
            # the others go on beside it.
            steep = np.abs(self.point.gradient).max(1) > FLAT * np.abs(self.point.value)
            moving = (idle < self.rules.patience) & steep
            if not moving.any():
                return False, number
            direction, memory = self._direction(memory)
            before = self.point
            step = self._search if self.rules.searching else self._stride
            after, moved = step(before, direction, moving)
            number += 1
            self.point = where(moved, after, before)
            won = self.best.value - self.point.value
            idle = np.where(
                won > self.rules.improvement * np.abs(self.best.value), 0, idle + 1
            )
            # One that did not move is tried once more, along the gradient.
            idle = np.where(moved, idle, np.maximum(idle, self.rules.patience - 1))
            self.best = where(won > 0, self.point, self.best)
            # Between plans the objective jumps by its truncation error: such a step
            # says nothing about curvature.
            replanned = (self.point.plan_number != before.plan_number).any(1)
            memory = self._without_curvature(memory, before, moved & ~replanned)
            # A speed that is solved now counts from now on.
            if (self.point.solved & ~self.aim.counted).any():
                self._count(self.aim.counted | self.point.solved)
                self._renew(self.best)
                memory = self._memory()
            self._note(number)
        return True, number

    def _stride(
        self, point: Point, direction: np.ndarray, moving: np.ndarray
    ) -> tuple[Point, np.ndarray]:
        """Take one step as it is, halved while it loses a speed: (Point, whether each
        design moved).
        """
        length = np.ones(len(point.z))
        best = point
        moved = np.zeros(len(point.z), dtype=bool)
        for _ in range(TRIALS):
            trial = self._at(
                point.z + length[:, None] * direction, point, to_solve=moving & ~moved
            )
            acceptable = self._is_acceptable(trial) & moving & ~moved
            best = where(acceptable, trial, best)
            moved = moved | acceptable
            if (moved | ~moving).all():
                break
            length = np.where(moved, length, length / 2)
        return best, moved

    def _search(
        self, point: Point, direction: np.ndarray, moving: np.ndarray
    ) -> tuple[Point, np.ndarray]:
        """Search along a line after Lewis and Overton, for all designs at once: (Point,
        whether each design moved).
        """
        slope = np.sum(point.gradient * direction, axis=1)
        low = np.zeros(len(slope))
        high = np.full(len(slope), np.inf)
        length = np.ones(len(slope))
        best = point
        moved = np.zeros(len(slope), dtype=bool)
        done = ~moving | ~(slope < 0)
        for attempt in range(TRIALS):
            if done.all():
                break
            z = point.z + np.where(done, 0.0, length)[:, None] * direction
            most = point.value + DECREASE * length * slope
            trial = self._at(z, point, to_solve=~done, most=most)
            falls = self._is_acceptable(trial) & (trial.value <= most) & ~done
            # Weak Wolfe conditions by bisection, which ends at the kinks of a worst
            # value, too (Lewis and Overton, Math. Program. 141 (2013) 135): a step that
            # rises is the new ``high``, one still steep the new ``low``.
            curved = np.sum(trial.gradient * direction, axis=1) >= CURVATURE * slope
            best = where(falls & (trial.value <= best.value), trial, best)
            moved = moved | falls
            done |= falls & (curved | (attempt >= EXPANSIONS))
            high = np.where(falls | done, high, length)
            low = np.where(falls, length, low)
            done |= moved & ~falls & (attempt >= EXPANSIONS)
            length = np.where(
                np.isinf(high), 2 * length, (low + np.minimum(high, 1e300)) / 2
            )
        return best, moved

    def _is_acceptable(self, point: Point) -> np.ndarray:
        """Whether each design ``(A,)`` still has every speed that counts, and a finite
        value and gradient.
        """
        finite = np.isfinite(point.value) & np.isfinite(point.gradient).all(1)
        return finite & (point.solved | ~self.aim.counted).all(1)

    def _renew(self, best: Point) -> None:
        """Evaluate the best designs under the present plans, widths and speeds, less
        those that finer plans lose for good.
        """
        self.best = self._at(best.z, best, rescues=best.status.shape[1])
        self.point = self.best
        self._count(self.aim.counted & self.point.solved)

    def _memory(self) -> Memory:
        """Empty memory of the optimiser, and whether the next step of a design is to be
        short.
        """
        state = jax.vmap(self.optimizer.init)(self.point.z)
        return state, np.full(len(self.point.z), self.sharpened)

    def _direction(self, memory: Memory) -> tuple[np.ndarray, Memory]:
        """Descent directions ``(A, P)``, no component longer than the longest, and the
        memory after them.
        """
        state, short = memory
        updates, state = self.update(self.point.gradient, state, self.point.z)
        direction = np.asarray(updates)
        # With gradients of two sides of a kink in its memory L-BFGS may point uphill.
        uphill = np.sum(direction * self.point.gradient, axis=1) >= 0
        if self.rules.searching:
            direction = np.where(uphill[:, None], -self.point.gradient, direction)
            square = np.maximum(np.sum(self.point.gradient**2, axis=1), 1e-300)
            # A kink is as wide as that.
            promised = np.minimum(
                1.0, 2 * self.aim.share * np.abs(self.point.value) / square
            )
            direction *= np.where(short, promised, 1.0)[:, None]
        longest = np.maximum(np.abs(direction).max(1), 1e-300)
        return direction * np.minimum(1.0, LONGEST / longest)[:, None], (state, short)

    def _without_curvature(
        self, memory: Memory, before: Point, moved: np.ndarray
    ) -> Memory:
        """Empty the memory of L-BFGS where a step did not turn the gradient the right
        way.
        """
        if not self.rules.searching:
            return memory
        change = (self.point.z - before.z) * (self.point.gradient - before.gradient)
        # L-BFGS needs s . y > 0: without, its matrix is not positive definite any more.
        bad = ~moved | ~(change.sum(1) > 0)
        return where(bad, self._memory(), (memory[0], np.zeros_like(bad)))

    def _note(self, number: int) -> None:
        """Add a step to the history."""
        evaluator = self.evaluator
        design = best_of(self.best)
        earlier = self.earlier
        seconds = time.monotonic() - self.began
        step = Step(
            number=number + (earlier.number + 1 if earlier else 0),
            objective=float(self.best.value[design]),
            parameters=evaluator.task.named(self.best.z[design]),
            gradient_norm=float(np.linalg.norm(self.best.gradient[design])),
            valid=int(self.best.solved[design, : len(evaluator.rpm)].sum()),
            width=self.aim.share,
            start=design,
            evaluations=self.evaluations + (earlier.evaluations if earlier else 0),
            plan=evaluator.described(self.best, design),
            seconds=seconds + (earlier.seconds if earlier else 0.0),
        )
        self.history.append(step)
        if self.on_step:
            self.on_step(step)


def best_of(point: Point) -> int:
    """Index of the start that keeps most speeds and, among those, has the lowest
    objective.
    """
    return int(np.lexsort((point.value, -point.solved.sum(1)))[0])


def _nothing_solved(evaluator: Evaluator, status: np.ndarray) -> str:
    """Say in a sentence that no speed converges at the start, and what may help."""
    title = evaluator.train.topology.title
    rpm = evaluator.rpm
    outcomes = counts([Status(int(s)).name for s in status])
    remedy = "choose other speeds, more damping, or look at them with jaxhb sweep."
    if any(evaluator.train.topology.mesh_backlash):
        remedy = (
            "where teeth hammer there may be no periodic motion to follow. Tune a copy"
            " of the scene without the backlash keys, or other speeds, or begin with"
            " more damping; then check the result with backlash by jaxhb sweep."
        )
    head = (
        f"{title}: none of the {len(rpm)} speeds from {rpm.min():g} to"
        f" {rpm.max():g} rpm converges at the start"
    )
    return f"{head} ({outcomes}): {remedy}"

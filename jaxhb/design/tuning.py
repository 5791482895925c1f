"""Tuning: the numbers of a train that make a response small over a range of speeds, by
gradient.

Numbers may be known only within limits: trains within the tolerances are further lanes
of a tuning, each at one speed. For the worst case they are found, and added, by
searches at the best design so far (cutting planes); for 95 % they are twenty of a
sample, whose largest response is on average what 95 % stay below.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from jaxhb._jax import Numbers, refuse_tracers
from jaxhb._shown import brief
from jaxhb.balance.plan import Request
from jaxhb.design.between_speeds import (
    Checked,
    Excess,
    Followed,
    check_between,
    exceeded,
    followed_at,
    is_linear,
    worst_share,
)
from jaxhb.design.descent import (
    BY_USER,
    Descent,
    Optimizer,
    Rules,
    Step,
    best_of,
    fault_of_optimizer,
)
from jaxhb.design.evaluation import Evaluator, Point
from jaxhb.design.quantities import Objective, Parameter, Penalty, check_all, label
from jaxhb.design.task import Reading, Task
from jaxhb.design.tolerances import (
    Scatter,
    Tolerance,
    box_of,
    check_tolerances,
    moved,
    read_tolerances,
)
from jaxhb.design.worst_case import Spread, tolerance as worst_within
from jaxhb.elements.sentences import SceneError
from jaxhb.results.checkpoint import (
    Cached,
    Checkpoint,
    answered_parts,
    computed,
    keeper,
    place_in,
)
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import check_speed

KINDS = "worst", "p95"
SEARCHES = 4  # searches for worse trains, each followed by a tuning
# Share of the worst response by which no search finds more: the design is the best
# against all trains
SLACK = 0.01
SAMPLE = 20  # trains of a sample tuned against
CHECKED = 100  # trains of the fresh sample that designs are compared on
ROUNDS = 3  # tunings that go on at the critical speeds between those asked for
# z of designs across the bounds of a number: a tenth, a half, nine tenths of the way
ACROSS = (-2.2, 0.0, 2.2)


@brief
@dataclass(frozen=True)
class Robustness:
    """Comparison of a robust tuning with others, over the tolerances.

    kind : "worst" or "p95"; nominal : Tuning of the scene's own numbers, from which the
    robust one began; spreads : ``{design: Spread}`` of the scene, the nominal and the
    robust design, with a fresh sample
    """

    kind: str
    nominal: Tuning
    spreads: dict[str, Spread]


@brief
@dataclass(frozen=True)
class Tuning:
    """Result of :func:`tune`.

    train : DriveTrain, tuned; rpm : ``(n,)``; before, after : Reading; history : tuple
    of Step; outcomes : tuple of (objective, parameters, valid speeds) of every start;
    stopped : why it ended, a sentence; interrupted : whether the user ended it; robust
    : the comparison of a robust tuning with others; checked : the readings of the last
    design between the speeds, and of the first of a linear train, ``{"after": Checked,
    "before": Checked}``; followed : sentences, limits exceeded on the way, after which
    it went on
    """

    train: DriveTrain
    rpm: np.ndarray
    before: Reading
    after: Reading
    history: tuple[Step, ...]
    outcomes: tuple[tuple[float, dict[str, float], int], ...]
    stopped: str
    interrupted: bool
    robust: Robustness | None = None
    checked: dict[str, Checked] = dataclasses.field(default_factory=dict)
    followed: tuple[str, ...] = ()


def tune(
    train: DriveTrain,
    *,
    parameters: Sequence[Parameter],
    rpm: Numbers,
    objective: Objective | Sequence[Objective],
    penalties: Sequence[Penalty] = (),
    optimizer: Optimizer = "lbfgs",
    steps: int = 40,
    rate: float = 0.15,
    starts: int = 1,
    seed: int = 0,
    widths: Sequence[float] = (0.1, 0.02),
    improvement: float = 0.001,
    patience: int = 3,
    harmonics: int | None = None,
    tolerance: float = 0.01,
    integrals: str = "sampled",
    peaks: int = 0,
    robust: str | None = None,
    tolerances: Sequence[Tolerance] = (),
    on_step: Callable[[Step], object] | None = None,
    on_start: Callable[[Reading], object] | None = None,
    out: str | Path | Cached | None = None,
    executor: Executor | None = None,
) -> Tuning:
    """Change numbers of a train so that response quantities become small over a range
    of speeds.

    Minimises, by the derivatives of :func:`jaxhb.solve`,

        sum_j weight_j Q_j / Q_j(start) + sum_k weight_k sum over speeds (excess_k /
        |limit_k|)^2,

    Q_j the smooth maximum ``w log sum exp(q / w)`` of a quantity over the speeds, or
    its mean. All starts and speeds are one compiled call of value and gradient; each
    solve begins at the motion of the design before. A speed that is lost is tried again
    from a march; a step that still loses one is halved, never accepted. The plan of the
    solves is fixed during a line search; between steps it gets more harmonics where
    they are too few, and the optimiser begins anew.

    The design found is checked between the speeds asked for (``checked`` of the
    result): at its critical speeds, and, where motions are not linear, at 64 speeds or
    more and round the largest values. With limits (penalties with ``most``, and
    objectives that are shares of a limit, of which 1 is the limit) the tuning goes on
    where one is exceeded, at most three times: at the critical speeds that matter,
    which then follow each design, or at the speed found where that is none; from the
    train as it is, the design found and, of a linear train, the best of some across the
    bounds. Speeds further apart than 2.5 times the median distance are a hole that is
    not looked into.

    :class:`SceneError` if names are unknown, bounds exclude the start, a mesh without
    backlash is to separate and the like, one sentence each; or if no speed converges at
    the start.

    Parameters
    ----------
    rpm : array ``(n,)``
    optimizer : "lbfgs", "adam" or an optax transformation
        L-BFGS with a line search after Armijo and Wolfe (Lewis and Overton, 2013), Adam
        of step ``rate`` in z, or what optax offers, ``optax.rmsprop(0.05)`` say, with a
        step of its own in z. Not one that searches along a line itself: it would ask
        for values that only a tuning has.
    steps : int
        Most steps.
    starts, seed : int
        Designs that are tuned side by side: the train as it is, and random ones within
        the bounds; their seed.
    widths : tuple of float
        w in shares of the worst value when its turn begins, each until nothing is won:
        the smooth maximum lies at most ``w log(n)`` above the true one.
    improvement, patience : float, int
        A width is done when ``patience`` steps in a row each win less than this share.
    harmonics, tolerance, integrals
        As in :func:`jaxhb.solve_speeds`; with ``harmonics`` none are added.
    peaks : int
        Speeds added for each objective that is a maximum: whenever a width is done they
        move to its highest peaks, so that no peak hides between two of the speeds asked
        for.
    robust : "worst" or "p95", optional
        Make small what the worst train within the tolerances does, or what 95 of 100
        stay below, instead of what the train with just these numbers does. It begins
        with the nominal optimum, and compares both on a fresh sample.
    tolerances : sequence of Tolerance, optional
        For ``robust``; by default those of the ``[tolerance]`` table of the scene.
        Ranges move with tuned numbers.
    on_step, on_start : callable, optional
        Called with every :class:`Step`; and with the :class:`Reading` of the train as
        it is, again and again while its speeds are solved before the first step.
    out : path, optional
        A folder to which every evaluation is written: the same call goes on where it
        was stopped, with the same numbers to the last bit.
        :class:`jaxhb.CheckpointError` where it holds anything else, or cannot be
        written.
    executor : concurrent.futures.Executor, optional
        Where each start is tuned by itself, as :class:`jaxhb.Workers`: the numbers are
        then the same whatever the executor, but not those of starts that are tuned side
        by side. ``on_step`` is called with the last step of each best start so far.

    Returns
    -------
    Tuning
        Ctrl-C ends the tuning and returns the best design so far, with ``interrupted``
        True; before the first step there is none, and it raises KeyboardInterrupt.

    Examples
    --------
    >>> from jaxhb.design import Objective, Parameter
    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> swing = Objective(quantity="shaft torque", of="cyl6|flywheel")
    >>> pulley = Parameter(name="pulley.inertia", low=0.005, high=0.05)
    >>> tuned = tune(
    ...     train,
    ...     parameters=[pulley],
    ...     rpm=[1800.0, 2000.0, 2200.0],
    ...     objective=swing,
    ...     steps=3,
    ... )
    >>> round(tuned.after.parameters["pulley.inertia"], 3)
    0.026
    """
    refuse_tracers(
        "tune",
        train,
        rpm,
        instead="differentiate jaxhb.solve(train, rpm=..., plan=...)",
    )
    check_speed(train, rpm, many=True)
    rpm = np.atleast_1d(np.asarray(rpm, dtype=float))
    objectives = (
        tuple(objective) if isinstance(objective, (list, tuple)) else (objective,)
    )
    task = Task(tuple(parameters), objectives, tuple(penalties))
    check_all(train, task.parameters, objectives, task.penalties, rpm)
    _check_numbers(train, optimizer, steps, starts, seed, peaks, widths, executor)
    request = Request.of(train, harmonics, tolerance, integrals=integrals)
    rules = Rules(optimizer, rate, tuple(widths), improvement, patience)
    check = partial(
        check_between, rpm=rpm, task=task, harmonics=harmonics, tolerance=tolerance
    )
    every_speed = np.arange(len(rpm))
    n_parameters = len(task.parameters)
    drawn = np.random.default_rng(seed).uniform(0.02, 0.98, (starts - 1, n_parameters))
    optimizer_name = optimizer if isinstance(optimizer, str) else "given"
    options = {
        "answers": "designs",
        "speeds": rpm,
        "task": task,
        "optimizer": optimizer_name,
        "steps": steps,
        "rate": rate,
        "starts": starts,
        "seed": seed,
        "widths": widths,
        "improvement": improvement,
        "patience": patience,
        "peaks": peaks,
        "robust": robust,
        "within": tuple(tolerances),
        **vars(request),
    }
    stages = itertools.count()

    def tuned_at_lanes(
        train: DriveTrain,
        speeds: np.ndarray = every_speed,
        scatter: Scatter | None = None,
        more: Sequence[np.ndarray] | np.ndarray = (),
        critical: Sequence[Followed] = (),
        history: Sequence[Step] = (),
    ) -> tuple[Tuning, np.ndarray]:
        """Tune from the train and the designs z of ``more``: the Tuning, and the
        largest responses of all its lanes.
        """
        # Every stage has a folder of its own.
        folder = place_in(out, f"stage {next(stages)}")
        settings = options | {"lanes": (speeds, scatter, critical)}
        lane_objectives = tuple(
            _at_lanes(objective, speeds) for objective in objectives
        )
        question = _Question(
            train=train,
            rpm=rpm,
            speeds=speeds,
            task=dataclasses.replace(task, objectives=lane_objectives),
            request=request,
            peaks=peaks,
            scatter=scatter,
            critical=tuple(critical),
            rules=rules,
            steps=steps,
            history=tuple(history),
        )
        z = np.concatenate(
            [task.unbounded(train)[None], np.reshape(more, (-1, n_parameters))]
        )
        if executor is None or len(z) == 1:
            return _tuned(
                question,
                z,
                on_step=on_step,
                on_start=on_start,
                keep=keeper(folder, train, settings),
            )
        settings |= {"starts by themselves": True}
        checkpoint = None
        if folder is not None:
            checkpoint = Checkpoint(folder, train, settings, None)
        return _tuned_apart(question, z, executor, checkpoint, on_step)

    random = np.log(drawn / (1 - drawn))
    if robust is None:
        tune_from = partial(tuned_at_lanes, train)
        return _tune_between(train, rpm, task, check, tune_from, random)
    tolerances = tuple(tolerances) or read_tolerances(train)
    check_tolerances(train, tolerances)
    _check_robust(train, robust, tolerances, peaks)
    result = _tune_robust(
        train,
        rpm,
        objectives,
        tolerances,
        robust,
        seed,
        partial(tuned_at_lanes, more=random),
        harmonics=harmonics,
        tolerance=tolerance,
        out=out,
    )
    return result if result.interrupted else _checked(train, check, result)


@dataclass(frozen=True)
class _Question:
    """Question of one stage of a tuning: the train and the speeds asked for, lanes at
    ``speeds`` of them, and how designs go down after the steps of the ``history``.
    """

    train: DriveTrain
    rpm: np.ndarray
    speeds: np.ndarray
    task: Task
    request: Request
    peaks: int
    scatter: Scatter | None
    critical: tuple[Followed, ...]
    rules: Rules
    steps: int
    history: tuple[Step, ...]


def _tuned(
    question: _Question,
    z: np.ndarray,
    only: int | None = None,
    *,
    on_step: Callable[[Step], object] | None = None,
    on_start: Callable[[Reading], object] | None = None,
    keep: Callable[..., Point] = computed,
) -> tuple[Tuning, np.ndarray]:
    """Tune from the designs z ``(A, P)``, the first of which is the train as it is, or
    from ``only`` one of them: the Tuning, and the largest responses of all its lanes.
    """
    train = question.train
    rpm = question.rpm
    evaluator = Evaluator(
        train,
        rpm[question.speeds],
        question.task,
        question.request,
        question.peaks,
        question.scatter,
        question.critical,
    )
    descent = Descent(
        evaluator,
        question.rules,
        on_step=on_step,
        on_start=on_start,
        keep=keep,
        history=question.history,
    )
    first, best, stopped, interrupted = descent.run(z, question.steps, only)
    return _result(train, rpm, evaluator, descent, first, best, stopped, interrupted)


def _tuned_apart(
    question: _Question,
    z: np.ndarray,
    executor: Executor,
    checkpoint: Checkpoint | None,
    on_step: Callable[[Step], object] | None,
) -> tuple[Tuning, np.ndarray]:
    """Tune as :func:`_tuned`, from each of the designs by itself: the best Tuning, with
    the outcomes of all.
    """
    # Beside each stands the train as it is, whose values are the units of objectives.
    parts: list[tuple] = [(question, z[:1])]
    parts += [(question, z[[0, number]], 1) for number in range(1, len(z))]
    questions = [part[1] for part in parts]
    results: dict[int, tuple[Tuning, np.ndarray]] = {}
    for number, result in answered_parts(
        checkpoint, questions, _tuned, parts, executor
    ):
        results[number] = result
        if on_step and _best(results) == number:
            on_step(result[0].history[-1])
    tuning, largest = results[_best(results)]
    outcomes = itertools.chain.from_iterable(
        results[number][0].outcomes for number in range(len(z))
    )
    return dataclasses.replace(tuning, outcomes=tuple(outcomes)), largest


def _best(results: Mapping[int, tuple[Tuning, np.ndarray]]) -> int:
    """Number of the start that keeps most speeds and, among those, has the lowest
    objective; the first of several.
    """

    def rank(number: int) -> tuple[int, float, int]:
        ((objective, _, solved),) = results[number][0].outcomes
        return -solved, objective, number

    return min(results, key=rank)


def _at_lanes(objective: Objective, speeds: np.ndarray) -> Objective:
    """Take the weights of an Objective at lanes of indices ``speeds``."""
    if not objective.weights:
        return objective
    weights = tuple(np.array(objective.weights)[speeds])
    return dataclasses.replace(objective, weights=weights)


def _checked(
    train: DriveTrain, check: Callable[..., Checked], result: Tuning
) -> Tuning:
    """Add to a Tuning the readings of its first and last design between the speeds."""
    checked = {"after": check(result.train, reading=result.after)}
    # Where teeth hammer a look at the start would take as long as the tuning.
    if is_linear(train):
        checked["before"] = check(train, reading=result.before)
    return dataclasses.replace(result, checked=checked)


def _tune_between(
    train: DriveTrain,
    rpm: np.ndarray,
    task: Task,
    check: Callable[..., Checked],
    tune_from: Callable[..., tuple[Tuning, np.ndarray]],
    random_z: np.ndarray,
) -> Tuning:
    """Tune so that limits are kept between the speeds, too: the Tuning that keeps them,
    or is nearest to that.

    ``check(design, reading=)`` reads a design between the speeds, its Reading, where
    given, not again; ``tune_from(more=, critical=, history=)`` makes a Tuning from the
    train and further designs ``(A, P)``, the first time ``random_z``, at critical
    speeds to follow.
    """
    result, _ = tune_from(more=random_z)
    attempts: list[Tuning] = []
    sentences: list[str] = []
    followed: tuple[Followed, ...] = ()
    while not result.interrupted:
        try:
            result = _checked(train, check, result)
        except KeyboardInterrupt:  # the design is there, though not checked
            return dataclasses.replace(result, interrupted=True, stopped=BY_USER)
        attempts.append(result)
        excesses = exceeded(task, result.checked["after"])
        peaks = _new_peaks(followed, result.train, rpm, excesses)
        if not peaks or len(attempts) > ROUNDS:
            break
        sentences += [excess.sentence(rpm) for excess in excesses]
        followed += peaks
        if "before" in result.checked:
            followed += _new_peaks(
                followed, train, rpm, exceeded(task, result.checked["before"])
            )
        starts = [
            task.unbounded(result.train),
            *_across(train, task, check, result.train),
        ]
        result, _ = tune_from(more=starts, critical=followed, history=result.history)
    if not attempts:
        return result
    best = min(
        attempts, key=lambda attempt: worst_share(task, attempt.checked["after"])
    )
    stopped = result.stopped
    if sentences and exceeded(task, best.checked["after"]):
        plural = "s" if len(attempts) > 2 else ""
        stopped += (
            f"; a limit is still exceeded after {len(attempts) - 1} round{plural} at"
            " speeds between those asked for"
        )
    return dataclasses.replace(
        best,
        history=result.history,
        interrupted=result.interrupted,
        stopped=stopped,
        followed=tuple(sentences),
    )


def _new_peaks(
    followed: Sequence[Followed],
    train: DriveTrain,
    rpm: np.ndarray,
    excesses: Sequence[Excess],
) -> tuple[Followed, ...]:
    """The peaks to follow of limits that a train exceeds, without those ``followed``
    already.
    """
    followed_names = {peak.name for peak in followed}
    new_peaks = {}
    for excess in excesses:
        peak = followed_at(excess.rpm, train, rpm, followed_names)
        if peak.name not in followed_names:
            new_peaks[peak.name] = peak
    return tuple(new_peaks.values())


def _across(
    train: DriveTrain, task: Task, check: Callable[..., Checked], design: DriveTrain
) -> list[np.ndarray]:
    """The z ``(P,)`` of the best of some designs that have one number elsewhere within
    its bounds, if it is better.
    """
    # Where teeth hammer a look at so many designs would take as long as the tuning.
    if not is_linear(train):
        return []
    own_z = task.unbounded(design)
    numbers = np.arange(len(own_z))
    designs = [
        own_z,
        *(
            np.where(numbers == number, place, own_z)
            for number in numbers
            for place in ACROSS
        ),
    ]
    checks = [check(train.replace(task.named(z))) for z in designs]
    shares = [
        worst_share(task, checked) if checked.solved.all() else np.inf
        for checked in checks
    ]
    best = int(np.argmin(shares))
    return [designs[best]] if best else []


def _result(
    train: DriveTrain,
    rpm: np.ndarray,
    evaluator: Evaluator,
    descent: Descent,
    first: Point,
    best: Point,
    stopped: str,
    interrupted: bool,
) -> tuple[Tuning, np.ndarray]:
    """Make the :class:`Tuning`, and the largest response to each objective ``(Q,)`` of
    all lanes of the best design.
    """
    design = best_of(best)
    after = evaluator.reading(best, design)
    designs = zip(best.value, best.z, best.solved, strict=True)
    task = evaluator.task
    tuning = Tuning(
        train=train.replace(after.parameters),
        rpm=rpm,
        before=evaluator.reading(first, 0).of_first(len(rpm)),
        after=after.of_first(len(rpm)),
        history=tuple(descent.history),
        outcomes=tuple(
            (float(value), task.named(z), int(solved[: len(rpm)].sum()))
            for value, z, solved in designs
        ),
        stopped=stopped,
        interrupted=interrupted,
    )
    largest = [
        np.nanmax(after.readings[label(objective)]) for objective in task.objectives
    ]
    return tuning, np.array(largest)


def _check_numbers(
    train: DriveTrain,
    optimizer: Optimizer,
    steps: int,
    starts: int,
    seed: int,
    peaks: int,
    widths: Sequence[float],
    executor: Executor | None,
) -> None:
    """Refuse options of a tuning, one sentence a fault."""
    title = train.topology.title
    faults = []
    fault = fault_of_optimizer(optimizer)
    if fault:
        faults.append(f"{title}: {fault}")
    if executor is not None and not isinstance(optimizer, str):
        faults.append(
            f"{title}: an optimizer of optax cannot be sent to an executor: name"
            ' "lbfgs" or "adam".'
        )
    counts = (
        ("steps", steps, 1),
        ("starts", starts, 1),
        ("seed", seed, 0),
        ("peaks", peaks, 0),
    )
    for name, value, least in counts:
        if value != int(value) or value < least:
            faults.append(
                f"{title}: {name} is {value:g}, must be a whole number of at least"
                f" {least}."
            )
    if not widths or any(not 0 < width < 10 for width in widths):
        faults.append(
            f"{title}: widths is {widths}, must be numbers between 0 and 10, shares of"
            " the worst value."
        )
    if faults:
        raise SceneError(faults)


def _check_robust(
    train: DriveTrain, kind: str, tolerances: Sequence[Tolerance], peaks: int
) -> None:
    """Refuse a tuning that cannot be robust, one sentence a fault."""
    title = train.topology.title
    faults = []
    if kind not in KINDS:
        faults.append(f"{title}: robust is {kind!r}, must be 'worst' or 'p95'.")
    if peaks:
        faults.append(
            f"{title}: robust tunings follow no peaks: leave out peaks, or robust."
        )
    zero = [
        name
        for tolerance in tolerances
        for name in (tolerance.name, *tolerance.together)
        if not float(train.value(name))
    ]
    faults += [
        f"{title}: the tolerance {name!r} is of a value of 0, which has no ratio: leave"
        " it out."
        for name in zero
    ]
    if faults:
        raise SceneError(faults)


def _tune_robust(
    train: DriveTrain,
    rpm: np.ndarray,
    objectives: Sequence[Objective],
    tolerances: Sequence[Tolerance],
    kind: str,
    seed: int,
    tune_lanes: Callable[
        [DriveTrain, np.ndarray, Scatter | None], tuple[Tuning, np.ndarray]
    ],
    *,
    out: str | Path | Cached | None = None,
    harmonics: int | None,
    tolerance: float,
) -> Tuning:
    """Tune for the worst case or the 95th percentile. ``tune_lanes(train, speeds,
    scatter)`` makes a Tuning with lanes at indices ``speeds`` of ``rpm``, and the
    largest response to each objective ``(Q,)`` of all its lanes.
    """
    all_speeds = np.arange(len(rpm))
    box = box_of(train, tolerances, objectives)
    shares = np.repeat(box.unbounded(train)[None], len(all_speeds), axis=0)
    searches = itertools.count()

    def spread_of(design: DriveTrain, samples: int = 0) -> Spread:
        return worst_within(
            design,
            rpm=rpm,
            of=objectives,
            tolerances=moved(tolerances, train, design),
            samples=samples,
            seed=seed + 1,
            harmonics=harmonics,
            tolerance=tolerance,
            bounds=False,
            out=place_in(out, f"search {next(searches)}"),
        )

    nominal, largest = tune_lanes(train, all_speeds, None)
    if nominal.interrupted:
        return nominal
    design = best = nominal
    if kind == "p95":
        speeds = np.concatenate([all_speeds, np.repeat(all_speeds, SAMPLE)])
        drawn = np.tile(box.sample(SAMPLE, seed), (len(all_speeds), 1))
        scatter = Scatter(box, np.concatenate([shares, drawn]))
        design, _ = tune_lanes(nominal.train, speeds, scatter)
        best = design
    else:
        speeds = all_speeds
        weights = np.array([objective.weight for objective in objectives])
        least = np.inf
        sizes = None
        for number in range(1, SEARCHES + 1):
            spread = spread_of(design.train)
            worst = np.nanmax(spread.worst, axis=0)
            # Of the nominal optimum: the sum is of shares of them.
            sizes = worst if sizes is None else sizes
            value = float((weights * worst / sizes).sum())
            if value < least:
                best = design
                least = value
            if number == SEARCHES or (
                number > 1 and (worst <= (1 + SLACK) * largest).all()
            ):
                break
            speed, objective = np.nonzero(np.isfinite(spread.worst))
            speeds = np.concatenate([speeds, speed])
            shares = np.concatenate([shares, spread.shares[speed, objective]])
            design, largest = tune_lanes(design.train, speeds, Scatter(box, shares))
            if design.interrupted:
                break
    if design.interrupted:  # who stops a tuning does not wait for more
        return dataclasses.replace(best, before=nominal.before, interrupted=True)
    designs = {
        "as it is": train,
        "nominal optimum": nominal.train,
        "robust": best.train,
    }
    spreads = {
        name: spread_of(candidate, CHECKED) for name, candidate in designs.items()
    }
    return dataclasses.replace(
        best, before=nominal.before, robust=Robustness(kind, nominal, spreads)
    )

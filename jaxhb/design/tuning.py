"""Tuning: the numbers of a train that make a response small over a range of speeds, by gradient."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from jaxhb._jax import Numbers
from jaxhb._shown import brief
from jaxhb.balance.plan import Request
from jaxhb.design.descent import OPTIMIZERS, Descent, Step, best_of
from jaxhb.design.evaluation import Evaluator, Reading, Task
from jaxhb.design.quantities import Objective, Parameter, Penalty, check_all
from jaxhb.elements.elements import SceneError
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import check_speed


@brief
@dataclass(frozen=True)
class Tuning:
    """Result of :func:`tune`.

    train : DriveTrain, tuned; rpm : ``(n,)``; before, after : Reading; history : tuple of Step
    outcomes : tuple of (objective, parameters, valid speeds) of every start; stopped : why it ended, a sentence;
    interrupted : whether the user ended it
    """

    train: DriveTrain
    rpm: np.ndarray
    before: Reading
    after: Reading
    history: tuple
    outcomes: tuple
    stopped: str
    interrupted: bool


def tune(
    train: DriveTrain,
    *,
    parameters: Sequence[Parameter],
    rpm: Numbers,
    objective: Objective | Sequence[Objective],
    penalties: Sequence[Penalty] = (),
    optimizer: str = "lbfgs",
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
    on_step: Callable[[Step], object] | None = None,
    on_start: Callable[[Reading], object] | None = None,
) -> Tuning:
    """Change numbers of a train so that response quantities become small over a range of speeds.

    Minimises, by the derivatives of :func:`jaxhb.solve`,

        sum_j weight_j Q_j / Q_j(start) + sum_k weight_k sum over speeds (excess_k / |limit_k|)^2,

    Q_j the smooth maximum ``w log sum exp(q / w)`` of a quantity over the speeds, or its mean. All starts and speeds
    are one compiled call of value and gradient; each solve begins at the motion of the design before. A speed that is
    lost is tried again from a march; a step that still loses one is halved, never accepted. The plan of the solves is
    fixed during a line search; between steps it gets more harmonics where they are too few, and the optimiser begins
    anew.

    :class:`SceneError` if names are unknown, bounds exclude the start, a mesh without backlash is to separate and the
    like, one sentence each; or if no speed converges at the start.

    Parameters
    ----------
    rpm : array ``(n,)``
    optimizer : "lbfgs" or "adam"
        L-BFGS with a line search after Armijo and Wolfe (Lewis and Overton, 2013), or Adam of step ``rate`` in z.
    steps : int
        Most steps.
    starts, seed : int
        Designs that are tuned side by side: the train as it is, and random ones within the bounds; their seed.
    widths : tuple of float
        w in shares of the worst value when its turn begins, each until nothing is won: the smooth maximum lies at most
        ``w log(n)`` above the true one.
    improvement, patience : float, int
        A width is done when ``patience`` steps in a row each win less than this share.
    harmonics, tolerance, integrals
        As in :func:`jaxhb.solve_speeds`; with ``harmonics`` none are added.
    peaks : int
        Speeds added for each objective that is a maximum: whenever a width is done they move to its highest peaks, so
        that no peak hides between two of the speeds asked for.
    on_step, on_start : callable, optional
        Called with every :class:`Step`; and with the :class:`Reading` of the train as it is, again and again while its
        speeds are solved before the first step.

    Returns
    -------
    Tuning
        Ctrl-C ends the tuning and returns the best design so far, with ``interrupted`` True; before the first step
        there is none, and it raises KeyboardInterrupt.

    Examples
    --------
    >>> from jaxhb.design import Objective, Parameter
    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> swing = Objective(quantity="shaft torque", of="cyl6|flywheel")
    >>> pulley = Parameter(name="pulley.inertia", low=0.005, high=0.05)
    >>> tuned = tune(train, parameters=[pulley], rpm=[1800.0, 2000.0, 2200.0], objective=swing, steps=3)
    >>> round(tuned.after.parameters["pulley.inertia"], 3)
    0.026
    """
    rpm = np.atleast_1d(np.asarray(rpm, dtype=float))
    given = tuple(objective) if isinstance(objective, (list, tuple)) else (objective,)
    task = Task(tuple(parameters), given, tuple(penalties))
    check_speed(train, rpm, many=True)
    check_all(train, task.parameters, given, task.penalties, rpm)
    _check_numbers(train, optimizer, steps, starts, seed, peaks, widths)
    evaluator = Evaluator(train, rpm, task, Request.of(train, harmonics, tolerance, integrals=integrals), peaks)
    options = {"rate": rate, "widths": tuple(widths), "improvement": improvement, "patience": patience}
    descent = Descent(evaluator, optimizer, **options, on_step=on_step or (lambda step: None), on_start=on_start)
    shares = np.random.default_rng(seed).uniform(0.02, 0.98, (starts - 1, len(task.parameters)))
    z = np.concatenate([task.unbounded(train)[None], np.log(shares / (1 - shares))])
    first, best, stopped, interrupted = descent.run(z, steps)
    after = evaluator.reading(best, best_of(best))
    designs = zip(best.value, best.z, best.solved, strict=True)
    return Tuning(
        train=train.replace(after.parameters),
        rpm=rpm,
        before=evaluator.reading(first, 0),
        after=after,
        history=tuple(descent.history),
        outcomes=tuple((float(v), task.named(z), int(solved[: len(rpm)].sum())) for v, z, solved in designs),
        stopped=stopped,
        interrupted=interrupted,
    )


def _check_numbers(train, optimizer, steps, starts, seed, peaks, widths):
    where, faults = train.topology.title, []
    if optimizer not in OPTIMIZERS:
        faults.append(f"{where}: optimizer is {optimizer!r}, must be 'lbfgs' or 'adam'.")
    for name, value, least in (("steps", steps, 1), ("starts", starts, 1), ("seed", seed, 0), ("peaks", peaks, 0)):
        if value != int(value) or value < least:
            faults.append(f"{where}: {name} is {value:g}, must be a whole number of at least {least}.")
    if not widths or any(not 0 < width < 10 for width in widths):
        faults.append(f"{where}: widths is {widths}, must be numbers between 0 and 10, shares of the worst value.")
    if faults:
        raise SceneError(faults)

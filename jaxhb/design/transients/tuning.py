"""Tuning of a train by its transients, by gradient."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array, Number, refuse_tracers
from jaxhb._shown import brief
from jaxhb.design.quantities import Parameter
from jaxhb.design.task import named_at, shares_at, unbounded_at
from jaxhb.elements.sentences import SceneError
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.transients.motion import Transient
from jaxhb.transients.transient import Speed, StepRate, transient_in_steps

# One number of the rows of an event, as "start.fuel[1,1]"
OF_ROWS = re.compile(r"(?P<name>.+)\[(?P<row>\d+), ?(?P<column>\d+)\]")
# Share of the objective that a step must win
IMPROVEMENT = 1e-4
# Share of steps to spare, with which designs of stiffer teeth have the same steps
SPARE = 0.2


@dataclass(frozen=True, kw_only=True)
class TransientObjective:
    """A number of a transient to be made small, or to be kept below a limit.

    Parameters
    ----------
    name : str
        Of the number, for the result.
    value : callable
        Gives the number, as a :class:`jaxhb.Transient` has it, which must not be 0 at
        the start: ``lambda motion: motion.torque("a", "b").smooth_peak()``.
    seconds, speed, events, start, rpm
        The transient, as in :func:`jaxhb.transient`. Objectives of the same transient
        share it.
    weight : float
        Of the number over what it is at the start.
    most : float, optional
        Limit of the number: it is then no objective, and what exceeds the limit adds
        ``weight (excess / |most|)^2``.
    """

    name: str
    value: Callable[[Transient], Number]
    seconds: float
    speed: Speed
    events: tuple[str, ...] = ()
    start: Any = None
    rpm: float | None = None
    weight: float = 1.0
    most: float | None = None

    @property
    def run(self) -> dict[str, Any]:
        """The transient that the number is of, as arguments."""
        names = ("seconds", "speed", "events", "start", "rpm")
        return {name: getattr(self, name) for name in names}


@brief
@dataclass(frozen=True)
class TransientStep:
    """One step of a tuning: its number, the objective as a share of that at the start,
    parameters and numbers by name.
    """

    number: int
    objective: float
    parameters: dict[str, float]
    values: dict[str, float]


@brief
@dataclass(frozen=True)
class TransientTuning:
    """Result of :func:`jaxhb.tune_transient`.

    train : DriveTrain, tuned; before, after : :class:`TransientStep` of the train as it
    is and of the best design; history : tuple of TransientStep; stopped : why it ended,
    a sentence; interrupted : whether the user ended it
    """

    train: DriveTrain
    before: TransientStep
    after: TransientStep
    history: tuple[TransientStep, ...]
    stopped: str
    interrupted: bool


def tune_transient(
    train: DriveTrain,
    *,
    parameters: Sequence[Parameter],
    objectives: Sequence[TransientObjective],
    steps: int = 30,
    on_step: Callable[[TransientStep], object] | None = None,
) -> TransientTuning:
    """Change numbers of a train, or of its events, so that numbers of transients become
    small.

    Minimises ``sum weight Q / |Q(start)|`` over the objectives, and what exceeds
    limits, by L-BFGS (scipy) with the derivatives of :func:`jaxhb.transient`, each
    transient marched once forwards and once backwards for a value and its gradient.
    Smooth numbers (``smooth_peak``) have better gradients than peaks.

    Parameters
    ----------
    parameters : sequence of Parameter
        Names as in :meth:`jaxhb.DriveTrain.replace`; of rows, as those of an event, one
        number is ``"NAME.FIELD[row,column]"``, counted from 0.
    objectives : sequence of TransientObjective
        One at least without a limit.
    steps : int
        Most steps.
    on_step : callable, optional
        Called with every :class:`TransientStep`.

    Returns
    -------
    TransientTuning
        Ctrl-C ends the tuning and returns the best design so far.

    Raises
    ------
    SceneError
        Unknown names, bounds that exclude the start, a number that is 0 or not finite
        at the start; and what :func:`jaxhb.transient` refuses.

    Examples
    --------
    >>> import jaxhb
    >>> from jaxhb.design import Parameter, TransientObjective
    >>> parts = [
    ...     jaxhb.Disk(name="rotor", inertia=1.0, damping=2.0),
    ...     jaxhb.Ground(disk="rotor", stiffness=1e4),
    ...     jaxhb.Torque(disk="rotor", mean=0.0, harmonics=[(1.0, 10.0, 0.0)]),
    ... ]
    >>> swing = TransientObjective(
    ...     name="swing",
    ...     value=lambda motion: motion.disk("rotor").smooth_peak(),
    ...     seconds=0.1,
    ...     speed=[(0.0, 800.0), (0.1, 1000.0)],
    ...     start="rest",
    ... )
    >>> tuned = tune_transient(
    ...     jaxhb.build(parts),
    ...     parameters=[Parameter(name="rotor.inertia", low=0.5, high=2.0)],
    ...     objectives=[swing],
    ...     steps=1,
    ... )
    >>> tuned.after.objective < 1.0
    True
    """
    refuse_tracers("tune_transient", train, instead="differentiate jaxhb.transient")
    _check(train, parameters, objectives)
    return _Descent(train, tuple(parameters), tuple(objectives), on_step).run(steps)


def _check(
    train: DriveTrain,
    parameters: Sequence[Parameter],
    objectives: Sequence[TransientObjective],
) -> None:
    """Refuse parameters and objectives that can be none."""
    faults = []
    for parameter in parameters:
        value = read_number(train, parameter.name)
        if not parameter.low < parameter.high:
            faults.append(
                f"parameter {parameter.name!r}: low is {parameter.low:g}, must be below"
                f" high = {parameter.high:g}."
            )
        elif not parameter.low <= value <= parameter.high:
            faults.append(
                f"parameter {parameter.name!r}: the train has {value:g}, which is not"
                f" between {parameter.low:g} and {parameter.high:g}. Widen the bounds."
            )
        if parameter.scale == "log" and not parameter.low > 0:
            faults.append(
                f"parameter {parameter.name!r}: low is {parameter.low:g}, must be above"
                ' 0 on a scale "log". Take scale="linear".'
            )
    if not parameters:
        faults.append("tune_transient: there is no parameter. Name one.")
    if not any(objective.most is None for objective in objectives):
        faults.append(
            "tune_transient: there is no objective without a limit. Give one to be made"
            " small."
        )
    if faults:
        raise SceneError(faults)


def read_number(train: DriveTrain, name: str) -> float:
    """A number of a train, one of rows by its place."""
    place = OF_ROWS.fullmatch(name)
    if place is None:
        return float(train.value(name))
    rows = np.asarray(train.value(place["name"]))
    row = int(place["row"])
    column = int(place["column"])
    if rows.ndim != 2 or row >= rows.shape[0] or column >= rows.shape[1]:
        raise SceneError(
            f"parameter {name!r}: {place['name']} has"
            f" {' x '.join(map(str, rows.shape)) or 'one'} numbers."
        )
    return float(rows[row, column])


def with_numbers(train: DriveTrain, numbers: Mapping[str, Number]) -> DriveTrain:
    """The train with numbers changed, those of rows by their places."""
    values: dict[str, Any] = {}
    for name, number in numbers.items():
        place = OF_ROWS.fullmatch(name)
        if place is None:
            values[name] = number
            continue
        rows = values.get(place["name"])
        if rows is None:
            rows = jnp.asarray(train.value(place["name"]))
        at = int(place["row"]), int(place["column"])
        values[place["name"]] = jnp.asarray(rows).at[at].set(number)
    return train.replace(values)


class _Descent:
    """A tuning on its way: the steps so far, and the numbers at the start."""

    def __init__(
        self,
        train: DriveTrain,
        parameters: tuple[Parameter, ...],
        objectives: tuple[TransientObjective, ...],
        on_step: Callable[[TransientStep], object] | None,
    ):
        self.train = train
        self.parameters = parameters
        self.objectives = objectives
        self.history: list[TransientStep] = []
        self._on_step = on_step or (lambda step: None)
        self._scale = np.ones(len(objectives))
        self._step_rates = [StepRate(SPARE) for _ in objectives]
        self._last: TransientStep | None = None

    def _start(self) -> np.ndarray:
        """The z ``(P,)`` of the train, of values on a bound a little inside."""
        values = [read_number(self.train, p.name) for p in self.parameters]
        return unbounded_at(shares_at(self.parameters, np.array(values)))

    def _numbers(self, z: Array) -> dict[str, Any]:
        """Parameters by name."""
        return named_at(self.parameters, jax.nn.sigmoid(jnp.asarray(z)))

    def _values(self, z: Array) -> Array:
        """Numbers ``(Q,)`` of the objectives."""
        changed = with_numbers(self.train, self._numbers(z))
        motions: list[tuple[dict[str, Any], Transient]] = []
        values = []
        for objective, step_rate in zip(self.objectives, self._step_rates, strict=True):
            alike = [motion for run, motion in motions if _same(run, objective.run)]
            if not alike:
                alike = [transient_in_steps(changed, step_rate, **objective.run)]
                motions.append((objective.run, alike[0]))
            values.append(jnp.asarray(objective.value(alike[0]), dtype=float))
        return jnp.stack(values)

    def _cost(self, z: Array) -> tuple[Array, Array]:
        """The objective, and the numbers that it is made of."""
        values = self._values(z)
        cost: Array = jnp.zeros(())
        for number, objective in enumerate(self.objectives):
            if objective.most is None:
                share = values[number] / self._scale[number]
                cost = cost + objective.weight * share
            else:
                excess = jnp.maximum(values[number] - objective.most, 0.0)
                cost = cost + objective.weight * (excess / abs(objective.most)) ** 2
        return jnp.asarray(cost), values

    def _step(self, z: np.ndarray, cost: float, values: np.ndarray) -> TransientStep:
        return TransientStep(
            number=len(self.history),
            objective=cost,
            parameters={name: float(v) for name, v in self._numbers(z).items()},
            values={
                objective.name: float(value)
                for objective, value in zip(self.objectives, values, strict=True)
            },
        )

    def _evaluate(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """The objective and its gradient, for scipy."""
        (cost, values), gradient = jax.value_and_grad(self._cost, has_aux=True)(
            jnp.asarray(z)
        )
        step = self._step(z, float(cost), np.asarray(values))
        if not self.history:
            self._note(step)
        if self._last is None or step.objective < self._last.objective:
            self._last = step
        gradient = np.nan_to_num(np.asarray(gradient, dtype=float))
        return (float(cost) if np.isfinite(cost) else 1e9), gradient

    def _note(self, step: TransientStep) -> None:
        self.history.append(step)
        self._on_step(step)

    def run(self, steps: int) -> TransientTuning:
        """Tune in so many steps at most."""
        from scipy.optimize import minimize

        z = self._start()
        first = np.asarray(self._values(jnp.asarray(z)))
        for objective, value in zip(self.objectives, first, strict=True):
            if not np.isfinite(value) or (value == 0 and objective.most is None):
                raise SceneError(
                    f"objective {objective.name!r} is {value:g} at the start: it must"
                    " be a number other than 0."
                )
        self._scale = np.abs(np.where(first == 0, 1.0, first))
        interrupted = False

        def after(_: np.ndarray) -> None:
            assert self._last is not None  # a step has been evaluated
            self._note(dataclasses.replace(self._last, number=len(self.history)))

        try:
            outcome = minimize(
                self._evaluate,
                z,
                jac=True,
                method="L-BFGS-B",
                callback=after,
                options={"maxiter": steps, "ftol": IMPROVEMENT},
            )
            stopped = "no step wins any more"
            if outcome.nit >= steps:
                stopped = f"{steps} steps are done"
        except KeyboardInterrupt:
            if not self.history:
                raise
            interrupted = True
            stopped = "interrupted"
        best = min(self.history, key=lambda step: step.objective)
        return TransientTuning(
            train=jax.tree.map(np.asarray, with_numbers(self.train, best.parameters)),
            before=self.history[0],
            after=best,
            history=tuple(self.history),
            stopped=stopped,
            interrupted=interrupted,
        )


def _same(run: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether two transients are the same."""
    return all(
        value is other[name] or np.array_equal(value, other[name])
        if name == "speed" and not isinstance(value, str)
        else value is other[name] or value == other[name]
        for name, value in run.items()
    )

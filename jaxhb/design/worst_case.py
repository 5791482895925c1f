"""Effects of tolerances on a response: sensitivities, the worst case, percentiles.

A lane is one train within its tolerances at one speed, its numbers the shares u of a
:class:`Box`. All lanes of a question are solved by the evaluation of tunings
(:mod:`jaxhb.design.evaluation`), whose gradients say which way leads to larger
responses.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import jax
import numpy as np

from jaxhb._jax import Numbers, refuse_tracers
from jaxhb._shown import brief
from jaxhb.balance.plan import Request
from jaxhb.design.bounds_over_box import bounds_over_box
from jaxhb.design.evaluation import Evaluator, Point, where
from jaxhb.design.quantities import (
    QUANTITIES,
    Objective,
    judged,
    label,
    objective_faults,
)
from jaxhb.design.tolerances import (
    Box,
    Tolerance,
    box_of,
    check_tolerances,
    read_tolerances,
)
from jaxhb.elements.sentences import SceneError
from jaxhb.results.answers import left_out
from jaxhb.results.checkpoint import Cached, Checkpoint, answered_parts, computed
from jaxhb.results.status import NotConverged
from jaxhb.solutions.speeds import solve_speeds
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import check_speed

ROUNDS = 3  # searches from one speed to the next
CLIMBS = 12  # steps of a search for a worst case at most
TRIALS = 5  # lengths of a step
APART = 1.0  # difference of a share that another start is worth
PROMISING = 0.8  # share of the best value that another start is worth
# Trains where no tooth separates, from which searches may begin, beside the corners
EXPLORED_LINEAR = 64
GAIN = 1e-3  # share of the value below which a step has won nothing
PATIENCE = 2  # steps that win nothing after which a search ends
ASCENT = 1e-4  # share of the slope that a step has to win, Armijo's condition
CURVED = 1e-8  # cosine of step and change of the slope at least
NO_LIMIT = "the rule of the shaft has no limit there"
TOGETHER = 8  # speeds whose searches are solved, and kept, together
# Of those where no tooth leaves contact, at which a program costs more than its lanes
TOGETHER_LINEAR = 32
LEAST_LANES = 64  # of which numbers are computed at a time, of linear speeds
QUANTITIES_ASKED = (
    "tooth force",
    "shaft torque",
    "damper power",
    "stress over continuous limit",
)
"""Quantities that are judged where none is named."""

Result = TypeVar("Result")
# Responses (A, Q) and Point of lanes, and a function from quantities (A,) to
# derivatives (A, P)
Outcome: TypeAlias = tuple[np.ndarray, Point, Callable[[np.ndarray], np.ndarray]]


@brief
@dataclass(frozen=True)
class Spread:
    """Result of :func:`tolerance`: n speeds, Q quantities, P tolerances, S samples. SI
    units, nan where not solved and where the rule of a shaft has no limit of which a
    stress would be a share.

    of : tuple of Objective; tolerances : tuple of Tolerance; rpm : ``(n,)``; nominal :
    ``(n, Q)``, of the train as the scene has it; slopes : ``(n, Q, P)``, change of the
    response over half the range of a number, by the derivative at the own values;
    worst, shares : ``(n, Q)`` and ``(n, Q, P)``, the largest response found and the
    shares u of the numbers there; bound : ``(n, Q)``, exceeded by no response within
    the tolerances, teeth in contact, nan where that is not proved; no_bound : ``(n,
    Q)``, why there is no bound, "" where there is one; samples, drawn : ``(n, S, Q)``
    and ``(S, P)``, responses of a sample and the shares u drawn; evaluations : solves
    of one speed, those of the sample included
    """

    train: DriveTrain
    of: tuple[Objective, ...]
    tolerances: tuple[Tolerance, ...]
    rpm: np.ndarray
    nominal: np.ndarray
    slopes: np.ndarray
    worst: np.ndarray
    shares: np.ndarray
    bound: np.ndarray
    no_bound: np.ndarray
    samples: np.ndarray
    drawn: np.ndarray
    evaluations: int

    @property
    def labels(self) -> list[str]:
        """Names of the quantities: ``"tooth force of crank gear|idler"``."""
        return [label(objective) for objective in self.of]

    @property
    def judged(self) -> np.ndarray:
        """Whether each quantity has a meaning at each speed ``(n, Q)``: a share of a
        limit has none where the rule has no limit.
        """
        return np.column_stack(
            [judged(self.train, objective, self.rpm) for objective in self.of]
        )

    @property
    def answered(self) -> np.ndarray:
        """Whether each speed is solved for the train as it is ``(n,)``."""
        return (np.isfinite(self.nominal) | ~self.judged).all(axis=1)

    @property
    def drawn_solved(self) -> np.ndarray:
        """Whether each train of the sample is solved at each speed ``(n, S)``."""
        return (np.isfinite(self.samples) | ~self.judged[:, None]).all(axis=2)

    @property
    def solved(self) -> np.ndarray:
        """Share of the samples that are solved ``(n,)``."""
        return self.drawn_solved.mean(axis=1)

    @property
    def effects(self) -> np.ndarray:
        """Change of the responses over half the range of each number ``(n, Q, P)``: by
        linear regression on the sample, where that has at least three trains for each
        number, else the slopes, which hold for small changes: where teeth hammer a
        force is no smooth function of the numbers.
        """
        effects = self.slopes.copy()
        count = 3 * self.drawn.shape[1]
        for i, (responses, solved, has_meaning) in enumerate(
            zip(self.samples, self.drawn_solved, self.judged, strict=True)
        ):
            if solved.sum() >= count:
                shares = np.column_stack([np.ones(solved.sum()), self.drawn[solved]])
                solution = np.linalg.lstsq(shares, responses[solved][:, has_meaning])[0]
                effects[i, has_meaning] = solution[1:].T
        return effects

    def percentile(self, q: float) -> np.ndarray:
        """Percentile ``(n, Q)`` of the samples that are solved; nan where none is."""
        percentiles = np.full(self.nominal.shape, np.nan)
        for i, (responses, solved, has_meaning) in enumerate(
            zip(self.samples, self.drawn_solved, self.judged, strict=True)
        ):
            if solved.any():
                percentiles[i, has_meaning] = np.percentile(
                    responses[solved][:, has_meaning], q, axis=0
                )
        return percentiles

    def to_xarray(self) -> Any:
        """Labelled arrays over ``rpm``, ``quantity`` and ``number``; needs
        ``jaxhb[data]``.
        """
        import xarray

        dims = ("rpm", "quantity")
        variables: dict[str, tuple] = {
            "nominal": (
                dims,
                self.nominal,
                {
                    "long_name": (
                        "response of the nominal scene, in the unit of the quantity"
                    )
                },
            ),
            "worst": (
                dims,
                self.worst,
                {"long_name": "largest response found within the tolerances"},
            ),
            "bound": (
                dims,
                self.bound,
                {
                    "long_name": (
                        "what no response exceeds within the tolerances, where proved"
                    )
                },
            ),
            "no_bound": (dims, self.no_bound, {"long_name": "why there is no bound"}),
            "slope": (
                (*dims, "number"),
                self.slopes,
                {"long_name": "change over half the range of a number"},
            ),
            "at_worst": (
                (*dims, "number"),
                self.numbers,
                {"long_name": "number at the largest response"},
            ),
        }
        if self.drawn.size:
            variables["sample"] = (
                ("rpm", "draw", "quantity"),
                self.samples,
                {"long_name": "responses of a random sample"},
            )
            variables["draw_share"] = (
                ("draw", "number"),
                self.drawn,
                {"long_name": "place in the range, -1 to 1"},
            )
        units = (
            "quantity",
            [QUANTITIES[objective.quantity].unit for objective in self.of],
        )
        names = {
            "rpm": self.rpm,
            "quantity": self.labels,
            "number": [number.name for number in self.tolerances],
        }
        return xarray.Dataset(
            variables,
            coords=names | {"unit": units},
            attrs={"scene": self.train.topology.name},
        )

    @property
    def numbers(self) -> np.ndarray:
        """The numbers with a tolerance at the worst case of every speed and quantity
        ``(n, Q, P)``.
        """
        low, high = np.array(
            [(number.low, number.high) for number in self.tolerances]
        ).T
        return (high + low) / 2 + self.shares * (high - low) / 2

    def values(self, i: int, j: int) -> dict[str, float]:
        """Numbers of the train at the worst case of a speed and a quantity, for
        :meth:`jaxhb.DriveTrain.replace`.
        """
        box = box_of(self.train, self.tolerances, self.of)
        return box.named(self.shares[i, j])


def tolerance(
    train: DriveTrain,
    *,
    rpm: Numbers,
    of: Sequence[Objective] = (),
    tolerances: Sequence[Tolerance] = (),
    samples: int = 0,
    seed: int = 0,
    harmonics: int | None = None,
    tolerance: float = 0.01,
    bounds: bool = True,
    progress: Callable[[str], object] | None = None,
    out: str | Path | Cached | None = None,
    executor: Executor | None = None,
) -> Spread:
    """Find the effects of the tolerances of a train on its response at some speeds.

    At each speed and of each quantity: the value of the train as it is; by the
    derivative of :func:`jaxhb.solve`, which number moves it how far over its own
    tolerance; the largest value within all tolerances that is found, and where; a bound
    that no value exceeds, where one can be proved; and percentiles of a random sample.

    The worst case is searched by projected gradients (BFGS in the numbers inside their
    ranges, Bertsekas, 1982), from the train as it is, the best corner of the range, and
    the best on the other side of the number that moves the response most, all speeds
    and quantities side by side; then from the worst cases of the speeds beside it.
    Corners are those that the derivatives point to, of the train as it is and at four
    others; where a corner is the worst case it is reached in one step. Any train that
    is solved on the way, or in the sample, counts for all quantities. It is the largest
    value *found*: where teeth hammer motions coexist, and a rare one may be missed.

    ``bound`` is beside it where the equations are linear: no tooth leaves contact in
    any train within the tolerances, which is proved too, and these are of stiffness,
    damping, loss factors, inertia, backlash, mean torques, gas factors or reciprocating
    masses. It is 2 % above the worst case, more near lightly damped resonances, and
    holds for the motion in contact (docs/theory A4.6).

    :class:`SceneError` if names are unknown, ranges do not hold the own values and the
    like, one sentence each; :class:`NotConverged` where quantities are to be chosen and
    no speed has an answer.

    Parameters
    ----------
    rpm : array ``(n,)``
    of : sequence of Objective, optional
        Quantities (``quantity``, ``of``, ``order`` count alone); by default the tooth
        force, the torque of shafts and dampers, the heat of dampers and the stress over
        its limit, each of the element where it is largest at the first speeds.
    tolerances : sequence of Tolerance, optional
        By default those of the ``[tolerance]`` table of the scene.
    samples, seed : int
        Trains of the sample, a Latin hypercube; seed of the sample and of the corners
        from which searches begin.
    harmonics, tolerance
        As in :func:`jaxhb.solve_speeds`.
    bounds : bool
        Whether bounds are asked for, which take up to some seconds for each speed and
        quantity.
    progress : callable, optional
        Told in a sentence what is computed.
    out : path, optional
        A folder to which results are written as the search goes: the same call goes on
        where it was stopped, with the same numbers to the last bit.
        :class:`jaxhb.CheckpointError` where it holds anything else, or cannot be
        written.
    executor : concurrent.futures.Executor, optional
        Where the trains of the sample are solved, as :class:`jaxhb.Workers`; the
        numbers are the same to the last bit on the same kind of machine.

    Examples
    --------
    >>> from jaxhb.design import Objective, Tolerance
    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> pulley = Tolerance(name="pulley.inertia", low=0.015, high=0.019)
    >>> torque = Objective(quantity="shaft torque", of="cyl6|flywheel")
    >>> spread = jaxhb.tolerance(
    ...     train, rpm=[1800.0, 2100.0], of=[torque], tolerances=[pulley]
    ... )
    >>> bool((spread.worst >= spread.nominal).all())
    True
    """
    refuse_tracers(
        "tolerance",
        train,
        rpm,
        instead="differentiate jaxhb.solve(train, rpm=..., plan=...)",
    )
    check_speed(train, rpm, many=True)
    rpm = np.atleast_1d(np.asarray(rpm, dtype=float))
    if tolerances:
        check_tolerances(train, tolerances)
    tolerances = tuple(tolerances) or read_tolerances(train)
    of = tuple(of) or default_quantities(train, rpm)
    faults = [
        f"{train.topology.title}, quantity {objective.quantity!r}: {sentence}"
        for objective in of
        for sentence in objective_faults(train, objective, len(rpm))
    ]
    if faults:
        raise SceneError(faults)
    request = Request.of(train, harmonics, tolerance, integrals="sampled")
    options = {
        "answers": "worst cases",
        "speeds": rpm,
        "quantities": of,
        "tolerances": tolerances,
        "seed": seed,
        "samples": samples,
        "bounds": bounds,
        **vars(request),
    }
    search = _Search(
        _Question(train, rpm, box_of(train, tolerances, of), request),
        progress or (lambda sentence: None),
        None if out is None else Checkpoint(out, train, options, None),
        executor,
    )
    search.start()
    drawn = (
        search.box.sample(samples, seed) if samples else np.zeros((0, len(tolerances)))
    )
    sampled = search.sampled(drawn)
    if search.point.solved.any():
        search.explore(seed)
        search.climb()
    bound = np.full(search.nominal.shape, np.nan)
    no_bound = np.full(search.nominal.shape, "it was not asked for")
    if bounds:
        bound, no_bound = search.bounded(harmonics)
    worst, shares = search.worst()
    has_meaning = np.column_stack([judged(train, objective, rpm) for objective in of])
    return Spread(
        train=train,
        of=of,
        tolerances=tolerances,
        rpm=rpm,
        nominal=np.where(has_meaning, search.nominal, np.nan),
        slopes=np.where(has_meaning[..., None], search.slopes, np.nan),
        worst=np.where(has_meaning, worst, np.nan),
        shares=np.where(has_meaning[..., None], shares, np.nan),
        bound=np.where(has_meaning, bound, np.nan),
        no_bound=np.where(has_meaning, no_bound, NO_LIMIT),
        samples=np.where(has_meaning[:, None], sampled, np.nan),
        drawn=drawn,
        evaluations=search.evaluations,
    )


def default_quantities(train: DriveTrain, rpm: np.ndarray) -> tuple[Objective, ...]:
    """Choose for each kind of :data:`QUANTITIES_ASKED` the element where it is largest
    at the nominal speeds.
    """
    topology = train.topology
    chosen = []
    kinds = {"tooth force": topology.mesh_names, "damper power": topology.damper_names}
    responses = solve_speeds(train, rpm=rpm)
    if not responses.solved.any():
        raise NotConverged(
            "\n".join(left_out(responses.rpm, responses.status, topology.title))
        )
    for quantity in QUANTITIES_ASKED:
        candidates = [
            Objective(quantity=quantity, of=name)
            for name in kinds.get(quantity, topology.shaft_and_damper_names)
        ]
        largest = 0.0
        largest_at = None
        for objective in candidates:
            if not objective_faults(train, objective, len(rpm)):
                values = QUANTITIES[quantity].exact_value(
                    responses, objective.of, None, train
                )
                value = float(np.max(values))  # 0 where not solved
                if value > largest:
                    largest = value
                    largest_at = objective
        if largest_at is not None:
            chosen.append(largest_at)
    if not chosen:
        raise SceneError(
            f"{topology.title}: no shaft, damper or mesh vibrates, so there is nothing"
            " to judge."
        )
    return tuple(chosen)


@dataclass(frozen=True)
class _Question:
    """Question of a search: trains within a Box at speeds ``(n,)``, how exactly."""

    train: DriveTrain
    rpm: np.ndarray
    box: Box
    request: Request


class _Search:
    """The lanes of a question: nominal ones, and those that climb.

    Its work comes in parts, each of at most so many lanes and kept when it is done
    (:meth:`_part`), so that neither memory nor the work lost when it is stopped grows
    with the speeds.
    """

    def __init__(
        self,
        question: _Question,
        say: Callable[[str], object] = lambda sentence: None,
        checkpoint: Checkpoint | None = None,
        executor: Executor | None = None,
    ):
        self.question = question
        self.train = train = question.train
        self.rpm = rpm = question.rpm
        self.box = box = question.box
        self.say = say
        self.checkpoint = checkpoint
        self.executor = executor
        self.evaluator = Evaluator(train, rpm, box, question.request)
        self.begin = self.evaluator.unsolved(box.unbounded(train)[None])
        in_contact = np.array([not plan.active for plan in self.begin.plans])
        # Without separation the equations are linear, and trains beside each other cost
        # hardly more than one.
        self.linear = in_contact[self.begin.plan_number[0]]
        together = TOGETHER_LINEAR if self.linear.all() else TOGETHER
        # Lanes of three searches for each speed and quantity.
        self.room = 3 * min(len(rpm), together) * len(box.objectives)
        self.evaluations = self.parts = 0
        # Responses (Q,) at every speed of the trains tried there, nan of those lost, by
        # their shares.
        self.tried: list[dict[tuple[float, ...], np.ndarray]] = [{} for _ in rpm]

    def _part(self, compute: Callable[[], Result]) -> Result:
        """The result of the next part of the work, computed or as it was kept, with all
        trains that it tried.
        """
        self.parts += 1
        work = partial(self._work, compute)
        keep = computed if self.checkpoint is None else self.checkpoint.keep
        return self._taken(keep(self.parts, work))

    def _work(self, compute: Callable[[], Result]) -> dict[str, Any]:
        """Compute a part: its result, the trains that it tried, and the evaluations up
        to its end.
        """
        self.log: list = []
        value = compute()
        tried = tuple(map(np.array, zip(*self.log, strict=True)))
        return {"value": value, "tried": tried, "evaluations": self.evaluations}

    def _taken(self, part: dict[str, Any]) -> Any:
        """The result of a part, whose trains are remembered."""
        for i, u, responses in zip(*part["tried"], strict=True):
            self._remember(i, u, responses)
        self.evaluations = part["evaluations"]
        return part["value"]

    def _in_parts(
        self, lanes: Sequence[Any] | np.ndarray, compute: Callable[[Any], Result]
    ) -> list[Result]:
        """Compute so many of a list of lanes at a time: the results of the parts."""
        return [
            self._part(partial(compute, lanes[first : first + self.room]))
            for first in range(0, len(lanes), self.room)
        ]

    def _solve(
        self,
        u: np.ndarray,
        near: Point,
        which: np.ndarray | bool = True,
        rescues: int = 0,
    ) -> Outcome:
        """Solve lanes of shares u ``(A, P)`` near a Point: responses ``(A, Q)``, nan
        where not solved or not ``which``, the Point, and a function from a quantity
        ``(A,)`` to its derivatives by the shares ``(A, P)``, 0 where none is.
        """
        count = len(u)
        which = np.broadcast_to(which, count)
        self.evaluations += int(which.sum())
        # Their number is a shape, and a shape is a program: one for all, and of linear
        # speeds, whose rooms are large, another for few.
        few = self.linear.all() and count <= LEAST_LANES
        room = min(LEAST_LANES, self.room) if few else self.room
        filled = np.resize(np.arange(count), max(room, count))
        to_solve = np.where(np.arange(len(filled)) < count, which[filled], False)
        lanes, pull = self.evaluator.solved(
            u[filled],
            _take(near, filled),
            to_solve[:, None],
            again=rescues > 0,
            rescues=rescues,
        )
        solved = lanes.point.solved & to_solve[:, None]

        def slopes(quantity: np.ndarray) -> np.ndarray:
            chosen = np.arange(len(self.box.objectives)) == quantity[filled][:, None]
            derivatives = np.asarray(
                pull(lanes.pulled(np.where(solved, chosen, 0.0)[:, None, :]))
            )
            return np.where(np.isfinite(derivatives), derivatives, 0.0)[:count]

        responses = np.where(solved, lanes.point.exact[:, 0], np.nan)[:count]
        point = jax.tree.map(np.asarray, _take(lanes.point, slice(count)))
        return responses, point, slopes

    def start(self) -> None:
        """Solve the train as it is at all speeds, with harmonics enough: a Point of n
        lanes, nominal values and slopes.
        """
        self.say("solving the nominal scene")
        self.nominal, self.point, self.slopes = self._part(self._started)
        # The number that moves a response most; nan counts as such.
        self.main = np.argmax(np.abs(self.slopes), axis=2)
        for tried, responses in zip(self.tried, self.nominal, strict=True):
            tried[tuple(self.box.unbounded(self.train).tolist())] = responses

    def _started(self) -> tuple[np.ndarray, Point, np.ndarray]:
        """Nominal values ``(n, Q)``, the Point of n lanes, and slopes ``(n, Q, P)``."""
        begin = self.begin
        # A lane for each speed.
        lanes = jax.tree.map(lambda leaf: np.moveaxis(leaf, 0, 1), begin)
        unfinished: Point | None = dataclasses.replace(
            lanes, z=np.repeat(begin.z, len(self.rpm), axis=0)
        )
        while unfinished is not None:
            nominal, solved, slopes = self._solve(unfinished.z, unfinished, rescues=1)
            unfinished = self.evaluator.finer(solved, solved.solved)
        by_quantity = [
            slopes(np.full(len(self.rpm), j)) for j in range(len(self.box.objectives))
        ]
        is_solved = np.isfinite(nominal)[..., None]
        nominal_slopes = np.where(is_solved, np.stack(by_quantity, axis=1), np.nan)
        return nominal, solved, nominal_slopes

    def _at(
        self,
        speed: np.ndarray,
        u: np.ndarray,
        which: np.ndarray | bool = True,
        near: Point | None = None,
    ) -> Outcome:
        """Solve lanes at speeds of index ``(A,)``, as :meth:`_solve`; all that is
        solved counts for all quantities.
        """
        near = _take(self.point, speed) if near is None else near
        outcome = self._solve(u, near, which)
        for lane in np.flatnonzero(np.broadcast_to(which, len(u))):
            tried = int(speed[lane]), u[lane], outcome[0][lane]
            self._remember(*tried)
            self.log.append(tried)
        return outcome

    def _remember(self, i: int, u: np.ndarray, responses: np.ndarray) -> None:
        """Keep the largest responses ``(Q,)`` of a train of shares ``(P,)`` at a
        speed.
        """
        shares = tuple(u.tolist())
        largest = self.tried[i].get(shares, responses)
        self.tried[i][shares] = np.fmax(largest, responses)

    def sampled(self, drawn: np.ndarray, which: np.ndarray | bool = True) -> np.ndarray:
        """Responses ``(n, S, Q)`` of a sample ``(S, P)``, its lanes near those of the
        train as it is, at speeds ``which``.
        """
        speeds = np.flatnonzero(self.point.solved[:, 0] & which)
        sampled = np.full((len(self.rpm), len(drawn), len(self.box.objectives)), np.nan)
        lanes = [(draw, i) for draw in range(len(drawn)) for i in speeds]
        chunks = [
            lanes[first : first + self.room]
            for first in range(0, len(lanes), self.room)
        ]
        numbers = range(self.parts + 1, self.parts + len(chunks) + 1)
        self.parts += len(chunks)
        lengths = map(len, chunks[:-1])
        before = itertools.accumulate(lengths, initial=self.evaluations)
        parts = list(zip(chunks, before, strict=False))
        compute = partial(self.sampled_part, drawn)
        if self.executor is not None:
            compute = partial(_sampled_part, self.question, self.point, drawn)
        sampled_parts = dict(
            answered_parts(self.checkpoint, numbers, compute, parts, self.executor)
        )
        # In their order, whatever the order in which they came.
        values = [self._taken(sampled_parts[number]) for number in range(len(chunks))]
        responses = itertools.chain.from_iterable(values)
        for (draw, i), values in zip(lanes, responses, strict=True):
            sampled[i, draw] = values
        return sampled

    def sampled_part(
        self, drawn: np.ndarray, lanes: list[tuple[int, int]], evaluations: int
    ) -> dict[str, Any]:
        """Solve some (draw, speed) of a sample ``(S, P)``, after so many
        ``evaluations``.
        """
        draw, i = np.array(lanes).T
        self.say(f"{draw[0]} of {len(drawn)} trains within the tolerances")
        self.evaluations = evaluations

        def solve() -> np.ndarray:
            responses, _, _ = self._at(i, drawn[draw])
            return responses

        return self._work(solve)

    def explore(self, seed: int) -> None:
        """Solve some corners of the range; for each quantity those to which its slopes
        at these and at the train as it is point, and the latter with the number that
        moves it most at its other end: a resonance has two sides.
        """
        linear = np.array([not plan.active for plan in self.point.plans])[
            self.point.plan_number[:, 0]
        ]
        self.sampled(self.box.sample(EXPLORED_LINEAR, seed), linear)
        speeds = np.flatnonzero(self.point.solved[:, 0])
        pointed = []
        for slope, main in zip(
            np.moveaxis(self.slopes[speeds], 1, 0), self.main[speeds].T, strict=True
        ):
            toward = np.where(slope < 0, -1.0, 1.0)
            across = np.where(
                np.arange(slope.shape[1]) == main[:, None], -toward, toward
            )
            pointed += [(speeds, toward), (speeds, across)]
        for corner in self.box.corners(seed):
            parts = self._in_parts(speeds, partial(self._pointed, corner))
            pointed += itertools.chain.from_iterable(parts)
        self._visit(
            np.concatenate([speed for speed, _ in pointed]),
            np.concatenate([corners for _, corners in pointed]),
        )

    def _pointed(
        self, corner: np.ndarray, speeds: np.ndarray
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """For each quantity the speeds at which the train of a corner is solved, and
        the corners to which it points.
        """
        values, _, slopes = self._at(speeds, np.tile(corner, (len(speeds), 1)))
        pointed = []
        for j, solved in enumerate(np.isfinite(values).T):
            slope = slopes(np.full(len(speeds), j))[solved]
            pointed.append((speeds[solved], np.where(slope, np.sign(slope), corner)))
        return pointed

    def _visit(self, speed: Iterable[int], u: Iterable[np.ndarray]) -> None:
        """Solve trains of shares u ``(A, P)``, at speeds of index ``(A,)``, that have
        not been tried there.
        """
        lanes = [
            (int(i), tuple(np.asarray(shares).tolist()))
            for i, shares in zip(speed, u, strict=True)
        ]
        fresh = list(
            dict.fromkeys(
                (i, shares) for i, shares in lanes if shares not in self.tried[i]
            )
        )

        def solve(part: list[tuple[int, tuple[float, ...]]]) -> None:
            speeds = np.array([i for i, _ in part])
            self._at(speeds, np.array([shares for _, shares in part]))

        self._in_parts(fresh, solve)

    def climb(self) -> None:
        """Search for the worst case of every speed and quantity from the best of all
        trains solved so far, from the train as it is, and from the best on the other
        side of the number that moves it most, where it promises as much; all side by
        side. Then from the worst cases of the speeds beside it, where these are worse
        here: where motions coexist, slopes of one know nothing of others.
        """

        def ascend(part: list[tuple]) -> None:
            speed, quantity, u = map(np.array, zip(*part, strict=True))
            self._ascend(speed, quantity, u)

        starts = []
        begin = tuple(self.box.unbounded(self.train).tolist())
        for i, j in np.argwhere(np.isfinite(self.nominal)):
            u, responses = _arrays(self.tried[i])
            values = responses[:, j]
            order = np.argsort(-np.nan_to_num(values, nan=-np.inf), kind="stable")
            first = order[0]
            across = np.abs(u - u[first])[:, self.main[i, j]] > APART
            promising = [
                lane
                for lane in order[1:]
                if across[lane] and values[lane] > PROMISING * values[first]
            ]
            # A climb from a corner mostly ends at one; that from the middle finds what
            # is largest inside the range.
            places = dict.fromkeys(
                [
                    tuple(u[first].tolist()),
                    begin,
                    *(tuple(u[lane].tolist()) for lane in promising[:1]),
                ]
            )
            starts += [(i, j, place) for place in places]
        by_speed = [i for i in np.argsort(self.rpm) if self.point.solved[i, 0]]
        neighbours = [
            *itertools.pairwise(by_speed),
            *itertools.pairwise(by_speed[::-1]),
        ]
        for _ in range(ROUNDS):
            if not starts:
                return
            self._in_parts(starts, ascend)
            worst, shares = self.worst()
            lanes = [(i, u) for other, i in neighbours for u in shares[other]]
            self._visit([i for i, _ in lanes], [u for _, u in lanes])
            after, shares = self.worst()
            starts = [
                (i, j, shares[i, j]) for i, j in np.argwhere(after > (1 + GAIN) * worst)
            ]

    def bounded(self, harmonics: int | None) -> tuple[np.ndarray, np.ndarray]:
        """Bounds and why there is none ``(n, Q)``; trains on their way with larger
        responses than all found so far are solved too.
        """
        worst, _ = self.worst()
        bound = []
        no_bound = []
        places = []
        for first in range(0, len(self.rpm), TOGETHER):
            self.say(
                f"bounds over all trains within the tolerances: {first} of"
                f" {len(self.rpm)} speeds are done"
            )
            speeds = slice(first, first + TOGETHER)
            values, why, above = self._part(
                partial(
                    bounds_over_box,
                    self.train,
                    self.rpm[speeds],
                    self.box,
                    worst[speeds],
                    harmonics,
                )
            )
            bound.append(values)
            no_bound.append(why)
            places += [(first + i, u) for i, u in above]
        self._visit([i for i, _ in places], [u for _, u in places])
        return np.concatenate(bound), np.concatenate(no_bound)

    def worst(self) -> tuple[np.ndarray, np.ndarray]:
        """The largest response of all trains solved, by speed and quantity ``(n, Q)``,
        and its shares ``(n, Q, P)``.
        """
        shares = np.zeros(self.slopes.shape)
        values = self.nominal.copy()
        for i, tried in enumerate(self.tried):
            u, responses = _arrays(tried)
            if np.isfinite(self.nominal[i]).any():
                first = np.nanargmax(responses, axis=0)
                shares[i] = u[first]
                values[i] = responses[first, np.arange(responses.shape[1])]
        return values, shares

    def _ascend(self, speed: np.ndarray, quantity: np.ndarray, u: np.ndarray) -> None:
        """Climb from shares u ``(A, P)`` at all lanes at once, by BFGS in the numbers
        that are free to move, along the projection of its way.
        """
        values, point, slopes = self._at(speed, u)
        unknown = np.full(values.shape[1], np.inf)
        lanes = np.arange(len(u))
        value = values[lanes, quantity]
        slope = slopes(quantity)
        moving = np.isfinite(value)
        idle = np.zeros(len(u), dtype=int)
        # The first step leads to the corner to which the slope points.
        curvature = np.abs(slope)[:, :, None] * np.eye(u.shape[1]) / 2
        for step in range(CLIMBS):
            direction = np.stack(
                [_direction(u[k], slope[k], curvature[k]) for k in lanes]
            )
            moving &= (direction * slope).sum(axis=1) > GAIN * np.abs(value)
            if not moving.any():
                return
            self.say(
                f"worst case: step {step + 1}, {moving.sum()} of {len(u)} searches"
                " go on"
            )
            length = np.ones(len(u))
            climbing = moving.copy()
            won = np.zeros(len(u))
            for _ in range(TRIALS):
                trial = np.clip(u + length[:, None] * direction, -1.0, 1.0)
                rise = ((trial - u) * slope).sum(axis=1)
                # A train known to be lost or no larger is not solved again.
                places = zip(speed, quantity, map(tuple, trial.tolist()), strict=True)
                known_value = np.array(
                    [self.tried[i].get(shares, unknown)[j] for i, j, shares in places]
                )
                to_solve = climbing & (known_value >= value + ASCENT * rise)
                values, solved, slopes = self._at(speed, trial, to_solve, point)
                trial_value = np.where(to_solve, values[lanes, quantity], known_value)
                rises = to_solve & (trial_value >= value + ASCENT * rise)
                if rises.any():
                    steep = slopes(np.where(rises, quantity, -1))
                    for k in np.flatnonzero(rises):
                        curvature[k] = _updated(
                            curvature[k], trial[k] - u[k], slope[k] - steep[k]
                        )
                    won = np.where(rises, trial_value - value, won)
                    value = np.where(rises, trial_value, value)
                    point, u, slope = where(
                        rises, (solved, trial, steep), (point, u, slope)
                    )
                climbing &= ~rises
                if not climbing.any():
                    break
                # To the vertex of the parabola through value, slope and what the trial
                # found; a lost one is halved.
                with np.errstate(divide="ignore", invalid="ignore"):
                    vertex = 0.5 * rise / (value + rise - trial_value)
                length *= np.where(np.isfinite(vertex), np.clip(vertex, 0.1, 0.5), 0.5)
            idle = np.where(won > GAIN * np.abs(value), 0, idle + 1)
            moving &= idle < PATIENCE


def _sampled_part(
    question: _Question,
    point: Point,
    drawn: np.ndarray,
    lanes: list[tuple[int, int]],
    evaluations: int,
) -> dict[str, Any]:
    """A part of a sample near the trains of a Point, in another process."""
    search = _Search(question)
    search.point = point
    return search.sampled_part(drawn, lanes, evaluations)


def _arrays(
    tried: dict[tuple[float, ...], np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Shares ``(T, P)`` and responses ``(T, Q)`` of the trains tried at a speed."""
    return np.array(list(tried)), np.array(list(tried.values()))


def _take(point: Point, which: np.ndarray | slice) -> Point:
    """Select the Point of some lanes."""
    return jax.tree.map(lambda leaf: leaf[which], point)


def _direction(u: np.ndarray, slope: np.ndarray, curvature: np.ndarray) -> np.ndarray:
    """BFGS's way up ``(P,)`` of one lane; numbers at an end of their range, beyond
    which it would rise, rest.
    """
    free = ~(((u >= 1.0) & (slope > 0)) | ((u <= -1.0) & (slope < 0))) & (slope != 0)
    direction = np.zeros_like(u)
    # Beside a fold slopes are of any size, and the matrix may be singular to rounding.
    direction[free] = np.linalg.lstsq(curvature[np.ix_(free, free)], slope[free])[0]
    return direction


def _updated(curvature: np.ndarray, step: np.ndarray, fall: np.ndarray) -> np.ndarray:
    """Update the approximate negative Hessian ``(P, P)`` after a step, in which the
    slope fell by ``fall``; as it was where none did.
    """
    along = fall @ step
    if not along > CURVED * np.linalg.norm(fall) * np.linalg.norm(step):
        return curvature
    old = curvature @ step
    return curvature + np.outer(fall, fall) / along - np.outer(old, old) / (step @ old)

"""What tolerances do to a response: sensitivities, the worst case, percentiles.

A lane is one train within its tolerances at one speed, its numbers the shares u of a
:class:`Box`. All lanes of a question are solved by the evaluation of tunings
(:mod:`jaxhb.design.evaluation`), whose gradients say which way leads to larger
responses.
"""

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxhb._jax import Numbers, refuse_tracers
from jaxhb._shown import brief
from jaxhb.balance.plan import Request
from jaxhb.design.bounds_over_box import bounds_over_box
from jaxhb.design.evaluation import Evaluator, pull_back, where
from jaxhb.design.quantities import (
    QUANTITIES,
    Objective,
    judged,
    label,
    objective_faults,
)
from jaxhb.design.tolerances import Tolerance, box_of, check_tolerances, read_tolerances
from jaxhb.elements.elements import SceneError
from jaxhb.results.answers import left_out
from jaxhb.results.checkpoint import Cached, keeper
from jaxhb.results.status import NotConverged
from jaxhb.solutions.speeds import solve_speeds
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import check_speed

ROUNDS = 3  # searches from one speed to the next
CLIMBS = 12  # steps of a search for a worst case at most
TRIALS = 5  # lengths of a step
APART, PROMISING = (
    1.0,
    0.8,
)  # difference of a share, and share of the best value, that another start is worth
# Trains where no tooth separates, from which searches may begin, beside the corners
EXPLORED_LINEAR = 64
GAIN, PATIENCE = (
    1e-3,
    2,
)  # share of the value below which a step has won nothing; so many of them end a search
ASCENT = 1e-4
CURVED = 1e-8
"""Share of the slope that a step has to win, Armijo's condition; cosine of step and
change of the slope at least.
"""
NO_LIMIT = "the rule of the shaft has no limit there"
TOGETHER = 8  # speeds whose searches are solved, and kept, together
QUANTITIES_ASKED = (
    "tooth force",
    "shaft torque",
    "damper power",
    "stress over continuous limit",
)


@brief
@dataclass(frozen=True)
class Spread:
    """Result of :func:`tolerance`: n speeds, Q quantities, P tolerances, S samples. SI
    units, nan where not solved and where the rule of a shaft has no limit of which a
    stress would be a share.

    of : tuple of Objective; tolerances : tuple of Tolerance; rpm : ``(n,)`` nominal :
    ``(n, Q)``, of the train as the scene has it slopes : ``(n, Q, P)``, change of the
    response over half the range of a number, by the derivative at the own values worst,
    shares : ``(n, Q)`` and ``(n, Q, P)``, the largest response found and the shares u
    of the numbers there bound : ``(n, Q)``, what no response within the tolerances
    exceeds, teeth in contact, nan where that is not proved no_bound : ``(n, Q)``, why
    there is no bound, "" where there is one samples, drawn : ``(n, S, Q)`` and ``(S,
    P)``, responses of a sample and the shares u drawn evaluations : solves of one
    speed, those of the sample included
    """

    train: DriveTrain
    of: tuple
    tolerances: tuple
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
        """What each quantity is: ``"tooth force of crank gear|idler"``."""
        return [label(one) for one in self.of]

    @property
    def judged(self) -> np.ndarray:
        """Whether each quantity has a meaning at each speed ``(n, Q)``: a share of a
        limit has none where the rule has no limit.
        """
        return np.column_stack(
            [judged(self.train, chosen, self.rpm) for chosen in self.of]
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
        found = self.slopes.copy()
        count = 3 * self.drawn.shape[1]
        for i, (responses, kept, meant) in enumerate(
            zip(self.samples, self.drawn_solved, self.judged, strict=True)
        ):
            if kept.sum() >= count:
                shares = np.column_stack([np.ones(kept.sum()), self.drawn[kept]])
                found[i, meant] = np.linalg.lstsq(shares, responses[kept][:, meant])[0][
                    1:
                ].T
        return found

    def percentile(self, q: float) -> np.ndarray:
        """Of the samples that are solved ``(n, Q)``; nan where none is."""
        found = np.full(self.nominal.shape, np.nan)
        for i, (responses, kept, meant) in enumerate(
            zip(self.samples, self.drawn_solved, self.judged, strict=True)
        ):
            if kept.any():
                found[i, meant] = np.percentile(responses[kept][:, meant], q, axis=0)
        return found

    def to_xarray(self) -> Any:
        """Labelled arrays over ``rpm``, ``quantity`` and ``number``; needs
        ``jaxhb[data]``.
        """
        import xarray

        over = ("rpm", "quantity")
        found = {
            "nominal": (
                over,
                self.nominal,
                {
                    "long_name": (
                        "response of the scene as it is, in the unit of the quantity"
                    )
                },
            ),
            "worst": (
                over,
                self.worst,
                {"long_name": "largest response found within the tolerances"},
            ),
            "bound": (
                over,
                self.bound,
                {
                    "long_name": (
                        "what no response exceeds within the tolerances, where proved"
                    )
                },
            ),
            "no_bound": (over, self.no_bound, {"long_name": "why there is no bound"}),
            "slope": (
                (*over, "number"),
                self.slopes,
                {"long_name": "change over half the range of a number"},
            ),
            "at_worst": (
                (*over, "number"),
                self.numbers,
                {"long_name": "number at the largest response"},
            ),
        }
        if self.drawn.size:
            found["sample"] = (
                ("rpm", "draw", "quantity"),
                self.samples,
                {"long_name": "responses of a random sample"},
            )
            found["draw_share"] = (
                ("draw", "number"),
                self.drawn,
                {"long_name": "place in the range, -1 to 1"},
            )
        units = ("quantity", [QUANTITIES[one.quantity].unit for one in self.of])
        names = {
            "rpm": self.rpm,
            "quantity": self.labels,
            "number": [one.name for one in self.tolerances],
        }
        return xarray.Dataset(
            found,
            coords=names | {"unit": units},
            attrs={"scene": self.train.topology.name},
        )

    @property
    def numbers(self) -> np.ndarray:
        """The numbers with a tolerance at the worst case of every speed and quantity
        ``(n, Q, P)``.
        """
        low, high = np.array([(one.low, one.high) for one in self.tolerances]).T
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
) -> Spread:
    """What the tolerances of a train do to its response at some speeds.

    At each speed and of each quantity: the value of the train as it is; by the
    derivative of :func:`jaxhb.solve`, which number moves it how far over its own
    tolerance; the largest value within all tolerances that is found, and where; what no
    value exceeds, where that can be proved; and percentiles of a random sample.

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
        from which is searched.
    harmonics, tolerance
        As in :func:`jaxhb.solve_speeds`.
    bounds : bool
        Whether bounds are asked for, which take up to some seconds for each speed and
        quantity.
    progress : callable, optional
        Told in a sentence what is computed.
    out : path, optional
        A folder to which what is found is written as the search goes: the same call
        goes on where it was stopped, with the same numbers to the last bit.
        :class:`jaxhb.CheckpointError` where it holds anything else, or cannot be
        written.

    Examples
    --------
    >>> from jaxhb.design import Objective, Tolerance
    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> pulley = Tolerance(name="pulley.inertia", low=0.015, high=0.019)
    >>> torque = Objective(quantity="shaft torque", of="cyl6|flywheel")
    >>> found = jaxhb.tolerance(
    ...     train, rpm=[1800.0, 2100.0], of=[torque], tolerances=[pulley]
    ... )
    >>> bool((found.worst >= found.nominal).all())
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
        (one.quantity, text)
        for one in of
        for text in objective_faults(train, one, len(rpm))
    ]
    if faults:
        raise SceneError(
            [
                f"{train.topology.title}, quantity {name!r}: {text}"
                for name, text in faults
            ]
        )
    request = Request.of(train, harmonics, tolerance, integrals="sampled")
    asked = {
        "answers": "worst cases",
        "speeds": rpm,
        "quantities": of,
        "tolerances": tolerances,
        "seed": seed,
    }
    keep = keeper(
        out, train, asked | {"samples": samples, "bounds": bounds, **vars(request)}
    )
    search = _Search(
        train,
        rpm,
        box_of(train, tolerances, of),
        request,
        progress or (lambda text: None),
        keep,
    )
    search.start()
    drawn = (
        search.box.sample(samples, seed) if samples else np.zeros((0, len(tolerances)))
    )
    sampled = search.sampled(drawn)
    if search.point.solved.any():
        search.explore(seed)
        search.climb()
    none = (
        np.full(search.nominal.shape, np.nan),
        np.full(search.nominal.shape, "it was not asked for"),
    )
    bound, no_bound = search.bounded(harmonics) if bounds else none
    worst, shares = search.worst()
    found = {"worst": worst, "shares": shares, "bound": bound, "no_bound": no_bound}
    found |= {
        "rpm": rpm,
        "nominal": search.nominal,
        "slopes": search.slopes,
        "samples": sampled,
        "drawn": drawn,
    }
    meant = np.column_stack([judged(train, chosen, rpm) for chosen in of])
    found |= {
        name: np.where(meant, found[name], np.nan)
        for name in ("nominal", "worst", "bound")
    }
    found |= {
        name: np.where(meant[..., None], found[name], np.nan)
        for name in ("slopes", "shares")
    }
    found["samples"] = np.where(meant[:, None], sampled, np.nan)
    found["no_bound"] = np.where(meant, no_bound, NO_LIMIT)
    return Spread(train, of, tolerances, **found, evaluations=search.evaluations)


def default_quantities(train, rpm):
    """Of each kind of :data:`QUANTITIES_ASKED` the element where it is largest at the
    nominal speeds.
    """
    topology = train.topology
    largest = {}
    kinds = {"tooth force": topology.mesh_names, "damper power": topology.damper_names}
    responses = solve_speeds(train, rpm=rpm)
    if not responses.solved.any():
        raise NotConverged(
            "\n".join(left_out(responses.rpm, responses.status, topology.title))
        )
    for quantity in QUANTITIES_ASKED:
        asked = [
            Objective(quantity=quantity, of=name)
            for name in kinds.get(quantity, topology.shaft_and_damper_names)
        ]
        for one in asked:
            if not objective_faults(train, one, len(rpm)):
                value = np.max(
                    QUANTITIES[quantity].exact_value(responses, one.of, None, train)
                )  # 0 where not solved
                if value > largest.get(quantity, (0.0,))[0]:
                    largest[quantity] = value, one
    if not largest:
        raise SceneError(
            f"{topology.title}: no shaft, damper or mesh vibrates, so there is nothing"
            " to judge."
        )
    return tuple(one for _, one in largest.values())


class _Search:
    """The lanes of a question: nominal ones, and those that climb.

    Its work comes in parts, each of at most so many lanes and kept when it is done
    (:meth:`_part`), so that neither memory nor what is lost when it is stopped grows
    with the speeds.
    """

    def __init__(self, train, rpm, box, request, say, keep):
        self.train = train
        self.rpm = rpm
        self.box = box
        self.say = say
        self.keep = keep
        self.evaluator = Evaluator(train, rpm, box, request)
        # Lanes of three searches for each speed and quantity.
        self.room = 3 * min(len(rpm), TOGETHER) * len(box.objectives)
        self.evaluations = self.parts = 0
        self.tried = [{} for _ in rpm]
        """Of every speed the responses (Q,) of the trains tried there, nan of those
        lost, by their shares.
        """

    def _part(self, compute):
        """What the next part of the work gives, computed or as it was kept, with all
        trains that it tried.
        """
        self.parts += 1
        self.log = []

        def work():
            value = compute()
            tried = tuple(map(np.array, zip(*self.log, strict=True)))
            return {"value": value, "tried": tried, "evaluations": self.evaluations}

        part = self.keep(self.parts, work)
        for i, u, responses in zip(*part["tried"], strict=True):
            z = tuple(u.tolist())
            self.tried[i][z] = np.fmax(self.tried[i].get(z, responses), responses)
        self.evaluations = part["evaluations"]
        return part["value"]

    def _in_parts(self, lanes, compute):
        """``compute`` of so many of a list of lanes at a time."""
        return [
            self._part(partial(compute, lanes[first : first + self.room]))
            for first in range(0, len(lanes), self.room)
        ]

    def _solve(self, u, near, which=True, rescues=0):
        """Lanes of shares u ``(A, P)`` near a Point: responses ``(A, Q)``, nan where
        not solved or not ``which``, the Point, and a function from a quantity ``(A,)``
        to its derivatives by the shares ``(A, P)``, 0 where none is.
        """
        count, which = len(u), np.broadcast_to(which, len(u))
        self.evaluations += int(which.sum())
        # Always as many lanes: their number is a shape, and a shape is a program.
        filled = np.resize(np.arange(count), max(self.room, count))
        asked = np.where(np.arange(len(filled)) < count, which[filled], False)
        lanes, pull = self.evaluator.solved(
            u[filled],
            _take(near, filled),
            asked[:, None],
            again=rescues > 0,
            rescues=rescues,
        )
        solved = lanes.point.solved & asked[:, None]

        def slopes(quantity):
            chosen = np.arange(len(self.box.objectives)) == quantity[filled][:, None]
            by = np.asarray(
                pull_back(pull, lanes.pulled(np.where(solved, chosen, 0.0)[:, None, :]))
            )
            return np.where(np.isfinite(by), by, 0.0)[:count]

        responses = np.where(solved, lanes.point.exact[:, 0], np.nan)[:count]
        return (
            responses,
            jax.tree.map(np.asarray, _take(lanes.point, slice(count))),
            slopes,
        )

    def start(self):
        """The train as it is at all speeds, with harmonics enough: a Point of n lanes,
        nominal values and slopes.
        """
        self.say("solving the scene as it is")
        self.nominal, self.point, self.slopes = self._part(self._started)
        self.main = np.argmax(
            np.abs(self.slopes), axis=2
        )  # the number that moves a response most; nan counts as such
        for tried, responses in zip(self.tried, self.nominal, strict=True):
            tried[tuple(self.box.unbounded(self.train).tolist())] = responses

    def _started(self):
        begin = self.evaluator.unsolved(self.box.unbounded(self.train)[None])
        point = jax.tree.map(
            lambda leaf: np.moveaxis(leaf, 0, 1), begin
        )  # a lane for each speed
        point = dataclasses.replace(point, z=np.repeat(begin.z, len(self.rpm), axis=0))
        while point is not None:
            nominal, solved, slopes = self._solve(point.z, point, rescues=1)
            point = self.evaluator.finer(solved, solved.solved)
        every = [
            slopes(np.full(len(self.rpm), j)) for j in range(len(self.box.objectives))
        ]
        return (
            nominal,
            solved,
            np.where(np.isfinite(nominal)[..., None], np.stack(every, axis=1), np.nan),
        )

    def _at(self, speed, u, which=True, near=None):
        """As :meth:`_solve`, of lanes at speeds of index ``(A,)``; all that is solved
        counts for all quantities.
        """
        found = self._solve(
            u, _take(self.point, speed) if near is None else near, which
        )
        lanes = zip(
            speed.tolist(),
            map(tuple, u.tolist()),
            found[0],
            np.broadcast_to(which, len(u)),
            strict=True,
        )
        for i, z, responses, asked in lanes:
            if asked:
                self.tried[i][z] = np.fmax(self.tried[i].get(z, responses), responses)
                self.log.append((i, z, responses))
        return found

    def sampled(self, drawn, which=True):
        """Responses ``(n, S, Q)`` of a sample, its lanes near those of the train as it
        is, at speeds ``which``.
        """
        speeds = np.flatnonzero(self.point.solved[:, 0] & which)
        found = np.full((len(self.rpm), len(drawn), len(self.box.objectives)), np.nan)
        lanes = [(k, i) for k in range(len(drawn)) for i in speeds]

        def solved(part):
            k, i = np.array(part).T
            self.say(f"{k[0]} of {len(drawn)} trains within the tolerances")
            return self._at(i, drawn[k])[0]

        for (k, i), values in zip(
            lanes, itertools.chain(*self._in_parts(lanes, solved)), strict=True
        ):
            found[i, k] = values
        return found

    def explore(self, seed):
        """Some corners of the range; for each quantity those to which its slopes at
        these and at the train as it is point, and the latter with the number that moves
        it most at its other end: a resonance has two sides.
        """
        # Without separation the equations are linear, and trains beside each other cost
        # hardly more than one.
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
            pointed += itertools.chain(
                *self._in_parts(speeds, partial(self._pointed, corner))
            )
        self._visit(*map(np.concatenate, zip(*pointed, strict=True)))

    def _pointed(self, corner, speeds):
        """Of each quantity the speeds at which the train of a corner is solved, and the
        corners to which it points.
        """
        values, _, slopes = self._at(speeds, np.tile(corner, (len(speeds), 1)))
        pointed = []
        for j, solved in enumerate(np.isfinite(values).T):
            slope = slopes(np.full(len(speeds), j))[solved]
            pointed.append((speeds[solved], np.where(slope, np.sign(slope), corner)))
        return pointed

    def _visit(self, speed, u):
        """Solve trains of shares u ``(A, P)``, at speeds of index ``(A,)``, that have
        not been tried there.
        """
        lanes = [
            (int(i), tuple(np.asarray(z).tolist()))
            for i, z in zip(speed, u, strict=True)
        ]
        fresh = list(dict.fromkeys((i, z) for i, z in lanes if z not in self.tried[i]))

        def solve(part):
            speed, u = zip(*part, strict=True)
            self._at(np.array(speed), np.array(u))

        self._in_parts(fresh, solve)

    def climb(self):
        """Search for the worst case of every speed and quantity from the best of all
        trains solved so far, from the train as it is, and from the best on the other
        side of the number that moves it most, where it promises as much; all side by
        side. Then from the worst cases of the speeds beside it, where these are worse
        here: where motions coexist, slopes of one know nothing of others.
        """
        starts = []
        begin = tuple(self.box.unbounded(self.train).tolist())
        for i, j in np.argwhere(np.isfinite(self.nominal)):
            u, responses = _arrays(self.tried[i])
            values = responses[:, j]
            order = np.argsort(-np.nan_to_num(values, nan=-np.inf), kind="stable")
            first = order[0]
            across = np.abs(u - u[first])[:, self.main[i, j]] > APART
            promising = [
                k
                for k in order[1:]
                if across[k] and values[k] > PROMISING * values[first]
            ]
            # A climb from a corner mostly ends at one; that from the middle finds what
            # is largest inside the range.
            places = dict.fromkeys(
                [
                    tuple(u[first].tolist()),
                    begin,
                    *(tuple(u[k].tolist()) for k in promising[:1]),
                ]
            )
            starts += [(i, j, z) for z in places]
        by_speed = [i for i in np.argsort(self.rpm) if self.point.solved[i, 0]]
        beside = [*itertools.pairwise(by_speed), *itertools.pairwise(by_speed[::-1])]
        for _ in range(ROUNDS):
            if not starts:
                return
            self._in_parts(
                starts,
                lambda part: self._ascend(*map(np.array, zip(*part, strict=True))),
            )
            worst, shares = self.worst()
            lanes = [(i, u) for other, i in beside for u in shares[other]]
            self._visit([i for i, _ in lanes], [u for _, u in lanes])
            after, shares = self.worst()
            starts = [
                (i, j, shares[i, j]) for i, j in np.argwhere(after > (1 + GAIN) * worst)
            ]

    def bounded(self, harmonics):
        """Bounds and why there is none ``(n, Q)``; what is larger than all found so far
        on their way is solved too.
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
            asked = self.train, self.rpm[speeds], self.box, worst[speeds], harmonics
            values, why, above = self._part(partial(bounds_over_box, *asked))
            bound.append(values)
            no_bound.append(why)
            places += [(first + i, u) for i, u in above]
        self._visit([i for i, _ in places], [u for _, u in places])
        return np.concatenate(bound), np.concatenate(no_bound)

    def worst(self):
        """The largest response of all trains solved, by speed and quantity ``(n, Q)``,
        and its shares ``(n, Q, P)``.
        """
        shares = np.zeros(self.slopes.shape)
        values = self.nominal.copy()
        for i, tried in enumerate(self.tried):
            u, own = _arrays(tried)
            if np.isfinite(self.nominal[i]).any():
                first = np.nanargmax(own, axis=0)
                shares[i], values[i] = u[first], own[first, np.arange(own.shape[1])]
        return values, shares

    def _ascend(self, speed, quantity, u):
        """Climb from shares u ``(A, P)`` at all lanes at once, by BFGS in the numbers
        that are free to move, along the projection of its way.
        """
        values, point, slopes = self._at(speed, u)
        unknown = np.full(values.shape[1], np.inf)
        lanes = np.arange(len(u))
        value = values[np.arange(len(u)), quantity]
        slope = slopes(quantity)
        moving = np.isfinite(value)
        idle = np.zeros(len(u), dtype=int)
        # The first step leads to the corner to which the slope points.
        curvature = np.abs(slope)[:, :, None] * np.eye(u.shape[1]) / 2
        for climb in range(CLIMBS):
            way = np.stack(
                [_way(*lane) for lane in zip(u, slope, curvature, strict=True)]
            )
            moving &= (way * slope).sum(axis=1) > GAIN * np.abs(value)
            if not moving.any():
                return
            self.say(
                f"worst case: step {climb + 1}, {moving.sum()} of {len(u)} searches"
                " go on"
            )
            length = np.ones(len(u))
            climbing = moving.copy()
            won = np.zeros(len(u))
            for _ in range(TRIALS):
                trial = np.clip(u + length[:, None] * way, -1.0, 1.0)
                rise = ((trial - u) * slope).sum(axis=1)
                # What is known to be lost or no larger is not solved again.
                places = zip(speed, quantity, map(tuple, trial.tolist()), strict=True)
                known = np.array(
                    [self.tried[i].get(z, unknown)[j] for i, j, z in places]
                )
                asked = climbing & (known >= value + ASCENT * rise)
                values, solved, slopes = self._at(speed, trial, asked, point)
                own = np.where(asked, values[lanes, quantity], known)
                good = asked & (own >= value + ASCENT * rise)
                if good.any():
                    steep = slopes(np.where(good, quantity, -1))
                    for k in np.flatnonzero(good):
                        curvature[k] = _updated(
                            curvature[k], trial[k] - u[k], slope[k] - steep[k]
                        )
                    won = np.where(good, own - value, won)
                    value = np.where(good, own, value)
                    point, u, slope = where(
                        good, (solved, trial, steep), (point, u, slope)
                    )
                climbing &= ~good
                if not climbing.any():
                    break
                # To the vertex of the parabola through value, slope and what the trial
                # found; a lost one is halved.
                with np.errstate(divide="ignore", invalid="ignore"):
                    vertex = 0.5 * rise / (value + rise - own)
                length *= np.where(np.isfinite(vertex), np.clip(vertex, 0.1, 0.5), 0.5)
            idle = np.where(won > GAIN * np.abs(value), 0, idle + 1)
            moving &= idle < PATIENCE


def _arrays(tried):
    """Shares ``(T, P)`` and responses ``(T, Q)`` of the trains tried at a speed."""
    return np.array(list(tried)), np.array(list(tried.values()))


def _take(point, which):
    """The Point of some lanes."""
    return jax.tree.map(lambda leaf: leaf[which], point)


def _way(u, slope, curvature):
    """BFGS's way up of one lane; numbers at an end of their range, beyond which it
    would rise, rest.
    """
    free = ~(((u >= 1.0) & (slope > 0)) | ((u <= -1.0) & (slope < 0))) & (slope != 0)
    way = np.zeros_like(u)
    # Beside a fold slopes are of any size, and the matrix may be singular to rounding.
    way[free] = np.linalg.lstsq(curvature[np.ix_(free, free)], slope[free])[0]
    return way


def _updated(curvature, step, fall):
    """The approximate negative Hessian after a step, in which the slope fell by
    ``fall``; as it was where none did.
    """
    along = fall @ step
    if not along > CURVED * np.linalg.norm(fall) * np.linalg.norm(step):
        return curvature
    old = curvature @ step
    return curvature + np.outer(fall, fall) / along - np.outer(old, old) / (step @ old)

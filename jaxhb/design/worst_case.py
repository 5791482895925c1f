"""What tolerances do to a response: sensitivities, the worst case, percentiles.

A lane is one train within its tolerances at one speed, its numbers the shares u of a :class:`Box`. All lanes of a
question are solved by the evaluation of tunings (:mod:`jaxhb.design.evaluation`), whose gradients say which way leads
to larger responses.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import jax
import numpy as np

from jaxhb._jax import Numbers
from jaxhb._shown import brief
from jaxhb.balance.plan import Request
from jaxhb.design.evaluation import Evaluator, pull_back, where
from jaxhb.design.quantities import Objective, label, objective_faults
from jaxhb.design.tolerances import Tolerance, box_of, check_tolerances, read_tolerances
from jaxhb.elements.elements import SceneError
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import check_speed

CLIMBS = 12  # steps of a search for a worst case at most
TRIALS = 5  # lengths of a step
APART, PROMISING = 1.0, 0.8  # difference of a share, and share of the best value, from which a second start is worth it
GAIN = 1e-3  # share of the value below which a step has won nothing
ASCENT, CURVED = 1e-4, 1e-8
"""Share of the slope that a step has to win, Armijo's condition; cosine of step and change of the slope at least."""
QUANTITIES_ASKED = "tooth force", "shaft torque", "damper power", "stress over continuous limit"


@brief
@dataclass(frozen=True)
class Spread:
    """Result of :func:`tolerance`: n speeds, Q quantities, P tolerances, S samples. SI units, nan where not solved.

    of : tuple of Objective; tolerances : tuple of Tolerance; rpm : ``(n,)``
    nominal : ``(n, Q)``, of the train as the scene has it
    slopes : ``(n, Q, P)``, change of the response over half the range of a number, by the derivative at the own values
    worst, shares : ``(n, Q)`` and ``(n, Q, P)``, the largest response found and the shares u of the numbers there
    samples, drawn : ``(n, S, Q)`` and ``(S, P)``, responses of a sample and the shares u drawn
    evaluations : solves of one speed, those of the sample included
    """

    train: DriveTrain
    of: tuple
    tolerances: tuple
    rpm: np.ndarray
    nominal: np.ndarray
    slopes: np.ndarray
    worst: np.ndarray
    shares: np.ndarray
    samples: np.ndarray
    drawn: np.ndarray
    evaluations: int

    @property
    def labels(self) -> list[str]:
        """What each quantity is: ``"tooth force of crank gear|idler"``."""
        return [label(one) for one in self.of]

    @property
    def solved(self) -> np.ndarray:
        """Share of the samples that are solved ``(n,)``."""
        return np.isfinite(self.samples).all(axis=2).mean(axis=1)

    def percentile(self, q: float) -> np.ndarray:
        """Of the samples that are solved ``(n, Q)``; nan where none is."""
        found = np.full(self.nominal.shape, np.nan)
        for i, own in enumerate(self.samples):
            kept = own[np.isfinite(own).all(axis=1)]
            if len(kept):
                found[i] = np.percentile(kept, q, axis=0)
        return found

    def values(self, i: int, j: int) -> dict[str, float]:
        """Numbers of the train at the worst case of a speed and a quantity, for :meth:`jaxhb.DriveTrain.replace`."""
        return box_of(self.train, self.tolerances, self.of).named(self.shares[i, j])


def tolerance(
    train: DriveTrain,
    *,
    rpm: Numbers,
    of: Sequence[Objective] = (),
    tolerances: Sequence[Tolerance] = (),
    samples: int = 0,
    seed: int = 0,
    harmonics: int | None = None,
    accuracy: float = 0.01,
    progress: Callable[[str], object] | None = None,
) -> Spread:
    """What the tolerances of a train do to its response at some speeds.

    At each speed and of each quantity: the value of the train as it is; by the derivative of :func:`jaxhb.solve`, which
    number moves it how far over its own tolerance; the largest value within all tolerances that is found, and where;
    and percentiles of a random sample.

    The worst case is searched by projected gradients (BFGS in the numbers inside their ranges, Bertsekas, 1982), from
    the best of the train as it is, the corners of the range that its derivatives point to and from, and eight more, all
    speeds and quantities side by side; where a corner is the worst case it is reached in one step. Any train that is
    solved on the way, or in the sample, counts for all quantities. It is the largest value *found*, no bound.

    :class:`SceneError` if names are unknown, ranges do not hold the own values and the like, one sentence each; or if
    no speed converges.

    Parameters
    ----------
    rpm : array ``(n,)``
    of : sequence of Objective, optional
        Quantities (``quantity``, ``of``, ``order`` count alone); by default the tooth force, the torque of shafts and
        dampers, the heat of dampers and the stress over its limit, each of the element where it is largest at the first
        speeds.
    tolerances : sequence of Tolerance, optional
        By default those of the ``[tolerance]`` table of the scene.
    samples, seed : int
        Trains of the sample, a Latin hypercube, and its seed.
    harmonics, accuracy
        Fixed number of harmonics, and truncation error as a share of the largest tooth force (``tolerance`` of
        :func:`jaxhb.solve`).
    progress : callable, optional
        Told in a sentence what is computed.

    Examples
    --------
    >>> from jaxhb.design import Objective, Tolerance
    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> rubber = Tolerance(name="pulley.inertia", low=0.009, high=0.0125)
    >>> torque = Objective(quantity="shaft torque", of="cyl6|flywheel")
    >>> found = jaxhb.tolerance(train, rpm=[1800.0, 2100.0], of=[torque], tolerances=[rubber])
    >>> bool((found.worst >= found.nominal).all())
    True
    """
    rpm = np.atleast_1d(np.asarray(rpm, dtype=float))
    check_speed(train, rpm, many=True)
    if tolerances:
        check_tolerances(train, tolerances)
    tolerances = tuple(tolerances) or read_tolerances(train)
    of = tuple(of) or default_quantities(train, rpm, tolerances)
    faults = [(one.quantity, text) for one in of for text in objective_faults(train, one, len(rpm))]
    if faults:
        raise SceneError([f"{train.topology.title}, quantity {name!r}: {text}" for name, text in faults])
    request = Request.of(train, harmonics, accuracy, integrals="sampled")
    search = _Search(train, rpm, box_of(train, tolerances, of), request, progress or (lambda text: None))
    search.start()
    drawn = search.box.sample(samples, seed) if samples else np.zeros((0, len(tolerances)))
    sampled = search.sampled(drawn)
    search.explore(seed)
    search.climb()
    worst, shares = search.worst()
    return Spread(
        train, of, tolerances, rpm, search.nominal, search.slopes, worst, shares, sampled, drawn, search.evaluations
    )


def default_quantities(train, rpm, tolerances):
    """Of each kind of :data:`QUANTITIES_ASKED` the element where it is largest at the nominal speeds."""
    candidates = []
    for quantity in QUANTITIES_ASKED:
        topology = train.topology
        names = {"tooth force": topology.mesh_names, "damper power": topology.damper_names}.get(
            quantity, topology.shaft_and_damper_names
        )
        asked = [Objective(quantity=quantity, of=name) for name in names]
        candidates += [one for one in asked if not objective_faults(train, one, len(rpm))]
    if not candidates:
        raise SceneError(f"{train.topology.title}: it has no meshes, shafts or dampers, so there is no force to judge.")
    request = Request.of(train, None, 0.01, integrals="sampled")
    search = _Search(train, rpm, box_of(train, tolerances, candidates), request, lambda text: None)
    values = np.nanmax(search.solve_nominal().exact[:, 0], axis=0)
    largest = {}
    for one, value in zip(candidates, values, strict=True):
        if np.isfinite(value) and value > largest.get(one.quantity, (0.0,))[0]:
            largest[one.quantity] = value, one
    return tuple(one for _, one in largest.values())


class _Search:
    """The lanes of a question: nominal ones, and those that climb."""

    def __init__(self, train, rpm, box, request, say):
        self.train, self.rpm, self.box, self.say = train, rpm, box, say
        self.evaluator = Evaluator(train, rpm, box, request)
        self.evaluations = 0

    def _take(self, point, which):
        """The Point of some lanes."""
        return jax.tree.map(lambda leaf: leaf[which], point)

    def _solve(self, u, near, which=True, rescues=0):
        """Lanes of shares u ``(A, P)`` near a Point, and the pullback; what is solved counts for the worst case."""
        which = np.broadcast_to(which, len(u))
        self.evaluations += int(which.sum())
        return self.evaluator.solved(u, near, which[:, None], rescues=rescues)

    def solve_nominal(self):
        """The train as it is at all speeds, with harmonics enough: a Point of n lanes."""
        begin = self.evaluator.unsolved(self.box.unbounded(self.train)[None])
        point = jax.tree.map(lambda leaf: np.moveaxis(leaf, 0, 1), begin)  # a lane for each speed
        point = dataclasses.replace(point, z=np.repeat(begin.z, len(self.rpm), axis=0))
        while point is not None:
            self.lanes, self.pull = self._solve(point.z, point, rescues=1)
            solved = self.lanes.point
            point = self.evaluator.finer(solved, solved.solved)
        return solved

    def start(self):
        """Nominal values and slopes; the first worst case."""
        self.say("solving the scene as it is")
        self.point = self.solve_nominal()
        if not self.point.solved.any():
            title = self.train.topology.title
            raise SceneError(f"{title}: no speed has a solution. jaxhb sweep shows what happens there.")
        self.nominal = self._values(self.point)
        count = len(self.box.objectives)
        slopes = [self._slopes(self.lanes, self.pull, np.full(len(self.rpm), j)) for j in range(count)]
        self.slopes = np.where(np.isfinite(self.nominal)[..., None], np.stack(slopes, axis=1), np.nan)
        self.tried = [[(self.box.unbounded(self.train), own)] for own in self.nominal]

    def _values(self, point):
        """Responses ``(A, Q)``, nan where not solved."""
        return np.where(point.solved, point.exact[:, 0], np.nan)

    def _slopes(self, lanes, pull, quantity):
        """Derivatives ``(A, P)`` of one quantity ``(A,)`` a lane by its shares; 0 where there is none."""
        chosen = np.arange(len(self.box.objectives)) == quantity[:, None]
        by = np.asarray(pull_back(pull, lanes.pulled(np.where(lanes.point.solved, chosen, 0.0)[:, None, :])))
        return np.where(np.isfinite(by), by, 0.0)

    def _at(self, speed, u, which=True, near=None):
        """Responses ``(A, Q)`` of lanes at speeds of index ``(A,)`` and shares u, with their Lanes and pullback; all
        that is solved counts for all quantities."""
        solved, pull = self._solve(u, self._take(self.point, speed) if near is None else near, which)
        values = np.where(np.broadcast_to(which, len(u))[:, None], self._values(solved.point), np.nan)
        for i, own, z in zip(speed, values, u, strict=True):
            if np.isfinite(own).any():
                self.tried[i].append((z, own))
        return values, solved, pull

    def sampled(self, drawn):
        """Responses ``(n, S, Q)`` of a sample, its lanes near those of the train as it is."""
        found = np.full((len(self.rpm), len(drawn), len(self.box.objectives)), np.nan)
        speeds = np.arange(len(self.rpm))
        for s, z in enumerate(drawn):
            self.say(f"sample: {s} of {len(drawn)} trains")
            found[:, s] = self._at(speeds, np.repeat(z[None], len(speeds), axis=0), self.point.solved[:, 0])[0]
        return found

    def explore(self, seed):
        """Some corners of the range, and for each quantity those to which its slope points and from which it does."""
        self.say("worst case: where to search")
        self.sampled(self.box.corners(seed))
        speed, quantity = self._pairs()
        toward = np.where(self.slopes[speed, quantity] < 0, -1.0, 1.0)
        self._at(np.tile(speed, 2), np.concatenate([toward, -toward]))

    def _pairs(self):
        """Indices of speed and quantity of all searches."""
        speed, quantity = (i.ravel() for i in np.mgrid[: len(self.rpm), : len(self.box.objectives)])
        solved = self.point.solved[speed, 0]
        return speed[solved], quantity[solved]

    def climb(self):
        """Search for the worst case of every speed and quantity from the best of all trains solved so far, and from the
        best on another side of the range, where it promises as much; all side by side."""
        starts = []
        for i, j in zip(*self._pairs(), strict=True):
            u, values = (np.array(part) for part in zip(*self.tried[i], strict=True))
            order = np.argsort(-np.nan_to_num(values[:, j], nan=-np.inf), kind="stable")
            first = order[0]
            starts.append((i, j, u[first]))
            apart = [k for k in order[1:] if np.abs(u[k] - u[first]).max() > APART]
            starts += [(i, j, u[k]) for k in apart[:1] if values[k, j] > PROMISING * values[first, j]]
        speed, quantity, u = (np.array(part) for part in zip(*starts, strict=True))
        values, solved, pull = self._at(speed, u)
        slope = self._slopes(solved, pull, quantity)
        self._ascend(speed, quantity, solved.point, u, values[np.arange(len(u)), quantity], slope)

    def worst(self):
        """The largest response of all trains solved, by speed and quantity ``(n, Q)``, and its shares ``(n, Q, P)``."""
        shares, values = np.zeros(self.slopes.shape), self.nominal.copy()
        for i, tried in enumerate(self.tried):
            u, own = (np.array(part) for part in zip(*tried, strict=True))
            if np.isfinite(self.nominal[i]).any():
                first = np.nanargmax(own, axis=0)
                shares[i], values[i] = u[first], own[first, np.arange(own.shape[1])]
        return values, shares

    def _ascend(self, speed, quantity, point, u, value, slope):
        """Climb of all lanes at once, by BFGS in the numbers that are free to move, along the projection of its way."""
        lanes, moving = np.arange(len(u)), np.isfinite(value)
        # The first step leads to the corner to which the slope points.
        curvature = np.abs(slope)[:, :, None] * np.eye(u.shape[1]) / 2
        for climb in range(CLIMBS):
            way = np.stack([_way(*lane) for lane in zip(u, slope, curvature, strict=True)])
            moving &= (way * slope).sum(axis=1) > GAIN * np.abs(value)
            if not moving.any():
                return
            self.say(f"worst case: step {climb + 1}, {moving.sum()} of {len(u)} searches go on")
            length, climbing, won = np.ones(len(u)), moving.copy(), np.zeros(len(u))
            for _ in range(TRIALS):
                trial = np.clip(u + length[:, None] * way, -1.0, 1.0)
                rise = ((trial - u) * slope).sum(axis=1)
                values, solved, pull = self._at(speed, trial, climbing, point)
                own = values[lanes, quantity]
                good = climbing & (own >= value + ASCENT * rise)
                if good.any():
                    steep = self._slopes(solved, pull, np.where(good, quantity, -1))
                    for k in np.flatnonzero(good):
                        curvature[k] = _updated(curvature[k], trial[k] - u[k], slope[k] - steep[k])
                    won, value = np.where(good, own - value, won), np.where(good, own, value)
                    point, u, slope = where(good, (solved.point, trial, steep), (point, u, slope))
                climbing &= ~good
                if not climbing.any():
                    break
                # To the vertex of the parabola through value, slope and what the trial found; a lost one is halved.
                with np.errstate(divide="ignore", invalid="ignore"):
                    vertex = 0.5 * rise / (value + rise - own)
                length *= np.where(np.isfinite(vertex), np.clip(vertex, 0.1, 0.5), 0.5)
            moving &= won > GAIN * np.abs(value)


def _way(u, slope, curvature):
    """BFGS's way up of one lane; numbers at an end of their range, beyond which it would rise, rest."""
    free = ~(((u >= 1.0) & (slope > 0)) | ((u <= -1.0) & (slope < 0))) & (slope != 0)
    way = np.zeros_like(u)
    way[free] = np.linalg.solve(curvature[np.ix_(free, free)], slope[free])
    return way


def _updated(curvature, step, fall):
    """The approximate negative Hessian after a step, in which the slope fell by ``fall``; as it was where none did."""
    along = fall @ step
    if not along > CURVED * np.linalg.norm(fall) * np.linalg.norm(step):
        return curvature
    old = curvature @ step
    return curvature + np.outer(fall, fall) / along - np.outer(old, old) / (step @ old)

"""A branch of periodic motions over a number of the train: followed by arclength
through its folds, with stability.

The curve is that of the reduced harmonic equations with a fixed number of harmonics
(:mod:`jaxhb.branches.curve`), followed by :mod:`jaxhb.solutions.continuation` on the
host.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from jaxhb._jax import Array, refuse_tracers
from jaxhb._shown import brief
from jaxhb.balance.plan import Plan, Request, excited_harmonic, time_steps_for
from jaxhb.balance.problem import problem_at
from jaxhb.balance.program import active_deflections, first_start, solve_once
from jaxhb.branches.curve import HarmonicCurve, linearized, null_direction, simplified
from jaxhb.equations import fourier
from jaxhb.floquet.stability import stability
from jaxhb.linear.mesh_modes import mesh_mode_harmonics
from jaxhb.results.answers import need_solved
from jaxhb.results.motion import drive_sense
from jaxhb.results.response import Response
from jaxhb.results.signal import Signal
from jaxhb.results.status import NotConverged
from jaxhb.solutions import continuation, planning
from jaxhb.solutions.solve import solve
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import listed_harmonic
from jaxhb.train.speeds import check_speed


@dataclass(frozen=True)
class SpecialPoint:
    """Point where a branch turns back or changes its stability: a "fold", "branch
    point", "period doubling" or "Neimark-Sacker" at a value of the parameter, after
    point no. ``after`` of the branch; ``y`` on the curve.
    """

    kind: str
    value: float
    after: int
    y: np.ndarray = field(repr=False, compare=False)

    def __str__(self) -> str:
        return f"{self.kind} at {self.value:.8g}"


def train_at(
    train: DriveTrain, rpm: float | None, parameter: str, value: float
) -> tuple[DriveTrain, float]:
    """Train and speed in rpm with a value of the parameter, checked."""
    speed = value if parameter == "rpm" else rpm
    assert speed is not None  # a parameter other than the speed has one
    check_speed(train, speed)
    return train if parameter == "rpm" else train.replace({parameter: value}), speed


def response_at(curve: HarmonicCurve, plan: Plan, y: np.ndarray) -> Response:
    """The Response at a point of the curve, which solves it already."""
    train, rpm = train_at(
        curve.train, float(curve.rpm), curve.parameter, curve.value(y)
    )
    start = first_start(plan, deflections=np.asarray(curve.deflection(y)))
    problem = problem_at(train, rpm, curve.shape.excited)
    response, _ = solve_once(train, rpm, problem, plan, start)
    return response


def extremes(response: Response) -> dict[str, list]:
    """Columns of a branch for the teeth, with an entry for every mesh: none depends on
    which of its gears is named first.
    """
    names = response.topology.mesh_names
    forces = [response.force(name) for name in names]
    deflections = [response.deflection(name) for name in names]
    senses = [drive_sense(response, name) for name in names]

    def of_all_meshes(
        signals: Sequence[Signal], extreme: str, opposite: str
    ) -> list[Array]:
        return [
            getattr(signal, extreme) if sense > 0 else -getattr(signal, opposite)
            for signal, sense in zip(signals, senses, strict=True)
        ]

    return {
        "largest_deflection": of_all_meshes(deflections, "max", "min"),
        "smallest_deflection": of_all_meshes(deflections, "min", "max"),
        "largest_force": [force.peak for force in forces],
        "smallest_force": of_all_meshes(forces, "min", "max"),
    }


@dataclass(frozen=True)
class BranchPoint:
    """A point of a branch: its row of the table by column; y and tangent of its curve,
    the multipliers of its teeth.
    """

    row: dict
    y: np.ndarray
    tangent: np.ndarray
    multipliers: np.ndarray

    @classmethod
    def at(
        cls, curve: HarmonicCurve, plan: Plan, y: np.ndarray, tangent: np.ndarray
    ) -> BranchPoint:
        """Make the point, with its row."""
        response = response_at(curve, plan, y)
        computed = stability(response)
        row: dict = {"value": curve.value(y)} | extremes(response)
        row |= {"multiplier": computed.critical, "stable": computed.stable}
        row["truncation_error"] = float(response.truncation_error)
        return cls(row, y, tangent, computed.multipliers[~computed.rotation])

    def beyond(self, place: int) -> float:
        """Product of ``1 - place x multiplier``: its sign changes where a real one
        passes ``place``, +1 or -1.
        """
        return float(np.prod(1 - place * self.multipliers).real)

    @property
    def pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Products of two multipliers, less 1, and whether those are complex: zero for
        a pair of modulus 1.
        """
        first, second = np.triu_indices(len(self.multipliers), 1)
        products = self.multipliers[first] * self.multipliers[second] - 1
        return products, self.multipliers[first].imag != 0


TESTS = {
    "branch point": lambda point: point.beyond(1),
    "period doubling": lambda point: point.beyond(-1),
    "Neimark-Sacker": lambda point: float(np.prod(point.pairs[0]).real),
}
"""Functions of a point whose sign changes (Kuznetsov, Elements of Applied Bifurcation
Theory, 2004, ch. 10).
"""


def special_points(
    curve: HarmonicCurve,
    plan: Plan,
    points: list[BranchPoint],
    locate: Callable[..., tuple[np.ndarray, np.ndarray]],
    options: BranchOptions,
) -> tuple[SpecialPoint, ...]:
    """The SpecialPoints of a branch, in its order."""

    def rise_of_parameter(y: np.ndarray, tangent: np.ndarray) -> float:
        return tangent[-1]  # zero at a fold

    def on_point(
        test: Callable[[BranchPoint], float],
    ) -> Callable[[np.ndarray, np.ndarray], float]:
        return lambda y, tangent: test(BranchPoint.at(curve, plan, y, tangent))

    tested = {"fold": [point.tangent[-1] for point in points]}
    for kind, test in TESTS.items():
        tested[kind] = [test(point) for point in points]
    changes = {
        kind: np.sign(values[:-1]) * np.sign(values[1:]) < 0
        for kind, values in tested.items()
    }
    passes_branch_point = changes["branch point"]
    for number in np.flatnonzero(changes["fold"]):
        # At a fold a multiplier passes +1, but not where that of the harmonics lies:
        # the truncation error is between.
        near = [
            k
            for k in (number, number - 1, number + 1)
            if 0 <= k < len(passes_branch_point) and passes_branch_point[k]
        ]
        passes_branch_point[near[:1]] = False
    special = []
    for kind, is_changing in changes.items():
        for number in np.flatnonzero(is_changing):
            before, after = points[number : number + 2]
            if kind != "fold":
                test_on_curve = on_point(TESTS[kind])
                closed = options.stability
            else:
                test_on_curve = rise_of_parameter
                closed = options.fold
            y, tangent = locate(
                (before.y, before.tangent),
                (after.y, after.tangent),
                test_on_curve,
                closed=closed,
            )
            located = BranchPoint.at(curve, plan, y, tangent)
            # The product of two real multipliers passes 1 as well, where nothing
            # happens: a pair must be complex.
            products, is_complex = located.pairs
            if kind != "Neimark-Sacker" or is_complex[np.argmin(np.abs(products))]:
                length = (located.y - before.y) @ before.tangent
                special_point = SpecialPoint(
                    kind, located.row["value"], int(number), located.y
                )
                special.append((number, length, special_point))
    return tuple(point for *_, point in sorted(special, key=lambda entry: entry[:2]))


@dataclass(frozen=True, kw_only=True)
class BranchOptions:
    """Options of :func:`follow`: steps as shares of the range of the parameter,
    deflections counted alike.
    """

    first: float = 0.01  # length of the first step
    longest: float = 0.05  # length of a step at most
    jacobians: int = 4000  # of a branch at most
    fold: float = 1e-9  # error of the parameter at a fold, as a share of its range
    # The same where the stability changes: multipliers cost some time
    stability: float = 1e-5
    # Error of a point, relative to the first motion: well below that of a solve
    closed: float = 1e-11


BRANCH = BranchOptions()


@brief
@dataclass(frozen=True)
class Branch:
    """A branch of periodic motions as a table of P points, made by :func:`follow`; M
    meshes.

    Parameters
    ----------
    parameter : "rpm" or "NAME.FIELD"
    value : ``(P,)`` of the parameter, in its unit
    largest_deflection, smallest_deflection : ``(P, M)`` m, positive as the teeth
    deflect under their mean force
    largest_force : ``(P, M)`` N, largest absolute tooth force
    smallest_force : ``(P, M)`` N, positive where the gear drives that does so on the
    whole
    multiplier : complex ``(P,)``, the critical one of :class:`~jaxhb.Stability`
    stable : bool ``(P,)``
    truncation_error : ``(P,)``, as of a response
    special : tuple of SpecialPoint, in the order of the branch
    ended : sentence, why the branch ends where it does
    """

    parameter: str
    value: np.ndarray
    largest_deflection: np.ndarray
    smallest_deflection: np.ndarray
    largest_force: np.ndarray
    smallest_force: np.ndarray
    multiplier: np.ndarray
    stable: np.ndarray
    truncation_error: np.ndarray
    special: tuple
    ended: str
    _curve: HarmonicCurve = field(repr=False)
    _plan: Plan = field(repr=False)
    _path: list = field(repr=False)

    def __len__(self) -> int:
        return len(self.value)

    @property
    def train(self) -> DriveTrain:
        """The train that was followed, with the value of the parameter that it had."""
        return self._curve.train

    @property
    def folds(self) -> np.ndarray:
        """Values of the parameter at which the branch turns back, ``(F,)``."""
        return np.array([point.value for point in self.special if point.kind == "fold"])

    def response(self, number: int) -> Response:
        """The Response at a point."""
        return response_at(self._curve, self._plan, self._path[number][0])

    def resume(
        self,
        number: int = -1,
        *,
        to: float | None = None,
        backwards: bool = False,
        options: BranchOptions = BRANCH,
    ) -> Branch:
        """Follow on, or ``backwards``, from point ``number`` of this branch, which is
        the first of the new one.

        ``to`` extends the range; SceneError or ValueError where it is not a value that
        the parameter can have.
        """
        curve = self._curve
        shares = [0.0, 1.0]
        if to is not None:
            train_at(curve.train, float(curve.rpm), curve.parameter, float(to))
            shares.append((float(to) - float(curve.begin)) / float(curve.span))
        y, tangent = self._path[number]
        return _followed(
            curve,
            self._plan,
            y,
            -tangent if backwards else tangent,
            (min(shares), max(shares)),
            options,
        )

    def doubled(self, number: int = 0, *, options: BranchOptions = BRANCH) -> Branch:
        """The branch of motions of twice the period that leaves this one at its period
        doubling no. ``number``.

        Of ``train.repeated(2)``, in the same range. Begins in the direction in which
        the harmonic equations over two periods are singular there; a motion and the one
        a period later are the same. ValueError where there is no such period doubling;
        ``branch.doubled().doubled()`` goes on.
        """
        places = [point for point in self.special if point.kind == "period doubling"]
        if not -len(places) <= number < len(places):
            raise ValueError(
                f"period doubling no. {number} is asked for, and this branch has"
                f" {len(places)} of them."
            )
        curve, plan, y, tangent = _doubled(self._curve, self._plan, places[number].y)
        doubled = _followed(curve, plan, y, tangent, (0.0, 1.0), options)
        # Where it begins a multiplier is 1, rounded to either side: no branch point.
        special = tuple(
            point
            for point in doubled.special
            if point.after or point.kind != "branch point"
        )
        return replace(doubled, special=special)

    def __str__(self) -> str:
        stable = f"{np.count_nonzero(self.stable)} of {len(self)} points stable"
        points = "; ".join(map(str, self.special)) or "no special points"
        truncation = f"truncation error up to {100 * self.truncation_error.max():.2g} %"
        return (
            f"{self.parameter} {self.value[0]:g} to {self.value[-1]:g}: {stable},"
            f" {truncation}; {points}. {self.ended}"
        )


def follow(
    train: DriveTrain,
    parameter: str,
    *,
    start: float,
    to: float,
    rpm: float | None = None,
    harmonics: int | None = None,
    tolerance: float = 0.01,
    begin: Response | None = None,
    options: BranchOptions = BRANCH,
) -> Branch:
    """Follow a branch of periodic motions over the speed or a number of the train,
    through its folds.

    Pseudo-arclength continuation (Keller 1977) of the harmonic equations F(l, p) = 0
    from a motion at ``start``. Every point has its stability. Ends where the parameter
    leaves ``start`` .. ``to`` on either side.

    :class:`SceneError` if there is no such element or field, a value is out of its
    range, or a speed not greater than 0 or above 1e6 rpm. ValueError for an empty
    range, a missing or superfluous ``rpm``, a train without backlash, or without
    multipliers (:func:`jaxhb.stability`). NotConverged if no motion is found at
    ``start``.

    Parameters
    ----------
    train : DriveTrain
    parameter : str
        "rpm", or "NAME.FIELD" of a number of the train.
    start, to : float
        Range of the parameter, in its unit; the branch begins at ``start`` towards
        ``to``.
    rpm : float, optional
        Speed, where that is not the parameter.
    harmonics : int, optional
        Of all motions. Default: as many as the motion at ``start`` needs, and mesh
        modes in the middle of the range.
    tolerance : float
        Truncation error that the first motion is solved to; that of each point is in
        the table.
    begin : Response, optional
        A motion at ``start`` to begin with, where several exist; default:
        :func:`jaxhb.solve`.
    options : BranchOptions

    Examples
    --------
    >>> train = jaxhb.load_scene("spur_pair")
    >>> branch = jaxhb.follow(train, "rpm", start=2000.0, to=3000.0)
    >>> round(float(branch.value[-1])), bool(branch.stable.all())
    (3000, True)
    """
    refuse_tracers(
        "follow",
        train,
        rpm,
        start,
        to,
        begin,
        instead="differentiate jaxhb.solve at a point of the branch",
    )
    if parameter == "rpm":
        check_speed(train, start)
        check_speed(train, to)
    _check(train, parameter, start, to, rpm)
    ends = [train_at(train, rpm, parameter, float(value)) for value in (start, to)]
    train_at_start, speed = ends[0]
    if begin is None:
        begin = solve(
            train_at_start, rpm=speed, harmonics=harmonics, tolerance=tolerance
        )
    need_solved(begin)
    # Its sentences come before the work.
    stability(replace(begin, train=train_at_start))
    plan = _plan(
        train_at_start,
        sum(speed for _, speed in ends) / 2,
        harmonics,
        tolerance,
        begin.harmonics,
    )
    deflection = fourier.resize(
        active_deflections(plan, begin.deflections), plan.harmonics
    )
    gaps = np.asarray(train_at_start.meshes.backlash)[list(plan.active)]
    scale = np.min(
        gaps + np.linalg.norm(fourier.pack(deflection), axis=-1)[: len(gaps)]
    )
    curve = HarmonicCurve(
        train=train,
        rpm=np.asarray(float(speed)),
        begin=np.asarray(float(start)),
        span=np.asarray(float(to) - float(start)),
        scale=np.asarray(float(scale)),
        active_meshes=plan.active_meshes,
        parameter=parameter,
        shape=plan.shape,
    )
    y = np.append(fourier.pack(deflection).ravel() / scale, 0.0)
    return _followed(curve, plan, y, None, (0.0, 1.0), options)


def _check(
    train: DriveTrain, parameter: str, start: float, to: float, rpm: float | None
) -> None:
    """Refuse what cannot be followed, with a sentence."""
    name = train.topology.title
    if parameter == "rpm" and rpm is not None:
        raise ValueError(
            f"{name}: rpm is the parameter: give start and to, and no rpm={rpm:g}."
        )
    if parameter != "rpm" and rpm is None:
        raise ValueError(f"{name}: {parameter} is followed at one speed: give rpm=...")
    if not (np.isfinite([start, to]).all() and start != to):
        raise ValueError(
            f"{name}: {parameter} from {start:g} to {to:g} is no range: give two"
            " different numbers."
        )
    if not train.topology.has_law.any():
        raise ValueError(
            f"{name} has no mesh with backlash: one motion at each speed, use"
            " jaxhb.solve_speeds."
        )


def _plan(
    train: DriveTrain,
    rpm: float,
    harmonics: int | None,
    tolerance: float,
    least_harmonics: int,
) -> Plan:
    """The Plan of all points of a branch."""
    request = Request.of(train, harmonics, tolerance)
    excited = listed_harmonic(train.topology)
    modes, _ = mesh_mode_harmonics(train, train.topology.cycle_frequency(rpm))
    level = planning.first_level(excited_harmonic(train, request.method), modes)
    steps = time_steps_for(max(modes, 2 * excited))
    plan = replace(planning.contact_plan(train, request), time_steps=steps)
    return replace(
        planning.all_active(train, plan, request),
        harmonics=harmonics or max(level, least_harmonics),
    )


def _doubled(
    curve: HarmonicCurve, plan: Plan, y: np.ndarray
) -> tuple[HarmonicCurve, Plan, np.ndarray, np.ndarray]:
    """Curve, plan, point and tangent over two periods, at a period doubling ``y``."""
    train = curve.train.repeated(2)
    _, rpm = train_at(
        train,
        float(curve.rpm),
        curve.parameter,
        float(curve.begin + y[-1] * curve.span),
    )
    plan = _plan(train, rpm, 2 * plan.harmonics, plan.tolerance, 0)
    one_period = np.asarray(curve.deflection(y))
    curve = replace(
        curve, train=train, active_meshes=plan.active_meshes, shape=plan.shape
    )
    two_periods = np.zeros((len(one_period), plan.harmonics + 1), dtype=complex)
    odd = np.zeros_like(two_periods)
    # Over two periods harmonic n of the motion is harmonic 2 n. The motion that leaves
    # it at a period doubling adds odd harmonics alone: random ones, falling like those
    # of smooth motions, are turned into the null direction.
    two_periods[:, ::2] = one_period
    draw = np.random.default_rng(0).normal(size=(2, *odd[:, 1::2].shape))
    odd[:, 1::2] = (draw[0] + 1j * draw[1]) / np.arange(1, plan.harmonics + 1, 2) ** 2
    y = np.append(fourier.pack(two_periods).ravel() / curve.scale, y[-1])
    tangent = np.append(null_direction(curve, y, fourier.pack(odd).ravel()), 0.0)
    return curve, plan, y, tangent


def _followed(
    curve: HarmonicCurve,
    plan: Plan,
    y: np.ndarray,
    onward: np.ndarray | None,
    within: tuple[float, float],
    options: BranchOptions,
) -> Branch:
    """Follow a :class:`Branch` from a point ``y``; onward : tangent on from there."""
    # Every point is a solution that is read, not a way to the end: exact, and on a
    # smooth curve steps that turn little.
    control = continuation.StepControl(
        first=options.first,
        longest=options.longest,
        corner=1e-7,
        near=options.closed,
        closed=options.closed,
        bent=0.8,
        straight=0.95,
    )
    path = []
    linearize = partial(linearized, curve)
    simplify = partial(simplified, curve)
    end = continuation.follow_curve(
        linearize,
        simplify,
        y,
        most=options.jacobians,
        within=within,
        onward=onward,
        visit=lambda y, tangent: path.append((y, tangent)),
        control=control,
    )
    if not path:
        value = f"{curve.parameter} = {curve.value(y):g}"
        raise NotConverged(
            f"{curve.train.topology.title}: Newton's method finds no motion with"
            f" {plan.harmonics} harmonics at {value}."
        )
    points = [BranchPoint.at(curve, plan, y, tangent) for y, tangent in path]
    locate = partial(continuation.locate_zero, linearize, simplify, control=control)
    special = special_points(curve, plan, points, locate, options)
    columns = {
        column: np.array([point.row[column] for point in points])
        for column in points[0].row
    }
    ended = _sentence(curve, end, within, options)
    return Branch(
        curve.parameter,
        **columns,
        special=special,
        ended=ended,
        _curve=curve,
        _plan=plan,
        _path=path,
    )


def _sentence(
    curve: HarmonicCurve,
    end: continuation.CurveEnd,
    within: tuple[float, float],
    options: BranchOptions,
) -> str:
    """Say why a branch ended."""
    value = f"{curve.parameter} = {curve.value(end.y):g}"
    if end.arrived and end.y[-1] > sum(within) / 2:
        return f"It reaches the end of the range, {value}."
    if end.arrived:
        return f"It turns back and leaves the range where that begins, {value}."
    if end.jacobians >= options.jacobians:
        return (
            f"Stopped at {value} after {end.jacobians} Jacobians: resume, or allow"
            " more."
        )
    return f"Lost at {value}: even the shortest step finds no further point."

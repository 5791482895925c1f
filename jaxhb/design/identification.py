"""Numbers of a train from measurements: a fit of computed to measured orders, and what
the data leave open.

    min over p   sum over rows |computed(p) - measured|^2 / sigma^2
                 + sum over priors (p - own)^2 / std^2

Computed is the linear forced response, teeth in contact; its derivatives by the numbers
are those of jax. Least squares are solved by the trust-region method of scipy, within
bounds. Rows at speeds at which the equations have no answer are left out, and said to
be.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from jaxhb._jax import refuse_tracers
from jaxhb._program import Program
from jaxhb._shown import brief
from jaxhb.design.evaluation import Task
from jaxhb.design.measurements import Measured
from jaxhb.design.quantities import Parameter, parameter_faults
from jaxhb.elements.elements import SceneError
from jaxhb.excitation.torques import listed_harmonic
from jaxhb.linear.forced import forced_response
from jaxhb.linear.tangent import linear_train
from jaxhb.results.answers import left_out, solved
from jaxhb.results.dataset import SIGNALS
from jaxhb.results.status import NotConverged
from jaxhb.train.drivetrain import DriveTrain

FLOOR = (
    0.05  # share of the largest amplitude of an element that sensors make noise of, too
)
# Share of the deviation that the bounds alone leave, from which a number counts as not
# determined
OPEN = 0.5
ALIKE = 0.95  # correlation from which the data hardly tell two numbers apart
NORMAL = 1.96  # deviations that 95 % of a normal distribution lie within
# Residuals over their deviations, root mean square, beyond which the scene does not
# explain the rows
MOST_MISFIT = 2.0
# Chi-square, at a misfit of 1, by which two explanations are told apart: two deviations
APART = 4.0


@brief
@dataclass(frozen=True)
class Identification:
    """Result of :func:`identify`: P numbers, R rows.

    train : DriveTrain with the fitted numbers; parameters : tuple of Parameter before,
    values, std : ``(P,)``, as the train had them, fitted, and their standard deviations
    correlation : ``(P, P)``; open : names of the numbers that the data do not
    determine; at_bound : names computed, before_computed : complex ``(R,)``, of the
    fitted train and of that given; sigma : ``(R,)``, standard deviation that was taken
    for each row, in its unit; misfit : root mean square of the residuals over sigma,
    the root of the reduced chi-square explained : share of the measured amplitudes that
    the fit explains, 1 less the mean square of what is left over that of what was
    measured, every element and quantity alike kept : bool ``(R,)``, rows that were
    fitted; left_out : tuple of str, a sentence for each status of the others
    """

    train: DriveTrain
    measured: Measured
    parameters: tuple
    before: np.ndarray
    values: np.ndarray
    std: np.ndarray
    correlation: np.ndarray
    open: tuple
    at_bound: tuple
    computed: np.ndarray
    before_computed: np.ndarray
    sigma: np.ndarray
    misfit: float
    explained: float
    kept: np.ndarray
    left_out: tuple[str, ...]

    def within(self, values: Sequence[float]) -> np.ndarray:
        """Whether true numbers lie inside the 95 % intervals ``(P,)``."""
        return np.abs(self.values - np.asarray(values)) <= NORMAL * self.std

    def alike(self) -> list[tuple[str, str, float]]:
        """Pairs of numbers that the data hardly tell apart, with their correlation."""
        names = [one.name for one in self.parameters]
        found = self.correlation
        rows, columns = np.triu_indices(len(names), 1)
        return [
            (names[i], names[j], float(found[i, j]))
            for i, j in zip(rows, columns, strict=True)
            if abs(found[i, j]) > ALIKE
        ]


def identify(
    train: DriveTrain,
    measured: Measured,
    *,
    parameters: Sequence[Parameter],
    noise: float = 0.03,
    priors: Mapping[str, float] | None = None,
) -> Identification:
    """Fit numbers of a train to measured orders, teeth in contact.

    The residual of a row is the difference of complex amplitudes where a phase was
    measured, else that of amplitudes, over its standard deviation: ``noise`` x the root
    of the sum of squares of the amplitude and a twentieth of the largest one of the
    same element and quantity. Covariances are those of the linearised fit, times the
    square of the misfit where that is above 1: what the model cannot tell is noise as
    well. Above 2 the scene does not explain the rows, and the numbers are to be
    doubted.

    Rows at speeds at which the equations have no answer, as at an undamped resonance,
    are left out; ``left_out`` of the result says which and why. :class:`NotConverged`
    if fewer rows are left than numbers. :class:`SceneError` if names are unknown,
    bounds exclude the own values, or there are fewer rows than numbers, one sentence
    each.

    Parameters
    ----------
    measured : Measured
        See :func:`jaxhb.design.read_measured`.
    parameters : sequence of Parameter
        Numbers to be fitted, with bounds and scale; ``CYLINDER.gas_factor`` scales the
        gas torque of a cylinder.
    noise : float
        Relative standard deviation of measured amplitudes.
    priors : {name: standard deviation}, optional
        Of numbers about which more is known than their bounds: the own values are then
        data, too.

    Examples
    --------
    >>> from jaxhb.design import Measured, Parameter
    >>> parts = [jaxhb.Disk(name="a", inertia=1.0), jaxhb.Disk(name="b", inertia=2.0)]
    >>> parts += [jaxhb.Shaft(between=("a", "b"), stiffness=6.7e3, damping=4.0)]
    >>> parts += [jaxhb.Torque(disk="a", harmonics=[(1.0, 5.0, 0.0)])]
    >>> train = jaxhb.build(parts, revolutions_per_cycle=1)
    >>> rpm = np.array([600.0, 900.0, 1200.0])
    >>> truth = jaxhb.forced_response(train.replace({"a|b.stiffness": 6.2e3}), rpm=rpm)
    >>> seen = truth.torque("a|b").order(1.0)
    >>> rows = Measured(
    ...     rpm, np.ones(3), ("a|b",) * 3, ("torque",) * 3, seen, np.full(3, np.nan)
    ... )
    >>> found = jaxhb.identify(
    ...     train, rows, parameters=[Parameter(name="a|b.stiffness", low=5e3, high=9e3)]
    ... )
    >>> round(found.train.value("a|b.stiffness")), found.open
    (6200, ())
    """
    refuse_tracers("identify", train, instead="differentiate jaxhb.forced_response")
    parameters = tuple(parameters)
    priors = dict(priors or {})
    where = train.topology.title
    faults = [
        f"parameter {one.name!r}: {text}"
        for one in parameters
        for text in parameter_faults(train, one)
    ]
    faults += [
        f"parameter {one.name!r}: {_STAGED}"
        for one in parameters
        if _is_of_stages(train, one.name)
    ]
    rows = len(measured.rpm) + int(np.isfinite(measured.phase).sum())
    if not parameters:
        faults.append("there is nothing to fit: name at least one parameter.")
    if rows + len(priors) < len(parameters):
        faults.append(
            f"{rows} measured numbers and {len(priors)} priors are fewer than"
            f" {len(parameters)} parameters."
        )
    faults += [
        f"the prior {name!r} is of no parameter."
        for name in priors
        if name not in {p.name for p in parameters}
    ]
    if faults:
        raise SceneError([f"{where}: {text}" for text in faults])
    fit = Fit(train, measured, parameters, noise, priors)
    fit.refuse_too_few(len(parameters))
    every = np.arange(len(parameters))
    u, residuals, slopes = fit.solve(fit.begin, every)
    if fit.keep_solved(
        u
    ):  # numbers that lose an answer are no step, but they may win some
        u, residuals, slopes = fit.solve(u, every)
    return fit.result(u, residuals, slopes)


_STAGED = (
    "its link is linear here, with its stiffness at the mean load, so that this cannot"
    " be fitted. Leave it out."
)


def _is_of_stages(train, name):
    """Whether a parameter is the stiffness of a link with stages, stops, clearance or
    friction, or one of these.
    """
    element, _, field = name.rpartition(".")
    links = {train.topology.link_names[link] for link, *_ in train.topology.springs}
    return element in links and field in (
        "stiffness",
        "clearance",
        "friction",
        "slip_speed",
    )


@dataclass(frozen=True)
class Shares(Task):
    """Parameters as shares u ``(P,)`` of the way from low to high, 0 to 1, on their
    scales.
    """

    def named(self, z):
        return {
            one.name: (
                one.low * (one.high / one.low) ** u
                if one.scale == "log"
                else one.low + u * (one.high - one.low)
            )
            for one, u in zip(self.parameters, z, strict=True)
        }


@partial(Program, static_argnames=("shares", "read", "harmonics"))
def computed_rows(train, rpm, places, u, *, shares, read, harmonics):
    """Complex amplitudes ``(R,)`` of rows at ``places`` (pair, speed, harmonic; 0 for a
    sum), derivatives by u, and the status ``(S,)`` of the speeds.
    """

    def rows(u):
        changed = train.replace(shares.named(u))
        response = forced_response(changed, rpm=rpm, harmonics=harmonics)
        signals = [
            getattr(response, SIGNALS[quantity][0])(name) for quantity, name in read
        ]
        sums = jnp.stack([signal.amplitudes.sum(axis=-1) for signal in signals])
        found = (
            (2 * jnp.stack([signal.coefficients for signal in signals]))
            .at[..., 0]
            .set(sums)[places]
        )
        return found, response.status

    return *rows(u), jax.jacfwd(lambda u: rows(u)[0])(u)


class Fit:
    """The residuals of rows and priors, and their least squares over some of the
    parameters.
    """

    def __init__(self, train, measured, parameters, noise, priors):
        self.train = train
        self.measured = measured
        self.parameters = parameters
        self.linear = linear_train(train, rpm=float(np.median(measured.rpm)))
        self.task = Shares(parameters, (), ())
        self.rpm, speed = np.unique(measured.rpm, return_inverse=True)
        pairs = list(zip(measured.quantity, measured.element, strict=True))
        self.read = tuple(dict.fromkeys(pairs))
        pair = np.array([self.read.index(one) for one in pairs])
        turn = np.nan_to_num(measured.order) * train.topology.revolutions_per_cycle
        self.places = pair, speed, np.round(turn).astype(int)
        self.harmonics = max(
            int(self.places[2].max()), listed_harmonic(train.topology), 1
        )
        self.noise = noise
        self.phased = np.isfinite(measured.phase)
        self.target = measured.amplitude * np.exp(
            1j * np.deg2rad(np.nan_to_num(measured.phase))
        )
        self.own = np.array([float(train.value(one.name)) for one in parameters])
        self.priors = np.array([priors.get(one.name, np.inf) for one in parameters])
        low, high = np.array([(one.low, one.high) for one in parameters]).T
        log = np.array([one.scale == "log" for one in parameters])
        self.width = high - low
        with np.errstate(divide="ignore", invalid="ignore"):
            self.ratio = np.where(log, np.log(high / low), 0.0)  # 0 on a linear scale
            self.begin = np.where(
                log, np.log(self.own / low) / self.ratio, (self.own - low) / self.width
            )
        self.kept = np.zeros(len(pairs), dtype=bool)
        self.left_out: tuple[str, ...] = ()
        self.keep_solved(self.begin)

    def keep_solved(self, u):
        """Keep the rows that have an answer at shares u, besides those kept, and
        whether that are more than before.
        """
        _, status, _ = self.computed(u)
        before = self.kept
        row_status = status[self.places[1]]
        self.kept = before | solved(row_status)
        lost = ~self.kept
        title = self.train.topology.title
        found = left_out(
            self.measured.rpm[lost],
            row_status[lost],
            title,
            kept=np.zeros(lost.sum(), dtype=bool),
        )
        self.left_out = tuple(dict.fromkeys(found))
        # Rows that are left out say nothing of the noise of the others.
        size = self.measured.amplitude
        pair = self.places[0]
        largest = np.array(
            [size[self.kept & (pair == one)].max(initial=0.0) for one in pair]
        )
        self.sigma = self.noise * np.hypot(size, FLOOR * largest)
        self.sigma = np.where(self.sigma > 0, self.sigma, 1.0)
        return bool((self.kept & ~before).any())

    def refuse_too_few(self, wanted):
        """:class:`NotConverged` where fewer than ``wanted`` measured numbers and priors
        have an answer.
        """
        if self.data < wanted:
            raise NotConverged(
                f"{self.data} of the measured numbers and priors are left for {wanted}"
                f" parameters, as the others have no answer: {' '.join(self.left_out)}"
            )

    @property
    def data(self):
        """How many measured numbers and priors are fitted."""
        return int(
            self.kept.sum()
            + (self.kept & self.phased).sum()
            + np.isfinite(self.priors).sum()
        )

    def misfit(self, residuals, free):
        """Root mean square of residuals over their deviations, of a fit of ``free``
        parameters.
        """
        return float(np.sqrt((residuals**2).sum() / max(self.data - free, 1)))

    def explained(self, u):
        """Share of the measured amplitudes that the numbers of shares u explain."""
        computed = self.computed(u)[0]
        measured = self.measured.amplitude
        off = np.where(
            self.phased, np.abs(computed - self.target), np.abs(computed) - measured
        )
        shares = []
        for pair in np.unique(self.places[0][self.kept & (measured > 0)]):
            rows = self.kept & (self.places[0] == pair)
            shares.append((off[rows] ** 2).sum() / (measured[rows] ** 2).sum())
        return 1.0 - float(np.mean(shares)) if shares else np.nan

    def numbers(self, u):
        """Numbers ``(P,)`` of shares, and their derivatives by them."""
        values = np.array([float(value) for value in self.task.named(u).values()])
        return values, np.where(self.ratio, values * self.ratio, self.width)

    def computed(self, u):
        """Complex amplitudes ``(R,)``, the status of the speeds ``(S,)``, and
        derivatives ``(R, P)``.
        """
        shape = {"shares": self.task, "read": self.read, "harmonics": self.harmonics}
        return [
            np.asarray(part)
            for part in computed_rows(
                self.linear, self.rpm, self.places, np.asarray(u), **shape
            )
        ]

    def residuals(self, u):
        """Residuals over their deviations: of rows, the second half of those with a
        phase, priors; and derivatives.

        0 of rows that are not kept; nan of rows that are and have no answer, which no
        step of least squares accepts.
        """
        values, status, slopes = self.computed(u)
        values = np.where(solved(status)[self.places[1]], values, np.nan)
        values = np.where(self.kept, values, self.target)
        slopes = np.where(self.kept[:, None], slopes, 0.0)
        size = np.abs(values)
        phased = self.phased
        turned = np.where(size > 0, values.conj() / np.where(size > 0, size, 1.0), 1.0)
        complex_off = values - self.target
        amplitude_off = size - self.measured.amplitude
        off = np.where(phased, complex_off.real, amplitude_off) / self.sigma
        by = (
            np.where(phased[:, None], slopes.real, (turned[:, None] * slopes).real)
            / self.sigma[:, None]
        )
        numbers, scale = self.numbers(u)
        known = np.isfinite(self.priors)
        more = (numbers - self.own)[known] / self.priors[known]
        prior_slopes = np.diag(scale)[known] / self.priors[known][:, None]
        off = np.concatenate([off, complex_off.imag[phased] / self.sigma[phased], more])
        return off, np.concatenate(
            [by, slopes.imag[phased] / self.sigma[phased][:, None], prior_slopes]
        )

    def solve(self, begin, free):
        """Least squares over the ``free`` parameters, the others as in ``begin``:
        shares, residuals and derivatives.
        """

        def whole(part):
            u = begin.copy()
            u[free] = part
            return u

        @lru_cache(
            maxsize=1
        )  # residuals and derivatives are asked for one after the other
        def told(numbers):
            return self.residuals(whole(np.frombuffer(numbers)))

        inside = np.clip(begin[free], 1e-6, 1 - 1e-6)
        options = {
            "bounds": (0.0, 1.0),
            "x_scale": "jac",
            "ftol": 1e-10,
            "xtol": 1e-10,
            "gtol": 1e-10,
        }

        def residuals(u):
            return told(u.tobytes())[0]

        def slopes(u):
            return told(u.tobytes())[1][:, free]

        u = whole(least_squares(residuals, inside, jac=slopes, **options).x)
        return u, *self.residuals(u)

    def result(self, u, residuals, slopes):
        """The :class:`Identification` of a fit."""
        values, scale = self.numbers(u)
        misfit = self.misfit(residuals, len(u))
        # Directions that no row sees keep the deviation that the bounds leave.
        covariance = np.linalg.inv(
            slopes.T @ slopes / max(misfit, 1.0) ** 2 + 12e-9 * np.eye(len(u))
        )
        deviation = np.sqrt(np.diag(covariance))
        left = np.sqrt(1 / 12.0)
        names = np.array([one.name for one in self.parameters])
        return Identification(
            train=self.train.replace(
                dict(zip(names.tolist(), values.tolist(), strict=True))
            ),
            measured=self.measured,
            parameters=self.parameters,
            before=self.own,
            values=values,
            std=np.minimum(deviation, left) * scale,
            correlation=covariance / np.outer(deviation, deviation),
            open=tuple(names[deviation > OPEN * left].tolist()),
            at_bound=tuple(names[(u < 1e-4) | (u > 1 - 1e-4)].tolist()),
            computed=self.computed(u)[0],
            before_computed=self.computed(self.begin)[0],
            sigma=self.sigma,
            misfit=misfit,
            explained=self.explained(u),
            kept=self.kept,
            left_out=self.left_out,
        )


@brief
@dataclass(frozen=True)
class WeakCylinder:
    """Result of :func:`weak_cylinder`: C cylinders, the likeliest first.

    names : tuple; gas_factor, std : ``(C,)``, the share that each burns if it alone
    differs; evidence : ``(C,)``, chi-square of the rows less that of the first;
    all_equal : the same of a train in which none differs misfit, explained, kept,
    left_out : of the fit of the first, as of an :class:`Identification`; the deviation
    of each is widened by its own misfit where that is above 1, and chi-squares are
    divided by the square of that of the first computed : complex ``(R,)``, of the fit
    of the first; at_bound : names whose share is at an end of its range
    """

    names: tuple
    gas_factor: np.ndarray
    std: np.ndarray
    evidence: np.ndarray
    all_equal: float
    measured: Measured
    computed: np.ndarray
    misfit: float
    explained: float
    kept: np.ndarray
    left_out: tuple[str, ...]
    at_bound: tuple[str, ...]

    @property
    def likely(self) -> tuple:
        """Names that the rows do not tell from the first: less than 4 of chi-square
        apart, two deviations.
        """
        return tuple(
            name
            for name, more in zip(self.names, self.evidence, strict=True)
            if more < APART
        )

    @property
    def explains(self) -> bool:
        """Whether one cylinder that differs explains the rows: the misfit is at most 2.
        Else there is no verdict.
        """
        return self.misfit <= MOST_MISFIT


def weak_cylinder(
    train: DriveTrain,
    measured: Measured,
    *,
    noise: float = 0.03,
    least: float = 0.0,
    most: float = 1.3,
) -> WeakCylinder:
    """Which cylinder, if one alone differs, explains the measured orders best, and how
    much it burns.

    Each cylinder that fires is fitted by itself between ``least`` and ``most`` of its
    injection: of its gas torque less that of compression where this can be told (from a
    pressure, traces or combustion), else of all of it. Low orders of a flywheel with
    phases tell all cylinders apart; amplitudes alone do not tell cylinders that fire
    half a cycle or a symmetric angle apart. Where no cylinder explains the rows
    (``explains``), something else is not as in the scene, and there is no verdict:
    :func:`identify` its numbers first. Arguments and errors as of :func:`identify`;
    :class:`SceneError` if no cylinder fires.
    """
    refuse_tracers(
        "weak_cylinder", train, instead="differentiate jaxhb.forced_response"
    )
    names = list(train.topology.firing_cylinders)
    if not names:
        raise SceneError(
            f"{train.topology.title}: no cylinder fires, so none can be weak."
        )
    train = train.replace({f"{name}.injection": 1.0 for name in names})
    parameters = tuple(
        Parameter(name=f"{name}.injection", low=least, high=most, scale="linear")
        for name in names
    )
    fit = Fit(train, measured, parameters, noise, {})
    fit.refuse_too_few(1)
    begin = fit.begin
    same = float((fit.residuals(fit.begin)[0] ** 2).sum())
    found = []
    for k, name in enumerate(names):
        # Amplitudes alone have a kink where all are equal, and grow to both sides of
        # it.
        both = [
            np.where(np.arange(len(names)) == k, side, begin)
            for side in (begin[k] / 2, (1 + begin[k]) / 2)
        ]
        tries = [fit.solve(own, np.array([k])) for own in both]
        u, residuals, slopes = min(tries, key=lambda one: (one[1] ** 2).sum())
        values, scale = fit.numbers(u)
        wider = max(fit.misfit(residuals, 1), 1.0)
        deviation = wider * scale[k] / max(float(np.linalg.norm(slopes[:, k])), 1e-300)
        found.append(
            _Suspect(
                name,
                values[k],
                deviation,
                residuals,
                u,
                bool(u[k] < 1e-4 or u[k] > 1 - 1e-4),
            )
        )
    found.sort(key=lambda suspect: suspect.chi_square)
    first = found[0]
    misfit = fit.misfit(first.residuals, 1)
    wider = max(misfit, 1.0)
    return WeakCylinder(
        names=tuple(one.name for one in found),
        gas_factor=np.array([one.gas_factor for one in found]),
        std=np.array([one.deviation for one in found]),
        evidence=np.array([one.chi_square - first.chi_square for one in found])
        / wider**2,
        all_equal=(same - first.chi_square) / wider**2,
        measured=measured,
        computed=fit.computed(first.shares)[0],
        misfit=misfit,
        explained=fit.explained(first.shares),
        kept=fit.kept,
        left_out=fit.left_out,
        at_bound=tuple(one.name for one in found if one.at_bound),
    )


@dataclass(frozen=True)
class _Suspect:
    """A cylinder that alone differs: its gas torque and what the fit leaves."""

    name: str
    gas_factor: float
    deviation: float
    residuals: np.ndarray
    shares: np.ndarray
    at_bound: bool

    @property
    def chi_square(self):
        """Sum of squares of the residuals over their deviations."""
        return float((self.residuals**2).sum())

"""Numbers of a train from measurements: a fit of computed to measured orders, and the
numbers that the data leave open.

    min over p   sum over rows |computed(p) - measured|^2 / sigma^2
                 + sum over priors (p - own)^2 / std^2

Computed is the linear forced response, teeth in contact; its derivatives by the numbers
are those of jax. Least squares are solved by the trust-region method of scipy, within
bounds. Rows at speeds at which the equations have no answer are left out, and said to
be.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from jaxhb._jax import Array, refuse_tracers, remembered
from jaxhb._program import Program
from jaxhb._shown import brief
from jaxhb.design.measurements import Measured
from jaxhb.design.quantities import Parameter, parameter_faults
from jaxhb.design.task import named_at, scales, shares_of
from jaxhb.elements.sentences import SceneError
from jaxhb.linear.forced import forced_response
from jaxhb.linear.tangent import linear_train
from jaxhb.results.answers import left_out, solved
from jaxhb.results.quantities import MEASURED
from jaxhb.results.status import NotConverged
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import listed_harmonic

# Share of the largest amplitude of an element that sensors make noise of, too
FLOOR = 0.05
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

    train : DriveTrain with the fitted numbers; parameters : tuple of Parameter; before,
    values, std : ``(P,)``, as the train had them, fitted, and their standard
    deviations; correlation : ``(P, P)``; open : names of the numbers that the data do
    not determine; at_bound : names; computed, before_computed : complex ``(R,)``, of
    the fitted train and of that given; sigma : ``(R,)``, standard deviation that was
    taken for each row, in its unit; misfit : root mean square of the residuals over
    sigma, the root of the reduced chi-square; explained : share of the measured
    amplitudes that the fit explains, 1 less the mean square of the residuals over that
    of the amplitudes measured, every element and quantity alike; kept : bool ``(R,)``,
    rows that were fitted; left_out : tuple of str, a sentence for each status of the
    others
    """

    train: DriveTrain
    measured: Measured
    parameters: tuple[Parameter, ...]
    before: np.ndarray
    values: np.ndarray
    std: np.ndarray
    correlation: np.ndarray
    open: tuple[str, ...]
    at_bound: tuple[str, ...]
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
        names = [parameter.name for parameter in self.parameters]
        correlation = self.correlation
        rows, columns = np.triu_indices(len(names), 1)
        return [
            (names[i], names[j], float(correlation[i, j]))
            for i, j in zip(rows, columns, strict=True)
            if abs(correlation[i, j]) > ALIKE
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
    title = train.topology.title
    faults = [
        f"parameter {parameter.name!r}: {sentence}"
        for parameter in parameters
        for sentence in parameter_faults(train, parameter)
    ]
    faults += [
        f"parameter {parameter.name!r}: {_STAGED}"
        for parameter in parameters
        if _is_of_stages(train, parameter.name)
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
        if name not in {parameter.name for parameter in parameters}
    ]
    if faults:
        raise SceneError([f"{title}: {sentence}" for sentence in faults])
    fit = Fit(train, measured, parameters, noise, priors)
    fit.refuse_too_few(len(parameters))
    all_numbers = np.arange(len(parameters))
    u, residuals, slopes = fit.solve(fit.begin, all_numbers)
    # Numbers that lose an answer are no step, but they may win some.
    if fit.add_solved(u):
        u, residuals, slopes = fit.solve(u, all_numbers)
    return fit.result(u, residuals, slopes)


# Why stiffness and springs of a link with stages cannot be fitted
_STAGED = (
    "its link is linear here, with its stiffness at the mean load, so that this cannot"
    " be fitted. Leave it out."
)


def _is_of_stages(train: DriveTrain, name: str) -> bool:
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


@partial(Program, static_argnames=("parameters", "pairs", "harmonics"))
def computed_rows(
    train: DriveTrain,
    rpm: Array,
    places: tuple[Array, Array, Array],
    u: Array,
    *,
    parameters: tuple[Parameter, ...],
    pairs: tuple[tuple[str, str], ...],
    harmonics: int,
) -> tuple[Array, Array, Array]:
    """Complex amplitudes ``(R,)`` of rows at ``places`` (pair, speed, harmonic; 0 for a
    sum), the status ``(S,)`` of the speeds, and derivatives ``(R, P)`` of the
    amplitudes by the shares u ``(P,)`` of the parameters.
    """

    def rows(u: Array) -> tuple[Array, Array]:
        changed = train.replace(named_at(parameters, u))
        response = forced_response(changed, rpm=rpm, harmonics=harmonics)
        signals = [MEASURED[quantity].read(response, name) for quantity, name in pairs]
        sums = jnp.stack([signal.amplitudes.sum(axis=-1) for signal in signals])
        orders = 2 * jnp.stack([signal.coefficients for signal in signals])
        return orders.at[..., 0].set(sums)[places], response.status

    amplitudes, status = rows(u)
    return amplitudes, status, jax.jacfwd(lambda u: rows(u)[0])(u)


class Fit:
    """The residuals of rows and priors, and their least squares over some of the
    parameters.
    """

    def __init__(
        self,
        train: DriveTrain,
        measured: Measured,
        parameters: tuple[Parameter, ...],
        noise: float,
        priors: Mapping[str, float],
    ):
        self.train = train
        self.measured = measured
        self.parameters = parameters
        self.linear = linear_train(train, rpm=float(np.median(measured.rpm)))
        self.rpm, speed = np.unique(measured.rpm, return_inverse=True)
        pairs = list(zip(measured.quantity, measured.element, strict=True))
        self.pairs = tuple(dict.fromkeys(pairs))
        pair = np.array([self.pairs.index(key) for key in pairs])
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
        self.begin = shares_of(train, parameters)
        self.before = np.array(
            [float(train.value(parameter.name)) for parameter in parameters]
        )
        self.priors = np.array(
            [priors.get(parameter.name, np.inf) for parameter in parameters]
        )
        self.fitted = np.zeros(len(pairs), dtype=bool)
        self.left_out: tuple[str, ...] = ()
        self.add_solved(self.begin)

    def add_solved(self, u: np.ndarray) -> bool:
        """Fit the rows that have an answer at shares u, besides those fitted before;
        tell whether they are more now.
        """
        _, status, _ = self.computed(u)
        before = self.fitted
        row_status = status[self.places[1]]
        self.fitted = before | solved(row_status)
        lost = ~self.fitted
        title = self.train.topology.title
        sentences = left_out(
            self.measured.rpm[lost],
            row_status[lost],
            title,
            answered=np.zeros(lost.sum(), dtype=bool),
        )
        self.left_out = tuple(dict.fromkeys(sentences))
        # Rows that are left out say nothing of the noise of the others.
        size = self.measured.amplitude
        pair = self.places[0]
        largest = np.array(
            [
                size[self.fitted & (pair == row_pair)].max(initial=0.0)
                for row_pair in pair
            ]
        )
        self.sigma = self.noise * np.hypot(size, FLOOR * largest)
        self.sigma = np.where(self.sigma > 0, self.sigma, 1.0)
        return bool((self.fitted & ~before).any())

    def refuse_too_few(self, needed: int) -> None:
        """Raise :class:`NotConverged` where fewer than ``needed`` measured numbers and
        priors have an answer.
        """
        if self.n_data < needed:
            raise NotConverged(
                f"{self.n_data} of the measured numbers and priors are left for"
                f" {needed} parameters, as the others have no answer:"
                f" {' '.join(self.left_out)}"
            )

    @property
    def n_data(self) -> int:
        """How many measured numbers and priors are fitted."""
        return int(
            self.fitted.sum()
            + (self.fitted & self.phased).sum()
            + np.isfinite(self.priors).sum()
        )

    def misfit(self, residuals: np.ndarray, free: int) -> float:
        """Root mean square of residuals over their deviations, of a fit of ``free``
        parameters.
        """
        return float(np.sqrt((residuals**2).sum() / max(self.n_data - free, 1)))

    def explained(self, u: np.ndarray) -> float:
        """Share of the measured amplitudes that the numbers of shares u explain."""
        computed, _, _ = self.computed(u)
        measured = self.measured.amplitude
        off = np.where(
            self.phased, np.abs(computed - self.target), np.abs(computed) - measured
        )
        shares = []
        for pair in np.unique(self.places[0][self.fitted & (measured > 0)]):
            rows = self.fitted & (self.places[0] == pair)
            shares.append((off[rows] ** 2).sum() / (measured[rows] ** 2).sum())
        return 1.0 - float(np.mean(shares)) if shares else np.nan

    def numbers(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Numbers ``(P,)`` of shares, and their derivatives by them ``(P,)``."""
        values = np.array(list(named_at(self.parameters, u).values()))
        low, high, ratio = scales(self.parameters)
        return values, np.where(ratio > 0, values * ratio, high - low)

    def computed(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Complex amplitudes ``(R,)``, the status of the speeds ``(S,)``, and
        derivatives ``(R, P)``.
        """
        amplitudes, status, slopes = computed_rows(
            self.linear,
            self.rpm,
            self.places,
            np.asarray(u),
            parameters=self.parameters,
            pairs=self.pairs,
            harmonics=self.harmonics,
        )
        return np.asarray(amplitudes), np.asarray(status), np.asarray(slopes)

    def residuals(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals over their deviations, of rows, the second half of those with a
        phase, and priors; and their derivatives by the shares.

        0 of rows that are not fitted; nan of rows that are and have no answer, which no
        step of least squares accepts.
        """
        values, status, slopes = self.computed(u)
        values = np.where(solved(status)[self.places[1]], values, np.nan)
        values = np.where(self.fitted, values, self.target)
        slopes = np.where(self.fitted[:, None], slopes, 0.0)
        size = np.abs(values)
        phased = self.phased
        turned = np.where(size > 0, values.conj() / np.where(size > 0, size, 1.0), 1.0)
        complex_off = values - self.target
        amplitude_off = size - self.measured.amplitude
        off = np.where(phased, complex_off.real, amplitude_off) / self.sigma
        turned_slopes = (turned[:, None] * slopes).real
        row_slopes = np.where(phased[:, None], slopes.real, turned_slopes)
        row_slopes = row_slopes / self.sigma[:, None]
        numbers, scale = self.numbers(u)
        has_prior = np.isfinite(self.priors)
        prior_off = (numbers - self.before)[has_prior] / self.priors[has_prior]
        prior_slopes = np.diag(scale)[has_prior] / self.priors[has_prior][:, None]
        off = np.concatenate(
            [off, complex_off.imag[phased] / self.sigma[phased], prior_off]
        )
        return off, np.concatenate(
            [
                row_slopes,
                slopes.imag[phased] / self.sigma[phased][:, None],
                prior_slopes,
            ]
        )

    def solve(
        self, begin: np.ndarray, free: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Solve least squares over the ``free`` parameters, the others as in ``begin``:
        shares, residuals and derivatives.
        """

        def whole(part: np.ndarray) -> np.ndarray:
            u = begin.copy()
            u[free] = part
            return u

        # Residuals and derivatives are read one after the other.
        evaluated = remembered(lambda part: self.residuals(whole(part)))
        least = least_squares(
            lambda part: evaluated(part)[0],
            np.clip(begin[free], 1e-6, 1 - 1e-6),
            jac=lambda part: evaluated(part)[1][:, free],
            bounds=(0.0, 1.0),
            x_scale="jac",
            ftol=1e-10,
            xtol=1e-10,
            gtol=1e-10,
        )
        off, by_shares = evaluated(least.x)
        return whole(least.x), off, by_shares

    def result(
        self, u: np.ndarray, residuals: np.ndarray, slopes: np.ndarray
    ) -> Identification:
        """The :class:`Identification` of a fit."""
        values, scale = self.numbers(u)
        misfit = self.misfit(residuals, len(u))
        # Directions that no row sees keep the deviation that the bounds leave.
        covariance = np.linalg.inv(
            slopes.T @ slopes / max(misfit, 1.0) ** 2 + 12e-9 * np.eye(len(u))
        )
        deviation = np.sqrt(np.diag(covariance))
        left = np.sqrt(1 / 12.0)
        names = np.array([parameter.name for parameter in self.parameters])
        return Identification(
            train=self.train.replace(
                dict(zip(names.tolist(), values.tolist(), strict=True))
            ),
            measured=self.measured,
            parameters=self.parameters,
            before=self.before,
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
            kept=self.fitted,
            left_out=self.left_out,
        )


@brief
@dataclass(frozen=True)
class WeakCylinder:
    """Result of :func:`weak_cylinder`: C cylinders, the likeliest first.

    names : tuple; gas_factor, std : ``(C,)``, the share that each burns if it alone
    differs; evidence : ``(C,)``, chi-square of the rows less that of the first;
    all_equal : the same of a train in which none differs; misfit, explained, kept,
    left_out : of the fit of the first, as of an :class:`Identification`; the deviation
    of each is widened by its own misfit where that is above 1, and chi-squares are
    divided by the square of that of the first; computed : complex ``(R,)``, of the fit
    of the first; at_bound : names whose share is at an end of its range
    """

    names: tuple[str, ...]
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
    def likely(self) -> tuple[str, ...]:
        """Names that the rows do not tell from the first: less than 4 of chi-square
        apart, two deviations.
        """
        return tuple(
            name
            for name, difference in zip(self.names, self.evidence, strict=True)
            if difference < APART
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
    """Find the cylinder that, if it alone differs, explains the measured orders best,
    and how much it burns.

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
    suspects = []
    for k, name in enumerate(names):
        # Amplitudes alone have a kink where all are equal, and grow to both sides of
        # it.
        starts = [
            np.where(np.arange(len(names)) == k, side, begin)
            for side in (begin[k] / 2, (1 + begin[k]) / 2)
        ]
        attempts = [fit.solve(start, np.array([k])) for start in starts]
        u, residuals, slopes = min(
            attempts, key=lambda attempt: (attempt[1] ** 2).sum()
        )
        values, scale = fit.numbers(u)
        wider = max(fit.misfit(residuals, 1), 1.0)
        deviation = wider * scale[k] / max(float(np.linalg.norm(slopes[:, k])), 1e-300)
        at_bound = bool(u[k] < 1e-4 or u[k] > 1 - 1e-4)
        suspects.append(_Suspect(name, values[k], deviation, residuals, u, at_bound))
    suspects.sort(key=lambda suspect: suspect.chi_square)
    first = suspects[0]
    misfit = fit.misfit(first.residuals, 1)
    wider = max(misfit, 1.0)
    return WeakCylinder(
        names=tuple(suspect.name for suspect in suspects),
        gas_factor=np.array([suspect.gas_factor for suspect in suspects]),
        std=np.array([suspect.deviation for suspect in suspects]),
        evidence=np.array(
            [suspect.chi_square - first.chi_square for suspect in suspects]
        )
        / wider**2,
        all_equal=(same - first.chi_square) / wider**2,
        measured=measured,
        computed=fit.computed(first.shares)[0],
        misfit=misfit,
        explained=fit.explained(first.shares),
        kept=fit.fitted,
        left_out=fit.left_out,
        at_bound=tuple(suspect.name for suspect in suspects if suspect.at_bound),
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
    def chi_square(self) -> float:
        """Sum of squares of the residuals over their deviations."""
        return float((self.residuals**2).sum())

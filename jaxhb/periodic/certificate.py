"""A certificate: within what distance of a computed motion a true periodic motion exists (Fridman 2009, ch. 4 and 5).

The theorem of Newton and Kantorovich on the untruncated equation of the deflections, ``F(y) = y - y_lin + H psi(y)``
``= 0`` (:mod:`jaxhb.periodic.linearisation`). With A the inverse of ``F'(ybar)`` on the low harmonics and 1 beyond,
``|.|_w`` the weighted norm, E the largest value over the weighted norm, ``|.|`` the largest value over the cycle:

1. ``Z1 = |1 - A F'|_w < 1`` shows that ``F'`` has an inverse, and that it is near A (docs/theory A4.5, where the
   columns beyond ``high`` are parted: those far from the rows they act on meet coefficients of the share that have
   died).
2. ``F'^-1 H = A H + (1 - A F') F'^-1 H``: as H makes bounded motions of forces with bounded root mean square,
   the largest value of Newton's correction is at most

       Y0 = |A F| + E Z1/(1 - Z1) |A F|_w,

   and within the distance r of ybar the correction changes at most Z2 r times as fast as the motion, with

       Z2 = |A H zone/tau| + E Z1/(1 - Z1) |A H zone|_w sqrt(sum of zone shares / tau^2),

   the zone of a mesh being the times at which its deflection is within r of the transition of its law: elsewhere a
   change of the deflection does not change its stiffness.
3. ``h0 = Y0 Z2 <= 1/2``: a true motion exists within ``r = 2 Y0 / (1 + sqrt(1 - 2 h0))`` backlashes of ybar, all the
   time and at every mesh, and no other within 2 Y0. (r <= 2 Y0: the zone is that of 2 Y0.)

A radius in the weighted norm would cost the factor E twice, 10 to 30 where tooth modes lie at harmonics in the
hundreds; the largest value has no such factor.

Forces: elastic ones change at most with the stiffness in contact. Damping asks for the rate of the difference
``p = y* - ybar``, ``F' p = q = -F - H Delta``, ``|Delta| <= zone r^2 / 2 tau``: ``p = A q + e`` with ``e = d - H psi'
e``, ``d = q - F' A q`` and ``|e|_w <= Z1/(1 - Z1) |A q|_w``, all of which can be differentiated in time.

The theorem is applied at the motion to which Newton's method leads on ``low`` harmonics, many more than those of the
response; bounds of the response add the distance between the two, which is computed. What is true uniformly is only
the small-gain number: below 1 the equation has one solution for every load. Else ``F'`` may be singular (a parametric
resonance, docs/theory A4.2: the claim (31) of the source is false) and several motions may coexist, each with a
certificate of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import jax
import numpy as np

from .._shown import brief
from ..harmonic import backlash, fourier
from ..harmonic.backlash import law_of
from ..harmonic.excitation import listed_harmonic
from ..response.response import Response
from .certified_stability import decide
from .linearisation import PER_HARMONIC, Linearisation, Sizes, highest_frequency
from .planning import mesh_mode_harmonics
from .problem import pose
from .stability import train_of
from .time_steps import time_steps_of

LEAST, MOST = 32, 8192
"""Harmonics in which the linearised equation is solved: at least, and at most."""

BEYOND, OUTER = 3, 8
"""Times the harmonics of the tooth modes in which the linearised equation is solved, and times those to which it is
evaluated."""

REFINEMENTS, EXACT = 6, 1e-10
"""Newton steps on the low harmonics at most, and size of a correction in backlashes that needs no other."""

ROUNDED, UNSOLVED = 1e-13, 1e-6
"""Share of the terms of F that rounding may leave, and of a right side that a solve with ``F'`` may."""

NEAR = 0.02
"""Distance from the knee of a mesh, in backlashes, below which its modes have to be resolved."""

SAMPLES = 64
"""Time samples per low harmonic at which the response is compared with the refined motion."""

SWEEP_STEPS = 4096
"""Time steps of the preconditioner at most."""

REACH = 2**18
"""Harmonics up to which receptances are evaluated: beyond twice the highest natural frequency they are bounded."""


@dataclass(frozen=True)
class Kantorovich:
    """The theorem of Newton and Kantorovich (Kantorovich & Akilov, XVIII.1; docs/theory A4.3).

    Parameters
    ----------
    H0 : norm of the inverse derivative; delta0 : of the first correction; K : Lipschitz constant of the derivative

    Examples
    --------
    >>> case = Kantorovich(H0=2.0, delta0=0.7, K=1 / 14)
    >>> round(case.h0, 12), round(float(case.radius), 6), round(float(case.bound(2)), 8)
    (0.1, 0.73901, 0.00012077)
    """

    H0: float
    delta0: float
    K: float

    @property
    def h0(self) -> float:
        """``H0 K delta0``, at most 1/2 where the theorem holds."""
        return self.H0 * self.K * self.delta0

    @property
    def holds(self) -> bool:
        """Whether a solution exists within :attr:`radius`."""
        return self.h0 <= 0.5

    @property
    def radius(self) -> float:
        """(36): ``(1 - sqrt(1 - 2 h0)) / h0 delta0``, within which a solution exists; nan where the theorem fails."""
        return 2 * self.delta0 / (1 + self._root)

    @property
    def uniqueness(self) -> float:
        """Distance within which it is the only one; inf where the derivative does not change."""
        slope = self.H0 * self.K
        return (1 + self._root) / slope if slope else np.inf

    @property
    def _root(self):
        return np.sqrt(1 - 2 * self.h0) if self.holds else np.nan

    def bound(self, steps: int) -> float:
        """Largest distance from the solution after so many exact Newton steps: (37) corrected, and sharp (Gragg &
        Tapia, SIAM J. Numer. Anal. 11 (1974) 10)."""
        if not self.h0:
            return 0.0 if steps else self.delta0
        ratio = self.radius / self.uniqueness
        if ratio == 1:
            return self.radius / 2.0**steps
        power = ratio ** (2.0**steps)
        return (self.uniqueness - self.radius) * power / (1 - power)


@brief
@dataclass(frozen=True)
class Certificate:
    """How far a true periodic motion is from a computed one, made by :func:`certify`; ``str`` says it.

    A check in double precision after the solve, with norms that are iterated and enlarged by a tenth: no interval
    arithmetic.

    Parameters
    ----------
    reason : str, what failed and what to do; empty where a true motion is shown to exist
    meshes : tuple of str, those with backlash
    deflection_bound, elastic_bound, force_bound : ``(G,)`` m, N, N
        Of each mesh the largest difference over the cycle between the computed and the true motion: of the deflection,
        of the elastic tooth force and of the tooth force with its damping; inf where nothing is shown.
    Y0, Z1, Z2 : of the theorem, lengths in backlashes, at the motion that Newton's method finds on ``low`` harmonics
    small_gain : float, below 1 there is one motion of one cycle whatever the load (docs/theory A4.2)
    harmonic_balance : Kantorovich, of the truncated equations with exact integrals, weighted norm, backlashes
    stable : bool or None, whether the true motion attracts; None where the bound does not decide it
    harmonics, low, high : of the response, of the inverse, of the equation
    """

    reason: str
    meshes: tuple
    deflection_bound: np.ndarray
    elastic_bound: np.ndarray
    force_bound: np.ndarray
    Y0: float
    Z1: float
    Z2: float
    small_gain: float
    low: int
    high: int
    harmonics: int = 0
    stable: bool | None = None
    harmonic_balance: Kantorovich | None = None

    @property
    def holds(self) -> bool:
        """Whether a true motion is shown to exist."""
        return not self.reason

    @property
    def h0(self) -> float:
        """``Y0 Z2``, at most 1/2 where a true motion is shown."""
        return self.Y0 * self.Z2

    @property
    def radius(self) -> float:
        """Distance of the true motion from the refined one, in backlashes, all the time and at every mesh."""
        return Kantorovich(self.Z2, self.Y0, 1.0).radius if self.holds else np.inf

    @property
    def unique_within(self) -> float:
        """Distance from the refined motion within which there is no other of one cycle, in backlashes."""
        return 2 * self.Y0 if self.holds else 0.0

    def __str__(self):
        if not self.holds:
            return f"not certified: {self.reason}"
        if not len(self.meshes):
            return "no mesh has backlash: the equations are linear and solved exactly"
        pairs = zip(self.meshes, self.force_bound, strict=True)
        return "a true periodic motion exists, its tooth forces within " + ", ".join(
            f"{bound:.2g} N ({name})" for name, bound in pairs
        )


_NONE = np.zeros(0)
_LINEAR = Certificate("", (), _NONE, _NONE, _NONE, Y0=0.0, Z1=0.0, Z2=0.0, small_gain=0.0, low=0, high=0)


def certify(response: Response) -> Certificate:
    """Show that a true periodic motion exists near a computed one, and how near.

    Parameters
    ----------
    response : Response
        At one speed, solved, with its train.

    Returns
    -------
    Certificate

    Raises
    ------
    NotConverged
        If the response solves no equations.
    ValueError
        For the response of a sweep or of a transformation; for disks without inertia, whose deflections do not fall
        with frequency.

    Notes
    -----
    Serves both laws of damping, loss factors and closed loops. Limits: the sampled largest values, the decay of
    coefficients beyond those computed, and rounding are not enclosed.

    Examples
    --------
    >>> import jaxhb
    >>> found = jaxhb.certify(jaxhb.solve(jaxhb.load_scene("spur_pair"), rpm=3000.0))
    >>> found.holds
    True
    """
    train = train_of(response)
    gaps = np.flatnonzero(train.topology.mesh_backlash)
    problem = pose(train, float(response.rpm), listed_harmonic(train.topology))
    _check_inertia(train, problem.system)
    given = np.asarray(response.deflections)[gaps]
    if not len(gaps):
        return _LINEAR
    modes = mesh_mode_harmonics(train, float(problem.frequency))[0] if _leaves_contact(train, given, gaps) else 0.0
    highest = highest_frequency(problem.system) / float(problem.frequency)
    low, deflection = _level(max(LEAST, 2 * response.harmonics, BEYOND * modes)), given
    balance = None
    while True:
        sizes = _sizes(low, highest, problem.load.shape[-1] - 1)
        lin = Linearisation(problem, train, deflection, sizes, max(1.0, modes / 3))
        balance = balance or _harmonic_balance(lin, response.harmonics)
        lin = _refine(lin)
        found = _prove(lin, train, gaps)
        if found.holds:
            found = replace(found, stable=decide(lin, train, found))
        if found.holds or 2 * low > MOST or not lin.complete:
            return _of_response(found, lin, given, balance, response.harmonics)
        low, deflection = 2 * low, lin.deflection * lin.law.backlash[:, None]


def _leaves_contact(train, deflection, gaps):
    """Whether any mesh comes near the knee of its law."""
    law = jax.tree.map(lambda a: np.asarray(a)[gaps], law_of(train.meshes))
    value = np.abs(fourier.synthesize(deflection, PER_HARMONIC * max(deflection.shape[1] - 1, 1)))
    return bool((value.min(-1) < law.knee + NEAR * law.backlash).any())


def _refine(lin):
    """The linearisation at the motion to which Newton's method leads on the low harmonics: the nearer to a true one,
    the less is to be shown."""
    size = np.inf
    for _ in range(REFINEMENTS):
        corrected = lin.inverse(lin.residual())
        corrected[:, lin.sizes.low + 1 :] = 0
        last, size = size, lin.largest(corrected).max()
        if not EXACT < size < last:
            break
        lin = lin.moved(-corrected[:, : lin.sizes.low + 1])
    return lin


def _level(harmonics):
    """The power of two from ``harmonics`` on, up to MOST: few of them, as each has programs of its own."""
    return min(1 << int(np.ceil(np.log2(harmonics))), MOST)


def _sizes(low, highest, excited):
    high = max(OUTER * low, 1 << max(excited - 1, 1).bit_length())
    reach = 1 << max(high + 1, int(np.ceil(2 * highest))).bit_length()
    if reach > REACH:
        raise ValueError(
            f"the highest natural frequency lies at harmonic {highest:.0f} of the cycle; the certificate serves up to "
            f"{REACH // 4}: lump disks that are much lighter than the others."
        )
    return Sizes(low=low, high=high, reach=reach, time_steps=min(time_steps_of(low), SWEEP_STEPS))


def _check_inertia(train, system):
    light = [name for name, mass in zip(train.topology.disk_names, system.mass, strict=False) if not mass > 0]
    if light:
        named = ", ".join(map(repr, light))
        raise ValueError(f"disk {named}: inertia 0; a certificate needs disks with inertia: give it the little it has.")


def _prove(lin, train, gaps):
    """The numbers of the theorem around the motion of ``lin``, and what follows for the true one."""
    sizes, law, w = lin.sizes, lin.law, lin.weight
    low, high = sizes.low, sizes.high
    E, grid = lin.embedding, PER_HARMONIC * low // 4

    F = lin.residual()
    left = np.sqrt(2 * _beyond(lin.integral, high, 3))  # of psi beyond ``high``, root mean square
    corrected = lin.inverse(F)
    correction = lin.largest(corrected) + lin.gain_between(high + 1) * left
    weighted = np.hypot(np.linalg.norm(fourier.pack(w[: high + 1] * corrected)), lin.largest_gain(high + 1) * left)
    correction += ROUNDED * (lin.largest(lin.linear) + lin.largest(F - lin.linear))
    Z1 = _defect(lin)
    spread = E * Z1 / (1 - Z1) if Z1 < 1 else np.inf
    Y0 = float(correction.max() + spread * weighted)

    rates = fourier.synthesize(_rate(lin.deflection), grid)
    bent = np.abs(fourier.synthesize(_rate(_rate(lin.deflection)), grid)).max() * (np.pi / grid) ** 2 / 2
    zone = lin.near_transition(2 * Y0 + np.abs(rates) * np.pi / grid + bent, np.arange(grid) / grid)
    root = np.sqrt((zone.mean(-1) / law.transition**2).sum())
    kernel = rate_kernel = in_zone = 0.0
    if zone.any() and np.isfinite(Y0):
        kernel, rate_kernel = (_row_sum(lin, zone / law.transition[:, None], grid, rate) for rate in (False, True))
        in_zone = np.hypot(_zone_norm(lin, zone, grid), lin.largest_gain(low + 1))
    missing = lin.gain_between(low + 1) * root
    Z2 = float(kernel + missing + spread * in_zone * root) if zone.any() and Z1 < 1 else 0.0
    found = Certificate(
        reason=_reason(lin, Y0, Z1, Z2),
        meshes=tuple(train.topology.mesh_names[i] for i in gaps),
        **dict.fromkeys(("deflection_bound", "elastic_bound", "force_bound"), np.full(len(gaps), np.inf)),
        Y0=Y0,
        Z1=float(Z1),
        Z2=Z2,
        small_gain=_small_gain(lin),
        low=low,
        high=high,
    )
    if found.reason:
        return found
    kick = found.radius**2 / 2
    apart = correction + spread * weighted + Z2 * kick
    beside = F - corrected - lin.apply_gain(lin.times_share(corrected))
    slow, fast = lin.rate_of_gain(0, low), lin.rate_of_gain(low + 1, high)
    left = np.sqrt(2 * _beyond(_rate(lin.integral), high, 2))
    rate = lin.largest(_rate(corrected)) + lin.gain_between(high + 1) * left + 2 * np.abs(_rate(beside)).sum(-1)
    rate += (rate_kernel + fast / law.transition.min()) * kick
    rate += lin.half_range * (slow * missing + fast * (kernel + missing)) * kick
    rate += lin.half_range * (slow + fast) * spread * (weighted + in_zone * root * kick)
    moving = np.where(lin.slopes[1] > 0, (np.abs(rates) * zone).max(-1), 0.0)
    drag = (rate + moving * np.minimum(1.0, apart / law.transition)) * lin.frequency * law.backlash
    elastic = law.stiffness * law.backlash * apart
    viscous = np.asarray(train.meshes.damping)[gaps]
    return replace(
        found, deflection_bound=law.backlash * apart, elastic_bound=elastic, force_bound=elastic + viscous * drag
    )


def _of_response(found, lin, given, balance, harmonics):
    """The certificate of the response: bounds are those of the refined motion, and how far that is away."""
    found = replace(found, harmonic_balance=balance, harmonics=harmonics)
    if not found.holds:
        return found
    count, law, motions = SAMPLES * lin.sizes.low, lin.law.expand(), []
    gated, viscous = (lin.damping[key][:, None] for key in ("gated", "viscous"))
    for deflection in (given, lin.deflection * lin.law.backlash[:, None]):
        value = fourier.synthesize(deflection, count)
        rate = fourier.synthesize(fourier.derivative(deflection, lin.frequency), count)
        force = backlash.mesh_force(law, viscous, gated, value, rate)
        motions.append((value, backlash.force(law, value), force))
    apart, elastic, total = (_largest(a - b) for a, b in zip(*motions, strict=True))
    return replace(
        found,
        deflection_bound=found.deflection_bound + apart,
        elastic_bound=found.elastic_bound + elastic,
        force_bound=found.force_bound + total,
    )


def _largest(values):
    """``(G,)``: largest values over the cycle of periodic samples ``(G, M)``: between two of them a smooth function
    exceeds the larger by an eighth of the second difference, at a kink by less than a half."""
    second = np.abs(np.roll(values, 1, -1) - 2 * values + np.roll(values, -1, -1))
    return np.abs(values).max(-1) + second.max(-1) / 2


def _rate(x):
    """Coefficients of the derivative over the angle of the cycle."""
    return fourier.derivative(x, 1.0)


def _beyond(coefficients, harmonics, power):
    """Sum of squares beyond ``harmonics`` of all meshes: known ones, and what falls as n^-power beyond those."""
    known = coefficients.shape[-1] - 1
    squares = (np.abs(coefficients[:, harmonics + 1 :]) ** 2).sum()
    n = np.arange(known + 1)[3 * known // 4 :]
    constant = 2 * (n**power * np.abs(coefficients[:, 3 * known // 4 :])).max(initial=0.0)
    return squares + len(coefficients) * constant**2 / ((2 * power - 1) * float(known) ** (2 * power - 1))


def _defect(lin):
    """Z1."""
    sizes, w = lin.sizes, lin.weight
    low, high = sizes.low, sizes.high
    inner = w[: high + 1]

    def apply(x):
        x = x / inner
        return inner * (x - lin.inverse(x + lin.apply_gain(lin.times_share(x))))

    def adjoint(x):
        x = inner * x
        z = lin.inverse_transposed(x)
        return (x - z - lin.times_share(lin.apply_gain_transposed(z))) / inner

    if lin.half_range == 0:
        return 0.0
    whole = lin.norm(apply, adjoint, high)
    half = high // 2
    columns = _gain_norm(lin, low) * _coupling(lin.share, low, high)
    columns += lin.largest_gain(low + 1) * _coupling(lin.share, half, high)
    columns += lin.largest_gain(half + 1) * lin.half_range
    return np.hypot(whole + columns / w[high + 1], lin.largest_gain(high + 1) * lin.half_range)


def _coupling(share, rows, columns):
    """Bound of the product with (engagement - 1) from harmonics beyond ``columns`` to those up to ``rows``."""
    first = columns - rows + 1
    k = np.arange(first, share.shape[1])
    pairs = np.minimum(2 * rows + 1, k - first + 1)
    known = 2 * (pairs * np.abs(share[:, first:]) ** 2).sum(-1).max(initial=0.0)
    return np.sqrt(known + 2 * (2 * rows + 1) * _beyond(share, share.shape[1] - 1, 2))


def _gain_norm(lin, harmonics):
    """``|A H|_w`` of forces with so many harmonics."""
    w = lin.weight[: harmonics + 1]
    return lin.norm(
        lambda x: w * lin.inverse(lin.apply_gain(x)),
        lambda x: lin.apply_gain_transposed(lin.inverse_transposed(w * x)),
        harmonics,
    )


def _zone_norm(lin, zone, count):
    """``|A H zone|_w``, of forces with whatever harmonics: the norm of its adjoint."""
    low = lin.sizes.low
    w = lin.weight[: low + 1]

    def adjoint(x):
        values = fourier.synthesize(lin.apply_gain_transposed(lin.inverse_transposed(w * x)), count)
        return fourier.analyze(zone * values, low)  # its square is the share in the zone, as that of a projection

    return lin.norm(adjoint, lambda x: w * lin.inverse(lin.apply_gain(x)), low)


def _row_sum(lin, zone, count, rate):
    """``|A H zone|`` from largest value to largest value, or of its rate."""
    low = lin.sizes.low
    factor = 1j * np.arange(low + 1) if rate else np.ones(low + 1)

    def apply(values):
        x = factor * lin.inverse(lin.apply_gain(fourier.analyze(zone * values, low)))
        return fourier.synthesize(x, count)

    def adjoint(values):
        x = np.conj(factor) * fourier.analyze(values, low)
        return zone * fourier.synthesize(lin.apply_gain_transposed(lin.inverse_transposed(x)), count)

    return lin.largest_row_sum(apply, adjoint, count)


def _harmonic_balance(lin, harmonics):
    """The theorem on the truncated equations: their solution near the computed one."""
    own = lin.galerkin(harmonics)
    F = fourier.resize(fourier.resize(own.residual(), harmonics), lin.sizes.low)
    first = fourier.resize(own.inverse(F), harmonics)
    w = lin.weight[: harmonics + 1]

    def apply(x):
        return w * fourier.resize(own.inverse(fourier.resize(own.apply_gain(x), lin.sizes.low)), harmonics)

    def adjoint(x):
        return own.apply_gain_transposed(
            fourier.resize(own.inverse_transposed(fourier.resize(w * x, lin.sizes.low)), harmonics)
        )

    return Kantorovich(
        H0=lin.norm(apply, adjoint, harmonics),
        delta0=float(np.linalg.norm(fourier.pack(w * first))),
        K=lin.embedding / float(lin.law.transition.min(initial=1.0)),
    )


def _small_gain(lin):
    """sup of ``|H(n)|/2`` about the middle slope, in the units of force in which the receptances are symmetric."""
    root = np.sqrt(lin.slopes[0] * lin.law.backlash**2)
    middle = np.linalg.solve(np.eye(len(root)) - lin.held / 2, lin.held)
    return float(np.linalg.norm(middle * (root[:, None] / root), 2, axis=(1, 2)).max(initial=0.0) / 2)


def _reason(lin, Y0, Z1, Z2):
    """What failed and what to do, empty if nothing did."""
    low = lin.sizes.low
    if not lin.complete:
        return "the teeth pass the knots of their law too often for exact integrals: use more harmonics."
    if lin.unsolved > UNSOLVED or not (Z1 < 1 and np.isfinite(Y0)):
        return (
            f"the linearised equation could not be inverted well enough (Z1 = {Z1:.2g}, must be below 1): the motion "
            f"is near a fold, modes beyond harmonic {low} take part, or damping in contact is very strong."
        )
    if not Y0 * Z2 <= 0.5:
        return (
            f"no true motion is shown to be near (Y0 = {Y0:.2g} backlashes, must be below {0.5 / Z2:.2g}): this is no "
            f"motion of the untruncated equations, or its harmonics beyond {low} matter; use more harmonics."
        )
    return ""

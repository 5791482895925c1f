"""The theorem behind a certificate, its numbers computed without outward rounding
(Fridman 2009, ch. 4 and 5).

The theorem of Newton and Kantorovich is applied to the untruncated equation of the
deflections, ``F(y) = y - y_lin + H psi(y) = 0``
(:mod:`jaxhb.certificate.linearization`). With A the inverse of ``F'(ybar)`` on the low
harmonics and 1 beyond, ``|.|_w`` the weighted norm, E the largest value over the
weighted norm, ``|.|`` the largest value over the cycle:

1. ``Z1 = |1 - A F'|_w < 1`` shows that ``F'`` has an inverse, and that it is near A
   (docs/theory A4.5, where the columns beyond ``high`` are split: those far from the
   rows they act on meet coefficients of the share that have decayed).
2. ``F'^-1 H = A H + (1 - A F') F'^-1 H``: as H turns forces with bounded root mean
   square into bounded motions, the largest value of Newton's correction is at most

       Y0 = |A F| + E Z1/(1 - Z1) |A F|_w,

   and within the distance r of ybar the correction changes at most Z2 r times as fast
   as the motion, with

       Z2 = |A H zone/tau| + E Z1/(1 - Z1) |A H zone|_w sqrt(sum of zone shares /
       tau^2),

   the zone of a mesh being the times at which its deflection is within r of the
   transition of its law: elsewhere a change of the deflection does not change its
   stiffness.
3. ``h0 = Y0 Z2 <= 1/2``: a true motion exists within ``r = 2 Y0 / (1 + sqrt(1 - 2
   h0))`` backlashes of ybar, all the time and at every mesh, and no other within 2 Y0.
   (r <= 2 Y0: the zone is that of 2 Y0.)

A radius in the weighted norm would cost the factor E twice, 10 to 30; the largest value
has no such factor. Forces: elastic ones change at most with the stiffness in contact.
Damping needs the rate of the difference ``p = y* - ybar``, ``F' p = q = -F - H Delta``,
``|Delta| <= zone r^2 / 2 tau``: ``p = A q + e`` with ``e = d - H psi' e``, ``d = q - F'
A q`` and ``|e|_w <= Z1/(1 - Z1) |A q|_w``, all of which can be differentiated in time.

Where the small-gain number is not below 1 several motions may coexist, each with a
certificate (docs/theory A4.2).
"""

from dataclasses import replace

import numpy as np

from jaxhb._jax import on_host
from jaxhb.certificate.linearization import (
    SAMPLES,
    Linearization,
    NotInverted,
    one_norm,
)
from jaxhb.equations import exact_integrals, fourier
from jaxhb.equations.state_space import partition, state_space
from jaxhb.floquet.variational import propagation
from jaxhb.results.bounds import NORM_MARGIN, ROW_SUM_MARGIN, Certificate, Kantorovich
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain


def without_bounds(
    lin: Linearization,
    train: DriveTrain,
    gaps: np.ndarray,
    Y0: float = np.inf,
    Z1: float = np.inf,
    Z2: float = 0.0,
) -> Certificate:
    """The certificate of the numbers of the theorem, with infinite bounds; by default
    the certificate where A was not computed.
    """
    # sup of |H(n)|/2 about the middle slope, in the units of force in which the
    # receptances are symmetric.
    root = np.sqrt(lin.slopes[0] * lin.law.backlash**2)
    middle = np.linalg.solve(np.eye(len(root)) - lin.held / 2, lin.held)
    gains = np.linalg.norm(middle * (root[:, None] / root), 2, axis=(1, 2))
    small_gain = gains.max(initial=0.0) / 2
    unbounded = np.full(len(gaps), np.inf)
    return Certificate(
        reason=_reason(lin, Y0, Z1, Z2),
        meshes=tuple(train.topology.mesh_names[i] for i in gaps),
        deflection_bound=unbounded,
        elastic_bound=unbounded,
        force_bound=unbounded,
        Y0=Y0,
        Z1=float(Z1),
        Z2=Z2,
        small_gain=float(small_gain),
        low=lin.sizes.low,
        high=lin.sizes.high,
    )


def bounds_at(lin: Linearization, train: DriveTrain, gaps: np.ndarray) -> Certificate:
    """The certificate of the motion of ``lin``: the numbers of the theorem, and the
    bounds that follow; raises NotInverted.
    """
    law = lin.law
    low = lin.sizes.low
    high = lin.sizes.high
    E = lin.embedding
    grid = SAMPLES * low // 4

    F, corrected, correction, weighted = _newton_correction(lin)
    Z1 = _defect(lin)
    # Neumann series of 1 - A F': a weighted norm times Z1/(1 - Z1), as a largest value
    # times E.
    spread = E * Z1 / (1 - Z1) if Z1 < 1 else np.inf
    Y0 = float(correction.max() + spread * weighted)

    # The zone is read at samples: between two of them a mesh moves as far as its rate
    # and bend allow.
    rates = fourier.synthesize(_rate(lin.deflection), grid)
    bends = fourier.synthesize(_rate(_rate(lin.deflection)), grid)
    bent = np.abs(bends).max() * (np.pi / grid) ** 2 / 2
    zone = lin.near_transition(
        2 * Y0 + np.abs(rates) * np.pi / grid + bent, np.arange(grid) / grid
    )
    root = np.sqrt((zone.mean(-1) / law.transition**2).sum())
    kernel = rate_kernel = in_zone = 0.0
    if zone.any() and np.isfinite(Y0):
        weight = zone / law.transition[:, None]
        kernel = _row_sum(lin, weight, grid, False)
        rate_kernel = _row_sum(lin, weight, grid, True)
        in_zone = np.hypot(_zone_norm(lin, zone, grid), lin.largest_gain(low + 1))
    # A is 1 beyond ``low``: there A H = H, from root mean square to largest value.
    missing = lin.gain_between(low + 1) * root
    Z2 = 0.0
    if zone.any() and Z1 < 1:
        Z2 = float(kernel + missing + spread * in_zone * root)
    certificate = without_bounds(lin, train, gaps, Y0, Z1, Z2)
    if certificate.reason:
        return certificate
    # The engagement has the slope 1/tau in the zone: its integral differs from the
    # linear one by at most r^2 / (2 tau).
    kick = certificate.radius**2 / 2  # bound of Delta / 2, times the transition
    apart = correction + spread * weighted + Z2 * kick
    # The rates of A q, of d = q - F' A q and of -H psi' e, one statement each, as in
    # the head of this module.
    defect = F - corrected - lin.apply_gain(lin.times_share(corrected))
    slow = lin.rate_of_gain(0, low)
    fast = lin.rate_of_gain(low + 1, high)
    left = np.sqrt(2 * _beyond(_rate(lin.integral), high, 2))
    rate = (
        lin.largest(_rate(corrected))
        + lin.gain_between(high + 1) * left
        + 2 * np.abs(_rate(defect)).sum(-1)
    )
    rate += (rate_kernel + fast / law.transition.min()) * kick
    rate += lin.half_range * (slow * missing + fast * (kernel + missing)) * kick
    rate += lin.half_range * (slow + fast) * spread * (weighted + in_zone * root * kick)
    moving = np.where(lin.slopes[1] > 0, (np.abs(rates) * zone).max(-1), 0.0)
    drag = (
        (rate + moving * np.minimum(1.0, apart / law.transition))
        * lin.frequency
        * law.backlash
    )
    elastic = law.stiffness * law.backlash * apart
    total = elastic + lin.meshes.viscous * drag
    return replace(
        certificate,
        deflection_bound=np.asarray(law.backlash * apart),
        elastic_bound=np.asarray(elastic),
        force_bound=total,
    )


def _newton_correction(
    lin: Linearization,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """F and A F ``(G, high+1)``, and bounds of the largest value of each mesh ``(G,)``
    and of the weighted norm of Newton's correction.
    """
    w = lin.weight
    high = lin.sizes.high
    F = lin.residual()
    # Root mean square of psi beyond ``high``
    left = np.sqrt(2 * _beyond(lin.integral, high, 3))
    corrected = lin.inverse(F)
    correction = lin.largest(corrected) + lin.gain_between(high + 1) * left
    weighted = np.hypot(
        np.linalg.norm(fourier.pack(w[: high + 1] * corrected)),
        lin.largest_gain(high + 1) * left,
    )
    # Rounding of the terms of F, which cancel, is not in the residual computed from
    # them.
    correction += 1e-13 * (lin.largest(lin.linear) + lin.largest(F - lin.linear))
    return F, corrected, correction, weighted


def _rate(x: np.ndarray) -> np.ndarray:
    """Coefficients of the derivative with respect to the angle of the cycle."""
    return fourier.derivative(x, 1.0)


def _beyond(coefficients: np.ndarray, harmonics: int, power: int) -> float:
    """Sum of squares beyond ``harmonics`` of all meshes: of the computed coefficients,
    and beyond these of a bound that falls as n^-power.
    """
    last = coefficients.shape[-1] - 1
    squares = (np.abs(coefficients[:, harmonics + 1 :]) ** 2).sum()
    first = 3 * last // 4
    n = np.arange(last + 1)[first:]
    constant = 2 * (n**power * np.abs(coefficients[:, first:])).max(initial=0.0)
    return squares + len(coefficients) * constant**2 / (
        (2 * power - 1) * float(last) ** (2 * power - 1)
    )


def _defect(lin: Linearization) -> float:
    """Bound of Z1."""
    w = lin.weight
    low = lin.sizes.low
    high = lin.sizes.high
    inner = w[: high + 1]

    def apply(x: np.ndarray) -> np.ndarray:
        x = x / inner
        return inner * (x - lin.inverse(x + lin.apply_gain(lin.times_share(x))))

    def adjoint(x: np.ndarray) -> np.ndarray:
        x = inner * x
        z = lin.inverse_transposed(x)
        return (x - z - lin.times_share(lin.apply_gain_transposed(z))) / inner

    if lin.half_range == 0:
        return 0.0
    whole = lin.norm(apply, adjoint, high, enough=1.0)
    if whole >= 1:
        return whole
    half = high // 2
    # Columns beyond ``high`` in three parts: rows up to ``low``, where A acts; up to
    # half of ``high``, whose coupling has decayed as well; and the rest, where the gain
    # is small.
    columns = _gain_norm(lin, low) * _coupling(lin.share, low, high)
    columns += lin.largest_gain(low + 1) * _coupling(lin.share, half, high)
    columns += lin.largest_gain(half + 1) * lin.half_range
    return np.hypot(
        whole + columns / w[high + 1], lin.largest_gain(high + 1) * lin.half_range
    )


def _coupling(share: np.ndarray, rows: int, columns: int) -> float:
    """Bound of the product with (engagement - 1) from harmonics beyond ``columns`` to
    those up to ``rows``.
    """
    first = columns - rows + 1
    k = np.arange(first, share.shape[1])
    # Hilbert-Schmidt norm of the corner of a Toeplitz matrix: ``places`` of it hold
    # coefficient k of the share.
    places = np.minimum(2 * rows + 1, k - first + 1)
    computed = 2 * (places * np.abs(share[:, first:]) ** 2).sum(-1).max(initial=0.0)
    beyond = 2 * (2 * rows + 1) * _beyond(share, share.shape[1] - 1, 2)
    return np.sqrt(computed + beyond)


def _gain_norm(lin: Linearization, harmonics: int) -> float:
    """``|A H|_w`` of forces with so many harmonics."""
    w = lin.weight[: harmonics + 1]
    return lin.norm(
        lambda x: w * lin.respond(x), lambda x: lin.respond_transposed(w * x), harmonics
    )


def _zone_norm(lin: Linearization, zone: np.ndarray, count: int) -> float:
    """``|A H zone|_w`` of forces with any number of harmonics: the norm of its
    adjoint.
    """
    low = lin.sizes.low
    w = lin.weight[: low + 1]

    def adjoint(x: np.ndarray) -> np.ndarray:
        values = fourier.synthesize(lin.respond_transposed(w * x), count)
        # Its square is the share in the zone, as that of a projection.
        return fourier.analyze(zone * values, low)

    return lin.norm(adjoint, lambda x: w * lin.respond(x), low)


def _row_sum(lin: Linearization, zone: np.ndarray, count: int, rate: bool) -> float:
    """``|A H zone|`` from largest value to largest value, or of its ``rate``: the
    largest absolute row sum of the map between motions at ``count`` time samples, with
    its margin.
    """
    low = lin.sizes.low
    factor = 1j * np.arange(low + 1) if rate else np.ones(low + 1)

    def apply(values: np.ndarray) -> np.ndarray:
        forces = fourier.analyze(zone * values.reshape(zone.shape), low)
        return fourier.synthesize(factor * lin.respond(forces), count).reshape(-1)

    def adjoint(values: np.ndarray) -> np.ndarray:
        x = np.conj(factor) * fourier.analyze(values.reshape(zone.shape), low)
        return (zone * fourier.synthesize(lin.respond_transposed(x), count)).reshape(-1)

    with np.errstate(all="ignore"):
        return ROW_SUM_MARGIN * one_norm(adjoint, apply, zone.size, columns=3)


def harmonic_balance(lin: Linearization, harmonics: int) -> Kantorovich:
    """Apply the theorem to the truncated equations: their solution near the computed
    motion.
    """
    truncated = lin.galerkin(harmonics)
    K = lin.embedding / float(lin.law.transition.min(initial=1.0))
    low = lin.sizes.low
    F = fourier.resize(fourier.resize(truncated.residual(), harmonics), low)
    w = lin.weight[: harmonics + 1]

    def apply(x: np.ndarray) -> np.ndarray:
        pushed = fourier.resize(truncated.apply_gain(x), low)
        return w * fourier.resize(truncated.inverse(pushed), harmonics)

    def adjoint(x: np.ndarray) -> np.ndarray:
        back = truncated.inverse_transposed(fourier.resize(w * x, low))
        return truncated.apply_gain_transposed(fourier.resize(back, harmonics))

    try:
        first = w * fourier.resize(truncated.inverse(F), harmonics)
        return Kantorovich(
            lin.norm(apply, adjoint, harmonics),
            float(np.linalg.norm(fourier.pack(first))),
            K,
        )
    except NotInverted:
        return Kantorovich(np.inf, np.inf, K)


def _reason(lin: Linearization, Y0: float, Z1: float, Z2: float) -> str:
    """Why no bound holds and what to do; empty if one does."""
    low = lin.sizes.low
    if not lin.complete:
        return (
            "the teeth pass the knots of their law too often for exact integrals: use"
            " more harmonics."
        )
    if not (Z1 < 1 and np.isfinite(Y0)):
        number = f" (Z1 = {Z1:.2g}, must be below 1)" if np.isfinite(Z1) else ""
        return (
            f"the linearised equation could not be inverted well enough{number}: the"
            f" motion is near a fold, modes beyond harmonic {low} take part, or damping"
            " in contact is very strong."
        )
    if not Y0 * Z2 <= 0.5:
        return (
            f"no motion of the train is found near (Y0 = {Y0:.2g} backlashes, must be"
            f" below {0.5 / Z2:.2g}): this is no motion of the untruncated equations,"
            f" or its harmonics beyond {low} matter; use more harmonics."
        )
    return ""


def attracts(
    lin: Linearization, train: DriveTrain, certificate: Certificate
) -> bool | None:
    """Whether the true motion near the refined motion of ``lin``, within the bounds of
    a ``certificate`` that holds, attracts: no multiplier crosses the unit circle
    between the two; None where that is not decided.

    The share of contact of the true motion differs from that of the refined one by
    ``s(t) Delta(t)``, s = 1, ``|Delta| <= r zone / tau``. Let s grow from 0 to 1. A
    multiplier ``z = exp(2 pi i theta)`` on the unit circle would be a motion ``exp(i
    theta t) x periodic`` with ``y + R_z s Delta y = 0``, R_z the response of the
    linearised train to impulses, in this class of motions: impossible if ``|R_z Delta|
    < 1`` in the largest value. With the monodromy matrix P, the deflections ``l(t)`` of
    unit states and the states ``e(s)`` after impulses

        R_z(t, s) = R_1(t, s) + l(t) ((z - P)^-1 - (1 - P)^-1) e(s),

    where the first term is part of the certificate, ``|R_1 Delta| <= Z2 r``, and the
    second is summed over the eigenvectors of P with the largest ``|1/(z - lambda) -
    1/(1 - lambda)|`` on the unit circle.
    """
    system = on_host(chain.assemble(train))
    meshes = lin.meshes
    # Loss factors have no equation in time, and large trains take too long.
    if np.any(system.loss) or len(system.mass) > 100:
        return None
    h = lin.law.backlash
    law = meshes.law
    parts = partition(
        system, meshes, train.topology.disk_names, train.topology.link_names
    )
    space = state_space(system, meshes, lin.frequency, parts)
    deflection = lin.deflection * h[:, None]
    times = np.append(
        exact_integrals.switching_times(law, deflection), np.arange(1, 2048) / 2048
    )
    onward = propagation(space, meshes, deflection, lin.frequency, np.unique(times))
    multipliers, shapes = np.linalg.eig(onward.matrix)
    # Largest deflection of each mesh in each eigenvector, and the amount of each that
    # impulses of the share of contact leave at the end of the cycle, where the share of
    # the true motion may differ: in the zone, by the trapezoidal rule.
    deflected = np.abs(onward.deflection @ shapes).max(0) / h[:, None]
    duration = np.diff(onward.share) * 2 * np.pi / lin.frequency
    near = lin.near_transition(certificate.radius, onward.share)
    zone = near / law.transition[:, None] * h[:, None]
    rate = (np.abs(np.linalg.inv(shapes) @ onward.end_state) * zone.T[:, None]).sum(-1)
    excited = ((rate[1:] + rate[:-1]) / 2 * duration[:, None]).sum(0)
    # The rotation of the train has a multiplier of 1 and bends no tooth: it is left
    # out.
    observed = deflected.max(0) > 1e-9 * deflected.max()
    bending = multipliers[observed]
    z = np.exp(2j * np.pi * (np.arange(4096) + 0.5) / 4096)[:, None]
    with np.errstate(all="ignore"):
        # |1/(z - lambda) - 1/(1 - lambda)|
        change = np.abs((1 - z) / (z - bending) / (1 - bending)).max(0)
        closed = (deflected[:, observed] * change * excited[observed]).sum(-1).max()
    if not certificate.radius * (certificate.Z2 + NORM_MARGIN * closed) < 1:
        return None
    # No multiplier crosses the circle on the way to the true motion: it has as many
    # inside as the refined motion.
    return bool((np.abs(bending) < 1).all())

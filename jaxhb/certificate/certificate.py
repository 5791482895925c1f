"""A certificate: the computed distance from a computed motion within which a motion of
the train lies (Fridman 2009, ch. 4 and 5).

The theorem (:mod:`jaxhb.certificate.theorem`) is applied at the motion to which
Newton's method leads on more and more harmonics; bounds of the response add the
distance to that motion.
"""

from collections.abc import Sequence
from dataclasses import replace

import jax
import numpy as np

from jaxhb._jax import Array, refuse_tracers
from jaxhb.balance.plan import time_steps_of
from jaxhb.balance.problem import problem_at
from jaxhb.certificate.linearization import (
    SAMPLES,
    CertificateSizes,
    Linearization,
    NotInverted,
    highest_frequency,
)
from jaxhb.certificate.theorem import (
    attracts,
    bounds_at,
    harmonic_balance,
    without_bounds,
)
from jaxhb.equations import backlash, fourier
from jaxhb.floquet.stability import train_of
from jaxhb.linear.mesh_modes import mesh_mode_harmonics
from jaxhb.results.bounds import LINEAR, Certificate, Kantorovich
from jaxhb.results.response import Response
from jaxhb.results.signal import Signal
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import listed_harmonic
from jaxhb.train.mesh_parameters import law_of
from jaxhb.train.varying import at_speed

# Harmonics in which the linearised equation is solved: twice those of the response,
# thrice those of the tooth modes, within these; doubled until a bound holds.
FEWEST = 32
MOST = 8192
# Receptances at most, numbers of 16 B: several such arrays are in memory at a time
MOST_RECEPTANCES = 2**24
# Harmonics of receptances at most: beyond twice the highest natural frequency they are
# bounded
RECEPTANCES = 2**18


def certify(response: Response) -> Certificate:
    """Compute a bound on the distance of a periodic motion of the train from a computed
    motion.

    Parameters and errors are those of :func:`jaxhb.stability`; disks without inertia,
    whose deflections do not fall with frequency, are refused too.

    Notes
    -----
    It covers both laws of damping, loss factors and closed loops. It is a computed
    bound and no proof: norms are iterated and multiplied by 1.1, largest row sums are
    estimated and multiplied by 1.5, and sampled largest values, the decay of
    coefficients beyond those computed, and rounding are not enclosed.

    Examples
    --------
    >>> response = jaxhb.solve(jaxhb.load_scene("spur_pair"), rpm=3000.0)
    >>> jaxhb.certify(response).holds
    True
    """
    refuse_tracers("certify", response)
    train = at_speed(train_of(response), float(response.rpm))
    topology = train.topology
    gaps = train.topology.law_index
    problem = problem_at(train, float(response.rpm), listed_harmonic(topology))
    light = [
        repr(topology.disk_names[i])
        for i in np.flatnonzero(~(np.asarray(problem.system.mass) > 0))
    ]
    if light:
        need = "a computed bound needs disks with inertia: give a small one."
        raise ValueError(f"disk {', '.join(light)} has inertia 0, and {need}")
    varying = [
        *topology.meshing,
        *dict.fromkeys(topology.link_names[link] for link, *_ in topology.springs),
    ]
    if varying:
        raise ValueError(
            f"{topology.title}: {', '.join(map(repr, varying))}: no bound is computed"
            " for a stiffness that varies over the mesh period, for transmission"
            " errors, and for play, stages, stops and friction of shafts. Compare the"
            " motion with time integration, jaxhb.shooting_correction."
        )
    computed = np.asarray(response.deflections)[gaps]
    if not len(gaps):
        return LINEAR
    modes = 0.0
    if _leaves_contact(train, computed, gaps):
        modes = mesh_mode_harmonics(train, float(problem.frequency))[0]
    highest = highest_frequency(problem.system) / float(problem.frequency)
    # Powers of two: few sizes, as each has programs of its own.
    low = 1 << int(np.ceil(np.log2(max(FEWEST, 2 * response.harmonics, 3 * modes))))
    low = min(low, MOST)
    deflection = computed
    balance = None
    while True:
        sizes = _sizes(low, highest, problem.load.shape[-1] - 1, len(gaps))
        lin = Linearization(problem, train, deflection, sizes, max(1.0, modes / 3))
        # The theorem on the truncated equation is applied at the response itself,
        # before the motion is refined.
        balance = balance or harmonic_balance(lin, response.harmonics)
        try:
            lin = _refine(lin)
            certificate = bounds_at(lin, train, gaps)
        except NotInverted:
            certificate = without_bounds(lin, train, gaps)
        if certificate.holds:
            stable = attracts(lin, train, certificate)
            certificate = replace(certificate, stable=stable)
        if certificate.holds or 2 * low > MOST or not lin.complete:
            return _of_response(certificate, lin, response, balance)
        low = 2 * low
        deflection = lin.deflection * lin.law.backlash[:, None]


def _leaves_contact(
    train: DriveTrain, deflection: np.ndarray, gaps: np.ndarray
) -> bool:
    """Whether any mesh comes near the knee of its law, within 2 % of its backlash."""
    law = jax.tree.map(lambda a: np.asarray(a)[gaps], law_of(train.meshes))
    count = SAMPLES * max(deflection.shape[1] - 1, 1)
    value = np.abs(fourier.synthesize(deflection, count))
    return bool((value.min(-1) < law.knee + 0.02 * law.backlash).any())


def _refine(lin: Linearization) -> Linearization:
    """The linearisation at the motion to which Newton's method leads on the low
    harmonics: nearer to a true motion less has to be shown.
    """
    size = np.inf
    for _ in range(6):
        corrected = lin.inverse(lin.residual())
        corrected[:, lin.sizes.low + 1 :] = 0
        last = size
        size = lin.largest(corrected).max()
        if not 1e-10 < size < last:
            break
        lin = lin.moved(-corrected[:, : lin.sizes.low + 1])
    return lin


def _sizes(low: int, highest: float, excited: int, meshes: int) -> CertificateSizes:
    """Sizes for ``low`` harmonics, with the ``highest`` natural frequency and the
    highest ``excited`` harmonic over that of the cycle.
    """
    high = max(8 * low, 1 << max(excited - 1, 1).bit_length())
    reach = 1 << max(high + 1, int(np.ceil(2 * highest))).bit_length()
    if reach * meshes**2 > MOST_RECEPTANCES:
        raise ValueError(
            f"the highest natural frequency lies at harmonic {highest:.0f} of the"
            f" cycle, and receptances of {meshes} meshes up to twice of it would take"
            f" {16 * reach * meshes**2 / 2**30:.2g} GiB: ask for a higher speed, or"
            " lump disks that are much lighter than the others."
        )
    if reach > RECEPTANCES:
        raise ValueError(
            f"the highest natural frequency lies at harmonic {highest:.0f} of the"
            f" cycle; the certificate serves up to {RECEPTANCES // 4}: lump disks that"
            " are much lighter than the others."
        )
    return CertificateSizes(
        low=low, high=high, reach=reach, time_steps=min(time_steps_of(low), 4096)
    )


def _of_response(
    certificate: Certificate,
    lin: Linearization,
    response: Response,
    balance: Kantorovich,
) -> Certificate:
    """The certificate of the response: to the bounds of the refined motion the distance
    of the response from it is added.
    """
    certificate = replace(
        certificate, harmonic_balance=balance, harmonics=response.harmonics
    )
    if not certificate.holds:
        return certificate
    count = 64 * lin.sizes.low
    refined = lin.deflection * lin.law.backlash[:, None]
    value = fourier.synthesize(refined, count)
    rate = fourier.synthesize(fourier.derivative(refined, lin.frequency), count)
    law, viscous, contact_damping = backlash.at_samples(
        lin.meshes, fourier.Equidistant(count).synthesize
    )
    force = backlash.mesh_force(law, viscous, contact_damping, value, rate)
    elastic_force = backlash.force(law, value)
    deflections = [response.deflection(name) for name in certificate.meshes]
    forces = [response.force(name) for name in certificate.meshes]
    elastic_forces = [signal.elastic for signal in forces]
    deflection_distance = _distance(deflections, value)
    elastic_distance = _distance(elastic_forces, elastic_force)
    force_distance = _distance(forces, force)
    return replace(
        certificate,
        deflection_bound=certificate.deflection_bound + deflection_distance,
        elastic_bound=certificate.elastic_bound + elastic_distance,
        force_bound=certificate.force_bound + force_distance,
    )


def _distance(signals: Sequence[Signal], values: Array) -> np.ndarray:
    """Distance ``(G,)`` of Signals from samples ``(G, M)`` over the cycle: at any
    instant, as series, and of their extremes, which are read from time samples that may
    miss them.
    """
    series = np.stack(
        [
            fourier.sample(np.asarray(signal.coefficients), values.shape[-1])
            for signal in signals
        ]
    )
    read = np.array([[float(signal.max), -float(signal.min)] for signal in signals])
    between = _between(series)
    missed = (
        np.stack([series.max(-1), -series.min(-1)], axis=-1) + between[:, None] - read
    )
    return _largest(series - values) + np.maximum(missed, 0.0).max(-1)


def _largest(values: np.ndarray) -> np.ndarray:
    """Largest absolute values ``(G,)`` over the cycle of samples ``(G, M)``."""
    return np.abs(values).max(-1) + _between(values)


def _between(values: np.ndarray) -> np.ndarray:
    """Bound ``(G,)`` on the excess of the largest value between two samples over them:
    for a smooth function an eighth of the second difference, at a kink less than a
    half.
    """
    bend = np.roll(values, 1, -1) - 2 * values + np.roll(values, -1, -1)
    return np.abs(bend).max(-1) / 2

"""A certificate: within what distance of a computed motion one of the train lies,
computed (Fridman 2009, ch. 4 and 5).

The theorem (:mod:`jaxhb.certificate.theorem`) is applied at the motion to which
Newton's method leads on more and more harmonics; bounds of the response add how far
that is away.
"""

from dataclasses import replace

import jax
import numpy as np

from jaxhb._jax import refuse_tracers
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
from jaxhb.equations.backlash import law_of
from jaxhb.excitation.torques import listed_harmonic
from jaxhb.floquet.stability import train_of
from jaxhb.linear.mesh_modes import mesh_mode_harmonics
from jaxhb.results.bounds import LINEAR, Certificate
from jaxhb.results.response import Response

# Harmonics in which the linearised equation is solved: twice those of the response,
# thrice those of the tooth modes, within these; doubled until a bound holds.
FEWEST = 32
MOST = 8192
MOST_RECEPTANCES = (
    2**24
)  # numbers of 16 B of them at most, some arrays of which are held at a time
RECEPTANCES = (
    2**18
    # Harmonics of them at most: beyond twice the highest natural frequency they are
    # bounded
)


def certify(response: Response) -> Certificate:
    """Compute a bound on how far a periodic motion of the train is from a computed one.

    Parameters and errors are as of :func:`jaxhb.stability`; disks without inertia,
    whose deflections do not fall with frequency, are refused too.

    Notes
    -----
    Serves both laws of damping, loss factors and closed loops. A computed bound and no
    proof: norms are iterated and taken times 1.1, largest row sums are estimated and
    taken times 1.5, and sampled largest values, the decay of coefficients beyond those
    computed, and rounding are not enclosed.

    Examples
    --------
    >>> found = jaxhb.certify(jaxhb.solve(jaxhb.load_scene("spur_pair"), rpm=3000.0))
    >>> found.holds
    True
    """
    refuse_tracers("certify", response)
    train = train_of(response)
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
    given = np.asarray(response.deflections)[gaps]
    if not len(gaps):
        return LINEAR
    modes = (
        mesh_mode_harmonics(train, float(problem.frequency))[0]
        if _leaves_contact(train, given, gaps)
        else 0.0
    )
    highest = highest_frequency(problem.system) / float(problem.frequency)
    # Powers of two: few sizes, as each has programs of its own.
    low = 1 << int(np.ceil(np.log2(max(FEWEST, 2 * response.harmonics, 3 * modes))))
    low = min(low, MOST)
    deflection = given
    balance = None
    while True:
        sizes = _sizes(low, highest, problem.load.shape[-1] - 1, len(gaps))
        lin = Linearization(problem, train, deflection, sizes, max(1.0, modes / 3))
        # The theorem on the truncated equation is applied at the response itself,
        # before the motion is refined.
        balance = balance or harmonic_balance(lin, response.harmonics)
        try:
            lin = _refine(lin)
            found = bounds_at(lin, train, gaps)
        except NotInverted:
            found = without_bounds(lin, train, gaps)
        if found.holds:
            found = replace(found, stable=attracts(lin, train, found))
        if found.holds or 2 * low > MOST or not lin.complete:
            return _of_response(found, lin, response, balance)
        low = 2 * low
        deflection = lin.deflection * lin.law.backlash[:, None]


def _leaves_contact(train, deflection, gaps):
    """Whether any mesh comes near the knee of its law, within 2 % of its backlash."""
    law = jax.tree.map(lambda a: np.asarray(a)[gaps], law_of(train.meshes))
    value = np.abs(
        fourier.synthesize(deflection, SAMPLES * max(deflection.shape[1] - 1, 1))
    )
    return bool((value.min(-1) < law.knee + 0.02 * law.backlash).any())


def _refine(lin):
    """The linearisation at the motion to which Newton's method leads on the low
    harmonics: the nearer to a true one, the less is to be shown.
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


def _sizes(low, highest, excited, meshes):
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


def _of_response(found, lin, response, balance):
    """The certificate of the response: bounds are those of the refined motion, and how
    far what is read of the response lies from that.
    """
    found = replace(found, harmonic_balance=balance, harmonics=response.harmonics)
    if not found.holds:
        return found
    count = 64 * lin.sizes.low
    law = lin.law.expand()
    refined = lin.deflection * lin.law.backlash[:, None]
    value = fourier.synthesize(refined, count)
    rate = fourier.synthesize(fourier.derivative(refined, lin.frequency), count)
    force = backlash.mesh_force(*backlash.at_samples(lin.meshes, None), value, rate)
    forces = [response.force(name) for name in found.meshes]
    return replace(
        found,
        deflection_bound=found.deflection_bound
        + _apart([response.deflection(name) for name in found.meshes], value),
        elastic_bound=found.elastic_bound
        + _apart([signal.elastic for signal in forces], backlash.force(law, value)),
        force_bound=found.force_bound + _apart(forces, force),
    )


def _apart(signals, values):
    """How far Signals are from samples ``(G, M)`` over the cycle, ``(G,)``: at any
    instant, as the series that they are, and by their extremes, which are looked for at
    time samples that may miss them.
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


def _largest(values):
    """``(G,)``: largest absolute values over the cycle of periodic samples ``(G,
    M)``.
    """
    return np.abs(values).max(-1) + _between(values)


def _between(values):
    """``(G,)``: by how much the largest value between two samples can exceed them: for
    a smooth function an eighth of the second difference, at a kink less than a half.
    """
    return (
        np.abs(np.roll(values, 1, -1) - 2 * values + np.roll(values, -1, -1)).max(-1)
        / 2
    )

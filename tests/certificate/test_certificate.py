"""Computed bounds: against closed forms, dense norms, true motions and motions that do
not exist.
"""

import dataclasses
from functools import cache

import jax
import numpy as np
import pytest
from reference_data import method_case, numbers
from tolerances import ALGEBRAIC
from trains import ONE_RADIAN_PER_SECOND, build, one_mass_parts

import jaxhb
from jaxhb._jax import on_host
from jaxhb.balance.problem import problem_at
from jaxhb.certificate import certificate, theorem
from jaxhb.certificate.certificate import certify
from jaxhb.certificate.linearization import Linearization, NotInverted
from jaxhb.equations import backlash, exact_integrals, fourier
from jaxhb.equations.state_space import partition, state_space
from jaxhb.floquet.variational import propagation
from jaxhb.results.bounds import NORM_MARGIN, ROW_SUM_MARGIN, Kantorovich
from jaxhb.train import chain
from jaxhb.train.mesh_parameters import law_meshes, law_of

pytestmark = pytest.mark.slow

WITHIN = 1.6
"""A bound over the true error where the error is mostly that of the truncation, which
the bound adds up exactly.
"""


def parameters():
    case, _ = method_case("A4_hb_one_mass_N4")
    return {key: float(value) for key, value in case.items()}


def one_mass(transition=0.2, **changes):
    return build(
        one_mass_parts(transition=transition, **(parameters() | changes)), reference="a"
    )


@cache
def solved(harmonics, **changes):
    return jaxhb.solve(
        one_mass(**changes),
        rpm=ONE_RADIAN_PER_SECOND,
        harmonics=harmonics,
        integrals="exact",
    )


def linearisation(response, low, high, scale=1.0):
    """The equation of a response with the sizes that a test asks for."""
    problem = problem_at(response.train, float(response.rpm), 8)
    sizes = dataclasses.replace(
        certificate._sizes(low, 2.0, 8, 1), high=high, reach=2 * high
    )
    return Linearization(
        problem, response.train, np.asarray(response.deflections), sizes, scale
    )


@pytest.mark.parametrize(
    "row", method_case("A4_kantorovich_majorant")[1]["rows"], ids=lambda row: row["h0"]
)
def test_case_a4_majorant_radii_and_the_sharp_bound(row):
    params = method_case("A4_kantorovich_majorant")[0]
    case = Kantorovich(float(params["H0"]), float(params["delta0"]), float(row["K"]))
    bounds = [case.bound(n) for n in range(4)]
    expected = [row["h0"], row["radius"], row["uniqueness"], *row["newton_errors"]]
    # The last errors are differences of radii of order 1: exact in the formula, 1e-16
    # of those in the table.
    np.testing.assert_allclose(
        [case.h0, case.radius, case.uniqueness, *bounds],
        numbers(expected),
        rtol=10 * ALGEBRAIC,
    )


def test_the_theorem_fails_above_one_half_and_says_so():
    case = Kantorovich(1.0, 1.0, 0.51)
    assert not case.holds
    assert np.isnan(case.radius)


@pytest.mark.parametrize("harmonics", [8, 32])
def test_one_mass_the_true_motion_lies_within_the_bound_and_hardly_nearer(harmonics):
    response = solved(harmonics)
    bounds = certify(response)
    h = parameters()["h"]
    fine = solved(384)
    count = 2**13
    difference = response.deflection_samples(count) - fine.deflection_samples(count)
    apart = np.abs(difference).max()
    assert bounds.holds
    assert bounds.h0 < 0.5
    assert apart <= bounds.deflection_bound[0] <= WITHIN * apart
    true = float(method_case("A7_true_periodic_one_mass")[1]["x0"])
    l = np.asarray(response.deflections)[0]
    assert abs(l[0].real + 2 * l[1:].sum().real - true) <= bounds.deflection_bound[0]
    assert bounds.harmonic_balance.h0 < 1e-6
    assert bounds.radius < 1e-2 * h
    # The weighted norm of method.md A4.5, nu = 4, bounds more loosely.
    if harmonics > 8:
        radius = float(method_case("A4_certificate_one_mass")[1][f"N{harmonics}"]["r"])
        embedding = np.sqrt(4 * np.pi / np.tanh(4 * np.pi))
        assert bounds.deflection_bound[0] < embedding * radius * h / 5


def test_case_a4_small_gain_numbers():
    _, expected = method_case("A4_small_gain")
    for key, damping in (("b_0p2", 0.2), ("b_3", 3.0)):
        gain = certify(solved(8, b=damping)).small_gain
        np.testing.assert_allclose(gain, float(expected[key]), rtol=ALGEBRAIC)


def test_norms_are_those_of_dense_matrices():
    lin = linearisation(solved(8), 16, 64)
    w = lin.weight[:17]
    columns = fourier.unpack(np.eye(33))[:, None]  # a motion each
    dense = np.array(
        [fourier.pack(w * lin.inverse(lin.apply_gain(x)))[0] for x in columns]
    ).T
    np.testing.assert_allclose(
        theorem._gain_norm(lin, 16), NORM_MARGIN * np.linalg.norm(dense, 2), rtol=0.02
    )
    count = 64
    zone = lin.near_transition(0.01, np.arange(count) / count)
    assert 0 < zone.mean() < 0.5
    from_samples = np.array(
        [fourier.pack(fourier.analyze(row, 16)) for row in np.eye(count) * zone[0]]
    )
    to_samples = np.array(
        [fourier.synthesize(fourier.unpack(row), count) for row in np.eye(33)]
    )
    kernel = to_samples.T @ (dense / np.r_[w, w[1:]][:, None]) @ from_samples.T
    expected = np.abs(kernel).sum(1).max()
    np.testing.assert_allclose(
        theorem._row_sum(lin, zone, count, False), ROW_SUM_MARGIN * expected, rtol=0.02
    )


def test_what_cannot_be_inverted_is_refused_at_once():
    lin = linearisation(solved(8), 128, 256)
    # Slopes that the preconditioner does not know, so large that no Krylov space of so
    # few steps holds the solution.
    lin._share = (
        lin._share + np.random.default_rng(0).normal(size=lin._share.shape) * 1e6
    )
    with pytest.raises(NotInverted):
        theorem.bounds_at(lin, one_mass(), np.array([0]))
    refused = theorem.without_bounds(lin, one_mass(), np.array([0]))
    assert not refused.holds
    assert refused.reason.startswith(
        "the linearised equation could not be inverted well enough: the motion is near"
    )


def test_the_inverse_and_its_adjoint():
    lin = linearisation(solved(8), 16, 64)
    rng = np.random.default_rng(1)
    x, y = (fourier.unpack(rng.normal(size=(1, 129))) for _ in range(2))

    def dot(a, b):
        return fourier.pack(a)[0] @ fourier.pack(b)[0]

    np.testing.assert_allclose(
        dot(y, lin.inverse(x)), dot(lin.inverse_transposed(y), x), rtol=1e-6
    )
    x[:, 17:] = 0
    again = lin.inverse(x)[:, :17]
    forward = again + lin.apply_gain(lin.times_share(again))[:, :17]
    np.testing.assert_allclose(forward, x[:, :17], rtol=0, atol=1e-6)


def test_a_singular_derivative_is_refused():
    """Method.md A4.2 (i): a motion inside the transition whose slopes 1 + a cos 2t are
    in parametric resonance.
    """
    a = 0.200109342148869
    b = 0.1
    slopes = (0.05 / 0.7, 1 / 0.7)
    h = 2.0
    c = slopes[1]
    eps = 0.05
    kappa = (c - eps * c) / (0.2 * h)
    x = np.zeros(5, complex)
    x[0] = 0.4 * h + (1 - eps * c) / kappa
    x[2] = a / 2 / kappa
    law = backlash.Law(
        stiffness=np.array([c]),
        epsilon=np.array([eps]),
        transition=np.array([0.2]),
        backlash=np.array([h]),
    )
    values = fourier.synthesize(x[None], 64)
    assert (np.abs(values) > law.gap).all()
    assert (np.abs(values) < law.knee).all()
    n = np.arange(5)
    q = (-(n**2) + 1j * b * n) * x + fourier.analyze(backlash.force(law, values), 4)[0]
    parts = one_mass_parts(m=1.0, b=b, c=c, eps=eps, h=h, q0=q[0].real, q1=0.0)[:-2]
    rows = [(float(k), 2 * q[k].real, 2 * q[k].imag) for k in range(1, 5) if abs(q[k])]
    for name, sign in (("a", 1), ("b", -1)):
        signed = [(k, sign * u, sign * v) for k, u, v in rows]
        parts.append(jaxhb.Torque(disk=name, mean=sign * q[0].real, harmonics=signed))
    train = build(parts, reference="a")
    base = jaxhb.solve(train, rpm=ONE_RADIAN_PER_SECOND, harmonics=8)
    singular = dataclasses.replace(
        base, deflections=fourier.resize(x[None], 8), status=np.array(0)
    )
    lin = linearisation(singular, 32, 256)
    assert np.abs(lin.residual()).max() < 1e-9  # a motion it is
    bounds = theorem.bounds_at(lin, train, np.array([0]))
    assert not bounds.holds


def pair(damping=3e3, damping_law="contact", loss=0.0):
    """Two gears with shafts: separated teeth, damping in contact."""
    return jaxhb.build(
        [
            jaxhb.Disk(name="engine", inertia=0.5),
            jaxhb.Disk(name="a", inertia=0.02, radius=0.05),
            jaxhb.Disk(name="b", inertia=0.06, radius=0.08, damping=0.3),
            jaxhb.Shaft(
                between=("engine", "a"), stiffness=4e4, damping=0.5, loss_factor=loss
            ),
            jaxhb.Mesh(
                between=("a", "b"),
                stiffness=2e8,
                damping=damping,
                damping_law=damping_law,
                backlash=1e-4,
                transition=0.1,
            ),
            jaxhb.Torque(
                disk="engine",
                mean=80.0,
                harmonics=[(2.0, 1500.0, 0.0), (4.0, 0.0, 300.0)],
            ),
            jaxhb.Load(disk="b"),
        ],
        reference="engine",
    )


def forces(response, count=2**14):
    """Tooth forces of the law along the motion."""
    train = response.train
    deflection = np.asarray(response.deflections)
    frequency = response.topology.cycle_frequency(float(response.rpm))
    value = fourier.synthesize(deflection, count)
    rate = fourier.synthesize(fourier.derivative(deflection, frequency), count)
    law = jax.tree.map(np.asarray, law_of(train.meshes)).expand()
    gated = np.array([law == "contact" for law in train.topology.mesh_damping_law])
    damping = np.asarray(train.meshes.damping)
    force = backlash.mesh_force(law, damping[:, None], gated[:, None], value, rate)
    return value, force


LAWS = {
    "contact": {},
    "always": {"damping_law": "always"},
    "loss": {"loss": 0.02},
    "strong": {"damping": 3e4},
}


def finely(response):
    """The same motion with many more harmonics."""
    return jaxhb.solve(
        response.train, rpm=float(response.rpm), harmonics=1536, start=response
    )


def coarse_and_fine(train, rpm):
    response = jaxhb.solve(train, rpm=rpm)
    return response, finely(response)


@pytest.mark.parametrize("changes", LAWS.values(), ids=LAWS)
def test_bounds_hold_for_both_laws_of_damping_and_for_loss_factors(changes):
    train = pair(**changes)
    # Most of its error is that of the truncation.
    response = jaxhb.solve(train, rpm=1500.0, harmonics=192)
    assert response.mesh("a", "b").separated_fraction > 0
    bounds = certify(response)
    assert bounds.holds, bounds.reason
    fine = finely(response)
    value, force = forces(response)
    true_value, true_force = forces(fine)
    apart = np.abs(value - true_value).max()
    off = np.abs(force - true_force).max()
    assert apart <= bounds.deflection_bound[0] <= WITHIN * apart
    assert off <= bounds.force_bound[0] <= WITHIN * off


@pytest.mark.parametrize(
    "solutions",
    [
        lambda: (solved(32), solved(384)),
        lambda: coarse_and_fine(pair(), 1500.0),
        lambda: coarse_and_fine(jaxhb.load_scene("engine_with_damper"), 2300.0),
    ],
    ids=["one mass", "pair", "engine"],
)
def test_whatever_is_read_of_a_response_lies_within_the_bound(solutions):
    """Beside the law along a solution with many more harmonics: forces are read as
    series, and extremes at samples.
    """
    response, fine = solutions()
    train = response.train
    bounds = certify(response)
    count = 2**16
    law = jax.tree.map(np.asarray, law_of(train.meshes)).expand()
    # The law has no meaning for meshes without backlash, which have no bound.
    with np.errstate(invalid="ignore"):
        deflections, true_forces = forces(fine, count)
        elastic = backlash.force(law, deflections)
    for place, name in enumerate(bounds.meshes):
        index = train.topology.mesh_names.index(name)
        force = response.force(name)
        for signal, values, bound in (
            (response.deflection(name), deflections, bounds.deflection_bound),
            (force, true_forces, bounds.force_bound),
            (force.elastic, elastic, bounds.elastic_bound),
        ):
            true = values[index]
            off = {}
            low = true.min()
            high = true.max()
            off["extremes"] = max(
                abs(signal.max - high),
                abs(signal.min - low),
                abs(signal.peak - abs(true).max()),
            )
            off["half peak-to-peak"] = abs(signal.half_peak_to_peak - (high - low) / 2)
            off["mean and rms"] = max(
                abs(signal.mean - true.mean()),
                abs(signal.rms - np.sqrt((true**2).mean())),
            )
            off["samples"] = np.abs(signal.samples(count) - true).max()
            few = true[:: count // 4096]
            off["few samples"] = np.abs(signal.samples(4096) - few).max()
            assert max(off.values()) <= bound[place] * (1 + 1e-6), (name, off)
            assert bound[place] <= 4 * off["samples"] + 1e-9 * abs(true).max()


def test_gear_train_is_certified_where_its_teeth_begin_to_separate():
    response = jaxhb.solve(jaxhb.load_scene("gear_train_30"), rpm=1200.0)
    bounds = certify(response)
    assert bounds.holds
    largest = np.array([response.force(name).max for name in bounds.meshes])
    assert (bounds.force_bound < 0.02 * largest).all()


def test_what_has_no_backlash_needs_no_certificate():
    bounds = certify(jaxhb.solve(jaxhb.load_scene("six_cylinder_diesel"), rpm=1500.0))
    assert bounds.holds
    assert "linear" in str(bounds)


def test_a_disk_without_inertia_is_refused_by_name_and_a_sweep():
    train = one_mass()
    disks = dataclasses.replace(train.disks, inertia=np.array([0.0, 2.0]))
    train = dataclasses.replace(train, disks=disks)
    response = dataclasses.replace(solved(8), train=train)
    with pytest.raises(ValueError, match="disk 'a' has inertia 0"):
        certify(response)
    with pytest.raises(ValueError, match="sweep"):
        certify(jaxhb.solve_speeds(one_mass(), rpm=[ONE_RADIAN_PER_SECOND] * 2))


def test_what_an_impulse_leaves_is_what_the_linearised_equation_answers():
    """The answer to a smooth periodic integral of (engagement - 1), in harmonics and
    from what impulses leave.
    """
    response = solved(8)
    lin = linearisation(response, 64, 256)
    system, meshes = on_host(
        (chain.assemble(response.train), law_meshes(response.train))
    )
    space = state_space(
        system, meshes, 1.0, partition(system, meshes, ("a", "b"), ("a|b",))
    )
    deflection = np.asarray(response.deflections)
    switching = exact_integrals.switching_times(meshes.law, deflection)
    times = np.concatenate([switching, np.arange(1, 4096) / 4096])
    way = propagation(space, meshes, deflection, 1.0, np.unique(times))
    wave = np.zeros((1, 65), complex)
    wave[0, 3] = 0.5  # cos 3t
    answer = -lin.inverse(np.pad(lin.apply_gain(wave), ((0, 0), (0, 192))))
    u = np.cos(3 * 2 * np.pi * way.share)
    left = np.trapezoid(
        way.end_state[..., 0] * u[:, None], 2 * np.pi * way.share, axis=0
    )
    begin = np.linalg.lstsq(np.eye(len(left)) - way.matrix, left, rcond=1e-9)[0]
    expected = answer[0, 0].real + 2 * answer[0, 1:].sum().real
    np.testing.assert_allclose((way.deflection[0] @ begin)[0], expected, rtol=1e-5)


LEVELS = (12, 17, 24, 34, 48, 68, 96)
FINE = 256
SAMPLES = 2**14
"""Aliases of force and stiffness are their coefficients at this harmonic, 1e-8 of the
stiffness.
"""

RATES = {"deflection": 4.5, "law": 4.5, "force": 2.5, "stiffness": 1.5}
"""``law``: the force of the law at the computed deflection, as wrong as that;
``force``, ``stiffness``: their series of N harmonics. Within 0.3 over three octaves:
the coefficients of several crossings beat.
"""


def truncated():
    """A function that solves the equations truncated to some harmonics, and gives the
    deflections in m.
    """
    first = jaxhb.check(solved(32))
    train = first.train
    problem = problem_at(train, ONE_RADIAN_PER_SECOND, 8)
    sizes = certificate._sizes(FINE, 4.0, 8, 1)
    at = Linearization(problem, train, np.asarray(first.deflections), sizes, 1.0)

    def truncate(coefficients, harmonics):
        return fourier.resize(fourier.resize(coefficients, harmonics), FINE)

    def solve(harmonics):
        lin = at.moved(truncate(at.deflection, harmonics) - at.deflection)
        for _ in range(8):
            galerkin = lin.galerkin(harmonics)
            residual = truncate(galerkin.residual(), harmonics)
            change = truncate(galerkin.inverse(residual), harmonics)
            lin = lin.moved(-change)
            if np.abs(change).max() < 1e-12:
                deflection = fourier.resize(lin.deflection, harmonics)
                return deflection * lin.law.backlash[:, None]
        raise AssertionError(
            f"{harmonics} harmonics: {np.abs(change).max():.1e} in the last step"
        )

    return solve


def quantities(train, deflection):
    """Coefficients that converge, each to its own number of harmonics."""
    law = jax.tree.map(np.asarray, law_meshes(train).law).expand()
    count = deflection.shape[1]
    value = fourier.synthesize(deflection, SAMPLES)
    force = fourier.analyze(backlash.force(law, value), SAMPLES // 2)
    stiffness = fourier.analyze(backlash.slope(law, value), SAMPLES // 2)
    return {
        "deflection": deflection,
        "law": force,
        "force": force[:, :count],
        "stiffness": stiffness[:, :count],
    }


def test_galerkins_method_converges_with_the_rates_of_theory():
    """Where teeth pass the knots of their law the slope of the stiffness jumps, so that
    coefficients fall (docs/theory A6) as ``c ~ n^-2``, ``f ~ n^-3``, ``x ~ n^-5``. What
    N harmonics omit of ``n^-p`` has the root mean square ``~ N^-(p - 1/2)``, over the
    cycle, against FINE harmonics.
    """
    train = one_mass()
    solve = truncated()
    true = quantities(train, solve(FINE))
    levels = [quantities(train, solve(n)) for n in LEVELS]
    for key, rate in RATES.items():
        wide = [fourier.resize(level[key], true[key].shape[-1] - 1) for level in levels]
        errors = [np.linalg.norm(fourier.pack(level - true[key])) for level in wide]
        slope = -np.polyfit(np.log(LEVELS), np.log(errors), 1)[0]
        assert abs(slope - rate) < 0.3, (key, errors, slope)

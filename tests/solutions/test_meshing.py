"""Teeth whose stiffness varies over the mesh period, with transmission errors: against
published motions, a closed form, and integration by scipy of equations written out
here.
"""

import dataclasses
from functools import cache

import jax
import numpy as np
import pytest
from reference_data import reference
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from tolerances import ALGEBRAIC, GRADIENT, PATHS, RESIDUAL

import jaxhb
from jaxhb.balance.plan import Request
from jaxhb.elements.meshing import contact_orders, standard_stiffness, table_orders
from jaxhb.report.answer import Answer
from jaxhb.report.text.cases import solve_text
from jaxhb.results.steady import orbit_state
from jaxhb.solutions import planning

HALF = 1e-4  # m, half the backlash
NATURAL = 500.0  # rad/s, of the mean stiffness
TEETH = 20  # of both gears
CASES = reference("varying_mesh_stiffness")["cases"]
# Numbers of the idler, and steps of differences between what is rounded and what bends.
STEPS = {
    "a|b.stiffness_orders": 3e-3,
    "a|b.transmission_error": 1e-4,
    "a|b.phase": 3e-4,
    "a|b.first_gear_error": 1e-2,
    "c|b.phase": 3e-3,
}


def pair(case, backlash=True, varying=True):
    """The pair of the published cases, one cycle a mesh period, its law nearly theirs;
    and its speed at Omega = 1.
    """
    inertia = 1.0
    radius = 0.5
    mass = inertia / radius**2 / 2
    gears = [
        jaxhb.Disk(name=name, inertia=inertia, radius=radius, teeth=TEETH)
        for name in "ab"
    ]
    variation = enumerate(case["kappa"], 1)
    errors = enumerate(case["F"], 1)
    mesh = jaxhb.Mesh(
        between=("a", "b"),
        stiffness=mass * NATURAL**2,
        damping=2 * case["zeta"] * mass * NATURAL,
        damping_law="always",
        stiffness_orders=[
            (k, share, 0.0) for k, share in variation if share and varying
        ],
        transmission_error=[(k, HALF * size, 0.0) for k, size in errors if size],
    )
    if backlash:
        mesh = dataclasses.replace(
            mesh, backlash=2 * HALF, epsilon=1e-5, transition=0.01
        )
    torque = jaxhb.Torque(disk="a", mean=case["Fm"] * HALF * mass * NATURAL**2 * radius)
    train = jaxhb.build(
        [*gears, mesh, torque, jaxhb.Load(disk="b")],
        reference="a",
        revolutions_per_cycle=1 / TEETH,
    )
    return train, NATURAL * 60 / (2 * np.pi) / TEETH


def idler():
    """Three gears, the second an idler, with errors of teeth and of a gear, and
    phases.
    """
    gears = [jaxhb.Disk(name=n, inertia=j, radius=r, teeth=z) for n, j, r, z in GEARS]
    driving = jaxhb.Mesh(
        between=("a", "b"),
        stiffness=2e8,
        damping=2e3,
        damping_law="always",
        backlash=2 * HALF,
        epsilon=1e-3,
        transition=0.04,
        stiffness_orders=[(1, 0.2, 0.1), (2, 0.0, -0.05)],
        transmission_error=[(1, 4e-6, 2e-6)],
        first_gear_error=[(1, 6e-6, 0.0)],
        phase=40.0,
    )
    driven = dataclasses.replace(
        driving,
        between=("c", "b"),
        stiffness_orders=[(1, 0.15, 0.0)],
        transmission_error=(),
        first_gear_error=(),
        phase=-70.0,
    )
    torque = jaxhb.Torque(disk="a", mean=60.0, harmonics=[(1.0, 150.0, 40.0)])
    ends = [jaxhb.Load(disk="c"), jaxhb.Ground(disk="a", stiffness=100.0)]
    return jaxhb.build(
        [*gears, driving, driven, torque, *ends],
        reference="a",
        revolutions_per_cycle=1,
    )


GEARS = ("a", 0.02, 0.05, 10), ("b", 0.05, 0.1, 20), ("c", 0.01, 0.05, 10)


@cache
def hammering(rpm):
    return jaxhb.solve(idler(), rpm=rpm, harmonics=768, tolerance=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_motions_up_and_down_are_those_published(case):
    train, unit = pair(case)
    for direction in ("up", "down"):
        rows = [row for row in case["rows"] if row["direction"] == direction]
        states = jaxhb.steady_state(
            train, rpm=[row["Omega"] * unit for row in rows], direction=direction
        )
        assert [state.period for state in states] == [row["period"] for row in rows]
        deflections = [state.deflection("a", "b") for state in states]
        extremes = np.array([[x.max, x.min] for x in deflections]) / HALF
        expected = np.array([[row["max"], row["min"]] for row in rows])
        errors = np.abs(extremes - expected).max(axis=1)
        # A share of the largest; the narrow smooth zone of our law leaves 1e-3 of it.
        assert (errors < 0.002 * expected[:, 0]).all()


@pytest.mark.slow
def test_coexisting_motions_are_found():
    train, unit = pair(CASES[0])
    motions = jaxhb.solve_all(train, rpm=0.6 * unit)
    deflections = [motion.response.deflection("a", "b") for motion in motions]
    largest = {round(float(deflection.max) / HALF, 2) for deflection in deflections}
    assert largest >= {1.24, 1.69}


def test_errors_of_a_linear_mesh_are_a_closed_form():
    case = CASES[0]
    train, unit = pair(case, backlash=False, varying=False)
    for response in (
        jaxhb.forced_response(train, rpm=1.3 * unit),
        jaxhb.solve(train, rpm=1.3 * unit),
    ):
        n = np.arange(response.harmonics + 1)
        size = np.zeros(len(n))
        size[1:3] = case["F"][:2]  # the third is 0
        driven = np.where(n > 0, 0.5 * size * (1.3 * n) ** 2, case["Fm"])
        expected = HALF * driven / (1 - (1.3 * n) ** 2 + 2j * case["zeta"] * 1.3 * n)
        np.testing.assert_allclose(
            response.deflections[0], expected, rtol=0, atol=PATHS * HALF
        )
        assert abs(float(response.power_defect)) < PATHS


def test_a_held_flank_and_no_backlash_deflect_alike():
    train, unit = pair(CASES[0], varying=False)
    linear, _ = pair(CASES[0], backlash=False, varying=False)
    on_flank = jaxhb.solve(train, rpm=1.7 * unit)
    assert on_flank.steps == 0
    flank = on_flank.deflections[0]
    free = jaxhb.solve(linear, rpm=1.7 * unit).deflections[0]
    shift = (1 - 1e-5) * HALF
    np.testing.assert_allclose(flank[0].real - free[0].real, shift, rtol=ALGEBRAIC)
    np.testing.assert_allclose(flank[1:], free[1:], rtol=0, atol=ALGEBRAIC * HALF)


@pytest.mark.slow
def test_parametric_instability_begins_where_integration_says():
    case = CASES[0] | {"F": []}
    train, unit = pair(case, backlash=False)

    def growth(omega):
        return float(jaxhb.stability(jaxhb.solve(train, rpm=omega * unit)).largest) - 1

    def integrated(omega):
        def hill(t, y):
            share = 1 + sum(
                s * np.cos(k * omega * t) for k, s in enumerate(case["kappa"], 1)
            )
            x, v = y.reshape(2, 2)
            return np.concatenate([v, -2 * case["zeta"] * v - share * x])

        solution = solve_ivp(
            hill, (0, 2 * np.pi / omega), np.eye(2).ravel(), rtol=1e-10, atol=1e-12
        )
        monodromy = solution.y[:, -1].reshape(2, 2)
        return np.abs(np.linalg.eigvals(monodromy)).max() - 1

    for low, high in ((1.8, 2.0), (2.0, 2.2)):
        expected = brentq(integrated, low, high, xtol=1e-8)
        assert brentq(growth, low, high, xtol=1e-8) == pytest.approx(expected, rel=1e-6)


def integrated_idler(response, rpm):
    """Deflections ``(2, 513)`` of :func:`idler` over a cycle from the state of a
    response, by its equations along the pitch line.
    """
    omega = 2 * np.pi * rpm / 60
    radius = np.array([r for _, _, r, _ in GEARS])
    mass = np.array([j / r**2 for _, j, r, _ in GEARS])
    turn = 10 * omega  # mesh periods of the first gear
    gap = 0.96 * HALF
    width = 0.08 * HALF  # of the smooth zone

    def meshing(t):
        """Stiffness over the mean, error and its rate."""
        first, second = np.exp(1j * (np.deg2rad([40.0, -70.0]) + turn * t))
        variation = [(0.2 + 0.1j) * first - 0.05j * first**2, 0.15 * second]
        share = 1 + np.array(variation).real
        teeth = (4e-6 + 2e-6j) * first
        runout = 6e-6 * np.exp(1j * omega * t)
        error = np.array([teeth + runout, 0.0])
        error_rate = np.array([1j * turn * teeth + 1j * omega * runout, 0.0])
        return share, error.real, error_rate.real

    def fall(t, y):
        x, v = np.split(y, 2)
        share, error, error_rate = meshing(t)
        l = np.array([x[0] - x[1], x[2] - x[1]]) - error
        rate = np.array([v[0] - v[1], v[2] - v[1]]) - error_rate
        inside = np.clip(np.abs(l) - gap, 0, width)
        beyond = np.maximum(np.abs(l) - gap - width, 0)
        contact = inside**2 / (2 * width) + beyond
        elastic = 1e-3 * l + (1 - 1e-3) * np.sign(l) * contact
        force = 2e8 * share * elastic + 2e3 * rate
        driven = 60 + ((150 + 40j) * np.exp(1j * omega * t)).real
        torque = np.array([driven - 100 * x[0] / 0.05, 0.0, -60.0])
        teeth = [force[0], -force[0] - force[1], force[1]]
        return np.concatenate([v, (torque / 0.05 - teeth) / mass])

    n = np.arange(response.harmonics + 1)
    motion = [
        np.asarray(response.angles) * radius[:, None] * (1j * n * omega) ** k
        for k in (0, 1)
    ]
    begin = np.concatenate(
        [m[:, 0].real + 2 * m[:, 1:].real.sum(axis=1) for m in motion]
    )
    at = 2 * np.pi / omega * np.arange(513) / 512
    y = solve_ivp(
        fall, (0, at[-1]), begin, t_eval=at, rtol=1e-10, atol=1e-14, max_step=at[1]
    ).y
    errors = np.array([meshing(t)[1] for t in at]).T
    return np.array([y[0] - y[1], y[2] - y[1]]) - errors


@pytest.mark.slow
@pytest.mark.parametrize("rpm", [1500.0, 600.0])
def test_two_meshes_with_phases_and_runout_follow_their_equations(rpm):
    response = hammering(rpm)
    assert response
    assert response.mesh("a", "b").separated_fraction > 0.01
    exact = integrated_idler(response, rpm)
    actual = response.deflection_samples(512)
    # The tolerance is that of the force, whose scale is the elastic deflection of the
    # teeth.
    elastic = np.abs(exact).max() - HALF
    np.testing.assert_allclose(actual, exact[:, :-1], rtol=0, atol=0.01 * elastic)
    np.testing.assert_allclose(exact[:, -1], exact[:, 0], rtol=0, atol=0.01 * elastic)


def exact_plan(train, harmonics, **how):
    """A plan at 1500 rpm that solves to rounding."""
    request = Request(harmonics=harmonics, **how)
    (plan,) = planning.plan_speeds(train, np.array([1500.0]), request)
    return dataclasses.replace(plan, residual_tolerance=1e-13)


def solved(train, harmonics, **how):
    plan = exact_plan(train, harmonics, **how)
    return jaxhb.solve(train, rpm=1500.0, plan=plan)


@pytest.mark.slow
def test_whole_train_and_condensed_equation_agree():
    """Solved to rounding: what is compared is the methods, not where they stop."""
    whole = solved(idler(), 80, method="chain")
    condensed = solved(idler(), 80)
    assert whole.residual < RESIDUAL
    assert condensed.residual < RESIDUAL
    for name in (
        "angles",
        "torques",
        "elastic_torques",
        "deflections",
        "forces",
        "elastic_forces",
    ):
        actual = np.asarray(getattr(whole, name))
        expected = np.asarray(getattr(condensed, name))
        scale = np.abs(expected).max(initial=0.0)
        np.testing.assert_allclose(actual, expected, rtol=0, atol=PATHS * scale)


@pytest.mark.slow
def test_shooting_hardly_corrects_exact_integrals():
    correction = jaxhb.shooting_correction(
        jaxhb.solve(idler(), rpm=1500.0, harmonics=256, integrals="exact")
    )
    assert correction.orbit.settled
    assert correction.error < 2e-3


@pytest.mark.slow
def test_gradients_are_those_of_differences():
    """Each number by itself; values, forwards and backwards are one program."""
    train = idler()
    # Differences of short steps show what is left of the equations.
    plan = exact_plan(train, 96, integrals="exact")
    weight = np.random.default_rng(2).normal(size=(2, 39))

    def amplitude(values):
        response = jaxhb.solve(train.replace(values), rpm=1500.0, plan=plan)
        return (response.forces[:, 1:40].real * weight).sum(), response.residual

    @jax.jit
    def linearised(values, along):
        number, push, residual = jax.linearize(amplitude, values, has_aux=True)
        (backwards,) = jax.linear_transpose(push, values)(1.0)
        return number, push(along), backwards, residual

    values = {name: np.asarray(train.value(name)) for name in STEPS}
    for name, step in STEPS.items():
        value = values[name]
        scale = max(np.abs(value).max(), 1e-6)
        direction = np.random.default_rng(3).normal(size=value.shape) * scale
        along = {other: np.zeros_like(number) for other, number in values.items()}
        along[name] = direction
        _, slope, gradients, residual = linearised(values, along)
        assert residual < RESIDUAL
        reverse = np.sum(np.asarray(gradients[name]) * direction)
        ends = [
            float(linearised(values | {name: value + k * step * direction}, along)[0])
            for k in (-2, -1, 1, 2)
        ]
        expected = (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * step)
        np.testing.assert_allclose([slope, reverse], expected, rtol=GRADIENT)


@pytest.mark.slow
def test_a_longer_cycle_has_the_same_motion():
    once = solved(idler(), 80)
    twice = solved(idler().repeated(2), 160)
    assert once.residual < RESIDUAL
    assert twice.residual < RESIDUAL
    np.testing.assert_allclose(
        twice.deflections[:, ::2], once.deflections, rtol=0, atol=1e-6 * HALF
    )
    assert np.abs(twice.deflections[:, 1::2]).max() < 1e-6 * HALF


def test_shorthands_stand_for_a_stiffness_and_its_orders(tmp_path):
    steps = np.arange(2000) / 2000

    def over_period(orders):
        return 1 + sum(
            (complex(re, im) * np.exp(2j * np.pi * k * steps)).real
            for k, re, im in orders
        )

    share = over_period(contact_orders(1.6, 900)) * (0.75 * 1.6 + 0.25)
    # One more pair in contact between 0 and 0.6, with flanks 0.1 wide around both ends
    # (ISO 6336-1: 1.75 and 1).
    np.testing.assert_allclose(
        share[[600, 1600, 0, 1200]], [1.75, 1.0, 1.375, 1.375], atol=2e-3
    )
    mean, orders = table_orders([(0.1, 1e8), (0.3, 3e8), (0.7, 2e8)], 900)
    table = np.interp(
        steps, [-0.3, 0.1, 0.3, 0.7, 1.1], np.array([2.0, 1.0, 3.0, 2.0, 1.0]) * 1e8
    )
    np.testing.assert_allclose(mean * over_period(orders), table, atol=1e-3 * mean)
    # ISO 6336-1, spur gears of 30 and 40 teeth: c' = 0.8 0.975 / (0.04723 + 0.15551 /
    # 30 + 0.25791 / 40), 13.25.
    stiffness = standard_stiffness((30, 40), 0.02, 0.0, 1.0)
    assert stiffness / np.cos(np.deg2rad(20)) ** 2 == pytest.approx(
        13.251 * 0.02 * 1e9, rel=1e-4
    )
    (tmp_path / "teeth.csv").write_text("0.0, 1e8\n0.5, 3e8\n")
    text = jaxhb.elements_text(
        [jaxhb.Disk(name=n, inertia=1.0, radius=0.1, teeth=20) for n in "ab"],
        reference="a",
    )
    mesh = '[[mesh]]\nbetween = ["a", "b"]\nstiffness_table = "teeth.csv"\norders = 1\n'
    (tmp_path / "pair.toml").write_text(text + mesh)
    train = jaxhb.load_scene(tmp_path / "pair.toml")
    assert train.value("a|b.stiffness") == 2e8
    assert train.topology.mesh_stiffness_orders == ((40,),)
    np.testing.assert_allclose(
        train.value("a|b.stiffness_orders"), [[-4 / np.pi**2, 0.0]], atol=ALGEBRAIC
    )


@pytest.mark.slow
def test_whine_transmission_error_and_energy_are_read_of_a_motion():
    response = hammering(1500.0)
    approach = 0.05 * response.angles[0] - 0.1 * response.angles[1]
    error = response.transmission_error("a", "b")
    np.testing.assert_allclose(
        error.coefficients[: len(approach)], approach, rtol=0, atol=PATHS * HALF
    )
    np.testing.assert_allclose(
        response.whine("a", "b", orders=2), 2 * np.abs(response.forces[0, [10, 20]])
    )
    speeds = [impact["speed"] for impact in response.mesh("a", "b").impacts]
    mass = 1 / (0.05**2 / 0.02 + 0.1**2 / 0.05)  # of the two gears alone
    assert response.impact_energy("a", "b") == pytest.approx(
        mass * np.square(speeds).sum() / 2
    )
    assert speeds
    linear = jaxhb.linear_response(response.train, rpm=1500.0)
    answer = Answer(response.train, orbit_state(response), linear, orbit=True)
    assert "Gear whine" in solve_text(answer)

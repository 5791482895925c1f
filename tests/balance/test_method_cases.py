"""The harmonic-balance cases of docs/theory A4 and A6: one mass on a backlash law,
solved as a pair of gears.
"""

from functools import cache, partial

import jax
import numpy as np
import pytest
from differences import tight_plan
from reference_data import complex_numbers, method_case
from tolerances import ALGEBRAIC, PATHS, RESIDUAL
from trains import ONE_RADIAN_PER_SECOND, build, one_mass_parts

import jaxhb
from jaxhb.balance import correction
from jaxhb.balance.newton import solve_reduced
from jaxhb.balance.problem import ActiveMeshes, problem_at, reduced_equation
from jaxhb.equations import backlash, condensation, fourier
from jaxhb.equations.reduced_model import ReducedOrderModel
from jaxhb.equations.state_space import StateSpace, modal_basis
from jaxhb.results.status import Status

SAMPLES = 2**16
"""The cases are exact Galerkin solutions. Sampling errs by Nt^-3: 16 N time samples
give 1e-6, 2^16 give 1e-12.
"""

solver = jax.jit(
    partial(solve_reduced, tolerance=1e-14, max_steps=30), static_argnames="samples"
)
train_of = jax.jit(correction.train_of, static_argnums=2)
nonlinear_force = jax.jit(
    condensation.CondensedEquation.nonlinear_force, static_argnums=3
)
evaluate = jax.jit(condensation.CondensedEquation.residual, static_argnums=2)
reduce = jax.jit(reduced_equation, static_argnums=1)


def parameters(name="A4_hb_one_mass_N4"):
    return {key: float(value) for key, value in method_case(name)[0].items()}


def by_hand(harmonics, numbers):
    """The condensed equation of ``m x'' + b x' + f(x) = q0 + q1 cos t`` written down,
    contact as the linear part.
    """
    n = np.arange(harmonics + 1)
    receptance = 1 / (numbers["c"] - numbers["m"] * n**2 + 1j * numbers["b"] * n)
    load = np.zeros(harmonics + 1)
    load[:2] = numbers["q0"], numbers["q1"] / 2
    law = backlash.Law(
        stiffness=np.array([numbers["c"]]),
        epsilon=np.array([numbers["eps"]]),
        transition=np.array([0.2]),
        backlash=np.array([numbers["h"]]),
    )
    nothing = np.zeros(1)
    linear = (receptance * load)[None]
    return condensation.CondensedEquation(
        linear, receptance[:, None, None], np.array(1.0), law, nothing, nothing > 0
    )


def mass_in_time(numbers):
    """The same mass as ``y' = A y + E phi`` in its mode, for the preconditioner; Omega
    = 1.
    """
    m, b, c = (numbers[name] for name in "mbc")
    s = max(np.sqrt(c / m), 1.0)
    space = StateSpace(
        transition=np.array([[0.0, s], [-c / m / s, -b / m]]),
        forcing=np.array([[0.0], [-1 / np.sqrt(m)]]),
        observation=np.diag([1 / s, 1.0]) / np.sqrt(m),
        coordinates=np.diag([s, 1.0]) * np.sqrt(m),
    )
    basis = np.asarray(modal_basis(space.transition))
    to_modes = np.linalg.inv(basis)
    space = StateSpace(
        to_modes @ space.transition @ basis,
        to_modes @ space.forcing,
        space.observation @ basis,
        to_modes @ space.coordinates,
        in_modes=True,
    )
    return ReducedOrderModel(space, np.zeros((1, 1)), basis, np.zeros((2, 1)))


def solve_by_hand(harmonics, samples):
    """Iterate of the one-mass problem from its linear solution."""
    reduced = by_hand(harmonics, parameters())
    mass = mass_in_time(parameters())
    return solver(
        reduced, train_of(reduced, mass, 256), reduced.linear, samples=samples
    )


@cache
def solution(harmonics):
    """The exact Galerkin solution."""
    return solve_by_hand(harmonics, SAMPLES)


def one_mass(**changes):
    return build(one_mass_parts(**(parameters() | changes)), reference="a")


@pytest.mark.slow
@pytest.mark.parametrize("harmonics", [1, 4, 8])
def test_case_a4_harmonics_of_the_exact_galerkin_solution(harmonics):
    _, expected = method_case(f"A4_hb_one_mass_N{harmonics}")
    iterate = solution(harmonics)
    assert iterate.steps < 12
    np.testing.assert_allclose(
        iterate.x[0], complex_numbers(expected["x"]), rtol=0, atol=ALGEBRAIC
    )


@pytest.mark.slow
def test_sixteen_samples_a_harmonic_err_less_than_the_truncation():
    harmonics = 8
    samples = 128

    def at_start(coefficients):
        return coefficients[0].real + 2 * coefficients[1:].sum().real

    x = solve_by_hand(harmonics, samples).x[0]
    exact = complex_numbers(method_case(f"A4_hb_one_mass_N{harmonics}")[1]["x"])
    true = method_case("A7_true_periodic_one_mass")[1]
    truncation = abs(at_start(exact) - float(true["x0"]))
    sampling = abs(at_start(x) - at_start(exact))
    assert sampling < truncation


def test_pair_of_gears_reduces_to_the_one_mass_equation():
    problem = problem_at(one_mass(), ONE_RADIAN_PER_SECOND, 8)
    reduced, _ = reduce(
        problem, 8, ActiveMeshes(np.ones(1), np.zeros(1, int), np.zeros(1))
    )
    hand = by_hand(8, parameters())
    np.testing.assert_allclose(reduced.receptance, hand.receptance, rtol=ALGEBRAIC)
    np.testing.assert_allclose(
        reduced.linear, hand.linear, rtol=ALGEBRAIC, atol=ALGEBRAIC
    )
    np.testing.assert_allclose(reduced.frequency, 1.0, rtol=ALGEBRAIC)
    l = np.linspace(-0.3, 0.3, 32)[None]
    samples = fourier.Equidistant(32)
    forces = nonlinear_force(reduced, l, l, samples)
    by_formula = nonlinear_force(hand, l, l, samples)
    for actual, expected in zip(forces, by_formula, strict=True):
        np.testing.assert_allclose(actual, expected, rtol=0, atol=ALGEBRAIC)


@pytest.fixture(scope="module")
def pair():
    """Response of the one-mass pair with 8 harmonics through the public function."""
    return jaxhb.solve(
        one_mass(),
        rpm=ONE_RADIAN_PER_SECOND,
        harmonics=8,
        start="linear",
        tolerance=0.1,
    )


@pytest.mark.slow
def test_solving_the_pair_of_gears_gives_the_one_mass_solution(pair):
    assert pair.residual < RESIDUAL
    exact = complex_numbers(method_case("A4_hb_one_mass_N8")[1]["x"])
    # Averages between 128 samples: their error is of the order of 1e-5, as that of the
    # samples (docs/theory A6).
    np.testing.assert_allclose(
        pair.deflection("a", "b").coefficients, exact, rtol=0, atol=3e-5
    )
    plan = tight_plan(harmonics=8, active=(0,), flank=(0,), tolerance=0.1)
    sampled = (
        jaxhb.solve(one_mass(), rpm=ONE_RADIAN_PER_SECOND, plan=plan)
        .deflection("a", "b")
        .coefficients
    )
    np.testing.assert_allclose(sampled, exact, rtol=0, atol=3e-5)
    np.testing.assert_allclose(sampled, solve_by_hand(8, 128).x[0], rtol=0, atol=PATHS)


def test_case_a6_permanent_contact_is_the_linear_motion_with_an_offset():
    params, expected = method_case("A6_permanent_contact")
    response = jaxhb.solve(one_mass(q0=float(params["q0"])), rpm=ONE_RADIAN_PER_SECOND)
    assert response.status == Status.CONVERGED
    assert response.steps == 0
    l = np.asarray(response.deflection("a", "b").coefficients)
    np.testing.assert_allclose(l[0], float(expected["x0"]), rtol=ALGEBRAIC)
    np.testing.assert_allclose(l[1], complex_numbers(expected["x1"]), rtol=ALGEBRAIC)
    np.testing.assert_allclose(l[2:], 0.0, rtol=0, atol=ALGEBRAIC)
    np.testing.assert_allclose(
        response.force("a", "b").mean, float(params["q0"]), rtol=ALGEBRAIC
    )


def test_case_a6_forcing_of_the_describing_stiffness_gives_its_amplitude():
    params, expected = method_case("A6_describing_stiffness")
    values = {key: float(value) for key, value in params.items()}
    for label, row in expected.items():
        amplitude = float(label.removeprefix("A="))
        reduced = by_hand(1, values | {"q0": 0.0, "q1": float(row["q1"])})
        # The phase that the linear equation with the describing stiffness gives
        phase = -np.angle(float(row["N"]) - values["m"] + 1j * values["b"])
        x = np.array([[0.0, amplitude / 2 * np.exp(1j * phase)]])
        residual = evaluate(reduced, x, SAMPLES)
        np.testing.assert_allclose(residual, 0.0, rtol=0, atol=1e-11 * amplitude)
        assert fourier.pack(residual).shape == (1, 3)

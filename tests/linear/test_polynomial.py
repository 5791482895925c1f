"""Values of characteristic polynomials against dense determinants, closed forms, exact rationals and differences."""

from fractions import Fraction

import dense
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference_data import complex_numbers, method_case, numbers
from tolerances import ALGEBRAIC, GRADIENT
from trains import branched_parts, build, chain_parts, gearbox_parts

import jaxhb
from jaxhb import Damper, Disk, Shaft
from jaxhb.linear.polynomial import characteristic, damped_approximation, frequency_response


def ring_with_tails(n=5):
    """A closed loop of shafts with dampers and branches on it, one of them massless."""
    parts = [*chain_parts([1.0, 0.4, 2.0, 0.7, 1.5][:n], [50.0, 80.0, 30.0, 20.0][: n - 1], damping=0.3)]
    parts += [Shaft(between=("1", str(n)), stiffness=60.0, damping=0.5, loss_factor=0.05)]
    parts += [Disk(name="s", inertia=0.0), Disk(name="t", inertia=0.3), Shaft(between=("2", "s"), stiffness=9.0)]
    parts += [Shaft(between=("s", "t"), stiffness=7.0, damping=0.2)]
    return [*parts, Damper(name="ring", disk="2", inertia=0.2, stiffness=3.0, damping=0.1)]


CASES = {
    "branched": (branched_parts(), "flywheel"),
    "ring": (ring_with_tails(), None),
    "held ring": ([*ring_with_tails(), jaxhb.Ground(disk="t", stiffness=4.0)], None),
    "gearbox with its loop": (gearbox_parts(), "motor"),
    "two parallel shafts": (
        [*chain_parts([1.0, 2.0, 3.0], [5.0, 6.0]), Shaft(between=("2", "1"), stiffness=2.0, damping=0.1, name="twin")],
        None,
    ),
}


def dense_log_determinant(parts, omega):
    inertia = [p.inertia for p in dense.of_kind(parts, Disk) + dense.of_kind(parts, Damper)]
    sign, logarithm = np.linalg.slogdet(np.stack([dense.dynamic_stiffness(parts, w) for w in omega]))
    return sign, logarithm - np.log([J for J in inertia if J > 0]).sum()


@pytest.mark.parametrize("case", CASES)
def test_values_are_the_dense_determinants(case):
    parts, reference = CASES[case]
    omega = np.array([0.7, 5.0, 31.0, 400.0, 3e4])
    found = characteristic(build(parts, reference=reference), 1j * omega)
    sign, logarithm = dense_log_determinant(parts, omega)
    # condition of determinants: K of 1e8 N/m beside inertia terms that it hides
    np.testing.assert_allclose(found.log_modulus, logarithm, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * np.asarray(found.phase)), sign, rtol=0, atol=1e-9)


def test_values_of_long_uniform_chains_are_those_of_the_closed_form():
    _, expected = method_case("C_large_chain_recurrence")
    for key, wanted in expected["R"].items():
        size, x = (part.split("=")[1] for part in key.split(","))
        train = build(chain_parts([1.0] * int(size), [1.0] * (int(size) - 1)))
        value = characteristic(train, np.array([1j * np.sqrt(float(x))])).value()[0]
        np.testing.assert_allclose(value.real / -float(x), float(wanted), rtol=1e-11)  # of the case


def test_values_of_a_hundred_links_keep_twelve_digits_of_exact_rationals():
    # free chain of 101 disks with unequal dyadic numbers: the continuant of K - omega^2 M in exact arithmetic
    random = np.random.default_rng(5)
    J, k = random.integers(3, 9, 101) / 4, random.integers(5, 50, 100) / 8
    squares = np.array([0.25, 1.5, 4.0, 20.0, 1e4])
    found = characteristic(build(chain_parts(J.tolist(), k.tolist())), 1j * np.sqrt(squares))
    for i, square in enumerate(squares):
        root = Fraction(float(np.sqrt(square))) ** 2  # what the square of the rounded frequency is
        left, last = Fraction(1), Fraction(0)
        for s in range(101):
            held = Fraction(0) if s == 0 else Fraction(k[s - 1])
            diagonal = held + (Fraction(k[s]) if s < 100 else 0) - root * Fraction(J[s])
            left, last = diagonal * left - held**2 * last, left
        for inertia in J:
            left /= Fraction(inertia)
        mantissa = left / Fraction(2) ** int(found.exponent[i])
        np.testing.assert_allclose(found.mantissa[i], complex(float(mantissa)), rtol=ALGEBRAIC, atol=0)


def test_a_chain_whose_determinant_overflows_has_a_modulus_and_a_phase():
    # uniform chain far above its frequencies: |D| = sinh((S) u) / sinh(u) x, 2 cosh u = x - 2
    size, x = 2000, 1e6
    value = characteristic(build(chain_parts([1.0] * size, [1.0] * (size - 1))), np.array([1j * np.sqrt(x)]))
    u = np.arccosh((x - 2) / 2)
    np.testing.assert_allclose(value.log_modulus, size * u - np.log(2 * np.sinh(u)) + np.log(x), rtol=1e-12)
    assert not np.isfinite(value.value()).any()


def test_case_c_receptances_of_three_disks():
    params, expected = method_case("C_receptance_3disc")
    train = build(chain_parts(numbers(params["J"]), numbers(params["c"])))
    hz = np.array([float(params["omega"]) / (2 * np.pi)])
    found = [[frequency_response(train, a, b, hz)[0] for b in "123"] for a in "123"]
    np.testing.assert_allclose(found, numbers(expected["H"]), rtol=1e-12)
    determinant = characteristic(train, 2j * np.pi * hz).value()[0] * numbers(params["J"]).prod()
    np.testing.assert_allclose(determinant, float(expected["det"]), rtol=1e-12)


def test_frequency_responses_are_the_dense_inverse():
    parts = branched_parts()
    train, names, hz = build(parts, reference="flywheel"), dense.disk_names(parts), np.array([3.0, 55.0, 700.0])
    for a, b in ((names[0], names[-1]), (names[2], names[1]), (names[3], names[3])):
        wanted = [
            np.linalg.inv(dense.dynamic_stiffness(parts, 2 * np.pi * f))[names.index(a), names.index(b)] for f in hz
        ]
        np.testing.assert_allclose(frequency_response(train, a, b, hz), wanted, rtol=1e-9)  # condition of the inverse


def test_case_c_damped_approximation_and_its_error():
    params, expected = method_case("C_damped_approximation")
    inertia = 1 / numbers(params["Delta"])
    parts = chain_parts(inertia, numbers(params["c"]))
    shafts = [
        Shaft(between=p.between, stiffness=p.stiffness, damping=r)
        for p, r in zip(dense.of_kind(parts, Shaft), numbers(params["r"]), strict=True)
    ]
    train, omega = build(dense.of_kind(parts, Disk) + shafts), float(params["omega"])
    found = damped_approximation(train, np.array([omega]))
    exact, approximate = (complex_numbers([expected[key]])[0] for key in ("exact", "approx"))
    np.testing.assert_allclose(found.exact.value()[0] / -(omega**2), exact, rtol=ALGEBRAIC)  # R = D / p^2
    np.testing.assert_allclose(found.approximate.value()[0] / -(omega**2), approximate, rtol=ALGEBRAIC)
    np.testing.assert_allclose(found.relative_error, abs(approximate - exact) / abs(exact), rtol=1e-9)


def test_values_are_differentiable_over_frequencies_and_designs():
    parts = ring_with_tails()
    train, omega = build(parts), jnp.array([3.0, 20.0])

    def value(k):
        return characteristic(train.replace({"1|5.stiffness": k}), 1j * omega).log_modulus

    h = 1e-3
    wanted = (np.asarray(value(60.0 + h)) - np.asarray(value(60.0 - h))) / (2 * h)
    np.testing.assert_allclose(jax.jacrev(value)(60.0), wanted, rtol=GRADIENT)
    batch = jax.jit(jax.vmap(value))(jnp.array([60.0, 70.0]))
    np.testing.assert_allclose(batch, np.stack([value(60.0), value(70.0)]), rtol=ALGEBRAIC)


def test_responses_and_the_error_of_the_approximation_have_the_derivatives_of_differences():
    parts = chain_parts([1.0, 2.0, 0.5], [50.0, 80.0], damping=0.2)[:3]
    parts += [
        Shaft(between=("1", "2"), stiffness=50.0, damping=0.3),
        Shaft(between=("2", "3"), stiffness=80.0, damping=0.9),
    ]
    train, hz = build(parts), jnp.array([0.4, 1.1])

    def quantities(k, J):
        changed = train.replace({"1|2.stiffness": k, "3.inertia": J})
        response = frequency_response(changed, "1", "3", hz)
        return jnp.concatenate([jnp.abs(response), damped_approximation(changed, 2 * jnp.pi * hz).relative_error])

    value, h = jax.jit(quantities), 1e-5
    for number, slope in enumerate(jax.jacrev(quantities, (0, 1))(50.0, 0.5)):
        step = np.eye(2)[number] * h * np.array([50.0, 0.5])
        at = np.array([50.0, 0.5])
        wanted = (value(*(at + step)) - value(*(at - step))) / (2 * step.sum())
        np.testing.assert_allclose(slope, wanted, rtol=GRADIENT, atol=1e-9 * np.abs(wanted).max())


def test_loops_beyond_what_the_rules_hold_for_are_refused_by_name():
    two = [*ring_with_tails(), Shaft(between=("2", "4"), stiffness=5.0)]
    with pytest.raises(jaxhb.SceneError, match="close 2 loops"):
        characteristic(build(two), np.array([1j]))
    with pytest.raises(jaxhb.SceneError, match="closes a loop, and responses"):
        frequency_response(build(ring_with_tails()), "1", "2", np.array([1.0]))

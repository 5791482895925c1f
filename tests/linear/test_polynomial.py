"""Values of characteristic polynomials against dense determinants, closed forms, exact
rationals and differences.
"""

from fractions import Fraction

import dense
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from differences import check_derivative
from reference_data import complex_numbers, method_case, numbers
from tolerances import ALGEBRAIC
from trains import branched_parts, build, chain_parts, gearbox_parts

import jaxhb
from jaxhb import Damper, Disk, Shaft
from jaxhb.linear.forced import frequency_response
from jaxhb.linear.polynomial import characteristic, damped_approximation


def ring_with_tails():
    """A closed loop of shafts with dampers and branches on it, one of them massless."""
    return [
        *chain_parts([1.0, 0.4, 2.0, 0.7, 1.5], [50.0, 80.0, 30.0, 20.0], damping=0.3),
        Shaft(between=("1", "5"), stiffness=60.0, damping=0.5, loss_factor=0.05),
        Disk(name="s", inertia=0.0),
        Disk(name="t", inertia=0.3),
        Shaft(between=("2", "s"), stiffness=9.0),
        Shaft(between=("s", "t"), stiffness=7.0, damping=0.2),
        Damper(name="ring", disk="2", inertia=0.2, stiffness=3.0, damping=0.1),
    ]


CASES = {
    "branched": (branched_parts(), "flywheel"),
    "ring": (ring_with_tails(), None),
    "held ring": ([*ring_with_tails(), jaxhb.Ground(disk="t", stiffness=4.0)], None),
    "two loops": (
        [*ring_with_tails(), Shaft(between=("2", "4"), stiffness=5.0)],
        None,
    ),
    "gearbox with its loop": (gearbox_parts(), "motor"),
    "two parallel shafts": (
        [
            *chain_parts([1.0, 2.0, 3.0], [5.0, 6.0]),
            Shaft(between=("2", "1"), stiffness=2.0, damping=0.1, name="twin"),
        ],
        None,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", [case for case in CASES if case not in ("ring", "two loops")]
)
def test_values_are_the_dense_determinants(case):
    parts, reference = CASES[case]
    omega = np.array([0.7, 5.0, 31.0, 400.0, 3e4])
    polynomial = characteristic(build(parts, reference=reference), 1j * omega)
    masses = dense.of_kind(parts, Disk) + dense.of_kind(parts, Damper)
    inertia = [mass.inertia for mass in masses if mass.inertia > 0]
    matrices = np.stack([dense.dynamic_stiffness(parts, w) for w in omega])
    sign, logarithm = np.linalg.slogdet(matrices)
    logarithm -= np.log(inertia).sum()
    # Condition of determinants: K of 1e8 N/m beside inertia terms that it hides.
    np.testing.assert_allclose(polynomial.log_modulus, logarithm, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        np.exp(1j * np.asarray(polynomial.phase)), sign, rtol=0, atol=1e-9
    )


def continuant(J, k, square):
    """det(K - omega^2 M) / prod J of a free chain in exact arithmetic."""
    now = Fraction(1)
    last = Fraction(0)
    for place, inertia in enumerate(J):
        before = Fraction(0) if place == 0 else Fraction(k[place - 1])
        after = Fraction(k[place]) if place < len(k) else 0
        diagonal = before + after - square * Fraction(inertia)
        following = (diagonal * now - before**2 * last) / Fraction(inertia)
        last = now / Fraction(inertia)
        now = following
    return now


def test_values_of_a_hundred_links_keep_twelve_digits_beside_roots_too():
    # A free chain of 101 disks with unequal dyadic numbers, in exact rationals.
    random = np.random.default_rng(5)
    J = random.integers(3, 9, 101) / 4
    k = random.integers(5, 50, 100) / 8
    train = build(chain_parts(J.tolist(), k.tolist()))
    roots = 2 * np.pi * jaxhb.natural_frequencies(train).frequencies_hz[[1, 40, 99]]
    beside = [roots * (1 + near) for near in (0.0, 1e-6, 1e-12)]
    omega = np.concatenate([[0.5, 1.25, 2.0, 4.5, 100.0], *beside])
    polynomial = characteristic(train, 1j * omega)
    for i, frequency in enumerate(omega):
        exact = continuant(J, k, Fraction(frequency) ** 2)
        mantissa = exact / Fraction(2) ** int(polynomial.exponent[i])
        np.testing.assert_allclose(
            polynomial.mantissa[i], complex(float(mantissa)), rtol=ALGEBRAIC, atol=0
        )


@pytest.mark.slow
def test_a_closed_loop_keeps_its_digits_beside_a_double_root():
    # A uniform ring of 40: det(K + x) = 2 T_40(1 + x/2) - 2, near a double root the
    # square of the distance.
    size = 40
    train = build(
        [
            *chain_parts([1.0] * size, [1.0] * (size - 1)),
            Shaft(between=("1", str(size)), stiffness=1.0),
        ]
    )
    omega = 2 * np.sin(np.pi * 7 / size) * (1 + np.array([1e-3, 1e-5, 1e-7]))
    values = characteristic(train, 1j * omega).value().real
    for frequency, number in zip(omega, values, strict=True):
        cosine = 1 - Fraction(frequency) ** 2 / 2
        now = cosine
        last = Fraction(1)
        for _ in range(size - 1):
            following = 2 * cosine * now - last
            last = now
            now = following
        np.testing.assert_allclose(number, float(2 * now - 2), rtol=ALGEBRAIC, atol=0)


@pytest.mark.slow
def test_a_chain_whose_determinant_overflows_has_a_modulus_and_a_phase():
    # A uniform chain far above its frequencies: |D| = sinh((S) u) / sinh(u) x,
    # 2 cosh u = x - 2.
    size = 100
    x = 1e6
    value = characteristic(
        build(chain_parts([1.0] * size, [1.0] * (size - 1))),
        np.array([1j * np.sqrt(x)]),
    )
    u = np.arccosh((x - 2) / 2)
    np.testing.assert_allclose(
        value.log_modulus, size * u - np.log(2 * np.sinh(u)) + np.log(x), rtol=1e-12
    )
    assert not np.isfinite(value.value()).any()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "a", "b"),
    [
        ("branched", 3, 3),
        ("ring", 0, 2),  # two ways round the loop
        ("held ring", 6, 3),  # from the end of a branch to the other side of the loop
        ("two loops", 2, 6),
        ("gearbox with its loop", 0, -1),
    ],
)
def test_frequency_responses_are_the_dense_inverse(case, a, b):
    parts, reference = CASES[case]
    names = dense.disk_names(parts)
    hz = np.array([0.11, 3.0, 55.0, 700.0])
    matrices = [dense.dynamic_stiffness(parts, 2 * np.pi * f) for f in hz]
    expected = np.linalg.inv(np.stack(matrices))[:, a, b]
    train = build(parts, reference=reference)
    response = frequency_response(train, names[a], names[b], hz)
    # The tolerance is the condition of the inverse.
    np.testing.assert_allclose(response, expected, rtol=1e-9)


TEN = np.array([10.0]) / (2 * np.pi)
"""Hz of 10 rad/s."""
TUNED = chain_parts([2.0, 3.0, 1.0], [70.0, 100.0])
"""Where disk 2 rests disk 3 is at resonance with 10 rad/s, the whole train is not."""


@pytest.mark.parametrize("at", ["1", "2", "3"])
def test_a_frequency_response_keeps_its_digits_where_a_branch_is_tuned(at):
    expected = np.linalg.inv(dense.dynamic_stiffness(TUNED, 10.0))[int(at) - 1]
    train = build(TUNED)
    response = [frequency_response(train, disk, at, TEN)[0] for disk in "123"]
    np.testing.assert_allclose(response, expected, rtol=0, atol=1e-15)


RING_AT_TEN = [
    *chain_parts([1.0] * 3, [100 / 3] * 2),
    Shaft(between=("3", "1"), stiffness=100 / 3),
]


@pytest.mark.parametrize("parts", [chain_parts([2.0] * 2, [100.0]), RING_AT_TEN])
def test_there_is_no_frequency_response_at_an_undamped_resonance(parts):
    hz = np.concatenate([0.9 * TEN, TEN, np.nextafter(TEN, 0), 1.1 * TEN])
    response = frequency_response(build(parts), "1", "2", hz)
    assert np.isnan(response).tolist() == [False, True, True, False]


@pytest.mark.slow
def test_case_c_damped_approximation_and_its_error():
    params, expected = method_case("C_damped_approximation")
    inertia = 1 / numbers(params["Delta"])
    parts = chain_parts(inertia, numbers(params["c"]))
    undamped = zip(dense.of_kind(parts, Shaft), numbers(params["r"]), strict=True)
    shafts = [
        Shaft(between=shaft.between, stiffness=shaft.stiffness, damping=damping)
        for shaft, damping in undamped
    ]
    train = build(dense.of_kind(parts, Disk) + shafts)
    omega = float(params["omega"])
    approximation = damped_approximation(train, np.array([omega]))
    exact, approximate = (
        complex_numbers([expected[key]])[0] for key in ("exact", "approx")
    )
    # R = D / p^2.
    np.testing.assert_allclose(
        approximation.exact.value()[0] / -(omega**2), exact, rtol=ALGEBRAIC
    )
    np.testing.assert_allclose(
        approximation.approximate.value()[0] / -(omega**2), approximate, rtol=ALGEBRAIC
    )
    np.testing.assert_allclose(
        approximation.relative_error, abs(approximate - exact) / abs(exact), rtol=1e-9
    )


@pytest.mark.slow
def test_values_responses_and_errors_have_the_derivatives_of_differences():
    keys = [
        "1|5.stiffness",
        "1|5.loss_factor",
        "s|t.damping",
        "3.inertia",
        "ring.inertia",
        "ring.stiffness",
    ]
    train = build(ring_with_tails())

    def value(numbers):
        changed = train.replace(dict(zip(keys, numbers[:-1], strict=True)))
        omega = jnp.array([3.0, 1.0]) * numbers[-1]
        polynomial = characteristic(changed, 1j * omega)
        response = jnp.abs(frequency_response(changed, "1", "3", omega / (2 * jnp.pi)))
        error = damped_approximation(changed, omega).relative_error
        return jnp.concatenate(
            [polynomial.log_modulus, polynomial.phase, response, error]
        )

    check_derivative(
        value, [*(float(train.value(key)) for key in keys), 20.0], step=2e-4
    )


@pytest.mark.slow
def test_derivatives_beside_a_root_are_those_of_two_disks():
    # D = p^2 (p^2 + k (1/J1 + 1/J2)): linear in k, and D / p^2 has a root at
    # p = i omega.
    train = build(chain_parts([2.0, 3.0], [120.0]))
    omega = 10.0 * (1 + 1e-9)

    def value(k, w):
        changed = train.replace({"1|2.stiffness": k})
        return characteristic(changed, 1j * jnp.array([w])).value().real[0]

    slopes = jax.jit(jax.grad(value, (0, 1)))(120.0, omega)
    # D = omega^4 - omega^2 k 5/6.
    expected = (-(omega**2) * 5 / 6, 4 * omega**3 - 2 * omega * 100.0)
    np.testing.assert_allclose(slopes, expected, rtol=ALGEBRAIC)


def test_loops_beyond_those_of_the_rules_are_refused_by_name():
    two, _ = CASES["two loops"]
    with pytest.raises(jaxhb.SceneError, match="close 2 loops"):
        characteristic(build(two), np.array([1j]))

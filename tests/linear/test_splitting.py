"""Exact coefficients against the reference's rationals and the source's rule for
branches, as corrected.

``k_i = c_i + r_i p``; the polynomial R of a piece is ``det / prod I``, of a free tree
over p^2. Row 2 of table 1 of the source's chapter 3, a branch 5-6 at mass 3 of a chain
1-4, must read (docs/theory C2)

    R_12 R_36 - gamma_23 R_1 R_4 R_56(3) - gamma_25 R_1 R_6 R_34(3),
    gamma_ij = k_i k_j / I_3^2;  printed: gamma_35.
"""

from fractions import Fraction

import numpy as np
import pytest
from reference_data import method_case
from tolerances import ALGEBRAIC
from trains import build, chain_parts, gearbox_parts

import jaxhb
from jaxhb import Disk, Shaft
from jaxhb.linear.polynomial import characteristic, characteristic_coefficients

CHAIN = {i: (i, i + 1) for i in range(1, 5)}
BRANCHED = {1: (1, 2), 2: (2, 3), 3: (3, 4), 4: (4, 5), 5: (3, 6), 6: (6, 7)}
RING = {1: (1, 2), 2: (2, 3), 3: (3, 4), 4: (4, 1)}
REFERENCE = {
    "C_chain_R14": (CHAIN, "coeffs"),
    "C_branched_R16": (BRANCHED, "coeffs"),
    "C_ring_R14": (RING, "coeffs_damped"),
}
POINTS = [Fraction(n, 2) for n in range(1, 16)]
"""Polynomials of degree 14 and less that are equal at these p are equal; K + p B + p^2
M is positive definite.
"""


def inertia(mass):
    """Inertia of a mass; ``-mass`` is a second mass as heavy."""
    return Fraction(abs(mass) + 1, 2)


def spring(link, p):
    """k of a link, c_i = 2i+1 and r_i = i/10."""
    return 2 * link + 1 + Fraction(link, 10) * p


def piece(ends, p, held=()):
    """R of a piece of some links at p, by elimination; 1 of none. Masses ``held`` do
    not move.
    """
    masses = {mass for pair in ends.values() for mass in pair}
    free = sorted(masses - set(held))
    rows = {
        a: {b: p**2 * inertia(a) if a == b else Fraction(0) for b in free} for a in free
    }
    for link, pair in ends.items():
        for a in pair:
            for b in pair:
                if a in rows and b in rows:
                    rows[a][b] += spring(link, p) * (1 if a == b else -1)
    determinant = Fraction(1)
    for i, a in enumerate(free):
        determinant *= rows[a][a] / inertia(a)
        for b in free[i + 1 :]:
            share = rows[b][a] / rows[a][a]
            rows[b] = {c: rows[b][c] - share * rows[a][c] for c in free}
    # Rigid rotation makes p^2 a factor.
    floats = ends and not held and len(masses) == len(ends) + 1
    return determinant / p**2 if floats else determinant


def among(ends, chosen):
    return {link: ends[link] for link in chosen}


def gamma(mass, i, j, p):
    return spring(i, p) * spring(j, p) / inertia(mass) ** 2


def of_train(ends):
    """Coefficients of the package, those of a tree over p^2."""
    masses = sorted({mass for pair in ends.values() for mass in pair})
    parts = [Disk(name=str(mass), inertia=float(inertia(mass))) for mass in masses]
    for link, (a, b) in ends.items():
        parts.append(
            Shaft(between=(str(a), str(b)), stiffness=2.0 * link + 1, damping=link / 10)
        )
    coefficients = characteristic_coefficients(build(parts), exact=True)
    return coefficients[:-2] if len(ends) < len(masses) else coefficients


def values(coefficients):
    return [np.polyval(coefficients, p) for p in POINTS]


@pytest.mark.parametrize("case", REFERENCE)
def test_coefficients_are_the_rationals_of_the_reference(case):
    ends, key = REFERENCE[case]
    assert of_train(ends) == tuple(map(Fraction, method_case(case)[1][key]))


def test_a_branch_needs_gamma_25_where_gamma_35_is_printed():
    expected = method_case("C_branched_R16")[1]

    def R(p, *links, held=()):
        return piece(among(BRANCHED, links), p, held)

    def split(i, j, p):
        """Row 2 with gamma_ij in the last term."""
        whole = R(p, 1, 2) * R(p, 3, 4, 5, 6)
        first = gamma(3, 2, 3, p) * R(p, 1) * R(p, 4) * R(p, 5, 6, held=[3])
        last = gamma(3, i, j, p) * R(p, 1) * R(p, 6) * R(p, 3, 4, held=[3])
        return whole - first - last

    for key, i, j in (("coeffs", 2, 5), ("coeffs_as_printed", 3, 5)):
        coefficients = [Fraction(number) for number in expected[key]]
        assert [split(i, j, p) for p in POINTS] == values(coefficients)


def test_coefficients_are_the_determinant_with_meshes_grounds_and_damping_of_disks():
    parts = chain_parts([1.0, 2.0, 0.5], [50.0, 80.0], ground=7.0, damping=0.3)
    parts += [
        Disk(name="b", inertia=0.2, radius=0.1),
        Disk(name="c", inertia=0.3, radius=0.04),
    ]
    parts += [
        Shaft(between=("3", "b"), stiffness=20.0, damping=0.5),
        jaxhb.Mesh(between=("c", "b"), stiffness=9e3),
    ]
    train = build(parts, reference="1")
    p = np.array([0.3 + 2j, 1j * 7.0])
    coefficients = characteristic_coefficients(train)
    np.testing.assert_allclose(
        np.polyval(coefficients, p), characteristic(train, p).value(), rtol=1e-11
    )
    exact = np.array(characteristic_coefficients(train, exact=True), float)
    np.testing.assert_allclose(coefficients, exact, rtol=ALGEBRAIC)


def test_rounded_coefficients_give_useless_values_where_the_recursion_is_exact():
    # docs/theory C5: uniform chain of 30 disks, Horner's rule on rounded coefficients
    # against the closed form.
    _, expected = method_case("C_large_chain_recurrence")
    train = build(chain_parts([1.0] * 30, [1.0] * 29))
    coefficients = np.array(characteristic_coefficients(train, exact=True), float)
    x = 2.7
    exact = float(expected["R"]["S=30,x=2.7"])
    horner = np.polyval(coefficients, 1j * np.sqrt(x)).real / -x
    recursion = characteristic(train, np.array([1j * np.sqrt(x)])).value()[0].real / -x
    assert abs(horner / exact - 1) > 1e-3
    assert abs(recursion / exact - 1) < 1e-11


def test_what_has_no_coefficients_is_refused_all_at_once():
    with pytest.raises(
        jaxhb.SceneError,
        match=r"'coupling\|input 1' has a loss factor, which is no polynomial",
    ):
        characteristic_coefficients(build(gearbox_parts(), reference="motor"))
    with pytest.raises(jaxhb.SceneError) as error:
        characteristic_coefficients(build(chain_parts([0.0, *[1.0] * 13], [1.0] * 13)))
    assert "disk '1' has no inertia" in str(error.value)
    assert "14 disks in double precision" in str(error.value)

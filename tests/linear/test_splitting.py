"""Exact coefficients against the reference's rationals and the rules of the source's table, as corrected."""

from fractions import Fraction

import numpy as np
import pytest
from reference_data import method_case
from splitting_rules import Links, less, open_ring, piece, split_at_mass, times
from tolerances import ALGEBRAIC
from trains import build, chain_parts, gearbox_parts

import jaxhb
from jaxhb import Disk, Shaft
from jaxhb.linear.polynomial import characteristic, characteristic_coefficients

CHAIN = {i: (i, i + 1) for i in range(1, 5)}
BRANCHED = {1: (1, 2), 2: (2, 3), 3: (3, 4), 4: (4, 5), 5: (3, 6), 6: (6, 7)}
RING = {1: (1, 2), 2: (2, 3), 3: (3, 4), 4: (4, 1)}
TAILED = {1: (1, 2), 2: (2, 3), 3: (3, 4), 4: (4, 5), 5: (5, 6), 6: (6, 3)}
REFERENCE = {
    "C_chain_R14": (CHAIN, "coeffs"),
    "C_branched_R16": (BRANCHED, "coeffs"),
    "C_ring_R14": (RING, "coeffs_damped"),
}
SPLITS = [
    *((CHAIN, split_at_mass, mass, part) for mass, part in ((2, [1]), (3, [1, 2]), (4, [4]))),
    *((BRANCHED, split_at_mass, 3, part) for part in ([1, 2], [5, 6], [3, 4], [1, 2, 5, 6])),
    *((RING, open_ring, mass, link) for mass, link in ((2, 2), (4, 3))),
    *((TAILED, open_ring, mass, link) for mass, link in ((4, 4), (5, 5))),
]


def system(ends):
    """The numbers of the cases: I_i = (i+1)/2, c_i = 2i+1, r_i = i/10."""
    masses = sorted({mass for pair in ends.values() for mass in pair})
    none = dict.fromkeys(masses, Fraction(0))
    springs = {i: (Fraction(2 * i + 1), Fraction(i, 10)) for i in ends}
    arms = dict.fromkeys(ends, (Fraction(1), Fraction(1)))
    return Links({i: Fraction(i + 1, 2) for i in masses}, none, none, ends, arms, springs)


def of_train(ends):
    """Coefficients of the package, those of a tree over p^2."""
    links = system(ends)
    parts = [Disk(name=str(mass), inertia=float(inertia)) for mass, inertia in links.inertia.items()]
    for link, (a, b) in ends.items():
        stiffness, damping = map(float, links.stiffness[link])
        parts.append(Shaft(between=(str(a), str(b)), stiffness=stiffness, damping=damping))
    found = characteristic_coefficients(build(parts), exact=True)
    return found[:-2] if len(ends) < len(links.inertia) else found


@pytest.mark.parametrize("case", REFERENCE)
def test_coefficients_are_the_rationals_of_the_reference(case):
    ends, key = REFERENCE[case]
    assert of_train(ends) == tuple(map(Fraction, method_case(case)[1][key]))


@pytest.mark.parametrize(("ends", "rule", "mass", "how"), SPLITS)
def test_coefficients_are_those_of_the_table_by_every_split(ends, rule, mass, how):
    assert of_train(ends) == rule(system(ends), mass, how) == piece(system(ends), list(ends))


def test_a_branch_needs_gamma_25_where_gamma_35_is_printed():
    links, expected = system(BRANCHED), method_case("C_branched_R16")[1]

    def split(i, j):
        """Row 2 with gamma_ij: R_12 R_36 - gamma_23 R_1 R_4 R_56(3) - gamma_ij R_1 R_6 R_34(3)."""
        total = times(piece(links, [1, 2]), piece(links, [3, 4, 5, 6]))
        for a, b, last, held in ((2, 3, 4, [5, 6]), (i, j, 6, [3, 4])):
            gamma = times(links.over(3, a), links.over(3, b))
            parts = times(piece(links, [1]), times(piece(links, [last]), piece(links, held, [3])))
            total = less(total, times(gamma, parts))
        return total

    assert split(2, 5) == tuple(map(Fraction, expected["coeffs"]))
    assert split(3, 5) == tuple(map(Fraction, expected["coeffs_as_printed"]))


def test_coefficients_are_the_determinant_with_meshes_grounds_and_damping_of_disks():
    parts = chain_parts([1.0, 2.0, 0.5], [50.0, 80.0], ground=7.0, damping=0.3)
    parts += [Disk(name="b", inertia=0.2, radius=0.1), Disk(name="c", inertia=0.3, radius=0.04)]
    parts += [Shaft(between=("3", "b"), stiffness=20.0, damping=0.5), jaxhb.Mesh(between=("c", "b"), stiffness=9e3)]
    train, p = build(parts, reference="1"), np.array([0.3 + 2j, 1j * 7.0])
    found = characteristic_coefficients(train)
    np.testing.assert_allclose(np.polyval(found, p), characteristic(train, p).value(), rtol=1e-11)
    np.testing.assert_allclose(found, np.array(characteristic_coefficients(train, exact=True), float), rtol=ALGEBRAIC)


def test_values_by_coefficients_in_double_precision_are_useless_where_the_recursion_is_exact():
    # docs/theory C5: uniform chain of 30 disks, Horner's rule on rounded coefficients against the closed form
    _, expected = method_case("C_large_chain_recurrence")
    train = build(chain_parts([1.0] * 30, [1.0] * 29))
    coefficients = np.array(characteristic_coefficients(train, exact=True), float)
    x, wanted = 2.7, float(expected["R"]["S=30,x=2.7"])
    horner = np.polyval(coefficients, 1j * np.sqrt(x)).real / -x
    recursion = characteristic(train, np.array([1j * np.sqrt(x)])).value()[0].real / -x
    assert abs(horner / wanted - 1) > 1e-3 and abs(recursion / wanted - 1) < 1e-11


def test_what_has_no_coefficients_is_refused_all_at_once():
    with pytest.raises(jaxhb.SceneError, match=r"'coupling\|input 1' has a loss factor, which is no polynomial"):
        characteristic_coefficients(build(gearbox_parts(), reference="motor"))
    with pytest.raises(jaxhb.SceneError) as error:
        characteristic_coefficients(build(chain_parts([0.0, *[1.0] * 13], [1.0] * 13)))
    assert "disk '1' has no inertia" in str(error.value) and "14 disks in double precision" in str(error.value)

"""Exact coefficients against the reference's rationals, and the rows of the source's table with its misprints."""

from fractions import Fraction

import numpy as np
import pytest
from reference_data import method_case
from splitting_rules import Links, open_ring, piece, plus, split_at_mass, times
from tolerances import ALGEBRAIC
from trains import build, chain_parts, gearbox_parts

import jaxhb
from jaxhb import Disk, Shaft
from jaxhb.linear import polynomial
from jaxhb.linear.polynomial import characteristic_coefficients

CHAIN = {i: (i, i + 1) for i in range(1, 5)}
BRANCHED = {1: (1, 2), 2: (2, 3), 3: (3, 4), 4: (4, 5), 5: (3, 6), 6: (6, 7)}
RING = {1: (1, 2), 2: (2, 3), 3: (3, 4), 4: (4, 1)}
TAILED = {1: (1, 2), 2: (2, 3), 3: (3, 4), 4: (4, 5), 5: (5, 6), 6: (6, 3)}


def system(ends, viscous=True):
    """The numbers of the cases: I_i = (i+1)/2, c_i = 2i+1, r_i = i/10."""
    masses = sorted({mass for pair in ends.values() for mass in pair})
    none = dict.fromkeys(masses, Fraction(0))
    springs = {i: (Fraction(2 * i + 1), Fraction(i, 10) if viscous else Fraction(0)) for i in ends}
    arms = dict.fromkeys(ends, (Fraction(1), Fraction(1)))
    return Links({i: Fraction(i + 1, 2) for i in masses}, none, none, ends, arms, springs)


def rationals(coefficients):
    return tuple(map(Fraction, coefficients))


def gamma(links, i, j, mass):
    return times(links.over(mass, i), links.over(mass, j))


def product(*factors):
    total = (Fraction(1),)
    for factor in factors:
        total = times(total, factor)
    return total


def minus(total, *factors):
    return plus(total, tuple(-value for value in product(*factors)))


def test_row_1_a_chain_by_either_split():
    links, R = system(CHAIN), lambda *chosen: piece(system(CHAIN), chosen)
    wanted = rationals(method_case("C_chain_R14")[1]["coeffs"])
    assert R(1, 2, 3, 4) == wanted
    assert minus(times(R(1), R(2, 3, 4)), gamma(links, 1, 2, 2), R(3, 4)) == wanted
    assert minus(times(R(1, 2), R(3, 4)), gamma(links, 2, 3, 3), R(1), R(4)) == wanted
    for mass, part in ((2, [1]), (3, [1, 2]), (4, [4])):
        assert split_at_mass(links, mass, part) == wanted


def test_row_2_a_branch_needs_gamma_25_where_gamma_35_is_printed():
    links, expected = system(BRANCHED), method_case("C_branched_R16")[1]
    R = lambda *chosen, held=(): piece(links, chosen, held)  # noqa: E731
    assert R(3, 4, held=[3]) == rationals(expected["R34_grounded3"])
    assert R(5, 6, held=[3]) == rationals(expected["R56_grounded3"])
    start = minus(times(R(1, 2), R(3, 4, 5, 6)), gamma(links, 2, 3, 3), R(1), R(4), R(5, 6, held=[3]))
    rest = R(1), R(6), R(3, 4, held=[3])
    assert minus(start, gamma(links, 2, 5, 3), *rest) == R(*BRANCHED) == rationals(expected["coeffs"])
    printed = minus(start, gamma(links, 3, 5, 3), *rest)
    assert printed == rationals(expected["coeffs_as_printed"]) != R(*BRANCHED)
    for part in ([1, 2], [5, 6], [3, 4], [1, 2, 5, 6]):
        assert split_at_mass(links, 3, part) == R(*BRANCHED)


def over_all(links, ring, masses, viscous=True):
    """prod k_i / I_i, or the printed prod c_i / I_i."""
    springs = [links.spring(i) if viscous else (links.stiffness[i][0],) for i in ring]
    return product(*springs, *((1 / links.inertia[m],) for m in masses))


def opened_at(links, mass, link):
    """The ring opened at a mass that is repeated."""
    ends = {**links.ends, link: tuple(99 if m == mass else m for m in links.ends[link])}
    none = dict.fromkeys([*links.inertia, 99], Fraction(0))
    return Links({**links.inertia, 99: links.inertia[mass]}, none, none, ends, links.arms, links.stiffness)


def test_row_3_a_ring_has_products_of_k_where_c_is_printed():
    expected = method_case("C_ring_R14")[1]
    for viscous, key in ((True, "coeffs_damped"), (False, "coeffs_undamped")):
        links, wanted = system(RING, viscous), rationals(expected[key])
        assert piece(links, list(RING)) == wanted
        start = minus(piece(opened_at(links, 2, 2), list(RING)), gamma(links, 1, 2, 2), piece(links, [3, 4]))
        assert minus(start, (2,), over_all(links, RING, (1, 2, 3, 4))) == wanted
        printed = minus(start, (2,), over_all(links, RING, (1, 2, 3, 4), viscous=False))
        assert (printed == wanted) is (not viscous)
        assert open_ring(links, 2, 2) == open_ring(links, 4, 3) == wanted


def test_row_4_a_ring_with_a_tail_is_neither_of_the_forms_as_printed():
    links = system(TAILED)
    R = lambda *chosen, held=(): piece(links, chosen, held)  # noqa: E731
    closed = minus(times(R(1), R(2, 3, 4, 5, 6)), gamma(links, 1, 2, 2), R(3, 4, 5, 6))
    opened = opened_at(links, 4, 4)
    ring = over_all(links, (3, 4, 5, 6), (3, 4, 5, 6))
    form = minus(piece(opened, list(TAILED)), gamma(links, 3, 4, 4), R(1, 2, 5, 6))
    form = minus(form, (2,), R(1, 2, held=[3]), ring)
    assert closed == form == R(*TAILED) == open_ring(links, 4, 4) == open_ring(links, 5, 5)
    as_printed = over_all(links, (3, 4, 5, 6), (3, 4, 5, 6), viscous=False)
    tree = piece(opened, [2, 3, 4, 5, 6])
    for start in (times(R(1), tree), times(R(1), R(2, 3, 4, 5, 6))):
        assert minus(minus(start, gamma(links, 1, 2, 2), R(3, 4, 5, 6)), (2,), as_printed) != closed


def test_coefficients_are_the_determinant_with_meshes_grounds_and_damping_of_disks():
    parts = chain_parts([1.0, 2.0, 0.5], [50.0, 80.0], ground=7.0, damping=0.3)
    parts += [Disk(name="b", inertia=0.2, radius=0.1), Disk(name="c", inertia=0.3, radius=0.04)]
    parts += [Shaft(between=("3", "b"), stiffness=20.0, damping=0.5), jaxhb.Mesh(between=("c", "b"), stiffness=9e3)]
    train, p = build(parts, reference="1"), np.array([0.3 + 2j, 1j * 7.0])
    found = characteristic_coefficients(train)
    np.testing.assert_allclose(np.polyval(found, p), polynomial.characteristic(train, p).value(), rtol=1e-11)
    exact = characteristic_coefficients(train, exact=True)
    np.testing.assert_allclose(found, np.array(exact, float), rtol=ALGEBRAIC)


def test_values_by_coefficients_in_double_precision_are_useless_where_the_recursion_is_exact():
    # docs/theory C5: uniform chain of 30 disks, Horner's rule on rounded coefficients against the closed form
    _, expected = method_case("C_large_chain_recurrence")
    train = build(chain_parts([1.0] * 30, [1.0] * 29))
    coefficients = np.array(characteristic_coefficients(train, exact=True), float)
    x, wanted = 2.7, float(expected["R"]["S=30,x=2.7"])
    horner = np.polyval(coefficients, 1j * np.sqrt(x)).real / -x
    recursion = polynomial.characteristic(train, np.array([1j * np.sqrt(x)])).value()[0].real / -x
    assert abs(horner / wanted - 1) > 1e-3 and abs(recursion / wanted - 1) < 1e-11


def test_what_has_no_coefficients_is_refused_all_at_once():
    with pytest.raises(jaxhb.SceneError, match="'coupling|input 1' has a loss factor, which is no polynomial"):
        characteristic_coefficients(build(gearbox_parts(), reference="motor"))
    large = chain_parts([0.0, *[1.0] * 13], [1.0] * 13)
    with pytest.raises(jaxhb.SceneError) as error:
        characteristic_coefficients(build(large))
    assert "disk '1' has no inertia" in str(error.value) and "14 disks in double precision" in str(error.value)


@pytest.mark.parametrize("ends", [CHAIN, BRANCHED, RING, TAILED])
def test_the_coefficients_of_a_train_are_those_of_the_table(ends):
    links = system(ends)
    parts = [Disk(name=str(mass), inertia=float(inertia)) for mass, inertia in links.inertia.items()]
    for link, (a, b) in ends.items():
        stiffness, damping = map(float, links.stiffness[link])
        parts.append(Shaft(between=(str(a), str(b)), stiffness=stiffness, damping=damping))
    whole = piece(links, list(ends))
    rigid = () if len(whole) == 2 * len(links.inertia) + 1 else (0, 0)
    assert characteristic_coefficients(build(parts), exact=True) == (*whole, *rigid)

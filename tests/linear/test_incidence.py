"""Singular values of the incidence factor against exact rationals, closed forms and
dense eigenproblems.
"""

from decimal import Decimal, localcontext
from fractions import Fraction

import dense
import jax.numpy as jnp
import numpy as np
import pytest
from tolerances import ALGEBRAIC
from trains import branched_parts, build, chain_parts, gearbox_parts

import jaxhb
from jaxhb import Disk, Shaft
from jaxhb.linear.modal import all_frequencies


def negative_pivots(parts, square):
    """Natural frequencies below a rational omega^2, from the exact pivots of K -
    omega^2 M (Sylvester).
    """
    names = dense.disk_names(parts)
    matrix = [[Fraction(0)] * len(names) for _ in names]
    for part in parts:
        if isinstance(part, Disk):
            i = names.index(part.name)
            matrix[i][i] -= square * Fraction(part.inertia)
        else:
            ends = getattr(part, "between", (getattr(part, "disk", None),))
            k = Fraction(part.stiffness)
            at = [names.index(name) for name in ends]
            for i in at:
                for j in at:
                    matrix[i][j] += k if i == j else -k
    below = 0
    for i, row in enumerate(matrix):
        below += row[i] < 0
        for other in matrix[i + 1 :]:
            ratio = other[i] / row[i]
            other[i:] = [a - ratio * b for a, b in zip(other[i:], row[i:], strict=True)]
    return below


HARD = [1e8, 1e-10, 1e8, 3e-10, 1e8, 2.0]
SPREAD = [1.0, 1e-3, 20.0, 5.0, 1e-4, 3.0, 0.2]
CASES = {
    "chain": chain_parts(SPREAD, HARD),
    "held": chain_parts(SPREAD, HARD, ground=1e-6),
    "tree": [
        *chain_parts(SPREAD, HARD),
        Disk(name="side", inertia=0.5),
        Shaft(between=("side", "3"), stiffness=1e-9),
    ],
    "massless": [
        *chain_parts([1.0, 0.0, 2.0, 0.0, 3.0], [1e8, 1e-9, 5.0, 1e7]),
        Disk(name="side", inertia=0.1),
        Shaft(between=("2", "side"), stiffness=1e-8),
    ],
}


@pytest.mark.parametrize("case", CASES)
def test_every_frequency_has_its_digits_however_far_stiffnesses_lie_apart(case):
    parts = CASES[case]
    omega = 2 * np.pi * jaxhb.natural_frequencies(build(parts)).frequencies_hz
    loose = int(case != "held")
    np.testing.assert_array_equal(omega[:loose], 0.0)
    for j in range(loose, len(omega)):
        square = Fraction(omega[j]) ** 2
        near = Fraction(2e-12)  # twice that of omega
        assert negative_pivots(parts, square * (1 - near)) == j
        assert negative_pivots(parts, square * (1 + near)) == j + 1


def test_soft_mode_of_a_closed_loop_keeps_its_digits():
    # Two stiff pairs joined by two soft shafts; a loop leaves a dependent row, so that
    # only moderate spreads are exact.
    parts = chain_parts([1.0, 2.0, 3.0, 1.5], [1e8, 1e-4, 1e8]) + [
        Shaft(between=("1", "4"), stiffness=3e-4)
    ]
    omega = 2 * np.pi * jaxhb.natural_frequencies(build(parts)).frequencies_hz
    square = Fraction(omega[1]) ** 2
    near = Fraction(2e-9)
    assert omega[0] == 0.0
    assert negative_pivots(parts, square * (1 - near)) == 1
    assert negative_pivots(parts, square * (1 + near)) == 2


@pytest.mark.parametrize(
    "parts", [branched_parts(), gearbox_parts(), gearbox_parts(grounded=False)]
)
def test_energies_are_those_of_the_dense_matrices(parts):
    reference = next(p.name for p in parts if isinstance(p, Disk))
    modes = jaxhb.natural_frequencies(build(parts, reference=reference))
    masses = dense.of_kind(parts, Disk) + dense.of_kind(parts, jaxhb.Damper)
    J = np.array([getattr(mass, "inertia", 0.0) for mass in masses])
    K = dense.dynamic_stiffness(parts, 0.0).real
    if J.all():
        squares = np.linalg.eigvalsh(K / np.sqrt(np.outer(J, J)))
        # Rounding of the dense squares is that of the largest.
        omega = 2 * np.pi * modes.frequencies_hz
        np.testing.assert_allclose(
            omega**2, squares, rtol=1e-11, atol=1e-14 * squares[-1]
        )
    mass = modes.generalised_mass
    product = (modes.shapes * J) @ modes.shapes.T / np.sqrt(np.outer(mass, mass))
    np.testing.assert_allclose(product, np.eye(len(product)), rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.abs(modes.shapes).max(1), 1.0, rtol=ALGEBRAIC)
    np.testing.assert_allclose(
        modes.generalised_mass, (modes.shapes**2) @ J, rtol=ALGEBRAIC
    )
    np.testing.assert_allclose(modes.kinetic_share.sum(1), 1.0, rtol=ALGEBRAIC)
    stored = np.einsum("mi,ij,mj->m", modes.shapes, K, modes.shapes)
    size = np.abs(K).max()
    np.testing.assert_allclose(
        modes.generalised_stiffness, stored, rtol=1e-9, atol=ALGEBRAIC * size
    )
    moving = modes.frequencies_hz > 0
    for link, (part, row) in enumerate(dense.links(parts)):
        share = part.stiffness * (modes.shapes @ row) ** 2
        assert modes.link_names[link].split("#")[0] in (
            part.name,
            "|".join(getattr(part, "between", ("", ""))),
        )
        energy = modes.strain_share[moving, link] * modes.generalised_stiffness[moving]
        np.testing.assert_allclose(
            energy, share[moving], rtol=1e-9, atol=ALGEBRAIC * size
        )


def test_part_behind_a_viscous_link_has_a_rigid_mode_of_its_own_that_rests_elsewhere():
    modes = jaxhb.natural_frequencies(
        build(gearbox_parts(grounded=False), reference="motor")
    )
    ring = modes.names.index("viscous ring")
    assert modes.frequencies_hz[1] == 0.0 < modes.frequencies_hz[2]
    np.testing.assert_array_equal(modes.shapes[1], np.arange(len(modes.names)) == ring)
    assert modes.shapes[0, ring] == 0.0
    assert modes.node_count[:2].tolist() == [0, 0]
    speeds = {"motor": 1.0, "lay 2": 0.05 / 0.10, "mill": 0.05 / 0.10 * 0.06 / 0.09}
    for disk, ratio in speeds.items():
        np.testing.assert_allclose(modes.shape(0)[disk], ratio, rtol=ALGEBRAIC)


def test_nodes_of_a_chain_count_its_modes_and_a_ring_has_two_more_with_each_pair():
    random = np.random.default_rng(3)
    parts = chain_parts(random.uniform(0.5, 1, 12), random.uniform(5e5, 1e6, 11))
    np.testing.assert_array_equal(
        jaxhb.natural_frequencies(build(parts)).node_count, np.arange(12)
    )
    symmetric = jaxhb.natural_frequencies(build(chain_parts([1.0] * 5, [1.0] * 4)))
    # The middle disk lies in a node.
    np.testing.assert_array_equal(symmetric.node_count, np.arange(5))
    ring = [
        *chain_parts([1.0] * 6, [1.0] * 5),
        Shaft(between=("1", "6"), stiffness=1.0),
    ]
    nodes = jaxhb.natural_frequencies(build(ring)).node_count
    assert nodes.tolist() == [0, 2, 2, 4, 4, 6]


@pytest.mark.parametrize("ground", [None, 1.0])
def test_a_long_chain_with_massless_disks_has_the_modes_of_the_closed_form(ground):
    # Each link of 1 N m/rad is two of 2 N m/rad with a massless disk between them.
    n = 510
    inertia = np.zeros(2 * n - 1)
    inertia[::2] = 1.0
    train = build(chain_parts(inertia.tolist(), [2.0] * (2 * n - 2), ground=ground))
    j = np.arange(n)
    exact = (
        2 * np.sin(j * np.pi / (2 * n))
        if ground is None
        else 2 * np.sin((2 * j + 1) * np.pi / (4 * n + 2))
    )
    omega = 2 * np.pi * all_frequencies(train)
    np.testing.assert_allclose(omega, exact, rtol=1e-12, atol=0.0)
    modes = jaxhb.natural_frequencies(train, count=5)
    np.testing.assert_allclose(2 * np.pi * modes.frequencies_hz, exact[:5], rtol=1e-12)
    wave = j * np.pi / n if ground is None else (2 * j + 1) * np.pi / (2 * n + 1)
    shape = np.cos(wave[:5, None] * np.arange(0.5, n))
    shapes = modes.shapes[:, ::2] / modes.shapes[:, :1]
    np.testing.assert_allclose(shapes, shape / shape[:, :1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        modes.shapes[:, 1], modes.shapes[:, [0, 2]].mean(1), rtol=1e-9
    )


def holzer_sum(inertia, stiffness, square):
    """Sum of all inertia torques of a free chain at a decimal omega^2: its sign changes
    at natural frequencies.
    """
    angle = Decimal(1)
    torque = Decimal(0)
    for J, k in zip(inertia, [*stiffness, 1.0], strict=True):
        torque += Decimal(J) * square * angle
        angle -= torque / Decimal(k)
    return torque


def test_soft_links_of_a_long_chain_keep_their_digits():
    random = np.random.default_rng(7)
    n = 600
    inertia = 10 ** random.uniform(-2, 0, n)
    stiffness = 10 ** random.uniform(3, 6, n - 1)
    inertia[5::50] = 0.0
    stiffness[[200, 450]] = (1e-4, 3e-6)
    train = build(chain_parts(inertia.tolist(), stiffness.tolist()))
    modes = jaxhb.natural_frequencies(train, count=4)
    with localcontext(prec=60):
        for frequencies in (all_frequencies(train)[:4], modes.frequencies_hz):
            assert frequencies[0] == 0.0
            for hz in frequencies[1:]:
                square = Decimal(2 * np.pi * hz) ** 2
                near = Decimal("2e-13")  # twice that of omega
                low, high = (
                    holzer_sum(inertia, stiffness, square * (1 + sign * near))
                    for sign in (-1, 1)
                )
                assert low * high < 0
    soft = modes.strain_share[1:3, [200, 450]].sum(1)
    # The stiff links between have the rest.
    np.testing.assert_allclose(soft, 1.0, atol=1e-5)


def test_arrays_of_jax_make_no_difference():
    train = build(branched_parts(), reference="flywheel")
    name = train.topology.shaft_names[0] + ".stiffness"
    changed = train.replace({name: jnp.asarray(train.value(name))})
    for modes in (jaxhb.natural_frequencies, jaxhb.damped_modes):
        expected = modes(train).shapes
        shapes = modes(changed).shapes
        assert isinstance(shapes, np.ndarray)
        assert np.array_equal(expected, shapes)

"""Sweeps over trees of links against dense solves, and the reference cases of
docs/theory A1 and A2.
"""

import jax
import numpy as np
import pytest
from reference_data import complex_numbers, method_case, numbers
from tolerances import ALGEBRAIC

from jaxhb.equations import fourier
from jaxhb.equations.block_sweep import matrix_sweep, scalar_sweep, slots

solve = jax.jit(scalar_sweep)
sweep_blocks = jax.jit(matrix_sweep)

SIZES = (2, 5, 9, 13)
"""Few sizes, for each is compiled once."""


def random_tree(draw, size):
    """Parents above every node; the root's is ``size``."""
    return np.array([*(draw.integers(s + 1, size) for s in range(size - 1)), size])


def sweep(parent, near, far, link, node, load, solve=solve):
    """Displacements and forces ``(S, H, R)``."""
    result = solve(slots(parent), near, far, link, node, load.transpose(0, 2, 1))
    return [np.asarray(a).transpose(0, 2, 1) for a in result]


def random_line(draw, *shape):
    """Complex numbers with positive real part."""
    return draw.uniform(0.5, 2.0, shape) + 1j * draw.normal(size=shape)


def dense_solution(parent, near, far, link, node, load):
    """Displacements and link forces ``(S, H, R)`` by a dense solve of each harmonic."""
    size, harmonics = node.shape
    rows = np.diag(near)[:-1].astype(complex)
    rows[np.arange(size - 1), parent[:-1]] -= far[:-1]
    x = np.empty_like(load)
    for h in range(harmonics):
        x[:, h] = np.linalg.solve(
            np.diag(node[:, h]) + rows.T @ (link[:-1, h, None] * rows), load[:, h]
        )
    force = np.zeros_like(load)
    force[:-1] = link[:-1, :, None] * np.einsum("st,thr->shr", rows, x)
    return x, force


def relative_error(actual, exact):
    return np.abs(np.asarray(actual) - exact).max() / np.abs(exact).max()


@pytest.mark.parametrize("place", [solve, scalar_sweep], ids=["program", "host"])
@pytest.mark.parametrize("size", SIZES)
def test_sweep_equals_dense_solve_on_random_trees_with_any_arms(size, place):
    draw = np.random.default_rng(size)
    for _ in range(20):
        parent = random_tree(draw, size)
        near, far = draw.uniform(0.3, 3.0, (2, size))
        link = random_line(draw, size, 4)
        node = random_line(draw, size, 4)
        load = draw.normal(size=(size, 4, 2)) + 1j * draw.normal(size=(size, 4, 2))
        exact = dense_solution(parent, near, far, link, node, load)
        swept = sweep(parent, near, far, link, node, load, place)
        for actual, expected in zip(swept, exact, strict=True):
            assert relative_error(actual, expected) < ALGEBRAIC


@pytest.mark.slow
def test_matrix_sweep_with_toeplitz_links_equals_dense_solve():
    draw = np.random.default_rng(200)
    size = 7
    harmonics = 3
    width = 7
    for _ in range(15):
        parent = random_tree(draw, size)
        near, far = draw.uniform(0.5, 2.0, (2, size))
        c = 0.1 * (
            draw.normal(size=(size, width)) + 1j * draw.normal(size=(size, width))
        )
        c[:, 0] = draw.uniform(2.0, 5.0, size)
        link = np.asarray(fourier.product_matrix(c))
        node = np.asarray(
            fourier.packed_diagonal(random_line(draw, size, harmonics + 1))
        )
        load = draw.normal(size=(size, width))
        x, deflection, quality = sweep_blocks(parent, near, far, link, node, load)
        K = np.zeros((size, width, size, width))
        K[np.arange(size), :, np.arange(size), :] = node
        for s in range(size - 1):
            row = np.zeros(size)
            row[s] = near[s]
            row[parent[s]] = -far[s]
            K += np.einsum("s,t,ij->sitj", row, row, link[s])
        exact = np.linalg.solve(K.reshape(size * width, -1), load.reshape(-1))
        exact = exact.reshape(size, width)
        apart = near[:-1, None] * exact[:-1] - far[:-1, None] * exact[parent[:-1]]
        assert relative_error(x, exact) < ALGEBRAIC
        assert relative_error(deflection[:-1], apart) < ALGEBRAIC
        assert not deflection[-1].any()
        assert 0 < quality <= 1


def test_matrix_sweep_tells_a_pivot_that_breaks_down_though_the_matrix_is_regular():
    # docs/theory A2: node 1 with its upper node held is at parametric resonance, m = 1,
    # b = 0.1, c = 1 + a cos 2t.
    m = 1.0
    b = 0.1
    a = 0.200109342148869
    harmonics = 8
    n = np.arange(harmonics + 1)
    coefficients = np.zeros(2 * harmonics + 1, complex)
    coefficients[0] = 1.0
    coefficients[2] = a / 2
    link = np.asarray(fourier.product_matrix(coefficients))[None].repeat(2, 0)
    node = np.asarray(
        fourier.packed_diagonal(
            np.stack([-m * n**2 + 1j * b * n, 0.5 - 2 * n**2 + 0.3j * n])
        )
    )
    ones = np.ones(2)
    *_, quality = sweep_blocks(
        np.array([1, 2]), ones, ones, link, node, np.ones((2, 2 * harmonics + 1))
    )
    whole = np.block([[node[0] + link[0], -link[0]], [-link[0], node[1] + link[0]]])
    assert np.linalg.cond(whole) < 1e4
    assert quality < 1e-10


def test_case_a1_soft_ground_costs_no_digits_of_displacements_and_forces():
    params, expected = method_case("A1_soft_ground_static")
    c = numbers(params["c"])
    q = numbers(params["q"])
    node = np.zeros((4, 1), complex)
    node[-1] = c[-1]
    x, force = sweep(
        np.array([1, 2, 3, 4]),
        np.ones(4),
        np.ones(4),
        c[:, None] + 0j,
        node,
        q[:, None, None] + 0j,
    )
    np.testing.assert_allclose(x[:, 0, 0], numbers(expected["x"]), rtol=ALGEBRAIC)
    tension = numbers(expected["f"])  # of x_{s+1} - x_s: the opposite sign
    np.testing.assert_allclose(force[:3, 0, 0], -tension[:3], rtol=ALGEBRAIC)
    np.testing.assert_allclose(-c[-1] * x[-1, 0, 0], tension[3], rtol=ALGEBRAIC)


def parents_from_fridman(places, image):
    """Fridman's numbering of a tree as a chain with fictitious nodes, whose places and
    images count from 1: place of every physical node in order of elimination, and
    position of its parent, S at the root.
    """
    physical = [place for place in range(1, places + 1) if place not in image]
    position = {place: s for s, place in enumerate([*physical, places + 1])}
    above = [image.get(place + 1, place + 1) for place in physical]
    return np.array(physical), np.array(
        [position[place] for place in above], dtype=np.int32
    )


def tree_case(parent, slots, harmonics):
    """The dimensionless trees of A2: m_s = 1 + s/10, b = 1/5, c_s = 10 + s, p_s = 1/s,
    soft ground 1/2 at the root.
    """
    n = np.array(harmonics)
    s = np.asarray(slots, float)
    node = -np.outer(1 + s / 10, n**2) + 0.2j * n
    node[-1] += 0.5
    link = np.repeat((10 + s)[:, None] + 0j, len(n), axis=1)
    load = np.repeat((1 / s)[:, None, None] + 0j, len(n), axis=1)
    x, _ = sweep(parent, np.ones(len(s)), np.ones(len(s)), link, node, load)
    return dict(zip(slots, np.asarray(x[..., 0]), strict=True))


@pytest.mark.parametrize(
    ("case", "places", "image", "tree"),
    [
        ("A2_tree7_fictitious", 7, {3: 6}, "links"),
        ("A2_fig2_topology", 30, {8: 11, 12: 15, 16: 24}, "parent"),  # figure 2
    ],
)
def test_case_a2_trees_in_the_numbering_of_fridman_with_fictitious_nodes(
    case, places, image, tree
):
    params, expected = method_case(case)
    slots, parent = parents_from_fridman(places, image)
    assert params[tree] == {
        str(p): int(slots[q]) if q < len(slots) else 0
        for p, q in zip(slots, parent, strict=True)
    }
    solution = tree_case(parent, slots.tolist(), [int(n) for n in expected["a"]])
    for k, amplitudes in enumerate(expected["a"].values()):
        for place, value in amplitudes.items():
            np.testing.assert_allclose(
                solution[int(place)][k], complex_numbers(value), rtol=ALGEBRAIC
            )


def test_a_part_that_nothing_holds_rests_on_its_parent():
    # A ring behind a purely viscous link: at the mean its pivot is 0, at other
    # harmonics it is an ordinary node.
    node = np.array([[0.0, -4.0], [3.0, 2.0]], complex)
    link = np.array([[0.0, 1j], [0.0, 0.0]])
    x, force = sweep(
        np.array([1, 2]),
        np.ones(2),
        np.ones(2),
        link,
        node,
        np.array([[[0.0], [1]], [[6.0], [1]]]) + 0j,
    )
    np.testing.assert_allclose(x[:, 0, 0], [2.0, 2.0], rtol=ALGEBRAIC)
    assert not np.asarray(force[:, 0]).any()
    exact = np.linalg.solve([[-4 + 1j, -1j], [-1j, 2 + 1j]], [1, 1])
    np.testing.assert_allclose(x[:, 1, 0], exact, rtol=ALGEBRAIC)


def test_an_undamped_absorber_at_its_frequency_holds_its_parent_still():
    # The pivot m omega^2 - c of the absorber is exactly 0, the whole matrix is regular:
    # x = (-1/4, 0), link force -1.
    node = np.array([[-4.0], [-5.0 + 1j]])
    link = np.array([[4.0], [0.0]], complex)
    load = np.array([[[0.0]], [[1.0]]], complex)
    x, force = sweep(np.array([1, 2]), np.ones(2), np.ones(2), link, node, load)
    exact = np.linalg.solve([[0.0, -4.0], [-4.0, -1.0 + 1j]], [0.0, 1.0])
    np.testing.assert_allclose(x[:, 0, 0], exact, rtol=0, atol=ALGEBRAIC)
    np.testing.assert_allclose(force[0, 0, 0], -1.0, rtol=0, atol=ALGEBRAIC)

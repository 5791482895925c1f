"""Natural frequencies and shapes against published systems and closed forms."""

import numpy as np
from reference_data import method_case, numbers, torsional_model
from tolerances import ALGEBRAIC, half_unit
from trains import build, chain_parts

import jaxhb
from jaxhb import Disk, Mesh, Shaft


def chain_of(model, ground=None):
    """Modes of a published chain of disks."""
    return jaxhb.natural_frequencies(
        build(chain_parts(model["J"], model["k"], ground=ground))
    )


def as_printed(shapes):
    """Shapes with the first ordinate 1."""
    return shapes / shapes[:, :1]


def test_published_frequencies_of_a_crankshaft_and_its_computed_modes():
    entry = torsional_model("honda_cbr600rr_crank")
    modes = chain_of(entry["model"])
    np.testing.assert_allclose(
        modes.frequencies_hz[1:3], entry["published_Hz"], rtol=0, atol=0.5
    )
    # The eigenvalues of another program.
    np.testing.assert_allclose(
        modes.frequencies_hz[1:], entry["computed_Hz"][1:], rtol=1e-9
    )
    shapes = as_printed(modes.shapes)
    np.testing.assert_allclose(shapes[1:3], [entry["mode1"], entry["mode2"]], rtol=1e-8)


def test_published_frequencies_of_a_geared_system_whose_teeth_are_rigid():
    # The teeth are rigid there: here 1e11 N/m on a radius of 1 m, 1e7 times the shafts,
    # which moves frequencies by some 1e-8 and adds a mode of the teeth at 1.4e7 Hz.
    entry = torsional_model("friswell_geared_pagex")
    model = entry["model"]
    disks = [Disk(name=key, inertia=J) for key, J in model["disks"].items()]
    disks += [
        Disk(name=str(gear["node"]), inertia=gear["I"], radius=float(gear["R"]))
        for gear in model["gears"]
    ]
    shafts = [
        Shaft(between=(str(a), str(b)), stiffness=k) for a, b, k in model["shafts"]
    ]
    train = build(
        [*disks, *shafts, Mesh(between=("1", "2"), stiffness=1e11)], reference="0"
    )
    modes = jaxhb.natural_frequencies(train)
    np.testing.assert_allclose(
        modes.frequencies_hz[:4], entry["expected_Hz"], rtol=0, atol=half_unit(3247.2)
    )
    assert modes.mesh_energy_share[-1] > 0.999
    assert modes.mesh_energy_share[:4].max() < 1e-6


def test_case_b_three_disks_have_their_rational_modes():
    params, expected = method_case("B_three_disc_free_free")
    modes = jaxhb.natural_frequencies(
        build(chain_parts(numbers(params["J"]), numbers(params["c"])))
    )
    squares = (2 * np.pi * modes.frequencies_hz) ** 2
    np.testing.assert_allclose(
        squares, numbers(expected["omega2"]), rtol=ALGEBRAIC, atol=0
    )
    shapes = as_printed(np.array([numbers(mode) for mode in expected["modes"]]))
    np.testing.assert_allclose(
        as_printed(modes.shapes), shapes, rtol=0, atol=20 * ALGEBRAIC
    )


def test_case_b_a_uniform_ring_has_its_closed_form():
    """Long chains of test_incidence.py are the case of open chains."""
    params, expected = method_case("B_uniform_ring")
    n = params["n"]
    ring = Shaft(between=("1", str(n)), stiffness=1.0)
    modes = jaxhb.natural_frequencies(
        build([*chain_parts([1.0] * n, [1.0] * (n - 1)), ring])
    )
    squares = (2 * np.pi * modes.frequencies_hz) ** 2
    np.testing.assert_allclose(
        squares, numbers(expected["omega2"]), rtol=ALGEBRAIC, atol=ALGEBRAIC
    )

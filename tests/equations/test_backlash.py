"""The backlash law (18) of Fridman 2009 with its slopes exchanged back, for any
transition and epsilon.
"""

import dense
import jax
import numpy as np
import pytest
from reference_data import method_case, numbers
from tolerances import ALGEBRAIC, GRADIENT

from jaxhb import Mesh
from jaxhb.equations import backlash
from jaxhb.equations.backlash import Law

DYADIC = Law(stiffness=3.0, epsilon=0.125, transition=0.25, backlash=0.5)
"""All knots are exact in binary: 0.1875 and 0.3125."""

KNOTS = np.array([-0.3125, -0.1875, 0.0, 0.1875, 0.3125])


def random_laws(count=20):
    draw = np.random.default_rng(5)
    return [
        Law(*draw.uniform([0.5, 0.0, 0.01, 0.1], [5.0, 0.9, 1.0, 2.0]))
        for _ in range(count)
    ]


def sweep_of(law):
    """Deflections in every piece on both sides."""
    return law.backlash * np.linspace(-1.7, 1.7, 101)


per_sample = jax.jit(
    jax.vmap(jax.grad(backlash.force, argnums=(0, 1)), in_axes=(None, 0))
)
energy_slopes = jax.jit(
    jax.vmap(jax.grad(backlash.energy, argnums=(0, 1)), in_axes=(None, 0))
)


def test_case_a3_values_slopes_and_energies():
    params, expected = method_case("A3_law18")
    law = Law(float(params["c"]), float(params["eps"]), 0.2, float(params["h"]))

    def column(key):
        return numbers([point[key] for point in expected["points"]])

    l = column("l")
    np.testing.assert_allclose(backlash.force(law, l), column("f"), rtol=ALGEBRAIC)
    np.testing.assert_allclose(backlash.slope(law, l), column("df"), rtol=ALGEBRAIC)
    np.testing.assert_allclose(backlash.energy(law, l), column("U"), rtol=ALGEBRAIC)
    gap = 2 * backlash.offset(law) / law.stiffness
    np.testing.assert_allclose(
        gap, float(expected["gap_total_effective"]), rtol=ALGEBRAIC
    )


def test_force_and_slope_are_those_of_the_law_written_piece_by_piece():
    for law in random_laws():
        mesh = Mesh(
            between=("a", "b"),
            stiffness=law.stiffness,
            epsilon=law.epsilon,
            transition=law.transition,
            backlash=law.backlash,
        )
        force, share = dense.law(mesh, sweep_of(law))
        scale = law.stiffness * law.backlash
        np.testing.assert_allclose(
            backlash.force(law, sweep_of(law)), force, rtol=0, atol=ALGEBRAIC * scale
        )
        np.testing.assert_allclose(
            backlash.engagement(law, sweep_of(law)), share, rtol=0, atol=ALGEBRAIC
        )
        slope = law.stiffness * (law.epsilon + (1 - law.epsilon) * share)
        np.testing.assert_allclose(
            backlash.slope(law, sweep_of(law)),
            slope,
            rtol=0,
            atol=ALGEBRAIC * law.stiffness,
        )


def test_teeth_part_below_the_gap_and_are_stiff_beyond_the_knee():
    assert (DYADIC.gap, DYADIC.knee, DYADIC.knee - DYADIC.gap) == (
        0.1875,
        0.3125,
        DYADIC.width,
    )
    for law in random_laws():
        l = sweep_of(law)
        np.testing.assert_array_equal(
            backlash.separated(law, l),
            np.abs(l) < (1 - law.transition) * law.backlash / 2,
        )
        share = backlash.engagement(law, np.array([law.gap, law.knee]))
        np.testing.assert_allclose(share, [0.0, 1.0], rtol=0, atol=ALGEBRAIC)
        np.testing.assert_allclose(
            law.knee_force, backlash.force(law, law.knee), rtol=ALGEBRAIC
        )
        np.testing.assert_allclose(
            law.gap_spring_force,
            law.epsilon * law.stiffness * law.backlash / 2,
            rtol=ALGEBRAIC,
        )


def test_autodiff_of_the_force_is_the_slope_and_of_the_energy_the_force():
    for law in random_laws():
        l = sweep_of(law)
        slope = backlash.slope(law, l)
        np.testing.assert_allclose(
            per_sample(law, l)[1], slope, rtol=0, atol=ALGEBRAIC * law.stiffness
        )
        scale = law.stiffness * law.backlash
        np.testing.assert_allclose(
            energy_slopes(law, l)[1],
            backlash.force(law, l),
            rtol=0,
            atol=ALGEBRAIC * scale,
        )


def test_autodiff_at_every_knot_equals_both_neighbours_for_all_arguments():
    near = 1e-9
    for derivatives in (per_sample, energy_slopes):
        at_knots = jax.tree.leaves(derivatives(DYADIC, KNOTS))
        for side in (-near, near):
            beside = jax.tree.leaves(derivatives(DYADIC, KNOTS + side))
            for knot, neighbour in zip(at_knots, beside, strict=True):
                # Slopes change by at most near * 96 beside a knot.
                np.testing.assert_allclose(knot, neighbour, rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        per_sample(DYADIC, KNOTS)[1], backlash.slope(DYADIC, KNOTS), rtol=ALGEBRAIC
    )
    np.testing.assert_allclose(
        energy_slopes(DYADIC, KNOTS)[1],
        backlash.force(DYADIC, KNOTS),
        rtol=0,
        atol=ALGEBRAIC,
    )


@pytest.mark.parametrize("function", [backlash.force, backlash.energy])
def test_derivatives_with_respect_to_the_parameters_are_those_of_differences(function):
    # Away from the knots, where the third derivative that limits central differences
    # exists.
    l = np.array([-0.5, -0.27, -0.21, -0.1, 0.05, 0.24, 0.29, 0.4])
    derivatives = per_sample if function is backlash.force else energy_slopes
    direction = Law(0.6, -0.3, 0.5, -0.4)

    def moved(step):
        return jax.tree.map(lambda a, b: a + step * b, DYADIC, direction)

    slopes = jax.tree.map(np.multiply, derivatives(DYADIC, l)[0], direction)
    difference = (function(moved(1e-5), l) - function(moved(-1e-5), l)) / 2e-5
    np.testing.assert_allclose(
        sum(jax.tree.leaves(slopes)), difference, rtol=0, atol=GRADIENT
    )


@pytest.mark.parametrize("in_contact", [True, False])
def test_hand_written_slopes_of_the_mesh_force_are_those_of_autodiff(in_contact):
    draw = np.random.default_rng(6)
    slopes = jax.jit(
        jax.vmap(
            jax.grad(backlash.mesh_force, argnums=(3, 4)),
            in_axes=(None, None, None, 0, 0),
        )
    )
    for law in random_laws():
        l = sweep_of(law)
        rate = draw.normal(size=101)
        stiffness, damping = backlash.mesh_slopes(law, 0.7, in_contact, l, rate)
        by_autodiff = slopes(law, 0.7, in_contact, l, rate)
        scale = law.stiffness + 0.7 * np.abs(rate).max() / law.width
        np.testing.assert_allclose(
            stiffness, by_autodiff[0], rtol=0, atol=ALGEBRAIC * scale
        )
        np.testing.assert_allclose(damping, by_autodiff[1], rtol=0, atol=ALGEBRAIC)


def test_damping_in_contact_pulls_nothing_in_the_gap_and_damping_always_does():
    l = np.array([0.0, 0.1, -0.1, 0.4])
    rate = np.array([-2.0, -2.0, 2.0, -2.0])
    elastic = backlash.force(DYADIC, l)
    gated = backlash.mesh_force(DYADIC, 0.5, True, l, rate) - elastic
    always = backlash.mesh_force(DYADIC, 0.5, False, l, rate) - elastic
    np.testing.assert_allclose(gated, [0, 0, 0, -1.0], rtol=0, atol=ALGEBRAIC)
    np.testing.assert_allclose(always, [-1.0, -1.0, 1.0, -1.0], rtol=0, atol=ALGEBRAIC)

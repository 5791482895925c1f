"""Exact integrals of a mesh force: against closed forms and many samples; their
derivatives.
"""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from differences import differences
from reference_data import method_case
from trains import branched_parts, build

from jaxhb import Mesh
from jaxhb.equations import backlash, exact_integrals, fourier
from jaxhb.equations.backlash import Law
from jaxhb.train.mesh_parameters import all_meshes

EXACT = 1e-13
"""Degree of the polynomials of a cell, for any spectrum of the deflection; relative to
the largest force.
"""

HARMONICS = 6
MESHES = 2


@partial(jax.jit, static_argnames="samples")
def coefficients(law, viscous, gated, deflection, samples=None):
    """Coefficients of the mesh force, exact or sampled, at 1.3 rad/s."""
    rule = (
        fourier.Equidistant(samples)
        if samples
        else exact_integrals.quadrature(law, deflection)
    )
    rate = fourier.derivative(deflection, 1.3)
    l = rule.synthesize(deflection)
    rate = rule.synthesize(rate)
    values = backlash.mesh_force(law.expand(), viscous[:, None], gated, l, rate)
    return rule.analyze(values, deflection.shape[-1] - 1)


locate = jax.jit(exact_integrals.find_crossings)


def motion(seed, *, decay=1.0):
    """Random deflections that pass the gap many times, and a law and damping for
    each.
    """
    draw = np.random.default_rng(seed)
    shape = (MESHES, HARMONICS + 1)
    l = draw.normal(size=shape) + 1j * draw.normal(size=shape)
    l /= np.maximum(1, np.arange(HARMONICS + 1)) ** decay
    l[:, 0] = 0.3 * l[:, 0].real
    l /= np.abs(l).sum(-1, keepdims=True)
    law = Law(
        np.array([1.0, 2.0]),
        np.array([0.02, 0.1]),
        np.array([0.3, 0.1]),
        np.array([0.4, 0.5]),
    )
    return law, np.array([0.3, 0.2]), l


def test_case_a6_closed_form_of_a_cosine():
    params, expected = method_case("A6_fourier_coefs_Acos")
    law = Law(
        stiffness=np.full(MESHES, float(params["c"])),
        epsilon=np.full(MESHES, float(params["eps"])),
        transition=np.full(MESHES, 0.2),
        backlash=np.full(MESHES, float(params["h"])),
    )
    l = np.zeros((MESHES, 12), complex)
    l[:, 1] = float(params["A"]) / 2 * np.exp(1j * np.array([0.0, 0.7]))
    turn = np.exp(-1j * np.arange(12) * np.array([0.0, 0.7])[:, None])
    forces = turn * coefficients(law, np.zeros(MESHES), False, l)
    for k, value in expected["f_hat"].items():
        np.testing.assert_allclose(forces[:, int(k)], float(value), rtol=0, atol=EXACT)


def test_a_mesh_without_backlash_has_no_knots_to_pass():
    """However fast its force changes sign: at harmonic 6 of 6 it would take more room
    than there is.
    """
    parts = [
        dataclasses.replace(e, backlash=None) if isinstance(e, Mesh) else e
        for e in branched_parts()
    ]
    law = all_meshes(build(parts, reference="flywheel")).law
    l = np.zeros((len(law.stiffness), HARMONICS + 1), complex)
    l[:, -1] = 1e-4
    crossings = locate(law, l)
    assert crossings.complete
    assert not np.any(crossings.inverse_rate)


@pytest.mark.parametrize(
    ("gated", "transition"), [(False, 0.2), (True, 0.2), (False, 1e-6)]
)
def test_integrals_are_those_of_many_samples_however_short_the_transition(
    gated, transition
):
    law, viscous, l = motion(2)
    law = dataclasses.replace(law, transition=np.full(MESHES, transition))
    viscous = viscous if transition > 1e-3 else 0 * viscous
    exact = coefficients(law, viscous, gated, l)
    sampled = coefficients(law, viscous, gated, l, samples=2**21)
    np.testing.assert_allclose(exact, sampled, rtol=0, atol=1e-10)


def test_room_that_is_too_small_is_told():
    law, _, l = motion(2)
    assert locate(law, l).complete
    fast = np.zeros((MESHES, 65), complex)
    fast[:, 64] = 0.3
    assert not locate(law, fast).complete


def objective(theta, gated):
    """A weighted sum of all coefficients, from packed deflections, law and damping in
    one vector.
    """
    width = 2 * HARMONICS + 1
    l = fourier.unpack(theta[: MESHES * width].reshape(MESHES, width))
    law = Law(*theta[MESHES * width : -MESHES].reshape(4, MESHES))
    weight = np.random.default_rng(4).normal(size=(MESHES, width))
    return (fourier.pack(coefficients(law, theta[-MESHES:], gated, l)) * weight).sum()


@partial(jax.jit, static_argnums=1)
@partial(jax.vmap, in_axes=(0, None))
def gradient(theta, gated):
    return jax.value_and_grad(objective)(theta, gated)


def test_sampling_comes_near_with_its_order():
    """Elastic forces have a continuous slope: order 3 in the number of samples; damping
    in contact: order 2.
    """
    counts = np.array([2**8, 2**10, 2**12])
    for gated, order in ((False, 3), (True, 2)):
        apart = np.zeros((6, len(counts)))
        # The error of a motion depends on where its knots fall among the samples.
        for seed in range(6):
            law, viscous, l = motion(seed)
            exact = coefficients(law, viscous, gated, l)
            for i, count in enumerate(counts):
                sampled = coefficients(law, viscous, gated, l, samples=int(count))
                apart[seed, i] = np.linalg.norm(sampled - exact)
        slope = np.polyfit(np.log(counts), np.log(np.sqrt((apart**2).mean(0))), 1)[0]
        assert abs(slope + order) < 0.4


def one_gradient(theta):
    """Value and gradient, damped in contact, in a batch as large as that of the
    differences: one program.
    """
    values, slopes = gradient(np.tile(theta, (4 * len(theta), 1)), True)
    return values[0], slopes[0]


hessian = jax.jit(jax.hessian(objective), static_argnums=1)


def packed(law, viscous, l):
    return np.concatenate(
        [np.ravel(fourier.pack(jnp.asarray(l))), *jax.tree.leaves(law), viscous]
    )


@pytest.mark.slow
def test_first_and_second_derivatives_are_those_of_differences():
    """In deflections, stiffness, epsilon, transition, backlash and damping;
    fourth-order differences: 1e-9 at worst.
    """
    law, viscous, l = motion(3)
    theta = packed(law, viscous, l)
    gradients = []

    def value(at):
        values, slopes = gradient(at, True)
        gradients.append(np.asarray(slopes))
        return values

    first = differences(value, theta, np.full(len(theta), 1e-4))
    near, back, far, farther = np.split(gradients[0], 4)
    _, slopes = one_gradient(theta)
    np.testing.assert_allclose(slopes, first, rtol=0, atol=1e-9 * np.abs(first).max())
    second = (8 * (near - back) - (far - farther)) / 12e-4
    np.testing.assert_allclose(
        hessian(theta, True), second, rtol=0, atol=1e-8 * np.abs(second).max()
    )


@pytest.mark.slow
def test_derivatives_are_finite_at_rest_on_a_knot_and_at_a_grazing_passage():
    law, viscous, l = motion(3)
    thetas = []
    for mean in (law.gap, 0.14, 0.26):
        for amplitude in (0.0, 0.1):
            resting = np.zeros_like(l)
            # Touches l = mean at t = 0.
            resting[:, 0] = mean - amplitude
            resting[:, 1] = amplitude / 2
            thetas.append(packed(law, viscous, resting))
    size = len(thetas[0])
    value, first = gradient(np.resize(thetas, (4 * size, size)), True)
    assert np.isfinite(value).all()
    assert np.isfinite(first).all()
    assert all(np.isfinite(hessian(theta, True)).all() for theta in thetas)

"""The derivative of a solve with two meshes separating, in a batch some lanes of which
fail.
"""

import dataclasses
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from differences import separating_plan
from trains import branched_parts, build

import jaxhb

KEYS = [
    "flywheel.inertia",
    "crank gear|idler.stiffness",
    "flywheel|crank gear.stiffness",
    "crank gear|idler.damping",
    "pump gear|pump.loss_factor",
    "pump gear|idler.backlash",
    "pump gear.radius",
    "flywheel:torque.harmonics",
    "crank gear|idler.epsilon",
    "pump gear|idler.transition",
    "ring.damping",
    "pump gear|idler.damping",
]
RPM = len(KEYS)
ONES = np.ones(RPM + 1)
ALONG = np.random.default_rng(0).normal(size=RPM + 1)


SEPARATING = separating_plan()
AVERAGED = dataclasses.replace(SEPARATING, averaged=True)


@cache
def train():
    return build(branched_parts(), reference="crank gear")


def read(response):
    """One number that every part of the response enters."""
    tooth = response.force("crank gear", "idler").smooth_peak(8) / 700
    other = response.force("pump gear", "idler").half_peak_to_peak / 300
    shaft = response.torque("pump gear", "pump").order(1.0) / 10
    return tooth + other + shaft + 1e4 * response.twist("flywheel", "crank gear").rms


def changed(factors, rpm, plan):
    values = {
        key: train().value(key) * factor
        for key, factor in zip(KEYS, factors[:-1], strict=True)
    }
    return jaxhb.solve(train().replace(values), rpm=rpm * factors[RPM], plan=plan)


@pytest.fixture(scope="module")
def batch():
    """A batch linearised: plain, without convergence, not finite, plain, backwards; and
    plain ones alone.

    Each (value, aux), gradient, change along ALONG.
    """

    def value(factors):
        response = changed(factors, 1500.0, SEPARATING)
        return read(response), (response.status, response.deflection_samples(512))

    def lane(factors):
        number, push, aux = jax.linearize(value, factors, has_aux=True)
        return (number, aux), jax.linear_transpose(push, factors)(1.0)[0], push(ALONG)

    plain = np.tile(ONES, (5, 1))
    linearised = jax.jit(jax.vmap(lane))
    lanes = plain.copy()
    lanes[1:, RPM] = 0.6, 1.0, 1.001, -1.0
    lanes[2, KEYS.index("flywheel.inertia")] = np.nan
    with pytest.warns(
        UserWarning, match="half_peak_to_peak is differentiated at one time sample"
    ):
        batches = linearised(lanes), linearised(plain)
    return jax.tree.map(np.asarray, batches)


@pytest.mark.slow
def test_a_failed_lane_has_zero_gradient_and_spoils_no_other(batch):
    ((_, (status, deflection)), gradient, along), (_, alone, _) = batch
    gap = 0.5 * (1 - 0.3) * 1e-4
    separated = np.mean(np.abs(deflection[0]) < gap, axis=-1)
    assert np.all(separated > 0.05)  # of both meshes
    assert status[0] == status[3] == jaxhb.Status.CONVERGED
    assert status[1] == jaxhb.Status.MAX_STEPS
    assert status[2] == jaxhb.Status.NONFINITE
    assert status[4] == jaxhb.Status.INVALID_INPUT
    assert not gradient[[1, 2, 4]].any()
    assert np.isnan(along[1])
    assert np.isfinite(gradient).all()
    assert np.all(gradient[0] != 0)
    np.testing.assert_allclose(gradient[0], alone[0], rtol=1e-9)
    # A neighbour, in speed 0.1 % away.
    assert np.abs(gradient[3] / gradient[0] - 1).max() < 1


def test_the_error_of_a_gradient_is_its_change_with_twice_the_harmonics_or_nan():
    """A function whose derivative is known for every number of harmonics; nan where
    nothing is solved.
    """

    def parabola(x, plan):
        value = (1 + 1 / plan.harmonics) * x["a"] ** 2 - x["b"] / plan.harmonics
        return jax.numpy.where(x["a"] > 0, value, np.nan)

    value, gradient, error = jaxhb.gradient_and_error(
        parabola, {"a": 3.0, "b": 64.0}, plan=SEPARATING
    )
    assert (value, gradient["a"], gradient["b"]) == pytest.approx(
        (9 * (1 + 1 / 64) - 1, 6 * (1 + 1 / 64), -1 / 64)
    )
    assert (error["a"], error["b"]) == pytest.approx((6 / 64, 1 / 64))
    unknown = jax.jit(lambda x: jaxhb.gradient_and_error(parabola, x, plan=SEPARATING))(
        {"a": -3.0, "b": 64.0}
    )
    assert np.isnan(jax.tree.leaves(unknown)).all()


@partial(jax.jit, static_argnums=2)
def values_and_derivatives(factors, along, plan):
    """Two numbers of a response, of which :func:`read` has a corner; their change along
    a direction; and the status.
    """

    def values(factors):
        response = changed(factors, 1500.0, plan)
        tooth = response.force("crank gear", "idler").smooth_peak(8) / 700
        shaft = response.torque("pump gear", "pump").order(1.0) / 10
        return jnp.stack([tooth + shaft, read(response)]), response.status

    return jax.jvp(values, (factors,), (along,), has_aux=True)


# Programs warn when they are traced, once: the batch above looks for it.
one_sample = pytest.mark.filterwarnings("ignore:.half_peak_to_peak is differentiated")


@pytest.mark.slow
@one_sample
def test_differences_of_values_under_a_plan_are_its_derivative_where_teeth_hammer():
    """Their law has kinks: derivatives are those of the forces that the equations
    balance, not of samples of slopes.
    """
    along = 0.1 * ALONG
    step = 1e-5

    def number_at(share):
        return float(
            values_and_derivatives(ONES + share * along, along, AVERAGED)[0][1]
        )

    derivative = float(values_and_derivatives(ONES, along, AVERAGED)[1][1])
    # Differences err by the square of the step, and by rounding and what is left of the
    # equations over the step.
    expected = (number_at(step) - number_at(-step)) / (2 * step)
    assert derivative == pytest.approx(expected, rel=1e-6)


@pytest.mark.slow
@one_sample
def test_the_derivatives_of_sampled_integrals_are_those_of_exact_ones():
    """Backwards, and second derivatives: test_meshing.py, test_derivative_paths.py."""
    exact_plan = dataclasses.replace(AVERAGED, integrals="exact")
    slopes = {AVERAGED: [], exact_plan: []}
    for name in (
        "crank gear|idler.stiffness",
        "crank gear|idler.damping",
        "pump gear|idler.backlash",
        "pump gear|idler.damping",
        "ring.damping",
    ):
        along = np.eye(len(ONES))[KEYS.index(name)]
        for plan, of_plan in slopes.items():
            _, slope, status = values_and_derivatives(ONES, along, plan)
            assert status == jaxhb.Status.CONVERGED
            of_plan.append(float(slope[0]))
    sampled, exact = map(np.array, slopes.values())
    # Order 2 in the samples, with a constant that depends on where the knots fall: 8e-4
    # at the 16 of the solve.
    assert np.abs(sampled - exact).max() < 3e-5 * np.abs(exact).max()

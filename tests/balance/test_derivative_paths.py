"""The derivative of a solve: the table of the benchmark; contact, cylinders, second
order, knots of the law.
"""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from derivatives import PLANS, parameters, table
from differences import compare, differences, tight_plan
from tolerances import GRADIENT, PATHS, TANGENT
from trains import ONE_RADIAN_PER_SECOND, build, one_mass_parts

import jaxhb

pytestmark = pytest.mark.slow


@cache
def one_mass():
    return build(
        one_mass_parts(m=1.0, b=0.3, c=4.0, eps=0.05, h=0.5, q0=0.3, q1=1.0),
        reference="a",
    )


ONE_MASS = np.array([4.0, 0.6, 0.5, 0.3, 1.0])
"""Stiffness, damping of gear a, backlash, mean torque and its first order."""


def one_mass_peak(values, integrals="sampled", max_steps=12):
    stiffness, damping, backlash, mean, order = values
    rows = [jnp.stack([sense * order, 0.0 * order])[None] for sense in (1, -1)]
    train = one_mass().replace(
        {"a|b.stiffness": stiffness, "a.damping": damping, "a|b.backlash": backlash}
        | {
            "a:torque.mean": mean,
            "b:torque.mean": -mean,
            "a:torque.harmonics": rows[0],
            "b:torque.harmonics": rows[1],
        }
    )
    plan = tight_plan(
        harmonics=8,
        active=(0,),
        flank=(0,),
        excited=1,
        integrals=integrals,
        start="march",
        max_steps=max_steps,
        tolerance=0.5,
    )
    response = jaxhb.solve(train, rpm=ONE_RADIAN_PER_SECOND, plan=plan)
    return (
        response.force("a", "b").smooth_peak(8) + response.twist("a", "b").rms,
        response.status,
    )


@pytest.fixture(scope="module")
def second_derivative():
    """Function of one mass: values, along -> (Hessian times along, gradient, status).

    One direction at a time: all of them at once are a program that takes half as long
    again to trace.
    """

    def gradient(values):
        return jax.grad(one_mass_peak, has_aux=True)(values, integrals="exact")

    def derivative(values, direction):
        slopes, change, status = jax.jvp(
            gradient, (values,), (direction,), has_aux=True
        )
        return change, slopes, status

    return jax.jit(derivative)


def test_second_derivatives_with_exact_integrals_are_those_of_differences_of_gradients(
    second_derivative,
):
    directions = np.eye(len(ONE_MASS))
    hessian = np.array([second_derivative(ONE_MASS, axis)[0] for axis in directions])

    def gradient(values, direction):
        return second_derivative(values, direction)[1]

    steps = 1e-3 * ONE_MASS
    rows = [
        (gradient(ONE_MASS + step, step) - gradient(ONE_MASS - step, step))
        / (2 * step.max())
        for step in np.diag(steps)
    ]
    largest = np.abs(hessian).max()
    np.testing.assert_allclose(hessian, hessian.T, rtol=0, atol=TANGENT * largest)
    # Steps squared, times a few.
    np.testing.assert_allclose(hessian, rows, rtol=0, atol=1e-5 * largest)


def sizes_of(jaxpr):
    """Numbers in all arrays that a program makes."""
    parameters = [
        leaf
        for equation in jaxpr.eqns
        for leaf in jax.tree.leaves(
            list(equation.params.values()), is_leaf=lambda v: hasattr(v, "eqns")
        )
    ]
    inner = [
        getattr(leaf, "jaxpr", leaf)
        for leaf in parameters
        if hasattr(leaf, "jaxpr") or hasattr(leaf, "eqns")
    ]
    outputs = sum(
        np.prod(variable.aval.shape, dtype=int)
        for equation in jaxpr.eqns
        for variable in equation.outvars
    )
    return outputs + sum(sizes_of(part) for part in inner)


def test_the_memory_of_a_gradient_does_not_grow_with_the_newton_steps():
    """A tape of the steps would be an array with one row for each."""

    def numbers(steps):
        gradient = jax.grad(partial(one_mass_peak, max_steps=steps), has_aux=True)
        return sizes_of(jax.make_jaxpr(gradient)(ONE_MASS).jaxpr)

    assert numbers(4) == numbers(24) > 1000


@pytest.mark.parametrize("deflection", [0.0, 0.2, 0.3])
def test_derivatives_on_the_knots_of_the_law_are_finite_and_right(
    second_derivative, deflection
):
    """At rest on a knot at every time sample of the cycle: slope 0.2 at l = 0 and 0.2,
    4 at l = 0.3; and no amplitude.
    """
    force = 0.2 * deflection + (3.8 * 0.05 if deflection == 0.3 else 0.0)
    values = np.array([4.0, 0.6, 0.5, force, 0.0])
    for direction in np.eye(len(values)):
        change, gradient, status = second_derivative(values, direction)
        assert status == jaxhb.Status.CONVERGED
        assert np.isfinite(change).all()
        assert np.isfinite(gradient).all()
    if deflection:
        np.testing.assert_allclose(
            gradient[3], 1 + 1 / (4.0 if deflection == 0.3 else 0.2), rtol=PATHS
        )


ENGINE_KEYS = ("stroke", "rod", "bore", "reciprocating_mass", "firing_angle")


def test_cylinder_data_differentiate():
    engine = jaxhb.load_scene("six_cylinder_diesel")
    plan = jaxhb.plan(engine, rpm=1500.0)
    assert plan.active == ()
    at = np.array([engine.value(f"cylinder 3.{key}") for key in ENGINE_KEYS])

    def value(numbers):
        changes = {
            f"cylinder 3.{key}": number
            for key, number in zip(ENGINE_KEYS, numbers, strict=True)
        }
        response = jaxhb.solve(engine.replace(changes), rpm=1500.0, plan=plan)
        return (
            response.torque("cyl6", "flywheel").smooth_peak(16)
            + response.torque("cyl1", "cyl2").rms
        )

    gradient = jax.jit(jax.grad(value))(at)
    slopes = differences(jax.jit(jax.vmap(value)), at, 1e-4 * at)
    compare(gradient * at, slopes * at, GRADIENT)


def test_without_a_plan_differentiation_outside_jit_works():
    pair = jaxhb.load_scene("spur_pair")

    def peak(stiffness, rpm):
        train = pair.replace({"gear a|gear b.stiffness": stiffness})
        return jaxhb.solve(train, rpm=rpm).force("gear a", "gear b").max

    at = (2e8, 3000.0)
    gradient = jax.grad(peak, argnums=(0, 1))(*at)
    by_stiffness = (peak(2e8 + 2e3, 3e3) - peak(2e8 - 2e3, 3e3)) / 4e3
    by_speed = (peak(2e8, 3e3 + 0.03) - peak(2e8, 3e3 - 0.03)) / 0.06
    compare(np.array(gradient), [by_stiffness, by_speed], GRADIENT)
    assert jax.jvp(peak, at, (1.0, 0.0))[1] == pytest.approx(
        float(gradient[0]), rel=TANGENT
    )


CASES = [(path, kind) for path in PLANS if path != "exact" for kind in parameters(path)]


@pytest.mark.parametrize(("path", "kind"), CASES)
def test_a_derivative_is_that_of_differences_and_forwards_is_backwards(path, kind):
    row = next(row for row in table(path) if row["kind"] == kind)
    assert row["solved"]
    assert row["error"] < GRADIENT
    assert row["transpose"] < TANGENT
    assert abs(row["gradient"]) > 0
    assert np.isfinite(row["gradient"])


def test_the_paths_are_what_they_are_called():
    assert all(table(path)[0]["apart"] > 0.05 for path in ("reduced", "chain"))
    assert table("contact")[0]["apart"] == 0

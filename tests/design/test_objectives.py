"""Objectives: each against the number it smooths, its bound, its derivative, and its
value where speeds fail.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tolerances import ALGEBRAIC, GRADIENT
from trains import branched_parts, build

import jaxhb
from jaxhb.design import objectives


@pytest.fixture(scope="module")
def response():
    """A ring, shafts and two meshes at a speed at which their teeth part."""
    train = build(branched_parts(), reference="crank gear")
    plan = jaxhb.Plan(
        harmonics=64,
        time_steps=768,
        tolerance=0.5,
        active=(0, 1),
        flank=(0, 0),
        start="march",
        excited=3,
    )
    response = jaxhb.solve(train, rpm=1500.0, plan=plan)
    assert response.converged
    return response


@pytest.fixture(scope="module")
def sweep(response):
    """Four speeds, the third of which failed and holds nan."""
    repeated = jax.tree.map(lambda a: jnp.asarray(np.stack([a] * 4)), response)
    forces = np.array([1.0, 1.2, np.nan, 0.9])[:, None, None] * repeated.forces
    return dataclasses.replace(
        repeated, forces=jnp.asarray(forces), status=jnp.array([0, 1, 3, 0])
    )


CRANK = "crank gear"
IDLER = "idler"
SCALABLE = ("angles", "torques", "deflections", "forces")


@pytest.mark.slow
def test_derivatives_are_those_of_differences(response):
    @jax.jit
    @jax.vmap
    def values(factor):
        scaled = dataclasses.replace(
            response, **{name: factor * getattr(response, name) for name in SCALABLE}
        )
        usable = objectives.usable(scaled)
        numbers = [
            objectives.tooth_force(scaled, CRANK, IDLER),
            objectives.shaft_torque(scaled, "flywheel", CRANK),
            objectives.damper_power(scaled, "ring"),
            objectives.separated_fraction(scaled, CRANK, IDLER),
            objectives.impact_severity(scaled, CRANK, IDLER),
            usable.force(CRANK, IDLER).smooth_peak(),
            usable.torque("flywheel", CRANK).order(2.0),
        ]
        return jnp.stack(numbers)

    step = 1e-5
    back, ahead = values(1 + step * np.array([-1.0, 1.0]))
    slopes = jax.jvp(values, (np.ones(1),), (np.ones(1),))[1][0]
    assert np.all(slopes != 0)
    np.testing.assert_allclose(slopes, (ahead - back) / (2 * step), rtol=GRADIENT)


@pytest.mark.slow
def test_smooth_half_peak_to_peak_keeps_its_bound(response):
    for p in (16, 64, 256):
        exact = float(response.force(CRANK, IDLER).half_peak_to_peak)
        assert (
            exact * response.resolution ** (-1 / p)
            <= objectives.tooth_force(response, CRANK, IDLER, p=p)
            <= exact
        )


@pytest.mark.slow
def test_smoothed_contact_tends_to_what_the_contact_reports(response):
    contact = response.mesh(CRANK, IDLER)
    assert contact.impacts
    apart = objectives.separated_fraction(response, CRANK, IDLER, smoothing=1e-3)
    assert apart == pytest.approx(contact.separated_fraction, abs=2e-3)
    severity = objectives.impact_severity(response, CRANK, IDLER, smoothing=1e-2)
    # The speed changes while the teeth pass the smooth edge, 2 % of the backlash.
    assert severity == pytest.approx(
        sum(impact["speed"] for impact in contact.impacts), rel=0.05
    )


@pytest.mark.slow
def test_failed_speeds_count_as_nothing_and_are_told(sweep):
    def sum_and_worst(factor):
        solved = sweep.forces.at[np.array([0, 1, 3])]
        scaled = dataclasses.replace(
            sweep, forces=solved.multiply(factor, unique_indices=True)
        )
        forces = objectives.tooth_force(scaled, CRANK, IDLER)
        total, count = objectives.weighted_sum(
            forces, scaled, weights=jnp.arange(1.0, 5.0)
        )
        largest, _ = objectives.worst(forces, scaled, width=10.0)
        return total + largest, (forces, count, total, largest)

    gradient, values = jax.jit(jax.grad(sum_and_worst, has_aux=True))(1.0)
    forces, count, total, largest = map(np.asarray, values)
    assert count == 3
    assert forces[2] == 0
    assert np.isfinite(gradient)
    assert forces.max() <= largest <= forces.max() + 10 * np.log(3)
    assert total == pytest.approx(
        float(forces[0] + 2 * forces[1] + 4 * forces[3]), rel=ALGEBRAIC
    )


@pytest.mark.slow
def test_no_valid_speed_gives_zero_of_nothing(sweep):
    lost = dataclasses.replace(sweep, status=jnp.full(4, 3))

    def largest(factor):
        return objectives.worst(
            factor * objectives.tooth_force(lost, CRANK, IDLER), lost, width=10.0
        )

    values, slope = jax.jit(jax.value_and_grad(largest, has_aux=True))(1.0)
    assert slope == 0
    assert [float(value) for value in values] == [0.0, 0.0]


@pytest.mark.slow
def test_a_mesh_without_backlash_never_parts(response):
    rigid = dataclasses.replace(
        response,
        topology=dataclasses.replace(response.topology, mesh_backlash=(False, True)),
    )
    for quantity in (objectives.separated_fraction, objectives.impact_severity):
        with pytest.raises(
            jaxhb.SceneError,
            match="'crank gear|idler' has no backlash, its teeth never part",
        ):
            quantity(rigid, CRANK, IDLER)

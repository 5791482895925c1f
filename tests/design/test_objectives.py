"""Objectives: each against the number it smooths, its bound, its derivative, and what
failed speeds do to it.
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
    both = {"active": (0, 1), "flank": (0, 0), "start": "march", "excited": 3}
    response = jaxhb.solve(
        train,
        rpm=1500.0,
        plan=jaxhb.Plan(harmonics=64, time_steps=768, tolerance=0.5, **both),
    )
    assert response.converged
    return response


@pytest.fixture(scope="module")
def sweep(response):
    """Four speeds, the third of which failed and holds nan."""
    several = jax.tree.map(lambda a: jnp.asarray(np.stack([a] * 4)), response)
    forces = np.array([1.0, 1.2, np.nan, 0.9])[:, None, None] * several.forces
    return dataclasses.replace(
        several, forces=jnp.asarray(forces), status=jnp.array([0, 1, 3, 0])
    )


MESH = ("crank gear", "idler")
SCALABLE = ("angles", "torques", "deflections", "forces")


def test_derivatives_are_those_of_differences(response):
    @jax.jit
    @jax.vmap
    def values(factor):
        r = dataclasses.replace(
            response, **{name: factor * getattr(response, name) for name in SCALABLE}
        )
        read = (
            objectives.tooth_force(r, *MESH),
            objectives.shaft_torque(r, "flywheel", "crank gear"),
        )
        read += (
            objectives.damper_power(r, "ring"),
            objectives.separated_fraction(r, *MESH),
        )
        read += (
            objectives.impact_severity(r, *MESH),
            objectives.usable(r).force(*MESH).smooth_peak(),
        )
        return jnp.stack(
            [*read, objectives.usable(r).torque("flywheel", "crank gear").order(2.0)]
        )

    step = 1e-5
    back, ahead = values(1 + step * np.array([-1.0, 1.0]))
    slopes = jax.jvp(values, (np.ones(1),), (np.ones(1),))[1][0]
    assert np.all(slopes != 0)
    np.testing.assert_allclose(slopes, (ahead - back) / (2 * step), rtol=GRADIENT)


def test_smooth_half_peak_to_peak_keeps_its_bound(response):
    for p in (16, 64, 256):
        true = float(response.force(*MESH).half_peak_to_peak)
        assert (
            true * response.resolution ** (-1 / p)
            <= objectives.tooth_force(response, *MESH, p=p)
            <= true
        )


def test_smoothed_contact_tends_to_what_the_contact_reports(response):
    contact = response.mesh(*MESH)
    assert contact.impacts
    apart = objectives.separated_fraction(response, *MESH, smoothing=1e-3)
    assert apart == pytest.approx(contact.separated_fraction, abs=2e-3)
    severity = objectives.impact_severity(response, *MESH, smoothing=1e-2)
    # the speed changes while the teeth pass the smooth edge, 2 % of the backlash
    assert severity == pytest.approx(
        sum(impact["speed"] for impact in contact.impacts), rel=0.05
    )


def test_failed_speeds_count_as_nothing_and_are_told(sweep):
    def both(factor):
        kept = sweep.forces.at[np.array([0, 1, 3])].multiply(
            factor, unique_indices=True
        )
        scaled = dataclasses.replace(sweep, forces=kept)
        forces = objectives.tooth_force(scaled, *MESH)
        total, count = objectives.weighted_sum(
            forces, scaled, weights=jnp.arange(1.0, 5.0)
        )
        largest, _ = objectives.worst(forces, scaled, width=10.0)
        return total + largest, (forces, count, total, largest)

    gradient, told = jax.jit(jax.grad(both, has_aux=True))(1.0)
    forces, count, total, largest = map(np.asarray, told)
    assert count == 3
    assert forces[2] == 0
    assert np.isfinite(gradient)
    assert forces.max() <= largest <= forces.max() + 10 * np.log(3)
    assert total == pytest.approx(
        float(forces[0] + 2 * forces[1] + 4 * forces[3]), rel=ALGEBRAIC
    )


def test_no_valid_speed_gives_zero_of_nothing(sweep):
    lost = dataclasses.replace(sweep, status=jnp.full(4, 3))

    def largest(factor):
        return objectives.worst(
            factor * objectives.tooth_force(lost, *MESH), lost, width=10.0
        )

    found, slope = jax.jit(jax.value_and_grad(largest, has_aux=True))(1.0)
    assert slope == 0
    assert [float(v) for v in found] == [0.0, 0.0]


def test_a_mesh_without_backlash_never_parts(response):
    never = dataclasses.replace(
        response,
        topology=dataclasses.replace(response.topology, mesh_backlash=(False, True)),
    )
    for quantity in (objectives.separated_fraction, objectives.impact_severity):
        with pytest.raises(
            jaxhb.SceneError,
            match="'crank gear|idler' has no backlash, its teeth never part",
        ):
            quantity(never, *MESH)

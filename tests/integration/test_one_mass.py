"""Exact periodic motions of one mass with backlash."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from integrated_trains import one_mass
from reference_data import method_case, reference

from jaxhb.equations.state_space import partition
from jaxhb.integration.shooting import monodromy, shoot
from jaxhb.integration.step import cycle, discretize, march

cut = jax.jit(discretize, static_argnames=("steps", "parts"))
correct = jax.jit(shoot)
multiply = jax.jit(monodromy)
run = jax.jit(cycle)


def stepper_of(case, frequency, load, steps):
    system, meshes = case
    return cut(
        system,
        meshes,
        frequency,
        np.array([load], complex),
        steps=steps,
        parts=partition(system, meshes),
    )


def state_of(stepper, x, v):
    return stepper.space.coordinates @ jnp.stack([x, v]) - stepper.linear_state


def exact(steps):
    """Errors of x(0), x'(0), trace and determinant of the monodromy matrix of the case
    of docs/theory A7.
    """
    case = one_mass(
        mass=1, damping=0.2, stiffness=4, epsilon=0.05, transition=0.2, backlash=0.2
    )
    stepper = stepper_of(case, 1.0, [0.3, 0.5], steps)
    start, *_ = jax.jit(march)(stepper, stepper.flank_state)
    state, periodicity_error, _ = correct(stepper, start)
    assert periodicity_error < 1e-11
    _, trace = run(stepper, state)
    matrix, _ = multiply(stepper, state)
    numbers = [
        trace.deflection[0, 0],
        trace.rate[0, 0],
        jnp.trace(matrix),
        jnp.linalg.det(matrix),
    ]
    _, expected = method_case("A7_true_periodic_one_mass")
    keys = ("x0", "v0", "monodromy_trace", "monodromy_det")
    return np.abs(np.array(numbers) - [float(expected[key]) for key in keys])


@pytest.mark.slow
def test_the_exact_periodic_motion_and_its_multipliers_are_found_with_order_three():
    errors = exact(4096)
    assert errors[:2].max() < 2e-9
    assert errors[2] < 1e-5
    assert errors[3] < 1e-11
    assert np.log2(exact(256)[:2] / errors[:2]).min() / 4 > 2.7


@pytest.mark.slow
def test_sharp_dead_zone_solutions_are_approached_quadratically_in_the_transition():
    rows = reference("backlash_one_mass_exact")["kahraman_singh_form"]["rows"]
    rows = [row for row in rows if row["Omega"] in (0.8, 0.9, 1.1, 1.3)]
    assert len(rows) >= 8
    errors = {0.01: [], 0.001: []}
    cases = [(transition, row) for transition in errors for row in rows]
    for transition, row in cases:
        case = one_mass(
            mass=1,
            damping=0.1,
            stiffness=1,
            epsilon=0,
            transition=transition,
            backlash=2,
        )
        load = [0.1, -0.5j * 0.05 * row["Omega"] ** 2]
        stepper = stepper_of(case, row["Omega"], load, 4096)
        x, v = row["y0"]
        state = correct(stepper, state_of(stepper, x, v))[0]
        values = np.asarray(run(stepper, state)[1].deflection[0])
        amplitudes = 2 * np.abs(np.fft.rfft(values)[1:4]) / values.size
        errors[transition].append(np.abs(amplitudes - row["amp_h"][:3]).max())
        multipliers = np.sort(np.abs(np.linalg.eigvals(multiply(stepper, state)[0])))
        np.testing.assert_allclose(multipliers, np.sort(row["floquet_abs"]), atol=1e-11)
        assert abs(values.max() - row["max"]) < 3 * transition**2
    assert max(errors[0.01]) < 3e-4
    assert max(errors[0.001]) < 3e-6

"""The variational equation around prescribed motions, and around a motion of a train
that is integrated in time.
"""

from functools import cache

import jax
import numpy as np
import pytest
from integrated_trains import one_mass, posed
from reference_data import DATA, method_case

import jaxhb
from jaxhb.equations import exact_integrals, fourier
from jaxhb.equations.state_space import partition, state_space
from jaxhb.floquet import variational
from jaxhb.integration.reference import reference_orbit
from jaxhb.integration.step import cycle_error

space_of = jax.jit(state_space, static_argnames="parts")
after_cycle = jax.jit(
    jax.vmap(lambda stepper, state: cycle_error(stepper, state)[0], in_axes=(None, 0))
)


def in_displacements(matrix, space):
    """A monodromy matrix of one mass in x and x'."""
    return np.linalg.solve(space.coordinates, matrix @ space.coordinates)


@cache
def mathieu(steps):
    """Error of the monodromy matrix of ``x'' + b x' + (c0 + a cos 2t) x = 0``, slope of
    a law in its smooth zone.
    """
    params, expected = method_case("A7_damped_mathieu_monodromy")
    b, c0, a = (float(params[key]) for key in ("b", "c0", "a"))
    contact = 3.0
    gap = 0.3
    system, meshes = one_mass(
        mass=1,
        damping=b,
        stiffness=contact,
        epsilon=gap / contact,
        transition=0.2,
        backlash=1.0,
    )
    middle = 0.4 + 0.2 * (c0 - gap) / (contact - gap)
    swing = 0.2 * a / (contact - gap)
    deflection = np.array([[middle, 0.0, swing / 2]], dtype=complex)
    parts = partition(system, meshes)
    space = jax.tree.map(np.asarray, space_of(system, meshes, 1.0, parts=parts))
    times = np.arange(steps) / steps
    monodromy = variational.monodromy(space, meshes, deflection, 1.0, times)
    assert abs(monodromy.log_determinant + 2 * np.pi * b) < 1e-6
    matrix = in_displacements(monodromy.matrix, space)
    return np.abs(matrix - np.array(expected["Phi"], dtype=float)).max()


def test_the_damped_mathieu_equation_is_solved_to_rounding():
    # The norm of the matrix asks for three steps a cycle.
    assert mathieu(1) < 1e-8
    assert mathieu(16) < 1e-12


def test_collocation_has_twice_the_order_of_its_nodes(monkeypatch):
    """Twenty with ten nodes: at steps that are far longer than those taken, as errors
    are soon lost in rounding.
    """
    monkeypatch.setattr(variational, "REACH", 1e3)
    mathieu.cache_clear()
    order = np.log(mathieu(3) / mathieu(5)) / np.log(5 / 3)
    mathieu.cache_clear()
    assert order > 2 * variational.STAGES - 2


def test_more_steps_than_memory_holds_are_a_sentence(monkeypatch):
    mathieu.cache_clear()
    monkeypatch.setattr(variational, "MOST_SLOPES", 10)
    with pytest.raises(
        ValueError,
        match=(
            r"stability would take \S+ steps a cycle, as teeth stay in the smooth zone"
        ),
    ):
        mathieu(1)


def test_a_motion_is_known_between_its_samples():
    rng = np.random.default_rng(0)
    orders = np.arange(41)
    deflection = rng.normal(size=(2, 41)) + 1j * rng.normal(size=(2, 41))
    deflection = deflection / (1 + orders) ** 2
    deflection[:, 0] = deflection[:, 0].real
    share = rng.uniform(size=30)
    sides = np.append(1.0, np.full(40, 2.0))  # every harmonic but the mean counts twice
    wave = np.exp(2j * np.pi * np.outer(orders, share)) * sides[:, None]
    rate = fourier.derivative(deflection, 3.0)
    expected = np.stack([(deflection @ wave).real, (rate @ wave).real])
    np.testing.assert_allclose(
        variational.motion(deflection, 3.0, share), expected, rtol=0, atol=1e-10
    )


def three_disks(damping_law):
    """A lightly loaded pair of gears driven through a shaft: the teeth separate and
    strike at 900 rpm.
    """
    train = jaxhb.load_scene(DATA / "scenes" / "driven_pair.toml")
    return train.replace({"pinion|wheel.damping_law": damping_law})


@pytest.mark.slow
@pytest.mark.parametrize("damping_law", ["contact", "always"])
def test_the_monodromy_matrix_is_the_derivative_of_the_exact_period_map(damping_law):
    """Central differences over one cycle of the reference integration, from the motion
    that closes there.

    A cycle multiplies a disturbance by about one, and the motion has 1e-5 of error from
    384 harmonics and 16384 steps: tooth contact of a few per cent of the cycle makes
    that 1e-3 in the matrix at most.
    """
    train = three_disks(damping_law)
    response = jaxhb.check(jaxhb.solve(train, rpm=900.0, harmonics=384))
    assert response.mesh("pinion", "wheel").separated_fraction > 0.05
    system, meshes, frequency, load = posed(train, 900.0)
    start = np.asarray(response.angles) * np.asarray(system.radius)[:, None]
    orbit = reference_orbit(system, meshes, frequency, load, start, steps=16384)
    assert orbit.settled
    size = 1e-6 * np.abs(orbit.state).max()
    shifts = size * np.eye(len(orbit.state))
    ahead, behind = (
        np.asarray(after_cycle(orbit.stepper, orbit.state + sign * shifts))
        for sign in (1, -1)
    )
    expected = ((ahead - behind) / (2 * size)).T
    space = space_of(system, meshes, frequency, parts=partition(system, meshes))
    deflection = np.asarray(response.deflections)
    times = exact_integrals.switching_times(meshes.law, deflection)
    monodromy = variational.monodromy(space, meshes, deflection, frequency, times)
    np.testing.assert_allclose(
        monodromy.matrix, expected, rtol=0, atol=1e-3 * np.abs(expected).max()
    )
    assert abs(np.expm1(monodromy.log_determinant - monodromy.trace)) < 1e-10

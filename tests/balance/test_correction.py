"""The linear solve of a Newton step: exact Jacobian, on the linearised map of a
sweep.
"""

import dataclasses
import itertools
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tolerances import ALGEBRAIC, RESIDUAL
from trains import branched_parts, build

from jaxhb import Disk, Mesh, Shaft
from jaxhb.balance import correction
from jaxhb.balance.problem import ActiveMeshes, problem_at, reduced_equation
from jaxhb.equations import fourier, reduced_model as reduced_models
from jaxhb.equations.reduced_model import reduced_model
from jaxhb.equations.state_space import paired, partition, state_space

HARMONICS = 48
SAMPLES = 768
RPM = 12000.0
"""The mesh modes lie at harmonic 13."""

reduce = jax.jit(reduced_equation, static_argnums=1)
approximate = jax.jit(reduced_model, static_argnames="time_steps")


@partial(jax.jit, static_argnums=(3, 4))
def prepare(reduced, model, l, samples, time_steps):
    """The linearised march and the slopes at a motion."""
    slopes = correction.slopes_at(reduced, l, samples)
    train = correction.train_of(reduced, model, time_steps)
    return correction.march_at(train, slopes), slopes


@pytest.fixture(scope="module")
def case():
    """Problem, condensed equation on both meshes, and random deflections that cross the
    gap.
    """
    problem = problem_at(build(branched_parts(), reference="flywheel"), RPM, HARMONICS)
    reduced, _ = reduce(
        problem, HARMONICS, ActiveMeshes(np.ones(2), np.arange(2), np.zeros(2))
    )
    draw = np.random.default_rng(14)
    l = 1e-4 * (
        draw.normal(size=(2, HARMONICS + 1)) + 1j * draw.normal(size=(2, HARMONICS + 1))
    )
    l[:, 0] = l[:, 0].real
    return problem, reduced, l / (1 + np.arange(HARMONICS + 1)) ** 1.5


def surrogate_of(problem, time_steps):
    return approximate(
        problem.system,
        problem.meshes.link,
        np.ones(2),
        problem.frequency,
        time_steps=time_steps,
    )


@pytest.mark.slow
def test_a_long_train_without_any_damping_has_a_basis():
    """Its receptances are real: the imaginary columns of the basis are zero."""
    count = reduced_models.DISKS + 6
    parts = [Disk(name=str(k), inertia=0.01, radius=0.1) for k in range(count)]
    parts += [
        Shaft(between=(str(k), str(k + 1)), stiffness=1e5)
        for k in range(count - 1)
        if k != count // 2
    ]
    parts.append(
        Mesh(
            between=(str(count // 2), str(count // 2 + 1)),
            stiffness=1e8,
            backlash=1e-4,
            epsilon=1e-3,
            transition=0.04,
        )
    )
    problem = problem_at(build(parts, reference="0"), RPM, HARMONICS)
    model = approximate(
        problem.system,
        problem.meshes.link,
        np.ones(1),
        problem.frequency,
        time_steps=512,
    )
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(model))


def dense_jacobian(reduced, l):
    def packed(flat):
        value = reduced.residual(fourier.unpack(flat.reshape(2, -1)), SAMPLES)
        return fourier.pack(value).reshape(-1)

    point = fourier.pack(jnp.asarray(l)).reshape(-1)
    return jax.jit(jax.jacfwd(packed))(point), jax.jit(packed)(point)


correct = jax.jit(correction.correct, static_argnums=5)


def coefficients(flat):
    return fourier.unpack(jnp.asarray(flat).reshape(2, -1))


@pytest.mark.slow
def test_correction_solves_the_jacobian_of_autodiff(case):
    problem, reduced, l = case
    matrix, value = dense_jacobian(reduced, l)
    expected = np.linalg.solve(np.asarray(matrix), value)
    march, slopes = prepare(reduced, surrogate_of(problem, 512), l, SAMPLES, 512)
    change, residual, steps = correct(
        reduced, march, slopes, coefficients(value), 1e-11, 60
    )
    change = np.asarray(fourier.pack(change)).reshape(-1)
    np.testing.assert_allclose(
        change, expected, rtol=0, atol=RESIDUAL * np.abs(expected).max()
    )
    assert residual <= 1e-11
    assert 0 < steps <= 30


@pytest.mark.slow
def test_steps_of_the_march_change_the_way_and_not_the_correction(case):
    problem, reduced, l = case

    def corrected(time_steps):
        model = surrogate_of(problem, time_steps)
        march, slopes = prepare(reduced, model, l, SAMPLES, time_steps)
        return correct(reduced, march, slopes, reduced.linear, 1e-12, 60)

    coarse, _, coarse_steps = corrected(128)
    fine, _, fine_steps = corrected(1024)
    assert 0 < coarse_steps <= 40
    assert 0 < fine_steps <= 40
    np.testing.assert_allclose(coarse, fine, rtol=0, atol=RESIDUAL * np.abs(fine).max())


@pytest.mark.slow
def test_the_transposed_solve_is_that_of_the_transposed_jacobian(case):
    problem, reduced, l = case
    matrix, value = dense_jacobian(reduced, l)
    expected = np.linalg.solve(np.asarray(matrix).T, value)

    @jax.jit
    def solve(march, slopes, value):
        product = correction.tangent(reduced, correction.force_change(reduced, slopes))
        return correction.correct_product(
            march, product, value, transposed=True, tolerance=1e-12, steps=60
        )

    march, slopes = prepare(reduced, surrogate_of(problem, 512), l, SAMPLES, 512)
    solution, residual = solve(march, slopes, coefficients(value))
    solution = np.asarray(fourier.pack(solution)).reshape(-1)
    assert residual <= 1e-12
    np.testing.assert_allclose(
        solution, expected, rtol=0, atol=RESIDUAL * np.abs(expected).max()
    )


@pytest.mark.slow
def test_a_bordered_solve_is_that_of_the_bordered_jacobian(case):
    problem, reduced, l = case
    matrix, value = dense_jacobian(reduced, l)
    draw = np.random.default_rng(5)
    column = draw.normal(size=len(value))
    row = draw.normal(size=len(value) + 1)
    whole = np.block([[np.asarray(matrix), column[:, None]], [row]])
    right = np.append(value, 0.3 * np.abs(value).max())
    march, slopes = prepare(reduced, surrogate_of(problem, 512), l, SAMPLES, 512)
    solve = jax.jit(
        lambda march, slopes, right: correction.correct_bordered(
            reduced, march, slopes, (column, row), (right,), 60
        )[0]
    )
    expected = np.linalg.solve(whole, right)
    np.testing.assert_allclose(
        solve(march, slopes, right),
        expected,
        rtol=0,
        atol=1e-7 * np.abs(expected).max(),
    )


@pytest.mark.slow
def test_a_bordered_solve_has_an_answer_where_the_right_side_is_at_the_border_alone(
    case,
):
    """The search for the direction of a branch poses it: the image of such a side has
    nothing at the border.
    """
    problem, reduced, l = case
    matrix, value = dense_jacobian(reduced, l)
    column = np.random.default_rng(6).normal(size=len(value))
    row = np.append(column, 0.0)
    right = np.append(np.zeros(len(value)), 1.0)
    whole = np.block([[np.asarray(matrix), column[:, None]], [row]])
    march, slopes = prepare(reduced, surrogate_of(problem, 512), l, SAMPLES, 512)
    solve = jax.jit(
        lambda march, slopes, right: correction.correct_bordered(
            reduced, march, slopes, (column, row), (right,), 60
        )[0]
    )
    expected = np.linalg.solve(whole, right)
    np.testing.assert_allclose(
        solve(march, slopes, right),
        expected,
        rtol=0,
        atol=1e-7 * np.abs(expected).max(),
    )


@pytest.mark.slow
def test_a_derivative_that_is_not_reached_is_nan(case, monkeypatch):
    problem, reduced, l = case
    march, slopes = prepare(reduced, surrogate_of(problem, 512), l, SAMPLES, 512)

    def both(steps):
        monkeypatch.setattr(correction, "DERIVATIVE", (1e-12, steps))
        product = correction.tangent(reduced, correction.force_change(reduced, slopes))
        solver = jax.jit(
            lambda value: correction.invert(march, product, product, value)
        )
        solution, pull = jax.vjp(solver, reduced.linear)
        return np.concatenate([solution, pull(jnp.conj(reduced.linear))[0]])

    assert np.isnan(both(2)).all()
    assert np.isfinite(both(60)).all()


@pytest.mark.slow
def test_product_on_few_instants_is_the_jacobian_at_all_samples(case):
    _, reduced, l = case
    matrix, _ = dense_jacobian(reduced, l)
    direction = fourier.pack(jnp.asarray(l[::-1]))

    @jax.jit
    def product(at, d):
        forces = correction.force_change(
            reduced, correction.slopes_at(reduced, at, SAMPLES)
        )
        return correction.tangent(reduced, forces)(d)

    expected = np.asarray(matrix @ direction.reshape(-1))
    image = fourier.pack(product(l, fourier.unpack(direction)))
    error = np.abs(np.asarray(image).reshape(-1) - expected).max()
    assert error <= ALGEBRAIC * np.abs(expected).max()


@pytest.mark.slow
def test_modes_that_outlast_the_cycle_take_a_krylov_step_each_at_most():
    """14 disks of which no motion decays within a cycle."""
    gears = {6: 0.05, 7: 0.05}
    parts = [
        Disk(name=str(k), inertia=0.01, damping=0.001, radius=gears.get(k))
        for k in range(14)
    ]
    parts += [
        Shaft(between=(str(k), str(k + 1)), stiffness=1e5) for k in range(13) if k != 6
    ]
    parts += [
        Mesh(
            between=("6", "7"),
            stiffness=2e8,
            damping=200.0,
            backlash=1e-4,
            epsilon=0.02,
            transition=0.04,
        )
    ]
    problem = problem_at(build(parts, reference="0"), RPM, 1)
    reduced, _ = reduce(
        problem, HARMONICS, ActiveMeshes(np.ones(1), np.arange(1), np.zeros(1))
    )
    model = approximate(
        problem.system,
        problem.meshes.link,
        np.ones(1),
        problem.frequency,
        time_steps=512,
    )
    draw = np.random.default_rng(14)
    amplitudes = 1e-4 * draw.normal(size=(1, HARMONICS + 1))
    l = amplitudes / (1 + np.arange(HARMONICS + 1)) ** 1.5 + 0j
    value = draw.normal(size=(1, HARMONICS + 1)) + 0j
    march, slopes = prepare(reduced, model, l, SAMPLES, 512)
    _, residual, steps = correct(reduced, march, slopes, value, 1e-8, 60)
    assert residual <= 1e-8
    assert steps <= 28


@pytest.mark.slow
def test_a_train_of_inertial_disks_is_its_own_surrogate(case):
    problem, _, _ = case
    problem = dataclasses.replace(
        problem,
        system=dataclasses.replace(problem.system, loss=0.0 * problem.system.loss),
    )
    parts = partition(problem.system, problem.meshes)
    exact = jax.jit(state_space, static_argnums=3)(
        problem.system, problem.meshes, problem.frequency, parts
    )
    time_steps = 2**16
    space = surrogate_of(problem, time_steps).space

    def receptance(space, n):
        A = np.asarray(space.transition)
        E = np.asarray(space.forcing)
        L = np.asarray(space.observation)
        rotation = 1j * n * float(problem.frequency) * np.eye(len(A))
        return L @ np.linalg.solve(rotation - A, E)

    for n in (1, 7, 40):
        expected = receptance(exact, n)
        np.testing.assert_allclose(
            receptance(space, n), expected, rtol=0, atol=1e-9 * np.abs(expected).max()
        )


def sliced(pieces):
    """The first shaft of the train in ``pieces``, its problem and its true
    receptances.
    """
    parts = branched_parts()
    shaft = next(p for p in parts if isinstance(p, Shaft))
    names = [
        shaft.between[0],
        *(f"slice {i}" for i in range(pieces - 1)),
        shaft.between[1],
    ]
    fine = [p for p in parts if p is not shaft] + [
        Disk(name=name, inertia=1e-4) for name in names[1:-1]
    ]
    fine += [
        Shaft(between=pair, stiffness=pieces * shaft.stiffness, damping=1.0)
        for pair in itertools.pairwise(names)
    ]
    problem = problem_at(build(fine, reference="flywheel"), RPM, HARMONICS)
    reduced, _ = reduce(
        problem, HARMONICS, ActiveMeshes(np.ones(2), np.arange(2), np.zeros(2))
    )
    return problem, np.asarray(reduced.receptance)


def receptance_of(train, frequency, harmonic):
    """Receptance ``(2, 2)`` of a ReducedOrderModel at one harmonic."""
    A = np.asarray(train.space.transition)
    E = np.asarray(train.space.forcing)
    L = np.asarray(train.space.observation)
    rotation = 1j * harmonic * float(frequency) * np.eye(len(A))
    return train.residual_flexibility - L[:2] @ np.linalg.solve(rotation - A, E)


@pytest.mark.slow
def test_few_modes_stand_for_a_shaft_of_many_disks():
    problem, expected = sliced(150)
    train = surrogate_of(problem, 256)
    assert len(train.space.transition) == 96
    # A loss factor of this train is viscous damping in time: a few percent at the
    # resonances.
    for harmonic in (3, 9, 15):
        receptance = receptance_of(train, problem.frequency, harmonic)
        error = np.abs(receptance - expected[harmonic]).max()
        assert error < 0.05 * np.abs(expected[harmonic]).max()


@pytest.mark.slow
def test_of_many_slow_modes_those_are_kept_that_meshes_see(monkeypatch):
    # Slices of 0.2 kg m^2: the mode of the meshes, at harmonic 12, is only the 36th
    problem, _ = sliced(150)
    slice_mass = np.median(problem.system.mass)
    heavy = np.where(
        np.isclose(problem.system.mass, slice_mass),
        2000 * slice_mass,
        problem.system.mass,
    )
    problem = dataclasses.replace(
        problem, system=dataclasses.replace(problem.system, mass=heavy)
    )
    every = surrogate_of(problem, 256)
    monkeypatch.setattr(reduced_models, "MODES", 24)
    # A program of its own: that of the module has all modes.
    few = jax.jit(
        lambda system, link, mask, frequency: reduced_model(
            system, link, mask, frequency, 256
        )
    )
    train = few(problem.system, problem.meshes.link, np.ones(2), problem.frequency)
    assert len(every.space.transition) == 96
    assert len(train.space.transition) == 48
    for harmonic in (11, 12, 13):
        expected = receptance_of(every, problem.frequency, harmonic)
        receptance = receptance_of(train, problem.frequency, harmonic)
        np.testing.assert_allclose(
            receptance, expected, rtol=0, atol=0.02 * np.abs(expected).max()
        )


@pytest.mark.slow
def test_what_takes_longest_to_decay_comes_first_and_what_does_not_move_last(case):
    """A floating train with modes too fast for the steps: those that a cycle closes on
    are the first.
    """
    problem, _, _ = case
    system = dataclasses.replace(problem.system, ground=0.0 * problem.system.ground)
    model = surrogate_of(dataclasses.replace(problem, system=system), 32)
    rates = np.asarray(paired(model.space.transition))
    decay = -np.maximum(rates[0, 0], rates[1, 1])
    observation = np.abs(np.asarray(model.space.observation)).max(axis=0)
    observed = observation.reshape(2, -1).max(axis=0)
    count = (observed > ALGEBRAIC * observed.max()).sum()
    assert 0 < count < len(decay)
    assert (observed[count:] <= ALGEBRAIC * observed.max()).all()
    assert (np.diff(decay[:count]) > 0).all()


@pytest.mark.slow
def test_resting_on_the_flank_balances_constant_forces(case):
    problem, _, _ = case
    model = surrogate_of(problem, 512)
    force = np.array([3.0, -2.0])
    space = model.space
    state = model.at_rest @ force
    speed = space.transition @ state + space.forcing @ force
    scale = np.abs(space.forcing @ force).max()
    np.testing.assert_allclose(speed, 0.0, rtol=0, atol=1e-9 * scale)

"""The condensed equation on the meshes against the whole train, and the Krylov steps of
its solution.
"""

import dataclasses
import itertools

import dense
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tolerances import ALGEBRAIC
from trains import branched_parts, build, gearbox_parts

from jaxhb import Damper, Disk, Mesh, Shaft
from jaxhb.balance.problem import (
    ActiveMeshes,
    force_balance,
    problem_at,
    reduced_equation,
)
from jaxhb.equations import condensation, dynamic_stiffness, fourier
from jaxhb.equations.residual import ForceBalance

HARMONICS = 6
SAMPLES = 96
RPM = 1500.0

evaluate = jax.jit(ForceBalance.residual)
reduce = jax.jit(reduced_equation, static_argnums=1)
excess_at = jax.jit(
    condensation.CondensedEquation.nonlinear_force_coefficients, static_argnums=2
)
reduced_residual = jax.jit(condensation.CondensedEquation.residual, static_argnums=2)
combine = jax.jit(condensation.CondensedTrain.combine)


@pytest.fixture(scope="module")
def case():
    """Train, problem, its condensed equation on both meshes, and random deflections
    that cross the gap.
    """
    parts = branched_parts()
    problem = problem_at(build(parts, reference="flywheel"), RPM, HARMONICS)
    reduced, condensed = reduce(
        problem, HARMONICS, ActiveMeshes(np.ones(2), np.arange(2), np.zeros(2))
    )
    draw = np.random.default_rng(14)
    l = 1e-4 * (
        draw.normal(size=(2, HARMONICS + 1)) + 1j * draw.normal(size=(2, HARMONICS + 1))
    )
    l[:, 0] = l[:, 0].real
    return parts, problem, reduced, condensed, l / (1 + np.arange(HARMONICS + 1))


def test_receptances_are_those_of_the_dense_train_in_angles(case):
    parts, problem, reduced, _, _ = case
    rows = np.array([row for _, row in dense.links(parts)[-2:]])
    load = dense.torques(parts, HARMONICS, 1)
    for n in range(HARMONICS + 1):
        Z = dense.dynamic_stiffness(parts, n * float(problem.frequency))
        expected = rows @ np.linalg.solve(Z, rows.T)
        np.testing.assert_allclose(
            reduced.receptance[n], expected, rtol=0, atol=1e-10 * np.abs(expected).max()
        )
        linear = rows @ np.linalg.solve(Z, load[:, n])
        # Differences of dense angles: the soft ground costs them three digits at the
        # mean.
        scale = np.abs(reduced.linear).max()
        np.testing.assert_allclose(
            reduced.linear[:, n], linear, rtol=0, atol=1e-9 * scale
        )


@pytest.mark.slow
def test_harmonics_swept_in_several_chunks_are_those_of_the_dense_train(case):
    parts, _, few, _, _ = case
    harmonics = 2 * condensation.CHUNK + 20
    problem = problem_at(build(parts, reference="flywheel"), RPM, harmonics)
    reduced, _ = reduce(
        problem, harmonics, ActiveMeshes(np.ones(2), np.arange(2), np.zeros(2))
    )
    np.testing.assert_allclose(
        reduced.linear[:, : HARMONICS + 1], few.linear, rtol=0, atol=ALGEBRAIC
    )
    assert not np.asarray(reduced.linear[:, HARMONICS + 1 :]).any()
    rows = np.array([row for _, row in dense.links(parts)[-2:]])
    chunk = condensation.CHUNK
    for n in (0, 1, chunk - 1, chunk, chunk + 1, harmonics):
        stiffness = dense.dynamic_stiffness(parts, n * float(problem.frequency))
        expected = rows @ np.linalg.solve(stiffness, rows.T)
        np.testing.assert_allclose(
            reduced.receptance[n], expected, rtol=0, atol=1e-10 * np.abs(expected).max()
        )


def sliced_parts():
    """A shaft in slices between flywheel and crank gear, another behind the idler, with
    a ring that nothing holds.
    """
    names = [f"slice {i}" for i in range(4)]
    parts = [
        p
        for p in branched_parts()
        if not (isinstance(p, Shaft) and p.between == ("flywheel", "crank gear"))
    ]
    parts += [
        Disk(name=name, inertia=0.002 * (i != 1), damping=0.1)
        for i, name in enumerate(names)
    ]
    for shaft in (("flywheel", *names[:2], "crank gear"), ("idler", *names[2:])):
        parts += [
            Shaft(between=b, stiffness=1e5, damping=2.0, loss_factor=0.01)
            for b in itertools.pairwise(shaft)
        ]
    return [
        *parts,
        Damper(
            name="free ring", disk=names[3], inertia=0.03, damping=1.5, stiffness=0.0
        ),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("parts", [sliced_parts, lambda: gearbox_parts(grounded=False)])
def test_receptances_with_chains_of_disks_folded_are_those_of_all_disks(parts):
    parts = parts()
    reference = (
        "motor" if any(getattr(p, "name", "") == "motor" for p in parts) else "flywheel"
    )
    problem = problem_at(build(parts, reference=reference), RPM, HARMONICS)
    system = jax.tree.map(jnp.asarray, problem.system)
    omega = dynamic_stiffness.frequencies(problem.frequency, 40)
    columns = system.incidence(problem.meshes.link)
    folded = jax.jit(dynamic_stiffness.receptance)(system, omega, columns)
    expected = jax.jit(dynamic_stiffness._receptance_of_all_disks)(
        system, omega, columns
    )
    size = np.abs(expected).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(folded / size, expected / size, rtol=0, atol=ALGEBRAIC)


def assert_same_equation(problem, reduced, condensed, l):
    """Take any l: x = Z^-1 (q - D^T phi(l)) has F(l) = l - D x, and leaves A(x) = D^T
    (phi(D x) - phi(l)).
    """
    nonlinear_force = np.asarray(excess_at(reduced, l, SAMPLES))
    x = np.asarray(combine(condensed, nonlinear_force)[0])
    full = evaluate(force_balance(problem, HARMONICS, SAMPLES), fourier.pack(x))
    meshes = np.asarray(problem.meshes.link)[: len(l)]
    moved = problem.system.deflections(x, meshes)
    # D x as a difference of displacements loses some digits.
    residual = reduced_residual(reduced, l, SAMPLES)
    np.testing.assert_allclose(
        residual, l - moved, rtol=0, atol=1e-10 * np.abs(l).max()
    )
    left = problem.system.incidence(meshes) @ (
        np.asarray(excess_at(reduced, moved, SAMPLES)) - nonlinear_force
    )
    largest = np.abs(nonlinear_force).max()
    np.testing.assert_allclose(
        fourier.unpack(np.asarray(full)), left, rtol=0, atol=1e-9 * largest
    )


def test_reduced_and_full_residual_are_the_same_equation(case):
    _, problem, reduced, condensed, l = case
    assert_same_equation(problem, reduced, condensed, l)


@pytest.mark.slow
def test_reduced_and_full_residual_are_the_same_equation_where_two_meshes_close_a_loop(
    case,
):
    parts = [
        dataclasses.replace(p, backlash=1e-4, epsilon=0.02, transition=0.3)
        if isinstance(p, Mesh)
        else p
        for p in gearbox_parts()
    ]
    problem = problem_at(build(parts, reference="motor"), RPM, HARMONICS)
    assert len(problem.system.tree.loops) == 1
    reduced, condensed = reduce(
        problem, HARMONICS, ActiveMeshes(np.ones(3), np.arange(3), np.zeros(3))
    )
    assert_same_equation(
        problem, reduced, condensed, np.concatenate([case[-1], case[-1][:1]])
    )


def test_padding_with_idle_meshes_changes_nothing(case):
    _, problem, reduced, _, l = case
    idle = ActiveMeshes(
        np.array([1.0, 1.0, 0.0, 0.0]), np.array([0, 1, 0, 0]), np.zeros(2)
    )
    padded, _ = reduce(problem, HARMONICS, idle)
    value = reduced_residual(padded, np.concatenate([l, 0 * l]), SAMPLES)
    expected = reduced_residual(reduced, l, SAMPLES)
    np.testing.assert_allclose(
        value[:2], expected, rtol=0, atol=ALGEBRAIC * np.abs(l).max()
    )
    assert not np.asarray(value[2:]).any()


def test_excess_is_constant_while_a_mesh_stays_on_one_flank(case):
    _, problem, reduced, _, _ = case
    l = np.zeros((2, HARMONICS + 1), complex)
    l[:, 0] = 2e-4
    l[:, 1] = 2e-5
    nonlinear_force = np.asarray(excess_at(reduced, l, SAMPLES))
    offset = -0.98 * 2e8 * 1e-4 / 2
    np.testing.assert_allclose(nonlinear_force[:, 0], offset, rtol=ALGEBRAIC)
    np.testing.assert_allclose(
        nonlinear_force[:, 1:], 0.0, rtol=0, atol=ALGEBRAIC * abs(offset)
    )

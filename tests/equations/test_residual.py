"""The residual A(x) against plain sums over time samples, its Jacobian against autodiff."""

from functools import partial

import dense
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tolerances import ALGEBRAIC
from trains import branched_parts, build

from jaxhb.balance.problem import problem_at
from jaxhb.equations import fourier
from jaxhb.equations.residual import link_blocks, node_blocks, residual

HARMONICS, SAMPLES, RPM = 6, 96, 1500.0
LAWS = [("contact", "contact"), ("always", "always"), ("contact", "always")]

evaluate = jax.jit(residual, static_argnames="samples")
by_autodiff = jax.jit(jax.jacfwd(residual), static_argnames="samples")


@partial(jax.jit, static_argnames="samples")
def assembled(packed, system, meshes, frequency, samples):
    """The dense Jacobian ``(S P, S P)`` of A(x), assembled from Toeplitz blocks; sweeps never assemble it."""
    disks, width = packed.shape
    columns = system.incidence()
    blocks = link_blocks(fourier.pack(system.deflections(fourier.unpack(packed))), system, meshes, frequency, samples)
    matrix = jnp.einsum("sl,tl,lij->sitj", columns, columns, blocks)
    node = node_blocks(system, frequency, (width - 1) // 2)
    disk = jnp.arange(disks)
    matrix = matrix.transpose(0, 2, 1, 3).at[disk, disk].add(node).transpose(0, 2, 1, 3)
    return matrix.reshape(disks * width, disks * width)


@pytest.fixture(scope="module")
def angles():
    """Random angles of six disks whose meshes cross the gap: deflections of about twice the backlash."""
    draw = np.random.default_rng(12)
    phi = 2e-3 * (draw.normal(size=(6, HARMONICS + 1)) + 1j * draw.normal(size=(6, HARMONICS + 1)))
    phi[:, 0] = phi[:, 0].real
    return phi / (1 + np.arange(HARMONICS + 1))


def posed(laws):
    parts = branched_parts(laws)
    return parts, problem_at(build(parts, reference="flywheel"), RPM, HARMONICS)


def arguments(problem, angles):
    x = fourier.pack(angles * problem.system.radius[:, None])
    return (x, problem.system, problem.meshes, problem.frequency)


@pytest.mark.parametrize("laws", LAWS)
def test_residual_is_the_galerkin_balance_by_plain_sums(laws, angles):
    parts, problem = posed(laws)
    for mesh, row in dense.links(parts)[3:]:  # backlash is at work
        _, share = dense.law(mesh, np.asarray(fourier.synthesize(row @ angles, SAMPLES)))
        assert {0.0, 1.0} <= set(share) and np.any((share > 0) & (share < 1))
    found = evaluate(*arguments(problem, angles), problem.load, samples=SAMPLES)
    torque = np.asarray(fourier.unpack(found)) * problem.system.radius[:, None]
    wanted = dense.galerkin_residual(parts, angles, float(problem.frequency), 1, SAMPLES)
    np.testing.assert_allclose(torque, wanted, rtol=0, atol=ALGEBRAIC * np.abs(wanted).max())


@pytest.mark.parametrize("laws", LAWS)
def test_assembled_toeplitz_jacobian_is_that_of_autodiff(laws, angles):
    _, problem = posed(laws)
    toeplitz = np.asarray(assembled(*arguments(problem, angles), samples=SAMPLES))
    autodiff = by_autodiff(*arguments(problem, angles), problem.load, samples=SAMPLES).reshape(toeplitz.shape)
    np.testing.assert_allclose(autodiff, toeplitz, rtol=0, atol=ALGEBRAIC * np.abs(toeplitz).max())

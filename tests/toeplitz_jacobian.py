"""The Jacobian of all disks as one dense matrix, for the tests: the sweeps never assemble it."""

import jax.numpy as jnp

from jaxhb.equations.residual import link_blocks, node_blocks


def jacobian(packed, system, meshes, frequency, samples):
    """The dense Jacobian ``(S P, S P)`` of A(x), assembled from Toeplitz blocks; the oracle of autodiff."""
    disks, width = packed.shape
    columns = system.incidence()
    blocks = link_blocks(packed, system, meshes, frequency, samples)
    matrix = jnp.einsum("sl,tl,lij->sitj", columns, columns, blocks)
    node = node_blocks(system, frequency, (width - 1) // 2)
    disk = jnp.arange(disks)
    matrix = matrix.transpose(0, 2, 1, 3).at[disk, disk].add(node).transpose(0, 2, 1, 3)
    return matrix.reshape(disks * width, disks * width)

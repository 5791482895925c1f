"""The few modes of a finely divided train that forces at its meshes move, on the host.

Dense matrices of all disks cost their cube. Here the train is projected on its
responses to forces at the meshes over the frequencies that matter (rational Krylov,
Galerkin): one sparse elimination a frequency, which a tree does not fill. Errors made
here cost sweeps, never accuracy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from jaxhb._jax import Array
from jaxhb.equations.state_space import (
    HELD,
    HELD_ROUNDED,
    LIGHT,
    ROTATION,
    ComplexModes,
    StateSpace,
    modes_of,
)

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

    from jaxhb.equations.backlash import MeshParameters
    from jaxhb.equations.system import System

# Frequencies at which responses are taken; with 20 of them 300 and 3000 disks take as
# many sweeps
SHIFTS = 12


def projected_modes(
    system: System, meshes: MeshParameters, frequency: float
) -> ComplexModes:
    """The :class:`~jaxhb.equations.state_space.ComplexModes` of a System of the host
    that its meshes notice.

    meshes : MeshParameters of those with backlash; frequency : rad/s, the lowest at
    which responses are taken, and what scales slow modes.
    """
    links = np.asarray(meshes.link)
    sparse = SparseTrain.of(system, links)
    basis = _basis(sparse, frequency)
    K, B, H = (
        basis.T @ (matrix @ basis)
        for matrix in (sparse.stiffness, sparse.damping, sparse.loss)
    )
    squares, vectors = np.linalg.eigh((K + K.T) / 2)
    moving = squares > ROTATION * squares[-1]
    # A soft spring parts the Jordan block of free rotation, as in march_modes.
    soft = max((HELD * frequency) ** 2, HELD_ROUNDED * squares[-1])
    squares = np.where(moving, squares, 0.0) + soft
    root = np.where(moving, squares**-0.25, 0.0)  # as in loss_damping
    drag = vectors.T @ B @ vectors + root[:, None] * (vectors.T @ H @ vectors) * root
    shapes = basis @ vectors
    rows = sparse.mesh_rows @ shapes
    scale = np.maximum(np.sqrt(squares), frequency)
    momenta = shapes.T * sparse.mass
    mode_zeros = np.zeros_like(drag)
    mesh_zeros = np.zeros_like(rows)
    disk_zeros = np.zeros_like(shapes)
    space = StateSpace(
        transition=np.block(
            [[mode_zeros, np.diag(scale)], [-np.diag(squares / scale), -drag]]
        ),
        forcing=np.concatenate([mesh_zeros.T, -rows.T]),
        observation=np.block([[rows / scale, mesh_zeros], [mesh_zeros, rows]]),
        coordinates=np.block(
            [[scale[:, None] * momenta, disk_zeros.T], [disk_zeros.T, momenta]]
        ),
    )
    motion = np.block([[shapes / scale, disk_zeros], [disk_zeros, shapes]])
    return modes_of(space, motion)


@dataclass(frozen=True)
class SparseTrain:
    """Sparse stiffness N/m, damping N s/m and imaginary stiffness N/m of loss factors,
    ``(S, S)`` each; mass ``(S,)`` kg, a little of disks without inertia; mesh_rows
    ``(G, S)`` of D of the meshes; highest : rad/s, above the modes in which gears swing
    against their teeth and shafts.
    """

    stiffness: csc_matrix
    damping: csc_matrix
    loss: csc_matrix
    mass: np.ndarray
    mesh_rows: np.ndarray
    highest: float

    @classmethod
    def of(cls, system: System, links: np.ndarray) -> SparseTrain:
        """Make it of a System, and the links that are meshes."""
        from scipy.sparse import csr_matrix, diags  # large trains alone need it

        tree = system.tree
        disks = len(system.mass)
        count = np.arange(len(system.arm_a))
        arms = np.concatenate([system.arm_a, -np.asarray(system.arm_b)])
        places = (np.tile(count, 2), np.concatenate([tree.end_a, tree.end_b]))
        deflections = csr_matrix((arms, places), shape=(len(count), disks))

        def assembled(of_links: Array, of_disks: Array) -> csc_matrix:
            from_links = deflections.T @ diags(of_links) @ deflections
            return (from_links + diags(of_disks)).tocsc()

        mass = np.where(system.mass > 0, system.mass, LIGHT * np.mean(system.mass))
        ends = np.concatenate([tree.end_a[links], tree.end_b[links]])
        highest_square = 2 * np.max(system.held_stiffness()[ends] / mass[ends])
        return cls(
            stiffness=assembled(system.stiffness, system.ground),
            damping=assembled(system.viscous, system.damping),
            loss=assembled(system.loss * system.stiffness, np.zeros(disks)),
            mass=mass,
            mesh_rows=deflections[links].toarray(),
            highest=float(np.sqrt(highest_square)),
        )


def _basis(sparse: SparseTrain, frequency: float) -> np.ndarray:
    """Columns ``(S, r)`` with ``basis^T M basis = 1`` of the responses to forces at the
    meshes.
    """
    from scipy.sparse import diags
    from scipy.sparse.linalg import splu

    root = np.sqrt(sparse.mass)[:, None]
    forces = sparse.mesh_rows.T.astype(complex)
    responses = []
    # Geometric: as many in each octave.
    for omega in np.geomspace(frequency, max(sparse.highest, 2 * frequency), SHIFTS):
        inertia = diags(omega**2 * sparse.mass)
        dynamic = (
            sparse.stiffness + 1j * (sparse.loss + omega * sparse.damping) - inertia
        )
        response = splu(dynamic.tocsc()).solve(forces)
        responses += [response.real, response.imag]
    columns = root * np.concatenate(responses, axis=1)
    # Responses at resonances would drown the others: columns of length one before they
    # are made orthogonal.
    sizes = np.linalg.norm(columns, axis=0)
    columns = columns[:, sizes > 0] / sizes[sizes > 0]
    orthonormal, triangle, _ = scipy.linalg.qr(columns, mode="economic", pivoting=True)
    least = np.finfo(float).eps * np.abs(triangle[0, 0])
    independent = np.abs(np.diag(triangle)) > least
    return orthonormal[:, independent] / root

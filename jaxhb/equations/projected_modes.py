"""The few modes of a finely divided train that forces at its meshes move, on the host.

Dense matrices of all disks cost their cube. Here the train is projected on its
responses to forces at the meshes over the frequencies that matter (rational Krylov,
Galerkin): one sparse elimination a frequency, which a tree does not fill. Errors made
here cost sweeps, never accuracy.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from jaxhb.equations.state_space import (
    HELD,
    HELD_ROUNDED,
    LIGHT,
    ROTATION,
    Modes,
    StateSpace,
    modes_of,
)

# Frequencies at which responses are taken; with 20 of them 300 and 3000 disks take as
# many sweeps
SHIFTS = 12


def projected_modes(system, meshes, frequency) -> Modes:
    """The :class:`~jaxhb.equations.state_space.Modes` of a System of the host that its
    meshes notice.

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
    square, mesh_zeros, disk_zeros = (np.zeros_like(a) for a in (drag, rows, shapes))
    space = StateSpace(
        transition=np.block(
            [[square, np.diag(scale)], [-np.diag(squares / scale), -drag]]
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
    """Sparse stiffness N/m, damping N s/m and imaginary stiffness of loss factors ``(S,
    S)``; mass ``(S,)`` kg, a little of disks without inertia; rows ``(G, S)`` of D of
    the meshes; highest : rad/s, above the modes in which gears swing against their
    teeth and shafts.
    """

    stiffness: object
    damping: object
    loss: object
    mass: np.ndarray
    mesh_rows: np.ndarray
    highest: float

    @classmethod
    def of(cls, system, links) -> "SparseTrain":
        """Of a System, and the links that are meshes."""
        from scipy.sparse import csr_matrix, diags  # large trains alone need it

        tree = system.tree
        disks = len(system.mass)
        count = np.arange(len(system.arm_a))
        arms = np.concatenate([system.arm_a, -np.asarray(system.arm_b)])
        at = np.tile(count, 2), np.concatenate([tree.end_a, tree.end_b])
        deflections = csr_matrix((arms, at), shape=(len(count), disks))

        def assembled(of_links, of_disks):
            return (
                deflections.T @ diags(of_links) @ deflections + diags(of_disks)
            ).tocsc()

        mass = np.where(system.mass > 0, system.mass, LIGHT * np.mean(system.mass))
        ends = np.concatenate([tree.end_a[links], tree.end_b[links]])
        return cls(
            stiffness=assembled(system.stiffness, system.ground),
            damping=assembled(system.viscous, system.damping),
            loss=assembled(system.loss * system.stiffness, np.zeros(disks)),
            mass=mass,
            mesh_rows=deflections[links].toarray(),
            highest=float(
                np.sqrt(2 * np.max(system.held_stiffness()[ends] / mass[ends]))
            ),
        )


def _basis(sparse, frequency):
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
    independent = np.abs(np.diag(triangle)) > np.finfo(float).eps * np.abs(
        triangle[0, 0]
    )
    return orthonormal[:, independent] / root

"""Natural frequencies and mode shapes of the undamped train, backlash meshes taken in contact."""

from dataclasses import dataclass

import numpy as np

from ..harmonic import chain


@dataclass(frozen=True)
class Modes:
    """Natural frequencies and shapes of an undamped train.

    Parameters
    ----------
    names : tuple of str, the S disks
    frequencies_hz : ``(m,)`` Hz, rising; a free train begins with 0
    shapes : ``(m, S)`` angles of the disks, largest absolute value 1
    mesh_energy_share : ``(m,)`` share of the strain energy that lies in tooth meshes
    """

    names: tuple
    frequencies_hz: np.ndarray
    shapes: np.ndarray
    mesh_energy_share: np.ndarray

    def shape(self, number):
        """Mode ``number`` as a dictionary disk -> angle."""
        return dict(zip(self.names, self.shapes[number].tolist(), strict=True))


def natural_frequencies(train):
    """Natural frequencies in Hz with mode shapes, undamped, meshes in contact.

    Solves ``K v = omega^2 M v`` (Lashko, (3.4)) through the singular values of ``C^{1/2} D M^{-1/2}``, which keeps the
    relative accuracy of soft modes beside stiff links and gives exact zeros to rigid motions. Disks without inertia
    are condensed statically; a purely viscous link does not count.

    Parameters
    ----------
    train : DriveTrain, concrete

    Returns
    -------
    Modes

    Examples
    --------
    >>> import jaxhb
    >>> jaxhb.natural_frequencies(jaxhb.load_scene("six_cylinder_diesel")).frequencies_hz[:3].round(1).tolist()
    [0.0, 216.6, 592.7]
    """
    system = chain.assemble(train)
    disks, links = len(system.mass), len(system.stiffness)
    rows = np.sqrt(system.stiffness)[:, None] * system.incidence().T
    held = np.flatnonzero(system.ground)
    soft = np.zeros((len(held), disks))
    soft[np.arange(len(held)), held] = np.sqrt(system.ground[held])
    rows = np.concatenate([rows, soft])
    heavy = system.mass > 0
    rows, follow = _condense(rows, heavy)
    root = np.sqrt(system.mass[heavy])
    _, singular, right = np.linalg.svd(rows / root, full_matrices=True)
    omega = np.zeros(len(root))
    omega[: len(singular)] = singular
    floor = 1e-13 * max(omega.max(initial=0.0), 1e-300) * max(rows.shape)
    omega[omega < floor] = 0.0
    order = np.argsort(omega, kind="stable")
    displacement = follow @ (right[order] / root).T
    strain = np.zeros((links + len(held), len(order)))
    strain[:links] = system.stiffness[:, None] * system.deflections(displacement) ** 2
    strain[links:] = system.ground[held][:, None] * displacement[held] ** 2
    first = links - len(train.topology.mesh_names)
    total = strain.sum(0)
    share = np.divide(strain[first:links].sum(0), total, out=np.zeros_like(total), where=total > 0)
    share[omega[order] == 0] = 0.0
    angles = displacement.T / system.radius
    largest = np.abs(angles).argmax(1)
    angles = angles / angles[np.arange(len(order)), largest][:, None]
    return Modes(train.topology.disk_names, omega[order] / (2 * np.pi), angles, share)


def _condense(rows, heavy):
    """Least-energy positions of massless disks: reduced rows, and the matrix from heavy disks to all."""
    disks = len(heavy)
    follow = np.zeros((disks, int(heavy.sum())))
    follow[heavy] = np.eye(follow.shape[1])
    if heavy.all():
        return rows, follow
    light = -np.linalg.pinv(rows[:, ~heavy], rcond=1e-12) @ rows[:, heavy]
    follow[~heavy] = light
    return rows[:, heavy] + rows[:, ~heavy] @ light, follow

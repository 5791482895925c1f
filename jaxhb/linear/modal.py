"""Natural frequencies and mode shapes of the undamped train, backlash meshes taken in contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .._jax import Array, namespace, on_host
from .._shown import brief
from ..harmonic import chain
from ..model.drivetrain import DriveTrain
from .incidence import factor, singular_values, singular_vectors

AT_REST = 1e-10
"""Ordinate over the largest one below which a disk lies in a node: rounding of a mode shape."""


class ModeShares(NamedTuple):
    """Shapes of m modes and where their energies lie, as in :class:`Modes`."""

    shapes: np.ndarray
    generalised_mass: np.ndarray
    kinetic_share: np.ndarray
    strain_share: np.ndarray


@brief
@dataclass(frozen=True)
class Modes:
    """Natural frequencies and shapes of an undamped train.

    Parameters
    ----------
    names : tuple of str, the S disks
    frequencies_hz : ``(m,)`` Hz, rising; a free train begins with 0
    shapes : ``(m, S)`` angles of the disks, largest absolute value 1
    mesh_energy_share : ``(m,)`` share of the strain energy that lies in tooth meshes
    link_names : tuple of str, the L links
    generalised_mass : ``(m,)`` kg m2, sum of J phi^2 over the disks
    node_count : ``(m,)`` int, links whose ends move against each other, where ordinates exceed 1e-10 of the largest;
        on a chain the number of the mode, unless the mode is confined to a few disks
    kinetic_share : ``(m, S)`` share of each disk in the kinetic energy; each row has sum 1
    strain_share : ``(m, L)`` share of each link in the strain energy; ground springs have the rest, rigid modes none
    """

    names: tuple
    frequencies_hz: np.ndarray
    shapes: np.ndarray
    mesh_energy_share: np.ndarray
    link_names: tuple
    generalised_mass: np.ndarray
    node_count: np.ndarray
    kinetic_share: np.ndarray
    strain_share: np.ndarray

    def shape(self, number: int) -> dict[str, float]:
        """Mode ``number`` as a dictionary disk -> angle."""
        return dict(zip(self.names, self.shapes[number].tolist(), strict=True))

    @property
    def generalised_stiffness(self) -> Array:
        """``(m,)`` N m/rad: omega^2 times the generalised mass, twice the strain energy of the shape."""
        return (2 * np.pi * self.frequencies_hz) ** 2 * self.generalised_mass


def natural_frequencies(train: DriveTrain, *, count: int | None = None) -> Modes:
    """Natural frequencies in Hz with mode shapes, undamped, meshes in contact.

    Solves ``K v = omega^2 M v`` (Lashko, (3.4)) through the singular values of ``C^{1/2} D M^{-1/2}``, which keeps the
    digits of soft modes beside stiff links and gives exact zeros to rigid motions, one for each part of the train that
    no spring holds. Disks without inertia are condensed statically; a purely viscous link does not count.

    Parameters
    ----------
    train : DriveTrain, concrete
    count : int, optional
        Of how many modes, the lowest ones; default all. A chain of more than 500 disks should ask for few: n modes of
        S disks take n S numbers.

    Returns
    -------
    Modes

    Examples
    --------
    >>> import jaxhb
    >>> jaxhb.natural_frequencies(jaxhb.load_scene("six_cylinder_diesel")).frequencies_hz[:3].round(1).tolist()
    [0.0, 216.6, 592.7]
    """
    system = on_host(chain.assemble(train))
    rows = factor(system)
    omega, vectors = singular_vectors(rows, count)
    displacement = rows.displacements(vectors / np.sqrt(system.mass[rows.heavy])[:, None])
    found, links = shares(system, omega, displacement), len(system.stiffness)
    return Modes(
        names=train.topology.disk_names,
        frequencies_hz=omega / (2 * np.pi),
        mesh_energy_share=found.strain_share[:, links - len(train.topology.mesh_names) :].sum(1),
        link_names=train.topology.link_names,
        node_count=_sign_changes(system.tree, found.shapes),
        **found._asdict(),
    )


def shares(system, omega, displacement) -> ModeShares:
    """The :class:`ModeShares` of modes of angular frequencies ``(m,)`` and displacements ``(S, m)``, may be traced."""
    xp = namespace(system, displacement)
    strain = system.stiffness[:, None] * system.deflections(displacement) ** 2
    total = strain.sum(0) + (system.ground[:, None] * displacement**2).sum(0)
    # What rounding leaves of the strain of a rigid mode has no shares.
    moving = (total > 0) & (omega > 0)
    strain = xp.where(moving, strain / xp.where(moving, total, 1.0), 0.0)
    angles = displacement / system.radius[:, None]
    shapes = (angles / angles[abs(angles).argmax(0), np.arange(len(omega))]).T
    kinetic = shapes**2 * (system.mass * system.radius**2)
    mass = kinetic.sum(1)
    return ModeShares(shapes, mass, kinetic / mass[:, None], strain.T)


def all_frequencies(train: DriveTrain) -> Array:
    """Natural frequencies in Hz alone: of a chain of thousands of disks in seconds.

    Parameters
    ----------
    train : DriveTrain, concrete
        A chain (shafts and single gears in a row, one ground at most) of more than 500 disks is solved by its
        Golub-Kahan tridiagonal in O(S^2), any other train by the dense factor in O(S^3).

    Returns
    -------
    array ``(m,)``
        Hz, rising, one for each disk with inertia: ``det(K - omega^2 M) = 0`` (Lashko, (3.4)).

    Examples
    --------
    >>> import jaxhb
    >>> jaxhb.all_frequencies(jaxhb.load_scene("six_cylinder_diesel"))[:3].round(1).tolist()
    [0.0, 216.6, 592.7]
    """
    return singular_values(factor(on_host(chain.assemble(train)))) / (2 * np.pi)


def _sign_changes(tree, shapes):
    """``(m,)`` links over which the sign changes; a disk at rest goes with a neighbour: a node counts once."""
    sign = np.where(np.abs(shapes) > AT_REST, np.sign(shapes), 0.0).T
    way = list(zip(tree.node[:-1].tolist(), tree.node[tree.parent[:-1]].tolist(), strict=True))
    for disk, above in way:
        sign[above] = np.where(sign[above] == 0, sign[disk], sign[above])
    for disk, above in reversed(way):
        sign[disk] = np.where(sign[disk] == 0, sign[above], sign[disk])
    return (sign[tree.end_a] != sign[tree.end_b]).sum(0)

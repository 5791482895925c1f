"""Kinetic and strain energy of the train as quadratic forms of its angles, and the matrices that follow from them.

Lashko, (3.1) and (3.2): ``T = 1/2 sum J_i phi_i'^2``, ``Pi = 1/2 sum c_i (phi_(i+1) - phi_i)^2``; here with meshes,
whose deflection is ``r_a phi_a - r_b phi_b``, and ground springs. The equations (3.3), (3.4) of free vibration are
``J phi'' + C phi = 0`` with ``J`` and ``C`` the second derivatives.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from jaxhb._jax import Array
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain


def kinetic_energy(train: DriveTrain, velocity: Array) -> Array:
    """Kinetic energy of the disks, ``T = 1/2 sum J_i phi_i'^2`` (Lashko, (3.1)).

    Parameters
    ----------
    train : DriveTrain
    velocity : array ``(S,)`` rad/s, rings of dampers last

    Returns
    -------
    scalar array, J

    Examples
    --------
    >>> import jax.numpy as jnp, jaxhb
    >>> train = jaxhb.build([jaxhb.Disk(name="a", inertia=2.0)])
    >>> float(jaxhb.kinetic_energy(train, jnp.array([3.0])))
    9.0
    """
    system = chain.assemble(train)
    return jnp.sum(system.mass * (system.radius * velocity) ** 2) / 2


def strain_energy(train: DriveTrain, angle: Array) -> Array:
    """Strain energy ``Pi = 1/2 sum c_i l_i^2`` of shafts, damper springs, meshes and grounds (Lashko, (3.2)).

    Parameters
    ----------
    train : DriveTrain
    angle : array ``(S,)`` rad, rings of dampers last

    Returns
    -------
    scalar array, J

    Examples
    --------
    >>> import jax.numpy as jnp, jaxhb
    >>> parts = [jaxhb.Disk(name="a", inertia=2.0), jaxhb.Disk(name="b", inertia=1.0)]
    >>> train = jaxhb.build([*parts, jaxhb.Shaft(between=("a", "b"), stiffness=100.0)])
    >>> float(jaxhb.strain_energy(train, jnp.array([0.3, 0.1]))).__round__(12)
    2.0
    """
    system = chain.assemble(train)
    displacement = system.radius * jnp.asarray(angle)
    links = jnp.sum(system.stiffness * system.deflections(displacement) ** 2)
    return (links + jnp.sum(system.ground * displacement**2)) / 2


def inertia_and_stiffness(train: DriveTrain) -> tuple[Array, Array]:
    """Matrices J and C of ``J phi'' + C phi = 0`` (Lashko, (3.4)), second derivatives of the energies.

    Parameters
    ----------
    train : DriveTrain

    Returns
    -------
    inertia : array ``(S, S)`` kg m2
    stiffness : array ``(S, S)`` N m/rad

    Examples
    --------
    >>> import jaxhb
    >>> parts = [jaxhb.Disk(name="a", inertia=2.0), jaxhb.Disk(name="b", inertia=1.0)]
    >>> train = jaxhb.build([*parts, jaxhb.Shaft(between=("a", "b"), stiffness=100.0)])
    >>> jaxhb.inertia_and_stiffness(train)[1].tolist()
    [[100.0, -100.0], [-100.0, 100.0]]
    """
    rest = jnp.zeros(train.topology.n_disks)
    return jax.hessian(lambda v: kinetic_energy(train, v))(rest), jax.hessian(lambda a: strain_energy(train, a))(rest)

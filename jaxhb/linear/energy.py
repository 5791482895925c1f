"""Kinetic and strain energy of the train as quadratic forms of its angles, and the matrices that follow from them.

Lashko's energies of a chain, here with meshes, whose deflection is ``r_a phi_a - r_b phi_b``, and ground springs.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from jaxhb._jax import Array
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain


def kinetic_energy(train: DriveTrain, velocity: Array) -> Array:
    """Kinetic energy in J, ``T = 1/2 sum J_i phi_i'^2`` (Lashko, (3.1)), of disks with ``velocity`` ``(S,)`` in rad/s.

    Rings of dampers come last.

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
    """Strain energy in J of links and grounds, ``Pi = 1/2 sum c_i l_i^2`` (Lashko, (3.2)), at ``angle`` ``(S,)`` rad.

    Rings of dampers come last.

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
    """Matrices J in kg m2 and C in N m/rad, ``(S, S)``, of ``J phi'' + C phi = 0`` (Lashko, (3.3) and (3.4)).

    They are the second derivatives of :func:`kinetic_energy` and :func:`strain_energy`.

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

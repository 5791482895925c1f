"""The residual A(x) of the whole train in the Fourier domain, and its Jacobian in packed coordinates.

    A(x) = Z x + D^T (mesh forces of the backlash meshes) - q,      Z = -n^2 Omega^2 M + i n Omega B + K + link damping,

the Galerkin equations of Fridman 2009 (with the opposite sign), ``x`` the displacements of all disks, real packed
coordinates ``(S, 2N+1)``. One pure function of arrays; :func:`jaxhb.equations.condensation.Reduced.residual` is the
same equation condensed to the meshes.
"""

from dataclasses import dataclass

import jax
import numpy as np

from jaxhb._jax import namespace
from jaxhb.equations import backlash, fourier
from jaxhb.equations.dynamic_stiffness import disk_stiffness, frequencies, link_stiffness


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MeshParameters:
    """Some meshes of a train: link indices, law, damping and damping law, each ``(n,)``.

    The equations in harmonics take all (:func:`all_meshes`), as any may be active or held on a flank; those in time the
    ones with backlash (:func:`backlash_meshes`): the others are linear links there.
    """

    link: jax.Array
    law: backlash.Law
    viscous: jax.Array
    contact_damping: jax.Array


def all_meshes(train):
    """Every mesh as an entry of :class:`MeshParameters`; linear ones have epsilon 1 and a gap of 1 m."""
    xp = namespace(train)
    topology, law = train.topology, backlash.law_of(train.meshes)
    gap = np.array(topology.mesh_backlash, dtype=bool)
    first = len(topology.link_names) - len(gap)
    in_contact = np.array([law == "contact" for law in topology.mesh_damping_law], dtype=bool) & gap
    return MeshParameters(
        link=np.arange(first, first + len(gap), dtype=np.int32),
        law=backlash.Law(
            stiffness=xp.asarray(law.stiffness),
            epsilon=xp.where(gap, law.epsilon, 1.0),
            transition=xp.where(gap, law.transition, 0.5),
            backlash=xp.where(gap, law.backlash, 1.0),
        ),
        viscous=xp.asarray(train.meshes.damping),
        contact_damping=in_contact,
    )


def backlash_meshes(train):
    """The meshes that have backlash, in the order of the scene, as :class:`MeshParameters`."""
    index = train.topology.backlash_index
    return jax.tree.map(lambda a: a[index], all_meshes(train))


def residual(packed, system, meshes, frequency, load, samples):
    """A(x) in packed coordinates.

    Parameters
    ----------
    packed : array ``(S, 2N+1)`` m
    system : System
    meshes : MeshParameters, at least those with backlash; the others are linear links
    frequency : float, Omega in rad/s
    load : complex array ``(S, N+1)`` N
    samples : int
        Time samples per cycle at which the law is evaluated; at least 2N+1, 16 N by default elsewhere.

    Returns
    -------
    array ``(S, 2N+1)`` N
    """
    x = fourier.unpack(packed)
    harmonics = x.shape[-1] - 1
    omega = frequencies(frequency, harmonics)
    node = disk_stiffness(omega, system.mass[:, None], system.damping[:, None], system.ground[:, None])
    deflection = system.deflections(x)
    force = link_stiffness(system, omega) * deflection
    mesh = deflection[meshes.link]
    rate = fourier.derivative(mesh, frequency)
    values = backlash.mesh_force(
        meshes.law.expand(),
        meshes.viscous[:, None],
        meshes.contact_damping[:, None],
        fourier.synthesize(mesh, samples),
        fourier.synthesize(rate, samples),
    )
    force = force.at[meshes.link].set(fourier.analyze(values, harmonics))
    return fourier.pack(node * x - load + system.spread(force))


def link_blocks(packed, system, meshes, frequency, samples):
    """Tangent blocks ``(L, P, P)`` of all links at x: diagonal for linear links, Toeplitz for backlash meshes.

    For a backlash mesh the block is ``T[df/dl] + T[df/dl'] d/dt``, with the slopes of the law written out by hand.
    """
    x = fourier.unpack(packed)
    harmonics = x.shape[-1] - 1
    omega = frequencies(frequency, harmonics)
    blocks = fourier.packed_diagonal(link_stiffness(system, omega))
    mesh = system.deflections(x, meshes.link)
    rate = fourier.derivative(mesh, frequency)
    slope, rate_slope = backlash.mesh_slopes(
        meshes.law.expand(),
        meshes.viscous[:, None],
        meshes.contact_damping[:, None],
        fourier.synthesize(mesh, samples),
        fourier.synthesize(rate, samples),
    )
    # A product with a slope couples harmonics n and m by its harmonic n - m: 2 N of them are needed.
    stiffness = fourier.product_matrix(fourier.analyze(slope, 2 * harmonics))
    damping = fourier.product_matrix(fourier.analyze(rate_slope, 2 * harmonics))
    return blocks.at[meshes.link].set(stiffness + damping @ fourier.packed_diagonal(1j * omega))


def node_blocks(system, frequency, harmonics):
    """Diagonal blocks ``(S, P, P)`` of the disks: inertia, damping to ground and ground."""
    omega = frequencies(frequency, harmonics)
    node = disk_stiffness(omega, system.mass[:, None], system.damping[:, None], system.ground[:, None])
    return fourier.packed_diagonal(node + 0j)

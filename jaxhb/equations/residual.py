"""The residual A(x) of the whole train in the Fourier domain, and its Jacobian in packed coordinates.

    A(x) = Z x + D^T (mesh forces of the backlash meshes) - q,      Z = -n^2 Omega^2 M + i n Omega B + K + link damping,

the Galerkin equations of Fridman 2009 (with the opposite sign), ``x`` the displacements of all disks, real packed
coordinates ``(S, 2N+1)``. :class:`jaxhb.equations.condensation.CondensedEquation` is the same equation condensed to
the meshes.
"""

from jaxhb.equations import backlash, fourier
from jaxhb.equations.dynamic_stiffness import disk_stiffness, frequencies, link_stiffness


def residual(packed, system, meshes, frequency, load, samples):
    """A(x) ``(S, 2N+1)`` N at ``packed`` displacements ``(S, 2N+1)`` m.

    meshes : MeshParameters, at least those that have a law; the others are linear links; frequency : Omega in rad/s;
    load : complex ``(S, N+1)`` N, without that of transmission errors; samples : per cycle, at which the law is
    evaluated, at least 2N+1.
    """
    deflection = fourier.pack(system.deflections(fourier.unpack(packed)))
    return residual_of(packed, deflection, system, meshes, frequency, load, samples)


def residual_of(displacement, deflection, system, meshes, frequency, load, samples):
    """The same at packed displacements ``(S, 2N+1)`` m and the deflections ``(L, 2N+1)`` m of all links between them,
    which a train that turns far as one does not tell by their differences."""
    x, deflection = fourier.unpack(displacement), fourier.unpack(deflection)
    harmonics = x.shape[-1] - 1
    omega = frequencies(frequency, harmonics)
    force = link_stiffness(system, omega) * deflection
    mesh = backlash.less_error(meshes, deflection[meshes.link])
    values = _at_samples(backlash.mesh_force, meshes, mesh, frequency, samples)
    force = force.at[meshes.link].set(fourier.analyze(values, harmonics))
    return fourier.pack(_disks(system, omega) * x - load + system.spread(force))


def link_blocks(packed, system, meshes, frequency, samples):
    """Tangent blocks ``(L, P, P)`` of all links at packed deflections ``(L, P)`` m: diagonal for linear links, for
    backlash meshes Toeplitz, ``T[df/dl] + T[df/dl'] d/dt``, with the slopes of the law written out by hand."""
    deflection = fourier.unpack(packed)
    harmonics = deflection.shape[-1] - 1
    omega = frequencies(frequency, harmonics)
    blocks = fourier.packed_diagonal(link_stiffness(system, omega))
    mesh = backlash.less_error(meshes, deflection[meshes.link])
    slope, rate_slope = _at_samples(backlash.mesh_slopes, meshes, mesh, frequency, samples)
    # A product with a slope couples harmonics n and m by its harmonic n - m: 2 N of them are needed.
    stiffness = fourier.product_matrix(fourier.analyze(slope, 2 * harmonics))
    damping = fourier.product_matrix(fourier.analyze(rate_slope, 2 * harmonics))
    return blocks.at[meshes.link].set(stiffness + damping @ fourier.packed_diagonal(1j * omega))


def node_blocks(system, frequency, harmonics):
    """Diagonal blocks ``(S, P, P)`` of the disks: inertia, damping to ground and ground."""
    return fourier.packed_diagonal(_disks(system, frequencies(frequency, harmonics)) + 0j)


def _disks(system, omega):
    return disk_stiffness(omega, system.mass[:, None], system.damping[:, None], system.ground[:, None])


def _at_samples(function, meshes, deflection, frequency, samples):
    """A function of the law of the meshes along the motion with coefficients ``deflection``, at time samples."""
    motion = (fourier.synthesize(x, samples) for x in (deflection, fourier.derivative(deflection, frequency)))
    return function(*backlash.at_samples(meshes, fourier.Equidistant(samples).synthesize), *motion)

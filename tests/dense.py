"""A slow twin of the package: dense matrices in angles, from the elements alone, in
numpy. Nothing here comes from the package.

Disks come in the order of the list, rings of dampers last, as in the package; every
rotor's own sense is positive, so that a mesh between gears a and b deflects by ``r_a
phi_a - r_b phi_b``.
"""

import numpy as np

from jaxhb import Damper, Disk, Ground, Mesh, Shaft, Torque


def of_kind(parts, kind):
    return [part for part in parts if isinstance(part, kind)]


def disk_names(parts):
    return [p.name for p in of_kind(parts, Disk)] + [
        p.name for p in of_kind(parts, Damper)
    ]


def radius_of(parts, name):
    return next(p.radius for p in of_kind(parts, Disk) if p.name == name)


def links(parts):
    """Pairs ``(element, row)`` of shafts, dampers, meshes: the row gives the deflection
    (rad or m) from the angles.
    """
    names = disk_names(parts)
    rows = []
    for kind in (Shaft, Damper, Mesh):
        for p in of_kind(parts, kind):
            a, b = (p.disk, p.name) if kind is Damper else p.between
            row = np.zeros(len(names))
            row[names.index(a)] += radius_of(parts, a) if kind is Mesh else 1.0
            row[names.index(b)] -= radius_of(parts, b) if kind is Mesh else 1.0
            rows.append((p, row))
    return rows


def link_stiffness(part, omega):
    loss = getattr(part, "loss_factor", 0.0) if omega else 0.0
    return part.stiffness * (1 + 1j * loss) + 1j * omega * part.damping


def node_stiffness(parts, omega):
    """Diagonal ``(S, S)``: inertia, damping to ground and ground springs."""
    names = disk_names(parts)
    Z = np.zeros((len(names), len(names)), complex)
    for p in of_kind(parts, Disk) + of_kind(parts, Damper):
        i = names.index(p.name)
        Z[i, i] += -(omega**2) * p.inertia + (
            1j * omega * p.damping if isinstance(p, Disk) else 0.0
        )
    for p in of_kind(parts, Ground):
        i = names.index(p.disk)
        Z[i, i] += p.stiffness
    return Z


def dynamic_stiffness(parts, omega):
    """Dynamic stiffness ``(S, S)`` with all meshes in contact."""
    Z = node_stiffness(parts, omega)
    for part, row in links(parts):
        Z += link_stiffness(part, omega) * np.outer(row, row)
    return Z


def torques(parts, harmonics, cycle):
    """Two-sided coefficients ``(S, N+1)`` of the external torques (orders of the
    reference rotor, no scale).
    """
    names = disk_names(parts)
    T = np.zeros((len(names), harmonics + 1), complex)
    for p in of_kind(parts, Torque):
        i = names.index(p.disk)
        T[i, 0] += p.mean
        for order, re, im in p.harmonics:
            T[i, round(order * cycle)] += 0.5 * complex(re, im)
    return T


def law(mesh, l):
    """Law (18) of a mesh piece by piece, with its share of contact."""
    c2 = mesh.stiffness
    c1 = mesh.epsilon * mesh.stiffness
    h = mesh.backlash
    tau = mesh.transition
    low = (1 - tau) * h / 2
    high = (1 + tau) * h / 2
    s = np.sign(l)
    d = np.abs(l)
    rise = c1 * low + c1 * (d - low) + (c2 - c1) * (d - low) ** 2 / (2 * tau * h)
    force = np.where(
        d < low, c1 * d, np.where(d < high, rise, c2 * d - (c2 - c1) * h / 2)
    )
    share = np.where(d < low, 0.0, np.where(d < high, (d - low) / (tau * h), 1.0))
    return s * force, share


def galerkin_residual(parts, angles, frequency, cycle, samples):
    """Torque balance ``(S, N+1)`` of angles by plain sums over time samples, in N m."""
    harmonics = angles.shape[1] - 1
    n = np.arange(harmonics + 1)
    t = 2 * np.pi * np.arange(samples) / samples
    wave = np.exp(1j * np.outer(n, t)) * np.where(n == 0, 1, 2)[:, None]
    back = np.exp(-1j * np.outer(t, n)) / samples
    balance = -torques(parts, harmonics, cycle)
    for k in n:
        balance[:, k] += node_stiffness(parts, k * frequency) @ angles[:, k]
    for part, row in links(parts):
        deflection = row @ angles
        if isinstance(part, Mesh) and part.backlash is not None:
            l = (deflection @ wave).real
            rate = (1j * frequency * n * deflection @ wave).real
            elastic, share = law(part, l)
            acting = share if part.damping_law == "contact" else 1.0
            force = (elastic + part.damping * rate * acting) @ back
        else:
            stiffness = np.array([link_stiffness(part, k * frequency) for k in n])
            force = stiffness * deflection
        balance += np.outer(row, force)
    return balance

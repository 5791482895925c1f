"""The linear train as dense first-order equations in energy coordinates; nothing is shared with the tree sweep.

With every mesh taken in contact the displacements obey ``M x'' + B x' + K x = q - D^T phi``. The state is

    y = (s q, p, v),     q = Q^T M^(1/2) x,     v = q',     p = scaled displacements of damped massless disks,

with Q the undamped modes and ``s = max(omega, Omega)``: ``|y|^2`` is twice the energy of all modes above the
excitation, so that propagators, monodromy matrices and their singular values are well scaled from the free rotation (s
q of a floating train) to the stiffest tooth. Massless disks without damping are condensed statically; massless disks
whose damping matrix is regular have the first-order equation ``B x' + K x = q``.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jax import lax

from jaxhb._jax import namespace


@dataclass(frozen=True)
class ModalOptions:
    """What a modal form takes for zero, and how it is kept regular.

    Parameters
    ----------
    light : share of the mean inertia that a disk without inertia gets: its mode is then far above all others
    rotation : share of the highest squared frequency below which a mode is free rotation, as far as rounding shows it
    held : frequency given to free rotation, as a share of that of the cycle, by springs in proportion to the inertias
    held_rounded : least square of that frequency, as a share of the highest one, which rounding leaves
    condition : of the eigenvectors above which damping is added
    parting : that damping, as a share of the largest
    """

    light: float = 1e-6
    rotation: float = 1e-14
    held: float = 1e-5
    held_rounded: float = 1e-15
    condition: float = 1e7
    parting: float = 1e-9


MODAL = ModalOptions()


@dataclass(frozen=True)
class Partition:
    """Disks by the order of their equation: inertial (second), damped massless (first), static massless (none)."""

    inertial: tuple[int, ...]
    damped: tuple[int, ...] = ()
    static: tuple[int, ...] = ()


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class StateSpace:
    """``y' = A y + E phi``, mesh deflections and rates ``w = L y`` (l before l'), ``y = T (x, x')``.

    transition A ``(n, n)`` 1/s; forcing E ``(n, G)``; observation L ``(2G, n)``; coordinates T ``(n, 2S)``.
    """

    transition: jax.Array
    forcing: jax.Array
    observation: jax.Array
    coordinates: jax.Array


def matrices(system):
    """Dense damping matrix B and stiffness matrix K ``(S, S)``, meshes taken in contact."""
    xp, D = namespace(system), system.incidence().T
    B = xp.diag(system.damping) + D.T @ (system.viscous[:, None] * D)
    K = xp.diag(system.ground) + D.T @ (system.stiffness[:, None] * D)
    return B, K


def loss_stiffness(system):
    """The imaginary part ``(S, S)`` N/m that loss factors add to K for harmonics above 0."""
    D = system.incidence().T
    return D.T @ ((system.loss * system.stiffness)[:, None] * D)


def loss_damping(system):
    """Damping matrix ``(S, S)`` N s/m, on the host, that takes as much from every mode as loss factors do.

    A loss factor has no equation in time. With the undamped modes (``Phi^T M Phi = 1``, ``Phi^T K Phi = W^2``) and the
    imaginary stiffness H, the matrix C of ``Phi^T C Phi = W^-1/2 Phi^T H Phi W^-1/2`` is symmetric, takes energy from
    all motions, and gives each mode the damping ratio that H gives it at its own frequency; off its resonance a mode is
    hardly damped by either.
    """
    if not np.any(system.loss):
        return np.zeros((len(system.mass),) * 2)
    mass = np.where(system.mass > 0, system.mass, MODAL.light * np.mean(system.mass))
    scale = np.sqrt(mass)[:, None]
    squares, shapes = np.linalg.eigh(matrices(system)[1] / scale / scale.T)
    moving = squares > MODAL.rotation * squares[-1]
    root = np.where(moving, np.where(moving, squares, 1.0) ** -0.25, 0.0)
    left = scale * shapes * root
    return left @ ((shapes / scale).T @ loss_stiffness(system) @ (shapes / scale)) @ left.T


def partition(system, meshes, disk_names=None, link_names=None, lossy=False):
    """Sort the disks by the order of their equation of motion, on the host.

    Parameters
    ----------
    system : System
    meshes : MeshParameters, the backlash meshes
    disk_names, link_names : sequence of str, optional
        For the sentences of errors; "disk 3" and "link 5" without.
    lossy : bool, whether loss factors are served, by :func:`loss_damping`

    Returns
    -------
    Partition
        Hashable; pass it as ``parts`` where the system is traced.

    Raises
    ------
    ValueError
        Naming the loss factors, or the massless disks that leave no equation to integrate.
    """
    for leaf in jax.tree.leaves((system, meshes)):
        if isinstance(leaf, jax.core.Tracer):
            raise ValueError("jit or vmap traces the train: pass parts=partition(system, meshes), made outside.")

    def disk(index):
        return repr(disk_names[index]) if disk_names else f"disk {index}"

    def link(index):
        return repr(link_names[index]) if link_names else f"link {index}"

    refused = [] if lossy else np.flatnonzero(np.asarray(system.loss))
    if len(refused):
        raise ValueError(
            f"{', '.join(link(i) for i in refused)}: loss factors exist only in harmonic methods: "
            "apply train.with_viscous_damping(hz=...)."
        )
    massless = np.flatnonzero(np.asarray(system.mass) == 0)
    meshed = np.asarray(meshes.link)
    ends = {*np.asarray(system.tree.end_a)[meshed].tolist(), *np.asarray(system.tree.end_b)[meshed].tolist()}
    for index in massless:
        if int(index) in ends:
            raise ValueError(
                f"{disk(index)} has no inertia and carries a backlash mesh: no equation of motion in time "
                "is left for it. Give it an inertia, or use a harmonic method."
            )
    B, K = matrices(jax.tree.map(np.asarray, system))
    undamped = ~np.any(B[massless] != 0, axis=1)
    static, damped = massless[undamped], massless[~undamped]
    for group, matrix, what in ((static, K, "stiffness"), (damped, B, "damping")):
        if group.size and not _regular(matrix[np.ix_(group, group)]):
            names = ", ".join(disk(i) for i in group)
            raise ValueError(
                f"{names}: no inertia, and the {what} between them does not determine their motion. "
                "Give them an inertia, or use a harmonic method."
            )
    inertial = np.flatnonzero(np.asarray(system.mass) != 0)
    return Partition(*(tuple(int(i) for i in group) for group in (inertial, damped, static)))


def _regular(matrix):
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return np.linalg.eigvalsh(matrix / scale[:, None] / scale)[0] > 1e-10


def state_space(system, meshes, frequency, parts, damping=0.0):
    """First-order equations of the train in energy coordinates.

    Parameters
    ----------
    system : System
    meshes : MeshParameters, the backlash meshes
    frequency : float, Omega in rad/s, only to scale the slow modes
    parts : Partition
    damping : array ``(S, S)`` N s/m, beside that of the system

    Returns
    -------
    StateSpace
    """
    xp, (B, K) = namespace(system, meshes, frequency), matrices(system)
    B = B + damping
    inertial, damped, static = (np.array(g, dtype=int) for g in (parts.inertial, parts.damped, parts.static))
    kept = np.concatenate([inertial, damped])
    stiffness = K[np.ix_(kept, kept)]
    if static.size:
        coupling = K[np.ix_(static, kept)]
        stiffness = stiffness - coupling.T @ xp.linalg.solve(K[np.ix_(static, static)], coupling)
    n, extra = inertial.size, damped.size
    root = xp.sqrt(system.mass[inertial])
    to_modal, from_modal, scale = _modes(stiffness[:n, :n], root, frequency)
    drag = B[np.ix_(kept, kept)]
    # x' of the damped massless disks from x and v: B x' + K x = 0
    follow = xp.zeros((extra, 2 * n + extra))
    if extra:
        right = xp.concatenate([stiffness[n:], drag[n:, :n]], axis=1)
        # Damped disks without inertia: B x' + K x = q gives their velocity from all displacements and the others'
        # velocities.
        follow = -xp.linalg.solve(drag[n:, n:], right)
    motion = xp.concatenate([xp.zeros((n, n + extra)), xp.eye(n)], axis=1)
    pull = xp.concatenate([stiffness[:n], drag[:n, :n]], axis=1) + drag[:n, n:] @ follow
    physical = xp.concatenate([motion, follow, -pull / (root**2)[:, None]])

    weight = xp.sqrt(xp.mean(root**2)) * frequency
    to = _blocks(scale[:, None] * to_modal, weight * xp.eye(extra), to_modal)
    back = _blocks(from_modal / scale, xp.eye(extra) / weight, from_modal)
    mesh_rows = system.incidence(meshes.link).T[:, inertial]
    forcing = xp.concatenate([xp.zeros((n + extra, meshes.link.shape[0])), -mesh_rows.T / (root**2)[:, None]])
    zeros = xp.zeros((meshes.link.shape[0], n + extra))
    position = xp.concatenate([mesh_rows, xp.zeros((mesh_rows.shape[0], extra + n))], axis=1)
    speed = xp.concatenate([zeros, mesh_rows], axis=1)
    disks = system.mass.shape[0]
    return StateSpace(
        transition=to @ physical @ back,
        forcing=to @ forcing,
        observation=xp.concatenate([position, speed]) @ back,
        coordinates=to @ np.eye(2 * disks)[np.concatenate([kept, disks + inertial])],
    )


def _modes(stiffness, root, frequency):
    """Modal coordinates of the inertial disks; any orthonormal basis is exact, hence no derivative through it."""
    xp = namespace(stiffness, root, frequency)
    constant = lax.stop_gradient if xp is jnp else lambda a: a
    values, vectors = xp.linalg.eigh(constant(stiffness / root[:, None] / root))
    scale = constant(xp.sqrt(xp.maximum(values, frequency**2)))
    return vectors.T * root, vectors / root[:, None], scale


def _blocks(*blocks):
    joined = scipy.linalg.block_diag if namespace(blocks) is np else jax.scipy.linalg.block_diag
    return joined(*blocks)


def dense_linear_motion(system, frequency, load):
    """Steady displacements of the train with all meshes in contact, one dense solve per harmonic.

    Parameters
    ----------
    system : System
    frequency : float, Omega in rad/s
    load : complex array ``(S, N+1)`` N

    Returns
    -------
    complex array ``(S, N+1)`` m
        Displacements that no force opposes (the rotation of a floating train, rings without spring) have mean zero.
    """
    xp, (B, K) = namespace(system, frequency, load), matrices(system)
    mean = static_response(K, load[:, 0].real)
    omega = frequency * xp.arange(1, load.shape[-1])
    K = K + 1j * loss_stiffness(system)
    Z = K + 1j * omega[:, None, None] * B - omega[:, None, None] ** 2 * xp.diag(system.mass)
    harmonics = xp.linalg.solve(Z, load[:, 1:].T[..., None])[..., 0].T
    return xp.concatenate([mean[:, None] + 0j, harmonics], axis=1)


def static_response(K, force):
    """K^-1 force, without the motions that meet no stiffness (the load is balanced on them)."""
    xp = namespace(K, force)
    diagonal = xp.diag(K)
    scale = xp.sqrt(xp.where(diagonal > 0, diagonal, 1.0))
    values, vectors = xp.linalg.eigh(K / scale[:, None] / scale)
    # Scaled by the diagonal: what is left of an eigenvalue that should be zero is rounding.
    held = values > 1e-13
    inverse = xp.where(held, 1.0, 0.0) / xp.where(held, values, 1.0)
    return (vectors @ (inverse * (vectors.T @ (force / scale)))) / scale

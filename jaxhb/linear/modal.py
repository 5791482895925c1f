"""Natural frequencies and mode shapes of the undamped train, backlash meshes taken in
contact.

With E = C^(1/2) D M^(-1/2), E^T E = M^(-1/2) K M^(-1/2): natural frequencies are
singular values of E (docs/theory B). A row has two entries that differ in sign, which
no sum has rounded: stiff and soft links keep their own digits. The number of zero
frequencies is counted on the graph, never judged by size. Disks without inertia are
eliminated first, from a star of links to its mesh, by sums of positive numbers.
"""

from collections import defaultdict
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh_tridiagonal, eigvalsh_tridiagonal, lapack

from jaxhb._jax import Array, namespace, on_host, refuse_tracers
from jaxhb._shown import brief
from jaxhb.equations.system import System, Tree
from jaxhb.linear.tangent import linear_train
from jaxhb.train import chain
from jaxhb.train.connections import pieces
from jaxhb.train.drivetrain import DriveTrain

FEW = 10  # fewer modes than 1/FEW of all are computed by Lanczos steps
# Share of the largest square of a frequency: far below the squares that are computed,
# above their rounding
SHIFT = 1e-9
DENSE = 500  # disks above which a dense factor takes longer than a few seconds
SMALL = 1e-3
"""Singular value over the largest up to which the fast method, exact to rounding of the
largest, loses digits.
"""
EVERY_DIGIT = 2 * np.finfo(float).tiny
"""Absolute tolerance that makes LAPACK's bisection (dstebz) stop by its relative
one.
"""
# Ordinate over the largest one below which a disk lies in a node: rounding of a mode
# shape
AT_REST = 1e-10

DIFFERENTIABLE = (
    "take jaxhb.frequencies_hz and jaxhb.mode_shares, which have derivatives"
)


Link = tuple[int, int, float, float, float]
"""Numbers of the disks at both ends of a link, its stiffness in N/m, and its arms."""


@dataclass(frozen=True)
class Factor:
    """Rows of E, elastic links and grounds between the H disks with inertia and the
    ground, which is number H.

    stiffness ``(n,)`` N/m; ends, arms ``(n, 2)``; mass ``(H,)`` kg; heavy ``(H,)``,
    numbers of these disks among all S; rigid ``(H, pieces)``, unit columns of M^(1/2)
    x, one for each piece that nothing holds; eliminated : list of (disk, neighbours,
    weights), displacements of disks without inertia from those eliminated later and the
    ground, number S.
    """

    stiffness: np.ndarray
    ends: np.ndarray
    arms: np.ndarray
    mass: np.ndarray
    heavy: np.ndarray
    rigid: np.ndarray
    eliminated: list

    def entries(self) -> np.ndarray:
        """Both entries of each row ``(n, 2)`` in rad/s; those of the ground, a disk of
        infinite mass, are 0.
        """
        mass = np.append(self.mass, np.inf)[self.ends]
        return np.sqrt(self.stiffness)[:, None] * self.arms * [1, -1] / np.sqrt(mass)

    def dense(self) -> np.ndarray:
        """E ``(n, H)`` in rad/s."""
        E = np.zeros((len(self.stiffness), len(self.mass) + 1))
        np.put_along_axis(E, self.ends, self.entries(), axis=1)
        return E[:, :-1]

    def displacements(self, heavy: np.ndarray, disks: int) -> np.ndarray:
        """Displacements ``(S, m)`` of all S ``disks`` from those with inertia ``(H,
        m)``; the other disks lie where they store least energy.
        """
        displacement = np.zeros((disks + 1, heavy.shape[1]))
        displacement[self.heavy] = heavy
        for disk, neighbours, weights in reversed(self.eliminated):
            displacement[disk] = weights @ displacement[neighbours]
        return displacement[:-1]

    def path(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Rows of E from one free end of a chain to the other, and its disks; None for
        other and small trains.
        """
        ground = len(self.mass)
        pairs = self.ends.tolist()
        links_at = np.bincount(self.ends.ravel(), minlength=ground + 1)
        free = np.flatnonzero(links_at[:-1] == 1)
        piece = np.array(pieces(ground + 1, pairs))[links_at > 0]
        # A chain has the ground at one end at most.
        if (
            ground <= DENSE
            or not len(free)
            or max(links_at) > 2
            or links_at[-1] > 1
            or np.ptp(piece)
        ):
            return None
        root = ground if links_at[-1] else int(free[-1])
        tree = chain.span_links(pairs, ground + 1, root)
        return tree.link[:-1], tree.node


def factor(train: DriveTrain) -> tuple[System, Factor]:
    """The System of a concrete train, meshes in contact, and its :class:`Factor`,
    without links of no stiffness.
    """
    train = linear_train(train)
    system = on_host(chain.assemble(train))
    rigid = np.asarray(chain.rigid_shape(train, system.radius))
    disks = len(system.mass)
    elastic = np.flatnonzero(system.stiffness)
    held = np.flatnonzero(system.ground)
    columns = (
        system.tree.end_a,
        system.tree.end_b,
        system.stiffness,
        system.arm_a,
        system.arm_b,
    )
    links = list(zip(*(column[elastic].tolist() for column in columns), strict=True))
    # The ground is one more node, the last.
    links += [
        (disk, disks, stiffness, 1.0, 1.0)
        for disk, stiffness in zip(held, system.ground[held], strict=True)
    ]
    heavy = np.flatnonzero(system.mass)
    mass = np.asarray(system.mass)[heavy]
    root = np.sqrt(mass) * rigid[heavy]
    piece = np.array(pieces(disks + 1, [(a, b) for a, b, *_ in links]))
    loose = [
        np.flatnonzero(piece[heavy] == number)
        for number in dict.fromkeys(piece[heavy].tolist())
        if number != piece[-1]
    ]
    shapes = np.zeros((len(heavy), len(loose)))
    # Heaviest first: the rotation of the train comes before that of loose rings.
    loose.sort(key=lambda members: -mass[members].sum())
    for column, members in enumerate(loose):
        shapes[members, column] = root[members] / np.linalg.norm(root[members])
    links, eliminated = _without_light_disks(
        links, np.flatnonzero(system.mass == 0).tolist()
    )
    number = np.full(disks + 1, len(heavy))
    number[heavy] = np.arange(len(heavy))
    table = np.array(links, dtype=float).reshape(-1, 5)
    ends = number[table[:, :2].astype(int)]
    return system, Factor(
        table[:, 2], ends, table[:, 3:], mass, heavy, shapes, eliminated
    )


def _without_light_disks(
    rows: list[Link], light: list[int]
) -> tuple[list[Link], list[tuple[int, np.ndarray, np.ndarray]]]:
    """Links after elimination of the disks ``light``, and the weights with which these
    follow their neighbours.

    At the least energy of links k_i with deflections s_i x - o_i y_i, x = sum k_i s_i
    o_i y_i / sum k_i s_i^2, and links k_i k_j / sum k s^2 with deflections s_j o_i y_i
    - s_i o_j y_j are left between all pairs of neighbours.
    """
    links = dict(enumerate(rows))
    eliminated = []
    links_at = defaultdict(set)
    for link, (a, b, *_) in links.items():
        for end in (a, b):
            links_at[end].add(link)
    count = len(links)
    for disk in light:
        star = []
        for link in sorted(links_at[disk]):
            a, b, k, arm_a, arm_b = links.pop(link)
            links_at[b if a == disk else a].discard(link)
            star.append((b, k, arm_a, arm_b) if a == disk else (a, k, arm_b, arm_a))
        total = sum(k * near**2 for _, k, near, _ in star)
        neighbours = np.array([neighbour for neighbour, *_ in star], dtype=int)
        weights = np.array([k * near * far / total for _, k, near, far in star])
        eliminated.append((disk, neighbours, weights))
        for i, (p, k_p, near_p, far_p) in enumerate(star):
            for q, k_q, near_q, far_q in star[i + 1 :]:
                if p == q:
                    # Parallel links to one neighbour do not bend: their ratios agree
                    continue
                stiffness = k_p * (k_q / total)
                links[count] = (p, q, stiffness, near_q * far_p, near_p * far_q)
                for end in (p, q):
                    links_at[end].add(count)
                count += 1
    return list(links.values()), eliminated


def singular_values(factor: Factor) -> np.ndarray:
    """All singular values ``(H,)`` in rad/s, rising; zeros are exact. Chains of any
    size by the Golub-Kahan tridiagonal.
    """
    path = factor.path()
    if path is None:
        return _with_zeros(factor, _dense(factor, vectors=False)[0])
    off, _ = _golub_kahan(factor, path)
    diagonal = np.zeros(len(off) + 1)
    values = eigvalsh_tridiagonal(diagonal, off)
    # Eigenvalues are the singular values with both signs, and zeros: the positive ones
    # come last.
    first = len(values) - len(factor.stiffness)
    small = int(np.searchsorted(values[first:], SMALL * values[-1]))
    # Bisection: entries of a tridiagonal with zero diagonal fix each eigenvalue to its
    # own last digits
    if small:
        values[first : first + small] = eigvalsh_tridiagonal(
            diagonal,
            off,
            select="i",
            select_range=(first, first + small - 1),
            tol=EVERY_DIGIT,
        )
    return _with_zeros(factor, values[first:])


def _with_zeros(factor: Factor, values: np.ndarray) -> np.ndarray:
    """Singular values behind the exact zeros of the rigid motions."""
    return np.concatenate([np.zeros(factor.rigid.shape[1]), np.abs(values)])


def singular_vectors(
    factor: Factor, count: int | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest ``count`` of the singular values ``(m,)`` in rad/s, and vectors ``(H,
    m)``, orthonormal M^(1/2) x.
    """
    zeros = factor.rigid.shape[1]
    path = factor.path()
    modes = len(factor.heavy) if count is None else min(count, len(factor.heavy))
    moving = len(factor.heavy) - zeros
    if path is None and 0 < modes - zeros < moving // FEW and moving > DENSE:
        values, vectors = _lowest(factor, modes - zeros)
    elif modes <= zeros:
        values = np.zeros(0)
        vectors = np.zeros((len(factor.heavy), 0))
    elif path is None:
        values, vectors = _dense(factor)
    else:
        off, disks = _golub_kahan(factor, path)
        first = len(off) + 1 - len(factor.stiffness)
        values, eigenvectors = eigh_tridiagonal(
            np.zeros(len(off) + 1),
            off,
            lapack_driver="stebz",
            select="i",
            select_range=(first, first + modes - zeros - 1),
            tol=EVERY_DIGIT,
        )
        vectors = np.zeros((len(factor.heavy), len(values)))
        # A unit eigenvector holds a right vector, at even places, and a left one, each
        # of length 1 / sqrt 2.
        vectors[disks] = np.sqrt(2) * eigenvectors[::2]
    return (
        _with_zeros(factor, values)[:modes],
        np.concatenate([factor.rigid, vectors], axis=1)[:, :modes],
    )


def _golub_kahan(
    factor: Factor, path: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Off-diagonal of the tridiagonal form, with zero diagonal, of [[0, E^T], [E, 0]]
    of a chain, and its disks.
    """
    rows, disks = path
    entries = factor.entries()[rows]
    turned = factor.ends[rows, 0] != disks[:-1]
    # Row after row, each with the end first that comes first on the path.
    off = np.where(turned[:, None], entries[:, ::-1], entries).ravel()
    # A chain that ends in the ground has no last disk.
    return (off[:-1], disks[:-1]) if disks[-1] == len(factor.mass) else (off, disks)


def _dense(factor: Factor, vectors: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Singular values that are not zero, rising, and right vectors, no columns unless
    ``vectors``, by Jacobi's method, which keeps the digits of small values.
    """
    moving = len(factor.heavy) - factor.rigid.shape[1]
    if not moving:
        return np.zeros(0), np.zeros((len(factor.heavy), 0))
    E = factor.dense()
    wide = E.shape[0] < E.shape[1]
    # dgejsv needs at least as many rows as columns.
    tall = np.asfortranarray(E.T if wide else E)
    job = 0 if vectors else 3
    values, left, right, scale, _, failed = lapack.dgejsv(
        tall, joba=2, jobu=job, jobv=job
    )
    if failed:
        left, values, right = np.linalg.svd(tall, full_matrices=False)
        scale = np.ones(2)
        right = right.T
    rising = np.s_[moving - 1 :: -1]
    # dgejsv returns scaled values where they would overflow or underflow.
    values = (scale[0] / scale[1] * values)[rising]
    if not vectors:
        return values, np.zeros((len(factor.heavy), 0))
    return values, (left if wide else right)[:, rising]


def _lowest(factor: Factor, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The ``count`` lowest singular values that are not zero, rising, and right
    vectors, of a large train of any shape by Lanczos steps on the inverse of E^T E,
    slightly shifted where rigid motions have zeros.
    """
    from scipy import sparse
    from scipy.sparse.linalg import eigsh

    disks = len(factor.mass)
    rigid = factor.rigid.shape[1]
    links = len(factor.stiffness)
    places = np.repeat(np.arange(links), 2), factor.ends.ravel()
    entries = factor.entries().ravel()
    E = sparse.csr_array((entries, places), shape=(links, disks + 1))[:, :disks]
    square = (E.T @ E).tocsc()
    shift = -SHIFT * square.diagonal().max()
    start = np.cos(np.arange(disks))  # the same at every call
    squares, vectors = eigsh(square, k=count + rigid, sigma=shift, v0=start)
    order = np.argsort(squares)[rigid:]
    return np.sqrt(squares[order]), vectors[:, order]


class ModeShares(NamedTuple):
    """Shapes of m modes and where their energies lie, as in :class:`Modes`."""

    shapes: Array
    generalised_mass: Array
    kinetic_share: Array
    strain_share: Array


@brief
@dataclass(frozen=True)
class Modes:
    """Natural frequencies and shapes of an undamped train.

    Parameters
    ----------
    names : tuple of str, the S disks; link_names : tuple of str, the L links
    frequencies_hz : ``(m,)`` Hz, rising; a free train begins with 0
    shapes : ``(m, S)`` angles of the disks, largest absolute value 1
    mesh_energy_share : ``(m,)`` share of the strain energy that lies in tooth meshes
    generalised_mass : ``(m,)`` kg m2, sum of J phi^2 over the disks
    node_count : ``(m,)`` int, links whose ends move against each other, where ordinates
    exceed 1e-10 of the largest;
        on a chain this is the number of the mode, unless it is confined to a few disks
    kinetic_share : ``(m, S)`` share of each disk in the kinetic energy; each row has
    sum 1
    strain_share : ``(m, L)`` share of each link in the strain energy; ground springs
    have the rest, rigid modes none
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
        """Shape of mode ``number``: the angle of each disk by its name."""
        return dict(zip(self.names, self.shapes[number].tolist(), strict=True))

    @property
    def generalised_stiffness(self) -> Array:
        """Generalised stiffness ``(m,)`` in N m/rad: omega^2 times the generalised
        mass, twice the strain energy of the shape.
        """
        return (2 * np.pi * self.frequencies_hz) ** 2 * self.generalised_mass


def natural_frequencies(train: DriveTrain, *, count: int | None = None) -> Modes:
    """Natural frequencies in Hz with mode shapes, undamped, meshes in contact.

    Solves ``K v = omega^2 M v`` (Lashko, (3.4)) through the singular values of
    ``C^{1/2} D M^{-1/2}``, which keeps the digits of soft modes beside stiff links and
    gives exact zeros to rigid motions, one for each part of the train that no spring
    holds. Disks without inertia are condensed statically; a purely viscous link does
    not count.

    The train is concrete, the modes are all or the lowest ``count``: of a train of more
    than 500 disks compute few, as n modes of S disks take n S numbers.

    >>> jaxhb.natural_frequencies(
    ...     jaxhb.load_scene("six_cylinder_diesel")
    ... ).frequencies_hz[:3].round(1).tolist()
    [0.0, 216.6, 592.7]
    """
    refuse_tracers("natural_frequencies", train, instead=DIFFERENTIABLE, host=True)
    system, rows = factor(train)
    omega, vectors = singular_vectors(rows, count)
    displacement = rows.displacements(
        vectors / np.sqrt(rows.mass)[:, None], len(system.mass)
    )
    energies = shares(system, omega, displacement)
    first_mesh = len(system.stiffness) - len(train.topology.mesh_names)
    return Modes(
        names=train.topology.disk_names,
        frequencies_hz=omega / (2 * np.pi),
        shapes=np.asarray(energies.shapes),
        mesh_energy_share=np.asarray(energies.strain_share[:, first_mesh:].sum(1)),
        link_names=train.topology.link_names,
        generalised_mass=np.asarray(energies.generalised_mass),
        node_count=_sign_changes(system.tree, energies.shapes),
        kinetic_share=np.asarray(energies.kinetic_share),
        strain_share=np.asarray(energies.strain_share),
    )


def shares(system: System, omega: Array, displacement: Array) -> ModeShares:
    """Compute the :class:`ModeShares` of modes with angular frequencies ``(m,)`` and
    displacements ``(S, m)``, which may be traced.
    """
    xp = namespace(system, displacement)
    strain = system.stiffness[:, None] * system.deflections(displacement) ** 2
    total = strain.sum(0) + (system.ground[:, None] * displacement**2).sum(0)
    # The strain of a rigid mode is rounding, which has no shares.
    moving = (total > 0) & (omega > 0)
    strain = xp.where(moving, strain / xp.where(moving, total, 1.0), 0.0)
    angles = displacement / system.radius[:, None]
    largest = xp.abs(angles).argmax(0)
    shapes = (angles / angles[largest, np.arange(len(omega))]).T
    kinetic = shapes**2 * (system.mass * system.radius**2)
    mass = kinetic.sum(1)
    return ModeShares(shapes, mass, kinetic / mass[:, None], strain.T)


def all_frequencies(train: DriveTrain) -> Array:
    """Natural frequencies ``(m,)`` in Hz of a concrete train without shapes, rising,
    one for each disk with inertia.

    A chain (shafts and single gears in a row, one ground at most) of more than 500
    disks is solved by its Golub-Kahan tridiagonal in O(S^2), thousands of disks in
    seconds, any other train by the dense factor in O(S^3).

    >>> jaxhb.all_frequencies(jaxhb.load_scene("six_cylinder_diesel"))[:3].round(
    ...     1
    ... ).tolist()
    [0.0, 216.6, 592.7]
    """
    refuse_tracers("all_frequencies", train, instead=DIFFERENTIABLE, host=True)
    return singular_values(factor(train)[1]) / (2 * np.pi)


def _sign_changes(tree: Tree, shapes: Array) -> np.ndarray:
    """Count the links over which the sign of each shape changes, ``(m,)``; a disk at
    rest goes with a neighbour, so that a node counts once.
    """
    sign = np.where(np.abs(shapes) > AT_REST, np.sign(shapes), 0.0).T
    parents = tree.node[tree.parent[:-1]].tolist()
    pairs = list(zip(tree.node[:-1].tolist(), parents, strict=True))
    for disk, above in pairs:
        sign[above] = np.where(sign[above] == 0, sign[disk], sign[above])
    for disk, above in reversed(pairs):
        sign[disk] = np.where(sign[disk] == 0, sign[above], sign[disk])
    return (sign[tree.end_a] != sign[tree.end_b]).sum(0)

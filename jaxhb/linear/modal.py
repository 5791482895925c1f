"""Natural frequencies and mode shapes of the undamped train, backlash meshes taken in
contact.

With E = C^(1/2) D M^(-1/2), E^T E = M^(-1/2) K M^(-1/2): natural frequencies are
singular values of E (docs/theory B). A row has two entries that differ in sign, which
no sum has rounded: stiff and soft links keep their own digits. How many frequencies are
zero is counted on the graph, never judged by size. Disks without inertia are eliminated
first, from a star of links to its mesh, by sums of positive numbers.
"""

from collections import defaultdict
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh_tridiagonal, eigvalsh_tridiagonal, lapack

from jaxhb._jax import Array, namespace, on_host, refuse_tracers
from jaxhb._shown import brief
from jaxhb.linear.tangent import linear_train
from jaxhb.train import chain
from jaxhb.train.connections import pieces
from jaxhb.train.drivetrain import DriveTrain

FEW = 10  # of so many modes fewer than one, the lowest are found by Lanczos steps
# Of the largest square of a frequency: far below the squares that are asked for, above
# their rounding
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


@dataclass(frozen=True)
class Factor:
    """Rows of E, elastic links and grounds between the H disks with inertia and the
    ground, which is number H.

    stiffness ``(n,)`` N/m; ends, arms ``(n, 2)``; mass ``(H,)`` kg; heavy ``(H,)``,
    these disks among all S; rigid ``(H, pieces)``, unit columns of M^(1/2) x, one for
    each piece that nothing holds; eliminated : list of (disk, neighbours, weights),
    displacements of disks without inertia from those eliminated later and the ground,
    number S.
    """

    stiffness: np.ndarray
    ends: np.ndarray
    arms: np.ndarray
    mass: np.ndarray
    heavy: np.ndarray
    rigid: np.ndarray
    eliminated: list

    def entries(self):
        """The two entries of each row ``(n, 2)`` in rad/s; those of the ground, a disk
        of infinite mass, are 0.
        """
        mass = np.append(self.mass, np.inf)[self.ends]
        return np.sqrt(self.stiffness)[:, None] * self.arms * [1, -1] / np.sqrt(mass)

    def dense(self):
        """E ``(n, H)`` in rad/s."""
        E = np.zeros((len(self.stiffness), len(self.mass) + 1))
        np.put_along_axis(E, self.ends, self.entries(), axis=1)
        return E[:, :-1]

    def displacements(self, heavy, disks):
        """``(S, m)`` of all S disks from those with inertia ``(H, m)``, the others
        where they store least energy.
        """
        found = np.zeros((disks + 1, heavy.shape[1]))
        found[self.heavy] = heavy
        for disk, neighbours, weights in reversed(self.eliminated):
            found[disk] = weights @ found[neighbours]
        return found[:-1]

    def path(self):
        """Rows of E from one free end of a chain to the other, and the disks, or None
        for other and small trains.
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
        tree = chain.span_links(
            pairs, ground + 1, ground if links_at[-1] else int(free[-1])
        )
        return tree.link[:-1], tree.node


def factor(train):
    """The System of a concrete train, meshes in contact, and its :class:`Factor`; links
    without stiffness drop.
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
    links = [*zip(*(column[elastic].tolist() for column in columns), strict=True)]
    # The ground is one more node, the last.
    links += [
        (disk, disks, stiffness, 1.0, 1.0)
        for disk, stiffness in zip(held, system.ground[held], strict=True)
    ]
    heavy = np.flatnonzero(system.mass)
    mass, root = system.mass[heavy], np.sqrt(system.mass[heavy]) * rigid[heavy]
    piece = np.array(pieces(disks + 1, [(a, b) for a, b, *_ in links]))
    loose = [
        np.flatnonzero(piece[heavy] == one)
        for one in dict.fromkeys(piece[heavy].tolist())
        if one != piece[-1]
    ]
    shapes = np.zeros((len(heavy), len(loose)))
    # Heaviest first: the rotation of the train comes before that of loose rings.
    for column, own in enumerate(sorted(loose, key=lambda own: -mass[own].sum())):
        shapes[own, column] = root[own] / np.linalg.norm(root[own])
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


def _without_light_disks(links, light):
    """Links after elimination of the disks ``light``, and how these follow their
    neighbours.

    At the least energy of links k_i with deflections s_i x - o_i y_i, x = sum k_i s_i
    o_i y_i / sum k_i s_i^2, and what is left are links k_i k_j / sum k s^2 with
    deflections s_j o_i y_i - s_i o_j y_j between all pairs of neighbours.
    """
    links = dict(enumerate(links))
    eliminated = []
    at = defaultdict(set)
    for name, (a, b, *_) in links.items():
        for end in (a, b):
            at[end].add(name)
    count = len(links)
    for disk in light:
        star = []
        for name in sorted(at[disk]):
            a, b, k, arm_a, arm_b = links.pop(name)
            at[b if a == disk else a].discard(name)
            star.append((b, k, arm_a, arm_b) if a == disk else (a, k, arm_b, arm_a))
        total = sum(k * own**2 for _, k, own, _ in star)
        neighbours = np.array([other for other, *_ in star], dtype=int)
        eliminated.append(
            (
                disk,
                neighbours,
                np.array([k * own * far / total for _, k, own, far in star]),
            )
        )
        for i, (p, k_p, own_p, far_p) in enumerate(star):
            for q, k_q, own_q, far_q in star[i + 1 :]:
                if p == q:
                    # Parallel links to one neighbour do not bend: their ratios agree
                    continue
                links[count] = (p, q, k_p * (k_q / total), own_q * far_p, own_p * far_q)
                for end in (p, q):
                    at[end].add(count)
                count += 1
    return list(links.values()), eliminated


def singular_values(factor):
    """All ``(H,)`` rising, rad/s; zeros are exact. Chains of any size by the
    Golub-Kahan tridiagonal.
    """
    path = factor.path()
    if path is None:
        return _with_zeros(factor, _dense(factor, vectors=False)[0])
    off, _ = _golub_kahan(factor, path)
    values = eigvalsh_tridiagonal(np.zeros(len(off) + 1), off)
    # Eigenvalues are the singular values with both signs, and zeros: the positive ones
    # come last.
    first = len(values) - len(factor.stiffness)
    small = int(np.searchsorted(values[first:], SMALL * values[-1]))
    # Bisection: entries of a tridiagonal with zero diagonal fix each eigenvalue to its
    # own last digits
    if small:
        few = {
            "select": "i",
            "select_range": (first, first + small - 1),
            "tol": EVERY_DIGIT,
        }
        values[first : first + small] = eigvalsh_tridiagonal(
            np.zeros(len(off) + 1), off, **few
        )
    return _with_zeros(factor, values[first:])


def _with_zeros(factor, values):
    return np.concatenate([np.zeros(factor.rigid.shape[1]), np.abs(values)])


def singular_vectors(factor, count=None):
    """Lowest ``count`` of the singular values ``(m,)`` in rad/s, and vectors ``(H,
    m)``, orthonormal M^(1/2) x.
    """
    zeros = factor.rigid.shape[1]
    path = factor.path()
    wanted = len(factor.heavy) if count is None else min(count, len(factor.heavy))
    moving = len(factor.heavy) - zeros
    if path is None and 0 < wanted - zeros < moving // FEW and moving > DENSE:
        values, vectors = _lowest(factor, wanted - zeros)
    elif path is None or wanted <= zeros:
        values, vectors = (
            _dense(factor)
            if wanted > zeros
            else (np.zeros(0), np.zeros((len(factor.heavy), 0)))
        )
    else:
        off, disks = _golub_kahan(factor, path)
        first = len(off) + 1 - len(factor.stiffness)
        few = {
            "select": "i",
            "select_range": (first, first + wanted - zeros - 1),
            "tol": EVERY_DIGIT,
        }
        values, both = eigh_tridiagonal(
            np.zeros(len(off) + 1), off, lapack_driver="stebz", **few
        )
        vectors = np.zeros((len(factor.heavy), len(values)))
        # A unit eigenvector holds a right vector, at even places, and a left one, each
        # of length 1 / sqrt 2.
        vectors[disks] = np.sqrt(2) * both[::2]
    return (
        _with_zeros(factor, values)[:wanted],
        np.concatenate([factor.rigid, vectors], axis=1)[:, :wanted],
    )


def _golub_kahan(factor, path):
    """Off-diagonal of the tridiagonal with zero diagonal that a chain makes of [[0,
    E^T], [E, 0]], and its disks.
    """
    rows, disks = path
    entries = factor.entries()[rows]
    turned = factor.ends[rows, 0] != disks[:-1]
    # Row after row, each with the end first that comes first on the way.
    off = np.where(turned[:, None], entries[:, ::-1], entries).ravel()
    # A chain that ends in the ground has no last disk.
    return (off[:-1], disks[:-1]) if disks[-1] == len(factor.mass) else (off, disks)


def _dense(factor, vectors=True):
    """Singular values that are not zero, rising, and right vectors, by Jacobi's method,
    which keeps small ones.
    """
    moving = len(factor.heavy) - factor.rigid.shape[1]
    if not moving:
        return np.zeros(0), np.zeros((len(factor.heavy), 0))
    E = factor.dense()
    wide = E.shape[0] < E.shape[1]
    # dgejsv wants at least as many rows as columns.
    tall = np.asfortranarray(E.T if wide else E)
    kept = 0 if vectors else 3
    values, left, right, scale, _, failed = lapack.dgejsv(
        tall, joba=2, jobu=kept, jobv=kept
    )
    if failed:
        left, values, right = np.linalg.svd(tall, full_matrices=False)
        scale = np.ones(2)
        right = right.T
    rising = np.s_[moving - 1 :: -1]
    # dgejsv returns scaled values where they would overflow or underflow.
    return (scale[0] / scale[1] * values)[rising], (
        (left if wide else right)[:, rising] if vectors else None
    )


def _lowest(factor, count):
    """The ``count`` lowest singular values that are not zero, rising, and right
    vectors, of a large train of any shape by Lanczos steps on the inverse of E^T E, a
    little shifted where rigid motions have zeros.
    """
    from scipy import sparse
    from scipy.sparse.linalg import eigsh

    disks = len(factor.mass)
    rigid = factor.rigid.shape[1]
    rows = np.repeat(np.arange(len(factor.stiffness)), 2)
    entries = factor.entries().ravel(), (rows, factor.ends.ravel())
    E = sparse.csr_array(entries, shape=(len(factor.stiffness), disks + 1))[:, :disks]
    square = (E.T @ E).tocsc()
    shift = -SHIFT * square.diagonal().max()
    start = np.cos(np.arange(disks))  # the same at every call
    squares, vectors = eigsh(square, k=count + rigid, sigma=shift, v0=start)
    order = np.argsort(squares)[rigid:]
    return np.sqrt(squares[order]), vectors[:, order]


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
    names : tuple of str, the S disks; link_names : tuple of str, the L links
    frequencies_hz : ``(m,)`` Hz, rising; a free train begins with 0
    shapes : ``(m, S)`` angles of the disks, largest absolute value 1
    mesh_energy_share : ``(m,)`` share of the strain energy that lies in tooth meshes
    generalised_mass : ``(m,)`` kg m2, sum of J phi^2 over the disks
    node_count : ``(m,)`` int, links whose ends move against each other, where ordinates
    exceed 1e-10 of the largest;
        on a chain the number of the mode, unless the mode is confined to a few disks
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
        """Mode ``number`` as a dictionary disk -> angle."""
        return dict(zip(self.names, self.shapes[number].tolist(), strict=True))

    @property
    def generalised_stiffness(self) -> Array:
        """``(m,)`` N m/rad: omega^2 times the generalised mass, twice the strain energy
        of the shape.
        """
        return (2 * np.pi * self.frequencies_hz) ** 2 * self.generalised_mass


def natural_frequencies(train: DriveTrain, *, count: int | None = None) -> Modes:
    """Natural frequencies in Hz with mode shapes, undamped, meshes in contact.

    Solves ``K v = omega^2 M v`` (Lashko, (3.4)) through the singular values of
    ``C^{1/2} D M^{-1/2}``, which keeps the digits of soft modes beside stiff links and
    gives exact zeros to rigid motions, one for each part of the train that no spring
    holds. Disks without inertia are condensed statically; a purely viscous link does
    not count.

    Of a concrete train, all modes or the lowest ``count``: a train of more than 500
    disks should ask for few, as n modes of S disks take n S numbers.

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
    found = shares(system, omega, displacement)
    links = len(system.stiffness)
    return Modes(
        names=train.topology.disk_names,
        frequencies_hz=omega / (2 * np.pi),
        mesh_energy_share=found.strain_share[
            :, links - len(train.topology.mesh_names) :
        ].sum(1),
        link_names=train.topology.link_names,
        node_count=_sign_changes(system.tree, found.shapes),
        **found._asdict(),
    )


def shares(system, omega, displacement) -> ModeShares:
    """The :class:`ModeShares` of modes of angular frequencies ``(m,)`` and
    displacements ``(S, m)``, may be traced.
    """
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
    """Natural frequencies ``(m,)`` in Hz alone, rising, one for each disk with inertia;
    of a concrete train.

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


def _sign_changes(tree, shapes):
    """``(m,)`` links over which the sign changes; a disk at rest goes with a neighbour:
    a node counts once.
    """
    sign = np.where(np.abs(shapes) > AT_REST, np.sign(shapes), 0.0).T
    way = list(
        zip(tree.node[:-1].tolist(), tree.node[tree.parent[:-1]].tolist(), strict=True)
    )
    for disk, above in way:
        sign[above] = np.where(sign[above] == 0, sign[disk], sign[above])
    for disk, above in reversed(way):
        sign[disk] = np.where(sign[disk] == 0, sign[above], sign[disk])
    return (sign[tree.end_a] != sign[tree.end_b]).sum(0)

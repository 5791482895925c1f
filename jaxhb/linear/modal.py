"""Natural frequencies and mode shapes of the undamped train, backlash meshes taken in contact.

With the weighted incidence factor E = C^(1/2) D M^(-1/2) of the train, E^T E = M^(-1/2) K M^(-1/2): natural frequencies
are singular values of E (docs/theory B). A row has two entries that differ in sign, which no sum has rounded: stiff and
soft links keep their own digits. How many frequencies are zero is counted on the graph, never judged by size. Disks
without inertia are eliminated first, from a star of links to its mesh, by sums of positive numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh_tridiagonal, eigvalsh_tridiagonal, lapack

from jaxhb._jax import Array, namespace, on_host
from jaxhb._shown import brief
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain

DENSE = 500
"""Disks above which a dense factor takes longer than a few seconds."""
SMALL = 1e-3
"""Singular value over the largest up to which the fast method, exact to rounding of the largest, loses digits."""
EVERY_DIGIT = 2 * np.finfo(float).tiny
"""Absolute tolerance that makes LAPACK's bisection (dstebz) stop by its relative one."""


@dataclass(frozen=True)
class Factor:
    """Rows of E: elastic links between disks with inertia, grounds among them.

    stiffness ``(n,)`` N/m; end_a, end_b ``(n,)`` disks, end_b = -1 for the ground; arm_a, arm_b ``(n,)``;
    mass ``(S,)`` kg; heavy : disks with inertia; pieces : tuple of int arrays, heavy disks that hang together and that
    nothing holds; rigid : ``(S,)`` displacements of each piece when no link deflects; eliminated : tuple of (disk,
    neighbours, weights), displacements of disks without inertia from those eliminated later.
    """

    stiffness: np.ndarray
    end_a: np.ndarray
    end_b: np.ndarray
    arm_a: np.ndarray
    arm_b: np.ndarray
    mass: np.ndarray
    heavy: np.ndarray
    pieces: tuple
    rigid: np.ndarray
    eliminated: tuple

    def dense(self):
        """E ``(n, H)`` in rad/s, columns in the order of ``heavy``."""
        column = np.full(len(self.mass) + 1, -1)
        column[self.heavy] = np.arange(len(self.heavy))
        rows, root = np.arange(len(self.stiffness)), np.sqrt(self.stiffness)
        E = np.zeros((len(rows), len(self.heavy)))
        E[rows, column[self.end_a]] = root * self.arm_a / np.sqrt(self.mass[self.end_a])
        held = self.end_b >= 0
        b = self.end_b[held]
        E[rows[held], column[b]] = -(root * self.arm_b)[held] / np.sqrt(self.mass[b])
        return E

    def displacements(self, heavy):
        """``(S, m)`` of all disks from those with inertia ``(H, m)``, the others where they store least energy."""
        found = np.zeros((len(self.mass), heavy.shape[1]))
        found[self.heavy] = heavy
        for disk, neighbours, weights in reversed(self.eliminated):
            found[disk] = weights @ found[neighbours]
        return found

    def rigid_shapes(self):
        """``(H, pieces)`` unit columns of M^(1/2) x, one for each piece that nothing holds."""
        shapes = np.zeros((len(self.mass), len(self.pieces)))
        for column, disks in enumerate(self.pieces):
            moved = np.sqrt(self.mass[disks]) * self.rigid[disks]
            shapes[disks, column] = moved / np.linalg.norm(moved)
        return shapes[self.heavy]

    def path(self):
        """Rows of E from one free end of a chain to the other with the disk behind each, or None for other trains."""
        if not len(self.stiffness) or len(self.stiffness) > len(self.heavy):
            return None
        at = [[] for _ in range(len(self.mass) + 1)]
        for row, pair in enumerate(zip(self.end_a.tolist(), self.end_b.tolist(), strict=True)):
            for disk in pair:
                at[disk].append(row)
        # The last entry is the ground: a chain has it at one end at most.
        if max(map(len, at)) > 2 or len(at[-1]) > 1:
            return None
        starts = [disk for disk in self.heavy if len(at[disk]) == 1]
        if not starts:
            return None
        disk, rows, disks = int(starts[0]), [], [int(starts[0])]
        while disk >= 0 and (onward := [row for row in at[disk] if row not in rows[-1:]]):
            rows.append(onward[0])
            disk = int(self.end_a[onward[0]] + self.end_b[onward[0]] - disk)
            disks.append(disk)
        return (rows, disks) if len(rows) == len(self.stiffness) else None


def factor(system):
    """The :class:`Factor` of a :class:`~jaxhb.train.chain.System`, meshes in contact; links without stiffness drop.

    Parameters
    ----------
    system : System, concrete

    Returns
    -------
    Factor
    """
    elastic, held = np.flatnonzero(system.stiffness), np.flatnonzero(system.ground)
    ends = zip(system.tree.end_a[elastic].tolist(), system.tree.end_b[elastic].tolist(), strict=True)
    numbers = (system.stiffness[elastic], system.arm_a[elastic], system.arm_b[elastic])
    links = [(*pair, *row) for pair, row in zip(ends, zip(*(a.tolist() for a in numbers), strict=True), strict=True)]
    links += [(int(disk), -1, float(system.ground[disk]), 1.0, 1.0) for disk in held]
    rigid, pieces = _loose(links, len(system.mass))
    heavy = np.flatnonzero(system.mass)
    pieces = [disks[system.mass[disks] > 0] for disks in pieces]
    links, eliminated = _without_light_disks(links, np.flatnonzero(system.mass == 0).tolist())
    end_a, end_b, stiffness, arm_a, arm_b = (
        (np.array(column) for column in zip(*links, strict=True))
        if links
        else (
            *np.zeros((2, 0), int),
            *np.zeros((3, 0)),
        )
    )
    # Heaviest first: the rotation of the train comes before that of loose rings.
    pieces = tuple(sorted((disks for disks in pieces if len(disks)), key=lambda disks: -system.mass[disks].sum()))
    return Factor(stiffness, end_a, end_b, arm_a, arm_b, system.mass, heavy, pieces, rigid, tuple(eliminated))


def _loose(links, disks):
    """Displacements in which no link deflects, and the pieces that no ground holds."""
    at = [[] for _ in range(disks)]
    for a, b, _, arm_a, arm_b in links:
        at[a].append((b, arm_a / arm_b))
        if b >= 0:
            at[b].append((a, arm_b / arm_a))
    shape, seen, pieces = np.ones(disks), np.zeros(disks, bool), []
    for start in range(disks):
        if seen[start]:
            continue
        seen[start], piece, loose = True, [start], True
        for disk in piece:
            for other, ratio in at[disk]:
                loose &= other >= 0
                if other >= 0 and not seen[other]:
                    seen[other], shape[other] = True, shape[disk] * ratio
                    piece.append(other)
        if loose:
            pieces.append(np.array(piece))
    return shape, pieces


def _without_light_disks(links, light):
    """Links after elimination of the disks ``light``, and how these follow their neighbours.

    At the least energy of links k_i with deflections s_i x - o_i y_i, x = sum k_i s_i o_i y_i / sum k_i s_i^2, and what
    is left are links k_i k_j / sum k s^2 with deflections s_j o_i y_i - s_i o_j y_j between all pairs of neighbours.
    """
    links, eliminated = dict(enumerate(links)), []
    at = {}
    for name, (a, b, *_) in links.items():
        for disk in (a, b):
            at.setdefault(disk, set()).add(name)
    count = len(links)
    for disk in light:
        star = []
        for name in sorted(at.get(disk, ())):
            a, b, k, arm_a, arm_b = links.pop(name)
            at[a].discard(name), at[b].discard(name)
            star.append((b, k, arm_a, arm_b) if a == disk else (a, k, arm_b, arm_a))
        total = sum(k * own**2 for _, k, own, _ in star)
        moving = [(other, k * own * far / total) for other, k, own, far in star if other >= 0]
        neighbours = np.array([other for other, _ in moving], dtype=int)
        eliminated.append((disk, neighbours, np.array([weight for _, weight in moving])))
        for i, (p, k_p, own_p, far_p) in enumerate(star):
            for q, k_q, own_q, far_q in star[i + 1 :]:
                if p == q:
                    continue  # parallel links to one neighbour do not bend: their ratios agree
                pair = (p, q, k_p * (k_q / total), own_q * far_p, own_p * far_q)
                a, b = (p, q) if p >= 0 else (q, p)
                links[count] = pair if p >= 0 else (q, p, pair[2], pair[4], pair[3])
                at.setdefault(a, set()).add(count), at.setdefault(b, set()).add(count)
                count += 1
    return list(links.values()), eliminated


def singular_values(factor):
    """All ``(H,)`` rising, rad/s; zeros are exact. Chains of any size by the Golub-Kahan tridiagonal."""
    zeros = len(factor.pieces)
    path = factor.path() if len(factor.heavy) > DENSE else None
    if path is None:
        return np.concatenate([np.zeros(zeros), _dense(factor, vectors=False)[0]])
    off, _ = _golub_kahan(factor, path)
    values = eigvalsh_tridiagonal(np.zeros(len(off) + 1), off)
    # Eigenvalues are the singular values with both signs, and zeros: the positive ones come last.
    first = len(values) - len(factor.stiffness)
    small = int(np.searchsorted(values[first:], SMALL * values[-1]))
    if small:  # bisection: entries of a tridiagonal with zero diagonal fix each eigenvalue to its own last digits
        few = {"select": "i", "select_range": (first, first + small - 1), "tol": EVERY_DIGIT}
        values[first : first + small] = eigvalsh_tridiagonal(np.zeros(len(off) + 1), off, **few)
    return np.concatenate([np.zeros(zeros), np.abs(values[first:])])


def singular_vectors(factor, count=None):
    """Lowest ``count`` of the singular values with vectors.

    Returns
    -------
    values ``(m,)`` rad/s, rising; vectors ``(H, m)``, orthonormal columns M^(1/2) x
    """
    zeros = len(factor.pieces)
    wanted = len(factor.heavy) if count is None else min(count, len(factor.heavy))
    path = factor.path() if len(factor.heavy) > DENSE else None
    if path is None or wanted <= zeros:
        values, vectors = _dense(factor) if wanted > zeros else (np.zeros(0), np.zeros((len(factor.heavy), 0)))
    else:
        off, disks = _golub_kahan(factor, path)
        first = len(off) + 1 - len(factor.stiffness)
        chosen = (first, first + wanted - zeros - 1)
        values, both = eigh_tridiagonal(
            np.zeros(len(off) + 1), off, select="i", select_range=chosen, lapack_driver="stebz", tol=EVERY_DIGIT
        )
        place = np.full(len(factor.mass), -1)
        place[factor.heavy] = np.arange(len(factor.heavy))
        vectors = np.zeros((len(factor.heavy), len(values)))
        # A unit eigenvector holds a right vector, at even places, and a left one, each of length 1 / sqrt 2.
        vectors[place[disks]] = np.sqrt(2) * both[::2]
    values = np.concatenate([np.zeros(zeros), np.abs(values)])[:wanted]
    return values, np.concatenate([factor.rigid_shapes(), vectors], axis=1)[:, :wanted]


def _golub_kahan(factor, path):
    """Off-diagonal of the tridiagonal with zero diagonal that a chain makes of [[0, E^T], [E, 0]], and its disks."""
    rows, disks = path
    near = np.where(factor.end_a[rows] == disks[:-1], 1.0, -1.0)  # which end comes first on the way
    k, heavy = np.sqrt(factor.stiffness[rows]), np.array(disks)
    arm = np.where(near > 0, [factor.arm_a[rows], -factor.arm_b[rows]], [-factor.arm_b[rows], factor.arm_a[rows]])
    held = heavy[-1] < 0  # a chain that ends in the ground has no last disk
    # The ground is a disk of infinite mass: its entry is 0, and cut off.
    mass = np.where(heavy < 0, np.inf, factor.mass[heavy])
    off = np.empty(2 * len(rows))
    off[0::2], off[1::2] = k * arm[0] / np.sqrt(mass[:-1]), k * arm[1] / np.sqrt(mass[1:])
    return (off[:-1], heavy[:-1]) if held else (off, heavy)


def _dense(factor, vectors=True):
    """Singular values that are not zero, rising, and right vectors, by Jacobi's method, which keeps small ones."""
    moving = len(factor.heavy) - len(factor.pieces)
    if not moving:
        return np.zeros(0), np.zeros((len(factor.heavy), 0))
    E = factor.dense()
    wide = E.shape[0] < E.shape[1]
    # dgejsv wants at least as many rows as columns.
    tall = np.asfortranarray(E.T if wide else E)
    kept = 0 if vectors else 3
    values, left, right, scale, _, failed = lapack.dgejsv(tall, joba=2, jobu=kept, jobv=kept)
    if failed:
        left, values, right = np.linalg.svd(tall, full_matrices=False)
        scale, right = np.ones(2), right.T
    rising = np.s_[moving - 1 :: -1]
    # dgejsv returns scaled values where they would overflow or underflow.
    return (scale[0] / scale[1] * values)[rising], (left if wide else right)[:, rising] if vectors else None


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

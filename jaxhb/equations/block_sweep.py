"""Elimination of a tree of links from its leaves to its root, in dynamic-stiffness
form, under ``lax.scan``.

Node s hangs on its parent p by one link with deflection ``l = alpha x_s - beta x_p``
and force ``f = C l``. With ``P`` the dynamic stiffness and ``psi`` the load collected
at the node, elimination of the node delivers to the parent

    f = pi - Y x_p,    Y = beta C (P + alpha^2 C)^{-1} P,
    pi = alpha C (P + alpha^2 C)^{-1} psi.

Unlike the textbook recursion, ``Y`` is exactly zero for a part that nothing holds: a
soft ground costs no digits, and link forces are no differences of displacements. The
scalar sweep treats every harmonic at once; the matrix sweep dense blocks that couple
all harmonics (Newton's matrix along a chain, :func:`jaxhb.block_sweep`). Source:
Fridman 2009, (10)-(12), in the form of Moliboshko's equivalent transformation; forces
of all branches of a node add in ``P`` and ``psi``, which is what a fictitious node of
Fridman's numbering does.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array, Number, namespace


def quotient(numerator: Number, denominator: Array) -> Array:
    """Complex quotient, 0 where the denominator is 0 (a ring behind a purely viscous
    link at the mean).
    """
    # Written out: the library's division is safe from overflow beyond 1e154 and costs
    # as much as the rest of a sweep. There it is nan, so that nothing that has lost a
    # link counts as an answer.
    xp = namespace(numerator, denominator)
    square = denominator.real**2 + denominator.imag**2
    inverse = xp.where(square < np.inf, 1 / xp.where(square == 0, 1.0, square), np.nan)
    return numerator * xp.conj(denominator) * xp.where(square == 0, 0.0, inverse)


# Pivot whose square does not overflow
LARGEST = 1e150
# Stands for a last pivot of exactly zero: far below what rounding leaves of any other
UNHELD = 1e-30


def last_pivot(pivot: Array) -> Array:
    """Replace a last pivot, that of the whole train, where it vanishes: the motion is
    then huge, and not infinite on one version of jax and nan on another.
    """
    return namespace(pivot).where(pivot == 0, UNHELD, pivot)


def nonzero_pivot(pivot: Array, link: Array) -> Array:
    """Move a pivot that vanishes exactly (an undamped part at resonance with its upper
    node held) by rounding: the whole train need not be singular there. A pivot that
    vanishes together with its link stays zero.
    """
    xp = namespace(pivot, link)
    size = xp.abs(link.real) + xp.abs(link.imag)
    return xp.where(pivot == 0, np.finfo(float).eps * size, pivot)


Carry = TypeVar("Carry")


class Slots(NamedTuple):
    """Rows in which a sweep collects what the nodes under elimination have received:
    ``(S,)`` the row of each node and of its parent (of the root: its own), and all rows
    ``(D,)``, few, used again and again.
    """

    row: np.ndarray
    parent_row: np.ndarray
    rows: np.ndarray


def slots(parent: Sequence[int] | np.ndarray) -> Slots:
    """The :class:`Slots` of a tree, host: a node takes a row when its first branch
    arrives and frees it when done; ``parent`` int ``(S,)``, position of the parent,
    larger than that of the node; S for the root (last).

    >>> slots([1, 4, 3, 4, 5, 6]).row.tolist()
    [0, 0, 1, 1, 0, 0]
    """
    row = np.full(len(parent), -1, np.int32)
    free = list(range(len(parent)))
    for node, up in enumerate(parent):
        if row[node] < 0:
            row[node] = heapq.heappop(free)
        heapq.heappush(free, row[node])
        if up < len(parent) and row[up] < 0:
            row[up] = heapq.heappop(free)
    parent_row = np.array([row[min(up, len(parent) - 1)] for up in parent], np.int32)
    return Slots(row, parent_row, np.arange(row.max() + 1, dtype=np.int32))


def scalar_sweep(
    places: Slots,
    near: Array,
    far: Array,
    link: Array,
    node: Array,
    load: Array,
    forces: int | None = None,
) -> tuple[Array, Array]:
    """Displacements ``(S, R, H)`` of a tree of scalar links, and the forces ``(S,
    forces, H)`` of the links to the parents, positive for ``alpha x_s > beta x_p``,
    zero at the root.

    places : Slots; near, far : ``(S,)`` arms alpha and beta; link : complex ``(S, H)``,
    C of the link to the parent (these of no meaning for the root); node : complex ``(S,
    H)``, ground included; load : complex ``(S, R, H)``; forces : of how many loads, the
    first ones, default all.
    """
    xp = namespace(near, far, link, node, load)
    rows: type[_HostRows] | type[_TracedRows]
    rows = _HostRows if xp is np else _TracedRows
    with_forces = slice(load.shape[1] if forces is None else forces)

    def eliminate(
        collected: tuple[Array, Array], branch: Sequence[Array]
    ) -> tuple[tuple[Array, Array], tuple[Array, ...]]:
        row, parent_row, alpha, beta, C, P, psi = branch
        stiffness, moment = collected
        P = P + stiffness[row]
        psi = psi + moment[row]
        inverse, unheld = rows.inverse(P, alpha**2 * C)
        hand = C * inverse
        passed = beta * hand * P
        pushed = alpha * hand * psi
        stiffness = rows.moved(stiffness, row, parent_row, beta * passed)
        moment = rows.moved(moment, row, parent_row, beta * pushed)
        # A part that nothing holds (a ring without spring, at the mean) has no
        # stiffness and no pivot: it goes with its parent.
        follow = xp.where(unheld, beta / alpha, alpha * beta * hand)
        return (stiffness, moment), (follow, passed, inverse * psi, pushed[with_forces])

    zeros = [
        xp.zeros((len(places.rows), *array.shape[1:]), array.dtype)
        for array in (node, load)
    ]
    arrays = (places.row, places.parent_row, near, far, link, node, load)
    below_root = [array[:-1] for array in arrays]
    (stiffness, moment), eliminated = rows.scan(
        eliminate, (zeros[0], zeros[1]), below_root
    )
    # All that hangs on the root has arrived: its displacement is known, and with it,
    # parent by parent, all others.
    root_row = places.row[-1]
    root_pivot = last_pivot(node[-1] + stiffness[root_row])
    root = (load[-1] + moment[root_row]) / root_pivot

    def substitute(
        motion: Array, branch: Sequence[Array]
    ) -> tuple[Array, tuple[Array, Array]]:
        row, parent_row, follow, transfer, free, push = branch
        up = motion[parent_row]
        below = free + follow * up
        force = push - transfer * up[with_forces]
        # Of the host in place: ``up`` is gone then
        return rows.replaced(motion, row, below), (below, force)

    motion = rows.replaced(xp.zeros_like(zeros[1]), root_row, root)
    branches = (places.row[:-1], places.parent_row[:-1], *eliminated)
    _, (below, force) = rows.scan(substitute, motion, branches, reverse=True)
    displacement = xp.concatenate([below, root[None]])
    at_root = xp.zeros_like(root)[None, with_forces]
    return displacement, xp.concatenate([force, at_root])


class _TracedRows:
    """Steps of a sweep from node to node in jax, and writes to the rows of what nodes
    have collected.
    """

    scan = staticmethod(lax.scan)

    @staticmethod
    def inverse(node: Array, link: Array) -> tuple[Array, Array]:
        """Inverse of the pivot ``node + link``, and whether there is none."""
        pivot = nonzero_pivot(node + link, link)
        return quotient(1.0, pivot), pivot == 0

    @staticmethod
    def moved(array: Array, row: Array, parent_row: Array, values: Array) -> jax.Array:
        """Clear ``row``, and add ``values`` to ``parent_row``."""
        cleared = cast(jax.Array, array).at[row].set(0.0, unique_indices=True)
        return cleared.at[parent_row].add(values)

    @staticmethod
    def replaced(array: Array, row: Array, values: Array) -> jax.Array:
        """Put ``values`` into ``row``."""
        return cast(jax.Array, array).at[row].set(values, unique_indices=True)


class _HostRows:
    """The same steps and writes in numpy, in place."""

    @staticmethod
    def inverse(node: Array, link: Array) -> tuple[Array, Array | bool]:
        """Inverse of the pivot, and whether there is none."""
        pivot = node + link
        if pivot.all() and np.abs(pivot).max() < LARGEST:
            return 1 / pivot, False
        return _TracedRows.inverse(node, link)

    @staticmethod
    def scan(
        step: Callable[[Carry, Sequence[Array]], tuple[Carry, Sequence[Array]]],
        carry: Carry,
        arrays: Sequence[Array],
        reverse: bool = False,
    ) -> tuple[Carry, Sequence[Array]]:
        """Scan as ``lax.scan`` does, over the rows of some arrays."""
        outputs = []
        rows = list(zip(*arrays, strict=True))
        for row in reversed(rows) if reverse else rows:
            carry, output = step(carry, row)
            outputs.append(output)
        if reverse:
            outputs.reverse()
        return carry, [np.stack(values) for values in zip(*outputs, strict=True)]

    @staticmethod
    def moved(array: Array, row: Array, parent_row: Array, values: Array) -> np.ndarray:
        """Clear ``row``, and add ``values`` to ``parent_row``."""
        rows = cast(np.ndarray, array)
        rows[row] = 0.0
        rows[parent_row] += values
        return rows

    @staticmethod
    def replaced(array: Array, row: Array, values: Array) -> np.ndarray:
        """Put ``values`` into ``row``."""
        rows = cast(np.ndarray, array)
        rows[row] = values
        return rows


class HeldNode(NamedTuple):
    """Motion of a node by that of its parent: with the parent held, and per its
    displacement; the deflection of the link between them in the same two parts.
    """

    free: jax.Array
    follow: jax.Array
    bent: jax.Array
    transfer: jax.Array


def matrix_sweep(
    parent: Array,
    near: Array,
    far: Array,
    link: jax.Array,
    node: jax.Array,
    load: jax.Array,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Eliminate a tree in the same way with matrices C and P: ``parent`` as of
    :func:`slots`, ``link`` and ``node`` ``(S, P, P)``.

    Gives displacements ``(S, P)`` under ``load`` ``(S, P)``, deflections ``(S, P)`` of
    the links to the parents, zero at the root, and the smallest ratio of the extreme
    diagonal entries of U over all pivots, a cheap sign of a breakdown: elimination
    without pivoting between blocks fails at a part that is singular with its upper node
    held.
    """
    width = node.shape[-1]

    def eliminate(
        carry: tuple[jax.Array, jax.Array], branch: tuple[Array, ...]
    ) -> tuple[tuple[jax.Array, jax.Array], tuple[HeldNode, jax.Array]]:
        stiffness, moment = carry
        position, up, alpha, beta, C = branch
        P = stiffness[position]
        psi = moment[position]
        factor = jax.scipy.linalg.lu_factor(P + alpha**2 * C)
        solved = jax.scipy.linalg.lu_solve(
            factor, jnp.concatenate([P, psi[:, None], C], axis=1)
        )
        passed = C @ solved[:, : width + 1]
        stiffness = stiffness.at[up].add(beta**2 * passed[:, :width])
        moment = moment.at[up].add(alpha * beta * passed[:, width])
        diagonal = jnp.abs(jnp.diagonal(factor[0]))
        quality = diagonal.min() / diagonal.max()
        free = solved[:, width]
        transfer = solved[:, :width]
        follow = solved[:, width + 1 :]
        # l = alpha x_s - beta x_p without a difference of displacements: what of x_p
        # the node does not follow is P's.
        held = HeldNode(free, alpha * beta * follow, alpha * free, beta * transfer)
        return (stiffness, moment), (held, quality)

    places = jnp.arange(node.shape[0] - 1), parent[:-1]
    branches = (*places, near[:-1], far[:-1], link[:-1])
    (stiffness, moment), (held, quality) = lax.scan(eliminate, (node, load), branches)
    root = jnp.linalg.solve(stiffness[-1], moment[-1])

    def substitute(
        displacement: jax.Array, branch: tuple[Array, Array, HeldNode]
    ) -> tuple[jax.Array, jax.Array]:
        position, up, (free, follow, bent, transfer) = branch
        above = displacement[up]
        return (
            displacement.at[position].set(free + follow @ above),
            bent - transfer @ above,
        )

    start = jnp.zeros_like(load).at[-1].set(root)
    displacement, deflection = lax.scan(
        substitute, start, (*places, held), reverse=True
    )
    return (
        displacement,
        jnp.concatenate([deflection, jnp.zeros_like(root)[None]]),
        quality.min(initial=1.0),
    )

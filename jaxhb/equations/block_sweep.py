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

import heapq
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import namespace


def quotient(numerator, denominator):
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


LARGEST = 1e150  # pivot whose square does not overflow
# Stands for a last pivot of exactly zero: far below what rounding leaves of any other
UNHELD = 1e-30


def last_pivot(pivot):
    """A last pivot, that of the whole train: where it vanishes the motion is huge, and
    not infinite on one version of jax and nan on another.
    """
    return namespace(pivot).where(pivot == 0, UNHELD, pivot)


def nonzero_pivot(pivot, link):
    """A pivot that vanishes exactly (an undamped part at resonance with its upper node
    held) moved by rounding: the whole train need not be singular there. One that
    vanishes together with its link stays zero.
    """
    xp = namespace(pivot, link)
    size = xp.abs(link.real) + xp.abs(link.imag)
    return xp.where(pivot == 0, np.finfo(float).eps * size, pivot)


class Slots(NamedTuple):
    """Where a sweep keeps what the nodes under elimination have collected: ``(S,)``
    place of each node and of its parent (of the root: its own); every place ``(D,)``,
    few, used again and again.
    """

    own: np.ndarray
    above: np.ndarray
    every: np.ndarray


def slots(parent):
    """The :class:`Slots` of a tree, host: a node takes one when its first branch
    arrives and frees it when done; ``parent`` int ``(S,)``, position of the parent,
    larger than the own position; S for the root (last).

    >>> slots([1, 4, 3, 4, 5, 6]).own.tolist()
    [0, 0, 1, 1, 0, 0]
    """
    own = np.full(len(parent), -1, np.int32)
    free = list(range(len(parent)))
    for node, up in enumerate(parent):
        if own[node] < 0:
            own[node] = heapq.heappop(free)
        heapq.heappush(free, own[node])
        if up < len(parent) and own[up] < 0:
            own[up] = heapq.heappop(free)
    above = [own[min(up, len(parent) - 1)] for up in parent]
    return Slots(
        own, np.array(above, np.int32), np.arange(own.max() + 1, dtype=np.int32)
    )


def scalar_sweep(at, near, far, link, node, load, forces=None):
    """Displacements ``(S, R, H)`` of a tree of scalar links, and the forces ``(S,
    forces, H)`` of the links to the parents, positive for ``alpha x_s > beta x_p``,
    zero at the root.

    at : Slots; near, far : ``(S,)`` arms alpha and beta; link : complex ``(S, H)``, C
    of the link to the parent (these of no meaning for the root); node : complex ``(S,
    H)``, ground included; load : complex ``(S, R, H)``; forces : of how many loads, the
    first ones, default all.
    """
    xp = namespace(near, far, link, node, load)
    rows = _HostRows if xp is np else _TracedRows
    kept = slice(load.shape[1] if forces is None else forces)

    def eliminate(collected, item):
        own, above, alpha, beta, C, P, psi = item
        stiffness, moment = collected
        P = P + stiffness[own]
        psi = psi + moment[own]
        inverse, unheld = rows.inverse(P, alpha**2 * C)
        hand = C * inverse
        passed = beta * hand * P
        pushed = alpha * hand * psi
        stiffness = rows.moved(stiffness, own, above, beta * passed)
        moment = rows.moved(moment, own, above, beta * pushed)
        # A part that nothing holds (a ring without spring, at the mean) has no
        # stiffness and no pivot: it goes with its parent.
        follow = xp.where(unheld, beta / alpha, alpha * beta * hand)
        return (stiffness, moment), (follow, passed, inverse * psi, pushed[kept])

    nothing = [xp.zeros((len(at.every), *a.shape[1:]), a.dtype) for a in (node, load)]
    below_root = [a[:-1] for a in (at.own, at.above, near, far, link, node, load)]
    (stiffness, moment), held = rows.scan(eliminate, tuple(nothing), below_root)
    # All that hangs on the root has arrived: its displacement is known, and with it,
    # parent by parent, all others.
    root = (load[-1] + moment[at.own[-1]]) / last_pivot(
        node[-1] + stiffness[at.own[-1]]
    )

    def substitute(motion, item):
        own, above, follow, transfer, free, push = item
        up = motion[above]
        below = free + follow * up
        force = push - transfer * up[kept]
        return rows.replaced(motion, own, below), (
            below,
            force,
        )  # of the host in place: ``up`` is gone then

    motion = rows.replaced(xp.zeros_like(nothing[1]), at.own[-1], root)
    _, (below, force) = rows.scan(
        substitute, motion, (at.own[:-1], at.above[:-1], *held), reverse=True
    )
    return xp.concatenate([below, root[None]]), xp.concatenate(
        [force, xp.zeros_like(root)[None, kept]]
    )


class _TracedRows:
    """How a sweep of jax goes from node to node, and writes to rows of what nodes have
    collected.
    """

    scan = staticmethod(lax.scan)

    @staticmethod
    def inverse(node, link):
        """1 over the pivot ``node + link``, and where there is none."""
        pivot = nonzero_pivot(node + link, link)
        return quotient(1.0, pivot), pivot == 0

    @staticmethod
    def moved(array, own, above, values):
        """Row ``own`` zero, and ``values`` added to row ``above``."""
        return array.at[own].set(0.0, unique_indices=True).at[above].add(values)

    @staticmethod
    def replaced(array, own, values):
        """``values`` in row ``own``."""
        return array.at[own].set(values, unique_indices=True)


class _HostRows:
    """The same of numpy, in place."""

    @staticmethod
    def inverse(node, link):
        pivot = node + link
        if pivot.all() and np.abs(pivot).max() < LARGEST:
            return 1 / pivot, False
        return _TracedRows.inverse(node, link)

    @staticmethod
    def scan(step, carry, items, reverse=False):
        """As ``lax.scan``, of items in a tuple."""
        made = []
        each = zip(*items, strict=True)
        for item in reversed(list(each)) if reverse else each:
            carry, row = step(carry, item)
            made.append(row)
        return carry, [
            np.stack(values)
            for values in zip(*(made[::-1] if reverse else made), strict=True)
        ]

    @staticmethod
    def moved(array, own, above, values):
        array[own] = 0.0
        array[above] += values
        return array

    @staticmethod
    def replaced(array, own, values):
        array[own] = values
        return array


def matrix_sweep(parent, near, far, link, node, load):
    """The same elimination with matrices C and P: ``parent`` as of :func:`slots`,
    ``link`` and ``node`` ``(S, P, P)``.

    Gives displacements ``(S, P)`` under ``load`` ``(S, P)``, deflections ``(S, P)`` of
    the links to the parents, zero at the root, and the smallest ratio of the extreme
    diagonal entries of U over all pivots, a cheap sign of a breakdown: elimination
    without pivoting between blocks fails at a part that is singular with its upper node
    held.
    """
    width = node.shape[-1]

    def eliminate(carry, item):
        stiffness, moment = carry
        position, up, alpha, beta, C = item
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
        held = free, alpha * beta * follow, alpha * free, beta * transfer
        return (stiffness, moment), (held, quality)

    places = jnp.arange(node.shape[0] - 1), parent[:-1]
    items = (*places, near[:-1], far[:-1], link[:-1])
    (stiffness, moment), (held, quality) = lax.scan(eliminate, (node, load), items)
    root = jnp.linalg.solve(stiffness[-1], moment[-1])

    def substitute(displacement, item):
        position, up, (free, follow, bent, transfer) = item
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

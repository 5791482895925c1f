"""Arrays of the linear train, as the equations take them: the elimination tree of its
links, and their coefficients in circumferential displacements
(:mod:`jaxhb.train.chain` makes them).
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import numpy as np

from jaxhb._jax import Array, added, namespace
from jaxhb.equations.block_sweep import Slots

ALL = slice(None)  # every link


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Condensation:
    """Chains of disks without teeth and without branches, condensed to one link each;
    integer arrays, no names.

    Of the n disks condensed, chain after chain: disk, chain, after (the link onwards)
    and before (the link by which the chain begins, if it lies between two disks). Of
    the c chains: begin and end, the disks that they lie between, first the t that do,
    and end of those with one free end: ``(t,)`` and ``(c,)``. remaining ``(K,)``: the
    other disks; begin, end and ``tree`` count these. The links of ``tree`` are the t
    chains and after them ``plain``, links between disks that remain.
    """

    disk: np.ndarray
    chain: np.ndarray
    before: np.ndarray
    after: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    remaining: np.ndarray
    plain: np.ndarray
    tree: Tree


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Tree:
    """Elimination order of S nodes joined by tree links, leaves first, root last;
    integer arrays, no names.

    node : ``(S,)`` disk of each position; parent : ``(S,)`` position of the parent, S
    at the root; slots : of the sweep; link : ``(S,)`` link to the parent, 0 at the
    root; from_a : ``(S,)`` whether the node is the link's first end; loops : ``(n,)``
    links outside the tree; end_a, end_b : ``(L,)`` disks that each link joins;
    condensation : the chains between the teeth, if they are known; pinned : bool
    ``(L,)``, the links that hold the mean of the part that hangs on them where they
    have no stiffness, if that is known.
    """

    node: np.ndarray
    parent: np.ndarray
    slots: Slots
    link: np.ndarray
    from_a: np.ndarray
    loops: np.ndarray
    end_a: np.ndarray
    end_b: np.ndarray
    condensation: Condensation | None = None
    pinned: np.ndarray | None = None


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class System:
    """Arrays of the linear train in circumferential displacements (meshes taken in
    contact).

    radius : ``(S,)`` m, displacement / angle; mass kg, damping N s/m of disks to
    ground, ground N/m : ``(S,)``; stiffness N/m, viscous N s/m, loss, arm_a, arm_b :
    ``(L,)``, the first three ``(L, H)`` where links have their own numbers at each of H
    frequencies, viscous the ``damping`` of shafts, dampers and meshes; floating : True
    where nothing holds the mean angle.

    The incidence of links is here alone: methods take the ``links`` that are meant, by
    default all L.
    """

    tree: Tree
    radius: Array
    mass: Array
    damping: Array
    ground: Array
    stiffness: Array
    viscous: Array
    loss: Array
    arm_a: Array
    arm_b: Array
    floating: np.ndarray

    def _arms(self, links: slice | Array, ndim: int) -> tuple[Array, Array]:
        """Arms a and b of links, shaped to multiply arrays of ``ndim`` dimensions."""
        shape = (-1,) + (1,) * (ndim - 1)
        return self.arm_a[links].reshape(shape), self.arm_b[links].reshape(shape)

    def _at_ends(self, links: slice | Array, at_a: Array, at_b: Array) -> Array:
        """Sums ``(S, ...)`` on the disks of numbers ``(n, ...)`` at the two ends of
        links.
        """
        xp = namespace(self, at_a)
        sums = xp.zeros((len(self.mass), *at_a.shape[1:]), at_a.dtype)
        return added(
            added(sums, self.tree.end_a[links], at_a), self.tree.end_b[links], at_b
        )

    def deflections(self, displacement: Array, links: slice | Array = ALL) -> Array:
        """Deflections D x ``(n, ...)``, ``a x_a - b x_b`` of each link, from
        displacements ``(S, ...)``.
        """
        arm_a, arm_b = self._arms(links, displacement.ndim)
        return (
            arm_a * displacement[self.tree.end_a[links]]
            - arm_b * displacement[self.tree.end_b[links]]
        )

    def spread(self, force: Array, links: slice | Array = ALL) -> Array:
        """Forces D^T f ``(S, ...)`` on the disks, a f and -b f at the ends of each
        link, from forces ``(n, ...)``.
        """
        arm_a, arm_b = self._arms(links, force.ndim)
        return self._at_ends(links, arm_a * force, -arm_b * force)

    def incidence(self, links: slice | Array = ALL) -> Array:
        """Columns of D^T ``(S, n)``: a at the first end of each link and -b at the
        second.
        """
        return self.spread(np.eye(len(self.arm_a[links])), links)

    def springs(self) -> tuple[Array, Array]:
        """Links and grounds as rows ``(L + S, S)`` of the motion that each resists,
        with their stiffness ``(L + S,)`` in N/m.
        """
        xp = namespace(self)
        rows = xp.concatenate([xp.asarray(self.incidence()).T, xp.eye(len(self.mass))])
        stiffness = xp.concatenate(
            [xp.asarray(self.stiffness), xp.asarray(self.ground)]
        )
        return rows, stiffness

    def held_stiffness(self) -> Array:
        """``(S,)`` N/m of every disk with all other disks held: the diagonal of K."""
        return self.ground + self._at_ends(
            ALL, self.arm_a**2 * self.stiffness, self.arm_b**2 * self.stiffness
        )

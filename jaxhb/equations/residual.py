"""The residual A(x) of the whole train in the Fourier domain, and its tangent in packed
coordinates.

    A(x) = Z x + D^T f(D x, D x') - q,      Z = -n^2 Omega^2 M + i n Omega B + ground,

the Galerkin equations of Fridman 2009 (with the opposite sign), ``x`` the displacements
of all disks, real packed coordinates ``(S, P)``, P = 2N+1.
:class:`jaxhb.equations.condensation.CondensedEquation` is the same equation condensed
to the meshes.

Mean angles that no force decides are held by springs of the size of inertia forces,
which carry nothing in a motion that solves the balance: the rotation of a floating
train, weighted by inertia, at 0, and a ring behind a link without stiffness at its hub.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar, cast

import jax
import jax.numpy as jnp
from jax import lax

from jaxhb._jax import Array
from jaxhb.equations import backlash, fourier
from jaxhb.equations.backlash import MeshParameters
from jaxhb.equations.block_sweep import matrix_sweep
from jaxhb.equations.dynamic_stiffness import (
    disk_stiffness,
    frequencies,
    link_stiffness,
)
from jaxhb.equations.system import System

Evaluated = TypeVar("Evaluated")


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ForceBalance:
    """The balance of forces on all disks of a train at one speed: arrays, no names.

    system : System; meshes : MeshParameters, at least those that have a law; the others
    are linear links; frequency : Omega in rad/s; load : complex ``(S, N+1)`` N, without
    the load of transmission errors; rigid : ``(S,)`` m, displacements of the rigid
    rotation; samples : per cycle, at which the law is evaluated, more than 4 N.
    """

    system: System
    meshes: MeshParameters
    frequency: Array
    load: Array
    rigid: Array
    samples: int = field(metadata={"static": True})

    @property
    def harmonics(self) -> int:
        """Number N of harmonics."""
        return self.load.shape[-1] - 1

    def residual(self, packed: Array) -> jax.Array:
        """Residual A(x) ``(S, P)`` N at ``packed`` displacements ``(S, P)`` m."""
        return self.residual_at(packed, self.deflections(packed))

    def deflections(self, packed: Array) -> Array:
        """Packed deflections D x ``(L, P)`` m of all links, from displacements ``(S,
        P)`` m.
        """
        return fourier.pack(self.system.deflections(fourier.unpack(packed)))

    def residual_at(self, displacement: Array, deflection: Array) -> jax.Array:
        """Residual A(x) ``(S, P)`` N at packed displacements ``(S, P)`` m and the
        deflections ``(L, P)`` m of all links between them, which the differences of
        displacements lose where a train turns far as one.
        """
        mean = displacement[:, 0]
        x = fourier.unpack(displacement)
        deflection = fourier.unpack(deflection)
        meshes = self.meshes
        count = self._meshes_proper
        force = self._link_stiffness() * deflection
        of_law = fourier.analyze(
            self._at_samples(backlash.mesh_force, deflection), self.harmonics
        )
        force = force.at[meshes.link[:count]].set(of_law[:count])
        if meshes.springs:
            # A law beside a shaft adds to it, less the part that is in the linear link
            # already.
            link = meshes.link[count:]
            force = force.at[link].add(
                of_law[count:] - self._linear_beside() * deflection[link]
            )
        left = self._disks() * x - self.load + self.system.spread(force)
        return cast(jax.Array, fourier.pack(left)).at[:, 0].add(self._hold(mean))

    def link_blocks(self, packed: Array) -> jax.Array:
        """Tangent blocks ``(L, P, P)`` of all links at ``packed`` deflections ``(L,
        P)`` m: diagonal for linear links, for those with a law Toeplitz, ``T[df/dl] +
        T[df/dl'] d/dt``, with the slopes of the law written out by hand.
        """
        meshes = self.meshes
        count = self._meshes_proper
        deflection = fourier.unpack(packed)
        slope, rate_slope = self._at_samples(backlash.mesh_slopes, deflection)
        # A product with a slope couples harmonics n and m by its harmonic n - m: 2 N of
        # them are needed.
        stiffness = fourier.product_matrix(fourier.analyze(slope, 2 * self.harmonics))
        damping = fourier.product_matrix(
            fourier.analyze(rate_slope, 2 * self.harmonics)
        )
        of_law = stiffness + damping @ fourier.packed_diagonal(1j * self._omega())
        linear_blocks = fourier.packed_diagonal(self._link_stiffness())
        blocks = jnp.asarray(linear_blocks).at[meshes.link[:count]].set(of_law[:count])
        if not meshes.springs:
            return blocks
        linear = self._linear_beside()[:, :, None] * jnp.eye(packed.shape[-1])
        return blocks.at[meshes.link[count:]].add(of_law[count:] - linear)

    def node_blocks(self) -> jax.Array:
        """Diagonal blocks ``(S, P, P)`` of the disks: inertia, damping to ground and
        ground.
        """
        return cast(jax.Array, fourier.packed_diagonal(self._disks() + 0j))

    def jacobian(self, packed: Array) -> jax.Array:
        """The dense Jacobian ``(S, P, S, P)`` of the residual, assembled from the
        blocks of disks and links.
        """
        system = self.system
        blocks = self.link_blocks(self.deflections(packed))
        a = system.tree.end_a
        b = system.tree.end_b
        arm_a = system.arm_a[:, None, None]
        arm_b = system.arm_b[:, None, None]
        disks, width = packed.shape
        disk = jnp.arange(disks)
        matrix = (
            jnp.zeros((disks, disks, width, width))
            .at[disk, disk]
            .add(self.node_blocks())
        )
        matrix = matrix.at[a, a].add(arm_a**2 * blocks).at[b, b].add(arm_b**2 * blocks)
        matrix = (
            matrix.at[a, b]
            .add(-arm_a * arm_b * blocks)
            .at[b, a]
            .add(-arm_a * arm_b * blocks)
        )
        turned, inertia = self._turned()
        matrix = matrix.at[:, :, 0, 0].add(
            self._hold_per_drift() * jnp.outer(turned, turned) / inertia
        )
        return matrix.transpose(0, 2, 1, 3)

    def solve(self, packed: Array, right_side: jax.Array) -> jax.Array:
        """Solve J(x) y = ``right_side``, both ``(S, P)``, by :meth:`sweep`, with its
        derivative.
        """
        node = self.node_blocks()
        link = self.link_blocks(self.deflections(packed))

        def product(change: Array) -> Array:
            force = jnp.einsum("lij,lj->li", link, self.system.deflections(change))
            on_disks = jnp.einsum("sij,sj->si", node, change) + self.system.spread(
                force
            )
            return on_disks.at[:, 0].add(self._hold(change[:, 0]))

        def by(
            node: jax.Array, link: jax.Array
        ) -> Callable[[Callable[[Array], Array], jax.Array], jax.Array]:
            return lambda _, right_side: self._swept(node, link, right_side)[0]

        transposed = by(node.transpose(0, 2, 1), link.transpose(0, 2, 1))
        return lax.custom_linear_solve(product, right_side, by(node, link), transposed)

    def sweep(
        self, deflection: Array, right_side: Array
    ) -> tuple[jax.Array, jax.Array]:
        """Solve with the Jacobian at packed deflections ``(L, P)`` m for a
        ``right_side`` ``(S, P)`` by one block sweep over the tree: the solution, and
        the deflections ``(L, P)`` of its links; without links outside the tree.
        """
        node = jnp.asarray(self.node_blocks())
        return self._swept(node, self.link_blocks(deflection), right_side)

    def _swept(
        self, node: jax.Array, link: jax.Array, right_side: Array
    ) -> tuple[jax.Array, jax.Array]:
        """Solution and deflections by elimination with blocks of disks and links."""
        system = self.system
        tree = self.system.tree
        if not len(link):
            return (
                jnp.linalg.solve(node, right_side[:, :, None])[:, :, 0],
                cast(jax.Array, right_side[:0]),
            )
        # The sweep counts from the leaves: arms of the node and of its parent,
        # whichever end of the link they are at.
        near = jnp.where(tree.from_a, system.arm_a[tree.link], system.arm_b[tree.link])
        far = jnp.where(tree.from_a, system.arm_b[tree.link], system.arm_a[tree.link])
        # The hold of a floating train joins all disks, a tree does not. The balance of
        # its mean torques, what the hold takes, tells the rotation; what is left is
        # balanced, and the root may then be held by any spring.
        turned, inertia = self._turned()
        hold = self._hold_per_drift()
        floating = system.floating
        unbalanced = jnp.where(floating, self.rigid @ right_side[:, 0], 0.0)
        balanced = (
            cast(jax.Array, right_side).at[:, 0].add(-turned * unbalanced / inertia)
        )
        node = node.at[tree.node[-1], 0, 0].add(jnp.where(floating, 1.0, 0.0))
        swept, bent, _ = matrix_sweep(
            tree.parent,
            near,
            far,
            link[tree.link],
            node[tree.node],
            balanced[tree.node],
        )
        bent = jnp.where(tree.from_a, 1.0, -1.0)[:, None] * bent
        deflection = (
            jnp.zeros((len(link), swept.shape[-1])).at[tree.link[:-1]].set(bent[:-1])
        )
        change = jnp.zeros_like(swept).at[tree.node].set(swept)
        rotation = unbalanced / jnp.where(floating, hold, 1.0) - turned @ change[:, 0]
        turn = jnp.where(floating, self.rigid * rotation / inertia, 0.0)
        return change.at[:, 0].add(turn), deflection

    @property
    def _meshes_proper(self) -> int:
        """Number of laws that are those of meshes; the others act beside shafts."""
        return len(self.meshes.link) - self.meshes.springs

    def _omega(self) -> jax.Array:
        """Frequencies ``(N+1,)`` rad/s of the harmonics."""
        return jnp.asarray(frequencies(self.frequency, self.harmonics))

    def _link_stiffness(self) -> jax.Array:
        """Complex stiffness ``(L, N+1)`` N/m of the linear links, with the springs that
        hold rings at the mean.
        """
        system = self.system
        assert system.tree.pinned is not None  # of a whole train
        ring = self.frequency**2 * system.mass[system.tree.end_b]
        hold = jnp.where(system.tree.pinned & (system.stiffness == 0), ring, 0.0)
        stiffness = jnp.asarray(link_stiffness(system, self._omega()))
        return stiffness.at[:, 0].add(hold)

    def _linear_beside(self) -> Array:
        """Stiffness ``(n, 1)`` N/m of the laws beside shafts that the linear links
        contain.
        """
        return self.meshes.law.linear_stiffness[self._meshes_proper :, None]

    def _disks(self) -> Array:
        """Dynamic stiffness ``(S, N+1)`` N/m of the disks."""
        system = self.system
        mass, damping, ground = (
            jnp.asarray(field)[:, None]
            for field in (system.mass, system.damping, system.ground)
        )
        return disk_stiffness(self._omega(), mass, damping, ground)

    def _turned(self) -> tuple[jax.Array, jax.Array]:
        """Inertia times the rigid rotation of each disk ``(S,)`` kg m, and the inertia
        of that rotation.
        """
        turned = jnp.asarray(self.system.mass) * self.rigid
        return turned, jnp.where(self.system.floating, turned @ self.rigid, 1.0)

    def _hold_per_drift(self) -> jax.Array:
        """Square Omega^2 of a floating train, 0 of one that a ground holds."""
        return jnp.where(self.system.floating, self.frequency**2, 0.0)

    def _hold(self, mean: Array) -> jax.Array:
        """Forces ``(S,)`` N that hold the mean rotation of a floating train, from mean
        displacements ``(S,)``.
        """
        turned, inertia = self._turned()
        return self._hold_per_drift() * turned * (turned @ mean) / inertia

    def _at_samples(
        self, function: Callable[..., Evaluated], deflection: Array
    ) -> Evaluated:
        """Evaluate a function of the laws at time samples, along the motion with
        deflections ``(L, N+1)`` m of the links.
        """
        teeth = backlash.less_error(self.meshes, deflection[self.meshes.link])
        rule = fourier.Equidistant(self.samples)
        law, viscous, contact_damping = backlash.at_samples(
            self.meshes, rule.synthesize
        )
        values = rule.synthesize(teeth)
        rates = rule.synthesize(fourier.derivative(teeth, self.frequency))
        return function(law, viscous, contact_damping, values, rates)

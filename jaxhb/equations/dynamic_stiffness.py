"""The linear train, meshes in contact, at many harmonics at once: dynamic stiffness,
solves over the tree, receptances.

Each solve is one sweep over the tree for all harmonics, closed by the links outside it;
derivatives are implicit.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array, added, namespace, placed
from jaxhb.equations.block_sweep import (
    last_pivot,
    nonzero_pivot,
    quotient,
    scalar_sweep,
)
from jaxhb.equations.fourier import AnyArray
from jaxhb.equations.system import System

Arrays = tuple[Array, ...]
Product = Callable[[tuple[Array, Array]], tuple[Array, Array]]


def frequencies(frequency: AnyArray, harmonics: int) -> AnyArray:
    """Frequencies n Omega ``(N+1,)`` rad/s of the harmonics."""
    return frequency * namespace(frequency).arange(harmonics + 1)


def link_stiffness(system: System, omega: Array) -> Array:
    """Complex stiffness ``(L, H)`` N/m of every link: k (1 + i eta) + i omega r,
    without loss factor at the mean.
    """
    stiffness, loss, viscous = (
        field if field.ndim == 2 else field[:, None]
        for field in (system.stiffness, system.loss, system.viscous)
    )
    return complex_stiffness(omega, stiffness, loss, viscous)


def complex_stiffness(
    omega: Array, stiffness: Array, loss: Array, viscous: Array
) -> Array:
    """Stiffness k (1 + i eta) + i omega r of a link, in N/m."""
    return stiffness * (1 + 1j * loss * (omega > 0)) + 1j * omega * viscous


def node_stiffness(system: System, omega: Array) -> Array:
    """Dynamic stiffness ``(S, N+1)`` N/m of every disk. A floating train is held at its
    root for the mean; without mean imbalance nothing flows through that support.
    """
    Z = disk_stiffness(
        omega, system.mass[:, None], system.damping[:, None], system.ground[:, None]
    )
    hold = namespace(Z).where(system.floating & (omega == 0), 1.0, 0.0)
    return added(Z, system.tree.node[-1], hold)


def disk_stiffness(
    omega: AnyArray, mass: AnyArray, damping: AnyArray, ground: AnyArray
) -> AnyArray:
    """Dynamic stiffness in N/m of a disk with nothing else to hold it: -omega^2 m + i
    omega b + ground.
    """
    return -(omega**2) * mass + 1j * omega * damping + ground


def solve_linear(
    system: System, omega: Array, load: Array, forces: int | None = None
) -> tuple[Array, Array]:
    """Displacements ``(S, R, H)`` m and link forces ``(L, forces, H)`` N of the train:
    ``Z x = q``, ``f = C D x``

    omega : ``(H,)`` rad/s; load : complex ``(S, R, H)`` N, R loads in disk order;
    forces : of how many loads, the first ones, the link forces (elastic, viscous and
    loss-factor part, positive for ``a x_a > b x_b``) are returned; default all.

    A change of the train acts like a load: ``Z dx = dq - dZ x``, one more sweep
    forwards and one backwards instead of the derivative of every step of the
    elimination. Numbers of the host are solved there.
    """
    if namespace(system, omega, load) is not np:
        return _solve_linear(system, omega, load, forces)
    with_forces = load.shape[1] if forces is None else forces
    C = link_stiffness(system, omega)
    node = node_stiffness(system, omega)
    return _sweep(system, C, node, load, with_forces)


@partial(jax.custom_jvp, nondiff_argnums=(3,))
def _solve_linear(
    system: System, omega: Array, load: Array, forces: int | None
) -> tuple[Array, Array]:
    """Solve as :func:`solve_linear`, in a program, with implicit derivatives."""
    C = link_stiffness(system, omega)
    node = node_stiffness(system, omega)
    with_forces = load.shape[1] if forces is None else forces

    def residual(motion: tuple[Array, Array]) -> tuple[Array, Array]:
        displacement, force = motion
        pushed = C[:, None] * system.deflections(displacement)
        return (
            node[:, None] * displacement + system.spread(pushed),
            force - pushed[:, :with_forces],
        )

    def solve(matvec: Product, right_side: tuple[Array, Array]) -> tuple[Array, Array]:
        load, shift = right_side
        displacement, force = _sweep(system, C, node, load, with_forces)
        return displacement, force + shift

    def solve_transposed(
        matvec: Product, right_side: tuple[jax.Array, jax.Array]
    ) -> tuple[Array, Array]:
        at_disks, at_links = right_side
        load = system.spread(C[:, None] * at_links)
        load = at_disks.at[:, :with_forces].add(load)
        displacement, _ = _sweep(system, C, node, load, 0)
        return displacement, at_links

    # The transpose stands here, as versions of jax differ in what they transpose by
    # themselves: not a loop that carries pivots beside loads. All that is solved for
    # has to be linear in the loads, so are the zeros.
    zeros = jnp.zeros((len(C), 1, 1)) * load[:1, :with_forces]
    return lax.custom_linear_solve(residual, (load, zeros), solve, solve_transposed)


@_solve_linear.defjvp
def _solve_linear_jvp(forces: int | None, primals: tuple, tangents: tuple) -> tuple:
    """Values and derivatives of :func:`_solve_linear`, by one more solve."""
    system, omega, load = primals
    system_dot, omega_dot, load_dot = tangents
    displacement, force = _solve_linear(system, omega, load, None)

    def parts(system: System, omega: Array) -> tuple[Array, Array, Array]:
        return (
            link_stiffness(system, omega),
            node_stiffness(system, omega),
            system.deflections(displacement),
        )

    (C, *_), (C_dot, node_dot, bent) = jax.jvp(
        parts, (system, omega), (system_dot, omega_dot)
    )
    # Deflections from forces, not from differences of displacements, in which stiff
    # links lose the digits that the sweep has kept.
    deflection = force / jnp.where(C == 0, 1.0, C)[:, None]
    held = C_dot[:, None] * deflection + C[:, None] * bent
    _, ends_dot = jax.jvp(type(system).spread, (system, force), (system_dot, held))
    change_of_load = load_dot - node_dot[:, None] * displacement - ends_dot
    displacement_dot, force_dot = _solve_linear(system, omega, change_of_load, forces)
    return (
        (displacement, force[:, :forces]),
        (displacement_dot, force_dot + held[:, :forces]),
    )


def balance(
    system: System, omega: Array, load: Array, displacement: Array, force: Array
) -> tuple[Array, Array, Array]:
    """Measures of how loads ``(S, H)`` are balanced: the largest force left on a disk,
    the largest load, and the largest force of all links, inertias, dampers and grounds,
    ``(H,)`` N each.
    """
    xp = namespace(system, load, displacement)
    mass, damping, ground = (
        xp.asarray(field)[:, None]
        for field in (system.mass, system.damping, system.ground)
    )
    left = (
        load
        - disk_stiffness(omega, mass, damping, ground) * displacement
        - system.spread(force)
    )
    # A train that moves as one at its resonance strains no link.
    disk_force = (omega**2 * mass + omega * damping + ground) * _size(displacement)
    largest_left, largest_load, largest_force = (
        xp.max(_size(forces), axis=0, initial=0.0) for forces in (left, load, force)
    )
    largest_disk_force = xp.max(disk_force, axis=0)
    return largest_left, largest_load, xp.maximum(largest_force, largest_disk_force)


def probe_balance(
    system: System, omega: Array, load: Array
) -> tuple[Array, Array, Array]:
    """:func:`balance` ``(H,)`` of other loads ``(S, H)``, as large at every frequency,
    which move what loads that cancel each other do not: an undamped mode at its
    resonance. Zero where every link is damped, as there is none.
    """
    xp = namespace(system, omega, load)
    if xp is not np:  # a status, which it is for, has no derivative
        system, omega, load = lax.stop_gradient((system, omega, load))
    undamped = xp.any((system.viscous == 0) & (system.loss == 0))

    def probe() -> tuple[Array, Array, Array]:
        # Incommensurable weights: no mode is orthogonal to them but by accident. Means
        # are judged by themselves.
        weights = xp.cos(xp.arange(1.0, len(load) + 1))
        largest = xp.max(_size(load), axis=0, initial=0.0)
        probes = weights[:, None] * xp.where(omega == 0, 0.0, largest) + 0j
        displacement, force = solve_linear(system, omega, probes[:, None])
        return balance(system, omega, probes, displacement[:, 0], force[:, 0])

    def nothing() -> tuple[Array, Array, Array]:
        zeros = xp.zeros(len(omega))
        return zeros, zeros, zeros

    if xp is np:
        return probe() if undamped else nothing()
    return lax.cond(undamped, probe, nothing)


def _size(values: Array) -> Array:
    """Sum of the moduli of real and imaginary part."""
    xp = namespace(values)
    return xp.abs(values.real) + xp.abs(values.imag)


def _sweep(
    system: System, C: Array, node: Array, load: Array, forces: int
) -> tuple[Array, Array]:
    """Eliminate the tree with links ``C`` and disks ``node``, and close it by the links
    outside it: displacements and link forces of :func:`solve_linear`.
    """
    tree = system.tree
    xp = namespace(C, node, load)
    if not len(C):
        no_force = xp.zeros((0, *load[:, :forces].shape[1:]), load.dtype)
        return load / last_pivot(node[:, None]), no_force
    near = xp.where(tree.from_a, system.arm_a[tree.link], system.arm_b[tree.link])
    far = xp.where(tree.from_a, system.arm_b[tree.link], system.arm_a[tree.link])
    loops = len(tree.loops)
    if loops:
        # Beside the loads, a unit force in each link outside the tree: from the
        # motion that it makes follows how much of it closes the loop.
        unit = unit_forces(system.incidence(tree.loops), load.shape[2])
        load = xp.concatenate([unit, load], axis=1)
    displacement, force = scalar_sweep(
        tree.slots,
        near,
        far,
        C[tree.link],
        node[tree.node],
        load[tree.node],
        loops + forces,
    )
    displacement = placed(xp.zeros_like(displacement), tree.node, displacement)
    signed = xp.where(tree.from_a, 1.0, -1.0)[:, None, None] * force
    link_force = xp.zeros((C.shape[0], *force.shape[1:]), force.dtype)
    link_force = placed(link_force, tree.link[:-1], signed[:-1])
    if not loops:
        return displacement, link_force
    # The forces of the links outside the tree: (I + C G) f = C D x_tree at every
    # harmonic.
    unit = displacement[:, :loops]
    loaded = displacement[:, loops:]
    # The tree under its loads opens the loops by D x_tree, and a unit force in a link
    # closes them by its receptance (Woodbury's identity): I + C G is regular where the
    # whole train is.
    gap = system.deflections(loaded, tree.loops).transpose(2, 0, 1)
    loop_receptance = system.deflections(unit, tree.loops).transpose(2, 0, 1)
    C_loop = C[tree.loops].T[:, :, None]
    closing = _solve_small(xp.eye(loops) + C_loop * loop_receptance, C_loop * gap)
    displacement = loaded - xp.einsum("slh,hlr->srh", unit, closing)
    closing = closing[..., : link_force.shape[1] - loops]
    force = link_force[:, loops:] - xp.einsum(
        "klh,hlr->krh", link_force[:, :loops], closing
    )
    return displacement, placed(force, tree.loops, closing.transpose(1, 2, 0))


def _solve_small(matrices: Array, right: Array) -> Array:
    """Solutions ``(H, n, R)`` of small systems ``(H, n, n)``; where one is singular
    they are huge.
    """
    identity = np.eye(matrices.shape[-1])
    if namespace(matrices, right) is np:
        try:
            return np.linalg.solve(matrices, right)
        except np.linalg.LinAlgError:
            # Their terms are of the size of 1 even where all of them cancel.
            size = np.abs(matrices).max(axis=(1, 2), keepdims=True, initial=1.0)
            return np.linalg.solve(
                matrices + np.finfo(float).eps * size * identity, right
            )
    factors, swaps = jax.scipy.linalg.lu_factor(matrices)
    factors = jnp.where(identity == 1, last_pivot(factors), factors)
    return jax.scipy.linalg.lu_solve((factors, swaps), right)


def condensed_chains(system: System, omega: Array) -> tuple[System, Array, Array]:
    """The train with its chains of disks without teeth as single links
    (:class:`~jaxhb.equations.system.Condensation`): a System whose tree and arms alone
    are those of the K disks that remain, links ``(L, H)`` and nodes ``(K, H)`` N/m.

    A disk of dynamic stiffness g between links k and c is a link kc/(k+c+g) between its
    neighbours, and stiffnesses kg/(k+c+g) and cg/(k+c+g) of these: sums without
    differences, so that a soft ground costs no digits.
    """
    condensation = system.tree.condensation
    assert condensation is not None  # of a whole train

    def fields(names: Sequence[str], index: Array) -> tuple[Array, ...]:
        return tuple(jnp.asarray(getattr(system, name))[index] for name in names)

    of_links = ("stiffness", "loss", "viscous")
    of_disks = ("mass", "damping", "ground")

    def take_out(
        state: tuple[Arrays, Arrays],
        row: tuple[Array, Array, Array, Arrays, Arrays, Arrays],
    ) -> tuple[tuple[Arrays, Arrays], None]:
        (link, begin, end), chains = state
        chain, first, held, before, after, disk = row
        link_before = jnp.where(held, complex_stiffness(omega, *before), 0.0)
        link = jnp.where(first, link_before, link)
        begin = jnp.where(first, 0.0, begin)
        end = jnp.where(first, 0.0, end)
        onward = complex_stiffness(omega, *after)
        to_ground = disk_stiffness(omega, *disk) + end
        pivot = nonzero_pivot(link + onward + to_ground, link + onward)
        inverse = quotient(1.0, pivot)
        # Condensed so far, the chain is a link k = C1 C2 / (C1 + C2 + g), and
        # stiffnesses to ground at its two ends.
        condensed = (
            link * onward * inverse,
            begin + link * to_ground * inverse,
            onward * to_ground * inverse,
        )
        chains = tuple(
            lax.dynamic_update_index_in_dim(values, new, chain, 0)
            for values, new in zip(chains, condensed, strict=True)
        )
        return (condensed, chains), None

    joined = len(condensation.begin)
    rows = (
        condensation.chain,
        jnp.diff(condensation.chain, prepend=-1) != 0,
        condensation.chain < joined,
        fields(of_links, condensation.before),
        fields(of_links, condensation.after),
        fields(of_disks, condensation.disk),
    )
    zeros: Arrays = (jnp.zeros(len(omega), complex),) * 3
    chains: Arrays = (jnp.zeros((len(condensation.end), len(omega)), complex),) * 3
    if len(condensation.end):
        (_, chains), _ = lax.scan(take_out, (zeros, chains), rows)
    chain_link, chain_begin, chain_end = chains
    plain = condensation.plain
    stiffness, loss, viscous = (field[:, None] for field in fields(of_links, plain))
    plain_link = complex_stiffness(omega, stiffness, loss, viscous)
    link = jnp.concatenate([chain_link[:joined], plain_link])
    node = node_stiffness(system, omega)[condensation.remaining]
    node = node.at[condensation.begin].add(chain_begin[:joined])
    node = node.at[condensation.end].add(chain_end)
    arm_a, arm_b = (
        jnp.concatenate([jnp.ones(joined), arm])
        for arm in fields(("arm_a", "arm_b"), plain)
    )
    condensed = dataclasses.replace(
        system,
        tree=condensation.tree,
        mass=system.mass[condensation.remaining],
        arm_a=arm_a,
        arm_b=arm_b,
    )
    return condensed, link, node


@jax.custom_jvp
def receptance(system: System, omega: Array, columns: Array) -> Array:
    """Deflections per unit force ``(H, G, G)`` m/N, ``D Z^{-1} D^T``, of meshes with
    ``columns`` ``(S, G)`` of D^T.
    """
    condensed, link, node = condensed_chains(system, omega)
    condensation = system.tree.condensation
    assert condensation is not None  # of a whole train
    mesh_columns = columns[condensation.remaining]
    motion, _ = _sweep(condensed, link, node, unit_forces(mesh_columns, len(omega)), 0)
    return jnp.einsum("sg,srh->hgr", mesh_columns, motion)


def _receptance_of_all_disks(system: System, omega: Array, columns: Array) -> Array:
    """Receptances as of :func:`receptance` by a sweep over all disks, whose derivative
    is defined.
    """
    motion, _ = solve_linear(system, omega, unit_forces(columns, len(omega)), forces=0)
    return jnp.einsum("sg,srh->hgr", columns, motion)


receptance.defjvp(partial(jax.jvp, _receptance_of_all_disks))


def unit_forces(columns: Array, count: int) -> Array:
    """Loads ``(S, G, count)`` N: a unit force in each link with ``columns`` ``(S, G)``
    of D^T, at every frequency.
    """
    xp = namespace(columns)
    shape = (*columns.shape, count)
    return xp.broadcast_to(columns[:, :, None], shape).astype(complex)

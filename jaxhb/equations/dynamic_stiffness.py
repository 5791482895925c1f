"""The linear train, meshes in contact, at many harmonics at once: dynamic stiffness,
solves over the tree, receptances.

Each solve is one sweep over the tree for all harmonics, closed by the links outside it;
derivatives are implicit.
"""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import added, namespace, placed
from jaxhb.equations.block_sweep import (
    last_pivot,
    nonzero_pivot,
    quotient,
    scalar_sweep,
)


def frequencies(frequency, harmonics):
    """``(N+1,)`` rad/s: n Omega."""
    return frequency * namespace(frequency).arange(harmonics + 1)


def link_stiffness(system, omega):
    """Complex stiffness ``(L, H)`` of every link: k (1 + i eta) + i omega r, without
    loss factor at the mean.
    """
    fields = system.stiffness, system.loss, system.viscous
    return complex_stiffness(
        omega, *(field if field.ndim == 2 else field[:, None] for field in fields)
    )


def complex_stiffness(omega, stiffness, loss, viscous):
    """k (1 + i eta) + i omega r of a link."""
    return stiffness * (1 + 1j * loss * (omega > 0)) + 1j * omega * viscous


def node_stiffness(system, omega):
    """Dynamic stiffness ``(S, N+1)`` of every disk. A floating train is held at its
    root for the mean; without mean imbalance nothing flows through that support.
    """
    Z = disk_stiffness(
        omega, system.mass[:, None], system.damping[:, None], system.ground[:, None]
    )
    return added(
        Z,
        system.tree.node[-1],
        namespace(Z).where(system.floating & (omega == 0), 1.0, 0.0),
    )


def disk_stiffness(omega, mass, damping, ground):
    """Dynamic stiffness of a disk with nothing else to hold it: -omega^2 m + i omega b
    + ground.
    """
    return -(omega**2) * mass + 1j * omega * damping + ground


def solve_linear(system, omega, load, forces=None):
    """Displacements ``(S, R, H)`` m and link forces ``(L, forces, H)`` N of the train:
    ``Z x = q``, ``f = C D x``

    omega : ``(H,)`` rad/s; load : complex ``(S, R, H)`` N, R loads in disk order;
    forces : of how many loads, the first ones, the link forces (elastic, viscous and
    loss-factor part, positive for ``a x_a > b x_b``) are wanted.

    A change of the train acts like a load: ``Z dx = dq - dZ x``, one more sweep
    forwards and one backwards instead of the derivative of every step of the
    elimination. Numbers of the host are solved there.
    """
    if namespace(system, omega, load) is not np:
        return _solve_linear(system, omega, load, forces)
    kept = load.shape[1] if forces is None else forces
    return _sweep(
        system, link_stiffness(system, omega), node_stiffness(system, omega), load, kept
    )


@partial(jax.custom_jvp, nondiff_argnums=(3,))
def _solve_linear(system, omega, load, forces):
    C, node = link_stiffness(system, omega), node_stiffness(system, omega)
    kept = load.shape[1] if forces is None else forces

    def residual(unknown):
        displacement, force = unknown
        pushed = C[:, None] * system.deflections(displacement)
        return (
            node[:, None] * displacement + system.spread(pushed),
            force - pushed[:, :kept],
        )

    def solve(_, given):
        load, shift = given
        displacement, force = _sweep(system, C, node, load, kept)
        return displacement, force + shift

    def solve_transposed(_, given):
        moved, pushed = given
        load = system.spread(C[:, None] * pushed)
        return _sweep(system, C, node, moved.at[:, :kept].add(load), 0)[0], pushed

    # The transpose stands here, as versions of jax differ in what they transpose by
    # themselves: not a loop that carries pivots beside loads. All that is solved for
    # has to be linear in the loads, so are the zeros.
    nothing = jnp.zeros((len(C), 1, 1)) * load[:1, :kept]
    return lax.custom_linear_solve(residual, (load, nothing), solve, solve_transposed)


@_solve_linear.defjvp
def _solve_linear_jvp(forces, primals, tangents):
    (system, omega, load), (system_dot, omega_dot, load_dot) = primals, tangents
    displacement, force = _solve_linear(system, omega, load, None)

    def parts(system, omega):
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
    change = _solve_linear(
        system, omega, load_dot - node_dot[:, None] * displacement - ends_dot, forces
    )
    return (displacement, force[:, :forces]), (change[0], change[1] + held[:, :forces])


def balance(system, omega, load, displacement, force):
    """How loads ``(S, H)`` are taken: the largest force left on a disk, the largest
    load, and the largest force of all links, inertias, dampers and grounds, ``(H,)`` N
    each.
    """
    xp = namespace(system, load, displacement)
    mass, damping, ground = (
        xp.asarray(a)[:, None] for a in (system.mass, system.damping, system.ground)
    )
    left = (
        load
        - disk_stiffness(omega, mass, damping, ground) * displacement
        - system.spread(force)
    )
    # A train that moves as one at its resonance strains no link.
    own = (omega**2 * mass + omega * damping + ground) * _size(displacement)
    left, load, force = (
        xp.max(_size(a), axis=0, initial=0.0) for a in (left, load, force)
    )
    return left, load, xp.maximum(force, xp.max(own, axis=0))


def _size(values):
    xp = namespace(values)
    return xp.abs(values.real) + xp.abs(values.imag)


def _sweep(system, C, node, load, forces):
    """The elimination of the tree with links ``C`` and disks ``node``, closed by the
    links outside it.
    """
    tree = system.tree
    xp = namespace(C, node, load)
    if not len(C):
        return load / last_pivot(node[:, None]), xp.zeros(
            (0, *load[:, :forces].shape[1:]), load.dtype
        )
    near = xp.where(tree.from_a, system.arm_a[tree.link], system.arm_b[tree.link])
    far = xp.where(tree.from_a, system.arm_b[tree.link], system.arm_a[tree.link])
    loops = len(tree.loops)
    if loops:
        # Beside the given loads, a unit force in each link outside the tree: from the
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
    given = displacement[:, loops:]
    # The tree under its loads opens the loops by D x_tree, and a unit force in a link
    # closes them by its receptance (Woodbury's identity): I + C G is regular where the
    # whole train is.
    gap, own = (
        system.deflections(x, tree.loops).transpose(2, 0, 1) for x in (given, unit)
    )
    C_loop = C[tree.loops].T[:, :, None]
    closing = _solve_small(xp.eye(loops) + C_loop * own, C_loop * gap)
    displacement = given - xp.einsum("slh,hlr->srh", unit, closing)
    closing = closing[..., : link_force.shape[1] - loops]
    force = link_force[:, loops:] - xp.einsum(
        "klh,hlr->krh", link_force[:, :loops], closing
    )
    return displacement, placed(force, tree.loops, closing.transpose(1, 2, 0))


def _solve_small(matrices, right):
    """Solutions ``(H, n, R)`` of small systems ``(H, n, n)``; where one is singular
    they are huge.
    """
    identity = np.eye(matrices.shape[-1])
    if namespace(matrices, right) is np:
        try:
            return np.linalg.solve(matrices, right)
        except np.linalg.LinAlgError:
            size = np.abs(matrices).max(axis=(1, 2), keepdims=True)
            return np.linalg.solve(
                matrices + np.finfo(float).eps * size * identity, right
            )
    factors, swaps = jax.scipy.linalg.lu_factor(matrices)
    factors = jnp.where(identity == 1, last_pivot(factors), factors)
    return jax.scipy.linalg.lu_solve((factors, swaps), right)


def condensed_chains(system, omega):
    """The train with its chains of disks without teeth as single links
    (:class:`~jaxhb.train.chain.Condensation`): a System whose tree and arms alone are
    those of the K disks that are kept, links ``(L, H)`` and nodes ``(K, H)`` N/m.

    A disk of dynamic stiffness g between links k and c is a link kc/(k+c+g) between its
    neighbours, and stiffnesses kg/(k+c+g) and cg/(k+c+g) of these: sums without
    differences, so that a soft ground costs no digits.
    """
    condensation = system.tree.condensation

    def numbers(*fields, at):
        return tuple(jnp.asarray(getattr(system, name))[at] for name in fields)

    elastic = "stiffness", "loss", "viscous"

    def take_out(state, item):
        (link, begin, end), chains = state
        chain, first, held, before, after, disk = item
        link = jnp.where(
            first, jnp.where(held, complex_stiffness(omega, *before), 0.0), link
        )
        begin = jnp.where(first, 0.0, begin)
        end = jnp.where(first, 0.0, end)
        onward = complex_stiffness(omega, *after)
        own = disk_stiffness(omega, *disk) + end
        inverse = quotient(1.0, nonzero_pivot(link + onward + own, link + onward))
        # What the chain so far is seen as: a link k = C1 C2 / (C1 + C2 + g), and
        # stiffnesses to ground at its two ends.
        now = (
            link * onward * inverse,
            begin + link * own * inverse,
            onward * own * inverse,
        )
        chains = tuple(
            lax.dynamic_update_index_in_dim(c, new, chain, 0)
            for c, new in zip(chains, now, strict=True)
        )
        return (now, chains), None

    joined = len(condensation.begin)
    items = (
        condensation.chain,
        jnp.diff(condensation.chain, prepend=-1) != 0,
        condensation.chain < joined,
    )
    items += (
        numbers(*elastic, at=condensation.before),
        numbers(*elastic, at=condensation.after),
    )
    items += (numbers("mass", "damping", "ground", at=condensation.disk),)
    nothing = (jnp.zeros(len(omega), complex),) * 3
    chains = (jnp.zeros((len(condensation.end), len(omega)), complex),) * 3
    if len(condensation.end):
        (_, chains), _ = lax.scan(take_out, (nothing, chains), items)
    plain = condensation.plain
    link = jnp.concatenate(
        [
            chains[0][:joined],
            complex_stiffness(
                omega, *(a[:, None] for a in numbers(*elastic, at=plain))
            ),
        ]
    )
    node = node_stiffness(system, omega)[condensation.kept]
    node = (
        node.at[condensation.begin]
        .add(chains[1][:joined])
        .at[condensation.end]
        .add(chains[2])
    )
    arms = {
        name: jnp.concatenate([jnp.ones(joined), *numbers(name, at=plain)])
        for name in ("arm_a", "arm_b")
    }
    return (
        dataclasses.replace(
            system, tree=condensation.tree, mass=system.mass[condensation.kept], **arms
        ),
        link,
        node,
    )


@jax.custom_jvp
def receptance(system, omega, columns):
    """Deflections per unit force ``(H, G, G)`` m/N, ``D Z^{-1} D^T``, of meshes with
    ``columns`` ``(S, G)`` of D^T.
    """
    small, link, node = condensed_chains(system, omega)
    own = columns[system.tree.condensation.kept]
    motion, _ = _sweep(small, link, node, unit_forces(own, len(omega)), 0)
    return jnp.einsum("sg,srh->hgr", own, motion)


def _receptance_of_all_disks(system, omega, columns):
    """The same by a sweep over all disks, whose derivative is known."""
    motion, _ = solve_linear(system, omega, unit_forces(columns, len(omega)), forces=0)
    return jnp.einsum("sg,srh->hgr", columns, motion)


receptance.defjvp(partial(jax.jvp, _receptance_of_all_disks))


def unit_forces(columns, count):
    """Loads ``(S, G, count)``: a unit force in each link with ``columns`` ``(S, G)`` of
    D^T, at every frequency.
    """
    return (
        namespace(columns)
        .broadcast_to(columns[:, :, None], (*columns.shape, count))
        .astype(complex)
    )

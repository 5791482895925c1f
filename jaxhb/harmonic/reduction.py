"""The linear train condensed to the meshes that can leave contact: receptances and the reduced equation.

With every mesh taken in contact (``Z(n) = -n^2 Omega^2 M + i n Omega B + K``, mesh damping included) the steady motion
obeys, exactly equivalent to A(x) = 0 (method.md A4.4),

    F(l) = l - l_lin + G phi(l, l') = 0,      l_lin(n) = D Z(n)^{-1} q(n),      G(n) = D Z(n)^{-1} D^T,

where ``phi`` is the mesh force less its linear part, ``phi = f(l) - c l + r l' (engagement - 1)`` (damping in contact).
``phi`` is constant while a mesh stays on one flank. The unknowns are the deflections of the active meshes alone; every
other node is condensed by scalar sweeps, one for all harmonics.
"""

import dataclasses
from dataclasses import dataclass, field
from functools import partial

import jax
import jax.numpy as jnp
from jax import lax

from . import backlash, exact, fourier
from .block_sweep import divide, regular, scalar_sweep

CHUNK = 64
"""Harmonics swept at a time: even a finely divided train then stays in the cache of a processor."""


def frequencies(frequency, harmonics):
    """``(N+1,)`` rad/s: n Omega."""
    return frequency * jnp.arange(harmonics + 1)


def link_stiffness(system, omega):
    """Complex stiffness ``(L, H)`` of every link: k (1 + i eta) + i omega r, without loss factor at the mean."""
    fields = system.stiffness, system.loss, system.viscous
    return _of_link(omega, *(field if field.ndim == 2 else field[:, None] for field in fields))


def node_stiffness(system, omega):
    """Dynamic stiffness ``(S, N+1)`` of every disk: -omega^2 m + i omega b + ground.

    A floating train is held at its root for the mean; without mean imbalance nothing flows through that support.
    """
    Z = disk_stiffness(omega, system.mass[:, None], system.damping[:, None], system.ground[:, None])
    return Z.at[system.tree.node[-1]].add(jnp.where(system.floating & (omega == 0), 1.0, 0.0))


def _of_link(omega, stiffness, loss, viscous):
    return stiffness * (1 + 1j * loss * (omega > 0)) + 1j * omega * viscous


def disk_stiffness(omega, mass, damping, ground):
    """Dynamic stiffness of a disk with nothing else to hold it: -omega^2 m + i omega b + ground."""
    return -(omega**2) * mass + 1j * omega * damping + ground


@partial(jax.custom_jvp, nondiff_argnums=(3,))
def solve_linear(system, omega, load, forces=None):
    """Displacements and link forces of the linear train for given loads: ``Z x = q``, ``f = C D x``.

    A change of the train acts like a load: ``Z dx = dq - dZ x``, one more sweep forwards and one backwards instead of
    the derivative of every step of the elimination.

    Parameters
    ----------
    system : System
    omega : array ``(H,)`` rad/s
    load : complex array ``(S, R, H)`` N, R loads in disk order
    forces : int, optional
        Of how many loads, the first ones, the link forces are wanted; default all R.

    Returns
    -------
    displacement : complex array ``(S, R, H)`` m
    force : complex array ``(L, forces, H)`` N
        Transmitted force of every link (elastic, viscous and loss-factor part), positive for ``a x_a > b x_b``.
    """
    C, node = link_stiffness(system, omega), node_stiffness(system, omega)
    kept = load.shape[1] if forces is None else forces

    def residual(unknown):
        displacement, force = unknown
        pushed = C[:, None] * system.deflections(displacement)
        resisted = node[:, None] * displacement + system.spread(pushed)
        return resisted, force - pushed[:, :kept]

    def solve(_, given):
        load, shift = given
        displacement, force = _sweep(system, C, node, load, kept)
        return displacement, force + shift

    def solve_transposed(_, given):
        moved, pushed = given
        load = system.spread(C[:, None] * pushed)
        return _sweep(system, C, node, moved.at[:, :kept].add(load), 0)[0], pushed

    # The transpose stands here, as versions of jax differ in what they transpose by themselves: not a loop that carries
    # pivots beside loads. All that is solved for has to be linear in the loads, so are the zeros.
    nothing = jnp.zeros((len(C), 1, 1)) * load[:1, :kept]
    return lax.custom_linear_solve(residual, (load, nothing), solve, solve_transposed)


@solve_linear.defjvp
def _solve_linear_jvp(forces, primals, tangents):
    (system, omega, load), (system_dot, omega_dot, load_dot) = primals, tangents
    displacement, force = solve_linear(system, omega, load)

    def parts(system, omega):
        return link_stiffness(system, omega), node_stiffness(system, omega), system.deflections(displacement)

    (C, *_), (C_dot, node_dot, bent) = jax.jvp(parts, (system, omega), (system_dot, omega_dot))
    deflection = force / jnp.where(C == 0, 1.0, C)[:, None]
    held = C_dot[:, None] * deflection + C[:, None] * bent
    _, ends_dot = jax.jvp(type(system).spread, (system, force), (system_dot, held))
    change = solve_linear(system, omega, load_dot - node_dot[:, None] * displacement - ends_dot, forces)
    return (displacement, force[:, :forces]), (change[0], change[1] + held[:, :forces])


def _sweep(system, C, node, load, forces):
    """The elimination of the tree with links ``C`` and disks ``node``, closed by the links outside it."""
    tree = system.tree
    if not len(C):
        return load / node[:, None], jnp.zeros((0, *load[:, :forces].shape[1:]), load.dtype)
    near = jnp.where(tree.from_a, system.arm_a[tree.link], system.arm_b[tree.link])
    far = jnp.where(tree.from_a, system.arm_b[tree.link], system.arm_a[tree.link])
    loops = len(tree.loops)
    extended = load
    if loops:
        unit = system.incidence(tree.loops)[:, :, None]
        unit = jnp.broadcast_to(unit, (len(unit), loops, load.shape[2]))
        extended = jnp.concatenate([unit.astype(load.dtype), load], axis=1)
    wanted = loops + (load.shape[1] if forces is None else forces)
    displacement, force = scalar_sweep(
        tree.slots, near, far, C[tree.link], node[tree.node], extended[tree.node], wanted
    )
    displacement = jnp.zeros_like(displacement).at[tree.node].set(displacement, unique_indices=True)
    signed = jnp.where(tree.from_a, 1.0, -1.0)[:, None, None] * force
    link_force = jnp.zeros((C.shape[0], *force.shape[1:]), force.dtype)
    link_force = link_force.at[tree.link[:-1]].set(signed[:-1], unique_indices=True)
    if not loops:
        return displacement, link_force
    return _close_loops(system, C, displacement, link_force, loops)


def _close_loops(system, C, displacement, link_force, loops):
    """Add the forces of the links outside the tree: (I + C G) f = C D x_tree at every harmonic."""
    unit, given = displacement[:, :loops], displacement[:, loops:]
    gap = system.deflections(given, system.tree.loops)
    receptance = system.deflections(unit, system.tree.loops)
    C_loop = C[system.tree.loops].T[:, :, None]
    matrix = jnp.eye(loops) + C_loop * receptance.transpose(2, 0, 1)
    closing = jnp.linalg.solve(matrix, C_loop * gap.transpose(2, 0, 1))
    displacement = given - jnp.einsum("slh,hlr->srh", unit, closing)
    closing = closing[..., : link_force.shape[1] - loops]
    force = link_force[:, loops:] - jnp.einsum("klh,hlr->krh", link_force[:, :loops], closing)
    return displacement, force.at[system.tree.loops].set(closing.transpose(1, 2, 0), unique_indices=True)


def condensed_chains(system, omega):
    """The train with its chains of disks without teeth as single links (:class:`~jaxhb.harmonic.chain.Condensation`).

    A disk of dynamic stiffness g between links k and c is a link kc/(k+c+g) between its neighbours, and stiffnesses
    kg/(k+c+g) and cg/(k+c+g) of these: sums without differences, so that a soft ground costs no digits.

    Returns
    -------
    system : System
        Its tree and arms alone are those of the K disks that are kept.
    link, node : complex arrays ``(L, H)``, ``(K, H)`` N/m
    """
    condensation = system.tree.condensation

    def numbers(*fields, at):
        return tuple(jnp.asarray(getattr(system, name))[at] for name in fields)

    elastic = "stiffness", "loss", "viscous"

    def take_out(state, item):
        (link, begin, end), chains = state
        chain, first, held, before, after, disk = item
        link = jnp.where(first, jnp.where(held, _of_link(omega, *before), 0.0), link)
        begin, end = jnp.where(first, 0.0, begin), jnp.where(first, 0.0, end)
        onward, own = _of_link(omega, *after), disk_stiffness(omega, *disk) + end
        inverse = divide(1.0, regular(link + onward + own, link + onward))
        now = (link * onward * inverse, begin + link * own * inverse, onward * own * inverse)
        chains = tuple(lax.dynamic_update_index_in_dim(c, new, chain, 0) for c, new in zip(chains, now, strict=True))
        return (now, chains), None

    joined = len(condensation.begin)
    items = (condensation.chain, jnp.diff(condensation.chain, prepend=-1) != 0, condensation.chain < joined)
    items += (numbers(*elastic, at=condensation.before), numbers(*elastic, at=condensation.after))
    items += (numbers("mass", "damping", "ground", at=condensation.disk),)
    nothing = (jnp.zeros(len(omega), complex),) * 3
    chains = (jnp.zeros((len(condensation.end), len(omega)), complex),) * 3
    if len(condensation.end):
        (_, chains), _ = lax.scan(take_out, (nothing, chains), items)
    plain = condensation.plain
    link = jnp.concatenate([chains[0][:joined], _of_link(omega, *(a[:, None] for a in numbers(*elastic, at=plain)))])
    node = node_stiffness(system, omega)[condensation.kept]
    node = node.at[condensation.begin].add(chains[1][:joined]).at[condensation.end].add(chains[2])
    arms = {name: jnp.concatenate([jnp.ones(joined), *numbers(name, at=plain)]) for name in ("arm_a", "arm_b")}
    return dataclasses.replace(system, tree=condensation.tree, mass=system.mass[condensation.kept], **arms), link, node


@jax.custom_jvp
def receptance(system, omega, columns):
    """Deflections per unit force ``(H, G, G)`` m/N, ``D Z^{-1} D^T``, of meshes with ``columns`` ``(S, G)`` of D^T."""
    small, link, node = condensed_chains(system, omega)
    own = columns[system.tree.condensation.kept]
    unit = jnp.broadcast_to(own[:, :, None], (*own.shape, len(omega))).astype(complex)
    motion, _ = _sweep(small, link, node, unit, 0)
    return jnp.einsum("sg,srh->hgr", own, motion)


@receptance.defjvp
def _receptance_jvp(primals, tangents):
    return jax.jvp(_receptance_of_all_disks, primals, tangents)


def _receptance_of_all_disks(system, omega, columns):
    """The same by a sweep over all disks, whose derivative is known."""
    unit = jnp.broadcast_to(columns[:, :, None], (*columns.shape, len(omega))).astype(complex)
    motion, _ = solve_linear(system, omega, unit, forces=0)
    return jnp.einsum("sg,srh->hgr", columns, motion)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Reduced:
    """The reduced equation of G active meshes (padded with meshes that do nothing).

    linear : complex ``(G, N+1)`` m, deflections with all meshes in contact; receptance : complex ``(N+1, G, G)`` m/N;
    frequency : rad/s; law, viscous N s/m, contact_damping : ``(G,)``; integrals : of phi over the cycle, "sampled" or
    "exact" (:mod:`jaxhb.harmonic.exact`); crossings : of the one deflection at which it is used, where they are known.
    """

    linear: jax.Array
    receptance: jax.Array
    frequency: jax.Array
    law: backlash.Law
    viscous: jax.Array
    contact_damping: jax.Array
    integrals: str = field(default="sampled", metadata={"static": True})
    crossings: exact.Crossings | None = None

    def located(self, deflection):
        """The same equation, with exact integrals knowing when ``deflection`` passes the knots, to be used there."""
        if self.integrals == "sampled":
            return self
        return dataclasses.replace(self, crossings=exact.locate(self.law, deflection))

    def quadrature(self, deflection, samples):
        """Where phi is evaluated: ``samples`` equidistant time samples, or those of the exact integrals."""
        return quadrature(self.integrals, self.law, deflection, samples, self.crossings)

    def nonlinear_force(self, deflection, rate):
        """phi and its slopes in l and l' at samples ``(G, samples)``: what the linear mesh does not contain."""
        law = self.law.expand()
        viscous, gated = self.viscous[:, None], self.contact_damping[:, None]
        total = backlash.mesh_force(law, viscous, gated, deflection, rate)
        slope, rate_slope = backlash.mesh_slopes(law, viscous, gated, deflection, rate)
        linear = law.stiffness * deflection + viscous * rate
        return total - linear, slope - law.stiffness, rate_slope - viscous

    def nonlinear_slopes(self, deflection, samples, harmonics):
        """Coefficients ``(2, G, harmonics+1)`` of the slopes of phi in l and l'."""
        rule = self.quadrature(deflection, samples)
        _, *slopes = self.nonlinear_force(*self.motion(deflection, rule))
        return jax.vmap(lambda slope: rule.analyze(slope, harmonics))(jnp.stack(slopes))

    def nonlinear_force_coefficients(self, deflection, samples):
        """Coefficients ``(G, N+1)`` of phi."""
        rule = self.quadrature(deflection, samples)
        nonlinear_force, _, _ = self.nonlinear_force(*self.motion(deflection, rule))
        return rule.analyze(nonlinear_force, deflection.shape[-1] - 1)

    def motion(self, deflection, rule):
        """Values of l and l' at the time samples of ``rule``, from coefficients ``(G, N+1)``."""
        return jax.vmap(rule.synthesize)(jnp.stack([deflection, fourier.derivative(deflection, self.frequency)]))

    def sampled(self, deflection, samples):
        """Values of l and l' at ``samples`` equidistant time samples."""
        return self.motion(deflection, fourier.Equidistant(samples))

    def respond(self, nonlinear_force):
        """Deflections caused by coefficients ``(G, N+1)`` of nonlinear force: G phi."""
        return jnp.einsum("ngh,hn->gn", self.receptance, nonlinear_force)

    def residual(self, deflection, samples):
        """F(l) as coefficients ``(G, N+1)``, phi sampled at ``samples`` time samples (method.md A6: 16 N) if at all."""
        return deflection - self.linear + self.respond(self.nonlinear_force_coefficients(deflection, samples))


def quadrature(integrals, law, deflection, samples, crossings=None):
    """Time samples for integrals over the cycle of forces of ``law`` at ``deflection``: "sampled" or "exact"."""
    if integrals == "exact" and len(deflection):
        return exact.divide(law, deflection, crossings)
    return fourier.Equidistant(samples)


def truncate(reduced, harmonics):
    """The same equation with fewer harmonics."""
    return dataclasses.replace(
        reduced,
        linear=reduced.linear[:, : harmonics + 1],
        receptance=reduced.receptance[: harmonics + 1],
    )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CondensedTrain:
    """The linear train under its load, and under forces at the active meshes as well.

    system : System; frequency : rad/s; load : complex ``(S, E+1)`` N; columns ``(S, G)`` of D^T of the active
    meshes. Under the load alone: mean_displacement ``(S,)`` m, mean_force ``(L,)`` N and the largest link force N.
    """

    system: object
    frequency: jax.Array
    load: jax.Array
    columns: jax.Array
    mean_displacement: jax.Array
    mean_force: jax.Array
    largest_force: jax.Array

    def combine(self, nonlinear_force):
        """Displacements ``(S, n+1)`` and link forces ``(L, n+1)`` with excess forces ``(G, n+1)`` at the meshes."""
        harmonics = nonlinear_force.shape[-1] - 1
        load = fourier.resize(self.load, harmonics) - self.columns @ nonlinear_force
        displacement, force = solve_linear(self.system, frequencies(self.frequency, harmonics), load[:, None])
        return displacement[:, 0], force[:, 0]


def reduce(system, frequency, load, harmonics, active, active_index, law, viscous, contact_damping):
    """Fold the linear train onto the active meshes.

    Parameters
    ----------
    system : System
    frequency : float, Omega in rad/s
    load : complex array ``(S, E+1)`` N, forces of the excitation and of meshes held on one flank; those above N are
        dropped
    harmonics : int, N
    active : array ``(G,)``, 1 for an active mesh and 0 for padding
    active_index : int array ``(G,)``, link of each active mesh
    law, viscous, contact_damping : ``(G,)`` entries of the active meshes

    Returns
    -------
    Reduced, CondensedTrain
    """
    load = load[:, : harmonics + 1]
    columns = system.incidence(active_index) * active
    displacement, force = solve_linear(system, frequencies(frequency, load.shape[-1] - 1), load[:, None])
    linear = system.deflections(displacement[:, 0], active_index) * active[:, None]
    chunks = -(-(harmonics + 1) // CHUNK)
    omega = frequencies(frequency, chunks * -(-(harmonics + 1) // chunks) - 1).reshape(chunks, -1)
    answers = lax.map(lambda omega: receptance(system, omega, columns), omega)
    reduced = Reduced(
        linear=fourier.resize(linear, harmonics),
        receptance=answers.reshape(omega.size, *answers.shape[2:])[: harmonics + 1],
        frequency=frequency,
        law=law,
        viscous=viscous,
        contact_damping=contact_damping,
    )
    largest_force = jnp.max(jnp.abs(force), initial=0.0)
    mean = displacement[:, 0, 0].real, force[:, 0, 0].real
    return reduced, CondensedTrain(system, frequency, load, columns, *mean, largest_force)

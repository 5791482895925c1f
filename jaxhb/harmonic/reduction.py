"""The linear train folded onto the meshes that can leave contact: receptances and the reduced equation.

With every mesh taken in contact (``Z(n) = -n^2 Omega^2 M + i n Omega B + K``, mesh damping included) the steady motion
obeys, exactly equivalent to A(x) = 0 (method.md A4.4),

    F(l) = l - l_lin + G phi(l, l') = 0,      l_lin(n) = D Z(n)^{-1} q(n),      G(n) = D Z(n)^{-1} D^T,

where ``phi`` is the mesh force less its linear part, ``phi = f(l) - c l + r l' (engagement - 1)`` (damping in contact).
``phi`` is constant while a mesh stays on one flank. The unknowns are the deflections of the active meshes alone; every
other node is folded in by scalar sweeps, one for all harmonics.
"""

import dataclasses
from dataclasses import dataclass, field
from functools import partial

import jax
import jax.numpy as jnp
from jax import lax

from . import backlash, exact, fourier
from .block_sweep import scalar_sweep

CHUNK = 64
"""Harmonics swept at a time: even a finely divided train then stays in the cache of a processor."""


def frequencies(frequency, harmonics):
    """``(N+1,)`` rad/s: n Omega."""
    return frequency * jnp.arange(harmonics + 1)


def link_stiffness(system, omega):
    """Complex stiffness ``(L, N+1)`` of every link: k (1 + i eta) + i omega r, without loss factor at the mean."""
    elastic = system.stiffness[:, None] * (1 + 1j * system.loss[:, None] * (omega > 0))
    return elastic + 1j * omega * system.viscous[:, None]


def node_stiffness(system, omega):
    """Dynamic stiffness ``(S, N+1)`` of every disk: -omega^2 m + i omega b + ground.

    A floating train is held at its root for the mean; without mean imbalance nothing flows through that support.
    """
    Z = -(omega**2) * system.mass[:, None] + 1j * omega * system.damping[:, None] + system.ground[:, None]
    return Z.at[system.tree.node[-1]].add(jnp.where(system.floating & (omega == 0), 1.0, 0.0))


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
    return _sweep(system, omega, load, forces)


@solve_linear.defjvp
def _solve_linear_jvp(forces, primals, tangents):
    (system, omega, load), (system_dot, omega_dot, load_dot) = primals, tangents
    displacement, force = solve_linear(system, omega, load)

    def stiffnesses(system, omega):
        return link_stiffness(system, omega), node_stiffness(system, omega)

    def bent(a, b):
        return a[:, None, None] * displacement[system.tree.end_a] - b[:, None, None] * displacement[system.tree.end_b]

    def spread(a, b, force):
        ends = jnp.zeros_like(displacement).at[system.tree.end_a].add(a[:, None, None] * force)
        return ends.at[system.tree.end_b].add(-b[:, None, None] * force)

    arms, arms_dot = (system.arm_a, system.arm_b), (system_dot.arm_a, system_dot.arm_b)
    (C, _), (C_dot, node_dot) = jax.jvp(stiffnesses, (system, omega), (system_dot, omega_dot))
    deflection = force / jnp.where(C == 0, 1.0, C)[:, None]
    held = C_dot[:, None] * deflection + C[:, None] * jax.jvp(bent, arms, arms_dot)[1]
    _, ends_dot = jax.jvp(spread, (*arms, force), (*arms_dot, held))
    change = solve_linear(system, omega, load_dot - node_dot[:, None] * displacement - ends_dot, forces)
    return (displacement, force[:, :forces]), (change[0], change[1] + held[:, :forces])


def _sweep(system, omega, load, forces):
    """The elimination of the tree, closed by the links outside it."""
    tree = system.tree
    C = link_stiffness(system, omega)
    node = node_stiffness(system, omega)[tree.node]
    if not len(C):
        return load / node[:, None], jnp.zeros((0, *load[:, :forces].shape[1:]), load.dtype)
    near = jnp.where(tree.from_a, system.arm_a[tree.link], system.arm_b[tree.link])
    far = jnp.where(tree.from_a, system.arm_b[tree.link], system.arm_a[tree.link])
    loops = len(tree.loops)
    extended = load
    if loops:
        unit = incidence(system, tree.loops)[:, :, None]
        unit = jnp.broadcast_to(unit, (len(unit), loops, load.shape[2]))
        extended = jnp.concatenate([unit.astype(load.dtype), load], axis=1)
    wanted = loops + (load.shape[1] if forces is None else forces)
    displacement, force = scalar_sweep(tree.places, near, far, C[tree.link], node, extended[tree.node], wanted)
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


def incidence(system, links):
    """Columns of D^T for the given links: ``(S, n)``, a at the first end and -b at the second."""
    columns = jnp.arange(len(links))
    shape = (system.mass.shape[0], len(links))
    rows = jnp.zeros(shape).at[system.tree.end_a[links], columns].add(system.arm_a[links])
    return rows.at[system.tree.end_b[links], columns].add(-system.arm_b[links])


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Reduced:
    """The reduced equation of G active meshes (padded with meshes that do nothing).

    linear : complex ``(G, N+1)`` m, deflections with all meshes in contact; receptance : complex ``(N+1, G, G)`` m/N;
    frequency : rad/s; law, viscous N s/m, contact_damping : ``(G,)``; integrals : of phi over the cycle, "sampled" or
    "exact" (:mod:`jaxhb.harmonic.exact`); passages : of the one deflection at which it is used, where they are known.
    """

    linear: jax.Array
    receptance: jax.Array
    frequency: jax.Array
    law: backlash.Law
    viscous: jax.Array
    contact_damping: jax.Array
    integrals: str = field(default="sampled", metadata={"static": True})
    passages: exact.Passages | None = None

    def located(self, deflection):
        """The same equation, with exact integrals knowing when ``deflection`` passes the knots, to be used there."""
        if self.integrals == "sampled":
            return self
        return dataclasses.replace(self, passages=exact.locate(self.law, deflection))

    def instants(self, deflection, samples):
        """Where phi is evaluated: ``samples`` equidistant instants, or those of the exact integrals."""
        return instants(self.integrals, self.law, deflection, samples, self.passages)

    def excess(self, deflection, rate):
        """phi and its slopes in l and l' at samples ``(G, samples)``: what the linear mesh does not contain."""
        law = self.law.expand()
        viscous, gated = self.viscous[:, None], self.contact_damping[:, None]
        total = backlash.mesh_force(law, viscous, gated, deflection, rate)
        slope, rate_slope = backlash.mesh_slopes(law, viscous, gated, deflection, rate)
        linear = law.stiffness * deflection + viscous * rate
        return total - linear, slope - law.stiffness, rate_slope - viscous

    def excess_slopes(self, deflection, samples, harmonics):
        """Coefficients ``(2, G, harmonics+1)`` of the slopes of phi in l and l'."""
        rule = self.instants(deflection, samples)
        _, *slopes = self.excess(*self.motion(deflection, rule))
        return jax.vmap(lambda slope: rule.analyze(slope, harmonics))(jnp.stack(slopes))

    def excess_coefficients(self, deflection, samples):
        """Coefficients ``(G, N+1)`` of phi."""
        rule = self.instants(deflection, samples)
        excess, _, _ = self.excess(*self.motion(deflection, rule))
        return rule.analyze(excess, deflection.shape[-1] - 1)

    def motion(self, deflection, rule):
        """Values of l and l' at the instants of ``rule``, from coefficients ``(G, N+1)``."""
        return jax.vmap(rule.synthesize)(jnp.stack([deflection, fourier.derivative(deflection, self.frequency)]))

    def sampled(self, deflection, samples):
        """Values of l and l' at ``samples`` equidistant instants."""
        return self.motion(deflection, fourier.Equidistant(samples))

    def respond(self, excess):
        """Deflections caused by coefficients ``(G, N+1)`` of excess force: G phi."""
        return jnp.einsum("ngh,hn->gn", self.receptance, excess)

    def residual(self, deflection, samples):
        """F(l) as coefficients ``(G, N+1)``, phi sampled at ``samples`` instants (method.md A6: 16 N) if at all."""
        return deflection - self.linear + self.respond(self.excess_coefficients(deflection, samples))


def instants(integrals, law, deflection, samples, passages=None):
    """Instants for integrals over the cycle of forces of ``law`` at ``deflection``: "sampled" or "exact"."""
    if integrals == "exact" and len(deflection):
        return exact.divide(law, deflection, passages)
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
class Folded:
    """The linear train under its load, and under forces at the active meshes as well.

    system : System; omega ``(N+1,)`` rad/s; load : complex ``(S, N+1)`` N; columns ``(S, G)`` of D^T of the active
    meshes. Under the load alone: mean_displacement ``(S,)`` m, mean_force ``(L,)`` N and the loudest link force N.
    """

    system: object
    omega: jax.Array
    load: jax.Array
    columns: jax.Array
    mean_displacement: jax.Array
    mean_force: jax.Array
    loudest: jax.Array

    def combine(self, excess):
        """Displacements ``(S, n+1)`` and link forces ``(L, n+1)`` with excess forces ``(G, n+1)`` at the meshes."""
        kept = excess.shape[-1]
        load = self.load[:, :kept] - self.columns @ excess
        displacement, force = solve_linear(self.system, self.omega[:kept], load[:, None])
        return displacement[:, 0], force[:, 0]


def reduce(system, frequency, load, active, active_index, law, viscous, contact_damping):
    """Fold the linear train onto the active meshes.

    Parameters
    ----------
    system : System
    frequency : float, Omega in rad/s
    load : complex array ``(S, N+1)`` N, forces of the excitation and of meshes held on one flank
    active : array ``(G,)``, 1 for an active mesh and 0 for padding
    active_index : int array ``(G,)``, link of each active mesh
    law, viscous, contact_damping : ``(G,)`` entries of the active meshes

    Returns
    -------
    Reduced, Folded
    """
    count = load.shape[-1]
    columns = incidence(system, active_index) * active
    chunks = -(-count // CHUNK)
    size = -(-count // chunks)
    omega = frequencies(frequency, chunks * size - 1)

    def sweep(part):
        omega, load = part
        unit = jnp.broadcast_to(columns[:, :, None], (*columns.shape, size)).astype(load.dtype)
        loads = jnp.concatenate([load[:, None], unit], axis=1)
        displacement, force = solve_linear(system, omega, loads, forces=1)
        deflection = system.deflections(displacement, active_index) * active[:, None, None]
        loudest = jnp.max(jnp.abs(force[:, 0]), initial=0.0)
        return deflection, displacement[:, 0, 0].real, force[:, 0, 0].real, loudest

    padded = jnp.pad(load, ((0, 0), (0, chunks * size - count))).reshape(-1, chunks, size)
    deflection, displacement, force, loudest = lax.map(sweep, (omega.reshape(chunks, size), padded.transpose(1, 0, 2)))
    deflection = deflection.transpose(1, 2, 0, 3).reshape(*deflection.shape[1:3], chunks * size)[..., :count]
    reduced = Reduced(
        linear=deflection[:, 0],
        receptance=deflection[:, 1:].transpose(2, 0, 1),
        frequency=frequency,
        law=law,
        viscous=viscous,
        contact_damping=contact_damping,
    )
    return reduced, Folded(system, omega[:count], load, columns, displacement[0], force[0], jnp.max(loudest))

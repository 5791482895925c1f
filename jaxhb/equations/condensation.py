"""The linear train condensed to the meshes that can leave contact: receptances and the
condensed equation.

With every mesh taken in contact (``Z(n) = -n^2 Omega^2 M + i n Omega B + K``, mesh
damping included) the steady motion obeys, exactly equivalent to A(x) = 0
(docs/theory/harmonic_balance.md A4.4),

    F(l) = l - l_lin + G phi(l, l') = 0,
    l_lin(n) = D Z(n)^{-1} q(n) - e(n),      G(n) = D Z(n)^{-1} D^T,

where ``phi`` is the mesh force less its linear part, ``phi = kappa f(l) - c l + r l'
(engagement - 1)`` (damping in contact). ``l = D x - e`` is the deflection of the teeth,
less a transmission error e, which acts on the linear train as a load, ``q`` with ``D^T
(c e + r e')``; ``kappa(t)`` is the stiffness of an instant over its mean c. ``phi`` is
constant while a mesh stays on one flank. The unknowns are the deflections of the active
meshes alone; every other node is condensed by scalar sweeps, one for all harmonics.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array, Numbers, added, namespace, remembered
from jaxhb._program import Program
from jaxhb.equations import backlash, cell_forces, exact_integrals, fourier
from jaxhb.equations.dynamic_stiffness import (
    balance,
    frequencies,
    link_stiffness,
    probe_balance,
    receptance,
    solve_linear,
)
from jaxhb.equations.system import System

# Disks up to which the motion under a load is found without a program, as quickly
HOST_DISKS = 100
# Harmonics swept at a time for receptances, and for the motions of all disks, of which
# more is held on the way: even those of a finely divided train then stay in the cache
# of a processor.
CHUNK = 64
MOTION_CHUNK = 16

Rule = fourier.Equidistant | exact_integrals.Quadrature
"""Time samples, and the integrals over them."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CondensedEquation:
    """The condensed equation of G active meshes (padded with meshes that do nothing).

    linear : complex ``(G, N+1)`` m, deflections with all meshes in contact; receptance
    : complex ``(N+1, G, G)`` m/N; frequency : rad/s; law, viscous N s/m,
    contact_damping : ``(G,)``; integrals : of phi over the cycle, "sampled", "averaged"
    between the samples (:mod:`jaxhb.equations.cell_forces`) or "exact"
    (:mod:`jaxhb.equations.exact_integrals`); crossings : of the one deflection at which
    the equation is used, where they are known; variation : complex ``(G, K+1)`` of the
    stiffness, kappa - 1, None where none varies; by_rate : whether phi depends on l'
    (damping in contact, dry friction), without which rates are not sampled.
    """

    linear: Array
    receptance: Array
    frequency: Array
    law: backlash.Law
    viscous: Array
    contact_damping: Array
    integrals: str = field(default="sampled", metadata={"static": True})
    crossings: exact_integrals.Crossings | None = None
    variation: Array | None = None
    by_rate: bool = field(default=True, metadata={"static": True})

    def with_crossings(self, deflection: Array) -> CondensedEquation:
        """The same equation, with exact integrals that know when ``deflection``, at
        which it is to be used, passes the knots.
        """
        if self.integrals != "exact":
            return self
        return dataclasses.replace(
            self, crossings=exact_integrals.find_crossings(self.law, deflection)
        )

    def nonlinear_force(self, deflection: Array, rate: Array, rule: Rule) -> Array:
        """The force phi at the samples ``(G, samples)`` of a rule: what the linear mesh
        does not contain.
        """
        law, viscous, contact_damping = backlash.at_samples(self, rule.synthesize)
        return backlash.nonlinear_force(law, viscous, contact_damping, deflection, rate)

    def _rule(self, deflection: Array, samples: int) -> Rule:
        return quadrature(self.integrals, self.law, deflection, samples, self.crossings)

    def nonlinear_slopes(
        self, deflection: Array, samples: int, harmonics: int
    ) -> Array:
        """Coefficients ``(2, G, harmonics+1)`` of the slopes of phi in l and l'."""
        if self.integrals == "averaged":
            return cell_forces.slope_coefficients(self, deflection, samples, harmonics)
        rule = self._rule(deflection, samples)
        law, viscous, contact_damping = backlash.at_samples(self, rule.synthesize)
        values, rates = self._values(deflection, rule)
        slopes = backlash.nonlinear_slopes(law, viscous, contact_damping, values, rates)
        return jax.vmap(lambda slope: rule.analyze(slope, harmonics))(jnp.stack(slopes))

    def nonlinear_force_coefficients(self, deflection: Array, samples: int) -> Array:
        """Coefficients ``(G, N+1)`` of phi at those of l."""
        if self.integrals == "averaged":
            return cell_forces.force_coefficients(self, deflection, samples)
        rule = self._rule(deflection, samples)
        values, rates = self._values(deflection, rule)
        nonlinear_force = self.nonlinear_force(values, rates, rule)
        return rule.analyze(nonlinear_force, deflection.shape[-1] - 1)

    def _values(self, deflection: Array, rule: Rule) -> tuple[Array, Array]:
        """Values of l and l' at the samples of a rule."""
        if not self.by_rate:
            values = rule.synthesize(deflection)
            return values, namespace(values).zeros_like(values)
        rate = fourier.derivative(deflection, self.frequency)
        values, rates = fourier.each(rule.synthesize, deflection, rate)
        return values, rates

    def sampled(self, deflection: Array, samples: int) -> tuple[Array, Array]:
        """Values of l and l' at ``samples`` equidistant time samples; l' is 0 where phi
        does not depend on it.
        """
        return self._values(deflection, fourier.Equidistant(samples))

    def respond(self, nonlinear_force: Array) -> Array:
        """Deflections caused by coefficients ``(G, N+1)`` of nonlinear force: G phi."""
        # Written out: a product of many small matrices takes six times as long.
        return (self.receptance * nonlinear_force.T[:, None, :]).sum(axis=-1).T

    def residual(self, deflection: Array, samples: int) -> Array:
        """Residual F(l) as coefficients ``(G, N+1)`` m; phi is taken at ``samples``
        time samples, except by exact integrals.
        """
        nonlinear_force = self.nonlinear_force_coefficients(deflection, samples)
        return self.left(deflection, nonlinear_force)

    def left(self, deflection: Array, nonlinear_force: Array) -> Array:
        """Residual F(l) ``(G, N+1)`` m from the coefficients of l and phi."""
        return deflection - self.linear + self.respond(nonlinear_force)


def quadrature(
    integrals: str,
    law: backlash.Law,
    deflection: Array,
    samples: int,
    crossings: exact_integrals.Crossings | None = None,
) -> Rule:
    """Time samples for integrals over the cycle of forces of ``law`` at ``deflection``:
    "sampled" or "exact".
    """
    if integrals == "exact" and len(deflection):
        return exact_integrals.quadrature(law, deflection, crossings)
    return fourier.Equidistant(samples)


def truncate(reduced: CondensedEquation, harmonics: int) -> CondensedEquation:
    """The same equation with fewer harmonics."""
    linear = reduced.linear[:, : harmonics + 1]
    receptance = reduced.receptance[: harmonics + 1]
    return dataclasses.replace(reduced, linear=linear, receptance=receptance)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CondensedTrain:
    """The linear train under its load, and under forces at the active meshes as well.

    system : System; frequency : rad/s; load : complex ``(S, E+1)`` N, that of
    transmission errors included; columns ``(S, G)`` of D^T of the active meshes;
    balance : how the train takes the load alone, and another that is as large
    (``balance`` and ``probe_balance`` of :mod:`~jaxhb.equations.dynamic_stiffness`),
    ``(2E+2,)`` N each; meshes : MeshParameters of all; alone : displacements ``(S,
    E+1)`` m and link forces ``(L, E+1)`` N under the load alone, where there is no
    active mesh.
    """

    system: System
    frequency: Array
    load: Array
    columns: Array
    balance: tuple[Array, Array, Array]
    meshes: backlash.MeshParameters
    alone: tuple[Array, Array] | None = None

    def combine(self, nonlinear_force: Array) -> tuple[Array, Array]:
        """Displacements ``(S, n+1)`` m and link forces ``(L, n+1)`` N with nonlinear
        forces ``(G, n+1)`` N of the meshes.
        """
        harmonics = nonlinear_force.shape[-1] - 1
        omega = frequencies(self.frequency, harmonics)
        if self.alone is not None:
            displacement, force = self.alone
            displacement = fourier.resize(displacement, harmonics)
            return displacement, self.less_error(
                fourier.resize(force, harmonics), omega
            )
        # phi acts against the deflection: D^T phi on the side of the loads.
        load = fourier.resize(self.load, harmonics) - self.columns @ nonlinear_force
        displacement, force = motion_under(self.system, omega, load)
        return displacement, self.less_error(force, omega)

    def less_error(self, force: Array, omega: Array) -> Array:
        """Forces ``(L, n+1)`` N of the linear links at teeth with errors, from the
        forces ``(L, n+1)`` N that the approach of the gears alone makes.
        """
        error = self.meshes.error
        if error is None:
            return force
        xp = namespace(force)
        links = xp.asarray(self.meshes.link)
        stiffness = link_stiffness(self.system, omega)[links]
        error = fourier.resize(error, omega.shape[-1] - 1)
        return added(xp.array(force), links, -stiffness * error)


def motion_under(system: System, omega: Array, load: Array) -> tuple[Array, Array]:
    """Displacements ``(S, H)`` m and link forces ``(L, H)`` N of the train under a load
    ``(S, H)`` N at frequencies ``(H,)``; on the host where its numbers lie there and
    disks are few.
    """
    if namespace(system, omega, load) is not np:
        return _by_chunks(system, omega, load)
    if len(system.mass) > HOST_DISKS:
        return jax.tree.map(np.asarray, _by_chunks(system, omega, load))
    displacement, force = solve_linear(system, omega, load[:, None])
    return displacement[:, 0], force[:, 0]


@remembered
def _cached_motion(arguments: tuple[System, Array, Array]) -> tuple[Array, Array]:
    """Motion of :func:`motion_under`, whose arguments are a tuple: the plan and the
    solve of a speed both need it.
    """
    system, omega, load = arguments
    motion = motion_under(system, omega, load)
    for values in motion:
        if isinstance(values, np.ndarray):
            values.flags.writeable = False
    return motion


def displacements_and_bends(
    system: System, frequency: Numbers, load: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Displacements ``(..., S, N+1)`` m of the train with all meshes in contact, and
    deflections ``(..., L, N+1)`` m of all links. The deflections come from the link
    forces, as differences of displacements lose digits where a train turns far as one.

    frequency : Omega ``(...)`` in rad/s; load ``(..., S, N+1)`` N.
    """
    speeds = np.shape(frequency)
    count = load.shape[-1]
    omega = np.multiply.outer(frequency, np.arange(count)).ravel()
    # One sweep over the tree for the harmonics of all speeds.
    loads = np.moveaxis(load, -2, 0).reshape(load.shape[-2], -1)
    displacement, force = _cached_motion((system, omega, loads))
    stiffness = link_stiffness(system, omega)
    bends = bends_of(system, displacement, force, stiffness)

    def by_speed(rows: Array) -> np.ndarray:
        return np.moveaxis(np.asarray(rows).reshape(len(rows), *speeds, count), 0, -2)

    return by_speed(displacement), by_speed(bends)


def bends_of(
    system: System,
    displacement: Array,
    force: Array,
    stiffness: Array,
    links: slice | Array = slice(None),
) -> Array:
    """Deflections ``(n, H)`` m of links, with displacements ``(S, H)`` m, from the link
    forces ``(L, H)`` N and complex stiffnesses ``(L, H)`` N/m of all.
    """
    xp = namespace(displacement, force, stiffness)
    stiffness = stiffness[links]
    apart = system.deflections(displacement, links)
    slack = stiffness == 0
    return xp.where(slack, apart, force[links] / xp.where(slack, 1.0, stiffness))


@Program
def _by_chunks(system: System, omega: Array, load: Array) -> tuple[Array, Array]:
    """Compute :func:`motion_under` for MOTION_CHUNK frequencies at a time."""
    count = len(omega)
    size = -(-count // -(-count // MOTION_CHUNK))

    def swept(
        chunk: jax.Array, motion: tuple[jax.Array, jax.Array]
    ) -> tuple[jax.Array, jax.Array]:
        # Chunks of equal size make one program; the last begins where it ends with the
        # frequencies.
        first = jnp.minimum(chunk * size, count - size)
        part = lax.dynamic_slice_in_dim(load, first, size, 1)
        displacement, force = solve_linear(
            system, lax.dynamic_slice_in_dim(omega, first, size), part[:, None]
        )
        displacements, forces = motion
        return (
            lax.dynamic_update_slice_in_dim(
                displacements, displacement[:, 0], first, 1
            ),
            lax.dynamic_update_slice_in_dim(forces, force[:, 0], first, 1),
        )

    zeros = (
        jnp.zeros((len(load), count), complex),
        jnp.zeros((len(system.arm_a), count), complex),
    )
    return lax.fori_loop(0, -(-count // size), swept, zeros)


def _cut(values: Array) -> Array:
    """Cut values ``(..., N+1)`` of harmonics into chunks ``(chunks, ..., size)``, each
    to be swept at once; the last repeats.
    """
    count = values.shape[-1]
    chunks = -(-count // CHUNK)
    size = -(-count // chunks)
    # Equal chunks make one program; harmonics that fill the last one up are dropped
    # again.
    filled = jnp.concatenate(
        [values, jnp.repeat(values[..., -1:], chunks * size - count, axis=-1)], axis=-1
    )
    return jnp.moveaxis(filled.reshape(*values.shape[:-1], chunks, size), -2, 0)


def with_receptances(
    equation: CondensedEquation, system: System, columns: Array
) -> CondensedEquation:
    """Give a CondensedEquation its receptances, those of a System; columns ``(S, G)``
    of D^T of its meshes.
    """
    omega = frequencies(equation.frequency, equation.linear.shape[-1] - 1)
    return dataclasses.replace(
        equation, receptance=_receptances(system, omega, columns)
    )


def linear_motion(
    system: System,
    frequency: Array,
    load: Array,
    harmonics: int,
    every: backlash.MeshParameters,
    meshes: backlash.MeshParameters,
    active: Array,
) -> tuple[CondensedEquation, CondensedTrain]:
    """Make the :class:`CondensedEquation`, without receptances, and the
    :class:`CondensedTrain`; numbers of the host stay there.

    frequency : Omega in rad/s; load : complex ``(S, E+1)`` N, of the excitation and of
    meshes held on one flank, those above ``harmonics`` N are dropped; every, meshes :
    MeshParameters of all and of the active ones; active : ``(G,)`` 1, 0 for padding.
    """
    load = backlash.error_load(system, every, frequency, load)[:, : harmonics + 1]
    columns = system.incidence(meshes.link) * active
    excited = frequencies(frequency, load.shape[-1] - 1)
    displacement, force = _cached_motion((system, excited, load))
    stiffness = link_stiffness(system, excited)
    approach = bends_of(system, displacement, force, stiffness, meshes.link)
    linear = backlash.less_error(meshes, approach) * active[:, None]
    linear = fourier.resize(linear, harmonics)
    law = meshes.law.only(active)
    viscous = meshes.viscous * active
    in_contact = meshes.contact_damping & (active > 0)
    receptance = namespace(columns).zeros(
        (0, columns.shape[1], columns.shape[1]), complex
    )
    equation = CondensedEquation(
        linear,
        receptance,
        frequency,
        law,
        viscous,
        in_contact,
        variation=meshes.variation,
    )
    load_balance = tuple(
        namespace(load).concatenate(parts)
        for parts in zip(
            balance(system, excited, load, displacement, force),
            probe_balance(system, excited, load),
            strict=True,
        )
    )
    alone = None if columns.shape[1] else (displacement, force)
    train = CondensedTrain(system, frequency, load, columns, load_balance, every, alone)
    return equation, train


def _receptances(system: System, omega: Array, columns: Array) -> Array:
    """Deflections per unit force ``(N+1, G, G)`` m/N of the active meshes at
    frequencies ``(N+1,)``.
    """
    if not columns.shape[1]:
        return namespace(omega).zeros((len(omega), 0, 0), complex)
    chunks = _cut(omega)
    receptances = lax.map(lambda chunk: receptance(system, chunk, columns), chunks)
    return receptances.reshape(chunks.size, *receptances.shape[2:])[: len(omega)]

"""The equations of one train at one speed, and the fields of its solution. Arrays in,
arrays out.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array, added, kept, namespace
from jaxhb.equations import backlash, condensation, dynamic_stiffness, fourier
from jaxhb.equations.backlash import MeshParameters, all_meshes
from jaxhb.equations.block_sweep import quotient
from jaxhb.equations.reduced_model import reduced_model
from jaxhb.equations.residual import ForceBalance
from jaxhb.excitation.torques import excitation, listed_harmonic, load_power_kW
from jaxhb.results.response import Fields
from jaxhb.train import chain


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Problem:
    """A train at one speed: linear system, all its meshes, excitation.

    system : System; meshes : MeshParameters over all meshes (a mesh without backlash
    has epsilon 1, which makes its law linear); frequency : Omega in rad/s; load :
    complex ``(S, E+1)`` N, E the highest harmonic excited; rigid : ``(S,)``
    displacements of the rigid rotation; load_torque N m; load_power W.
    """

    system: chain.System
    meshes: MeshParameters
    frequency: jax.Array
    load: jax.Array
    rigid: jax.Array
    load_torque: jax.Array
    load_power: jax.Array

    def links(self, active_meshes):
        """Links ``(G,)`` of the active meshes."""
        return jnp.asarray(self.meshes.link)[active_meshes.index]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ActiveMeshes:
    """The meshes whose contact is an unknown, padded to G of them, and the flanks of
    the others.

    mask ``(G,)`` 1, or 0 for padding; index ``(G,)`` of the mesh; flank ``(M,)`` of
    every mesh: +1 or -1 where it is held on that flank all cycle, else 0.
    """

    mask: Array
    index: Array
    flank: Array


def problem_at(train, rpm, excited):
    """The :class:`Problem` of ``train`` at ``rpm``, with room for ``excited`` harmonics
    of the excitation.
    """
    xp = namespace(train, rpm)
    train = jax.tree.map(lambda a: xp.asarray(a, dtype=float), train)
    system, meshes, rigid = _at_any_speed(train)
    torque, load_torque, _ = excitation(
        train, rpm, min(excited, listed_harmonic(train.topology))
    )
    torque = fourier.resize(xp.asarray(torque), excited)
    rpm = xp.asarray(rpm, dtype=float)
    topology = train.topology
    return Problem(
        system=system,
        meshes=meshes,
        frequency=topology.cycle_frequency(rpm),
        load=torque / system.radius[:, None],
        rigid=rigid,
        load_torque=load_torque,
        load_power=1e3 * load_power_kW(train, rpm, load_torque),
    )


@kept
def _at_any_speed(train):
    """Linear system, meshes and rigid rotation of a train."""
    system = chain.assemble(train)
    return system, all_meshes(train), chain.rigid_shape(train, system.radius)


def reduced_equation(problem, harmonics, active_meshes):
    """CondensedEquation and CondensedTrain of the active meshes; those that are not
    active are held on their flanks.
    """
    equation, train = linear_equation(problem, harmonics, active_meshes)
    return condensation.with_receptances(equation, train.system, train.columns), train


def linear_equation(problem, harmonics, active_meshes):
    """The same without receptances; of numbers of the host there."""
    meshes = problem.meshes
    xp = namespace(problem, active_meshes)
    # Beyond the knee f = c l - offset sign(l): a mesh that stays on its flank is a
    # linear link with a constant force.
    constant = -xp.asarray(active_meshes.flank) * backlash.offset(meshes.law)
    load = _with_mean(
        xp.asarray(problem.load), -problem.system.spread(constant, meshes.link)
    )
    chosen = jax.tree.map(lambda a: xp.asarray(a)[active_meshes.index], meshes)
    given = (
        problem.system,
        problem.frequency,
        load,
        harmonics,
        meshes,
        chosen,
        active_meshes.mask,
    )
    return condensation.linear_motion(*given)


def _with_mean(coefficients, mean):
    """Coefficients ``(S, N+1)`` with ``mean`` ``(S,)`` added to those of harmonic 0."""
    xp = namespace(coefficients, mean)
    return coefficients + xp.where(
        np.arange(coefficients.shape[-1]) == 0, mean[:, None], 0.0
    )


def force_balance(problem, harmonics, samples):
    """The :class:`~jaxhb.equations.residual.ForceBalance` on all disks, every mesh with
    its whole law.
    """
    return ForceBalance(
        system=problem.system,
        meshes=problem.meshes,
        frequency=problem.frequency,
        load=fourier.resize(problem.load, harmonics),
        rigid=problem.rigid,
        samples=samples,
    )


def model_of(problem, active_meshes, time_steps):
    """The :class:`~jaxhb.equations.reduced_model.ReducedOrderModel` that so many time
    steps a cycle resolve, with the active meshes as its inputs.
    """
    links = problem.links(active_meshes)
    return reduced_model(
        problem.system, links, active_meshes.mask, problem.frequency, time_steps
    )


# Times the harmonics of the motion that tooth forces have: what their time samples tell
# apart.
FORCE_HARMONICS = fourier.SAMPLES_PER_HARMONIC // 2


def fields(problem, displacement, force, integrals, samples, crossings=None):
    """Motion, torques and forces from displacements ``(S, N+1)`` and forces ``(L,
    N+1)`` of the linear links.

    Deflections of meshes come from link forces, not from differences of displacements.
    Tooth forces are those of the law at the synthesised deflection, to eight times the
    harmonics of the motion: the samples themselves, or with exact integrals
    (``crossings`` of all meshes, where known) their Fourier series.
    """
    system = problem.system
    meshes = problem.meshes
    xp = namespace(problem, displacement, force)
    harmonics = displacement.shape[-1] - 1
    omega = dynamic_stiffness.frequencies(problem.frequency, harmonics)
    displacement = _with_mean(
        displacement, -chain.drift(system, problem.rigid, displacement[:, 0].real)
    )
    complex_stiffness = dynamic_stiffness.link_stiffness(system, omega)
    links = xp.asarray(meshes.link)
    stiffness = xp.asarray(system.stiffness)[:, None]
    elastic_torque = force * quotient(stiffness, complex_stiffness)
    at_meshes = complex_stiffness[links]
    mesh = force[links] / xp.where(at_meshes == 0, 1.0, at_meshes)
    ends = xp.asarray(system.radius)[system.tree.end_a][:, None]
    count = len(links) - meshes.springs
    shafts = force.shape[0] - count
    law = jax.tree.map(xp.asarray, meshes.law)
    rule = condensation.quadrature(integrals, law, mesh, samples, crossings)
    values, rates = fourier.each(
        rule.synthesize, mesh, fourier.derivative(mesh, problem.frequency)
    )
    known = backlash.at_samples(meshes, rule.synthesize)
    elastic = backlash.force(known[0], values)
    total = backlash.mesh_force(*known, values, rates)
    kept = FORCE_HARMONICS * harmonics - 1
    total, elastic = fourier.each(
        lambda values: rule.analyze(values, kept), total, elastic
    )
    torque = force
    if meshes.springs:
        # What acts beside a shaft: its force less that of the linear link in its place.
        springs = links[count:]
        linear = law.linear[count:, None] * mesh[count:]
        torque, elastic_torque = (
            added(
                fourier.resize(own, kept),
                springs,
                beside[count:] - fourier.resize(linear, kept),
            )
            for own, beside in ((torque, total), (elastic_torque, elastic))
        )
    return Fields(
        angles=chain.to_angles(system, displacement),
        torques=(torque * ends)[:shafts],
        elastic_torques=(elastic_torque * ends)[:shafts],
        deflections=mesh,
        forces=total,
        elastic_forces=elastic,
    )


def power_defect(problem, displacement, force, found):
    """Power of the torques less what dampers, links and teeth take, over what the
    torques exchange with the train.

    Zero for the exact motion and for every solution of the truncated equations, as
    elastic forces do no work over a cycle, ``sum of b |x'|^2 = <q, x'>`` (docs/theory
    A4.1): what is left comes of unsolved equations, and of the work that sampled
    elastic tooth forces seem to do. Those of a stiffness that varies, and against
    transmission errors, do work, and count.

    displacement ``(S, N+1)`` m; force ``(L, N+1)`` N of the linear links; found :
    Fields.
    """
    system = problem.system
    harmonics = displacement.shape[-1] - 1
    xp = namespace(problem, found, force)
    velocity = fourier.derivative(displacement, problem.frequency)
    load = fourier.resize(
        xp.asarray(problem.load), min(problem.load.shape[-1] - 1, harmonics)
    )
    worked = problem.meshes.variation is not None or problem.meshes.error is not None
    teeth = fourier.resize(
        found.forces - (0.0 if worked else found.elastic_forces), harmonics
    )
    count = len(teeth) - problem.meshes.springs
    links = xp.asarray(problem.meshes.link)
    at_teeth = added(xp.zeros(len(force)), links[:count], 1.0) > 0
    force = added(xp.where(at_teeth[:, None], 0.0, force), links[:count], teeth[:count])
    if problem.meshes.springs:
        own = (
            problem.meshes.law.linear[count:, None] * found.deflections[count:]
            if worked
            else 0.0
        )
        force = added(force, links[count:], teeth[count:] - own)
    # Power of each harmonic is Re(q conj(v)), n > 0 counted twice: a common factor of
    # all terms, left out.
    driven = velocity[:, : load.shape[1]]
    given = (load * xp.conj(driven)).real
    taken = (force * xp.conj(system.deflections(velocity))).real.sum()
    taken = taken + (xp.asarray(system.damping)[:, None] * xp.abs(velocity) ** 2).sum()
    exchanged = (xp.abs(load) * xp.abs(driven)).sum()
    return (given.sum() - taken) / xp.where(exchanged > 0, exchanged, 1.0)


def force_defect(problem, active_meshes, nonlinear_force, computed):
    """Mean force in N by which the law at the computed deflection misses the one that
    balances the mean torques, over the largest root mean square of a tooth force: the
    largest of all meshes; 0 for a solution of the equations.

    nonlinear_force : coefficients ``(G, N+1)`` N of the active meshes with which the
    train was balanced; computed : Fields.
    """
    meshes = problem.meshes
    xp = namespace(problem, computed)
    balancing = -xp.asarray(active_meshes.flank) * backlash.offset(meshes.law)
    balancing = added(
        balancing, active_meshes.index, active_meshes.mask * nonlinear_force[:, 0].real
    )
    balancing = (
        balancing + meshes.law.linear_stiffness * computed.deflections[:, 0].real
    )
    missed = xp.max(xp.abs(computed.forces[:, 0].real - balancing), initial=0.0)
    size = xp.max(xp.linalg.norm(fourier.pack(computed.forces), axis=-1), initial=0.0)
    # Without a load all forces are rounding.
    driven = xp.any(problem.load != 0) & (size > 0)
    return xp.where(driven, missed / xp.where(driven, size, 1.0), 0.0)


def ring_force(problem, computed):
    """Mean force on a damper ring that no stiffness holds, over the root mean square of
    the dry friction on it, the largest of all; 0 for a motion that repeats, as nothing
    else takes that mean.

    Where dry friction slips longer one way than the other, such a ring creeps on its
    hub. computed : Fields.
    """
    system = problem.system
    meshes = problem.meshes
    xp = namespace(problem, computed)
    if not meshes.springs:
        return xp.zeros(())
    beside = computed.forces[-meshes.springs :]
    links = xp.asarray(meshes.link)[-meshes.springs :]
    loose = (system.tree.pinned & (xp.asarray(system.stiffness) == 0))[links]
    mean = xp.abs(beside[:, 0].real)
    size = xp.linalg.norm(fourier.pack(beside), axis=-1)
    return xp.max(
        xp.where(loose & (size > 0), mean / xp.where(size > 0, size, 1.0), 0.0)
    )


def held_in_contact(problem, deflections, flank, samples):
    """Whether every held mesh stays beyond the transition zone on its flank all
    cycle.
    """
    xp = namespace(problem, deflections)
    if xp is np and not np.any(flank):
        return np.array(True)
    values = fourier.synthesize(deflections, samples)
    margin = (
        xp.min(xp.asarray(flank)[:, None] * values, axis=-1) - problem.meshes.law.knee
    )
    return xp.all((xp.asarray(flank) == 0) | (margin >= 0))

"""The equations of one train at one speed, and the fields of its solution. Arrays in,
arrays out.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array, Number, added, namespace, remembered
from jaxhb.equations import (
    backlash,
    condensation,
    dynamic_stiffness,
    exact_integrals,
    fourier,
)
from jaxhb.equations.backlash import MeshParameters
from jaxhb.equations.block_sweep import quotient
from jaxhb.equations.condensation import CondensedEquation, CondensedTrain
from jaxhb.equations.reduced_model import ReducedOrderModel, reduced_model
from jaxhb.equations.residual import ForceBalance
from jaxhb.equations.system import System
from jaxhb.results.response import Fields
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import excitation, listed_harmonic, load_power_kW
from jaxhb.train.mesh_parameters import all_meshes
from jaxhb.train.varying import at_speed


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Problem:
    """A train at one speed: linear system, all its meshes, excitation.

    system : System; meshes : MeshParameters over all meshes (a mesh without backlash
    has epsilon 1, which makes its law linear); frequency : Omega in rad/s; load :
    complex ``(S, E+1)`` N, E the highest harmonic excited; rigid : ``(S,)``
    displacements of the rigid rotation; load_torque N m; load_power W.
    """

    system: System
    meshes: MeshParameters
    frequency: Array
    load: Array
    rigid: Array
    load_torque: Array
    load_power: Array

    def links(self, active_meshes: ActiveMeshes) -> Array:
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


def problem_at(train: DriveTrain, rpm: Number, excited: int) -> Problem:
    """The :class:`Problem` of ``train`` at ``rpm``, with room for ``excited`` harmonics
    of the excitation.
    """
    xp = namespace(train, rpm)
    train = at_speed(
        jax.tree.map(lambda leaf: xp.asarray(leaf, dtype=float), train), rpm
    )
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


@remembered
def _at_any_speed(train: DriveTrain) -> tuple[System, MeshParameters, Array]:
    """Linear system, meshes and rigid rotation of a train whose numbers are
    constants.
    """
    system = chain.assemble(train)
    return system, all_meshes(train), chain.rigid_shape(train, system.radius)


def reduced_equation(
    problem: Problem, harmonics: int, active_meshes: ActiveMeshes
) -> tuple[CondensedEquation, CondensedTrain]:
    """CondensedEquation and CondensedTrain of the active meshes; those that are not
    active are held on their flanks.
    """
    equation, condensed = linear_equation(problem, harmonics, active_meshes)
    return condensation.with_receptances(
        equation, condensed.system, condensed.columns
    ), condensed


def linear_equation(
    problem: Problem, harmonics: int, active_meshes: ActiveMeshes
) -> tuple[CondensedEquation, CondensedTrain]:
    """The pair of :func:`reduced_equation` without receptances; computed on the host
    where its numbers are there.
    """
    meshes = problem.meshes
    xp = namespace(problem, active_meshes)
    # Beyond the knee f = c l - offset sign(l): a mesh that stays on its flank is a
    # linear link with a constant force.
    constant = -xp.asarray(active_meshes.flank) * backlash.offset(meshes.law)
    load = _with_mean(
        xp.asarray(problem.load), -problem.system.spread(constant, meshes.link)
    )
    chosen = jax.tree.map(lambda leaf: xp.asarray(leaf)[active_meshes.index], meshes)
    return condensation.linear_motion(
        problem.system,
        problem.frequency,
        load,
        harmonics,
        meshes,
        chosen,
        active_meshes.mask,
    )


def _with_mean(coefficients: Array, mean: Array) -> Array:
    """Coefficients ``(S, N+1)`` with ``mean`` ``(S,)`` added to those of harmonic 0."""
    xp = namespace(coefficients, mean)
    return coefficients + xp.where(
        np.arange(coefficients.shape[-1]) == 0, mean[:, None], 0.0
    )


def force_balance(problem: Problem, harmonics: int, samples: int) -> ForceBalance:
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


def model_of(
    problem: Problem, active_meshes: ActiveMeshes, time_steps: int
) -> ReducedOrderModel:
    """The :class:`~jaxhb.equations.reduced_model.ReducedOrderModel` that so many time
    steps a cycle resolve, with the active meshes as its inputs.
    """
    links = problem.links(active_meshes)
    return reduced_model(
        problem.system, links, active_meshes.mask, problem.frequency, time_steps
    )


# Harmonics of the tooth forces per harmonic of the motion: as many as their time
# samples tell apart.
FORCE_HARMONICS = fourier.SAMPLES_PER_HARMONIC // 2


def fields(
    problem: Problem,
    displacement: Array,
    force: Array,
    integrals: str,
    samples: int,
    crossings: exact_integrals.Crossings | None = None,
) -> Fields:
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
    mesh_stiffness = complex_stiffness[links]
    deflections = force[links] / xp.where(mesh_stiffness == 0, 1.0, mesh_stiffness)
    end_radius = xp.asarray(system.radius)[system.tree.end_a][:, None]
    meshes_proper = len(links) - meshes.springs
    shafts = force.shape[0] - meshes_proper
    law = jax.tree.map(xp.asarray, meshes.law)
    rule = condensation.quadrature(integrals, law, deflections, samples, crossings)
    values, rates = fourier.each(
        rule.synthesize, deflections, fourier.derivative(deflections, problem.frequency)
    )
    sampled_law, viscous, contact_damping = backlash.at_samples(meshes, rule.synthesize)
    elastic = backlash.force(sampled_law, values)
    transmitted = backlash.mesh_force(
        sampled_law, viscous, contact_damping, values, rates
    )
    force_harmonics = FORCE_HARMONICS * harmonics - 1
    transmitted, elastic = fourier.each(
        lambda values: rule.analyze(values, force_harmonics), transmitted, elastic
    )
    torque = force
    if meshes.springs:
        # The force beside a shaft less that of the linear link in its place is added.
        springs = links[meshes_proper:]
        linear = law.linear[meshes_proper:, None] * deflections[meshes_proper:]
        torque, elastic_torque = (
            added(
                fourier.resize(link_force, force_harmonics),
                springs,
                mesh_force[meshes_proper:] - fourier.resize(linear, force_harmonics),
            )
            for link_force, mesh_force in (
                (torque, transmitted),
                (elastic_torque, elastic),
            )
        )
    return Fields(
        angles=chain.to_angles(system, displacement),
        torques=(torque * end_radius)[:shafts],
        elastic_torques=(elastic_torque * end_radius)[:shafts],
        deflections=deflections,
        forces=transmitted,
        elastic_forces=elastic,
    )


def power_defect(
    problem: Problem, displacement: Array, force: Array, computed: Fields
) -> Array:
    """Power of the torques less that taken by dampers, links and teeth, over the power
    that the torques exchange with the train.

    Zero for the exact motion and for every solution of the truncated equations, as
    elastic forces do no work over a cycle, ``sum of b |x'|^2 = <q, x'>`` (docs/theory
    A4.1): a rest comes from unsolved equations, and from the work that sampled elastic
    tooth forces seem to do. Those of a stiffness that varies, and against transmission
    errors, do work, and count.

    displacement ``(S, N+1)`` m; force ``(L, N+1)`` N of the linear links; computed :
    Fields.
    """
    system = problem.system
    harmonics = displacement.shape[-1] - 1
    xp = namespace(problem, computed, force)
    velocity = fourier.derivative(displacement, problem.frequency)
    load = fourier.resize(
        xp.asarray(problem.load), min(problem.load.shape[-1] - 1, harmonics)
    )
    does_work = problem.meshes.variation is not None or problem.meshes.error is not None
    tooth_forces = fourier.resize(
        computed.forces - (0.0 if does_work else computed.elastic_forces), harmonics
    )
    meshes_proper = len(tooth_forces) - problem.meshes.springs
    links = xp.asarray(problem.meshes.link)
    at_teeth = added(xp.zeros(len(force)), links[:meshes_proper], xp.asarray(1.0)) > 0
    force = added(
        xp.where(at_teeth[:, None], 0.0, force),
        links[:meshes_proper],
        tooth_forces[:meshes_proper],
    )
    if problem.meshes.springs:
        linear_force: Number = 0.0
        if does_work:
            linear = problem.meshes.law.linear
            assert linear is not None  # springs have it
            linear_force = (
                linear[meshes_proper:, None] * computed.deflections[meshes_proper:]
            )
        force = added(
            force, links[meshes_proper:], tooth_forces[meshes_proper:] - linear_force
        )
    # Power of each harmonic is Re(q conj(v)), n > 0 counted twice: a common factor of
    # all terms, left out.
    driven = velocity[:, : load.shape[1]]
    supplied = (load * xp.conj(driven)).real
    dissipated = (force * xp.conj(system.deflections(velocity))).real.sum()
    dissipated = (
        dissipated + (xp.asarray(system.damping)[:, None] * xp.abs(velocity) ** 2).sum()
    )
    exchanged = (xp.abs(load) * xp.abs(driven)).sum()
    return (supplied.sum() - dissipated) / xp.where(exchanged > 0, exchanged, 1.0)


def force_defect(
    problem: Problem,
    active_meshes: ActiveMeshes,
    nonlinear_force: Array,
    computed: Fields,
) -> Array:
    """Mean force by which the law at the computed deflection misses the one that
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
    is_driven = xp.any(problem.load != 0) & (size > 0)
    return xp.where(is_driven, missed / xp.where(is_driven, size, 1.0), 0.0)


def ring_force(problem: Problem, computed: Fields) -> Array:
    """Mean force on a damper ring that no stiffness holds, over the root mean square of
    the dry friction on it, the largest of all; 0 for a motion that repeats, as nothing
    else carries that mean.

    Where dry friction slips longer one way than the other, such a ring creeps on its
    hub. computed : Fields.
    """
    system = problem.system
    meshes = problem.meshes
    xp = namespace(problem, computed)
    if not meshes.springs:
        return xp.zeros(())
    spring_forces = computed.forces[-meshes.springs :]
    links = xp.asarray(meshes.link)[-meshes.springs :]
    is_loose = (system.tree.pinned & (xp.asarray(system.stiffness) == 0))[links]
    mean = xp.abs(spring_forces[:, 0].real)
    size = xp.linalg.norm(fourier.pack(spring_forces), axis=-1)
    return xp.max(
        xp.where(is_loose & (size > 0), mean / xp.where(size > 0, size, 1.0), 0.0)
    )


def held_in_contact(
    problem: Problem, deflections: Array, flank: Array, samples: int
) -> Array:
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

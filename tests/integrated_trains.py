"""Systems for the tests of time integration."""

from dataclasses import replace

import numpy as np

from jaxhb._jax import on_host
from jaxhb.elements.elements import Damper, Disk, Ground, Mesh, Shaft
from jaxhb.elements.excitations.torque import Torque
from jaxhb.equations import exact_integrals, fourier
from jaxhb.equations.backlash import Law, MeshParameters
from jaxhb.equations.block_sweep import slots
from jaxhb.equations.state_space import loss_damping, partition, state_space
from jaxhb.equations.system import System, Tree
from jaxhb.floquet.variational import monodromy
from jaxhb.train import chain
from jaxhb.train.assembly import build
from jaxhb.train.excitation import excitation, highest_harmonic
from jaxhb.train.mesh_parameters import law_meshes


def one_mass(*, mass, damping, stiffness, epsilon, transition, backlash):
    """A mass on a mesh whose other end is the ground (arm 0)."""
    first = np.zeros(1, np.int32)
    tree = Tree(
        node=first,
        parent=first + 1,
        slots=slots(first + 1),
        link=first,
        from_a=np.array([True]),
        loops=first[:0],
        end_a=first,
        end_b=first,
    )

    def single(value):
        return np.array([value], float)

    system = System(
        tree,
        radius=single(1),
        mass=single(mass),
        damping=single(damping),
        ground=single(0),
        stiffness=single(stiffness),
        viscous=single(0),
        loss=single(0),
        arm_a=single(1),
        arm_b=single(0),
        floating=np.array(False),
    )
    law = Law(
        single(stiffness),
        epsilon=single(epsilon),
        transition=single(transition),
        backlash=single(backlash),
    )
    return system, MeshParameters(first, law, np.zeros(1), np.array([False]))


def posed(train, rpm, harmonics=None):
    """System, backlash meshes, Omega and load of a train at a speed."""
    system = chain.assemble(train)
    torque, _, _ = excitation(train, rpm, harmonics or highest_harmonic(train))
    load = np.asarray(torque) / np.asarray(system.radius)[:, None]
    frequency = 2 * np.pi * rpm / 60 / train.topology.revolutions_per_cycle
    return system, law_meshes(train), frequency, load


def dense_monodromy(response):
    """The :class:`~jaxhb.floquet.variational.Monodromy` of a response, from the dense
    equation, arc by arc.
    """
    train = response.train
    system = on_host(chain.assemble(train))
    meshes = on_host(law_meshes(train))
    frequency = train.topology.cycle_frequency(float(response.rpm))
    space = state_space(
        system,
        meshes,
        frequency,
        partition(system, meshes, lossy=True),
        loss_damping(system),
    )
    deflection = np.asarray(response.deflections)[train.topology.law_index]
    times = exact_integrals.switching_times(meshes.law, deflection)
    if meshes.law.friction is not None:
        slip = replace(
            meshes.law,
            transition=0 * meshes.law.transition,
            backlash=2 * meshes.law.slip,
        )
        rates = fourier.derivative(deflection, frequency)
        times = np.concatenate([times, exact_integrals.switching_times(slip, rates)])
    return monodromy(space, meshes, deflection, frequency, times)


def pair(*, damping_law="contact", pinion=0.0, ground=True, backlash=2e-4, extra=()):
    """Two meshing gears with a flywheel and a ring; at 600 rpm the teeth hammer."""
    parts = [
        Disk(name="flywheel", inertia=2.0, damping=0.5),
        Disk(name="gear a", inertia=0.01, radius=0.05),
        Disk(name="gear b", inertia=0.03, radius=0.1, damping=pinion),
        Disk(name="driven", inertia=0.1, damping=1.0),
        Shaft(between=("flywheel", "gear a"), stiffness=2e4, damping=5.0),
        Shaft(between=("gear b", "driven"), stiffness=1e4, damping=4.0),
        Mesh(
            between=("gear a", "gear b"),
            stiffness=1e8,
            damping=1500.0,
            damping_law=damping_law,
            backlash=backlash,
            epsilon=1e-3 if backlash else None,
            transition=0.1 if backlash else None,
        ),
        Damper(name="ring", disk="flywheel", inertia=0.2, damping=20.0),
        Torque(
            disk="flywheel",
            mean=20.0,
            harmonics=[(1.0, 50.0, -20.0), (2.0, 10.0, 60.0), (3.0, 0.0, 40.0)],
        ),
        Torque(disk="driven", mean=-40.0, harmonics=[(1.0, 30.0, 10.0)]),
        *([Ground(disk="driven", stiffness=10.0)] if ground else []),
        *extra,
    ]
    return build(parts, revolutions_per_cycle=1, reference="flywheel", name="pair")

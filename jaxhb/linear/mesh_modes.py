"""Natural frequencies that strain tooth meshes, or shafts with stages: up to these the
motion has to be resolved.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from jaxhb._jax import Number, remembered
from jaxhb.linear.modal import natural_frequencies
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.mesh_parameters import all_meshes
from jaxhb.train.varying import at_speed

STRAINED = 0.05
"""Share of a mode's strain energy in tooth meshes from which the motion has to be
resolved to its frequency.
"""
WEAKLY_STRAINED = 0.01
"""The same from which an estimate of the truncation error has to see the mode: with
little damping it may resonate.
"""
MODAL_DISKS = 400  # disks up to which all modes are computed
# Factor by which the shafts of larger trains raise the frequencies of the gears alone
SHAFT_STIFFENING = 1.1


def mesh_mode_harmonics(train: DriveTrain, frequency: Number) -> np.ndarray:
    """Harmonics ``(2,)`` of the cycle at the highest modes whose share in meshes is
    STRAINED and WEAKLY_STRAINED.

    ``frequency`` is that of the cycle in rad/s, at whose speed the train is taken. Of a
    finely divided train, whose modes would take longer than its solve, both are the
    highest mode of the gears and meshes alone.
    """
    constant = at_speed(train, frequency / train.topology.cycle_frequency(1.0))
    return _mesh_modes_hz(constant) / (frequency / (2 * np.pi))


@remembered
def _mesh_modes_hz(train: DriveTrain) -> np.ndarray:
    """Frequencies ``(2,)`` in Hz of :func:`mesh_mode_harmonics`."""
    if train.topology.n_disks > MODAL_DISKS:
        return np.full(2, SHAFT_STIFFENING * _gear_mode_hz(train))
    modes = natural_frequencies(_engaged(train))
    links = sorted({link for link, *_ in train.topology.springs})
    share = modes.mesh_energy_share + modes.strain_share[:, links].sum(1)
    least_shares = (STRAINED, WEAKLY_STRAINED)
    return np.array(
        [
            np.max(modes.frequencies_hz[share > least], initial=0.0)
            for least in least_shares
        ]
    )


def _engaged(train: DriveTrain) -> DriveTrain:
    """The train with every stage and stop of its shafts and dampers in contact."""
    meshes = all_meshes(train)
    if not meshes.springs:
        return train
    system = chain.assemble(train)
    added = np.zeros(len(train.topology.link_names))
    np.add.at(
        added,
        meshes.link,
        np.where(meshes.law.linear == 0, np.maximum(meshes.law.stiffness, 0.0), 0.0),
    )
    added *= np.asarray(system.radius)[system.tree.end_a] ** 2
    shafts, dampers = np.split(
        added[: len(train.topology.shaft_and_damper_names)],
        [len(train.topology.shaft_names)],
    )

    def stiffened(table: Any, added: np.ndarray) -> Any:
        return replace(table, stiffness=table.stiffness + added)

    return replace(
        train,
        shafts=stiffened(train.shafts, shafts),
        dampers=stiffened(train.dampers, dampers),
    )


def _gear_mode_hz(train: DriveTrain) -> float:
    """Highest natural frequency in Hz of the gears on their meshes, all shafts left
    out.
    """
    system = chain.assemble(train)
    links = np.arange(
        len(system.stiffness) - len(train.topology.mesh_names), len(system.stiffness)
    )
    rows = system.incidence(links).T
    # Root of the largest eigenvalue of sqrt(c) D M^-1 D^T sqrt(c), a matrix of the
    # meshes.
    mass = np.maximum(system.mass, 1e-6 * np.mean(system.mass))
    root = np.sqrt(system.stiffness[links])
    squares = np.linalg.eigvalsh(root[:, None] * (rows / mass) @ rows.T * root)
    return np.sqrt(max(squares.max(initial=0.0), 0.0)) / (2 * np.pi)

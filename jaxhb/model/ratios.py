"""Numbers of a train that follow from its tables: speeds of the rotors, inertias of all disks."""

from __future__ import annotations

import numpy as np

from jaxhb._arrays import namespace


def speed_ratios(train):
    """Speed of each rotor over that of the reference rotor, from the pitch radii: r_a Omega_a = r_b Omega_b.

    Parameters
    ----------
    train : DriveTrain

    Returns
    -------
    array [n_rotors]
        Positive (each rotor has its own sense); 1 for the reference rotor.

    Examples
    --------
    >>> from jaxhb.model.drivetrain import speed_ratios
    >>> from jaxhb.model.scene import load_scene
    >>> train = load_scene("gear_train_30")
    >>> float(speed_ratios(train)[train.topology.rotor[train.topology.disk_index("cam A1")]])
    0.5
    """
    paths = train.topology.rotor_path
    depth = max((len(p) for p in paths), default=0)
    xp = namespace(train.disks.radius)
    if depth == 0:
        return xp.ones(train.topology.n_rotors)
    gear = paths[max(range(len(paths)), key=lambda k: len(paths[k]))][0][0]
    steps = np.array([[*p, *([(gear, gear)] * (depth - len(p)))] for p in paths])
    radius = xp.asarray(train.disks.radius)
    return xp.prod(radius[steps[..., 0]] / radius[steps[..., 1]], axis=1)


def inertias(train):
    """Inertia of every disk, the rings of the dampers last.

    Parameters
    ----------
    train : DriveTrain

    Returns
    -------
    array [n_disks]
        kg m2.

    Examples
    --------
    >>> from jaxhb.model.drivetrain import inertias
    >>> from jaxhb.model.scene import load_scene
    >>> inertias(load_scene("gear_train_30")).shape
    (27,)
    """
    inertia = train.disks.inertia, train.dampers.inertia
    return namespace(inertia).concatenate(inertia)

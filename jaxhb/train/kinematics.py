"""Numbers of a train that follow from its tables: speeds of the rotors, inertias of all
disks, and both referred to the reference rotor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jaxhb._jax import Array, namespace
from jaxhb._shown import brief
from jaxhb.train.tables import TrainArrays
from jaxhb.train.topology import Topology


def speed_ratios(train: TrainArrays) -> Array:
    """Speed ``[n_rotors]`` of each rotor over that of the reference rotor, from the
    pitch radii: r_a Omega_a = r_b Omega_b; positive, as each rotor has a sense of its
    own.
    """
    return rotor_ratios(train.topology, train.disks.radius)


def rotor_ratios(topology: Topology, radius: Array) -> Array:
    """Speed ratios ``(..., n_rotors)`` as :func:`speed_ratios`, of a topology with
    pitch radii ``(..., S)`` m.
    """
    paths = topology.rotor_path
    xp = namespace(radius)
    longest = max(paths, key=len, default=())
    radius = xp.asarray(radius)
    if not longest:
        return xp.ones((*radius.shape[:-1], topology.n_rotors))
    # Shorter paths are filled up by a gear over itself: disks that are no gears have
    # radius 0.
    gear = longest[0][0]
    filler = [(gear, gear)] * len(longest)
    steps = np.array([[*path, *filler[len(path) :]] for path in paths])
    return xp.prod(radius[..., steps[..., 0]] / radius[..., steps[..., 1]], axis=-1)


def displacement_radii(train: TrainArrays) -> Array:
    """Radius R ``(S,)`` m of every disk's rotor, x = R phi."""
    xp = namespace(train.disks.radius)
    topology = train.topology
    scene_disks = train.disks.radius.shape[0]
    first_gear: dict[int, int] = {}
    for ends in topology.mesh_ends:
        for disk in ends:
            first_gear.setdefault(topology.rotor[disk], disk)
    gear = np.array([first_gear.get(rotor, scene_disks) for rotor in topology.rotor])
    return xp.append(xp.asarray(train.disks.radius), 1.0)[gear]


def inertias(train: TrainArrays) -> Array:
    """Inertia ``[n_disks]`` kg m2 of every disk, the rings of the dampers last."""
    parts = (train.disks.inertia, train.dampers.inertia)
    return namespace(parts).concatenate(parts)


def tooth_damping_ratios(train: TrainArrays) -> Array:
    """Damping ratio ``[n_meshes]`` of the teeth of every mesh in contact, of its two
    gears alone, ``r / (2 sqrt(c m))``; nan where a gear has no inertia. The train may
    be traced.

    Along the pitch circle a gear has the mass ``J / r^2``, and two that are free
    otherwise vibrate against each other with ``m = m_a m_b / (m_a + m_b)``. Gears that
    stiff shafts couple to heavier parts have a smaller ratio
    (:func:`jaxhb.damping_ratios` has those of the modes).

    Examples
    --------
    >>> from jaxhb.scene.files import load_scene
    >>> tooth_damping_ratios(load_scene("gear_train_30")).round(3).tolist()
    [0.05, 0.05, 0.05, 0.05]
    """
    xp = namespace(train)
    meshes = train.meshes
    if not len(train.topology.mesh_ends):
        return xp.zeros(0)
    a, b = np.array(train.topology.mesh_ends).T
    # An infinite radius instead of 0 gives disks that are no gears no mass, and
    # derivatives no nan.
    mass = (
        xp.asarray(train.disks.inertia)
        / xp.where(train.disks.radius > 0, train.disks.radius, xp.inf) ** 2
    )
    heavy = mass[a] * mass[b] > 0
    reduced = xp.where(heavy, mass[a] * mass[b], 1.0) / xp.where(
        heavy, mass[a] + mass[b], 1.0
    )
    return xp.where(
        heavy, meshes.damping / (2.0 * xp.sqrt(meshes.stiffness * reduced)), xp.nan
    )


@brief
@dataclass(frozen=True)
class Referred:
    """Numbers of a train as they are and referred to the reference rotor; made by
    :func:`referred`.

    Loss factors are ratios and stay as they are.

    Parameters
    ----------
    disks : tuple of str, the S disks, rings of dampers last; links : tuple of str, the
    L links
    factor : ``(S,)`` i, speed of the disk over that of the reference rotor
    inertia, inertia_referred : ``(S,)`` kg m2, J and J i^2
    link_factor : ``(L,)`` i of the rotor of a shaft or damper, of a mesh i r of its
    first gear in m
    stiffness : ``(L,)`` N m/rad of shafts and dampers, N/m of meshes;
    stiffness_referred : ``(L,)`` N m/rad, k factor^2
    damping, damping_referred : ``(L,)`` the same in N m s/rad and N s/m
    order, order_referred : ``(D,)`` of the D dampers, of their own rotor and n i of the
    reference rotor; 0: not tuned
    """

    disks: tuple[str, ...]
    links: tuple[str, ...]
    factor: Array
    inertia: Array
    inertia_referred: Array
    link_factor: Array
    stiffness: Array
    stiffness_referred: Array
    damping: Array
    damping_referred: Array
    order: Array
    order_referred: Array


def referred(train: TrainArrays) -> Referred:
    """Inertias, stiffnesses and dampings as they are and referred to the reference
    rotor, ``J i^2``, ``k i^2``; the train may be traced.

    Angles referred to the reference rotor are ``phi / i``: energies stay the same when
    each inertia and each torsional stiffness is multiplied by i^2. The deflection of a
    mesh is ``i r (phi_a / i_a - phi_b / i_b)``, as ``i_a r_a = i_b r_b``, so that its
    stiffness c along the pitch circle becomes ``c (i r)^2``.

    Examples
    --------
    >>> from jaxhb.train.assembly import build
    >>> from jaxhb.elements.elements import Disk, Mesh
    >>> gears = [
    ...     Disk(name="slow", inertia=1.0, radius=0.2),
    ...     Disk(name="fast", inertia=0.5, radius=0.1),
    ... ]
    >>> numbers = referred(
    ...     build(
    ...         [*gears, Mesh(between=("slow", "fast"), stiffness=1e8)],
    ...         reference="slow",
    ...     )
    ... )
    >>> (
    ...     numbers.factor.tolist(),
    ...     numbers.inertia_referred.tolist(),
    ...     numbers.stiffness_referred.round(6).tolist(),
    ... )
    ([1.0, 2.0], [1.0, 2.0], [4000000.0])
    """
    topology = train.topology
    inertia = inertias(train)
    xp = namespace(train)
    factor = speed_ratios(train)[np.array(topology.rotor, dtype=int)]
    first = np.array([a for a, _ in topology.link_ends], dtype=int)
    meshes = np.arange(len(first)) >= len(first) - len(topology.mesh_names)
    radius = xp.concatenate([train.disks.radius, np.ones(len(topology.damper_names))])
    link_factor = factor[first] * xp.where(meshes, radius[first], 1.0)
    tables = (train.shafts, train.dampers, train.meshes)
    stiffness = xp.concatenate([table.stiffness for table in tables])
    damping = xp.concatenate([table.damping for table in tables])
    damper_disk = np.array(topology.damper_disk, dtype=int)
    return Referred(
        disks=topology.disk_names,
        links=topology.link_names,
        factor=factor,
        inertia=inertia,
        inertia_referred=inertia * factor**2,
        link_factor=link_factor,
        stiffness=stiffness,
        stiffness_referred=stiffness * link_factor**2,
        damping=damping,
        damping_referred=damping * link_factor**2,
        order=train.dampers.order,
        order_referred=train.dampers.order * factor[damper_disk],
    )

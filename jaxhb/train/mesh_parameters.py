"""Parameters of the meshes of a train for the equations, and of the springs that act
beside the stiffness of shafts and dampers.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np

from jaxhb._jax import Array, added, namespace
from jaxhb.elements.elements import OF_GEARS, OF_PERIOD
from jaxhb.equations.backlash import Law, MeshParameters
from jaxhb.train.kinematics import displacement_radii
from jaxhb.train.tables import Meshes, TrainArrays

# Share of a play in which stiffness sets in
SMOOTH = 0.04
# Share of the stiffness that is left in a play
LEFT = 1e-3
SLIP_SPEED = 0.1  # rad/s, from which dry friction is whole
# In m, gap of a mesh without backlash whose stiffness varies: its law has no kink there
NARROW = 1e-9


def law_of(meshes: Meshes) -> Law:
    """Make the :class:`Law` of the :class:`~jaxhb.train.tables.Meshes` of a train; of
    linear meshes it has no meaning.
    """
    return Law(meshes.stiffness, meshes.epsilon, meshes.transition, meshes.backlash)


def all_meshes(train: TrainArrays) -> MeshParameters:
    """Every mesh of a train as an entry of :class:`MeshParameters`, and the ``springs``
    of its topology. Meshes without backlash have epsilon 1; their gap is 1 m where
    their stiffness is constant, else one that is no measure of their motion.
    """
    xp = namespace(train)
    topology = train.topology
    meshes = train.meshes
    has_backlash = np.array(topology.mesh_backlash, dtype=bool)
    # A linear mesh has no gap to measure: it gets one that its law does not notice.
    linear_gap = np.where(topology.mesh_varies, NARROW, 1.0)
    law = Law(
        stiffness=xp.asarray(meshes.stiffness),
        epsilon=xp.where(has_backlash, meshes.epsilon, 1.0),
        transition=xp.where(has_backlash, meshes.transition, 0.5),
        backlash=xp.where(has_backlash, meshes.backlash, linear_gap),
    )
    parameters = MeshParameters(
        variation=_over_cycle(train, ["stiffness_orders"]),
        error=_over_cycle(train, [OF_PERIOD[1], *OF_GEARS]),
        link=np.arange(
            len(topology.link_names) - len(has_backlash),
            len(topology.link_names),
            dtype=np.int32,
        ),
        law=law,
        viscous=xp.asarray(meshes.damping),
        contact_damping=np.array(
            [name == "contact" for name in topology.mesh_damping_law], dtype=bool
        )
        & has_backlash,
    )
    return _with_springs(train, parameters) if topology.springs else parameters


def _with_springs(train: TrainArrays, meshes: MeshParameters) -> MeshParameters:
    """Append to the MeshParameters of meshes the springs that act beside the stiffness
    of shafts and dampers.
    """
    xp = namespace(train)
    topology = train.topology
    rows = []
    radius = displacement_radii(train)
    shafts = len(topology.shaft_names)
    for link, kind, number in topology.springs:
        is_shaft = link < shafts
        table = train.shafts if is_shaft else train.dampers
        index = link if is_shaft else link - shafts
        arm = radius[topology.link_ends[link][0]]
        stiffness = table.stiffness[index]
        values = {
            "stiffness": 0.0,
            "epsilon": 0.0,
            "transition": SMOOTH,
            "linear": 0.0,
            "side": 0.0,
            "friction": 0.0,
        }
        if kind == "friction":
            slip = 0.0 if table.slip_speed is None else table.slip_speed[index]
            values |= {
                "epsilon": 1.0,
                "backlash": NARROW,
                "friction": table.friction[index] / arm,
            }
            values |= {"slip": xp.where(slip > 0, slip, SLIP_SPEED) * arm}
        elif kind == "clearance":
            values |= {
                "epsilon": LEFT,
                "backlash": xp.deg2rad(table.clearance[index]) * arm,
            }
            values |= dict.fromkeys(("stiffness", "linear"), stiffness / arm**2)
        else:
            twist, beyond = getattr(table, kind)[index, number]
            before = 0.0
            if kind == "stages":
                before = table.stages[index, number - 1, 1] if number else stiffness
            values |= {
                "stiffness": (beyond - before) / arm**2,
                "backlash": 2 * xp.deg2rad(xp.abs(twist)) * arm,
            }
            values |= {"side": xp.sign(twist)} if kind == "stops" else {}
        rows.append({"slip": arm} | values)
    kinds = {kind for _, kind, _ in topology.springs}
    zeros = xp.zeros(len(meshes.link))

    def joined(of_meshes: Array, name: str) -> Array:
        of_springs = xp.stack([xp.asarray(row[name], float) for row in rows])
        return xp.concatenate([of_meshes, of_springs])

    law = Law(
        stiffness=joined(meshes.law.stiffness, "stiffness"),
        epsilon=joined(meshes.law.epsilon, "epsilon"),
        transition=joined(meshes.law.transition, "transition"),
        backlash=joined(meshes.law.backlash, "backlash"),
        linear=joined(meshes.law.stiffness, "linear"),
        side=joined(zeros, "side") if "stops" in kinds else None,
        friction=joined(zeros, "friction") if "friction" in kinds else None,
        slip=joined(zeros + 1.0, "slip") if "friction" in kinds else None,
    )

    def with_zeros(values: Array) -> Array:
        more = np.zeros((len(rows), *values.shape[1:]), values.dtype)
        return xp.concatenate([values, more])

    links = np.array([link for link, *_ in topology.springs], dtype=np.int32)
    return MeshParameters(
        link=np.concatenate([meshes.link, links]),
        law=law,
        viscous=with_zeros(meshes.viscous),
        contact_damping=with_zeros(meshes.contact_damping),
        variation=jax.tree.map(with_zeros, meshes.variation),
        error=jax.tree.map(with_zeros, meshes.error),
        springs=len(rows),
    )


def _over_cycle(train: TrainArrays, names: Sequence[str]) -> Array | None:
    """Complex coefficients ``(M, K+1)`` over the cycle of the sum of the named rows of
    the meshes, None without rows.
    """
    topology = train.topology
    meshes = train.meshes
    listed = {name: getattr(topology, f"mesh_{name}") for name in names}
    rows = [
        (name, mesh, column, order)
        for name in names
        for mesh, row in enumerate(listed[name])
        for column, order in enumerate(row)
    ]
    if not rows:
        return None
    xp = namespace(train)
    coefficients = xp.zeros(
        (len(topology.mesh_names), 1 + max(order for *_, order in rows)), dtype=complex
    )
    for name in names:
        places = [row[1:] for row in rows if row[0] == name]
        if not places:
            continue
        mesh, column, order = np.array(places).T
        value = xp.asarray(getattr(meshes, name))[mesh, column]
        value = 0.5 * (value[:, 0] + 1j * value[:, 1])
        if name in OF_PERIOD:
            value = value * xp.exp(
                1j
                * order
                / np.array(topology.mesh_periods)[mesh]
                * xp.deg2rad(meshes.phase)[mesh]
            )
        coefficients = added(coefficients, (mesh, order), value)
    return coefficients


def law_meshes(train: TrainArrays) -> MeshParameters:
    """The meshes that are no constant springs, in the order of the scene, as
    :class:`MeshParameters`.
    """
    index = train.topology.law_index
    return jax.tree.map(lambda array: array[index], all_meshes(train))

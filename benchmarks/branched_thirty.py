"""A branched train of 30 disks under 24 half orders of six cylinders, and its response
by dense matrices in numpy.
"""

import numpy as np

import jaxhb
from jaxhb.train import chain
from jaxhb.train.excitation import excitation

MESH = {"stiffness": 2e8, "damping": 500.0}
"""Teeth: the reference has rigid ones."""


def branched_thirty(data):
    """The train of ``branched_30_disk_linear.json``."""
    radius = {gear["node"]: 1e-3 * gear["R"] for gear in data["gears"]}
    parts = [
        jaxhb.Disk(
            name=str(d["node"]),
            inertia=d["J"],
            damping=d["c"],
            radius=radius.get(d["node"]),
        )
        for d in data["disks"]
    ]
    for s in data["shafts"]:
        parts.append(
            jaxhb.Shaft(
                between=(str(s["n1"]), str(s["n2"])), stiffness=s["k"], damping=s["c"]
            )
        )
    for gear in data["gears"]:
        if gear["parent"] is not None:
            parts.append(
                jaxhb.Mesh(between=(str(gear["parent"]), str(gear["node"])), **MESH)
            )
    for node, phase in zip(data["cyl_nodes"], data["phase_rad_per_order"], strict=True):
        waves = [
            (order, a * np.exp(1j * order * phase))
            for order, a in zip(data["orders"], data["amp_Nm"], strict=True)
        ]
        parts.append(
            jaxhb.Torque(
                disk=str(node),
                harmonics=[(order, w.real, w.imag) for order, w in waves],
            )
        )
    return jaxhb.build(
        parts, reference="0", revolutions_per_cycle=2, name="branched train of 30 disks"
    )


def numpy_angles(train, rpm, orders=24, refinements=0):
    """Angles ``(n, S, orders)`` by one batch of dense solves, refined with residuals in
    extended precision.
    """
    system = chain.assemble(train)
    D = system.incidence()
    K = (D * system.stiffness) @ D.T
    B = (D * system.viscous) @ D.T + np.diag(system.damping)
    omega = (
        train.topology.cycle_frequency(rpm)[:, None] * np.arange(1, orders + 1)
    ).ravel()[:, None, None]
    Z = K - omega**2 * np.diag(system.mass) + 1j * omega * B
    torque = np.asarray(excitation(train, float(rpm[0]), orders)[0])[
        :, 1:
    ]  # the same at all speeds
    load = np.tile((torque / system.radius[:, None]).T, (len(rpm), 1))
    moved = np.linalg.solve(Z, load[..., None])
    for _ in range(refinements):
        left = load[..., None] - Z.astype(np.clongdouble) @ moved.astype(np.clongdouble)
        moved = moved + np.linalg.solve(Z, left.astype(complex))
    moved = moved[..., 0] / system.radius
    return moved.reshape(len(rpm), orders, -1).transpose(0, 2, 1)

"""A drive train at one speed as plain arrays for time integrators: excitation as a
table, start, fastest rate.
"""

import dataclasses
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import eigsh

import jaxhb
from jaxhb.equations import backlash
from jaxhb.train import chain
from jaxhb.train.excitation import excitation, highest_harmonic
from jaxhb.train.mesh_parameters import all_meshes


class Model(NamedTuple):
    """A train as arrays in circumferential displacements, disks in elimination order.

    mass kg, damping N s/m, ground N/m ``(S,)``; chain_k N/m, chain_r N s/m ``(S,)`` of
    the shaft from each position to the next, 0 where there is none; shaft_a, shaft_b,
    shaft_k, shaft_r of the other shafts; mesh_a, mesh_b, arm_a, arm_b, mesh_k N/m,
    mesh_r N s/m, soft N/m, low, width m, gated ``(M,)``; pushed : disks with
    excitation.
    """

    mass: np.ndarray
    damping: np.ndarray
    ground: np.ndarray
    chain_k: np.ndarray
    chain_r: np.ndarray
    shaft_a: np.ndarray
    shaft_b: np.ndarray
    shaft_k: np.ndarray
    shaft_r: np.ndarray
    mesh_a: np.ndarray
    mesh_b: np.ndarray
    arm_a: np.ndarray
    arm_b: np.ndarray
    mesh_k: np.ndarray
    mesh_r: np.ndarray
    soft: np.ndarray
    low: np.ndarray
    width: np.ndarray
    gated: np.ndarray
    pushed: np.ndarray


@dataclass(frozen=True)
class Task:
    """One train at one speed, ready to be integrated.

    model : Model; law : of the meshes; frequency : Omega in rad/s; load : complex ``(E,
    N+1)`` N of the pushed disks; displacement m, velocity m/s ``(S,)`` : all teeth in
    contact, shifted onto their flanks, at t = 0; order : disk at each position; radius
    ``(S,)`` m of the positions; parent, link ``(S,)`` of the tree.
    """

    model: Model
    law: object
    frequency: float
    load: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    order: np.ndarray
    radius: np.ndarray
    parent: np.ndarray
    link: np.ndarray

    @property
    def period(self):
        """Cycle in s."""
        return 2 * np.pi / self.frequency

    def table(self, count, shift=0.0):
        """Excitation ``(count, E)`` N at the time samples ``(j + shift) period /
        count``.
        """
        n = np.arange(self.load.shape[1])
        if count < 2 * n.size:
            return np.ascontiguousarray(
                self.table(2 * count * n.size, 2 * shift * n.size)[:: 2 * n.size]
            )
        padded = np.zeros((self.load.shape[0], count // 2 + 1), dtype=complex)
        padded[:, : n.size] = self.load * np.exp(2j * np.pi * n * shift / count)
        return np.ascontiguousarray(np.fft.irfft(padded, n=count, norm="forward").T)

    def force(self, deflection):
        """Elastic tooth forces ``(M, steps)`` N of deflections ``(M, steps)`` m."""
        return np.asarray(backlash.force(self.law.expand(), deflection))

    def started(self, response):
        """The same task, starting at t = 0 of a response."""
        displacement, velocity = _instant(
            response, self.order, self.radius, self.frequency
        )
        return dataclasses.replace(self, displacement=displacement, velocity=velocity)


def prepare(train, rpm):
    """The :class:`Task` of a train, a tree without loss factors and massless disks and
    with one ground at most.
    """
    system = chain.assemble(train)
    meshes = all_meshes(train)
    tree = system.tree
    if (
        len(tree.loops)
        or np.any(system.loss)
        or np.any(system.mass == 0)
        or np.count_nonzero(system.ground) > 1
    ):
        raise ValueError(
            "closed loops, loss factors, massless disks and several grounds are not"
            " integrated"
        )
    order = np.asarray(tree.node)
    position = np.argsort(order)
    torque, _, _ = excitation(train, rpm, highest_harmonic(train))
    load = (torque / system.radius[:, None])[order]
    pushed = np.flatnonzero(np.abs(load).max(axis=1)).astype(np.uintp)
    law = meshes.law
    count = len(meshes.link)
    shafts = slice(None, len(tree.end_a) - count)
    teeth = slice(len(tree.end_a) - count, None)
    end_a = position[tree.end_a].astype(np.uintp)
    end_b = position[tree.end_b].astype(np.uintp)
    shaft_a = end_a[shafts]
    shaft_b = end_b[shafts]
    shaft_k = np.asarray(system.stiffness)[shafts]
    shaft_r = np.asarray(system.viscous)[shafts]
    near = np.abs(shaft_a.astype(int) - shaft_b.astype(int)) == 1
    chain_k, chain_r = np.zeros((2, order.size))
    chain_k[np.minimum(shaft_a, shaft_b)[near]] = shaft_k[near]
    chain_r[np.minimum(shaft_a, shaft_b)[near]] = shaft_r[near]
    model = Model(
        mass=system.mass[order],
        damping=system.damping[order],
        ground=system.ground[order],
        chain_k=chain_k,
        chain_r=chain_r,
        shaft_a=shaft_a[~near],
        shaft_b=shaft_b[~near],
        shaft_k=shaft_k[~near],
        shaft_r=shaft_r[~near],
        mesh_a=end_a[teeth],
        mesh_b=end_b[teeth],
        arm_a=system.arm_a[teeth],
        arm_b=system.arm_b[teeth],
        mesh_k=np.asarray(law.stiffness),
        mesh_r=np.asarray(meshes.viscous),
        soft=np.asarray(law.epsilon * law.stiffness),
        low=np.asarray(law.gap),
        width=np.asarray(law.width),
        gated=np.asarray(meshes.contact_damping),
        pushed=pushed,
    )
    frequency = float(train.topology.cycle_frequency(rpm))
    straight = jaxhb.linear_response(train, rpm=rpm)
    displacement, velocity = _instant(straight, order, system.radius[order], frequency)
    side = np.where(np.asarray(straight.deflections)[:, 0].real < 0, -1.0, 1.0)
    opening = np.zeros(len(tree.end_a))
    opening[teeth] = side * np.asarray(backlash.offset(law)) / model.mesh_k
    return Task(
        model=model,
        law=law,
        frequency=frequency,
        load=load[pushed],
        displacement=displacement + _opened(system, position, opening),
        velocity=velocity,
        order=order,
        radius=system.radius[order],
        parent=np.asarray(tree.parent, dtype=np.int64),
        link=np.asarray(tree.link, dtype=np.int64),
    )


def _instant(response, order, radius, frequency):
    """Displacements m and velocities m/s of the positions at t = 0 of a response."""
    c = np.asarray(response.angles)[order] * radius[:, None]
    rate = 1j * frequency * np.arange(c.shape[1]) * c
    return c[:, 0].real + 2 * c[:, 1:].real.sum(axis=1), 2 * rate.real.sum(axis=1)


def _opened(system, position, opening):
    """Displacements ``(S,)`` that give the links the deflections ``opening`` and leave
    the root where it is.
    """
    tree = system.tree
    moved = np.zeros(len(position))
    for s in range(len(position) - 2, -1, -1):
        link = tree.link[s]
        above = moved[tree.parent[s]]
        a = system.arm_a[link]
        b = system.arm_b[link]
        moved[s] = (
            (opening[link] + b * above) / a
            if tree.from_a[s]
            else (a * above - opening[link]) / b
        )
    return moved


def links(model):
    """All links as one list: ends a, b, arms a, b, stiffness N/m, damping N s/m, teeth
    in contact.
    """
    m = model
    near = np.arange(model.mass.size - 1)
    one = np.ones(near.size + m.shaft_k.size)
    return (
        np.concatenate([near, m.shaft_a, m.mesh_a]).astype(int),
        np.concatenate([near + 1, m.shaft_b, m.mesh_b]).astype(int),
        np.concatenate([one, m.arm_a]),
        np.concatenate([one, m.arm_b]),
        np.concatenate([m.chain_k[:-1], m.shaft_k, m.mesh_k]),
        np.concatenate([m.chain_r[:-1], m.shaft_r, m.mesh_r]),
    )


def fastest_rate(task):
    """Largest of the undamped natural frequencies and of the damping rates ``eig(M^-1
    B)``, rad/s, teeth in contact.
    """
    m = task.model
    size = task.model.mass.size
    a, b, arm_a, arm_b, stiffness, damping = links(m)
    root = 1 / np.sqrt(m.mass)
    rates = []
    for k, disk in ((stiffness, m.ground), (damping, m.damping)):
        values = [
            k * arm_a**2,
            k * arm_b**2,
            -k * arm_a * arm_b,
            -k * arm_a * arm_b,
            disk,
        ]
        rows = [a, b, a, b, np.arange(size)]
        columns = [a, b, b, a, np.arange(size)]
        entry = (
            np.concatenate(values),
            (np.concatenate(rows), np.concatenate(columns)),
        )
        matrix = (
            coo_array(entry, shape=(size, size))
            .tocsr()
            .multiply(root[:, None])
            .multiply(root[None, :])
        )
        rates.append(
            float(eigsh(matrix.tocsr(), k=1, return_eigenvectors=False, tol=1e-3)[0])
        )
    return max(np.sqrt(rates[0]), rates[1])

"""Phase diagrams of the firing: the vectors of the cylinders in every order, and their
sums, also weighted by the relative amplitudes of modes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jaxhb._jax import Array, namespace
from jaxhb.elements.excitations import EXCITATIONS
from jaxhb.elements.excitations.cylinder import CylinderSeats
from jaxhb.elements.sentences import SceneError
from jaxhb.linear.modal import Modes
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import turned

ALIKE = 1e-6  # distance of unit vectors up to which two orders have one phase diagram
# Sum over the number of cylinders from which an order is a major one
MAJOR = 1.0 - 1e-9


@dataclass(frozen=True, eq=False)
class VectorSums:
    """Vectors exp(i n angle) of the cylinders that fire, by order, and their sums.

    Attributes
    ----------
    cylinders : tuple of str ``(C,)``; firing_deg : array ``(C,)`` deg, of the own rotor
    orders : array ``(K,)``, of the reference rotor
    vectors : complex array ``(K, C)``, of length 1, or 0 of a cylinder whose torque has
        no such order; sums : complex array ``(K,)``
    modes : array ``(m,)`` of numbers; amplitudes : array ``(m, C)``, angle of the disk
        of each cylinder where the largest of the mode is 1
    mode_sums : complex array ``(m, K)``, sums of amplitudes times vectors
    """

    cylinders: tuple[str, ...]
    firing_deg: Array
    orders: np.ndarray
    vectors: Array
    sums: Array
    modes: np.ndarray
    amplitudes: Array
    mode_sums: Array

    def major(self) -> np.ndarray:
        """Whether each order ``(K,)`` is a major one, all vectors in one direction."""
        most = np.abs(self.vectors).sum(axis=1)
        return (np.abs(self.sums) >= MAJOR * most) & (most > 0)

    def diagrams(self) -> list[list[int]]:
        """Numbers of the orders that share a phase diagram, group after group."""
        groups: list[list[int]] = []
        vectors = np.asarray(self.vectors)
        for k, star in enumerate(vectors):
            same = (
                group
                for group in groups
                if np.abs(vectors[group[0]] - star).max() < ALIKE
            )
            group = next(same, None)
            if group is None:
                groups.append([k])
            else:
                group.append(k)
        return groups


def vector_sums(
    train: DriveTrain,
    *,
    orders: Sequence[float] | Array | None = None,
    modes: Modes | None = None,
    numbers: Sequence[int] | None = None,
) -> VectorSums:
    """Vector sums of the firing angles over the cylinders that fire.

    In order n of its own rotor a cylinder that fires at an angle has the vector
    exp(i n angle): all cylinders have the same torque but for it. A two-stroke beside a
    four-stroke has none in half orders. Its work in a mode is that vector times the
    angle of its disk. Phases of the train turn the vectors.

    Parameters
    ----------
    orders : of the reference rotor, multiples of that of the cycle; by default those of
        the gas torques
    modes : of :func:`jaxhb.natural_frequencies`; numbers : of those that count, by
        default all

    Raises
    ------
    SceneError : no cylinder fires, or an order is no harmonic of the cycle

    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> sums = jaxhb.vector_sums(train, orders=[1.0, 3.0])
    >>> abs(sums.sums).round(9)
    array([0., 6.])
    """
    topology = train.topology
    seats = topology.cylinders
    where = f"{topology.title}, vector_sums"
    firing = [i for i, fires in enumerate(seats.fires) if fires]
    if not firing:
        raise SceneError(
            f"{where}: no cylinder fires. Give cylinders, or let one fire."
        )
    revolutions = topology.revolutions_per_cycle
    if orders is None:
        rows = (seats.harmonics, seats.orders, seats.gas_rows())
        listed = {n for lists in rows for i in firing for n in lists[i]}
        harmonics = np.array(sorted(listed - {0}), dtype=int)
    else:
        in_cycles = np.asarray(orders, dtype=float) * revolutions
        harmonics = np.round(in_cycles).astype(int)
        odd = [n for n, whole in zip(in_cycles, harmonics, strict=True) if n != whole]
        if odd or (harmonics <= 0).any():
            raise SceneError(
                f"{where}: orders must be multiples of {1 / revolutions:g} above 0, the"
                " order of the cycle. Correct them."
            )
    xp = namespace(train)
    i = np.array(firing)
    turns = np.array(seats.turn)[i]
    place = list(EXCITATIONS).index("cylinder")
    members = [row[place] for row in topology.phase_members]
    delay = turned(
        train, members, np.tile(i, len(harmonics)), np.repeat(harmonics, len(i))
    )
    delay = xp.reshape(
        xp.ones(len(harmonics) * len(i)) * delay, (len(harmonics), len(i))
    )
    angle = xp.deg2rad(xp.asarray(train.cylinders.firing_angle)[i])
    has_order = harmonics[:, None] % _periods(seats)[i] == 0
    vectors = has_order * xp.exp(1j * (harmonics[:, None] / turns) * angle)
    vectors = vectors * xp.conj(delay)
    disks = np.array(seats.disk)[i]
    chosen = np.arange(0 if modes is None else len(modes.frequencies_hz))
    if numbers is not None:
        chosen = np.array(numbers, dtype=int)
    shapes = np.zeros((0, topology.n_disks)) if modes is None else modes.shapes[chosen]
    amplitudes = shapes[:, disks]
    return VectorSums(
        cylinders=tuple(seats.names[k] for k in firing),
        firing_deg=xp.rad2deg(angle),
        orders=harmonics / revolutions,
        vectors=vectors,
        sums=vectors.sum(axis=1),
        modes=chosen,
        amplitudes=amplitudes,
        mode_sums=amplitudes @ vectors.T,
    )


def _periods(seats: CylinderSeats) -> np.ndarray:
    """Harmonics of the cycle ``(C,)`` of which those of the gas torque of each cylinder
    are multiples.
    """
    listed = zip(seats.step, seats.harmonics, seats.orders, seats.turn, strict=True)
    return np.array(
        [
            step or math.gcd(*harmonics, *orders) or max(round(turn), 1)
            for step, harmonics, orders, turn in listed
        ]
    )

"""Excitation: the torques of all kinds of excitation and of loads as harmonics of the
cycle. Pure functions on arrays.

Coefficients are those of T(t) = sum_{n=-N..N} T^n exp(i n Omega t); an amplitude A in
Re(A exp(i n Omega t)) gives T^n = A/2. The number of operations does not grow with the
number of elements.

Torques may have lines at fixed frequencies beside these, with which no motion repeats
after a cycle. All that asks here for harmonics is refused such a train, unless it says
that it takes the lines, too (:func:`lines_at`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import lru_cache, partial

import numpy as np

from jaxhb._jax import Array, Number, added, namespace, on_host, remembered
from jaxhb.elements.elements import OF_GEARS, OF_PERIOD
from jaxhb.elements.excitations import EXCITATIONS
from jaxhb.elements.sentences import SceneError
from jaxhb.excitation.gas import FAR
from jaxhb.excitation.orders import add_rows, highest_rows
from jaxhb.train.kinematics import speed_ratios
from jaxhb.train.tables import Train, TrainArrays
from jaxhb.train.topology import Topology


def mean_torques(train: TrainArrays, rpm: Number) -> Array:
    """Mean torque of every excitation, kind after kind, N m [..., n] at ``rpm``
    [...].
    """
    means = [
        kind.means(numbers, seats, rpm) for kind, numbers, seats in train.excited()
    ]
    return namespace(means).concatenate(means, axis=-1)


def excited_disks(topology: Topology) -> list[int]:
    """Disk of every excitation, kind after kind."""
    return [disk for seats in topology.excitations for disk in seats.disk]


def mean_on_disks(train: TrainArrays, speeds: np.ndarray) -> np.ndarray:
    """Mean torque of all excitations ``(n, S)`` N m on every disk at some speeds
    ``(n,)`` rpm, without loads; of a train of the host.
    """
    topology = train.topology
    means = mean_torques(train, speeds)
    return on_disks(topology.n_disks, excited_disks(topology), means)


def on_disks(disks: int, seats: Sequence[int], torques: Array) -> np.ndarray:
    """Sum torques [..., n] that act on the disks ``seats`` [n]: [..., disks]."""
    total = np.zeros((*torques.shape[:-1], disks))
    places = np.array(seats, dtype=int)
    np.add.at(total, (..., places), torques)  # type: ignore[arg-type]
    return total


def speeds(train: TrainArrays) -> np.ndarray:
    """Speeds (rpm) at which torques have a point: of scales, loads, traces, charge
    pressures and rated speeds; [0] without any.
    """
    train = on_host(train)
    points = [
        np.ravel(rpm)
        for kind, numbers, _ in train.excited()
        for rpm in kind.speeds(numbers)
    ]
    distinct = np.unique(np.concatenate(points)) if points else np.zeros(0)
    # Points that fill up grids are no speeds.
    return distinct[distinct < FAR] if len(distinct) else np.zeros(1)


ANY_SPEED = 1000.0  # rpm, where a scene names none


def main_speed(train: TrainArrays) -> float:
    """Speed (rpm) of a scene: the rated one, else the highest at which it gives a
    torque.
    """
    return float(train.topology.rated_rpm or max(speeds(train)) or ANY_SPEED)


def _line_places(topology: Topology) -> list[tuple[str, int]]:
    """Name and disk of the element of every line, kind after kind."""
    return [
        (seats.names[i], seats.disk[i])
        for table, kind in EXCITATIONS.items()
        for seats in (topology.seats_of(table),)
        for i, _ in kind.line_places(seats)
    ]


def line_owners(topology: Topology) -> list[str]:
    """Name of the element of every line at a fixed frequency."""
    return [name for name, _ in _line_places(topology)]


def line_names(topology: Topology) -> list[str]:
    """Names of the elements that have lines at fixed frequencies, each once."""
    return list(dict.fromkeys(line_owners(topology)))


def line_disks(topology: Topology) -> np.ndarray:
    """Disk ``(L,)`` of every line at a fixed frequency."""
    return np.array([disk for _, disk in _line_places(topology)], dtype=int)


def lines_at(train: TrainArrays, rpm: Number) -> tuple[Array, Array]:
    """Frequency in Hz ``(L,)`` of every line, and its coefficient in N m ``(..., L)``
    at ``rpm`` ``(...)``, half the complex amplitude.
    """
    xp = namespace(train, rpm)
    speed = xp.asarray(rpm, dtype=float)
    lines = [
        kind.lines(numbers, seats, speed) for kind, numbers, seats in train.excited()
    ]
    hz = xp.concatenate([frequencies for frequencies, _ in lines])
    return hz, xp.concatenate([torque for _, torque in lines], axis=-1)


def line_torques(train: TrainArrays, rpm: Number) -> tuple[Array, Array]:
    """Frequency ``(L,)`` Hz of every line, and the coefficients ``(..., S, L)`` in N m
    on the disks at ``rpm`` ``(...)``; those of one frequency act together, as the
    first of them.
    """
    hz, coefficients = lines_at(train, rpm)
    xp = namespace(hz, coefficients)
    seats = np.eye(train.topology.n_disks)[:, line_disks(train.topology)]
    if not len(hz):
        return hz, seats * coefficients[..., None, :]
    first = xp.argmax(hz[:, None] == hz, axis=1)
    together = first[:, None] == np.arange(len(hz))
    return hz, (seats * coefficients[..., None, :]) @ (together + 0j)


def without_lines(train: Train) -> Train:
    """The same train without lines at fixed frequencies."""
    numbers = {}
    every_seats = []
    for table, (kind, own_numbers, seats) in zip(
        EXCITATIONS, train.excited(), strict=True
    ):
        numbers[table], without = kind.without_lines(own_numbers, seats)
        every_seats.append(without)
    topology = dataclasses.replace(train.topology, excitations=tuple(every_seats))
    return dataclasses.replace(train, topology=topology, excitations=numbers)


def refuse_lines(topology: Topology) -> None:
    """Refuse trains with lines at fixed frequencies, where a periodic motion is
    computed.
    """
    names = line_names(topology)
    if names:
        raise SceneError(
            f"{topology.title}: [[torque]] {names[0]!r} has lines at fixed frequencies,"
            " with which no motion repeats after a cycle. Take the linear answer"
            " (jaxhb.forced_response, jaxhb forced), march the motion"
            " (jaxhb.transient), or leave out its lines."
        )


def excitation(
    train: TrainArrays, rpm: Number, harmonics: int, *, beside_lines: bool = False
) -> tuple[Array, Array, Array]:
    """Torque in N m on every disk up to harmonic N of the cycle, complex [..., n_disks,
    N + 1], loads included; the mean torque of each load [..., n_loads]; and the
    imbalance left, sum over disks of speed ratio x mean torque; at speeds ``rpm``
    [...].

    The loads make the imbalance 0, each taking its share; their pulsation is in
    proportion to the torque that each takes. The angle 0 of the reference rotor is
    firing top dead centre of a cylinder with ``firing_angle`` 0; an event later by
    alpha of its own rotor multiplies by exp(-i order alpha). Of numbers of the host the
    arrays are read-only: they are cached, as plan and problem of one speed both need
    them.

    SceneError of a train with lines, unless ``beside_lines`` says that the caller needs
    the harmonics without them.
    """
    if not beside_lines:
        refuse_lines(train.topology)
    if namespace(train, rpm) is not np or np.size(rpm) != 1:
        return _excitation(train, rpm, harmonics)
    speed = np.asarray(rpm, dtype=float).item()
    torque, load_torque, imbalance = _cached_excitation(train, speed, harmonics)
    if not np.ndim(rpm):
        return torque, load_torque, imbalance
    shape = np.shape(rpm)
    return (
        np.broadcast_to(torque, (*shape, *np.shape(torque))),
        np.broadcast_to(load_torque, (*shape, *np.shape(load_torque))),
        np.broadcast_to(imbalance, (*shape, *np.shape(imbalance))),
    )


@remembered
def _cached_excitation(
    train: TrainArrays, rpm: float, harmonics: int
) -> tuple[Array, Array, Array]:
    """Remember :func:`_excitation` at a speed, as read-only arrays of the host."""
    torque, load_torque, imbalance = _excitation(train, rpm, harmonics)
    for values in (torque, load_torque):
        assert isinstance(values, np.ndarray)  # remembered are those of the host alone
        values.flags.writeable = False
    return torque, load_torque, imbalance


def _excitation(
    train: TrainArrays, rpm: Number, harmonics: int
) -> tuple[Array, Array, Array]:
    """Compute :func:`excitation` anew."""
    xp = namespace(train, rpm)
    topology = train.topology
    speed = xp.asarray(rpm, dtype=float)
    ratio = speed_ratios(train)[np.array(topology.rotor, dtype=int)]
    torque = xp.zeros((*speed.shape, topology.n_disks, harmonics + 1), dtype=complex)
    for k, (kind, numbers, seats) in enumerate(train.excited()):
        if not seats.disk:
            continue
        disks = np.array(seats.disk, dtype=int)
        means = kind.means(numbers, seats, speed)
        torque = added(torque, (..., disks, 0), means)
        turn = partial(turned, train, [row[k] for row in topology.phase_members])
        torque = kind.add_harmonics(torque, numbers, seats, speed, ratio[disks], turn)
    # Power of the mean torques over the speed of the reference rotor: torque x speed
    # ratio, summed.
    power = torque[..., 0].real @ ratio
    if not topology.load_disk:
        return torque, xp.zeros((*speed.shape, 0)), power
    share = xp.asarray(train.loads.share)
    load_disk = np.array(topology.load_disk, dtype=int)
    # Each load takes its share of torque, and all together the power: sum of ratio x
    # load torque = -power.
    load_torque = -power[..., None] * share / (share @ ratio[load_disk])
    torque = added(torque, (..., load_disk, 0), load_torque)
    rows = train.loads.harmonics
    if rows is not None:
        torque = add_rows(torque, load_disk, topology.load_harmonics, rows, load_torque)
    return torque, load_torque, torque[..., 0].real @ ratio


def turned(
    train: TrainArrays, members: Sequence[Sequence[int]], i: np.ndarray, n: np.ndarray
) -> Number:
    """Factor exp(-i n alpha / turn) of elements i at harmonics n of the cycle, over all
    phases of which they are members.
    """
    if not members:
        return 1.0
    assert train.phases is not None  # there are members
    xp = namespace(train.phases)
    angle = train.phases.angle
    is_member = np.array([np.isin(i, row) for row in members])
    turns = is_member * n / np.array(train.topology.phase_turn)[:, None]
    return xp.exp(-1j * (xp.deg2rad(angle) @ turns))


def load_power_kW(train: TrainArrays, rpm: Number, load_torque: Array) -> Array:  # noqa: N802
    """Power in kW that loads of ``load_torque`` [n_loads] N m take: -sum_j
    load_torque_j x ratio_j x 2 pi rpm / 60.
    """
    load_disk = np.array(train.topology.load_disk, dtype=int)
    rotor = np.array(train.topology.rotor, dtype=int)[load_disk]
    at_reference = load_torque @ speed_ratios(train)[rotor]
    return -at_reference * (2.0 * np.pi / 60.0 / 1000.0) * rpm


def highest_harmonic(train: TrainArrays, *, beside_lines: bool = False) -> int:
    """Largest harmonic n >= 1 of the cycle that the excitation holds to an extent that
    counts. Host: concrete values.

    Counted are all harmonics that have an amplitude, those of meshes too, inertia
    torques up to order 6 of their own rotor, and of computed gas torques those above
    1e-6 of the largest, always within the cylinder's ``orders``. Lines as in
    :func:`excitation`.
    """
    if not beside_lines:
        refuse_lines(train.topology)
    topology = train.topology
    harmonics = [1]
    for kind, numbers, seats in train.excited():
        harmonics += kind.highest(numbers, seats)
    harmonics += highest_rows(topology.load_harmonics, train.loads.harmonics)
    for name in (*OF_PERIOD, *OF_GEARS):
        rows = getattr(topology, f"mesh_{name}")
        harmonics += highest_rows(rows, getattr(train.meshes, name))
    return int(max(harmonics))


@lru_cache(maxsize=256)
def listed_harmonic(topology: Topology, *, beside_lines: bool = False) -> int:
    """Largest harmonic n >= 1 of the cycle that the excitation can have, whatever the
    numbers of the train are.

    Amplitudes of 0 and cylinders that misfire count like the others: with so many
    :func:`excitation` drops nothing. Lines as there.
    """
    if not beside_lines:
        refuse_lines(topology)
    listed = [row for seats in topology.excitations for row in seats.listed()]
    listed += topology.load_harmonics
    for name in (*OF_PERIOD, *OF_GEARS):
        listed += getattr(topology, f"mesh_{name}")
    return int(max([1, *(n for row in listed for n in row)]))

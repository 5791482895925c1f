"""Excitation: the torque of cylinders, prescribed torques and loads as harmonics of the
cycle. Pure functions on arrays.

A cylinder's gas torque is T = gas_factor (scale(rpm) p - p_ambient) A x'(a), its
inertia torque at constant speed w of its own rotor T = -m x'(a) x''(a) w^2, with the
travel x from top dead centre (:func:`~jaxhb.excitation.crank.slider_crank`). Without
injection p is that of compression alone; a prescribed gas torque, of which this is not
known, is then 0. The scale over rpm multiplies gas torques and prescribed torques,
never inertia torques. The pressure p is a sum of functions of the angle, weighted by
speed and load (:mod:`jaxhb.excitation.gas`). Coefficients are those of T(t) =
sum_{n=-N..N} T^n exp(i n Omega t); an amplitude A in Re(A exp(i n Omega t)) gives T^n =
A/2. The number of operations does not grow with the number of elements.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache

import numpy as np

from jaxhb._jax import Array, Number, added, namespace, remembered
from jaxhb.elements.elements import OF_GEARS, OF_PERIOD
from jaxhb.excitation.crank import CRANK_SAMPLES
from jaxhb.excitation.cylinder_harmonics import (
    harmonic_weights,
    pressure_harmonics,
    unit_inertia_harmonics,
)
from jaxhb.excitation.gas import injection
from jaxhb.excitation.mean_torques import mean_torques, scale_at
from jaxhb.train.kinematics import speed_ratios
from jaxhb.train.tables import TrainArrays
from jaxhb.train.topology import Topology

INERTIA_ORDERS_THAT_COUNT = 6
"""Orders of the inertia torque per revolution of its own rotor: the next is 0.04 % of
the largest.
"""

# Share of the largest harmonic of a computed gas torque below which one does not count
NEGLIGIBLE_GAS = 1e-6


def _computed_gas(train: TrainArrays) -> tuple:
    """Cylinders whose gas torque is computed, and their :func:`pressure_harmonics`,
    also of the ambient pressure.
    """
    cycles = train.topology.gas_cycles
    rows = tuple(i for i, computed in enumerate(cycles.computed) if computed)
    if not rows:
        return rows, None, None
    harmonics, ambient = pressure_harmonics(train.cylinders, rows, cycles)
    return rows, harmonics, ambient


def excitation(
    train: TrainArrays, rpm: Number, harmonics: int
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
    """
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
    seats = np.array([*topology.torque_disk, *topology.cylinder_disk], dtype=int)
    means = mean_torques(train.torques, train.cylinders, topology.gas_cycles, speed)
    torque = added(torque, (..., seats, 0), means)
    scale = scale_at(train.torques, speed)
    torque_rows = train.torques.harmonics

    def prescribed(i: np.ndarray, k: np.ndarray, n: np.ndarray) -> Array:
        return (
            scale[..., i]
            * _coefficients(torque_rows, i, k)
            * _turned(train, topology.phase_torques, i, n)
        )

    torque = _add_listed(
        torque, topology.torque_disk, topology.torque_harmonics, prescribed
    )
    if topology.cylinder_names:
        torque = _add_cylinders(torque, train, speed, ratio)
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
        torque = _add_rows(
            torque, load_disk, topology.load_harmonics, rows, load_torque
        )
    return torque, load_torque, torque[..., 0].real @ ratio


def _add_cylinders(
    torque: Array, train: TrainArrays, rpm: Array, ratio: Array
) -> Array:
    """Add the harmonics of the gas torques, prescribed and computed, and of the
    reciprocating masses.
    """
    topology = train.topology
    table = train.cylinders
    disks = topology.cylinder_disk
    scale = scale_at(table, rpm)
    factor = table.gas_factor if table.gas_factor is not None else np.ones(len(disks))
    cycles = topology.gas_cycles
    injected = injection(table, cycles)

    def phase(i: np.ndarray, n: np.ndarray) -> Array:
        """Factor exp(-i order alpha) of cylinder i at harmonic n of the cycle; order in
        revolutions of its own rotor.
        """
        order = n / np.array(topology.cylinder_turn)[i]
        xp = namespace(table.firing_angle)
        turned = xp.exp(-1j * order * xp.deg2rad(table.firing_angle)[i])
        return turned * _turned(train, topology.phase_cylinders, i, n)

    def prescribed(i: np.ndarray, k: np.ndarray, n: np.ndarray) -> Array:
        return (
            factor[i]
            * injected[i]
            * (scale[..., i] * _coefficients(table.gas_torque, i, k))
            * phase(i, n)
        )

    lists = [
        row if counts else ()
        for row, counts in zip(
            topology.cylinder_harmonics, cycles.prescribed, strict=True
        )
    ]
    torque = _add_listed(torque, disks, lists, prescribed)
    rows, parts, ambient = _computed_gas(train)

    def computed(i: np.ndarray, k: np.ndarray, n: np.ndarray) -> Array:
        row = np.searchsorted(rows, i)
        weighted = harmonic_weights(table, cycles, rpm)[..., i] * parts[:, row, k + 1]
        gas = weighted.sum(axis=-2)
        return factor[i] * (scale[..., i] * gas - ambient[row, k + 1]) * phase(i, n)

    steps = zip(topology.cylinder_step, topology.cylinder_gas, strict=True)
    lists = [
        tuple(step * k for k in range(1, count + 1)) if i in rows else ()
        for i, (step, count) in enumerate(steps)
    ]
    torque = _add_listed(torque, disks, lists, computed)

    def inertia(i: np.ndarray, k: np.ndarray, n: np.ndarray) -> Array:
        disk = np.array(disks, dtype=int)
        speed = ratio[disk] * (2.0 * np.pi / 60.0) * rpm[..., None]
        unit = unit_inertia_harmonics(table, topology.cylinder_series)
        of_mass = (table.reciprocating_mass * speed**2)[..., i]
        return of_mass * unit[i, k + 1] * phase(i, n)

    turns = zip(topology.cylinder_inertia, topology.cylinder_turn, strict=True)
    lists = [
        tuple(round(j * turn) for j in range(1, min(count, CRANK_SAMPLES // 2) + 1))
        for count, turn in turns
    ]
    return _add_listed(torque, disks, lists, inertia)


def _turned(
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


def _add_listed(
    torque: Array,
    disks: Sequence[int] | np.ndarray,
    numbers: Iterable[tuple[int, ...]],
    values: Callable[[np.ndarray, np.ndarray, np.ndarray], Array],
) -> Array:
    """Add ``values(i, k, n)`` of elements i on ``disks`` at their harmonics n =
    ``numbers[i][k]`` up to N.
    """
    i, k, n = _listed(tuple(numbers), torque.shape[-1] - 1)
    if not i.size:
        return torque
    return added(torque, (..., np.array(disks, dtype=int)[i], n), values(i, k, n))


@lru_cache(maxsize=256)
def _listed(numbers: tuple[tuple[int, ...], ...], most: int) -> np.ndarray:
    """Elements i, places k and harmonics n = ``numbers[i][k]`` up to ``most``."""
    flat = [
        (i, k, n)
        for i, row in enumerate(numbers)
        for k, n in enumerate(row)
        if n <= most
    ]
    return np.array(flat, dtype=int).reshape(-1, 3).T


def _add_rows(
    torque: Array,
    disks: Sequence[int] | np.ndarray,
    numbers: Iterable[tuple[int, ...]],
    rows: Array,
    factor: Array,
) -> Array:
    """Add harmonics of elements, from their rows of amplitudes, each times
    its factor.
    """
    return _add_listed(
        torque,
        disks,
        numbers,
        lambda i, k, n: factor[..., i] * _coefficients(rows, i, k),
    )


def _coefficients(rows: Array, i: np.ndarray, k: np.ndarray) -> Array:
    """Coefficients T^n of rows (Re, Im) of peak amplitudes."""
    pair = rows[i, k]
    return 0.5 * (pair[:, 0] + 1j * pair[:, 1])


def load_power_kW(train: TrainArrays, rpm: Number, load_torque: Array) -> Array:  # noqa: N802
    """Power in kW that loads of ``load_torque`` [n_loads] N m take: -sum_j
    load_torque_j x ratio_j x 2 pi rpm / 60.
    """
    load_disk = np.array(train.topology.load_disk, dtype=int)
    rotor = np.array(train.topology.rotor, dtype=int)[load_disk]
    at_reference = load_torque @ speed_ratios(train)[rotor]
    return -at_reference * (2.0 * np.pi / 60.0 / 1000.0) * rpm


def highest_harmonic(train: TrainArrays) -> int:
    """Largest harmonic n >= 1 of the cycle that the excitation holds to an extent that
    counts. Host: concrete values.

    Counted are all harmonics that have an amplitude, those of meshes too, inertia
    torques up to order 6 of their own rotor, and of computed gas torques those above
    1e-6 of the largest, always within the cylinder's ``orders``.
    """
    topology = train.topology
    harmonics = [1]
    rows_of = [
        (topology.torque_harmonics, train.torques.harmonics),
        (topology.cylinder_harmonics, train.cylinders.gas_torque),
    ]
    optional = [
        (f"mesh_{name}", getattr(train.meshes, name))
        for name in (*OF_PERIOD, *OF_GEARS)
    ]
    optional.append(("load_harmonics", train.loads.harmonics))
    rows_of += [
        (getattr(topology, name), values)
        for name, values in optional
        if values is not None
    ]
    for numbers, values in rows_of:
        present = (np.asarray(values) != 0.0).any(axis=-1).tolist()
        for row, counts in zip(numbers, present, strict=True):
            harmonics += [n for n, there in zip(row, counts, strict=False) if there]
    mass = np.asarray(train.cylinders.reciprocating_mass)
    inertia = zip(topology.cylinder_inertia, topology.cylinder_turn, strict=True)
    for i, (orders, turn) in enumerate(inertia):
        if orders and mass[i] > 0.0:
            harmonics.append(round(min(orders, INERTIA_ORDERS_THAT_COUNT) * turn))
    cylinders, gas, _ = _computed_gas(train)
    sizes = np.abs(np.asarray(gas)).max(axis=0) if cylinders else ()
    for i, size in zip(cylinders, sizes, strict=True):
        size = size[1 : topology.cylinder_gas[i] + 1]
        least = NEGLIGIBLE_GAS * max(size.max(initial=0.0), 1e-300)
        counts = np.flatnonzero(size > least)
        harmonics += [(k + 1) * topology.cylinder_step[i] for k in counts.tolist()]
    return int(max(harmonics))


@lru_cache(maxsize=256)
def listed_harmonic(topology: Topology) -> int:
    """Largest harmonic n >= 1 of the cycle that the excitation can have, whatever the
    numbers of the train are.

    Amplitudes of 0 and cylinders that misfire count like the others: with so many
    :func:`excitation` drops nothing.
    """
    listed = (
        *topology.torque_harmonics,
        *topology.cylinder_harmonics,
        *topology.load_harmonics,
    )
    listed += tuple(
        row
        for name in (*OF_PERIOD, *OF_GEARS)
        for row in getattr(topology, f"mesh_{name}")
    )
    harmonics = [1, *(n for row in listed for n in row)]
    gas = zip(topology.cylinder_gas, topology.cylinder_step, strict=True)
    harmonics += [count * step for count, step in gas]
    inertia = zip(topology.cylinder_inertia, topology.cylinder_turn, strict=True)
    harmonics += [round(orders * turn) for orders, turn in inertia]
    return int(max(harmonics))

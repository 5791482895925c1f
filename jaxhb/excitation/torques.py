"""Excitation: the torque of cylinders, given torques and loads as harmonics of the
cycle. Pure functions on arrays.

A cylinder's gas torque is T = gas_factor (scale(rpm) p - p_ambient) A x'(a), its
inertia torque at constant speed w of its own rotor T = -m x'(a) x''(a) w^2, with the
travel x from top dead centre (:func:`~jaxhb.excitation.crank.slider_crank`). Without
injection p is that of compression alone; a given gas torque, of which this cannot be
told, is then 0. The scale over rpm multiplies gas torques and given torques, never
inertia torques. The pressure p is a sum of functions of the angle, weighted by speed
and load (:mod:`jaxhb.excitation.gas`). Coefficients are those of T(t) = sum_{n=-N..N}
T^n exp(i n Omega t); an amplitude A in Re(A exp(i n Omega t)) gives T^n = A/2. The
number of operations does not grow with the number of elements.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from jaxhb._jax import added, kept, namespace
from jaxhb.equations import fourier
from jaxhb.equations.kinematics import OF_GEARS, OF_PERIOD, speed_ratios
from jaxhb.excitation.crank import CRANK_SAMPLES, gas_torque, inertia_torque
from jaxhb.excitation.gas import components, injection, unburnt_weights, weights
from jaxhb.excitation.mean_torques import mean_torques, scale_at

if TYPE_CHECKING:
    from jaxhb.train.drivetrain import DriveTrain
    from jaxhb.train.topology import Topology

INERTIA_ORDERS_THAT_COUNT = 6
"""Orders of the inertia torque per revolution of its own rotor: the next is 0.04 % of
the largest.
"""

# Share of the largest harmonic of a computed gas torque below which one does not count
NEGLIGIBLE_GAS = 1e-6


@kept
def _pressure_harmonics(table, rows, cycles):
    """Harmonics of the gas cycle of p A x' [J, n, K], one for each component of p, and
    of p_ambient A x' [n, K].

    ``rows`` are the n cylinders of the table.
    """
    revolutions = np.array([cycles.revolutions[i] for i in rows])
    xp = namespace(table)
    rows = np.array(rows, dtype=int)
    given = (table.ambient_pressure, table.bore, table.stroke, table.rod)
    pressure = xp.asarray(components(table, cycles))[:, rows]
    ambient, *geometry = (xp.asarray(values)[rows] for values in given)
    all_of = xp.concatenate(
        [pressure, xp.broadcast_to(ambient[None, :, None], (1, *pressure.shape[1:]))]
    )
    torque = gas_torque(all_of, *geometry, revolutions=revolutions)
    if cycles.skipping:
        return _over_several_cycles(
            torque[:-1], torque[-1], [cycles.every[i] for i in rows]
        )
    harmonics = fourier.analyze(torque, torque.shape[-1] // 2)
    return harmonics[:-1], harmonics[-1]


def _over_several_cycles(torque, ambient, every):
    """The same of cylinders that are injected in one of ``every`` [n] gas cycles:
    harmonics of all these cycles.

    Components [J, n, M] hold in the gas cycle round the injection; those without
    injection, the second half of them but for the heat, hold in the others too, and
    follow once more with that part.
    """
    xp = namespace(torque)
    samples = torque.shape[-1]
    half = samples // 2
    found = []
    order = []
    for cycles in sorted(set(every)):
        rows = np.flatnonzero(np.array(every) == cycles)
        between = xp.zeros((*torque[:, rows].shape[:-1], (cycles - 1) * samples))
        with_injection = xp.concatenate(
            [torque[:, rows, :half], between, torque[:, rows, half:]], axis=-1
        )
        turned = xp.roll(torque[:, rows], -half, axis=-1)
        others = (
            xp.concatenate([turned] * (cycles - 1), axis=-1) if cycles > 1 else between
        )
        none = xp.zeros((*others.shape[:-1], half))
        without = xp.concatenate([none, others, none], axis=-1)
        outside = xp.concatenate([ambient[None, rows]] * cycles, axis=-1)
        found.append(
            fourier.analyze(xp.concatenate([with_injection, without, outside]), half)
        )
        order.append(rows)
    harmonics = xp.concatenate(found, axis=1)[:, np.argsort(np.concatenate(order))]
    return harmonics[:-1], harmonics[-1]


@kept
def _unit_inertia_harmonics(table, short_series):
    """Harmonics [..., 257] of the torque of 1 kg at 1 rad/s over a revolution of each
    cylinder's crank, m2.
    """
    torque = inertia_torque(
        table.stroke, table.rod, short_series=np.array(short_series)
    )
    return fourier.analyze(torque, CRANK_SAMPLES // 2)


def _computed_gas(train):
    """Cylinders whose gas torque is computed, and its :func:`_pressure_harmonics`, of
    the ambient pressure as well.
    """
    cycles = train.topology.gas_cycles
    rows = tuple(i for i, computed in enumerate(cycles.computed) if computed)
    return (
        (rows, *_pressure_harmonics(train.cylinders, rows, cycles))
        if rows
        else (rows, None, None)
    )


def excitation(train: DriveTrain, rpm, harmonics: int):
    """Torque in N m on every disk up to harmonic N of the cycle, complex [..., n_disks,
    N + 1], loads included; the mean torque of each load [..., n_loads]; and the
    imbalance left, sum over disks of speed ratio x mean torque; at speeds ``rpm``
    [...].

    The loads make the imbalance 0, each taking its share; their pulsation is in
    proportion to the torque that each takes. The angle 0 of the reference rotor is
    firing top dead centre of a cylinder with ``firing_angle`` 0; an event later by
    alpha of its own rotor multiplies by exp(-i order alpha). Of numbers of the host the
    arrays are read-only: who asks again, as plan and problem of one speed do, has the
    same.
    """
    if namespace(train, rpm) is not np or np.size(rpm) != 1:
        return _excitation(train, rpm, harmonics)
    found = _kept_excitation(train, np.asarray(rpm, dtype=float).item(), harmonics)
    return (
        tuple(
            np.broadcast_to(values, (*np.shape(rpm), *np.shape(values)))
            for values in found
        )
        if np.ndim(rpm)
        else found
    )


@kept
def _kept_excitation(train, rpm, harmonics):
    found = _excitation(train, rpm, harmonics)
    for values in found[:2]:
        values.flags.writeable = False
    return found


def _excitation(train, rpm, harmonics):
    """What :func:`excitation` gives, anew."""
    xp = namespace(train, rpm)
    topology = train.topology
    rpm = xp.asarray(rpm, dtype=float)
    ratio = speed_ratios(train)[np.array(topology.rotor, dtype=int)]
    torque = xp.zeros((*rpm.shape, topology.n_disks, harmonics + 1), dtype=complex)
    seats = np.array([*topology.torque_disk, *topology.cylinder_disk], dtype=int)
    means = mean_torques(train.torques, train.cylinders, topology.gas_cycles, rpm)
    torque = added(torque, (..., seats, 0), means)
    own = (topology.torque_disk, topology.torque_harmonics)
    scale = scale_at(train.torques, rpm)
    rows = train.torques.harmonics

    def later(i, k, n):
        return (
            scale[..., i]
            * _coefficients(rows, i, k)
            * _turned(train, topology.phase_torques, i, n)
        )

    torque = _add_listed(torque, *own, later)
    if topology.cylinder_names:
        torque = _add_cylinders(torque, train, rpm, ratio)
    # Power of the mean torques over the speed of the reference rotor: torque x speed
    # ratio, summed.
    power = torque[..., 0].real @ ratio
    if not topology.load_disk:
        return torque, xp.zeros((*rpm.shape, 0)), power
    share = xp.asarray(train.loads.share)
    load_disk = np.array(topology.load_disk, dtype=int)
    # Each load takes its share of torque, and all together the power: sum of ratio x
    # load torque = -power.
    load_torque = -power[..., None] * share / (share @ ratio[load_disk])
    torque = added(torque, (..., load_disk, 0), load_torque)
    torque = _add_given(
        torque, load_disk, topology.load_harmonics, train.loads.harmonics, load_torque
    )
    return torque, load_torque, torque[..., 0].real @ ratio


def _add_cylinders(torque, train, rpm, ratio):
    """Add the harmonics of the gas torques, given and computed, and of the
    reciprocating masses.
    """
    topology, table, disks = (
        train.topology,
        train.cylinders,
        train.topology.cylinder_disk,
    )
    scale = scale_at(table, rpm)
    factor = table.gas_factor if table.gas_factor is not None else np.ones(len(disks))
    cycles = topology.gas_cycles
    injected = injection(table, cycles)

    def phase(i, n):
        """exp(-i order alpha) of cylinder i at harmonic n of the cycle; order in
        revolutions of its own rotor.
        """
        order = n / np.array(topology.cylinder_turn)[i]
        xp = namespace(table.firing_angle)
        turned = xp.exp(-1j * order * xp.deg2rad(table.firing_angle)[i])
        return turned * _turned(train, topology.phase_cylinders, i, n)

    def given(i, k, n):
        return (
            factor[i]
            * injected[i]
            * (scale[..., i] * _coefficients(table.gas_torque, i, k))
            * phase(i, n)
        )

    lists = [
        row if counts else ()
        for row, counts in zip(topology.cylinder_harmonics, cycles.given, strict=True)
    ]
    torque = _add_listed(torque, disks, lists, given)
    rows, parts, ambient = _computed_gas(train)

    def computed(i, k, n):
        row = np.searchsorted(rows, i)
        gas = (_gas_weights(table, cycles, rpm)[..., i] * parts[:, row, k + 1]).sum(
            axis=-2
        )
        return factor[i] * (scale[..., i] * gas - ambient[row, k + 1]) * phase(i, n)

    steps = enumerate(zip(topology.cylinder_step, topology.cylinder_gas, strict=True))
    lists = [
        tuple(step * k for k in range(1, kept + 1)) if i in rows else ()
        for i, (step, kept) in steps
    ]
    torque = _add_listed(torque, disks, lists, computed)

    def inertia(i, k, n):
        speed = (
            ratio[np.array(disks, dtype=int)] * (2.0 * np.pi / 60.0) * rpm[..., None]
        )
        unit = _unit_inertia_harmonics(table, topology.cylinder_series)
        return (
            (table.reciprocating_mass * speed**2)[..., i] * unit[i, k + 1] * phase(i, n)
        )

    turns = zip(topology.cylinder_inertia, topology.cylinder_turn, strict=True)
    lists = [
        tuple(round(j * turn) for j in range(1, min(kept, CRANK_SAMPLES // 2) + 1))
        for kept, turn in turns
    ]
    return _add_listed(torque, disks, lists, inertia)


def _gas_weights(table, cycles, rpm):
    """Weights [..., J, nc] of all that :func:`_pressure_harmonics` gives."""
    own = weights(table, cycles, rpm)
    if not cycles.skipping:
        return own
    unburnt = unburnt_weights(table, rpm)
    xp = namespace(own, unburnt)
    burnt = xp.zeros(
        (*own.shape[:-2], own.shape[-2] - unburnt.shape[-2], own.shape[-1])
    )
    return xp.concatenate([own, burnt, unburnt], axis=-2)


def _turned(train, members, i, n):
    """exp(-i n alpha / turn) of elements i at harmonics n of the cycle, for every phase
    of which they are members.
    """
    if not members:
        return 1.0
    xp = namespace(train.phases)
    angle = train.phases.angle
    own = np.array([np.isin(i, row) for row in members])
    turns = own * n / np.array(train.topology.phase_turn)[:, None]
    return xp.exp(-1j * (xp.deg2rad(angle) @ turns))


def _add_listed(torque, disks, numbers, values):
    """Add ``values(i, k, n)`` of elements i on ``disks`` at their harmonics n =
    ``numbers[i][k]`` up to N.
    """
    i, k, n = _listed(tuple(numbers), torque.shape[-1] - 1)
    if not i.size:
        return torque
    return added(torque, (..., np.array(disks, dtype=int)[i], n), values(i, k, n))


@lru_cache(maxsize=256)
def _listed(numbers, most):
    """Elements i, places k and harmonics n = ``numbers[i][k]`` up to ``most``."""
    flat = [
        (i, k, n)
        for i, row in enumerate(numbers)
        for k, n in enumerate(row)
        if n <= most
    ]
    return np.array(flat, dtype=int).reshape(-1, 3).T


def _add_given(torque, disks, numbers, rows, factor):
    """Add the given harmonics of elements, each times its factor."""
    return _add_listed(
        torque,
        disks,
        numbers,
        lambda i, k, n: factor[..., i] * _coefficients(rows, i, k),
    )


def _coefficients(rows, i, k):
    """T^n of rows (Re, Im) of peak amplitudes."""
    pair = rows[i, k]
    return 0.5 * (pair[:, 0] + 1j * pair[:, 1])


def load_power_kW(train: DriveTrain, rpm, load_torque):  # noqa: N802
    """Power in kW that loads of ``load_torque`` [n_loads] N m take: -sum_j
    load_torque_j x ratio_j x 2 pi rpm / 60.
    """
    rotor = np.array(train.topology.rotor, dtype=int)[
        np.array(train.topology.load_disk, dtype=int)
    ]
    return (
        -(load_torque @ speed_ratios(train)[rotor])
        * (2.0 * np.pi / 60.0 / 1000.0)
        * rpm
    )


def highest_harmonic(train: DriveTrain) -> int:
    """Largest harmonic n >= 1 of the cycle that the excitation holds to an extent that
    counts. Host: concrete values.

    Counted are all harmonics given with an amplitude, those of meshes too, inertia
    torques up to order 6 of their own rotor, and of computed gas torques those above
    1e-6 of the largest, always within the cylinder's ``orders``.
    """
    topology = train.topology
    found = [1]
    given = [(topology.torque_harmonics, train.torques.harmonics)]
    given.append((topology.cylinder_harmonics, train.cylinders.gas_torque))
    own = [
        (f"mesh_{name}", getattr(train.meshes, name))
        for name in (*OF_PERIOD, *OF_GEARS)
    ]
    own.append(("load_harmonics", train.loads.harmonics))
    given += [
        (getattr(topology, name), values) for name, values in own if values is not None
    ]
    for numbers, values in given:
        present = (np.asarray(values) != 0.0).any(axis=-1).tolist()
        for row, counts in zip(numbers, present, strict=True):
            found += [n for n, there in zip(row, counts, strict=False) if there]
    mass = np.asarray(train.cylinders.reciprocating_mass)
    for i, (orders, turn) in enumerate(
        zip(topology.cylinder_inertia, topology.cylinder_turn, strict=True)
    ):
        if orders and mass[i] > 0.0:
            found.append(round(min(orders, INERTIA_ORDERS_THAT_COUNT) * turn))
    rows, gas, _ = _computed_gas(train)
    for i, row in zip(
        rows, np.abs(np.asarray(gas)).max(axis=0) if rows else (), strict=True
    ):
        row = row[1 : topology.cylinder_gas[i] + 1]
        counts = np.flatnonzero(
            row > NEGLIGIBLE_GAS * max(row.max(initial=0.0), 1e-300)
        )
        found += [(k + 1) * topology.cylinder_step[i] for k in counts.tolist()]
    return int(max(found))


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
    found = [1, *(n for row in listed for n in row)]
    found += [
        kept * step
        for kept, step in zip(
            topology.cylinder_gas, topology.cylinder_step, strict=True
        )
    ]
    found += [
        round(kept * turn)
        for kept, turn in zip(
            topology.cylinder_inertia, topology.cylinder_turn, strict=True
        )
    ]
    return int(max(found))

"""Excitation: the torque of cylinders, given torques and loads as harmonics of the cycle. Pure functions on
arrays.

A cylinder's gas torque is T = gas_factor (scale(rpm) p - p_ambient) A x'(a), its inertia torque at constant speed w of
its own rotor T = -m x'(a) x''(a) w^2, with the travel x from top dead centre
(:func:`~jaxhb.excitation.crank.slider_crank`). The scale over rpm multiplies gas torques and given torques, never
inertia torques. The pressure p is a sum of functions of the angle, weighted by speed and load
(:mod:`jaxhb.excitation.gas`). Coefficients are those of T(t) = sum_{n=-N..N} T^n exp(i n Omega t); an amplitude A in
Re(A exp(i n Omega t)) gives T^n = A/2. The number of operations does not grow with the number of elements.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np

from jaxhb._jax import kept, namespace
from jaxhb.equations import fourier
from jaxhb.equations.kinematics import speed_ratios
from jaxhb.excitation.crank import CRANK_SAMPLES, gas_torque, inertia_torque
from jaxhb.excitation.gas import COMPUTED, components, weights
from jaxhb.excitation.mean_torques import mean_torques, scale_at

if TYPE_CHECKING:
    from jaxhb.train.drivetrain import DriveTrain
    from jaxhb.train.topology import Topology


def gas_torque_harmonics(pressure, bore, stroke, rod, *, revolutions):
    """Harmonics of :func:`~jaxhb.excitation.crank.gas_torque` over the gas cycle, arguments as there.

    Returns
    -------
    array [..., M//2 + 1], complex
        N m; entry 0 the mean, entry k the coefficient of exp(i k a / revolutions), half the peak amplitude.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxhb.excitation.torques import gas_torque_harmonics
    >>> bool(abs(gas_torque_harmonics(np.ones(64) * 1e5, 0.1, 0.1, 0.2, revolutions=2)[0]) < 1e-9)
    True
    """
    torque = gas_torque(pressure, bore, stroke, rod, revolutions=revolutions)
    return fourier.analyze(torque, torque.shape[-1] // 2)


def inertia_torque_harmonics(stroke, rod, *, short_series=False):
    """Harmonics of :func:`~jaxhb.excitation.crank.inertia_torque` over a revolution, arguments as there.

    Returns
    -------
    array [..., 257], complex
        N m; entry j the coefficient of exp(i j a), half the peak amplitude, a from top dead centre.

    Notes
    -----
    The series in lambda = stroke/(2 rod) is Porter's (1943): -1/2 sin 2a - 3 lambda/4 sin 3a + ... times m r^2 w^2.

    Examples
    --------
    >>> from jaxhb.excitation.torques import inertia_torque_harmonics
    >>> round(float(-2 * inertia_torque_harmonics(2.0, 5.0)[2].imag), 12)
    -0.500052072485
    """
    return fourier.analyze(inertia_torque(stroke, rod, short_series=short_series), CRANK_SAMPLES // 2)


def pressure_cylinders(topology) -> tuple[int, ...]:
    """Indices of the cylinders whose gas torque is computed."""
    both = zip(topology.cylinder_source, topology.cylinder_fires, strict=True)
    return tuple(i for i, (source, fires) in enumerate(both) if source in COMPUTED and fires)


def gas_revolutions(topology, rows):
    """Revolutions of the gas cycles of some cylinders."""
    return tuple(topology.cylinder_gas_revolutions[i] for i in rows)


@kept
def pressure_harmonics(table, rows, revolutions):
    """Harmonics of the gas cycle of p A x' [J, n, K], one for each component of p, and of p_ambient A x' [n, K].

    ``rows`` are the n cylinders of the table, ``revolutions`` those of their gas cycles.
    """
    xp, rows = namespace(table), np.array(rows, dtype=int)
    given = (table.ambient_pressure, table.bore, table.stroke, table.rod)
    pressure = xp.asarray(components(table))[:, rows]
    ambient, *geometry = (xp.asarray(values)[rows] for values in given)
    all_of = xp.concatenate([pressure, xp.broadcast_to(ambient[None, :, None], (1, *pressure.shape[1:]))])
    harmonics = gas_torque_harmonics(all_of, *geometry, revolutions=np.array(revolutions))
    return harmonics[:-1], harmonics[-1]


@kept
def unit_inertia_harmonics(table, short_series):
    """:func:`inertia_torque_harmonics` of the cylinders of a table."""
    return inertia_torque_harmonics(table.stroke, table.rod, short_series=np.array(short_series))


__all__ = [
    "excitation",
    "highest_harmonic",
    "listed_harmonic",
    "load_power_kW",
]

INERTIA_ORDERS_THAT_COUNT = 6
"""Orders of the inertia torque per revolution of its own rotor: the next is 0.04 % of the largest."""

NEGLIGIBLE_GAS = 1e-6
"""Share of the largest harmonic of a computed gas torque below which one does not count."""


def excitation(train: DriveTrain, rpm, harmonics: int):
    """Torque on every disk as harmonics of the cycle, the loads that balance it, and what is left unbalanced.

    The loads satisfy: sum over disks of speed ratio x mean torque = 0, each taking its share; their pulsation is in
    proportion to the torque that each takes. The angle 0 of
    the reference rotor is firing top dead centre of a cylinder with ``firing_angle`` 0; an event later by
    alpha of its own rotor multiplies by exp(-i order alpha).

    Parameters
    ----------
    train : DriveTrain
    rpm : float, scalar array
        Speed of the reference rotor.
    harmonics : int
        N (static); harmonics above N are dropped, see :func:`highest_harmonic`.

    Returns
    -------
    torque : array [n_disks, N + 1], complex
        N m, T^n for n = 0..N; rings of dampers last; the loads are included.
    load_torque : array [n_loads]
        N m, mean torque of each load on its disk (negative where it takes power).
    imbalance : scalar array
        N m, sum over disks of speed ratio x mean torque, loads included: 0 when there is a load.

    Examples
    --------
    >>> from jaxhb.excitation.torques import excitation
    >>> from jaxhb.scene.files import load_scene
    >>> torque, load, left = excitation(load_scene("gear_train_30"), 1800.0, 24)
    >>> torque.shape, load.shape
    ((27, 25), (1,))
    """
    xp, topology = namespace(train, rpm), train.topology
    rpm = xp.asarray(rpm, dtype=float)
    ratio = speed_ratios(train)[np.array(topology.rotor, dtype=int)]
    torque = xp.zeros((topology.n_disks, harmonics + 1), dtype=complex)
    seats = np.array([*topology.torque_disk, *topology.cylinder_disk], dtype=int)
    cycle = topology.cylinder_fires, topology.cylinder_gas_revolutions
    torque = _add(torque, seats, 0, mean_torques(train.torques, train.cylinders, *cycle, rpm))
    torque = _add_given(torque, train, rpm)
    if topology.cylinder_names:
        torque = _add_gas(torque, train, rpm)
        torque = _add_inertia(torque, train, rpm, ratio)
    load_disk = np.array(topology.load_disk, dtype=int)
    # Power of the mean torques over the speed of the reference rotor: torque x speed ratio, summed.
    power = ratio @ torque[:, 0].real
    if not topology.load_disk:
        return torque, xp.zeros(0), power
    share = xp.asarray(train.loads.share)
    # Each load takes its share of torque, and all together the power: sum of ratio x load torque = -power.
    load_torque = -power * share / (share @ ratio[load_disk])
    torque = _add(torque, load_disk, 0, load_torque)
    torque = _add_pulsation(torque, train, load_torque)
    return torque, load_torque, ratio @ torque[:, 0].real


def _add(torque, disks, harmonics, values):
    """``torque`` with ``values`` added at ``[disks, harmonics]``, where indices may repeat."""
    if isinstance(torque, np.ndarray) and namespace(values) is np:
        np.add.at(torque, (disks, harmonics), values)
        return torque
    return jnp.asarray(torque).at[disks, harmonics].add(values)


def load_power_kW(train: DriveTrain, rpm, load_torque):  # noqa: N802
    """Power that the loads take from the train.

    P = - sum_j load_torque_j x ratio_j x 2 pi rpm / 60.

    Parameters
    ----------
    train : DriveTrain
    rpm : float, scalar array
        Speed of the reference rotor.
    load_torque : array [n_loads]
        N m, from :func:`excitation`.

    Returns
    -------
    scalar array
        kW.

    Examples
    --------
    >>> from jaxhb.excitation.torques import excitation, load_power_kW
    >>> from jaxhb.scene.files import load_scene
    >>> train = load_scene("gear_train_30")
    >>> round(float(load_power_kW(train, 1800.0, excitation(train, 1800.0, 0)[1])), 1)
    436.7
    """
    rotor = np.array(train.topology.rotor, dtype=int)[np.array(train.topology.load_disk, dtype=int)]
    return -(load_torque @ speed_ratios(train)[rotor]) * (2.0 * np.pi / 60.0 / 1000.0) * rpm


def highest_harmonic(train: DriveTrain) -> int:
    """Largest harmonic of the cycle that the excitation holds to an extent that counts. Host: concrete
    values.

    Counted are all harmonics given with an amplitude, inertia torques up to order 6 of their own rotor (the
    next is 0.04 % of the largest), and of computed gas torques those above 1e-6 of the largest, always within
    the cylinder's ``orders``.

    Parameters
    ----------
    train : DriveTrain

    Returns
    -------
    int
        n >= 1; an analysis with fewer harmonics than this drops excitation.

    Examples
    --------
    >>> from jaxhb.excitation.torques import highest_harmonic
    >>> from jaxhb.scene.files import load_scene
    >>> highest_harmonic(load_scene("gear_train_30"))
    24
    """
    topology, found = train.topology, [1]
    given = [(topology.torque_harmonics, train.torques.harmonics)]
    given.append((topology.cylinder_harmonics, train.cylinders.gas_torque))
    if train.loads.harmonics is not None:
        given.append((topology.load_harmonics, train.loads.harmonics))
    for numbers, values in given:
        present = (np.asarray(values) != 0.0).any(axis=-1).tolist()
        for row, counts in zip(numbers, present, strict=True):
            found += [n for n, there in zip(row, counts, strict=False) if there]
    mass = np.asarray(train.cylinders.reciprocating_mass)
    for i, (orders, turn) in enumerate(zip(topology.cylinder_inertia, topology.cylinder_turn, strict=True)):
        if orders and mass[i] > 0.0:
            found.append(round(min(orders, INERTIA_ORDERS_THAT_COUNT) * turn))
    with_gas = pressure_cylinders(topology)
    if with_gas:
        gas, _ = pressure_harmonics(train.cylinders, with_gas, gas_revolutions(topology, with_gas))
        for i, row in zip(with_gas, np.abs(np.asarray(gas)).max(axis=0), strict=True):
            row = row[1 : topology.cylinder_gas[i] + 1]
            counts = np.flatnonzero(row > NEGLIGIBLE_GAS * max(row.max(initial=0.0), 1e-300))
            found += [(k + 1) * topology.cylinder_step[i] for k in counts.tolist()]
    return int(max(found))


def listed_harmonic(topology: Topology) -> int:
    """Largest harmonic of the cycle that the excitation can have, whatever the numbers of the train are.

    Counted are all harmonics listed for torques and cylinders, of computed gas torques and of inertia torques
    all that the cylinder's ``orders`` keeps; amplitudes of 0 and cylinders that misfire count like the others.
    So it is never below :func:`highest_harmonic`, and it stays under :meth:`DriveTrain.replace` and
    :meth:`DriveTrain.misfire`.

    Parameters
    ----------
    topology : Topology

    Returns
    -------
    int
        n >= 1; :func:`excitation` with this many harmonics drops nothing.

    Examples
    --------
    >>> from jaxhb.excitation.torques import listed_harmonic
    >>> from jaxhb.scene.files import load_scene
    >>> listed_harmonic(load_scene("gear_train_30").topology)
    24
    """
    listed = *topology.torque_harmonics, *topology.cylinder_harmonics, *topology.load_harmonics
    found = [1, *(n for row in listed for n in row)]
    found += [kept * step for kept, step in zip(topology.cylinder_gas, topology.cylinder_step, strict=True)]
    found += [round(kept * turn) for kept, turn in zip(topology.cylinder_inertia, topology.cylinder_turn, strict=True)]
    return int(max(found))


def _entries(numbers, harmonics):
    """Index arrays (element, column, n) of the given harmonics up to N."""
    flat = [(i, k, n) for i, row in enumerate(numbers) for k, n in enumerate(row) if n <= harmonics]
    return np.array(flat, dtype=int).reshape(-1, 3).T


def _add_given(torque, train, rpm):
    """Add the harmonics of the given torques."""
    topology, table = train.topology, train.torques
    disk = np.array(topology.torque_disk, dtype=int)
    i, k, n = _entries(topology.torque_harmonics, torque.shape[1] - 1)
    if not i.size:
        return torque
    pair = table.harmonics[i, k]
    return _add(torque, disk[i], n, 0.5 * scale_at(table, rpm)[i] * (pair[:, 0] + 1j * pair[:, 1]))


def _add_pulsation(torque, train, load_torque):
    """Add what the loads pulsate, in proportion to their mean torques."""
    i, k, n = _entries(train.topology.load_harmonics, torque.shape[1] - 1)
    if not i.size:
        return torque
    pair = train.loads.harmonics[i, k]
    return _add(
        torque,
        np.array(train.topology.load_disk, dtype=int)[i],
        n,
        0.5 * load_torque[i] * (pair[:, 0] + 1j * pair[:, 1]),
    )


def _phase(train, i, n):
    """exp(-i order alpha) of cylinder i at harmonic n of the cycle; order in revolutions of its own rotor."""
    order = n / np.array(train.topology.cylinder_turn)[i]
    xp, angle = namespace(train.cylinders.firing_angle), train.cylinders.firing_angle
    return xp.exp(-1j * order * xp.deg2rad(angle)[i])


def _add_gas(torque, train, rpm):
    """Add the harmonics of the gas torques, given and computed."""
    topology, table = train.topology, train.cylinders
    disk = np.array(topology.cylinder_disk, dtype=int)
    scale = scale_at(table, rpm)
    factor = table.gas_factor if table.gas_factor is not None else np.ones(len(disk))
    lists = [row if f else () for row, f in zip(topology.cylinder_harmonics, topology.cylinder_fires, strict=True)]
    i, k, n = _entries(lists, torque.shape[1] - 1)
    if i.size:
        pair = table.gas_torque[i, k]
        value = 0.5 * scale[i] * (pair[:, 0] + 1j * pair[:, 1])
        torque = _add(torque, disk[i], n, factor[i] * value * _phase(train, i, n))
    rows = pressure_cylinders(topology)
    if not rows:
        return torque
    parts, ambient = pressure_harmonics(table, rows, gas_revolutions(topology, rows))
    rows = np.array(rows)
    row_scale = scale[rows]
    lists = [tuple(topology.cylinder_step[c] * k for k in range(1, topology.cylinder_gas[c] + 1)) for c in rows]
    i, k, n = _entries(lists, torque.shape[1] - 1)
    gas = (weights(table, rpm)[:, rows[i]] * parts[:, i, k + 1]).sum(axis=0)
    value = factor[rows[i]] * (row_scale[i] * gas - ambient[i, k + 1])
    return _add(torque, disk[rows[i]], n, value * _phase(train, rows[i], n))


def _add_inertia(torque, train, rpm, ratio):
    """Add the inertia torques of the reciprocating masses."""
    topology, table = train.topology, train.cylinders
    lists = [
        tuple(round(j * turn) for j in range(1, min(orders, CRANK_SAMPLES // 2) + 1))
        for orders, turn in zip(topology.cylinder_inertia, topology.cylinder_turn, strict=True)
    ]
    i, k, n = _entries(lists, torque.shape[1] - 1)
    if not i.size:
        return torque
    disk = np.array(topology.cylinder_disk, dtype=int)
    speed = ratio[disk] * (2.0 * np.pi / 60.0) * rpm
    unit = unit_inertia_harmonics(table, topology.cylinder_series)
    value = (table.reciprocating_mass * speed**2)[i] * unit[i, k + 1]
    return _add(torque, disk[i], n, value * _phase(train, i, n))

"""Loads of a transient: torques by the turning angle of the mean rotation, at its
momentary speed.

The torque of a disk at the angle theta and the speed Omega is

    T = Re sum_n c_n(Omega) exp(i n theta),

with the harmonics ``c_n`` that steady motions have at that speed, and of lines at
fixed frequencies, which count on the time, ``Re c_l(Omega) exp(2 pi i f_l t)``. What
counts on the momentary acceleration in the inertia torque of a crank drive, less its
mean, is left out: its share of the rest is the change of speed in a revolution over
the speed.

In the frame that turns with the mean rotation, disks of speed ratio i carry ``-J i
alpha``. Loads of a given speed take the power that accelerates the train from theirs;
at free speed they follow their laws. Where there is no load, each disk is accelerated
by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import jax
import numpy as np

from jaxhb._jax import Array, Number, added, namespace
from jaxhb.equations.backlash import MeshParameters
from jaxhb.equations.system import System
from jaxhb.excitation.orders import add_rows
from jaxhb.train import excitation
from jaxhb.train.chain import rigid_shape
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.kinematics import displacement_radii, inertias, speed_ratios
from jaxhb.train.tables import TrainArrays
from jaxhb.transients.loads import load_torques

# Panels over the range of speeds, at least: the parabolas of a panel are exact for
# torques linear in the speed and for inertia torques.
PANELS = 32
# Speed below which torques are those of this speed, rpm
STANDSTILL = 1e-3


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class TorqueTable:
    """Harmonics of the torques of D disks over the speed, in P panels, each a parabola
    through its begin, its middle and its end; behind harmonics 0 to N the L lines of
    fixed frequencies.

    omega ``(P, 2)`` rad/s: begin and end of the panels; harmonics ``(M, P, 3, D,
    N+1+L)`` N m of M states of the cylinders; hz ``(L,)`` of the lines; idle : the same
    without gas torques and torques that drive, None where no event changes the fuel;
    accelerating ``(D, N+1+L)`` N m s2: what loads add per angular acceleration of the
    reference rotor.
    """

    omega: Array
    harmonics: Array
    hz: Array
    accelerating: Array
    idle: Array | None = None

    @property
    def highest(self) -> int:
        """Highest harmonic N."""
        return self.harmonics.shape[-1] - len(self.hz) - 1


def excited_disks(train: TrainArrays) -> np.ndarray:
    """Disks on which excitations or loads act, sorted."""
    topology = train.topology
    disks = {*excitation.excited_disks(topology), *topology.load_disk}
    return np.array(sorted(disks), dtype=int)


def load_patterns(train: TrainArrays, harmonics: int) -> Array:
    """Torques ``(n_loads, S, N+1)`` of every load per mean torque of its own."""
    topology = train.topology
    xp = namespace(train)
    count = len(topology.load_disk)
    disks = np.array(topology.load_disk, dtype=int)
    patterns = []
    for number in range(count):
        own = np.arange(count) == number
        torque = xp.zeros((topology.n_disks, harmonics + 1), dtype=complex)
        torque = added(torque, (disks, 0), own + 0j)
        rows = train.loads.harmonics
        if rows is not None:
            torque = add_rows(
                torque, disks, topology.load_harmonics, rows, own.astype(float)
            )
        patterns.append(torque)
    if not patterns:
        return xp.zeros((0, topology.n_disks, harmonics + 1), dtype=complex)
    return xp.stack(patterns)


def accelerated_inertia(train: TrainArrays) -> Number:
    """Inertia in kg m2 of the whole train, referred to the reference rotor."""
    ratio = speed_ratios(train)[np.array(train.topology.rotor, dtype=int)]
    return (inertias(train) * ratio**2).sum()


def panels(train: TrainArrays, lowest: float, highest: float) -> np.ndarray:
    """Begin and end ``(P, 2)`` rpm of panels over a range of speeds, with borders where
    torques have a kink.
    """
    lowest = max(lowest, STANDSTILL)
    if highest - lowest < 1e-9 * highest:
        return np.array([[lowest * (1 - 1e-6), lowest * (1 + 1e-6)]])
    kinks = kinks_between(train, lowest, highest)
    even = np.linspace(lowest, highest, PANELS + 1)[1:-1]
    apart = [
        rpm
        for rpm in even
        if not kinks or min(abs(rpm - kink) for kink in kinks) > 1e-6 * highest
    ]
    borders = np.array(sorted([lowest, *kinks, *apart, highest]))
    return np.stack([borders[:-1], borders[1:]], axis=1)


def nodes_of(ranges: Array) -> Array:
    """Begin, middle and end ``(P, 3)`` of ranges ``(P, 2)``."""
    xp = namespace(ranges)
    return xp.stack([ranges[:, 0], ranges.mean(axis=1), ranges[:, 1]], axis=1)


def kinks_between(train: TrainArrays, lowest: float, highest: float) -> list[float]:
    """Speeds in rpm between two at which numbers over the speed have a kink."""
    speeds = excitation.speeds(train)
    for table, field, index, count in train.topology.rpm_tables:
        rows = getattr(train.table(table), f"{field}_over_rpm")
        speeds = np.union1d(speeds, np.asarray(rows)[index, :count, 0])
    if train.loads.over_rpm is not None:
        speeds = np.union1d(speeds, np.asarray(train.loads.over_rpm)[..., 0])
    return [float(rpm) for rpm in speeds if lowest < rpm < highest]


def torque_table(
    trains: Sequence[DriveTrain],
    idle_trains: Sequence[DriveTrain],
    ranges: Array,
    harmonics: int,
    *,
    free: bool,
) -> TorqueTable:
    """The :class:`TorqueTable` of trains, one for each state of the cylinders, over
    panels ``(P, 2)`` rpm.

    idle_trains : the same trains without fuel, none where no event changes it; free :
    whether loads follow their laws over the speed, or balance the power.
    """
    train = trains[0]
    xp = namespace(train)
    disks = excited_disks(train)
    rpm = nodes_of(ranges)
    hz, _ = excitation.lines_at(train, rpm[0, 0])
    patterns = load_patterns(train, harmonics)[:, disks]
    patterns = xp.pad(patterns, ((0, 0), (0, 0), (0, len(hz))))

    def over_panels(other: DriveTrain) -> Array:
        torque, balancing, _ = excitation.excitation(
            other, rpm.ravel(), harmonics, beside_lines=True
        )
        _, of_lines = excitation.line_torques(other, rpm.ravel())
        torque = xp.concatenate([torque, of_lines], axis=-1)[:, disks]
        torque = torque.reshape(*rpm.shape, *torque.shape[1:])
        if free:
            change = load_torques(train, rpm) - balancing.reshape(*rpm.shape, -1)
            torque = torque + xp.einsum("pkl,ldn->pkdn", change + 0j, patterns)
        return torque

    accelerating = xp.zeros((len(disks), harmonics + 1 + len(hz)), dtype=complex)
    if not free and train.topology.load_disk:
        share = xp.asarray(train.loads.share)
        rotor = np.array(train.topology.rotor, dtype=int)
        ratio = speed_ratios(train)[rotor][np.array(train.topology.load_disk)]
        taken = accelerated_inertia(train) * share / (share @ ratio)
        accelerating = xp.einsum("l,ldn->dn", taken + 0j, patterns)
    return TorqueTable(
        omega=ranges * (np.pi / 30),
        harmonics=xp.stack([over_panels(other) for other in trains]),
        hz=hz,
        accelerating=accelerating,
        idle=xp.stack([over_panels(other) for other in idle_trains])
        if idle_trains
        else None,
    )


def panel_of(borders: Array, omega: Number) -> Array:
    """Number of the panel, of those with ``borders`` ``(P, 2)``, of a speed in rad/s,
    the nearest of one outside.
    """
    xp = namespace(borders, omega)
    panel = xp.searchsorted(borders[:, 0], omega, side="right") - 1
    return xp.clip(panel, 0, len(borders) - 1)


def powers_in_panel(borders: Array, panel: Array, omega: Number) -> Array:
    """Powers 0 to 2 ``(..., 3)`` of the share of a panel at speeds in rad/s."""
    begin = borders[panel, 0]
    end = borders[panel, 1]
    share = (omega - begin) / (end - begin)
    return namespace(share).asarray(share)[..., None] ** np.arange(3)


def fuelled(
    table: TorqueTable, nodes: Callable[[Array], Array], factor: Array
) -> Array:
    """Harmonics that ``nodes`` takes from a table, with a factor of gas torques and
    torques that drive.
    """
    full = nodes(table.harmonics)
    if table.idle is None:
        return full
    idle = nodes(table.idle)
    return idle + factor * (full - idle)


def means(table: TorqueTable, mode: Array, omega: Number, factor: Number) -> Array:
    """Mean torques ``(D,)`` N m at a speed in rad/s."""
    panel = panel_of(table.omega, omega)

    def nodes(harmonics: Array) -> Array:
        return harmonics[mode, panel, :, :, 0].real

    begin, middle, end = fuelled(table, nodes, namespace(table).asarray(factor))
    over_speed = namespace(table).stack(parabola(begin, middle, end))
    return powers_in_panel(table.omega, panel, omega) @ over_speed


def load_columns(
    train: TrainArrays,
    system: System,
    meshes: MeshParameters,
    event_disks: np.ndarray,
) -> Array:
    """Forces ``(S, C)`` N on the disks of unit loads: torques in N m of the excited
    disks, angular acceleration of the reference rotor in rad/s2, torques of events in N
    m, and forces of the transmission errors of ``meshes`` in N.
    """
    xp = namespace(train, system)
    radius = displacement_radii(train)
    seats = np.eye(train.topology.n_disks)
    on_disks = seats / radius[:, None]
    carried = system.mass * rigid_shape(train, radius)
    if not train.topology.load_disk:
        carried = 0 * carried
    columns = [
        on_disks[:, excited_disks(train)],
        -carried[:, None],
        on_disks[:, event_disks],
    ]
    if meshes.error is not None:
        columns.append(system.incidence(meshes.link))
    return xp.concatenate(columns, axis=1)


def parabola(begin: Array, middle: Array, end: Array) -> list[Array]:
    """Coefficients of the powers 0, 1, 2 of a share of a range, of what has given
    values at its begin, its middle and its end.
    """
    return [
        begin,
        4 * middle - 3 * begin - end,
        2 * begin - 4 * middle + 2 * end,
    ]

"""Checks of a train as a whole: connections, gears, orders and cycle, what holds the
train, mean balance.

Each check leaves out data in doubt, which have another sentence already.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np

from jaxhb.elements.checks import Parts
from jaxhb.elements.elements import OF_PERIOD
from jaxhb.elements.excitations import EXCITATIONS
from jaxhb.elements.sentences import Suggestions, shown
from jaxhb.elements.values import whole
from jaxhb.train import connections
from jaxhb.train.connections import members_of, names_of, pieces
from jaxhb.train.excitation import on_disks

# Share by which the ratio of radii may miss that of the teeth, which then counts
TEETH_TOLERANCE = 1e-3
BALANCE_TOLERANCE = 1e-9
"""Mean torque left over the largest up to which a train without ground balances:
rounding of the sums.
"""


def elastic_pairs(parts: Parts) -> list[tuple[int, int]]:
    """Disk pairs of one rotor: shafts, and dampers with their rings."""
    n_disks = len(parts.tables["disk"])
    return parts.ends("shaft") + [
        (disk, n_disks + i) for i, disk in parts.seats("damper")
    ]


def connection_errors(parts: Parts) -> list[str]:
    """Find pieces of the train that no link joins."""
    if not parts.connected:
        return []
    names = parts.disk_names
    first, *rest = members_of(
        pieces(len(names), elastic_pairs(parts) + parts.ends("mesh"))
    ) or [[]]
    return [
        f"{parts.source}: the train falls into pieces that no link joins:"
        f" {names_of(names, first)} and {names_of(names, piece)}. Join them by a"
        " [[shaft]] or a [[mesh]]."
        for piece in rest
    ]


def gear_errors(parts: Parts, rotor: Sequence[int]) -> list[str]:
    """Check that every mesh joins gears of two rotors, and teeth against radii."""
    errors = []
    disks = parts.tables["disk"]
    for i, ends in parts.links("mesh"):
        where = parts.where("mesh", i)
        names = [parts.disk_names[disk] for disk in ends]
        bare = [
            parts.disk_names[disk]
            for disk in ends
            if disk >= len(disks) or disks[disk].radius is None
        ]
        errors += [
            f"{where}: disk {name!r} has no radius. Give its pitch radius in m."
            for name in bare
        ]
        if rotor[ends[0]] == rotor[ends[1]]:
            errors.append(
                f"{where}: {names[0]!r} and {names[1]!r} are on one rotor, must be on"
                " two: the shafts between them lock the mesh. Remove the mesh or a"
                " shaft."
            )
        if bare or not all(
            parts.usable("disk", disk, "radius", "teeth") for disk in ends
        ):
            continue
        first, second = (disks[disk] for disk in ends)
        mesh = parts.tables["mesh"][i]
        keys = [*OF_PERIOD, "stiffness_table", "contact_ratio", "width"]
        keys_that_need_teeth = [
            key for key in keys if parts.usable("mesh", i, key) and getattr(mesh, key)
        ]
        toothless = [
            name
            for name, gear in zip(names, (first, second), strict=True)
            if not gear.teeth
        ]
        needs_all = "width" in keys_that_need_teeth
        if (needs_all and toothless) or (keys_that_need_teeth and len(toothless) == 2):
            gears = " and ".join(map(repr, toothless))
            have = "has" if len(toothless) == 1 else "have"
            numbers = "its number" if len(toothless) == 1 else "their numbers"
            errors.append(
                f"{where}: {keys_that_need_teeth[-1]} is given, and {gears} {have} no"
                f" teeth. Give {numbers} of teeth."
            )
        if not (first.teeth and second.teeth):
            continue
        tooth_ratio = first.teeth / second.teeth
        if abs(tooth_ratio * second.radius / first.radius - 1.0) > TEETH_TOLERANCE:
            # Their ratio is in doubt: it decides nothing more.
            parts.bad |= {("disk", disk, "radius") for disk in ends}
            errors.append(
                f"{where}: teeth {first.teeth}:{second.teeth} = {tooth_ratio:.6g} but"
                f" radii {first.radius:g}:{second.radius:g} m ="
                f" {first.radius / second.radius:.6g}; must agree to 0.1 %. Correct"
                " teeth or radii."
            )
    return errors


def reference_error(parts: Parts, reference: Any, rotor: Sequence[int]) -> list[str]:
    """Ask for the reference where there are several rotors."""
    if reference is not None or not parts.connected or max(rotor, default=0) == 0:
        return []
    first_disks = [
        parts.disk_names[rotor.index(number)] for number in range(max(rotor) + 1)
    ]
    listed = ", ".join(repr(name) for name in first_disks[:8])
    return [
        f"{parts.source}, [scene]: the key 'reference' is missing; there are"
        f" {max(rotor) + 1} rotors. Name a disk of the rotor whose rpm is given, one of"
        f" {listed}."
    ]


def loop_errors(
    parts: Parts, locked: Iterable[tuple[int, Sequence[int], str]]
) -> list[str]:
    """Say which loops lock the train."""
    return [
        f"{parts.where('mesh', mesh)}: locked closed loop"
        f" {names_of(parts.disk_names, disks)}: {why}. Correct the radii, the kind of a"
        " mesh, or remove one mesh."
        for mesh, disks, why in locked
    ]


def cycle_errors(
    parts: Parts, needs: Sequence[tuple[str, int, str, float, str]], revolutions: float
) -> list[str]:
    """Find orders that are no harmonic 1, 2, ... of the cycle; ``needs``: (table, i,
    text, order, key of the mean).
    """

    def is_small(per_revolution: float) -> bool:
        """Whether an order is harmonic 0 of the cycle."""
        harmonic = per_revolution * revolutions
        return harmonic < 0.5 and whole(harmonic)

    unfit = [need for need in needs if not whole(need[3] * revolutions)]
    small = [need for need in needs if is_small(need[3])]
    remedy = " Correct the order or the radii."
    if unfit:
        orders = {need[3] for need in needs if not is_small(need[3])}
        fitting_revolutions = fitting_cycle(orders)
        if fitting_revolutions:
            remedy = f" Set revolutions_per_cycle = {fitting_revolutions:g}."
    errors = []
    for table, i, text, per_revolution, mean in unfit + small:
        expected = f"whole.{remedy}"
        if is_small(per_revolution):
            mean_remedy = (
                f"Give the mean as {mean} = …" if mean else "Correct the radii."
            )
            expected = f"at least 1. {mean_remedy}"
        errors.append(
            f"{parts.where(table, i)}: {text} is harmonic"
            f" {per_revolution * revolutions:.6g} of a cycle of {revolutions:g}"
            f" revolutions of the reference rotor, must be {expected}"
        )
    return errors


def fitting_cycle(per_revolution: Collection[float]) -> float | None:
    """Smallest number of revolutions (up to 1000) that makes all harmonics per
    revolution whole.
    """
    if not all(math.isfinite(value) for value in per_revolution):
        return None
    fractions = [Fraction(value).limit_denominator(1000) for value in per_revolution]
    fits = all(
        abs(float(fraction) - value) <= 1e-9 * max(1.0, abs(value))
        for fraction, value in zip(fractions, per_revolution, strict=True)
    )
    revolutions = math.lcm(*(fraction.denominator for fraction in fractions))
    return float(revolutions) if fits and revolutions <= 1000 else None


def phase_errors(parts: Parts, ratio: Sequence[float | None]) -> list[str]:
    """Find phases whose members are no cylinders or torques, or turn at different
    speeds.
    """
    errors = []
    names: list[str] = []
    engines: set[str] = set()
    for table in reversed(EXCITATIONS):
        own_names = [name for name in parts.names[table] if isinstance(name, str)]
        names += own_names
        if EXCITATIONS[table].of_engines:
            engines |= {name.rpartition(" ")[0] for name in own_names} - {""}
    groups = dict.fromkeys([*names, *sorted(engines)])
    near = Suggestions(groups)
    seats = {table: dict(parts.seats(table)) for table in EXCITATIONS}
    for i, phase in enumerate(parts.tables["phase"]):
        members = phase.of if isinstance(phase.of, tuple | list) else []
        errors += [
            f"{parts.where('phase', i)}: of: there is no cylinder, torque or engine"
            f" {shown(name)}.{near(name)}"
            for name in members
            if not (isinstance(name, str) and name in groups)
        ]
        if parts.usable("phase", i, "of") and not members:
            errors.append(
                f"{parts.where('phase', i)}: of is empty. Name the cylinders and"
                " torques, or their engine."
            )
        disks = [
            seats[table].get(index)
            for table, indices in parts.phased(i).items()
            for index in indices
        ]
        ratios = [ratio[disk] for disk in disks if disk is not None]
        speeds = {round(speed, 9) for speed in ratios if speed is not None}
        if len(speeds) > 1:
            errors.append(
                f"{parts.where('phase', i)}: what it names turns at {len(speeds)}"
                " speeds, must be on one rotor. Give each rotor a [[phase]]."
            )
    return errors


def inertia_errors(parts: Parts) -> list[str]:
    """Find a train without any inertia."""
    bodies = [
        (table, i, element)
        for table in ("disk", "damper")
        for i, element in enumerate(parts.tables[table])
    ]
    is_known = all(parts.usable(table, i, "inertia", "gd2") for table, i, _ in bodies)
    inertias = [
        getattr(element, "gd2", None) if element.inertia is None else element.inertia
        for *_, element in bodies
    ]
    if not (bodies and is_known and parts.complete) or any(
        inertia is None or inertia for inertia in inertias
    ):
        return []
    return [
        f"{parts.source}: the inertia of every disk is 0 kg m2. Give at least one disk"
        " an inertia."
    ]


def _mean_known(parts: Parts, table: str, i: int) -> bool:
    """Whether the mean torque of an element can be computed."""
    fields = EXCITATIONS[table].mean_fields(parts.tables[table][i])
    return parts.usable(table, i, *fields)


@np.errstate(over="ignore", invalid="ignore")
def mean_torques(parts: Parts, speeds: Sequence[float]) -> np.ndarray:
    """Mean torque of all excitations on each disk, where known, N m [speeds,
    n_disks].
    """
    all_disks: list[int] = []
    all_means = []
    for table, kind in EXCITATIONS.items():
        sound_seats = [
            (parts.tables[table][i], disk)
            for i, disk in parts.seats(table)
            if _mean_known(parts, table, i)
        ]
        # Copies of the fields that decide the mean: other fields may be faulty.
        sound_elements = [
            type(element)(
                disk="",
                **{name: getattr(element, name) for name in kind.mean_fields(element)},
            )
            for element, _ in sound_seats
        ]
        disks = [disk for _, disk in sound_seats]
        ones = [1.0] * len(disks)
        seats = kind.seats(sound_elements, [""] * len(disks), disks, ones, 1.0)
        means = kind.means(kind.numbers(sound_elements), seats, np.asarray(speeds))
        all_disks += disks
        all_means.append(means)
    total = np.concatenate(all_means, axis=-1)
    return on_disks(len(parts.disk_names), all_disks, total)


def scale_speeds(parts: Parts) -> list[float]:
    """Speeds (rpm) at which a scale, a load or traces have a point, or a torque its
    rated speed.
    """
    speeds = {
        speed
        for table, kind in EXCITATIONS.items()
        for i, element in enumerate(parts.tables[table])
        for speed in kind.written_speeds(element, partial(parts.usable, table, i))
    }
    return sorted(speeds) or [0.0]


def hold_errors(parts: Parts, main: int | None) -> list[str]:
    """Find pieces joined without static stiffness that a ground or a mean torque leaves
    unheld.
    """
    if main is None or not parts.connected:
        return []
    n_disks = len(parts.tables["disk"])
    dampers = parts.tables["damper"]
    rings = [
        (disk, n_disks + i)
        for i, disk in parts.seats("damper")
        if not parts.usable("damper", i, "stiffness", "stiffness_over_rpm")
        or dampers[i].stiffness > 0
        or any(row[1] > 0 for row in dampers[i].stiffness_over_rpm)
        or dampers[i].order is not None
    ]
    means = mean_torques(parts, scale_speeds(parts))
    grounds = parts.sits_on("ground")
    if len(grounds) < len(parts.tables["ground"]):
        return []
    return connections.unheld(
        parts.source,
        parts.disk_names,
        links=elastic_pairs(parts) + parts.ends("mesh"),
        static=parts.ends("shaft") + parts.ends("mesh") + rings,
        ground=grounds,
        loaded=[*parts.sits_on("load"), *np.flatnonzero(means.any(axis=0))],
        main=main,
    )


@np.errstate(over="ignore", invalid="ignore")
def balance_errors(parts: Parts, ratio: Sequence[float | None]) -> list[str]:
    """Check that mean torques balance where neither a ground nor a load takes the
    rest.
    """
    if parts.tables["ground"] or parts.tables["load"] or not parts.complete:
        return []
    for table in EXCITATIONS:
        count = len(parts.tables[table])
        if len(parts.seats(table)) < count or not all(
            _mean_known(parts, table, i) for i in range(count)
        ):
            return []
    speeds = scale_speeds(parts)
    for rpm, mean in zip(speeds, mean_torques(parts, speeds), strict=True):
        loaded = np.flatnonzero(mean)
        ratios = [ratio[disk] for disk in loaded.tolist()]
        if None in ratios:
            return []
        power = np.array(ratios, dtype=float) * mean[loaded]
        total = power.sum()
        size = np.abs(power).sum()
        if abs(total) > BALANCE_TOLERANCE * size:
            at_speed = f" at {rpm:g} rpm" if rpm else ""
            return [
                f"{parts.source}: the mean torques leave {total:.6g} N m{at_speed} (sum"
                " of speed ratio x mean torque), must balance in a train without"
                " ground. Add a [[load]] or a [[ground]], or correct the means."
            ]
    return []

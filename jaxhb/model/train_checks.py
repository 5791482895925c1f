"""Checks of a train as a whole: connections, gears, orders and cycle, what holds the train, mean balance."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from jaxhb.model import tables
from jaxhb.model.crank import slider_crank
from jaxhb.model.graph import pieces

WHOLE = 1e-6
TEETH_TOLERANCE = 1e-3
BALANCE_TOLERANCE = 1e-9


def names_of(names, indices, most: int = 8) -> str:
    """List names for a sentence."""
    shown = ", ".join(repr(names[i]) for i in indices[:most])
    return shown + (f", … ({len(indices)} disks)" if len(indices) > most else "")


def elastic_pairs(parts) -> list[tuple[int, int]]:
    """Disk pairs of one rotor: shafts, and dampers with their rings."""
    n = len(parts.tables["disk"])
    return parts.ends("shaft") + [(d, n + k) for k, d in enumerate(parts.sits_on("damper"))]


def connection_errors(parts) -> list[str]:
    """Find pieces of the train that no link joins."""
    names = parts.disk_names
    piece = pieces(len(names), elastic_pairs(parts) + parts.ends("mesh"))
    count = max(piece) + 1
    if count == 1:
        return []
    first = [i for i, p in enumerate(piece) if p == 0]
    errors = []
    for k in range(1, count):
        other = [i for i, p in enumerate(piece) if p == k]
        errors.append(
            f"{parts.source}: the train falls into pieces that no link joins: {names_of(names, first)} and"
            f" {names_of(names, other)}. Join them by a [[shaft]] or a [[mesh]]."
        )
    return errors


def gear_errors(parts, rotor) -> list[str]:
    """Check that every mesh joins gears of two rotors, and teeth against radii."""
    errors = []
    disks = parts.tables["disk"]
    for i, (mesh, ends) in enumerate(zip(parts.tables["mesh"], parts.ends("mesh"), strict=True)):
        where = parts.where("mesh", i)
        bare = [name for name, d in zip(mesh.between, ends, strict=True) if d >= len(disks) or not disks[d].radius]
        errors += [f"{where}: disk {name!r} has no radius. Give its pitch radius in m." for name in bare]
        if rotor[ends[0]] == rotor[ends[1]]:
            errors.append(
                f"{where}: {mesh.between[0]!r} and {mesh.between[1]!r} are on one rotor, must be on two:"
                " the shafts between them lock the mesh. Remove the mesh or a shaft."
            )
        if bare:
            continue
        a, b = (disks[d] for d in ends)
        if a.teeth and b.teeth and abs(a.teeth / b.teeth * b.radius / a.radius - 1.0) > TEETH_TOLERANCE:
            errors.append(
                f"{where}: teeth {a.teeth}:{b.teeth} = {a.teeth / b.teeth:.6g} but radii"
                f" {a.radius:g}:{b.radius:g} m"
                f" = {a.radius / b.radius:.6g}; must agree to 0.1 %. Correct teeth or radii."
            )
    return errors


def reference_error(parts, reference, rotor) -> list[str]:
    """Ask for the reference where there are several rotors."""
    if reference is None and max(rotor) > 0:
        first = [parts.disk_names[rotor.index(k)] for k in range(max(rotor) + 1)]
        shown = ", ".join(repr(name) for name in first[:8])
        return [
            f"{parts.source}, [scene]: the key 'reference' is missing; there are {max(rotor) + 1} rotors."
            f" Name a disk of the rotor whose rpm is given, one of {shown}."
        ]
    return []


def loop_errors(parts, locked) -> list[str]:
    """Say which loops lock the train."""
    return [
        f"{parts.where('mesh', m)}: locked closed loop {names_of(parts.disk_names, disks)}: {why}."
        " Correct the radii, the kind of a mesh, or remove one mesh."
        for m, disks, why in locked
    ]


def whole(number: float) -> bool:
    """Tell whether a number is whole to 1e-6."""
    return abs(number - round(number)) <= WHOLE


def cycle_errors(parts, needs, revolutions: float) -> list[str]:
    """Find orders that are no whole harmonic of the cycle; ``needs``: (table, i, text, order)."""
    bad = [need for need in needs if not whole(need[3] * revolutions)]
    if not bad:
        return []
    fitting = fitting_cycle([need[3] for need in needs])
    remedy = f" Set revolutions_per_cycle = {fitting:g}." if fitting else " Correct the order or the radii."
    return [
        f"{parts.where(table, i)}: {text} is harmonic {per_revolution * revolutions:.6g} of a cycle of"
        f" {revolutions:g}"
        f" revolutions of the reference rotor, must be whole.{remedy}"
        for table, i, text, per_revolution in bad
    ]


def fitting_cycle(per_revolution) -> float | None:
    """Smallest number of revolutions (up to 1000) that makes all given harmonics per revolution whole."""
    least = 1
    for value in per_revolution:
        fraction = Fraction(value).limit_denominator(1000)
        if abs(float(fraction) - value) > 1e-9 * max(1.0, abs(value)):
            return None
        least = int(np.lcm(least, fraction.denominator))
        if least > 1000:
            return None
    return float(least)


def inertia_errors(parts) -> list[str]:
    """Find a train without any inertia."""
    heavy = [e.inertia for table in ("disk", "damper") for e in parts.tables[table]]
    if any(heavy):
        return []
    return [f"{parts.source}: the inertia of every disk is 0 kg m2. Give at least one disk an inertia."]


def mean_torques(parts, rpm) -> np.ndarray:
    """Mean torque of all given torques and cylinders on each disk at one speed, N m [n_disks]."""
    mean = np.zeros(len(parts.disk_names))

    def factor(element):
        if not element.scale:
            return 1.0
        points = np.asarray(element.scale, dtype=float)
        return np.interp(rpm, points[:, 0], points[:, 1])

    for disk, torque in zip(parts.sits_on("torque"), parts.tables["torque"], strict=True):
        mean[disk] += torque.mean * factor(torque)
    for disk, cylinder in zip(parts.sits_on("cylinder"), parts.tables["cylinder"], strict=True):
        if cylinder.fires:
            mean[disk] += mean_gas_torque(cylinder) * factor(cylinder)
    return mean


def mean_gas_torque(cylinder) -> float:
    """Mean gas torque of a cylinder at scale 1, N m."""
    if cylinder.pressure is None:
        return cylinder.gas_torque_mean or 0.0
    pressure = tables.gas_cycle(cylinder.pressure, cylinder.table_firing_tdc)
    turns = 2 if tables.is_four_stroke(cylinder.pressure) else 1
    angle = 2.0 * np.pi * turns * np.arange(pressure.size) / pressure.size
    _, x1, _ = slider_crank(angle, cylinder.stroke, cylinder.rod, xp=np)
    return float(np.mean(pressure * x1) * np.pi / 4.0 * cylinder.bore**2)


def scale_speeds(parts) -> list[float]:
    """Speeds (rpm) at which some scale has a point: balanced there is balanced everywhere."""
    elements = [*parts.tables["torque"], *parts.tables["cylinder"]]
    return sorted({float(row[0]) for e in elements for row in e.scale}) or [0.0]


def hold_errors(parts, reference_disk: int) -> list[str]:
    """Find pieces joined without static stiffness that a ground or a mean torque leaves unheld."""
    n, names = len(parts.tables["disk"]), parts.disk_names
    rings = [
        (disk, n + k)
        for k, (disk, d) in enumerate(zip(parts.sits_on("damper"), parts.tables["damper"], strict=True))
        if d.stiffness > 0
    ]
    piece = pieces(len(names), parts.ends("shaft") + parts.ends("mesh") + rings)
    grounded = {piece[d] for d in parts.sits_on("ground")}
    main = piece[reference_disk]
    errors = []
    if grounded and main not in grounded:
        held = [i for i, p in enumerate(piece) if p in grounded]
        errors.append(
            f"{parts.source}: the [[ground]] on {names_of(names, held)} holds the train only through links"
            f" without"
            f" static stiffness. Ground a disk that is joined by shafts or meshes to"
            f" {names[reference_disk]!r}."
        )
    largest = np.max([np.abs(mean_torques(parts, rpm)) for rpm in scale_speeds(parts)], axis=0)
    loaded = {piece[d] for d in parts.sits_on("load")} | {piece[d] for d in np.flatnonzero(largest)}
    for p in sorted(loaded - grounded - {main}):
        disks = [i for i, q in enumerate(piece) if q == p]
        errors.append(
            f"{parts.source}: a mean torque acts on {names_of(names, disks)}, which no static stiffness"
            f" holds."
            " Give the damper a stiffness, ground the disk, or remove the mean torque."
        )
    return errors


def balance_errors(parts, ratio) -> list[str]:
    """Check that mean torques balance where neither a ground nor a load takes what is left."""
    if parts.tables["ground"] or parts.tables["load"]:
        return []
    for rpm in scale_speeds(parts):
        power = np.asarray(ratio) * mean_torques(parts, rpm)
        total, size = power.sum(), np.abs(power).sum()
        if abs(total) > BALANCE_TOLERANCE * size:
            at = f" at {rpm:g} rpm" if rpm else ""
            return [
                f"{parts.source}: the mean torques leave {total:.6g} N m{at} (sum of speed ratio x mean"
                f" torque), must"
                " balance in a train without ground. Add a [[load]] or a [[ground]], or correct the means."
            ]
    return []

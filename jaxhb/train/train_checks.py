"""Checks of a train as a whole: connections, gears, orders and cycle, what holds the
train, mean balance.

Each check leaves out what is not known because another sentence was said about it.
"""

import math
from fractions import Fraction
from typing import Any

import numpy as np

from jaxhb.elements.elements import Combustion, Suggestions, Torque, shown
from jaxhb.equations.kinematics import OF_PERIOD
from jaxhb.excitation import gas
from jaxhb.excitation.mean_torques import mean_torques as mean_torques_at
from jaxhb.train import connections, tables
from jaxhb.train.connections import members_of, names_of, pieces

# Distance from a whole number, in harmonics of the cycle, up to which an order fits
WHOLE = 1e-6
# Share by which the ratio of radii may miss that of the teeth, which then counts
TEETH_TOLERANCE = 1e-3
BALANCE_TOLERANCE = 1e-9
"""Mean torque left over the largest up to which a train without ground balances:
rounding of the sums.
"""


def elastic_pairs(parts) -> list[tuple[int, int]]:
    """Disk pairs of one rotor: shafts, and dampers with their rings."""
    n = len(parts.tables["disk"])
    return parts.ends("shaft") + [(d, n + k) for k, d in parts.seats("damper")]


def connection_errors(parts) -> list[str]:
    """Find pieces of the train that no link joins."""
    if not parts.connected:
        return []
    names = parts.disk_names
    first, *others = members_of(
        pieces(len(names), elastic_pairs(parts) + parts.ends("mesh"))
    ) or [[]]
    return [
        f"{parts.source}: the train falls into pieces that no link joins:"
        f" {names_of(names, first)} and {names_of(names, other)}. Join them by a"
        " [[shaft]] or a [[mesh]]."
        for other in others
    ]


def gear_errors(parts, rotor) -> list[str]:
    """Check that every mesh joins gears of two rotors, and teeth against radii."""
    errors = []
    disks = parts.tables["disk"]
    for i, ends in parts.links("mesh"):
        where = parts.where("mesh", i)
        names = [parts.disk_names[d] for d in ends]
        bare = [
            parts.disk_names[d]
            for d in ends
            if d >= len(disks) or disks[d].radius is None
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
        if bare or not all(parts.usable("disk", d, "radius", "teeth") for d in ends):
            continue
        a, b = (disks[d] for d in ends)
        keys = [*OF_PERIOD, "stiffness_table", "contact_ratio", "width"]
        needing = [
            f
            for f in keys
            if parts.usable("mesh", i, f) and getattr(parts.tables["mesh"][i], f)
        ]
        bare = [
            name for name, disk in zip(names, (a, b), strict=True) if not disk.teeth
        ]
        if "width" in needing and bare or needing and len(bare) == 2:
            errors.append(
                f"{where}: {needing[-1]} is given, and {' and '.join(map(repr, bare))}"
                f" {'has' if len(bare) == 1 else 'have'} no teeth. Give"
                f" {'its number' if len(bare) == 1 else 'their numbers'} of teeth."
            )
        if (
            a.teeth
            and b.teeth
            and abs(a.teeth / b.teeth * b.radius / a.radius - 1.0) > TEETH_TOLERANCE
        ):
            # Their ratio is in doubt: it decides nothing more.
            parts.bad |= {("disk", d, "radius") for d in ends}
            errors.append(
                f"{where}: teeth {a.teeth}:{b.teeth} = {a.teeth / b.teeth:.6g} but"
                f" radii {a.radius:g}:{b.radius:g} m = {a.radius / b.radius:.6g}; must"
                " agree to 0.1 %. Correct teeth or radii."
            )
    return errors


def reference_error(parts, reference, rotor) -> list[str]:
    """Ask for the reference where there are several rotors."""
    if reference is not None or not parts.connected or max(rotor, default=0) == 0:
        return []
    first = [parts.disk_names[rotor.index(k)] for k in range(max(rotor) + 1)]
    shown = ", ".join(repr(name) for name in first[:8])
    return [
        f"{parts.source}, [scene]: the key 'reference' is missing; there are"
        f" {max(rotor) + 1} rotors. Name a disk of the rotor whose rpm is given, one of"
        f" {shown}."
    ]


def loop_errors(parts, locked) -> list[str]:
    """Say which loops lock the train."""
    return [
        f"{parts.where('mesh', m)}: locked closed loop"
        f" {names_of(parts.disk_names, disks)}: {why}. Correct the radii, the kind of a"
        " mesh, or remove one mesh."
        for m, disks, why in locked
    ]


def whole(number: float) -> bool:
    """Tell whether a number is whole to 1e-6."""
    return math.isfinite(number) and abs(number - round(number)) <= WHOLE


def cycle_errors(parts, needs, revolutions: float) -> list[str]:
    """Find orders that are no harmonic 1, 2, ... of the cycle; ``needs``: (table, i,
    text, order, key of the mean).
    """

    def is_small(need):
        return need[3] * revolutions < 0.5 and whole(need[3] * revolutions)

    bad = [need for need in needs if not whole(need[3] * revolutions)]
    fitting = (
        fitting_cycle({need[3] for need in needs if not is_small(need)})
        if bad
        else None
    )
    remedy = (
        f" Set revolutions_per_cycle = {fitting:g}."
        if fitting
        else " Correct the order or the radii."
    )
    errors = []
    for need in bad + list(filter(is_small, needs)):
        table, i, text, per_revolution, mean = need
        wanted = f"whole.{remedy}"
        if is_small(need):
            wanted = "at least 1." + (
                f" Give the mean as {mean} = …" if mean else " Correct the radii."
            )
        errors.append(
            f"{parts.where(table, i)}: {text} is harmonic"
            f" {per_revolution * revolutions:.6g} of a cycle of {revolutions:g}"
            f" revolutions of the reference rotor, must be {wanted}"
        )
    return errors


def fitting_cycle(per_revolution) -> float | None:
    """Smallest number of revolutions (up to 1000) that makes all given harmonics per
    revolution whole.
    """
    if not all(math.isfinite(value) for value in per_revolution):
        return None
    near = [Fraction(value).limit_denominator(1000) for value in per_revolution]
    fits = all(
        abs(float(n) - v) <= 1e-9 * max(1.0, abs(v))
        for n, v in zip(near, per_revolution, strict=True)
    )
    least = math.lcm(*(fraction.denominator for fraction in near))
    return float(least) if fits and least <= 1000 else None


def phase_errors(parts, ratio) -> list[str]:
    """Find phases of what is no cylinder or torque, and of what turns at different
    speeds.
    """
    errors = []
    names = {
        table: [name for name in parts.names[table] if isinstance(name, str)]
        for table in ("cylinder", "torque")
    }
    engines = sorted({name.rpartition(" ")[0] for name in names["cylinder"]} - {""})
    groups = dict.fromkeys([*names["cylinder"], *names["torque"], *engines])
    near = Suggestions(groups)
    seats = {table: dict(parts.seats(table)) for table in ("cylinder", "torque")}
    for i, phase in enumerate(parts.tables["phase"]):
        named = phase.of if isinstance(phase.of, tuple | list) else []
        errors += [
            f"{parts.where('phase', i)}: of: there is no cylinder, torque or engine"
            f" {shown(name)}.{near(name)}"
            for name in named
            if not (isinstance(name, str) and name in groups)
        ]
        if parts.usable("phase", i, "of") and not named:
            errors.append(
                f"{parts.where('phase', i)}: of is empty. Name the cylinders and"
                " torques, or their engine."
            )
        disks = [
            seats[table].get(k) for table, own in parts.phased(i).items() for k in own
        ]
        speeds = {
            round(ratio[d], 9) for d in disks if d is not None and ratio[d] is not None
        }
        if len(speeds) > 1:
            errors.append(
                f"{parts.where('phase', i)}: what it names turns at {len(speeds)}"
                " speeds, must be on one rotor. Give each rotor a [[phase]]."
            )
    return errors


def inertia_errors(parts) -> list[str]:
    """Find a train without any inertia."""
    bodies = [
        (table, i, e)
        for table in ("disk", "damper")
        for i, e in enumerate(parts.tables[table])
    ]
    known = all(parts.usable(table, i, "inertia") for table, i, _ in bodies)
    if not (bodies and known and parts.complete) or any(e.inertia for *_, e in bodies):
        return []
    return [
        f"{parts.source}: the inertia of every disk is 0 kg m2. Give at least one disk"
        " an inertia."
    ]


def _mean_fields(element) -> tuple[str, ...]:
    """Fields that the mean torque of a given torque or a cylinder comes from."""
    if isinstance(element, Torque):
        return ("mean", "scale", "rated_rpm", "speed_exponent")
    of_pressure = (*gas.COMPUTED, "load", "bore", "stroke", "rod", "table_firing_tdc")
    return (
        "fires",
        "scale",
        "fires_every",
        "gas_factor",
        "injection",
        "gas_torque_mean",
        *(of_pressure if gas.source(element) else ()),
    )


def _mean_known(parts, table: str, i: int) -> bool:
    return parts.usable(table, i, *_mean_fields(parts.tables[table][i]))


@np.errstate(over="ignore", invalid="ignore")
def mean_torques(parts, speeds) -> np.ndarray:
    """Mean torque of all given torques and cylinders on each disk, where known, N m
    [speeds, n_disks].
    """
    seats = []
    known = {}
    for table in ("torque", "cylinder"):
        found = [
            (parts.tables[table][i], disk)
            for i, disk in parts.seats(table)
            if _mean_known(parts, table, i)
        ]
        seats += [disk for _, disk in found]
        # Copies of what means come from: other fields may be faulty.
        known[table] = [
            type(e)(disk="", **{name: getattr(e, name) for name in _mean_fields(e)})
            for e, _ in found
        ]
    cylinders = known["cylinder"]
    cycles = gas.GasCycles(
        source=tuple(gas.source_word(c) for c in cylinders),
        fires=tuple(c.fires for c in cylinders),
        cut_off=(False,) * len(cylinders),
        revolutions=tuple(map(gas.gas_revolutions, cylinders)),
        every=tuple(int(c.fires_every) for c in cylinders),
    )
    given = tables.torque_table(known["torque"]), tables.cylinder_table(cylinders)
    return connections.on_disks(
        len(parts.disk_names), seats, mean_torques_at(*given, cycles, speeds)
    )


def scale_speeds(parts) -> list[float]:
    """Speeds (rpm) at which a scale, a load or traces have a point, or a torque its
    rated speed.
    """
    found = set()
    for table in ("torque", "cylinder"):
        for i, e in enumerate(parts.tables[table]):
            names = [
                name
                for name in ("scale", "load", "traces", "rated_rpm")
                if parts.usable(table, i, name)
            ]
            sound: dict[str, Any] = {name: getattr(e, name, None) for name in names}
            found |= {
                float(row[0])
                for name in ("scale", "load")
                for row in sound.get(name) or ()
            }
            found |= {float(trace.rpm) for trace in sound.get("traces") or ()}
            if parts.usable(table, i, "combustion") and isinstance(
                getattr(e, "combustion", None), Combustion
            ):
                found |= {float(row[0]) for row in e.combustion.charge_over_rpm}
            found |= (
                {float(sound["rated_rpm"])}
                if sound.get("rated_rpm") is not None
                else set()
            )
    return sorted(found) or [0.0]


def hold_errors(parts, main: int | None) -> list[str]:
    """Find pieces joined without static stiffness that a ground or a mean torque leaves
    unheld.
    """
    if main is None or not parts.connected:
        return []
    n = len(parts.tables["disk"])
    dampers = parts.tables["damper"]
    rings = [
        (disk, n + k)
        for k, disk in parts.seats("damper")
        if not parts.usable("damper", k, "stiffness")
        or dampers[k].stiffness > 0
        or dampers[k].order is not None
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
def balance_errors(parts, ratio) -> list[str]:
    """Check that mean torques balance where neither a ground nor a load takes what is
    left.
    """
    if parts.tables["ground"] or parts.tables["load"] or not parts.complete:
        return []
    for table in ("torque", "cylinder"):
        count = len(parts.tables[table])
        if len(parts.seats(table)) < count or not all(
            _mean_known(parts, table, i) for i in range(count)
        ):
            return []
    speeds = scale_speeds(parts)
    for rpm, mean in zip(speeds, mean_torques(parts, speeds), strict=True):
        if any(ratio[d] is None for d in np.flatnonzero(mean)):
            return []
        power = np.array([ratio[d] * mean[d] for d in np.flatnonzero(mean)])
        total = power.sum()
        size = np.abs(power).sum()
        if abs(total) > BALANCE_TOLERANCE * size:
            at = f" at {rpm:g} rpm" if rpm else ""
            return [
                f"{parts.source}: the mean torques leave {total:.6g} N m{at} (sum of"
                " speed ratio x mean torque), must balance in a train without ground."
                " Add a [[load]] or a [[ground]], or correct the means."
            ]
    return []

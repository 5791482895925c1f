"""Notes on numbers that the format allows and an engineer would look at twice: each
names element, value and usual range.

A number far outside of the values in engines and gears is nearly always in another
unit, has the other sign, or is counted from another angle. The ranges are wide: they
hold from model engines to ship diesels.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb._jax import Number, on_host, refuse_tracers
from jaxhb.elements.elements import OF_GEARS, OF_PERIOD
from jaxhb.elements.excitations import EXCITATIONS
from jaxhb.excitation import gas
from jaxhb.excitation.mean_torques import gas_pressures, mean_gas_torques
from jaxhb.excitation.tables import COMPUTED
from jaxhb.train import connections
from jaxhb.train.excitation import main_speed, speeds as speeds_of
from jaxhb.train.kinematics import tooth_damping_ratios
from jaxhb.train.varying import tables_at

if TYPE_CHECKING:
    from jaxhb.train.drivetrain import DriveTrain

    Note = tuple[str, str, str]
    """Table and name of an element, and the text."""
    Usual = tuple[float, float, str, str]
    """Least and most of a number, its unit and the question of a note."""

_NOT_MM = "is it in m, not in mm?"
_NOT_BAR = "is it in Pa, not in bar?"
MOST_ERROR = 2e-4  # m, of a transmission error or runout: the coarsest gears

USUAL: dict[str, Usual] = {
    "bore": (0.02, 1.2, "m", _NOT_MM),
    "stroke": (0.02, 4.5, "m", _NOT_MM),
    "rod": (0.03, 8.0, "m", _NOT_MM),
    "ambient_pressure": (3e4, 1e6, "Pa", _NOT_BAR),
    "combustion.charge_pressure": (2e4, 1e6, "Pa", _NOT_BAR),
    "combustion.imep": (2e4, 6e6, "Pa", _NOT_BAR),
    # Of a cycle: from an engine that is turned without firing to the strongest diesels.
    "the largest pressure": (5e5, 4e7, "Pa", "is it in Pa, not in bar or MPa?"),
    # Overload is 1.1.
    "load": (
        0.0,
        2.0,
        "",
        "it is a share of the mean effective pressure at full load, not percent",
    ),
    # A soft rubber has 0.3.
    "loss_factor": (0.0, 1.0, "", "is it in percent?"),
    # Of gears, from instruments to the bull gears of ships, and of their teeth, from
    # precision to module 20 mm.
    "radius": (2e-3, 2.0, "m", _NOT_MM),
    # From the couplings of instruments to a line of ship shafts.
    "length": (1e-3, 60.0, "m", _NOT_MM),
    # The heat that rubber dampers, viscous dampers and couplings give off.
    "power_limit": (10.0, 1e6, "W", "is it in W, not in kW?"),
    "backlash": (2e-5, 1e-3, "m", _NOT_MM),
}
"""Least and most of numbers, with their unit and the question of a note."""

PEAK_ANGLE = -15.0, 45.0
"""deg after firing top dead centre: the pressure of compression alone is largest just
before, late firing after.
"""
ATMOSPHERE = 3e4, 2.2e5
"""Pa, least pressure of a cycle that tells absolute pressures: overpressures fall to 0,
and those of a charged engine that stay above may be either.
"""
# Share by which a charge pressure may change with the power without a note
CHARGE_CHANGE = 0.05
TOGETHER = 1.0  # deg between two firings that count as one
INERTIA_OF_MEDIAN = 500.0
"""Inertia over the median of the disks of the rotor: 400 for a car behind its gearbox
on a crankshaft.
"""
MEDIAN_OF_STIFFNESS = 1000.0
"""The median of the shafts of a rotor over a stiffness: 560 for a dual-mass flywheel
beside crank throws.
"""
MASS_PER_CUBE = 200.0, 2e4
"""kg/m3, reciprocating mass over the cube of the bore: about 500 in racing engines,
1500 in cars, 1e4 in crossheads of strokes as long as the bore; the most is over bore x
bore x stroke where the stroke is that of a crosshead engine.
"""
LONG_STROKE = 1.5
"""Stroke over bore from which on an engine has crossheads."""
COMPRESSOR_ANGLE = -90.0, 5.0
"""deg after top dead centre: a compressor discharges at its largest pressure before
it.
"""
LEAST_OF_COMPRESSOR = 1.1e5
"""Pa, the largest pressure of a cycle of a blower."""
SLENDERNESS = 300.0
"""Length over outer diameter of a shaft between two disks: 100 for a quill shaft."""
INERTIA_OF_SIZE = 300.0
"""Inertia over that of a steel cylinder as long as its radius, of a throw as large as
bore or stroke or of all gears of a train as large as their pitch circles: 0.1 to 30,
more where engines are lumped into one disk.
"""
STEEL = 7850.0  # kg/m3
STIFF = 1e10, 5e12
"""N m/rad per m3, the stiffer half of the shafts of a rotor in line over the cube of
the radius of a steel cylinder, as long as its radius, that has all inertia of the
rotor: 4e9 is a steel shaft of half its diameter and length; engines have 1e7 to 1e8,
cams 2e9; what is above the second number is stiff on purpose.
"""
STIFFNESS_OF_MEDIAN = 300.0
"""A stiffness over the median of the shafts of its rotor."""
INTERNAL_RATIO = 1.02
"""Radius of a ring gear over that of the gear inside it, at least."""
STIFFNESS_OF_WIDTH = 2e10
"""N/m per m of face width: c_gamma = 20 N/(mm um), the mean stiffness of steel teeth in
ISO 6336-1, method C.
"""
WIDTH_OF_DIAMETER = 0.01, 2.0
"""Face width over the pitch diameter of the smaller gear: 0.05 to 1.5 as built, less
where gear bodies yield.
"""
TOOTH_DAMPING = 0.005, 0.3
"""Damping ratio of the two gears alone: 0.03 to 0.17 as measured (Kasuba and Evans
1981; Lin, Huston and Coy 1988).
"""
# To write 2e-5 and 1e6 as an engineer does, not 2e-05 and 1e+06.
_EXPONENT = re.compile(r"(?<=\d)e\+?(-?)0*(?=\d)")


def plausibility(train: DriveTrain) -> list[str]:
    """Find numbers of a train, not traced, that are allowed but far from usual: a note
    for each, empty where none is.

    The notes of the scene come first, as on the parts of a file of another program that
    were not read. Notes on numbers name the elements, the value and the usual range: of
    sizes, pressures and their angles, firings, masses, loads, torques that drive, disks
    and shafts far from the others of their rotor, loss factors, gears and their teeth.

    >>> train = jaxhb.load_scene("gear_train_30")
    >>> plausibility(train)
    []
    >>> wide = train.replace({"crank gear|idler.backlash": 0.15})
    >>> plausibility(wide)[0].split(": ", 1)[1]
    'backlash is 0.15 m, usual 2e-5 to 0.001 m: is it in m, not in mm?'
    """
    refuse_tracers("plausibility", train, host=True)
    train = on_host(train)
    train = tables_at(train, main_speed(train))
    of_cylinders = _sizes, _masses, _pressures, _charges, _firings, _drives
    of_links = _disks, _inertias, _shafts, _links, _meshes, _internal
    alike: dict[tuple[str, str], list[str]] = {}
    for table, name, text in (
        note for rule in (*of_cylinders, *of_links) for note in rule(train)
    ):
        alike.setdefault((table, text), []).append(name)
    notes = [
        f"[[{table}]] {connections.names_of(names, range(len(names)))}: {text}"
        for (table, text), names in alike.items()
    ]
    return [*train.topology.notes, *notes]


def _far(value: Number, limits: tuple[float, float] | Usual) -> bool:
    """Whether a value is outside of limits."""
    return not limits[0] <= value <= limits[1]


def _unusual(
    table: str, name: str, quantity: str, value: Number, usual: Usual | None = None
) -> Iterator[Note]:
    """The note, or none, on a number of an element outside of its usual range, by
    default that of :data:`USUAL`.
    """
    low, high, unit, question = usual or USUAL[quantity]
    if _far(value, (low, high)):
        unit = f" {unit}" if unit else ""
        text = f"{quantity} is {value:.4g}{unit}, usual {low:.2g} to {high:.2g}{unit}"
        remark = f": {question}" if question else ""
        yield table, name, _EXPONENT.sub(r"e\1", text) + remark


def _sizes(train: DriveTrain) -> Iterator[Note]:
    """Notes on fields of cylinders in other units; a field that is 0 is absent."""
    cylinders = train.cylinders
    names = train.topology.cylinder_names
    for field in (
        "bore",
        "stroke",
        "rod",
        "ambient_pressure",
        "combustion.charge_pressure",
        "combustion.imep",
    ):
        outer, _, inner = field.rpartition(".")
        table: Any = getattr(cylinders, outer) if outer else cylinders
        seats: Sequence[int] = range(len(names))
        if outer:
            seats = () if table is None else table.seats
        for i, value in zip(seats, getattr(table, inner, ()), strict=True):
            absent = value == 0 or (field == "rod" and cylinders.stroke[i] == 0)
            if not absent and _far(abs(value), USUAL[field]):  # an imep may be negative
                yield from _unusual("cylinder", names[i], field, value)


def _masses(train: DriveTrain) -> Iterator[Note]:
    """Notes on reciprocating masses that are unusual for their bore."""
    cylinders = train.cylinders
    for i, name in enumerate(train.topology.cylinder_names):
        mass = cylinders.reciprocating_mass[i]
        bore = cylinders.bore[i]
        if not 0 < bore < 2 * USUAL["bore"][1] or not cylinders.stroke[i]:
            continue  # the note on a bore in mm says enough
        question = (
            "is it in kg, of one cylinder?"
            if mass
            else "without it there is no inertia torque"
        )
        stroke_factor = (
            cylinders.stroke[i] / bore
            if cylinders.stroke[i] > LONG_STROKE * bore
            else 1.0
        )
        usual = (
            MASS_PER_CUBE[0] * bore**3,
            MASS_PER_CUBE[1] * bore**3 * stroke_factor,
            "kg",
            question,
        )
        in_mm = f" kg for a bore of {1e3 * bore:.4g} mm:"
        for table, _, text in _unusual(
            "cylinder", name, "reciprocating_mass", mass, usual
        ):
            yield table, name, text.replace(" kg:", in_mm)


def _pressures(train: DriveTrain) -> Iterator[Note]:
    """Notes on load, size and angle of the largest pressure, and on the pressure on the
    other side of the piston, over the speeds.
    """
    topology = train.topology
    cylinders = train.cylinders
    percent = _in_percent(train)
    for i, value in percent.items():
        yield from _unusual("cylinder", topology.cylinder_names[i], "load", value)
    # [speed, cylinder, angle] Pa from firing top dead centre on, at the speeds at which
    # torques have a point.
    cycles = gas_pressures(cylinders, topology.cylinders, speeds_of(train))
    if not cycles.shape[-1]:
        return
    peaks = cycles.max(axis=(0, 2))
    least = cycles.min(axis=2).max(axis=0)
    period = 360.0 * np.array(topology.cylinders.revolutions)
    angles = cycles.argmax(axis=2) * period / cycles.shape[-1]
    # In the second half of the cycle the next firing is nearer: angles before it are
    # negative.
    angles -= period * (angles > period / 2)
    farthest = np.abs(angles - np.mean(PEAK_ANGLE)).argmax(axis=0)
    compressing = compressors(train)
    for i, name in enumerate(topology.cylinder_names):
        peak = peaks[i]
        angle = angles[farthest[i], i]
        source = topology.cylinders.source[i]
        if source not in COMPUTED:
            continue
        if i not in percent and peak > 0:
            low, high, unit, question = USUAL["the largest pressure"]
            if i in compressing:
                low = LEAST_OF_COMPRESSOR
            usual = (low, high, unit, question)
            yield from _unusual("cylinder", name, "the largest pressure", peak, usual)
        if peak > 0 and i not in compressing and _far(angle, PEAK_ANGLE):
            where = f"{abs(angle):.4g} deg {'after' if angle > 0 else 'before'}"
            span = f"{-PEAK_ANGLE[0]:g} deg before to {PEAK_ANGLE[1]:g} deg after"
            question = "is table_firing_tdc the angle at which the table fires?"
            if source == "combustion":
                question = "do start and duration count from there?"
            text = f"the pressure is largest {where} firing top dead centre, usual"
            yield "cylinder", name, f"{text} {span}: {question}"
        # Models give absolute pressures, tables may give overpressures.
        if not cylinders.ambient_pressure[i] and (
            source == "combustion" or not _far(least[i], ATMOSPHERE)
        ):
            question = (
                "the pressure in the cylinder is absolute, and the crankcase has about"
                " 1e5 Pa"
            )
            low, high, unit, _ = USUAL["ambient_pressure"]
            usual = (low, high, unit, question)
            yield from _unusual("cylinder", name, "ambient_pressure", 0.0, usual)


def _charges(train: DriveTrain) -> Iterator[Note]:
    """Notes on charge pressures that follow the power because nothing else is known."""
    combustion = train.cylinders.combustion
    speeds = speeds_of(train)
    speeds = speeds[speeds > 0.0]  # absent scales have a point at 0
    if combustion is None or not len(speeds):
        return
    charge, _ = gas.charge_pressures(train.cylinders, speeds)
    loads = gas.load_share(train.cylinders, speeds)
    for k, i in enumerate(combustion.seats):
        slowest = int(charge[:, k].argmin())
        full = float(combustion.charge_pressure[k])
        if (
            combustion.charge_by[k]
            or abs(charge[slowest, k] / full - 1.0) < CHARGE_CHANGE
        ):
            continue
        text = (
            f"the charge pressure follows the power: {charge[slowest, k]:.4g} Pa at"
            f" {speeds[slowest]:g} rpm"
        )
        text += f" (load {loads[slowest, i]:.3g}), {full:.4g} Pa at full load"
        text = _EXPONENT.sub(r"e\1", text)
        question = "give charge_over_load or charge_over_rpm where it is known"
        yield "cylinder", train.topology.cylinder_names[i], f"{text}: {question}"


def compressors(train: DriveTrain) -> set[int]:
    """Cylinders that take power and have their largest pressure before every top dead
    centre.
    """
    topology = train.topology
    speeds = speeds_of(train)
    one_revolution = np.array(topology.cylinders.revolutions, dtype=int) == 1
    computed = np.array(
        [source in COMPUTED for source in topology.cylinders.source], dtype=bool
    )
    if not (one_revolution & computed).any():
        return set()
    cycles = gas_pressures(train.cylinders, topology.cylinders, speeds)
    angles = cycles.argmax(axis=2) * 360.0 / cycles.shape[-1]
    angles -= 360.0 * (angles > 180.0)
    peaks_before = (
        (angles >= COMPRESSOR_ANGLE[0]) & (angles <= COMPRESSOR_ANGLE[1])
    ).all(axis=0)
    means = mean_gas_torques(train.cylinders, topology.cylinders, speeds)
    takes_power = (means < 0.0).all(axis=0)
    return set(
        np.flatnonzero(one_revolution & computed & peaks_before & takes_power).tolist()
    )


def _firings(train: DriveTrain) -> Iterator[Note]:
    """Notes on cylinders of one rotor that fire at the same angle of its cycle."""
    topology = train.topology
    factor = train.cylinders.gas_factor
    cranks: dict[tuple[int, float], list[tuple[float, str]]] = {}
    for i, name in enumerate(topology.cylinder_names):
        if topology.cylinders.fires[i] and (factor is None or factor[i] > 0):
            computed = topology.cylinders.source[i] in COMPUTED
            gas_turns = topology.cylinders.revolutions[i] * topology.cylinders.every[i]
            turns = gas_turns if computed else topology.cylinders.turn[i]
            crank = cranks.setdefault(
                (topology.rotor[topology.cylinders.disk[i]], 360.0 * turns), []
            )
            crank.append((train.cylinders.firing_angle[i] % (360.0 * turns), name))
    for (_, cycle), firings in cranks.items():
        together: dict[tuple[str, ...], float] = {}
        for angle, _ in firings:
            firing_together = [
                name
                for other_angle, name in firings
                if abs((other_angle - angle + cycle / 2) % cycle - cycle / 2) < TOGETHER
            ]
            together.setdefault(tuple(firing_together), angle)
        for names, angle in together.items():
            even = (
                f"usual one every {cycle:g} / {len(firings)} ="
                f" {cycle / len(firings):.4g} deg"
            )
            text = (
                f"they fire together, at {angle:g} deg, {even}: has each its own"
                " firing_angle?"
            )
            yield from (("cylinder", name, text) for name in names if len(names) > 1)


def _drives(train: DriveTrain) -> Iterator[Note]:
    """Notes on torques that drive though cylinders do."""
    topology = train.topology
    if not any(topology.cylinders.fires):
        return
    speeds = speeds_of(train)
    of_gas = mean_gas_torques(train.cylinders, topology.cylinders, speeds)
    # Cylinders that take power are those of a compressor, which a torque drives.
    if not of_gas.sum(axis=1).max() > 0:
        return
    means = EXCITATIONS["torque"].means(train.torques, topology.torques, speeds)
    for name, mean in zip(
        topology.torque_names, means.max(axis=0, initial=0.0), strict=True
    ):
        if mean > 0:
            question = "what takes power has a negative mean"
            text = f"it drives with a mean of {mean:.4g} N m, usually below 0 with"
            yield "torque", name, f"{text} cylinders: {question}"


def _in_percent(train: DriveTrain) -> dict[int, float]:
    """Largest load of the cylinders that have it in percent, by their number; traces
    may count in percent as well.
    """
    cylinders = train.cylinders
    traces = train.cylinders.traces
    most = USUAL["load"][1]
    if cylinders.load_share is None:
        return {}
    alike: set[int] = set()
    if traces is not None:
        sizes = zip(traces.seats, traces.load, traces.sizes, strict=True)
        alike = {seat for seat, load, (_, loads) in sizes if load[:loads].max() > most}
    largest = enumerate(cylinders.load_share.max(axis=-1).tolist())
    return {i: value for i, value in largest if value > most and i not in alike}


def _by_rotor(
    rotor: Sequence[int] | np.ndarray, values: np.ndarray
) -> Iterator[tuple[np.ndarray, float]]:
    """Elements of each rotor with values above 0, and the median of these."""
    for number in sorted(set(rotor)):
        members = np.flatnonzero((np.array(rotor) == number) & (values > 0))
        if members.size:
            yield members, np.median(values[members])


def _above_median(train: DriveTrain) -> Iterator[tuple[int, float]]:
    """Disks whose inertia is far above the median of their rotor, and this median."""
    topology = train.topology
    inertia = train.disks.inertia
    for members, median in _by_rotor(topology.rotor[: topology.n_scene_disks], inertia):
        yield from (
            (int(i), median)
            for i in members[inertia[members] > INERTIA_OF_MEDIAN * median]
        )


def _disks(train: DriveTrain) -> Iterator[Note]:
    """Notes on inertias far above the others of their rotor, and on the radii of
    gears.
    """
    topology = train.topology
    disks = train.disks
    for i, median in _above_median(train):
        usual = (
            f"{INERTIA_OF_MEDIAN:g} times the median of its rotor, {median:.4g} kg m2"
        )
        text = (
            f"inertia is {disks.inertia[i]:.4g} kg m2, usual up to {usual}: is it in kg"
            " m2, not in kg cm2?"
        )
        yield "disk", topology.disk_names[i], text
    for i in sorted({disk for ends in topology.mesh_ends for disk in ends}):
        yield from _unusual("disk", topology.disk_names[i], "radius", disks.radius[i])


def _size(inertia: float) -> float:
    """Radius (m) of a steel cylinder as long as its radius that has an inertia."""
    return (2.0 * inertia / (np.pi * STEEL)) ** 0.2


def _inertias(train: DriveTrain) -> Iterator[Note]:
    """Notes on throws far too heavy for their bore, and on gears that are all far too
    heavy for their radius: whole trains in other units, which medians do not show.
    """
    topology = train.topology
    inertia = train.disks.inertia
    question = "is it in kg m2, not in kg cm2?"
    sizes = np.maximum(train.cylinders.bore, train.cylinders.stroke) / 2.0
    throws = {
        disk: size
        for disk, size in zip(topology.cylinders.disk, sizes, strict=True)
        if size > 0.0
    }
    gears = {
        disk: train.disks.radius[disk] for ends in topology.mesh_ends for disk in ends
    }
    noted = {i for i, _ in _above_median(train)}
    for measure, radii in {"bore and stroke": throws, "pitch circle": gears}.items():
        usual = {
            disk: INERTIA_OF_SIZE * np.pi / 2.0 * STEEL * radius**5
            for disk, radius in radii.items()
        }
        heavy = [
            disk
            for disk, most in usual.items()
            if disk < topology.n_scene_disks and inertia[disk] > most
        ]
        if len(heavy) == len(radii):
            for disk in heavy if noted.isdisjoint(heavy) else ():
                text = (
                    f"inertia is {inertia[disk]:.4g} kg m2, usual up to"
                    f" {usual[disk]:.2g} kg m2 for its {measure}: {question}"
                )
                yield "disk", topology.disk_names[disk], _EXPONENT.sub(r"e\1", text)


def _shafts(train: DriveTrain) -> Iterator[Note]:
    """Notes on shafts too long, and on stiffnesses that no shaft between disks of this
    size has.
    """
    topology = train.topology
    shafts = train.shafts
    for i, name in enumerate(topology.shaft_names if shafts.length is not None else ()):
        length = shafts.length[i]
        outer = shafts.outer[i]
        low, high, unit, question = USUAL["length"]
        if length > 0.0:
            most = min(high, SLENDERNESS * outer)
            usual = (min(low, most), most, unit, question)
            yield from _unusual("shaft", name, "length", length, usual)
    inertia = np.concatenate([train.disks.inertia, train.dampers.inertia])
    rotor = np.array(
        [topology.rotor[first] for first, _ in topology.shaft_ends], dtype=int
    )
    for members, median in _by_rotor(rotor, shafts.stiffness):
        cube = _size(inertia[np.array(topology.rotor) == rotor[members[0]]].sum()) ** 3
        least = STIFF[0] * cube
        most = STIFF[1] * cube
        stiffer = shafts.stiffness[members]
        in_line = 1.0 / (1.0 / stiffer[stiffer >= median]).sum()
        single = (
            shafts.stiffness[members] > max(least, STIFFNESS_OF_MEDIAN * median)
        ) & (shafts.stiffness[members] < most)
        for i in members if least < in_line < most else members[single]:
            text = (
                f"stiffness is {shafts.stiffness[i]:.4g} N m/rad, usual up to"
                f" {least:.2g} N m/rad for these inertias"
            )
            yield (
                "shaft",
                topology.shaft_names[i],
                _EXPONENT.sub(r"e\1", f"{text}: is it in N m/rad, not in N mm/rad?"),
            )


def _links(train: DriveTrain) -> Iterator[Note]:
    """Notes on shafts far softer than the others of their rotor or with limits for
    other shafts than cranks, and on loss factors.
    """
    topology = train.topology
    stiffness = train.shafts.stiffness
    strengths = train.shafts.tensile_strength
    for members, median in _by_rotor(
        [topology.rotor[first] for first, _ in topology.shaft_ends], stiffness
    ):
        for i in members[MEDIAN_OF_STIFFNESS * stiffness[members] < median]:
            usual = (
                f"at least 1/{MEDIAN_OF_STIFFNESS:g} of the median of its rotor,"
                f" {median:.4g} N m/rad"
            )
            text = (
                f"stiffness is {stiffness[i]:.4g} N m/rad, usual {usual}: is it in N"
                " m/rad, not in kN m/rad?"
            )
            yield "shaft", topology.shaft_names[i], _EXPONENT.sub(r"e\1", text)
    for table, links in (("shaft", train.shafts), ("damper", train.dampers)):
        for name, value in zip(
            topology.names_of(table), links.loss_factor, strict=True
        ):
            yield from _unusual(table, name, "loss_factor", value)
        for name, value in zip(
            topology.names_of(table),
            _or_empty(links.power_limit),
            strict=False,
        ):
            if value > 0.0:
                yield from _unusual(table, name, "power_limit", value)
    throws = set(topology.cylinders.disk)
    for i, ends in enumerate(topology.shaft_ends if strengths is not None else ()):
        rule = topology.rule_of(i)
        if strengths[i] and throws.issuperset(ends) and not rule.crankshafts:
            text = (
                f"tensile_strength sets the limits of {rule.title or rule.name}, which"
                " do not hold for crankshafts: UR M53 does,"
            )
            yield (
                "shaft",
                topology.shaft_names[i],
                f"{text} and it lies between two disks with cylinders",
            )


def _or_empty(vector: np.ndarray | None) -> Iterable[Any]:
    """Numbers of a field over its elements, none where no element has it."""
    return () if vector is None else vector


def _internal(train: DriveTrain) -> Iterator[Note]:
    """Notes on ring gears that are no larger than the gears inside them."""
    topology = train.topology
    for name, ends, internal in zip(
        topology.mesh_names, topology.mesh_ends, topology.mesh_internal, strict=True
    ):
        small, large = sorted(float(train.disks.radius[disk]) for disk in ends)
        if internal and large < INTERNAL_RATIO * small:
            text = (
                f"its gears have radii of {small:.4g} and {large:.4g} m, and kind is"
                " 'internal'"
            )
            yield (
                "mesh",
                name,
                f"{text}: a ring is larger than the gear inside it; is it external?",
            )


def _meshes(train: DriveTrain) -> Iterator[Note]:
    """Notes on errors, backlash, stiffness and damping of meshes."""
    topology = train.topology
    meshes = train.meshes
    ratios = tooth_damping_ratios(train)
    for field in (OF_PERIOD[1], *OF_GEARS):
        for i, rows in enumerate(_or_empty(getattr(meshes, field))):
            amplitude = np.hypot(rows[:, 0], rows[:, 1]).max(initial=0.0)
            yield from _unusual(
                "mesh",
                topology.mesh_names[i],
                f"the largest amplitude of {field}",
                amplitude,
                (0.0, MOST_ERROR, "m", "is it in m, not in um?"),
            )
    for i in np.flatnonzero(topology.mesh_backlash).tolist():
        radii = train.disks.radius[list(topology.mesh_ends[i])]
        name = topology.mesh_names[i]
        yield from _unusual("mesh", name, "backlash", meshes.backlash[i])
        if any(_far(radius, USUAL["radius"]) for radius in radii):
            continue  # the note on the radius says enough
        size = 2 * radii.min()
        question = (
            f"steel teeth on a gear of {1e3 * size:.4g} mm have 20 N/(mm um) of their"
            " face width; is it in N/m?"
        )
        usual = (
            STIFFNESS_OF_WIDTH * WIDTH_OF_DIAMETER[0] * size,
            STIFFNESS_OF_WIDTH * WIDTH_OF_DIAMETER[1] * size,
            "N/m",
            question,
        )
        stiff = list(_unusual("mesh", name, "stiffness", meshes.stiffness[i], usual))
        yield from stiff
        if np.isfinite(ratios[i]) and not stiff:
            quantity = (
                f"damping is {meshes.damping[i]:.4g} N s/m: the damping ratio of the"
                " two gears alone"
            )
            low, high = TOOTH_DAMPING
            yield from _unusual("mesh", name, quantity, ratios[i], (low, high, "", ""))

"""Check of a scene before anything vibrates: mean torques, tooth forces, damping,
notes, referred numbers.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from jaxhb._jax import Array
from jaxhb.design.quantities import check_all
from jaxhb.design.table import read_table
from jaxhb.design.tolerances import read_tolerances
from jaxhb.elements.sentences import SceneError
from jaxhb.equations.fourier import sample
from jaxhb.excitation.gas import charge_pressures, load_share
from jaxhb.excitation.mean_torques import mean_gas_torques
from jaxhb.excitation.tables import COMPUTED, TANGENTIAL
from jaxhb.linear.cylinders.tangential import TangentialTable
from jaxhb.linear.strength import train_of
from jaxhb.report.files.output import Sheet
from jaxhb.report.table import Column, Table
from jaxhb.report.text.columns import NONE, fixed, plain_number
from jaxhb.report.text.mean_torques import torque_notes, torques_of
from jaxhb.report.text.sentences import firing_lines, once_alike
from jaxhb.results.motion import ROUNDING
from jaxhb.results.response import Response
from jaxhb.train.checks.plausible import plausibility
from jaxhb.train.connections import names_of
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import (
    excited_disks,
    line_owners,
    lines_at,
    main_speed,
    mean_torques,
    speeds as excitation_speeds,
)
from jaxhb.train.kinematics import (
    Referred,
    referred,
    speed_ratios,
    tooth_damping_ratios,
)
from jaxhb.train.mesh_parameters import all_meshes
from jaxhb.train.topology import Topology
from jaxhb.train.varying import archer_damping, tables_at

ANY_SPEED = 1000.0  # rpm, where no torque depends on the speed
FEW = 2  # names of cylinders alike that are all told
LARGE = (1e7, "M"), (1e5, "k")  # largest number of a column from which it has a prefix
PREFIXES = {"": 1.0, "k": 1e3, "M": 1e6}
SAMPLES = 8192  # of a cycle, at which the stiffness of a mesh is looked at


def referred_tables(train: DriveTrain) -> list[Table]:
    """Inertias, stiffnesses and dampings, actual and referred to the reference rotor;
    tables of those that the train has. Numbers over the speed stand there as they are
    at the speed of the scene.
    """
    over_speed = over_speed_table(train)
    train = at_own_speed(train)
    numbers = referred(train)
    topology = train.topology
    damping = np.zeros(len(numbers.factor))
    stiffness = np.zeros(len(numbers.factor))
    damping[: len(train.disks.damping)] = train.disks.damping
    np.add.at(
        stiffness, np.array(topology.ground_disk, dtype=int), train.grounds.stiffness
    )
    # Of a train that turns with one speed referred values are the actual ones.
    several = len({*topology.rotor}) > 1
    disks: dict[str, Any] = {"disk": numbers.disks}
    if several:
        disks["speed ratio i"] = numbers.factor
    disks["J kg m2"] = numbers.inertia
    if several:
        disks["J i^2"] = numbers.inertia_referred
    to_ground = []
    for quantity, letter, unit, values in (
        ("damping", "r", "N m s/rad", damping),
        ("stiffness", "k", "N m/rad", stiffness),
    ):
        if values.any():
            to_ground.append(quantity)
            scaled, power = _prefixed(values)
            disks[f"{letter} {power}{unit}"] = scaled
            if several:
                disks[f"{letter} i^2"] = scaled * numbers.factor**2
    more = f", {' and '.join(to_ground)} to ground" if to_ground else ""
    actual = ", actual and referred to the reference rotor" if several else ""
    tables = [_numbers(f"{topology.title}: inertias{more}{actual}", disks)]
    if numbers.links:
        kinds = [
            kind
            for kind in ("shaft", "damper", "mesh")
            for _ in topology.names_of(kind)
        ]
        links: dict[str, Any] = {"link": numbers.links}
        if len({*kinds}) > 1:
            links["kind"] = kinds
        if several:
            links["factor i"] = numbers.link_factor
        torsional = len(numbers.links) - len(topology.mesh_names)
        of_meshes = []
        for letter, unit, of_links, of_reference in (
            ("k", "N m/rad", numbers.stiffness, numbers.stiffness_referred),
            ("r", "N m s/rad", numbers.damping, numbers.damping_referred),
        ):
            scaled, power = _prefixed(of_links[:torsional])
            of_teeth, power_of_teeth = _prefixed(of_links[torsional:])
            links[f"{letter} {power}{unit}"] = np.append(scaled, of_teeth)
            if several:
                links[f"{letter} i^2"] = np.asarray(of_reference) / PREFIXES[power]
            of_meshes.append(
                f"{power_of_teeth}{unit.replace('N m', 'N').replace('rad', 'm')}"
            )
        remark = (
            f"; of meshes in {' and '.join(of_meshes)}, their factor is i x radius in m"
        )
        loss = [*train.shafts.loss_factor, *train.dampers.loss_factor]
        if any(loss):
            links["loss factor"] = loss + [NONE] * len(topology.mesh_names)
        tables.append(
            _numbers(
                "Stiffness k and damping r of links"
                + remark * bool(topology.mesh_names),
                links,
                left="kind",
            )
        )
    varying = [*_order_table(train, numbers), *_varying_table(train, numbers)]
    return [*tables, *varying, *over_speed]


def _prefixed(values: Array) -> tuple[np.ndarray, str]:
    """Numbers in thousands or millions of their unit where the largest is as large, and
    the prefix of the unit.

    >>> _prefixed(np.array([2.5e7, 5e6]))
    (array([25.,  5.]), 'M')
    """
    numbers = np.asarray(values, float)
    largest = float(np.max(np.abs(numbers), initial=0.0))
    power = next((power for least, power in LARGE if largest >= least), "")
    return numbers / PREFIXES[power], power


def at_own_speed(train: DriveTrain) -> DriveTrain:
    """The train with its numbers over the speed as they are at the rated speed, else at
    the highest at which the scene gives a torque.
    """
    return tables_at(train, main_speed(train))


def over_speed_table(train: DriveTrain) -> list[Table]:
    """The table of the numbers that depend on the speed, in a list."""
    columns: dict[str, list] = defaultdict(list)
    for table, name, field, rows in _over_speed(train):
        unit = "N s/m" if table == "mesh" else "N m s/rad"
        if field == "stiffness":
            unit = "N/m" if table == "mesh" else "N m/rad"
        for rpm, value in rows:
            columns["element"].append(name)
            columns["of it"].append(field)
            columns["rpm"].append(rpm)
            columns["value"].append(value)
            columns["unit"].append(unit)
    if not columns:
        return []
    caption = (
        "Damping and stiffness over the speed of the reference rotor; other tables have"
        f" them at {main_speed(train):g} rpm"
    )
    topology = train.topology
    loads: Any = train.loads
    sources = [
        f"; {topology.disk_names[disk]}: Archer's formula (Proc. IMechE 164, 1951), a ="
        f" {loads.archer[load]:g}, in proportion to the speed"
        for load, disk in zip(topology.archer_loads, topology.archer_disks, strict=True)
    ]
    return [_numbers(caption + "".join(sources), columns, left="of it")]


def _over_speed(train: DriveTrain) -> Iterator[tuple[str, str, str, list]]:
    """Table, name, "damping" or "stiffness" and rows (rpm, value) of each number that
    depends on the speed; of propellers up to the rated speed of their law.
    """
    topology = train.topology
    loads: Any = train.loads
    for table, field, i, count in topology.rpm_tables:
        rows = getattr(train.table(table), f"{field}_over_rpm")[i, :count]
        yield table, topology.names_of(table)[i], field, np.asarray(rows).tolist()
    for load, disk in zip(topology.archer_loads, topology.archer_disks, strict=True):
        rated_rpm = float(loads.rated_rpm[load])
        damping = float(archer_damping(train, rated_rpm)[disk])
        rows = [[0.0, 0.0], [rated_rpm, damping]]
        yield "disk", topology.disk_names[disk], "damping", rows


def _numbers(
    title: str, columns: Mapping[str, Sequence[Any] | Array], left: str | None = None
) -> Table:
    """A table of columns by their heads: names, and numbers of six digits; ``left`` is
    the head of words.
    """

    def six_digits(cell: str | float) -> str:
        return cell if isinstance(cell, str) else f"{cell:.6g}"

    specs = [Column(head, six_digits, left=head == left) for head in columns]
    return Table(title, specs, zip(*columns.values(), strict=True))


def _order_table(train: DriveTrain, numbers: Referred) -> list[Table]:
    """The table of order-tuned dampers, in a list."""
    tuned = np.flatnonzero(numbers.order)
    if not len(tuned):
        return []
    names = train.topology.damper_names
    rings = len(train.disks.inertia) + tuned
    rate = numbers.order_referred[tuned] * 2 * np.pi / 60
    growth = numbers.inertia[rings] * rate**2
    return [
        _numbers(
            "Order-tuned dampers: stiffness that is added per square of the speed of"
            " the reference rotor",
            {
                "link": [names[i] for i in tuned],
                "order n": numbers.order[tuned],
                "n i": numbers.order_referred[tuned],
                "N m/rad/rpm2": growth,
                "i^2 of it": growth * numbers.factor[rings] ** 2,
            },
        )
    ]


def _varying_table(train: DriveTrain, numbers: Referred) -> list[Table]:
    """The table of links that vary, as stiffness and damping, in a list."""
    topology = train.topology
    shafts = len(train.topology.shaft_names)
    columns: dict[str, list] = defaultdict(list)
    for field, links in (
        ("over_hz", topology.hz_links),
        ("over_amplitude", topology.amplitude_links),
    ):
        for i in links:
            table, k = (train.shafts, i) if i < shafts else (train.dampers, i - shafts)
            factor = numbers.link_factor[i]
            knots = map(tuple, np.asarray(getattr(table, field)[k]).tolist())
            for place, stiffer, damped in dict.fromkeys(knots):
                stiffness = stiffer * numbers.stiffness[i]
                damping = damped * numbers.damping[i]
                row = {
                    "link": numbers.links[i],
                    "over": field,
                    "at": place,
                    # Angles referred to the reference rotor are phi / i; frequencies
                    # are the same for all.
                    "referred": place if field == "over_hz" else place / factor,
                    "k N m/rad": stiffness,
                    "k i^2": stiffness * factor**2,
                    "r N m s/rad": damping,
                    "r i^2": damping * factor**2,
                    "loss factor": damped * table.loss_factor[k],
                }
                for head, cell in row.items():
                    columns[head].append(cell)
    if not columns:
        return []
    return [
        _numbers(
            "Links that vary: stiffness, damping and loss factor at the frequencies"
            " (Hz) or amplitudes (rad) of their rows",
            columns,
            left="over",
        )
    ]


def own_speeds(train: DriveTrain) -> list[float] | None:
    """The lowest and the highest speed, rpm, at which the scene gives a torque; None
    where none depends on it.
    """
    speeds = excitation_speeds(train)
    speeds = speeds[speeds > 0.0]
    return sorted({float(speeds[0]), float(speeds[-1])}) if len(speeds) else None


MOST_OF_RATED = 20.0  # a mean torque over the rated torque that no gear is built for


def scene_notes(responses: Sequence[Response]) -> list[str]:
    """All notes on a scene, of its mean motion at some speeds."""
    train = train_of(responses[0])
    speeds = [float(response.rpm) for response in responses]
    outside = once_alike(
        (rpm, note) for rpm in speeds for note in train.outside_traces(rpm)
    )
    return (
        plausibility(train)
        + torque_notes(responses)
        + _rated_notes(responses)
        + outside
    )


def _rated_notes(responses: Sequence[Response]) -> list[str]:
    """Notes on rated torques of meshes that are far below the mean torque of their
    first gear.
    """
    train = train_of(responses[0])
    if train.meshes.rated_torque is None:
        return []
    sentences = []
    topology = train.topology
    for i, name in enumerate(topology.mesh_names):
        radius = float(train.disks.radius[topology.mesh_ends[i][0]])
        rated = float(train.meshes.rated_torque[i])
        force = max(abs(float(response.force(name).mean)) for response in responses)
        mean = force * radius
        if 0.0 < rated < mean / MOST_OF_RATED:
            sentences.append(
                f"[[mesh]] {name!r}: rated_torque is {plain_number(rated)} N m, and the"
                f" mean torque of its first gear {plain_number(mean)} N m: is it in"
                " N m, not in kN m?"
            )
    return sentences


def table_notes(train: DriveTrain) -> list[str]:
    """Notes on what ``jaxhb tune`` and ``jaxhb tolerance`` would refuse in their tables
    of the scene.
    """

    def tune() -> None:
        settings = read_table(train)
        check_all(
            train,
            settings["parameters"],
            settings["objective"],
            settings["penalties"],
            settings["rpm"],
        )

    checks: dict[str, Callable[[], Any]] = {
        "tune": tune,
        "tolerance": lambda: read_tolerances(train),
    }
    notes = []
    for name, check in checks.items():
        try:
            if getattr(train, name):
                check()
        except SceneError as error:
            notes += [
                f"jaxhb {name} will refuse this scene: {sentence}"
                for sentence in error.sentences
            ]
    return notes


def check_text(
    train: DriveTrain,
    responses: Sequence[Response],
    speeds: Sequence[float] | None,
    notes: Sequence[str],
) -> list[str]:
    """Head, mean torques and teeth of linear ``responses``; ``speeds`` None where no
    torque depends on them.
    """
    topology = train.topology
    places = [f"at {rpm:g} rpm" for rpm in speeds] if speeds else ["at any speed"]
    torque_means = [Column(place, "mean", unit="N m") for place in places]
    force_means = [Column(place, "mean", unit="N") for place in places]
    verdict = (
        f"{len(notes)} note{'s' * (len(notes) != 1)} below" if notes else "no notes"
    )
    head = f"{topology.title}: {_counts(topology)}; {verdict}."
    parts = ["\n".join([head, *firing_lines(train)])]
    torques = [
        [name, disk, *means] for name, disk, means in torque_rows(train, responses)
    ]
    if torques:
        parts.append(
            Table(
                "Mean torque on the disk's own shaft, {N m} (positive: drives)",
                ["", Column("disk", left=True), *torque_means],
                torques,
            )
        )
    parts += _cylinder_tables(train, speeds, places)
    parts += _line_table(train, speeds, places)
    parts += _charge_table(
        train, [float(response.rpm) for response in responses], places
    )
    parts += over_speed_table(train)
    ratios = tooth_damping_ratios(at_own_speed(train))
    rows = [
        [
            name,
            *(abs(mean) for mean in _means(responses, name)),
            _drivers(responses, i),
            f"{1e3 * backlash:.4g}" if topology.mesh_backlash[i] else NONE,
            fixed(float(ratios[i]), 4),
        ]
        for i, (name, backlash) in enumerate(
            zip(topology.mesh_names, train.meshes.backlash, strict=True)
        )
    ]
    if rows:
        parts.append(
            Table(
                "Mean tooth force, {N}, backlash, and damping ratio of the two gears"
                " alone",
                ["mesh", *force_means, "driven by", "backlash mm", "damping ratio"],
                rows,
            )
        )
    meshing = _over_period(train)
    if meshing:
        parts.append(
            Table(
                "Over the mesh period: order of the reference rotor, stiffness in % of"
                " its mean, errors of all kinds",
                ["mesh", "order", "least %", "most %", "error p-p um"],
                meshing,
            )
        )
    return parts


def lines_of(
    train: DriveTrain, speeds: Sequence[float]
) -> list[tuple[str, float, list[float]]]:
    """Torque, frequency in Hz and amplitude in N m at some speeds of every line at a
    fixed frequency.
    """
    hz, coefficients = lines_at(train, np.array(speeds))
    amplitudes = 2 * np.abs(np.asarray(coefficients))
    return list(
        zip(
            line_owners(train.topology),
            np.asarray(hz).tolist(),
            amplitudes.T.tolist(),
            strict=True,
        )
    )


def _line_table(
    train: DriveTrain, speeds: Sequence[float] | None, places: Sequence[str]
) -> list[Table]:
    """The table of lines at fixed frequencies, in a list."""
    lines = lines_of(train, speeds or [ANY_SPEED])
    rows = [[name, f"{hz:g}", *sizes] for name, hz, sizes in lines]
    caption = (
        "Lines of torques at fixed frequencies, amplitude in {N m}; jaxhb forced takes"
        " them, and jaxhb.transient"
    )
    amplitudes = [Column(place, "amplitude", unit="N m") for place in places]
    return [Table(caption, ["", "Hz", *amplitudes], rows)] if rows else []


def _over_period(train: DriveTrain) -> list[list[str]]:
    """A row for every mesh whose stiffness varies, or that has errors."""
    topology = train.topology
    meshes = all_meshes(train)
    rows = []
    for i, name in enumerate(topology.mesh_names):
        if name not in topology.meshing:
            continue
        variation, error = (
            np.zeros(1)
            if coefficients is None
            else sample(np.asarray(coefficients)[i], SAMPLES)
            for coefficients in (meshes.variation, meshes.error)
        )
        order = topology.mesh_periods[i] / topology.revolutions_per_cycle
        rows.append(
            [
                name,
                f"{order:g}" if order else NONE,
                f"{100 * (1 + variation.min()):.3g}",
                f"{100 * (1 + variation.max()):.3g}",
                f"{1e6 * np.ptp(error):.3g}",
            ]
        )
    return rows


def charges_of(
    train: DriveTrain, speeds: Sequence[float]
) -> dict[str, tuple[list[float], list[float]]]:
    """Load and charge pressure (bar) over the speeds of the cylinders with a
    combustion, by their names.
    """
    burning = train.cylinders.combustion
    if burning is None:
        return {}
    rpm = np.array(speeds, dtype=float)
    loads = load_share(train.cylinders, rpm)
    charge, _ = charge_pressures(train.cylinders, rpm)
    names = train.topology.cylinder_names
    return {
        names[i]: (loads[:, i].tolist(), (1e-5 * charge[:, k]).tolist())
        for k, i in enumerate(burning.seats)
    }


def _charge_table(
    train: DriveTrain, speeds: Sequence[float], places: Sequence[str]
) -> list[Table]:
    """A row for cylinders with the same loads and charge pressures, in a list; empty
    where all run at full load.
    """
    alike: dict[tuple[tuple[float, ...], tuple[float, ...]], list[str]] = {}
    for name, (load, charge) in charges_of(train, speeds).items():
        alike.setdefault((tuple(load), tuple(charge)), []).append(name)
    constant = [set(load) == {1.0} and len(set(charge)) == 1 for load, charge in alike]
    if all(constant):
        return []
    rows = [
        [names_of(names, range(len(names))), *load, *charge]
        for (load, charge), names in alike.items()
    ]
    return [
        Table(
            "Load (share of the mean effective pressure at full load) and charge"
            " pressure, bar, of the combustion",
            [
                "cylinder",
                *(Column(f"load {place}", "load") for place in places),
                *(Column(f"charge {place}", "charge") for place in places),
            ],
            rows,
        )
    ]


def check_record(
    train: DriveTrain, responses: Sequence[Response], notes: Sequence[str]
) -> dict[str, Any]:
    """The record of ``check --json`` but for the modes, SI units, lists over the
    speeds; ratios of two gears alone.
    """
    constant = at_own_speed(train)
    ratios = tooth_damping_ratios(constant)
    speeds = [float(response.rpm) for response in responses]
    over_rpm = {f"{name}.{field}": rows for _, name, field, rows in _over_speed(train)}
    lines = [
        {"torque": name, "hz": hz, "amplitude_Nm": amplitudes}
        for name, hz, amplitudes in lines_of(train, speeds)
    ]
    optional: dict[str, Any] = {"over_rpm": over_rpm, "lines": lines}
    return {key: values for key, values in optional.items() if values} | {
        "scene": train.topology.name,
        "rpm": speeds,
        "mean_torque_Nm": {
            name: means for name, _, means in torque_rows(train, responses)
        },
        "meshes": {
            name: {
                "mean_force": _means(responses, name),
                "damping_ratio": ratios[i],
                "stiffness": constant.meshes.stiffness[i],
                "damping": constant.meshes.damping[i],
                "backlash": train.meshes.backlash[i],
            }
            for i, name in enumerate(train.topology.mesh_names)
        },
        "not_firing": train.not_firing(),
        "cylinders": cylinders_of(train, speeds),
        "combustion": {
            name: {"load": load, "charge_pressure_Pa": [1e5 * bar for bar in charge]}
            for name, (load, charge) in charges_of(train, speeds).items()
        },
        "notes": notes,
    }


def cylinders_of(
    train: DriveTrain, speeds: Sequence[float]
) -> dict[str, dict[str, Any]]:
    """Mass, crank and firing of the cylinders by their names, and over the speeds the
    mean indicated pressure (Pa) and the power of the gas (W); None where the scene does
    not tell.
    """
    topology = train.topology
    seats = topology.cylinders
    numbers = train.cylinders
    rpm = np.array(speeds, dtype=float)
    means = np.asarray(mean_gas_torques(numbers, seats, rpm))
    ratio = np.asarray(speed_ratios(train))[np.array(topology.rotor, dtype=int)]
    cylinders = {}
    for i, name in enumerate(seats.names):
        stroke = float(numbers.stroke[i])
        swept = float(np.pi / 4 * numbers.bore[i] ** 2) * stroke
        turns = seats.revolutions[i] * seats.every[i]
        has_cycle = swept > 0 and seats.source[i] in (*COMPUTED, TANGENTIAL)
        work = 2 * np.pi * turns * means[:, i]
        speed = 2 * np.pi / 60 * ratio[seats.disk[i]] * rpm
        cylinders[name] = {
            "firing_deg": float(numbers.firing_angle[i]),
            "reciprocating_mass_kg": float(numbers.reciprocating_mass[i]) or None,
            "crank_radius_m": 0.5 * stroke or None,
            "swept_volume_m3": swept or None,
            "imep_Pa": (work / swept).tolist() if has_cycle else None,
            "power_W": (means[:, i] * speed).tolist(),
        }
    return cylinders


def _cylinder_tables(
    train: DriveTrain, speeds: Sequence[float] | None, places: Sequence[str]
) -> list[str]:
    """A row for cylinders with the same numbers, and when each fires, in a list;
    ``speeds`` None where no torque depends on them.
    """
    rated = train.topology.rated_rpm
    cylinders = cylinders_of(train, speeds or [rated or ANY_SPEED])
    if not cylinders:
        return []
    columns: list[Column | str] = ["cylinder", "kg", "radius mm", "litre"]
    # Where torques do not depend on the speed, only the rated one tells a power.
    with_power = bool(speeds or rated)
    power_head = "kW" if speeds or not rated else f"kW at {rated:g} rpm"
    for place in places:
        columns.append(Column("imep bar", group=place))
        columns += [Column(power_head, group=place if speeds else "")] * with_power
    alike: dict[tuple[str, ...], list[str]] = {}
    for name, numbers in cylinders.items():
        cells = [
            _scaled(numbers["reciprocating_mass_kg"], 1.0),
            _scaled(numbers["crank_radius_m"], 1e3),
            _scaled(numbers["swept_volume_m3"], 1e3),
        ]
        pressures = numbers["imep_Pa"] or [None] * len(places)
        for pressure, power in zip(pressures, numbers["power_W"], strict=True):
            cells.append(_scaled(pressure, 1e-5))
            cells += [_scaled(power, 1e-3)] * with_power
        alike.setdefault(tuple(cells), []).append(name)
    firing = sorted(cylinders, key=lambda name: cylinders[name]["firing_deg"])
    angles = ", ".join(f"{name} {cylinders[name]['firing_deg']:g}" for name in firing)
    return [
        Table(
            "Of each cylinder: reciprocating mass, crank radius, swept volume, and of"
            f" its gas the mean indicated pressure{' and the power' * with_power}",
            columns,
            [[_together(names), *cells] for cells, names in alike.items()],
        ),
        f"Firing angles, deg of the crank: {angles}.",
    ]


def _together(names: Sequence[str]) -> str:
    """Names of cylinders alike, of many the first and the last."""
    if len(names) <= FEW:
        return ", ".join(names)
    return f"{names[0]} ... {names[-1]} ({len(names)} alike)"


def _scaled(number: float | None, factor: float) -> str:
    """A number of four digits in another unit, none where there is none."""
    return NONE if number is None else f"{factor * number:.4g}"


def tangential_text(table: TangentialTable) -> Table:
    """Tangential pressures by order, of every mean indicated pressure."""
    columns: list[Column | str] = [Column("order", "{:g}".format)]
    rows = [[order] for order in table.orders.tolist()]
    parts = zip(
        table.imep,
        1e-6 * table.amplitude,
        table.phase_deg,
        1e-6 * table.cosine,
        1e-6 * table.sine,
        strict=True,
    )
    for imep, amplitudes, phases, cosines, sines in parts:
        group = f"p_mi {1e-6 * imep:.4g} N/mm2" if imep else "compression alone"
        columns += [
            Column("N/mm2", "{:.4f}".format, group=group),
            Column("deg", "{:.1f}".format, group=group),
            Column("cosine", "{:+.4f}".format, group=group),
            Column("sine", "{:+.4f}".format, group=group),
        ]
        for row, *numbers in zip(rows, amplitudes, phases, cosines, sines, strict=True):
            row += numbers
    return Table(
        f"Tangential pressure of {table.cylinder} at {table.rpm:g} rpm: amplitude x"
        " cos(order x crank angle from firing + phase), p_mi: mean indicated pressure",
        columns,
        rows,
    )


def tangential_record(table: TangentialTable) -> dict[str, Any]:
    """The part of ``check --excitation --json``, lists by mean indicated pressure."""
    return {
        "cylinder": table.cylinder,
        "rpm": table.rpm,
        "stroke_cycle": table.stroke_cycle,
        "orders": table.orders,
        "imep_Pa": table.imep,
        "amplitude_Pa": table.amplitude,
        "phase_deg": table.phase_deg,
        "cosine_Pa": table.cosine,
        "sine_Pa": table.sine,
    }


def tangential_sheet(table: TangentialTable) -> Sheet:
    """Rows as ``cosine_sine`` of a scene reads them."""
    return Sheet(["order", "imep Pa", "cosine Pa", "sine Pa"], table.rows())


def _counts(topology: Topology) -> str:
    """How many elements of each kind there are, in words."""
    numbers = {"disk": topology.n_scene_disks, "rotor": topology.n_rotors}
    for kind in ("shaft", "mesh", "damper", "cylinder"):
        numbers[kind] = len(topology.names_of(kind))
    texts = {
        kind: f"{number} {kind}{('es' if kind == 'mesh' else 's') * (number != 1)}"
        for kind, number in numbers.items()
        if number
    }
    if "mesh" in texts:
        texts["mesh"] += f" ({sum(topology.mesh_backlash)} with backlash)"
    return ", ".join(texts.values())


def torque_rows(
    train: DriveTrain, responses: Sequence[Response]
) -> list[tuple[str, str, list[float]]]:
    """(name, disk, means over the speeds in N m) of torques of the scene, cylinders,
    loads and grounds.
    """
    topology = train.topology
    speeds = np.array([response.rpm for response in responses], dtype=float)
    means = mean_torques(train, speeds).T.tolist()
    loads = [torques_of(response, "load") for response in responses]
    grounds = [torques_of(response, "ground") for response in responses]
    means += [[load[name] for load in loads] for name in topology.load_names]
    means += [[-ground[name] for ground in grounds] for name in topology.ground_names]
    names = [
        *(name for seats in topology.excitations for name in seats.names),
        *topology.load_names,
        *topology.ground_names,
    ]
    seats = [*excited_disks(topology), *topology.load_disk, *topology.ground_disk]
    return [
        (name, topology.disk_names[seat], row)
        for name, seat, row in zip(names, seats, means, strict=True)
    ]


def _drivers(responses: Sequence[Response], mesh: int) -> str:
    """The gear that drives a mesh; of several speeds both, where it is not always the
    same.
    """
    topology = responses[0].topology
    first, second = (topology.disk_names[disk] for disk in topology.mesh_ends[mesh])
    means = _means(responses, topology.mesh_names[mesh])
    least = ROUNDING * max(map(abs, means), default=0.0)
    drivers = dict.fromkeys(
        first if mean > 0 else second for mean in means if abs(mean) > least
    )
    return " or ".join(drivers) or NONE


def _means(responses: Sequence[Response], mesh: str) -> list[float]:
    """Mean tooth force in N of a mesh at every speed."""
    return [float(response.force(mesh).mean) for response in responses]

"""Parts of the page on the subject: the train, what excites and loads it, assumptions,
versions.
"""

import dataclasses
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from jaxhb.elements.declared import facts_of, unit_of
from jaxhb.excitation.gas import GAS_SAMPLES
from jaxhb.excitation.mean_torques import gas_pressures, mean_gas_torques, scale_at
from jaxhb.report.figures.draw import as_svg
from jaxhb.report.figures.equivalent import equivalent_system
from jaxhb.report.figures.sketch import MOST, plot_train
from jaxhb.report.orders import order_names
from jaxhb.report.page.differences import value_text
from jaxhb.report.page.judgement import linear_accuracy
from jaxhb.report.page.parts import (
    Block,
    Heading,
    Report,
    Sketch,
    Strip,
    environment,
    table,
    without,
)
from jaxhb.report.table import Column, Table
from jaxhb.report.text.columns import NONE, alike, plain_number
from jaxhb.report.text.mean_torques import mean_angles_of
from jaxhb.report.text.scene_check import charges_of, referred_tables, torque_rows
from jaxhb.report.units import shown_unit
from jaxhb.train.drivetrain import DriveTrain

# Units in which engineers read numbers of a scene
UNITS = {"m": (1e3, "mm"), "Pa": (1e-5, "bar")}
OWN = (
    "disk",
    "firing_angle",
)  # fields in which cylinders that are told together differ
SPEEDS = 8  # speeds of a table, of more those that are spread evenly over them

UNSAID = {"fires": True, "fires_every": 1}
"""Facts of a cylinder that go without saying."""

OF_GAS = (
    "cylinder",
    "rpm",
    "factor",
    "load",
    "charge bar",
    "largest pressure bar",
    "deg after firing TDC",
    "imep bar",
)
"""Heads of the table of gas before the mean torque, of which a train without them has
not all.
"""

Value = TypeVar("Value")


def train_data(report: Report) -> list[Block]:
    """Show the equivalent system and the sketch, numbers as they are and referred,
    meshes, excitation and loads of the train.
    """
    drawn = equivalent_system(report.train)
    tables = [*map(without, referred_tables(report.train)), _meshes(report.train)]
    return [
        Heading(drawn.caption),
        *map(Strip, drawn.strips),
        *_sketch(report.train),
        *filter(None, tables),
        *excitation_tables(report),
    ]


def _sketch(train: DriveTrain) -> list[Block]:
    """Draw the sketch of a train with gears, in a list; the equivalent system shows
    other trains.
    """
    if not train.topology.mesh_names or train.topology.n_disks > MOST:
        return []
    # Inside HTML an SVG has no XML head.
    _, svg, rest = as_svg(plot_train(train)).partition("<svg")
    return [Sketch(svg + rest)]


def _meshes(train: DriveTrain) -> Table | None:
    """Make a table of the meshes; None without."""
    topology = train.topology
    meshes = train.meshes
    radius = 1e3 * np.asarray(train.disks.radius)
    rows = []
    for i, ends in enumerate(topology.mesh_ends):
        teeth = [topology.teeth[disk] for disk in ends]
        law = (
            [1e3 * meshes.backlash[i], meshes.epsilon[i], meshes.transition[i]]
            if topology.mesh_backlash[i]
            else [np.nan, np.nan, np.nan]
        )
        rows.append(
            [
                topology.mesh_names[i],
                "internal" if topology.mesh_internal[i] else "external",
                " : ".join(plain_number(radius[disk], 6) for disk in ends),
                " : ".join(map(str, teeth)) if all(teeth) else NONE,
                *(float(f"{value:.4g}") for value in law),
                topology.mesh_damping_law[i],
            ]
        )
    return table(
        "Meshes: epsilon is the stiffness in the gap over that in contact, transition"
        " its width over the backlash",
        rows,
        [
            "mesh",
            "kind",
            "radii mm",
            "teeth",
            "backlash mm",
            "epsilon",
            "transition",
            "damping law",
        ],
    )


def excitation_tables(report: Report) -> list[Table]:
    """Make tables of excitation and loads of the train: as the scene has them, gas and
    mean torques over the speed, orders. Of cylinders that differ in nothing but their
    firing angle and their throw the first stands for all.
    """
    names = report.train.topology.cylinder_names
    first: dict[str, str] = {}
    first_of_facts: dict[tuple, str] = {}
    for name, files in zip(
        names, report.files.get("cylinder") or [{}] * len(names), strict=True
    ):
        facts = [
            (key, value)
            for key, (value, _) in facts_of(report.elements[name]).items()
            if key not in OWN
        ]
        first[name] = first_of_facts.setdefault((*facts, *files.items()), name)
    tables = [
        *_cylinders(report, first),
        _rows_of(
            report,
            "torque",
            "Torques given by their orders, before the factors over the speed",
        ),
        _rows_of(report, "load", "Loads, which balance the mean power"),
        _rows_of(report, "ground", "Grounds"),
        _gas(report, first),
        _means(report, first),
        *_orders(report, first),
    ]
    return [table for table in tables if table is not None]


def _columns_of(report: Report, kind: str) -> dict[str, dict[str, str]]:
    """Write the facts that the scene gives of the elements of a kind: cells by name, by
    heads; without facts that it gives of none.
    """
    names = report.train.topology.names_of(kind)
    columns: dict[str, dict[str, str]] = defaultdict(dict)
    for name, files in zip(
        names, report.files.get(kind) or [{}] * len(names), strict=True
    ):
        facts = facts_of(report.elements[name])
        for key, (value, field) in facts.items():
            said = value not in (None, "", ()) and not value == 0 == field.default
            if said and UNSAID.get(key) != value:
                factor, unit = UNITS.get(unit_of(field), (1.0, unit_of(field)))
                words = key.replace("_", " ").replace(".", ": ")
                # Some names end with their unit, as rated_rpm.
                if words.lower().endswith(f" {unit.lower()}"):
                    words = words[: -len(unit) - 1]
                head = f"{words} {unit}".rstrip()
                columns[head][name] = _cell(value, field, factor, files.get(key))
        for key in files.keys() - facts.keys():
            columns[f"files of {key}"][name] = files[key]
    return columns


def _cell(value: Any, field: dataclasses.Field, factor: float, file: str | None) -> str:
    """Write a number or word; of rows how many there are, their range and their
    file.
    """
    if field.metadata["kind"] != "rows":
        shown = value if isinstance(value, str | bool) else factor * value
        return value_text(shown, 6)
    spans = [
        f"{column} {min(numbers):.6g} to {max(numbers):.6g}"
        for column, numbers in zip(
            field.metadata["columns"], np.transpose(value), strict=True
        )
        if column not in ("Re", "Im")
    ]
    return ", ".join(filter(None, [f"{len(value)} rows", *spans, file]))


def _rows_of(report: Report, kind: str, title: str) -> Table | None:
    """Make a table with a row for each element of a kind; None without."""
    columns = _columns_of(report, kind)
    names = report.train.topology.names_of(kind)
    rows = [
        (name, *(cells.get(name, NONE) for cells in columns.values())) for name in names
    ]
    return table(title, rows, [kind, *columns])


def _cylinders(
    report: Report, first: Mapping[str, str]
) -> tuple[Table | None, Table | None]:
    """Make tables of where the cylinders sit and fire, and of their numbers, a column
    for those that have the same.

    first : of every cylinder the first one alike
    """
    columns = _columns_of(report, "cylinder")
    different = list(dict.fromkeys(first.values()))
    disks = columns.pop("disk", {})
    angles = columns.pop("firing angle deg", {})
    rows = [(name, disks[name], angles.get(name, "0"), first[name]) for name in first]
    numbers = [
        (head, *(cells.get(name, NONE) for name in different))
        for head, cells in columns.items()
    ]
    return (
        table(
            "Cylinders", rows, ["cylinder", "disk", "firing angle deg", "numbers as of"]
        ),
        table(
            "Numbers of the cylinders; angles of the combustion count from firing top"
            " dead centre, rows are in SI units and deg",
            numbers,
            ["", *different],
        ),
    )


def _some(values: Sequence[Value]) -> list[Value]:
    """Take SPEEDS of a list, its ends among them."""
    places = np.round(np.linspace(0, len(values) - 1, SPEEDS)).astype(int)
    return [values[place] for place in np.unique(places)]


def _gas(report: Report, first: Mapping[str, str]) -> Table | None:
    """Make a table of load, charge and peak pressure, its angle, mean effective
    pressure and mean torque of the cylinders over the speed.
    """
    topology = report.train.topology
    cylinders = report.train.cylinders
    rpm = _some(report.rpm)
    speeds = np.array(rpm)
    gas_factor = (
        np.ones(len(first))
        if cylinders.gas_factor is None
        else np.asarray(cylinders.gas_factor)
    )
    factors = gas_factor * scale_at(cylinders, speeds)
    pressures = gas_factor[:, None] * gas_pressures(
        cylinders, topology.cylinders, speeds
    )
    rows: list[dict[str, Any]] = []
    charges = charges_of(report.train, rpm)
    means = mean_gas_torques(cylinders, topology.cylinders, speeds)
    factor, unit = shown_unit("N m", float(np.max(np.abs(means), initial=0.0)))
    mean_torque = f"mean torque {unit}"
    for i in sorted({topology.cylinder_names.index(name) for name in first.values()}):
        name = topology.cylinder_names[i]
        turns = topology.cylinders.revolutions[i]
        period = 360.0 * turns
        swept = np.pi / 4 * cylinders.bore[i] ** 2 * cylinders.stroke[i]
        for k, speed in enumerate(speeds):
            row = {"cylinder": name, "rpm": f"{speed:g}", "factor": factors[k, i]}
            if name in charges:
                load, charge = charges[name]
                row |= {"load": load[k], "charge bar": charge[k]}
            if topology.cylinders.computed[i]:
                place = int(np.argmax(pressures[k, i]))
                angle = place * period / GAS_SAMPLES
                angle -= period * (angle > period / 2)
                # Work of a gas cycle over the swept volume.
                imep = (
                    1e-5
                    * 2
                    * np.pi
                    * turns
                    * topology.cylinders.every[i]
                    * means[k, i]
                    / swept
                )
                row |= {
                    "largest pressure bar": 1e-5 * pressures[k, i, place],
                    "deg after firing TDC": f"{angle:.1f}",
                    "imep bar": imep,
                }
            rows.append(row | {mean_torque: factor * means[k, i]})
    heads = [*OF_GAS, mean_torque]
    heads = [head for head in heads if any(head in row for row in rows)]
    remark = "; load: mean effective pressure over that at full load" * (
        "load" in heads
    )
    return table(
        f"Gas over the speed; of equal cylinders the first stands for all{remark}",
        [[row.get(head, NONE) for head in heads] for row in rows],
        heads,
        digits=4,
    )


def _means(report: Report, first: Mapping[str, str]) -> Table | None:
    """Make a table of the mean torques of everything that drives and takes power, and
    of the power of the loads, over the speed.
    """
    answers = _some(report.cases[0].answers)
    rows = torque_rows(report.train, [answer.linear for answer in answers])
    rows = [row for row in rows if first.get(row[0], row[0]) == row[0]]
    if not rows:
        return None
    largest = max(max(map(abs, means)) for _, _, means in rows)
    factor, unit = shown_unit("N m", largest)
    # Torques of a cylinder and of a propeller may differ by a factor of a hundred.
    texts = [alike([factor * mean for mean in means])[0] for _, _, means in rows]
    table_rows = [
        [name, disk, *means] for (name, disk, _), means in zip(rows, texts, strict=True)
    ]
    if report.train.topology.load_names:
        loads = [plain_number(float(answer.balance.load_kW)) for answer in answers]
        table_rows.append(["power of the loads, kW", NONE, *loads])
    return Table(
        f"Mean torques over the speed, {unit} (positive: drives); of equal cylinders"
        " the first stands for all",
        ["element", "disk", *(f"{answer.rpm:g} rpm" for answer in answers)],
        table_rows,
    )


def _orders(report: Report, first: Mapping[str, str]) -> list[Table]:
    """Make tables of the orders that the scene gives: of torques, of gas torques, of
    loads; those with the same amplitudes in a table.
    """
    train = report.train
    topology = train.topology
    number_of = order_names(train).number
    sources = [
        (name, "N m", harmonics, values)
        for name, harmonics, values in zip(
            topology.torque_names,
            topology.torques.harmonics,
            train.torques.harmonics,
            strict=True,
        )
    ]
    sources += [
        (f"gas torque of {name}, firing at 0", "N m", harmonics, values)
        for name, harmonics, values in zip(
            topology.cylinder_names,
            topology.cylinders.harmonics,
            train.cylinders.gas_torque,
            strict=True,
        )
        if first[name] == name
    ]
    if train.loads.harmonics is not None:
        sources += [
            (name, "over the mean", harmonics, values)
            for name, harmonics, values in zip(
                topology.load_names,
                topology.load_harmonics,
                train.loads.harmonics,
                strict=True,
            )
        ]
    # Sources of the same orders and amplitudes: (order, complex amplitude) by name.
    groups: dict[tuple, dict[str, list[tuple[float, complex]]]] = defaultdict(dict)
    for name, unit, harmonics, values in sources:
        amplitudes = [complex(*value) for value in values[: len(harmonics)]]
        orders = np.divide(harmonics, topology.revolutions_per_cycle)
        rows = sorted(zip(orders, amplitudes, strict=True), key=lambda row: row[0])
        same = tuple((order, f"{abs(value):.6g}") for order, value in rows)
        groups[unit, same][name] = rows
    tables = []
    for (unit, same), rows_by_name in groups.items():
        if not same:
            continue
        rows = next(iter(rows_by_name.values()))
        names = list(rows_by_name)
        several = len(names) > 1
        phases = [
            [f"{np.degrees(np.angle(x)):.1f}" if x else NONE for _, x in of_source]
            for of_source in rows_by_name.values()
        ]
        called = (
            f"{len(names)} torques with the same amplitudes" if several else names[0]
        )
        tables.append(
            Table(
                f"Orders of {called}: A cos(order x angle + p), angle of the reference"
                " rotor",
                [
                    "order",
                    Column(f"A {unit}", "size"),
                    *(
                        Column(name if several else "p deg", group="p deg" * several)
                        for name in names
                    ),
                ],
                [
                    [number_of(order), abs(value), *cells]
                    for (order, value), *cells in zip(rows, *phases, strict=True)
                ],
            )
        )
    return tables


def assumptions(report: Report) -> list[Block]:
    """Say what holds for every number of the page, and where it comes from."""
    template = environment().get_template("assumptions.txt")
    text = template.render(report=report, means=mean_angles_of)
    facts = dict(report.facts)
    if report.is_linear:
        facts.pop("accuracy", None)  # of harmonic balance, which has no part in it
    return [
        *filter(None, text.splitlines()),
        *linear_accuracy(report),
        Table("Where this page comes from", ["", ""], facts.items()),
    ]

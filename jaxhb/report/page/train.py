"""Parts of the page on what was computed: the train, what excites and loads it,
assumptions, versions.
"""

import io
import re
from collections import defaultdict

import numpy as np

from jaxhb.elements.elements import facts_of, unit_of
from jaxhb.excitation.gas import GAS_SAMPLES
from jaxhb.excitation.mean_torques import gas_pressures, mean_torques, scale_at
from jaxhb.report.figures.sketch import plot_train
from jaxhb.report.orders import order_names
from jaxhb.report.page.differences import value_text
from jaxhb.report.page.parts import Sketch, environment, table
from jaxhb.report.text.columns import NONE, Table, alike, plain_number
from jaxhb.report.text.mean_torques import mean_angles_of
from jaxhb.report.text.scene_check import charges_of, referred_tables, torque_rows

UNITS = {
    "m": (1e3, "mm"),
    "Pa": (1e-5, "bar"),
}  # in which numbers of a scene are told, as engineers read them
OWN = ("disk", "firing_angle")  # in what cylinders differ that are told together
SPEEDS = 8  # speeds of a table, of more those that are spread evenly over them


def train_data(report):
    """Sketch, numbers as they are and referred, meshes, what excites and what loads the
    train.
    """
    try:
        content = io.StringIO()
        # The page has a date of its own.
        plot_train(report.train).savefig(content, format="svg", metadata={"Date": None})
        # Inside HTML an SVG has no XML head.
        sketch = Sketch(
            re.sub(r"\A.*?(?=<svg)", "", content.getvalue(), flags=re.DOTALL)
        )
    except ValueError as error:
        sketch = f"No sketch: {error}"
    tables = [
        *referred_tables(report.train),
        _meshes(report.train),
        *excitation_tables(report),
    ]
    return [sketch, *filter(None, tables)]


def _meshes(train):
    topology = train.topology
    meshes = train.meshes
    radius = 1e3 * np.asarray(train.disks.radius)
    rows = []
    for i, ends in enumerate(topology.mesh_ends):
        teeth = [topology.teeth[disk] for disk in ends]
        row = [
            topology.mesh_names[i],
            "internal" if topology.mesh_internal[i] else "external",
        ]
        row += [" : ".join(plain_number(radius[disk], 6) for disk in ends)]
        row += [" : ".join(map(str, teeth)) if all(teeth) else NONE]
        law = 1e3 * meshes.backlash[i], meshes.epsilon[i], meshes.transition[i]
        rows.append(
            [
                *row,
                *(law if topology.mesh_backlash[i] else [np.nan] * 3),
                topology.mesh_damping_law[i],
            ]
        )
    heads = [
        "mesh",
        "kind",
        "radii mm",
        "teeth",
        "backlash mm",
        "epsilon",
        "transition",
        "damping law",
    ]
    title = (
        "Meshes: epsilon is the stiffness in the gap over that in contact, transition"
        " its width over the backlash"
    )
    return table(title, rows, heads)


def excitation_tables(report):
    """What excites and loads the train: as the scene has it, gas and mean torques over
    the speed, orders: a list of Table. Cylinders that differ in nothing but their
    firing angle and their throw are told by the first of them.
    """
    names = report.train.topology.cylinder_names
    first = {}
    seen = {}
    for name, files in zip(
        names, report.files.get("cylinder") or [{}] * len(names), strict=True
    ):
        facts = {
            key: value
            for key, (value, _) in facts_of(report.elements[name]).items()
            if key not in OWN
        }
        first[name] = seen.setdefault((*facts.items(), *files.items()), name)
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
    return [one for one in tables if one is not None]


def _given(report, kind):
    """What the scene says of the elements of a kind: cells by name, by heads; without
    what it says of none.
    """
    names = getattr(report.train.topology, f"{kind}_names")
    columns = defaultdict(dict)
    for name, files in zip(
        names, report.files.get(kind) or [{}] * len(names), strict=True
    ):
        facts = facts_of(report.elements[name])
        for key, (value, field) in facts.items():
            if value not in (None, "", ()) and not value == 0 == field.default:
                factor, unit = UNITS.get(unit_of(field), (1.0, unit_of(field)))
                head = f"{key.replace('_', ' ')} {unit}".rstrip()
                columns[head][name] = _told(value, field, factor, files.get(key))
        for key in files.keys() - facts.keys():
            columns[f"files of {key}"][name] = files[key]
    return columns


def _told(value, field, factor, file):
    """A number or word; of rows how many there are, their range and their file."""
    if field.metadata["kind"] != "rows":
        return value_text(value if isinstance(value, str | bool) else factor * value, 6)
    spans = zip(field.metadata["columns"], np.transpose(value), strict=True)
    spans = [
        f"{what} {min(own):.6g} to {max(own):.6g}"
        for what, own in spans
        if what not in ("Re", "Im")
    ]
    return ", ".join(filter(None, [f"{len(value)} rows", *spans, file]))


def _rows_of(report, kind, title):
    """A row for each element of a kind."""
    columns = _given(report, kind)
    names = getattr(report.train.topology, f"{kind}_names")
    rows = [
        (name, *(cells.get(name, NONE) for cells in columns.values())) for name in names
    ]
    return table(title, rows, [kind, *columns])


def _cylinders(report, first):
    """Where the cylinders sit and fire, and their numbers, a column for those that have
    the same.
    """
    columns = _given(report, "cylinder")
    different = list(dict.fromkeys(first.values()))
    disks = columns.pop("disk", {})
    angles = columns.pop("firing angle deg", {})
    rows = [
        (name, disks[name], angles.get(name, "0"), own) for name, own in first.items()
    ]
    title = (
        "Numbers of the cylinders; combustion counts from firing top dead centre, rows"
        " are in SI units and deg"
    )
    numbers = [
        (head, *(cells.get(name, NONE) for name in different))
        for head, cells in columns.items()
    ]
    placed = table(
        "Cylinders", rows, ["cylinder", "disk", "firing angle deg", "numbers as of"]
    )
    return placed, table(title, numbers, ["", *different])


def _some(values):
    """So many of a list, its ends among them."""
    return [
        values[k]
        for k in np.unique(
            np.round(np.linspace(0, len(values) - 1, SPEEDS)).astype(int)
        )
    ]


def _gas(report, first):
    """Load, charge and peak pressure, its angle, mean effective pressure and mean
    torque of the cylinders over the speed.
    """
    topology = report.train.topology
    cylinders = report.train.cylinders
    speeds = np.array(_some(report.rpm))
    own = (
        np.ones(len(first))
        if cylinders.gas_factor is None
        else np.asarray(cylinders.gas_factor)
    )
    factors = own * scale_at(cylinders, speeds)
    pressures = own[:, None] * gas_pressures(cylinders, topology.gas_cycles, speeds)
    rows = []
    charges = charges_of(report.train, speeds)
    means = mean_torques(report.train.torques, cylinders, topology.gas_cycles, speeds)[
        :, len(topology.torque_names) :
    ]
    for i in sorted({topology.cylinder_names.index(name) for name in first.values()}):
        turns = topology.cylinder_gas_revolutions[i]
        swept = np.pi / 4 * cylinders.bore[i] ** 2 * cylinders.stroke[i]
        for k, speed in enumerate(speeds):
            cells = [NONE] * 3
            if topology.gas_cycles.computed[i]:
                place = int(np.argmax(pressures[k, i]))
                period = 360.0 * turns
                angle = place * period / GAS_SAMPLES
                cells = [
                    1e-5 * pressures[k, i, place],
                    f"{angle - period * (angle > period / 2):.1f}",
                ]
                # Work of a gas cycle over the swept volume.
                cells.append(
                    1e-5
                    * 2
                    * np.pi
                    * turns
                    * topology.cylinder_every[i]
                    * means[k, i]
                    / swept
                )
            name = topology.cylinder_names[i]
            load, charge = (
                (column[k] for column in charges[name])
                if name in charges
                else (NONE, NONE)
            )
            rows.append(
                [name, f"{speed:g}", factors[k, i], load, charge, *cells, means[k, i]]
            )
    of_pressure = ["largest pressure bar", "deg after firing TDC", "imep bar"]
    heads = [
        "cylinder",
        "rpm",
        "factor",
        "load",
        "charge bar",
        *of_pressure,
        "mean torque N m",
    ]
    empty = [place for place in range(3, 8) if all(row[place] == NONE for row in rows)]
    rows, heads = (
        [[x for i, x in enumerate(row) if i not in empty] for row in both]
        for both in (rows, [heads])
    )
    said = "; load: share of the mean effective pressure at full load" * (
        "load" in heads[0]
    )
    return table(
        f"Gas over the speed, of cylinders with the same numbers the first{said}",
        rows,
        heads[0],
        digits=4,
    )


def _means(report, first):
    """Mean torques of everything that drives and takes power, and the power of the
    loads, over the speed.
    """
    answers = _some(report.cases[0].answers)
    rows = torque_rows(report.train, [answer.linear for answer in answers])
    rows = [row for row in rows if first.get(row[0], row[0]) == row[0]]
    if not rows:
        return None
    names, disks, means = zip(*rows, strict=True)
    columns = [names, disks, *alike(*zip(*means, strict=True))]
    if report.train.topology.load_names:
        last = [
            "power of the loads, kW",
            NONE,
            *(plain_number(answer.balance.load_kW) for answer in answers),
        ]
        columns = [[*column, own] for column, own in zip(columns, last, strict=True)]
    title = (
        "Mean torques over the speed, N m on the disk's own shaft (positive: drives),"
        " of cylinders alike the first"
    )
    return Table(
        title,
        ["element", "disk", *(f"{answer.rpm:g} rpm" for answer in answers)],
        columns,
    )


def _orders(report, first):
    """Orders that the scene gives: of torques, of gas torques, of loads; those with the
    same amplitudes in a table.
    """
    train = report.train
    topology = report.train.topology
    found = defaultdict(dict)
    number_of = order_names(train).number
    own = zip(
        topology.torque_names,
        topology.torque_harmonics,
        train.torques.harmonics,
        strict=True,
    )
    told = [(name, "N m", *rows) for name, *rows in own]
    own = zip(
        topology.cylinder_names,
        topology.cylinder_harmonics,
        train.cylinders.gas_torque,
        strict=True,
    )
    told += [
        (f"gas torque of {name}, firing at 0", "N m", *rows)
        for name, *rows in own
        if first[name] == name
    ]
    if train.loads.harmonics is not None:
        own = zip(
            topology.load_names,
            topology.load_harmonics,
            train.loads.harmonics,
            strict=True,
        )
        told += [(name, "over the mean", *rows) for name, *rows in own]
    for name, unit, harmonics, values in told:
        values = [complex(*value) for value in values[: len(harmonics)]]
        rows = sorted(
            zip(
                np.divide(harmonics, topology.revolutions_per_cycle),
                values,
                strict=True,
            ),
            key=lambda row: row[0],
        )
        found[unit, tuple((order, f"{abs(value):.6g}") for order, value in rows)][
            name
        ] = rows
    tables = []
    for (unit, same), own in found.items():
        if same:
            rows = next(iter(own.values()))
            names = list(own)
            cells = [
                [number_of(order) for order, _ in rows],
                *alike([abs(value) for _, value in rows]),
            ]
            cells += [
                [f"{np.degrees(np.angle(x)):.1f}" if x else NONE for _, x in one]
                for one in own.values()
            ]
            heads = ["order", f"A {unit}", *(["p deg"] if len(own) == 1 else names)]
            called = (
                names[0]
                if len(names) == 1
                else f"{len(names)} torques with the same amplitudes"
            )
            title = (
                f"Orders of {called}: A cos(order x angle + p), angle of the reference"
                " rotor"
            )
            tables.append(
                Table(
                    title, heads, cells, [("p deg", 2, len(own) + 1)] * (len(own) > 1)
                )
            )
    return tables


def assumptions(report):
    """What holds for every number of the page, and what made it."""
    said = (
        environment()
        .get_template("assumptions.txt")
        .render(report=report, means=mean_angles_of)
    )
    return [
        *said.splitlines(),
        Table(
            "Where this page comes from",
            ["", ""],
            list(zip(*report.facts.items(), strict=True)),
        ),
    ]

"""The linear train as text, plain numbers and rows: modes, mean load, Holzer's tables,
the Campbell diagram.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from jaxhb._jax import Array
from jaxhb.elements.rules.margins import MARGINS
from jaxhb.elements.sentences import SceneError
from jaxhb.linear.critical import (
    ELASTIC,
    RIGID,
    RING,
    Campbell,
    Critical,
    shares_in_mode,
)
from jaxhb.linear.cylinders.vector_sums import VectorSums
from jaxhb.linear.forced import ForcedResponse
from jaxhb.linear.heat import fixed_temperatures, span_of, warm_names
from jaxhb.linear.holzer import HolzerTable
from jaxhb.linear.margins import Separation
from jaxhb.linear.modal import Modes
from jaxhb.linear.tangent import MeanLoad, at_pressed_load, own_speed
from jaxhb.report.files.output import Sheet
from jaxhb.report.orders import OrderNames
from jaxhb.report.table import Column, Table
from jaxhb.report.text.columns import NONE, ROUNDING, fixed, percent, plain_number
from jaxhb.report.text.strength import AID
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.mesh_parameters import all_meshes

MOST_MODES = 4  # of vector sums in a table: files have all
SMALL = 1e-9  # vector sum below which its direction is rounding
FIRST = 3  # modes whose energies or tables are shown unless some are chosen

SCALE = (
    "Modal torque: amplitude of the order's torques on the shape whose largest angle is"
    " 1. Every mode has a scale of its own: compare the orders of one mode, not modes."
)


def modes_text(
    modes: Modes,
    name: str,
    kinds: Sequence[str],
    ratios: Sequence[float] | Array,
    teeth: str = "",
) -> Table:
    """Natural frequencies, nodes, damping ratios (nan: none), disks that move;
    ``teeth`` says how stiff they are.
    """
    rows = []
    loose = sum(kind == RIGID for kind in kinds)
    for k, hz in enumerate(modes.frequencies_hz):
        shape = modes.shape(k)
        largest = sorted(shape, key=lambda disk: -abs(shape[disk]))[:3]
        moving = ", ".join(
            f"{disk} {shape[disk]:+.2f}"
            for disk in largest
            if abs(shape[disk]) >= 0.005
        )
        if kinds[k] == RING:
            moving = f"ring only: {largest[0]} turns freely"
        elif kinds[k] == RIGID:
            moving = (
                f"one of {loose} rigid-body modes" if loose > 1 else "rigid-body mode"
            )
            moving += " on the ground's spring" if hz else ""
        damping = fixed(float(ratios[k]), 4)
        nodes = modes.node_count[k] if kinds[k] == ELASTIC else NONE
        in_teeth = [f"{100 * modes.mesh_energy_share[k]:.0f}"] * bool(teeth)
        rows.append(
            [k, fixed(hz, 2), fixed(60 * hz, 0), nodes, damping, *in_teeth, moving]
        )
    title = f"Natural frequencies of {name}: undamped"
    title += f", {teeth}; share of the strain energy in the teeth" if teeth else ""
    return Table(
        title,
        [
            "mode",
            "Hz",
            "per minute",
            "nodes",
            "damping ratio",
            *["in teeth %"] * bool(teeth),
            Column(
                "largest angles (each on its own shaft, scaled to a maximum of 1)",
                left=True,
            ),
        ],
        rows,
    )


def in_contact(train: DriveTrain) -> str:
    """Stiffness of the teeth in words, for tables of trains with teeth; "" without."""
    return "teeth in contact" if train.topology.mesh_names else ""


def energies_text(modes: Modes, kinds: Sequence[str]) -> list[Table]:
    """Tables of the energies of the first elastic modes, by disk and link; Holzer's
    table has them of trees.
    """
    shown = [k for k, kind in enumerate(kinds) if kind == ELASTIC][:FIRST]
    if not shown:
        return []
    columns = [Column(f"mode {k}", percent) for k in shown]
    return [
        Table(
            f"{energy} energy of the first elastic modes, %",
            [head, *columns],
            zip(names, *share[shown], strict=True),
        )
        for energy, head, names, share in (
            ("Kinetic", "disk", modes.names, modes.kinetic_share),
            ("Strain", "link", modes.link_names, modes.strain_share),
        )
    ]


def modes_record(
    modes: Modes, kinds: Sequence[str], ratios: Sequence[float] | Array
) -> dict[str, Any]:
    """The record of ``modes --json``: lists over the modes, by name of disks and links;
    the largest angle is 1.
    """
    fields = ("frequencies_hz", "mesh_energy_share", "node_count", "generalised_mass")
    return {field: getattr(modes, field) for field in fields} | {
        "kinds": kinds,
        "damping_ratios": ratios,
        "modes": dict(zip(modes.names, modes.shapes.T, strict=True)),
        "kinetic_share": dict(zip(modes.names, modes.kinetic_share.T, strict=True)),
        "strain_share": dict(zip(modes.link_names, modes.strain_share.T, strict=True)),
    }


def vector_text(sums: VectorSums, modes: Modes, names: OrderNames) -> list[Table]:
    """Firing angles, and sums by order: of unit vectors, and weighted by the first
    modes; a star marks the major orders.
    """
    firings = sorted(
        zip(sums.firing_deg.tolist(), sums.cylinders, strict=True),
        key=lambda pair: pair[0],
    )
    major = sums.major()
    shown = range(min(MOST_MODES, len(sums.modes)))
    columns: list[Column | str] = [
        "order",
        Column("sum", "{:.3f}".format),
        "deg",
    ]
    for k in shown:
        number = sums.modes[k]
        title = f"mode {number}, {modes.frequencies_hz[number]:.4g} Hz"
        columns += [
            Column("sum", "{:.3f}".format, group=title),
            Column("deg", group=title),
        ]
    rows = []
    for place, order in enumerate(sums.orders):
        vectors = [sums.sums[place], *sums.mode_sums[list(shown), place]]
        row: list[Any] = [f"{names.number(order)}{' *' * bool(major[place])}"]
        for vector in vectors:
            row += [abs(vector), _direction(vector)]
        rows.append(row)
    return [
        Table(
            "Cylinders that fire, deg of their own rotor",
            ["cylinder", Column("firing deg", "{:g}".format)],
            [[name, angle] for angle, name in firings],
        ),
        Table(
            "Vector sums of exp(i order x firing angle): all cylinders alike, and"
            " weighted by their angles in modes whose largest angle is 1 (* major"
            " order: all in one direction)",
            columns,
            rows,
        ),
    ]


def _direction(vector: complex) -> str:
    """Direction of a sum in deg, none of one that is only rounding."""
    if abs(vector) < SMALL:
        return NONE
    if abs(vector.imag) < SMALL * abs(vector):
        # Rounding of the imaginary part would choose between 180 and -180.
        return "0.0" if vector.real > 0.0 else "180.0"
    return f"{np.degrees(np.angle(vector)):.1f}"


def vector_record(sums: VectorSums) -> dict[str, Any]:
    """The part of ``modes --vector-sums --json``."""
    return {
        "vector_sums": {
            "cylinders": sums.cylinders,
            "firing_deg": sums.firing_deg,
            "orders": sums.orders,
            "major": sums.major(),
            "sum": _polar(sums.sums),
            "modes": sums.modes,
            "amplitudes": sums.amplitudes,
            "mode_sums": _polar(sums.mode_sums),
        }
    }


def _polar(vectors: Array) -> dict[str, Array]:
    """Magnitudes and directions of vectors."""
    return {"magnitude": np.abs(vectors), "deg": np.degrees(np.angle(vectors))}


def vector_sheet(sums: VectorSums) -> Sheet:
    """A row for every order, sums of unit vectors and of modes."""
    heads = ["order", "sum", "sum deg"]
    for number in sums.modes:
        heads += [f"mode {number} sum", f"mode {number} deg"]
    rows = []
    for place, order in enumerate(sums.orders.tolist()):
        vectors = [sums.sums[place], *sums.mode_sums[:, place]]
        row = [order]
        for vector in vectors:
            row += [float(abs(vector)), float(np.degrees(np.angle(vector)))]
        rows.append(row)
    return Sheet(heads, rows)


def separation_tables(
    separations: Sequence[Separation], operating_rpm: Sequence[float]
) -> list[Table]:
    """The nearest excitation of every mode, a table for each rule."""
    return [
        _table([row for row in separations if row.rule == rule], operating_rpm)
        for rule in dict.fromkeys(row.rule for row in separations)
    ]


def _table(rows: Sequence[Separation], operating_rpm: Sequence[float]) -> Table:
    """The nearest excitation of every mode after one rule."""
    nearest: dict[int, Separation] = {}
    for row in rows:
        before = nearest.setdefault(row.mode, row)
        nearest[row.mode] = min(before, row, key=lambda each: each.margin)
    rule = MARGINS[rows[0].rule]
    low, high = operating_rpm
    missed = sum(not row.kept for row in nearest.values())
    verdict = f"{missed} of {len(nearest)} TOO CLOSE" if missed else "all kept"
    return Table(
        f"Separation margins after {rule.source}, {low:g} to {high:g} rpm: {verdict};"
        f" to be checked against the current text ({AID})",
        [
            Column("mode", read=lambda row: str(row.mode)),
            Column("Hz", "hz", lambda row: row.hz),
            Column("rotor of", read=lambda row: row.rotor),
            Column("order", read=lambda row: f"{row.order}x"),
            Column("from Hz", "hz", lambda row: row.low_hz),
            Column("to Hz", "hz", lambda row: row.high_hz),
            Column("margin %", "{:.1f}".format, lambda row: 100 * row.margin),
            Column("", read=lambda row: "" if row.kept else "TOO CLOSE"),
        ],
        list(nearest.values()),
    )


def separation_record(separations: Sequence[Separation]) -> dict[str, Any]:
    """Record of all margins, ``{"separation_margins": ...}``; empty without rules."""
    if not separations:
        return {}
    rows = [vars(row) | {"margin": row.margin, "kept": row.kept} for row in separations]
    return {"separation_margins": rows}


def _outside_rows(train: DriveTrain, response: ForcedResponse) -> list[str]:
    """Sentences on links whose temperature lies outside the rows of their numbers."""
    sentences = []
    for name in warm_names(train.topology):
        temperatures = response.temperature(name)
        (lowest, highest) = span_of(train, name)
        if temperatures is None:
            continue
        outside = (temperatures < lowest) | (temperatures > highest)
        if np.any(outside):
            sentences.append(
                f"{name}: at {np.sum(outside)} of {outside.size} speeds its temperature"
                f" lies outside over_temperature, {lowest:g} to {highest:g} deg C,"
                " where its numbers are those of the nearest row."
            )
    return sentences


def approximations(
    train: DriveTrain,
    rpm: Sequence[float] | Array | None = None,
    response: ForcedResponse | None = None,
    *,
    closed: bool = True,
    balanced: bool = False,
) -> list[str]:
    """Sentences on what linear calculations take at the mean load or leave out, one for
    each element and reason: of one speed or several, by default of that of
    :func:`own_speed`; ``response``, a :class:`jaxhb.ForcedResponse` at these, tells
    which vibrations leave the stage; ``closed``: clearances are; ``balanced``: links
    have the temperature of their heat, as they have in a response.
    """
    topology = train.topology
    springs: dict[int, dict[str, list[int]]] = {}
    for link, kind, row in topology.springs:
        springs.setdefault(link, {}).setdefault(kind, []).append(row)
    speeds = [own_speed(train)] if rpm is None else rpm
    loads = []
    if springs:
        loads = [at_pressed_load(train, rpm=float(speed)) for speed in speeds]
    sentences = []
    if response is not None:
        sentences = _outside_rows(train, response)
    elif not balanced:
        sentences = [f"{note}." for note in fixed_temperatures(train)]
    for place, (link, kinds) in enumerate(springs.items()):
        name = topology.link_names[link]
        if "stages" in kinds or "stops" in kinds:
            sentences.append(f"{name}: {_stage_sentence(loads, place)}.")
            sentences += _crossing(train, link, kinds, response)
        if "clearance" in kinds and closed:
            sentences.append(
                f"{name}: its clearance is taken closed; jaxhb solve has it open."
            )
        if "friction" in kinds:
            friction = _of_link(train, link, "friction")
            sentences.append(
                f"{name}: its dry friction of {float(friction):.4g} N m is left out;"
                " jaxhb solve has it."
            )
    variation = all_meshes(train).variation
    for mesh in np.flatnonzero(topology.mesh_varies):
        assert variation is not None  # a mesh varies
        most = 200 * np.abs(np.asarray(variation[mesh])).sum()
        varies = (
            f"its stiffness varies over the mesh period, by up to {most:.3g} % of its"
            " mean"
        )
        sentences.append(
            f"{topology.mesh_names[mesh]}: {varies}, which is taken here; jaxhb solve"
            " has the variation."
        )
    return sentences


def _of_link(train: DriveTrain, link: int, field: str) -> np.ndarray:
    """A field of a shaft or damper by the number of the link."""
    shafts = len(train.topology.shaft_names)
    if link < shafts:
        return np.asarray(getattr(train.shafts, field))[link]
    return np.asarray(getattr(train.dampers, field))[link - shafts]


def _stage_sentence(loads: Sequence[MeanLoad], place: int) -> str:
    """The stiffness of one link with stages or stops at its mean load, over the
    speeds.
    """
    slopes = [float(load.link_stiffness[place]) for load in loads]
    torques = [float(load.torque[place]) for load in loads]
    if not all(load.loaded for load in loads):
        return (
            f"linear with {plain_number(slopes[0])} N m/rad, its stiffness at rest: no"
            " load balances the mean torques"
        )
    first = loads[0].rpm
    last = loads[-1].rpm
    where = (
        f"at {first:g} rpm" if len(loads) == 1 else f"from {first:g} to {last:g} rpm"
    )
    return (
        f"linear with {_range_text(slopes)} N m/rad, its stiffness at the mean torque"
        f" of {_range_text(torques)} N m {where}"
    )


def _range_text(values: Sequence[float]) -> str:
    """The smallest and the largest of some values; one where they are the same."""
    if np.ptp(values) <= 1e-6 * np.abs(values).max():
        return f"{min(values):.4g}"
    return f"{min(values):.4g} to {max(values):.4g}"


def _crossing(
    train: DriveTrain,
    link: int,
    kinds: Mapping[str, Sequence[int]],
    response: ForcedResponse | None,
) -> list[str]:
    """A sentence on the speeds at which the vibration of a link leaves the stage of its
    mean torque, in a list.
    """
    if response is None:
        return []
    stages = [
        sign * row[0]
        for row in _rows_of(train, link, kinds, "stages")
        for sign in (1, -1)
    ]
    stops = [row[0] for row in _rows_of(train, link, kinds, "stops")]
    knots = np.array(stages + stops)
    first, second = train.topology.link_ends[link]
    disk_names = train.topology.disk_names
    twist = response.twist(disk_names[first], disk_names[second])
    low = np.rad2deg(np.asarray(twist.min))[:, None]
    high = np.rad2deg(np.asarray(twist.max))[:, None]
    crossed = np.asarray(response.converged) & ((low < knots) & (knots < high)).any(
        axis=-1
    )
    if not crossed.any():
        return []
    worst = int(np.argmax(np.where(crossed, (high - low)[:, 0], -1.0)))
    speeds = np.asarray(response.rpm)[crossed]
    where = (
        f"at {speeds[0]:g} rpm"
        if len(speeds) == 1
        else f"at {len(speeds)} speeds from {speeds[0]:g} rpm on"
    )
    swing = (
        f"{low[worst, 0]:.3g} to {high[worst, 0]:.3g} deg at"
        f" {float(response.rpm[worst]):g} rpm"
    )
    name = train.topology.link_names[link]
    march = "jaxhb solve" if response.lines is None else "jaxhb.transient"
    return [
        f"{name}: its vibration leaves this stage {where} ({swing}): only {march} shows"
        " what it does there."
    ]


def _rows_of(
    train: DriveTrain, link: int, kinds: Mapping[str, Sequence[int]], field: str
) -> np.ndarray | Sequence:
    """The rows of the stages or stops of a link."""
    if field not in kinds:
        return ()
    return _of_link(train, link, field)[: len(kinds[field])]


def mean_load_text(load: MeanLoad, rpm: float) -> str:
    """A line on the tangent stiffness of every mesh with backlash, and of shafts and
    dampers with stages, stops or clearance.
    """
    links = [
        f"{name} {plain_number(torque)} N m at {plain_number(stiffness)} N m/rad"
        for name, torque, stiffness in zip(
            load.links, load.torque, load.link_stiffness, strict=True
        )
    ]
    for name, force, engagement, share in zip(
        load.names, load.force, load.engagement, load.share, strict=True
    ):
        if engagement == 1:
            where = "in contact"
        else:
            zone = "in the gap" if engagement == 0 else "in the transition zone"
            where = f"{zone}, {percent(share)} % of its stiffness"
        links.append(f"{name} {abs(force) / 1e3:.4g} kN {where}")
    return f"Mean load of {rpm:g} rpm: {', '.join(links) or 'no mesh has backlash'}."


def mean_load_record(load: MeanLoad, rpm: float) -> dict[str, Any]:
    """The part of ``modes --at --json`` on meshes with backlash: elastic force, tangent
    stiffness, engagement 0 to 1; and on shafts or dampers with stages, stops, clearance
    or friction: torque, twist, tangent stiffness.
    """
    of_meshes = zip(
        load.names, load.force, load.stiffness, load.engagement, strict=True
    )
    of_links = zip(
        load.links, load.torque, load.twist, load.link_stiffness, strict=True
    )
    rows = {
        name: {"force": force, "stiffness": stiffness, "engagement": engagement}
        for name, force, stiffness, engagement in of_meshes
    }
    rows |= {
        name: {"torque": torque, "twist": twist, "stiffness": stiffness}
        for name, torque, twist, stiffness in of_links
    }
    return {"at_rpm": rpm, "mean_load": rows}


HOLZER = (
    "inertia",
    "ordinate",
    "torque",
    "torque_sum",
    "stiffness",
    "twist",
    "kinetic_energy",
    "strain_energy",
)
"""Fields of a HolzerTable in the file; the first six stand in the text."""


def chosen_modes(
    kinds: Sequence[str], name: str, modes: Sequence[int] | None = None
) -> list[int]:
    """Numbers of the chosen ``modes``, by default of the first that strain links; a
    ``SceneError`` of those that do not.
    """
    elastic = [k for k, kind in enumerate(kinds) if kind == ELASTIC]
    if not elastic:
        raise SceneError(f"{name}: no mode strains a link. Give a frequency with --hz.")
    errors = []
    for k in modes or ():
        if k >= len(kinds):
            errors.append(f"{name}: --mode {k}: there are modes 0 to {len(kinds) - 1}.")
        elif k not in elastic:
            strained = (
                f"no link is strained. The first that strains one is {elastic[0]}."
            )
            errors.append(f"{name}: --mode {k}: this mode is {kinds[k]}, {strained}")
    if errors:
        raise SceneError(errors)
    return list(dict.fromkeys(modes)) if modes else elastic[:FIRST]


def holzer_text(
    tables: Iterable[tuple[int | None, HolzerTable]], name: str, teeth: str = ""
) -> str:
    """Holzer's ``tables``, pairs (number of the mode or None, HolzerTable), with
    ``teeth`` as of :func:`modes_text`.
    """
    return "\n\n".join(holzer_parts(tables, name, teeth))


def holzer_parts(
    tables: Iterable[tuple[int | None, HolzerTable]], name: str, teeth: str = ""
) -> list[str]:
    """Words on Holzer's tables, and the tables, as of :func:`holzer_text`."""
    stiff = ", ".join(filter(None, ["undamped", teeth]))
    meshes = "; of a mesh c N/m, sum/c m" if teeth else ""
    return [
        f"{name}: Holzer's table, {stiff}. J kg m2, theta rad, torques N m,\nc"
        f" N m/rad, sum/c rad{meshes}. Energies of disk and link in % of the"
        " kinetic energy.\nThe sum of a row passes through its link.",
        *(_holzer_table(mode, table) for mode, table in tables),
    ]


def _holzer_table(mode: int | None, table: HolzerTable) -> Table:
    """One of Holzer's tables, disks in the order of calculation."""
    kinetic = table.kinetic_energy.sum()
    inertia, ordinate, torque, torque_sum, stiffness, twist = (
        [f"{value:#.5g}".rstrip(".") for value in _without_rounding(table, field)]
        for field in HOLZER[:6]
    )
    of_disk, of_link = (
        # At 0 Hz nothing has kinetic energy.
        [f"{100 * share:.1f}" for share in energy / kinetic]
        if kinetic
        else [NONE] * len(energy)
        for energy in (table.kinetic_energy, table.strain_energy)
    )
    columns = {
        "disk": table.names,
        "J": inertia,
        "theta": ordinate,
        "J w2 theta": torque,
        "sum": torque_sum,
        "disk %": of_disk,
    }
    # Behind the last disk is no link.
    columns |= {
        head: [*cells[:-1], NONE]
        for head, cells in {
            "link": table.links,
            "c": stiffness,
            "sum/c": twist,
            "link %": of_link,
        }.items()
    }
    number = "" if mode is None else f"mode {mode}, "
    return Table(
        f"{number}{table.hz:.6g} Hz, residual {table.residual + 0.0:.4g} N m",
        [Column(head, left=head == "link") for head in columns],
        zip(*columns.values(), strict=True),
    )


def _without_rounding(table: HolzerTable, field: str) -> np.ndarray:
    """Numbers of a column of Holzer's table, those that are but rounding beside the
    largest as 0; the last sum is the residual, and stays.
    """
    values = np.asarray(getattr(table, field), float)
    small = np.abs(values) < ROUNDING * np.abs(values).max(initial=0.0)
    if field == "torque_sum":
        small[-1:] = False
    return np.where(small, 0.0, values) + 0.0


def holzer_record(
    tables: Iterable[tuple[int | None, HolzerTable]], name: str
) -> dict[str, Any]:
    """The record of ``holzer --json``: lists over the rows of every table, SI units;
    mode None: of a frequency that is no natural one.
    """
    rows = [
        {
            "hz": table.hz,
            "mode": mode,
            "residual": table.residual,
            "disks": table.names,
            "links": table.links,
        }
        | {field: getattr(table, field) for field in HOLZER}
        for mode, table in tables
    ]
    return {"scene": name, "tables": rows}


def campbell_text(
    diagram: Campbell,
    count: int,
    name: str,
    misfires: Mapping[str, Campbell],
    names: OrderNames,
    teeth: str = "",
    lines: Iterable[str] = (),
    worst: Iterable[str] = (),
) -> str:
    """Modes and critical speeds of a Campbell diagram of ``count`` elastic modes;
    ``misfires`` by cylinder, ``names`` of the orders; ``lines`` stand below the first,
    sentences on the ``worst`` misfire last.
    """
    stiff = ", ".join(filter(None, ["undamped", teeth]))
    head = (
        f"{name}: Campbell diagram from {diagram.rpm[0]:g} to {diagram.rpm[-1]:g} rpm,"
        f" {stiff}"
    )
    parts = campbell_parts(diagram, count, misfires, names)
    return "\n\n".join(["\n".join([head, *lines]), *parts, *worst])


def campbell_parts(
    diagram: Campbell, count: int, misfires: Mapping[str, Campbell], names: OrderNames
) -> list[str]:
    """The tables of :func:`campbell_text`, and a sentence where there is none."""
    shown = diagram.shown(count)
    hz = diagram.frequencies_hz
    constant = (hz[:, shown] == hz[0, shown]).all()
    columns = {"Hz": hz[0]}
    if not constant:
        columns = {
            f"Hz at {diagram.rpm[0]:g} rpm": hz[0],
            f"at {diagram.rpm[-1]:g} rpm": hz[-1],
        }
    rows: list[list[Any]] = [
        [k, *(f"{column[k]:.2f}" for column in columns.values()), diagram.kinds[k]]
        for k in shown
    ]
    others = {diagram.kinds[k] for k in shown} - {ELASTIC}
    remark = f"; those called {' or '.join(sorted(others))} have no critical speeds"
    modes = Table(
        f"Natural frequencies{remark * bool(others)}",
        ["mode", *columns, Column("kind", left=True)],
        rows,
    )
    parts = [modes, *_left_out(diagram, count), *_line_table(diagram)]
    orders = ", ".join(map(names.number, diagram.orders)) or "none"
    if not diagram.critical:
        return [*parts, f"No critical speed lies in the range. Orders: {orders}."]
    rows = [
        [
            f"{critical.rpm:.1f}",
            names.number(critical.order),
            critical.mode,
            f"{critical.hz:.2f}",
            critical.torque,
        ]
        for critical in diagram.critical
    ]
    for place, row in enumerate(rows if misfires else ()):
        cylinder, torque = _worst_at(place, misfires)
        row += [torque, cylinder]
    critical_speeds = Table(
        f"Critical speeds, order x rpm / 60 = Hz. {SCALE}\nOrders: {orders}.",
        [
            "rpm",
            "order",
            "mode",
            "Hz",
            Column("modal torque {N m}", plain_number, unit="N m"),
            *[Column("worst misfire {N m}", plain_number, unit="N m")] * bool(misfires),
            *[Column("that of", left=True)] * bool(misfires),
        ],
        rows,
    )
    return [*parts, critical_speeds]


def _line_table(diagram: Campbell) -> list[Table]:
    """The table of lines at fixed frequencies and their modes, in a list."""
    if not diagram.lines:
        return []
    at_every_speed = diagram.lines[0].rpm is None
    rows = [
        [
            f"{line.hz:g}",
            line.mode,
            f"{line.mode_hz:.2f}",
            f"{100 * line.apart:+.1f}",
            line.torque,
            *([] if line.rpm is None else [f"{line.rpm:.1f}"]),
        ]
        for line in diagram.lines
    ]
    where = "at every speed" if at_every_speed else "where it is nearest or crosses"
    return [
        Table(
            f"Lines at fixed frequencies and the nearest elastic mode, {where}",
            [
                "Hz",
                "mode",
                "mode Hz",
                "apart %",
                Column("modal torque {N m}", plain_number, unit="N m"),
                *["rpm"] * (not at_every_speed),
            ],
            rows,
        )
    ]


def _worst_at(place: int, misfires: Mapping[str, Campbell]) -> tuple[str, float]:
    """The cylinder whose misfire has the largest modal torque at a critical speed,
    where all have the same mode, and this torque in N m.
    """
    torques = {
        cylinder: diagram.critical[place].torque
        for cylinder, diagram in misfires.items()
    }
    return max(torques.items(), key=lambda entry: entry[1])


def excited_most(
    diagram: Campbell, misfires: Mapping[str, Campbell], cylinder: str, rpm: float
) -> tuple[Critical, float]:
    """The Critical at a critical speed whose order and mode a misfire excites most
    beside others of its mode, its modal torque that of the misfire, and the torque with
    all firing.
    """
    every = misfires[cylinder].critical
    shares = shares_in_mode(every, [critical.torque for critical in every])
    place = max(
        (k for k, critical in enumerate(every) if critical.rpm == rpm),
        key=lambda k: shares[k],
    )
    return every[place], diagram.critical[place].torque


def _left_out(diagram: Campbell, count: int) -> list[str]:
    """A sentence on modes that are left out, in a list."""
    shown = len(diagram.elastic(count))
    every = len(diagram.elastic(len(diagram.kinds)))
    crossed = diagram.reached()
    if shown == every:
        return []
    highest = max(diagram.orders, default=0.0)
    low = float(diagram.rpm[0])
    high = float(diagram.rpm[-1])
    top = f"order {highest:g} at {high:g} rpm is {highest * high / 60:.4g} Hz"
    first = f"These are the {shown} lowest of {every} modes that strain links"
    if crossed <= shown:
        return [f"{first}. The orders reach {crossed} of them, all shown: {top}."]
    call = f"jaxhb campbell SCENE --rpm {low:g}:{high:g} --modes {crossed} lists all"
    return [f"{first}. The orders reach {crossed} of them, {top}; {call}."]


def campbell_record(
    diagram: Campbell,
    count: int,
    name: str,
    misfires: Mapping[str, Campbell],
    worst: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """The record of ``campbell --json``, see ``docs/how_to/linear.md``; ``worst`` is
    that of the worst misfire.
    """
    speeds = [_critical_record(critical) for critical in diagram.critical]
    for place, speed in enumerate(speeds if misfires else ()):
        speed["misfires"] = {
            cylinder: misfire.critical[place].torque
            for cylinder, misfire in misfires.items()
        }
    modes = [
        {
            "mode": k,
            "kind": diagram.kinds[k],
            "frequencies_hz": diagram.frequencies_hz[:, k],
        }
        for k in diagram.shown(count)
    ]
    record: dict[str, Any] = {
        "scene": name,
        "rpm": diagram.rpm,
        "orders": diagram.orders,
        "modes": modes,
        "critical_speeds": speeds,
    }
    if diagram.lines:
        record["lines"] = [
            {
                "hz": line.hz,
                "mode": line.mode,
                "mode_hz": line.mode_hz,
                "rpm": line.rpm,
                "modal_torque": line.torque,
            }
            for line in diagram.lines
        ]
    if misfires:
        record["worst_misfire"] = worst and worst | _of_mode(diagram, misfires, worst)
    return record


def _of_mode(
    diagram: Campbell, misfires: Mapping[str, Campbell], worst: Mapping[str, Any]
) -> dict[str, Any]:
    """Order, mode and modal torques of the record of a worst misfire."""
    critical, firing = excited_most(diagram, misfires, worst["cylinder"], worst["rpm"])
    return _critical_record(critical) | {"modal_torque_firing": firing}


def _critical_record(critical: Critical) -> dict[str, Any]:
    """The record of a critical speed; torque in N m."""
    return {
        "rpm": critical.rpm,
        "order": critical.order,
        "mode": critical.mode,
        "hz": critical.hz,
        "modal_torque": critical.torque,
    }


def campbell_rows(
    diagram: Campbell, misfires: Mapping[str, Campbell], titles: Mapping[str, str]
) -> tuple[list[str], list[list[Any]]]:
    """Heads and rows of ``campbell --csv``: one row per critical speed; modal torques
    with misfires, which have ``titles``, come last.
    """
    heads = ["rpm", "order", "mode", "Hz", "modal torque N m"]
    heads += [f"modal torque N m, {titles[cylinder]}" for cylinder in misfires]
    rows = []
    for place, critical in enumerate(diagram.critical):
        torques = [misfire.critical[place].torque for misfire in misfires.values()]
        rows.append([*dataclasses.astuple(critical), *torques])
    return heads, rows

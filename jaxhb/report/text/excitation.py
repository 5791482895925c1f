"""The excitation by cylinders as text, plain numbers and rows: tangential pressures,
and the vector sums of the firing.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxhb._jax import Array
from jaxhb.elements.sentences import SceneError
from jaxhb.excitation.mean_torques import mean_gas_torques
from jaxhb.excitation.tables import COMPUTED, TANGENTIAL
from jaxhb.linear.modal import Modes
from jaxhb.linear.tangential import TangentialTable
from jaxhb.linear.vector_sums import VectorSums
from jaxhb.report.files.output import Sheet
from jaxhb.report.orders import OrderNames
from jaxhb.report.table import Column, Table
from jaxhb.report.text.columns import NONE
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import ANY_SPEED
from jaxhb.train.kinematics import speed_ratios

MOST_MODES = 4  # of vector sums in a table: files have all
FEW = 2  # names of cylinders alike that are all told
SMALL = 1e-9  # vector sum below which its direction is rounding


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


def cylinder_tables(
    train: DriveTrain, speeds: Sequence[float] | None, places: Sequence[str]
) -> list[str]:
    """A row for cylinders with the same numbers, and when each fires, in a list;
    ``speeds`` None where no torque depends on them.
    """
    cylinders = cylinders_of(train, speeds or [ANY_SPEED])
    if not cylinders:
        return []
    columns: list[Column | str] = ["cylinder", "kg", "radius mm", "litre"]
    for place in places:
        columns.append(Column("imep bar", group=place))
        # Where torques do not depend on the speed, none is told, and so no power.
        columns += [Column("kW", group=place)] * bool(speeds)
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
            cells += [_scaled(power, 1e-3)] * bool(speeds)
        alike.setdefault(tuple(cells), []).append(name)
    firing = sorted(cylinders, key=lambda name: cylinders[name]["firing_deg"])
    angles = ", ".join(f"{name} {cylinders[name]['firing_deg']:g}" for name in firing)
    return [
        Table(
            "Of each cylinder: reciprocating mass, crank radius, swept volume, and of"
            " its gas the mean indicated pressure and the power",
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


def refuse_without(train: DriveTrain, option: str, needed: Sequence[str]) -> None:
    """Refuse options that mean nothing without another one."""
    if needed:
        raise SceneError(
            f"{train.topology.title}: {', '.join(needed)} needs {option}. Give it, or"
            f" leave {', '.join(needed)} out."
        )

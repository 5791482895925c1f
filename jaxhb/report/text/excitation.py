"""The excitation by cylinders as text, plain numbers and rows: tangential pressures,
and the vector sums of the firing.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxhb.elements.sentences import SceneError
from jaxhb.linear.modal import Modes
from jaxhb.linear.tangential import TangentialTable
from jaxhb.linear.vector_sums import VectorSums
from jaxhb.report.files.output import Sheet
from jaxhb.report.orders import OrderNames
from jaxhb.report.table import Column, Table
from jaxhb.report.text.columns import NONE
from jaxhb.train.drivetrain import DriveTrain

MOST_MODES = 4  # of vector sums in a table: files have all
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


def _polar(vectors: np.ndarray) -> dict[str, np.ndarray]:
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


def refuse_without(train: DriveTrain, option: str, needed: Sequence[str]) -> None:
    """Refuse options that mean nothing without another one."""
    if needed:
        raise SceneError(
            f"{train.topology.title}: {', '.join(needed)} needs {option}. Give it, or"
            f" leave {', '.join(needed)} out."
        )

"""Measured orders of torques, stresses, angles, speeds and accelerations, and the CSV
files that hold them.

A strain gauge measures the shear stress of a shaft: it is read as the torque that makes
it, the stress times W_p of the section that the scene gives.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jaxhb._equal import by_value
from jaxhb.elements.sentences import SceneError, cut, shown, suggestion
from jaxhb.elements.units import Refused, si_number
from jaxhb.linear.strength import having, stress_of
from jaxhb.results.quantities import CALLED, MEASURED, names_of
from jaxhb.scene.csv_tables import CsvText, Line, read_csv
from jaxhb.scene.input_files import Unreadable, read_text
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import HIGHEST_RPM

COLUMNS = "rpm", "order", "element", "quantity", "amplitude", "phase"
STRESS = "stress"
"""Quantity of a strain gauge, Pa."""
UNITS = {name: vibration.unit for name, vibration in MEASURED.items()} | {STRESS: "Pa"}
"""Units of amplitudes by the quantities that files may name."""


@by_value
@dataclass(frozen=True)
class Measured:
    """Measured amplitudes, a row for each ``(R,)``.

    rpm; order, of the reference rotor, nan for the sum of the amplitudes of all orders;
    element : tuple of names of shafts, dampers or disks; quantity : tuple of "torque",
    "angle", "speed" or "acceleration"; amplitude, of a cosine, in SI units; phase in
    deg of ``cos(order theta + phase)``, theta the angle of the reference rotor, nan
    where none was measured.
    """

    rpm: np.ndarray
    order: np.ndarray
    element: tuple
    quantity: tuple
    amplitude: np.ndarray
    phase: np.ndarray


@dataclass(frozen=True)
class _Row:
    """Cells of a line by the heads of their columns."""

    table: CsvText
    cells: dict[str, str]

    def text(self, head: str) -> str:
        """The cell of a column, empty where there is none."""
        return self.cells.get(head, "")

    def number(self, head: str) -> float:
        """The number of a cell: infinite where it is none, nan for the order
        ``sum``.
        """
        if head == "order" and self.text(head) == "sum":
            return np.nan
        if head == "amplitude":
            value = self.with_unit()
            return np.inf if isinstance(value, str) else value
        try:
            return self.table.number(self.text(head))
        except ValueError:
            return np.inf

    def with_unit(self) -> Any:
        """The amplitude in the unit of its quantity: Refused where that of the text
        does not fit.
        """
        text = self.text("amplitude")
        try:
            return self.table.number(text)
        except ValueError:
            pass
        return si_number(text, UNITS.get(self.text("quantity"), ""))

    @property
    def place(self) -> tuple:
        """Speed, order, element and quantity, of which a file has each row once."""
        order = "sum" if self.text("order") == "sum" else self.number("order")
        return self.number("rpm"), order, self.text("element"), self.text("quantity")


def read_measured(path: str | Path, train: DriveTrain) -> Measured:
    """Read the rows of a CSV file with the columns rpm, order, element, quantity,
    amplitude and, if measured, phase.

    Amplitudes are in SI units, or each with a unit of its own as ``45 MPa``. Rows of
    the ``stress`` of a shaft become those of its torque.

    Columns are separated by commas, semicolons or tabs; decimals may have commas where
    these separate nothing; # begins a comment. ``order`` may be ``sum``.
    :class:`SceneError` tells unknown columns, elements and quantities, numbers that are
    none or negative, orders that are no harmonic of the cycle and rows that are there
    twice: all at once, each fault in one sentence that names its first line and counts
    the others.
    """
    path = Path(path)
    try:
        table = read_csv(read_text(path), path.name)
    except Unreadable as error:
        raise SceneError(f"{cut(str(path))}: {error}") from None
    faults = _head_faults(table)
    if faults:
        raise SceneError([f"{path.name}: {text}" for text in faults])
    heads = table.lines[0].cells
    row_at: dict[tuple, _Row] = {}
    lines_of: dict = {}
    for line in table.lines[1:]:
        row = _Row(table, dict(zip(heads, line.cells, strict=False)))
        texts = _line_faults(train, heads, line, row)
        if not texts and row_at.setdefault(row.place, row) is not row:
            texts = ["the row is there twice: leave one out."]
        for text in texts:
            lines_of.setdefault(text, []).append(line.number)
    faults = [
        f"{path.name}, {_lines(numbers)}: {text}" for text, numbers in lines_of.items()
    ]
    if not row_at and not faults:
        faults = [f"{path.name}: there are no rows of measurements below the heads."]
    if faults:
        raise SceneError(faults)
    rows = list(row_at.values())
    return Measured(
        rpm=np.array([row.number("rpm") for row in rows]),
        order=np.array([row.number("order") for row in rows]),
        element=tuple(row.text("element") for row in rows),
        quantity=tuple(
            "torque" if row.text("quantity") == STRESS else row.text("quantity")
            for row in rows
        ),
        amplitude=np.array([_amplitude(train, row) for row in rows]),
        phase=np.array(
            [row.number("phase") if row.text("phase") else np.nan for row in rows]
        ),
    )


def _amplitude(train: DriveTrain, row: _Row) -> float:
    """Amplitude of a sound row, of a stress that of the torque."""
    amplitude = row.number("amplitude")
    if row.text("quantity") != STRESS:
        return amplitude
    return amplitude / float(stress_of(train, row.text("element"), 1.0))


def _lines(numbers: list[int]) -> str:
    """Name the first line of a fault, and count the others that have it."""
    if len(numbers) == 1:
        return f"line {numbers[0]}"
    plural = "s" if len(numbers) > 2 else ""
    return f"line {numbers[0]} and {len(numbers) - 1} other{plural}"


def _head_faults(table: CsvText) -> list[str]:
    """Sentences on the heads of the columns."""
    heads = table.lines[0].cells if table.lines else ()
    faults = [
        f"there is no column {shown(head)}.{suggestion(head, COLUMNS)}"
        for head in heads
        if head not in COLUMNS
    ]
    faults += [
        f"the column {head!r} is there twice. Keep one."
        for head in COLUMNS
        if heads.count(head) > 1
    ]
    return faults + [
        f"the column {head!r} is missing." for head in COLUMNS[:-1] if head not in heads
    ]


def _line_faults(
    train: DriveTrain, heads: tuple[str, ...], line: Line, row: _Row
) -> list[str]:
    """Sentences on one line."""
    if any(line.cells[len(heads) :]):
        cure = "Correct it; where decimals have commas separate by semicolons or tabs."
        return [f"there are {len(line.cells)} cells under {len(heads)} heads. {cure}"]
    return _number_faults(train, row) + _name_faults(train, row)


def _number_faults(train: DriveTrain, row: _Row) -> list[str]:
    """Sentences on the numbers of a row."""
    faults = []
    turns = train.topology.revolutions_per_cycle
    if not 0 < row.number("rpm") < HIGHEST_RPM:
        faults.append(
            f"rpm is {shown(row.text('rpm'))}, must be a number greater than 0."
        )
    order = row.number("order")
    if row.text("order") != "sum" and not 0 < order < np.inf:
        faults.append(
            f"order is {shown(row.text('order'))}, must be a number greater than 0."
        )
    elif abs(order * turns - round(np.nan_to_num(order * turns))) > 1e-9:
        faults.append(
            f"order {order:g} is no harmonic of the cycle: use a multiple of"
            f" {1 / turns:g}."
        )
    refused = row.with_unit()
    if isinstance(refused, Refused):
        faults.append(f"amplitude is {shown(refused)}, {refused.why}")
    elif not 0 <= row.number("amplitude") < np.inf:
        faults.append(
            f"amplitude is {shown(row.text('amplitude'))}, must be at least 0."
        )
    if row.text("phase") and not np.isfinite(row.number("phase")):
        faults.append(
            f"phase is {shown(row.text('phase'))}, must be a number of degrees."
        )
    return faults


def _name_faults(train: DriveTrain, row: _Row) -> list[str]:
    """Sentences on the quantity and the element of a row."""
    quantity = row.text("quantity")
    element = row.text("element")
    if quantity == STRESS:
        return _stress_faults(train, element)
    if quantity not in MEASURED:
        near = suggestion(quantity, UNITS)
        return [f"there is no quantity {shown(quantity)}.{near}"]
    kind = MEASURED[quantity].element
    names = names_of(train.topology)[kind]
    if element in names:
        return []
    near = suggestion(element, names)
    return [f"there is no {CALLED[kind]} {shown(element)}.{near}"]


def _stress_faults(train: DriveTrain, element: str) -> list[str]:
    """Sentences on a stress: it needs a shaft whose section is known."""
    shafts = train.topology.shaft_names
    if element not in shafts:
        near = suggestion(element, shafts)
        return [f"there is no shaft {shown(element)} for its stress.{near}"]
    if element in having(train.topology, "shaft", "diameter", "outer"):
        return []
    return [
        f"the stress of {shown(element)} needs the section of the shaft: give its"
        " diameter (and bore) in the scene, or the torque."
    ]

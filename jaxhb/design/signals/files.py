"""Files of measured rotations: CSV with the columns of a torsiograph, an encoder or the
pulses of a wheel.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jaxhb.elements.sentences import SceneError, cut, shown, suggestion
from jaxhb.elements.units import UnitError, factor
from jaxhb.scene.csv_tables import CsvText, name_and_unit, read_csv
from jaxhb.scene.input_files import Unreadable, read_text

MOST_BYTES = 256 * 2**20
_TURNS_A_MINUTE = 2 * math.pi / 60
_SI = {"deg": math.pi / 180, "rpm": _TURNS_A_MINUTE, "1/min": _TURNS_A_MINUTE}
"""Factors of units that are read without the library of units."""


@dataclass(frozen=True)
class _Head:
    """Content of a column: its name in :func:`measured_orders`, its unit there, and the
    unit of a head that names none.
    """

    name: str
    unit: str
    usual: str


_HEADS = {
    "time": _Head("time", "s", "s"),
    "angle": _Head("angle", "rad", "deg"),
    "speed": _Head("speed", "rad/s", "rpm"),
    "rpm": _Head("speed", "rad/s", "rpm"),
    "angular velocity": _Head("speed", "rad/s", "rad/s"),
    "mark": _Head("mark", "s", ""),
}


@dataclass(frozen=True)
class Recorded:
    """Columns of a file, each ``(n,)``: time in s; angle in rad or speed in rad/s, None
    where there is none; marks in s ``(m,)``, None without.
    """

    time: np.ndarray
    angle: np.ndarray | None
    speed: np.ndarray | None
    marks: np.ndarray | None


def read_recorded(path: str | Path, *, pulses: bool = False) -> Recorded:
    """Read a CSV file with the columns ``time`` (s), ``angle`` (deg) or ``speed`` (rpm)
    and perhaps ``mark``, heads with other units in brackets; with ``pulses`` the
    times of pulses alone.

    ``mark [s]`` lists times of the mark; without a unit it is a level, and the mark is
    where that rises through the middle of its range. :class:`SceneError` tells faults
    of heads, and the first line that is none of the table.
    """
    path = Path(path)
    try:
        table = read_csv(read_text(path, MOST_BYTES), path.name)
    except Unreadable as error:
        raise SceneError(f"{cut(str(path))}: {error}") from None
    columns = _columns(table, path.name, pulses)
    numbers = _numbers(table, columns, path.name)
    listed = {column.head.name: k for k, column in enumerate(columns)}
    missing = "time" if "time" not in listed else ""
    if not pulses and not {"angle", "speed"} & {*listed}:
        missing = missing or "angle or speed"
    if missing:
        raise SceneError(
            f"{path.name}: there is no column {missing}. Name it in the first line"
            + ("." if pulses else ", or give --pulses for times of pulses.")
        )
    time = numbers[:, listed["time"]]
    present = ~np.isnan(time)
    if not present.any():
        raise SceneError(
            f"{path.name}: there is no time below its head. Give lines of numbers."
        )
    values = {
        name: numbers[present, listed[name]]
        for name in ("angle", "speed")
        if name in listed
    }
    if len(values) > 1:
        raise SceneError(
            f"{path.name}: angle and speed are both there. Keep one of them, or put #"
            " before the head of the other."
        )
    marks = None
    if "mark" in listed:
        column = numbers[:, listed["mark"]]
        as_times = bool(columns[listed["mark"]].unit)
        marks = (
            column[~np.isnan(column)]
            if as_times
            else _rises(time[present], column[present], exact=pulses)
        )
        if not len(marks):
            raise SceneError(
                f"{path.name}: the column mark has no mark: no time, or a level that"
                " never rises. Correct it, or put # before its head."
            )
    return Recorded(time[present], values.get("angle"), values.get("speed"), marks)


@dataclass(frozen=True)
class _Column:
    """A column of a file: its place in a line, what it holds, the unit of its head."""

    place: int
    head: _Head
    unit: str
    scale: float


def _columns(table: CsvText, source: str, pulses: bool) -> list[_Column]:
    """Columns that the first line names; a single one of numbers is times."""
    if not table.lines:
        raise SceneError(f"{source}: the file is empty. Give lines of numbers.")
    first = table.lines[0]
    if all(map(table.is_number, first.cells)):
        if pulses and len(first.cells) == 1:
            return [_Column(0, _HEADS["time"], "", 1.0)]
        raise SceneError(
            f"{source}, line {first.number}: the columns have no heads. Write their"
            " names into the first line: time, and angle or speed."
        )
    columns: list[_Column] = []
    for place, cell in enumerate(first.cells):
        name, unit = name_and_unit(cell)
        name = name.strip().casefold()
        if not name or name.startswith("#"):
            continue
        where = f"{source}, line {first.number}"
        if name not in _HEADS:
            raise SceneError(
                f"{where}: there is no column {shown(cell)}.{suggestion(name, _HEADS)}"
                " Put # before the head of another one."
            )
        head = _HEADS[name]
        if head.name in [column.head.name for column in columns]:
            raise SceneError(f"{where}: there are two columns {name!r}. Keep one.")
        written = unit or head.usual
        try:
            scale = _SI.get(written) or (factor(written, head.unit) if written else 1.0)
        except UnitError as error:
            remedy = " Leave out the unit of a level." if head.name == "mark" else ""
            raise SceneError(
                f"{where}: the head is {shown(cell)}, {error}{remedy}"
            ) from None
        columns.append(_Column(place, head, unit, scale))
    return columns


def _numbers(table: CsvText, columns: list[_Column], source: str) -> np.ndarray:
    """Numbers ``(n, C)`` of the columns, nan where a cell is empty."""
    numbers = np.full((len(table.lines), len(columns)), np.nan)
    heads = not table.is_number(table.lines[0].cells[0])
    for row, line in enumerate(table.lines):
        for k, column in enumerate(columns):
            cell = line.cells[column.place] if column.place < len(line.cells) else ""
            if not cell or (heads and row == 0):
                continue
            try:
                numbers[row, k] = column.scale * table.number(cell)
            except ValueError:
                raise SceneError(
                    f"{source}, line {line.number}: {column.head.name} is"
                    f" {shown(cell)}, must be a number."
                ) from None
    return numbers


def _rises(time: np.ndarray, level: np.ndarray, *, exact: bool) -> np.ndarray:
    """Times at which a level rises through the middle of its range: at a sample where
    times are ``exact``, as those of pulses, else between two.
    """
    level = np.nan_to_num(level)
    middle = (level.max() + level.min()) / 2
    after = 1 + np.flatnonzero((level[:-1] <= middle) & (level[1:] > middle))
    if exact:
        first = [0] if level[0] > middle else []
        return time[np.array([*first, *after], dtype=int)]
    low = level[after - 1]
    share = (middle - low) / (level[after] - low)
    return time[after - 1] + share * (time[after] - time[after - 1])

"""Workbooks to the content of a scene: a sheet for each table, a row for each element,
rows of numbers on sheets of their own.
"""

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from jaxhb.elements.declared import Unread
from jaxhb.elements.elements import TABLES
from jaxhb.elements.engine import Engine
from jaxhb.elements.sentences import shown, suggestion
from jaxhb.elements.units import has_unit
from jaxhb.scene.csv_tables import name_and_unit
from jaxhb.scene.workbook.columns import (
    SETTINGS,
    Column,
    columns_of,
    free_column,
    inner_columns,
    settings_columns,
)
from jaxhb.scene.workbook.grid import Cell, Grid, grids
from jaxhb.scene.workbook.values import CellError, number_text, value_of

BESIDE = ("engine", *SETTINGS, "scenario", "sequence", "tolerance")
"""Tables beside those of single elements."""

NAMED = ("tolerance", "sequence")
"""Tables whose entries have names: the first column of their sheets."""


@dataclass(frozen=True)
class Place:
    """Where a value stands: ``sheet shaft, cell D7``, and the rows of the sheet that it
    names.
    """

    text: str
    value: Any = None
    rows: tuple[str, ...] = ()


def workbook_content(content: bytes, source: str, errors: list[str]) -> dict[str, Any]:
    """Convert the bytes of an .xlsx to tables of a scene; sentences that begin with the
    file ``source`` are added to ``errors``.

    :class:`SceneError` where it is no workbook.
    """
    reader = Reader(content, source)
    errors += dict.fromkeys(reader.errors)
    return reader.content


@dataclass(frozen=True)
class _Head:
    """The head of a column of a sheet, and the units that it names instead of those of
    the scene.
    """

    column: Column
    place: int
    units: tuple[str, ...]


class Reader:
    """Content of a workbook, and the ``places`` of its values by their paths, as
    ``("shaft", 2, "stiffness")``; of a row of an element ``("shaft", 2)``.
    """

    def __init__(self, content: bytes, source: str) -> None:
        self.source = source
        self.errors: list[str] = []
        self.places: dict[tuple, Place] = {}
        self.content: dict[str, Any] = {}
        self._grids = grids(content, source)
        self._read: dict[tuple, Any] = {}
        self._named: set[str] = set()
        for name, grid in self._grids.items():
            self._read_sheet(name, grid)
        for name, grid in self._grids.items():
            if name in self._named or not grid.rows:
                continue
            if difflib.get_close_matches(name, [*TABLES, *BESIDE], n=1):
                # It has its sentence when elements are made
                self.content[name] = []
            else:
                self._tell(
                    name,
                    "",
                    "it is no table, and no cell names it. Put # before its name, or"
                    " delete it.",
                )

    def _tell(self, sheet: str, cell: str, text: str) -> None:
        where = f"sheet {sheet}, {cell}" if cell else f"sheet {sheet}"
        self.errors.append(f"{self.source}, {where}: {text}")

    def _read_sheet(self, name: str, grid: Grid) -> None:
        """Read the sheet of a table; others are read where a cell names them."""
        table, _, inner = name.partition(".")
        value: Any = None
        if name in SETTINGS:
            columns = {column.name: column for column in settings_columns(name)}
            value = self._settings(grid, columns)
        elif name == "engine":
            rows = self._elements(grid, columns_of(Engine), (name,))
            value = rows[0] if len(rows) == 1 else rows
        elif name in TABLES:
            value = self._elements(grid, columns_of(TABLES[name]), (name,))
        elif name in NAMED:
            value = self._entries(grid, name)
        elif name == "scenario":
            value = self._scenarios(grid)
        elif table in SETTINGS and inner:
            rows = self._elements(grid, None, (name,))
            value = {inner: rows} if rows else {}
        else:
            return
        self._named.add(name)
        if not value:
            return
        if table in SETTINGS:
            value = self.content.get(table, {}) | value
        self.content[table] = value

    def _cell(self, grid: Grid, cell: Cell, head: _Head, path: tuple) -> Any:
        """Value of a cell that is not empty, whose place is noted under ``path``."""
        text = f"sheet {grid.name}, cell {cell.name}"
        self.places[path] = Place(text, cell.value)
        if cell.fault:
            self._tell(grid.name, f"cell {cell.name}", cell.fault)
            return Unread()
        column = head.column
        try:
            value = value_of(cell.value, column, head.units)
        except CellError as error:
            self._tell(grid.name, f"cell {cell.name}", str(error))
            return Unread()
        if column.kind not in ("rows", "tables") or not isinstance(value, str):
            return value
        sheet = self._sheet_called(value)
        if sheet is None and column.kind == "rows" and value.endswith(".csv"):
            return value
        if sheet is None:
            others = [name for name in self._grids if name not in TABLES]
            instead = (
                " or the name of a CSV file, or rows as [[1, 2], [3, 4]]"
                if column.kind == "rows"
                else ""
            )
            self._tell(
                grid.name,
                f"cell {cell.name}",
                f"there is no sheet {shown(value)}.{suggestion(value, others)} Give the"
                f" name of a sheet{instead}.",
            )
            return Unread()
        self._named.add(sheet)
        if column.kind == "tables":
            return self._elements(self._grids[sheet], inner_columns(column), path)
        rows, row_places = self._rows(sheet, column)
        self.places[path] = Place(text, cell.value, row_places)
        return rows

    def _sheet_called(self, name: str) -> str | None:
        """Name of the sheet that a cell names, whose capitals may differ."""
        if name in self._grids:
            return name
        folded = {sheet.casefold(): sheet for sheet in self._grids}
        return folded.get(name.casefold())

    def _heads(self, grid: Grid, columns: Mapping[str, Column] | None) -> list[_Head]:
        """Read the heads of a sheet; without ``columns`` any key is one."""
        heads: dict[str, _Head] = {}
        cells = grid.rows[0] if grid.rows else ()
        for place, cell in enumerate(cells):
            if cell.empty or (isinstance(cell.value, str) and cell.value[0] == "#"):
                if cell.empty:
                    self._tell_headless(grid, place)
                continue
            if cell.fault:
                self._tell(grid.name, f"cell {cell.name}", cell.fault)
                continue
            name, unit = name_and_unit(str(cell.value))
            column = self._column(grid, cell, name.strip(), columns, heads)
            if column is None:
                continue
            if column.name in heads:
                self._tell(
                    grid.name,
                    f"cell {cell.name}",
                    f"the head {column.name!r} is there twice. Keep one.",
                )
                continue
            units = self._units(grid, cell, column, unit)
            heads[column.name] = _Head(column, place, units)
        return list(heads.values())

    def _units(
        self, grid: Grid, cell: Cell, column: Column, unit: str
    ) -> tuple[str, ...]:
        """Units that a head names, if they are not those of its key."""
        if unit in ("", "-", "1", column.unit):
            return ()
        if column.takes_units:
            return tuple(_split(unit))
        remedy = "Leave it out"
        if column.row_columns:
            remedy = "Write units into the heads of the sheet that a cell names"
        self._tell(
            grid.name,
            f"cell {cell.name}",
            f"the head names the unit {shown(unit)}, and {column.name} has none."
            f" {remedy}.",
        )
        return ()

    def _column(
        self,
        grid: Grid,
        cell: Cell,
        name: str,
        columns: Mapping[str, Column] | None,
        heads: Mapping[str, Any],
    ) -> Column | None:
        """Column that a head means; an unknown one is read as that which it is most
        like, so that no second sentence says that this is missing.
        """
        if columns is None:
            return free_column(name)
        if name in columns:
            return columns[name]
        folded = {key.casefold(): key for key in columns}
        if name.casefold() in folded:
            return columns[folded[name.casefold()]]
        self._tell(
            grid.name,
            f"cell {cell.name}",
            f"unknown key {shown(name)}.{suggestion(name, columns)} Put # before the"
            " head of a remark.",
        )
        meant = [
            key
            for key in difflib.get_close_matches(name, columns, n=1)
            if key not in heads
        ]
        return columns[meant[0]] if meant else None

    def _tell_headless(self, grid: Grid, place: int) -> None:
        """Tell the first value below an empty head."""
        below = (row[place] for row in grid.rows[1:] if not row[place].empty)
        cell = next(below, None)
        if cell is not None:
            self._tell(
                grid.name,
                f"cell {cell.name}",
                "its column has no head. Give it a key, or a head that begins with #.",
            )

    def _elements(
        self, grid: Grid, columns: Sequence[Column] | None, path: tuple
    ) -> list[dict[str, Any]]:
        """Rows of a sheet as tables of a scene."""
        by_name = None if columns is None else {c.name: c for c in columns}
        heads = self._heads(grid, by_name)
        rows = []
        for number, cells in enumerate(grid.rows[1:]):
            row: dict[str, Any] = {}
            line = re.sub(r"\D", "", cells[0].name)
            self.places[(*path, number)] = Place(f"sheet {grid.name}, row {line}")
            for head in heads:
                cell = cells[head.place]
                place = (*path, number, *head.column.path)
                if cell.empty:
                    text = f"sheet {grid.name}, cell {cell.name}"
                    self.places[place] = Place(text)
                else:
                    _put(row, head.column.path, self._cell(grid, cell, head, place))
            rows.append(row)
        return rows

    def _rows(self, sheet: str, column: Column) -> tuple[Any, tuple[str, ...]]:
        """Rows of numbers of a sheet in the order of the columns of a field, and the
        places of these rows.
        """
        key = (sheet, column.row_columns, column.row_units)
        if key not in self._read:
            self._read[key] = self._new_rows(self._grids[sheet], column)
        return self._read[key]

    def _new_rows(self, grid: Grid, column: Column) -> tuple[Any, tuple[str, ...]]:
        names = column.row_columns
        lines = list(grid.rows)
        heads = [
            _Head(Column((name,), "number", unit), k, ())
            for k, (name, unit) in enumerate(zip(names, column.row_units, strict=True))
        ]
        count = len(self.errors)
        if lines and any(
            isinstance(cell.value, str)
            and isinstance(_number_of(cell), str)
            and not has_unit(_number_of(cell))
            for cell in lines[0]
        ):
            heads = self._heads(grid, {head.column.name: head.column for head in heads})
            heads.sort(key=lambda head: names.index(head.column.name))
            lines = lines[1:]
        else:
            self._tell_further(grid, names)
        missing = [name for name in names if name not in {h.column.name for h in heads}]
        if missing and len(self.errors) == count:
            self._tell(grid.name, "", f"the column {missing[0]!r} is missing. Give it.")
        rows = []
        places = []
        for number, cells in enumerate(lines):
            line = re.sub(r"\D", "", cells[0].name)
            places.append(f"sheet {grid.name}, row {line}")
            row = []
            for head in heads:
                if head.place >= len(cells) or cells[head.place].empty:
                    name = cells[head.place].name if head.place < len(cells) else line
                    self._tell(
                        grid.name,
                        f"cell {name}",
                        f"the {head.column.name} of the row is missing. Give a number.",
                    )
                else:
                    path = ("", grid.name, number, head.column.name)
                    row.append(self._cell(grid, cells[head.place], head, path))
            rows.append(row)
        if len(self.errors) > count:
            return Unread(), ()
        return rows, tuple(places)

    def _tell_further(self, grid: Grid, names: Sequence[str]) -> None:
        """Tell the first value beside the columns of rows that have no heads."""
        beside = (cell for row in grid.rows for cell in row[len(names) :])
        cell = next((cell for cell in beside if not cell.empty), None)
        if cell is not None:
            self._tell(
                grid.name,
                f"cell {cell.name}",
                f"rows have the columns {', '.join(names)}, and there are more. Give"
                " each column a head, a remark one that begins with #.",
            )

    def _key(self, grid: Grid, cell: Cell, present: Mapping[str, Any]) -> str:
        """Key in a cell beside a value, "" where it has a sentence: a key that is
        missing, or one of those that are ``present``.
        """
        fault = cell.fault
        if cell.empty:
            fault = "the key of the row is missing. Give it, or delete the row."
        elif str(cell.value) in present:
            fault = f"{shown(str(cell.value))} is there twice. Keep one."
        if fault:
            self._tell(grid.name, f"cell {cell.name}", fault)
            return ""
        return str(cell.value)

    def _settings(self, grid: Grid, columns: Mapping[str, Column]) -> dict[str, Any]:
        """Keys and values, below each other in the first two columns of a sheet."""
        settings: dict[str, Any] = {}
        for cells in grid.rows:
            first = cells[0]
            if first.value == "key":
                continue
            if len(cells) < 2 or cells[1].empty:
                continue
            written = self._key(grid, first, {})
            if not written:
                continue
            name, unit = name_and_unit(written)
            column = columns.get(name)
            units: tuple[str, ...] = ()
            if column is None:
                column = free_column(written)
            else:
                units = self._units(grid, first, column, unit)
            key = str(column.path[0])
            if not self._key(grid, Cell(key, first.name), settings):
                continue
            place = (grid.name, key)
            settings[key] = self._cell(grid, cells[1], _Head(column, 1, units), place)
        return settings

    def _entries(self, grid: Grid, table: str) -> dict[str, Any]:
        """Entries with names, which stand in the column ``name``."""
        rows = self._elements(grid, None, (table,))
        entries: dict[str, Any] = {}
        for number, row in enumerate(rows):
            name = row.pop("name", None)
            if not isinstance(name, str):
                place = self.places[table, number].text
                self.errors.append(f"{self.source}, {place}: its name is missing.")
            elif name in entries:
                place = self.places[table, number, "name"].text
                self.errors.append(
                    f"{self.source}, {place}: {shown(name)} is there twice. Keep one."
                )
            else:
                entries[name] = row
        return entries

    def _scenarios(self, grid: Grid) -> dict[str, Any]:
        """Scenarios, a column for each; the first column has the names of numbers."""
        if not grid.rows:
            return {}
        heads, *lines = grid.rows
        scenarios: dict[str, Any] = {}
        for place, head in enumerate(heads):
            if place == 0 or str(head.value).startswith("#"):
                continue
            if head.empty:
                self._tell_headless(grid, place)
                continue
            name = self._key(grid, head, scenarios)
            if not name:
                continue
            values = scenarios.setdefault(name, {})
            self.places["scenario", name] = Place(
                f"sheet {grid.name}, cell {head.name}"
            )
            for cells in lines:
                if cells[place].empty:
                    continue
                key = self._key(grid, cells[0], values)
                if not key:
                    continue
                column = _Head(free_column(key), place, ())
                path = ("scenario", name, key)
                values[key] = self._cell(grid, cells[place], column, path)
        return scenarios


def _number_of(cell: Cell) -> Any:
    """Number of the text of a cell; of a doubtful one 0."""
    try:
        return number_text(cell.value)
    except CellError:
        return 0.0


def _split(unit: str) -> list[str]:
    return [part.strip() for part in unit.split(";")]


def _put(row: dict[str, Any], path: tuple, value: Any) -> None:
    """Put a value into a row, in tables inside it, or at a place of a pair."""
    *outer, last = path
    if isinstance(last, int):
        *outer, key = outer
    for table in outer:
        row = row.setdefault(table, {})
    if isinstance(last, int):
        row.setdefault(key, [None, None])[last] = value
    else:
        row[last] = value

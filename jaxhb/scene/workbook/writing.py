"""Scenes as workbooks: a sheet for each table with heads, drop-down lists and what each
cell may hold, rows of numbers on sheets of their own.
"""

import io
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from jaxhb.elements.elements import TABLES
from jaxhb.elements.engine import Engine
from jaxhb.scene.files import find_scene, load_scene, parse, rows_beside
from jaxhb.scene.workbook.columns import (
    ENDS,
    SETTINGS,
    Column,
    columns_of,
    free_column,
    inner_columns,
    settings_columns,
)
from jaxhb.scene.workbook.grid import NOTES
from jaxhb.scene.workbook.reading import BESIDE, NAMED
from jaxhb.scene.workbook.values import cell_of

_LONGEST = 31  # characters of the name of a sheet
_LAST_ROW = 1000  # with drop-down lists
_OF_SETTINGS = tuple(f"{table}." for table in SETTINGS)
_OFFERED = {"report": ("yard", "Nordwerft"), "parts": ("files", "makers.toml")}
"""Tables of settings whose sheets are always there, with an example of a key."""
_EMPTY = "BFBFBF"
_REQUIRED = "FFF2CC"
_GIVEN = "D9E1F2"
_EXPLANATION = (
    "This workbook is a scene of jaxhb: a drive train whose torsional vibration is"
    " computed. Try: jaxhb check FILE.xlsx",
    "Each sheet is a table, each row below the heads an element. Sheets of tables that"
    " are not needed stay empty, or can be deleted.",
    "Heads are keys with their units. Write another unit into the head, as inertia [kg"
    " cm2], or behind a number, as 350 kg cm2. Yellow columns are required. What a cell"
    " may hold is shown when it is selected.",
    "Rows of numbers, as pressures over the crank angle, stand on sheets of their own"
    " with a head for each column; a cell names the sheet. Short ones may stand in the"
    " cell: [[1, 5.0, 0.0], [2, 3.0, 1.0]]. The name of a CSV file in the folder of the"
    " workbook is taken as well.",
    "Several values in one cell have semicolons between them.",
    "A row, a head or the name of a sheet that begins with # is a remark. Formulas may"
    " stand anywhere: their values are read as the spreadsheet program saved them.",
    "The sheet scenario has a column for each operating mode, the sheet tolerance how"
    " far numbers may deviate, the sheets tune and tune.* what jaxhb tune changes. The"
    " sheet report has the title block of reports, the sheet parts the files of"
    " catalogue parts.",
    "Keys are described in docs/reference/scene.md.",
)


def scene_workbook(
    name: str | Path,
    *,
    called: str | None = None,
    renamed: Mapping[str, str] | None = None,
) -> bytes:
    """Write a scene as an .xlsx that loads to the same train; ``name`` and ``called``
    are those of :func:`jaxhb.scene_text`.

    Rows of CSV files come on sheets; files of parts and of rules (``.toml``) stay files
    beside the workbook, under the names that ``renamed`` gives by those of the scene.
    :class:`SceneError` names all faults of the scene.

    >>> scene_workbook("spur_pair")[:2]
    b'PK'
    """
    load_scene(name)
    path = find_scene(name)
    content = parse(path, [])
    head = {"name": path.stem} | content.get("scene", {})
    if called:
        head["name"] = called
    tables = content | {"scene": head}
    for table, key in (("scene", "rules"), ("parts", "files")):
        if key in tables.get(table, {}):
            names = [(renamed or {}).get(file, file) for file in tables[table][key]]
            tables[table] = tables[table] | {key: names}
    return workbook_bytes(tables, path.parent)


def workbook_bytes(content: Mapping[str, Any], folder: Path) -> bytes:
    """Write the content of a scene as an .xlsx that is read as the same; rows of CSV
    files in the ``folder`` of the scene come on sheets.
    """
    return _Writer(folder).write(content)


class _Writer:
    """Writer of one workbook; rows of numbers that are equal share a sheet."""

    def __init__(self, folder: Path) -> None:
        import openpyxl

        self._book: Any = openpyxl.Workbook()
        self._book.remove(self._book.active)
        self._folder = folder
        self._sheets: dict[str, str] = {}
        self._later: list[tuple[str, Sequence[Column], list[dict[str, Any]]]] = []

    def write(self, content: Mapping[str, Any]) -> bytes:
        """Write all sheets."""
        self._explain()
        self._settings("scene", content.get("scene", {}), settings_columns("scene"))
        classes = {**TABLES, "engine": Engine}
        disks = [row.get("name") for row in content.get("disk", ())]
        for table, cls in classes.items():
            rows = content.get(table, [])
            rows = [rows] if isinstance(rows, dict) else rows
            by_use = _sorted(columns_of(cls), rows)
            self._elements(table, by_use, rows, example=disks or ["crank"])
        self._beside(content)
        # Lists of tables name sheets of rows in turn.
        for name, inner, rows in self._later:
            self._elements(name, inner, rows)
        stream = io.BytesIO()
        self._book.save(stream)
        return stream.getvalue()

    def _explain(self) -> None:
        """Write the sheet of notes."""
        from openpyxl.styles import Alignment

        sheet = self._new_sheet(NOTES)
        sheet.column_dimensions["A"].width = 110
        for number, text in enumerate(_EXPLANATION, 1):
            cell = sheet.cell(number, 1, text)
            cell.alignment = Alignment(wrap_text=True, vertical="top")

    def _new_sheet(self, name: str) -> Any:
        return self._book.create_sheet(name)

    def _settings(
        self, name: str, settings: Mapping[str, Any], columns: Sequence[Column]
    ) -> None:
        """Write keys and values below each other: all of declared ``columns``; where
        there are no values an example, as a remark.
        """
        declared = {column.name: column for column in columns}
        keys = dict.fromkeys((*declared, *settings))
        sheet = self._new_sheet(name)
        self._heads(sheet, [free_column("key"), free_column("value")], set())
        for number, key in enumerate(keys, 2):
            column = declared.get(key, free_column(key))
            set_cell(sheet.cell(number, 1), column.head)
            if key in settings:
                self._put(sheet.cell(number, 2), settings[key], column, name)
            if key in declared:
                _prompt(sheet, column, f"B{number}")
        if not settings and name in _OFFERED:
            sheet.sheet_properties.tabColor = _EMPTY
            key, value = _OFFERED[name]
            sheet.append([f"# {key}", value])
        sheet.column_dimensions["A"].width = 28
        sheet.column_dimensions["B"].width = 60

    def _elements(
        self,
        name: str,
        columns: Sequence[Column],
        rows: Sequence[Mapping[str, Any]],
        example: Sequence[str] = (),
    ) -> None:
        """Write the rows of a table; where there are none an ``example`` with these
        disks, as a remark.
        """
        sheet = self._new_sheet(name)
        used = {
            column.path
            for column in columns
            if any(_inside(row, column.path) is not None for row in rows)
        }
        self._heads(sheet, columns, used)
        for number, row in enumerate(rows, 2):
            owner = row.get("name") or f"{name} {number - 1}"
            for place, column in enumerate(columns, 1):
                value = _inside(row, column.path)
                if value is not None:
                    self._put(sheet.cell(number, place), value, column, owner)
        if not rows and example:
            sheet.sheet_properties.tabColor = _EMPTY
            for place, column in enumerate(columns, 1):
                text = _example(column, name, example)
                cell = sheet.cell(2, place)
                if place == 1:
                    set_cell(cell, f"# {text}")
                elif text is not None:
                    set_cell(cell, text)

    def _heads(self, sheet: Any, columns: Sequence[Column], used: set[tuple]) -> None:
        """Write the heads of a sheet, with what its cells may hold."""
        from openpyxl.styles import Font, PatternFill
        from openpyxl.utils import get_column_letter

        for place, column in enumerate(columns, 1):
            cell = sheet.cell(1, place)
            set_cell(cell, column.head)
            cell.font = Font(bold=True)
            colour = _REQUIRED if column.required else _GIVEN
            if column.required or column.path in used:
                cell.fill = PatternFill("solid", fgColor=colour)
            letter = get_column_letter(place)
            sheet.column_dimensions[letter].width = max(12, len(column.head) + 2)
            if column.field is not None:
                _prompt(sheet, column, f"{letter}2:{letter}{_LAST_ROW}")
        sheet.freeze_panes = "B2"

    def _put(self, cell: Any, value: Any, column: Column, owner: str) -> None:
        """Write one value, on a sheet of its own where it is rows."""
        if column.kind == "pair":
            set_cell(cell, cell_of(value, column))
            return
        if column.kind == "tables":
            inner = _sorted(inner_columns(column), value)
            name = self._sheet_of(f"{owner} {column.name}", [column.name, value])
            if name not in [later_name for later_name, *_ in self._later]:
                self._later.append((name, inner, value))
            self._refer(cell, name)
            return
        if column.kind != "rows":
            set_cell(cell, cell_of(value, column))
            return
        base = f"{owner} {column.name}"
        if isinstance(value, str):
            base = Path(value).stem
            value = rows_beside(
                value, self._folder, column.row_columns, column.row_units
            )
        if not value:
            set_cell(cell, json.dumps(value))
            return
        name = self._sheet_of(base, [column.row_columns, column.row_units, value])
        if name not in self._book.sheetnames:
            self._rows(name, column, value)
        self._refer(cell, name)

    def _rows(self, name: str, column: Column, rows: Iterable[Sequence[Any]]) -> None:
        """Write rows of numbers."""
        sheet = self._new_sheet(name)
        columns = [
            Column((head,), "number", unit)
            for head, unit in zip(column.row_columns, column.row_units, strict=True)
        ]
        self._heads(sheet, columns, {inner.path for inner in columns})
        for number, row in enumerate(rows, 2):
            for place, value in enumerate(row, 1):
                set_cell(sheet.cell(number, place), value)

    def _sheet_of(self, base: str, content: Any) -> str:
        """Name of the sheet of some content, the same for equal content."""
        key = json.dumps(content, default=str)
        if key not in self._sheets:
            names = {name.casefold() for name in self._sheets.values()}
            names |= {*TABLES, *BESIDE, NOTES}
            name = sheet_name(
                base.strip().lstrip("#"),
                lambda name: name in names or name.startswith(_OF_SETTINGS),
            )
            self._sheets[key] = name
        return self._sheets[key]

    def _refer(self, cell: Any, name: str) -> None:
        """Write the name of a sheet with a link to it."""
        from openpyxl.worksheet.hyperlink import Hyperlink

        set_cell(cell, name)
        cell.hyperlink = Hyperlink(ref=cell.coordinate, location=f"'{name}'!A1")

    def _beside(self, content: Mapping[str, Any]) -> None:
        """Write the tables that are no elements, as far as the scene has them or they
        are offered.
        """
        scenarios = {
            name: _flat(values) for name, values in content.get("scenario", {}).items()
        }
        if scenarios:
            self._scenarios(scenarios)
        for table in NAMED:
            entries = content.get(table, {})
            if table == "tolerance":
                entries = _flat(entries, _is_entry)
            if entries:
                rows = [{"name": name} | entry for name, entry in entries.items()]
                self._elements(table, _free_columns(rows), rows)
        for table in SETTINGS:
            settings = content.get(table, {})
            lists = {key: rows for key, rows in settings.items() if _is_tables(rows)}
            plain = {key: v for key, v in settings.items() if key not in lists}
            if (settings or table in _OFFERED) and table != "scene":
                self._settings(table, plain, settings_columns(table))
            for key, rows in lists.items():
                self._elements(f"{table}.{key}", _free_columns(rows), rows)

    def _scenarios(self, scenarios: Mapping[str, Mapping[str, Any]]) -> None:
        """Write scenarios side by side, a row for each number."""
        sheet = self._new_sheet("scenario")
        columns = [free_column(name) for name in ("key", *scenarios)]
        self._heads(sheet, columns, set())
        sheet.column_dimensions["A"].width = 40
        keys = dict.fromkeys(key for values in scenarios.values() for key in values)
        for number, key in enumerate(keys, 2):
            set_cell(sheet.cell(number, 1), key)
            for place, values in enumerate(scenarios.values(), 2):
                if key in values:
                    value = cell_of(values[key], free_column(key))
                    set_cell(sheet.cell(number, place), value)


def sheet_name(text: str, is_taken: Callable[[str], bool]) -> str:
    """Name of a sheet after a text, in letters and length as spreadsheet programs take
    it, and with a number where ``is_taken`` says so of its small letters.
    """
    plain = re.sub(r"[\[\]:*?/\\']", "_", text) or "rows"
    name = plain[:_LONGEST]
    number = 1
    while is_taken(name.casefold()):
        number += 1
        name = f"{plain[: _LONGEST - 4]} {number}"
    return name


def set_cell(cell: Any, value: Any) -> None:
    """Write a value: texts never as formulas or numbers, numbers with all digits."""
    if isinstance(value, str):
        cell.value = value
        cell.data_type = "s"
        cell.number_format = "@"
    elif isinstance(value, bool):
        cell.value = value
    else:
        # As text: openpyxl writes numbers with 16 digits, and doubles need 17.
        cell.value = repr(value)
        cell.data_type = "n"
        cell.number_format = "General"


def _prompt(sheet: Any, column: Column, cells: str) -> None:
    """Offer the values that cells may hold, and say what they are."""
    from openpyxl.worksheet.datavalidation import DataValidation

    source = None
    if column.words:
        source = f'"{",".join(column.words)}"'
    elif column.kind in ("disk", "pair"):
        source = f"=disk!$A$2:$A${_LAST_ROW}"
    elif column.kind == "cylinder":
        source = f"=cylinder!$A$2:$A${_LAST_ROW}"
    offered = DataValidation(
        type="list" if source else None,
        formula1=source,
        allow_blank=True,
        # Rings of dampers are disks as well, engines have lists: nothing is refused.
        showErrorMessage=False,
        showInputMessage=True,
        promptTitle=column.name[:32],
        prompt=column.explained()[:255],
    )
    sheet.add_data_validation(offered)
    offered.add(cells)


def _sorted(columns: Sequence[Column], rows: Sequence[Any]) -> list[Column]:
    """Columns with names and disks first, then what is required, then what rows
    have.
    """

    def rank(column: Column) -> tuple:
        is_used = any(_inside(row, column.path) is not None for row in rows)
        first = column.name != "name"
        return (
            first,
            column.kind not in ("pair", "disk"),
            not column.required,
            not is_used,
        )

    return sorted(columns, key=rank)


def _inside(row: Any, path: Sequence[str | int]) -> Any:
    """Value of a row that a path leads to, None where there is none."""
    for key in path:
        row = row[key] if isinstance(key, int) else row.get(key)
        if row is None:
            return None
    return row


def _example(column: Column, table: str, disks: Sequence[str]) -> Any:
    """Value of a column in the row that shows what is required, None for none."""
    if column.kind == "name" and column.name == "name":
        return f"{table} 1"
    if column.name in ENDS or column.kind == "disk":
        return disks[min(column.name == ENDS[1], len(disks) - 1)]
    if not column.required or column.field is None or len(column.path) > 1:
        return None
    limits = column.field.metadata.get("range")
    if limits is None:
        return "; ".join(disks[:2]) if column.kind == "list" else None
    return next(
        (
            number
            for number in (1, limits.least, limits.most)
            if number is not None and not limits.excludes(number)
        ),
        None,
    )


def _free_columns(rows: Iterable[Mapping[str, Any]]) -> list[Column]:
    """Columns of all keys of rows."""
    return [
        free_column(key) for key in dict.fromkeys(key for row in rows for key in row)
    ]


def _is_tables(value: Any) -> bool:
    """Whether a value is a list of tables; an empty list is one of texts."""
    return (
        isinstance(value, list)
        and bool(value)
        and all(isinstance(row, dict) for row in value)
    )


def _is_entry(value: Any) -> bool:
    """Whether a table is an entry of tolerances, and not the first part of a dotted
    name.
    """
    return not value or not all(isinstance(inner, dict) for inner in value.values())


def _flat(
    values: Mapping[str, Any], ends: Any = lambda value: False, before: str = ""
) -> dict[str, Any]:
    """Dotted keys for nested tables, down to those at which a name ``ends``."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, dict) and not ends(value):
            flat |= _flat(value, ends, f"{before}{key}.")
        else:
            flat[before + key] = value
    return flat

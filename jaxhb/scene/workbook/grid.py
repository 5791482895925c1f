"""Sheets of a workbook as rows of cells: values of formulas, merged cells filled, empty
rows and remarks left out.
"""

import importlib.util
import io
import re
import warnings
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from jaxhb.elements.sentences import SceneError, shown

NOTES = "notes"
"""Name of the sheet that explains the others."""

MOST_UNPACKED = 256 * 2**20  # bytes of all parts of a workbook
MOST_CELLS = 1_000_000  # of a sheet, empty ones within its borders counted
NO_LIBRARY = 'workbooks need openpyxl. Install it: pip install "jaxhb[spreadsheet]".'


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell: its value, its name as ``D7``, and a sentence where it has no value that
    can be read.
    """

    value: Any
    name: str
    fault: str = ""

    @property
    def empty(self) -> bool:
        """Whether nothing stands in it."""
        return self.value is None and not self.fault


@dataclass(frozen=True)
class Grid:
    """A sheet: its name, and its rows of cells without those that are empty or begin
    with #.
    """

    name: str
    rows: tuple[tuple[Cell, ...], ...]


def has_library() -> bool:
    """Whether the library of workbooks is installed."""
    return importlib.util.find_spec("openpyxl") is not None


def grids(content: bytes, source: str) -> dict[str, Grid]:
    """Read all sheets of a workbook but notes and those whose names begin with #;
    :class:`SceneError` where it is none.
    """
    if not has_library():
        raise SceneError(f"{source}: {NO_LIBRARY}")
    sheets = _loaded(content, source, data_only=False).worksheets
    read = [
        sheet
        for sheet in sheets
        if not (_is_remark(sheet.title) or sheet.title.casefold() == NOTES)
    ]
    for sheet in read:
        if sheet.max_row * sheet.max_column > MOST_CELLS:
            raise SceneError(
                f"{source}, sheet {sheet.title}: it has cells down to"
                f" {sheet.cell(sheet.max_row, sheet.max_column).coordinate}, must have"
                f" at most {MOST_CELLS} within its borders. Delete empty rows and"
                " columns behind the last ones."
            )
    formulas = any(
        cell.data_type == "f" for sheet in read for row in sheet.rows for cell in row
    )
    values = _loaded(content, source, data_only=True) if formulas else None
    return {
        sheet.title: _grid(sheet, values[sheet.title] if values else None)
        for sheet in read
    }


def _loaded(content: bytes, source: str, *, data_only: bool) -> Any:
    """The workbook of openpyxl."""
    import openpyxl

    try:
        with zipfile.ZipFile(io.BytesIO(content)) as parts:
            unpacked = sum(part.file_size for part in parts.infolist())
        if unpacked > MOST_UNPACKED:
            raise SceneError(
                f"{source}: the workbook unpacks to {unpacked / 2**20:.0f} MiB, must be"
                f" at most {MOST_UNPACKED // 2**20} MiB. Leave out what is not needed."
            )
        with warnings.catch_warnings():
            # Of drop-down lists and styles of other programs, which are not read
            warnings.simplefilter("ignore")
            return openpyxl.load_workbook(io.BytesIO(content), data_only=data_only)
    except SceneError:
        raise
    except Exception:  # a damaged file raises whatever its parts run into
        raise SceneError(
            f"{source}: the file is no workbook that can be read. Save it as .xlsx"
            " again."
        ) from None


def _is_remark(text: Any) -> bool:
    return isinstance(text, str) and text.startswith("#")


def _grid(sheet: Any, values: Any) -> Grid:
    """Rows of a sheet; ``values`` is the same with the values of formulas."""
    rows = [
        [_cell(cell, values and values[cell.coordinate]) for cell in row]
        for row in sheet.iter_rows()
    ]
    for merged in sheet.merged_cells.ranges:
        _fill(rows, merged)
    return Grid(sheet.title, tuple(tuple(row) for row in _without_remarks(rows)))


def _without_remarks(rows: Iterable[list[Cell]]) -> Iterable[list[Cell]]:
    for row in rows:
        first = next((cell for cell in row if not cell.empty), None)
        if first is not None and not _is_remark(first.value):
            yield row


def _cell(cell: Any, computed: Any) -> Cell:
    """Read one cell; of a formula, ``computed`` is the cell with its value."""
    formula = cell.data_type == "f"
    read = computed if formula else cell
    value = read.value
    name = cell.coordinate
    if formula and value is None:
        return Cell(
            None,
            name,
            "its formula has no value in the file. Open the workbook in a spreadsheet"
            " program and save it, or write the number.",
        )
    if read.data_type == "e":
        return Cell(None, name, f"it holds the error {value}. Correct its formula.")
    if read.data_type == "d" or not isinstance(
        value, bool | int | float | str | type(None)
    ):
        return Cell(
            None,
            name,
            "it holds a date or a time. Format it as a number, or as text, and write it"
            " again.",
        )
    if isinstance(value, str):
        value = re.sub(r"[\u00a0\u202f]", " ", value).strip() or None
    return Cell(value, name)


def _fill(rows: list[list[Cell]], merged: Any) -> None:
    """Give all cells of a merged range of one column its value; refuse one over several
    columns, unless it is a remark.
    """
    first = rows[merged.min_row - 1][merged.min_col - 1]
    if first.empty or _is_remark(first.value):
        return
    column = merged.min_col - 1
    if merged.min_col != merged.max_col:
        fault = (
            f"cells {merged.coord} with {shown(first.value)} are merged over several"
            " columns. Unmerge them."
        )
        rows[merged.min_row - 1][column] = Cell(None, first.name, fault)
        return
    for row in rows[merged.min_row : merged.max_row]:
        row[column] = Cell(first.value, row[column].name, first.fault)

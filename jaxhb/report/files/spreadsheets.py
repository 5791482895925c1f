"""Tables of answers as workbooks of spreadsheets: a sheet for each, heads that stay in
sight, numbers with as many decimals as they ask for.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from jaxhb.report.files.output import Sheet

_WIDEST = 32  # characters of a column, whose head is broken
DIGITS = 5  # that are shown of the largest number of a column; cells hold all


def as_workbook(sheets: Mapping[str, Sheet]) -> list[bytes]:
    """The .xlsx of tables by the names of their sheets; cells of what is not finite are
    empty.
    """
    import openpyxl

    from jaxhb.scene.workbook.writing import sheet_name

    book = openpyxl.Workbook()
    assert book.active is not None  # a new one has a sheet
    book.remove(book.active)
    titles: set[str] = set()
    for name, table in sheets.items():
        title = sheet_name(name, titles.__contains__)
        titles.add(title.casefold())
        _write(book.create_sheet(title), table)
    stream = io.BytesIO()
    book.save(stream)
    return [stream.getvalue()]


def merged_workbook(files: Mapping[str, str], _: Mapping[str, Any]) -> list[bytes]:
    """One workbook of those of several operating modes by title, with a sheet for
    each.
    """
    import openpyxl

    sheets = {}
    for title, path in files.items():
        book = openpyxl.load_workbook(path)
        heads, *rows = book.worksheets[0].iter_rows(values_only=True)
        sheets[title] = Sheet([str(head) for head in heads], rows)
    return as_workbook(sheets)


def _write(sheet: Any, table: Sheet) -> None:
    """Write a table on a sheet."""
    from openpyxl.styles import Alignment, Font
    from openpyxl.utils import get_column_letter

    from jaxhb.scene.workbook.writing import set_cell

    rows = [[_plain(value) for value in row] for row in table.rows]
    for place, head in enumerate(table.heads, 1):
        cell = sheet.cell(1, place)
        set_cell(cell, head)
        cell.font = Font(bold=True)
        cell.alignment = Alignment(wrap_text=True, vertical="top")
        width = min(max(len(head) + 2, 10), _WIDEST)
        sheet.column_dimensions[get_column_letter(place)].width = width
        shown = number_format([row[place - 1] for row in rows])
        for number, row in enumerate(rows, 2):
            value = row[place - 1]
            if value is None:
                continue
            cell = sheet.cell(number, place)
            set_cell(cell, value)
            if isinstance(value, float):
                cell.number_format = shown
    sheet.freeze_panes = "B2"
    sheet.auto_filter.ref = sheet.dimensions


def _plain(value: Any) -> Any:
    """A value of Python, None for what is not finite and for what is not there."""
    value = value.item() if hasattr(value, "item") else value
    if isinstance(value, float):
        return value + 0.0 if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    return str(value)


def number_format(values: Iterable[Any]) -> str:
    """Format of a column that shows :data:`DIGITS` digits of its largest number.

    >>> number_format([1800.0, 12.5]), number_format([2e-5]), number_format([3.0e7])
    ('0.0', '0.0000E+00', '0.0000E+00')
    """
    sizes: Sequence[float] = [abs(v) for v in values if isinstance(v, float)]
    largest = max(sizes, default=0.0)
    if largest and not 1e-3 <= largest < 1e6:
        return f"0.{'0' * (DIGITS - 1)}E+00"
    before = math.floor(math.log10(largest)) + 1 if largest else 1
    decimals = max(DIGITS - before, 0)
    return f"0.{'0' * decimals}" if decimals else "0"

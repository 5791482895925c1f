"""CSV files as laboratories and spreadsheets write them: the only reader of CSV in the
program.

Columns are separated by tabs, semicolons, commas or, in tables of numbers, blanks.
Decimals take a point or, where commas separate nothing, a comma. ``#`` begins a
comment; a table of numbers may have heads. A text that a spreadsheet would run as a
formula has an apostrophe before it (:func:`guarded`), which readers take away again
(:func:`unguarded`).
"""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass

from jaxhb.elements.sentences import SceneError, shown
from jaxhb.elements.units import OFTEN, UnitError, factor, is_unit

SEPARATORS = ",", ";", "\t"
_NUMBER = re.compile(r"[+-]?[\d.,]*\d[\d.,]*(?:[eE][+-]?\d+)?")
_FORMULA = re.compile(r"'*[=+\-@\t\r]")
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
"""Number whose comma may be that of decimals or of thousands."""
_UNIT_OF_HEAD = re.compile(r"(.*?)(?:\s*\[([^\]]*)\]|\s*\(([^)]*)\)|\s+in\s+(\S.*))\s*")
_CRANK_ANGLE = re.compile(r"(?:°|deg\.?)\s*(?:CA|CRA|KW)\b")


def guarded(text: str) -> str:
    """Cell of a text, with an apostrophe where a spreadsheet would read a formula."""
    return f"'{text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else text


def unguarded(cell: str) -> str:
    """Text of a cell of :func:`guarded`."""
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell


@dataclass(frozen=True, slots=True)
class Line:
    """A line of a CSV file: its number and its cells, without blanks around them."""

    number: int
    cells: tuple[str, ...]


@dataclass(frozen=True)
class CsvText:
    """Lines of a CSV file without comments and blank lines, its separator, and the mark
    of its decimals.
    """

    lines: tuple[Line, ...]
    separator: str
    decimal: str

    def number(self, cell: str) -> float:
        """Number of a cell; ValueError if it is none."""
        return float(cell.replace(",", ".") if self.decimal == "," else cell)

    def is_number(self, cell: str) -> bool:
        """Whether a cell is a number, nan and infinity among them."""
        try:
            self.number(cell)
        except ValueError:
            return False
        return True


def read_csv(
    text: str, source: str, *, columns: int | None = None, quoted: bool = True
) -> CsvText:
    """Split a text into cells.

    ``columns`` is the number of columns of a table that has nothing but numbers;
    without ``quoted`` sentences name lines and do not quote cells. :class:`SceneError`
    if the meaning of a comma is not clear.
    """
    numbered = [
        (number, line)
        for number, line in enumerate(text.split("\n"), 1)
        if line.strip() and line.lstrip()[0] != "#"
    ]
    # A line with which spreadsheets name the separator
    declared = None
    if numbered:
        declared = re.fullmatch(r"\s*sep=([,;|\t])\s*", numbered[0][1])
    if declared:
        numbered = numbered[1:]
    try:
        if declared:
            separator = declared[1]
        else:
            separator = _separator([line for _, line in numbered], columns)
        lines = tuple(Line(k, _cells(line, separator)) for k, line in numbered)
    except csv.Error as error:
        raise SceneError(
            f"{source}: the file is no CSV: {error}. Correct it."
        ) from None
    return CsvText(lines, separator, _decimal_mark(lines, source, quoted))


def name_and_unit(head: str) -> tuple[str, str]:
    """Name and unit of the head of a column, no unit where it has none in brackets or
    behind "in".

    >>> name_and_unit("pressure [bar]"), name_and_unit("angle in deg")
    (('pressure', 'bar'), ('angle', 'deg'))
    >>> name_and_unit("heat_transfer [W/(m2 K)]")
    ('heat_transfer', 'W/(m2 K)')
    """
    match = _UNIT_OF_HEAD.fullmatch(head)
    if not match:
        return head, ""
    return match[1], _CRANK_ANGLE.sub(
        "deg", (match[2] or match[3] or match[4] or "").strip()
    )


def number_rows(
    text: str,
    columns: Sequence[str],
    source: str,
    *,
    units: Sequence[str] = (),
    quoted: bool = True,
) -> tuple:
    """Rows of a table of numbers, in the order of ``columns`` whatever the order of the
    heads, and in their ``units`` where heads name others.

    Other arguments are those of :func:`read_csv`; :class:`SceneError` on the first line
    that is no row.
    """
    table = read_csv(text, source, columns=len(columns), quoted=quoted)
    lines = [
        Line(line.number, _without_empty_ends(line.cells, len(columns)))
        for line in table.lines
    ]
    first = next(
        (k for k, line in enumerate(lines) if any(map(table.is_number, line.cells))),
        len(lines),
    )
    heads = [line for line in lines[:first] if len(line.cells) == len(columns)]
    places = _places(heads, columns)
    units = units or ("",) * len(columns)
    scales = _scales(heads, columns, units, places, source, quoted)
    rows = []
    for line in lines[first:]:
        if len(line.cells) != len(columns) or not all(map(table.is_number, line.cells)):
            raise SceneError(_no_row(table, line, columns, source, quoted))
        numbers = [table.number(cell) for cell in line.cells]
        rows.append(
            tuple(
                numbers[place] * scale
                for place, scale in zip(places, scales, strict=True)
            )
        )
    if not rows:
        raise SceneError(
            f"{source} holds no rows. Give {', '.join(columns)} on each line."
        )
    return tuple(rows)


def _separator(lines: list[str], columns: int | None) -> str:
    """Separator of the columns: in a table of numbers a comma only where there is
    neither tab nor semicolon.
    """
    if columns is None:  # heads come first, and names may hold any mark
        first = lines[0] if lines else ""
        return max(SEPARATORS, key=lambda mark: len(_cells(first, mark)))
    separator = next(
        (mark for mark in reversed(SEPARATORS) if any(mark in line for line in lines)),
        " ",
    )
    # "0 1,0e5" has one number too few between commas.
    if (
        separator == ","
        and _are_numbers(lines[-1].split(), columns)
        and not _are_numbers(lines[-1].split(","), columns)
    ):
        return " "
    return separator


def _are_numbers(cells: list[str], columns: int) -> bool:
    """Whether cells are as many numbers as there are columns."""
    return len(cells) == columns and all(
        _NUMBER.fullmatch(cell.strip()) for cell in cells
    )


def _cells(line: str, separator: str) -> tuple[str, ...]:
    """Cells of a line, without blanks around them and apostrophes before formulas."""
    if separator == " ":
        return tuple(line.split())
    return tuple(
        unguarded(cell.strip())
        for cell in next(csv.reader([line], delimiter=separator))
    )


def _without_empty_ends(cells: tuple[str, ...], count: int) -> tuple[str, ...]:
    """Cells without the empty ones that a separator at the end of a line makes."""
    while len(cells) > count and not cells[-1]:
        cells = cells[:-1]
    return cells


def _decimal_mark(lines: tuple[Line, ...], source: str, quoted: bool) -> str:
    """Decimal mark of the numbers of a file, the same for all."""
    numbers = [
        (line.number, cell)
        for line in lines
        for cell in line.cells
        if _NUMBER.fullmatch(cell)
    ]
    commas = [(number, cell) for number, cell in numbers if "," in cell]
    if not commas:
        return "."

    def place(number: int, cell: str) -> str:
        return f"{source}, line {number}: {shown(cell) if quoted else 'a number'}"

    cure = "Write decimals with a point, and thousands without a mark."
    for number, cell in commas:
        if "." in cell or cell.count(",") > 1:
            raise SceneError(f"{place(number, cell)} has several marks. {cure}")
    number, cell = commas[0]
    points = [line_number for line_number, cell in numbers if "." in cell]
    if points:
        other = f"in line {points[0]} decimals have a point"
        raise SceneError(f"{place(number, cell)} has a comma, and {other}. {cure}")
    if all(THOUSANDS.fullmatch(cell) for _, cell in commas):
        raise SceneError(
            f"{place(number, cell)} may have decimals or thousands behind its comma."
            f" {cure}"
        )
    return ","


def _words(head: str) -> set[str]:
    """Words of the head of a column, in lower case."""
    return set(re.findall(r"[a-z]+", head.lower()))


def _places(heads: list[Line], columns: Sequence[str]) -> list[int]:
    """Place of each column in a line: by its name in the heads if all names are there,
    else in the order of ``columns``.
    """
    places = list(range(len(columns)))
    for line in heads:
        named = [
            [k for k, head in enumerate(line.cells) if _words(column) <= _words(head)]
            for column in columns
        ]
        unique = all(len(matches) == 1 for matches in named)
        if unique and len({matches[0] for matches in named}) == len(columns):
            places = [matches[0] for matches in named]
    return places


def _scales(
    heads: list[Line],
    columns: Sequence[str],
    units: Sequence[str],
    places: Sequence[int],
    source: str,
    quoted: bool,
) -> list[float]:
    """Factors from the units that heads name to those of the columns."""
    scales = [1.0] * len(columns)
    for line in heads:
        for k, (column, unit, place) in enumerate(
            zip(columns, units, places, strict=True)
        ):
            head = line.cells[place]
            written = _unit_of(head, unit)
            try:
                if written:
                    scales[k] = factor(written, unit)
            except UnitError as error:
                has = f"is {shown(head)}, {error}"
                why = has if quoted else f"has no unit of {unit or 'a number'}."
                raise SceneError(
                    f"{source}, line {line.number}: the head of {column} {why}"
                ) from None
    return scales


def _unit_of(head: str, unit: str) -> str:
    """Unit that the head of a column of numbers in ``unit`` names, "" for none."""
    written = name_and_unit(head)[1]
    often = {choice.casefold(): choice for choice in OFTEN.get(unit, ())}
    if not written:
        # As "p mpa": capitals of heads are often lost.
        words = re.split(r"[\s_,;/]+", head.casefold())
        return next((often[word] for word in words if word in often), "")
    # Round brackets and "in" may as well hold a remark, as "pressure in cylinder 1".
    remark = "[" not in head and not is_unit(written)
    return "" if remark or written in ("-", "1") else written


def _no_row(
    table: CsvText, line: Line, columns: Sequence[str], source: str, quoted: bool
) -> str:
    """Sentence about a line that is no row of the columns."""
    mark = {"\t": "\t", " ": " "}.get(table.separator, f"{table.separator} ")
    row = shown(mark.join(line.cells)) if quoted else "no such row"
    names = {"\t": "tabs", ";": "semicolons", ",": "commas", " ": "blanks"}
    separators = names.get(table.separator, "one mark")
    if table.separator == ",":
        separators += ", or by semicolons where decimals have commas"
    return (
        f"{source}, line {line.number} is {row}, must be {len(columns)} numbers"
        f" {', '.join(columns)}, separated by {separators}. Correct it or put # before"
        " it."
    )

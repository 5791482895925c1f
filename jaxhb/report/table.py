"""Tables of reports: columns that read and write rows, as text and as cells."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, Self

from jaxhb.report.text.columns import DOUBT, Doubtful, Way, alike
from jaxhb.report.units import shown_unit

THOUSANDTHS = 3  # decimals


@dataclass(frozen=True)
class Column:
    """A column of a table.

    way : how values are written, by a function of one value, or by a key that is shared
    by the columns of numbers that get the same decimals; read : reader of the value
    from a row, by default what stands at the place of the column; group : title above
    this column and its neighbours of the same group; left : whether texts are flush
    left, as those of the first column always are; unit : SI unit of its numbers, which
    are shown in the unit for people, "" where they are shown as they are
    """

    head: str
    way: Way = str
    read: Callable[..., Any] | None = None
    group: str = ""
    left: bool = False
    unit: str = ""


class Table(str):
    """A table as text under its caption, with its cells at hand for other ways to show
    it. In caption, heads and groups ``{N m}`` stands for the unit in which people read
    the columns of that SI unit.

    columns : texts of each column; groups : (title, first, last) from left to right;
    left : numbers of the columns that are flush left; marked : numbers of the rows that
    a page shows in red, as those above a limit
    """

    caption: str
    heads: list[str]
    columns: list[list[str]]
    groups: list[tuple[str, int, int]]
    left: set[int]
    marked: frozenset[int]

    def __new__(
        cls,
        caption: str,
        columns: Sequence[Column | str],
        rows: Iterable[Any],
        *,
        marked: Iterable[int] = (),
    ) -> Self:
        """Write values of rows in columns; a word is the head of a column of texts."""
        specs = [Column(each) if isinstance(each, str) else each for each in columns]
        rows = list(rows)
        values = [
            [spec.read(row) if spec.read else row[place] for row in rows]
            for place, spec in enumerate(specs)
        ]
        enlarged = set()
        for unit in dict.fromkeys(spec.unit for spec in specs if spec.unit):
            factor, shown = shown_unit(unit, _largest(specs, values, unit))
            if shown != shown_unit(unit)[1]:
                enlarged.add(unit)
            words = f"{{{unit}}}", shown
            caption = caption.replace(*words)
            values = [
                [_scaled(value, factor) for value in column]
                if spec.unit == unit
                else column
                for spec, column in zip(specs, values, strict=True)
            ]
            specs = [
                replace(
                    spec,
                    head=spec.head.replace(*words),
                    group=spec.group.replace(*words),
                )
                for spec in specs
            ]
        cells = _written(
            values,
            [spec.way for spec in specs],
            # As many digits as in the smaller unit without decimals
            [THOUSANDTHS * (spec.unit in enlarged) for spec in specs],
        )
        heads = [spec.head for spec in specs]
        groups = []
        for title, several in groupby(enumerate(specs), lambda pair: pair[1].group):
            places = [place for place, _ in several]
            if title:
                groups.append((title, places[0], places[-1]))
        left = {0, *(place for place, spec in enumerate(specs) if spec.left)}
        text = _aligned(heads, cells, groups, left)
        table = super().__new__(cls, f"{caption}\n{text}" if caption else text)
        table.caption = caption
        table.heads = heads
        table.columns = cells
        table.groups = groups
        table.left = left
        table.marked = frozenset(marked)
        return table


def _largest(
    specs: Sequence[Column], values: Sequence[Sequence[Any]], unit: str
) -> float:
    """Size of the largest number of the columns of an SI unit."""
    return max(
        (
            abs(value)
            for spec, column in zip(specs, values, strict=True)
            if spec.unit == unit
            for value in column
            if not isinstance(value, str) and math.isfinite(value)
        ),
        default=0.0,
    )


def _scaled(value: Any, factor: float) -> Any:
    """A number times a factor, doubtful as it was; words stay."""
    if isinstance(value, str):
        return value
    return Doubtful(factor * value) if isinstance(value, Doubtful) else factor * value


def _written(
    values: Sequence[Sequence[Any]], ways: Sequence[Way], least: Sequence[int]
) -> list[list[str]]:
    """Write columns of values, each in its way and with at ``least`` so many decimals,
    with a mark behind doubtful numbers.
    """
    cells: list[list[str]] = [[] for _ in values]
    for way in dict.fromkeys(ways):
        places = [place for place, other in enumerate(ways) if other == way]
        chosen = [values[place] for place in places]
        if callable(way):
            texts = [list(map(way, column)) for column in chosen]
        else:
            texts = alike(*chosen, least=max(least[place] for place in places))
        for place, column in zip(places, texts, strict=True):
            cells[place] = [
                text + DOUBT * (isinstance(value, Doubtful) and text[:1].isdigit())
                for text, value in zip(column, values[place], strict=True)
            ]
    return cells


def _aligned(
    heads: Sequence[str],
    columns: Sequence[Sequence[str]],
    groups: Sequence[tuple[str, int, int]],
    left: set[int],
) -> str:
    """Align texts under their heads and groups of columns, flush left or right."""
    cells = [[head, *column] for head, column in zip(heads, columns, strict=True)]
    widths = [max(map(len, column)) for column in cells]
    above = ""
    for title, first, last in groups:
        room = sum(widths[first : last + 1]) + 2 * (last - first)
        widths[first] += max(0, len(title) - room)
        begin = sum(widths[:first]) + 2 * first
        above = above.ljust(begin) + f" {title} ".center(max(room, len(title)), "-")
    justified = [
        [cell.ljust(width) if place in left else cell.rjust(width) for cell in column]
        for place, (column, width) in enumerate(zip(cells, widths, strict=True))
    ]
    rows = ["  ".join(row).rstrip() for row in zip(*justified, strict=True)]
    return "\n".join("  " + row for row in [*[above.rstrip()] * bool(groups), *rows])

"""Tables of text: numbers in columns, and how they are written."""

import math
from collections.abc import Callable, Collection, Hashable, Sequence
from typing import Any, Self

import numpy as np

NONE = "-"
# Behind numbers that are not converged, or not confirmed by harmonic balance
DOUBT = "?"

ROUNDING = 1e-9  # size of a number that is zero but for rounding

Way = Callable[[Any], str] | Hashable
"""How a column is written: by a function of one value, or by a key that is shared by
the columns of numbers that get the same decimals.
"""
Head = str | tuple[str, Way]
"""Head of a column, alone where the column holds texts, else with its way."""
Groups = Sequence[tuple[str, int, int]]
"""Groups of columns from left to right: title, first and last column."""


class Doubtful(float):
    """A number that is written with a mark behind it."""


class Table(str):
    """A table as text under its title, as :func:`aligned`, with its cells at hand for
    other ways to show it.
    """

    title: str  # type: ignore[assignment]  # in place of a method of str
    heads: list[str]
    columns: list[list[str]]
    groups: Groups
    left: Collection[int]

    def __new__(
        cls,
        title: str,
        heads: Sequence[str],
        columns: Sequence[Sequence[Any]],
        groups: Groups = (),
        left: Collection[int] = (),
    ) -> Self:
        cells = [[str(cell) for cell in column] for column in columns]
        text = aligned(heads, cells, groups, left)
        table = super().__new__(cls, f"{title}\n{text}" if title else text)
        table.title = title
        table.heads = list(heads)
        table.columns = cells
        table.groups = groups
        table.left = left
        return table


def from_rows(
    title: str,
    heads: Sequence[Head],
    rows: Sequence[Sequence[Any]],
    groups: Groups = (),
    left: Collection[int] = (),
) -> Table:
    """Make a :class:`Table` of rows of values; a head may be (head, way), with a way of
    :func:`written`.
    """
    pairs = [(head, str) if isinstance(head, str) else head for head in heads]
    names = [name for name, _ in pairs]
    ways = [way for _, way in pairs]
    columns = [[row[place] for row in rows] for place in range(len(pairs))]
    return Table(title, names, written(columns, ways), groups, left)


def written(columns: Sequence[Sequence[Any]], ways: Sequence[Way]) -> list[list[str]]:
    """Write columns of values, each in its way: by a function of one value, or, where
    the way is no function, with the same decimals as all numbers in this way.
    """
    cells: list[list[str]] = [[] for _ in columns]
    for way in dict.fromkeys(ways):
        places = [place for place, other in enumerate(ways) if other == way]
        chosen = [columns[place] for place in places]
        if callable(way):
            texts = [list(map(way, column)) for column in chosen]
        else:
            texts = alike(*chosen)
        for place, column in zip(places, texts, strict=True):
            cells[place] = column
    return cells


def aligned(
    heads: Sequence[str],
    columns: Sequence[Sequence[Any]],
    groups: Groups = (),
    left: Collection[int] = (),
) -> str:
    """Columns of strings under their heads and groups of columns, (title, first, last),
    from left to right; the first column is flush left, as those numbered in ``left``,
    the others right.
    """
    cells = [
        [head, *map(str, column)] for head, column in zip(heads, columns, strict=True)
    ]
    widths = [max(map(len, column)) for column in cells]
    above = ""
    for title, first, last in groups:
        room = sum(widths[first : last + 1]) + 2 * (last - first)
        widths[first] += max(0, len(title) - room)
        begin = sum(widths[:first]) + 2 * first
        above = above.ljust(begin) + f" {title} ".center(max(room, len(title)), "-")
    justified = [
        str.ljust if i == 0 or i in left else str.rjust for i in range(len(cells))
    ]
    rows = [
        "  ".join(
            justify(cell, width)
            for justify, cell, width in zip(justified, row, widths, strict=True)
        ).rstrip()
        for row in zip(*cells, strict=True)
    ]
    return "\n".join("  " + row for row in [*[above.rstrip()] * bool(groups), *rows])


def alike(*columns: Sequence[float]) -> list[list[str]]:
    """Write columns of numbers with the same decimals: four significant digits for the
    largest of all.
    """
    numbers = [[float(value) for value in column] for column in columns]
    largest = max(
        (abs(x) for column in numbers for x in column if math.isfinite(x)), default=0.0
    )
    places = 0 if largest == 0 else min(max(3 - math.floor(math.log10(largest)), 0), 12)
    return [[_with_places(value, places) for value in column] for column in columns]


def _with_places(value: float, places: int) -> str:
    """A number with so many decimals, a dash where it is not known, and a mark where it
    is doubtful.
    """
    mark = DOUBT * isinstance(value, Doubtful)
    number = float(value)
    # Adding 0.0 after rounding turns -0.0 into 0.0.
    return (
        f"{round(number, places) + 0.0:.{places}f}{mark}"
        if math.isfinite(number)
        else NONE
    )


def fixed(value: float, places: int) -> str:
    """A number with so many decimals; one that is too small for them and more than
    rounding with two digits, a dash where it is not known.
    """
    if not math.isfinite(value):
        return NONE
    rounded = round(float(value), places) + 0.0
    if rounded == 0 and abs(value) > ROUNDING:
        return plain_number(float(value), 2)
    return f"{rounded:.{places}f}"


def plain_number(value: float, digits: int = 4) -> str:
    """A number with so many digits, as 12340, without a power of ten where that is
    readable.
    """
    value = value + 0.0  # no minus zero
    if not 1e-4 <= abs(value) < 1e7:
        return f"{value:.{digits}g}"
    return np.format_float_positional(float(f"{value:.{digits}g}"), trim="-")


def percent(share: float | None) -> str:
    """A share in %, a small one not as 0, a dash where it is not known."""
    if share is None or not math.isfinite(share):
        return NONE
    return "<0.1" if 0 < share < 5e-4 else f"{100 * share:.1f}"


def count(number: float) -> str:
    """A number of events, three digits, a dash where it is not known."""
    return plain_number(number, digits=3) if math.isfinite(number) else NONE


def hit(speed: float) -> str:
    """Approach speed of an impact in m/s, a small one with two digits, a dash without
    an impact.
    """
    return fixed(speed, 2) if speed > 0 else NONE


def irregular(share: float) -> str:
    """Cyclic irregularity in %, a dash where it is not known."""
    return count(100 * share)


def ratio(pair: tuple[float, float]) -> str:
    """A quotient with two decimals, a dash where nothing is compared."""
    value = float(pair[0]) / float(pair[1]) if pair[1] else math.nan
    return f"{value:.2f}" if math.isfinite(value) else NONE


WAYS: dict[str, Way] = {
    "percent": percent,
    "count": count,
    "hit": hit,
    "irregular": irregular,
}
"""Ways in which numbers of answers are written, by the words of
:class:`jaxhb.results.quantities.Variable`.
"""

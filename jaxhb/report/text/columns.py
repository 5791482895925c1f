"""Tables of text: numbers in columns, and how they are written."""

import math

import numpy as np

NONE = "-"
DOUBT = (  # behind numbers that are not converged, or not confirmed by harmonic balance
    "?"
)


ROUNDING = 1e-9  # size of a number that is zero but for rounding


class Doubtful(float):
    """A number that is written with a mark behind it."""


def from_rows(title, heads, rows, groups=(), left=()):
    """A :class:`Table` of rows of values; a head may be (head, way), as of
    :func:`written`.
    """
    heads, ways = zip(
        *((head, str) if isinstance(head, str) else head for head in heads), strict=True
    )
    columns = [[row[place] for row in rows] for place in range(len(heads))]
    return Table(title, heads, written(columns, ways), groups, left)


def written(columns, ways):
    """Cells of columns of values, each written in its way: by a function of one value,
    or, where the way is no function, with the same decimals as all numbers in this way.
    """
    cells = list(columns)
    for way in dict.fromkeys(ways):
        own = [place for place, one in enumerate(ways) if one == way]
        done = (
            [map(way, columns[i]) for i in own]
            if callable(way)
            else alike(*(columns[i] for i in own))
        )
        for place, column in zip(own, done, strict=True):
            cells[place] = list(column)
    return cells


class Table(str):
    """A table as text under its title, as :func:`aligned`, with its cells at hand for
    other ways to show it.
    """

    def __new__(cls, title, heads, columns, groups=(), left=()):
        columns = [[str(cell) for cell in column] for column in columns]
        text = aligned(heads, columns, groups, left)
        made = super().__new__(cls, f"{title}\n{text}" if title else text)
        made.title, made.heads, made.columns, made.groups, made.left = (
            title,
            list(heads),
            columns,
            groups,
            left,
        )
        return made


def aligned(heads, columns, groups=(), left=()):
    """Columns of strings under their heads and groups of columns, (title, first, last),
    from left to right; the first column is flush left, as those numbered in ``left``,
    the others right.
    """
    columns = [
        [head, *map(str, column)] for head, column in zip(heads, columns, strict=True)
    ]
    widths = [max(map(len, column)) for column in columns]
    above = ""
    for title, first, last in groups:
        room = sum(widths[first : last + 1]) + 2 * (last - first)
        widths[first] += max(0, len(title) - room)
        begin = sum(widths[:first]) + 2 * first
        above = above.ljust(begin) + f" {title} ".center(max(room, len(title)), "-")
    flush = [
        str.ljust if i == 0 or i in left else str.rjust for i in range(len(columns))
    ]
    rows = [
        "  ".join(
            put(cell, width)
            for put, cell, width in zip(flush, row, widths, strict=True)
        ).rstrip()
        for row in zip(*columns, strict=True)
    ]
    return "\n".join("  " + row for row in [*[above.rstrip()] * bool(groups), *rows])


def alike(*columns):
    """Columns of numbers with the same decimals: four significant digits for the
    largest of all.
    """
    numbers = [[float(value) for value in column] for column in columns]
    largest = max(
        (abs(x) for column in numbers for x in column if math.isfinite(x)), default=0.0
    )
    places = 0 if largest == 0 else min(max(3 - math.floor(math.log10(largest)), 0), 12)
    return [[_with_places(value, places) for value in column] for column in columns]


def _with_places(value, places):
    """A number with so many decimals, a dash where it is not known, and a mark where it
    is doubtful.
    """
    mark = DOUBT * isinstance(value, Doubtful)
    value = float(value)
    # Adding 0.0 after rounding turns -0.0 into 0.0.
    return (
        f"{round(value, places) + 0.0:.{places}f}{mark}"
        if math.isfinite(value)
        else NONE
    )


def fixed(value, places):
    """A number with so many decimals; one that is too small for them and more than
    rounding with two digits, a dash where it is not known.
    """
    if not math.isfinite(value):
        return NONE
    rounded = round(float(value), places) + 0.0
    if rounded == 0 and abs(value) > ROUNDING:
        return plain_number(float(value), 2)
    return f"{rounded:.{places}f}"


def plain_number(value, digits=4):
    """A number with so many digits, as 12340, without a power of ten where that is
    readable.
    """
    value = value + 0.0  # no minus zero
    if not 1e-4 <= abs(value) < 1e7:
        return f"{value:.{digits}g}"
    return np.format_float_positional(float(f"{value:.{digits}g}"), trim="-")


def percent(share):
    """A share in %, a small one not as 0, a dash where it is not known."""
    if share is None or not math.isfinite(share):
        return NONE
    return "<0.1" if 0 < share < 5e-4 else f"{100 * share:.1f}"


def count(number):
    """A number of events, three digits, a dash where it is not known."""
    return plain_number(number, digits=3) if math.isfinite(number) else NONE


def hit(speed):
    """Approach speed of an impact, a small one with two digits, a dash without one."""
    return fixed(speed, 2) if speed > 0 else NONE


def irregular(share):
    """Cyclic irregularity in %, a dash where it is not known."""
    return count(100 * share)


def ratio(pair):
    """A quotient with two decimals, a dash where nothing is compared."""
    value = float(pair[0]) / float(pair[1]) if pair[1] else math.nan
    return f"{value:.2f}" if math.isfinite(value) else NONE

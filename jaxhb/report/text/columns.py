"""Numbers in columns of text."""

import math

import numpy as np

NONE = "-"


class Table(str):
    """A table as text, with its cells at hand for other ways to show it.

    Parameters
    ----------
    title : str
        A line or more above it; empty: none.
    heads, columns, groups, left : as for :func:`aligned`

    Examples
    --------
    >>> table = Table("Disks", ["disk", "kg m2"], [["hub", "flywheel"], ["0.1", "2"]])
    >>> print(table)
    Disks
      disk      kg m2
      hub         0.1
      flywheel      2
    >>> table.columns[1]
    ['0.1', '2']
    """

    def __new__(cls, title, heads, columns, groups=(), left=()):
        columns = [[str(cell) for cell in column] for column in columns]
        text = aligned(heads, columns, groups, left)
        made = super().__new__(cls, f"{title}\n{text}" if title else text)
        made.title, made.heads, made.columns, made.groups, made.left = title, heads, columns, groups, left
        return made

    def __getnewargs__(self):
        return self.title, self.heads, self.columns, self.groups, self.left


def aligned(heads, columns, groups=(), left=()):
    """Columns of strings under their heads; the first flush left, as those numbered in ``left``, the others right."""
    columns = [[head, *map(str, column)] for head, column in zip(heads, columns, strict=True)]
    widths = [max(map(len, column)) for column in columns]
    for title, first, last in groups:
        room = sum(widths[first : last + 1]) + 2 * (last - first)
        widths[first] += max(0, len(title) - room)
    flush = [str.ljust if i == 0 or i in left else str.rjust for i in range(len(columns))]
    rows = [
        "  ".join(put(cell, width) for put, cell, width in zip(flush, row, widths, strict=True)).rstrip()
        for row in zip(*columns, strict=True)
    ]
    return "\n".join("  " + row for row in [*_group_line(groups, widths), *rows])


def _group_line(groups, widths):
    line = ""
    for title, first, last in groups:
        begin = sum(widths[:first]) + 2 * first
        room = sum(widths[first : last + 1]) + 2 * (last - first)
        line = line.ljust(begin) + f" {title} ".center(room, "-")
    return [line.rstrip()] if groups else []


def alike(*columns, digits=4):
    """Columns of numbers with the same decimals: ``digits`` significant ones for the largest of all."""
    numbers = [[float(value) for value in column] for column in columns]
    largest = max((abs(x) for column in numbers for x in column if math.isfinite(x)), default=0.0)
    places = 0 if largest == 0 else min(max(digits - 1 - math.floor(math.log10(largest)), 0), 12)
    # Adding 0.0 after rounding turns -0.0 into 0.0.
    return [
        [f"{round(x, places) + 0.0:.{places}f}" if math.isfinite(x) else NONE for x in column] for column in numbers
    ]


def shares(fractions):
    """Fractions of the cycle in %; a small one is not shown as 0."""
    return [NONE if share is None or not math.isfinite(share) else percent(share) for share in fractions]


def percent(share):
    """A share in %, a small one not as 0."""
    return "<0.1" if 0 < share < 5e-4 else f"{100 * share:.1f}"


def ratios(numbers, before):
    """Quotients with two decimals, ``-`` where nothing is compared."""
    quotient = [float(a) / float(b) if b else np.nan for a, b in zip(numbers, before, strict=True)]
    return [f"{value:.2f}" if math.isfinite(value) else NONE for value in quotient]


def ranges(speeds, chosen, to="-"):
    """``1500-2450`` for speeds that follow each other."""
    runs, ordered = [], sorted(speeds)
    for i, speed in enumerate(ordered):
        if speed not in chosen:
            continue
        if runs and i and runs[-1][1] == ordered[i - 1]:
            runs[-1][1] = speed
        else:
            runs.append([speed, speed])
    return ", ".join(f"{a:g}" if a == b else f"{a:g}{to}{b:g}" for a, b in runs)

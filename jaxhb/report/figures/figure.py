"""One specification of a figure for plotly.js, on the page, and for matplotlib: axes,
lines, marks, bands and texts. Dashes, symbols and words tell what colours tell too.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from jaxhb.report.figures.lettering import width_of
from jaxhb.report.units import is_chosen

if TYPE_CHECKING:
    from jaxhb.report.answer import Answer

Trace = dict[str, Any]
"""A trace of plotly.js, of plain numbers and words."""

Column = Sequence[float] | np.ndarray
"""Numbers of a trace, nan where there is none."""

Limits = tuple[float, float]
"""Range of an axis."""

WIDTH = 680
PANEL = 155
GAP = 26
BOTTOM = 46
EDGE = 9
"""Pixels: the width of an A4 page between its margins, the height of a panel, the gap
between two, the axis below, and the edge below that.
"""

LEGEND_ROW = 19
LEGEND_SIZE = 10
KEY = 45
"""Pixels of a row of the legend, of the font in it, and of the line before a name with
the gaps beside it.
"""

BESIDE = 76
BESIDE_NARROW = 58
"""Pixels left and right of the panels, of a figure as wide as a page and of others."""

TITLE_LETTER = 5.9  # pixels of a letter of the title of an axis
THOUSANDS = {"N m": "kN m", "kN m": "MN m", "kN": "MN", "W": "kW", "kW": "MW"}
# Largest number of an axis in a unit; above it the next of THOUSANDS is taken
MOST = 2000.0
THOUSANDTHS = {"kN": "N", "MPa": "kPa"}
# Units that powers of ten stand before where numbers are tiny
SMALL = ("N", "kPa", "N m", "W", "deg", "rpm", "%")
LEAST = 1e-3  # largest number of an axis in a unit, below which a smaller one is taken
HEADROOM = 1.08
DIGITS = 5
MARKED = 80  # points up to which every one is marked, or with a large mark
WITH = "#b3261e"
WITHOUT = "#1f4e79"
GREY = "#6f6f6f"
BAND = "#e3e3e3"
ZERO = "#9a9a9a"
STYLES = (
    {"color": WITH, "dash": "solid"},
    {"color": WITHOUT, "dash": "dash"},
    {"color": "#2e7d32", "dash": "dashdot"},
    {"color": GREY, "dash": "dot"},
    {"color": "#6a1b9a", "dash": "longdash"},
    {"color": "#ef6c00", "dash": "longdashdot"},
)
"""Lines that differ without colour."""

SYMBOLS = "circle", "square", "diamond", "triangle-up", "cross", "star"
"""Symbols of marked lines, by their style."""

ALONE = (
    "cross-thin-open",
    "line-ew-open",
    "triangle-left",
    "triangle-right",
    "pentagon",
    "hexagon",
)
"""Symbols of lines of one point, which nothing else would show, by their style; none of
them is a kind of motion.
"""

MOTIONS = {
    "contact": ("circle", "teeth in contact"),
    "periodic": ("square", "periodic, one cycle"),
    "subharmonic": ("diamond", "period of several cycles"),
    "irregular": ("star", "irregular"),
    "unstable": ("triangle-down", "unstable: the train does not run there"),
    None: ("x-thin-open", "no result"),
}
"""Symbol and words of every kind of motion, in every picture; None: there are no
numbers.
"""

NO_ANSWER = MOTIONS[None][1]


@dataclass(frozen=True)
class Axis:
    """An axis: its title, and its range, None where the numbers tell it.

    log : whether it is logarithmic; linear : number up to which it is linear on both
    sides of 0 and logarithmic beyond, of an upright axis of files; step : between
    ticks; ticks : their places, with words or without; grid : colour of lines at ticks
    """

    title: str
    limits: Limits | None = None
    log: bool = False
    linear: float | None = None
    step: float | None = None
    ticks: Mapping[float, str] | Sequence[float] = ()
    grid: str = "#e4e4e4"


@dataclass(frozen=True)
class Band:
    """Grey between two x, over the whole height or that of a panel."""

    low: float
    high: float
    panel: int | None = None


@dataclass(frozen=True)
class Figure:
    """Panels of one height above one another, over one axis.

    x, panels : axes, those of the panels from the top; traces, notes : lines, marks and
    texts, as plotly.js calls them; height : of a panel; top, right, bottom : room
    beside the panels, pixels; legend : side at which it stands; width : pixels of a
    page that it takes
    """

    caption: str
    x: Axis
    panels: list[Axis]
    traces: list[Trace]
    bands: Sequence[Band] = ()
    notes: Sequence[dict[str, Any]] = ()
    height: int = PANEL
    top: int = 0
    right: int = 14
    bottom: int = BOTTOM
    legend: Literal["left", "right"] = "left"
    width: int = WIDTH

    @property
    def narrow(self) -> bool:
        """Whether two stand side by side on a page."""
        return self.width < WIDTH

    @property
    def in_legend(self) -> list[Trace]:
        """Traces that the legend names: of one name there is none."""
        named = [trace for trace in self.traces if trace.get("showlegend", True)]
        return named if len(named) > 1 else []

    def titles(self, end: str) -> list[str]:
        """Titles of the panels in rows, with ``end`` between them, that are no longer
        than a panel is high.
        """
        most = max(8, int(self.height / TITLE_LETTER))
        return [
            end.join(textwrap.wrap(axis.title, most, break_long_words=False))
            for axis in self.panels
        ]

    @property
    def inside(self) -> int:
        """Pixels from the top of the first panel to the bottom of the last."""
        return self.height * len(self.panels) + GAP * (len(self.panels) - 1)

    @property
    def above(self) -> int:
        """Pixels above the panels."""
        rows = -(-len(self.in_legend) // legend_columns(self.traces, self.width))
        return 12 + LEGEND_ROW * rows + self.top

    @property
    def pixels(self) -> int:
        """The whole height."""
        return self.inside + self.above + self.bottom + EDGE


def figure(
    caption: str,
    x: Axis,
    panels: str | Sequence[Axis],
    traces: Sequence[Trace],
    *,
    height: int = PANEL,
    bands: Sequence[Band] = (),
    notes: Sequence[dict[str, Any]] = (),
) -> Figure:
    """Make a :class:`Figure` of panels, or of one, given by its title, which begins at
    zero and holds all numbers; units make numbers short.
    """
    axes = [Axis(panels)] if isinstance(panels, str) else list(panels)
    shown = list(traces)
    for panel, axis in enumerate(axes):
        axes[panel], shown = _in_readable_unit(axis, panel, shown)
    if isinstance(panels, str):
        # The caption tells the unit of its only panel.
        unit = panels.rpartition(", ")[2]
        readable = axes[0].title.rpartition(", ")[2]
        if unit != readable:
            caption = re.sub(rf", {unit}(?!\w)", f", {readable}", caption)
        axes = [replace(axes[0], limits=top_of(shown))]
    return Figure(caption, x, axes, shown, bands, notes, height)


def _in_readable_unit(
    axis: Axis, panel: int, traces: list[Trace]
) -> tuple[Axis, list[Trace]]:
    """Write numbers of thousands of a panel in the next larger unit, 12 kN m in place
    of 12000 N m, and tiny ones in a smaller unit.
    """
    name, comma, unit = axis.title.rpartition(", ")
    y_axis = numbered("y", panel)
    largest = max(
        (
            abs(y)
            for trace in traces
            if trace["yaxis"] == y_axis
            for y in trace["y"]
            if y is not None
        ),
        default=0.0,
    )
    fixed = not comma or is_chosen(unit)
    factor, readable = (1.0, unit) if fixed else _readable(unit, largest)
    if readable == unit:
        return axis, traces
    limits = axis.limits
    if limits:
        limits = (factor * limits[0], factor * limits[1])
    scaled = [
        trace | {"y": _scaled(trace["y"], factor)}
        if trace["yaxis"] == y_axis
        else trace
        for trace in traces
    ]
    return replace(axis, title=f"{name}, {readable}", limits=limits), scaled


def _readable(unit: str, largest: float) -> tuple[float, str]:
    """Return the factor from a unit, and the unit in which an axis up to ``largest``
    has short numbers.

    >>> _readable("N m", 12000.0), _readable("kN", 4e-7), _readable("deg", 2e-8)
    ((0.001, 'kN m'), (1000000000.0, '1e-6 N'), (1000000000.0, '1e-9 deg'))
    """
    factor = 1.0
    while factor * largest > MOST and unit in THOUSANDS:
        factor = 1e-3 * factor
        unit = THOUSANDS[unit]
    while 0 < factor * largest < LEAST and unit in THOUSANDTHS:
        factor = 1e3 * factor
        unit = THOUSANDTHS[unit]
    if 0 < factor * largest < LEAST and unit in SMALL:
        thousands = -math.floor(math.log10(factor * largest) / 3)
        return factor * 1e3**thousands, f"1e-{3 * thousands} {unit}"
    return factor, unit


def _scaled(values: Iterable[float | None], factor: float) -> list[float | None]:
    """Multiply the numbers of a trace by a factor."""
    return numbers(math.nan if value is None else factor * value for value in values)


def numbered(name: str, panel: int) -> str:
    """Name an axis of a panel as plotly.js does: y, y2, y3."""
    return f"{name}{panel + 1}" if panel else name


def legend_columns(traces: Iterable[Trace], width: int = WIDTH) -> int:
    """Count the columns of the legend, from the lengths of its names."""
    widths = [
        KEY + width_of(trace["name"], LEGEND_SIZE)
        for trace in traces
        if trace.get("showlegend", True)
    ]
    room = width - (BESIDE if width == WIDTH else BESIDE_NARROW)
    if sum(widths) <= room:
        return max(1, len(widths))
    # plotly gives every entry the width of the longest.
    return max(1, int(room // max(widths)))


def numbers(values: Iterable[float]) -> list[float | None]:
    """Round numbers to five digits, as they go into the page; None where there is
    none.
    """
    return [
        float(f"{value:.{DIGITS}g}") + 0.0 if math.isfinite(value) else None
        for value in map(float, values)
    ]


def line(
    x: Column,
    y: Column,
    name: str,
    style: int = 0,
    *,
    panel: int = 0,
    look: dict[str, Any] | None = None,
    alone: int | None = None,
    **more: Any,
) -> Trace:
    """Make a line over x; ``style`` numbers one of STYLES, ``look`` is what differs
    from it, ``more`` are further attributes of the trace.

    Where a point has none beside it the line has marks: the symbol of its style, or
    number ``alone`` of ALONE.
    """
    turn, place = divmod(style, len(STYLES))
    trace = {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(x),
        "y": numbers(y),
        "name": name,
    } | more
    if "markers" in trace["mode"]:
        trace.setdefault("marker", {"symbol": SYMBOLS[place], "size": 6})
    elif _stands_alone(trace["y"]):
        symbol = ALONE[place if alone is None else alone]
        edge = {"width": 2 * symbol.endswith("-open")}
        trace |= {
            "mode": "lines+markers",
            "marker": {"symbol": symbol, "size": 9, "line": edge},
        }
    # A colour that comes once more has another dash than before.
    dash = STYLES[(place + turn) % len(STYLES)]["dash"]
    full_look = STYLES[place] | {"dash": dash, "width": 1.6} | (look or {})
    return trace | {"yaxis": numbered("y", panel), "line": full_look}


def _stands_alone(values: Sequence[float | None]) -> bool:
    """Tell whether a number has none beside it, so that no line reaches it."""
    present = [False, *(value is not None for value in values), False]
    return any(
        here and not before and not after
        for before, here, after in zip(present, present[1:], present[2:], strict=False)
    )


def bars(
    x: Column,
    low: Column,
    high: Column,
    name: str,
    *,
    panel: int = 0,
    look: dict[str, Any] | None = None,
    **more: Any,
) -> Trace:
    """Make upright bars, all in one line: nan ends each."""
    gaps = np.full(len(x), np.nan)
    return line(
        np.stack((x, x, gaps), axis=-1).ravel(),
        np.stack((low, high, gaps), axis=-1).ravel(),
        name,
        panel=panel,
        look=look,
        **more,
    )


OTHER_RECORDS = "other records, +- 2 deviations"


def spread_bars(
    x: Column, values: Column, spread: Column, width: float, **more: Any
) -> list[Trace]:
    """Make bars with feet of ``width`` at values of irregular motions, to where those
    of other records as long may lie, in a list; none where no spread is known.
    """
    rows = np.transpose([x, values, spread]).astype(float)
    place, middle, half = rows[rows[:, 2] > 0].T
    if not len(place):
        return []
    gap = np.full(len(place), np.nan)
    left = place - width / 2
    right = place + width / 2
    high = middle + half
    low = middle - half
    across = np.stack([left, right, gap, place, place, gap, left, right, gap], axis=-1)
    up = np.stack([high, high, gap, high, low, gap, low, low, gap], axis=-1)
    return [
        line(
            across.ravel(),
            up.ravel(),
            OTHER_RECORDS,
            look={"color": "#ef6c00", "dash": "solid", "width": 2.2},
            hoverinfo="skip",
            **more,
        )
    ]


def marks(
    x: Column,
    y: Column,
    name: str,
    symbol: str,
    *,
    panel: int = 0,
    size: float = 8,
    color: str = "black",
    **more: Any,
) -> Trace:
    """Make points over x; ``more`` are further attributes of the trace."""
    trace = {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(x),
        "y": numbers(y),
        "name": name,
        "yaxis": numbered("y", panel),
        "marker": {
            "symbol": symbol,
            "size": size,
            "color": color,
            "line": {"width": 2 * ("thin" in symbol), "color": color},
        },
    }
    return trace | more


def kind_of(answer: Answer) -> str | None:
    """Return the key of MOTIONS of an answer."""
    if not answer.answered:
        return None
    if answer.unstable:
        return "unstable"
    return answer.state.kind


def motion_line(
    answers: Sequence[Answer],
    values: Column,
    name: str,
    style: int = 0,
    *,
    hollow: bool = False,
) -> Trace:
    """Make a line over the speed with the symbol of the kind of motion at every speed;
    a gap where there is no answer.
    """
    kinds = [kind_of(answer) for answer in answers]
    symbols = [
        (MOTIONS[kind][0] if kind else "circle") + "-open" * hollow for kind in kinds
    ]
    size = 6 if len(answers) <= MARKED else 4
    return line(
        [answer.place for answer in answers],
        values,
        name,
        style,
        mode="lines+markers",
        text=[MOTIONS[kind][1] for kind in kinds],
        hovertemplate=f"%{{x}} {answers[0].axis.unit}: %{{y}}, %{{text}}",
        marker={"symbol": symbols, "size": size + 3 * hollow},
    )


def kind_keys(*lists: Sequence[Answer]) -> list[Trace]:
    """Make entries of the legend for the kinds of motion that occur, and crosses at the
    bottom where there is no answer.
    """
    answers = [answer for answers in lists for answer in answers]
    kinds = {kind_of(answer) for answer in answers}
    keys = [
        marks([np.nan], [np.nan], words, symbol)
        for kind, (symbol, words) in MOTIONS.items()
        if kind in kinds - {None}
    ]
    places = {answer.place for answer in answers if not answer.answered}
    return keys + crosses(sorted(places))


UNCONFIRMED = "ringed: not confirmed, ? in tables"


def rings(points: Sequence[tuple[float, float]]) -> list[Trace]:
    """Make rings round numbers that harmonic balance did not confirm, in a list."""
    if not points:
        return []
    x, y = zip(*points, strict=True)
    return [marks(x, y, UNCONFIRMED, "circle-open", size=14)]


def crosses(speeds: Column, bottom: float = 0.0) -> list[Trace]:
    """Make crosses at the bottom where there is no answer, in a list."""
    if not len(speeds):
        return []
    heights = [bottom] * len(speeds)
    return [marks(speeds, heights, NO_ANSWER, "x-thin-open", cliponaxis=False)]


def top_of(traces: Iterable[Trace]) -> Limits:
    """Return the range of an axis from zero that holds all numbers of some lines."""
    highest = max(
        (y for trace in traces for y in trace["y"] if y is not None), default=0.0
    )
    return (0.0, HEADROOM * highest if highest > 0 else 1.0)


def speed_range(rpm: Column) -> Limits:
    """Return the range of the axis of speeds, a little wider than they are."""
    low = min(rpm)
    high = max(rpm)
    edge = 0.02 * (high - low) or 0.05 * high
    return (low - edge, high + edge)


def bands(
    edges: Iterable[Sequence[float]] | np.ndarray, panel: int | None = None
) -> list[Band]:
    """Make grey bands between pairs of x, over the whole height or that of a panel."""
    return [Band(float(low), float(high), panel) for low, high in edges]


def note(
    text: str, x: float, y: float, *, size: float = 10, **more: Any
) -> dict[str, Any]:
    """Make a text at a place; ``more`` are further attributes of the annotation."""
    return {
        "text": text,
        "x": x,
        "y": y,
        "showarrow": False,
        "font": {"size": size},
    } | more


def above(text: str, panel: int) -> dict[str, Any]:
    """Make a text above a panel, at the left."""
    return note(
        text,
        0.0,
        1.0,
        xref="paper",
        yref=f"{numbered('y', panel)} domain",
        xanchor="left",
        yanchor="bottom",
    )


def plain(name: str) -> str:
    """Write ``a|b`` as a label."""
    return name.replace("|", " - ")

"""One specification of a figure for plotly.js, on the page, and for matplotlib: lines,
marks, bands and panels as plain dictionaries. Dashes, symbols and words tell what
colours tell too.
"""

import math
import re
import textwrap
from dataclasses import dataclass

import numpy as np

WIDTH = 680
PANEL = 155
BOTTOM = 46
"""Pixels: what an A4 page has between its margins, the height of a panel, and what the
axis below takes.
"""

LEGEND_ROW = 19
LETTER = 4.9
KEY = 46
"""Pixels of a row of the legend, of a letter in it, and of the line before its name."""

AXIS = 62
ROW = 15
"""Pixels left of a panel, with a title of one row, and of another row of the title."""

TITLE_LETTER = 5.9  # pixels of a letter of the title of an axis
THOUSANDS = {"N m": "kN m", "kN m": "MN m", "kN": "MN", "W": "kW", "kW": "MW"}
# Largest number of an axis in a unit; above it the next of THOUSANDS is taken
MOST = 2000.0
THOUSANDTHS = {"kN": "N", "MPa": "kPa"}
SMALL = (
    "N",
    "kPa",
    "N m",
    "W",
    "deg",
    "rpm",
    "%",
)  # units that powers of ten stand before where numbers are tiny
LEAST = 1e-3  # largest number of an axis in a unit, below which a smaller one is taken
HEADROOM = 1.08
DIGITS = 5
MARKED = 80  # points up to which every one is marked, or with a large mark
WITH, WITHOUT, GREY, BAND = "#b3261e", "#1f4e79", "#6f6f6f", "#e3e3e3"
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
"""Of marked lines, by their style."""

ALONE = (
    "cross-thin-open",
    "line-ew-open",
    "triangle-left",
    "triangle-right",
    "pentagon",
    "hexagon",
)
"""Of lines of one point, which nothing else would show, by their style; none of them is
a kind of motion.
"""

MOTIONS = {
    "contact": ("circle", "teeth in contact"),
    "periodic": ("square", "periodic, one cycle"),
    "subharmonic": ("diamond", "period of several cycles"),
    "irregular": ("star", "irregular"),
    "unstable": ("triangle-down", "unstable: the train does not run there"),
    None: ("x-thin-open", "no answer: unknown, or not converged"),
}
"""Symbol and words of every kind of motion, in every picture; None: there are no
numbers.
"""

NO_ANSWER = MOTIONS[None][1]
ALONG = {
    "type": "rect",
    "xref": "x",
    "y0": 0,
    "y1": 1,
    "layer": "below",
    "fillcolor": BAND,
    "line": {"width": 0},
}


@dataclass(frozen=True)
class Figure:
    """A caption, traces and a layout, all of plain numbers and words, as plotly.js
    draws them.
    """

    caption: str
    traces: list
    layout: dict


def figure(
    caption,
    x_title,
    panels,
    traces,
    *,
    x_range=None,
    height=PANEL,
    shapes=(),
    annotations=(),
):
    """A :class:`Figure` of panels above one another, each a (title, range or None) from
    the top, over one axis; or of one panel, given by its title, which begins at zero
    and holds all numbers.
    """
    caption, panels, traces = _readable_units(caption, panels, traces)
    panels = [(panels, top_of(traces))] if isinstance(panels, str) else panels
    panels = [(_wrapped(title, height), limits) for title, limits in panels]
    rows_of_title = max(title.count("<br>") for title, _ in panels)
    keys = sum(trace.get("showlegend", True) for trace in traces)
    rows = (
        -(-keys // legend_columns(traces)) if keys > 1 else 0
    )  # one name needs no legend
    above = 12 + LEGEND_ROW * rows
    gap = 26
    inside = height * len(panels) + gap * (len(panels) - 1)
    axis = {
        "showline": True,
        "mirror": True,
        "linecolor": "black",
        "ticks": "outside",
        "gridcolor": "#e4e4e4",
    }
    axis["exponentformat"] = "none"
    made = {
        "width": WIDTH,
        "height": round(inside + above + BOTTOM + 9),
        "margin": {
            "l": AXIS + ROW * rows_of_title,
            "r": 14,
            "t": above,
            "b": BOTTOM,
            "autoexpand": False,
        },
        "font": {
            "size": 11,
            "color": "black",
            "family": "Arial, Helvetica, sans-serif",
        },
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "hovermode": "closest",
        "separators": ".",  # no comma in 12000 rpm
        "showlegend": rows > 0,
        "legend": {
            "orientation": "h",
            "x": 0,
            "y": 1 + 6 / inside,
            "yanchor": "bottom",
            "font": {"size": 10},
        },
        "xaxis": (
            axis
            | {
                "title": {"text": x_title},
                "zeroline": False,
                "anchor": _numbered("y", len(panels) - 1),
                "mirror": "all" if len(panels) > 1 else True,
                # Mirrored ticks would cross the texts above the panels.
                "ticks": "" if len(panels) > 1 else "outside",
            }
        ),
        "shapes": list(shapes),
        "annotations": list(annotations),
    }
    for panel, (title, _) in enumerate(panels):
        top = inside - panel * (height + gap)
        own = {
            "title": {"text": title, "standoff": 6},
            "domain": [max(0.0, (top - height) / inside), top / inside],
        }
        made[_numbered("yaxis", panel)] = axis | own | {"zerolinecolor": "#9a9a9a"}
    for name, limits in [
        ("xaxis", x_range),
        *((_numbered("yaxis", k), own) for k, (_, own) in enumerate(panels)),
    ]:
        made[name] |= (
            {} if limits is None else {"range": [float(limit) for limit in limits]}
        )
    return Figure(caption, traces, made)


def _readable_units(caption, panels, traces):
    """Caption, panels and traces with numbers of thousands in the next larger unit, 12
    kN m in place of 12000 N m, and tiny ones in a smaller unit.
    """
    single = isinstance(panels, str)
    titles, ranges = (
        ([panels], [None]) if single else map(list, zip(*panels, strict=True))
    )
    for panel, title in enumerate(titles):
        _, behind, unit = title.rpartition(", ")
        shown = [trace for trace in traces if trace["yaxis"] == _numbered("y", panel)]
        largest = max(
            (abs(y) for trace in shown for y in trace["y"] if y is not None),
            default=0.0,
        )
        factor, readable = _readable(unit, largest) if behind else (1.0, unit)
        if readable == unit:
            continue
        titles[panel] = f"{title.removesuffix(unit)}{readable}"
        ranges[panel] = ranges[panel] and tuple(
            factor * limit for limit in ranges[panel]
        )
        scaled = {
            id(trace): trace | {"y": _scaled(trace["y"], factor)} for trace in shown
        }
        traces = [scaled.get(id(trace), trace) for trace in traces]
        if single:  # the caption tells the unit of its only panel
            caption = re.sub(rf", {unit}(?!\w)", f", {readable}", caption)
    return (
        caption,
        titles[0] if single else list(zip(titles, ranges, strict=True)),
        list(traces),
    )


def _readable(unit, largest):
    """Factor from a unit, and the unit in which an axis up to ``largest`` has short
    numbers.

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


def _scaled(values, factor):
    """Numbers of a trace times a factor."""
    return numbers(math.nan if value is None else factor * value for value in values)


def _wrapped(title, height):
    """The title of a panel in rows that are no longer than the panel is high."""
    return "<br>".join(
        textwrap.wrap(title, max(8, int(height / TITLE_LETTER)), break_long_words=False)
    )


def _numbered(name, panel):
    return f"{name}{panel + 1}" if panel else name


def legend_columns(traces):
    """Columns of the legend, from the lengths of its names."""
    widths = [
        KEY + LETTER * len(trace["name"])
        for trace in traces
        if trace.get("showlegend", True)
    ]
    if sum(widths) <= WIDTH - 76:
        return max(1, len(widths))
    return max(
        1, int((WIDTH - 76) // max(widths))
    )  # plotly gives every entry the width of the longest


def numbers(values):
    """Numbers as they go into the page: five digits, None where there is none."""
    return [
        float(f"{value:.{DIGITS}g}") + 0.0 if math.isfinite(value) else None
        for value in map(float, values)
    ]


def line(x, y, name, style=0, *, panel=0, look=None, alone=None, **more):
    """A line over x; ``style`` numbers one of STYLES, ``look`` is what differs from it.

    Where a point has none beside it the line has marks: the symbol of its style, or
    number ``alone`` of ALONE.
    """
    turn, place = divmod(style, len(STYLES))
    own = {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(x),
        "y": numbers(y),
        "name": name,
    } | more
    if "markers" in own["mode"]:
        own.setdefault("marker", {"symbol": SYMBOLS[place], "size": 6})
    elif _stands_alone(own["y"]):
        symbol = ALONE[place if alone is None else alone]
        edge = {"width": 2 * symbol.endswith("-open")}
        own |= {
            "mode": "lines+markers",
            "marker": {"symbol": symbol, "size": 9, "line": edge},
        }
    # What has a colour once more has another dash than before.
    drawn = (
        STYLES[place]
        | {"dash": STYLES[(place + turn) % len(STYLES)]["dash"], "width": 1.6}
        | (look or {})
    )
    return own | {"yaxis": _numbered("y", panel), "line": drawn}


def _stands_alone(values):
    """Whether a number has none beside it, so that no line reaches it."""
    known = [False, *(value is not None for value in values), False]
    return any(
        at and not before and not after
        for before, at, after in zip(known, known[1:], known[2:], strict=False)
    )


def bars(x, low, high, name, *, panel=0, look=None, **more):
    """Upright bars, all in one line: nan ends each."""
    gaps = np.full(len(x), np.nan)
    ends = (
        np.stack(columns, axis=-1).ravel()
        for columns in ((x, x, gaps), (low, high, gaps))
    )
    return line(*ends, name, panel=panel, look=look, **more)


OTHER_RECORDS = "other records, +- 2 deviations"


def spread_bars(x, values, spread, width, **more):
    """Bars with feet of ``width`` at values of irregular motions, to where those of
    other records as long may lie, in a list; none where no spread is known.
    """
    known = np.flatnonzero(np.asarray(spread) > 0)
    if not len(known):
        return []
    x, values, spread = (
        np.asarray(column, float)[known] for column in (x, values, spread)
    )
    gap = np.full(len(x), np.nan)
    left = x - width / 2
    right = x + width / 2
    high = values + spread
    low = values - spread
    across = np.stack([left, right, gap, x, x, gap, left, right, gap], axis=-1)
    up = np.stack([high, high, gap, high, low, gap, low, low, gap], axis=-1)
    look = {"color": "#ef6c00", "dash": "solid", "width": 2.2}
    return [
        line(
            across.ravel(),
            up.ravel(),
            OTHER_RECORDS,
            look=look,
            hoverinfo="skip",
            **more,
        )
    ]


def marks(x, y, name, symbol, *, panel=0, size=8, color="black", **more):
    """Points over x."""
    own = {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(x),
        "y": numbers(y),
        "name": name,
    }
    marker = {
        "symbol": symbol,
        "size": size,
        "color": color,
        "line": {"width": 2 * ("thin" in symbol), "color": color},
    }
    return own | {"yaxis": _numbered("y", panel), "marker": marker} | more


def kind_of(answer):
    """Key of MOTIONS."""
    if not answer.answered:
        return None
    if answer.unstable:
        return "unstable"
    return answer.state.kind


def motion_line(answers, values, name, style=0, *, hollow=False):
    """A line over the speed with the symbol of the kind of motion at every speed; a gap
    where there is no answer.
    """
    kinds = [kind_of(answer) for answer in answers]
    symbols = [
        (MOTIONS[kind][0] if kind else "circle") + "-open" * hollow for kind in kinds
    ]
    more = {"mode": "lines+markers", "text": [MOTIONS[kind][1] for kind in kinds]}
    more["hovertemplate"] = f"%{{x}} {answers[0].axis.unit}: %{{y}}, %{{text}}"
    more["marker"] = {
        "symbol": symbols,
        "size": (6 if len(answers) <= MARKED else 4) + 3 * hollow,
    }
    return line([answer.place for answer in answers], values, name, style, **more)


def kind_keys(*lists):
    """Entries of the legend for the kinds of motion that occur, and crosses at the
    bottom where there is no answer.
    """
    met = {kind_of(answer) for answers in lists for answer in answers}
    keys = [
        marks([np.nan], [np.nan], said, symbol)
        for kind, (symbol, said) in MOTIONS.items()
        if kind in met - {None}
    ]
    return keys + crosses(
        sorted(
            {
                answer.place
                for answers in lists
                for answer in answers
                if not answer.answered
            }
        )
    )


UNCONFIRMED = "ringed: not confirmed by harmonic balance, ? in tables"


def rings(speeds, values):
    """Rings round numbers that harmonic balance did not confirm, in a list."""
    return (
        [marks(speeds, values, UNCONFIRMED, "circle-open", size=14)]
        if len(speeds)
        else []
    )


def crosses(speeds, bottom=0.0):
    """Crosses at the bottom where there is no answer, in a list."""
    return (
        [
            marks(
                speeds,
                [bottom] * len(speeds),
                NO_ANSWER,
                "x-thin-open",
                cliponaxis=False,
            )
        ]
        if len(speeds)
        else []
    )


def top_of(traces):
    """Range of an axis from zero that holds all numbers of some lines."""
    highest = max(
        (y for trace in traces for y in trace["y"] if y is not None), default=0.0
    )
    return (0.0, HEADROOM * highest if highest > 0 else 1.0)


def speed_range(rpm):
    """Range of the axis of speeds, a little wider than they are."""
    low = min(rpm)
    high = max(rpm)
    edge = 0.02 * (high - low) or 0.05 * high
    return (low - edge, high + edge)


def bands(edges, panel=None):
    """Grey bands between pairs of x, over the whole height or that of a panel."""
    rows = "paper" if panel is None else f"{_numbered('y', panel)} domain"
    return [
        ALONG | {"yref": rows, "x0": float(low), "x1": float(high)}
        for low, high in edges
    ]


def note(text, x, y, *, size=10, **more):
    """A text at a place."""
    return {
        "text": text,
        "x": x,
        "y": y,
        "showarrow": False,
        "font": {"size": size},
    } | more


def above(text, panel):
    """A text above a panel, at the left."""
    more = {
        "xref": "paper",
        "yref": f"{_numbered('y', panel)} domain",
        "xanchor": "left",
        "yanchor": "bottom",
    }
    return note(text, 0.0, 1.0, **more)


def plain(name):
    """``a|b`` as a label."""
    return name.replace("|", " - ")

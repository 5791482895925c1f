"""One specification of a figure for plotly.js, on the page, and for matplotlib: lines, marks, bands and panels as plain
dictionaries. Dashes, symbols and words tell what colours tell too."""

import math
from dataclasses import dataclass

import numpy as np

from jaxhb.report.figures.style import GAP, MOTIONS, WITH, WITHOUT

WIDTH, PANEL, EDGES = 680, 155, 70
"""Pixels: what an A4 page has between its margins, the height of a panel, and what axes take beside it."""

LEGEND_ROW, LETTER, KEY = 19, 4.9, 46
"""Pixels of a row of the legend, of a letter in it, and of the line before its name."""

HEADROOM = 1.08
DIGITS = 5

SYMBOLS = {kind: symbol for kind, (_, symbol, *_) in MOTIONS.items() if kind != "unknown"}
"""Symbol of every kind of motion that has numbers."""

NO_ANSWER = MOTIONS["unknown"][-1]
STYLES = (
    {"color": WITH, "dash": "solid"},
    {"color": WITHOUT, "dash": "dash"},
    {"color": "#2e7d32", "dash": "dashdot"},
    {"color": "#6f6f6f", "dash": "dot"},
    {"color": "#6a1b9a", "dash": "longdash"},
    {"color": "#ef6c00", "dash": "longdashdot"},
)
"""Lines that differ without colour."""


@dataclass(frozen=True)
class Figure:
    """A caption, traces and a layout, all of plain numbers and words, as plotly.js draws them."""

    caption: str
    traces: list
    layout: dict


def numbers(values):
    """Numbers as they go into the page: five digits, None where there is none."""
    return [float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None for value in map(float, values)]


def line(x, y, name, style=0, *, panel=0, **more):
    """A line over x; ``style`` numbers one of STYLES."""
    own = {"type": "scatter", "mode": "lines", "x": numbers(x), "y": numbers(y), "name": name}
    turn, place = divmod(style, len(STYLES))
    # What has a colour once more has another dash than before.
    look = {"color": STYLES[place]["color"], "dash": STYLES[(place + turn) % len(STYLES)]["dash"], "width": 1.6}
    return own | _axis(panel) | {"line": look} | more


def marks(x, y, name, symbol, *, panel=0, size=8, color="black", **more):
    """Points over x."""
    own = {"type": "scatter", "mode": "markers", "x": numbers(x), "y": numbers(y), "name": name}
    return own | _axis(panel) | {"marker": {"symbol": symbol, "size": size, "color": color}} | more


def _axis(panel):
    return {"yaxis": f"y{panel + 1}" if panel else "y"}


def layout(x_title, panels, traces, *, x_range=None, heights=None, shapes=(), annotations=()):
    """The layout of panels above one another over one axis.

    Parameters
    ----------
    x_title : str
    panels : list of (title, range or None)
        From the first, at the top.
    traces : list of dict
        Their names make the legend.
    x_range : (low, high), optional
    heights : list of float, pixels, optional
    """
    heights = heights or [PANEL] * len(panels)
    rows = _legend_rows(traces)
    above, gap = 12 + LEGEND_ROW * rows, 26
    inside = sum(heights) + gap * (len(panels) - 1)
    axis = {"showline": True, "mirror": True, "linecolor": "black", "ticks": "outside", "gridcolor": "#e4e4e4"}
    axis["exponentformat"] = "none"
    made = {
        "width": WIDTH,
        "height": round(inside + above + EDGES - 15),
        "margin": {"l": 62, "r": 14, "t": above, "b": 46, "autoexpand": False},
        "font": {"size": 11, "color": "black", "family": "Arial, Helvetica, sans-serif"},
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "hovermode": "closest",
        "showlegend": rows > 0,
        "legend": {"orientation": "h", "x": 0, "y": 1 + 6 / inside, "yanchor": "bottom", "font": {"size": 10}},
        "xaxis": axis | {"title": {"text": x_title}, "zeroline": False, "anchor": _last("y", len(panels))},
        "shapes": list(shapes),
        "annotations": list(annotations),
    }
    made["xaxis"] |= {"range": [float(x) for x in x_range]} if x_range is not None else {}
    top = inside
    for number, ((title, limits), height) in enumerate(zip(panels, heights, strict=True)):
        own = axis | {"title": {"text": title}, "domain": [max(0.0, (top - height) / inside), top / inside]}
        own |= {"zerolinecolor": "#9a9a9a"} | ({"range": [float(y) for y in limits]} if limits is not None else {})
        made[_last("yaxis", number + 1)] = own
        top -= height + gap
    return made


def _last(name, count):
    return name if count == 1 else f"{name}{count}"


def _legend_rows(traces):
    """Rows that the legend takes; one name needs none."""
    count = sum(trace.get("showlegend", True) for trace in traces)
    return -(-count // legend_columns(traces)) if count > 1 else 0


def legend_columns(traces):
    """Columns of the legend, from the lengths of its names."""
    widths = [KEY + LETTER * len(trace["name"]) for trace in traces if trace.get("showlegend", True)]
    if sum(widths) <= WIDTH - 76:
        return max(1, len(widths))
    return max(1, int((WIDTH - 76) // max(widths)))  # plotly gives every entry the width of the longest


def top_of(*columns):
    """Range of an axis from zero that holds all numbers."""
    known = [y for column in columns for y in column if y is not None and math.isfinite(y)]
    highest = max(known, default=0.0)
    return (0.0, HEADROOM * highest if highest > 0 else 1.0)


def speed_range(rpm):
    """Range of the axis of speeds, a little wider than they are."""
    low, high = min(rpm), max(rpm)
    edge = 0.02 * (high - low) or 0.05 * high
    return (low - edge, high + edge)


def kind_of(answer):
    """Key of SYMBOLS; None where there is no answer."""
    if not answer.answered:
        return None
    if answer.growth.unstable:
        return "unstable"
    return answer.state.kind if answer.topology.mesh_names else "periodic"


def kind_word(kind):
    """A kind of motion in a few words."""
    return MOTIONS[kind][-1].split(" (")[0]


def motion_line(answers, values, name, style=0, *, panel=0, hollow=False):
    """A line over the speed with the symbol of the kind of motion at every speed; a gap where there is no answer."""
    symbols = [SYMBOLS.get(kind_of(answer), "circle") + "-open" * hollow for answer in answers]
    said = [kind_word(kind_of(answer) or "unknown") for answer in answers]
    more = {"mode": "lines+markers", "text": said, "hovertemplate": f"%{{x}} {answers[0].axis.unit}: %{{y}}, %{{text}}"}
    more["marker"] = {"symbol": symbols, "size": 6 if len(answers) <= 80 else 4}
    return line([answer.place for answer in answers], values, name, style, panel=panel, **more)


def kind_keys(*lists):
    """Entries of the legend for the kinds of motion that occur, and crosses at the bottom where there is no answer."""
    met = {kind_of(answer) for answers in lists for answer in answers}
    keys = [marks([np.nan], [np.nan], kind_word(kind), symbol) for kind, symbol in SYMBOLS.items() if kind in met]
    return keys + crosses(sorted({answer.place for answers in lists for answer in answers if not answer.answered}))


def crosses(speeds):
    """Crosses at the bottom where there is no answer, in a list."""
    style = {"marker": {"symbol": "x-thin-open", "size": 9, "color": "black", "line": {"width": 2}}}
    made = marks(speeds, np.zeros(len(speeds)), NO_ANSWER, "", **style, cliponaxis=False)
    return [made] if len(speeds) else []


def bands(edges, *, rows="paper"):
    """Grey bands between pairs of x, over the whole height."""
    place = {"type": "rect", "xref": "x", "yref": rows, "y0": 0, "y1": 1, "layer": "below"}
    return [
        place | {"x0": float(low), "x1": float(high), "fillcolor": GAP, "line": {"width": 0}} for low, high in edges
    ]


def above(text, panel):
    """A text above a panel, at the left."""
    place = {"xref": "paper", "x": 0.0, "yref": f"y{panel + 1 if panel else ''} domain", "y": 1.0}
    return place | {"text": text, "showarrow": False, "xanchor": "left", "yanchor": "bottom", "font": {"size": 10}}

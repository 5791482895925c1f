"""Specifications as plotly.js takes them, for the page: traces are as they are."""

import math
from collections.abc import Mapping
from typing import Any

from jaxhb.report.figures.figure import (
    BAND,
    GAP,
    LEGEND_SIZE,
    ZERO,
    Axis,
    Band,
    Figure,
    numbered,
)

AXIS = 62
AXIS_NARROW = 50
ROW = 15
"""Pixels left of a panel, with a title of one row, of that of a narrow figure, and of
another row of the title.
"""


def layout_of(figure: Figure) -> dict[str, Any]:
    """Make the layout of a figure."""
    inside = figure.inside
    titles = figure.titles("<br>")
    more_rows = max(title.count("<br>") for title in titles)
    several = len(figure.panels) > 1
    legend = {
        "orientation": "h",
        "x": int(figure.legend == "right"),
        "y": 1 + 6 / inside,
        "yanchor": "bottom",
        "font": {"size": LEGEND_SIZE},
    }
    if figure.legend == "right":
        legend["xanchor"] = "right"
    x = {
        "title": {"text": figure.x.title},
        "zeroline": False,
        "anchor": numbered("y", len(figure.panels) - 1),
        "mirror": "all" if several else True,
        # Mirrored ticks would cross the texts above the panels.
        "ticks": "" if several else "outside",
    }
    layout: dict[str, Any] = {
        "width": figure.width,
        "height": figure.pixels,
        "margin": {
            "l": (AXIS_NARROW if figure.narrow else AXIS) + ROW * more_rows,
            "r": figure.right,
            "t": figure.above,
            "b": figure.bottom,
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
        "showlegend": bool(figure.in_legend),
        "legend": legend,
        "xaxis": _axis(figure.x, x),
        "shapes": list(map(_shape, figure.bands)),
        "annotations": list(figure.notes),
    }
    if figure.x.ticks:
        layout["xaxis"] |= {"tickangle": -90, "tickfont": {"size": 9}}
    for panel, (axis, title) in enumerate(zip(figure.panels, titles, strict=True)):
        top = inside - panel * (figure.height + GAP)
        y = {
            "title": {"text": title, "standoff": 6},
            "domain": [max(0.0, (top - figure.height) / inside), top / inside],
            "zerolinecolor": ZERO,
        }
        layout[numbered("yaxis", panel)] = _axis(axis, y)
    return layout


def _axis(axis: Axis, more: dict[str, Any]) -> dict[str, Any]:
    """Draw an axis as a frame with a grid, with ``more`` of its own, and with range,
    scale and ticks as far as it has them.
    """
    settings = {
        "showline": True,
        "mirror": True,
        "linecolor": "black",
        "ticks": "outside",
        "gridcolor": axis.grid,
        "exponentformat": "none",
    } | more
    if axis.limits:
        settings["range"] = [
            math.log10(limit) if axis.log else float(limit) for limit in axis.limits
        ]
    if axis.log:
        settings["type"] = "log"
    if axis.step:
        settings["dtick"] = axis.step
    if isinstance(axis.ticks, Mapping):
        settings["tickvals"] = list(axis.ticks)
        settings["ticktext"] = list(axis.ticks.values())
    return settings


def _shape(band: Band) -> dict[str, Any]:
    """Draw a band below the lines."""
    over = "paper" if band.panel is None else f"{numbered('y', band.panel)} domain"
    return {
        "type": "rect",
        "xref": "x",
        "y0": 0,
        "y1": 1,
        "layer": "below",
        "fillcolor": BAND,
        "line": {"width": 0},
        "yref": over,
        "x0": band.low,
        "x1": band.high,
    }

"""Pictures of specifications by matplotlib, for files and notebooks: what plotly.js
draws on the page. The only importer of matplotlib, inside functions: it takes longer to
import than many commands take; without pyplot.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from jaxhb.report.figures.figure import Figure, Trace, legend_columns

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture

PIXELS = 75  # of the page in an inch of the height, as in its width
POINTS = 0.8  # of a line or marker, for a pixel of the page
LETTERS = 112  # of a line of a caption
DASHES: dict = {
    "solid": "-",
    "dash": "--",
    "dashdot": "-.",
    "dot": ":",
    "longdash": (0, (9, 2.5)),
    "longdashdot": (0, (9, 2, 1.5, 2)),
}
MARKERS = {
    "circle": "o",
    "square": "s",
    "diamond": "D",
    "star": "*",
    "triangle-down": "v",
    "triangle-up": "^",
    "cross": "P",
    "x-thin": "x",
    "cross-thin": "+",
    "line-ew": "_",
    "pentagon": "p",
    "hexagon": "h",
    "triangle-left": "<",
    "triangle-right": ">",
}


def empty(
    width: float, height: float, layout: Literal["constrained"] | None = None
) -> Picture:
    """Make an empty picture of so many inches."""
    from matplotlib.figure import Figure as Picture

    return Picture(figsize=(width, height), layout=layout)


def drawn(*figures: Figure, title: str = "") -> Picture:
    """Draw specifications one below the other by matplotlib, with axes for every panel
    from the top.
    """
    height = sum(figure.layout["height"] for figure in figures)
    picture = empty(9.0, height / PIXELS, layout="constrained")
    picture.suptitle(_wrapped(title), fontsize="medium")
    panels = [
        (figure, name)
        for figure in figures
        for name in figure.layout
        if name.startswith("yaxis")
    ]
    # A panel takes its share of what is between the margins.
    height_ratios = []
    for figure, name in panels:
        margin = figure.layout["margin"]
        inside = figure.layout["height"] - margin["t"] - margin["b"]
        height_ratios.append(np.ptp(figure.layout[name]["domain"]) * inside)
    subplots = iter(
        picture.subplots(
            len(height_ratios), 1, squeeze=False, height_ratios=height_ratios
        )[:, 0]
    )
    for figure in figures:
        axes_by_name = {
            name.replace("axis", ""): next(subplots)
            for owner, name in panels
            if owner is figure
        }
        _draw(figure, axes_by_name)
    return picture


def _wrapped(text: str) -> str:
    return "\n".join(textwrap.fill(line, LETTERS) for line in text.split("\n"))


def _draw(figure: Figure, panels: Mapping[str, Axes]) -> None:
    """Draw everything of one figure, in axes by their names."""
    x = figure.layout["xaxis"]
    top = next(iter(panels.values()))
    _draw_axis(top, "x", x)
    for name, axes in panels.items():
        if axes is not top:
            axes.sharex(top)
        axes.tick_params(
            "x", labelbottom=name == x["anchor"], labelrotation=-x.get("tickangle", 0)
        )
        title = figure.layout[name.replace("y", "yaxis")]["title"]["text"]
        axes.set_ylabel(title.replace("<br>", "\n"))
    panels[x["anchor"]].set_xlabel(x["title"]["text"])
    for trace in figure.traces:
        _draw_trace(panels[trace["yaxis"]], trace)
    for shape in figure.layout["shapes"]:
        name = shape["yref"].removesuffix(" domain")
        for axes in panels.values() if name == "paper" else [panels[name]]:
            axes.axvspan(
                shape["x0"],
                shape["x1"],
                color=shape["fillcolor"],
                linewidth=0,
                zorder=0,
            )
    for name, axes in panels.items():
        axis = figure.layout[name.replace("y", "yaxis")]
        _draw_axis(axes, "y", axis)
        axes.grid(axis="x", color=x["gridcolor"], linewidth=0.6)
        low, high = axes.get_ylim()
        if low < 0 < high:
            axes.axhline(0.0, color=axis["zerolinecolor"], linewidth=0.8, zorder=0.6)
    for note in figure.layout["annotations"]:
        _draw_note(panels, note)
    _draw_legend(top, figure)


def _draw_axis(axes: Axes, which: Literal["x", "y"], axis: Mapping[str, Any]) -> None:
    """Set scale, range, ticks and grid of an axis."""
    limits = axis.get("range")
    if axis.get("type") == "log":
        axes.set(**{f"{which}scale": "log"})
        getattr(axes, f"{which}axis").set_major_formatter("{x:g}")
        limits = limits and [10**limit for limit in limits]
    else:
        axes.ticklabel_format(axis=which, style="plain", useOffset=False)
    if limits:
        axes.set(**{f"{which}lim": limits})
    if "dtick" in axis:
        assert limits  # steps of ticks come with a range
        ticks = np.arange(limits[0], limits[1] * (1 + 1e-9), axis["dtick"])
        axes.set(**{f"{which}ticks": ticks})
    if "tickvals" in axis:
        labels = [text.replace("<br>", "\n") for text in axis["ticktext"]]
        axes.set(**{f"{which}ticks": axis["tickvals"], f"{which}ticklabels": labels})
        axes.tick_params(which, labelsize="small" if len(labels) <= 25 else "x-small")
    axes.grid(axis=which, color=axis["gridcolor"], linewidth=0.6)
    axes.set_axisbelow(True)


def _draw_trace(axes: Axes, trace: Trace) -> None:
    """Draw a line with gaps where there is no number, and its markers, which may be of
    several kinds.
    """
    y = np.array(trace["y"], float)
    x = (
        np.array(trace["x"], float)
        if "x" in trace
        else trace["x0"] + trace["dx"] * np.arange(len(y))
    )
    symbols = np.broadcast_to(_symbol(trace), len(y))
    if len(set(symbols)) < 2:
        axes.plot(x, y, **_look(trace, symbols[0] if len(y) else ""))
        return
    axes.plot(x, y, **_look(trace, ""))
    for symbol in dict.fromkeys(symbols.tolist()):
        there = symbols == symbol
        axes.plot(x[there], y[there], **_look(trace, symbol) | {"linestyle": "none"})


def _symbol(trace: Trace) -> str | list[str]:
    """Return the symbol of a trace or of every point; "" without."""
    if "markers" not in trace["mode"]:
        return ""
    return trace.get("marker", {}).get("symbol", "circle")


def _look(trace: Trace, symbol: str) -> dict[str, Any]:
    """Return line and marker as matplotlib calls them."""
    line = trace.get("line", {})
    marker = trace.get("marker", {})
    colour = marker.get("color", line.get("color"))
    dash = DASHES[line.get("dash", "solid")]
    look = {
        "color": line.get("color", colour),
        "alpha": trace.get("opacity"),
        "clip_on": trace.get("cliponaxis", True),
        "linewidth": POINTS * line.get("width", 2),
        "linestyle": dash if "lines" in trace["mode"] else "none",
        "drawstyle": "steps-post" if line.get("shape") == "hv" else "default",
    }
    if symbol:
        name = symbol.removesuffix("-open")
        count = len(trace["y"])
        enlarged = 1.5 if name == "star" else 1.0
        look |= {
            "marker": MARKERS[name],
            "markerfacecolor": colour if name == symbol else "none",
            "markersize": POINTS * marker.get("size", 6) * enlarged,
            "markeredgecolor": colour,
            "markeredgewidth": POINTS * (marker.get("line", {}).get("width") or 1.2),
            "markevery": max(1, count // marker.get("maxdisplayed", count or 1)),
        }
    return look


def _draw_note(panels: Mapping[str, Axes], note: Mapping[str, Any]) -> None:
    """Draw a text: at a place of the axes or of the data, moved by pixels."""
    across = note.get("yref", "y")
    along = note.get("xref", "x")
    box = None
    if "bgcolor" in note:
        box = {"facecolor": note["bgcolor"], "edgecolor": "none", "pad": 0.5}
    panels[across.removesuffix(" domain")].annotate(
        note["text"].replace("<br>", "\n"),
        (note["x"], note["y"]),
        (POINTS * note.get("xshift", 0), POINTS * note.get("yshift", 0)),
        xycoords=(
            "axes fraction" if along == "paper" else "data",
            "axes fraction" if "domain" in across else "data",
        ),
        textcoords="offset points",
        fontsize=POINTS * note["font"]["size"],
        ha=note.get("xanchor", "center"),
        va=note.get("yanchor", "middle").replace("middle", "center"),
        annotation_clip=False,
        bbox=box,
    )


def _draw_legend(axes: Axes, figure: Figure) -> None:
    """Draw caption and legend above a panel."""
    from matplotlib.lines import Line2D
    from matplotlib.transforms import ScaledTranslation

    shown = [
        trace for trace in figure.traces if trace.get("showlegend", True)
    ] * figure.layout["showlegend"]
    # Texts above a panel stand between it and the caption.
    notes_above = any(
        note.get("yanchor") == "bottom" for note in figure.layout["annotations"]
    )
    room = 13 if notes_above else 3
    handles = [
        Line2D([], [], label=trace["name"], **_look(trace, np.ravel(_symbol(trace))[0]))
        for trace in shown
    ]
    offset = ScaledTranslation(0, room / 72, axes.figure.dpi_scale_trans)
    # Sizes with which as many names find room as on the page.
    axes.legend(
        handles=handles,
        ncols=legend_columns(figure.traces),
        title=_wrapped(figure.caption),
        title_fontsize=9,
        alignment="left",
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        bbox_transform=axes.transAxes + offset,
        borderaxespad=0.0,
        borderpad=0.0,
        frameon=False,
        fontsize=7.5,
        handlelength=3.8,
        handletextpad=0.6,
        columnspacing=1.3,
        labelspacing=0.3,
    )

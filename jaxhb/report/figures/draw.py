"""Pictures of specifications by matplotlib, for files and notebooks: what plotly.js
draws on the page. The only importer of matplotlib, inside functions: it takes longer to
import than many commands take; without pyplot.
"""

from __future__ import annotations

import io
import itertools
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from jaxhb.report.figures.figure import (
    BAND,
    EDGE,
    ZERO,
    Axis,
    Figure,
    Trace,
    legend_columns,
    numbered,
)

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


def as_svg(picture: Picture) -> str:
    """Write a picture as SVG whose texts stay texts, without a date."""
    from matplotlib import rc_context

    content = io.StringIO()
    with rc_context({"svg.fonttype": "none"}):
        picture.savefig(content, format="svg", metadata={"Date": None})
    return content.getvalue()


def drawn(*figures: Figure, title: str = "") -> Picture:
    """Draw specifications one below the other by matplotlib, with axes for every panel
    from the top.
    """
    height = sum(figure.pixels for figure in figures)
    picture = empty(9.0, height / PIXELS, layout="constrained")
    picture.suptitle(_wrapped(title), fontsize="medium")
    # A panel has its share of the edge beside the panels, too.
    ratios = [
        figure.height * (1 + EDGE / figure.inside)
        for figure in figures
        for _ in figure.panels
    ]
    subplots = picture.subplots(len(ratios), 1, squeeze=False, height_ratios=ratios)
    rest = iter(subplots[:, 0])
    for figure in figures:
        _draw(figure, list(itertools.islice(rest, len(figure.panels))))
    return picture


def _wrapped(text: str) -> str:
    return "\n".join(textwrap.fill(line, LETTERS) for line in text.split("\n"))


def _draw(figure: Figure, panels: Sequence[Axes]) -> None:
    """Draw everything of one figure in the axes of its panels."""
    by_name = {numbered("y", panel): axes for panel, axes in enumerate(panels)}
    _draw_axis(panels[0], "x", figure.x)
    for axes, title in zip(panels, figure.titles("\n"), strict=True):
        if axes is not panels[0]:
            axes.sharex(panels[0])
        axes.tick_params(
            "x",
            labelbottom=axes is panels[-1],
            labelrotation=90 if figure.x.ticks else 0,
        )
        axes.set_ylabel(title)
    panels[-1].set_xlabel(figure.x.title)
    for trace in figure.traces:
        _draw_trace(by_name[trace["yaxis"]], trace)
    for band in figure.bands:
        for axes in panels if band.panel is None else [panels[band.panel]]:
            axes.axvspan(band.low, band.high, color=BAND, linewidth=0, zorder=0)
    for axis, axes in zip(figure.panels, panels, strict=True):
        _draw_axis(axes, "y", axis)
        axes.grid(axis="x", color=figure.x.grid, linewidth=0.6)
        low, high = axes.get_ylim()
        if low < 0 < high:
            axes.axhline(0.0, color=ZERO, linewidth=0.8, zorder=0.6)
        if axis.linear is not None:
            axes.set_yscale("symlog", linthresh=axis.linear)
            axes.set_yticks(list(axis.ticks))
    for note in figure.notes:
        _draw_note(by_name, note)
    _draw_legend(panels[0], figure)


def _draw_axis(axes: Axes, which: Literal["x", "y"], axis: Axis) -> None:
    """Set scale, range, ticks and grid of an axis."""
    if axis.log:
        axes.set(**{f"{which}scale": "log"})
        getattr(axes, f"{which}axis").set_major_formatter("{x:g}")
    else:
        axes.ticklabel_format(axis=which, style="plain", useOffset=False)
    if axis.limits:
        axes.set(**{f"{which}lim": axis.limits})
    if axis.step:
        assert axis.limits  # steps of ticks come with a range
        low, high = axis.limits
        axes.set(**{f"{which}ticks": np.arange(low, high * (1 + 1e-9), axis.step)})
    if isinstance(axis.ticks, Mapping):
        axes.set(**{f"{which}ticks": list(axis.ticks)})
        labels = [text.replace("<br>", "\n") for text in axis.ticks.values()]
        axes.set(**{f"{which}ticklabels": labels})
        axes.tick_params(which, labelsize="small" if len(labels) <= 25 else "x-small")
    axes.grid(axis=which, color=axis.grid, linewidth=0.6)
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

    # Texts above a panel stand between it and the caption.
    notes_above = any(note.get("yanchor") == "bottom" for note in figure.notes)
    room = 13 if notes_above else 3
    handles = [
        Line2D([], [], label=trace["name"], **_look(trace, np.ravel(_symbol(trace))[0]))
        for trace in figure.in_legend
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

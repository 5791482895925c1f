"""What pictures share: figures, colours, labels and marks.

The only importer of matplotlib; figures are made without pyplot, for any backend.
"""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation

WITH, WITHOUT, GAP = "#b3261e", "#1f4e79", "#e3e3e3"
MOTIONS = {
    "contact": ("o", "circle", "#1f4e79", "teeth in contact"),
    "periodic": ("s", "square", "#2e7d32", "periodic, one cycle"),
    "subharmonic": ("D", "diamond", "#e07000", "period of several cycles"),
    "irregular": ("*", "star", "#b3261e", "irregular (bar: 5 to 95 % of the cycles)"),
    "unstable": ("v", "triangle-down", "black", "unstable: the train does not run there"),
    "unknown": ("x", "x-thin-open", "black", "no answer: unknown, or not converged"),
}
"""Marker, its name for plotly, colour and words of every kind of motion, in every picture."""


def new_figure(height):
    """An empty figure of the usual width."""
    return Figure(figsize=(9.0, height), layout="constrained")


def one_panel(title, ylabel, height=4.6):
    """A figure of one panel over the speed, and its axes."""
    figure = new_figure(height)
    axes = figure.subplots()
    axes.set_title(title, fontsize="medium")
    axes.set_ylabel(ylabel)
    axes.set_xlabel("speed, rpm")
    return figure, axes


def plain(name):
    """``a|b`` as a label."""
    return name.replace("|", " - ")


def crosses(axes, x):
    """Crosses at the bottom: nothing is known there."""
    if len(x):
        place = {"transform": axes.get_xaxis_transform(), "clip_on": False}
        axes.plot(x, np.full(len(x), 0.02), "x", color="black", markersize=7, **place)


def raised(axes, points):
    """Coordinates of the axes, moved up by so many points."""
    return axes.transAxes + ScaledTranslation(0, points / 72, axes.figure.dpi_scale_trans)


def key(said, marker, colour, **style):
    """Entry of a legend for a marker."""
    return Line2D([], [], linestyle="none", marker=marker, color=colour, label=said, **style)


def line_key(said, colour, **style):
    """Entry of a legend for a line."""
    return Line2D([], [], color=colour, label=said, **style)


def legend(axes, keys):
    """Legend below the axes: pictures of kinds leave no corner free."""
    axes.figure.legend(handles=keys, loc="outside lower center", ncols=4, fontsize="small", frameon=False)

"""Picture of the train itself: disks, shafts, gears in mesh, dampers, grounds; readable
without colour.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jaxhb.report.figures.draw import empty
from jaxhb.report.figures.figure import BAND
from jaxhb.report.figures.layout import Layout
from jaxhb.train.chain import span
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import excited_disks
from jaxhb.train.topology import Topology

if TYPE_CHECKING:
    from jaxhb.report.figures.draw import Axes, Picture

MOST = 400  # disks of a sketch
# Inches of a unit of the layout, and of a picture, at most
UNIT = 0.42
WIDEST = 18.0
TORQUE = "#8f8f8f"
# Points of the names where the unit has its size, and below which they are left out
LETTERS = 7.5
SMALLEST = 4.0
EDGE = 0.8  # inches kept free at each side, for title and legend
ROUND = np.stack([np.cos(turn := np.linspace(0.0, 2 * np.pi, 73)), np.sin(turn)])
BOW = 0.9  # units by which a link that closes a loop passes the disks between its ends
# Sign of the ground, from the disk that is held, in units of 0.15
GROUND = [(0, 0), (1, 1), (np.nan, np.nan)]
for half, height in ((1, 1), (0.6, 1.4), (0.27, 1.8)):
    GROUND += [(1 - half, height), (1 + half, height), (np.nan, np.nan)]


def plot_train(train: DriveTrain) -> Picture:
    """Draw a sketch of a train: rotors as horizontal lines, gears in mesh as pitch
    circles that touch.

    Circles are disks, dark where a torque acts; their radius grows with the fourth root
    of the inertia, not referred. Dash-dotted are pitch circles, in proportion, with a
    white dot where teeth with backlash touch, a black one without; a dotted line joins
    those for which no place was free. Internal meshes touch from outside too. More than
    400 disks raise a ValueError.

    >>> import jaxhb
    >>> picture = plot_train(jaxhb.load_scene("spur_pair"))
    >>> [text.get_text() for text in picture.axes[0].texts][:2]
    ['gear a', 'gear b']
    """
    topology = train.topology
    if topology.n_disks > MOST:
        raise ValueError(
            f"a sketch of {topology.n_disks} disks cannot be read; at most {MOST} are"
            " drawn."
        )
    layout = Layout(train)
    if LETTERS * _inches(layout) / UNIT < SMALLEST:
        layout = Layout(train, named=False)
    unit = _inches(layout)
    size = np.maximum(unit * (layout.high - layout.low) + 2 * EDGE, (6.0, 2.0))
    # The picture has its own scale: a unit is as long across as up, so that circles are
    # round.
    picture = empty(size[0], size[1])
    axes = picture.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    low = (layout.low + layout.high - size / unit) / 2
    high = (layout.low + layout.high + size / unit) / 2
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    _draw_disks(axes, topology, layout)
    _draw_links(axes, topology, layout)
    _draw_supports(axes, topology, layout)
    for x, y, text, upright in layout.names.values():
        axes.text(
            x,
            y,
            text,
            zorder=3.5,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.4},
            fontsize=LETTERS * unit / UNIT,
            rotation=90 * upright,
            ha="center",
            va="center",
        )
    handles, labels = axes.get_legend_handles_labels()
    # The first part of every kind.
    once = dict(zip(labels[::-1], handles[::-1], strict=True))
    keys = {label: once[label] for label in dict.fromkeys(labels)}
    axes.legend(
        keys.values(),
        keys,
        loc="lower center",
        ncols=max(1, int(size[0] / 1.7)),
        frameon=False,
        fontsize="x-small",
        handlelength=1.6,
        columnspacing=1.4,
        borderpad=0.0,
    )
    axes.text(
        0.5,
        1 - 0.15 / size[1],
        topology.title,
        transform=axes.transAxes,
        ha="center",
        va="top",
    )
    return picture


def _inches(layout: Layout) -> float:
    """Return the inches of a unit."""
    return min(UNIT, (WIDEST - 2 * EDGE) / (layout.high[0] - layout.low[0]))


def _draw_disks(axes: Axes, topology: Topology, layout: Layout) -> None:
    """Draw disks, rings and pitch circles."""
    excited = {*excited_disks(topology)}
    centres = np.stack([layout.x, layout.y], axis=1)[:, :, None]
    for disk, centre in enumerate(centres):
        ring = disk >= topology.n_scene_disks
        if ring:
            kind = "ring of a damper"
            colour = "white"
        elif disk in excited:
            kind = "disk under torque"
            colour = TORQUE
        else:
            kind = "disk"
            colour = BAND
        x, y = centre + layout.disk[disk] * ROUND
        axes.fill(
            x,
            y,
            facecolor=colour,
            edgecolor="black",
            linewidth=2.0 if ring else 1.0,
            zorder=4,
            label=kind,
        )
        if layout.pitch[disk]:
            x, y = centre + layout.pitch[disk] * ROUND
            axes.plot(
                x,
                y,
                color="black",
                linewidth=0.9,
                linestyle="-.",
                zorder=3,
                label="pitch circle of a gear",
            )


def _draw_links(axes: Axes, topology: Topology, layout: Layout) -> None:
    """Draw shafts, links of dampers and meshes."""
    shafts = len(topology.shaft_names)
    dampers = len(topology.damper_names)
    loops = set(span(topology).loops.tolist())
    t = np.linspace(0.0, 1.0, 41)[:, None]
    for link, (a, b) in enumerate(topology.link_ends):
        ends = np.array([[layout.x[a], layout.y[a]], [layout.x[b], layout.y[b]]])
        along = ends[1] - ends[0]
        way = along / np.hypot(along[0], along[1])
        if link < shafts + dampers:
            if link in loops:  # it passes the disks between its ends
                bow = np.copysign(BOW, way[0]) * np.sin(np.pi * t) * (-way[1], way[0])
                ends = ends[0] + t * along + bow
            x, y = ends.T
            if link < shafts:
                axes.plot(x, y, color="black", zorder=2, linewidth=2.2, label="shaft")
            else:
                axes.plot(
                    x,
                    y,
                    color="black",
                    zorder=2,
                    linewidth=1.6,
                    linestyle=(0, (1.5, 1)),
                    label="damper",
                )
            continue
        ends += np.array([layout.pitch[a] * way, -layout.pitch[b] * way])
        if link not in layout.touching:
            x, y = ends.T
            axes.plot(x, y, color="black", linewidth=1.2, linestyle=":", zorder=2)
        mesh = link - shafts - dampers
        gap = topology.mesh_backlash[mesh]
        kind = "internal mesh" if topology.mesh_internal[mesh] else "mesh"
        x, y = ends.mean(axis=0)
        axes.plot(
            x,
            y,
            "o",
            linestyle="",
            label=kind + " with backlash" * bool(gap),
            color="black",
            markersize=5,
            markerfacecolor="white" if gap else "black",
            zorder=7,
        )


def _draw_supports(axes: Axes, topology: Topology, layout: Layout) -> None:
    """Draw crosses on the disks of loads, and the sign of the ground beside each disk
    that a ground holds, away from its name.
    """
    loads = sorted(set(topology.load_disk))
    if loads:
        axes.plot(
            layout.x[loads],
            layout.y[loads],
            "x",
            label="load",
            color="black",
            markersize=5,
            markeredgewidth=1.4,
            linestyle="",
            zorder=5,
        )
    for disk in sorted(set(topology.ground_disk)):
        name_below = disk in layout.names and layout.names[disk][1] < layout.y[disk]
        side = 1.0 if name_below else -1.0
        centre = np.array([layout.x[disk], layout.y[disk]])
        edge = centre + 0.7 * layout.disk[disk] * np.array([1.0, side])
        x, y = (edge + 0.15 * np.array(GROUND) * (1.0, side)).T
        axes.plot(x, y, color="black", linewidth=1.2, zorder=5, label="ground")

"""Picture of the train itself: disks, shafts, gears in mesh, dampers, grounds; readable
without colour.
"""

import numpy as np

from jaxhb.report.figures.draw import empty
from jaxhb.report.figures.figure import BAND
from jaxhb.report.figures.layout import Layout
from jaxhb.train.chain import span

MOST = 400  # disks of a sketch
UNIT, WIDEST = 0.42, 18.0  # inches of a unit of the layout, and of a picture, at most
TORQUE = "#8f8f8f"
LETTERS, SMALLEST = (
    7.5,
    4.0,
)  # points of the names where the unit has its size, and below which they are left out
EDGE = 0.8  # inches kept free at each side, for title and legend
ROUND = np.stack([np.cos(turn := np.linspace(0.0, 2 * np.pi, 73)), np.sin(turn)])
BOW = 0.9  # units by which a link that closes a loop passes the disks between its ends
GROUND = [
    (0, 0),
    (1, 1),
    (np.nan, np.nan),
]  # sign of the ground, from the disk that is held, in units of 0.15
for half, height in ((1, 1), (0.6, 1.4), (0.27, 1.8)):
    GROUND += [(1 - half, height), (1 + half, height), (np.nan, np.nan)]


def plot_train(train):
    """Sketch of a train: rotors as horizontal lines, gears in mesh as pitch circles
    that touch.

    Circles are disks, dark where a torque acts; their radius grows with the fourth root
    of the inertia, not referred. Dash-dotted are pitch circles, in proportion, with a
    white dot where teeth with backlash touch, a black one without; a dotted line joins
    those for which no place was free. Internal meshes touch from outside too. More than
    400 disks raise a ValueError.

    >>> import jaxhb
    >>> [
    ...     text.get_text()
    ...     for text in plot_train(jaxhb.load_scene("spur_pair")).axes[0].texts
    ... ][:2]
    ['gear a', 'gear b']
    """
    topology = train.topology
    if topology.n_disks > MOST:
        raise ValueError(
            f"a sketch of {topology.n_disks} disks cannot be read; at most {MOST} are"
            " drawn."
        )
    found = Layout(train)
    if LETTERS * _inches(found) / UNIT < SMALLEST:
        found = Layout(train, named=False)
    unit = _inches(found)
    size = np.maximum(unit * (found.high - found.low) + 2 * EDGE, (6.0, 2.0))
    # The picture has its own scale: a unit is as long across as up, so that circles are
    # round.
    figure = empty(*size)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    low = (found.low + found.high - size / unit) / 2
    high = (found.low + found.high + size / unit) / 2
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    _draw_disks(axes, topology, found)
    _draw_links(axes, topology, found)
    _draw_supports(axes, topology, found)
    for x, y, text, upright in found.names.values():
        style = {
            "fontsize": LETTERS * unit / UNIT,
            "rotation": 90 * upright,
            "ha": "center",
            "va": "center",
        }
        axes.text(
            x,
            y,
            text,
            zorder=3.5,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.4},
            **style,
        )
    handles, labels = axes.get_legend_handles_labels()
    once = dict(
        zip(labels[::-1], handles[::-1], strict=True)
    )  # the first part of every kind
    keys = {label: once[label] for label in dict.fromkeys(labels)}
    style = {
        "frameon": False,
        "fontsize": "x-small",
        "handlelength": 1.6,
        "columnspacing": 1.4,
        "borderpad": 0.0,
    }
    axes.legend(
        keys.values(),
        keys,
        loc="lower center",
        ncols=max(1, int(size[0] / 1.7)),
        **style,
    )
    axes.text(
        0.5,
        1 - 0.15 / size[1],
        topology.title,
        transform=axes.transAxes,
        ha="center",
        va="top",
    )
    return figure


def _inches(found):
    """Inches of a unit."""
    return min(UNIT, (WIDEST - 2 * EDGE) / (found.high[0] - found.low[0]))


def _draw_disks(axes, topology, found):
    """Disks, rings and pitch circles."""
    excited = {*topology.torque_disk, *topology.cylinder_disk}
    for disk, centre in enumerate(np.stack([found.x, found.y], axis=1)[:, :, None]):
        ring = disk >= topology.n_scene_disks
        kind = (
            "ring of a damper"
            if ring
            else "disk under torque"
            if disk in excited
            else "disk"
        )
        face = {
            "facecolor": "white" if ring else TORQUE if disk in excited else BAND,
            "edgecolor": "black",
        }
        axes.fill(
            *(centre + found.disk[disk] * ROUND),
            **face,
            linewidth=2.0 if ring else 1.0,
            zorder=4,
            label=kind,
        )
        if found.pitch[disk]:
            style = {"color": "black", "linewidth": 0.9, "linestyle": "-.", "zorder": 3}
            axes.plot(
                *(centre + found.pitch[disk] * ROUND),
                **style,
                label="pitch circle of a gear",
            )


def _draw_links(axes, topology, found):
    """Shafts, links of dampers and meshes."""
    shafts = len(topology.shaft_names)
    dampers = len(topology.damper_names)
    loops = set(span(topology).loops.tolist())
    t = np.linspace(0.0, 1.0, 41)[:, None]
    for link, (a, b) in enumerate(topology.link_ends):
        ends = np.array([[found.x[a], found.y[a]], [found.x[b], found.y[b]]])
        way = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
        if link < shafts + dampers:
            damper = {"linewidth": 1.6, "linestyle": (0, (1.5, 1)), "label": "damper"}
            style = damper if link >= shafts else {"linewidth": 2.2, "label": "shaft"}
            if link in loops:  # it passes the disks between its ends
                bow = np.copysign(BOW, way[0]) * np.sin(np.pi * t) * (-way[1], way[0])
                ends = ends[0] + t * (ends[1] - ends[0]) + bow
            axes.plot(*ends.T, color="black", zorder=2, **style)
            continue
        ends += np.array([found.pitch[a] * way, -found.pitch[b] * way])
        if link not in found.touching:
            axes.plot(*ends.T, color="black", linewidth=1.2, linestyle=":", zorder=2)
        gap = topology.mesh_backlash[link - shafts - dampers]
        kind = (
            "internal mesh"
            if topology.mesh_internal[link - shafts - dampers]
            else "mesh"
        )
        style = {
            "color": "black",
            "markersize": 5,
            "markerfacecolor": "white" if gap else "black",
            "zorder": 7,
        }
        axes.plot(
            *ends.mean(axis=0),
            "o",
            linestyle="",
            label=kind + " with backlash" * bool(gap),
            **style,
        )


def _draw_supports(axes, topology, found):
    """Crosses on the disks of loads, and the sign of the ground beside what a ground
    holds, away from its name.
    """
    loads = sorted(set(topology.load_disk))
    if loads:
        style = {
            "color": "black",
            "markersize": 5,
            "markeredgewidth": 1.4,
            "linestyle": "",
            "zorder": 5,
        }
        axes.plot(found.x[loads], found.y[loads], "x", label="load", **style)
    for disk in sorted(set(topology.ground_disk)):
        side = (
            1.0
            if disk in found.names and found.names[disk][1] < found.y[disk]
            else -1.0
        )
        at = np.array([found.x[disk], found.y[disk]]) + 0.7 * found.disk[
            disk
        ] * np.array([1.0, side])
        axes.plot(
            *(at + 0.15 * np.array(GROUND) * (1.0, side)).T,
            color="black",
            linewidth=1.2,
            zorder=5,
            label="ground",
        )

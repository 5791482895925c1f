"""Pictures of the linear train: mode shapes, Holzer's residual over the frequency, the
Campbell diagram.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb._jax import Array
from jaxhb.linear.critical import ELASTIC, Campbell, Critical, shares_in_mode
from jaxhb.linear.holzer import HolzerTable, holzer_residual
from jaxhb.linear.modal import AT_REST, Modes
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import (
    GREY,
    WITH,
    WITHOUT,
    Axis,
    Figure,
    above,
    bars,
    figure,
    line,
    marks,
    note,
)
from jaxhb.report.figures.lettering import width_of
from jaxhb.report.figures.ways import train_lines
from jaxhb.report.orders import NUMBERS, OrderNames
from jaxhb.report.units import said
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.kinematics import speed_ratios

if TYPE_CHECKING:
    from jaxhb.report.figures.draw import Picture

POINTS = 2000
# Modal torque over the largest of the mode from which a critical speed is filled
COUNTS = 0.1
APART = 0.032  # share of the height between the names of two modes
BEHIND = 26  # pixels from the frame to the names of modes, behind those of orders
FEW = 4  # orders of geared rotors whose makers are named at their rays
MOST_DECADES = 5  # on either side of 0
LINEAR = 1e-3  # residual over its median below which the scale is linear


def plot_holzer(
    train: DriveTrain,
    tables: Sequence[tuple[int | None, HolzerTable]],
    natural: Mapping[int, float],
) -> Picture:
    """Draw Holzer's residual over the frequency, natural frequencies as circles,
    frequencies asked for as dotted lines.

    The scale is logarithmic on both sides of 0: the residual grows with a high power of
    the frequency. Every branch begins with ordinate 1 at its free end; a table of a
    train with branches is scaled otherwise.

    tables : list of (int or None, HolzerTable); natural : dict, number of the mode: Hz,
    of those that strain links
    """
    highest = 1.15 * max(float(table.hz) for _, table in tables)
    hz = highest * np.arange(1, POINTS + 1) / POINTS
    values = np.asarray(holzer_residual(train, hz=hz))
    zeros = {mode: zero for mode, zero in natural.items() if zero <= highest}
    asked_for = [float(table.hz) for mode, table in tables if mode is None]
    low = np.nanmin(values)
    high = np.nanmax(values)
    traces = [line(hz, values, "residual", 1, look={"dash": "solid"})]
    if zeros:
        traces.append(
            marks(
                list(zeros.values()),
                np.zeros(len(zeros)),
                "zero",
                "circle-open",
                color=WITH,
            )
        )
    if asked_for:
        traces.append(
            bars(
                asked_for,
                np.full(len(asked_for), low),
                np.full(len(asked_for), high),
                "frequency asked for",
                look={"color": "black", "dash": "dot"},
            )
        )
    notes = [
        note(
            f"mode {mode}<br>{zero:.4g} Hz",
            zero,
            0.0,
            xshift=5,
            yshift=14,
            xanchor="left",
        )
        for mode, zero in zeros.items()
    ]
    small = LINEAR * float(np.median(np.abs(values[np.isfinite(values)])))
    linear = 10 ** np.ceil(np.log10(small)) if small else 1.0
    ticks = _decades(low, high, linear)
    spec = figure(
        "Holzer's residual, zero at natural frequencies",
        Axis("frequency, Hz", (0.0, highest)),
        [Axis("residual, N m, from ordinates 1", linear=linear, ticks=ticks)],
        traces,
        height=220,
        notes=notes,
    )
    return drawn(spec, title=train.topology.title)


def _decades(low: float, high: float, linear: float) -> list[float]:
    """Choose ticks of a scale that is logarithmic beyond ``linear`` on both sides of 0:
    as many decades as have room, none within the linear part but 0.
    """
    first = int(np.log10(linear)) + 1
    last = int(np.floor(np.log10(max(abs(low), abs(high), 10.0**first))))
    step = -(-(last - first + 1) // MOST_DECADES)
    decades = 10.0 ** np.arange(first, last + 1, step)
    return [*(-decades[decades <= -low][::-1]), 0.0, *decades[decades <= high]]


def plot_campbell(
    campbell: Campbell, count: int, name: str, names: OrderNames = NUMBERS
) -> Picture:
    """Draw natural frequencies over the speed, orders as rays, critical speeds as
    circles.

    Full lines are modes, dotted ones those of rigid bodies or rings; ``count`` elastic
    modes were taken; ``names`` are those of the orders.
    """
    return drawn(campbell_figure(campbell, count, name, names))


def campbell_figure(
    campbell: Campbell, count: int, title: str, names: OrderNames
) -> Figure:
    """Make the figure of :func:`plot_campbell`; its title is that of the scene or
    case.
    """
    low = float(campbell.rpm[0])
    high = float(campbell.rpm[-1])
    elastic = campbell.elastic(count)
    # Where modes or orders end, and at least the lowest mode.
    modes = campbell.frequencies_hz[:, elastic].max(axis=0)
    rays = campbell.orders * high / 60
    top = max(
        min(modes.max(initial=0.0), rays.max(initial=0.0)), modes[:1].max(initial=0.0)
    )
    top = 1.08 * (top or 1.0)
    fixed_hz = sorted({critical.hz for critical in campbell.lines if critical.hz < top})
    traces = [
        line(
            [low, high],
            [order * low / 60, order * high / 60],
            f"order {names.number(order)}",
            look={"color": GREY, "dash": "dash", "width": 0.8},
            showlegend=False,
        )
        for order in campbell.orders
    ]
    traces += [
        line(
            [low, high],
            [hz, hz],
            f"{hz:g} Hz",
            look={"color": GREY, "dash": "dashdot", "width": 0.8},
            showlegend=False,
        )
        for hz in fixed_hz
    ]
    shown = [k for k in campbell.shown(count) if campbell.frequencies_hz[-1, k] <= top]
    full = {"color": WITHOUT, "dash": "solid", "width": 1.8}
    dotted = {"color": "grey", "dash": "dot", "width": 1.8}
    traces += [
        line(
            campbell.rpm,
            campbell.frequencies_hz[:, k],
            f"mode {k}",
            look=full if k in elastic else dotted,
            showlegend=False,
        )
        for k in shown
    ]
    filled = counting(campbell)
    for symbol in ("circle", "circle-open"):
        critical = [
            c for c in campbell.critical if (c in filled) == (symbol == "circle")
        ]
        traces.append(
            marks(
                [c.rpm for c in critical],
                [c.hz for c in critical],
                "critical speed",
                symbol,
                color=WITH,
                text=[
                    f"order {names.number(c.order)}, mode {c.mode}, modal torque"
                    f" {said(c.torque, 'N m')}"
                    for c in critical
                ],
                hovertemplate="%{x} rpm, %{y} Hz: %{text}<extra></extra>",
                showlegend=False,
            )
        )
    lines = ", lines at fixed frequencies dash-dotted" if fixed_hz else ""
    caption = (
        f"Campbell diagram, {title}: modes full, orders dashed (named at their ends)"
        f"{lines},"
        " critical speeds circled, filled where the modal torque is above"
        f" {100 * COUNTS:g} % of the largest of the mode"
    )
    drawn_orders = [order for order in campbell.orders if order * low / 60 < top]
    long_names = sum(names.number(order) != f"{order:g}" for order in drawn_orders)
    # Many long names would hide the diagram; tables have them.
    short = names if long_names <= FEW else NUMBERS
    ray_names = [_ray_name(order, high, top, short) for order in drawn_orders]
    ray_names += [
        note(f"{hz:g} Hz", low, hz, size=9, xanchor="left", yanchor="bottom")
        for hz in fixed_hz
    ]
    spec = figure(
        caption,
        Axis("speed, rpm", (low, high)),
        [Axis("frequency, Hz", (0.0, top))],
        traces,
        height=400,
        notes=ray_names + _mode_names(campbell, shown, top),
    )
    return replace(spec, right=145, top=12)


def counting(campbell: Campbell) -> list[Critical]:
    """Return the critical speeds whose modal torque counts beside the largest of their
    mode.
    """
    shares = shares_in_mode(campbell.critical, [c.torque for c in campbell.critical])
    return [
        c for c, share in zip(campbell.critical, shares, strict=True) if share > COUNTS
    ]


def _mode_names(
    campbell: Campbell, shown: Sequence[int], top: float
) -> list[dict[str, Any]]:
    """Name the modes at the right, moved up where they would lie on one another."""
    notes = []
    lowest = 0.0
    for k in shown:
        hz = float(campbell.frequencies_hz[-1, k])
        kind = campbell.kinds[k]
        words = f"{hz:.4g} Hz" if kind == ELASTIC else kind
        notes.append(
            note(
                f" mode {k}: {words}",
                1.0,
                max(hz, lowest),
                xref="paper",
                xanchor="left",
                xshift=BEHIND,
            )
        )
        lowest = notes[-1]["y"] + APART * top
    return notes


def _ray_name(
    order: float, high: float, top: float, names: OrderNames
) -> dict[str, Any]:
    """Name the order where its ray leaves the picture."""
    hz = order * high / 60
    name = names.number(order)
    if hz > top:
        place: dict[str, Any] = {"x": 60 * top / order, "y": top, "yanchor": "bottom"}
    else:
        # A number stands behind the end of its ray, a long name below the ray.
        place = {"x": high, "y": hz, "xanchor": "left", "xshift": 3}
        if name != f"{order:g}":
            place = {"x": high, "y": hz, "xanchor": "right", "xshift": -4}
            place |= {"yanchor": "top", "bgcolor": "white", "borderpad": 0}
    return note(name, **place, size=9)


MOST = 6  # modes in one picture
NAMES = 60  # names of disks that have room
NAME_SIZE = 9  # of their font, pixels
SHAPE = 76  # pixels of the height of a shape: two sheets of three find room on a page


def plot_modes(
    train: DriveTrain, modes: Modes, chosen: Sequence[int], ratios: Array
) -> Picture:
    """Draw shapes of up to six modes along the train, angles referred to the reference
    rotor, nodes as crosses.

    chosen : numbers of the modes; ratios : damping ratios of all modes, nan where there
    is none. Branches stand right of the main line.
    """
    return drawn(
        shapes_figure(train, modes, chosen[:MOST], ratios), title=train.topology.title
    )


def shapes_figure(
    train: DriveTrain, modes: Modes, chosen: Sequence[int], ratios: Array
) -> Figure:
    """Make the figure of :func:`plot_modes`."""
    lines = train_lines(train.topology)
    starts = np.cumsum([0, *(len(way) + 1 for way in lines)]).tolist()
    # Referred to one rotor angles do not jump at meshes.
    shapes = (
        modes.shapes / np.asarray(speed_ratios(train))[np.array(train.topology.rotor)]
    )
    shapes /= np.abs(shapes).max(axis=1, keepdims=True)
    traces = []
    notes = []
    for panel, k in enumerate(chosen):
        traces += [
            line(
                start + np.arange(len(way)),
                shapes[k][way],
                "",
                min(number, 1),
                mode="lines+markers",
                text=[modes.names[disk] for disk in way],
                hovertemplate="%{text}: %{y}<extra></extra>",
                panel=panel,
                showlegend=False,
            )
            for number, (start, way) in enumerate(zip(starts, lines, strict=False))
        ]
        at_rest = np.abs(modes.shapes[k]) <= AT_REST
        nodes = mode_nodes(lines, starts, np.where(at_rest, 0.0, shapes[k]))
        traces.append(
            marks(
                nodes,
                np.zeros(len(nodes)),
                "node",
                "x-thin-open",
                panel=panel,
                showlegend=False,
            )
        )
        damping = "" if np.isnan(ratios[k]) else f", damping ratio {ratios[k]:.3g}"
        notes.append(
            above(f"mode {k}: {modes.frequencies_hz[k]:.4g} Hz{damping}", panel)
        )
    caption = (
        "Mode shapes, angles referred to the reference rotor, the largest is 1;"
        " crosses: nodes. "
    )
    caption += "Dashed: branches, each begins at the disk named in brackets." * (
        len(lines) > 1
    )
    names: dict = {}  # the disk on which a branch hangs is in brackets
    for number, (start, way) in enumerate(zip(starts, lines, strict=False)):
        names |= {start + i: modes.names[disk] for i, disk in enumerate(way)}
        if number:
            names[start] = f"({names[start]})"
    names = dict(list(names.items())[:: -(-len(names) // NAMES)])
    spec = figure(
        caption,
        Axis("", (-0.5, starts[-1] - 1.5), ticks=names),
        [Axis("", (-1.15, 1.15))] * len(chosen),
        traces,
        height=SHAPE,
        notes=notes,
    )
    longest = max(width_of(name, NAME_SIZE) for name in names.values())
    return replace(spec, top=10, bottom=16 + round(longest))


def mode_nodes(
    lines: Sequence[Sequence[int]], starts: Sequence[int], shape: np.ndarray
) -> list[float]:
    """Find the places of the nodes: between disks that move against each other, and
    disks at rest between such.
    """
    nodes = []
    place_of_disk: dict[int, int] = {}
    signs: dict[int, set] = {}
    for start, way in zip(starts, lines, strict=False):
        for i, (a, b) in enumerate(zip(way, way[1:], strict=False)):
            if shape[a] * shape[b] < 0:
                nodes.append(start + i + shape[a] / (shape[a] - shape[b]))
            for disk, other, place in ((a, b, start + i), (b, a, start + i + 1)):
                place_of_disk.setdefault(disk, place)
                signs.setdefault(disk, set()).add(np.sign(shape[other]))
    nodes += [
        place
        for disk, place in place_of_disk.items()
        if shape[disk] == 0 and {-1.0, 1.0} <= signs[disk]
    ]
    return [float(node) for node in nodes]

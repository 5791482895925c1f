"""Pictures of the linear train: mode shapes, Holzer's residual over the frequency, the
Campbell diagram.
"""

import numpy as np

from jaxhb.equations.kinematics import speed_ratios
from jaxhb.linear.critical import ELASTIC, shares_in_mode
from jaxhb.linear.holzer import holzer_residual
from jaxhb.linear.modal import AT_REST
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import (
    GREY,
    WITH,
    WITHOUT,
    above,
    bars,
    figure,
    line,
    marks,
    note,
)
from jaxhb.report.figures.ways import train_lines
from jaxhb.report.orders import NUMBERS
from jaxhb.report.text.columns import plain_number

POINTS = 2000
# Modal torque over the largest of the mode from which a critical speed is filled
COUNTS = 0.1
APART = 0.032  # share of the height between the names of two modes
MOST_DECADES = 5  # on either side of 0
LINEAR = 1e-3  # residual over its median below which the scale is linear


def plot_holzer(train, tables, natural):
    """Holzer's residual over the frequency, natural frequencies as circles, frequencies
    asked for as dotted lines.

    The scale is logarithmic on both sides of 0: the residual grows with a high power of
    the frequency. Every branch begins with ordinate 1 at its free end; a table of a
    train with branches is scaled otherwise.

    tables : list of (int or None, HolzerTable); natural : dict, number of the mode: Hz,
    of those that strain links
    """
    highest = 1.15 * max(table.hz for _, table in tables)
    hz = highest * np.arange(1, POINTS + 1) / POINTS
    values = holzer_residual(train, hz=hz)
    zeros = {mode: own for mode, own in natural.items() if own <= highest}
    asked = [table.hz for mode, table in tables if mode is None]
    ends = np.nanmin(values), np.nanmax(values)
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
    if asked:
        low, high = (np.full(len(asked), end) for end in ends)
        traces.append(
            bars(
                asked,
                low,
                high,
                "frequency asked for",
                look={"color": "black", "dash": "dot"},
            )
        )
    style = {"xshift": 5, "yshift": 14, "xanchor": "left"}
    notes = [
        note(f"mode {mode}<br>{own:.4g} Hz", own, 0.0, **style)
        for mode, own in zeros.items()
    ]
    caption = "Holzer's residual, zero at natural frequencies"
    panels = [("residual, N m, from ordinates 1", None)]
    more = {"x_range": (0.0, highest), "height": 220, "annotations": notes}
    picture = drawn(
        figure(caption, "frequency, Hz", panels, traces, **more),
        title=train.topology.title,
    )
    small = LINEAR * float(np.median(np.abs(values[np.isfinite(values)])))
    linear = 10 ** np.ceil(np.log10(small)) if small else 1.0
    picture.axes[0].set_yscale("symlog", linthresh=linear)
    picture.axes[0].set_yticks(_decades(ends, linear))
    return picture


def _decades(ends, linear):
    """Ticks of a scale that is logarithmic beyond ``linear`` on both sides of 0: of the
    decades so many as have room, none within the linear part but 0.
    """
    first = int(np.log10(linear)) + 1
    last = int(np.floor(np.log10(max(np.abs(ends).max(), 10.0**first))))
    step = -(-(last - first + 1) // MOST_DECADES)
    decades = 10.0 ** np.arange(first, last + 1, step)
    return [*(-decades[decades <= -ends[0]][::-1]), 0.0, *decades[decades <= ends[1]]]


def plot_campbell(found, count, name, names=NUMBERS):
    """Natural frequencies over the speed, orders as rays, critical speeds as circles.

    Full lines are modes, dotted ones those of rigid bodies or rings; ``count`` elastic
    modes were taken; ``names`` are those of the orders.
    """
    return drawn(campbell_figure(found, count, name, names))


def campbell_figure(found, count, title, names):
    """The figure of :func:`plot_campbell`; its title is that of the scene or case."""
    low = float(found.rpm[0])
    high = float(found.rpm[-1])
    elastic = found.elastic(count)
    # Where modes or orders end, and at least the lowest mode.
    modes = found.frequencies_hz[:, elastic].max(axis=0)
    rays = found.orders * high / 60
    top = max(
        min(modes.max(initial=0.0), rays.max(initial=0.0)), modes[:1].max(initial=0.0)
    )
    top = 1.08 * (top or 1.0)
    traces = []
    for order in found.orders:
        look = {"color": GREY, "dash": "dash", "width": 0.8}
        own = [order * low / 60, order * high / 60]
        traces.append(
            line(
                [low, high],
                own,
                f"order {names.number(order)}",
                look=look,
                showlegend=False,
            )
        )
    shown = [k for k in found.shown(count) if found.frequencies_hz[-1, k] <= top]
    for k in shown:
        look = (
            {"color": WITHOUT, "dash": "solid"}
            if k in elastic
            else {"color": "grey", "dash": "dot"}
        )
        own = found.frequencies_hz[:, k]
        traces.append(
            line(
                found.rpm,
                own,
                f"mode {k}",
                look=look | {"width": 1.8},
                showlegend=False,
            )
        )
    filled = counting(found)
    for symbol, own in {
        "circle": filled,
        "circle-open": [c for c in found.critical if c not in filled],
    }.items():
        text = [
            f"order {names.number(c.order)}, mode {c.mode}, modal torque"
            f" {plain_number(c.torque)} N m"
            for c in own
        ]
        more = {
            "text": text,
            "hovertemplate": "%{x} rpm, %{y} Hz: %{text}<extra></extra>",
            "showlegend": False,
        }
        points = [c.rpm for c in own], [c.hz for c in own]
        traces.append(marks(*points, "critical speed", symbol, color=WITH, **more))
    caption = (
        f"Campbell diagram, {title}: modes full, orders dashed (named at their ends),"
        " critical speeds circled, filled where the modal torque is above"
        f" {100 * COUNTS:g} % of the largest of the mode"
    )
    rays = [
        _ray_name(order, high, top, names)
        for order in found.orders
        if order * low / 60 < top
    ]
    more = {
        "x_range": (low, high),
        "height": 400,
        "annotations": rays + _mode_names(found, shown, top),
    }
    made = figure(
        caption, "speed, rpm", [("frequency, Hz", (0.0, top))], traces, **more
    )
    made.layout["margin"] |= {"r": 125, "t": 24}
    made.layout["height"] += 12
    return made


def counting(found):
    """Critical speeds whose modal torque counts beside the largest of their mode."""
    shares = shares_in_mode(found.critical, [c.torque for c in found.critical])
    return [
        c for c, share in zip(found.critical, shares, strict=True) if share > COUNTS
    ]


def _mode_names(found, shown, top):
    """Names of the modes at the right, moved up where they would lie on one another."""
    notes = []
    lowest = 0.0
    for k in shown:
        hz = float(found.frequencies_hz[-1, k])
        what = f"{hz:.4g} Hz" if found.kinds[k] == ELASTIC else found.kinds[k]
        notes.append(
            note(
                f" mode {k}: {what}", 1.0, max(hz, lowest), xref="paper", xanchor="left"
            )
        )
        lowest = notes[-1]["y"] + APART * top
    return notes


def _ray_name(order, high, top, names):
    """The order where its ray leaves the picture."""
    hz = order * high / 60
    style = {"size": 9, "bgcolor": "white", "borderpad": 0}
    if hz > top:
        return note(
            names.number(order), 60 * top / order, top, yanchor="bottom", **style
        )
    # A long name stands below its ray, where it hides no mode.
    under = {} if names.number(order) == f"{order:g}" else {"yanchor": "top"}
    return note(
        names.number(order), high, hz, xanchor="right", xshift=-4, **under, **style
    )


MOST = 6  # modes in one picture
NAMES = 80  # names of disks that have room


def plot_modes(train, modes, chosen, ratios):
    """Shapes of up to six modes along the train, angles referred to the reference
    rotor, nodes as crosses.

    chosen : numbers of the modes; ratios : damping ratios of all modes, nan where there
    is none. Branches stand right of the main line.
    """
    return drawn(
        shapes_figure(train, modes, chosen[:MOST], ratios), title=train.topology.title
    )


def shapes_figure(train, modes, chosen, ratios):
    """The figure of :func:`plot_modes`."""
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
        own = {"panel": panel, "showlegend": False}
        for number, (start, way) in enumerate(zip(starts, lines, strict=False)):
            names = [modes.names[disk] for disk in way]
            style = {
                "mode": "lines+markers",
                "text": names,
                "hovertemplate": "%{text}: %{y}<extra></extra>",
            }
            traces.append(
                line(
                    start + np.arange(len(way)),
                    shapes[k][way],
                    "",
                    min(number, 1),
                    **style,
                    **own,
                )
            )
        nodes = mode_nodes(
            lines, starts, np.where(np.abs(modes.shapes[k]) <= AT_REST, 0.0, shapes[k])
        )
        traces.append(marks(nodes, np.zeros(len(nodes)), "node", "x-thin-open", **own))
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
    panels = [("", (-1.15, 1.15))] * len(chosen)
    more = {"annotations": notes, "x_range": (-0.5, starts[-1] - 1.5)}
    made = figure(caption, "", panels, traces, height=95, **more)
    said = {}  # of a branch the disk on which it hangs is in brackets
    for number, (start, way) in enumerate(zip(starts, lines, strict=False)):
        said |= {start + i: modes.names[disk] for i, disk in enumerate(way)}
        said |= {start: f"({said[start]})"} if number else {}
    said = dict(list(said.items())[:: -(-len(said) // NAMES)])
    room = round(5.4 * max(map(len, said.values())))
    ticks = {
        "tickvals": list(said),
        "ticktext": list(said.values()),
        "tickangle": -90,
        "tickfont": {"size": 9},
    }
    made.layout["xaxis"] |= ticks
    made.layout["margin"] |= {"t": 22, "b": 16 + room}
    made.layout["height"] += room - 20
    return made


def mode_nodes(lines, starts, shape):
    """Places of the nodes: between disks that move against each other, and disks at
    rest between such.
    """
    found = []
    place = {}
    signs = {}
    for start, way in zip(starts, lines, strict=False):
        for i, (a, b) in enumerate(zip(way, way[1:], strict=False)):
            if shape[a] * shape[b] < 0:
                found.append(start + i + shape[a] / (shape[a] - shape[b]))
            for disk, other, at in ((a, b, start + i), (b, a, start + i + 1)):
                place.setdefault(disk, at)
                signs.setdefault(disk, set()).add(np.sign(shape[other]))
    found += [
        place[disk] for disk in place if shape[disk] == 0 and {-1.0, 1.0} <= signs[disk]
    ]
    return [float(at) for at in found]

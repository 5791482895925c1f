"""Picture of mode shapes along the train: the longest way through it first, its branches behind it."""

import numpy as np

from jaxhb.equations.kinematics import speed_ratios
from jaxhb.linear.modal import AT_REST
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import above, figure, line, marks
from jaxhb.report.figures.layout import neighbours, ways
from jaxhb.train.chain import span

MOST = 6
"""Modes in one picture."""

NAMES = 80
"""Names of disks that have room."""


def train_lines(topology):
    """Ways along the train, lists of disks, on which every link lies once: the longest, then branches from where they
    leave, then links that close a loop.

    Examples
    --------
    >>> import jaxhb
    >>> topology = jaxhb.load_scene("engine_with_damper").topology
    >>> [[topology.disk_names[disk] for disk in way] for way in train_lines(topology)][2:]
    [['idler', 'cam gear', 'camshaft'], ['hub', 'viscous damper']]
    """
    found = ways(neighbours(topology, range(len(topology.link_ends))), 0)
    return found + [list(topology.link_ends[link]) for link in span(topology).loops.tolist()]


def plot_modes(train, modes, chosen, ratios):
    """Shapes of up to six modes along the train, angles referred to the reference rotor, nodes as crosses.

    chosen : numbers of the modes; ratios : damping ratios of all modes, nan where there is none. Each branch is a line
    of its own right of the main one; it begins at the disk on which it hangs, named in brackets.
    """
    return drawn(shapes_figure(train, modes, chosen[:MOST], ratios), title=train.topology.title)


def shapes_figure(train, modes, chosen, ratios):
    """The figure of :func:`plot_modes`."""
    lines = train_lines(train.topology)
    starts = np.cumsum([0, *(len(way) + 1 for way in lines)]).tolist()
    # Referred to one rotor angles do not jump at meshes.
    shapes = modes.shapes / np.asarray(speed_ratios(train))[np.array(train.topology.rotor)]
    shapes /= np.abs(shapes).max(axis=1, keepdims=True)
    traces, notes = [], []
    for panel, k in enumerate(chosen):
        own = {"panel": panel, "showlegend": False}
        for number, (start, way) in enumerate(zip(starts, lines, strict=False)):
            names = [modes.names[disk] for disk in way]
            style = {"mode": "lines+markers", "text": names, "hovertemplate": "%{text}: %{y}<extra></extra>"}
            traces.append(line(start + np.arange(len(way)), shapes[k][way], "", min(number, 1), **style, **own))
        nodes = mode_nodes(lines, starts, np.where(np.abs(modes.shapes[k]) <= AT_REST, 0.0, shapes[k]))
        traces.append(marks(nodes, np.zeros(len(nodes)), "node", "x-thin-open", **own))
        damping = "" if np.isnan(ratios[k]) else f", damping ratio {ratios[k]:.3g}"
        notes.append(above(f"mode {k}: {modes.frequencies_hz[k]:.4g} Hz{damping}", panel))
    caption = "Mode shapes, angles referred to the reference rotor, the largest is 1; crosses: nodes. "
    caption += "Dashed: branches, each begins at the disk named in brackets." * (len(lines) > 1)
    panels, more = [("", (-1.15, 1.15))] * len(chosen), {"annotations": notes, "x_range": (-0.5, starts[-1] - 1.5)}
    made = figure(caption, "", panels, traces, height=95, **more)
    places, said = _places(lines, starts, modes.names)
    room = round(5.4 * max(map(len, said)))
    made.layout["xaxis"] |= {"tickvals": places, "ticktext": said, "tickangle": -90, "tickfont": {"size": 9}}
    made.layout["margin"] |= {"t": 22, "b": 16 + room}
    made.layout["height"] += room - 20
    return made


def _places(lines, starts, names):
    """Places and names of the disks that have room; of a branch the disk on which it hangs is in brackets."""
    found = {}
    for number, (start, way) in enumerate(zip(starts, lines, strict=False)):
        for i, disk in enumerate(way):
            found[start + i] = f"({names[disk]})" if number and i == 0 else names[disk]
    step = -(-len(found) // NAMES)
    return list(found)[::step], list(found.values())[::step]


def mode_nodes(lines, starts, shape):
    """Places of the nodes: between disks that move against each other, and disks at rest between such."""
    found, place, signs = [], {}, {}
    for start, way in zip(starts, lines, strict=False):
        for i, (a, b) in enumerate(zip(way, way[1:], strict=False)):
            if shape[a] * shape[b] < 0:
                found.append(start + i + shape[a] / (shape[a] - shape[b]))
            for disk, other, at in ((a, b, start + i), (b, a, start + i + 1)):
                place.setdefault(disk, at)
                signs.setdefault(disk, set()).add(np.sign(shape[other]))
    found += [place[disk] for disk in place if shape[disk] == 0 and {-1.0, 1.0} <= signs[disk]]
    return [float(at) for at in found]

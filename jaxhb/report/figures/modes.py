"""Picture of mode shapes along the train: the longest way through it first, its branches behind it."""

import numpy as np

from jaxhb.equations.kinematics import speed_ratios
from jaxhb.linear.modal import AT_REST
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import Figure, above, layout, line, marks
from jaxhb.report.figures.layout import longest_way
from jaxhb.report.figures.style import WITH
from jaxhb.train.chain import span

MOST = 6
"""Modes in one picture."""

NAMES = 80
"""Names of disks that have room."""


def train_lines(topology):
    """Ways along the train on which every link lies once: the longest, then branches from where they leave.

    Parameters
    ----------
    topology : Topology

    Returns
    -------
    list of list of int
        Disks; each way but the first begins at a disk of an earlier one, a link that closes a loop also ends at one.

    Examples
    --------
    >>> import jaxhb
    >>> topology = jaxhb.load_scene("engine_with_damper").topology
    >>> [[topology.disk_names[disk] for disk in way] for way in train_lines(topology)][2:]
    [['idler', 'cam gear', 'camshaft'], ['hub', 'viscous damper']]
    """
    loops = span(topology).loops.tolist()
    near = [[] for _ in range(topology.n_disks)]
    for index, (a, b) in enumerate(topology.link_ends):
        if index not in loops:
            near[a].append(b)
            near[b].append(a)
    first = longest_way(near, longest_way(near, 0)[-1])
    # As the scene runs, whichever end the search began at.
    found = [first if first[0] < first[-1] else first[::-1]]
    placed = set(first)
    for way in found:
        for disk in way:
            while branches := [longest_way(near, other, placed) for other in near[disk] if other not in placed]:
                found.append([disk, *max(branches, key=len)])
                placed.update(found[-1])
    return found + [list(topology.link_ends[index]) for index in loops]


def plot_modes(train, modes, chosen, ratios):
    """Shapes of some modes along the train, angles referred to the reference rotor, nodes as crosses.

    Parameters
    ----------
    train : DriveTrain
    modes : Modes
    chosen : sequence of int, numbers of the modes, up to six are drawn
    ratios : sequence of float, damping ratios of all modes, nan where there is none

    Returns
    -------
    matplotlib.figure.Figure
        One panel a mode. Each branch is a line of its own right of the main one; it begins at the disk on which it
        hangs, named in brackets. The largest angle is 1.
    """
    return drawn(shapes_figure(train, modes, chosen[:MOST], ratios), title=train.topology.title)


def shapes_figure(train, modes, chosen, ratios):
    """The figure of :func:`plot_modes`."""
    ways = train_lines(train.topology)
    starts = np.cumsum([0, *(len(way) + 1 for way in ways)]).tolist()
    # Referred to one rotor angles do not jump at meshes.
    shapes = modes.shapes / np.asarray(speed_ratios(train))[np.array(train.topology.rotor)]
    shapes /= np.abs(shapes).max(axis=1, keepdims=True)
    traces, panels, notes = [], [], []
    for panel, k in enumerate(chosen):
        nodes = mode_nodes(ways, starts, np.where(np.abs(modes.shapes[k]) <= AT_REST, 0.0, shapes[k]))
        for number, (start, way) in enumerate(zip(starts, ways, strict=False)):
            names = [modes.names[disk] for disk in way]
            style = {"mode": "lines+markers", "text": names, "hovertemplate": "%{text}: %{y}<extra></extra>"}
            place = start + np.arange(len(way))
            traces.append(line(place, shapes[k][way], "", min(number, 1), panel=panel, showlegend=False, **style))
        traces.append(marks(nodes, np.zeros(len(nodes)), "node", "x-thin-open", panel=panel, showlegend=False))
        traces[-1]["marker"] |= {"line": {"width": 2, "color": WITH}}
        panels.append(("", (-1.15, 1.15)))
        damping = "" if np.isnan(ratios[k]) else f", damping ratio {ratios[k]:.3g}"
        text = f"mode {k}: {modes.frequencies_hz[k]:.4g} Hz{damping}"
        notes.append(above(text, panel))
    places, said = _places(ways, starts, modes.names)
    made = layout("", panels, traces, heights=[95] * len(panels), annotations=notes, x_range=(-0.5, starts[-1] - 1.5))
    longest = max(map(len, said))
    made["xaxis"] |= {"tickvals": places, "ticktext": said, "tickangle": -90, "tickfont": {"size": 9}}
    made["margin"] |= {"t": 22, "b": 16 + round(5.4 * longest)}
    made["height"] += round(5.4 * longest) - 20
    caption = "Mode shapes, angles referred to the reference rotor, the largest is 1; crosses: nodes. "
    branches = "Dashed: branches, each begins at the disk named in brackets." * (len(ways) > 1)
    return Figure(caption + branches, traces, made)


def _places(ways, starts, names):
    """Places and names of the disks that have room; of a branch the disk on which it hangs is in brackets."""
    places, said = [], []
    for number, (start, way) in enumerate(zip(starts, ways, strict=False)):
        for i, disk in enumerate(way):
            places.append(start + i)
            said.append(f"({names[disk]})" if number and i == 0 else names[disk])
    step = -(-len(places) // NAMES)
    return places[::step], said[::step]


def mode_nodes(ways, starts, shape):
    """Places of the nodes: between disks that move against each other, and disks at rest between such."""
    found, place, signs = [], {}, {}
    for start, way in zip(starts, ways, strict=False):
        for i, (a, b) in enumerate(zip(way, way[1:], strict=False)):
            if shape[a] * shape[b] < 0:
                found.append(start + i + shape[a] / (shape[a] - shape[b]))
            for disk, other, at in ((a, b, start + i), (b, a, start + i + 1)):
                place.setdefault(disk, at)
                signs.setdefault(disk, set()).add(np.sign(shape[other]))
    found += [place[disk] for disk in place if shape[disk] == 0 and {-1.0, 1.0} <= signs[disk]]
    return [float(at) for at in found]

"""Picture of mode shapes along the train: the longest way through it first, its branches behind it."""

from dataclasses import dataclass

import numpy as np

from jaxhb.equations.kinematics import speed_ratios
from jaxhb.linear.modal import AT_REST
from jaxhb.report.figures.layout import longest_way
from jaxhb.report.figures.style import WITH, WITHOUT, new_figure
from jaxhb.train.chain import span

MOST = 6
"""Modes in one picture."""

NAMES = 80
"""Names of disks that have room."""

STYLES = ("-", "--", "-.", ":")


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
    topology, chosen, ways = train.topology, chosen[:MOST], Ways.of(train, modes)
    figure = new_figure(1.6 + 1.6 * len(chosen))
    panels = figure.subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
    for axes, k in zip(panels, chosen, strict=True):
        axes.axhline(0.0, color="black", linewidth=0.8)
        for number, (start, way) in enumerate(zip(ways.starts, ways.ways, strict=True)):
            place = start + np.arange(len(way))
            style = STYLES[min(number, 1) + max(number - 1, 0) % 3]
            axes.plot(place, ways.shapes[k][way], style, color=WITHOUT, marker="o", markersize=3, linewidth=1.4)
        nodes = ways.nodes(k)
        axes.plot(nodes, np.zeros(len(nodes)), "x", color=WITH, markersize=7, markeredgewidth=1.8)
        damping = "" if np.isnan(ratios[k]) else f", damping ratio {ratios[k]:.3g}"
        axes.set_title(f"mode {k}: {modes.frequencies_hz[k]:.4g} Hz{damping}", fontsize="small", loc="left")
        axes.set_ylim(-1.15, 1.15)
    places, said = ways.names(topology.disk_names)
    panels[-1].set_xticks(places, said, rotation=90, fontsize="x-small" if len(places) > 25 else "small")
    panels[-1].set_xlim(-0.5, ways.last + 0.5)
    figure.suptitle(f"{topology.name or 'scene'}: angles referred to the reference rotor; x: node", fontsize="medium")
    return figure


@dataclass(frozen=True)
class Ways:
    """Places of the disks in a picture of shapes: the ways of :func:`train_lines` one behind the other.

    ways : list of lists of disks; starts : their first places; shapes : ``(m, S)`` angles referred to the reference
    rotor, the largest of a mode 1; resting : ``(m, S)`` bool, disks that do not move
    """

    ways: list
    starts: np.ndarray
    shapes: np.ndarray
    resting: np.ndarray

    @classmethod
    def of(cls, train, modes):
        """Of a train and its modes."""
        ways = train_lines(train.topology)
        starts = np.cumsum([0, *(len(way) + 1 for way in ways[:-1])])
        # Referred to one rotor angles do not jump at meshes.
        shapes = modes.shapes / np.asarray(speed_ratios(train))[np.array(train.topology.rotor)]
        largest = np.abs(shapes).max(axis=1, keepdims=True)
        return cls(ways, starts, shapes / largest, np.abs(modes.shapes) <= AT_REST)

    @property
    def last(self):
        """The last place."""
        return int(self.starts[-1]) + len(self.ways[-1]) - 1

    def nodes(self, k):
        """Places of the nodes of a mode."""
        return mode_nodes(self.ways, self.starts, np.where(self.resting[k], 0.0, self.shapes[k]))

    def names(self, names):
        """Places and names of the disks that have room; of a branch the disk on which it hangs is in brackets."""
        places, said = [], []
        for number, (start, way) in enumerate(zip(self.starts.tolist(), self.ways, strict=True)):
            for i, disk in enumerate(way):
                places.append(start + i)
                said.append(f"({names[disk]})" if number and i == 0 else names[disk])
        step = -(-len(places) // NAMES)
        return places[::step], said[::step]


def mode_nodes(ways, starts, shape):
    """Places of the nodes: between disks that move against each other, and disks at rest between such."""
    found, place, signs = [], {}, {}
    for start, way in zip(starts, ways, strict=True):
        for i, (a, b) in enumerate(zip(way, way[1:], strict=False)):
            if shape[a] * shape[b] < 0:
                found.append(start + i + shape[a] / (shape[a] - shape[b]))
            for disk, other, at in ((a, b, start + i), (b, a, start + i + 1)):
                place.setdefault(disk, at)
                signs.setdefault(disk, set()).add(np.sign(shape[other]))
    found += [place[disk] for disk in place if shape[disk] == 0 and {-1.0, 1.0} <= signs[disk]]
    return [float(at) for at in found]

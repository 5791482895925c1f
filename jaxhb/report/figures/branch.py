"""Pictures of periodic motions: branches through their folds, and Floquet multipliers.

Forces are transmitted tooth forces; a peak is the largest absolute value.
"""

from itertools import pairwise

import numpy as np

from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import GREY, WITH, WITHOUT, crosses, figure, line, marks, plain, speed_range, top_of
from jaxhb.report.text.tuned import parameter_unit

POINTS = {"fold": "diamond", "branch point": "star", "period doubling": "triangle-up", "Neimark-Sacker": "cross"}
LOST = "fold", "period doubling", "Neimark-Sacker"
STABLE, UNSTABLE = {"color": WITHOUT, "dash": "solid"}, {"color": WITH, "dash": "dash"}


def plot_branch(branch, mesh=None):
    """A branch of periodic motions over its parameter: largest tooth force, and below it the critical multiplier.

    Lines are solid where the motion is stable, dashed where not; folds, period doublings and the like are marked. A
    motion is stable where the modulus of its multipliers is below 1.

    Parameters
    ----------
    branch : Branch
    mesh : str, optional
        Default: the one with the largest force.

    Examples
    --------
    >>> import jaxhb
    >>> train = jaxhb.load_scene("spur_pair")
    >>> figure = plot_branch(jaxhb.follow(train, "rpm", start=2000.0, to=3000.0))
    >>> [axes.get_ylabel() for axes in figure.axes]
    ['largest tooth force, kN', 'modulus of the multiplier']
    """
    topology = branch.train.topology
    mesh = mesh or topology.mesh_names[int(np.argmax(_peaks(branch).max(axis=0)))]
    traces, moduli = branch_traces(branch, mesh), np.abs(branch.multiplier)
    panels = [("largest tooth force, kN", top_of(traces)), ("modulus of the multiplier", None)]
    traces.append(line(branch.value, moduli, "critical multiplier", 3, panel=1, look={"dash": "solid", "width": 0.9}))
    traces += _moduli(branch.value, moduli, branch.stable, panel=1)
    unit = "rpm" if branch.parameter == "rpm" else parameter_unit(branch.train, branch.parameter)
    title = "speed" if branch.parameter == "rpm" else branch.parameter
    caption = f"{plain(mesh)}: a branch and its folds"
    made = figure(caption, f"{title}, {unit}".removesuffix(", "), panels, traces, height=210)
    return drawn(_logarithmic(made, "yaxis2", moduli), title=topology.name or "scene")


def plot_multipliers(rpm, stabilities):
    """Moduli of Floquet multipliers over the speed: from 1 on, the train does not run in the periodic motion.

    A small grey dot for each multiplier, a large mark for that of largest modulus with how stability is lost.

    Parameters
    ----------
    rpm : array ``(n,)``
    stabilities : sequence of n Stability or None
        None where there is no motion to ask about.

    Examples
    --------
    >>> import jaxhb
    >>> train, rpm = jaxhb.load_scene("spur_pair"), [2000.0, 3000.0]
    >>> figure = plot_multipliers(rpm, [jaxhb.stability(jaxhb.solve(train, rpm=speed)) for speed in rpm])
    >>> figure.axes[0].get_ylabel()
    'modulus of the multiplier'
    """
    asked = [(speed, found) for speed, found in zip(rpm, stabilities, strict=True) if found is not None]
    every = [(speed, abs(value)) for speed, found in asked for value in found.multipliers[~found.rotation]]
    traces = [marks(*np.reshape(every, (-1, 2)).T, "multiplier", "circle", size=3, color=GREY)]
    speeds, largest = np.array([(speed, found.largest) for speed, found in asked]).reshape(-1, 2).T
    traces += _moduli(speeds, largest, np.array([found.stable for _, found in asked], dtype=bool))
    for manner in LOST:
        at = [(speed, found.largest) for speed, found in asked if found.loses_by == manner]
        if at:
            traces.append(marks(*np.transpose(at), f"unstable: {manner}", POINTS[manner], color=WITH))
    caption, panels = "Multipliers of the periodic motions: growth of a disturbance in a cycle", [("", None)]
    none = [speed for speed, found in zip(rpm, stabilities, strict=True) if found is None]
    bottom = _limits(largest)[0]
    made = figure(caption, "speed, rpm", panels, traces + crosses(none, bottom), x_range=speed_range(rpm), height=330)
    made.layout["yaxis"]["title"]["text"] = "modulus of the multiplier"
    return drawn(_logarithmic(made, "yaxis", largest))


def branch_traces(branch, mesh):
    """Largest forces of a branch in kN as lines, solid where stable, with its special points on them."""
    peaks = _peaks(branch)[:, branch.train.topology.mesh_names.index(mesh)]
    values, forces, stable, points = _with_special_points(branch, peaks)
    edges, traces, met = [0, *(np.flatnonzero(np.diff(stable)) + 1), len(stable)], [], set()
    for begin, end in pairwise(edges):
        said, look = ("stable branch", STABLE) if stable[begin] else ("unstable branch", UNSTABLE)
        own = values[begin : end + 1], forces[begin : end + 1]
        traces.append(line(*own, said, look=look, showlegend=said not in met))
        met.add(said)
    for kind in dict.fromkeys(kind for kind, *_ in points):
        at = np.transpose([place for one, *place in points if one == kind])
        traces.append(marks(*at, kind, f"{POINTS[kind]}-open"))
    return traces


def _peaks(branch):
    """Largest absolute tooth forces in kN ``(P, M)``."""
    return np.maximum(branch.largest_force, -branch.smallest_force) / 1e3


def _with_special_points(branch, peaks):
    """Values and forces of a branch with its special points between, which of its stretches are stable, and these."""
    values, forces, stable, points = [branch.value[0]], [peaks[0]], [], []
    for k in range(len(branch) - 1):
        special = [point for point in branch.special if point.after == k]
        for point in special:
            force = peaks[k] + _share(point, *branch.value[k : k + 2]) * (peaks[k + 1] - peaks[k])
            points.append((point.kind, point.value, force))
            values.append(point.value)
            forces.append(force)
        ends = [bool(branch.stable[k]), bool(branch.stable[k + 1])]
        # Stability changes at special points alone; between two of one step nothing is known to be stable.
        stable += [ends[0], *[False] * (len(special) - 1), ends[1]] if special else [all(ends)]
        values.append(branch.value[k + 1])
        forces.append(peaks[k + 1])
    return np.array(values), np.array(forces), np.array(stable), points


def _share(point, before, after):
    """Of the way between two points of a branch where a special one lies; at a fold values go with its square."""
    one, other = abs(point.value - before), abs(point.value - after)
    if point.kind == "fold":
        one, other = one**0.5, other**0.5
    return one / (one + other) if one + other else 0.5


def _moduli(x, moduli, stable, panel=0):
    """Moduli of critical multipliers, and their limit 1."""
    ends = [np.min(x, initial=np.inf), np.max(x, initial=-np.inf)] if len(x) else [0.0, 0.0]
    limit = line(ends, [1.0, 1.0], "limit, unstable above", panel=panel, look={"color": "black"})
    points = {"stable": (stable, "circle", WITHOUT), "unstable": (~stable, "circle-open", WITH)}
    return [limit] + [
        marks(x[chosen], moduli[chosen], said, symbol, panel=panel, size=5, color=color)
        for said, (chosen, symbol, color) in points.items()
        if chosen.any()
    ]


def _limits(moduli):
    """Range of the axis of moduli."""
    return min(0.05, np.min(moduli, initial=1.0) / 2), max(3.0, 2 * np.max(moduli, initial=0.0))


def _logarithmic(made, axis, moduli):
    """A figure with an axis of moduli in a logarithmic scale."""
    made.layout[axis] |= {"type": "log", "range": [float(np.log10(end)) for end in _limits(moduli)]}
    return made

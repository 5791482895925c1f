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
LOWEST = 0.05
"""Modulus at the bottom of a picture, if none is smaller."""
STABLE, UNSTABLE = {"color": WITHOUT, "dash": "solid"}, {"color": WITH, "dash": "dash"}


def plot_branch(branch, mesh=None):
    """A branch of periodic motions over its parameter: largest tooth force, and below it the critical multiplier.

    Lines are solid where the motion is stable, dashed where not; folds, period doublings and the like are marked.
    ``mesh`` is by default the one with the largest force.
    """
    topology, moduli = branch.train.topology, np.abs(branch.multiplier)
    mesh = mesh or topology.mesh_names[int(np.argmax(_peaks(branch).max(axis=0)))]
    traces = branch_traces(branch, mesh)
    panels = [("largest tooth force, kN", top_of(traces)), ("modulus of the multiplier", None)]
    traces.append(line(branch.value, moduli, "critical multiplier", 3, panel=1, look={"dash": "solid", "width": 0.9}))
    points, scale = _moduli(branch.value, moduli, branch.stable, panel=1)
    unit = "rpm" if branch.parameter == "rpm" else parameter_unit(branch.train, branch.parameter)
    title = f"{branch.parameter.replace('rpm', 'speed')}, {unit}".removesuffix(", ")
    made = figure(f"{plain(mesh)}: a branch and its folds", title, panels, traces + points, height=210)
    made.layout["yaxis2"] |= scale
    return drawn(made, title=topology.name or "scene")


def plot_multipliers(rpm, stabilities):
    """Moduli of Floquet multipliers over the speed: from 1 on, the train does not run in the periodic motion.

    A small grey dot for each multiplier, a large mark for that of largest modulus with how stability is lost. Of the n
    ``stabilities`` one is None where there is no motion to ask about.
    """
    asked = [(speed, found) for speed, found in zip(rpm, stabilities, strict=True) if found is not None]
    every = [(speed, abs(value)) for speed, found in asked for value in found.multipliers[~found.rotation]]
    traces = [marks(*np.reshape(every, (-1, 2)).T, "multiplier", "circle", size=3, color=GREY)]
    speeds, largest = np.array([(speed, found.largest) for speed, found in asked]).reshape(-1, 2).T
    points, scale = _moduli(speeds, largest, np.array([found.stable for _, found in asked], dtype=bool))
    traces += points
    for manner in LOST:
        at = [(speed, found.largest) for speed, found in asked if found.loses_by == manner]
        if at:
            traces.append(marks(*np.transpose(at), f"unstable: {manner}", POINTS[manner], color=WITH))
    traces += crosses([speed for speed, found in zip(rpm, stabilities, strict=True) if found is None], LOWEST)
    caption = "Multipliers of the periodic motions: growth of a disturbance in a cycle"
    panels = [("modulus of the multiplier", None)]
    made = figure(caption, "speed, rpm", panels, traces, x_range=speed_range(rpm), height=300)
    made.layout["yaxis"] |= scale
    return drawn(made)


def branch_traces(branch, mesh):
    """Largest forces of a branch in kN as lines, solid where stable, with its special points on them."""
    peaks = _peaks(branch)[:, branch.train.topology.mesh_names.index(mesh)]
    at, special = [point.after for point in branch.special], branch.special
    shares = [_share(point, *branch.value[point.after : point.after + 2]) for point in special]
    marked = np.array([peaks[k] + share * (peaks[k + 1] - peaks[k]) for k, share in zip(at, shares, strict=True)])
    values = np.insert(branch.value, np.add(at, 1).astype(int), [point.value for point in special])
    forces = np.insert(peaks, np.add(at, 1).astype(int), marked)
    # Stability changes at special points alone; between two of one step nothing is known to be stable.
    sound = np.insert(np.asarray(branch.stable, float), np.add(at, 1).astype(int), 0.5)
    stable = sound[:-1] + sound[1:] > 1.0
    edges, traces, met = [0, *(np.flatnonzero(np.diff(stable)) + 1), len(stable)], [], set()
    for begin, end in pairwise(edges):
        said, look = ("stable branch", STABLE) if stable[begin] else ("unstable branch", UNSTABLE)
        own = values[begin : end + 1], forces[begin : end + 1]
        traces.append(line(*own, said, look=look, showlegend=said not in met))
        met.add(said)
    for kind in dict.fromkeys(point.kind for point in special):
        own = [point.kind == kind for point in special]
        x = [point.value for point in special if point.kind == kind]
        traces.append(marks(x, marked[own], kind, f"{POINTS[kind]}-open"))
    return traces


def _peaks(branch):
    """Largest absolute tooth forces in kN ``(P, M)``."""
    return np.maximum(branch.largest_force, -branch.smallest_force) / 1e3


def _share(point, before, after):
    """Of the way between two points of a branch where a special one lies; at a fold values go with its square."""
    power = 0.5 if point.kind == "fold" else 1.0
    one, other = abs(point.value - before) ** power, abs(point.value - after) ** power
    return one / (one + other) if one + other else 0.5


def _moduli(x, moduli, stable, panel=0):
    """Moduli of critical multipliers and their limit 1, and the logarithmic axis that they need."""
    limit = line(
        [min(x, default=0.0), max(x, default=0.0)],
        [1.0, 1.0],
        "limit, unstable above",
        panel=panel,
        look={"color": "black"},
    )
    points = {"stable": (stable, "circle", WITHOUT), "unstable": (~stable, "circle-open", WITH)}
    points = [
        marks(x[chosen], moduli[chosen], said, symbol, panel=panel, size=5, color=color)
        for said, (chosen, symbol, color) in points.items()
        if chosen.any()
    ]
    ends = min(LOWEST, np.min(moduli, initial=1.0) / 2), max(3.0, 2 * np.max(moduli, initial=0.0))
    return [limit, *points], {"type": "log", "range": [float(np.log10(end)) for end in ends]}

"""Pictures of periodic motions: branches through their folds, and Floquet multipliers.

Forces are transmitted tooth forces; a peak is the largest absolute value.
"""

import numpy as np

from jaxhb.report.figures.style import crosses, key, legend, line_key, new_figure, one_panel, plain
from jaxhb.report.text.tuned import parameter_unit

POINTS = {"fold": "D", "branch point": "*", "period doubling": "^", "Neimark-Sacker": "P"}
STABLE, UNSTABLE, GREY = "#1f4e79", "#b3261e", "0.65"


def plot_branch(branch, mesh=None):
    """A branch of periodic motions over its parameter: largest tooth force, and below it the critical multiplier.

    Parameters
    ----------
    branch : Branch
    mesh : str, optional
        Default: the one with the largest force.

    Returns
    -------
    matplotlib.figure.Figure
        Lines are solid where the motion is stable, dashed where not; folds, period doublings and the like are marked.
        A motion is stable where the modulus of its multipliers is below 1.

    Examples
    --------
    >>> import jaxhb
    >>> train = jaxhb.load_scene("spur_pair")
    >>> figure = plot_branch(jaxhb.follow(train, "rpm", start=2000.0, to=3000.0))
    >>> [axes.get_ylabel() for axes in figure.axes]
    ['largest tooth force, kN', 'modulus of the multiplier']
    """
    names = branch.train.topology.mesh_names
    mesh = mesh or names[int(np.argmax(_branch_peaks(branch).max(axis=0)))]
    figure = new_figure(6.2)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    above.set_title(
        f"{branch.train.topology.name or 'scene'}, {plain(mesh)}: a branch and its folds", fontsize="medium"
    )
    above.set_ylabel("largest tooth force, kN")
    draw_branch(above, branch, mesh)
    above.set_ylim(bottom=0.0)
    legend(above, branch_keys([branch]))
    below.semilogy(branch.value, np.abs(branch.multiplier), color="0.4", linewidth=0.9)
    _draw_moduli(below, branch.value, np.abs(branch.multiplier), branch.stable)
    unit = "" if branch.parameter == "rpm" else parameter_unit(branch.train, branch.parameter)
    below.set_xlabel("speed, rpm" if branch.parameter == "rpm" else f"{branch.parameter}{', ' + unit if unit else ''}")
    return figure


def plot_multipliers(rpm, stabilities):
    """Moduli of Floquet multipliers over the speed: from 1 on, the train does not run in the periodic motion.

    Parameters
    ----------
    rpm : array ``(n,)``
    stabilities : sequence of n Stability or None
        None where there is no motion to ask about.

    Returns
    -------
    matplotlib.figure.Figure
        A small grey dot for each multiplier, a large one for that of largest modulus with how stability is lost.

    Examples
    --------
    >>> import jaxhb
    >>> train, rpm = jaxhb.load_scene("spur_pair"), [2000.0, 3000.0]
    >>> figure = plot_multipliers(rpm, [jaxhb.stability(jaxhb.solve(train, rpm=speed)) for speed in rpm])
    >>> figure.axes[0].get_ylabel()
    'modulus of the multiplier'
    """
    figure, axes = one_panel("Multipliers of the periodic motions: growth of a disturbance in a cycle", "")
    asked = [(speed, found) for speed, found in zip(rpm, stabilities, strict=True) if found is not None]
    every = [(speed, abs(value)) for speed, found in asked for value in found.multipliers[~found.rotation]]
    axes.semilogy(*np.reshape(every, (-1, 2)).T, ".", color=GREY, markersize=3)
    speeds, largest = np.array([(speed, found.largest) for speed, found in asked]).reshape(-1, 2).T
    _draw_moduli(axes, speeds, largest, np.array([found.stable for _, found in asked], dtype=bool))
    none = [speed for speed, found in zip(rpm, stabilities, strict=True) if found is None]
    crosses(axes, none)
    keys = [key("stable", "o", STABLE)]
    for manner in ("fold", "period doubling", "Neimark-Sacker"):
        at = [(speed, found.largest) for speed, found in asked if found.loses_by == manner]
        if at:
            axes.plot(*np.transpose(at), POINTS[manner], color=UNSTABLE, markersize=7)
            keys.append(key(f"unstable: {manner}", POINTS[manner], UNSTABLE))
    legend(axes, keys + [key("no motion", "x", "black")] * bool(none))
    return figure


def _branch_peaks(branch):
    """Largest absolute tooth forces in kN ``(P, M)``."""
    return np.maximum(branch.largest_force, -branch.smallest_force) / 1e3


def draw_branch(axes, branch, mesh):
    """A branch as lines, its special points on them."""
    peak = _branch_peaks(branch)[:, branch.train.topology.mesh_names.index(mesh)]
    values, forces, stable, points = _with_special_points(branch, peak)
    edges = [0, *(np.flatnonzero(np.diff(stable)) + 1), len(stable)]
    for begin, end in zip(edges, edges[1:], strict=False):
        style = {"color": STABLE} if stable[begin] else {"color": UNSTABLE, "linestyle": (0, (4, 2))}
        axes.plot(values[begin : end + 1], forces[begin : end + 1], linewidth=1.5, **style)
    for kind, value, force in points:
        style = {"markerfacecolor": "white", "markersize": 9 if kind == "branch point" else 6.5, "zorder": 3}
        axes.plot(value, force, POINTS[kind], color="black", **style)


def _with_special_points(branch, peak):
    """Values and forces of a branch with its special points between, which of its stretches are stable, and these."""
    values, forces, stable, points = [branch.value[0]], [peak[0]], [], []
    for k in range(len(branch) - 1):
        special = [point for point in branch.special if point.after == k]
        for point in special:
            force = peak[k] + _share(point, *branch.value[k : k + 2]) * (peak[k + 1] - peak[k])
            points.append((point.kind, point.value, force))
            values.append(point.value)
            forces.append(force)
        ends = [bool(branch.stable[k]), bool(branch.stable[k + 1])]
        # Stability changes at special points alone; between two of one step nothing is known to be stable.
        stable += [ends[0], *[False] * (len(special) - 1), ends[1]] if special else [all(ends)]
        values.append(branch.value[k + 1])
        forces.append(peak[k + 1])
    return np.array(values), np.array(forces), np.array(stable), points


def _share(point, before, after):
    """Of the way between two points of a branch where a special one lies; at a fold values go with its square."""
    one, other = abs(point.value - before), abs(point.value - after)
    if point.kind == "fold":
        one, other = one**0.5, other**0.5
    return one / (one + other) if one + other else 0.5


def _draw_moduli(axes, x, moduli, stable):
    """Moduli of critical multipliers, the limit 1, and what lies beyond it shaded."""
    axes.semilogy(x[stable], moduli[stable], "o", color=STABLE, markersize=4)
    axes.semilogy(x[~stable], moduli[~stable], "o", color=UNSTABLE, markersize=4)
    axes.axhline(1.0, color="black", linewidth=1.0)
    top = max(3.0, 2 * np.max(moduli, initial=0.0))
    axes.axhspan(1.0, top, color=UNSTABLE, alpha=0.07, linewidth=0)
    axes.set_ylim(min(0.05, np.min(moduli, initial=1.0) / 2), top)
    axes.text(
        0.995, 1.15, "unstable", transform=axes.get_yaxis_transform(), ha="right", fontsize="small", color=UNSTABLE
    )
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_ylabel("modulus of the multiplier")


def branch_keys(branches):
    """Entries of a legend: branches and their special points."""
    found = {point.kind for branch in branches for point in branch.special}
    keys = [line_key("stable branch", STABLE)] * any(b.stable.any() for b in branches)
    broken = line_key("unstable branch", UNSTABLE, linestyle=(0, (4, 2)))
    keys += [broken] * any(not b.stable.all() for b in branches)
    return keys + [key(kind, POINTS[kind], "black", markerfacecolor="white") for kind in POINTS if kind in found]

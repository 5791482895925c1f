"""Picture of the linear forced response: orders and synthesis of some elements over the speed."""

import itertools

import numpy as np

from jaxhb.linear.strength import strength
from jaxhb.report.answer import shown
from jaxhb.report.figures.limits import draw_limits, judged_elements
from jaxhb.report.figures.style import WITH, WITHOUT, crosses, new_figure, plain
from jaxhb.report.selection import NOT_FIRING, train_name
from jaxhb.report.text.forced import signal_of

MOST = 4
"""Elements in one picture."""

DASHES = "-", (0, (6, 1.5)), (0, (6, 1.5, 1, 1.5)), (0, (2, 1)), (0, (9, 1.5, 1, 1.5, 1, 1.5)), (0, (1, 2.5))
"""Of the orders, which so differ without colour."""


def plot_forced(response, found, misfires=None, worst=None):
    """Half peak-to-peak, sum of amplitudes and the largest orders of up to four elements over the speed; limits.

    What the scene gives limits for has panels below: stresses, tooth torques and heat beside their limits, barred
    ranges shaded; of the elements drawn if few are given, else of each kind what comes nearest to its limit.

    Parameters
    ----------
    response : ForcedResponse, of several speeds
    found : list of Reading
        Of more than four, and of all elements, the shaft and the mesh that swing most are drawn.
    misfires : Misfires, worst : dict from :func:`jaxhb.report.text.forced.worst_of`, both optional
        With them each element has the half peak-to-peak of its worst misfire beside it.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> import jaxhb
    >>> from jaxhb.report.text.forced import readings
    >>> sweep = jaxhb.forced_response(jaxhb.load_scene("six_cylinder_diesel"), rpm=[1000.0, 1500.0, 2000.0])
    >>> len(plot_forced(sweep, readings(sweep)).axes)
    1
    """
    drawn = found if len(found) <= MOST else hardest_elements(found)
    judged = strength(shown(response))
    limited = judged_elements(judged, {one.name for one in found}, each=len(found) <= MOST)
    figure = new_figure(1.2 + 3.0 * len(drawn) + 2.2 * len(limited))
    heights = [3.0] * len(drawn) + [2.2] * len(limited)
    panels = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for axes, chosen in zip(panels[len(drawn) :], limited, strict=True):
        sweeps = {"": judged}
        if misfires is not None:
            cylinder = worst[chosen[1]].cylinder
            sweeps[f", {plain(cylinder)}{NOT_FIRING}"] = strength(shown(misfires.responses[cylinder]))
        draw_limits(axes, sweeps, *chosen)
    for axes, one in zip(panels, drawn, strict=False):
        factor, unit = one.shown
        signal, certain = one.signal, np.where(response.converged, factor, np.nan)
        swing, total = certain * signal.half_peak_to_peak, certain * signal.sum_of_amplitudes
        axes.plot(response.rpm, swing, color=WITH, linewidth=1.8, label="half peak-to-peak")
        axes.plot(response.rpm, total, color=WITH, linestyle=":", label="sum of amplitudes")
        if misfires is not None:
            cylinder = worst[one.name].cylinder
            other = misfires.responses[cylinder]
            swing = signal_of(other, one.name, one.kind).half_peak_to_peak
            named = {"label": f"half peak-to-peak, {plain(cylinder)}{NOT_FIRING}"}
            swing = np.where(other.converged, factor, np.nan) * swing
            axes.plot(response.rpm, swing, color=WITHOUT, linestyle="--", linewidth=1.8, **named)
        main = one.at(np.asarray(response.converged)).main() if response.converged.any() else ()
        for k, dashes in zip(main, itertools.cycle(DASHES), strict=False):
            heights = certain * signal.amplitudes[:, k]
            axes.plot(response.rpm, heights, linewidth=1.0, linestyle=dashes, label=f"order {signal.orders[k]:g}")
        crosses(axes, response.rpm[~np.asarray(response.converged)])
        axes.set_ylabel(f"{plain(one.name)}, {unit}")
        axes.set_ylim(bottom=0.0)
        axes.legend(fontsize="x-small", ncols=2, handlelength=4)
    panels[0].set_title(f"{train_name(response.topology)}: linear forced response", fontsize="medium")
    panels[-1].set_xlabel("speed, rpm")
    return figure


def hardest_elements(found):
    """The shaft and the mesh with the largest half peak-to-peak, without either the disk."""
    kinds = {kind: [one for one in found if one.kind == kind] for kind in ("shafts", "meshes")}
    kinds = [own for own in kinds.values() if own] or [found]
    return [max(own, key=lambda one: np.max(one.signal.half_peak_to_peak)) for own in kinds]

"""Figures of the linear forced response: orders and synthesis of some elements over the speed."""

import numpy as np

from jaxhb.linear.strength import strength
from jaxhb.report.answer import shown
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import crosses, figure, line, plain, top_of
from jaxhb.report.figures.limits import judged_elements, limit_figure
from jaxhb.report.selection import NOT_FIRING, train_name

MOST = 4
"""Elements in one picture."""

SYMBOLS = "circle", "square", "diamond", "triangle-up", "cross", "star"
"""Of the orders."""


def plot_forced(response, found, misfires=None, worst=None):
    """Half peak-to-peak, sum of amplitudes and the largest orders of up to four elements over the speed; limits.

    What the scene gives limits for has panels below: stresses, tooth torques and heat beside their limits, barred
    ranges shaded; of the elements drawn if few are given, else of each kind what comes nearest to its limit.
    Of more than four readings ``found`` the shaft and the mesh that swing most are drawn. With ``misfires`` and the
    ``worst`` of them (:func:`jaxhb.report.text.forced.worst_of`) each element has the half peak-to-peak of its worst
    misfire beside it.
    """
    return drawn(*forced_figures(response, found, misfires, worst), title=train_name(response.topology))


def forced_figures(response, found, misfires=None, worst=None):
    """The figures of :func:`plot_forced`, in a list."""
    certain = np.asarray(response.converged)
    known = [one.at(certain) for one in found] if certain.any() else found
    chosen = known if len(found) <= MOST else hardest_elements(known)
    judged = strength(shown(response))

    def beside(name):
        """The worst misfire of an element."""
        return {f"{worst[name].cylinder}{NOT_FIRING}": misfires.responses[worst[name].cylinder]} if misfires else {}

    figures = [orders_figure(response, one, beside(one.name)) for one in chosen]
    for kind, name in judged_elements(judged, {one.name for one in found}, each=len(found) <= MOST):
        cases = {title: strength(shown(other)) for title, other in beside(name).items()}
        figures.append(limit_figure({"": judged} | cases, kind, name))
    return figures


def orders_figure(response, element, misfires, title=""):
    """Synthesis, sum and main orders of an element, a Reading, over the speed; gaps and crosses without an answer.

    misfires : responses by title, whose half peak-to-peak stands beside it; title : of the case
    """
    factor, unit = element.shown
    signal, rpm = element.of(response).signal, response.rpm
    converged = np.asarray(response.converged)
    certain = np.where(converged, factor, np.nan)
    traces = [
        line(rpm, certain * signal.half_peak_to_peak, "half peak-to-peak", look={"width": 2.4}),
        line(rpm, certain * signal.sum_of_amplitudes, "sum of amplitudes", 3),
    ]
    for called, other in misfires.items():
        own = np.where(other.converged, factor, np.nan) * element.of(other).signal.half_peak_to_peak
        traces.append(line(rpm, own, f"half peak-to-peak, {plain(called)}", 1))
    for number, k in enumerate(element.main() if converged.any() else ()):
        marker = {"symbol": SYMBOLS[number % len(SYMBOLS)], "size": 6, "maxdisplayed": 12}
        more = {"mode": "lines+markers", "marker": marker, "look": {"width": 1.0}}
        traces.append(line(rpm, certain * signal.amplitudes[:, k], f"order {signal.orders[k]:g}", 2 + number, **more))
    panels = [(f"{element.called}, {unit}", top_of(traces))]
    traces += crosses(rpm[~converged])
    across = (rpm[0], rpm[-1]) if len(rpm) > 1 else None
    said = f"linear forced response over the speed, {title}".removesuffix(", ")
    return figure(f"{plain(element.name)}: {said}, {unit}", "speed, rpm", panels, traces, x_range=across, height=220)


def hardest_elements(found):
    """The shaft and the mesh with the largest half peak-to-peak, without either the disk."""
    kinds = {kind: [one for one in found if one.kind == kind] for kind in ("shafts", "meshes")}
    kinds = [own for own in kinds.values() if own] or [found]
    return [max(own, key=lambda one: np.max(one.signal.half_peak_to_peak)) for own in kinds]

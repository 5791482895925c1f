"""Figures of the linear forced response: orders and synthesis of some elements over the speed."""

import numpy as np

from jaxhb.linear.strength import strength
from jaxhb.report.answer import shown
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import Figure, crosses, layout, line, top_of
from jaxhb.report.figures.limits import judged_elements, limit_figure
from jaxhb.report.figures.style import plain
from jaxhb.report.selection import NOT_FIRING, train_name
from jaxhb.report.text.forced import signal_of

MOST = 4
"""Elements in one picture."""

SYMBOLS = "circle", "square", "diamond", "triangle-up", "cross", "star"
"""Of the orders."""


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
    return drawn(*forced_figures(response, found, misfires, worst), title=train_name(response.topology))


def forced_figures(response, found, misfires=None, worst=None):
    """The figures of :func:`plot_forced`, in a list."""
    certain = np.asarray(response.converged)
    known = [one.at(certain) for one in found] if certain.any() else found
    chosen = known if len(found) <= MOST else hardest_elements(known)
    judged = strength(shown(response))
    limited = judged_elements(judged, {one.name for one in found}, each=len(found) <= MOST)

    def beside(name):
        """The worst misfire of an element."""
        return {f"{worst[name].cylinder}{NOT_FIRING}": misfires.responses[worst[name].cylinder]} if misfires else {}

    figures = [orders_figure(response, one, beside(one.name)) for one in chosen]
    for kind, name in limited:
        cases = {title: strength(shown(other)) for title, other in beside(name).items()}
        figures.append(limit_figure({"": judged} | cases, kind, name))
    return figures


def orders_figure(response, element, misfires, title=""):
    """Synthesis, sum and main orders of an element over the speed; gaps and crosses where there is no answer.

    Parameters
    ----------
    response : ForcedResponse, of several speeds
    element : Reading
    misfires : dict
        Responses by title, whose half peak-to-peak stands beside it.
    title : str, of the case
    """
    factor, unit = element.shown
    signal, rpm = signal_of(response, element.name, element.kind), response.rpm
    converged = np.asarray(response.converged)
    certain = np.where(converged, factor, np.nan)
    traces = [
        line(rpm, certain * signal.half_peak_to_peak, "half peak-to-peak"),
        line(rpm, certain * signal.sum_of_amplitudes, "sum of amplitudes", 3),
    ]
    traces[0]["line"] |= {"width": 2.4}
    for called, other in misfires.items():
        own = signal_of(other, element.name, element.kind).half_peak_to_peak
        own = np.where(other.converged, factor, np.nan) * own
        traces.append(line(rpm, own, f"half peak-to-peak, {plain(called)}", 1))
    for number, k in enumerate(element.main() if converged.any() else ()):
        marker = {"symbol": SYMBOLS[number % len(SYMBOLS)], "size": 6, "maxdisplayed": 12}
        more = {"mode": "lines+markers", "marker": marker}
        traces.append(line(rpm, certain * signal.amplitudes[:, k], f"order {signal.orders[k]:g}", 2 + number, **more))
        traces[-1]["line"] |= {"width": 1.0}
    panels = [(f"{element.called}, {unit}", top_of(*(trace["y"] for trace in traces)))]
    traces += crosses(rpm[~converged])
    across = (rpm[0], rpm[-1]) if len(rpm) > 1 else None
    made = layout("speed, rpm", panels, traces, x_range=across, heights=[220])
    said = f"linear forced response over the speed, {title}".removesuffix(", ")
    return Figure(f"{plain(element.name)}: {said}, {unit}", traces, made)


def hardest_elements(found):
    """The shaft and the mesh with the largest half peak-to-peak, without either the disk."""
    kinds = {kind: [one for one in found if one.kind == kind] for kind in ("shafts", "meshes")}
    kinds = [own for own in kinds.values() if own] or [found]
    return [max(own, key=lambda one: np.max(one.signal.half_peak_to_peak)) for own in kinds]

"""Pictures of the linear train: Holzer's residual over the frequency and the Campbell diagram."""

import numpy as np

from jaxhb.linear.critical import ELASTIC
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import GREY, WITH, WITHOUT, bars, figure, line, marks
from jaxhb.report.text.linear import shares_in_mode, shown_modes

POINTS = 2000
COUNTS = 0.1
"""Modal torque over the largest of the mode from which a critical speed is filled."""
APART = 0.032
"""Share of the height between the names of two modes."""
LINEAR = 1e-3
"""Residual over its median below which the scale is linear."""


def plot_holzer(residual, tables, natural, name):
    """Holzer's residual over the frequency, natural frequencies as circles, frequencies asked for as dotted lines.

    Every branch begins with ordinate 1 at its free end; a table of a train with branches is scaled otherwise. The scale
    is logarithmic on both sides of 0, as the residual grows with a high power of the frequency.

    residual : function, frequencies ``(n,)`` in Hz to N m; tables : list of (int or None, HolzerTable); natural : dict,
    number of the mode: Hz, of those that strain links; name : of the scene
    """
    highest = 1.15 * max(table.hz for _, table in tables)
    hz = highest * np.arange(1, POINTS + 1) / POINTS
    values = residual(hz)
    zeros = {mode: own for mode, own in natural.items() if own <= highest}
    asked = [table.hz for mode, table in tables if mode is None]
    ends = np.nanmin(values), np.nanmax(values)
    traces = [line(hz, values, "residual", 1, look={"dash": "solid"})]
    traces.append(marks(list(zeros.values()), np.zeros(len(zeros)), "zero", "circle-open", color=WITH))
    if asked:
        low, high = (np.full(len(asked), end) for end in ends)
        traces.append(bars(asked, low, high, "frequency asked for", look={"color": "black", "dash": "dot"}))
    style = {"y": 0.0, "xshift": 5, "yshift": 14, "xanchor": "left", "showarrow": False, "font": {"size": 10}}
    notes = [style | {"x": own, "text": f"mode {mode}<br>{own:.4g} Hz"} for mode, own in zeros.items()]
    caption, panels = "Holzer's residual, zero at natural frequencies", [("residual, N m, from ordinates 1", None)]
    more = {"x_range": (0.0, highest), "height": 220, "annotations": notes}
    picture = drawn(figure(caption, "frequency, Hz", panels, traces, **more), title=name)
    small = LINEAR * float(np.median(np.abs(values[np.isfinite(values)])))
    picture.axes[0].set_yscale("symlog", linthresh=10 ** np.ceil(np.log10(small)) if small else 1.0)
    return picture


def plot_campbell(found, count, name):
    """Natural frequencies over the speed, orders as rays, critical speeds as circles.

    Full lines are modes, named with their frequency at the right; dashed rays are orders, named where they leave the
    picture; dotted lines are rigid modes and those of rings only. ``count`` elastic modes were taken.
    """
    return drawn(campbell_figure(found, count, name))


def campbell_figure(found, count, title):
    """The figure of :func:`plot_campbell`; its title is that of the scene or case."""
    low, high = float(found.rpm[0]), float(found.rpm[-1])
    elastic = found.elastic(count)
    top, traces = _top_frequency(found, elastic), []
    for order in found.orders:
        look, own = {"color": GREY, "dash": "dash", "width": 0.8}, [order * low / 60, order * high / 60]
        traces.append(line([low, high], own, f"order {order:g}", look=look, showlegend=False))
    shown = [k for k in shown_modes(found, count) if found.frequencies_hz[-1, k] <= top]
    for k in shown:
        look = {"color": WITHOUT, "dash": "solid"} if k in elastic else {"color": "grey", "dash": "dot"}
        own = found.frequencies_hz[:, k]
        traces.append(line(found.rpm, own, f"mode {k}", look=look | {"width": 1.8}, showlegend=False))
    filled = counting(found)
    for symbol, own in {"circle": filled, "circle-open": [c for c in found.critical if c not in filled]}.items():
        text = [f"order {c.order:g}, mode {c.mode}, modal torque {c.torque:.4g} N m" for c in own]
        more = {"text": text, "hovertemplate": "%{x} rpm, %{y} Hz: %{text}<extra></extra>", "showlegend": False}
        points = [c.rpm for c in own], [c.hz for c in own]
        traces.append(marks(*points, "critical speed", symbol, color=WITH, **more))
    caption = (
        f"Campbell diagram, {title}: modes full, orders dashed (named at their ends), critical speeds circled,"
        f" filled where the modal torque is above {100 * COUNTS:g} % of the largest of the mode"
    )
    names = [_ray_name(order, high, top) for order in found.orders if order * low / 60 < top]
    more = {"x_range": (low, high), "height": 400, "annotations": names + _mode_names(found, shown, top)}
    made = figure(caption, "speed, rpm", [("frequency, Hz", (0.0, top))], traces, **more)
    made.layout["margin"] |= {"r": 125, "t": 24}
    made.layout["height"] += 12
    return made


def counting(found):
    """Critical speeds whose modal torque counts beside the largest of their mode."""
    shares = shares_in_mode(found.critical, [c.torque for c in found.critical])
    return [c for c, share in zip(found.critical, shares, strict=True) if share > COUNTS]


def _mode_names(found, shown, top):
    """Names of the modes at the right, moved up where they would lie on one another; zero frequencies share one."""
    names = {}
    for k in shown:
        hz = found.frequencies_hz[-1, k]
        what = f"{hz:.4g} Hz" if found.kinds[k] == ELASTIC else found.kinds[k]
        names.setdefault(float(hz) if hz > APART * top / 10 else 0.0, []).append(f" mode {k}: {what}")
    style = {"x": 1.0, "xref": "paper", "xanchor": "left", "align": "left", "showarrow": False, "font": {"size": 10}}
    notes, lowest = [], 0.0
    for hz, said in names.items():
        place = {"y": max(hz, lowest), "yanchor": "middle" if hz else "bottom"}
        notes.append(style | place | {"text": "<br>".join(said)})
        lowest = place["y"] + APART * top * (len(said) + 0.5 * (not hz))
    return notes


def _top_frequency(found, elastic):
    """Highest frequency: where modes or orders end, and at least the lowest mode."""
    modes = found.frequencies_hz[:, elastic].max(axis=0)
    rays = found.orders * found.rpm[-1] / 60
    highest = min(modes.max(initial=0.0), rays.max(initial=0.0))
    return 1.08 * (max(highest, modes[:1].max(initial=0.0)) or 1.0)


def _ray_name(order, high, top):
    """The order where its ray leaves the picture."""
    style = {"text": f"{order:g}", "showarrow": False, "font": {"size": 9}, "bgcolor": "white", "borderpad": 0}
    if order * high / 60 > top:
        return style | {"x": 60 * top / order, "y": top, "yanchor": "bottom"}
    return style | {"x": high, "y": order * high / 60, "xanchor": "right", "xshift": -4}

"""Parts of the page of the linear train: natural frequencies and shapes, the Campbell diagram, forced orders."""

import dataclasses

import numpy as np

from jaxhb.linear.critical import ELASTIC, campbell as campbell_of, excited_orders, mode_kinds
from jaxhb.linear.damped import DAMPED_DISKS, damping_ratios
from jaxhb.linear.forced import forced_response
from jaxhb.linear.modal import natural_frequencies
from jaxhb.report.figures.forced import hardest_elements
from jaxhb.report.figures.linear import COUNTS, counting, top_frequency
from jaxhb.report.figures.modes import MOST, Ways
from jaxhb.report.figures.style import WITH, WITHOUT, plain
from jaxhb.report.page.figures import Figure, above, crosses, layout, line, marks, top_of
from jaxhb.report.page.parts import Heading
from jaxhb.report.selection import NOT_FIRING
from jaxhb.report.text.campbell import campbell_parts, reached, shares_in_mode, shown_modes
from jaxhb.report.text.forced import forced_failures, readings, signal_of, worst_tables
from jaxhb.report.text.tables import modes_text

CAMPBELL_MODES = 6, 12
"""Modes of the Campbell diagram: at least so many, and those that the orders reach up to the second number."""

ONE_SPEED = 0.5
"""Range of a Campbell diagram around one speed, below and above as a share of it."""

LOWEST = 60
"""Natural frequencies of a train of many disks."""

TOGETHER = 3
"""Mode shapes in a figure: what does not fit on a sheet leaves it empty."""

NEGLIGIBLE = 0.01
"""Modal torque over the largest of the mode below which a critical speed is not in the table."""

SPEEDS = 201
"""Speeds of the linear forced response at least: it costs little and has sharp peaks."""


def modes_part(report):
    """Natural frequencies and the shapes of the first ones that strain links."""
    train = report.train
    few = train.topology.n_disks <= DAMPED_DISKS
    found = natural_frequencies(train, count=None if few else LOWEST)
    kinds = mode_kinds(found, train.topology.damper_names)
    ratios = damping_ratios(train, found) if few else np.full(len(kinds), np.nan)
    table = modes_text(found, report.name, kinds, ratios, "teeth in contact" if train.topology.mesh_names else "")
    elastic = [k for k, kind in enumerate(kinds) if kind == ELASTIC][:MOST]
    shapes = [elastic[i : i + TOGETHER] for i in range(0, len(elastic), TOGETHER)]
    return [table, *(_shapes(train, found, some, ratios) for some in shapes)]


def _shapes(train, modes, chosen, ratios):
    """Mode shapes along the train: a line for every way through it, crosses at the nodes."""
    ways = Ways.of(train, modes)
    traces, panels, notes = [], [], []
    for panel, k in enumerate(chosen):
        shape, nodes = ways.shapes[k], ways.nodes(k)
        for number, (start, way) in enumerate(zip(ways.starts, ways.ways, strict=True)):
            names = [modes.names[disk] for disk in way]
            style = {"mode": "lines+markers", "text": names, "hovertemplate": "%{text}: %{y}<extra></extra>"}
            place = start + np.arange(len(way))
            traces.append(line(place, shape[way], "", min(number, 1), panel=panel, showlegend=False, **style))
        traces.append(marks(nodes, np.zeros(len(nodes)), "node", "x-thin-open", panel=panel, showlegend=False))
        traces[-1]["marker"] |= {"line": {"width": 2, "color": WITH}}
        panels.append(("", (-1.15, 1.15)))
        damping = "" if np.isnan(ratios[k]) else f", damping ratio {ratios[k]:.3g}"
        text = f"mode {k}: {modes.frequencies_hz[k]:.4g} Hz{damping}"
        notes.append(above(text, panel))
    places, said = ways.names(modes.names)
    made = layout("", panels, traces, heights=[95] * len(panels), annotations=notes, x_range=(-0.5, ways.last + 0.5))
    longest = max(map(len, said))
    made["xaxis"] |= {"tickvals": places, "ticktext": said, "tickangle": -90, "tickfont": {"size": 9}}
    made["margin"] |= {"t": 22, "b": 16 + round(5.4 * longest)}
    made["height"] += round(5.4 * longest) - 20
    caption = "Mode shapes, angles referred to the reference rotor, the largest is 1; crosses: nodes. "
    branches = "Dashed: branches, each begins at the disk named in brackets." * (len(ways.ways) > 1)
    return Figure(caption + branches, traces, made)


def campbell_part(report):
    """Natural frequencies over the speed, orders, critical speeds."""
    rpm = report.rpm
    low, high = min(rpm), max(rpm)
    low, high = (low * (1 - ONE_SPEED), high * (1 + ONE_SPEED)) if low == high else (low, high)
    speeds = np.linspace(low, high, 33)
    trains = {case.title.removesuffix(NOT_FIRING): case.answers[0].train for case in report.shown}
    orders = sorted({order for train in trains.values() for order in excited_orders(train, rpm=speeds)})
    asked = {"rpm": speeds, "orders": orders, "count": CAMPBELL_MODES[1]}
    found, *others = (campbell_of(train, **asked) for train in trains.values())
    count = min(max(reached(found), CAMPBELL_MODES[0]), CAMPBELL_MODES[1])
    torques = [max(c.torque for c in same) for same in zip(*(one.critical for one in (found, *others)), strict=True)]
    shares = shares_in_mode(found.critical, torques)
    chosen = [place for place, share in enumerate(shares) if share >= NEGLIGIBLE]
    main, *others = (
        dataclasses.replace(one, critical=tuple(one.critical[place] for place in chosen)) for one in (found, *others)
    )
    misfires = dict(zip(list(trains)[1:], others, strict=True))
    left = len(torques) - len(chosen)
    said = f"{left} critical speeds have a modal torque below {100 * NEGLIGIBLE:g} % of the largest of their mode:"
    said += " left out here."
    tables = campbell_parts(main, count, misfires)
    return [_campbell(found, count, report.cases[0].title), *tables, *[said] * bool(left)]


def _campbell(found, count, title):
    low, high = float(found.rpm[0]), float(found.rpm[-1])
    elastic = found.elastic(count)
    top = top_frequency(found, elastic)
    traces, names = [], []
    for order in found.orders:
        traces.append(line([low, high], [order * low / 60, order * high / 60], f"order {order:g}", showlegend=False))
        traces[-1]["line"] = {"color": "#6f6f6f", "dash": "dash", "width": 0.8}
        names += [_ray_name(order, high, top)] if order * low / 60 < top else []
    lowest = 0.0
    for k in [k for k in shown_modes(found, count) if found.frequencies_hz[-1, k] <= top]:
        hz = found.frequencies_hz[:, k]
        traces.append(line(found.rpm, hz, f"mode {k}", 1, showlegend=False))
        traces[-1]["line"] = {"color": WITHOUT if k in elastic else "grey", "width": 1.8}
        if k in elastic:
            lowest = max(float(hz[-1]), lowest)
            said = {"x": 1.0, "xref": "paper", "y": lowest, "text": f" mode {k}: {hz[-1]:.4g} Hz"}
            names.append(said | {"xanchor": "left", "showarrow": False, "font": {"size": 10}})
            lowest += 0.035 * top
    kinds = {"circle": counting(found)}
    kinds["circle-open"] = [c for c in found.critical if c not in kinds["circle"]]
    for symbol, own in kinds.items():
        text = [f"order {c.order:g}, mode {c.mode}, modal torque {c.torque:.4g} N m" for c in own]
        more = {"text": text, "hovertemplate": "%{x} rpm, %{y} Hz: %{text}<extra></extra>", "color": WITH}
        points = [c.rpm for c in own], [c.hz for c in own]
        traces.append(marks(*points, "critical speed", symbol, showlegend=False, **more))
    caption = (
        f"Campbell diagram, {title}: modes full, orders dashed (named at their ends), critical speeds circled,"
        f" filled where the modal torque is above {100 * COUNTS:g} % of the largest of the mode"
    )
    panels = [("frequency, Hz", (0.0, top))]
    made = layout("speed, rpm", panels, traces, x_range=(low, high), heights=[400], annotations=names)
    made["margin"] |= {"r": 125, "t": 24}
    made["height"] += 12
    return Figure(caption, traces, made)


def _ray_name(order, high, top):
    """The order where its ray leaves the picture."""
    style = {"text": f"{order:g}", "showarrow": False, "font": {"size": 9}, "bgcolor": "white", "borderpad": 0}
    if order * high / 60 > top:
        return style | {"x": 60 * top / order, "y": top, "yanchor": "bottom"}
    return style | {"x": high, "y": order * high / 60, "xanchor": "right", "xshift": -4}


def forced_part(report):
    """The linear forced response over the speeds: the worst of every element, orders of what swings most."""
    low, high = min(report.rpm), max(report.rpm)
    speeds = np.unique([*report.rpm, *(np.linspace(low, high, SPEEDS) if low < high else [])])
    trains = {case.title: case.answers[0].train for case in report.shown}
    responses = {title: forced_response(train, rpm=speeds) for title, train in trains.items()}
    first = responses[report.cases[0].title]
    found, good = readings(first), np.asarray(first.converged)
    chosen = hardest_elements([one.at(good) for one in found]) if len(speeds) > 1 and good.any() else []
    misfires = {title: response for title, response in responses.items() if NOT_FIRING in title}
    figures = [_orders(first, one, misfires, report.cases[0].title) for one in chosen]
    title = report.cases[0].title
    dashed = " Lines of a misfire are its half peak-to-peak." * bool(misfires)
    head = f"Linear, teeth in contact, at {len(speeds)} speeds. Sums and orders in the figures: {title}.{dashed}"
    tables = [Heading(f"Largest values, {title}"), *worst_tables(first, found), *forced_failures(first)]
    for other, response in misfires.items():
        tables += [Heading(f"Largest values, {other}"), *worst_tables(response, readings(response))]
        tables += forced_failures(response, other)
    return [head, *figures, *tables]


def _orders(response, element, misfires, title):
    """Synthesis, sum and main orders of an element over the speed; gaps and crosses where there is no answer."""
    factor, unit = element.shown
    signal, rpm = signal_of(response, element.name, element.kind), response.rpm
    certain = np.where(response.converged, factor, np.nan)
    traces = [
        line(rpm, certain * signal.half_peak_to_peak, "half peak-to-peak"),
        line(rpm, certain * signal.sum_of_amplitudes, "sum of amplitudes", 3),
    ]
    traces[0]["line"] |= {"width": 2.4}
    for called, other in misfires.items():
        own = signal_of(other, element.name, element.kind).half_peak_to_peak
        own = np.where(other.converged, factor, np.nan) * own
        traces.append(line(rpm, own, f"half peak-to-peak, {plain(called)}", 1))
    for number, k in enumerate(element.main()):
        symbol = ("circle", "square", "diamond", "triangle-up", "cross", "star")[number % 6]
        marker = {"symbol": symbol, "size": 6, "maxdisplayed": 12}
        more = {"mode": "lines+markers", "marker": marker}
        traces.append(line(rpm, certain * signal.amplitudes[:, k], f"order {signal.orders[k]:g}", 2 + number, **more))
        traces[-1]["line"] |= {"width": 1.0}
    panels = [(unit, top_of(*(trace["y"] for trace in traces)))]
    traces += crosses(rpm[~np.asarray(response.converged)])
    made = layout("speed, rpm", panels, traces, x_range=(float(rpm[0]), float(rpm[-1])), heights=[220])
    return Figure(f"{plain(element.name)}: linear forced response over the speed, {title}, {unit}", traces, made)

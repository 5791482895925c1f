"""Figures over the speed: stresses, tooth torques and heat beside their limits, barred ranges shaded."""

import numpy as np

from jaxhb.report.figures.figure import MARKED, bands, figure, line, plain, speed_range, top_of
from jaxhb.report.text.strength import LIMITED


def judged_elements(found, names=None, *, each=False):
    """What has a panel, as (key of LIMITED, name), of the elements ``names`` or of all: of each kind that with the
    largest share of its limit, without limits that with the largest number, or ``each``."""
    chosen = []
    for key, kind in LIMITED.items():
        rows = {name: row for name, row in getattr(found, key).items() if names is None or name in names}

        def most(name, kind=kind, rows=rows):
            values = np.asarray(getattr(rows[name], kind.field), float)
            return np.nanmax(np.append(kind.shares(rows[name]), -1.0)), np.nanmax(np.append(values, 0.0))

        chosen += [(key, name) for name in (rows if each or not rows else [max(rows, key=most)])]
    return chosen


def limit_figure(judged, key, name):
    """One element of :func:`judged_elements` against its limits; what is barred is shaded.

    judged : one :class:`jaxhb.Strength` or more of the same speeds and limits, by the titles of their cases
    """
    kind, first, traces = LIMITED[key], next(iter(judged.values())), []
    called, (factor, unit) = kind.called, kind.shown
    for number, (title, found) in enumerate(judged.items()):
        values = factor * np.asarray(getattr(getattr(found, key)[name], kind.field), float)
        said = f"{called}, {plain(title)}".removesuffix(", ")
        traces.append(line(found.rpm, values, said, number, mode="lines+markers" if len(values) <= MARKED else "lines"))
    for number, (limit, said) in enumerate(kind.limits.items()):
        values = getattr(getattr(first, key)[name], limit)
        if values is not None:
            values = factor * np.broadcast_to(values, np.shape(first.rpm))
            traces.append(line(first.rpm, values, said, 2 + number, look={"color": "black"}))
    barred = [one for found in judged.values() for one in found.barred.get(name, ())] if key == "stresses" else []
    shaded = "; grey: barred" + " in one of these cases" * (len(judged) > 1) if barred else ""
    against = " against its limits" if len(traces) > len(judged) else ""
    caption = f"{plain(name)}: {called}{against}, {unit}{shaded}"
    panels, shapes = [(f"{called}, {unit}", top_of(traces))], bands([(one.low, one.high) for one in barred])
    return figure(caption, "speed, rpm", panels, traces, x_range=speed_range(first.rpm), height=180, shapes=shapes)

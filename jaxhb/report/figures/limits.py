"""Figures over the speed: stresses, tooth torques and heat beside their limits, barred ranges shaded."""

from typing import NamedTuple

import numpy as np

from jaxhb.report.figures.figure import MARKED, bands, figure, line, plain, speed_range, top_of


class Judged(NamedTuple):
    """A kind of number that is judged: its field in a row of a :class:`jaxhb.Strength`, what it is called, factor and
    unit for people, and the fields of its limits with what they are called, the one that counts first."""

    field: str
    called: str
    factor: float
    unit: str
    limits: dict

    @property
    def limit(self):
        """What the first limit is called."""
        return next(iter(self.limits.values()))

    def shares(self, row):
        """Shares of the first limit over the speeds, nan where there is none or nothing is known."""
        limit = getattr(row, next(iter(self.limits)))
        limit = np.asarray(np.nan if limit is None else limit, float)
        return np.asarray(getattr(row, self.field), float) / np.where(np.isfinite(limit), limit, np.nan)


JUDGED = {
    "stresses": Judged(
        "stress", "stress", 1e-6, "MPa", {"continuous": "continuous limit", "transient": "transient limit"}
    ),
    "tooth_torques": Judged("vibratory", "vibratory torque", 1.0, "N m", {"limit": "a third of the rated torque"}),
    "heat": Judged("power", "heat", 1.0, "W", {"limit": "limit"}),
}
"""By the fields of a :class:`jaxhb.Strength`."""


def judged_elements(found, names=None, *, each=False):
    """What has a panel, as (key of JUDGED, name): of each kind the element with the largest share of its limit, without
    limits that with the largest number, or ``each`` of them; ``names``: elements that are looked at, else all."""
    chosen = []
    for key, kind in JUDGED.items():
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
    _, called, factor, unit, limits = kind = JUDGED[key]
    first, traces = next(iter(judged.values())), []
    for number, (title, found) in enumerate(judged.items()):
        values = factor * np.asarray(getattr(getattr(found, key)[name], kind.field), float)
        said = f"{called}, {plain(title)}".removesuffix(", ")
        traces.append(line(found.rpm, values, said, number, mode="lines+markers" if len(values) <= MARKED else "lines"))
    for number, (limit, said) in enumerate(limits.items()):
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

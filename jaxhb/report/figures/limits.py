"""Figures over the speed: stresses, tooth torques and heat beside their limits, barred ranges shaded."""

import numpy as np

from jaxhb.report.figures.figure import Figure, bands, layout, line, speed_range, top_of
from jaxhb.report.figures.style import plain

PANELS = {
    "stresses": ("stress", "stress", 1e-6, "MPa", {"continuous": "continuous limit", "transient": "transient limit"}),
    "tooth_torques": ("vibratory", "vibratory torque", 1.0, "N m", {"limit": "a third of the rated torque"}),
    "heat": ("power", "heat", 1.0, "W", {"limit": "limit"}),
}
"""Number of a row, its name, its factor from SI, unit, and its limits with what they are called."""

MARKED = 80
"""Speeds up to which every one is marked."""


def judged_elements(found, names=None, *, each=False):
    """What has a panel: of each kind the element with the largest share of its limit, without limits that with the
    largest number, or ``each`` of them.

    Parameters
    ----------
    found : Strength, of several speeds
    names : collection of str, optional
        Elements that are looked at; default all.
    each : bool

    Returns
    -------
    list of (kind, name)
        Kinds are the keys of ``PANELS``.
    """
    chosen = []
    for kind in PANELS:
        shares = {name: (share_of(row, kind), _largest(row, kind)) for name, row in getattr(found, kind).items()}
        shares = {name: share for name, share in shares.items() if names is None or name in names}
        chosen += [(kind, name) for name in (shares if each or not shares else [max(shares, key=shares.get)])]
    return chosen


def _largest(row, kind):
    """The largest number of a row over the speeds, 0 where none is known."""
    return float(np.nan_to_num(np.asarray(getattr(row, PANELS[kind][0]), float)).max())


def share_of(row, kind):
    """The largest share of the first limit; of a row without, or of nothing known, less than any."""
    shares = shares_of(row, kind)
    return np.nanmax(shares) if np.isfinite(shares).any() else -1.0


def shares_of(row, kind):
    """Shares of the first limit over the speeds, nan where there is none or nothing is known."""
    field, *_, limits = PANELS[kind]
    limit = getattr(row, next(iter(limits)))
    limit = np.asarray(np.nan if limit is None else limit, float)
    return np.asarray(getattr(row, field), float) / np.where(np.isfinite(limit), limit, np.nan)


def limit_figure(judged, kind, name):
    """One element against its limits, case by case; what is barred is shaded.

    Parameters
    ----------
    judged : dict
        One :class:`jaxhb.Strength` or more of the same speeds and limits, by the titles of their cases.
    kind, name : str, from :func:`judged_elements`
    """
    field, called, factor, unit, limits = PANELS[kind]
    first, traces = next(iter(judged.values())), []
    for number, (title, found) in enumerate(judged.items()):
        values = factor * np.asarray(getattr(getattr(found, kind)[name], field), float)
        said = f"{called}, {plain(title)}".removesuffix(", ")
        traces.append(line(found.rpm, values, said, number, mode="lines+markers" if len(values) <= MARKED else "lines"))
    for number, (limit, said) in enumerate(limits.items()):
        values = getattr(getattr(first, kind)[name], limit)
        if values is not None:
            traces.append(line(first.rpm, factor * np.broadcast_to(values, np.shape(first.rpm)), said, 2 + number))
            traces[-1]["line"] |= {"color": "black"}
    barred = [one for found in judged.values() for one in found.barred.get(name, ())] if kind == "stresses" else []
    shapes = bands([(one.low, one.high) for one in barred])
    panels = [(f"{called}, {unit}", top_of(*(trace["y"] for trace in traces)))]
    made = layout("speed, rpm", panels, traces, x_range=speed_range(first.rpm), heights=[180], shapes=shapes)
    shaded = "; grey: barred" + " in one of these cases" * (len(judged) > 1) if shapes else ""
    against = " against its limits" if len(traces) > len(judged) else ""
    return Figure(f"{plain(name)}: {called}{against}, {unit}{shaded}", traces, made)

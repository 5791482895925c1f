"""Panels of pictures over the speed: stresses, tooth torques and heat beside their limits, barred ranges shaded."""

import numpy as np

from jaxhb.report.figures.style import GAP, WITH, plain

PANELS = {
    "stresses": ("stress", "stress", 1e-6, "MPa", {"continuous": "continuous limit", "transient": "transient limit"}),
    "tooth_torques": ("vibratory", "vibratory torque", 1.0, "N m", {"limit": "a third of the rated torque"}),
    "heat": ("power", "heat", 1.0, "W", {"limit": "limit"}),
}
"""Number of a row, its name, its factor from SI, unit, and its limits with what they are called."""

LINES = "--", "-."
WAYS = "-", ":"


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


def draw_limits(axes, sweeps, kind, name):
    """Draw one element against its limits.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    sweeps : dict
        One :class:`jaxhb.Strength` or two, the second dotted, of the same limits; the keys are added to their names in
        the legend.
    kind, name : str, from :func:`judged_elements`
    """
    field, called, factor, unit, limits = PANELS[kind]
    first = next(iter(sweeps.values()))
    for (said, found), line in zip(sweeps.items(), WAYS, strict=False):
        row = getattr(found, kind)[name]
        values = factor * np.asarray(getattr(row, field), float)
        axes.plot(found.rpm, values, color=WITH, linestyle=line, linewidth=1.8, label=f"{called}{said}")
    for (limit, said), line in zip(limits.items(), LINES, strict=False):
        values = getattr(getattr(first, kind)[name], limit)
        if values is not None:
            values = factor * np.broadcast_to(values, np.shape(first.rpm))
            axes.plot(first.rpm, values, color="black", linestyle=line, linewidth=1.1, label=said)
    barred = [one for found in sweeps.values() for one in found.barred.get(name, ())] if kind == "stresses" else []
    for number, one in enumerate(barred):
        axes.axvspan(one.low, one.high, color=GAP, zorder=0, label=None if number else "barred")
    axes.set_ylabel(f"{called}, {unit}\n{plain(name)}")
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize="x-small", ncols=2)

"""Panels of pictures over the speed: stresses, tooth torques and heat beside their limits, barred ranges shaded."""

import numpy as np

from .plots import GAP, WITH, plain

PANELS = {
    "stresses": ("stress", "stress", 1e-6, "MPa", {"continuous": "continuous limit", "transient": "transient limit"}),
    "tooth_torques": ("vibratory", "vibratory torque", 1.0, "N m", {"limit": "a third of the rated torque"}),
    "heat": ("power", "heat", 1.0, "W", {"limit": "limit"}),
}
"""Number of a row, its name, its factor from SI, unit, and its limits with what they are called."""

LINES = "--", "-."
WAYS = "-", ":"


def judged_elements(found, names=()):
    """What has a panel: of each kind the element with the largest share of its limit, or all of those named.

    Parameters
    ----------
    found : Strength, of several speeds
    names : collection of str, optional

    Returns
    -------
    list of (kind, name)
        Kinds are the keys of ``PANELS``.
    """
    chosen = []
    for kind in PANELS:
        rows = {name: row for name, row in getattr(found, kind).items() if not names or name in names}
        kept = (
            rows if names or not rows else [max(rows, key=lambda name, rows=rows, kind=kind: _share(rows[name], kind))]
        )
        chosen += [(kind, name) for name in kept]
    return chosen


def _share(row, kind):
    """The largest share of the first limit; of a row without, or of nothing known, less than any."""
    field, *_, limits = PANELS[kind]
    limit = getattr(row, next(iter(limits)))
    shares = np.asarray(getattr(row, field), float) / (np.nan if limit is None else limit)
    return np.nanmax(shares) if np.isfinite(shares).any() else -1.0


def draw_limits(axes, sweeps, kind, name):
    """Draw one element against its limits.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    sweeps : sequence of Strength
        Of the same train and limits, the second drawn dotted.
    kind, name : str, from :func:`judged_elements`
    """
    field, called, factor, unit, limits = PANELS[kind]
    first = sweeps[0]
    for found, line in zip(sweeps, WAYS, strict=False):
        row = getattr(found, kind)[name]
        values = factor * np.asarray(getattr(row, field), float)
        axes.plot(
            found.rpm, values, color=WITH, linestyle=line, linewidth=1.8, label=called if found is first else None
        )
    for (limit, said), line in zip(limits.items(), LINES, strict=False):
        values = getattr(getattr(first, kind)[name], limit)
        if values is not None:
            values = factor * np.broadcast_to(values, np.shape(first.rpm))
            axes.plot(first.rpm, values, color="black", linestyle=line, linewidth=1.1, label=said)
    barred = [one for found in sweeps for one in found.barred.get(name, ())] if kind == "stresses" else []
    for number, one in enumerate(barred):
        axes.axvspan(one.low, one.high, color=GAP, zorder=0, label=None if number else "barred")
    axes.set_ylabel(f"{called}, {unit}\n{plain(name)}")
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize="x-small", ncols=2)

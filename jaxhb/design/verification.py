"""What a tuned design does in steady state, in the quantities that were tuned for its orbits."""

import numpy as np

from jaxhb.linear.strength import strength
from jaxhb.steady.steady_state import steady_state

SIGNALS = {
    "tooth force": "force",
    "tooth force peak": "force",
    "tooth force order": "force",
    "shaft torque": "torque",
    "shaft torque order": "torque",
    "gear torque": "gear_torque",
    "angle": "disk",
    "angle order": "disk",
}
"""Quantities of a tuning that steady states are compared in, and the readers of their signals."""

JUDGED = {
    "stress": ("stresses", "stress", None),
    "stress over continuous limit": ("stresses", "stress", "continuous"),
    "stress over transient limit": ("stresses", "stress", "transient"),
    "tooth torque over limit": ("tooth_torques", "vibratory", "limit"),
}
"""Those of a :class:`jaxhb.Strength`: its rows, their number, and the limit that divides it."""


def _steady_number(design, state, chosen):
    """A quantity of a tuning as a steady state of a design has it."""
    if chosen.quantity in JUDGED:
        kind, field, limit = JUDGED[chosen.quantity]
        row = getattr(strength(state, train=design), kind)[chosen.of]
        return getattr(row, field) / (getattr(row, limit) if limit else 1.0)
    signal = getattr(state, SIGNALS[chosen.quantity])(chosen.of)
    if chosen.order is not None:
        return signal.order(chosen.order)
    return signal.peak if chosen.quantity.endswith("peak") else signal.half_peak_to_peak


def steady_readings(design, asked):
    """Steady states of a design at the speeds of ``asked``, as of :func:`jaxhb.design.table.read_table`, and by
    Objective or Penalty, of those that they can be compared in, numbers over the speeds, nan of an unknown motion."""
    states = steady_state(design, rpm=np.asarray(asked["rpm"]), tolerance=asked.get("tolerance")).states
    compared = [c for c in (*asked["objective"], *asked["penalties"]) if c.quantity in SIGNALS | JUDGED]
    return states, {
        c: [float(_steady_number(design, state, c)) if state.known else np.nan for state in states] for c in compared
    }

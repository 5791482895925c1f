"""Does a train do what was tuned? The first and the last design of a tuning beside their steady states."""

import numpy as np

from ..design.evaluator import label
from ..linear import limits
from ..periodic.steady_state import steady_state
from .balance import plain_number
from .tables import paragraph
from .tuned import scaled_unit

APART = 0.02
"""Difference of a force, torque or angle from which the steady state is told as another motion than the orbit tuned."""

READ = {
    "tooth force": ("force", "half_peak_to_peak"),
    "tooth force peak": ("force", "peak"),
    "shaft torque": ("torque", "half_peak_to_peak"),
    "gear torque": ("gear_torque", "half_peak_to_peak"),
    "angle": ("disk", "half_peak_to_peak"),
    "tooth force order": ("force", "order"),
    "shaft torque order": ("torque", "order"),
    "angle order": ("disk", "order"),
    "stress": ("torque", "half_peak_to_peak"),
    "stress over continuous limit": ("torque", "half_peak_to_peak"),
    "stress over transient limit": ("torque", "half_peak_to_peak"),
    "tooth torque over limit": ("force", "half_peak_to_peak"),
}
"""How a steady state tells the quantities that are compared: signal and number."""

FACTORS = {
    "stress": lambda train, name, _: limits.stress_of(train, name, 1.0),
    "stress over continuous limit": lambda *where: _share_of_stress(0, *where),
    "stress over transient limit": lambda *where: _share_of_stress(1, *where),
    "tooth torque over limit": lambda train, name, _: (
        limits.first_radius(train, name) / limits.tooth_torque_limit(train, name)
    ),
}
"""By what the number has to be multiplied, from train, element and speed; 1 for the others."""

DESIGNS = {"before": "the first design", "after": "the last design"}


def check_designs(train, asked, result, say=lambda text: None):
    """What the first and the last design do at the speeds of a tuning, and where that is not what was tuned.

    Parameters
    ----------
    train : DriveTrain, as it was
    asked : dict, from :func:`jaxhb.design.table.read_table`
    result : Tuning
    say : callable, told what is done

    Returns
    -------
    dict
        ``{"before", "after"}`` of ``{"kind", "period", "readings", "differences"}``: of every speed the kind and period
        of its motion and, by label, the quantities that can be compared; a sentence for each speed at which the motion
        is neither in contact nor periodic, or a quantity more than 2 % from that of the orbit tuned.
    """
    found = {}
    for when, design, reading in (("before", train, result.before), ("after", result.train, result.after)):
        say(f"what does {DESIGNS[when]} do?")
        states = steady_state(design, rpm=np.asarray(asked["rpm"]), tolerance=asked.get("tolerance")).states
        compared = [c for c in (*asked["objective"], *asked["penalties"]) if c.quantity in READ]
        told = {label(chosen): [_reading(design, state, chosen) for state in states] for chosen in compared}
        differences = (
            _difference(state, {c: (told[label(c)][i], float(reading.readings[label(c)][i])) for c in compared})
            for i, state in enumerate(states)
        )
        found[when] = {
            "kind": [state.kind for state in states],
            "period": [state.period for state in states],
            "readings": told,
            "differences": [f"{DESIGNS[when].capitalize()} {said}" for said in differences if said],
        }
    return found


def check_text(found):
    """The sentences of :func:`check_designs`, or one that says that there is nothing to tell."""
    differences = [said for told in found.values() for said in told["differences"]]
    if not differences:
        return "Both designs do at all speeds what was tuned: their steady states are the periodic motions tuned."
    head = "Steady states that are not the periodic motions tuned"
    return "\n".join([head, *map(paragraph, differences)])


def _share_of_stress(limit, train, name, rpm):
    """Share of a stress limit that a torque of 1 N m takes."""
    return limits.stress_of(train, name, 1.0) / limits.stress_limits(train, name, rpm)[limit]


def _reading(design, state, chosen):
    """A quantity in a steady state of a design, nan where its motion is unknown."""
    if not state.known:
        return float("nan")
    signal, number = READ[chosen.quantity]
    value = getattr(getattr(state, signal)(chosen.of), number)
    factor = FACTORS[chosen.quantity](design, chosen.of, state.rpm) if chosen.quantity in FACTORS else 1.0
    return float(factor * (value(chosen.order) if number == "order" else value))


def _difference(state, pairs):
    """What a steady state does that the orbit of the tuning does not; "" for the same motion."""
    kind = {
        "subharmonic": f"has a period of {state.period} cycles",
        "irregular": "is irregular",
        "unknown": f"is not known ({'; '.join(state.notes)})",
    }.get(state.kind, "")
    apart = [
        f"{label(chosen)} {_shown(chosen, own)} instead of {_shown(chosen, tuned)}"
        for chosen, (own, tuned) in pairs.items()
        if abs(own - tuned) > APART * max(abs(own), abs(tuned))
    ]
    if not kind and not apart:
        return ""
    motion = kind or "is in another motion"
    about = f" ({'; '.join(state.notes)})" if state.known and state.notes else ""
    return f"at {state.rpm:g} rpm {motion}{': ' if apart else ''}{', '.join(apart)}{about}."


def _shown(chosen, value):
    factor, unit = scaled_unit(chosen.quantity)
    return f"{plain_number(factor * value, digits=3)} {unit}".strip()

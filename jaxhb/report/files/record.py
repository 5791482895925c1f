"""What programs read of answers: plain dictionaries, whose keys ``docs/how_to/data_and_files.md`` explains."""

import numpy as np

from jaxhb.report.quantities import ELEMENTS, number
from jaxhb.report.text.certified import certificate_record
from jaxhb.report.text.mean_torques import ground_reactions, load_torques, mean_angles_of
from jaxhb.report.text.sentences import notes, verdict
from jaxhb.report.text.strength import answers_strength, strength_entry
from jaxhb.train.plausible import plausibility

NEGLIGIBLE = 1e-12
NO_ORDERS = 0.0
"""Highest order listed where amplitudes are left out."""


def answer_record(answer, *, orders=None):
    """Everything that is reported of one speed, in SI units; ``solve --json`` writes it.

    Amplitudes are listed up to the order ``orders``, or to the last that is not below 1e-12 of the largest.

    Examples
    --------
    >>> import jaxhb
    >>> from jaxhb.report.compute import Asked, answer_one
    >>> record = answer_record(answer_one(jaxhb.load_scene("six_cylinder_diesel"), 1500.0, Asked()))
    >>> record["motion"]["kind"], record["status"], round(record["shafts"]["cyl6|flywheel"]["mean"], 1)
    ('contact', 'CONVERGED', 1046.8)
    """
    balance = answer.balance
    found = _outcome_record(answer) | {
        "load_torque_Nm": load_torques(balance),
        "ground_reaction_Nm": ground_reactions(balance),
        "mean_angles": mean_angles_of(answer.topology),
    }
    for kind, element, record in (
        ("disks", "disk", _disk_record),
        ("shafts", "shaft", _shaft_record),
        ("gears", "gear", _gear_record),
        ("meshes", "mesh", _mesh_record),
    ):
        found[kind] = {name: record(answer, name, orders) for name in ELEMENTS[element](answer.topology)}
    found |= strength_entry(answers_strength([answer]), one_speed=True)
    return found | (certificate_record(answer.certificate) if answer.certificate is not None else {})


def on_scene(train):
    """What is noted of the scene itself, once for all speeds."""
    return {"scene_notes": plausibility(train)}


def both_record(answer, orders=None):
    """The record of an answer, under ``without_backlash`` the same with all teeth in contact."""
    record = answer_record(answer, orders=orders)
    if any(answer.topology.mesh_backlash):
        record["without_backlash"] = answer_record(answer.without_backlash, orders=orders)
    return record


def cases_record(cases, *, orders=None):
    """What ``report --json`` writes: per case the records of all speeds with and without backlash."""
    rows = [
        {
            "title": case.title,
            "responses": [answer_record(answer, orders=orders) for answer in case.answers],
            "without_backlash": [answer_record(answer.without_backlash, orders=orders) for answer in case.answers],
        }
        | strength_entry(answers_strength(case.answers))
        for case in cases
    ]
    return {"rpm": [answer.rpm for answer in cases[0].answers], "cases": rows}


def _outcome_record(answer):
    solved, state = answer.response, answer.state
    numbers = "residual", "truncation_error", "power_defect"
    return {
        "scene": answer.topology.name,
        "rpm": answer.rpm,
        "motion": {
            "kind": state.kind,
            "period": state.period,
            "orbit": answer.orbit,
            "stable": answer.growth.stable,
            "multiplier": answer.growth.multiplier,
            "reason": "; ".join(state.notes) if not answer.known else None,
            "cycles": state.cycles,
            "started_from_rpm": state.started_from,
            "per_cycle": {name: {"max": answer.force(name).per_cycle.max} for name in answer.topology.mesh_names},
        },
        "converged": answer.converged,
        "harmonics": answer.harmonics,
        "load_kW": float(answer.balance.load_kW) + 0.0,
        "verdict": verdict(answer),
        "notes": notes(answer),
        "status": None if solved is None else answer.status.name,
        **{name: None if solved is None else float(getattr(solved, name)) for name in numbers},
        "path": None if solved is None else [str(event) for event in solved.path],
    }


def _signal_record(signal, orders):
    summary = signal.summary()
    return summary | {"amplitudes": _listed(summary["amplitudes"], orders)}


def _listed(rows, orders):
    """Rows up to the last that is not negligible, with three entries; order k of the cycle stays at place k - 1."""
    if orders == NO_ORDERS:
        return []
    sizes = np.array([row[1] for row in rows])
    # Not ``>``: amplitudes that are nan are listed, as None.
    counted = ~(sizes <= NEGLIGIBLE * sizes.max(initial=0.0))
    if orders is not None:
        counted &= np.array([row[0] for row in rows]) <= orders
    last = np.flatnonzero(counted)
    # A motion that does not repeat has no phases.
    return [[*row, None][:3] for row in rows[: last[-1] + 1]] if len(last) else []


def _disk_record(answer, name, orders):
    record = _signal_record(answer.disk(name), orders)
    return {key: record[key] for key in ("mean", "half_peak_to_peak", "amplitudes")} | {
        "speed": answer.speed(name).extremes(),
        "acceleration": answer.acceleration(name).extremes(),
        "irregularity": answer.irregularity(name),
    }


def _shaft_record(answer, name, orders):
    return _signal_record(answer.torque(name), orders) | {"power_W": answer.power(name)}


def _gear_record(answer, name, orders):
    return _signal_record(answer.gear_torque(name), orders)


def _mesh_record(answer, name, orders):
    force, law, details = answer.force(name), answer.law(name), answer.details.get(name)

    def of_contact(*variables):
        return {variable: number(answer, variable, name) for variable in variables}

    def impact_record(impact):
        period_deg = 360.0 * answer.response.topology.revolutions_per_cycle
        return {"theta_deg": period_deg * impact["cycle"], "speed": impact["speed"], "side": impact["side"]}

    return {
        **_signal_record(force, orders),
        "elastic": _signal_record(force.elastic, orders),
        **of_contact("separated_fraction", "reverse_contact_fraction"),
        "impacts": details and list(map(impact_record, details.impacts)),
        **of_contact("impacts_per_cycle", "hardest_impact"),
        "drive_side": answer.contacts[name].drive_side if answer.known else None,
        "gap_spring_force": law.gap_spring_force if law else 0.0,
        "knee_force": law.knee_force if law else 0.0,
        "pulling_force": details and details.pulling_force,
        "power_W": answer.power(name),
    }

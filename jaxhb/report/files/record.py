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
    """All that is reported of one speed, in SI units; amplitudes up to the order ``orders``, by default that count."""

    def of_each(element, record):
        return {name: record(name) for name in ELEMENTS[element](answer.topology)}

    def of_signal(signal):
        return _signal_record(signal, orders)

    found = _outcome_record(answer) | {
        "load_torque_Nm": load_torques(answer.balance),
        "ground_reaction_Nm": ground_reactions(answer.balance),
        "mean_angles": mean_angles_of(answer.topology),
        "disks": of_each("disk", lambda name: _disk_record(answer, name, of_signal(answer.disk(name)))),
        "shafts": of_each("shaft", lambda name: of_signal(answer.torque(name)) | {"power_W": answer.power(name)}),
        "gears": of_each("gear", lambda name: of_signal(answer.gear_torque(name))),
        "meshes": of_each("mesh", lambda name: _mesh_record(answer, name, of_signal)),
    }
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
            **strength_entry(answers_strength(case.answers)),
        }
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
    """A signal with its rows up to the last that is not negligible; order k of the cycle stays at place k - 1."""
    summary = signal.summary()
    sizes = np.array([row[1] for row in summary["amplitudes"]])
    # Not ``>``: amplitudes that are nan are listed, as None.
    counted = ~(sizes <= NEGLIGIBLE * sizes.max(initial=0.0))
    last = np.flatnonzero(counted[: sum(orders is None or row[0] <= orders for row in summary["amplitudes"])])
    rows = summary["amplitudes"][: last[-1] + 1] if len(last) else []
    # A motion that does not repeat has no phases.
    return summary | {"amplitudes": [[*row, None][:3] for row in rows]}


def _disk_record(answer, name, angle):
    return {key: angle[key] for key in ("mean", "half_peak_to_peak", "amplitudes")} | {
        "speed": answer.speed(name).extremes(),
        "acceleration": answer.acceleration(name).extremes(),
        "irregularity": answer.irregularity(name),
    }


CONTACT = "separated_fraction", "reverse_contact_fraction", "impacts_per_cycle", "hardest_impact"


def _mesh_record(answer, name, of_signal):
    force, law, details = answer.force(name), answer.law(name), answer.details.get(name)
    impacts = details and [
        {"theta_deg": answer.state.period * answer.cycle_deg * one["cycle"], "speed": one["speed"], "side": one["side"]}
        for one in details.impacts
    ]
    return {
        **of_signal(force),
        "elastic": of_signal(force.elastic),
        **{variable: number(answer, name, variable) for variable in CONTACT},
        "impacts": impacts,
        "drive_side": answer.contacts[name].drive_side if answer.known else None,
        "gap_spring_force": law.gap_spring_force if law else 0.0,
        "knee_force": law.knee_force if law else 0.0,
        "pulling_force": details and details.pulling_force,
        "power_W": answer.power(name),
    }

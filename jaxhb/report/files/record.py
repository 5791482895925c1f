"""What a program reads of an answer: one plain dictionary."""

import numpy as np

from jaxhb.report.selection import gears, shafts_of
from jaxhb.report.text.certified import certificate_record
from jaxhb.report.text.mean_torques import balance_record
from jaxhb.report.text.sentences import notes, verdict
from jaxhb.report.text.strength import strength_entry
from jaxhb.train.plausible import plausibility

NEGLIGIBLE = 1e-12
KEPT_OF_DISKS = "mean", "half_peak_to_peak", "amplitudes"
NO_ORDERS = 0.0
"""Highest order listed where amplitudes are left out."""


def answer_record(answer, *, orders=None):
    """Everything that is reported of one speed, as plain numbers in SI units; ``solve --json`` writes it.

    Parameters
    ----------
    answer : Answer
    orders : float, optional
        Highest order whose amplitude is listed; default: all.

    Returns
    -------
    dict
        ``rpm``, ``motion`` (see :func:`motion_record`), ``converged``, ``status``, ``harmonics``, ``residual``,
        ``truncation_error``, ``power_defect`` (of the harmonic solution, None without one), ``path``, ``load_kW``;
        ``load_torque_Nm`` and ``ground_reaction_Nm`` by name, ``mean_angles`` (what sets the means of the disks);
        ``disks`` (rad), ``shafts`` with the dampers (N m), ``gears`` (N m) and ``meshes`` (N) by name, each a signal
        ``{"mean", "min", "max", "rms", "half_peak_to_peak", "sum_of_amplitudes", "amplitudes"}`` (disks without min,
        max and rms). Of disks also ``speed`` (rad/s, of rotation) and ``acceleration`` (rad/s2), each with mean and
        extremes, and ``irregularity``; of shafts, dampers and meshes ``power_W``, their heat. Amplitudes are
        ``[[order, A, phase in deg], ...]`` from the first harmonic of the motion's period on. Of a motion that does not
        repeat they are the quadratic mean over its cycles, with phase None, extremes are those over the record, and
        accelerations and the heat of meshes None. The list ends where all amplitudes that follow are below 1e-12 of the
        largest. Tooth forces have eight times the harmonics of the motion. ``certificate`` where a computed bound was
        asked for. Numbers that are not finite are None.

    Examples
    --------
    >>> import jaxhb
    >>> from jaxhb.report.compute import Asked, answer_one
    >>> record = answer_record(answer_one(jaxhb.load_scene("six_cylinder_diesel"), 1500.0, Asked()))
    >>> record["motion"]["kind"], record["status"], round(record["shafts"]["cyl6|flywheel"]["mean"], 1)
    ('contact', 'CONVERGED', 1046.8)
    """
    topology = answer.topology
    names = {"shafts": shafts_of(topology), "gears": gears(topology)}
    read = {"shafts": answer.torque, "gears": answer.gear_torque}
    found = (
        _outcome_record(answer)
        | balance_record(answer.balance)
        | {"disks": {name: _disk_record(answer, name, orders) for name in topology.disk_names}}
        | {kind: {name: _signal_record(read[kind](name), orders) for name in names[kind]} for kind in names}
        | {"meshes": {name: _mesh_record(answer, name, orders) for name in topology.mesh_names}}
        | strength_entry(answer)
        | (certificate_record(answer.certificate) if answer.certificate is not None else {})
    )
    for kind in ("shafts", "meshes"):
        for name, signal in found[kind].items():
            signal["power_W"] = answer.power(name)
    return finite(found)


def on_scene(train):
    """What is noted of the scene itself, once for all speeds."""
    return {"scene_notes": plausibility(train)}


def both_record(answer, orders=None):
    """The record of an answer, under ``without_backlash`` the same with all teeth in contact."""
    record = answer_record(answer, orders=orders)
    if any(answer.topology.mesh_backlash):
        record["without_backlash"] = answer_record(answer.without_backlash, orders=orders)
    return record


def motion_record(answer):
    """What kind of motion it is.

    ``kind``, one of "contact", "periodic", "subharmonic", "irregular" and "unknown"; ``period`` in cycles, 0 where
    there is none; ``orbit``: whether it is a periodic solution that the train need not run in; ``stable`` and
    ``multiplier`` (modulus of the largest Floquet multiplier), None where they are not known; ``reason`` why the kind
    is unknown, else None; ``cycles`` marched; ``started_from_rpm``, the speed of the motion from which it was marched,
    None from teeth on their drive sides;
    ``per_cycle``: percentiles 5, 50 and 95 of the largest tooth force of a cycle, N, by mesh.
    """
    peaks = {name: answer.force(name).per_cycle.max.tolist() for name in answer.topology.mesh_names}
    return {
        "kind": answer.state.kind,
        "period": answer.state.period,
        "orbit": answer.orbit,
        "stable": answer.growth.stable,
        "multiplier": answer.growth.multiplier,
        "reason": "; ".join(answer.state.notes) if not answer.known else None,
        "cycles": answer.state.cycles,
        "started_from_rpm": answer.state.started_from,
        "per_cycle": {name: {"max": percentiles} for name, percentiles in peaks.items()},
    }


def _outcome_record(answer):
    response, solved = (
        answer.response,
        dict.fromkeys(("status", "residual", "truncation_error", "power_defect", "path")),
    )
    if response is not None:
        solved = {
            "status": answer.status.name,
            "residual": float(response.residual),
            "truncation_error": float(response.truncation_error),
            "power_defect": float(response.power_defect),
            "path": [str(event) for event in response.path],
        }
    return {
        "scene": answer.topology.name,
        "rpm": answer.rpm,
        "motion": motion_record(answer),
        "converged": answer.converged,
        "harmonics": answer.harmonics,
        "load_kW": float(answer.balance.load_kW) + 0.0,
        "verdict": verdict(answer),
        "notes": notes(answer),
    } | solved


def modes_record(modes, kinds, ratios):
    """What ``modes --json`` writes: every value is a list over the modes.

    ``{"frequencies_hz": [...], "mesh_energy_share": [...], "kinds": [...], "node_count": [...],
    "damping_ratios": [...], "generalised_mass": [...], "modes": {disk: [angle in mode 0, ...]}, "kinetic_share": {disk:
    [...]}, "strain_share": {link: [...]}}``; shares of the kinetic and of the strain energy are between 0 and 1 (all of
    the teeth together: ``mesh_energy_share``), damping ratios are those of Lehr (None: none is known), masses are in
    kg m2 for a largest angle of 1.
    """
    named = {
        "modes": (modes.names, modes.shapes),
        "kinetic_share": (modes.names, modes.kinetic_share),
        "strain_share": (modes.link_names, modes.strain_share),
    }
    listed = ("frequencies_hz", "mesh_energy_share", "node_count", "generalised_mass")
    numbers = {name: np.asarray(getattr(modes, name)).tolist() for name in listed}
    more = {"kinds": list(kinds), "damping_ratios": np.asarray(ratios).tolist()}
    columns = {key: dict(zip(names, values.T.tolist(), strict=True)) for key, (names, values) in named.items()}
    return finite(numbers | more | columns)


def finite(value):
    """The same nest of dictionaries and lists with None for every number that is not finite (JSON has no nan)."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def _signal_record(signal, orders):
    summary = signal.summary()
    return summary | {"amplitudes": _listed(summary["amplitudes"], orders)}


def _disk_record(answer, name, orders):
    record = _signal_record(answer.disk(name), orders)
    return {key: record[key] for key in KEPT_OF_DISKS} | {
        "speed": answer.speed(name).extremes(),
        "acceleration": answer.acceleration(name).extremes(),
        "irregularity": answer.irregularity(name),
    }


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


def _mesh_record(answer, name, orders):
    force, contact, law = answer.force(name), answer.contacts[name], answer.law(name)
    details = answer.details.get(name)
    return _signal_record(force, orders) | {
        "elastic": _signal_record(force.elastic, orders),
        "separated_fraction": contact.separated_fraction,
        "reverse_contact_fraction": contact.reverse_contact_fraction,
        "impacts": details and _impacts(details, 360.0 * answer.response.topology.revolutions_per_cycle),
        "impacts_per_cycle": contact.impacts_per_cycle,
        "hardest_impact": contact.hardest_impact,
        "drive_side": contact.drive_side if answer.known else None,
        "gap_spring_force": law.gap_spring_force if law else 0.0,
        "knee_force": law.knee_force if law else 0.0,
        "pulling_force": details and details.pulling_force,
    }


def _impacts(details, period_deg):
    return [
        {"theta_deg": period_deg * hit["cycle"], "speed": hit["speed"], "side": hit["side"]} for hit in details.impacts
    ]

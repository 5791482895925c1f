"""A transient for programs, see ``docs/how_to/data_and_files.md``: record of the JSON
file, signals over time of the CSV file.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxhb.report.files.numbers import on_scene
from jaxhb.report.files.output import Sheet
from jaxhb.report.text.strength import AID, LIMITED, range_record
from jaxhb.report.text.transients import transient_verdict
from jaxhb.report.transients import Passage, Peak, StressPeak, TransientReport
from jaxhb.results.quantities import VIBRATIONS, names_of
from jaxhb.transients.history import History
from jaxhb.transients.motion import Transient

TRACED = ("torque", "tooth_force")
"""Vibrating quantities of the CSV file; the NetCDF file has all."""


def transient_record(report: TransientReport) -> dict[str, Any]:
    """Report peaks and trouble of a transient, in SI units."""
    run = report.run
    topology = run.topology
    speeds = np.asarray(run.rpm)
    return on_scene(run.train) | {
        "scene": topology.name,
        "verdict": transient_verdict(report),
        "notes": list(run.notes),
        "start": report.start,
        "events": list(report.events),
        "seconds": float(run.time[-1]),
        "instants": len(run.time),
        "first_rpm": float(speeds[0]),
        "last_rpm": float(speeds[-1]),
        "lowest_rpm": float(speeds.min()),
        "highest_rpm": float(speeds.max()),
        "shafts": {
            name: _signal_record(run.torque(name)) | {"power_W": float(run.power(name))}
            for name in topology.shaft_and_damper_names
        },
        "gears": {
            name: _signal_record(run.gear_torque(name)) for name in topology.gear_names
        },
        "meshes": {name: _mesh_record(run, name) for name in topology.mesh_names},
        "strength": {
            "note": AID,
            "rated_rpm": topology.rated_rpm,
            "stresses": {
                name: _stress_record(peak) for name, peak in report.stresses.items()
            },
            **{
                kind: {
                    name: _peak_record(peak, LIMITED[kind].suffix)
                    for name, peak in peaks.items()
                }
                for kind, peaks in report.peaks.items()
            },
        },
        "passages": [_passage_record(passage) for passage in report.passages],
    }


def _signal_record(signal: History) -> dict[str, float]:
    """Record the extremes of a signal, in the sense of the scene."""
    return {
        "mean": float(signal.mean),
        "min": float(signal.min),
        "max": float(signal.max),
        "half_peak_to_peak": float(signal.half_peak_to_peak),
        "rms": float(signal.rms),
        "peak": float(signal.peak),
        "time_of_peak_s": float(signal.time_of_peak),
        "rpm_of_peak": float(signal.rpm_of_peak),
    }


def _mesh_record(run: Transient, name: str) -> dict[str, Any]:
    """Record tooth force, contact and heat of a mesh."""
    force = run.force(name)
    contact = run.mesh(name)
    return _signal_record(force) | {
        "elastic": _signal_record(force.elastic),
        "separated_s": contact.separated,
        "reverse_contact_s": contact.reverse_contact,
        "impacts": contact.impacts,
        "hardest_impact": contact.hardest_impact,
        "drive_side": contact.drive_side,
        "troubles": list(contact.troubles),
        "first_separation_s": contact.first_separation,
        "first_impact_s": contact.first_impact,
        "first_reverse_contact_s": contact.first_reverse_contact,
        "power_W": float(run.power(name)),
    }


def _stress_record(peak: StressPeak) -> dict[str, Any]:
    """Record the stress of a shaft, its limit and its damage."""
    record: dict[str, Any] = {
        "stress_Pa": peak.amplitude,
        "time_s": peak.time,
        "rpm": peak.rpm,
        "transient_Pa": peak.limit,
        "share": peak.share,
        "rule": peak.rule.name if peak.rule else None,
    }
    fatigue = peak.fatigue
    if fatigue is None:
        return record
    return record | {
        "cycles": fatigue.cycles,
        "largest_amplitude_Pa": fatigue.amplitude,
        "damage": fatigue.damage,
        "sn_source": fatigue.curve.source,
    }


def _peak_record(peak: Peak, suffix: str) -> dict[str, float]:
    """Record a number that a limit bounds at every instant."""
    return {
        f"value{suffix}": peak.value,
        f"limit{suffix}": peak.limit,
        "time_s": peak.time,
        "rpm": peak.rpm,
        "share": peak.share,
    }


def _passage_record(passage: Passage) -> dict[str, Any]:
    """Record a range of speeds and its seconds."""
    barred = passage.barred
    return {
        "low_rpm": passage.low,
        "high_rpm": passage.high,
        "seconds": passage.seconds,
        "shaft": passage.shaft or None,
        "barred": None if barred is None else range_record(barred),
    }


def transient_sheet(run: Transient) -> Sheet:
    """Torques of shafts and dampers and tooth forces over time as a table, SI units."""
    columns = {"time s": np.asarray(run.time), "rpm": np.asarray(run.rpm)}
    names = names_of(run.topology)
    for vibration in (VIBRATIONS[name] for name in TRACED):
        columns |= {
            f"{name} {vibration.called} {vibration.unit}": np.asarray(
                vibration.read(run, name).values
            )
            for name in names[vibration.element]
        }
    return Sheet(list(columns), np.transpose(list(columns.values())))

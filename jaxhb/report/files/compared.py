"""Numbers that are compared over the operating modes of an installation: of every
element those of which the largest counts. All are sizes, whose largest does not depend
on which end of a link the scene names first.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxhb._jax import Array, Numbers
from jaxhb.linear.forced import ForcedResponse
from jaxhb.linear.strength import Strength
from jaxhb.report.answer import Answer
from jaxhb.report.quantities import number
from jaxhb.report.text.forced import ElementReading
from jaxhb.report.text.strength import LIMITED, answers_strength
from jaxhb.report.transients import TransientReport
from jaxhb.results.quantities import WORKED, names_of, variables_of


@dataclass(frozen=True)
class Compared:
    """A number in its SI unit: what it is called, with its element; the ``place`` where
    it was read on the ``axis`` of the speeds or of another number; and in which case,
    as the cylinder that did not fire.
    """

    called: str
    unit: str
    value: float
    place: float
    axis: str = "rpm"
    case: str = ""

    @property
    def key(self) -> str:
        """Name and unit, which numbers that are compared with one another share."""
        return f"{self.called} {self.unit}"


def of_answers(answers: Iterable[Answer], case: str = "") -> list[Compared]:
    """Compared numbers of answers along a sweep, of those that have an answer."""
    compared = []
    for answer in answers:
        if not answer.answered:
            continue
        axis = answer.axis.label
        compared += [
            Compared(
                f"{name} {variable.csv}",
                variable.unit,
                number(answer, name, variable.name),
                answer.place,
                axis,
                case,
            )
            for element in WORKED
            for name in names_of(answer.topology)[element]
            for variable in variables_of(element)
            if variable.compared
        ]
        compared += _judged(answers_strength([answer]), [answer.place], axis, case)
    return compared


def of_forced(
    cases: Mapping[str, ForcedResponse],
    readings: Sequence[ElementReading],
    strengths: Mapping[str, Strength],
) -> list[Compared]:
    """Compared numbers of linear forced responses by the cylinder that does not fire,
    with the readings and the strength of each.
    """
    compared = []
    for case, response in cases.items():
        places = np.where(response.converged, response.rpm, np.nan)
        for reading in (each.of(response) for each in readings):
            for called, values, unit in (
                ("half peak-to-peak", reading.signal.half_peak_to_peak, reading.unit),
                ("heat", reading.power, "W"),
            ):
                compared += _over(
                    f"{reading.csv_name} {called}", unit, values, places, "rpm", case
                )
        compared += _judged(strengths[case], places, "rpm", case)
    return compared


def of_transient(report: TransientReport) -> list[Compared]:
    """Compared numbers of a transient, with the time of each."""
    run = report.run
    topology = run.topology
    peaks = [
        (f"{name} torque", "N m", run.torque(name))
        for name in topology.shaft_and_damper_names
    ]
    peaks += [
        (f"{name} tooth force", "N", run.force(name)) for name in topology.mesh_names
    ]
    compared = [
        Compared(called, unit, float(signal.peak), float(signal.time_of_peak), "s")
        for called, unit, signal in peaks
    ]
    compared += [
        Compared(f"{name} stress", "Pa", peak.amplitude, peak.time, "s")
        for name, peak in report.stresses.items()
    ]
    return compared


def of_worst(rows: Iterable[Mapping[str, Any]]) -> list[Compared]:
    """Compared numbers of the worst cases of quantities over the speeds: rows with
    ``quantity``, ``unit``, ``worst`` and ``rpm``.
    """
    return [
        Compared(row["quantity"], row["unit"], float(row["worst"]), float(row["rpm"]))
        for row in rows
    ]


def _judged(
    strength: Strength, places: Sequence[float] | Array, axis: str, case: str
) -> list[Compared]:
    """Numbers that limits judge, at places ``(n,)`` on an axis."""
    return [
        compared
        for key, limited in LIMITED.items()
        for name, row in getattr(strength, key).items()
        for compared in _over(
            f"{name} {limited.called}",
            limited.si_unit,
            getattr(row, limited.field),
            places,
            axis,
            case,
        )
    ]


def _over(
    called: str,
    unit: str,
    values: Numbers,
    places: Sequence[float] | Array,
    axis: str,
    case: str,
) -> list[Compared]:
    """One quantity at several places ``(n,)``; nan is no place."""
    values = np.broadcast_to(np.asarray(values, float), np.shape(places))
    pairs = zip(values.tolist(), np.asarray(places, float).tolist(), strict=True)
    return [
        Compared(called, unit, value, place, axis, case)
        for value, place in pairs
        if np.isfinite([value, place]).all()
    ]

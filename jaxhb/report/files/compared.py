"""Numbers that are compared over the operating modes of an installation: of every
element those of which the largest counts. All are sizes, whose largest does not depend
on which end of a link the scene names first.
"""

from dataclasses import dataclass

import numpy as np

from jaxhb.report.quantities import number, unit_of
from jaxhb.report.text.strength import LIMITED, answers_strength
from jaxhb.results.dataset import names_of


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

    key = property(
        lambda self: f"{self.called} {self.unit}",
        doc="What is compared with one another.",
    )


VARIABLES = {
    "mesh": {"peak": "tooth_force_peak"},
    "gear": {"torque half peak-to-peak": "gear_torque_half_peak_to_peak"},
    "shaft": {"torque half peak-to-peak": "torque_half_peak_to_peak", "heat": "heat"},
}
"""What is compared of every element, and its variable in data sets."""


def of_answers(answers, case=""):
    """Of :class:`jaxhb.report.answer.Answer` along a sweep, those that have an
    answer.
    """
    found = []
    for answer in (one for one in answers if one.answered):
        where = {"place": answer.place, "axis": answer.axis.label, "case": case}
        for element, variables in VARIABLES.items():
            for name in names_of(answer.topology)[element]:
                for called, variable in variables.items():
                    value = number(answer, name, variable)
                    found.append(
                        Compared(f"{name} {called}", unit_of(variable), value, **where)
                    )
        found += _judged(answers_strength([answer]), [answer.place], where)
    return found


def of_forced(cases, readings, strengths):
    """Of linear forced responses by the cylinder that does not fire, with the readings
    and the strength of each.
    """
    found = []
    for case, response in cases.items():
        places = np.where(response.converged, response.rpm, np.nan)
        for reading in (one.of(response) for one in readings):
            for called, values, unit in (
                ("half peak-to-peak", reading.signal.half_peak_to_peak, reading.unit),
                ("heat", reading.power, "W"),
            ):
                found += _over(
                    f"{reading.csv_name} {called}", unit, values, places, {"case": case}
                )
        found += _judged(strengths[case], places, {"case": case})
    return found


def of_worst(found):
    """Of the worst cases of quantities over the speeds: rows with ``quantity``,
    ``unit``, ``worst`` and ``rpm``.
    """
    return [
        Compared(row["quantity"], row["unit"], float(row["worst"]), float(row["rpm"]))
        for row in found
    ]


def _judged(strength, places, where):
    """What is judged by limits."""
    where = {key: value for key, value in where.items() if key != "place"}
    return [
        one
        for key, limited in LIMITED.items()
        for name, row in getattr(strength, key).items()
        for one in _over(
            f"{name} {limited.called}",
            limited.si_unit,
            getattr(row, limited.field),
            places,
            where,
        )
    ]


def _over(called, unit, values, places, where):
    """One quantity at several places; nan is no place."""
    values = np.broadcast_to(np.asarray(values, float), np.shape(places))
    pairs = zip(values.tolist(), np.asarray(places, float).tolist(), strict=True)
    return [
        Compared(called, unit, value, place, **where)
        for value, place in pairs
        if np.isfinite([value, place]).all()
    ]

"""The quantities of reports, one table over that of data sets: names of elements,
titles, units for people.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb.report.selection import largest, turning_disks
from jaxhb.report.text.columns import plain_number
from jaxhb.results.dataset import OF_ELEMENTS, SIGNALS, names_of as element_names
from jaxhb.results.motion import drive_sense as sense_of_motion

if TYPE_CHECKING:
    from jaxhb.report.answer import Answer, Case
    from jaxhb.train.drivetrain import DriveTrain

SHOWN_UNITS = {
    "N": (1e-3, "kN"),
    "rad": (180 / math.pi, "deg"),
    "rad/s": (30 / math.pi, "rpm"),
    "Pa": (1e-6, "MPa"),
    "1": (100.0, "%"),
}
"""Factor from an SI unit, and the unit in which people read it; other units are read as
they are.
"""

READERS = {name: reader for name, (reader, *_) in SIGNALS.items()}
READERS |= {"heat": "power", "mesh_heat": "power", "irregularity": "irregularity"}
"""Names of the readers of variables of data sets that are not of contact."""

# End of the names of variables that are those with the gaps of meshes closed
WITHOUT = "_without_backlash"


def shown_unit(unit: str) -> tuple[float, str]:
    """Return the factor from an SI unit, and the unit in which people read it."""
    return SHOWN_UNITS.get(unit, (1.0, unit))


def unit_of(variable: str) -> str:
    """Return the SI unit of a variable of a data set."""
    signal, _ = _parts(variable.removesuffix(WITHOUT))
    return (SIGNALS | OF_ELEMENTS)[signal][-2]


def drive_sense(answer: Answer, name: str) -> int:
    """Return the sign by which people read the force or torque of a link of an answer
    (:func:`jaxhb.results.motion.drive_sense`); of an unknown motion that of the linear
    one.
    """
    return sense_of_motion(answer if answer.known else answer.linear, name)


def number_for_people(answer: Answer, name: str, variable: str) -> float:
    """Read a :func:`number`, of a force or torque of a link in its
    :func:`drive_sense`.
    """
    signal, statistic = _parts(variable.removesuffix(WITHOUT))
    if statistic not in TURNED or not of_links(signal) or drive_sense(answer, name) > 0:
        return number(answer, name, variable)
    return -number(
        answer,
        name,
        variable.replace(f"{signal}_{statistic}", f"{signal}_{TURNED[statistic]}"),
    )


TURNED = {"mean": "mean", "min": "max", "max": "min"}
"""The statistic whose negative is that of the quantity with the other sign."""


def of_links(signal: str) -> bool:
    """Tell whether a signal of data sets is one of links, whose sign depends on which
    end is named first.
    """
    return SIGNALS[signal][1] in ("shaft", "mesh") if signal in SIGNALS else False


def number(motion: Any, name: str, variable: str) -> float:
    """Read a number of one element of an Answer or Response in SI by its variable in
    data sets; those of contact are known of Answers only.
    """
    if variable.endswith(WITHOUT):
        return number(motion.without_backlash, name, variable.removesuffix(WITHOUT))
    signal, statistic = _parts(variable)
    if signal not in READERS:
        return getattr(motion.contacts[name], signal)
    reading = getattr(motion, READERS[signal])(name)
    return float(getattr(reading, statistic) if statistic else reading)


def _parts(variable: str) -> tuple[str, str]:
    """Split a variable into signal and statistic; one of no signal into its name and
    "".
    """
    signal = next(
        (signal for signal in SIGNALS if variable.startswith(f"{signal}_")), variable
    )
    return signal, variable.removeprefix(signal)[1:]


@dataclass(frozen=True)
class Quantity:
    """One number of every element of a kind, by its ``variable`` in data sets:
    ``element`` heads their column, ``called`` is for sentences and files, ``title`` for
    tables and figures, ``names`` are those of the elements.
    """

    variable: str
    element: str
    called: str
    title: str
    names: tuple[str, ...]

    @property
    def unit(self) -> str:
        """The unit for people."""
        return shown_unit(unit_of(self.variable))[1]

    @property
    def factor(self) -> float:
        """The factor from SI to the unit for people."""
        return shown_unit(unit_of(self.variable))[0]

    @property
    def small_title(self) -> str:
        """The title inside a sentence."""
        return f"{self.title[0].lower()}{self.title[1:]}"

    @property
    def of_signal(self) -> bool:
        """Whether it is a number of a Signal."""
        return bool(_parts(self.variable)[1])

    def read(self, motion: Any, name: str) -> float:
        """Read the number of one element of an Answer or Response, in SI; of "" the
        largest of all.
        """
        names = [name] if name else self.names
        return max(number(motion, name, self.variable) for name in names)

    def signal(self, motion: Any, name: str) -> Any:
        """Read the Signal of an Answer or Response that it is a number of."""
        return getattr(motion, READERS[_parts(self.variable)[0]])(name)

    def signal_for_people(self, answer: Answer, motion: Any, name: str) -> Any:
        """Read the Signal of a ``motion``, in the drive sense that the link has in the
        ``answer``.
        """
        signal = self.signal(motion, name)
        turned = of_links(_parts(self.variable)[0]) and drive_sense(answer, name) < 0
        return signal.reversed() if turned else signal

    def said(self, value: float) -> str:
        """A number in SI in words for people."""
        return f"{plain_number(self.factor * value)} {self.unit}"

    def of(self, answers: Sequence[Answer], name: str) -> np.ndarray:
        """Read the number ``(n,)`` of every answer in the unit for people, nan where
        there is none to rely on.
        """
        return self.factor * np.array(
            [
                self.read(answer, name) if answer.answered else np.nan
                for answer in answers
            ],
            float,
        )

    def without(self, answers: Sequence[Answer], name: str) -> np.ndarray:
        """Read the same without backlash ``(n,)``; nan where that has not converged."""
        return self.of([answer.without_backlash for answer in answers], name)

    def spread(self, answer: Answer, name: str) -> float:
        """Return by how much the number of another record of an irregular motion would
        differ, in the unit for people; of "" that of the element with the largest
        number; 0 where that is not known.
        """
        if not self.of_signal:
            return 0.0
        element = name or self.largest(answer)
        assert element is not None  # only what is known has a spread
        spread = self.signal(answer, element).spread
        return self.factor * getattr(spread, _parts(self.variable)[1], 0.0)

    def largest(self, answer: Answer) -> str | None:
        """Find the element with the largest number at one speed; None where nothing is
        known.
        """
        return largest(self.names, lambda name: self.read(answer, name))

    def hardest(self, cases: Sequence[Case]) -> list[str]:
        """Sort the elements by their largest numbers over cases and speeds, the largest
        first.
        """
        answers = [answer for case in cases for answer in case.answers]
        most = {name: np.nanmax([-1.0, *self.of(answers, name)]) for name in self.names}
        return sorted(self.names, key=lambda name: -most[name])


def _quantity(
    element: str,
    called: str,
    title: str,
    variable: str,
    names_of: Callable[[DriveTrain], tuple[str, ...]] | None = None,
) -> Callable[[DriveTrain], Quantity]:
    """Make the function from a train to a quantity of its elements."""
    names_of = names_of or (lambda train: element_names(train.topology)[element])
    return lambda train: Quantity(variable, element, called, title, names_of(train))


IRREGULARITY = "Cyclic irregularity, (largest - smallest) / mean speed"
SWING = ", half peak-to-peak"

forces = _quantity("mesh", "tooth force", "Largest tooth force", "tooth_force_peak")
gear_torques = _quantity(
    "gear", "gear torque", f"Gear torque{SWING}", "gear_torque_half_peak_to_peak"
)
shaft_torques = _quantity(
    "shaft",
    "torque",
    f"Torque of shafts and dampers{SWING}",
    "torque_half_peak_to_peak",
)
angles = _quantity(
    "disk", "angle", f"Vibratory angle of disks{SWING}", "angle_half_peak_to_peak"
)
heat = _quantity(
    "damper",
    "heat",
    "Heat of dampers",
    "heat",
    lambda train: train.topology.damper_names,
)
separation = _quantity(
    "mesh", "teeth apart", "Time out of contact", "separated_fraction"
)
_turning = f"{IRREGULARITY}, of the heaviest disk, the gears and the loads"
irregularity = _quantity(
    "disk", "irregularity", _turning, "irregularity", turning_disks
)


def main_quantity(train: DriveTrain) -> Quantity:
    """Return the quantity that tells most of a train: tooth forces, without teeth
    torques of shafts, without these angles.
    """
    topology = train.topology
    if topology.mesh_names:
        return forces(train)
    if topology.shaft_and_damper_names:
        return shaft_torques(train)
    return angles(train)

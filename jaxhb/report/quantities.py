"""The numbers of answers as reports show them: elements, signs and units for people."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb.report.answer import largest
from jaxhb.report.selection import turning_disks
from jaxhb.report.units import said, shown_unit
from jaxhb.results.motion import drive_sense as sense_of_motion
from jaxhb.results.quantities import (
    VARIABLES,
    WITHOUT,
    Variable,
    names_of as element_names,
    read,
)

if TYPE_CHECKING:
    from jaxhb.report.answer import Answer, Case
    from jaxhb.train.drivetrain import DriveTrain


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
    entry = VARIABLES[variable.removesuffix(WITHOUT)]
    vibration = entry.vibration
    other = TURNED.get(entry.statistic)
    if (
        other is None
        or vibration is None
        or not vibration.of_link
        or drive_sense(answer, name) > 0
    ):
        return number(answer, name, variable)
    return -number(
        answer,
        name,
        variable.replace(entry.name, f"{vibration.name}_{other}"),
    )


TURNED = {"mean": "mean", "min": "max", "max": "min"}
"""The statistic whose negative is that of the quantity with the other sign."""


def number(answer: Answer, name: str, variable: str) -> float:
    """Read a number of one element of an Answer in SI by its variable in data sets."""
    if variable.endswith(WITHOUT):
        return number(answer.without_backlash, name, variable.removesuffix(WITHOUT))
    return read(answer, name, [VARIABLES[variable]])[variable]


@dataclass(frozen=True)
class Quantity:
    """A variable of data sets as reports show it: of the elements ``names``, whose
    column is headed ``element``.
    """

    variable: str
    names: tuple[str, ...]
    element: str

    @property
    def entry(self) -> Variable:
        """Its entry in the table of all numbers."""
        return VARIABLES[self.variable]

    @property
    def called(self) -> str:
        """Its name in sentences and pictures."""
        return self.entry.called

    @property
    def title(self) -> str:
        """The title of tables and figures."""
        return self.entry.title

    @property
    def unit(self) -> str:
        """The unit for people."""
        return shown_unit(self.entry.unit)[1]

    @property
    def placeholder(self) -> str:
        """Placeholder for the unit in tables."""
        return f"{{{self.entry.unit}}}"

    @property
    def factor(self) -> float:
        """The factor from SI to the unit for people."""
        return shown_unit(self.entry.unit)[0]

    @property
    def small_title(self) -> str:
        """The title inside a sentence."""
        return f"{self.title[0].lower()}{self.title[1:]}"

    @property
    def of_signal(self) -> bool:
        """Whether it is a number of a Signal."""
        return self.entry.vibration is not None

    def read(self, motion: Any, name: str) -> float:
        """Read the number of one element of an Answer or Response, in SI; of "" the
        largest of all.
        """
        names = [name] if name else self.names
        return max(number(motion, name, self.variable) for name in names)

    def signal(self, motion: Any, name: str) -> Any:
        """Read the Signal of an Answer or Response that it is a number of."""
        return getattr(motion, self.entry.reader)(name)

    def signal_for_people(self, answer: Answer, motion: Any, name: str) -> Any:
        """Read the Signal of a ``motion``, in the drive sense that the link has in the
        ``answer``.
        """
        signal = self.signal(motion, name)
        vibration = self.entry.vibration
        assert vibration is not None  # what has a signal
        turned = vibration.of_link and drive_sense(answer, name) < 0
        return signal.reversed() if turned else signal

    def said(self, value: float) -> str:
        """A number in SI in words for people."""
        return said(value, self.entry.unit)

    def numbers(self, answers: Sequence[Answer], name: str) -> np.ndarray:
        """Read the number ``(n,)`` of every answer in SI, nan where there is none to
        rely on.
        """
        return np.array(
            [
                self.read(answer, name) if answer.answered else np.nan
                for answer in answers
            ],
            float,
        )

    def of(self, answers: Sequence[Answer], name: str) -> np.ndarray:
        """Read the :meth:`numbers` in the unit for people."""
        return self.factor * self.numbers(answers, name)

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
        return self.factor * getattr(spread, self.entry.statistic, 0.0)

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
    variable: str,
    element: str = "",
    names_of: Callable[[DriveTrain], tuple[str, ...]] | None = None,
) -> Callable[[DriveTrain], Quantity]:
    """Make the function from a train to a quantity of its elements: of all that the
    variable has, or of some that are called ``element``.
    """
    kind = VARIABLES[variable].element

    def of(train: DriveTrain) -> Quantity:
        every = element_names(train.topology)[kind]
        return Quantity(
            variable, every if names_of is None else names_of(train), element or kind
        )

    return of


forces = _quantity("tooth_force_peak")
gear_torques = _quantity("gear_torque_half_peak_to_peak")
shaft_torques = _quantity("torque_half_peak_to_peak")
angles = _quantity("angle_half_peak_to_peak")
heat = _quantity("heat", "damper", lambda train: train.topology.damper_names)
separation = _quantity("separated_fraction")
irregularity = _quantity("irregularity", names_of=turning_disks)


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

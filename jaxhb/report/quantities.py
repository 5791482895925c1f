"""The quantities that reports tell, one table over that of data sets: names of
elements, titles, units for people.
"""

import math
from dataclasses import dataclass

import numpy as np

from jaxhb.report.selection import largest, turning_disks
from jaxhb.report.text.columns import plain_number
from jaxhb.results.dataset import OF_ELEMENTS, SIGNALS, names_of as element_names
from jaxhb.results.motion import drive_sense as sense_of_motion

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
"""What reads a variable of a data set that is not one of contact."""

# End of the names of variables that are those with the gaps of meshes closed
WITHOUT = "_without_backlash"


def shown_unit(unit):
    """Factor from an SI unit, and the unit in which people read it."""
    return SHOWN_UNITS.get(unit, (1.0, unit))


def unit_of(variable):
    """SI unit of a variable of a data set."""
    signal, _ = _parts(variable.removesuffix(WITHOUT))
    return (SIGNALS | OF_ELEMENTS)[signal][-2]


def drive_sense(answer, name):
    """Sign by which people read the force or torque of a link of an answer
    (:func:`jaxhb.results.motion.drive_sense`), where nothing is known that of the
    linear motion.
    """
    return sense_of_motion(answer if answer.known else answer.linear, name)


def number_for_people(answer, name, variable):
    """As :func:`number`, of a force or torque of a link in its :func:`drive_sense`."""
    signal, statistic = _parts(variable.removesuffix(WITHOUT))
    if statistic not in TURNED or not of_links(signal) or drive_sense(answer, name) > 0:
        return number(answer, name, variable)
    return -number(
        answer,
        name,
        variable.replace(f"{signal}_{statistic}", f"{signal}_{TURNED[statistic]}"),
    )


TURNED = {"mean": "mean", "min": "max", "max": "min"}
"""Of a quantity with the other sign a statistic is the negative of this one."""


def of_links(signal):
    """Whether a signal of data sets is one of links, whose sign depends on which end is
    named first.
    """
    return SIGNALS[signal][1] in ("shaft", "mesh") if signal in SIGNALS else False


def number(motion, name, variable):
    """A number of one element in SI by its variable in data sets; those of contact are
    known of Answers only.
    """
    if variable.endswith(WITHOUT):
        return number(motion.without_backlash, name, variable.removesuffix(WITHOUT))
    signal, statistic = _parts(variable)
    if signal not in READERS:
        return getattr(motion.contacts[name], signal)
    found = getattr(motion, READERS[signal])(name)
    return float(getattr(found, statistic) if statistic else found)


def _parts(variable):
    """Signal and statistic; of what is of no signal its name and ""."""
    signal = next((one for one in SIGNALS if variable.startswith(f"{one}_")), variable)
    return signal, variable.removeprefix(signal)[1:]


@dataclass(frozen=True)
class Quantity:
    """One number of every element of a kind, by its ``variable`` in data sets:
    ``element`` heads their column, ``called`` is for sentences and files, ``title`` for
    tables and figures.
    """

    variable: str
    element: str
    called: str
    title: str
    names: tuple

    unit = property(
        lambda self: shown_unit(unit_of(self.variable))[1], doc="The unit for people."
    )
    factor = property(
        lambda self: shown_unit(unit_of(self.variable))[0],
        doc="From SI to the unit for people.",
    )
    small_title = property(
        lambda self: f"{self.title[0].lower()}{self.title[1:]}",
        doc="The title inside a sentence.",
    )
    of_signal = property(
        lambda self: bool(_parts(self.variable)[1]),
        doc="Whether it is a number of a Signal.",
    )

    def read(self, motion, name):
        """The number of one element in SI, of an Answer or Response; of "" the largest
        of all.
        """
        return max(
            number(motion, one, self.variable)
            for one in ([name] if name else self.names)
        )

    def signal(self, motion, name):
        """The Signal that it is a number of."""
        return getattr(motion, READERS[_parts(self.variable)[0]])(name)

    def signal_for_people(self, answer, motion, name):
        """The same of a ``motion``, in the drive sense that the link has in the
        ``answer``.
        """
        found = self.signal(motion, name)
        turned = of_links(_parts(self.variable)[0]) and drive_sense(answer, name) < 0
        return found.reversed() if turned else found

    def said(self, value):
        """A number in SI in words for people."""
        return f"{plain_number(self.factor * value)} {self.unit}"

    def of(self, answers, name):
        """Of every answer in the unit for people, nan where there is none to rely
        on.
        """
        return self.factor * np.array(
            [self.read(a, name) if a.answered else np.nan for a in answers], float
        )

    def without(self, answers, name):
        """The same without backlash; nan where that has not converged."""
        return self.of([answer.without_backlash for answer in answers], name)

    def spread(self, answer, name):
        """By how much the number of another record of an irregular motion would differ,
        in the unit for people; of "" that of the element with the largest number; 0
        where that is not known.
        """
        if not self.of_signal:
            return 0.0
        found = self.signal(answer, name or self.largest(answer)).spread
        return self.factor * getattr(found, _parts(self.variable)[1], 0.0)

    def largest(self, answer):
        """The element with the largest number at one speed; None where nothing is
        known.
        """
        return largest(self.names, lambda name: self.read(answer, name))

    def hardest(self, cases):
        """The elements with the largest numbers over cases and speeds, the largest
        first.
        """
        answers = [answer for case in cases for answer in case.answers]
        most = {name: np.nanmax([-1.0, *self.of(answers, name)]) for name in self.names}
        return sorted(self.names, key=lambda name: -most[name])


def _told(element, called, title, variable, names_of=None):
    """The function from a train to a quantity of its elements."""
    names_of = names_of or (lambda train: element_names(train.topology)[element])
    return lambda train: Quantity(variable, element, called, title, names_of(train))


IRREGULARITY = "Cyclic irregularity, (largest - smallest) / mean speed"
SWING = ", half peak-to-peak"

forces = _told("mesh", "tooth force", "Largest tooth force", "tooth_force_peak")
gear_torques = _told(
    "gear", "gear torque", f"Gear torque{SWING}", "gear_torque_half_peak_to_peak"
)
shaft_torques = _told(
    "shaft",
    "torque",
    f"Torque of shafts and dampers{SWING}",
    "torque_half_peak_to_peak",
)
angles = _told(
    "disk", "angle", f"Vibratory angle of disks{SWING}", "angle_half_peak_to_peak"
)
heat = _told(
    "damper",
    "heat",
    "Heat of dampers",
    "heat",
    lambda train: train.topology.damper_names,
)
separation = _told("mesh", "teeth apart", "Time out of contact", "separated_fraction")
_turning = f"{IRREGULARITY}, of the heaviest disk, the gears and the loads"
irregularity = _told("disk", "irregularity", _turning, "irregularity", turning_disks)


def main_quantity(train):
    """What tells most of a train: tooth forces, without teeth torques of shafts,
    without these angles.
    """
    topology = train.topology
    return (
        forces
        if topology.mesh_names
        else shaft_torques
        if topology.shaft_and_damper_names
        else angles
    )(train)

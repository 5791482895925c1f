"""The quantities that reports tell, in one table: of which elements, how an answer is read, the unit for people."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jaxhb.report.selection import gears, largest, shafts_of, turning_disks

SHOWN_UNITS = {"N": (1e-3, "kN"), "rad": (180 / math.pi, "deg"), "Pa": (1e-6, "MPa"), "1": (100.0, "%")}
"""Factor from an SI unit, and the unit in which people read it; other units are read as they are."""


def shown_unit(unit):
    """Factor from an SI unit, and the unit in which people read it."""
    return SHOWN_UNITS.get(unit, (1.0, unit))


@dataclass(frozen=True)
class Quantity:
    """One number of every element of a kind.

    Parameters
    ----------
    element : str, what the elements are, the head of their column
    called : str, in sentences and files
    title : str, of tables and figures
    names : tuple of str, of the elements
    read : function of (Answer or Response, name) to the number in SI
    si_unit : str
    signal : function of (Answer or Response, name) to the Signal that the number is of; None where it is of none
    """

    element: str
    called: str
    title: str
    names: tuple
    read: Callable
    si_unit: str
    signal: Callable | None = None

    @property
    def unit(self):
        """The unit for people."""
        return shown_unit(self.si_unit)[1]

    @property
    def factor(self):
        """From SI to the unit for people."""
        return shown_unit(self.si_unit)[0]

    @property
    def small_title(self):
        """The title inside a sentence."""
        return f"{self.title[0].lower()}{self.title[1:]}"

    def of(self, answers, name):
        """Of every answer in the unit for people, nan where there is none to rely on."""
        return self.factor * answered(answers, lambda answer: self.read(answer, name))

    def without(self, answers, name):
        """The same without backlash; nan where that has not converged."""
        values = [float(self.read(a.linear, name)) if bool(a.linear.converged) else np.nan for a in answers]
        return self.factor * np.array(values)

    def largest(self, answer):
        """The element with the largest number at one speed; None where nothing is known."""
        return largest(self.names, lambda name: self.read(answer, name))

    def hardest(self, cases):
        """The elements with the largest numbers over cases and speeds, the largest first."""

        def most(name):
            values = np.concatenate([self.of(case.answers, name) for case in cases])
            return np.nanmax(values) if np.isfinite(values).any() else -1.0

        return sorted(self.names, key=lambda name: -most(name))


def answered(answers, read):
    """A number of every answer, nan where there is none to rely on."""
    return np.array([float(read(answer)) if answer.answered else np.nan for answer in answers])


def _swing(element, called, title, names, signal, unit):
    """Half the peak-to-peak value of a signal."""

    def read(answer, name):
        return signal(answer, name).half_peak_to_peak

    return Quantity(element, called, f"{title}, half peak-to-peak", names, read, unit, signal)


def forces(train):
    """Tooth forces."""
    names = train.topology.mesh_names

    def signal(answer, name):
        return answer.force(name)

    return Quantity("mesh", "tooth force", "Largest tooth force", names, lambda a, n: signal(a, n).peak, "N", signal)


def gear_torques(train):
    """Torques of gears."""
    names = gears(train.topology)
    return _swing("gear", "gear torque", "Gear torque", names, lambda a, name: a.gear_torque(name), "N m")


def shaft_torques(train):
    """Torques of shafts and dampers."""
    names, title = shafts_of(train.topology), "Torque of shafts and dampers"
    return _swing("shaft", "torque", title, names, lambda a, name: a.torque(name), "N m")


def angles(train):
    """Vibratory angles of disks."""
    names, title = train.topology.disk_names, "Vibratory angle of disks"
    return _swing("disk", "angle", title, names, lambda a, name: a.disk(name), "rad")


def heat(train):
    """Power that dampers turn into heat."""
    names = train.topology.damper_names
    return Quantity("damper", "heat", "Heat of dampers", names, lambda a, name: a.power(name), "W")


def separation(train):
    """Share of the time that teeth are apart."""

    def read(answer, name):
        return answer.contacts[name].separated_fraction

    return Quantity("mesh", "teeth apart", "Time out of contact", train.topology.mesh_names, read, "1")


def irregularity(train):
    """Cyclic irregularity of the disks that count."""
    title = "Cyclic irregularity, (largest - smallest) / mean speed, of the heaviest disk, the gears and the loads"
    return Quantity("disk", "irregularity", title, turning_disks(train), lambda a, name: a.irregularity(name), "1")


def main_quantity(train):
    """What tells most of a train: tooth forces, without teeth torques of shafts, without these angles."""
    topology = train.topology
    return (forces if topology.mesh_names else shaft_torques if shafts_of(topology) else angles)(train)

"""The numbers of an answer, one table: all that tables, CSV, JSON and NetCDF files hold
of a motion and of its elements. A new number is an entry of :data:`OF_ELEMENTS`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from jaxhb.results.record import NO_SPREAD, PERCENT
from jaxhb.train.topology import Topology

# End of the names of variables that are those with the gaps of meshes closed
WITHOUT = "_without_backlash"

STATISTICS = {
    "mean": "mean of the ",
    "max": "largest ",
    "min": "smallest ",
    "half_peak_to_peak": "half peak-to-peak of the ",
    "sum_of_amplitudes": "sum of the amplitudes of all orders of the ",
}
"""Statistics of signals that data sets have, and what they mean."""

CALLED = {
    "disk": "disk",
    "shaft": "shaft or damper",
    "gear": "gear",
    "mesh": "mesh",
}
"""The elements of dimensions in words."""

WORKED = ("mesh", "gear", "shaft", "disk")
"""Dimensions of the elements that vibrate: what tells most of a train comes first."""


def names_of(topology: Topology) -> dict[str, tuple[str, ...]]:
    """Names of the elements of every dimension."""
    return {
        "disk": topology.disk_names,
        "shaft": topology.shaft_and_damper_names,
        "gear": topology.gear_names,
        "mesh": topology.mesh_names,
        "load": topology.load_names,
        "ground": topology.ground_names,
    }


@dataclass(frozen=True)
class Vibration:
    """A vibrating quantity of every element of a dimension, in an SI ``unit``:
    ``reader`` is the method of a motion that gives its signal; ``labelled`` and
    ``orders`` tell whether data sets have its statistics, its amplitudes and phases.
    """

    name: str
    element: str
    unit: str
    meaning: str
    reader: str
    labelled: bool = True
    orders: bool = False

    @property
    def called(self) -> str:
        """Its name in words."""
        return self.name.replace("_", " ")

    @property
    def of_link(self) -> bool:
        """Whether it is one of a link, whose sign depends on which end is named
        first.
        """
        return self.element in ("shaft", "mesh")

    def read(self, motion: Any, name: str) -> Any:
        """Read the signal of an element of a motion."""
        return getattr(motion, self.reader)(name)


VIBRATIONS = {
    vibration.name: vibration
    for vibration in (
        # Orders of speeds and accelerations follow from those of the angles.
        Vibration("angle", "disk", "rad", "vibratory angle", "disk", orders=True),
        Vibration("speed", "disk", "rad/s", "speed of rotation", "speed"),
        Vibration(
            "acceleration", "disk", "rad/s2", "angular acceleration", "acceleration"
        ),
        Vibration(
            "torque",
            "shaft",
            "N m",
            "torque of shafts and dampers",
            "torque",
            orders=True,
        ),
        Vibration(
            "gear_torque",
            "gear",
            "N m",
            "torque that a gear passes to its mates",
            "gear_torque",
            orders=True,
        ),
        Vibration(
            "tooth_force",
            "mesh",
            "N",
            "tooth force, elastic and damping part",
            "force",
            orders=True,
        ),
        Vibration(
            "deflection",
            "mesh",
            "m",
            "deflection of the teeth",
            "deflection",
            labelled=False,
        ),
    )
}
"""All vibrating quantities by name: those of which time traces have a column."""

MEASURED = {
    name: VIBRATIONS[name] for name in ("torque", "angle", "speed", "acceleration")
}
"""Vibrating quantities that are measured."""


@dataclass(frozen=True, kw_only=True)
class Variable:
    """One number of every element of a dimension ("" : of the motion), in an SI unit.

    name : in data sets and Python; meaning : a phrase, "" where data sets do not have
    it; reader : the method of a motion that reads an element by name, of loads, grounds
    and motions an attribute of the solution, "" where it has none; part : the number of
    what that returns; vibration, statistic : of which it is the statistic, None and ""
    of others; unknown : in data sets where there is none

    json : key in the record of an element; csv : head of its column behind the name of
    the element, without the unit; without : whether CSV files have it without backlash,
    too; compared : whether operating modes are compared in it, by size. "" : not there.

    column : head in the table of its kind of element at one speed; way : how it is
    written in tables, a key of ``WAYS`` of :mod:`jaxhb.report.text.columns`, "" for a
    number in the unit for people; called, title : in sentences, in titles of tables and
    figures
    """

    name: str
    element: str = ""
    unit: str = ""
    meaning: str = ""
    reader: str = ""
    part: Callable[[Any], Any] = float
    vibration: Vibration | None = None
    statistic: str = ""
    unknown: Any = float("nan")
    json: str = ""
    csv: str = ""
    without: bool = False
    compared: bool = False
    column: str = ""
    way: str = ""
    called: str = ""
    title: str = ""

    @property
    def head(self) -> str:
        """Head of its column in CSV files, with the unit."""
        return self.csv if self.unit == "1" else f"{self.csv} {self.unit}"


def _statistic(
    name: str,
    statistic: str,
    *,
    csv: str = "",
    without: bool = False,
    compared: bool = False,
    called: str = "",
    title: str = "",
) -> Variable:
    """Make the variable of a statistic of a vibrating quantity."""
    vibration = VIBRATIONS[name]
    words = STATISTICS.get(statistic, "")
    return Variable(
        name=f"{name}_{statistic}",
        element=vibration.element,
        unit=vibration.unit,
        meaning=words and words + vibration.meaning,
        reader=vibration.reader,
        part=attrgetter(statistic),
        vibration=vibration,
        statistic=statistic,
        csv=csv,
        without=without,
        compared=compared,
        called=called,
        title=title,
    )


def _of_cycle(extreme: str, place: int) -> Variable:
    """Make the variable of a percentile of the tooth forces of a cycle."""
    percentiles = attrgetter(f"per_cycle.{extreme}")
    return Variable(
        name=f"tooth_force_{extreme}_{PERCENT[place]}",
        element="mesh",
        unit="N",
        reader="force",
        part=lambda force: percentiles(force)[place],
        vibration=VIBRATIONS["tooth_force"],
        csv=f"{extreme} of a cycle {PERCENT[place]} %",
    )


def _spread(extreme: str, name: str, meaning: str = "") -> Variable:
    """Make the variable of how far the tooth forces of other records may be off."""
    return Variable(
        name=name,
        element="mesh",
        unit="N",
        meaning=meaning,
        reader="force",
        part=lambda force: getattr(getattr(force, "spread", NO_SPREAD), extreme),
        vibration=VIBRATIONS["tooth_force"],
        csv=f"spread of {extreme}",
    )


SWING = ", half peak-to-peak"
IRREGULARITY = "Cyclic irregularity, (largest - smallest) / mean speed"

OF_SIGNALS = (
    _statistic(
        "angle",
        "half_peak_to_peak",
        called="angle",
        title=f"Vibratory angle of disks{SWING}",
    ),
    _statistic("speed", "half_peak_to_peak", csv="speed half peak-to-peak"),
    _statistic(
        "acceleration", "half_peak_to_peak", csv="acceleration half peak-to-peak"
    ),
    _statistic(
        "torque",
        "half_peak_to_peak",
        csv="torque half peak-to-peak",
        compared=True,
        called="torque",
        title=f"Torque of shafts and dampers{SWING}",
    ),
    _statistic("torque", "peak"),
    _statistic(
        "gear_torque",
        "half_peak_to_peak",
        csv="torque half peak-to-peak",
        without=True,
        compared=True,
        called="gear torque",
        title=f"Gear torque{SWING}",
    ),
    _statistic("gear_torque", "peak"),
    _statistic("tooth_force", "mean", csv="mean"),
    _statistic("tooth_force", "max", csv="max", without=True),
    _statistic("tooth_force", "min", csv="min", without=True),
    _statistic(
        "tooth_force",
        "peak",
        csv="peak",
        compared=True,
        called="tooth force",
        title="Largest tooth force",
    ),
    *(
        _of_cycle(extreme, place)
        for extreme in ("max", "peak")
        for place in range(len(PERCENT))
    ),
    _spread("max", "tooth_force_spread_of_max"),
    _spread("min", "tooth_force_spread_of_min"),
    _spread(
        "peak",
        "tooth_force_spread",
        "two standard deviations of the largest absolute tooth force over records",
    ),
)
"""Variables of signals that are not in data sets alone."""

OF_ELEMENTS = (
    Variable(
        name="irregularity",
        element="disk",
        unit="1",
        meaning="cyclic irregularity, (largest - smallest speed) / mean speed",
        reader="irregularity",
        json="irregularity",
        csv="irregularity",
        column="irregularity %",
        way="irregular",
        called="irregularity",
        title=f"{IRREGULARITY}, of the heaviest disk, the gears and the loads",
    ),
    Variable(
        name="heat",
        element="shaft",
        unit="W",
        meaning="mean power that a shaft or damper turns into heat",
        reader="power",
        json="power_W",
        csv="heat",
        compared=True,
        column="heat {W}",
        called="heat",
        title="Heat of dampers",
    ),
    Variable(
        name="mesh_heat",
        element="mesh",
        unit="W",
        meaning="mean power that the damping of a mesh turns into heat",
        reader="power",
    ),
    Variable(
        name="separated_fraction",
        element="mesh",
        unit="1",
        meaning="share of the time with the teeth separated",
        reader="mesh",
        part=attrgetter("separated_fraction"),
        json="separated_fraction",
        csv="separated fraction",
        column="separated %",
        way="percent",
        called="teeth separated",
        title="Separated time",
    ),
    Variable(
        name="reverse_contact_fraction",
        element="mesh",
        unit="1",
        meaning="share of the time on the flank that does not drive",
        reader="mesh",
        part=attrgetter("reverse_contact_fraction"),
        json="reverse_contact_fraction",
        csv="reverse fraction",
        column="reverse %",
        way="percent",
    ),
    Variable(
        name="impacts_per_cycle",
        element="mesh",
        unit="1",
        meaning="entries into contact in a cycle of the excitation",
        reader="mesh",
        part=attrgetter("impacts_per_cycle"),
        json="impacts_per_cycle",
        csv="impacts per cycle",
        column="impacts",
        way="count",
    ),
    Variable(
        name="hardest_impact",
        element="mesh",
        unit="m/s",
        meaning="largest approach speed of an impact",
        reader="mesh",
        part=attrgetter("hardest_impact"),
        json="hardest_impact",
        csv="hardest impact",
        column="hardest m/s",
        way="hit",
    ),
    Variable(
        name="load_torque",
        element="load",
        unit="N m",
        meaning="mean torque of a load on its disk",
        reader="load_torque",
        csv="load torque",
    ),
    Variable(
        name="ground_reaction",
        element="ground",
        unit="N m",
        meaning="mean torque that a ground takes",
        reader="ground_reaction",
        csv="ground reaction",
    ),
)
"""Variables of elements that are no statistics: a new one is an entry here."""

OF_MOTIONS = (
    Variable(
        name="kind",
        meaning=(
            "contact, periodic, subharmonic, irregular or unknown; solution: of"
            " jaxhb.solve"
        ),
        unknown="unknown",
    ),
    Variable(
        name="period",
        unit="1",
        meaning=(
            "period of the motion in cycles of the excitation, 0 where there is none"
        ),
        unknown=0,
    ),
    Variable(
        name="source",
        meaning="what the numbers are read from: harmonics, record, or nothing",
        unknown="nothing",
    ),
    Variable(
        name="status",
        meaning="status of the harmonic solution",
        reader="status_name",
        unknown="",
    ),
    Variable(
        name="harmonics",
        unit="1",
        meaning=(
            "highest harmonic of the motion over its period, 0 without a harmonic"
            " solution"
        ),
        reader="highest_harmonic",
        unknown=0,
    ),
    Variable(
        name="residual",
        unit="1",
        meaning="residual of the equations",
        reader="residual",
    ),
    Variable(
        name="truncation_error",
        unit="1",
        meaning="truncation error over the largest tooth force",
        reader="truncation_error",
    ),
    Variable(
        name="load_power",
        unit="W",
        meaning="power that the loads take",
        reader="load_power",
    ),
)
"""Variables of a motion as a whole."""


VARIABLES = {
    variable.name: variable
    for variable in (
        *(
            _statistic(name, statistic)
            for name, vibration in VIBRATIONS.items()
            if vibration.labelled
            for statistic in STATISTICS
        ),
        *OF_SIGNALS,
        *OF_ELEMENTS,
    )
}
"""All variables of elements by name: those of signals first, and as ``OF_SIGNALS`` has
them.
"""


def variables_of(element: str) -> list[Variable]:
    """All variables of the elements of a dimension."""
    return [variable for variable in VARIABLES.values() if variable.element == element]


def read(motion: Any, name: str, variables: Sequence[Variable]) -> dict[str, float]:
    """Read numbers of an element by the names of their variables; what several are
    parts of is read once.
    """
    readers = {variable.reader for variable in variables}
    readings = {reader: getattr(motion, reader)(name) for reader in readers}
    return {
        variable.name: float(variable.part(readings[variable.reader]))
        for variable in variables
    }

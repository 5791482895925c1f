"""What a drive train is made of, as the engineer writes it: one frozen dataclass for each ``[[table]]`` of a
scene.

The elements only hold what was written. Nothing is checked when one is made;
:func:`jaxhb.model.drivetrain.build` checks all of them together. Every numeric field carries its unit and its
allowed range, which the checks and the sentences of the errors read. Units are SI, angles at the border in
degrees.

Examples
--------
>>> from jaxhb.model.elements import Disk, Shaft
>>> parts = [Disk(name="a", inertia=1.0), Disk(name="b", inertia=2.0)]
>>> parts += [Shaft(between=("a", "b"), stiffness=1e4)]
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any


class SceneError(ValueError):
    """What is wrong with a scene or with a request to change it: one sentence a line, all of them at once."""

    def __init__(self, sentences):
        self.sentences = (sentences,) if isinstance(sentences, str) else tuple(sentences)
        super().__init__("\n".join(self.sentences))


class Unread:
    """Stands for a value that could not be read and about which a sentence has been said."""


@dataclass(frozen=True, kw_only=True)
class Range:
    """The numbers a field may take, with its unit and what to do about a number outside."""

    unit: str = ""
    above: float | None = None
    least: float | None = None
    below: float | None = None
    most: float | None = None
    remedy: str = ""

    def contains(self, value) -> bool:
        """Tell whether ``value`` (finite) lies in the range."""
        return not (
            (self.above is not None and not value > self.above)
            or (self.least is not None and not value >= self.least)
            or (self.below is not None and not value < self.below)
            or (self.most is not None and not value <= self.most)
        )

    def words(self) -> str:
        """Say the range: ``greater than 0 N m/rad``."""
        unit = f" {self.unit}" if self.unit else ""
        parts = []
        if self.above is not None:
            parts.append(f"greater than {self.above:g}{unit}")
        if self.least is not None:
            parts.append(f"at least {self.least:g}{unit}")
        if self.below is not None:
            parts.append(f"less than {self.below:g}{unit}")
        if self.most is not None:
            parts.append(f"at most {self.most:g}{unit}")
        return " and ".join(parts) or f"a finite number{f' in {self.unit}' if self.unit else ''}"


REQUIRED = dataclasses.MISSING


def _quantity(unit: str, default: Any = REQUIRED, **limits) -> Any:
    return field(default=default, metadata={"kind": "number", "range": Range(unit=unit, **limits)})


def _positive(unit: str, default: Any = REQUIRED, remedy: str = "") -> Any:
    return _quantity(unit, default, above=0.0, remedy=remedy)


def _not_negative(unit: str, default: Any = REQUIRED, remedy: str = "") -> Any:
    return _quantity(unit, default, least=0.0, remedy=remedy)


def _choice(default: str, *words: str) -> Any:
    return field(default=default, metadata={"kind": "choice", "words": (default, *words)})


def _rows(columns: tuple[str, ...], default: Any = ()) -> Any:
    return field(default=default, metadata={"kind": "rows", "columns": columns})


def _flag(default: bool) -> Any:
    return field(default=default, metadata={"kind": "flag"})


def _table(cls) -> Any:
    return field(default=None, metadata={"kind": "table", "of": cls})


def _tables(cls) -> Any:
    return field(default=None, metadata={"kind": "tables", "of": cls})


def _name(required: bool = False) -> Any:
    metadata = {"kind": "name", "required": required}
    return field(metadata=metadata) if required else field(default=None, metadata=metadata)


def _disk() -> Any:
    return field(metadata={"kind": "disk"})


def _pair() -> Any:
    return field(metadata={"kind": "pair"})


_SCALE = ("rpm", "factor")
_OVER_HZ = ("hz", "factor of stiffness", "factor of damping")
_OVER_AMPLITUDE = ("amplitude", "factor of stiffness", "factor of damping")
_HARMONICS = ("order", "Re", "Im")
_PRESSURE = ("angle", "pressure")
_STRAIGHT = "Leave the key out for a mesh that is always in contact."


@dataclass(frozen=True, kw_only=True)
class Disk:
    """``[[disk]]``: an inertia (0 is condensed exactly); with a radius it is a gear."""

    name: str = _name(required=True)
    inertia: float = _not_negative("kg m2", remedy="0 is allowed and is condensed exactly.")
    radius: float | None = _positive("m", None, "Leave the key out for a disk that is no gear.")
    teeth: int | None = field(default=None, metadata={"kind": "count", "range": Range(least=1.0)})
    damping: float = _not_negative("N m s/rad", 0.0)


@dataclass(frozen=True, kw_only=True)
class Shaft:
    """``[[shaft]]``: an elastic link between two disks of one rotor.

    ``over_hz`` = rows of (frequency in Hz, factor of stiffness, factor of damping and loss factor) and
    ``over_amplitude`` = the same over the amplitude of its vibratory twist in rad make it vary
    (:mod:`jaxhb.model.varying`); only the linear forced response takes that.
    """

    between: tuple[str, str] = _pair()
    stiffness: float = _positive("N m/rad")
    damping: float = _not_negative("N m s/rad", 0.0)
    loss_factor: float = _not_negative("", 0.0)
    over_hz: tuple = _rows(_OVER_HZ)
    over_amplitude: tuple = _rows(_OVER_AMPLITUDE)
    name: str | None = _name()


@dataclass(frozen=True, kw_only=True)
class Mesh:
    """``[[mesh]]``: the tooth contact between two gears.

    ``epsilon`` and ``transition`` are 1e-3 and 0.04 when neither they nor ``law = "fridman2009"`` (0.03 and
    0.2, the law (18) of Fridman 2009) are given.
    """

    between: tuple[str, str] = _pair()
    kind: str = _choice("external", "internal")
    stiffness: float = _positive("N/m")
    damping: float = _not_negative("N s/m", 0.0)
    damping_law: str = _choice("contact", "always")
    backlash: float | None = _positive("m", None, _STRAIGHT)
    epsilon: float | None = _quantity("", None, least=0.0, below=1.0)
    transition: float | None = _quantity("", None, above=0.0, most=1.0)
    law: str = _choice("", "fridman2009")
    name: str | None = _name()


@dataclass(frozen=True, kw_only=True)
class Damper:
    """``[[damper]]``: an inertia ring behind a viscous or rubber link; the ring is a disk of this name.

    With ``order`` it is an order-tuned absorber (a pendulum): inertia x (order x speed of its rotor)^2 adds to its
    stiffness. ``over_hz`` and ``over_amplitude`` as of a :class:`Shaft`.
    """

    name: str = _name(required=True)
    disk: str = _disk()
    inertia: float = _positive("kg m2")
    damping: float = _not_negative("N m s/rad", 0.0)
    stiffness: float = _not_negative("N m/rad", 0.0, "0 is allowed: a viscous damper.")
    loss_factor: float = _not_negative("", 0.0)
    order: float | None = _positive("", None, "Leave the key out for a damper that is not tuned to an order.")
    over_hz: tuple = _rows(_OVER_HZ)
    over_amplitude: tuple = _rows(_OVER_AMPLITUDE)


@dataclass(frozen=True, kw_only=True)
class Ground:
    """``[[ground]]``: a soft spring from a disk to the ground, which fixes the mean angle."""

    disk: str = _disk()
    stiffness: float = _positive("N m/rad")
    name: str | None = _name()


@dataclass(frozen=True, kw_only=True)
class Load:
    """``[[load]]``: the driven machine, whose torque balances the mean power of all other torques.

    ``share`` is that of its torque, on its own shaft, relative to the shares of other loads. ``harmonics`` make the
    torque pulsate, as the blades of a propeller and the pistons of a pump do: rows of (order of its own rotor, Re, Im),
    so that it is its mean x (1 + sum Re((Re + i Im) exp(i order theta))).
    """

    disk: str = _disk()
    share: float = _positive("", 1.0, "Leave out the load that takes no share.")
    harmonics: tuple = _rows(_HARMONICS)
    name: str | None = _name()


@dataclass(frozen=True, kw_only=True)
class Torque:
    """``[[torque]]``: mean + sum Re((Re + i Im) exp(i order theta)) in N m, times ``scale`` over rpm.

    With ``rated_rpm``, a speed of the reference rotor, all of it grows as (rpm / rated_rpm)^speed_exponent, 2 unless
    given: the law of propellers, fans and inertia torques.
    """

    disk: str = _disk()
    mean: float = _quantity("N m", 0.0)
    harmonics: tuple = _rows(_HARMONICS)
    orders_of: str = _choice("reference", "own")
    scale: tuple = _rows(_SCALE)
    rated_rpm: float | None = _positive("rpm", None)
    speed_exponent: float | None = _not_negative("", None)
    name: str | None = _name()


@dataclass(frozen=True, kw_only=True)
class Trace:
    """``[[cylinder.traces]]``: a pressure table, and the speed of the reference rotor and the load it holds for."""

    rpm: float = _positive("rpm")
    load: float = _not_negative("", 1.0)
    pressure: tuple = _rows(_PRESSURE, REQUIRED)
    table_firing_tdc: float | None = _quantity("deg", None)


@dataclass(frozen=True, kw_only=True)
class Combustion:
    """``[cylinder.combustion]``: the numbers of :func:`jaxhb.model.combustion.pressures`, at full load.

    Angles count from firing top dead centre. Either ``heat``, released per cycle, or ``imep``, the indicated mean
    effective pressure of the whole cycle, is given. ``exhaust_pressure`` is ``charge_pressure`` unless given.
    """

    compression_ratio: float = _quantity("", above=1.0)
    charge_pressure: float = _positive("Pa")
    exhaust_pressure: float | None = _positive("Pa", None)
    start: float = _quantity("deg", above=-180.0, below=180.0)
    duration: float = _quantity("deg", above=0.0, most=360.0)
    shape: float = _quantity("", 1.0, above=0.0, most=20.0)
    heat: float | None = _not_negative("J", None)
    imep: float | None = _quantity("Pa", None)
    compression_exponent: float = _quantity("", 1.35, above=1.0, most=5.0 / 3.0)
    expansion_exponent: float = _quantity("", 1.28, above=1.0, most=5.0 / 3.0)
    stroke_cycle: int = field(default=4, metadata={"kind": "count", "range": Range(least=1.0)})


@dataclass(frozen=True, kw_only=True)
class CrankSlider:
    """What a ``[[cylinder]]`` and an ``[engine]`` have in common: geometry, gas and what is kept of the torques."""

    bore: float | None = _positive("m", None)
    stroke: float | None = _positive("m", None)
    rod: float | None = _positive("m", None)
    reciprocating_mass: float = _not_negative("kg", 0.0)
    firing_angle: float = _quantity("deg", 0.0)
    pressure: tuple | None = _rows(_PRESSURE, None)
    table_firing_tdc: float | None = _quantity("deg", None)
    traces: tuple | None = _tables(Trace)
    combustion: Combustion | None = _table(Combustion)
    load: tuple = _rows(("rpm", "share"))
    ambient_pressure: float = _not_negative("Pa", 0.0)
    gas_torque_mean: float | None = _quantity("N m", None)
    gas_torque: tuple | None = _rows(_HARMONICS, None)
    gas_factor: float | None = _not_negative("", None, "0 is allowed: a misfire.")
    orders: float = _positive("", 12.0)
    kinematics: str = _choice("exact", "mendes2008")
    fires: bool = _flag(True)
    scale: tuple = _rows(_SCALE)
    name: str | None = _name()


@dataclass(frozen=True, kw_only=True)
class Cylinder(CrankSlider):
    """``[[cylinder]]``: the gas torque and the inertia torque of a crank-slider.

    The gas torque is computed from ``pressure`` = rows of (crank angle deg, Pa), from several such tables over speed
    and load (``traces``), or from a model (``combustion``); or it is given by ``gas_torque_mean`` and ``gas_torque`` =
    rows of (order, Re, Im) for firing at 0, orders of its own rotor.
    ``orders`` is the largest order of its own rotor that is kept of computed torques. ``ambient_pressure``
    acts on the other side of the piston. A table that goes beyond 360 deg or over more than 360 deg is that of two
    revolutions and fires at 360 deg, one within fires at 0, unless ``table_firing_tdc`` says otherwise.
    ``load`` = rows of (rpm, share of full load) says which of the ``traces`` hold, and multiplies ``heat`` or ``imep``.
    ``gas_factor`` multiplies the gas torque: the scatter from cylinder to cylinder.
    ``kinematics = "mendes2008"`` takes the piston acceleration of the inertia torque from the short series of that
    paper instead of the exact one.
    """

    disk: str = _disk()


TABLES = {
    "disk": Disk,
    "shaft": Shaft,
    "mesh": Mesh,
    "damper": Damper,
    "ground": Ground,
    "load": Load,
    "torque": Torque,
    "cylinder": Cylinder,
}


def table_of(element) -> str:
    """Name the ``[[table]]`` that describes an element: ``table_of(Disk(...)) == "disk"``."""
    return type(element).__name__.lower()

"""Elements of a drive train as the engineer writes them: one frozen dataclass for each
``[[table]]`` of a scene, with unit and range of every number.

Elements only hold what was written. Nothing is checked when one is made;
:func:`jaxhb.train.assembly.build` checks all of them together. Every numeric field
carries its unit and its allowed range, which the checks and the sentences of the errors
read. Units are SI, angles at the border in degrees.
"""

import dataclasses
import difflib
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache, reduce
from operator import ge, gt, le, lt, or_
from typing import Any

from jaxhb.elements.rules import RULES


@dataclass(frozen=True, kw_only=True)
class Range:
    """Numbers that a field may take, with their unit and the remedy for a number
    outside.
    """

    unit: str = ""
    above: float | None = None
    least: float | None = None
    below: float | None = None
    most: float | None = None
    remedy: str = ""

    def excludes(self, values: Any) -> Any:
        """Whether numbers, or arrays of them, lie outside the range; nan does not."""
        bounds = (le, self.above), (lt, self.least), (ge, self.below), (gt, self.most)
        return reduce(
            or_,
            (
                lies_beyond(values, end)
                for lies_beyond, end in bounds
                if end is not None
            ),
            False,
        )

    def words(self) -> str:
        """Say the range in words: ``greater than 0 N m/rad``."""
        unit = f" {self.unit}" if self.unit else ""
        limits = {
            "greater than": self.above,
            "at least": self.least,
            "less than": self.below,
            "at most": self.most,
        }
        parts = [
            f"{words} {limit:g}{unit}"
            for words, limit in limits.items()
            if limit is not None
        ]
        in_unit = f" in {self.unit}" if self.unit else ""
        return " and ".join(parts) or f"a finite number{in_unit}"


REQUIRED = dataclasses.MISSING


def declared(kind: str, default: Any = REQUIRED, **metadata: Any) -> Any:
    """Declare a field of an element; :mod:`jaxhb.elements.value_checks` says what each
    kind takes.
    """
    return field(default=default, metadata={"kind": kind, **metadata})


def quantity(
    unit: str, default: Any = REQUIRED, *, kind: str = "number", **limits: Any
) -> Any:
    """Declare a number in a unit, within the ``limits`` of a :class:`Range`."""
    return declared(kind, default, range=Range(unit=unit, **limits))


def positive(unit: str, default: Any = REQUIRED, remedy: str = "") -> Any:
    """Declare a number greater than 0."""
    return quantity(unit, default, above=0.0, remedy=remedy)


def not_negative(unit: str, default: Any = REQUIRED, remedy: str = "") -> Any:
    """Declare a number of at least 0."""
    return quantity(unit, default, least=0.0, remedy=remedy)


def cross_size(default: Any, *, kind: str = "number", **limits: Any) -> Any:
    """Declare a diameter or width in m, at most 5 m: larger numbers are in mm."""
    return quantity("m", default, kind=kind, most=5.0, remedy="Give it in m.", **limits)


def choice(default: str, *words: str) -> Any:
    """Declare a word out of several, the first by default."""
    return declared("choice", default, words=(default, *words))


def rows(columns: tuple[str, ...], default: Any = ()) -> Any:
    """Declare a table of numbers with these columns."""
    return declared("rows", default, columns=columns)


MOST_SENTENCES = 12  # of an error that are printed
LONGEST_SENTENCE = 1000  # characters that are printed of each
LARGEST = 1e60  # of any number, in SI units: products of five stay finite
SMALLEST = 1e-60  # of a number that is not 0: so do quotients


class SceneError(ValueError):
    """Everything wrong with a scene or with a request to change it, one sentence a
    line.

    ``sentences`` holds all; its text the first dozen and the number of the rest.
    """

    def __init__(self, sentences: str | Iterable[str]) -> None:
        self.sentences = (
            (sentences,) if isinstance(sentences, str) else tuple(sentences)
        )
        left_out = len(self.sentences) - MOST_SENTENCES
        printed = self.sentences[: MOST_SENTENCES if left_out > 1 else None]
        lines = [cut(text, LONGEST_SENTENCE) for text in printed]
        if left_out > 1:
            lines.append(f"... and {left_out} more faults.")
        super().__init__("\n".join(lines))


QUOTED = 60  # characters of a value that a sentence quotes


def shown(value: Any) -> str:
    """Write a value as a sentence quotes it, cut after :data:`QUOTED` characters."""
    # Beyond float64; and repr refuses more than 4300 digits.
    if isinstance(value, int) and value.bit_length() > 1023:
        digits = int(value.bit_length() * math.log10(2.0)) + 1
        return f"an integer of about {digits} digits"
    # Cut before it is written: a long list would be written whole.
    quoted = value[: QUOTED + 1] if isinstance(value, str | list | tuple) else value
    try:
        text = repr(quoted)
    except ValueError:
        return "a value too long to be written"
    return text if len(text) <= QUOTED + 2 else f"{text[:QUOTED]}…"


def cut(text: str, most: int = 4 * QUOTED) -> str:
    """Shorten a text that stands in a sentence without quotes, as a path or the message
    of a library.
    """
    return text if len(text) <= most else f"{text[:most]}…"


def suggestion(word: Any, choices: Iterable[str]) -> str:
    """Say what was probably meant: `` Did you mean 'stiffness'?``, or the choices where
    nothing is near.
    """
    words = list(choices)
    near = difflib.get_close_matches(
        word if isinstance(word, str) else "", words, n=1, cutoff=0.6
    )
    if near:
        return f" Did you mean {shown(near[0])}?"
    if not words:
        return ""
    listed = ", ".join(map(shown, words[:8]))
    return f" Known: {listed}{', …' if len(words) > 8 else ''}."


class Suggestions:
    """Suggest by :func:`suggestion` for the first :data:`MOST_SENTENCES` unknown words:
    each is compared with all names of a scene.
    """

    def __init__(self, choices: Iterable[str]) -> None:
        self._choices = list(choices)
        self._left = MOST_SENTENCES

    def __call__(self, word: Any) -> str:
        self._left -= 1
        return suggestion(word, self._choices) if self._left >= 0 else ""


def fields_of(element: Any) -> tuple[dataclasses.Field, ...]:
    """Declared fields of an element."""
    # Classes are hashable.
    return _fields_of_class(type(element))  # type: ignore[arg-type]


@cache
def _fields_of_class(cls: Any) -> tuple[dataclasses.Field, ...]:
    return dataclasses.fields(cls)


class Unread:
    """Placeholder for a value that could not be read and that has its sentence
    already.
    """


_SCALE = ("rpm", "factor")
_OVER_HZ = ("hz", "factor of stiffness", "factor of damping")
_OVER_AMPLITUDE = ("amplitude", "factor of stiffness", "factor of damping")
_HARMONICS = ("order", "Re", "Im")
_PRESSURE = ("angle", "pressure")
_STRAIGHT = "Leave the key out for a mesh that is always in contact."
_FORM_FACTOR = (
    "It is the factor C_K of IACS UR M68: 1 for an integral flange, 0.6 for a keyway on"
    " a taper; for a notch with stress concentration factor scf give 1.45 / scf."
)


@dataclass(frozen=True, kw_only=True)
class Disk:
    """``[[disk]]``: an inertia (0 is condensed exactly); with a radius it is a gear."""

    name: str = declared("name")
    inertia: float = not_negative(
        "kg m2", remedy="0 is allowed and is condensed exactly."
    )
    radius: float | None = positive(
        "m", None, "Leave the key out for a disk that is no gear."
    )
    teeth: int | None = quantity("", None, kind="count", least=1.0)
    damping: float = not_negative("N m s/rad", 0.0)


@dataclass(frozen=True, kw_only=True)
class Link:
    """Ways in which shafts, dampers and meshes may give their viscous damping.

    ``magnifier`` M, the dynamic magnifier, or ``damping_ratio`` D, Lehr's, holds at the
    frequency ``damping_hz`` (:func:`jaxhb.viscous_damping`).
    """

    magnifier: float | None = positive("", None)
    damping_ratio: float | None = positive("", None)
    damping_hz: float | None = positive("Hz", None)


@dataclass(frozen=True, kw_only=True)
class Spring(Link):
    """Play, stages, stops and dry friction of shafts and dampers, as clutch discs,
    dual-mass flywheels and splines have them.

    ``stiffness`` holds at small twist, or with a ``clearance``, the whole free play,
    once that is used up. ``stages`` = rows of (twist in deg, N m/rad): from that twist
    on, either way, the stiffness is this. ``stops`` = rows of (twist in deg, N m/rad):
    beyond that twist, one way, this adds to it. Twists count from the middle of the
    play, of the first disk against the second. Every change of stiffness is spread over
    4 % of twice its twist, or of the clearance. ``friction``, a torque, acts against
    the rate of twist, in proportion to it below ``slip_speed`` (0.1 rad/s).
    """

    clearance: float | None = quantity("deg", None, above=0.0, below=360.0)
    stages: tuple = rows(("twist", "stiffness"))
    stops: tuple = rows(("twist", "stiffness"))
    friction: float | None = positive("N m", None)
    slip_speed: float | None = positive("rad/s", None)


@dataclass(frozen=True, kw_only=True)
class Shaft(Spring):
    """``[[shaft]]``: an elastic link between two disks of one rotor.

    ``stiffness`` is given or follows from ``length``, ``outer`` and ``inner`` diameter
    and ``shear_modulus`` (:func:`jaxhb.shaft_stiffness`). ``over_hz`` = rows of
    (frequency in Hz, factor of stiffness, factor of damping and loss factor) and
    ``over_amplitude`` = the same over the amplitude of its vibratory twist in rad make
    it vary (:mod:`jaxhb.train.varying`); only the linear forced response takes that.
    :func:`jaxhb.strength` alone reads the rest: ``diameter`` and ``bore`` of the
    section that is judged (``outer`` and ``inner`` unless given), the factor C_K of its
    form in IACS UR M68 (``stress_concentration``, 1 for an integral flange, less for
    what concentrates stresses), the ``tensile_strength`` sigma_B, the ``rule`` whose
    limits hold (C_K is of M68 alone, ``yield_strength`` of the others), and
    ``power_limit``, the heat that it can give off.
    """

    between: tuple[str, str] = declared("pair")
    stiffness: float | None = positive("N m/rad", None, "Correct the value.")
    damping: float = not_negative("N m s/rad", 0.0)
    loss_factor: float = not_negative("", 0.0)
    over_hz: tuple = rows(_OVER_HZ)
    over_amplitude: tuple = rows(_OVER_AMPLITUDE)
    name: str | None = declared("name", None)
    length: float | None = positive("m", None)
    outer: float | None = cross_size(None, above=0.0)
    inner: float = cross_size(0.0, least=0.0)
    shear_modulus: float | None = quantity(
        "Pa", None, least=1e5, remedy="Give it in Pa: steel has about 8e10."
    )
    diameter: float | None = cross_size(None, above=0.0)
    bore: float = cross_size(0.0, least=0.0)
    stress_concentration: float | None = quantity(
        "", None, above=0.0, most=1.0, remedy=_FORM_FACTOR
    )
    tensile_strength: float | None = quantity(
        "Pa", None, least=1e8, most=5e9, remedy="Give it in Pa: 600 MPa is 6e8."
    )
    yield_strength: float | None = quantity(
        "Pa", None, least=1e8, most=5e9, remedy="Give it in Pa: 300 MPa is 3e8."
    )
    rule: str = choice(*RULES)
    power_limit: float | None = positive("W", None)


@dataclass(frozen=True, kw_only=True)
class Mesh(Link):
    """``[[mesh]]``: the tooth contact between two gears.

    ``epsilon`` and ``transition`` that are not given follow from the smallest mean
    force F of the mesh at the speeds at which the scene gives torques, when the train
    is built: with C = stiffness x backlash / 2 epsilon is 0.04 F / C within 1e-4 and
    1e-3, and transition 0.2 F / C - epsilon within 0.004 and 0.04, so that full
    stiffness begins below a fifth of F. ``law = "fridman2009"`` is 0.03 and 0.2, the
    law (18) of Fridman 2009. ``rated_torque`` is that of its first gear;
    :func:`jaxhb.strength` reads it.

    Over the mesh period, of angle psi, 0 at t = 0, ``stiffness_orders`` = rows of
    (order, Re, Im) make the stiffness its mean x (1 + sum Re((Re + i Im) exp(i order
    (psi + phase)))). ``transmission_error``, likewise a sum in m, is how far the gears
    must approach each other for the teeth to touch; ``first_gear_error`` and
    ``second_gear_error`` are the same by orders of the own revolution of a gear
    (runout, pitch errors). The mesh period needs ``teeth`` of a gear. Shorthands, of
    which the first ``orders`` are kept, are in ``jaxhb.elements.meshing``:
    ``stiffness_table`` = rows of (share of the mesh period, N/m), which also gives the
    mean; ``contact_ratio``; and instead of a stiffness the face ``width`` and the
    ``helix`` angle at the pitch circle, for standard steel gears.
    """

    between: tuple[str, str] = declared("pair")
    kind: str = choice("external", "internal")
    stiffness: float | None = positive("N/m", None, "Correct the value.")
    damping: float = not_negative("N s/m", 0.0)
    damping_law: str = choice("contact", "always")
    backlash: float | None = positive("m", None, _STRAIGHT)
    epsilon: float | None = quantity("", None, least=0.0, below=1.0)
    transition: float | None = quantity("", None, above=0.0, most=1.0)
    law: str = choice("", "fridman2009")
    rated_torque: float | None = positive("N m", None)
    stiffness_orders: tuple = rows(_HARMONICS)
    transmission_error: tuple = rows(_HARMONICS)
    first_gear_error: tuple = rows(_HARMONICS)
    second_gear_error: tuple = rows(_HARMONICS)
    phase: float = quantity("deg", 0.0)
    stiffness_table: tuple = rows(("share", "stiffness"))
    contact_ratio: float | None = quantity(
        "", None, kind="shorthand", least=1.0, most=4.0
    )
    width: float | None = cross_size(None, kind="shorthand", above=0.0)
    helix: float = quantity("deg", 0.0, kind="shorthand", above=-45.0, below=45.0)
    orders: int = quantity("", 4, kind="count", least=1.0)
    name: str | None = declared("name", None)


OF_PERIOD = ("stiffness_orders", "transmission_error")
OF_GEARS = ("first_gear_error", "second_gear_error")
"""Names of the rows of a mesh by orders of its mesh period, and by orders of the
revolutions of its first and of its second gear.
"""


@dataclass(frozen=True, kw_only=True)
class Damper(Spring):
    """``[[damper]]``: an inertia ring behind a viscous or rubber link; the ring is a
    disk of this name.

    With ``order`` it is an order-tuned absorber (a pendulum): inertia x (order x speed
    of its rotor)^2 adds to its stiffness. ``over_hz``, ``over_amplitude`` and
    ``power_limit`` as of a :class:`Shaft`.
    """

    name: str = declared("name")
    disk: str = declared("disk")
    inertia: float = positive("kg m2")
    damping: float = not_negative("N m s/rad", 0.0)
    stiffness: float = not_negative("N m/rad", 0.0, "0 is allowed: a viscous damper.")
    loss_factor: float = not_negative("", 0.0)
    order: float | None = positive(
        "", None, "Leave the key out for a damper that is not tuned to an order."
    )
    over_hz: tuple = rows(_OVER_HZ)
    over_amplitude: tuple = rows(_OVER_AMPLITUDE)
    power_limit: float | None = positive("W", None)


@dataclass(frozen=True, kw_only=True)
class Ground:
    """``[[ground]]``: a soft spring from a disk to the ground, which fixes the mean
    angle.
    """

    disk: str = declared("disk")
    stiffness: float = positive("N m/rad")
    name: str | None = declared("name", None)


@dataclass(frozen=True, kw_only=True)
class Load:
    """``[[load]]``: the driven machine, whose torque balances the mean power of all
    other torques.

    ``share`` is that of its torque, on its own shaft, relative to the shares of other
    loads. ``harmonics`` make the torque pulsate, as the blades of a propeller and the
    pistons of a pump do: rows of (order of its own rotor, Re, Im), so that it is its
    mean x (1 + sum Re((Re + i Im) exp(i order theta))).
    """

    disk: str = declared("disk")
    share: float = positive("", 1.0, "Leave out the load that takes no share.")
    harmonics: tuple = rows(_HARMONICS)
    name: str | None = declared("name", None)


@dataclass(frozen=True, kw_only=True)
class Torque:
    """``[[torque]]``: mean + sum Re((Re + i Im) exp(i order theta)) in N m, times
    ``scale`` over rpm.

    With ``rated_rpm``, a speed of the reference rotor, all of it grows as (rpm /
    rated_rpm)^speed_exponent, 2 unless given: the law of propellers, fans and inertia
    torques.
    """

    disk: str = declared("disk")
    mean: float = quantity("N m", 0.0)
    harmonics: tuple = rows(_HARMONICS)
    orders_of: str = choice("reference", "own")
    scale: tuple = rows(_SCALE)
    rated_rpm: float | None = positive("rpm", None)
    speed_exponent: float | None = not_negative("", None)
    name: str | None = declared("name", None)


@dataclass(frozen=True, kw_only=True)
class Trace:
    """``[[cylinder.traces]]``: a pressure table, and the speed of the reference rotor
    and the load (share of the mean effective pressure at full load) it holds for.
    """

    rpm: float = positive("rpm")
    load: float = not_negative("", 1.0)
    pressure: tuple = rows(_PRESSURE, REQUIRED)
    table_firing_tdc: float | None = quantity("deg", None)


@dataclass(frozen=True, kw_only=True)
class Combustion:
    """``[cylinder.combustion]``: the numbers of :mod:`jaxhb.excitation.combustion`, at
    full load.

    Angles count from firing top dead centre. Either ``heat``, released per cycle, or
    ``imep``, the indicated mean effective pressure of the whole cycle, is given.
    ``exhaust_pressure`` is ``charge_pressure`` unless given. ``charge_over_load`` =
    rows of (load, factor) or ``charge_over_rpm`` = rows of (rpm, factor) multiply both
    pressures, linear between the rows and constant outside them; without either what
    they have above the atmosphere grows with the power.
    """

    compression_ratio: float = quantity("", above=1.0)
    charge_pressure: float = positive("Pa")
    exhaust_pressure: float | None = positive("Pa", None)
    start: float = quantity("deg", above=-180.0, below=180.0)
    duration: float = quantity("deg", above=0.0, most=360.0)
    shape: float = quantity("", 1.0, above=0.0, most=20.0)
    heat: float | None = not_negative("J", None)
    imep: float | None = quantity("Pa", None)
    compression_exponent: float = quantity("", 1.35, above=1.0, most=5.0 / 3.0)
    expansion_exponent: float = quantity("", 1.28, above=1.0, most=5.0 / 3.0)
    charge_over_load: tuple = rows(("load", "factor"))
    charge_over_rpm: tuple = rows(_SCALE)
    stroke_cycle: int = quantity("", 4, kind="count", least=1.0)


@dataclass(frozen=True, kw_only=True)
class CrankSlider:
    """Geometry, gas and orders of the torques that a ``[[cylinder]]`` and an
    ``[engine]`` share.
    """

    bore: float | None = positive("m", None)
    stroke: float | None = positive("m", None)
    rod: float | None = positive("m", None)
    reciprocating_mass: float = not_negative("kg", 0.0)
    firing_angle: float = quantity("deg", 0.0)
    pressure: tuple | None = rows(_PRESSURE, None)
    table_firing_tdc: float | None = quantity("deg", None)
    traces: tuple | None = declared("tables", None, of=Trace)
    combustion: Combustion | None = declared("table", None, of=Combustion)
    load: tuple = rows(("rpm", "load"))
    ambient_pressure: float = not_negative("Pa", 0.0)
    gas_torque_mean: float | None = quantity("N m", None)
    gas_torque: tuple | None = rows(_HARMONICS, None)
    gas_factor: float | None = not_negative(
        "", None, "0 is allowed: no gas torque at all."
    )
    injection: float | None = not_negative("", None, "0 is allowed: a misfire.")
    orders: float | None = positive("", None)
    kinematics: str = choice("exact", "mendes2008")
    fires: bool = declared("flag", True)
    fires_every: int = quantity("", 1, kind="count", least=1.0, most=100.0)
    scale: tuple = rows(_SCALE)
    name: str | None = declared("name", None)


@dataclass(frozen=True, kw_only=True)
class Cylinder(CrankSlider):
    """``[[cylinder]]``: the gas torque and the inertia torque of a crank-slider.

    The gas torque is computed from ``pressure`` = rows of (crank angle deg, Pa), from
    several such tables over speed and load (``traces``), or from a model
    (``combustion``); or it is given by ``gas_torque_mean`` and ``gas_torque`` = rows of
    (order, Re, Im) for firing at 0, orders of its own rotor. ``orders`` is the largest
    order of its own rotor that is kept of computed torques, 12 unless given, of a
    two-stroke 15, up to which rules ask for orders. ``ambient_pressure`` acts on the
    other side of the piston. A table that goes beyond 360 deg or over more than 360 deg
    is that of two revolutions and fires at 360 deg, one within fires at 0, unless
    ``table_firing_tdc`` says otherwise. ``load`` = rows of (rpm, load) says which of
    the ``traces`` hold, and multiplies ``heat`` or ``imep``. A load is a share of the
    mean effective pressure at full load, and so of torque, not of power. ``gas_factor``
    multiplies the gas torque: the scatter from cylinder to cylinder. ``injection``
    multiplies what combustion adds to the pressure of compression alone: with 0, as
    with ``fires = false``, the cylinder misfires. With ``fires_every = 2`` it is
    injected in every second of its engine cycles, and compresses alone in the others.
    ``kinematics = "mendes2008"`` takes the piston acceleration of the inertia torque
    from the short series of that paper instead of the exact one.
    """

    disk: str = declared("disk")


@dataclass(frozen=True, kw_only=True)
class Phase:
    """``[[phase]]``: how far one engine is turned against the rest of the train, as its
    clutch happened to close.

    All that the cylinders and torques in ``of`` excite comes later by ``angle``,
    counted on their rotor, which must be one. ``of`` names cylinders and torques; a
    name as "port" stands for "port 1", "port 2" and so on, the cylinders of the engine
    of that name.
    """

    name: str = declared("name")
    of: tuple = declared("list")
    angle: float = quantity("deg", 0.0)


@dataclass(frozen=True, kw_only=True)
class Head:
    """``[scene]``: settings of the whole train; ``notes`` are texts that every check
    and report repeats.
    """

    name: str | None = declared("name", None)
    description: str | None = declared("name", None)
    notes: tuple = declared("list", ())
    revolutions_per_cycle: float = positive("", 2.0)
    reference: str | None = declared("disk", None)
    rated_rpm: float | None = positive("rpm", None)


def table_of(element: Any) -> str:
    """Name the ``[[table]]`` that describes an element: ``table_of(Disk(...)) ==
    "disk"``.
    """
    return type(element).__name__.lower()


TABLES: dict[str, Any] = {
    cls.__name__.lower(): cls
    for cls in (Disk, Shaft, Mesh, Damper, Ground, Load, Torque, Cylinder, Phase)
}


def facts_of(
    element: Any, before: str = ""
) -> dict[str, tuple[Any, dataclasses.Field]]:
    """Everything a scene says of an element: value and declared field by name, as
    "stiffness", "combustion.start" or "traces no. 1.rpm"; None where a scene may be
    silent and is.
    """
    facts: dict = {}
    for declared in dataclasses.fields(element):
        value = getattr(element, declared.name)
        name = before + declared.name
        if dataclasses.is_dataclass(value):
            facts |= facts_of(value, f"{name}.")
        elif declared.metadata["kind"] == "tables":
            for k, inner in enumerate(value or ()):
                facts |= facts_of(inner, f"{name} no. {k + 1}.")
        elif declared.name != "name":
            if declared.metadata["kind"] == "rows" and value is not None:
                value = tuple(map(tuple, value))
            elif declared.metadata["kind"] == "pair":
                value = ", ".join(value)
            facts[name] = (value, declared)
    return facts


def unit_of(declared: dataclasses.Field) -> str:
    """SI unit of a declared field, "" without one."""
    span = declared.metadata.get("range")
    return span.unit if span else ""

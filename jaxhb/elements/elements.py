"""Elements of a drive train as the engineer writes them: one frozen dataclass for each
``[[table]]`` of a scene, with unit and range of every number.

Elements only hold what was written. Nothing is checked when one is made;
:func:`jaxhb.train.assembly.build` checks all of them together. Every numeric field
carries its unit and its allowed range, which the checks and the sentences of the errors
read. Units are SI, angles at the border in degrees.
"""

from dataclasses import dataclass
from typing import Any

from jaxhb.elements.declared import (
    BLADE_ORDERS,
    DAMPING_OVER_RPM,
    HARMONICS,
    OVER_AMPLITUDE,
    OVER_HZ,
    OVER_RPM,
    OVER_TEMPERATURE,
    SN_CURVE,
    STIFFNESS_OVER_RPM,
    TWISTS,
    choice,
    cross_size,
    declared,
    not_negative,
    positive,
    quantity,
    rows,
    table_name,
)
from jaxhb.elements.events import Event
from jaxhb.elements.excitations import EXCITATIONS

_STRAIGHT = "Leave the key out for a mesh that is always in contact."
_ARCHER_FACTOR = (
    "Archer's chart over pitch and blade area has these, 30 is usual; give another"
    " damping as damping_over_rpm of the disk."
)
_FORM_FACTOR = (
    "It is the factor C_K of IACS UR M68: 1 for an integral flange, 0.6 for a keyway on"
    " a taper; for a notch with stress concentration factor scf give 1.45 / scf."
)


@dataclass(frozen=True, kw_only=True)
class Disk:
    """``[[disk]]``: an inertia (0 is condensed exactly); with a radius it is a gear.

    ``damping_over_rpm`` = rows of (rpm of the reference rotor, N m s/rad), in the place
    of ``damping``, linear between the rows and constant outside, as of a propeller.
    Other elements have such rows of their damping and stiffness as well
    (:mod:`jaxhb.train.varying`). ``gd2``, the flywheel effect of makers' sheets, stands
    in the place of ``inertia``, which is a quarter of it. ``part`` names the catalogue
    part, and its file, from which the reader of a scene took keys
    (``jaxhb.scene.parts``). Limits, which :func:`jaxhb.strength` alone reads:
    ``angle_limit`` of half of the peak-to-peak vibratory angle,
    ``speed_irregularity_limit`` of (largest - smallest) / mean speed, and
    ``acceleration_limit`` of half of the peak-to-peak angular acceleration.
    """

    name: str = declared("name")
    inertia: float | None = not_negative(
        "kg m2", None, remedy="0 is allowed and is condensed exactly."
    )
    gd2: float | None = quantity(
        "kg m2", None, kind="shorthand", weight=True, least=0.0
    )
    radius: float | None = positive(
        "m", None, "Leave the key out for a disk that is no gear."
    )
    teeth: int | None = quantity("", None, kind="count", least=1.0)
    damping: float = not_negative("N m s/rad", 0.0)
    damping_over_rpm: tuple = rows(DAMPING_OVER_RPM)
    angle_limit: float | None = positive("deg", None)
    speed_irregularity_limit: float | None = quantity(
        "", None, above=0.0, most=2.0, remedy="Give a share: 1/250 is 0.004."
    )
    acceleration_limit: float | None = positive("rad/s2", None)
    part: str | None = declared("text", None)


@dataclass(frozen=True, kw_only=True)
class Link:
    """Ways in which shafts, dampers and meshes may give their viscous damping.

    ``magnifier`` M, the dynamic magnifier, or ``damping_ratio`` D, Lehr's, holds at the
    frequency ``damping_hz`` (:func:`jaxhb.viscous_damping`). ``damping_over_rpm`` and
    ``stiffness_over_rpm`` = rows of (rpm of the reference rotor, value in the unit of
    the number) give damping and stiffness over the speed.
    """

    damping_over_rpm: tuple = rows(DAMPING_OVER_RPM)
    stiffness_over_rpm: tuple = rows(STIFFNESS_OVER_RPM)

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

    Catalogues of rubber couplings give the ``relative_damping`` psi, the work lost in a
    cycle over the elastic energy at its amplitude: a loss factor psi / (2 pi), or with
    ``damping_hz`` the viscous damping that loses as much there.
    ``over_temperature`` = rows of (deg C, factor of stiffness and of its stages, factor
    of damping and loss factor) are taken at ``temperature``, by default that of the
    scene, when the train is built. A damping that is a share of the stiffness has both
    factors. With ``surface``, ``heat_transfer`` and ``ambient``, its temperature in
    :func:`jaxhb.heat_balance` is that at which it gives off its heat, and ``ambient``
    stands for a temperature that is not given. ``stiffness_over_hz`` and
    ``damping_over_hz`` = rows of (Hz, value) give what ``over_hz`` gives as factors;
    the number is then the largest of its rows. ``stiffness_over_torque`` = rows of
    (mean torque in N m, dynamic stiffness in N m/rad) of progressive couplings stand
    for the stiffness and the stages that have the stiffness of each row at its torque.
    ``part`` as of a :class:`Disk`.
    """

    clearance: float | None = quantity("deg", None, above=0.0, below=360.0)
    stages: tuple = rows(TWISTS)
    stops: tuple = rows(TWISTS)
    friction: float | None = positive("N m", None)
    slip_speed: float | None = positive("rad/s", None)
    relative_damping: float | None = positive("", None)
    temperature: float | None = quantity("deg C", None, least=-100.0, most=500.0)
    over_temperature: tuple = rows(OVER_TEMPERATURE)
    surface: float | None = positive("m2", None)
    heat_transfer: float | None = positive("W/(m2 K)", None)
    ambient: float | None = quantity("deg C", None, least=-100.0, most=500.0)
    stiffness_over_torque: tuple = rows(("mean torque", "stiffness"))
    stiffness_over_hz: tuple = rows(("hz", "stiffness"))
    damping_over_hz: tuple = rows(("hz", "damping"))
    part: str | None = declared("text", None)


@dataclass(frozen=True, kw_only=True)
class Rated(Spring):
    """Limits that catalogues give couplings and dampers; :func:`jaxhb.strength` alone
    reads them.

    ``nominal_torque`` T_KN bounds the mean torque, ``vibratory_torque`` T_KW half of
    its peak-to-peak in continuous running, ``maximum_torque`` T_Kmax the largest torque
    at any instant, also of transients, ``power_limit`` the heat that it can give off,
    and ``speed_limit`` the speed of its own rotor in rpm.
    """

    nominal_torque: float | None = positive("N m", None)
    vibratory_torque: float | None = positive("N m", None)
    maximum_torque: float | None = positive("N m", None)
    power_limit: float | None = positive("W", None)
    speed_limit: float | None = positive("rpm", None)


@dataclass(frozen=True, kw_only=True)
class Shaft(Rated):
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
    limits hold (C_K is of M68 alone, ``yield_strength`` of the others). Of a
    crankshaft, the stress concentration factors for torsion ``fillet_factor`` and
    ``oil_bore_factor`` of IACS UR M53 (alpha_T or beta_T, and gamma_T) times the
    nominal alternating stress must not exceed ``alternating_limit``, which the user
    answers for. Of transients alone, ``sn_curve`` = rows of (cycles, amplitude of the
    nominal torsional stress in Pa that it bears so often), from the standard or test
    that ``sn_source`` names.
    """

    between: tuple[str, str] = declared("pair")
    stiffness: float | None = positive("N m/rad", None, "Correct the value.")
    damping: float = not_negative("N m s/rad", 0.0)
    loss_factor: float = not_negative("", 0.0)
    over_hz: tuple = rows(OVER_HZ)
    over_amplitude: tuple = rows(OVER_AMPLITUDE)
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
    rule: str | None = declared("text", None)
    fillet_factor: float | None = positive("", None)
    oil_bore_factor: float | None = positive("", None)
    alternating_limit: float | None = quantity(
        "Pa", None, least=1e5, remedy="Give it in Pa: 60 MPa is 6e7."
    )
    sn_curve: tuple = rows(SN_CURVE)
    sn_source: str | None = declared("text", None)


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
    stiffness_orders: tuple = rows(HARMONICS)
    transmission_error: tuple = rows(HARMONICS, unit="m")
    first_gear_error: tuple = rows(HARMONICS, unit="m")
    second_gear_error: tuple = rows(HARMONICS, unit="m")
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
class Damper(Rated):
    """``[[damper]]``: an inertia ring behind a viscous or rubber link; the ring is a
    disk of this name.

    With ``order`` it is an order-tuned absorber (a pendulum): inertia x (order x speed
    of its rotor)^2 adds to its stiffness. ``over_hz`` and ``over_amplitude`` as of a
    :class:`Shaft`.
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
    over_hz: tuple = rows(OVER_HZ)
    over_amplitude: tuple = rows(OVER_AMPLITUDE)


@dataclass(frozen=True, kw_only=True)
class Ground:
    """``[[ground]]``: a soft spring from a disk to the ground, which fixes the mean
    angle.

    ``stiffness_over_rpm`` as of other elements.
    """

    disk: str = declared("disk")
    stiffness: float | None = positive("N m/rad", None, "Correct the value.")
    stiffness_over_rpm: tuple = rows(STIFFNESS_OVER_RPM)
    name: str | None = declared("name", None)


LOAD_LAWS = ("constant", "propeller", "generator")
"""Laws of a load over the speed."""


@dataclass(frozen=True, kw_only=True)
class Load:
    """``[[load]]``: the driven machine, whose torque balances the mean power of all
    other torques.

    ``share`` is that of its torque, on its own shaft, relative to the shares of other
    loads. ``harmonics`` make the torque pulsate, as the blades of a propeller and the
    pistons of a pump do: rows of (order of its own rotor, Re, Im), so that it is its
    mean x (1 + sum Re((Re + i Im) exp(i order theta))). Instead of these, ``blades``
    and ``blade_orders`` = rows of (multiple, share, phase deg) make it its mean x (1 +
    sum share cos(multiple x blades x theta + phase)).

    Transients with a free speed read the law of its torque over the speed n of the
    reference rotor: with ``law`` and ``rated_torque`` T at ``rated_rpm`` N it takes T
    ("constant"), T (n / N)^2 ("propeller") or T n / N ("generator": a resistive load at
    constant excitation); with ``over_rpm``, rows of (rpm, N m), what lies between these
    linearly, constant outside. Torques are those on its own shaft, without sign: it
    brakes.

    ``archer`` a, beside the law "propeller", gives its disk Archer's damping of
    propellers, ``c = a M / n`` in N m s/rad with the torque M in N m that the law has
    at the speed n of its own shaft in rpm: proportional to the speed
    (``jaxhb.train.varying.archer_damping``).
    """

    disk: str = declared("disk")
    share: float = positive("", 1.0, "Leave out the load that takes no share.")
    harmonics: tuple = rows(HARMONICS)
    blades: int | None = quantity("", None, kind="count", least=1.0, most=1000.0)
    blade_orders: tuple = rows(BLADE_ORDERS)
    law: str = choice("", *LOAD_LAWS)
    rated_torque: float | None = positive("N m", None)
    rated_rpm: float | None = positive("rpm", None)
    over_rpm: tuple = rows(OVER_RPM)
    archer: float | None = quantity(
        "", None, least=20.0, most=40.0, remedy=_ARCHER_FACTOR
    )
    name: str | None = declared("name", None)


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


TACHOMETER = 0.01
"""Tolerance of the tachometer as a share of the rated speed, unless it is given."""


@dataclass(frozen=True, kw_only=True)
class Head:
    """``[scene]``: settings of the whole train; ``notes`` are texts that every check
    and report repeats; ``temperature`` is that of elements with ``over_temperature``
    that have none of their own.

    ``rules`` chooses rules by name and files with rules of the user; the first one of
    shafts judges those that name none. ``tachometer_tolerance``, a share of the rated
    speed, widens barred ranges, and ``operating_rpm`` = [lowest, highest] are the
    speeds over which separation margins are judged.
    """

    name: str | None = declared("name", None)
    description: str | None = declared("name", None)
    notes: tuple = declared("list", ())
    revolutions_per_cycle: float = positive("", 2.0)
    reference: str | None = declared("disk", None)
    rated_rpm: float | None = positive("rpm", None)
    rules: tuple = declared("list", ())
    tachometer_tolerance: float = quantity("", TACHOMETER, least=0.0, most=0.1)
    operating_rpm: tuple = declared("list", (), unit="rpm")
    temperature: float | None = quantity("deg C", None, least=-100.0, most=500.0)


TABLES: dict[str, Any] = {
    table_name(cls): cls
    for cls in (
        *(Disk, Shaft, Mesh, Damper, Ground, Load),
        *(kind.element for kind in EXCITATIONS.values()),
        Phase,
        Event,
    )
}

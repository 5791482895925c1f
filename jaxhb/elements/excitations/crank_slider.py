"""Cylinders as the engineer writes them: their keys, where the gas torque comes from,
and the checks of both.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from jaxhb.elements.declared import (
    HARMONICS,
    PRESSURE,
    REQUIRED,
    SCALE,
    Unread,
    choice,
    declared,
    not_negative,
    positive,
    quantity,
    rows,
)
from jaxhb.elements.excitations.tangential import (
    TangentialPressure,
    revolutions,
    tangential_errors,
)
from jaxhb.elements.values import exactly_one, number_like, row_errors, several_given
from jaxhb.excitation import gas
from jaxhb.excitation.tables import COMPUTED, LOADED, TANGENTIAL


@dataclass(frozen=True, kw_only=True)
class Trace:
    """``[[cylinder.traces]]``: a pressure table, and the speed of the reference rotor
    and the load (share of the mean effective pressure at full load) it holds for.
    """

    rpm: float = positive("rpm")
    load: float = not_negative("", 1.0)
    pressure: tuple = rows(PRESSURE, REQUIRED)
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
    they have above the atmosphere grows with the power. ``charge_pressure_over_load`` =
    rows of (load, Pa) stands for the charge pressure of its last row and these factors.
    """

    compression_ratio: float = quantity("", above=1.0)
    charge_pressure: float | None = positive("Pa", None)
    exhaust_pressure: float | None = positive("Pa", None)
    start: float = quantity("deg", above=-180.0, below=180.0)
    duration: float = quantity("deg", above=0.0, most=360.0)
    shape: float = quantity("", 1.0, above=0.0, most=20.0)
    heat: float | None = not_negative("J", None)
    imep: float | None = quantity("Pa", None)
    compression_exponent: float = quantity("", 1.35, above=1.0, most=5.0 / 3.0)
    expansion_exponent: float = quantity("", 1.28, above=1.0, most=5.0 / 3.0)
    charge_pressure_over_load: tuple = rows(("load", "pressure"))
    charge_over_load: tuple = rows(("load", "factor"))
    charge_over_rpm: tuple = rows(SCALE)
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
    pressure: tuple | None = rows(PRESSURE, None)
    table_firing_tdc: float | None = quantity("deg", None)
    traces: tuple | None = declared("tables", None, of=Trace)
    combustion: Combustion | None = declared("table", None, of=Combustion)
    tangential_pressure: TangentialPressure | None = declared(
        "table", None, of=TangentialPressure
    )
    load: tuple = rows(("rpm", "load"))
    ambient_pressure: float = not_negative("Pa", 0.0)
    gas_torque_mean: float | None = quantity("N m", None)
    gas_torque: tuple | None = rows(HARMONICS, None, unit="N m")
    gas_factor: float | None = not_negative(
        "", None, "0 is allowed: no gas torque at all."
    )
    injection: float | None = not_negative("", None, "0 is allowed: a misfire.")
    orders: float | None = positive("", None)
    kinematics: str = choice("exact", "mendes2008")
    fires: bool = declared("flag", True)
    fires_every: int = quantity("", 1, kind="count", least=1.0, most=100.0)
    scale: tuple = rows(SCALE)
    name: str | None = declared("name", None)


@dataclass(frozen=True, kw_only=True)
class Cylinder(CrankSlider):
    """``[[cylinder]]``: the gas torque and the inertia torque of a crank-slider.

    The gas torque is computed from ``pressure`` = rows of (crank angle deg, Pa), from
    several such tables over speed and load (``traces``), or from a model
    (``combustion``); or it is given by a table of the engine maker
    (``tangential_pressure``), or by ``gas_torque_mean`` and ``gas_torque`` = rows of
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


def source(cylinder: CrankSlider) -> str | None:
    """Name the field that the gas torque of a cylinder is computed from, None where it
    is not computed.
    """
    return next((key for key in COMPUTED if getattr(cylinder, key)), None)


def source_word(cylinder: CrankSlider) -> str:
    """Name the :func:`source` as a word: "tangential_pressure" of such a table,
    "harmonics" of a prescribed gas torque, "none" where there is none.
    """
    if cylinder.tangential_pressure is not None:
        return TANGENTIAL
    prescribed = cylinder.gas_torque is not None or cylinder.gas_torque_mean is not None
    return source(cylinder) or ("harmonics" if prescribed else "none")


def with_charge(combustion: Combustion) -> Combustion:
    """A sound combustion with charge pressure and factors in the place of rows of
    pressures.
    """
    pressures = combustion.charge_pressure_over_load
    if not pressures:
        return combustion
    full = pressures[-1][1]
    return dataclasses.replace(
        combustion,
        charge_pressure=full,
        charge_over_load=tuple((load, pressure / full) for load, pressure in pressures),
        charge_pressure_over_load=(),
    )


def gas_revolutions(cylinder: CrankSlider) -> int:
    """Revolutions of the crank in a gas cycle of a cylinder, 1 where its gas torque is
    given by harmonics.
    """
    if cylinder.tangential_pressure is not None:
        return revolutions(cylinder.tangential_pressure)
    if source(cylinder) == "combustion" and cylinder.combustion is not None:
        return int(cylinder.combustion.stroke_cycle) // 2
    rows = cylinder.pressure or (
        cylinder.traces[0].pressure if cylinder.traces else None
    )
    return 2 if rows and gas.is_four_stroke(rows) else 1


def cylinder_errors(cylinder: Cylinder) -> list[str]:
    """Check that a cylinder has one source of its gas torque and the numbers that this
    source needs.
    """
    computed = [key for key in COMPUTED if getattr(cylinder, key) is not None]
    has_torque = cylinder.gas_torque is not None or cylinder.gas_torque_mean is not None
    has_table = cylinder.tangential_pressure is not None
    sources = computed + [TANGENTIAL] * has_table + ["gas_torque"] * has_torque
    errors = several_given(sources)
    if cylinder.fires is True and not sources:
        errors.append(
            "neither pressure nor gas_torque is given. Give one of them, or set fires ="
            " false."
        )
    needed_keys = []
    moves = number_like(cylinder.reciprocating_mass) and cylinder.reciprocating_mass > 0
    reason = computed[0] if computed else "reciprocating_mass"
    if computed:
        needed_keys = ["bore", "stroke", "rod"]
    elif has_table:
        reason = TANGENTIAL
        needed_keys = ["bore", "stroke", "rod"] if moves else ["bore", "stroke"]
    elif moves:
        needed_keys = ["stroke", "rod"]
    missing = [key for key in needed_keys if getattr(cylinder, key) is None]
    errors += [
        f"the key {key!r} is missing; {reason} needs it. Give it in m."
        for key in missing
    ]
    if (
        number_like(cylinder.rod)
        and number_like(cylinder.stroke)
        and cylinder.rod <= cylinder.stroke / 2
    ):
        errors.append(
            f"rod is {cylinder.rod:g} m, must be longer than half the stroke"
            f" ({cylinder.stroke / 2:g} m). Correct rod or stroke."
        )
    if cylinder.load and not set(LOADED) & set(sources):
        errors.append(
            "load is given without traces, combustion or tangential_pressure, which it"
            " acts on. Give scale instead."
        )
    if number_like(cylinder.fires_every) and cylinder.fires_every > 1 and not computed:
        reason = (
            "only pressure, traces and combustion tell what a cycle without injection"
            " does"
        )
        errors.append(
            f"fires_every is {cylinder.fires_every:g}, but {reason}. Give gas_torque"
            " with orders of its own."
        )
    errors += (
        _trace_errors(cylinder.traces)
        if isinstance(cylinder.traces, tuple | list)
        else []
    )
    if isinstance(cylinder.tangential_pressure, TangentialPressure):
        errors += tangential_errors(
            cylinder.tangential_pressure,
            ambient=bool(cylinder.ambient_pressure),
            injected=cylinder.fires and cylinder.injection in (None, 1.0),
        )
    return errors + (
        _combustion_errors(cylinder.combustion)
        if isinstance(cylinder.combustion, Combustion)
        else []
    )


def _trace_errors(traces: Sequence[Any]) -> list[str]:
    """Check that traces stand once at every pair of their speeds and loads, and have
    the same gas cycle.
    """
    traces = [trace for trace in traces if isinstance(trace, Trace)]
    if not all(number_like(trace.rpm) and number_like(trace.load) for trace in traces):
        return []
    count = Counter((float(trace.rpm), float(trace.load)) for trace in traces)
    errors = [
        f"traces: {times} of them are for {rpm:g} rpm and load {load:g}. Keep one."
        for (rpm, load), times in count.items()
        if times > 1
    ]
    speeds = {rpm for rpm, _ in count}
    loads = {load for _, load in count}
    lacking = sorted({(rpm, load) for rpm in speeds for load in loads} - set(count))
    if lacking:
        rpm, load = lacking[0]
        errors.append(
            f"traces: there is none for {rpm:g} rpm and load {load:g}, but for this"
            " speed and for this load: every speed needs all loads. Add it; for one"
            " load curve leave out load."
        )
    tables = [
        trace.pressure for trace in traces if not isinstance(trace.pressure, Unread)
    ]
    sound = all(
        not row_errors("pressure", ("angle", "pressure"), rows) for rows in tables
    )
    if sound and len({gas.is_four_stroke(rows) for rows in tables}) > 1:
        errors.append(
            "traces: some span 720 deg, some 360 deg. Give one gas cycle, the same for"
            " all."
        )
    return errors


def _combustion_errors(combustion: Combustion) -> list[str]:
    """Check that either the heat or the mean pressure is given, and the strokes of a
    cycle.
    """
    tables = ("charge_pressure_over_load", "charge_over_load", "charge_over_rpm")
    errors = exactly_one(combustion, "heat", "imep")
    errors += several_given([name for name in tables if getattr(combustion, name)])
    errors += exactly_one(combustion, "charge_pressure", "charge_pressure_over_load")
    for name, columns in (
        ("charge_pressure_over_load", ("load", "pressure")),
        ("charge_over_load", ("load", "factor")),
        ("charge_over_rpm", ("rpm", "factor")),
    ):
        table = getattr(combustion, name)
        least_factor = (
            None
            if row_errors(name, columns, table)
            else min((row[1] for row in table), default=1.0)
        )
        if least_factor is not None and least_factor <= 0.0:
            errors.append(
                f"the least {columns[1]} of {name} is {least_factor:g},"
                " must be greater than 0. Correct it."
            )
    if number_like(combustion.stroke_cycle) and combustion.stroke_cycle not in (2, 4):
        errors.append(
            f"stroke_cycle is {combustion.stroke_cycle:g}, must be 2 or 4. Correct it."
        )
    return [f"combustion: {text}" for text in errors]

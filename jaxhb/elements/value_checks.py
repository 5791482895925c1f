"""Checks of several keys of an element together: ways to define a link, what stress
limits need, laws of meshes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from jaxhb.elements.declared import OVER_RPM, SN_CURVE, fields_of, unit_of
from jaxhb.elements.derived import COOLING, OVER_HZ, SHARES
from jaxhb.elements.elements import (
    LOAD_LAWS,
    OF_PERIOD,
    Damper,
    Disk,
    Ground,
    Load,
    Mesh,
    Shaft,
)
from jaxhb.elements.events import event_errors
from jaxhb.elements.excitations import EXCITATIONS
from jaxhb.elements.excitations.blades import blade_errors
from jaxhb.elements.rules import Rule
from jaxhb.elements.rules.chosen import STRENGTH_KEYS, lacking
from jaxhb.elements.sentences import shown
from jaxhb.elements.values import (
    is_present,
    joined,
    number_like,
    plain_number,
    row_errors,
    several_given,
)


def over_rpm_errors(name: str, rows: Any, *, least_is_excluded: bool) -> list[str]:
    """Check rows (rpm, value) of a damping or stiffness over the speed, ``name``;
    nothing where they are absent, or no rows of numbers.

    least_is_excluded : whether a value of 0 is refused, too.
    """
    quantity = name.removesuffix("_over_rpm")
    if not is_present(rows) or row_errors(name, ("rpm", quantity), rows):
        return []
    if len(rows) < 2:
        return [
            f"{name} has 1 row, needs at least 2. Give the constant as {quantity}, or"
            " another row."
        ]
    words = "greater than 0" if least_is_excluded else "at least 0"
    return [
        f"{name}, row {i}: {quantity} is {value:g}, must be {words}. Correct the row."
        for i, (_, value) in enumerate(rows, 1)
        if value < 0.0 or least_is_excluded and value == 0.0
    ]


def _over_rpm_errors(element: Any) -> list[str]:
    """Check the rows over the speed of an element."""
    # A ring may have no spring.
    excluded = {"damping_over_rpm": False}
    excluded["stiffness_over_rpm"] = not isinstance(element, Damper)
    return [
        text
        for name, least_is_excluded in excluded.items()
        for text in over_rpm_errors(
            name, getattr(element, name, ()), least_is_excluded=least_is_excluded
        )
    ]


def _twice_errors(element: Any, name: str, *others: str) -> list[str]:
    """Check that rows over the speed, ``name``, do not stand beside ``others``."""
    constants = present_keys(element, *others)
    if not (is_present(getattr(element, name)) and constants):
        return []
    return [f"{name} is given together with {joined(constants)}. Keep one of them."]


def disk_errors(disk: Disk) -> list[str]:
    """Check that a disk has one inertia and one damping."""
    texts = _over_rpm_errors(disk) + _twice_errors(disk, "damping_over_rpm", "damping")
    if disk.inertia is None and disk.gd2 is None:
        texts.append(
            "the key 'inertia' is missing. Give at least 0 kg m2, or gd2, four times"
            " as much."
        )
    present = [key for key in ("inertia", "gd2") if getattr(disk, key) is not None]
    return texts + several_given(present)


def ground_errors(ground: Ground) -> list[str]:
    """Check that a ground has one stiffness."""
    if ground.stiffness is None and not is_present(ground.stiffness_over_rpm):
        return [
            "the key 'stiffness' is missing. Give greater than 0 N m/rad, or"
            " stiffness_over_rpm."
        ]
    doubled = _twice_errors(ground, "stiffness_over_rpm", "stiffness")
    return _over_rpm_errors(ground) + doubled


def shaft_errors(shaft: Shaft) -> list[str]:
    """Check that a shaft has one stiffness and one damping, and that its stages and
    limits have all they need.
    """
    return (
        _stiffness_errors(shaft)
        + _damping_errors(shaft)
        + _over_rpm_errors(shaft)
        + _section_errors(shaft)
        + _concentration_errors(shaft)
        + _rated_errors(shaft)
        + _curve_errors(shaft)
        + _spring_errors(shaft)
        + _temperature_errors(shaft)
        + _over_hz_errors(shaft)
    )


def _temperature_errors(link: Shaft | Damper) -> list[str]:
    """Check that a link with numbers over the temperature has one, and the other way
    round.
    """
    cooling = [key for key in COOLING if getattr(link, key) is not None]
    lacking = [key for key in COOLING if getattr(link, key) is None]
    if cooling and not is_present(link.over_temperature):
        lacking.append("over_temperature")
    if cooling and lacking:
        return [
            f"{joined(cooling)} {'ask' if len(cooling) > 1 else 'asks'} for a balance"
            f" of heat, without {joined(lacking)}. Give all of these, or none."
        ]
    if not is_present(link.over_temperature):
        if link.temperature is None:
            return []
        return [
            "temperature is given without over_temperature, and changes nothing. Give"
            " the rows, or leave it out."
        ]
    texts = []
    if link.temperature is None and not cooling:
        texts.append(
            "over_temperature is given without temperature. Give it in deg C, here or"
            " in [scene]."
        )
    for name in ("stiffness_over_rpm", "damping_over_rpm"):
        texts += _twice_errors(link, name, "over_temperature")
    return texts


def _over_torque_errors(link: Shaft | Damper) -> list[str]:
    """Check the stiffness of a link over the mean torque, and that it has no other."""
    name = "stiffness_over_torque"
    rows = link.stiffness_over_torque
    constants = ("stiffness", "length", "stiffness_over_rpm", "stiffness_over_hz")
    springs = ("stages", "clearance", "over_hz", "over_amplitude", "order", "surface")
    texts = _twice_errors(link, name, *constants)
    texts += _twice_errors(link, name, *(key for key in springs if hasattr(link, key)))
    if not is_present(rows) or row_errors(name, ("mean torque", "stiffness"), rows):
        return texts
    return texts + [
        f"{name}, row {i}: it has {torque:g} N m and {stiffness:g} N m/rad, must have"
        " at least 0 N m and more than 0 N m/rad. Correct the row."
        for i, (torque, stiffness) in enumerate(rows, 1)
        if torque < 0.0 or stiffness <= 0.0
    ]


def _over_hz_errors(link: Shaft | Damper) -> list[str]:
    """Check that a link with numbers over the frequency has each of them once, and one
    that is greater than 0.
    """
    rivals = {
        "stiffness_over_hz": ("over_hz", "stiffness", "length", "stiffness_over_rpm"),
        "damping_over_hz": (
            "over_hz",
            "damping",
            "loss_factor",
            *("relative_damping", "damping_over_rpm"),
        ),
    }
    texts = _over_torque_errors(link)
    for name, keys in rivals.items():
        rows = getattr(link, name)
        texts += _twice_errors(link, name, *keys, "magnifier", "damping_ratio")
        if link.damping_hz is not None and link.relative_damping is not None:
            texts += _twice_errors(link, name, "damping_hz")
        columns = ("hz", name.removesuffix("_over_hz"))
        if not is_present(rows) or row_errors(name, columns, rows):
            continue
        if max(value for _, value in rows) <= 0.0:
            texts.append(f"{name} is 0 in all rows. Give one that is greater than 0.")
    return texts


def _spring_errors(link: Shaft | Damper) -> list[str]:
    """Check play, stages and stops of a shaft or damper."""
    columns = ("twist", "stiffness")
    texts = []
    sound_tables = [
        name
        for name in ("stages", "stops")
        if not row_errors(name, columns, getattr(link, name))
    ]
    play = link.clearance / 2 if plain_number(link.clearance) else 0.0
    allowed = {
        "stages": ("greater than 0 deg", "at least 0"),
        "stops": ("other than 0 deg", "greater than 0"),
    }
    for name, i, (twist, stiffness) in (
        (table, i, row)
        for table in sound_tables
        for i, row in enumerate(getattr(link, table), 1)
    ):
        where = f"{name}, row {i}"
        (twists, least_stiffness) = allowed[name]
        if twist == 0.0 or (name == "stages" and twist < 0.0):
            texts.append(
                f"{where}: twist is {twist:g} deg, must be {twists}. Stiffness at rest"
                " has its own key."
            )
        elif abs(twist) <= play:
            texts.append(
                f"{where}: twist {twist:g} deg lies in the play, {play:g} deg either"
                " way. Correct one of them."
            )
        if stiffness < 0.0 or (name == "stops" and stiffness == 0.0):
            texts.append(
                f"{where}: stiffness is {stiffness:g} N m/rad, must be"
                f" {least_stiffness}. Correct the row."
            )
    springless = link.stiffness == 0 and not is_present(link.stiffness_over_rpm)
    if link.clearance is not None and springless:
        texts.append(
            "clearance is given, and stiffness is 0. Give the stiffness once the play"
            " is used up."
        )
    if link.slip_speed is not None and link.friction is None:
        texts.append(
            "slip_speed is given without friction. Give the friction torque in N m, or"
            " leave it out."
        )
    springs = [
        key
        for key in ("clearance", "stages", "stops", "friction")
        if is_present(getattr(link, key))
    ]
    varying_keys = [
        key
        for key in ("over_hz", *OVER_HZ, "over_amplitude", "order", "surface")
        if is_present(getattr(link, key, None))
    ]
    if springs and varying_keys:
        texts.append(
            f"{springs[0]} is given together with {varying_keys[0]}, which only linear"
            " links have. Keep one of them."
        )
    return texts


def mesh_errors(mesh: Mesh) -> list[str]:
    """Check the numbers of the law of a mesh, its orders, and that it has one
    damping.
    """
    texts = _damping_errors(mesh) + _over_rpm_errors(mesh)
    law_keys = [
        key for key in ("epsilon", "transition") if getattr(mesh, key) is not None
    ]
    if mesh.law and law_keys:
        texts.append(
            f"law = {shown(mesh.law)} is given together with {' and '.join(law_keys)}."
            " Keep one of them."
        )
    sound_tables = [
        name
        for name in OF_PERIOD
        if not row_errors(name, ("order", "Re", "Im"), getattr(mesh, name))
    ]
    texts += [
        f"{name}, row {i}: order {row[0]:g} of the mesh period must be a whole number."
        " Give what repeats with the revolution of a gear as first_gear_error or"
        " second_gear_error."
        for name in sound_tables
        for i, row in enumerate(getattr(mesh, name), 1)
        if row[0] != int(row[0])
    ]
    texts += _shorthand_errors(mesh)
    return texts + (
        stiffness_errors(mesh.stiffness_orders)
        if "stiffness_orders" in sound_tables
        else []
    )


def _shorthand_errors(mesh: Mesh) -> list[str]:
    """Check that a mesh has one stiffness, and one way to its orders."""
    stiffness_keys = [
        key
        for key in ("stiffness", "stiffness_over_rpm", "stiffness_table", "width")
        if is_present(getattr(mesh, key))
    ]
    order_keys = [
        key
        for key in ("stiffness_orders", "stiffness_table", "contact_ratio")
        if getattr(mesh, key)
    ]
    doubled = [keys for keys in (stiffness_keys, order_keys) if keys[1:]]
    texts = [
        f"{first} is given together with {joined(rest)}. Keep one of them."
        for first, *rest in doubled
    ]
    if not stiffness_keys:
        texts.append(
            "the key 'stiffness' is missing. Give greater than 0 N/m, a"
            " stiffness_table, or the width in m."
        )
    if number_like(mesh.helix) and mesh.helix and mesh.width is None:
        texts.append(
            f"helix = {mesh.helix:g} deg is given without width. Give the face width in"
            " m, or leave it out."
        )
    if mesh.width is not None and mesh.kind == "internal":
        texts.append(
            "width gives the stiffness of external gears alone. Give the stiffness in"
            " N/m."
        )
    table = mesh.stiffness_table
    if not table or row_errors("stiffness_table", ("share", "stiffness"), table):
        return texts
    (first, first_stiffness) = table[0]
    (last, last_stiffness) = table[-1]
    (lowest_at, lowest) = min(table, key=lambda row: row[1])
    if lowest <= 0.0:
        texts.append(
            f"stiffness_table: the stiffness is {lowest:g} N/m at {lowest_at:g}, must"
            " be greater than 0. Correct it."
        )
    if first < 0.0 or last > 1.0 or len(table) < 2:
        span = f"{len(table)} rows from {first:g} to {last:g}"
        texts.append(
            f"stiffness_table has {span}, must have at least 2 from 0 to 1, shares of"
            " the mesh period."
        )
    elif last == 1.0 and (first > 0.0 or first_stiffness != last_stiffness):
        at_0 = "none" if first > 0.0 else f"{first_stiffness:g} N/m"
        texts.append(
            f"stiffness_table is not periodic: it has {at_0} at 0 and"
            f" {last_stiffness:g} N/m at 1. Give both, equal, or leave out the row at"
            " 1."
        )
    return texts


def stiffness_errors(rows: Sequence[tuple[float, float, float]]) -> list[str]:
    """Check that a stiffness stays above 0 all over the mesh period."""
    angle = np.linspace(0.0, 2 * np.pi, 720, endpoint=False)
    shares = 1.0 + sum(
        re * np.cos(order * angle) - im * np.sin(order * angle)
        for order, re, im in rows
    )
    if np.min(shares) > 0.0:
        return []
    return [
        f"stiffness_orders make the stiffness {np.min(shares):.3g} of its mean at"
        f" {np.argmin(shares) / 2:g} deg of the mesh period, must be greater than 0."
        " Correct the rows: they are shares of the mean."
    ]


def damper_errors(damper: Damper) -> list[str]:
    """Check that a damper's ring is held by something, and that it has one damping."""
    errors = _over_rpm_errors(damper)
    errors += _twice_errors(damper, "stiffness_over_rpm", "stiffness")
    errors += _rated_errors(damper)
    errors += _temperature_errors(damper) + _over_hz_errors(damper)
    tables = (
        damper.stiffness_over_rpm,
        damper.damping_over_rpm,
        damper.stiffness_over_hz,
        damper.damping_over_hz,
        damper.stiffness_over_torque,
    )
    if damper.stiffness != 0 or damper.damping != 0 or any(map(is_present, tables)):
        return _damping_errors(damper) + errors + _spring_errors(damper)
    damping_keys = present_keys(damper, *SHARES)
    if damping_keys:
        needs = (
            "needs a stiffness greater than 0 N m/rad, of which the damping is a share"
        )
        return [
            f"{damping_keys[0]} {needs}. Give a stiffness, or the damping in N m s/rad."
        ]
    if damper.order is None:
        return [
            "damping and stiffness are both 0, so that the ring is loose. Give at least"
            " one of them."
        ]
    return _damping_errors(damper)


def present_keys(element: Any, *keys: str) -> list[str]:
    """``key = value unit`` of each of the ``keys`` that an element can have and has,
    other than as 0.
    """
    texts = []
    for key in keys:
        value = getattr(element, key, None)
        if is_present(value) and not (number_like(value) and value == 0):
            unit = next(
                unit_of(field) for field in fields_of(element) if field.name == key
            )
            texts.append(
                f"{key} = {value:g} {unit}".rstrip() if plain_number(value) else key
            )
    return texts


def _stiffness_errors(shaft: Shaft) -> list[str]:
    """Check that a shaft has a stiffness, or dimensions that give one."""
    sizes = present_keys(shaft, "length", "outer", "inner", "shear_modulus")
    if is_present(shaft.stiffness_over_hz) or is_present(shaft.stiffness_over_torque):
        return []  # its own check tells what stands beside it
    if is_present(shaft.stiffness_over_rpm):
        constants = ("stiffness", "length", "outer", "inner", "shear_modulus")
        return _twice_errors(shaft, "stiffness_over_rpm", *constants)
    if shaft.stiffness is not None:
        if not sizes:
            return []
        stiffness = (present_keys(shaft, "stiffness") or ["stiffness"])[0]
        remedy = "Keep stiffness, or length, outer, inner and shear_modulus."
        return [f"{stiffness} is given together with {joined(sizes)}. {remedy}"]
    lacking = [
        key
        for key in ("length", "outer", "shear_modulus")
        if getattr(shaft, key) is None
    ]
    if not sizes:
        text = "the key 'stiffness' is missing. Give greater than 0 N m/rad"
        return [f"{text}, or length, outer and inner in m and shear_modulus in Pa."]
    if lacking:
        return [
            f"{joined(sizes)} without {joined(lacking)} give no stiffness. Give the"
            " rest, or stiffness in N m/rad."
        ]
    return _hole_errors(shaft, "inner", "outer")


def _hole_errors(shaft: Shaft, hole: str, around: str) -> list[str]:
    """Check that a hole is smaller than the diameter ``around`` it."""
    inside = getattr(shaft, hole)
    outside = getattr(shaft, around)
    if not (number_like(inside) and number_like(outside)) or inside < outside:
        return []
    return [
        f"{hole} is {inside:g} m, must be less than {around} = {outside:g} m. Correct"
        " one of them."
    ]


def _damping_errors(link: Shaft | Damper | Mesh) -> list[str]:
    """Check that a link has one damping, a share of the critical one with its
    frequency.
    """
    damping_keys = present_keys(link, "damping", *SHARES)
    shares = present_keys(link, *SHARES)
    frequency = present_keys(link, "damping_hz")
    # Without a frequency it is a loss factor.
    is_loss_factor = len(shares) == 1 and present_keys(link, "relative_damping")
    tables = ["damping_over_rpm"]
    if shares:
        damping_keys += present_keys(link, "loss_factor")
    if shares and not (is_loss_factor and not frequency):
        # They are shares of a constant stiffness.
        tables.append("stiffness_over_rpm")
    damping_keys += [name for name in tables if is_present(getattr(link, name))]
    if len(damping_keys) > 1:
        return [
            f"{damping_keys[0]} is given together with {joined(damping_keys[1:])}."
            " Keep one of them."
        ]
    if shares and not frequency and not is_loss_factor:
        return [
            f"{shares[0]} is given without damping_hz. Give the frequency in Hz at"
            " which it holds."
        ]
    if frequency and not shares:
        ways = " or ".join(key for key in SHARES if hasattr(link, key))
        return [
            f"{frequency[0]} is given without {ways}. Give one of them, or leave it"
            " out."
        ]
    return []


def _section_errors(shaft: Shaft) -> list[str]:
    """Check the section of a shaft."""
    texts = []
    bore = present_keys(shaft, "bore")
    if bore and shaft.diameter is None:
        texts.append(
            f"{bore[0]} is given without diameter. Give the outer diameter in m."
        )
    elif bore:
        texts += _hole_errors(shaft, "bore", "diameter")
    return texts


def rule_errors(shaft: Shaft, rule: Rule) -> list[str]:
    """Check that a shaft has the numbers that its limits need, and none without a part
    in them.
    """
    texts = []
    asking = present_keys(shaft, "stress_concentration", "tensile_strength")
    if shaft.rule is not None and not rule.default:
        asking = ["rule"]
    present = [
        key for key in (*STRENGTH_KEYS, "outer") if getattr(shaft, key) is not None
    ]
    missing = lacking(rule, present)
    if asking and missing:
        limits = (
            f"{joined(asking)} {'ask' if len(asking) > 1 else 'asks'} for the stress"
            f" limits of {rule.title or rule.name}"
        )
        texts.append(
            f"{limits}, without {joined(missing)}. Give"
            f" {joined(STRENGTH_KEYS[key] for key in missing)}."
        )
    texts += [
        f"{key} has no part in the limits of {rule.name}. Leave it out, or name"
        " another rule."
        for key in rule.unread
        if getattr(shaft, key) is not None and (shaft.rule or rule.default)
    ]
    return texts


def _concentration_errors(shaft: Shaft) -> list[str]:
    """Check that stress concentration factors for torsion and the limit of the
    alternating stress are given together, with a section.
    """
    factors = present_keys(shaft, "fillet_factor", "oil_bore_factor")
    if factors and shaft.alternating_limit is None:
        return [
            f"{joined(factors)} {'are' if factors[1:] else 'is'} given without"
            " alternating_limit. Give the permissible alternating torsional stress in"
            " Pa."
        ]
    if shaft.alternating_limit is None:
        return []
    texts = []
    if not factors:
        texts.append(
            "alternating_limit is given without fillet_factor or oil_bore_factor. Give"
            " one or both (alpha_T or beta_T, and gamma_T of IACS UR M53)."
        )
    if shaft.diameter is None and shaft.outer is None:
        texts.append(
            "alternating_limit is given without diameter. Give the diameter (or outer)"
            " in m."
        )
    return texts


def _rated_errors(link: Shaft | Damper) -> list[str]:
    """Check that the maximum torque of a coupling is its largest."""
    most = link.maximum_torque
    return [
        f"maximum_torque is {most:g} N m, less than {key} = {value:g} N m. It bounds"
        " every instant: correct one of them."
        for key in ("nominal_torque", "vibratory_torque")
        if plain_number(value := getattr(link, key))
        and plain_number(most)
        and most < value
    ]


def _curve_errors(shaft: Shaft) -> list[str]:
    """Check the S-N curve of a shaft, its source and the section that it needs."""
    if not is_present(shaft.sn_curve):
        if shaft.sn_source is None:
            return []
        return ["sn_source is given without sn_curve. Give the rows, or leave it out."]
    texts = []
    if shaft.sn_source is None:
        texts.append(
            "sn_curve is given without sn_source. Name the standard or test that it is"
            " of."
        )
    if shaft.diameter is None and shaft.outer is None:
        texts.append(
            "sn_curve is given without diameter. Give the diameter (or outer) in m."
        )
    if row_errors("sn_curve", SN_CURVE, shaft.sn_curve):
        return texts
    cycles, stresses = zip(*shaft.sn_curve, strict=True)
    falling = all(after < before for before, after in pairwise(stresses))
    if len(cycles) < 2 or not (falling and min(*cycles, *stresses) > 0):
        texts.append(
            "sn_curve must be two rows or more of cycles and Pa, all greater than 0,"
            " the stresses falling. Correct the rows."
        )
    return texts


def load_errors(load: Load) -> list[str]:
    """Check the blades of a load, its law over the speed, and what asks for one."""
    texts = blade_errors(load) + _law_errors(load)
    # A law that is no law has its own sentence.
    if load.archer is not None and load.law in ("", "constant", "generator"):
        texts.append(
            "archer takes the torque of the law 'propeller'. Give law = 'propeller'"
            " with rated_torque in N m and rated_rpm, or leave it out."
        )
    return texts


def _law_errors(load: Load) -> list[str]:
    """Check that a load has one law over the speed, with all that it needs."""
    rated = {"rated_torque in N m": load.rated_torque, "rated_rpm": load.rated_rpm}
    present = [key.split()[0] for key, value in rated.items() if value is not None]
    lacking = [key for key, value in rated.items() if value is None]
    if load.law and is_present(load.over_rpm):
        return several_given(["law", "over_rpm"])
    if load.law == "constant":
        lacking = lacking[: load.rated_torque is None]
    if load.law in LOAD_LAWS and lacking:
        return [
            f"law {shown(load.law)} needs {joined(lacking)}. Give"
            f" {'them' if lacking[1:] else 'it'}."
        ]
    if not load.law and present:
        return [
            f"{joined(present)} {'say' if present[1:] else 'says'} nothing without law."
            f" Give law, or leave {'them' if present[1:] else 'it'} out."
        ]
    if row_errors("over_rpm", OVER_RPM, load.over_rpm):
        return []
    least = min((row[1] for row in load.over_rpm), default=0.0)
    if least < 0.0:
        return [
            f"over_rpm: the least torque is {least:g} N m, must be at least 0 N m. A"
            " load brakes; give its torque without sign."
        ]
    return []


TOGETHER: dict[str, tuple[Callable[[Any], list[str]], str]] = {
    "disk": (disk_errors, "damping"),
    "ground": (ground_errors, "stiffness"),
    "shaft": (shaft_errors, "stiffness"),
    "mesh": (mesh_errors, "law"),
    "damper": (damper_errors, "stiffness"),
    "load": (load_errors, "law"),
    "event": (event_errors, "begin"),
    **{name: (kind.errors, kind.doubtful) for name, kind in EXCITATIONS.items()},
}
"""Checks of several fields of an element together, and the field that each puts in
doubt.
"""

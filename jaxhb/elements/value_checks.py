"""Checks of the values of an element: fields, tables, ways to define a link, sources of
the gas torque.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any, TypeGuard

import numpy as np

from jaxhb._jax import traced
from jaxhb.elements.elements import (
    LARGEST,
    MOST_SENTENCES,
    OF_PERIOD,
    SMALLEST,
    Combustion,
    Cylinder,
    Damper,
    Mesh,
    Shaft,
    Torque,
    Trace,
    Unread,
    fields_of,
    shown,
    suggestion,
)
from jaxhb.elements.rules import RULES
from jaxhb.excitation import gas
from jaxhb.excitation.tables import COMPUTED


def number_like(value: Any) -> TypeGuard[float]:
    """Tell whether a value is a number and no truth value."""
    if isinstance(value, bool):
        return False
    try:
        float(value)
    except (TypeError, ValueError, OverflowError):
        return False
    return not isinstance(value, str)


def field_errors(where: str, field: dataclasses.Field, value: Any) -> list[str] | None:
    """Sentences on one field; None where it is sound, an empty list where its sentences
    exist already.
    """
    if isinstance(value, Unread):
        return []
    if value is None:
        return [_missing(where, field)] if field.default is not None else None
    if field.metadata["kind"] in ("table", "tables"):
        return _table_errors(where, field, value)
    return [f"{where}: {text}" for text in _value_errors(field, value)] or None


def _table_errors(where: str, field: dataclasses.Field, value: Any) -> list[str] | None:
    """Sentences on a table inside an element, or on a list of them; None where all is
    sound.
    """
    cls = field.metadata["of"]
    several = field.metadata["kind"] == "tables"
    rows = value if several else [value]
    if not is_list(rows) or not rows or not all(isinstance(row, cls) for row in rows):
        expected = (
            f"one table or more. Write [[….{field.name}]]"
            if several
            else f"a table. Write [….{field.name}]"
        )
        return [f"{where}: {field.name} is {shown(value)}, must be {expected}."]
    by_field = [
        field_errors(
            f"{where}, {field.name}{f' no. {k + 1}' if several else ''}",
            inner_field,
            getattr(row, inner_field.name),
        )
        for k, row in enumerate(rows)
        for inner_field in fields_of(row)
    ]
    if all(sentences is None for sentences in by_field):
        return None
    return [text for sentences in by_field for text in sentences or ()]


LONGEST_NAME = 100  # characters: tables and pictures show names
_NAME = f"a text of at most {LONGEST_NAME} characters"

_KINDS: dict[str, tuple[Callable[[Any], Any], str, str]] = {
    "name": (
        lambda value: isinstance(value, str) and 0 < len(value) <= LONGEST_NAME,
        _NAME,
        "a text, unique over all tables",
    ),
    "disk": (
        lambda value: isinstance(value, str) and value,
        "a text",
        "the name of a disk",
    ),
    "pair": (
        lambda value: is_list(value) and [type(end) for end in value] == [str, str],
        "the names of two disks",
        "the names of two disks",
    ),
    "flag": (lambda value: isinstance(value, bool), "true or false", "a value"),
    "list": (lambda value: is_list(value), "a list", "a list"),
}
"""A test of the values of each kind of field, and the words for a value that fails it
and for a missing one.
"""


def is_list(value: Any) -> TypeGuard[Sequence[Any]]:
    return isinstance(value, tuple | list)


def _is_present(value: Any) -> bool:
    """Tell whether a key is given, with rows if it takes rows."""
    return value is not None and not (is_list(value) and not value)


def _missing(where: str, field: dataclasses.Field) -> str:
    """Sentence for a key that is not there."""
    limits = field.metadata.get("range")
    kind = field.metadata["kind"]
    expected = "a value"
    if limits:
        expected = limits.words()
    elif kind == "rows":
        columns = ", ".join(field.metadata["columns"])
        expected = f"rows of {columns}, or the name of a CSV file"
    elif kind in _KINDS:
        expected = _KINDS[kind][2]
    return f"{where}: the key {field.name!r} is missing. Give {expected}."


def _value_errors(field: dataclasses.Field, value: Any) -> list[str]:
    """Check one value against the kind and the range of its field."""
    kind = field.metadata["kind"]
    if kind in ("number", "count", "shorthand"):
        return value_errors(field, value)
    if kind == "rows":
        return row_errors(field.name, field.metadata["columns"], value)
    if kind == "choice":
        words = [word for word in field.metadata["words"] if word]
        if value in field.metadata["words"]:
            return []
        expected = " or ".join(repr(word) for word in words)
        near = suggestion(value, words)
    else:
        test, expected, _ = _KINDS[kind]
        if test(value):
            return []
        near = ""
    return [f"{field.name} is {shown(value)}, must be {expected}.{near}"]


def value_errors(field: dataclasses.Field, value: Any) -> list[str]:
    """Check a number against the range in its field's metadata; sentences without the
    element.
    """
    limits = field.metadata["range"]
    remedy = ""
    unit = f" {limits.unit}" if limits.unit else ""
    number = float(value) if number_like(value) else math.nan
    if not number_like(value) and traced(value):
        remedy_outside = (
            "build the train outside, and change it there by train.replace, whose"
            " numbers may be traced"
        )
        return [
            f"{field.name} is traced by jit, vmap or grad, must be a number:"
            f" {remedy_outside}."
        ]
    if not number_like(value) and (
        isinstance(value, bool) or not isinstance(value, int)
    ):
        actual = shown(value)
        expected = f"a number{f' in {limits.unit}' if limits.unit else ''}"
    elif not math.isfinite(number):
        actual = f"{number if number_like(value) else shown(value)}{unit}"
        expected = "a finite number"
    elif abs(number) > LARGEST:
        actual = f"{number:g}{unit}"
        expected = f"at most {LARGEST:g} in size"
    elif 0.0 < abs(number) < SMALLEST:
        actual = f"{number:g}{unit}"
        expected = f"0 or at least {SMALLEST:g} in size"
    elif field.metadata["kind"] == "count" and number != int(number):
        actual = f"{number:g}"
        expected = "a whole number"
    elif limits.excludes(number):
        absent = "" if field.default is dataclasses.MISSING else " or leave the key out"
        actual = f"{number:g}{unit}"
        expected = limits.words()
        remedy = f" {limits.remedy or f'Correct the value{absent}.'}"
    else:
        return []
    return [f"{field.name} is {actual}, must be {expected}.{remedy}"]


def row_errors(name: str, columns: Sequence[str], rows: Any) -> list[str]:
    """Check a table of numbers: its columns, finiteness, and the growth of its first
    column.
    """
    header = ", ".join(columns)
    if not is_list(rows):
        return [f"{name} is {shown(rows)}, must be a list of rows [{header}]."]
    for i, row in enumerate(rows):
        if not (
            is_list(row)
            and len(row) == len(columns)
            and all(number_like(number) for number in row)
        ):
            return [
                f"{name}, row {i + 1} is {shown(row)}, must be {len(columns)} numbers"
                f" [{header}]."
            ]
        if not all(abs(float(number)) <= LARGEST for number in row):
            return [
                f"{name}, row {i + 1} is {shown(list(row))}, must be finite numbers, at"
                f" most {LARGEST:g} in size."
            ]
    first = [float(row[0]) for row in rows]
    if columns[0] == "order":
        not_positive = [i for i, order in enumerate(first) if order <= 0.0]
        repeated = [
            (order, times) for order, times in Counter(first).items() if times > 1
        ]
        errors = [
            f"{name}, row {i + 1}: order is {first[i]:g}, must be greater than 0. Give"
            " the mean by its own key."
            for i in not_positive[:MOST_SENTENCES]
        ]
        errors += [
            f"{name}: order {order:g} stands {times} times. Add the rows."
            for order, times in repeated[:MOST_SENTENCES]
        ]
        left_out = max(len(not_positive) - MOST_SENTENCES, 0) + max(
            len(repeated) - MOST_SENTENCES, 0
        )
        return (
            [*errors, f"{name}: {left_out} more rows are so."] if left_out else errors
        )
    for i, (previous, current) in enumerate(pairwise(first), start=2):
        if current <= previous:
            remedy = (
                "Leave out one of the two rows"
                if current == previous
                else "Sort the rows"
            )
            return [
                f"{name}, row {i}: {columns[0]} {current:g} after {previous:g}; must"
                f" increase. {remedy}."
            ]
    if columns[0] in ("hz", "amplitude"):
        # 5e-324 is the least number above 0.
        rules = (
            (0, "at least 0", 0.0),
            (2, "at least 0", 0.0),
            (1, "greater than 0", 5e-324),
        )
        outside = (
            f"{name}, row {i + 1}: {columns[column]} is {row[column]:g}, must be"
            f" {words}. Correct the row."
            for i, row in enumerate(rows)
            for column, words, least in rules
            if not row[column] >= least
        )
        return list(itertools.islice(outside, MOST_SENTENCES))
    if columns[0] == "rpm" and first and first[0] < 0.0:
        return [
            f"{name}, row 1: rpm is {first[0]:g}, must be at least 0. Speeds are"
            " positive; correct the row."
        ]
    return _span_errors(name, first, rows) if columns[0] == "angle" else []


def _span_errors(name: str, angle: Sequence[float], rows: Any) -> list[str]:
    """Check that a pressure table covers one gas cycle but for one step at most."""
    if len(angle) < 2:
        return [f"{name} has {len(angle)} rows, needs at least 2."]
    span = angle[-1] - angle[0]
    if span > 720.0 + 1e-9:
        return [
            f"{name} spans {span:g} deg, must span at most 720 deg. Give one gas cycle."
        ]
    period = 720.0 if gas.is_four_stroke(rows) else 360.0
    steps = np.diff(angle)
    # The end of a table may be left out: as much as a step of it, up to an eighth of
    # the cycle.
    step = min(max(float(np.median(steps)), steps[0], steps[-1]), period / 8.0)
    if span >= period - step - 1e-6:
        return []
    return [
        f"{name} covers {angle[0]:g} to {angle[-1]:g} deg, must cover a whole gas cycle"
        f" of {period:g} deg but for one step ({step:g} deg). Add the missing angles;"
        " four-stroke tables span 720 deg, two-stroke tables 360 deg within -360 to"
        " 360 deg."
    ]


_STRENGTH_KEYS = {
    "diameter": "diameter (or outer) in m",
    "stress_concentration": (
        "stress_concentration (C_K of the form, 1 for an integral flange, less"
        " otherwise)"
    ),
    "tensile_strength": "tensile_strength in Pa",
}


def shaft_errors(shaft: Shaft) -> list[str]:
    """Check that a shaft has one stiffness and one damping, and that its stages and
    limits have all they need.
    """
    return (
        _stiffness_errors(shaft)
        + _damping_errors(shaft)
        + _section_errors(shaft)
        + _spring_errors(shaft)
    )


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
    if link.clearance is not None and link.stiffness == 0:
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
        if _is_present(getattr(link, key))
    ]
    varying_keys = [
        key
        for key in ("over_hz", "over_amplitude", "order")
        if _is_present(getattr(link, key, None))
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
    texts = _damping_errors(mesh)
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
        for key in ("stiffness", "stiffness_table", "width")
        if _is_present(getattr(mesh, key))
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
    if damper.stiffness != 0 or damper.damping != 0:
        return _damping_errors(damper) + _spring_errors(damper)
    damping_keys = _present_keys(damper, "magnifier", "damping_ratio")
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


def torque_errors(torque: Torque) -> list[str]:
    """Check that a power of the speed has a speed at which the torque holds."""
    if torque.speed_exponent is not None and torque.rated_rpm is None:
        return [
            "speed_exponent is given without rated_rpm. Give the speed at which the"
            " torque has this size."
        ]
    return []


def _present_keys(link: Shaft | Damper | Mesh, *keys: str) -> list[str]:
    """``key = value unit`` of each of the ``keys`` that a link can have and has, other
    than as 0.
    """
    texts = []
    for key in keys:
        value = getattr(link, key, None)
        if value is not None and not (number_like(value) and value == 0):
            unit = next(
                field.metadata["range"].unit
                for field in fields_of(link)
                if field.name == key
            )
            texts.append(
                f"{key} = {value:g} {unit}".rstrip() if plain_number(value) else key
            )
    return texts


def plain_number(value: Any) -> TypeGuard[float]:
    """Tell whether a value is a number that can be printed: no text, no truth value and
    not infinite.
    """
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) < 1e300
    )


def joined(texts: Iterable[str]) -> str:
    """Join texts by commas and a last "and"."""
    words = list(texts)
    if len(words) > 1:
        return f"{', '.join(words[:-1])} and {words[-1]}"
    return "".join(words)


def _stiffness_errors(shaft: Shaft) -> list[str]:
    """Check that a shaft has a stiffness, or dimensions that give one."""
    sizes = _present_keys(shaft, "length", "outer", "inner", "shear_modulus")
    if shaft.stiffness is not None:
        if not sizes:
            return []
        stiffness = (_present_keys(shaft, "stiffness") or ["stiffness"])[0]
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
    damping_keys = _present_keys(link, "damping", "magnifier", "damping_ratio")
    shares = _present_keys(link, "magnifier", "damping_ratio")
    frequency = _present_keys(link, "damping_hz")
    if shares:
        damping_keys += _present_keys(link, "loss_factor")
    if len(damping_keys) > 1:
        return [
            f"{damping_keys[0]} is given together with {joined(damping_keys[1:])}."
            " Keep one of them."
        ]
    if shares and not frequency:
        return [
            f"{shares[0]} is given without damping_hz. Give the frequency in Hz at"
            " which it holds."
        ]
    if frequency and not shares:
        return [
            f"{frequency[0]} is given without magnifier or damping_ratio. Give one of"
            " them, or leave it out."
        ]
    return []


def _section_errors(shaft: Shaft) -> list[str]:
    """Check the section of a shaft, and the numbers that its stress limits need."""
    texts = []
    bore = _present_keys(shaft, "bore")
    if bore and shaft.diameter is None:
        texts.append(
            f"{bore[0]} is given without diameter. Give the outer diameter in m."
        )
    elif bore:
        texts += _hole_errors(shaft, "bore", "diameter")
    asking = _present_keys(shaft, "stress_concentration", "tensile_strength")
    rule = RULES.get(shaft.rule) if isinstance(shaft.rule, str) else None
    needs = _STRENGTH_KEYS if rule is None else rule.needs
    lacking = [
        key
        for key in needs
        if getattr(shaft, key) is None and (key != "diameter" or shaft.outer is None)
    ]
    if rule is not None and not rule.default:
        asking = ["rule"]
    if asking and lacking:
        title = shaft.rule if rule is None else rule.title or rule.name
        limits = (
            f"{joined(asking)} {'ask' if len(asking) > 1 else 'asks'} for the stress"
            f" limits of {title}"
        )
        texts.append(
            f"{limits}, without {joined(lacking)}. Give"
            f" {joined(_STRENGTH_KEYS[key] for key in lacking)}."
        )
    texts += [
        f"{key} has no part in the limits of {shaft.rule}. Leave it out, or name"
        " another rule."
        for key in (() if rule is None else rule.unread)
        if getattr(shaft, key) is not None
    ]
    return texts


def cylinder_errors(cylinder: Cylinder) -> list[str]:
    """Check that a cylinder has one source of its gas torque and the numbers that this
    source needs.
    """
    computed = [key for key in COMPUTED if getattr(cylinder, key) is not None]
    has_torque = cylinder.gas_torque is not None or cylinder.gas_torque_mean is not None
    sources = [*computed, "gas_torque"] if has_torque else computed
    errors = []
    if len(sources) > 1:
        several = "both" if len(sources) == 2 else "all"
        errors.append(
            f"{', '.join(sources[:-1])} and {sources[-1]} are {several} given. Keep one"
            " of them."
        )
    if cylinder.fires is True and not sources:
        errors.append(
            "neither pressure nor gas_torque is given. Give one of them, or set fires ="
            " false."
        )
    needed_keys = []
    reason = computed[0] if computed else "reciprocating_mass"
    if computed:
        needed_keys = ["bore", "stroke", "rod"]
    elif number_like(cylinder.reciprocating_mass) and cylinder.reciprocating_mass > 0:
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
    if cylinder.load and not {"traces", "combustion"} & set(computed):
        errors.append(
            "load is given without traces or combustion, which it acts on. Give scale"
            " instead."
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
    present = [getattr(combustion, key) is not None for key in ("heat", "imep")]
    errors = []
    if all(present):
        errors.append("combustion: heat and imep are both given. Keep one of them.")
    if not any(present):
        errors.append("combustion: neither heat nor imep is given. Give one of them.")
    if combustion.charge_over_load and combustion.charge_over_rpm:
        errors.append(
            "combustion: charge_over_load and charge_over_rpm are both given. Keep one"
            " of them."
        )
    for name, columns in (
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
                f"combustion: the least factor of {name} is {least_factor:g}, must be"
                " greater than 0. Correct it."
            )
    if number_like(combustion.stroke_cycle) and combustion.stroke_cycle not in (2, 4):
        errors.append(
            f"combustion: stroke_cycle is {combustion.stroke_cycle:g}, must be 2 or 4."
            " Correct it."
        )
    return errors


TOGETHER: dict[str, tuple[Callable[[Any], list[str]], str]] = {
    "shaft": (shaft_errors, "stiffness"),
    "mesh": (mesh_errors, "law"),
    "damper": (damper_errors, "stiffness"),
    "torque": (torque_errors, "speed_exponent"),
    "cylinder": (cylinder_errors, "fires"),
}
"""Checks of several fields of an element together, and the field that each puts in
doubt.
"""

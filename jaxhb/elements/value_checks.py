"""Checks of the values of an element: fields, tables, what a link is given by, where
gas torque comes from.
"""

import dataclasses
import itertools
import math
from collections import Counter
from itertools import pairwise
from typing import Any

import numpy as np

from jaxhb._jax import traced
from jaxhb.elements.elements import (
    LARGEST,
    RULES,
    SMALLEST,
    TOLD,
    Combustion,
    Trace,
    Unread,
    fields_of,
    shown,
    suggestion,
)
from jaxhb.equations.kinematics import OF_PERIOD
from jaxhb.excitation import gas


def number_like(value) -> bool:
    """Tell whether a value is a number and no truth value."""
    if isinstance(value, bool):
        return False
    try:
        float(value)
    except (TypeError, ValueError, OverflowError):
        return False
    return not isinstance(value, str)


def field_errors(where, f, value) -> list[str] | None:
    """Sentences on one field; None where it is sound, none where they have been said
    already.
    """
    if isinstance(value, Unread):
        return []
    if value is None:
        return [_missing(where, f)] if f.default is not None else None
    if f.metadata["kind"] in ("table", "tables"):
        return _table_errors(where, f, value)
    return [f"{where}: {text}" for text in _value_errors(f, value)] or None


def _table_errors(where, f, value) -> list[str] | None:
    """Sentences on a table inside an element, or on a list of them; None where all is
    sound.
    """
    cls = f.metadata["of"]
    several = f.metadata["kind"] == "tables"
    rows = value if several else [value]
    if not _is_list(rows) or not rows or not all(isinstance(row, cls) for row in rows):
        wanted = (
            f"one table or more. Write [[….{f.name}]]"
            if several
            else f"a table. Write [….{f.name}]"
        )
        return [f"{where}: {f.name} is {shown(value)}, must be {wanted}."]
    said = [
        field_errors(
            f"{where}, {f.name}{f' no. {k + 1}' if several else ''}",
            g,
            getattr(row, g.name),
        )
        for k, row in enumerate(rows)
        for g in fields_of(row)
    ]
    return (
        [text for sentences in said for text in sentences or ()]
        if any(s is not None for s in said)
        else None
    )


LONGEST_NAME = 100  # characters: tables and pictures show names
_NAME = f"a text of at most {LONGEST_NAME} characters"

_KINDS: dict[str, Any] = {
    "name": (
        lambda v: isinstance(v, str) and 0 < len(v) <= LONGEST_NAME,
        _NAME,
        "a text, unique over all tables",
    ),
    "disk": (lambda v: isinstance(v, str) and v, "a text", "the name of a disk"),
    "pair": (
        lambda v: _is_list(v) and [type(e) for e in v] == [str, str],
        *["the names of two disks"] * 2,
    ),
    "flag": (lambda v: isinstance(v, bool), "true or false", "a value"),
    "list": (lambda v: _is_list(v), "a list", "a list"),
}
"""What a field of a kind takes: a test, and the words for what it is not and for what
is missing.
"""


def _is_list(value) -> bool:
    return isinstance(value, tuple | list)


def _is_there(value) -> bool:
    """Tell whether a key is given, not as no rows."""
    return value is not None and not (_is_list(value) and not value)


def _missing(where, f) -> str:
    """Sentence for a key that is not there."""
    limits = f.metadata.get("range")
    kind = f.metadata["kind"]
    wanted = (
        limits.words() if limits else _KINDS[kind][2] if kind in _KINDS else "a value"
    )
    if kind == "rows":
        wanted = (
            f"rows of {', '.join(f.metadata['columns'])}, or the name of a CSV file"
        )
    return f"{where}: the key {f.name!r} is missing. Give {wanted}."


def _value_errors(f, value) -> list[str]:
    """Check one value against the kind and the range of its field."""
    kind = f.metadata["kind"]
    if kind in ("number", "count", "shorthand"):
        return value_errors(f, value)
    if kind == "rows":
        return row_errors(f.name, f.metadata["columns"], value)
    if kind == "choice":
        words = [w for w in f.metadata["words"] if w]
        if value in f.metadata["words"]:
            return []
        wanted = " or ".join(repr(w) for w in words)
        near = suggestion(value, words)
    else:
        test, wanted, _ = _KINDS[kind]
        if test(value):
            return []
        near = ""
    return [f"{f.name} is {shown(value)}, must be {wanted}.{near}"]


def value_errors(f, value) -> list[str]:
    """Check a number against the range in its field's metadata; sentences without the
    element.
    """
    limits = f.metadata["range"]
    remedy = ""
    unit = f" {limits.unit}" if limits.unit else ""
    number = float(value) if number_like(value) else math.nan
    if not number_like(value) and traced(value):
        there = (
            "build the train outside, and change it there by train.replace, whose"
            " numbers may be traced"
        )
        return [f"{f.name} is traced by jit, vmap or grad, must be a number: {there}."]
    if not number_like(value) and (
        isinstance(value, bool) or not isinstance(value, int)
    ):
        found = shown(value)
        wanted = f"a number{f' in {limits.unit}' if limits.unit else ''}"
    elif not math.isfinite(number):
        found = f"{number if number_like(value) else shown(value)}{unit}"
        wanted = "a finite number"
    elif abs(number) > LARGEST:
        found = f"{number:g}{unit}"
        wanted = f"at most {LARGEST:g} in size"
    elif 0.0 < abs(number) < SMALLEST:
        found = f"{number:g}{unit}"
        wanted = f"0 or at least {SMALLEST:g} in size"
    elif f.metadata["kind"] == "count" and number != int(number):
        found = f"{number:g}"
        wanted = "a whole number"
    elif limits.excludes(number):
        absent = "" if f.default is dataclasses.MISSING else " or leave the key out"
        found = f"{number:g}{unit}"
        wanted = limits.words()
        remedy = f" {limits.remedy or f'Correct the value{absent}.'}"
    else:
        return []
    return [f"{f.name} is {found}, must be {wanted}.{remedy}"]


def row_errors(name, columns, rows) -> list[str]:
    """Check a table of numbers: its columns, finiteness, and the growth of its first
    column.
    """
    wanted = ", ".join(columns)
    if not _is_list(rows):
        return [f"{name} is {shown(rows)}, must be a list of rows [{wanted}]."]
    for k, row in enumerate(rows):
        if not (
            _is_list(row)
            and len(row) == len(columns)
            and all(number_like(v) for v in row)
        ):
            return [
                f"{name}, row {k + 1} is {shown(row)}, must be {len(columns)} numbers"
                f" [{wanted}]."
            ]
        if not all(abs(float(v)) <= LARGEST for v in row):
            return [
                f"{name}, row {k + 1} is {shown(list(row))}, must be finite numbers, at"
                f" most {LARGEST:g} in size."
            ]
    first = [float(row[0]) for row in rows]
    if columns[0] == "order":
        wrong = [k for k, order in enumerate(first) if order <= 0.0]
        twice = [(order, times) for order, times in Counter(first).items() if times > 1]
        errors = [
            f"{name}, row {k + 1}: order is {first[k]:g}, must be greater than 0. Give"
            " the mean by its own key."
            for k in wrong[:TOLD]
        ]
        errors += [
            f"{name}: order {order:g} stands {times} times. Add the rows."
            for order, times in twice[:TOLD]
        ]
        more = max(len(wrong) - TOLD, 0) + max(len(twice) - TOLD, 0)
        return [*errors, f"{name}: {more} more rows are so."] if more else errors
    for k, (before, here) in enumerate(pairwise(first), start=2):
        if here <= before:
            cure = (
                "Leave out one of the two rows" if here == before else "Sort the rows"
            )
            return [
                f"{name}, row {k}: {columns[0]} {here:g} after {before:g}; must"
                f" increase. {cure}."
            ]
    if columns[0] in ("hz", "amplitude"):
        # 5e-324 is the least number above 0.
        rules = (
            (0, "at least 0", 0.0),
            (2, "at least 0", 0.0),
            (1, "greater than 0", 5e-324),
        )
        outside = (
            f"{name}, row {k + 1}: {columns[column]} is {row[column]:g}, must be"
            f" {words}. Correct the row."
            for k, row in enumerate(rows)
            for column, words, least in rules
            if not row[column] >= least
        )
        return list(itertools.islice(outside, TOLD))
    if columns[0] == "rpm" and first and first[0] < 0.0:
        return [
            f"{name}, row 1: rpm is {first[0]:g}, must be at least 0. Speeds are"
            " positive; correct the row."
        ]
    return _span_errors(name, first, rows) if columns[0] == "angle" else []


def _span_errors(name, angle, rows) -> list[str]:
    """Check that a pressure table covers one gas cycle, but for one step at the
    most.
    """
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


_ASKED = {
    "diameter": "diameter (or outer) in m",
    "stress_concentration": (
        "stress_concentration (C_K of the form, 1 for an integral flange, less"
        " otherwise)"
    ),
    "tensile_strength": "tensile_strength in Pa",
}


def shaft_errors(shaft) -> list[str]:
    """Check that a shaft has one stiffness and one damping, and what its stages and its
    limits need.
    """
    return (
        _stiffness_errors(shaft)
        + _damping_errors(shaft)
        + _section_errors(shaft)
        + _spring_errors(shaft)
    )


def _spring_errors(link) -> list[str]:
    """Check play, stages and stops of a shaft or damper."""
    columns = ("twist", "stiffness")
    texts = []
    sound = [
        name
        for name in ("stages", "stops")
        if not row_errors(name, columns, getattr(link, name))
    ]
    play = link.clearance / 2 if plain_number(link.clearance) else 0.0
    allowed = {
        "stages": ("greater than 0 deg", "at least 0"),
        "stops": ("other than 0 deg", "greater than 0"),
    }
    for name, k, (twist, stiffness) in (
        (n, k, row) for n in sound for k, row in enumerate(getattr(link, n), 1)
    ):
        where = f"{name}, row {k}"
        (twists, least) = allowed[name]
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
                f"{where}: stiffness is {stiffness:g} N m/rad, must be {least}. Correct"
                " the row."
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
    ways = [
        key
        for key in ("clearance", "stages", "stops", "friction")
        if _is_there(getattr(link, key))
    ]
    varies = [
        key
        for key in ("over_hz", "over_amplitude", "order")
        if _is_there(getattr(link, key, None))
    ]
    if ways and varies:
        texts.append(
            f"{ways[0]} is given together with {varies[0]}, which only linear links"
            " have. Keep one of them."
        )
    return texts


def mesh_errors(mesh) -> list[str]:
    """Check what the law of a mesh is made of, and that it has one damping."""
    texts = _damping_errors(mesh)
    both = [key for key in ("epsilon", "transition") if getattr(mesh, key) is not None]
    if mesh.law and both:
        texts.append(
            f"law = {shown(mesh.law)} is given together with {' and '.join(both)}. Keep"
            " one of them."
        )
    sound = [
        name
        for name in OF_PERIOD
        if not row_errors(name, ("order", "Re", "Im"), getattr(mesh, name))
    ]
    texts += [
        f"{name}, row {k}: order {row[0]:g} of the mesh period must be a whole number."
        " Give what repeats with the revolution of a gear as first_gear_error or"
        " second_gear_error."
        for name in sound
        for k, row in enumerate(getattr(mesh, name), 1)
        if row[0] != int(row[0])
    ]
    texts += _shorthand_errors(mesh)
    return texts + (
        stiffness_errors(mesh.stiffness_orders) if "stiffness_orders" in sound else []
    )


def _shorthand_errors(mesh) -> list[str]:
    """Check that a mesh has one stiffness, and one way to its orders."""
    own = [
        key
        for key in ("stiffness", "stiffness_table", "width")
        if _is_there(getattr(mesh, key))
    ]
    ways = [
        key
        for key in ("stiffness_orders", "stiffness_table", "contact_ratio")
        if getattr(mesh, key)
    ]
    both = [keys for keys in (own, ways) if keys[1:]]
    texts = [
        f"{first} is given together with {_and(others)}. Keep one of them."
        for first, *others in both
    ]
    if not own:
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
    (first, begin) = table[0]
    (last, end) = table[-1]
    (where, low) = min(table, key=lambda row: row[1])
    if low <= 0.0:
        texts.append(
            f"stiffness_table: the stiffness is {low:g} N/m at {where:g}, must be"
            " greater than 0. Correct it."
        )
    if first < 0.0 or last > 1.0 or len(table) < 2:
        span = f"{len(table)} rows from {first:g} to {last:g}"
        texts.append(
            f"stiffness_table has {span}, must have at least 2 from 0 to 1, shares of"
            " the mesh period."
        )
    elif last == 1.0 and (first > 0.0 or begin != end):
        found = "none" if first > 0.0 else f"{begin:g} N/m"
        found = f"{found} at 0 and {end:g} N/m at 1"
        texts.append(
            f"stiffness_table is not periodic: it has {found}. Give both, equal, or"
            " leave out the row at 1."
        )
    return texts


def stiffness_errors(rows) -> list[str]:
    """Check that a stiffness stays above 0 all over the mesh period."""
    angle = np.linspace(0.0, 2 * np.pi, 720, endpoint=False)
    share = 1.0 + sum(
        re * np.cos(order * angle) - im * np.sin(order * angle)
        for order, re, im in rows
    )
    if np.min(share) > 0.0:
        return []
    return [
        f"stiffness_orders make the stiffness {np.min(share):.3g} of its mean at"
        f" {np.argmin(share) / 2:g} deg of the mesh period, must be greater than 0."
        " Correct the rows: they are shares of the mean."
    ]


def damper_errors(damper) -> list[str]:
    """Check that a damper's ring is held by something, and that it has one damping."""
    if damper.stiffness != 0 or damper.damping != 0:
        return _damping_errors(damper) + _spring_errors(damper)
    way = _given(damper, "magnifier", "damping_ratio")
    if way:
        needs = (
            "needs a stiffness greater than 0 N m/rad, of which the damping is a share"
        )
        return [f"{way[0]} {needs}. Give a stiffness, or the damping in N m s/rad."]
    if damper.order is None:
        return [
            "damping and stiffness are both 0, so that the ring is loose. Give at least"
            " one of them."
        ]
    return _damping_errors(damper)


def torque_errors(torque) -> list[str]:
    """Check that a power of the speed has a speed at which the torque holds."""
    if torque.speed_exponent is not None and torque.rated_rpm is None:
        return [
            "speed_exponent is given without rated_rpm. Give the speed at which the"
            " torque has this size."
        ]
    return []


def _given(link, *keys) -> list[str]:
    """``key = value unit`` of the keys that a link can have and that are given, not as
    0.
    """
    found = []
    for key in keys:
        value = getattr(link, key, None)
        if value is not None and not (number_like(value) and value == 0):
            unit = next(
                f.metadata["range"].unit for f in fields_of(link) if f.name == key
            )
            found.append(
                f"{key} = {value:g} {unit}".rstrip() if plain_number(value) else key
            )
    return found


def plain_number(value) -> bool:
    """Whether a value is a number that can be printed, no text, no truth value and not
    infinite.
    """
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) < 1e300
    )


def _and(words) -> str:
    words = list(words)
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _stiffness_errors(shaft) -> list[str]:
    sizes = _given(shaft, "length", "outer", "inner", "shear_modulus")
    if shaft.stiffness is not None:
        if not sizes:
            return []
        own = (_given(shaft, "stiffness") or ["stiffness"])[0]
        rest = "Keep stiffness, or length, outer, inner and shear_modulus."
        return [f"{own} is given together with {_and(sizes)}. {rest}"]
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
            f"{_and(sizes)} without {_and(lacking)} give no stiffness. Give the rest,"
            " or stiffness in N m/rad."
        ]
    return _hole_errors(shaft, "inner", "outer")


def _hole_errors(shaft, hole: str, around: str) -> list[str]:
    inside = getattr(shaft, hole)
    outside = getattr(shaft, around)
    if not (number_like(inside) and number_like(outside)) or inside < outside:
        return []
    return [
        f"{hole} is {inside:g} m, must be less than {around} = {outside:g} m. Correct"
        " one of them."
    ]


def _damping_errors(link) -> list[str]:
    ways = _given(link, "damping", "magnifier", "damping_ratio")
    shares = _given(link, "magnifier", "damping_ratio")
    at = _given(link, "damping_hz")
    if shares:
        ways += _given(link, "loss_factor")
    if len(ways) > 1:
        return [f"{ways[0]} is given together with {_and(ways[1:])}. Keep one of them."]
    if shares and not at:
        return [
            f"{shares[0]} is given without damping_hz. Give the frequency in Hz at"
            " which it holds."
        ]
    if at and not shares:
        return [
            f"{at[0]} is given without magnifier or damping_ratio. Give one of them, or"
            " leave it out."
        ]
    return []


def _section_errors(shaft) -> list[str]:
    texts = []
    bore = _given(shaft, "bore")
    if bore and shaft.diameter is None:
        texts.append(
            f"{bore[0]} is given without diameter. Give the outer diameter in m."
        )
    elif bore:
        texts += _hole_errors(shaft, "bore", "diameter")
    asked = _given(shaft, "stress_concentration", "tensile_strength")
    form = "stress_concentration"
    other = shaft.rule in RULES[1:]
    lacking = [
        key
        for key in _ASKED
        if getattr(shaft, key) is None and (key != "diameter" or shaft.outer is None)
    ]
    if other:
        asked = ["rule"]
        lacking = [key for key in lacking if key != form]
    if asked and lacking:
        rule = shaft.rule if other else "IACS UR M68"
        limits = (
            f"{_and(asked)} {'ask' if len(asked) > 1 else 'asks'} for the stress limits"
            f" of {rule}"
        )
        texts.append(
            f"{limits}, without {_and(lacking)}. Give"
            f" {_and(_ASKED[key] for key in lacking)}."
        )
    unread = form if other else "yield_strength"
    if getattr(shaft, unread) is not None and shaft.rule in RULES:
        texts.append(
            f"{unread} has no part in the limits of {shaft.rule}. Leave it out, or name"
            " another rule."
        )
    return texts


MOST_PRESSURES = (
    1000  # pressure tables on their grid: 0.6 MB each while a scene is checked
)
# Rows of a key over all elements, the shorter lists padded as the longest
MOST_ROWS = 2_000_000


def size_errors(parts) -> list[str]:
    """Find lists that would take more memory than a train may; nothing is computed of
    them.
    """
    errors = []
    for table, elements in parts.tables.items():
        for f in fields_of(elements[0]) if elements else ():
            rows = (
                [getattr(element, f.name) for element in elements]
                if f.metadata["kind"] == "rows"
                else []
            )
            longest = max((len(row) for row in rows if _is_list(row)), default=0)
            if longest * len(rows) > MOST_ROWS:
                told = f"{len(rows)} elements with {f.name} of up to {longest} rows"
                errors.append(
                    f"{parts.source}, [[{table}]]: {told}, must be at most {MOST_ROWS}"
                    " together. Thin them out."
                )
    sources = [c for c in parts.tables["cylinder"] if gas.source(c)]
    tables = len(sources) * max(
        (len(c.traces) for c in sources if _is_list(c.traces)), default=1
    )
    if tables > MOST_PRESSURES:
        told = (
            f"{len(sources)} cylinders need {tables} pressure tables, must be at most"
            f" {MOST_PRESSURES}"
        )
        errors.append(
            f"{parts.source}, [[cylinder]]: {told}. Give some of them gas_torque"
            " instead."
        )
    return errors


def rated_errors(parts, rated_rpm) -> list[str]:
    """Check that the rated speed is there where limits depend on it."""
    shafts = zip(parts.names["shaft"], parts.tables["shaft"], strict=True)
    judged = [name for name, shaft in shafts if shaft.tensile_strength is not None]
    if rated_rpm is not None or not judged:
        return []
    names = _and(map(repr, judged[:8])) + (", …" if len(judged) > 8 else "")
    text = (
        f"the key 'rated_rpm' is missing; the stress limits of {names} depend on the"
        " speed over it"
    )
    return [
        f"{parts.source}, [scene]: {text}. Give the rated speed of the reference rotor"
        " in rpm."
    ]


def cylinder_errors(cylinder) -> list[str]:
    """Check that a cylinder has one source of its gas torque and the numbers this
    source needs.
    """
    found = [key for key in gas.COMPUTED if getattr(cylinder, key) is not None]
    given = cylinder.gas_torque is not None or cylinder.gas_torque_mean is not None
    sources = [*found, *["gas_torque"] * given]
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
    needed = []
    why = found[0] if found else "reciprocating_mass"
    if found:
        needed = ["bore", "stroke", "rod"]
    elif number_like(cylinder.reciprocating_mass) and cylinder.reciprocating_mass > 0:
        needed = ["stroke", "rod"]
    missing = [key for key in needed if getattr(cylinder, key) is None]
    errors += [
        f"the key {key!r} is missing; {why} needs it. Give it in m." for key in missing
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
    if cylinder.load and not {"traces", "combustion"} & set(found):
        errors.append(
            "load is given without traces or combustion, which it acts on. Give scale"
            " instead."
        )
    if number_like(cylinder.fires_every) and cylinder.fires_every > 1 and not found:
        why = (
            "only pressure, traces and combustion tell what a cycle without injection"
            " does"
        )
        errors.append(
            f"fires_every is {cylinder.fires_every:g}, but {why}. Give gas_torque with"
            " orders of its own."
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


def _trace_errors(traces) -> list[str]:
    """Check that traces stand at every pair of their speeds and loads, once, and have
    the same gas cycle.
    """
    traces = [trace for trace in traces if isinstance(trace, Trace)]
    if not all(number_like(trace.rpm) and number_like(trace.load) for trace in traces):
        return []
    count = Counter((float(trace.rpm), float(trace.load)) for trace in traces)
    errors = [
        f"traces: {n} of them are for {rpm:g} rpm and load {load:g}. Keep one."
        for (rpm, load), n in count.items()
        if n > 1
    ]
    speeds, loads = ({key[k] for key in count} for k in (0, 1))
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


def _combustion_errors(combustion) -> list[str]:
    """Check that either the heat or the mean pressure is given, and the strokes of a
    cycle.
    """
    given = [getattr(combustion, key) is not None for key in ("heat", "imep")]
    errors = []
    if all(given):
        errors.append("combustion: heat and imep are both given. Keep one of them.")
    if not any(given):
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
        least = (
            None
            if row_errors(name, columns, table)
            else min((row[1] for row in table), default=1.0)
        )
        if least is not None and least <= 0.0:
            errors.append(
                f"combustion: the least factor of {name} is {least:g}, must be greater"
                " than 0. Correct it."
            )
    if number_like(combustion.stroke_cycle) and combustion.stroke_cycle not in (2, 4):
        errors.append(
            f"combustion: stroke_cycle is {combustion.stroke_cycle:g}, must be 2 or 4."
            " Correct it."
        )
    return errors


TOGETHER = {
    "shaft": (shaft_errors, "stiffness"),
    "mesh": (mesh_errors, "law"),
    "damper": (damper_errors, "stiffness"),
    "torque": (torque_errors, "speed_exponent"),
    "cylinder": (cylinder_errors, "fires"),
}
"""Checks of several fields of an element together, and the field that they put in
doubt.
"""

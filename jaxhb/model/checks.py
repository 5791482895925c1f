"""Checks of single elements on the host: a finding is a sentence with element, value and remedy."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter

import numpy as np

from jaxhb.model import tables
from jaxhb.model.elements import TABLES, SceneError, Unread, table_of
from jaxhb.model.topology import suggestion

LINKS = ("shaft", "mesh")


class Parts:
    """The elements of a scene by table, with the names and places that sentences use.

    ``bad`` collects (table, index, field) of what a sentence was said about; the checks of the whole train leave
    it out. ``complete`` is False where some table of the scene could not be read.
    """

    def __init__(self, elements, source: str, *, complete: bool = True):
        self.source, self.complete, self.bad = source, complete, set()
        self.tables = {table: [] for table in TABLES}
        for element in elements:
            if table_of(element) not in TABLES or not isinstance(element, TABLES[table_of(element)]):
                raise SceneError(f"{source}: {element!r} is no element of a drive train.{suggestion('', TABLES)}")
            self.tables[table_of(element)].append(element)
        self.names = {table: [getattr(e, "name", None) for e in rows] for table, rows in self.tables.items()}
        self._give_names()
        self.disk_names = [*self.names["disk"], *self.names["damper"]]
        self.disk_of = {name: i for i, name in enumerate(self.disk_names) if isinstance(name, str)}
        self._count = Counter(name for name in self.disk_names if isinstance(name, str))

    def _give_names(self):
        count = Counter()
        for table in TABLES:
            for i, element in enumerate(self.tables[table]):
                if self.names[table][i] is not None or table in ("disk", "damper"):
                    continue
                if table in LINKS:
                    ends = element.between if isinstance(element.between, tuple | list) else ()
                    base = "|".join(end if isinstance(end, str) else shown(end) for end in ends)
                else:
                    base = f"{element.disk if isinstance(element.disk, str) else shown(element.disk)}:{table}"
                count[base] += 1
                self.names[table][i] = base if count[base] == 1 else f"{base}#{count[base]}"

    def where(self, table: str, i: int) -> str:
        """Say which element: ``gears.toml, [[shaft]] no. 3 'coupling'``."""
        name = getattr(self.tables[table][i], "name", None)
        return f"{self.source}, [[{table}]] no. {i + 1}{f' {name!r}' if isinstance(name, str) else ''}"

    def usable(self, table: str, i: int, *fields: str) -> bool:
        """Tell whether fields of an element can be computed with."""
        return not any((table, i, name) in self.bad for name in fields)

    def disk(self, name) -> int | None:
        """Index of a disk or ring, None where the name is not that of exactly one."""
        return self.disk_of[name] if isinstance(name, str) and self._count[name] == 1 else None

    def links(self, table: str) -> list[tuple[int, tuple[int, int]]]:
        """Index and disks of the links of a table whose ends are known."""
        found = []
        for i, element in enumerate(self.tables[table]):
            pair = element.between if isinstance(element.between, tuple | list) else ()
            ends = tuple(self.disk(name) for name in pair)
            if len(ends) == 2 and None not in ends and ends[0] != ends[1]:
                found.append((i, ends))
        return found

    def seats(self, table: str) -> list[tuple[int, int]]:
        """Index and disk of the elements of a table that sit on a known disk, not on their own ring."""
        found = [(i, self.disk(element.disk)) for i, element in enumerate(self.tables[table])]
        rings = len(self.tables["disk"])
        return [(i, d) for i, d in found if d is not None and not (table == "damper" and d == rings + i)]

    def ends(self, table: str) -> list[tuple[int, int]]:
        """Pairs of disks that the links of a table join."""
        return [ends for _, ends in self.links(table)]

    def sits_on(self, table: str) -> list[int]:
        """Disks that the elements of a table sit on."""
        return [disk for _, disk in self.seats(table)]

    @property
    def connected(self) -> bool:
        """Tell whether it is known what every link joins."""
        found = [(self.tables[t], self.links(t)) for t in LINKS]
        found.append((self.tables["damper"], self.seats("damper")))
        known = all(len(rows) == len(known) for rows, known in found)
        return self.complete and known and all(self.disk(name) is not None for name in self.disk_names)


def shown(value) -> str:
    """Write a value into a sentence, in short."""
    if isinstance(value, int) and value.bit_length() > 1023:
        return f"an integer of about {int(value.bit_length() * math.log10(2.0)) + 1} digits"
    try:
        text = repr(value)
    except ValueError:
        return "a value too long to be written"
    return text if len(text) <= 100 else f"{text[:100]}…"


def number_like(value) -> bool:
    """Tell whether a value is a number and no truth value."""
    if isinstance(value, bool):
        return False
    try:
        float(value)
    except (TypeError, ValueError, OverflowError):
        return False
    return not isinstance(value, str)


def element_errors(parts: Parts) -> list[str]:
    """Find what is wrong with each element by itself: keys, values, rows; and mark it in ``parts.bad``."""
    errors = []
    special = {"mesh": (_mesh_errors, "law"), "cylinder": (_cylinder_errors, "fires")}
    special["damper"] = (_damper_errors, "stiffness")
    for table, rows in parts.tables.items():
        for i, element in enumerate(rows):
            where = parts.where(table, i)
            for f in dataclasses.fields(element):
                found = _field_errors(where, f, getattr(element, f.name))
                if found is not None:
                    parts.bad.add((table, i, f.name))
                    errors += found
            if table in special:
                check, field = special[table]
                found = check(element)
                if found:
                    parts.bad.add((table, i, field))
                    errors += [f"{where}: {text}" for text in found]
    return errors


def _field_errors(where, f, value) -> list[str] | None:
    """Sentences on one field; None where it is sound, none where they have been said already."""
    if isinstance(value, Unread):
        return []
    if value is None:
        return [_missing(where, f)] if f.default is not None else None
    return [f"{where}: {text}" for text in _value_errors(f, value)] or None


def _missing(where, f) -> str:
    """Sentence for a key that is not there."""
    limits = f.metadata.get("range")
    kinds = {
        "name": "a text, unique over all tables",
        "disk": "the name of a disk",
        "pair": "the names of two disks",
    }
    wanted = limits.words() if limits else kinds.get(f.metadata["kind"], "a value")
    return f"{where}: the key {f.name!r} is missing. Give {wanted}."


def _value_errors(f, value) -> list[str]:
    """Check one value against the kind and the range of its field."""
    kind = f.metadata["kind"]
    if kind in ("number", "count"):
        return value_errors(f, value)
    if kind in ("name", "disk") and not (isinstance(value, str) and value):
        return [f"{f.name} is {shown(value)}, must be a text."]
    if kind == "pair":
        good = isinstance(value, tuple | list) and len(value) == 2 and all(isinstance(v, str) for v in value)
        return [] if good else [f"{f.name} is {shown(value)}, must be the names of two disks."]
    if kind == "flag" and not isinstance(value, bool):
        return [f"{f.name} is {shown(value)}, must be true or false."]
    if kind == "choice" and value not in f.metadata["words"]:
        words = [w for w in f.metadata["words"] if w]
        return [f"{f.name} is {shown(value)}, must be {' or '.join(repr(w) for w in words)}.{suggestion(value, words)}"]
    if kind == "rows":
        return _row_errors(f.name, f.metadata["columns"], value)
    return []


def value_errors(f, value) -> list[str]:
    """Check a number against the range in its field's metadata; sentences without the element."""
    limits = f.metadata["range"]
    unit = f" {limits.unit}" if limits.unit else ""
    if isinstance(value, int) and not isinstance(value, bool) and not number_like(value):
        return [f"{f.name} is {shown(value)}{unit}, must be a finite number."]
    if not number_like(value):
        return [f"{f.name} is {shown(value)}, must be a number{f' in {limits.unit}' if limits.unit else ''}."]
    number = float(value)
    if not math.isfinite(number):
        return [f"{f.name} is {number}{unit}, must be a finite number."]
    if f.metadata["kind"] == "count" and number != int(number):
        return [f"{f.name} is {number:g}, must be a whole number."]
    if not limits.contains(number):
        remedy = f" {limits.remedy}" if limits.remedy else " Correct the value or leave the key out."
        if f.default is dataclasses.MISSING and not limits.remedy:
            remedy = " Correct the value."
        return [f"{f.name} is {number:g}{unit}, must be {limits.words()}.{remedy}"]
    return []


def _row_errors(name, columns, rows) -> list[str]:
    """Check a table of numbers: its columns, finiteness, and the growth of its first column."""
    wanted = ", ".join(columns)
    if not isinstance(rows, tuple | list):
        return [f"{name} is {shown(rows)}, must be a list of rows [{wanted}]."]
    for k, row in enumerate(rows):
        good = isinstance(row, tuple | list) and len(row) == len(columns) and all(number_like(v) for v in row)
        if not good:
            return [f"{name}, row {k + 1} is {shown(row)}, must be {len(columns)} numbers [{wanted}]."]
        if not all(math.isfinite(float(v)) for v in row):
            return [f"{name}, row {k + 1} is {shown(list(row))}, must be finite numbers."]
    first = [float(row[0]) for row in rows]
    if columns[0] == "order":
        errors = [
            f"{name}, row {k + 1}: order is {order:g}, must be greater than 0. Give the mean by its own key."
            for k, order in enumerate(first)
            if order <= 0.0
        ]
        errors += [f"{name}: order {o:g} stands {n} times. Add the rows." for o, n in Counter(first).items() if n > 1]
        return errors
    for k in range(1, len(first)):
        if first[k] <= first[k - 1]:
            text = f"{columns[0]} {first[k]:g} after {first[k - 1]:g}; must increase. Sort the rows."
            return [f"{name}, row {k + 1}: {text}"]
    if columns[0] in ("hz", "amplitude"):
        return _factor_errors(name, columns, rows)
    if columns[0] == "rpm" and first and first[0] < 0.0:
        return [f"{name}, row 1: rpm is {first[0]:g}, must be at least 0. Speeds are positive; correct the row."]
    return _span_errors(name, first, rows) if columns[0] == "angle" else []


def _factor_errors(name, columns, rows) -> list[str]:
    """Check the signs of rows (frequency or amplitude, factor of stiffness, factor of damping)."""
    limits = {columns[0]: ("at least 0", 0.0), columns[2]: ("at least 0", 0.0), columns[1]: ("greater than 0", 5e-324)}
    return [
        f"{name}, row {k + 1}: {column} is {row[columns.index(column)]:g}, must be {words}. Correct the row."
        for k, row in enumerate(rows)
        for column, (words, least) in limits.items()
        if not row[columns.index(column)] >= least
    ]


def _span_errors(name, angle, rows) -> list[str]:
    """Check that a pressure table covers one gas cycle, but for one step at the most."""
    if len(angle) < 2:
        return [f"{name} has {len(angle)} rows, needs at least 2."]
    span = angle[-1] - angle[0]
    if span > 720.0 + 1e-9:
        return [f"{name} spans {span:g} deg, must span at most 720 deg. Give one gas cycle."]
    period = 720.0 if tables.is_four_stroke(rows) else 360.0
    steps = np.diff(angle)
    step = min(max(float(np.median(steps)), steps[0], steps[-1]), period / 8.0)
    if span >= period - step - 1e-6:
        return []
    return [
        f"{name} covers {angle[0]:g} to {angle[-1]:g} deg, must cover a whole gas cycle of {period:g} deg but for one"
        f" step ({step:g} deg). Add the missing angles; four-stroke tables span 720 deg, two-stroke tables 360 deg"
        " within -360 to 360 deg."
    ]


def _mesh_errors(mesh) -> list[str]:
    """Check what the law of a mesh is made of."""
    both = [key for key in ("epsilon", "transition") if getattr(mesh, key) is not None]
    if mesh.law and both:
        return [f"law = {shown(mesh.law)} is given together with {' and '.join(both)}. Keep one of them."]
    return []


def _damper_errors(damper) -> list[str]:
    """Check that a damper's ring is held by something."""
    if damper.stiffness == 0 and damper.damping == 0 and damper.order is None:
        return ["damping and stiffness are both 0, so that the ring is loose. Give at least one of them."]
    return []


def _cylinder_errors(cylinder) -> list[str]:
    """Check that a cylinder has one source of its gas torque and the geometry this source needs."""
    given = cylinder.gas_torque is not None or cylinder.gas_torque_mean is not None
    errors = []
    if cylinder.pressure is not None and given:
        errors.append("pressure and gas_torque are both given. Keep one of them.")
    if cylinder.fires is True and cylinder.pressure is None and not given:
        errors.append("neither pressure nor gas_torque is given. Give one of them, or set fires = false.")
    needed = []
    if cylinder.pressure is not None:
        needed = ["bore", "stroke", "rod"]
    elif number_like(cylinder.reciprocating_mass) and cylinder.reciprocating_mass > 0:
        needed = ["stroke", "rod"]
    why = "pressure" if cylinder.pressure is not None else "reciprocating_mass"
    missing = [key for key in needed if getattr(cylinder, key) is None]
    errors += [f"the key {key!r} is missing; {why} needs it. Give it in m." for key in missing]
    if number_like(cylinder.rod) and number_like(cylinder.stroke) and cylinder.rod <= cylinder.stroke / 2:
        errors.append(
            f"rod is {cylinder.rod:g} m, must be longer than half the stroke ({cylinder.stroke / 2:g} m)."
            " Correct rod or stroke."
        )
    return errors


def name_errors(parts: Parts) -> list[str]:
    """Find names that stand for several elements."""
    places = {}
    for table in TABLES:
        for i, name in enumerate(parts.names[table]):
            if isinstance(name, str):
                places.setdefault(name, []).append((table, i))
    errors = []
    for name, found in places.items():
        if len(found) > 1:
            first = f"[[{found[0][0]}]] no. {found[0][1] + 1}"
            for table, i in found[1:]:
                errors.append(
                    f"{parts.source}, [[{table}]] no. {i + 1}: the name {name!r} is taken by {first}. Rename."
                )
    return errors


def reference_errors(parts: Parts, reference) -> list[str]:
    """Find references to disks that do not exist, and links that join a disk to itself."""
    errors = []
    known = [name for name in parts.disk_names if isinstance(name, str)]
    if not parts.tables["disk"]:
        errors.append(f"{parts.source}: there is no [[disk]]. Give at least one.")
    for table, rows in parts.tables.items():
        for i, element in enumerate(rows):
            pair = getattr(element, "between", None) if table in LINKS else (getattr(element, "disk", None),)
            ends = [end for end in pair if isinstance(end, str)] if isinstance(pair, tuple | list) else []
            for end in ends:
                if end not in parts.disk_of:
                    text = f"there is no disk {end!r}.{suggestion(end, known)}"
                    errors.append(f"{parts.where(table, i)}: {text}")
            if len(ends) == 2 and ends[0] == ends[1]:
                errors.append(f"{parts.where(table, i)}: it joins {ends[0]!r} to itself. Name two different disks.")
            if table == "damper" and ends and ends[0] == element.name:
                errors.append(f"{parts.where(table, i)}: it sits on itself. Name the disk that carries it.")
    if reference is not None and not (isinstance(reference, str) and reference in parts.disk_of):
        errors.append(
            f"{parts.source}, [scene]: reference: there is no disk {shown(reference)}.{suggestion(reference, known)}"
        )
    return errors

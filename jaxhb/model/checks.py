"""Checks of single elements on the host: a finding is a sentence with element, value and remedy."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter

from jaxhb.model.elements import TABLES, SceneError, table_of
from jaxhb.model.topology import suggestion

LINKS = ("shaft", "mesh")


class Parts:
    """The elements of a scene by table, with the names and places that sentences use."""

    def __init__(self, elements, source: str):
        self.source = source
        self.tables = {table: [] for table in TABLES}
        for element in elements:
            if table_of(element) not in TABLES or not isinstance(element, TABLES[table_of(element)]):
                raise SceneError(f"{source}: {element!r} is no element of a drive train.{suggestion('', TABLES)}")
            self.tables[table_of(element)].append(element)
        self.names = {table: [getattr(e, "name", None) for e in rows] for table, rows in self.tables.items()}
        self._give_names()
        self.disk_names = [*self.names["disk"], *self.names["damper"]]
        self.disk_of = {name: i for i, name in enumerate(self.disk_names) if isinstance(name, str)}

    def _give_names(self):
        count = Counter()
        for table in TABLES:
            for i, element in enumerate(self.tables[table]):
                if self.names[table][i] is not None or table in ("disk", "damper"):
                    continue
                if table in LINKS:
                    ends = element.between if isinstance(element.between, tuple | list) else ()
                    base = "|".join(str(end) for end in ends)
                else:
                    base = f"{element.disk}:{table}"
                count[base] += 1
                self.names[table][i] = base if count[base] == 1 else f"{base}#{count[base]}"

    def where(self, table: str, i: int) -> str:
        """Say which element: ``gears.toml, [[shaft]] no. 3 'coupling'``."""
        name = getattr(self.tables[table][i], "name", None)
        return f"{self.source}, [[{table}]] no. {i + 1}{f' {name!r}' if isinstance(name, str) else ''}"

    def disk(self, name) -> int:
        """Index of a disk or ring."""
        return self.disk_of[name]

    def ends(self, table: str) -> list[tuple[int, int]]:
        """Disk indices that the links of a table join."""
        return [(self.disk_of[e.between[0]], self.disk_of[e.between[1]]) for e in self.tables[table]]

    def sits_on(self, table: str) -> list[int]:
        """Disk index that each element of a table sits on."""
        return [self.disk_of[e.disk] for e in self.tables[table]]


def number_like(value) -> bool:
    """Tell whether a value is a number and no truth value."""
    if isinstance(value, bool):
        return False
    try:
        float(value)
    except (TypeError, ValueError):
        return False
    return not isinstance(value, str)


def element_errors(parts: Parts) -> list[str]:
    """Find what is wrong with each element by itself: keys, values, rows."""
    errors = []
    for table, rows in parts.tables.items():
        for i, element in enumerate(rows):
            where = parts.where(table, i)
            for f in dataclasses.fields(element):
                value = getattr(element, f.name)
                required = f.default is dataclasses.MISSING
                if value is None:
                    if required:
                        errors.append(_missing(where, f))
                    continue
                errors += [f"{where}: {text}" for text in _value_errors(f, value)]
            special = {"mesh": _mesh_errors, "cylinder": _cylinder_errors, "damper": _damper_errors}
            if table in special:
                errors += [f"{where}: {text}" for text in special[table](element)]
    return errors


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
        return [f"{f.name} is {value!r}, must be a text."]
    if kind == "pair":
        good = isinstance(value, tuple | list) and len(value) == 2 and all(isinstance(v, str) for v in value)
        return [] if good else [f"{f.name} is {value!r}, must be the names of two disks."]
    if kind == "flag" and not isinstance(value, bool):
        return [f"{f.name} is {value!r}, must be true or false."]
    if kind == "choice" and value not in f.metadata["words"]:
        words = [w for w in f.metadata["words"] if w]
        return [f"{f.name} is {value!r}, must be {' or '.join(repr(w) for w in words)}.{suggestion(value, words)}"]
    if kind == "rows":
        return _row_errors(f.name, f.metadata["columns"], value)
    return []


def value_errors(f, value) -> list[str]:
    """Check a number against the range in its field's metadata; sentences without the element."""
    limits = f.metadata["range"]
    unit = f" {limits.unit}" if limits.unit else ""
    if not number_like(value):
        return [f"{f.name} is {value!r}, must be a number{f' in {limits.unit}' if limits.unit else ''}."]
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
        return [f"{name} is {rows!r}, must be a list of rows [{wanted}]."]
    errors = []
    for k, row in enumerate(rows):
        good = isinstance(row, tuple | list) and len(row) == len(columns) and all(number_like(v) for v in row)
        if not good:
            return [f"{name}, row {k + 1} is {row!r}, must be {len(columns)} numbers [{wanted}]."]
        if not all(math.isfinite(float(v)) for v in row):
            return [f"{name}, row {k + 1} is {list(row)}, must be finite numbers."]
    first = [float(row[0]) for row in rows]
    if columns[0] == "order":
        errors += [
            f"{name}, row {k + 1}: order is {order:g}, must be greater than 0. Give the mean by its own key."
            for k, order in enumerate(first)
            if order <= 0.0
        ]
        errors += [f"{name}: order {o:g} stands {n} times. Add the rows." for o, n in Counter(first).items() if n > 1]
        return errors
    for k in range(1, len(first)):
        if first[k] <= first[k - 1]:
            errors.append(
                f"{name}, row {k + 1}: {columns[0]} {first[k]:g} after {first[k - 1]:g}; must increase. Sort the rows."
            )
            break
    if name == "pressure" and len(first) < 2:
        errors.append(f"{name} has {len(first)} rows, needs at least 2.")
    if name == "pressure" and first and first[-1] - first[0] > 720.0 + 1e-9:
        errors.append(f"{name} spans {first[-1] - first[0]:g} deg, must span at most 720 deg. Give one gas cycle.")
    return errors


def _mesh_errors(mesh) -> list[str]:
    """Check what the law of a mesh is made of."""
    both = [key for key in ("epsilon", "transition") if getattr(mesh, key) is not None]
    if mesh.law and both:
        return [f"law = {mesh.law!r} is given together with {' and '.join(both)}. Keep one of them."]
    return []


def _damper_errors(damper) -> list[str]:
    """Check that a damper's ring is held by something."""
    if damper.stiffness == 0 and damper.damping == 0:
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
            f"{parts.source}, [scene]: reference: there is no disk {reference!r}.{suggestion(reference, known)}"
        )
    return errors

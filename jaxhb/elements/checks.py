"""Checks of single elements on the host: a finding is a sentence with element, value
and remedy.

Scenarios are named sets of values of a scene, as a coupling that is warm or worn:
``[scenario.NAME]`` holds ``"ELEMENT.FIELD" = value`` or ``ELEMENT.FIELD = value``, in
the units of the scene, ``CYLINDER.fires``, ``CYLINDER.combustion.FIELD`` and, with the
orders of the scene, ``harmonics`` or ``gas_torque``. ``without = [ELEMENT, ...]``
leaves elements out, as a clutch that is open.
"""

import dataclasses
from collections import Counter, defaultdict
from functools import cached_property

from jaxhb.elements.elements import (
    TABLES,
    Combustion,
    SceneError,
    Suggestions,
    cut,
    fields_of,
    shown,
    suggestion,
    table_of,
)
from jaxhb.elements.engine import Engine, cylinders, engine_errors
from jaxhb.elements.value_checks import TOGETHER, field_errors, row_errors


def read_scenarios(parts, scenarios) -> tuple[dict, list[str]]:
    """Values by scenario and ``"ELEMENT.FIELD"``, and sentences on what names no number
    of an element.
    """
    if scenarios is None:
        return {}, []
    if not isinstance(scenarios, dict) or not all(
        isinstance(values, dict) for values in scenarios.values()
    ):
        return {}, [
            f"{parts.source}: 'scenario' must hold a table for each scenario. Write"
            " [scenario.NAME]."
        ]
    found = {name: dict(_flat(values)) for name, values in scenarios.items()}
    # Of two tables with one name the first counts; the name has its own sentence.
    places = {
        n: (t, i)
        for t in reversed(TABLES)
        for i, n in enumerate(parts.names[t])
        if isinstance(n, str)
    }
    near = Suggestions(places)
    errors = [
        f"{parts.source}, [scenario.{cut(name)}]: {text}"
        for name, values in found.items()
        for key, value in values.items()
        for text in _errors(parts, places, near, key, value)
    ]
    return found, errors


def _flat(values, before=""):
    """Pairs of dotted keys and values of nested tables."""
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


def _errors(parts, places, near, key, value) -> list[str]:
    name, dot, field = key.rpartition(".")
    if key == "without":
        names = value if isinstance(value, list) else [value]
        lost = [n for n in names if not (isinstance(n, str) and n in places)]
        return [f"without: there is no element {shown(n)}.{near(n)}" for n in lost]
    if not dot:
        return [
            f"{shown(key)} names no field. Write 'NAME.FIELD', as 'coupling.stiffness'."
        ]
    outer, _, inner = name.rpartition(".")
    # A name may hold dots: an element called so goes before a table inside an element.
    if name not in places and inner == "combustion" and outer in places:
        return _combustion_errors(parts, places[outer], outer, field, value)
    if name not in places:
        return [f"there is no element {shown(name)} in {shown(key)}.{near(name)}"]
    (table, i) = places[name]
    taken = ("number", "flag")
    fields = {
        f.name: f
        for f in dataclasses.fields(TABLES[table])
        if f.metadata["kind"] in taken
    }
    if field in ("harmonics", "gas_torque") and (
        rows := getattr(parts.tables[table][i], field, None)
    ):
        errors = row_errors(field, ("order", "Re", "Im"), value)
        orders = [row[0] for row in rows]
        if errors or [row[0] for row in value] == orders:
            return [f"{name!r}: {text}" for text in errors]
        return [
            f"{key} has other orders than the scene, must have"
            f" {', '.join(f'{o:g}' for o in orders)}, in this order."
        ]
    if field not in fields:
        return [
            f"a [[{table}]] as {name!r} has no number"
            f" {shown(field)}.{suggestion(field, fields)}"
        ]
    if isinstance(value, list):
        return [f"{key} is {shown(value)}, must be a number."]
    return field_errors(repr(name), fields[field], value) or []


def _combustion_errors(parts, place, name, field, value) -> list[str]:
    """The same of a number of the combustion of a cylinder."""
    table, i = place
    combustion = getattr(parts.tables[table][i], "combustion", None)
    if not isinstance(combustion, Combustion):
        return [f"{name!r} has no combustion. Build the scene with one."]
    fields = {
        f.name: f
        for f in dataclasses.fields(combustion)
        if f.metadata["kind"] == "number"
    }
    if field not in fields:
        return [
            f"the combustion of {name!r} has no number"
            f" {field!r}.{suggestion(field, fields)}"
        ]
    if isinstance(value, list):
        return [f"{name}.combustion.{field} is {shown(value)}, must be a number."]
    return field_errors(f"{name!r}, combustion", fields[field], value) or []


LINKS = ("shaft", "mesh")


class Parts:
    """The elements of a scene by table, with the names and places that sentences use.

    ``bad`` collects (table, index, field) of what a sentence was said about; the checks
    of the whole train leave it out. ``complete`` is False where some table of the scene
    could not be read. Engines are replaced by their cylinders, which come last;
    ``engine_errors`` are sentences on those that cannot be.
    """

    def __init__(self, elements, source: str, *, complete: bool = True):
        self.source, self.complete, self.bad = source, complete, set()
        self.tables = {table: [] for table in TABLES}
        engines = [element for element in elements if isinstance(element, Engine)]
        for element in elements:
            if isinstance(element, Engine):
                continue
            if table_of(element) not in TABLES or not isinstance(
                element, TABLES[table_of(element)]
            ):
                raise SceneError(
                    f"{source}: {element!r} is no element of a drive"
                    f" train.{suggestion('', TABLES)}"
                )
            self.tables[table_of(element)].append(element)
        self._put_engines(engines)
        self.names = {
            table: [getattr(e, "name", None) for e in rows]
            for table, rows in self.tables.items()
        }
        self._give_names()
        self.disk_names = [*self.names["disk"], *self.names["damper"]]
        self.disk_of = {
            name: i for i, name in enumerate(self.disk_names) if isinstance(name, str)
        }
        self._count = Counter(name for name in self.disk_names if isinstance(name, str))
        # What joins the disks is settled here, and asked for by every check.
        self._links = {}
        self._seats = {}

    def _put_engines(self, engines):
        """Put the cylinders of engines behind those of the scene."""
        given = list(self.tables["cylinder"])
        self.engine_errors = []
        self._engine_of = [""] * len(given)
        known = [
            e.name
            for table in ("disk", "damper")
            for e in self.tables[table]
            if isinstance(e.name, str)
        ]
        for engine in engines:
            name = f" {engine.name!r}" if isinstance(engine.name, str) else ""
            where = f"{self.source}, [engine]{name}"
            errors = engine_errors(engine, where, known)
            disks = engine.disks if isinstance(engine.disks, tuple | list) else ()
            for i, cylinder in enumerate(given):
                if cylinder.disk in disks:
                    text = (
                        f"it sits on {cylinder.disk!r}, a disk of an [engine], which"
                        " makes its cylinders"
                    )
                    errors.append(
                        f"{self.where('cylinder', i)}: {text}. Remove one of them."
                    )
            if errors:
                # Its cylinders are missing: what follows from that is no fault of the
                # train.
                self.complete = False
                self.engine_errors += errors
                continue
            made = cylinders(engine)
            self.tables["cylinder"] += made
            self._engine_of += [where] * len(made)

    def rows(self):
        """Table, number and element of all elements."""
        return (
            (table, i, element)
            for table, rows in self.tables.items()
            for i, element in enumerate(rows)
        )

    def _give_names(self):
        count = Counter()
        for table, i, element in self.rows():
            if self.names[table][i] is not None or table in ("disk", "damper", "phase"):
                continue
            if table in LINKS:
                ends = (
                    element.between if isinstance(element.between, tuple | list) else ()
                )
                base = "|".join(
                    end if isinstance(end, str) else shown(end) for end in ends
                )
            else:
                named = isinstance(element.disk, str)
                disk = element.disk if named else shown(element.disk)
                base = f"{disk}:{table}"
            count[base] += 1
            self.names[table][i] = base if count[base] == 1 else f"{base}#{count[base]}"

    def where(self, table: str, i: int) -> str:
        """Say which element: ``gears.toml, [[shaft]] no. 3 'coupling'``."""
        if table == "cylinder" and self._engine_of[i]:
            return self._engine_of[i]
        name = getattr(self.tables[table][i], "name", None)
        return (
            f"{self.source}, [[{table}]] no."
            f" {i + 1}{f' {shown(name)}' if isinstance(name, str) else ''}"
        )

    def usable(self, table: str, i: int, *fields: str) -> bool:
        """Tell whether fields of an element can be computed with."""
        return not any((table, i, name) in self.bad for name in fields)

    def disk(self, name) -> int | None:
        """Index of a disk or ring, None where the name is not that of exactly one."""
        return (
            self.disk_of[name]
            if isinstance(name, str) and self._count[name] == 1
            else None
        )

    def links(self, table: str) -> list[tuple[int, tuple[int, int]]]:
        """Index and disks of the links of a table whose ends are known."""
        if table not in self._links:
            found = []
            for i, element in enumerate(self.tables[table]):
                pair = (
                    element.between if isinstance(element.between, tuple | list) else ()
                )
                ends = [disk for disk in map(self.disk, pair) if disk is not None]
                if len(pair) == len(ends) == 2 and ends[0] != ends[1]:
                    found.append((i, (ends[0], ends[1])))
            self._links[table] = found
        return self._links[table]

    def seats(self, table: str) -> list[tuple[int, int]]:
        """Index and disk of the elements of a table that sit on a known disk, not on
        their own ring.
        """
        if table not in self._seats:
            found = [
                (i, self.disk(element.disk))
                for i, element in enumerate(self.tables[table])
            ]
            rings = len(self.tables["disk"])
            own = {i: rings + i for i, _ in found} if table == "damper" else {}
            self._seats[table] = [
                (i, d) for i, d in found if d is not None and d != own.get(i)
            ]
        return self._seats[table]

    def phased(self, i: int) -> dict[str, list[int]]:
        """Cylinders and torques that a phase names, by table; of a name that is none,
        the cylinders of that engine.
        """
        named = self.tables["phase"][i].of
        named = (
            {name for name in named if isinstance(name, str)}
            if isinstance(named, tuple | list)
            else set()
        )
        return {
            table: sorted({k for name in named for k in at.get(name, ())})
            for table, at in self._phased.items()
        }

    @cached_property
    def _phased(self) -> dict[str, dict[str, list[int]]]:
        """Cylinders and torques by the names that a phase may give: their own, and for
        cylinders that of the engine.
        """
        found: dict[str, dict[str, list[int]]] = {
            "cylinder": defaultdict(list),
            "torque": defaultdict(list),
        }
        for table, at in found.items():
            for k, name in enumerate(self.names[table]):
                at[str(name)].append(k)
        for k, name in enumerate(self.names["cylinder"]):
            # "port" is the engine of the cylinders "port 1", "port A2", ...
            found["cylinder"][str(name).rpartition(" ")[0]].append(k)
        return found

    def ends(self, table: str) -> list[tuple[int, int]]:
        """Pairs of disks that the links of a table join."""
        return [ends for _, ends in self.links(table)]

    def sits_on(self, table: str) -> list[int]:
        """Disks that the elements of a table sit on."""
        return [disk for _, disk in self.seats(table)]

    @property
    def connected(self) -> bool:
        """Tell whether it is known what every link joins."""
        found = [(self.tables[t], len(self.links(t))) for t in LINKS]
        found.append((self.tables["damper"], len(self.seats("damper"))))
        known = all(len(rows) == known for rows, known in found)
        return (
            self.complete
            and known
            and all(self.disk(name) is not None for name in self.disk_names)
        )


def element_errors(parts: Parts) -> list[str]:
    """Find what is wrong with each element by itself: keys, values, rows; and mark it
    in ``parts.bad``.
    """
    errors = []
    for table, i, element in parts.rows():
        where = parts.where(table, i)
        for f in fields_of(element):
            value = getattr(element, f.name)
            # Defaults are sound.
            found = None if value is f.default else field_errors(where, f, value)
            if found is not None:
                parts.bad.add((table, i, f.name))
                errors += found
        check, field = TOGETHER.get(table, (lambda element: [], ""))
        if found := check(element):
            parts.bad.add((table, i, field))
            errors += [f"{where}: {text}" for text in found]
    return errors


def name_errors(parts: Parts) -> list[str]:
    """Find names that stand for several elements."""
    first = {}
    errors = []
    for table in TABLES:
        for i, name in enumerate(parts.names[table]):
            place = f"[[{table}]] no. {i + 1}"
            if isinstance(name, str) and first.setdefault(name, place) != place:
                errors.append(
                    f"{parts.source}, {place}: the name {shown(name)} is taken by"
                    f" {first[name]}. Rename."
                )
    return errors


def reference_errors(parts: Parts, reference, *, disks_read: bool) -> list[str]:
    """Find references to disks that do not exist, if all were read, and links that join
    a disk to itself.
    """
    errors = []
    known = [name for name in parts.disk_names if isinstance(name, str)]
    near = Suggestions(known)
    if disks_read and not parts.tables["disk"]:
        errors.append(f"{parts.source}: there is no [[disk]]. Give at least one.")
    for table, i, element in parts.rows():
        where = parts.where(table, i)
        pair = getattr(element, "between", (getattr(element, "disk", None),))
        ends = (
            [end for end in pair if isinstance(end, str)]
            if isinstance(pair, tuple | list)
            else []
        )
        unknown = (
            [end for end in ends if end not in parts.disk_of] if disks_read else []
        )
        errors += [
            f"{where}: there is no disk {shown(end)}.{near(end)}" for end in unknown
        ]
        if len(ends) == 2 and ends[0] == ends[1]:
            errors.append(
                f"{where}: it joins {shown(ends[0])} to itself. Name two different"
                " disks."
            )
        if table == "damper" and ends and ends[0] == element.name:
            errors.append(f"{where}: it sits on itself. Name the disk that carries it.")
    if (
        disks_read
        and reference is not None
        and not (isinstance(reference, str) and reference in parts.disk_of)
    ):
        errors.append(
            f"{parts.source}, [scene]: reference: there is no disk"
            f" {shown(reference)}.{near(reference)}"
        )
    return errors

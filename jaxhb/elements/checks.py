"""Checks of single elements on the host: a finding is a sentence with element, value
and remedy.

Scenarios are named sets of values of a scene, as a coupling that is warm or worn:
``[scenario.NAME]`` holds ``"ELEMENT.FIELD" = value`` or ``ELEMENT.FIELD = value``, in
the units of the scene, ``CYLINDER.fires``, ``CYLINDER.combustion.FIELD``, with the
orders of the scene ``harmonics`` or ``gas_torque``, and with as many rows as the scene
``damping_over_rpm``, ``stiffness_over_rpm`` and ``lines``. ``without = [ELEMENT, ...]``
leaves elements out, as a clutch that is open.
"""

from __future__ import annotations

import dataclasses
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

from jaxhb.elements.declared import HARMONICS, fields_of, fields_of_class, table_of
from jaxhb.elements.elements import TABLES
from jaxhb.elements.engine import Engine, cylinders, engine_errors
from jaxhb.elements.excitations import EXCITATIONS
from jaxhb.elements.rules.chosen import Chosen
from jaxhb.elements.rules.margins import MARGINS
from jaxhb.elements.sentences import SceneError, Suggestions, cut, shown, suggestion
from jaxhb.elements.units import si_value
from jaxhb.elements.value_checks import TOGETHER, present_keys, rule_errors
from jaxhb.elements.values import (
    field_errors,
    is_list,
    joined,
    plain_number,
    row_errors,
)


def read_scenarios(
    parts: Parts, scenarios: Any
) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """Values by scenario and ``"ELEMENT.FIELD"``, and sentences on keys that name no
    number of an element.
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
    by_name = {name: dict(_flat(values)) for name, values in scenarios.items()}
    # The first of two tables with one name counts; the name has its own sentence.
    places = {
        element_name: (table, index)
        for table in reversed(TABLES)
        for index, element_name in enumerate(parts.names[table])
        if isinstance(element_name, str)
    }
    by_name = {
        name: {key: _in_si(places, key, value) for key, value in values.items()}
        for name, values in by_name.items()
    }
    near = Suggestions(places)
    errors = [
        f"{parts.source}, [scenario.{cut(name)}]: {text}"
        for name, values in by_name.items()
        for key, value in values.items()
        for text in _scenario_errors(parts, places, near, key, value)
    ]
    return by_name, errors


def _in_si(places: Mapping[str, tuple[str, int]], key: str, value: Any) -> Any:
    """A value of a scenario, with a unit in the unit of its field."""
    name, _, field = key.rpartition(".")
    outer, _, inner = name.rpartition(".")
    cls = TABLES[places[name][0]] if name in places else None
    if cls is None and outer in places:
        cls = INNER.get(inner)
    declared = None if cls is None else fields_of_class(cls).get(field)
    if cls is None or declared is None:
        return value
    return si_value(cls, declared, value)


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Pairs of dotted keys and values of nested tables."""
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _scenario_errors(
    parts: Parts,
    places: Mapping[str, tuple[str, int]],
    near: Suggestions,
    key: str,
    value: Any,
) -> list[str]:
    """Sentences on one key of a scenario and its value."""
    name, dot, field = key.rpartition(".")
    if key == "without":
        names = value if isinstance(value, list) else [value]
        unknown = [
            element
            for element in names
            if not (isinstance(element, str) and element in places)
        ]
        return [
            f"without: there is no element {shown(element)}.{near(element)}"
            for element in unknown
        ]
    if not dot:
        return [
            f"{shown(key)} names no field. Write 'NAME.FIELD', as 'coupling.stiffness'."
        ]
    outer, _, inner = name.rpartition(".")
    # A name may hold dots: an element called so goes before a table inside an element.
    if name not in places and inner in INNER and outer in places:
        return _inner_errors(parts, places[outer], name, field, value)
    if name not in places:
        return [f"there is no element {shown(name)} in {shown(key)}.{near(name)}"]
    (table, index) = places[name]
    if field in WHOLE_ROWS and field in fields_of_class(TABLES[table]):
        return _row_errors(parts, places[name], key, value)
    has_orders = field in ORDER_ROWS
    rows = getattr(parts.tables[table][index], field, None) if has_orders else None
    if rows:
        errors = row_errors(field, HARMONICS, value)
        orders = [row[0] for row in rows]
        if errors or [row[0] for row in value] == orders:
            return [f"{name!r}: {text}" for text in errors]
        listed = ", ".join(f"{order:g}" for order in orders)
        return [
            f"{key} has other orders than the scene, must have {listed}, in this order."
        ]
    return _number_errors(
        TABLES[table],
        ("number", "flag"),
        (key, field, value),
        f"a [[{table}]] as {name!r}",
        repr(name),
    )


def _row_errors(
    parts: Parts, place: tuple[str, int], key: str, value: Any
) -> list[str]:
    """Sentences on rows that stand whole in a scenario, ``key`` = "NAME.lines"."""
    table, index = place
    name, _, field = key.rpartition(".")
    element = parts.tables[table][index]
    rows = getattr(element, field)
    if not rows:
        return [f"{name!r} has no {field}. Build the scene with such rows."]
    texts = field_errors(repr(name), fields_of_class(TABLES[table])[field], value)
    if texts is not None or not parts.usable(table, index, field):
        return texts or []
    if len(value) != len(rows):
        counts = f"{len(value)}, must be {len(rows)}, as many as in the scene"
        return [f"the number of rows of {key} is {counts}."]
    check = TOGETHER[table][0]
    before = check(element)
    changed = dataclasses.replace(element, **{field: value})
    return [f"{name!r}: {text}" for text in check(changed) if text not in before]


def _inner_errors(
    parts: Parts, place: tuple[str, int], key: str, field: str, value: Any
) -> list[str]:
    """Sentences on a number of a table inside an element, ``key`` = "NAME.combustion",
    in a scenario.
    """
    table, index = place
    name, _, inner = key.rpartition(".")
    if not isinstance(getattr(parts.tables[table][index], inner, None), INNER[inner]):
        return [f"{name!r} has no {inner}. Build the scene with one."]
    return _number_errors(
        INNER[inner],
        ("number",),
        (f"{key}.{field}", field, value),
        f"the {inner} of {name!r}",
        f"{name!r}, {inner}",
    )


def _number_errors(
    cls: type,
    kinds: Collection[str],
    setting: tuple[str, str, Any],
    holder: str,
    where: str,
) -> list[str]:
    """Sentences on a number (key, field, value) of a scenario, of a field of one of the
    ``kinds`` of ``cls``; ``holder`` and ``where`` say whose it is.
    """
    key, field, value = setting
    fields = {
        declared.name: declared
        for declared in dataclasses.fields(cls)
        if declared.metadata["kind"] in kinds or declared.name == "gd2"
    }
    if field not in fields:
        return [f"{holder} has no number {shown(field)}.{suggestion(field, fields)}"]
    if isinstance(value, list):
        return [f"{key} is {shown(value)}, must be a number."]
    return field_errors(where, fields[field], value) or []


LINKS = ("shaft", "mesh")
INNER = {
    field.name: field.metadata["of"]
    for cls in TABLES.values()
    for field in dataclasses.fields(cls)
    if field.metadata["kind"] == "table"
}
"""Classes of the tables inside elements by their keys."""
ORDER_ROWS = {"harmonics", *(kind.order_rows for kind in EXCITATIONS.values())}
"""Keys of loads and of excitations that a scenario may change row by row."""
WHOLE_ROWS = ("damping_over_rpm", "stiffness_over_rpm", "lines")
"""Keys whose rows a scenario may replace, as many as there are."""


class Parts:
    """The elements of a scene by table, with the names and places that sentences use.

    ``bad`` collects (table, index, field) of values with a sentence; the checks of the
    whole train leave them out. ``complete`` is False where some table of the scene
    could not be read. Engines are replaced by their cylinders, which come last;
    ``engine_errors`` are sentences on engines whose cylinders cannot be made.
    """

    def __init__(
        self, elements: Iterable[Any], source: str, *, complete: bool = True
    ) -> None:
        self.source = source
        self.complete = complete
        self.bad: set[tuple[str, int, str]] = set()
        self.tables: dict[str, list[Any]] = {table: [] for table in TABLES}
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
        self.names: dict[str, list[Any]] = {
            table: [getattr(element, "name", None) for element in rows]
            for table, rows in self.tables.items()
        }
        self._give_names()
        self.disk_names = [*self.names["disk"], *self.names["damper"]]
        self.disk_of = {
            name: index
            for index, name in enumerate(self.disk_names)
            if isinstance(name, str)
        }
        self._count = Counter(name for name in self.disk_names if isinstance(name, str))
        # Links and seats are found once: every check reads them.
        self._links: dict[str, list[tuple[int, tuple[int, int]]]] = {}
        self._seats: dict[str, list[tuple[int, int]]] = {}

    def _put_engines(self, engines: Iterable[Engine]) -> None:
        """Put the cylinders of engines behind those of the scene."""
        scene_cylinders = list(self.tables["cylinder"])
        self.engine_errors: list[str] = []
        self._engine_of = [""] * len(scene_cylinders)
        disk_names = [
            element.name
            for table in ("disk", "damper")
            for element in self.tables[table]
            if isinstance(element.name, str)
        ]
        for engine in engines:
            name = f" {engine.name!r}" if isinstance(engine.name, str) else ""
            where = f"{self.source}, [engine]{name}"
            errors = engine_errors(engine, where, disk_names)
            disks = engine.disks if isinstance(engine.disks, tuple | list) else ()
            for index, cylinder in enumerate(scene_cylinders):
                if cylinder.disk in disks:
                    text = (
                        f"it sits on {cylinder.disk!r}, a disk of an [engine], which"
                        " makes its cylinders"
                    )
                    errors.append(
                        f"{self.where('cylinder', index)}: {text}. Remove one of them."
                    )
            if errors:
                # Its cylinders are missing, which is no fault of the rest of the train.
                self.complete = False
                self.engine_errors += errors
                continue
            engine_cylinders = cylinders(engine)
            self.tables["cylinder"] += engine_cylinders
            self._engine_of += [where] * len(engine_cylinders)

    def rows(self) -> Iterator[tuple[str, int, Any]]:
        """Table, index and element of all elements."""
        return (
            (table, index, element)
            for table, rows in self.tables.items()
            for index, element in enumerate(rows)
        )

    def _give_names(self) -> None:
        """Name the elements that have no name by the disks that they join or sit on."""
        count: Counter = Counter()
        for table, index, element in self.rows():
            if self.names[table][index] is not None or table in (
                "disk",
                "damper",
                "phase",
                "event",
            ):
                continue
            if table in LINKS:
                ends = (
                    element.between if isinstance(element.between, tuple | list) else ()
                )
                base = "|".join(
                    end if isinstance(end, str) else shown(end) for end in ends
                )
            else:
                is_text = isinstance(element.disk, str)
                disk = element.disk if is_text else shown(element.disk)
                base = f"{disk}:{table}"
            count[base] += 1
            self.names[table][index] = (
                base if count[base] == 1 else f"{base}#{count[base]}"
            )

    def where(self, table: str, i: int) -> str:
        """Say where an element stands: ``gears.toml, [[shaft]] no. 3 'coupling'``."""
        if table == "cylinder" and self._engine_of[i]:
            return self._engine_of[i]
        name = getattr(self.tables[table][i], "name", None)
        title = f" {shown(name)}" if isinstance(name, str) else ""
        part = getattr(self.tables[table][i], "part", None)
        origin = f" (part {part})" if isinstance(part, str) else ""
        return f"{self.source}, [[{table}]] no. {i + 1}{title}{origin}"

    def usable(self, table: str, i: int, *fields: str) -> bool:
        """Tell whether fields of an element can be computed with."""
        return not any((table, i, name) in self.bad for name in fields)

    def disk(self, name: Any) -> int | None:
        """Index of a disk or ring; None unless exactly one has the name."""
        return (
            self.disk_of[name]
            if isinstance(name, str) and self._count[name] == 1
            else None
        )

    def links(self, table: str) -> list[tuple[int, tuple[int, int]]]:
        """Index and disks of the links of a table whose ends are known."""
        if table not in self._links:
            links = []
            for i, element in enumerate(self.tables[table]):
                pair = (
                    element.between if isinstance(element.between, tuple | list) else ()
                )
                ends = [disk for disk in map(self.disk, pair) if disk is not None]
                if len(pair) == len(ends) == 2 and ends[0] != ends[1]:
                    links.append((i, (ends[0], ends[1])))
            self._links[table] = links
        return self._links[table]

    def seats(self, table: str) -> list[tuple[int, int]]:
        """Index and disk of the elements of a table that sit on a known disk, except
        dampers on their own ring.
        """
        if table not in self._seats:
            all_seats = [
                (i, self.disk(element.disk))
                for i, element in enumerate(self.tables[table])
            ]
            n_disks = len(self.tables["disk"])
            ring_of = (
                {i: n_disks + i for i, _ in all_seats} if table == "damper" else {}
            )
            self._seats[table] = [
                (i, disk)
                for i, disk in all_seats
                if disk is not None and disk != ring_of.get(i)
            ]
        return self._seats[table]

    def phased(self, i: int) -> dict[str, list[int]]:
        """Indices of the elements that a phase names, by the table of their kind of
        excitation; the name of an engine stands for its cylinders.
        """
        members = self.tables["phase"][i].of
        listed = members if isinstance(members, tuple | list) else ()
        names = {name for name in listed if isinstance(name, str)}
        return {
            table: sorted(
                {index for name in names for index in indices_of.get(name, ())}
            )
            for table, indices_of in self._phased.items()
        }

    @cached_property
    def _phased(self) -> dict[str, dict[str, list[int]]]:
        """Indices of elements by the names that a phase may give: their own, and for
        cylinders that of the engine.
        """
        by_table: dict[str, dict[str, list[int]]] = {}
        for table, kind in EXCITATIONS.items():
            indices_of = by_table[table] = defaultdict(list)
            for index, name in enumerate(self.names[table]):
                indices_of[str(name)].append(index)
                if kind.of_engines:
                    # "port" is the engine of the cylinders "port 1", "port A2", ...
                    indices_of[str(name).rpartition(" ")[0]].append(index)
        return by_table

    def ends(self, table: str) -> list[tuple[int, int]]:
        """Pairs of disks that the links of a table join."""
        return [ends for _, ends in self.links(table)]

    def sits_on(self, table: str) -> list[int]:
        """Disks that the elements of a table sit on."""
        return [disk for _, disk in self.seats(table)]

    @property
    def connected(self) -> bool:
        """Tell whether it is known which disks every link joins."""
        counts = [(self.tables[table], len(self.links(table))) for table in LINKS]
        counts.append((self.tables["damper"], len(self.seats("damper"))))
        return (
            self.complete
            and all(len(rows) == n_placed for rows, n_placed in counts)
            and all(self.disk(name) is not None for name in self.disk_names)
        )


def element_errors(parts: Parts) -> list[str]:
    """Find everything wrong with each element by itself: keys, values, rows; and mark
    it in ``parts.bad``.
    """
    errors = []
    for table, index, element in parts.rows():
        where = parts.where(table, index)
        for field in fields_of(element):
            value = getattr(element, field.name)
            if value is field.default:
                continue  # defaults are sound
            sentences = field_errors(where, field, value)
            if sentences is not None:
                parts.bad.add((table, index, field.name))
                errors += sentences
        if table in TOGETHER:
            check, doubtful_field = TOGETHER[table]
            texts = check(element)
            if texts:
                parts.bad.add((table, index, doubtful_field))
                errors += [f"{where}: {text}" for text in texts]
    return errors


def name_errors(parts: Parts) -> list[str]:
    """Find names that stand for several elements."""
    first_place: dict = {}
    errors = []
    for table in TABLES:
        for index, name in enumerate(parts.names[table]):
            place = f"[[{table}]] no. {index + 1}"
            if isinstance(name, str) and first_place.setdefault(name, place) != place:
                errors.append(
                    f"{parts.source}, {place}: the name {shown(name)} is taken by"
                    f" {first_place[name]}. Rename."
                )
    return errors


def reference_errors(parts: Parts, reference: Any, *, disks_read: bool) -> list[str]:
    """Find references to disks that do not exist, if all were read, and links that join
    a disk to itself.
    """
    errors = []
    disk_names = [name for name in parts.disk_names if isinstance(name, str)]
    near = Suggestions(disk_names)
    if disks_read and not parts.tables["disk"]:
        errors.append(f"{parts.source}: there is no [[disk]]. Give at least one.")
    for table, index, element in parts.rows():
        where = parts.where(table, index)
        pair = getattr(element, "between", None)
        names = [getattr(element, "disk", None)]
        names += pair if isinstance(pair, tuple | list) else []
        ends = [end for end in names if isinstance(end, str)]
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


def archer_errors(parts: Parts) -> list[str]:
    """Check that the disks of loads with ``archer`` have no damping of their own."""
    errors = []
    for index, load in enumerate(parts.tables["load"]):
        disk = parts.disk(load.disk)
        if load.archer is None or disk is None:
            continue
        where = parts.where("load", index)
        if disk >= len(parts.tables["disk"]):
            errors.append(
                f"{where}: archer damps a [[disk]], and {shown(load.disk)} is the ring"
                " of a [[damper]]. Put the load on a disk."
            )
            continue
        keys = present_keys(parts.tables["disk"][disk], "damping", "damping_over_rpm")
        if keys:
            errors.append(
                f"{where}: archer gives the damping of {shown(load.disk)}, which has"
                f" {joined(keys)}. Keep one of them."
            )
    return errors


# Rows of a key over all elements, the shorter lists padded as the longest
MOST_ROWS = 2_000_000


def size_errors(parts: Parts) -> list[str]:
    """Find lists that would take more memory than a train may; nothing is computed from
    them.
    """
    errors = []
    for table, elements in parts.tables.items():
        for field in fields_of(elements[0]) if elements else ():
            rows = (
                [getattr(element, field.name) for element in elements]
                if field.metadata["kind"] == "rows"
                else []
            )
            longest = max((len(row) for row in rows if is_list(row)), default=0)
            if longest * len(rows) > MOST_ROWS:
                excess = (
                    f"{len(rows)} elements with {field.name} of up to {longest} rows"
                )
                errors.append(
                    f"{parts.source}, [[{table}]]: {excess}, must be at most"
                    f" {MOST_ROWS} together. Thin them out."
                )
    errors += [
        f"{parts.source}, [[{table}]]: {text}"
        for table, kind in EXCITATIONS.items()
        for text in kind.size_errors(parts.tables[table])
    ]
    return errors


def shaft_rule_errors(parts: Parts, chosen: Chosen) -> list[str]:
    """Check that the rules of shafts exist and have the numbers that they need, and
    mark shafts with a fault in ``parts.bad``.
    """
    errors = []
    for index, shaft in enumerate(parts.tables["shaft"]):
        name = chosen.default if shaft.rule is None else shaft.rule
        if not isinstance(name, str):
            continue  # has its sentence
        rule = chosen.rules.get(name)
        if rule is None:
            texts = [f"there is no rule {shown(name)}.{suggestion(name, chosen.rules)}"]
        else:
            texts = rule_errors(shaft, rule)
        if texts:
            parts.bad.add(("shaft", index, "rule"))
            where = parts.where("shaft", index)
            errors += [f"{where}: {text}" for text in texts]
    return errors


def operating_errors(source: str, operating: Any, names: Sequence[str]) -> list[str]:
    """Check the operating speeds, which separation margins need."""
    asking = [name for name in names if name in MARGINS]
    where = f"{source}, [scene]"
    if not operating:
        return [
            f"{where}: the rule {shown(name)} needs operating_rpm = [lowest, highest]."
            " Give the operating speeds of the reference rotor in rpm."
            for name in asking
        ]
    sound = (
        is_list(operating)
        and len(operating) == 2
        and all(map(plain_number, operating))
        and 0 < operating[0] < operating[1]
    )
    return (
        []
        if sound
        else [
            f"{where}: operating_rpm is {shown(operating)}, must be [lowest, highest],"
            " two rising speeds above 0 rpm. Correct it."
        ]
    )


def rated_errors(parts: Parts, rated_rpm: float | None) -> list[str]:
    """Check that the rated speed is given where limits depend on it."""
    shafts = zip(parts.names["shaft"], parts.tables["shaft"], strict=True)
    judged = [name for name, shaft in shafts if shaft.tensile_strength is not None]
    if rated_rpm is not None or not judged:
        return []
    names = joined(map(repr, judged[:8])) + (", …" if len(judged) > 8 else "")
    text = (
        f"the key 'rated_rpm' is missing; the stress limits of {names} depend on the"
        " speed over it"
    )
    return [
        f"{parts.source}, [scene]: {text}. Give the rated speed of the reference rotor"
        " in rpm."
    ]

"""Columns of the sheet of a class of elements, made from its declared fields: heads,
units, and what the cells may hold.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from jaxhb.elements.declared import fields_of_class, unit_of
from jaxhb.elements.elements import Head
from jaxhb.elements.units import units_of_columns
from jaxhb.scene.title_block import KEYS, KEYS_BESIDE

ENDS = ("from", "to")
"""Heads of the two disks of a link."""

SETTINGS = ("scene", "tune", "report", "parts")
"""Tables whose keys and values stand below each other; lists of tables in them have
sheets of their own, as ``tune.parameter``.
"""

_FREE = {"name": "name", "of": "name"}
_FREE |= dict.fromkeys(("together", "without", "events", "files"), "list")
"""Kinds of keys of tables that have no declared fields; others hold anything."""

_TITLE_BLOCK = "a text in the title block of reports; logo: a picture beside the scene"
_UNITS = 'units of answers by quantity, as {"torque": "kN m"}'
_PARTS = "files of catalogue parts beside the scene, with semicolons between them"

NUMBERS = ("number", "count", "shorthand", "numbers")
"""Kinds of columns of numbers."""


@dataclass(frozen=True)
class Column:
    """A column of a sheet.

    path : keys that lead to its value in a row of the scene; a number behind the key of
    a pair; kind : of the declared field, "" for anything; unit : SI, of the numbers in
    its cells, of several ``"N m; s"``; cls, field : where it is declared; note : what
    its cells hold, where no field tells it
    """

    path: tuple[str | int, ...]
    kind: str = ""
    unit: str = ""
    cls: type | None = None
    field: dataclasses.Field | None = None
    note: str = ""

    @property
    def name(self) -> str:
        """The head without its unit."""
        last = self.path[-1]
        end = (ENDS[last],) if isinstance(last, int) else ()
        keys = self.path[:-1] if end else self.path
        return ".".join((*map(str, keys[:-1]), *(end or map(str, keys[-1:]))))

    @property
    def head(self) -> str:
        """The head with the unit of the scene."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @property
    def required(self) -> bool:
        """Whether every row needs a value."""
        return self.field is not None and self.field.default is dataclasses.MISSING

    @property
    def takes_units(self) -> bool:
        """Whether a unit in its head is that of the numbers in its cells."""
        return self.kind in ("", *NUMBERS) or bool(self.kind == "list" and self.unit)

    @property
    def row_columns(self) -> tuple[str, ...]:
        """Heads of the rows that a cell names."""
        return self.field.metadata["columns"] if self.field else ()

    @property
    def row_units(self) -> tuple[str, ...]:
        """SI units of the rows that a cell names."""
        if self.cls is None or self.field is None:
            return ()
        return units_of_columns(self.cls, self.field)

    @property
    def words(self) -> tuple[str, ...]:
        """Words of which a cell holds one."""
        if self.kind == "flag":
            return ("TRUE", "FALSE")
        if self.kind != "choice" or self.field is None:
            return ()
        return tuple(word for word in self.field.metadata["words"] if word)

    def explained(self) -> str:
        """Say what a cell may hold."""
        parts = [self.note or _KINDS.get(self.kind, "")]
        if self.kind in ("rows", "tables"):
            parts[0] += f" with the columns {', '.join(self._sheet_heads())}"
        metadata: Mapping[str, Any] = self.field.metadata if self.field else {}
        limits = metadata.get("range")
        if limits is not None:
            parts[0] = f"{parts[0]} {limits.words()}".strip()
            parts.append(limits.remedy)
        if self.words:
            parts[0] = f"one of {', '.join(self.words)}"
        default = None if self.field is None else self.field.default
        if self.required:
            parts.append("Required")
        elif isinstance(default, bool | int | float | str) and default != "":
            parts.append(f"{default} unless given")
        return ". ".join(part.rstrip(".") for part in parts if part) + "."

    def _sheet_heads(self) -> list[str]:
        """Heads of the sheet that a cell names."""
        if self.kind == "tables":
            return [column.head for column in inner_columns(self)]
        return [
            f"{head} [{unit}]" if unit else head
            for head, unit in zip(self.row_columns, self.row_units, strict=True)
        ]


_KINDS = {
    "name": "a name, unique in the workbook",
    "disk": "the name of a disk",
    "pair": "the name of a disk",
    "cylinder": "the name of a cylinder",
    "text": "a text",
    "number": "a number,",
    "count": "a whole number,",
    "shorthand": "a number,",
    "list": "texts or numbers with semicolons between them",
    "numbers": "numbers with a semicolon between them",
    "rows": "the name of a sheet",
    "tables": "the name of a sheet",
}
"""Words for what cells of each kind hold."""


def columns_of(cls: type, before: tuple[str, ...] = ()) -> list[Column]:
    """Columns of a class of elements; a table inside it has columns of its own, as
    ``combustion.start``, and the two disks of a link have ``from`` and ``to``.
    """
    return list(_columns(cls, before))


def _columns(cls: type, before: tuple[str, ...]) -> Iterator[Column]:
    for key, field in fields_of_class(cls).items():
        kind = field.metadata["kind"]
        path = (*before, key)
        if kind == "table":
            yield from _columns(field.metadata["of"], path)
        elif kind == "pair":
            for end in (0, 1):
                yield Column((*path, end), kind, cls=cls, field=field)
        else:
            unit = field.metadata.get("unit", "") or unit_of(field)
            if kind == "numbers":
                unit = "; ".join(units_of_columns(cls, field))
            if kind == "rows":
                unit = ""
            yield Column(path, kind, unit, cls, field)


def inner_columns(column: Column) -> list[Column]:
    """Columns of the sheet that a cell of a list of tables names."""
    assert column.field is not None  # only declared columns have such cells
    return columns_of(column.field.metadata["of"])


def settings_columns(table: str) -> list[Column]:
    """Columns of a table of settings whose keys are known."""
    if table == "scene":
        return columns_of(Head)
    return list(_SETTINGS_COLUMNS.get(table, ()))


_SETTINGS_COLUMNS = {
    "report": (
        *(Column((key,), "text", note=_TITLE_BLOCK) for key in KEYS),
        *(Column((key,), note=_UNITS) for key in KEYS_BESIDE),
    ),
    "parts": (Column(("files",), "list", note=_PARTS),),
}


def free_column(key: str) -> Column:
    """Column of a key that is not declared."""
    return Column((key,), _FREE.get(key, ""))

"""Declarations of the fields of elements: kind, unit and allowed range of every value,
which the checks and the sentences of errors read.
"""

import dataclasses
from dataclasses import dataclass, field
from functools import cache, reduce
from operator import ge, gt, le, lt, or_
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Range:
    """Numbers that a field may take, with their unit and the remedy for a number
    outside.
    """

    unit: str = ""
    above: float | None = None
    least: float | None = None
    below: float | None = None
    most: float | None = None
    remedy: str = ""

    def excludes(self, values: Any) -> Any:
        """Whether numbers, or arrays of them, lie outside the range; nan does not."""
        bounds = (le, self.above), (lt, self.least), (ge, self.below), (gt, self.most)
        return reduce(
            or_,
            (
                lies_beyond(values, end)
                for lies_beyond, end in bounds
                if end is not None
            ),
            False,
        )

    def words(self) -> str:
        """Say the range in words: ``greater than 0 N m/rad``."""
        unit = f" {self.unit}" if self.unit else ""
        limits = {
            "greater than": self.above,
            "at least": self.least,
            "less than": self.below,
            "at most": self.most,
        }
        parts = [
            f"{words} {limit:g}{unit}"
            for words, limit in limits.items()
            if limit is not None
        ]
        in_unit = f" in {self.unit}" if self.unit else ""
        return " and ".join(parts) or f"a finite number{in_unit}"


REQUIRED = dataclasses.MISSING


def declared(kind: str, default: Any = REQUIRED, **metadata: Any) -> Any:
    """Declare a field of an element; :mod:`jaxhb.elements.value_checks` says what each
    kind takes.
    """
    return field(default=default, metadata={"kind": kind, **metadata})


def quantity(
    unit: str,
    default: Any = REQUIRED,
    *,
    kind: str = "number",
    weight: bool = False,
    **limits: Any,
) -> Any:
    """Declare a number in a unit, within the ``limits`` of a :class:`Range`.

    weight : whether people write its mass as a weight, kgf for kg
    """
    return declared(kind, default, range=Range(unit=unit, **limits), weight=weight)


def positive(unit: str, default: Any = REQUIRED, remedy: str = "") -> Any:
    """Declare a number greater than 0."""
    return quantity(unit, default, above=0.0, remedy=remedy)


def not_negative(unit: str, default: Any = REQUIRED, remedy: str = "") -> Any:
    """Declare a number of at least 0."""
    return quantity(unit, default, least=0.0, remedy=remedy)


def cross_size(default: Any, *, kind: str = "number", **limits: Any) -> Any:
    """Declare a diameter or width in m, at most 5 m: larger numbers are in mm."""
    return quantity("m", default, kind=kind, most=5.0, remedy="Give it in m.", **limits)


def choice(default: str, *words: str) -> Any:
    """Declare a word out of several, the first by default."""
    return declared("choice", default, words=(default, *words))


def rows(columns: tuple[str, ...], default: Any = (), *, unit: str = "") -> Any:
    """Declare a table of numbers with these columns, their size in a ``unit``."""
    return declared("rows", default, columns=columns, unit=unit)


LARGEST = 1e60  # of any number, in SI units: products of five stay finite
SMALLEST = 1e-60  # of a number that is not 0: so do quotients


SCALE = ("rpm", "factor")
OVER_HZ = ("hz", "factor of stiffness", "factor of damping")
OVER_AMPLITUDE = ("amplitude", "factor of stiffness", "factor of damping")
OVER_TEMPERATURE = ("temperature", "factor of stiffness", "factor of damping")
HARMONICS = ("order", "Re", "Im")
LINES = ("Hz", "Re", "Im")
BLADE_ORDERS = ("multiple", "share", "phase")
PRESSURE = ("angle", "pressure")
COSINES = ("order", "imep", "cosine", "sine")
AMPLITUDES = ("order", "imep", "amplitude", "phase")
OVER_RPM = ("rpm", "torque")
TWISTS = ("twist", "stiffness")
SN_CURVE = ("cycles", "stress")
DAMPING_OVER_RPM = ("rpm", "damping")
STIFFNESS_OVER_RPM = ("rpm", "stiffness")
"""Columns of rows."""


def fields_of(element: Any) -> tuple[dataclasses.Field, ...]:
    """Declared fields of an element."""
    # Classes are hashable.
    return _fields_of_class(type(element))  # type: ignore[arg-type]


@cache
def _fields_of_class(cls: Any) -> tuple[dataclasses.Field, ...]:
    return dataclasses.fields(cls)


@cache
def fields_of_class(cls: type) -> dict[str, dataclasses.Field]:
    """Declared fields of a class of elements by their names."""
    return {field.name: field for field in _fields_of_class(cls)}


class Unread:
    """Placeholder for a value that could not be read and that has its sentence
    already.
    """


def table_name(cls: type[Any]) -> str:
    """Name the ``[[table]]`` of a class of elements."""
    return cls.__name__.lower()


def table_of(element: Any) -> str:
    """Name the ``[[table]]`` that describes an element: ``table_of(Disk(...)) ==
    "disk"``.
    """
    return table_name(type(element))


def facts_of(
    element: Any, before: str = ""
) -> dict[str, tuple[Any, dataclasses.Field]]:
    """Everything a scene says of an element: value and declared field by name, as
    "stiffness", "combustion.start" or "traces no. 1.rpm"; None where a scene may be
    silent and is.
    """
    facts: dict = {}
    for declared in dataclasses.fields(element):
        value = getattr(element, declared.name)
        name = before + declared.name
        if dataclasses.is_dataclass(value):
            facts |= facts_of(value, f"{name}.")
        elif declared.metadata["kind"] == "tables":
            for k, inner in enumerate(value or ()):
                facts |= facts_of(inner, f"{name} no. {k + 1}.")
        elif declared.name != "name":
            if declared.metadata["kind"] == "rows" and value is not None:
                value = tuple(map(tuple, value))
            elif declared.metadata["kind"] == "pair" and value is not None:
                value = ", ".join(value)
            elif declared.metadata["kind"] == "numbers" and value is not None:
                value = tuple(value)
            facts[name] = (value, declared)
    return facts


def unit_of(declared: dataclasses.Field) -> str:
    """SI unit of a declared field, "" without one."""
    span = declared.metadata.get("range")
    return span.unit if span else ""

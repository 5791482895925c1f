"""How the fields of elements are declared: their kind, and of numbers the unit and the range that is allowed."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Range:
    """The numbers a field may take, with its unit and what to do about a number outside."""

    unit: str = ""
    above: float | None = None
    least: float | None = None
    below: float | None = None
    most: float | None = None
    remedy: str = ""

    def contains(self, value) -> bool:
        """Tell whether ``value`` (finite) lies in the range."""
        return not (
            (self.above is not None and not value > self.above)
            or (self.least is not None and not value >= self.least)
            or (self.below is not None and not value < self.below)
            or (self.most is not None and not value <= self.most)
        )

    def words(self) -> str:
        """Say the range: ``greater than 0 N m/rad``."""
        unit = f" {self.unit}" if self.unit else ""
        parts = []
        if self.above is not None:
            parts.append(f"greater than {self.above:g}{unit}")
        if self.least is not None:
            parts.append(f"at least {self.least:g}{unit}")
        if self.below is not None:
            parts.append(f"less than {self.below:g}{unit}")
        if self.most is not None:
            parts.append(f"at most {self.most:g}{unit}")
        return " and ".join(parts) or f"a finite number{f' in {self.unit}' if self.unit else ''}"


REQUIRED = dataclasses.MISSING


def quantity(unit: str, default: Any = REQUIRED, **limits) -> Any:
    return field(default=default, metadata={"kind": "number", "range": Range(unit=unit, **limits)})


def positive(unit: str, default: Any = REQUIRED, remedy: str = "") -> Any:
    return quantity(unit, default, above=0.0, remedy=remedy)


def not_negative(unit: str, default: Any = REQUIRED, remedy: str = "") -> Any:
    return quantity(unit, default, least=0.0, remedy=remedy)


def choice(default: str, *words: str) -> Any:
    return field(default=default, metadata={"kind": "choice", "words": (default, *words)})


def rows(columns: tuple[str, ...], default: Any = ()) -> Any:
    return field(default=default, metadata={"kind": "rows", "columns": columns})


def flag(default: bool) -> Any:
    return field(default=default, metadata={"kind": "flag"})


def table(cls) -> Any:
    return field(default=None, metadata={"kind": "table", "of": cls})


def tables(cls) -> Any:
    return field(default=None, metadata={"kind": "tables", "of": cls})


def named(required: bool = False) -> Any:
    metadata = {"kind": "name", "required": required}
    return field(metadata=metadata) if required else field(default=None, metadata=metadata)


def of_disk() -> Any:
    return field(metadata={"kind": "disk"})


def of_pair() -> Any:
    return field(metadata={"kind": "pair"})

"""The units in which people read numbers of answers: usual ones, or those that a scene
or a command chooses.

Speeds at which a train runs stay in rpm, as commands take them, and files of numbers
and the values of a scene in SI.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from types import MappingProxyType

from jaxhb.elements.units import Shown
from jaxhb.report.text.columns import plain_number

SHOWN_UNITS: dict[str, Shown] = {
    "N": (1e-3, "kN"),
    "rad": (180 / math.pi, "deg"),
    "rad/s": (30 / math.pi, "rpm"),
    "Pa": (1e-6, "MPa"),
    "1": (100.0, "%"),
}
"""How people read SI units; other units are read as they are."""

LARGE: dict[str, tuple[float, Shown]] = {"N m": (1e4, (1e-3, "kN m"))}
"""Number from which a table takes a larger unit, where none is chosen."""

_USUAL: Mapping[str, Shown] = MappingProxyType({})
_CHOSEN: ContextVar[Mapping[str, Shown]] = ContextVar("chosen units", default=_USUAL)


@contextmanager
def shown_in(units: Mapping[str, Shown]) -> Iterator[None]:
    """Show numbers in chosen ``units``, by SI units, within the block.

    >>> with shown_in({"N m": (1e-3, "kN m")}):
    ...     shown_unit("N m")
    (0.001, 'kN m')
    """
    before = _CHOSEN.set(units)
    try:
        yield
    finally:
        _CHOSEN.reset(before)


def shown_unit(unit: str, largest: float = 0.0) -> Shown:
    """Return the factor from an SI unit, and the unit in which people read it.

    largest : the size of the largest number of a table, in SI
    """
    chosen = _CHOSEN.get()
    if unit in chosen:
        return chosen[unit]
    least, large = LARGE.get(unit, (math.inf, (1.0, unit)))
    return large if largest >= least else SHOWN_UNITS.get(unit, (1.0, unit))


def is_chosen(unit: str) -> bool:
    """Whether a unit was chosen, and numbers stay in it whatever their size."""
    return any(unit == chosen for _, chosen in _CHOSEN.get().values())


def said(value: float, unit: str, digits: int = 4) -> str:
    """A number in an SI unit in words for people.

    >>> said(12300.0, "N")
    '12.3 kN'
    """
    factor, shown = shown_unit(unit)
    return f"{plain_number(factor * value, digits)} {shown}"

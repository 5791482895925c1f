"""A kind of excitation: what a scene may write of it, and the torque that
follows.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np

from jaxhb._jax import Array, Number

Rows = tuple[tuple[int, ...], ...]
Need = tuple[str, float, str]
Usable = Callable[..., bool]


def per_cycle() -> Any:
    """Declare a field of numbers, or of rows of numbers, that a cycle as long several
    times over has so many times as large.
    """
    return field(metadata={"per_cycle": True})


@dataclass(frozen=True, kw_only=True)
class Seats:
    """The part of the n elements of a kind that is fixed when a program is compiled,
    each field a tuple over them: text, integers and floats.

    ``of_own_rotor`` : whether orders are those of its own rotor; ``harmonics`` n
    of the cycle of each order that the scene gives.
    """

    names: tuple[str, ...]
    disk: tuple[int, ...]
    of_own_rotor: tuple[bool, ...]
    harmonics: Rows = per_cycle()

    def listed(self) -> Rows:
        """Harmonics of the cycle that each element can have, whatever its numbers
        are.
        """
        return self.harmonics

    def repeated(self, cycles: int) -> Self:
        """The same over a cycle ``cycles`` times as long."""

        def longer(value: Any) -> Any:
            return (
                tuple(map(longer, value))
                if isinstance(value, tuple)
                else cycles * value
            )

        changed: dict[str, Any] = {
            declared.name: longer(getattr(self, declared.name))
            for declared in dataclasses.fields(self)
            if declared.metadata.get("per_cycle")
        }
        return dataclasses.replace(self, **changed)

    def only(self, keep: Sequence[int], place: Mapping[int, int]) -> Self:
        """Select the elements ``keep``, on disks numbered anew: ``place[old]``."""
        fields: dict[str, Any] = {
            declared.name: tuple(getattr(self, declared.name)[i] for i in keep)
            for declared in dataclasses.fields(self)
        }
        fields["disk"] = tuple(place[disk] for disk in fields["disk"])
        return dataclasses.replace(self, **fields)


class Excitation:
    """A kind of excitation; each is one object, in ``EXCITATION`` of a module of this
    folder.

    Attributes
    ----------
    element : type, the dataclass of its ``[[table]]``, with a ``disk`` and a ``name``
    doubtful : str, the field that :meth:`errors` puts in doubt
    no_mean : tuple of str, numbers that no mean torque depends on
    order_rows : str, the rows (order, Re, Im) whose harmonics are ``harmonics`` of its
        :class:`Seats`, "" without any
    of_engines : bool, whether elements "port 1", "port 2" are those of an engine "port"
    ones : tuple of str, numbers that are 1 where the train has none
    """

    element: ClassVar[type[Any]]
    doubtful: ClassVar[str] = "disk"
    no_mean: ClassVar[tuple[str, ...]] = ()
    order_rows: ClassVar[str] = ""
    of_engines: ClassVar[bool] = False
    ones: ClassVar[tuple[str, ...]] = ()

    def errors(self, element: Any) -> list[str]:
        """Check keys of an element against each other."""
        return []

    def size_errors(self, elements: Sequence[Any]) -> list[str]:
        """Check that elements need no more memory than a train may."""
        return []

    def mean_fields(self, element: Any) -> tuple[str, ...]:
        """Keys that decide the mean torque of an element."""
        raise NotImplementedError

    def written_speeds(self, element: Any, usable: Usable) -> Iterator[float]:
        """Speeds (rpm) at which the torque of an element has a point; ``usable(key)``
        tells which of its keys are sound.
        """
        return iter(())

    def needs(
        self, element: Any, ratio: float | None, usable: Usable
    ) -> Iterator[Need]:
        """Orders that must be harmonics of the cycle: text, harmonics per revolution of
        the reference rotor, and the key of the mean.

        ratio : speed of its rotor over that of the reference rotor, None: unknown
        """
        return iter(())

    def seats(
        self,
        elements: Sequence[Any],
        names: Sequence[str],
        disks: Sequence[int],
        ratios: Sequence[float],
        cycle: float,
    ) -> Any:
        """The :class:`Seats` of sound elements on ``disks`` whose rotors have speed
        ``ratios``; ``cycle`` in revolutions of the reference rotor.
        """
        raise NotImplementedError

    def numbers(self, elements: Sequence[Any]) -> Any:
        """Table of the numbers of sound elements."""
        raise NotImplementedError

    def speeds(self, numbers: Any) -> list[Array]:
        """Arrays of the speeds (rpm) at which torques have a point."""
        return []

    def rated_speeds(self, numbers: Any) -> Array:
        """Speeds (rpm) of torques that follow a power of the speed."""
        return np.zeros(0)

    def means(self, numbers: Any, seats: Any, rpm: Number) -> Array:
        """Mean torque of each element in N m ``(..., n)`` at ``rpm`` ``(...)``."""
        raise NotImplementedError

    def add_harmonics(
        self,
        torque: Array,
        numbers: Any,
        seats: Any,
        rpm: Array,
        ratios: Array,
        turned: Callable[[np.ndarray, np.ndarray], Number],
    ) -> Array:
        """Add the harmonics of the elements to the torque on disks ``(..., S, N+1)``.

        rpm : ``(...)`` of the reference rotor; ratios : ``(n,)`` speed of the rotor of
        each element over that; turned : factor by which phases turn elements i at
        harmonics n
        """
        return torque

    def highest(self, numbers: Any, seats: Any) -> list[int]:
        """Harmonics of the cycle that count, the highest of each element at least;
        concrete values.
        """
        raise NotImplementedError

    def line_places(self, seats: Any) -> list[tuple[int, int]]:
        """Element and row of every line, a sine of a fixed frequency that the torque
        has beside its orders.
        """
        return []

    def lines(self, numbers: Any, seats: Any, rpm: Number) -> tuple[Array, Array]:
        """Frequency in Hz ``(L,)`` of every line, and its coefficient in N m ``(...,
        L)`` at ``rpm`` ``(...)``, half the complex amplitude.
        """
        return np.zeros(0), np.zeros((*np.shape(rpm), 0), dtype=complex)

    def without_lines(self, numbers: Any, seats: Any) -> tuple[Any, Any]:
        """Numbers and seats of the same elements without their lines."""
        return numbers, seats

    def scene_row(
        self, numbers: Any, seats: Any, field: str, place: int, row: Array
    ) -> Array:
        """The part of a row of numbers that the scene gave."""
        return row

    def without_effect(self, numbers: Any, seats: Any, field: str, index: int) -> str:
        """Say why a number of an element has no effect; empty where it has one."""
        return ""

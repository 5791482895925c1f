"""Torques that a scene gives: a mean and harmonics, times a scale over the speed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxhb._jax import Array, Number, namespace
from jaxhb.elements.columns import collected, column, padded, scales
from jaxhb.elements.declared import (
    BLADE_ORDERS,
    HARMONICS,
    LINES,
    SCALE,
    choice,
    declared,
    not_negative,
    positive,
    quantity,
    rows,
)
from jaxhb.elements.excitations.blades import blade_errors
from jaxhb.elements.excitations.kind import (
    Excitation,
    Need,
    Seats,
    Usable,
)
from jaxhb.elements.values import sound_orders
from jaxhb.excitation.mean_torques import scale_at
from jaxhb.excitation.orders import add_listed, coefficients, harmonics_of, highest_rows
from jaxhb.excitation.tables import table


@dataclass(frozen=True, kw_only=True)
class Torque:
    """``[[torque]]``: mean + sum Re((Re + i Im) exp(i order theta)) in N m, times
    ``scale`` over rpm.

    ``lines`` = rows of (Hz, Re, Im) add Re((Re + i Im) exp(2 pi i Hz t)): frequencies
    that do not follow the speed, as of a grid or an inverter. With ``rated_rpm``, a
    speed of the reference rotor, all of it grows as (rpm / rated_rpm)^speed_exponent, 2
    unless given: the law of propellers, fans and inertia torques. ``blades`` and
    ``blade_orders`` = rows of (multiple, share of the mean, phase deg) stand for the
    harmonics mean x share cos(multiple x blades x theta + phase) of its own rotor.
    """

    disk: str = declared("disk")
    mean: float = quantity("N m", 0.0)
    harmonics: tuple = rows(HARMONICS, unit="N m")
    blades: int | None = quantity("", None, kind="count", least=1.0, most=1000.0)
    blade_orders: tuple = rows(BLADE_ORDERS)
    lines: tuple = rows(LINES, unit="N m")
    orders_of: str = choice("reference", "own")
    scale: tuple = rows(SCALE)
    rated_rpm: float | None = positive("rpm", None)
    speed_exponent: float | None = not_negative("", None)
    name: str | None = declared("name", None)


@table
class Torques:
    """Mean [nt] (N m), harmonics [nt, K, 2] (Re, Im of the peak amplitude, N m), scale
    over rpm [nt, L].

    ``rated_rpm`` [nt], 0 for torques without, and ``speed_exponent`` [nt]; None where
    no torque has a rated speed. ``lines`` [nt, K, 3] (Hz, Re, Im), None where no torque
    has any.
    """

    mean: Any
    harmonics: Any
    scale_rpm: Any
    scale_factor: Any
    rated_rpm: Any = None
    speed_exponent: Any = None
    lines: Any = None


@dataclass(frozen=True, kw_only=True)
class TorqueSeats(Seats):
    """Seats of torques; ``lines`` : number of the lines of each."""

    lines: tuple[int, ...] = ()


def factor_at(torques: Torques, rpm: Number) -> Array:
    """Factor of each torque at ``rpm`` [..., n]: its scale, times the power of the
    speed of those with a rated speed.
    """
    factor = scale_at(torques, rpm)
    if torques.rated_rpm is None:
        return factor
    xp = namespace(torques, rpm)
    # 1 where there is none: a power of infinity would be nan in derivatives.
    rated = xp.where(torques.rated_rpm > 0.0, torques.rated_rpm, 1.0)
    power = (xp.asarray(rpm, dtype=float)[..., None] / rated) ** torques.speed_exponent
    return factor * xp.where(torques.rated_rpm > 0.0, power, 1.0)


class TorqueKind(Excitation):
    """``[[torque]]``."""

    element = Torque
    doubtful = "speed_exponent"
    no_mean = ("harmonics", "lines")
    order_rows = "harmonics"

    def errors(self, element: Torque) -> list[str]:
        errors = blade_errors(element)
        if element.speed_exponent is not None and element.rated_rpm is None:
            errors.append(
                "speed_exponent is given without rated_rpm. Give the speed at which the"
                " torque has this size."
            )
        return errors

    def mean_fields(self, element: Torque) -> tuple[str, ...]:
        return ("mean", "scale", "rated_rpm", "speed_exponent")

    def written_speeds(self, element: Torque, usable: Usable) -> Iterator[float]:
        if usable("scale"):
            yield from (float(row[0]) for row in element.scale or ())
        if usable("rated_rpm") and element.rated_rpm is not None:
            yield float(element.rated_rpm)

    def needs(
        self, element: Torque, ratio: float | None, usable: Usable
    ) -> Iterator[Need]:
        factor = ratio if element.orders_of == "own" else 1.0
        if usable("orders_of") and factor is not None:
            for order in sound_orders(element.harmonics):
                yield f"order {order:g}", order * factor, "mean"

    def seats(
        self,
        elements: Sequence[Torque],
        names: Sequence[str],
        disks: Sequence[int],
        ratios: Sequence[float],
        cycle: float,
    ) -> TorqueSeats:
        of_own_rotor = tuple(torque.orders_of == "own" for torque in elements)
        turns = [
            (ratio if is_own else 1.0) * cycle
            for is_own, ratio in zip(of_own_rotor, ratios, strict=True)
        ]
        return TorqueSeats(
            lines=tuple(len(torque.lines) for torque in elements),
            names=tuple(names),
            disk=tuple(disks),
            of_own_rotor=of_own_rotor,
            harmonics=harmonics_of([torque.harmonics for torque in elements], turns),
        )

    def numbers(self, elements: Sequence[Torque]) -> Torques:
        rated = any(torque.rated_rpm is not None for torque in elements)
        exponent = column(elements, "speed_exponent", absent=2.0) if rated else None
        special = scales(elements) | {"speed_exponent": exponent}
        if any(torque.lines for torque in elements):
            rows = [torque.lines for torque in elements]
            special |= {"lines": padded(rows, (1.0, 0.0, 0.0))}
        return collected(Torques, Torque, elements, special)

    def speeds(self, numbers: Torques) -> list[Array]:
        rated = [] if numbers.rated_rpm is None else [numbers.rated_rpm]
        return [numbers.scale_rpm, *rated]

    def rated_speeds(self, numbers: Torques) -> Array:
        return np.zeros(0) if numbers.rated_rpm is None else numbers.rated_rpm

    def means(self, numbers: Torques, seats: Seats, rpm: Number) -> Array:
        return factor_at(numbers, rpm) * numbers.mean

    def add_harmonics(
        self,
        torque: Array,
        numbers: Torques,
        seats: Seats,
        rpm: Array,
        ratios: Array,
        turned: Callable[[np.ndarray, np.ndarray], Number],
    ) -> Array:
        factor = factor_at(numbers, rpm)

        def values(i: np.ndarray, k: np.ndarray, n: np.ndarray) -> Array:
            return factor[..., i] * coefficients(numbers.harmonics, i, k) * turned(i, n)

        return add_listed(torque, seats.disk, seats.harmonics, values)

    def highest(self, numbers: Torques, seats: Seats) -> list[int]:
        return highest_rows(seats.harmonics, numbers.harmonics)

    def line_places(self, seats: TorqueSeats) -> list[tuple[int, int]]:
        return [(i, k) for i, count in enumerate(seats.lines) for k in range(count)]

    def lines(
        self, numbers: Torques, seats: TorqueSeats, rpm: Number
    ) -> tuple[Array, Array]:
        places = self.line_places(seats)
        if not places:
            return super().lines(numbers, seats, rpm)
        i, k = np.array(places).T
        xp = namespace(numbers, rpm)
        rows = xp.asarray(numbers.lines)[i, k]
        amplitude = rows[:, 1] + 1j * rows[:, 2]
        return rows[:, 0], 0.5 * factor_at(numbers, rpm)[..., i] * amplitude

    def without_lines(
        self, numbers: Torques, seats: TorqueSeats
    ) -> tuple[Torques, TorqueSeats]:
        none = dataclasses.replace(seats, lines=(0,) * len(seats.lines))
        return dataclasses.replace(numbers, lines=None), none

    def scene_row(
        self, numbers: Torques, seats: TorqueSeats, field: str, place: int, row: Array
    ) -> Array:
        return row[: seats.lines[place]] if field == "lines" else row


EXCITATION = TorqueKind()

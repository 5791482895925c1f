"""The events of a train: their numbers as arrays, and what of them is fixed when a
program is compiled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jaxhb.elements.columns import collected, column, padded
from jaxhb.elements.events import TORQUES, Event, Ice, Pulse, completed, kind_of
from jaxhb.elements.values import is_list
from jaxhb.excitation.tables import table

Array = Any


@dataclass(frozen=True, kw_only=True)
class EventSeat:
    """The part of an event that is fixed when a program is compiled.

    Parameters
    ----------
    name : str; kind : str, the key of its kind, as "step"
    disk : int, on which its torque acts, -1 where it has none
    of : str, the cylinder or the shaft that it changes, "" where there is none
    by_angle : bool, whether it begins at an angle; ends : bool, whether it has an end
    rows : int, rows of its table; shape : str, of its pulse
    passages : int, passages of a blade by an ice block in a revolution
    """

    name: str
    kind: str
    disk: int = -1
    of: str = ""
    by_angle: bool = False
    ends: bool = False
    rows: int = 0
    shape: str = ""
    passages: int = 0

    @property
    def is_torque(self) -> bool:
        """Whether it is a torque on a disk."""
        return self.kind in TORQUES


@table
class Pulses:
    """The numbers of a :class:`~jaxhb.Pulse`, each [k]; ``seats`` [k] are their
    events.
    """

    seats: tuple[int, ...] = field(metadata={"static": True})
    torque: Array
    seconds: Array
    rise: Array


@table
class Ices:
    """The numbers of an :class:`~jaxhb.Ice`, those of its case included, each [k];
    ``seats`` [k] are their events.
    """

    seats: tuple[int, ...] = field(metadata={"static": True})
    torque: Array
    coefficient: Array
    contact_deg: Array
    angle_deg: Array
    ramp_deg: Array


@table
class Clutches:
    """Rows (s, N m) of the capacity of clutches, [k, K, 2]; ``seats`` [k] are their
    events.
    """

    seats: tuple[int, ...] = field(metadata={"static": True})
    capacity: Array


@table
class Events:
    """The numbers of events: begin and end (s), begin in deg, factor, each [n], 0 where
    absent; None where no event has them: ``step`` (N m) and ``firing_from`` (rpm) [n],
    ``ramp`` (N m, s) [n, 2], ``table`` (s, N m) and ``fuel`` (s, factor) [n, K, 2],
    ``decaying`` (N m, s, Hz, deg) [n, K, 4], and the tables of pulses, ice and
    clutches.
    """

    begin: Array
    begin_deg: Array
    factor: Array
    end: Array | None = None
    step: Array | None = None
    ramp: Array | None = None
    table: Array | None = None
    decaying: Array | None = None
    fuel: Array | None = None
    firing_from: Array | None = None
    pulse: Pulses | None = None
    ice: Ices | None = None
    clutch: Clutches | None = None


def numbers_of(events: Sequence[Event]) -> Events | None:
    """Numbers of sound events; None without any."""
    if not events:
        return None
    ramp = _rows_of([[event.ramp] if event.ramp else () for event in events])
    return Events(
        begin=column(events, "begin"),
        begin_deg=column(events, "begin_deg"),
        factor=column(events, "factor"),
        end=_column_of(events, "end"),
        step=_column_of(events, "step"),
        ramp=None if ramp is None else ramp[:, 0],
        table=_rows_of([event.table for event in events]),
        # Terms that fill up decay, whether they count or not.
        decaying=_rows_of([event.decaying for event in events], (0.0, 1.0, 0.0, 0.0)),
        fuel=_rows_of([event.fuel for event in events]),
        firing_from=_column_of(events, "firing_from"),
        pulse=_of_pulses(events),
        ice=_of_ice(events),
        clutch=_of_clutches(events),
    )


def _column_of(events: Sequence[Event], name: str) -> np.ndarray | None:
    """Collect a number that events may have, None where no event has it."""
    present = any(getattr(event, name) is not None for event in events)
    return column(events, name) if present else None


def _rows_of(
    rows: Sequence[Any], absent: tuple[float, ...] = (0.0, 0.0)
) -> np.ndarray | None:
    """Stack the rows of events, None where no event has any."""
    return padded(rows, absent) if any(rows) else None


def _seats(events: Sequence[Event], kind: str) -> tuple[int, ...]:
    """Numbers of the events of a kind."""
    return tuple(i for i, event in enumerate(events) if kind_of(event) == kind)


def _of_pulses(events: Sequence[Event]) -> Pulses | None:
    """Numbers of the pulses, None without any."""
    seats = _seats(events, "pulse")
    pulses = [events[i].pulse for i in seats]
    return collected(Pulses, Pulse, pulses, {"seats": seats}) if seats else None


def _of_ice(events: Sequence[Event]) -> Ices | None:
    """Numbers of the ice, None without any; without a case and a coefficient it has
    all of its torque.
    """
    seats = _seats(events, "ice")
    ice = [completed(sound) for i in seats if (sound := events[i].ice) is not None]
    special = {"seats": seats, "coefficient": column(ice, "coefficient", absent=1.0)}
    return collected(Ices, Ice, ice, special) if seats else None


def _of_clutches(events: Sequence[Event]) -> Clutches | None:
    """Numbers of the clutches, None without any."""
    seats = _seats(events, "clutch")
    rows = [clutch.capacity for i in seats if (clutch := events[i].clutch) is not None]
    return Clutches(seats=seats, capacity=padded(rows, (0.0, 0.0))) if seats else None


def seat_of(event: Event, disk: int | None, shaft: str) -> EventSeat:
    """The fixed part of a sound event on a disk, or with its shaft."""
    kind = kind_of(event)
    value = getattr(event, kind)
    rows = value.capacity if kind == "clutch" else value
    ice = None if event.ice is None else completed(event.ice)
    return EventSeat(
        name=event.name,
        kind=kind,
        disk=-1 if disk is None else disk,
        of=value if kind in ("misfire", "cut_off") else shaft,
        by_angle=event.begin_deg is not None,
        ends=event.end is not None,
        rows=len(rows) if kind != "ramp" and is_list(rows) else 0,
        shape="" if event.pulse is None else event.pulse.shape,
        passages=0 if ice is None else int(ice.blades) * int(ice.blocks or 1),
    )


def row_of(seat: EventSeat, field: str, row: Array) -> Array:
    """The part of a row of numbers of an event that the scene gave."""
    inner = field.rpartition(".")[2]
    if inner in ("table", "decaying", "fuel", "capacity"):
        return row[: seat.rows]
    return row


def without_effect(seat: EventSeat, field: str) -> str:
    """Say why a number of an event has no effect; empty where it has one."""
    key = field.partition(".")[0]
    if key in ("begin", "begin_deg"):
        if (key == "begin_deg") == seat.by_angle:
            return ""
        other = "begin_deg" if seat.by_angle else "begin"
        return f"it has no effect, as the event begins by {other}. Change that."
    if key == "end" and not seat.ends:
        return "it has no effect, as the event has no end. Build the scene with one."
    if key == "factor" and not seat.is_torque:
        return f"it has no effect, as the event is a {seat.kind}, no torque."
    if key in ("end", "factor", seat.kind):
        return ""
    return (
        f"it has no effect, as the event has a {seat.kind}. Build the scene with {key}."
    )

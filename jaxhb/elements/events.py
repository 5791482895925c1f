"""Events of a transient as the engineer writes them: a torque that begins at a time or
an angle, a cylinder that fails, fuel that is cut, a start, a clutch.

Ice on a propeller follows the formula that IACS UR I3 (polar class) and the
Finnish-Swedish ice class rules share. To be checked against their current text: an aid
to evaluation, no approval by a class.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from jaxhb.elements.declared import (
    REQUIRED,
    choice,
    declared,
    not_negative,
    positive,
    quantity,
    rows,
)
from jaxhb.elements.sentences import shown
from jaxhb.elements.values import (
    exactly_one,
    is_present,
    joined,
    numbers_errors,
    plain_number,
    row_errors,
    several_given,
)

TIMED = ("seconds", "torque")
FACTORS = ("seconds", "factor")
TERMS = ("torque", "decay", "hz", "phase")
RAMP = ("torque", "seconds")
"""Columns of the rows of events."""

DEG_PER_METRE = 720.0
"""Rotation in deg per m of ice thickness: the rules count N_Q = 2 H_ice revolutions of
the propeller in a milling sequence.
"""


@dataclass(frozen=True, kw_only=True)
class Pulse:
    """``pulse`` of an event: a torque that is over after ``seconds``.

    Its shape is half a sine, or a trapezoid that rises and falls for ``rise`` each, 0
    for a rectangle.
    """

    torque: float = quantity("N m")
    seconds: float = positive("s")
    shape: str = choice("half-sine", "trapezoid")
    rise: float = not_negative("s", 0.0)


@dataclass(frozen=True, kw_only=True)
class Ice:
    """``ice`` of an event: blades of a propeller that mill ice.

    Each passage of a blade brakes by ``coefficient x torque x sin(180 x /
    contact_deg)`` over the angle x from 0 to ``contact_deg`` after it; passages follow
    each other by 360 deg / (blades x blocks), and those that overlap add up. All of it
    grows linearly over the first ``ramp_deg`` and falls so over the last, and is over
    after ``angle_deg``. Angles are those of the propeller, whose disk the event names.
    ``torque`` is the Q_max of the rules, without sign, as ice only brakes.

    ``case`` 1 to 4 stands for ``coefficient`` (C_q), ``contact_deg`` (alpha_i) and
    ``blocks`` of the rules, see :data:`CASES`; ``thickness`` H_ice for ``angle_deg`` =
    720 deg x H_ice.
    """

    torque: float = positive("N m", REQUIRED, "Ice brakes: give its size.")
    blades: int = quantity("", kind="count", least=1.0, most=20.0)
    case: int | None = quantity("", None, kind="count", least=1.0, most=4.0)
    coefficient: float | None = positive("", None)
    contact_deg: float | None = quantity("deg", None, above=0.0, most=360.0)
    blocks: int | None = quantity("", None, kind="count", least=1.0, most=4.0)
    angle_deg: float | None = positive("deg", None)
    thickness: float | None = quantity(
        "m", None, kind="shorthand", above=0.0, most=20.0, remedy="Give it in m."
    )
    ramp_deg: float = not_negative("deg", 270.0)


@dataclass(frozen=True)
class Case:
    """A case of the torque excitation by ice: C_q, the largest alpha_i in deg, and the
    number of ice blocks, of which the second comes half a blade later.

    Of a case that is not ``wide`` alpha_i is at most the angle between two passages.
    """

    coefficient: float
    contact_deg: float
    blocks: int = 1
    wide: bool = False

    def contact(self, blades: int) -> float:
        """Contact angle alpha_i in deg of a propeller with so many blades."""
        if self.wide:
            return self.contact_deg
        # 90, 90, 72, 60 deg of case 1 and 45, 45, 36, 30 deg of 3 and 4 for Z = 3 .. 6
        return self.contact_deg * min(1.0, 4.0 / blades)


CASES = {
    1: Case(0.75, 90.0),
    2: Case(1.0, 135.0, wide=True),
    3: Case(0.5, 45.0, blocks=2),
    4: Case(0.5, 45.0),
}
"""Cases of the torque excitation by ice for three to six blades, Finnish-Swedish ice
class rules 2017 and IACS UR I3, as read without their text at hand: to be checked
against the current one. Earlier editions know cases 1 to 3 and the same angles for any
number of blades.
"""


@dataclass(frozen=True, kw_only=True)
class Clutch:
    """``clutch`` of an event: rows of (seconds since it begins, torque in N m that the
    clutch can carry), linear between them.
    """

    capacity: tuple = rows(TIMED, REQUIRED)


@dataclass(frozen=True, kw_only=True)
class Event:
    """``[[event]]``: a torque on a disk, or a change of the train, that begins in a
    transient.

    It begins after ``begin`` seconds, or when the reference rotor has turned by
    ``begin_deg`` since the start. Of the kinds of events it has one. Torques act on
    ``disk``, positive in the sense of its rotor and times ``factor``, until ``end`` (s,
    of the same clock as ``begin``) if that is given:

    - ``step``, N m, from then on;
    - ``ramp`` = (N m, s): rises linearly over so many seconds, and stays;
    - ``pulse``, see :class:`Pulse`;
    - ``table`` = rows of (seconds since it begins, N m), the first of 0 s, linear
      between; the last stays;
    - ``decaying`` = rows of (N m, decay s, Hz, phase deg), a sum of
      ``T exp(-t / decay) sin(2 pi f t + phase)``, as of a short circuit;
    - ``ice``, see :class:`Ice`.

    The others change the train:

    - ``misfire`` or ``cut_off``, the cylinder without injection or gas torque;
    - ``fuel`` = rows of (seconds since it begins, factor of all gas torques and all
      torques that drive), the first of 0 s;
    - ``firing_from``, rpm of the reference rotor at which the cylinders begin to fire;
    - ``clutch`` of the shaft ``between`` two disks, see :class:`Clutch`.
    """

    name: str = declared("name")
    disk: str | None = declared("disk", None)
    begin: float | None = not_negative("s", None)
    begin_deg: float | None = not_negative("deg", None)
    end: float | None = positive("s", None)
    factor: float = quantity("", 1.0)
    step: float | None = quantity("N m", None)
    ramp: tuple | None = declared("numbers", None, columns=RAMP)
    pulse: Pulse | None = declared("table", None, of=Pulse)
    table: tuple = rows(TIMED)
    decaying: tuple = rows(TERMS)
    ice: Ice | None = declared("table", None, of=Ice)
    misfire: str | None = declared("cylinder", None)
    cut_off: str | None = declared("cylinder", None)
    fuel: tuple = rows(FACTORS)
    firing_from: float | None = positive("rpm", None)
    clutch: Clutch | None = declared("table", None, of=Clutch)
    between: tuple[str, str] | None = declared("pair", None)


TORQUES = ("step", "ramp", "pulse", "table", "decaying", "ice")
MODES = ("misfire", "cut_off", "fuel", "firing_from", "clutch")
"""Kinds of events by their keys: torques on a disk, and changes of the train."""


def kind_of(event: Event) -> str:
    """Name the kind of a sound event."""
    return next(key for key in (*TORQUES, *MODES) if is_present(getattr(event, key)))


def completed(ice: Ice) -> Ice:
    """Sound ice with the numbers that its case and its thickness stand for."""
    values: dict[str, Any] = {}
    if ice.case is not None:
        case = CASES[int(ice.case)]
        values["coefficient"] = case.coefficient
        values["contact_deg"] = case.contact(int(ice.blades))
        values["blocks"] = case.blocks
    if ice.thickness is not None:
        values["angle_deg"] = DEG_PER_METRE * ice.thickness
    return replace(ice, **values)


def event_errors(event: Event) -> list[str]:
    """Check that an event has one kind, one begin, and all that its kind needs."""
    kinds = [key for key in (*TORQUES, *MODES) if is_present(getattr(event, key))]
    texts = _begin_errors(event)
    if len(kinds) > 1:
        return [*texts, f"{joined(kinds)} are given together. Keep one of them."]
    if not kinds:
        kinds_text = joined((*TORQUES, *MODES))
        return [*texts, f"it has no kind. Give one of {kinds_text}."]
    (kind,) = kinds
    texts += _place_errors(event, kind)
    check = _CHECKS.get(kind)
    return texts + (check(getattr(event, kind)) if check else [])


def _begin_errors(event: Event) -> list[str]:
    """Check begin and end against each other."""
    begins = [key for key in ("begin", "begin_deg") if getattr(event, key) is not None]
    texts = several_given(begins)
    if event.end is None:
        return texts
    if event.begin_deg is not None:
        texts.append("end is given with begin_deg. Give begin in s, or leave it out.")
    begin = 0.0 if event.begin is None else event.begin
    if plain_number(event.end) and plain_number(begin) and event.end <= begin:
        texts.append(
            f"end is {event.end:g} s, must be after begin = {begin:g} s. Correct one of"
            " them."
        )
    return texts


def _place_errors(event: Event, kind: str) -> list[str]:
    """Check that a torque has a disk and a clutch its shaft, and the others none."""
    if kind in TORQUES:
        texts = [] if event.disk is not None else [f"{kind} needs a disk. Name it."]
    else:
        unread = {"disk": event.disk, "end": event.end, "factor": event.factor}
        texts = [
            f"{key} has no part in {kind}. Leave it out."
            for key, value in unread.items()
            if value is not None and not (key == "factor" and value == 1.0)
        ]
    if kind == "clutch" and event.between is None:
        texts.append("clutch needs between. Name the two disks of its shaft.")
    if kind != "clutch" and event.between is not None:
        texts.append(f"between has no part in {kind}. Leave it out.")
    return texts


def timed_errors(name: str, columns: Sequence[str], table: Any) -> list[str]:
    """Check a sound table over the time since an event begins."""
    if row_errors(name, columns, table) or not table:
        return []
    first = float(table[0][0])
    texts = []
    if first != 0.0:
        texts.append(
            f"{name}, row 1: seconds is {first:g} s, must be 0 s, as times count from"
            " the begin. Correct the row."
        )
    negative = [row[1] for row in table if row[1] < 0.0]
    if name != "table" and negative:
        texts.append(
            f"{name}: the least {columns[1]} is {min(negative):g}, must be at least 0."
            " Correct it."
        )
    return texts


def _ramp_errors(ramp: Any) -> list[str]:
    """Check the time of a ramp."""
    if numbers_errors("ramp", RAMP, ramp) or ramp[1] > 0.0:
        return []
    return [
        f"ramp: seconds is {ramp[1]:g} s, must be greater than 0 s. Give a step, or the"
        " time of the rise."
    ]


def _pulse_errors(pulse: Any) -> list[str]:
    """Check shape and rise of a pulse."""
    if not isinstance(pulse, Pulse) or not plain_number(pulse.rise):
        return []
    if pulse.shape == "half-sine" and pulse.rise:
        return [
            f"pulse: rise is {pulse.rise:g} s, but its shape is half-sine. Give shape ="
            ' "trapezoid", or leave it out.'
        ]
    seconds = pulse.seconds
    if plain_number(seconds) and seconds > 0.0 and pulse.rise > seconds / 2:
        return [
            f"pulse: rise is {pulse.rise:g} s, must be at most half of seconds ="
            f" {pulse.seconds:g} s. Correct one of them."
        ]
    return []


def _decaying_errors(terms: Any) -> list[str]:
    """Check decay and frequency of decaying sinusoids."""
    if row_errors("decaying", TERMS, terms):
        return []
    texts = []
    for i, (_, decay, hz, _) in enumerate(terms, 1):
        if not decay > 0.0:
            texts.append(
                f"decaying, row {i}: decay is {decay:g} s, must be greater than 0 s."
                " Correct the row."
            )
        if hz < 0.0:
            texts.append(
                f"decaying, row {i}: hz is {hz:g} Hz, must be at least 0 Hz. Correct"
                " the row."
            )
    return texts


def _ice_errors(ice: Any) -> list[str]:
    """Check that ice has a case or its numbers, and one length."""
    if not isinstance(ice, Ice):
        return []
    texts = []
    by_case = ("coefficient", "contact_deg", "blocks")
    numbers = [key for key in by_case if getattr(ice, key) is not None]
    if ice.case is not None and numbers:
        texts.append(
            f"ice: case is given together with {joined(numbers)}. Keep the case, or the"
            " numbers."
        )
    if ice.case is not None and ice.blades not in (3, 4, 5, 6):
        texts.append(
            f"ice: case {shown(ice.case)} holds for 3 to 6 blades, not for"
            f" {shown(ice.blades)}. Give coefficient and contact_deg instead."
        )
    if ice.case is None and ice.contact_deg is None:
        texts.append("ice: neither case nor contact_deg is given. Give one of them.")
    lengths = exactly_one(ice, "angle_deg", "thickness")
    return texts + [f"ice: {text}" for text in lengths]


def _clutch_errors(clutch: Any) -> list[str]:
    """Check the capacity of a clutch."""
    if not isinstance(clutch, Clutch):
        return []
    if isinstance(clutch.capacity, tuple | list) and not clutch.capacity:
        return ["clutch: capacity is empty. Give rows of s and N m."]
    texts = timed_errors("capacity", TIMED, clutch.capacity)
    return [f"clutch: {text}" for text in texts]


_CHECKS: dict[str, Callable[[Any], list[str]]] = {
    "ramp": _ramp_errors,
    "pulse": _pulse_errors,
    "table": lambda table: timed_errors("table", TIMED, table),
    "decaying": _decaying_errors,
    "ice": _ice_errors,
    "fuel": lambda table: timed_errors("fuel", FACTORS, table),
    "clutch": _clutch_errors,
}
"""Checks of the value of a kind."""


def rows_errors(key: str, rows: Any) -> list[str]:
    """Check rows that take the place of those of a sound event."""
    if key == "ramp":
        return _ramp_errors(rows)
    columns = {"decaying": TERMS, "fuel": FACTORS}.get(key, TIMED)
    faults = row_errors(key, columns, rows)
    check = _CHECKS.get(key, lambda table: timed_errors(key, columns, table))
    return faults or check(rows)

"""Speeds as text, the same on the command line and in scene files, and checks of speeds
as numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from jaxhb.elements.sentences import SceneError, shown
from jaxhb.elements.units import Refused, si_number, split

if TYPE_CHECKING:
    from jaxhb._jax import Numbers
    from jaxhb.train.tables import TrainArrays

# Speed beyond which a number is no speed in rpm: the fastest turbochargers and spindles
# stay below
HIGHEST_RPM = 1e6
MOST_SPEEDS = 100_000  # of a range: answers of so many small trains fill a gigabyte
_TOO_FAST = f"must be at most {HIGHEST_RPM:.0f} rpm: give revolutions per minute"


def read_speed(text: str) -> float:
    """A speed in rpm, of a number or of a number with a unit, as ``"25 Hz"``;
    :class:`ValueError` with a sentence if it is no number greater than 0 and at most
    1e6.
    """
    value = si_number(text, "rpm")
    if isinstance(value, Refused):
        raise ValueError(f"the speed is {text!r}, {value.why}")
    try:
        value = float(value)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise ValueError(f"the speed is {text!r}, must be a number greater than 0 rpm")
    if value > HIGHEST_RPM:
        raise ValueError(f"the speed is {text!r}, {_TOO_FAST}")
    return value


def read_speeds(text: str) -> list[float]:
    """Speeds in rpm from ``A:B:COUNT``, equally spaced, or ``R1,R2,...``;
    :class:`ValueError` if it is neither.
    """
    if ":" not in text:
        return [read_speed(word) for word in with_units(text.split(","))]
    words = text.split(":")
    words[:-1] = with_units(words[:-1])
    if len(words) != 3:
        raise ValueError(
            f"{text!r} is not A:B:COUNT, as 600:2450:20 (rpm, rpm, number of speeds)"
        )
    first = read_speed(words[0])
    last = read_speed(words[1])
    if not words[2].isdecimal() or int(words[2]) < 1:
        raise ValueError(f"{words[2]!r} must be a whole number of at least 1")
    count = int(words[2])
    if count > MOST_SPEEDS:
        raise ValueError(
            f"{text!r} asks for {count} speeds: give at most {MOST_SPEEDS}"
        )
    if count == 1 and first != last:
        raise ValueError(
            f"{text!r} asks for one speed between two: give a COUNT of at least 2"
        )
    return [first + (last - first) * i / max(count - 1, 1) for i in range(count)]


def with_units(words: Sequence[str]) -> list[str]:
    """Numbers with the unit of the last behind each; :class:`ValueError` where they
    have others.

    >>> with_units(["10", "40 Hz"])
    ['10 Hz', '40 Hz']
    """
    numbers = [split(word) for word in words]
    unit = numbers[-1][1]
    others = [other for _, other in numbers if other not in ("", unit)]
    if others:
        raise ValueError(
            f"{':'.join(words)!r} has the unit {others[0]!r} and"
            f" {repr(unit) if unit else 'none behind the last number'}: write one unit,"
            " behind the last"
        )
    return [f"{number} {unit}" for number, _ in numbers] if unit else [*words]


def read_range(text: str) -> tuple[str, list[float] | list[str]]:
    """``(NAME.FIELD, [values])`` from ``NAME.FIELD=A:B:COUNT`` or ``=V1,V2,...``, whose
    last value may have a unit, that of all, and then all have it;
    :class:`ValueError` with a sentence if it is neither.
    """
    key, equals, values = text.rpartition("=")
    words = values.split(":")
    ends = words[:-1] if len(words) == 3 else values.split(",")
    unit = split(with_units(ends)[-1])[1]
    ends = [split(end)[0] for end in ends]
    try:
        if len(words) == 3:
            words[:-1] = ends
            first = float(words[0])
            last = float(words[1])
            steps = int(words[2])
            most = min(steps, MOST_SPEEDS + 1)
            numbers = [first + (last - first) * i / (steps - 1) for i in range(most)]
        else:
            numbers = [float(word) for word in ends]
    except (ValueError, ZeroDivisionError):
        numbers = []
    if not equals or len(numbers) < 2 or not all(map(math.isfinite, numbers)):
        raise ValueError(
            f"{text!r} is not NAME.FIELD=A:B:COUNT with a COUNT of at least 2, as"
            ' "crank damper.damping=100:400:13" or =100,200,400'
        )
    if len(numbers) > MOST_SPEEDS:
        raise ValueError(
            f"{text!r} asks for more than {MOST_SPEEDS} values: give fewer"
        )
    if unit:
        return key.strip(), [f"{number!r} {unit}" for number in numbers]
    return key.strip(), numbers


def check_speed(train: TrainArrays, rpm: Numbers, *, many: bool = False) -> None:
    """Refuse a speed that is not a positive number or beyond any train, and several
    speeds unless ``many`` are allowed.

    One that is traced is not known yet: where it is no speed, a status says so. In a
    process forked after a solve nothing can be computed, whatever the speed.
    """
    import numpy as np  # the command line reads speeds before it imports anything heavy

    from jaxhb._jax import check_fork, traced

    check_fork()
    if traced(rpm):
        return
    name = train.topology.title
    try:
        speeds = np.asarray(rpm)
    except ValueError:  # rows of different lengths
        speeds = np.array(None)
    if speeds.size and speeds.dtype.kind not in "iuf":
        raise SceneError(
            f"{name}: the speed is {shown(rpm)}, must be a number greater than 0 rpm."
        )
    values = np.atleast_1d(speeds)
    if values.ndim > 1:
        raise SceneError(
            f"{name}: the speeds are an array of {' x '.join(map(str, values.shape))},"
            " must be numbers in one row."
        )
    if speeds.ndim and not many:
        raise SceneError(
            f"{name}: {values.size} speeds were given where one is solved: use"
            " jaxhb.solve_speeds."
        )
    if not values.size:
        raise SceneError(f"{name}: no speed is given: name at least one, in rpm.")
    for value in values:
        if not (np.isfinite(value) and value > 0):
            raise SceneError(
                f"{name}: the speed is {value:g} rpm, must be greater than 0 rpm: a"
                " running engine."
            )
        if value > HIGHEST_RPM:
            raise SceneError(f"{name}: the speed is {value:g} rpm, {_TOO_FAST}.")

"""Readers of the values of options: each takes a word and raises a ValueError that says
what is wrong.
"""

import math
from functools import partial

from jaxhb.elements.units import Refused, chosen_units, has_unit, si_number, split
from jaxhb.train.speeds import read_speeds, with_units

RANGE_COUNT = 33  # speeds of a range that has no count


def one_speed(text: str) -> float:
    """A speed in rpm, where a command takes no more than one."""
    speeds = speed_range(text)
    if len(speeds) > 1:
        raise ValueError(
            f"{text!r} are {len(speeds)} speeds, and this command takes one: jaxhb"
            " sweep and jaxhb report take several"
        )
    return speeds[0]


def speed_range(text: str) -> list[float]:
    """Speeds in rpm from ``A:B[:COUNT]`` or ``R1,R2,...``."""
    return read_speeds(f"{text}:{RANGE_COUNT}" if text.count(":") == 1 else text)


def orders(text: str) -> list[float]:
    """Orders from ``N1,N2,...``."""
    return [positive(word) for word in text.split(",")]


def positive(
    text: str, below: float = math.inf, bound: str = "", unit: str = ""
) -> float:
    """A number greater than 0, in a ``unit`` where one is written."""
    value = _number(text, unit)
    if not 0 < value < below:
        in_unit = f" {unit}" if unit else ""
        raise ValueError(f"{text!r} must be a number greater than 0{in_unit}{bound}")
    return value


seconds = partial(positive, unit="s")
frequency = partial(positive, unit="Hz")
speed_step = partial(positive, unit="rpm")


def speed_rows(text: str) -> list[tuple[float, float]]:
    """Rows of (s, rpm) from ``S:RPM,S:RPM,...``; what they hold is checked later."""
    rows = [word.split(":") for word in text.split(",")]
    if all(len(row) == 2 for row in rows):
        times, speeds = (with_units(column) for column in zip(*rows, strict=True))
        numbers = [
            (_number(time, "s"), _number(speed, "rpm"))
            for time, speed in zip(times, speeds, strict=True)
        ]
        if not any(math.isnan(sum(row)) for row in numbers):
            return numbers
    raise ValueError(
        f"{text!r} is not S:RPM,S:RPM,..., seconds and speeds in rpm, as 0:0,20:120"
    )


def speed_pair(text: str) -> tuple[float, float]:
    """Two speeds in rpm from ``LOW:HIGH``."""
    ends = [_number(word, "rpm") for word in with_units(text.split(":"))]
    if len(ends) != 2 or not 0 <= ends[0] < ends[1]:
        raise ValueError(f"{text!r} is not LOW:HIGH, speeds in rpm, as 400:450")
    return ends[0], ends[1]


def angle(text: str) -> float:
    """An angle in deg."""
    value = _number(text, "deg")
    if math.isnan(value):
        raise ValueError(f"{text!r} must be a number")
    return value


share = partial(positive, below=1.0, bound=" and less than 1, as 0.01 for 1 %")


def whole(text: str, least: int = 1) -> int:
    """A whole number."""
    if not text.isdecimal() or int(text) < least:
        raise ValueError(f"{text!r} must be a whole number of at least {least}")
    return int(text)


count = partial(whole, least=0)


def setting(text: str) -> tuple[str, float | str]:
    """``(NAME.FIELD, VALUE)``, the value a number, a number with a unit, or a word."""
    key, equals, word = text.rpartition("=")
    value = _number(word)
    word = word.strip()
    if equals and has_unit(word):
        return key.strip(), word
    if not equals or not word:
        raise ValueError(
            f'{text!r} is not NAME.FIELD=VALUE, as "crank damper.damping=300"'
        )
    is_word = word.isidentifier() and word.lower() not in ("nan", "inf", "infinity")
    if math.isnan(value) and not is_word:
        raise ValueError(
            f"{text!r}: {word} is not a number; values are numbers in SI units,"
            " such as 3.6e4, or with a unit, such as 36 kN m/rad"
        )
    return key.strip(), word if math.isnan(value) else value


def units(text: str) -> dict[str, str]:
    """Units of quantities from ``QUANTITY=UNIT,...``."""
    pairs = [word.partition("=") for word in text.split(",")]
    if not all(equals and unit.strip() for _, equals, unit in pairs):
        raise ValueError(
            f'{text!r} is not QUANTITY=UNIT,..., as "torque=kN m,angle=mrad"'
        )
    by_quantity = {quantity.strip(): unit.strip() for quantity, _, unit in pairs}
    chosen_units(by_quantity)
    return by_quantity


def bounded(text: str) -> tuple[str, tuple[float | str, float | str]]:
    """``(NAME.FIELD, (LOW, HIGH))`` from ``NAME.FIELD=LOW:HIGH``; ends with a unit stay
    texts.
    """
    key, equals, words = text.rpartition("=")
    ends_with_units = with_units(words.split(":"))
    ends = [_number(split(word)[0]) for word in ends_with_units]
    if not equals or len(ends) != 2 or not ends[0] < ends[1]:
        raise ValueError(
            f'{text!r} is not NAME.FIELD=LOW:HIGH, as "cyl6|flywheel.stiffness=1e6:4e6"'
        )
    if has_unit(ends_with_units[0]):
        return key.strip(), (ends_with_units[0], ends_with_units[1])
    return key.strip(), (ends[0], ends[1])


def place(text: str) -> tuple[str, float]:
    """``(hz | amplitude | rpm, VALUE)``."""
    name, _, number = text.partition("=")
    unit = {"hz": "Hz", "amplitude": "rad", "rpm": "rpm"}.get(name)
    value = math.nan if unit is None else _number(number, unit)
    if not value >= 0:
        raise ValueError(
            f"{text!r} is none of hz=VALUE, amplitude=VALUE and rpm=VALUE, VALUE at"
            " least 0"
        )
    return name, value


def _number(text: str, unit: str = "") -> float:
    """A finite number, in a ``unit`` where one is written, or nan; :class:`ValueError`
    with a sentence if the written one does not fit.
    """
    number = si_number(text, unit) if unit else text
    if isinstance(number, Refused):
        raise ValueError(f"{text!r} {number.why}")
    try:
        value = float(number)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan

"""How the values of options are read: each reader takes a word and raises a ValueError that says what is wrong."""

import math
import re

from jaxhb.train.speeds import read_speed, read_speeds

RANGE_COUNT = 33
"""Speeds of a range that has no count."""


def one_speed(text):
    """A speed in rpm, where a command takes no more than one."""
    if not {",", ":"} & set(text):
        return read_speed(text)
    several = len(speed_range(text))
    commands = "jaxhb sweep and jaxhb report take several"
    raise ValueError(f"{text!r} are {several} speeds, and this command takes one: {commands}")


def speed_range(text):
    """Speeds in rpm from ``A:B[:COUNT]`` or ``R1,R2,...``."""
    return read_speeds(f"{text}:{RANGE_COUNT}" if text.count(":") == 1 else text)


def orders(text):
    """Orders from ``N1,N2,...``."""
    return [positive(word) for word in text.split(",")]


def positive(text):
    """A number greater than 0 from the command line."""
    value = _number(text)
    if not value > 0:
        raise ValueError(f"{text!r} must be a number greater than 0")
    return value


def whole(text, least=1):
    """A whole number of at least 1 from the command line."""
    if not text.isdecimal() or int(text) < least:
        raise ValueError(f"{text!r} must be a whole number of at least {least}")
    return int(text)


def count(text):
    """A whole number of at least 0 from the command line."""
    return whole(text, least=0)


def share(text):
    """A number between 0 and 1 from the command line."""
    value = _number(text)
    if not 0 < value < 1:
        raise ValueError(f"{text!r} must be a number greater than 0 and less than 1, as 0.01 for 1 %")
    return value


def setting(text):
    """``(NAME.FIELD, VALUE)`` from the command line, the value a number or a word."""
    key, equals, word = text.rpartition("=")
    value, word = _number(word), word.strip()
    if not equals or not word:
        raise ValueError(f'{text!r} is not NAME.FIELD=VALUE, as "crank damper.damping=300"')
    if not math.isnan(value):
        return key.strip(), value
    if re.fullmatch(r"[^\W\d_]\w*", word) and word.lower() not in ("nan", "inf", "infinity"):
        return key.strip(), word
    raise ValueError(f"{text!r}: {word} is no number; values are numbers in SI units, as 3.6e4")


def over(text):
    """``(NAME.FIELD, [values])`` from the command line."""
    key, equals, values = text.rpartition("=")
    words = values.split(":")
    try:
        if len(words) == 1:
            found = [float(word) for word in values.split(",")]
        else:
            first, last, steps = float(words[0]), float(words[1]), int(words[2])
            found = [first + (last - first) * i / (steps - 1) for i in range(steps)]
    except (ValueError, IndexError, ZeroDivisionError):
        found = []
    if not equals or len(words) not in (1, 3) or len(found) < 2 or not all(map(math.isfinite, found)):
        example = '"crank damper.damping=100:400:13" or =100,200,400'
        raise ValueError(f"{text!r} is not NAME.FIELD=A:B:COUNT with a COUNT of at least 2, as {example}")
    return key.strip(), found


def place(text):
    """``(hz | amplitude | rpm, VALUE)`` from the command line."""
    name, _, number = text.partition("=")
    value = _number(number)
    if name not in ("hz", "amplitude", "rpm") or not value >= 0:
        raise ValueError(f"{text!r} is none of hz=VALUE, amplitude=VALUE and rpm=VALUE, VALUE at least 0")
    return name, value


def _number(text):
    """A finite number, or nan."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan

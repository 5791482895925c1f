"""Numbers in columns of tables, and how they are written."""

import math
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import numpy as np

NONE = "-"
# Behind numbers that are not converged, or not confirmed by harmonic balance
DOUBT = "?"

ROUNDING = 1e-9  # size of a number that is zero but for rounding

Way = Callable[[Any], str] | Hashable
"""How a column is written: by a function of one value, or by a key that is shared by
the columns of numbers that get the same decimals.
"""


class Doubtful(float):
    """A number that is written with a mark behind it."""


def alike(*columns: Sequence[float], least: int = 0) -> list[list[str]]:
    """Write columns of numbers with the same decimals: four significant digits for the
    largest of all, and at ``least`` so many.
    """
    numbers = [[float(value) for value in column] for column in columns]
    largest = max(
        (abs(x) for column in numbers for x in column if math.isfinite(x)), default=0.0
    )
    places = least
    if largest:
        places = min(max(3 - math.floor(math.log10(largest)), least), 12)
    return [[_with_places(value, places) for value in column] for column in numbers]


def _with_places(value: float, places: int) -> str:
    """A number with so many decimals, a dash where it is not known."""
    # Adding 0.0 after rounding turns -0.0 into 0.0.
    return f"{round(value, places) + 0.0:.{places}f}" if math.isfinite(value) else NONE


def fixed(value: float, places: int) -> str:
    """A number with so many decimals; one that is too small for them and more than
    rounding with two digits, a dash where it is not known.
    """
    if not math.isfinite(value):
        return NONE
    rounded = round(float(value), places) + 0.0
    if rounded == 0 and abs(value) > ROUNDING:
        return plain_number(float(value), 2)
    return f"{rounded:.{places}f}"


def plain_number(value: float, digits: int = 4) -> str:
    """A number with so many digits, as 12340, without a power of ten where that is
    readable.
    """
    value = value + 0.0  # no minus zero
    if not 1e-4 <= abs(value) < 1e7:
        return f"{value:.{digits}g}"
    return np.format_float_positional(float(f"{value:.{digits}g}"), trim="-")


def percent(share: float | None) -> str:
    """A share in %, a small one not as 0, a dash where it is not known."""
    if share is None or not math.isfinite(share):
        return NONE
    return "<0.1" if 0 < share < 5e-4 else f"{100 * share:.1f}"


def count(number: float) -> str:
    """A number of events, three digits, a dash where it is not known."""
    return plain_number(number, digits=3) if math.isfinite(number) else NONE


def hit(speed: float) -> str:
    """Approach speed of an impact in m/s, a small one with two digits, a dash without
    an impact.
    """
    return fixed(speed, 2) if speed > 0 else NONE


def irregular(share: float) -> str:
    """Cyclic irregularity in %, a dash where it is not known."""
    return count(100 * share)


def ratio(pair: tuple[float, float]) -> str:
    """A quotient with two decimals, a dash where nothing is compared."""
    value = float(pair[0]) / float(pair[1]) if pair[1] else math.nan
    return f"{value:.2f}" if math.isfinite(value) else NONE


WAYS: dict[str, Way] = {
    "percent": percent,
    "count": count,
    "hit": hit,
    "irregular": irregular,
}
"""Ways in which numbers of answers are written, by the words of
:class:`jaxhb.results.quantities.Variable`.
"""

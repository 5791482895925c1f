"""Rules that keep torsional natural frequencies away from excitation.

To be checked against their current texts: an aid to evaluation, no approval.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Margin:
    """A rule of separation margins: its publication, the least distance of a natural
    frequency to an excitation at any operating speed, as a share of that excitation,
    and the excitations as orders of the speed of each rotor.
    """

    name: str
    source: str
    least: float
    orders: tuple[int, ...]


MARGINS = {
    margin.name: margin
    for margin in (
        Margin(
            name="API",
            source="API 617, 671 and 677: 10 % to 1x and 2x of each rotor",
            least=0.1,
            orders=(1, 2),
        ),
    )
}
"""Rules of separation margins by name."""

"""Orders in words: beside that of the reference rotor the order of the geared rotor
that makes it, as 4 of a propeller behind a reduction of 5, which is order 0.8.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.kinematics import speed_ratios
from jaxhb.train.topology import Topology

# Difference of a speed ratio from 1 up to which a rotor turns as the reference rotor
SAME = 1e-9


@dataclass(frozen=True)
class OrderNames:
    """Names of orders: ``makers`` has by harmonic of the cycle the order in revolutions
    of the geared rotor that makes it, and a disk of it, ``"4 of propeller"``.
    """

    revolutions_per_cycle: float
    makers: dict[int, str]

    def number(self, order: float) -> str:
        """Name an order of the reference rotor, and who makes it: ``"0.8 (4 of
        propeller)"``.
        """
        maker = self.makers.get(round(order * self.revolutions_per_cycle))
        return f"{order:g} ({maker})" if maker else f"{order:g}"


NUMBERS = OrderNames(1.0, {})
"""Orders by their numbers alone."""


def order_names(train: DriveTrain) -> OrderNames:
    """Name the orders that excite a train; those that the reference rotor makes as well
    have their numbers alone. Rotors that make an order at the same number of their own
    are named by the first disk: cylinders, and engines side by side.
    """
    topology = train.topology
    cycle = train.topology.revolutions_per_cycle
    ratios = np.asarray(speed_ratios(train))[np.array(topology.rotor, dtype=int)]
    by_reference: set = set()
    makers: dict[int, dict[str, str]] = {}
    for disk, harmonics, of_own_rotor in _sources(topology):
        if not of_own_rotor or abs(ratios[disk] - 1) <= SAME:
            by_reference.update(harmonics)
            continue
        for n in harmonics:
            number = f"{n / cycle / ratios[disk]:.6g}"
            makers.setdefault(n, {}).setdefault(number, topology.disk_names[disk])
    by_geared_rotor = {
        n: ", ".join(f"{number} of {disk}" for number, disk in by_number.items())
        for n, by_number in makers.items()
        if n not in by_reference
    }
    return OrderNames(cycle, by_geared_rotor)


def _sources(topology: Topology) -> Iterator[tuple[int, Sequence[int], bool]]:
    """Disk, harmonics of the cycle, and whether they are orders of the disk's own
    rotor, of all that excites.
    """
    for seats in topology.excitations:
        yield from zip(seats.disk, seats.listed(), seats.of_own_rotor, strict=True)
    loads = topology.load_harmonics or [()] * len(topology.load_disk)
    yield from (
        (disk, row, True) for disk, row in zip(topology.load_disk, loads, strict=True)
    )

"""Distance of torsional natural frequencies from excitations at the operating speeds,
by rules of separation margins: an aid to evaluation, no approval.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jaxhb.elements.rules.margins import MARGINS
from jaxhb.linear.critical import ELASTIC
from jaxhb.linear.modal import Modes
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.kinematics import speed_ratios


@dataclass(frozen=True)
class Separation:
    """Distance of a natural frequency from an ``order`` of the speed of a rotor.

    Parameters
    ----------
    rule : str, its name; mode : int, counted from 0; hz : float, natural frequency
    rotor : str, the reference disk of the reference rotor, of others the first
    low_hz, high_hz : float, of the order at the lowest and highest operating speed
    least : float, margin that the rule asks for, a share
    """

    rule: str
    mode: int
    hz: float
    rotor: str
    order: int
    low_hz: float
    high_hz: float
    least: float

    @property
    def margin(self) -> float:
        """Distance over the nearest frequency of the order, 0 where it is met."""
        return max(self.hz / self.high_hz - 1.0, 1.0 - self.hz / self.low_hz, 0.0)

    @property
    def kept(self) -> bool:
        """Whether the rule is kept."""
        return self.margin >= self.least


def separations(
    train: DriveTrain, modes: Modes, kinds: Sequence[str]
) -> list[Separation]:
    """Compute the :class:`Separation` of every elastic mode from every order of every
    rotor, of the rules of separation margins that the scene chooses; empty without.

    ``kinds`` of the modes as of :func:`jaxhb.linear.critical.modes_of`.
    """
    topology = train.topology
    rules = [MARGINS[name] for name in topology.rules.names if name in MARGINS]
    if not rules:
        return []
    low, high = topology.operating_rpm
    ratios = np.abs(np.asarray(speed_ratios(train)))
    disks = [topology.rotor.index(k) for k in range(len(ratios))]
    disks[topology.reference_rotor] = topology.reference_disk
    rotors = [topology.disk_names[disk] for disk in disks]
    return [
        Separation(
            rule=rule.name,
            mode=mode,
            hz=float(hz),
            rotor=rotor,
            order=order,
            low_hz=float(order * ratio * low / 60.0),
            high_hz=float(order * ratio * high / 60.0),
            least=rule.least,
        )
        for rule in rules
        for mode, hz in enumerate(modes.frequencies_hz)
        if kinds[mode] == ELASTIC
        for rotor, ratio in zip(rotors, ratios, strict=True)
        for order in rule.orders
    ]

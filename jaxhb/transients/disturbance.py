"""Events of a transient as a program takes them."""

from __future__ import annotations

from dataclasses import dataclass, field

import jax

from jaxhb._jax import Array
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.transients.events import event_torques, fuel_factor


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Disturbance:
    """Events of a transient: E torques by their names and begins ``(E,)`` s, and fuel
    likewise ``(F,)``; start_angles ``(E,)`` rad, at which the torques begin.
    """

    train: DriveTrain
    begins: Array
    start_angles: Array
    fuel_begins: Array
    torques: tuple[str, ...] = field(metadata={"static": True})
    fuels: tuple[str, ...] = field(metadata={"static": True})

    def torque(self, seconds: Array, angle: Array) -> Array:
        """Torques ``(n, E)`` N m on their disks."""
        return event_torques(
            self.train, self.torques, seconds, angle, self.begins, self.start_angles
        )

    def fuel(self, seconds: Array) -> Array:
        """Factor ``(n,)`` of gas torques and torques that drive."""
        return fuel_factor(self.train, self.fuels, seconds, self.fuel_begins)

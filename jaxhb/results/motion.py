"""Readers by name of any motion: of a response, of recorded cycles, and of a steady
state, which is one of the two.
"""

from typing import Any, Generic, TypeVar, cast

import numpy as np

from jaxhb.train.topology import Topology

SignalOf = TypeVar("SignalOf")
ContactOf = TypeVar("ContactOf")
NumberOf = TypeVar("NumberOf")


ROUNDING = 1e-9  # share of the peak below which a mean counts as 0


def drive_sense(motion: Any, name: str) -> int:
    """Sign with which the force or torque of a mesh, shaft or damper is shown, so that
    it does not depend on which of its ends the scene names first.

    It is the sign of the mean; without a mean it is +1 where the first end comes before
    the second in the list of disks.
    """
    topology = motion.topology
    signal = motion.force(name) if name in topology.mesh_names else motion.torque(name)
    return sense_of(topology, name, signal)


def sense_of(topology: Topology, name: str, signal: Any) -> int:
    """:func:`drive_sense` of a link whose signal has been read."""
    mean = float(signal.mean)
    first, second = topology.link_ends[topology.link_index(name)[0]]
    if abs(mean) > ROUNDING * float(signal.peak):
        return 1 if mean > 0 else -1
    return 1 if first < second else -1


class Motion(Generic[SignalOf, ContactOf, NumberOf]):
    """Readers by name. ``_read(quantity, index, sense)`` of a subclass gives a quantity
    of the disk, gear, link or mesh ``index``, or of the two disks of a twist, times
    ``sense``.
    """

    topology: Topology
    solution: Any
    """:class:`jaxhb.Response` that the numbers are read from; None for recorded
    cycles.
    """
    _read: Any

    def disk(self, name: str) -> SignalOf:
        """Vibratory angle of a disk or damper ring, rad; its own sense of rotation
        positive.
        """
        return self._read("angle", self.topology.disk_index(name))

    def speed(self, name: str) -> SignalOf:
        """Speed of rotation of a disk or damper ring, rad/s: the mean speed of its
        rotor and the vibration.
        """
        return self._read("speed", self.topology.disk_index(name))

    def acceleration(self, name: str) -> SignalOf:
        """Angular acceleration of a disk or damper ring, rad/s2; recorded cycles have
        none.
        """
        return self._read("acceleration", self.topology.disk_index(name))

    def irregularity(self, name: str) -> NumberOf:
        """Cyclic irregularity of a disk: (largest - smallest speed) / mean speed; of a
        record over all its cycles.
        """
        speed: Any = self.speed(name)
        return 2 * speed.half_peak_to_peak / speed.mean

    def twist(self, a: str, b: str) -> SignalOf:
        """Angle of disk a less angle of disk b, rad; of a record only where a shaft or
        damper joins them.
        """
        return self._read(
            "twist", (self.topology.disk_index(a), self.topology.disk_index(b))
        )

    def torque(self, a: str, b: str | None = None) -> SignalOf:
        """Torque transmitted by a shaft or damper in N m, positive when a is ahead of
        b.

        ``a, b`` : the two disks (a damper's ring goes by the damper's name); or the
        link's name alone, as in all readers of links. Elastic, viscous and loss-factor
        part together; ``.elastic`` for the stiffness alone.
        """
        index, sense = self.topology.link_index(a, b)
        if index >= self._shafts:
            mesh = self.topology.link_names[index]
            raise ValueError(
                f"{mesh!r} is a mesh, not a shaft: use force(...) for its tooth force"
                " in N"
            )
        return self._read("torque", index, sense)

    def force(self, a: str, b: str | None = None) -> SignalOf:
        """Tooth force transmitted by the mesh between gears a and b in N, positive when
        a drives b.

        Elastic and damping part together; ``.elastic`` for f(l) alone. ``force(b, a)``
        is the negative.
        """
        index, sense = self._mesh_index(a, b)
        return self._read("force", index, sense)

    def deflection(self, a: str, b: str | None = None) -> SignalOf:
        """Deflection l = r_a phi_a - r_b phi_b of a mesh, m."""
        index, sense = self._mesh_index(a, b)
        return self._read("deflection", index, sense)

    def transmission_error(self, a: str, b: str | None = None) -> SignalOf:
        """Loaded transmission error of a mesh in m, how far its gears approach each
        other along the pitch circle: deflection and transmission error of the teeth;
        recorded cycles have none.
        """
        index, sense = self._mesh_index(a, b)
        return self._read("transmission_error", index, sense)

    def mesh_order(self, a: str, b: str | None = None) -> float:
        """Mesh periods in a revolution of the reference rotor: the order at which a
        mesh with ``stiffness_orders`` or ``transmission_error`` whines; ValueError for
        any other mesh.
        """
        index, _ = self._mesh_index(a, b)
        if not self.topology.mesh_periods[index]:
            name = self.topology.mesh_names[index]
            raise ValueError(
                f"{name!r} has neither stiffness_orders nor transmission_error: nothing"
                " makes it whine"
            )
        return self.topology.mesh_periods[index] / self.topology.revolutions_per_cycle

    def whine(self, a: str, b: str | None = None, *, orders: int = 3) -> Any:
        """Amplitudes ``(orders,)`` in N of the tooth force at the orders 1, 2, .. of
        the mesh period, which a mesh with ``stiffness_orders`` or
        ``transmission_error`` has; nan for orders that are not recorded.
        """
        period = self.mesh_order(a, b)
        force = cast(Any, self.force(a, b))
        highest = max(force.orders, default=0.0)
        return np.array(
            [
                force.order(k * period) if k * period <= highest else np.nan
                for k in range(1, orders + 1)
            ]
        )

    def gear_torque(self, name: str) -> SignalOf:
        """Torque that a gear passes to its mates, the sum of its mesh forces x radius,
        N m.
        """
        disk = self.topology.disk_index(name)
        if not any(disk in ends for ends in self.topology.mesh_ends):
            raise ValueError(f"{name!r} carries no mesh: gear_torque needs a gear")
        return self._read("gear_torque", disk)

    def power(self, a: str, b: str | None = None) -> NumberOf:
        """Mean power in W that a shaft, damper or mesh turns into heat; nan of a mesh
        of recorded cycles.

        Exact from the harmonics of a response,

            P = sum_{n >= 1} 2 Re(T^n conj(i n Omega theta^n)),

        T the transmitted torque and theta the twist, or tooth force and deflection; the
        elastic part does no work.
        """
        return self._read("power", self.topology.link_index(a, b)[0])

    def mesh(self, a: str, b: str | None = None) -> ContactOf:
        """Contact of a mesh over the cycle; its drive side is that of the scene's order
        of gears.
        """
        return self._read("contact", self._mesh_index(a, b)[0])

    @property
    def _shafts(self) -> int:
        """Number of shafts and dampers, the links before the meshes."""
        return len(self.topology.link_names) - len(self.topology.mesh_names)

    def _mesh_index(self, a: str, b: str | None) -> tuple[int, int]:
        """Index of a mesh among the meshes, and its sense."""
        index, sense = self.topology.link_index(a, b)
        if index < self._shafts:
            name = self.topology.link_names[index]
            raise ValueError(
                f"{name!r} is a shaft or damper, not a mesh: use torque(...) for its"
                " torque in N m"
            )
        return index - self._shafts, sense

"""What a train does after it has run long enough: the kind of its motion, and the numbers of that motion."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from jaxhb.results.dataset import Dataset, to_xarray
from jaxhb.results.display import state_html, state_line, states_html, states_line
from jaxhb.results.record import Record, RecordedSignal, SteadyContact, SteadySignal
from jaxhb.results.response import Response
from jaxhb.train.topology import Topology

KINDS = "contact", "periodic", "subharmonic", "irregular", "unknown"


@dataclass(frozen=True)
class SteadyState:
    """What a train does at one speed after it has run long enough; made by :func:`jaxhb.steady_state`.

    Parameters
    ----------
    rpm : float
    kind : str
        "contact" : no teeth part. "periodic" : period one cycle. "subharmonic" : ``period`` cycles. "irregular" : none
        of these within the cycles marched. "unknown" : ``notes`` say why.
    period : int
        In cycles of the excitation; 0 for irregular and unknown motion.
    response : Response or None
        The harmonic solution of a periodic or subharmonic motion; of a subharmonic one over ``period`` cycles, whose
        orders are multiples of ``1 / (period x revolutions_per_cycle)``.
    record : Record or None
        Numbers of the recorded cycles where there is no response.
    cycles : int
        Cycles marched.
    notes : tuple of str
        What to know about the numbers: how time integration takes loss factors, why a kind is unknown.
    motion : array ``(2S,)`` or None
        Displacements in m and velocities in m/s of the disks at the end of the march, at the beginning of a cycle:
        where a neighbouring speed starts.
    topology : Topology
    stability : Stability or None
        Of ``response``, as :func:`jaxhb.stability` gives it; None where contact follows from the linear motion and
        nothing was marched, and where it is not decided: ``notes`` then say why.
    started_from : float or None
        Speed in rpm of the motion from which this one was marched: a neighbour's in a sweep, or that of ``start``; None
        from teeth at rest on their drive sides.
    """

    rpm: float
    kind: str
    period: int
    response: Response | None
    record: Record | None
    cycles: int
    notes: tuple
    motion: np.ndarray | None
    topology: Topology
    stability: object = None
    started_from: float | None = None

    def __repr__(self):
        return state_line(self)

    def _repr_html_(self):
        return state_html(self)

    @property
    def known(self) -> bool:
        """Whether the kind of motion is known."""
        return self.kind != "unknown"

    def _signal(self, name, *args):
        found = getattr(self.response, name)(*args)
        # Period 0 stands for a response that did not converge, which has one cycle.
        return SteadySignal(**vars(found), cycles=max(self.period, 1))

    def _read(self) -> Record | None:
        """The record where that is what to read; a sentence where there is nothing."""
        if self.response is None and self.record is None:
            raise ValueError(f"the motion at {self.rpm:g} rpm is unknown: {' '.join(self.notes)}")
        return self.record if self.response is None else None

    def disk(self, name: str) -> SteadySignal | RecordedSignal:
        """Vibratory angle of a disk or damper ring, rad."""
        record = self._read()
        return record.disks[self.topology.disk_index(name)] if record else self._signal("disk", name)

    def speed(self, name: str) -> SteadySignal | RecordedSignal:
        """Speed of rotation of a disk or damper ring, rad/s: the mean speed of its rotor and the vibration."""
        record = self._read()
        return record.speeds[self.topology.disk_index(name)] if record else self._signal("speed", name)

    def acceleration(self, name: str) -> SteadySignal:
        """Angular acceleration of a disk or damper ring, rad/s2; a record has none."""
        if self._read():
            raise ValueError(f"the motion at {self.rpm:g} rpm has no period: its record holds no accelerations")
        return self._signal("acceleration", name)

    def irregularity(self, name: str) -> float:
        """Cyclic irregularity of a disk, (largest - smallest speed) / mean speed; of a record over all its cycles."""
        speed = self.speed(name)
        return float(2 * speed.half_peak_to_peak / speed.mean)

    def power(self, a: str, b: str | None = None) -> float:
        """Mean power in W that a shaft, damper or mesh turns into heat; nan of a mesh of a record."""
        record = self._read()
        if record is None:
            return float(cast(Response, self.response).power(a, b))
        index, _ = self.topology.link_index(a, b)
        return record.heat[index] if index < len(record.heat) else float("nan")

    def twist(self, a: str, b: str) -> SteadySignal | RecordedSignal:
        """Angle of disk a less angle of disk b, rad; of a record only where a shaft or damper joins them."""
        record = self._read()
        if record is None:
            return self._signal("twist", a, b)
        index, sense = self.topology.link_index(a, b)
        if index >= len(record.twists):
            raise ValueError(f"a record holds the twists of shafts and dampers, and a mesh joins {a!r} and {b!r}")
        return _sensed(record.twists[index], sense)

    def torque(self, a: str, b: str | None = None) -> SteadySignal | RecordedSignal:
        """Torque transmitted by a shaft or damper in N m, positive when a is ahead of b."""
        record = self._read()
        if record is None:
            return self._signal("torque", a, b)
        index, sense = self.topology.link_index(a, b)
        if index >= len(record.torques):
            raise ValueError(f"{self.topology.link_names[index]!r} is a mesh, not a shaft: use force(...)")
        return _sensed(record.torques[index], sense)

    def _mesh(self, a, b):
        index, sense = self.topology.link_index(a, b)
        index -= len(self.topology.link_names) - len(self.topology.mesh_names)
        if index < 0:
            raise ValueError(f"{a!r}{f' and {b!r} join' if b else ' is'} a shaft or damper: use torque(...)")
        return index, sense

    def force(self, a: str, b: str | None = None) -> SteadySignal | RecordedSignal:
        """Tooth force transmitted by a mesh in N, positive when a drives b; ``.elastic`` for f(l) alone."""
        record = self._read()
        if record is None:
            return self._signal("force", a, b)
        index, sense = self._mesh(a, b)
        return _sensed(record.forces[index], sense)

    def deflection(self, a: str, b: str | None = None) -> SteadySignal | RecordedSignal:
        """Deflection of a mesh, m."""
        record = self._read()
        if record is None:
            return self._signal("deflection", a, b)
        index, sense = self._mesh(a, b)
        return _sensed(record.deflections[index], sense)

    def gear_torque(self, name: str) -> SteadySignal | RecordedSignal:
        """Torque that a gear passes to its mates, N m."""
        record = self._read()
        if record is None:
            return self._signal("gear_torque", name)
        disk = self.topology.disk_index(name)
        if disk not in record.gears:
            raise ValueError(f"{name!r} carries no mesh: gear_torque needs a gear")
        return record.gears[disk]

    def mesh(self, a: str, b: str | None = None) -> SteadyContact:
        """:class:`SteadyContact` of a mesh."""
        index, _ = self._mesh(a, b)
        record = self._read()
        if record is not None:
            return record.contacts[index]
        found = cast(Response, self.response).mesh(self.topology.mesh_names[index])
        speeds = [impact["speed"] for impact in found.impacts]
        shares = found.separated_fraction, found.reverse_contact_fraction
        # The response goes over a whole period: its impacts are told for one cycle.
        return SteadyContact(*shares, len(speeds) / max(self.period, 1), max(speeds, default=0.0), found.drive_side)

    def to_xarray(self, *, orders: float | None = None) -> Dataset:
        """The motion as a data set of xarray, as :meth:`SteadySweep.to_xarray`, without the dimension ``rpm``."""
        return to_xarray([self], self.topology, self.rpm, orders=orders)

    def __str__(self):
        what = f"{self.kind}, period {self.period} cycles" if self.kind == "subharmonic" else self.kind
        return f"{self.rpm:g} rpm: {what}" + "".join(f"; {note}" for note in self.notes)


def _sensed(signal, sense):
    return signal if sense > 0 else signal.reversed()


@dataclass(frozen=True)
class SteadySweep:
    """Steady states at several speeds, one after another as a sequence; :attr:`kind` and the like as arrays."""

    states: tuple
    direction: str

    def __repr__(self):
        return states_line(self)

    def _repr_html_(self):
        return states_html(self)

    def __len__(self) -> int:
        return len(self.states)

    def __getitem__(self, index: Any) -> Any:
        return dataclasses.replace(self, states=self.states[index]) if isinstance(index, slice) else self.states[index]

    @property
    def rpm(self) -> np.ndarray:
        """Speeds ``(n,)``."""
        return np.array([state.rpm for state in self.states])

    @property
    def kind(self) -> np.ndarray:
        """Kinds ``(n,)``."""
        return np.array([state.kind for state in self.states])

    @property
    def period(self) -> np.ndarray:
        """Periods in cycles ``(n,)``."""
        return np.array([state.period for state in self.states])

    def to_xarray(self, *, orders: float | None = None) -> Dataset:
        """The sweep as a data set of xarray (extra ``data``), see :meth:`jaxhb.Response.to_xarray`.

        Also ``kind``, ``period`` and ``source`` of every motion: numbers come from its ``harmonics``, from a ``record``
        (extremes over the cycles recorded, no phases and accelerations) or from ``nothing``, and are then nan. Orders
        that a motion of a shorter period does not have are 0.
        """
        return to_xarray(self.states, self.states[0].topology, self.rpm, orders=orders)

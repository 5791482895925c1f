"""Steady states: the motion of a train after it has run long enough, its kind and its
numbers.
"""

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxhb._equal import by_value
from jaxhb._shown import counts, html_table, number, span
from jaxhb.results.contact import Contact
from jaxhb.results.dataset import Dataset, to_xarray
from jaxhb.results.display import table_of_links, table_of_speeds
from jaxhb.results.motion import Motion
from jaxhb.results.record import Record, RecordedSignal, SteadyContact, SteadySignal
from jaxhb.results.response import Response
from jaxhb.results.signal import Signal
from jaxhb.results.status import Status
from jaxhb.train.topology import Topology

KINDS = "contact", "periodic", "subharmonic", "irregular", "unknown"


@by_value
@dataclass(frozen=True)
class SteadyState(Motion[SteadySignal | RecordedSignal, SteadyContact, float]):
    """Motion of a train at one speed after it has run long enough; made by
    :func:`jaxhb.steady_state`.

    Parameters
    ----------
    kind : str
        "contact" : a train with teeth none of which part. "periodic" : period one
        cycle, with teeth that part or without any. "subharmonic" : ``period`` cycles.
        "irregular" : none of these within the cycles marched. "unknown" : ``notes`` say
        why.
    period : int, in cycles of the excitation; 0 for irregular and unknown motion
    response : Response or None
        The harmonic solution over ``period`` cycles, whose orders are multiples of ``1
        / (period x revolutions_per_cycle)``.
    record : Record or None, numbers of the recorded cycles where there is no response
    cycles : int, marched
    notes : tuple of str, what to know about the numbers, and why a kind is unknown
    motion : array ``(2S,)`` or None
        Displacements in m and velocities in m/s of the disks at the end of the march,
        at the beginning of a cycle: where a neighbouring speed starts.
    stability : Stability or None
        Of ``response``, as :func:`jaxhb.stability` gives it; None where contact follows
        from the linear motion and nothing was marched, and where it is not decided:
        ``notes`` then say why.
    started_from : float or None
        Speed in rpm of the motion from which this one was marched, that of a neighbour
        in a sweep or that of ``start``; None from teeth at rest on their drive sides.
    """

    rpm: float
    kind: str
    period: int
    response: Response | None
    record: Record | None
    cycles: int
    notes: tuple[str, ...]
    motion: np.ndarray | None
    topology: Topology
    stability: Any = None
    started_from: float | None = None

    def __repr__(self) -> str:
        kind = (
            f"subharmonic, period {self.period} cycles"
            if self.kind == "subharmonic"
            else self.kind
        )
        outcome = (
            self.response.outcome
            if self.response is not None
            else f"{self.cycles} cycles marched"
        )
        return (
            f"<SteadyState of {self.topology.title} at {number(self.rpm)} rpm: {kind};"
            f" {outcome}>"
        )

    def _repr_html_(self) -> str:
        caption = "; ".join([repr(self)[1:-1], *self.notes])
        return (
            table_of_links(caption, self) if self.known else html_table(caption, [], [])
        )

    @property
    def known(self) -> bool:
        """Whether the kind of motion is known."""
        return self.kind != "unknown"

    @property
    def linear(self) -> bool:
        """Whether it is the only motion of a train that is linear as long as no teeth
        part: they do not.
        """
        apart = (
            self.kind != "contact"
            if self.topology.mesh_names
            else self.kind != "periodic"
        )
        return self.topology.linear_in_contact and not apart

    @property
    def solution(self) -> Response | None:
        """The response; None for recorded cycles, and for a motion that is unknown."""
        return self.response

    def _read(self, quantity: str, index: Any, sense: int = 1) -> Any:
        source = self.record if self.response is None else self.response
        if source is None:
            raise ValueError(
                f"the motion at {self.rpm:g} rpm is unknown: {' '.join(self.notes)}"
            )
        reading = source._read(quantity, index, sense)
        # Period 0 stands for a response that did not converge, which has one cycle.
        cycles = max(self.period, 1)
        if isinstance(reading, Signal):
            return SteadySignal(
                coefficients=reading.coefficients,
                elastic_coefficients=reading.elastic_coefficients,
                revolutions_per_cycle=reading.revolutions_per_cycle,
                resolution=reading.resolution,
                sharp=reading.sharp,
                cycles=cycles,
            )
        if isinstance(reading, Contact):
            # The response covers a whole period: its impacts are counted for one cycle.
            return SteadyContact(
                separated_fraction=reading.separated_fraction,
                reverse_contact_fraction=reading.reverse_contact_fraction,
                impacts_per_cycle=reading.impacts_per_cycle / cycles,
                hardest_impact=reading.hardest_impact,
                drive_side=reading.drive_side,
            )
        return float(reading) if quantity == "power" else reading

    def to_xarray(self, *, orders: float | None = None) -> Dataset:
        """The motion as a data set of xarray: that of :meth:`SteadySweep.to_xarray`
        without the dimension ``rpm``.
        """
        return to_xarray([self], self.topology, self.rpm, orders=orders)

    def __str__(self) -> str:
        kind = (
            f"{self.kind}, period {self.period} cycles"
            if self.kind == "subharmonic"
            else self.kind
        )
        return f"{self.rpm:g} rpm: {kind}" + "".join(f"; {note}" for note in self.notes)


def kind_of_one_cycle(
    topology: Topology, contacts: Iterable[Contact | SteadyContact]
) -> str:
    """Kind of a motion whose period is one cycle: only where there are teeth can they
    be in contact.
    """
    apart = any(contact.separated_fraction > 0 for contact in contacts)
    return "contact" if topology.mesh_names and not apart else "periodic"


def orbit_state(response: Response) -> SteadyState:
    """A periodic solution as the steady state that it would be; "unknown" where the
    equations are not solved.
    """
    status = Status(int(response.status))
    notes: tuple[str, ...] = ()
    if not response.solved:
        kind = "unknown"
        notes = (status.sentence,)
    else:
        kind = kind_of_one_cycle(response.topology, response.contacts().values())
    period = int(kind != "unknown")
    return SteadyState(
        rpm=float(response.rpm),
        kind=kind,
        period=period,
        response=response,
        record=None,
        cycles=0,
        notes=notes,
        motion=None,
        topology=response.topology,
    )


@by_value
@dataclass(frozen=True)
class SteadySweep:
    """Sequence of steady states at several speeds; :attr:`kind` and the like as
    arrays.
    """

    states: tuple[SteadyState, ...]
    direction: str

    def __repr__(self) -> str:
        return (
            f"<SteadySweep {self.direction}, {span(self.rpm, 'rpm')}:"
            f" {counts(self.kind)}>"
        )

    def _repr_html_(self) -> str:
        caption = repr(self)[1:-1]
        head = ["motion", "period"]

        def cells(state: SteadyState) -> tuple[list[Any], bool]:
            return [state.kind, state.period or "-"], state.known

        return table_of_speeds(caption, self, head, cells)

    def __len__(self) -> int:
        return len(self.states)

    def __getitem__(self, index: Any) -> Any:
        return (
            dataclasses.replace(self, states=self.states[index])
            if isinstance(index, slice)
            else self.states[index]
        )

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
        """The sweep as a data set of xarray: that of :meth:`jaxhb.Response.to_xarray`
        with kind, period and source.

        Numbers of a motion come from its ``harmonics``, from a ``record`` (extremes
        over the cycles recorded, no phases and accelerations) or from ``nothing``, and
        are then nan. Orders that a motion does not have are 0.
        """
        return to_xarray(self.states, self.states[0].topology, self.rpm, orders=orders)

"""The answer at one speed, as every report reads it: the motion of the train, and
beside it the motion without backlash.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import jax
import numpy as np

from jaxhb._jax import Array, Number
from jaxhb.equations.backlash import Law
from jaxhb.floquet.stability import Stability
from jaxhb.results.bounds import Certificate
from jaxhb.results.contact import Contact
from jaxhb.results.motion import Motion
from jaxhb.results.record import NO_CONTACT, NO_SIGNAL, SteadyContact
from jaxhb.results.response import Response
from jaxhb.results.status import Status
from jaxhb.results.steady import SteadyState, orbit_state
from jaxhb.train.changes import in_contact
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.mesh_parameters import law_of
from jaxhb.train.varying import at_speed

UNCONFIRMED = "not confirmed by harmonic balance"
"""Words for a motion that returns in time integration and that no harmonic solution
repeats.
"""


def largest(names: Iterable[str], value: Callable[[str], Number]) -> str | None:
    """Find the name with the largest value; None where none is a number."""
    numbers = {name: float(value(name)) for name in names}
    known_names = [name for name in names if not math.isnan(numbers[name])]
    return max(known_names, key=lambda name: numbers[name], default=None)


@dataclass(frozen=True)
class SweepAxis:
    """The quantity that changes along a sweep: the speed in rpm, or a number of the
    scene by its name "NAME.FIELD".
    """

    name: str = "rpm"
    unit: str = "rpm"

    @property
    def label(self) -> str:
        """Title of axes of pictures and of columns."""
        if self == SPEED:
            return "rpm"
        return f"{self.name}, {self.unit}".removesuffix(", ")

    def span(
        self, values: Sequence[float] | Array, word: str = "from", to: str = "to"
    ) -> str:
        """``8 speeds from 700 to 2450 rpm``, or ``5 values of NAME.FIELD from 100 to
        400 N m s/rad``; a single value as by :meth:`said`.
        """
        if len(values) == 1:
            return self.said(f"{values[0]:g}")
        counted = "speeds" if self == SPEED else f"values of {self.name}"
        return (
            f"{len(values)} {counted} {word} {min(values):g} {to} {max(values):g}"
            f" {self.unit}".rstrip()
        )

    def said(self, values: str) -> str:
        """Values as text: ``600, 1200 rpm``, or ``NAME.FIELD = 100, 300 N m s/rad``."""
        text = f"{values} {self.unit}".rstrip()
        return text if self == SPEED else f"{self.name} = {text}"


SPEED = SweepAxis()


@dataclass(frozen=True)
class Answer(Motion):
    """One speed: the steady state of the train, or with ``--orbit`` a periodic
    solution, stable or not; read by name as any motion, nan where nothing is known.

    state : SteadyState, of an orbit the state that it would be if it were stable;
    linear : Response of the linear train with all teeth in contact, which balances the
    mean torques; closed : SteadyState with the gaps of meshes closed and all else
    unchanged, None where that is the linear motion; stability : of the motion, None
    where it is not decided, for the reason ``undecided``; certificate : Certificate, or
    the reason why there is none, or None where none was asked for; axis, value : the
    quantity that a sweep changes, and its value here, None for the speed
    """

    train: DriveTrain
    state: SteadyState
    linear: Response
    orbit: bool = False
    closed: SteadyState | None = None
    stability: Stability | None = None
    undecided: str = ""
    certificate: Certificate | str | None = None
    axis: SweepAxis = SPEED
    value: float | None = None

    topology = property(lambda self: self.train.topology, doc="Topology of the train.")

    def _read(self, quantity: str, index: int | tuple[int, int], sense: int = 1) -> Any:
        # Recorded cycles have no accelerations.
        if self.known and (quantity != "acceleration" or self.response is not None):
            return self.state._read(quantity, index, sense)
        return {"contact": NO_CONTACT, "power": math.nan}.get(quantity, NO_SIGNAL)

    @property
    def stable(self) -> bool | None:
        """Whether disturbances die away; None where that is not decided."""
        return None if self.stability is None else self.stability.stable

    @property
    def multiplier(self) -> float | None:
        """The largest Floquet multiplier in modulus; None where stability is not
        decided.
        """
        return None if self.stability is None else self.stability.largest

    @property
    def unstable(self) -> bool:
        """Whether disturbances grow, as far as is known."""
        return self.stable is False

    @property
    def rpm(self) -> float:
        """Speed of the reference rotor, rpm."""
        return self.state.rpm

    @property
    def known(self) -> bool:
        """Whether the kind of motion is known, so that it has numbers."""
        return self.state.known

    @property
    def recorded(self) -> bool:
        """Whether the motion is known from recorded cycles alone."""
        return self.known and self.response is None

    @property
    def response(self) -> Response | None:
        """The harmonic solution; None where there is none."""
        return self.state.response

    @property
    def balance(self) -> Response:
        """The response whose mean torques are in balance."""
        return self.linear if self.response is None else self.response

    @property
    def cycle_deg(self) -> float:
        """Cycle of the excitation in degrees of the reference rotor."""
        return 360.0 * self.topology.revolutions_per_cycle

    @property
    def place(self) -> float:
        """Value of the quantity that a sweep changes, the speed by default."""
        return self.rpm if self.value is None else self.value

    @property
    def at(self) -> str:
        """The place in words, as ``2000 rpm``."""
        return self.axis.said(f"{self.place:g}")

    @property
    def status(self) -> Status | None:
        """The :class:`jaxhb.Status` of the harmonic solution; None without."""
        return None if self.response is None else Status(int(self.response.status))

    @property
    def harmonics(self) -> int | None:
        """Highest harmonic of the solution over its own period; None without one."""
        return None if self.response is None else int(self.response.highest_harmonic)

    @property
    def converged(self) -> bool | None:
        """Whether the harmonic solution is within its limits; None for a motion that is
        known from recorded cycles.
        """
        if self.response is None:
            return None if self.known else False
        return bool(self.response.converged)

    @property
    def answered(self) -> bool:
        """Whether the kind of motion is known, with numbers of recorded cycles or of a
        solution within its limits.
        """
        return self.known and self.converged is not False

    @property
    def unconfirmed(self) -> bool:
        """Whether no harmonic solution repeats a periodic motion: its numbers are those
        of recorded cycles.
        """
        return self.recorded and self.state.kind != "irregular"

    @property
    def doubt(self) -> str:
        """Why not to rely on numbers that are there, in two words; else ""."""
        if self.unconfirmed:
            return "not confirmed"
        return "not converged" if self.known and not self.answered else ""

    @cached_property
    def without_backlash(self) -> "Answer":
        """The motion with the gaps of meshes closed and all else unchanged, as an
        answer.
        """
        topology = self.topology
        if not (topology.linear_in_contact or any(topology.mesh_backlash)):
            return self  # there is no gap to close
        if self.closed is None:
            linear_train = self.linear.train
            assert linear_train is not None  # which only transformations leave out
            return Answer(
                linear_train, orbit_state(self.linear), self.linear, orbit=True
            )
        train = in_contact(self.train)
        closed = self.closed
        stability = cast("Stability | None", closed.stability)
        return Answer(train, closed, self.linear, self.orbit, closed, stability)

    @cached_property
    def worst_mesh(self) -> str | None:
        """The mesh with the largest tooth force; None where the motion is unknown."""
        return largest(self.topology.mesh_names, lambda name: self.force(name).peak)

    @cached_property
    def contacts(self) -> dict[str, SteadyContact]:
        """:class:`SteadyContact` of every mesh by name."""
        return {name: Motion.mesh(self, name) for name in self.topology.mesh_names}

    def mesh(self, a: str, b: str | None = None) -> SteadyContact:
        """Contact of a mesh, of which all reports read several numbers."""
        place, _ = self._mesh_index(a, b)
        return self.contacts[self.topology.mesh_names[place]]

    @cached_property
    def details(self) -> dict[str, Contact]:
        """:class:`jaxhb.results.contact.Contact` of every mesh, impact by impact; empty
        without a solution.
        """
        return (
            self.response.contacts() if self.known and self.response is not None else {}
        )

    def law(self, mesh: str) -> Law | None:
        """The :class:`Law` of one mesh in floats; None where it has no backlash."""
        index = self.topology.mesh_names.index(mesh)
        if not self.topology.mesh_backlash[index]:
            return None
        law = law_of(at_speed(self.train, self.rpm).meshes)
        return jax.tree.map(lambda values: float(np.asarray(values)[index]), law)


@dataclass(frozen=True)
class Case:
    """A train as it runs, with a misfire, in another design or direction (``title``),
    and its answers over speeds.
    """

    title: str
    answers: list[Answer]

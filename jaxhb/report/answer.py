"""What is told of one speed, as every report reads it: the motion of the train, beside
it that without backlash.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import jax
import numpy as np

from jaxhb.equations.backlash import law_of
from jaxhb.floquet.stability import Stability
from jaxhb.report.selection import largest
from jaxhb.results.motion import Motion
from jaxhb.results.record import NO_CONTACT, NO_SIGNAL
from jaxhb.results.response import Response
from jaxhb.results.status import Status
from jaxhb.results.steady import SteadyState, orbit_state
from jaxhb.train.changes import in_contact
from jaxhb.train.drivetrain import DriveTrain

UNCONFIRMED = "not confirmed by harmonic balance"
"""What is said of a motion that returns in time integration and that no harmonic
solution repeats.
"""


@dataclass(frozen=True)
class Axis:
    """What changes along a sweep: the speed in rpm, or a number of the scene by its
    name "NAME.FIELD".
    """

    name: str = "rpm"
    unit: str = "rpm"

    @property
    def label(self):
        """For axes of pictures and heads of columns."""
        return (
            "rpm" if self == SPEED else f"{self.name}, {self.unit}".removesuffix(", ")
        )

    def span(self, values, word="from", to="to"):
        """``8 speeds from 700 to 2450 rpm``, or ``5 values of NAME.FIELD from 100 to
        400 N m s/rad``; of one itself.
        """
        if len(values) == 1:
            return self.said(f"{values[0]:g}")
        counted = "speeds" if self == SPEED else f"values of {self.name}"
        return (
            f"{len(values)} {counted} {word} {min(values):g} {to} {max(values):g}"
            f" {self.unit}".rstrip()
        )

    def said(self, values):
        """Values as text: ``600, 1200 rpm``, or ``NAME.FIELD = 100, 300 N m s/rad``."""
        told = f"{values} {self.unit}".rstrip()
        return told if self == SPEED else f"{self.name} = {told}"


SPEED = Axis()


@dataclass(frozen=True)
class Answer(Motion):
    """One speed: what the train does there, or with ``--orbit`` a periodic solution,
    stable or not; read by name as any motion, nan where nothing is known.

    state : SteadyState, of an orbit what the train would do if it were stable; linear :
    Response of the linear train with all teeth in contact, which balances the mean
    torques; closed : SteadyState with the gaps of meshes closed and all else as it is,
    None where that is the linear motion; stability : of the motion, None where it is
    not decided, as ``undecided`` says; certificate : Certificate, or why there is none,
    or None: not asked for; axis, value : along which a sweep goes, and where on it the
    answer is, None for the speed
    """

    train: DriveTrain
    state: SteadyState
    linear: Response
    orbit: bool = False
    closed: SteadyState | None = None
    stability: Stability | None = None
    undecided: str = ""
    certificate: object = None
    axis: Axis = SPEED
    value: float | None = None

    def _read(self, quantity, index, sense=1):
        # Recorded cycles have no accelerations.
        if self.known and (quantity != "acceleration" or self.response is not None):
            return self.state._read(quantity, index, sense)
        return {"contact": NO_CONTACT, "power": math.nan}.get(quantity, NO_SIGNAL)

    # What is read of its parts, and where it stands.
    stable = property(
        lambda self: self.stability and self.stability.stable,
        doc="None where that is not decided.",
    )
    multiplier = property(
        lambda self: self.stability and self.stability.largest,
        doc="The largest; None likewise.",
    )
    unstable = property(
        lambda self: self.stable is False,
        doc="Whether disturbances grow, as far as is known.",
    )
    topology = property(lambda self: self.train.topology)
    rpm = property(lambda self: self.state.rpm)
    known = property(
        lambda self: self.state.known,
        doc="Whether the kind of motion is known, so that it has numbers.",
    )
    recorded = property(
        lambda self: self.known and self.response is None,
        doc="Known from recorded cycles alone.",
    )
    response = property(
        lambda self: self.state.response,
        doc="The harmonic solution; None where there is none.",
    )
    balance = property(
        lambda self: self.linear if self.response is None else self.response,
        doc="Of mean torques.",
    )
    cycle_deg = property(
        lambda self: 360.0 * self.topology.revolutions_per_cycle,
        doc="Of the reference rotor, deg.",
    )
    place = property(
        lambda self: self.rpm if self.value is None else self.value,
        doc="Where it stands in a sweep.",
    )
    at = property(
        lambda self: self.axis.said(f"{self.place:g}"), doc="The same in words."
    )

    @property
    def status(self):
        """The :class:`jaxhb.Status` of the harmonic solution; None without."""
        return None if self.response is None else Status(int(self.response.status))

    @property
    def harmonics(self):
        """Highest harmonic of the solution over its own period; None without one."""
        return None if self.response is None else int(self.response.highest_harmonic)

    @property
    def converged(self):
        """Whether the harmonic solution is within its limits; None for a motion that is
        known from recorded cycles.
        """
        if self.response is None:
            return None if self.known else False
        return bool(self.response.converged)

    @property
    def answered(self):
        """Whether the kind of motion is known, with numbers of recorded cycles or of a
        solution within its limits.
        """
        return self.known and self.converged is not False

    @property
    def unconfirmed(self):
        """Whether no harmonic solution repeats a periodic motion: its numbers are those
        of recorded cycles.
        """
        return self.recorded and self.state.kind != "irregular"

    @property
    def doubt(self):
        """What to doubt of numbers that are there, in two words; "" of those to rely
        on.
        """
        if self.unconfirmed:
            return "not confirmed"
        return "not converged" if self.known and not self.answered else ""

    @cached_property
    def without_backlash(self):
        """The motion with the gaps of meshes closed and all else as it is, as an answer
        of its own.
        """
        topology = self.topology
        if not (topology.linear_in_contact or any(topology.mesh_backlash)):
            return self  # there is no gap to close
        if self.closed is None:
            return Answer(
                self.linear.train, orbit_state(self.linear), self.linear, orbit=True
            )
        train = in_contact(self.train)
        closed = self.closed
        return Answer(train, closed, self.linear, self.orbit, closed, closed.stability)

    @cached_property
    def worst_mesh(self):
        """The mesh with the largest tooth force; None where the motion is unknown."""
        return largest(self.topology.mesh_names, lambda name: self.force(name).peak)

    @cached_property
    def contacts(self):
        """:class:`SteadyContact` of every mesh by name."""
        return {name: self.mesh(name) for name in self.topology.mesh_names}

    @cached_property
    def details(self):
        """:class:`jaxhb.results.contact.Contact` of every mesh, impact by impact; empty
        without a solution.
        """
        return (
            self.response.contacts() if self.known and self.response is not None else {}
        )

    def law(self, mesh):
        """The :class:`Law` of one mesh in floats; None where it has no backlash."""
        index = self.topology.mesh_names.index(mesh)
        if not self.topology.mesh_backlash[index]:
            return None
        law = law_of(self.train.meshes)
        return jax.tree.map(lambda values: float(np.asarray(values)[index]), law)


@dataclass(frozen=True)
class Case:
    """A train as it runs, with a misfire, in another design or direction (``title``),
    and its answers over speeds.
    """

    title: str
    answers: list[Answer]

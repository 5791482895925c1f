"""Course of a transient, decided on the host: which events begin when, which cylinders
fire when, and where blocks of steps must end.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxhb._jax import Array, Number, namespace, traced
from jaxhb.elements.events import TORQUES
from jaxhb.elements.sentences import SceneError, shown, suggestion
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.tables import with_table
from jaxhb.train.topology import Topology
from jaxhb.transients.events import Disturbance, Placed, chosen_events, corners
from jaxhb.transients.timeline import SpeedTable


@dataclass(frozen=True)
class Occurrence:
    """An event of a transient, that begins later by ``delay`` s where a sequence begins
    later.
    """

    event: Placed
    delay: float

    @property
    def name(self) -> str:
        """Name of the event."""
        return self.event.seat.name

    @property
    def kind(self) -> str:
        """Kind of the event, as "step"."""
        return self.event.seat.kind


def occurrences(train: DriveTrain, names: Sequence[str]) -> list[Occurrence]:
    """Events of the names of events and of sequences, in this order."""
    if isinstance(names, str):
        names = (names,)
    topology = train.topology
    sequences = train.sequences
    allowed = (*topology.names_of("event"), *sequences)
    unknown = [name for name in names if name not in allowed]
    if unknown:
        raise SceneError(
            [
                f"{topology.title}: there is no event or sequence"
                f" {shown(name)}.{suggestion(name, allowed)}"
                for name in unknown
            ]
        )
    listed = []
    for name in names:
        sequence = sequences.get(name)
        of_name = (name,) if sequence is None else sequence["events"]
        delay = 0.0 if sequence is None else float(sequence["begin"])
        events = chosen_events(topology, of_name)
        listed += [Occurrence(event, delay) for event in events]
    return listed


@dataclass(frozen=True)
class Course:
    """Events ``listed`` by their begins ``(n,)`` s, infinite of those that do not
    begin; and states of the cylinders, ``numbers`` that differ in each from the train:
    the first from 0 s on, each further one from its time among the ``changes`` s.
    """

    listed: list[Occurrence]
    begins: np.ndarray
    numbers: list[dict[str, float]]
    changes: np.ndarray

    def mode(self, begin: np.ndarray) -> np.ndarray:
        """Number of the state of the cylinders of blocks that begin at times ``(B,)``
        s.
        """
        return np.searchsorted(self.changes, begin + 1e-9, side="right")

    def of_kind(self, *kinds: str) -> list[int]:
        """Places of the events of some kinds."""
        return [place for place, row in enumerate(self.listed) if row.kind in kinds]

    @property
    def torque_disks(self) -> np.ndarray:
        """Disks ``(E,)`` of the events that are torques."""
        places = self.of_kind(*TORQUES)
        return np.array([self.listed[k].event.seat.disk for k in places], dtype=int)

    @property
    def torque_begins(self) -> np.ndarray:
        """Begins ``(E,)`` s of the events that are torques."""
        return self.begins[np.array(self.of_kind(*TORQUES), dtype=int)]

    def clutch_links(self, topology: Topology) -> np.ndarray:
        """Links ``(C,)`` of the shafts with clutches."""
        names = [self.listed[k].event.seat.of for k in self.of_kind("clutch")]
        links = [topology.link_names.index(name) for name in names]
        return np.array(links, dtype=int)

    def states(self, train: DriveTrain) -> list[DriveTrain]:
        """The train in each state of its cylinders."""
        return [
            train.replace(numbers) if numbers else train for numbers in self.numbers
        ]

    def idle_states(self, train: DriveTrain) -> list[DriveTrain]:
        """The same without gas torques and torques that drive; none where no event
        changes the fuel.
        """
        if not self.of_kind("fuel"):
            return []
        return [without_fuel(state) for state in self.states(train)]


def course(values: DriveTrain, listed: list[Occurrence], table: SpeedTable) -> Course:
    """The :class:`Course` of a transient at a speed; ``values`` is the train with
    concrete numbers.
    """
    begins = np.array([_begin(values, occurrence, table) for occurrence in listed])
    failures: list[tuple[float, dict[str, float]]] = []
    starts = 0.0
    for occurrence, begin in zip(listed, begins, strict=True):
        seat = occurrence.event.seat
        if seat.kind in ("misfire", "cut_off"):
            number = "injection" if seat.kind == "misfire" else "gas_factor"
            failures.append((float(begin), {f"{seat.of}.{number}": 0.0}))
        if seat.kind == "firing_from":
            starts = max(starts, float(begin))
    times = {0.0, starts, *(time for time, _ in failures)}
    changes = sorted(time for time in times if np.isfinite(time))
    states = []
    for time in changes:
        numbers: dict[str, float] = {}
        for begin, failed in failures:
            if begin <= time:
                numbers |= failed
        if time < starts:
            cylinders = values.topology.cylinder_names
            numbers |= {f"{name}.injection": 0.0 for name in cylinders}
        states.append(numbers)
    return Course(listed, begins, states, np.array(changes[1:]))


def _begin(train: DriveTrain, occurrence: Occurrence, table: SpeedTable) -> float:
    """Time in s at which an event begins; infinite where it does not."""
    numbers: Any = train.events
    index = occurrence.event.index
    seat = occurrence.event.seat
    if seat.kind == "firing_from":
        speed = float(numbers.firing_from[index])
        if table.rpm[0] >= speed:
            return 0.0
        return min(table.times_of_speed(speed), default=np.inf)
    if seat.by_angle:
        angle = np.deg2rad(float(numbers.begin_deg[index]))
        return table.time_of_angle(float(angle)) + occurrence.delay
    return float(numbers.begin[index]) + occurrence.delay


def begin_seconds(train: DriveTrain, course: Course, places: Sequence[int]) -> Array:
    """Begins ``(n,)`` s of occurrences by their places, differentiable by the ``begin``
    of events.
    """
    numbers: Any = train.events
    xp = namespace(numbers)
    begins: list[Number] = []
    for place in places:
        occurrence = course.listed[place]
        index = occurrence.event.index
        if occurrence.event.seat.by_angle or occurrence.kind == "firing_from":
            begins.append(course.begins[place])
        else:
            begins.append(xp.asarray(numbers.begin)[index] + occurrence.delay)
    return xp.stack(begins) if begins else np.zeros(0)


def event_corners(
    train: DriveTrain, course: Course, table: SpeedTable, seconds: float
) -> Iterable[float]:
    """Times in s at which events begin, end or have a kink."""
    for occurrence, begin in zip(course.listed, course.begins, strict=True):
        if not begin < seconds:
            continue
        yield float(begin)
        if occurrence.kind in ("misfire", "cut_off", "firing_from"):
            continue
        bends = corners(train, occurrence.name)
        yield from (begin + bends.seconds).tolist()
        angle = float(table.angle(np.array(begin)))
        for turned in bends.angles:
            time = table.time_of_angle(angle + float(turned))
            if np.isfinite(time):
                yield time


def refuse_clutches(topology: Topology, listed: list[Occurrence]) -> None:
    """Refuse two clutches of one shaft, and one of a shaft whose stiffness is no
    constant.
    """
    shafts = [row.event.seat.of for row in listed if row.kind == "clutch"]
    springs = {topology.link_names[link] for link, *_ in topology.springs}
    over_speed = {
        topology.shaft_names[index]
        for table, _, index, _ in topology.rpm_tables
        if table == "shaft"
    }
    for name in shafts:
        if shafts.count(name) > 1:
            raise SceneError(
                f"{topology.title}: shaft {shown(name)} has two clutches among the"
                " events: name one of them."
            )
        if name in springs | over_speed:
            raise SceneError(
                f"{topology.title}: shaft {shown(name)} has a clutch, and its stiffness"
                " must be constant, without stages, stops, clearance or friction."
            )


def refuse_moving_jumps(train: DriveTrain, listed: list[Occurrence]) -> None:
    """Refuse derivatives by the begin of events whose torque may jump: borders of
    blocks do not move with it.
    """
    numbers = train.events
    if numbers is None or not traced(numbers.begin):
        return
    jumping = [row.name for row in listed if row.kind not in ("ramp", "ice", "fuel")]
    if jumping:
        raise SceneError(
            f"{train.topology.title}: the begin of event {shown(jumping[0])} is"
            " differentiated, and its torque may jump there: only ramps, ice and fuel"
            " have derivatives by their begin."
        )


def without_fuel(train: DriveTrain) -> DriveTrain:
    """The train without gas torques and without torques that drive."""
    topology = train.topology
    if topology.cylinder_names:
        train = train.replace(
            {f"{name}.gas_factor": 0.0 for name in topology.cylinder_names}
        )
    numbers = train.torques
    xp = namespace(numbers)
    driving = xp.asarray(numbers.mean) > 0
    idle = dataclasses.replace(
        numbers,
        mean=xp.where(driving, 0.0, numbers.mean),
        harmonics=xp.where(driving[:, None, None], 0.0, numbers.harmonics),
    )
    if numbers.lines is not None:
        # The frequencies stay.
        unchanged = xp.stack([xp.ones_like(driving), ~driving, ~driving], axis=-1)
        idle = dataclasses.replace(idle, lines=unchanged[:, None] * numbers.lines)
    return with_table(train, "torque", idle)


def disturbance_of(train: DriveTrain, plan: Course) -> Disturbance | None:
    """The :class:`Disturbance` of the events of a course; None of none."""
    places = plan.of_kind(*TORQUES)
    fuels = plan.of_kind("fuel")
    clutches = plan.of_kind("clutch")
    if not (places or fuels or clutches):
        return None
    return Disturbance(
        train=train,
        begins=begin_seconds(train, plan, places),
        start_angles=np.zeros(len(places)),
        fuel_begins=begin_seconds(train, plan, fuels),
        clutch_begins=begin_seconds(train, plan, clutches),
        torques=tuple(plan.listed[place].name for place in places),
        fuels=tuple(plan.listed[place].name for place in fuels),
        clutches=tuple(plan.listed[place].name for place in clutches),
    )

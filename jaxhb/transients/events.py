"""Torques of events as pure functions of time and angle, in NumPy or JAX."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np

from jaxhb._jax import Array, namespace
from jaxhb.elements.event_tables import EventSeat
from jaxhb.elements.sentences import SceneError, shown, suggestion
from jaxhb.train.kinematics import speed_ratios
from jaxhb.train.tables import TrainArrays
from jaxhb.train.topology import Topology
from jaxhb.transients.polylines import polyline_at


@dataclass(frozen=True)
class Placed:
    """An event: its number in the tables of a train, and its seat."""

    index: int
    seat: EventSeat


def chosen_events(topology: Topology, chosen: Sequence[str]) -> list[Placed]:
    """Events by their names, in this order; else :class:`SceneError` with the
    nearest.
    """
    names = topology.names_of("event")
    unknown = [name for name in chosen if name not in names]
    if unknown:
        raise SceneError(
            [
                f"{topology.title}: there is no event"
                f" {shown(name)}.{suggestion(name, names)}"
                for name in unknown
            ]
        )
    indices = [names.index(name) for name in chosen]
    return [Placed(index, topology.events[index]) for index in indices]


def torque_events(topology: Topology, chosen: Sequence[str]) -> tuple[str, ...]:
    """Names of those E of the ``chosen`` events that are torques, in their order."""
    events = chosen_events(topology, chosen)
    return tuple(event.seat.name for event in events if event.seat.is_torque)


def torque_disks(topology: Topology, chosen: Sequence[str]) -> np.ndarray:
    """Disk ``(E,)`` on which each of the :func:`torque_events` acts."""
    names = torque_events(topology, chosen)
    seats = (event.seat for event in chosen_events(topology, names))
    return np.array([seat.disk for seat in seats], dtype=int)


def event_torques(
    train: TrainArrays,
    chosen: Sequence[str],
    seconds: Array,
    angle: Array,
    begin_seconds: Array,
    begin_angle: Array,
) -> Array:
    """Torque ``(n, E)`` N m of the :func:`torque_events` among ``chosen``, positive in
    the sense of the rotor of their disks.

    Parameters
    ----------
    train : DriveTrain
    chosen : names of events; those that are no torques are left out
    seconds, angle : ``(n,)`` s and rad, time and turned angle of the reference rotor
    begin_seconds, begin_angle : ``(E,)`` s and rad, time at which each of the
        :func:`torque_events` begins, and angle at that time; inf of one that does not

    Differentiable by the numbers of the events, time and angle, and those of the
    begins. Of ice the torque is ``-Q``, with the angle phi of its propeller since the
    begin, ``Q = C_q Q_max r(phi) sum_k sin(pi (phi - phi_k) / alpha)`` over the
    passages ``phi_k = k 360 deg / (blades blocks)`` within the last alpha, and r its
    rise and fall.

    Examples
    --------
    >>> from jaxhb import Disk, Event, Ground, build
    >>> train = build(
    ...     [
    ...         Disk(name="rotor", inertia=1.0),
    ...         Event(name="brake", disk="rotor", ramp=(-8.0, 2.0)),
    ...         Ground(disk="rotor", stiffness=1.0),
    ...     ]
    ... )
    >>> times = np.array([0.0, 1.5, 3.0])
    >>> event_torques(train, ["brake"], times, times, np.array([1.0]), np.array([1.0]))[
    ...     :, 0
    ... ].tolist()
    [0.0, -2.0, -8.0]
    """
    events = chosen_events(train.topology, torque_events(train.topology, chosen))
    numbers = train.events
    xp = namespace(numbers, seconds, angle, begin_seconds, begin_angle)
    if numbers is None or not events:
        return xp.zeros((len(seconds), 0))
    since = xp.asarray(seconds)[:, None] - xp.asarray(begin_seconds)
    turned = xp.asarray(angle)[:, None] - xp.asarray(begin_angle)
    groups: dict[str, list[int]] = {}
    for place, event in enumerate(events):
        groups.setdefault(_group(event.seat), []).append(place)
    torques = []
    for group, places in groups.items():
        members = [events[place] for place in places]
        columns = np.array(places)
        if group == "ice":
            torques.append(_ice(train, members, turned[:, columns]))
        else:
            torques.append(_LAWS[group](numbers, members, since[:, columns]))
    order = np.argsort(np.concatenate(list(groups.values())))
    torque = xp.concatenate(torques, axis=-1)[:, order]
    index = np.array([event.index for event in events])
    torque = xp.asarray(numbers.factor)[index] * torque
    ends = np.array([event.seat.ends for event in events])
    if ends.any():
        length = xp.asarray(numbers.end)[index] - xp.asarray(numbers.begin)[index]
        torque = xp.where(ends & (since >= length), 0.0, torque)
    return torque


def _group(seat: EventSeat) -> str:
    """Name the law by which the torque of an event is computed with others."""
    if seat.kind in ("decaying", "ice"):
        return seat.kind
    return "half-sine" if seat.shape == "half-sine" else "polyline"


def _begun(since: Array, torque: Array) -> Array:
    """The torque from its begin on, 0 before."""
    return namespace(since, torque).where(since >= 0.0, torque, 0.0)


def _polylines(numbers: Any, members: Sequence[Placed], since: Array) -> Array:
    """Steps, ramps, trapezoids and tables."""
    xp = namespace(numbers, since)
    lines = [_points(numbers, member) for member in members]
    counts = np.array([len(line) for line in lines])
    rows = [
        xp.concatenate([line, xp.zeros((counts.max() - len(line), 2))])
        for line in lines
    ]
    table = xp.stack(rows)
    elapsed = xp.where(since > 0.0, since, 0.0)
    value = polyline_at(elapsed, table[..., 0], table[..., 1], counts)
    return _begun(since, value)


def _points(numbers: Any, member: Placed) -> Array:
    """Points ``(K, 2)`` (s, N m or factor) of a piecewise linear event."""
    xp = namespace(numbers)
    kind = member.seat.kind
    i = member.index
    if kind == "step":
        return xp.stack([xp.zeros(()), xp.asarray(numbers.step)[i]])[None]
    if kind == "ramp":
        torque, seconds = xp.asarray(numbers.ramp)[i]
        start = xp.zeros(2)
        return xp.stack([start, xp.stack([seconds, torque])])
    if kind == "pulse":
        k = numbers.pulse.seats.index(i)
        torque = xp.asarray(numbers.pulse.torque)[k]
        seconds = xp.asarray(numbers.pulse.seconds)[k]
        rise = xp.minimum(xp.asarray(numbers.pulse.rise)[k], seconds / 2)
        zero = xp.zeros(())
        times = xp.stack([zero, rise, seconds - rise, seconds])
        return xp.stack([times, xp.stack([zero, torque, torque, zero])], axis=-1)
    if kind == "clutch":
        k = numbers.clutch.seats.index(i)
        return xp.asarray(numbers.clutch.capacity)[k, : member.seat.rows]
    return xp.asarray(getattr(numbers, kind))[i, : member.seat.rows]


def _half_sines(numbers: Any, members: Sequence[Placed], since: Array) -> Array:
    """Half-sine pulses."""
    xp = namespace(numbers, since)
    k = np.array([numbers.pulse.seats.index(member.index) for member in members])
    seconds = xp.asarray(numbers.pulse.seconds)[k]
    inside = (since >= 0.0) & (since < seconds)
    elapsed = xp.where(inside, since, 0.0)
    torque = xp.asarray(numbers.pulse.torque)[k]
    return xp.where(inside, torque * xp.sin(np.pi * elapsed / seconds), 0.0)


def _decaying(numbers: Any, members: Sequence[Placed], since: Array) -> Array:
    """Sums of decaying sinusoids."""
    xp = namespace(numbers, since)
    i = np.array([member.index for member in members])
    longest = max(member.seat.rows for member in members)
    terms = xp.asarray(numbers.decaying)[i, :longest]
    counts = np.array([member.seat.rows for member in members])
    counts_here = np.arange(longest) < counts[:, None]
    elapsed = xp.where(since > 0.0, since, 0.0)[..., None]
    phase = 2.0 * np.pi * terms[..., 2] * elapsed + xp.deg2rad(terms[..., 3])
    wave = terms[..., 0] * xp.exp(-elapsed / terms[..., 1]) * xp.sin(phase)
    return _begun(since, xp.where(counts_here, wave, 0.0).sum(axis=-1))


_LAWS = {"polyline": _polylines, "half-sine": _half_sines, "decaying": _decaying}
"""Torques ``(n, m)`` of the members of a group at times ``(n, m)`` since their
begins.
"""


def _ice(train: TrainArrays, members: Sequence[Placed], turned: Array) -> Array:
    """Torque ``(n, m)`` of ice where the reference rotor has turned by so many rad
    since the begins.
    """
    numbers: Any = train.events
    xp = namespace(train, turned)
    ice = numbers.ice
    k = np.array([ice.seats.index(member.index) for member in members])
    disks = np.array([member.seat.disk for member in members])
    rotor = np.array(train.topology.rotor)[disks]
    length = xp.asarray(ice.angle_deg)[k]
    # An event that never begins would have a derivative of nan by the ratio.
    turned = xp.where(turned < 0.0, -1.0, turned)
    angle = xp.rad2deg(turned) * xp.asarray(speed_ratios(train))[rotor]
    inside = (angle >= 0.0) & (angle < length)
    angle = xp.where(inside, angle, 0.0)
    passages = np.array([member.seat.passages for member in members])
    spacing = 360.0 / passages
    # A contact lasts at most a revolution: so many passages before may go on.
    before = np.arange(passages.max())[:, None] * spacing
    after_last = angle - spacing * xp.floor(angle / spacing)
    after = after_last[:, None] + before
    contact = xp.asarray(ice.contact_deg)[k]
    # Rounding of sums of spacings
    is_past = after <= angle[:, None] + 1e-9
    touches = is_past & (after < contact) & (before < 360.0)
    impact = xp.where(touches, xp.sin(np.pi * after / contact), 0.0).sum(axis=1)
    ramp = xp.asarray(ice.ramp_deg)[k]
    has_ramp = ramp > 0.0
    rise = xp.minimum(angle, length - angle) / xp.where(has_ramp, ramp, 1.0)
    rise = xp.where(has_ramp, xp.minimum(rise, 1.0), 1.0)
    size = xp.asarray(ice.torque)[k] * xp.asarray(ice.coefficient)[k]
    return xp.where(inside, -size * rise * impact, 0.0)


def fuel_factor(
    train: TrainArrays, chosen: Sequence[str], seconds: Array, begin_seconds: Array
) -> Array:
    """Factor ``(n,)`` of all gas torques and all torques that drive at ``seconds``
    ``(n,)``: the product over the F fuel events among ``chosen``, 1 before they begin
    at ``begin_seconds`` ``(F,)`` s.
    """
    return _over_time(train, chosen, "fuel", seconds, begin_seconds, 1.0).prod(axis=-1)


def clutch_capacity(
    train: TrainArrays, chosen: Sequence[str], seconds: Array, begin_seconds: Array
) -> Array:
    """Torque ``(n, C)`` N m that the clutches of the C clutch events among ``chosen``
    can carry at ``seconds`` ``(n,)``; inf before they begin at ``begin_seconds``
    ``(C,)`` s.
    """
    return _over_time(train, chosen, "clutch", seconds, begin_seconds, np.inf)


def _over_time(
    train: TrainArrays,
    chosen: Sequence[str],
    kind: str,
    seconds: Array,
    begin_seconds: Array,
    before: float,
) -> Array:
    """Values ``(n, m)`` of the tables over time of the events of a kind among those
    chosen.
    """
    members = [
        event
        for event in chosen_events(train.topology, chosen)
        if event.seat.kind == kind
    ]
    xp = namespace(train.events, seconds, begin_seconds)
    if not members:
        return xp.zeros((len(seconds), 0))
    since = xp.asarray(seconds)[:, None] - xp.asarray(begin_seconds)
    value = _polylines(train.events, members, since)
    return xp.where(since >= 0.0, value, before)


@dataclass(frozen=True)
class Corners:
    """Seconds, and angles in rad of the reference rotor, since the begin of an event at
    which it has a kink or a jump, each increasing.
    """

    seconds: np.ndarray
    angles: np.ndarray


def corners(train: TrainArrays, event: str) -> Corners:
    """Find where an event of a train of the host, by its name, has a kink or jumps.

    >>> from jaxhb import Disk, Event, Ground, build
    >>> parts = [Disk(name="rotor", inertia=1.0), Ground(disk="rotor", stiffness=1.0)]
    >>> parts += [Event(name="brake", disk="rotor", ramp=(-8.0, 2.0))]
    >>> corners(build(parts), "brake").seconds.tolist()
    [0.0, 2.0]
    """
    (member,) = chosen_events(train.topology, [event])
    numbers: Any = train.events
    seat = member.seat
    times = np.zeros(1)
    angles = np.zeros(0)
    if seat.kind == "ice":
        angles = np.fromiter(_ice_corners(train, member), dtype=float)
        times = np.zeros(0)
    elif _group(seat) == "half-sine":
        k = numbers.pulse.seats.index(member.index)
        times = np.array([0.0, float(numbers.pulse.seconds[k])])
    elif seat.kind in (*_LINEAR, "fuel", "clutch"):
        times = np.asarray(_points(numbers, member))[:, 0]
    if seat.ends:
        length = float(numbers.end[member.index] - numbers.begin[member.index])
        times = np.append(times[times < length], length)
    return Corners(np.unique(times), np.unique(angles))


_LINEAR = ("step", "ramp", "pulse", "table")
"""Kinds whose torque is piecewise linear, pulses that are no half-sines among them."""


def _ice_corners(train: TrainArrays, member: Placed) -> Iterator[float]:
    """Angles in rad of the reference rotor at which contacts of ice begin and end, and
    its rise and fall.
    """
    numbers: Any = train.events
    k = numbers.ice.seats.index(member.index)
    length = float(numbers.ice.angle_deg[k])
    ramp = float(numbers.ice.ramp_deg[k])
    contact = float(numbers.ice.contact_deg[k])
    spacing = 360.0 / member.seat.passages
    starts = spacing * np.arange(int(np.ceil(length / spacing)))
    bends = [ramp, length - ramp] if 2.0 * ramp <= length else [length / 2.0]
    angles = np.concatenate([starts, starts + contact, bends, [0.0, length]])
    rotor = train.topology.rotor[member.seat.disk]
    ratio = float(speed_ratios(train)[rotor])
    inside = (angles >= 0.0) & (angles <= length)
    # Contacts that follow each other meet but for rounding.
    yield from np.deg2rad(np.unique(angles[inside].round(9))) / ratio


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Disturbance:
    """Events of a transient: E torques by their names and begins ``(E,)`` s, and fuel
    ``(F,)`` and clutches ``(C,)`` likewise; start_angles ``(E,)`` rad, at which the
    torques begin.
    """

    train: TrainArrays
    begins: Array
    start_angles: Array
    fuel_begins: Array
    clutch_begins: Array
    torques: tuple[str, ...] = field(metadata={"static": True})
    fuels: tuple[str, ...] = field(metadata={"static": True})
    clutches: tuple[str, ...] = field(metadata={"static": True})

    def torque(self, seconds: Array, angle: Array) -> Array:
        """Torques ``(n, E)`` N m on their disks."""
        return event_torques(
            self.train, self.torques, seconds, angle, self.begins, self.start_angles
        )

    def capacity(self, seconds: Array) -> Array:
        """Torques ``(n, C)`` N m that the clutches carry at most."""
        return clutch_capacity(self.train, self.clutches, seconds, self.clutch_begins)

    def fuel(self, seconds: Array) -> Array:
        """Factor ``(n,)`` of gas torques and torques that drive."""
        return fuel_factor(self.train, self.fuels, seconds, self.fuel_begins)

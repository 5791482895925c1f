"""Part of the page with a figure for every element: its torque, or what is judged of
it, over the speed, with its limits, in normal running and the misfire that governs it.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jaxhb.linear.forced import ForcedResponse
from jaxhb.report import quantities
from jaxhb.report.figures.figure import (
    UNCONFIRMED,
    Axis,
    Figure,
    Trace,
    crosses,
    figure,
    line,
    motion_line,
    plain,
    speed_range,
)
from jaxhb.report.figures.speeds import limit_figure
from jaxhb.report.page.parts import Block, Report
from jaxhb.report.text.strength import LIMITED, largest_shares
from jaxhb.results.quantities import VIBRATIONS
from jaxhb.train.chain import span
from jaxhb.train.connections import breadth_first, neighbours
from jaxhb.train.drivetrain import DriveTrain

MOST = 60  # elements that are drawn
# Pixels of a panel, of a figure, and below a panel: two stand side by side
HEIGHT = 100
WIDTH = 334
BELOW = 38
BESIDE = 8
SMALLER = 0.6  # of the size of marks of lines and rings
NAMES = {UNCONFIRMED: "ringed: unconfirmed"}  # short ones, of which two have room
RING = 14  # pixels of marks from which they are rings
INSTEAD = ("stresses", "tooth_torques")
"""Kinds of limits whose figure stands for that of the torque of an element."""


@dataclass(frozen=True)
class Seat:
    """An element and the quantity that is drawn of it, ``called`` in captions."""

    name: str
    quantity: quantities.Quantity
    called: str

    @property
    def signal(self) -> str:
        """Vibration of which the quantity is a number."""
        vibration = self.quantity.entry.vibration
        assert vibration is not None  # torques, forces and angles have one
        return vibration.name


def over_the_speed(report: Report) -> list[Block]:
    """Draw every shaft, damper, mesh and gear and the forward end over the speed."""
    if len(set(report.rpm)) == 1:
        return []
    seats = seats_of(report.train)
    shown = _most(report, seats)
    remark = (
        f"Linear forced response at {len(report.fine_rpm)} speeds."
        if report.is_linear
        else (
            f"At {len(report.rpm)} speeds, with backlash; symbols tell the kind of"
            " motion as in the figure of motions over the speed."
        )
    )
    if len(report.cases) > 2:
        remark += " Of the misfires that which governs the element is drawn."
    if len(shown) < len(seats):
        remark += (
            f" Of {len(seats)} elements the {len(shown)} with the largest shares of"
            " limits, then with the largest numbers, are drawn."
        )
    return [remark, *(each for seat in shown for each in _figures_of(report, seat))]


def seats_of(train: DriveTrain) -> list[Seat]:
    """List what is drawn of a train: shafts and dampers, meshes, gears, and the angle
    of the forward end.
    """
    topology = train.topology
    kinds = [quantities.shaft_torques, quantities.forces, quantities.gear_torques]
    seats = [
        Seat(name, quantity, plain(name))
        for quantity in (kind(train) for kind in kinds)
        for name in quantity.names
    ]
    disk = topology.disk_names[forward_end(train)]
    seats.append(Seat(disk, quantities.angles(train), f"{plain(disk)}, forward end"))
    return seats


def forward_end(train: DriveTrain) -> int:
    """Find the free end of the reference rotor: the disk that is farthest from the
    first load, without loads from the heaviest disk.
    """
    topology = train.topology
    loops = span(topology).loops.tolist()
    joined = neighbours(topology.link_ends, topology.n_disks, loops)
    on_rotor = {
        disk
        for disk in range(topology.n_scene_disks)
        if topology.rotor[disk] == topology.reference_rotor
    }
    inertia = np.asarray(train.disks.inertia)
    start = next(iter(topology.load_disk), max(on_rotor, key=lambda k: inertia[k]))
    # Breadth first: the last one is farthest.
    outward = [disk for disk, _, _ in breadth_first(joined, start)]
    return [disk for disk in outward if disk in on_rotor][-1]


def _most(report: Report, seats: Sequence[Seat]) -> list[Seat]:
    """Choose the elements that are drawn, in the order of the train; all if they are
    not many.
    """
    if len(seats) <= MOST:
        return list(seats)
    shares: dict[str, float] = {}
    for (_, name), share in largest_shares(report.strengths).items():
        shares.setdefault(name, share.share)
    first = next(iter(report.responses.values()))

    def size(seat: Seat) -> tuple[float, float]:
        """Share of a limit, and a number that costs little for many elements."""
        signal = VIBRATIONS[seat.signal].read(first, seat.name)
        return shares.get(seat.name, 0.0), float(np.max(signal.sum_of_amplitudes))

    by_size = sorted(seats, key=size, reverse=True)
    chosen = {*by_size[: MOST - 1], seats[-1]}
    return [seat for seat in seats if seat in chosen]


def _values(report: Report, title: str, seat: Seat) -> np.ndarray:
    """Read the numbers ``(n,)`` of an element over the speeds, in the unit for people,
    nan without an answer.
    """
    if not report.is_linear:
        case = next(case for case in report.cases if case.title == title)
        return seat.quantity.of(case.answers, seat.name)
    response = report.responses[title]
    return seat.quantity.factor * _swing(response, seat)


def _swing(response: ForcedResponse, seat: Seat) -> np.ndarray:
    """Read the quantity of an element of a linear response ``(n,)`` SI."""
    signal = VIBRATIONS[seat.signal].read(response, seat.name)
    values = np.asarray(getattr(signal, seat.quantity.entry.statistic), float)
    return np.where(np.asarray(response.converged), values, np.nan)


def _size(report: Report, title: str, seat: Seat) -> float:
    """The largest number of an element over the speeds, 0 without an answer."""
    values = _values(report, title, seat)
    return float(np.nanmax(values)) if np.isfinite(values).any() else 0.0


def _figures_of(report: Report, seat: Seat) -> Iterator[Figure]:
    """Make the figures of an element: one for every kind of limit, and one of its
    torque where no limit stands for it.
    """
    strengths = report.strengths
    normal = report.cases[0].title
    misfires = {case.title: strengths[case.title] for case in report.cases[1:]}
    governing = largest_shares(misfires)
    of_torque = True
    for key in LIMITED if seat.signal != "angle" else ():
        if seat.signal == "gear_torque" or seat.name not in getattr(
            strengths[normal], key
        ):
            continue
        titles = [normal]
        if (key, seat.name) in governing:
            titles.append(governing[key, seat.name].case)
        elif misfires:
            titles.append(next(iter(misfires)))
        judged = {title: strengths[title] for title in titles}
        made = limit_figure(judged, key, seat.name, report.train)
        of_torque = of_torque and key not in INSTEAD
        yield _small(made, LIMITED[key].called)
    if of_torque:
        yield _small(_torque(report, seat))


def _small(large: Figure, called: str = "") -> Figure:
    """Make a figure small, so that two stand side by side; legends leave out what was
    ``called`` in the caption.
    """
    traces = []
    for trace in large.traces:
        name = trace["name"].removeprefix(f"{called}, ")
        traces.append(trace | {"name": NAMES.get(name, name)})
    # The caption tells the quantity; a long title would be broken.
    units = [
        dataclasses.replace(axis, title=axis.title.rpartition(", ")[2])
        for axis in large.panels
    ]
    return dataclasses.replace(
        large,
        panels=units,
        traces=[_with_small_marks(trace) for trace in traces],
        height=HEIGHT,
        width=WIDTH,
        bottom=BELOW,
        right=BESIDE,
    )


def _with_small_marks(trace: Trace) -> Trace:
    """Make the marks of a line smaller, those of single points stay."""
    marker = trace.get("marker", {})
    if "size" not in marker or trace["mode"] == "markers" and marker["size"] < RING:
        return trace
    return trace | {"marker": marker | {"size": SMALLER * marker["size"]}}


def _torque(report: Report, seat: Seat) -> Figure:
    """Make the figure of the torque, force or angle of an element without a limit."""
    titles = [report.cases[0].title]
    if report.cases[1:]:
        misfires = [case.title for case in report.cases[1:]]
        titles.append(max(misfires, key=lambda title: _size(report, title, seat)))
    quantity = seat.quantity
    called = quantity.small_title
    if quantity.entry.statistic == "half_peak_to_peak":
        called = f"{quantity.called}, half peak-to-peak"
    caption = f"{seat.called}: {called}, {quantity.unit}"
    axis = f"{quantity.called}, {quantity.unit}"
    if not report.is_linear:
        cases = [case for case in report.cases if case.title in titles]
        lines = [
            motion_line(
                case.answers,
                quantity.of(case.answers, seat.name),
                plain(case.title),
                2 * number,
                hollow=number > 0,
            )
            for number, case in enumerate(cases)
        ]
        missing = {
            answer.place
            for case in cases
            for answer in case.answers
            if not answer.answered
        }
        lines += crosses(sorted(missing))
        return figure(caption, Axis("speed, rpm", speed_range(report.rpm)), axis, lines)
    rpm = report.fine_rpm
    traces = [
        line(rpm, _values(report, title, seat), plain(title), number)
        for number, title in enumerate(titles)
    ]
    converged = np.asarray(report.responses[titles[0]].converged)
    traces += crosses(rpm[~converged])
    return figure(caption, Axis("speed, rpm", speed_range(rpm)), axis, traces)

"""The linear forced response over the speed, and with each cylinder misfiring: text,
plain numbers and rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from jaxhb._jax import Array, Number
from jaxhb.elements.sentences import SceneError, suggestion
from jaxhb.linear.cylinders.contributions import Contributions, cylinder_contributions
from jaxhb.linear.forced import ForcedResponse
from jaxhb.linear.heat import span_of
from jaxhb.linear.strength import Strength, strength, train_of
from jaxhb.report.answer import SPEED
from jaxhb.report.orders import order_names
from jaxhb.report.selection import case_title, train_name
from jaxhb.report.table import Column, Table
from jaxhb.report.text.columns import NONE, ratio
from jaxhb.report.text.sentences import firing_lines, misfire_text
from jaxhb.report.text.strength import (
    Limited,
    Share,
    at_same_speed,
    largest_shares,
    strength_columns,
    strength_record,
)
from jaxhb.report.units import shown_unit
from jaxhb.results.answers import left_out, with_gaps
from jaxhb.results.quantities import VIBRATIONS, names_of
from jaxhb.results.response import Response
from jaxhb.results.signal import Signal
from jaxhb.results.status import Status
from jaxhb.solutions.misfires import Misfires, Worst
from jaxhb.train.drivetrain import DriveTrain

SHOWN = 6  # orders in a table or picture, those with the largest amplitudes
# Amplitude of an order over the largest of its element from which it is not listed
NEGLIGIBLE = 1e-12

KINDS = {"disks": "angle", "shafts": "torque", "meshes": "tooth_force"}
"""Vibrating quantities by kind of element; meshes tell most of a train, then shafts,
then disks.
"""

LINES = (
    "Lines at fixed frequencies: synthesis and sum hold their amplitudes, as if all"
    " lines were largest where the orders are; the motion comes as near to that as one"
    " likes where the frequencies have no common period."
)
"""Synthesis of orders and lines, in words."""

TITLES = {
    "disks": "Vibratory angle of disks",
    "shafts": "Vibratory torque of shafts and dampers",
    "meshes": "Vibratory tooth force",
}

ADVICE = {
    Status.MAX_STEPS: (
        "the amplitude of a link was not found: make its table over_amplitude smoother"
        " or add damping"
    )
}
"""Meaning of a status of the linear response where it differs from that of the response
with backlash.
"""


ElementKey = tuple[str, str]
"""Kind, as in ``KINDS``, and name of an element."""

KIND_OF_LIMITED = {"disk": "disks", "mesh": "meshes"}
"""Kinds by the heads of what limits bound; other limits are those of shafts and
dampers.
"""


@dataclass(frozen=True)
class ElementReading:
    """One element of a :class:`jaxhb.ForcedResponse` of several speeds: its signal, the
    unit of that, and the heat.
    """

    response: Response
    name: str
    kind: str

    @property
    def called(self) -> str:
        """The signal in words."""
        return VIBRATIONS[KINDS[self.kind]].called

    @property
    def unit(self) -> str:
        """SI unit of the signal."""
        return VIBRATIONS[KINDS[self.kind]].unit

    @property
    def shown(self) -> tuple[float, str]:
        """Factor from the SI unit, and the unit for people."""
        return shown_unit(self.unit)

    @cached_property
    def signal(self) -> Signal:
        """The signal of the element, ``(n,)`` speeds."""
        return VIBRATIONS[KINDS[self.kind]].read(self.response, self.name)

    @property
    def power(self) -> np.ndarray:
        """Power ``(n,)`` W that the element turns into heat."""
        # The name of a ring is that of its damper, whose row has the heat of the link.
        ring = self.kind == "disks" and self.name in self.response.topology.damper_names
        return (
            np.zeros(len(self.response))
            if ring
            else np.asarray(self.response.power(self.name))
        )

    @property
    def temperature(self) -> Array | None:
        """Temperature ``(n,)`` in deg C at which the element gives off its heat; None
        of those without a balance of heat.
        """
        if self.kind != "shafts" or not isinstance(self.response, ForcedResponse):
            return None
        return self.response.temperature(self.name)

    def most(self) -> tuple[Number, Number]:
        """The largest half peak-to-peak over the speeds that have an answer, and its
        speed; nan without.
        """
        swing = np.where(self.response.converged, self.signal.half_peak_to_peak, np.nan)
        if not np.isfinite(swing).any():
            return np.nan, np.nan
        place = np.nanargmax(swing)
        return swing[place], self.response.rpm[place]

    @property
    def key(self) -> ElementKey:
        """Kind and name, which no other element has: a damper and its ring share their
        name.
        """
        return self.kind, self.name

    @property
    def csv_name(self) -> str:
        """The name in heads of columns, where ring and link of a damper, which share
        theirs, must differ.
        """
        return (
            f"{self.name} angle"
            if self.kind == "disks" and self.name in self.response.topology.damper_names
            else self.name
        )

    def of(self, response: Response) -> ElementReading:
        """The same element of another response."""
        return ElementReading(response, self.name, self.kind)

    def swing(self, response: Response) -> Array:
        """Half peak-to-peak ``(n,)`` of the same element in another response."""
        return self.of(response).signal.half_peak_to_peak

    def at(self, speeds: Array) -> ElementReading:
        """The same at some of the speeds, a mask ``(n,)``."""
        if np.all(speeds):
            return self  # a copy of the response of many disks is large
        return self.of(self.response[np.flatnonzero(speeds)])

    @cached_property
    def largest(self) -> Array:
        """Largest amplitude ``(K,)`` of every order over the speeds that have an
        answer.
        """
        return self.at(self.response.converged).signal.amplitudes.max(
            axis=0, initial=0.0
        )

    def listed(self) -> np.ndarray:
        """Places of the orders that are there, by rising order."""
        largest = self.largest
        return np.flatnonzero(largest > NEGLIGIBLE * largest.max(initial=0.0))

    def main(self) -> np.ndarray:
        """Places of the orders with the largest amplitudes, by rising order."""
        places = self.listed()
        largest = self.largest
        return np.sort(places[np.argsort(-largest[places], kind="stable")[:SHOWN]])


def readings(
    response: ForcedResponse, names: Sequence[str] = ()
) -> list[ElementReading]:
    """An :class:`ElementReading` of each element named (of a damper its link) or of
    all; ``SceneError`` of other names.
    """
    topology = response.topology
    elements = [
        (name, kind)
        for kind, signal in KINDS.items()
        for name in names_of(topology)[VIBRATIONS[signal].element]
    ]
    if names:
        kinds = dict(elements)  # a damper stands there twice, last as a link
        errors = [
            f"{topology.title}: --element: there is no disk, shaft, damper or mesh"
            f" {name!r}.{suggestion(name, kinds)}"
            for name in names
            if name not in kinds
        ]
        if errors:
            raise SceneError(errors)
        elements = [(name, kinds[name]) for name in dict.fromkeys(names)]
    return [ElementReading(response, name, kind) for name, kind in elements]


def forced_text(
    cases: Mapping[str, ForcedResponse],
    chosen: Sequence[ElementReading],
    worst: Mapping[ElementKey, WorstMisfire] | None = None,
    *,
    each: bool,
) -> str:
    """Tables for people: the largest values of every element over the speeds, or
    ``each`` of the ``chosen`` elements speed by speed; of several ``cases``,
    :class:`jaxhb.ForcedResponse` by the cylinder that does not fire, the ``worst``
    misfires.
    """
    response = cases[""]
    converged = np.asarray(response.converged)
    parts = [
        f"{train_name(response.topology)}: linear forced response, teeth in contact,"
        f" {SPEED.span(response.rpm)}",
        *firing_lines(*(train_of(case) for case in cases.values())),
    ]
    if worst:
        return "\n\n".join([*parts, *_misfire_parts(cases, chosen, worst, each)])
    if each:
        parts += [_speed_table(reading, converged) for reading in chosen]
    else:
        parts += worst_tables(response, chosen)
    if not converged.all():
        parts.append(
            f"{np.sum(~converged)} of {len(converged)} speeds have no answer and are"
            " left out."
        )
    if response.lines is not None:
        parts.append(LINES)
    every = (*chosen, *readings(response))
    if not any(np.any(reading.signal.sum_of_amplitudes) for reading in every):
        parts.append(
            "Nothing excites the train. Give it a [[torque]] with harmonics, a"
            " [[cylinder]] or an [engine]."
        )
    return "\n\n".join(parts)


def _speed_table(reading: ElementReading, converged: np.ndarray) -> Table:
    """One element speed by speed; nan where a speed has not converged."""
    signal = reading.signal
    places = reading.main()
    lines = signal.by_line()
    sizes = [
        signal.half_peak_to_peak,
        signal.sum_of_amplitudes,
        *signal.amplitudes[:, places].T,
        *lines.values(),
    ]
    values = [np.where(converged, each, np.nan) for each in (*sizes, reading.power)]
    warmth = []
    if reading.temperature is not None:
        warmth = [Column("deg C", "deg C"), Column("damping N m s/rad", "damping")]
        warmth.append(Column("loss factor", "loss factor"))
        warm = [reading.temperature, *_dampings(reading)]
        values += [np.where(converged, each, np.nan) for each in warm]
    names = order_names(train_of(reading.response))
    orders = [f"order {names.number(order)}" for order in signal.orders[places]]
    orders += [f"{hz:g} Hz" for hz in lines]
    omitted = len(reading.listed()) - len(places)
    note = f"; {omitted} smaller orders are left out" if omitted else ""
    speeds = (f"{speed:g}" for speed in reading.response.rpm)
    return Table(
        f"{reading.name}, {{{reading.unit}}}: synthesis, sum of amplitudes, amplitudes"
        f" by order{note}",
        [
            "rpm",
            *(
                Column(head, "size", unit=reading.unit)
                for head in ("half p-p", "sum", *orders)
            ),
            Column("heat {W}", "W", unit="W"),
            *warmth,
        ],
        zip(speeds, *values, strict=True),
    )


def contributions_of(
    train: DriveTrain, chosen: Sequence[ElementReading]
) -> list[tuple[ElementReading, Contributions]]:
    """Elements, and what each cylinder adds to them at the speed of their largest half
    peak-to-peak; without those that have no answer.
    """
    added = []
    for reading in chosen:
        _, rpm = reading.most()
        if np.isfinite(rpm):
            read = partial(_signal, reading)
            contributions = cylinder_contributions(train, read, rpm=[float(rpm)])
            added.append((reading, contributions))
    return added


def _signal(reading: ElementReading, response: Response) -> Signal:
    """The signal of the same element in another response."""
    return reading.of(response).signal


def contributions_text(reading: ElementReading, added: Contributions) -> Table:
    """Shares of each cylinder in the main orders of an element, as amplitude, and as
    share in the direction of the whole.
    """
    factor, unit = reading.shown
    names = order_names(train_of(reading.response))
    columns: list[Column | str] = ["cylinder"]
    shares = 100 * added.shares()[:, 0]
    rows: list[list[Any]] = [[name] for name in (*added.cylinders, "all that excites")]
    for place in reading.main():
        group = f"order {names.number(added.orders[place])}"
        columns += [
            Column("amplitude", "size", group=group),
            Column("share %", "{:.1f}".format, group=group),
        ]
        amplitudes = factor * np.abs([*added.parts[:, 0, place], added.total[0, place]])
        for row, size, share in zip(
            rows, amplitudes, [*shares[:, place], 100.0], strict=True
        ):
            row += [size, share]
    return Table(
        f"{reading.name} at {added.rpm[0]:g} rpm, {unit}: what each cylinder adds to"
        " its orders, and the share of that in the direction of the whole",
        columns,
        rows,
    )


def contributions_record(
    added: Sequence[tuple[ElementReading, Contributions]],
) -> dict[str, Any]:
    """The part of ``forced --by-cylinder --json``: amplitudes and phases by order, SI
    units.
    """
    record = {}
    for reading, one in added:
        parts = dict(zip(one.cylinders, one.parts[:, 0], strict=True))
        record[reading.csv_name] = {
            "rpm": float(one.rpm[0]),
            "orders": one.orders,
            "cylinders": {name: _polar(part) for name, part in parts.items()},
            "all": _polar(one.total[0]),
        }
    return {"by_cylinder": record} if record else {}


def _polar(values: Array) -> dict[str, Array]:
    """Magnitudes and phases of complex amplitudes."""
    return {"amplitude": np.abs(values), "phase_deg": np.degrees(np.angle(values))}


def _dampings(reading: ElementReading) -> np.ndarray:
    """Damping in N m s/rad and loss factor ``(2, n)`` of a link that gives off its
    heat, at its temperatures.
    """
    train = train_of(reading.response)
    temperatures = reading.temperature
    assert temperatures is not None
    inside = np.clip(temperatures, *span_of(train, reading.name))
    warm = [train.replace({f"{reading.name}.temperature": t}) for t in inside]
    return np.array(
        [
            [float(each.value(f"{reading.name}.{field}")) for each in warm]
            for field in ("damping", "loss_factor")
        ]
    )


def _heat_table(readings: Sequence[ElementReading]) -> list[Table]:
    """The largest temperature over the speeds of each link that gives off its heat, in
    a list; ``readings`` at speeds that have an answer.
    """
    rows = []
    for reading in readings:
        if reading.temperature is None:
            continue
        hottest = int(np.argmax(reading.temperature))
        rows.append(
            [
                reading.name,
                reading.temperature[hottest],
                f"{reading.response.rpm[hottest]:g}",
                reading.power[hottest],
                *_dampings(reading)[:, hottest],
            ]
        )
    columns: list[Column | str] = [
        "shaft",
        Column("deg C", "deg C"),
        "at rpm",
        Column("heat W", "W"),
        Column("damping N m s/rad", "damping"),
        Column("loss factor", "loss factor"),
    ]
    caption = "Balance of heat: largest temperature over the speeds, and there"
    return [Table(caption, columns, rows)] if rows else []


def worst_tables(
    response: ForcedResponse, readings: Sequence[ElementReading]
) -> list[Table]:
    """The largest half peak-to-peak, sum and amplitude of each element over the speeds
    that have an answer, and where they are: a table for each kind of element.
    """
    converged = np.asarray(response.converged)
    names = order_names(train_of(response))
    tables = []
    for of_kind in by_kind(readings) if converged.any() else ():
        heads = [
            Column("half p-p", "size", group="synthesis", unit=of_kind[0].unit),
            Column("at rpm", group="synthesis"),
            Column("sum", "size", group="sum of amplitudes", unit=of_kind[0].unit),
            Column("at rpm", group="sum of amplitudes"),
            Column("order", group="largest order"),
            Column("amplitude", "size", group="largest order", unit=of_kind[0].unit),
            Column("at rpm", group="largest order"),
            Column("heat {W}", "W", unit="W"),
        ]
        rows = []
        for reading in (each.at(converged) for each in of_kind):
            signal = reading.signal
            rpm = reading.response.rpm
            largest = np.unravel_index(
                signal.amplitudes.argmax(), signal.amplitudes.shape
            )
            speed, order = map(int, largest)
            moves = signal.amplitudes[speed, order] > 0
            row: list[Any] = [reading.name]
            for values in (signal.half_peak_to_peak, signal.sum_of_amplitudes):
                row += [
                    values.max(),
                    f"{rpm[values.argmax()]:g}" if values.max() > 0 else NONE,
                ]
            row += [
                names.number(signal.orders[order]) if moves else NONE,
                signal.amplitudes[speed, order],
                f"{rpm[speed]:g}" if moves else NONE,
                reading.power.max(),
            ]
            rows.append(row)
        tables.append(_over_speeds(of_kind, "largest over the speeds", heads, rows))
        if response.lines is not None:
            tables.append(_line_table(of_kind, converged))
    if converged.any():
        tables += _heat_table([reading.at(converged) for reading in readings])
    return tables


def _line_table(readings: Sequence[ElementReading], converged: np.ndarray) -> Table:
    """The largest amplitude of every line over the speeds that have an answer, of
    elements of one kind.
    """
    lines = [reading.at(converged).signal.by_line() for reading in readings]
    rows = [
        [reading.name, *(values.max() for values in of_element.values())]
        for reading, of_element in zip(readings, lines, strict=True)
    ]
    heads = [Column(f"{hz:g} Hz", "size", unit=readings[0].unit) for hz in lines[0]]
    caption = "lines at fixed frequencies, largest amplitude over the speeds"
    return _over_speeds(readings, caption, heads, rows)


def by_kind(readings: Sequence[ElementReading]) -> list[list[ElementReading]]:
    """Readings of disks, of shafts and of meshes, of those that there are."""
    lists = (
        [reading for reading in readings if reading.kind == kind] for kind in KINDS
    )
    return list(filter(None, lists))


def _over_speeds(
    readings: Sequence[ElementReading],
    caption: str,
    columns: Sequence[Column | str],
    rows: Sequence[Sequence[Any]],
) -> Table:
    """A table of elements of one kind."""
    kind = readings[0].kind
    title = f"{TITLES[kind]}, {{{readings[0].unit}}}: {caption}"
    element = VIBRATIONS[KINDS[kind]].element
    return Table(title, [element, *columns], rows)


def forced_record(
    cases: Mapping[str, ForcedResponse],
    readings: Sequence[ElementReading],
    strengths: Mapping[str, Strength],
    worst: Mapping[ElementKey, WorstMisfire] | None = None,
    *,
    orders: float | None = None,
) -> dict[str, Any]:
    """The record of ``forced --json``, see ``docs/how_to/linear.md``; orders up to
    ``orders``, ``strengths`` as of :func:`forced_rows`.
    """
    records = {
        name: _record(response, readings, orders) | strength_record(strengths[name])
        for name, response in cases.items()
    }
    record = records.pop("")
    if worst:
        rows = {reading.csv_name: _worst_record(reading, worst) for reading in readings}
        hardest = rows[hardest_of(readings, worst).csv_name]
        # The name of the element is the key of its row.
        rows = {
            name: {key: row[key] for key in row if key != "of"}
            for name, row in rows.items()
        }
        record |= {
            "misfires": records,
            "worst_misfires": rows,
            "worst_misfire": hardest,
        }
    return record


def _record(
    response: ForcedResponse, readings: Sequence[ElementReading], orders: float | None
) -> dict[str, Any]:
    """The record of one train; orders up to ``orders``."""
    gapped = with_gaps(response)
    gapped_readings = [reading.of(gapped) for reading in readings]
    all_orders = gapped_readings[0].signal.orders if gapped_readings else np.zeros(0)
    listed = np.flatnonzero(all_orders <= (np.inf if orders is None else orders))

    def summary(signal: Signal) -> dict[str, Any]:
        return {
            name: getattr(signal, name)
            for name in ("mean", "half_peak_to_peak", "sum_of_amplitudes")
        }

    def of_element(reading: ElementReading) -> dict[str, Any]:
        signal = reading.signal
        record = summary(signal) | {
            "amplitudes": signal.amplitudes[:, listed],
            "phases_deg": signal.phases_deg[:, listed],
            "power_W": reading.power,
        }
        if reading.temperature is not None:
            record["temperature_deg_C"] = reading.temperature
        if signal.lines is not None:
            record["line_amplitudes"] = list(signal.by_line().values())
        return record | (
            {} if reading.kind == "disks" else {"elastic": summary(signal.elastic)}
        )

    record = {
        "scene": response.topology.name,
        "rpm": response.rpm,
        "status": [Status(int(status)).name for status in response.status],
        "residual": response.residual,
        "load_kW": response.load_kW + 0.0,
        "input_power_W": gapped.input_power,
        "orders": all_orders[listed],
    }
    if response.lines is not None:
        record["lines_hz"] = np.unique(np.asarray(response.lines.hz))
    return record | {
        kind: {
            reading.name: of_element(reading)
            for reading in gapped_readings
            if reading.kind == kind
        }
        for kind in KINDS
    }


def forced_rows(
    cases: Mapping[str, ForcedResponse],
    readings: Sequence[ElementReading],
    strengths: Mapping[str, Strength],
) -> list[dict[str, Any]]:
    """Rows of ``forced --csv`` by heads, one per speed, SI units; of several cases the
    cylinder comes first, the columns of the :class:`jaxhb.Strength` of every case, of
    ``strengths``, last.
    """
    rows = []
    for name, response in cases.items():
        columns = {"misfire": [name] * len(response.rpm)} if len(cases) > 1 else {}
        columns |= _columns(
            response,
            [reading.of(response) for reading in readings],
            strength_columns(strengths[name]),
        )
        rows += [
            dict(zip(columns, row, strict=True))
            for row in zip(*columns.values(), strict=True)
        ]
    return rows


def _columns(
    response: ForcedResponse,
    readings: Sequence[ElementReading],
    strength_columns: Mapping[str, Array],
) -> dict[str, Any]:
    """Columns ``(n,)`` of the rows of one train by heads, None where a speed has not
    converged.
    """
    columns = {"load kW": response.load_kW + 0.0, "input power W": response.input_power}
    for reading in readings:
        name = reading.csv_name
        unit = reading.unit
        signal = reading.signal
        columns[f"{name} half peak-to-peak {unit}"] = signal.half_peak_to_peak
        columns[f"{name} sum of amplitudes {unit}"] = signal.sum_of_amplitudes
        for k in reading.listed():
            head = f"{name} order {signal.orders[k]:g} {unit}"
            columns[head] = signal.amplitudes[:, k]
        for hz, amplitudes in signal.by_line().items():
            columns[f"{name} {hz:g} Hz {unit}"] = amplitudes
        columns[f"{name} heat W"] = reading.power
        if reading.temperature is not None:
            columns[f"{name} temperature deg C"] = reading.temperature
    columns |= strength_columns
    cells: dict[str, Any] = {
        "rpm": response.rpm,
        "status": [Status(int(status)).name for status in response.status],
    }
    for head, values in columns.items():
        cells[head] = [
            value if converged else None
            for value, converged in zip(values, response.converged, strict=True)
        ]
    return cells


def forced_failures(response: ForcedResponse, case: str = "") -> list[str]:
    """A sentence for each status other than converged, with its speeds; ``case`` says
    how the train runs.
    """
    title = f"{response.topology.title}, {case}," if case else response.topology.title
    return left_out(
        response.rpm, response.status, title, answered=response.converged, advice=ADVICE
    )


@dataclass(frozen=True)
class WorstMisfire(Worst):
    """The misfire that governs an element: with the largest share of a limit, else,
    without limits, with the largest half peak-to-peak; the share of the limit then and
    in normal running.
    """

    share: Share | None = None
    firing_share: float | None = None


def worst_of(
    cases: Mapping[str, ForcedResponse],
    readings: Sequence[ElementReading],
    strengths: Mapping[str, Strength],
) -> dict[ElementKey, WorstMisfire]:
    """The :class:`WorstMisfire` of each element, of all its limits; ``strengths`` as of
    :func:`forced_rows`; ``ValueError`` where no speed has an answer.
    """
    misfires = Misfires(
        cases[""], {name: response for name, response in cases.items() if name}
    )
    shares = largest_shares({name: strengths[name] for name in misfires.responses})
    worst = {}
    for reading in readings:
        limited = [
            (key, share)
            for (key, name), share in shares.items()
            if (kind_of(share.kind), name) == reading.key
        ]
        if limited:
            key, share = limited[0]
            value, firing = (
                float(reading.swing(with_gaps(case))[share.place])
                for case in (cases[share.case], cases[""])
            )
            _, firing_share = at_same_speed(share, key, strengths[""])
            worst[reading.key] = WorstMisfire(
                share.case, share.rpm, value, firing, share, firing_share
            )
        else:
            most = misfires.worst(reading.swing)
            worst[reading.key] = WorstMisfire(
                most.cylinder, most.rpm, most.value, most.firing
            )
    return worst


def kind_of(limited: Limited) -> str:
    """The kind of the elements that limits bound."""
    return KIND_OF_LIMITED.get(limited.element, "shafts")


def hardest_of(
    readings: Sequence[ElementReading], worst: Mapping[ElementKey, WorstMisfire]
) -> ElementReading:
    """The element that its worst misfire brings nearest to a limit, or beyond; without
    limits that which swings most, of the meshes, without any of the shafts, else of the
    disks.
    """
    shares = {
        key: misfire.share.share
        for key, misfire in worst.items()
        if misfire.share is not None
    }
    limited = [reading for reading in readings if reading.key in shares]
    if limited:
        return max(limited, key=lambda reading: shares[reading.key])
    return max(by_kind(readings)[-1], key=lambda reading: worst[reading.key].value)


def hardest_misfire(cases: Mapping[str, ForcedResponse]) -> dict[str, Any] | None:
    """The record of the misfire that governs the element nearest to its limit, or
    without limits that swings most; None where no misfire has an answer. ``cases`` as
    of :func:`forced_text`.
    """
    if not any(
        response.converged.any() for cylinder, response in cases.items() if cylinder
    ):
        return None
    every = readings(cases[""])
    strengths = {cylinder: strength(response) for cylinder, response in cases.items()}
    worst = worst_of(cases, every, strengths)
    return _worst_record(hardest_of(every, worst), worst)


def critical_misfire_text(
    cases: Mapping[str, ForcedResponse],
    worst: Mapping[str, Any] | None,
    firing: str,
) -> list[str]:
    """Sentences on the ``worst`` misfire at critical speeds, as of
    :func:`hardest_misfire`, and on the number of speeds of which nothing is known.
    """
    rpm = cases[""].rpm
    answered = np.logical_or.reduce(
        [response.converged for cylinder, response in cases.items() if cylinder]
    )
    sentences = [misfire_text(worst, firing, " half peak-to-peak")] if worst else []
    if not answered.all():
        lost = (
            f"At {np.sum(~answered)} of {len(rpm)} critical speeds nothing damps the"
            " mode and no response is finite"
        )
        sentences.append(
            f"{lost}: modal torques of different modes do not tell which misfire is"
            " worse."
        )
    return sentences


def _misfire_parts(
    cases: Mapping[str, ForcedResponse],
    readings: Sequence[ElementReading],
    worst: Mapping[ElementKey, WorstMisfire],
    each: bool,
) -> Iterator[str]:
    """The worst misfire and every misfire, of the element that swings most or of
    ``each`` element, and the worst misfire of all.
    """
    titles = {
        name: case_title(train_of(response), name) for name, response in cases.items()
    }
    chosen = readings if each else [hardest_of(readings, worst)]
    yield "\n".join(
        misfire_text(_worst_record(reading, worst), titles[""], " half peak-to-peak")
        for reading in chosen
    )
    for reading in chosen:
        firing, _ = reading.most()
        rows = []
        for name, response in cases.items():
            value, rpm = reading.of(response).most()
            rows.append(
                [
                    titles[name],
                    value,
                    f"{rpm:g}" if value > 0 else NONE,
                    (value, firing),
                ]
            )
        yield Table(
            f"{reading.name}, {{{reading.unit}}}: largest half peak-to-peak over the"
            " speeds",
            [
                "",
                Column("half p-p", "size", unit=reading.unit),
                "at rpm",
                Column("ratio", ratio),
            ],
            rows,
        )
    if not each:
        yield from misfire_tables(readings, worst, titles[""])


def misfire_tables(
    readings: Sequence[ElementReading],
    worst: Mapping[ElementKey, WorstMisfire],
    firing: str,
) -> Iterator[Table]:
    """The misfire that governs each element, a table for each kind of element;
    ``firing`` is the title of the train without a misfire.
    """
    for of_kind in by_kind(readings):
        rows: list[list[Any]] = []
        limited = any(worst[reading.key].share for reading in of_kind)
        for reading in of_kind:
            misfire = worst[reading.key]
            largest, _ = reading.most()
            rows.append(
                [
                    reading.name,
                    largest,
                    misfire.value,
                    (misfire.value, largest),
                    f"{misfire.rpm:g}" if misfire.value else NONE,
                    misfire.cylinder if misfire.value else NONE,
                ]
            )
            if limited:
                share = misfire.share
                rows[-1].append(
                    f"{share.share:.2f}, {share.kind.called}" if share else NONE
                )
        by = " (of elements with limits: of the largest share)" * limited
        yield _over_speeds(
            of_kind,
            f"largest half peak-to-peak over the speeds{by}",
            [
                Column(firing, "size", unit=of_kind[0].unit),
                Column("worst misfire", "size", unit=of_kind[0].unit),
                Column("ratio", ratio),
                "at rpm",
                Column("that of", left=True),
                *[Column("share of its limit", left=True)] * limited,
            ],
            rows,
        )


def _worst_record(
    reading: ElementReading, worst: Mapping[ElementKey, WorstMisfire]
) -> dict[str, Any]:
    """The record of the worst misfire of an element."""
    misfire = worst[reading.key]
    record = {
        "cylinder": misfire.cylinder,
        "rpm": misfire.rpm,
        "value": misfire.value,
        "firing": misfire.firing,
        "quantity": reading.called,
        "unit": reading.unit,
        "of": reading.name,
    }
    share = misfire.share
    if share is not None:
        record |= {
            "share": share.share,
            "firing_share": misfire.firing_share,
            "judged": share.kind.called,
            "limit": share.said,
        }
    return record

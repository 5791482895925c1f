"""The linear forced response over the speed, and with each cylinder misfiring: text,
plain numbers and rows.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jaxhb.elements.elements import SceneError, suggestion
from jaxhb.linear.strength import strength
from jaxhb.report.answer import SPEED
from jaxhb.report.orders import order_names
from jaxhb.report.quantities import READERS, shown_unit
from jaxhb.report.selection import case_title, train_name
from jaxhb.report.text.columns import NONE, from_rows, ratio
from jaxhb.report.text.sentences import firing_lines, misfire_text
from jaxhb.report.text.strength import (
    Share,
    at_same_speed,
    largest_shares,
    strength_columns,
    strength_record,
)
from jaxhb.results.answers import left_out, with_gaps
from jaxhb.results.dataset import SIGNALS, names_of
from jaxhb.results.response import Response
from jaxhb.results.status import Status
from jaxhb.solutions.misfires import Misfires, Worst

SHOWN = 6  # orders in a table or picture, those with the largest amplitudes
# Amplitude of an order over the largest of its element from which it is not listed
NEGLIGIBLE = 1e-12

KINDS = {"disks": "angle", "shafts": "torque", "meshes": "tooth_force"}
"""What vibrates, of :data:`jaxhb.results.dataset.SIGNALS`; meshes tell most of a train,
then shafts, then disks.
"""

TITLES = {
    "disks": "Vibratory angle of disks",
    "shafts": "Vibratory torque of shafts and dampers",
}
TITLES |= {"meshes": "Vibratory tooth force"}

ADVICE = {
    Status.MAX_STEPS: (
        "the amplitude of a link was not found: make its table over_amplitude smoother"
        " or add damping"
    )
}
"""What a status of the linear response means where that differs from the response with
backlash.
"""


@dataclass(frozen=True)
class Reading:
    """One element of a :class:`jaxhb.ForcedResponse` of several speeds: what vibrates,
    its unit, and the heat.
    """

    response: Response
    name: str
    kind: str

    called = property(
        lambda self: KINDS[self.kind].replace("_", " "), doc="What vibrates, in words."
    )
    unit = property(
        lambda self: SIGNALS[KINDS[self.kind]][2], doc="SI unit of the signal."
    )
    shown = property(
        lambda self: shown_unit(self.unit),
        doc="Factor from the SI unit, and the unit for people.",
    )

    @cached_property
    def signal(self):
        """What vibrates."""
        return getattr(self.response, READERS[KINDS[self.kind]])(self.name)

    @property
    def power(self):
        """Power ``(n,)`` W that the element turns into heat."""
        # The name of a ring is that of its damper, whose row has the heat of the link.
        ring = self.kind == "disks" and self.name in self.response.topology.damper_names
        return (
            np.zeros(len(self.response))
            if ring
            else np.asarray(self.response.power(self.name))
        )

    def most(self):
        """The largest half peak-to-peak over the speeds that have an answer, and its
        speed; nan without.
        """
        swing = np.where(self.response.converged, self.signal.half_peak_to_peak, np.nan)
        if not np.isfinite(swing).any():
            return np.nan, np.nan
        place = np.nanargmax(swing)
        return swing[place], self.response.rpm[place]

    @property
    def csv_name(self):
        """The name in heads of columns, where ring and link of a damper, which share
        theirs, must differ.
        """
        return (
            f"{self.name} angle"
            if self.kind == "disks" and self.name in self.response.topology.damper_names
            else self.name
        )

    def of(self, response):
        """The same element of another response."""
        return Reading(response, self.name, self.kind)

    def at(self, speeds):
        """The same at some of the speeds, a mask."""
        return self.of(self.response[np.flatnonzero(speeds)])

    @cached_property
    def largest(self):
        """Largest amplitude ``(K,)`` of every order over the speeds that have an
        answer.
        """
        return self.at(self.response.converged).signal.amplitudes.max(
            axis=0, initial=0.0
        )

    def listed(self):
        """Places of the orders that are there, by rising order."""
        largest = self.largest
        return np.flatnonzero(largest > NEGLIGIBLE * largest.max(initial=0.0))

    def main(self):
        """Places of the orders with the largest amplitudes, by rising order."""
        places = self.listed()
        largest = self.largest
        return np.sort(places[np.argsort(-largest[places], kind="stable")[:SHOWN]])


def readings(response, names=()):
    """A :class:`Reading` of each element named (of a damper its link) or of all;
    ``SceneError`` of other names.
    """
    topology = response.topology
    chosen = [
        (name, kind)
        for kind, signal in KINDS.items()
        for name in names_of(topology)[SIGNALS[signal][1]]
    ]
    if names:
        kinds, where = (
            dict(chosen),
            topology.title,
        )  # a damper stands there twice, last as a link
        errors = [
            f"{where}: --element: there is no disk, shaft, damper or mesh"
            f" {name!r}.{suggestion(name, kinds)}"
            for name in names
            if name not in kinds
        ]
        if errors:
            raise SceneError(errors)
        chosen = [(name, kinds[name]) for name in dict.fromkeys(names)]
    return [Reading(response, name, kind) for name, kind in chosen]


def forced_text(cases, found, worst=None, *, each):
    """Tables for people: the largest values of every element over the speeds, or
    ``each`` element speed by speed; of several ``cases``, :class:`jaxhb.ForcedResponse`
    by the cylinder that does not fire, the ``worst`` misfires.
    """
    response = cases[""]
    name = train_name(response.topology)
    rpm = response.rpm
    good = np.asarray(response.converged)
    parts = [f"{name}: linear forced response, teeth in contact, {SPEED.span(rpm)}"]
    parts += firing_lines(*(one.train for one in cases.values()))
    if worst:
        return "\n\n".join([*parts, *_misfire_parts(cases, found, worst, each)])
    parts += (
        [_speed_table(one, good) for one in found]
        if each
        else worst_tables(response, found)
    )
    if not good.all():
        parts.append(
            f"{np.sum(~good)} of {len(good)} speeds have no answer and are left out."
        )
    if not any(np.any(one.signal.amplitudes) for one in (*found, *readings(response))):
        parts.append(
            "Nothing excites the train. Give it a [[torque]] with harmonics, a"
            " [[cylinder]] or an [engine]."
        )
    return "\n\n".join(parts)


def _speed_table(one, good):
    signal = one.signal
    places = one.main()
    (factor, unit) = one.shown
    sizes = [
        signal.half_peak_to_peak,
        signal.sum_of_amplitudes,
        *signal.amplitudes[:, places].T,
    ]
    columns = [
        np.where(good, values, np.nan)
        for values in (*(factor * size for size in sizes), one.power)
    ]
    names = order_names(one.response.train)
    heads = [
        "half p-p",
        "sum",
        *(f"order {names.number(order)}" for order in signal.orders[places]),
    ]
    left_out = len(one.listed()) - len(places)
    note = f"; {left_out} smaller orders are left out" if left_out else ""
    title = (
        f"{one.name}, {unit}: synthesis, sum of amplitudes, amplitudes by order{note}"
    )
    rows = zip((f"{speed:g}" for speed in one.response.rpm), *columns, strict=True)
    return from_rows(
        title, ["rpm", *((head, "size") for head in heads), ("heat W", "W")], list(rows)
    )


def worst_tables(response, found):
    """The largest half peak-to-peak, sum and amplitude of each element over the speeds
    that have an answer, and where they are: a table for each kind of element.
    """
    good = np.asarray(response.converged)
    names = order_names(response.train)
    heads = [
        ("half p-p", "size"),
        "at rpm",
        ("sum", "size"),
        "at rpm",
        "order",
        ("amplitude", "size"),
        "at rpm",
    ]
    groups = [("synthesis", 1, 2), ("sum of amplitudes", 3, 4), ("largest order", 5, 7)]
    tables = []
    for own in by_kind(found) if good.any() else ():
        factor = own[0].shown[0]
        rows = []
        for one in (reading.at(good) for reading in own):
            signal = one.signal
            rpm = one.response.rpm
            speed, order = np.unravel_index(
                signal.amplitudes.argmax(), signal.amplitudes.shape
            )
            moves = signal.amplitudes[speed, order] > 0
            row = [one.name]
            for values in (signal.half_peak_to_peak, signal.sum_of_amplitudes):
                row += [
                    factor * values.max(),
                    f"{rpm[values.argmax()]:g}" if moves else NONE,
                ]
            row += [
                names.number(signal.orders[order]) if moves else NONE,
                factor * signal.amplitudes[speed, order],
            ]
            rows.append([*row, f"{rpm[speed]:g}" if moves else NONE, one.power.max()])
        tables.append(
            _over_speeds(
                own, "largest over the speeds", [*heads, ("heat W", "W")], rows, groups
            )
        )
    return tables


def by_kind(found):
    """Readings of disks, of shafts and of meshes, of those that there are."""
    return list(
        filter(None, ([one for one in found if one.kind == kind] for kind in KINDS))
    )


def _over_speeds(found, what, heads, rows, groups=(), left=()):
    """A table of elements of one kind."""
    kind = found[0].kind
    title = f"{TITLES[kind]}, {found[0].shown[1]}: {what}"
    element = SIGNALS[KINDS[kind]][1]
    return from_rows(title, [element, *heads], rows, groups, left)


def forced_record(cases, found, judged, worst=None, *, orders=None):
    """What ``forced --json`` writes, see ``docs/how_to/linear.md``; orders up to
    ``orders``, ``judged`` as of :func:`forced_rows`.
    """
    records = {
        name: _record(one, found, orders) | strength_record(judged[name])
        for name, one in cases.items()
    }
    record = records.pop("")
    if worst:
        rows = {one.name: _worst_record(one, worst) for one in found}
        hardest = rows[hardest_of(found, worst).name]
        rows = {
            name: {key: row[key] for key in row if key != "of"}
            for name, row in rows.items()
        }  # it is their name
        record |= {
            "misfires": records,
            "worst_misfires": rows,
            "worst_misfire": hardest,
        }
    return record


def _record(response, found, orders):
    """What was found of one train."""
    known = with_gaps(response)
    found = [one.of(known) for one in found]
    listed = found[0].signal.orders if found else np.zeros(0)
    kept = np.flatnonzero(listed <= (np.inf if orders is None else orders))

    def summary(signal):
        return {
            name: getattr(signal, name)
            for name in ("mean", "half_peak_to_peak", "sum_of_amplitudes")
        }

    def of_element(one):
        amplitudes = one.signal.amplitudes[:, kept]
        phases = one.signal.phases_deg[:, kept]
        record = summary(one.signal) | {
            "amplitudes": amplitudes,
            "phases_deg": phases,
            "power_W": one.power,
        }
        return (
            record
            if one.kind == "disks"
            else record | {"elastic": summary(one.signal.elastic)}
        )

    return {
        "scene": response.topology.name,
        "rpm": response.rpm,
        "status": [Status(int(s)).name for s in response.status],
        "residual": response.residual,
        "load_kW": response.load_kW + 0.0,
        "input_power_W": known.input_power,
        "orders": listed[kept],
    } | {
        kind: {one.name: of_element(one) for one in found if one.kind == kind}
        for kind in KINDS
    }


def forced_rows(cases, found, judged):
    """Rows of ``forced --csv`` by heads, one per speed, SI units; of several cases the
    cylinder comes first, what the :class:`jaxhb.Strength` of every case, ``judged``,
    says last.
    """
    rows = []
    for name, response in cases.items():
        own = {"misfire": [name] * len(response.rpm)} if len(cases) > 1 else {}
        own |= _columns(
            response,
            [one.of(response) for one in found],
            strength_columns(judged[name]),
        )
        rows += [
            dict(zip(own, row, strict=True)) for row in zip(*own.values(), strict=True)
        ]
    return rows


def _columns(response, found, more):
    columns = {"load kW": response.load_kW + 0.0, "input power W": response.input_power}
    for one in found:
        name = one.csv_name
        columns[f"{name} half peak-to-peak {one.unit}"] = one.signal.half_peak_to_peak
        columns[f"{name} sum of amplitudes {one.unit}"] = one.signal.sum_of_amplitudes
        for k in one.listed():
            columns[f"{name} order {one.signal.orders[k]:g} {one.unit}"] = (
                one.signal.amplitudes[:, k]
            )
        columns[f"{name} heat W"] = one.power
    told = {
        "rpm": response.rpm,
        "status": [Status(int(s)).name for s in response.status],
    }
    for head, values in (columns | more).items():
        told[head] = [
            value if good else None
            for value, good in zip(values, response.converged, strict=True)
        ]
    return told


def forced_failures(response, case=""):
    """A sentence for each status other than converged, with its speeds; ``case`` says
    how the train runs.
    """
    title = f"{response.topology.title}, {case}," if case else response.topology.title
    return left_out(
        response.rpm, response.status, title, kept=response.converged, advice=ADVICE
    )


@dataclass(frozen=True)
class WorstMisfire(Worst):
    """The misfire that governs an element: with the largest share of a limit, else,
    without limits, with the largest half peak-to-peak; the share of the limit then and
    in normal running.
    """

    share: Share | None = None
    firing_share: float | None = None


def worst_of(cases, found, judged):
    """The :class:`WorstMisfire` of each element; ``judged`` as of :func:`forced_rows`;
    ``ValueError`` without.
    """
    misfires = Misfires(cases[""], {name: one for name, one in cases.items() if name})
    shares = largest_shares({name: judged[name] for name in misfires.responses})
    worst = {}
    for one in found:
        # The ring of a damper has its name, and no limits.
        limited = [
            (key, share)
            for (key, name), share in shares.items()
            if name == one.name and one.kind != "disks"
        ]
        worst[one.name] = (
            _by_share(one, cases, *limited[0], judged)
            if limited
            else _by_swing(one, misfires)
        )
    return worst


def _by_swing(one, misfires):
    return WorstMisfire(
        **vars(misfires.worst(lambda r: one.of(r).signal.half_peak_to_peak))
    )


def _by_share(one, cases, key, share, judged):
    swings = (
        one.of(with_gaps(cases[name])).signal.half_peak_to_peak[share.place]
        for name in (share.case, "")
    )
    value, firing = map(float, swings)
    _, firing_share = at_same_speed(share, key, judged[""])
    return WorstMisfire(share.case, share.rpm, value, firing, share, firing_share)


def hardest_of(found, worst):
    """The element that its worst misfire brings nearest to a limit, or beyond; without
    limits that which swings most, of the meshes, without any of the shafts, else of the
    disks.
    """
    limited = [one for one in found if worst[one.name].share]
    if limited:
        return max(limited, key=lambda one: worst[one.name].share.share)
    return max(by_kind(found)[-1], key=lambda one: worst[one.name].value)


def hardest_misfire(cases):
    """The record of the misfire that governs the element nearest to its limit, or
    without limits that swings most; None where no misfire has an answer. ``cases`` as
    of :func:`forced_text`.
    """
    if not any(
        response.converged.any() for cylinder, response in cases.items() if cylinder
    ):
        return None
    found = readings(cases[""])
    worst = worst_of(
        cases,
        found,
        {cylinder: strength(response) for cylinder, response in cases.items()},
    )
    return _worst_record(hardest_of(found, worst), worst)


def critical_misfire_text(cases, worst, firing):
    """Sentences on the ``worst`` misfire at critical speeds, as of
    :func:`hardest_misfire`: what it is, and of how many speeds nothing is known.
    """
    rpm = cases[""].rpm
    known = np.logical_or.reduce(
        [response.converged for cylinder, response in cases.items() if cylinder]
    )
    sentences = [misfire_text(worst, firing, " half peak-to-peak")] if worst else []
    if not known.all():
        lost = (
            f"At {np.sum(~known)} of {len(rpm)} critical speeds nothing damps the mode"
            " and no response is finite"
        )
        sentences.append(
            f"{lost}: modal torques of different modes do not tell which misfire is"
            " worse."
        )
    return sentences


def _misfire_parts(cases, found, worst, each):
    """The worst misfire and every misfire, of what swings most or of ``each`` element,
    and the worst misfire of all.
    """
    titles = {
        name: case_title(response.train, name) for name, response in cases.items()
    }
    chosen = found if each else [hardest_of(found, worst)]
    yield "\n".join(
        misfire_text(_worst_record(one, worst), titles[""], " half peak-to-peak")
        for one in chosen
    )
    for one in chosen:
        (factor, unit) = one.shown
        (firing, _) = one.most()
        rows = []
        for name, response in cases.items():
            value, rpm = one.of(response).most()
            rows.append(
                [
                    titles[name],
                    factor * value,
                    f"{rpm:g}" if value > 0 else NONE,
                    (value, firing),
                ]
            )
        title = f"{one.name}, {unit}: largest half peak-to-peak over the speeds"
        yield from_rows(
            title, ["", ("half p-p", "size"), "at rpm", ("ratio", ratio)], rows
        )
    yield from () if each else misfire_tables(found, worst, titles[""])


def misfire_tables(found, worst, firing):
    """The misfire that governs each element, a table for each kind of element;
    ``firing`` is what the train is called without.
    """
    for own in by_kind(found):
        factor = own[0].shown[0]
        rows = []
        limited = any(worst[one.name].share for one in own)
        for one in own:
            most = worst[one.name]
            (largest, _) = one.most()
            where = (f"{most.rpm:g}", most.cylinder) if most.value else (NONE, NONE)
            row = [
                one.name,
                factor * largest,
                factor * most.value,
                (most.value, largest),
                *where,
            ]
            share = (
                f"{most.share.share:.2f}, {most.share.kind.called}"
                if most.share
                else NONE
            )
            rows.append(row + [share] * limited)
        heads = [
            (firing, "size"),
            ("worst misfire", "size"),
            ("ratio", ratio),
            "at rpm",
            "that of",
        ]
        by = " (of elements with limits: of the largest share)" * limited
        what = f"largest half peak-to-peak over the speeds{by}"
        yield _over_speeds(
            own, what, heads + ["share of its limit"] * limited, rows, left=(5, 6)
        )


def _worst_record(one, worst):
    most = worst[one.name]
    record = {
        name: getattr(most, name) for name in ("cylinder", "rpm", "value", "firing")
    }
    record |= {"quantity": one.called, "unit": one.unit, "of": one.name}
    if most.share is None:
        return record
    limit = f"{most.share.said} of {most.share.kind.called}"
    return record | {
        "share": most.share.share,
        "firing_share": most.firing_share,
        "limit": limit,
    }

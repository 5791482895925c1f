"""The linear forced response over the speed, and with each cylinder misfiring: text, plain numbers and rows."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from jaxhb.elements.elements import SceneError, suggestion
from jaxhb.report.quantities import shown_unit
from jaxhb.report.selection import case_title, shafts_of, train_name
from jaxhb.report.text.columns import NONE, Table, aligned, alike, ranges, ratios
from jaxhb.results.signal import Signal
from jaxhb.results.status import Status

SHOWN = 6
"""Orders in a table or picture, those with the largest amplitudes."""

NEGLIGIBLE = 1e-12
"""Amplitude of an order over the largest of its element from which it is not listed."""

KINDS = {
    "disks": ("disk", "angle", "Vibratory angle of disks", "rad"),
    "shafts": ("shaft", "torque", "Vibratory torque of shafts and dampers", "N m"),
    "meshes": ("mesh", "tooth force", "Vibratory tooth force", "N"),
}
"""Head of its column, what vibrates, title and SI unit."""


ADVICE = {
    Status.MAX_STEPS: "the amplitude of a link was not found: make its table over_amplitude smoother or add damping"
}
"""What a status of the linear response means where that differs from the response with backlash."""


@dataclass(frozen=True)
class Reading:
    """One element over the speeds: its signal, and power ``(n,)`` W that it turns into heat."""

    name: str
    kind: str
    signal: Signal
    power: np.ndarray

    @property
    def unit(self):
        """SI unit of the signal."""
        return KINDS[self.kind][3]

    @property
    def shown(self):
        """Factor from the SI unit, and the unit for people."""
        return shown_unit(self.unit)

    def listed(self):
        """Places of the orders that are there, by rising order."""
        largest = self.signal.amplitudes.max(axis=0)
        return np.flatnonzero(largest > NEGLIGIBLE * largest.max(initial=0.0))

    def at(self, speeds):
        """The same at some of the speeds."""
        chosen = {"coefficients": self.signal.coefficients[speeds]}
        if self.signal.elastic_coefficients is not None:
            chosen["elastic_coefficients"] = self.signal.elastic_coefficients[speeds]
        return dataclasses.replace(self, signal=dataclasses.replace(self.signal, **chosen), power=self.power[speeds])

    def main(self):
        """Places of the orders with the largest amplitudes, by rising order."""
        largest = self.signal.amplitudes.max(axis=0)
        places = self.listed()
        return np.sort(places[np.argsort(-largest[places], kind="stable")[:SHOWN]])


def readings(response, names=()):
    """A :class:`Reading` of each element named, or of every disk, shaft, damper and mesh.

    Parameters
    ----------
    response : ForcedResponse, of several speeds
    names : sequence of str
        Of a damper its link is read, among the disks its ring.

    Returns
    -------
    list of Reading

    Raises
    ------
    SceneError
        For names of nothing that vibrates.

    Examples
    --------
    >>> import jaxhb
    >>> sweep = jaxhb.forced_response(jaxhb.load_scene("six_cylinder_diesel"), rpm=[1000.0, 1500.0])
    >>> [(r.name, r.kind) for r in readings(sweep, ["pulley", "cyl6|flywheel"])]
    [('pulley', 'disks'), ('cyl6|flywheel', 'shafts')]
    """
    topology = response.topology
    of_kind = {"disks": topology.disk_names, "shafts": shafts_of(topology), "meshes": topology.mesh_names}
    chosen = [(name, kind) for kind, all_of in of_kind.items() for name in all_of]
    if names:
        kinds = dict(chosen)  # a damper stands there twice, last as a link
        check_names(topology, names, kinds)
        chosen = [(name, kinds[name]) for name in dict.fromkeys(names)]
    return [_reading(response, name, kind) for name, kind in chosen]


def check_names(topology, names, known):
    """Refuse names of nothing that vibrates."""
    where = topology.name or "scene"
    errors = [
        f"{where}: --element: there is no disk, shaft, damper or mesh {name!r}.{suggestion(name, known)}"
        for name in names
        if name not in known
    ]
    if errors:
        raise SceneError(errors)


def _reading(response, name, kind):
    topology = response.topology
    if kind == "disks":
        ring = name in topology.damper_names
        # The name of a ring is that of its damper, whose row has the heat of the link.
        power = np.zeros(len(response)) if ring else response.power(name)
        return Reading(name, kind, signal_of(response, name, kind), power)
    return Reading(name, kind, signal_of(response, name, kind), response.power(name))


def signal_of(response, name, kind):
    """The angle of a disk, the torque of a shaft or damper, the force of a mesh."""
    return {"disks": response.disk, "shafts": response.torque, "meshes": response.force}[kind](name)


def forced_text(response, found, *, each):
    """Tables for people: the worst of every element over the speeds, or ``each`` element speed by speed.

    Parameters
    ----------
    response : ForcedResponse
    found : list of Reading
    each : bool

    Returns
    -------
    str
    """
    parts, good = [forced_head(response)], np.asarray(response.converged)
    if each:
        parts += [_speed_table(response.rpm, one, good) for one in found]
    else:
        parts += worst_tables(response, found)
    if not good.all():
        parts.append(f"{np.sum(~good)} of {len(good)} speeds have no answer and are left out.")
    if not _moves(found) and not _moves(readings(response)):
        parts.append("Nothing excites the train. Give it a [[torque]] with harmonics, a [[cylinder]] or an [engine].")
    return "\n\n".join(parts)


def forced_head(response):
    """The scene, what is computed and the speeds, in a line."""
    topology, rpm = response.topology, response.rpm
    speeds = f"{len(rpm)} speeds from {rpm.min():g} to {rpm.max():g}" if len(rpm) > 1 else f"{rpm[0]:g}"
    return f"{train_name(topology)}: linear forced response, teeth in contact, {speeds} rpm"


def _moves(found):
    return any(np.any(one.signal.amplitudes) for one in found)


def _speed_table(rpm, reading, good):
    factor, unit = reading.shown
    signal, places = reading.signal, reading.at(good).main() if good.any() else []
    values = [signal.half_peak_to_peak, signal.sum_of_amplitudes, *signal.amplitudes[:, places].T]
    columns = alike(*(np.where(good, factor * np.asarray(column), np.nan) for column in values))
    heads = ["rpm", "half p-p", "sum", *(f"order {order:g}" for order in signal.orders[places]), "heat W"]
    left_out = len(reading.listed()) - len(places)
    note = f"; {left_out} smaller orders are left out" if left_out else ""
    title = f"{reading.name}, {unit}: synthesis, sum of amplitudes, amplitudes by order{note}"
    rows = [[f"{speed:g}" for speed in rpm], *columns, *alike(np.where(good, reading.power, np.nan))]
    return Table(title, heads, rows)


def worst_tables(response, found):
    """The largest values over the speeds that have an answer, a table for each kind of element."""
    good = np.asarray(response.converged)
    kinds = {kind: [one.at(good) for one in found if one.kind == kind] for kind in KINDS if good.any()}
    return [_worst_table(response.rpm[good], kind, own) for kind, own in kinds.items() if own]


def _worst_table(rpm, kind, found):
    head, _, title, unit = KINDS[kind]
    factor, unit = shown_unit(unit)
    swings = [np.asarray(one.signal.half_peak_to_peak) for one in found]
    sums = [np.asarray(one.signal.sum_of_amplitudes) for one in found]
    peaks = [np.unravel_index(one.signal.amplitudes.argmax(), one.signal.amplitudes.shape) for one in found]
    largest = [one.signal.amplitudes[at] for one, at in zip(found, peaks, strict=True)]
    columns = alike(*(factor * np.array(c) for c in ([v.max() for v in swings], [v.max() for v in sums], largest)))
    moving = [value > 0 for value in largest]

    def where(places):
        return [f"{rpm[i]:g}" if moves else NONE for i, moves in zip(places, moving, strict=True)]

    orders = [f"{one.signal.orders[k]:g}" for one, (_, k) in zip(found, peaks, strict=True)]
    rows = [
        [one.name for one in found],
        columns[0],
        where([v.argmax() for v in swings]),
        columns[1],
        where([v.argmax() for v in sums]),
        [order if moves else NONE for order, moves in zip(orders, moving, strict=True)],
        columns[2],
        where([i for i, _ in peaks]),
        *alike([one.power.max() for one in found]),
    ]
    heads = [head, "half p-p", "at rpm", "sum", "at rpm", "order", "amplitude", "at rpm", "heat W"]
    groups = [("synthesis", 1, 2), ("sum of amplitudes", 3, 4), ("largest order", 5, 7)]
    return Table(f"{title}, {unit}: largest over the speeds", heads, rows, groups)


def forced_record(response, found, *, orders=None):
    """What ``forced --json`` writes: every number in SI units, a list over the speeds.

    Parameters
    ----------
    response : ForcedResponse
    found : list of Reading
    orders : float, optional
        Highest order that is listed.

    Returns
    -------
    dict
        ``scene``; ``rpm``, ``status``, ``residual``, ``load_kW``, ``input_power_W``; ``orders``; ``disks`` (rad),
        ``shafts`` with the dampers (N m) and ``meshes`` (N) by name: ``mean``, ``half_peak_to_peak``,
        ``sum_of_amplitudes``, ``amplitudes`` and ``phases_deg`` (a list of the orders for each speed), ``power_W``;
        of what transmits a torque or force also ``elastic``: the first three of its elastic part.
    """
    listed = found[0].signal.orders if found else np.zeros(0)
    kept = np.flatnonzero(listed <= (np.inf if orders is None else orders))
    record = {
        "scene": response.topology.name,
        "rpm": response.rpm.tolist(),
        "status": [Status(int(s)).name for s in response.status],
        "residual": response.residual.tolist(),
        "load_kW": (response.load_kW + 0.0).tolist(),
        "input_power_W": response.input_power.tolist(),
        "orders": listed[kept].tolist(),
    }
    return record | {kind: {r.name: _signal_record(r, kept) for r in found if r.kind == kind} for kind in KINDS}


def _signal_record(reading, kept):
    signal = reading.signal
    record = _summary(signal) | {
        "amplitudes": signal.amplitudes[:, kept].tolist(),
        "phases_deg": signal.phases_deg[:, kept].tolist(),
        "power_W": np.asarray(reading.power).tolist(),
    }
    return record if reading.kind == "disks" else record | {"elastic": _summary(signal.elastic)}


def _summary(signal):
    return {name: getattr(signal, name).tolist() for name in ("mean", "half_peak_to_peak", "sum_of_amplitudes")}


def forced_rows(response, found, more=None):
    """Heads and rows of ``forced --csv``: one row per speed, SI units; ``more`` columns by their heads come last."""
    columns = {"rpm": response.rpm.tolist(), "status": [Status(int(s)).name for s in response.status]}
    columns |= {"load kW": (response.load_kW + 0.0).tolist(), "input power W": response.input_power.tolist()}
    for one in found:
        # Ring and link of a damper share a name; heads of columns must not.
        name = f"{one.name} angle" if one.kind == "disks" and one.name in response.topology.damper_names else one.name
        columns[f"{name} half peak-to-peak {one.unit}"] = one.signal.half_peak_to_peak.tolist()
        columns[f"{name} sum of amplitudes {one.unit}"] = one.signal.sum_of_amplitudes.tolist()
        for k in one.listed():
            columns[f"{name} order {one.signal.orders[k]:g} {one.unit}"] = one.signal.amplitudes[:, k].tolist()
        columns[f"{name} heat W"] = np.asarray(one.power).tolist()
    columns |= more or {}
    about, good = ("rpm", "status"), np.asarray(response.converged)
    told = {
        head: values if head in about else [v if ok else None for v, ok in zip(values, good, strict=True)]
        for head, values in columns.items()
    }
    return list(told), list(zip(*told.values(), strict=True))


def forced_failures(response, case=""):
    """A sentence for each status other than converged, with its speeds; ``case`` says how the train runs."""
    name, rpm = response.topology.name or "scene", response.rpm.tolist()
    name = f"{name}, {case}," if case else name
    found = []
    for value in sorted(set(response.status.tolist()) - {0}):
        status = Status(value)
        speeds = ranges(rpm, [speed for speed, s in zip(rpm, response.status, strict=True) if s == value])
        found.append(f"{name} at {speeds} rpm: {status.name}: {ADVICE.get(status, status.sentence)}.")
    return found


def worst_of(misfires, found):
    """The misfire and the speed at which each element swings most.

    Parameters
    ----------
    misfires : Misfires, of forced responses
    found : list of Reading, of the response with all cylinders firing

    Returns
    -------
    dict
        :class:`jaxhb.solutions.misfires.Worst` by name, of the half peak-to-peak in SI units.

    Raises
    ------
    ValueError
        If no speed has an answer.
    """
    return {
        one.name: misfires.worst(lambda r, one=one: signal_of(r, one.name, one.kind).half_peak_to_peak) for one in found
    }


def hardest_of(found, worst):
    """The element that swings most under a misfire: of the meshes, without any of the shafts, else of the disks."""
    kinds = [one.kind for one in found]
    kind = next(kind for kind in ("meshes", "shafts", "disks") if kind in kinds)
    return max((one for one in found if one.kind == kind), key=lambda one: worst[one.name].value)


def misfires_text(misfires, found, worst, *, each):
    """The worst misfire, the largest swing of an element with every misfire, and the worst misfire of every element.

    Parameters
    ----------
    misfires : Misfires
    found : list of Reading, with all cylinders firing
    worst : dict, from :func:`worst_of`
    each : bool
        Whether the elements of ``found`` were asked for by name: then every misfire is listed for each of them.

    Returns
    -------
    str
    """
    chosen, title = found if each else [hardest_of(found, worst)], case_title(misfires.firing.train)
    parts = ["\n".join(_sentence(one, worst[one.name], title) for one in chosen)]
    parts += [_cylinder_table(misfires, one) for one in chosen]
    if not each:
        kinds = {kind: [one for one in found if one.kind == kind] for kind in KINDS}
        parts += [_element_table(misfires, kind, own, worst) for kind, own in kinds.items() if own]
    return "\n\n".join(parts)


def _sentence(element, worst, title):
    factor, unit = element.shown
    value, firing = (f"{factor * number:.4g} {unit}" for number in (worst.value, worst.firing))
    return (
        f"The worst misfire is that of {worst.cylinder}: {KINDS[element.kind][1]} of {value} half peak-to-peak in"
        f" {element.name} at {worst.rpm:g} rpm, {firing} with {title}."
    )


def _cylinder_table(misfires, element):
    factor, unit = element.shown
    train, responses = misfires.firing.train, {"": misfires.firing} | misfires.responses
    values, speeds = zip(*(_largest(response, element) for response in responses.values()), strict=True)
    values = [factor * value for value in values]
    speeds = [f"{rpm:g}" if value > 0 else NONE for value, rpm in zip(values, speeds, strict=True)]
    titles, ratio = [case_title(train, name) for name in responses], ratios(values, values[:1] * len(values))
    title = f"{element.name}, {unit}: largest half peak-to-peak over the speeds"
    return title + "\n" + aligned(["", "half p-p", "at rpm", "ratio"], [titles, *alike(values), speeds, ratio])


def _largest(response, element):
    """The largest half peak-to-peak of an element over the speeds that have an answer, and its speed; nan without."""
    swing = signal_of(response, element.name, element.kind).half_peak_to_peak
    answered = np.flatnonzero(response.converged)
    if not len(answered):
        return np.nan, np.nan
    place = answered[np.argmax(swing[answered])]
    return swing[place], response.rpm[place]


def _element_table(misfires, kind, found, worst):
    head, _, title, unit = KINDS[kind]
    factor, unit = shown_unit(unit)
    own = [worst[one.name] for one in found]
    largest = [factor * _largest(misfires.firing, one)[0] for one in found]
    values = [factor * one.value for one in own]
    columns = [
        [one.name for one in found],
        *alike(largest, values),
        ratios(values, largest),
        [f"{one.rpm:g}" if one.value else NONE for one in own],
        [one.cylinder if one.value else NONE for one in own],
    ]
    heads = [head, case_title(misfires.firing.train), "worst misfire", "ratio", "at rpm", "that of"]
    return f"{title}, {unit}: largest half peak-to-peak over the speeds\n" + aligned(heads, columns, left=(5,))


def misfires_record(misfires, found, worst, *, orders=None):
    """What ``forced --misfire each --json`` writes beside normal running.

    Parameters
    ----------
    misfires : Misfires
    found : list of Reading, with all cylinders firing
    worst : dict, from :func:`worst_of`
    orders : float, optional
        Highest order that is listed.

    Returns
    -------
    dict
        ``misfires``: by the cylinder that does not fire what :func:`jaxhb.report.text.forced.forced_record` gives;
        ``worst_misfires`` by element ``cylinder``, ``rpm``, ``quantity``, ``unit``, ``value`` (half peak-to-peak) and
        ``firing``, the value at this speed with all cylinders firing; ``worst_misfire``, that of the element that
        swings most, with its name as ``of``.
    """
    rows = {
        one.name: {
            "cylinder": worst[one.name].cylinder,
            "rpm": worst[one.name].rpm,
            "quantity": KINDS[one.kind][1],
            "unit": one.unit,
            "value": worst[one.name].value,
            "firing": worst[one.name].firing,
        }
        for one in found
    }
    hardest, names = hardest_of(found, worst).name, [one.name for one in found]
    records = {
        cylinder: forced_record(response, readings(response, names), orders=orders)
        for cylinder, response in misfires.responses.items()
    }
    return {"misfires": records, "worst_misfires": rows, "worst_misfire": rows[hardest] | {"of": hardest}}


def misfires_rows(misfires, found, more):
    """Heads and rows of the CSV file: those of normal running, then those of every misfire, named in the first column.

    ``more`` holds further columns of every response, by the cylinder that does not fire, "" for none.
    """
    responses = {"": misfires.firing} | misfires.responses
    names, heads, rows = [one.name for one in found], {}, []
    for cylinder, response in responses.items():
        own, cells = forced_rows(response, readings(response, names), more[cylinder])
        rows += [{"misfire": cylinder} | dict(zip(own, row, strict=True)) for row in cells]
        heads |= dict.fromkeys(["misfire", *own])
    # An order that a response does not have has no column there: its amplitude is 0.
    return list(heads), [[row.get(head, 0.0) for head in heads] for row in rows]

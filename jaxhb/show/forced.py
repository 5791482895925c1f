"""The linear forced response over the speed as text, as plain numbers and as rows: disks, shafts, dampers, meshes."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from ..model.elements import SceneError, suggestion
from ..response.signal import Signal
from ..response.status import Status
from .choose import shafts_of, train_name
from .columns import NONE, Table, alike, ranges

SHOWN = 6
"""Orders in a table or picture, those with the largest amplitudes."""

NEGLIGIBLE = 1e-12
"""Amplitude of an order over the largest of its element from which it is not listed."""

KINDS = {
    "disks": ("disk", "Vibratory angle of disks, deg", "rad", "deg", 180 / np.pi),
    "shafts": ("shaft", "Vibratory torque of shafts and dampers, N m", "N m", "N m", 1.0),
    "meshes": ("mesh", "Vibratory tooth force, kN", "N", "kN", 1e-3),
}
"""Head of its column, title, SI unit, unit for people and the factor between them."""


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
        return KINDS[self.kind][2]

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
    _, _, _, unit, factor = KINDS[reading.kind]
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
    head, title, _, _, factor = KINDS[kind]
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
    return Table(f"{title}: largest over the speeds", heads, rows, groups)


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

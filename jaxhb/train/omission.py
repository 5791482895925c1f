"""Parts that a train is without: elements that are left out, as with a clutch open,
with everything that they carry and everything that no link joins to the reference disk
any more; and the gas torques of cylinders that do not fire.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb._jax import Array, traced
from jaxhb.elements.derived import LINKS, link_number
from jaxhb.elements.excitations import EXCITATIONS
from jaxhb.elements.sentences import SceneError, shown, suggestion
from jaxhb.excitation.tables import COMPUTED, TANGENTIAL
from jaxhb.train import connections
from jaxhb.train.tables import with_table

if TYPE_CHECKING:
    from jaxhb.elements.event_tables import EventSeat
    from jaxhb.train.tables import Train, TrainArrays
    from jaxhb.train.topology import Topology


def without(train: Train, names: Sequence[str]) -> Train:
    """Leave elements out; see :meth:`DriveTrain.without`."""
    topology = train.topology
    title = train.topology.title
    elements = topology.elements
    reference = topology.disk_names[topology.reference_disk]
    unknown = [name for name in names if name not in elements]
    if unknown:
        sentences = (
            f"{title}, without: there is no element"
            f" {shown(name)}.{suggestion(name, elements)}"
            for name in unknown
        )
        raise SceneError(list(sentences))
    if reference in names:
        raise SceneError(
            f"{title}, without: {reference!r} is the reference disk, to which the speed"
            " belongs. Make a disk that stays the reference."
        )
    keep, disks = _remaining(topology, {elements[name] for name in names})
    changed = dataclasses.replace(train, topology=_topology(topology, keep, disks))
    for table, rows in keep.items():
        numbers = train.table(table)
        if numbers is not None:
            left = None if table in _MAY_LACK and not rows else _rows(numbers, rows)
            changed = with_table(changed, table, left)
    errors = connections.train_errors(changed)
    if errors:
        raise SceneError(errors)
    return changed


# Tables of a train that are None where it has no such element
_MAY_LACK = ("phase", "event")


def _remaining(
    topology: Topology, out: Collection[tuple[str, int]]
) -> tuple[dict[str, list[int]], list[int]]:
    """Numbers of the remaining elements by table, and of the disks, where (table,
    number) are left ``out``.
    """
    n_scene_disks = topology.n_scene_disks
    links = [
        (table, index)
        for table in LINKS
        for index in range(len(topology.names_of(table)))
    ]
    closed_ends = [
        ends
        for link, ends in zip(links, topology.link_ends, strict=True)
        if link not in out
    ]
    lost_disks = {index for table, index in out if table == "disk"} | {
        n_scene_disks + index for table, index in out if table == "damper"
    }
    # A disk that is left out joins nothing: what hung on it alone goes with it.
    piece = connections.pieces(
        topology.n_disks,
        [ends for ends in closed_ends if not lost_disks.intersection(ends)],
    )
    disks = [
        disk
        for disk, number in enumerate(piece)
        if number == piece[topology.reference_disk]
    ]
    keep = {"disk": [disk for disk in disks if disk < n_scene_disks]}
    remaining_disks = set(disks)
    seats: dict[tuple[str, int], tuple[int, ...]] = dict(
        zip(links, topology.link_ends, strict=True)
    )
    seated = {"ground": topology.ground_disk, "load": topology.load_disk}
    seated |= {table: topology.seats_of(table).disk for table in EXCITATIONS}
    for table, disks_of in seated.items():
        seats |= {(table, index): (disk,) for index, disk in enumerate(disks_of)}
    for table in (*LINKS, *seated):
        joined = [
            index
            for (kind, index), disks_below in seats.items()
            if kind == table and remaining_disks.issuperset(disks_below)
        ]
        keep[table] = [index for index in joined if (table, index) not in out]
    phase_stays = [
        any(
            not set(keep[table]).isdisjoint(members)
            for table, members in zip(EXCITATIONS, members_of, strict=True)
        )
        for members_of in topology.phase_members
    ]
    keep["phase"] = [
        index
        for index, stays in enumerate(phase_stays)
        if stays and ("phase", index) not in out
    ]
    changeable = {
        topology.names_of(table)[index]
        for table in ("cylinder", "shaft")
        for index in keep[table]
    }
    keep["event"] = [
        index
        for index, event in enumerate(topology.events)
        if ("event", index) not in out
        and (event.disk < 0 or event.disk in remaining_disks)
        and (not event.of or event.of in changeable)
    ]
    return keep, disks


def _rows(table: Any, keep: Sequence[int]) -> Any:
    """A table with the rows to keep; of a table inside it those that belong to them."""
    columns = {}
    for field in dataclasses.fields(table):
        values = getattr(table, field.name)
        if dataclasses.is_dataclass(values):
            inner: Any = values
            rows = [k for k, seat in enumerate(inner.seats) if seat in keep]
            seats = tuple(keep.index(inner.seats[k]) for k in rows)
            values = (
                dataclasses.replace(_rows(values, rows), seats=seats) if rows else None
            )
        elif isinstance(values, tuple):
            values = tuple(values[i] for i in keep)
        elif values is not None:
            values = values[keep]
        columns[field.name] = values
    return type(table)(**columns)


def _topology(
    topology: Topology, keep: Mapping[str, Sequence[int]], disks: Sequence[int]
) -> Topology:
    """The topology of the remaining elements, numbered anew."""
    place = {disk: k for k, disk in enumerate(disks)}
    links = [
        link_number(topology, table, index) for table in LINKS for index in keep[table]
    ]
    number = {link: k for k, link in enumerate(links)}
    keys = topology.link_keys
    fields: dict[str, Any] = {}
    for field in dataclasses.fields(topology):
        table, _, suffix = field.name.partition("_")
        if table not in keep or field.name in ("disk_names", "disk_keys"):
            continue
        rows: list[Any] = [
            getattr(topology, field.name)[index] for index in keep[table]
        ]
        if suffix == "disk":
            rows = [place[disk] for disk in rows]
        elif suffix == "ends":
            rows = [(place[a], place[b]) for a, b in rows]
        elif suffix == "members":  # of a phase
            rows = [
                tuple(
                    tuple(
                        keep[kind].index(index) for index in row if index in keep[kind]
                    )
                    for kind, row in zip(EXCITATIONS, members, strict=True)
                )
                for members in rows
            ]
        fields[field.name] = tuple(rows)
    limited = topology.disk_keys
    disk_keys = tuple(limited[disk] for disk in keep["disk"] if limited)
    fields["excitations"] = tuple(
        topology.seats_of(table).only(keep[table], place) for table in EXCITATIONS
    )
    fields["events"] = tuple(
        dataclasses.replace(event, disk=place.get(event.disk, -1))
        for event in (topology.events[index] for index in keep["event"])
    )
    fields["sequences"] = _sequences(topology, fields["events"])
    varying = {
        name: getattr(topology, name)
        for name in ("hz_links", "amplitude_links", "order_links")
    }
    fields |= {
        name: tuple(number[link] for link in varying_links if link in number)
        for name, varying_links in varying.items()
    }
    fields["archer_loads"] = tuple(
        keep["load"].index(load)
        for load in topology.archer_loads
        if load in keep["load"]
    )
    fields["rpm_tables"] = tuple(
        (table, field, keep[table].index(index), rows)
        for table, field, index, rows in topology.rpm_tables
        if index in keep[table]
    )
    elastic = [
        *fields["shaft_ends"],
        *(
            (disk, len(keep["disk"]) + k)
            for k, disk in enumerate(fields["damper_disk"])
        ),
    ]
    # Speeds follow from the radii of the train: here they are not looked at.
    radii: list[float] = [float("nan")] * len(disks)
    reference = place[topology.reference_disk]
    gearing = connections.Gearing(
        len(disks), elastic, fields["mesh_ends"], fields["mesh_internal"], radii
    )
    rotors = gearing.rotors(gearing.lead(reference))
    return dataclasses.replace(
        topology,
        **fields,
        disk_names=tuple(topology.disk_names[disk] for disk in disks),
        n_scene_disks=len(keep["disk"]),
        teeth=tuple(topology.teeth[disk] for disk in keep["disk"]),
        rotor=rotors.rotor,
        n_rotors=len(rotors.ratio),
        reference_disk=reference,
        reference_rotor=rotors.rotor[reference],
        rotor_path=rotors.path,
        springs=tuple(
            (number[link], kind, row)
            for link, kind, row in topology.springs
            if link in number
        ),
        link_keys=(
            tuple(keys[link] for link in links)
            if any(keys[link] for link in links if keys)
            else ()
        ),
        disk_keys=disk_keys if any(disk_keys) else (),
    )


def _sequences(topology: Topology, events: Sequence[EventSeat]) -> str:
    """The sequences of a topology with the remaining events, of those with any."""
    names = {event.name for event in events}
    sequences = {
        name: sequence | {"events": [e for e in sequence["events"] if e in names]}
        for name, sequence in json.loads(topology.sequences).items()
    }
    return json.dumps({name: row for name, row in sequences.items() if row["events"]})


COMPRESSING = "no injection, compression stays"
CUT_OFF = "cut off, no gas torque at all"
NO_COMPRESSION = (
    "no gas torque at all, as compression is unknown for a given gas_torque"
)
NOTHING = "no gas torque, the scene gives none"
"""Words for what is computed of a cylinder that does not fire."""


NAMED = 6  # cylinders in a sentence; of more the first and the last


def not_firing(*trains: TrainArrays) -> list[str]:
    """Say what is computed of cylinders without injection or gas torque, in any of some
    trains; see :meth:`DriveTrain.not_firing`.
    """
    alike: dict[str, dict[str, None]] = {}
    for train in trains:
        for number, name in enumerate(train.topology.cylinder_names):
            state = _computed(train, number)
            if state:
                alike.setdefault(state, {})[name] = None
    return [f"{_names_text(list(names))}: {state}" for state, names in alike.items()]


def _names_text(names: Sequence[str]) -> str:
    """Names in a sentence; of many the first and the last."""
    return (
        ", ".join(names)
        if len(names) <= NAMED
        else f"{names[0]}, … {names[-1]} ({len(names)} cylinders)"
    )


def silent_cylinders(train: TrainArrays) -> tuple[str, ...]:
    """Names of the cylinders without injection or without gas torque."""
    names = train.topology.cylinder_names
    return tuple(name for i, name in enumerate(names) if _computed(train, i))


def is_cut_off(train: TrainArrays, cylinder: str) -> bool:
    """Tell whether a cylinder has no gas torque at all, whatever it is made of."""
    number = train.topology.cylinder_names.index(cylinder)
    return _computed(train, number) == CUT_OFF


def _computed(train: TrainArrays, number: int) -> str:
    """Words for what is computed of one cylinder, "" of one that fires."""
    cycles = train.topology.cylinders
    if cycles.cut_off[number] or _is_zero(train.cylinders.gas_factor, number):
        return CUT_OFF
    if cycles.fires[number] and not _is_zero(train.cylinders.injection, number):
        return ""
    if cycles.source[number] in (*COMPUTED, TANGENTIAL):
        return COMPRESSING
    return NO_COMPRESSION if cycles.source[number] == "harmonics" else NOTHING


def check_compressions(train: TrainArrays, cylinders: Sequence[str]) -> None:
    """Refuse cylinders whose torque without injection nothing tells."""
    seats = train.topology.cylinders
    kind = EXCITATIONS["cylinder"]
    texts = {
        name: kind.without_effect(
            train.cylinders, seats, "injection", seats.names.index(name)
        )
        for name in cylinders
    }
    errors = [
        f"{train.topology.title}, misfire of {name!r}: {text}"
        for name, text in texts.items()
        if text
    ]
    if errors:
        raise SceneError(errors)


def _is_zero(values: Array | None, number: int) -> bool:
    """Whether a number of an element is there, not traced, and 0."""
    return (
        values is not None
        and not traced(values)
        and float(np.asarray(values)[number]) == 0.0
    )

"""A train without some of its elements, as with a clutch open: what they carried, and
what no link joins to the reference disk any more, goes with them.
"""

import dataclasses

from jaxhb.elements.derived import LINKS, link_number
from jaxhb.elements.elements import SceneError, shown, suggestion
from jaxhb.train import connections
from jaxhb.train.changes import TABLE_OF

SEATED = "ground", "load", "torque", "cylinder"  # tables of what sits on one disk


def without(train, names):
    """See :meth:`DriveTrain.without`."""
    topology = train.topology
    title = train.topology.title
    elements = topology.elements
    reference = topology.disk_names[topology.reference_disk]
    unknown = [name for name in names if name not in elements]
    if unknown:
        near = (
            f"{title}, without: there is no element"
            f" {shown(n)}.{suggestion(n, elements)}"
            for n in unknown
        )
        raise SceneError(list(near))
    if reference in names:
        raise SceneError(
            f"{title}, without: {reference!r} is the reference disk, to which the speed"
            " belongs. Make a disk that stays the reference."
        )
    keep, disks = _kept(topology, {elements[name] for name in names})
    given = {table: (own, getattr(train, own)) for table, own in TABLE_OF.items()}
    tables = {
        own: rows if rows is None else _rows(rows, keep[table])
        for table, (own, rows) in given.items()
    }
    changed = dataclasses.replace(
        train, topology=_topology(topology, keep, disks), **tables
    )
    if errors := connections.train_errors(changed):
        raise SceneError(errors)
    return changed


def _kept(topology, out):
    """Numbers of the elements that stay by table, and of the disks, where (table,
    number) are left ``out``.
    """
    scene = topology.n_scene_disks
    links = [
        (table, i)
        for table in LINKS
        for i in range(len(getattr(topology, f"{table}_names")))
    ]
    closed = [
        ends
        for link, ends in zip(links, topology.link_ends, strict=True)
        if link not in out
    ]
    lost = {i for table, i in out if table == "disk"} | {
        scene + i for table, i in out if table == "damper"
    }
    # A disk that is left out joins nothing: what hung on it alone goes with it.
    piece = connections.pieces(
        topology.n_disks, [ends for ends in closed if not lost.intersection(ends)]
    )
    disks = [d for d, p in enumerate(piece) if p == piece[topology.reference_disk]]
    keep = {"disk": [d for d in disks if d < scene]}
    there = set(disks)
    seats = dict(zip(links, topology.link_ends, strict=True))
    for table in SEATED:
        seats |= {
            (table, i): (disk,)
            for i, disk in enumerate(getattr(topology, f"{table}_disk"))
        }
    for table in (*LINKS, *SEATED):
        own = [
            i
            for (kind, i), on in seats.items()
            if kind == table and there.issuperset(on)
        ]
        keep[table] = [i for i in own if (table, i) not in out]
    phased = zip(topology.phase_cylinders, topology.phase_torques, strict=True)
    both = {*keep["cylinder"]}, {*keep["torque"]}
    stays = [
        any(own.intersection(row) for own, row in zip(both, rows, strict=True))
        for rows in phased
    ]
    keep["phase"] = [
        i for i, there in enumerate(stays) if there and ("phase", i) not in out
    ]
    return keep, disks


def _rows(table, keep):
    """The rows of a table that stay; of a table inside it those that belong to them."""
    found = {}
    for field in dataclasses.fields(table):
        values = getattr(table, field.name)
        if dataclasses.is_dataclass(values):
            rows = [k for k, seat in enumerate(values.seats) if seat in keep]
            seats = tuple(keep.index(values.seats[k]) for k in rows)
            values = (
                dataclasses.replace(_rows(values, rows), seats=seats) if rows else None
            )
        elif isinstance(values, tuple):
            values = tuple(values[i] for i in keep)
        elif values is not None:
            values = values[keep]
        found[field.name] = values
    return type(table)(**found)


def _topology(topology, keep, disks):
    """The topology of the elements that stay, numbered anew."""
    place = {disk: k for k, disk in enumerate(disks)}
    links = [link_number(topology, table, i) for table in LINKS for i in keep[table]]
    number = {link: k for k, link in enumerate(links)}
    keys = topology.link_keys
    found = {}
    for field in dataclasses.fields(topology):
        table, _, what = field.name.partition("_")
        if table not in keep or field.name == "disk_names":
            continue
        rows = [getattr(topology, field.name)[i] for i in keep[table]]
        if what == "disk":
            rows = [place[disk] for disk in rows]
        elif what == "ends":
            rows = [(place[a], place[b]) for a, b in rows]
        elif what in ("cylinders", "torques"):  # of a phase
            own = keep[what.removesuffix("s")]
            rows = [tuple(own.index(i) for i in row if i in own) for row in rows]
        found[field.name] = tuple(rows)
    varying = {
        name: getattr(topology, name)
        for name in ("hz_links", "amplitude_links", "order_links")
    }
    found |= {
        name: tuple(number[i] for i in own if i in number)
        for name, own in varying.items()
    }
    elastic = [
        *found["shaft_ends"],
        *((on, len(keep["disk"]) + k) for k, on in enumerate(found["damper_disk"])),
    ]
    # Speeds follow from the radii of the train: here they are not looked at.
    radii = [float("nan")] * len(disks)
    reference = place[topology.reference_disk]
    gearing = connections.Gearing(
        len(disks), elastic, found["mesh_ends"], found["mesh_internal"], radii
    )
    rotors = gearing.rotors(gearing.lead(reference))
    return dataclasses.replace(
        topology,
        **found,
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
    )

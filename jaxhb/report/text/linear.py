"""The linear train as text, plain numbers and rows: modes, mean load, Holzer's tables,
the Campbell diagram.
"""

import dataclasses

import numpy as np

from jaxhb.elements.elements import SceneError
from jaxhb.equations.backlash import all_meshes
from jaxhb.linear.critical import ELASTIC, RIGID, RING, shares_in_mode
from jaxhb.linear.tangent import at_pressed_load, own_speed
from jaxhb.report.text.columns import (
    NONE,
    Table,
    fixed,
    from_rows,
    percent,
    plain_number,
)

FIRST = 3  # modes whose energies or tables are shown where none is asked for

SCALE = (
    "Modal torque: amplitude of the order's torques on the shape whose largest angle is"
    " 1. Every mode has a scale of its own: compare the orders of one mode, not modes."
)


def modes_text(modes, name, kinds, ratios, teeth=""):
    """Natural frequencies, nodes, damping ratios (nan: none), what moves; ``teeth``
    says how stiff they are.
    """
    rows = []
    loose = sum(kind == RIGID for kind in kinds)
    for k, hz in enumerate(modes.frequencies_hz):
        shape = modes.shape(k)
        most = sorted(shape, key=lambda disk: -abs(shape[disk]))[:3]
        moving = ", ".join(
            f"{disk} {shape[disk]:+.2f}" for disk in most if abs(shape[disk]) >= 0.005
        )
        if kinds[k] == RING:
            moving = f"ring only: {most[0]} turns freely"
        elif kinds[k] == RIGID:
            moving = (
                f"one of {loose} rigid-body modes" if loose > 1 else "rigid-body mode"
            )
            moving += " on the ground's spring" if hz else ""
        damping = fixed(ratios[k], 4)
        nodes = modes.node_count[k] if kinds[k] == ELASTIC else NONE
        in_teeth = [f"{100 * modes.mesh_energy_share[k]:.0f}"] * bool(teeth)
        rows.append(
            [k, fixed(hz, 2), fixed(60 * hz, 0), nodes, damping, *in_teeth, moving]
        )
    heads = [
        "mode",
        "Hz",
        "per minute",
        "nodes",
        "damping ratio",
        *["in teeth %"] * bool(teeth),
    ]
    title = f"Natural frequencies of {name}: undamped"
    title += f", {teeth}; share of the strain energy in the teeth" if teeth else ""
    return from_rows(
        title,
        [*heads, "largest angles, on own shafts, the largest 1"],
        rows,
        left=(len(heads),),
    )


def in_contact(train):
    """How stiff the teeth are, of which tables of trains with teeth tell."""
    return "teeth in contact" if train.topology.mesh_names else ""


def energies_text(modes, kinds):
    """Where the energies of the first elastic modes lie, in tables; Holzer's table has
    them of trees.
    """
    shown = [k for k, kind in enumerate(kinds) if kind == ELASTIC][:FIRST]
    kinetic = ("disk", modes.names, modes.kinetic_share)
    strain = ("link", modes.link_names, modes.strain_share)
    heads = [f"mode {k}" for k in shown]
    return [
        Table(
            f"{what} energy of the first elastic modes, %",
            [head, *heads],
            [names, *(list(map(percent, share[k])) for k in shown)],
        )
        for what, (head, names, share) in {"Kinetic": kinetic, "Strain": strain}.items()
        if shown
    ]


def modes_record(modes, kinds, ratios):
    """What ``modes --json`` writes: lists over the modes, by name of disks and links;
    the largest angle is 1.
    """
    listed = ("frequencies_hz", "mesh_energy_share", "node_count", "generalised_mass")
    return {name: getattr(modes, name) for name in listed} | {
        "kinds": kinds,
        "damping_ratios": ratios,
        "modes": dict(zip(modes.names, modes.shapes.T, strict=True)),
        "kinetic_share": dict(zip(modes.names, modes.kinetic_share.T, strict=True)),
        "strain_share": dict(zip(modes.link_names, modes.strain_share.T, strict=True)),
    }


def approximations(train, rpm=None, response=None, *, closed=True):
    """What linear calculations take at the mean load or leave out, a sentence for each
    element and reason: of one speed or several, by default of that of
    :func:`own_speed`; ``response``, a :class:`jaxhb.ForcedResponse` at these, tells
    which vibrations leave the stage; ``closed``: clearances are.
    """
    topology = train.topology
    springs = {}
    for link, kind, row in topology.springs:
        springs.setdefault(link, {}).setdefault(kind, []).append(row)
    asked = [own_speed(train)] if rpm is None else rpm
    loads = (
        [at_pressed_load(train, rpm=float(speed)) for speed in asked] if springs else []
    )
    found = []
    for place, (link, kinds) in enumerate(springs.items()):
        name = topology.link_names[link]
        if "stages" in kinds or "stops" in kinds:
            found.append(f"{name}: {_stage_sentence(loads, place)}.")
            found += _crossing(train, link, kinds, response)
        if "clearance" in kinds and closed:
            found.append(
                f"{name}: its clearance is taken closed; jaxhb solve has it open."
            )
        if "friction" in kinds:
            friction = _of_link(train, link, "friction")
            found.append(
                f"{name}: its dry friction of {float(friction):.4g} N m is left out;"
                " jaxhb solve has it."
            )
    variation = all_meshes(train).variation
    for mesh in np.flatnonzero(topology.mesh_varies):
        most = 200 * np.abs(np.asarray(variation[mesh])).sum()
        said = (
            f"its stiffness varies over the mesh period, by up to {most:.3g} % of its"
            " mean"
        )
        found.append(
            f"{topology.mesh_names[mesh]}: {said}, which is taken here; jaxhb solve has"
            " the variation."
        )
    return found


def _of_link(train, link, field):
    """A field of a shaft or damper by the number of the link."""
    shafts = len(train.topology.shaft_names)
    table, index = (
        (train.shafts, link) if link < shafts else (train.dampers, link - shafts)
    )
    return np.asarray(getattr(table, field))[index]


def _stage_sentence(loads, place):
    """The stiffness of one link with stages or stops at its mean load, over the
    speeds.
    """
    slopes = [float(load.link_stiffness[place]) for load in loads]
    torques = [float(load.torque[place]) for load in loads]
    if not all(load.loaded for load in loads):
        return (
            f"linear with {plain_number(slopes[0])} N m/rad, its stiffness at rest: no"
            " load balances the mean torques"
        )
    first = loads[0].rpm
    last = loads[-1].rpm
    where = (
        f"at {first:g} rpm" if len(loads) == 1 else f"from {first:g} to {last:g} rpm"
    )
    stiffness, torque = (
        (
            f"{min(own):.4g}"
            if np.ptp(own) <= 1e-6 * np.abs(own).max()
            else f"{min(own):.4g} to {max(own):.4g}"
        )
        for own in (slopes, torques)
    )
    return (
        f"linear with {stiffness} N m/rad, its stiffness at the mean torque of {torque}"
        f" N m {where}"
    )


def _crossing(train, link, kinds, response):
    """A sentence on the speeds at which the vibration of a link leaves the stage of its
    mean torque, in a list.
    """
    if response is None:
        return []
    knots = [
        sign * row[0]
        for row in _rows_of(train, link, kinds, "stages")
        for sign in (1, -1)
    ]
    knots = np.array(knots + [row[0] for row in _rows_of(train, link, kinds, "stops")])
    ends = [train.topology.disk_names[disk] for disk in train.topology.link_ends[link]]
    twist = response.twist(*ends)
    low, high = (
        np.rad2deg(np.asarray(values))[:, None] for values in (twist.min, twist.max)
    )
    crossed = np.asarray(response.converged) & ((low < knots) & (knots < high)).any(
        axis=-1
    )
    if not crossed.any():
        return []
    worst = int(np.argmax(np.where(crossed, (high - low)[:, 0], -1.0)))
    speeds = np.asarray(response.rpm)[crossed]
    where = (
        f"at {speeds[0]:g} rpm"
        if len(speeds) == 1
        else f"at {len(speeds)} speeds from {speeds[0]:g} rpm on"
    )
    swing = (
        f"{low[worst, 0]:.3g} to {high[worst, 0]:.3g} deg at"
        f" {float(response.rpm[worst]):g} rpm"
    )
    name = train.topology.link_names[link]
    return [
        f"{name}: its vibration leaves this stage {where} ({swing}): only jaxhb solve"
        " tells what it does there."
    ]


def _rows_of(train, link, kinds, field):
    """The stages or stops of a link."""
    return (
        _of_link(train, link, field)[: len(kinds.get(field, ()))]
        if field in kinds
        else []
    )


def mean_load_text(load, rpm):
    """A line that tells the tangent stiffness of every mesh with backlash, and of
    shafts and dampers with stages, stops or clearance; ``load`` is a
    :class:`jaxhb.MeanLoad`.
    """
    said = [
        f"{name} {plain_number(torque)} N m at {plain_number(stiffness)} N m/rad"
        for name, torque, stiffness in zip(
            load.links, load.torque, load.link_stiffness, strict=True
        )
    ]
    for name, force, engagement, share in zip(
        load.names, load.force, load.engagement, load.share, strict=True
    ):
        where = "in the gap" if engagement == 0 else "in the transition zone"
        where = (
            "in contact"
            if engagement == 1
            else f"{where}, {percent(share)} % of its stiffness"
        )
        said.append(f"{name} {abs(force) / 1e3:.4g} kN {where}")
    return f"Mean load of {rpm:g} rpm: {', '.join(said) or 'no mesh has backlash'}."


def mean_load_record(load, rpm):
    """What ``modes --at --json`` adds by mesh with backlash: elastic force, tangent
    stiffness, engagement 0 to 1; by shaft or damper with stages, stops, clearance or
    friction: torque, twist, tangent stiffness.
    """
    keys = "force", "stiffness", "engagement"
    rows = {
        name: {key: getattr(load, key)[i] for key in keys}
        for i, name in enumerate(load.names)
    }
    of_links = {
        "torque": load.torque,
        "twist": load.twist,
        "stiffness": load.link_stiffness,
    }
    rows |= {
        name: {key: values[i] for key, values in of_links.items()}
        for i, name in enumerate(load.links)
    }
    return {"at_rpm": rpm, "mean_load": rows}


HOLZER = (
    "inertia",
    "ordinate",
    "torque",
    "torque_sum",
    "stiffness",
    "twist",
    "kinetic_energy",
    "strain_energy",
)
"""Of a HolzerTable, in the file; the first six in the text."""


def chosen_modes(kinds, name, asked=None):
    """Numbers of the modes asked for, or the first that strain links; a ``SceneError``
    of those that do not.
    """
    elastic = [k for k, kind in enumerate(kinds) if kind == ELASTIC]
    if not elastic:
        raise SceneError(f"{name}: no mode strains a link. Give a frequency with --hz.")
    errors = []
    for k in asked or ():
        if k >= len(kinds):
            errors.append(f"{name}: --mode {k}: there are modes 0 to {len(kinds) - 1}.")
        elif k not in elastic:
            strained = (
                f"no link is strained. The first that strains one is {elastic[0]}."
            )
            errors.append(f"{name}: --mode {k}: this mode is {kinds[k]}, {strained}")
    if errors:
        raise SceneError(errors)
    return list(dict.fromkeys(asked)) if asked else elastic[:FIRST]


def holzer_text(tables, name, teeth=""):
    """Holzer's ``tables``, pairs (number of the mode or None, HolzerTable), with
    ``teeth`` as of :func:`modes_text`.
    """
    how = ", ".join(filter(None, ["undamped", teeth]))
    meshes = "; of a mesh c N/m, sum/c m" if teeth else ""
    head = (
        f"{name}: Holzer's table, {how}. J kg m2, theta rad, torques N m,\nc N m/rad,"
        f" sum/c rad{meshes}. Energies of disk and link in % of the kinetic"
        " energy.\nThe sum of a row passes through its link."
    )
    return "\n\n".join([head, *(_holzer_table(*one) for one in tables)])


def _holzer_table(mode, table):
    kinetic = table.kinetic_energy.sum()
    cells = [
        [f"{value:#.5g}".rstrip(".") for value in getattr(table, field) + 0.0]
        for field in HOLZER[:6]
    ]
    cells += [
        [f"{100 * share:.1f}" for share in e / kinetic]
        for e in (table.kinetic_energy, table.strain_energy)
    ]
    inertia, ordinate, torque, torque_sum, stiffness, twist, of_disk, of_link = cells
    # Behind the last disk is no link.
    links, stiffness, twist, of_link = (
        [*own[:-1], NONE] for own in (table.links, stiffness, twist, of_link)
    )
    heads = [
        "disk",
        "J",
        "theta",
        "J w2 theta",
        "sum",
        "disk %",
        "link",
        "c",
        "sum/c",
        "link %",
    ]
    columns = [
        table.names,
        inertia,
        ordinate,
        torque,
        torque_sum,
        of_disk,
        links,
        stiffness,
        twist,
        of_link,
    ]
    what = "" if mode is None else f"mode {mode}, "
    return Table(
        f"{what}{table.hz:.6g} Hz, residual {table.residual + 0.0:.4g} N m",
        heads,
        columns,
        left=(6,),
    )


def holzer_record(tables, name):
    """What ``holzer --json`` writes: lists over the rows of every table, SI units; mode
    None: of a given frequency.
    """
    rows = [
        {
            "hz": table.hz,
            "mode": mode,
            "residual": table.residual,
            "disks": table.names,
            "links": table.links,
        }
        | {field: getattr(table, field) for field in HOLZER}
        for mode, table in tables
    ]
    return {"scene": name, "tables": rows}


def campbell_text(found, count, name, misfires, names, teeth="", lines=(), worst=()):
    """Modes and critical speeds of a Campbell diagram of ``count`` elastic modes;
    ``misfires`` by cylinder, ``names`` of the orders; ``lines`` stand below the first,
    sentences on the ``worst`` misfire last.
    """
    stiff = ", ".join(filter(None, ["undamped", teeth]))
    head = (
        f"{name}: Campbell diagram from {found.rpm[0]:g} to {found.rpm[-1]:g} rpm,"
        f" {stiff}"
    )
    return "\n\n".join(
        [
            "\n".join([head, *lines]),
            *campbell_parts(found, count, misfires, names),
            *worst,
        ]
    )


def campbell_parts(found, count, misfires, names):
    """The tables of :func:`campbell_text`, and a sentence where there is none."""
    shown = found.shown(count)
    hz = found.frequencies_hz
    constant = (hz[:, shown] == hz[0, shown]).all()
    heads = (
        ["Hz"]
        if constant
        else [f"Hz at {found.rpm[0]:g} rpm", f"at {found.rpm[-1]:g} rpm"]
    )
    rows = [
        [k, *(f"{hz[i, k]:.2f}" for i in (0, -1)[: len(heads)]), found.kinds[k]]
        for k in shown
    ]
    title = (
        "Natural frequencies; rigid modes and those of rings only have no critical"
        " speeds"
    )
    parts = [
        from_rows(title, ["mode", *heads, "kind"], rows, left=(1 + len(heads),)),
        *_left_out(found, count),
    ]
    orders = ", ".join(map(names.number, found.orders)) or "none"
    if not found.critical:
        return [*parts, f"No critical speed lies in the range. Orders: {orders}."]
    heads = ["rpm", "order", "mode", "Hz", "modal torque N m"]
    rows = [
        [
            f"{c.rpm:.1f}",
            names.number(c.order),
            c.mode,
            f"{c.hz:.2f}",
            plain_number(c.torque),
        ]
        for c in found.critical
    ]
    if misfires:
        heads += ["worst misfire N m", "that of"]
        worst = [_worst_at(place, misfires) for place in range(len(rows))]
        rows = [
            [*row, plain_number(torque), name]
            for row, (name, torque) in zip(rows, worst, strict=True)
        ]
    title = f"Critical speeds, order x rpm / 60 = Hz. {SCALE}\nOrders: {orders}."
    return [*parts, from_rows(title, heads, rows, left=(6,))]


def _worst_at(place, misfires):
    """The cylinder whose misfire has the largest modal torque at a critical speed,
    where all have the same mode, and this torque.
    """
    torques = {
        cylinder: diagram.critical[place].torque
        for cylinder, diagram in misfires.items()
    }
    return max(torques.items(), key=lambda item: item[1])


def excited_most(found, misfires, cylinder, rpm):
    """The Critical at a critical speed whose order and mode a misfire excites most
    beside others of its mode, its modal torque that of the misfire, and the torque with
    all firing.
    """
    critical = misfires[cylinder].critical
    shares = shares_in_mode(critical, [c.torque for c in critical])
    place = max(
        (k for k, c in enumerate(critical) if c.rpm == rpm), key=lambda k: shares[k]
    )
    return critical[place], found.critical[place].torque


def _left_out(found, count):
    """A sentence on modes that are not told, in a list."""
    shown = len(found.elastic(count))
    every = len(found.elastic(len(found.kinds)))
    crossed = found.reached()
    if shown == every:
        return []
    highest = max(found.orders, default=0.0)
    low = float(found.rpm[0])
    high = float(found.rpm[-1])
    top = f"order {highest:g} at {high:g} rpm is {highest * high / 60:.4g} Hz"
    first = f"These are the {shown} lowest of {every} modes that strain links"
    if crossed <= shown:
        return [f"{first}. The orders reach {crossed} of them, all shown: {top}."]
    call = f"jaxhb campbell SCENE --rpm {low:g}:{high:g} --modes {crossed} lists all."
    return [f"{first}; the orders reach {crossed} of them ({top}). {call}"]


def campbell_record(found, count, name, misfires, worst=None):
    """What ``campbell --json`` writes, see ``docs/how_to/linear.md``; ``worst`` is the
    record of the worst misfire.
    """
    speeds = [_critical_record(c) for c in found.critical]
    for place, speed in enumerate(speeds if misfires else ()):
        speed["misfires"] = {
            cylinder: one.critical[place].torque for cylinder, one in misfires.items()
        }
    modes = [
        {
            "mode": k,
            "kind": found.kinds[k],
            "frequencies_hz": found.frequencies_hz[:, k],
        }
        for k in found.shown(count)
    ]
    record = {
        "scene": name,
        "rpm": found.rpm,
        "orders": found.orders,
        "modes": modes,
        "critical_speeds": speeds,
    }
    if misfires:
        record["worst_misfire"] = worst and worst | _of_mode(found, misfires, worst)
    return record


def _of_mode(found, misfires, worst):
    """Order, mode and modal torques of the record of a worst misfire."""
    critical, firing = excited_most(found, misfires, worst["cylinder"], worst["rpm"])
    return _critical_record(critical) | {"modal_torque_firing": firing}


def _critical_record(c):
    return {
        "rpm": c.rpm,
        "order": c.order,
        "mode": c.mode,
        "hz": c.hz,
        "modal_torque": c.torque,
    }


def campbell_rows(found, misfires, titles):
    """Heads and rows of ``campbell --csv``: one row per critical speed; modal torques
    with misfires, which have ``titles``, come last.
    """
    heads = ["rpm", "order", "mode", "Hz", "modal torque N m"]
    heads += [f"modal torque N m, {titles[cylinder]}" for cylinder in misfires]
    own = [
        [one.critical[k].torque for one in misfires.values()]
        for k in range(len(found.critical))
    ]
    return heads, [
        [*dataclasses.astuple(c), *more]
        for c, more in zip(found.critical, own, strict=True)
    ]

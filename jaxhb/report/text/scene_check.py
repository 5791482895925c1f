"""What a scene comes to before anything vibrates: mean torques, tooth forces, tooth damping, notes on it, and numbers
referred to the reference rotor.
"""

import numpy as np

from jaxhb.design.quantities import check_all
from jaxhb.design.table import read_table
from jaxhb.elements.elements import SceneError
from jaxhb.equations.kinematics import referred, tooth_damping_ratios
from jaxhb.excitation.mean_torques import mean_torques
from jaxhb.report.text.columns import NONE, Table, aligned, alike
from jaxhb.report.text.mean_torques import ground_notes, ground_reactions, load_notes, load_torques
from jaxhb.report.text.sentences import once_alike, speed_of
from jaxhb.train import connections
from jaxhb.train.plausible import plausibility


def referred_text(train):
    """The tables of :func:`referred_tables` as one text."""
    return "\n\n".join(referred_tables(train))


def referred_tables(train):
    """Inertias, stiffnesses and dampings, actual and referred, with the factor between them.

    Loss factors, order-tuned dampers and the rows of links that vary are told where the train has any.

    Parameters
    ----------
    train : DriveTrain

    Returns
    -------
    list of Table

    Examples
    --------
    >>> from jaxhb.scene.files import load_scene
    >>> disks, links = referred_tables(load_scene("spur_pair"))
    >>> disks.columns[2]
    ['0.00281448', '0.00281448']
    """
    found = referred(train)
    disks = [found.disks, *map(_numbers, (found.factor, found.inertia, found.inertia_referred))]
    more_heads, more = _to_ground(train, found.factor)
    kinds = ["shaft"] * len(train.topology.shaft_names) + ["damper"] * len(train.topology.damper_names)
    kinds += ["mesh"] * len(train.topology.mesh_names)
    names = "link_factor", "stiffness", "stiffness_referred", "damping", "damping_referred"
    links = [found.links, kinds, *(_numbers(getattr(found, name)) for name in names)]
    name = train.topology.name or "scene"
    more_said = ", damping and stiffness to ground" * bool(more)
    title = f"{name}: inertias{more_said}, actual and referred to the reference rotor"
    heads = ["disk", "speed ratio i", "J kg m2", "J i^2", *more_heads]
    parts = [Table(title, heads, [*disks, *map(_numbers, more)])]
    if found.links:
        title = "Stiffness k and damping r of links; of meshes in N/m and N s/m, their factor is i x radius in m"
        heads = ["link", "", "factor i", "k N m/rad", "k i^2", "r N m s/rad", "r i^2"]
        loss = np.concatenate([train.shafts.loss_factor, train.dampers.loss_factor])
        if loss.any():
            heads.append("loss factor")
            links.append(_numbers(loss) + [NONE] * len(train.topology.mesh_names))
        parts.append(Table(title, heads, links, left=(1,)))
    return [*parts, *_order_table(train, found), *_varying_table(train, found)]


def _to_ground(train, factor):
    """Heads and columns of the damping of disks and the stiffness of grounds, of what the train has."""
    damping, stiffness = np.zeros((2, len(factor)))
    damping[: len(train.disks.damping)] = train.disks.damping
    np.add.at(stiffness, np.array(train.topology.ground_disk, dtype=int), train.grounds.stiffness)
    heads, columns = [], []
    for values, own, made in ((damping, "r N m s/rad", "r i^2"), (stiffness, "k N m/rad", "k i^2")):
        if values.any():
            heads += [own, made]
            columns += [values, values * factor**2]
    return heads, columns


def _order_table(train, found):
    """Order-tuned dampers, in a list; empty without."""
    tuned = np.flatnonzero(found.order)
    if not len(tuned):
        return []
    first = len(train.topology.shaft_names) + tuned
    rings = len(train.disks.inertia) + tuned
    growth = found.inertia[rings] * (found.order_referred[tuned] * 2 * np.pi / 60) ** 2
    columns = [growth, growth * found.factor[rings] ** 2]
    cells = [found.order[tuned], found.order_referred[tuned], *columns]
    title = "Order-tuned dampers: stiffness that is added per square of the speed of the reference rotor"
    heads = ["link", "order n", "n i", "N m/rad/rpm2", "i^2 of it"]
    return [Table(title, heads, [[found.links[i] for i in first], *map(_numbers, cells)])]


def _varying_table(train, found):
    """Rows of the tables of links that vary, as stiffness and damping, in a list; empty without."""
    topology, shafts = train.topology, len(train.topology.shaft_names)
    rows = []
    for field, numbers in (("over_hz", topology.hz_links), ("over_amplitude", topology.amplitude_links)):
        for i in numbers:
            table, k = (train.shafts, i) if i < shafts else (train.dampers, i - shafts)
            i2 = found.link_factor[i] ** 2
            for at, stiffer, damped in dict.fromkeys(map(tuple, np.asarray(getattr(table, field)[k]).tolist())):
                # Angles referred to the reference rotor are phi / i; frequencies are the same for all.
                referred_at = at if field == "over_hz" else at / found.link_factor[i]
                stiffness, damping = stiffer * found.stiffness[i], damped * found.damping[i]
                values = [at, referred_at, stiffness, stiffness * i2, damping, damping * i2]
                rows.append([found.links[i], field, *_numbers([*values, damped * table.loss_factor[k]])])
    if not rows:
        return []
    title = (
        "Links that vary: stiffness, damping and loss factor at the frequencies (Hz) or amplitudes (rad) of their rows"
    )
    heads = ["link", "over", "at", "referred", "k N m/rad", "k i^2", "r N m s/rad", "r i^2", "loss factor"]
    return [Table(title, heads, list(zip(*rows, strict=True)), left=(1,))]


def _numbers(values):
    return [f"{value:.6g}" for value in values]


ANY_SPEED = 1000.0
"""rpm, where no torque depends on the speed."""


def own_speeds(train):
    """The lowest and the highest speed at which the scene gives a torque, rpm; None where torques do not depend on it.

    Parameters
    ----------
    train : DriveTrain

    Returns
    -------
    list of float or None

    Examples
    --------
    >>> import jaxhb
    >>> own_speeds(jaxhb.load_scene("gear_train_30")), own_speeds(jaxhb.load_scene("first_scene"))
    ([600.0, 2450.0], None)
    """
    speeds = connections.speeds(train)
    speeds = speeds[speeds > 0.0]
    return sorted({float(speeds[0]), float(speeds[-1])}) if len(speeds) else None


def scene_notes(responses):
    """All notes on a scene, of its mean motion at some speeds."""
    train = responses[0].train
    found = plausibility(train) + load_notes(responses, speed_of) + ground_notes(responses, speed_of)
    speeds = [float(response.rpm) for response in responses]
    return found + once_alike((rpm, note) for rpm in speeds for note in train.outside_traces(rpm))


def tune_notes(train):
    """What ``jaxhb tune`` would refuse in the ``[tune]`` table of the scene; nothing where there is none."""
    if not train.tune:
        return []
    try:
        asked = read_table(train)
        check_all(train, asked["parameters"], asked["objective"], asked["penalties"], asked["rpm"])
    except SceneError as error:
        return [f"jaxhb tune will refuse this scene: {sentence}" for sentence in error.sentences]
    return []


def check_text(train, responses, speeds, notes):
    """Head, mean torques and teeth as a list of paragraphs.

    Parameters
    ----------
    train : DriveTrain
        With its backlash.
    responses : list of Response
        The mean of the linear motion at every speed.
    speeds : list of float or None
        None where no torque depends on the speed.
    notes : list of str

    Returns
    -------
    list of str
    """
    topology = train.topology
    heads = [f"at {rpm:g} rpm" for rpm in speeds] if speeds else ["at any speed"]
    verdict = f"{len(notes)} note{'s' * (len(notes) != 1)} below" if notes else "nothing to note"
    parts = [f"{topology.name or 'scene'}: {_counts(topology)}; {verdict}."]
    rows = torque_rows(train, responses)
    if rows:
        columns = [
            [row[0] for row in rows],
            [row[1] for row in rows],
            *alike(*zip(*(row[2] for row in rows), strict=True)),
        ]
        title = "Mean torque on the disk's own shaft, N m (positive: drives)"
        parts.append(f"{title}\n{aligned(['', 'disk', *heads], columns, left=(1,))}")
    if topology.mesh_names:
        parts.append(_mesh_table(train, responses, heads))
    return parts


def check_record(train, responses, notes):
    """What ``check --json`` writes but for the modes.

    ``{"scene", "rpm": [...], "mean_torque_Nm": {name: [...]}, "meshes": {name: {"mean_force": [...], "damping_ratio",
    "stiffness", "damping", "backlash"}}, "notes": [...]}``; lists are over the speeds, forces in N, the rest in SI
    units; damping ratios of the two gears alone, None where a gear has no inertia.
    """
    topology, meshes = train.topology, train.meshes
    of_meshes = zip(
        topology.mesh_names,
        *(
            np.asarray(v).tolist()
            for v in (tooth_damping_ratios(train), meshes.stiffness, meshes.damping, meshes.backlash)
        ),
        strict=True,
    )
    return {
        "scene": topology.name,
        "rpm": [float(response.rpm) for response in responses],
        "mean_torque_Nm": {name: list(means) for name, _, means in torque_rows(train, responses)},
        "meshes": {
            name: {"mean_force": _means(responses, name), "damping_ratio": ratio}
            | {"stiffness": stiffness, "damping": damping, "backlash": backlash}
            for name, ratio, stiffness, damping, backlash in of_meshes
        },
        "notes": notes,
    }


def _counts(topology):
    backlash = sum(topology.mesh_backlash)
    counted = [
        (topology.n_scene_disks, "disk", ""),
        (topology.n_rotors, "rotor", ""),
        (len(topology.shaft_names), "shaft", ""),
        (len(topology.mesh_names), "mesh", f" ({backlash} with backlash)"),
        (len(topology.damper_names), "damper", ""),
        (len(topology.cylinder_names), "cylinder", ""),
    ]
    plural = {"mesh": "meshes"}
    return ", ".join(
        f"{count} {word if count == 1 else plural.get(word, word + 's')}{more}"
        for count, word, more in counted
        if count
    )


def torque_rows(train, responses):
    """(name, disk, means over the speeds) of given torques, cylinders, loads and grounds."""
    topology = train.topology
    speeds = np.array([float(response.rpm) for response in responses])
    cycle = topology.cylinder_fires, topology.cylinder_gas_revolutions
    means = mean_torques(train.torques, train.cylinders, *cycle, speeds).T.tolist()
    names = [*topology.torque_names, *topology.cylinder_names]
    seats = [*topology.torque_disk, *topology.cylinder_disk]
    rows = list(zip(names, seats, means, strict=True))
    for names, seats, read, sign in (
        (topology.load_names, topology.load_disk, load_torques, 1.0),
        (topology.ground_names, topology.ground_disk, ground_reactions, -1.0),
    ):
        taken = [read(response) for response in responses]
        rows += [(name, seat, [sign * one[name] for one in taken]) for name, seat in zip(names, seats, strict=True)]
    return [(name, topology.disk_names[seat], means) for name, seat, means in rows]


def _means(responses, mesh):
    return [float(response.force(mesh).mean) for response in responses]


def _mesh_table(train, responses, heads):
    topology, meshes = train.topology, train.meshes
    names = topology.mesh_names
    forces = alike(
        *([1e-3 * force for force in one] for one in zip(*(_means(responses, n) for n in names), strict=True))
    )
    ratios = [f"{ratio:.4f}" if np.isfinite(ratio) else NONE for ratio in tooth_damping_ratios(train)]
    backlash = [
        f"{1e3 * h:.4g}" if own else NONE for h, own in zip(meshes.backlash, topology.mesh_backlash, strict=True)
    ]
    title = "Mean tooth force, kN (positive: the first gear drives), backlash, and damping ratio of the two gears alone"
    return f"{title}\n{aligned(['mesh', *heads, 'backlash mm', 'damping ratio'], [names, *forces, backlash, ratios])}"

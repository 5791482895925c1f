"""What a scene comes to before anything vibrates: mean torques, tooth forces, damping,
notes, referred numbers.
"""

import numpy as np

from jaxhb.design.quantities import check_all
from jaxhb.design.table import read_table
from jaxhb.design.tolerances import read_tolerances
from jaxhb.elements.elements import SceneError
from jaxhb.equations.backlash import all_meshes
from jaxhb.equations.fourier import sample
from jaxhb.equations.kinematics import referred, tooth_damping_ratios
from jaxhb.excitation.gas import charge_pressures, load_share
from jaxhb.excitation.mean_torques import mean_torques
from jaxhb.report.text.columns import NONE, Table, fixed, from_rows, plain_number
from jaxhb.report.text.mean_torques import torque_notes, torques_of
from jaxhb.report.text.sentences import firing_lines, once_alike
from jaxhb.results.motion import ROUNDING
from jaxhb.train import connections
from jaxhb.train.plausible import plausibility

ANY_SPEED = 1000.0  # rpm, where no torque depends on the speed
SAMPLES = 8192  # of a cycle, at which the stiffness of a mesh is looked at


def referred_tables(train):
    """Inertias, stiffnesses and dampings, actual and referred to the reference rotor;
    what the train has, in tables.
    """
    found = referred(train)
    topology = train.topology
    damping, stiffness = np.zeros((2, len(found.factor)))
    damping[: len(train.disks.damping)] = train.disks.damping
    np.add.at(
        stiffness, np.array(topology.ground_disk, dtype=int), train.grounds.stiffness
    )
    disks = {"disk": found.disks, "speed ratio i": found.factor}
    disks |= {"J kg m2": found.inertia, "J i^2": found.inertia_referred}
    for head, referred_head, values in (
        ("r N m s/rad", "r i^2", damping),
        ("k N m/rad", "k i^2", stiffness),
    ):
        if values.any():
            disks |= {head: values, referred_head: values * found.factor**2}
    more = ", damping and stiffness to ground" * (len(disks) > 4)
    parts = [
        _numbers(
            f"{topology.title}: inertias{more}, actual and referred to the reference"
            " rotor",
            disks,
        )
    ]
    if found.links:
        kinds = [
            kind
            for kind in ("shaft", "damper", "mesh")
            for _ in getattr(topology, f"{kind}_names")
        ]
        links = {"link": found.links, "": kinds, "factor i": found.link_factor}
        links |= {"k N m/rad": found.stiffness, "k i^2": found.stiffness_referred}
        links |= {"r N m s/rad": found.damping, "r i^2": found.damping_referred}
        loss = [*train.shafts.loss_factor, *train.dampers.loss_factor]
        if any(loss):
            links["loss factor"] = loss + [NONE] * len(topology.mesh_names)
        title = (
            "Stiffness k and damping r of links; of meshes in N/m and N s/m, their"
            " factor is i x radius in m"
        )
        parts.append(_numbers(title, links, left=(1,)))
    return [*parts, *_order_table(train, found), *_varying_table(train, found)]


def _numbers(title, columns, left=()):
    """A table of columns by their heads: names, and numbers of six digits."""
    cells = [
        [cell if isinstance(cell, str) else f"{cell:.6g}" for cell in column]
        for column in columns.values()
    ]
    return Table(title, list(columns), cells, left=left)


def _order_table(train, found):
    """Order-tuned dampers, in a list."""
    tuned = np.flatnonzero(found.order)
    if not len(tuned):
        return []
    names = train.topology.damper_names
    rings = len(train.disks.inertia) + tuned
    growth = found.inertia[rings] * (found.order_referred[tuned] * 2 * np.pi / 60) ** 2
    columns = {
        "link": [names[i] for i in tuned],
        "order n": found.order[tuned],
        "n i": found.order_referred[tuned],
    }
    columns |= {"N m/rad/rpm2": growth, "i^2 of it": growth * found.factor[rings] ** 2}
    title = (
        "Order-tuned dampers: stiffness that is added per square of the speed of the"
        " reference rotor"
    )
    return [_numbers(title, columns)]


def _varying_table(train, found):
    """The tables of links that vary, as stiffness and damping, in a list."""
    topology = train.topology
    shafts = len(train.topology.shaft_names)
    rows = []
    for field, numbers in (
        ("over_hz", topology.hz_links),
        ("over_amplitude", topology.amplitude_links),
    ):
        for i in numbers:
            table, k = (train.shafts, i) if i < shafts else (train.dampers, i - shafts)
            i2 = found.link_factor[i] ** 2
            for at, stiffer, damped in dict.fromkeys(
                map(tuple, np.asarray(getattr(table, field)[k]).tolist())
            ):
                # Angles referred to the reference rotor are phi / i; frequencies are
                # the same for all.
                referred_at = at if field == "over_hz" else at / found.link_factor[i]
                stiffness = stiffer * found.stiffness[i]
                damping = damped * found.damping[i]
                values = (
                    at,
                    referred_at,
                    stiffness,
                    stiffness * i2,
                    damping,
                    damping * i2,
                )
                rows.append(
                    [found.links[i], field, *values, damped * table.loss_factor[k]]
                )
    at = "frequencies (Hz) or amplitudes (rad) of their rows"
    title = f"Links that vary: stiffness, damping and loss factor at the {at}"
    heads = [
        "link",
        "over",
        "at",
        "referred",
        "k N m/rad",
        "k i^2",
        "r N m s/rad",
        "r i^2",
        "loss factor",
    ]
    return (
        [
            _numbers(
                title, dict(zip(heads, zip(*rows, strict=True), strict=True)), left=(1,)
            )
        ]
        if rows
        else []
    )


def own_speeds(train):
    """The lowest and the highest speed, rpm, at which the scene gives a torque; None
    where none depends on it.
    """
    speeds = connections.speeds(train)
    speeds = speeds[speeds > 0.0]
    return sorted({float(speeds[0]), float(speeds[-1])}) if len(speeds) else None


MOST_OF_RATED = 20.0  # a mean torque over the rated torque that no gear is built for


def scene_notes(responses):
    """All notes on a scene, of its mean motion at some speeds."""
    train = responses[0].train
    speeds = [float(response.rpm) for response in responses]
    outside = once_alike(
        (rpm, note) for rpm in speeds for note in train.outside_traces(rpm)
    )
    return (
        plausibility(train)
        + torque_notes(responses)
        + _rated_notes(responses)
        + outside
    )


def _rated_notes(responses):
    """Rated torques of meshes that are far below the mean torque of their first
    gear.
    """
    train = responses[0].train
    found = []
    topology = train.topology
    for i, name in enumerate(
        topology.mesh_names if train.meshes.rated_torque is not None else ()
    ):
        radius = float(train.disks.radius[topology.mesh_ends[i][0]])
        rated = float(train.meshes.rated_torque[i])
        mean = (
            max(abs(float(response.force(name).mean)) for response in responses)
            * radius
        )
        if 0.0 < rated < mean / MOST_OF_RATED:
            found.append(
                f"[[mesh]] {name!r}: rated_torque is {plain_number(rated)} N m, and the"
                f" mean torque of its first gear {plain_number(mean)} N m: is it in"
                " N m, not in kN m?"
            )
    return found


def table_notes(train):
    """What ``jaxhb tune`` and ``jaxhb tolerance`` would refuse in their tables of the
    scene.
    """

    def tune():
        asked = read_table(train)
        check_all(
            train,
            asked["parameters"],
            asked["objective"],
            asked["penalties"],
            asked["rpm"],
        )

    notes = []
    for name, check in (("tune", tune), ("tolerance", lambda: read_tolerances(train))):
        try:
            _ = getattr(train, name) and check()
        except SceneError as error:
            notes += [
                f"jaxhb {name} will refuse this scene: {sentence}"
                for sentence in error.sentences
            ]
    return notes


def check_text(train, responses, speeds, notes):
    """Head, mean torques and teeth of linear ``responses``; ``speeds`` None where no
    torque depends on them.
    """
    topology = train.topology
    heads = (
        [(f"at {rpm:g} rpm", "mean") for rpm in speeds]
        if speeds
        else [("at any speed", "mean")]
    )
    verdict = (
        f"{len(notes)} note{'s' * (len(notes) != 1)} below"
        if notes
        else "nothing to note"
    )
    parts = [
        "\n".join(
            [f"{topology.title}: {_counts(topology)}; {verdict}.", *firing_lines(train)]
        )
    ]
    torques = [
        [name, disk, *means] for name, disk, means in torque_rows(train, responses)
    ]
    if torques:
        title = "Mean torque on the disk's own shaft, N m (positive: drives)"
        parts.append(from_rows(title, ["", "disk", *heads], torques, left=(1,)))
    parts += _charge_table(train, [response.rpm for response in responses], heads)
    ratios = tooth_damping_ratios(train)
    rows = [
        [
            name,
            *(1e-3 * abs(mean) for mean in _means(responses, name)),
            _drivers(responses, i),
        ]
        + [
            (
                f"{1e3 * train.meshes.backlash[i]:.4g}"
                if topology.mesh_backlash[i]
                else NONE
            )
        ]
        + [fixed(ratios[i], 4)]
        for i, name in enumerate(topology.mesh_names)
    ]
    if rows:
        title = (
            "Mean tooth force, kN, backlash, and damping ratio of the two gears alone"
        )
        parts.append(
            from_rows(
                title,
                ["mesh", *heads, "driven by", "backlash mm", "damping ratio"],
                rows,
            )
        )
    meshing = _over_period(train)
    if meshing:
        title = (
            "Over the mesh period: order of the reference rotor, stiffness in % of its"
            " mean, errors of all kinds"
        )
        parts.append(
            from_rows(
                title, ["mesh", "order", "least %", "most %", "error p-p um"], meshing
            )
        )
    return parts


def _over_period(train):
    """A row for every mesh whose stiffness varies, or that has errors."""
    topology = train.topology
    meshes = all_meshes(train)
    rows = []
    given = meshes.variation, meshes.error
    for i, name in enumerate(topology.mesh_names):
        if name in topology.meshing:
            variation, error = (
                np.zeros(1) if own is None else sample(np.asarray(own)[i], SAMPLES)
                for own in given
            )
            order = topology.mesh_periods[i] / topology.revolutions_per_cycle
            told = (
                100 * (1 + variation.min()),
                100 * (1 + variation.max()),
                1e6 * np.ptp(error),
            )
            rows.append(
                [
                    name,
                    f"{order:g}" if order else NONE,
                    *(f"{value:.3g}" for value in told),
                ]
            )
    return rows


def charges_of(train, speeds):
    """Load and charge pressure (bar) over the speeds of the cylinders with a
    combustion, by their names.
    """
    burning = train.cylinders.combustion
    if burning is None:
        return {}
    speeds = np.array(speeds, dtype=float)
    loads = load_share(train.cylinders, speeds)
    (charge, _) = charge_pressures(train.cylinders, speeds)
    names = train.topology.cylinder_names
    return {
        names[i]: (loads[:, i].tolist(), (1e-5 * charge[:, k]).tolist())
        for k, i in enumerate(burning.seats)
    }


def _charge_table(train, speeds, heads):
    """A row for cylinders with the same loads and charge pressures, in a list; empty
    where all run at full load.
    """
    alike = {}
    for name, values in charges_of(train, speeds).items():
        alike.setdefault(tuple(map(tuple, values)), []).append(name)
    constant = [set(load) == {1.0} and len(set(charge)) == 1 for load, charge in alike]
    if all(constant):
        return []
    rows = [
        [connections.names_of(names, range(len(names))), *load, *charge]
        for (load, charge), names in alike.items()
    ]
    title = (
        "Load (share of the mean effective pressure at full load) and charge pressure,"
        " bar, of the combustion"
    )
    columns = [
        (f"{what} {head}", what) for what in ("load", "charge") for head, _ in heads
    ]
    return [from_rows(title, ["cylinder", *columns], rows)]


def check_record(train, responses, notes):
    """What ``check --json`` writes but for the modes, SI units, lists over the speeds;
    ratios of two gears alone.
    """
    ratios = tooth_damping_ratios(train)
    keys = ("stiffness", "damping", "backlash")
    return {
        "scene": train.topology.name,
        "rpm": [float(response.rpm) for response in responses],
        "mean_torque_Nm": {
            name: means for name, _, means in torque_rows(train, responses)
        },
        "meshes": {
            name: (
                {"mean_force": _means(responses, name), "damping_ratio": ratios[i]}
                | {key: getattr(train.meshes, key)[i] for key in keys}
            )
            for i, name in enumerate(train.topology.mesh_names)
        },
        "not_firing": train.not_firing(),
        "combustion": {
            name: {"load": load, "charge_pressure_Pa": [1e5 * bar for bar in charge]}
            for name, (load, charge) in charges_of(
                train, [float(response.rpm) for response in responses]
            ).items()
        },
        "notes": notes,
    }


def _counts(topology):
    kinds = "shaft", "mesh", "damper", "cylinder"
    counted = {"disk": topology.n_scene_disks, "rotor": topology.n_rotors}
    counted |= {kind: len(getattr(topology, f"{kind}_names")) for kind in kinds}
    said = {
        word: f"{n} {word}{('es' if word == 'mesh' else 's') * (n != 1)}"
        for word, n in counted.items()
        if n
    }
    if "mesh" in said:
        said["mesh"] += f" ({sum(topology.mesh_backlash)} with backlash)"
    return ", ".join(said.values())


def torque_rows(train, responses):
    """(name, disk, means over the speeds) of given torques, cylinders, loads and
    grounds.
    """
    topology = train.topology
    speeds = np.array([response.rpm for response in responses], dtype=float)
    means = mean_torques(
        train.torques, train.cylinders, topology.gas_cycles, speeds
    ).T.tolist()
    names = [
        *topology.torque_names,
        *topology.cylinder_names,
        *topology.load_names,
        *topology.ground_names,
    ]
    seats = [
        *topology.torque_disk,
        *topology.cylinder_disk,
        *topology.load_disk,
        *topology.ground_disk,
    ]
    loads, grounds = (
        [torques_of(one, kind) for one in responses] for kind in ("load", "ground")
    )
    means += [[own[name] for own in loads] for name in topology.load_names]
    means += [[-own[name] for own in grounds] for name in topology.ground_names]
    return [
        (name, topology.disk_names[seat], own)
        for name, seat, own in zip(names, seats, means, strict=True)
    ]


def _drivers(responses, mesh):
    """The gear that drives a mesh; of several speeds both, where it is not always the
    same.
    """
    topology = responses[0].topology
    first, second = (topology.disk_names[disk] for disk in topology.mesh_ends[mesh])
    means = _means(responses, topology.mesh_names[mesh])
    least = ROUNDING * max(map(abs, means), default=0.0)
    drivers = dict.fromkeys(
        first if mean > 0 else second for mean in means if abs(mean) > least
    )
    return " or ".join(drivers) or NONE


def _means(responses, mesh):
    return [float(response.force(mesh).mean) for response in responses]

"""Numbers of a train as they are and referred to the reference rotor, as text."""

import numpy as np

from ..model.ratios import referred
from .columns import NONE, Table


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
    >>> from jaxhb.model.scene import load_scene
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

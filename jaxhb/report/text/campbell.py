"""The Campbell diagram as text, as plain numbers and as rows."""

import dataclasses

from jaxhb.report.selection import NOT_FIRING
from jaxhb.report.text.columns import Table
from jaxhb.report.text.mean_torques import plain_number

SCALE = (
    "Modal torque: amplitude of the order's torques on the shape whose largest angle is 1. Every mode has a scale of"
    " its own: compare the orders of one mode, not modes."
)


def campbell_text(found, count, name, misfires=(), *, teeth=""):
    """Modes and critical speeds for people.

    Parameters
    ----------
    found : Campbell
    count : int, elastic modes that were taken
    name : str, of the scene
    misfires : dict, optional
        The :class:`Campbell` of the same speeds and orders by the cylinder that does not fire.
    teeth : str, how stiff they are; empty of a train without

    Returns
    -------
    str
    """
    low, high = found.rpm[0], found.rpm[-1]
    stiff = ", ".join(filter(None, ["undamped", teeth]))
    head = f"{name}: Campbell diagram from {low:g} to {high:g} rpm, {stiff}"
    return "\n\n".join([head, *campbell_parts(found, count, misfires)])


def campbell_parts(found, count, misfires=()):
    """The tables of :func:`campbell_text`, and a sentence where there is none."""
    worst = [_worst_sentence(found, misfires)] if found.critical and misfires else []
    return [_modes(found, count), *_left_out(found, count), _critical(found, misfires), *worst]


def reached(found):
    """How many of the modes that strain links have a frequency that an order reaches within the speeds."""
    top = max(found.orders, default=0.0) * float(found.rpm[-1]) / 60
    return sum(float(found.frequencies_hz[:, k].min()) <= top for k in found.elastic(len(found.kinds)))


def _left_out(found, count):
    """A sentence on modes that are not told, in a list."""
    shown, every, crossed = len(found.elastic(count)), len(found.elastic(len(found.kinds))), reached(found)
    if shown == every:
        return []
    highest, rpm = max(found.orders, default=0.0), float(found.rpm[-1])
    top = f"order {highest:g} at {rpm:g} rpm is {highest * rpm / 60:.4g} Hz"
    first = f"These are the {shown} lowest of {every} modes that strain links"
    if crossed <= shown:
        return [f"{first}. The orders reach {crossed} of them, all shown: {top}."]
    return [
        f"{first}; the orders reach {crossed} of them ({top}). jaxhb campbell SCENE --rpm"
        f" {found.rpm[0]:g}:{rpm:g} --modes {crossed} lists all."
    ]


def shares_in_mode(critical, torques):
    """Modal torques over the largest of the same mode, as those of different modes do not compare.

    Parameters
    ----------
    critical : sequence of Critical
    torques : sequence of float, their modal torques, N m
    """
    largest = {}
    for one, torque in zip(critical, torques, strict=True):
        largest[one.mode] = max(torque, largest.get(one.mode, 0.0))
    return [torque / (largest[one.mode] or 1.0) for one, torque in zip(critical, torques, strict=True)]


def shown_modes(found, count):
    """Numbers of the modes that are told: the elastic ones taken and all below that are rigid or of rings only."""
    elastic = found.elastic(count)
    last = elastic[-1] if elastic else len(found.kinds) - 1
    return list(range(last + 1))


def _modes(found, count):
    shown = shown_modes(found, count)
    hz = found.frequencies_hz[:, shown]
    kinds = [found.kinds[k] for k in shown]
    if (hz == hz[0]).all():
        heads, columns = ["mode", "Hz"], [[f"{value:.2f}" for value in hz[0]]]
    else:
        heads = ["mode", f"Hz at {found.rpm[0]:g} rpm", f"at {found.rpm[-1]:g} rpm"]
        columns = [[f"{value:.2f}" for value in hz[i]] for i in (0, -1)]
    title = "Natural frequencies; rigid modes and those of rings only have no critical speeds"
    return Table(title, [*heads, "kind"], [shown, *columns, kinds], left=(len(heads),))


def _worst(misfires, place):
    """The cylinder whose misfire has the largest modal torque at a critical speed, and this torque."""
    torques = {cylinder: one.critical[place].torque for cylinder, one in misfires.items()}
    cylinder = max(torques, key=torques.get)
    return cylinder, torques[cylinder]


def _worst_sentence(found, misfires):
    """The misfire with the largest modal torque of all."""
    rows = [(*_worst(misfires, place), c) for place, c in enumerate(found.critical)]
    cylinder, torque, at = max(rows, key=lambda row: row[1])
    where = f"order {at.order:g} at {at.rpm:.1f} rpm, mode {at.mode}"
    return f"The worst misfire is that of {cylinder}: {torque:.4g} N m of {where}, {at.torque:.4g} N m without it."


def _critical(found, misfires):
    orders = ", ".join(f"{order:g}" for order in found.orders) or "none"
    if not found.critical:
        return f"No critical speed lies in the range. Orders: {orders}."
    title = f"Critical speeds, order x rpm / 60 = Hz. {SCALE}\nOrders: {orders}."
    columns = [
        [f"{c.rpm:.1f}" for c in found.critical],
        [f"{c.order:g}" for c in found.critical],
        [c.mode for c in found.critical],
        [f"{c.hz:.2f}" for c in found.critical],
        [plain_number(c.torque) for c in found.critical],
    ]
    heads = ["rpm", "order", "mode", "Hz", "modal torque N m"]
    if not misfires:
        return Table(title, heads, columns)
    worst = [_worst(misfires, place) for place in range(len(found.critical))]
    columns += [[plain_number(torque) for _, torque in worst], [cylinder for cylinder, _ in worst]]
    heads += ["worst misfire N m", "that of"]
    return Table(title, heads, columns, left=(6,))


def campbell_record(found, count, name, misfires=()):
    """What ``campbell --json`` writes.

    Parameters
    ----------
    found : Campbell
    count : int, elastic modes that were taken
    name : str, of the scene
    misfires : dict, as for :func:`campbell_text`

    Returns
    -------
    dict
        ``scene``, ``rpm``, ``orders``; ``modes``: ``mode`` (its number), ``kind`` and ``frequencies_hz`` over the
        speeds; ``critical_speeds``: ``rpm``, ``order``, ``mode``, ``hz``, ``modal_torque`` in N m, by rising speed, and
        with ``misfires`` by cylinder the modal torque when it does not fire; ``worst_misfire`` then names the
        ``cylinder`` with the largest of these, with the critical speed it belongs to.
    """
    speeds = [
        {"rpm": c.rpm, "order": c.order, "mode": c.mode, "hz": c.hz, "modal_torque": c.torque}
        | ({"misfires": {name: one.critical[k].torque for name, one in misfires.items()}} if misfires else {})
        for k, c in enumerate(found.critical)
    ]
    return {
        "scene": name,
        "rpm": found.rpm.tolist(),
        "orders": found.orders.tolist(),
        "modes": [
            {"mode": k, "kind": found.kinds[k], "frequencies_hz": found.frequencies_hz[:, k].tolist()}
            for k in shown_modes(found, count)
        ],
        "critical_speeds": speeds,
    } | _worst_record(speeds, misfires)


def _worst_record(speeds, misfires):
    """The largest modal torque of all critical speeds and misfires."""
    if not misfires:
        return {}
    rows = [(torque, cylinder, at) for at in speeds for cylinder, torque in at["misfires"].items()]
    if not rows:
        return {"worst_misfire": None}
    torque, cylinder, at = max(rows, key=lambda row: row[0])
    named = {name: at[name] for name in ("rpm", "order", "mode", "hz")}
    return {"worst_misfire": {"cylinder": cylinder} | named | {"modal_torque": torque, "firing": at["modal_torque"]}}


def campbell_rows(found, misfires=()):
    """Heads and rows of ``campbell --csv``: one row per critical speed; modal torques with misfires come last."""
    heads = ["rpm", "order", "mode", "Hz", "modal torque N m"]
    heads += [f"modal torque N m, {cylinder}{NOT_FIRING}" for cylinder in misfires]
    own = [[one.critical[k].torque for one in dict(misfires).values()] for k in range(len(found.critical))]
    return heads, [[*dataclasses.astuple(c), *more] for c, more in zip(found.critical, own, strict=True)]

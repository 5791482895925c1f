"""The Campbell diagram as text, as plain numbers and as rows."""

import dataclasses

from .columns import aligned, alike


def campbell_text(found, count, name):
    """Modes and critical speeds for people.

    Parameters
    ----------
    found : Campbell
    count : int, elastic modes that were taken
    name : str, of the scene

    Returns
    -------
    str
    """
    low, high = found.rpm[0], found.rpm[-1]
    head = f"{name}: Campbell diagram from {low:g} to {high:g} rpm, undamped, teeth in contact"
    return "\n\n".join([head, _modes(found, count), _critical(found)])


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
    return title + "\n" + aligned([*heads, "kind"], [shown, *columns, kinds], left=(len(heads),))


def _critical(found):
    orders = ", ".join(f"{order:g}" for order in found.orders) or "none"
    if not found.critical:
        return f"No critical speed lies in the range. Orders: {orders}."
    title = (
        "Critical speeds, order x rpm / 60 = Hz. Modal torque: amplitude of the order's torques on the shape whose"
        f" largest angle is 1.\nOrders: {orders}."
    )
    columns = [
        [f"{c.rpm:.1f}" for c in found.critical],
        [f"{c.order:g}" for c in found.critical],
        [c.mode for c in found.critical],
        [f"{c.hz:.2f}" for c in found.critical],
        *alike([c.torque for c in found.critical]),
    ]
    return title + "\n" + aligned(["rpm", "order", "mode", "Hz", "modal torque N m"], columns)


def campbell_record(found, count, name):
    """What ``campbell --json`` writes.

    Parameters
    ----------
    found : Campbell
    count : int, elastic modes that were taken
    name : str, of the scene

    Returns
    -------
    dict
        ``scene``, ``rpm``, ``orders``; ``modes``: ``mode`` (its number), ``kind`` and ``frequencies_hz`` over the
        speeds; ``critical_speeds``: ``rpm``, ``order``, ``mode``, ``hz``, ``modal_torque`` in N m, by rising speed.
    """
    return {
        "scene": name,
        "rpm": found.rpm.tolist(),
        "orders": found.orders.tolist(),
        "modes": [
            {"mode": k, "kind": found.kinds[k], "frequencies_hz": found.frequencies_hz[:, k].tolist()}
            for k in shown_modes(found, count)
        ],
        "critical_speeds": [
            {"rpm": c.rpm, "order": c.order, "mode": c.mode, "hz": c.hz, "modal_torque": c.torque}
            for c in found.critical
        ],
    }


def campbell_rows(found):
    """Heads and rows of ``campbell --csv``: one row per critical speed."""
    return ["rpm", "order", "mode", "Hz", "modal torque N m"], [dataclasses.astuple(c) for c in found.critical]

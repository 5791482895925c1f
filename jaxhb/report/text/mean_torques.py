"""Mean torques: what the loads and the grounds take, and what fixes the mean angles."""

import numpy as np

from jaxhb.excitation.torques import excitation
from jaxhb.report.text.columns import plain_number
from jaxhb.train.plausible import compressors

NOTED_SHARE = 0.01
ROUNDING = 1e-9


def mean_angles_of(topology):
    """What the absolute mean angles are measured from, as a sentence without its full
    stop.
    """
    names = ", ".join(repr(name) for name in topology.ground_names)
    if not names:
        return "no ground: the inertia-weighted mean is zero"
    return (
        f"set by the {'grounds' if len(topology.ground_names) > 1 else 'ground'}"
        f" {names}"
    )


def torques_of(response, kind):
    """Mean torque by name, N m: of every "load" on its disk, negative where it takes
    power; that every "ground" takes from its disk.
    """
    values = response.load_torque if kind == "load" else response.ground_reaction
    return dict(
        zip(
            getattr(response.topology, f"{kind}_names"),
            np.asarray(values, float).tolist(),
            strict=True,
        )
    )


def _rounding(response):
    """What a balanced train leaves to its ground at most, N m: given torques that
    cancel do so up to rounding.
    """
    return ROUNDING * float(
        np.abs(np.asarray(response.train.torques.mean)).max(initial=0.0)
    )


def balance_line(response):
    """What the loads and the grounds take, and the power of the loads; "" without
    either.
    """
    loads = torques_of(response, "load")
    grounds = torques_of(response, "ground")
    # What balances leaves rounding, which would read as a torque.
    least = max(
        _rounding(response),
        ROUNDING * max(map(abs, [*loads.values(), *grounds.values()]), default=0.0),
    )

    def taken(torques, sign):
        told = {
            name: plain_number(sign * torque) if abs(torque) > least else 0
            for name, torque in torques.items()
        }
        return ", ".join(f"{name} takes {torque} N m" for name, torque in told.items())

    parts = []
    if loads:
        parts.append(
            f"load: {taken(loads, -1)}, {plain_number(float(response.load_kW) + 0.0)}"
            " kW in all"
        )
    if grounds:
        parts.append(f"ground: {taken(grounds, 1)}")
    return "; ".join(parts)


def speed_of(told, number):
    """`` at 1800 rpm``, of one of several responses or answers."""
    one = told[number]
    return (
        f" at {one.at if hasattr(one, 'at') else f'{float(one.rpm):g} rpm'}"
        if len(told) > 1
        else ""
    )


def _noted(responses, read):
    """The largest of the torques that are above 1 % of the largest mean torque, with
    its speed; "" without any.
    """
    torques = list(map(read, responses))
    rounding = _rounding(responses[0])

    def above(torque, response):
        on_disks = np.abs(
            np.asarray(excitation(response.train, float(response.rpm), 0)[0])[:, 0].real
        )
        return torque > NOTED_SHARE * max(
            on_disks.max(initial=0.0), np.abs(response.load_torque).max(initial=0.0)
        )

    # Most trains need no look at what acts on their disks.
    places = [
        i
        for i, torque in enumerate(torques)
        if torque > rounding and above(torque, responses[i])
    ]
    worst = max(places, key=torques.__getitem__, default=None)
    return (
        ""
        if worst is None
        else f"{plain_number(torques[worst])} N m{speed_of(responses, worst)}"
    )


def torque_notes(responses):
    """A sentence per ground that takes much, and per load that drives though others
    should, at its worst speed.
    """
    topology = responses[0].topology
    found = []
    for name in topology.ground_names:
        if said := _noted(
            responses, lambda one, name=name: abs(torques_of(one, "ground")[name])
        ):
            share = f"more than {100 * NOTED_SHARE:g} % of the largest mean torque"
            found.append(
                f"The ground {name!r} takes {said}, {share}: is a [[load]] missing?"
            )
    train = responses[0].train
    fires = np.flatnonzero(topology.cylinder_fires).tolist()
    driven = (
        not compressors(train).issuperset(fires)
        or (np.asarray(train.torques.mean) > 0).any()
    )
    for name in topology.load_names if driven else ():  # else the load is the motor
        if said := _noted(
            responses, lambda one, name=name: torques_of(one, "load")[name]
        ):
            found.append(
                f"[[load]] {name!r}: it drives the train with {said}, usual below 0, as"
                " a load takes power: do the other torques drive? A pressure table"
                " that is read from another firing top dead centre brakes."
            )
    return found

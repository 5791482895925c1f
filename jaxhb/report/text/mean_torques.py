"""Mean torques: what the loads and the grounds take, and what fixes the mean angles."""

from collections.abc import Mapping, Sequence

import numpy as np

from jaxhb.linear.strength import train_of
from jaxhb.report.text.columns import plain_number
from jaxhb.report.units import said
from jaxhb.results.response import Response
from jaxhb.train.checks.plausible import compressors
from jaxhb.train.excitation import excitation
from jaxhb.train.topology import Topology

NOTED_SHARE = 0.01
ROUNDING = 1e-9


def mean_angles_of(topology: Topology) -> str:
    """Say what the absolute mean angles are measured from, as a sentence without its
    full stop.
    """
    names = ", ".join(repr(name) for name in topology.ground_names)
    if not names:
        return "no ground: the inertia-weighted mean is zero"
    return (
        f"set by the {'grounds' if len(topology.ground_names) > 1 else 'ground'}"
        f" {names}"
    )


def torques_of(response: Response, kind: str) -> dict[str, float]:
    """Mean torques of one speed by name, N m: of every "load" on its disk, negative
    where it takes power; or what every "ground" takes from its disk.
    """
    values = response.load_torque if kind == "load" else response.ground_reaction
    return dict(
        zip(
            response.topology.names_of(kind),
            np.asarray(values, float).tolist(),
            strict=True,
        )
    )


def _rounding(response: Response) -> float:
    """Largest torque that a balanced train leaves to its ground, N m: torques of the
    scene that cancel do so up to rounding.
    """
    return ROUNDING * float(
        np.abs(np.asarray(train_of(response).torques.mean)).max(initial=0.0)
    )


def balance_line(response: Response) -> str:
    """Mean torques that the loads and the grounds take, and the power of the loads; ""
    without either.
    """
    loads = torques_of(response, "load")
    grounds = torques_of(response, "ground")
    # What balances leaves rounding, which would read as a torque.
    least = max(
        _rounding(response),
        ROUNDING * max(map(abs, [*loads.values(), *grounds.values()]), default=0.0),
    )

    def torques_text(torques: Mapping[str, float], sign: int) -> str:
        return ", ".join(
            f"{name} takes {said(sign * torque if abs(torque) > least else 0.0, 'N m')}"
            for name, torque in torques.items()
        )

    power = plain_number(float(response.load_kW) + 0.0)
    parts = [f"load: {torques_text(loads, -1)}, {power} kW in all"] * bool(loads)
    parts += [f"ground: {torques_text(grounds, 1)}"] * bool(grounds)
    return "; ".join(parts)


def speed_of(motions: Sequence, number: int) -> str:
    """`` at 1800 rpm``, of one of several responses or answers; "" where there is but
    one.
    """
    if len(motions) <= 1:
        return ""
    motion = motions[number]
    return f" at {motion.at if hasattr(motion, 'at') else f'{float(motion.rpm):g} rpm'}"


def _noted(responses: Sequence[Response], torques: Sequence[float]) -> str:
    """The largest of the torques of some responses, N m, that are above 1 % of the
    largest mean torque, with its speed; "" without any.
    """
    rounding = _rounding(responses[0])

    def above(torque: float, response: Response) -> bool:
        torque_on_disks, *_ = excitation(
            train_of(response), float(response.rpm), 0, beside_lines=True
        )
        on_disks = np.abs(np.asarray(torque_on_disks)[:, 0].real)
        return torque > NOTED_SHARE * max(
            on_disks.max(initial=0.0), np.abs(response.load_torque).max(initial=0.0)
        )

    # Most trains need no look at what acts on their disks.
    places = [
        i
        for i, torque in enumerate(torques)
        if torque > rounding and above(torque, responses[i])
    ]
    if not places:
        return ""
    worst = max(places, key=torques.__getitem__)
    return f"{said(torques[worst], 'N m')}{speed_of(responses, worst)}"


def torque_notes(responses: Sequence[Response]) -> list[str]:
    """A sentence for each ground that takes much, and for each load that drives though
    other torques should, at its worst speed.
    """
    topology = responses[0].topology
    sentences = []
    for name in topology.ground_names:
        reactions = [
            abs(torques_of(response, "ground")[name]) for response in responses
        ]
        torque = _noted(responses, reactions)
        if torque:
            share = f"more than {100 * NOTED_SHARE:g} % of the largest mean torque"
            sentences.append(
                f"The ground {name!r} takes {torque}, {share}: is a [[load]] missing?"
            )
    train = train_of(responses[0])
    fires = np.flatnonzero(topology.cylinders.fires).tolist()
    driven = (
        not compressors(train).issuperset(fires)
        or (np.asarray(train.torques.mean) > 0).any()
    )
    for name in topology.load_names if driven else ():  # else the load is the motor
        drives = [torques_of(response, "load")[name] for response in responses]
        torque = _noted(responses, drives)
        if torque:
            sentences.append(
                f"[[load]] {name!r}: it drives the train with {torque}, usually below"
                " 0, as a load takes power: do the other torques drive? A pressure"
                " table that is read from another firing top dead centre brakes."
            )
    return sentences

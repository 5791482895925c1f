"""Mean torques: what the loads and the grounds take, and what fixes the mean angles."""

import numpy as np

from jaxhb.excitation.torques import excitation
from jaxhb.report.text.columns import plain_number

NOTED_SHARE = 0.01
ROUNDING = 1e-9


def mean_angles_of(topology):
    """What the absolute mean angles are measured from, as a sentence without its full stop."""
    names = ", ".join(repr(name) for name in topology.ground_names)
    if not names:
        return "no ground: the inertia-weighted mean is zero"
    return f"set by the {'grounds' if len(topology.ground_names) > 1 else 'ground'} {names}"


def load_torques(response):
    """Mean torque of every load on its disk by name, N m: negative where it takes power."""
    return dict(zip(response.topology.load_names, np.asarray(response.load_torque, float).tolist(), strict=True))


def ground_reactions(response):
    """Mean torque that every ground takes from its disk by name, N m."""
    return dict(zip(response.topology.ground_names, np.asarray(response.ground_reaction, float).tolist(), strict=True))


def _largest_mean_torque(response):
    """Largest mean torque that acts on a disk of the train, loads among them, N m."""
    on_disks = np.abs(np.asarray(excitation(response.train, float(response.rpm), 0)[0])[:, 0].real)
    return float(max(on_disks.max(initial=0.0), np.abs(np.asarray(response.load_torque)).max(initial=0.0)))


def _rounding(response):
    """What a balanced train leaves to its ground at most, N m: given torques that cancel do so up to rounding."""
    return ROUNDING * float(np.abs(np.asarray(response.train.torques.mean)).max(initial=0.0))


def balance_line(response):
    """What the loads and the grounds take, and the power of the loads; "" without either."""
    loads, grounds = load_torques(response), ground_reactions(response)
    # What balances leaves rounding, which would read as a torque.
    least = max(_rounding(response), ROUNDING * max(map(abs, [*loads.values(), *grounds.values()]), default=0.0))

    def taken(torques, sign):
        told = {name: plain_number(sign * torque) if abs(torque) > least else 0 for name, torque in torques.items()}
        return ", ".join(f"{name} takes {torque} N m" for name, torque in told.items())

    parts = []
    if loads:
        parts.append(f"load: {taken(loads, -1)}, {plain_number(float(response.load_kW) + 0.0)} kW in all")
    if grounds:
        parts.append(f"ground: {taken(grounds, 1)}")
    return "; ".join(parts)


def ground_notes(responses, speed_of):
    """A sentence per ground that takes more than 1 % of the largest mean torque, at the speed of the largest."""
    found, rounding = [], _rounding(responses[0])
    for name in responses[0].topology.ground_names:
        reactions = np.abs([ground_reactions(response)[name] for response in responses])
        suspects = np.flatnonzero(reactions > rounding)  # most trains need no further look
        wrong = [i for i in suspects if reactions[i] > NOTED_SHARE * _largest_mean_torque(responses[i])]
        if wrong:
            worst = max(wrong, key=lambda i: reactions[i])
            found.append(
                f"The ground {name!r} takes {plain_number(reactions[worst])} N m{speed_of(responses, worst)}, more "
                f"than {100 * NOTED_SHARE:g} % of the largest mean torque: is a [[load]] missing?"
            )
    return found


def load_notes(responses, speed_of):
    """A sentence per load that drives the train though other torques should, at the speed at which it drives most."""
    topology, given = responses[0].topology, np.asarray(responses[0].train.torques.mean)
    if not any(topology.cylinder_fires) and not (given > 0).any():
        return []  # then the load is the motor
    found = []
    for name in topology.load_names:
        driving = np.array([load_torques(response)[name] for response in responses])
        most = int(np.argmax(driving))
        if driving[most] > NOTED_SHARE * _largest_mean_torque(responses[most]):
            found.append(
                f"[[load]] {name!r}: it drives the train with {plain_number(driving[most])} N m"
                f"{speed_of(responses, most)}, usual below 0, as a load takes power: do the other torques drive? "
                "A pressure table that is read from another firing top dead centre brakes."
            )
    return found

"""What a response says: one plain dictionary for programs, and the sentences an engineer reads first."""

import numpy as np

from ..response.events import Homotopy, Shooting
from ..response.status import Status
from .balance import balance_record, ground_notes, plain_number

GAP_SPRING_SHARE = 0.05
KNEE_SHARE = 0.5
NEGLIGIBLE = 1e-12


def response_record(response, *, orders=None):
    """Everything that is reported of one response, as plain numbers in SI units; ``solve --json`` writes it.

    Parameters
    ----------
    response : Response
        At one speed.
    orders : float, optional
        Highest order whose amplitude is listed; default: all.

    Returns
    -------
    dict
        ``rpm``, ``converged``, ``status``, ``harmonics``, ``residual``, ``truncation_error``, ``path``, ``load_kW``;
        ``load_torque_Nm`` and ``ground_reaction_Nm`` by name, ``mean_angles`` (what sets the means of the disks);
        ``disks`` (rad), ``shafts`` with the dampers (N m), ``gears`` (N m) and ``meshes`` (N) by name, each a signal
        ``{"mean", "min", "max", "rms", "half_peak_to_peak", "sum_of_amplitudes", "amplitudes"}`` with amplitudes
        ``[[order, A, phase in deg], ...]`` from the first harmonic of the cycle on (disks without min, max and rms).
        The list ends where all amplitudes that follow are below 1e-12 of the largest. Tooth forces have eight times
        the harmonics of the motion. Numbers that are not finite are None.

    Examples
    --------
    >>> import jaxhb
    >>> record = response_record(jaxhb.solve(jaxhb.load_scene("six_cylinder_diesel"), rpm=1500.0))
    >>> record["status"], round(record["shafts"]["cyl6|flywheel"]["mean"], 1)
    ('CONVERGED', 1046.8)
    """
    topology = response.topology
    names = {"shafts": shafts_of(topology), "gears": gears(response)}
    read = {"shafts": response.torque, "gears": response.gear_torque}
    return finite(
        _outcome_record(response)
        | balance_record(response)
        | {"disks": {name: _disk_record(response.disk(name), orders) for name in topology.disk_names}}
        | {kind: {name: _signal_record(read[kind](name), orders) for name in names[kind]} for kind in names}
        | {"meshes": {name: _mesh_record(response, name, orders) for name in topology.mesh_names}}
    )


def _outcome_record(response):
    return {
        "scene": response.topology.name,
        "rpm": float(response.rpm),
        "converged": bool(response.converged),
        "status": status_of(response).name,
        "harmonics": int(response.harmonics),
        "residual": float(response.residual),
        "truncation_error": float(response.truncation_error),
        "path": [str(event) for event in response.path],
        "load_kW": float(response.load_kW) + 0.0,
        "verdict": verdict(response),
        "notes": notes(response),
    }


def modes_record(modes):
    """What ``modes --json`` writes: every value is a list over the modes.

    ``{"frequencies_hz": [...], "mesh_energy_share": [...], "modes": {disk: [angle in mode 0, ...]}}``; the share of the
    strain energy that lies in the teeth is between 0 and 1.
    """
    shapes = zip(modes.names, np.asarray(modes.shapes).T.tolist(), strict=True)
    numbers = {name: np.asarray(getattr(modes, name)).tolist() for name in ("frequencies_hz", "mesh_energy_share")}
    return finite(numbers | {"modes": dict(shapes)})


def finite(value):
    """The same nest of dictionaries and lists with None for every number that is not finite (JSON has no nan)."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def _signal_record(signal, orders):
    return signal.summary() | {"amplitudes": _amplitudes(signal, orders)}


def _disk_record(signal, orders):
    return {
        "mean": float(signal.mean),
        "half_peak_to_peak": float(signal.half_peak_to_peak),
        "amplitudes": _amplitudes(signal, orders),
    }


def _amplitudes(signal, orders):
    """Rows up to the last that is not negligible; order k of the cycle stays at place k - 1."""
    rows = signal.spectrum()
    sizes = np.array([row[1] for row in rows])
    counted = ~(sizes <= NEGLIGIBLE * sizes.max(initial=0.0))
    if orders is not None:
        counted &= np.array([row[0] for row in rows]) <= orders
    last = np.flatnonzero(counted)
    return rows[: last[-1] + 1] if len(last) else []


def _mesh_record(response, name, orders):
    force, contact = response.force(name), contact_at(response, name)
    cycle = 360.0 * response.topology.revolutions_per_cycle
    record = _signal_record(force, orders) | {"elastic": _signal_record(force.elastic, orders)}
    if contact is None:
        keys = ("separated_fraction", "reverse_contact_fraction", "impacts", "drive_side")
        return record | dict.fromkeys((*keys, "gap_spring_force", "knee_force", "pulling_force"))
    return record | {
        "separated_fraction": contact.separated_fraction,
        "reverse_contact_fraction": contact.reverse_contact_fraction,
        "impacts": [
            {"theta_deg": cycle * hit["cycle"], "speed": hit["speed"], "side": hit["side"]} for hit in contact.impacts
        ],
        "drive_side": contact.drive_side,
        "gap_spring_force": contact.gap_spring_force,
        "knee_force": contact.knee_force,
        "pulling_force": contact.pulling_force,
    }


def gears(response):
    """Names of the disks that carry a mesh, in the order of the meshes."""
    topology = response.topology
    return tuple(dict.fromkeys(topology.disk_names[disk] for ends in topology.mesh_ends for disk in ends))


def meshes_of(response, gear):
    """Names of the meshes of a gear."""
    topology = response.topology
    disk = topology.disk_index(gear)
    return tuple(name for name, ends in zip(topology.mesh_names, topology.mesh_ends, strict=True) if disk in ends)


def hardest_gear(response):
    """The gear whose torque has the largest half peak-to-peak; None where no gear meshes."""
    return max(gears(response), key=lambda name: float(response.gear_torque(name).half_peak_to_peak), default=None)


def shafts_of(topology):
    """Names of the links that transmit a torque: shafts, then dampers."""
    return topology.shaft_names + topology.damper_names


def hardest_shaft(response):
    """The shaft or damper whose torque has the largest half peak-to-peak (of a sweep: at any speed); None without."""
    names = shafts_of(response.topology)
    return max(names, key=lambda name: float(np.max(response.torque(name).half_peak_to_peak)), default=None)


def status_of(response):
    """The :class:`jaxhb.Status` of one response."""
    return Status(int(response.status))


def contact_at(response, mesh):
    """The :class:`Contact` of a mesh; None where its motion is not finite."""
    index, _ = response.topology.link_index(mesh)
    index -= len(response.topology.link_names) - len(response.topology.mesh_names)
    if not (np.isfinite(response.deflections[index]).all() and np.isfinite(response.forces[index]).all()):
        return None
    return response.mesh(mesh)


def contacts_of(response):
    """:class:`Contact` of every mesh by name, None where the motion is not finite."""
    return {name: contact_at(response, name) for name in response.topology.mesh_names}


def hardest_impact(contact):
    """Largest approach speed of an impact in m/s, 0 without impacts."""
    return max((hit["speed"] for hit in contact.impacts), default=0.0)


def status_line(response):
    """How the solve went: status with what to try, harmonics, residual, truncation error."""
    status = status_of(response)
    said = "converged" if response.converged else f"NOT CONVERGED, {status.name}: {status.sentence}"
    line = f"{said}; {int(response.harmonics)} harmonics of the cycle"
    if not float(response.residual) and not float(response.truncation_error):
        return f"{line}, linear" + (": every mesh keeps its flank" if any(response.topology.mesh_backlash) else "")
    return (
        f"{line}, residual {float(response.residual):.1e}, "
        f"truncation error {_percent(float(response.truncation_error))} of the largest tooth force"
    )


def verdict(response):
    """The answer in one sentence: do the teeth hammer at this speed?

    Parameters
    ----------
    response : Response
        At one speed.

    Returns
    -------
    str
        Names the mesh that is apart for the largest share of the cycle.

    Examples
    --------
    >>> import jaxhb
    >>> verdict(jaxhb.solve(jaxhb.load_scene("six_cylinder_diesel"), rpm=1500.0))
    'No teeth mesh in this train.'
    """
    topology, speed = response.topology, f"{float(response.rpm):g} rpm"
    if not topology.mesh_names:
        return "No teeth mesh in this train."
    if not any(topology.mesh_backlash):
        return "No mesh has backlash: the teeth cannot separate."
    contacts = contacts_of(response)
    if None in contacts.values():
        return f"No answer at {speed}: the solution is not finite."
    doubt = "" if response.converged else "Not converged, do not rely on this: "
    name = max(contacts, key=lambda mesh: contacts[mesh].separated_fraction)
    worst = contacts[name]
    if not worst.separated_fraction:
        return doubt + f"{'a' if doubt else 'A'}ll teeth stay in contact at {speed}."
    share = f"{_percent(worst.separated_fraction)} of the cycle"
    if not worst.impacts:
        return doubt + f"{name} is apart {share} at {speed}, without an impact."
    count = len(worst.impacts)
    hits = "one impact" if count == 1 else f"{count} impacts"
    return (
        doubt + f"{'t' if doubt else 'T'}he teeth hammer at {speed}: {name} is apart {share}, "
        f"{hits} a cycle, the hardest at {hardest_impact(worst):.2f} m/s."
    )


def _percent(share):
    """Two digits, three from 99.5 % on: never ``1e+02 %``."""
    return f"{plain_number(100 * share, digits=2 if share < 0.995 else 3)} %"


def notes(*responses):
    """Sentences on grounds that take a mean torque, motions that may be unstable, and large traits of the tooth law.

    Parameters
    ----------
    *responses : Response
        Of one train, each at one speed; the notes name the speed of the smallest mean force.

    Returns
    -------
    list of str
        A ground that takes above 1 % of the largest mean torque; motions on which time integration did not settle; a
        gap spring above 5 % of the mean force, a knee above 50 % of it, damping in the gap above 5 % of it.
    """
    found, through = ground_notes(responses, _speed_of) + _unsettled_notes(responses), []
    for name in responses[0].topology.mesh_names:
        contacts = [contact_at(response, name) for response in responses]
        if None in contacts or not contacts[0].knee_force:
            continue
        means = [abs(float(response.force(name).mean)) for response in responses]
        least = int(np.argmin(means))
        found += _law_notes(name, contacts[0], means[least], _speed_of(responses, least))
        if responses[0].topology.mesh_damping_law[responses[0].topology.mesh_names.index(name)] == "contact":
            continue
        pulling = [contact.pulling_force for contact in contacts]
        hardest = int(np.argmax(pulling))
        if pulling[hardest] > GAP_SPRING_SHARE * means[hardest]:
            through.append(f"{_kN(pulling[hardest])}{_speed_of(responses, hardest)} in {name}")
    if through:
        found.append(
            'Damping law "always" transmits force while the teeth are apart ("contact" does not): up to '
            f"{', '.join(through)}."
        )
    return found


def _unsettled_notes(responses):
    """Of converged motions that a march of a few cycles did not settle on."""
    found = [
        f"{float(r.rpm):g}"
        for r in responses
        if r.converged and any(isinstance(event, Shooting | Homotopy) for event in r.path)
    ]
    if not found:
        return []
    speeds = f"{', '.join(found[:6])}{f' and {len(found) - 6} more' if len(found) > 6 else ''} rpm"
    return [
        f"A periodic motion was found at {speeds}, but a few cycles of time integration do not settle there: it may be "
        "unstable, and the engine may run in another motion (jaxhb.integrate shows it)."
    ]


def _speed_of(responses, number):
    return f" at {float(responses[number].rpm):g} rpm" if len(responses) > 1 else ""


def _law_notes(name, contact, mean, speed):
    said = f"the mean tooth force of {_kN(mean)}{speed}"
    found = []
    if contact.gap_spring_force > GAP_SPRING_SHARE * mean:
        found.append(
            f"{name}: the spring in the gap carries up to {_kN(contact.gap_spring_force)}, more than "
            f"{100 * GAP_SPRING_SHARE:g} % of {said}: lower epsilon."
        )
    if contact.knee_force > KNEE_SHARE * mean:
        found.append(
            f"{name}: the teeth are stiff only above {_kN(contact.knee_force)}, more than {100 * KNEE_SHARE:g} % of "
            f"{said}: a smaller transition makes contact sharper."
        )
    return found


def _kN(force):
    return f"{force / 1e3:.3g} kN"

"""Answers for programs, see ``docs/how_to/data_and_files.md``: records of JSON files,
rows of CSV files, a motion over its cycle as a table of time traces, and labelled
arrays of NetCDF files.
"""

import numpy as np

from jaxhb.equations import fourier
from jaxhb.excitation.torques import listed_harmonic
from jaxhb.report.answer import UNCONFIRMED
from jaxhb.report.files.output import as_csv
from jaxhb.report.quantities import WITHOUT, number
from jaxhb.report.text.certified import certificate_record
from jaxhb.report.text.mean_torques import mean_angles_of, torques_of
from jaxhb.report.text.sentences import notes, verdict
from jaxhb.report.text.strength import (
    answers_strength,
    strength_columns,
    strength_record,
)
from jaxhb.results.dataset import CONTACT, as_netcdf, names_of, to_xarray
from jaxhb.results.record import PERCENT
from jaxhb.results.signal import MISSED
from jaxhb.train.firing import not_firing
from jaxhb.train.plausible import plausibility

NEGLIGIBLE = 1e-12
TRACED = 720  # time samples in a period of a trace, or twice, four times... as many
NO_ORDERS = 0.0  # highest order listed where amplitudes are left out


def answer_record(answer, *, orders=None):
    """All that is reported of one speed, in SI units; amplitudes up to the order
    ``orders``, by default that count.
    """

    def of_each(element, record):
        return {name: record(name) for name in names_of(answer.topology)[element]}

    def of_signal(signal):
        return _signal_record(signal, orders)

    solved = answer.response
    state = answer.state
    numbers = "residual", "truncation_error", "power_defect"
    found = {
        "scene": answer.topology.name,
        "rpm": answer.rpm,
        "motion": {
            "kind": state.kind,
            "period": state.period,
            "orbit": answer.orbit,
            "stable": answer.stable,
            "multiplier": answer.multiplier,
            "reason": "; ".join(state.notes) if not answer.known else None,
            "cycles": state.cycles,
            "started_from_rpm": state.started_from,
            "recorded_cycles": state.record.cycles if answer.recorded else None,
            "spread": of_each("mesh", lambda name: answer.force(name).spread._asdict()),
            "per_cycle": of_each(
                "mesh", lambda name: _per_cycle(answer.force(name).per_cycle)
            ),
        },
        "converged": answer.converged,
        "harmonics": answer.harmonics,
        "load_kW": float(answer.balance.load_kW) + 0.0,
        "verdict": verdict(answer),
        "notes": notes(answer),
        "status": None if solved is None else answer.status.name,
        **{
            name: None if solved is None else float(getattr(solved, name))
            for name in numbers
        },
        "path": None if solved is None else [str(event) for event in solved.path],
        "load_torque_Nm": torques_of(answer.balance, "load"),
        "ground_reaction_Nm": torques_of(answer.balance, "ground"),
        "mean_angles": mean_angles_of(answer.topology),
        "disks": of_each(
            "disk",
            lambda name: _disk_record(answer, name, of_signal(answer.disk(name))),
        ),
        "shafts": of_each(
            "shaft",
            lambda name: (
                of_signal(answer.torque(name)) | {"power_W": answer.power(name)}
            ),
        ),
        "gears": of_each("gear", lambda name: of_signal(answer.gear_torque(name))),
        "meshes": of_each("mesh", lambda name: _mesh_record(answer, name, of_signal)),
    }
    found |= strength_record(answers_strength([answer]), one_speed=True)
    return found | (
        certificate_record(answer.certificate) if answer.certificate is not None else {}
    )


def _per_cycle(distribution):
    """Of the largest tooth force of a cycle, as it is signed and by its size."""
    return {"max": distribution.max, "peak": distribution.peak}


def on_scene(*trains):
    """What is noted of the scene, once for all speeds, and what is computed of
    cylinders that do not fire in it or its misfires.
    """
    return {"scene_notes": plausibility(trains[0])} | not_firing_record(*trains)


def not_firing_record(*trains):
    """What is computed of cylinders that do not fire: sentences, none where all
    fire.
    """
    return {"not_firing": not_firing(*trains)}


def both_record(answer, orders=None):
    """The record of an answer, under ``without_backlash`` the same with all teeth in
    contact.
    """
    record = answer_record(answer, orders=orders)
    if any(answer.topology.mesh_backlash):
        record["without_backlash"] = answer_record(
            answer.without_backlash, orders=orders
        )
    return record


def cases_record(cases, *, orders=None):
    """What ``report --json`` writes: per case the records of all speeds with and
    without backlash.
    """
    rows = [
        {
            "title": case.title,
            "responses": [
                answer_record(answer, orders=orders) for answer in case.answers
            ],
            "without_backlash": [
                answer_record(answer.without_backlash, orders=orders)
                for answer in case.answers
            ],
            **strength_record(answers_strength(case.answers)),
        }
        for case in cases
    ]
    return {"rpm": [answer.rpm for answer in cases[0].answers], "cases": rows}


def _signal_record(signal, orders):
    """A signal with its rows up to the last that is not negligible; order k of the
    cycle stays at place k - 1.
    """
    summary = signal.summary()
    sizes = np.array([row[1] for row in summary["amplitudes"]])
    # Not ``>``: amplitudes that are nan are listed, as None.
    counted = ~(sizes <= NEGLIGIBLE * sizes.max(initial=0.0))
    last = np.flatnonzero(
        counted[
            : sum(orders is None or row[0] <= orders for row in summary["amplitudes"])
        ]
    )
    rows = summary["amplitudes"][: last[-1] + 1] if len(last) else []
    # A motion that does not repeat has no phases.
    return summary | {"amplitudes": [[*row, None][:3] for row in rows]}


def _disk_record(answer, name, angle):
    return {key: angle[key] for key in ("mean", "half_peak_to_peak", "amplitudes")} | {
        "speed": answer.speed(name).extremes(),
        "acceleration": answer.acceleration(name).extremes(),
        "irregularity": answer.irregularity(name),
    }


def _mesh_record(answer, name, of_signal):
    force = answer.force(name)
    law = answer.law(name)
    details = answer.details.get(name)
    impacts = details and [
        {
            "theta_deg": answer.state.period * answer.cycle_deg * one["cycle"],
            "speed": one["speed"],
            "side": one["side"],
        }
        for one in details.impacts
    ]
    return {
        **of_signal(force),
        "elastic": of_signal(force.elastic),
        **{variable: number(answer, name, variable) for variable in CONTACT},
        "impacts": impacts,
        "drive_side": answer.contacts[name].drive_side if answer.known else None,
        "gap_spring_force": law.gap_spring_force if law else 0.0,
        "knee_force": law.knee_force if law else 0.0,
        "pulling_force": details and details.pulling_force,
        "power_W": answer.power(name),
    } | _meshing_record(answer, name)


def _meshing_record(answer, name):
    """Gear whine, transmission error and rattle of a mesh with a mesh period; nothing
    of others.
    """
    topology = answer.topology
    solution = answer.response
    periods = topology.mesh_periods[topology.mesh_names.index(name)]
    if not periods or not answer.known:
        return {}
    error = (
        None
        if solution is None
        else solution.transmission_error(name).half_peak_to_peak
    )
    return {
        "mesh_order": answer.mesh_order(name),
        "mesh_order_amplitudes": answer.whine(name),
        "transmission_error_half_peak_to_peak": error,
        "impact_energy_J": None if solution is None else solution.impact_energy(name),
    }


def answer_row(answer, **first):
    """One answer as a row of a CSV file by heads, ``first`` behind the speed; no
    numbers where nothing is certain.
    """
    solved = answer.response
    about = {
        "rpm": answer.rpm,
        **first,
        "motion": answer.state.kind,
        "period cycles": answer.state.period,
        "started from rpm": answer.state.started_from,
        "stable": answer.stable,
        "largest multiplier": answer.multiplier,
        "status": None if solved is None else answer.status.name,
        "harmonics": answer.harmonics,
        "residual": None if solved is None else float(solved.residual),
        "truncation error": None if solved is None else float(solved.truncation_error),
    }
    return about | (
        _numbers(answer) if answer.answered else dict.fromkeys(_numbers(answer))
    )


CELLS = {
    "mesh": {
        "mean N": "tooth_force_mean",
        "max N": "tooth_force_max",
        "min N": "tooth_force_min",
        "peak N": "tooth_force_peak",
        **{
            f"{what} of a cycle {percent} % N": lambda answer, name, i=i, what=what: (
                float(getattr(answer.force(name).per_cycle, what)[i])
            )
            for what in ("max", "peak")
            for i, percent in enumerate(PERCENT)
        },
        "spread of max N": lambda answer, name: answer.force(name).spread.max,
        "spread of min N": lambda answer, name: answer.force(name).spread.min,
        "spread of peak N": lambda answer, name: answer.force(name).spread.peak,
        "max N without backlash": f"tooth_force_max{WITHOUT}",
        "min N without backlash": f"tooth_force_min{WITHOUT}",
        "separated fraction": "separated_fraction",
        "reverse fraction": "reverse_contact_fraction",
        "impacts per cycle": "impacts_per_cycle",
        "hardest impact m/s": "hardest_impact",
    },
    "gear": {
        "torque half peak-to-peak N m": "gear_torque_half_peak_to_peak",
        "torque half peak-to-peak N m without backlash": (
            f"gear_torque_half_peak_to_peak{WITHOUT}"
        ),
    },
    "shaft": {
        "torque half peak-to-peak N m": "torque_half_peak_to_peak",
        "heat W": "heat",
    },
    "disk": {
        "speed half peak-to-peak rad/s": "speed_half_peak_to_peak",
        "acceleration half peak-to-peak rad/s2": "acceleration_half_peak_to_peak",
        "irregularity": "irregularity",
    },
}
"""Heads of the columns of every element behind its name, and their variables of data
sets or readers.
"""


def _numbers(answer):
    row = {"load kW": float(answer.balance.load_kW)}
    for kind, what in (("load", "load torque"), ("ground", "ground reaction")):
        row |= {
            f"{name} {what} N m": torque
            for name, torque in torques_of(answer.balance, kind).items()
        }
    for element, cells in CELLS.items():
        for name in names_of(answer.topology)[element]:
            for head, read in cells.items():
                row[f"{name} {head}"] = (
                    read(answer, name) if callable(read) else number(answer, name, read)
                )
    return row | {
        head: values[0]
        for head, values in strength_columns(answers_strength([answer])).items()
    }


def untraceable(answer):
    """Why a motion has no trace; "" where it has."""
    if not answer.answered:
        return (
            "the motion is not converged" if answer.known else "the motion is not known"
        )
    if answer.unconfirmed:
        return (
            f"the motion is {UNCONFIRMED}, so there is no solution to trace (--orbit: a"
            " periodic solution)"
        )
    return (
        "the motion never repeats, so it has no period (--orbit: a periodic solution)"
        * (answer.response is None)
    )


def trace_csv(answer):
    """The motion over its period, of an answer that :func:`untraceable` has nothing to
    say about; SI units.
    """
    turns = answer.response.topology.revolutions_per_cycle
    traced = {
        f"{name} {head}": getattr(answer.state, read)(name)
        for element, head, read in TRACES
        for name in names_of(answer.topology)[element]
    }
    # At least four time samples for each harmonic of the motion, and so many that no
    # tooth force loses its peak.
    count = TRACED * max(1, -(-4 * answer.response.harmonics // TRACED))
    forces = [answer.force(name) for name in answer.topology.mesh_names]
    while any(
        np.abs(_samples(force, count)).max() < (1 - MISSED) * force.peak
        for force in forces
    ):
        count *= 2
    part = np.arange(count) / count
    columns = {
        "angle deg": 360.0 * turns * part,
        "time s": 60.0 * turns / answer.rpm * part,
    }
    columns |= {head: _samples(signal, count) for head, signal in traced.items()}
    return as_csv(list(columns), np.transpose(list(columns.values())))


def _samples(signal, count):
    return fourier.sample(np.asarray(signal.coefficients), count)


TRACES = (
    ("mesh", "tooth force N", "force"),
    ("mesh", "deflection m", "deflection"),
    ("gear", "gear torque N m", "gear_torque"),
    ("shaft", "torque N m", "torque"),
    ("disk", "angle rad", "disk"),
    ("disk", "speed rad/s", "speed"),
    ("disk", "acceleration rad/s2", "acceleration"),
)
"""Columns of a trace: element, head behind its name, and reader."""

LINEAR_TOO = (
    "torque",
    "gear_torque",
    "tooth_force",
)  # signals that are given without backlash too
DIMENSIONS = {
    "direction": "in which the sweep went",
    "case": "normal running, and with misfires",
}
"""What several lists of answers are called in a file."""


def netcdf(found, orders, *, along=None, every=False):
    """The NetCDF file of answers: lists of them by name in ``found``, of trains with
    the same elements. ``along`` is the dimension of names, None of one list; ``orders``
    the highest whose amplitudes are given, None: the highest of the excitation, or with
    ``every`` of the motions.
    """
    import xarray

    data = _labelled(
        [answer for answers in found.values() for answer in answers], orders, every
    )
    if along is None:
        return [as_netcdf(data)]
    dim = "value" if "value" in data.dims else "rpm"
    ends = np.cumsum([0, *map(len, found.values())])
    sets = [data.isel({dim: slice(*ends[i : i + 2])}) for i in range(len(found))]
    names = xarray.Variable(along, list(found), {"long_name": DIMENSIONS[along]})
    return [
        as_netcdf(xarray.concat(sets, names, join="outer", combine_attrs="override"))
    ]


def _labelled(answers, orders, every):
    topology = answers[0].topology
    axis = answers[0].axis
    if orders is None and not every:
        orders = listed_harmonic(topology) / topology.revolutions_per_cycle
    data = to_xarray(
        [answer.state for answer in answers],
        topology,
        [answer.rpm for answer in answers],
        orders=orders,
    )
    data.attrs |= {
        "motions": "periodic solutions" if answers[0].orbit else "steady states"
    }
    flags = {None: -1, False: 0, True: 1}
    about = {"long_name": "whether disturbances die away"}
    about |= {
        "flag_values": list(flags.values()),
        "flag_meanings": "not_known unstable stable",
    }
    data["stable"] = ("rpm", [flags[answer.stable] for answer in answers], about)
    about = {"units": "1", "long_name": "modulus over the period"}
    data["largest_multiplier"] = (
        "rpm",
        np.array([answer.multiplier for answer in answers], dtype=float),
        about,
    )
    if any(topology.mesh_backlash):
        linear = to_xarray(
            [answer.without_backlash.state for answer in answers],
            topology,
            data.rpm.values,
            orders=0,
        )
        names = [
            name
            for name in linear
            if str(name).startswith(tuple(f"{n}_" for n in LINEAR_TOO))
        ]
        data = data.merge(
            linear[names].rename({name: f"{name}{WITHOUT}" for name in names})
        )
    if answers[0].value is not None:
        data = data.rename(rpm="value").assign_coords(
            value=[answer.place for answer in answers]
        )
        data.value.attrs |= {"units": axis.unit, "long_name": axis.name}
        data.attrs |= {"rpm": answers[0].rpm}
    return data

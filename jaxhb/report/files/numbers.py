"""Answers for programs, see ``docs/how_to/data_and_files.md``: records of JSON files,
rows of CSV files, a motion over its cycle as a table of time traces, and labelled
arrays of NetCDF files.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb.equations import fourier
from jaxhb.report.answer import UNCONFIRMED, Answer, Case
from jaxhb.report.files.output import Sheet
from jaxhb.report.text.certified import certificate_record
from jaxhb.report.text.mean_torques import mean_angles_of, torques_of
from jaxhb.report.text.sentences import notes, verdict
from jaxhb.report.text.strength import (
    answers_strength,
    strength_columns,
    strength_record,
)
from jaxhb.results.bounds import Certificate
from jaxhb.results.dataset import to_xarray
from jaxhb.results.quantities import (
    VARIABLES,
    VIBRATIONS,
    WITHOUT,
    WORKED,
    names_of,
    read,
    variables_of,
)
from jaxhb.results.record import RecordedSignal
from jaxhb.results.signal import MISSED, Signal
from jaxhb.train.checks.plausible import plausibility
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import listed_harmonic
from jaxhb.train.omission import not_firing

if TYPE_CHECKING:
    from jaxhb.results.dataset import Dataset

NEGLIGIBLE = 1e-12  # amplitude over the largest of its signal that is not listed
TRACED = 720  # time samples in a period of a trace, or twice, four times... as many
NO_ORDERS = 0.0  # highest order listed where amplitudes are left out


def answer_record(answer: Answer, *, orders: float | None = None) -> dict[str, Any]:
    """Report all of one speed, in SI units; amplitudes up to the order ``orders``, by
    default all that are not negligible.
    """

    def of_each(element: str, record: Callable[[str], Any]) -> dict[str, Any]:
        return {name: record(name) for name in names_of(answer.topology)[element]}

    of_signal = partial(_signal_record, orders=orders)
    response = answer.response
    state = answer.state
    recorded = state.record if answer.recorded else None
    record = {
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
            "recorded_cycles": None if recorded is None else recorded.cycles,
            "spread": of_each("mesh", lambda name: answer.force(name).spread._asdict()),
            "per_cycle": of_each(
                "mesh",
                lambda name: {
                    extreme: getattr(answer.force(name).per_cycle, extreme)
                    for extreme in ("max", "peak")
                },
            ),
        },
        "converged": answer.converged,
        "harmonics": answer.harmonics,
        "load_kW": float(answer.balance.load_kW) + 0.0,
        "verdict": verdict(answer),
        "notes": notes(answer),
        "status": None if answer.status is None else answer.status.name,
        "residual": None if response is None else float(response.residual),
        "truncation_error": (
            None if response is None else float(response.truncation_error)
        ),
        "power_defect": None if response is None else float(response.power_defect),
        "path": None if response is None else [str(event) for event in response.path],
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
                of_signal(answer.torque(name)) | _plain_numbers(answer, name, "shaft")
            ),
        ),
        "gears": of_each(
            "gear",
            lambda name: (
                of_signal(answer.gear_torque(name))
                | _plain_numbers(answer, name, "gear")
            ),
        ),
        "meshes": of_each("mesh", lambda name: _mesh_record(answer, name, of_signal)),
    }
    record |= strength_record(answers_strength([answer]), one_speed=True)
    if isinstance(answer.certificate, Certificate | str):
        record |= certificate_record(answer.certificate)
    return record


def on_scene(*trains: DriveTrain) -> dict[str, Any]:
    """Record the notes on the scene, once for all speeds, and what is computed of
    cylinders that do not fire in it or its misfires.
    """
    return {"scene_notes": plausibility(trains[0])} | not_firing_record(*trains)


def not_firing_record(*trains: DriveTrain) -> dict[str, list[str]]:
    """Record what is computed of cylinders that do not fire: sentences, none where all
    fire.
    """
    return {"not_firing": not_firing(*trains)}


def both_record(answer: Answer, orders: float | None = None) -> dict[str, Any]:
    """The record of an answer, under ``without_backlash`` the same with all teeth in
    contact.
    """
    record = answer_record(answer, orders=orders)
    if any(answer.topology.mesh_backlash):
        record["without_backlash"] = answer_record(
            answer.without_backlash, orders=orders
        )
    return record


def cases_record(
    cases: Sequence[Case], *, orders: float | None = None
) -> dict[str, Any]:
    """The record of ``report --json``: per case the records of all speeds with and
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
        }
        | strength_record(answers_strength(case.answers))
        for case in cases
    ]
    return {"rpm": [answer.rpm for answer in cases[0].answers], "cases": rows}


def _signal_record(
    signal: Signal | RecordedSignal, orders: float | None
) -> dict[str, Any]:
    """A signal with its rows up to the last that is not negligible; order k of the
    cycle stays at place k - 1.
    """
    summary = signal.summary()
    spectrum = summary["amplitudes"]
    sizes = np.array([row[1] for row in spectrum])
    # Not ``>``: amplitudes that are nan are listed, as None.
    counted = ~(sizes <= NEGLIGIBLE * sizes.max(initial=0.0))
    within = sum(orders is None or row[0] <= orders for row in spectrum)
    places = np.flatnonzero(counted[:within])
    rows = spectrum[: places[-1] + 1] if len(places) else []
    # A motion that does not repeat has no phases.
    return summary | {"amplitudes": [[*row, None][:3] for row in rows]}


def _plain_numbers(answer: Answer, name: str, element: str) -> dict[str, float]:
    """Numbers of one element that are no signals, by their keys."""
    keyed = [variable for variable in variables_of(element) if variable.json]
    numbers = read(answer, name, keyed)
    return {variable.json: numbers[variable.name] for variable in keyed}


def _disk_record(answer: Answer, name: str, angle: Mapping[str, Any]) -> dict[str, Any]:
    """Angle, speed and acceleration of a disk; ``angle`` is the record of the first."""
    return (
        {key: angle[key] for key in ("mean", "half_peak_to_peak", "amplitudes")}
        | {
            "speed": answer.speed(name).extremes(),
            "acceleration": answer.acceleration(name).extremes(),
        }
        | _plain_numbers(answer, name, "disk")
    )


def _mesh_record(
    answer: Answer,
    name: str,
    of_signal: Callable[[Signal | RecordedSignal], dict[str, Any]],
) -> dict[str, Any]:
    """Tooth force, contact and heat of a mesh; ``of_signal`` makes the record of a
    signal.
    """
    force = answer.force(name)
    law = answer.law(name)
    details = answer.details.get(name)
    impacts = details and [
        {
            "theta_deg": answer.state.period * answer.cycle_deg * impact["cycle"],
            "speed": impact["speed"],
            "side": impact["side"],
        }
        for impact in details.impacts
    ]
    record = of_signal(force)
    record["elastic"] = of_signal(force.elastic)
    record |= _plain_numbers(answer, name, "mesh")
    record |= {
        "impacts": impacts,
        "drive_side": answer.contacts[name].drive_side if answer.known else None,
        "gap_spring_force": law.gap_spring_force if law else 0.0,
        "knee_force": law.knee_force if law else 0.0,
        "pulling_force": details and details.pulling_force,
        "power_W": answer.power(name),
    }
    return record | _meshing_record(answer, name)


def _meshing_record(answer: Answer, name: str) -> dict[str, Any]:
    """Gear whine, transmission error and rattle of a mesh with a mesh period; empty of
    meshes without.
    """
    topology = answer.topology
    response = answer.response
    periods = topology.mesh_periods[topology.mesh_names.index(name)]
    if not periods or not answer.known:
        return {}
    error = (
        None
        if response is None
        else response.transmission_error(name).half_peak_to_peak
    )
    return {
        "mesh_order": answer.mesh_order(name),
        "mesh_order_amplitudes": answer.whine(name),
        "transmission_error_half_peak_to_peak": error,
        "impact_energy_J": None if response is None else response.impact_energy(name),
    }


def answer_row(answer: Answer, **first: Any) -> dict[str, Any]:
    """One answer as a row of a CSV file by heads, ``first`` behind the speed; no
    numbers where nothing is certain.
    """
    response = answer.response
    row = {
        "rpm": answer.rpm,
        **first,
        "motion": answer.state.kind,
        "period cycles": answer.state.period,
        "started from rpm": answer.state.started_from,
        "stable": answer.stable,
        "largest multiplier": answer.multiplier,
        "status": None if answer.status is None else answer.status.name,
        "harmonics": answer.harmonics,
        "residual": None if response is None else float(response.residual),
        "truncation error": (
            None if response is None else float(response.truncation_error)
        ),
    }
    numbers = _numbers(answer)
    return row | (numbers if answer.answered else dict.fromkeys(numbers))


def _cells(answer: Answer, name: str, element: str) -> dict[str, float]:
    """Numbers of one element by heads: of signals, those without backlash, others."""
    listed = [variable for variable in variables_of(element) if variable.csv]
    of_signals = [variable for variable in listed if variable.vibration is not None]
    twice = [variable for variable in listed if variable.without]
    numbers = read(answer, name, listed)
    closed = read(answer.without_backlash, name, twice) if twice else {}
    cells = {variable.head: numbers[variable.name] for variable in of_signals}
    cells |= {
        f"{variable.head} without backlash": closed[variable.name] for variable in twice
    }
    return cells | {variable.head: numbers[variable.name] for variable in listed}


def _numbers(answer: Answer) -> dict[str, Any]:
    """Numbers of the row of an answer by heads, SI units."""
    row = {"load kW": float(answer.balance.load_kW)}
    for variable in (VARIABLES["load_torque"], VARIABLES["ground_reaction"]):
        row |= {
            f"{name} {variable.head}": torque
            for name, torque in torques_of(answer.balance, variable.element).items()
        }
    for element in WORKED:
        for name in names_of(answer.topology)[element]:
            cells = _cells(answer, name, element)
            row |= {f"{name} {head}": number for head, number in cells.items()}
    return row | {
        head: values[0]
        for head, values in strength_columns(answers_strength([answer])).items()
    }


def untraceable(answer: Answer) -> str:
    """Say why a motion has no trace; "" where it has."""
    if not answer.answered:
        return (
            "the motion is not converged" if answer.known else "the motion is not known"
        )
    if answer.unconfirmed:
        return (
            f"the motion is {UNCONFIRMED}, so there is no solution to trace (--orbit: a"
            " periodic solution)"
        )
    if answer.response is None:
        return (
            "the motion never repeats, so it has no period (--orbit: a periodic"
            " solution)"
        )
    return ""


def trace(answer: Answer) -> Sheet:
    """The motion over its period as a table, of an answer that :func:`untraceable`
    has nothing to say about; SI units.
    """
    response = answer.response
    assert response is not None  # others are untraceable
    turns = response.topology.revolutions_per_cycle
    signals = {
        f"{name} {vibration.called} {vibration.unit}": vibration.read(
            answer.state, name
        )
        for element in WORKED
        for vibration in VIBRATIONS.values()
        if vibration.element == element
        for name in names_of(answer.topology)[element]
    }
    # At least four time samples for each harmonic of the motion, and so many that no
    # tooth force loses its peak.
    count = TRACED * max(1, -(-4 * response.harmonics // TRACED))
    forces = [answer.force(name) for name in answer.topology.mesh_names]
    while any(
        np.abs(_samples(force, count)).max() < (1 - MISSED) * force.peak
        for force in forces
    ):
        count *= 2
    share = np.arange(count) / count  # of the period
    columns = {
        "angle deg": 360.0 * turns * share,
        "time s": 60.0 * turns / answer.rpm * share,
    }
    columns |= {head: _samples(signal, count) for head, signal in signals.items()}
    return Sheet(list(columns), np.transpose(list(columns.values())))


def _samples(signal: Signal, count: int) -> np.ndarray:
    """Values ``(count,)`` of a signal at equidistant times of its period."""
    return fourier.sample(np.asarray(signal.coefficients), count)


DIMENSIONS = {
    "direction": "in which the sweep went",
    "case": "normal running, and with misfires",
}
"""Dimensions along which a file has several lists of answers, and what they mean."""


def labelled(
    sweeps: Mapping[str, Sequence[Answer]],
    orders: float | None,
    *,
    along: str | None = None,
    every: bool = False,
) -> Dataset:
    """The data set of answers: lists of them by name in ``sweeps``, of trains with
    the same elements. ``along`` is the dimension of names, None of one list; ``orders``
    is the highest whose amplitudes are listed, None: the highest of the excitation, or
    with ``every`` of the motions.
    """
    import xarray

    dataset = _data_set(
        [answer for answers in sweeps.values() for answer in answers], orders, every
    )
    if along is None:
        return dataset
    dimension = "value" if "value" in dataset.dims else "rpm"
    ends = np.cumsum([0, *map(len, sweeps.values())])
    sets = [
        dataset.isel({dimension: slice(first, end)})
        for first, end in zip(ends[:-1], ends[1:], strict=True)
    ]
    names = xarray.Variable(along, list(sweeps), {"long_name": DIMENSIONS[along]})
    return xarray.concat(sets, names, join="outer", combine_attrs="override")


def _data_set(answers: Sequence[Answer], orders: float | None, every: bool) -> Dataset:
    """The data set of answers of trains with the same elements, along the speed or the
    number that a sweep goes over; ``orders`` and ``every`` as of :func:`labelled`.
    """
    topology = answers[0].topology
    axis = answers[0].axis
    if orders is None and not every:
        orders = listed_harmonic(topology) / topology.revolutions_per_cycle
    dataset = to_xarray(
        [answer.state for answer in answers],
        topology,
        [answer.rpm for answer in answers],
        orders=orders,
    )
    dataset.attrs |= {
        "motions": "periodic solutions" if answers[0].orbit else "steady states"
    }
    flags = {None: -1, False: 0, True: 1}
    attributes = {
        "long_name": "whether disturbances die away",
        "flag_values": list(flags.values()),
        "flag_meanings": "not_known unstable stable",
    }
    dataset["stable"] = (
        "rpm",
        [flags[answer.stable] for answer in answers],
        attributes,
    )
    dataset["largest_multiplier"] = (
        "rpm",
        np.array([answer.multiplier for answer in answers], dtype=float),
        {"units": "1", "long_name": "modulus over the period"},
    )
    if any(topology.mesh_backlash):
        linear = to_xarray(
            [answer.without_backlash.state for answer in answers],
            topology,
            dataset.rpm.values,
            orders=0,
        )
        # What gaps change: torques and forces, as far as they are signals
        names = [
            name
            for name, variable in VARIABLES.items()
            if name in linear and variable.vibration and variable.element != "disk"
        ]
        dataset = dataset.merge(
            linear[names].rename({name: f"{name}{WITHOUT}" for name in names})
        )
    if answers[0].value is not None:
        dataset = dataset.rename(rpm="value").assign_coords(
            value=[answer.place for answer in answers]
        )
        dataset.value.attrs |= {"units": axis.unit, "long_name": axis.name}
        dataset.attrs |= {"rpm": answers[0].rpm}
    return dataset

"""Answers as rows of CSV files, and one motion over its cycle as the rows of a table of time traces."""

import numpy as np

from jaxhb.equations import fourier
from jaxhb.report.answer import UNCONFIRMED
from jaxhb.report.files.output import as_csv
from jaxhb.report.quantities import ELEMENTS, WITHOUT, number
from jaxhb.report.text.mean_torques import ground_reactions, load_torques
from jaxhb.report.text.strength import answers_strength, strength_columns
from jaxhb.results.record import PERCENT
from jaxhb.results.signal import MISSED

TRACED = 720
"""Time samples in a period of a trace, or twice, four times... as many."""


def answer_row(answer, **first):
    """One answer as a row of a CSV file by heads, ``first`` behind the speed; no numbers where nothing is certain."""
    solved = answer.response
    about = {
        "rpm": answer.rpm,
        **first,
        "motion": answer.state.kind,
        "period cycles": answer.state.period,
        "started from rpm": answer.state.started_from,
        "stable": answer.growth.stable,
        "largest multiplier": answer.growth.multiplier,
        "status": None if solved is None else answer.status.name,
        "harmonics": answer.harmonics,
        "residual": None if solved is None else float(solved.residual),
        "truncation error": None if solved is None else float(solved.truncation_error),
    }
    return about | (_numbers(answer) if answer.answered else dict.fromkeys(_numbers(answer)))


def rows_csv(rows):
    """The CSV file of such rows."""
    heads = dict.fromkeys(head for row in rows for head in row)
    return as_csv(list(heads), [[row.get(head) for head in heads] for row in rows])


CELLS = {
    "mesh": {
        "mean N": "tooth_force_mean",
        "max N": "tooth_force_max",
        "min N": "tooth_force_min",
        **{
            f"max of a cycle {percent} % N": lambda answer, name, i=i: float(answer.force(name).per_cycle.max[i])
            for i, percent in enumerate(PERCENT)
        },
        "max N without backlash": f"tooth_force_max{WITHOUT}",
        "min N without backlash": f"tooth_force_min{WITHOUT}",
        "separated fraction": "separated_fraction",
        "reverse fraction": "reverse_contact_fraction",
        "impacts per cycle": "impacts_per_cycle",
        "hardest impact m/s": "hardest_impact",
    },
    "gear": {
        "torque half peak-to-peak N m": "gear_torque_half_peak_to_peak",
        "torque half peak-to-peak N m without backlash": f"gear_torque_half_peak_to_peak{WITHOUT}",
    },
    "shaft": {"torque half peak-to-peak N m": "torque_half_peak_to_peak", "heat W": "heat"},
    "disk": {
        "speed half peak-to-peak rad/s": "speed_half_peak_to_peak",
        "acceleration half peak-to-peak rad/s2": "acceleration_half_peak_to_peak",
        "irregularity": "irregularity",
    },
}
"""Heads of the columns of every element behind its name, and their variables of data sets or readers."""


def _numbers(answer):
    row = {"load kW": float(answer.balance.load_kW)}
    row |= {f"{name} load torque N m": torque for name, torque in load_torques(answer.balance).items()}
    row |= {f"{name} ground reaction N m": torque for name, torque in ground_reactions(answer.balance).items()}
    for element, cells in CELLS.items():
        for name in ELEMENTS[element](answer.topology):
            for head, read in cells.items():
                row[f"{name} {head}"] = read(answer, name) if callable(read) else number(answer, name, read)
    return row | {head: values[0] for head, values in strength_columns(answers_strength([answer])).items()}


def untraceable(answer):
    """Why a motion has no trace; "" where it has."""
    if not answer.answered:
        return "the motion is not converged" if answer.known else "the motion is not known"
    if answer.unconfirmed:
        return f"the motion is {UNCONFIRMED}, so there is no solution to trace (--orbit: a periodic solution)"
    return "the motion never repeats, so it has no period (--orbit: a periodic solution)" * (answer.response is None)


def trace_csv(answer):
    """The motion over its period, of an answer that :func:`untraceable` has nothing to say about; SI units."""
    turns = answer.response.topology.revolutions_per_cycle
    traced = {
        f"{name} {head}": getattr(answer.state, read)(name)
        for element, head, read in TRACES
        for name in ELEMENTS[element](answer.topology)
    }
    # At least four time samples for each harmonic of the motion, and so many that no tooth force loses its peak.
    count = TRACED * max(1, -(-4 * answer.response.harmonics // TRACED))
    forces = [answer.force(name) for name in answer.topology.mesh_names]
    while any(np.abs(_samples(force, count)).max() < (1 - MISSED) * force.peak for force in forces):
        count *= 2
    part = np.arange(count) / count
    columns = {"angle deg": 360.0 * turns * part, "time s": 60.0 * turns / answer.rpm * part}
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

"""Result of a tuning: tables for people, a record for programs, and its designs beside
their steady states.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb._jax import Numbers
from jaxhb.design.between_speeds import EXCESS, Checked, most_of
from jaxhb.design.quantities import OF_DESIGN, Objective, Penalty, label, unit_of
from jaxhb.report.answer import SPEED
from jaxhb.report.table import Column, Table
from jaxhb.report.text.columns import NONE, count, plain_number
from jaxhb.report.text.sentences import remarks_text
from jaxhb.report.text.strength import AID
from jaxhb.report.units import shown_unit
from jaxhb.results.steady import SteadyState
from jaxhb.train.changes import declared_field, locate
from jaxhb.train.drivetrain import DriveTrain

if TYPE_CHECKING:  # Commands do not wait for what a tuning needs.
    from jaxhb.design.descent import Step
    from jaxhb.design.task import Reading
    from jaxhb.design.tuning import Tuning

# Share by which a value between the speeds exceeds those at them before a sentence says
# so
LARGER = 0.02
MANY = 12  # speeds that are listed
SAME_MOTION = 0.02
"""Difference of a force, torque or angle from which the steady state is told as another
motion than the orbit tuned.
"""
_HEADS = [
    "quantity, worst over the speeds",
    "before",
    "at rpm",
    "after",
    "at rpm",
    "limit",
]
"""Heads of the tables of quantities."""


def tuned_record(
    train: DriveTrain, settings: Mapping[str, Any], result: Tuning
) -> dict[str, Any]:
    """The record of ``tune --json``, in SI units: of the ``train`` as it was, the
    ``settings`` of its [tune] table, as :func:`jaxhb.design.table.read_table` gives
    them, and the result.
    """
    before = result.before
    after = result.after
    record = progress_record(train, settings["rpm"], result.history)
    if result.robust:
        designs = {
            title: {
                "nominal": spread.nominal,
                "worst": spread.worst,
                "p95": spread.percentile(95),
                "solved": spread.solved,
            }
            for title, spread in result.robust.spreads.items()
        }
        record["robust"] = {"kind": result.robust.kind, "designs": designs}
    return record | {
        "stopped": result.stopped,
        "interrupted": result.interrupted,
        "parameters": {
            parameter.name: {
                "before": before.parameters[parameter.name],
                "after": after.parameters[parameter.name],
                "low": parameter.low,
                "high": parameter.high,
                "unit": parameter_unit(train, parameter.name),
            }
            for parameter in settings["parameters"]
        },
        "readings": {
            name: {"unit": unit_of(chosen.quantity), "before": first, "after": last}
            for chosen, name, first, last in _readings(settings, result)
        },
        "solved": {"before": before.solved, "after": after.solved},
        "checked": {
            when: checked_record(checked) for when, checked in result.checked.items()
        },
        "followed": result.followed,
        "outcomes": [
            {"objective": value, "parameters": parameters, "valid": valid}
            for value, parameters, valid in result.outcomes
        ],
    }


def checked_record(checked: Checked) -> dict[str, Any]:
    """The readings of a design at the speeds of a tuning and between them, and the
    largest of each.
    """
    worst = {
        name: dict(zip(("value", "rpm"), checked.worst(name), strict=True))
        for name in checked.readings
    }
    return {
        "rpm": checked.rpm,
        "solved": checked.solved,
        "readings": checked.readings,
        "worst": worst,
    }


def progress_record(
    train: DriveTrain, rpm: Numbers, history: Iterable[Step]
) -> dict[str, Any]:
    """The record while a tuning runs: ``scene``, ``rpm``, ``history``."""
    steps = [dataclasses.asdict(step) for step in history]
    return {"scene": train.topology.name, "rpm": rpm, "history": steps}


def start_record(train: DriveTrain, rpm: Numbers, reading: Reading) -> dict[str, Any]:
    """The record before the first step: of the nominal scene the parameters, and
    readings over the speeds.
    """
    start = {
        "parameters": reading.parameters,
        "solved": reading.solved,
        "readings": reading.readings,
    }
    return progress_record(train, rpm, ()) | {"start": start, "interrupted": True}


def tuned_parts(
    train: DriveTrain, settings: Mapping[str, Any], result: Tuning
) -> list[str]:
    """Before and after in the words of an engineer: changes of the objectives,
    parameters, quantities at their worst speeds.
    """
    rpm = np.asarray(settings["rpm"])
    last = result.history[-1]
    changes: list[str] = []
    rows: list[list[Any]] = []
    for chosen, name, before, after in _compared(settings, result):
        old, old_rpm = _worst(rpm, before, chosen)
        new, new_rpm = _worst(rpm, after, chosen)
        factor, _ = scaled_unit(chosen.quantity)
        speedless = chosen.quantity in OF_DESIGN
        rows.append(
            [
                with_unit(chosen),
                count(factor * old),
                NONE if speedless else f"{old_rpm:g}",
                count(factor * new),
                NONE if speedless else f"{new_rpm:g}",
                _limit(chosen) or NONE,
            ]
        )
        if len(changes) < len(settings["objective"]):
            if "before" in result.checked:
                old, old_rpm = result.checked["before"].worst(name)
                new, new_rpm = result.checked["after"].worst(name)
            change = f", {100 * (new / old - 1):+.0f} %" if old else ""
            changes.append(
                f"Largest {name}: {shown_value(chosen, old)}"
                f" at {old_rpm:.5g} rpm before, {shown_value(chosen, new)} at"
                f" {new_rpm:.5g} rpm after{change}."
            )
    head = [
        *changes,
        "",
        (
            f"{train.topology.title} at {SPEED.span(rpm)}: {last.number} steps,"
            f" {last.evaluations} evaluations, {last.seconds:.0f} s; {result.stopped}"
        ),
        (
            f"solved: {result.before.solved.sum()} of {len(rpm)} speeds before,"
            f" {result.after.solved.sum()} after"
        ),
        *_not_solved(rpm, result),
    ]
    # Quantities of rules: their table says that it is no approval.
    judged = any(
        re.match("stress|.* over limit$", chosen.quantity)
        for chosen, *_ in _readings(settings, result)
    )
    title = (
        "Quantities (forces, torques and angles: half peak-to-peak unless called peak"
        " or order)"
    )
    quantities = Table(f"{title} ({AID})" if judged else title, _HEADS, rows)
    parts = ["\n".join(head), _parameter_table(train, settings, result), quantities]
    if result.checked:
        parts.append(_between_table(settings, result))
    if result.robust:
        parts.append(_robust_table(settings, result))
    parts += remarks_text(
        result.followed,
        "Where a limit was exceeded the tuning went on at the critical speeds, which"
        " follow each design",
    )
    if result.checked:
        parts += _peaks_between(settings, rpm, result)
    return parts + _limits_exceeded(settings, rpm, result)


def _parameter_table(
    train: DriveTrain, settings: Mapping[str, Any], result: Tuning
) -> Table:
    """The parameters before and after, and their bounds."""
    before = result.before.parameters
    after = result.after.parameters
    return Table(
        "Parameters",
        [
            Column("parameter", read=lambda each: each.name),
            Column("before", plain_number, lambda each: before[each.name]),
            Column("after", plain_number, lambda each: after[each.name]),
            Column("unit", read=lambda each: parameter_unit(train, each.name) or NONE),
            Column("bounds", read=bounds_text),
        ],
        settings["parameters"],
    )


def bounds_text(bounded: Any) -> str:
    """The range of a parameter or tolerance in words."""
    return f"{plain_number(bounded.low)} to {plain_number(bounded.high)}"


def _peaks_between(
    settings: Mapping[str, Any], rpm: np.ndarray, result: Tuning
) -> list[str]:
    """Sentences on the last design: readings that are larger between the speeds asked
    for, and speeds there without a solution.
    """
    checked = result.checked["after"]
    larger = []
    for chosen, name, _, after in _readings(settings, result):
        if (
            chosen.quantity in OF_DESIGN
            or not np.isfinite(after).any()
            or _lower_alone(chosen)
        ):
            continue
        value, speed = checked.worst(name)
        at_grid = np.nanmax(after)
        place = int(np.nanargmax(after))
        if value > (1 + LARGER) * at_grid:
            most = f"{shown_value(chosen, value)} at {speed:.4g} rpm"
            larger.append(
                f"{name} {most}, not {shown_value(chosen, at_grid)} as at"
                f" {rpm[place]:g} rpm"
            )
    sentences = []
    if larger:
        sentences.append(
            f"LARGER between the speeds asked for: {'; '.join(larger)}. Give more"
            " speeds there."
        )
    lost = np.setdiff1d(checked.rpm[~checked.solved], rpm)
    if len(lost):
        speeds = ", ".join(f"{speed:.5g}" for speed in lost[:MANY])
        more = ", ..." if len(lost) > MANY else ""
        sentences.append(
            "NOT solved between the speeds, and left out of these results:"
            f" {speeds}{more} rpm."
        )
    return sentences


def _between_table(settings: Mapping[str, Any], result: Tuning) -> Table:
    """All readings of responses at their worst, between the speeds, too."""
    designs = [result.checked.get(when) for when in ("before", "after")]

    def of_design(chosen: Objective | Penalty, name: str, place: int) -> list[str]:
        checked = designs[place]
        if checked is None:
            return [NONE, NONE]
        factor, _ = scaled_unit(chosen.quantity)
        value, speed = checked.worst(name)
        return [count(factor * value), f"{speed:.4g}"]

    speeds = len(result.checked["after"].rpm)
    return Table(
        f"Check between the speeds ({speeds} speeds of the last design)",
        _HEADS,
        [
            [
                with_unit(chosen),
                *of_design(chosen, name, 0),
                *of_design(chosen, name, 1),
                _limit(chosen) or NONE,
            ]
            for chosen, name, *_ in _readings(settings, result)
            if chosen.quantity not in OF_DESIGN
        ],
    )


def _robust_table(settings: Mapping[str, Any], result: Tuning) -> Table:
    """The scene, the nominal and the robust design over the tolerances, at their worst
    speeds.
    """
    assert result.robust is not None  # of a robust tuning
    spreads = result.robust.spreads
    rows = []
    for j, objective in enumerate(settings["objective"]):
        factor, _ = scaled_unit(objective.quantity)
        for title, spread in spreads.items():
            values = (
                spread.nominal[:, j],
                spread.worst[:, j],
                spread.percentile(95)[:, j],
                spread.samples[..., j],
            )
            numbers = [count(factor * np.nanmax(each)) for each in values]
            solved = f"{100 * spread.solved.min():.0f}"
            rows.append([with_unit(objective), title, *numbers, solved])
    drawn = len(next(iter(spreads.values())).drawn)
    return Table(
        "Within the tolerances: the design itself, the worst case found, and a fresh"
        f" sample of {drawn} trains",
        [
            "worst over the speeds",
            Column("design", left=True),
            "itself",
            "worst case",
            "95 %",
            "largest",
            "solved, %",
        ],
        rows,
    )


def _not_solved(rpm: np.ndarray, result: Tuning) -> list[str]:
    """A line on the speeds without a solution, which do not count in the objectives, in
    a list.
    """
    solved = {"before": result.before.solved, "after": result.after.solved}
    lost = [
        f"{', '.join(f'{speed:g}' for speed in rpm[~of_design])} rpm {when}"
        for when, of_design in solved.items()
        if not of_design.all()
    ]
    if not lost:
        return []
    both = int((result.before.solved & result.after.solved).sum())
    compared = (
        f"are compared at the {both} speed{'s' * (both != 1)} solved in both"
        if both
        else "do not compare"
    )
    return [
        f"NOT solved, and left out of the objectives: {'; '.join(lost)}. jaxhb"
        f" sweep shows what happens there. Before and after {compared}."
    ]


def _limits_exceeded(
    settings: Mapping[str, Any], rpm: np.ndarray, result: Tuning
) -> list[str]:
    """A sentence on the limits that the last design exceeds by more than what a penalty
    lets through, in a list.
    """
    exceeded = []
    limited = False
    checked = result.checked.get("after")
    for chosen, name, _, after in _readings(settings, result):
        value, speed = _worst(rpm, after, chosen)
        most = most_of(chosen)
        least = getattr(chosen, "least", None)
        limited |= most is not None
        if checked and most is not None and name in checked.readings:
            value, speed = checked.worst(name)
        above = most is not None and value > most + EXCESS * abs(most)
        below = least is not None and value < least - EXCESS * abs(least)
        if above or below:
            where = "" if chosen.quantity in OF_DESIGN else f" at {speed:.4g} rpm"
            exceeded.append(
                f"{name} is {shown_value(chosen, value)}{where},"
                f" {_limit(chosen) or 'at most 1'}"
            )
    if exceeded:
        return [f"NOT within its limits: {'; '.join(exceeded)}."]
    return ["Within its limits, between the speeds too."] if checked and limited else []


def _readings(
    settings: Mapping[str, Any], result: Tuning
) -> Iterator[tuple[Objective | Penalty, str, Numbers, Numbers]]:
    """(Objective or Penalty, label, reading before, after) of each, readings ``(n,)``
    over the speeds or one number.
    """
    for chosen in (*settings["objective"], *settings["penalties"]):
        name = label(chosen)
        yield chosen, name, result.before.readings[name], result.after.readings[name]


def _compared(
    settings: Mapping[str, Any], result: Tuning
) -> Iterator[tuple[Objective | Penalty, str, Numbers, Numbers]]:
    """The same with NaN at speeds that only one of the designs has solved, unless no
    speed is solved in both.
    """
    both = result.before.solved & result.after.solved

    def masked(values: Numbers) -> Numbers:
        over_speeds = np.shape(values) == both.shape and both.any()
        return np.where(both, values, np.nan) if over_speeds else values

    for chosen, name, before, after in _readings(settings, result):
        yield chosen, name, masked(before), masked(after)


def _worst(
    rpm: np.ndarray, values: Numbers, chosen: Objective | Penalty
) -> tuple[float, float]:
    """Largest value and its speed; the smallest where only a lower limit is set."""
    values = np.atleast_1d(np.asarray(values, dtype=float))
    if not np.isfinite(values).any():
        return np.nan, np.nan
    place = int((np.nanargmin if _lower_alone(chosen) else np.nanargmax)(values))
    return float(values[place]), float(rpm[place])


def _lower_alone(chosen: Objective | Penalty) -> bool:
    """Whether only a lower limit is set."""
    return (
        getattr(chosen, "least", None) is not None
        and getattr(chosen, "most", None) is None
    )


def shown_value(chosen: Objective | Penalty, value: float) -> str:
    """A value of a quantity, in the unit for people."""
    factor, unit = scaled_unit(chosen.quantity)
    return f"{count(factor * value)} {unit}".rstrip()


def _limit(chosen: Objective | Penalty) -> str:
    """The limits of a quantity, in the unit for people; "" without."""
    limits = {name: getattr(chosen, name, None) for name in ("most", "least")}
    factor, _ = scaled_unit(chosen.quantity)
    return ", ".join(
        f"at {name} {factor * value:g}"
        for name, value in limits.items()
        if value is not None
    )


def scaled_unit(quantity: str) -> tuple[float, str]:
    """Factor from SI, and the unit in which people read a quantity."""
    return shown_unit(unit_of(quantity))


def with_unit(chosen: Objective | Penalty) -> str:
    """Label of a quantity, and the unit for people behind it where there is one."""
    return f"{label(chosen)}, {scaled_unit(chosen.quantity)[1]}".removesuffix(", ")


def parameter_unit(train: DriveTrain, name: str) -> str:
    """Unit of a parameter ``"NAME.FIELD"``."""
    table, field_name, _ = locate(train.topology, name)
    field = declared_field(table, field_name)
    assert field is not None  # it was located
    return field.metadata["range"].unit


def difference(
    state: SteadyState, pairs: Mapping[Objective | Penalty, tuple[float, float]]
) -> str:
    """Sentence on how a steady state differs from the orbit of the tuning, by the
    values of quantities in both; "" for the same motion.
    """
    kind = {
        "subharmonic": f"has a period of {state.period} cycles",
        "irregular": "is irregular",
        "unknown": f"is not known ({'; '.join(state.notes)})",
    }.get(state.kind, "")
    apart = [
        f"{label(chosen)} {shown_value(chosen, steady)} instead of"
        f" {shown_value(chosen, tuned)}"
        for chosen, (steady, tuned) in pairs.items()
        if abs(steady - tuned) > SAME_MOTION * max(abs(steady), abs(tuned))
    ]
    if not kind and not apart:
        return ""
    about = f" ({'; '.join(state.notes)})" if state.known and state.notes else ""
    return (
        f"at {state.rpm:g} rpm {kind or 'is in another motion'}"
        f"{': ' * bool(apart)}{', '.join(apart)}{about}."
    )


def check_text(designs: Mapping[str, Mapping[str, Sequence]]) -> str:
    """The sentences of :func:`jaxhb.report.compute.check_designs`, or one that there is
    nothing to tell.
    """
    differences = [
        sentence for design in designs.values() for sentence in design["differences"]
    ]
    head = "Steady states that are not the periodic motions tuned"
    return "".join(remarks_text(differences, head)) or (
        "At all speeds the steady states of both designs are the tuned periodic"
        " motions."
    )

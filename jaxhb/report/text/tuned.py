"""What a tuning says: a table for people, a record for programs, and its designs beside
their steady states.
"""

import dataclasses
import re

import numpy as np

from jaxhb.design.between_speeds import EXCESS, most_of
from jaxhb.design.quantities import OF_DESIGN, label, unit_of
from jaxhb.report.answer import SPEED
from jaxhb.report.quantities import shown_unit
from jaxhb.report.text.columns import NONE, count, from_rows, plain_number
from jaxhb.report.text.sentences import remarks_text
from jaxhb.report.text.strength import AID
from jaxhb.train.changes import declared_field, locate

# Share by which a value between the speeds exceeds those at them before a sentence says
# so
LARGER = 0.02
MANY = 12  # speeds that are listed
SAME_MOTION = 0.02
"""Difference of a force, torque or angle from which the steady state is told as another
motion than the orbit tuned.
"""


def tuned_record(train, asked, result):
    """What ``tune --json`` writes, in SI units: of the ``train`` as it was, ``asked``
    as its table, and a Tuning.
    """
    before = result.before
    after = result.after
    record = progress_record(train, asked["rpm"], result.history)
    if result.robust:
        designs = {
            said: {
                "nominal": one.nominal,
                "worst": one.worst,
                "p95": one.percentile(95),
                "solved": one.solved,
            }
            for said, one in result.robust.spreads.items()
        }
        record["robust"] = {"kind": result.robust.kind, "designs": designs}
    return record | {
        "stopped": result.stopped,
        "interrupted": result.interrupted,
        "parameters": {
            p.name: {
                "before": before.parameters[p.name],
                "after": after.parameters[p.name],
            }
            | {"low": p.low, "high": p.high, "unit": parameter_unit(train, p.name)}
            for p in asked["parameters"]
        },
        "readings": {
            name: {"unit": unit_of(chosen.quantity), "before": first, "after": last}
            for chosen, name, first, last in _readings(asked, result)
        },
        "solved": {"before": before.solved, "after": after.solved},
        "checked": {
            when: checked_record(checked) for when, checked in result.checked.items()
        },
        "followed": result.followed,
        "outcomes": [
            {"objective": value, "parameters": own, "valid": valid}
            for value, own, valid in result.outcomes
        ],
    }


def checked_record(checked):
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


def progress_record(train, rpm, history):
    """What is known while a tuning runs: ``scene``, ``rpm``, ``history``."""
    steps = [dataclasses.asdict(step) for step in history]
    return {"scene": train.topology.name, "rpm": rpm, "history": steps}


def start_record(train, rpm, reading):
    """What is known before the first step: of the scene as it is the parameters, and
    readings over the speeds.
    """
    start = {
        "parameters": reading.parameters,
        "solved": reading.solved,
        "readings": reading.readings,
    }
    return progress_record(train, rpm, ()) | {"start": start, "interrupted": True}


def tuned_parts(train, asked, result):
    """Before and after in the words of an engineer: what was won, parameters,
    quantities at their worst speeds.
    """
    rpm = np.asarray(asked["rpm"])
    last = result.history[-1]
    won = []
    rows = []
    for chosen, name, *both in _compared(asked, result):
        found = [_worst(rpm, values, chosen) for values in both]
        if len(won) < len(asked["objective"]):
            (old, old_rpm), (new, new_rpm) = found
            if "before" in result.checked:
                (old, old_rpm), (new, new_rpm) = (
                    result.checked[when].worst(name) for when in ("before", "after")
                )
            change = f", {100 * (new / old - 1):+.0f} %" if old else ""
            won.append(
                f"{name[0].upper()}{name[1:]} at its worst: {shown_value(chosen, old)}"
                f" at {old_rpm:.5g} rpm before, {shown_value(chosen, new)} at"
                f" {new_rpm:.5g} rpm after{change}."
            )
        factor, _ = scaled_unit(chosen.quantity)
        rows.append([with_unit(chosen)])
        for value, at in found:
            rows[-1] += [
                count(factor * value),
                NONE if chosen.quantity in OF_DESIGN else f"{at:g}",
            ]
        rows[-1].append(_limit(chosen) or NONE)
    head = [
        *won,
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
    heads = [
        "quantity, worst over the speeds",
        "before",
        "at rpm",
        "after",
        "at rpm",
        "limit",
    ]
    title = (
        "Quantities (forces, torques and angles: half peak-to-peak unless called peak"
        " or order)"
    )
    # Quantities of rules: their table says that it is no approval.
    judged = any(
        re.match("stress|.* over limit$", chosen.quantity)
        for chosen, *_ in _readings(asked, result)
    )
    quantities = from_rows(f"{title} ({AID})" if judged else title, heads, rows)
    rows = [
        [p.name, result.before.parameters[p.name], result.after.parameters[p.name]]
        + [
            parameter_unit(train, p.name) or NONE,
            f"{plain_number(p.low)} to {plain_number(p.high)}",
        ]
        for p in asked["parameters"]
    ]
    heads = [
        "parameter",
        ("before", plain_number),
        ("after", plain_number),
        "unit",
        "bounds",
    ]
    parameters = from_rows("Parameters", heads, rows)
    robust = [_robust_table(asked, result)] if result.robust else []
    between = [_between_table(asked, result)] if result.checked else []
    followed = [_followed_text(result.followed)] if result.followed else []
    peaks = _peaks_between(asked, rpm, result) if result.checked else []
    limits = _limits_exceeded(asked, rpm, result)
    return [
        "\n".join(head),
        parameters,
        quantities,
        *between,
        *robust,
        *followed,
        *peaks,
        *limits,
    ]


def _peaks_between(asked, rpm, result):
    """Sentences on the last design: readings that are larger between the speeds asked
    for, and speeds there without a solution.
    """
    checked = result.checked["after"]
    said = []
    for chosen, name, _, after in _readings(asked, result):
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
            said.append(
                f"{name} {most}, not {shown_value(chosen, at_grid)} as at"
                f" {rpm[place]:g} rpm"
            )
    told = (
        [
            f"LARGER between the speeds asked for: {'; '.join(said)}. Give more speeds"
            " there."
        ]
        if said
        else []
    )
    lost = np.setdiff1d(checked.rpm[~checked.solved], rpm)
    if len(lost):
        speeds = ", ".join(f"{speed:.5g}" for speed in lost[:MANY])
        more = ", ..." if len(lost) > MANY else ""
        shown = f"{speeds}{more} rpm"
        told.append(
            "NOT solved between the speeds, and left out of what is told of them:"
            f" {shown}."
        )
    return told


def _between_table(asked, result):
    """All readings of responses at their worst, between the speeds, too."""
    rows = []
    for chosen, name, *_ in _readings(asked, result):
        if chosen.quantity not in OF_DESIGN:
            factor, _ = scaled_unit(chosen.quantity)
            rows.append([with_unit(chosen)])
            for when in ("before", "after"):
                checked = result.checked.get(when)
                value, at = checked.worst(name) if checked else (np.nan, np.nan)
                rows[-1] += (
                    [count(factor * value), f"{at:.4g}"] if checked else [NONE, NONE]
                )
            rows[-1].append(_limit(chosen) or NONE)
    looked = len(result.checked["after"].rpm)
    title = f"The same between the speeds, too ({looked} speeds of the last design)"
    return from_rows(
        title,
        [
            "quantity, worst over the speeds",
            "before",
            "at rpm",
            "after",
            "at rpm",
            "limit",
        ],
        rows,
    )


def _followed_text(followed):
    """Limits that were exceeded on the way, after which the tuning went on."""
    told = (
        "Where a limit was exceeded the tuning went on at the critical speeds, which"
        " follow each design"
    )
    return "".join(remarks_text(followed, told))


def _robust_table(asked, result):
    """The scene, the nominal and the robust design over the tolerances, at their worst
    speeds.
    """
    rows = []
    for j, one in enumerate(asked["objective"]):
        factor, _ = scaled_unit(one.quantity)
        for said, spread in result.robust.spreads.items():
            values = (
                spread.nominal[:, j],
                spread.worst[:, j],
                spread.percentile(95)[:, j],
                spread.samples[..., j],
            )
            numbers = [count(factor * np.nanmax(own)) for own in values]
            rows.append(
                [with_unit(one), said, *numbers, f"{100 * spread.solved.min():.0f}"]
            )
    drawn = len(next(iter(result.robust.spreads.values())).drawn)
    heads = [
        "worst over the speeds",
        "design",
        "itself",
        "worst case",
        "95 %",
        "largest",
        "solved, %",
    ]
    title = (
        "Within the tolerances: the design itself, the worst case found, and a fresh"
        f" sample of {drawn} trains"
    )
    return from_rows(title, heads, rows, left=(1,))


def _not_solved(rpm, result):
    """A line on the speeds without a solution, which do not count in what was made
    small.
    """
    told = {"before": result.before.solved, "after": result.after.solved}
    said = [
        f"{', '.join(f'{x:g}' for x in rpm[~ok])} rpm {when}"
        for when, ok in told.items()
        if not ok.all()
    ]
    if not said:
        return []
    both = int((result.before.solved & result.after.solved).sum())
    compared = (
        f"are compared at the {both} speed{'s' * (both != 1)} solved in both"
        if both
        else "do not compare"
    )
    return [
        f"NOT solved, and left out of what was made small: {'; '.join(said)}. jaxhb"
        f" sweep shows what happens there. Before and after {compared}."
    ]


def _limits_exceeded(asked, rpm, result):
    """A sentence on the limits that the last design exceeds by more than what a penalty
    lets through.
    """
    said = []
    checked = result.checked.get("after")
    for chosen, name, _, after in _readings(asked, result):
        value, at = _worst(rpm, after, chosen)
        most = most_of(chosen)
        least = getattr(chosen, "least", None)
        if checked and most is not None and name in checked.readings:
            value, at = checked.worst(name)
        over = most is not None and value > most + EXCESS * abs(most)
        if over or (least is not None and value < least - EXCESS * abs(least)):
            where = "" if chosen.quantity in OF_DESIGN else f" at {at:.4g} rpm"
            said.append(
                f"{name} is {shown_value(chosen, value)}{where},"
                f" {_limit(chosen) or 'at most 1'}"
            )
    if said:
        return [f"NOT within its limits: {'; '.join(said)}."]
    limited = any(
        most_of(chosen) is not None for chosen, *_ in _readings(asked, result)
    )
    return ["Within its limits, between the speeds too."] if checked and limited else []


def _readings(asked, result):
    """(Objective or Penalty, label, before, after) of each."""
    for chosen in (*asked["objective"], *asked["penalties"]):
        name = label(chosen)
        yield chosen, name, result.before.readings[name], result.after.readings[name]


def _compared(asked, result):
    """The same with NaN at speeds that only one of the designs has solved, unless no
    speed is solved in both.
    """
    both = result.before.solved & result.after.solved
    for chosen, name, *values in _readings(asked, result):
        masked = (
            (
                np.where(both, one, np.nan)
                if np.shape(one) == both.shape and both.any()
                else one
            )
            for one in values
        )
        yield chosen, name, *masked


def _worst(rpm, values, chosen):
    """Largest value and its speed; the smallest where only a lower limit is set."""
    values = np.atleast_1d(np.asarray(values, dtype=float))
    if not np.isfinite(values).any():
        return np.nan, np.nan
    place = int((np.nanargmin if _lower_alone(chosen) else np.nanargmax)(values))
    return float(values[place]), float(rpm[place])


def _lower_alone(chosen):
    """Whether only a lower limit is set."""
    return (
        getattr(chosen, "least", None) is not None
        and getattr(chosen, "most", None) is None
    )


def shown_value(chosen, value):
    """A value of what is read, in the unit for people."""
    factor, unit = scaled_unit(chosen.quantity)
    return f"{count(factor * value)} {unit}".rstrip()


def _limit(chosen):
    limits = {name: getattr(chosen, name, None) for name in ("most", "least")}
    factor, _ = scaled_unit(chosen.quantity)
    return ", ".join(
        f"at {name} {factor * value:g}"
        for name, value in limits.items()
        if value is not None
    )


def scaled_unit(quantity):
    """Factor from SI, and the unit in which people read a quantity."""
    return shown_unit(unit_of(quantity))


def with_unit(chosen):
    """What is read, and the unit for people behind it where there is one."""
    return f"{label(chosen)}, {scaled_unit(chosen.quantity)[1]}".removesuffix(", ")


def parameter_unit(train, name):
    """Unit of a parameter ``"NAME.FIELD"``."""
    table, field, _ = locate(train.topology, name)
    return declared_field(table, field).metadata["range"].unit


def difference(state, pairs):
    """What a steady state does that the orbit of the tuning does not; "" for the same
    motion.
    """
    kind = {
        "subharmonic": f"has a period of {state.period} cycles",
        "irregular": "is irregular",
        "unknown": f"is not known ({'; '.join(state.notes)})",
    }.get(state.kind, "")
    apart = [
        f"{label(chosen)} {shown_value(chosen, own)} instead of"
        f" {shown_value(chosen, tuned)}"
        for chosen, (own, tuned) in pairs.items()
        if abs(own - tuned) > SAME_MOTION * max(abs(own), abs(tuned))
    ]
    if not kind and not apart:
        return ""
    about = f" ({'; '.join(state.notes)})" if state.known and state.notes else ""
    motion = kind or "is in another motion"
    colon = ": " if apart else ""
    return f"at {state.rpm:g} rpm {motion}{colon}{', '.join(apart)}{about}."


def check_text(found):
    """The sentences of :func:`jaxhb.report.compute.check_designs`, or one that there is
    nothing to tell.
    """
    differences = [said for told in found.values() for said in told["differences"]]
    alike = (
        "Both designs do at all speeds what was tuned: their steady states are the"
        " periodic motions tuned."
    )
    return (
        "".join(
            remarks_text(
                differences, "Steady states that are not the periodic motions tuned"
            )
        )
        or alike
    )

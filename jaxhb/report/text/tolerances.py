"""Effects of tolerances on a train: tables for people, a record for programs, and rows
for spreadsheets.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from jaxhb.design.quantities import label, unit_of
from jaxhb.design.worst_case import Spread
from jaxhb.report.answer import SPEED
from jaxhb.report.table import Column, Table
from jaxhb.report.text.columns import NONE, count, plain_number
from jaxhb.report.text.sentences import remarks_text
from jaxhb.report.text.tuned import bounds_text, parameter_unit, scaled_unit, with_unit

PERCENT = 5, 50, 95  # of the sample
MOVING = 5  # numbers listed of a quantity, those that move it most
NEGLIGIBLE = 0.002  # share of the nominal response below which a number moves nothing


def tolerance_parts(spread: Spread, checked: Mapping[str, Any] | None) -> list[str]:
    """Words and tables of a Spread: the worst case of each quantity, over the speeds,
    which numbers move it, where. ``checked`` are the motions there, as of
    :func:`jaxhb.report.compute.check_spread`.
    """
    rpm = spread.rpm
    solved = spread.answered
    lines = [
        f"{spread.train.topology.title} at {SPEED.span(rpm)}: {len(spread.tolerances)}"
        f" tolerances; {spread.evaluations} solves of a speed."
    ]
    if not solved.all():
        lost = ", ".join(f"{speed:g}" for speed in rpm[~solved])
        lines.append(f"NOT solved, and left out: {lost} rpm.")
    parts = ["\n".join(lines), *_not_judged(spread)]
    answered = _answered_quantities(spread)
    if len(answered):
        parts += [
            _worst_table(spread),
            *(_over_speeds(spread, j, checked) for j in answered),
            _moving(spread),
            _places(spread),
            *remarks_text(_guarantee(spread), "Bounds"),
        ]
    if len(spread.drawn):
        share = 100 * spread.solved[solved].min() if solved.any() else 0.0
        many = "all" if share == 100 else f"{share:.0f} % or more"
        parts.append(
            f"Sample: {len(spread.drawn)} trains, of which {many} are solved at each"
            " speed."
        )
    return parts + remarks_text(
        checked["differences"] if checked else [],
        "Steady states that are not the periodic motions searched",
    )


def _answered_quantities(spread: Spread) -> np.ndarray:
    """Indices of the quantities that have a value at any speed."""
    return np.flatnonzero(np.isfinite(spread.worst).any(axis=0))


def _not_judged(spread: Spread) -> list[str]:
    """A line on the speeds for which a rule has no limit, of each share of a limit, in
    a list.
    """
    quantities = [
        f"{name} at {', '.join(f'{speed:g}' for speed in spread.rpm[~judged])} rpm"
        for name, judged in zip(spread.labels, spread.judged.T, strict=True)
        if not judged.all()
    ]
    if not quantities:
        return []
    return [f"NOT judged, as the rule has no limit there: {'; '.join(quantities)}."]


def _guarantee(spread: Spread) -> list[str]:
    """Sentences on what is proved of the worst cases, and where and why it is not."""
    answered = spread.answered[:, None] & spread.judged
    reasons = spread.no_bound[answered]
    bounded = bool((reasons == "").any())
    free = bool((reasons != "").any())
    loose = any(spread.train.topology.mesh_backlash)
    sentences = []
    if bounded:
        teeth = (
            ", as long as its teeth stay in contact, in which all of them can run"
            if loose
            else ""
        )
        sentences.append(
            "No train within the tolerances has more than stands under 'at"
            f" most'{teeth}."
        )
    for reason in dict.fromkeys(reasons[reasons != ""].tolist()):
        unbounded = (spread.no_bound == reason) & answered
        names = [
            name
            for name, concerned in zip(spread.labels, unbounded.any(0), strict=True)
            if concerned
        ]
        quantities = "" if len(names) == len(spread.of) else f" of {', '.join(names)}"
        speeds = ", ".join(f"{speed:g}" for speed in spread.rpm[unbounded.any(1)])
        sentences.append(f"No bound{quantities} at {speeds} rpm: {reason}.")
    if free:
        there = "There the worst case" if bounded else "The worst case"
        sentences.append(
            f"{there} is the largest response found: another train within the"
            " tolerances may do worse."
        )
    return sentences


def _largest(spread: Spread, j: int) -> int:
    """Index of the speed at which the worst case of a quantity is largest."""
    return int(np.nanargmax(spread.worst[:, j]))


def _worst_table(spread: Spread) -> Table:
    """Each quantity at its worst speed, nominal and within the tolerances."""
    rows = []
    for j in _answered_quantities(spread):
        objective = spread.of[j]
        factor, _ = scaled_unit(objective.quantity)
        before = int(np.nanargmax(spread.nominal[:, j]))
        after = _largest(spread, j)
        old = factor * spread.nominal[before, j]
        new = factor * spread.worst[after, j]
        rows.append(
            [
                with_unit(objective),
                count(old),
                f"{spread.rpm[before]:g}",
                count(new),
                f"{spread.rpm[after]:g}",
                f"{new / old:.2f}" if old else NONE,
            ]
        )
    return Table(
        "Worst case over the tolerances (half peak-to-peak unless called peak or"
        " order)",
        [
            "quantity, worst over the speeds",
            "nominal",
            "at rpm",
            "worst case",
            "at rpm",
            "ratio",
        ],
        rows,
    )


def _over_speeds(spread: Spread, j: int, checked: Mapping[str, Any] | None) -> Table:
    """One quantity over the speeds."""
    factor, _ = scaled_unit(spread.of[j].quantity)
    nominal = factor * spread.nominal[:, j]
    worst = factor * spread.worst[:, j]
    bound = factor * spread.bound[:, j]
    columns = [
        Column("rpm", "{:g}".format, spread.rpm.__getitem__),
        Column("nominal", 1, nominal.__getitem__),
        Column("worst case", 1, worst.__getitem__),
        *[Column("at most", 1, bound.__getitem__)] * bool(np.isfinite(bound).any()),
        Column(
            "ratio",
            read=lambda i: f"{worst[i] / nominal[i]:.2f}" if nominal[i] > 0 else NONE,
        ),
    ]
    for q in PERCENT if len(spread.drawn) else ():
        sampled = factor * spread.percentile(q)[:, j]
        columns.append(Column(f"{q} %", 1, sampled.__getitem__))
    if checked:
        kinds = checked["nominal"], [of_speed[j] for of_speed in checked["worst"]]
        columns += [
            Column(head, read=kind.__getitem__, left=True)
            for head, kind in zip(("motion", "in the worst case"), kinds, strict=True)
        ]
    return Table(with_unit(spread.of[j]), columns, range(len(spread.rpm)))


def _moving(spread: Spread) -> Table:
    """Which numbers move each quantity, where its worst case is largest."""
    rows = []
    for j in _answered_quantities(spread):
        i = _largest(spread, j)
        slopes = spread.effects[i, j]
        size = spread.nominal[i, j]
        order = [
            k
            for k in np.argsort(-np.abs(slopes), kind="stable")
            if abs(slopes[k]) > NEGLIGIBLE * abs(size)
        ]
        for k in order[:MOVING]:
            share = 100 * float(slopes[k]) / size
            rows.append(
                [
                    label(spread.of[j]),
                    f"{spread.rpm[i]:g}",
                    spread.tolerances[k].name,
                    f"{share:+.1f}",
                ]
            )
    method = (
        "by regression on the sample"
        if len(spread.drawn) >= 3 * len(spread.tolerances)
        else "by its derivative"
    )
    return Table(
        "Sensitivities: change of the response over half the range of a parameter,"
        f" {method}, %",
        ["quantity", "at rpm", Column("parameter", left=True), "%"],
        rows,
    )


def _places(spread: Spread) -> Table:
    """The numbers of each worst case beside their ranges."""
    train = spread.train
    places = {j: _largest(spread, j) for j in _answered_quantities(spread)}
    columns = [
        Column("parameter", read=lambda each: each.name),
        Column("nominal", plain_number, lambda each: float(train.value(each.name))),
    ]
    for number, (j, i) in enumerate(places.items(), 1):
        values = {
            tolerance: spread.numbers[i, j, k]
            for k, tolerance in enumerate(spread.tolerances)
        }
        columns.append(Column(f"worst {number}", plain_number, values.__getitem__))
    columns += [
        Column("unit", read=lambda each: parameter_unit(train, each.name) or NONE),
        Column("range", read=bounds_text),
    ]
    quantities = "; ".join(
        f"{number} {label(spread.of[j])}" for number, j in enumerate(places, 1)
    )
    title = f"Parameters in the worst case of {quantities}"
    return Table(title, columns, spread.tolerances)


def tolerance_record(
    spread: Spread, checked: Mapping[str, Any] | None
) -> dict[str, Any]:
    """The record of ``tolerance --json``, in SI units."""
    sampled = len(spread.drawn) > 0
    quantities = []
    for j, (objective, name) in enumerate(zip(spread.of, spread.labels, strict=True)):
        record = {
            "name": name,
            "unit": unit_of(objective.quantity),
            "nominal": spread.nominal[:, j],
            "worst": spread.worst[:, j],
            "bound": spread.bound[:, j],
            "no_bound": spread.no_bound[:, j].tolist(),
            "judged": spread.judged[:, j],
            "slopes": spread.slopes[:, j],
            "effects": spread.effects[:, j],
            "numbers_at_worst": spread.numbers[:, j],
        }
        if sampled:
            record["percentiles"] = {
                str(q): spread.percentile(q)[:, j] for q in PERCENT
            }
        if checked:
            record["kind_at_worst"] = [kinds[j] for kinds in checked["worst"]]
        quantities.append(record)
    return {
        "scene": spread.train.topology.name,
        "rpm": spread.rpm,
        "tolerances": [
            {
                "name": tolerance.name,
                "low": tolerance.low,
                "high": tolerance.high,
                "std": tolerance.std,
                "together": tolerance.together,
                "value": float(spread.train.value(tolerance.name)),
                "unit": parameter_unit(spread.train, tolerance.name),
            }
            for tolerance in spread.tolerances
        ],
        "quantities": quantities,
        "kind": checked["nominal"] if checked else None,
        "samples": len(spread.drawn),
        "solved": spread.solved if sampled else None,
        "evaluations": spread.evaluations,
    }


def tolerance_rows(
    spread: Spread, checked: Mapping[str, Any] | None
) -> Iterator[dict[str, Any]]:
    """Rows of ``tolerance --csv``, one for each speed and quantity, SI units."""
    names = [tolerance.name for tolerance in spread.tolerances]
    effects = spread.effects
    percentiles = (
        {f"{q} %": spread.percentile(q) for q in PERCENT} if len(spread.drawn) else {}
    )
    for i, rpm in enumerate(spread.rpm):
        for j, objective in enumerate(spread.of):
            row = {
                "rpm": rpm,
                "quantity": spread.labels[j],
                "unit": unit_of(objective.quantity),
                "judged": bool(spread.judged[i, j]),
                "nominal": spread.nominal[i, j],
                "worst": spread.worst[i, j],
                "bound": spread.bound[i, j],
                "no bound": spread.no_bound[i, j],
            }
            row |= {head: values[i, j] for head, values in percentiles.items()}
            if checked:
                row |= {
                    "kind": checked["nominal"][i],
                    "kind in the worst case": checked["worst"][i][j],
                }
            row |= {
                f"moved by {name}": effects[i, j, k] for k, name in enumerate(names)
            }
            row |= {
                f"worst {name}": spread.numbers[i, j, k] for k, name in enumerate(names)
            }
            yield row

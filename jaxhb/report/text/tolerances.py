"""What tolerances do to a train, in tables for people, a record for programs, and rows
for spreadsheets.
"""

import numpy as np

from jaxhb.design.quantities import label, unit_of
from jaxhb.report.answer import SPEED
from jaxhb.report.text.columns import NONE, count, from_rows, plain_number
from jaxhb.report.text.sentences import remarks_text
from jaxhb.report.text.tuned import parameter_unit, scaled_unit, with_unit

PERCENT = 5, 50, 95  # of the sample
MOVING = 5  # numbers told of a quantity, those that move it most
NEGLIGIBLE = 0.002  # share of the nominal response below which a number moves nothing


def tolerance_parts(spread, checked):
    """Words and tables of a Spread: the worst case of each quantity, over the speeds,
    which numbers move it, where.
    """
    title = spread.train.topology.title
    rpm = spread.rpm
    solved = spread.answered
    head = (
        f"{title} at {SPEED.span(rpm)}: {len(spread.tolerances)} tolerances;"
        f" {spread.evaluations} solves of a speed."
    )
    lost = f"NOT solved, and left out: {', '.join(f'{x:g}' for x in rpm[~solved])} rpm."
    parts = ["\n".join([head, *([] if solved.all() else [lost])])]
    parts += _not_judged(spread)
    if len(_told(spread)):
        parts += [_worst_table(spread)]
        parts += [_over_speeds(spread, j, checked) for j in _told(spread)]
        parts += [
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
    differences = checked["differences"] if checked else []
    return parts + remarks_text(
        differences, "Steady states that are not the periodic motions searched"
    )


def _told(spread):
    """Indices of the quantities that have a value at any speed."""
    return np.flatnonzero(np.isfinite(spread.worst).any(axis=0))


def _not_judged(spread):
    """A line on the speeds for which a rule has no limit, of each share of a limit."""
    said = [
        f"{name} at {', '.join(f'{speed:g}' for speed in spread.rpm[~meant])} rpm"
        for name, meant in zip(spread.labels, spread.judged.T, strict=True)
        if not meant.all()
    ]
    return (
        [f"NOT judged, as the rule has no limit there: {'; '.join(said)}."]
        if said
        else []
    )


def _guarantee(spread):
    """Sentences on what is proved of the worst cases, and where and why it is not."""
    found = spread.answered[:, None] & spread.judged
    asked = spread.no_bound[found]
    bounded = bool((asked == "").any())
    free = bool((asked != "").any())
    loose = any(spread.train.topology.mesh_backlash)
    told = []
    if bounded:
        teeth = (
            ", as long as its teeth stay in contact, in which all of them can run"
            if loose
            else ""
        )
        told.append(
            "No train within the tolerances has more than stands under 'at"
            f" most'{teeth}."
        )
    for reason in dict.fromkeys(asked[asked != ""].tolist()):
        here = (spread.no_bound == reason) & found
        names = [
            name for name, own in zip(spread.labels, here.any(0), strict=True) if own
        ]
        own = "" if len(names) == len(spread.of) else f" of {', '.join(names)}"
        told.append(
            f"No bound{own} at {', '.join(f'{x:g}' for x in spread.rpm[here.any(1)])}"
            f" rpm: {reason}."
        )
    if free:
        there = "There the worst case" if bounded else "The worst case"
        told.append(
            f"{there} is the largest response found: another train within the"
            " tolerances may do worse."
        )
    return told


def _largest(spread, j):
    """Index of the speed at which the worst case of a quantity is largest."""
    return int(np.nanargmax(spread.worst[:, j]))


def _worst_table(spread):
    """Each quantity at its worst speed, as the scene is and within the tolerances."""
    rows = []
    for j in _told(spread):
        one = spread.of[j]
        factor, _ = scaled_unit(one.quantity)
        at = [int(np.nanargmax(spread.nominal[:, j])), _largest(spread, j)]
        old = factor * spread.nominal[at[0], j]
        new = factor * spread.worst[at[1], j]
        rows.append([with_unit(one), count(old), f"{spread.rpm[at[0]]:g}"])
        rows[-1] += [
            count(new),
            f"{spread.rpm[at[1]]:g}",
            f"{new / old:.2f}" if old else NONE,
        ]
    heads = [
        "quantity, worst over the speeds",
        "as it is",
        "at rpm",
        "worst case",
        "at rpm",
        "ratio",
    ]
    return from_rows(
        "Worst case over the tolerances (half peak-to-peak unless called peak or"
        " order)",
        heads,
        rows,
    )


def _over_speeds(spread, j, checked):
    """One quantity over the speeds."""
    factor, _ = scaled_unit(spread.of[j].quantity)
    sampled = len(spread.drawn) > 0
    bounded = np.isfinite(spread.bound[:, j]).any()
    shares = [factor * spread.percentile(q)[:, j] for q in PERCENT] if sampled else []
    kinds = (
        [checked["nominal"], [own[j] for own in checked["worst"]]] if checked else []
    )
    rows = []
    for i, rpm in enumerate(spread.rpm):
        nominal = factor * spread.nominal[i, j]
        worst = factor * spread.worst[i, j]
        row = [
            f"{rpm:g}",
            nominal,
            worst,
            *([factor * spread.bound[i, j]] if bounded else []),
        ]
        row.append(f"{worst / nominal:.2f}" if nominal > 0 else NONE)
        rows.append([*row, *(own[i] for own in shares), *(own[i] for own in kinds)])
    heads = [
        "rpm",
        ("as it is", 1),
        ("worst case", 1),
        *([("at most", 1)] if bounded else []),
        "ratio",
    ]
    heads += [(f"{q} %", 1) for q in PERCENT if sampled]
    heads += ["motion", "in the worst case"] if checked else []
    left = range(len(heads) - 2, len(heads)) if checked else ()
    return from_rows(with_unit(spread.of[j]), heads, rows, left=left)


def _moving(spread):
    """Which numbers move each quantity, where its worst case is largest."""
    rows = []
    for j in _told(spread):
        one = spread.of[j]
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
                    label(one),
                    f"{spread.rpm[i]:g}",
                    spread.tolerances[k].name,
                    f"{share:+.1f}",
                ]
            )
    how = (
        "by regression on the sample"
        if len(spread.drawn) >= 3 * len(spread.tolerances)
        else "by its derivative"
    )
    title = (
        "What moves them: change of the response over half the range of a number,"
        f" {how}, %"
    )
    return from_rows(title, ["quantity", "at rpm", "number", "%"], rows, left=(2,))


def _places(spread):
    """The numbers of each worst case beside their ranges."""
    train = spread.train
    places = {j: _largest(spread, j) for j in _told(spread)}
    rows = []
    for k, one in enumerate(spread.tolerances):
        own = [plain_number(spread.numbers[i, j, k]) for j, i in places.items()]
        unit = parameter_unit(train, one.name) or NONE
        rows.append([one.name, plain_number(float(train.value(one.name))), *own, unit])
        rows[-1].append(f"{plain_number(one.low)} to {plain_number(one.high)}")
    worst = [f"worst {j}" for j in range(1, len(places) + 1)]
    told = "; ".join(
        f"{j} {label(one)}" for j, one in enumerate((spread.of[j] for j in places), 1)
    )
    return from_rows(
        f"Numbers in the worst case of {told}",
        ["number", "as it is", *worst, "unit", "range"],
        rows,
    )


def tolerance_record(spread, checked):
    """What ``tolerance --json`` writes, in SI units."""
    worst = checked["worst"] if checked else None
    return {
        "scene": spread.train.topology.name,
        "rpm": spread.rpm,
        "tolerances": [
            {
                "name": one.name,
                "low": one.low,
                "high": one.high,
                "std": one.std,
                "together": one.together,
            }
            | {
                "value": float(spread.train.value(one.name)),
                "unit": parameter_unit(spread.train, one.name),
            }
            for one in spread.tolerances
        ],
        "quantities": [
            {
                "name": name,
                "unit": unit_of(one.quantity),
                "nominal": spread.nominal[:, j],
                "worst": spread.worst[:, j],
            }
            | {"bound": spread.bound[:, j], "no_bound": spread.no_bound[:, j].tolist()}
            | {"judged": spread.judged[:, j]}
            | {
                "slopes": spread.slopes[:, j],
                "effects": spread.effects[:, j],
                "numbers_at_worst": spread.numbers[:, j],
            }
            | (
                {"percentiles": {str(q): spread.percentile(q)[:, j] for q in PERCENT}}
                if len(spread.drawn)
                else {}
            )
            | ({"kind_at_worst": [own[j] for own in worst]} if checked else {})
            for j, (one, name) in enumerate(zip(spread.of, spread.labels, strict=True))
        ],
        "kind": checked["nominal"] if checked else None,
        "samples": len(spread.drawn),
        "solved": spread.solved if len(spread.drawn) else None,
        "evaluations": spread.evaluations,
    }


def tolerance_rows(spread, checked):
    """Rows of ``tolerance --csv``, one for each speed and quantity, SI units."""
    names = [one.name for one in spread.tolerances]
    effects = spread.effects
    sampled = (
        {f"{q} %": spread.percentile(q) for q in PERCENT} if len(spread.drawn) else {}
    )
    for i, rpm in enumerate(spread.rpm):
        for j, one in enumerate(spread.of):
            row = {
                "rpm": rpm,
                "quantity": spread.labels[j],
                "unit": unit_of(one.quantity),
            }
            row["judged"] = bool(spread.judged[i, j])
            row |= {"nominal": spread.nominal[i, j], "worst": spread.worst[i, j]}
            row |= {"bound": spread.bound[i, j], "no bound": spread.no_bound[i, j]}
            row |= {head: own[i, j] for head, own in sampled.items()}
            if checked:
                row |= {
                    "kind": checked["nominal"][i],
                    "kind in the worst case": checked["worst"][i][j],
                }
            row |= {
                f"moved by {name}": effects[i, j, k] for k, name in enumerate(names)
            }
            yield row | {
                f"worst {name}": spread.numbers[i, j, k] for k, name in enumerate(names)
            }

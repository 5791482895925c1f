"""What a fit to measurements found: tables for people, a record for programs, and the
scene with fitted numbers.
"""

import numpy as np

from jaxhb.design.identification import APART, MOST_MISFIT
from jaxhb.design.measurements import UNITS
from jaxhb.report.orders import NUMBERS, order_names
from jaxhb.report.quantities import shown_unit
from jaxhb.report.text.columns import NONE, count, from_rows, plain_number
from jaxhb.report.text.sentences import remarks_text
from jaxhb.report.text.tuned import parameter_unit


def identified_text(found):
    """Fitted numbers beside the scene's, what the data leave open, and how far orders
    are off before and after.
    """
    rows = found.measured
    speeds = len(np.unique(found.measured.rpm))
    head = (
        f"{found.train.topology.title}: {len(rows.rpm)} measured amplitudes at {speeds}"
        " speeds, "
    )
    head += (
        f"{int(np.isfinite(rows.phase).sum())} with a phase; {len(found.parameters)}"
        " numbers fitted."
    )
    told = goodness(found)
    told += " Intervals are as much wider, and something is not in the scene." * (
        found.misfit > MOST_MISFIT
    )
    said = [
        f"NOT determined by these data: {', '.join(found.open)}. Measure elsewhere, or"
        " keep the scene's numbers."
    ]
    said = said * bool(found.open)
    if pairs := [f"{a} and {b} ({value:+.2f})" for a, b, value in found.alike()]:
        said.append(f"Hardly told apart (correlation): {'; '.join(pairs)}.")
    said += [f"Left out: {sentence}" for sentence in found.left_out]
    names = order_names(found.train)
    both = {"scene off, %": found.before_computed, "fitted off, %": found.computed}
    return "\n\n".join(
        [
            "\n".join([head, told]),
            _numbers(found),
            *remarks_text(said, ""),
            _residuals(found, both, names),
        ]
    )


def goodness(found):
    """How well what was found explains the measured amplitudes."""
    left = (
        f"{found.kept.sum()} of {len(found.kept)} amplitudes are"
        if found.left_out
        else "The amplitudes are"
    )
    return (
        f"{left} explained to {100 * max(found.explained, 0.0):.4g} %; residuals are"
        f" {found.misfit:.2f} times the noise that was taken (reduced chi-square"
        f" {found.misfit**2:.3g})."
    )


def _numbers(found):
    rows = []
    for one, before, value, std in zip(
        found.parameters, found.before, found.values, found.std, strict=True
    ):
        remark = (
            "open"
            if one.name in found.open
            else "at its bound"
            if one.name in found.at_bound
            else ""
        )
        unit = parameter_unit(found.train, one.name) or NONE
        rows.append(
            [
                one.name,
                plain_number(before),
                plain_number(value),
                count(std),
                f"{100 * std / abs(value):.1f}",
            ]
        )
        rows[-1] += [
            unit,
            f"{plain_number(one.low)} to {plain_number(one.high)}",
            remark,
        ]
    heads = ["number", "scene", "fitted", "+- (1 deviation)", "%", "unit", "bounds", ""]
    return from_rows("Numbers", heads, rows, left=(7,))


def _residuals(found, computed, names):
    """Root mean squares of what is measured and of its difference from what is
    ``computed``, by head, for each element and order, of which ``names`` tell; of the
    rows that were kept.
    """
    rows = []
    measured = found.measured
    size = found.measured.amplitude
    target = size * np.exp(1j * np.deg2rad(np.nan_to_num(measured.phase)))
    differences = [
        np.where(
            np.isfinite(measured.phase), np.abs(values - target), np.abs(values) - size
        )
        for values in computed.values()
    ]
    keys = list(
        zip(measured.quantity, measured.element, map(str, measured.order), strict=True)
    )
    for quantity, element, order in dict.fromkeys(keys):
        own = found.kept & np.array([key == (quantity, element, order) for key in keys])
        if not own.any():
            continue
        factor, unit = shown_unit(UNITS[quantity])
        offs = [
            100 * np.sqrt((off[own] ** 2).mean() / (size[own] ** 2).mean())
            for off in differences
        ]
        called = "sum" if order == "nan" else names.number(float(order))
        mean = count(factor * np.sqrt((size[own] ** 2).mean()))
        rows.append(
            [
                f"{quantity} of {element}",
                called,
                f"{mean} {unit}",
                *(f"{off:.1f}" for off in offs),
            ]
        )
    return from_rows(
        "Residuals over the speeds",
        ["measured", "order", "root mean square", *computed],
        rows,
    )


def identified_record(found):
    """What ``identify --json`` writes, in SI units."""
    fields = "rpm", "order", "quantity", "element", "amplitude", "phase"
    measured = zip(*(getattr(found.measured, field) for field in fields), strict=True)
    known = np.where(found.kept, found.computed, np.nan)
    return {
        "scene": found.train.topology.name,
        "misfit": found.misfit,
        "explained": found.explained,
        "left_out": found.left_out,
        "parameters": [
            {
                "name": one.name,
                "before": before,
                "value": value,
                "std": std,
                "low": one.low,
                "high": one.high,
            }
            | {
                "unit": parameter_unit(found.train, one.name),
                "open": one.name in found.open,
            }
            for one, before, value, std in zip(
                found.parameters, found.before, found.values, found.std, strict=True
            )
        ],
        "correlation": found.correlation,
        "rows": [
            dict(zip(fields, row, strict=True))
            | {
                "computed": abs(value),
                "computed_phase": float(np.rad2deg(np.angle(value))),
                "sigma": sigma,
            }
            for row, value, sigma in zip(measured, known, found.sigma, strict=True)
        ],
    }


def weak_text(found, names=NUMBERS):
    """Which cylinder is weak, that none is, or that no cylinder alone explains the
    measurements.
    """
    rows = [
        [
            name,
            f"{100 * factor:.1f}",
            f"{100 * std:.1f}",
            count(more),
            "at its bound" * (name in found.at_bound),
        ]
        for name, factor, std, more in zip(
            found.names, found.gas_factor, found.std, found.evidence, strict=True
        )
    ]
    heads = [
        "cylinder, if it alone differs",
        "burns, %",
        "+-",
        "worse than the first by (chi-square)",
        "",
    ]
    table = from_rows("Weak cylinder", heads, rows, left=(4,))
    first = found.names[0]
    share = f"{100 * found.gas_factor[0]:.0f} % of what the others do"
    if not found.explains:
        said = (
            "No verdict: no cylinder that alone differs explains the measurements, as"
            f" even the best fit leaves residuals {found.misfit:.3g} times the noise"
            f" (at most {MOST_MISFIT:g}). Something else is not as in the scene: fit"
            " its stiffnesses and inertias first (--fit), or say how noisy the data"
            " are (--noise)."
        )
    elif found.all_equal < APART:
        said = (
            "No cylinder differs: with equal cylinders the measurements are explained"
            " as well."
        )
    elif len(found.likely) > 1:
        said = (
            f"These are not told apart by the measurements: {', '.join(found.likely)}."
        )
    elif first in found.at_bound and found.gas_factor[0] > 1:
        said = f"{first} burns at least {share}, the most that is looked for."
    else:
        said = f"{first} burns {share}."
    remarks = remarks_text([f"Left out: {sentence}" for sentence in found.left_out], "")
    residuals = _residuals(found, {f"off with {first}, %": found.computed}, names)
    return "\n\n".join([f"{said}\n{goodness(found)}", table, *remarks, residuals])


def weak_record(found):
    """The same for programs."""
    return {
        "weak_cylinder": [
            {
                "name": name,
                "gas_factor": factor,
                "std": std,
                "evidence": more,
                "at_bound": name in found.at_bound,
            }
            for name, factor, std, more in zip(
                found.names, found.gas_factor, found.std, found.evidence, strict=True
            )
        ],
        "all_equal": found.all_equal,
        "explains": found.explains,
        "misfit": found.misfit,
        "explained": found.explained,
        "left_out": found.left_out,
    }

"""Results of measurements: orders of a rotation, and fits to them, as tables for people
and records for programs.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxhb.design.identification import (
    APART,
    MOST_MISFIT,
    Identification,
    WeakCylinder,
)
from jaxhb.design.measurements import COLUMNS
from jaxhb.design.signals.orders import QUANTITIES, MeasuredOrders
from jaxhb.report.files.output import Sheet
from jaxhb.report.orders import NUMBERS, OrderNames, order_names
from jaxhb.report.table import Column, Table
from jaxhb.report.text.columns import NONE, count, plain_number
from jaxhb.report.text.sentences import remarks_text
from jaxhb.report.text.tuned import bounds_text, parameter_unit
from jaxhb.report.units import shown_unit
from jaxhb.results.quantities import MEASURED


def identified_text(fit: Identification) -> str:
    """Fitted numbers beside the scene's, numbers that the data leave open, and how far
    orders are off before and after.
    """
    measured = fit.measured
    speeds = len(np.unique(measured.rpm))
    explained = goodness(fit)
    if fit.misfit > MOST_MISFIT:
        explained += " Intervals are as much wider, and something is not in the scene."
    remarks = []
    if fit.open:
        remarks.append(
            f"NOT determined by these data: {', '.join(fit.open)}. Measure elsewhere,"
            " or keep the scene's values."
        )
    pairs = [f"{a} and {b} ({value:+.2f})" for a, b, value in fit.alike()]
    if pairs:
        remarks.append(f"Hardly distinguishable (correlation): {'; '.join(pairs)}.")
    remarks += [f"Left out: {sentence}" for sentence in fit.left_out]
    computed = {"scene off, %": fit.before_computed, "fitted off, %": fit.computed}
    return "\n\n".join(
        [
            f"{fit.train.topology.title}: {len(measured.rpm)} measured amplitudes at"
            f" {speeds} speeds, {int(np.isfinite(measured.phase).sum())} with a phase;"
            f" {len(fit.parameters)} parameters fitted.\n{explained}",
            _numbers(fit),
            *remarks_text(remarks, ""),
            _residuals(fit, computed, order_names(fit.train)),
        ]
    )


def goodness(fit: Identification | WeakCylinder) -> str:
    """Sentence on how well a fit explains the measured amplitudes."""
    amplitudes = (
        f"{fit.kept.sum()} of {len(fit.kept)} amplitudes are"
        if fit.left_out
        else "The amplitudes are"
    )
    return (
        f"{amplitudes} explained to {100 * max(fit.explained, 0.0):.4g} %; residuals"
        f" are {fit.misfit:.2f} times the assumed noise (reduced chi-square"
        f" {fit.misfit**2:.3g})."
    )


def _numbers(fit: Identification) -> Table:
    """A row for every fitted number: before and after, its deviation and bounds."""
    rows = [
        [
            parameter.name,
            before,
            value,
            std,
            100 * std / abs(value),
            parameter_unit(fit.train, parameter.name) or NONE,
            bounds_text(parameter),
            "open"
            if parameter.name in fit.open
            else "at its bound" * (parameter.name in fit.at_bound),
        ]
        for parameter, before, value, std in zip(
            fit.parameters, fit.before, fit.values, fit.std, strict=True
        )
    ]
    return Table(
        "Parameters",
        [
            "parameter",
            Column("scene", plain_number),
            Column("fitted", plain_number),
            Column("+- (1 deviation)", count),
            Column("%", "{:.1f}".format),
            "unit",
            "bounds",
            Column("", left=True),
        ],
        rows,
    )


def _residuals(
    fit: Identification | WeakCylinder,
    computed: Mapping[str, np.ndarray],
    names: OrderNames,
) -> Table:
    """Root mean squares of the measured amplitudes and of their differences from the
    complex amplitudes ``(R,)`` that are ``computed``, by head, for each element and
    order, of which ``names`` tell; of the rows that were fitted.
    """
    rows = []
    measured = fit.measured
    size = measured.amplitude
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
        chosen = fit.kept & np.array(
            [key == (quantity, element, order) for key in keys]
        )
        if not chosen.any():
            continue
        factor, unit = shown_unit(MEASURED[quantity].unit)
        mean_square = (size[chosen] ** 2).mean()
        offs = [
            100 * np.sqrt((difference[chosen] ** 2).mean() / mean_square)
            for difference in differences
        ]
        called = "sum" if order == "nan" else names.number(float(order))
        root = count(factor * np.sqrt(mean_square))
        rows.append(
            [
                f"{quantity} of {element}",
                called,
                f"{root} {unit}",
                *(f"{off:.1f}" for off in offs),
            ]
        )
    return Table(
        "Residuals over the speeds",
        ["measured", "order", "root mean square", *computed],
        rows,
    )


def identified_record(fit: Identification) -> dict[str, Any]:
    """The record of ``identify --json``, in SI units."""
    fields = "rpm", "order", "quantity", "element", "amplitude", "phase"
    measured = zip(*(getattr(fit.measured, field) for field in fields), strict=True)
    computed = np.where(fit.kept, fit.computed, np.nan)
    return {
        "scene": fit.train.topology.name,
        "misfit": fit.misfit,
        "explained": fit.explained,
        "left_out": fit.left_out,
        "parameters": [
            {
                "name": parameter.name,
                "before": before,
                "value": value,
                "std": std,
                "low": parameter.low,
                "high": parameter.high,
                "unit": parameter_unit(fit.train, parameter.name),
                "open": parameter.name in fit.open,
            }
            for parameter, before, value, std in zip(
                fit.parameters, fit.before, fit.values, fit.std, strict=True
            )
        ],
        "correlation": fit.correlation,
        "rows": [
            dict(zip(fields, row, strict=True))
            | {
                "computed": abs(value),
                "computed_phase": float(np.rad2deg(np.angle(value))),
                "sigma": sigma,
            }
            for row, value, sigma in zip(measured, computed, fit.sigma, strict=True)
        ],
    }


def weak_text(fit: WeakCylinder, names: OrderNames = NUMBERS) -> str:
    """Say which cylinder is weak, that none is, or that no cylinder alone explains the
    measurements.
    """
    percent = "{:.1f}".format
    table = Table(
        "Weak cylinder",
        [
            "cylinder, if it alone differs",
            Column("burns, %", percent),
            Column("+-", percent),
            Column("worse than the first by (chi-square)", count),
            Column("", left=True),
        ],
        [
            [
                name,
                100 * factor,
                100 * std,
                evidence,
                "at its bound" * (name in fit.at_bound),
            ]
            for name, factor, std, evidence in zip(
                fit.names, fit.gas_factor, fit.std, fit.evidence, strict=True
            )
        ],
    )
    first = fit.names[0]
    share = f"{100 * fit.gas_factor[0]:.0f} % of what the others do"
    if not fit.explains:
        verdict = (
            "No verdict: no single cylinder explains the measurements, as"
            f" even the best fit leaves residuals {fit.misfit:.3g} times the noise"
            f" (at most {MOST_MISFIT:g}). Something else is not as in the scene: fit"
            " its stiffnesses and inertias first (--fit), or say how noisy the data"
            " are (--noise)."
        )
    elif fit.all_equal < APART:
        verdict = (
            "No cylinder differs: with equal cylinders the measurements are explained"
            " as well."
        )
    elif len(fit.likely) > 1:
        verdict = (
            "These are not distinguishable by the measurements:"
            f" {', '.join(fit.likely)}."
        )
    elif first in fit.at_bound and fit.gas_factor[0] > 1:
        verdict = f"{first} burns at least {share}, the upper limit of the search."
    else:
        verdict = f"{first} burns {share}."
    remarks = remarks_text([f"Left out: {sentence}" for sentence in fit.left_out], "")
    residuals = _residuals(fit, {f"residual with {first}, %": fit.computed}, names)
    return "\n\n".join([f"{verdict}\n{goodness(fit)}", table, *remarks, residuals])


def weak_record(fit: WeakCylinder) -> dict[str, Any]:
    """The record of ``identify --weak-cylinder --json``."""
    return {
        "weak_cylinder": [
            {
                "name": name,
                "gas_factor": factor,
                "std": std,
                "evidence": evidence,
                "at_bound": name in fit.at_bound,
            }
            for name, factor, std, evidence in zip(
                fit.names, fit.gas_factor, fit.std, fit.evidence, strict=True
            )
        ],
        "all_equal": fit.all_equal,
        "explains": fit.explains,
        "misfit": fit.misfit,
        "explained": fit.explained,
        "left_out": fit.left_out,
    }


LISTED = 8  # orders of a table, the largest


def largest_orders(values: np.ndarray, most: int) -> list[int]:
    """Places of the largest of K orders over all speeds, of amplitudes ``(B, K)``, in
    rising order.
    """
    sizes = np.abs(values).max(axis=0)
    return sorted(map(int, np.argsort(-sizes, kind="stable")[:most]))


def measured_text(found: MeasuredOrders, quantity: str, name: str) -> str:
    """The largest orders of a measured rotation over the speed."""
    values = found.values(quantity)
    factor, unit = shown_unit(MEASURED[quantity].unit)
    places = largest_orders(values, LISTED)
    noise = np.abs(found.noise[:, :1] / found.angle[:, :1]) * np.abs(values[:, :1])
    phased = "with phases" if found.phased else "without phases, as there is no mark"
    caption = (
        f"{name}: {found.blocks.sum()} blocks in {len(found.rpm)} windows of speed,"
        f" {phased}.\nAmplitudes of the {quantity} by order, {unit}"
    )
    columns = [
        Column("rpm", "{:.1f}".format),
        Column("blocks", str),
        *(Column(f"{found.orders[place]:g}", "amplitude") for place in places),
        Column(f"noise of order {found.orders[0]:g}", "{:.2g}".format),
    ]
    rows = [
        [
            rpm,
            blocks,
            *(factor * abs(row[place]) for place in places),
            factor * float(own_noise[0]),
        ]
        for rpm, blocks, row, own_noise in zip(
            found.rpm, found.blocks, values, noise, strict=True
        )
    ]
    return "\n\n".join([Table(caption, columns, rows), *remarks_text(found.notes, "")])


def measured_sheet(found: MeasuredOrders, element: str, quantity: str) -> Sheet:
    """Rows of a file as :func:`jaxhb.design.read_measured` reads it."""
    rows = found.rows(element, quantity)
    columns = [getattr(rows, name) for name in COLUMNS]
    return Sheet(COLUMNS, [list(row) for row in zip(*columns, strict=True)])


def measured_record(found: MeasuredOrders, name: str, element: str) -> dict[str, Any]:
    """The record of ``orders --json``, in SI units; phases are null without a mark."""
    windows = [
        {
            "rpm": rpm,
            "blocks": int(blocks),
            "noise_rad": noise,
            **{
                quantity: _listed(found, found.values(quantity)[row])
                for quantity in QUANTITIES
            },
        }
        for row, (rpm, blocks, noise) in enumerate(
            zip(found.rpm, found.blocks, found.noise, strict=True)
        )
    ]
    return {
        "recorded": name,
        "element": element or None,
        "phased": found.phased,
        "notes": found.notes,
        "windows": windows,
    }


def _listed(found: MeasuredOrders, values: np.ndarray) -> list[list[Any]]:
    """Rows of order, amplitude and phase in deg."""
    phases = np.rad2deg(np.angle(values)) if found.phased else [None] * len(values)
    return [
        [order, abs(value), phase]
        for order, value, phase in zip(found.orders, values, phases, strict=True)
    ]

"""What a fit to measurements found: tables for people, a record for programs, and the scene with fitted numbers."""

import numpy as np

from jaxhb.design.measurements import UNITS
from jaxhb.report.quantities import shown_unit
from jaxhb.report.text.columns import NONE, count, from_rows, plain_number
from jaxhb.report.text.sentences import remarks_text
from jaxhb.report.text.tuned import parameter_unit


def identified_text(found):
    """Fitted numbers beside the scene's, what the data leave open, and how far orders are off before and after."""
    rows, speeds = found.measured, len(np.unique(found.measured.rpm))
    head = f"{found.train.topology.title}: {len(rows.rpm)} measured amplitudes at {speeds} speeds, "
    head += f"{int(np.isfinite(rows.phase).sum())} with a phase; {len(found.parameters)} numbers fitted."
    told = f"Residuals are {found.misfit:.2f} times the noise that was taken" + (
        ": intervals are as much wider, and something is not in the scene." if found.misfit > 2 else "."
    )
    said = [f"NOT determined by these data: {', '.join(found.open)}. Measure elsewhere, or keep the scene's numbers."]
    said = said * bool(found.open)
    if pairs := [f"{a} and {b} ({value:+.2f})" for a, b, value in found.alike()]:
        said.append(f"Hardly told apart (correlation): {'; '.join(pairs)}.")
    return "\n\n".join(["\n".join([head, told]), _numbers(found), *remarks_text(said, ""), _residuals(found)])


def _numbers(found):
    rows = []
    for one, before, value, std in zip(found.parameters, found.before, found.values, found.std, strict=True):
        remark = "open" if one.name in found.open else "at its bound" if one.name in found.at_bound else ""
        unit = parameter_unit(found.train, one.name) or NONE
        rows.append([one.name, plain_number(before), plain_number(value), count(std), f"{100 * std / abs(value):.1f}"])
        rows[-1] += [unit, f"{plain_number(one.low)} to {plain_number(one.high)}", remark]
    heads = ["number", "scene", "fitted", "+- (1 deviation)", "%", "unit", "bounds", ""]
    return from_rows("Numbers", heads, rows, left=(7,))


def _residuals(found):
    """Root mean squares of what is measured and of its difference from what is computed, by element and order."""
    rows, measured, size = [], found.measured, found.measured.amplitude
    target = size * np.exp(1j * np.deg2rad(np.nan_to_num(measured.phase)))
    both = [
        np.where(np.isfinite(measured.phase), np.abs(computed - target), np.abs(computed) - size)
        for computed in (found.before_computed, found.computed)
    ]
    keys = list(zip(measured.quantity, measured.element, map(str, measured.order), strict=True))
    for quantity, element, order in dict.fromkeys(keys):
        own = np.array([key == (quantity, element, order) for key in keys])
        factor, unit = shown_unit(UNITS[quantity])
        offs = [100 * np.sqrt((off[own] ** 2).mean() / (size[own] ** 2).mean()) for off in both]
        called = "sum" if order == "nan" else f"{float(order):g}"
        mean = count(factor * np.sqrt((size[own] ** 2).mean()))
        rows.append([f"{quantity} of {element}", called, f"{mean} {unit}", *(f"{off:.1f}" for off in offs)])
    heads = ["measured", "order", "root mean square", "scene off, %", "fitted off, %"]
    return from_rows("Residuals over the speeds", heads, rows)


def identified_record(found):
    """What ``identify --json`` writes, in SI units."""
    fields = "rpm", "order", "quantity", "element", "amplitude", "phase"
    measured = zip(*(getattr(found.measured, field) for field in fields), strict=True)
    return {
        "scene": found.train.topology.name,
        "misfit": found.misfit,
        "parameters": [
            {"name": one.name, "before": before, "value": value, "std": std, "low": one.low, "high": one.high}
            | {"unit": parameter_unit(found.train, one.name), "open": one.name in found.open}
            for one, before, value, std in zip(found.parameters, found.before, found.values, found.std, strict=True)
        ],
        "correlation": found.correlation,
        "rows": [
            dict(zip(fields, row, strict=True))
            | {"computed": abs(own), "computed_phase": float(np.rad2deg(np.angle(own))), "sigma": sigma}
            for row, own, sigma in zip(measured, found.computed, found.sigma, strict=True)
        ],
    }


def weak_text(found):
    """Which cylinder is weak, or that none is."""
    rows = [
        [name, f"{100 * factor:.1f}", f"{100 * std:.1f}", count(more)]
        for name, factor, std, more in zip(found.names, found.gas_factor, found.std, found.evidence, strict=True)
    ]
    heads = ["cylinder, if it alone differs", "burns, %", "+-", "worse than the first by (chi-square)"]
    table = from_rows("Weak cylinder", heads, rows)
    if found.all_equal < 4.0:
        said = "No cylinder differs: with equal cylinders the measurements are explained as well."
    elif len(found.likely) > 1:
        said = f"These are not told apart by the measurements: {', '.join(found.likely)}."
    else:
        said = f"{found.names[0]} burns {100 * found.gas_factor[0]:.0f} % of what the others do."
    return f"{said}\n\n{table}"


def weak_record(found):
    """The same for programs."""
    return {
        "weak_cylinder": [
            {"name": name, "gas_factor": factor, "std": std, "evidence": more}
            for name, factor, std, more in zip(found.names, found.gas_factor, found.std, found.evidence, strict=True)
        ],
        "all_equal": found.all_equal,
    }

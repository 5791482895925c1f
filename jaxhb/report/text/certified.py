"""The computed bound of a solution in words and numbers: how far off its tooth forces
and deflections can be.
"""

from typing import Any

import numpy as np

from jaxhb.report.answer import Answer
from jaxhb.report.table import Column, Table
from jaxhb.report.text.columns import plain_number
from jaxhb.report.units import shown_unit
from jaxhb.results.bounds import MARGINS, NORM_MARGIN, ROW_SUM_MARGIN, Certificate

_STABLE = {
    True: "within the bound it is",
    False: "within the bound it is not",
    None: "not decided by the bound",
}
_NUMBERS = "stable", "Y0", "Z1", "Z2", "h0", "radius", "small_gain", "harmonics", "low"


def certificate_text(answer: Answer) -> list[str]:
    """The parts of :func:`certificate_parts` as one text, in a list; empty where no
    bound was asked for.
    """
    certificate = answer.certificate
    if not isinstance(certificate, Certificate | str):
        return []
    return ["\n".join(certificate_parts(answer, certificate))]


def certificate_parts(answer: Answer, certificate: Certificate | str) -> list[str]:
    """The bound as a paragraph and a :class:`~jaxhb.report.table.Table`; what
    failed where there is none. ``certificate`` is a sentence where it was refused.
    """
    if isinstance(certificate, str):
        return [f"Computed bound: none. {certificate}"]
    if not certificate.holds:
        return [f"Computed bound: none: {certificate.reason}"]
    if not certificate.meshes:
        return [
            "Computed bound: no mesh has backlash: the equations are linear, solved to"
            " rounding."
        ]
    factor, unit = shown_unit("N")
    forces = [factor * float(answer.force(name).peak) for name in certificate.meshes]
    bounds = [
        _force_and_bound(force, factor * bound)
        for force, bound in zip(forces, certificate.force_bound, strict=True)
    ]
    rows = [
        (name, *texts, 1e6 * deflection)
        for name, texts, deflection in zip(
            certificate.meshes, bounds, certificate.deflection_bound, strict=True
        )
    ]
    force, bound = bounds[int(np.argmax(forces))]
    paragraph = (
        f"Computed bound: the largest tooth force is {force} {unit}, within {bound}"
        f" {unit} of that of a periodic motion of the train\n({MARGINS}; no"
        " proof).\nWhether that"
        f" motion is stable: {_STABLE[certificate.stable]}."
    )
    deflection = Column("deflection within um", _up)
    table = Table("", ["mesh", f"largest {unit}", f"within {unit}", deflection], rows)
    return [paragraph, table]


def _force_and_bound(value: float, bound: float) -> tuple[str, str]:
    """A number with the digits that its bound leaves, and the bound with what rounding
    takes from them, as texts.
    """
    size = int(np.floor(np.log10(abs(value)))) if value else 0
    decimals = 2 - int(np.floor(np.log10(bound))) if bound > 0 else 0
    places = max(int(np.clip(decimals, 3 - size, 9 - size)), 0)
    return f"{value:.{places}f}", _up(bound + 0.5 * 10.0**-places)


def _up(bound: float) -> str:
    """A bound as text with two digits that is not below it."""
    if bound > 0:
        unit = 10.0 ** (np.floor(np.log10(bound)) - 1)
        bound = np.ceil(bound / unit * (1 - 1e-12)) * unit
    return plain_number(bound, 2)


def certificate_record(certificate: Certificate | str) -> dict[str, Any]:
    """The bound for programs: bounds in N and m by mesh, and the numbers of the
    theorem.
    """
    if isinstance(certificate, str):
        return {"certificate": {"holds": False, "reason": certificate}}
    bounds = zip(
        certificate.meshes,
        certificate.force_bound,
        certificate.elastic_bound,
        certificate.deflection_bound,
        strict=True,
    )
    meshes = {
        name: {
            "force_N": force,
            "elastic_force_N": elastic_force,
            "deflection_m": deflection,
        }
        for name, force, elastic_force, deflection in bounds
    }
    record = {
        "holds": certificate.holds,
        "reason": certificate.reason,
        "meshes": meshes,
    }
    record["margins"] = {
        "iterated_norms": NORM_MARGIN,
        "estimated_row_sums": ROW_SUM_MARGIN,
    }
    record |= {key: getattr(certificate, key) for key in _NUMBERS}
    balance = certificate.harmonic_balance
    if balance is not None:
        record["harmonic_balance"] = {
            key: float(getattr(balance, key))
            for key in ("H0", "delta0", "K", "h0", "radius")
        }
    return {"certificate": record}

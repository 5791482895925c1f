"""The computed bound of a solution in words and numbers: how far off its tooth forces
and deflections can be.
"""

import numpy as np

from jaxhb.report.text.columns import from_rows, plain_number
from jaxhb.results.bounds import MARGINS, NORM_MARGIN, ROW_SUM_MARGIN

_STABLE = {
    True: "within the bound it is",
    False: "within the bound it is not",
    None: "not decided by the bound",
}
_NUMBERS = "stable", "Y0", "Z1", "Z2", "h0", "radius", "small_gain", "harmonics", "low"


def certificate_text(answer):
    """The parts of :func:`certificate_parts` as one text, in a list; empty where no
    bound was asked for.
    """
    return (
        []
        if answer.certificate is None
        else ["\n".join(certificate_parts(answer, answer.certificate))]
    )


def certificate_parts(answer, found):
    """The bound, a :class:`jaxhb.Certificate`, as a paragraph and a :class:`Table`;
    what failed where there is none.
    """
    if isinstance(found, str):
        return [f"Computed bound: none. {found}"]
    if not found.holds:
        return [f"Computed bound: none: {found.reason}"]
    if not found.meshes:
        return [
            "Computed bound: no mesh has backlash: the equations are linear, solved to"
            " rounding."
        ]
    forces = [float(answer.force(name).peak) / 1e3 for name in found.meshes]
    bounds = [
        _beside(force, bound / 1e3)
        for force, bound in zip(forces, found.force_bound, strict=True)
    ]
    rows = [
        (name, *both, 1e6 * deflection)
        for name, both, deflection in zip(
            found.meshes, bounds, found.deflection_bound, strict=True
        )
    ]
    force, bound = bounds[int(np.argmax(forces))]
    said = (
        f"Computed bound: the largest tooth force is {force} kN, within {bound} kN of"
        f" that of a periodic motion of the train\n({MARGINS}; no proof).\nWhether that"
        f" motion is stable: {_STABLE[found.stable]}."
    )
    heads = "mesh", "largest kN", "within kN", ("deflection within um", _up)
    return [said, from_rows("", heads, rows)]


def _beside(value, bound):
    """A number with the digits that its bound leaves, and the bound with what rounding
    takes from them, as texts.
    """
    size = int(np.floor(np.log10(abs(value)))) if value else 0
    wanted = 2 - int(np.floor(np.log10(bound))) if bound > 0 else 0
    places = max(int(np.clip(wanted, 3 - size, 9 - size)), 0)
    return f"{value:.{places}f}", _up(bound + 0.5 * 10.0**-places)


def _up(bound):
    """A bound as text with two digits that is not below it."""
    if bound > 0:
        unit = 10.0 ** (np.floor(np.log10(bound)) - 1)
        bound = np.ceil(bound / unit * (1 - 1e-12)) * unit
    return plain_number(bound, 2)


def certificate_record(found):
    """The same for programs: bounds in N and m by mesh, and the numbers of the
    theorem.
    """
    if isinstance(found, str):
        return {"certificate": {"holds": False, "reason": found}}
    bounds = zip(
        found.meshes,
        found.force_bound,
        found.elastic_bound,
        found.deflection_bound,
        strict=True,
    )
    meshes = {
        name: {"force_N": a, "elastic_force_N": b, "deflection_m": c}
        for name, a, b, c in bounds
    }
    own = {"holds": found.holds, "reason": found.reason, "meshes": meshes}
    own["margins"] = {
        "iterated_norms": NORM_MARGIN,
        "estimated_row_sums": ROW_SUM_MARGIN,
    }
    own |= {key: getattr(found, key) for key in _NUMBERS}
    balance = found.harmonic_balance
    if balance is not None:
        own["harmonic_balance"] = {
            key: float(getattr(balance, key))
            for key in ("H0", "delta0", "K", "h0", "radius")
        }
    return {"certificate": own}

"""The computed bound of a solution in words and numbers: how far off its tooth forces and deflections can be."""

import numpy as np

from jaxhb.certificate.certificate import certify
from jaxhb.report.answer import UNCONFIRMED
from jaxhb.report.text.columns import Table, alike
from jaxhb.report.text.mean_torques import plain_number
from jaxhb.results.bounds import MARGINS, NORM_MARGIN, ROW_SUM_MARGIN
from jaxhb.results.status import NotConverged

_STABLE = {True: "within the bound it is", False: "within the bound it is not", None: "not decided by the bound"}


def certificate_of(answer, say=lambda text: None):
    """The Certificate of an answer's harmonic solution; a sentence where there can be none."""
    if answer.response is None and answer.known:
        why = f"The motion is {UNCONFIRMED}" if answer.unconfirmed else "The motion does not repeat itself"
        return f"{why}: a computed bound needs a harmonic solution (--orbit asks for one)."
    if not answer.known:
        return "There is no solution."
    say(f"{answer.rpm:g} rpm: how far off can it be?")
    try:
        return certify(answer.response)
    except (ValueError, NotConverged) as refusal:
        return str(refusal)


def certificate_text(answer, found):
    """The parts of :func:`certificate_parts` as one text."""
    return "\n".join(certificate_parts(answer, found))


def certificate_parts(answer, found):
    """The bound, as a paragraph and a table; what failed where there is none.

    Parameters
    ----------
    answer : Answer
    found : Certificate or str

    Returns
    -------
    list of str
        The last is a :class:`Table` where a bound holds.
    """
    if isinstance(found, str):
        return [f"Computed bound: none. {found}"]
    if not found.holds:
        return [f"Computed bound: none: {found.reason}"]
    if not found.meshes:
        return ["Computed bound: no mesh has backlash: the equations are linear, solved to rounding."]
    forces = np.array([answer.force(name).peak for name in found.meshes]) / 1e3
    hardest = int(np.argmax(forces))
    bounds = found.force_bound / 1e3
    largest, within = f"{forces[hardest]:.4g} kN", f"{plain_number(_up(bounds[hardest]), 2)} kN"
    said = (
        f"Computed bound: the largest tooth force is {largest}, within {within} of that of a periodic motion of the "
        "train\n"
        f"({MARGINS}; no proof).\n"
        f"Whether that motion is stable: {_STABLE[found.stable]}."
    )
    columns = [
        found.meshes,
        *alike(forces),
        [plain_number(_up(bound), 2) for bound in bounds],
        [plain_number(_up(1e6 * bound), 2) for bound in found.deflection_bound],
    ]
    return [said, Table("", ["mesh", "largest kN", "within kN", "deflection within um"], columns)]


def _up(bound):
    """A bound with two digits that is not below it."""
    if not bound > 0:
        return bound
    unit = 10.0 ** (np.floor(np.log10(bound)) - 1)
    return np.ceil(bound / unit * (1 - 1e-12)) * unit


def certificate_record(found):
    """The same for programs: bounds in N and m by mesh, and the numbers of the theorem."""
    if isinstance(found, str):
        return {"certificate": {"holds": False, "reason": found}}
    bounds = zip(found.meshes, found.force_bound, found.elastic_bound, found.deflection_bound, strict=True)
    keys = "force_N", "elastic_force_N", "deflection_m"
    by_mesh = {name: dict(zip(keys, of_mesh, strict=True)) for name, *of_mesh in bounds}
    own = {"holds": found.holds, "reason": found.reason, "meshes": by_mesh}
    own["margins"] = {"iterated_norms": NORM_MARGIN, "estimated_row_sums": ROW_SUM_MARGIN}
    own |= {
        key: getattr(found, key)
        for key in ("stable", "Y0", "Z1", "Z2", "h0", "radius", "small_gain", "harmonics", "low")
    }
    balance = found.harmonic_balance
    if balance is not None:
        own["harmonic_balance"] = {key: float(getattr(balance, key)) for key in ("H0", "delta0", "K", "h0", "radius")}
    return {"certificate": own}

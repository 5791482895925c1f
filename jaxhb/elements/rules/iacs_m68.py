"""IACS Unified Requirement M68, "Dimensions of propulsion shafts and their permissible
torsional vibration stresses".

For intermediate, thrust and propeller shafts. Crankshafts have a rule of their own, UR
M53, which is not computed here. To be checked against its current text: an aid to
evaluation, no approval by a class.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jaxhb.elements.rules.rule import Rule, Section

if TYPE_CHECKING:
    from jaxhb._jax import Array, Number

CAP = 800e6
"""Tensile strength in Pa beyond which the rule gives no higher limit, for alloy steels;
for other steels and for propeller shafts it says less, which the user observes by the
tensile strength.
"""
PLATEAU = 0.9  # speed ratio from which the limit is constant
HIGHEST = 1.05


def limits(section: Section, ratio: Array) -> tuple[Array, Array]:
    """Continuous and transient limits in Pa at speeds over the rated speed, M68.5."""
    from jaxhb._jax import namespace

    xp = namespace(section.tensile_strength, section.diameter, ratio)
    # The numbers of the rule are for mm and MPa.
    size = 0.35 + 0.93 * (1e3 * section.diameter) ** -0.2
    strength = xp.minimum(section.tensile_strength, CAP) / 1e6
    slope = xp.where(ratio < PLATEAU, 3.0 - 2.0 * ratio**2, 3.0 - 2.0 * PLATEAU**2)
    continuous = (
        1e6 * (strength + 160.0) / 18.0 * section.stress_concentration * size * slope
    )
    return continuous, 1.7 * continuous / section.stress_concentration**0.5


def barred(critical: Number, rated: Number) -> tuple[Number, Number]:
    """Lowest and highest speed of the barred range around a critical speed, all in
    rpm: ``16 n_c / (18 - lambda)`` to ``(18 - lambda) n_c / 16``, M68.5.
    """
    width = 18.0 - critical / rated
    return 16.0 * critical / width, width * critical / 16.0


RULES = (
    Rule(
        name="M68",
        title="IACS UR M68",
        source="IACS UR M68",
        limits=limits,
        highest=HIGHEST,
        required=HIGHEST,
        passed=0.8,
        corners=(PLATEAU, HIGHEST),
        note=(
            "Limits after IACS UR M68 for intermediate, thrust and propeller shafts, "
            "lambda = speed / {rated:g} rpm: to be checked\n"
            "against its current text. Tensile strengths count up to 800 MPa; of "
            "carbon steels and propeller shafts the rule counts\n"
            "at most 600 MPa. They do NOT hold for crankshafts: these have a rule of "
            "their own, IACS UR M53, which adds bending,\n"
            "fillets and oil holes, and is not computed here."
        ),
        needs=("diameter", "stress_concentration", "tensile_strength"),
        unread=("yield_strength",),
        crankshafts=False,
        default=True,
        barred=barred,
        range_source="M68.5",
    ),
)

"""Korean Register, Rules for the Classification of Steel Ships 2025 (RA-05-E), Part 5,
Chapter 4: torsional stresses of crankshafts and generator shafts.

To be checked against its current text: an aid to evaluation, no approval by a class.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from jaxhb.elements.rules.rule import Rule, Section

if TYPE_CHECKING:
    from jaxhb._jax import Array

    Form = Callable[[Array], tuple[Array, Array]]

SOURCE = (
    "Korean Register, Rules for the Classification of Steel Ships 2025, Part 5,"
    " Chapter 4, "
)
CAP = 835e6
"""Tensile strength in Pa beyond which the rules leave the limit to the society."""

REQUIRED = 1.2
"""Share of the rated speed up to which 102 requires the stresses."""

NOTE = (
    "Limits after {source},\n"
    "lambda = speed / {rated:g} rpm: to be checked against its current text. A: "
    "four-strokes in line, or in vee with firing\n"
    "intervals of 45 or 60 deg; B: two-strokes and other vees. Tensile strengths "
    "count up to 835 MPa; of carbon steels the\n"
    "rule counts at most 590 MPa. The strength of a crankshaft after IACS UR M53 "
    "is not computed here."
)


def crankshaft(ratio: Array, *, c: float) -> tuple[Array, Array]:
    """Limits in MPa of steel of 440 MPa before the factors f and g, 201: ``c`` is 24
    for engines of kind A, 29 for B.
    """
    from jaxhb._jax import namespace

    xp = namespace(ratio)
    below = 45.0 - c * ratio**2
    # The root has no derivative at 1: another number stands there.
    above = 237.0 * (ratio - 0.8) * xp.where(ratio > 1.0, ratio - 1.0, 1.0) ** 0.5
    return xp.where(ratio > 1.0, 45.0 - c + above, below), 2.0 * below


def generator(
    ratio: Array, *, continuous: float, transient: float
) -> tuple[Array, Array]:
    """Limits in MPa of steel of 440 MPa before the factors f and g, 203."""
    from jaxhb._jax import namespace

    ones = namespace(ratio).ones_like(ratio)
    return ones * continuous, ones * transient


def limits(
    form: Form, passed: float, section: Section, ratio: Array
) -> tuple[Array, Array]:
    """Continuous and transient limits in Pa at speeds over the rated speed: those of a
    ``form`` with the factors of 201.4 and 203.3; no passing is accepted above
    ``passed``.
    """
    from jaxhb._jax import namespace

    xp = namespace(section.tensile_strength, section.yield_strength, ratio)
    continuous, passing = form(ratio)
    strength = xp.asarray(section.tensile_strength, dtype=float)
    relative = xp.minimum(strength, CAP) / 440e6
    continuous = 1e6 * continuous * xp.maximum(1.0 + 2.0 / 3.0 * (relative - 1.0), 1.0)
    flow = xp.asarray(section.yield_strength, dtype=float) / 225e6
    passing = 1e6 * passing * xp.maximum(flow, 1.0)
    return continuous, xp.where(ratio > passed, continuous, passing)


def _rule(
    name: str, paragraph: str, form: Form, *, highest: float, passed: float
) -> Rule:
    return Rule(
        name=name,
        source=f"{SOURCE}{paragraph}",
        limits=partial(limits, form, passed),
        highest=highest,
        required=REQUIRED,
        passed=passed,
        corners=(passed, 1.0, highest),
        note=NOTE,
        needs=("diameter", "tensile_strength"),
        unread=("stress_concentration",),
        year=2025,
    )


def _main_engine(kind: str, c: float) -> Rule:
    return _rule(
        f"KR crankshaft {kind}",
        "201 (main engines)",
        partial(crankshaft, c=c),
        highest=1.15,
        passed=0.8,
    )


def _generator(shaft: str, continuous: float, transient: float) -> Rule:
    return _rule(
        f"KR generator {shaft}",
        "203 (generators)",
        partial(generator, continuous=continuous, transient=transient),
        highest=1.1,
        passed=0.9,
    )


RULES = (
    _main_engine("A", c=24.0),
    _main_engine("B", c=29.0),
    _generator("crankshaft A", continuous=21.0, transient=90.0),
    _generator("crankshaft B", continuous=16.0, transient=90.0),
    _generator("shaft", continuous=31.0, transient=118.0),
)

"""Pulsation by the blades of propellers and fans, as shares of the mean torque, in the
place of rows of harmonics.
"""

from __future__ import annotations

import cmath
import dataclasses
import math
from typing import Any

from jaxhb.elements.declared import BLADE_ORDERS
from jaxhb.elements.values import (
    is_list,
    is_present,
    number_like,
    row_errors,
    several_given,
)


def blade_errors(element: Any) -> list[str]:
    """Check the blades of a load or a torque: with rows, beside no harmonics, of whole
    multiples.
    """
    rows = element.blade_orders
    blades = element.blades
    if not is_present(rows):
        if blades is None:
            return []
        return ["blades is given without blade_orders. Give rows of both."]
    if blades is None:
        return ["blade_orders is given without blades. Give the number of blades."]
    if is_present(element.harmonics):
        return several_given(["harmonics", "blade_orders"])
    if not number_like(blades) or row_errors("blade_orders", BLADE_ORDERS, rows):
        return []
    for i, (multiple, share, _) in enumerate(rows):
        if multiple < 1 or multiple != int(multiple):
            return [
                f"blade_orders, row {i + 1}: multiple is {multiple:g}, must be a whole"
                " number of at least 1, of blades passing in a revolution. Correct it."
            ]
        if share < 0:
            return [
                f"blade_orders, row {i + 1}: share is {share:g}, must be at least 0."
                " Turn the phase by 180 deg instead."
            ]
    if getattr(element, "mean", None) == 0.0:
        return [
            "blade_orders are shares of the mean torque, which is 0 N m. Give mean, or"
            " harmonics in N m."
        ]
    return []


def with_blades(element: Any) -> Any:
    """A sound load or torque with the harmonics of its blades: rows of (order of its
    own rotor, Re, Im) in shares of the mean of a load, in N m of a torque.
    """
    if not is_list(element.blade_orders) or not element.blade_orders:
        return element
    mean = getattr(element, "mean", 1.0)
    rows = []
    for multiple, share, phase in element.blade_orders:
        part = mean * cmath.rect(share, math.radians(phase))
        rows.append((float(multiple * element.blades), part.real, part.imag))
    rotor = {"orders_of": "own"} if hasattr(element, "orders_of") else {}
    changes: dict[str, Any] = {"harmonics": tuple(rows), "blades": None, **rotor}
    return dataclasses.replace(element, blade_orders=(), **changes)

"""Stiffness of gear teeth over the mesh period, from a table, a contact ratio, or the
gears. Host arithmetic.

Teeth of standard steel gears (ISO 6336-1:2019, method B, 20 deg, x = 0, solid bodies,
at least 100 N/mm): a pair has at most ``c' = C_M C_B cos(beta) / q'``, C_M = 0.8, C_B =
0.975, with n pairs in contact ``c' (0.75 n + 0.25)``, on the average ``c' (0.75
eps_alpha + 0.25)``, N/(mm um) along the line of action in the transverse plane.
Deflections of this package are along the pitch circle: there it is times cos^2 alpha_t.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxhb.elements.elements import Disk, Mesh

PRESSURE_ANGLE = math.radians(20.0)
# Share of the mesh period in which a pair takes over or gives up its load, at most
FLANK = 0.1


def table_orders(
    rows: Sequence[tuple[float, float]], count: int
) -> tuple[float, tuple[tuple[float, float, float], ...]]:
    """Mean in N/m of a stiffness over the mesh period, and rows (order, Re, Im) of
    shares of the mean.

    The stiffness has straight lines between its ``rows`` (share of the mesh period,
    N/m), and from the last one on to the first.

    >>> mean, orders = table_orders(
    ...     [(0.0, 1e8), (0.5, 3e8)], 1
    ... )  # a triangle: 8 / pi^2 of its height
    >>> mean, [round(float(part), 6) for part in orders[0]]
    (200000000.0, [1.0, -0.405285, -0.0])
    """
    position, value = np.array([row for row in rows if row[0] < 1.0], dtype=float).T
    position = np.append(position, position[0] + 1.0)
    value = np.append(value, value[0])
    width = np.diff(position)
    slope = np.diff(value)
    mean = float(np.sum(width * (value[1:] + value[:-1]) / 2))
    order = np.arange(1, count + 1)
    # Integrated by parts: only the changes of slope are left of a continuous function
    # with straight lines.
    rotation = np.exp(-2j * np.pi * order[:, None] * position)
    shares = (
        2
        * (np.diff(rotation, axis=1) @ (slope / width))
        / (2 * np.pi * order) ** 2
        / mean
    )
    return mean, tuple(
        (float(n), share.real, share.imag)
        for n, share in zip(order, shares, strict=True)
    )


def contact_orders(
    contact_ratio: float, count: int, overlap: float = 0.0
) -> tuple[tuple[float, float, float], ...]:
    """Rows (order, Re, Im) of shares of the mean stiffness of teeth of a transverse
    contact ratio.

    A pair enters at 0 of the mesh period; one more than otherwise is in contact for the
    excess of the ratio over a whole number. Flanks are straight. Helical teeth enter
    one after another along the width: with the ``overlap`` ratio their stiffness is an
    average over so many mesh periods.

    >>> [
    ...     round(float(part), 4) for part in contact_orders(1.5, 1)[0]
    ... ]  # between 1 and 1.75 of 1.375 c'
    [1.0, 0.0, -0.3416]
    """
    pairs = math.floor(contact_ratio)
    excess = contact_ratio - pairs
    order = np.arange(1, count + 1)
    step = 0.75 / (0.75 * contact_ratio + 0.25)
    flank = np.sinc(order * min(FLANK, excess, 1.0 - excess)) * np.sinc(order * overlap)
    shares = (
        2
        * step
        * excess
        * np.sinc(order * excess)
        * flank
        * np.exp(-1j * np.pi * order * excess)
    )
    return tuple(
        (float(n), share.real, share.imag)
        for n, share in zip(order, shares, strict=True)
    )


def standard_contact_ratio(teeth: Sequence[int], helix: float) -> float:
    """Transverse contact ratio of two external standard gears, addendum one normal
    module, ``helix`` in rad.
    """
    a, b = teeth
    angle = math.atan(math.tan(PRESSURE_ANGLE) / math.cos(helix))
    reaches = [
        math.sqrt((z / 2 + math.cos(helix)) ** 2 - (z / 2 * math.cos(angle)) ** 2)
        for z in (a, b)
    ]
    return (sum(reaches) - (a + b) / 2 * math.sin(angle)) / (math.pi * math.cos(angle))


def standard_stiffness(
    teeth: Sequence[int], width: float, helix: float, contact_ratio: float
) -> float:
    """Mean stiffness in N/m along the pitch circle of two external standard gears:
    ``width`` m, ``helix`` rad.

    >>> round(standard_stiffness((30, 40), 0.02, 0.0, 1.7) / 1e6)
    357
    """
    equivalent_teeth = [z / math.cos(helix) ** 3 for z in teeth]
    flexibility = (
        0.04723 + 0.15551 / equivalent_teeth[0] + 0.25791 / equivalent_teeth[1]
    )
    pair_stiffness = 0.8 * 0.975 * math.cos(helix) / flexibility
    angle = math.atan(math.tan(PRESSURE_ANGLE) / math.cos(helix))
    # N/(mm um) x m: 1e9 N/m.
    return (
        pair_stiffness
        * (0.75 * contact_ratio + 0.25)
        * 1e9
        * width
        * math.cos(angle) ** 2
    )


def expanded(mesh: Mesh, gears: Sequence[Disk]) -> Mesh:
    """A sound mesh of two :class:`~jaxhb.Disk` with its shorthands replaced by the
    stiffness and the orders that they stand for.
    """
    values: dict[str, Any] = {}
    helix = math.radians(mesh.helix)
    if mesh.stiffness_table:
        mean, orders = table_orders(mesh.stiffness_table, mesh.orders)
        values["stiffness"] = mean
        values["stiffness_orders"] = orders
    ratio = mesh.contact_ratio
    overlap = 0.0
    if mesh.width is not None:
        # A sound mesh with a width joins gears with teeth.
        teeth = [gear.teeth for gear in gears if gear.teeth]
        radius = gears[0].radius
        assert radius is not None
        # The smaller gear is the first of the formula. A module is 2 r cos(beta) / z.
        overlap = mesh.width * abs(math.tan(helix)) * teeth[0] / (2 * math.pi * radius)
        values["stiffness"] = standard_stiffness(
            sorted(teeth),
            mesh.width,
            helix,
            ratio or standard_contact_ratio(teeth, helix),
        )
    if ratio is not None:
        values["stiffness_orders"] = contact_orders(ratio, mesh.orders, overlap)
    return dataclasses.replace(mesh, **values) if values else mesh

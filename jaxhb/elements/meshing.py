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

import numpy as np

PRESSURE_ANGLE = math.radians(20.0)
# Share of the mesh period in which a pair takes over or gives up its load, at most
FLANK = 0.1


def table_orders(rows, count):
    """Mean in N/m, and rows (order, Re, Im) of shares of it, of a stiffness with
    straight lines between its rows (share of the mesh period, N/m) and from the last
    one on to the first.

    >>> mean, orders = table_orders(
    ...     [(0.0, 1e8), (0.5, 3e8)], 1
    ... )  # a triangle: 8 / pi^2 of its height
    >>> mean, [round(float(part), 6) for part in orders[0]]
    (200000000.0, [1.0, -0.405285, -0.0])
    """
    at, value = np.array([row for row in rows if row[0] < 1.0], dtype=float).T
    at = np.append(at, at[0] + 1.0)
    value = np.append(value, value[0])
    length = np.diff(at)
    slope = np.diff(value)
    mean = float(np.sum(length * (value[1:] + value[:-1]) / 2))
    order = np.arange(1, count + 1)
    # Integrated by parts: of a continuous function with straight lines only the changes
    # of slope are left.
    turn = np.exp(-2j * np.pi * order[:, None] * at)
    share = (
        2 * (np.diff(turn, axis=1) @ (slope / length)) / (2 * np.pi * order) ** 2 / mean
    )
    return mean, tuple(
        (float(k), s.real, s.imag) for k, s in zip(order, share, strict=True)
    )


def contact_orders(contact_ratio, count, overlap=0.0):
    """Rows (order, Re, Im) of shares of the mean stiffness of teeth of a transverse
    contact ratio.

    A pair enters at 0 of the mesh period; one more than otherwise is in contact for
    what the ratio exceeds a whole number. Flanks are straight. Helical teeth enter one
    after another along the width: with the ``overlap`` ratio their stiffness is an
    average over so many mesh periods.

    >>> [
    ...     round(float(part), 4) for part in contact_orders(1.5, 1)[0]
    ... ]  # between 1 and 1.75 of 1.375 c'
    [1.0, 0.0, -0.3416]
    """
    pairs = math.floor(contact_ratio)
    longer = contact_ratio - pairs
    order = np.arange(1, count + 1)
    height = 0.75 / (0.75 * contact_ratio + 0.25)
    flank = np.sinc(order * min(FLANK, longer, 1.0 - longer)) * np.sinc(order * overlap)
    share = (
        2
        * height
        * longer
        * np.sinc(order * longer)
        * flank
        * np.exp(-1j * np.pi * order * longer)
    )
    return tuple((float(k), s.real, s.imag) for k, s in zip(order, share, strict=True))


def standard_contact_ratio(teeth, helix):
    """Transverse contact ratio of two external standard gears, addendum one normal
    module, ``helix`` in rad.
    """
    a, b = teeth
    angle = math.atan(math.tan(PRESSURE_ANGLE) / math.cos(helix))
    reach = [
        math.sqrt((z / 2 + math.cos(helix)) ** 2 - (z / 2 * math.cos(angle)) ** 2)
        for z in (a, b)
    ]
    return (sum(reach) - (a + b) / 2 * math.sin(angle)) / (math.pi * math.cos(angle))


def standard_stiffness(teeth, width, helix, contact_ratio):
    """Mean stiffness in N/m along the pitch circle of two external standard gears:
    ``width`` m, ``helix`` rad.

    >>> round(standard_stiffness((30, 40), 0.02, 0.0, 1.7) / 1e6)
    357
    """
    equivalent = [z / math.cos(helix) ** 3 for z in teeth]
    flexibility = 0.04723 + 0.15551 / equivalent[0] + 0.25791 / equivalent[1]
    pair = 0.8 * 0.975 * math.cos(helix) / flexibility
    angle = math.atan(math.tan(PRESSURE_ANGLE) / math.cos(helix))
    # N/(mm um) x m: 1e9 N/m.
    return pair * (0.75 * contact_ratio + 0.25) * 1e9 * width * math.cos(angle) ** 2


def expanded(mesh, gears):
    """A sound mesh of two :class:`~jaxhb.Disk` with the stiffness and its orders that
    its shorthands stand for.
    """
    values = {}
    teeth = [gear.teeth for gear in gears]
    helix = math.radians(mesh.helix)
    if mesh.stiffness_table:
        values["stiffness"], values["stiffness_orders"] = table_orders(
            mesh.stiffness_table, mesh.orders
        )
    ratio = mesh.contact_ratio
    overlap = 0.0
    if mesh.width is not None:
        # The smaller gear is the first of the formula. A module is 2 r cos(beta) / z.
        overlap = (
            mesh.width
            * abs(math.tan(helix))
            * teeth[0]
            / (2 * math.pi * gears[0].radius)
        )
        values["stiffness"] = standard_stiffness(
            sorted(teeth),
            mesh.width,
            helix,
            ratio or standard_contact_ratio(teeth, helix),
        )
    if ratio is not None:
        values["stiffness_orders"] = contact_orders(ratio, mesh.orders, overlap)
    return dataclasses.replace(mesh, **values) if values else mesh

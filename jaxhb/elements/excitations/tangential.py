"""Tables of tangential pressure of engine makers as the engineer writes them, their
checks, and their numbers.
"""

from __future__ import annotations

import cmath
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxhb._jax import Array
from jaxhb.elements.declared import (
    AMPLITUDES,
    COSINES,
    Unread,
    choice,
    not_negative,
    quantity,
    rows,
)
from jaxhb.elements.values import exactly_one, is_present, row_errors
from jaxhb.excitation import gas
from jaxhb.excitation.tables import TANGENTIAL, Cylinders, TangentialPressures


@dataclass(frozen=True, kw_only=True)
class TangentialPressure:
    """``[cylinder.tangential_pressure]``: a table of the engine maker, the gas torque
    over piston area and crank radius by orders of the crank.

    ``cosine_sine`` = rows of (order, imep, cosine, sine) or ``amplitude_phase`` = rows
    of (order, imep, amplitude, phase deg), in any order, but every order at each mean
    indicated pressure. Pressures of the rows are in Pa, phases those of
    cos(order a + phase), or of the sine with ``phase_of = "sine"``, a the crank angle
    from firing top dead centre. ``imep`` is the mean indicated pressure at full load in
    Pa, which ``load`` multiplies. Rows at imep 0 are those of compression alone.
    """

    imep: float = not_negative("Pa")
    cosine_sine: tuple | None = rows(COSINES, None, unit="Pa")
    amplitude_phase: tuple | None = rows(AMPLITUDES, None, unit="Pa")
    phase_of: str = choice("cosine", "sine")
    stroke_cycle: int = quantity("", 4, kind="count", least=1.0)


NO_COMPRESSION_ROW = (
    "{}, but its tangential_pressure has no rows at imep 0, those of compression alone."
    " Add them, or cut the cylinder off by gas_factor = 0."
)


def tangential_rows(table: TangentialPressure) -> dict[float, dict[float, complex]]:
    """Cosine - i sine in Pa by mean indicated pressure (Pa) and order, both increasing,
    of a sound table.
    """
    by_place: dict[float, dict[float, complex]] = {}
    for order, imep, cosine, sine in table.cosine_sine or ():
        part = complex(cosine, -sine)
        by_place.setdefault(float(imep), {})[float(order)] = part
    turned = 90.0 if table.phase_of == "sine" else 0.0
    for order, imep, amplitude, phase in table.amplitude_phase or ():
        part = cmath.rect(amplitude, math.radians(phase - turned))
        by_place.setdefault(float(imep), {})[float(order)] = part
    return {
        imep: dict(sorted(orders.items())) for imep, orders in sorted(by_place.items())
    }


def revolutions(table: TangentialPressure) -> int:
    """Revolutions of the crank in the gas cycle of a table."""
    return int(table.stroke_cycle) // 2


def orders_of(table: TangentialPressure | None, largest: float | None) -> list[float]:
    """Orders of a table up to the ``largest`` that is kept; none without a table."""
    if table is None:
        return []
    most = math.inf if largest is None else largest + 1e-9
    first = next(iter(tangential_rows(table).values()))
    return [order for order in first if order <= most]


def collected_tables(
    tables: Mapping[int, TangentialPressure], orders: Sequence[Sequence[float]]
) -> TangentialPressures | None:
    """Collect the tables of cylinders by their index, with the orders that are kept of
    each; None where there is none.
    """
    if not tables:
        return None
    rows = [tangential_rows(table) for table in tables.values()]
    grid = gas.padded([list(row) for row in rows])
    parts = np.zeros((*grid.shape, max(map(len, orders)), 2))
    for k, (row, own) in enumerate(zip(rows, orders, strict=True)):
        for r, by_order in enumerate(row.values()):
            coefficients = np.array([by_order[order] for order in own], dtype=complex)
            parts[k, r, : len(own), 0] = coefficients.real
            parts[k, r, : len(own), 1] = -coefficients.imag
    sizes = [(len(row), len(own)) for row, own in zip(rows, orders, strict=True)]
    return TangentialPressures(
        seats=tuple(tables),
        sizes=tuple(sizes),
        revolutions=tuple(map(revolutions, tables.values())),
        compresses=tuple(0.0 in row for row in rows),
        imep=np.array([float(table.imep) for table in tables.values()]),
        grid=grid,
        parts=parts,
    )


def scene_part(numbers: Cylinders, field: str, place: int, row: Array) -> Array:
    """The part of a row of tangential pressures that the scene gave."""
    tables = numbers.tangential_pressure
    assert tables is not None  # the field was located in them
    pressures, orders = tables.sizes[place]
    parts_of_scene: dict[str, Any] = {
        f"{TANGENTIAL}.grid": np.s_[:pressures],
        f"{TANGENTIAL}.parts": np.s_[:pressures, :orders],
    }
    return row[parts_of_scene[field]] if field in parts_of_scene else row


def tangential_errors(
    table: TangentialPressure, *, ambient: bool, injected: bool
) -> list[str]:
    """Check the rows of a table of tangential pressure, and that a cylinder which is
    not wholly ``injected`` finds its compression there.

    ambient : whether an ambient pressure is given beside it.
    """
    names = ("cosine_sine", "amplitude_phase")
    texts = exactly_one(table, *names)
    if texts:
        return [f"{TANGENTIAL}: {text}" for text in texts]
    errors = []
    if ambient:
        errors.append(
            f"ambient_pressure is given beside {TANGENTIAL}, which has both sides of"
            " the piston in it. Leave it out."
        )
    strokes = table.stroke_cycle
    if strokes not in (2, 4):
        errors.append(
            f"{TANGENTIAL}: stroke_cycle is {strokes}, must be 2 or 4. Correct it."
        )
    (name,) = (name for name in names if is_present(getattr(table, name)))
    rows = getattr(table, name)
    if isinstance(rows, Unread) or row_errors(name, COSINES, rows) or errors:
        return errors
    texts = [f"{TANGENTIAL}: {text}" for text in _order_errors(name, rows, strokes)]
    if not (texts or injected or any(row[1] == 0.0 for row in rows)):
        texts = [NO_COMPRESSION_ROW.format("the cylinder lacks injection")]
    return texts


def _order_errors(name: str, rows: Sequence[Any], strokes: int) -> list[str]:
    """Check orders and mean indicated pressures of rows, each pair once."""
    least = 0.5 if strokes == 4 else 1.0
    for i, (order, imep, *_) in enumerate(rows):
        if order <= 0.0 or order % least:
            return [
                f"{name}, row {i + 1}: order is {order:g}, must be a multiple of"
                f" {least:g} above 0 in a {strokes:g}-stroke cycle. Correct it; the"
                " mean follows from imep."
            ]
        if imep < 0.0:
            return [
                f"{name}, row {i + 1}: imep is {imep:g}, must be at least 0, that of"
                " compression alone. Correct it."
            ]
    places = Counter((float(row[1]), float(row[0])) for row in rows)
    for (imep, order), times in places.items():
        if times > 1:
            return [
                f"{name}: order {order:g} at imep {imep:g} stands {times} times. Keep"
                " one."
            ]
    pressures = {imep for imep, _ in places}
    orders = {order for _, order in places}
    lacking = sorted({(imep, n) for imep in pressures for n in orders} - set(places))
    if lacking:
        imep, order = lacking[0]
        return [
            f"{name}: there is no order {order:g} at imep {imep:g}, but at another"
            " imep. Give every order at each imep."
        ]
    return []

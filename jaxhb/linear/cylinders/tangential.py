"""Tangential pressures of a cylinder from its pressure table, traces or combustion, as
engine makers print them, and as its ``[cylinder.tangential_pressure]`` reads them; of a
cylinder with such a table at the load of a speed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jaxhb._jax import Array, Number, namespace, traced
from jaxhb.elements.excitations.tangential import TangentialPressure
from jaxhb.elements.sentences import SceneError, shown, suggestion
from jaxhb.excitation import cylinder_harmonics
from jaxhb.excitation.gas import hats, unburnt_weights, weights
from jaxhb.excitation.mean_torques import scale_at
from jaxhb.excitation.tangential import mean_indicated_pressures
from jaxhb.train.tables import TrainArrays


@dataclass(frozen=True, eq=False)
class TangentialTable:
    """Tangential pressures of a cylinder at one speed: its gas torque over the area of
    the piston and the radius of the crank.

    With the crank angle a from firing top dead centre, order n is cosine cos(n a) +
    sine sin(n a) = amplitude cos(n a + phase).

    Attributes
    ----------
    cylinder : str; rpm : float, of the reference rotor
    stroke_cycle : int, 4 or 2
    orders : array ``(K,)``, of the crank
    imep : array ``(R,)`` Pa, mean indicated pressure of each row; 0 of the first, which
        has compression without injection, if that is known
    cosine, sine : arrays ``(R, K)`` Pa
    amplitude, phase_deg : arrays ``(R, K)`` Pa, and deg of the cosine
    """

    cylinder: str
    rpm: Number
    stroke_cycle: int
    orders: np.ndarray
    imep: Array
    cosine: Array
    sine: Array

    @property
    def amplitude(self) -> Array:
        return namespace(self.cosine).hypot(self.cosine, self.sine)

    @property
    def phase_deg(self) -> Array:
        xp = namespace(self.cosine)
        return xp.rad2deg(xp.arctan2(-self.sine, self.cosine))

    def rows(self, unit: float = 1.0) -> list[list[float]]:
        """Rows of order, imep, cosine and sine, pressures in so many Pa, as
        ``cosine_sine`` takes them.
        """
        return [
            [float(order), *(float(part) / unit for part in (imep, cosine, sine))]
            for imep, cosines, sines in zip(
                self.imep, self.cosine, self.sine, strict=True
            )
            for order, cosine, sine in zip(self.orders, cosines, sines, strict=True)
        ]

    def element(self) -> TangentialPressure:
        """The table as a scene has it, with the last row at full load.

        >>> train = jaxhb.load_scene("six_cylinder_diesel")
        >>> table = jaxhb.tangential_pressure(train, "cylinder 1", rpm=1500)
        >>> len(table.element().cosine_sine)
        48
        """
        return TangentialPressure(
            imep=float(self.imep[-1]),
            cosine_sine=tuple(map(tuple, self.rows())),
            stroke_cycle=self.stroke_cycle,
        )


def tangential_pressure(
    train: TrainArrays,
    cylinder: str,
    *,
    rpm: Number,
    loads: Sequence[float] | None = None,
) -> TangentialTable:
    """Tangential pressures by orders of a cylinder whose pressure is known, or that has
    a table of them, with its whole injection.

    A table in a scene (``table.element()``) gives the same torques at this speed. The
    ambient pressure and the scale over the speed are in it, ``gas_factor`` is not.

    Parameters
    ----------
    cylinder : name of a cylinder with ``pressure``, ``traces``, ``combustion`` or
        ``tangential_pressure``
    rpm : of the reference rotor
    loads : shares of the mean effective pressure at full load, one row of the table for
        each; by default the load that the cylinder has at ``rpm``

    Raises
    ------
    SceneError : no such cylinder, or its torque comes from no pressure

    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> table = jaxhb.tangential_pressure(train, "cylinder 1", rpm=1500)
    >>> table.orders[:4]
    array([0.5, 1. , 1.5, 2. ])
    """
    seats = train.topology.cylinders
    where = f"{train.topology.title}, tangential_pressure"
    if cylinder not in seats.names:
        raise SceneError(
            f"{where}: there is no cylinder"
            f" {shown(cylinder)}.{suggestion(cylinder, seats.names)}"
        )
    i = seats.names.index(cylinder)
    count = len(seats.names)
    cycles = dataclasses.replace(
        seats, fires=(True,) * count, cut_off=(False,) * count, every=(1,) * count
    )
    if cycles.tangential[i]:
        table = _of_makers_table(train, i, rpm, loads)
        _check_loads(table, loads, where)
        return table
    if not cycles.computed[i]:
        raise SceneError(
            f"{where}: the gas torque of {cylinder!r} comes from no pressure table,"
            " traces, combustion or tangential_pressure. Give one of them."
        )
    xp = namespace(train, rpm)
    numbers = dataclasses.replace(train.cylinders, injection=None)
    if loads is not None and numbers.load_share is None:
        raise SceneError(
            f"{where}: no cylinder has traces or combustion, so that loads have no"
            " effect. Leave loads out."
        )
    compression = dataclasses.replace(cycles, fires=(False,) * count)
    at_loads = [numbers]
    if loads is not None and numbers.load_share is not None:
        share = np.ones(np.shape(numbers.load_share))
        at_loads = [
            dataclasses.replace(numbers, load_share=load * share) for load in loads
        ]
    parts, ambient = cylinder_harmonics.pressure_harmonics(numbers, (i,), compression)
    unburnt = unburnt_weights(numbers, rpm)[..., i]
    burnt_rows = [weights(at_load, cycles, rpm)[..., i] for at_load in at_loads]
    burnt = parts.shape[0] - unburnt.shape[-1]
    idle = (unburnt[:, None] * parts[burnt:, 0]).sum(axis=0)
    rows = [(row[:, None] * parts[:burnt, 0]).sum(axis=0) for row in burnt_rows]
    scale = scale_at(numbers, rpm)[..., i]
    torque = scale * xp.stack([idle, *rows]) - ambient[0]
    revolutions = seats.revolutions[i]
    orders = np.arange(1, seats.gas[i] // seats.every[i] + 1) / revolutions
    area = np.pi / 4.0 * numbers.bore[i] ** 2
    stroke = numbers.stroke[i]
    work = 2.0 * np.pi * revolutions * torque[1:, 0].real
    imep = xp.concatenate([xp.zeros(1), work / (area * stroke)])
    coefficients = torque[:, 1 : len(orders) + 1] / (0.25 * area * stroke)
    table = TangentialTable(
        cylinder,
        rpm,
        2 * revolutions,
        orders,
        imep,
        coefficients.real,
        -coefficients.imag,
    )
    _check_loads(table, loads, where)
    return table


def _check_loads(
    table: TangentialTable, loads: Sequence[float] | None, where: str
) -> None:
    """Refuse loads whose mean indicated pressures do not rise from those of compression
    on.
    """
    if loads is None or traced(table.imep):
        return
    imep = np.asarray(table.imep)[-len(loads) :]
    if np.any(np.diff(imep, prepend=0.0) <= 0.0):
        raise SceneError(
            f"{where}: the loads of {table.cylinder!r} make mean indicated pressures of"
            f" {', '.join(f'{value:.4g}' for value in imep)} Pa, must increase from"
            " above 0. Correct the loads."
        )


def _of_makers_table(
    train: TrainArrays, i: int, rpm: Number, loads: Sequence[float] | None
) -> TangentialTable:
    """The table of cylinder ``i``, as the scene has it, at the mean indicated pressures
    of a speed or of loads.
    """
    seats = train.topology.cylinders
    numbers = train.cylinders
    tables = numbers.tangential_pressure
    assert tables is not None  # the cylinder has one
    place = tables.seats.index(i)
    xp = namespace(train, rpm)
    if loads is None:
        burnt = mean_indicated_pressures(numbers, rpm)[..., [place]]
    else:
        burnt = tables.imep[place] * xp.asarray(loads)
    imep = xp.concatenate([xp.zeros(int(tables.compresses[place])), burnt])
    weights = hats(imep[:, None], tables.grid[[place]])[:, 0]
    orders = np.array(seats.orders[i]) / seats.turn[i]
    parts = xp.einsum("jr,rkc->jkc", weights, tables.parts[place])[:, : len(orders)]
    scale = scale_at(numbers, rpm)[..., i]
    return TangentialTable(
        seats.names[i],
        rpm,
        2 * tables.revolutions[place],
        orders,
        scale * imep,
        scale * parts[..., 0],
        scale * parts[..., 1],
    )

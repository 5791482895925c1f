"""Cylinders: the gas torque and the inertia torque of crank-sliders.

A cylinder's gas torque is T = gas_factor (scale(rpm) p - p_ambient) A x'(a), its
inertia torque at constant speed w of its own rotor T = -m x'(a) x''(a) w^2, with the
travel x from top dead centre (:func:`~jaxhb.excitation.crank.slider_crank`). Without
injection p is that of compression alone; a prescribed gas torque, of which this is not
known, is then 0. The scale over rpm multiplies gas torques, never inertia torques. The
pressure p is a sum of functions of the angle, weighted by speed and load
(:mod:`jaxhb.excitation.gas`).
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxhb._jax import Array, Number, namespace
from jaxhb.elements.columns import collected, column, padded, scales
from jaxhb.elements.excitations.crank_slider import (
    Combustion,
    Cylinder,
    cylinder_errors,
    gas_revolutions,
    source,
    source_word,
    with_charge,
)
from jaxhb.elements.excitations.kind import (
    Excitation,
    Need,
    Rows,
    Seats,
    Usable,
    per_cycle,
)
from jaxhb.elements.excitations.tangential import (
    NO_COMPRESSION_ROW,
    collected_tables,
    orders_of,
    scene_part,
)
from jaxhb.elements.values import is_list, rounded, sound_orders, whole
from jaxhb.excitation import gas
from jaxhb.excitation.crank import CRANK_SAMPLES
from jaxhb.excitation.gas import GAS_SAMPLES, gas_cycle, injection
from jaxhb.excitation.mean_torques import mean_gas_torques, scale_at
from jaxhb.excitation.orders import add_listed, coefficients, harmonics_of, highest_rows
from jaxhb.excitation.tables import (
    COMPUTED,
    LOADED,
    TANGENTIAL,
    Combustions,
    Cylinders,
    GasCycles,
    TangentialPressures,
    Traces,
)
from jaxhb.excitation.tangential import tangential_harmonics

# Largest orders of computed torques, where a scene says nothing
ORDERS = 12.0
ORDERS_OF_TWO_STROKES = 15.0
INERTIA_ORDERS_THAT_COUNT = 6
"""Orders of the inertia torque per revolution of its own rotor: the next is 0.04 % of
the largest.
"""
# Share of the largest harmonic of a computed gas torque below which one does not count
NEGLIGIBLE_GAS = 1e-6
# Pressure tables on their grid: 0.6 MB each while a scene is checked
MOST_PRESSURES = 1000


@dataclass(frozen=True, kw_only=True)
class CylinderSeats(GasCycles, Seats):
    """Gas cycles of the cylinders; ``harmonics`` are those of prescribed gas torques,
    ``step`` the harmonics of the cycle per harmonic of the gas cycle, or of all
    ``every`` (0 where no pressure is given), and ``turn`` per order of its own rotor;
    ``gas`` and ``inertia`` how many harmonics of the gas cycle and how many orders of
    the own rotor are computed; ``series`` whether the inertia torque is that of the
    short series; ``orders`` the
    harmonics of tables of tangential pressure.
    """

    step: tuple[int, ...] = per_cycle()
    turn: tuple[float, ...] = per_cycle()
    gas: tuple[int, ...]
    inertia: tuple[int, ...]
    series: tuple[bool, ...]
    orders: Rows = per_cycle()

    def gas_rows(self) -> Rows:
        """Harmonics of the cycle of the computed gas torques."""
        steps = zip(self.step, self.gas, strict=True)
        return tuple(tuple(step * k for k in range(1, n + 1)) for step, n in steps)

    def inertia_rows(self) -> Rows:
        """Harmonics of the cycle of the inertia torques."""
        turns = zip(self.turn, self.inertia, strict=True)
        return tuple(
            tuple(round(turn * k) for k in range(1, n + 1)) for turn, n in turns
        )

    def listed(self) -> Rows:
        rows = (self.harmonics, self.orders, self.gas_rows(), self.inertia_rows())
        return tuple(
            tuple(sorted({n for row in own for n in row} - {0}))
            for own in zip(*rows, strict=True)
        )


class CylinderKind(Excitation):
    """``[[cylinder]]``, which an ``[engine]`` makes, too."""

    element = Cylinder
    doubtful = "fires"
    no_mean = ("gas_torque", "firing_angle", "reciprocating_mass", "ambient_pressure")
    order_rows = "gas_torque"
    of_engines = True
    ones = ("gas_factor", "injection")

    def errors(self, element: Cylinder) -> list[str]:
        return cylinder_errors(element)

    def size_errors(self, elements: Sequence[Cylinder]) -> list[str]:
        sources = [cylinder for cylinder in elements if source(cylinder)]
        tables = len(sources) * max(
            (len(cylinder.traces) for cylinder in sources if is_list(cylinder.traces)),
            default=1,
        )
        if tables <= MOST_PRESSURES:
            return []
        return [
            f"{len(sources)} cylinders need {tables} pressure tables, must be at most"
            f" {MOST_PRESSURES}. Give some of them gas_torque instead."
        ]

    def mean_fields(self, element: Cylinder) -> tuple[str, ...]:
        of_table = (TANGENTIAL, "load", "bore", "stroke")
        of_pressure = (*COMPUTED, "load", "bore", "stroke", "rod", "table_firing_tdc")
        return (
            "fires",
            "scale",
            "fires_every",
            "gas_factor",
            "injection",
            "gas_torque_mean",
            *(of_pressure if source(element) else ()),
            *(of_table if element.tangential_pressure is not None else ()),
        )

    def written_speeds(self, element: Cylinder, usable: Usable) -> Iterator[float]:
        for name in ("scale", "load"):
            if usable(name):
                yield from (float(row[0]) for row in getattr(element, name) or ())
        if usable("traces"):
            yield from (float(trace.rpm) for trace in element.traces or ())
        combustion = element.combustion
        if usable("combustion") and isinstance(combustion, Combustion):
            yield from (float(row[0]) for row in combustion.charge_over_rpm)

    def needs(
        self, element: Cylinder, ratio: float | None, usable: Usable
    ) -> Iterator[Need]:
        if ratio is None:
            return
        for order in sound_orders(element.gas_torque):
            yield f"order {order:g}", order * ratio, "gas_torque_mean"
        tabled = element.tangential_pressure is not None
        if (source(element) or tabled) and usable(*COMPUTED, TANGENTIAL):
            revolutions = gas_revolutions(element)
            if usable("fires_every"):
                revolutions *= int(element.fires_every)
            plural = "s" if revolutions > 1 else ""
            yield (
                f"one gas cycle of {revolutions} revolution{plural}",
                ratio / revolutions,
                "",
            )
        moving = usable("stroke", "reciprocating_mass") and element.stroke is not None
        if moving and element.reciprocating_mass > 0:
            yield "order 1 of the reciprocating mass", ratio, ""

    def seats(
        self,
        elements: Sequence[Cylinder],
        names: Sequence[str],
        disks: Sequence[int],
        ratios: Sequence[float],
        cycle: float,
    ) -> CylinderSeats:
        turns = [rounded(ratio * cycle) for ratio in ratios]
        columns: dict[str, list[Any]] = {
            name: [] for name in ("revolutions", "step", "gas", "inertia")
        }
        for cylinder, turn in zip(elements, turns, strict=True):
            is_computed = source(cylinder) is not None
            revolutions = gas_revolutions(cylinder)
            # Of all gas cycles from one with injection to the next
            span = revolutions * cylinder.fires_every
            has_crank = cylinder.stroke is not None and cylinder.rod is not None
            has_gas = is_computed or cylinder.tangential_pressure is not None
            two_stroke = has_gas and revolutions == 1
            orders = cylinder.orders or (
                ORDERS_OF_TWO_STROKES if two_stroke else ORDERS
            )
            # 1e-9 keeps a product that rounds below a whole number.
            of_gas = math.floor(orders * revolutions * cylinder.fires_every + 1e-9)
            moves = has_crank and whole(turn)
            columns["revolutions"].append(revolutions)
            columns["step"].append(round(turn / span) if is_computed else 0)
            columns["gas"].append(of_gas if is_computed else 0)
            columns["inertia"].append(math.floor(orders + 1e-9) if moves else 0)
        return CylinderSeats(
            names=tuple(names),
            disk=tuple(disks),
            of_own_rotor=(True,) * len(elements),
            source=tuple(map(source_word, elements)),
            fires=tuple(cylinder.fires for cylinder in elements),
            cut_off=(False,) * len(elements),
            every=tuple(int(cylinder.fires_every) for cylinder in elements),
            harmonics=harmonics_of(
                [cylinder.gas_torque or () for cylinder in elements], turns
            ),
            turn=tuple(turns),
            orders=tuple(
                tuple(round(order * turn) for order in _orders(cylinder))
                for cylinder, turn in zip(elements, turns, strict=True)
            ),
            series=tuple(cylinder.kinematics == "mendes2008" for cylinder in elements),
            **{name: tuple(values) for name, values in columns.items()},
        )

    def numbers(self, elements: Sequence[Cylinder]) -> Cylinders:
        has_tables = any(cylinder.pressure for cylinder in elements)
        # Without tables no samples: every program would take them.
        pressure = np.zeros((len(elements), GAS_SAMPLES if has_tables else 0))
        for i, cylinder in enumerate(elements):
            if cylinder.pressure:
                pressure[i] = gas_cycle(cylinder.pressure, cylinder.table_firing_tdc)
        special: dict[str, Any] = {
            "rod": column(elements, "rod", absent=1.0),
            "pressure": pressure,
            "traces": _trace_table(elements),
            "combustion": _combustion_table(elements),
            "tangential_pressure": _tangential_table(elements),
        }
        for name in self.ones:
            scattered = any(
                getattr(cylinder, name) is not None for cylinder in elements
            )
            special[name] = column(elements, name, absent=1.0) if scattered else None
        return collected(
            Cylinders,
            Cylinder,
            elements,
            special | scales(elements) | _shares(elements),
        )

    def speeds(self, numbers: Cylinders) -> list[Array]:
        points = [numbers.scale_rpm]
        points += [] if numbers.load_rpm is None else [numbers.load_rpm]
        points += [] if numbers.traces is None else [numbers.traces.rpm]
        combustion = numbers.combustion
        if combustion is not None and combustion.charge_at is not None:
            by_speed = [quantity == "rpm" for quantity in combustion.charge_by]
            points.append(combustion.charge_at[by_speed])
        return points

    def means(self, numbers: Cylinders, seats: CylinderSeats, rpm: Number) -> Array:
        return mean_gas_torques(numbers, seats, rpm)

    def add_harmonics(
        self,
        torque: Array,
        numbers: Cylinders,
        seats: CylinderSeats,
        rpm: Array,
        ratios: Array,
        turned: Callable[[np.ndarray, np.ndarray], Number],
    ) -> Array:
        # Here: it imports jax, which a scene that is only checked does without.
        from jaxhb.excitation import cylinder_harmonics

        scale = scale_at(numbers, rpm)
        factor = numbers.gas_factor
        factor = np.ones(len(seats.disk)) if factor is None else factor
        injected = injection(numbers, seats)

        def phase(i: np.ndarray, n: np.ndarray) -> Array:
            """Factor exp(-i order alpha) of cylinder i at harmonic n of the cycle;
            order in revolutions of its own rotor.
            """
            order = n / np.array(seats.turn)[i]
            xp = namespace(numbers.firing_angle)
            firing = xp.exp(-1j * order * xp.deg2rad(numbers.firing_angle)[i])
            return firing * turned(i, n)

        def prescribed(i: np.ndarray, k: np.ndarray, n: np.ndarray) -> Array:
            rows = scale[..., i] * coefficients(numbers.gas_torque, i, k)
            return factor[i] * injected[i] * rows * phase(i, n)

        rows, parts, ambient = cylinder_harmonics.computed_gas(numbers, seats)

        def computed(i: np.ndarray, k: np.ndarray, n: np.ndarray) -> Array:
            row = np.searchsorted(rows, i)
            weights = cylinder_harmonics.harmonic_weights(numbers, seats, rpm)[..., i]
            of_gas = (weights * parts[:, row, k + 1]).sum(axis=-2)
            pressed = scale[..., i] * of_gas - ambient[row, k + 1]
            return factor[i] * pressed * phase(i, n)

        def inertia(i: np.ndarray, k: np.ndarray, n: np.ndarray) -> Array:
            speed = ratios * (2.0 * np.pi / 60.0) * rpm[..., None]
            unit = cylinder_harmonics.unit_inertia_harmonics(numbers, seats.series)
            of_mass = (numbers.reciprocating_mass * speed**2)[..., i]
            return of_mass * unit[i, k + 1] * phase(i, n)

        def where(lists: Rows, counts: Sequence[bool]) -> Rows:
            """The rows of cylinders that count."""
            return tuple(
                row if there else () for row, there in zip(lists, counts, strict=True)
            )

        disks = seats.disk
        lists = where(seats.harmonics, seats.prescribed)
        torque = add_listed(torque, disks, lists, prescribed)
        if numbers.tangential_pressure is not None:
            place = np.zeros(len(disks), dtype=int)
            tabled_seats = numbers.tangential_pressure.seats
            place[list(tabled_seats)] = np.arange(len(tabled_seats))

            def tabled(i: np.ndarray, k: np.ndarray, n: np.ndarray) -> Array:
                of_orders = tangential_harmonics(numbers, seats, rpm)
                sized = scale[..., i] * of_orders[..., place[i], k]
                return factor[i] * sized * phase(i, n)

            lists = where(seats.orders, seats.tangential)
            torque = add_listed(torque, disks, lists, tabled)
        lists = where(seats.gas_rows(), seats.computed)
        torque = add_listed(torque, disks, lists, computed)
        lists = tuple(row[: CRANK_SAMPLES // 2] for row in seats.inertia_rows())
        return add_listed(torque, disks, lists, inertia)

    def highest(self, numbers: Cylinders, seats: CylinderSeats) -> list[int]:
        from jaxhb.excitation import cylinder_harmonics

        harmonics = highest_rows(seats.harmonics, numbers.gas_torque)
        mass = np.asarray(numbers.reciprocating_mass)
        inertia = zip(seats.inertia, seats.turn, strict=True)
        for i, (orders, turn) in enumerate(inertia):
            if orders and mass[i] > 0.0:
                harmonics.append(round(min(orders, INERTIA_ORDERS_THAT_COUNT) * turn))
        tables = numbers.tangential_pressure
        parts = () if tables is None else np.abs(np.asarray(tables.parts))
        for i, own in zip(() if tables is None else tables.seats, parts, strict=True):
            size = own.max(axis=(0, 2))
            least = NEGLIGIBLE_GAS * max(size.max(initial=0.0), 1e-300)
            counts = size[: len(seats.orders[i])] > least
            harmonics += itertools.compress(seats.orders[i], counts.tolist())
        cylinders, of_gas, _ = cylinder_harmonics.computed_gas(numbers, seats)
        sizes = np.abs(np.asarray(of_gas)).max(axis=0) if cylinders else ()
        for i, size in zip(cylinders, sizes, strict=True):
            size = size[1 : seats.gas[i] + 1]
            least = NEGLIGIBLE_GAS * max(size.max(initial=0.0), 1e-300)
            counts = np.flatnonzero(size > least)
            harmonics += [(k + 1) * seats.step[i] for k in counts.tolist()]
        return harmonics

    def scene_row(
        self,
        numbers: Cylinders,
        seats: CylinderSeats,
        field: str,
        place: int,
        row: Array,
    ) -> Array:
        if field == "combustion.exhaust_pressure":
            assert numbers.combustion is not None  # the field was located in it
            return gas.full_exhaust_pressure(numbers.combustion)[place]
        if field.startswith(f"{TANGENTIAL}."):
            return scene_part(numbers, field, place, row)
        if not field.startswith("traces."):
            return row
        assert numbers.traces is not None  # the field was located in them
        speeds, loads = numbers.traces.sizes[place]
        parts_of_scene: dict[str, Any] = {
            "traces.rpm": np.s_[:speeds],
            "traces.load": np.s_[:loads],
            "traces.pressure": np.s_[:speeds, :loads],
        }
        return row[parts_of_scene[field]]

    def without_effect(
        self, numbers: Cylinders, seats: CylinderSeats, field: str, index: int
    ) -> str:
        return _without_effect(numbers, seats, field, index)


def _without_effect(
    numbers: Cylinders, seats: CylinderSeats, field: str, index: int
) -> str:
    """Say why a number of a cylinder has no effect; empty where it has one."""
    origin = seats.source[index]
    moves = seats.inertia[index] > 0
    computed = origin in COMPUTED
    tabled = origin == TANGENTIAL
    if field == "injection" and tabled:
        tables = numbers.tangential_pressure
        assert tables is not None  # a cylinder has it
        compresses = tables.compresses[tables.seats.index(index)]
        return "" if compresses else NO_COMPRESSION_ROW.format("it would misfire")
    if (
        (field == "bore" and not (computed or tabled))
        or (field == "ambient_pressure" and not computed)
        or (field == "pressure" and origin != "pressure")
    ):
        return (
            "it has no effect, as the cylinder has no pressure table. Build the scene"
            " with a pressure."
        )
    if field in ("load_rpm", "load_share") and origin not in LOADED:
        return (
            "it has no effect, as the cylinder has neither traces nor combustion nor"
            " tangential_pressure. Build the scene with one of them."
        )
    if field in ("combustion.heat", "combustion.imep"):
        combustion = numbers.combustion
        assert combustion is not None  # the field was located in it
        by_work = combustion.by_work[combustion.seats.index(index)]
        if by_work != (field == "combustion.imep"):
            return (
                f"it has no effect, as the scene gives {'imep' if by_work else 'heat'}"
                " instead. Change that."
            )
    if field in ("gas_torque_mean", "gas_torque") and (computed or tabled):
        name = "pressure table" if origin == "pressure" else origin
        return (
            f"the gas torque comes from the {name}. Change {origin}, or build the scene"
            " without it."
        )
    if (
        (field == "reciprocating_mass" and not moves)
        or (field == "stroke" and not (moves or computed or tabled))
        or (field == "rod" and not (moves or computed))
    ):
        return (
            "it has no effect, as the cylinder was built without inertia torque. Build"
            " the scene with stroke, rod and reciprocating_mass (orders at least 1,"
            " whole harmonics of the cycle)."
        )
    return ""


def _trace_table(cylinders: Sequence[Any]) -> Traces | None:
    """Collect the traces; None where no cylinder has any."""
    seats = tuple(
        i for i, cylinder in enumerate(cylinders) if source(cylinder) == "traces"
    )
    if not seats:
        return None
    traces = [cylinders[i].traces for i in seats]
    speeds = [sorted({float(trace.rpm) for trace in row}) for row in traces]
    loads = [sorted({float(trace.load) for trace in row}) for row in traces]
    rpm = gas.padded(speeds)
    load = gas.padded(loads)
    pressure = np.zeros((len(seats), rpm.shape[1], load.shape[1], GAS_SAMPLES))
    for k, row in enumerate(traces):
        for trace in row:
            r = speeds[k].index(float(trace.rpm))
            s = loads[k].index(float(trace.load))
            pressure[k, r, s] = gas_cycle(trace.pressure, trace.table_firing_tdc)
    sizes = tuple(
        (len(own_speeds), len(own_loads))
        for own_speeds, own_loads in zip(speeds, loads, strict=True)
    )
    return Traces(seats=seats, sizes=sizes, rpm=rpm, load=load, pressure=pressure)


def _combustion_table(cylinders: Sequence[Any]) -> Combustions | None:
    """Collect the combustions; None where no cylinder has one."""
    seats = tuple(
        i for i, cylinder in enumerate(cylinders) if source(cylinder) == "combustion"
    )
    if not seats:
        return None
    combustions = [with_charge(cylinders[i].combustion) for i in seats]
    names = [
        field.name
        for field in dataclasses.fields(Combustion)
        if field.metadata["kind"] == "number"
    ]
    tables = [
        combustion.charge_over_load or combustion.charge_over_rpm
        for combustion in combustions
    ]
    numbers = {
        name: np.array(
            [float(getattr(combustion, name) or 0.0) for combustion in combustions]
        )
        for name in names
    }
    charge_by = []
    for combustion in combustions:
        if combustion.charge_over_load:
            charge_by.append("load")
        else:
            charge_by.append("rpm" if combustion.charge_over_rpm else "")
    charge_at = None
    charge_factor = None
    if any(tables):
        charge_at, charge_factor = _on_grids(tables)
    return Combustions(
        seats=seats,
        revolutions=tuple(gas_revolutions(cylinders[i]) for i in seats),
        by_work=tuple(combustion.imep is not None for combustion in combustions),
        charge_by=tuple(charge_by),
        charge_at=charge_at,
        charge_factor=charge_factor,
        **numbers,
    )


def _orders(cylinder: Cylinder) -> list[float]:
    """Orders that are kept of the table of tangential pressure of a cylinder."""
    return orders_of(cylinder.tangential_pressure, cylinder.orders)


def _tangential_table(cylinders: Sequence[Cylinder]) -> TangentialPressures | None:
    """Collect the tangential pressures; None where no cylinder has any."""
    tables = {
        i: cylinder.tangential_pressure
        for i, cylinder in enumerate(cylinders)
        if cylinder.tangential_pressure is not None
    }
    return collected_tables(tables, [_orders(cylinders[i]) for i in tables])


def _shares(cylinders: Sequence[Any]) -> dict[str, np.ndarray | None]:
    """Speeds and loads of every cylinder, [nc, L]; None where no load counts."""
    if not any(source_word(cylinder) in LOADED for cylinder in cylinders):
        return {"load_rpm": None, "load_share": None}
    rpm, share = _on_grids([cylinder.load for cylinder in cylinders])
    return {"load_rpm": rpm, "load_share": share}


def _on_grids(tables: Sequence[Any]) -> tuple[np.ndarray, np.ndarray]:
    """Positions and factors [n, L] of tables of (position, factor); the factor is 1
    without a table.
    """
    rows = [table or ((0.0, 1.0),) for table in tables]
    grids = gas.padded([[position for position, _ in row] for row in rows])
    return grids, padded(rows, (0.0, 1.0))[..., 1].copy()


EXCITATION = CylinderKind()

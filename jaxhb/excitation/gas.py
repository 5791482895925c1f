"""The gas in the cylinders: pressure tables on a uniform grid, one, several over speed
and load, or from a model.

At every speed the pressure of a cylinder is a weighted sum of functions of the crank
angle that do not depend on the speed (:func:`components`, :func:`weights`): harmonics
are taken of these once, for all speeds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from jaxhb._jax import Array, Number, namespace
from jaxhb.excitation.combustion import NUMBERS, pressures, unburnt
from jaxhb.excitation.compression import unburnt_table
from jaxhb.excitation.crank import slider_crank
from jaxhb.excitation.tables import Combustions, Cylinders, GasCycles

GAS_SAMPLES = 7200  # angles of a gas cycle: a tenth of a degree of four strokes
# Speed or load of points that fill up a grid: interpolation never reaches them
FAR = 1e30
STANDARD_ATMOSPHERE = 101325.0  # Pa
FULL_LOAD = 0.02
"""Difference from load 1 up to which a row is that of full load: a load that is changed
about 1, as for a derivative, has no kink there.
"""
CHARGE_EXPONENT = 1.5
"""Exponent of the engine's power with which a turbocharger's pressure above the
atmosphere grows, as engines on test beds show it at part load, on the propeller law and
at constant speed: see ``docs/reference/excitation.md``.
"""


def is_four_stroke(rows: Sequence[Sequence[float]] | np.ndarray) -> bool:
    """Tell whether a pressure table (angle deg, Pa) is that of two revolutions: it
    extends beyond 360 deg.
    """
    angle = np.asarray(rows, dtype=np.float64)[:, 0]
    longest = 360.0 + 1e-9
    return bool(angle[-1] - angle[0] > longest or np.abs(angle).max() > longest)


def gas_cycle(
    rows: Sequence[Sequence[float]] | np.ndarray, firing_tdc: float | None
) -> np.ndarray:
    """Sample a pressure table (angle deg, Pa) linearly at ``GAS_SAMPLES`` angles from
    firing TDC on.
    """
    rows = np.asarray(rows, dtype=np.float64)
    period = 720.0 if is_four_stroke(rows) else 360.0
    if firing_tdc is None:
        firing_tdc = 360.0 if period == 720.0 else 0.0
    angle = rows[:, 0]
    pressure = rows[:, 1]
    # A table that lacks its end is closed by its first row.
    if angle[-1] - angle[0] < period - 1e-9:
        angle = np.append(angle, angle[0] + period)
        pressure = np.append(pressure, pressure[0])
    grid = firing_tdc + np.arange(GAS_SAMPLES) * (period / GAS_SAMPLES)
    # Rounded: an angle just below 0 would be taken from the other end of the table.
    turned = angle[0] + np.mod(np.round(grid - angle[0], 9), period)
    return np.interp(turned, angle, pressure)


def padded(grids: Sequence[Sequence[float]]) -> np.ndarray:
    """Stack increasing numbers, the shorter rows continued so far away that
    :func:`hats` never sees it.
    """
    longest = max(len(grid) for grid in grids)
    return np.array(
        [[*grid, *(FAR * np.arange(1, longest - len(grid) + 1))] for grid in grids],
        dtype=np.float64,
    )


def hats(x: Array, grid: Array) -> Array:
    """Weights [..., n, R] of values at ``grid`` [n, R] in their linear interpolation at
    ``x`` [..., n].

    Outside the grid the nearest value has weight 1.
    """
    xp = namespace(x, grid)
    passed = xp.clip(
        (x[..., None] - grid[:, :-1]) / (grid[:, 1:] - grid[:, :-1]), 0.0, 1.0
    )
    ends = xp.zeros((*x.shape, 1))
    # A hat is the ramp up to its point less the ramp beyond it.
    up = xp.concatenate([ends + 1.0, passed], axis=-1)
    beyond = xp.concatenate([passed, ends], axis=-1)
    return up - beyond


def injection(cylinders: Cylinders, cycles: GasCycles) -> Array:
    """Share of its injection that each cylinder has [nc], 0 where it does not fire."""
    if cylinders.injection is None:
        return np.array(cycles.fires, dtype=float)
    xp = namespace(cylinders.injection)
    return xp.where(np.array(cycles.fires), cylinders.injection, 0.0)


def components(cylinders: Cylinders, cycles: GasCycles) -> Array:
    """Pressures [J, nc, M] (Pa) from firing top dead centre on; their sum with
    :func:`weights` is the pressure at a speed.

    Pressures with injection come first, and behind them, where some cylinder lacks it,
    those without.
    """
    parts = _parts(cylinders, lambda table: table, _burning)
    if cycles.compressing(cylinders):
        parts += _parts(
            cylinders, lambda table: _of_tables(cylinders, cycles, table), _unburnt
        )
    count = cylinders.bore.shape[-1]
    return namespace(parts).concatenate(parts) if parts else np.zeros((1, count, 0))


def _parts(
    cylinders: Cylinders, of_tables: Callable[[Array], Array], of_combustion: Callable
) -> list[Array]:
    """Pressures [J, nc, M] of tables, of traces and of the combustion model;
    ``of_tables`` takes [J, nc, M].
    """
    count = cylinders.bore.shape[-1]
    parts = []
    traces = cylinders.traces
    burning = cylinders.combustion
    if cylinders.pressure.shape[-1]:
        parts.append(of_tables(cylinders.pressure[None]))
    if traces is not None:
        by_trace = traces.pressure.reshape(len(traces.seats), -1, GAS_SAMPLES)
        by_trace = by_trace.swapaxes(0, 1)
        parts.append(of_tables(on_cylinders(by_trace, traces.seats, count, axis=1)))
    if burning is not None:
        parts.append(
            on_cylinders(of_combustion(cylinders), burning.seats, count, axis=1)
        )
    return parts


def in_groups(
    keys: Sequence[int], of_group: Callable[[int, np.ndarray], Array]
) -> Array:
    """Join ``of_group(key, rows)`` [J, rows, ...] of the rows with equal ``keys`` [n],
    in the order of the rows.
    """
    distinct = sorted(set(keys))
    groups = [np.flatnonzero(np.array(keys) == key) for key in distinct]
    parts = [of_group(key, rows) for key, rows in zip(distinct, groups, strict=True)]
    order = np.argsort(np.concatenate(groups))
    return namespace(parts).concatenate(parts, axis=1)[:, order]


def _of_tables(cylinders: Cylinders, cycles: GasCycles, pressure: Array) -> Array:
    """Pressure tables [J, nc, M] without injection."""
    xp = namespace(cylinders, pressure)

    def of_group(revolutions: int, rows: np.ndarray) -> Array:
        stroke = xp.asarray(cylinders.stroke)[rows]
        rod = xp.asarray(cylinders.rod)[rows]
        # Cylinders without pressures may have none
        stroke = xp.where(stroke > 0.0, stroke, 1.0)
        return unburnt_table(pressure[:, rows], stroke, rod, revolutions=revolutions)

    # Two- and four-strokes have other angles at the same sample.
    return in_groups(cycles.revolutions, of_group)


def weights(cylinders: Cylinders, cycles: GasCycles, rpm: Number) -> Array:
    """Weight [..., J, nc] of each of the :func:`components` at ``rpm`` [...] of the
    reference rotor.
    """
    tabled, burning = _weights(cylinders, rpm)
    xp = namespace(tabled, burning, cylinders.injection)
    burnt = xp.concatenate([*tabled, *burning], axis=-2)
    if not cycles.compressing(cylinders):
        return burnt
    share = injection(cylinders, cycles)
    idle = (1.0 - share) * unburnt_weights(cylinders, rpm)
    return xp.concatenate([share * burnt, idle], axis=-2)


def unburnt_weights(cylinders: Cylinders, rpm: Number) -> Array:
    """Weight [..., J, nc] at ``rpm`` [...] of the last J :func:`components`, those
    without injection.
    """
    tabled, burning = _weights(cylinders, rpm)
    # The heat of the combustion comes last: without injection it is not there.
    parts = [*tabled, *(part[..., :-1, :] for part in burning)]
    return namespace(parts).concatenate(parts, axis=-2)


def _weights(cylinders: Cylinders, rpm: Number) -> tuple[list[Array], list[Array]]:
    """Weights [..., J, nc] of tables and traces, and of the combustion model, each in a
    list.
    """
    traces = cylinders.traces
    burning = cylinders.combustion
    xp = namespace(cylinders, rpm)
    count = cylinders.bore.shape[-1]
    speed = xp.asarray(rpm, dtype=float)
    tabled = [xp.ones((*speed.shape, 1, count))] if cylinders.pressure.shape[-1] else []
    if traces is None and burning is None:
        return tabled or [xp.ones((*speed.shape, 1, count))], []
    share = load_share(cylinders, speed)
    if traces is not None:
        seats = np.array(traces.seats)
        by_speed = hats(
            xp.broadcast_to(speed[..., None], (*speed.shape, seats.size)), traces.rpm
        )
        by_load = hats(share[..., seats], traces.load)
        both = by_speed[..., :, None] * by_load[..., None, :]
        both = both.reshape((*speed.shape, seats.size, -1))
        tabled.append(
            on_cylinders(xp.swapaxes(both, -1, -2), traces.seats, count, axis=-1)
        )
    if burning is None:
        return tabled, []
    seats = np.array(burning.seats)
    charge, exhaust = charge_pressures(cylinders, speed)
    by_cylinder = xp.stack([charge, exhaust, share[..., seats]], axis=-2)
    return tabled, [on_cylinders(by_cylinder, burning.seats, count, axis=-1)]


def charge_pressures(cylinders: Cylinders, rpm: Number) -> tuple[Array, Array]:
    """Pressure (Pa) of the charge and in the exhaust [..., n] of the cylinders with a
    combustion at ``rpm`` [...].

    Each is the pressure at full load times the factor of the table over load or speed.
    Without a table the part above the atmosphere grows with the power of the engine to
    the :data:`CHARGE_EXPONENT`. An engine that is not charged keeps its pressure.
    """
    table = cylinders.combustion
    assert table is not None
    xp = namespace(cylinders, rpm)
    seats = np.array(table.seats)
    charging = power_share(cylinders, rpm)[..., seats] ** CHARGE_EXPONENT

    def with_the_power(full: Array) -> Array:
        uncharged = xp.minimum(full, STANDARD_ATMOSPHERE)
        return uncharged + (full - uncharged) * charging

    tabled = np.array([bool(by) for by in table.charge_by])
    factor = xp.ones_like(charging)
    if table.charge_at is not None and table.charge_factor is not None:
        speed = xp.broadcast_to(xp.asarray(rpm, dtype=float)[..., None], charging.shape)
        by_speed = np.array([by == "rpm" for by in table.charge_by])
        variable = xp.where(by_speed, speed, load_share(cylinders, rpm)[..., seats])
        factor = (hats(variable, table.charge_at) * table.charge_factor).sum(axis=-1)

    def at_load(full: Array) -> Array:
        return xp.where(tabled, full * factor, with_the_power(full))

    return at_load(table.charge_pressure), at_load(full_exhaust_pressure(table))


def full_exhaust_pressure(table: Combustions) -> Array:
    """Pressure (Pa) in the exhaust at full load [n]: that of the charge where the table
    has none.
    """
    exhaust = table.exhaust_pressure
    xp = namespace(exhaust, table.charge_pressure)
    return xp.where(exhaust > 0.0, exhaust, table.charge_pressure)


def power_share(cylinders: Cylinders, rpm: Number) -> Array:
    """Power [..., nc] of each cylinder over that at full load.

    The most power up to full load among the rows of its load has the largest load up to
    there as its share; rows of an overload count where the load passes 1, unless a row
    has that load. Above their last speed power is that there. Without rows a cylinder
    runs at full load at every speed.
    """
    rows = cylinders.load_rpm
    loads = cylinders.load_share
    assert rows is not None and loads is not None
    xp = namespace(rows, loads, rpm)
    # Points that fill up the grid do not count.
    present = rows < FAR
    # Rows of an overload are none of full load, unless there are no others.
    within = present & (loads <= 1.0 + FULL_LOAD)
    full = within & (loads >= 1.0 - FULL_LOAD)
    counts = xp.where(within.any(axis=-1, keepdims=True), within, present)
    points, at_points, passed = _full_loads(rows, loads)
    passed = passed & ~full.any(axis=-1, keepdims=True)
    points = xp.concatenate([rows, points], axis=-1)
    at_points = xp.concatenate([loads, at_points], axis=-1)
    counts = xp.concatenate([counts, passed], axis=-1)
    most_power = xp.where(counts, points * at_points, 0.0).max(axis=-1)
    most_load = xp.where(counts, at_points, 0.0).max(axis=-1)
    last_speed = xp.where(present, rows, 0.0).max(axis=-1)
    load = load_share(cylinders, rpm)
    speed = xp.minimum(xp.asarray(rpm, dtype=float)[..., None], last_speed)
    has_rows = most_power > 0.0
    power = load * speed / xp.where(has_rows, most_power, 1.0)
    return xp.where(has_rows, most_load * power, load)


def _full_loads(rows: Array, loads: Array) -> tuple[Array, Array, Array]:
    """Speeds (rpm) between rows [nc, R] at which the load passes that of full load,
    that load, and whether it passes there, [nc, R - 1] each.
    """
    xp = namespace(rows, loads)
    before = loads[:, :-1]
    after = loads[:, 1:]
    passes = (rows[:, 1:] < FAR) & ((before <= 1.0) != (after <= 1.0))
    share = xp.where(passes, 1.0 - before, 0.0) / xp.where(passes, after - before, 1.0)
    speed = rows[:, :-1] + share * (rows[:, 1:] - rows[:, :-1])
    return speed, xp.ones_like(speed), passes


def load_share(cylinders: Cylinders, rpm: Number) -> Array:
    """Load [..., nc] of each cylinder at ``rpm`` [...]: share of the mean effective
    pressure at full load.
    """
    points = cylinders.load_rpm
    shares = cylinders.load_share
    assert points is not None and shares is not None
    xp = namespace(points, shares, rpm)
    x = xp.broadcast_to(
        xp.asarray(rpm, dtype=float)[..., None], (*np.shape(rpm), points.shape[0])
    )
    return (hats(x, points) * shares).sum(axis=-1)


def on_cylinders(
    values: Array, seats: Sequence[int], count: int, *, axis: int
) -> Array:
    """Spread values of some cylinders along ``axis`` over all of them: zeros where
    there is none.
    """
    xp = namespace(values)
    place = np.full(count, len(seats))
    place[list(seats)] = np.arange(len(seats))
    zeros = xp.zeros_like(xp.take(values, np.array([0]), axis=axis))
    return xp.take(xp.concatenate([values, zeros], axis=axis), place, axis=axis)


def _burning(cylinders: Cylinders) -> Array:
    """Pressures per Pa of charge, per Pa in the exhaust and of the heat at full load,
    [3, n, M], of the cylinders with a combustion.
    """
    return _by_strokes(cylinders, _with_heat)


def _unburnt(cylinders: Cylinders) -> Array:
    """Pressures per Pa of charge and per Pa in the exhaust without injection, [2, n,
    M], of the cylinders with a combustion.
    """

    def without_heat(numbers: Mapping[str, Array], revolutions: int) -> Array:
        xp = namespace(numbers)
        return xp.stack(
            unburnt(
                numbers["stroke"],
                numbers["rod"],
                numbers,
                revolutions=revolutions,
                samples=GAS_SAMPLES,
            )
        )

    return _by_strokes(cylinders, without_heat)


def _by_strokes(
    cylinders: Cylinders, pressures_of: Callable[[Mapping[str, Array], int], Array]
) -> Array:
    """``pressures_of(numbers by their names, revolutions)`` of two- and four-strokes,
    in the order of the cylinders.
    """
    table = cylinders.combustion
    assert table is not None
    xp = namespace(cylinders)

    def of_group(revolutions: int, rows: np.ndarray) -> Array:
        seats = np.array(table.seats)[rows]
        numbers = {
            name: xp.asarray(getattr(table, name))[rows]
            for name in (*NUMBERS, "heat", "imep")
        }
        numbers |= {
            name: xp.asarray(getattr(cylinders, name))[seats]
            for name in ("bore", "stroke", "rod")
        }
        numbers["by_work"] = np.array(table.by_work)[rows]
        return pressures_of(numbers, revolutions)

    # Two- and four-strokes have other angles at the same sample.
    return in_groups(table.revolutions, of_group)


def _with_heat(numbers: Mapping[str, Array], revolutions: int) -> Array:
    """Pressures of :func:`_burning`, [3, n, M], of cylinders with the same number of
    revolutions in a gas cycle.
    """
    xp = namespace(numbers)
    stroke = numbers["stroke"]
    rod = numbers["rod"]
    heat, imep, by_work = (
        numbers[name][:, None] for name in ("heat", "imep", "by_work")
    )
    of_charge, of_exhaust, per_joule = pressures(
        numbers["bore"],
        stroke,
        rod,
        numbers,
        revolutions=revolutions,
        samples=GAS_SAMPLES,
    )
    angle = 2.0 * np.pi * revolutions * np.arange(GAS_SAMPLES) / GAS_SAMPLES
    travel = slider_crank(angle, stroke[:, None], rod[:, None])[1]

    def mean_effective(pressure: Array) -> Array:
        # Work of a cycle over the swept volume, in which the area of the piston
        # cancels.
        mean = (pressure * travel).mean(axis=1, keepdims=True)
        return 2.0 * np.pi * revolutions * mean / stroke[:, None]

    def without_work(pressure: Array) -> Array:
        # Where there is an imep, so much heat is taken off that the rest does no work:
        # the imep is then the whole of it.
        idle = mean_effective(pressure) / mean_effective(per_joule)
        return xp.where(by_work, pressure - idle * per_joule, pressure)

    burnt = per_joule * xp.where(by_work, imep / mean_effective(per_joule), heat)
    return xp.stack([without_work(of_charge), without_work(of_exhaust), burnt])


def outside_traces(
    names: Sequence[str], cylinders: Cylinders, rpm: Number
) -> list[str]:
    """Write sentences on speeds and loads outside of the range of traces and of tables
    of tangential pressure; see :meth:`DriveTrain.outside_traces`.
    """
    cylinders_by_range: dict[tuple[str, str], list[str]] = {}
    for i, quantity, value, grid, unit in _grids(cylinders, rpm):
        low = float(grid[0])
        high = float(grid[-1])
        # The product of full load and share rounds.
        rounding = 1e-12 * high
        if not low - rounding <= value <= high + rounding:
            covered = f"({low:g} to {high:g}{unit}): the nearest is used"
            cylinders_by_range.setdefault((quantity, covered), []).append(names[i])
    return [
        f"the {quantity} of {', '.join(map(repr, cylinder_names))} {covered}"
        for (quantity, covered), cylinder_names in cylinders_by_range.items()
    ]


def _grids(
    cylinders: Cylinders, rpm: Number
) -> Iterator[tuple[int, str, float, Array, str]]:
    """Cylinder, quantity and table in words, value at a speed, points of the table, and
    their unit.
    """
    traces = cylinders.traces
    tables = cylinders.tangential_pressure
    if traces is None and tables is None:
        return
    share = np.asarray(load_share(cylinders, rpm))
    for k, i in enumerate(traces.seats if traces is not None else ()):
        assert traces is not None  # it has seats
        speeds, loads = traces.sizes[k]
        lies = "lies outside the pressure traces"
        yield i, f"speed {lies}", float(rpm), traces.rpm[k][:speeds], " rpm"
        if loads > 1:
            load = traces.load[k][:loads]
            yield i, f"load {lies}", float(share[i]), load, ""
    for k, i in enumerate(tables.seats if tables is not None else ()):
        assert tables is not None  # it has seats
        grid = 1e-5 * tables.grid[k][: tables.sizes[k][0]]
        mean_pressure = 1e-5 * float(tables.imep[k] * share[i])
        quantity = "mean indicated pressure lies outside the tangential pressures"
        yield i, quantity, mean_pressure, grid, " bar"

"""Tables of the page on what excites and loads the train: gas in the cylinders, orders, torques over the speed."""

import numpy as np

from jaxhb.excitation import gas
from jaxhb.excitation.gas import FAR, GAS_SAMPLES
from jaxhb.excitation.mean_torques import gas_pressures, mean_torques, scale_at
from jaxhb.report.page.differences import facts_of
from jaxhb.report.text.columns import NONE, Table, alike, plain_number
from jaxhb.report.text.scene_check import torque_rows

GAS = {
    "pressure": "pressure table",
    "traces": "pressure tables over speed and load",
    "combustion": "combustion model",
    "harmonics": "given orders",
    "none": NONE,
}
"""Where the gas torque of a cylinder comes from."""

SPEEDS = 8
"""Speeds of a table, of more those that are spread evenly over them."""

ROWS = 24
"""Rows of a table over the speed where cylinders differ, about."""

BESIDE = 3
"""Columns of orders beside one another."""

BAR = 1e-5


def gas_words(topology, cylinder):
    """Where the gas torque of a cylinder comes from, in words."""
    return GAS.get(topology.cylinder_source[cylinder], NONE)


def excitation_tables(report):
    """Combustion data, gas and mean torques over the speed, given orders: a list of Table.

    Cylinders that differ in nothing but their firing angle and their throw share a row.
    """
    train, files = report.train, report.files or {}
    named = files.get("cylinder") or [{}] * len(train.topology.cylinder_names)
    groups = _groups(train, "cylinder", train.topology.cylinder_names, ("firing_angle", "disk"), named)
    rows = [_sources(train, groups, named), _models(train, groups), _traces(train, groups)]
    rows += [_gas(train, groups, report.rpm), _means(report), *_given(train, groups, files)]
    return [table for table in rows if table is not None]


def _some(values, most=SPEEDS):
    """So many of a list, its ends among them."""
    places = np.unique(np.round(np.linspace(0, len(values) - 1, max(2, most))).astype(int))
    return [values[place] for place in places]


def _groups(train, table, names, besides, files):
    """``{names in words: number of the first}`` of elements that have the same data but for some fields."""
    found = {}
    for i, name in enumerate(names):
        facts = facts_of(train, table, i).items()
        same = tuple((key, np.asarray(value).tobytes()) for key, value in facts if key not in besides)
        found.setdefault((same, *files[i].items()), []).append((name, i))
    if len(found) == 1 and len(names) > 2:
        return {f"all {len(names)} {table}s": 0}
    return {", ".join(name for name, _ in own): own[0][1] for own in found.values()}


def _table(title, heads, rows, left=()):
    return Table(title, heads, list(zip(*rows, strict=True)), left=left) if rows else None


def _number(value, digits=4):
    return plain_number(float(value), digits) if np.isfinite(value) else NONE


def _over(speeds, values, file):
    """A table over the speed in words: its range, its number of points, its file."""
    known = np.asarray(speeds)[np.asarray(speeds) < FAR]
    points = np.unique(known)
    if len(points) < 2:
        return NONE
    span = (
        f"{np.min(values):.3g} to {np.max(values):.3g}, {len(points)} points from {points[0]:g} to {points[-1]:g} rpm"
    )
    return f"{span}, {file}" if file else span


def torque_over_speed(train, torque, files):
    """How a given torque changes over the speed, in words."""
    torques, own = train.torques, files[torque] if files else {}
    said = [_over(torques.scale_rpm[torque], torques.scale_factor[torque], own.get("scale", ""))]
    if torques.rated_rpm is not None and torques.rated_rpm[torque]:
        exponent, rated = torques.speed_exponent[torque], torques.rated_rpm[torque]
        said.append(f"(rpm / {rated:g})^{exponent:g}")
    return " and ".join(one for one in said if one != NONE) or NONE


def _sources(train, groups, files):
    """Where the gas torques come from, and what changes them over the speed."""
    topology, cylinders, rows = train.topology, train.cylinders, []
    for label, i in groups.items():
        own, source = files[i], topology.cylinder_source[i]
        file = own.get({"harmonics": "gas_torque"}.get(source, source), "in the scene" if source != "none" else NONE)
        scale = _over(cylinders.scale_rpm[i], cylinders.scale_factor[i], own.get("scale", ""))
        share = NONE
        if cylinders.load_rpm is not None and source in ("traces", "combustion"):
            share = _over(cylinders.load_rpm[i], cylinders.load_share[i], own.get("load", ""))
        factor = 1.0 if cylinders.gas_factor is None else cylinders.gas_factor[i]
        kept = [NONE] * 2
        if source in gas.COMPUTED:
            highest = topology.cylinder_gas[i] / topology.cylinder_gas_revolutions[i]
            kept = [_number(BAR * cylinders.ambient_pressure[i]), _number(highest)]
        rows.append([gas_words(topology, i), label, file, *kept, _number(factor), scale, share])
    heads = ["gas torque from", "cylinders", "file", "crankcase bar", "orders up to", "factor", "factor over the speed"]
    heads.append("share of full load over the speed")
    columns = list(zip(*rows, strict=True)) or [()] * len(heads)
    chosen = [k for k in range(len(heads)) if k not in (6, 7) or set(columns[k]) != {NONE}]
    title = "Combustion: where gas torques come from; factors multiply them, between points of a table linear"
    rows = [[row[k] for k in chosen] for row in rows]
    return _table(title, [heads[k] for k in chosen], rows, left=(1, 2, *range(6, len(chosen))))


def _models(train, groups):
    """Numbers of the combustion models."""
    burning, rows = train.cylinders.combustion, []
    if burning is None:
        return None
    for label, i in groups.items():
        if i in burning.seats:
            k = burning.seats.index(i)
            by = f"imep {_number(BAR * burning.imep[k])} bar" if burning.by_work[k] else f"{_number(burning.heat[k])} J"
            cells = [burning.compression_ratio[k], BAR * burning.charge_pressure[k], BAR * burning.exhaust_pressure[k]]
            cells += [burning.start[k], burning.duration[k], burning.shape[k]]
            cells += [burning.compression_exponent[k], burning.expansion_exponent[k]]
            rows.append([label, by, *map(_number, cells)])
    heads = ["cylinders", "burnt at full load", "compression ratio", "charge bar", "exhaust bar", "start deg"]
    heads += ["duration deg", "shape", "n compression", "n expansion"]
    return _table(
        "Combustion model: angles from firing top dead centre, polytropic exponents n", heads, rows, left=(1,)
    )


def _traces(train, groups):
    """Peaks of the pressure tables over speed and load."""
    traces, rows = train.cylinders.traces, []
    for label, i in groups.items() if traces is not None else ():
        if i in traces.seats:
            k = traces.seats.index(i)
            speeds, loads = traces.sizes[k]
            for r in range(speeds):
                for s in range(loads):
                    peak, angle = _peak(traces.pressure[k, r, s], train.topology.cylinder_gas_revolutions[i])
                    at = f"{traces.rpm[k, r]:g}", _number(traces.load[k, s])
                    rows.append([label, *at, _number(BAR * peak), f"{angle:.1f}"])
    heads = ["cylinders", "at rpm", "load share", "largest pressure bar", "deg after firing TDC"]
    return _table("Pressure tables over speed and load: the nearest is used outside of them", heads, rows)


def _peak(pressure, turns):
    """Largest pressure and its angle after firing top dead centre, deg; negative: before."""
    place, period = int(np.argmax(pressure)), 360.0 * turns
    angle = place * period / GAS_SAMPLES
    return float(pressure[place]), angle - period * (angle > period / 2)


def _gas(train, groups, rpm):
    """Peak pressure, its angle, mean effective pressure and mean torque of the cylinders at speeds of the report."""
    topology, cylinders = train.topology, train.cylinders
    chosen = _some(list(rpm), min(SPEEDS, ROWS // max(len(groups), 1)))
    speeds = np.array(chosen)
    own = np.ones(len(cylinders.bore)) if cylinders.gas_factor is None else np.asarray(cylinders.gas_factor)
    factors, pressures = own * scale_at(cylinders, speeds), own[:, None] * gas_pressures(cylinders, speeds)
    cycle = topology.cylinder_fires, topology.cylinder_gas_revolutions
    means = mean_torques(train.torques, cylinders, *cycle, speeds)[:, len(topology.torque_names) :]
    rows = []
    for label, i in groups.items():
        if topology.cylinder_source[i] == "none":
            continue
        computed, turns = topology.cylinder_source[i] in gas.COMPUTED, topology.cylinder_gas_revolutions[i]
        swept = np.pi / 4 * cylinders.bore[i] ** 2 * cylinders.stroke[i]
        for place, speed in enumerate(chosen):
            cells = [NONE] * 3
            if computed and topology.cylinder_fires[i]:
                peak, angle = _peak(pressures[place, i], turns)
                # Work of a gas cycle over the swept volume.
                imep = 2 * np.pi * turns * means[place, i] / swept
                cells = [_number(BAR * peak), f"{angle:.1f}", _number(BAR * imep)]
            rows.append([label, f"{speed:g}", _number(factors[place, i]), *cells, _number(means[place, i])])
    heads = ["cylinders", "rpm", "factor", "largest pressure bar", "deg after firing TDC", "imep bar"]
    if all(row[3] == NONE for row in rows):
        heads, rows = [*heads[:3]], [[*row[:3], row[6]] for row in rows]
    title = "Gas of one cylinder over the speed"
    return _table(title, [*heads, "mean torque N m"], rows)


def _means(report):
    """Mean torques of everything that drives and takes power, and the power of the loads, over the speed."""
    answers = _some(report.cases[0].answers)
    rows = torque_rows(report.train, [answer.linear for answer in answers])
    if not rows:
        return None
    together, cylinders = {}, set(report.train.topology.cylinder_names)
    for name, disk, means in rows:
        key = (True, tuple(means)) if name in cylinders else (False, name)
        together.setdefault(key, []).append((name, disk, means))
    cells = []
    for (cylinder, _), own in together.items():
        name, disk, means = own[0]
        many = f"{len(own)} cylinders, each" if cylinder and len(own) > 2 else ", ".join(one for one, *_ in own)
        cells.append((many, disk if len(own) == 1 else NONE, means))
    columns = alike(*zip(*(means for *_, means in cells), strict=True))
    names = [[name for name, *_ in cells], [disk for _, disk, _ in cells]]
    if report.train.topology.load_names:
        names = [[*names[0], "power of the loads, kW"], [*names[1], NONE]]
        columns = [[*column, _number(answer.balance.load_kW)] for column, answer in zip(columns, answers, strict=True)]
    title = "Mean torques over the speed, N m on the disk's own shaft (positive: drives), and what the loads take"
    return Table(
        title, ["element", "disk", *(f"{answer.rpm:g} rpm" for answer in answers)], [*names, *columns], left=(1,)
    )


def _given(train, groups, files):
    """Orders that the scene gives: of torques, of gas torques, of loads; those with the same amplitudes in a table."""
    topology, found = train.topology, {}
    named = files.get("torque") or [{}] * len(topology.torque_names)
    gases = files.get("cylinder") or [{}] * len(topology.cylinder_names)
    own = [
        (name, "N m", topology.torque_harmonics[i], train.torques.harmonics[i], named[i].get("harmonics"))
        for i, name in enumerate(topology.torque_names)
    ]
    own += [
        (
            f"gas torque of {label}, firing at 0",
            "N m",
            topology.cylinder_harmonics[i],
            train.cylinders.gas_torque[i],
            gases[i].get("gas_torque"),
        )
        for label, i in groups.items()
        if topology.cylinder_source[i] == "harmonics"
    ]
    pulsating = topology.load_names if train.loads.harmonics is not None else ()
    own += [
        (name, "over the mean", topology.load_harmonics[i], train.loads.harmonics[i], None)
        for i, name in enumerate(pulsating)
    ]
    for name, unit, harmonics, values, file in own:
        rows = [
            (n / topology.revolutions_per_cycle, complex(*value)) for n, value in zip(harmonics, values, strict=False)
        ]
        rows.sort(key=lambda row: row[0])
        same = tuple((order, f"{abs(value):.6g}") for order, value in rows)
        found.setdefault((same, unit, file), {})[name] = rows
    return [_orders(alike, unit, file) for (same, unit, file), alike in found.items() if same]


def _orders(own, unit, file):
    """Orders, amplitudes, phases: of one element in columns beside one another, of several a column of phases each."""
    rows, names = next(iter(own.values())), list(own)
    cells = [[f"{order:g}" for order, _ in rows], alike([abs(value) for _, value in rows])[0]]
    cells += [[_phase(value) for _, value in one] for one in own.values()]
    heads = ["order", f"A {unit}", *(["p deg"] if len(own) == 1 else names)]
    groups = [("p deg", 2, len(own) + 1)] if len(own) > 1 else ()
    if len(own) == 1 and len(rows) > 2 * BESIDE:
        size = -(-len(rows) // BESIDE)
        pad = [""] * (BESIDE * size - len(rows))
        cells = [[*column, *pad][part * size :][:size] for part in range(BESIDE) for column in cells]
        heads = heads * BESIDE
    source = f", from {file}" if file else ""
    called = ", ".join(names) if len(names) <= BESIDE else f"{len(names)} torques with the same amplitudes"
    title = f"Orders of {called}{source}: A cos(order x angle + p), angle of the reference rotor"
    return Table(title, heads, cells, groups)


def _phase(value):
    return f"{np.degrees(np.angle(value)):.1f}" if value else NONE

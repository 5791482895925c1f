"""Tables of the page on what excites and loads the train: gas in the cylinders, orders, torques over the speed."""

import numpy as np

from jaxhb.excitation import gas
from jaxhb.excitation.gas import FAR, GAS_SAMPLES
from jaxhb.excitation.mean_torques import gas_pressures, mean_torques, scale_at
from jaxhb.report.page.differences import facts_of
from jaxhb.report.page.parts import table
from jaxhb.report.text.columns import NONE, Table, alike
from jaxhb.report.text.mean_torques import plain_number
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
    train, names = report.train, report.train.topology.cylinder_names
    files = report.files.get("cylinder") or [{}] * len(names)
    alike_ones = {}
    for i, name in enumerate(names):
        facts = facts_of(train, "cylinder", i).items()
        same = tuple((key, np.asarray(value).tobytes()) for key, value in facts if key not in ("firing_angle", "disk"))
        alike_ones.setdefault((same, *files[i].items()), []).append((name, i))
    groups = {", ".join(name for name, _ in own): own[0][1] for own in alike_ones.values()}
    if len(groups) == 1 and len(names) > 2:
        groups = {f"all {len(names)} cylinders": 0}
    tables = [_sources(train, groups, files), _models(train, groups), _traces(train, groups)]
    tables += [_gas(train, groups, report.rpm), _means(report), *_given(train, groups, report.files)]
    return [one for one in tables if one is not None]


def _some(values, most=SPEEDS):
    """So many of a list, its ends among them."""
    return [values[k] for k in np.unique(np.round(np.linspace(0, len(values) - 1, max(2, most))).astype(int))]


def _over(speeds, values, file):
    """A table over the speed in words: its range, its number of points, its file."""
    points = np.unique(np.asarray(speeds)[np.asarray(speeds) < FAR])
    if len(points) < 2:
        return NONE
    span = f"{len(points)} points from {points[0]:g} to {points[-1]:g} rpm"
    return ", ".join(filter(None, [f"{np.min(values):.3g} to {np.max(values):.3g}", span, file]))


def torque_over_speed(train, torque, files):
    """How a given torque changes over the speed, in words."""
    torques, own = train.torques, files[torque] if files else {}
    said = [_over(torques.scale_rpm[torque], torques.scale_factor[torque], own.get("scale", ""))]
    if torques.rated_rpm is not None and torques.rated_rpm[torque]:
        exponent, rated = torques.speed_exponent[torque], torques.rated_rpm[torque]
        said.append(f"(rpm / {rated:g})^{exponent:g}")
    return " and ".join(one for one in said if one != NONE) or NONE


def _gas_factors(cylinders):
    return np.ones(len(cylinders.bore)) if cylinders.gas_factor is None else np.asarray(cylinders.gas_factor)


def _sources(train, groups, files):
    """Where the gas torques come from, and what changes them over the speed."""
    topology, cylinders, source = train.topology, train.cylinders, train.topology.cylinder_source
    loaded = {i for i in groups.values() if cylinders.load_rpm is not None and source[i] in ("traces", "combustion")}

    def file(i):
        key = {"harmonics": "gas_torque"}.get(source[i], source[i])
        return files[i].get(key, "in the scene" if source[i] != "none" else NONE)

    def over(i, what, values):
        speeds = getattr(cylinders, f"{what}_rpm")[i]
        return _over(speeds, getattr(cylinders, f"{what}_{values}")[i], files[i].get(what, ""))

    def highest(i):
        return topology.cylinder_gas[i] / topology.cylinder_gas_revolutions[i]

    columns = {
        "gas torque from": lambda row: gas_words(topology, row[1]),
        "cylinders": lambda row: row[0],
        "file": lambda row: file(row[1]),
        "crankcase bar": lambda row: (
            BAR * cylinders.ambient_pressure[row[1]] if _computed(topology, row[1]) else np.nan
        ),
        "orders up to": lambda row: highest(row[1]) if _computed(topology, row[1]) else np.nan,
        "factor": lambda row: _gas_factors(cylinders)[row[1]],
    }
    more = {
        "factor over the speed": lambda row: over(row[1], "scale", "factor"),
        "share of full load over the speed": lambda row: over(row[1], "load", "share") if row[1] in loaded else NONE,
    }
    columns |= {head: read for head, read in more.items() if any(read(row) != NONE for row in groups.items())}
    title = "Combustion: where gas torques come from; factors multiply them, between points of a table linear"
    return table(title, groups.items(), columns, digits=4)


def _computed(topology, cylinder):
    """Whether the gas torque of a cylinder is computed from a pressure."""
    return topology.cylinder_source[cylinder] in gas.COMPUTED


def _models(train, groups):
    """Numbers of the combustion models."""
    burning = train.cylinders.combustion
    if burning is None:
        return None

    def burnt(row):
        work, k = burning.by_work[row[1]], row[1]
        much = BAR * burning.imep[k] if work else burning.heat[k]
        return f"imep {plain_number(float(much))} bar" if work else f"{plain_number(float(much))} J"

    columns = {
        "cylinders": lambda row: row[0],
        "burnt at full load": burnt,
        "compression ratio": lambda row: burning.compression_ratio[row[1]],
        "charge bar": lambda row: BAR * burning.charge_pressure[row[1]],
        "exhaust bar": lambda row: BAR * burning.exhaust_pressure[row[1]],
        "start deg": lambda row: burning.start[row[1]],
        "duration deg": lambda row: burning.duration[row[1]],
        "shape": lambda row: burning.shape[row[1]],
        "n compression": lambda row: burning.compression_exponent[row[1]],
        "n expansion": lambda row: burning.expansion_exponent[row[1]],
    }
    rows = [(label, burning.seats.index(i)) for label, i in groups.items() if i in burning.seats]
    title = "Combustion model: angles from firing top dead centre, polytropic exponents n"
    return table(title, rows, columns, digits=4)


def _traces(train, groups):
    """Peaks of the pressure tables over speed and load."""
    traces, rows = train.cylinders.traces, []
    for label, i in groups.items() if traces is not None else ():
        if i in traces.seats:
            k = traces.seats.index(i)
            for r, s in np.ndindex(*traces.sizes[k]):
                peak = _peak(traces.pressure[k, r, s], train.topology.cylinder_gas_revolutions[i])
                rows.append((label, f"{traces.rpm[k, r]:g}", traces.load[k, s], *peak))
    heads = ["cylinders", "at rpm", "load share", "largest pressure bar", "deg after firing TDC"]
    title = "Pressure tables over speed and load: the nearest is used outside of them"
    return table(title, rows, heads, digits=4)


def _peak(pressure, turns):
    """Largest pressure in bar, and its angle after firing top dead centre in deg; negative: before."""
    place, period = int(np.argmax(pressure)), 360.0 * turns
    angle = place * period / GAS_SAMPLES
    return BAR * float(pressure[place]), f"{angle - period * (angle > period / 2):.1f}"


def _gas(train, groups, rpm):
    """Peak pressure, its angle, mean effective pressure and mean torque of the cylinders at speeds of the report."""
    topology, cylinders = train.topology, train.cylinders
    chosen = _some(list(rpm), min(SPEEDS, ROWS // max(len(groups), 1)))
    speeds, own, rows = np.array(chosen), _gas_factors(cylinders), []
    factors, pressures = own * scale_at(cylinders, speeds), own[:, None] * gas_pressures(cylinders, speeds)
    cycle = topology.cylinder_fires, topology.cylinder_gas_revolutions
    means = mean_torques(train.torques, cylinders, *cycle, speeds)[:, len(topology.torque_names) :]
    giving = {label: i for label, i in groups.items() if topology.cylinder_source[i] != "none"}
    for label, i in giving.items():
        turns, swept = topology.cylinder_gas_revolutions[i], np.pi / 4 * cylinders.bore[i] ** 2 * cylinders.stroke[i]
        for k, speed in enumerate(chosen):
            cells = [NONE] * 3
            if _computed(topology, i) and topology.cylinder_fires[i]:
                # Work of a gas cycle over the swept volume.
                cells = [*_peak(pressures[k, i], turns), BAR * 2 * np.pi * turns * means[k, i] / swept]
            rows.append([label, f"{speed:g}", factors[k, i], means[k, i], *cells])
    heads = [
        "cylinders",
        "rpm",
        "factor",
        "mean torque N m",
        "largest pressure bar",
        "deg after firing TDC",
        "imep bar",
    ]
    known = 7 if any(row[4] != NONE for row in rows) else 4
    return table("Gas of one cylinder over the speed", rows, heads[:known], digits=4)


def _means(report):
    """Mean torques of everything that drives and takes power, and the power of the loads, over the speed."""
    answers, cylinders = _some(report.cases[0].answers), report.train.topology.cylinder_names
    together = {}
    for name, disk, means in torque_rows(report.train, [answer.linear for answer in answers]):
        key = (True, tuple(means)) if name in cylinders else (False, name)
        together.setdefault(key, []).append((name, disk, means))
    if not together:
        return None
    rows = list(together.values())
    many = [
        f"{len(own)} cylinders, each" if cylinder and len(own) > 2 else ", ".join(name for name, *_ in own)
        for (cylinder, _), own in together.items()
    ]
    columns = alike(*zip(*(own[0][2] for own in rows), strict=True))
    names = [many, [own[0][1] if len(own) == 1 else NONE for own in rows]]
    if report.train.topology.load_names:
        names = [[*names[0], "power of the loads, kW"], [*names[1], NONE]]
        power = [plain_number(answer.balance.load_kW) for answer in answers]
        columns = [[*column, taken] for column, taken in zip(columns, power, strict=True)]
    title = "Mean torques over the speed, N m on the disk's own shaft (positive: drives), and what the loads take"
    return Table(title, ["element", "disk", *(f"{answer.rpm:g} rpm" for answer in answers)], [*names, *columns])


def _given(train, groups, files):
    """Orders that the scene gives: of torques, of gas torques, of loads; those with the same amplitudes in a table."""
    topology, found = train.topology, {}
    torques, gases = files.get("torque"), files.get("cylinder")
    own = [
        (name, "N m", topology.torque_harmonics[i], train.torques.harmonics[i], torques and torques[i].get("harmonics"))
        for i, name in enumerate(topology.torque_names)
    ]
    for label, i in groups.items():
        if topology.cylinder_source[i] == "harmonics":
            values = topology.cylinder_harmonics[i], train.cylinders.gas_torque[i]
            own.append((f"gas torque of {label}, firing at 0", "N m", *values, gases and gases[i].get("gas_torque")))
    if train.loads.harmonics is not None:
        loads = zip(topology.load_names, topology.load_harmonics, train.loads.harmonics, strict=False)
        own += [(name, "over the mean", harmonics, values, None) for name, harmonics, values in loads]
    for name, unit, harmonics, values, file in own:
        orders = [harmonic / topology.revolutions_per_cycle for harmonic in harmonics]
        rows = sorted(zip(orders, (complex(*value) for value in values), strict=False), key=lambda row: row[0])
        same = tuple((order, f"{abs(value):.6g}") for order, value in rows)
        found.setdefault((same, unit, file), {})[name] = rows
    return [_orders(alike_ones, unit, file) for (same, unit, file), alike_ones in found.items() if same]


def _orders(own, unit, file):
    """Orders, amplitudes, phases: of one element in columns beside one another, of several a column of phases each."""
    rows, names = next(iter(own.values())), list(own)
    cells = [[f"{order:g}" for order, _ in rows], alike([abs(value) for _, value in rows])[0]]
    cells += [[f"{np.degrees(np.angle(value)):.1f}" if value else NONE for _, value in one] for one in own.values()]
    heads, groups = ["order", f"A {unit}", *(["p deg"] if len(own) == 1 else names)], ()
    if len(own) > 1:
        groups = [("p deg", 2, len(own) + 1)]
    elif len(rows) > 2 * BESIDE:
        size = -(-len(rows) // BESIDE)
        pad = [""] * (BESIDE * size - len(rows))
        cells = [[*column, *pad][part * size :][:size] for part in range(BESIDE) for column in cells]
        heads = heads * BESIDE
    source = f", from {file}" if file else ""
    called = ", ".join(names) if len(names) <= BESIDE else f"{len(names)} torques with the same amplitudes"
    title = f"Orders of {called}{source}: A cos(order x angle + p), angle of the reference rotor"
    return Table(title, heads, cells, groups)

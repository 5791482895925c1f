"""Parts of the page on what was computed: the train, what excites and loads it, assumptions, versions."""

import io
import re

import numpy as np

from jaxhb.excitation import gas
from jaxhb.excitation.gas import FAR, GAS_SAMPLES
from jaxhb.excitation.mean_torques import gas_pressures, mean_torques, scale_at
from jaxhb.report.figures.sketch import plot_train
from jaxhb.report.page.differences import facts_of
from jaxhb.report.page.parts import table
from jaxhb.report.text.columns import NONE, Table, alike, plain_number
from jaxhb.report.text.mean_torques import mean_angles_of
from jaxhb.report.text.scene_check import referred_tables, torque_rows


def train_data(report):
    """Sketch, numbers as they are and referred, meshes, what excites and what loads the train."""
    train, sketch, refusal = report.train, "", ""
    try:
        content = io.StringIO()
        # The page has a date of its own.
        plot_train(train).savefig(content, format="svg", metadata={"Date": None})
        # Inside HTML an SVG has no XML head.
        sketch = re.sub(r"\A.*?(?=<svg)", "", content.getvalue(), flags=re.DOTALL)
    except ValueError as error:
        refusal = str(error)
    tables = [*referred_tables(train), _meshes(train), _cylinders(train), _torques(report), _loads(train)]
    return {"sketch": sketch, "refusal": refusal, "tables": [*filter(None, tables), *excitation_tables(report)]}


def _meshes(train):
    topology, meshes, radius = train.topology, train.meshes, train.disks.radius
    gaps = np.where(topology.mesh_backlash, [meshes.backlash, meshes.epsilon, meshes.transition], np.nan)

    def teeth(i):
        both = [topology.teeth[disk] for disk in topology.mesh_ends[i]]
        return " : ".join(map(str, both)) if all(both) else NONE

    columns = {
        "mesh": lambda i: topology.mesh_names[i],
        "kind": lambda i: "internal" if topology.mesh_internal[i] else "external",
        "radii mm": lambda i: " : ".join(_number(1e3 * radius[disk]) for disk in topology.mesh_ends[i]),
        "teeth": teeth,
        "backlash mm": lambda i: 1e3 * gaps[0, i],
        "epsilon": lambda i: gaps[1, i],
        "transition": lambda i: gaps[2, i],
        "damping law": lambda i: topology.mesh_damping_law[i],
    }
    title = "Meshes: epsilon is the stiffness in the gap over that in contact, transition its width over the backlash"
    return table(title, range(len(topology.mesh_names)), columns)


def _number(value):
    return plain_number(float(value), digits=6)


def _cylinders(train):
    topology, cylinders = train.topology, train.cylinders
    columns = {
        "cylinder": lambda i: topology.cylinder_names[i],
        "disk": lambda i: topology.disk_names[topology.cylinder_disk[i]],
        "firing angle deg": lambda i: cylinders.firing_angle[i],
        "fires": lambda i: "yes" if topology.cylinder_fires[i] else "no",
        "gas torque from": lambda i: gas_words(topology, i),
        "bore mm": lambda i: 1e3 * cylinders.bore[i] or np.nan,
        "stroke mm": lambda i: 1e3 * cylinders.stroke[i] or np.nan,
        # Without a stroke the rod is one that stands in for none.
        "rod mm": lambda i: (1e3 * cylinders.rod[i] if cylinders.stroke[i] > 0 else 0.0) or np.nan,
        "recip. mass kg": lambda i: cylinders.reciprocating_mass[i] or np.nan,
    }
    return table("Cylinders", range(len(topology.cylinder_names)), columns)


def _torques(report):
    topology, torques = report.train.topology, report.train.torques
    columns = {
        "torque": lambda i: topology.torque_names[i],
        "disk": lambda i: topology.disk_names[topology.torque_disk[i]],
        "mean N m": lambda i: torques.mean[i],
        "orders": lambda i: len(topology.torque_harmonics[i]),
        "orders of": lambda i: "own" if topology.torque_own[i] else "reference",
        "factor over the speed": lambda i: torque_over_speed(report.train, i, report.files.get("torque")),
    }
    title = "Torques given by their orders, before the factor over the speed"
    return table(title, range(len(topology.torque_names)), columns)


def _loads(train):
    topology, rows = train.topology, []
    for name, disk, share in zip(topology.load_names, topology.load_disk, train.loads.share, strict=True):
        rows.append((name, topology.disk_names[disk], "load", f"share {_number(share)}"))
    for name, disk, stiff in zip(topology.ground_names, topology.ground_disk, train.grounds.stiffness, strict=True):
        rows.append((name, topology.disk_names[disk], "ground", f"{_number(stiff)} N m/rad"))
    return table("Loads, which balance the mean power, and grounds", rows, ["element", "disk", "kind", ""])


def assumptions(report):
    """What holds for every number of the page, and what made it."""
    topology, burning = report.train.topology, report.train.cylinders.combustion
    burnt = ""  # the number of a scene without which a cylinder compresses and does not burn
    if burning is not None:
        name = topology.cylinder_names[burning.seats[0]]
        burnt = f"{name}.combustion.{'imep' if burning.by_work[0] else 'heat'}"
    source = Table("Where this page comes from", ["", ""], list(zip(*report.facts.items(), strict=True)))
    return {
        "topology": topology,
        "orbit": report.cases[0].answers[0].orbit,
        "burnt": burnt,
        "mean_angles": mean_angles_of(topology),
        "source": source,
    }


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
    topology, cylinders, rows = train.topology, train.cylinders, []
    for label, i in groups.items():
        source, own = topology.cylinder_source[i], files[i]
        file = own.get({"harmonics": "gas_torque"}.get(source, source), "in the scene" if source != "none" else NONE)
        kept = [np.nan] * 2
        if source in gas.COMPUTED:
            highest = topology.cylinder_gas[i] / topology.cylinder_gas_revolutions[i]
            kept = [BAR * cylinders.ambient_pressure[i], highest]
        over = [_over(cylinders.scale_rpm[i], cylinders.scale_factor[i], own.get("scale", "")), NONE]
        if cylinders.load_rpm is not None and source in ("traces", "combustion"):
            over[1] = _over(cylinders.load_rpm[i], cylinders.load_share[i], own.get("load", ""))
        rows.append((gas_words(topology, i), label, file, *kept, _gas_factors(cylinders)[i], *over))
    heads = ["gas torque from", "cylinders", "file", "crankcase bar", "orders up to", "factor"]
    rare = ["factor over the speed", "share of full load over the speed"]
    title = "Combustion: where gas torques come from; factors multiply them, between points of a table linear"
    return table(title, rows, heads + rare, digits=4, rare=rare)


def _models(train, groups):
    """Numbers of the combustion models."""
    burning, rows = train.cylinders.combustion, []
    for label, i in groups.items() if burning is not None else ():
        if i in burning.seats:
            k = burning.seats.index(i)
            much, unit = (BAR * burning.imep[k], "bar") if burning.by_work[k] else (burning.heat[k], "J")
            pressures = BAR * burning.charge_pressure[k], BAR * burning.exhaust_pressure[k]
            exponents = burning.compression_exponent[k], burning.expansion_exponent[k]
            cells = burning.compression_ratio[k], *pressures, burning.start[k], burning.duration[k], burning.shape[k]
            burnt = "imep " * bool(burning.by_work[k]) + f"{plain_number(float(much))} {unit}"
            rows.append((label, burnt, *cells, *exponents))
    heads = ["cylinders", "burnt at full load", "compression ratio", "charge bar", "exhaust bar", "start deg"]
    heads += ["duration deg", "shape", "n compression", "n expansion"]
    title = "Combustion model: angles from firing top dead centre, polytropic exponents n"
    return table(title, rows, heads, digits=4)


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
            if topology.cylinder_source[i] in gas.COMPUTED and topology.cylinder_fires[i]:
                # Work of a gas cycle over the swept volume.
                cells = [*_peak(pressures[k, i], turns), BAR * 2 * np.pi * turns * means[k, i] / swept]
            rows.append([label, f"{speed:g}", factors[k, i], *cells, means[k, i]])
    rare = ["largest pressure bar", "deg after firing TDC", "imep bar"]
    heads = ["cylinders", "rpm", "factor", *rare, "mean torque N m"]
    return table("Gas of one cylinder over the speed", rows, heads, digits=4, rare=rare)


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

"""Numbers that an engineer checks by hand, beside jaxhb, on two plants: modes, orders,
stresses, limits, losses, blade orders, a misfire that keeps its compression.

    python benchmarks/hand_checks.py                     both plants, a minute
    python benchmarks/hand_checks.py --plants two_stroke --json rows.jsonl

The hand is :mod:`hand_plant`: NumPy from the physics and the numbers of the scene file,
with nothing of jaxhb. jaxhb's numbers are those of its public functions and of the JSON
of ``jaxhb check``. Differences are those of phasors where there are phases, as a share
of the size by hand. Exit status 1 if one is above 0.5 %.
"""

import copy
import json
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from hand_plant import (
    Plant,
    inertia_orders,
    inertia_series,
    m68_limits,
    over_cycle,
    radians_per_second,
    swing,
)
from records import command_line, started

import jaxhb

PLANTS = Path(__file__).parent / "plants"
ALLOWED = 0.5
"""Largest difference in %."""
ELASTIC = slice(1, 6)
"""The first five modes above the rigid one."""
COLUMNS = {"kind": "<21s", "plant": "<11s", "quantity": "<76s", "by_hand": "13.6g",
           "jaxhb": "13.6g", "percent": "9.1e", "note": "<54s"}  # fmt: skip
STEPPED = "jaxhb takes the cycle at 7200 angles"
SAMPLED = "jaxhb takes the extremes of 4096 instants or more"


@dataclass(frozen=True)
class Check:
    """One number twice, phasors where it has a phase; None where the plant lacks it, as
    the note says.
    """

    kind: str
    quantity: str
    by_hand: complex | None = None
    by_jaxhb: complex | None = None
    note: str = ""

    @property
    def percent(self):
        """Difference as a share of the size by hand, %."""
        if self.by_hand is None:
            return None
        return 100.0 * abs(self.by_jaxhb - self.by_hand) / abs(self.by_hand)


@dataclass(frozen=True)
class Case:
    """Choice of the numbers that are checked on a plant.

    resonance : number of the mode and order that meet at the critical speed; shaft : what
    is judged there; cylinder : whose torques are compared, and which misfires; disks : two
    whose angles are; sums : links of torque sums and energies by modes, the first one of
    forced torques too; orders : of vector sums and critical speeds; misfire_orders :
    lowest of a misfire; gas_orders : of the crank, all others of the reference shaft;
    part_load : rpm; scenario : whose frequencies are; losses : links that heat; lacking :
    what the plant has not, by kind
    """

    name: str
    resonance: tuple[int, float]
    shaft: str
    cylinder: str
    disks: tuple[str, str]
    sums: dict[int, str]
    orders: tuple[float, ...]
    misfire_orders: tuple[float, ...]
    gas_orders: tuple[float, ...]
    part_load: float
    scenario: str
    losses: tuple[str, ...]
    lacking: dict[str, str] = field(default_factory=dict)


CASES = {
    "two_stroke": Case(
        name="two_stroke",
        resonance=(1, 6.0),
        shaft="propeller shaft 1",
        cylinder="cylinder 3",
        disks=("tuning wheel", "propeller"),
        sums={1: "flange bolts", 2: "intermediate 3"},
        orders=(1.0, 3.0, 4.0, 6.0),
        misfire_orders=(1.0, 2.0),
        gas_orders=(1.0, 2.0, 3.0, 6.0, 12.0),
        part_load=60.0,
        scenario="ice clad propeller",
        losses=("intermediate 3", "propeller shaft 2"),
        lacking={
            "14 heat": "no damper and no coupling with a power_limit",
            "15 gears": "no gears",
        },
    ),
    "twin_v12": Case(
        name="twin_v12",
        resonance=(8, 13.5),
        shaft="generator quill",
        cylinder="port A3",
        disks=("port throw 1", "port coupling inner"),
        sums={2: "port coupling row 1", 3: "generator quill"},
        orders=(1.5, 7.5, 13.5, 18.0),
        misfire_orders=(1.5, 3.0),
        gas_orders=(0.5, 1.0, 1.5, 2.5, 3.0, 6.0),
        part_load=200.0,
        scenario="port engine alone",
        losses=("port coupling row 1", "port coupling row 2"),
        lacking={"14 heat": "no damper: its couplings have the limits"},
    ),
}


class Both:
    """A plant by hand and the train of jaxhb, with the motions that several checks
    read.
    """

    def __init__(self, case):
        self.case = case
        self.path = PLANTS / f"{case.name}.toml"
        self.scene = tomllib.loads(self.path.read_text())
        self.hand = Plant(self.scene)
        self.train = jaxhb.load_scene(self.path)
        self.rated = self.hand.rated_rpm
        self.engine = self.hand.engine_of(case.cylinder)
        self.ratio = self.hand.ratio[self.hand.disk(self.engine.disk(case.cylinder))]
        # A damping over the speed asks for one, though no undamped mode depends on it.
        self.fixed = self.train.with_constant_links(rpm=self.rated)

    @cached_property
    def modes(self):
        return jaxhb.natural_frequencies(self.fixed)

    @cached_property
    def checked(self):
        """JSON of ``jaxhb check`` at part load and at the rated speed."""
        speeds = f"{self.case.part_load},{self.rated}"
        with tempfile.TemporaryDirectory() as folder:
            file = f"{folder}/check.json"
            words = ["check", str(self.path), f"--rpm={speeds}", f"--json={file}"]
            subprocess.run(
                [sys.executable, "-m", "jaxhb", *words, "--quiet"], check=True
            )
            return json.loads(Path(file).read_text())

    @property
    def critical(self):
        """Critical speed by hand, rpm."""
        mode, order = self.case.resonance
        return self.hand.modes[0][mode] * 30.0 / np.pi / order

    @cached_property
    def speeds(self):
        """Critical speed and rated speed, rpm."""
        return [self.critical, self.rated]

    @cached_property
    def torques(self):
        return [self.hand.torques(rpm) for rpm in self.speeds]

    @cached_property
    def motions(self):
        return [
            self.hand.forced(rpm, torque)
            for rpm, torque in zip(self.speeds, self.torques, strict=True)
        ]

    @cached_property
    def responses(self):
        response = jaxhb.check(jaxhb.forced_response(self.train, rpm=self.speeds))
        return [response[k] for k in range(len(self.speeds))]

    @cached_property
    def strengths(self):
        return [jaxhb.strength(response) for response in self.responses]

    def section(self, torque, name):
        """Nominal stress in Pa of a shaft under a torque."""
        keys = self.hand.links[self.hand.link(name)].keys
        bore = keys.get("inner", 0.0)
        modulus = np.pi / 16.0 * (keys["outer"] ** 4 - bore**4) / keys["outer"]
        return torque / modulus

    def stress(self, hand, rpm, name):
        """Nominal stress in Pa of a shaft of a plant, half of peak-to-peak."""
        motion = hand.forced(rpm, hand.torques(rpm))
        return self.section(swing(motion.transmitted[hand.link(name)]), name)

    def limits(self, name, rpm):
        keys = self.hand.links[self.hand.link(name)].keys
        return m68_limits(
            keys["outer"],
            keys["tensile_strength"],
            keys["stress_concentration"],
            rpm / self.rated,
        )


def phasor(signal, harmonic):
    """Peak phasor of a signal of jaxhb at a harmonic of the cycle."""
    phase = np.deg2rad(signal.phases_deg[harmonic - 1])
    return complex(signal.amplitudes[harmonic - 1] * np.exp(1j * phase))


def frequencies(both):
    omega, _ = both.hand.modes
    for number in range(ELASTIC.start, ELASTIC.stop):
        yield Check(
            "1 frequencies",
            f"mode {number}, Hz",
            omega[number] / (2.0 * np.pi),
            both.modes.frequencies_hz[number],
        )
    name = both.case.scenario
    omega, _ = in_scenario(both.hand, name).modes
    changed = jaxhb.natural_frequencies(both.fixed.scenario(name))
    for number in (1, 2):
        yield Check(
            "1 frequencies",
            f"{name}, mode {number}, Hz",
            omega[number] / (2.0 * np.pi),
            changed.frequencies_hz[number],
        )


def in_scenario(hand, name):
    """The plant in a scenario that changes inertias, or leaves out a shaft and all that
    it joins to the reference disk.
    """
    scene = copy.deepcopy(hand.scene)
    for key, value in scene["scenario"][name].items():
        if key == "without":
            (link,) = (hand.link(shaft) for shaft in value)
            behind = hand.behind(link)
            cut = behind != behind[hand.disk(scene["scene"]["reference"])]
            left_out = {disk for disk, out in zip(hand.disks, cut, strict=True) if out}
            scene["disk"] = [d for d in scene["disk"] if d["name"] not in left_out]
            scene["shaft"] = [
                shaft
                for shaft in scene["shaft"]
                if not left_out & set(shaft["between"])
            ]
        else:
            disk, _, field_name = key.partition(".")
            row = scene["disk"][hand.disk(disk)]
            row[field_name] = value
    return Plant(scene)


def shapes(both):
    """Relative amplitudes, and the torque sums of Holzer's table in a mode: of all disks
    behind a link, J omega^2 phi.
    """
    hand = both.hand
    omega, by_hand = hand.modes
    first, second = (hand.disk(name) for name in both.case.disks)
    for number in range(1, 4):
        yield Check(
            "2 shapes",
            f"mode {number}, angle of {both.case.disks[0]} over {both.case.disks[1]}",
            by_hand[number, first] / by_hand[number, second],
            both.modes.shapes[number, first] / both.modes.shapes[number, second],
        )
    for number, name in both.case.sums.items():
        referred = by_hand[number] / hand.ratio / by_hand[number, 0]
        behind = hand.behind(hand.link(name))
        torque = omega[number] ** 2 * (hand.inertia * referred)[behind].sum()
        hz = both.modes.frequencies_hz[number]
        table = jaxhb.holzer_table(both.fixed, hz=hz)
        yield Check(
            "2 shapes",
            f"mode {number}, torque sum of {name}, N m a rad of {hand.disks[0]}",
            abs(torque) / hand.gearing[hand.link(name)],
            abs(table.torque_sum[table.links.index(name)]),
        )


def means(both):
    engine = both.engine
    cylinder = both.case.cylinder
    imep = engine.keys["combustion"]["imep"]
    for k, rpm in enumerate((both.case.part_load, both.rated)):
        mean = engine.load(rpm) * imep * engine.swept
        mean /= 2.0 * np.pi * engine.revolutions
        yield Check(
            "3 mean torque",
            f"{cylinder} at {rpm:g} rpm, p_mi V / (2 pi revolutions), N m",
            mean,
            both.checked["mean_torque_Nm"][cylinder][k],
        )
        charge = both.checked["combustion"][cylinder]["charge_pressure_Pa"][k]
        yield Check(
            "3 mean torque",
            f"charge pressure at {rpm:g} rpm, Pa",
            engine.charge(rpm),
            charge,
        )
    table = jaxhb.tangential_pressure(both.train, cylinder, rpm=both.rated)
    indicated = engine.work(engine.pressure(both.rated)) / engine.swept
    yield Check(
        "3 mean torque",
        f"mean indicated pressure of the diagram at {both.rated:g} rpm, Pa",
        indicated,
        float(table.imep[-1]),
    )
    torque = both.torques[1][:, 0].real
    power = torque[torque > 0.0] @ both.hand.ratio[torque > 0.0]
    yield Check(
        "3 mean torque",
        f"power of the plant at {both.rated:g} rpm, W",
        power * radians_per_second(both.rated),
        both.responses[1].load_power.sum(),
    )


def inertia_torques(both):
    """Read from the angles of a free disk that the piston alone turns: T = -J omega^2
    phi.
    """
    keys = both.engine.keys
    speed = both.ratio * radians_per_second(both.rated)
    size = keys["reciprocating_mass"] * speed**2
    orders = np.arange(1, 5)
    by_hand = size * inertia_orders(keys["stroke"], keys["rod"], orders)
    series = size * inertia_series(keys["stroke"], keys["rod"])
    disk = jaxhb.Disk(name="crank", inertia=1.0)
    far = jaxhb.Disk(name="far", inertia=1.0)
    loose = jaxhb.Shaft(between=("crank", "far"), stiffness=1e-9)
    piston = jaxhb.Cylinder(
        disk="crank",
        stroke=keys["stroke"],
        rod=keys["rod"],
        reciprocating_mass=keys["reciprocating_mass"],
        fires=False,
    )
    free = jaxhb.build([disk, far, loose, piston], revolutions_per_cycle=1)
    angle = jaxhb.forced_response(free, rpm=both.ratio * both.rated).disk("crank")
    for order in orders:
        read = -((order * speed) ** 2) * phasor(angle, order)
        yield Check(
            "4 inertia torque",
            f"order {order} at {both.ratio * both.rated:g} rpm of the crank, N m",
            by_hand[order - 1],
            read,
            "read from the angle of a free disk: no output has it",
        )
        yield Check(
            "4 inertia torque",
            f"order {order}, series of handbooks, N m",
            series[order - 1],
            -read.imag,
            "series to the sixth power of radius over rod",
        )


def gas_harmonics(both):
    engine = both.engine
    arm = engine.area * engine.keys["stroke"] / 2.0
    table = jaxhb.tangential_pressure(both.train, both.case.cylinder, rpm=both.rated)
    rows = (table.cosine - 1j * table.sine)[[-1, 0]]
    for row, fires in zip(rows, (True, False), strict=True):
        _, gas = engine.gas_orders(both.rated, fires=fires)
        for order in both.case.gas_orders[: len(both.case.gas_orders) if fires else 2]:
            (place,) = np.flatnonzero(engine.orders == order)
            yield Check(
                "5 tangential pressure",
                f"T_{order:g} {'firing' if fires else 'compression alone'}, Pa",
                gas[place] / arm,
                row[list(table.orders).index(order)],
                STEPPED,
            )


def vector_sums(both):
    hand = both.hand
    _, shapes = hand.modes
    numbers = [1, 2, 3]
    sums = jaxhb.vector_sums(
        both.fixed, orders=both.case.orders, modes=both.modes, numbers=numbers
    )
    for k, order in enumerate(both.case.orders):
        for i, number in enumerate(numbers):
            total = 0.0
            size = 0.0
            for engine in hand.engines:
                for name in engine.names:
                    place = hand.disk(engine.disk(name))
                    turned = order / hand.ratio[place] * engine.firing(name)
                    total = total + shapes[number, place] * np.exp(1j * turned)
                    size += abs(shapes[number, place])
            if abs(total) > 1e-6 * size:
                yield Check(
                    "6 vector sums",
                    f"mode {number}, order {order:g}, |sum phi exp(i order alpha)|",
                    abs(total),
                    abs(sums.mode_sums[i, k]),
                )


def resonance(both):
    mode, order = both.case.resonance
    hand = both.hand
    motion = both.motions[0]
    response = both.responses[0]
    harmonic = hand.harmonic(order)
    name = both.case.disks[0]
    at = f"mode {mode}, order {order:g}, {both.critical:.2f} rpm"
    yield Check(
        "7 at resonance",
        f"{at}: angle of {name}, rad",
        motion.angles[hand.disk(name), harmonic],
        phasor(response.disk(name), harmonic),
    )
    for name in (both.case.shaft, next(iter(both.case.sums.values()))):
        yield Check(
            "7 at resonance",
            f"{at}: torque of {name}, N m",
            motion.transmitted[hand.link(name), harmonic],
            phasor(response.torque(name), harmonic),
        )


def synthesis(both):
    name = both.case.shaft
    for rpm, motion, response in zip(
        both.speeds, both.motions, both.responses, strict=True
    ):
        phasors = motion.transmitted[both.hand.link(name)]
        torque = response.torque(name)
        at = f"{name} at {rpm:.2f} rpm"
        yield Check(
            "8 synthesis",
            f"{at}: half peak-to-peak of all orders, N m",
            swing(phasors),
            torque.half_peak_to_peak,
            SAMPLED,
        )
        yield Check(
            "8 synthesis",
            f"{at}: sum of amplitudes, N m",
            np.abs(phasors[1:]).sum(),
            torque.sum_of_amplitudes,
        )
        yield Check(
            "8 synthesis",
            f"{at}: mean torque, N m",
            phasors[0].real,
            torque.mean,
        )


def stresses(both):
    name = both.case.shaft
    for rpm, motion, strength in zip(
        both.speeds, both.motions, both.strengths, strict=True
    ):
        torque = swing(motion.transmitted[both.hand.link(name)])
        row = strength.stresses[name]
        limits = both.limits(name, rpm)
        at = f"{name} at {rpm:.2f} rpm"
        yield Check(
            "9 stress",
            f"{at}: 16 T / (pi d^3), Pa",
            both.section(torque, name),
            row.stress,
            SAMPLED,
        )
        yield Check("10 M68", f"{at}: tau_1, Pa", limits[0], row.continuous)
        yield Check("10 M68", f"{at}: tau_2, Pa", limits[1], row.transient)


def critical_speeds(both):
    hand = both.hand
    omega, shapes = hand.modes
    low = 0.25 * both.rated
    high = 1.05 * both.rated
    diagram = jaxhb.campbell(
        both.train, rpm=[low, high], orders=both.case.orders, count=6
    )
    by_hand = {}
    for order in both.case.orders:
        for number in range(1, 7):
            rpm = omega[number] * 30.0 / np.pi / order
            if low <= rpm <= high:
                by_hand[order, number] = rpm
    critical = {(row.order, row.mode): row for row in diagram.critical}
    kind = "11 critical speeds"
    yield Check(
        kind,
        f"number of them from {low:g} to {high:g} rpm",
        len(by_hand),
        len(critical),
    )
    for (order, number), rpm in sorted(by_hand.items()):
        yield Check(
            kind,
            f"mode {number}, order {order:g}, rpm",
            rpm,
            critical[order, number].rpm,
        )
        torque = hand.torques(rpm)[:, hand.harmonic(order)]
        modal = abs(shapes[number] @ torque)
        # Symmetric engines do not move a mode that is antisymmetric.
        if modal > 1e-6 * np.abs(shapes[number] * torque).sum():
            yield Check(
                kind,
                f"mode {number}, order {order:g}, modal torque |sum phi T|, N m",
                modal,
                critical[order, number].torque,
                STEPPED,
            )


def barred(both):
    """Neither plant has a barred range: the rule is checked on the two-stroke with a
    propeller of a tenth of its damping.
    """
    kind = "11 barred range"
    name = both.case.shaft
    width = 0.2 * both.critical
    speeds = np.linspace(both.critical - width, both.critical + width, 81)
    yield from largest_share(both, kind, speeds)
    if both.case.name != "two_stroke":
        return
    changed = copy.deepcopy(both.scene)
    (disk,) = [row for row in changed["disk"] if "damping_over_rpm" in row]
    rows = [[rpm, 0.1 * value] for rpm, value in disk["damping_over_rpm"]]
    disk["damping_over_rpm"] = rows
    hand = Plant(changed)
    train = both.train.replace({f"{disk['name']}.damping_over_rpm": rows})
    limit = np.array([both.limits(name, rpm)[0] for rpm in speeds])
    stress = np.array([both.stress(hand, rpm, name) for rpm in speeds])
    excess = stress - limit
    share = stress / limit
    above = np.flatnonzero(excess > 0.0)
    edges = []
    for inside, outside in ((above[0], above[0] - 1), (above[-1], above[-1] + 1)):
        part = excess[inside] / (excess[inside] - excess[outside])
        edges.append(speeds[inside] + part * (speeds[outside] - speeds[inside]))
    (barred_range,) = jaxhb.strength(jaxhb.forced_response(train, rpm=speeds)).barred[
        name
    ]
    at = speeds[share.argmax()]
    ratio = at / both.rated
    note = "propeller with a tenth of its damping"
    for quantity, by_hand, by_jaxhb in (
        ("critical speed n_c, rpm", at, barred_range.at),
        ("largest stress over tau_1", share.max(), barred_range.share),
        ("stress above tau_1 from, rpm", edges[0], barred_range.low),
        ("stress above tau_1 to, rpm", edges[1], barred_range.high),
        ("16 n_c / (18 - lambda), rpm", 16 * at / (18 - ratio), barred_range.rule_low),
        ("(18 - lambda) n_c / 16, rpm", (18 - ratio) * at / 16, barred_range.rule_high),
        (
            "barred from, rpm",
            min(edges[0] - 0.01 * both.rated, 16 * at / (18 - ratio)),
            barred_range.bar_low,
        ),
        (
            "barred to, rpm",
            max(edges[1] + 0.01 * both.rated, (18 - ratio) * at / 16),
            barred_range.bar_high,
        ),
    ):
        yield Check(kind, f"{name}: {quantity}", by_hand, by_jaxhb, note)


def largest_share(both, kind, speeds):
    """The largest stress over tau_1 of the shaft, and whether a range is barred."""
    strength = jaxhb.strength(jaxhb.forced_response(both.train, rpm=speeds))
    name = both.case.shaft
    row = strength.stresses[name]
    shares = [
        both.stress(both.hand, rpm, name) / both.limits(name, rpm)[0] for rpm in speeds
    ]
    yield Check(
        kind,
        f"{name}: largest stress over tau_1 about {both.critical:.1f} rpm",
        max(shares),
        (row.stress / row.continuous).max(),
        SAMPLED,
    )
    if not any(strength.barred.values()):
        yield Check(
            kind,
            "of the plant as it is",
            note="none: no stress above tau_1",
        )


def blade_orders(both):
    """The forced answer to the blades alone is the whole one less that without them."""
    hand = both.hand
    (load,) = [load for load in both.scene["load"] if "harmonics" in load]
    place = hand.disk(load["disk"])
    name = both.case.shaft
    zero = np.zeros((len(load["harmonics"]), 2))
    still = both.train.replace({f"{load['name']}.harmonics": zero})
    without = jaxhb.forced_response(still, rpm=both.speeds)
    torque = both.torques[1][place, 0].real
    by_jaxhb = both.checked["mean_torque_Nm"][load["name"]][1]
    yield Check(
        "12 blade orders",
        f"mean torque of {load['disk']} at {both.rated:g} rpm, N m",
        torque,
        by_jaxhb,
    )
    for order, real, imaginary in load["harmonics"]:
        harmonic = hand.harmonic(order, hand.ratio[place])
        share = np.hypot(real, imaginary)
        yield Check(
            "12 blade orders",
            f"torque of order {order} on {load['disk']}, N m",
            abs(torque) * share,
            abs(by_jaxhb) * share,
            "share of the mean torque: no output has it",
        )
        for k, rpm in enumerate(both.speeds):
            mean = both.torques[k][:, 0].real
            mean = np.where(mean > 0.0, mean, 0.0)
            blades = hand.loads(mean)
            blades[:, 0] = 0.0
            alone = hand.forced(rpm, blades).transmitted[hand.link(name), harmonic]
            whole = phasor(both.responses[k].torque(name), harmonic)
            yield Check(
                "12 blade orders",
                f"{name} at {rpm:.2f} rpm by order {order} of the blades, N m",
                alone,
                whole - phasor(without[k].torque(name), harmonic),
            )


def misfire(both):
    hand = both.hand
    cylinder = both.case.cylinder
    train = both.train.misfire(cylinder)
    response = jaxhb.forced_response(train, rpm=both.speeds)
    for k, rpm in enumerate(both.speeds):
        torque = hand.torques(rpm, misfiring=(cylinder,))
        motion = hand.forced(rpm, torque)
        for name in (both.case.shaft, next(iter(both.case.sums.values()))):
            at = f"{name} at {rpm:.2f} rpm"
            for order in both.case.misfire_orders:
                harmonic = hand.harmonic(order)
                yield Check(
                    "13 misfire",
                    f"{at}: torque of order {order / both.ratio:g} of the engine, N m",
                    motion.transmitted[hand.link(name), harmonic],
                    phasor(response[k].torque(name), harmonic),
                    STEPPED,
                )
            yield Check(
                "13 misfire",
                f"{at}: half peak-to-peak of all orders, N m",
                swing(motion.transmitted[hand.link(name)]),
                response[k].torque(name).half_peak_to_peak,
                SAMPLED,
            )


def heat(both):
    yield Check("14 heat", "of a damper", note=both.case.lacking["14 heat"])
    for k, rpm in enumerate(both.speeds):
        motion = both.motions[k]
        response = both.responses[k]
        for name in both.case.losses:
            place = both.hand.link(name)
            power = motion.heat[place]
            yield Check(
                "14 heat",
                f"{name} at {rpm:.2f} rpm, sum of c omega^2 twist^2 / 2, W",
                power,
                response.power(name),
            )
            limit = both.hand.links[place].keys.get("power_limit")
            if limit is not None:
                row = both.strengths[k].heat[name]
                yield Check(
                    "14 heat",
                    f"{name} at {rpm:.2f} rpm, share of its limit",
                    power / limit,
                    row.power / row.limit,
                )
        yield Check(
            "14 heat",
            f"all links and disks at {rpm:.2f} rpm, W",
            motion.heat.sum() + motion.disk_heat.sum(),
            response.input_power,
            "jaxhb: the work of the torques",
        )


def gears(both):
    if "15 gears" in both.case.lacking:
        yield Check("15 gears", "vibratory torque", note=both.case.lacking["15 gears"])
        return
    hand = both.hand
    for rpm, motion, response, strength in zip(
        both.speeds, both.motions, both.responses, both.strengths, strict=True
    ):
        for place, link in enumerate(hand.links):
            rated = link.keys.get("rated_torque")
            if rated is None or link.name.startswith("starboard"):
                continue
            radius = both.scene["disk"][link.first]["radius"]
            force = over_cycle(motion.transmitted[place])
            row = strength.tooth_torques[link.name]
            at = f"{link.name} at {rpm:.2f} rpm"
            vibratory = radius * np.ptp(force) / 2.0
            tooth = response.force(link.name)
            sense = np.sign(force.mean())
            for quantity, by_hand, by_jaxhb in (
                ("vibratory torque, N m", vibratory, row.vibratory),
                (
                    "vibratory torque over a third of rated",
                    3.0 * vibratory / rated,
                    row.vibratory / row.limit,
                ),
                ("mean torque, N m", radius * force.mean(), row.mean),
                (
                    "mean less vibratory torque, N m",
                    abs(radius * force.mean()) - vibratory,
                    abs(row.mean) - row.vibratory,
                ),
                (
                    "largest force of the drive flank, N",
                    (sense * force).max(),
                    max(sense * tooth.max, sense * tooth.min),
                ),
                (
                    "least force (reversal below 0), N",
                    (sense * force).min(),
                    min(sense * tooth.max, sense * tooth.min),
                ),
                (
                    "reversal, 1 no and 2 yes",
                    1.0 + ((sense * force).min() < 0.0),
                    1.0 + bool(row.reverses),
                ),
            ):
                note = SAMPLED if "vibratory" in quantity or "force" in quantity else ""
                yield Check("15 gears", f"{at}: {quantity}", by_hand, by_jaxhb, note)


def energies(both):
    """Shares of the energies in a mode, damping ratios of free vibration, irregularity."""
    hand = both.hand
    omega, shapes = hand.modes
    for number, name in both.case.sums.items():
        referred = shapes[number] / hand.ratio
        strain = hand.stiffness * (hand.ends @ referred) ** 2
        kinetic = hand.inertia * referred**2
        place = hand.link(name)
        link = both.modes.link_names.index(name)
        yield Check(
            "16 energies",
            f"mode {number}, share of {name} in the strain energy",
            strain[place] / strain.sum(),
            both.modes.strain_share[number, link],
        )
        disk = both.case.disks[1]
        yield Check(
            "16 energies",
            f"mode {number}, share of {disk} in the kinetic energy",
            kinetic[hand.disk(disk)] / kinetic.sum(),
            both.modes.kinetic_share[number, hand.disk(disk)],
        )
        yield Check(
            "16 energies",
            f"mode {number}, generalised mass, kg m2",
            kinetic.sum(),
            both.modes.generalised_mass[number],
        )
    values = hand.damped_eigenvalues(both.rated)
    damped = jaxhb.damped_modes(both.fixed)
    for k in range(4):
        yield Check(
            "16 damping",
            f"mode {k + 1}, damping ratio at {both.rated:g} rpm",
            -values[k].real / abs(values[k]),
            damped.damping_ratio[k],
        )
    name = both.case.disks[0]
    place = hand.disk(name)
    harmonics = np.arange(hand.highest + 1)
    for rpm, motion, response in zip(
        both.speeds, both.motions, both.responses, strict=True
    ):
        base = radians_per_second(rpm) / hand.revolutions
        speed = 1j * harmonics * base * motion.angles[place]
        mean = hand.ratio[place] * radians_per_second(rpm)
        yield Check(
            "16 irregularity",
            f"{name} at {rpm:.2f} rpm, (largest - least speed) / mean",
            2.0 * swing(speed) / mean,
            response.irregularity(name),
            SAMPLED,
        )


KINDS = (
    frequencies,
    shapes,
    means,
    inertia_torques,
    gas_harmonics,
    vector_sums,
    resonance,
    synthesis,
    stresses,
    critical_speeds,
    barred,
    blade_orders,
    misfire,
    heat,
    gears,
    energies,
)


def checks(case, kinds=KINDS):
    """The :class:`Check` rows of a :class:`Case`."""
    both = Both(case)
    for kind in kinds:
        yield from kind(both)


def main():
    """Print the table; the exit status is 1 if a difference is above :data:`ALLOWED`."""
    parser = command_line(__doc__, core=-1)
    parser.add_argument("--plants", nargs="+", choices=list(CASES), default=list(CASES))
    options = parser.parse_args()
    rows = started("hand-checks", options, COLUMNS)
    beyond = 0
    for plant in options.plants:
        for check in checks(CASES[plant]):
            beyond += check.percent is not None and not check.percent <= ALLOWED
            rows.add(
                kind=check.kind,
                plant=plant,
                quantity=check.quantity,
                by_hand=shown(check.by_hand),
                jaxhb=shown(check.by_jaxhb),
                percent=check.percent,
                note=check.note,
            )
    compared = [row for row in rows.rows if row["percent"] is not None]
    worst = max(compared, key=lambda row: row["percent"])
    print(
        f"{len(compared)} numbers of {len({row['kind'].split()[0] for row in compared})} kinds;"
        f" {beyond} differ by more than {ALLOWED} %; largest difference"
        f" {worst['percent']:.2g} %: {worst['plant']}, {worst['kind']},"
        f" {worst['quantity']}"
    )
    sys.exit(beyond > 0)


def shown(value):
    """Number of a table: the amplitude of a phasor."""
    if value is None:
        return None
    return float(abs(value)) if np.iscomplexobj(value) else float(value)


if __name__ == "__main__":
    main()

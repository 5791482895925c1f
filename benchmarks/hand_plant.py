"""The torsional vibration of a plant by hand: an engineer's own matrices, cycles and sums
in NumPy, from the numbers of the scene file alone. Nothing of jaxhb is used.

All disks are referred to the shaft of the reference disk: a disk that turns i times as
fast has the inertia J i^2 there, its angle is phi / i, its torque T i. A link whose
deflection is g times the difference of these angles (g = i of a shaft, pitch radius
times i of a mesh) has the stiffness k g^2.

Phasors are peak amplitudes: a quantity is Re sum A_n exp(i n theta), n the harmonic of
the cycle, theta = 0 at firing of a cylinder with firing angle 0.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

STANDARD_ATMOSPHERE = 101325.0
UNBURNT_AT_END = 1e-3
"""Share of the fuel that Wiebe's law leaves at the end of its duration."""
COMPRESSION_EXPONENT = 1.35
EXPANSION_EXPONENT = 1.28
CHARGING_EXPONENT = 1.5
"""Exponents where a scene gives none: p V^n, and charge pressure over power."""
STEPS = 3600
"""Steps of a revolution in indicator diagrams."""
INSTANTS = 1 << 15
"""Instants of a cycle at which a synthesis is read."""


def radians_per_second(rpm):
    return rpm * np.pi / 30.0


def simpson(values):
    """Integral of samples at an even number of unit steps."""
    return (
        values[0]
        + 4.0 * values[1:-1:2].sum(axis=0)
        + 2.0 * values[2:-1:2].sum(axis=0)
        + values[-1]
    ) / 3.0


def piston(angle, stroke, rod):
    """Way of the piston from top dead centre in m, and its derivative by the crank angle
    in rad, from the triangle of crank and rod.
    """
    radius = stroke / 2.0
    height = np.sqrt(rod**2 - (radius * np.sin(angle)) ** 2)
    way = radius + rod - radius * np.cos(angle) - height
    slope = radius * np.sin(angle) + radius**2 * np.sin(angle) * np.cos(angle) / height
    return way, slope


def inertia_orders(stroke, rod, orders):
    """Phasors of the torque of 1 kg at 1 rad/s for whole orders of the crank: what the
    shaft loses while the kinetic energy of the piston grows, T = -dE/da.
    """
    angle = np.arange(STEPS) * (2.0 * np.pi / STEPS)
    energy = 0.5 * piston(angle, stroke, rod)[1] ** 2
    waves = np.exp(-1j * np.outer(angle, orders))
    return -1j * orders * 2.0 * (energy @ waves) / STEPS


def inertia_series(stroke, rod):
    """Sine amplitudes of orders 1 to 4 of the same torque, as handbooks print them:
    powers of l = radius / rod up to the sixth.
    """
    radius = stroke / 2.0
    l = radius / rod
    return radius**2 * np.array(
        [
            l / 4.0 + l**3 / 16.0 + 15.0 * l**5 / 512.0,
            -1.0 / 2.0 - l**4 / 32.0 - l**6 / 32.0,
            -3.0 * l / 4.0 - 9.0 * l**3 / 32.0 - 81.0 * l**5 / 512.0,
            -(l**2) / 4.0 - l**4 / 8.0 - l**6 / 16.0,
        ]
    )


@dataclass(frozen=True)
class Engine:
    """The keys of an ``[engine]`` by name, and what follows from them."""

    keys: dict
    rated_rpm: float

    @property
    def revolutions(self):
        return self.keys.get("stroke_cycle", 4) // 2

    @property
    def area(self):
        return np.pi / 4.0 * self.keys["bore"] ** 2

    @property
    def swept(self):
        return self.area * self.keys["stroke"]

    @property
    def orders(self):
        """Orders of the crank that a scene without ``orders`` keeps: up to 12, of a
        two-stroke up to 15.
        """
        highest = 15 if self.revolutions == 1 else 12
        return np.arange(1, highest * self.revolutions + 1) / self.revolutions

    @property
    def names(self):
        """Cylinders as they fire."""
        prefix = self.keys.get("name", "cylinder")
        return [f"{prefix} {label}" for label in self.keys["firing_order"]]

    def disk(self, name):
        """Disk of a cylinder: number 5 or, of a vee engine, A5 and B5 are at the fifth."""
        throw = int(name.split()[-1].lstrip("AB"))
        return self.keys["disks"][throw - 1]

    def firing(self, name):
        """Firing angle of a cylinder in rad of the crank, at equal intervals.

        ValueError if a bank angle contradicts them.
        """
        interval = 2.0 * np.pi * self.revolutions / len(self.names)
        angle = self.names.index(name) * interval
        bank = np.deg2rad(self.keys.get("bank_angle", 0.0))
        if name.split()[-1].startswith("B"):
            opposite = self.names.index(name.replace(" B", " A")) * interval
            apart = np.exp(1j * (angle - opposite - bank))
            if abs(apart - 1.0) > 1e-9:
                raise ValueError(f"{name} does not fire at equal intervals")
        return angle

    def load(self, rpm):
        speeds, loads = np.transpose(self.keys["load"])
        return np.interp(rpm, speeds, loads)

    def charge(self, rpm):
        """Charge pressure in Pa: its part above the atmosphere goes with the 1.5th power
        of the power, that of full load at the rated speed being 1.
        """
        last = self.keys["load"][-1][0]
        power = self.load(rpm) * min(rpm, last) / self.rated_rpm
        above = self.keys["combustion"]["charge_pressure"] - STANDARD_ATMOSPHERE
        return STANDARD_ATMOSPHERE + above * power**CHARGING_EXPONENT

    @cached_property
    def angle(self):
        """Crank angles of a cycle in rad, from the bottom dead centre before firing."""
        turns = np.arange(STEPS * self.revolutions + 1) / STEPS
        return 2.0 * np.pi * turns - np.pi

    @cached_property
    def slope(self):
        """Derivative of the way of the piston by the angle, m, over a cycle."""
        return piston(self.angle, self.keys["stroke"], self.keys["rod"])[1]

    def volume(self, angle):
        way, slope = piston(angle, self.keys["stroke"], self.keys["rod"])
        clearance = self.keys["stroke"] / (
            self.keys["combustion"]["compression_ratio"] - 1
        )
        return self.area * (clearance + way), self.area * slope

    @cached_property
    def diagrams(self):
        """Pressures over a cycle that 1 Pa of charge makes where the fuel burns, that 1 J
        of heat adds, and that 1 Pa of charge makes without injection.

        Runge-Kutta steps of p' = -n p V'/V + (n - 1) Q b'/V with Wiebe's burnt share b;
        the exponent n goes with b from that of compression to that of expansion.
        """
        half_steps = np.linspace(-np.pi, np.pi, 2 * STEPS + 1)
        volume, growth = self.volume(half_steps)
        combustion = self.keys["combustion"]
        duration = np.deg2rad(combustion["duration"])
        passed = (
            np.maximum(half_steps - np.deg2rad(combustion["start"]), 0.0) / duration
        )
        burnt = 1.0 - UNBURNT_AT_END ** (passed**2)
        rate = -2.0 * np.log(UNBURNT_AT_END) * passed / duration * (1.0 - burnt)
        exponent = COMPRESSION_EXPONENT + burnt * (
            EXPANSION_EXPONENT - COMPRESSION_EXPONENT
        )
        falls = -exponent * growth / volume
        heats = (exponent - 1.0) * rate / volume
        step = 2.0 * np.pi / STEPS
        pressure = np.array([1.0, 0.0])
        rows = [pressure]
        per_joule = np.array([0.0, 1.0])

        def slope(k, pressure):
            return falls[k] * pressure + heats[k] * per_joule

        for k in range(0, 2 * STEPS, 2):
            first = slope(k, pressure)
            second = slope(k + 1, pressure + 0.5 * step * first)
            third = slope(k + 1, pressure + 0.5 * step * second)
            fourth = slope(k + 2, pressure + step * third)
            pressure = pressure + step / 6.0 * (first + 2.0 * (second + third) + fourth)
            rows.append(pressure)
        charged, heated = np.transpose(rows)
        compressed = (volume[0] / volume[::2]) ** COMPRESSION_EXPONENT
        exchange = STEPS * (self.revolutions - 1)
        return (
            np.append(charged, np.ones(exchange)),
            np.append(heated, np.zeros(exchange)),
            np.append(compressed, np.ones(exchange)),
        )

    def work(self, pressure):
        """Work of a cycle in J."""
        return simpson(pressure * self.area * self.slope) * (2.0 * np.pi / STEPS)

    def pressure(self, rpm, *, fires=True):
        """Pressure over the cycle at a speed of the reference shaft: so much heat that
        the mean indicated pressure is that of the load, or none.
        """
        charged, heated, compressed = self.diagrams
        charge = self.charge(rpm)
        if not fires:
            return charge * compressed
        indicated = self.load(rpm) * self.keys["combustion"]["imep"] * self.swept
        heat = (indicated - self.work(charge * charged)) / self.work(heated)
        return charge * charged + heat * heated

    def gas_orders(self, rpm, *, fires=True):
        """Mean and phasors of the gas torque of a cylinder in N m by its orders."""
        over_ambient = self.pressure(rpm, fires=fires) - self.keys["ambient_pressure"]
        torque = over_ambient * self.area * self.slope
        steps = STEPS * self.revolutions
        waves = np.exp(-1j * np.outer(self.angle, self.orders))
        return simpson(torque) / steps, 2.0 * simpson(torque[:, None] * waves) / steps

    def mass_orders(self, crank_speed):
        """Phasors of the inertia torque in N m by the same orders, at rad/s of the
        crank; half orders have none.
        """
        whole = self.orders % 1.0 == 0.0
        keys = self.keys
        unit = inertia_orders(keys["stroke"], keys["rod"], self.orders * whole)
        return keys["reciprocating_mass"] * crank_speed**2 * unit


@dataclass(frozen=True)
class Link:
    """A shaft or mesh between disks ``first`` and ``second``: stiffness and damping of
    its own deflection, and the gearing g.
    """

    name: str
    first: int
    second: int
    stiffness: float
    damping: float
    loss_factor: float
    gearing: float
    keys: dict


@dataclass(frozen=True)
class Motion:
    """Phasors ``(.., N + 1)`` over the harmonics of the cycle: angles of disks in rad and
    torques of links in N m (forces of meshes in N), all on their own shaft. Column 0 has
    means; those of angles are 0. ``heat`` is that of the links, ``disk_heat`` of the
    damping of disks, W.
    """

    angles: np.ndarray
    transmitted: np.ndarray
    heat: np.ndarray
    disk_heat: np.ndarray


class Plant:
    """The plant of a scene, the tables of its file, referred to the shaft of the
    reference disk.
    """

    def __init__(self, scene):
        self.scene = scene
        self.rated_rpm = float(self.scene["scene"]["rated_rpm"])
        self.revolutions = self.scene["scene"]["revolutions_per_cycle"]
        disks = self.scene["disk"]
        self.disks = [disk["name"] for disk in disks]
        self.ratio = self._ratios()
        self.inertia = np.array([disk["inertia"] for disk in disks]) * self.ratio**2
        self.links = [self._shaft(keys) for keys in self.scene["shaft"]]
        self.links += [self._mesh(keys) for keys in self.scene.get("mesh", ())]
        self.names = [link.name for link in self.links]
        self.ends = np.zeros((len(self.links), len(disks)))
        for row, link in zip(self.ends, self.links, strict=True):
            row[link.first] = 1.0
            row[link.second] = -1.0
        engines = self.scene["engine"]
        engines = engines if isinstance(engines, list) else [engines]
        self.engines = [Engine(keys, self.rated_rpm) for keys in engines]

    def _ratios(self):
        """Speeds of the disks over that of the reference disk, from shaft to shaft."""
        ratio = {self.scene["scene"]["reference"]: 1.0}
        shafts = [(keys["between"], 1.0) for keys in self.scene["shaft"]]
        radius = {disk["name"]: disk.get("radius") for disk in self.scene["disk"]}
        meshes = [
            (keys["between"], radius[keys["between"][0]] / radius[keys["between"][1]])
            for keys in self.scene.get("mesh", ())
        ]
        while len(ratio) < len(self.disks):
            for (first, second), step in shafts + meshes:
                if first in ratio:
                    ratio.setdefault(second, ratio[first] * step)
                elif second in ratio:
                    ratio[first] = ratio[second] / step
        return np.array([ratio[name] for name in self.disks])

    def _shaft(self, keys):
        first, second = (self.disks.index(name) for name in keys["between"])
        stiffness = keys.get("stiffness")
        if stiffness is None:
            polar = np.pi / 32.0 * (keys["outer"] ** 4 - keys.get("inner", 0.0) ** 4)
            stiffness = keys["shear_modulus"] * polar / keys["length"]
        damping = 0.0
        if "magnifier" in keys:
            at = 2.0 * np.pi * keys["damping_hz"]
            damping = stiffness / (at * keys["magnifier"])
        return Link(
            name=keys.get("name", "|".join(keys["between"])),
            first=first,
            second=second,
            stiffness=stiffness,
            damping=damping,
            loss_factor=keys.get("loss_factor", 0.0),
            gearing=self.ratio[first],
            keys=keys,
        )

    def _mesh(self, keys):
        first, second = (self.disks.index(name) for name in keys["between"])
        return Link(
            name="|".join(keys["between"]),
            first=first,
            second=second,
            stiffness=keys["stiffness"],
            damping=keys["damping"],
            loss_factor=0.0,
            gearing=self.scene["disk"][first]["radius"] * self.ratio[first],
            keys=keys,
        )

    def link(self, name):
        return self.names.index(name)

    def disk(self, name):
        return self.disks.index(name)

    def behind(self, number):
        """Disks ``(S,)`` that a cut through a link divides from its first end."""
        reached = {self.links[number].second}
        pairs = [(link.first, link.second) for link in self.links]
        del pairs[number]
        grown = True
        while grown:
            before = len(reached)
            for pair in pairs:
                if reached & set(pair):
                    reached |= set(pair)
            grown = len(reached) > before
        return np.isin(np.arange(len(self.disks)), list(reached))

    def engine_of(self, cylinder):
        return next(engine for engine in self.engines if cylinder in engine.names)

    @cached_property
    def gearing(self):
        return np.array([link.gearing for link in self.links])

    @cached_property
    def stiffness(self):
        """Referred stiffnesses of the links, N m/rad."""
        return np.array([link.stiffness for link in self.links]) * self.gearing**2

    @cached_property
    def viscous(self):
        """Referred dampings of the links, N m s/rad."""
        return np.array([link.damping for link in self.links]) * self.gearing**2

    @cached_property
    def loss_factor(self):
        return np.array([link.loss_factor for link in self.links])

    def damping(self, rpm):
        """Referred dampings of the disks to ground, N m s/rad."""
        own = [
            np.interp(rpm, *np.transpose(disk["damping_over_rpm"]))
            if "damping_over_rpm" in disk
            else disk.get("damping", 0.0)
            for disk in self.scene["disk"]
        ]
        return np.array(own) * self.ratio**2

    def matrix(self, values):
        """Matrix of links with such referred stiffnesses or dampings."""
        return self.ends.T @ (values[:, None] * self.ends)

    @cached_property
    def modes(self):
        """Natural frequencies in rad/s, rising, and shapes: angles on the own shafts, one
        mode a row, the largest 1.
        """
        root = np.sqrt(self.inertia)
        squares, vectors = np.linalg.eigh(
            self.matrix(self.stiffness) / np.outer(root, root)
        )
        shapes = (vectors / root[:, None] * self.ratio[:, None]).T
        largest = np.abs(shapes).argmax(axis=1)
        shapes = shapes / shapes[np.arange(len(shapes)), largest][:, None]
        return np.sqrt(np.maximum(squares, 0.0)), shapes

    def damped_eigenvalues(self, rpm):
        """Eigenvalues in 1/s of the damped motions that oscillate, by rising imaginary
        part: of the matrix of first order of J x'' + B x' + K x = 0.
        """
        size = len(self.inertia)
        complex_stiffness = self.stiffness * (1.0 + 1j * self.loss_factor)
        damping = np.diag(self.damping(rpm)) + self.matrix(self.viscous)
        first_order = np.zeros((2 * size, 2 * size), dtype=complex)
        first_order[:size, size:] = np.eye(size)
        first_order[size:, :size] = -self.matrix(complex_stiffness)
        first_order[size:, size:] = -damping
        first_order[size:] /= self.inertia[:, None]
        values = np.linalg.eigvals(first_order)
        values = values[values.imag > 0.05 * np.abs(values)]
        return values[np.argsort(values.imag)]

    def harmonic(self, order, ratio=1.0):
        """Harmonic of the cycle of an order of a shaft with such a speed ratio."""
        return round(order * ratio * self.revolutions)

    @cached_property
    def highest(self):
        """Highest harmonic of the cycle that the engines excite."""
        return max(
            self.harmonic(
                engine.orders[-1], self.ratio[self.disk(engine.keys["disks"][0])]
            )
            for engine in self.engines
        )

    def torques(self, rpm, *, misfiring=()):
        """Phasors of the torques on the disks ``(S, N + 1)`` in N m on their own shafts,
        loads included: these take the mean power of the cylinders by their shares.
        """
        torque = np.zeros((len(self.disks), self.highest + 1), dtype=complex)
        for engine in self.engines:
            ratio = self.ratio[self.disk(engine.keys["disks"][0])]
            columns = [self.harmonic(order, ratio) for order in engine.orders]
            mass = engine.mass_orders(ratio * radians_per_second(rpm))
            burning = engine.gas_orders(rpm)
            compressing = engine.gas_orders(rpm, fires=False)
            for name in engine.names:
                mean, gas = compressing if name in misfiring else burning
                place = self.disk(engine.disk(name))
                turned = np.exp(-1j * engine.orders * engine.firing(name))
                torque[place, 0] += mean
                torque[place, columns] += (gas + mass) * turned
        return torque + self.loads(torque[:, 0].real)

    def loads(self, mean_torques):
        """Phasors of the loads under mean torques ``(S,)`` of all else, with the
        pulsation by blade order.
        """
        torque = np.zeros((len(self.disks), self.highest + 1), dtype=complex)
        rows = self.scene["load"]
        shares = np.array([load.get("share", 1.0) for load in rows])
        places = [self.disk(load["disk"]) for load in rows]
        means = -(mean_torques @ self.ratio) * shares / (shares @ self.ratio[places])
        for load, place, mean in zip(rows, places, means, strict=True):
            torque[place, 0] += mean
            for order, real, imaginary in load.get("harmonics", ()):
                column = self.harmonic(order, self.ratio[place])
                torque[place, column] += mean * (real + 1j * imaginary)
        return torque

    def forced(self, rpm, torque):
        """The :class:`Motion` under torques ``(S, N + 1)`` on the own shafts: one dense
        complex solve for each harmonic.
        """
        referred = torque * self.ratio[:, None]
        angles = np.zeros_like(referred)
        transmitted = np.zeros((len(self.links), referred.shape[1]), dtype=complex)
        # A tree: equilibrium alone gives the means.
        mean, *_ = np.linalg.lstsq(self.ends.T, referred[:, 0].real, rcond=None)
        transmitted[:, 0] = mean
        heat = np.zeros(len(self.links))
        disk_heat = np.zeros(len(self.disks))
        base = radians_per_second(rpm) / self.revolutions
        damping = self.damping(rpm)
        for n in range(1, referred.shape[1]):
            omega = n * base
            link = self.stiffness * (1.0 + 1j * self.loss_factor)
            link = link + 1j * omega * self.viscous
            dynamic = self.matrix(link) + 1j * omega * np.diag(damping)
            dynamic -= omega**2 * np.diag(self.inertia)
            angles[:, n] = np.linalg.solve(dynamic, referred[:, n])
            twist = self.ends @ angles[:, n]
            transmitted[:, n] = link * twist
            heat += 0.5 * omega * link.imag * np.abs(twist) ** 2
            disk_heat += 0.5 * omega**2 * damping * np.abs(angles[:, n]) ** 2
        return Motion(
            angles * self.ratio[:, None],
            transmitted / self.gearing[:, None],
            heat,
            disk_heat,
        )


def over_cycle(phasors):
    """Values over the cycle of phasors ``(N + 1,)``, the mean among them."""
    spectrum = np.zeros(INSTANTS // 2 + 1, dtype=complex)
    spectrum[: len(phasors)] = phasors * (INSTANTS / 2.0)
    spectrum[0] = phasors[0].real * INSTANTS
    return np.fft.irfft(spectrum)


def swing(phasors):
    """Half of the peak-to-peak value over the cycle."""
    return np.ptp(over_cycle(phasors)) / 2.0


def m68_limits(diameter, strength, form, speed_ratio):
    """tau_1 for continuous running and tau_2 for rapid passing in Pa after IACS UR M68.5:

    tau_1 = (sigma_B + 160) / 18 C_K C_D (3 - 2 lambda^2) below lambda = 0.9, with 1.38 in
    the place of the bracket up to 1.05; C_D = 0.35 + 0.93 d^-0.2; tau_2 = 1.7 tau_1 /
    sqrt(C_K); N/mm2 and mm.
    """
    size = 0.35 + 0.93 * (1000.0 * diameter) ** -0.2
    bracket = 3.0 - 2.0 * speed_ratio**2 if speed_ratio < 0.9 else 1.38
    continuous = (strength / 1e6 + 160.0) / 18.0 * form * size * bracket
    return 1e6 * continuous, 1.7e6 * continuous / np.sqrt(form)

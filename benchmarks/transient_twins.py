"""Twins of transients: the equations of a train written once more from its elements, in
angles, and integrated by scipy's DOP853; and one mass that is accelerated, exactly.

Nothing here calls the package but for the classes of its elements. Every rotor's own
sense is positive. With the angle theta, the speed Omega and the acceleration alpha of
the reference rotor, i the speed ratio of a rotor,

    J phi'' + B phi' + K phi + sum D^T F = T(theta, Omega, t) - i J alpha,

loads take the power that accelerates the train (given speed) or follow their laws (free
speed), and without loads nothing is accelerated. Of disks without inertia the damped
ones have a velocity that follows at once, the others an angle.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import wofz

import jaxhb
from jaxhb import Cylinder, Damper, Disk, Ground, Load, Mesh, Phase, Shaft, Torque

RPM = np.pi / 30
TOLERANCE = 1e-11
"""Of DOP853, relative."""


def of_kind(parts, kind):
    """Elements of a kind."""
    return [part for part in parts if isinstance(part, kind)]


@dataclass(frozen=True)
class Ramps:
    """Speed of the reference rotor: linear between rows of (s, rpm), then constant."""

    rows: tuple

    def alpha(self, t):
        """Acceleration in rad/s2 behind the instant t."""
        for (begin, low), (end, high) in zip(
            self.rows[:-1], self.rows[1:], strict=True
        ):
            if begin <= t < end:
                return (high - low) / (end - begin) * RPM
        return 0.0

    def omega(self, t):
        """Speed in rad/s."""
        times, speeds = np.array(self.rows).T
        return float(np.interp(t, times, speeds)) * RPM

    def theta(self, t):
        """Angle in rad since 0 s."""
        times = np.array([row[0] for row in self.rows])
        inside = np.concatenate([times[times < t], [t]])
        if len(inside) < 2:
            return self.omega(0.0) * t
        speeds = np.array([self.omega(time) for time in inside])
        return float((np.diff(inside) * (speeds[1:] + speeds[:-1]) / 2).sum())


@dataclass
class Twin:
    """A train as dense matrices in angles.

    parts : elements; cycle : revolutions of the reference rotor in a cycle (nothing
    depends on it, as torques have orders of the reference rotor); torque : function
    ``(t, theta) -> {disk: N m}`` of events; fuel : function ``t -> factor``; gas :
    function ``(name, t) -> factor`` of the gas torque of a cylinder.
    """

    parts: list
    reference: str
    torque: object = None
    fuel: object = None
    gas: object = None
    names: list = field(init=False)

    def __post_init__(self):
        disks = of_kind(self.parts, Disk)
        dampers = of_kind(self.parts, Damper)
        self.names = [part.name for part in disks + dampers]
        self.inertia = np.array([part.inertia for part in disks + dampers])
        self.radius = {part.name: part.radius for part in disks}
        self.teeth = {part.name: part.teeth for part in disks}
        self.B = np.diag(
            [part.damping for part in disks] + [0.0 for _ in dampers]
        ).astype(float)
        self.K = np.zeros_like(self.B)
        self.rows = {}
        for part in of_kind(self.parts, Shaft) + dampers:
            pair = (part.disk, part.name) if isinstance(part, Damper) else part.between
            row = self.row(*pair)
            self.rows[pair] = (row, part.stiffness, part.damping)
            self.K += part.stiffness * np.outer(row, row)
            self.B += part.damping * np.outer(row, row)
        for part in of_kind(self.parts, Ground):
            place = self.names.index(part.disk)
            self.K[place, place] += part.stiffness
        self.meshes = of_kind(self.parts, Mesh)
        self.arms = [self.arm(part) for part in self.meshes]
        for part, arm in zip(self.meshes, self.arms, strict=True):
            if part.backlash is None:
                self.K += part.stiffness * np.outer(arm, arm)
                self.B += part.damping * np.outer(arm, arm)
        self.ratio = self.ratios()
        self.total = float((self.inertia * self.ratio**2).sum())
        self.loads = of_kind(self.parts, Load)
        braked = np.diag(self.B) > 0
        self.inertial = np.flatnonzero(self.inertia > 0)
        self.damped = np.flatnonzero((self.inertia == 0) & braked)
        self.static = np.flatnonzero((self.inertia == 0) & ~braked)

    def row(self, a, b):
        """Twist of disk a against disk b."""
        row = np.zeros(len(self.names))
        row[self.names.index(a)] = 1.0
        row[self.names.index(b)] = -1.0
        return row

    def arm(self, mesh):
        """Deflection of a mesh from the angles."""
        a, b = mesh.between
        row = np.zeros(len(self.names))
        row[self.names.index(a)] = self.radius[a]
        row[self.names.index(b)] = -self.radius[b]
        return row

    def ratios(self):
        """Speed of every disk over that of the reference rotor."""
        ratio = {self.reference: 1.0}
        links = [(a, b, 1.0) for a, b in self.rows]
        for mesh in self.meshes:
            a, b = mesh.between
            links.append((a, b, self.radius[a] / self.radius[b]))
        while len(ratio) < len(self.names):
            for a, b, factor in links:
                if a in ratio and b not in ratio:
                    ratio[b] = ratio[a] * factor
                if b in ratio and a not in ratio:
                    ratio[a] = ratio[b] / factor
        return np.array([ratio[name] for name in self.names])

    def delay(self, element):
        """Angle of the reference rotor by which phases delay an element, in rad."""
        place = self.names.index(element.disk)
        turned = [
            phase.angle
            for phase in of_kind(self.parts, Phase)
            if element.name in phase.of
        ]
        return np.deg2rad(sum(turned)) / self.ratio[place]

    def driving(self, t, theta, omega):
        """Torques ``(S,)`` of torques and cylinders, and their means ``(S,)``, N m."""
        total = np.zeros(len(self.names))
        mean = np.zeros(len(self.names))
        fuel = 1.0 if self.fuel is None else self.fuel(t)
        for part in of_kind(self.parts, Torque):
            place = self.names.index(part.disk)
            factor = fuel if part.mean > 0 else 1.0
            if part.scale:
                speeds, factors = np.array(part.scale).T
                factor = factor * np.interp(omega / RPM, speeds, factors)
            if part.rated_rpm is not None:
                share = omega / RPM / part.rated_rpm
                factor = factor * share**2
            angle = theta - self.delay(part)
            wave = sum(
                re * np.cos(order * angle) - im * np.sin(order * angle)
                for order, re, im in part.harmonics
            )
            mean[place] += factor * part.mean
            total[place] += factor * (part.mean + wave)
        for part in of_kind(self.parts, Cylinder):
            place = self.names.index(part.disk)
            factor = fuel if self.gas is None else fuel * self.gas(part.name, t)
            angle = theta - self.delay(part) - np.deg2rad(part.firing_angle)
            wave = sum(
                re * np.cos(order * angle) - im * np.sin(order * angle)
                for order, re, im in part.gas_torque
            )
            mean[place] += factor * part.gas_torque_mean
            total[place] += factor * (part.gas_torque_mean + wave)
        return total, mean

    def carried(self, t, theta, omega, alpha, free):
        """All torques ``(S,)`` N m, and their mean power over the speed."""
        total, mean = self.driving(t, theta, omega)
        places = [self.names.index(part.disk) for part in self.loads]
        if self.loads:
            ratio = self.ratio[places]
            share = np.array([part.share for part in self.loads])
            if free:
                taken = np.array([self.law(part, omega) for part in self.loads])
            else:
                power = mean @ self.ratio
                taken = -share * (power - self.total * alpha) / (share @ ratio)
            for part, place, torque in zip(self.loads, places, taken, strict=True):
                own = theta * self.ratio[place]
                wave = sum(
                    re * np.cos(order * own) - im * np.sin(order * own)
                    for order, re, im in part.harmonics
                )
                total[place] += torque * (1 + wave)
                mean[place] += torque
        if self.torque is not None:
            for name, value in self.torque(t, theta).items():
                place = self.names.index(name)
                total[place] += value
                mean[place] += value
        return total, float(mean @ self.ratio)

    def law(self, load, omega):
        """Torque in N m of a load at free speed, on its shaft."""
        rpm = omega / RPM
        if load.over_rpm:
            speeds, torques = np.array(load.over_rpm).T
            return -float(np.interp(rpm, speeds, torques))
        if load.law == "constant":
            return -load.rated_torque
        share = rpm / load.rated_rpm
        exponent = 2 if load.law == "propeller" else 1
        return -load.rated_torque * share**exponent

    def mesh(self, number, theta, omega, angles, rates):
        """Transmitted force in N of a mesh, without its linear part where it has one,
        and the whole.
        """
        part = self.meshes[number]
        arm = self.arms[number]
        a, b = part.between
        places = [self.names.index(name) for name in (a, b)]
        own = [theta * self.ratio[place] for place in places]
        teeth = self.teeth[a]
        error = 0.0
        error_rate = 0.0
        tooth = teeth * self.ratio[places[0]] if teeth else 0.0
        late = np.deg2rad(part.phase)
        waves = [(part.transmission_error, tooth, tooth * theta + late)]
        waves.append((part.first_gear_error, self.ratio[places[0]], own[0]))
        waves.append((part.second_gear_error, self.ratio[places[1]], own[1]))
        for rows, speed, angle in waves:
            for order, re, im in rows:
                error += re * np.cos(order * angle) - im * np.sin(order * angle)
                slope = -re * np.sin(order * angle) - im * np.cos(order * angle)
                error_rate += order * speed * omega * slope
        stiffness = part.stiffness
        for order, re, im in part.stiffness_orders:
            angle = order * (tooth * theta + late)
            stiffness += part.stiffness * (re * np.cos(angle) - im * np.sin(angle))
        l = arm @ angles - error
        rate = arm @ rates - error_rate
        if part.backlash is None:
            whole = stiffness * l + part.damping * rate
            linear = part.stiffness * (arm @ angles) + part.damping * (arm @ rates)
            return whole - linear, whole
        whole = tooth_force(part, stiffness, l, rate)
        return whole, whole

    def motion(self, state, load):
        """Angles and rates ``(S,)`` of a state: angles of disks with inertia, those of
        damped ones, rates of those with inertia; load ``(S,)`` N m.
        """
        count = len(self.inertial)
        angles = np.zeros(len(self.names))
        rates = np.zeros(len(self.names))
        dynamic = np.concatenate([self.inertial, self.damped])
        angles[dynamic] = state[: len(dynamic)]
        rates[self.inertial] = state[len(dynamic) :]
        if len(self.static):
            one = self.static
            right = load[one] - self.K[np.ix_(one, dynamic)] @ angles[dynamic]
            angles[one] = np.linalg.solve(self.K[np.ix_(one, one)], right)
        if len(self.damped):
            one = self.damped
            inertial = self.inertial
            right = load[one] - self.K[one] @ angles
            right = right - self.B[np.ix_(one, inertial)] @ rates[inertial]
            rates[one] = np.linalg.solve(self.B[np.ix_(one, one)], right)
        if len(self.static) and not count:
            raise ValueError("no disk has inertia")
        return angles, rates

    def posed(self, t, state, theta, omega, alpha, free):
        """Angles, rates, load ``(S,)`` and the mean power over the speed."""
        load, power = self.carried(t, theta, omega, alpha, free)
        if free:
            alpha = power / self.total
        if self.loads:
            load = load - self.inertia * self.ratio * alpha
        angles, rates = self.motion(state, load)
        return angles, rates, load, power

    def slope(self, t, state, theta, omega, alpha, free):
        """Rates of a state, and the mean power over the speed."""
        angles, rates, load, power = self.posed(t, state, theta, omega, alpha, free)
        for number in range(len(self.meshes)):
            beyond, _ = self.mesh(number, theta, omega, angles, rates)
            load = load - self.arms[number] * beyond
        pull = load - self.K @ angles - self.B @ rates
        inertial = self.inertial
        dynamic = np.concatenate([inertial, self.damped])
        acceleration = pull[inertial] / self.inertia[inertial]
        return np.concatenate([rates[dynamic], acceleration]), power

    def angle_over_time(self, seconds, speed, rpm=None, corners=()):
        """Angle of the reference rotor in rad as a function of the time in s."""
        if speed is not None:
            return speed.theta
        borders = np.array(
            [0.0, *sorted(t for t in set(corners) if 0 < t < seconds), seconds]
        )
        state = np.array([rpm * RPM, 0.0])
        pieces = []
        for begin, end in zip(borders[:-1], borders[1:], strict=True):

            def slope(t, y, low=begin, high=end):
                inside = min(max(t, low + 1e-12), high - 1e-12)
                _, power = self.carried(inside, y[1], y[0], 0.0, True)
                return [power / self.total, y[0]]

            solved = solve_ivp(
                slope,
                (begin, end),
                state,
                method="DOP853",
                rtol=TOLERANCE,
                atol=1e-13,
                dense_output=True,
            )
            pieces.append(solved.sol)
            state = solved.y[:, -1]

        def theta(t):
            piece = np.searchsorted(borders, t, side="right") - 1
            return float(pieces[min(piece, len(pieces) - 1)](t)[1])

        return theta

    def integrate(self, seconds, speed, times, *, corners=(), rpm=None, longest=np.inf):
        """Angles, rates ``(n, S)``, forces ``(n, M)`` of the meshes, speeds rad/s and
        angles rad ``(n,)`` at some ``times`` ``(n,)``, from rest; ``speed`` is
        :class:`Ramps` or None for a free one from ``rpm`` on.
        """
        free = speed is None
        count = 2 * len(self.inertial) + len(self.damped)
        state = np.zeros(count + 2 * free)
        if free:
            state[-2] = rpm * RPM
        borders = [0.0, *sorted(t for t in set(corners) if 0 < t < seconds), seconds]
        found = np.zeros((len(times), len(state)))
        before = [0.0]
        for begin, end in zip(borders[:-1], borders[1:], strict=True):
            # An instant inside, so that jumps at a border belong to one side of it
            low = begin + 1e-12 * seconds
            high = end - 1e-12 * seconds

            def slope(t, y, low=low, high=high):
                t = min(max(t, low), high)
                if not free:
                    rates, _ = self.slope(
                        t, y, speed.theta(t), speed.omega(t), speed.alpha(t), False
                    )
                    return rates
                rates, power = self.slope(t, y[:-2], y[-1], y[-2], 0.0, True)
                return np.concatenate([rates, [power / self.total, y[-2]]])

            inside = (times >= begin) & (times < end)
            if end == seconds:
                inside |= times >= end
            asked = np.clip(times[inside], begin, end)
            solved = solve_ivp(
                slope,
                (begin, end),
                state,
                method="DOP853",
                rtol=TOLERANCE,
                atol=1e-14,
                t_eval=np.append(asked, end) if asked[-1:] != end else asked,
                max_step=longest,
            )
            found[inside] = solved.y.T[: len(asked)]
            state = solved.y[:, -1]
            before.append(end)
        return self.read(times, found, speed)

    def read(self, times, states, speed):
        """The motion at some instants, see :meth:`integrate`."""
        angles = []
        rates = []
        forces = []
        speeds = []
        turned = []
        for t, state in zip(times, states, strict=True):
            if speed is None:
                motion = state[:-2]
                omega = state[-2]
                theta = state[-1]
                alpha = 0.0
            else:
                motion = state
                omega = speed.omega(t)
                theta = speed.theta(t)
                alpha = speed.alpha(t)
            phi, rate, _, _ = self.posed(t, motion, theta, omega, alpha, speed is None)
            angles.append(phi)
            rates.append(rate)
            speeds.append(omega)
            turned.append(theta)
            forces.append(
                [
                    self.mesh(number, theta, omega, phi, rate)[1]
                    for number in range(len(self.meshes))
                ]
            )
        return Moved(
            np.array(angles),
            np.array(rates),
            np.array(forces),
            np.array(speeds),
            np.array(turned),
        )

    def torques(self, moved):
        """Transmitted torques ``(n,)`` N m of shafts and dampers by their disks."""
        return {
            pair: stiffness * (moved.angles @ row) + damping * (moved.rates @ row)
            for pair, (row, stiffness, damping) in self.rows.items()
        }


@dataclass(frozen=True)
class Moved:
    """Motion of a twin at some instants, see :meth:`Twin.integrate`."""

    angles: np.ndarray
    rates: np.ndarray
    forces: np.ndarray
    omega: np.ndarray
    theta: np.ndarray


def tooth_force(part, stiffness, l, rate):
    """Force in N of teeth with backlash, law (18) piece by piece."""
    soft = part.epsilon * part.stiffness
    width = part.transition * part.backlash
    low = (part.backlash - width) / 2
    depth = abs(l) - low
    hard = stiffness - soft
    if part.stiffness_orders:
        raise ValueError("backlash and varying stiffness are not written here")
    if depth <= 0:
        contact = 0.0
        share = 0.0
    elif depth < width:
        contact = hard * depth**2 / (2 * width)
        share = depth / width
    else:
        contact = hard * (depth - width / 2)
        share = 1.0
    if part.damping_law == "always":
        share = 1.0
    return soft * l + np.sign(l) * contact + part.damping * rate * share


def worst_difference(twin, moved, transient, instants):
    """Largest difference of a torque or tooth force of a transient from the twin at the
    instants ``(n,)``, over the largest value of that torque or force.
    """
    worst = 0.0
    for pair, expected in twin.torques(moved).items():
        found = transient.torque(*pair).values[instants]
        worst = max(worst, np.abs(found - expected).max() / np.abs(expected).max())
    for number, mesh in enumerate(twin.meshes):
        expected = moved.forces[:, number]
        found = transient.force(*mesh.between).values[instants]
        worst = max(worst, np.abs(found - expected).max() / np.abs(expected).max())
    return float(worst)


def disturbed(twin, kind, seconds, speed, rpm=None):
    """Lets an event of :mod:`random_plants` act on a twin: the times of its corners."""
    begin = kind.event.begin
    theta = twin.angle_over_time(seconds, speed, rpm)
    if begin is None:
        first = np.deg2rad(kind.event.begin_deg)
        begin = brentq(lambda t: theta(t) - first, 0.0, seconds, xtol=1e-14)
    else:
        first = theta(begin)

    def torque(t, turned):
        if t < begin:
            return {}
        return {kind.event.disk: kind.torque(t - begin, turned - first)}

    twin.torque = torque
    corners = [begin, *(begin + since for since in kind.seconds)]
    if not kind.angles:
        return corners
    theta = twin.angle_over_time(seconds, speed, rpm, corners)
    for angle in kind.angles:
        if theta(seconds) > first + angle > first:
            after = corners[-1]
            bend = brentq(
                lambda t, angle=angle: theta(t) - first - angle,
                begin,
                seconds,
                xtol=1e-14,
            )
            corners.append(max(bend, after) if angle == 0 else bend)
    return corners


def difference(
    parts, seconds, speed, *, rpm=None, kind=None, change=None, corners=(), instants=200
):
    """Largest difference of a transient from its twin, see :func:`worst_difference`:
    from rest, at a speed :class:`Ramps` or a free one from ``rpm`` on, with an event of
    a kind of :mod:`random_plants`, or a ``change``, a pair of an event and what of the
    twin does the same.
    """
    twin = Twin(parts, "engine")
    corners = list(corners)
    events = []
    if speed is not None:
        corners += [row[0] for row in speed.rows]
    if change is not None:
        event, name, function = change
        events.append(event)
        setattr(twin, name, function)
    if kind is not None:
        events.append(kind.event)
        corners += disturbed(twin, kind, seconds, speed, rpm)
    train = jaxhb.build([*parts, *events], reference="engine", revolutions_per_cycle=2)
    found = jaxhb.transient(
        train,
        seconds=seconds,
        speed="free" if speed is None else speed.rows,
        rpm=rpm,
        events=[event.name for event in events],
        start="rest",
    )
    time = np.asarray(found.time)
    places = np.unique(np.linspace(0, len(time) - 1, instants).astype(int))
    # Torques of disks without inertia jump with those of events.
    away = np.abs(time[places, None] - np.array([np.inf, *corners])).min(axis=1) > 1e-9
    places = places[away]
    moved = twin.integrate(seconds, speed, time[places], corners=corners, rpm=rpm)
    return worst_difference(twin, moved, found, places)


def accelerated_mass(t, *, omega, ratio, alpha, amplitude):
    """Exact motion ``(n,)`` from rest of ``x'' + 2 D w x' + w^2 x = a cos(alpha t^2 /
    2)`` by the complex error function: ``omega`` w rad/s, ``ratio`` D, ``alpha`` rad/s2.

    x = Im z / w_d of ``z' = lambda z + a cos(alpha t^2 / 2)`` with ``lambda = -D w + i
    w_d``. Both halves of the cosine are an integral of ``exp(lambda (t - s) +- i alpha
    s^2 / 2)``, a difference of two error functions, taken as Faddeeva's so that nothing
    overflows.
    """
    damped = omega * np.sqrt(1 - ratio**2)
    rate = -ratio * omega + 1j * damped

    def half(sign):
        c = 0.5j * sign * alpha
        middle = rate / (2 * c)
        root = np.sqrt(-c)
        peak = rate * t - rate**2 / (4 * c)

        def at(s):
            z = root * (s - middle)
            side = np.where(z.real >= 0, 1.0, -1.0)
            tail = np.exp(peak + c * (s - middle) ** 2) * wofz(1j * z * side)
            return side, tail * side

        side, tail = at(t)
        first_side, first_tail = at(np.zeros_like(t))
        crossed = side != first_side
        main = np.where(crossed, 2 * np.exp(np.where(crossed, peak, 0)), 0)
        return np.sqrt(np.pi) / (2 * root) * (main - (tail - first_tail))

    return (amplitude / 2 * (half(1) + half(-1)) / damped).imag

"""Cycles of an engine cylinder simulated step by step, valves and ports as orifices,
for tables like measured ones.

The gas of mass m, pressure p and temperature T = p V/(m R) obeys dp = (-n p dV + (n -
1) dQ + n R sum T dm)/V, Wiebe's heat Q goes with the shape 1, the exponent n with the
burnt share, and dm with the isentropic flow through an orifice.
"""

import math
from dataclasses import dataclass

import numpy as np

GAS_CONSTANT = 287.0
KAPPA = 1.35
CRITICAL = (2.0 / (KAPPA + 1.0)) ** (KAPPA / (KAPPA - 1.0))


@dataclass(frozen=True)
class Opening:
    """Valve or port to a receiver: angles in deg from firing top dead centre, m2, Pa,
    K.
    """

    opens: float
    closes: float
    area: float
    pressure: float
    temperature: float

    def width(self, angle: float, period: float) -> float:
        """Free area (m2) at an angle of any cycle: it widens and narrows within a
        quarter of its time.
        """
        passed = (angle - self.opens) % period / (self.closes - self.opens)
        return (
            self.area * min(1.0, 1.6 * math.sin(math.pi * passed))
            if passed < 1.0
            else 0.0
        )


@dataclass(frozen=True)
class Engine:
    """Cylinder in SI units, angles in deg; ``heat`` in J a cycle."""

    bore: float
    stroke: float
    rod: float
    ratio: float
    rpm: float
    exhaust: Opening
    inlet: Opening
    heat: float
    strokes: int = 4
    compression_exponent: float = 1.33
    expansion_exponent: float = 1.27
    start: float = -4.0
    duration: float = 60.0

    def volume(self, angle: float) -> tuple[float, float]:
        """Volume (m3) and its slope per deg."""
        sine = math.sin(math.radians(angle))
        cosine = math.cos(math.radians(angle))
        crank = self.stroke / 2.0
        lean = math.sqrt(self.rod**2 - (crank * sine) ** 2)
        travel = crank * (1.0 - cosine) + self.rod - lean
        slope = crank * sine * (1.0 + crank * cosine / lean) * math.pi / 180.0
        piston = math.pi / 4.0 * self.bore**2
        return piston * (self.stroke / (self.ratio - 1.0) + travel), piston * slope


def cycle(
    engine: Engine, *, fires: bool, step: float = 0.5
) -> tuple[np.ndarray, np.ndarray]:
    """Angle (deg, from half a period before firing TDC on) and pressure (Pa) of the
    cycle that repeats itself.
    """
    period = 180.0 * engine.strokes
    angles = -period / 2.0 + step * np.arange(round(period / step))
    pressure = engine.inlet.pressure
    volume, _ = engine.volume(angles[0])
    mass = pressure * volume / (GAS_CONSTANT * engine.inlet.temperature)
    before = np.zeros_like(angles)
    for _ in range(12):
        trace = np.empty_like(angles)
        for k, angle in enumerate(angles.tolist()):
            trace[k] = pressure
            pressure, mass = _stepped(engine, fires, angle, (pressure, mass), step)
        if abs(trace - before).max() < 1e-6 * trace.max():
            return angles, trace
        before = trace
    raise AssertionError("the cycle does not repeat itself")


def torque_harmonics(engine: Engine, angles, pressure, orders) -> np.ndarray:
    """T^n (N m) of p dV at the orders, by the trapezoidal rule over the cycle."""
    slopes = np.array([engine.volume(angle)[1] for angle in angles]) * 180.0 / math.pi
    return np.array(
        [
            (pressure * slopes * np.exp(-1j * order * np.deg2rad(angles))).mean()
            for order in orders
        ]
    )


def _stepped(engine, fires, angle, state, step):
    """Pressure and mass after a step of the classical Runge-Kutta method."""
    half = step / 2.0
    first = _slopes(engine, fires, angle, state)
    second = _slopes(engine, fires, angle + half, _moved(state, first, half))
    third = _slopes(engine, fires, angle + half, _moved(state, second, half))
    fourth = _slopes(engine, fires, angle + step, _moved(state, third, step))
    slopes = zip(first, second, third, fourth, strict=True)
    return tuple(
        v + step / 6.0 * (a + 2 * b + 2 * c + d)
        for v, (a, b, c, d) in zip(state, slopes, strict=True)
    )


def _moved(state, slopes, step):
    """State after a step along constant slopes."""
    return tuple(v + step * s for v, s in zip(state, slopes, strict=True))


def _slopes(engine, fires, angle, state):
    """Change of pressure and mass per deg."""
    pressure, mass = state
    volume, volume_slope = engine.volume(angle)
    temperature = pressure * volume / (mass * GAS_CONSTANT)
    burnt, burning = _burnt(engine, angle) if fires else (0.0, 0.0)
    exponent = (
        engine.compression_exponent
        + (engine.expansion_exponent - engine.compression_exponent) * burnt
    )
    gained = 0.0
    carried = 0.0
    for opening in (engine.exhaust, engine.inlet):
        area = opening.width(angle, 180.0 * engine.strokes)
        width = area / (6.0 * engine.rpm)  # m2 s/deg
        if pressure > opening.pressure:
            flow = -width * _flow(pressure, temperature, opening.pressure)
            warmth = temperature
        else:
            flow = width * _flow(opening.pressure, opening.temperature, pressure)
            warmth = opening.temperature
        gained = gained + flow
        carried = carried + flow * warmth
    heat = (exponent - 1.0) * engine.heat * burning
    work = -exponent * pressure * volume_slope
    pressure_slope = (work + heat + exponent * GAS_CONSTANT * carried) / volume
    return pressure_slope, gained


def _burnt(engine, angle):
    """Burnt share of the charge and its slope per deg, by Wiebe's function."""
    passed = (angle - engine.start) / engine.duration
    if passed < 0.0:
        return 0.0, 0.0
    left = math.exp(-6.908 * passed**2)
    return 1.0 - left, 2.0 * 6.908 * passed / engine.duration * left


def _flow(pressure, temperature, behind):
    """Mass flow (kg/(m2 s)) of the isentropic nozzle."""
    ratio = max(behind / pressure, CRITICAL)
    gain = (
        2.0
        * KAPPA
        / (KAPPA - 1.0)
        * (ratio ** (2.0 / KAPPA) - ratio ** ((KAPPA + 1.0) / KAPPA))
    )
    return pressure / math.sqrt(GAS_CONSTANT * temperature) * math.sqrt(max(gain, 0.0))

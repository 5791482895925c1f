"""Numbers over the cycles of a motion: of a solution that repeats, and of a record of a
motion that does not.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxhb._equal import by_value
from jaxhb._jax import Array
from jaxhb._shown import brief
from jaxhb.results.motion import Motion
from jaxhb.results.signal import Signal, Summarized
from jaxhb.train.topology import Topology

PARTS = 8  # of a record, whose extremes tell how far those of other records may lie
PERCENT = 5, 50, 95  # percentiles of a distribution over cycles


class PerCycle(NamedTuple):
    """Distribution over the cycles of the largest, the smallest and the largest
    absolute value of each: percentiles 5, 50, 95.
    """

    max: np.ndarray
    min: np.ndarray
    peak: np.ndarray


class RecordSpread(NamedTuple):
    """Difference to expect of the largest, the smallest and the largest absolute value
    of another record as long: two standard deviations, 0 for a motion that repeats.
    """

    max: float
    min: float
    peak: float

    @property
    def half_peak_to_peak(self) -> float:
        """Spread of (largest - smallest) / 2, at most."""
        return (self.max + self.min) / 2


NO_SPREAD = RecordSpread(0.0, 0.0, 0.0)


class OverCycles:
    """Statistics that follow from the largest and the smallest value of each cycle,
    ``highest`` and ``lowest``.
    """

    @property
    def peaks(self: Any) -> np.ndarray:
        """Largest absolute value of each cycle ``(cycles,)``."""
        return np.maximum(self.highest, -self.lowest)

    @property
    def per_cycle(self: Any) -> PerCycle:
        """Distribution of the extremes of a cycle, as :class:`PerCycle`."""
        return PerCycle(
            max=np.percentile(self.highest, PERCENT),
            min=np.percentile(self.lowest, PERCENT),
            peak=np.percentile(self.peaks, PERCENT),
        )


@jax.tree_util.register_dataclass
@by_value
@dataclass(frozen=True, repr=False)
class SteadySignal(Signal, OverCycles):
    """The :class:`Signal` of a motion whose period is ``cycles`` cycles of the
    excitation.
    """

    cycles: int = field(default=1, metadata={"static": True})

    spread = NO_SPREAD

    @property
    def highest(self) -> Array:
        """Largest value of each cycle ``(cycles,)``."""
        return self._by_cycle().max(axis=1)

    @property
    def lowest(self) -> Array:
        """Smallest value of each cycle ``(cycles,)``."""
        return self._by_cycle().min(axis=1)

    def _by_cycle(self) -> Array:
        """Samples of each cycle and the first of the next ``(cycles, n + 1)``."""
        # Rounded up: every cycle has as many samples.
        count = -(-self.resolution // self.cycles)
        values = np.reshape(self._sampled(count * self.cycles), (self.cycles, count))
        # A peak on the border of two cycles counts in both.
        return np.concatenate([values, np.roll(values, -1, axis=0)[:, :1]], axis=1)


@brief
@dataclass(frozen=True)
class RecordedSignal(Summarized, OverCycles):
    """A quantity over C recorded cycles that do not repeat.

    Parameters
    ----------
    highest, lowest : ``(C,)`` largest and smallest value of each cycle
    mean, rms : over the record
    amplitudes : ``(K,)`` one-sided peak amplitudes of the orders: quadratic mean over
    the cycles
    """

    highest: np.ndarray
    lowest: np.ndarray
    mean: float
    rms: float
    amplitudes: np.ndarray
    revolutions_per_cycle: float
    elastic_part: RecordedSignal | None = None

    @property
    def elastic(self) -> RecordedSignal:
        """The elastic part alone, a :class:`RecordedSignal`."""
        if self.elastic_part is None:
            raise AttributeError(
                "this signal is not a force or torque: it has no elastic part"
            )
        return self.elastic_part

    @property
    def max(self) -> float:
        """Largest value of the record."""
        return self.highest.max()

    @property
    def min(self) -> float:
        """Smallest value of the record."""
        return self.lowest.min()

    @property
    def peak(self) -> float:
        """Largest absolute value of the record."""
        return max(self.max, -self.min)

    @property
    def half_peak_to_peak(self) -> float:
        """(max - min) / 2 of the record."""
        return (self.max - self.min) / 2

    @property
    def spread(self) -> RecordSpread:
        """Distance of the extremes of other records from these.

        From the extremes of eight parts of the record, which scatter no less than those
        of longer ones; 0 of fewer than 16 cycles.
        """
        if len(self.highest) < 2 * PARTS:
            return NO_SPREAD
        values = self.highest, -self.lowest, np.maximum(self.highest, -self.lowest)
        parts = (
            [part.max() for part in np.array_split(of_cycles, PARTS)]
            for of_cycles in values
        )
        return RecordSpread._make(
            2 * float(np.std(largest, ddof=1)) for largest in parts
        )

    def order(self, order: float) -> float:
        """Amplitude of one order of the cycle: quadratic mean over the cycles."""
        turns = self.revolutions_per_cycle
        count = len(self.amplitudes)
        harmonic = round(order * turns)
        if abs(harmonic - order * turns) > 1e-9 or not 0 < harmonic <= count:
            allowed = f"a multiple of {1 / turns:g} up to {count / turns:g}"
            raise ValueError(
                f"order {order:g} is not among those recorded: use {allowed}"
            )
        return self.amplitudes[harmonic - 1]

    def reversed(self) -> RecordedSignal:
        """The quantity with the other sign."""
        part = self.elastic_part and self.elastic_part.reversed()
        high = -self.lowest
        low = -self.highest
        return dataclasses.replace(
            self, highest=high, lowest=low, mean=-self.mean, elastic_part=part
        )

    def shifted(self, by: float) -> RecordedSignal:
        """The quantity with a constant added."""
        rms = float(np.sqrt(self.rms**2 + 2 * by * self.mean + by**2))
        return dataclasses.replace(
            self,
            highest=self.highest + by,
            lowest=self.lowest + by,
            mean=self.mean + by,
            rms=rms,
        )

    def scaled(self, factor: float) -> RecordedSignal:
        """The quantity times a factor above 0."""
        return dataclasses.replace(
            self,
            highest=factor * self.highest,
            lowest=factor * self.lowest,
            mean=factor * self.mean,
            rms=factor * self.rms,
            amplitudes=factor * self.amplitudes,
        )

    def spectrum(self) -> list[list[float]]:
        """``[[order, A], ...]``."""
        return [
            [float(order), float(amplitude)]
            for order, amplitude in zip(self.orders, self.amplitudes, strict=True)
        ]


@dataclass(frozen=True)
class SteadyContact:
    """Contact of one mesh over a steady motion: shares of the time with the teeth
    separated and on the flank that does not drive; entries from separation to
    contact in a cycle; largest approach speed of an entry, m/s; sign of the mean force.
    """

    separated_fraction: float
    reverse_contact_fraction: float
    impacts_per_cycle: float
    hardest_impact: float
    drive_side: int


@brief
@dataclass(frozen=True)
class Record(Motion[RecordedSignal, SteadyContact, float]):
    """Record of a motion: a :class:`RecordedSignal` of the angle and of the speed of
    rotation of every disk, of the twist and of the torque of every shaft and damper, of
    the deflection and of the force of every mesh, and of the torque of every gear (by
    disk index); the contact of every mesh; and the heat of shafts and dampers, W.
    """

    topology: Topology = field(repr=False)
    cycles: int
    disks: tuple[RecordedSignal, ...]
    speeds: tuple[RecordedSignal, ...]
    twists: tuple[RecordedSignal, ...]
    torques: tuple[RecordedSignal, ...]
    deflections: tuple[RecordedSignal, ...]
    forces: tuple[RecordedSignal, ...]
    gears: dict[int, RecordedSignal]
    contacts: tuple[SteadyContact, ...]
    heat: tuple[float, ...]

    solution = None

    @property
    def spread(self) -> float:
        """Spread of the largest absolute tooth force of a mesh (without teeth: of the
        torque of a shaft) as a share of that force; the largest of all.
        """
        signals = self.forces or self.torques
        shares = (
            signal.spread.peak / signal.peak for signal in signals if signal.peak > 0
        )
        return max(shares, default=0.0)

    def _read(self, quantity: str, index: Any, sense: int = 1) -> Any:
        if quantity in ("acceleration", "transmission_error"):
            plural = f"{quantity.replace('_', ' ')}s"
            raise ValueError(f"the motion has no period: its record holds no {plural}")
        if quantity == "power":
            return self.heat[index] if index < len(self.heat) else float("nan")
        if quantity == "twist":
            a, b = (self.topology.disk_names[disk] for disk in index)
            index, sense = self.topology.link_index(a, b)
            if index >= len(self.twists):
                raise ValueError(
                    "a record holds the twists of shafts and dampers, and a mesh joins"
                    f" {a!r} and {b!r}"
                )
        by_quantity: dict[str, Any] = {
            "angle": self.disks,
            "speed": self.speeds,
            "twist": self.twists,
            "torque": self.torques,
            "force": self.forces,
            "deflection": self.deflections,
            "gear_torque": self.gears,
            "contact": self.contacts,
        }
        signal = by_quantity[quantity][index]
        return signal if sense > 0 else signal.reversed()


class NoSignal(Summarized):
    """The signal of a motion that is not known."""

    mean = min = max = rms = peak = half_peak_to_peak = sum_of_amplitudes = math.nan
    per_cycle = PerCycle._make(np.full((3, 3), np.nan))
    spread = RecordSpread(math.nan, math.nan, math.nan)
    elastic = property(lambda self: self)

    def spectrum(self) -> list[list[float]]:
        """No orders."""
        return []

    def reversed(self) -> NoSignal:
        """The signal itself: it has no sign."""
        return self


NO_SIGNAL = NoSignal()
NO_CONTACT = SteadyContact(math.nan, math.nan, math.nan, math.nan, 0)


class Motions(Motion):
    """Motions at several speeds read together: extremes and means of signals, and
    powers, as arrays ``(n,)``; nan where a motion is None.
    """

    def __init__(self, topology: Topology, motions: Sequence[Motion | None]):
        self.topology = topology
        self.motions = motions

    def _read(self, quantity: str, index: Any, sense: int = 1) -> Any:
        if quantity == "power":
            powers = [
                np.nan if motion is None else motion._read(quantity, index)
                for motion in self.motions
            ]
            return np.array(powers)
        # A motion without a period has no accelerations.
        signals = [
            NO_SIGNAL
            if motion is None or (quantity == "acceleration" and not motion.solution)
            else motion._read(quantity, index, sense)
            for motion in self.motions
        ]
        return SimpleNamespace(
            mean=np.array([float(signal.mean) for signal in signals]),
            min=np.array([float(signal.min) for signal in signals]),
            max=np.array([float(signal.max) for signal in signals]),
            half_peak_to_peak=np.array(
                [float(signal.half_peak_to_peak) for signal in signals]
            ),
        )

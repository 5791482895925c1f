"""Numbers over the cycles of a motion: of a solution that repeats, and of one that was
recorded as it never does.
"""

from __future__ import annotations

import dataclasses
import math
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
PERCENT = 5, 50, 95  # that are given of a distribution over cycles


class PerCycle(NamedTuple):
    """Distribution over the cycles of the largest, the smallest and the largest
    absolute value of each: percentiles 5, 50, 95.
    """

    max: np.ndarray
    min: np.ndarray
    peak: np.ndarray


class Spread(NamedTuple):
    """By how much the largest, the smallest and the largest absolute value of another
    record as long would differ: two standard deviations, 0 of a motion that repeats.
    """

    max: float
    min: float
    peak: float

    @property
    def half_peak_to_peak(self) -> float:
        """That of (largest - smallest) / 2, at most."""
        return (self.max + self.min) / 2


NO_SPREAD = Spread(0.0, 0.0, 0.0)


class OverCycles:
    """What follows from the largest and the smallest value of each cycle, ``highest``
    and ``lowest``.
    """

    @property
    def peaks(self: Any) -> np.ndarray:
        """Largest absolute value of each cycle ``(cycles,)``."""
        return np.maximum(self.highest, -self.lowest)

    @property
    def per_cycle(self: Any) -> PerCycle:
        """Distribution of the extremes of a cycle, as :class:`PerCycle`."""
        return PerCycle(
            *(
                np.percentile(own, PERCENT)
                for own in (self.highest, self.lowest, self.peaks)
            )
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

    def _by_cycle(self):
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

    highest, lowest : ``(C,)`` largest and smallest value of each cycle; mean, rms :
    over the record amplitudes : ``(K,)`` one-sided peak amplitudes of the orders:
    quadratic mean over the cycles
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
    def spread(self) -> Spread:
        """How far the extremes of other records may lie from these, as :class:`Spread`.

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
        return Spread(*(2 * float(np.std(largest, ddof=1)) for largest in parts))

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
        moved = {
            name: getattr(self, name) + by for name in ("highest", "lowest", "mean")
        }
        rms = float(np.sqrt(self.rms**2 + 2 * by * self.mean + by**2))
        return dataclasses.replace(self, **moved, rms=rms)

    def scaled(self, factor: float) -> RecordedSignal:
        """The quantity times a factor above 0."""
        names = "highest", "lowest", "mean", "rms", "amplitudes"
        return dataclasses.replace(
            self, **{name: factor * getattr(self, name) for name in names}
        )

    def spectrum(self) -> list[list[float]]:
        """``[[order, A], ...]``."""
        return [
            [float(o), float(a)]
            for o, a in zip(self.orders, self.amplitudes, strict=True)
        ]


@dataclass(frozen=True)
class SteadyContact:
    """Contact of one mesh over a steady motion: shares of the time, teeth apart, and on
    the flank that does not drive; entries from separation to contact; largest approach
    speed of one, m/s; sign of the mean force.
    """

    separated_fraction: float
    reverse_contact_fraction: float
    impacts_per_cycle: float
    hardest_impact: float
    drive_side: int


@brief
@dataclass(frozen=True)
class Record(Motion[RecordedSignal, SteadyContact, float]):
    """:class:`RecordedSignal` of every disk, of its speed of rotation, of every shaft
    and damper (twists, torques), mesh and gear (by disk index); the contact of every
    mesh; and the heat of shafts and dampers, W.
    """

    topology: Topology = field(repr=False)
    cycles: int
    disks: tuple
    speeds: tuple
    twists: tuple
    torques: tuple
    deflections: tuple
    forces: tuple
    gears: dict
    contacts: tuple
    heat: tuple

    solution = None

    @property
    def spread(self) -> float:
        """Of the largest absolute tooth force of every mesh (without teeth: of the
        torque of shafts) its spread as a share of it: the largest.
        """
        signals = self.forces or self.torques
        return max(
            (one.spread.peak / one.peak for one in signals if one.peak > 0), default=0.0
        )

    def _read(self, quantity, index, sense=1):
        if quantity in ("acceleration", "transmission_error"):
            what = {"acceleration": "accelerations"}.get(
                quantity, "transmission errors"
            )
            raise ValueError(f"the motion has no period: its record holds no {what}")
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
        read = {
            "angle": self.disks,
            "speed": self.speeds,
            "twist": self.twists,
            "torque": self.torques,
        }
        read |= {"force": self.forces, "deflection": self.deflections}
        read |= {"gear_torque": self.gears, "contact": self.contacts}
        found = read[quantity][index]
        return found if sense > 0 else found.reversed()


class NoSignal(Summarized):
    """The signal of a motion that is not known."""

    mean = min = max = rms = peak = half_peak_to_peak = sum_of_amplitudes = math.nan
    per_cycle = PerCycle(*np.full((3, 3), np.nan))
    spread = Spread(math.nan, math.nan, math.nan)
    elastic = property(lambda self: self)

    def spectrum(self):
        """No orders."""
        return []

    def reversed(self):
        """The same: it has no sign."""
        return self


NO_SIGNAL = NoSignal()
NO_CONTACT = SteadyContact(math.nan, math.nan, math.nan, math.nan, 0)


class Motions(Motion):
    """Motions at several speeds as one, of which the extremes and means of signals and
    the powers are read as arrays; nan where a motion is None.
    """

    def __init__(self, topology, motions):
        self.topology = topology
        self.motions = motions

    def _read(self, quantity, index, sense=1):
        if quantity == "power":
            return np.array(
                [
                    np.nan if one is None else one._read(quantity, index)
                    for one in self.motions
                ]
            )
        signals = [
            NO_SIGNAL if one is None else one._read(quantity, index, sense)
            for one in self.motions
        ]
        names = "mean", "min", "max", "half_peak_to_peak"
        return SimpleNamespace(
            **{
                name: np.array([float(getattr(s, name)) for s in signals])
                for name in names
            }
        )

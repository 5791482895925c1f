"""Readings of a transient that reports tell: stresses beside their limits, damage,
passages through ranges of speeds, the steady motion at the same speeds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxhb.elements.rules import Rule
from jaxhb.linear.forced import forced_response
from jaxhb.linear.strength import (
    LIMITS,
    BarredRange,
    Running,
    having,
    speed_of,
    strength,
    stress_limits,
)
from jaxhb.results.motion import drive_sense, sense_of
from jaxhb.steady.steady_state import steady_state
from jaxhb.train.topology import Topology
from jaxhb.transients.fatigue import SNCurve, count_cycles, damage_of
from jaxhb.transients.history import History
from jaxhb.transients.motion import Transient

BARRED_SPEEDS = 201  # from which barred ranges are found
STEADY_SPEEDS = 49  # of the steady motion of a picture
SAME_SPEED = 1e-3  # share by which speeds differ that count as one
SLOWEST = 0.02  # share of the highest speed below which no steady motion is looked for


@dataclass(frozen=True)
class Fatigue:
    """Counted cycles of the stress of a shaft, largest amplitude in Pa, damage by its
    S-N curve.
    """

    cycles: float
    amplitude: float
    damage: float
    curve: SNCurve


@dataclass(frozen=True)
class StressPeak:
    """Amplitude of the torsional stress of a shaft in a cycle of the excitation, in Pa,
    where its share of the transient limit is largest, without limits where it is
    largest: time in s, speed in rpm, limit in Pa and share, nan without.
    """

    amplitude: float
    time: float
    rpm: float
    limit: float
    share: float
    rule: Rule | None
    fatigue: Fatigue | None


@dataclass(frozen=True)
class Peak:
    """Largest number of an element that a limit bounds at every instant, with its limit
    in the SI unit: time in s, speed in rpm.
    """

    value: float
    limit: float
    time: float
    rpm: float

    @property
    def share(self) -> float:
        """Number over its limit."""
        return self.value / self.limit


@dataclass(frozen=True)
class Passage:
    """Seconds between two speeds in rpm: those of a barred range of a shaft, of
    ``shaft`` "" any others.
    """

    low: float
    high: float
    seconds: float
    shaft: str = ""
    barred: BarredRange | None = None


@dataclass(frozen=True)
class TransientReport:
    """A transient, how it began, its events, and what follows from it; ``peaks`` by
    fields of :class:`jaxhb.Strength` and elements.
    """

    run: Transient
    start: str
    events: tuple[str, ...]
    stresses: dict[str, StressPeak]
    passages: list[Passage]
    peaks: dict[str, dict[str, Peak]]

    @property
    def topology(self) -> Topology:
        """Topology of the train."""
        return self.run.topology


def transient_report(
    run: Transient,
    *,
    start: str,
    events: Sequence[str],
    passages: Sequence[tuple[float, float]],
) -> TransientReport:
    """Read a transient."""
    shafts = having(run.topology, "shaft", "outer", "diameter")
    chosen = [
        Passage(low, high, float(run.passage(low, high))) for low, high in passages
    ]
    return TransientReport(
        run=run,
        start=start,
        events=tuple(events),
        stresses={name: _stress_peak(run, name) for name in shafts},
        passages=[*_barred_passages(run), *chosen],
        peaks={kind: _peaks(run, kind) for kind in AT_EVERY_INSTANT},
    )


AT_EVERY_INSTANT = ("largest_torques", "speeds")
"""Kinds of limits that hold at every instant, not over a cycle alone."""


def _peaks(run: Transient, kind: str) -> dict[str, Peak]:
    """Find the largest number of every element with a limit of a kind."""
    peaks = {}
    limit = LIMITS[kind]
    names = [
        name
        for table in limit.tables
        for name in having(run.topology, table, limit.key)
    ]
    for name in names:
        values = run.torque(name)
        if kind == "speeds":
            speeds = np.asarray(speed_of(Running(run.train, run.rpm, run), name))
            values = History(run.time, speeds, run.rpm, run.angle)
        peaks[name] = Peak(
            value=float(values.peak),
            limit=float(limit.of(run.train, name)),
            time=float(values.time_of_peak),
            rpm=float(values.rpm_of_peak),
        )
    return peaks


def has_curve(topology: Topology) -> bool:
    """Tell whether the scene gives a S-N curve."""
    return any(points for points, _ in topology.shaft_curves)


def _stress_peak(run: Transient, name: str) -> StressPeak:
    """Read the stress of a shaft that has a section."""
    topology = run.topology
    stress = run.stress(name)
    envelope = stress.envelope_of_cycles(topology.revolutions_per_cycle)
    amplitude = (envelope.highest - envelope.lowest) / 2
    limits = np.full(len(amplitude), np.nan)
    link, _ = topology.link_index(name)
    rule = None
    if topology.has_key(link, "tensile_strength"):
        rule = topology.rule_of(link)
        limits = np.asarray(stress_limits(run.train, name, envelope.rpm)[1])
        limits = np.where(np.isfinite(limits), limits, np.nan)
    shares = amplitude / limits
    judged = np.isfinite(shares).any()
    place = int(np.nanargmax(shares) if judged else np.argmax(amplitude))
    points, _ = topology.shaft_curves[link] if topology.shaft_curves else ((), "")
    return StressPeak(
        amplitude=float(amplitude[place]),
        time=float(envelope.time[place]),
        rpm=float(envelope.rpm[place]),
        limit=float(limits[place]),
        share=float(shares[place]),
        rule=rule,
        fatigue=_fatigue(stress, run.sn_curve(name)) if points else None,
    )


def _fatigue(stress: History, curve: SNCurve) -> Fatigue:
    """Count the cycles of a stress."""
    cycles = count_cycles(stress)
    return Fatigue(
        cycles=cycles.total,
        amplitude=float(np.max(cycles.ranges, initial=0.0)) / 2,
        damage=float(damage_of(cycles, curve)),
        curve=curve,
    )


def speeds_passed(run: Transient, count: int) -> np.ndarray:
    """So many speeds in rpm between the lowest and the highest one of a transient;
    empty where it stays at one.
    """
    speeds = np.asarray(run.rpm)
    highest = float(speeds.max())
    lowest = max(float(speeds.min()), SLOWEST * highest)
    if highest - lowest <= SAME_SPEED * highest:
        return np.zeros(0)
    return np.linspace(lowest, highest, count)


def _barred_passages(run: Transient) -> list[Passage]:
    """Find the barred ranges of the linear response that a transient passes, as wide as
    their rule bars them.
    """
    topology = run.topology
    limited = [
        name
        for name in having(topology, "shaft", "outer", "diameter")
        if topology.has_key(topology.link_index(name)[0], "tensile_strength")
    ]
    speeds = speeds_passed(run, BARRED_SPEEDS)
    if not limited or not len(speeds):
        return []
    judged = strength(forced_response(run.train, rpm=speeds))
    return [
        Passage(
            barred.bar_low,
            barred.bar_high,
            float(run.passage(barred.bar_low, barred.bar_high)),
            name,
            barred,
        )
        for name, ranges in judged.barred.items()
        for barred in ranges
        if barred.low < barred.high
    ]


def signal_of(motion: Any, name: str) -> Any:
    """Read the tooth force of a mesh, the torque of a shaft or damper."""
    if name in motion.topology.mesh_names:
        return motion.force(name)
    return motion.torque(name)


def signal_for_people(run: Transient, name: str) -> History:
    """Read the same, in the drive sense of the link."""
    signal = signal_of(run, name)
    in_sense = sense_of(run.topology, name, signal) > 0
    return signal if in_sense else signal.reversed()


def governing_link(report: TransientReport) -> str:
    """Find the shaft with the largest share of its transient limit, else that with the
    largest torque; the mesh with the largest force where there are no shafts.
    """
    run = report.run
    shares = {
        name: peak.share
        for name, peak in report.stresses.items()
        if np.isfinite(peak.share)
    }
    if shares:
        return max(shares, key=shares.__getitem__)
    topology = run.topology
    names = topology.shaft_names or topology.shaft_and_damper_names
    names = names or topology.mesh_names
    return max(names, key=lambda name: float(signal_of(run, name).peak))


@dataclass(frozen=True)
class SteadyExtremes:
    """Largest and smallest value of a link in the steady motion at speeds in rpm, in
    the sense of a transient; nan where it is not known.
    """

    rpm: np.ndarray
    highest: np.ndarray
    lowest: np.ndarray


def steady_extremes(
    run: Transient, name: str, progress: Callable[[int], object] | None = None
) -> SteadyExtremes | None:
    """Compute the steady motion of a link at the speeds that a transient passes; None
    where it stays at one.
    """
    speeds = speeds_passed(run, STEADY_SPEEDS)
    if not len(speeds):
        return None
    sweep = steady_state(run.train, rpm=speeds, progress=progress)
    extremes = np.full((2, len(speeds)), np.nan)
    for place, state in enumerate(sweep.states):
        if state.known:
            signal = signal_of(state, name)
            extremes[:, place] = float(signal.max), float(signal.min)
    if drive_sense(run, name) < 0:
        extremes = -extremes[::-1]
    return SteadyExtremes(speeds, *extremes)

"""Figures of transients: a torque and the speed over time, its envelope beside the
steady motion, its orders over the speed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import (
    Axis,
    Band,
    Figure,
    bands,
    figure,
    line,
    plain,
    speed_range,
)
from jaxhb.report.selection import train_name
from jaxhb.report.transients import (
    SteadyExtremes,
    TransientReport,
    signal_for_people,
    speeds_passed,
)
from jaxhb.report.units import shown_unit
from jaxhb.train.excitation import listed_harmonic
from jaxhb.transients.history import History

if TYPE_CHECKING:
    from jaxhb.report.figures.draw import Picture

MOST_POINTS = 3000  # of a line; of more instants the extremes of windows are drawn
MOST_ORDERS = 5  # that are drawn
SMALLEST = 0.03  # share of the largest order from which others are drawn
REVOLUTIONS = 8.0  # of a window of the orders, at least
HEIGHT = 125  # pixels of the panels over time
TALL = 190  # pixels of a panel of signals


def plot_transient(
    report: TransientReport, link: str, steady: SteadyExtremes | None
) -> Picture:
    """Draw the :func:`transient_figures`."""
    figures = transient_figures(report, link, steady)
    return drawn(*figures, title=train_name(report.topology))


def transient_figures(
    report: TransientReport, link: str, steady: SteadyExtremes | None
) -> list[Figure]:
    """Make the figures of the torque of a shaft or damper, or the force of a mesh, with
    the speed over time; of its extremes in a cycle over the speed beside those of the
    steady motion; and of its largest orders over the speed.

    Where the speed goes up and down the last two go over the time. Barred ranges of
    speeds are grey.
    """
    run = report.run
    signal = signal_for_people(run, link)
    is_mesh = link in run.topology.mesh_names
    factor, unit = shown_unit("N" if is_mesh else "N m")
    called = "tooth force" if is_mesh else "torque"
    shown = _Shown(signal, factor, f"{called}, {unit}", plain(link))
    figures = [_over_time(report, shown)]
    if steady is not None:
        figures.append(_beside_steady(report, shown, steady))
    orders = _orders(report, shown)
    if orders is not None:
        figures.append(orders)
    return figures


class _Shown:
    """A signal of a link, the factor to its unit for people, the title of its axis."""

    def __init__(self, signal: History, factor: float, title: str, link: str):
        self.signal = signal
        self.factor = factor
        self.title = title
        self.link = link

    @property
    def called(self) -> str:
        """Its quantity and its link in a caption."""
        quantity = self.title.partition(",")[0]
        return f"{quantity.capitalize()} of {self.link}"


def _over_time(report: TransientReport, shown: _Shown) -> Figure:
    """Make the figure of speed and signal over time."""
    run = report.run
    signal = shown.signal
    time = np.asarray(signal.time)
    values = np.asarray(signal.values)
    speed_at = time
    if len(time) > MOST_POINTS:
        envelope = signal.envelope(2 * (time[-1] - time[0]) / MOST_POINTS)
        # The line goes up and down in every window, so that all peaks are there.
        both = np.stack([envelope.lowest, envelope.highest], axis=-1)
        values = both.ravel()
        time = np.repeat(envelope.time, 2)
        speed_at = np.append(envelope.time, signal.time[-1])
    rpm = np.interp(speed_at, run.time, run.rpm)
    traces = [
        line(speed_at, rpm, "speed", 1, panel=0, look={"dash": "solid"}),
        line(time, shown.factor * values, shown.link, panel=1, look={"width": 0.9}),
    ]
    highest = float(np.max(run.rpm))
    panels = [
        Axis("speed, rpm", (0.0, 1.08 * highest)),
        Axis(shown.title, _range(shown.factor * values)),
    ]
    events = f"; events: {', '.join(report.events)}" if report.events else ""
    caption = f"{shown.called} over time, and the speed{events}"
    end = float(run.time[-1])
    return figure(caption, Axis("time, s", (0.0, end)), panels, traces, height=HEIGHT)


def _range(values: np.ndarray) -> tuple[float, float]:
    """Return the range of an axis that holds all values, and zero."""
    low = min(float(values.min()), 0.0)
    high = max(float(values.max()), 0.0)
    edge = 0.06 * (high - low) or 1.0
    return (low - edge * (low < 0), high + edge * (high > 0))


def _beside_steady(
    report: TransientReport, shown: _Shown, steady: SteadyExtremes
) -> Figure:
    """Make the figure of the extremes in a cycle over the speed."""
    cycle = report.topology.revolutions_per_cycle
    envelope = shown.signal.envelope_of_cycles(cycle)
    factor = shown.factor
    across = _Across(report)
    x = across.places(envelope.time, envelope.rpm)
    traces = [
        line(x, factor * envelope.highest, "transient", look={"width": 2}),
        line(
            x,
            factor * envelope.lowest,
            "transient",
            look={"width": 2},
            showlegend=False,
        ),
    ]
    for values, named in ((steady.highest, True), (steady.lowest, False)):
        there = steady.rpm
        if not across.by_speed:
            there = x
            values = np.interp(envelope.rpm, steady.rpm, values)
        traces.append(
            line(
                there,
                factor * values,
                "steady motion",
                1,
                mode="lines+markers" if across.by_speed else "lines",
                showlegend=named,
            )
        )
    every = [factor * row for row in (envelope.highest, envelope.lowest)]
    every += [factor * row for row in (steady.highest, steady.lowest)]
    extremes = np.concatenate(every)
    caption = (
        f"{shown.called}: largest and smallest in a cycle, beside the steady motion"
    )
    return figure(
        caption,
        across.axis,
        [Axis(shown.title, _range(extremes[np.isfinite(extremes)]))],
        traces,
        height=TALL,
        bands=across.bands,
    )


class _Across:
    """Axis of figures of windows: the speed where it goes one way, else the time."""

    def __init__(self, report: TransientReport):
        run = report.run
        change = np.diff(np.asarray(run.rpm))
        still = 1e-9 * float(np.max(run.rpm))
        one_way = bool(np.all(change >= -still) or np.all(change <= still))
        speeds = speeds_passed(run, 2)
        self.by_speed = one_way and len(speeds) > 0
        self.axis = Axis("time, s", (0.0, float(run.time[-1])))
        self.bands: list[Band] = []
        if self.by_speed:
            self.axis = Axis("speed, rpm", speed_range(speeds))
            self.bands = bands(
                (passage.low, passage.high)
                for passage in report.passages
                if passage.barred
            )

    def places(self, time: np.ndarray, rpm: np.ndarray) -> np.ndarray:
        """Return places of windows on the axis."""
        return rpm if self.by_speed else time


def _orders(report: TransientReport, shown: _Shown) -> Figure | None:
    """Make the figure of the largest orders over the speed, or the time; None
    where the rotor turns too little.
    """
    signal = shown.signal
    topology = report.topology
    cycle = topology.revolutions_per_cycle
    cycles = math.ceil(REVOLUTIONS / cycle)
    turned = float(signal.angle[-1] - signal.angle[0]) / (2 * np.pi)
    harmonics = listed_harmonic(topology)
    if turned < 2 * cycles * cycle or not harmonics:
        return None
    orders = np.arange(1, harmonics + 1) / cycle
    spectra = signal.order_map(
        highest=orders[-1] + 0.5 / (cycles * cycle), revolutions=cycles * cycle
    )
    # Those of the excitation alone: each spreads over its neighbours.
    amplitudes = shown.factor * spectra.amplitudes[:, cycles::cycles]
    highest = amplitudes.max(axis=0)
    largest = np.argsort(-highest, kind="stable")[:MOST_ORDERS]
    largest = largest[highest[largest] >= SMALLEST * highest.max()]
    across = _Across(report)
    x = across.places(spectra.time, spectra.rpm)
    traces = [
        line(x, amplitudes[:, k], f"order {orders[k]:g}", style)
        for style, k in enumerate(sorted(largest))
    ]
    which = "the largest orders" if len(traces) > 1 else traces[0]["name"]
    caption = (
        f"{shown.called}: amplitudes of {which} in windows of {cycles * cycle:g}"
        " revolutions"
    )
    return figure(
        caption,
        across.axis,
        [Axis(shown.title, (0.0, 1.08 * float(highest.max()) or 1.0))],
        traces,
        height=TALL,
        bands=across.bands,
    )

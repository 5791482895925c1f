"""Pulse trains of a wheel: pulses that are missing or too many are found by their
intervals.
"""

from dataclasses import dataclass

import numpy as np

NEIGHBOURS = 4  # intervals to either side whose median tells the usual one
MISSING = 1.5  # intervals from which a pulse is missing
EXTRA = 0.4  # of an interval, below which a pulse is one too many


@dataclass(frozen=True)
class Pulses:
    """Times ``(n,)`` of pulses in s, the number ``(n,)`` of each, counted from the
    first with those that are missing, and sentences on what was mended.
    """

    time: np.ndarray
    number: np.ndarray
    notes: tuple[str, ...]


def counted(time: np.ndarray) -> Pulses:
    """Count rising times of pulses.

    An interval of one and a half usual ones or more holds missing pulses, one below 0.4
    ends with a pulse too many: so speeds may vary by a third from pulse to pulse.
    """
    notes = []
    usual = _usual(np.diff(time))
    extra = 1 + np.flatnonzero(np.diff(time) < EXTRA * usual)
    if len(extra):
        notes.append(
            f"{_count(len(extra), 'pulse')} too many, the first at"
            f" {time[extra[0]]:.6g} s, left out."
        )
        time = np.delete(time, extra)
    intervals = np.diff(time)
    steps = np.maximum(np.rint(intervals / _usual(intervals)), 1.0)
    steps[intervals < MISSING * _usual(intervals)] = 1.0
    gaps = np.flatnonzero(steps > 1)
    if len(gaps):
        missing = int((steps[gaps] - 1).sum())
        place = f"behind {time[gaps[0]]:.6g} s"
        first = place if missing == 1 else f"the first {place}"
        notes.append(
            f"{_count(missing, 'pulse')} missing, {first}; the others are counted on."
        )
    number = np.concatenate([[0.0], np.cumsum(steps)])
    return Pulses(time, number, tuple(notes))


def _usual(intervals: np.ndarray) -> np.ndarray:
    """Median of the intervals around each."""
    width = min(2 * NEIGHBOURS + 1, len(intervals))
    padded = np.pad(intervals, width // 2, mode="reflect" if width > 1 else "edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, width)
    return np.median(windows, axis=-1)[: len(intervals)]


def _count(number: int, word: str) -> str:
    """Say how many there are: ``1 pulse is``, ``3 pulses are``."""
    return f"{number} {word} is" if number == 1 else f"{number} {word}s are"

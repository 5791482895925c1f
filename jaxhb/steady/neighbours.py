"""Neighbours along a sweep, over speeds or over values of a number: which of them hand
on their motion.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxhb.balance.swept import difference
from jaxhb.results.steady import SteadyState
from jaxhb.steady.classification import APART, ARRIVED


@dataclass(frozen=True)
class Start:
    """Motion (x, x') ``(2S,)`` from which a place of a sweep starts, and the speed of
    that motion in rpm.
    """

    motion: np.ndarray
    rpm: float


def settle_along(
    order: Sequence[int] | np.ndarray,
    from_contact: Mapping[int, SteadyState],
    march: Callable[[dict[int, Start]], Mapping[int, SteadyState]],
    name: Callable[[int], str],
    begun: Mapping[int, SteadyState],
) -> dict[int, SteadyState]:
    """Steady states of places by index, each reached from the one before it in
    ``order``.

    Places that may have another motion from there are marched side by side, again where
    the one before changed.

    from_contact : states from teeth at rest on their drive sides; march : gives the
    states of places from other starts, without those that stay as they are; name : of a
    place in words, as "2000 rpm"; begun : states of places that had another start
    """
    states = {**from_contact, **begun}
    reached_from: dict[int, SteadyState] = {}
    while True:
        starts = {}
        origins = {}
        for last, index in itertools.pairwise(order):
            before = states[last]
            if reached_from.get(index) is before:
                continue
            reached_from[index] = before
            if before.motion is not None and _differs(before, from_contact[index]):
                starts[index] = Start(before.motion, before.rpm)
                origins[index] = name(last)
            else:
                states[index] = from_contact[index]
        if not starts:
            return states
        for index, state in march(starts).items():
            at_hand = from_contact[index], states[index]
            same = (other for other in at_hand if _alike(state, other))
            states[index] = next(same, None) or _with_note(
                state, from_contact[index], origins[index]
            )


def _kind(state: SteadyState) -> tuple[str, int]:
    """Kind and period of a steady state."""
    return state.kind, state.period


def _with_note(state: SteadyState, other: SteadyState, origin: str) -> SteadyState:
    """A steady state with a note that it was reached from that at ``origin``, and is
    not the ``other`` one, to which teeth come from rest on their drive sides.
    """
    motion = (
        "another motion"
        if _kind(other) == _kind(state)
        else f"a motion that is {other.kind}"
    )
    note = (
        "several motions are possible: this one was reached from that at"
        f" {origin}, and from rest on their drive sides the teeth come to {motion}"
    )
    if not (other.known and state.known):
        return state
    return replace(state, notes=(*state.notes, note))


def _differs(before: SteadyState, state: SteadyState) -> bool:
    """Whether a place may have another motion when it starts from the one before."""
    if not state.topology.has_law.any():  # constant links have one motion, or none
        return False
    return _kind(before) != _kind(state) or (
        not state.linear and _distance(before, state) > APART
    )


def _alike(state: SteadyState, other: SteadyState) -> bool:
    """Whether two steady states of one place are the same motion."""
    most = APART if state.kind == "irregular" else ARRIVED
    return _kind(state) == _kind(other) and _distance(state, other) <= most


def _distance(state: SteadyState, other: SteadyState) -> float:
    """Relative difference of two steady states of one kind: of their motions over a
    period, or of the largest deflections of records.
    """
    if not state.known:
        return 0.0
    if state.response is not None and other.response is not None:
        return difference(
            state.response.deflections,
            other.response.deflections,
            max(state.period, 1),
        )
    names = state.topology.mesh_names
    peaks = np.array([float(state.deflection(name).peak) for name in names])
    other_peaks = np.array([float(other.deflection(name).peak) for name in names])
    largest = np.maximum(np.maximum(peaks, other_peaks), 1e-300)
    return float((np.abs(peaks - other_peaks) / largest).max(initial=0.0))

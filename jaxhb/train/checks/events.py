"""Checks of events against the rest of a scene, and its sequences: named lists of
events that begin together, ``[sequence.NAME]`` with ``events`` and ``begin`` in s.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from jaxhb.elements.checks import Parts
from jaxhb.elements.sentences import Suggestions, cut, shown, suggestion
from jaxhb.elements.units import si_number
from jaxhb.elements.values import number_like

_KEYS = ("events", "begin")


def event_errors(parts: Parts) -> list[str]:
    """Find events of cylinders and shafts that do not exist."""
    errors = []
    cylinders = [name for name in parts.names["cylinder"] if isinstance(name, str)]
    names = set(cylinders)
    near = Suggestions(cylinders)
    for i, event in enumerate(parts.tables["event"]):
        where = parts.where("event", i)
        failing = [
            name
            for key in ("misfire", "cut_off")
            if isinstance(name := getattr(event, key), str) and name
        ]
        if parts.complete:
            errors += [
                f"{where}: there is no cylinder {shown(name)}.{near(name)}"
                for name in failing
                if name not in names
            ]
        pair = event.between
        is_pair = parts.usable("event", i, "between") and pair is not None
        if is_pair and all(parts.disk(end) is not None for end in pair):
            errors += [f"{where}: {text}" for text in _shaft_errors(parts, pair)]
    return errors


def _shafts(parts: Parts, pair: Sequence[str]) -> list[int]:
    """Shafts between two disks."""
    disks = {parts.disk(end) for end in pair}
    return [i for i, ends in parts.links("shaft") if set(ends) == disks]


def shaft_of(parts: Parts, pair: Sequence[str]) -> int:
    """Number of the shaft between two disks of a sound scene."""
    (shaft,) = _shafts(parts, pair)
    return shaft


def _shaft_errors(parts: Parts, pair: Sequence[str]) -> list[str]:
    """Check that exactly one shaft joins two disks."""
    a, b = pair
    count = len(_shafts(parts, pair))
    if count == 1 or a == b or not parts.complete:
        return []
    if count:
        return [
            f"{count} shafts join {shown(a)} and {shown(b)}, must be one. Put a disk"
            " between them and the clutch."
        ]
    names = [name for name in parts.names["shaft"] if isinstance(name, str)]
    near = suggestion(f"{a}|{b}", names)
    return [f"there is no shaft between {shown(a)} and {shown(b)}.{near}"]


def read_sequences(
    parts: Parts, sequences: Any
) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """Read the sequences by name, each with ``events`` and ``begin``, and tell faults
    in sentences.
    """
    if sequences is None:
        return {}, []
    if not isinstance(sequences, dict) or not all(
        isinstance(sequence, dict) for sequence in sequences.values()
    ):
        return {}, [
            f"{parts.source}: 'sequence' must hold a table for each sequence. Write"
            " [sequence.NAME]."
        ]
    sequences = {
        name: {
            key: si_number(value, "s") if key == "begin" else value
            for key, value in sequence.items()
        }
        for name, sequence in sequences.items()
    }
    near = Suggestions(name for name in parts.names["event"] if isinstance(name, str))
    errors = [
        f"{parts.source}, [sequence.{cut(str(name))}]: {text}"
        for name, sequence in sequences.items()
        for text in _sequence_errors(parts, near, name, sequence)
    ]
    if errors:
        return {}, errors
    return {
        name: {
            "events": list(sequence["events"]),
            "begin": float(sequence.get("begin", 0.0)),
        }
        for name, sequence in sequences.items()
    }, []


def _sequence_errors(
    parts: Parts, near: Suggestions, name: str, sequence: dict[str, Any]
) -> list[str]:
    """Check one sequence."""
    events = sequence.get("events")
    begin = sequence.get("begin", 0.0)
    index_of = {
        event: i
        for i, event in enumerate(parts.names["event"])
        if isinstance(event, str)
    }
    texts = [
        f"unknown key {shown(key)}.{suggestion(key, _KEYS)}"
        for key in sequence
        if key not in _KEYS
    ]
    if name in index_of:
        texts.append("an event has the same name. Rename one of them.")
    if not (number_like(begin) and 0.0 <= float(begin) < 1e60):
        texts.append(f"begin is {shown(begin)}, must be at least 0 s. Correct it.")
    if not isinstance(events, list | tuple) or not events:
        return [*texts, "events must be a list of names of events. Name one at least."]
    for event in events:
        if not (isinstance(event, str) and event in index_of):
            # Where not all could be read it may be among the others.
            if parts.complete or not isinstance(event, str):
                texts.append(f"there is no event {shown(event)}.{near(event)}")
        elif events.count(event) > 1:
            texts.append(f"it names {shown(event)} twice. Name each event once.")
        elif begin and parts.tables["event"][index_of[event]].begin_deg is not None:
            texts.append(
                f"begin is in s, but {shown(event)} begins at an angle. Leave begin"
                f" out, or give {shown(event)} a begin."
            )
    return list(dict.fromkeys(texts))

"""Scenarios: named sets of values of a scene, as a coupling that is warm or worn.

``[scenario.NAME]`` holds ``"ELEMENT.FIELD" = value`` or ``ELEMENT.FIELD = value``, in the units of the scene.
"""

from __future__ import annotations

import dataclasses

from jaxhb.model.checks import shown, value_errors
from jaxhb.model.elements import TABLES, suggestion


def read_scenarios(parts, scenarios) -> tuple[dict, list[str]]:
    """Values by scenario and ``"ELEMENT.FIELD"``, and sentences on what names no number of an element."""
    if scenarios is None:
        return {}, []
    if not isinstance(scenarios, dict) or not all(isinstance(values, dict) for values in scenarios.values()):
        return {}, [f"{parts.source}: 'scenario' must hold a table for each scenario. Write [scenario.NAME]."]
    found = {name: dict(_flat(values)) for name, values in scenarios.items()}
    # Of two tables with one name the first counts; the name has its own sentence.
    places = {n: (t, i) for t in reversed(TABLES) for i, n in enumerate(parts.names[t]) if isinstance(n, str)}
    errors = [
        f"{parts.source}, [scenario.{name}]: {text}"
        for name, values in found.items()
        for key, value in values.items()
        for text in _errors(places, key, value)
    ]
    return found, errors


def _flat(values, before=""):
    """Pairs of dotted keys and values of nested tables."""
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


def _errors(places, key, value) -> list[str]:
    name, dot, field = key.rpartition(".")
    if not dot:
        return [f"{key!r} names no field. Write 'NAME.FIELD', as 'coupling.stiffness'."]
    if name not in places:
        return [f"there is no element {name!r} in {key!r}.{suggestion(name, places)}"]
    table, _ = places[name]
    fields = {f.name: f for f in dataclasses.fields(TABLES[table]) if f.metadata["kind"] == "number"}
    if field not in fields:
        return [f"a [[{table}]] as {name!r} has no number {field!r}.{suggestion(field, fields)}"]
    if isinstance(value, list):
        return [f"{key} is {shown(value)}, must be a number."]
    return [f"{name!r}: {text}" for text in value_errors(fields[field], value)]

"""The ``[tune]`` table of a scene file: the arguments of :func:`jaxhb.tune`."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxhb.design.quantities import (
    OF_DESIGN,
    QUANTITIES,
    Objective,
    Parameter,
    Penalty,
    unit_of,
)
from jaxhb.elements.sentences import SceneError, shown, suggestion
from jaxhb.elements.units import Refused, si_number
from jaxhb.elements.values import number_like
from jaxhb.train.changes import in_si
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import read_speeds

_ROWS = {"parameter": Parameter, "objective": Objective, "penalty": Penalty}
_KINDS: dict[str, type] = dict.fromkeys(
    ("steps", "starts", "seed", "harmonics", "peaks"), int
)
_KINDS |= {"tolerance": float, "rate": float, "widths": tuple}
WORDS = "optimizer", "robust"  # checked where they are used


def read_table(
    train: DriveTrain, instead: dict[str, Any] | None = None
) -> dict[str, Any]:
    """Read the arguments of :func:`jaxhb.tune` from the ``[tune]`` table of a scene,
    with the keys ``instead`` of its own.

    A SceneError tells no table, unknown or missing keys, values of the wrong kind: one
    sentence each, all at once.
    """
    table = train.tune
    title = train.topology.title
    if not table:
        raise SceneError(
            f"{title}: the scene has no [tune] table. Write [tune] with rpm,"
            " [[tune.parameter]] and [[tune.objective]]."
        )
    if not isinstance(table, dict):
        raise SceneError(
            f"{title}: 'tune' is a list of tables, must be one. Write [tune]."
        )
    table = _in_si(train, table | (instead or {}))
    faults = []
    keys = ["rpm", *WORDS, *_KINDS, *_ROWS]
    faults += [
        f"{title}, [tune]: unknown key {key!r}.{suggestion(key, keys)}"
        for key in table
        if key not in keys
    ]
    names = {
        "parameters": "parameter",
        "objective": "objective",
        "penalties": "penalty",
    }
    arguments: dict[str, Any] = {
        name: _rows(table, key, title, faults) for name, key in names.items()
    }
    arguments["rpm"] = _speeds(table.get("rpm"), title, faults)
    for key in [key for key in _KINDS if key in table]:
        faults += [
            f"{title}, [tune]: {key} {sentence}"
            for sentence in _kind_faults(table[key], _KINDS[key])
        ]
    if faults:
        raise SceneError(faults)
    return arguments | {
        key: _hashable(table[key]) for key in (*WORDS, *_KINDS) if key in table
    }


def _in_si(train: DriveTrain, table: Mapping[str, Any]) -> dict[str, Any]:
    """The table with numbers for texts with units: bounds in the unit of the parameter
    that they bound, limits in that of their quantity, speeds in rpm.
    """
    read = dict(table)
    speeds = table.get("rpm")
    if isinstance(speeds, list):
        read["rpm"] = [si_number(speed, "rpm") for speed in speeds]
    if "tolerance" in table:
        read["tolerance"] = si_number(table["tolerance"], "")
    for key, bounds in (("parameter", ("low", "high")), ("penalty", ("most", "least"))):
        rows = table.get(key)
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            continue
        read[key] = [
            row
            | {
                bound: _bound_in_si(train, row, row[bound])
                for bound in bounds
                if bound in row
            }
            for row in rows
        ]
    return read


def _bound_in_si(train: DriveTrain, row: Mapping[str, Any], value: Any) -> Any:
    """A bound of a parameter, or a limit of a quantity, in its unit."""
    name = row.get("name")
    if isinstance(name, str):
        return in_si(train.topology, {name: value})[name]
    quantity = row.get("quantity")
    if isinstance(quantity, str) and quantity in (*QUANTITIES, *OF_DESIGN):
        return si_number(value, unit_of(quantity))
    return value


def _hashable(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _rows(table: Mapping[str, Any], key: str, title: str, faults: list[str]) -> tuple:
    """Build the elements of ``[[tune.KEY]]``; sentences go to ``faults``."""
    rows = table.get(key, [])
    element_type = _ROWS[key]
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        faults.append(
            f"{title}, [tune]: {key!r} must be a list of tables. Write [[tune.{key}]]."
        )
        return ()
    fields = {field.name: field for field in dataclasses.fields(element_type)}
    elements = []
    for number, row in enumerate(rows, 1):
        head = f"{title}, [[tune.{key}]] no. {number}"
        row_faults = [
            f"{head}: unknown key {name!r}.{suggestion(name, fields)}"
            for name in row
            if name not in fields
        ]
        missing = [
            name
            for name, field in fields.items()
            if field.default is dataclasses.MISSING and name not in row
        ]
        row_faults += [f"{head}: the key {name!r} is missing." for name in missing]
        for name in [name for name in fields if name in row]:
            kind = next(
                candidate
                for candidate in (str, tuple, int, float)
                if fields[name].type in (candidate, candidate | None)
            )
            row_faults += [
                f"{head}: {name} {sentence}"
                for sentence in _kind_faults(row[name], kind)
            ]
        faults += row_faults
        if not row_faults:
            elements.append(
                element_type(**{key: _hashable(value) for key, value in row.items()})
            )
    return tuple(elements)


def _kind_faults(value: Any, kind: type) -> list[str]:
    """The sentence on a value that is not of a kind; nothing if it is."""
    is_of_kind, words = {
        str: (isinstance(value, str), "a text"),
        float: (number_like(value), "a number"),
        int: (isinstance(value, int) and number_like(value), "a whole number"),
        tuple: (
            isinstance(value, list) and all(map(number_like, value)),
            "a list of numbers",
        ),
    }[kind]
    if isinstance(value, Refused):
        return [f"is {shown(value)}, {value.why}"]
    return [] if is_of_kind else [f"is {shown(value)}, must be {words}."]


def _speeds(speeds: Any, title: str, faults: list[str]) -> np.ndarray:
    """Read speeds in rpm ``(n,)`` from ``"A:B:COUNT"`` or a list of numbers."""
    if isinstance(speeds, list) and speeds and not _kind_faults(speeds, tuple):
        return np.array(speeds, dtype=float)
    if isinstance(speeds, str):
        try:
            return np.array(read_speeds(speeds))
        except ValueError as error:
            complaint = f"is {speeds!r}: {error}; it"
    else:
        complaint = "is missing," if speeds is None else f"is {shown(speeds)},"
    faults.append(
        f'{title}, [tune]: rpm {complaint} must be "A:B:COUNT", as "600:2600:41", or a'
        " list of speeds in rpm."
    )
    return np.ones(1)

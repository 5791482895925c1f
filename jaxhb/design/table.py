"""The ``[tune]`` table of a scene file: what :func:`jaxhb.tune` is asked."""

import dataclasses

import numpy as np

from jaxhb.design.quantities import Objective, Parameter, Penalty
from jaxhb.elements.elements import SceneError, shown, suggestion
from jaxhb.elements.value_checks import number_like
from jaxhb.train.speeds import read_speeds

_ROWS = {"parameter": Parameter, "objective": Objective, "penalty": Penalty}
_KINDS: dict[str, type] = dict.fromkeys(
    ("steps", "starts", "seed", "harmonics", "peaks"), int
)
WORDS = "optimizer", "robust"  # checked where they are used
_KINDS |= {"tolerance": float, "rate": float, "widths": tuple}


def read_table(train, instead=None):
    """The arguments of :func:`jaxhb.tune` from the ``[tune]`` table of a scene, with
    the keys ``instead`` of its own.

    A SceneError tells no table, unknown or missing keys, values of the wrong kind: one
    sentence each, all at once.
    """
    table = train.tune
    where = train.topology.title
    if not table:
        raise SceneError(
            f"{where}: the scene has no [tune] table. Write [tune] with rpm,"
            " [[tune.parameter]] and [[tune.objective]]."
        )
    if not isinstance(table, dict):
        raise SceneError(
            f"{where}: 'tune' is a list of tables, must be one. Write [tune]."
        )
    table = table | (instead or {})
    faults = []
    known = ["rpm", *WORDS, *_KINDS, *_ROWS]
    faults += [
        f"{where}, [tune]: unknown key {k!r}.{suggestion(k, known)}"
        for k in table
        if k not in known
    ]
    names = {
        "parameters": "parameter",
        "objective": "objective",
        "penalties": "penalty",
    }
    asked = {name: _rows(table, key, where, faults) for name, key in names.items()}
    asked["rpm"] = _speeds(table.get("rpm"), where, faults)
    for key in [key for key in _KINDS if key in table]:
        faults += [
            f"{where}, [tune]: {key} {text}"
            for text in _kind_faults(table[key], _KINDS[key])
        ]
    if faults:
        raise SceneError(faults)
    return asked | {
        key: _hashable(table[key]) for key in (*WORDS, *_KINDS) if key in table
    }


def _hashable(value):
    return tuple(value) if isinstance(value, list) else value


def _rows(table, key, where, faults):
    """Elements of ``[[tune.KEY]]``; sentences go to ``faults``."""
    rows = table.get(key, [])
    cls = _ROWS[key]
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        faults.append(
            f"{where}, [tune]: {key!r} must be a list of tables. Write [[tune.{key}]]."
        )
        return ()
    fields = {f.name: f for f in dataclasses.fields(cls)}
    elements = []
    for number, row in enumerate(rows, 1):
        head = f"{where}, [[tune.{key}]] no. {number}"
        found = [
            f"{head}: unknown key {k!r}.{suggestion(k, fields)}"
            for k in row
            if k not in fields
        ]
        missing = [
            n
            for n, f in fields.items()
            if f.default is dataclasses.MISSING and n not in row
        ]
        found += [f"{head}: the key {name!r} is missing." for name in missing]
        for name in [name for name in fields if name in row]:
            kind = next(
                one
                for one in (str, tuple, int, float)
                if fields[name].type in (one, one | None)
            )
            found += [
                f"{head}: {name} {text}" for text in _kind_faults(row[name], kind)
            ]
        faults += found
        if not found:
            elements.append(
                cls(**{key: _hashable(value) for key, value in row.items()})
            )
    return tuple(elements)


def _kind_faults(value, kind):
    """What is wrong with a value that should be of a kind; nothing if it is."""
    good, words = {
        str: (isinstance(value, str), "a text"),
        float: (number_like(value), "a number"),
        int: (isinstance(value, int) and number_like(value), "a whole number"),
        tuple: (
            isinstance(value, list) and all(map(number_like, value)),
            "a list of numbers",
        ),
    }[kind]
    return [] if good else [f"is {shown(value)}, must be {words}."]


def _speeds(given, where, faults):
    """Speeds in rpm ``(n,)`` from ``"A:B:COUNT"`` or a list of numbers."""
    if isinstance(given, list) and given and not _kind_faults(given, tuple):
        return np.array(given, dtype=float)
    if isinstance(given, str):
        try:
            return np.array(read_speeds(given))
        except ValueError as error:
            text = f"is {given!r}: {error}; it"
    else:
        text = "is missing," if given is None else f"is {shown(given)},"
    faults.append(
        f'{where}, [tune]: rpm {text} must be "A:B:COUNT", as "600:2600:41", or a list'
        " of speeds in rpm."
    )
    return np.ones(1)

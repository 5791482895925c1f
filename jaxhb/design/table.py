"""The ``[tune]`` table of a scene file: what :func:`jaxhb.tune` is asked."""

import dataclasses

import numpy as np

from jaxhb.design.quantities import Objective, Parameter, Penalty
from jaxhb.elements.elements import SceneError, suggestion
from jaxhb.elements.value_checks import number_like, shown
from jaxhb.train.speeds import read_speeds

_ROWS = {"parameter": Parameter, "objective": Objective, "penalty": Penalty}
_NUMBERS = {"steps": int, "starts": int, "seed": int, "harmonics": int, "peaks": int, "tolerance": float, "rate": float}
_OWN = ("rpm", "optimizer", "widths")


def read_table(train, instead=None):
    """The arguments of :func:`jaxhb.tune` from the ``[tune]`` table of a scene.

    Parameters
    ----------
    train : DriveTrain
    instead : dict, optional
        Keys of the table with the values that replace its own.

    Returns
    -------
    dict
        ``parameters``, ``objective``, ``penalties``, ``rpm``, and what else the table gives.

    Raises
    ------
    SceneError
        No table, unknown or missing keys, values of the wrong kind: one sentence each, all at once.

    Examples
    --------
    >>> import jaxhb
    >>> asked = read_table(jaxhb.load_scene("engine_with_damper"))
    >>> asked["parameters"][0].name, len(asked["rpm"])
    ('viscous damper.damping', 41)
    """
    table, where = train.tune, train.topology.title
    if not table:
        raise SceneError(
            f"{where}: the scene has no [tune] table. Write [tune] with rpm, [[tune.parameter]] and [[tune.objective]]."
        )
    if not isinstance(table, dict):
        raise SceneError(f"{where}: 'tune' is a list of tables, must be one. Write [tune].")
    table, faults = table | (instead or {}), []
    known = [*_OWN, *_NUMBERS, *_ROWS]
    faults += [f"{where}, [tune]: unknown key {k!r}.{suggestion(k, known)}" for k in table if k not in known]
    asked = {
        "parameters": _rows(table, "parameter", where, faults),
        "objective": _rows(table, "objective", where, faults),
        "penalties": _rows(table, "penalty", where, faults),
    }
    asked["rpm"] = _speeds(table.get("rpm"), where, faults)
    for key, kind in _NUMBERS.items():
        if key in table:
            faults += [f"{where}, [tune]: {key} {text}" for text in _kind_faults(table[key], kind)]
            asked[key] = table[key]
    if "widths" in table:
        faults += [f"{where}, [tune]: widths {text}" for text in _kind_faults(table["widths"], tuple)]
        asked["widths"] = tuple(table["widths"]) if isinstance(table["widths"], list) else ()
    if "optimizer" in table:
        asked["optimizer"] = table["optimizer"]
    if faults:
        raise SceneError(faults)
    return asked


def _rows(table, key, where, faults):
    """Elements of ``[[tune.KEY]]``; sentences go to ``faults``."""
    rows, cls = table.get(key, []), _ROWS[key]
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        faults.append(f"{where}, [tune]: {key!r} must be a list of tables. Write [[tune.{key}]].")
        return ()
    fields = {f.name: f for f in dataclasses.fields(cls)}
    elements = []
    for i, row in enumerate(rows):
        head = f"{where}, [[tune.{key}]] no. {i + 1}"
        found = [f"{head}: unknown key {k!r}.{suggestion(k, fields)}" for k in row if k not in fields]
        missing = [n for n, f in fields.items() if f.default is dataclasses.MISSING and n not in row]
        found += [f"{head}: the key {name!r} is missing." for name in missing]
        for name in fields.keys() & row.keys():
            found += [f"{head}: {name} {text}" for text in _kind_faults(row[name], _kind(fields[name].type))]
        faults += found
        if not found:
            elements.append(cls(**{k: tuple(v) if isinstance(v, list) else v for k, v in row.items()}))
    return tuple(elements)


def _kind(annotation):
    kinds = (str, tuple, int, float)
    return next(kind for kind in kinds if annotation in (kind, kind | None))


def _kind_faults(value, kind):
    """What is wrong with a value that should be of a kind; nothing if it is."""
    good = {
        str: isinstance(value, str),
        float: number_like(value),
        int: isinstance(value, int) and number_like(value),
        tuple: isinstance(value, list) and all(number_like(v) for v in value),
    }
    words = {str: "a text", float: "a number", int: "a whole number", tuple: "a list of numbers"}
    return [] if good[kind] else [f"is {shown(value)}, must be {words[kind]}."]


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
    faults.append(f'{where}, [tune]: rpm {text} must be "A:B:COUNT", as "600:2600:41", or a list of speeds in rpm.')
    return np.ones(1)

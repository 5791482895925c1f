"""A scene file with some numbers changed, written anew as TOML."""

import math
from pathlib import Path

from .elements import SceneError
from .scene import _find, _parse
from .tables import FRIDMAN_EPSILON, FRIDMAN_TRANSITION

_CSV = ("harmonics", "gas_torque", "scale", "pressure", "over_hz", "over_amplitude")


def changed_scene(name, values, *, remark=""):
    """The text of a scene with some numbers changed, and the tables that lie beside it.

    Parameters
    ----------
    name : str or path
        Packaged scene, or the path of a ``.toml``.
    values : dict
        ``{(table, number of the row in its table, field): value}``.
    remark : str
        Lines of comment at the head.

    Returns
    -------
    text : str
        TOML; comments of the original are not kept.
    beside : dict
        ``{file name: Path}`` of the CSV files that the scene names, which belong beside it.

    Examples
    --------
    >>> text, beside = changed_scene("spur_pair", {("disk", 0, "inertia"): 0.25})
    >>> text.splitlines()[6:9], sorted(beside)
    (['[[disk]]', 'name = "gear a"', 'inertia = 0.25'], ['spur_pair_omega_squared.csv'])
    """
    path = _find(name)
    content = _parse(path)
    for (table, row, field), value in values.items():
        numbers = content[table][row]
        if table == "mesh" and field in ("epsilon", "transition") and numbers.pop("law", ""):
            numbers |= {"epsilon": FRIDMAN_EPSILON, "transition": FRIDMAN_TRANSITION}
        numbers[field] = value
    named = [row.get(key) for rows in content.values() if isinstance(rows, list) for row in rows for key in _CSV]
    beside = {file: path.parent / file for file in named if isinstance(file, str)}
    lines = [f"# {line}" for line in remark.splitlines()]
    for table, rows in content.items():
        lines += _table(table, rows)
    return "\n".join(lines).lstrip("\n") + "\n", beside


def copies_beside(beside, folder):
    """``{path: bytes}`` of the CSV files that must be copied into ``folder``.

    Raises
    ------
    SceneError
        If another file of that name lies there.
    """
    found = {}
    for name, source in beside.items():
        target = Path(folder) / name
        content = source.read_bytes()
        if not target.exists():
            found[str(target)] = content
        elif target.read_bytes() != content:
            raise SceneError(
                f"{str(target)!r} is another file than {name!r} of the scene, which must lie beside the tuned one: "
                "give --output in another folder."
            )
    return found


def _table(name, rows):
    """Lines of a table, of a list of tables, and of the tables inside it."""
    if isinstance(rows, list):
        return [line for row in rows for line in _one(f"[[{name}]]", name, row)]
    return _one(f"[{name}]", name, rows)


def _one(head, name, row):
    inner = {k: v for k, v in row.items() if isinstance(v, dict) or _is_tables(v)}
    lines = ["", head, *(f"{_key(k)} = {_value(v)}" for k, v in row.items() if k not in inner)]
    for key, rows in inner.items():
        lines += _table(f"{name}.{_key(key)}", rows)
    return lines


def _is_tables(value):
    return isinstance(value, list) and bool(value) and all(isinstance(v, dict) for v in value)


def _key(key):
    return key if key.replace("_", "").replace("-", "").isalnum() and key.isascii() else _value(key)


def _value(value):
    """A TOML value; numbers in full precision."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in escaped) + '"'
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, float) and math.isfinite(value):
        return repr(float(value))
    return str(value)

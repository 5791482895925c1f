"""Scenes as TOML: of any file that can be read, with some numbers changed, with its engines expanded, of elements."""

import dataclasses
import math
from pathlib import Path

from .elements import SceneError, table_of
from .engine import cylinder_rows
from .scene import _find, _parse, load_scene
from .tables import FRIDMAN_EPSILON, FRIDMAN_TRANSITION

_CSV = ("harmonics", "gas_torque", "scale", "load", "pressure", "over_hz", "over_amplitude")


def scene_text(name, *, expand=False):
    """The text of a scene, and the tables that lie beside it.

    Parameters
    ----------
    name : str or path
        Packaged scene, or a path as for :func:`jaxhb.load_scene`.
    expand : bool
        Write the ``[[cylinder]]`` entries that an ``[engine]`` makes in its place.

    Returns
    -------
    text : str
        TOML; comments of the original are not kept. It loads to the same train.
    beside : dict
        ``{file name: Path}`` of the CSV files that the scene names, which belong beside it.

    Raises
    ------
    SceneError
        Everything that is wrong with the scene.

    Examples
    --------
    >>> text, beside = scene_text("spur_pair")
    >>> text.splitlines()[6:8], sorted(beside)
    (['[[disk]]', 'name = "gear a"'], ['spur_pair_omega_squared.csv'])
    """
    load_scene(name)
    path = _find(name)
    content = _parse(path, [])
    content = {"scene": None} | content | {"scene": {"name": path.stem} | content.get("scene", {})}
    return _text(_expanded(content) if expand else content), _beside(content, path.parent)


def elements_text(elements, *, name="", reference=None, revolutions_per_cycle=2, rated_rpm=None, tune=None):
    """The text of a scene of elements; arguments as for :func:`jaxhb.build`.

    Returns
    -------
    str
        TOML, which loads to the train that :func:`jaxhb.build` makes of the elements.

    Examples
    --------
    >>> from jaxhb.model.elements import Disk
    >>> print(elements_text([Disk(name="rotor", inertia=2.0)], name="one"))
    [scene]
    name = "one"
    revolutions_per_cycle = 2
    <BLANKLINE>
    [[disk]]
    name = "rotor"
    inertia = 2.0
    <BLANKLINE>
    """
    head = {"name": name, "reference": reference, "revolutions_per_cycle": revolutions_per_cycle}
    head["rated_rpm"] = rated_rpm
    content = {"scene": {key: value for key, value in head.items() if value is not None}}
    for element in elements:
        content.setdefault(table_of(element), []).append(_given(element))
    return _text(content | ({"tune": tune} if tune else {}))


def _given(element):
    """The fields of an element that are not at their defaults, as TOML takes them."""
    values = {f.name: getattr(element, f.name) for f in dataclasses.fields(element)}
    defaults = {f.name: f.default for f in dataclasses.fields(element)}
    return {key: _plain(value) for key, value in values.items() if not _same(value, defaults[key])}


def _same(value, default):
    return value is default or (not hasattr(value, "shape") and value == default)


def _plain(value):
    """Lists and numbers of Python; a table inside an element as a dictionary."""
    if dataclasses.is_dataclass(value):
        return _given(value)
    value = value.tolist() if hasattr(value, "tolist") else value
    return [_plain(v) for v in value] if isinstance(value, tuple | list) else value


def _expanded(content):
    """The content with the cylinders of its engines behind those it has."""
    engines = content.get("engine", [])
    made = [row for engine in ([engines] if isinstance(engines, dict) else engines) for row in cylinder_rows(engine)]
    rest = {table: rows for table, rows in content.items() if table not in ("engine", "cylinder", "tune")}
    cylinders = {"cylinder": [*content.get("cylinder", []), *made]} if made or "cylinder" in content else {}
    return rest | cylinders | {key: content[key] for key in ("tune",) if key in content}


def _beside(content, folder):
    """Files that rows of a scene name, in tables and in tables inside them."""
    found = {}
    for table, rows in content.items():
        inner = [] if table in ("scene", "tune") else list(rows) if isinstance(rows, list) else [rows]
        while inner:
            row = inner.pop()
            if not isinstance(row, dict):
                continue
            found |= {row[key]: folder / row[key] for key in _CSV if isinstance(row.get(key), str)}
            for value in row.values():
                inner += [v for v in (value if isinstance(value, list) else [value]) if isinstance(v, dict)]
    return found


def scene_files(name):
    """Paths of the files that a scene is read from: itself and the tables it names."""
    path = _find(name)
    return [path, *(table for table in _beside(_parse(path, []), path.parent).values() if table.is_file())]


def changed_scene(name, values, *, remark=""):
    """The text of a scene with some numbers changed, and the tables that lie beside it.

    Parameters
    ----------
    name : str or path
        Packaged scene, or the path of a ``.toml``.
    values : dict
        ``{(table, number of the row in its table, field): value}``; an engine whose cylinder changes is expanded.
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
    content = _parse(path, [])
    if any(table == "cylinder" for table, _, _ in values):
        content = _expanded(content)
    for (table, row, field), value in values.items():
        numbers = content[table][row]
        outer, _, field = field.rpartition(".")
        numbers = numbers[outer] if outer else numbers
        if table == "mesh" and field in ("epsilon", "transition") and numbers.pop("law", ""):
            numbers |= {"epsilon": FRIDMAN_EPSILON, "transition": FRIDMAN_TRANSITION}
        numbers[field] = value
    return _text(content, remark), _beside(content, path.parent)


def _text(content, remark=""):
    """TOML of the tables of a scene."""
    lines = [f"# {line}" for line in remark.splitlines()]
    for table, rows in content.items():
        lines += _table(table, rows)
    return "\n".join(lines).lstrip("\n") + "\n"


def copies_beside(beside, folder, option="--output"):
    """``{path: bytes}`` of the CSV files that must be copied into ``folder``, which ``option`` names.

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
                f"{str(target)!r} is another file than {name!r} of the scene, which must lie beside the "
                f"{'tuned' if option == '--output' else 'written'} one: give {option} in another folder."
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
    if inner and len(lines) == 2 and not head.startswith("[["):
        lines = []  # the heads of the tables inside say as much
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
    if isinstance(value, tuple | list):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, float) and math.isfinite(value):
        return repr(float(value))
    return str(value)

"""Scenes as TOML: of any file that can be read, with some numbers changed, with its
engines expanded, of elements.

What a ``.toml`` says is kept as it was written, comments included, but for what
changes.
"""

import dataclasses
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jaxhb.elements.checks import Parts
from jaxhb.elements.elements import TABLES, SceneError, table_of
from jaxhb.elements.engine import Engine, cylinder_rows
from jaxhb.scene.files import (
    _READERS,
    BESIDE,
    _find,
    _parse,
    _read_elements,
    load_scene,
)
from jaxhb.scene.input_files import is_beside, read_bytes
from jaxhb.scene.toml_text import TomlText
from jaxhb.train.tables import LAW_OF_FRIDMAN


def _keys_of_rows(cls: type) -> Iterator[str]:
    """Keys of a table, and of tables inside it, whose rows may stand in a file."""
    for field in dataclasses.fields(cls):
        if field.metadata.get("kind") == "rows":
            yield field.name
        if "of" in field.metadata:
            yield from _keys_of_rows(field.metadata["of"])


_CSV = tuple(
    dict.fromkeys(
        key for cls in (*TABLES.values(), Engine) for key in _keys_of_rows(cls)
    )
)


def scene_text(
    name: str | Path, *, expand: bool = False, called: str | None = None
) -> tuple[str, dict[str, Path]]:
    """The text of a scene, and the tables that lie beside it.

    ``name`` as in :func:`jaxhb.load_scene`, ``called`` another name for the scene;
    ``expand`` writes the ``[[cylinder]]`` entries that an ``[engine]`` makes in its
    place. The text is TOML with the comments and the order of a ``.toml``, and loads to
    the same train; beside it come ``{file name: Path}`` of the CSV files that the scene
    names. :class:`SceneError` tells everything that is wrong with the scene.

    >>> text, beside = scene_text("spur_pair")
    >>> text.splitlines()[4:6], sorted(beside)
    (['[scene]', 'name = "spur_pair"'], ['spur_pair_omega_squared.csv'])
    """
    # For its errors: what does not load is not written.
    load_scene(name)
    path = _find(name)
    content = _parse(path, [])
    text = _text_of(path, content)
    if expand:
        _expand(text, content)
    head = content.get("scene")
    if head is None:
        text.insert_behind(
            0, "scene", {"name": called or path.stem}
        )  # before all heads
    elif called or "name" not in head:
        text.set("scene", 0, "name", called or path.stem)
    return str(text), _beside(content, path.parent)


def elements_text(
    elements: Iterable[Any],
    *,
    name: str = "",
    reference: str | None = None,
    revolutions_per_cycle: float = 2,
    rated_rpm: float | None = None,
    tune: dict[str, Any] | None = None,
    tolerance: dict[str, Any] | None = None,
) -> str:
    """TOML that loads to the train that :func:`jaxhb.build` makes of the elements;
    arguments as there.

    >>> print(
    ...     elements_text(
    ...         [jaxhb.Disk(name="rotor", inertia=2.0)], name="one"
    ...     ).splitlines()[:2]
    ... )
    ['[scene]', 'name = "one"']
    """
    head = {
        "name": name,
        "reference": reference,
        "revolutions_per_cycle": revolutions_per_cycle,
        "rated_rpm": rated_rpm,
    }
    content: dict[str, Any] = {
        "scene": {key: value for key, value in head.items() if value is not None}
    }
    for element in elements:
        content.setdefault(table_of(element), []).append(_given(element))
    beside = {"tune": tune, "tolerance": tolerance}
    return str(
        TomlText.of(content | {key: table for key, table in beside.items() if table})
    )


def _given(element):
    """The fields of an element that are not at their defaults, as TOML takes them."""
    both = [(f, getattr(element, f.name)) for f in dataclasses.fields(element)]
    # An array equals no default, and has no one truth value.
    return {
        f.name: _plain(v)
        for f, v in both
        if v is not f.default and (hasattr(v, "shape") or v != f.default)
    }


def _plain(value):
    """Lists and numbers of Python; a table inside an element as a dictionary."""
    if dataclasses.is_dataclass(value):
        return _given(value)
    value = value.tolist() if hasattr(value, "tolist") else value
    return [_plain(v) for v in value] if isinstance(value, tuple | list) else value


def _text_of(path, content):
    """The text of a file, of other programs that of what was read."""
    # Bytes: text mode would turn the line ends of Windows.
    return (
        TomlText.of(content)
        if path.suffix in _READERS
        else TomlText(read_bytes(path).decode("utf-8-sig"))
    )


def _expand(text, content):
    """Put the cylinders of engines behind those of the scene, or where the first engine
    is.
    """
    made = _made(content)
    if made and content.get("cylinder"):
        text.append("cylinder", made)
        text.replace("engine", "cylinder", [])
    elif made:
        text.replace("engine", "cylinder", made)


def _made(content):
    """Rows of the cylinders that the engines of a scene make."""
    engines = content.get("engine", [])
    return [
        row
        for engine in ([engines] if isinstance(engines, dict) else engines)
        for row in cylinder_rows(engine)
    ]


def _beside(content, folder):
    """Files that rows of a scene name, in tables and in tables inside them."""
    found = {}

    def walk(row):
        found.update({name: folder / name for name in _named(row).values()})
        for value in row.values():
            for inner in value if isinstance(value, list) else [value]:
                if isinstance(inner, dict):
                    walk(inner)

    walk({table: rows for table, rows in content.items() if table not in BESIDE})
    return found


def element_files(name):
    """Files that the torques and the cylinders of a scene take their rows from,
    ``{field: file names}`` of each.
    """
    content = _parse(_find(name), [])
    rows = {
        "torque": content.get("torque", []),
        "cylinder": [*content.get("cylinder", []), *_made(content)],
    }
    found = {table: [_named(row) for row in own] for table, own in rows.items()}
    for row, files in zip(rows["cylinder"], found["cylinder"], strict=True):
        of_traces = [
            name for trace in row.get("traces", ()) for name in _named(trace).values()
        ]
        files |= {"traces": ", ".join(of_traces)} if of_traces else {}
    return found


def _named(row):
    """Files that a row names in place of its lists."""
    return {key: row[key] for key in _CSV if isinstance(row.get(key), str)}


def scene_files(name):
    """Paths of the files that a scene is read from: itself and the tables it names."""
    path = _find(name)
    return [
        path,
        *(
            table
            for table in _beside(_parse(path, []), path.parent).values()
            if table.is_file()
        ),
    ]


def changed_scene(name, values, *, tolerances=None, remark=""):
    """The text of a scene with some numbers changed, and the tables beside it, as of
    :func:`scene_text`.

    ``values`` : ``{(table, number of the row in its table, field): value}``; an engine
    whose cylinder changes is expanded. ``tolerances`` : entries of ``[tolerance]``,
    ``{"NAME.FIELD": {"std": value}}``, in the place of those there; ``remark`` : lines
    of comment at the head.
    """
    path = _find(name)
    content = _parse(path, [])
    text = _text_of(path, content)
    if any(table == "cylinder" for table, _, _ in values):
        _expand(text, content)
    for row in {
        row
        for table, row, field in values
        if table == "mesh" and field in ("stiffness", "stiffness_orders")
    }:
        # Shorthands exclude what they stand for, which is written out.
        if [
            key
            for key in ("stiffness_table", "width", "contact_ratio", "helix")
            if text.discard("mesh", row, key)
        ]:
            train = load_scene(name)
            text.set("mesh", row, "stiffness", float(train.meshes.stiffness[row]))
            listed = train.topology.mesh_stiffness_orders[row]
            periods = train.topology.mesh_periods[row]
            if listed:
                numbers = train.meshes.stiffness_orders[row, : len(listed)].tolist()
                orders = [
                    [n / periods, *pair]
                    for n, pair in zip(listed, numbers, strict=True)
                ]
                text.set("mesh", row, "stiffness_orders", orders)
    for (table, row, field), value in values.items():
        # A law excludes numbers of its own: it is written out as the two that it stands
        # for.
        if (
            table == "mesh"
            and field in LAW_OF_FRIDMAN
            and text.discard(table, row, "law")
        ):
            for key, number in LAW_OF_FRIDMAN.items():
                text.set(table, row, key, number)
        text.set(table, row, field, value)
    if tolerances:
        text.merge("tolerance", tolerances)
    remark = "".join(f"# {line}{text.newline}" for line in remark.splitlines())
    return remark + text.newline * bool(remark) + str(text), _beside(
        content, path.parent
    )


def elements_of(name, values=()):
    """The elements of a scene by name, engines as cylinders, with ``values`` as of
    :func:`changed_scene`.
    """
    path = _find(name)
    elements, _ = _read_elements(
        path, tomllib.loads(changed_scene(name, dict(values))[0]), []
    )
    parts = Parts(elements, path.name)
    return {parts.names[kind][i]: element for kind, i, element in parts.rows()}


@dataclass(frozen=True)
class Copies:
    """Tables to write into the folder of a scene that is written.

    Parameters
    ----------
    files : ``{path: bytes}`` of tables that are not there yet
    names : ``{name in the scene: name beside the scene that is written}`` of tables
    that would lie outside its folder
    """

    files: dict[str, bytes]
    names: dict[str, str]

    def renamed(self, text: str) -> str:
        """The text of a scene with the names that its tables have there."""
        if not self.names:
            return text
        changed = TomlText(text)
        changed.rename(_CSV, self.names)
        return str(changed)


def copies_beside(
    beside: dict[str, Path], folder: str | Path, option: str = "--output"
) -> Copies:
    """:class:`Copies` of the CSV files ``beside`` a scene in ``folder``, which
    ``option`` names.

    None is written over another file or outside of the folder: a table of a name as
    ``../x.csv`` becomes ``x.csv``, unless its name leads to it from there, too.
    """
    files = {}
    names = {}
    sources = {}
    for name, source in beside.items():
        if _leads_to(Path(folder) / name, source):
            continue
        copied = name
        if not is_beside(Path(folder) / name, Path(folder)):
            copied = names[name] = _free_name(Path(name), source, sources)
        sources[copied] = source
        target = Path(folder) / copied
        content = read_bytes(source)
        if not target.exists():
            files[str(target)] = content
        elif not (target.is_file() and read_bytes(target) == content):
            raise SceneError(
                f"{str(target)!r} is another file than {name!r} of the scene, which"
                f" must lie beside the {'tuned' if option == '--output' else 'written'}"
                f" one: give {option} in another folder."
            )
    return Copies(files, names)


def _leads_to(path: Path, source: Path) -> bool:
    """Whether a path is that of a file that is there."""
    try:
        return path.samefile(source)
    except OSError:
        return False


def _free_name(path: Path, source: Path, sources: dict[str, Path]) -> str:
    """The name of a file without its folders, numbered where another source has it
    already.
    """
    name = path.name
    number = 1
    while name in sources and not _leads_to(sources[name], source):
        number += 1
        name = f"{path.stem} {number}{path.suffix}"
    return name

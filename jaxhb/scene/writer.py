"""Scenes as TOML: of any file that can be read, with some numbers changed, with its
engines expanded, of elements.

A ``.toml`` stays as it was written, comments included, except where it changes.
"""

import dataclasses
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jaxhb.elements.checks import Parts
from jaxhb.elements.declared import table_of
from jaxhb.elements.derived import temperature_factors
from jaxhb.elements.elements import TABLES
from jaxhb.elements.engine import Engine, cylinder_rows
from jaxhb.elements.sentences import SceneError
from jaxhb.scene.files import (
    BESIDE,
    READ,
    RULE_FILE,
    _read_elements,
    find_scene,
    load_scene,
    parse,
    si_keys,
)
from jaxhb.scene.input_files import is_beside, read_bytes
from jaxhb.scene.parts import is_shared, part_files, with_parts
from jaxhb.scene.toml_text import TomlText
from jaxhb.train.tables import LAW_OF_FRIDMAN

Values = Mapping[tuple[str, int, str], Any]
"""Values of a scene by (table, number of the row in its table, field)."""


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
    """Write the text of a scene, and find the tables that lie beside it.

    ``name`` is that of :func:`jaxhb.load_scene`, ``called`` another name for the scene;
    ``expand`` writes the ``[[cylinder]]`` entries that an ``[engine]`` makes in its
    place, and the keys of catalogue parts in the place of their names. The text is TOML
    with the comments and the order of a ``.toml``, and loads to the same train; with it
    comes ``{file name: Path}`` of the CSV files and the files of parts that the scene
    names. :class:`SceneError` names all faults of the scene.

    >>> text, beside = scene_text("spur_pair")
    >>> text.splitlines()[4:6], sorted(beside)
    (['[scene]', 'name = "spur_pair"'], ['spur_pair_omega_squared.csv'])
    """
    # For its errors: a scene that does not load is not written.
    load_scene(name)
    path = find_scene(name)
    content = parse(path, [])
    text = _text_of(path, content)
    if expand:
        _expand(text, content)
        _expand_parts(text, content, path)
    head = content.get("scene")
    if head is None:
        # Before all heads
        text.insert_behind(0, "scene", {"name": called or path.stem})
    elif called or "name" not in head:
        text.set("scene", 0, "name", called or path.stem)
    return str(text), _tables_beside(content, path.parent)


def elements_text(
    elements: Iterable[Any],
    *,
    name: str = "",
    reference: str | None = None,
    revolutions_per_cycle: float = 2,
    rated_rpm: float | None = None,
    temperature: float | None = None,
    tune: dict[str, Any] | None = None,
    tolerance: dict[str, Any] | None = None,
    sequences: dict[str, dict[str, Any]] | None = None,
    rules: Sequence[str] | None = None,
    tachometer_tolerance: float | None = None,
    operating_rpm: Sequence[float] | None = None,
) -> str:
    """Write TOML that loads to the train of :func:`jaxhb.build` with the same
    arguments.

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
        "rules": _plain(rules),
        "tachometer_tolerance": tachometer_tolerance,
        "operating_rpm": _plain(operating_rpm),
        "temperature": temperature,
    }
    content: dict[str, Any] = {
        "scene": {key: value for key, value in head.items() if value is not None}
    }
    for element in elements:
        content.setdefault(table_of(element), []).append(_fields_set(element))
    if sequences:
        content["sequence"] = sequences
    if tune:
        content["tune"] = tune
    if tolerance:
        content["tolerance"] = tolerance
    return str(TomlText.of(content))


def _fields_set(element: Any) -> dict[str, Any]:
    """Fields of an element that are not at their defaults, as TOML takes them."""
    values = {}
    for field in dataclasses.fields(element):
        value = getattr(element, field.name)
        # An array equals no default, and has no truth value.
        if field.name == "part":
            continue  # its keys are written themselves
        if value is not field.default and (
            hasattr(value, "shape") or value != field.default
        ):
            values[field.name] = _plain(value)
    return values


def _plain(value: Any) -> Any:
    """Convert a value to lists and numbers of Python, and a table inside an element to
    a dictionary.
    """
    if dataclasses.is_dataclass(value):
        return _fields_set(value)
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, tuple | list):
        return [_plain(inner) for inner in value]
    return value


def _text_of(path: Path, content: Mapping[str, Any]) -> TomlText:
    """Text of a file; of a file of another program the text of its content."""
    if path.suffix in READ:
        return TomlText.of(content)
    # Bytes: text mode would turn the line ends of Windows.
    return TomlText(read_bytes(path).decode("utf-8-sig"))


def _expand(text: TomlText, content: Mapping[str, Any]) -> None:
    """Put the cylinders of engines behind those of the scene, or in the place of the
    first engine.
    """
    cylinders = _engine_cylinders(content)
    if cylinders and content.get("cylinder"):
        text.append("cylinder", cylinders)
        text.replace("engine", "cylinder", [])
    elif cylinders:
        text.replace("engine", "cylinder", cylinders)


def _expand_parts(text: TomlText, content: Mapping[str, Any], path: Path) -> None:
    """Write the keys of parts into the elements that name these."""
    if "parts" not in content:
        return
    for table, rows in with_parts(content, path, []).items():
        written = content[table]
        for i, row in enumerate(rows if isinstance(rows, list) else []):
            if "part" not in row:
                continue
            text.discard(table, i, "part")
            for key in row:
                if key not in written[i]:
                    text.set(table, i, key, row[key])
    text.replace("parts", "parts", [])


def _engine_cylinders(content: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Rows of the cylinders that the engines of a scene make."""
    engines = content.get("engine", [])
    if isinstance(engines, dict):
        engines = [engines]
    return [row for engine in engines for row in cylinder_rows(si_keys(Engine, engine))]


def _tables_beside(content: Mapping[str, Any], folder: Path) -> dict[str, Path]:
    """Paths of the files of parts, of the files that rows of a scene name, in tables
    and in tables inside them, and of its files of rules, by these names.
    """
    paths = part_files(content, folder)

    def walk(row: dict[str, Any]) -> None:
        paths.update({name: folder / name for name in _files_of_row(row).values()})
        for value in row.values():
            for inner in value if isinstance(value, list) else [value]:
                if isinstance(inner, dict):
                    walk(inner)

    walk({table: rows for table, rows in content.items() if table not in BESIDE})
    head = content.get("scene")
    rules = head.get("rules", ()) if isinstance(head, dict) else ()
    paths.update({rule: folder / rule for rule in rules if rule.endswith(RULE_FILE)})
    return paths


def element_files(name: str | Path) -> dict[str, list[dict[str, str]]]:
    """Files from which the torques and the cylinders of a scene take their rows, of
    each by field.
    """
    content = parse(find_scene(name), [])
    rows = {
        "torque": content.get("torque", []),
        "cylinder": [*content.get("cylinder", []), *_engine_cylinders(content)],
    }
    files = {
        table: [_files_of_row(row) for row in table_rows]
        for table, table_rows in rows.items()
    }
    for row, row_files in zip(rows["cylinder"], files["cylinder"], strict=True):
        trace_files = [
            file
            for trace in row.get("traces", ())
            for file in _files_of_row(trace).values()
        ]
        if trace_files:
            row_files["traces"] = ", ".join(trace_files)
    return files


def _files_of_row(row: Mapping[str, Any]) -> dict[str, str]:
    """Files that a row names in place of its lists, by key."""
    return {key: row[key] for key in _CSV if isinstance(row.get(key), str)}


def scene_files(name: str | Path) -> list[Path]:
    """Paths of the files from which a scene is read: itself and the tables it names."""
    path = find_scene(name)
    tables = _tables_beside(parse(path, []), path.parent).values()
    return [path, *(table for table in tables if table.is_file())]


def changed_scene(
    name: str | Path,
    values: Values,
    *,
    tolerances: Mapping[str, Mapping[str, Any]] | None = None,
    remark: str = "",
) -> tuple[str, dict[str, Path]]:
    """Write the text of a scene with some numbers changed, and find the tables beside
    it, as :func:`scene_text` does.

    ``values`` : ``{(table, number of the row in its table, field): value}``; an engine
    whose cylinder changes is expanded. ``tolerances`` : entries of ``[tolerance]``,
    ``{"NAME.FIELD": {"std": value}}``, in the place of those there; ``remark`` : lines
    of comment at the head.
    """
    path = find_scene(name)
    content = parse(path, [])
    text = _text_of(path, content)
    if any(table == "cylinder" for table, _, _ in values):
        _expand(text, content)
    stiffened = {
        row
        for table, row, field in values
        if table == "mesh" and field in ("stiffness", "stiffness_orders")
    }
    for row in stiffened:
        # Shorthands exclude the numbers for which they stand: these are written out.
        shorthands = ("stiffness_table", "width", "contact_ratio", "helix")
        discarded = [text.discard("mesh", row, key) for key in shorthands]
        if any(discarded):
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
    rows_with_parts = with_parts(content, path, [])
    for (table, row, field), value in values.items():
        if (table, field) == ("disk", "inertia"):
            text.discard(table, row, "gd2")
        if (
            table in ("shaft", "damper")
            and field in ("stiffness", "damping", "loss_factor")
            and rows_with_parts[table][row].get("over_temperature")
        ):
            value = _at_reference(name, values, (table, row, field))
        # A law excludes the two numbers for which it stands: they are written out.
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
    comment = "".join(f"# {line}{text.newline}" for line in remark.splitlines())
    if comment:
        comment += text.newline
    return comment + str(text), _tables_beside(content, path.parent)


def _at_reference(name: str | Path, values: Values, place: tuple[str, int, str]) -> Any:
    """Value of a number of a link as a scene writes it, which is the one at which the
    factors over temperature are 1.
    """
    (table, row, field) = place
    links = load_scene(name).table(table)
    temperature = values.get((table, row, "temperature"), links.temperature[row])
    stiffer, damped = temperature_factors(links.over_temperature[row], temperature)
    return float(values[place] / (stiffer if field == "stiffness" else damped))


def elements_of(name: str | Path, values: Values | tuple[()] = ()) -> dict[str, Any]:
    """Elements of a scene by name, engines as cylinders, with ``values`` as in
    :func:`changed_scene`.
    """
    path = find_scene(name)
    text, _ = changed_scene(name, dict(values))
    elements, _ = _read_elements(path, tomllib.loads(text), [])
    parts = Parts(elements, path.name)
    return {parts.names[kind][i]: element for kind, i, element in parts.rows()}


@dataclass(frozen=True)
class Copies:
    """Tables to write into the folder of a scene.

    Parameters
    ----------
    files : ``{path: bytes}`` of tables that are not there yet
    names : ``{name in the scene: name in the folder}`` of tables that would lie outside
    it
    """

    files: dict[str, bytes]
    names: dict[str, str]

    def renamed(self, text: str) -> str:
        """Text of a scene with the names of its tables in the folder."""
        if not self.names:
            return text
        changed = TomlText(text)
        changed.rename((*_CSV, "files"), self.names)
        return str(changed)


def copies_beside(
    beside: dict[str, Path], folder: str | Path, option: str = "--output"
) -> Copies:
    """Find the :class:`Copies` of the CSV files ``beside`` a scene for ``folder``,
    which ``option`` names.

    None is written over another file or outside of the folder: a table with a name such
    as ``../x.csv`` becomes ``x.csv``, unless its name leads to it from there, too.
    Files of parts in the folder of the user are found from everywhere.
    """
    files: dict[str, bytes] = {}
    names: dict[str, str] = {}
    sources: dict[str, Path] = {}
    for name, source in beside.items():
        if is_shared(source) or _leads_to(Path(folder) / name, source):
            continue
        copied = name
        if not is_beside(Path(folder) / name, Path(folder)):
            copied = _free_name(Path(name), source, sources)
            names[name] = copied
        sources[copied] = source
        target = Path(folder) / copied
        content = read_bytes(source)
        if not target.exists():
            files[str(target)] = content
        elif not (target.is_file() and read_bytes(target) == content):
            raise SceneError(
                f"{str(target)!r} is another file than {name!r} of the scene, which"
                " must lie in the folder of the"
                f" {'tuned' if option == '--output' else 'written'} one: give"
                f" {option} in another folder."
            )
    return Copies(files, names)


def _leads_to(path: Path, source: Path) -> bool:
    """Whether a path is that of an existing file."""
    try:
        return path.samefile(source)
    except OSError:
        return False


def _free_name(path: Path, source: Path, sources: dict[str, Path]) -> str:
    """Name of a file without its folders, numbered where another source already has
    this name.
    """
    name = path.name
    number = 1
    while name in sources and not _leads_to(sources[name], source):
        number += 1
        name = f"{path.stem} {number}{path.suffix}"
    return name

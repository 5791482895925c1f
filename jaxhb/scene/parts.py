"""Catalogue parts: files of couplings, dampers, shafts and disks, whose keys elements
of a scene take by the name of the part.

``[parts] files = ["makers.toml"]`` of a scene names files beside it, or in the folder
of the user (:func:`shared_folder`). Such a file holds ``[coupling."X 3100"]``,
``[shaft.NAME]``, ``[damper.NAME]`` and ``[disk.NAME]`` with keys of that element; a
coupling is a shaft. An element with ``part = "X 3100"`` has these keys beside its own,
and its own win.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from jaxhb.elements.declared import Unread
from jaxhb.elements.elements import TABLES
from jaxhb.elements.sentences import cut, shown, suggestion
from jaxhb.elements.units import si_value
from jaxhb.elements.values import field_errors
from jaxhb.scene.input_files import Missing, Unreadable, read_text

KINDS = {"coupling": "shaft", "shaft": "shaft", "damper": "damper", "disk": "disk"}
"""Tables of a file of parts, and the tables of a scene whose elements take them."""

OF_SCENE = ("name", "between", "disk", "part")
"""Keys that say where an element stands, which a part does not know."""

_FROM_PARTS = {
    "shaft": ("stiffness",),
    "damper": ("inertia", "stiffness"),
    "disk": ("inertia",),
}
"""Keys without which an element has further sentences."""

Catalogue = dict[tuple[str, str], "Part"]
"""Parts by the table of a scene and their names."""


@dataclass(frozen=True)
class Part:
    """A part: its sound keys, those with a sentence as :class:`Unread`, and the file
    that holds it.
    """

    keys: dict[str, Any]
    file: str


def shared_folder() -> Path:
    """Folder of the user for files of parts that scenes anywhere name."""
    import platformdirs  # only scenes with parts need it

    config = platformdirs.user_config_path("jaxhb", appauthor=False)
    return config / "parts"


def is_shared(path: Path) -> bool:
    """Whether a file lies in the folder of the user."""
    return path.is_relative_to(shared_folder())


def part_files(content: Mapping[str, Any], folder: Path) -> dict[str, Path]:
    """Paths of the files of parts of a scene in ``folder``, by their names in it."""
    table = content.get("parts")
    names = table.get("files") if isinstance(table, dict) else None
    return {
        name: _path_of(name, folder)
        for name in (names if isinstance(names, list) else [])
        if isinstance(name, str)
    }


def _path_of(name: str, folder: Path) -> Path:
    """Path of a file of parts: beside the scene, else in the folder of the user."""
    shared = shared_folder() / name
    # A name with a null character is told when the file is read.
    beside = folder / name
    if "\0" in name or beside.exists() or not shared.is_file():
        return beside
    return shared


def with_parts(
    content: Mapping[str, Any], path: Path, errors: list[str]
) -> dict[str, Any]:
    """Read the content of the scene ``path`` with the keys of the parts that its
    elements name; ``part`` then holds the part and its file.

    Sentences are added to ``errors``; an element whose part is not known stays as it
    is.
    """
    file_errors: list[str] = []
    catalogue = _catalogue(content, path, file_errors)
    errors += file_errors
    part_errors: list[str] = []
    merged = dict(content)
    for table in dict.fromkeys(KINDS.values()):
        rows = content.get(table)
        if isinstance(rows, list):
            merged[table] = [
                _with_part(
                    row, (table, i), catalogue, f"{path.name}, [[{table}]]", part_errors
                )
                for i, row in enumerate(rows)
            ]
    # Of parts in a file that cannot be read nothing is known.
    if catalogue or not file_errors:
        errors += part_errors
    return merged


def _with_part(
    row: Any,
    place: tuple[str, int],
    catalogue: Catalogue,
    where: str,
    errors: list[str],
) -> Any:
    """Read a row of a table with the keys of its part, if it names one; ``place`` is
    its table and its number there.
    """
    if not isinstance(row, dict) or "part" not in row:
        return row
    (table, i) = place
    name = row["part"]
    part = catalogue.get((table, name)) if isinstance(name, str) else None
    if part is None:
        title = f" {shown(row['name'])}" if isinstance(row.get("name"), str) else ""
        names = [part_name for kind, part_name in catalogue if kind == table]
        advice = suggestion(name, names)
        if not names:
            advice = " Name its file in [parts], files = [...]."
        errors.append(
            f"{where} no. {i + 1}{title}: there is no part {shown(name)}.{advice}"
        )
        # Keys that the part may have given are no faults of their own.
        scene_keys = {key: value for key, value in row.items() if key != "part"}
        return {key: Unread() for key in _FROM_PARTS[table]} | scene_keys
    return part.keys | row | {"part": f"{name} of {part.file}"}


def _catalogue(content: Mapping[str, Any], path: Path, errors: list[str]) -> Catalogue:
    """Read the parts of all files of a scene."""
    table = content.get("parts", {"files": []})
    files = None
    if isinstance(table, dict):
        unknown = [key for key in table if key != "files"]
        errors += [
            f"{path.name}, [parts]: unknown key {shown(key)}."
            f"{suggestion(key, ['files'])}"
            for key in unknown
        ]
        files = table.get("files", [] if unknown else None)
    if not (isinstance(files, list) and all(isinstance(name, str) for name in files)):
        errors.append(
            f"{path.name}: 'parts' is {shown(table)}, must hold the names of files"
            ' alone. Write [parts] and files = ["makers.toml"].'
        )
        return {}
    catalogue: Catalogue = {}
    for name, file in part_files(content, path.parent).items():
        for key, part in _parts_of(name, file, errors).items():
            if key in catalogue:
                errors.append(
                    f"{part.file}: the part {shown(key[1])} is in"
                    f" {catalogue[key].file}, too. Rename one of them."
                )
            catalogue.setdefault(key, part)
    return catalogue


def _parts_of(name: str, file: Path, errors: list[str]) -> Catalogue:
    """Read the parts of one file."""
    try:
        tables = tomllib.loads(read_text(file))
    except Missing:
        errors.append(
            f"[parts]: there is no file {shown(name)} in the folder of the scene, nor"
            f" in {str(shared_folder())!r}. Correct the name."
        )
        return {}
    except Unreadable as error:
        errors.append(f"[parts]: {shown(name)}: {error}")
        return {}
    # An integer of many digits, lists nested too deeply
    except (ValueError, RecursionError) as error:
        reason = cut(str(error)) if isinstance(error, tomllib.TOMLDecodeError) else ""
        errors.append(
            f"[parts]: {shown(name)}: invalid TOML{f': {reason}' if reason else ''}."
            " Correct the file."
        )
        return {}
    parts: Catalogue = {}
    for table, rows in tables.items():
        if table not in KINDS:
            errors.append(
                f"{file.name}: unknown table {shown(table)}.{suggestion(table, KINDS)}"
            )
            continue
        if not isinstance(rows, dict) or not all(
            isinstance(row, dict) for row in rows.values()
        ):
            errors.append(
                f"{file.name}: {table!r} must hold a table for each part. Write"
                f" [{table}.NAME]."
            )
            continue
        for part_name, row in rows.items():
            key = KINDS[table], part_name
            where = f"{file.name}, [{table}.{shown(part_name)}]"
            if key in parts:
                errors.append(f"{where}: there are two parts of this name. Rename.")
            parts[key] = Part(_sound_keys(KINDS[table], row, where, errors), file.name)
    return parts


def _sound_keys(
    table: str, row: Mapping[str, Any], where: str, errors: list[str]
) -> dict[str, Any]:
    """Keys of a part whose faults have their sentences, the faulty ones unread."""
    allowed = {
        field.name: field
        for field in fields(TABLES[table])
        if field.name not in OF_SCENE
    }
    keys: dict[str, Any] = {}
    for key, value in row.items():
        if key not in allowed:
            errors.append(
                f"{where}: unknown key {shown(key)}.{suggestion(key, allowed)}"
            )
            continue
        # Texts with units stay as they are written: copies of the scene have them.
        number = si_value(TABLES[table], allowed[key], value)
        faults = field_errors(where, allowed[key], number)
        errors += faults or []
        keys[key] = value if faults is None else Unread()
    return keys

"""Scene files: TOML and CSV to a drive train. All faults of a file are raised together,
in sentences.

Files of other programs are read by their endings, see :mod:`jaxhb.scene.exchange`. Any
list of rows may be the name of a CSV file beside the scene, one row a line, see
:mod:`jaxhb.scene.csv_tables`.
"""

import dataclasses
import difflib
import os
import re
import tomllib
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import Any

from jaxhb.elements.declared import Unread, fields_of_class
from jaxhb.elements.elements import TABLES, TACHOMETER, Head
from jaxhb.elements.engine import Engine
from jaxhb.elements.rules.chosen import DEFAULT, File
from jaxhb.elements.sentences import SceneError, cut, shown, suggestion
from jaxhb.elements.units import UnitError, chosen_units, si_value, units_of_columns
from jaxhb.scene.csv_tables import number_rows
from jaxhb.scene.exchange import csv_content, tors_content
from jaxhb.scene.input_files import (
    Missing,
    Unreadable,
    is_beside,
    read_bytes,
    read_text,
)
from jaxhb.scene.parts import with_parts
from jaxhb.scene.title_block import TitleBlock, read_title_block
from jaxhb.scene.workbook.places import in_cells
from jaxhb.scene.workbook.reading import workbook_content
from jaxhb.train.assembly import checked
from jaxhb.train.drivetrain import DriveTrain

WORKBOOK = ".xlsx"
_OF_TEXTS = {".json": tors_content, ".csv": csv_content}
READ = (*_OF_TEXTS, WORKBOOK)
"""Endings of the files of other programs."""

_UNREADABLE = {
    # Python reads no more than 4300
    ValueError: "an integer has too many digits to be read. Write it as 1e9.",
    RecursionError: (
        "lists or tables are nested too deeply to be read. Write them flat."
    ),
}
BESIDE = (
    "scene",
    "scenario",
    "sequence",
    "tune",
    "tolerance",
    "report",
    "parts",
)  # tables that are no elements
MOST_ELEMENTS = 100_000
Tables = dict[tuple[str, tuple[str, ...]], tuple | Unread]
"""Rows of CSV files by their names and the units of their columns."""
RULE_FILE = ".toml"
"""End of the names of files among the rules of a scene."""

_SCENE_KEYS = [f.name for f in dataclasses.fields(Head)]


def scene_names() -> list[str]:
    """List the packaged scenes by their names.

    >>> "gear_train_30" in scene_names()
    True
    """
    return sorted(path.stem for path in _folder().iterdir() if path.suffix == ".toml")


def scene_description(name: str | Path) -> str:
    """Read the ``description`` in the ``[scene]`` of a packaged scene or a file, empty
    if there is none.
    """
    head = parse(find_scene(name), []).get("scene", {})
    return str(head.get("description", "")) if isinstance(head, dict) else ""


def scene_title_block(name: str | Path) -> tuple[TitleBlock, Path]:
    """Read the ``[report]`` of a packaged scene or a file, and return it with the
    folder in which its logo lies.
    """
    path = find_scene(name)
    table = parse(path, []).get("report")
    return read_title_block(table, path.name, path.parent, []), path.parent


def load_scene(name: str | Path) -> DriveTrain:
    """Read a scene.

    ``name`` is a packaged scene (:func:`scene_names`), or the path of a ``.toml`` in
    the scene format, SI units, an ``.xlsx`` with a sheet for each table, a ``.json`` in
    the TORS format of openTorsion, or a ``.csv`` with a table of inertias and a table
    of links. The train is as :func:`jaxhb.build` makes it; :class:`SceneError` names
    all faults, one sentence a line.

    >>> load_scene("gear_train_30").topology.mesh_names[0]
    'crank gear|idler'
    """
    path = find_scene(name)
    try:
        return _load(path)
    except SceneError as error:
        if path.suffix != WORKBOOK or not path.is_file():
            raise
        places = in_cells(read_bytes(path), path.name, error.sentences)
        raise SceneError(places) from None


def _load(path: Path) -> DriveTrain:
    """Read the scene of a file."""
    errors: list[str] = []
    content = parse(path, errors)
    whole = not errors
    head = content.get("scene", {})
    if not isinstance(head, dict):
        errors.append(
            f"{path.name}: 'scene' is {shown(head)}, must be a table. Write [scene]."
        )
        head = {}
    head = si_keys(Head, head)
    unknown = [key for key in head if key not in _SCENE_KEYS]
    errors += [
        f"{path.name}, [scene]: unknown key {shown(key)}.{suggestion(key, _SCENE_KEYS)}"
        for key in unknown
    ]
    read_title_block(content.get("report"), path.name, path.parent, errors)
    elements, lost = _read_elements(path, content, errors)
    return checked(
        elements,
        name=str(head.get("name", path.stem)),
        reference=head.get("reference"),
        cycle=head.get("revolutions_per_cycle", 2),
        rated_rpm=head.get("rated_rpm"),
        temperature=head.get("temperature"),
        tune=content.get("tune"),
        tolerance=content.get("tolerance"),
        report=_report_units(content.get("report"), path.name, errors),
        scenarios=content.get("scenario"),
        sequences=content.get("sequence"),
        notes=_notes(head, path.name, errors),
        rules=_rules(head, path, errors),
        tachometer_tolerance=head.get("tachometer_tolerance", TACHOMETER),
        operating_rpm=head.get("operating_rpm", ()),
        source=path.name,
        findings=errors,
        complete=whole and not lost,
        disks_read=lost.isdisjoint(("disk", "damper")),
    )


def _notes(head: dict[str, Any], source: str, errors: list[str]) -> tuple[str, ...]:
    """Read the notes of ``[scene]``."""
    notes = head.get("notes", [])
    if isinstance(notes, list) and all(isinstance(note, str) for note in notes):
        return tuple(notes)
    errors.append(
        f"{source}, [scene]: notes is {shown(notes)}, must be a list of texts."
        " Correct it."
    )
    return ()


def _report_units(table: Any, source: str, errors: list[str]) -> dict[str, str]:
    """Read the ``units`` of ``[report]``, whose other keys stand in the title block."""
    if not isinstance(table, dict):
        return {}
    units = table.get("units", {})
    if not isinstance(units, dict):
        errors.append(
            f"{source}, [report]: units is {shown(units)}, must be a table. Write"
            ' units = { torque = "kN m" }.'
        )
        return {}
    try:
        chosen_units(units)
    except UnitError as error:
        errors.append(f"{source}, [report]: {error}")
        return {}
    return units


def _rules(
    head: dict[str, Any], path: Path, errors: list[str]
) -> tuple[str | File, ...]:
    """Read the rules of ``[scene]``: names, and files beside the scene."""
    rules = head.get("rules", DEFAULT)
    if not isinstance(rules, list | tuple) or not all(
        isinstance(rule, str) for rule in rules
    ):
        errors.append(
            f"{path.name}, [scene]: rules is {shown(rules)}, must be a list of names"
            " and files. Correct it."
        )
        return DEFAULT
    try:
        return read_rules(rules, path.parent)
    except SceneError as error:
        errors += [f"{path.name}, [scene]: rules: {text}" for text in error.sentences]
        return DEFAULT


def read_rules(rules: Iterable[str], folder: Path) -> tuple[str | File, ...]:
    """Read the files among names of rules, those that end in ``.toml``;
    :class:`SceneError` where one cannot be read.
    """
    entries: list[str | File] = []
    for rule in rules:
        if not rule.endswith(RULE_FILE):
            entries.append(rule)
            continue
        try:
            entries.append(File(Path(rule).name, read_text(folder / rule)))
        except Unreadable as error:
            raise SceneError(f"{cut(rule)}: {error}") from None
    return tuple(entries)


def _folder() -> Path:
    """Folder of the packaged scenes."""
    return Path(str(resources.files("jaxhb.scene") / "scenes"))


def find_scene(name: str | Path) -> Path:
    """Path of a packaged scene or of a file."""
    text = str(name)
    if (
        isinstance(name, Path)
        or text.endswith((".toml", *READ))
        or "/" in text
        or "\\" in text
    ):
        # Where "~somebody" has no folder the text is the path.
        return Path(os.path.expanduser(text))
    if text not in scene_names():
        if os.path.lexists(text):  # its faults are found when it is read
            return Path(text)
        raise SceneError(
            "there is no packaged scene"
            f" {shown(text)}.{suggestion(text, scene_names())}"
        )
    return _folder() / f"{text}.toml"


def _correct(text: str, error: tomllib.TOMLDecodeError) -> str:
    """Advice on the line of a syntax error, in a sentence."""
    match = re.search(r"at line (\d+)", str(error))
    line = text.splitlines()[int(match[1]) - 1].strip() if match else ""
    value = line.partition("=")[2].partition("#")[0]
    comma = re.search(r"\d,\d", value) and "[" not in line
    quoted = f" {line[:60]!r}" if line else ""
    decimals = ": decimals take a point, not a comma" if comma else ""
    return f"Correct the line{quoted}{decimals}."


def parse(path: Path, errors: list[str]) -> dict[str, Any]:
    """Read a file; raise a syntax error as a sentence, and add other faults to
    ``errors``.
    """
    try:
        if path.suffix == WORKBOOK:
            return workbook_content(read_bytes(path), path.name, errors)
        text = read_text(path)
    except Missing:
        raise SceneError(
            f"{cut(str(path))}: there is no such file. Give the path of a .toml, or a"
            " packaged scene."
        ) from None
    except Unreadable as error:
        raise SceneError(f"{cut(str(path))}: {error}") from None
    try:
        if path.suffix in _OF_TEXTS:
            return _OF_TEXTS[path.suffix](text, path.name, errors)
        return tomllib.loads(text)
    except SceneError:
        raise
    except tomllib.TOMLDecodeError as error:
        raise SceneError(
            f"{path.name}: invalid TOML: {cut(str(error))}. {_correct(text, error)}"
        ) from None
    except (ValueError, RecursionError) as error:
        why = next(
            sentence
            for kind, sentence in _UNREADABLE.items()
            if isinstance(error, kind)
        )
        raise SceneError(f"{path.name}: {why}") from None


def _read_elements(
    path: Path, content: dict[str, Any], errors: list[str]
) -> tuple[list[Any], set[str]]:
    """Make the elements, and name the tables that are not read, or not whole; sentences
    are added to ``errors``.
    """
    content = with_parts(content, path, errors)
    elements: list[Any] = []
    tables: Tables = {}
    lost: set[str] = set()
    count = sum(
        len(rows)
        for table, rows in content.items()
        if isinstance(rows, list) and table not in BESIDE
    )
    if count > MOST_ELEMENTS:
        raise SceneError(
            f"{path.name}: there are {count} elements, must be at most {MOST_ELEMENTS}."
            " Leave some out."
        )
    for table, rows in content.items():
        engine = table == "engine"
        if table in BESIDE:
            continue
        rows = [rows] if engine and isinstance(rows, dict) else rows
        if table not in TABLES and not engine:
            names = [*BESIDE, *TABLES, "engine"]
            errors.append(
                f"{path.name}: unknown table {shown(table)}.{suggestion(table, names)}"
            )
            lost |= {table, *difflib.get_close_matches(table, names, n=1)}
            continue
        if not isinstance(rows, list):
            errors.append(
                f"{path.name}: {table!r} must be a list of tables. Write [[{table}]]."
            )
            lost.add(table)
            continue
        for i, row in enumerate(rows):
            place = "[engine]" if engine else f"[[{table}]] no. {i + 1}"
            where = f"{path.name}, {place}"
            if not isinstance(row, dict):
                errors.append(
                    f"{where} is {shown(row)}, must be a table. Write [[{table}]]."
                )
                lost.add(table)
                continue
            if isinstance(row.get("name"), str):
                where += f" {shown(row['name'])}"
            cls = Engine if engine else TABLES[table]
            elements.append(_read_element(cls, row, where, path.parent, tables, errors))
    return elements, lost


def _read_element(
    cls: type,
    row: dict[str, Any],
    where: str,
    folder: Path,
    tables: Tables,
    errors: list[str],
) -> Any:
    """Make one element; a missing key becomes None, which the checks find."""
    fields = fields_of_class(cls)
    values: dict[str, Any] = {
        key: None
        for key, field in fields.items()
        if field.default is dataclasses.MISSING
    }
    for key, value in row.items():
        if key in fields:
            values[key] = _read_value(
                cls, fields[key], value, where, folder, tables, errors
            )
        else:
            errors.append(
                f"{where}: unknown key {shown(key)}.{suggestion(key, fields)}"
            )
            # A misspelt key is read as the key that it means, so that no second
            # sentence says that this is missing.
            matches = difflib.get_close_matches(key, fields, n=1)
            meant = [match for match in matches if match not in row]
            for match in meant:
                values[match] = si_value(cls, fields[match], value)
    return cls(**values)


def si_keys(cls: type, row: dict[str, Any]) -> dict[str, Any]:
    """Keys of a table, and of tables inside it, with texts of numbers and units in the
    units of their fields.
    """
    fields = fields_of_class(cls)
    values: dict[str, Any] = {}
    for key, value in row.items():
        field = fields.get(key)
        if field is None:
            values[key] = value
        elif "of" in field.metadata and isinstance(value, dict):
            values[key] = si_keys(field.metadata["of"], value)
        elif "of" in field.metadata and isinstance(value, list):
            values[key] = [si_keys(field.metadata["of"], inner) for inner in value]
        else:
            values[key] = si_value(cls, field, value)
    return values


def _read_value(
    cls: type,
    field: dataclasses.Field,
    value: Any,
    where: str,
    folder: Path,
    tables: Tables,
    errors: list[str],
) -> Any:
    """Read the value of a key; values that are no table, or no list of tables, are
    found by the checks.
    """
    kind = field.metadata["kind"]
    key = field.name
    value = si_value(cls, field, value)
    if kind == "table" and isinstance(value, dict):
        return _read_element(
            field.metadata["of"], value, f"{where}, {key}", folder, tables, errors
        )
    if (
        kind == "tables"
        and isinstance(value, list)
        and all(isinstance(inner, dict) for inner in value)
    ):
        return tuple(
            _read_element(
                field.metadata["of"],
                inner,
                f"{where}, {key} no. {k + 1}",
                folder,
                tables,
                errors,
            )
            for k, inner in enumerate(value)
        )
    if kind == "rows" and isinstance(value, str):
        try:
            units = units_of_columns(cls, field)
            return _read_rows(value, folder, field.metadata["columns"], units, tables)
        except SceneError as error:
            errors += [f"{where}: {key}: {text}" for text in error.sentences]
            return Unread()
    return value


def _read_rows(
    name: str,
    folder: Path,
    columns: tuple[str, ...],
    units: tuple[str, ...],
    tables: Tables,
) -> tuple | Unread:
    """Read a table of numbers once for all elements that name it for numbers in these
    units, and keep it in ``tables``; :class:`SceneError` the first time it is faulty.
    """
    if (name, units) in tables:
        return tables[name, units]
    tables[name, units] = Unread()
    path = folder / name
    try:
        text = read_text(path)
    except Missing:
        raise SceneError(
            f"there is no file {shown(name)} in the folder of the scene. Correct"
            " the name."
        ) from None
    except Unreadable as error:
        raise SceneError(f"{shown(name)}: {error}") from None
    rows = number_rows(
        text, columns, path.name, units=units, quoted=is_beside(path, folder)
    )
    tables[name, units] = rows
    return rows


def rows_beside(
    name: str, folder: Path, columns: tuple[str, ...], units: tuple[str, ...]
) -> list[list[float]]:
    """Rows of a sound CSV file beside a scene, in the units of their columns."""
    rows = _read_rows(name, folder, columns, units, {})
    assert not isinstance(rows, Unread)  # it is the first time that the file is read
    return [list(row) for row in rows]

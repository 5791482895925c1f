"""The ``[report]`` table of a scene: what stands in the title block of its report."""

import base64
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from datetime import date
from pathlib import Path
from typing import Any

from jaxhb.elements.sentences import shown, suggestion
from jaxhb.scene.input_files import Unreadable, read_bytes

IMAGES = {
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
    ".gif": "image/gif",
    ".svg": "image/svg+xml",
    ".webp": "image/webp",
}
"""Kinds of pictures by the endings of their files."""

KEYS_BESIDE = ("units",)
"""Keys of ``[report]`` that are read elsewhere."""


@dataclass(frozen=True, kw_only=True)
class TitleBlock:
    """The title block of a report: texts, "" where the scene gives none, each with the
    ``label`` before which it stands; ``logo`` is the name of a picture beside the
    scene.

    >>> TitleBlock(yard="Nordwerft", revision="B").rows
    [('Yard', 'Nordwerft'), ('Revision', 'B')]
    """

    yard: str = field(default="", metadata={"label": "Yard"})
    hull: str = field(default="", metadata={"label": "Hull"})
    site: str = field(default="", metadata={"label": "Site"})
    engine: str = field(default="", metadata={"label": "Engine"})
    engine_number: str = field(default="", metadata={"label": "Engine number"})
    classification: str = field(default="", metadata={"label": "Class", "key": "class"})
    drawing: str = field(default="", metadata={"label": "Drawing"})
    revision: str = field(default="", metadata={"label": "Revision"})
    date: str = field(default="", metadata={"label": "Date"})
    author: str = field(default="", metadata={"label": "Author"})
    checker: str = field(default="", metadata={"label": "Checker"})
    logo: str = field(default="", metadata={"label": ""})

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Labels and texts of what the scene gives."""
        return [
            (each.metadata["label"], getattr(self, each.name))
            for each in fields(self)
            if each.metadata["label"] and getattr(self, each.name)
        ]

    @property
    def short(self) -> str:
        """A line for the running head of printed pages, "" without a title block."""
        words = [self.yard or self.site, self.hull, self.engine, self.drawing]
        if self.revision:
            words.append(f"rev. {self.revision}")
        return ", ".join(filter(None, words))


KEYS = {each.metadata.get("key", each.name): each.name for each in fields(TitleBlock)}
"""Names of the fields of a :class:`TitleBlock` by the keys of ``[report]``."""


def read_title_block(
    table: Any, source: str, folder: Path, errors: list[str]
) -> TitleBlock:
    """Read the ``[report]`` table of a scene, None without; sentences on what is wrong
    go to ``errors``.

    >>> errors = []
    >>> table = {"yard": "Nordwerft", "hul": 7}
    >>> read_title_block(table, "ship.toml", Path("."), errors).yard, errors
    ('Nordwerft', ["ship.toml, [report]: unknown key 'hul'. Did you mean 'hull'?"])
    """
    if table is None:
        return TitleBlock()
    if not isinstance(table, Mapping):
        errors.append(
            f"{source}: 'report' is {shown(table)}, must be a table. Write [report]."
        )
        return TitleBlock()
    where = f"{source}, [report]"
    choices = [*KEYS, *KEYS_BESIDE]
    texts = {}
    for key, value in table.items():
        if key in KEYS_BESIDE:
            continue
        if key not in KEYS:
            errors.append(
                f"{where}: unknown key {shown(key)}.{suggestion(key, choices)}"
            )
        elif isinstance(value, str | int | float | date):
            texts[KEYS[key]] = str(value)
        else:
            errors.append(
                f"{where}: {key} is {shown(value)}, must be a text. Put it in quotes."
            )
    block = TitleBlock(**texts)
    if block.logo and Path(block.logo).suffix.lower() not in IMAGES:
        errors.append(
            f"{where}: logo {shown(block.logo)} is no picture. Give a file that ends in"
            f" {', '.join(IMAGES)}."
        )
    elif block.logo and not (folder / block.logo).is_file():
        errors.append(
            f"{where}: logo: there is no file {shown(block.logo)} in the folder of the"
            " scene. Correct the name."
        )
    return block


def logo_address(block: TitleBlock, folder: Path) -> str:
    """Write the logo as an address that holds the whole picture, "" without one;
    :class:`~jaxhb.scene.input_files.Unreadable` where it cannot be read.
    """
    if not block.logo:
        return ""
    path = folder / block.logo
    try:
        content = read_bytes(path)
    except Unreadable as error:
        raise Unreadable(f"logo {block.logo!r}: {error}") from None
    kind = IMAGES[path.suffix.lower()]
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"

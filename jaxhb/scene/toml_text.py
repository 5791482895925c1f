"""TOML that stays as it was written: comments, order, blank lines, and the digits of
all values that are not changed.

tomlkit keeps all this within a table. But it gathers the entries of an array of tables
with other tables between them (python-poetry/tomlkit pull request 601), and scenes mix
[[disk]] and [[shaft]] freely. So a text is cut into pieces, one for each head, and
tomlkit changes one piece at a time.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import reduce
from operator import getitem
from typing import Any

import tomlkit

Path = Sequence[str | int]
"""Keys and indices that lead to a table or value inside a piece."""

_HEAD = re.compile(r"(?m)^(?=[ \t]*\[)")
_TAIL = re.compile(r"(?:^[ \t]*(?:#.*)?\n)*\Z", re.MULTILINE)
"""Blank lines and comments at the end of a piece: they belong to the next head."""


class TomlText:
    """A valid TOML text whose values can be changed one by one; ``newline`` ends most
    of its lines, and all lines that are written.
    """

    def __init__(self, text: str = "") -> None:
        self.newline = "\r\n" if 2 * text.count("\r\n") > text.count("\n") else "\n"
        self._pieces = _cut(text.replace("\r\n", "\n"))
        self._read = [tomllib.loads(piece) for piece in self._pieces]

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> TomlText:
        """Write plain dictionaries, lists and numbers, with a blank line before every
        head.
        """
        text = cls()
        for table, rows in content.items():
            text.append(table, rows)
        return text

    def __str__(self) -> str:
        return "".join(self._pieces).replace("\n", self.newline)

    def set(self, table: str, row: int, field: str, value: Any) -> None:
        """Change or add one value of a row of ``[[table]]``, or of ``[table]``;
        ``field`` may be ``"inner.key"``.
        """
        outer, _, key = field.rpartition(".")
        parts = self._rows(table)[row]
        inside = (
            (number, path)
            for number, path in parts
            if outer and outer in _inside(self._read[number], path)
        )
        number, path = next(inside, parts[0])
        self._change(
            number,
            [*path, outer] if outer else path,
            lambda node: _put(node, key, value),
        )

    def merge(self, table: str, entries: Mapping[str, Mapping[str, Any]]) -> None:
        """Put entries of ``[table]``, small tables themselves, in the place of entries
        with the same keys, also where these are dotted or heads, or add them.
        """
        for name, entry in entries.items():
            number, path = self._entry(table, name)
            *outer, key = path
            self._change(
                number,
                outer,
                lambda node, key=key, entry=entry: _put_table(node, key, entry),
            )

    def _entry(self, table: str, name: str) -> tuple[int, list[str | int]]:
        """Piece and path of the entry of ``[table]`` with this name, or for a new
        one.
        """
        parts = [part for row in self._rows(table) for part in row]
        for number, path in parts:
            keys = _keys_of(_inside(self._read[number], path), name)
            if keys:
                return number, [*path, *keys]
        # Below the head of one entry there is no place for another.
        own = [number for number, _ in parts if self._head(number) in ("", table)]
        if not own:
            self.append(table, {})
            return self._entry(table, name)
        return own[0], [table, name]

    def _head(self, number: int) -> str:
        """Name in the head of a piece, as it is written; "" of the first, without."""
        head = self._pieces[number] if number else ""
        return head.partition("]")[0].strip(" \t\n[")

    def discard(self, table: str, row: int, key: str) -> Any:
        """Remove one value, if it is there, and return it."""
        number, path = self._rows(table)[row][0]
        value = _inside(self._read[number], path).get(key)
        if value is not None:
            self._change(number, path, lambda node: node.pop(key))
        return value

    def rename(self, keys: Collection[str], names: Mapping[str, str]) -> None:
        """Change texts that are values of some ``keys``, or stand in lists that are, in
        any table; ``names`` gives the new text of each.
        """
        for number, content in enumerate(self._read):
            for path in _places(content, keys, names):
                *outer, key = path
                self._change(
                    number,
                    outer,
                    lambda node, key=key: node.__setitem__(key, names[node[key]]),
                )

    def append(self, table: str, rows: list | Mapping[str, Any]) -> None:
        """Add rows ``[[table]]``, or one ``[table]``, behind the rows of the table, or
        at the end.
        """
        numbers = [number for parts in self._rows(table) for number, _ in parts]
        if numbers and not numbers[-1]:
            # A list above all heads: TOML takes no [[table]] of the same name below it.
            self._change(0, [table], lambda node: node.extend(rows))
        elif numbers:
            self.insert_behind(numbers[-1], table, rows)
        else:
            self._insert(len(self._pieces), table, rows)

    def replace(self, old: str, table: str, rows: list | Mapping[str, Any]) -> None:
        """Put rows ``[[table]]`` in the place of ``[old]`` and the tables inside it;
        comments above its head stay.
        """
        numbers = [number for parts in self._rows(old) for number, _ in parts]
        for number in filter(None, numbers):
            self._write(number, _tail(self._pieces[number]))
        if numbers[0]:
            self._insert(numbers[0], table, rows)
        else:
            self._change(0, [], lambda node: node.pop(old))
            self.insert_behind(0, table, rows)

    def insert_behind(
        self, number: int, table: str, rows: list | Mapping[str, Any]
    ) -> None:
        """Put new pieces behind piece ``number``; the comments at its end belong to the
        next head and stay before that.
        """
        tail = _tail(self._pieces[number])
        self._write(number, self._pieces[number].removesuffix(tail))
        self._insert(number + 1, table, rows, tail)

    def _insert(
        self, number: int, table: str, rows: list | Mapping[str, Any], tail: str = ""
    ) -> None:
        """Put new pieces before piece ``number``, the last with ``tail`` behind it."""
        before = "".join(self._pieces[:number])
        behind = "".join(self._pieces[number:])
        pieces: list[str] = []
        for row in [[row] for row in rows] if isinstance(rows, list) else [rows]:
            pieces.append(_gap(before) + tomlkit.dumps({table: row}))
            before = pieces[-1]
        self._pieces[number:number] = pieces
        self._read[number:number] = [tomllib.loads(piece) for piece in pieces]
        if not pieces:
            return
        if not tail and behind != "" and not behind.startswith("\n"):
            tail = "\n"
        self._pieces[number + len(pieces) - 1] += tail

    def _rows(self, table: str) -> list[list[tuple[int, list[str | int]]]]:
        """Parts of each row of a table, each (number of the piece, path in it): the
        part of its head first, then those of heads inside it.
        """
        rows: list[list[tuple[int, list[str | int]]]] = []
        for number, content in enumerate(self._read):
            value = content.get(table)
            if isinstance(value, list):
                rows += [[(number, [table, k])] for k in range(len(value))]
            elif value is not None and rows:
                rows[-1].append((number, [table]))
            elif value is not None:
                rows.append([(number, [table])])
        return rows

    def _change(self, number: int, path: Path, change: Callable[..., Any]) -> None:
        """Change a table of a piece; additions stand before the comments that belong to
        the next head.
        """
        piece = self._pieces[number]
        tail = _tail(piece)
        document = tomlkit.parse(piece.removesuffix(tail))
        change(_inside(document, path))
        self._write(number, tomlkit.dumps(document) + tail)

    def _write(self, number: int, piece: str) -> None:
        """Replace a piece."""
        self._pieces[number] = piece
        self._read[number] = tomllib.loads(piece)


def _inside(content: Any, path: Path) -> Any:
    """Value inside a piece that a path leads to."""
    return reduce(getitem, path, content)


def _put_table(node: Any, key: str, entry: Mapping[str, Any]) -> None:
    """Put a small table into another one: on a line, unless one with a head, or of
    dotted keys, is there.
    """
    written = node.get(key)
    if not isinstance(written, tomlkit.items.Table):
        node[key] = tomlkit.inline_table()
        node[key].update(entry)
        return
    for old in list(written):
        del written[old]
    written.update(entry)


def _keys_of(tables: Mapping[str, Any], name: str) -> list[str]:
    """Keys, one inside the other, that make a name with dots between them; none without
    such an entry.
    """
    for key, inner in tables.items():
        if key == name:
            return [key]
        if isinstance(inner, dict) and name.startswith(f"{key}."):
            rest = _keys_of(inner, name.removeprefix(f"{key}."))
            if rest:
                return [key, *rest]
    return []


def _tail(piece: str) -> str:
    """Blank lines and comments at the end of a piece."""
    match = _TAIL.search(piece)
    assert match is not None  # it matches the empty end, too
    return match.group()


def _places(
    value: dict | list,
    keys: Collection[str],
    texts: Collection[str],
    path: tuple[str | int, ...] = (),
    holder: str | int = "",
) -> Iterator[tuple[str | int, ...]]:
    """Paths, inside a table or a list, of values of some keys, or in lists that are
    values of these, that are one of some texts; ``holder`` is the key of a list.
    """
    pairs = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inner in pairs:
        name = key if isinstance(value, dict) else holder
        if isinstance(inner, dict | list):
            yield from _places(inner, keys, texts, (*path, key), name)
        elif name in keys and isinstance(inner, str) and inner in texts:
            yield *path, key


def _cut(text: str) -> list[str]:
    """Pieces of a text, each with one head, the first without; a line inside a value
    that begins like a head is none.
    """
    piece, *parts = _HEAD.split(text)
    pieces = []
    for part in parts:
        if _is_whole(piece):
            pieces.append(piece)
            piece = ""
        piece += part
    return [*pieces, piece]


def _gap(before: str) -> str:
    """Gap between a text and a new head: a blank line, except at the beginning and
    below a comment.
    """
    last = before.splitlines()[-1:]
    if not before.strip() or before.endswith("\n\n") or last[0].startswith("#"):
        return ""
    return "\n" if before.endswith("\n") else "\n\n"


def _is_whole(piece: str) -> bool:
    """Whether a piece is TOML by itself, and does not end inside a list or a text of
    several lines.
    """
    try:
        tomllib.loads(piece)
    except tomllib.TOMLDecodeError:
        return False
    return True


def _put(node: Any, key: str, value: Any) -> None:
    """Set a value of a table of tomlkit; numbers that are equal keep their digits,
    unless they have a unit.
    """
    if not isinstance(value, float | int) or isinstance(value, bool):
        node[key] = value
    elif key not in node or isinstance(node[key], str) or float(node[key]) != value:
        number = int(value) if isinstance(value, int) else float(value)
        node[key] = tomlkit.value(repr(number))

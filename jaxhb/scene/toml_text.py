"""TOML that stays as it was written: comments, order, blank lines and the digits of
whatever is not changed.

tomlkit keeps all this within a table. But it gathers the entries of an array of tables
that others stand between (python-poetry/tomlkit pull request 601), and scenes mix
[[disk]] and [[shaft]] as they like. So a text is cut into pieces, one for each head,
and tomlkit changes one piece at a time.
"""

import re
import tomllib
from collections.abc import Iterable
from functools import reduce
from operator import getitem

import tomlkit

_HEAD = re.compile(r"(?m)^(?=[ \t]*\[)")
_TAIL = re.compile(r"(?:^[ \t]*(?:#.*)?\n)*\Z", re.MULTILINE)
"""Blank lines and comments that end a piece: they belong to the head that follows."""


class TomlText:
    """A valid TOML text whose values can be changed one by one; ``newline`` ends most
    of its lines, and all written.
    """

    def __init__(self, text=""):
        self.newline = "\r\n" if 2 * text.count("\r\n") > text.count("\n") else "\n"
        self._pieces = _cut(text.replace("\r\n", "\n"))
        self._read = [tomllib.loads(piece) for piece in self._pieces]

    @classmethod
    def of(cls, content):
        """The text of plain dictionaries, lists and numbers, with a blank line before
        every head.
        """
        made = cls()
        for table, rows in content.items():
            made.append(table, rows)
        return made

    def __str__(self):
        return "".join(self._pieces).replace("\n", self.newline)

    def set(self, table, row, field, value):
        """Change or add one value of a row of ``[[table]]``, or of ``[table]``;
        ``field`` may be ``"inner.key"``.
        """
        outer, _, key = field.rpartition(".")
        parts = self._rows(table)[row]
        inside = (
            part
            for part in parts
            if outer and outer in reduce(getitem, part[1], self._read[part[0]])
        )
        number, path = next(inside, parts[0])
        self._change(
            number,
            [*path, outer] if outer else path,
            lambda node: _put(node, key, value),
        )

    def merge(self, table, entries):
        """Put entries of ``[table]``, small tables themselves, in the place of those of
        the same keys, or add them.
        """
        if not self._rows(table):
            self.append(table, {})
        number, path = self._rows(table)[0][0]
        for key, entry in entries.items():
            inline = tomlkit.inline_table()
            inline.update(entry)
            self._change(
                number,
                path,
                lambda node, key=key, inline=inline: node.update({key: inline}),
            )

    def discard(self, table, row, key):
        """Take out one value, if it is there, and return it."""
        number, path = self._rows(table)[row][0]
        found = reduce(getitem, path, self._read[number]).get(key)
        if found is not None:
            self._change(number, path, lambda node: node.pop(key))
        return found

    def rename(self, keys: Iterable[str], names: dict[str, str]):
        """Change texts that are values of some keys, in whatever table: ``{text: new
        text}``.
        """
        for number, read in enumerate(self._read):
            for path in _places(read, keys, names):
                *outer, key = path
                self._change(
                    number,
                    outer,
                    lambda node, key=key: node.__setitem__(key, names[node[key]]),
                )

    def append(self, table, rows):
        """Add rows ``[[table]]``, or one ``[table]``: behind the rows it has, or at the
        end.
        """
        own = [number for parts in self._rows(table) for number, _ in parts]
        if own and not own[-1]:
            # A list above all heads: TOML takes no [[table]] of the same name below it.
            self._change(0, [table], lambda node: node.extend(rows))
        elif own:
            self.insert_behind(own[-1], table, rows)
        else:
            self._insert(len(self._pieces), table, rows)

    def replace(self, old, table, rows):
        """Put rows ``[[table]]`` where ``[old]`` is, with the tables inside it;
        comments above its head stay.
        """
        own = [number for parts in self._rows(old) for number, _ in parts]
        for number in filter(None, own):
            self._write(number, _TAIL.search(self._pieces[number]).group())
        if own[0]:
            self._insert(own[0], table, rows)
        else:
            self._change(0, [], lambda node: node.pop(old))
            self.insert_behind(0, table, rows)

    def insert_behind(self, number, table, rows):
        """Put new pieces behind one; the comments that end it belong to the next head
        and stay before that.
        """
        tail = _TAIL.search(self._pieces[number]).group()
        self._write(number, self._pieces[number].removesuffix(tail))
        self._insert(number + 1, table, rows, tail)

    def _insert(self, number, table, rows, tail=""):
        """Put new pieces before piece ``number``."""
        before, behind = (
            "".join(pieces) for pieces in (self._pieces[:number], self._pieces[number:])
        )
        made = []
        for row in [[row] for row in rows] if isinstance(rows, list) else [rows]:
            made.append(_gap(before) + tomlkit.dumps({table: row}))
            before = made[-1]
        self._pieces[number:number] = made
        self._read[number:number] = [tomllib.loads(piece) for piece in made]
        if made:
            self._pieces[number + len(made) - 1] += tail or "\n" * (
                behind != "" and not behind.startswith("\n")
            )

    def _rows(self, table):
        """Of each row of a table its parts: (piece, path in it) of its own head first,
        then of heads inside it.
        """
        rows = []
        for number, read in enumerate(self._read):
            found = read.get(table)
            if isinstance(found, list):
                rows += [[(number, [table, k])] for k in range(len(found))]
            elif found is not None and rows:
                rows[-1].append((number, [table]))
            elif found is not None:
                rows.append([(number, [table])])
        return rows

    def _change(self, number, path, change):
        """Change a table of a piece; what is added stands before the comments that
        belong to the next head.
        """
        piece = self._pieces[number]
        tail = _TAIL.search(piece).group()
        document = tomlkit.parse(piece.removesuffix(tail))
        change(reduce(getitem, path, document))
        self._write(number, tomlkit.dumps(document) + tail)

    def _write(self, number, piece):
        self._pieces[number], self._read[number] = piece, tomllib.loads(piece)


def _places(value, keys, texts, path=()):
    """Paths, inside a table or a list, of values of some keys that are one of some
    texts.
    """
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
        if isinstance(inner, dict | list):
            yield from _places(inner, keys, texts, (*path, key))
        elif key in keys and isinstance(inner, str) and inner in texts:
            yield *path, key


def _cut(text):
    """The pieces of a text, each with one head, the first without; a line that begins
    so inside a value is no head.
    """
    piece, *parts = _HEAD.split(text)
    pieces = []
    for part in parts:
        if _is_whole(piece):
            pieces.append(piece)
            piece = ""
        piece += part
    return [*pieces, piece]


def _gap(before):
    """What stands between a text and a new head: a blank line, but for the beginning
    and below a comment.
    """
    last = before.splitlines()[-1:]
    if not before.strip() or before.endswith("\n\n") or last[0].startswith("#"):
        return ""
    return "\n" if before.endswith("\n") else "\n\n"


def _is_whole(piece):
    """Whether a piece is TOML by itself: what ends inside a list or a text of several
    lines is not.
    """
    try:
        tomllib.loads(piece)
    except tomllib.TOMLDecodeError:
        return False
    return True


def _put(node, key, value):
    if not isinstance(value, float | int) or isinstance(value, bool):
        node[key] = value
    elif key not in node or float(node[key]) != value:
        node[key] = tomlkit.value(
            repr(int(value) if isinstance(value, int) else float(value))
        )

"""The words of a page in another language: phrases and what stands in their place.

A text is split at names of the scene and at numbers, which stay; what lies between is
replaced as a whole where a phrase is given for it, else phrases inside it are, the
longest first.
"""

import re
import tomllib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape, unescape
from pathlib import Path
from typing import Any

from jaxhb.elements.sentences import cut, shown
from jaxhb.report.figures.figure import Figure, plain
from jaxhb.report.files.output import OutputError
from jaxhb.scene.input_files import Unreadable, read_text
from jaxhb.train.topology import Topology

NUMBER = r"[-+]?\d[\d.,:]*(?:e[-+]?\d+)?(?:[%^]\d*)?"
EDGES = " \t\n.,;:()[]?!'-–=+*/|%"
"""Letters at the ends of a phrase that are no part of it."""

SHORTEST = 4  # letters of a phrase that is found inside others

HEAD = """\
# Phrases of a page of jaxhb report: write behind each what stands in its place, and
# give this file as --words. Those left empty stay as they are, as do names and numbers;
# phrases may be parts of these.
"""


@dataclass
class Words:
    """Phrases by the English ones, and ``names`` that are never replaced; ``used`` are
    all phrases that were asked for, in their order.

    >>> words = Words({"speeds": "Drehzahlen", "largest": "größte"}, ["largest wheel"])
    >>> words("largest of 7 speeds at largest wheel")
    'größte of 7 Drehzahlen at largest wheel'
    """

    phrases: Mapping[str, str] = field(default_factory=dict)
    names: Collection[str] = ()
    used: dict[str, None] = field(default_factory=dict)

    def __call__(self, text: str) -> str:
        """Replace the phrases of a text."""
        if text in self.names or not re.search("[A-Za-z]{2}", text):
            return text
        # What is split at stands at odd places.
        pieces = self._borders.split(str(text))
        pieces[::2] = map(self._replaced, pieces[::2])
        return "".join(pieces)

    @cached_property
    def _borders(self) -> re.Pattern[str]:
        """Names and numbers."""
        names = sorted(map(re.escape, self.names), key=len, reverse=True)
        return re.compile(rf"(?<!\w)({'|'.join([*names, NUMBER])})(?!\w)")

    @cached_property
    def _inside(self) -> re.Pattern[str] | None:
        """Phrases, the longest first, without short words; None without any."""
        long = [phrase for phrase in self.phrases if len(phrase) >= SHORTEST]
        phrases = sorted(map(re.escape, long), key=len, reverse=True)
        if not phrases:
            return None
        return re.compile(rf"(?<!\w)({'|'.join(phrases)})(?!\w)")

    def _replaced(self, piece: str) -> str:
        """Replace a piece between names and numbers."""
        phrase = piece.strip(EDGES)
        if not re.search("[A-Za-z]{2}", phrase):
            return piece
        self.used.setdefault(phrase)
        if phrase in self.phrases:
            return piece.replace(phrase, self.phrases[phrase])
        if self._inside is None:
            return piece
        return self._inside.sub(lambda found: self.phrases[found[0]], piece)

    def figure(self, drawn: Figure) -> Figure:
        """Replace the phrases of a figure: caption, axes, legend and notes."""
        traces = [
            trace | {"name": self(trace["name"])} | self._texts(trace)
            for trace in drawn.traces
        ]
        return replace(
            drawn,
            caption=self(drawn.caption),
            x=replace(drawn.x, title=self(drawn.x.title)),
            panels=[replace(axis, title=self(axis.title)) for axis in drawn.panels],
            traces=traces,
            notes=[each | {"text": self(each["text"])} for each in drawn.notes],
        )

    def drawing(self, svg: str) -> str:
        """Replace the phrases of the texts of an SVG, but for lines of names.

        >>> Words({"disk": "Scheibe"}).drawing("<text>disk &amp; more</text>")
        '<text>Scheibe &amp; more</text>'
        """
        return re.sub(
            r'(<text(?![^>]* class="name")[^>]*>)([^<]+)',
            lambda text: text[1] + escape(self(unescape(text[2])), quote=False),
            svg,
        )

    def _texts(self, trace: Mapping[str, Any]) -> dict[str, list[str]]:
        """Replace the phrases of the texts under the pointer."""
        return {"text": [*map(self, trace["text"])]} if "text" in trace else {}

    def template(self) -> bytes:
        """Write a file of all phrases that were asked for and of what replaces them."""
        lines = [
            f"{_quoted(phrase)} = {_quoted(self.phrases.get(phrase, ''))}\n"
            for phrase in self.used
        ]
        return (HEAD + "".join(lines)).encode()


def _quoted(text: str) -> str:
    """Write a text as TOML."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'


def names_of(topology: Topology, more: Iterable[str] = ()) -> set[str]:
    """Collect the names of a scene, which no words replace."""
    names = {topology.title, *topology.disk_names, *topology.elements, *more}
    return {form for name in names if name for form in (name, plain(name))}


def read_words(name: str) -> dict[str, str]:
    """Read the phrases of a TOML file, those left empty are none;
    :class:`~jaxhb.report.files.output.OutputError` says what is wrong with it.
    """
    try:
        table = tomllib.loads(read_text(Path(name)))
    except Unreadable as error:
        raise OutputError(f"--words: {cut(name)}: {error}") from None
    except tomllib.TOMLDecodeError as error:
        raise OutputError(
            f"--words: {cut(name)}: invalid TOML: {cut(str(error))}. Correct it."
        ) from None
    for phrase, other in table.items():
        if not isinstance(other, str):
            raise OutputError(
                f"--words: {cut(name)}: {shown(phrase)} is {shown(other)}, must be a"
                ' text. Write "English" = "other".'
            )
    return {phrase: other for phrase, other in table.items() if other}

"""Sentences on elements of a scene in the words of the workbook from which it comes:
sheet and cell in the place of table and number.
"""

import re
from collections.abc import Iterable

from jaxhb.elements.sentences import shown
from jaxhb.scene.workbook.columns import SETTINGS
from jaxhb.scene.workbook.reading import Place, Reader


def in_cells(content: bytes, source: str, sentences: Iterable[str]) -> list[str]:
    """Rename the places of sentences: ``plant.xlsx, [[shaft]] no. 6: stiffness is -5``
    becomes ``plant.xlsx, sheet shaft, cell D7: stiffness is -5``.
    """
    reader = Reader(content, source)
    return [_renamed(reader, sentence) for sentence in sentences]


_ELEMENT = r", \[\[(?P<table>[\w.]+)\]\] no\. (?P<number>\d+)"
_ENGINE = r", \[(?P<engine>engine)\]"


def _renamed(reader: Reader, sentence: str) -> str:
    begin = re.escape(reader.source)
    match = re.match(rf"{begin}(?:{_ELEMENT}|{_ENGINE})(?P<rest>.*)", sentence, re.S)
    if match:
        table = match["table"] or match["engine"]
        number = int(match["number"] or 1) - 1
        return _of_element(reader, (table, number), match["rest"]) or sentence
    match = re.match(rf"{begin}, \[({'|'.join(SETTINGS)})\](.*)", sentence, re.S)
    if match:
        return _of_setting(reader, (match[1],), match[2]) or sentence
    match = re.match(rf"{begin}, \[scenario\.([^\]]*)\](?P<rest>.*)", sentence, re.S)
    if match:
        return _of_setting(reader, ("scenario", match[1]), match["rest"]) or sentence
    return sentence


def _of_element(reader: Reader, path: tuple, rest: str) -> str:
    """Sentence on an element, "" where the workbook has it nowhere."""
    title = ""
    named = reader.places.get((*path, "name"))
    if named is not None and rest.startswith(f" {shown(named.value)}"):
        title = f" {shown(named.value)}"
    inner, colon, text = rest.removeprefix(title).partition(": ")
    for key, row in re.findall(r", (\w+)(?: no\. (\d+))?", inner):
        path = (*path, key, int(row) - 1) if row else (*path, key)
    place = _place_of(reader, path, text)
    if place is None or not colon:
        return ""
    row = re.match(r"\w+, row (\d+)", text)
    where = place.text
    if row and int(row[1]) <= len(place.rows):
        where = place.rows[int(row[1]) - 1]
    return f"{reader.source}, {where}{title}: {text}"


def _place_of(reader: Reader, path: tuple, text: str) -> Place | None:
    """Place of the key that a sentence names, of a value that it quotes, or of the
    element.
    """
    keys = re.match(r"(?:the key ')?(\w+)", text)
    if keys and (*path, keys[1]) in reader.places:
        return reader.places[(*path, keys[1])]
    inside = {
        inner: place
        for inner, place in reader.places.items()
        if inner[: len(path)] == path and len(inner) > len(path) and inner[-1] != "name"
    }
    fault = re.split(r" (?:Known|Did you mean)\b", text)[0]
    for quoted in inside.values():
        if isinstance(quoted.value, str) and shown(quoted.value) in fault:
            return quoted
    return reader.places.get(path[:2])


def _of_setting(reader: Reader, path: tuple, rest: str) -> str:
    """Sentence on a key of a sheet of settings, "" where the workbook has it
    nowhere.
    """
    text = rest.removeprefix(": ")
    for keys, inner in reader.places.items():
        if keys[:-1] != path:
            continue
        key = str(keys[-1])
        element, _, field = key.rpartition(".")
        begins = (f"{key} ", f"{key}:", f"{shown(element)}: {field} ")
        if shown(key) in text or text.startswith(begins):
            return f"{reader.source}, {inner.text}: {text}"
    place = reader.places.get(path)
    return "" if place is None else f"{reader.source}, {place.text}: {text}"

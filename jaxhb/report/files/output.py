"""Files that appear whole or not at all, standard output among them, and refusals
before anything is computed.
"""

import contextlib
import csv
import glob
import io
import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jaxhb._files import clear_parts, write_whole

ANSWERED = 0
NOT_ANSWERED = 1
INTERRUPTED = 130
STANDARD_OUTPUT = "-"
_CHANGES: dict[str, Callable[[Any], Any]] = {
    "scenario": lambda name: name,
    "set": dict,
    "links_at": dict,
    "viscous": lambda hz: hz,
    "misfire": list,
    "cut_off": list,
}
"""Options that change the scene, and how the files write their values."""


class OutputError(ValueError):
    """A file that cannot be written, or a picture that cannot be drawn: a sentence for
    the user.
    """


def check_output(
    option: str, name: str, inputs: Iterable[str | Path], *, streamed: bool
) -> None:
    """Refuse a path that cannot be written, or is one of ``inputs``, before the work is
    done; ``streamed`` : whether it may be standard output.
    """
    if name == STANDARD_OUTPUT:
        if streamed:
            return
        raise OutputError(
            f"{option}: it is not written to standard output. Give the name of a file."
        )
    path = Path(name).resolve()
    if not path.parent.is_dir():
        raise OutputError(
            f"{option}: there is no folder {str(path.parent)!r}. Make it, or give"
            " another path."
        )
    if path.is_dir():
        raise OutputError(f"{option}: {name!r} is a folder. Give the name of a file.")
    if path.exists() and not path.is_file():
        instead = f", or {STANDARD_OUTPUT} for standard output" * streamed
        raise OutputError(
            f"{option}: {name!r} is a device or a pipe. Give the name of a"
            f" file{instead}."
        )
    if not os.access(path.parent, os.W_OK) or (
        path.exists() and not os.access(path, os.W_OK)
    ):
        raise OutputError(
            f"{option}: {name!r} cannot be written. Give a path where you may write."
        )
    if path.exists() and any(path.samefile(source) for source in inputs):
        raise OutputError(
            f"{option}: {name!r} is read by this command and would be lost. Give"
            " another name."
        )


def make_folders(names: Iterable[str | Path]) -> None:
    """Make the folders in which files of these names will lie."""
    for name in names:
        with _sentence(name):
            Path(name).parent.mkdir(parents=True, exist_ok=True)


def write_files(contents: Mapping[str, bytes | Iterable[bytes]]) -> None:
    """Write all files of ``{name: bytes or an iterable of them}`` or none; the content
    named "-" goes to standard output, after them.
    """
    chunks: dict[str | Path, Iterable[bytes]] = {
        name: [content] if isinstance(content, bytes) else content
        for name, content in contents.items()
    }
    streamed = chunks.pop(STANDARD_OUTPUT, None)
    for path in map(Path, chunks):
        clear_parts(path.resolve().parent, glob.escape(path.resolve().name))
    with _sentence():
        write_whole(chunks)
    if streamed is not None:
        sys.stdout.flush()
        sys.stdout.buffer.writelines(streamed)  # UTF-8, whatever the terminal shows


@contextlib.contextmanager
def _sentence(name: str | Path | None = None) -> Iterator[None]:
    """Turn a failure to write into an :class:`OutputError`."""
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"{name or error.filename!r} cannot be written: {error.strerror}."
        ) from None


def as_json(record: Mapping[str, Any]) -> Iterator[bytes]:
    """Generate the file of a record (see
    :func:`jaxhb.report.files.numbers.answer_record`); behind it stand its iterators, of
    records as :func:`as_bytes` makes them, as lists.
    """
    lists = {key: value for key, value in record.items() if isinstance(value, Iterator)}
    yield as_bytes({key: record[key] for key in record if key not in lists})[:-1]
    for key, records in lists.items():
        yield b", " + as_bytes(key) + b": ["
        for i, encoded in enumerate(records):
            yield (b", " if i else b"") + encoded
        yield b"]"
    yield b"}\n"


def as_bytes(record: Any) -> bytes:
    """A record as JSON, numbers in full precision."""
    return json.dumps(_plain(record), allow_nan=False, ensure_ascii=False).encode()


def _plain(value: Any) -> Any:
    """A nest of values with lists for arrays, None for every number that is not finite
    (JSON has no nan), 0 of no sign.
    """
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    if isinstance(value, float):
        return value + 0.0 if math.isfinite(value) else None
    return value


def as_csv(heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> list[bytes]:
    """The file of a table, numbers in full precision, cells of what is not finite
    empty, texts no formulae.
    """
    # Not before the help of a command is printed
    from jaxhb.scene.csv_tables import guarded

    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for cells in [heads, *_plain(list(rows))]:
        writer.writerow(
            [guarded(cell) if isinstance(cell, str) else cell for cell in cells]
        )
    return [text.getvalue().encode()]


@dataclass(frozen=True)
class Sheet:
    """A table of numbers for a file: rows of cells under heads."""

    heads: Sequence[str]
    rows: Iterable[Sequence[Any]]


def sheet(rows: Sequence[Mapping[str, Any]], missing: float | None = None) -> Sheet:
    """The :class:`Sheet` of rows by heads; cells that a row does not have are
    ``missing``.
    """
    heads = list(dict.fromkeys(head for row in rows for head in row))
    return Sheet(heads, [[row.get(head, missing) for head in heads] for row in rows])


def merged_csv(files: Mapping[str, str], _: Mapping[str, Any]) -> list[bytes]:
    """One CSV file of those of several operating modes by title, which comes first."""
    from jaxhb.scene.csv_tables import unguarded

    heads: dict[str, None] = {}
    rows = []
    for title, path in files.items():
        with Path(path).open(encoding="utf-8", newline="") as text:
            names, *lines = (
                [unguarded(cell) for cell in cells] for cells in csv.reader(text)
            )
        heads |= dict.fromkeys(names)
        rows += [(title, dict(zip(names, cells, strict=True))) for cells in lines]
    cells = [[title, *map(row.get, heads)] for title, row in rows]
    return as_csv(["scenario", *heads], cells)


def merged_json(
    files: Mapping[str, str], together: Mapping[str, Any]
) -> Iterator[bytes]:
    """One JSON file of those of several operating modes by title, and what is told of
    them ``together``.
    """
    records = {
        title: json.loads(Path(path).read_text("utf-8"))
        for title, path in files.items()
    }
    return as_json({"scenarios": records, **together})


def as_picture(name: str, figure: Any) -> list[bytes]:
    """A matplotlib figure as the kind that ``name`` ends in."""
    content = io.BytesIO()
    figure.savefig(content, format=Path(name).suffix.lower()[1:], dpi=100)
    return [content.getvalue()]


def changes(arguments: Any) -> dict[str, Any]:
    """Changes of the scene by options of the command line, for the files."""
    return {
        option: convert(getattr(arguments, option))
        for option, convert in _CHANGES.items()
        if hasattr(arguments, option)
    }


def changed_text(arguments: Any) -> str:
    """Changes of the scene as they were typed: a line, "" where there are none."""
    options = []
    for option, value in changes(arguments).items():
        rows = (
            [f"{key}={number}" for key, number in value.items()]
            if isinstance(value, dict)
            else value
        )
        rows = rows if isinstance(rows, list) else [str(rows)] * (rows is not None)
        options += [f"--{option.replace('_', '-')} {row!r}" for row in rows]
    return f"Asked with {', '.join(options)}." if options else ""

"""Files that appear whole or not at all, and refusals before anything is computed."""

import csv
import importlib.util
import io
import itertools
import json
import os
from pathlib import Path

PICTURES = (".png", ".svg", ".pdf")


class OutputError(ValueError):
    """A file that cannot be written, or a picture that cannot be drawn: a sentence for the user."""


def check_output(option, name):
    """Refuse a path that cannot be written, before the work is done."""
    path = Path(name)
    if not path.parent.is_dir():
        raise OutputError(f"{option}: there is no folder {str(path.parent)!r}. Make it, or give another path.")
    if path.is_dir():
        raise OutputError(f"{option}: {name!r} is a folder. Give the name of a file.")
    if not os.access(path.parent, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise OutputError(f"{option}: {name!r} cannot be written. Give a path where you may write.")


def check_picture(option, name):
    """Refuse a picture of unknown kind, and any picture without matplotlib."""
    check_output(option, name)
    if Path(name).suffix.lower() not in PICTURES:
        raise OutputError(f"{option}: {name!r} is no picture. Give a name that ends in {', '.join(PICTURES)}.")
    if importlib.util.find_spec("matplotlib") is None:
        raise OutputError(f'{option}: pictures need matplotlib. Install it: pip install "jaxhb[plot]".')


def write_whole(name, *parts):
    """Write bytes beside ``name`` and move them there: nobody ever sees half a file."""
    path = Path(name)
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with beside.open("wb") as file:
            file.writelines(itertools.chain.from_iterable(parts))
        os.replace(beside, path)
    except OSError as error:
        raise OutputError(f"{name!r} cannot be written: {error.strerror}.") from None
    finally:
        beside.unlink(missing_ok=True)


def write_json(name, record):
    """Write a record (see :func:`jaxhb.show.report.response_record`) in full precision."""
    write_whole(name, [_json(record), b"\n"])


def write_sweep_json(name, rpm, records):
    """Write ``{"rpm": [...], "responses": [...]}``; ``records`` may be a generator, one record is held at a time."""
    head = b'{"rpm": ' + _json(rpm) + b', "responses": ['
    rows = ((b", " if i else b"") + _json(record) for i, record in enumerate(records))
    write_whole(name, [head], rows, [b"]}\n"])


def _json(record):
    return json.dumps(record, allow_nan=False, ensure_ascii=False).encode()


def write_csv(name, heads, rows):
    """Write a table, numbers in full precision."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows(rows)
    write_whole(name, [text.getvalue().encode()])


def write_figure(name, figure):
    """Write a matplotlib figure as the kind its name ends in."""
    content = io.BytesIO()
    figure.savefig(content, format=Path(name).suffix.lower()[1:], dpi=100)
    write_whole(name, [content.getvalue()])

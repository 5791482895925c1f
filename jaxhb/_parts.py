"""Names of files that are being written, and what killed processes leave of them."""

import os
from pathlib import Path

PART = ".part"
"""Ends the name of a file that is being written, after the number of its process."""


def part_of(path):
    """The file beside ``path`` in which this process writes it."""
    path = Path(path)
    return path.with_name(f".{path.name}.{os.getpid()}{PART}")


def clear_parts(folder, pattern="*"):
    """Remove half-written files of processes of this machine that were killed; of names that match a glob pattern."""
    for part in Path(folder).glob(f".{pattern}.*{PART}"):
        owner = part.name.removesuffix(PART).rpartition(".")[2]
        if owner.isdecimal() and not _runs(int(owner)):
            part.unlink(missing_ok=True)


def _runs(process):
    """Whether a process of this machine runs."""
    try:
        os.kill(process, 0)
    except OSError as error:
        return isinstance(error, PermissionError)
    return True

"""Files that appear whole or not at all, and what killed processes leave of them."""

import os
import stat
from pathlib import Path

# Ends the name of a file that is being written, after the number of its process
PART = ".part"


def write_whole(contents, mode=0o666):
    """Write all files or none, of ``{path: iterable of bytes}``: each beside its place
    first, then moved there.

    Nobody ever sees half a file, and what fails leaves none behind; an OSError has the
    path as it was given. A file that is there keeps its mode, a new one gets ``mode``
    less what the process masks.
    """
    beside = {}
    try:
        for name, content in contents.items():
            path = Path(name).resolve()
            beside[name] = path.with_name(
                f".{path.name}.{os.urandom(4).hex()}.{os.getpid()}{PART}"
            )
            with os.fdopen(_new_file(beside[name], path, mode), "wb") as file:
                file.writelines(content)
                file.flush()
                os.fsync(file.fileno())
        for name, part in beside.items():
            os.replace(part, Path(name).resolve())
    except OSError as error:
        error.filename = name
        raise
    finally:
        for part in beside.values():
            part.unlink(missing_ok=True)


def _new_file(part, path, mode):
    """The descriptor of a new file, never one that is there nor what a link points to,
    with the mode of ``path``.
    """
    try:
        there = stat.S_IMODE(path.stat().st_mode)
    except OSError:
        there = None
    opened = os.open(
        part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode if there is None else 0o600
    )
    if there is not None and hasattr(os, "fchmod"):
        os.fchmod(opened, there)
    return opened


def clear_parts(folder, pattern="*"):
    """Remove half-written files of processes of this machine that were killed; of names
    that match a glob pattern.
    """
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

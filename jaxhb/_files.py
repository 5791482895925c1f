"""Files that appear whole or not at all, and the parts that killed processes leave."""

import os
import stat
from collections.abc import Iterable, Mapping
from pathlib import Path

# Ends the name of a file that is being written, after the number of its process
PART = ".part"


def write_whole(
    contents: Mapping[str | Path, Iterable[bytes]], mode: int = 0o666
) -> None:
    """Write all files or none, of ``{path: iterable of bytes}``: each beside its place
    first, then moved there.

    Nobody ever sees half a file, and what fails leaves none behind; an OSError has the
    path as it was given. A file that is there keeps its mode, a new one gets ``mode``
    less what the process masks.
    """
    parts = {}
    try:
        for name, content in contents.items():
            path = Path(name).resolve()
            parts[name] = path.with_name(
                f".{path.name}.{os.urandom(4).hex()}.{os.getpid()}{PART}"
            )
            with os.fdopen(_new_file(parts[name], path, mode), "wb") as file:
                file.writelines(content)
                file.flush()
                os.fsync(file.fileno())
        for name, part in parts.items():
            os.replace(part, Path(name).resolve())
    except OSError as error:
        error.filename = name
        raise
    finally:
        for part in parts.values():
            part.unlink(missing_ok=True)


def _new_file(part: Path, path: Path, mode: int) -> int:
    """The descriptor of a new file, never one that is there nor what a link points to,
    with the mode of ``path``.
    """
    try:
        present_mode = stat.S_IMODE(path.stat().st_mode)
    except OSError:
        present_mode = None
    first_mode = mode if present_mode is None else 0o600
    descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, first_mode)
    if present_mode is not None and hasattr(os, "fchmod"):
        os.fchmod(descriptor, present_mode)
    return descriptor


def clear_parts(folder: str | Path, pattern: str = "*") -> None:
    """Remove half-written files of processes of this machine that were killed, where
    their names match a glob pattern.
    """
    for part in Path(folder).glob(f".{pattern}.*{PART}"):
        owner = part.name.removesuffix(PART).rpartition(".")[2]
        if owner.isdecimal() and not _runs(int(owner)):
            part.unlink(missing_ok=True)


def _runs(process: int) -> bool:
    """Whether a process of this machine runs."""
    try:
        os.kill(process, 0)
    except OSError as error:
        return isinstance(error, PermissionError)
    return True

"""Files that people and scenes name: opened without waiting, regular, up to a size, or
refused with a sentence.
"""

import os
import stat
from pathlib import Path

MOST_BYTES = 8 * 2**20
"""Size of the largest file that is read: a table of some 400,000 rows, a scene of
50,000 elements.
"""

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


_MISSING = "there is no such file. Correct the name."


class Unreadable(ValueError):
    """A file cannot be read: a sentence that says why and what to do, and does not name
    the file.
    """


class Missing(Unreadable):
    """There is no file of a name."""


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """Read the content of a regular file of at most ``most`` bytes, else raise
    :class:`Unreadable`.
    """
    try:
        # Before it is opened: opening alone acts on some devices.
        _refuse(os.stat(path), most)
        # A pipe that took the place of the file would wait for its writer.
        flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
        handle = os.open(path, flags)
        with open(handle, "rb") as file:
            _refuse(os.fstat(handle), most)
            # Files of the system state no size.
            content = file.read(most + 1)
    except Unreadable:
        raise
    except OSError as error:
        if isinstance(error, FileNotFoundError | NotADirectoryError):
            raise Missing(_MISSING) from None
        raise Unreadable(f"the file cannot be read: {error.strerror}.") from None
    except ValueError:  # no file has a null character in its name
        raise Missing(_MISSING) from None
    if len(content) > most:
        raise Unreadable(_too_large("more", most))
    return content


def read_text(path: Path, most: int = MOST_BYTES) -> str:
    """Read the text of a file as by :func:`read_bytes`, line ends as ``\\n``; UTF-8,
    with or without the mark of Windows.
    """
    try:
        text = read_bytes(path, most).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise Unreadable("the file is not UTF-8 text. Save it as UTF-8.") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def is_beside(path: Path, folder: Path) -> bool:
    """Whether a file lies in a folder or below it, links followed: sentences do not
    quote files elsewhere.
    """
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):
        return False


def _refuse(status: os.stat_result, most: int) -> None:
    """Refuse what is no regular file, or too large."""
    kind = stat.S_IFMT(status.st_mode)
    if kind != stat.S_IFREG:
        raise Unreadable(
            f"the file is {_KINDS.get(kind, 'none on a disk')}, must be a regular file."
            " Correct the name."
        )
    if status.st_size > most:
        raise Unreadable(_too_large(f"{status.st_size / 2**20:.0f} MiB", most))


def _too_large(size: str, most: int) -> str:
    return (
        f"the file has {size}, must have at most {most // 2**20} MiB. Leave out"
        " what is not needed."
    )

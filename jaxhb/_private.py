"""A folder of the user alone, and its files: read as they were written there, or not at
all.

What is kept is believed, and programs are run, so that nobody else may have a part in
it. The folder and every file are the user's, others may not write them, and no link is
followed. Each file ends with a keyed hash of its name and its content; the key, which
others cannot read, lies in the folder. What was put there while others could write, or
under another name, is damage like half a file: it is removed and made again.
"""

import contextlib
import errno
import hashlib
import os
import secrets
import stat
from collections.abc import Iterable
from pathlib import Path

from jaxhb._files import write_whole

KEY = ".key"
KEY_BYTES = 32
SEAL_BYTES = 32  # of the keyed hash at the end of a file


class NotPrivate(OSError):
    """A folder or file in which others have a part; its text says what to do."""


class PrivateFolder:
    """A folder whose files are the user's own; made with mode 0700 where there is none.

    An OSError where it cannot be made; NotPrivate where others could have written what
    lies in it.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
        check_private(self.path)
        self.key = self._key()

    def read(self, name: str) -> memoryview | None:
        """The content of a file; None where there is none, and where it is not what was
        written, which is removed.
        """
        try:
            sealed = read_private(self.path / name)
        except FileNotFoundError:
            return None
        except NotPrivate:
            self.remove(name)
            return None
        except OSError:
            return None
        seal = sealed[-SEAL_BYTES:]
        content = memoryview(sealed)[:-SEAL_BYTES]
        if secrets.compare_digest(self._seal(name, [content]), seal):
            return content
        self.remove(name)
        return None

    def write(self, name: str, *parts: bytes) -> None:
        """Write a file, whole or not at all; an OSError where that fails."""
        write_whole({self.path / name: (*parts, self._seal(name, parts))}, mode=0o600)

    def remove(self, name: str) -> None:
        """Remove a file, if it can be."""
        with contextlib.suppress(OSError):
            (self.path / name).unlink()

    def _seal(self, name: str, parts: Iterable[bytes | memoryview]) -> bytes:
        seal = hashlib.blake2b(key=self.key, digest_size=SEAL_BYTES)
        seal.update(name.encode() + b"\0")
        for part in parts:
            seal.update(part)
        return seal.digest()

    def _key(self) -> bytes:
        """The secret of the folder; a new one where there is none that only the user
        can know.
        """
        path = self.path / KEY
        for _ in range(3):
            try:
                key = read_private(path, hidden=True)
                if len(key) == KEY_BYTES:
                    return key
                self.remove(KEY)
            except FileNotFoundError:
                pass
            except NotPrivate:
                self.remove(KEY)
            self._make_key(path)
        raise NotPrivate(
            f"{str(path)!r} cannot be read. Remove the folder: it is made again."
        )

    def _make_key(self, path: Path) -> None:
        """A new secret, unless another process is sooner: linked into place it never
        replaces one that is there.
        """
        part = path.with_name(f"{KEY}.{secrets.token_hex(8)}")
        descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(secrets.token_bytes(KEY_BYTES))
            try:
                os.link(part, path)
            except FileExistsError:
                pass
            except OSError:  # a file system without links
                os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)


def check_private(folder: str | Path) -> None:
    """NotPrivate where a folder is not the user's, or others may write to it."""
    status = os.stat(folder)  # of what a link of the user leads to
    if not stat.S_ISDIR(status.st_mode):
        raise NotPrivate(f"{str(folder)!r} is no folder.")
    if _foreign(status):
        raise NotPrivate(
            f"{str(folder)!r} is not yours alone: others may have written what lies in"
            " it, and a change of its mode does not undo that. Remove it with all that"
            " is in it, or give another folder."
        )


def read_private(path: Path, *, hidden: bool = False) -> bytes:
    """The content of a regular file of the user that others cannot write, nor read if
    ``hidden``; else NotPrivate.
    """
    flags = os.O_RDONLY | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
    # A pipe would wait for somebody to write, and a link leads elsewhere.
    flags |= getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0)
    try:
        descriptor = os.open(path, flags)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENXIO):  # a link, a socket
            raise NotPrivate(f"{str(path)!r} is no file.") from None
        raise
    try:
        status = os.fstat(descriptor)
        readable = (
            hidden
            and hasattr(os, "getuid")
            and status.st_mode & (stat.S_IRWXG | stat.S_IRWXO)
        )
        if not stat.S_ISREG(status.st_mode) or _foreign(status) or readable:
            raise NotPrivate(f"{str(path)!r} is no file of yours alone.")
        with os.fdopen(descriptor, "rb", closefd=False) as file:
            return file.read()
    finally:
        os.close(descriptor)


def is_private(path: Path) -> bool:
    """Whether a path is a file or folder of the user that others cannot write, and no
    link.
    """
    status = os.lstat(path)
    return (
        stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)
    ) and not _foreign(status)


def _foreign(status: os.stat_result) -> bool:
    """Whether others own or may write what has this status."""
    if not hasattr(os, "getuid"):
        return False
    return status.st_uid != os.getuid() or bool(
        status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    )

"""Answers of a command under way, kept in the folder of programs until it is done:
stopped, it goes on there.
"""

import contextlib
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TypeVar

from jaxhb._store import private_folder, processor, sentence_of, tell_once, user_folder
from jaxhb.results.checkpoint import Cached, digest, hash_of, versions
from jaxhb.train.drivetrain import DriveTrain

FOLDER = "under_way"  # in the folder of programs
FORGOTTEN_AFTER = 30  # days, then what a stopped command left is removed
GOES_ON = "the same command goes on from there"

Result = TypeVar("Result")


class Unfinished:
    """A command that can be stopped and goes on: its ``folder``, named for its trains
    and all else that answers depend on; None where none may be.

    Where it cannot be written that is told once, and the command goes on without.
    ``elsewhere``: another folder, which the user named and which stays.
    """

    folder: Cached | Path | None

    def __init__(
        self,
        trains: Sequence[DriveTrain],
        question: tuple,
        elsewhere: str | None = None,
    ):
        self.folder = None
        if elsewhere:
            self.folder = Path(elsewhere)
            return
        base = user_folder()
        if base is None:
            return
        # Other code, packages or processors may find other numbers: then the command
        # begins anew.
        name = digest(
            [hash_of(train) for train in trains],
            versions(),
            repr(processor()),
            question,
        )
        try:
            under_way = private_folder(base, FOLDER).path
            self.folder = Cached(private_folder(under_way, name).path, self._lose)
        except OSError as error:
            self._lose(sentence_of(error))
            return
        for old in under_way.glob("[0-9a-f]" * 32 + "*"):
            with contextlib.suppress(OSError):  # another process may remove it too
                if old.stat().st_mtime < time.time() - 86400 * FORGOTTEN_AFTER:
                    shutil.rmtree(old, ignore_errors=True)

    def _lose(self, reason: str) -> None:
        """Go on without the folder, which cannot be used."""
        self.folder = None
        tell_once(
            "what is found is not kept on disk, and begins anew where it is stopped:"
            f" {reason}"
        )

    def run(self, compute: Callable[[Any], Result], left: Callable[[], str]) -> Result:
        """``compute(folder)``, with None where there is none; ``left()`` says what it
        leaves if stopped.
        """
        several = _of_several.get()
        if several is not None:
            several.append(self)
        try:
            return compute(self.folder)
        except KeyboardInterrupt as stop:
            stop.add_note(left())
            raise

    def left(self) -> str:
        """A sentence on what a command leaves that writes its files at the end."""
        if self.folder is None:
            return "no further files are written"
        return f"no file is written, but intermediate results are kept; {GOES_ON}"

    def forget(self) -> None:
        """Remove it: the command is done; one of several is removed when all are."""
        if isinstance(self.folder, Cached) and _of_several.get() is None:
            shutil.rmtree(self.folder.folder, ignore_errors=True)


_of_several: ContextVar[list[Unfinished] | None] = ContextVar(
    "_of_several", default=None
)
"""Commands of which several are one, None of a command alone."""


@contextlib.contextmanager
def as_one() -> Iterator[None]:
    """Let the folders of the commands of the block be forgotten together, when all are
    done.
    """
    several: list[Unfinished] = []
    token = _of_several.set(several)
    try:
        yield
    except KeyboardInterrupt as stop:
        if any(unfinished.folder for unfinished in several):
            stop.add_note(f"({GOES_ON})")
        raise
    finally:
        _of_several.reset(token)
    for unfinished in several:
        unfinished.forget()

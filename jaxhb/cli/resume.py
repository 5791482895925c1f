"""Answers of a command under way, kept in the folder of programs until it is done:
stopped, it goes on there.
"""

import contextlib
import shutil
import time
from contextvars import ContextVar
from pathlib import Path

from jaxhb._store import private_folder, processor, sentence_of, tell_once, user_folder
from jaxhb.results.checkpoint import Cached, digest, hash_of, versions

FOLDER = "under_way"  # in the folder of programs
FORGOTTEN_AFTER = 30  # days, then what a stopped command left is removed
GOES_ON = "the same command goes on from there"

_of_several: ContextVar[list | None] = ContextVar("_of_several", default=None)
"""What commands of which several are one have kept, None of a command alone."""


class Kept:
    """A folder of a command's own, named for its trains and all else that answers
    depend on; None where none may be.

    Where it cannot be written that is told once, and the command goes on without.
    ``elsewhere``: another folder, which the user asked for and which stays.
    """

    def __init__(self, trains, asked, elsewhere=None):
        self.folder, base = None, user_folder()
        if elsewhere:
            self.folder = Path(elsewhere)
            return
        if base is None:
            return
        # Other code, packages or processors may find other numbers: then the command
        # begins anew.
        name = digest(
            [hash_of(train) for train in trains], versions(), repr(processor()), asked
        )
        try:
            under_way = private_folder(base, FOLDER).path
            self.folder = Cached(private_folder(under_way, name).path, self._lost)
        except OSError as error:
            self._lost(sentence_of(error))
            return
        for old in under_way.glob("[0-9a-f]" * 32 + "*"):
            with contextlib.suppress(OSError):  # another process may remove it too
                if old.stat().st_mtime < time.time() - 86400 * FORGOTTEN_AFTER:
                    shutil.rmtree(old, ignore_errors=True)

    def _lost(self, why):
        """The folder cannot be used."""
        self.folder = None
        tell_once(
            "what is found is not kept on disk, and begins anew where it is stopped:"
            f" {why}"
        )

    def run(self, compute, left):
        """``compute(folder)``, with None where there is none; ``left()`` tells what it
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

    def forget(self):
        """Remove it: the command is done; one of several is removed when all are."""
        if isinstance(self.folder, Cached) and _of_several.get() is None:
            shutil.rmtree(self.folder.folder, ignore_errors=True)


@contextlib.contextmanager
def as_one():
    """Let what the commands of the block have kept be forgotten together, when all are
    done.
    """
    several: list[Kept] = []
    token = _of_several.set(several)
    try:
        yield
    except KeyboardInterrupt as stop:
        if any(kept.folder for kept in several):
            stop.add_note(f"({GOES_ON})")
        raise
    finally:
        _of_several.reset(token)
    for kept in several:
        kept.forget()

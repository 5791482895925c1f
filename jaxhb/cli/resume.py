"""Motions of a command under way, kept in the folder of programs until it is done: stopped, it goes on there."""

import contextlib
import shutil
import time

import jax

from jaxhb._store import blake2, package_hash, user_folder
from jaxhb.steady.checkpoint import CheckpointError, hash_of

FOLDER = "under_way"  # in the folder of programs
FORGOTTEN_AFTER = 30  # days, then what a stopped command left is removed
GOES_ON = "the same command goes on from there"


class Kept:
    """A folder of a command's own, named for its trains and all else that answers depend on; None where none may be."""

    def __init__(self, trains, asked):
        base = user_folder()
        parts = [hash_of(train).encode() for train in trains]
        # Other code or another jax may find other numbers: then the command begins anew.
        name = blake2(*parts, package_hash(), jax.__version__.encode(), repr(asked).encode()).hex()[:32]
        self.folder = base / FOLDER / name if base else None
        for old in (base / FOLDER).glob("[0-9a-f]" * 32) if base else []:
            with contextlib.suppress(OSError):  # another process may remove it too
                if old.stat().st_mtime < time.time() - 86400 * FORGOTTEN_AFTER:
                    shutil.rmtree(old, ignore_errors=True)

    def run(self, compute, left):
        """``compute(folder)``, without a folder where it cannot be used; ``left()`` tells what it leaves if stopped."""
        try:
            return compute(self.folder)
        except CheckpointError:
            if self.folder is None:
                raise
            self.forget()  # the disk is full, or old files there were removed; nobody asked for the folder
            self.folder = None
            return self.run(compute, left)
        except KeyboardInterrupt as stop:
            stop.add_note(left())
            raise

    def forget(self):
        """Remove it: the command is done."""
        if self.folder:
            shutil.rmtree(self.folder, ignore_errors=True)

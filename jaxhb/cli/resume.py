"""Motions of a command under way, kept in the folder of programs until it is done: stopped, it goes on there."""

import contextlib
import time

import jax

from jaxhb._files import PART
from jaxhb._store import blake2, package_hash, user_folder
from jaxhb.steady.checkpoint import MANIFEST, CheckpointError, hash_of

FOLDER = "under_way"
"""In the folder of programs."""

FORGOTTEN_AFTER = 30
"""Days after which what a stopped command left is removed."""

GOES_ON = "the same command goes on from there"


class Kept:
    """A folder of a command's own, under the hash of what was asked; ``folder`` is None where nothing may be kept.

    Parameters
    ----------
    trains : sequence of DriveTrain
    asked : what else the answers depend on, of plain values
    """

    def __init__(self, trains, asked):
        base = user_folder()
        parts = [hash_of(train).encode() for train in trains]
        # Other code or another jax may find other numbers: then the command begins anew.
        name = blake2(*parts, package_hash(), jax.__version__.encode(), repr(asked).encode()).hex()[:32]
        self.folder = None if base is None else base / FOLDER / name
        for old in [] if base is None else (base / FOLDER).glob("[0-9a-f]" * 32):
            with contextlib.suppress(OSError):
                if old.stat().st_mtime < time.time() - 86400 * FORGOTTEN_AFTER:
                    _remove(old)

    def run(self, compute):
        """``compute(folder)``; without a folder where it cannot be used, as nobody asked for it."""
        try:
            return compute(self.folder)
        except CheckpointError:
            if self.folder is None:
                raise
            self.forget()  # the disk is full, or old files there were removed
            self.folder = None
            return compute(None)

    def forget(self):
        """Remove it: the command is done."""
        if self.folder is not None:
            _remove(self.folder)


def _remove(folder):
    """Remove the files of checkpoints below a folder, and the folders that are empty then."""
    for path in [*sorted(folder.rglob("*"), reverse=True), folder]:  # what is in a folder before it
        with contextlib.suppress(OSError):
            if path.is_dir() and not path.is_symlink():
                path.rmdir()
            elif path.name == MANIFEST or path.suffix in (".npz", PART):
                path.unlink()

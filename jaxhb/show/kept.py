"""Motions of a command under way, kept in the folder of programs until it is done: stopped, it goes on there."""

import contextlib
import shutil

import jax

from .._store import blake2, package_hash, user_folder
from ..periodic.checkpoint import CheckpointError, hash_of

FOLDER = "under_way"
"""In the folder of programs."""

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
            with contextlib.suppress(OSError):
                shutil.rmtree(self.folder)

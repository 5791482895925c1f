"""Compiled programs on disk: a process that finds its programs there neither traces nor compiles.

An entry is an executable for one kind of processor, whose name is a hash of all that went into it: the sources of the
package, versions, flags, the processor, the settings of jax, the function, its static arguments, and structure, shapes
and types of the others. What is damaged is made again, what is foreign is never looked at nor removed, and a file
appears whole or not at all, so that processes share a folder. Loading an executable runs what the file says: the folder
belongs to the user alone.
"""

import contextlib
import hashlib
import os
import pickle
import re
import stat
import sys
from functools import cache, cached_property
from pathlib import Path

import jax
import jaxlib.version
import numpy as np
import platformdirs
from jax.experimental import serialize_executable
from jaxlib import lapack

from jaxhb._files import clear_parts, write_whole

VARIABLE = "JAXHB_CACHE"
"""Environment variable: another folder for programs, or "off"."""

LIMIT = 1 << 30
"""Bytes that all programs may take; those not used for longest are removed. A sweep of one train takes some 20 MB."""

SUBFOLDER = "jaxhb-programs"
"""Where programs lie in the folder that the user gives: other things may be beside it."""

JAX_SUBFOLDER = "jax"
"""In SUBFOLDER, of jax's own cache: jax bounds it only where the package filelock is installed."""

SUFFIX = ".program"

_DIGEST = 32
"""Bytes of the digest that stands before a stored program."""

_REMOVABLE = {
    ".": re.compile(rf"[0-9a-f]{{{2 * _DIGEST}}}{re.escape(SUFFIX)}"),
    JAX_SUBFOLDER: re.compile(r".+-[0-9a-f]{64}-cache"),
}
"""Names of what may be removed, by folder: those that this module and jax give to what they write there."""


class Store:
    """A folder of executables; nothing is stored where ``folder`` is None or not the user's own."""

    def __init__(self, folder=None, limit=LIMIT):
        self.folder, self.limit = folder, limit

    @cached_property
    def origin(self):
        """Hash of what all entries of this process have in common."""
        versions = sys.version, jax.__version__, jaxlib.version.__version__
        flags = tuple(os.environ.get(name, "") for name in ("XLA_FLAGS", "LIBTPU_INIT_ARGS"))
        return blake2(package_hash(), repr((versions, flags, _processor())).encode())

    def load(self, key, arguments):
        """The executable of ``key`` for ``arguments``, a jax.stages.Compiled; None where there is none that works."""
        path = self._path(key)
        if path is None:
            return None
        try:
            content = path.read_bytes()
            if blake2(content[_DIGEST:]) != content[:_DIGEST]:
                raise ValueError("damaged")
            lapack.prepare_lapack_call("potrf", np.float64)  # else a loaded program that calls LAPACK crashes
            executable, result = pickle.loads(content[_DIGEST:])
            structures = jax.tree.structure(((arguments,), {})), jax.tree.structure(result)
            device = jax.devices("cpu")[:1]
            loaded = serialize_executable.deserialize_and_load(executable, *structures, execution_devices=device)
            os.utime(path)
        except FileNotFoundError:
            return None
        except Exception:  # whatever is wrong with a file, the program can be made again
            with contextlib.suppress(OSError):
                path.unlink()
            return None
        return loaded

    def save(self, key, compiled):
        """Keep an executable, unless it cannot be or the disk is full: then the next process makes it again."""
        path = self._path(key)
        if path is None:
            return
        # A pullback among the results holds functions of jax that no file can.
        unpickled = AttributeError, TypeError, pickle.PicklingError
        with contextlib.suppress(OSError, ValueError, RuntimeError, *unpickled):
            executable, _, tree = serialize_executable.serialize(compiled)
            content = pickle.dumps((executable, jax.tree.unflatten(tree, range(tree.num_leaves))))
            self.make_room(len(content))
            write_whole({path: (blake2(content), content)})

    def _path(self, key):
        folder = self.own_folder
        return folder and folder / (blake2(self.origin, key.encode()).hex() + SUFFIX)

    @cached_property
    def own_folder(self):
        """The sub-folder of programs as a Path, made if need be; None where others could have written what is in it."""
        if self.folder is None:
            return None
        own = Path(self.folder) / SUBFOLDER
        for folder in (own.parent, own):
            try:
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
                found = folder.stat()
            except OSError:
                return None
            if hasattr(os, "getuid") and (found.st_uid != os.getuid() or found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)):
                print(
                    f"jaxhb: programs are not kept in {folder}, which others may write. Make it yours alone (chmod "
                    f"700), or give another folder in {VARIABLE}.",
                    file=sys.stderr,
                )
                return None
        return own

    def make_room(self, size=0):
        """Remove programs until ``size`` more bytes fit, those not used for longest first, and what was half written
        by processes that were killed."""
        clear_parts(self.own_folder, "[0-9a-f]" * 2 * _DIGEST + SUFFIX)
        found = []
        for folder, name in _REMOVABLE.items():
            with contextlib.suppress(OSError), os.scandir(self.own_folder / folder) as entries:
                for entry in entries:
                    if name.fullmatch(entry.name) and entry.is_file(follow_symlinks=False):
                        found.append((entry.stat().st_mtime, entry.stat().st_size, entry.path))
        total = size + sum(size for _, size, _ in found)
        for _, own, path in sorted(found):
            if total <= self.limit:
                return
            with contextlib.suppress(OSError):
                os.unlink(path)
                total -= own


def user_folder():
    """Where the user wants programs kept: the folder in JAXHB_CACHE, None if it is "off", else in the user's cache."""
    chosen = os.environ.get(VARIABLE)
    if chosen:
        return None if chosen.lower() in ("off", "0", "none") else Path(chosen)
    return platformdirs.user_cache_path("jaxhb", appauthor=False, opinion=False)


@cache
def package_hash():
    """Hash of the sources of the package."""
    sources = sorted(Path(__file__).parent.rglob("*.py"))
    return blake2(*(path.read_bytes() for path in sources))


def blake2(*parts):
    """BLAKE2 of several byte strings."""
    found = hashlib.blake2b(digest_size=_DIGEST)
    for part in parts:
        found.update(len(part).to_bytes(8, "little") + part)
    return found.digest()


def _processor():
    """What an executable depends on: another processor may lack its instructions."""
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().split("\n\n")[0].splitlines()
        return [line for line in lines if line.startswith(("model name", "flags", "Features", "CPU part"))]
    import platform

    return platform.machine(), platform.processor(), platform.version()

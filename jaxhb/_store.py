"""Compiled programs on disk: a process that finds its programs there neither traces nor
compiles.

An entry is an executable for one kind of processor, whose name is a hash of all that
went into it: the sources of the package, versions, flags, the processor, the settings
of jax, the function, its static arguments, and structure, shapes and types of the
others. What is damaged is made again, what is foreign is never looked at nor removed,
and a file appears whole or not at all, so that processes share a folder. Loading an
executable runs what the file says: only what this user wrote there under this name is
loaded (:mod:`jaxhb._private`).
"""

import contextlib
import hashlib
import os
import pickle
import re
import sys
from collections.abc import Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import jax
import jaxlib.version
import numpy as np
import platformdirs
from jax.experimental import serialize_executable
from jaxlib import lapack

from jaxhb._files import clear_parts
from jaxhb._private import NotPrivate, PrivateFolder, check_private, is_private

VARIABLE = "JAXHB_CACHE"
"""Environment variable: another folder for programs, or "off"."""

LIMIT = 1 << 30
"""Bytes that all programs may take; those not used for longest are removed. A sweep of
one train takes some 20 MB.
"""

SUBFOLDER = "jaxhb-programs"
"""Where programs lie in the folder that the user gives: other things may be beside
it.
"""

JAX_SUBFOLDER = "jax"
"""In SUBFOLDER, of jax's own cache: jax bounds it only where the package filelock is
installed.
"""

SUFFIX = ".program"

_DIGEST = 32
"""Bytes of a digest."""

_REMOVABLE = {
    ".": re.compile(rf"[0-9a-f]{{{2 * _DIGEST}}}{re.escape(SUFFIX)}"),
    JAX_SUBFOLDER: re.compile(r".+-[0-9a-f]{64}-cache"),
}
"""Names of what may be removed, by folder: those that this module and jax give to what
they write there.
"""


class Store:
    """A folder of executables; nothing is stored where ``folder`` is None or not the
    user's own.
    """

    def __init__(self, folder: Path | None = None, limit: int = LIMIT):
        self.folder = folder
        self.limit = limit

    @cached_property
    def origin(self) -> bytes:
        """Hash of what all entries of this process have in common."""
        versions = (sys.version, jax.__version__, jaxlib.version.__version__)
        flags = tuple(
            os.environ.get(name, "") for name in ("XLA_FLAGS", "LIBTPU_INIT_ARGS")
        )
        return blake2(package_hash(), repr((versions, flags, processor())).encode())

    def load(self, key: str, arguments: Mapping[str, Any]) -> Any:
        """The executable of ``key`` for ``arguments``, a jax.stages.Compiled; None
        where there is none that works.
        """
        if self.private is None:
            return None
        name = self._name(key)
        content = self.private.read(name)
        if content is None:
            return None
        try:
            # Without it a loaded program that calls LAPACK crashes.
            lapack.prepare_lapack_call("potrf", np.float64)
            executable, result = pickle.loads(content)
            structures = (
                jax.tree.structure(((arguments,), {})),
                jax.tree.structure(result),
            )
            device = jax.devices("cpu")[:1]
            loaded = serialize_executable.deserialize_and_load(
                executable, *structures, execution_devices=device
            )
        except Exception:  # whatever is wrong with a program, it can be made again
            self.private.remove(name)
            return None
        with contextlib.suppress(OSError):  # another process may have removed it
            os.utime(self.private.path / name)
        return loaded

    def holds(self, key: str) -> bool:
        """Whether there is an executable of ``key``, which may turn out not to work."""
        if self.private is None:
            return False
        return (self.private.path / self._name(key)).exists()

    def save(self, key: str, compiled: Any) -> None:
        """Keep an executable, unless it cannot be or the disk is full: then the next
        process makes it again.
        """
        if self.private is None:
            return
        # A pullback among the results holds functions of jax that no file can.
        unpicklable = (AttributeError, TypeError, pickle.PicklingError)
        failures = (OSError, ValueError, RuntimeError, *unpicklable)
        with contextlib.suppress(*failures):
            executable, _, tree = serialize_executable.serialize(compiled)
            result = jax.tree.unflatten(tree, range(tree.num_leaves))
            content = pickle.dumps((executable, result))
            self.make_room(len(content))
            self.private.write(self._name(key), content)

    def _name(self, key: str) -> str:
        return blake2(self.origin, key.encode()).hex() + SUFFIX

    @property
    def own_folder(self) -> Path | None:
        """The sub-folder of programs; None where nothing is kept."""
        return None if self.private is None else self.private.path

    @cached_property
    def private(self) -> PrivateFolder | None:
        """The PrivateFolder of programs, made if need be; None where others could have
        written what is in it.
        """
        if self.folder is None:
            return None
        try:
            return private_folder(self.folder, SUBFOLDER)
        except NotPrivate as refusal:
            tell_once(f"programs are not kept on disk: {refusal}")
        except OSError:  # it cannot be made: then every process compiles
            pass
        return None

    def jax_folder(self) -> Path | None:
        """The folder for jax's own cache, which believes what it finds: files of others
        are removed before.
        """
        if self.own_folder is None:
            return None
        folder = self.own_folder / JAX_SUBFOLDER
        try:
            folder.mkdir(mode=0o700, exist_ok=True)
            check_private(folder)
            for path in folder.iterdir():
                if not is_private(path):
                    path.unlink()
        except NotPrivate as refusal:
            tell_once(f"what jax compiles is not kept on disk: {refusal}")
            return None
        except OSError:
            return None
        return folder

    def make_room(self, size: int = 0) -> None:
        """Remove programs until ``size`` more bytes fit, those not used for longest
        first, and what was half written by processes that were killed.
        """
        if self.own_folder is None:
            return
        clear_parts(self.own_folder, "[0-9a-f]" * 2 * _DIGEST + SUFFIX)
        programs = []
        for subfolder, name in _REMOVABLE.items():
            folder = self.own_folder / subfolder
            with contextlib.suppress(OSError), os.scandir(folder) as entries:
                for entry in entries:
                    is_file = entry.is_file(follow_symlinks=False)
                    if is_file and name.fullmatch(entry.name):
                        status = entry.stat()
                        programs.append((status.st_mtime, status.st_size, entry.path))
        total = size + sum(program_size for _, program_size, _ in programs)
        for _, program_size, path in sorted(programs):
            if total <= self.limit:
                return
            with contextlib.suppress(OSError):
                os.unlink(path)
                total -= program_size


def private_folder(base: Path | str, *names: str) -> PrivateFolder:
    """The PrivateFolder of the name in the folder ``base``, of which and of all in
    between others have no part.
    """
    folder = Path(base)
    for name in names:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        check_private(folder)
        folder /= name
    return PrivateFolder(folder)


_printed: set[str] = set()


def tell_once(sentence: str) -> None:
    """Print a sentence on stderr, once in a process."""
    if sentence not in _printed:
        _printed.add(sentence)
        print(f"jaxhb: {sentence}", file=sys.stderr)


def sentence_of(error: OSError) -> str:
    """An OSError in the words of a note."""
    if error.strerror is None:  # a NotPrivate says it all
        return str(error)
    return (
        f"{str(error.filename)!r} cannot be written ({error.strerror}); {VARIABLE}"
        " names another folder."
    )


def user_folder() -> Path | None:
    """The folder in which the user wants programs kept: that of JAXHB_CACHE, None if it
    is "off", else in the user's cache.
    """
    chosen = os.environ.get(VARIABLE)
    if chosen:
        return None if chosen.lower() in ("off", "0", "none") else Path(chosen)
    return platformdirs.user_cache_path("jaxhb", appauthor=False, opinion=False)


@cache
def package_hash() -> bytes:
    """Hash of the sources of the package."""
    sources = sorted(Path(__file__).parent.rglob("*.py"))
    return blake2(*(path.read_bytes() for path in sources))


def blake2(*parts: bytes) -> bytes:
    """BLAKE2 of several byte strings."""
    digest = hashlib.blake2b(digest_size=_DIGEST)
    for part in parts:
        digest.update(len(part).to_bytes(8, "little") + part)
    return digest.digest()


def processor() -> Sequence[str]:
    """The processor as an executable depends on it: another may lack its
    instructions.
    """
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().split("\n\n")[0].splitlines()
        return [
            line
            for line in lines
            if line.startswith(("model name", "flags", "Features", "CPU part"))
        ]
    import platform

    return platform.machine(), platform.processor(), platform.version()

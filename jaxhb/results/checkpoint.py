"""What is found, written to a folder as the work goes, part by part: work that was
stopped goes on where it was.

A part is what is asked for at a time and what is found, and its file has the name of a
hash of the question; asked again, the answer is read. As questions follow from answers
alone, work that goes on gives the same numbers to the last bit. A file appears whole or
not at all, and is believed only as it was written (:mod:`jaxhb._private`).
"""

import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import jax
import numpy as np

from jaxhb import __version__
from jaxhb._files import clear_parts, write_whole
from jaxhb._private import NotPrivate, PrivateFolder, read_private
from jaxhb._store import blake2, package_hash
from jaxhb.results.serial import pack, unpack

MANIFEST = "sweep.json"

CHUNK = 64  # speeds of a chunk by default: as many as are marched side by side
PACKAGES = (
    "numpy",
    "scipy",
    "jax",
    "jaxlib",
    "optax",
)  # others of them may find other last digits


class CheckpointError(ValueError):
    """A folder that holds something else, or that cannot be written: a sentence for the
    user.
    """


@dataclass(frozen=True)
class Cached:
    """A folder that nobody asked for: work goes on without it where it cannot be
    written, and ``lost`` is told why.
    """

    folder: Path
    lost: Callable[[str], object]

    def __truediv__(self, name: str) -> "Cached":
        return Cached(self.folder / name, self.lost)


class Checkpoint:
    """A folder of what is found for one train, for one way of asking.

    ``folder``: a path, or a :class:`Cached` one; ``asked``: values that the answers
    depend on beside the train, by the name under which a sentence speaks of them;
    ``chunk``: speeds that are computed and written together, None of work in other
    parts. A CheckpointError for a folder that holds anything else, be it of another
    train, other sources of the package or other options, for one in which others could
    write, and for one that cannot be written, unless it is Cached.
    """

    def __init__(self, folder, train, asked, chunk=CHUNK):
        if chunk is not None and not (
            isinstance(chunk, int | np.integer) and chunk >= 1
        ):
            raise CheckpointError(
                f"chunk is {chunk!r}: give a whole number of speeds, at least 1."
            )
        self.lost = folder.lost if isinstance(folder, Cached) else None
        self.folder = Path(folder.folder if self.lost else folder)
        self.chunk = chunk
        options = {} if chunk is None else {"speeds of a chunk": int(chunk)}
        options |= {name: _told(value) for name, value in asked.items()}
        now = {
            "scene": train.topology.name,
            "numbers": hash_of(train),
            "versions": versions(),
            "options": options,
        }
        self.origin = digest(now)
        self.private = None
        try:
            self.private = PrivateFolder(self.folder)
            self._open(now)
        except OSError as error:
            self._fail(error)

    def _open(self, now):
        """Begin in an empty folder, go on in one that answers the same question."""
        clear_parts(self.folder)
        if (self.folder / MANIFEST).exists():
            try:
                self._compare(now)
                return
            except CheckpointError:
                if self.lost is None:
                    raise
                for path in self.folder.glob(
                    "*.npz"
                ):  # nobody asked for it: the work begins anew
                    path.unlink(missing_ok=True)
        elif (
            any(not path.name.startswith(".") for path in self.folder.iterdir())
            and self.lost is None
        ):
            raise CheckpointError(
                f"{str(self.folder)!r} holds other files. Give this sweep a folder of"
                " its own."
            )
        manifest = json.dumps(now, indent=1, ensure_ascii=False).encode()
        write_whole({self.folder / MANIFEST: [manifest]}, mode=0o600)

    def _compare(self, now):
        """Refuse a folder whose answers are to other questions."""
        place = repr(str(self.folder))
        other = "Give another folder, or remove this one."
        try:
            there = json.loads(read_private(self.folder / MANIFEST))
            parts = (
                there["scene"],
                there["numbers"],
                there["versions"].items(),
                there["options"].items(),
            )
        except (ValueError, KeyError, TypeError, AttributeError, OSError):
            raise CheckpointError(
                f"{place} has no readable {MANIFEST}: it is no folder of a sweep."
                f" {other}"
            ) from None
        if parts[:2] != (now["scene"], now["numbers"]):
            scene = there["scene"]
            what = (
                "the same scene with other numbers"
                if scene == now["scene"]
                else f"scene {scene!r}"
            )
            raise CheckpointError(f"{place} holds a sweep of {what}. {other}")
        for kind in ("versions", "options"):
            for name, value in now[kind].items():
                if there[kind].get(name) != value:
                    was = f"{name} {there[kind].get(name)} there, {value} now"
                    raise CheckpointError(
                        f"{place} holds a sweep with other {kind}: {was}. {other}"
                    )

    def keep_or_march(self, classifier, indices, motions, progress):
        """What ``classifier.march_to_the_end`` gives of the speeds of a chunk, from the
        folder where it is there.
        """
        given = [index in motions for index in indices]

        def compute():
            found = classifier.march_to_the_end(indices, motions, progress)
            return [found[index] for index in indices]

        states = self.keep(
            (classifier.speeds[indices], given, *motions.values()), compute, progress
        )
        return dict(zip(indices, states, strict=True))

    def keep(self, question, compute, progress=lambda count: None):
        """What ``compute()`` gives to a question, of values that :func:`pack` takes,
        from the folder where it is there; then ``progress`` is called with the number
        of its parts, if it is a list.
        """
        name = f"{digest(self.origin, question)}.npz"
        answer = self._read(name)
        if answer is not None:
            progress(len(answer) if isinstance(answer, list) else 1)
            return answer
        answer = compute()
        if self.private is not None:
            try:
                self.private.write(name, _content(answer))
            except OSError as error:
                self._fail(error)
        return answer

    def _read(self, name):
        """The answer of a file; None where it is not there, or not as it was written:
        then it is computed again.
        """
        content = self.private and self.private.read(name)
        if content is None:
            return None
        try:
            with np.load(io.BytesIO(content), allow_pickle=False) as file:
                index = json.loads(file["index"].tobytes())
                return unpack(
                    index, [file[f"a{i}"] for i in range(len(file.files) - 1)]
                )
        except Exception:  # whatever a damaged file does to its reader
            return None

    def _fail(self, error):
        """Say that the folder cannot be used: an error where it was asked for, else the
        work goes on without it.
        """
        if isinstance(error, NotPrivate):
            why = str(error)
        else:
            why = f"{str(self.folder)!r} cannot be written: {error.strerror}."
        self.private = None
        if self.lost is not None:
            self.lost(why)
            return
        stays = (
            ""
            if isinstance(error, NotPrivate)
            else " What is in it stays: mend that, and the same sweep goes on."
        )
        raise CheckpointError(why + stays) from None


def place_in(folder, name):
    """A folder of the name in a path or :class:`Cached`; None in None."""
    if folder is None:
        return None
    return (folder if isinstance(folder, Cached) else Path(folder)) / name


def computed(question, compute, progress=None):
    """What ``compute()`` gives, which is kept nowhere."""
    return compute()


def keeper(folder, train, asked, chunk=None):
    """``keep(question, compute)`` of a :class:`Checkpoint`; without a folder what is
    asked for is computed.
    """
    if folder is None:
        return computed
    return Checkpoint(folder, train, asked, chunk).keep


def _content(answer):
    """An answer as the bytes of a file of arrays."""
    index, arrays = pack(answer)
    text = np.frombuffer(json.dumps(index).encode(), dtype=np.uint8)
    content = io.BytesIO()
    np.savez(content, index=text, **{f"a{i}": array for i, array in enumerate(arrays)})
    return content.getvalue()


def _told(value):
    """A value of what is asked as the manifest tells it: plain where it is plain, else
    by its digest.
    """
    plain = value is None or type(value) in (bool, int, float, str)
    return value if plain else digest(value)


@cache
def versions():
    """Versions of all that answers depend on, by name."""
    found = {"jaxhb": __version__, "sources of jaxhb": package_hash().hex()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = ""
    return found


def hash_of(train):
    """Hash of all that a train is: its numbers, names and connections, in hexadecimal
    digits.
    """
    leaves, tree = jax.tree.flatten(train)
    return digest([np.asarray(leaf) for leaf in leaves], repr(tree))


def digest(*values):
    """Hash of all digits of values that :func:`pack` takes, in hexadecimal digits."""
    index, arrays = pack(values)
    shapes = repr([(array.shape, array.dtype.str) for array in arrays])
    return blake2(
        json.dumps(index).encode(),
        shapes.encode(),
        *(array.tobytes() for array in arrays),
    ).hex()

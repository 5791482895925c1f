"""Motions written to a folder as a sweep goes, chunk by chunk: a sweep that was stopped goes on where it was.

A sweep asks for the motions of some speeds at a time, from given ones. What it asks for and what it gets is one
file, whose name is a hash of the question; asked again, the answer is read. As the questions follow from the answers
alone, a sweep that goes on gives the same numbers to the last bit. A file appears whole or not at all.
"""

import contextlib
import io
import json
from pathlib import Path

import jax
import numpy as np

from jaxhb import __version__
from jaxhb._files import clear_parts, write_whole
from jaxhb._store import blake2, package_hash
from jaxhb.results.serial import pack, unpack

MANIFEST = "sweep.json"

CHUNK = 64  # speeds of a chunk by default: as many as are marched side by side


class CheckpointError(ValueError):
    """A folder that holds something else, or that cannot be written: a sentence for the user."""


class Checkpoint:
    """A folder of steady states or periodic solutions of one train, for one way of asking.

    ``asked``: plain values that the answers depend on beside the train, by the name under which a sentence speaks of
    it; ``chunk``: speeds that are computed and written together. A CheckpointError for a folder that holds anything
    else, be it of another train, other sources of the package or other options, and for one that cannot be written.
    """

    def __init__(self, folder, train, asked, chunk=CHUNK):
        if not (isinstance(chunk, int | np.integer) and chunk >= 1):
            raise CheckpointError(f"chunk is {chunk!r}: give a whole number of speeds, at least 1.")
        self.folder, self.chunk = Path(folder), int(chunk)
        versions = {"jaxhb": __version__, "jax": jax.__version__, "numpy": np.__version__}
        versions["sources of jaxhb"] = package_hash().hex()[:16]
        options = {"speeds of a chunk": self.chunk, **asked}
        now = {"scene": train.topology.name, "numbers": hash_of(train), "versions": versions, "options": options}
        with self._sentence():
            self.folder.mkdir(parents=True, exist_ok=True)
            clear_parts(self.folder)
            if not (self.folder / MANIFEST).exists():
                if any(not path.name.startswith(".") for path in self.folder.iterdir()):
                    raise CheckpointError(f"{str(folder)!r} holds other files. Give this sweep a folder of its own.")
                self._write(MANIFEST, json.dumps(now, indent=1, ensure_ascii=False).encode())
        self._compare(now)

    def _compare(self, now):
        """Refuse a folder whose answers are to other questions."""
        place, other = repr(str(self.folder)), "Give another folder, or remove this one."
        try:
            there = json.loads((self.folder / MANIFEST).read_text())
            parts = there["scene"], there["numbers"], there["versions"].items(), there["options"].items()
        except (ValueError, KeyError, TypeError, AttributeError, OSError):
            raise CheckpointError(f"{place} has no readable {MANIFEST}: it is no folder of a sweep. {other}") from None
        if parts[:2] != (now["scene"], now["numbers"]):
            scene = there["scene"]
            what = "the same scene with other numbers" if scene == now["scene"] else f"scene {scene!r}"
            raise CheckpointError(f"{place} holds a sweep of {what}. {other}")
        for kind in ("versions", "options"):
            for name, value in now[kind].items():
                if there[kind].get(name) != value:
                    was = f"{name} {there[kind].get(name)} there, {value} now"
                    raise CheckpointError(f"{place} holds a sweep with other {kind}: {was}. {other}")

    def keep_or_march(self, classifier, indices, motions, progress):
        """What ``classifier.march_to_the_end`` gives of the speeds of a chunk, from the folder where it is there."""
        given = [index in motions for index in indices]

        def compute():
            found = classifier.march_to_the_end(indices, motions, progress)
            return [found[index] for index in indices]

        states = self.keep((classifier.speeds[indices], given, *motions.values()), compute, progress)
        return dict(zip(indices, states, strict=True))

    def keep(self, question, compute, progress):
        """The list of states that ``compute()`` gives to a question (arrays), from the folder where it is there; then
        ``progress`` is called with the number of those read."""
        name = f"{_hash(*question)}.npz"
        states = self._read(name)
        if states is not None:
            progress(len(states))
            return states
        states, content = compute(), io.BytesIO()
        index, arrays = pack(states)
        text = np.frombuffer(json.dumps(index).encode(), dtype=np.uint8)
        np.savez(content, index=text, **{f"a{i}": array for i, array in enumerate(arrays)})
        self._write(name, content.getvalue())
        return states

    def _read(self, name):
        """The states of a file; None where it is not there, or not readable: then they are computed again."""
        try:
            content = io.BytesIO((self.folder / name).read_bytes())
            with np.load(content, allow_pickle=False) as file:
                index = json.loads(file["index"].tobytes())
                return unpack(index, [file[f"a{i}"] for i in range(len(file.files) - 1)])
        except Exception:  # whatever a damaged file does to its reader
            return None

    def _write(self, name, content):
        with self._sentence():
            write_whole({self.folder / name: [content]})

    @contextlib.contextmanager
    def _sentence(self):
        try:
            yield
        except OSError as error:
            raise CheckpointError(
                f"{str(self.folder)!r} cannot be written: {error.strerror}. What is in it stays: mend that, and the "
                "same sweep goes on."
            ) from None


def hash_of(train):
    """Hash of all that a train is: its numbers, names and connections, in hexadecimal digits."""
    leaves, tree = jax.tree.flatten(train)
    return _hash(*leaves, np.frombuffer(repr(tree).encode(), dtype=np.uint8))


def _hash(*arrays):
    """Hash of arrays, in hexadecimal digits."""
    arrays = [np.asarray(array) for array in arrays]
    return blake2(*(repr((a.shape, a.dtype.str)).encode() + a.tobytes() for a in arrays)).hex()[:32]

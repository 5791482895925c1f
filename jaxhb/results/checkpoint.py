"""Checkpoints: answers written to a folder as the work goes, part by part, so that work
that was stopped goes on where it was.

A part is a question and its answer. Its file is named by a hash of the question; the
next time the question comes, the answer is read. As questions follow from answers
alone, work that goes on gives the same numbers to the last bit. A file appears whole or
not at all, and is believed only as it was written (:mod:`jaxhb._private`).
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeVar

import jax
import numpy as np

from jaxhb import __version__
from jaxhb._executors import WorkerLost, in_parts
from jaxhb._files import clear_parts, write_whole
from jaxhb._private import NotPrivate, PrivateFolder, read_private
from jaxhb._store import blake2, package_hash
from jaxhb.results.serial import pack, unpack
from jaxhb.train.drivetrain import DriveTrain

Answer = TypeVar("Answer")

MANIFEST = "sweep.json"

CHUNK = 64  # speeds of a chunk by default: as many as are marched side by side
# Other versions of these may give other last digits
PACKAGES = ("numpy", "scipy", "jax", "jaxlib", "optax")


class CheckpointError(ValueError):
    """A folder holds something else, or cannot be written: a sentence for the user."""


@dataclass(frozen=True)
class Cached:
    """A folder that nobody asked for: work goes on without it where it cannot be
    written, and ``lost`` is called with the reason.
    """

    folder: Path
    lost: Callable[[str], object]

    def __truediv__(self, name: str) -> Cached:
        return Cached(self.folder / name, self.lost)


class Checkpoint:
    """A folder of answers for one train and one set of options.

    ``folder``: a path, or a :class:`Cached` one; ``settings``: values that the answers
    depend on beside the train, by the name under which a sentence speaks of them;
    ``chunk``: speeds that are computed and written together, None for work in other
    parts. A CheckpointError for a folder that holds anything else, be it of another
    train, other sources of the package or other options, for one in which other users
    could write, and for one that cannot be written, unless it is Cached.
    """

    def __init__(
        self,
        folder: str | Path | Cached,
        train: DriveTrain,
        settings: Mapping[str, Any],
        chunk: int | None = CHUNK,
    ):
        if chunk is not None and not (
            isinstance(chunk, int | np.integer) and chunk >= 1
        ):
            raise CheckpointError(
                f"chunk is {chunk!r}: give a whole number of speeds, at least 1."
            )
        self.lost = folder.lost if isinstance(folder, Cached) else None
        self.folder = Path(folder.folder if isinstance(folder, Cached) else folder)
        self.chunk = chunk
        options = {} if chunk is None else {"speeds of a chunk": int(chunk)}
        options |= {name: _manifest_value(value) for name, value in settings.items()}
        manifest = {
            "scene": train.topology.name,
            "numbers": hash_of(train),
            "versions": versions(),
            "options": options,
        }
        self.origin = digest(manifest)
        self.private = None
        try:
            self.private = PrivateFolder(self.folder)
            self._open(manifest)
        except OSError as error:
            self._fail(error)

    def _open(self, manifest: dict[str, Any]) -> None:
        """Begin in an empty folder, go on in one with the same manifest."""
        clear_parts(self.folder)
        if (self.folder / MANIFEST).exists():
            try:
                self._compare(manifest)
                return
            except CheckpointError:
                if self.lost is None:
                    raise
                # Nobody asked for this folder: the work begins anew.
                for path in self.folder.glob("*.npz"):
                    path.unlink(missing_ok=True)
        elif (
            any(not path.name.startswith(".") for path in self.folder.iterdir())
            and self.lost is None
        ):
            raise CheckpointError(
                f"{str(self.folder)!r} holds other files. Give this sweep a folder of"
                " its own."
            )
        content = json.dumps(manifest, indent=1, ensure_ascii=False).encode()
        write_whole({self.folder / MANIFEST: [content]}, mode=0o600)

    def _compare(self, manifest: dict[str, Any]) -> None:
        """Refuse a folder with another manifest: its answers are to other questions."""
        place = repr(str(self.folder))
        remedy = "Give another folder, or remove this one."
        try:
            stored = json.loads(read_private(self.folder / MANIFEST))
            stored_parts = (
                stored["scene"],
                stored["numbers"],
                stored["versions"].items(),
                stored["options"].items(),
            )
        except (ValueError, KeyError, TypeError, AttributeError, OSError):
            raise CheckpointError(
                f"{place} has no readable {MANIFEST}: it is no folder of a sweep."
                f" {remedy}"
            ) from None
        if stored_parts[:2] != (manifest["scene"], manifest["numbers"]):
            scene = stored["scene"]
            description = (
                "the same scene with other numbers"
                if scene == manifest["scene"]
                else f"scene {scene!r}"
            )
            raise CheckpointError(f"{place} holds a sweep of {description}. {remedy}")
        for kind in ("versions", "options"):
            for change in changes(stored[kind], manifest[kind]):
                raise CheckpointError(
                    f"{place} holds a sweep with other {kind}: {change}. {remedy}"
                )

    def keep(
        self,
        question: Any,
        compute: Callable[[], Answer],
        progress: Callable[[int], object] = lambda count: None,
    ) -> Answer:
        """Answer a question, made of values that :func:`pack` takes, from the folder;
        where the answer is not there, by ``compute()``.

        ``progress`` is called for an answer that was read: with its length if it is a
        list, else with 1.
        """
        answer = self.find(question)
        if answer is not None:
            progress(len(answer) if isinstance(answer, list) else 1)
            return answer
        answer = compute()
        self.write(question, answer)
        return answer

    def find(self, question: Any) -> Any:
        """The answer to a question that is in the folder, else None."""
        return self._read(self._name(question))

    def write(self, question: Any, answer: Any) -> None:
        """Write the answer to a question."""
        if self.private is not None:
            try:
                self.private.write(self._name(question), _content(answer))
            except OSError as error:
                self._fail(error)

    def _name(self, question: Any) -> str:
        return f"{digest(self.origin, question)}.npz"

    def _read(self, name: str) -> Any:
        """The answer of a file; None where it is not there, or not as it was written:
        then it is computed again.
        """
        content = None if self.private is None else self.private.read(name)
        if content is None:
            return None
        try:
            with np.load(io.BytesIO(content), allow_pickle=False) as file:
                index = json.loads(file["index"].tobytes())
                return unpack(
                    index, [file[f"a{i}"] for i in range(len(file.files) - 1)]
                )
        # Whatever a damaged file does to its reader.
        except Exception:
            return None

    def _fail(self, error: OSError) -> None:
        """Give up the folder: an error where the user chose it, else the work goes on
        without it.
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


def changes(stored: Mapping[str, Any], present: Mapping[str, Any]) -> Iterator[str]:
    """Yield in words each value of a manifest that differs from the one stored."""
    for name, value in present.items():
        if stored.get(name) != value:
            yield f"{name} {stored.get(name)} there, {value} now"


def answered_parts(
    checkpoint: Checkpoint | None,
    questions: Sequence[Any],
    function: Callable[..., Answer],
    parts: Sequence[Sequence[Any]],
    executor: Executor | None,
    note: Callable[[Answer], object] = lambda answer: None,
    lost: Callable[[int, WorkerLost], Answer] | None = None,
) -> Generator[tuple[int, Answer]]:
    """Yield the number and the answer of parts of a work, as they come: those in the
    folder of a Checkpoint first, then ``function(*part)`` of the others, by an executor
    or in this process.

    ``note`` is called with an answer that this process does not compute; ``lost`` is
    that of :func:`in_parts`, and what it gives is not written: the part is tried again
    when the work goes on.
    """
    missing: list[int] = []
    given_up: set[int] = set()

    def give_up(place: int, failure: WorkerLost) -> Answer:
        if lost is None:
            raise failure
        given_up.add(missing[place])
        return lost(missing[place], failure)

    for number, question in enumerate(questions):
        answer = None if checkpoint is None else checkpoint.find(question)
        if answer is None:
            missing.append(number)
        else:
            note(answer)
            yield number, answer
    missing_parts = (parts[number] for number in missing)
    computed_parts = in_parts(function, missing_parts, executor, give_up)
    for place, answer in computed_parts:
        number = missing[place]
        if executor is not None:
            note(answer)
        if checkpoint is not None and number not in given_up:
            checkpoint.write(questions[number], answer)
        yield number, answer


def place_in(folder: str | Path | Cached | None, name: str) -> Path | Cached | None:
    """Return the folder of that name in a path or :class:`Cached`; None for None."""
    if folder is None:
        return None
    return (folder if isinstance(folder, Cached) else Path(folder)) / name


def computed(
    question: Any,
    compute: Callable[[], Answer],
    progress: Callable[[int], object] | None = None,
) -> Answer:
    """Answer any question by ``compute()``, and keep the answer nowhere."""
    return compute()


def keeper(
    folder: str | Path | Cached | None,
    train: DriveTrain,
    settings: Mapping[str, Any],
    chunk: int | None = None,
) -> Callable[..., Any]:
    """Return :meth:`Checkpoint.keep` of a folder; without one :func:`computed`."""
    if folder is None:
        return computed
    return Checkpoint(folder, train, settings, chunk).keep


def _content(answer: Any) -> bytes:
    """An answer as the bytes of a file of arrays."""
    index, arrays = pack(answer)
    text = np.frombuffer(json.dumps(index).encode(), dtype=np.uint8)
    content = io.BytesIO()
    by_name: dict[str, Any] = {f"a{i}": array for i, array in enumerate(arrays)}
    np.savez(content, index=text, **by_name)
    return content.getvalue()


def _manifest_value(value: Any) -> Any:
    """A setting as the manifest holds it: plain where it is plain, else its digest."""
    plain = value is None or type(value) in (bool, int, float, str)
    return value if plain else digest(value)


@cache
def versions() -> dict[str, str]:
    """Versions of everything that answers depend on, by name."""
    by_name = {"jaxhb": __version__, "sources of jaxhb": package_hash().hex()}
    for package in PACKAGES:
        try:
            by_name[package] = version(package)
        except PackageNotFoundError:
            by_name[package] = ""
    return by_name


def hash_of(train: DriveTrain) -> str:
    """Hash of a whole train, its numbers, names and connections, in hexadecimal
    digits.
    """
    leaves, tree = jax.tree.flatten(train)
    return digest([np.asarray(leaf) for leaf in leaves], repr(tree))


def digest(*values: Any) -> str:
    """Hash of all digits of values that :func:`pack` takes, in hexadecimal digits."""
    index, arrays = pack(values)
    shapes = repr([(array.shape, array.dtype.str) for array in arrays])
    return blake2(
        json.dumps(index).encode(),
        shapes.encode(),
        *(array.tobytes() for array in arrays),
    ).hex()

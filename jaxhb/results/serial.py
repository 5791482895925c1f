"""Results of the package as plain values and arrays, for files that run nothing when
they are read.
"""

import dataclasses
import enum
import importlib
import json
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import numpy as np

PACKAGE = __name__.split(".")[0]


def pack(value: Any) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Pack a value as ``(index, arrays)``: an index that JSON can hold, and the numpy
    arrays that it refers to by number.

    Holds None, bool, int, float, str, arrays, tuples, lists, dicts, and dataclasses and
    enumerations of this package. Equal parts are stored once, so that equal values are
    stored alike.
    """
    arrays: list[np.ndarray] = []
    shared: list[Any] = []
    places: dict[Any, int] = {}
    packed_by_id: dict[int, tuple[Any, Any]] = {}

    def share(key: Hashable, make: Callable[[], Any]) -> dict[str, int]:
        """Refer to a shared part by its number; make it if there is none like it."""
        if key not in places:
            places[key] = len(shared)
            shared.append(make())
        return {"shared": places[key]}

    def array_of(value: Any) -> dict[str, int]:
        array = np.asarray(value)
        scalar = isinstance(value, np.generic)
        # Objects would be pickled, and to read a pickle is to run it.
        if array.dtype.hasobject:
            raise TypeError(f"a {type(value).__name__} cannot be kept")

        def make() -> dict[str, Any]:
            arrays.append(array)
            return {"array": len(arrays) - 1, "scalar": scalar}

        return share((scalar, array.dtype.str, array.shape, array.tobytes()), make)

    def plain(value: Any) -> Any:
        # By type: a float of numpy is a float as well, and has to come back as it was.
        if (
            value is None
            or isinstance(value, bool | str)
            or type(value) in (int, float)
        ):
            return value
        if isinstance(value, enum.IntEnum):
            return {"enum": _name(type(value)), "of": int(value)}
        if isinstance(value, list | tuple):
            # A named tuple would come back as a plain one.
            if hasattr(value, "_fields"):
                raise TypeError(f"a {type(value).__name__} cannot be kept")
            return {type(value).__name__: [plain(entry) for entry in value]}
        if isinstance(value, dict):
            return {
                "dict": [[plain(key), plain(entry)] for key, entry in value.items()]
            }
        if not dataclasses.is_dataclass(value):
            return array_of(value)
        if id(value) not in packed_by_id:
            fields = {
                field.name: plain(getattr(value, field.name))
                for field in dataclasses.fields(value)
            }
            packed = {"class": _name(type(value)), "of": fields}
            reference = share(json.dumps(packed), lambda: packed)
            # The value is held, so that no other value gets its id.
            packed_by_id[id(value)] = (reference, value)
        return packed_by_id[id(value)][0]

    return {"value": plain(value), "shared": shared}, arrays


def unpack(index: dict[str, Any], arrays: Sequence[np.ndarray]) -> Any:
    """Restore the value that :func:`pack` packed; its arrays are numpy's."""
    shared: list[Any] = []

    def restore(plain: Any) -> Any:
        if not isinstance(plain, dict):
            return plain
        (kind, content), *_ = plain.items()
        if kind == "shared":
            return shared[content]
        if kind in ("list", "tuple"):
            return {"list": list, "tuple": tuple}[kind](map(restore, content))
        if kind == "dict":
            return {restore(key): restore(entry) for key, entry in content}
        if kind == "array":
            return arrays[content][()] if plain["scalar"] else arrays[content]
        if kind == "enum":
            return _class(content)(plain["of"])
        return _class(content)(
            **{name: restore(part) for name, part in plain["of"].items()}
        )

    for part in index["shared"]:
        shared.append(restore(part))
    return restore(index["value"])


def _name(cls: type) -> str:
    """Module and qualified name of a class of this package, as files name it."""
    if cls.__module__.split(".")[0] != PACKAGE:
        raise TypeError(f"a {cls.__name__} cannot be kept")
    return f"{cls.__module__}:{cls.__qualname__}"


def _class(name: str) -> type:
    """The class of this package that a file names; nothing else is ever called."""
    module, _, qualname = name.partition(":")
    if module.split(".")[0] != PACKAGE:
        raise TypeError(f"{name!r} is no class of {PACKAGE}")
    cls = getattr(importlib.import_module(module), qualname)
    if not (
        isinstance(cls, type)
        and (dataclasses.is_dataclass(cls) or issubclass(cls, enum.IntEnum))
    ):
        raise TypeError(f"{name!r} is no class of {PACKAGE} that holds values")
    return cls

"""Results of the package as plain values and arrays, to be written to files that run
nothing when they are read.
"""

import dataclasses
import enum
import importlib
import json

import numpy as np

PACKAGE = __name__.split(".")[0]


def pack(value):
    """A value as ``(index, arrays)``: what JSON can hold, and numpy arrays that it
    refers to by number.

    Holds None, bool, int, float, str, arrays, tuples, lists, dicts, and dataclasses and
    enumerations of this package. Equal parts are stored once, so that equal values are
    stored alike.
    """
    arrays, shared, places, known = [], [], {}, {}

    def once(key, make):
        """The number of a part, made if there is none like it."""
        if key not in places:
            places[key] = len(shared)
            shared.append(make())
        return {"shared": places[key]}

    def array_of(value):
        array, scalar = np.asarray(value), isinstance(value, np.generic)
        # Objects would be pickled, and to read a pickle is to run it.
        if array.dtype.hasobject:
            raise TypeError(f"a {type(value).__name__} cannot be kept")

        def make():
            arrays.append(array)
            return {"array": len(arrays) - 1, "scalar": scalar}

        return once((scalar, array.dtype.str, array.shape, array.tobytes()), make)

    def plain(value):
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
            return {type(value).__name__: [plain(item) for item in value]}
        if isinstance(value, dict):
            return {"dict": [[plain(key), plain(item)] for key, item in value.items()]}
        if not dataclasses.is_dataclass(value):
            return array_of(value)
        if id(value) not in known:
            own = {
                f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)
            }
            made = {"class": _name(type(value)), "of": own}
            known[id(value)] = (
                once(json.dumps(made), lambda: made),
                value,
            )  # held: its number stays its own
        return known[id(value)][0]

    return {"value": plain(value), "shared": shared}, arrays


def unpack(index, arrays):
    """The value that :func:`pack` made ``(index, arrays)`` of; arrays are numpy's."""
    shared = []

    def value(plain):
        if not isinstance(plain, dict):
            return plain
        (kind, content), *_ = plain.items()
        if kind == "shared":
            return shared[content]
        if kind in ("list", "tuple"):
            return {"list": list, "tuple": tuple}[kind](map(value, content))
        if kind == "dict":
            return {value(key): value(item) for key, item in content}
        if kind == "array":
            return arrays[content][()] if plain["scalar"] else arrays[content]
        if kind == "enum":
            return _class(content)(plain["of"])
        return _class(content)(
            **{name: value(item) for name, item in plain["of"].items()}
        )

    for made in index["shared"]:
        shared.append(value(made))
    return value(index["value"])


def _name(cls):
    if cls.__module__.split(".")[0] != PACKAGE:
        raise TypeError(f"a {cls.__name__} cannot be kept")
    return f"{cls.__module__}:{cls.__qualname__}"


def _class(name):
    """The class of this package that a file names; nothing else is ever called."""
    module, _, qualname = name.partition(":")
    if module.split(".")[0] != PACKAGE:
        raise TypeError(f"{name!r} is no class of {PACKAGE}")
    found = getattr(importlib.import_module(module), qualname)
    if not (
        isinstance(found, type)
        and (dataclasses.is_dataclass(found) or issubclass(found, enum.IntEnum))
    ):
        raise TypeError(f"{name!r} is no class of {PACKAGE} that holds values")
    return found

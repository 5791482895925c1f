"""Equality of trains and results: by the numbers that they hold, whoever made them."""

import dataclasses
from typing import Any, TypeVar

import numpy as np

from jaxhb._jax import traced

Compared = TypeVar("Compared")


def by_value(cls: type[Compared]) -> type[Compared]:
    """Give a dataclass of arrays an ``==`` by value and a hash that agrees with it;
    ``nan`` is equal to itself.

    >>> pair = by_value(dataclasses.make_dataclass("Pair", ["hz", "name"]))
    >>> (
    ...     pair(np.ones(2), "a") == pair(np.ones(2), "a"),
    ...     pair(np.ones(2), "a") == pair(np.zeros(2), "a"),
    ... )
    (True, False)
    """

    def equal(self: Any, other: Any) -> Any:
        if type(other) is not type(self):
            return NotImplemented
        return self is other or value_key(self) == value_key(other)

    def hashed(self: Any) -> int:
        return hash(value_key(self))

    cls.__eq__ = equal  # type: ignore[method-assign]
    cls.__hash__ = hashed  # type: ignore[method-assign]
    return cls


def value_key(value: Any) -> Any:
    """The key by which a value is compared: of arrays type, shape and bytes, of
    dataclasses the fields that are compared.
    """
    if traced(value):  # its numbers are not known yet
        return "traced", *map(
            id, vars(value).values() if dataclasses.is_dataclass(value) else [value]
        )
    if hasattr(value, "dtype") or isinstance(value, float):
        numbers = np.asarray(value)
        return numbers.dtype.str, numbers.shape, numbers.tobytes()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        compared = (field.name for field in dataclasses.fields(value) if field.compare)
        return type(value), *(value_key(getattr(value, name)) for name in compared)
    if isinstance(value, dict):
        return dict, *((key, value_key(item)) for key, item in value.items())
    if isinstance(value, list | tuple):
        return tuple, *map(value_key, value)
    return value

"""Formulas that users write as text: arithmetic over named numbers, nothing else.

The text is parsed, never executed: only numbers, names, ``+ - * / **``, ``min``,
``max``, ``sqrt`` and ``where(a < b, x, y)`` are understood.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jaxhb.elements.sentences import shown, suggestion

if TYPE_CHECKING:
    from jaxhb._jax import Array

LONGEST = 1000  # characters of a formula
# A keyword of Python, written as a name of the same length so that columns stay
_LAMBDA = "lambda"
_NAMED = "lambd_"

_BINARY: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_SIGNS: dict[type, Callable[[Any], Any]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
_COMPARED: dict[type, Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
_FUNCTIONS = {"min": 2, "max": 2, "sqrt": 1, "where": 3}


class FormulaError(ValueError):
    """A fault of a formula, with its column."""


@dataclass(frozen=True)
class Formula:
    """A sound formula: its ``text`` and the ``names`` that it reads."""

    text: str
    names: frozenset[str]
    tree: ast.expr

    def value(self, numbers: Mapping[str, Any]) -> Array:
        """Value of the formula of numbers or arrays by name; differentiable."""
        import numpy as np

        from jaxhb._jax import namespace

        xp = namespace(*numbers.values())
        with_arrays = {
            name: xp.asarray(number, dtype=float) for name, number in numbers.items()
        }
        # Both values of ``where`` are computed, also that which does not count.
        with np.errstate(all="ignore"):
            return _value(self.tree, with_arrays, xp)


def formula(text: str, known: Collection[str]) -> Formula:
    """Read a formula over ``known`` names; :class:`FormulaError` with the column of
    what is not understood.

    >>> import numpy as np
    >>> doubled = formula("where(lambda < 1, 2 * d, sqrt(d))", ("d", "lambda"))
    >>> doubled.value({"d": 4.0, "lambda": np.array([0.5, 1.0])}).tolist()
    [8.0, 2.0]
    """
    if len(text) > LONGEST:
        raise FormulaError(
            f"it has {len(text)} characters, must have at most {LONGEST}. Define parts"
            " of it by names."
        )
    # A text of several lines is one formula.
    text = " ".join(text.split())
    source = re.sub(rf"\b{_LAMBDA}\b", _NAMED, text)
    try:
        tree = ast.parse(source, mode="eval").body
    except SyntaxError as error:
        raise FormulaError(
            f"it is no formula, at column {error.offset or 1} of {shown(text)}. Correct"
            " it."
        ) from None
    except (ValueError, RecursionError, MemoryError):
        raise FormulaError("it is nested too deeply. Define parts of it.") from None
    names: set[str] = set()
    try:
        _check(tree, text, known, names)
    except RecursionError:
        raise FormulaError("it is nested too deeply. Define parts of it.") from None
    return Formula(text, frozenset(names), tree)


def _check(node: ast.expr, text: str, known: Collection[str], names: set[str]) -> None:
    """Check a part of a formula and collect the names that it reads."""
    column = node.col_offset + 1
    match node:
        case ast.Constant(value=int() | float()) if _is_finite(node.value):
            parts: list[ast.expr] = []
        case ast.Name(id=name):
            name = name.replace(_NAMED, _LAMBDA)
            if name not in known:
                raise FormulaError(
                    f"unknown name {shown(name)} at column {column} of"
                    f" {shown(text)}.{suggestion(name, known)}"
                )
            names.add(name)
            parts = []
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
            parts = [left, right]
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _SIGNS:
            parts = [operand]
        case ast.Call(func=ast.Name(id=called), args=parts, keywords=[]) if (
            called in _FUNCTIONS
        ):
            _check_call(called, parts, column, text)
            if called == "where":
                condition, *others = parts
                assert isinstance(condition, ast.Compare)
                parts = [condition.left, *condition.comparators, *others]
        case _:
            hint = ""
            if isinstance(getattr(node, "op", None), ast.BitXor):
                hint = " Write ** for powers."
            elif isinstance(node, ast.Tuple):
                hint = " Write decimals with a point."
            raise FormulaError(
                f"{shown(ast.get_source_segment(text, node) or text)} at column"
                f" {column} is not understood: a formula has numbers, names, + - * /"
                f" **, min, max, sqrt and where(a < b, x, y).{hint}"
            )
    for part in parts:
        _check(part, text, known, names)


def _is_finite(number: Any) -> bool:
    """Whether a constant is a finite number, and no truth value."""
    try:
        return not isinstance(number, bool) and math.isfinite(number)
    except OverflowError:  # of an integer of many digits
        return False


def _check_call(called: str, parts: list[ast.expr], column: int, text: str) -> None:
    """Check the number of arguments of a function, and the condition of ``where``."""
    count = _FUNCTIONS[called]
    at_least = called in ("min", "max")
    if len(parts) < count or (len(parts) > count and not at_least):
        raise FormulaError(
            f"{called} at column {column} of {shown(text)} has {len(parts)} arguments,"
            f" must have {'at least ' * at_least}{count}. Correct it."
        )
    condition = parts[0]
    if called == "where" and not (
        isinstance(condition, ast.Compare)
        and len(condition.ops) == 1
        and type(condition.ops[0]) in _COMPARED
    ):
        raise FormulaError(
            f"where at column {column} of {shown(text)} needs a comparison first:"
            " where(a < b, x, y), with < <= > or >=."
        )


def _value(node: ast.expr, numbers: Mapping[str, Any], xp: Any) -> Any:
    """Value of a part of a checked formula."""

    def value(part: ast.expr) -> Any:
        return _value(part, numbers, xp)

    match node:
        case ast.Constant(value=int() | float() as number):
            return xp.asarray(float(number))
        case ast.Name(id=name):
            return numbers[name.replace(_NAMED, _LAMBDA)]
        case ast.BinOp(left=left, op=op, right=right):
            return _BINARY[type(op)](value(left), value(right))
        case ast.UnaryOp(op=op, operand=operand):
            return _SIGNS[type(op)](value(operand))
        case ast.Call(func=ast.Name(id="where"), args=[condition, first, second]):
            assert isinstance(condition, ast.Compare)
            compare = _COMPARED[type(condition.ops[0])]
            holds = compare(value(condition.left), value(condition.comparators[0]))
            return xp.where(holds, value(first), value(second))
        case ast.Call(func=ast.Name(id="sqrt"), args=[part]):
            return xp.sqrt(value(part))
        case ast.Call(func=ast.Name(id=called), args=parts):
            larger = xp.minimum if called == "min" else xp.maximum
            result = value(parts[0])
            for part in parts[1:]:
                result = larger(result, value(part))
            return result
    raise AssertionError("a part of a checked formula is none of these")

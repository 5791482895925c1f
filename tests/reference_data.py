"""Data that the tests read in ``tests/data``: copies of reference data (see
``shared/reference/README.md``), scenes, and cases that are words alone: input and
sentence.
"""

import functools
import json
from pathlib import Path

import numpy as np
import pytest

import jaxhb
from jaxhb import SceneError

DATA = Path(__file__).parent / "data"
PACKAGED = Path(jaxhb.__path__[0], "scene", "scenes")
"""Folder of the scenes of the package."""


def text_of(name):
    """A scene of ``tests/data/scenes``, or a part of one."""
    return (DATA / "scenes" / name).read_text(encoding="utf-8")


@functools.cache
def reference(name):
    """One file of ``tests/data`` without its ending."""
    return json.loads((DATA / f"{name}.json").read_text())


def method_case(name):
    """Pair ``(params, expected)`` of one entry of method_cases.json."""
    cases = reference("method_cases")["cases"]
    case = next(case for case in cases if case["id"] == name)
    return case.get("params"), case["expected"]


def numbers(values):
    """Strings, or nested lists of strings, as float64."""
    return np.array(values, dtype=float)


def complex_numbers(pairs):
    """A list of [re, im] strings as complex128."""
    return numbers(pairs) @ np.array([1.0, 1j])


def torsional_model(name):
    """One entry of torsional_models.json."""
    return next(model for model in reference("torsional_models") if model["id"] == name)


def refused(call, pattern, error=SceneError):
    """Checks that a call is refused with a sentence that matches a pattern."""
    with pytest.raises(error, match=pattern):
        call()

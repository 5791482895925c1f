"""Derivatives on every path of the solve, for every kind of parameter: the table of the benchmark, and its limits."""

import sys
from pathlib import Path

import numpy as np
import pytest
from tolerances import GRADIENT, TANGENT

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from derivatives import PLANS, parameters, table

pytestmark = pytest.mark.oracle

sys.path.pop(0)
CASES = [(path, kind) for path in PLANS if path != "exact" for kind in parameters(path)]


@pytest.mark.parametrize(("path", "kind"), CASES)
def test_a_derivative_is_that_of_differences_and_forwards_is_backwards(path, kind):
    row = next(row for row in table(path) if row["kind"] == kind)
    assert row["solved"] and row["error"] < GRADIENT and row["transpose"] < TANGENT
    assert abs(row["gradient"]) > 0 and np.isfinite(row["gradient"])


def test_the_paths_are_what_they_are_called():
    assert all(table(path)[0]["apart"] > 0.05 for path in ("reduced", "chain"))
    assert table("contact")[0]["apart"] == 0

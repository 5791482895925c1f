"""The fast part of ``benchmarks/stress.py``: random trains of three sizes and the extremes that take little time."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))

import extremes
import random_trains
import stress

CASES = [(size, index) for size in ((3, 1, 0), (3, 2, 0), (6, 2, 1)) for index in range(4)]
MODES_AT = 30
"""Harmonic of the cycle of the highest mesh mode: the speed is chosen so that all cases share a few programs."""

records = {}


def examined(size, index):
    """Record of a random case, solved once for all tests."""
    if (size, index) not in records:
        train, rpm, facts = random_trains.random_case(np.random.default_rng([7, index]), size)
        rpm *= stress.mode_harmonic(train, rpm) / MODES_AT
        records[size, index] = {"seed": 7, "case": index} | stress.examine(train, rpm, facts)
    return records[size, index]


@pytest.mark.parametrize(("size", "index"), CASES)
def test_random_train_gives_no_wrong_number_without_status(size, index):
    record = examined(size, index)
    assert not record["status"].startswith("raised"), record["sentence"]
    assert not record["wrong"], stress.line(record)


def test_random_trains_converge():
    found = [examined(*case) for case in CASES]
    failed = [stress.line(r) for r in found if r["status"] != "CONVERGED"]
    assert len(failed) <= 1, failed


def test_skeletons_fix_what_is_compiled():
    for size in random_trains.SKELETONS:
        first, second = (random_trains.random_case(np.random.default_rng([7, k]), size)[0] for k in (0, 1))
        assert first.topology == second.topology
        assert first.topology.n_disks == size[0]
        assert len(first.topology.mesh_names) == size[1]


def test_cases_are_drawn_from_their_seeds():
    first, second = (random_trains.random_case(np.random.default_rng([3, 5])) for _ in range(2))
    assert first[1:] == second[1:]
    np.testing.assert_array_equal(first[0].meshes.stiffness, second[0].meshes.stiffness)


@pytest.mark.parametrize("extreme", [e for e in extremes.extremes() if e.quick], ids=lambda e: e.name)
def test_extreme_has_its_expected_outcome(extreme):
    row = extremes.judged(extreme)
    assert row["as_expected"], row

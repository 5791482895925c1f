"""The two-stroke plant beside an engineer's own numbers (``benchmarks/hand_plant.py``,
NumPy alone); the benchmark ``hand_checks.py`` has both plants.
"""

import ast
import copy
from pathlib import Path

import hand_plant
import pytest
from hand_checks import (
    CASES,
    Both,
    blade_orders,
    critical_speeds,
    energies,
    frequencies,
    gas_harmonics,
    heat,
    misfire,
    resonance,
    shapes,
    stresses,
    synthesis,
    vector_sums,
)

ALIKE = 1e-6
"""%: the same mathematics; dense matrices lose digits of the lowest mode beside stiff
links (1e-9).
"""
STEPPED = 1e-3
"""%: the hand takes cycles by Runge-Kutta steps and Simpson's rule, jaxhb by trapezoids of
7200 angles, 3e-5 of order 12.
"""
SAMPLED = 1e-2
"""%: jaxhb takes the extremes of 4096 instants, between which a peak of order 15 lies up
to 1e-4 of itself higher.
"""


@pytest.fixture(scope="module")
def both():
    return Both(CASES["two_stroke"])


def compare(both, kind, tolerance):
    rows = [row for row in kind(both) if row.by_hand is not None]
    assert rows
    for row in rows:
        assert row.percent < tolerance, row


def test_the_hand_takes_nothing_of_jaxhb():
    tree = ast.parse(Path(hand_plant.__file__).read_text())
    modules = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
    }
    modules |= {
        node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)
    }
    assert modules == {"dataclasses", "functools", "numpy"}


@pytest.mark.parametrize("kind", [frequencies, shapes, vector_sums])
def test_modes_and_vector_sums_are_those_by_hand(both, kind):
    compare(both, kind, ALIKE)


def test_tangential_pressures_are_those_by_hand(both):
    compare(both, gas_harmonics, STEPPED)


def test_a_plant_of_other_numbers_differs(both):
    """Both numbers of a comparison depend on the scene."""
    scene = copy.deepcopy(both.scene)
    scene["disk"][0]["inertia"] *= 1.01
    scene["engine"]["combustion"]["charge_pressure"] *= 1.01
    other = Both(CASES["two_stroke"])
    other.hand = hand_plant.Plant(scene)
    (other.engine,) = other.hand.engines
    for kind in (frequencies, gas_harmonics):
        assert max(row.percent for row in kind(other)) > 10.0 * STEPPED


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "tolerance"),
    [
        (resonance, STEPPED),
        (synthesis, SAMPLED),
        (stresses, SAMPLED),
        (critical_speeds, STEPPED),
        (blade_orders, ALIKE),
        (misfire, SAMPLED),
        (heat, STEPPED),
        (energies, SAMPLED),
    ],
)
def test_forced_vibration_stresses_and_losses_are_those_by_hand(both, kind, tolerance):
    compare(both, kind, tolerance)

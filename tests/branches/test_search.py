"""All periodic motions of a train at one speed, against the exact motions of the
lightly loaded pair.
"""

import dataclasses
import math

import numpy as np
import pytest
from reference_data import reference
from trains import Pair, pair_rpm, pair_train

import jaxhb
from jaxhb.solutions import starts

EPSILON = 1e-3
ROWS = {
    row["speed"]: row for row in reference("lightly_loaded_pair")["laws"][1]["rows"]
}


def reaches(motion):
    deflection = motion.response.deflection("a", "b")
    return np.array([float(deflection.max), float(deflection.min)])


@pytest.fixture(scope="module", params=[pytest.param(0.8, marks=pytest.mark.slow), 1.0])
def searched(request):
    """Speed over the natural frequency, and the motions there: three of one cycle; one
    of one, two, three cycles.
    """
    train = pair_train(Pair(1.0, epsilon=EPSILON), transition=0.01)
    rpm = pair_rpm(Pair(request.param, epsilon=EPSILON))
    return request.param, jaxhb.solve_all(train, rpm=rpm, tolerance=1e-3)


@pytest.mark.slow
def test_every_exact_motion_is_found_with_its_stability(searched):
    """0.2 %: the transition zone, and 0.1 % of truncation."""
    speed, motions = searched
    row = ROWS[speed]
    exact = []
    for orbit in row["orbits"]:
        largest = max(abs(complex(re, im)) for re, im in orbit["multipliers"])
        exact.append((1, orbit, largest < 1))
    exact += [
        (attractor["period"], attractor, True)
        for attractor in row["attractors"]
        if attractor["period"] > 0
    ]
    for period, motion, attracts in exact:
        expected = np.array([motion["maximum"], motion["minimum"]])
        near = [
            m
            for m in motions
            if m.period == period
            and np.abs(reaches(m) - expected).max() < 2e-3 * abs(expected).max()
        ]
        assert near, (period, expected)
        assert near[0].attracts == attracts, (period, expected)


@pytest.mark.slow
def test_no_motion_is_told_twice_and_those_that_attract_come_first(searched):
    _, motions = searched
    tops = [(m.period, *reaches(m).round(3)) for m in motions]
    assert len(set(tops)) == len(tops)
    order = [motion.attracts for motion in motions]
    assert order == sorted(order, reverse=True)
    assert ("attracts" if order[0] else "repels") in str(motions[0])
    assert "kN" in str(motions[0])


def test_a_train_without_backlash_has_one_motion():
    (only,) = jaxhb.solve_all(jaxhb.load_scene("six_cylinder_diesel"), rpm=1500.0)
    assert only.period == 1
    assert only.attracts
    assert only.response.converged


@dataclasses.dataclass
class Unsolved:
    """A response, as far as start strategies look at it."""

    path: tuple = ()
    status: int = jaxhb.Status.STALLED


def test_no_attempt_begins_when_the_time_is_up_but_one_is_made(monkeypatch):
    def refine(self, attempt):
        tried.append(attempt)
        self.reached = starts.Reached(None, Unsolved())

    tried = []
    monkeypatch.setattr(starts.Attempts, "refine", refine)
    strategies = [
        lambda attempts, names=names: iter(names) for names in ("", "ab", "c")
    ]
    train = jaxhb.load_scene("spur_pair")
    for until, expected in ((math.inf, ["a", "b", "c"]), (0.0, ["a"])):
        tried.clear()
        case = starts.SolveCase(train, 5000.0, None, None, deadline=until)
        starts.Attempts(case).make(strategies)
        assert tried == expected

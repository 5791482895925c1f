"""Motions of one cycle from many starts of Newton's method on the map of a sweep."""

import itertools

import numpy as np
import pytest
from trains import Pair, hammering_train, pair_rpm, pair_train

import jaxhb
from jaxhb.balance import map_newton
from jaxhb.balance.plan import Request
from jaxhb.balance.swept import difference
from jaxhb.solutions import orbits, planning
from jaxhb.solutions.sweeping import SweptTrain


def search_of(train, rpm):
    (plan,) = planning.plan_speeds(train, np.array([rpm]), Request())
    return orbits.OrbitSearch(SweptTrain.of(train, plan, Request()), rpm)


@pytest.fixture(scope="module")
def pair():
    """The lightly loaded pair where a motion of one cycle repels beside those of two
    and three that attract.
    """
    return search_of(
        pair_train(Pair(1.0, epsilon=1e-3), transition=0.01),
        pair_rpm(Pair(1.0, epsilon=1e-3)),
    )


def test_a_motion_that_repels_is_closed_from_far_away(pair):
    """And the cycle that is closed there is one that the march repeats."""
    flank = pair.map.flank()
    plan = pair.map.plan
    visited = pair._march(flank)
    unclosed = np.where(np.isfinite(visited[2]), visited[2], np.nan)
    assert np.nanmin(unclosed) > 0
    equation = pair.map.swept.sweeps
    point, missed, marches = map_newton.close_cycle(
        equation, flank, plan, tolerance=1e-8, most=40
    )
    assert missed < 1e-8
    assert marches > 5
    following = map_newton.close_cycle(equation, point, plan, tolerance=1e-6)
    assert following[2] == 1  # closed already
    repelled = jaxhb.stability(next(pair._from(pair.map, point, [])))
    assert not repelled.stable


def test_a_motion_is_told_once(pair):
    again = orbits.OrbitSearch(pair.train, pair.rpm)
    settled = again.map.newton(pair.map.point_of(pair.found[0]))
    assert again.map.arrived(settled)
    assert len(list(again._taken(again.map, settled, []))) == 1
    assert list(again._taken(again.map, settled, [])) == []
    assert again.idle == 1


@pytest.mark.slow
def test_motions_of_a_hammering_train_are_found_that_time_integration_confirms():
    """Twelve disks, two meshes: beside the motion to which the train comes there are
    others that repel.
    """
    train, rpm = hammering_train(48271211, 8)
    responses = list(search_of(train, rpm).motions())
    assert len(responses) > 1
    for response in responses:
        judged = jaxhb.shooting_correction(response)
        assert judged.orbit.settled
        assert judged.error < 0.02
    apart = [
        difference(first.deflections, second.deflections)
        for first, second in itertools.combinations(responses, 2)
    ]
    assert min(apart) > orbits.SAME

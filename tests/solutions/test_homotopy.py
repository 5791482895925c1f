"""From a linear law to the teeth of a train along the curve of periodic motions, on the
map of a sweep.
"""

import dataclasses

import jax
import numpy as np
import pytest
from tolerances import ALGEBRAIC, PATHS
from trains import hammering_train, random_case

import jaxhb
from jaxhb.balance.plan import Request
from jaxhb.balance.swept import difference
from jaxhb.results.status import Homotopy
from jaxhb.solutions import continuation, homotopy, orbits, planning
from jaxhb.solutions.sweeping import SweptTrain

pytestmark = pytest.mark.slow


def search_of(train, rpm):
    (plan,) = planning.plan_speeds(train, np.array([rpm]), Request())
    return orbits.OrbitSearch(SweptTrain.of(train, plan, Request()), rpm)


@pytest.fixture(scope="module")
def unsettled():
    """Twelve disks and two meshes at which sweeps do not settle."""
    train, rpm = hammering_train(48271211, 8)
    return search_of(train, rpm)


def curve_of(search, most=np.inf):
    by_rate = search._map_of(dataclasses.replace(search.map.plan, by_rate=True))
    return homotopy.MapCurve(
        by_rate.swept.sweeps,
        by_rate.flank(),
        by_rate.plan,
        homotopy.BEGINNINGS[0],
        most,
    )


def test_the_curve_begins_at_a_linear_law_and_ends_at_that_of_the_teeth():
    train, rpm, _ = random_case(np.random.default_rng([1, 73]))
    search = search_of(train, rpm)
    curve = curve_of(search)
    teeth = search.map.swept.sweeps.teeth
    assert np.any(teeth.contact_damping)
    deflection, rate = (
        np.random.default_rng(0).normal(size=(2, 50, 2))
        * np.array([2e-4, 0.3])[:, None, None]
    )

    def excess(law):
        return jax.jit(jax.vmap(law.excess))(deflection, rate)

    end = excess(curve.at(1.0).teeth)
    for actual, expected in zip(end, excess(teeth), strict=True):
        np.testing.assert_allclose(
            actual, expected, atol=ALGEBRAIC * np.abs(expected).max()
        )
    begin = excess(curve.at(0.0).teeth)
    force, by_deflection, by_rate = map(np.asarray, begin)
    np.testing.assert_allclose(
        force, by_rate * rate, atol=ALGEBRAIC * np.abs(force).max()
    )
    np.testing.assert_allclose(by_rate, by_rate[:1].repeat(50, axis=0), rtol=PATHS)
    stiffness = np.asarray(teeth.law.stiffness).max()
    assert np.all(by_rate > 0)
    assert np.abs(by_deflection).max() < ALGEBRAIC * stiffness


def test_the_end_of_a_curve_is_a_motion_of_the_train_that_time_integration_confirms(
    unsettled,
):
    assert not unsettled.map.arrived(unsettled.map.settle())
    (response,) = unsettled._from_linear_law(once=True)
    assert response.converged
    assert isinstance(response.path[0], Homotopy)
    judged = jaxhb.shooting_correction(response)
    assert judged.orbit.settled
    assert judged.error < 0.01


def test_a_curve_has_no_more_marches_than_it_is_given(unsettled):
    curve = curve_of(unsettled, most=40)
    end = continuation.follow_curve(
        curve.linearize, curve.simplify, curve.start(), most=150, control=orbits.CURVE
    )
    assert not end.arrived
    assert curve.marches == 40


def test_points_of_the_curve_are_motions_of_their_law(unsettled):
    curve = curve_of(unsettled)
    points = []
    continuation.follow_curve(
        curve.linearize,
        curve.simplify,
        curve.start(),
        most=8,
        visit=lambda y, _: points.append(y),
        control=orbits.CURVE,
    )
    assert len(points) > 1
    assert points[-1][-1] > 0
    for y in points:
        assert np.linalg.norm(curve.unclosed(y)) < 2 * orbits.CURVE.near
    begin = curve.point(curve.start())
    flank = unsettled.map.flank()
    assert difference(begin.linear, flank.linear) < 1e-12

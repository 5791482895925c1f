"""From a linear law to the wanted teeth along the curve of periodic motions, on the map
of a sweep.
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

pytestmark = pytest.mark.oracle


def search_of(train, rpm):
    (plan,) = planning.plan_speeds(train, np.array([rpm]), Request())
    return orbits.OrbitSearch(SweptTrain.of(train, plan, Request()), rpm)


@pytest.fixture(scope="module")
def unsettled():
    """Twelve disks and two meshes at which sweeps do not settle."""
    return search_of(*hammering_train(48271211, 8))


def curve_of(search, most=np.inf):
    along = search._map_of(dataclasses.replace(search.map.plan, by_rate=True))
    return homotopy.MapCurve(
        along.swept.sweeps, along.flank(), along.plan, homotopy.BEGINNINGS[0], most
    )


def test_the_curve_begins_at_a_linear_law_and_ends_at_the_wanted_one():
    train, rpm, _ = random_case(np.random.default_rng([1, 73]))
    search = search_of(train, rpm)
    curve = curve_of(search)
    teeth = search.map.swept.sweeps.teeth
    assert np.any(teeth.contact_damping)
    motion = (
        np.random.default_rng(0).normal(size=(2, 50, 2))
        * np.array([2e-4, 0.3])[:, None, None]
    )
    laws = curve.at(0.0).teeth, curve.at(1.0).teeth, teeth
    begin, end, wanted = (jax.jit(jax.vmap(at.excess))(*motion) for at in laws)
    for found, expected in zip(end, wanted, strict=True):
        np.testing.assert_allclose(
            found, expected, atol=ALGEBRAIC * np.abs(expected).max()
        )
    force, by_deflection, by_rate = map(np.asarray, begin)
    np.testing.assert_allclose(
        force, by_rate * motion[1], atol=ALGEBRAIC * np.abs(force).max()
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
    seen = []
    given = curve.linearize, curve.simplify, curve.start()
    continuation.follow_curve(
        *given, most=8, visit=lambda y, _: seen.append(y), control=orbits.CURVE
    )
    assert len(seen) > 1
    assert seen[-1][-1] > 0
    for y in seen:
        assert np.linalg.norm(curve.unclosed(y)) < 2 * orbits.CURVE.near
    assert (
        difference(curve.point(curve.start()).linear, unsettled.map.flank().linear)
        < 1e-12
    )

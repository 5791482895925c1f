"""From the linear law to the wanted train along the curve of its periodic motions."""

import dataclasses

import jax
import numpy as np
import pytest
import random_trains
from tolerances import ALGEBRAIC

import jaxhb
from jaxhb import Status
from jaxhb.balance.plan import Plan, Request
from jaxhb.integration.step import Stepper
from jaxhb.results.status import Homotopy
from jaxhb.solutions import homotopy, orbits, planning, starts

pytestmark = pytest.mark.oracle

PLAN = Plan(harmonics=384, active=(0, 1), flank=(0, 0), start="march", time_steps=1536, excited=20)
BEGINNING = homotopy.Beginning(damping=20.0, transition=20.0, linear=False)


@pytest.fixture(scope="module")
def hammering():
    """Six disks, two meshes with 2 % damping and hardly any mean load: no cycle of a long march closes by itself."""
    train, rpm, facts = random_trains.random_case(np.random.default_rng([1, 73]))
    assert facts["zeta"] < 0.025 and facts["load"] < 0.05
    return train, rpm


def attempted(train, rpm):
    """The response of the march that comes first, and of the curve from there."""
    (plan,) = planning.plan_speeds(train, np.array([rpm]), Request())
    case = starts.Case(train, rpm, Request(), plan, effort=starts.LONG)
    return starts.first_solved(case, (starts.from_sweeps, starts.from_linear_law)).response


def homotopies(response):
    return [event for event in response.path if isinstance(event, Homotopy)]


def on_the_way(train, rpm, p):
    stepper, _ = orbits.stepper_of(train, rpm, PLAN)
    parts = {f.name: getattr(stepper, f.name) for f in dataclasses.fields(Stepper)}
    return stepper, homotopy.HomotopyStepper(**parts, parameter=p, beginning=BEGINNING)


def test_the_path_begins_at_a_linear_law_and_ends_at_the_wanted_one(hammering):
    motion = np.random.default_rng(0).normal(size=(50, 4)) * [2e-4, 2e-4, 0.3, 0.3]
    stepper, end = on_the_way(*hammering, 1.0)
    forces = (jax.jit(jax.vmap(lambda w, s=s: s.nonlinear_force_at(w, 0))) for s in (stepper, end))
    wanted, found = (np.asarray(force(motion)) for force in forces)
    np.testing.assert_allclose(found, wanted, atol=ALGEBRAIC * np.abs(wanted).max())
    begin = on_the_way(*hammering, 0.0)[1]
    slopes = jax.jit(jax.vmap(jax.jacfwd(lambda w: begin.nonlinear_force_at(w, 0))))
    slope = np.asarray(slopes(motion))
    scale = np.asarray(stepper.viscous).max()
    np.testing.assert_allclose(slope - slope[0], 0.0, atol=ALGEBRAIC * np.abs(slope).max())
    np.testing.assert_allclose(slope[:, :, :2], 0.0, atol=ALGEBRAIC * np.asarray(stepper.law.stiffness).max())
    assert np.all(np.diagonal(slope[0][:, 2:]) > 0) and np.abs(slope).max() < 20 * scale


def test_a_motion_is_found_without_shooting_and_confirmed_by_time_integration(hammering):
    response = attempted(*hammering)
    assert response.converged and homotopies(response)[0].found
    judged = jaxhb.shooting_correction(response)
    assert judged.orbit.settled and judged.error < 0.01
    adrift = dataclasses.replace(response, angles=1.5 * response.angles, deflections=1.5 * response.deflections)
    doubted = jaxhb.shooting_correction(adrift)
    assert not doubted.orbit.settled or doubted.error > 0.1


@pytest.mark.parametrize(
    ("limit", "value", "curves", "told"),
    [("MOST_JACOBIANS", 30, 3, "lost, curve no. 3"), ("WORK", 1e6, 0, "not tried")],
)
def test_a_curve_that_costs_too_much_is_told_in_the_path(hammering, monkeypatch, limit, value, curves, told):
    monkeypatch.setattr(homotopy, limit, value)
    response = attempted(*hammering)
    assert response.status in (Status.STALLED, Status.MAX_STEPS)
    (event,) = homotopies(response)
    assert not event.found and event.curves == curves and told in str(event)


def test_numbers_that_are_not_finite_end_the_curve_at_once(hammering):
    train, rpm = hammering
    torques = dataclasses.replace(train.torques, mean=np.nan * train.torques.mean)
    orbit, event = homotopy.find(dataclasses.replace(train, torques=torques), rpm, PLAN)
    assert orbit.coefficients is None and event.steps == 0 and not event.found

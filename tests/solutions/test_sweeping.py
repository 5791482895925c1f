"""Sweeps answer where teeth part: Newton's method with fixed harmonics and time
integration are the second ways.
"""

import dataclasses

import numpy as np
import pytest
import random_trains
from refined_trains import refined, with_tooth_damping
from tolerances import ALGEBRAIC

import jaxhb
from jaxhb.balance.march import modes_for_march
from jaxhb.balance.plan import Request
from jaxhb.balance.problem import problem_at, reduced_equation
from jaxhb.results.status import Newton, NewtonOnSweeps, Shooting, Sweeps
from jaxhb.solutions import planning, sweeping

RPM = 1833.0
LATE = 2266.2  # sweeps do not settle there
HARMONICS = 768  # those of test_gear_train_30.py, and their program


@pytest.fixture(scope="module")
def train():
    return jaxhb.load_scene("gear_train_30")


@pytest.fixture(scope="module")
def response(train):
    return jaxhb.solve(train, rpm=RPM)


@pytest.fixture(scope="module")
def swept(train):
    request = Request.of(train)
    (plan,) = planning.plan_speeds(train, np.array([RPM]), request)
    return sweeping.swept_train(train, plan, request)


def force_difference(response, reference):
    """Largest difference of the tooth forces of two responses, over the largest
    force.
    """
    actual = response.force("crank gear", "idler").samples(2**15)
    expected = reference.force("crank gear", "idler").samples(2**15)
    return np.abs(actual - expected).max() / np.abs(expected).max()


@pytest.mark.slow
def test_newtons_method_with_fixed_harmonics_finds_the_motion_of_sweeps(
    train, response
):
    """To the errors that the two tell."""
    assert [type(event) for event in response.path] == [Sweeps]
    newton = jaxhb.solve(train, rpm=RPM, harmonics=HARMONICS, start=response)
    assert newton.converged
    error = float(response.truncation_error + newton.truncation_error)
    assert force_difference(response, newton) < 1.2 * error


@pytest.mark.slow
def test_a_tighter_tolerance_takes_more_steps(train, response):
    finer = jaxhb.solve(train, rpm=RPM, tolerance=1e-3)
    assert finer.converged
    assert float(finer.truncation_error) <= 1e-3
    assert finer.harmonics > response.harmonics
    steps = [event.time_steps for event in finer.path if isinstance(event, Sweeps)]
    assert steps == sorted({event.time_steps for event in finer.path})
    error = float(response.truncation_error + finer.truncation_error)
    assert force_difference(response, finer) < 1.2 * error


@pytest.mark.slow
def test_newtons_method_on_sweeps_solves_what_these_do_not(train):
    response = jaxhb.solve(train, rpm=LATE)
    assert response.converged
    assert [type(event) for event in response.path] == [Sweeps, NewtonOnSweeps]
    error = jaxhb.shooting_correction(response).error
    assert error < 2 * float(response.truncation_error)


@pytest.mark.slow
def test_where_nothing_settles_shooting_finds_a_motion():
    """Three disks, two meshes with 3 % damping."""
    rng = np.random.default_rng([48271127, 21])
    for _ in range(2):
        train, rpm, _ = random_trains.random_case(rng)
        train = with_tooth_damping(train, random_trains.span(rng, 0.01, 0.3))
    # Rounding decides at which speeds Newton's method on sweeps arrives, and where
    # shooting does.
    for speed in rpm * np.linspace(0.995, 1.005, 11):
        hurried = jaxhb.solve(train, rpm=speed, seconds=0.0)
        assert not any(isinstance(event, Shooting) for event in hurried.path)
        if hurried.solved:
            continue
        response = jaxhb.solve(train, rpm=speed)
        if response.converged:
            break
    else:
        pytest.fail("shooting found no motion")
    rungs = [type(event) for event in response.path]
    assert rungs[:2] == [Sweeps, NewtonOnSweeps]
    assert Shooting in rungs
    assert rungs[-1] == Newton
    # Within the tolerance: this motion repels, and magnifies what is left out.
    assert jaxhb.shooting_correction(response).error < 0.01


@pytest.fixture(scope="module")
def long_train():
    """More disks than modes are made of."""
    return with_tooth_damping(refined("gear_train_30", 130), 0.06)


@pytest.mark.slow
def test_a_few_modes_of_a_long_train_respond_at_its_meshes_as_all_disks_do(long_train):
    """To harmonics of its mesh modes, against the receptances of the equations."""
    modes = modes_of(long_train)
    assert len(modes.rates) <= 64
    plan = planning.all_active(
        long_train, planning.contact_plan(long_train, Request()), Request()
    )
    exact, _ = reduced_equation(
        problem_at(long_train, RPM, plan.excited), 300, plan.active_meshes
    )
    receptance = np.asarray(exact.receptance)
    omega = float(exact.frequency) * np.arange(301)
    # Deflections fall under a positive force: of a mode that is counted twice, half of
    # it and of its conjugate.
    observed = modes.deflections
    rates = modes.rates
    forcing = modes.forcing
    moving = sum(
        np.einsum("gm,mh,mk->hgk", a / 2, 1 / (1j * omega - b[:, None]), c)
        for a, b, c in (
            (observed, rates, forcing),
            (observed.conj(), rates.conj(), forcing.conj()),
        )
    )
    response = modes.flexibility - moving
    errors = np.abs(response - receptance)[1:].max(axis=(1, 2))
    scale = np.abs(receptance)[1:].max(axis=(1, 2))
    assert (errors / scale).max() < 0.02


@pytest.mark.slow
def test_sweeps_of_a_long_train_end_at_the_motion_of_newtons_method_on_all_disks(
    long_train,
):
    swept = jaxhb.solve(long_train, rpm=RPM)
    assert swept.converged
    assert not any(isinstance(event, Newton) for event in swept.path)
    newton = jaxhb.solve(long_train, rpm=RPM, harmonics=swept.harmonics, start=swept)
    assert newton.converged
    error = float(swept.truncation_error + newton.truncation_error)
    assert force_difference(swept, newton) < 1.2 * error


@pytest.mark.slow
def test_speeds_of_a_sweep_are_solved_as_each_by_itself(train, response):
    sweep = jaxhb.solve_speeds(train, rpm=[RPM, RPM + 20])
    np.testing.assert_array_equal(sweep[0].angles, response.angles)


@pytest.mark.slow
def test_sweeps_from_a_motion_stay_there(train, swept, response):
    """A motion is what a steady state starts its neighbour from."""
    state = jaxhb.steady_state(train, rpm=RPM)
    assert state.kind == "periodic"
    assert state.cycles == int(response.steps)
    again = swept.solve(RPM, motion=state.motion)
    assert force_difference(again, response) < 5e-3


@pytest.mark.slow
def test_a_start_that_is_no_motion_of_the_train_is_forgotten(swept, response):
    """A train that settles comes to the same motion from elsewhere."""
    disturbed = np.zeros(2 * response.topology.n_disks)
    again = swept.solve(RPM, motion=disturbed)
    assert force_difference(again, response) < 5e-3


@pytest.mark.slow
def test_fixed_harmonics_exact_integrals_and_a_start_are_left_to_newtons_method(
    train, response
):
    for newton in (
        jaxhb.solve(train, rpm=RPM, harmonics=HARMONICS),
        jaxhb.solve(train, rpm=RPM, integrals="exact"),
        jaxhb.solve(train, rpm=RPM, start="march"),
    ):
        assert isinstance(newton.path[-1], Newton)
        assert not any(isinstance(event, NewtonOnSweeps) for event in newton.path)
        assert force_difference(newton, response) < 0.1


def modes_of(train):
    request = Request.of(train)
    plan = planning.contact_plan(train, request)
    return sweeping.swept_train(train, plan, request).modes


def new_modes(train):
    """Modes made anew, though others are kept."""
    request = Request.of(train)
    plan = planning.all_active(train, planning.contact_plan(train, request), request)
    problem = problem_at(train, sweeping.MODES_RPM, plan.excited)
    return modes_for_march(problem, plan.active_meshes)


@pytest.mark.slow
def test_modes_are_kept_for_the_numbers_of_a_train_and_for_no_others(train):
    """Also where numbers are written into the arrays of a train."""
    modes = modes_of(train)
    assert modes_of(dataclasses.replace(train)) is modes
    np.testing.assert_allclose(modes.rates, new_modes(train).rates, rtol=ALGEBRAIC)
    inertia = np.array(train.disks.inertia)
    disks = dataclasses.replace(train.disks, inertia=inertia)
    writable = dataclasses.replace(train, disks=disks)
    assert modes_of(writable) is modes
    inertia[0] *= 1.5
    changed = modes_of(writable)
    np.testing.assert_array_equal(changed.rates, new_modes(writable).rates)
    difference = np.abs(changed.rates - modes.rates).max()
    assert difference > 1e-3 * np.abs(modes.rates).max()


@pytest.mark.slow
def test_rates_are_sampled_where_damping_sets_in_with_contact(train, swept):
    assert not any(plan.by_rate for plan in swept.sweep_plans(RPM))
    law = ("contact", *train.topology.mesh_damping_law[1:])
    topology = dataclasses.replace(train.topology, mesh_damping_law=law)
    damped = dataclasses.replace(train, topology=topology)
    damped_sweeps = dataclasses.replace(swept, train=damped)
    assert all(plan.by_rate for plan in damped_sweeps.sweep_plans(RPM))

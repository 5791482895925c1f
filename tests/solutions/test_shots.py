"""Closed orbits of irregular trains, found by shooting."""

import dataclasses
import itertools

import jax
import numpy as np
import pytest
import random_trains
from compiling import executables
from trains import ONE_RADIAN_PER_SECOND, build

import jaxhb
from jaxhb import Disk, Mesh, Shaft, Torque
from jaxhb.balance.plan import Plan
from jaxhb.balance.problem import problem_at, reduced_equation
from jaxhb.balance.sizes import relative_residual
from jaxhb.solutions import shots

pytestmark = pytest.mark.slow

RPM = 2320.0
PLAN = Plan(
    harmonics=384,
    active=(0, 1, 2, 3),
    flank=(0,) * 4,
    start="march",
    time_steps=1536,
    excited=24,
)


def test_shooting_closes_an_orbit_that_a_march_leaves_open_for_ever():
    train = jaxhb.load_scene("gear_train_30")
    orbit = next(shots.shoot(train, RPM, PLAN))
    assert orbit.periodicity_error <= shots.PERIODIC
    assert orbit.tries >= 1
    response = jaxhb.solve(train, rpm=RPM)
    assert response.converged
    open_for_ever = jaxhb.integrate(train, rpm=RPM, cycles=30)
    assert open_for_ever.periodicity_error > 100 * shots.PERIODIC
    harmonic = np.fft.irfft(np.asarray(response.deflections), n=1536, norm="forward")
    shot = np.fft.irfft(orbit.coefficients, n=1536, norm="forward")
    # 1536 steps leave some percent.
    assert np.abs(harmonic - shot).max() < 0.1 * np.abs(harmonic).max()


def test_a_march_that_is_not_finite_gives_no_orbit():
    train = jaxhb.load_scene("gear_train_30")
    assert list(shots.shoot(train, float("nan"), PLAN)) == []


def test_every_closed_orbit_is_found_once():
    """Three disks with hardly any mean load on two meshes: many unstable motions."""
    train, rpm, facts = random_trains.random_case(np.random.default_rng([0, 90]))
    assert facts["load"] < 0.1
    assert train.topology.n_disks == 3
    plan = Plan(
        harmonics=384,
        active=(0, 1),
        flank=(0, 0),
        start="march",
        time_steps=1536,
        excited=20,
    )
    closed = list(itertools.islice(shots.shoot(train, rpm, plan), 6))
    motions = [
        np.fft.irfft(orbit.coefficients, n=plan.time_steps, norm="forward")
        for orbit in closed
    ]
    assert all(orbit.periodicity_error <= shots.PERIODIC for orbit in closed)
    apart = [
        np.abs(first - second).max() / np.abs(first).max()
        for first, second in itertools.combinations(motions, 2)
    ]
    assert len(closed) == 6
    assert min(apart) > shots.SAME


@pytest.mark.parametrize(
    ("fewer", "more", "followed"), [(64, 96, False), (1536, 4096, True)]
)
def test_other_steps_compile_nothing_where_they_follow_the_modes_of_the_teeth_alike(
    fewer, more, followed
):
    """March and shot have two programs: where modes are too fast for the steps, these
    add their static response.
    """
    train = jaxhb.load_scene("gear_train_30")
    compiled = []
    for time_steps in (fewer, more):
        plan = dataclasses.replace(PLAN, time_steps=time_steps)
        stepper = shots.reduced_stepper(train, RPM, plan)
        assert (stepper.residual_flexibility is None) == followed
        list(shots.shoot(train, RPM, plan, work=0.0))
        programs = (shots._equations, shots._visited, shots._shot)
        compiled.append([executables(program) for program in programs])
    assert compiled[0] == compiled[1]


def test_modes_too_fast_for_the_steps_answer_statically():
    """A light gear on a shaft five times as stiff as its teeth, and a mode forty times
    too fast for the steps.

    The equations of the harmonics know the shaft: what is left of them at the orbit is
    the error of the steps, with the static answer and without. The teeth are not
    damped: the rate of the static answer is neglected.
    """
    parts = [
        Disk(name="driver", inertia=1.0, radius=1.0, damping=0.6),
        Disk(name="gear", inertia=1e-6, radius=1.0),
        Disk(name="driven", inertia=1.0, damping=0.6),
        Mesh(
            between=("driver", "gear"),
            stiffness=4.0,
            backlash=0.5,
            epsilon=0.01,
            transition=0.2,
        ),
        Shaft(between=("gear", "driven"), stiffness=20.0),
        Torque(disk="driver", mean=0.4, harmonics=[(1.0, 1.5, 0.0)]),
        Torque(disk="driven", mean=-0.4),
    ]
    train = build(parts, reference="driver")
    plan = Plan(
        harmonics=32, active=(0,), flank=(0,), start="march", time_steps=256, excited=1
    )
    rpm = 2.0 * ONE_RADIAN_PER_SECOND
    stepper = shots.reduced_stepper(train, rpm, plan)

    @jax.jit
    def left_over(problem, active_meshes, coefficients):
        reduced, _ = reduced_equation(problem, plan.harmonics, active_meshes)
        return relative_residual(
            reduced, reduced.residual(coefficients, plan.shape.samples)
        )

    problem = problem_at(train, rpm, plan.excited)
    residuals = []
    for flexibility in (stepper.residual_flexibility, None):
        changed = dataclasses.replace(stepper, residual_flexibility=flexibility)
        shot = shots._shot(changed, stepper.flank_state)
        deflection, periodicity_error = map(np.asarray, shot)
        assert periodicity_error <= shots.PERIODIC
        coefficients = shots.coefficients(deflection, plan.time_steps)
        coefficients = coefficients[:, : plan.harmonics + 1]
        residual = left_over(problem, plan.active_meshes, coefficients)
        residuals.append(float(residual))
    motion = deflection[0, : plan.time_steps]
    assert motion.min() < 0 < motion.max()
    assert residuals[0] < 1e-4 < 1e-2 < residuals[1]

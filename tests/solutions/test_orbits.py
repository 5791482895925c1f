"""Closed orbits found by shooting, where a march of a few cycles does not settle."""

import dataclasses
import itertools

import jax
import numpy as np
import pytest
import random_trains
from compiling import executables
from trains import ONE_RADIAN_PER_SECOND, build

import jaxhb
from jaxhb import Disk, Load, Mesh, Shaft, Torque
from jaxhb.balance.plan import Plan, Request
from jaxhb.balance.problem import problem_at, reduced_equation
from jaxhb.balance.sizes import relative_residual
from jaxhb.integration import shooting
from jaxhb.results.status import Shooting
from jaxhb.solutions import orbits, planning, starts

pytestmark = pytest.mark.oracle

RPM = 2320.0
PLAN = Plan(harmonics=384, active=(0, 1, 2, 3), flank=(0,) * 4, start="march", time_steps=1536, excited=24)


def test_shooting_closes_an_orbit_that_a_march_leaves_open_for_ever():
    train = jaxhb.load_scene("gear_train_30")
    orbit = next(orbits.OrbitSearch(train, RPM, PLAN).shoot())
    assert orbit.periodicity_error <= orbits.PERIODIC and orbit.tries >= 1
    response = jaxhb.solve(train, rpm=RPM)
    assert response.converged
    open_for_ever = jaxhb.integrate(train, rpm=RPM, cycles=30)
    assert open_for_ever.periodicity_error > 100 * orbits.PERIODIC
    harmonic = np.fft.irfft(np.asarray(response.deflections), n=1536, norm="forward")
    shot = np.fft.irfft(orbit.coefficients, n=1536, norm="forward")
    assert np.abs(harmonic - shot).max() < 0.1 * np.abs(harmonic).max()  # 1536 steps leave some percent


def test_a_march_that_is_not_finite_gives_no_orbit():
    orbit = next(orbits.OrbitSearch(jaxhb.load_scene("gear_train_30"), float("nan"), PLAN).shoot())
    assert orbit.coefficients is None and orbit.tries == 0


def test_every_closed_orbit_is_found_once():
    """Three disks with hardly any mean load on two meshes: many unstable motions."""
    train, rpm, facts = random_trains.random_case(np.random.default_rng([0, 90]))
    assert facts["load"] < 0.1 and train.topology.n_disks == 3
    plan = Plan(harmonics=384, active=(0, 1), flank=(0, 0), start="march", time_steps=1536, excited=20)
    found = list(itertools.islice(orbits.OrbitSearch(train, rpm, plan).shoot(), 6))
    motions = [np.fft.irfft(orbit.coefficients, n=plan.time_steps, norm="forward") for orbit in found]
    assert all(orbit.periodicity_error <= orbits.PERIODIC for orbit in found)
    apart = [np.abs(one - other).max() / np.abs(one).max() for one, other in itertools.combinations(motions, 2)]
    assert len(found) == 6 and min(apart) > orbits.SAME


@pytest.mark.parametrize(("fewer", "more", "followed"), [(64, 96, False), (1536, 4096, True)])
def test_another_number_of_steps_compiles_nothing_where_it_follows_the_modes_of_the_teeth_alike(fewer, more, followed):
    """March and shot have two programs: where modes are too fast for the steps, these add their static response."""
    train, compiled = jaxhb.load_scene("gear_train_30"), []
    for time_steps in (fewer, more):
        search = orbits.OrbitSearch(train, RPM, dataclasses.replace(PLAN, time_steps=time_steps))
        search.march(np.inf)
        next(search.shoot())
        assert (search.stepper.residual_flexibility is None) == followed
        compiled.append([executables(program) for program in (orbits._equations, orbits._visited, orbits._shot)])
    assert compiled[0] == compiled[1]


class Misled(orbits.OrbitSearch):
    """Its first orbit is far from the motion."""

    def shoot(self):
        found = next(super().shoot())
        yield dataclasses.replace(found, coefficients=0.3 * found.coefficients)
        yield found


class Blind(orbits.OrbitSearch):
    """Sees orbits only with four times the time steps of the plan."""

    def shoot(self):
        seeing = self.plan.time_steps == 4 * PLAN.time_steps
        yield from super().shoot() if seeing else [orbits.FoundOrbit(None, 1.0, None, 0)]


def attempted(search, wanted, **effort):
    """The case after strategies with another search, and the time steps that were searched with."""
    train = jaxhb.load_scene("gear_train_30")
    (plan,) = planning.plan_speeds(train, np.array([RPM]), Request())
    effort = dataclasses.replace(starts.LONG, **effort)
    case = starts.Case(train, RPM, Request(), plan, effort=effort, search_with=search)
    found = starts.first_solved(case, wanted)
    return found, sorted({steps for _, _, steps in case.searches})


def test_another_orbit_is_tried_where_the_harmonics_do_not_take_the_first():
    found, _ = attempted(Misled, (starts.shooting,), finer=1)
    assert found.response.converged
    assert sum(isinstance(event, Shooting) for event in found.response.path) == 2


def test_shorter_steps_are_tried_where_longer_ones_close_no_orbit():
    wanted = (starts.shooting,)
    found, steps = attempted(Blind, wanted, work=1e8)
    assert steps == [PLAN.time_steps, 2 * PLAN.time_steps, 4 * PLAN.time_steps]
    assert found.response.converged and found.response.harmonics == 4 * PLAN.harmonics
    found, steps = attempted(Blind, wanted, work=1e6)
    assert found.response is None  # no attempt was made
    assert steps == [PLAN.time_steps, 2 * PLAN.time_steps]  # four shots of four times the steps are more than the work


@pytest.mark.parametrize(("half", "few"), [(40, 512), (4, 128)])
def test_more_steps_begin_at_the_motion_of_the_disks_whatever_modes_they_keep(monkeypatch, half, few):
    """The modes, and of a long train which are kept, depend on the steps: the same numbers would be another motion."""
    parts = [Disk(name=str(k), inertia=0.01, radius=0.1, damping=0.1) for k in range(2 * half)]
    parts += [Shaft(between=(str(k), str(k + 1)), stiffness=1e5) for k in range(2 * half - 1) if k != half - 1]
    parts.append(
        Mesh(
            between=(str(half - 1), str(half)), stiffness=1e8, damping=1e3, backlash=1e-4, epsilon=1e-3, transition=0.04
        )
    )
    parts += [Torque(disk="0", mean=5.0, harmonics=[(2.0, 8.0, 0.0)]), Load(disk=str(2 * half - 1))]
    train = build(parts, reference="0")
    plan = Plan(harmonics=64, active=(0,), flank=(0,), start="march", time_steps=few, excited=2)
    coarse, fine = (orbits.OrbitSearch(train, 3000.0, dataclasses.replace(plan, time_steps=n)) for n in (few, 2 * few))
    nodes, seen = np.asarray(shooting.beginnings(coarse.stepper, coarse.stepper.flank_state)), []

    def closed(stepper, nodes):
        seen.append(stepper.space.observation @ nodes.T)
        return nodes, np.zeros((1, orbits.CAPACITY)), np.array(0.0)

    with monkeypatch.context() as patched:
        patched.setattr(orbits, "_closed", closed)
        fine.close(nodes, coarse)
    before = coarse.stepper.space.observation @ nodes.T
    np.testing.assert_allclose(seen[0], before, atol=1e-3 * np.abs(before).max())
    wrong = fine.stepper.space.observation @ nodes.T
    assert np.abs(wrong - before).max() > 0.02 * np.abs(before).max()


def test_modes_too_fast_for_the_steps_answer_statically():
    """A light gear on a shaft five times as stiff as its teeth, and a mode forty times too fast for the steps.

    The equations of the harmonics know the shaft: what is left of them at the orbit is the error of the steps, with the
    static answer and without. The teeth are not damped: the rate of the static answer is neglected.
    """
    parts = [
        Disk(name="driver", inertia=1.0, radius=1.0, damping=0.6),
        Disk(name="gear", inertia=1e-6, radius=1.0),
        Disk(name="driven", inertia=1.0, damping=0.6),
        Mesh(between=("driver", "gear"), stiffness=4.0, backlash=0.5, epsilon=0.01, transition=0.2),
        Shaft(between=("gear", "driven"), stiffness=20.0),
        Torque(disk="driver", mean=0.4, harmonics=[(1.0, 1.5, 0.0)]),
        Torque(disk="driven", mean=-0.4),
    ]
    train = build(parts, reference="driver")
    plan = Plan(harmonics=32, active=(0,), flank=(0,), start="march", time_steps=256, excited=1)
    rpm = 2.0 * ONE_RADIAN_PER_SECOND
    search = orbits.OrbitSearch(train, rpm, plan)

    @jax.jit
    def left_over(problem, active_meshes, coefficients):
        reduced, _ = reduced_equation(problem, plan.harmonics, active_meshes)
        return relative_residual(reduced, reduced.residual(coefficients, plan.samples))

    problem = problem_at(train, rpm, plan.excited)
    settled, closed = search.march(1e-9), next(search.shoot())
    size = np.abs(settled.coefficients).max()
    assert closed.periodicity_error <= orbits.PERIODIC
    np.testing.assert_allclose(closed.coefficients, settled.coefficients, atol=1e-5 * size)  # as orbits close
    left = []
    for flexibility in (search.stepper.residual_flexibility, None):
        stepper, model = search._made
        search._made = dataclasses.replace(stepper, residual_flexibility=flexibility), model
        orbit = search.march(1e-9)
        assert orbit.coefficients is not None
        left.append(float(left_over(problem, plan.active_meshes, orbit.coefficients[:, : plan.harmonics + 1])))
    motion = np.fft.irfft(orbit.coefficients, n=plan.time_steps, norm="forward")
    assert motion.min() < 0 < motion.max()
    assert left[0] < 1e-4 < 1e-2 < left[1]

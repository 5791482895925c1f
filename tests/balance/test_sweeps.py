"""Sweeps end at the solution of harmonic balance, whatever their march does wrong.

Second ways: Newton's method on the same equations (``jaxhb.solve``), a march with twice
the steps, closed forms.
"""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tolerances import ALGEBRAIC

import jaxhb
from jaxhb._jax import on_host
from jaxhb.balance import map_newton
from jaxhb.balance.map_newton import solve_map
from jaxhb.balance.march import InstantSolve, modes_for_march, modes_of_model
from jaxhb.balance.plan import Request
from jaxhb.balance.problem import (
    ActiveMeshes,
    Problem,
    model_of,
    problem_at,
    reduced_equation,
)
from jaxhb.balance.sweeps import (
    SweepPlan,
    SweepPoint,
    equation_program,
    first_point,
    force_size,
    point_at,
    point_of,
    settle_program,
    sweep_program,
    vibration_size,
)
from jaxhb.balance.swept import solve_by_sweeps
from jaxhb.elements.elements import Damper, Disk, Ground, Mesh, Shaft
from jaxhb.elements.excitations.torque import Torque
from jaxhb.equations import fourier
from jaxhb.results.status import Status
from jaxhb.solutions import planning
from jaxhb.train.assembly import build
from jaxhb.train.excitation import listed_harmonic

RPM = 600.0
STEPS = 512
GOAL = 1e-7  # change of the motion in the last sweep


def pair(*, mesh=(), coupling=(), gear_inertia=0.03, ground=True, brake=-20.0, more=()):
    """A flywheel with a ring, two gears whose teeth part at RPM, and what they
    drive.
    """
    shaft = Shaft(between=("gear b", "driven"), stiffness=1e4, damping=8.0)
    teeth = Mesh(
        between=("gear a", "gear b"),
        stiffness=1e7,
        damping=1500.0,
        backlash=2e-4,
        epsilon=1e-3,
        transition=0.1,
    )
    parts = [
        Disk(name="flywheel", inertia=2.0, damping=0.5),
        Disk(name="gear a", inertia=0.01, radius=0.05, teeth=20),
        Disk(name="gear b", inertia=gear_inertia, radius=0.1, teeth=40),
        Disk(name="driven", inertia=0.1, damping=1.0),
        Shaft(between=("flywheel", "gear a"), stiffness=2e4, damping=8.0),
        dataclasses.replace(shaft, **dict(coupling)),
        dataclasses.replace(teeth, **dict(mesh)),
        Damper(name="ring", disk="flywheel", inertia=0.2, damping=20.0),
        Torque(
            disk="flywheel",
            mean=10.0,
            harmonics=[(1.0, 50.0, -20.0), (2.0, 10.0, 60.0)],
        ),
        Torque(
            disk="driven", mean=brake, harmonics=[(1.0, 30.0, 10.0), (3.0, 20.0, 0.0)]
        ),
        *more,
    ]
    if ground:
        parts.append(Ground(disk="driven", stiffness=10.0))
    return build(parts, revolutions_per_cycle=1, reference="flywheel", name="pair")


TRAINS = {
    "damping in contact": {},
    "damping always": {"mesh": {"damping_law": "always"}},
    "sharp teeth": {"mesh": {"transition": 0.01, "epsilon": 0.0}},
    "a floating train": {"ground": False},
    "a gear without inertia": {"gear_inertia": 0.0},
    "a loss factor": {"coupling": {"loss_factor": 0.1}},
    "a stage": {"coupling": {"stages": ((0.2, 3e4),)}},
    "a clearance": {"coupling": {"clearance": 0.1}},
    "a stop": {"coupling": {"stops": ((0.3, 3e4),)}},
    "friction": {"coupling": {"friction": 3.0}},
    "a stiffness that varies": {"mesh": {"stiffness_orders": ((1.0, 0.1, 0.05),)}},
    "a transmission error": {"mesh": {"transmission_error": ((1.0, 3e-6, 1e-6),)}},
}


@dataclasses.dataclass(frozen=True)
class Case:
    """A train at RPM, ready for sweeps."""

    train: jaxhb.DriveTrain
    plan: SweepPlan
    active: tuple
    problem: Problem
    meshes: ActiveMeshes
    equation: object
    modes: object


@partial(jax.jit, static_argnames="harmonics")
def condensed(problem, meshes, harmonics):
    return reduced_equation(problem, harmonics, meshes)[0]


def case_of(train, *, steps=STEPS, instant=None):
    """All meshes with a law are unknowns."""
    request = Request.of(train)
    (planned,) = planning.plan_speeds(train, np.array([RPM]), request)
    planned = planning.all_active(train, planned, request)
    if instant is None:
        instant = (
            InstantSolve(2, coupled=True) if train.topology.springs else InstantSolve()
        )
    plan = SweepPlan(steps, instant)
    problem = problem_at(train, RPM, listed_harmonic(train.topology))
    meshes = planned.active_meshes
    equation = condensed(problem, meshes, plan.harmonics)
    return Case(
        train,
        plan,
        planned.active,
        problem,
        meshes,
        equation,
        modes_for_march(problem, meshes),
    )


def settled(case, goal=GOAL):
    """Where sweeps of the case end."""
    sweeps = equation_program(case.equation, case.modes, plan=case.plan)
    return settle_program(
        sweeps, first_point(sweeps), goal=goal, most=40, plan=case.plan
    )


def distance(case, motion, other):
    """Distance of two motions, over the vibration of the second."""
    motion = jnp.asarray(motion)
    other = jnp.asarray(other)
    size = force_size(case.equation, motion - other)
    return float(size / vibration_size(case.equation, other))


@pytest.fixture(scope="module")
def hammering():
    return case_of(pair())


@partial(jax.jit, static_argnames="steps")
def modes_inside_a_program(problem, meshes, steps):
    return modes_of_model(model_of(problem, meshes, steps))


def light_end():
    """A disk on a short shaft behind a gear, whose mode is far too fast for the
    steps.
    """
    return (
        Disk(name="light end", inertia=1e-4),
        Shaft(between=("gear b", "light end"), stiffness=1e6, damping=1.0),
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "at_once"),
    [({}, False), ({"ground": False}, False), ({"more": light_end()}, True)],
)
def test_modes_made_inside_a_program_lead_to_the_same_motion(changes, at_once):
    """Modes of a pair that floats, too, whose rotation has no two eigenvectors, and
    where one responds at once.
    """
    case = case_of(pair(**changes))
    traced = modes_inside_a_program(case.problem, case.meshes, STEPS)
    assert (np.abs(traced.flexibility).max() > 0) == at_once
    other = settled(dataclasses.replace(case, modes=traced))
    assert distance(case, other.deflection, settled(case).deflection) < 100 * GOAL


def case_named(name):
    """Case of a train of ``TRAINS``."""
    return case_of(pair(**TRAINS[name]))


FAST = ("damping in contact", "a gear without inertia", "a stage")
KINDS = [
    pytest.param(name, marks=() if name in FAST else pytest.mark.slow)
    for name in TRAINS
]


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_sweeps_settle_at_a_solution_of_harmonic_balance(name):
    """Within a few cycles, however long the train on its soft ground takes: some 150 of
    them.
    """
    case = case_named(name)
    motion = settled(case)
    assert float(motion.change) <= GOAL
    assert int(motion.marches) <= 15
    # F, which knows nothing of the march; sweeps contract, so that what is left is
    # below the last change.
    residual = case.equation.residual(motion.deflection, case.plan.samples)
    assert distance(case, motion.deflection - residual, motion.deflection) <= GOAL
    teeth, _ = case.equation.sampled(motion.deflection, 4096)
    apart = np.abs(np.asarray(teeth)) < np.asarray(case.equation.law.gap)[:, None]
    assert apart[0].any()
    assert not apart[0].all()


@pytest.mark.slow
def test_newtons_method_finds_the_same_motion(hammering):
    """It takes the law at 16 samples a harmonic and sweeps at 6: kinks of the law make
    that 1e-5 here.
    """
    response = jaxhb.solve(hammering.train, rpm=RPM, harmonics=hammering.plan.harmonics)
    assert response.solved
    newton = np.asarray(response.deflections)[list(hammering.active)]
    assert distance(hammering, settled(hammering).deflection, newton) < 1e-4


@pytest.mark.slow
def test_the_motion_does_not_depend_on_the_steps_of_the_march(hammering):
    """The harmonics and samples are the same, but a march of twice the steps has
    another error.
    """
    finer = dataclasses.replace(
        hammering, plan=FinerMarch(2 * STEPS, harmonics_of=STEPS)
    )
    assert finer.plan.harmonics == hammering.plan.harmonics
    assert (
        distance(hammering, settled(finer).deflection, settled(hammering).deflection)
        < 10 * GOAL
    )


@dataclasses.dataclass(frozen=True)
class FinerMarch(SweepPlan):
    """A march with more steps than its harmonics and samples ask for."""

    harmonics_of: int = STEPS

    @property
    def harmonics(self):
        return SweepPlan(self.harmonics_of).harmonics

    @property
    def samples(self):
        return SweepPlan(self.harmonics_of).samples


@pytest.mark.slow
def test_steps_err_by_their_square():
    """The difference of b from the linear motion is the error of the steps; under a law
    that is smooth in a wide zone.
    """
    case = case_of(pair(mesh={"transition": 1.0}))
    errors = []
    for steps in (512, 1024, 2048):
        finer = dataclasses.replace(case, plan=FinerMarch(steps))
        errors.append(distance(case, settled(finer).point.linear, case.equation.linear))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 2.0, atol=0.15)


@pytest.mark.slow
def test_a_cycle_that_does_not_close_is_no_error_of_the_steps():
    """Teeth in contact all cycle: whatever state a sweep begins with, b stays the
    linear motion to rounding.
    """
    case = case_of(
        pair(
            mesh={"backlash": 2e-7},
            more=[Torque(name="preload", disk="flywheel", mean=400.0)],
            brake=-800.0,
        )
    )
    sweeps = equation_program(case.equation, case.modes, plan=case.plan)
    begin = first_point(sweeps)
    disturbed = dataclasses.replace(
        begin, state=begin.state + np.linspace(-1e-3, 1e-3, len(begin.state))
    )
    following, marched = sweep_program(sweeps, disturbed, plan=case.plan)
    assert distance(case, marched, case.equation.linear) > 1e-3
    assert distance(case, following.linear, begin.linear) < 1e-9


def solved(case, tolerance):
    """The Outcome of a case by sweeps."""
    return solve_by_sweeps(
        case.problem, case.meshes, case.modes, tolerance, case.plan
    ).outcome


@pytest.mark.slow
def test_a_solve_by_sweeps_tells_how_it_went(hammering):
    """A looser tolerance is met; a finer one than 232 harmonics resolve is not; sweeps
    never settle to nothing.
    """
    met = solved(hammering, 0.01)
    missed = solved(hammering, 1e-5)
    unsettled = solved(hammering, 1e-15)
    assert met.status == Status.CONVERGED
    assert met.truncation_error <= 0.01
    assert missed.status == Status.TOLERANCE_NOT_MET
    assert missed.truncation_error > 1e-5
    assert unsettled.status == Status.MAX_STEPS
    # Energy: what torques do and dampers take, to what the harmonics left out carry.
    assert abs(missed.power_defect) < 1e-4


@pytest.mark.slow
def test_the_error_that_a_solve_by_sweeps_tells_covers_that_of_its_march(hammering):
    """Beside a march with four times the steps. An estimate, no bound, as sampling is
    not in it: a fifth more is allowed.
    """
    coarse = solved(hammering, 0.01)
    finer = solved(dataclasses.replace(hammering, plan=SweepPlan(4 * STEPS)), 1e-6)
    assert finer.truncation_error < coarse.truncation_error / 4
    # Energy: with so many harmonics hardly anything is left out.
    assert abs(finer.power_defect) < 1e-5
    coarse_force, force = (
        fourier.synthesize(outcome.fields.elastic_forces, 2**14)
        for outcome in (coarse, finer)
    )
    error = np.abs(coarse_force - force).max() / np.abs(force).max()
    assert error < 1.2 * coarse.truncation_error


@pytest.mark.slow
def test_mean_torques_that_nothing_takes_are_told():
    floating = case_of(pair(ground=False))
    load = np.array(floating.problem.load)
    load[0, 0] *= 1.01
    pushed = dataclasses.replace(
        floating, problem=dataclasses.replace(floating.problem, load=load)
    )
    assert solved(floating, 0.01).status == Status.CONVERGED
    assert solved(pushed, 0.01).status == Status.UNBALANCED


def test_newtons_method_on_the_map_finds_the_fixed_point(hammering):
    """From one sweep: products are differences, so that it ends a little above their
    rounding.
    """
    sweeps = equation_program(hammering.equation, hammering.modes, plan=hammering.plan)
    begun, _ = sweep_program(sweeps, first_point(sweeps), plan=hammering.plan)
    iterate = solve_map(sweeps, begun, hammering.plan, goal=1e-8)
    assert iterate.change <= 1e-8
    assert distance(hammering, iterate.deflection, settled(hammering).deflection) < 1e-6


def test_a_cycle_that_does_not_close_is_no_end_however_short_the_last_correction_is(
    hammering, monkeypatch
):
    """A map that is stiff in the deflections and soft in the states, with too few
    Krylov steps for both: the first correction halves what is unclosed, and the states
    have hardly moved.
    """
    sweeps = equation_program(hammering.equation, hammering.modes, plan=hammering.plan)
    begin = jax.tree.map(np.asarray, first_point(sweeps))
    size = np.linalg.norm(fourier.pack(begin.linear))
    visible = map_newton.PackedPoint(sweeps, begin).visibility
    linear = begin.linear + 2e-6 * begin.linear
    away = 0.01 * size
    state = begin.state + away / visible / np.sqrt(len(visible))

    def sweep(_, point, plan):
        unclosed = SweepPoint(
            1e3 * (point.linear - linear), 0.1 * (point.state - state), 0 * point.force
        )
        return jax.tree.map(np.subtract, point, unclosed), point.linear

    monkeypatch.setattr(map_newton, "sweep_program", sweep)
    monkeypatch.setattr(map_newton, "KRYLOV_STEPS", 1)
    iterate = solve_map(sweeps, begin, hammering.plan, goal=1e-5)
    missed = np.linalg.norm((iterate.point.state - state) * visible)
    assert iterate.distance > 1e-5 or missed < 0.5 * away


def test_a_motion_is_where_sweeps_from_it_stay(hammering):
    """The point of the motion that sweeps end at is nearly their fixed point: harmonics
    above N, and what one step of Newton's method leaves of the force of an instant, are
    2e-5 here.
    """
    motion = settled(hammering).deflection
    sweeps = equation_program(hammering.equation, hammering.modes, plan=hammering.plan)
    begin = point_of(on_host(sweeps), motion, hammering.plan)
    following, marched = sweep_program(sweeps, begin, plan=hammering.plan)
    assert distance(hammering, marched, motion) < 1e-4
    assert distance(hammering, following.linear, begin.linear) < 1e-4


@pytest.mark.slow
def test_padding_by_idle_meshes_changes_nothing(hammering):
    """Arrays have room for 1, 2, 4, ... meshes and 32, 64, ... modes."""
    train = hammering.train
    rpm = RPM
    problem = problem_at(train, rpm, listed_harmonic(train.topology))
    meshes = ActiveMeshes(
        mask=np.array([1.0, 0.0]), index=np.zeros(2, np.int32), flank=np.zeros(1)
    )
    equation = condensed(problem, meshes, hammering.plan.harmonics)
    padded = dataclasses.replace(
        hammering, equation=equation, modes=modes_for_march(problem, meshes)
    )
    motion = settled(padded).deflection
    assert distance(hammering, motion[:1], settled(hammering).deflection) < 10 * GOAL
    assert not np.any(motion[1])


def test_a_gear_pair_turned_round_moves_as_before(hammering):
    """``between`` swapped: deflections have the other sign."""
    turned = case_of(pair(mesh={"between": ("gear b", "gear a")}))
    assert (
        distance(hammering, -settled(turned).deflection, settled(hammering).deflection)
        < 10 * GOAL
    )


def test_without_rates_sweeps_end_where_they_do_with_them():
    """Where teeth are damped always: with damping in contact they end elsewhere."""
    case = case_named("damping always")
    equation = dataclasses.replace(case.equation, by_rate=False)
    plan = dataclasses.replace(case.plan, by_rate=False)
    motion = settled(case)
    short = settled(dataclasses.replace(case, equation=equation, plan=plan))
    assert int(short.marches) == int(motion.marches)
    assert distance(case, short.deflection, motion.deflection) < ALGEBRAIC


def test_a_sweep_begins_with_the_force_at_the_first_instant(hammering):
    """Force of the linear motion, where the train does not deviate from it: the sum of
    its harmonics.
    """
    sweeps = equation_program(hammering.equation, hammering.modes, plan=hammering.plan)
    point = point_at(on_host(sweeps), np.zeros(2 * hammering.train.topology.n_disks))
    harmonics = np.arange(hammering.plan.harmonics + 1)
    twice = np.where(harmonics > 0, 2.0, 1.0) * np.asarray(hammering.equation.linear)
    rate = twice * 1j * harmonics * float(hammering.problem.frequency)
    force, *_ = sweeps.teeth.excess(twice.sum(axis=1).real, rate.sum(axis=1).real)
    np.testing.assert_allclose(point.force, force, rtol=ALGEBRAIC * 1e3)
    mean_force, *_ = sweeps.teeth.excess(twice[:, 0].real, np.zeros(len(twice)))
    assert np.abs(force - mean_force).max() > 1e-3 * np.abs(force).max()

"""A plan decides on the host; a planned solve decides nothing and works under
transformations.
"""

import dataclasses
from functools import partial

import jax
import numpy as np
import pytest
from compiling import executables
from reference_data import reference, refused
from trains import build, pinions_parts

import jaxhb
from jaxhb.balance import program
from jaxhb.balance.plan import STEPS_PER_MODE_PERIOD, Request
from jaxhb.balance.program import solve_problem
from jaxhb.linear import mesh_modes
from jaxhb.results.response import stack
from jaxhb.solutions import planning, speeds, starts
from jaxhb.train.changes import within_range

HAMMERING_RPM = 5625.0


@pytest.fixture(scope="module")
def pair():
    return jaxhb.load_scene("spur_pair")


@pytest.fixture(scope="module")
def plan(pair):
    return jaxhb.plan(pair, rpm=HAMMERING_RPM, harmonics=50)


NAMES = [
    f"gear a|gear b.{name}"
    for name in ("stiffness", "damping", "backlash", "epsilon", "transition")
]
NAMES.append("gear a.inertia")
SPEEDS = [5500.0, HAMMERING_RPM, 5900.0]
OUT_OF_RANGE = [0.0, -1500.0, 1.1e6]
WRONG = [
    (0, -1e6),
    (1, -1.0),
    (2, -1e-5),
    (3, -0.1),
    (3, 1.5),
    (4, 0.0),
    (4, 1.5),
    (5, -0.01),
]
"""Places in NAMES, and values that are none there."""


@pytest.fixture(scope="module")
def lanes(pair, plan):
    """Responses of one program, jit of vmap: at SPEEDS, OUT_OF_RANGE and with WRONG;
    not solved; not finite.
    """
    valid = [float(pair.value(name)) for name in NAMES]
    changes = [*WRONG, (1, 1.0), (1, np.nan)]
    numbers = np.tile(valid, (len(SPEEDS) + len(OUT_OF_RANGE) + len(changes), 1))
    for row, (place, value) in zip(numbers[-len(changes) :], changes, strict=True):
        row[place] = value
    rpm = np.array(SPEEDS + OUT_OF_RANGE + [HAMMERING_RPM] * len(changes))

    @jax.jit
    @jax.vmap
    def solved(rpm, values):
        response = jaxhb.solve(
            pair.replace(dict(zip(NAMES, values, strict=True))), rpm=rpm, plan=plan
        )
        return response, response.force("gear a", "gear b").max

    # Arrays on the host are read without compiling.
    return jax.tree.map(np.asarray, solved(rpm, numbers))


@pytest.mark.slow
def test_a_planned_solve_finds_the_motion_without_a_plan_and_under_jit_of_vmap(
    pair, plan, lanes
):
    """All converge to a residual of 1e-10 from nearly the same march. A plan averages
    the law between the samples of the other solve, which leaves an error of 1e-6.
    """
    free = jaxhb.solve(pair, rpm=HAMMERING_RPM, harmonics=50)
    single = [jaxhb.solve(pair, rpm=speed, plan=plan) for speed in SPEEDS]
    sampled = jaxhb.solve(
        pair, rpm=HAMMERING_RPM, plan=dataclasses.replace(plan, averaged=False)
    )
    size = np.abs(free.deflections).max()
    np.testing.assert_allclose(
        sampled.deflections, free.deflections, rtol=0, atol=1e-9 * size
    )
    np.testing.assert_allclose(
        single[1].deflections, free.deflections, rtol=0, atol=1e-6 * size
    )
    assert np.array_equal(lanes[0].status[:3], [response.status for response in single])
    expected = [response.force("gear a", "gear b").max for response in single]
    np.testing.assert_allclose(lanes[1][:3], expected, rtol=1e-9)


@pytest.mark.slow
def test_without_a_plan_a_traced_solve_says_what_to_pass(pair):
    def traced_speed(rpm):
        return jaxhb.solve(pair, rpm=rpm).load_kW

    def traced_factor(factor):
        return factor * jaxhb.solve(pair, rpm=1000.0).load_kW

    for traced, argument in (
        (jax.jit(traced_speed), 1000.0),
        (jax.jit(traced_factor), 1000.0),
        (jax.vmap(jax.grad(traced_speed)), np.array([1000.0])),
    ):
        with pytest.raises(
            TypeError, match="jit or vmap traces solve: pass plan=jaxhb.plan"
        ):
            traced(argument)
    with pytest.raises(TypeError, match="plan depends on values"):
        jax.jit(lambda factor: factor * jaxhb.plan(pair, rpm=1000.0).harmonics)(2.0)


@pytest.mark.slow
def test_what_is_constant_is_checked_under_jit_too(pair, plan):
    @jax.jit
    def solved_backwards(damping):
        changed = pair.replace({"gear a|gear b.damping": damping})
        return jaxhb.solve(changed, rpm=-3000.0, plan=plan).load_kW

    refused(lambda: solved_backwards(1.0), "must be greater than 0 rpm")
    engine = jaxhb.load_scene("six_cylinder_diesel")
    contact = jaxhb.plan(engine, rpm=1500.0)

    def mean(rpm, plan):
        return jaxhb.solve(engine, rpm=rpm, plan=plan).torque("cyl6", "flywheel").mean

    twice = jax.jit(lambda factor: factor * mean(1500.0, contact))(2.0)
    assert float(twice) == pytest.approx(2 * float(mean(1500.0, contact)), rel=1e-9)
    few = dataclasses.replace(contact, harmonics=12)
    with pytest.raises(jaxhb.SceneError, match="ask for at least 24 harmonics"):
        jax.jit(lambda rpm: mean(rpm, few))(1500.0)


@pytest.mark.slow
def test_new_numbers_compile_nothing(pair, plan):
    jaxhb.solve(pair, rpm=HAMMERING_RPM, plan=plan)
    before = executables(solve_problem)
    for rpm, damping in ((5700.0, 1100.0), (5650, 1000)):
        jaxhb.solve(
            pair.replace({"gear a|gear b.damping": damping}), rpm=rpm, plan=plan
        )
    assert executables(solve_problem) == before


@pytest.mark.slow
def test_a_mesh_that_leaves_its_flank_violates_the_plan(pair):
    contact = jaxhb.plan(pair, rpm=3000.0)
    assert contact.active == ()
    response = jaxhb.solve(pair, rpm=HAMMERING_RPM, plan=contact)
    assert int(response.status) == jaxhb.Status.PLAN_VIOLATED
    refused(
        lambda: jaxhb.check(response), "PLAN_VIOLATED.*plan again", jaxhb.NotConverged
    )


@pytest.mark.slow
def test_too_few_harmonics_are_told_as_such_whatever_a_second_try_ends_in(
    pair, monkeypatch
):
    response = jaxhb.solve(pair, rpm=HAMMERING_RPM, harmonics=50, tolerance=1e-6)
    assert int(response.status) == jaxhb.Status.TOLERANCE_NOT_MET
    assert response.residual < 1e-10
    refused(lambda: jaxhb.check(response), "use more harmonics", jaxhb.NotConverged)
    lost = dataclasses.replace(response, status=np.array(jaxhb.Status.STALLED))
    monkeypatch.setattr(speeds, "solve_again", lambda *_, **__: lost)
    retried = speeds.try_again(pair, 0, [response], Request(tolerance=1e-6), None)
    assert int(retried.status) == jaxhb.Status.TOLERANCE_NOT_MET


@pytest.mark.slow
def test_an_unbalanced_floating_train_has_a_status(pair):
    plan = jaxhb.plan(pair, rpm=3000.0)
    response = jaxhb.solve(pair.replace({"drive.mean": 60.0}), rpm=3000.0, plan=plan)
    assert int(response.status) == jaxhb.Status.UNBALANCED


@pytest.mark.slow
def test_teeth_that_push_at_a_resonance_of_the_train_are_told_that_it_is_singular(
    pair, plan
):
    # Undamped, the pair has its natural frequency at HAMMERING_RPM: order 2 at half of
    # it, where no torque acts.
    undamped = pair.replace({"gear a|gear b.damping": 0.0})
    resonance = 60 * jaxhb.natural_frequencies(undamped).frequencies_hz[-1] / 32
    assert abs(resonance - HAMMERING_RPM) < 1
    response = jaxhb.solve(undamped, rpm=resonance / 2, plan=plan)
    assert int(response.status) == jaxhb.Status.NEAR_SINGULAR


@pytest.mark.slow
def test_contact_is_looked_for_with_the_harmonics_of_the_excitation(pair):
    """And not with those asked for, which may be a thousand."""
    before = executables(solve_problem)
    plans = planning.plan_speeds(pair, np.array([3000.0]), Request(harmonics=1024))
    planning.plan_speeds(pair, np.array([HAMMERING_RPM]), Request(harmonics=512))
    assert executables(solve_problem) <= before + 1
    assert plans[0].harmonics == 1024


@pytest.mark.slow
def test_a_march_that_blew_up_is_followed_by_all_starts(pair):
    """Its periodicity error is not finite: it is not taken for a settled march."""
    attempts = attempts_at(pair, HAMMERING_RPM, harmonics=50)
    case = attempts.case
    march = starts.Attempt(dataclasses.replace(case.plan, start="march"))
    attempts.refine(march)
    assert attempts.reached.sweep_change < np.inf
    attempts.case = dataclasses.replace(case, rpm=np.nan)
    attempts.refine(march)
    assert attempts.reached.sweep_change == np.inf


def attempts_at(train, rpm, harmonics=None):
    request = Request(harmonics=harmonics)
    (plan,) = planning.plan_speeds(train, np.array([rpm]), request)
    return starts.Attempts(starts.SolveCase(train, rpm, request, plan))


@pytest.mark.slow
def test_start_strategies_are_asked_for_the_next_attempt_until_one_is_solved(pair):
    """Strategies that must fail come first here, and the last one is never asked."""
    attempts = attempts_at(pair, HAMMERING_RPM, harmonics=50)
    tried = []

    def hopeless(attempts):
        for number in (1, 2):
            tried.append(number)
            nowhere = np.full((1, 51), np.nan + 0j)
            yield starts.Attempt(attempts.case.plan, nowhere)

    def never(attempts):
        pytest.fail("asked for though the attempt before was solved")

    attempts.make((hopeless, starts.from_sweeps, never))
    assert tried == [1, 2]
    assert attempts.response.converged
    events = [type(event).__name__ for event in attempts.response.path]
    assert events == ["Newton", "Newton", "Sweeps", "Newton"]


def test_a_sweep_tells_the_harmonics_of_every_speed_though_it_pads_them():
    engine = jaxhb.load_scene("six_cylinder_diesel")
    few, more = (
        jaxhb.solve(engine, rpm=1500.0, harmonics=harmonics) for harmonics in (24, 48)
    )
    both = stack([more, few])
    assert both.harmonics == 48
    assert both.path[1] == few.path
    assert both.highest_harmonic.tolist() == [
        more.highest_harmonic,
        few.highest_harmonic,
    ]
    np.testing.assert_array_equal(both[1].angles[:, :25], few.angles)


@pytest.mark.parametrize(("arguments", "sentence"), reference("cases")["solves"])
def test_bad_requests_are_refused_with_a_sentence(arguments, sentence):
    with pytest.raises((jaxhb.SceneError, ValueError), match=sentence):
        jaxhb.solve(jaxhb.load_scene("gear_train_30"), **arguments)


@pytest.mark.slow
def test_a_plan_that_does_not_know_a_backlash_is_refused(pair):
    stranger = jaxhb.Plan(harmonics=16, active=(), flank=(0,))
    with pytest.raises(
        jaxhb.SceneError, match="the plan was made for a train without this backlash"
    ):
        jaxhb.solve(pair, rpm=HAMMERING_RPM, plan=stranger)


@pytest.mark.slow
def test_arguments_that_belong_to_the_plan_are_refused_beside_it(pair, plan):
    solve = partial(jaxhb.solve, pair, rpm=HAMMERING_RPM, plan=plan)
    for call in (
        partial(solve, harmonics=50),
        partial(solve, tolerance=1e-3),
        partial(solve, method="chain"),
        partial(solve, integrals="exact"),
    ):
        with pytest.raises(ValueError, match="belong to the plan"):
            call()
    with pytest.raises(ValueError, match="belong to the plan"):
        jaxhb.solve_speeds(pair, rpm=[HAMMERING_RPM], plan=plan, harmonics=50)


@pytest.mark.slow
@pytest.mark.parametrize("rpm", [0.0, -100.0, np.nan, np.inf, 1.1e6])
def test_every_entry_refuses_a_speed_that_is_none(pair, plan, rpm):
    sentence = (
        "must be at most 1000000 rpm: give"
        if rpm == 1.1e6
        else "must be greater than 0 rpm"
    )
    refused(lambda: jaxhb.solve(pair, rpm=rpm, plan=plan), sentence)
    for entry in (
        jaxhb.plan,
        jaxhb.linear_response,
        jaxhb.steady_state,
        jaxhb.integrate,
    ):
        refused(partial(entry, pair, rpm=rpm), sentence)
    for entry in (jaxhb.solve_speeds, jaxhb.forced_response):
        refused(partial(entry, pair, rpm=[3000.0, rpm]), sentence)


@pytest.mark.slow
def test_one_plan_serves_speeds_in_contact_and_speeds_that_hammer(pair):
    """And a speed between; the motions are those of solves that decide for
    themselves.
    """
    speeds = [3000.0, 4500.0, HAMMERING_RPM]
    together = jaxhb.plan(pair, rpm=speeds, harmonics=50)
    assert together.active == (0,)
    assert together.flank == (0,)
    assert jaxhb.plan(pair, rpm=3000.0).active == ()
    assert jaxhb.plan(pair, rpm=3000.0, harmonics=50, active="all") == together
    parts = []
    for rpm in (*speeds, 5200.0):
        planned = jaxhb.solve(pair, rpm=rpm, plan=together)
        free = jaxhb.solve(pair, rpm=rpm, harmonics=50)
        assert planned.converged
        assert free.converged
        largest = np.abs(free.deflections).max()
        np.testing.assert_allclose(
            planned.deflections[:, :51], free.deflections[:, :51], atol=1e-7 * largest
        )
        parts.append(float(planned.mesh("gear a", "gear b").separated_fraction) > 0)
    assert parts == [False, False, True, True]


@pytest.mark.slow
def test_a_plan_for_a_range_has_the_harmonics_of_its_most_demanding_speed(pair):
    alone = jaxhb.plan(pair, rpm=HAMMERING_RPM)
    together = jaxhb.plan(pair, rpm=[3000.0, HAMMERING_RPM])
    assert together.harmonics >= alone.harmonics
    assert jaxhb.solve(pair, rpm=HAMMERING_RPM, plan=together).converged
    # None parts: one linear solve each.
    assert jaxhb.plan(pair, rpm=[2000.0, 3000.0]).active == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"rpm": []}, "no speed is given"),
        ({"rpm": [3000.0, -1.0]}, "must be greater than 0 rpm"),
        ({"rpm": 3000.0, "active": "some"}, "active is 'some': give 'all'"),
        (
            {"rpm": 3000.0, "failed_gradient": 0},
            "failed_gradient is 0: give 'zero' or 'nan'",
        ),
    ],
)
def test_a_range_that_cannot_be_planned_is_refused_with_a_sentence(
    pair, arguments, sentence
):
    refused(lambda: jaxhb.plan(pair, **arguments), sentence, ValueError)


@pytest.mark.slow
def test_a_range_without_a_motion_at_any_speed_is_not_planned(pair):
    """Nothing takes the mean torque, and no tooth parts: the status of a plan in
    contact counts, too.
    """
    unbalanced = pair.replace({"drive.mean": 60.0})
    refused(
        lambda: jaxhb.plan(unbalanced, rpm=[2000.0, 3000.0]),
        "UNBALANCED",
        jaxhb.NotConverged,
    )


@pytest.mark.slow
def test_the_derivative_of_a_failed_solve_is_nan_where_its_plan_says_so(pair):
    """At a speed that is none and at one whose Newton's method may take no step,
    forwards and backwards; that of a neighbour in the batch is left alone. Zero, as
    plans say by default: test_derivatives.py.
    """
    # Its start is the motion at the first speed.
    plan = jaxhb.Plan(
        harmonics=32,
        active=(0,),
        flank=(0,),
        start="linear",
        cycles=0,
        max_steps=0,
        failed_gradient="nan",
    )

    @jax.jit
    @jax.vmap
    def slopes(rpm):
        def rms(rpm):
            return jaxhb.solve(pair, rpm=rpm, plan=plan).force("gear a", "gear b").rms

        _, forwards = jax.linearize(rms, rpm)
        (backwards,) = jax.linear_transpose(forwards, rpm)(1.0)
        return forwards(1.0), backwards

    forwards, backwards = slopes(np.array([3000.0, -1.0, HAMMERING_RPM]))
    assert np.isfinite(backwards[0])
    assert backwards[0] != 0
    assert forwards[0] == pytest.approx(float(backwards[0]), rel=1e-9)
    assert np.isnan(backwards[1:]).all()
    # A tangent of nan is nan whatever the derivative.
    assert np.isnan(forwards[1:]).all()


def test_speeds_that_hammer_share_a_plan_that_resolves_the_mesh_modes_of_all():
    """Plans of few numbers of harmonics, 192, 768, 1536 and 4096: each plan is a
    program.
    """
    train = jaxhb.load_scene("gear_train_30")
    for rpm, most in (
        (np.linspace(1300.0, 2450.0, 20), 1),
        (np.linspace(1300.0, 12000.0, 20), 2),
    ):
        plans = planning.plan_speeds(train, rpm, Request(few_levels=True))
        frequencies = [train.topology.cycle_frequency(speed) for speed in rpm]
        modes = np.array(
            [mesh_modes.mesh_mode_harmonics(train, w)[0] for w in frequencies]
        )
        marched = np.array([plan.marches for plan in plans])
        steps = np.array([plan.time_steps for plan in plans])
        levels = np.array([plan.harmonics for plan in plans])
        assert np.all(steps[marched] >= STEPS_PER_MODE_PERIOD * modes[marched])
        assert np.all(levels[marched] >= 1.5 * modes[marched])
        assert len({plan for plan in plans if plan.marches}) == most


@pytest.mark.slow
def test_a_sweep_is_its_single_solves_and_has_at_most_four_large_programs(pair):
    """Whatever its speeds do: those of Newton's method, one for each level of
    harmonics.
    """
    rpm = np.linspace(1500.0, 6000.0, 9)
    assert jaxhb.solve_speeds(planning.linearised(pair), rpm=rpm).converged.all()
    before = executables(solve_problem) + executables(program._solve_all)
    sweep = jaxhb.solve_speeds(pair, rpm=rpm)
    assert executables(solve_problem) + executables(program._solve_all) - before <= 4
    assert sweep.converged.all()
    assert len(sweep) == 9
    separated = [
        response.mesh("gear a", "gear b").separated_fraction > 0 for response in sweep
    ]
    hammers = np.flatnonzero(separated)
    assert 0 < len(hammers) < 9
    for place in (0, hammers[0]):
        alone = jaxhb.solve(pair, rpm=rpm[place])
        largest = sweep[place].force("gear a", "gear b").max
        expected = alone.force("gear a", "gear b").max
        tolerance = max(sweep[place].truncation_error, 1e-9)
        assert abs(largest - expected) <= tolerance * expected


@pytest.mark.slow
def test_a_linear_response_is_the_same_bits_among_few_and_one_motion_among_many():
    train = jaxhb.load_scene("six_cylinder_diesel")
    rpm = np.linspace(600.0, 2400.0, program.LINEAR_SPEEDS + 3)
    few = jaxhb.solve_speeds(train, rpm=rpm[:5])
    alone = jaxhb.solve_speeds(train, rpm=rpm[3:4])
    np.testing.assert_array_equal(few[3].angles, alone[0].angles)
    many = jaxhb.solve_speeds(train, rpm=rpm)
    rounding = 1e-14 * np.abs(few.angles).max()
    assert many.converged.all()
    assert many.rpm.tolist() == rpm.tolist()
    np.testing.assert_allclose(many.angles[:5], few.angles, rtol=1e-10, atol=rounding)
    last = jaxhb.solve_speeds(train, rpm=rpm[-1:])  # in a batch that is padded
    np.testing.assert_allclose(many.angles[-1:], last.angles, rtol=1e-10, atol=rounding)
    # No pressure table is copied.
    plan = jaxhb.plan(train, rpm=600.0, harmonics=few.harmonics)
    batch = jax.vmap(lambda speed: jaxhb.solve(train, rpm=speed, plan=plan))(rpm[:5])
    largest = max(leaf.size for leaf in jax.tree.leaves(batch))
    assert largest < train.cylinders.pressure.size


@pytest.mark.slow
def test_a_march_where_no_tooth_was_expected_to_separate_begins_above_the_mesh_modes(
    pair,
):
    train = jaxhb.load_scene("engine_with_damper")
    rpm = 1900.0
    attempts = attempts_at(train, rpm)
    first, march = (
        next(strategy(attempts)).plan
        for strategy in (starts.contact_unseparated, starts.from_sweeps)
    )
    modes, _ = mesh_modes.mesh_mode_harmonics(
        train, train.topology.cycle_frequency(rpm)
    )
    assert [first.start, march.start] == ["linear", "march"]
    assert first.harmonics < modes < 1.5 * modes <= march.harmonics
    attempts = attempts_at(pair, 7950.0, harmonics=50)
    assert attempts.case.plan.start == "linear"
    assert attempts.case.plan.active
    attempts.make([starts.from_sweeps])
    assert attempts.response.converged


@pytest.mark.slow
def test_an_amplitude_raised_from_zero_is_not_dropped_by_a_plan(pair):
    silent = pair.replace(
        {"error a.harmonics": [[0.0, 0.0]], "error b.harmonics": [[0.0, 0.0]]}
    )
    contact = jaxhb.plan(silent, rpm=3000.0)
    planned, free = (jaxhb.solve(pair, rpm=3000.0, plan=p) for p in (contact, None))
    assert planned.force("gear a", "gear b").max == pytest.approx(
        float(free.force("gear a", "gear b").max), rel=1e-9
    )


def test_mean_torque_that_nothing_holds_has_a_status():
    """A ring behind a viscous link takes no mean torque: found in the program, whatever
    the host saw.
    """
    parts = [
        jaxhb.Disk(name="hub", inertia=1.0, damping=1.0),
        jaxhb.Damper(
            name="ring", disk="hub", inertia=0.5, damping=2.0, stiffness=100.0
        ),
        jaxhb.Ground(disk="ring", stiffness=50.0),
        jaxhb.Torque(disk="hub", mean=5.0, harmonics=((1.0, 3.0, 0.0),)),
    ]
    train = jaxhb.build(parts)
    plan = jaxhb.plan(train, rpm=60.0)

    def solve(stiffness):
        return jaxhb.solve(
            train.replace({"ring.stiffness": stiffness}), rpm=60.0, plan=plan
        ).status

    assert int(jax.jit(solve)(100.0)) == jaxhb.Status.CONVERGED
    assert int(jax.jit(solve)(0.0)) == jaxhb.Status.UNBALANCED


@pytest.mark.slow
def test_a_mesh_that_stays_loaded_beside_one_that_hammers_is_no_unknown():
    train = build(pinions_parts(pump=300.0), reference="flywheel")
    (plan,) = planning.plan_speeds(train, np.array([1500.0]), Request(harmonics=192))
    assert plan.active == (0,)
    assert plan.flank == (0, 1)
    assert plan.harmonics == 192
    every = dataclasses.replace(plan, active=(0, 1), flank=(0, 0))
    single, both = (jaxhb.solve(train, rpm=1500.0, plan=p) for p in (plan, every))
    assert single.converged
    assert both.converged
    for mesh in ("crank gear|cam gear", "crank gear|pump gear"):
        expected = float(both.force(mesh).max)
        assert single.force(mesh).max == pytest.approx(expected, rel=1e-8)


@pytest.mark.slow
def test_a_mesh_thought_loaded_that_leaves_its_flank_is_planned_again():
    train = build(pinions_parts(pump=40.0), reference="flywheel")
    mesh = "crank gear|pump gear"
    careful = jaxhb.solve(train, rpm=1500.0, harmonics=192)
    case = attempts_at(train, 1500.0, harmonics=192).case
    index = train.topology.mesh_names.index(mesh)
    flank = tuple(
        careful.mesh(mesh).drive_side if i == index else side
        for i, side in enumerate(case.plan.flank)
    )
    active = tuple(i for i in case.plan.active if i != index)
    plan = dataclasses.replace(case.plan, active=active, flank=flank)
    attempts = starts.Attempts(dataclasses.replace(case, plan=plan))
    attempts.make([starts.from_sweeps])
    response = attempts.response
    assert response.path[1].status == jaxhb.Status.PLAN_VIOLATED
    assert response.converged
    assert response.mesh(mesh).separated_fraction > 0
    expected = float(careful.force(mesh).max)
    assert response.force(mesh).max == pytest.approx(expected, rel=1e-8)


@pytest.mark.slow
def test_numbers_that_are_invalid_have_a_status_under_jit(lanes):
    """Speed, and every kind of number that is checked where it is concrete; absent ones
    are 0 and valid.
    """
    *status, not_solved, not_finite = lanes[0].status.tolist()
    assert status[:3] == [jaxhb.Status.CONVERGED] * 3
    assert status[3:] == [jaxhb.Status.INVALID_INPUT] * (len(OUT_OF_RANGE) + len(WRONG))
    assert not_solved in (jaxhb.Status.STALLED, jaxhb.Status.MAX_STEPS)
    assert not_finite == jaxhb.Status.NONFINITE


@pytest.mark.slow
@pytest.mark.parametrize("place", [len(SPEEDS), -2], ids=["out of range", "not solved"])
def test_nothing_computed_is_told_of_a_speed_that_is_not_solved(
    place, pair, plan, lanes
):
    """Given numbers are told, and nan is no start."""
    response = dataclasses.replace(
        jax.tree.map(lambda leaf: leaf[place], lanes[0]), train=pair
    )
    assert not response
    not_computed = {
        "rpm",
        "radius",
        "law",
        "status",
        "steps",
        "topology",
        "resolution",
        "sharp",
        "train",
        "path",
        "certificate",
    }
    for name in {f.name for f in dataclasses.fields(response)} - not_computed:
        leaves = jax.tree.leaves(getattr(response, name))
        assert all(np.isnan(leaf).all() for leaf in leaves), name
    force = response.force("gear a", "gear b")
    contact = response.mesh("gear a", "gear b")
    read = [
        force.max,
        force.min,
        force.peak,
        force.mean,
        force.rms,
        force.half_peak_to_peak,
        force.order(32),
        force.order(3.2e6),
        force.smooth_peak(),
        force.sum_of_amplitudes,
        response.power("gear a", "gear b"),
        contact.separated_fraction,
        contact.reverse_contact_fraction,
        contact.pulling_force,
    ]
    assert np.isnan(read).all()
    assert contact.impacts == []
    refused(
        lambda: jaxhb.check(response),
        jaxhb.Status(int(response.status)).name,
        jaxhb.NotConverged,
    )
    again = jaxhb.solve(pair, rpm=HAMMERING_RPM, plan=plan, start=response)
    assert not np.isnan(again.residual)


def test_the_numbers_of_every_packaged_scene_are_within_their_ranges():
    within = jax.jit(within_range)
    assert all(bool(within(jaxhb.load_scene(scene))) for scene in jaxhb.scene_names())


@pytest.mark.slow
def test_a_response_is_a_clean_tree(pair, plan):
    """Arrays of the speed and nothing else: two responses of one plan are one
    structure, and nothing traces again.
    """
    responses = [
        jaxhb.solve(pair, rpm=rpm, plan=plan) for rpm in np.linspace(5500.0, 5900.0, 5)
    ]
    assert len({jax.tree.structure(response) for response in responses}) == 1
    traced = []

    @jax.jit
    def largest(response):
        traced.append(response)
        return response.force("gear a", "gear b").max

    values = [float(largest(response)) for response in responses]
    assert len(traced) == 1
    assert len(set(values)) == 5
    sweep = stack(responses)
    assert all(len(leaf) == 5 for leaf in jax.tree.leaves(sweep))
    np.testing.assert_allclose(
        jax.vmap(lambda r: r.force("gear a", "gear b").max)(sweep), values, rtol=1e-12
    )
    assert sweep[3].train is pair
    assert jax.tree.map(np.asarray, sweep[3]).train is None


def test_mesh_forces_of_the_linear_train_are_those_of_the_program_of_long_trains(
    monkeypatch,
):
    train = jaxhb.load_scene("gear_train_30")
    request = Request.of(train)
    contact = planning.contact_plan(train, request)
    few = np.array([700.0, 1800.0])
    host = planning._linear_mesh_forces(train, few, contact, 24)
    one_by_one = [
        planning._linear_mesh_forces(train, few[i : i + 1], contact, 24)[0]
        for i in range(2)
    ]
    np.testing.assert_allclose(
        host, one_by_one, rtol=0, atol=1e-12 * np.abs(host).max()
    )
    monkeypatch.setattr(planning, "HOST_DISKS", 0)
    shared = planning._linear_mesh_forces(train, few, contact, 24)
    assert np.abs(host - shared[..., :25]).max() < 1e-12 * np.abs(shared).max()

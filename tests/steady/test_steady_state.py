"""Motions of trains that have run long enough: their kinds and their numbers, against
exact motions and long integrations.
"""

import dataclasses
from types import SimpleNamespace

import jax
import numpy as np
import pytest
import trains
from reference_data import reference

import jaxhb
from jaxhb.balance.swept import difference
from jaxhb.equations import backlash
from jaxhb.integration.step import cycle
from jaxhb.results.status import Sweeps
from jaxhb.steady import classification
from jaxhb.steady.closure import Cycles
from jaxhb.steady.marching import Batch, Equations, record_of
from jaxhb.train.excitation import excitation, highest_harmonic
from jaxhb.train.mesh_parameters import law_meshes


def one_mass(omega):
    """Gears without a spring in their gap under a force that grows with the square of
    the speed, as published.
    """
    return trains.pair_train(
        trains.Pair(omega, mean=0.1, alternating=0.05j * omega**2), transition=1e-3
    )


def moved(state, other):
    """Relative difference of two motions over two cycles."""
    return difference(state.response.deflections, other.response.deflections, 2)


def rpm(omega):
    """Speeds at which the excitation has angular frequencies in units of the natural
    one.
    """
    return np.asarray(omega) * trains.ONE_RADIAN_PER_SECOND


@pytest.mark.slow
def test_teeth_that_the_linear_motion_holds_stay_in_contact():
    # Where there are no teeth none can be in contact: the motion is periodic.
    for name, speed, kind in (
        ("six_cylinder_diesel", 1500.0, "periodic"),
        ("gear_train_30", 600.0, "contact"),
    ):
        train = jaxhb.load_scene(name)
        state = jaxhb.steady_state(train, rpm=speed)
        linear = jaxhb.linear_response(train, rpm=speed)
        # At 600 rpm a mesh comes so near its gap that its law bends.
        swept = kind == "contact"
        assert state.kind == kind
        assert state.period == 1
        assert (state.cycles > 0) == swept
        assert state.notes == ()
        assert ([type(event) for event in state.response.path] == [Sweeps]) == swept
        shaft = train.topology.shaft_names[0]
        np.testing.assert_allclose(
            float(state.torque(shaft).max), float(linear.torque(shaft).max), rtol=1e-5
        )


def test_a_longer_cycle_has_the_same_excitation_at_multiples_of_its_harmonics():
    for name in ("gear_train_30", "six_cylinder_diesel"):
        train = jaxhb.load_scene(name)
        for cycles in (2, 3):
            harmonics = highest_harmonic(train)
            long = train.repeated(cycles)
            assert highest_harmonic(long) == cycles * harmonics
            once = excitation(train, 1500.0, harmonics)[0]
            often = excitation(long, 1500.0, cycles * harmonics)[0]
            np.testing.assert_allclose(often[:, ::cycles], once, rtol=1e-12)
            between = np.arange(often.shape[1]) % cycles != 0
            assert not often[:, between].any()


@pytest.mark.slow
def test_sweeps_up_and_down_follow_the_exact_stable_branches():
    rows = reference("backlash_one_mass_exact")["kahraman_singh_form"]["rows"]
    omegas = sorted({row["Omega"] for row in rows})
    exact = {
        omega: [row["max"] for row in rows if row["Omega"] == omega] for omega in omegas
    }
    highest = {}
    for way in ("up", "down"):
        state = None
        for omega in omegas if way == "up" else omegas[::-1]:
            state = jaxhb.steady_state(one_mass(omega), rpm=rpm(omega), start=state)
            assert state.period == 1
            highest[way, omega] = float(state.deflection("a", "b").max)
            errors = [abs(highest[way, omega] - largest) for largest in exact[omega]]
            # Harmonics left out; the transition zone moves extremes by a few of its
            # squares.
            assert min(errors) < 5e-4
    coexisting = {omega for omega in omegas if np.ptp(exact[omega]) > 0.01}
    apart = {
        omega
        for omega in omegas
        if abs(highest["up", omega] - highest["down", omega]) > 0.01
    }
    assert coexisting == apart
    assert coexisting


@pytest.mark.slow
def test_the_packaged_train_hammers_with_the_statistics_of_a_finer_integration():
    train = jaxhb.load_scene("gear_train_30")
    state = jaxhb.steady_state(train, rpm=2400.0)
    assert (state.kind, state.period) == ("irregular", 0)
    force = state.force("crank gear", "idler")
    lowest = force.per_cycle.min[0]
    uppermost = force.per_cycle.max[2]
    assert force.min <= lowest <= force.mean <= uppermost <= force.max
    orbit = jaxhb.integrate(train, rpm=2400.0, steps=4096, cycles=64)
    highest = np.empty((64, 4))
    run = jax.jit(cycle)
    z = orbit.state
    for c in range(64):
        z, trace = run(orbit.stepper, z)
        law = jax.tree.map(lambda a: np.asarray(a)[:, None], orbit.stepper.law)
        elastic = backlash.force(law, np.asarray(trace.deflection))
        highest[c] = np.asarray(elastic).max(axis=1)
    for g, name in enumerate(train.topology.mesh_names):
        signal = state.force(name).elastic
        median = signal.per_cycle.max[1]
        # Two records of 64 cycles of the same irregular motion: their largest, and the
        # middle of their distributions.
        assert abs(signal.max - highest[:, g].max()) < 0.05 * signal.max
        assert abs(median - np.median(highest[:, g])) < 0.03 * signal.max


@pytest.fixture(scope="module")
def hammering():
    return jaxhb.solve(jaxhb.load_scene("gear_train_30"), rpm=1800.0)


@pytest.mark.slow
def test_a_short_march_is_what_was_asked_and_its_record_is_read_as_a_response_is(
    hammering,
):
    train = jaxhb.load_scene("gear_train_30")
    state = jaxhb.steady_state(
        train, rpm=2400.0, cycles=Cycles(transient=8, recorded=16), exact=False
    )
    assert (state.record.cycles, state.cycles) == (16, 24)
    response = hammering
    for read in (
        lambda motion: motion.force("crank gear", "idler"),
        lambda motion: motion.gear_torque("idler"),
        lambda motion: motion.torque("throw 1", "throw 2"),
        lambda motion: motion.torque("cam damper A"),
        lambda motion: motion.twist("throw 1", "throw 2"),
        lambda motion: motion.disk("flywheel"),
        lambda motion: motion.deflection("crank gear", "idler"),
        lambda motion: motion.speed("cam gear A"),
    ):
        signal = read(state)
        other = read(response)
        assert signal.min <= signal.mean <= signal.max
        assert signal.rms <= signal.peak
        assert signal.half_peak_to_peak == pytest.approx((signal.max - signal.min) / 2)
        assert signal.order(1.0) > 0
        # The same quantity at another speed, of another size, but in the same unit:
        # wrong units are 57 or 1000 times as large.
        assert 0.2 < signal.rms / other.rms < 5
    # Half the speed of the crank.
    half_speed = np.pi / 60 * 2400.0
    assert state.speed("cam gear A").mean == pytest.approx(half_speed, rel=1e-3)
    assert 0.2 < state.irregularity("idler") / response.irregularity("idler") < 5
    for read in (
        lambda motion: motion.power("throw 1", "throw 2"),
        lambda motion: motion.power("crank damper"),
    ):
        # Heat grows with the square of the speeds of both ends.
        assert 0.2 < read(state) / read(response) < 20
    assert np.isnan(state.power("crank gear|idler"))
    forward = state.force("crank gear", "idler")
    back = state.force("idler", "crank gear")
    assert (back.max, back.min, back.mean) == (
        -forward.min,
        -forward.max,
        -forward.mean,
    )
    contact = state.mesh("crank gear", "idler")
    assert contact.impacts_per_cycle > 1
    assert contact.hardest_impact > 0.1
    with pytest.raises(ValueError, match="use torque"):
        state.force("throw 1", "throw 2")
    with pytest.raises(ValueError, match="carries no mesh"):
        state.gear_torque("flywheel")


@pytest.mark.slow
def test_a_record_of_a_periodic_motion_has_the_numbers_of_its_harmonics(hammering):
    train = hammering.train
    response = hammering
    equations = Equations(train)
    batch = Batch(equations, np.array([1800.0]), 4096)
    for _ in range(4):
        batch.run(batch.marches)
    batch.run(batch.marches, record=True)
    record = record_of(equations, batch.marches[0])
    topology = train.topology
    for i, name in enumerate(topology.mesh_names):
        recorded = record.forces[i]
        force = response.force(name)
        for actual, expected in (
            (recorded, force),
            (recorded.elastic, force.elastic),
        ):
            # The truncation error of the response is about 0.3 %, the error of 4096
            # steps 0.1 %.
            assert abs(actual.max - expected.max) < 0.006 * expected.peak
            assert abs(actual.min - expected.min) < 0.006 * expected.peak
            assert abs(actual.rms - expected.rms) < 2e-3 * expected.rms
        np.testing.assert_allclose(
            recorded.elastic.amplitudes[:40],
            force.elastic.amplitudes[:40],
            atol=1e-3 * force.elastic.amplitudes.max(),
        )
        contact = response.mesh(name)
        marched = record.contacts[i]
        separated = abs(contact.separated_fraction - marched.separated_fraction)
        reverse = abs(
            contact.reverse_contact_fraction - marched.reverse_contact_fraction
        )
        assert separated < 2e-3
        assert reverse < 2e-3
        assert abs(len(contact.impacts) - marched.impacts_per_cycle) <= 1
    for i, name in enumerate(topology.shaft_names + topology.damper_names):
        recorded = record.torques[i]
        torque = response.torque(name)
        for actual, expected in (
            (recorded, torque),
            (recorded.elastic, torque.elastic),
        ):
            size = expected.half_peak_to_peak + 1e-9
            assert abs(actual.max - expected.max) < 0.01 * size
            assert abs(actual.mean - expected.mean) < 1e-3 * expected.peak
    for disk, recorded in record.gears.items():
        torque = response.gear_torque(topology.disk_names[disk])
        difference = abs(recorded.half_peak_to_peak - torque.half_peak_to_peak)
        assert difference < 0.01 * torque.half_peak_to_peak


def test_a_sweep_keeps_the_motion_of_its_neighbour_where_two_are_possible():
    train = one_mass(0.85)
    speeds = rpm(np.linspace(0.6, 1.1, 11))
    reported = {"up": {}, "down": {}}
    up, down = jaxhb.steady_state(
        train,
        rpm=speeds,
        direction="both",
        on_states=lambda states, way: reported[way].update(states),
    )
    # The states reported last are returned.
    for sweep in (up, down):
        assert all(reported[sweep.direction][i] is sweep[i] for i in range(11))
    assert up.kind.shape == up.period.shape == (11,)
    np.testing.assert_allclose(up.rpm, speeds)
    upwards = [float(state.deflection("a", "b").max) for state in up]
    downwards = [float(state.deflection("a", "b").max) for state in down]
    assert np.ptp([upwards, downwards], axis=0).max() > 0.1


def test_a_sweep_keeps_the_motion_of_its_neighbour_where_another_is_as_large():
    """Two motions of two cycles, whose largest deflections differ by 3 % and their
    waves by a fifth.
    """
    train = trains.pair_train(trains.Pair(1.0, epsilon=1e-3), transition=0.01)
    speeds = rpm([3175 / 3000, 3200 / 3000])
    before, state = jaxhb.steady_state(train, rpm=speeds)
    alone = jaxhb.steady_state(train, rpm=speeds[1], start=None)
    after = jaxhb.steady_state(train, rpm=speeds[1], start=before)
    assert {s.period for s in (before, state, alone, after)} == {2}
    assert moved(state, after) < 0.01
    assert moved(alone, after) > 0.1
    expected = float(after.deflection("a", "b").peak)
    assert float(alone.deflection("a", "b").peak) == pytest.approx(expected, rel=0.05)


def test_a_massless_gear_with_backlash_is_unknown_with_its_reason():
    light = {"gear a.inertia": 0.0, "drive.mean": 1.0, "brake.mean": -1.0}
    state = jaxhb.steady_state(jaxhb.load_scene("spur_pair").replace(light), rpm=6000.0)
    assert state.kind == "unknown"
    assert not state.known
    assert "'gear a' has no inertia and carries a backlash mesh" in state.notes[0]
    with pytest.raises(ValueError, match="no inertia"):
        state.force("gear a", "gear b")


@pytest.mark.slow
def test_loss_factors_are_damping_in_the_march_and_themselves_in_the_answer():
    def lossy(part):
        return (
            dataclasses.replace(part, loss_factor=0.03, damping=0.0)
            if isinstance(part, jaxhb.Shaft)
            else part
        )

    train = trains.build(
        [lossy(p) for p in trains.pinions_parts(20.0)], reference="crank gear"
    )
    state = jaxhb.steady_state(train, rpm=1500.0)
    assert state.kind == "periodic"
    assert "loss factors" in state.notes[0]
    assert state.response.train is not None
    assert state.stability.stable
    solved = jaxhb.solve(train, rpm=1500.0, start=state.response)
    assert solved.converged
    mesh = "crank gear|cam gear"
    shaft = "flywheel|crank gear"
    force = float(state.force(mesh).max)
    assert force == pytest.approx(float(solved.force(mesh).max), rel=0.01)
    # Recorded torques have the part that loss factors transmit.
    recorded = jaxhb.steady_state(train, rpm=1500.0, exact=False)
    assert float(recorded.force(mesh).max) == pytest.approx(force, rel=0.02)
    torque = state.torque(shaft)
    marched = recorded.torque(shaft)
    swing = float(torque.half_peak_to_peak)
    assert marched.half_peak_to_peak == pytest.approx(swing, rel=0.02)
    assert marched.rms == pytest.approx(float(torque.rms), rel=0.01)
    # Heat of a loss factor.
    heat = float(state.power(shaft))
    assert recorded.power(shaft) == pytest.approx(heat, rel=0.02)
    # A gear that is hit rings, damped by its modes.
    for disk, tolerance in (("flywheel", 0.01), ("cam gear", 0.05)):
        irregularity = float(state.irregularity(disk))
        speed = float(state.speed(disk).mean)
        assert recorded.irregularity(disk) == pytest.approx(irregularity, rel=tolerance)
        assert recorded.speed(disk).mean == pytest.approx(speed, rel=1e-3)


def test_what_cannot_be_done_is_a_sentence():
    train = jaxhb.load_scene("gear_train_30")
    with pytest.raises(ValueError, match="direction is 'left'"):
        jaxhb.steady_state(train, rpm=[1000.0], direction="left")
    with pytest.raises(TypeError, match="pass|differentiate"):
        jax.jit(lambda speed: jaxhb.steady_state(train, rpm=speed))(1000.0)
    other = jaxhb.steady_state(jaxhb.load_scene("spur_pair"), rpm=1000.0)
    with pytest.raises(jaxhb.SceneError, match="another train"):
        jaxhb.steady_state(train, rpm=1000.0, start=other)


@pytest.mark.slow
def test_a_motion_to_which_a_train_takes_hundreds_of_cycles_is_waited_for():
    """Its mode takes 113 cycles to decay; Runge-Kutta through links
    (``benchmarks/kinds.py``) has this period, too.
    """
    pair = jaxhb.load_scene("spur_pair").replace({"gear a|gear b.damping": 31.8})
    early = jaxhb.steady_state(pair, rpm=6000.0, cycles=Cycles(transient=192))
    assert early.kind == "irregular"
    assert any(
        "takes 113 cycles to fall to a third" in note and "may still change" in note
        for note in early.notes
    )
    state = jaxhb.steady_state(pair, rpm=6000.0, cycles=None)
    later = jaxhb.steady_state(pair, rpm=6000.0, cycles=Cycles(transient=1500))
    assert (state.kind, state.period) == ("subharmonic", 2)
    assert (later.kind, later.period) == ("subharmonic", 2)
    assert state.response.converged
    assert state.stability.stable
    # Long after, the motion is still the one that harmonic balance found.
    assert moved(state, later) < 1e-3


@pytest.mark.slow
def test_a_motion_of_one_cycle_that_is_approached_in_turns_is_no_subharmonic_one():
    """Its multipliers, 0.97 at 104 degrees, let seven cycles nearly return long before
    one does.
    """
    train = jaxhb.load_scene("spur_pair").replace({"gear a|gear b.damping": 106.1})
    state = jaxhb.steady_state(train, rpm=6500.0)
    assert (state.kind, state.period) == ("periodic", 1)
    response = jaxhb.solve(train, rpm=6500.0)
    largest = float(state.force("gear a", "gear b").max)
    expected = float(response.force("gear a", "gear b").max)
    assert largest == pytest.approx(expected, rel=5e-3)


@pytest.mark.slow
def test_a_motion_that_repels_is_not_what_the_train_does():
    """A march passes near it for long, and harmonic balance solves it: its multiplier
    is -1.1.
    """
    train = jaxhb.load_scene("gear_train_30")
    state = jaxhb.steady_state(train, rpm=2300.0)
    assert not jaxhb.stability(jaxhb.solve(train, rpm=2300.0)).stable
    assert state.response is None or jaxhb.stability(state.response).stable


@pytest.mark.parametrize(
    ("closure_error", "period", "moved", "recognised"),
    [
        (1e-2, 1, 1.0, True),
        (1e-5, 1, 1.0, False),
        (1e-2, 2, 1.0, False),
        (1e-2, 1, 1.2, False),
    ],
)
def test_a_motion_that_a_march_passed_by_is_known_when_it_passes_again(
    closure_error, period, moved, recognised
):
    """Not where the march has come to a motion, or to one of another period, or to
    another motion of the same period.
    """
    train = one_mass(1.3)
    response = jaxhb.solve(train, rpm=rpm(1.3))
    deflection = moved * response.deflection_samples(64)[train.topology.law_index]
    closure = SimpleNamespace(errors=lambda period: [closure_error])
    classified = SimpleNamespace(
        classifier=SimpleNamespace(
            train=train, repelling={0: [classification.SolvedMotion(response, 1)]}
        ),
        index=0,
        march=SimpleNamespace(closure=closure),
        batch=SimpleNamespace(equations=SimpleNamespace(meshes=law_meshes(train))),
    )
    passed = classification._Classification._passed_again(
        classified, np.concatenate([deflection] * 2), period
    )
    assert passed is (response if recognised else None)

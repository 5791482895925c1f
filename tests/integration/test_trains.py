"""Time integration of drive trains against independent integrators and dense harmonic
solutions.
"""

import dataclasses
from types import SimpleNamespace

import dense
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from integrated_trains import pair, posed
from scipy.integrate import solve_ivp

from jaxhb import shooting_correction, solve
from jaxhb.elements.elements import Disk, Ground, Mesh, Shaft
from jaxhb.elements.excitations.crank_slider import Cylinder
from jaxhb.elements.excitations.torque import Torque
from jaxhb.equations import fourier
from jaxhb.equations.state_space import dense_linear_motion, matrices, partition
from jaxhb.integration import reference
from jaxhb.integration.reference import integrate, resolving_steps
from jaxhb.integration.shooting import monodromy, shoot
from jaxhb.integration.step import cycle, discretize, march as march_on
from jaxhb.scene.files import load_scene
from jaxhb.train.assembly import build
from jaxhb.train.excitation import highest_harmonic, listed_harmonic

HAMMERING_RPM = 2200.0
STEPS = 2000
"""Of a cycle: numbers of steps are programs of their own."""
cut = jax.jit(discretize, static_argnames=("steps", "parts"))
march = jax.jit(march_on)
correct = jax.jit(shoot)


def run(stepper, state, cycles):
    """State and last cycle after some cycles."""
    return march(stepper, state, tolerance=-1.0, max_cycles=cycles)[:2]


def stepper_of(posed_train, steps):
    system, meshes, frequency, load = posed_train
    parts = partition(system, meshes)
    return cut(system, meshes, frequency, load, steps=steps, parts=parts)


def adaptive(system, meshes, frequency, load, x, v, cycles, samples):
    """Deflections of the last cycle by an adaptive integrator of the plain
    equations.
    """
    B, K = (np.array(matrix) for matrix in matrices(system))
    link = np.asarray(meshes.link)
    columns = np.asarray(system.incidence(link))
    mass = np.asarray(system.mass)
    load = np.asarray(load)
    B -= columns @ np.diag(np.asarray(system.viscous)[link]) @ columns.T
    K -= columns @ np.diag(np.asarray(system.stiffness)[link]) @ columns.T
    law = SimpleNamespace(
        **{name: np.asarray(value) for name, value in vars(meshes.law).items()}
    )
    gated = np.asarray(meshes.contact_damping)
    r = np.asarray(meshes.viscous)
    disks = mass.size
    n = np.arange(load.shape[1])

    def motion(t, y):
        deflection = columns.T @ y[:disks]
        rate = columns.T @ y[disks:]
        f, share = dense.law(law, deflection)
        f = f + r * rate * np.where(gated, share, 1.0)
        wave = np.exp(1j * n * frequency * t) * np.where(n == 0, 1, 2)
        q = (load @ wave).real
        force = q - columns @ f - B @ y[disks:] - K @ y[:disks]
        return np.concatenate([y[disks:], force / mass])

    period = 2 * np.pi / frequency
    times = period * (cycles - 1 + np.arange(samples) / samples)
    start = np.concatenate([x, v])
    out = solve_ivp(
        motion,
        (0, cycles * period),
        start,
        "DOP853",
        times,
        rtol=1e-11,
        atol=1e-13,
        max_step=period / 400,
    )
    return columns.T @ out.y[:disks]


@pytest.mark.slow
@pytest.mark.parametrize("law", ["contact", "always"])
def test_a_hammering_train_converges_to_an_adaptive_integrator(law):
    posed_train = posed(pair(damping_law=law), HAMMERING_RPM)
    system, meshes, frequency, load = posed_train
    response = dense_linear_motion(
        jax.tree.map(jnp.asarray, system), frequency, jnp.asarray(load)
    )
    x = fourier.synthesize(response, 64)[:, 0]
    v = fourier.synthesize(fourier.derivative(response, frequency), 64)[:, 0]
    expected = adaptive(system, meshes, frequency, load, x, v, 2, STEPS)
    assert (np.abs(expected) < 0.9 * meshes.law.backlash[0] / 2).any()
    errors = []
    for steps in (STEPS, 8 * STEPS):
        stepper = stepper_of(posed_train, steps)
        _, trace = run(stepper, 0.0 * stepper.flank_state, 2)
        deflection = trace.deflection[:, :: steps // STEPS]
        errors.append(np.abs(deflection - expected).max() / np.abs(expected).max())
    assert errors[1] < 1e-6
    # Orders 2 (damping in contact has a kink where engagement begins) and 3, scattered
    # by where steps meet the knots.
    assert np.log2(errors[0] / errors[1]) / 3 > (1.4 if law == "contact" else 2.2)


@pytest.mark.parametrize("ground", [True, False])
def test_teeth_that_stay_on_their_flank_start_on_the_periodic_motion(ground):
    train = pair(ground=ground, damping_law="always").replace(
        {"gear a|gear b.transition": 0.005}
    )
    stepper = stepper_of(posed(train, 300.0), STEPS)
    law = stepper.law.expand()
    _, trace = run(stepper, stepper.flank_state, 1)
    assert (jnp.abs(trace.deflection) > law.knee).all()
    assert trace.periodicity_error < 1e-9


@pytest.mark.slow
def test_a_floating_train_is_the_limit_of_a_soft_ground():
    traces = {}
    for ground in (10.0, 0.1, 0.0):
        train = pair(ground=ground > 0)
        train = train.replace({"driven:ground.stiffness": ground}) if ground else train
        stepper = stepper_of(posed(train, HAMMERING_RPM), STEPS)
        start, _ = run(stepper, stepper.flank_state, 20)
        state, periodicity_error, _ = correct(stepper, start)
        assert periodicity_error < 1e-10
        traces[ground] = np.asarray(jax.jit(cycle)(stepper, state)[1].deflection)
    size = np.abs(traces[0.0]).max()
    assert np.abs(traces[10.0] - traces[0.0]).max() < 1e-2 * size
    assert np.abs(traces[0.1] - traces[0.0]).max() < 1e-4 * size
    matrix, _ = jax.jit(monodromy)(stepper, state)
    multipliers = np.sort(np.abs(np.linalg.eigvals(matrix)))[::-1]
    # The angles of the train and of the ring, which no spring holds.
    np.testing.assert_allclose(multipliers[:2], 1, atol=1e-8)
    assert multipliers[2] < 0.999


def test_a_march_ends_where_a_cycle_closes_or_after_so_many():
    stepper = stepper_of(posed(pair(), HAMMERING_RPM), STEPS)
    _, trace, done = march(stepper, stepper.flank_state, tolerance=1e-6, max_cycles=3)
    assert done == 3
    assert trace.periodicity_error > 1e-6
    _, trace, done = march(stepper, stepper.flank_state, tolerance=1e-6, max_cycles=300)
    assert done < 300
    assert trace.periodicity_error <= 1e-6


def massless_pair(inertia, damping, grounded=True):
    """The pair with a light disk in the shaft of the driven gear."""
    parts = [
        Disk(name="gear a", inertia=0.01, radius=0.05),
        Disk(name="gear b", inertia=0.03, radius=0.1),
        Disk(name="flange", inertia=inertia),
        Disk(name="driven", inertia=0.1, damping=1.0),
        Shaft(between=("gear b", "flange"), stiffness=2e4, damping=damping),
        Shaft(between=("flange", "driven"), stiffness=2e4, damping=2 * damping),
        Mesh(
            between=("gear a", "gear b"),
            stiffness=1e8,
            damping=1500.0,
            backlash=2e-4,
            epsilon=1e-3,
            transition=0.1,
        ),
        Torque(
            disk="gear a", mean=20.0, harmonics=[(1.0, 40.0, -20.0), (2.0, 10.0, 30.0)]
        ),
        Torque(disk="driven", mean=-40.0, harmonics=[(1.0, 30.0, 10.0)]),
        *([Ground(disk="driven", stiffness=10.0)] if grounded else []),
    ]
    return build(parts, revolutions_per_cycle=1, reference="gear a", name="massless")


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.0, 3.0])
def test_a_massless_disk_is_the_limit_of_a_light_one(damping):
    traces = []
    for inertia in (0.0, 1e-8):
        posed_train = posed(massless_pair(inertia, damping), 2000.0)
        stepper = stepper_of(posed_train, 4000)
        _, trace = run(stepper, stepper.flank_state, 4)
        traces.append(np.asarray(trace.deflection))
    system, meshes, *_ = posed(massless_pair(0.0, damping), 2000.0)
    parts = partition(system, meshes)
    counts = (len(parts.static), len(parts.damped))
    assert counts == ((1, 0) if damping == 0 else (0, 1))
    assert np.ptp(traces[0]) > 1e-4
    assert np.abs(traces[0] - traces[1]).max() < 1e-4 * np.abs(traces[0]).max()


@pytest.fixture(scope="module")
def floating():
    """The response of a floating train with a damped massless disk."""
    return solve(massless_pair(0.0, 3.0, grounded=False), rpm=2000.0, harmonics=96)


@pytest.mark.slow
def test_a_floating_train_with_a_damped_massless_disk_is_closed(floating):
    """Its free rotation is no coordinate of its own: the equations that close the cycle
    are singular.

    An estimate is good to about a tenth. A train turned by 1e10 rad leaves no digits to
    its backlash.
    """
    correction = shooting_correction(floating)
    assert floating.residual < 1e-10
    assert correction.orbit.settled
    assert np.all(correction.orbit.separated > 0.1)
    assert abs(correction.error - floating.truncation_error) < 0.3 * correction.error
    turned = dataclasses.replace(
        floating, angles=floating.angles + 1e10 * (np.arange(97) == 0)
    )
    with pytest.raises(
        ValueError,
        match=(
            r"massless: the mean torques turn .* no digits for a backlash of 2.0e-04 m"
        ),
    ):
        shooting_correction(turned)


SHOTS = [
    ([(0.001, True)], 0.001, [None]),
    ([(0.2, True), (0.001, True)], 0.001, [None, 400]),
    ([(0.2, True)] * 3, 0.2, [None, 400, 1600]),
    ([(0.2, True), (0.001, False)], 0.2, [None, 400]),
    ([(0.2, False)], 0.2, [None]),
]


@pytest.mark.slow
@pytest.mark.parametrize(("outcomes", "error", "steps"), SHOTS)
def test_only_more_steps_that_close_overrule_a_correction_beside_the_estimate(
    monkeypatch, floating, outcomes, error, steps
):
    shots = []
    remaining = iter(outcomes)
    response = dataclasses.replace(floating, truncation_error=np.array(0.01))

    def shot(*_, steps, tolerance):
        shots.append(steps)
        error, settled = next(remaining)
        return SimpleNamespace(
            settled=settled, deflection=np.zeros((1, steps or 100)), error=error
        )

    monkeypatch.setattr(reference, "reference_orbit", shot)

    def same(*arguments):
        orbit = arguments[-1]
        return SimpleNamespace(error=orbit.error, orbit=orbit)

    monkeypatch.setattr(reference, "_difference", same)
    assert shooting_correction(response).error == error
    assert shots == steps


def test_what_cannot_be_integrated_is_refused_with_its_name():
    engine = load_scene("engine_with_damper")
    with pytest.raises(ValueError, match=r"'hub\|crank gear'.*with_viscous_damping"):
        integrate(engine, rpm=1000.0)
    light = load_scene("spur_pair")
    massless = light.replace({"gear a.inertia": 0.0})
    sentence = "'gear a' has no inertia and carries a backlash mesh"
    with pytest.raises(ValueError, match=sentence):
        integrate(massless, rpm=1000.0)
    with pytest.raises(ValueError, match="cycles is 0, must be at least 1"):
        integrate(light, rpm=1000.0, cycles=0)


def test_the_reference_integration_is_driven_by_all_harmonics_that_are_listed():
    """Inertia torques beyond order 6 do not count for the harmonics of the response,
    but drive the train.
    """
    piston = Cylinder(
        disk="a",
        stroke=0.1,
        rod=0.2,
        reciprocating_mass=1.0,
        gas_torque=[(1.0, 5.0, 0.0)],
    )
    train = build(
        [Disk(name="a", inertia=1.0), Ground(disk="a", stiffness=1e4), piston],
        revolutions_per_cycle=1,
    )
    *_, load = reference.equations_of(train, 1500.0)
    assert (
        load.shape[-1] - 1 == listed_harmonic(train.topology) > highest_harmonic(train)
    )


def test_a_train_without_backlash_is_integrated():
    parts = [
        Disk(name="a", inertia=1.0),
        Disk(name="b", inertia=1.0),
        Torque(disk="a", harmonics=[(1.0, 5.0, 0.0)]),
    ]
    train = build(
        [*parts, Shaft(between=("a", "b"), stiffness=1e4, damping=3.0)],
        revolutions_per_cycle=1,
    )
    orbit = integrate(train, rpm=1000.0)
    assert orbit.settled
    assert orbit.deflection.shape[0] == 0


def test_steps_follow_the_highest_mesh_mode():
    system, meshes, frequency, _ = posed(load_scene("gear_train_30"), 1800.0)
    steps = resolving_steps(system, meshes, frequency)
    assert abs(steps - 40 * 4333.1 / 15) < 0.01 * steps


@pytest.mark.slow
def test_the_monodromy_matrix_is_the_derivative_of_the_cycle():
    stepper = stepper_of(posed(pair(), HAMMERING_RPM), STEPS)
    state, _ = run(stepper, stepper.flank_state, 5)
    matrix, end = map(np.asarray, jax.jit(monodromy)(stepper, state))
    direction = np.random.default_rng(0).normal(size=state.size)
    step = 1e-6 * np.linalg.norm(state)
    ends = np.array(
        [
            jax.jit(cycle)(stepper, state + sign * step * direction)[0]
            for sign in (1, -1)
        ]
    )
    difference = (ends[0] - ends[1]) / (2 * step)
    error = np.linalg.norm(matrix @ direction - difference)
    assert error < 1e-5 * np.linalg.norm(difference)
    # The ends differ by the step squared.
    np.testing.assert_allclose(end, ends.mean(axis=0), atol=1e-9 * np.abs(end).max())

"""Shafts and dampers with play, stages, stops and dry friction, against integration by
scipy of equations written out here.
"""

import jax
import numpy as np
import pytest
from reference_data import refused
from scipy.integrate import solve_ivp
from tolerances import GRADIENT, PATHS

import jaxhb
from jaxhb.balance.plan import Request
from jaxhb.design.quantities import Objective, Parameter
from jaxhb.equations import fourier
from jaxhb.solutions import planning

STIFFNESS = 200.0  # N m/rad
DAMPING = 0.4  # N m s/rad
SMOOTH = 0.04  # half the width of a stage over its twist
RPM = 700.0
STAGED = {"stages": [(2.0, 800.0), (5.0, 3000.0)]}
MIXED = {
    "clearance": 1.0,
    "stages": [(3.0, 1000.0)],
    "stops": [(-5.0, 3000.0), (6.0, 5000.0)],
    "friction": 3.0,
    "slip_speed": 2.0,
}


def clutch(springs, mean=20.0):
    """An engine that drives a gear through a clutch disc."""
    parts = [
        jaxhb.Disk(name="engine", inertia=0.2, damping=0.3),
        jaxhb.Disk(name="gear", inertia=0.05, damping=0.5),
        jaxhb.Shaft(
            between=("engine", "gear"),
            stiffness=STIFFNESS,
            damping=DAMPING,
            name="disc",
            **springs,
        ),
        jaxhb.Torque(
            disk="engine", mean=mean, harmonics=[(2.0, 120.0, 30.0), (4.0, 20.0, 0.0)]
        ),
        jaxhb.Load(disk="gear"),
    ]
    return jaxhb.build(parts, reference="engine", revolutions_per_cycle=1)


def knee(x, at):
    """Force of a spring of 1 N m/rad that begins at a twist, in rad, its slope rising
    over 8 % of it.
    """
    inside = np.clip(x - (1 - SMOOTH) * at, 0, 2 * SMOOTH * at)
    beyond = np.maximum(x - (1 + SMOOTH) * at, 0)
    return inside**2 / (4 * SMOOTH * at) + beyond


def torque_of(
    twist, rate, *, clearance=0.0, stages=(), stops=(), friction=0.0, slip_speed=0.1
):
    """Torque of the clutch disc in N m."""
    play = np.deg2rad(clearance) / 2
    torque = STIFFNESS * (
        1e-3 * twist + 0.999 * np.sign(twist) * knee(np.abs(twist), play)
        if play
        else twist
    )
    before = STIFFNESS
    for at, stiffness in stages:
        torque = torque + (stiffness - before) * np.sign(twist) * knee(
            np.abs(twist), np.deg2rad(at)
        )
        before = stiffness
    for at, stiffness in stops:
        torque = torque + np.sign(at) * stiffness * knee(
            np.sign(at) * twist, np.deg2rad(abs(at))
        )
    return torque + DAMPING * rate + friction * np.clip(rate / slip_speed, -1, 1)


def integrated(response, rpm, springs, mean=20.0):
    """Twist and its rate ``(2, 513)`` over a cycle from the state of a response."""
    omega = 2 * np.pi * rpm / 60
    n = np.arange(response.harmonics + 1)

    def fall(t, y):
        (a, b), (a_rate, b_rate) = y.reshape(2, 2)
        torque = torque_of(a - b, a_rate - b_rate, **springs)
        waves = (120 + 30j) * np.exp(2j * omega * t) + 20 * np.exp(4j * omega * t)
        driven = mean + waves.real
        return [
            a_rate,
            b_rate,
            (driven - 0.3 * a_rate - torque) / 0.2,
            (torque - 0.5 * b_rate - mean) / 0.05,
        ]

    motion = [np.asarray(response.angles) * (1j * n * omega) ** k for k in (0, 1)]
    begin = np.concatenate(
        [m[:, 0].real + 2 * m[:, 1:].real.sum(axis=1) for m in motion]
    )
    at = 2 * np.pi / omega * np.arange(513) / 512
    y = solve_ivp(
        fall, (0, at[-1]), begin, t_eval=at, rtol=1e-10, atol=1e-13, max_step=at[1]
    ).y
    return np.array([y[0] - y[1], y[2] - y[3]])


@pytest.mark.slow
@pytest.mark.parametrize(
    "springs", [STAGED, {"stops": [(4.0, 2000.0)]}, {"clearance": 3.0}, MIXED]
)
def test_motion_and_torque_follow_the_equations(springs):
    mean = 2.0 if "clearance" in springs else 20.0  # it goes through the play
    train = clutch(springs, mean)
    response = jaxhb.solve(train, rpm=RPM, tolerance=1e-3)
    assert response
    twist, rate = integrated(response, RPM, springs, mean)
    size = np.ptp(twist)
    sampled = fourier.sample(np.asarray(response.angles[0] - response.angles[1]), 512)
    np.testing.assert_allclose(sampled, twist[:-1], rtol=0, atol=1e-3 * size)
    np.testing.assert_allclose(twist[-1], twist[0], rtol=0, atol=1e-3 * size)
    torque = response.torque("disc")
    expected = torque_of(twist, rate, **springs)
    ends = [expected.max(), expected.min()]
    np.testing.assert_allclose(
        [torque.max, torque.min], ends, rtol=0, atol=4e-3 * np.ptp(expected)
    )
    sliding = np.clip(rate / springs.get("slip_speed", 0.1), -1, 1)
    heat = DAMPING * rate**2 + springs.get("friction", 0.0) * rate * sliding
    assert float(response.power("disc")) == pytest.approx(heat[:-1].mean(), rel=5e-3)
    assert jaxhb.stability(response).stable


@pytest.mark.slow
def test_a_march_records_the_same_torque():
    train = clutch(STAGED)
    state = jaxhb.steady_state(train, rpm=RPM)
    assert state.period == 1
    response = jaxhb.solve(train, rpm=RPM, tolerance=1e-3)
    assert float(state.torque("disc").max) == pytest.approx(
        float(response.torque("disc").max), rel=5e-3
    )


@pytest.mark.slow
def test_below_the_first_stage_the_shaft_is_linear():
    far = jaxhb.solve(clutch({"stages": [(60.0, 3000.0)]}), rpm=RPM)
    linear = jaxhb.forced_response(clutch({}), rpm=RPM)
    assert far
    np.testing.assert_allclose(
        far.angles[:, :5], linear.angles[:, :5], rtol=0, atol=PATHS
    )


@pytest.mark.slow
def test_gradients_are_those_of_differences():
    names = ("disc.stages", "disc.stiffness", "disc.stops")
    step = 1e-3
    train = clutch({"stages": [(2.0, 800.0)], "stops": [(3.0, 1500.0)]})
    (plan,) = planning.plan_speeds(
        train, np.array([RPM]), Request(harmonics=64, integrals="exact")
    )
    start = jaxhb.solve(train, rpm=RPM)

    @jax.jit
    @jax.value_and_grad
    def torque(values):
        changed = train.replace(values)
        response = jaxhb.solve(changed, rpm=RPM, plan=plan, start=start)
        return response.torques[0, 2].real

    values = {name: np.asarray(train.value(name)) for name in names}
    _, gradients = torque(values)
    for name, value in values.items():
        direction = np.random.default_rng(1).normal(size=value.shape) * value
        slope = float(np.sum(np.asarray(gradients[name]) * direction))
        ends = [
            float(torque(values | {name: value + k * step * direction})[0])
            for k in (-2, -1, 1, 2)
        ]
        expected = (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * step)
        assert slope == pytest.approx(expected, rel=GRADIENT)


@pytest.mark.slow
def test_what_is_not_served_is_refused():
    train = clutch(MIXED)
    response = jaxhb.solve(train, rpm=RPM)
    refused(lambda: jaxhb.certify(response), "'disc': no bound", ValueError)
    refused(
        lambda: jaxhb.solve(train, rpm=RPM, method="chain"),
        "method 'chain' takes no play",
    )
    refused(
        lambda: jaxhb.solve(train, rpm=RPM, integrals="exact"),
        "exact integrals take no friction",
    )


@pytest.mark.slow
def test_a_clutch_is_tuned_and_checked_by_marches():
    train = clutch(STAGED)
    rpm = np.linspace(500.0, 1200.0, 4)
    parameters = [
        Parameter(name="disc.stiffness", low=50.0, high=400.0),
        Parameter(name="disc.damping", low=0.1, high=4.0),
    ]
    objective = Objective(quantity="shaft torque", of="disc")
    tuned = jaxhb.tune(
        train, parameters=parameters, rpm=rpm, objective=objective, steps=6
    )

    def largest(train):
        sweep = jaxhb.steady_state(train, rpm=rpm)
        return max(state.torque("disc").half_peak_to_peak for state in sweep)

    marched = [largest(train), largest(tuned.train)]
    readings = [
        sweep.readings["shaft torque of disc"].max()
        for sweep in (tuned.before, tuned.after)
    ]
    np.testing.assert_allclose(marched, readings, rtol=0.02)
    assert marched[1] < 0.5 * marched[0]

"""Links over frequency and amplitude, order-tuned absorbers, scenarios: against dense
matrices and constant links.
"""

import dataclasses

import dense
import jax.numpy as jnp
import numpy as np
import pytest
from differences import check_derivative
from tolerances import ALGEBRAIC
from trains import ONE_RADIAN_PER_SECOND, build

import jaxhb
from jaxhb import Damper, Disk, Ground, Mesh, SceneError, Shaft, Status, Torque
from jaxhb.linear import forced

OVER_HZ = ((0.0, 1.0, 1.0), (20.0, 1.5, 0.8), (60.0, 2.0, 0.3))
OVER_AMPLITUDE = ((0.0, 1.4, 0.5), (0.01, 1.0, 1.0), (0.05, 0.7, 1.8))
ORDERS = ((0.5, 200.0, 30.0), (1.0, 90.0, -40.0), (3.0, 60.0, 80.0), (6.0, 20.0, 0.0))
SPEEDS = np.array([300.0, 1300.0])
BALANCE = 1e-10


def parts(*, over_hz=(), over_amplitude=(), order=None, ring_damping=8.0):
    """An engine on a coupling with a rubber damper and a geared pump at twice its
    speed.
    """
    return [
        Disk(name="engine", inertia=1.2, damping=2.0),
        Disk(name="hub", inertia=0.1),
        Disk(name="gear", inertia=0.3, radius=0.2),
        Disk(name="pinion", inertia=0.02, radius=0.1),
        Disk(name="pump", inertia=0.4, damping=0.3),
        Shaft(between=("engine", "hub"), stiffness=8e5, loss_factor=0.02),
        Shaft(
            between=("gear", "hub"),
            stiffness=2.5e4,
            loss_factor=0.15,
            damping=3.0,
            name="coupling",
            over_hz=over_hz,
            over_amplitude=over_amplitude,
        ),
        Shaft(between=("pinion", "pump"), stiffness=4e4, damping=1.0),
        Mesh(between=("gear", "pinion"), stiffness=1e8, damping=200.0),
        Damper(
            name="ring",
            disk="engine",
            inertia=0.3,
            damping=ring_damping,
            stiffness=6e4,
        ),
        Damper(
            name="absorber",
            disk="pump",
            inertia=0.05,
            damping=0.02,
            order=order,
            stiffness=0.0 if order else 900.0,
        ),
        Ground(disk="engine", stiffness=400.0),
        Torque(disk="engine", mean=120.0, harmonics=ORDERS),
    ]


def train_of(**changes):
    return build(parts(**changes), reference="engine", cycle=2)


def dense_angles(elements, train, rpm, alter):
    """Angles ``(S, N)`` at one speed; ``alter(part, omega)`` is the part as it is at a
    frequency.
    """
    frequencies = float(train.topology.cycle_frequency(rpm)) * np.arange(1, 13)
    torque = dense.torques(elements, 12, 2)[:, 1:]

    def angles(omega, applied):
        altered = [alter(part, omega) for part in elements]
        return np.linalg.solve(dense.dynamic_stiffness(altered, omega), applied)

    columns = [angles(omega, torque[:, n]) for n, omega in enumerate(frequencies)]
    return np.array(columns).T


@pytest.mark.slow
def test_links_over_frequency_are_evaluated_at_every_harmonic():
    elements = parts(over_hz=OVER_HZ)
    train = train_of(over_hz=OVER_HZ)
    response = jaxhb.forced_response(train, rpm=SPEEDS)
    hz, *factors = np.array(OVER_HZ).T

    def alter(part, omega):
        if getattr(part, "name", "") != "coupling":
            return part
        stiffer, damped = (np.interp(omega / (2 * np.pi), hz, f) for f in factors)
        return dataclasses.replace(
            part,
            stiffness=part.stiffness * stiffer,
            damping=part.damping * damped,
            loss_factor=part.loss_factor * damped,
        )

    # The complex stiffness is k s (1 + i eta d) + i omega r d.
    for row, rpm in enumerate(SPEEDS):
        expected = dense_angles(elements, train, rpm, alter)
        np.testing.assert_allclose(
            response.angles[row][:, 1:],
            expected,
            rtol=0,
            atol=ALGEBRAIC * np.abs(expected).max(),
        )
        constant = jaxhb.forced_response(train.with_constant_links(hz=0.0), rpm=rpm)
        # The mean twists by the static stiffness.
        np.testing.assert_allclose(
            response.angles[row][:, 0], constant.angles[:, 0], rtol=1e-9
        )
    heat = response.disk_power.sum(-1) + response.link_power.sum(-1)
    np.testing.assert_allclose(heat, response.input_power, rtol=BALANCE)


@pytest.mark.slow
def test_an_absorber_adds_inertia_times_square_of_order_and_speed():
    train = train_of(order=1.5)
    rpm = 800.0
    stiffness = 0.05 * (1.5 * 2 * rpm / ONE_RADIAN_PER_SECOND) ** 2
    constant = train_of().replace({"absorber.stiffness": stiffness})
    angles = jaxhb.forced_response(train, rpm=rpm).angles
    expected = jaxhb.forced_response(constant, rpm=rpm).angles
    np.testing.assert_allclose(
        angles, expected, rtol=0, atol=ALGEBRAIC * np.abs(expected).max()
    )
    at_speed = train.with_constant_links(rpm=rpm)
    assert at_speed.value("absorber.stiffness") == pytest.approx(stiffness)


def equivalent(signal):
    return np.sqrt((signal.amplitudes**2).sum(-1))


@pytest.mark.slow
def test_links_over_amplitude_have_the_stiffness_of_the_amplitude_that_they_lead_to():
    rpm = np.linspace(200.0, 3000.0, 57)
    level, *factors = np.array(OVER_AMPLITUDE).T
    elements = [
        dataclasses.replace(part, over_amplitude=OVER_AMPLITUDE)
        if getattr(part, "name", "") == "ring"
        else part
        for part in parts(over_amplitude=OVER_AMPLITUDE, ring_damping=2.0)
    ]
    train = build(elements, reference="engine", cycle=2)
    response = jaxhb.check(jaxhb.forced_response(train, rpm=rpm))
    amplitudes = {
        "coupling": equivalent(response.twist("gear", "hub")),
        "ring": equivalent(response.twist("engine", "ring")),
    }
    # The coupling passes through all of the table.
    assert amplitudes["coupling"].max() > 0.03
    assert amplitudes["coupling"].min() < 0.01
    constant = train_of(ring_damping=2.0)
    for row in (3, 20, 41):
        values = {}
        for name, amplitude in amplitudes.items():
            stiffer, damped = (np.interp(amplitude[row], level, f) for f in factors)
            changes = {
                f"{name}.stiffness": stiffer,
                f"{name}.damping": damped,
                f"{name}.loss_factor": damped,
            }
            for key, factor in changes.items():
                values[key] = factor * constant.value(key)
        expected = jaxhb.forced_response(constant.replace(values), rpm=rpm[row])
        np.testing.assert_allclose(
            response.angles[row],
            expected.angles,
            rtol=0,
            atol=1e-7 * np.abs(expected.angles).max(),
        )
    heat = response.disk_power.sum(-1) + response.link_power.sum(-1)
    np.testing.assert_allclose(heat, response.input_power, rtol=BALANCE)


@pytest.mark.slow
def test_amplitudes_that_are_not_found_are_told(monkeypatch):
    monkeypatch.setattr(forced, "STEPS", 1)
    # The number of steps has it compiled anew.
    response = jaxhb.forced_response(
        train_of(over_amplitude=OVER_AMPLITUDE), rpm=SPEEDS
    )
    assert (response.status == Status.MAX_STEPS).all()
    with pytest.raises(
        jaxhb.NotConverged, match="the amplitude of a link was not found"
    ):
        jaxhb.check(response)


KEYS = [
    "coupling.stiffness",
    "coupling.loss_factor",
    "coupling.damping",
    "pump.inertia",
    "absorber.order",
]


@pytest.mark.slow
def test_derivatives_of_varying_links_are_those_of_differences():
    train = train_of(over_hz=OVER_HZ, over_amplitude=OVER_AMPLITUDE, order=1.6)

    def numbers(values):
        changed = train.replace(dict(zip(KEYS, values[:-1], strict=True)))
        # The last value changes factors of stiffness.
        rows = changed.shafts.over_amplitude * jnp.array([1.0, values[-1], 1.0])
        changed = dataclasses.replace(
            changed, shafts=dataclasses.replace(changed.shafts, over_amplitude=rows)
        )
        response = jaxhb.forced_response(changed, rpm=jnp.array([650.0, 1250.0]))
        outputs = [
            response.torque("coupling").order(1.0),
            response.disk("pump").sum_of_amplitudes,
            response.power("coupling"),
            response.power("ring"),
        ]
        return jnp.concatenate(outputs)

    check_derivative(numbers, [*(train.value(key) for key in KEYS), 1.0])


VARIANTS = {
    "over_hz": ({"over_hz": OVER_HZ}, "'coupling' has over_hz", {"hz": 30.0}),
    "over_amplitude": (
        {"over_amplitude": OVER_AMPLITUDE},
        "'coupling' has over_amplitude",
        {"amplitude": 0.01},
    ),
    "order": ({"order": 1.5}, "'absorber' has order", {"rpm": 1500.0}),
}


@pytest.mark.parametrize("kind", VARIANTS)
def test_calls_for_constant_links_refuse_others_by_name_and_take_them_fixed(kind):
    changes, sentence, fixed_at = VARIANTS[kind]
    train = train_of(**changes)
    calls = [
        jaxhb.natural_frequencies,
        lambda train: jaxhb.solve(train, rpm=1500.0),
        lambda train: jaxhb.integrate(train, rpm=1500.0, cycles=2),
        lambda train: train.with_viscous_damping(hz=100.0),
    ]
    why = "which only the forced response"
    if kind == "order":
        # At a speed its stiffness is a constant.
        calls = [calls[0], calls[-1]]
        why = "which needs a speed"
    for call in calls:
        with pytest.raises(SceneError, match=f"{sentence}, {why}"):
            call(train)
    with pytest.raises(SceneError, match=f"{sentence}.*Give it"):
        train.with_constant_links()
    constant = train.with_constant_links(**fixed_at)
    jaxhb.natural_frequencies(constant)
    response = jaxhb.forced_response(constant, rpm=1500.0)
    if kind == "order":
        expected = jaxhb.forced_response(train, rpm=1500.0).angles
        np.testing.assert_allclose(response.angles, expected, rtol=0, atol=1e-11)


def test_numbers_that_links_cannot_have_are_refused():
    with pytest.raises(SceneError, match="hz is -1.0, must be at least 0"):
        train_of(over_hz=OVER_HZ).with_constant_links(hz=-1.0)
    with pytest.raises(SceneError, match="built without order"):
        train_of().replace({"absorber.order": 2.0})


def test_a_scenario_is_the_train_with_its_values():
    hot = {"coupling.stiffness": 1.8e4, "coupling.loss_factor": 0.1}
    train = jaxhb.build(
        parts(),
        reference="engine",
        scenarios={"hot": hot, "cold": {"ring.damping": 20.0}},
    )
    assert train.scenarios["hot"] == hot
    response = jaxhb.forced_response(train.scenario("hot"), rpm=900.0)
    expected = jaxhb.forced_response(train.replace(hot), rpm=900.0)
    np.testing.assert_array_equal(response.angles, expected.angles)
    with pytest.raises(
        SceneError, match="there is no scenario 'hott'. Did you mean 'hot'?"
    ):
        train.scenario("hott")

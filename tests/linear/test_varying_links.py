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


def parts(*, over_hz=(), over_amplitude=(), order=None, **ring):
    """An engine on a coupling with a rubber damper and a geared pump at twice its
    speed.
    """
    tables = {"over_hz": over_hz, "over_amplitude": over_amplitude}
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
            **tables,
        ),
        Shaft(between=("pinion", "pump"), stiffness=4e4, damping=1.0),
        Mesh(between=("gear", "pinion"), stiffness=1e8, damping=200.0),
        Damper(
            name="ring",
            disk="engine",
            inertia=0.3,
            **({"damping": 8.0, "stiffness": 6e4} | ring),
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


def train_of(**change):
    return build(parts(**change), reference="engine", cycle=2)


def dense_angles(elements, train, rpm, alter):
    """Angles ``(S, N)`` at one speed; ``alter(part, omega)`` gives the part as it is at
    a frequency.
    """
    omega = float(train.topology.cycle_frequency(rpm)) * np.arange(1, 13)
    torque = dense.torques(elements, 12, 2)[:, 1:]
    columns = [
        np.linalg.solve(
            dense.dynamic_stiffness([alter(p, w) for p in elements], w), torque[:, n]
        )
        for n, w in enumerate(omega)
    ]
    return np.array(columns).T


def test_links_over_frequency_are_evaluated_at_every_harmonic():
    elements = parts(over_hz=OVER_HZ)
    train = train_of(over_hz=OVER_HZ)
    found = jaxhb.forced_response(train, rpm=SPEEDS)
    hz, *factors = np.array(OVER_HZ).T

    def alter(part, omega):
        if getattr(part, "name", "") != "coupling":
            return part
        stiffer, damped = (np.interp(omega / (2 * np.pi), hz, f) for f in factors)
        own = {"stiffness": part.stiffness * stiffer, "damping": part.damping * damped}
        return dataclasses.replace(part, **own, loss_factor=part.loss_factor * damped)

    # the complex stiffness k s (1 + i eta d) + i omega r d
    for row, rpm in enumerate(SPEEDS):
        wanted = dense_angles(elements, train, rpm, alter)
        np.testing.assert_allclose(
            found.angles[row][:, 1:],
            wanted,
            rtol=0,
            atol=ALGEBRAIC * np.abs(wanted).max(),
        )
        constant = jaxhb.forced_response(train.with_constant_links(hz=0.0), rpm=rpm)
        # Static stiffness.
        np.testing.assert_allclose(
            found.angles[row][:, 0], constant.angles[:, 0], rtol=1e-9
        )
    heat = found.disk_power.sum(-1) + found.link_power.sum(-1)
    np.testing.assert_allclose(heat, found.input_power, rtol=BALANCE)


def test_an_absorber_adds_inertia_times_square_of_order_and_speed():
    train = train_of(order=1.5)
    rpm = 800.0
    stiffness = 0.05 * (1.5 * 2 * rpm / ONE_RADIAN_PER_SECOND) ** 2
    constant = train_of().replace({"absorber.stiffness": stiffness})
    found, wanted = (
        jaxhb.forced_response(t, rpm=rpm).angles for t in (train, constant)
    )
    np.testing.assert_allclose(
        found, wanted, rtol=0, atol=ALGEBRAIC * np.abs(wanted).max()
    )
    assert train.with_constant_links(rpm=rpm).value(
        "absorber.stiffness"
    ) == pytest.approx(stiffness)


def equivalent(signal):
    return np.sqrt((signal.amplitudes**2).sum(-1))


def test_links_over_amplitude_have_the_stiffness_of_the_amplitude_that_they_lead_to():
    ring = {"over_amplitude": OVER_AMPLITUDE, "damping": 2.0}
    rpm = np.linspace(200.0, 3000.0, 57)
    (level, *factors) = np.array(OVER_AMPLITUDE).T
    elements = parts(over_amplitude=OVER_AMPLITUDE)
    elements = [
        dataclasses.replace(p, **ring) if getattr(p, "name", "") == "ring" else p
        for p in elements
    ]
    found = jaxhb.check(
        jaxhb.forced_response(build(elements, reference="engine", cycle=2), rpm=rpm)
    )
    own = [
        equivalent(found.twist(*ends)) for ends in (("gear", "hub"), ("engine", "ring"))
    ]
    assert own[0].max() > 0.03 and own[0].min() < 0.01  # all of the table
    constant = train_of(damping=2.0)
    for row in (3, 20, 41):
        values = {}
        for name, a in zip(("coupling", "ring"), own, strict=True):
            stiffer, damped = (np.interp(a[row], level, f) for f in factors)
            for field, factor in (
                ("stiffness", stiffer),
                ("damping", damped),
                ("loss_factor", damped),
            ):
                values[f"{name}.{field}"] = factor * constant.value(f"{name}.{field}")
        wanted = jaxhb.forced_response(constant.replace(values), rpm=rpm[row])
        np.testing.assert_allclose(
            found.angles[row],
            wanted.angles,
            rtol=0,
            atol=1e-7 * np.abs(wanted.angles).max(),
        )
    heat = found.disk_power.sum(-1) + found.link_power.sum(-1)
    np.testing.assert_allclose(heat, found.input_power, rtol=BALANCE)


@pytest.mark.oracle
def test_amplitudes_that_are_not_found_are_told(monkeypatch):
    monkeypatch.setattr(forced, "STEPS", 1)
    # Compiled anew.
    found = jaxhb.forced_response(train_of(over_amplitude=OVER_AMPLITUDE), rpm=SPEEDS)
    assert (found.status == Status.MAX_STEPS).all()
    with pytest.raises(
        jaxhb.NotConverged, match="the amplitude of a link was not found"
    ):
        jaxhb.check(found)


KEYS = [
    "coupling.stiffness",
    "coupling.loss_factor",
    "coupling.damping",
    "pump.inertia",
    "absorber.order",
]


@pytest.mark.oracle
def test_derivatives_of_varying_links_are_those_of_differences():
    train = train_of(over_hz=OVER_HZ, over_amplitude=OVER_AMPLITUDE, order=1.6)

    def numbers(values):
        changed = train.replace(dict(zip(KEYS, values[:-1], strict=True)))
        # All factors of stiffness.
        rows = changed.shafts.over_amplitude * jnp.array([1.0, values[-1], 1.0])
        changed = dataclasses.replace(
            changed, shafts=dataclasses.replace(changed.shafts, over_amplitude=rows)
        )
        r = jaxhb.forced_response(changed, rpm=jnp.array([650.0, 1250.0]))
        own = [
            r.torque("coupling").order(1.0),
            r.disk("pump").sum_of_amplitudes,
            r.power("coupling"),
            r.power("ring"),
        ]
        return jnp.concatenate(own)

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
def test_what_needs_constant_links_refuses_others_by_name_and_takes_them_at_one_number(
    kind,
):
    change, sentence, at = VARIANTS[kind]
    train = train_of(**change)
    needing = [jaxhb.natural_frequencies, lambda t: jaxhb.solve(t, rpm=1500.0)]
    needing += [
        lambda t: jaxhb.integrate(t, rpm=1500.0, cycles=2),
        lambda t: t.with_viscous_damping(hz=100.0),
    ]
    for call in needing:
        with pytest.raises(
            SceneError, match=f"{sentence}, which only the forced response"
        ):
            call(train)
    with pytest.raises(SceneError, match=f"{sentence}.*Give it"):
        train.with_constant_links()
    jaxhb.natural_frequencies(train.with_constant_links(**at))
    constant = jaxhb.forced_response(train.with_constant_links(**at), rpm=1500.0)
    if kind == "order":
        wanted = jaxhb.forced_response(train, rpm=1500.0).angles
        np.testing.assert_allclose(constant.angles, wanted, rtol=0, atol=1e-11)


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
    found, wanted = (
        jaxhb.forced_response(t, rpm=900.0)
        for t in (train.scenario("hot"), train.replace(hot))
    )
    np.testing.assert_array_equal(found.angles, wanted.angles)
    with pytest.raises(
        SceneError, match="there is no scenario 'hott'. Did you mean 'hot'?"
    ):
        train.scenario("hott")

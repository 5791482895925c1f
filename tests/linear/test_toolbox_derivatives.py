"""Derivatives of quantities that engineers tune on beside amplitudes and frequencies,
against differences.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from differences import check_derivative, compare, differences
from tolerances import GRADIENT

import jaxhb
from jaxhb import Damper, Disk, Ground, Load, Mesh, Shaft, Torque

pytestmark = pytest.mark.slow

ORDER = 3.0
HZ = 31.0
RPM = 700.0
HEAVY = np.ones(6, bool)


def build(*, order=None):
    """A rotor with a ring, geared to a branched one that a spring holds."""
    parts = [
        Disk(name="a", inertia=2.0),
        Disk(name="b", inertia=0.3, radius=0.1),
        Disk(name="c", inertia=0.2, radius=0.05),
        Disk(name="d", inertia=0.7),
        Disk(name="e", inertia=0.4),
        Shaft(between=("a", "b"), stiffness=3e4),
        Shaft(between=("c", "d"), stiffness=2e4),
        Shaft(between=("c", "e"), stiffness=5e4),
        Mesh(between=("b", "c"), stiffness=4e6, backlash=1e-4, transition=0.5),
        Damper(
            name="ring", disk="a", inertia=0.5, stiffness=8e3, damping=3.0, order=order
        ),
        Ground(disk="e", stiffness=200.0),
        Torque(disk="a", mean=4.0, harmonics=[(3.0, 30.0, 10.0)], rated_rpm=900.0),
        Load(disk="d"),
    ]
    return jaxhb.build(parts, reference="a", revolutions_per_cycle=1)


TRAIN = build()
KEYS = [
    "a.inertia",
    "ring.inertia",
    "a|b.stiffness",
    "b|c.stiffness",
    "ring.stiffness",
    "c.radius",
    "e:ground.stiffness",
]


def numbers_of(train, keys, *more):
    return np.array([*(float(train.value(key)) for key in keys), *more])


def changed(values, train=TRAIN, keys=KEYS):
    """The train with the first of the values at its keys."""
    return train.replace(dict(zip(keys, values, strict=False)))


def holzer_table(values):
    table = jaxhb.holzer_table(changed(values), hz=HZ)
    columns = [
        table.ordinate,
        table.torque_sum,
        table.twist,
        table.kinetic_energy,
        table.strain_energy,
        table.residual[None],
    ]
    return jnp.concatenate(columns)


def holzer_residual(values):
    hz = jnp.array([0.5, 1.0]) * values[-1] / 20.0
    return jaxhb.holzer_residual(changed(values), hz=hz)


def energies_of_modes(values):
    shares = jaxhb.mode_shares(changed(values), HEAVY)
    return jnp.concatenate([jnp.ravel(share[1:]) for share in shares])


def coefficients(values):
    return jnp.stack(jaxhb.characteristic_coefficients(changed(values))[1:-2])


@pytest.mark.parametrize(
    "quantity", [holzer_table, holzer_residual, energies_of_modes, coefficients]
)
def test_quantities_have_the_derivatives_of_differences(quantity):
    check_derivative(quantity, numbers_of(TRAIN, KEYS, RPM))


@pytest.mark.parametrize("order", [None, ORDER + 1.0])
def test_critical_speeds_and_modal_torques_have_the_derivatives_of_differences(order):
    train = build(order=order)
    keys = [
        "a.inertia",
        "a|b.stiffness",
        "ring.inertia",
        "c.radius",
        "a:torque.rated_rpm",
    ]
    if order:
        keys.append("ring.order")
    at = numbers_of(train, keys)
    rpm = np.linspace(100.0, 1500.0, 20)

    def critical_speeds(values):
        return jaxhb.campbell(
            changed(values, train, keys), rpm=rpm, orders=[ORDER], count=3
        ).critical

    def numbers(critical):
        return [critical.rpm, critical.hz, critical.torque]

    def refined(near, values):
        critical = jaxhb.critical_speed(changed(values, train, keys), near, heavy=HEAVY)
        return jnp.stack(numbers(critical))

    for number, near in enumerate(critical_speeds(at)):

        def searched(designs, number=number):
            return np.array(
                [numbers(critical_speeds(values)[number]) for values in designs]
            )

        value = partial(refined, near)

        def twice(values, value=value):
            critical = value(values)
            return critical, critical

        slopes, values = jax.jit(jax.jacfwd(twice, has_aux=True))(at)
        np.testing.assert_allclose(values, numbers(near), rtol=1e-9)
        by_differences = differences(searched, at, 1e-3 * at).T
        for slope, expected in zip(np.asarray(slopes), by_differences, strict=True):
            compare(slope * at, expected * at, GRADIENT)

    def scaled_slopes(values):
        return jax.jacfwd(value)(values)[::2].ravel() * jnp.tile(at, 2)

    # Second derivatives of the last critical speed.
    check_derivative(scaled_slopes, at)


def at_mean_load(keys, values):
    load = jaxhb.at_mean_load(changed(values, keys=keys), rpm=values[-1])
    hz = jaxhb.frequencies_hz(load.train, HEAVY)
    return jnp.concatenate([hz[1:3], load.stiffness, load.force, load.engagement])


def test_the_stiffness_of_teeth_at_their_mean_load_has_the_derivatives_of_differences():
    keys = [
        "a:torque.mean",
        "b|c.backlash",
        "b|c.stiffness",
        "e:ground.stiffness",
        "c.radius",
        "a|b.stiffness",
    ]
    at = numbers_of(TRAIN, keys, 1000.0)
    value = partial(at_mean_load, keys)
    assert 0.1 < value(at)[-1] < 0.9  # in the transition zone
    check_derivative(value, at, staged=False)

    def teeth(values):
        return value(values)[2:]

    def scaled_slopes(values):
        return jax.jacrev(teeth)(values).ravel() * jnp.tile(at, 3)

    scale = np.repeat(np.abs(teeth(at)), len(at))
    check_derivative(scaled_slopes, at, staged=False, scale=scale)


def test_barred_ranges_have_the_derivatives_of_differences():
    train = jaxhb.load_scene("six_cylinder_diesel")
    shaft = "cyl6|flywheel"
    keys = [f"{shaft}.stiffness", "pulley.inertia"]

    @jax.jit
    def stress(values):
        rpm = jnp.linspace(1500.0, 3000.0, 16) + values[2]
        response = jaxhb.forced_response(changed(values, train, keys), rpm=rpm)
        swing = response.torque(shaft).half_peak_to_peak
        return rpm, jaxhb.torsional_stress(swing, diameter=values[3])

    at = numbers_of(train, keys, 0.5, 0.08, 0.0)
    at[-1] = np.mean(stress(at)[1])  # a lower limit than the rule has

    def barred_ranges(values):
        rpm, amplitude = stress(values)
        return jaxhb.barred_ranges(rpm, amplitude, values[-1], 1.5 * values[-1])

    def numbers(values):
        fields = ("low", "high", "at", "share", "transient_share")
        ranges = barred_ranges(values)
        return jnp.stack(
            [getattr(barred, field) for barred in ranges for field in fields]
        )

    first, *_ = barred_ranges(at)
    assert not first.open_below
    assert not first.open_above
    assert isinstance(first.low, float)
    check_derivative(numbers, at, step=1e-6, staged=False)


def test_damping_ratios_have_the_derivatives_of_differences():
    train = TRAIN.replace(
        {"a.damping": 9.0, "b.damping": 4.0, "d.damping": 7.0, "e.damping": 5.0}
    )
    modes = jaxhb.natural_frequencies(train)
    keys = [
        "a.inertia",
        "a|b.stiffness",
        "ring.damping",
        "ring.stiffness",
        "c.radius",
        "e:ground.stiffness",
    ]
    at = numbers_of(train, keys)
    paired = np.isfinite(jaxhb.damping_ratios(train, modes))
    assert paired.sum() >= 3

    def value(values):
        return jaxhb.damping_ratios(changed(values, train, keys), modes)[paired]

    check_derivative(value, at, step=1e-3, staged=False)


@pytest.mark.parametrize(
    "quantity",
    [
        lambda train: (
            jaxhb.barred_ranges([1.0, 2.0], train.disks.inertia[:2], 1.0, 2.0)[0].low
        ),
        lambda train: jaxhb.damping_ratios(train, jaxhb.natural_frequencies(TRAIN)),
        lambda train: jaxhb.characteristic_coefficients(train)[1],
        lambda train: jaxhb.at_mean_load(train, rpm=RPM).force,
    ],
)
def test_what_needs_values_on_the_host_is_refused_inside_jit_and_vmap(quantity):
    with pytest.raises(
        ValueError, match=r"jit or vmap traces .*\. (Call it|Close over)"
    ):
        jax.jit(quantity)(TRAIN)
    with pytest.raises(ValueError, match="jit or vmap traces"):
        jax.vmap(quantity)(jax.tree.map(lambda leaf: np.stack([leaf, leaf]), TRAIN))

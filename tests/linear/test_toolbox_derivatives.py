"""Derivatives of what engineers tune on beside amplitudes and frequencies, against differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from differences import compare, differences
from tolerances import GRADIENT

import jaxhb
from jaxhb import Damper, Disk, Ground, Load, Mesh, Shaft, Torque

pytestmark = pytest.mark.oracle

ORDER, HZ, RPM = 3.0, 31.0, 700.0


def parts(*, order=None):
    """A rotor with a ring, geared to a branched one that a spring holds."""
    return [
        Disk(name="a", inertia=2.0),
        Disk(name="b", inertia=0.3, radius=0.1),
        Disk(name="c", inertia=0.2, radius=0.05),
        Disk(name="d", inertia=0.7),
        Disk(name="e", inertia=0.4),
        Shaft(between=("a", "b"), stiffness=3e4),
        Shaft(between=("c", "d"), stiffness=2e4),
        Shaft(between=("c", "e"), stiffness=5e4),
        Mesh(between=("b", "c"), stiffness=4e6, backlash=1e-4, transition=0.5),
        Damper(name="ring", disk="a", inertia=0.5, stiffness=8e3, damping=3.0, order=order),
        Ground(disk="e", stiffness=200.0),
        Torque(disk="a", mean=4.0, harmonics=[(3.0, 30.0, 10.0)], rated_rpm=900.0),
        Load(disk="d"),
    ]


def build(**given):
    return jaxhb.build(parts(**given), reference="a", revolutions_per_cycle=1)


TRAIN = build()
KEYS = ["a.inertia", "ring.inertia", "a|b.stiffness", "b|c.stiffness", "ring.stiffness", "c.radius",
        "e:ground.stiffness"]  # fmt: skip


def holzer_table(train, _):
    found = jaxhb.holzer_table(train, hz=HZ)
    columns = found.ordinate, found.torque_sum / 1e5, found.twist, found.kinetic_energy / 1e5, found.strain_energy / 1e5
    return jnp.concatenate([*columns, found.residual[None] / 1e5])


def holzer_residual(train, rpm):
    return jaxhb.holzer_residual(train, hz=jnp.array([0.5, 1.0]) * rpm / 20.0) / 1e5


def energies_of_modes(train, _):
    found = jaxhb.mode_shares(train, np.ones(6, bool))
    return jnp.concatenate([jnp.ravel(a[1:]) for a in found])


@pytest.mark.parametrize("quantity", [holzer_table, holzer_residual, energies_of_modes])
def test_quantities_have_the_derivatives_of_differences(quantity):
    at = np.array([*(float(TRAIN.value(key)) for key in KEYS), RPM])

    def numbers(values):
        return quantity(TRAIN.replace(dict(zip(KEYS, values[:-1], strict=True))), values[-1])

    slopes, backwards = jax.jit(lambda x: (jax.jacfwd(numbers)(x) * at, jax.jacrev(numbers)(x) * at))(at)
    rows = differences(jax.jit(jax.vmap(numbers)), at, 1e-4 * at).T * at
    for row, (slope, wanted) in enumerate(zip(slopes, rows, strict=True)):
        size = max(np.abs(wanted).max(), 1e-3 * np.abs(slopes).max())
        np.testing.assert_allclose(slope, wanted, rtol=0, atol=GRADIENT * size, err_msg=str(row))
    np.testing.assert_allclose(backwards, slopes, rtol=0, atol=1e-10 * np.abs(slopes).max())


@pytest.mark.parametrize("order", [None, ORDER + 1.0])
def test_critical_speeds_and_their_modal_torques_have_the_derivatives_of_differences(order):
    train, keys = build(order=order), ["a.inertia", "a|b.stiffness", "ring.inertia", "c.radius", "a:torque.rated_rpm"]
    keys += ["ring.order"] * bool(order)
    at = np.array([float(train.value(key)) for key in keys])
    rpm = np.linspace(100.0, 1500.0, 20)

    def changed(values):
        return train.replace(dict(zip(keys, values, strict=True)))

    def found(values):
        return jaxhb.campbell(changed(values), rpm=rpm, orders=[ORDER], count=3).critical

    for number, near in enumerate(found(at)):

        def numbers(values, near=near):
            c = jaxhb.critical_speed(changed(values), near, heavy=np.ones(6, bool))
            return (jnp.stack([c.rpm, c.hz, c.torque]),) * 2

        def searched(several, number=number):
            return np.array([[(c := found(v)[number]).rpm, c.hz, c.torque] for v in several])

        slopes, values = map(np.asarray, jax.jit(jax.jacfwd(numbers, has_aux=True))(at))
        np.testing.assert_allclose(values, [near.rpm, near.hz, near.torque], rtol=1e-9)
        wanted = differences(searched, at, 1e-3 * at)
        for slope, expected in zip(slopes, wanted.T, strict=True):
            compare(slope * at, expected * at, GRADIENT)

        def twice(values, near=near):
            found = jaxhb.critical_speed(changed(values), near, heavy=np.ones(6, bool))
            return jnp.stack([found.rpm, found.torque])

        curvature = jax.jit(jax.hessian(twice))(at) * at * at[:, None]
        slopes_of = jax.jit(jax.vmap(jax.jacfwd(twice)))
        wanted = differences(slopes_of, at, 1e-4 * at) * at[:, None, None] * at
        for found_one, expected in zip(curvature, np.moveaxis(wanted, 0, -1), strict=True):
            compare(found_one, expected, GRADIENT)


def test_coefficients_of_the_characteristic_polynomial_have_the_derivatives_of_differences():
    keys = ["a.inertia", "a|b.stiffness", "ring.damping", "c.radius", "b|c.stiffness"]
    at = np.array([float(TRAIN.value(key)) for key in keys])

    def coefficients(values):
        return jaxhb.characteristic_coefficients(TRAIN.replace(dict(zip(keys, values, strict=True))))

    stacked = lambda v: jnp.stack(coefficients(v)[1:-1])  # noqa: E731
    slopes = np.asarray(jax.jit(jax.jacfwd(stacked))(at))
    wanted = differences(lambda several: [coefficients(v)[1:-1] for v in several], at, 1e-3 * at)
    for slope, expected in zip(slopes, wanted.T, strict=True):
        if np.abs(expected).max():
            compare(slope * at, expected * at, GRADIENT)
    batch = jax.jit(jax.vmap(stacked))(np.stack([at, 1.1 * at]))
    np.testing.assert_allclose(batch[1], coefficients(1.1 * at)[1:-1], rtol=1e-14)


def test_the_stiffness_of_teeth_at_their_mean_load_has_the_derivatives_of_differences():
    keys = ["a:torque.mean", "b|c.backlash", "b|c.stiffness", "e:ground.stiffness", "c.radius", "a|b.stiffness"]
    at = np.array([*(float(TRAIN.value(key)) for key in keys), 1000.0])

    def numbers(values):
        found = jaxhb.at_mean_load(TRAIN.replace(dict(zip(keys, values[:-1], strict=True))), rpm=values[-1])
        hz = jaxhb.frequencies_hz(found.train, np.ones(6, bool))
        return jnp.concatenate([hz[1:3], found.stiffness, found.force, found.engagement])

    assert 0.1 < numbers(at)[-1] < 0.9  # in the transition zone
    slopes = np.asarray(jax.jacfwd(numbers)(at))
    wanted = differences(lambda several: [numbers(v) for v in several], at, 1e-4 * at)
    for slope, expected in zip(slopes, wanted.T, strict=True):
        compare(slope * at, expected * at, GRADIENT)
    gradient = jax.jacrev(lambda v: numbers(v)[2:])
    curvature = np.asarray(jax.jacfwd(gradient)(at)) * at * at[:, None]
    wanted = differences(lambda several: [gradient(v) for v in several], at, 1e-4 * at) * at[:, None, None] * at
    for found, expected in zip(curvature, np.moveaxis(wanted, 0, -1), strict=True):
        compare(found, expected, GRADIENT)


@jax.jit
def diesel_stress(values):
    """Stress of the shaft before the flywheel over the speed and its limits, with a lower one than the rule has."""
    train = jaxhb.load_scene("six_cylinder_diesel")
    train = train.replace(dict(zip(["cyl6|flywheel.stiffness", "pulley.inertia"], values[:2], strict=True)))
    rpm = jnp.linspace(1500.0, 3000.0, 16) + values[2]
    torque = jaxhb.forced_response(train, rpm=rpm).torque("cyl6|flywheel").half_peak_to_peak
    return rpm, jaxhb.torsional_stress(torque, diameter=values[3])


def test_barred_ranges_have_the_derivatives_of_differences():
    train = jaxhb.load_scene("six_cylinder_diesel")
    at = np.array([train.value("cyl6|flywheel.stiffness"), train.value("pulley.inertia"), 0.5, 0.08, 0.0])
    at[-1] = np.mean(diesel_stress(at)[1])

    def ranges(values):
        return jaxhb.barred_ranges(*diesel_stress(values), values[-1], 1.5 * values[-1])

    def numbers(values):
        found = ranges(values)
        return jnp.stack([getattr(one, f) for one in found for f in ("low", "high", "at", "share", "transient_share")])

    found = ranges(at)
    assert found and not found[0].open_below and not found[0].open_above and isinstance(found[0].low, float)
    slopes = np.asarray(jax.jacfwd(numbers)(at))
    wanted = differences(lambda several: [numbers(v) for v in several], at, 1e-5 * at)
    for slope, expected in zip(slopes, wanted.T, strict=True):
        compare(slope * at, expected * at, GRADIENT)
    reverse = jax.jacrev(numbers)(at)
    np.testing.assert_allclose(reverse * at, slopes * at, rtol=1e-9, atol=1e-9 * np.abs(slopes * at).max())


def test_damping_ratios_have_the_derivatives_of_differences():
    train = TRAIN.replace({"a.damping": 9.0, "b.damping": 4.0, "d.damping": 7.0, "e.damping": 5.0})
    modes = jaxhb.natural_frequencies(train)
    keys = ["a.inertia", "a|b.stiffness", "ring.damping", "ring.stiffness", "c.radius", "e:ground.stiffness"]
    at = np.array([float(train.value(key)) for key in keys])

    def ratios(values):
        return jaxhb.damping_ratios(train.replace(dict(zip(keys, values, strict=True))), modes)

    paired = np.isfinite(ratios(at))
    assert paired.sum() >= 3
    slopes = np.asarray(jax.jacfwd(lambda v: ratios(v)[paired])(at))
    wanted = differences(lambda several: [ratios(v)[paired] for v in several], at, 1e-3 * at)
    for slope, expected in zip(slopes, wanted.T, strict=True):
        compare(slope * at, expected * at, GRADIENT)
    reverse = jax.jacrev(lambda v: ratios(v)[paired])(at)
    np.testing.assert_allclose(reverse * at, slopes * at, rtol=1e-9, atol=1e-9 * np.abs(slopes * at).max())


@pytest.mark.parametrize(
    "quantity",
    [
        lambda train: jaxhb.barred_ranges([1.0, 2.0], train.disks.inertia[:2], 1.0, 2.0)[0].low,
        lambda train: jaxhb.damping_ratios(train, jaxhb.natural_frequencies(TRAIN)),
        lambda train: jaxhb.characteristic_coefficients(train)[1],
        lambda train: jaxhb.at_mean_load(train, rpm=RPM).force,
    ],
)
def test_what_needs_values_on_the_host_is_refused_inside_jit_and_vmap(quantity):
    with pytest.raises(ValueError, match=r"jit or vmap traces .*\. (Call it|Close over)"):
        jax.jit(quantity)(TRAIN)
    with pytest.raises(ValueError, match="jit or vmap traces"):
        jax.vmap(quantity)(jax.tree.map(lambda leaf: np.stack([leaf, leaf]), TRAIN))


def test_the_torque_of_a_misfire_has_the_derivatives_of_differences():
    train, shaft = jaxhb.load_scene("six_cylinder_diesel").misfires()["cylinder 5"], "cyl6|flywheel"
    keys = [f"{shaft}.stiffness", "cyl1.damping", "cylinder 1.gas_factor", "pulley.inertia"]
    at = np.array([*(float(train.value(key)) for key in keys), 2185.0])

    @jax.jit
    @jax.vmap
    def torque(values):
        changed = train.replace(dict(zip(keys, values[:-1], strict=True)))
        return jaxhb.forced_response(changed, rpm=values[-1]).torque(shaft).half_peak_to_peak

    slope = np.asarray(jax.jacfwd(lambda v: torque(v[None])[0])(at))
    compare(slope * at, differences(torque, at, 1e-5 * at) * at, GRADIENT)

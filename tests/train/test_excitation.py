"""Excitation against direct sums, published series and the reference data."""

import dataclasses

import jax
import numpy as np
import pytest
from built_trains import pair
from reference_data import reference

from jaxhb.elements.elements import Disk, Load, Mesh
from jaxhb.elements.excitations.crank_slider import Cylinder
from jaxhb.elements.excitations.torque import Torque
from jaxhb.equations import fourier
from jaxhb.excitation.crank import gas_torque, inertia_torque, slider_crank
from jaxhb.excitation.gas import gas_cycle
from jaxhb.scene.files import load_scene
from jaxhb.train.assembly import build
from jaxhb.train.excitation import (
    excitation,
    highest_harmonic,
    listed_harmonic,
    load_power_kW,
    mean_torques,
)
from jaxhb.train.tables import with_table

TRACE = [(0.0, 1e5), (300.0, 2e6), (370.0, 1e7), (500.0, 4e5), (720.0, 1e5)]


def cylinder(name=None, **source):
    return Cylinder(
        disk="a",
        name=name,
        bore=0.1,
        stroke=0.12,
        rod=0.2,
        reciprocating_mass=2.0,
        **source,
    )


def harmonics(torque):
    return np.asarray(fourier.analyze(torque, torque.shape[-1] // 2))


def synthesis(coefficients, angle):
    """Real signal of coefficients T^n over the angle of the cycle."""
    n = np.arange(1, coefficients.size)
    wave = np.exp(1j * np.outer(angle, n)) @ np.asarray(coefficients)[1:]
    return np.asarray(coefficients)[0].real + 2 * wave.real


def test_slider_crank_derivatives_are_those_of_automatic_differentiation():
    angle = np.linspace(0.0, 7.0, 29)
    x, x1, x2 = slider_crank(angle, 0.12, 0.2)
    travel = lambda a: slider_crank(a, 0.12, 0.2)[0]  # noqa: E731
    slopes = jax.jit(
        jax.vmap(lambda a: (jax.grad(travel)(a), jax.grad(jax.grad(travel))(a)))
    )(angle)
    np.testing.assert_allclose(
        x,
        0.06 + 0.2 - 0.06 * np.cos(angle) - np.sqrt(0.04 - (0.06 * np.sin(angle)) ** 2),
    )
    np.testing.assert_allclose(x1, slopes[0], atol=1e-15)
    np.testing.assert_allclose(x2, slopes[1], atol=1e-14)


def test_inertia_torque_has_the_exact_sine_coefficients():
    for row in reference("excitation")["inertia_torque_crank_slider"]["rows"]:
        torque = harmonics(inertia_torque(2.0, 1.0 / row["lambda"]))
        expected = [row["sin_coeff_exact"][str(k)] for k in range(1, 9)]
        np.testing.assert_allclose(-2 * torque[1:9].imag, expected, atol=1e-12)
        np.testing.assert_allclose(torque.real, 0.0, atol=1e-14)


def test_gas_torque_has_the_tangential_pressure_harmonics_of_the_reference():
    table = reference("six_cylinder_diesel_2008")["pressure_deg_MPa_at_15.2_peak"]
    row = reference("excitation")["gas_tangential_pressure_harmonics"][1]
    torque = harmonics(
        gas_torque(gas_cycle(table, 0.0), 0.105, 0.137, 0.207, revolutions=2)
    )
    pressure = torque / (np.pi / 4 * 0.105**2 * 0.137 / 2)
    np.testing.assert_allclose(pressure[0].real, row["mean_MPa"], rtol=1e-12)
    expected = np.array([c[1] + 1j * c[2] for c in row["order_re_im_amp_MPa"]])
    np.testing.assert_allclose(2 * pressure[1:25], expected, atol=1e-12)


@pytest.mark.parametrize("ambient", [0.0, 101325.0])
def test_cylinder_torque_is_the_direct_sum_of_gas_and_inertia(ambient):
    rpm = 1500.0
    alpha = 130.0
    fired = cylinder(
        pressure=TRACE,
        firing_angle=alpha,
        ambient_pressure=ambient,
        scale=[(1000.0, 0.5), (2000.0, 1.0)],
        orders=400.0,
    )
    torque, _, _ = excitation(pair(fired), rpm, 800)
    theta = np.linspace(0.0, 4 * np.pi, 97)
    crank = theta - np.deg2rad(alpha)
    angles, pressures = np.array(TRACE).T
    pressure = np.interp(np.mod(np.rad2deg(crank) + 360.0, 720.0), angles, pressures)
    _, x1, x2 = slider_crank(crank, 0.12, 0.2)
    gas = (0.75 * pressure - ambient) * np.pi / 4 * 0.1**2 * x1
    expected = gas - 2.0 * x1 * x2 * (2 * np.pi * rpm / 60) ** 2
    np.testing.assert_allclose(
        synthesis(torque[0], theta / 2), expected, atol=5e-4 * np.abs(expected).max()
    )


def test_a_cylinder_that_is_cut_off_has_no_gas_torque_but_its_inertia_torque():
    table = pair(cylinder("c", pressure=TRACE))
    listed = pair(cylinder("c", gas_torque_mean=100.0, gas_torque=[(0.5, 3.0, 4.0)]))
    for fired, silent in (
        (table, table.cut_off("c")),
        (listed, listed.misfire("c")),
    ):
        torque = np.asarray(excitation(silent, 3000.0, 8)[0])[0]
        inertia = harmonics(inertia_torque(0.12, 0.2)) * 2.0 * (100 * np.pi) ** 2
        np.testing.assert_allclose(torque[2::2], inertia[1:5], rtol=1e-12)
        assert np.all(np.abs(torque[[0, 1, 3, 5, 7]]) < 1e-9)
        assert abs(excitation(fired, 3000.0, 8)[0][0, 0]) > 1.0


def test_a_two_stroke_table_repeats_every_revolution():
    trace = [(-180.0, 1e5), (0.0, 8e6), (20.0, 6e6), (180.0, 1e5)]
    train = pair(cylinder(pressure=trace), revolutions_per_cycle=2)
    torque = np.abs(np.asarray(excitation(train, 0.0, 12)[0])[0])
    assert torque[0] > 1.0
    assert np.all(torque[1::2] == 0.0)
    assert np.all(torque[2::2] > 0.0)
    assert train.topology.cylinders.step == (2,)


def test_table_firing_tdc_turns_the_trace():
    early = [(angle - 360.0, p) for angle, p in TRACE]
    plain = pair(cylinder(pressure=TRACE))
    turned = pair(cylinder(pressure=early, table_firing_tdc=0.0))
    np.testing.assert_allclose(
        excitation(plain, 1000.0, 24)[0], excitation(turned, 1000.0, 24)[0], atol=1e-9
    )


def test_scale_multiplies_given_torques_linearly_between_speeds():
    torque = Torque(
        disk="a",
        mean=10.0,
        harmonics=[(1.0, 2.0, -4.0)],
        scale=[(100.0, 0.0), (200.0, 1.0)],
    )
    train = pair(torque, revolutions_per_cycle=1)
    for rpm, factor in (
        (50.0, 0.0),
        (100.0, 0.0),
        (125.0, 0.25),
        (200.0, 1.0),
        (900.0, 1.0),
    ):
        scaled = np.asarray(excitation(train, rpm, 2)[0])[0]
        np.testing.assert_allclose(
            scaled, factor * np.array([10.0, 1.0 - 2.0j, 0.0]), atol=1e-14
        )


def test_mean_torque_of_the_excitation_is_that_of_the_host():
    train = pair(
        Torque(disk="a", mean=10.0, scale=[(500.0, 0.0), (1500.0, 1.0)]),
        cylinder(
            "one",
            pressure=TRACE,
            ambient_pressure=1e5,
            scale=[(1000.0, 0.5), (2000.0, 1.0)],
        ),
        cylinder("two", gas_torque_mean=30.0),
        cylinder("idle", gas_torque_mean=50.0, fires=False),
    )
    speeds = np.array([800.0, 1700.0])
    means = mean_torques(train, speeds)
    assert isinstance(means, np.ndarray)
    assert means.shape == (2, 4)
    np.testing.assert_allclose(
        means[:, [0, 2, 3]], [[3.0, 30.0, 0.0], [10.0, 30.0, 0.0]], rtol=1e-14
    )
    np.testing.assert_allclose(means[0, 1] / means[1, 1], 0.5 / 0.85, rtol=1e-14)
    for rpm, mean in zip(speeds, means, strict=True):
        np.testing.assert_allclose(
            excitation(train, rpm, 0)[0][0, 0], mean.sum(), rtol=1e-13
        )


GEARS = [
    Disk(name="a", inertia=1.0, radius=0.1),
    Disk(name="b", inertia=1.0, radius=0.2),
    Mesh(between=("a", "b"), stiffness=1e8),
]


def test_orders_of_an_own_rotor_are_led_to_the_reference():
    source = Torque(disk="b", mean=8.0, harmonics=[(3.0, 1.0, 0.0)], orders_of="own")
    train = build(
        [*GEARS, Load(disk="a"), source], reference="a", revolutions_per_cycle=2
    )
    assert train.topology.torques.harmonics == ((3,),)
    torque, load, _ = excitation(train, 600.0, 4)
    assert torque[1, 3] == 0.5
    np.testing.assert_allclose(load, [-4.0])
    np.testing.assert_allclose(
        load_power_kW(train, 600.0, load), 4.0 * 20 * np.pi / 1000
    )


def test_loads_balance_the_mean_power_and_keep_their_shares():
    parts = [
        *GEARS,
        Load(disk="a", share=1.0),
        Load(disk="b", share=3.0),
        Torque(disk="a", mean=50.0),
    ]
    torque, load, imbalance = excitation(build(parts, reference="a"), 600.0, 0)
    np.testing.assert_allclose(load, [-20.0, -60.0])
    assert abs(imbalance) < 1e-12
    np.testing.assert_allclose(torque[:, 0].real, [30.0, -60.0])


def test_harmonics_above_the_asked_number_are_dropped():
    train = load_scene("gear_train_30")
    many, few = (excitation(train, 1500.0, n)[0] for n in (24, 7))
    np.testing.assert_allclose(few, many[:, :8], rtol=1e-14, atol=1e-12)
    assert highest_harmonic(train) == 24


def test_highest_harmonic_leaves_out_what_has_no_amplitude():
    rows = [(1.0, 1.0, 0.0), (3.5, 0.0, 2.0), (6.0, 0.0, 0.0)]
    assert highest_harmonic(pair(Torque(disk="a", harmonics=rows))) == 7
    assert highest_harmonic(pair(cylinder(fires=False))) == 12
    assert highest_harmonic(pair(cylinder(pressure=TRACE, orders=9.0))) == 18


def test_the_listed_harmonic_holds_for_all_numbers_and_misfires():
    assert listed_harmonic(load_scene("gear_train_30").topology) == 24
    bare = pair(
        Torque(disk="a", name="t", harmonics=[(1.0, 1.0, 0.0), (20.0, 0.0, 0.0)])
    )
    assert (highest_harmonic(bare), listed_harmonic(bare.topology)) == (2, 40)
    raised = bare.replace({"t.harmonics": [[0.0, 0.0], [1.0, 0.0]]})
    assert highest_harmonic(raised) == 40
    crank = pair(cylinder("c", pressure=TRACE, orders=9.0))
    assert listed_harmonic(crank.topology) == 18
    assert listed_harmonic(crank.misfire("c").topology) == 18
    listed = pair(
        Cylinder(disk="a", name="c", gas_torque=[(15.5, 1.0, 0.0)], fires=False)
    )
    assert listed_harmonic(listed.topology) == 31
    assert listed_harmonic(pair().topology) == 1
    torque = excitation(crank, 1000.0, 40)[0]
    assert np.all(torque[:, 19:] == 0.0)
    assert np.any(torque[:, 18] != 0.0)


def test_what_is_remembered_of_a_train_follows_an_array_that_its_user_writes_to():
    """A train holds read-only views: the numbers may change under it."""
    train = load_scene("gear_train_30")
    stroke = np.array(train.cylinders.stroke)

    def with_stroke(values):
        cylinders = dataclasses.replace(train.cylinders, stroke=values)
        changed = with_table(train, "cylinder", cylinders)
        return changed, excitation(changed, 1800.0, 24)[0]

    changed, before = with_stroke(stroke)
    stroke *= 1.5
    after = excitation(changed, 1800.0, 24)[0]
    np.testing.assert_array_equal(after, with_stroke(stroke.copy())[1])
    assert np.abs(after - before).max() > 100.0  # N m


def test_an_excitation_is_kept_for_its_numbers_alone():
    """Also where numbers are written into the arrays of a train; nobody can write to a
    result that is kept.
    """
    train = load_scene("gear_train_30")
    amplitudes = np.array(train.torques.harmonics)
    torques = dataclasses.replace(train.torques, harmonics=amplitudes)
    writable = with_table(train, "torque", torques)
    first, load, _ = excitation(writable, 1800.0, 24)
    assert excitation(train, 1800, 24)[0] is first
    assert not (first.flags.writeable or load.flags.writeable)
    amplitudes *= 2.0
    changed, *_ = excitation(writable, 1800.0, 24)
    doubled = np.asarray(jax.jit(excitation, static_argnums=2)(writable, 1800.0, 24)[0])
    np.testing.assert_allclose(
        changed, doubled, rtol=1e-12, atol=1e-9 * np.abs(doubled).max()
    )
    assert np.abs(changed - first).max() > 0.0

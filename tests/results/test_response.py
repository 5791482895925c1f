"""Linear responses at the border: amplitudes, signs and names."""

import dataclasses

import numpy as np
import pytest
from reference_data import refused
from tolerances import ALGEBRAIC
from trains import build

import jaxhb
from jaxhb import Disk, Load, Mesh, Shaft, Torque

RPM = 900.0


@pytest.fixture(scope="module")
def geared():
    """A massless gear driven by 3 N m and 10 N m cos(2 theta + 50 deg), all of which
    passes the links.
    """
    amplitude = 10.0 * np.exp(1j * np.deg2rad(50.0))
    parts = [
        Disk(name="sleeve", inertia=0.0),
        Disk(name="pinion", inertia=0.0, radius=0.04),
        Disk(name="wheel", inertia=0.5, radius=0.1),
        Disk(name="machine", inertia=2.0),
        Shaft(
            between=("sleeve", "pinion"), stiffness=1e5, damping=3.0, loss_factor=0.02
        ),
        Shaft(between=("machine", "wheel"), stiffness=3e5, damping=1.0),
        Mesh(between=("pinion", "wheel"), stiffness=1e8, damping=200.0),
        Torque(
            disk="sleeve", mean=3.0, harmonics=((2.0, amplitude.real, amplitude.imag),)
        ),
        Load(disk="machine"),
    ]
    return jaxhb.check(jaxhb.solve(build(parts, cycle=2, reference="sleeve"), rpm=RPM))


def test_one_cosine_of_ten_newton_metres_reads_ten_at_the_border(geared):
    torque = geared.torque("sleeve", "pinion")
    np.testing.assert_allclose(torque.order(2.0), 10.0, rtol=ALGEBRAIC)
    assert not any(torque.order(order) for order in (0.5, 1.0, 1.5, 2.5, 3.0))
    np.testing.assert_allclose(torque.sum_of_amplitudes, 10.0, rtol=ALGEBRAIC)
    np.testing.assert_allclose(torque.mean, 3.0, rtol=ALGEBRAIC)
    # The extremes of a cosine of phase 50 deg lie between the time samples.
    np.testing.assert_allclose(torque.half_peak_to_peak, 10.0, rtol=1e-5)
    np.testing.assert_allclose(torque.max, 13.0, rtol=1e-5)
    np.testing.assert_allclose(torque.phases_deg[3], 50.0, rtol=ALGEBRAIC)
    theta = np.deg2rad(torque.angles_deg(90))
    np.testing.assert_allclose(
        torque.samples(90), 3 + 10 * np.cos(2 * theta + np.deg2rad(50)), rtol=1e-10
    )


@pytest.mark.filterwarnings("ignore:.* samples miss the peak")
def test_torque_between_a_and_b_is_minus_that_from_b_to_a_and_that_of_the_link(
    geared,
):
    for pair, method in (
        (("sleeve", "pinion"), geared.torque),
        (("pinion", "wheel"), geared.force),
    ):
        first, second = pair
        forward = method(first, second)
        backward = method(second, first)
        named = method(f"{first}|{second}")
        for ahead, back, by_name in (
            (forward, backward, named),
            (forward.elastic, backward.elastic, named.elastic),
        ):
            np.testing.assert_array_equal(
                ahead.samples(ahead.resolution), -back.samples(back.resolution)
            )
            np.testing.assert_array_equal(ahead.coefficients, by_name.coefficients)
    np.testing.assert_array_equal(
        geared.deflection("wheel", "pinion").mean,
        -geared.deflection("pinion", "wheel").mean,
    )
    np.testing.assert_array_equal(
        geared.twist("sleeve", "wheel").rms, geared.twist("wheel", "sleeve").rms
    )


def test_force_is_positive_when_the_first_gear_drives(geared):
    force = geared.force("pinion", "wheel")
    np.testing.assert_allclose(force.mean, 3.0 / 0.04, rtol=ALGEBRAIC)
    np.testing.assert_allclose(force.order(2.0), 10.0 / 0.04, rtol=ALGEBRAIC)
    np.testing.assert_allclose(geared.load_torque, [-7.5], rtol=ALGEBRAIC)
    np.testing.assert_allclose(
        geared.torque("wheel", "machine").mean, 7.5, rtol=ALGEBRAIC
    )
    contact = geared.mesh("pinion", "wheel")  # a linear mesh
    assert contact.separated_fraction == 0.0
    assert contact.impacts == []
    assert contact.drive_side == 1


def test_gear_torque_is_what_a_gear_passes_on(geared):
    for gear, mean, swing in (("pinion", 3.0, 10.0), ("wheel", -7.5, 25.0)):
        np.testing.assert_allclose(geared.gear_torque(gear).mean, mean, rtol=ALGEBRAIC)
        np.testing.assert_allclose(
            geared.gear_torque(gear).order(2.0), swing, rtol=ALGEBRAIC
        )


def test_twist_is_the_difference_of_the_angles_and_carries_the_elastic_torque(geared):
    sleeve = geared.disk("sleeve").coefficients
    pinion = geared.disk("pinion").coefficients
    twist = geared.twist("sleeve", "pinion")
    np.testing.assert_allclose(
        twist.coefficients,
        sleeve - pinion,
        rtol=0,
        atol=ALGEBRAIC * np.abs(sleeve).max(),
    )
    elastic = geared.torque("sleeve", "pinion").elastic.coefficients
    np.testing.assert_allclose(
        elastic, 1e5 * twist.coefficients, rtol=0, atol=1e-7 * np.abs(elastic).max()
    )


def test_plain_torque_has_the_viscous_and_loss_part_that_the_elastic_part_lacks(geared):
    omega = 2 * np.pi * RPM / 60 * 2.0
    torque = geared.torque("sleeve", "pinion")
    ratio = torque.coefficients[4] / torque.elastic.coefficients[4]
    np.testing.assert_allclose(
        ratio, 1 + 0.02j + 1j * omega * 3.0 / 1e5, rtol=ALGEBRAIC
    )
    np.testing.assert_allclose(torque.mean, torque.elastic.mean, rtol=ALGEBRAIC)
    force = geared.force("pinion", "wheel")
    ratio = force.coefficients[4] / force.elastic.coefficients[4]
    np.testing.assert_allclose(ratio, 1 + 1j * omega * 200.0 / 1e8, rtol=ALGEBRAIC)


def test_asking_for_the_wrong_kind_of_link_says_what_to_use(geared):
    refused(
        lambda: geared.torque("pinion", "wheel"),
        "is a mesh, not a shaft: use force",
        ValueError,
    )
    refused(
        lambda: geared.force("sleeve", "pinion"),
        "is a shaft or damper, not a mesh: use torque",
        ValueError,
    )
    refused(
        lambda: geared.gear_torque("machine"), "'machine' carries no mesh", ValueError
    )
    refused(
        lambda: geared.torque("sleeve", "wheel"), "no link joins 'sleeve' and 'wheel'"
    )
    refused(lambda: geared[0], "not a sweep", TypeError)


def test_a_response_is_true_where_it_converged_and_a_sweep_is_neither(geared):
    assert bool(geared) is True
    unconverged = dataclasses.replace(
        geared, status=np.array(jaxhb.Status.TOLERANCE_NOT_MET)
    )
    assert bool(unconverged) is False
    refused(
        lambda: bool(jaxhb.solve_speeds(geared.train, rpm=[RPM])),
        r"read \.converged",
        TypeError,
    )


def test_speed_and_acceleration_are_derivatives_of_the_angle_of_a_rotor(geared):
    count = 720
    omega = 2 * np.pi * RPM / 60
    step = 2 * 2 * np.pi / omega / count  # s, of two revolutions
    for name, ratio in (("sleeve", 1.0), ("machine", 0.4)):
        angle = geared.disk(name).samples(count)
        speed = geared.speed(name)
        rate = (np.roll(angle, -1) - np.roll(angle, 1)) / (2 * step)
        np.testing.assert_allclose(speed.mean, ratio * omega, rtol=ALGEBRAIC)
        np.testing.assert_allclose(
            speed.samples(count) - speed.mean, rate, atol=1e-3 * np.abs(rate).max()
        )
        bend = (np.roll(angle, -1) - 2 * angle + np.roll(angle, 1)) / step**2
        np.testing.assert_allclose(
            geared.acceleration(name).samples(count),
            bend,
            atol=1e-3 * np.abs(bend).max(),
        )
        irregularity = (speed.max - speed.min) / speed.mean
        np.testing.assert_allclose(
            geared.irregularity(name), irregularity, rtol=ALGEBRAIC
        )


def test_heat_of_links_is_what_the_torques_bring_in(geared):
    heat = sum(float(geared.power(name)) for name in geared.topology.link_names)
    order = 2.0 * 2 * np.pi * RPM / 60
    torque = 10.0 * np.exp(1j * np.deg2rad(50.0))
    angle = 2 * geared.disk("sleeve").coefficients[4]
    assert heat > 0
    np.testing.assert_allclose(
        heat, 0.5 * (torque * np.conj(1j * order * angle)).real, rtol=1e-9
    )

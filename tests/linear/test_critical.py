"""Critical speeds against calculation by hand."""

import dataclasses
import math

import numpy as np
import pytest

import jaxhb
from jaxhb.linear.critical import campbell, excited_orders, mode_kinds

SHAFT_STIFFNESS = 4e5  # N m/rad
LOAD_INERTIA = 3.0  # kg m2


def pendulum():
    """An order-tuned ring on the crank of two disks."""
    parts = [
        jaxhb.Disk(name="crank", inertia=1.0),
        jaxhb.Disk(name="load", inertia=LOAD_INERTIA),
        jaxhb.Shaft(between=("crank", "load"), stiffness=SHAFT_STIFFNESS),
        jaxhb.Damper(name="ring", disk="crank", inertia=0.1, order=3.0),
        jaxhb.Torque(disk="load", harmonics=[(1.5, 30.0, 0.0), (3.0, 0.0, 100.0)]),
    ]
    return jaxhb.build(parts, revolutions_per_cycle=2)


def test_an_order_tuned_ring_holds_its_disk_still_where_the_rest_swings_at_its_order():
    """The crank rests, so the load swings on the shaft as if clamped:
    sqrt(k / J_load) = 3 x speed.
    """
    diagram = campbell(pendulum(), rpm=np.linspace(600.0, 4000.0, 5).tolist())
    (at,) = [critical for critical in diagram.critical if critical.order == 3.0]
    hz = math.sqrt(SHAFT_STIFFNESS / LOAD_INERTIA) / (2 * math.pi)
    assert at.hz == pytest.approx(hz, rel=1e-9)
    assert at.rpm == pytest.approx(20 * hz, rel=1e-9)
    modes = jaxhb.natural_frequencies(pendulum().with_constant_links(rpm=at.rpm))
    assert modes.frequencies_hz[at.mode] == pytest.approx(hz, rel=1e-9)
    assert abs(modes.shape(at.mode)["crank"]) < 1e-8
    assert at.torque == pytest.approx(
        100.0 * abs(modes.shape(at.mode)["load"]), rel=1e-6
    )


def test_links_held_at_one_speed_have_horizontal_lines_and_torques_tell_their_orders():
    diagram = campbell(pendulum(), rpm=[600.0, 4000.0], links_at={"rpm": 1000.0})
    assert np.ptp(diagram.frequencies_hz, axis=0).max() == 0
    constant = pendulum().with_constant_links(rpm=1000.0)
    expected = jaxhb.natural_frequencies(constant).frequencies_hz
    np.testing.assert_array_equal(diagram.frequencies_hz[0], expected)
    orders = excited_orders(pendulum(), rpm=[1000.0])
    assert diagram.orders.tolist() == orders == [1.5, 3.0]


def test_rigid_modes_and_rings_alone_have_no_critical_speed():
    # A soft ground makes its rigid mode one of 0.02 Hz.
    train = jaxhb.load_scene("gear_train_30")
    diagram = campbell(train, rpm=[1.0, 30.0], orders=[0.1, 1.0])
    assert diagram.kinds[0] == "rigid"
    assert 0 < diagram.frequencies_hz[0, 0] < 0.1
    assert all(critical.mode > 0 for critical in diagram.critical)
    train = jaxhb.load_scene("engine_with_damper")
    kinds = mode_kinds(jaxhb.natural_frequencies(train), train.topology.damper_names)
    assert kinds[:3] == ("rigid", "ring only", "elastic")
    assert set(kinds[2:]) == {"elastic"}


@pytest.mark.parametrize(
    "rpm, orders", [([1000.0], None), ([1000.0, 900.0], None), ([900.0, 1000.0], [0.0])]
)
def test_ranges_that_do_not_rise_and_orders_of_0_are_refused(rpm, orders):
    with pytest.raises(jaxhb.SceneError, match="rising order|greater than 0"):
        campbell(pendulum(), rpm=rpm, orders=orders)


def engine(stroke_cycle):
    """Two cylinders on two throws before a heavy flywheel."""
    combustion = jaxhb.Combustion(
        compression_ratio=14.0,
        charge_pressure=2e5,
        start=-4.0,
        duration=35.0,
        imep=1e6,
        stroke_cycle=stroke_cycle,
    )
    for name, inertia in (("a", 80.0), ("b", 80.0), ("wheel", 4e3)):
        yield jaxhb.Disk(name=name, inertia=inertia, damping=10.0)
    yield jaxhb.Shaft(between=("a", "b"), stiffness=4e7, damping=4e3)
    yield jaxhb.Shaft(between=("b", "wheel"), stiffness=4e7, damping=4e3)
    for k, disk in enumerate("ab"):
        yield jaxhb.Cylinder(
            name=f"cylinder {k + 1}",
            disk=disk,
            firing_angle=180.0 * k,
            bore=0.3,
            stroke=0.6,
            rod=1.2,
            combustion=combustion,
        )
    yield jaxhb.Load(disk="wheel")


@pytest.mark.slow
def test_a_two_stroke_has_all_whole_orders_to_15_with_and_without_a_misfire():
    firing = jaxhb.build([*engine(stroke_cycle=2)], revolutions_per_cycle=1)
    misfire = firing.misfires()["cylinder 2"]
    whole = [float(n) for n in range(1, 16)]
    for train in (firing, misfire):
        assert excited_orders(train, rpm=[300.0]) == whole
        speeds = campbell(train, rpm=[100.0, 2000.0], count=2).critical
        assert {critical.order for critical in speeds} >= {15.0, 14.0, 13.0}
    response = jaxhb.forced_response(misfire, rpm=300.0)
    assert np.asarray(response.torque("b", "wheel").orders)[-1] == 15.0
    # The harmonics are those of the torque over the crank angle.
    parts = [
        dataclasses.replace(part, orders=20.0)
        if isinstance(part, jaxhb.Cylinder)
        else part
        for part in engine(stroke_cycle=2)
    ]
    more_orders = jaxhb.build(parts, revolutions_per_cycle=1).misfire("cylinder 2")
    wide = jaxhb.forced_response(more_orders, rpm=300.0)
    expected = float(wide.torque("b", "wheel").order(15.0))
    order = float(response.torque("b", "wheel").order(15.0))
    assert order == pytest.approx(expected, rel=1e-9)
    assert expected > 0


def test_a_four_stroke_keeps_its_orders_to_12():
    train = jaxhb.build([*engine(stroke_cycle=4)], revolutions_per_cycle=2)
    assert max(excited_orders(train, rpm=[300.0])) <= 12.0
    assert train.topology.cylinders.gas == (24, 24)

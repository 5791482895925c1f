"""Vector sums of firing angles against closed forms and sums in loops."""

import cmath
import math

import numpy as np
import pytest
from built_trains import pair

import jaxhb
from jaxhb import Cylinder, Disk, Engine, Load, Phase, Shaft, build
from jaxhb.elements.sentences import SceneError
from jaxhb.report.figures.phase_diagrams import plot_vector_sums

ROUNDING = 1e-12  # of sums of a dozen unit vectors


def test_sums_of_an_even_engine_are_all_cylinders_or_nothing():
    """Six cylinders have vectors of one direction in orders 3, 6, 9 and 12."""
    train = jaxhb.load_scene("six_cylinder_diesel")
    sums = jaxhb.vector_sums(train)
    np.testing.assert_array_equal(sums.orders, np.arange(1, 25) / 2)
    expected = np.where(sums.orders % 3 == 0, 6.0, 0.0)
    np.testing.assert_allclose(sums.sums, expected, rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(sums.major(), sums.orders % 3 == 0)
    # The same star every three orders
    assert sums.diagrams() == [list(range(k, 24, 6)) for k in range(6)]


def test_sums_of_a_mode_are_those_of_its_angles_at_the_cylinders():
    train = jaxhb.load_scene("six_cylinder_diesel")
    modes = jaxhb.natural_frequencies(train)
    sums = jaxhb.vector_sums(train, modes=modes, numbers=[1, 2], orders=[1.5, 4.0])
    firing = {"1": 0, "5": 120, "3": 240, "6": 360, "2": 480, "4": 600}
    for row, number in enumerate([1, 2]):
        shape = modes.shape(number)
        for column, order in enumerate([1.5, 4.0]):
            expected = sum(
                shape[f"cyl{name}"] * cmath.exp(1j * order * math.radians(angle))
                for name, angle in firing.items()
            )
            actual = sums.mode_sums[row, column]
            assert abs(actual - expected) < ROUNDING, (number, order)
    assert list(sums.modes) == [1, 2]


def cylinder(name, disk="a", firing_angle=0.0, **more):
    return Cylinder(
        name=name,
        disk=disk,
        gas_torque_mean=5.0,
        gas_torque=[(0.5, 3.0, 0.0), (2.0, 1.0, 0.0)],
        firing_angle=firing_angle,
        **more,
    )


def test_phases_turn_vectors_and_cylinders_that_misfire_have_none():
    train = pair(
        cylinder("x"),
        cylinder("y", firing_angle=90.0),
        cylinder("z", firing_angle=10.0),
        Phase(name="turn", of=["y"], angle=30.0),
    ).misfire("z")
    sums = jaxhb.vector_sums(train)
    assert sums.cylinders == ("x", "y")
    np.testing.assert_array_equal(sums.orders, [0.5, 2.0])
    expected = [1 + cmath.exp(1j * n * math.radians(120.0)) for n in (0.5, 2.0)]
    np.testing.assert_allclose(sums.sums, expected, rtol=0, atol=ROUNDING)


def test_orders_count_on_the_reference_and_angles_on_the_own_rotor():
    """A crank at half the speed of the reference has order 2 in its order 4."""
    parts = [Disk(name="a", inertia=1.0, radius=0.1)]
    parts += [Disk(name="b", inertia=1.0, radius=0.2)]
    parts += [jaxhb.Mesh(between=("a", "b"), stiffness=1e8), Load(disk="a")]
    parts += [cylinder("x", "b"), cylinder("y", "b", firing_angle=50.0)]
    train = build(parts, reference="a", revolutions_per_cycle=4)
    sums = jaxhb.vector_sums(train, orders=[1.0])
    expected = 1 + cmath.exp(2j * math.radians(50.0))
    np.testing.assert_allclose(sums.sums, [expected], rtol=0, atol=ROUNDING)


def test_a_cylinder_has_no_vector_in_orders_that_its_torque_lacks():
    """A two-stroke beside a four-stroke on one crank: half orders are of one alone."""
    two_stroke = Cylinder(
        name="y", disk="a", gas_torque_mean=5.0, gas_torque=[(1.0, 3.0, 0.0)]
    )
    sums = jaxhb.vector_sums(pair(cylinder("x"), two_stroke), orders=[0.5, 1.0, 1.5])
    np.testing.assert_allclose(sums.sums, [1.0, 2.0, 1.0], rtol=0, atol=ROUNDING)
    assert sums.major().all()


def test_what_has_no_vector_sum_is_refused_in_a_sentence():
    with pytest.raises(SceneError, match="no cylinder fires"):
        jaxhb.vector_sums(jaxhb.load_scene("spur_pair"))
    with pytest.raises(SceneError, match=r"multiples of 0\.5 above 0"):
        jaxhb.vector_sums(jaxhb.load_scene("first_scene"), orders=[0.7])


def test_a_phase_diagram_has_an_arrow_for_each_direction():
    parts = [Disk(name=str(k), inertia=1.0) for k in range(1, 5)]
    parts += [
        Shaft(between=(str(k), str(k + 1)), stiffness=1e6, damping=1.0)
        for k in range(1, 4)
    ]
    parts += [
        Engine(
            cylinders=4,
            disks=("1", "2", "3", "4"),
            firing_order=("1", "3", "4", "2"),
            gas_torque_mean=5.0,
            gas_torque=[(0.5, 1.0, 0.0), (1.0, 1.0, 0.0), (2.0, 1.0, 0.0)],
        ),
        Load(disk="4"),
    ]
    picture = plot_vector_sums(jaxhb.vector_sums(build(parts)), "four")
    titles = [axes.get_title() for axes in picture.axes[:3]]
    assert titles == ["order 0.5", "order 1", "order 2"]
    names = [
        sorted(text.get_text() for text in axes.texts if text.get_text())
        for axes in picture.axes[:3]
    ]
    assert names == [["1", "2", "3", "4"], ["1, 4", "2, 3"], ["1, 2, 3, 4"]]

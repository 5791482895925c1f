"""Transition and stiffness in the gap of meshes whose scene gives none: the rule in
numbers written out here, and teeth that never part, which move as with a closed gap.
"""

from pathlib import Path

import numpy as np
import pytest
from tolerances import ALGEBRAIC, PATHS

import jaxhb
from jaxhb.train.contact_law import _least_mean_forces
from jaxhb.train.excitation import speeds
from jaxhb.train.mesh_parameters import law_of

STIFFNESS = 1e8
BACKLASH = 1e-4
RADIUS = 0.05
WHOLE = STIFFNESS * BACKLASH / 2  # N
HUNTING = Path(__file__).parents[1] / "data" / "scenes" / "hunting.toml"


def pair(mean=20.0, *, alternating=5.0, scale=(), rated_rpm=None, **law):
    """Two gears that pass on a mean torque with little damping."""
    parts = [
        jaxhb.Disk(name="a", inertia=0.01, radius=RADIUS),
        jaxhb.Disk(name="b", inertia=0.01, radius=RADIUS),
        jaxhb.Torque(
            disk="a",
            mean=mean,
            harmonics=[(1.0, alternating, 0.0)],
            scale=scale,
            rated_rpm=rated_rpm,
        ),
        jaxhb.Load(disk="b"),
        jaxhb.Mesh(
            between=("a", "b"),
            stiffness=STIFFNESS,
            damping=200.0,
            backlash=BACKLASH,
            **law,
        ),
    ]
    return jaxhb.build(parts, reference="a", revolutions_per_cycle=1)


def law(train):
    """Epsilon and transition of the only mesh of a train."""
    return float(train.meshes.epsilon[0]), float(train.meshes.transition[0])


def test_teeth_are_stiff_above_a_fifth_of_their_mean_force_and_the_gap_carries_little():
    for mean in (7.0, 20.0, -20.0):
        force = abs(mean) / RADIUS
        contact = law_of(pair(mean).meshes)
        assert contact.knee_force[0] == pytest.approx(force / 5, rel=ALGEBRAIC)
        assert contact.gap_spring_force[0] <= force / 25 * (1 + ALGEBRAIC)


def test_neither_is_wider_than_usual_nor_narrower_than_a_march_can_follow():
    assert law(pair(2000.0)) == (1e-3, 0.04)
    # Idle: no mean load at all.
    assert law(pair(0.0, alternating=5.0)) == (1e-4, 0.004)


def test_numbers_that_a_scene_gives_stand():
    assert law(pair(transition=0.3)) == (1e-3, 0.3)
    epsilon, transition = law(pair(epsilon=0.01))
    assert epsilon == 0.01
    assert transition == pytest.approx(400.0 / 5 / WHOLE - 0.01, rel=ALGEBRAIC)
    assert law(pair(law="fridman2009")) == (0.03, 0.2)


def test_the_smallest_mean_force_of_the_speed_range_counts():
    scaled = pair(scale=[(600.0, 0.4), (1200.0, 1.0)])
    assert law_of(scaled.meshes).knee_force[0] == pytest.approx(
        0.4 * 400.0 / 5, rel=ALGEBRAIC
    )
    # A torque with the square of the speed runs from a third of its rated speed on.
    squared = pair(mean=90.0, rated_rpm=1500.0)
    assert law_of(squared.meshes).knee_force[0] == pytest.approx(
        90.0 / 9 / RADIUS / 5, rel=ALGEBRAIC
    )


@pytest.mark.slow
def test_mean_forces_are_those_of_the_linear_response():
    disks = [jaxhb.Disk(name=name, inertia=0.01, radius=RADIUS) for name in "abcd"]
    two_ways = [
        *disks,
        jaxhb.Mesh(between=("a", "b"), stiffness=1e7),
        jaxhb.Mesh(between=("b", "c"), stiffness=2e7),
        jaxhb.Mesh(between=("c", "d"), stiffness=3e7),
        jaxhb.Mesh(between=("d", "a"), stiffness=4e7),
        jaxhb.Torque(disk="a", mean=20.0),
        jaxhb.Load(disk="c"),
    ]
    loop = jaxhb.build(two_ways, reference="a", revolutions_per_cycle=1)
    for train in (
        loop,
        jaxhb.load_scene("gear_train_30"),
        jaxhb.load_scene("inline_four_timing_drive"),
    ):
        response = jaxhb.forced_response(train, rpm=1500.0, harmonics=1)
        names = train.topology.mesh_names
        means = np.abs([float(response.force(name).mean) for name in names])
        np.testing.assert_allclose(
            _least_mean_forces(train, speeds(train)), means, rtol=PATHS
        )


def test_a_train_keeps_the_law_that_it_was_built_with():
    train = pair()
    assert law(train.replace({"a:torque.mean": 2.0})) == law(train)


@pytest.mark.slow
def test_light_teeth_that_never_part_move_as_with_a_closed_gap():
    """A wider transition makes the teeth soft where they carry little: their vibratory
    force is off by tens of per cent.
    """
    train = pair(mean=10.0, alternating=7.0)
    closed = jaxhb.linear_response(train, rpm=48000.0).force("a", "b")
    # The teeth never part and come close to it.
    assert 0.2 < closed.min / closed.mean < 0.35

    def error(transition):
        wider = train.replace({"a|b.transition": transition})
        force = jaxhb.solve(wider, rpm=48000.0).force("a", "b")
        return abs(force.half_peak_to_peak / closed.half_peak_to_peak - 1)

    _, chosen = law(train)
    assert error(0.04) > 0.1 > error(2 * chosen) > error(chosen)
    assert error(chosen) < PATHS


def test_modes_at_the_mean_load_have_the_full_stiffness_of_light_teeth():
    train = jaxhb.load_scene(HUNTING)
    compliance = 0.0465**2 / 0.002 + 0.066**2 / 0.01
    modes = jaxhb.natural_frequencies(jaxhb.at_mean_load(train, rpm=3000.0).train)
    assert modes.frequencies_hz[-1] == pytest.approx(
        np.sqrt(3e8 * compliance) / (2 * np.pi), rel=PATHS
    )


@pytest.mark.slow
def test_the_vibratory_force_of_hunting_teeth_is_that_of_a_sharp_gap():
    """An independent integration has 503.7 and 343.9 N with a sharp gap, and 590.5 and
    272.6 N with 0.04.
    """
    train = jaxhb.load_scene(HUNTING)
    for chosen in (train, train.replace({"pinion|wheel.transition": 0.004})):
        force = jaxhb.steady_state(chosen, rpm=3000.0).force("pinion", "wheel")
        assert force.max == pytest.approx(503.7, rel=2e-3)
        assert force.min == pytest.approx(343.9, rel=3e-3)

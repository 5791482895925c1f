"""Transition and stiffness in the gap of meshes whose scene gives none: the rule in
numbers written out here, and the motion of teeth that never part, which is that of a
closed gap.
"""

from pathlib import Path

import numpy as np
import pytest
from tolerances import ALGEBRAIC, PATHS

import jaxhb
from jaxhb.equations.backlash import law_of
from jaxhb.train.contact_law import _least_mean_forces

STIFFNESS = 1e8
BACKLASH = 1e-4
RADIUS = 0.05
WHOLE = STIFFNESS * BACKLASH / 2  # N
HUNTING = Path(__file__).parents[1] / "data" / "scenes" / "hunting.toml"


def pair(mean=20.0, mesh=(), torque=()):
    """Two gears that pass on a mean torque with little damping."""
    parts = [jaxhb.Disk(name=name, inertia=0.01, radius=RADIUS) for name in "ab"]
    given = {"stiffness": STIFFNESS, "damping": 200.0, "backlash": BACKLASH} | dict(
        mesh
    )
    drive = {"mean": mean, "harmonics": [(1.0, 5.0, 0.0)]} | dict(torque)
    parts += [
        jaxhb.Torque(disk="a", **drive),
        jaxhb.Load(disk="b"),
        jaxhb.Mesh(between=("a", "b"), **given),
    ]
    return jaxhb.build(parts, reference="a", revolutions_per_cycle=1)


def law(train):
    """Epsilon and transition of its only mesh."""
    return float(train.meshes.epsilon[0]), float(train.meshes.transition[0])


def test_teeth_are_stiff_above_a_fifth_of_their_mean_force_and_the_gap_carries_little():
    for mean in (7.0, 20.0, -20.0):
        force = abs(mean) / RADIUS
        found = law_of(pair(mean).meshes)
        assert found.knee_force[0] == pytest.approx(force / 5, rel=ALGEBRAIC)
        assert found.gap_spring_force[0] <= force / 25 * (1 + ALGEBRAIC)


def test_neither_is_wider_than_usual_nor_narrower_than_a_march_can_follow():
    assert law(pair(2000.0)) == (1e-3, 0.04)
    assert law(pair(0.0, torque={"harmonics": [(1.0, 5.0, 0.0)]})) == (
        1e-4,
        0.004,
    )  # idle: no mean load at all


def test_numbers_that_a_scene_gives_stand():
    assert law(pair(mesh={"transition": 0.3})) == (1e-3, 0.3)
    epsilon, transition = law(pair(mesh={"epsilon": 0.01}))
    assert (epsilon, transition) == (
        0.01,
        pytest.approx(400.0 / 5 / WHOLE - 0.01, rel=ALGEBRAIC),
    )
    assert law(pair(mesh={"law": "fridman2009"})) == (0.03, 0.2)


def test_the_smallest_mean_force_of_the_speed_range_counts():
    scaled = pair(torque={"scale": [(600.0, 0.4), (1200.0, 1.0)]})
    assert law_of(scaled.meshes).knee_force[0] == pytest.approx(
        0.4 * 400.0 / 5, rel=ALGEBRAIC
    )
    # A torque with the square of the speed runs from a third of its rated speed on.
    squared = pair(mean=90.0, torque={"rated_rpm": 1500.0})
    assert law_of(squared.meshes).knee_force[0] == pytest.approx(
        90.0 / 9 / RADIUS / 5, rel=ALGEBRAIC
    )


def test_mean_forces_are_those_of_the_linear_response():
    two_ways = [jaxhb.Disk(name=name, inertia=0.01, radius=RADIUS) for name in "abcd"]
    ends = ("a", "b"), ("b", "c"), ("c", "d"), ("d", "a")
    two_ways += [
        jaxhb.Mesh(between=pair, stiffness=k)
        for pair, k in zip(ends, (1e7, 2e7, 3e7, 4e7), strict=True)
    ]
    two_ways += [jaxhb.Torque(disk="a", mean=20.0), jaxhb.Load(disk="c")]
    loop = jaxhb.build(two_ways, reference="a", revolutions_per_cycle=1)
    for train in (
        loop,
        jaxhb.load_scene("gear_train_30"),
        jaxhb.load_scene("inline_four_timing_drive"),
    ):
        response = jaxhb.forced_response(train, rpm=1500.0, harmonics=1)
        means = np.abs(
            [float(response.force(name).mean) for name in train.topology.mesh_names]
        )
        np.testing.assert_allclose(_least_mean_forces(train), means, rtol=PATHS)


def test_a_train_keeps_the_law_that_it_was_built_with():
    train = pair()
    assert law(train.replace({"a:torque.mean": 2.0})) == law(train)


def test_light_teeth_that_never_part_move_as_with_a_closed_gap():
    """A wider transition makes them soft where they carry little: their vibratory force
    is off by tens of per cent.
    """
    light = {"mean": 10.0, "torque": {"harmonics": [(1.0, 7.0, 0.0)]}}
    train = pair(**light)
    closed = jaxhb.linear_response(train, rpm=48000.0).force("a", "b")
    assert 0.2 < closed.min / closed.mean < 0.35

    def error(transition):
        wider = train.replace({"a|b.transition": transition})
        found = jaxhb.solve(wider, rpm=48000.0).force("a", "b")
        return abs(found.half_peak_to_peak / closed.half_peak_to_peak - 1)

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


@pytest.mark.oracle
def test_the_vibratory_force_of_hunting_teeth_is_that_of_a_sharp_gap():
    """503.7 and 343.9 N by an integration of its own with a sharp gap; 590.5 and 272.6
    N with 0.04.
    """
    train = jaxhb.load_scene(HUNTING)
    for chosen in (train, train.replace({"pinion|wheel.transition": 0.004})):
        force = jaxhb.steady_state(chosen, rpm=3000.0).force("pinion", "wheel")
        assert (force.max, force.min) == (
            pytest.approx(503.7, rel=2e-3),
            pytest.approx(343.9, rel=3e-3),
        )

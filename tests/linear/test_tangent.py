"""The train at its mean load against law (18) and calculation by hand."""

import math

import pytest

import jaxhb
from jaxhb.linear.tangent import at_mean_load

GAP = 1e-4
STIFFNESS = 1e8
EPSILON = 1e-3
TRANSITION = 0.04


def mesh(a, b, backlash=GAP, epsilon=EPSILON):
    return jaxhb.Mesh(
        between=(a, b),
        stiffness=STIFFNESS,
        backlash=backlash,
        epsilon=epsilon,
        transition=TRANSITION,
    )


def pair(force, epsilon=EPSILON):
    """A gear of 0.1 m that drives another with ``force`` in N."""
    parts = [jaxhb.Disk(name=name, inertia=0.1, radius=0.1) for name in "ab"]
    parts += [
        jaxhb.Torque(disk="a", mean=0.1 * force),
        jaxhb.Load(disk="b"),
        mesh("a", "b", epsilon=epsilon),
    ]
    return jaxhb.build(parts, reference="a")


def test_a_loaded_mesh_has_its_full_stiffness_an_idle_one_that_of_the_gap():
    half = (1 - TRANSITION) * GAP / 2
    width = TRANSITION * GAP
    drop = STIFFNESS * (1 - EPSILON)
    loaded = at_mean_load(pair(1000.0), rpm=1000.0)
    idle = at_mean_load(pair(2.0), rpm=1000.0)
    assert loaded.force == pytest.approx([1000.0], rel=1e-9)
    assert loaded.stiffness.tolist() == [STIFFNESS]
    assert idle.force == pytest.approx([2.0], rel=1e-9)
    assert idle.stiffness.tolist() == [EPSILON * STIFFNESS]
    assert idle.engagement.tolist() == [0.0]
    u = 0.3 * width
    force = EPSILON * STIFFNESS * (half + u) + drop * u**2 / (2 * width)
    between = at_mean_load(pair(force), rpm=1000.0)
    assert between.engagement == pytest.approx([0.3], rel=1e-6)
    assert between.stiffness == pytest.approx(
        [EPSILON * STIFFNESS + drop * u / width], rel=1e-6
    )


@pytest.mark.parametrize("force", [0.0, 1e-3, 5.0, -300.0, 1e5])
def test_a_gap_without_stiffness_carries_nothing_and_its_flank_the_load(force):
    load = at_mean_load(pair(force, epsilon=0.0), rpm=1000.0)
    # F = c u^2 / (2 tau h).
    u = min(math.sqrt(2 * TRANSITION * GAP * abs(force) / STIFFNESS), TRANSITION * GAP)
    assert load.force == pytest.approx([force], rel=1e-9)
    assert load.stiffness == pytest.approx(
        [STIFFNESS * u / (TRANSITION * GAP)], rel=1e-6
    )


def test_the_natural_frequency_at_mean_load_is_that_of_the_slope():
    load = at_mean_load(pair(2.0), rpm=1000.0)
    hz = jaxhb.natural_frequencies(load.train).frequencies_hz[1]
    omega = math.sqrt(2 * EPSILON * STIFFNESS * 0.1**2 / 0.1)
    assert hz == pytest.approx(omega / (2 * math.pi), rel=1e-9)


@pytest.mark.slow
def test_mean_tooth_forces_of_a_train_without_loops_do_not_depend_on_the_law():
    train = jaxhb.load_scene("engine_with_damper")
    load = at_mean_load(train, rpm=1200.0)
    linear = jaxhb.forced_response(train, rpm=1200.0)
    means = [float(linear.force(name).mean) for name in load.names]
    assert load.force == pytest.approx(means, rel=1e-6)


def test_mean_torques_that_do_not_balance_have_no_mean_load():
    parts = [jaxhb.Disk(name="a", inertia=0.1)]
    parts += [
        jaxhb.Torque(name=name, disk="a", mean=mean)
        for name, mean in (("drive", 5.0), ("brake", -5.0))
    ]
    train = jaxhb.build(parts).replace({"drive.mean": 6.0})
    with pytest.raises(jaxhb.SceneError, match="do not balance"):
        at_mean_load(train, rpm=1000.0)


def test_in_a_closed_loop_the_mesh_with_less_backlash_carries_more():
    """Two gears on each of two shafts; the forces together carry the torque, and shafts
    and teeth fit together.
    """
    parts = [
        jaxhb.Disk(name=name, inertia=0.1, radius=0.1)
        for name in ("a1", "a2", "b1", "b2")
    ]
    parts += [jaxhb.Shaft(between=(f"{x}1", f"{x}2"), stiffness=1e5) for x in "ab"]
    parts += [mesh("a1", "b1"), mesh("a2", "b2", 3 * GAP)]
    parts += [jaxhb.Torque(disk="a1", mean=1000.0), jaxhb.Load(disk="b2")]
    load = at_mean_load(jaxhb.build(parts, reference="a1"), rpm=1000.0)
    tight, slack = load.force
    assert tight + slack == pytest.approx(1000.0 / 0.1, rel=1e-9)
    assert tight > slack > 0
    driving_twist = (1000.0 - 0.1 * tight) / 1e5
    driven_twist = 0.1 * tight / 1e5
    tight_deflection = tight / STIFFNESS + (1 - EPSILON) * GAP / 2
    slack_deflection = slack / STIFFNESS + (1 - EPSILON) * 3 * GAP / 2
    assert tight_deflection - slack_deflection == pytest.approx(
        0.1 * (driving_twist - driven_twist), abs=1e-12
    )

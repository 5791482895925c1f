"""A cycle in segments against the same cycle in one piece."""

import dataclasses

import jax
import numpy as np
import pytest
from tolerances import PATHS
from trains import ONE_RADIAN_PER_SECOND, branched_parts, build

from jaxhb import Disk, Ground, Mesh, Shaft, Torque
from jaxhb.balance.plan import Plan
from jaxhb.integration import shooting
from jaxhb.integration.step import cycle, cycle_error
from jaxhb.solutions import shots

PLAN = Plan(harmonics=32, active=(0, 1), flank=(0, 0), time_steps=1024, excited=3)


def stepper():
    train = build(branched_parts(), reference="flywheel")
    return shots.reduced_stepper(train, 1500.0, PLAN)


@jax.jit
def both_ways(stepper, state):
    nodes = shooting.beginnings(stepper, state)
    end, trace = cycle(stepper, state)
    pieces = shooting.linearize(stepper, nodes)
    whole, _ = shooting.monodromy(stepper, state)
    return (
        nodes,
        end,
        trace.deflection,
        shooting.motion(stepper, nodes).deflection,
        pieces,
        whole,
    )


@pytest.mark.slow
def test_segments_in_a_row_are_the_cycle():
    stepped = stepper()
    nodes, end, deflection, pieced, (gap, slope), whole = both_ways(
        stepped, stepped.flank_state
    )
    np.testing.assert_allclose(
        pieced, deflection, atol=PATHS * np.abs(deflection).max()
    )
    size = np.abs(nodes).max()
    np.testing.assert_allclose(gap[:-1], 0.0, atol=PATHS * size)
    np.testing.assert_allclose(gap[-1], end - stepped.flank_state, atol=PATHS * size)
    product = np.linalg.multi_dot(np.asarray(slope)[::-1])
    np.testing.assert_allclose(product, whole, atol=PATHS * np.abs(whole).max())


@pytest.mark.slow
def test_room_for_more_steps_changes_nothing():
    roomy = stepper()
    steps = int(roomy.count)
    assert roomy.capacity > steps == PLAN.time_steps
    tight = dataclasses.replace(roomy, linear=roomy.linear[: 2 * steps], count=None)
    nodes = shooting.beginnings(tight, tight.flank_state)
    for motion in (shooting.motion, lambda stepper, nodes: cycle(stepper, nodes[0])[1]):
        padded = jax.jit(motion)(roomy, nodes)
        expected = jax.jit(motion)(tight, nodes)
        np.testing.assert_array_equal(padded.deflection[:, steps:], 0.0)
        np.testing.assert_allclose(
            padded.deflection[:, :steps], expected.deflection, rtol=PATHS, atol=0.0
        )
        # This error is a difference of the motion.
        np.testing.assert_allclose(
            padded.periodicity_error, expected.periodicity_error, rtol=1e-6
        )


@pytest.mark.slow
def test_what_closes_a_cycle_is_the_same_with_and_without_samples():
    stepped = stepper()
    stretch = 1 + 1e-3 * np.arange(shooting.SEGMENTS)[:, None]
    nodes = shooting.beginnings(stepped, stepped.flank_state) * stretch
    gap, periodicity_error = shooting.gaps_and_error(stepped, nodes)
    np.testing.assert_array_equal(gap, shooting.gaps(stepped, nodes)[0])
    np.testing.assert_allclose(
        periodicity_error, shooting.motion(stepped, nodes).periodicity_error, rtol=PATHS
    )
    end, periodicity_error = cycle_error(stepped, stepped.flank_state)
    after, trace = cycle(stepped, stepped.flank_state)
    np.testing.assert_array_equal(end, after)
    np.testing.assert_allclose(periodicity_error, trace.periodicity_error, rtol=PATHS)


def test_a_correction_solves_the_linearised_equations():
    rng = np.random.default_rng(3)
    count = 8
    size = 4
    slope = 0.8 * rng.normal(size=(count, size, size))
    gap = rng.normal(size=(count, size))
    change = np.asarray(shooting.closing(shooting.condense(slope), gap))
    left = np.einsum("kij,kj->ki", slope, change) - np.roll(change, -1, axis=0)
    np.testing.assert_allclose(left, -gap, atol=PATHS * np.abs(change).max())


@pytest.mark.slow
def test_what_moves_nothing_is_left_out():
    """Free rotation and its undamped rate, and a mode forty times too fast for the
    steps, which answers statically.
    """
    grounded = floating_pair(grounded=True)
    floating = floating_pair(grounded=False)
    # The fast mode and its rate.
    assert np.sum(shooting.moving(grounded.space) == 0) == 2
    still = np.flatnonzero(np.asarray(shooting.moving(floating.space)) == 0)
    assert len(still) == 4
    nodes = shooting.beginnings(floating, floating.flank_state)
    change = np.asarray(direction(floating, nodes))
    assert np.abs(change).max() > 0
    np.testing.assert_allclose(change[:, still], 0.0, atol=PATHS * np.abs(nodes).max())


@jax.jit
def direction(stepper, nodes):
    gap, slope = shooting.linearize(stepper, nodes)
    return shooting.closing(shooting.condense(slope), gap)


def floating_pair(grounded):
    parts = [
        Disk(name="driver", inertia=1.0, radius=1.0),
        Disk(name="gear", inertia=1e-6, radius=1.0),
        Disk(name="driven", inertia=1.0),
        Mesh(
            between=("driver", "gear"),
            stiffness=4.0,
            damping=0.1,
            backlash=0.5,
            epsilon=0.01,
            transition=0.2,
        ),
        Shaft(between=("gear", "driven"), stiffness=20.0, damping=0.1),
        Torque(disk="driver", mean=0.4, harmonics=[(1.0, 1.5, 0.0)]),
        Torque(disk="driven", mean=-0.4),
        *([Ground(disk="driven", stiffness=0.1)] if grounded else []),
    ]
    plan = Plan(harmonics=32, active=(0,), flank=(0,), time_steps=256, excited=1)
    return shots.reduced_stepper(
        build(parts, reference="driver"), 2 * ONE_RADIAN_PER_SECOND, plan
    )

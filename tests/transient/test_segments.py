"""A cycle in segments against the same cycle in one piece."""

import jax
import numpy as np
from tolerances import PATHS
from trains import branched_parts, build

from jaxhb.periodic import orbits
from jaxhb.periodic.harmonics import Plan
from jaxhb.transient import segments, shooting
from jaxhb.transient.integrate import cycle

PLAN = Plan(harmonics=32, active=(0, 1), flank=(0, 0), instants=1024, excited=3)


def stepper():
    train = build(branched_parts(), reference="flywheel")
    return orbits.stepper_of(train, 1500.0, PLAN)


@jax.jit
def both_ways(stepper, state):
    nodes = segments.beginnings(stepper, state)
    end, trace = cycle(stepper, state)
    pieces = segments.linearize(lambda share: stepper, nodes, 0.0)
    whole = shooting.monodromy(stepper, state)
    return nodes, end, trace.deflection, segments.motion(stepper, nodes).deflection, pieces, whole


def test_segments_in_a_row_are_the_cycle():
    train = stepper()
    nodes, end, deflection, pieced, (gap, slope, share_slope), whole = both_ways(train, train.flank_state)
    np.testing.assert_allclose(pieced, deflection, atol=PATHS * np.abs(deflection).max())
    size = np.abs(nodes).max()
    np.testing.assert_allclose(gap[:-1], 0.0, atol=PATHS * size)
    np.testing.assert_allclose(gap[-1], end - train.flank_state, atol=PATHS * size)
    product = np.linalg.multi_dot(np.asarray(slope)[::-1])
    np.testing.assert_allclose(product, whole, atol=PATHS * np.abs(whole).max())
    np.testing.assert_array_equal(share_slope, 0.0)


def test_segments_closed_one_by_one_are_a_periodic_cycle():
    train = stepper()
    nodes, joined, _ = jax.jit(lambda nodes: segments.close(train, nodes, tolerance=1e-10, most=15))(
        segments.beginnings(train, train.flank_state)
    )
    _, begun = cycle(train, train.flank_state)
    _, closed = cycle(train, nodes[0])
    assert joined.closure <= 1e-10 < 1e-6 < begun.closure
    assert closed.closure < 1e-8  # no Floquet multiplier of this train is large


def test_correction_and_tangent_solve_the_linearised_equations():
    rng = np.random.default_rng(3)
    count, size = 8, 4
    slope, gap = 0.8 * rng.normal(size=(count, size, size)), rng.normal(size=(count, size))
    share_slope = rng.normal(size=(count, size))
    change, tangent = np.asarray(jax.jit(segments.correct)(gap, slope, share_slope)).T

    def left(y):
        nodes = y[:-1].reshape(count, size)
        moved = np.einsum("kij,kj->ki", slope, nodes) + y[-1] * share_slope
        return moved - np.roll(nodes, -1, axis=0)

    np.testing.assert_allclose(left(change), -gap, atol=PATHS * np.abs(change).max())
    np.testing.assert_allclose(left(tangent), 0.0, atol=PATHS * np.abs(tangent).max())


def test_free_rotation_is_left_out():
    space = stepper().space
    assert np.all(segments.moving(space) == 1)  # a ground spring holds this train

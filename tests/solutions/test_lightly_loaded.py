"""The lightly loaded pair: what it does in the long run, and which of its orbits are
unstable; exact motions tell.
"""

import dataclasses

import jax
import numpy as np
import pytest
from reference_data import reference
from trains import Pair, pair_rpm, pair_train

import jaxhb

EPSILON = 1e-3
ROWS = {
    row["speed"]: row for row in reference("lightly_loaded_pair")["laws"][1]["rows"]
}


@pytest.fixture(scope="module")
def train():
    """With a transition zone that moves extremes by 0.1 % of what a sharp gap gives."""
    return pair_train(Pair(1.0, epsilon=EPSILON), transition=0.01)


def rpm(speed):
    return pair_rpm(Pair(speed, epsilon=EPSILON))


@pytest.mark.parametrize("speed", [0.6, 1.0, 1.3, 1.6])
def test_a_steady_state_is_an_exact_motion_of_the_long_run(train, speed):
    state = jaxhb.steady_state(train, rpm=rpm(speed), tolerance=1e-3)
    deflection = state.deflection("a", "b")
    found = np.array([deflection.max, deflection.min])
    exact = [
        (a["period"], np.array([a["maximum"], a["minimum"]]))
        for a in ROWS[speed]["attractors"]
    ]
    # 0.2 %: the transition zone, and 0.1 % of truncation
    assert any(
        period == state.period and np.abs(found - m).max() < 2e-3 * np.abs(m).max()
        for period, m in exact
    )


def test_where_no_motion_repeats_the_record_reaches_what_the_exact_motion_reaches_in_as_many_cycles(
    train,
):
    state = jaxhb.steady_state(train, rpm=rpm(1.1))
    (exact,) = ROWS[1.1]["attractors"]
    assert state.kind == exact["kind"] == "irregular"
    low, _, high = exact["largest_over"][str(state.record.cycles)]
    assert 0.97 * low < state.deflection("a", "b").max < 1.03 * high


@pytest.mark.parametrize("speed", [0.4, 0.8, 1.0, 1.5])
def test_an_orbit_of_one_cycle_is_as_stable_as_the_exact_one(train, speed):
    orbit = jaxhb.solve(train, rpm=rpm(speed), tolerance=1e-3)
    assert orbit.converged
    told = jaxhb.stability(orbit)
    top = float(orbit.deflection("a", "b").max)
    exact = min(ROWS[speed]["orbits"], key=lambda one: abs(one["maximum"] - top))
    wanted = max((complex(*pair) for pair in exact["multipliers"]), key=abs)
    wanted = wanted.conjugate() if wanted.imag * told.critical.imag < 0 else wanted
    assert abs(told.critical - wanted) < 2e-3 * abs(
        wanted
    )  # the law is smooth there, and the motion cut off
    assert told.stable == (abs(wanted) < 1)
    assert told.loses_by == (None if told.stable else "period doubling")


@pytest.mark.parametrize(("speed", "start"), [(0.4, "march"), (0.9, "response")])
def test_a_plan_whose_own_start_does_not_lead_to_the_motion_asks_for_one(
    train, speed, start
):
    asked = {"rpm": rpm(speed), "plan": jaxhb.plan(train, rpm=rpm(speed))}
    assert asked["plan"].start == start
    found = jaxhb.solve(train, rpm=rpm(speed))
    if start == "response":
        for solve in (jaxhb.solve, jax.jit(jaxhb.solve, static_argnames="plan")):
            with pytest.raises(
                ValueError, match="solve without a plan and give that response as start"
            ):
                solve(train, **asked)
        marched = jaxhb.solve(train, **asked, start="march")
        assert not marched.converged  # as without the question
        asked["start"] = found
    planned = jaxhb.solve(train, **asked)
    assert planned.converged
    # What sweeps found has the error that it tells.
    difference = abs(planned.deflection("a", "b").max - found.deflection("a", "b").max)
    assert difference <= found.truncation_error * found.deflection("a", "b").max
    # Both residuals are below 1e-10, and the deflection has the condition of its
    # equations beside. Averages of the law in place of samples err less than the
    # truncation does.
    exact = jaxhb.solve(train, rpm=rpm(speed), harmonics=planned.harmonics, start=found)
    sampled = jaxhb.solve(
        train, **asked | {"plan": dataclasses.replace(asked["plan"], averaged=False)}
    )
    assert abs(sampled.deflection("a", "b").max - exact.deflection("a", "b").max) < 1e-7
    difference = abs(planned.deflection("a", "b").max - exact.deflection("a", "b").max)
    assert difference < 0.3 * planned.truncation_error * exact.deflection("a", "b").max

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
    reached = np.array([deflection.max, deflection.min])
    exact = [
        np.array([attractor["maximum"], attractor["minimum"]])
        for attractor in ROWS[speed]["attractors"]
        if attractor["period"] == state.period
    ]
    # 0.2 %: the transition zone, and 0.1 % of truncation.
    errors = [np.abs(reached - m).max() / np.abs(m).max() for m in exact]
    assert min(errors, default=np.inf) < 2e-3


def test_where_no_motion_repeats_the_record_reaches_what_the_exact_one_reaches(train):
    """In as many cycles."""
    state = jaxhb.steady_state(train, rpm=rpm(1.1))
    (exact,) = ROWS[1.1]["attractors"]
    assert state.kind == exact["kind"] == "irregular"
    low, _, high = exact["largest_over"][str(state.record.cycles)]
    assert 0.97 * low < state.deflection("a", "b").max < 1.03 * high


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.4, 0.8, 1.0, 1.5])
def test_an_orbit_of_one_cycle_is_as_stable_as_the_exact_one(train, speed):
    orbit = jaxhb.solve(train, rpm=rpm(speed), tolerance=1e-3)
    assert orbit.converged
    stability = jaxhb.stability(orbit)
    top = float(orbit.deflection("a", "b").max)
    exact = min(ROWS[speed]["orbits"], key=lambda row: abs(row["maximum"] - top))
    expected = max((complex(re, im) for re, im in exact["multipliers"]), key=abs)
    if expected.imag * stability.critical.imag < 0:
        expected = expected.conjugate()
    # The law is smooth there, and the motion cut off.
    assert abs(stability.critical - expected) < 2e-3 * abs(expected)
    assert stability.stable == (abs(expected) < 1)
    assert stability.loses_by == (None if stability.stable else "period doubling")


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "start"), [(0.4, "march"), (0.9, "response")])
def test_a_plan_whose_own_start_does_not_lead_to_the_motion_asks_for_one(
    train, speed, start
):
    speed_rpm = rpm(speed)
    plan = jaxhb.plan(train, rpm=speed_rpm)
    assert plan.start == start
    swept = jaxhb.solve(train, rpm=speed_rpm)
    if start == "response":
        for solve in (jaxhb.solve, jax.jit(jaxhb.solve, static_argnames="plan")):
            with pytest.raises(
                ValueError, match="solve without a plan and give that response as start"
            ):
                solve(train, rpm=speed_rpm, plan=plan)
        marched = jaxhb.solve(train, rpm=speed_rpm, plan=plan, start="march")
        assert not marched.converged  # as without the question
    begin = swept if start == "response" else None
    planned = jaxhb.solve(train, rpm=speed_rpm, plan=plan, start=begin)
    assert planned.converged

    def largest(response):
        return response.deflection("a", "b").max

    # A motion of sweeps has the error that it tells.
    difference = abs(largest(planned) - largest(swept))
    assert difference <= swept.truncation_error * largest(swept)
    # Both residuals are below 1e-10, and the deflection has the condition of its
    # equations beside. Averages of the law in place of samples err less than the
    # truncation does.
    exact = jaxhb.solve(train, rpm=speed_rpm, harmonics=planned.harmonics, start=swept)
    sampling = dataclasses.replace(plan, averaged=False)
    sampled = jaxhb.solve(train, rpm=speed_rpm, plan=sampling, start=begin)
    assert abs(largest(sampled) - largest(exact)) < 1e-7
    difference = abs(largest(planned) - largest(exact))
    assert difference < 0.3 * planned.truncation_error * largest(exact)

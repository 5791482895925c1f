"""Limits between the speeds of a tuning: peaks against fine sweeps, designs that keep them, what is told of both."""

import dataclasses

import numpy as np
import pytest
from reference_data import DATA

import jaxhb
from jaxhb.balance.plan import Request
from jaxhb.design import Objective, Parameter, Penalty
from jaxhb.design.between_speeds import Followed, check_between, critical_speeds, exceeded, speeds_of
from jaxhb.design.evaluation import Aim, Evaluator, Task
from jaxhb.design.quantities import QUANTITIES
from jaxhb.report.text.tuned import tuned_parts, tuned_record

TRAIN = jaxhb.load_scene(DATA / "scenes/propeller_shaft.toml")
STRESS = Objective(quantity="stress over continuous limit", of="shaft")
NAME = "stress over continuous limit of shaft"
OUTER = Parameter(name="shaft.outer", low=0.44, high=0.585)
RPM = np.linspace(50.0, 110.0, 7)
FINE = np.linspace(50.0, 110.0, 1201)
TASK = Task((OUTER,), (STRESS,), ())


def share(train, rpm):
    """Stress over its limit by the linear forced response, which no tuning reads."""
    response = jaxhb.forced_response(train, rpm=rpm)
    return np.asarray(QUANTITIES[STRESS.quantity].exact_value(response, "shaft", None, train))


def of_diameter(outer):
    return TRAIN.replace({"shaft.outer": float(outer)})


@pytest.mark.parametrize("outer", [0.45, 0.46, 0.52, 0.585])
def test_the_peak_between_the_speeds_is_that_of_a_fine_sweep(outer):
    train = of_diameter(outer)
    checked, truth = check_between(train, RPM, TASK), share(train, FINE)
    value, speed = checked.worst(NAME)
    assert value == pytest.approx(truth.max(), rel=1e-3)
    assert speed == pytest.approx(FINE[truth.argmax()], rel=2e-3)
    assert set(RPM) <= set(checked.rpm) and len(checked.rpm) < 40
    over = exceeded(TASK, checked)
    assert bool(over) == (truth.max() > 1.01)


def test_speeds_that_lie_further_apart_than_the_others_are_a_hole_that_is_not_looked_into():
    """As about a barred range: the resonance at 66.7 rpm lies in it."""
    checked = check_between(TRAIN, np.array([50.0, 53.0, 56.0, 80.0, 83.0, 86.0]), TASK)
    assert not ((checked.rpm > 56.0) & (checked.rpm < 80.0)).any()


def test_a_followed_speed_is_the_critical_speed_of_every_design_within_the_range():
    (one,) = critical_speeds(TRAIN, RPM)
    for outer in (0.44, 0.5, 0.55):
        train = of_diameter(outer)
        (critical,) = jaxhb.campbell(train, rpm=[50.0, 110.0]).critical
        assert speeds_of([one], train, RPM) == pytest.approx(critical.rpm, rel=1e-12)
    assert speeds_of([one, Followed(77.0)], of_diameter(0.7), RPM).tolist() == [110.0, 77.0]


DIAMETERS = np.linspace(0.45, 0.56, 8)


def values_at(diameters, task, critical):
    """What a tuning makes small, of designs, from its smooth readings."""
    evaluator = Evaluator(TRAIN, RPM, task, Request.of(TRAIN, None, 0.01, integrals="sampled"), critical=critical)
    z = np.array([task.unbounded(of_diameter(outer)) for outer in diameters])
    near = evaluator.unsolved(z)
    aim = Aim(np.ones(near.status.shape, dtype=bool), np.ones(1), np.array([0.01]), 0.01)
    return evaluator.at(z, near, aim).value


def test_an_objective_that_follows_a_resonance_falls_all_the_way_on_which_its_peak_falls():
    """Read at the speeds asked for alone it rises and falls as the resonance passes them."""
    peaks = np.array([share(of_diameter(outer), FINE).max() for outer in DIAMETERS])
    assert (np.diff(peaks) < 0).all() and (np.diff(values_at(DIAMETERS, TASK, ())) > 0).any()
    followed = values_at(DIAMETERS, TASK, critical_speeds(TRAIN, RPM))
    assert (np.diff(followed) < 0).all()
    np.testing.assert_allclose(followed, peaks, rtol=0.02)  # smooth, at the undamped critical speed


def test_a_penalty_counts_at_the_critical_speed_too():
    held = Penalty(quantity=STRESS.quantity, of="shaft", most=0.5, weight=100.0)
    nothing = Objective(quantity="shaft torque order", of="shaft", order=6.0, over="mean", weight=0.0)
    found = values_at(DIAMETERS, Task((OUTER,), (nothing,), (held,)), critical_speeds(TRAIN, RPM))
    for value, outer in zip(found, DIAMETERS, strict=True):
        train = of_diameter(outer)
        (critical,) = jaxhb.campbell(train, rpm=[50.0, 110.0]).critical
        excess = np.maximum(share(train, np.array([*RPM, critical.rpm])) - 0.5, 0.0) / 0.5
        assert value == pytest.approx(100.0 * (excess**2).sum(), rel=0.03)  # smooth: 0.8 % below at most


@pytest.fixture(scope="module")
def tuned():
    return jaxhb.tune(TRAIN, parameters=[OUTER], rpm=RPM, objective=STRESS)


def test_the_default_search_finds_the_way_to_a_design_that_keeps_its_limit_between_the_speeds(tuned):
    """At the speeds asked for alone it ends beside the start, at 0.45 m, where the stress is 1.27 of its limit."""
    best = min(share(of_diameter(outer), FINE).max() for outer in np.linspace(0.53, 0.585, 12))
    truth = share(tuned.train, FINE).max()
    assert best < 0.9 and truth < 1.02 * best
    assert tuned.checked["after"].worst(NAME)[0] == pytest.approx(truth, rel=1e-3)
    assert tuned.checked["before"].worst(NAME)[0] == pytest.approx(share(TRAIN, FINE).max(), rel=1e-3)
    (sentence,) = tuned.followed
    assert "of its limit at 6" in sentence and "between the speeds asked for" in sentence


def test_what_is_told_of_limits_is_what_holds_between_the_speeds(tuned):
    asked = {"parameters": (OUTER,), "objective": (STRESS,), "penalties": (), "rpm": RPM}
    text = "\n\n".join(tuned_parts(TRAIN, asked, tuned))
    value, speed = tuned.checked["after"].worst(NAME)
    assert f"{value:.3g} at {speed:.5g} rpm after" in text and "Within its limits, between the speeds too." in text
    record = tuned_record(TRAIN, asked, tuned)
    assert record["checked"]["after"]["worst"][NAME] == {"value": value, "rpm": speed}
    assert record["followed"] == tuned.followed
    before = tuned.checked["before"]
    unmended = dataclasses.replace(tuned, after=tuned.before, checked={"before": before, "after": before})
    assert np.nanmax(unmended.after.readings[NAME]) < 0.5
    text = tuned_parts(TRAIN, asked, unmended)[-1]
    assert text == f"NOT within its limits: {NAME} is 1.22 at 66.74 rpm, at most 1."

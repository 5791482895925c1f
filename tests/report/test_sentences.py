"""Sentences and tables on several speeds: notes that are alike, speeds that a tuning
could not solve, torques that grounds take.
"""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

import jaxhb
from jaxhb.design import Objective
from jaxhb.report.answer import SPEED
from jaxhb.report.text.mean_torques import balance_line, mean_angles_of, torque_notes
from jaxhb.report.text.sentences import once_alike, speeds_text
from jaxhb.report.text.tuned import _compared, _not_solved, _worst


@pytest.mark.parametrize(
    "name", ["cylinder {}", "o'ring {}", 'a "{}" b', 'it\'s {} "x"']
)
def test_notes_on_elements_whose_names_differ_in_a_digit_stay_apart(name):
    names = [repr(name.format(k)) for k in (1, 2)]
    remarks = [
        (rpm, f"the speed lies outside of {element} ({rpm / 3:g} rpm)")
        for rpm in (900.0, 600.0)
        for element in names
    ]
    expected = "At 600 rpm the speed lies outside of {} (200 rpm) (alike at 900 rpm)."
    assert once_alike(remarks) == [expected.format(element) for element in names]


@pytest.mark.parametrize(
    ("first", "second"),
    [("5.24e+03 N", "0.01 N"), ("1e-05", "3"), ("2.5 cycles.", "31 cycles.")],
)
def test_notes_that_differ_in_values_stand_once_with_each_speed_once_and_in_order(
    first, second
):
    places = [1472.0, 2500.0, 4000.0, 800.0, 1472.0, 2500.0, 800.0]
    remarks = [
        (place, f"takes {first if place == 800 else second}") for place in places
    ]
    (sentence,) = once_alike(remarks)
    assert sentence == f"At 800 rpm takes {first} (alike at 1472, 2500, 4000 rpm)."
    (single,) = once_alike([(800.0, "the same"), (800.0, "the same")])
    assert single == "At 800 rpm the same."


def test_speeds_are_listed_from_the_lowest_on_each_once():
    answers = [
        SimpleNamespace(place=value, axis=SPEED) for value in (3.0, 1.0, 2.0, 3.0, 1.0)
    ]
    assert speeds_text(answers) == "1, 2, 3 rpm"


def test_speeds_that_a_tuning_could_not_solve_are_named():
    rpm = np.array([1000.0, 1857.5, 2000.0])
    before = SimpleNamespace(solved=np.array([True, False, False]))
    after = SimpleNamespace(solved=np.array([True] * 3))
    (sentence,) = _not_solved(rpm, SimpleNamespace(before=before, after=after))
    assert sentence.startswith(
        "NOT solved, and left out of the objectives: 1857.5, 2000 rpm before. "
    )
    assert sentence.endswith(
        " Before and after are compared at the 1 speed solved in both."
    )
    assert _not_solved(rpm, SimpleNamespace(before=after, after=after)) == []


def test_two_designs_are_compared_at_the_speeds_that_both_have_solved():
    objective = Objective(quantity="tooth force", of="a|b")
    rpm = np.array([1000.0, 1800.0, 2000.0])
    before = SimpleNamespace(
        solved=np.array([False, True, True]),
        readings={"tooth force of a|b": [np.nan, 9.0, 7.0]},
    )
    after = SimpleNamespace(
        solved=np.array([True, False, True]),
        readings={"tooth force of a|b": [8.0, np.nan, 6.0]},
    )
    tuning = {"objective": (objective,), "penalties": ()}
    result = SimpleNamespace(before=before, after=after)
    ((_, _, readings_before, readings_after),) = _compared(tuning, result)
    assert _worst(rpm, readings_before, objective) == (7.0, 2000.0)
    assert _worst(rpm, readings_after, objective) == (6.0, 2000.0)


def hub(mean=500.0, *more):
    """A disk that a ground holds and a torque drives."""
    parts = [
        jaxhb.Disk(name="hub", inertia=0.5, damping=1.0),
        jaxhb.Ground(name="bed", disk="hub", stiffness=1000.0),
        jaxhb.Torque(
            disk="hub", mean=mean, harmonics=[(0.5, 20.0, 10.0), (1.0, 30.0, -5.0)]
        ),
        *more,
    ]
    return jaxhb.build(parts, revolutions_per_cycle=2)


def test_a_ground_is_noted_where_it_takes_more_than_one_per_cent_of_the_torque():
    cancelled = jaxhb.solve(
        hub(500.0, jaxhb.Torque(name="brake", disk="hub", mean=-500.0)), rpm=1000.0
    )
    rounded = dataclasses.replace(
        cancelled, ground_reaction=cancelled.ground_reaction + 1e-13
    )
    assert torque_notes([rounded]) == []
    assert balance_line(rounded) == "ground: bed takes 0 N m"
    loaded = jaxhb.solve(hub(500.0, jaxhb.Load(disk="hub")), rpm=1000.0)
    for share, noted in ((0.005, 0), (0.02, 1)):
        moved = dataclasses.replace(
            loaded, ground_reaction=loaded.ground_reaction + share * 500.0
        )
        assert len(torque_notes([moved])) == noted
    # The note names the speed at which the ground takes most.
    responses = [jaxhb.solve(hub(100.0), rpm=900.0), jaxhb.solve(hub(), rpm=1000.0)]
    (note,) = torque_notes(responses)
    assert "500 N m at 1000 rpm" in note


def test_without_a_ground_the_mean_angles_are_weighted_by_inertia():
    response = jaxhb.solve(jaxhb.load_scene("spur_pair"), rpm=2000.0)
    sentence = mean_angles_of(response.topology)
    assert sentence == "no ground: the inertia-weighted mean is zero"
    assert balance_line(response) == ""

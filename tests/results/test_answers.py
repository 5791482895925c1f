"""No reader takes numbers of a speed at which the equations are not solved."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

import jaxhb
from jaxhb import Disk, Load, Mesh, NotConverged, Phase, Shaft, Status, Torque, build
from jaxhb.design import (
    Measured,
    Objective,
    Parameter,
    Tolerance,
    identify,
    objectives,
    tolerance,
    worst_phase,
)
from jaxhb.results.answers import OF_MOTION, left_out, with_gaps, with_zeros
from jaxhb.results.response import FIELDS
from jaxhb.solutions.misfires import Misfires

RESONANCE = 10.0 * 30.0 / np.pi
"""Speed in rpm at which order 1 meets the natural frequency of 10 rad/s, without
damping: NEAR_SINGULAR there.
"""
RPM = np.array([40.0, 60.0, RESONANCE, 150.0])
ANSWERED = np.array([True, True, False, True])


def undamped(diameter=None, power_limit=None):
    """Outer disks of 2 kg m2 on 200 N m/rad each, which swing against each other at
    10 rad/s, and a disk of 1 kg m2 in the middle, which rests.
    """
    parts = [
        Disk(name="a", inertia=2.0),
        Disk(name="b", inertia=1.0),
        Disk(name="c", inertia=2.0),
    ]
    parts += [
        Shaft(between=ends, stiffness=200.0, diameter=diameter, power_limit=power_limit)
        for ends in (("a", "b"), ("b", "c"))
    ]
    parts += [
        Torque(name=name, disk="a", harmonics=[(1.0, 10.0, 0.0)])
        for name in ("port", "starboard")
    ]
    parts.append(Phase(name="turn", of=["port"], angle=90.0))
    return build(parts, name="undamped", revolutions_per_cycle=1)


@pytest.fixture(scope="module")
def train():
    return undamped()


@pytest.fixture(scope="module")
def response(train):
    return jaxhb.forced_response(train, rpm=RPM)


def test_the_fields_that_are_masked_are_those_of_the_motion(response):
    names = {field.name for field in dataclasses.fields(response)}
    assert set(FIELDS) <= set(OF_MOTION) <= names


def test_converged_judges_the_truncation_and_solved_the_equations_alone(response):
    assert response.status_name.tolist() == [
        "CONVERGED",
        "CONVERGED",
        "NEAR_SINGULAR",
        "CONVERGED",
    ]
    assert response.solved.tolist() == ANSWERED.tolist() == response.converged.tolist()
    truncated = dataclasses.replace(
        response, status=np.where(ANSWERED, Status.TOLERANCE_NOT_MET, response.status)
    )
    assert truncated.solved.tolist() == ANSWERED.tolist()
    assert not truncated.converged.any()
    assert np.isnan(with_gaps(truncated).torque("a|b").max).all()
    assert (
        np.isfinite(with_gaps(truncated, doubtful=True).torque("a|b").max).tolist()
        == ANSWERED.tolist()
    )


def test_gaps_and_zeros_stand_in_place_of_what_is_not_solved_and_nothing_else_changes(
    response,
):
    for masked, fill in ((with_gaps(response), np.nan), (with_zeros(response), 0.0)):
        swings = np.asarray(masked.torque("a|b").half_peak_to_peak)
        np.testing.assert_array_equal(swings[~ANSWERED], [fill])
        np.testing.assert_array_equal(
            swings[ANSWERED], response.torque("a|b").half_peak_to_peak[ANSWERED]
        )
    assert with_gaps(response[0]) is not None
    assert with_gaps(response[:2]).status.tolist() == [0, 0]


def test_speeds_left_out_are_listed_once_for_each_status():
    rpm = np.arange(100.0, 600.0, 100.0)
    status = np.array([0, 6, 6, 5, 1])
    first, second = left_out(rpm, status, "scene")
    assert first.startswith(
        "scene at 400 rpm: UNBALANCED: the mean torques do not balance"
    )
    assert second.startswith("scene at 200-300 rpm: NEAR_SINGULAR: ")


MEASURED_INERTIA = {"b.inertia": 1.3}


def measured(train):
    """Torque of a shaft with another inertia in the middle, and rubbish at the
    resonance, which that inertia does not move.
    """
    truth = jaxhb.forced_response(train.replace(MEASURED_INERTIA), rpm=RPM)
    torque = np.where(ANSWERED, truth.torque("a|b").order(1.0), 1e6)
    return Measured(
        RPM, np.ones(4), ("a|b",) * 4, ("torque",) * 4, torque, np.full(4, np.nan)
    )


@pytest.mark.slow
def test_a_fit_leaves_out_a_speed_without_an_answer_and_says_so(train):
    fit = identify(
        train,
        measured(train),
        parameters=[Parameter(name="b.inertia", low=0.5, high=2.0)],
        noise=1e-3,
    )
    assert fit.values[0] == pytest.approx(1.3, rel=1e-6)
    assert fit.misfit < 1e-6
    assert not fit.open
    assert fit.kept.tolist() == ANSWERED.tolist()
    assert fit.explained == pytest.approx(1.0)
    (sentence,) = fit.left_out
    assert sentence.startswith("undamped at 95.493 rpm: NEAR_SINGULAR")


@pytest.mark.slow
def test_a_fit_without_enough_answers_is_refused_with_the_reason(train):
    unbalanced = train.replace({"port.mean": 1.0})
    with pytest.raises(
        NotConverged,
        match=r"^0 of the measured numbers .* for 1 parameters.*: UNBALANCED",
    ):
        identify(
            unbalanced,
            measured(train),
            parameters=[Parameter(name="b.inertia", low=0.5, high=2.0)],
        )


@pytest.mark.slow
def test_the_worst_phase_is_judged_at_the_speeds_with_an_answer(train):
    torque = [Objective(quantity="shaft torque", of="a|b")]
    everywhere = worst_phase(train, "turn", rpm=RPM, of=torque)
    at_answers = worst_phase(train, "turn", rpm=RPM[ANSWERED], of=torque)
    for name in ("nominal", "worst", "best"):
        values = getattr(everywhere, name)
        assert np.isnan(values[~ANSWERED]).all()
        np.testing.assert_allclose(
            values[ANSWERED], getattr(at_answers, name), rtol=1e-12
        )
    assert "NEAR_SINGULAR" in everywhere.left_out[0]
    assert not at_answers.left_out


@pytest.mark.slow
def test_tolerances_judge_the_speeds_with_an_answer(train):
    judged = tolerance(
        train,
        rpm=RPM[1:],
        of=[Objective(quantity="shaft torque", of="a|b")],
        tolerances=[Tolerance(name="b.inertia", low=0.9, high=1.1)],
    )
    answered = ANSWERED[1:]
    assert np.isfinite(judged.worst[answered]).all()
    assert np.isnan(judged.nominal[~answered]).all()
    assert np.isnan(judged.worst[~answered]).all()
    assert judged.no_bound[1, 0] == "the nominal scene was not solved"


def test_quantities_are_not_chosen_where_no_speed_has_an_answer(train):
    with pytest.raises(NotConverged, match=r"undamped at 95.493 rpm: NEAR_SINGULAR"):
        tolerance(
            train,
            rpm=[RESONANCE],
            tolerances=[Tolerance(name="b.inertia", low=0.9, high=1.1)],
        )


def test_a_steady_state_is_known_beside_a_speed_without_an_answer(train):
    assert jaxhb.steady_state(train, rpm=RPM).kind.tolist() == [
        "periodic",
        "periodic",
        "unknown",
        "periodic",
    ]


def test_objectives_count_no_speed_without_an_answer(response):
    values = objectives.shaft_torque(response, "a", "b")
    assert (np.asarray(values) > 0).tolist() == ANSWERED.tolist()
    largest, count = objectives.worst(values, response, width=1e-9)
    assert count == 3
    assert float(largest) == pytest.approx(float(np.max(values)))


def swing(response):
    """Half peak-to-peak torque of the first shaft."""
    return response.torque("a|b").half_peak_to_peak


def test_the_worst_misfire_is_judged_at_speeds_with_an_answer(response):
    misfires = Misfires(response, {"one": response})
    worst = misfires.worst(swing)
    assert worst.rpm == 60.0
    assert worst.firing == worst.value
    unanswered = dataclasses.replace(
        response, status=np.where(RPM == 60.0, Status.STALLED, response.status)
    )
    without_answer = Misfires(unanswered, {"one": response}).worst(swing)
    assert np.isnan(without_answer.firing)


def test_stresses_and_heat_are_nan_without_an_answer():
    strength = jaxhb.strength(
        jaxhb.forced_response(undamped(diameter=0.01, power_limit=100.0), rpm=RPM)
    )
    for values in (strength.stresses["a|b"].stress, strength.heat["a|b"].power):
        assert np.isfinite(values).tolist() == ANSWERED.tolist()


@pytest.mark.parametrize(
    "reader", [jaxhb.stability, jaxhb.certify, jaxhb.shooting_correction, jaxhb.check]
)
def test_readers_of_one_motion_refuse_a_response_that_solves_nothing(reader):
    stalled = dataclasses.replace(
        jaxhb.solve(jaxhb.load_scene("spur_pair"), rpm=3000.0), status=Status.STALLED
    )
    with pytest.raises(
        NotConverged, match=r"spur_pair at 3000 rpm.*STALLED.*found no step"
    ):
        reader(stalled)
    with pytest.raises(NotConverged, match="STALLED"):
        jaxhb.follow(stalled.train, "rpm", start=3000.0, to=3500.0, begin=stalled)


def test_data_sets_and_tables_have_no_number_without_an_answer(response):
    pytest.importorskip("xarray")
    swing = response.to_xarray().torque_half_peak_to_peak.sel(shaft="a|b")
    assert np.isfinite(swing.values).tolist() == ANSWERED.tolist()
    assert "<td>a|b</td>" not in response[2]._repr_html_()
    assert "<td>a|b</td>" in response[0]._repr_html_()


def gears(balanced=True):
    """Two gears with backlash, without damping: order 1 makes the teeth lift off."""
    parts = [
        Disk(name="a", inertia=0.01, radius=0.05),
        Disk(name="b", inertia=0.01, radius=0.05),
        Mesh(between=("a", "b"), stiffness=1e6, backlash=1e-4),
        Torque(
            name="drive", disk="a", mean=100.0 * balanced, harmonics=[(1.0, 30.0, 0.0)]
        ),
    ]
    if balanced:
        parts.append(Load(disk="b"))
    train = build(parts, name="gears", reference="a", revolutions_per_cycle=1)
    return train.replace({"drive.mean": 100.0})


@pytest.mark.slow
def test_lift_off_leaves_out_a_resonance_and_refuses_a_train_that_does_not_balance():
    # The twist has k r^2 (1/J + 1/J), which is 707 rad/s. The teeth part where the
    # vibration exceeds the mean: half of the amplitude over 1 - s^2 does so at
    # 1 - s^2 = +-0.15.
    unit = np.sqrt(1e6 * 0.05**2 * 200.0) * 30 / np.pi
    rpm = unit * np.array([0.5, 0.97, 1.0, 1.03, 1.5])
    limits = jaxhb.lift_off(gears(), rpm=rpm)
    np.testing.assert_allclose(
        limits.rpm, unit * np.sqrt([1 - 0.15, 1 + 0.15]), rtol=1e-6
    )
    assert len(limits.left_out) == 1
    assert "NEAR_SINGULAR" in limits.left_out[0]
    with pytest.raises(
        NotConverged,
        match=r"two speeds with an answer.*UNBALANCED: the mean torques do not balance",
    ):
        jaxhb.lift_off(gears(balanced=False), rpm=rpm)


def test_only_the_reader_of_answers_and_the_solvers_compare_statuses():
    # A second place that decides by a status which numbers may be read would follow a
    # rule that differs in time.
    solvers = {
        f"solutions/{name}.py" for name in ("orbits", "starts", "speeds", "sweeping")
    }
    deciding = solvers | {"results/answers.py", "results/response.py"}
    root = Path(jaxhb.__file__).parent
    compared = re.compile(r"(<=|>|==|!=) *Status\.(CONVERGED|TOLERANCE_NOT_MET)")
    for path in root.rglob("*.py"):
        place = path.relative_to(root).as_posix()
        if place not in deciding and not place.startswith("balance/"):
            assert not compared.search(path.read_text(encoding="utf-8")), place

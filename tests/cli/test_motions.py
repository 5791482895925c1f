"""What the command line tells of every kind of motion: the same as Python, in words,
tables, files and pictures.
"""

import numpy as np
import pytest

import jaxhb
from jaxhb.report.compute import Asked, answer_one, answer_speeds
from jaxhb.report.figures import cycle, speeds
from jaxhb.report.figures.cycle import plot_cycle
from jaxhb.report.figures.figure import DIGITS, OTHER_RECORDS
from jaxhb.report.figures.speeds import plot_sweep
from jaxhb.report.quantities import gear_torques, separation
from jaxhb.report.text.sweep_tables import sweep_text
from jaxhb.results.status import NewtonOnSweeps, Sweeps

MESH = "gear a|gear b"
DAMPING = f"{MESH}.damping"
PERIODIC = "two cycles"
IRREGULAR = "none"
SETTINGS = {
    PERIODIC: {DAMPING: 106.1},
    IRREGULAR: {"drive.mean": 12.5, "brake.mean": -12.5},
}
"""Tooth damping in N s/m and mean torques in N m with which the pair has two cycles as
period at 6000 rpm, or none.
"""


@pytest.fixture(scope="module")
def answers():
    """What the pair does with little damping or load, from Python."""
    trains = {
        period: jaxhb.load_scene("spur_pair").replace(changes)
        for period, changes in SETTINGS.items()
    }
    return {
        period: answer_one(train, 6000.0, Asked()) for period, train in trains.items()
    }


@pytest.fixture
def figures_of(monkeypatch):
    """Specifications of the figures of a picture."""

    def made(plot, given):
        with monkeypatch.context() as patch:
            for module in (cycle, speeds):
                patch.setattr(module, "drawn", lambda *figures, title: figures)
            return plot(given)

    return made


def call(period):
    changed = " ".join(
        f"--set '{name}={value}'" for name, value in SETTINGS[period].items()
    )
    return f"solve spur_pair --rpm 6000 {changed} --certify", "json", "plot"


@pytest.mark.slow
@pytest.mark.parametrize("period", SETTINGS)
def test_the_kind_and_the_numbers_are_those_of_the_motion(period, answers, told):
    called = told(*call(period))
    state = answers[period].state
    record = called.json
    motion = record["motion"]
    mesh = record["meshes"][MESH]
    force = state.force(MESH)
    contact = state.mesh(MESH)
    assert called.status == 0 and called.is_drawn
    assert (motion["kind"], motion["period"], motion["cycles"]) == (
        state.kind,
        state.period,
        state.cycles,
    )
    assert (mesh["max"], mesh["min"], mesh["rms"]) == (
        float(force.max),
        float(force.min),
        float(force.rms),
    )
    assert motion["per_cycle"][MESH]["max"] == force.per_cycle.max.tolist()
    assert (mesh["impacts_per_cycle"], mesh["hardest_impact"]) == (
        contact.impacts_per_cycle,
        contact.hardest_impact,
    )
    assert mesh["separated_fraction"] == contact.separated_fraction
    swing = float(state.gear_torque("gear a").half_peak_to_peak)
    assert record["gears"]["gear a"]["half_peak_to_peak"] == swing
    assert record["disks"]["gear b"]["half_peak_to_peak"] == float(
        state.disk("gear b").half_peak_to_peak
    )
    assert (
        f"at 6000 rpm: gear a|gear b is apart {100 * contact.separated_fraction:.0f} %"
        " of the time" in called.out
    )


@pytest.mark.slow
def test_a_motion_of_two_cycles_has_impacts_over_both_and_a_multiplier(answers, told):
    called = told(*call(PERIODIC))
    found = jaxhb.stability(answers[PERIODIC].response)
    motion = called.json["motion"]
    mesh = called.json["meshes"][MESH]
    assert (motion["stable"], motion["multiplier"]) == (True, found.largest)
    assert called.json["converged"] and called.json["status"] == "CONVERGED"
    # One impact in two cycles of 11.25 deg, in the second of them.
    assert [11.25 < hit["theta_deg"] < 22.5 for hit in mesh["impacts"]] == [True]
    assert mesh["impacts_per_cycle"] == 0.5
    assert mesh["amplitudes"][0][0] == 16.0  # half the tooth frequency
    assert "(of 0.0625 revolutions); stable" in called.out


@pytest.mark.slow
def test_a_motion_that_never_repeats_has_a_distribution_and_no_solution(answers, told):
    called = told(*call(IRREGULAR))
    record = called.json
    said = called.out
    keys = (
        "converged",
        "status",
        "harmonics",
        "residual",
        "truncation_error",
        "power_defect",
        "path",
    )
    assert [record[key] for key in keys] == [None] * 7
    assert [record["motion"][key] for key in ("stable", "multiplier")] == [None, None]
    assert record["meshes"][MESH]["impacts"] is None
    assert all(phase is None for _, _, phase in record["meshes"][MESH]["amplitudes"])
    assert (
        "never repeats" in said
        and "256 recorded" in said
        and "(two standard deviations" in said
    )
    force = answers[IRREGULAR].state.force(MESH)
    per_cycle = [*force.per_cycle.peak / 1e3, force.spread.peak / 1e3]
    assert record["motion"]["recorded_cycles"] == 256
    assert record["motion"]["spread"][MESH] == force.spread._asdict()
    line = said[said.index("Largest tooth force of a cycle") :].splitlines()[3]
    assert line.split()[-4:] == [f"{value:.3f}" for value in per_cycle]
    why = record["certificate"]["reason"]
    assert (
        record["certificate"]["holds"] is False
        and "does not repeat" in why
        and "--orbit" in why
    )
    assert f"Computed bound: none. {why}" in said


def test_an_orbit_is_the_solution_of_solve_and_the_word_for_its_stability(told):
    called = told("solve spur_pair --rpm 5000 --orbit", "json")
    response = jaxhb.solve_speeds(jaxhb.load_scene("spur_pair"), rpm=[5000.0])[0]
    found = jaxhb.stability(response)
    motion = called.json["motion"]
    assert called.json["meshes"][MESH]["max"] == float(response.force(MESH).max)
    assert motion["orbit"] and motion["kind"] == "periodic"
    assert (motion["stable"], motion["multiplier"]) == (found.stable, found.largest)
    assert (
        f"orbit: periodic, period one cycle; {'stable' if found.stable else 'UNSTABLE'}"
        in called.out
    )


def test_a_sweep_both_ways_tells_hysteresis(told):
    """At 4500 rpm the pair hammers when it comes from above and stays in contact from
    below (published branches).
    """
    called = told(
        "sweep spur_pair --rpm 4500,5000 --direction both", "json", "csv", "plot"
    )
    said = called.out
    record = called.json
    assert said.startswith(
        "Upwards: Teeth separate at 1 of 2 speeds between 4500 and 5000 rpm: 5000 rpm."
    )
    assert said.count(": Teeth separate at ") == 2 and "downwards differ" in said
    assert record["direction"] == "both" and "responses" not in record
    kinds = {
        way: [row["motion"]["kind"] for row in record[way]] for way in ("up", "down")
    }
    assert kinds == {"up": ["contact", "periodic"], "down": ["periodic", "periodic"]}
    rpm = "4500.0", "5000.0"
    listed = [
        (way, *one) for way, own in kinds.items() for one in zip(rpm, own, strict=True)
    ]
    assert [
        (row["direction"], row["rpm"], row["motion"]) for row in called.rows
    ] == listed
    assert called.is_drawn


@pytest.mark.slow
def test_a_periodic_solution_has_the_same_bits_alone_and_in_a_sweep():
    """One speed in contact, one with an unknown on a flank, two that hammer: of
    different plans.
    """
    train = jaxhb.load_scene("spur_pair")
    asked = Asked(orbit=True)
    rpm = [2000.0, 7950.0, 5000.0, 5600.0]
    sweep = answer_speeds(train, rpm, asked)["orbit"]
    assert [answer.state.response.harmonics for answer in sweep] == [16, 16, 128, 128]
    by_newton = sweep[:2]
    by_sweeps = sweep[2:]
    assert [answer.state.response.path[-1].active_meshes for answer in by_newton] == [
        0,
        1,
    ]
    assert all(
        isinstance(answer.state.response.path[-1], Sweeps | NewtonOnSweeps)
        for answer in by_sweeps
    )
    for answer in sweep:
        alone = answer_one(train, answer.rpm, asked).state.response
        np.testing.assert_array_equal(
            answer.state.response.elastic_forces, alone.elastic_forces
        )


@pytest.mark.slow
def test_a_sweep_of_orbits_says_which_are_unstable(figures_of):
    """A lightly loaded pair, which does something else at the second speed."""
    train = jaxhb.load_scene("spur_pair").replace(
        {"drive.mean": 12.5, "brake.mean": -12.5}
    )
    sweep = answer_speeds(train, [4000.0, 6000.0], Asked(orbit=True))
    for answer, stable in zip(sweep["orbit"], (True, False), strict=True):
        truth = jaxhb.stability(jaxhb.solve(train, rpm=answer.rpm))
        assert answer.stable == truth.stable == stable
        # The cheap multiplier of a sweep is good to 10 % (its docstring).
        assert answer.stability.largest == pytest.approx(truth.largest, rel=0.1)
    assert (
        "UNSTABLE, the train does not run in these motions, at 6000 rpm."
        in sweep_text(sweep)
    )
    assert figures_of(plot_sweep, sweep)[0].traces[0]["marker"]["symbol"] == [
        "square",
        "triangle-down",
    ]
    assert answer_one(train, 6000.0, Asked()).state.kind != "periodic"


@pytest.mark.slow
def test_the_picture_of_an_irregular_motion_shows_the_distribution_over_the_cycles(
    answers, figures_of
):
    answer = answers[IRREGULAR]
    digits = 0.5 * 10 ** (1 - DIGITS)
    extremes, below = figures_of(plot_cycle, answer)
    torque = answer.gear_torque("gear a")
    force = answer.force(MESH)
    np.testing.assert_allclose(extremes.traces[0]["y"], torque.highest, rtol=digits)
    shares = [
        trace["y"][::3]
        for trace in extremes.traces
        if trace["name"] == "5, 50, 95 % of the cycles"
    ]
    wanted = [np.ravel(torque.per_cycle[:2]), np.ravel(force.per_cycle[:2]) / 1e3]
    np.testing.assert_allclose(shares, wanted, rtol=digits)
    assert (
        below.traces[0]["x"][-1] == pytest.approx(force.peak / 1e3, rel=digits)
        and below.traces[0]["y"][-1] == 100
    )
    (axes,) = [
        one
        for one in plot_cycle(answer).axes
        if one.get_ylabel() == "cycles below it, %"
    ]
    assert axes.get_lines()[0].get_drawstyle() == "steps-post"
    low, _, high = force.per_cycle.peak / 1e3
    traces = figures_of(plot_sweep, {"up": [answer]})[0].traces
    (bars,) = [one for one in traces if one["name"] == "5 to 95 % of the cycles"]
    assert bars["x"] == [6000.0, 6000.0, None] and bars["y"][:2] == pytest.approx(
        [low, high], rel=digits
    )


@pytest.mark.slow
def test_pictures_of_an_irregular_motion_show_how_far_other_records_may_lie(
    answers, figures_of
):
    """Bars with feet, 2 standard deviations up and down, at the largest force and at
    the extremes of a record.
    """
    answer = answers[IRREGULAR]
    digits = {"rtol": 10.0 ** (1 - DIGITS)}
    force = answer.force(MESH)
    torque = answer.gear_torque("gear a")
    assert force.spread.peak > 0.01 * force.peak
    traces = figures_of(plot_sweep, {"up": [answer]})[0].traces
    (bar,) = [trace for trace in traces if trace["name"] == OTHER_RECORDS]
    ends = np.array([bar["y"][4], bar["y"][3]]) * 1e3
    np.testing.assert_allclose(
        ends, force.peak + np.array([-1, 1]) * force.spread.peak, **digits
    )
    assert bar["x"][3:5] == [6000.0, 6000.0] and bar["x"][0] < 6000.0 < bar["x"][1]
    extremes, _ = figures_of(plot_cycle, answer)
    bars = [trace for trace in extremes.traces if trace["name"] == OTHER_RECORDS]
    assert [trace["showlegend"] for trace in bars] == [True, False]
    for signal, factor, trace in zip((torque, force), (1.0, 1e3), bars, strict=True):
        upper, lower = np.reshape(np.array(trace["y"], float) * factor, (2, 9))
        np.testing.assert_allclose(
            upper[[4, 3]], signal.max + np.array([-1, 1]) * signal.spread.max, **digits
        )
        np.testing.assert_allclose(
            lower[[4, 3]], signal.min + np.array([-1, 1]) * signal.spread.min, **digits
        )
        assert trace["x"][3] == 1 + np.argmax(signal.highest) and trace["x"][
            12
        ] == 1 + np.argmin(signal.lowest)
    gears = gear_torques(answer.train)
    assert gears.spread(answer, "gear a") == (torque.spread.max + torque.spread.min) / 2
    assert separation(answer.train).spread(answer, MESH) == 0.0
    periodic = figures_of(plot_sweep, {"up": [answers[PERIODIC]]})[0].traces
    assert OTHER_RECORDS not in [trace["name"] for trace in periodic]


def test_what_is_not_known_exits_1_with_the_reason_and_no_numbers(told):
    called = told("sweep spur_pair --rpm 2000,5000 --set drive.mean=70", "csv", "plot")
    assert called.status == 1
    assert called.out.startswith(
        "No answer at any of 2 speeds from 2000 to 5000 rpm.\nThe motion is unknown at"
        " 2000-"
    )
    assert [line.split()[1:7] for line in called.out.splitlines()[4:6]] == [
        ["-"] * 6
    ] * 2
    (line,) = called.err.splitlines()  # of both speeds, once
    assert line.startswith(
        "2000, 5000 rpm: the kind of motion is unknown: the mean torques do not balance"
    )
    assert all(row[f"{MESH} max N"] == "" for row in called.rows)
    assert "If --set unbalances a scene" in told("solve --help").words


def test_a_sweep_that_is_kept_goes_on_and_a_folder_of_another_sweep_is_refused(
    tmp_path, run
):
    line = f"sweep spur_pair --rpm 4500,5000 --out {tmp_path / 'kept'}"
    first = run(f"{line} --chunk 1", "json")
    written = first.path("json").read_bytes()
    assert first.json["complete"] and len(list((tmp_path / "kept").glob("*.npz"))) == 2
    assert (
        run(f"{line} --chunk 1", "json") == first
        and first.path("json").read_bytes() == written
    )
    called = run(f"{line} --chunk 1 --orbit")  # others: tests/steady/test_checkpoint.py
    assert (
        called.status == 2
        and "answers steady states there, periodic solutions now" in called.err
    )

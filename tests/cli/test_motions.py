"""What the command line tells of every kind of motion: the same as Python, in words,
tables, files and pictures.
"""

import numpy as np
import pytest
from printed import HAMMERING

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
LIGHT = {"drive.mean": 12.5, "brake.mean": -12.5}
SETTINGS = {PERIODIC: {DAMPING: 106.1}, IRREGULAR: LIGHT}
"""Tooth damping in N s/m and mean torques in N m with which the pair has two cycles as
period at 6000 rpm, or none.
"""
ROUNDED = 10.0 ** (1 - DIGITS)
"""Relative unit of the last digit of numbers in figures."""


@pytest.fixture(scope="module")
def answers():
    """Answers for the pair with little damping or load, from Python."""
    train = jaxhb.load_scene("spur_pair")
    return {
        period: answer_one(train.replace(changes), 6000.0, Asked())
        for period, changes in SETTINGS.items()
    }


@pytest.fixture
def figures_of(monkeypatch):
    """Specifications of the figures of a picture."""

    def specify(plot, argument):
        with monkeypatch.context() as patch:
            for module in (cycle, speeds):
                patch.setattr(module, "drawn", lambda *figures, title: figures)
            return plot(argument)

    return specify


@pytest.fixture
def completed_of(run_once):
    """The command on the pair with a period."""

    def completed(period):
        changes = " ".join(
            f"--set '{name}={value}'" for name, value in SETTINGS[period].items()
        )
        line = f"solve spur_pair --rpm 6000 {changes} --certify"
        return run_once(line, "json", "plot")

    return completed


@pytest.mark.slow
@pytest.mark.parametrize("period", SETTINGS)
def test_the_kind_and_the_numbers_are_those_of_the_motion(
    period, answers, completed_of
):
    completed = completed_of(period)
    state = answers[period].state
    record = completed.json
    motion = record["motion"]
    mesh = record["meshes"][MESH]
    force = state.force(MESH)
    contact = state.mesh(MESH)
    assert motion == motion | {
        "kind": state.kind,
        "period": state.period,
        "cycles": state.cycles,
    }
    assert motion["per_cycle"][MESH]["max"] == force.per_cycle.max.tolist()
    assert mesh == mesh | {
        "max": float(force.max),
        "min": float(force.min),
        "rms": float(force.rms),
        "impacts_per_cycle": contact.impacts_per_cycle,
        "hardest_impact": contact.hardest_impact,
        "separated_fraction": contact.separated_fraction,
    }
    swing = float(state.gear_torque("gear a").half_peak_to_peak)
    assert record["gears"]["gear a"]["half_peak_to_peak"] == swing
    swing = float(state.disk("gear b").half_peak_to_peak)
    assert record["disks"]["gear b"]["half_peak_to_peak"] == swing
    share = f"{100 * contact.separated_fraction:.0f} % of the time"
    assert f"at 6000 rpm: gear a|gear b is separated {share}" in completed.out


@pytest.mark.slow
def test_a_motion_of_two_cycles_has_impacts_over_both_and_a_multiplier(
    answers, completed_of
):
    completed = completed_of(PERIODIC)
    completed.check_printed("solve_two_cycles", HAMMERING)
    record = completed.json
    assert record == record | {"converged": True, "status": "CONVERGED"}
    motion = record["motion"]
    largest = jaxhb.stability(answers[PERIODIC].response).largest
    assert motion == motion | {"stable": True, "multiplier": largest}
    # One impact in two cycles of 11.25 deg, in the second of them.
    mesh = record["meshes"][MESH]
    (impact,) = mesh["impacts"]
    assert 11.25 < impact["theta_deg"] < 22.5
    assert mesh["impacts_per_cycle"] == 0.5
    assert mesh["amplitudes"][0][0] == 16.0  # half the tooth frequency


@pytest.mark.slow
def test_a_motion_that_never_repeats_has_a_distribution_and_no_solution(
    answers, completed_of
):
    completed = completed_of(IRREGULAR)
    record = completed.json
    assert record == record | {
        "converged": None,
        "status": None,
        "harmonics": None,
        "residual": None,
        "truncation_error": None,
        "power_defect": None,
        "path": None,
    }
    force = answers[IRREGULAR].state.force(MESH)
    motion = record["motion"]
    assert motion == motion | {
        "stable": None,
        "multiplier": None,
        "recorded_cycles": 256,
        "spread": {MESH: force.spread._asdict()},
    }
    mesh = record["meshes"][MESH]
    assert mesh["impacts"] is None
    assert all(phase is None for _, _, phase in mesh["amplitudes"])
    for words in ("never repeats", "256 recorded", "(two standard deviations"):
        assert words in completed.out
    beginning = completed.out.index("Largest tooth force of a cycle")
    cells = completed.out[beginning:].splitlines()[3].split()
    peaks = [*force.per_cycle.peak / 1e3, force.spread.peak / 1e3]
    assert cells[-4:] == [f"{value:.3f}" for value in peaks]
    certificate = record["certificate"]
    reason = certificate["reason"]
    assert certificate["holds"] is False
    assert "does not repeat" in reason
    assert "--orbit" in reason
    assert f"Computed bound: none. {reason}" in completed.out


def test_an_orbit_is_the_solution_of_solve_and_the_word_for_its_stability(run_once):
    completed = run_once("solve spur_pair --rpm 5000 --orbit", "json")
    response = jaxhb.solve_speeds(jaxhb.load_scene("spur_pair"), rpm=[5000.0])[0]
    stability = jaxhb.stability(response)
    record = completed.json
    assert record["meshes"][MESH]["max"] == float(response.force(MESH).max)
    motion = record["motion"]
    assert motion == motion | {
        "orbit": True,
        "kind": "periodic",
        "stable": stability.stable,
        "multiplier": stability.largest,
    }
    word = "stable" if stability.stable else "UNSTABLE"
    assert f"orbit: periodic, period one cycle; {word}" in completed.out


def test_a_sweep_both_ways_tells_hysteresis(run_once):
    """At 4500 rpm the pair hammers when it comes from above and stays in contact from
    below (published branches).
    """
    line = "sweep spur_pair --rpm 4500,5000 --direction both"
    completed = run_once(line, "json", "csv", "plot")
    completed.check_printed("sweep_both_ways", HAMMERING)
    record = completed.json
    assert record["direction"] == "both"
    assert "responses" not in record
    kinds = {
        way: [row["motion"]["kind"] for row in record[way]] for way in ("up", "down")
    }
    assert kinds == {"up": ["contact", "periodic"], "down": ["periodic", "periodic"]}
    rows = [(row["direction"], row["rpm"], row["motion"]) for row in completed.rows]
    assert rows == [
        ("up", "4500.0", "contact"),
        ("up", "5000.0", "periodic"),
        ("down", "4500.0", "periodic"),
        ("down", "5000.0", "periodic"),
    ]


@pytest.mark.slow
def test_a_periodic_solution_has_the_same_bits_alone_and_in_a_sweep():
    """One speed in contact, one with an unknown on a flank, two that hammer: of
    different plans.
    """
    train = jaxhb.load_scene("spur_pair")
    asked_for = Asked(orbit=True)
    sweep = answer_speeds(train, [2000.0, 7950.0, 5000.0, 5600.0], asked_for)["orbit"]
    responses = [answer.state.response for answer in sweep]
    assert [response.harmonics for response in responses] == [16, 16, 128, 128]
    last_steps = [response.path[-1] for response in responses]
    assert [step.active_meshes for step in last_steps[:2]] == [0, 1]
    for step in last_steps[2:]:
        assert isinstance(step, Sweeps | NewtonOnSweeps)
    for answer, response in zip(sweep, responses, strict=True):
        alone = answer_one(train, answer.rpm, asked_for).state.response
        np.testing.assert_array_equal(response.elastic_forces, alone.elastic_forces)


@pytest.mark.slow
def test_a_sweep_of_orbits_says_which_are_unstable(figures_of):
    """A lightly loaded pair, which does something else at the second speed."""
    train = jaxhb.load_scene("spur_pair").replace(LIGHT)
    sweep = answer_speeds(train, [4000.0, 6000.0], Asked(orbit=True))
    for answer, stable in zip(sweep["orbit"], (True, False), strict=True):
        truth = jaxhb.stability(jaxhb.solve(train, rpm=answer.rpm))
        assert answer.stable == truth.stable == stable
        # The cheap multiplier of a sweep is good to 10 % (its docstring).
        assert answer.stability.largest == pytest.approx(truth.largest, rel=0.1)
    sentence = "UNSTABLE, the train does not run in these motions, at 6000 rpm."
    assert sentence in sweep_text(sweep)
    markers = figures_of(plot_sweep, sweep)[0].traces[0]["marker"]
    assert markers["symbol"] == ["square", "triangle-down"]
    assert answer_one(train, 6000.0, Asked()).state.kind != "periodic"


@pytest.mark.slow
def test_the_picture_of_an_irregular_motion_shows_the_distribution_over_the_cycles(
    answers, figures_of
):
    answer = answers[IRREGULAR]
    extremes, below = figures_of(plot_cycle, answer)
    torque = answer.gear_torque("gear a")
    force = answer.force(MESH)
    highest = extremes.traces[0]["y"]
    np.testing.assert_allclose(highest, torque.highest, rtol=0.5 * ROUNDED)
    shares = [
        trace["y"][::3]
        for trace in extremes.traces
        if trace["name"] == "5, 50, 95 % of the cycles"
    ]
    expected = [np.ravel(torque.per_cycle[:2]), np.ravel(force.per_cycle[:2]) / 1e3]
    np.testing.assert_allclose(shares, expected, rtol=0.5 * ROUNDED)
    counted = below.traces[0]
    assert counted["x"][-1] == pytest.approx(force.peak / 1e3, rel=0.5 * ROUNDED)
    assert counted["y"][-1] == 100
    (axes,) = [
        panel
        for panel in plot_cycle(answer).axes
        if panel.get_ylabel() == "cycles below it, %"
    ]
    assert axes.get_lines()[0].get_drawstyle() == "steps-post"


@pytest.mark.slow
def test_the_picture_of_a_sweep_has_a_bar_over_the_cycles_of_an_irregular_motion(
    answers, figures_of
):
    answer = answers[IRREGULAR]
    low, _, high = answer.force(MESH).per_cycle.peak / 1e3
    traces = figures_of(plot_sweep, {"up": [answer]})[0].traces
    (bars,) = [trace for trace in traces if trace["name"] == "5 to 95 % of the cycles"]
    assert bars["x"] == [6000.0, 6000.0, None]
    assert bars["y"][:2] == pytest.approx([low, high], rel=0.5 * ROUNDED)


@pytest.mark.slow
def test_the_picture_of_a_sweep_shows_how_far_the_peak_of_other_records_may_lie(
    answers, figures_of
):
    """Bars with feet, 2 standard deviations up and down, at the largest force."""
    force = answers[IRREGULAR].force(MESH)
    assert force.spread.peak > 0.01 * force.peak
    traces = figures_of(plot_sweep, {"up": [answers[IRREGULAR]]})[0].traces
    (bar,) = [trace for trace in traces if trace["name"] == OTHER_RECORDS]
    ends = np.array([bar["y"][4], bar["y"][3]]) * 1e3
    expected = force.peak + np.array([-1, 1]) * force.spread.peak
    np.testing.assert_allclose(ends, expected, rtol=ROUNDED)
    assert bar["x"][3:5] == [6000.0, 6000.0]
    assert bar["x"][0] < 6000.0 < bar["x"][1]
    periodic = figures_of(plot_sweep, {"up": [answers[PERIODIC]]})[0].traces
    assert OTHER_RECORDS not in [trace["name"] for trace in periodic]


@pytest.mark.slow
def test_the_picture_of_a_cycle_shows_how_far_extremes_of_other_records_may_lie(
    answers, figures_of
):
    answer = answers[IRREGULAR]
    force = answer.force(MESH)
    torque = answer.gear_torque("gear a")
    extremes, _ = figures_of(plot_cycle, answer)
    bars = [trace for trace in extremes.traces if trace["name"] == OTHER_RECORDS]
    assert [trace["showlegend"] for trace in bars] == [True, False]
    both = np.array([-1, 1])
    for signal, factor, trace in zip((torque, force), (1.0, 1e3), bars, strict=True):
        upper, lower = np.reshape(np.array(trace["y"], float) * factor, (2, 9))
        expected = signal.max + both * signal.spread.max
        np.testing.assert_allclose(upper[[4, 3]], expected, rtol=ROUNDED)
        expected = signal.min + both * signal.spread.min
        np.testing.assert_allclose(lower[[4, 3]], expected, rtol=ROUNDED)
        assert trace["x"][3] == 1 + np.argmax(signal.highest)
        assert trace["x"][12] == 1 + np.argmin(signal.lowest)
    gears = gear_torques(answer.train)
    half = (torque.spread.max + torque.spread.min) / 2
    assert gears.spread(answer, "gear a") == half
    assert separation(answer.train).spread(answer, MESH) == 0.0


def test_what_is_not_known_exits_1_with_the_reason_and_no_numbers(run_once):
    line = "sweep spur_pair --rpm 2000,5000 --set drive.mean=70"
    completed = run_once(line, "csv", "plot", status=1)
    completed.check_printed("sweep_unknown")
    assert [row[f"{MESH} max N"] for row in completed.rows] == ["", ""]
    assert "If --set unbalances a scene" in run_once("solve --help").words


def test_a_sweep_that_is_kept_goes_on_and_a_folder_of_another_sweep_is_refused(
    tmp_path, run
):
    line = f"sweep spur_pair --rpm 4500,5000 --out {tmp_path / 'kept'} --chunk 1"
    first = run(line, "json")
    written = first.path("json").read_bytes()
    assert first.json["complete"]
    assert len(list((tmp_path / "kept").glob("*.npz"))) == 2
    assert run(line, "json") == first
    assert first.path("json").read_bytes() == written
    completed = run(
        f"{line} --orbit", status=2
    )  # others: tests/steady/test_checkpoint.py
    assert "answers steady states there, periodic solutions now" in completed.err

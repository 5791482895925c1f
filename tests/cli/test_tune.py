"""``jaxhb tune``: the tuned scene loads, the files say what was done, Ctrl-C leaves the
best so far, bad tables.
"""

import difflib
import tomllib

import numpy as np
import pytest
from reference_data import reference, text_of

import jaxhb
from jaxhb.cli.progress import Progress
from jaxhb.design import Objective, Parameter
from jaxhb.design.table import read_table
from jaxhb.report.compute import check_designs
from jaxhb.report.figures.cycle import plot_tuning
from jaxhb.report.figures.figure import DIGITS
from jaxhb.report.text.tuned import check_text
from jaxhb.scene.writer import changed_scene

TABLE = "\n" + text_of("diesel_tune.toml")
SHAFT = "cyl6|flywheel"
TORQUE = f"shaft torque of {SHAFT}"


@pytest.fixture
def scene(tmp_path):
    """The diesel with a [tune] table, in a folder of its own."""
    text, beside = changed_scene("six_cylinder_diesel", {})
    folder = tmp_path / "scene"
    folder.mkdir()
    for name, path in beside.items():
        (folder / name).write_bytes(path.read_bytes())
    (folder / "diesel.toml").write_text(text + TABLE, encoding="utf-8")
    return folder / "diesel.toml"


@pytest.fixture
def better(tmp_path):
    """File of the tuned scene, beside the folder of the scene."""
    return tmp_path / "better.toml"


@pytest.fixture
def tune(scene, better, run):
    """Runs a tuning."""
    return lambda options="", *files, status=0: run(
        f"tune {scene} --output {better} {options}", "json", *files, status=status
    )


def replace_in(path, old, new):
    """Replace words of a file."""
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace(old, new), encoding="utf-8")


def swings_of(train, rpm):
    """Half peak-to-peak torques of the shaft at the speeds."""
    return jaxhb.solve_speeds(train, rpm=np.array(rpm)).torque(SHAFT).half_peak_to_peak


@pytest.mark.slow
def test_the_tuned_scene_loads_and_the_files_say_what_was_done(scene, better, tune):
    completed = tune("--set cyl2.damping=3", "plot")
    record = completed.json
    before = jaxhb.load_scene(scene)
    after = jaxhb.load_scene(better)
    assert after.value("cyl2.damping") == 3.0
    for name, parameter in record["parameters"].items():
        assert parameter["before"] == pytest.approx(before.value(name), rel=1e-12)
        assert parameter["after"] == after.value(name) != parameter["before"]
    assert record["parameters"]["cyl1.damping"]["unit"] == "N m s/rad"
    swing = record["readings"][TORQUE]
    truth = swings_of(after, record["rpm"])
    np.testing.assert_allclose(swing["after"], truth, rtol=1e-9)
    assert swing["unit"] == "N m"
    # Between the speeds lie resonances, which the tuning finds and makes smaller.
    designs = {"before": before.replace({"cyl2.damping": 3.0}), "after": after}
    peaks = {}
    for when, design in designs.items():
        peaks[when] = record["checked"][when]["worst"][TORQUE]
        response = jaxhb.solve(design, rpm=peaks[when]["rpm"])
        value = float(response.torque(SHAFT).half_peak_to_peak)
        assert peaks[when]["value"] == pytest.approx(value, rel=1e-9)
        assert peaks[when]["value"] > max(swing[when])
    worst = peaks["after"]
    assert worst["value"] < peaks["before"]["value"]
    # A penalty gives way a little.
    assert record["readings"]["inertia added"]["after"] > -0.0063
    numbers = [step["number"] for step in record["history"]]
    assert numbers == list(range(len(numbers)))
    assert record["solved"]["after"] == [True] * 4
    assert not record["interrupted"]
    assert record["followed"]
    for words in (
        f"{round(worst['value'], -1):.0f} N m at {worst['rpm']:.5g} rpm after",
        "NOT within its limits",
        "pulley.inertia",
        "0.005 to 0.05",
        "at least -0.006",
        "steady states of both designs",
    ):
        assert words in completed.out
    # A linear train does what was tuned.
    checked = record["steady_state"]["after"]
    assert checked["kind"] == ["periodic"] * 4
    assert checked["differences"] == []
    np.testing.assert_allclose(checked["readings"][TORQUE], truth, rtol=1e-9)
    check_what_differs(scene, better)


def check_what_differs(scene, better):
    """The tuned scene differs in a heading and three numbers."""
    old, new = (path.read_text(encoding="utf-8") for path in (scene, better))
    assert tomllib.loads(new)["tune"] == tomllib.loads(TABLE)["tune"]
    lines = [
        line
        for line in difflib.ndiff(old.splitlines(), new.splitlines())
        if line[0] in "+-"
    ]
    removed = [line for line in lines if line[0] == "-"]
    assert removed == ["- inertia = 0.017", "- damping = 2.0", "- damping = 2.0"]
    assert lines[:2] == [f"+ # {scene}, tuned by jaxhb tune.", "+ "]
    assert len(lines) == 8


@pytest.fixture
def stop_at(monkeypatch):
    """Presses Ctrl-C when the progress says something."""

    def stop(words):
        say = Progress.say

        def interrupted(progress, text):
            say(progress, text)
            if words in text:
                raise KeyboardInterrupt

        monkeypatch.setattr(Progress, "say", interrupted)

    return stop


@pytest.mark.slow
def test_ctrl_c_leaves_the_best_design_and_the_history_on_disk(better, tune, stop_at):
    stop_at("step 2: ")
    completed = tune(status=130)
    record = completed.json
    assert "stopped by the user" in completed.out
    assert record["interrupted"]
    assert len(record["history"]) == 3
    inertia = record["history"][-1]["parameters"]["pulley.inertia"]
    assert jaxhb.load_scene(better).value("pulley.inertia") == inertia


def test_ctrl_c_before_the_first_step_leaves_the_speeds_that_are_solved(
    scene, better, tune, stop_at
):
    stop_at("4 of 4 speeds are solved")
    completed = tune(status=130)
    completed.check_printed("tune_stopped_at_the_start")
    assert not better.exists()
    record = completed.json
    assert record == record | {"history": [], "interrupted": True}
    start = record["start"]
    assert start["solved"] == [True] * 4
    truth = swings_of(jaxhb.load_scene(scene), record["rpm"])
    np.testing.assert_allclose(start["readings"][TORQUE], truth, rtol=1e-9)


def test_ctrl_c_before_any_speed_is_solved_leaves_no_file(better, tune, monkeypatch):
    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxhb.design.tuning.tune", stop)
    completed = tune(status=130)
    completed.check_printed("tune_stopped_before_the_start")
    assert not better.exists()
    assert not completed.path("json").exists()


@pytest.mark.slow
def test_the_picture_shows_the_response_before_and_after_and_the_history(scene):
    train = jaxhb.load_scene(scene)
    question = read_table(train)
    result = jaxhb.tune(train, **question)
    above, below = plot_tuning(question["objective"], result).axes
    before, after = (line.get_ydata() for line in above.get_lines())
    digits = 0.5 * 10 ** (1 - DIGITS)
    torque = result.checked["before"].readings[TORQUE]
    np.testing.assert_allclose(1e3 * before, torque, rtol=digits)  # drawn in kN m
    assert after.max() < before.max()
    objectives = [step.objective for step in result.history]
    drawn = below.get_lines()[0].get_ydata()
    np.testing.assert_allclose(drawn, objectives, rtol=digits)


WRONG = reference("cases")["tables of a tuning"]


@pytest.mark.parametrize(
    ("old", "new", "sentence"), WRONG, ids=[new for _, new, _ in WRONG]
)
def test_a_bad_table_is_told_and_nothing_is_written(
    old, new, sentence, scene, tmp_path, tune
):
    replace_in(scene, old, new)
    assert sentence in tune(status=2).err
    assert [path.name for path in tmp_path.iterdir()] == ["scene"]


@pytest.mark.slow
def test_a_limit_that_is_exceeded_is_told_and_tables_lie_beside_the_tuned_scene(
    scene, better, tune
):
    (scene.parent / "data").mkdir()
    name = "six_cylinder_diesel_pressure.csv"
    (scene.parent / name).rename(scene.parent / "data" / name)
    replace_in(scene, f'"{name}"', f'"data/{name}"')
    # At 2166 rpm order 6 is in resonance.
    completed = tune("--steps 1 --rpm 1440,1800,2166,2400")
    assert completed.json["rpm"] == [1440.0, 1800.0, 2166.0, 2400.0]
    _, sentence = completed.out.split("NOT within its limits: ")
    assert f"{TORQUE} is" in sentence
    assert "rpm, at most 5000." in sentence
    topologies = [jaxhb.load_scene(path).topology for path in (better, scene)]
    assert topologies[0] == topologies[1]


def test_another_table_of_the_same_name_is_not_overwritten(tmp_path, tune):
    mine = tmp_path / "six_cylinder_diesel_pressure.csv"
    mine.write_text("mine", encoding="utf-8")
    assert f"is another file than '{mine.name}' of the scene" in tune(status=2).err
    assert mine.read_text(encoding="utf-8") == "mine"


@pytest.mark.slow
def test_a_design_whose_tuned_orbit_is_not_what_the_train_does_is_told():
    """A lightly loaded pair: attracted to one cycle at 4000 rpm, irregular at 6000 rpm,
    where an orbit exists too.
    """
    mesh = "gear a|gear b"
    train = jaxhb.load_scene("spur_pair").replace(
        {"drive.mean": 12.5, "brake.mean": -12.5}
    )
    rpm = np.array([4000.0, 6000.0])
    question = {
        "rpm": rpm,
        "objective": [Objective(quantity="tooth force peak", of=mesh)],
        "parameters": [Parameter(name=f"{mesh}.damping", low=900.0, high=1200.0)],
        "penalties": [],
    }
    result = jaxhb.tune(train, **question, steps=1)
    checked = check_designs(train, question, result)
    assert checked["before"]["kind"] == ["periodic", "irregular"]
    (sentence,) = checked["before"]["differences"]
    state = jaxhb.steady_state(train, rpm=rpm)[1]
    orbit = result.before.readings[f"tooth force peak of {mesh}"][1]
    assert sentence == (
        f"The first design at 6000 rpm is irregular: tooth force peak of {mesh}"
        f" {state.force(mesh).peak / 1e3:.3g} kN instead of {orbit / 1e3:.3g} kN."
    )
    assert sentence in " ".join(check_text(checked).split())

"""``jaxhb tune``: the tuned scene loads, the files say what was done, Ctrl-C leaves the
best so far, bad tables.
"""

import difflib
import tomllib

import numpy as np
import pytest
from reference_data import reference, text_of

import jaxhb
from jaxhb.cli import commands
from jaxhb.design import Objective, Parameter
from jaxhb.design.table import read_table
from jaxhb.report.compute import check_designs
from jaxhb.report.figures.cycle import plot_tuning
from jaxhb.report.figures.figure import DIGITS
from jaxhb.report.text.tuned import check_text
from jaxhb.scene.writer import changed_scene

TABLE = "\n" + text_of("diesel_tune.toml")


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
def tune(scene, tmp_path, run):
    """Runs a tuning; the files lie beside the folder of the scene."""
    return lambda line="", *files: run(
        f"tune {scene} --output {tmp_path / 'better.toml'} {line}", "json", *files
    )


@pytest.mark.slow
def test_the_tuned_scene_loads_and_the_files_say_what_was_done(scene, tmp_path, tune):
    called = tune("--set cyl2.damping=3", "plot")
    assert called.status == 0 and called.is_drawn
    said = called.out
    record = called.json
    before = jaxhb.load_scene(scene)
    after = jaxhb.load_scene(tmp_path / "better.toml")
    assert after.value("cyl2.damping") == 3.0
    for name, found in record["parameters"].items():
        assert found["before"] == pytest.approx(before.value(name), rel=1e-12)
        assert found["after"] == after.value(name) != found["before"]
    assert record["parameters"]["cyl1.damping"]["unit"] == "N m s/rad"
    swing = record["readings"]["shaft torque of cyl6|flywheel"]
    truth = (
        jaxhb.solve_speeds(after, rpm=np.array(record["rpm"]))
        .torque("cyl6|flywheel")
        .half_peak_to_peak
    )
    np.testing.assert_allclose(swing["after"], truth, rtol=1e-9)
    assert swing["unit"] == "N m"
    # Between the speeds lie resonances, which the tuning finds and makes smaller.
    swings = {
        when: record["checked"][when]["worst"]["shaft torque of cyl6|flywheel"]
        for when in ("before", "after")
    }
    for when, design in (
        ("before", before.replace({"cyl2.damping": 3.0})),
        ("after", after),
    ):
        peak = (
            jaxhb.solve(design, rpm=swings[when]["rpm"])
            .torque("cyl6|flywheel")
            .half_peak_to_peak
        )
        assert swings[when]["value"] == pytest.approx(float(peak), rel=1e-9)
        assert swings[when]["value"] > max(swing[when])
    assert swings["after"]["value"] < swings["before"]["value"]
    assert (
        record["readings"]["inertia added"]["after"] > -0.0063
    )  # a penalty gives way a little
    assert [step["number"] for step in record["history"]] == list(
        range(len(record["history"]))
    )
    assert record["solved"]["after"] == [True] * 4 and not record["interrupted"]
    worst = swings["after"]
    assert (
        f"{round(worst['value'], -1):.0f} N m at {worst['rpm']:.5g} rpm after" in said
    )
    assert "NOT within its limits" in said and record["followed"]
    assert (
        "pulley.inertia" in said
        and "0.005 to 0.05" in said
        and "at least -0.006" in said
    )
    # A linear train does what was tuned.
    checked = record["steady_state"]["after"]
    assert (checked["kind"], checked["differences"]) == (["periodic"] * 4, [])
    np.testing.assert_allclose(
        checked["readings"]["shaft torque of cyl6|flywheel"], truth, rtol=1e-9
    )
    assert "Both designs" in said
    old, new = (
        path.read_text(encoding="utf-8") for path in (scene, tmp_path / "better.toml")
    )
    assert tomllib.loads(new)["tune"] == tomllib.loads(TABLE)["tune"]
    lines = [
        line
        for line in difflib.ndiff(old.splitlines(), new.splitlines())
        if line[0] in "+-"
    ]
    assert [line for line in lines if line[0] == "-"] == [
        "- inertia = 0.017",
        "- damping = 2.0",
        "- damping = 2.0",
    ]
    assert lines[:2] == [f"+ # {scene}, tuned by jaxhb tune.", "+ "] and len(lines) == 8


@pytest.mark.slow
def test_ctrl_c_leaves_the_best_design_and_the_history_on_disk(
    tmp_path, tune, monkeypatch
):
    note = commands._TunedFiles.note

    def stop(files, step):
        note(files, step)
        if step.number == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(commands._TunedFiles, "note", stop)
    called = tune()
    record = called.json
    assert called.status == 130 and "stopped by the user" in called.out
    assert record["interrupted"] and len(record["history"]) == 3
    best = record["history"][-1]["parameters"]
    assert (
        jaxhb.load_scene(tmp_path / "better.toml").value("pulley.inertia")
        == best["pulley.inertia"]
    )


@pytest.mark.parametrize("done", [4, 0])
def test_ctrl_c_before_the_first_step_leaves_the_speeds_that_are_solved(
    done, scene, tmp_path, tune, monkeypatch
):
    begin = commands._TunedFiles.begin

    def stop(files, reading):
        if done:
            begin(files, reading)
        raise KeyboardInterrupt

    monkeypatch.setattr(commands._TunedFiles, "begin", stop)
    called = tune()
    assert called.status == 130 and not (tmp_path / "better.toml").exists()
    said = f"{done} of 4 speeds of the scene as it is are solved"
    said += f", and their numbers are in {str(called.path('json'))!r}" * bool(done)
    assert (
        called.err
        == f"stopped; no design is there yet and no scene is written; {said}\n"
    )
    assert called.path("json").exists() == bool(done)
    if done:
        record = called.json
        assert (
            record["history"] == []
            and record["interrupted"]
            and record["start"]["solved"] == [True] * 4
        )
        sweep = jaxhb.solve_speeds(jaxhb.load_scene(scene), rpm=np.array(record["rpm"]))
        truth = sweep.torque("cyl6|flywheel").half_peak_to_peak
        np.testing.assert_allclose(
            record["start"]["readings"]["shaft torque of cyl6|flywheel"],
            truth,
            rtol=1e-9,
        )


@pytest.mark.slow
def test_the_picture_shows_the_response_before_and_after_and_the_history(scene):
    train = jaxhb.load_scene(scene)
    asked = read_table(train)
    result = jaxhb.tune(train, **asked)
    above, below = plot_tuning(asked["objective"], result).axes
    before, after = (line.get_ydata() for line in above.get_lines())
    digits = 0.5 * 10 ** (1 - DIGITS)
    torque = result.checked["before"].readings["shaft torque of cyl6|flywheel"]
    np.testing.assert_allclose(1e3 * before, torque, rtol=digits)  # drawn in kN m
    assert after.max() < before.max()
    wanted = [step.objective for step in result.history]
    np.testing.assert_allclose(below.get_lines()[0].get_ydata(), wanted, rtol=digits)


WRONG = reference("cases")["tables of a tuning"]


@pytest.mark.parametrize(
    ("old", "new", "sentence"), WRONG, ids=[new for _, new, _ in WRONG]
)
def test_a_bad_table_is_told_and_nothing_is_written(
    old, new, sentence, scene, tmp_path, tune
):
    scene.write_text(
        scene.read_text(encoding="utf-8").replace(old, new), encoding="utf-8"
    )
    called = tune()
    assert called.status == 2 and sentence in called.err
    assert [path.name for path in tmp_path.iterdir()] == ["scene"]


@pytest.mark.slow
def test_a_limit_that_is_exceeded_is_told_and_a_folder_of_tables_is_made_beside_the_tuned_scene(
    scene, tmp_path, tune
):
    (scene.parent / "data").mkdir()
    name = "six_cylinder_diesel_pressure.csv"
    (scene.parent / name).rename(scene.parent / "data" / name)
    scene.write_text(
        scene.read_text(encoding="utf-8").replace(f'"{name}"', f'"data/{name}"'),
        encoding="utf-8",
    )
    called = tune(
        "--steps 1 --rpm 1440,1800,2166,2400"
    )  # at 2166 rpm order 6 is in resonance
    assert called.status == 0 and called.json["rpm"] == [1440.0, 1800.0, 2166.0, 2400.0]
    told = called.out[called.out.index("NOT within its limits: ") :]
    assert "shaft torque of cyl6|flywheel is" in told and "rpm, at most 5000." in told
    assert (
        jaxhb.load_scene(tmp_path / "better.toml").topology
        == jaxhb.load_scene(scene).topology
    )


def test_another_table_of_the_same_name_is_not_overwritten(tmp_path, tune):
    mine = tmp_path / "six_cylinder_diesel_pressure.csv"
    mine.write_text("mine", encoding="utf-8")
    called = tune()
    assert called.status == 2
    assert f"is another file than '{mine.name}' of the scene" in called.err
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
    asked = {
        "rpm": np.array([4000.0, 6000.0]),
        "objective": [Objective(quantity="tooth force peak", of=mesh)],
    }
    asked |= {
        "parameters": [Parameter(name=f"{mesh}.damping", low=900.0, high=1200.0)],
        "penalties": [],
    }
    result = jaxhb.tune(train, **asked, steps=1)
    found = check_designs(train, asked, result)
    state = jaxhb.steady_state(train, rpm=asked["rpm"])[1]
    orbit = result.before.readings[f"tooth force peak of {mesh}"][1]
    assert found["before"]["kind"] == ["periodic", "irregular"]
    (said,) = found["before"]["differences"]
    forces = f"{state.force(mesh).peak / 1e3:.3g} kN instead of {orbit / 1e3:.3g} kN."
    assert (
        said == f"The first design at 6000 rpm is irregular: tooth force peak of {mesh}"
        f" {forces}"
    )
    assert said in " ".join(check_text(found).split())

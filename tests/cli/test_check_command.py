"""``jaxhb new`` writes a scene to begin with; ``jaxhb check`` and the answers tell what
is far from usual, once.
"""

import tomllib

import numpy as np
import pytest

import jaxhb
from jaxhb.scene.writer import scene_text
from jaxhb.train.kinematics import tooth_damping_ratios

ENGINE = "inline_four_timing_drive"
NOTE = (
    "[[mesh]] 'gear a|gear b': backlash is 0.002 m, usual 2e-5 to 0.001 m: is it in m,"
    " not in mm?"
)
TWO = (
    '[[disk]]\nname = "a"\ninertia = 1\n[[disk]]\nname = "b"\ninertia ='
    ' 1\n[[shaft]]\nbetween = ["a", "b"]\n'
)


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_a_scene_to_begin_with_is_written_and_has_nothing_to_note(here, run):
    assert (
        run("new 'my engine.toml'").out
        == "my engine.toml is written.\nTry: jaxhb check 'my engine.toml'\n"
    )
    text = (here / "my engine.toml").read_text(encoding="utf-8")
    assert tomllib.loads(text)["scene"]["name"] == "my engine" and text.count("#") > 40
    counted = (
        "5 disks, 2 rotors, 3 shafts, 1 mesh (1 with backlash), 1 damper, 1 cylinder;"
    )
    assert run("check 'my engine.toml'").words.startswith(
        f"my engine: {counted} nothing to note."
    )


def test_a_copy_has_the_tables_and_the_comments_of_its_scene(here, run):
    said = run(f"new four.toml --from {ENGINE}").out
    table = f"{ENGINE}_pressure.csv"
    assert sorted(path.name for path in here.iterdir()) == ["four.toml", table]
    assert said.splitlines()[:2] == ["four.toml is written.", f"{table} is written."]
    copy = jaxhb.load_scene("four.toml")
    train = jaxhb.load_scene(ENGINE)
    assert copy.topology.name == "four" and np.array_equal(
        copy.cylinders.pressure, train.cylinders.pressure
    )
    assert "# m: four times 0.499 litres" in (here / "four.toml").read_text(
        encoding="utf-8"
    )


def test_nothing_is_overwritten(here, run):
    files = here / "mine.toml", here / "spur_pair_omega_squared.csv"
    for file in files:
        file.write_text("mine")
    called = run("new mine.toml")
    assert (
        called.status == 2
        and "FILE: 'mine.toml' is there already, and is not overwritten." in called.err
    )
    called = run("new other.toml --from spur_pair")
    assert (
        called.status == 2
        and "'spur_pair_omega_squared.csv' is another file than" in called.err
    )
    assert {path: path.read_text() for path in here.iterdir()} == dict.fromkeys(
        files, "mine"
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", jaxhb.scene_names())
def test_there_is_nothing_to_note_on_a_packaged_scene_and_its_loads(name, told):
    assert told(f"check {name}", "json").json["notes"] == []


def test_check_tells_torques_tooth_forces_and_damping(run):
    called = run(f"check {ENGINE}", "json")
    text = called.words
    record = called.json
    train = jaxhb.load_scene(ENGINE)
    assert (
        "15 disks, 4 rotors, 11 shafts, 3 meshes (3 with backlash), 1 damper, 4"
        " cylinders; nothing to note." in text
    )
    assert record["notes"] == [] and record["scene"] == ENGINE
    assert record["mean_torque_Nm"]["pump plungers"] == [-20.0]
    # statics: the pump and the camshaft turn at half speed, the load takes what is left
    # of the gas torque
    gas = [record["mean_torque_Nm"][f"cylinder {k}"][0] for k in (1, 2, 3, 4)]
    assert record["mean_torque_Nm"]["vehicle:load"] == [
        pytest.approx(-sum(gas) + 14.0, rel=1e-9)
    ]
    force = {name: mesh["mean_force"][0] for name, mesh in record["meshes"].items()}
    assert force["idler|pump gear"] == pytest.approx(20.0 / 0.075, rel=1e-9)
    assert force["crank gear|idler"] == pytest.approx(28.0 / 0.075, rel=1e-9)
    ratios = [mesh["damping_ratio"] for mesh in record["meshes"].values()]
    np.testing.assert_allclose(ratios, tooth_damping_ratios(train), rtol=1e-12)
    assert (
        "crank gear|idler 0.3733 crank gear 0.1 0.0570" in text
        and "cylinder 1 throw 1 93.6" in text
    )
    assert (
        record["modes"]["frequencies_hz"]
        == jaxhb.natural_frequencies(train).frequencies_hz.tolist()
    )
    assert "5 386.11 23167 4 0.0435 4 pulley +1.00" in text


@pytest.mark.slow
def test_check_takes_the_ends_of_what_the_scene_gives_over_the_speed(told):
    record, one = (
        told(f"check gear_train_30 {rpm}", "json").json for rpm in ("", "--rpm 1800")
    )
    assert record["mean_torque_Nm"]["load:load"] == pytest.approx(
        [-778, -4761], abs=0.5
    )
    assert one["mean_torque_Nm"]["load:load"] == pytest.approx([-2317], abs=0.5)


@pytest.mark.slow
def test_a_load_that_drives_is_noted_with_its_torque_and_a_motor_given_as_a_load_is_not(
    here, run
):
    run(f"new four.toml --from {ENGINE}")
    path = here / "four.toml"
    path.write_text(
        path.read_text().replace("table_firing_tdc = 0.0", "table_firing_tdc = 180.0")
    )
    pressure, load = run("check four.toml", "json").json["notes"]
    assert "169 deg" in pressure and load.startswith(
        "[[load]] 'vehicle:load': it drives the train with 285.8 N m, "
    )
    mill = (
        f'{TWO}stiffness = 1e4\n[[load]]\ndisk = "a"\n[[torque]]\ndisk = "b"\nmean ='
        " -50.0\n"
    )
    (here / "mill.toml").write_text(mill)
    record = run("check mill.toml", "json").json
    assert record["notes"] == [] and record["mean_torque_Nm"]["a:load"] == [50.0]


def test_check_of_links_that_vary_says_what_it_lacks(here, run):
    (here / "rubber.toml").write_text(
        f"{TWO}stiffness = 1e4\nover_hz = [[0, 1, 1], [100, 2, 1]]\n"
    )
    assert (
        "Links vary: natural frequencies need --links-at, as hz=30."
        in run("check rubber.toml").words
    )
    assert (
        f"{np.sqrt(4e4) / (2 * np.pi):.2f}"
        in run("check rubber.toml --links-at hz=100").words
    )


@pytest.mark.slow
def test_check_tells_what_a_tuning_would_refuse(here, run):
    text = scene_text("first_scene")[0].replace(
        'of = "crank gear|pump gear"', 'of = "crank gear|pump"'
    )
    (here / "wrong.toml").write_text(text, encoding="utf-8")
    called = run("check wrong.toml", "json")
    (note,) = called.json["notes"]
    assert (
        "jaxhb tune" in note
        and "no mesh 'crank gear|pump'" in note
        and note in called.words
    )


@pytest.mark.parametrize("command", ["solve", "sweep", "report"])
def test_the_notes_on_the_scene_are_told_once(command, run):
    called = run(
        f"{command} spur_pair --rpm 2000 --set 'gear a|gear b.backlash=0.002'", "json"
    )
    assert called.words.count("backlash is 0.002 m") == 1 and called.json[
        "scene_notes"
    ] == [NOTE]
    assert (
        called.path("json").read_text(encoding="utf-8").count("backlash is 0.002 m")
        == 1
    )

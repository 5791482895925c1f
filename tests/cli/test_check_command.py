"""``jaxhb new`` writes a scene to begin with; ``jaxhb check`` and the answers tell what is far from usual, once."""

import doctest
import json
import tomllib

import numpy as np
import pytest

import jaxhb
from jaxhb.cli.main import main
from jaxhb.equations.kinematics import tooth_damping_ratios
from jaxhb.report.text import scene_check
from jaxhb.scene.writer import scene_text

ENGINE = "inline_four_timing_drive"
NOTE = "[[mesh]] 'gear a|gear b': backlash is 0.002 m, usual 2e-5 to 0.001 m: is it in m, not in mm?"


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def said(capsys):
    """What was printed, on one line."""
    return " ".join(capsys.readouterr().out.split())


def test_a_scene_to_begin_with_is_written_and_has_nothing_to_note(here, capsys):
    assert main(["new", "my engine.toml"]) == 0
    assert capsys.readouterr().out == "my engine.toml is written.\nTry: jaxhb check 'my engine.toml'\n"
    text = (here / "my engine.toml").read_text(encoding="utf-8")
    assert tomllib.loads(text)["scene"]["name"] == "my engine" and text.count("#") > 40
    assert main(["check", "my engine.toml"]) == 0
    assert said(capsys).startswith(
        "my engine: 5 disks, 2 rotors, 3 shafts, 1 mesh (1 with backlash), 1 damper, 1 cylinder;"
    )


def test_a_copy_has_the_tables_and_the_comments_of_its_scene(here, capsys):
    assert main(["new", "four.toml", "--from", ENGINE]) == 0
    table = f"{ENGINE}_pressure.csv"
    assert sorted(path.name for path in here.iterdir()) == ["four.toml", table]
    assert capsys.readouterr().out.splitlines()[:2] == ["four.toml is written.", f"{table} is written."]
    copy, train = jaxhb.load_scene("four.toml"), jaxhb.load_scene(ENGINE)
    assert copy.topology.name == "four" and np.array_equal(copy.cylinders.pressure, train.cylinders.pressure)
    assert "# m: four times 0.499 litres" in (here / "four.toml").read_text(encoding="utf-8")


def test_nothing_is_overwritten(here, capsys):
    (here / "mine.toml").write_text("mine")
    (here / "spur_pair_omega_squared.csv").write_text("mine")
    assert main(["new", "mine.toml"]) == 2
    assert capsys.readouterr().err == "FILE: 'mine.toml' is there already, and is not overwritten. Give another name.\n"
    assert main(["new", "other.toml", "--from", "spur_pair"]) == 2
    assert "'spur_pair_omega_squared.csv' is another file than" in capsys.readouterr().err
    assert {path.name: path.read_text() for path in here.iterdir()} == {
        "mine.toml": "mine",
        "spur_pair_omega_squared.csv": "mine",
    }


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        (["engine"], "FILE: 'engine' is no scene. Give a name that ends in .toml."),
        (["no/engine.toml"], "FILE: there is no folder"),
        (["engine.toml", "--from", "inline_four"], "there is no packaged scene 'inline_four'. Did you mean"),
    ],
)
def test_what_cannot_be_written_or_copied_is_refused(arguments, sentence, here, capsys):
    assert main(["new", *arguments]) == 2
    assert sentence in capsys.readouterr().err and not list(here.iterdir())


@pytest.mark.parametrize("name", jaxhb.scene_names())
def test_there_is_nothing_to_note_on_a_packaged_scene_and_its_loads(name, capsys):
    assert main(["check", name]) == 0
    assert "nothing to note" in said(capsys)


def test_check_tells_torques_tooth_forces_and_damping(here, capsys):
    assert main(["check", ENGINE, "--json", "check.json"]) == 0
    text, record = said(capsys), json.loads((here / "check.json").read_text(encoding="utf-8"))
    train = jaxhb.load_scene(ENGINE)
    assert "15 disks, 4 rotors, 11 shafts, 3 meshes (3 with backlash), 1 damper, 4 cylinders; nothing to note." in text
    assert record["notes"] == [] and record["scene"] == ENGINE
    assert record["mean_torque_Nm"]["pump plungers"] == [-20.0]
    # statics: the pump and the camshaft turn at half speed, the load takes what is left of the gas torque
    gas = [record["mean_torque_Nm"][f"cylinder {k}"][0] for k in (1, 2, 3, 4)]
    assert record["mean_torque_Nm"]["vehicle:load"] == [pytest.approx(-sum(gas) + 14.0, rel=1e-9)]
    force = {name: mesh["mean_force"][0] for name, mesh in record["meshes"].items()}
    assert force["idler|pump gear"] == pytest.approx(20.0 / 0.075, rel=1e-9)
    assert force["crank gear|idler"] == pytest.approx(28.0 / 0.075, rel=1e-9)
    ratios = [mesh["damping_ratio"] for mesh in record["meshes"].values()]
    np.testing.assert_allclose(ratios, tooth_damping_ratios(train), rtol=1e-12)
    assert "crank gear|idler 0.3733 0.1 0.0570" in text and "cylinder 1 throw 1 93.6" in text
    modes = jaxhb.natural_frequencies(train)
    assert record["modes"]["frequencies_hz"] == modes.frequencies_hz.tolist()
    assert "5 386.11 23167 4 0.0435 4 pulley +1.00" in text


def test_check_takes_the_ends_of_what_the_scene_gives_over_the_speed(capsys):
    assert main(["check", "gear_train_30"]) == 0
    assert "at 600 rpm at 2450 rpm" in (text := said(capsys)) and "load:load load -778 -4761" in text
    assert main(["check", "gear_train_30", "--rpm", "1800"]) == 0
    assert "load:load load -2317" in said(capsys)


def test_a_load_that_drives_is_noted_with_its_torque(here, capsys):
    assert main(["new", "four.toml", "--from", ENGINE]) == 0
    path = here / "four.toml"
    path.write_text(path.read_text().replace("table_firing_tdc = 0.0", "table_firing_tdc = 180.0"))
    capsys.readouterr()
    assert main(["check", "four.toml"]) == 0
    text = said(capsys)
    assert "2 notes below." in text and "the pressure is largest 169 deg before firing top dead centre" in text
    assert "[[load]] 'vehicle:load': it drives the train with 285.8 N m, usual below 0, as a load takes power" in text


def test_a_motor_given_as_a_load_is_not_noted(here, capsys):
    text = '[[disk]]\nname = "motor"\ninertia = 1\n[[disk]]\nname = "mill"\ninertia = 1\n'
    text += '[[shaft]]\nbetween = ["motor", "mill"]\nstiffness = 1e4\n[[load]]\ndisk = "motor"\n'
    (here / "mill.toml").write_text(text + '[[torque]]\ndisk = "mill"\nmean = -50.0\n')
    assert main(["check", "mill.toml"]) == 0
    text = said(capsys)
    assert "nothing to note" in text and "motor:load motor 50" in text


def test_check_of_links_that_vary_says_what_it_lacks(here, capsys):
    text = '[[disk]]\nname = "a"\ninertia = 1\n[[disk]]\nname = "b"\ninertia = 1\n[[shaft]]\nbetween = ["a", "b"]\n'
    (here / "rubber.toml").write_text(text + "stiffness = 1e4\nover_hz = [[0, 1, 1], [100, 2, 1]]\n")
    assert main(["check", "rubber.toml"]) == 0
    assert "Links vary: natural frequencies need --links-at, as hz=30." in said(capsys)
    assert main(["check", "rubber.toml", "--links-at", "hz=100"]) == 0
    assert f"{np.sqrt(4e4) / (2 * np.pi):.2f}" in said(capsys)


def test_check_tells_what_a_tuning_would_refuse(here, capsys):
    text = scene_text("first_scene")[0].replace('of = "crank gear|pump gear"', 'of = "crank gear|pump"')
    (here / "wrong.toml").write_text(text, encoding="utf-8")
    assert main(["check", "wrong.toml"]) == 0
    words = said(capsys)
    assert "; 1 note below." in words
    assert "jaxhb tune will refuse this scene: wrong, objective" in words.replace(" first_scene,", " wrong,")
    assert "there is no mesh 'crank gear|pump'. Did you mean 'crank gear|pump gear'?" in words


def test_solve_sweep_and_report_tell_the_notes_on_the_scene_once(here, capsys):
    wide = ["--set", "gear a|gear b.backlash=0.002", "--json", "r.json"]
    for command in (["solve", "--rpm", "2000"], ["sweep", "--rpm", "1900,2000"], ["report", "--rpm", "1900,2000"]):
        assert main([command[0], "spur_pair", *command[1:], *wide]) == 0
        text, file = said(capsys), (here / "r.json").read_text(encoding="utf-8")
        assert text.count("backlash is 0.002 m") == 1 and file.count("backlash is 0.002 m") == 1
        assert json.loads(file)["scene_notes"] == [NOTE]


def test_the_examples_of_the_check_hold():
    failures, tests = doctest.testmod(scene_check)
    assert tests and not failures
